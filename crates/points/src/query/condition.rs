//! Conditions on the attributes of points.

use crate::attribute::{Attribute, to_f64};
use crate::statistics::ColumnStatistics;

/// How a number compares with another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointRelation {
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
    pub relation: PointRelation,
    /// With what.
    pub number: f64,
}

impl PointCondition {
    fn holds(&self, quantity: f64) -> bool {
        match self.relation {
            PointRelation::Equal => quantity == self.number,
            PointRelation::Unequal => quantity != self.number,
            PointRelation::Less => quantity < self.number,
            PointRelation::AtMost => quantity <= self.number,
            PointRelation::Greater => quantity > self.number,
            PointRelation::AtLeast => quantity >= self.number,
        }
    }

    /// Whether it holds for a number of the attribute.
    pub(crate) fn holds_for(&self, attribute: &Attribute, number: i64) -> bool {
        self.holds(attribute.quantity(to_f64(attribute.sample, number)))
    }

    /// Whether it can hold for any number between the extremes of a column.
    pub(crate) fn may_hold(&self, attribute: &Attribute, column: &ColumnStatistics, points: u64) -> bool {
        // (What is no number is equal to none.)
        if column.count < points {
            return true;
        }
        let ends =
            [column.least, column.most].map(|number| attribute.quantity(to_f64(attribute.sample, number)));
        let (least, most) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        match self.relation {
            PointRelation::Equal => least <= self.number && self.number <= most,
            PointRelation::Unequal => least != most || least != self.number,
            PointRelation::Less | PointRelation::AtMost => self.holds(least),
            PointRelation::Greater | PointRelation::AtLeast => self.holds(most),
        }
    }
}
