//! The configuration: small sections named like the modules that read them.
//!
//! Layers, later wins: defaults in code → the data set's calibration → preset →
//! the user's file → single settings. Every layer is checked against the options'
//! own declarations first, so that an error names the layer and the line; then the
//! layers are merged as TOML tables and deserialised once. See [`Config::resolve`].

mod error;
mod layer;
mod options;
mod preset;

pub use error::ConfigError;
pub use layer::Layer;
pub use options::{Choice, ConfigOption, Kind, Range, find_options, json_schema, options};
pub use preset::Preset;

use crate::back_end::LoopClosureConfig;
use crate::front_end::{FilterConfig, FilterKind, GrisettiConfig};
use crate::localization::LocalizationConfig;
use crate::map::MapConfig;
use crate::motion_model::MotionConfig;
use crate::odometry::{OdometryConfig, ScanConfig};
use crate::scan_matcher::MatcherConfig;
use crate::sensors::RobotConfig;
use crate::texture::TextureConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Table;

/// Everything that shapes a run. The defaults are the preset `default`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Seed of every random draw. Any number is a seed; none means "random".
    pub seed: u64,
    /// Calibration of the robot.
    pub robot: RobotConfig,
    /// Dead reckoning.
    pub odometry: OdometryConfig,
    /// From raw scans to points.
    pub scan: ScanConfig,
    /// The occupancy grid.
    pub map: MapConfig,
    /// Noise of the motion between scans.
    pub motion: MotionConfig,
    /// Scan matching.
    pub matcher: MatcherConfig,
    /// The particle filter.
    pub filter: FilterConfig,
    /// The filter `grisetti2007`.
    pub grisetti: GrisettiConfig,
    /// Closing loops.
    pub loop_closure: LoopClosureConfig,
    /// Localization in a finished map.
    pub localization: LocalizationConfig,
    /// The floor texture.
    pub texture: TextureConfig,
}

impl Config {
    /// The configuration that `layers` make on top of the defaults, later layers winning.
    ///
    /// A layer's table `when.NAME` holds settings that count only for the robot of that name
    /// (the `robot.name` that the layers before it leave).
    ///
    /// # Errors
    /// The first unknown key, value of the wrong type or value out of range, with the layer
    /// (and line) it stands in; a section that is incomplete; options that contradict each other.
    pub fn resolve(layers: &[Layer]) -> Result<Self, ConfigError> {
        let options = options();
        let mut merged = Self::default().to_table();
        for layer in layers {
            layer.check(&options)?;
            layer.merge_into(&mut merged);
        }
        let config: Self =
            merged.try_into().map_err(|error: toml::de::Error| ConfigError::Incomplete(error.message().to_owned()))?;
        config.check_consistency()?;
        Ok(config)
    }

    /// Whether a configuration that was put together in code holds only values in their ranges.
    ///
    /// # Errors
    /// As [`resolve`](Self::resolve).
    pub fn validate(&self) -> Result<(), ConfigError> {
        Self::resolve(&[Layer::from_table("the configuration", self.to_table())]).map(|_| ())
    }

    /// The configuration as a TOML document that [`Layer::from_toml`] reads back.
    #[must_use]
    pub fn to_toml(&self) -> String {
        self.to_table().to_string()
    }

    /// The configuration as a TOML table, sections as tables in tables.
    #[must_use]
    pub fn to_table(&self) -> Table {
        // Every section is a plain struct of numbers, strings and enums, which TOML can hold.
        Table::try_from(self).unwrap_or_default()
    }

