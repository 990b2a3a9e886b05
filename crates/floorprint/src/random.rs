//! Counter-based randomness: every generator is keyed by what it is for.
//!
//! A generator is made from (seed, stage, step, particle) and nothing else, so
//! neither the order of the calls nor the number of threads can change a draw.

use rand_pcg::Pcg64Mcg;

/// What random numbers are drawn for. Two stages never share a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum Stage {
    /// Motion noise of the particles.
    Motion = 1,
    /// The offsets of a resampling step.
    Resampling = 2,
    /// Samples of a measurement-driven proposal.
    Proposal = 3,
    /// The particles' first poses.
    Initialisation = 4,
    /// Building a simulated world.
    World = 5,
    /// Errors of simulated sensors.
    Sensors = 6,
    /// Random sample consensus of the floor plane.
    FloorPlane = 7,
    /// Delays of records on their way.
    Arrival = 8,
}

/// The generator for `particle` at `step` of `stage`.
#[must_use]
pub fn generator(seed: u64, stage: Stage, step: u64, particle: u64) -> Pcg64Mcg {
    let mut high = mix(seed ^ 0x9e37_79b9_7f4a_7c15);
    high = mix(high ^ (stage as u64));
    high = mix(high ^ step);
    let low = mix(high ^ particle.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(1));
    Pcg64Mcg::new((u128::from(high) << 64) | u128::from(low))
}

/// SplitMix64's finaliser (Steele, Lea & Flood 2014): every input bit reaches every output bit.
fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn equal_keys_give_equal_streams_and_other_keys_other_streams() {
        let first = |seed, stage, step, particle| generator(seed, stage, step, particle).next_u64();
        assert_eq!(first(1, Stage::Motion, 2, 3), first(1, Stage::Motion, 2, 3));
        let mut seen = std::collections::BTreeSet::new();
        for seed in 0..8 {
            for stage in [Stage::Motion, Stage::Resampling, Stage::Proposal] {
                for step in 0..8 {
                    for particle in 0..8 {
                        assert!(seen.insert(first(seed, stage, step, particle)));
                    }
                }
            }
        }
    }
}
