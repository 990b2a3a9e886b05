//! Mean, spread and worst of a set of error magnitudes.

use serde::Serialize;

/// Summary of non-negative errors, in the unit of the errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorStatistics {
    /// How many errors were summarised.
    pub count: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation about the mean, over the whole set (divided by the count).
    pub std: f64,
    /// Root of the mean square.
    pub rmse: f64,
    /// The middle value; the mean of the two middle values of an even count.
    pub median: f64,
    /// The largest error.
    pub max: f64,
}

impl ErrorStatistics {
    /// Summarises `errors`; `None` when there is none.
    #[must_use]
    pub fn of(errors: &[f64]) -> Option<Self> {
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        let max = *sorted.last()?;
        let count = sorted.len();
        let mean = sorted.iter().sum::<f64>() / count as f64;
        let mean_square = sorted.iter().map(|e| e * e).sum::<f64>() / count as f64;
        let variance = sorted.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / count as f64;
        let median = (sorted[(count - 1) / 2] + sorted[count / 2]) / 2.0;
        Some(Self { count, mean, std: variance.sqrt(), rmse: mean_square.sqrt(), median, max })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_small_set_by_hand() {
        let found = ErrorStatistics::of(&[4.0, 0.0, 2.0, 2.0]).unwrap();
        assert_eq!((found.count, found.mean, found.median, found.max), (4, 2.0, 2.0, 4.0));
        assert!((found.std - 2.0_f64.sqrt()).abs() < 1e-12);
        assert!((found.rmse - 6.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(ErrorStatistics::of(&[]), None);
    }

    proptest! {
        #[test]
        fn the_square_of_the_rmse_is_mean_square_plus_variance(errors in prop::collection::vec(0.0..10.0_f64, 1..50)) {
            let found = ErrorStatistics::of(&errors).unwrap();
            prop_assert!((found.rmse.powi(2) - found.mean.powi(2) - found.std.powi(2)).abs() < 1e-9);
            prop_assert!(found.median <= found.max && found.mean <= found.rmse + 1e-12);
        }
    }
}
