//! Boreholes in long form: a feature for each borehole and layer, with the layer's depth.

use std::path::Path;

use super::read::{HEIGHT, SurfacePoints, number};
use crate::import::feature::{
    Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureSchema, open_features,
};
use spinney_base::io::shown;
use spinney_base::{Error, Result};

/// Attributes of features that are boreholes' layers: one feature for each borehole and layer.
#[derive(Clone, Debug)]
pub struct BoreholeAttributes {
    /// Attribute with the name of the layer, which is that of a surface.
    pub layer: String,
    /// Attribute with the depth of the surface below the borehole's mouth.
    pub depth: String,
}

/// Counts of boreholes' layers that were read, and of those that are in no surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoreholeReport {
    /// Number of features.
    pub features: u64,
    /// Whether mouths have heights. If not, heights of surfaces are negative depths.
    pub has_mouths: bool,
    /// Number of features without a height of the mouth, although others have one.
    pub without_mouth: u64,
    /// Number of features without a position.
    pub without_position: u64,
    /// Number of features without the name of a layer.
    pub without_layer: u64,
    /// Number of features of layers that are not requested.
    pub others: u64,
    /// The first few names of these layers.
    pub other_names: Vec<String>,
    /// Number of features that repeat another one: same borehole, layer and depth.
    pub repeated: u64,
}

/// Number of names of other layers that are kept, and their maximum number of characters.
const MAX_NAMES: usize = 5;
const MAX_CHARACTERS: usize = 60;

/// Points of one surface.
#[derive(Default)]
struct Surface {
    /// Points with heights, from mouths with heights.
    heights: Vec<[f64; 3]>,
    /// Points with negative depths, from mouths without heights; kept until a mouth has a height.
    depths: Vec<[f64; 3]>,
    without: u64,
}

/// Reads the points of surfaces, feature by feature. A point's height is that of the borehole's
/// mouth (the attribute `z`, or else the z of the geometry) minus the depth.
///
/// # Errors
/// Those of [`open_features`]; if an attribute does not exist; if a depth is negative; if a feature
/// is not a point; if a borehole has a layer at several depths.
pub(super) fn read_boreholes(
    path: &Path,
    names: &[String],
    attributes: &BoreholeAttributes,
    options: &FeatureOptions,
) -> Result<SurfacePoints> {
    let mut reader = open_features(path, options)?;
    let columns = Columns::of(reader.schema(), attributes, path)?;
    let crs = reader.schema().crs.clone();
    let mut report = BoreholeReport::default();
    let mut surfaces: Vec<Surface> = names.iter().map(|_| Surface::default()).collect();
    while let Some(feature) = reader.next()? {
        report.features += 1;
        let points = match &feature.geometry {
            None => {
                report.without_position += 1;
                continue;
            }
            Some(FeatureGeometry::Points(points)) => points,
            Some(_) => {
                let advice = "boreholes are points, with a feature for each borehole and layer";
                return Err(Error::unsupported(path, "a feature that is not a point", advice));
            }
        };
        let Some(name) = name_of(feature.attributes.get(columns.layer)) else {
            report.without_layer += 1;
            continue;
        };
        let Some(at) = names.iter().position(|wanted| wanted.trim() == name) else {
            report.others += 1;
            let name: String = name.chars().take(MAX_CHARACTERS).collect();
            if report.other_names.len() < MAX_NAMES && !report.other_names.contains(&name) {
                report.other_names.push(name);
            }
            continue;
        };
        let Some(depth) = feature.attributes.get(columns.depth).and_then(number) else {
            surfaces[at].without += points.len() as u64;
            continue;
        };
        if let Some([x, y]) = points.first().filter(|_| depth < 0.0) {
            let found = format!("{depth} of `{name}` at {x}, {y}");
            let what = format!("{}: attribute {}", shown(path), attributes.depth);
            return Err(Error::invalid(what, found, "depths below the mouth, which are not negative"));
        }
        for (place, [x, y]) in points.iter().enumerate() {
            match columns.mouth(&feature, points.len(), place) {
                Some(mouth) => {
                    report.has_mouths = true;
                    surfaces[at].heights.push([*x, *y, mouth - depth]);
                }
                None => {
                    report.without_mouth += 1;
                    if !report.has_mouths {
                        surfaces[at].depths.push([*x, *y, -depth]);
                    }
                }
            }
        }
    }
    let mut found = SurfacePoints {
        crs_file: crs.is_some().then(|| path.to_path_buf()),
        crs,
        without: surfaces.iter().map(|surface| surface.without).collect(),
        ..SurfacePoints::default()
    };
    if !report.has_mouths {
        report.without_mouth = 0;
    }
    for (name, Surface { heights, depths, .. }) in names.iter().zip(surfaces) {
        let points = if report.has_mouths { heights } else { depths };
        found.points.push(distinct(points, name, path, &mut report.repeated)?);
    }
    found.boreholes = Some(report);
    Ok(found)
}

