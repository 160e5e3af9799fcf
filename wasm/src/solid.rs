//! Octrees: slices, surfaces, what is inside.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::value::Rule;
use spinney_base::{Error, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::PointSamples;

use crate::answer::Found;
use crate::files::Opened;
use crate::part::Part;
use crate::points::cells_at;
use crate::windows::{Detail, samples};

/// A slice across an axis.
#[derive(Deserialize)]
pub(crate) struct Slice {
    axis: Axis,
    /// The coordinate in the world.
    at: Option<f64>,
    /// Or the cell of the deepest level.
    index: Option<u64>,
    #[serde(flatten)]
    part: Part,
    #[serde(flatten)]
    detail: Detail,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Axis {
    X,
    Y,
    Z,
}

/// A surface: of which level, and where.
#[derive(Deserialize)]
pub(crate) struct MeshRequest {
    level: Option<u8>,
    smooth: Option<bool>,
    #[serde(flatten)]
    part: Part,
}

fn check_octree(tree: &Dataset) -> Result<()> {
    if tree.header().form.axes() == 3 {
        return Ok(());
    }
    Err(Error::unsupported(tree.name(), "a quadtree, where an octree is asked for,", "ask for windows"))
}

/// The samples of a slice: columns and rows are the other two axes, in their order.
pub(crate) fn slice(tree: &Dataset, slice: &Slice) -> Result<Found> {
    check_octree(tree)?;
    let axis = slice.axis as usize;
    let extent = tree.header().extent;
    let cell = match (slice.index, slice.at) {
        (Some(index), None) => index,
        (None, Some(at)) => {
            let frame = &tree.metadata().frame;
            let mut world = frame.to_world(extent.map(|cells| cells as f64 / 2.0));
            world[axis] = at;
            let cell = frame.to_cells(world).map_or(f64::NAN, |cell| cell[axis].floor());
            if !(0.0..extent[axis] as f64).contains(&cell) {
                let [low, high] = frame.world_box(&tree.header().picture());
                let expected = format!("{} to {}", low[axis], high[axis]);
                return Err(Error::invalid("at", at.to_string(), expected));
            }
            cell as u64
        }
        (None, None) => 0,
        (Some(_), Some(_)) => return Err(Error::invalid("slice", "both `at` and `index`", "one of the two")),
    };
    if cell >= extent[axis] {
        return Err(Error::invalid("index", cell.to_string(), format!("less than {}", extent[axis])));
    }
    let mut bounds = slice.part.one_box(tree)?;
    (bounds.min[axis], bounds.max[axis]) = (cell, cell + 1);
    let level = slice.detail.level(tree, &bounds)?;
    let mut found = samples(tree, &bounds, level, None, None)?;
    let size = ["width", "height", "layers"].map(|name| found.json[name].clone());
    let [columns, rows] = [[1, 2], [0, 2], [0, 1]][axis];
    (found.json["width"], found.json["height"], found.json["layers"]) =
        (size[columns].clone(), size[rows].clone(), json!(1));
    Ok(found)
}

/// Whether places are in the solid.
pub(crate) fn contains(tree: &Dataset, level: Option<u8>, numbers: &[f64]) -> Result<Found> {
    /// Occupancy from which on a cell is full.
    const HALF: f64 = 128.0;
    check_octree(tree)?;
    let (cells, level) = cells_at(tree, (None, level), numbers)?;
    let mut samples = PointSamples::default();
    tree.points(&cells, level, &mut samples)?;
    let is_occupancy = tree.header().rule == Rule::Occupancy;
    let is_in =
        |index: usize| samples.get(index).is_some_and(|values| !is_occupancy || values[0].to_f64() >= HALF);
    Ok(Value::from((0..cells.len()).map(is_in).collect::<Vec<bool>>()).into())
}

/// The surface of a level.
pub(crate) fn mesh(opened: &Opened, request: &MeshRequest) -> Result<Found> {
    let tree = opened.cells()?;
    check_octree(tree)?;
    let _ = (request.level, request.smooth, &request.part);
    Err(Error::unsupported(tree.name(), "a mesh", "it is to come"))
}
