//! What cannot be simulated.

use super::World;

/// Why there is no simulation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// No world has that name.
    #[error("there is no world \"{name}\"{suggestion}; the worlds are {known}")]
    UnknownWorld {
        /// The name that was asked for.
        name: String,
        /// The most similar name, as the end of a sentence, or nothing.
        suggestion: String,
        /// All names.
        known: String,
    },
    /// A setting is out of its bounds.
    #[error("simulation setting {key} = {found}: expected {expected}")]
    InvalidSetting {
        /// The setting.
        key: &'static str,
        /// Its value.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
}

impl SimulationError {
    pub(super) fn unknown_world(name: &str) -> Self {
        let similarity = |known: &&str| strsim::jaro_winkler(name, known);
        let nearest = World::names().max_by(|a, b| similarity(a).total_cmp(&similarity(b)));
        let nearest = nearest.filter(|known| similarity(known) > 0.8);
        Self::UnknownWorld {
            name: name.to_owned(),
            suggestion: nearest.map(|known| format!(" (did you mean \"{known}\"?)")).unwrap_or_default(),
            known: World::names().collect::<Vec<_>>().join(", "),
        }
    }
}
