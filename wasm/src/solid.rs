//! Octrees: slices, surfaces, containment.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::value::Rule;
use spinney_base::{Error, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::ViewOperation;
use spinney_engine::query::PointSamples;
use spinney_mesh::export::{MeshRequest as SurfaceRequest, SurfaceMesh, surface_mesh};

use crate::files::Opened;
use crate::images::slice_image;
use crate::points::cells_at;
use crate::region::Region;
use crate::result::{Found, bytes_of};
use crate::windows::{Detail, at_level, samples};

/// A slice across an axis.
#[derive(Deserialize)]
pub(crate) struct Slice {
    axis: Axis,
    /// World coordinate.
    at: Option<f64>,
    /// Alternatively, the cell of the deepest level.
    index: Option<u64>,
    /// A style, for colours instead of samples.
    style: Option<String>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Axis {
    X,
    Y,
    Z,
}

/// A surface: its level, and whether it is smooth.
#[derive(Deserialize)]
pub(crate) struct MeshRequest {
    level: Option<u8>,
    smooth: Option<bool>,
}

fn check_octree(tree: &Dataset) -> Result<()> {
    if tree.header().form.axes() == 3 {
        return Ok(());
    }
    Err(Error::unsupported(
        tree.name(),
        "this query of a quadtree",
        "only octrees have it; quadtrees have windows",
    ))
}

/// Returns a slice, whose columns and rows are the other two axes, in their order: its samples, or
/// its colours if there is a style.
pub(crate) fn slice(opened: &Opened, (region, detail): (&Region, &Detail), slice: &Slice) -> Result<Found> {
    let tree = opened.cells()?;
    check_octree(tree)?;
    let axis = slice.axis as usize;
    let mut bounds = region.one_box(tree)?;
    let cell = cell_of(tree, slice)?;
    (bounds.min[axis], bounds.max[axis]) = (cell, cell + 1);
    let level = detail.level(tree, &bounds)?;
    if slice.style.is_some() {
        return slice_image(tree, &opened.prepared, slice.style.as_ref(), (&bounds, level, axis));
    }
    let mut found = samples(tree, &bounds, level, None, None)?;
    let size = ["width", "height", "layers"].map(|name| found.json[name].clone());
    let [columns, rows] = IN_SLICE[axis];
    (found.json["width"], found.json["height"], found.json["layers"]) =
        (size[columns].clone(), size[rows].clone(), json!(1));
    Ok(found)
}

/// Axes of a slice's columns and rows, by the axis that it is across.
pub(crate) const IN_SLICE: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

/// Returns the cell of a slice along its axis.
fn cell_of(tree: &Dataset, slice: &Slice) -> Result<u64> {
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
                let [low, high] = frame.world_box(&tree.header().extent_bounds());
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
    Ok(cell)
}

/// Returns whether points are in the solid.
pub(crate) fn contains(tree: &Dataset, level: Option<u8>, numbers: &[f64]) -> Result<Found> {
    /// Minimum occupancy of a full cell.
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

/// Returns the surface of a level as triangles: vertices relative to an origin, and three vertex
/// numbers each.
pub(crate) fn mesh(tree: &Dataset, region: &Region, request: &MeshRequest) -> Result<Found> {
    check_octree(tree)?;
    let depth = tree.depth();
    let level = request.level.unwrap_or(depth);
    if level > depth {
        return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
    }
    let bounds = match region.boxes(tree)? {
        None => None,
        Some(_) => Some(region.one_box(tree)?),
    };
    let mut wanted = SurfaceRequest::new();
    wanted.smooth = request.smooth.unwrap_or(false);
    let surface = match bounds {
        None => {
            wanted.level = Some(level);
            surface_mesh(tree, &wanted, &())?
        }
        Some(bounds) => {
            // (Aligned to the level's cells, so that adjacent regions have no gaps.)
            let shift = depth - level;
            let cells = at_level(&bounds, shift);
            let min = cells.min.map(|cell| (cell << shift) as i64);
            let size = cells.size().map(|cells| cells << shift);
            let view =
                tree.layer(&tree.layer_number().to_string())?.view(&[ViewOperation::Window(min, size)])?;
            // (The window's space may be smaller: its levels are counted from the cells, too.)
            wanted.level = Some(view.depth().saturating_sub(shift));
            surface_mesh(&view, &wanted, &())?
        }
    };
    let SurfaceMesh { vertices, triangles } = surface;
    let origin: [f64; 3] = match vertices.is_empty() {
        true => [0.0; 3],
        false => std::array::from_fn(|axis| vertices.iter().map(|at| at[axis]).fold(f64::INFINITY, f64::min)),
    };
    let corner = |at: &[f64; 3]| std::array::from_fn(|axis| (at[axis] - origin[axis]) as f32);
    let positions: Vec<[f32; 3]> = vertices.iter().map(corner).collect();
    let buffers = vec![
        bytes_of(positions.as_flattened(), f32::to_le_bytes),
        bytes_of(triangles.as_flattened(), u32::to_le_bytes),
    ];
    Ok(Found { json: json!({ "origin": origin, "level": level }), buffers })
}
