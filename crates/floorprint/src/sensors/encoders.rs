//! Wheel encoders of a differential or skid-steered drive.

/// Ticks since the previous reading, left and right.
///
/// Robots with several wheels a side give the mean of that side. Cumulative
/// counters are turned into increments by the reader; the first increment is zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncoderReading {
    /// Time of the reading, seconds.
    pub stamp_s: f64,
    /// Ticks of the left side since the previous reading; positive forward.
    pub left_ticks: f64,
    /// Ticks of the right side since the previous reading; positive forward.
    pub right_ticks: f64,
}