/// Indices of attributes.
struct Columns {
    layer: usize,
    depth: usize,
    mouth: Option<usize>,
}

impl Columns {
    fn of(schema: &FeatureSchema, attributes: &BoreholeAttributes, path: &Path) -> Result<Columns> {
        let column = |name: &str| {
            schema.position(name).ok_or_else(|| {
                let known: Vec<&str> =
                    schema.attributes.iter().take(100).map(|(name, _)| name.as_str()).collect();
                let found = format!("{name}, which no feature of {} has", shown(path));
                let expected = format!("one of the features' attributes: {}", known.join(", "));
                Error::invalid("attribute", found, expected)
            })
        };
        Ok(Columns {
            layer: column(&attributes.layer)?,
            depth: column(&attributes.depth)?,
            mouth: schema.attributes.iter().position(|(name, _)| name.eq_ignore_ascii_case(HEIGHT)),
        })
    }

    /// Returns the height of a borehole's mouth: the attribute, or else the z of one of `count`
    /// points.
    fn mouth(&self, feature: &Feature, count: usize, place: usize) -> Option<f64> {
        let of_attribute = self.mouth.and_then(|at| number(feature.attributes.get(at)?));
        let heights = &feature.heights.of_points;
        let of_point = || heights.get(place).copied().filter(|at| at.is_finite() && heights.len() == count);
        of_attribute.or_else(of_point)
    }
}

/// Returns the name of a layer, without surrounding blanks.
fn name_of(value: Option<&FeatureAttribute>) -> Option<String> {
    let name = match value? {
        FeatureAttribute::Text(text) => text.trim().to_owned(),
        FeatureAttribute::Integer(number) => number.to_string(),
        FeatureAttribute::Number(number) => number.to_string(),
        _ => return None,
    };
    Some(name).filter(|name| !name.is_empty())
}

/// Sorts points by position, and removes those that are repeated.
///
/// # Errors
/// If a position has several heights.
fn distinct(mut points: Vec<[f64; 3]>, name: &str, path: &Path, repeated: &mut u64) -> Result<Vec<[f64; 3]>> {
    // (Adding 0.0 turns -0.0 into 0.0.)
    points.iter_mut().flatten().for_each(|at| *at += 0.0);
    points.sort_unstable_by(|a, b| {
        let order = |axis: usize| a[axis].total_cmp(&b[axis]);
        order(0).then(order(1)).then(order(2))
    });
    let before = points.len();
    points.dedup();
    *repeated += (before - points.len()) as u64;
    if let Some(pair) = points.windows(2).find(|pair| pair[0][..2] == pair[1][..2]) {
        let ([x, y, low], [_, _, high]) = (pair[0], pair[1]);
        let found = format!("`{name}` with the heights {low} and {high} at {x}, {y}");
        let what = format!("{}: layers of boreholes", shown(path));
        return Err(Error::invalid(what, found, "one depth for each borehole and layer"));
    }
    Ok(points)
}
