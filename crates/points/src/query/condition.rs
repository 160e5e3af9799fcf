//! Conditions on the attributes of points.

use crate::attribute::PointAttribute;
use crate::statistics::ColumnStatistics;

/// How a number compares with another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    /// It is equal.
    Equal,
    /// It is not.
    Unequal,
    /// It is less.
    Less,
    /// It is less or equal.
    AtMost,
    /// It is greater.
    Greater,
    /// It is greater or equal.
    AtLeast,
}

/// A comparison of an attribute's quantity with a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointCondition {
    /// The attribute, by its place among all.
    pub attribute: usize,
    /// How it compares.
    pub relation: Relation,
    /// With what.
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

    /// Whether it holds for a number of the attribute.
    pub(crate) fn holds_for(&self, attribute: &PointAttribute, number: i64) -> bool {
        let quantity = attribute.quantity(number);
        // (NaN is unequal to every number, but "no value" fulfils no condition.)
        attribute.no_data != Some(number) && self.holds(quantity)
    }

    /// Whether it can hold for any number between the extremes of a column.
    pub(crate) fn may_hold(
        &self,
        attribute: &PointAttribute,
        column: &ColumnStatistics,
        points: u64,
    ) -> bool {
        // (What is no number is equal to none.)
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
