//! The inside of a body as an octree source of interpolated values.

use super::{BodySamples, BodyValueOptions};
use spinney_base::space::Dimension;
use spinney_base::value::{SampleType, Value, ValueType};
use spinney_base::{Progress, Result, TreeType};
use spinney_brep::ExactModel;
use spinney_brep::query::{BoxLocation, Location};
use spinney_engine::store::builder::ReusableSource;
use spinney_engine::tree::{Child, Children, Source};
use spinney_points::PointIndex;

/// Distance from the outermost cell centres of a box to the sides of the box that is located, in
/// cells: faces through a centre cut the box.
const MARGIN: f64 = 0.25;

/// Offset of centres on the surface, in cells. It is parallel to few planes that models have.
const OFFSET: [f64; 3] = [0.001, 0.000_61, 0.000_43];

/// Means of the nearest samples, weighted by inverse squares of distances.
pub(super) struct Interpolation<'a> {
    index: PointIndex,
    values: &'a [f64],
    nearest: usize,
    radius: f64,
}

impl<'a> Interpolation<'a> {
    pub(super) fn new(samples: &'a BodySamples, nearest: usize, radius: f64) -> Interpolation<'a> {
        Interpolation { index: PointIndex::new(&samples.positions), values: &samples.values, nearest, radius }
    }

    /// Value at a point; `None` without a sample within the radius.
    fn at(&self, point: [f64; 3]) -> Option<f64> {
        let found = self.index.nearest(point, self.nearest, self.radius);
        let least = found.first()?.0;
        // (Relative to the nearest sample's, no weight overflows.)
        let weight = |square: f64| match least {
            0.0 => f64::from(u8::from(square == 0.0)),
            _ => least / square,
        };
        let sum: f64 = found.iter().map(|(square, _)| weight(*square)).sum();
        if !sum.is_finite() {
            // (All squares are beyond the range of doubles.)
            return Some(self.values[found[0].1 as usize]);
        }
        let (mut mean, mut low, mut high) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
        for (square, number) in &found {
            let (value, share) = (self.values[*number as usize], weight(*square) / sum);
            if share > 0.0 {
                mean += share * value;
                (low, high) = (low.min(value), high.max(value));
            }
        }
        // (A mean of equal values is exact.)
        Some(mean.clamp(low, high))
    }
}

/// The cells inside of a body.
pub(super) struct BodyTree<'a> {
    pub(super) model: &'a ExactModel,
    pub(super) interpolation: Interpolation<'a>,
    pub(super) options: &'a BodyValueOptions,
    pub(super) progress: &'a dyn Progress,
}

/// A box of cells that the body has a part of.
#[derive(Clone, Copy)]
pub(super) struct BodyBox {
    level: u8,
    /// Position among the boxes of its level.
    position: [u32; 3],
    /// Whether all centres are inside.
    is_inside: bool,
}

impl BodyTree<'_> {
    /// Returns a box as a child: VOID, LEAF or INNER.
    fn child(&self, node: BodyBox) -> Result<Child<BodyBox>> {
        let BodyValueOptions { depth, extent, frame, .. } = self.options;
        let width = 1u64 << (depth - node.level);
        let first = node.position.map(|position| u64::from(position) * width);
        if first.iter().zip(extent).any(|(first, extent)| first >= extent) {
            return Ok(Child::Void);
        }
        let first = first.map(|cell| cell as f64);
        if node.level == *depth {
            let centre = first.map(|cell| cell + 0.5);
            if !node.is_inside && !self.is_inside(centre)? {
                return Ok(Child::Void);
            }
            let value = self.interpolation.at(frame.to_world(centre));
            return Ok(Child::uniform(value.map(|value| self.value(value))));
        }
        let is_inside = match node.is_inside {
            true => true,
            false => match self.locate_box(first, width as f64)? {
                BoxLocation::Outside => return Ok(Child::Void),
                location => location == BoxLocation::Inside,
            },
        };
        // (The store computes the representative from the children.)
        Ok(Child::Inner { representative: self.value(0.0), node: BodyBox { is_inside, ..node } })
    }

    /// Locates the box around the centres of cells.
    fn locate_box(&self, first: [f64; 3], width: f64) -> Result<BoxLocation> {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for corner in 0..8 {
            let reach = |axis: usize| if corner >> axis & 1 == 1 { width - MARGIN } else { MARGIN };
            let point = self.options.frame.to_world([0, 1, 2].map(|axis| first[axis] + reach(axis)));
            for (axis, at) in point.iter().enumerate() {
                bounds[0][axis] = bounds[0][axis].min(*at);
                bounds[1][axis] = bounds[1][axis].max(*at);
            }
        }
        Ok(self.model.locate_box(bounds[0], bounds[1])?.0)
    }

    /// Whether the centre of a cell is inside.
    fn is_inside(&self, centre: [f64; 3]) -> Result<bool> {
        let frame = &self.options.frame;
        Ok(match self.model.locate(frame.to_world(centre))? {
            Location::Inside => true,
            Location::Outside => false,
            Location::Boundary => {
                let moved = [0, 1, 2].map(|axis| centre[axis] + OFFSET[axis]);
                self.model.locate(frame.to_world(moved))? == Location::Inside
            }
        })
    }

    fn value(&self, number: f64) -> Value {
        match self.options.sample {
            SampleType::F32 => Value::from([number as f32]),
            _ => Value::from([number]),
        }
    }
}

impl Source for BodyTree<'_> {
    type Node = BodyBox;

    fn form(&self) -> TreeType {
        TreeType::new(Dimension::Oct, ValueType::new(self.options.sample, 1))
    }

    fn depth(&self) -> u8 {
        self.options.depth
    }

    fn root(&self) -> Result<Child<BodyBox>> {
        self.child(BodyBox { level: 0, position: [0; 3], is_inside: false })
    }

    fn children(&self, node: &BodyBox, children: &mut Children<BodyBox>) -> Result<()> {
        self.progress.check()?;
        for (number, child) in (0..8).zip(children) {
            let position = [0, 1, 2].map(|axis| 2 * node.position[axis] + (number >> axis & 1));
            *child = self.child(BodyBox { level: node.level + 1, position, ..*node })?;
        }
        Ok(())
    }

    fn check_unchanged(&self) -> Result<()> {
        self.model.check_unchanged()
    }
}

impl ReusableSource for BodyTree<'_> {}
