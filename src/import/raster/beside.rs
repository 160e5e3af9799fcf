//! What files beside a picture tell of its place, where the picture itself does not: world files, GDAL's
//! `.aux.xml`, and `.prj`.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use super::worldfile;
use super::xml::{elements, unescape};
use crate::space::{Crs, Frame};
use crate::{Error, Result};

/// Bytes of a file that are read. In `.aux.xml` files, which may have long tables, the place comes first.
const MOST: u64 = 4 << 20;

/// Completes a picture's frame: its map from a world file or `.aux.xml`, its coordinate system from `.aux.xml` or,
/// if there is a world file, from `.prj`.
pub(super) fn place(picture: &Path, frame: &mut Frame) -> Result<()> {
    let world = if frame.is_identity() { worldfile::frame_beside(picture)? } else { None };
    if let Some(world) = &world {
        frame.matrix = world.matrix;
    }
    if frame.crs.is_some() && !frame.is_identity() {
        return Ok(());
    }
    let mut name = picture.as_os_str().to_owned();
    name.push(".aux.xml");
    if let Some((path, text)) = read(PathBuf::from(name))? {
        let first = |name| elements(&text, name).next().map(|(_, content)| unescape(content));
        if frame.is_identity()
            && let Some(numbers) = first("GeoTransform")
        {
            frame.matrix = geo_transform(&path, &numbers)?.matrix;
        }
        if frame.crs.is_none()
            && let Some(definition) = first("SRS").filter(|text| !text.trim().is_empty())
        {
            frame.crs = Some(crs(&path, &definition)?);
        }
    }
    if frame.crs.is_none()
        && world.is_some()
        && let Some((path, text)) = read(picture.with_extension("prj"))?
    {
        frame.crs = Some(crs(&path, &text)?);
    }
    Ok(())
}

/// The text of a file, if there is one, and its path.
fn read(path: PathBuf) -> Result<Option<(PathBuf, String)>> {
    let file = match File::open(&path) {
        Ok(file) => file,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(Error::io(path, "open")(error)),
    };
    let mut text = Vec::new();
    file.take(MOST).read_to_end(&mut text).map_err(Error::io(&path, "read"))?;
    Ok(Some((path, String::from_utf8_lossy(&text).into_owned())))
}

fn crs(path: &Path, definition: &str) -> Result<Crs> {
    Crs::parse(definition).map_err(|error| {
        let advice = "write it as WKT, or move the file away and tell the system with --crs";
        Error::unsupported(path, format!("a definition that is no coordinate system ({error})"), advice)
    })
}

/// The frame from GDAL's six numbers, which stand in the order c, a, b, f, d, e.
fn geo_transform(path: &Path, text: &str) -> Result<Frame> {
    let numbers: Vec<f64> = text.split(',').map_while(|word| word.trim().parse().ok()).collect();
    let frame = <[f64; 6]>::try_from(numbers).map(|[c, a, b, f, d, e]| Frame::planar([a, b, c, d, e, f]));
    frame
        .ok()
        .filter(|frame| {
            frame.affine().iter().all(|number| number.is_finite()) && frame.to_cells([0.0; 3]).is_some()
        })
        .ok_or_else(|| {
            Error::corrupt(path, "GeoTransform", "something else", "six numbers that make an invertible map")
        })
}
