//! Ground control points: tie points that no scale makes a map of.

use super::geokeys;
use super::ifd::Directory;
use super::spec::tag;
use crate::Result;
use crate::space::{ControlPoint, ControlPoints};

/// The control points, if that is what the tie points are; those with numbers that are not finite are left out.
pub(super) fn read(directory: &Directory<'_>) -> Result<Option<ControlPoints>> {
    let tie_points = directory.doubles(tag::MODEL_TIEPOINT)?;
    let Some(system) = geokeys::system_of_points(directory)? else { return Ok(None) };
    // A pixel's number may be that of its centre.
    let centre = if geokeys::is_about_centres(directory)? { 0.5 } else { 0.0 };
    let tie_points = tie_points.as_chunks::<6>().0.iter();
    let points: Vec<ControlPoint> = tie_points
        .filter(|numbers| numbers.iter().all(|number| number.is_finite()))
        .map(|&[column, row, _, x, y, z]| ControlPoint {
            cell: [column + centre, row + centre],
            world: [x, y, z],
        })
        .collect();
    Ok((!points.is_empty()).then_some(ControlPoints { system, points }))
}
