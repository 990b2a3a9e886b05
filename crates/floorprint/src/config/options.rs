//! The list of options, read off the documented fields of the configuration's structs.
//!
//! An option is declared once, as a field: its doc comment is the help text, its
//! `schemars` range is what values are checked against. The JSON schema carries both.

use super::error::{did_you_mean, nearest};
use super::{Config, ConfigError};
use schemars::schema_for;
use std::fmt;
use toml::Value;

/// One option: a leaf of the configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct ConfigOption {
    /// Dotted key, `filter.particles`.
    pub key: String,
    /// What it means, with its unit.
    pub description: String,
    /// What values it takes.
    pub kind: Kind,
}

/// What values an option takes.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// `true` or `false`.
    Boolean,
    /// A whole number.
    Integer(Range),
    /// A number.
    Number(Range),
    /// Any text.
    Text,
    /// A section of several fields.
    Section,
    /// One of a few words.
    Choice(Vec<Choice>),
    /// Several values of one kind.
    List(Box<Kind>),
}

/// One of the words that an option takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice {
    /// The word.
    pub name: String,
    /// What it means.
    pub description: String,
}

/// Limits of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Least value; −∞ for none.
    pub minimum: f64,
    /// Greatest value; ∞ for none.
    pub maximum: f64,
    /// Whether `minimum` itself is excluded.
    pub above_minimum: bool,
}

/// The JSON schema of a configuration file, for editors and checkers.
#[must_use]
pub fn json_schema() -> String {
    format!("{:#}", schema_for!(Config).as_value())
}

/// All options, in the order of the configuration's fields.
#[must_use]
pub fn options() -> Vec<ConfigOption> {
    let schema = schema_for!(Config);
    let mut options = Vec::new();
    collect(schema.as_value(), schema.as_value(), "", &mut options);
    options
}

/// The option called `key`, or all options of the section called `key`.
///
/// # Errors
/// There is neither.
pub fn find_options(key: &str) -> Result<Vec<ConfigOption>, ConfigError> {
    let (found, others): (Vec<_>, Vec<_>) = options()
        .into_iter()
        .partition(|option| option.key.strip_prefix(key).is_some_and(|rest| rest.is_empty() || rest.starts_with('.')));
    if found.is_empty() {
        let hint = hint_for(key, &others, Wanted::Either);
        return Err(ConfigError::UnknownKey { place: "config".to_owned(), key: key.to_owned(), hint });
    }
    Ok(found)
}

/// What an unknown key should have been the name of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    /// An option.
    Option,
    /// A section, which has a table in a file.
    Table,
    /// Any of both.
    Either,
}

/// What may have been meant by an unknown key: an option or section of the same last name in another
/// section, else the one most like it.
pub(super) fn hint_for(key: &str, options: &[ConfigOption], wanted: Wanted) -> String {
    let keys = options.iter().map(|option| option.key.as_str());
    let sections = keys.clone().flat_map(|key| key.match_indices('.').map(|(end, _)| &key[..end]));
    let meant = match wanted {
        Wanted::Option => meant_by(key, keys),
        Wanted::Either => meant_by(key, sections.chain(keys)),
        Wanted::Table => match meant_by(key, sections) {
            Some(section) => return format!(" (did you mean the table `[{section}]`?)"),
            None => meant_by(key, keys),
        },
    };
    match meant {
        Some(meant) => format!(" (did you mean `{meant}`?)"),
        None => "; `floorprint config explain` lists them all".to_owned(),
    }
}

/// The first of the same last name, else the one most like the key.
fn meant_by<'a>(key: &str, candidates: impl Iterator<Item = &'a str> + Clone) -> Option<&'a str> {
    let last = |key: &str| key.rsplit('.').next().map(str::to_owned);
    candidates.clone().find(|candidate| last(candidate) == last(key)).or_else(|| nearest(key, candidates))
}

/// Appends the options below `node` of the schema `root`.
fn collect(root: &Json, node: &Json, key: &str, options: &mut Vec<ConfigOption>) {
    let target = follow(root, node);
    if let Some(properties) = target["properties"].as_object() {
        for (name, property) in properties {
            let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
            collect(root, property, &key, options);
        }
    } else if let Some(kind) = kind_of(root, target) {
        let text = node["description"].as_str().or(target["description"].as_str()).unwrap_or_default();
        options.push(ConfigOption { key: key.to_owned(), description: one_line(text), kind });
    }
}

type Json = serde_json::Value;

