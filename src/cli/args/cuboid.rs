//! Boxes of octrees as people give them, in cells or in other coordinates.

use anyhow::{Result, bail, ensure};
use spinney::dataset::Dataset;
use spinney::space::{Bounds, Coordinates};

use super::{CoordinatesOption, numbers};

/// A box: the corner with the least coordinates, and the lengths of the edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cuboid {
    corner: [f64; 3],
    size: [f64; 3],
}

/// Reads six numbers: a corner, and the lengths of the edges.
pub(crate) fn parse_cuboid(text: &str) -> Result<Cuboid, String> {
    let numbers = numbers(text).filter(|numbers: &[f64; 6]| numbers.iter().all(|number| number.is_finite()));
    let [x, y, z, width, height, depth] = numbers.ok_or("expected six numbers: x,y,z,width,height,depth")?;
    Ok(Cuboid { corner: [x, y, z], size: [width, height, depth] })
}

impl Cuboid {
    /// The cells of a level that it has; of one in other coordinates than cells those that are in the tree.
    pub(crate) fn cells(&self, tree: &Dataset, level: u8, coordinates: &CoordinatesOption) -> Result<Bounds> {
        let Cuboid { corner, size } = *self;
        ensure!(
            size.iter().all(|length| *length > 0.0),
            "--box: width, height and depth must be more than 0"
        );
        if !coordinates.are_cells() {
            let end = std::array::from_fn(|axis| corner[axis] + size[axis]);
            let boxes = coordinates.places(tree, Coordinates::Cells)?.boxes(corner, end)?;
            let Some(bounds) = boxes.first() else { bail!("--box: outside the solid") };
            let shift = tree.depth() - level;
            let max = bounds.max.map(|cell| cell.div_ceil(1 << shift));
            return Ok(Bounds { min: bounds.min.map(|cell| cell >> shift), max });
        }
        let whole = |number: &f64| number.fract() == 0.0 && (0.0..9e15).contains(number);
        ensure!(
            corner.iter().chain(&size).all(whole),
            "--box: cells are whole numbers; with --in world it is a box in the world"
        );
        let min = corner.map(|number| number as u64);
        Ok(Bounds { min, max: std::array::from_fn(|axis| min[axis] + size[axis] as u64) })
    }
}
