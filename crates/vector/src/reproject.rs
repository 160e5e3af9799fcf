//! Transformation of feature files to another coordinate system.

use std::path::Path;

use crate::export::{
    AttributeType, AttributeValue, FeatureParts, Geometry, GeometryKind, VectorFeature, VectorFormat,
    VectorLayer, VectorWriter, push_attribute,
};
use crate::import::feature::{Feature, FeatureOptions, open_features};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_crs::{Crs, Transformation};
use spinney_engine::ops::{ViewOperation, WarpTarget};

/// Operation on the coordinate system of features.
#[derive(Clone, Debug, PartialEq)]
pub enum SystemChange {
    /// Declares the coordinate system, overriding that of the file.
    Declare(Crs),
    /// Transforms to a coordinate system.
    Transform(Crs),
}

impl SystemChange {
    /// Converts operations of a view to operations on the features of a file.
    ///
    /// # Errors
    /// If there are none, or one is not applicable to features.
    pub fn of_view(path: &Path, operations: &[ViewOperation]) -> Result<Vec<SystemChange>> {
        let advice = "features have two operations: warp=DEF transforms to another coordinate system, crs=DEF declares their own";
        let refused = |found: String| Error::unsupported(path, found, advice);
        let of = |operation: &ViewOperation| match operation {
            ViewOperation::Crs(crs) => Ok(SystemChange::Declare(crs.clone())),
            ViewOperation::Warp(WarpTarget { crs, cell: None, resampling: None }) => {
                Ok(SystemChange::Transform(crs.clone()))
            }
            ViewOperation::Warp(_) => Err(refused("cell= or resampling= for features".into())),
            operation => Err(refused(format!("operation {operation} for features"))),
        };
        match operations {
            [] => Err(refused("a transformation of features without an operation".into())),
            operations => operations.iter().map(of).collect(),
        }
    }
}

/// Options of transforming features.
#[derive(Clone, Debug, Default)]
pub struct ReprojectOptions {
    /// The operations, in order.
    pub operations: Vec<SystemChange>,
    /// Whether a datum with an unknown or grid-based shift is taken for WGS 84.
    pub allow_ballpark: bool,
    /// Options of reading features.
    pub features: FeatureOptions,
}

