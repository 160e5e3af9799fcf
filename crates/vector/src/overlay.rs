//! Set operations on polygons of several files, which keep all attributes.
//!
//! ```
//! use spinney::raw::overlay::{OverlayOperation, OverlayRequest, overlay_features, read_polygon_layers};
//! use spinney::export::VectorFormat;
//! use spinney::Output;
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = |name: &str| folder.path().join(name);
//! let square = |west: f64, name: &str| {
//!     let east = west + 2.0;
//!     let ring = format!("[[{west},0],[{east},0],[{east},2],[{west},2],[{west},0]]");
//!     format!(r#"{{"type":"Feature","properties":{{"{name}":"x"}},"geometry":{{"type":"Polygon","coordinates":[{ring}]}}}}"#)
//! };
//! std::fs::write(path("a.geojson"), square(0.0, "soil")).unwrap();
//! std::fs::write(path("b.geojson"), square(1.0, "owner")).unwrap();
//! let layers = read_polygon_layers(&[path("a.geojson"), path("b.geojson")], &Default::default(), 64 << 20)?;
//! let request = OverlayRequest::new(OverlayOperation::named("and").unwrap());
//! let output = Output::create(&path("c.geojson"))?;
//! let report = overlay_features(layers, &request, output, VectorFormat::GeoJson, &())?;
//! assert_eq!((report.parts, report.area), (1, 2.0));
//! # let text = std::fs::read_to_string(path("c.geojson")).unwrap();
//! # assert!(text.contains(r#""properties":{"soil":"x","owner":"x"}"#), "{text}");
//! # Ok::<(), spinney::Error>(())
//! ```

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::export::{
    AttributeType, AttributeValue, FeatureParts, Geometry, VectorFeature, VectorFormat, VectorLayer,
    VectorWriter,
};
use crate::export::{bounds_of, push_attribute};
use crate::import::feature::{FeatureGeometry, FeatureOptions, open_features};
use crate::import::filter::FeatureFilter;
use crate::import::zones::{PolygonLayer, read_polygons, take_polygons};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, SetOperation};
use spinney_crs::{Crs, PolygonParts, Transformation};
use spinney_engine::ops::{CombineOperation, Prefer};
pub use spinney_overlay::OverlaySummary;
use spinney_overlay::{OverlayGrid, OverlayRegion, PolygonOverlay};

/// Feature number of the region that limits a result.
const WITHIN: u32 = u32::MAX;

/// Operation on polygons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OverlayOperation {
    /// Set operation. For more than two files, the union is the area in any file, the intersection
    /// that in all, the difference that in the first only, and the symmetric difference that in an
    /// odd number of files. Complements of these are also available.
    Set(SetOperation),
    /// Partition of the plane by the polygons' borders. Each part has all features that contain it.
    Partition,
}

impl OverlayOperation {
    /// Returns the operation with a name of [`CombineOperation::named`], or `partition`; `None` for
    /// operations that need values.
    pub fn named(name: &str) -> Option<OverlayOperation> {
        match (name, CombineOperation::named(name, Prefer::First)) {
            ("partition", _) => Some(OverlayOperation::Partition),
            (_, Some(CombineOperation::Set { operation, .. })) => Some(OverlayOperation::Set(operation)),
            _ => None,
        }
    }

    /// Returns whether the result includes the area outside all polygons, so that a region must
    /// limit it.
    fn reaches_outside(self) -> bool {
        matches!(self, OverlayOperation::Set(operation) if operation.is_unbounded())
    }

    /// Returns whether the result contains points that are in these files.
    fn takes(self, is_in: &[bool]) -> bool {
        let OverlayOperation::Set(operation) = self else { return is_in.contains(&true) };
        if operation.is_unbounded() && is_in.len() > 2 {
            return !OverlayOperation::Set(operation.complement()).takes(is_in);
        }
        let (first, others) =
            is_in.split_first().map_or((false, &[][..]), |(first, others)| (*first, others));
        match (others.len(), operation) {
            (0 | 1, _) => operation.contains(first, others.contains(&true)),
            (_, SetOperation::Intersection) => !is_in.contains(&false),
            (_, SetOperation::Difference) => first && !others.contains(&true),
            (_, SetOperation::SymmetricDifference) => is_in.iter().filter(|is_in| **is_in).count() % 2 == 1,
            (_, SetOperation::Union) => is_in.contains(&true),
            _ => false,
        }
    }

