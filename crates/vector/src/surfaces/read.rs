//! Reads points, lines and polygons for surfaces.

use std::path::{Path, PathBuf};

use super::boreholes::{BoreholeAttributes, BoreholeReport, read_boreholes};
use crate::import::feature::{FeatureAttribute, FeatureGeometry, FeatureOptions, open_features};
use spinney_base::{Error, Result};
use spinney_crs::{Crs, PolygonParts};

/// Name of the height attribute of breaklines and of boreholes' mouths, in any case.
pub(super) const HEIGHT: &str = "z";

/// Input files of surfaces.
#[derive(Clone, Debug, Default)]
pub struct SurfaceFiles {
    /// Point features.
    pub points: PathBuf,
    /// Names of the height attributes, one per surface; with `boreholes`, names of layers.
    pub heights: Vec<String>,
    /// Attributes of boreholes in long form: a feature for each borehole and layer.
    pub boreholes: Option<BoreholeAttributes>,
    /// Selection of the points, and whether coordinates of all files are checked to be degrees.
    pub options: FeatureOptions,
    /// Lines that become edges; their height is the attribute `z`, if they have it.
    pub breaklines: Option<PathBuf>,
    /// Polygons that bound the surface.
    pub outline: Option<PathBuf>,
}

/// Input geometry of surfaces.
#[derive(Clone, Debug, Default)]
pub struct SurfacePoints {
    /// Points of each surface.
    pub points: Vec<Vec<[f64; 3]>>,
    /// Number of points without a height, per surface.
    pub without: Vec<u64>,
    /// Breaklines; unknown heights are NaN.
    pub breaklines: Vec<Vec<[f64; 3]>>,
    /// Polygons.
    pub outlines: PolygonParts,
    /// Coordinate system, if known.
    pub crs: Option<Crs>,
    /// The first file that has it.
    pub crs_file: Option<PathBuf>,
    /// Counts of boreholes in long form.
    pub boreholes: Option<BoreholeReport>,
}

/// Reads the input of surfaces. A feature without a numeric height is left out of that surface.
/// Features are read one by one; points and lines are kept in memory.
///
/// # Errors
/// Those of [`open_features`]; if the features are of other kinds, heights are not numeric, or the
/// files have different coordinate systems; if a borehole has a layer at several depths.
pub fn read_surfaces(files: &SurfaceFiles) -> Result<SurfacePoints> {
    let path = &files.points;
    let mut found = match &files.boreholes {
        Some(attributes) => read_boreholes(path, &files.heights, attributes, &files.options)?,
        None => read_points(path, &files.heights, &files.options)?,
    };
    if let Some(at) = found.points.iter().position(Vec::is_empty) {
        let expected = match files.boreholes {
            None => "an attribute that is a number for at least three points",
            Some(_) => "the name of a layer, with a depth in at least three boreholes",
        };
        return Err(Error::invalid(
            "heights",
            format!("`{}` without any in {}", files.heights[at], path.display()),
            expected,
        ));
    }
    let check_degrees = files.options.check_degrees;
    let reading = FeatureOptions { check_degrees, ..FeatureOptions::default() };
    let file_of = |crs: &Option<Crs>, path: &PathBuf| crs.is_some().then(|| path.clone());
    if let Some(path) = &files.breaklines {
        found.breaklines = read_lines(path, &reading, &mut found.crs)?;
        found.crs_file = found.crs_file.or_else(|| file_of(&found.crs, path));
    }
    if let Some(path) = &files.outline {
        found.outlines = read_polygons(path, &reading, &mut found.crs)?;
        found.crs_file = found.crs_file.or_else(|| file_of(&found.crs, path));
    }
    Ok(found)
}

