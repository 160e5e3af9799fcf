//! Georeferencing of a GeoTIFF: the model tags and the GeoKeys.

use super::ifd::Directory;
use spinney_base::Result;
use spinney_chunks::spec::tag;
use spinney_crs::{ControlPoint, ControlPoints, Crs, Frame, GeoKeys};

// GeoKey of the raster type and its value for points, by their names in the GeoTIFF specification.
const GT_RASTER_TYPE: u16 = 1025;
const RASTER_PIXEL_IS_POINT: u16 = 2;

/// Georeferencing of an image by its tags.
pub(super) struct Georeferencing {
    /// The identity if there is none.
    pub(super) frame: Frame,
    /// Ground control points, if there is no other georeferencing.
    pub(super) control_points: Option<ControlPoints>,
}

impl Georeferencing {
    pub(super) fn read(directory: &Directory<'_>) -> Result<Georeferencing> {
        let (crs, is_point) = crs(directory)?;
        let Some(mut affine) = affine(directory)? else {
            // Tie points alone are ground control points. No affine map fits them exactly, so the
            // frame is the identity without a coordinate system.
            let points = tie_points(directory, is_point)?;
            return Ok(if points.is_empty() {
                Georeferencing { frame: Frame { crs, ..Frame::identity() }, control_points: None }
            } else {
                Georeferencing {
                    frame: Frame::identity(),
                    control_points: Some(ControlPoints { crs, points }),
                }
            });
        };
        if is_point {
            // Shift the origin from the pixel's centre to its corner.
            let [a, b, _, d, e, _] = affine;
            affine[2] -= (a + b) / 2.0;
            affine[5] -= (d + e) / 2.0;
        }
        let frame = Frame { crs, pixel_is_point: is_point, ..Frame::planar(affine) };
        Ok(Georeferencing { frame, control_points: None })
    }
}

/// The tie points, without those that are not finite.
fn tie_points(directory: &Directory<'_>, is_point: bool) -> Result<Vec<ControlPoint>> {
    // Raster coordinates may refer to pixel centres.
    let centre = if is_point { 0.5 } else { 0.0 };
    let numbers = directory.doubles(tag::MODEL_TIEPOINT)?;
    let points = numbers.as_chunks::<6>().0.iter();
    let points = points.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
    Ok(points
        .map(|&[column, row, _, x, y, z]| ControlPoint {
            cell: [column + centre, row + centre],
            world: [x, y, z],
        })
        .collect())
}

/// The affine map in the tags, in the order of [`Frame::planar`].
fn affine(directory: &Directory<'_>) -> Result<Option<[f64; 6]>> {
    let tie_points = directory.doubles(tag::MODEL_TIEPOINT)?;
    Ok(match (directory.doubles(tag::MODEL_PIXEL_SCALE)?.as_slice(), tie_points.as_slice()) {
        (&[a, e, ..], &[column, row, _, x, y, _, ..]) if a != 0.0 && e != 0.0 => {
            // Scales are positive and rows go south; some writers use a negative scale nonetheless.
            let e = -e.abs();
            Some([a, 0.0, x - column * a, 0.0, e, y - row * e])
        }
        _ => match directory.doubles(tag::MODEL_TRANSFORMATION)?.as_slice() {
            &[a, b, _, c, d, e, _, f, ..] => Some([a, b, c, d, e, f]),
            _ => None,
        },
    }
    .filter(|affine| affine.iter().all(|number| number.is_finite())))
}

/// The coordinate system that the keys define, and whether they declare samples to be points.
fn crs(directory: &Directory<'_>) -> Result<(Option<Crs>, bool)> {
    let table = directory.numbers(tag::GEO_KEY_DIRECTORY)?.unwrap_or_default();
    let table: Vec<u16> = table.into_iter().map(|number| number as u16).collect();
    let doubles = directory.doubles(tag::GEO_DOUBLE_PARAMS)?;
    let strings = directory.bytes(tag::GEO_ASCII_PARAMS)?.unwrap_or_default();
    let mut entries = table.as_chunks::<4>().0.iter().skip(1);
    let is_point = entries.any(|entry| *entry == [GT_RASTER_TYPE, 0, 1, RASTER_PIXEL_IS_POINT]);
    let crs = GeoKeys::new(&table, &doubles, &strings).map(|keys| {
        // Keys that are equivalent to an EPSG code are replaced by it.
        let epsg = Crs::GeoKeys(keys.clone()).numbers();
        match epsg.filter(|epsg| GeoKeys::of_epsg(*epsg).as_ref() == Some(&keys)) {
            Some(epsg) => Crs::Epsg(epsg),
            None => Crs::GeoKeys(keys),
        }
    });
    Ok((crs, is_point))
}
