//! What fits and misfits are worth, as log-likelihoods.

use super::place_match::Placement;

/// What a fit is worth: log-likelihood per unit by which it is better than a fit by chance and than places farther on.
const EVIDENCE_PER_QUALITY: f64 = 20.0;
const CHANCE_QUALITY: f64 = 0.8;
/// The same of each further older submap that agrees: it shows much of what the first does. Up to so many count.
pub(super) const EVIDENCE_OF_WITNESS: f64 = 3.5;
pub(super) const MOST_WITNESSES: usize = 4;
/// What it is worth when another place on the same older submap fits better: the same surfaces are compared.
pub(super) const EVIDENCE_PER_DEFICIT: f64 = 60.0;
/// What moves a submap against where it was thought to be must fit so much better than farther on: along a bare corridor a
/// submap fits anywhere.
const LEAST_DISTINCTNESS: f64 = 0.05;
/// What it counts not to be recognised.
pub(super) const MISS_EVIDENCE: f64 = 2.0;

impl Placement {
    /// By how much it fits better than a wrong place would.
    pub(super) fn surplus(&self) -> f64 {
        (self.quality() - CHANCE_QUALITY).min(self.distinctness).max(0.0)
    }

    /// Whether the fit is worth enough to move anything.
    pub(super) fn is_conclusive(&self) -> bool {
        self.distinctness > LEAST_DISTINCTNESS
    }
}

/// What a fit is worth that is so much better than a wrong one would be, and so much worse than another on the same
/// older submap; log-likelihood.
pub(super) fn fit_evidence(surplus: f64, deficit: f64) -> f64 {
    EVIDENCE_PER_QUALITY * surplus - EVIDENCE_PER_DEFICIT * deficit
}
