//! Slices of octrees as arguments, by cells or in the world.

use anyhow::{Result, bail, ensure};
use spinney::Dataset;

/// A slice: the axis perpendicular to it, and its coordinate on that axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Slice {
    pub(crate) axis: usize,
    coordinate: f64,
}

const AXES: [&str; 3] = ["x", "y", "z"];

/// Parses `12` or `z=12`.
pub(crate) fn parse_slice(text: &str) -> Result<Slice, String> {
    let (axis, coordinate) = text.split_once('=').unwrap_or(("z", text));
    let axis = AXES.iter().position(|name| *name == axis.trim().to_lowercase());
    let coordinate = coordinate.trim().parse().ok().filter(|coordinate: &f64| coordinate.is_finite());
    axis.zip(coordinate)
        .map(|(axis, coordinate)| Slice { axis, coordinate })
        .ok_or_else(|| "expected an axis and a coordinate, such as z=12".into())
}

impl Slice {
    /// The first slice along z, the only one of quadtrees.
    pub(crate) const FLOOR: Slice = Slice { axis: 2, coordinate: 0.0 };

    /// Returns the slice's index in cells of the deepest level.
    pub(crate) fn cell(&self, tree: &Dataset, world: bool) -> Result<u64> {
        let Slice { axis, coordinate } = *self;
        let name = AXES[axis];
        let cells = tree.header().extent[axis];
        let cell = if world {
            let row = tree.metadata().frame.matrix[axis];
            let others = (0..3).filter(|other| *other != axis).any(|other| row[other] != 0.0);
            ensure!(
                !others && row[axis] != 0.0,
                "--slice: the tree's {name} axis is not parallel to the world's; give a cell, without --in"
            );
            ((coordinate - row[3]) / row[axis]).floor()
        } else {
            ensure!(
                coordinate.fract() == 0.0,
                "--slice: got {coordinate}, expected an integer cell; for a world coordinate, add --in world"
            );
            coordinate
        };
        if !(0.0..cells as f64).contains(&cell) {
            let last = cells - 1;
            if world {
                bail!(
                    "--slice: world {name}={coordinate} is outside of the tree: cell {cell}, expected 0 to {last}"
                );
            }
            bail!("--slice: cell {name}={coordinate} is outside of the tree, expected 0 to {last}");
        }
        Ok(cell as u64)
    }
}
