//! Rules for the representative: the value of an INNER node at coarse detail.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::{Error, Result};

/// Rule that computes the representative of an INNER node from its subtree. VOID never counts,
/// except in [`Rule::Occupancy`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Rule {
    /// Mean of all cells below that are not VOID, per channel. It is computed from sums that are
    /// carried up the tree, and rounded once (integers: to nearest, half up), so rounding errors do
    /// not accumulate. Sums of integers are exact. Sums of floating samples are double-double,
    /// added pairwise in Z order.
    Mean,
    /// The value that covers most cells below, from exact counts. A tie goes to the first child, in
    /// child order, whose value is one of the tied ones. If there is none, a hash of the children's
    /// values chooses. So the number of a class does not affect ties.
    Majority,
    /// The survey's local rule on the children alone. A LEAF child's value weighs 3, an INNER
    /// child's representative 2; a tie goes to the first child in order. It reproduces the tables
    /// of the literature.
    Dominant,
    /// The smallest value below, per channel.
    Min,
    /// The largest value below, per channel.
    Max,
    /// The value of the first child, in child order, that is not VOID.
    Nearest,
    /// Occupancy: the mean over all cells below, where VOID cells count as zero; otherwise as
    /// [`Rule::Mean`]. For solids, whose full cells are 255.
    Occupancy,
}

impl Rule {
    /// All rules, in the order of their numbers on disk.
    pub const ALL: [Rule; 7] =
        [Rule::Mean, Rule::Majority, Rule::Dominant, Rule::Min, Rule::Max, Rule::Nearest, Rule::Occupancy];

    /// Returns the rule's name on the command line.
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

    fn from_str(name: &str) -> Result<Rule> {
        Rule::ALL
            .into_iter()
            .find(|rule| rule.name() == name)
            .ok_or_else(|| Error::invalid("rule", format!("`{name}`"), Rule::ALL.map(Rule::name).join(", ")))
    }
}

/// Meaning of the values, which determines the default rule and the supported queries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum DataKind {
    /// Class codes, such as land cover. They are counted, never averaged.
    Categorical,
    /// Continuous values, such as brightness or height.
    Continuous,
}

impl DataKind {
    /// Returns the default rule.
    pub fn default_rule(self) -> Rule {
        match self {
            DataKind::Categorical => Rule::Majority,
            DataKind::Continuous => Rule::Mean,
        }
    }

    /// Checks a rule that was requested for values of this kind: averages of class numbers are
    /// numbers of other classes. `path` is the input, for the error message.
    ///
    /// # Errors
    /// If the rule computes averages, and the values are classes.
    pub fn check_rule(self, rule: Rule, path: &Path) -> Result<()> {
        if self == DataKind::Continuous || !matches!(rule, Rule::Mean | Rule::Occupancy) {
            return Ok(());
        }
        let advice = "averages of class numbers are numbers of other classes: choose the rule majority, dominant, nearest, min or max; \
            if the values are continuous, add --kind continuous (in Python: kind=\"continuous\")";
        Err(Error::unsupported(path, format!("the rule {rule} for categorical values"), advice))
    }

    /// Returns the kind's name on the command line.
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

    fn from_str(name: &str) -> Result<DataKind> {
        [DataKind::Categorical, DataKind::Continuous]
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| Error::invalid("kind", format!("`{name}`"), "categorical or continuous"))
    }
}
