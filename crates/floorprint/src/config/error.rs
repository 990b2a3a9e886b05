//! What can be wrong with a configuration.

use thiserror::Error;

/// A configuration that cannot be used: where, what was found, what was expected.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ConfigError {
    /// A layer is not TOML.
    #[error("{place}: not valid TOML: {message}")]
    Syntax {
        /// Layer and line.
        place: String,
        /// What the TOML parser says.
        message: String,
    },
    /// A single setting is not of the form `KEY=VALUE`.
    #[error("--set {0}: expected KEY=VALUE, for example --set filter.particles=60")]
    Setting(String),
    /// An option that does not exist.
    #[error("{place}: there is no option `{key}`{hint}")]
    UnknownKey {
        /// Layer and line.
        place: String,
        /// The key as written.
        key: String,
        /// What to do: the nearest option, or how to list them all.
        hint: String,
    },
    /// A value of the wrong type or out of range.
    #[error("{place}: `{key}` is {found}, expected {expected}{hint}")]
    BadValue {
        /// Layer and line.
        place: String,
        /// The option.
        key: String,
        /// The value as written.
        found: String,
        /// What the option takes.
        expected: String,
        /// The nearest choice, where there is one.
        hint: String,
    },
    /// A preset that does not exist.
    #[error("there is no preset `{name}`{hint}; there are {known}")]
    UnknownPreset {
        /// The name as given.
        name: String,
        /// The nearest preset, where there is one.
        hint: String,
        /// All presets.
        known: String,
    },
    /// A section that misses a value without a default.
    #[error("the configuration is incomplete: {0}")]
    Incomplete(String),
    /// Options that contradict each other.
    #[error("{0}")]
    Contradiction(String),
}

/// ` (did you mean …?)` for the candidate most like `word`, or nothing when none is near.
pub(super) fn did_you_mean<'a>(word: &str, candidates: impl Iterator<Item = &'a str>, quote: char) -> String {
    nearest(word, candidates).map(|best| format!(" (did you mean {quote}{best}{quote}?)")).unwrap_or_default()
}

/// The candidate most like `word`; the first of equals.
pub(super) fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    /// Jaro-Winkler similarity below which two words have nothing to do with each other.
    const LEAST_SIMILARITY: f64 = 0.8;
    let mut best = None;
    for candidate in candidates {
        let similarity = strsim::jaro_winkler(word, candidate);
        if similarity >= LEAST_SIMILARITY && best.is_none_or(|(most, _)| similarity > most) {
            best = Some((similarity, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}
