//! `[matcher]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[matcher]`: scan matching.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MatcherConfig {}