/// Reads points whose attributes are the heights of surfaces.
fn read_points(path: &Path, heights: &[String], options: &FeatureOptions) -> Result<SurfacePoints> {
    let options = FeatureOptions { attributes: Some(heights.to_vec()), ..options.clone() };
    let mut reader = open_features(path, &options)?;
    let crs = reader.schema().crs.clone();
    let mut found = SurfacePoints {
        points: vec![Vec::new(); heights.len()],
        without: vec![0; heights.len()],
        crs_file: crs.is_some().then(|| path.to_path_buf()),
        crs,
        ..SurfacePoints::default()
    };
    while let Some(feature) = reader.next()? {
        let points = match feature.geometry {
            None => continue,
            Some(FeatureGeometry::Points(points)) => points,
            Some(_) => {
                let advice = "surfaces need points; give lines as --breaklines, and polygons as --outline";
                return Err(Error::unsupported(path, "a feature that is not a point", advice));
            }
        };
        for (surface, value) in feature.attributes.iter().enumerate() {
            match number(value) {
                Some(height) => found.points[surface].extend(points.iter().map(|[x, y]| [*x, *y, height])),
                None => found.without[surface] += points.len() as u64,
            }
        }
    }
    Ok(found)
}

/// Converts a value to a number, if it is finite. (In a column that has words too, such as `n/a`,
/// all values of CSV files are strings.)
pub(super) fn number(value: &FeatureAttribute) -> Option<f64> {
    let number = match value {
        FeatureAttribute::Integer(number) => *number as f64,
        FeatureAttribute::Number(number) => *number,
        FeatureAttribute::Text(text) => text.trim().parse().ok()?,
        _ => return None,
    };
    Some(number).filter(|number| number.is_finite())
}

/// Fails if a file's coordinate system differs from that of the previous files.
fn agree(path: &Path, crs: &mut Option<Crs>, other: Option<&Crs>) -> Result<()> {
    match (&crs, other) {
        (Some(crs), Some(other)) if crs != other => {
            let advice = "transform both to one system first";
            Err(Error::unsupported(path, "a coordinate system other than that of the points", advice))
        }
        (None, Some(other)) => {
            *crs = Some(other.clone());
            Ok(())
        }
        _ => Ok(()),
    }
}

/// Reads lines; rings of polygons are also read as lines.
fn read_lines(path: &Path, options: &FeatureOptions, crs: &mut Option<Crs>) -> Result<Vec<Vec<[f64; 3]>>> {
    let mut reader = open_features(path, options)?;
    agree(path, crs, reader.schema().crs.as_ref())?;
    let height = reader.schema().attributes.iter().position(|(name, _)| name.eq_ignore_ascii_case(HEIGHT));
    let mut found = Vec::new();
    while let Some(feature) = reader.next()? {
        let above = height.and_then(|at| number(feature.attributes.get(at)?)).unwrap_or(f64::NAN);
        let mut take = |line: &[[f64; 2]]| found.push(line.iter().map(|[x, y]| [*x, *y, above]).collect());
        match feature.geometry {
            None => {}
            Some(FeatureGeometry::Lines(lines)) => lines.iter().for_each(|line| take(line)),
            Some(FeatureGeometry::Polygons(parts)) => {
                for mut ring in parts.into_iter().flatten() {
                    ring.extend(ring.first().copied());
                    take(&ring);
                }
            }
            Some(_) => {
                let advice = "breaklines are lines or polygons";
                return Err(Error::unsupported(path, "a breakline that is a point", advice));
            }
        }
    }
    Ok(found)
}

/// Reads polygons.
fn read_polygons(path: &Path, options: &FeatureOptions, crs: &mut Option<Crs>) -> Result<PolygonParts> {
    let mut reader = open_features(path, options)?;
    agree(path, crs, reader.schema().crs.as_ref())?;
    let mut found = PolygonParts::new();
    while let Some(feature) = reader.next()? {
        match feature.geometry {
            None => {}
            Some(FeatureGeometry::Polygons(parts)) => found.extend(parts),
            Some(_) => {
                return Err(Error::unsupported(
                    path,
                    "an outline with a feature that is not a polygon",
                    "outlines consist of polygons",
                ));
            }
        }
    }
    if found.is_empty() {
        return Err(Error::unsupported(path, "an outline without polygons", "an outline has at least one"));
    }
    Ok(found)
}
