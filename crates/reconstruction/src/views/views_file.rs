//! Parser of views files, a JSON format.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::value::RawValue;
use spinney_base::{Error, Result};

/// Maximum length of a file, in bytes.
const MAX_BYTES: u64 = 8 << 20;

/// Sine of the minimum angle between a view's direction and its up vector. Unit vectors are
/// accurate to about 2^-51. At this sine the image is rotated by at most 4e-7 radians, half a pixel
/// in 2^20.
const MIN_SINE: f64 = 1e-9;

/// Supported units of length.
const UNITS: [&str; 6] = ["mm", "cm", "m", "km", "in", "ft"];

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with `bounds` and `views`")]
struct Document {
    bounds: [f64; 6],
    unit: Option<String>,
    views: Vec<Box<RawValue>>,
}

/// A view as it is in the file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object that describes a view")]
struct RawView {
    image: PathBuf,
    kind: ImageKind,
    from: Option<[f64; 2]>,
    direction: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    centre: [f64; 3],
    pixel: f64,
    scale: Option<f64>,
    offset: Option<f64>,
    nodata: Option<f64>,
}

/// Kind of an image's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ImageKind {
    Silhouette,
    Depth,
}

/// A view with defaults filled in.
pub(super) struct ViewDescription {
    /// Path of the views file and the view's number, from 1, for error messages.
    pub(super) name: String,
    pub(super) image: PathBuf,
    pub(super) kind: ImageKind,
    /// Unit vectors of the image: to the right, up, and towards the viewer.
    pub(super) axes: [[f64; 3]; 3],
    pub(super) centre: [f64; 3],
    pub(super) pixel: f64,
    pub(super) scale: f64,
    pub(super) offset: f64,
    pub(super) nodata: Option<f64>,
}

/// A parsed views file.
pub(super) struct ViewsFile {
    /// Minimum and maximum corner of the box that is carved.
    pub(super) bounds: [[f64; 3]; 2],
    pub(super) unit: Option<String>,
    pub(super) views: Vec<ViewDescription>,
}

impl ViewsFile {
    /// Reads and parses a file.
    pub(super) fn open(path: &Path) -> Result<ViewsFile> {
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        // (One byte over the limit is enough to detect that the file is too long.)
        file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(Error::io(path, "read"))?;
        if bytes.len() as u64 > MAX_BYTES {
            let advice = "divide the views among several files, and combine the solids with `combine and`";
            return Err(Error::unsupported(
                path,
                format!("a views file of more than {MAX_BYTES} bytes"),
                advice,
            ));
        }
        ViewsFile::parse(path, &bytes)
    }

    fn parse(path: &Path, bytes: &[u8]) -> Result<ViewsFile> {
        let name = path.display();
        let document: Document = serde_json::from_slice(bytes).map_err(|error| {
            let expected = "JSON with `bounds`, six numbers, and `views`, a list";
            Error::invalid(name.to_string(), error.to_string(), expected)
        })?;
        let [x, y, z, to_x, to_y, to_z] = document.bounds;
        let bounds = [[x, y, z], [to_x, to_y, to_z]];
        let sides = (0..3).map(|axis| bounds[1][axis] - bounds[0][axis]);
        if !sides.clone().all(|side| side > 0.0 && side.is_finite()) {
            let found = format!("{:?}", document.bounds);
            let expected = "minimum x, y and z of a box, then its maximum x, y and z, which are larger";
            return Err(Error::invalid(format!("{name}, bounds"), found, expected));
        }
        if let Some(unit) = document.unit.as_deref().filter(|unit| !UNITS.contains(unit)) {
            return Err(Error::invalid(format!("{name}, unit"), unit, UNITS.join(", ")));
        }
        if document.views.is_empty() {
            return Err(Error::invalid(format!("{name}, views"), "none", "at least one"));
        }
        let directory = path.parent().unwrap_or(Path::new(""));
        let views = (1..).zip(&document.views).map(|(number, text)| {
            let name = format!("{name}, view {number}");
            let raw: RawView = serde_json::from_str(text.get()).map_err(|error| {
                Error::invalid(&name, error.to_string(), "the keys of a view: see docs/reconstruction.md")
            })?;
            ViewDescription::of(raw, name, directory)
        });
        Ok(ViewsFile { bounds, unit: document.unit, views: views.collect::<Result<_>>()? })
    }
}

