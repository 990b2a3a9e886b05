//! Configurations: a preset, a file and settings laid over what is known of a robot.

use crate::errors::OrRaise;
use floorprint::Config;
use floorprint::config::Preset;
use floorprint::sensors::RobotConfig;
use floorprint_cli::Settings;
use pyo3::prelude::*;
use std::path::PathBuf;

/// What a configuration is made of: preset, file, settings, and the robot's calibration as JSON, where one is known.
#[derive(FromPyObject)]
pub(crate) struct Layers(String, Option<PathBuf>, Vec<String>, Option<String>);

impl Layers {
    /// The layers above the robot's.
    pub(crate) fn settings(&self) -> PyResult<Settings> {
        let Self(preset, file, settings, _) = self;
        let preset: Preset = preset.parse().or_raise()?;
        Ok(Settings { preset, config: file.clone(), set: settings.clone(), seed: None })
    }

    /// All layers put together.
    pub(crate) fn config(&self) -> PyResult<Config> {
        let robot: Option<RobotConfig> = self.3.as_deref().map(serde_json::from_str).transpose().or_raise()?;
        self.settings()?.resolve(robot.as_ref()).or_raise()
    }
}

/// The configuration that the layers make, as JSON and as TOML.
#[pyfunction]
pub(crate) fn resolve(layers: Layers) -> PyResult<(String, String)> {
    let config = layers.config()?;
    Ok((serde_json::to_string(&config).or_raise()?, config.to_toml()))
}

/// Every option with its description, in the order of the sections.
#[pyfunction]
pub(crate) fn options() -> Vec<(String, String)> {
    floorprint::config::options()
        .into_iter()
        .map(|option| (option.key.to_string(), option.description.to_string()))
        .collect()
}
