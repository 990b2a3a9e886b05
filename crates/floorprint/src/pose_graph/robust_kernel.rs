//! Robust kernels: how much a factor counts, given how badly it fits.

use serde::{Deserialize, Serialize};

/// A function ρ of a factor's squared Mahalanobis error s. The factor costs ½ ρ(s), and
/// the optimiser weights it with ρ′(s) (iteratively reweighted least squares).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RobustKernel {
    /// ρ(s) = s: the factor is trusted whatever it says.
    #[default]
    Quadratic,
    /// Quadratic up to errors of `threshold` standard deviations, linear beyond (Huber 1964).
    Huber {
        /// Standard deviations.
        threshold: f64,
    },
    /// ρ(s) = c² ln(1 + s/c²).
    Cauchy {
        /// c, standard deviations.
        scale: f64,
    },
    /// ρ(s) = c² s / (c² + s): what fits badly costs no more than c² (Geman & McClure 1987).
    GemanMcClure {
        /// c, standard deviations.
        scale: f64,
    },
    /// Dynamic covariance scaling (Agarwal et al. 2013): the information is multiplied by
    /// min(1, 2Φ/(Φ + s))². Bounded, and quadratic up to Φ. In the form of
    /// an M-estimator by MacTavish & Barfoot (2015).
    DynamicCovarianceScaling {
        /// Φ, squared standard deviations.
        phi: f64,
    },
}

impl RobustKernel {
    /// ρ(s).
    #[must_use]
    pub fn cost(&self, s: f64) -> f64 {
        match *self {
            Self::Quadratic => s,
            Self::Huber { threshold } if s <= threshold * threshold => s,
            Self::Huber { threshold } => 2.0 * threshold * s.sqrt() - threshold * threshold,
            Self::Cauchy { scale } => scale * scale * (s / (scale * scale)).ln_1p(),
            Self::GemanMcClure { scale } => scale * scale * s / (scale * scale + s),
            Self::DynamicCovarianceScaling { phi } if s <= phi => s,
            Self::DynamicCovarianceScaling { phi } => 4.0 * phi * s / (phi + s) - phi,
        }
    }

    /// ρ′(s): 1 where the factor is fully trusted, towards 0 where it is rejected.
    #[must_use]
    pub fn weight(&self, s: f64) -> f64 {
        match *self {
            Self::Quadratic => 1.0,
            Self::Huber { threshold } if s <= threshold * threshold => 1.0,
            Self::Huber { threshold } => threshold / s.sqrt(),
            Self::Cauchy { scale } => scale * scale / (scale * scale + s),
            Self::GemanMcClure { scale } => (scale * scale / (scale * scale + s)).powi(2),
            Self::DynamicCovarianceScaling { phi } => (2.0 * phi / (phi + s)).min(1.0).powi(2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_weight_is_the_slope_of_the_cost(s in 0.01..50.0_f64, scale in 0.5..4.0_f64) {
            for kernel in [
                RobustKernel::Quadratic,
                RobustKernel::Huber { threshold: scale },
                RobustKernel::Cauchy { scale },
                RobustKernel::GemanMcClure { scale },
                RobustKernel::DynamicCovarianceScaling { phi: scale },
            ] {
                let step = 1e-5;
                let slope = (kernel.cost(s + step) - kernel.cost(s - step)) / (2.0 * step);
                prop_assert!((slope - kernel.weight(s)).abs() < 1e-4, "{kernel:?}: {slope}");
                prop_assert!(kernel.cost(s) <= s + 1e-12 && kernel.weight(s) <= 1.0);
                prop_assert_eq!(kernel.cost(0.0), 0.0);
            }
        }
    }
}