impl ViewDescription {
    fn of(raw: RawView, name: String, directory: &Path) -> Result<ViewDescription> {
        let RawView { image, kind, from, direction, up, centre, pixel, scale, offset, nodata } = raw;
        if !(pixel > 0.0 && pixel.is_finite()) {
            let expected = "the width of a pixel, above zero";
            return Err(Error::invalid(format!("{name}, pixel"), pixel.to_string(), expected));
        }
        let of_depths = [("scale", scale.is_some()), ("offset", offset.is_some())];
        let given = of_depths.iter().find(|(_, is_given)| *is_given);
        if let Some((key, _)) = given.filter(|_| kind == ImageKind::Silhouette) {
            let expected = "nothing: it is for depth images";
            return Err(Error::invalid(format!("{name}, {key}"), "a number", expected));
        }
        let scale = scale.unwrap_or(1.0);
        if !(scale.is_finite() && scale != 0.0) {
            let expected = "the distance of one unit of samples, other than zero";
            return Err(Error::invalid(format!("{name}, scale"), scale.to_string(), expected));
        }
        let axes = match (from, direction, up) {
            (Some(from), None, None) => axes_from(from, &name)?,
            (None, Some(towards), up) => axes_along(towards, up.unwrap_or([0.0, 0.0, 1.0]), &name)?,
            (Some(_), None, Some(_)) => {
                let expected = "nothing: it is for `direction`; `from` has z up";
                return Err(Error::invalid(format!("{name}, up"), "a vector", expected));
            }
            (from, ..) => {
                let found = if from.is_some() { "both" } else { "neither" };
                return Err(Error::invalid(format!("{name}, from or direction"), found, "one of them"));
            }
        };
        let image = directory.join(image);
        let offset = offset.unwrap_or(0.0);
        Ok(ViewDescription { name, image, kind, axes, centre, pixel, scale, offset, nodata })
    }
}

/// Returns the axes for a viewer at an azimuth and at an elevation above the horizon, both in
/// degrees.
fn axes_from([azimuth, elevation]: [f64; 2], name: &str) -> Result<[[f64; 3]; 3]> {
    if !(azimuth.is_finite() && (-90.0..=90.0).contains(&elevation)) {
        let found = format!("[{azimuth}, {elevation}]");
        let expected = "an azimuth, and an elevation of -90 to 90 degrees";
        return Err(Error::invalid(format!("{name}, from"), found, expected));
    }
    let ([east, north], [high, level]) = (sine_and_cosine(azimuth), sine_and_cosine(elevation));
    let towards = [east * level, north * level, high];
    let right = [-north, east, 0.0];
    Ok([right, cross(towards, right), towards])
}

/// Returns the axes for a viewer in a direction, given a vector that points up in the image.
fn axes_along(direction: [f64; 3], up: [f64; 3], name: &str) -> Result<[[f64; 3]; 3]> {
    let wrong = |key: &str, found: [f64; 3], expected: &str| {
        Err(Error::invalid(format!("{name}, {key}"), format!("{found:?}"), expected))
    };
    let Some(towards) = unit(direction) else {
        return wrong("direction", direction, "a vector towards the viewer that is not zero");
    };
    let Some(sky) = unit(up) else { return wrong("up", up, "a vector that is not zero") };
    let right = Some(cross(sky, towards)).filter(|right| length(*right) > MIN_SINE).and_then(unit);
    let Some(right) = right else {
        return wrong(
            "up",
            up,
            "a vector that is not along the direction: give another one that points up in the image",
        );
    };
    Ok([right, cross(towards, right), towards])
}