    fn check(self, files: usize) -> Result<()> {
        let is_for_many = |operation: SetOperation| {
            matches!(operation.index().min(operation.complement().index()), 0 | 1 | 2 | 6 | 7)
        };
        match self {
            OverlayOperation::Set(operation) if files > 2 && !is_for_many(operation) => {
                Err(Error::invalid("files", files.to_string(), "one or two for this operation"))
            }
            _ if files == 0 => Err(Error::invalid("files", "none", "at least one")),
            _ => Ok(()),
        }
    }
}

/// Request for an overlay of polygons.
#[derive(Clone, Debug)]
pub struct OverlayRequest {
    /// The operation.
    pub operation: OverlayOperation,
    /// Polygons that limit the result, in coordinates of the first file. Required if the result
    /// includes the area outside all polygons.
    pub within: Option<PolygonParts>,
    /// Cell width of the output grid, rounded down to a power of two; `None` for 2^-42 of the
    /// largest coordinate.
    pub snap: Option<f64>,
    /// Memory limit in bytes.
    pub memory: u64,
}

impl OverlayRequest {
    /// Creates a request with a default grid and a memory limit of 1 GiB.
    pub fn new(operation: OverlayOperation) -> OverlayRequest {
        OverlayRequest { operation, within: None, snap: None, memory: 1 << 30 }
    }

    /// Limits the result to a box, in coordinates of the first file.
    pub fn within_box(&mut self, [west, south]: [f64; 2], [east, north]: [f64; 2]) {
        self.within = Some(vec![vec![vec![[west, south], [east, south], [east, north], [west, north]]]]);
    }
}

/// Summary of an overlay of polygons.
#[derive(Clone, Debug, PartialEq)]
pub struct OverlayReport {
    /// Counts and precision.
    pub summary: OverlaySummary,
    /// Number of features written.
    pub parts: u64,
    /// Number of polygons in all features.
    pub polygons: u64,
    /// Total area, in square units of the coordinates.
    pub area: f64,
    /// Number of parts that are in several features of one file. They have the attributes of the
    /// last of these.
    pub shared: u64,
}

