//! Export of features with zonal statistics.

use std::path::PathBuf;

use super::features::bounds_of;
use super::layer::push_attribute;
use super::{
    AttributeType, AttributeValue, FeatureParts, Geometry, VectorFeature, VectorFormat, VectorLayer,
    VectorWriter,
};
use crate::import::feature::{Feature, FeatureAttribute, FeatureSchema};
use crate::import::zones::{PolygonLayer, PolygonReader};
use crate::zonal::{FeatureZones, in_file};
use spinney_base::io::Output;
use spinney_base::space::EdgeRule;
use spinney_base::value::{Number, SampleType};
use spinney_base::{Error, Progress, Result};
use spinney_crs::{Coordinates, Crs};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ZonalRequest, ZoneMeasure, ZoneStatistics};

/// Maximum number of classes with their own columns, over all layers.
const MAX_CLASSES: usize = 1000;

/// Column of statistics.
struct Column {
    /// Index of the layer, and of its channel.
    layer: usize,
    channel: usize,
    statistic: Statistic,
    kind: AttributeType,
}

/// Statistic of a column.
enum Statistic {
    Measure(ZoneMeasure),
    /// Quantile, by its index in the request.
    Quantile(usize),
    /// Count of a class's cells, or their area or volume; the second field is a factor.
    Class(Number, f64),
}