/// Returns sine and cosine of an angle in degrees. They are exact for multiples of 90 degrees.
fn sine_and_cosine(degrees: f64) -> [f64; 2] {
    match degrees.rem_euclid(360.0) {
        0.0 => [0.0, 1.0],
        90.0 => [1.0, 0.0],
        180.0 => [0.0, -1.0],
        270.0 => [-1.0, 0.0],
        degrees => [degrees.to_radians().sin(), degrees.to_radians().cos()],
    }
}

fn cross([a, b, c]: [f64; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}

fn length([x, y, z]: [f64; 3]) -> f64 {
    x.hypot(y).hypot(z)
}

/// Normalizes a vector to length 1; `None` if its length is zero, subnormal or not finite.
fn unit(vector: [f64; 3]) -> Option<[f64; 3]> {
    let length = length(vector);
    (length.is_normal()).then(|| vector.map(|part| part / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn views(text: &str) -> Result<ViewsFile> {
        ViewsFile::parse(Path::new("a/x.views"), text.as_bytes())
    }

    #[test]
    fn axes_are_those_of_a_viewer() {
        let south = axes_from([180.0, 0.0], "").unwrap();
        assert_eq!(south, [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]);
        assert_eq!(axes_along([0.0, -2.0, 0.0], [0.0, 1.0, 5.0], "").unwrap(), south);
        let above = axes_from([180.0, 90.0], "").unwrap();
        assert_eq!(above, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        let askew = axes_from([215.0, 30.0], "").unwrap();
        for (axis, vector) in askew.iter().enumerate() {
            for (other, with) in askew.iter().enumerate() {
                let product: f64 = (0..3).map(|part| vector[part] * with[part]).sum();
                assert!((product - f64::from(u8::from(axis == other))).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn what_makes_no_sense_is_named() {
        let view = r#""image": "p.png", "kind": "silhouette", "centre": [0,0,0]"#;
        let with = |rest: &str| format!(r#"{{"bounds": [0,0,0,1,1,1], "views": [{{{view}{rest}}}]}}"#);
        let read = views(&with(r#", "pixel": 1, "from": [0, 0]"#)).unwrap();
        assert_eq!(read.views[0].image, Path::new("a/p.png"));
        for (text, expected) in [
            ("", "a/x.views: got EOF"),
            ("{}", "missing field `bounds`"),
            (r#"{"bounds": [0,0,0,1,1,1], "views": []}"#, "a/x.views, views: got none"),
            (r#"{"bounds": [0,0,0,1,1,0], "views": []}"#, "a/x.views, bounds: got [0.0"),
            (r#"{"bounds": [0,0,0,1,1,1e999], "views": []}"#, "out of range"),
            (r#"{"bounds": [-1e308,0,0,1e308,1,1], "views": []}"#, "bounds"),
            (r#"{"bounds": [0,0,0,1,1,1], "unit": "yard", "views": []}"#, "unit: got yard"),
            (r#"{"bounds": [0,0,0,1,1,1], "views": [3]}"#, "a/x.views, view 1: got invalid type"),
            (&with(""), "missing field `pixel`"),
            (&with(r#", "pixel": 0, "from": [0,0]"#), "view 1, pixel: got 0"),
            (&with(r#", "pixel": 1"#), "from or direction: got neither"),
            (&with(r#", "pixel": 1, "from": [0,0], "direction": [0,0,1]"#), "got both"),
            (&with(r#", "pixel": 1, "from": [0,91]"#), "-90 to 90"),
            (&with(r#", "pixel": 1, "from": [0,0], "up": [0,0,1]"#), "up: got a vector"),
            (&with(r#", "pixel": 1, "direction": [0,0,0]"#), "direction: got [0.0"),
            (&with(r#", "pixel": 1, "direction": [0,0,1]"#), "not along the direction"),
            (&with(r#", "pixel": 1, "direction": [0,1,0], "up": [0,0,0]"#), "up: got [0.0"),
            (&with(r#", "pixel": 1, "from": [0,0], "scale": 2"#), "scale: got a number"),
            (&with(r#", "pixel": 1, "from": [0,0], "depth": 2"#), "unknown field `depth`"),
        ] {
            let error = views(text).err().unwrap().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
