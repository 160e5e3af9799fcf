//! Reads polygons with heights as sections of a solid.

use std::collections::BTreeMap;
use std::path::Path;

use super::outline::{Outline, bounds};
use spinney_base::{Error, Result};
use spinney_crs::{Crs, PolygonParts};
use spinney_overlay::{OverlayGrid, PolygonOverlay};
use spinney_vector::import::feature::{FeatureAttribute, FeatureGeometry, FeatureOptions, open_features};

/// Memory per vertex while outlines are read, in bytes: in the input and in an outline.
const CORNER: u64 = 96;

/// An outline at a height.
pub(super) struct Section {
    pub(super) height: f64,
    pub(super) outline: Outline,
    /// Number of edges of all its rings.
    pub(super) sides: u64,
}

/// The outlines of a file.
pub(super) struct FoundSections {
    /// From the lowest to the highest.
    pub(super) sections: Vec<Section>,
    /// Minimum and maximum coordinates.
    pub(super) bounds: [[f64; 2]; 2],
    pub(super) crs: Option<Crs>,
    /// Number of features without a height or without vertices.
    pub(super) without: u64,
}

/// Reads polygons with a height attribute.
pub(super) fn read_sections(
    path: &Path,
    height: &str,
    features: &FeatureOptions,
    memory: u64,
) -> Result<FoundSections> {
    let options = FeatureOptions { attributes: Some(vec![height.into()]), ..features.clone() };
    let mut reader = open_features(path, &options)?;
    let crs = reader.schema().crs.clone();
    let mut by_height: BTreeMap<Height, PolygonParts> = BTreeMap::new();
    let (mut without, mut needed) = (0, 0u64);
    while let Some(feature) = reader.next()? {
        let parts = match feature.geometry {
            Some(FeatureGeometry::Polygons(parts)) if !parts.is_empty() => parts,
            Some(FeatureGeometry::Polygons(_)) | None => {
                without += 1;
                continue;
            }
            Some(_) => {
                let advice = "outlines are polygons; exclude other features with --where";
                return Err(Error::unsupported(path, "a feature that is not a polygon", advice));
            }
        };
        let Some(height) = feature.attributes.first().and_then(number) else {
            without += 1;
            continue;
        };
        needed += parts.iter().flatten().map(|ring| ring.len() as u64 * CORNER).sum::<u64>();
        if needed > memory {
            return Err(Error::TooLarge {
                path: path.into(),
                what: "outlines".into(),
                needed,
                limit: memory,
                advice: "allow more with --memory (outlines may take half of it)".into(),
            });
        }
        by_height.entry(Height(height)).or_default().extend(parts);
    }
    let bounds = bounds(by_height.values().flatten().flatten().flatten());
    let max_coordinate = bounds.iter().flatten().fold(0.0, |most: f64, at| most.max(at.abs()));
    let mut sections = Vec::new();
    for (Height(height), parts) in by_height {
        let rings = united(path, max_coordinate, &parts, memory)?;
        let sides = rings.iter().map(|ring| ring.len() as u64 - 1).sum();
        if sides == 0 {
            let found = format!("an outline without an area, at height {height},");
            return Err(Error::unsupported(path, found, "exclude it with --where"));
        }
        sections.push(Section { height, outline: Outline::new(&rings), sides });
    }
    Ok(FoundSections { sections, bounds, crs, without })
}

/// Returns the rings around the union of polygons. Each repeats its first vertex at the end.
fn united(path: &Path, max_coordinate: f64, parts: &PolygonParts, memory: u64) -> Result<Vec<Vec<[f64; 2]>>> {
    let mut overlay = PolygonOverlay::new(OverlayGrid::for_coordinates(max_coordinate), memory);
    for (number, rings) in (0..).zip(parts) {
        overlay.add(path, number, rings)?;
    }
    let mut rings = Vec::new();
    overlay.regions(&mut |_| Some(vec![0]), &(), &mut |part| {
        rings.extend(part.polygons.into_iter().flatten());
        Ok(())
    })?;
    Ok(rings)
}

/// A height as a map key.
#[derive(Clone, Copy, Debug)]
struct Height(f64);

impl Ord for Height {
    fn cmp(&self, other: &Height) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Height {
    fn partial_cmp(&self, other: &Height) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Height {
    fn eq(&self, other: &Height) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Height {}

/// Returns an attribute value as a height, if it is a finite number.
fn number(value: &FeatureAttribute) -> Option<f64> {
    match value {
        FeatureAttribute::Integer(number) => Some(*number as f64),
        // (Adding 0.0 turns -0.0 into 0.0.)
        FeatureAttribute::Number(number) => Some(*number + 0.0).filter(|number| number.is_finite()),
        _ => None,
    }
}