/// Writes the features of a file, in order and unchanged, joined with the zonal statistics of one
/// or more layers; returns their number. Features other than polygons get no statistics.
///
/// There is one column per measure and quantile, and, for trees that count classes, one per class:
/// its area in square metres (`area_3`), in octrees its volume in cubic world units (`volume_3`),
/// or, if the coordinate system does not determine the cell size, its cell count (`cells_3`). Names
/// start with the layer's (`B08_mean`) if there are several layers, and end with the channel's
/// number (`mean_2`) if there are several channels. Duplicate attribute names get a number. Ids are
/// stored as such if the format supports it, else in an attribute `id`.
///
/// Vertices are in the given coordinates, or in the file's own, and are not transformed.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::VectorFormat;
/// use spinney::raw::export::vector::export_zones;
/// use spinney::import::feature::FeatureOptions;
/// use spinney::raw::import::feature::PolygonReader;
/// use spinney::{Coordinates, Output};
/// use spinney::query::EdgeRule;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let (path, table) = (directory.path().join("parcels.geojson"), directory.path().join("parcels.csv"));
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let [low, high] = map.metadata().frame.world_box(&map.header().extent_bounds());
/// let ring = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], low[1]]];
/// std::fs::write(&path, format!(r#"{{"type":"Polygon","crs":null,"coordinates":[{ring:?}]}}"#)).unwrap();
/// let reader = PolygonReader::open(&path, &FeatureOptions::default())?;
/// let (request, output) = (EdgeRule::Area.into(), Output::create(&table)?);
/// let count = export_zones(reader, Some(&Coordinates::World), &[&map], &request, output, VectorFormat::Csv, &())?;
/// assert_eq!(count, 1);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the features cannot be read, all of them lie outside of the trees, a tree has too many
/// classes for columns, is corrupt, or has no transform to its cells; if the output cannot be
/// written; on cancellation.
pub fn export_zones(
    reader: PolygonReader,
    coordinates: Option<&Coordinates>,
    trees: &[&Dataset],
    request: &ZonalRequest,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<u64> {
    let mut reader = reader.with_others();
    let mut zones = FeatureZones::new(&reader, coordinates, trees, request, progress)?;
    let mut schema = reader.schema().clone();
    schema.crs = system_of(coordinates, schema.crs, trees);
    let (mut output, mut writer, mut count) = (Some(output), None, 0u64);
    while let Some(layer) = reader.next_layer().map_err(|error| in_file(reader.path(), error))? {
        if let Some(output) = output.take() {
            let first = (&schema, &layer);
            writer = Some(ZoneWriter::create(output, format, first, trees, request, progress)?);
        }
        zones.each(&layer, progress, &mut |number, zone| {
            count += 1;
            writer.as_mut().map_or(Ok(()), |writer| writer.write(&layer.features[number], zone))
        })?;
    }
    zones.finish(progress)?;
    match writer {
        Some(writer) => writer.finish(progress).map(|()| count),
        None => Err(Error::invalid(format!("{}: features", reader.path().display()), "none", "at least one")),
    }
}

/// Returns the coordinate system of the vertices: the given one, or the file's own.
fn system_of(coordinates: Option<&Coordinates>, own: Option<Crs>, trees: &[&Dataset]) -> Option<Crs> {
    match coordinates {
        None => own,
        Some(Coordinates::System(crs)) => Some(crs.clone()),
        Some(Coordinates::World) => trees.first().and_then(|tree| tree.metadata().frame.crs.clone()),
        Some(Coordinates::Cells) => None,
    }
}

/// File of features with statistics under construction.
struct ZoneWriter {
    writer: VectorWriter,
    path: PathBuf,
    columns: Vec<Column>,
    /// Whether ids are an attribute; false if the format stores ids.
    has_id_column: bool,
    keeps_ids: bool,
    with_heights: u64,
}

impl ZoneWriter {
    /// Starts a file for features of a schema; `first` contains the first features. The statistics
    /// are those of a request about `trees`.
    fn create(
        output: Output,
        format: VectorFormat,
        (schema, first): (&FeatureSchema, &PolygonLayer),
        trees: &[&Dataset],
        request: &ZonalRequest,
        progress: &dyn Progress,
    ) -> Result<ZoneWriter> {
        let path = output.path().to_path_buf();
        let has_ids = first.features.iter().any(|feature| feature.id.is_some());
        let is_whole = |feature: &Feature| feature.id.as_ref().is_none_or(serde_json::Value::is_i64);
        // Row ids must be unique integers. Only ascending ids, as another such table has, guarantee
        // that.
        let keeps_ids = match format {
            VectorFormat::GeoJson => true,
            VectorFormat::GeoPackage => {
                !has_ids || is_ascending(&first.features) && first.features.iter().all(is_whole)
            }
            _ => false,
        };
        let has_id_column = has_ids && !keeps_ids;
        let mut names: Vec<(String, AttributeType)> = Vec::new();
        let mut push = |name: String, kind| {
            if push_attribute(&mut names, name.clone(), kind)
                && let Some((unique, _)) = names.last()
            {
                let text = format!(
                    "statistic `{name}` is written as `{unique}`, since features have an attribute `{name}`"
                );
                progress.warn(&path, &text);
            }
        };
        for (name, kind) in &schema.attributes {
            push(name.clone(), *kind);
        }
        if has_id_column {
            push("id".into(), AttributeType::Mixed);
        }
        let mut columns = Vec::new();
        for (layer, tree) in trees.iter().enumerate() {
            let prefix = if trees.len() > 1 { format!("{}_", tree.metadata().name) } else { String::new() };
            for (name, column) in columns_of(layer, tree, request, progress)? {
                push(format!("{prefix}{name}"), column.kind);
                columns.push(column);
            }
            if columns.len() > MAX_CLASSES + 64 * trees.len() {
                let found = format!("a table with {} columns of statistics", columns.len());
                return Err(Error::unsupported(
                    &path,
                    found,
                    "select measures without classes, or print JSON",
                ));
            }
        }
        let parts = first.features.iter().filter_map(|feature| feature.geometry.as_ref());
        let parts: Vec<FeatureParts<'_>> = parts.map(FeatureParts::of).collect();
        let layer = VectorLayer {
            name: if schema.name.is_empty() { "zones".into() } else { schema.name.clone() },
            kind: schema.kind,
            is_multi: true,
            has_z: false,
            attributes: names,
            crs: schema.crs.clone(),
            bounds: bounds_of(&mut parts.iter().flat_map(FeatureParts::vertices)),
        };
        let writer = VectorWriter::create(output, format, layer)?;
        Ok(ZoneWriter { writer, path, columns, has_id_column, keeps_ids, with_heights: 0 })
    }

    /// Writes the next feature with its statistics of each layer.
    fn write(&mut self, feature: &Feature, zones: &[ZoneStatistics]) -> Result<()> {
        self.with_heights += u64::from(feature.heights.any());
        let statistics: Vec<FeatureAttribute> =
            self.columns.iter().map(|column| column.value(&zones[column.layer])).collect();
        let mut values: Vec<AttributeValue<'_>> =
            feature.attributes.iter().map(AttributeValue::from).collect();
        let id = self.has_id_column.then(|| feature.id_attribute());
        values.extend(id.iter().map(AttributeValue::from));
        values.extend(statistics.iter().map(AttributeValue::from));
        let geometry = feature.geometry.as_ref().map(FeatureParts::of);
        self.writer.write_feature(&VectorFeature {
            id: feature.id.as_ref().filter(|_| self.keeps_ids),
            geometry: geometry.as_ref().map(|parts| (parts.kind(), parts as &dyn Geometry)),
            attributes: &values,
        })
    }

    /// Completes and publishes the file.
    fn finish(self, progress: &dyn Progress) -> Result<()> {
        if self.with_heights > 0 {
            let count = self.with_heights;
            progress.warn(&self.path, &format!("heights and measures of {count} features are dropped"));
        }
        self.writer.finish(progress)
    }
}

impl Column {
    fn value(&self, zone: &ZoneStatistics) -> FeatureAttribute {
        let number = match &self.statistic {
            Statistic::Measure(measure) => zone.number(*measure, self.channel),
            Statistic::Quantile(index) => {
                let values = zone.channels.get(self.channel).and_then(|channel| channel.values.as_ref());
                values.and_then(|values| values.quantiles.get(*index)).map(|quantile| Number::from(*quantile))
            }
            Statistic::Class(class, area) => {
                let found = zone.classes.iter().find(|(own, _)| own == class);
                Some(Number::from(found.map_or(0.0, |(_, cells)| cells * area)))
            }
        };
        let Some(number) = number else { return FeatureAttribute::None };
        match (self.kind, number.to_integer().and_then(|whole| i64::try_from(whole).ok())) {
            (AttributeType::Integer, Some(whole)) => FeatureAttribute::Integer(whole),
            // There are no cells.
            (AttributeType::Integer, None) => FeatureAttribute::None,
            (AttributeType::Text, _) if number.to_f64().is_nan() => FeatureAttribute::None,
            (AttributeType::Text, _) => FeatureAttribute::Text(number.to_string()),
            _ => FeatureAttribute::Number(number.to_f64()),
        }
    }
}

/// Returns whether a tree has integers above the range of `i64`.
fn exceeds(tree: &Dataset, progress: &dyn Progress) -> Result<bool> {
    let most = Number::from(i64::MAX as u64);
    Ok(tree.statistics(None, progress)?.channels.iter().any(|own| own.cells > 0 && own.max > most))
}

/// Returns names and columns of the statistics of a layer.
fn columns_of(
    layer: usize,
    tree: &Dataset,
    request: &ZonalRequest,
    progress: &dyn Progress,
) -> Result<Vec<(String, Column)>> {
    let header = tree.header();
    let (channels, sample) = (usize::from(header.form.value.channels), header.form.value.sample);
    let counts_classes = header.counts_classes();
    let is_requested = |measure: &ZoneMeasure| match request.measures.is_empty() {
        true => !measure.needs_values() && (*measure != ZoneMeasure::Void),
        false => request.measures.contains(measure),
    };
    let cells = if request.edge == EdgeRule::Area { AttributeType::Number } else { AttributeType::Integer };
    let samples = match sample {
        sample if sample.is_float() => AttributeType::Number,
        // Integers above the range of `i64` are written as strings, which are exact.
        SampleType::U64 if exceeds(tree, progress)? => AttributeType::Text,
        _ => AttributeType::Integer,
    };
    let of_channel = |name: &str, channel: usize| match channels {
        1 => name.to_owned(),
        _ => format!("{name}_{}", channel + 1),
    };
    let mut columns = Vec::new();
    for measure in ZoneMeasure::ALL.iter().filter(|measure| is_requested(measure)) {
        let (kind, of_each) = match measure {
            ZoneMeasure::Count | ZoneMeasure::Void => (cells, false),
            ZoneMeasure::VoidShare | ZoneMeasure::Outside => (AttributeType::Number, false),
            ZoneMeasure::Min | ZoneMeasure::Max | ZoneMeasure::Majority | ZoneMeasure::Minority => {
                (samples, true)
            }
            ZoneMeasure::Variety => (AttributeType::Integer, true),
            ZoneMeasure::Sum | ZoneMeasure::Mean | ZoneMeasure::Deviation | ZoneMeasure::Median => {
                (AttributeType::Number, true)
            }
            ZoneMeasure::Classes => continue,
        };
        // Class numbers have no meaningful sum.
        let is_number = matches!(measure, ZoneMeasure::Sum | ZoneMeasure::Mean | ZoneMeasure::Deviation);
        if request.measures.is_empty() && counts_classes && is_number {
            continue;
        }
        for channel in 0..if of_each { channels } else { 1 } {
            let statistic = Statistic::Measure(*measure);
            columns.push((of_channel(measure.name(), channel), Column { layer, channel, statistic, kind }));
        }
    }
    for (index, quantile) in request.quantiles.iter().enumerate() {
        for channel in 0..channels {
            let column =
                Column { layer, channel, statistic: Statistic::Quantile(index), kind: AttributeType::Number };
            columns.push((of_channel(&quantile_name(*quantile), channel), column));
        }
    }
    if counts_classes && is_requested(&ZoneMeasure::Classes) {
        let frame = &tree.metadata().frame;
        let (name, measure) = match header.form.axes() {
            3 => ("volume", frame.cell_volume()),
            _ => ("area", frame.cell_square_metres()),
        };
        let (name, area) = measure.map_or(("cells", 1.0), |each| (name, each));
        let classes = tree.statistics(None, progress)?.classes;
        if classes.len() > MAX_CLASSES {
            let advice = "select measures without classes, or print JSON";
            return Err(Error::unsupported(
                tree.name(),
                format!("{} classes as columns", classes.len()),
                advice,
            ));
        }
        for (class, _) in classes {
            let kind = if name == "cells" { cells } else { AttributeType::Number };
            columns.push((
                format!("{name}_{class}"),
                Column { layer, channel: 0, statistic: Statistic::Class(class, area), kind },
            ));
        }
    }
    Ok(columns)
}

/// Returns the column name of a quantile: `q2_5` for 0.025.
pub fn quantile_name(quantile: f64) -> String {
    let percent = (quantile * 1e8).round() / 1e6;
    format!("q{percent}").replace('.', "_")
}

/// Returns whether the integer ids of features ascend.
fn is_ascending(features: &[Feature]) -> bool {
    let mut ids =
        features.iter().filter_map(|feature| feature.id.as_ref().and_then(serde_json::Value::as_i64));
    let mut last = None;
    ids.all(|id| last.replace(id).is_none_or(|before| before < id))
}
