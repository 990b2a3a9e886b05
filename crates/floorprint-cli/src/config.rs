//! `floorprint config`: the configuration shown and explained.

use crate::outcome::{BadArguments, Outcome};
use crate::terminal::{HEADING, Terminal, prose};
use clap::{Args, Subcommand};
use floorprint::Config;
use floorprint::config::{ConfigError, ConfigOption, Kind, Layer, Preset, find_options, json_schema, options};
use floorprint::sensors::RobotConfig;
use floorprint_io::{OpenOptions, open, read_text};
use std::io::Write;
use std::path::PathBuf;
use toml::{Table, Value};

/// Show and explain the configuration.
#[derive(Subcommand)]
pub(crate) enum Command {
    /// Print the resolved configuration as TOML.
    Show {
        /// Data set whose robot it is resolved for; without it, for a robot of which nothing is known.
        path: Option<PathBuf>,
        /// Number of the drive, for folders that hold several.
        #[arg(long, value_name = "N")]
        drive: Option<u32>,
        #[command(flatten)]
        settings: Settings,
    },
    /// Explain options: meaning, values, default, presets. Without a key, list them all.
    Explain {
        /// An option (`filter.particles`) or a section (`filter`).
        key: Option<String>,
    },
    /// Print the JSON schema of configuration files, for editors.
    Schema,
}

/// Where settings come from; later ones win: preset, file, --set, --seed.
#[derive(Args, Clone, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    /// Named configuration to start from.
    #[arg(long, default_value = "default", value_name = "NAME", value_parser = |name: &str| name.parse::<Preset>())]
    pub preset: Preset,
    /// TOML file laid over the preset.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Single setting laid over all else, e.g. filter.particles=60. Can be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Seed of all random draws.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: Option<u64>,
}

impl Settings {
    /// The configuration for a robot (the data set's calibration), all layers resolved.
    ///
    /// # Errors
    /// The file cannot be read; whatever is wrong with a setting.
    pub fn resolve(&self, robot: Option<&RobotConfig>) -> anyhow::Result<Config> {
        let mut layers: Vec<Layer> = robot.map(Layer::from_robot).into_iter().collect();
        layers.push(self.preset.layer());
        if let Some(path) = &self.config {
            let unreadable = |error| BadArguments(format!("the configuration file: {error}"));
            let text = read_text(path).map_err(unreadable)?;
            layers.push(Layer::from_toml(&path.display().to_string(), &text)?);
        }
        for setting in &self.set {
            layers.push(Layer::from_setting(setting)?);
        }
        if let Some(seed) = self.seed {
            layers.push(Layer::from_setting(&format!("seed={seed}"))?);
        }
        Ok(Config::resolve(&layers)?)
    }
}

/// Runs `floorprint config`.
pub(crate) fn execute(command: &Command, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let mut out = terminal.results();
    match command {
        Command::Show { path, drive, settings } => {
            let options = OpenOptions { drive: *drive, ..OpenOptions::default() };
            let data_set = path.as_deref().map(|path| open(path, &options)).transpose()?;
            let robot = data_set.as_ref().map(|data_set| &data_set.robot);
            write!(out, "{}", settings.resolve(robot)?.to_toml())?;
        }
        Command::Schema => writeln!(out, "{}", json_schema())?,
        Command::Explain { key } => {
            let presets = preset_tables()?;
            let chosen = key.as_deref().map_or_else(|| Ok(options()), find_options)?;
            for option in chosen {
                explain(&mut out, &option, &presets)?;
            }
        }
    }
    out.flush()?;
    Ok(Outcome::Fine)
}

/// Every preset's resolved configuration.
fn preset_tables() -> Result<Vec<(Preset, Table)>, ConfigError> {
    let table = |preset: Preset| Ok((preset, Config::resolve(&[preset.layer()])?.to_table()));
    Preset::ALL.into_iter().map(table).collect()
}

fn explain(out: &mut impl Write, option: &ConfigOption, presets: &[(Preset, Table)]) -> anyhow::Result<()> {
    writeln!(out, "{HEADING}{}{HEADING:#}", option.key)?;
    writeln!(out, "    {}", prose(&option.description, 4))?;
    match &option.kind {
        Kind::Choice(choices) => {
            for choice in choices {
                writeln!(out, "      {:<24} {}", format!("\"{}\"", choice.name), choice.description)?;
            }
        }
        kind => writeln!(out, "    takes     {kind}{}", unit(&option.key))?,
    }
    let default = Config::default().to_table();
    let shown = |table: &Table| lookup(table, &option.key).map_or("from the data set".to_owned(), ToString::to_string);
    writeln!(out, "    default   {}", shown(&default))?;
    for (preset, table) in presets {
        if lookup(table, &option.key) != lookup(&default, &option.key) {
            writeln!(out, "    {:<9} {}", preset.name(), shown(table))?;
        }
    }
    writeln!(out)?;
    Ok(())
}

/// The unit that the name of an option ends in, as text.
fn unit(key: &str) -> &'static str {
    const UNITS: [(&str, &str); 9] = [
        ("_m_s2", ", metres per second squared"),
        ("_m_s", ", metres per second"),
        ("_rad_s", ", radians per second"),
        ("_m_per_tick", ", metres per tick"),
        ("_rad", ", radians"),
        ("_px", ", pixels"),
        ("_hz", ", hertz"),
        ("_m", ", metres"),
        ("_s", ", seconds"),
    ];
    UNITS.into_iter().find(|(suffix, _)| key.ends_with(suffix)).map_or("", |(_, unit)| unit)
}

/// The value at a dotted key.
fn lookup<'a>(table: &'a Table, key: &str) -> Option<&'a Value> {
    let (first, rest) = key.split_once('.').unwrap_or((key, ""));
    let value = table.get(first)?;
    if rest.is_empty() { Some(value) } else { lookup(value.as_table()?, rest) }
}
