//! One source of settings: a preset, a file, a single setting, a calibration.

use super::options::{ConfigOption, Wanted, hint_for, render};
use super::{ConfigError, RobotConfig};
use toml::{Table, Value};

/// Settings from one source, under the name by which errors call it.
#[derive(Debug, Clone)]
pub struct Layer {
    name: String,
    table: Table,
    /// The TOML text, to tell lines; empty where there is none.
    text: String,
}

impl Layer {
    /// A layer from a TOML document; `name` is the file's.
    ///
    /// # Errors
    /// The text is not TOML.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, ConfigError> {
        let table = text.parse().map_err(|error: toml::de::Error| ConfigError::Syntax {
            place: place_at(name, text, error.span().map_or(0, |span| span.start)),
            message: error.message().replace('\n', ", "),
        })?;
        Ok(Self { name: name.to_owned(), table, text: text.to_owned() })
    }

    /// A layer from one `KEY=VALUE`. The value is TOML; what is not TOML is taken as text,
    /// so that words need no quotes.
    ///
    /// # Errors
    /// There is no `=`, or no key before it.
    pub fn from_setting(setting: &str) -> Result<Self, ConfigError> {
        let malformed = || ConfigError::Setting(setting.to_owned());
        let (key, value) = setting.split_once('=').ok_or_else(malformed)?;
        let (key, value) = (key.trim(), value.trim());
        if key.is_empty() || key.split('.').any(str::is_empty) {
            return Err(malformed());
        }
        let parsed = format!("value = {value}").parse::<Table>().ok().filter(|table| table.len() == 1);
        let value =
            parsed.and_then(|mut table| table.remove("value")).unwrap_or_else(|| Value::String(value.to_owned()));
        let nested =
            key.rsplit('.').fold(value, |inner, part| Value::Table(Table::from_iter([(part.to_owned(), inner)])));
        let Value::Table(table) = nested else { return Err(malformed()) };
        Ok(Self::from_table(&format!("--set {setting}"), table))
    }

    /// A data set's calibration as a layer.
    #[must_use]
    pub fn from_robot(robot: &RobotConfig) -> Self {
        let robot_table = Table::try_from(robot).unwrap_or_default();
        let table = Table::from_iter([("robot".to_owned(), Value::Table(robot_table))]);
        Self::from_table(&format!("calibration `{}`", robot.name), table)
    }

    /// A layer from a table made in code.
    #[must_use]
    pub fn from_table(name: &str, table: Table) -> Self {
        Self { name: name.to_owned(), table, text: String::new() }
    }

    /// Checks every setting against the options' declarations.
    pub(super) fn check(&self, options: &[ConfigOption]) -> Result<(), ConfigError> {
        for (key, value) in &self.table {
            match (key.as_str(), value) {
                ("when", Value::Table(robots)) => {
                    for (robot, settings) in robots {
                        let Value::Table(settings) = settings else {
                            return Err(self.unknown_key(&["when", robot], options, 2, Wanted::Option));
                        };
                        for (key, value) in settings {
                            self.check_value(&["when", robot, key], 2, value, options)?;
                        }
                    }
                }
                _ => self.check_value(&[key], 0, value, options)?,
            }
        }
        Ok(())
    }

    /// Lays this layer's settings over `target`, those for its robot included.
    pub(super) fn merge_into(&self, target: &mut Table) {
        let mut settings = self.table.clone();
        let when = settings.remove("when");
        merge(target, settings);
        let robot = target.get("robot").and_then(|robot| robot.get("name")).and_then(Value::as_str);
        let for_robot = when.as_ref().zip(robot).and_then(|(when, robot)| when.get(robot));
        if let Some(Value::Table(for_robot)) = for_robot {
            merge(target, for_robot.clone());
        }
    }

    /// Checks the value at `path`, of which the first `prefix` parts are not part of the key.
    fn check_value(
        &self,
        path: &[&str],
        prefix: usize,
        value: &Value,
        options: &[ConfigOption],
    ) -> Result<(), ConfigError> {
        let key = path[prefix..].join(".");
        if let Some(option) = options.iter().find(|option| option.key == key) {
            return option.kind.check(value).map_err(|hint| ConfigError::BadValue {
                place: self.place(path),
                found: render(value),
                expected: option.kind.to_string(),
                key,
                hint,
            });
        }
        let section = format!("{key}.");
        let sets_nothing = value.as_table().is_some_and(Table::is_empty);
        if !sets_nothing && !options.iter().any(|option| option.key.starts_with(&section)) {
            return match value {
                // A single setting has no tables: all of its key is in question.
                Value::Table(table) if self.text.is_empty() && table.len() == 1 => table
                    .iter()
                    .try_for_each(|(name, value)| self.check_value(&[path, &[name]].concat(), prefix, value, options)),
                Value::Table(_) => Err(self.unknown_key(path, options, prefix, Wanted::Table)),
                _ => Err(self.unknown_key(path, options, prefix, Wanted::Option)),
            };
        }
        let Value::Table(table) = value else {
            return Err(ConfigError::BadValue {
                place: self.place(path),
                found: render(value),
                expected: "a section".to_owned(),
                key,
                hint: String::new(),
            });
        };
        for (name, value) in table {
            self.check_value(&[path, &[name]].concat(), prefix, value, options)?;
        }
        Ok(())
    }

    fn unknown_key(&self, path: &[&str], options: &[ConfigOption], prefix: usize, wanted: Wanted) -> ConfigError {
        let key = path[prefix.min(path.len())..].join(".");
        let hint = hint_for(&key, options, wanted);
        ConfigError::UnknownKey { place: self.place(path), key, hint }
    }

    /// The layer's name, and the line of `path` where it has lines.
    fn place(&self, path: &[&str]) -> String {
        match offset_of(&self.text, path) {
            Some(offset) => place_at(&self.name, &self.text, offset),
            None => self.name.clone(),
        }
    }
}

/// `name:line` of a byte offset.
fn place_at(name: &str, text: &str, offset: usize) -> String {
    let line = 1 + text.bytes().take(offset).filter(|&byte| byte == b'\n').count();
    format!("{name}:{line}")
}

/// Where the key at `path` stands in a TOML document, bytes from its beginning.
fn offset_of(text: &str, path: &[&str]) -> Option<usize> {
    let document = toml::de::DeTable::parse(text).ok()?;
    let mut table = document.get_ref();
    let mut offset = None;
    for part in path {
        let (key, value) = table.iter().find(|(key, _)| key.get_ref().as_ref() == *part)?;
        offset = Some(key.span().start);
        match value.get_ref() {
            toml::de::DeValue::Table(inner) => table = inner,
            _ => break,
        }
    }
    offset
}

/// Lays `layer` over `target`: tables are merged, anything else is replaced.
fn merge(target: &mut Table, layer: Table) {
    for (key, value) in layer {
        match (target.get_mut(&key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => merge(old, new),
            (_, value) => {
                target.insert(key, value);
            }
        }
    }
}
