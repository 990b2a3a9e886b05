//! Weights of particles, kept as logarithms: the report's exp(corr) of a thousand hits is no
//! number that a float can hold.

/// Scales log weights so that the weights sum to one, and returns the weights.
///
/// Where no weight is finite all become equal.
pub fn normalise(log_weights: &mut [f64]) -> Vec<f64> {
    let largest = log_weights.iter().copied().filter(|w| !w.is_nan()).fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        log_weights.fill(-(log_weights.len() as f64).ln());
    } else {
        for weight in log_weights.iter_mut().filter(|weight| weight.is_nan()) {
            *weight = f64::NEG_INFINITY;
        }
        let total: f64 = log_weights.iter().map(|weight| (weight - largest).exp()).sum();
        let shift = largest + total.ln();
        log_weights.iter_mut().for_each(|weight| *weight -= shift);
    }
    log_weights.iter().map(|weight| weight.exp()).collect()
}

/// The effective number of particles, 1 / Σ w² (report eq. 22).
#[must_use]
pub fn effective_number(weights: &[f64]) -> f64 {
    weights.iter().map(|weight| weight * weight).sum::<f64>().recip()
}

/// The index of the largest weight; the first of equals.
#[must_use]
pub fn heaviest(weights: &[f64]) -> usize {
    let mut best = 0;
    for (index, weight) in weights.iter().enumerate() {
        if *weight > weights[best] {
            best = index;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_thousand_hits_are_no_infinity() {
        let mut log_weights = [1000.0, 999.0, -2000.0];
        let weights = normalise(&mut log_weights);
        assert!((weights[0] / weights[1] - 1.0_f64.exp()).abs() < 1e-9);
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn weights_that_say_nothing_become_equal() {
        for mut bad in [[f64::NEG_INFINITY; 4], [f64::NAN; 4]] {
            assert_eq!(normalise(&mut bad), [0.25; 4]);
        }
    }

    proptest! {
        #[test]
        fn weights_sum_to_one_and_the_effective_number_is_between_one_and_all(
            mut log_weights in prop::collection::vec(-1e4..1e4_f64, 1..50)
        ) {
            let weights = normalise(&mut log_weights);
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            let effective = effective_number(&weights);
            prop_assert!(effective >= 1.0 - 1e-9 && effective <= weights.len() as f64 + 1e-9);
        }
    }
}