/// Writes the features of a file in another coordinate system, in order; returns their number. The
/// file is read twice.
///
/// Vertices are transformed individually, as by ogr2ogr: edges are straight between them in the new
/// system. Attributes, heights and the layer's name are kept. Ids are stored as such if the format
/// supports it, else in an attribute `id`. Measures are dropped, and heights if some features have
/// none, with a warning.
///
/// # Errors
/// If the file cannot be read, no coordinate system is stored or declared, a system is not
/// supported, a vertex is outside its domain (with the feature's number), or the output cannot be
/// written.
pub fn reproject_features(
    input: &Path,
    options: &ReprojectOptions,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<u64> {
    // A declared coordinate system overrides that of the file.
    let is_declared = matches!(options.operations.first(), Some(SystemChange::Declare(_)));
    let check_degrees = options.features.check_degrees && !is_declared;
    let reading = FeatureOptions { check_degrees, ..options.features.clone() };
    let mut reader = open_features(input, &reading)?;
    let schema = reader.schema().clone();
    let chain = SystemChain::new(input, schema.crs.as_ref(), options)?;
    chain.remarks().for_each(|remark| progress.warn(input, &remark));
    // The properties of the layer must be known before the first feature is written.
    let mut survey = LayerSurvey::default();
    while let Some(mut feature) = reader.next()? {
        chain.apply(input, survey.features + 1, &mut feature)?;
        survey.add(&feature, format);
        if survey.features.is_multiple_of(1 << 12) {
            progress.check()?;
        }
    }
    let path = output.path().to_path_buf();
    let mut attributes = schema.attributes.clone();
    let has_id_column = survey.has_ids && !survey.keeps_ids(format);
    if has_id_column {
        push_attribute(&mut attributes, "id".into(), survey.id_type.unwrap_or(AttributeType::Mixed));
    }
    let layer = VectorLayer {
        name: layer_name(schema.name, &path),
        kind: survey.kind.flatten(),
        is_multi: survey.is_multi,
        has_z: survey.has_z(),
        attributes,
        crs: chain.crs.clone(),
        bounds: survey.bounds.unwrap_or_default(),
    };
    let mut writer = FeatureWriter {
        has_z: layer.has_z,
        has_id_column,
        keeps_ids: survey.keeps_ids(format),
        writer: VectorWriter::create(output, format, layer)?,
        losses: 0,
    };
    let mut reader = open_features(input, &reading)?;
    let mut done = 0;
    while let Some(mut feature) = reader.next()? {
        done += 1;
        chain.apply(input, done, &mut feature)?;
        writer.write(&feature)?;
        if done.is_multiple_of(1024) {
            progress.check()?;
            progress.advance(1024, survey.features);
        }
    }
    if writer.losses > 0 {
        progress.warn(&path, &format!("heights and measures of {} features are dropped", writer.losses));
    }
    writer.writer.finish(progress)?;
    Ok(done)
}

/// Returns the layer's name, or else that of the file.
fn layer_name(name: String, path: &Path) -> String {
    let stem = path.file_stem().filter(|stem| *stem != "-");
    match name.is_empty() {
        true => stem.map_or_else(|| "features".into(), |stem| stem.to_string_lossy().into_owned()),
        false => name,
    }
}

/// Chain of transformations.
struct SystemChain {
    transformations: Vec<(Transformation, Crs)>,
    /// The final coordinate system, if known.
    crs: Option<Crs>,
}

impl SystemChain {
    fn new(path: &Path, own: Option<&Crs>, options: &ReprojectOptions) -> Result<SystemChain> {
        let mut chain = SystemChain { transformations: Vec::new(), crs: own.cloned() };
        for operation in &options.operations {
            let target = match operation {
                SystemChange::Declare(crs) => crs,
                SystemChange::Transform(crs) => {
                    let Some(from) = &chain.crs else {
                        let advice = "declare it before the transformation, with crs=EPSG:NUMBER";
                        let found = "a transformation of features without a coordinate system";
                        return Err(Error::unsupported(path, found, advice));
                    };
                    let transformation = Transformation::new(from, crs, options.allow_ballpark)?;
                    chain.transformations.push((transformation, crs.clone()));
                    crs
                }
            };
            chain.crs = Some(target.clone());
        }
        Ok(chain)
    }

    fn remarks(&self) -> impl Iterator<Item = String> {
        self.transformations.iter().flat_map(|(transformation, _)| transformation.remarks())
    }

    /// Transforms all vertices of a feature.
    fn apply(&self, path: &Path, number: u64, feature: &mut Feature) -> Result<()> {
        let Feature { id, geometry: Some(geometry), .. } = feature else { return Ok(()) };
        let id = id.as_ref().map(|id| format!(" (id {id})")).unwrap_or_default();
        geometry.for_each_point(&mut |vertex| {
            for (transformation, target) in &self.transformations {
                let [x, y] = *vertex;
                *vertex = transformation.forward(*vertex).ok_or_else(|| {
                    let found = format!(
                        "feature {number}{id} with a vertex at {x},{y}, which is outside the domain of {target},"
                    );
                    Error::unsupported(
                        path,
                        found,
                        "exclude it with --where, or choose another coordinate system",
                    )
                })?;
            }
            Ok(())
        })
    }
}

/// Properties of a layer's features.
#[derive(Default)]
struct LayerSurvey {
    features: u64,
    /// Kind of the features; `Some(None)` for several kinds.
    kind: Option<Option<GeometryKind>>,
    is_multi: bool,
    bounds: Option<[[f64; 2]; 2]>,
    /// Number of features with vertices, and of those among them whose vertices all have heights.
    with_vertices: u64,
    with_heights: u64,
    has_ids: bool,
    /// Type of the id attribute, in formats without ids.
    id_type: Option<AttributeType>,
    /// Whether ids are not ascending integers and thus cannot be row ids.
    has_other_ids: bool,
    last_id: Option<i64>,
}

impl LayerSurvey {
    fn add(&mut self, feature: &Feature, format: VectorFormat) {
        self.features += 1;
        self.has_ids |= feature.id.is_some();
        if let Some(id) = &feature.id {
            let own = if id.is_string() { AttributeType::Text } else { AttributeType::Integer };
            let own = if id.is_f64() || id.is_u64() && !id.is_i64() { AttributeType::Mixed } else { own };
            self.id_type = Some(self.id_type.map_or(own, |before| before.with(own)));
        }
        if format == VectorFormat::GeoPackage
            && let Some(id) = &feature.id
        {
            let id = id.as_i64();
            self.has_other_ids |= id.is_none() || id <= self.last_id;
            self.last_id = id.or(self.last_id);
        }
        let Some(geometry) = &feature.geometry else { return };
        let parts = FeatureParts::of(geometry);
        let own = geometry.kind();
        self.kind = Some(match self.kind {
            None => own,
            Some(kind) => kind.filter(|kind| own == Some(*kind)),
        });
        self.is_multi |= (0..parts.parts()).filter(|part| parts.is_outer(*part)).count() > 1;
        let mut count = 0;
        for vertex in geometry.points() {
            count += 1;
            let [low, high] = self.bounds.get_or_insert([*vertex; 2]);
            for axis in 0..2 {
                low[axis] = low[axis].min(vertex[axis]);
                high[axis] = high[axis].max(vertex[axis]);
            }
        }
        self.with_vertices += u64::from(count > 0);
        self.with_heights += u64::from(count > 0 && feature.heights.of_points.len() == count);
    }

    fn has_z(&self) -> bool {
        self.with_heights > 0 && self.with_heights == self.with_vertices
    }

    fn keeps_ids(&self, format: VectorFormat) -> bool {
        match format {
            VectorFormat::GeoJson => true,
            VectorFormat::GeoPackage => !self.has_other_ids,
            _ => false,
        }
    }
}

/// Output file of features.
struct FeatureWriter {
    writer: VectorWriter,
    has_z: bool,
    has_id_column: bool,
    keeps_ids: bool,
    /// Number of features whose heights or measures are dropped.
    losses: u64,
}

impl FeatureWriter {
    fn write(&mut self, feature: &Feature) -> Result<()> {
        let heights = &feature.heights;
        self.losses += u64::from(heights.have_measures || heights.are_there && !self.has_z);
        let mut values: Vec<AttributeValue<'_>> =
            feature.attributes.iter().map(AttributeValue::from).collect();
        let id = self.has_id_column.then(|| feature.id_attribute());
        values.extend(id.iter().map(AttributeValue::from));
        let z: &[f64] = if self.has_z { &heights.of_points } else { &[] };
        let geometry = feature.geometry.as_ref().map(|geometry| FeatureParts::with_heights(geometry, z));
        self.writer.write_feature(&VectorFeature {
            id: feature.id.as_ref().filter(|_| self.keeps_ids),
            geometry: geometry.as_ref().map(|parts| (parts.kind(), parts as &dyn Geometry)),
            attributes: &values,
        })
    }
}
