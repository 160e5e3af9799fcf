//! Points joined with the attributes of features of a line tree.

use std::collections::HashMap;
use std::path::Path;

use super::{chosen_of, layer_name, type_of, value_of};
use crate::export::{
    AttributeType, AttributeValue, GeometryKind, VectorFeature, VectorFormat, VectorLayer, VectorWriter,
    push_attribute,
};
use crate::import::feature::{Feature, FeatureReader, FeatureSchema};
use crate::zonal::{coordinates_in, in_file};
use spinney_base::io::Output;
use spinney_base::{Progress, Result, sort};
use spinney_crs::{Crs, WorldLocator};
use spinney_lines::{LineTree, LineValue};

/// Maximum number of cached attribute values.
const MAX_CACHED_VALUES: usize = 1 << 20;

/// Computes the bounds of a layer, if its format needs them.
type LayerBounds<'b> = &'b mut dyn FnMut() -> Result<[[f64; 2]; 2]>;

/// Output layer of points. Each has the attributes of a feature of a file, its own attributes, and
/// those of a feature of the tree.
pub(super) struct JoinedLayer<'t> {
    tree: &'t LineTree,
    chosen: Vec<usize>,
    writer: Option<VectorWriter>,
    /// Cached attribute values of the tree's features.
    known: HashMap<u64, Vec<LineValue>>,
}

/// Point of the output layer.
pub(super) struct JoinedPoint<'f> {
    pub(super) id: Option<&'f serde_json::Value>,
    pub(super) feature: &'f Feature,
    /// Position; z is written if the layer has heights.
    pub(super) position: Option<[f64; 3]>,
    /// Number of the tree's feature, if there is one.
    pub(super) line: Option<u64>,
    /// Its own attributes, in number those of the layer.
    pub(super) own: Vec<AttributeValue<'f>>,
}

impl<'t> JoinedLayer<'t> {
    /// Starts a layer in a coordinate system, with or without heights. Its own attributes come
    /// after those of the file and before the chosen ones of the tree. Without an output, only the
    /// names are checked.
    pub(super) fn new(
        tree: &'t LineTree,
        names: Option<&[String]>,
        (schema, own): (&FeatureSchema, &[(&str, AttributeType)]),
        output: Option<(Output, VectorFormat)>,
        (crs, has_z, bounds): (Option<Crs>, bool, LayerBounds<'_>),
    ) -> Result<JoinedLayer<'t>> {
        let chosen = chosen_of(tree, names)?;
        let mut attributes = schema.attributes.clone();
        let added = chosen.iter().map(|index| &tree.attributes()[*index]);
        let added = added.map(|attribute| (attribute.name.clone(), type_of(attribute.kind)));
        for (name, kind) in own.iter().map(|(name, kind)| ((*name).to_owned(), *kind)).chain(added) {
            push_attribute(&mut attributes, name, kind);
        }
        let mut writer = None;
        if let Some((output, format)) = output {
            let bounds = if format.wants_bounds() { bounds()? } else { [[0.0; 2]; 2] };
            let (kind, name) = (Some(GeometryKind::Point), layer_name(output.path()));
            let layer = VectorLayer { name, kind, is_multi: false, has_z, attributes, crs, bounds };
            writer = Some(VectorWriter::create(output, format, layer)?);
        }
        Ok(JoinedLayer { tree, chosen, writer, known: HashMap::new() })
    }

    /// Writes points, if there is an output.
    pub(super) fn write(&mut self, points: Vec<JoinedPoint<'_>>) -> Result<()> {
        if self.writer.is_none() {
            return Ok(());
        }
        self.read(points.iter().filter_map(|point| point.line).collect())?;
        let JoinedLayer { chosen, writer: Some(writer), known, .. } = self else { return Ok(()) };
        for point in points {
            let JoinedPoint { id, feature, position, line, own } = point;
            let mut values: Vec<AttributeValue<'_>> =
                feature.attributes.iter().map(AttributeValue::from).collect();
            values.extend(own);
            match line.and_then(|line| known.get(&line)) {
                Some(line) => values.extend(line.iter().map(value_of)),
                None => values.extend(chosen.iter().map(|_| AttributeValue::None)),
            }
            let geometry = position.map(|position| [vec![position]]);
            writer.write_feature(&VectorFeature {
                id,
                geometry: geometry.as_ref().map(|geometry| (GeometryKind::Point, geometry as _)),
                attributes: &values,
            })?;
        }
        Ok(())
    }

    /// Reads the values of features that are not cached.
    fn read(&mut self, mut numbers: Vec<u64>) -> Result<()> {
        let JoinedLayer { tree, chosen, known, .. } = self;
        if chosen.is_empty() {
            return Ok(());
        }
        if known.len() * chosen.len() > MAX_CACHED_VALUES {
            known.clear();
        }
        numbers.retain(|number| !known.contains_key(number));
        sort::numbers64(&mut numbers);
        numbers.dedup();
        tree.features(&mut numbers.into_iter(), &mut |number, feature| {
            let value = |index: &usize| feature.values.get(*index).cloned().unwrap_or(LineValue::None);
            known.insert(number, chosen.iter().map(value).collect());
            Ok(())
        })
    }

    /// Completes the layer; returns whether there is an output.
    pub(super) fn finish(self, progress: &dyn Progress) -> Result<bool> {
        self.writer.map_or(Ok(false), |writer| writer.finish(progress).map(|()| true))
    }
}

/// Returns the conversion from the coordinates of a file's features to those of the tree.
pub(super) fn locator_of(
    tree: &LineTree,
    path: &Path,
    reader: &dyn FeatureReader,
    progress: &dyn Progress,
) -> Result<WorldLocator> {
    let coordinates = coordinates_in(&tree.metadata().frame, path, reader, progress);
    let locator = tree.locator(&coordinates).map_err(|error| in_file(path, error))?;
    locator.remarks().iter().for_each(|remark| progress.warn(path, remark));
    Ok(locator)
}
