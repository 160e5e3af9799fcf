//! World files, and the `.prj` files beside them, which tell the place of a picture that does not tell it itself.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use super::worldfile;
use crate::space::{Crs, Frame};
use crate::{Error, Result};

/// Bytes of a `.prj` file that are read.
const MOST: u64 = 4 << 20;

/// Completes a picture's frame: its map from a world file, its coordinate system from the `.prj` file beside that.
pub(super) fn place(picture: &Path, frame: &mut Frame) -> Result<()> {
    if !frame.is_identity() {
        return Ok(());
    }
    let Some(world) = worldfile::frame_beside(picture)? else { return Ok(()) };
    frame.matrix = world.matrix;
    if frame.crs.is_none()
        && let Some((path, text)) = read(picture.with_extension("prj"))?
    {
        frame.crs = crs(&path, &text)?;
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

/// The coordinate system of a definition in a file; nothing of an empty one.
pub(super) fn crs(path: &Path, definition: &str) -> Result<Option<Crs>> {
    if definition.trim().is_empty() {
        return Ok(None);
    }
    Crs::parse(definition).map(Some).map_err(|error| {
        let advice = "write it as WKT, or move the file away and tell the system with --crs";
        Error::unsupported(path, format!("a definition that is no coordinate system ({error})"), advice)
    })
}
