//! Feature filters: comparisons of attributes with values.

use std::cmp::Ordering;
use std::fmt;
use std::str::FromStr;

use super::feature::FeatureAttribute;
use spinney_base::{Error, Result};
pub use spinney_points::Relation;
use spinney_points::{PointAttribute, PointCondition, attribute_index};

/// Comparisons of attributes, all of which must hold.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FeatureFilter {
    /// The comparisons.
    pub conditions: Vec<AttributeCondition>,
}

/// Comparison of an attribute with a value.
///
/// Numbers compare numerically, however they are written, and strings as strings. A missing value
/// equals only the empty string, and has no order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttributeCondition {
    /// Attribute name.
    pub name: String,
    /// Comparison operator.
    pub relation: Relation,
    /// The value, as text.
    pub value: String,
}

/// Operators, longer ones first.
const SIGNS: [(&str, Relation); 6] = [
    ("!=", Relation::Unequal),
    ("<=", Relation::AtMost),
    (">=", Relation::AtLeast),
    ("=", Relation::Equal),
    ("<", Relation::Less),
    (">", Relation::Greater),
];

impl FromStr for AttributeCondition {
    type Err = Error;

    fn from_str(text: &str) -> Result<AttributeCondition> {
        let wrong = || {
            Error::invalid("condition", text, "NAME=VALUE, as in type=Building, or with !=, <, <=, > or >=")
        };
        let at = text.find(['!', '<', '>', '=']).ok_or_else(wrong)?;
        let (name, rest) = (text[..at].trim(), &text[at..]);
        let found = SIGNS.iter().find_map(|(sign, relation)| Some((*relation, rest.strip_prefix(sign)?)));
        let (relation, value) = found.filter(|_| !name.is_empty()).ok_or_else(wrong)?;
        Ok(AttributeCondition { name: name.into(), relation, value: value.trim().into() })
    }
}

impl fmt::Display for AttributeCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign =
            SIGNS.iter().find(|(_, relation)| *relation == self.relation).map_or("=", |(sign, _)| sign);
        write!(f, "{}{sign}{}", self.name, self.value)
    }
}

impl AttributeCondition {
    /// Returns whether the comparison holds for a value of the attribute.
    pub fn holds(&self, value: &FeatureAttribute) -> bool {
        let order = self.order(value);
        match self.relation {
            Relation::Equal => order == Some(Ordering::Equal),
            Relation::Unequal => order != Some(Ordering::Equal),
            // Missing values, Booleans and JSON may be equal, but have no order.
            _ if !matches!(
                value,
                FeatureAttribute::Integer(_) | FeatureAttribute::Number(_) | FeatureAttribute::Text(_)
            ) =>
            {
                false
            }
            Relation::Less => order == Some(Ordering::Less),
            Relation::AtMost => matches!(order, Some(Ordering::Less | Ordering::Equal)),
            Relation::Greater => order == Some(Ordering::Greater),
            Relation::AtLeast => matches!(order, Some(Ordering::Greater | Ordering::Equal)),
        }
    }

    /// Compares a value with that of the condition.
    fn order(&self, value: &FeatureAttribute) -> Option<Ordering> {
        let equal = |is: bool| is.then_some(Ordering::Equal);
        match value {
            FeatureAttribute::None => equal(self.value.is_empty()),
            FeatureAttribute::Integer(number) => match self.value.parse::<i64>() {
                Ok(other) => Some(number.cmp(&other)),
                Err(_) => (*number as f64).partial_cmp(&self.value.parse().ok()?),
            },
            FeatureAttribute::Number(number) => number.partial_cmp(&self.value.parse().ok()?),
            FeatureAttribute::Text(text) => Some(text.as_str().cmp(&self.value)),
            FeatureAttribute::Boolean(is) => equal(self.value == is.to_string()),
            FeatureAttribute::Json(text) => equal(*text == self.value),
        }
    }
}

impl FromStr for FeatureFilter {
    type Err = Error;

    fn from_str(text: &str) -> Result<FeatureFilter> {
        text.split(',')
            .map(str::parse)
            .collect::<Result<Vec<_>>>()
            .map(|conditions| FeatureFilter { conditions })
    }
}

impl fmt::Display for FeatureFilter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all: Vec<String> = self.conditions.iter().map(AttributeCondition::to_string).collect();
        f.write_str(&all.join(", "))
    }
}

impl FeatureFilter {
    /// Converts the conditions for points with numeric attributes.
    ///
    /// # Errors
    /// If an attribute name is unknown, or a value is not a number.
    pub fn for_points(&self, attributes: &[PointAttribute]) -> Result<Vec<PointCondition>> {
        let condition = |condition: &AttributeCondition| {
            let number = condition.value.parse().map_err(|_| {
                let expected = format!("a number to compare `{}` with", condition.name);
                Error::invalid("condition", format!("`{condition}`"), expected)
            })?;
            let attribute = attribute_index(attributes, &condition.name)?;
            Ok(PointCondition { attribute, relation: condition.relation, number })
        };
        self.conditions.iter().map(condition).collect()
    }

    /// Returns the attribute name of each condition.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.conditions.iter().map(|condition| condition.name.as_str())
    }

    /// Returns whether all conditions hold. `value` returns the feature's value for the condition
    /// with this index.
    pub(super) fn holds<'a>(&self, value: impl Fn(usize) -> Option<&'a FeatureAttribute>) -> bool {
        let holds = |(index, condition): (usize, &AttributeCondition)| {
            condition.holds(value(index).unwrap_or(&FeatureAttribute::None))
        };
        self.conditions.iter().enumerate().all(holds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_strings_compare_by_type() {
        let holds =
            |text: &str, value: &FeatureAttribute| text.parse::<AttributeCondition>().unwrap().holds(value);
        let (ten, half) = (FeatureAttribute::Integer(10), FeatureAttribute::Number(0.5));
        let text = |text: &str| FeatureAttribute::Text(text.into());
        for (condition, value, expected) in [
            ("a=10", &ten, true),
            ("a = 10.0", &ten, true),
            ("a!=10", &ten, false),
            ("a<9", &ten, false),
            ("a>9", &ten, true),
            ("a>=1e1", &ten, true),
            ("a<=x", &ten, false),
            ("a=.5", &half, true),
            ("a<1", &half, true),
            ("a<9", &text("10"), true),
            ("a=10.0", &text("10"), false),
            ("a>=b", &text("b"), true),
            ("a=", &FeatureAttribute::None, true),
            ("a!=3", &FeatureAttribute::None, true),
            ("a<3", &FeatureAttribute::None, false),
            ("a<=", &FeatureAttribute::None, false),
            ("a=true", &FeatureAttribute::Boolean(true), true),
            ("a>=true", &FeatureAttribute::Boolean(true), false),
            ("a=x=y", &text("x=y"), true),
        ] {
            assert_eq!(holds(condition, value), expected, "{condition} {value:?}");
        }
        // Also above 2^53.
        assert!(!holds("a=9007199254740993", &FeatureAttribute::Integer(9_007_199_254_740_992)));
        for wrong in ["", "a", "=3", "a!3", " <3"] {
            assert!(wrong.parse::<AttributeCondition>().is_err(), "{wrong}");
        }
        let both: FeatureFilter = "code >= 3,kind!=lake".parse().unwrap();
        assert_eq!((both.conditions.len(), both.to_string()), (2, "code>=3, kind!=lake".into()));
    }
}
