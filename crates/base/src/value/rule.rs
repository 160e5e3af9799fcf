//! Rules for the representative: the one value that stands for an inner node at coarse detail.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::Error;

/// Rule by which the representative of an inner node comes from what is below it. VOID never counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Rule {
    /// The mean over all cells below that are not VOID, each channel by itself: from sums carried up the
    /// tree and rounded once (integers: to the nearest, a half upwards), so no bias builds up by level.
    /// Sums of integers are exact; sums of floating samples are double-double, added pairwise in Z order.
    Mean,
    /// The value that covers most cells below, from exact counts. A tie goes to the first child, in child
    /// order, whose value is one of the tied ones; if there is none, a hash of the children's values
    /// chooses. So no class is preferred for its number.
    Majority,
    /// The survey's local rule on the children alone: a LEAF child's value weighs 3, an INNER child's
    /// representative 2; ties go to the first in child order. It gives the literature's tables.
    Dominant,
    /// The smallest value below, each channel by itself.
    Min,
    /// The largest value below, each channel by itself.
    Max,
    /// The value of the first child, in child order, that is not VOID.
    Nearest,
    /// The occupancy of the node: the mean over all cells below, those that are VOID counting as zero;
    /// otherwise as [`Rule::Mean`]. Made for solids, whose full cells are 255.
    Occupancy,
}

impl Rule {
    /// All rules, in the order of their numbers on disk.
    pub const ALL: [Rule; 7] =
        [Rule::Mean, Rule::Majority, Rule::Dominant, Rule::Min, Rule::Max, Rule::Nearest, Rule::Occupancy];

    /// The rule's name on the command line.
    pub fn name(self) -> &'static str {
        ["mean", "majority", "dominant", "min", "max", "nearest", "occupancy"][self as usize]
    }
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Rule {
    type Err = Error;

    fn from_str(name: &str) -> Result<Rule, Error> {
        Rule::ALL
            .into_iter()
            .find(|rule| rule.name() == name)
            .ok_or_else(|| Error::invalid("rule", format!("`{name}`"), Rule::ALL.map(Rule::name).join(", ")))
    }
}

/// The meaning of the values, which decides the default rule and what can be asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum DataKind {
    /// Names of things: land cover, parts. They are counted, never averaged.
    Categorical,
    /// Amounts: brightness, height.
    Continuous,
}

impl DataKind {
    /// The rule that fits when the user says nothing.
    pub fn default_rule(self) -> Rule {
        match self {
            DataKind::Categorical => Rule::Majority,
            DataKind::Continuous => Rule::Mean,
        }
    }

    /// The kind's name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            DataKind::Categorical => "categorical",
            DataKind::Continuous => "continuous",
        }
    }
}

impl fmt::Display for DataKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for DataKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<DataKind, Error> {
        [DataKind::Categorical, DataKind::Continuous]
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| Error::invalid("kind", format!("`{name}`"), "categorical or continuous"))
    }
}
