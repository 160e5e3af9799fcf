//! Values at points.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Transformation};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::PointSamples;

use crate::region::cell_locator;
use crate::result::{Found, sample};

/// How points are queried, whose coordinates are passed separately.
#[derive(Deserialize)]
pub(crate) struct Request {
    crs: Option<String>,
    level: Option<u8>,
}

/// The cell that represents points outside of the raster.
const OUTSIDE: [u64; 3] = [u64::MAX; 3];

/// Returns the cells of a level at points, which have as many numbers each as the tree has axes.
pub(crate) fn cells_at(
    tree: &Dataset,
    (crs, level): (Option<&str>, Option<u8>),
    numbers: &[f64],
) -> Result<(Vec<[u64; 3]>, u8)> {
    let (axes, depth) = (tree.header().form.axes(), tree.depth());
    let level = level.unwrap_or(depth);
    if level > depth {
        return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
    }
    let locator = cell_locator(tree, crs)?;
    let cell = |coordinates: &[f64]| {
        let mut point = [0.0; 3];
        point[..axes].copy_from_slice(coordinates);
        let cell = locator.cell(point).map(|[x, y, z]| if axes == 3 { [x, y, z] } else { [x, y, 0.0] });
        let cell = cell.filter(|cell| locator.is_inside(*cell));
        cell.map_or(OUTSIDE, |cell| cell.map(|at| at.floor() as u64 >> (depth - level)))
    };
    Ok((numbers.chunks_exact(axes).map(cell).collect(), level))
}

/// Returns the values at points.
pub(crate) fn values(tree: &Dataset, request: &Request, numbers: &[f64]) -> Result<Found> {
    let (axes, of) = (tree.header().form.axes(), tree.header().form.value.sample);
    let (cells, level) = cells_at(tree, (request.crs.as_deref(), request.level), numbers)?;
    let mut samples = PointSamples::default();
    tree.points(&cells, level, &mut samples)?;
    let names = &tree.metadata().class_names;
    let point = |(index, cell): (usize, &[u64; 3])| {
        let values = samples.get(index);
        let list: Option<Vec<Value>> =
            values.as_ref().map(|values| values.iter().map(|number| sample(*number, of)).collect());
        let first = values.as_ref().and_then(|values| values.first().copied());
        let is_outside = *cell == OUTSIDE;
        json!({
            "value": list.as_ref().and_then(|list| list.first()),
            "values": list,
            "className": first.and_then(|value| names.get(&value)),
            "cell": if is_outside { Value::Null } else { json!(cell[..axes]) },
            "level": level,
            "isOutside": is_outside,
        })
    };
    Ok(Value::from(cells.iter().enumerate().map(point).collect::<Vec<_>>()).into())
}

/// Returns longitudes and latitudes of points in the tree's own system, two numbers each; null if
/// there are none.
pub(crate) fn geographic(tree: &Dataset, numbers: &[f64]) -> Result<Found> {
    let Some(crs) = &tree.metadata().frame.crs else {
        return Err(Error::unsupported(
            tree.name(),
            "longitude and latitude without a coordinate reference system",
            "give it one with `spinney edit --crs`",
        ));
    };
    let way = Transformation::new(crs, &Crs::epsg(4326), true)?;
    let positions = numbers.chunks_exact(2).map(|point| json!(way.forward([point[0], point[1]])));
    Ok(Value::from(positions.collect::<Vec<_>>()).into())
}
