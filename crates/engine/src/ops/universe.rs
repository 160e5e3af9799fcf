//! Universe of complements: the region in which a set operation may fill cells that are in none of
//! its trees.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::affine::{AffineMap, View};
use super::reconcile::ReconcileOptions;
use crate::store::depth_for;
use crate::tree::Source;
use spinney_base::space::Bounds;
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_crs::Frame;

/// Options of combining trees, for cells that are in none of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CombineOptions {
    /// Value of cells that a set operation fills, for each channel; `None` for 255 in trees of
    /// bytes, else 1.
    #[serde(with = "spinney_base::text_fields")]
    pub fill: Option<Number>,
    /// Region that is filled: see
    /// [`CombineOperation::needs_universe`](super::CombineOperation::needs_universe).
    pub universe: Universe,
    /// Options for aligning the trees with the first.
    #[serde(default)]
    pub reconcile: ReconcileOptions,
}

/// Universe of operations that fill cells that are in none of their trees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Universe {
    /// A raster's extent, or an octree's root: the smallest cube with a power of two of cells that
    /// contains all trees.
    #[default]
    Usual,
    /// Extent of the trees, enlarged by this many cells on every side.
    Margin(u32),
    /// Box in world coordinates: minimum and maximum. (z is ignored for rasters.)
    Within(
        #[serde(with = "spinney_base::text_fields")] [f64; 3],
        #[serde(with = "spinney_base::text_fields")] [f64; 3],
    ),
}

/// Limit of cell coordinates: no tree is deep enough to hold more.
const MAX_COORDINATE: f64 = (1u64 << 40) as f64;

impl Universe {
    /// Aligns the views with a grid that contains the whole universe; also returns the universe's
    /// cells there.
    ///
    /// # Errors
    /// If it is empty or too large for a tree, or the world does not determine cells.
    pub(super) fn around(self, views: Vec<View>) -> Result<(Vec<View>, Bounds)> {
        let (extent, form) = (views[0].extent(), views[0].form());
        let depth = views.iter().map(View::depth).max().unwrap_or(0);
        let all = extent.map(|cells| cells as f64);
        let (low, high) = match self {
            Universe::Usual if form.axes() == 3 => ([0.0; 3], [(1u64 << depth) as f64; 3]),
            Universe::Usual => ([0.0; 3], all),
            Universe::Margin(cells) => {
                let margin = f64::from(cells);
                (all.map(|_| -margin), all.map(|cells| cells + margin))
            }
            Universe::Within(low, high) => box_of_cells(&views[0].frame(false), low, high)?,
        };
        let mut universe = Bounds { min: [0; 3], max: [1; 3] };
        let (mut total, mut shift) = ([1; 3], [0.0; 3]);
        for axis in 0..form.axes() {
            if low[axis] >= high[axis] || !(low[axis] > -MAX_COORDINATE && high[axis] < MAX_COORDINATE) {
                let found = format!("cells {} to {} along an axis", low[axis], high[axis]);
                return Err(Error::invalid(
                    "universe",
                    found,
                    "at least one cell, and at most the number that a tree can have",
                ));
            }
            shift[axis] = (-low[axis]).max(0.0);
            universe.min[axis] = (low[axis] + shift[axis]) as u64;
            universe.max[axis] = (high[axis] + shift[axis]) as u64;
            total[axis] = ((all[axis] + shift[axis]) as u64).max(universe.max[axis]);
        }
        if shift == [0.0; 3] && total[..form.axes()] == extent[..form.axes()] {
            return Ok((views, universe));
        }
        let depth = depth_for(total).max(depth);
        let map = AffineMap::translation(shift);
        let views = views.into_iter().map(|view| view.onto(&map, total)?.deepened(depth));
        Ok((views.collect::<Result<_>>()?, universe))
    }
}

/// Cells of a frame that a box of the world touches. Contact within rounding errors does not count.
fn box_of_cells(frame: &Frame, low: [f64; 3], high: [f64; 3]) -> Result<([f64; 3], [f64; 3])> {
    const CLOSE: f64 = 1e-6;
    let to_cells = AffineMap::from_rows(frame.matrix).inverse()?;
    let (low, high) = to_cells.bounding_box(DVec3::from(low), DVec3::from(high));
    Ok(((low + CLOSE).floor().to_array(), (high - CLOSE).ceil().to_array()))
}
