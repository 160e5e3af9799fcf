//! Parts of octrees as people give them: slices and boxes, in cells or in the world.

use anyhow::{Context as _, Result, bail, ensure};
use spinney::dataset::Dataset;
use spinney::space::Bounds;

/// A slice: the axis it lies across, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slice {
    pub(super) axis: usize,
    place: f64,
}

/// `12` or `z=12`.
pub(super) fn parse_slice(text: &str) -> Result<Slice, String> {
    let (axis, place) = text.split_once('=').unwrap_or(("z", text));
    let axis = ["x", "y", "z"].iter().position(|name| *name == axis.trim().to_lowercase());
    let place = place.trim().parse().ok().filter(|place: &f64| place.is_finite());
    axis.zip(place)
        .map(|(axis, place)| Slice { axis, place })
        .ok_or_else(|| "expected z=12, x=3 or y=5".into())
}

/// Six numbers: a corner, and the length of the edges.
pub(super) fn parse_box(text: &str) -> Result<[f64; 6], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let numbers = numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
    numbers
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| "expected six numbers: x,y,z,width,height,depth".into())
}

const AXES: [&str; 3] = ["x", "y", "z"];

impl Slice {
    /// The first slice along an axis.
    pub(super) const FLOOR: Slice = Slice { axis: 2, place: 0.0 };

    /// The cell of the deepest level in which it lies.
    pub(super) fn cell(&self, tree: &Dataset, world: bool) -> Result<u64> {
        let Slice { axis, place } = *self;
        let name = AXES[axis];
        let extent = tree.header().extent;
        let cell = if world {
            let row = tree.metadata().frame.matrix[axis];
            let others = (0..3).filter(|other| *other != axis).any(|other| row[other] != 0.0);
            ensure!(
                !others && row[axis] != 0.0,
                "--slice: the tree's {name} is not along the world's: give a cell"
            );
            ((place - row[3]) / row[axis]).floor()
        } else {
            ensure!(
                place.fract() == 0.0,
                "--slice: {place} is no cell; with --world it is a place in the world"
            );
            place
        };
        if !(0.0..extent[axis] as f64).contains(&cell) {
            let last = extent[axis] - 1;
            if world {
                bail!("--slice: {name}={place} is outside the tree, in cell {cell} of 0 to {last}");
            }
            bail!("--slice: {place} is outside the tree, which has slices 0 to {last}");
        }
        Ok(cell as u64)
    }
}

/// The cells of a level that a box has; the whole tree if there is none.
pub(super) fn box_cells(
    tree: &Dataset,
    numbers: Option<[f64; 6]>,
    level: u8,
    world: bool,
) -> Result<Bounds> {
    let Some([x, y, z, width, height, depth]) = numbers else { return Ok(tree.extent_at(level)) };
    let (corner, size) = ([x, y, z], [width, height, depth]);
    ensure!(size.iter().all(|length| *length > 0.0), "--box: width, height and depth must be more than 0");
    if !world {
        let whole = |number: &f64| number.fract() == 0.0 && (0.0..9e15).contains(number);
        ensure!(
            corner.iter().chain(&size).all(whole),
            "--box: cells are whole numbers; with --world it is a box in the world"
        );
        let min = corner.map(|number| number as u64);
        return Ok(Bounds { min, max: std::array::from_fn(|axis| min[axis] + size[axis] as u64) });
    }
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for number in 0..8 {
        let point = std::array::from_fn(|axis| corner[axis] + f64::from(number >> axis & 1u8) * size[axis]);
        let cell = frame.to_cells(point).context("the file's transform has no inverse")?;
        for axis in 0..3 {
            low[axis] = low[axis].min(cell[axis]);
            high[axis] = high[axis].max(cell[axis]);
        }
    }
    // Edges that are a rounding error beside a cell's edge mean that edge.
    let bounds = Bounds {
        min: low.map(|cell| (cell + 1e-6).floor().max(0.0) as u64),
        max: high.map(|cell| (cell - 1e-6).ceil().max(0.0) as u64),
    };
    let inside = bounds.intersect(&tree.extent_at(level));
    ensure!(!inside.is_empty(), "--box: outside the solid");
    Ok(inside)
}
