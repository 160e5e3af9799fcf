//! Georeferencing of a GeoTIFF: the model tags and the GeoKeys.

use std::collections::HashMap;

use super::ifd::Directory;
use super::spec::tag;
use crate::Result;
use crate::space::Frame;

// Keys by their names in the GeoTIFF specification.
const GT_MODEL_TYPE: u16 = 1024;
const GT_RASTER_TYPE: u16 = 1025;
const GT_CITATION: u16 = 1026;
const GEOGRAPHIC_TYPE: u16 = 2048;
const GEOG_CITATION: u16 = 2049;
const PROJECTED_CS_TYPE: u16 = 3072;
const PCS_CITATION: u16 = 3073;
const PROJECTION: u16 = 3074;

// Values of the keys for the model and raster type.
const MODEL_TYPE_PROJECTED: u16 = 1;
const RASTER_PIXEL_IS_POINT: u16 = 2;

/// The frame that the tags tell, the identity if none.
pub(super) fn frame(directory: &Directory<'_>) -> Result<Frame> {
    let keys = Keys::read(directory)?;
    let point = keys.numbers.get(&GT_RASTER_TYPE) == Some(&RASTER_PIXEL_IS_POINT);
    let Some(mut affine) = affine(directory)? else {
        // Tie points alone are ground control points, which no affine map goes through: then there is only
        // the picture itself, and its coordinate system would be misleading.
        let system = if directory.has(tag::MODEL_TIEPOINT) { None } else { keys.epsg() };
        return Ok(Frame { epsg: system, ..Frame::identity() });
    };
    if point {
        // What is said of a pixel's centre is to be said of its corner.
        let [a, b, _, d, e, _] = affine;
        affine[2] -= (a + b) / 2.0;
        affine[5] -= (d + e) / 2.0;
    }
    Ok(Frame { epsg: keys.epsg(), crs_name: keys.name(), pixel_is_point: point, ..Frame::planar(affine) })
}

/// The coordinate system alone, for control points; nothing if the tags tell a map.
pub(super) fn system_of_points(directory: &Directory<'_>) -> Result<Option<Frame>> {
    if affine(directory)?.is_some() {
        return Ok(None);
    }
    let keys = Keys::read(directory)?;
    Ok(Some(Frame { epsg: keys.epsg(), crs_name: keys.name(), ..Frame::identity() }))
}

/// Whether what is said of a pixel is said of its centre.
pub(super) fn is_about_centres(directory: &Directory<'_>) -> Result<bool> {
    Ok(Keys::read(directory)?.numbers.get(&GT_RASTER_TYPE) == Some(&RASTER_PIXEL_IS_POINT))
}

/// The affine map as it stands, in the order of [`Frame::planar`].
fn affine(directory: &Directory<'_>) -> Result<Option<[f64; 6]>> {
    let tie_points = directory.doubles(tag::MODEL_TIEPOINT)?;
    Ok(match (directory.doubles(tag::MODEL_PIXEL_SCALE)?.as_slice(), tie_points.as_slice()) {
        (&[a, e, ..], &[column, row, _, x, y, _, ..]) if a != 0.0 && e != 0.0 => {
            // Scales have no sign, rows go south; some writers give a negative number nonetheless.
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

/// The GeoKeys that have a number of 16 bits or a text.
#[derive(Default)]
struct Keys {
    numbers: HashMap<u16, u16>,
    texts: HashMap<u16, String>,
}

impl Keys {
    fn read(directory: &Directory<'_>) -> Result<Keys> {
        let table = directory.numbers(tag::GEO_KEY_DIRECTORY)?.unwrap_or_default();
        let texts = directory.bytes(tag::GEO_ASCII_PARAMS)?.unwrap_or_default();
        let mut keys = Keys::default();
        // The first four numbers are a version and a count, which the tag's length tells as well.
        for entry in table.as_chunks::<4>().0.iter().skip(1) {
            let [key, location, count, value] = entry.map(|number| number as u16);
            match location {
                0 => {
                    keys.numbers.insert(key, value);
                }
                tag::GEO_ASCII_PARAMS => {
                    let (start, count) = (usize::from(value), usize::from(count));
                    let Some(text) = texts.get(start..start + count) else { continue };
                    let text = String::from_utf8_lossy(text);
                    keys.texts.insert(key, text.trim_end_matches(['|', '\0', ' ']).to_string());
                }
                _ => {}
            }
        }
        Ok(keys)
    }

    /// The EPSG number of the horizontal coordinate system.
    fn epsg(&self) -> Option<u32> {
        let cited = |words: &str| self.texts.values().any(|text| text.to_lowercase().contains(words));
        // Some writers have names of their own for the system that most web maps use.
        if cited("wgs_1984_web_mercator_auxiliary_sphere") || self.numbers.get(&PROJECTION) == Some(&3856) {
            return Some(3857);
        }
        // ERDAS Imagine gives the metric system's number for systems in feet.
        if cited("imagine geotiff support") && cited("feet") {
            return None;
        }
        let code = match self.numbers.get(&PROJECTED_CS_TYPE) {
            Some(code) => code,
            None if self.numbers.get(&GT_MODEL_TYPE) == Some(&MODEL_TYPE_PROJECTED) => return None,
            None => self.numbers.get(&GEOGRAPHIC_TYPE)?,
        };
        // 0 is undefined, 32767 is defined by the user.
        (1024..32767).contains(code).then_some(u32::from(*code))
    }

    fn name(&self) -> Option<String> {
        let names = [GT_CITATION, PCS_CITATION, GEOG_CITATION];
        names.iter().find_map(|key| self.texts.get(key)).filter(|name| !name.is_empty()).cloned()
    }
}
