//! Named configurations that come with the program.

use super::error::did_you_mean;
use super::{ConfigError, Layer};
use std::str::FromStr;

/// A named configuration: what it sets is a TOML file in `presets/`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Preset {
    /// The best map for most drives; what the defaults in code are.
    #[default]
    Default,
    /// The fewest computations that still give a good map.
    Fast,
    /// The best poses that the data allow, at about twice the cost.
    Accurate,
    /// The report to the letter.
    Seed,
    /// The algorithm of Grisetti, Stachniss & Burgard 2007, for comparison.
    Gmapping,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 5] = [Self::Default, Self::Fast, Self::Accurate, Self::Seed, Self::Gmapping];

    /// The name by which users call it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Fast => "fast",
            Self::Accurate => "accurate",
            Self::Seed => "seed",
            Self::Gmapping => "gmapping",
        }
    }

    /// Its TOML file; the comments say what it is for.
    #[must_use]
    pub const fn toml(self) -> &'static str {
        match self {
            Self::Default => include_str!("../../presets/default.toml"),
            Self::Fast => include_str!("../../presets/fast.toml"),
            Self::Accurate => include_str!("../../presets/accurate.toml"),
            Self::Seed => include_str!("../../presets/seed.toml"),
            Self::Gmapping => include_str!("../../presets/gmapping.toml"),
        }
    }

    /// What it sets, as a layer.
    #[must_use]
    pub fn layer(self) -> Layer {
        let name = format!("preset `{}`", self.name());
        // The files are part of the program; a test parses each.
        Layer::from_toml(&name, self.toml()).unwrap_or_else(|_| Layer::from_table(&name, toml::Table::new()))
    }
}

impl FromStr for Preset {
    type Err = ConfigError;

    fn from_str(name: &str) -> Result<Self, ConfigError> {
        Self::ALL.into_iter().find(|preset| preset.name() == name).ok_or_else(|| ConfigError::UnknownPreset {
            name: name.to_owned(),
            hint: did_you_mean(name, Self::ALL.into_iter().map(Self::name), '`'),
            known: Self::ALL.map(|preset| format!("`{}`", preset.name())).join(", "),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_parses_and_is_found_by_its_name() {
        for preset in Preset::ALL {
            Layer::from_toml(preset.name(), preset.toml()).unwrap();
            assert_eq!(preset.name().parse::<Preset>().unwrap(), preset);
        }
    }

    #[test]
    fn a_misspelt_preset_leads_to_the_nearest() {
        let error = "defualt".parse::<Preset>().unwrap_err().to_string();
        assert!(error.contains("did you mean `default`?") && error.contains("`seed`"), "{error}");
    }
}
