//! Conditions on point attributes.

use crate::attribute::PointAttribute;
use crate::statistics::ColumnStatistics;

/// Comparison operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    /// Equal.
    Equal,
    /// Not equal.
    Unequal,
    /// Less.
    Less,
    /// Less or equal.
    AtMost,
    /// Greater.
    Greater,
    /// Greater or equal.
    AtLeast,
}

/// Comparison of an attribute's quantity with a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointCondition {
    /// Index of the attribute.
    pub attribute: usize,
    /// Operator.
    pub relation: Relation,
    /// Right-hand side.
    pub number: f64,
}

impl PointCondition {
    fn holds(&self, quantity: f64) -> bool {
        match self.relation {
            Relation::Equal => quantity == self.number,
            Relation::Unequal => quantity != self.number,
            Relation::Less => quantity < self.number,
            Relation::AtMost => quantity <= self.number,
            Relation::Greater => quantity > self.number,
            Relation::AtLeast => quantity >= self.number,
        }
    }

    /// Returns whether the condition holds for a number of the attribute.
    pub(crate) fn holds_for(&self, attribute: &PointAttribute, number: i64) -> bool {
        let quantity = attribute.quantity(number);
        // NaN is unequal to every number, but "no value" satisfies no condition.
        attribute.no_data != Some(number) && self.holds(quantity)
    }

    /// Returns whether the condition can hold for any number between the extremes of a column.
    pub(crate) fn may_hold(
        &self,
        attribute: &PointAttribute,
        column: &ColumnStatistics,
        points: u64,
    ) -> bool {
        // NaN values, which `count` excludes, satisfy `Unequal`.
        if column.count < points {
            return true;
        }
        let ends = [column.least, column.most].map(|number| attribute.quantity(number));
        let (least, most) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        match self.relation {
            Relation::Equal => least <= self.number && self.number <= most,
            Relation::Unequal => least != most || least != self.number,
            Relation::Less | Relation::AtMost => self.holds(least),
            Relation::Greater | Relation::AtLeast => self.holds(most),
        }
    }
}