/// The definition that a node refers to, through `$ref` and through `null` alternatives.
fn follow<'a>(root: &'a Json, node: &'a Json) -> &'a Json {
    if let Some(pointer) = node["$ref"].as_str().and_then(|reference| reference.strip_prefix('#')) {
        return root.pointer(pointer).map_or(node, |target| follow(root, target));
    }
    let alternatives = node["anyOf"].as_array().map(Vec::as_slice).unwrap_or_default();
    alternatives.iter().find(|alternative| alternative["type"] != "null").map_or(node, |target| follow(root, target))
}

fn kind_of(root: &Json, node: &Json) -> Option<Kind> {
    if let Some(words) = node["oneOf"].as_array().or(node["enum"].as_array()) {
        let choice = |word: &Json| Choice {
            name: word["const"].as_str().or(word.as_str()).unwrap_or_default().to_owned(),
            description: one_line(word["description"].as_str().unwrap_or_default()),
        };
        return Some(Kind::Choice(words.iter().map(choice).collect()));
    }
    // An optional number has the type ["number", "null"].
    let kind = node["type"].as_str().or(node["type"][0].as_str())?;
    let exclusive = node["exclusiveMinimum"].as_f64();
    let range = Range {
        minimum: exclusive.or(node["minimum"].as_f64()).unwrap_or(f64::NEG_INFINITY),
        maximum: node["maximum"].as_f64().unwrap_or(f64::INFINITY),
        above_minimum: exclusive.is_some(),
    };
    match kind {
        "boolean" => Some(Kind::Boolean),
        "integer" => Some(Kind::Integer(range)),
        "number" => Some(Kind::Number(range)),
        "string" => Some(Kind::Text),
        // Within a list only: the fields of other sections are options of their own.
        "object" => Some(Kind::Section),
        "array" => kind_of(root, follow(root, &node["items"])).map(|items| Kind::List(Box::new(items))),
        _ => None,
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl Kind {
    /// Whether the option takes `value`; the error is a hint, which may be empty.
    pub(super) fn check(&self, value: &Value) -> Result<(), String> {
        let fits = match (self, value) {
            (Self::Boolean, Value::Boolean(_))
            | (Self::Text, Value::String(_))
            // Its fields are checked where the configuration is deserialised.
            | (Self::Section, Value::Table(_)) => true,
            #[expect(clippy::cast_precision_loss, reason = "limits are small or at the ends of the type")]
            (Self::Integer(range) | Self::Number(range), Value::Integer(number)) => range.contains(*number as f64),
            (Self::Number(range), Value::Float(number)) => number.is_finite() && range.contains(*number),
            (Self::Choice(choices), Value::String(word)) => {
                if !choices.iter().any(|choice| choice.name == *word) {
                    return Err(did_you_mean(word, choices.iter().map(|choice| choice.name.as_str()), '"'));
                }
                true
            }
            (Self::List(items), Value::Array(values)) => return values.iter().try_for_each(|value| items.check(value)),
            _ => false,
        };
        if fits { Ok(()) } else { Err(String::new()) }
    }
}

impl Range {
    fn contains(&self, number: f64) -> bool {
        let high_enough = if self.above_minimum { number > self.minimum } else { number >= self.minimum };
        high_enough && number <= self.maximum
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Boolean => write!(formatter, "true or false"),
            Self::Integer(range) => write!(formatter, "a whole number{range}"),
            Self::Number(range) => write!(formatter, "a number{range}"),
            Self::Text => write!(formatter, "text"),
            Self::Section => write!(formatter, "a section"),
            Self::Choice(choices) => {
                let words: Vec<_> = choices.iter().map(|choice| format!("\"{}\"", choice.name)).collect();
                write!(formatter, "one of {}", words.join(", "))
            }
            Self::List(items) => write!(formatter, "a list, each {items}"),
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { minimum, maximum, above_minimum } = *self;
        match (minimum.is_finite(), maximum.is_finite()) {
            (false, false) => Ok(()),
            (false, true) => write!(formatter, " ≤ {maximum}"),
            (true, false) if above_minimum => write!(formatter, " > {minimum}"),
            (true, false) => write!(formatter, " ≥ {minimum}"),
            (true, true) if above_minimum => write!(formatter, " above {minimum} and up to {maximum}"),
            (true, true) => write!(formatter, " from {minimum} to {maximum}"),
        }
    }
}

/// A value as it stands in an error message.
pub(super) fn render(value: &Value) -> String {
    match value {
        Value::Table(_) => "a section".to_owned(),
        Value::String(text) => format!("the text \"{text}\""),
        other => other.to_string(),
    }
}
