//! World files: text files of six numbers that georeference the image next to them, and
//! accompanying `.prj` files.

use std::io::Read;
use std::path::{Path, PathBuf};

use spinney_base::io::{FileAccess, sibling_path, without_query};
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};

/// Maximum bytes read of a `.prj` file.
const MOST: u64 = 4 << 20;

/// Completes an image's frame: the transform from a world file, the coordinate system from the
/// accompanying `.prj` file.
pub(super) fn complete_frame(image: &Path, access: &FileAccess, frame: &mut Frame) -> Result<()> {
    if !frame.is_identity() {
        return Ok(());
    }
    let Some(world) = world_file_frame(image, access)? else { return Ok(()) };
    frame.matrix = world.matrix;
    if frame.crs.is_none() {
        for path in prj_files(image) {
            if let Some((path, text)) = read(path, access)? {
                frame.crs = crs(&path, &text)?;
                break;
            }
        }
    }
    Ok(())
}

/// Reads a text file, if it exists; also returns its path.
fn read(path: PathBuf, access: &FileAccess) -> Result<Option<(PathBuf, String)>> {
    let Some(file) = access.find_companion(&path)? else { return Ok(None) };
    let mut text = Vec::new();
    file.take(MOST).read_to_end(&mut text).map_err(Error::io(&path, "read"))?;
    Ok(Some((path, String::from_utf8_lossy(&text).into_owned())))
}

/// Parses a coordinate system definition; `None` if it is empty.
pub(super) fn crs(path: &Path, definition: &str) -> Result<Option<Crs>> {
    if definition.trim().is_empty() {
        return Ok(None);
    }
    Crs::parse(definition).map(Some).map_err(|error| {
        let advice = "write it as WKT, or move the file away and set the system with --crs";
        Error::unsupported(path, format!("its definition of a coordinate system ({error})"), advice)
    })
}

/// The frame from the world file next to an image, if there is one.
fn world_file_frame(image: &Path, access: &FileAccess) -> Result<Option<Frame>> {
    for path in candidates(image) {
        if let Some(file) = access.find_companion(&path)? {
            let mut text = Vec::new();
            file.take(4096).read_to_end(&mut text).map_err(Error::io(&path, "read"))?;
            return parse(&path, &text).map(Some);
        }
    }
    Ok(None)
}

/// `a.jpgw`, `a.jgw`, `a.wld` and `a.wf` for `a.jpg`; for local files also with extensions in the
/// other case, as `a.JGW`.
pub(super) fn candidates(image: &Path) -> Vec<PathBuf> {
    let extension = without_query(image).extension().unwrap_or_default().to_string_lossy();
    let mut endings = vec![format!("{extension}w"), "wld".into(), "wf".into()];
    if let (Some(first), Some(last)) = (extension.chars().next(), extension.chars().last()) {
        endings.push(format!("{first}{last}w"));
    }
    with_cases(image, &endings)
}

/// The files next to a raster with these extensions. Lower and upper case are both listed, since
/// systems with case-insensitive file names write either. (For remote files each name costs a
/// request, so only the case of the raster's extension is listed.)
fn with_cases(image: &Path, endings: &[String]) -> Vec<PathBuf> {
    let extension = without_query(image).extension().unwrap_or_default().to_string_lossy();
    let is_upper = extension.chars().any(char::is_uppercase);
    let in_case =
        |ending: &String, upper: bool| if upper { ending.to_uppercase() } else { ending.to_lowercase() };
    let mut all: Vec<String> = endings.iter().map(|ending| in_case(ending, is_upper)).collect();
    if !image.to_string_lossy().contains("://") {
        all.extend(endings.iter().map(|ending| in_case(ending, !is_upper)));
        all.extend(endings.iter().cloned());
    }
    let mut paths: Vec<PathBuf> = Vec::new();
    for ending in all {
        let path = sibling_path(image, |path| path.with_extension(&ending));
        if !paths.contains(&path) {
            paths.push(path);
        }
    }
    paths
}

/// Files next to a raster that may have its coordinate system.
pub(super) fn prj_files(image: &Path) -> Vec<PathBuf> {
    with_cases(image, &["prj".into()])
}

fn parse(path: &Path, text: &[u8]) -> Result<Frame> {
    let text = String::from_utf8_lossy(text);
    let numbers: Vec<f64> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
    let Ok([a, d, b, e, x, y]) = <[f64; 6]>::try_from(numbers) else {
        return Err(Error::corrupt(path, "world file", "other text", "six numbers"));
    };
    // The last two are the centre of the first pixel; a frame starts at its corner.
    let frame = Frame::planar([a, b, x - (a + b) / 2.0, d, e, y - (d + e) / 2.0]);
    if frame.matrix.as_flattened().iter().all(|number| number.is_finite())
        && frame.to_cells([0.0; 3]).is_some()
    {
        Ok(frame)
    } else {
        Err(Error::corrupt(
            path,
            "world file",
            "numbers of a map that is not invertible",
            "an invertible affine map",
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn world_file_centres_become_frame_corners() {
        let frame = parse(Path::new("a.pgw"), b"0.5\n0\n0\n-0.25\n10.25\n49.875\n").unwrap();
        assert_eq!(frame.affine(), [0.5, 0.0, 10.0, 0.0, -0.25, 50.0]);
    }

    #[test]
    fn malformed_world_files_are_rejected() {
        for text in ["", "1 2 3 4 5", "1 0 0 1 0 x", "0 0 0 0 0 0", "1 0 0 inf 0 0", "1 0 0 1 0 0 7"] {
            assert!(parse(Path::new("a.pgw"), text.as_bytes()).is_err(), "{text}");
        }
    }

    #[test]
    fn extensions_have_either_case() {
        let directory = tempfile::tempdir().unwrap();
        for (image, world) in [
            ("MAP.TIF", "MAP.TFW"),
            ("x.TIF", "x.tfw"),
            ("y.tif", "y.TFW"),
            ("z.png", "z.pgw"),
            ("v.JPG", "v.JPGw"),
        ] {
            let path = directory.path().join(image);
            let mut frame = Frame::identity();
            complete_frame(&path, &FileAccess::default(), &mut frame).unwrap();
            assert!(frame.is_identity());
            std::fs::write(directory.path().join(world), "2 0 0 -2 11 49").unwrap();
            std::fs::write(path.with_extension("PRJ"), "EPSG:32631").unwrap();
            complete_frame(&path, &FileAccess::default(), &mut frame).unwrap();
            assert_eq!(frame.affine(), [2.0, 0.0, 10.0, 0.0, -2.0, 50.0], "{image}");
            assert!(frame.crs.is_some());
        }
        let remote = candidates(Path::new("https://host/a.tif"));
        assert_eq!(remote.len(), 4);
    }

    #[test]
    fn names() {
        let names = candidates(Path::new("dir/a.b.jpeg"));
        assert!(
            names.contains(&PathBuf::from("dir/a.b.jpegw")) && names.contains(&PathBuf::from("dir/a.b.jgw"))
        );
    }
}