/// Writes the overlay of the polygons of some files: one feature per set of input features that
/// contain a part (for set operations, per combination of the last feature of each file), with the
/// attributes of these. Attribute names that several files have end with the file's number, from 1.
/// Vertices are transformed to the first file's coordinate system.
///
/// # Errors
/// If the operation does not support this number of files, or is unbounded and nothing limits it;
/// if coordinates cannot be transformed to the first file's system; if the polygons exceed the
/// memory limit, the output cannot be written, or on cancellation.
pub fn overlay_features(
    layers: Vec<(PathBuf, PolygonLayer)>,
    request: &OverlayRequest,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<OverlayReport> {
    let operation = request.operation;
    operation.check(layers.len())?;
    if operation.reaches_outside() && request.within.is_none() {
        let expected = "a region, since the result includes the area outside all polygons";
        return Err(Error::invalid("region of the result (within)", "none", expected));
    }
    let layers = Layers::of(layers, progress)?;
    let bounds = layers.bounds(request.within.as_ref());
    let max_coordinate = bounds.as_flattened().iter().fold(0f64, |most, at| most.max(at.abs()));
    let grid = match request.snap {
        Some(width) => OverlayGrid::of_cells(width)?,
        None => OverlayGrid::for_coordinates(max_coordinate),
    };
    let is_partition = operation == OverlayOperation::Partition;
    let attributes = layers.attributes(is_partition);
    let layer = VectorLayer {
        name: "parts".into(),
        kind: Some(crate::export::GeometryKind::Polygon),
        is_multi: true,
        has_z: false,
        attributes,
        crs: layers.layers[0].1.crs.clone(),
        bounds,
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let mut overlay = PolygonOverlay::new(grid, request.memory);
    let mut layers = layers;
    layers.move_to(&mut overlay, request.within.as_ref())?;
    let (mut parts, mut polygons, mut area, mut shared) = (0, 0, 0.0, 0);
    let mut is_shared = BTreeMap::new();
    let mut key_of = |sources: &[u32]| {
        let own = match (request.within.is_some(), sources.split_last()) {
            (true, Some((&WITHIN, own))) => own,
            (true, _) => return None,
            (false, _) => sources,
        };
        let last = layers.last_of_each(own);
        let is_in: Vec<bool> = last.iter().map(|number| *number > 0).collect();
        if !operation.takes(&is_in) {
            return None;
        }
        let key = if is_partition { own.to_vec() } else { last };
        let several = own.len() > is_in.iter().filter(|is_in| **is_in).count();
        *is_shared.entry(key.clone()).or_insert(false) |= several;
        Some(key)
    };
    let mut written: Vec<Vec<u32>> = Vec::new();
    let summary = overlay.regions(&mut key_of, progress, &mut |part: OverlayRegion| {
        progress.check()?;
        let OverlayRegion { key, polygons: own, area: own_area } = part;
        parts += 1;
        polygons += own.len() as u64;
        area += own_area;
        let last = if is_partition { layers.last_of_each(&key) } else { key.clone() };
        let ids = if is_partition { layers.ids(&key) } else { Vec::new() };
        let values = layers.values(&last, &ids);
        let geometry = FeatureGeometry::Polygons(own);
        let geometry = FeatureParts::of(&geometry);
        let geometry = Some((geometry.kind(), &geometry as &dyn Geometry));
        writer.write_feature(&VectorFeature { id: None, geometry, attributes: &values })?;
        written.push(key);
        Ok(())
    })?;
    shared += written.iter().filter(|key| is_shared.get(*key) == Some(&true)).count() as u64;
    writer.finish(progress)?;
    Ok(OverlayReport { summary, parts, polygons, area, shared })
}

/// Reads the polygons of files; `memory` is the limit per file in bytes. A condition applies to the
/// files that have its attribute; at least one must.
///
/// # Errors
/// Those of [`read_polygons`].
pub fn read_polygon_layers(
    files: &[PathBuf],
    filter: &FeatureFilter,
    memory: u64,
) -> Result<Vec<(PathBuf, PolygonLayer)>> {
    let mut own = vec![FeatureFilter::default(); files.len()];
    for condition in &filter.conditions {
        let single = FeatureFilter { conditions: vec![condition.clone()] };
        let mut is_known = false;
        for (file, own) in files.iter().zip(&mut own) {
            let options = FeatureOptions { memory, ..FeatureOptions::default() };
            let reader = open_features(file, &options)?;
            if single.names().all(|name| reader.schema().position(name).is_some()) {
                own.conditions.push(condition.clone());
                is_known = true;
            }
        }
        // A condition that no file knows is reported for the first.
        if let Some(first) = own.first_mut().filter(|_| !is_known) {
            first.conditions.push(condition.clone());
        }
    }
    let read = |(file, filter): (&PathBuf, FeatureFilter)| {
        let options = FeatureOptions { memory, filter, ..FeatureOptions::default() };
        Ok((file.clone(), read_polygons(file, &options)?))
    };
    files.iter().zip(own).map(read).collect()
}

/// Polygons of all files. Features are numbered consecutively, starting with the first file.
struct Layers {
    layers: Vec<(PathBuf, PolygonLayer)>,
    /// Number of each layer's first feature.
    first: Vec<u32>,
}

impl Layers {
    /// Transforms all layers to the first one's coordinate system.
    fn of(mut layers: Vec<(PathBuf, PolygonLayer)>, progress: &dyn Progress) -> Result<Layers> {
        let mut first = Vec::new();
        let mut count = 0u32;
        for (path, layer) in &layers {
            first.push(count);
            let next = u32::try_from(layer.features.len()).ok().and_then(|own| count.checked_add(own));
            // The last numbers are reserved for the region.
            count = next.filter(|next| *next < WITHIN - 1).ok_or_else(|| {
                Error::unsupported(path, "an overlay of more than 2^32 features", "divide the files")
            })?;
        }
        for (path, layer) in &layers {
            let count = layer.features.iter().filter(|feature| feature.heights.any()).count();
            if count > 0 {
                progress.warn(path, &format!("heights and measures of {count} features are dropped"));
            }
        }
        let target = layers[0].1.crs.clone();
        for (path, layer) in layers.iter_mut().skip(1) {
            match (&layer.crs, &target) {
                (Some(own), Some(target)) if !own.is_same(target) => {
                    let transformation = Transformation::new(own, target, false)?;
                    transformation.remarks().iter().for_each(|remark| progress.warn(path, remark));
                    transform(path, layer, &transformation, target)?;
                }
                (None, Some(target)) => progress
                    .warn(path, &format!("has no coordinate system; vertices are assumed to be in {target}")),
                (Some(own), None) => progress.warn(
                    path,
                    &format!(
                        "the first file has no coordinate system; its vertices are assumed to be in {own}"
                    ),
                ),
                _ => {}
            }
        }
        Ok(Layers { layers, first })
    }

    fn bounds(&self, within: Option<&PolygonParts>) -> [[f64; 2]; 2] {
        let features = self.layers.iter().flat_map(|(_, layer)| &layer.features);
        let parts: Vec<FeatureParts<'_>> =
            features.filter_map(|feature| feature.geometry.as_ref()).map(FeatureParts::of).collect();
        let limits = within.into_iter().flatten().flatten().flatten();
        bounds_of(&mut parts.iter().flat_map(FeatureParts::vertices).chain(limits))
    }

    /// Returns names and types of the results' attributes.
    fn attributes(&self, is_partition: bool) -> Vec<(String, AttributeType)> {
        let own = self.layers.iter().map(|(_, layer)| layer.attributes.iter().map(|(name, _)| name.as_str()));
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        own.flatten().for_each(|name| *counts.entry(name).or_default() += 1);
        let mut names: Vec<(String, AttributeType)> = Vec::new();
        for (number, (_, layer)) in (1..).zip(&self.layers) {
            for (name, kind) in &layer.attributes {
                let name = if counts[name.as_str()] > 1 { format!("{name}_{number}") } else { name.clone() };
                push_attribute(&mut names, name, *kind);
            }
        }
        for number in (1..=self.layers.len()).filter(|_| is_partition) {
            push_attribute(&mut names, format!("features_{number}"), AttributeType::Text);
        }
        names
    }

    /// Moves all geometries to the overlay; attributes stay.
    fn move_to(&mut self, overlay: &mut PolygonOverlay, within: Option<&PolygonParts>) -> Result<()> {
        for ((path, layer), first) in self.layers.iter_mut().zip(&self.first) {
            for (number, feature) in (*first..).zip(&mut layer.features) {
                let mut parts = Vec::new();
                feature.geometry.take().into_iter().for_each(|own| take_polygons(own, &mut parts));
                parts.iter().try_for_each(|rings| overlay.add(path, number, rings))?;
            }
        }
        for rings in within.into_iter().flatten() {
            overlay.add(&self.layers[0].0, WITHIN, rings)?;
        }
        Ok(())
    }

    /// Returns the last of the features of each layer, numbered from 1; 0 if there is none.
    fn last_of_each(&self, features: &[u32]) -> Vec<u32> {
        let mut last = vec![0; self.layers.len()];
        for feature in features {
            let layer = self.first.partition_point(|first| first <= feature) - 1;
            // A layer without features has the same first number as the next one.
            last[layer] = feature - self.first[layer] + 1;
        }
        last
    }

    /// Returns the ids of features, or their numbers from 1, for each layer.
    fn ids(&self, features: &[u32]) -> Vec<String> {
        let mut ids = vec![String::new(); self.layers.len()];
        for feature in features {
            let layer = self.first.partition_point(|first| first <= feature) - 1;
            let number = feature - self.first[layer];
            let own = &self.layers[layer].1.features[number as usize];
            let id = match &own.id {
                Some(serde_json::Value::String(text)) => text.clone(),
                Some(id) => id.to_string(),
                None => (number + 1).to_string(),
            };
            let list = &mut ids[layer];
            list.push_str(if list.is_empty() { "" } else { "," });
            list.push_str(&id);
        }
        ids
    }

    /// Returns the attributes of at most one feature per layer, and the lists of ids of each layer.
    fn values<'a>(&'a self, last: &[u32], ids: &'a [String]) -> Vec<AttributeValue<'a>> {
        let mut values = Vec::new();
        for ((_, layer), number) in self.layers.iter().zip(last) {
            match number.checked_sub(1) {
                Some(number) => {
                    let own = &layer.features[number as usize].attributes;
                    values.extend(own.iter().map(AttributeValue::from));
                }
                None => values.extend(layer.attributes.iter().map(|_| AttributeValue::None)),
            }
        }
        values.extend(ids.iter().map(|text| match text.is_empty() {
            true => AttributeValue::None,
            false => AttributeValue::Text(text),
        }));
        values
    }
}

/// Transforms all vertices of a layer to another coordinate system.
fn transform(
    path: &std::path::Path,
    layer: &mut PolygonLayer,
    transformation: &Transformation,
    to: &Crs,
) -> Result<()> {
    for (number, feature) in (1..).zip(&mut layer.features) {
        let Some(geometry) = feature.geometry.take() else { continue };
        let mut parts = Vec::new();
        take_polygons(geometry, &mut parts);
        for corner in parts.iter_mut().flatten().flatten() {
            *corner = transformation.forward(*corner).ok_or_else(|| {
                let found = format!("{},{}", corner[0], corner[1]);
                Error::corrupt(
                    path,
                    format!("feature {number}"),
                    found,
                    format!("a position in the domain of {to}"),
                )
            })?;
        }
        feature.geometry = Some(FeatureGeometry::Polygons(parts));
    }
    Ok(())
}
