//! Assignment of boundary cells to a polygon or a solid.

use std::fmt;
use std::str::FromStr;

use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Rule by which cells that a boundary crosses belong to its polygon or solid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EdgeRule {
    /// A cell belongs entirely if its centre is inside, otherwise not at all.
    #[default]
    Centre,
    /// A cell belongs entirely if any point of it is inside: the rule of the literature, and GDAL's
    /// ALL_TOUCHED.
    Touch,
    /// A cell belongs with the fraction of its area or volume that is inside.
    Area,
}

impl EdgeRule {
    /// All rules.
    pub const ALL: [EdgeRule; 3] = [EdgeRule::Centre, EdgeRule::Touch, EdgeRule::Area];

    /// Returns the name on the command line and in files' tags.
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
