//! Which cells along the edge of a polygon or a body belong to it.

use std::fmt;
use std::str::FromStr;

use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// The rule by which cells belong to a polygon or a body whose edge passes through them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EdgeRule {
    /// A cell belongs to it whole if its centre is inside, else not at all.
    #[default]
    Centre,
    /// A cell belongs to it whole if any part of it does: the rule of the literature, and GDAL's ALL_TOUCHED.
    Touch,
    /// A cell belongs to it by the part of its area, or of its volume, that is inside.
    Area,
}

impl EdgeRule {
    /// All rules.
    pub const ALL: [EdgeRule; 3] = [EdgeRule::Centre, EdgeRule::Touch, EdgeRule::Area];

    /// The name on the command line and in files' tags.
    pub fn name(self) -> &'static str {
        ["centre", "touch", "area"][self as usize]
    }
}

impl fmt::Display for EdgeRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for EdgeRule {
    type Err = Error;

    fn from_str(name: &str) -> Result<EdgeRule> {
        let found = EdgeRule::ALL.into_iter().find(|rule| rule.name() == name);
        let expected = || EdgeRule::ALL.map(EdgeRule::name).join(", ");
        found.ok_or_else(|| Error::invalid("edge", format!("`{name}`"), expected()))
    }
}
