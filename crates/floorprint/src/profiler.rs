//! Where time goes, without a clock in the library.

/// A stage of the work whose time is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Reading and decoding the input.
    Read,
    /// Building frames: odometry, synchronisation, projection of the scan.
    Synchronise,
    /// Moving the particles.
    Predict,
    /// Matching the scan against the map and weighting the particles.
    Match,
    /// Resampling.
    Resample,
    /// Writing the scan into the map.
    Map,
    /// Loop search and graph optimisation.
    LoopClosure,
    /// Painting the floor.
    Texture,
    /// Comparing the results with the truth.
    Evaluate,
    /// Writing the results.
    Write,
}

/// Told when a phase begins; whoever has a clock implements it.
pub trait Profiler {
    /// From now on time counts for `phase`.
    fn enter(&mut self, phase: Phase);

    /// The work on a frame is done; until the next [`enter`](Self::enter) nothing is worked on.
    fn end_of_frame(&mut self) {}
}

/// Measures nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoProfiler;

impl Profiler for NoProfiler {
    fn enter(&mut self, _phase: Phase) {}
}