    /// What ranges of single options cannot say.
    fn check_consistency(&self) -> Result<(), ConfigError> {
        if self.scan.range_min_m >= self.scan.range_max_m {
            return Err(ConfigError::Contradiction(format!(
                "`scan.range_min_m` ({}) must be below `scan.range_max_m` ({})",
                self.scan.range_min_m, self.scan.range_max_m
            )));
        }
        let adaptive = &self.filter.adaptive;
        if adaptive.least > adaptive.most {
            return Err(ConfigError::Contradiction(format!(
                "`filter.adaptive.least` ({}) must not be above `filter.adaptive.most` ({})",
                adaptive.least, adaptive.most
            )));
        }
        let (most, with_maps) = (self.filter.most_particles(), FilterConfig::MOST_WITH_MAPS);
        if self.filter.kind != FilterKind::SharedMap && most > with_maps {
            let key = if adaptive.enabled { "filter.adaptive.most" } else { "filter.particles" };
            return Err(ConfigError::Contradiction(format!(
                "`{key}` is {most}, expected at most {with_maps} where each particle has a map of its own: a thousand take \
                 half a gigabyte and a tenth of a second or more for each scan (only filter.kind = \"shared_map\" takes more)"
            )));
        }
        let kinect = self.robot.camera.as_ref().map(|camera| ("camera", camera.depth_min_m, camera.depth_max_m));
        let other = self.robot.depth_camera.as_ref();
        let other = other.map(|camera| ("depth_camera", camera.depth_min_m, camera.depth_max_m));
        for (section, nearest_m, farthest_m) in kinect.into_iter().chain(other) {
            if nearest_m >= farthest_m {
                return Err(ConfigError::Contradiction(format!(
                    "`robot.{section}.depth_min_m` ({nearest_m}) must be below `robot.{section}.depth_max_m` ({farthest_m})"
                )));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(text: &str) -> String {
        let layer = Layer::from_toml("my.toml", text).unwrap();
        Config::resolve(&[layer]).unwrap_err().to_string()
    }

    #[test]
    fn later_layers_win_and_leave_the_rest_alone() {
        let file = Layer::from_toml("my.toml", "[filter]\nparticles = 60\n[map]\nresolution_m = 0.1").unwrap();
        let setting = Layer::from_setting("filter.particles=7").unwrap();
        let config = Config::resolve(&[file, setting]).unwrap();
        assert_eq!(config.filter.particles, 7);
        assert_eq!(config.map.resolution_m, 0.1);
        assert_eq!(config.odometry, Config::default().odometry);
    }

    #[test]
    fn the_resolved_configuration_reads_back_as_itself() {
        for preset in Preset::ALL {
            let config = Config::resolve(&[preset.layer()]).unwrap();
            let again = Config::resolve(&[Layer::from_toml("config.toml", &config.to_toml()).unwrap()]).unwrap();
            assert_eq!(config, again, "{}", preset.name());
        }
    }

    #[test]
    fn the_defaults_are_valid_and_are_the_preset_default() {
        Config::default().validate().unwrap();
        let preset = Config::resolve(&[Preset::Default.layer()]).unwrap();
        assert_eq!(preset, Config::default());
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line_and_the_nearest_option() {
        let error = error_of("[filter]\n\nparticels = 5");
        assert!(error.contains("my.toml:3"), "{error}");
        assert!(error.contains("`filter.particels`"), "{error}");
        assert!(error.contains("did you mean `filter.particles`?"), "{error}");
    }

    #[test]
    fn a_key_in_the_wrong_section_leads_to_the_right_one() {
        assert!(error_of("[map]\nparticles = 5").contains("did you mean `filter.particles`?"));
        assert!(error_of("particles = 5").contains("did you mean `filter.particles`?"));
    }

    #[test]
    fn an_unknown_table_leads_to_the_nearest() {
        assert!(error_of("[filtr]\nparticles = 5").contains("`filtr` (did you mean the table `[filter]`?)"));
        assert!(error_of("[filter.adaptve]\nleast = 5").contains("did you mean the table `[filter.adaptive]`?"));
        assert!(error_of("[adaptive]\nleast = 5").contains("did you mean the table `[filter.adaptive]`?"));
        assert!(error_of("[when.alpha.mapp]\nresolution_m = 0.2").contains("did you mean the table `[map]`?"));
        let error = Config::resolve(&[Layer::from_setting("filtr.particles=3").unwrap()]).unwrap_err().to_string();
        assert!(error.contains("did you mean `filter.particles`?"), "{error}");
        let error = find_options("filtr").unwrap_err().to_string();
        assert!(error.contains("did you mean `filter`?"), "{error}");
    }

    #[test]
    fn a_value_out_of_range_says_what_is_expected() {
        assert!(error_of("filter.particles = 0").contains("my.toml:1: `filter.particles` is 0"));
        assert!(error_of("map.resolution_m = -1.0").contains("expected a number from 0.005 to 2"));
        assert!(error_of("map.hit_log_odds = 0").contains("expected a number > 0"));
        assert!(error_of("map.resolution_m = nan").contains("`map.resolution_m` is nan"));
        assert!(error_of("filter.resample_below = 1.5").contains("from 0 to 1"));
    }

    #[test]
    fn maps_of_thousands_of_particles_are_refused_with_what_they_would_cost() {
        assert!(error_of("filter.particles = 1001").contains("expected at most 1000 where each particle has a map"));
        let adaptive = "filter.adaptive = { enabled = true, most = 5000 }";
        assert!(error_of(adaptive).starts_with("`filter.adaptive.most` is 5000"));
        for fine in ["filter.particles = 1000", "filter = { particles = 100000, kind = \"shared_map\" }"] {
            Config::resolve(&[Layer::from_toml("my.toml", fine).unwrap()]).unwrap();
        }
    }

    #[test]
    fn a_value_of_the_wrong_type_says_what_was_found() {
        assert!(error_of("filter.particles = \"many\"").contains("the text \"many\", expected a whole number"));
        assert!(error_of("filter = 3").contains("`filter` is 3, expected a section"));
        assert!(error_of("[seed]\na = 1").contains("`seed` is a section, expected a whole number"));
    }

    #[test]
    fn a_misspelt_choice_leads_to_the_nearest() {
        let error = error_of("filter.resampler = \"stratifed\"");
        assert!(error.contains("did you mean \"stratified\"?"), "{error}");
    }

    #[test]
    fn broken_toml_says_where() {
        let error = Layer::from_toml("my.toml", "[filter]\nparticles = = 3").unwrap_err().to_string();
        assert!(error.contains("my.toml:2"), "{error}");
    }

    #[test]
    fn half_a_section_names_what_is_missing() {
        let error = error_of("robot.wheels.track_width_m = 0.7");
        assert!(error.contains("left_m_per_tick"), "{error}");
    }

    #[test]
    fn settings_for_another_robot_do_not_count() {
        let text = "[when.alpha.map]\nresolution_m = 0.2";
        let layer = |name: &str| {
            let robot = RobotConfig { name: name.to_owned(), ..RobotConfig::default() };
            let layers = [Layer::from_robot(&robot), Layer::from_toml("my.toml", text).unwrap()];
            Config::resolve(&layers).unwrap().map.resolution_m
        };
        assert_eq!(layer("alpha"), 0.2);
        assert_eq!(layer("beta"), Config::default().map.resolution_m);
        assert!(error_of("[when.alpha.map]\nresolutoin_m = 0.2").contains("did you mean `map.resolution_m`?"));
    }

    #[test]
    fn a_setting_takes_toml_values_and_bare_words() {
        let words = Layer::from_setting("filter.resampler = residual").unwrap();
        let quoted = Layer::from_setting("filter.resampler=\"residual\"").unwrap();
        assert_eq!(Config::resolve(&[words]).unwrap(), Config::resolve(&[quoted]).unwrap());
        let error = Layer::from_setting("filter.particles").unwrap_err().to_string();
        assert!(error.contains("KEY=VALUE"), "{error}");
        let error = Config::resolve(&[Layer::from_setting("filter.particels=3").unwrap()]).unwrap_err().to_string();
        assert!(error.starts_with("--set filter.particels=3: "), "{error}");
    }

    #[test]
    fn contradictions_are_named() {
        assert!(error_of("scan.range_min_m = 5.0\nscan.range_max_m = 2.0").contains("must be below"));
        assert!(error_of("filter.adaptive.least = 50\nfilter.adaptive.most = 20").contains("must not be above"));
    }

    #[test]
    fn every_option_is_documented() {
        for option in options() {
            assert!(!option.description.is_empty(), "{} has no description", option.key);
        }
    }
}
