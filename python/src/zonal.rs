//! Statistics of the cells in polygons.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pyo3::prelude::*;
use spinney::export::VectorFormat;
use spinney::import::feature::{FeatureFilter, FeatureOptions};
use spinney::query::{EdgeRule, Polygon, ZonalRequest, ZoneMeasure, ZoneStatistics};
use spinney::raw::export::vector::export_zones;
use spinney::raw::import::feature::{
    AttributeCondition, PolygonLayer, PolygonReader, Relation, parse_polygons, read_polygons,
};
use spinney::raw::query::ZoneValues;
use spinney::{CellLocator, Coordinates, Dataset, Progress as _};

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms, Work};
use crate::tree::{Opened, Tree};

/// Valid, VOID and outside cells, numbers of each channel, and cells per class.
type Zone<'py> = ((f64, f64, f64), Vec<ZoneNumbers<'py>>, Vec<(Bound<'py, PyAny>, f64)>);

/// Cells, minimum, maximum, mean, standard deviation and sum of a channel, and the statistics of
/// single values.
type ZoneNumbers<'py> = (f64, Bound<'py, PyAny>, Bound<'py, PyAny>, f64, f64, f64, Option<ValueNumbers<'py>>);

/// Variety, majority, minority, median, and the requested quantiles.
type ValueNumbers<'py> = (u64, Bound<'py, PyAny>, Bound<'py, PyAny>, f64, Vec<f64>);

#[pymethods]
impl Tree {
    /// Returns statistics of the cells in each polygon of several documents, each with the
    /// definition of its coordinate system: `world` is the tree's own, `None` that of the document.
    /// Only selected features count. There is a list per layer, or one for the open layer. It can
    /// be an error if all polygons of one coordinate system are outside.
    #[pyo3(name = "_zones")]
    #[allow(clippy::too_many_arguments)] // as in Python
    fn zones<'py>(
        &self,
        py: Python<'py>,
        documents: Vec<Document>,
        edge: &str,
        query: ZonalQuery,
        layers: Option<Vec<String>>,
        outside_is_error: bool,
        terms: Terms,
    ) -> PyResult<Vec<Vec<Zone<'py>>>> {
        let opened = self.requested_layers(py, layers)?;
        let memory = query.1;
        let (filter, request) = request_of(edge, query)?;
        let zones = jobs::run(py, terms, |work| {
            let trees: Vec<&Dataset> = opened.iter().map(|opened| &opened.tree).collect();
            let has_system = trees.iter().all(|tree| tree.metadata().frame.crs.is_some());
            let (coordinates, layers) = layers_of(&documents, (&filter, memory), has_system, work)?;
            // Polygons are transformed once per grid; layers may share a grid.
            let same = Dataset::same_cells(&trees);
            let grids: Vec<usize> = (0..trees.len()).filter(|number| same[*number] == *number).collect();
            let mut polygons: Vec<Vec<Option<Polygon>>> = vec![Vec::new(); grids.len()];
            for (coordinates, layer) in coordinates.iter().zip(&layers) {
                work.check()?;
                let locators = grids.iter().map(|grid| {
                    let (header, frame) = (trees[*grid].header(), &trees[*grid].metadata().frame);
                    Ok((CellLocator::new(coordinates, frame, header.extent)?, header.extent))
                });
                let found =
                    layer.in_cells_of(coordinates, &locators.collect::<spinney::Result<Vec<_>>>()?)?;
                found.outside.filter(|_| outside_is_error).map_or(Ok(()), Err)?;
                polygons.iter_mut().zip(found.trees).for_each(|(all, found)| all.extend(found));
            }
            let of_grid = |first: &usize| &polygons[grids.binary_search(first).unwrap_or_default()][..];
            let tree_zones: Vec<_> = trees.iter().copied().zip(same.iter().map(of_grid)).collect();
            let mut of_layers = vec![Vec::new(); trees.len()];
            Dataset::zonal_layers(&tree_zones, &request, work, &mut |zone| {
                of_layers.iter_mut().zip(zone).for_each(|(zones, zone)| zones.push(zone));
                Ok(())
            })?;
            trees.iter().try_for_each(|tree| tree.check_unchanged())?;
            Ok(of_layers)
        })?;
        let of_layer = |(opened, zones): (&Arc<Opened>, &Vec<ZoneStatistics>)| {
            zones.iter().map(|zone| zone_to_python(py, opened, zone)).collect()
        };
        opened.iter().zip(&zones).map(of_layer).collect()
    }

    /// Writes the features of a file, in given coordinates or in its own, joined with the
    /// statistics of their cells; returns the number of features.
    #[pyo3(name = "_write_zones")]
    #[allow(clippy::too_many_arguments)] // as in Python
    fn write_zones(
        &self,
        py: Python<'_>,
        features: (PathBuf, Option<String>),
        edge: &str,
        query: ZonalQuery,
        attributes: Option<Vec<String>>,
        layers: Option<Vec<String>>,
        out: PathBuf,
        terms: Terms,
    ) -> PyResult<u64> {
        let opened = self.requested_layers(py, layers)?;
        let (path, coordinates) = features;
        let format = VectorFormat::of(&out)
            .ok_or_else(|| invalid("out: expected .geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply"))?;
        let trees = opened.iter().map(|opened| opened.tree.name().to_path_buf());
        check_output(&trees.chain([path.clone()]).collect::<Vec<_>>(), &out)?;
        let coordinates: Option<Coordinates> = coordinates.map(|text| text.parse()).transpose().or_raise()?;
        let memory = query.1;
        let (filter, mut request) = request_of(edge, query)?;
        // (If values are requested, they get half.)
        request.memory = memory / 2;
        let memory = if request.needs_values() { memory - request.memory } else { memory };
        let has_system = opened.iter().all(|opened| opened.tree.metadata().frame.crs.is_some());
        let check_degrees = coordinates.is_none() && has_system;
        let options =
            FeatureOptions { memory, filter, attributes, check_degrees, ..FeatureOptions::default() };
        jobs::run(py, terms, |work| {
            let trees: Vec<&Dataset> = opened.iter().map(|opened| &opened.tree).collect();
            let reader = PolygonReader::open(&path, &options)?;
            let output = work.create(&out)?;
            let count = export_zones(reader, coordinates.as_ref(), &trees, &request, output, format, work)?;
            trees.iter().try_for_each(|tree| tree.check_unchanged())?;
            Ok(count)
        })
    }
}

impl Tree {
    /// Returns the layers with these names, or the open one.
    fn requested_layers(&self, py: Python<'_>, layers: Option<Vec<String>>) -> PyResult<Vec<Arc<Opened>>> {
        match layers {
            Some(names) => py.detach(|| self.open_layers(&names)).or_raise(),
            None => Ok(vec![self.get()?]),
        }
    }
}

/// Zonal request: selected features, memory in bytes, names of measures, and quantiles.
type ZonalQuery = (Chosen, u64, Vec<String>, Vec<f64>);

fn request_of(edge: &str, query: ZonalQuery) -> PyResult<(FeatureFilter, ZonalRequest)> {
    let edge: EdgeRule = edge.parse().or_raise()?;
    let (chosen, memory, measures, quantiles) = query;
    let measures = measures.iter().map(|name| name.parse()).collect::<spinney::Result<Vec<ZoneMeasure>>>();
    let request = ZonalRequest { edge, measures: measures.or_raise()?, quantiles, memory };
    let filter = match chosen {
        Chosen::Conditions(text) => text.parse().or_raise()?,
        Chosen::Values(values) => {
            let equal = |(name, value)| AttributeCondition { name, relation: Relation::Equal, value };
            FeatureFilter { conditions: values.into_iter().map(equal).collect() }
        }
    };
    Ok((filter, request))
}

/// Selected features.
#[derive(FromPyObject)]
enum Chosen {
    /// Features that meet all conditions, as in `code>=3,kind!=lake`.
    Conditions(String),
    /// Features with these attribute values.
    Values(Vec<(String, String)>),
}

/// GeoJSON string, or the path of a feature file; the definition of its coordinate system; whether
/// it is a path.
type Document = (String, Option<String>, bool);

/// Returns the features of documents that pass a filter, and their coordinates. The features of a
/// file must fit into `memory` bytes. Consecutive documents with one coordinate system form one
/// layer: the error for features outside of the tree applies only if all of its features are
/// outside.
fn layers_of(
    documents: &[Document],
    (filter, memory): (&FeatureFilter, u64),
    has_system: bool,
    work: &Work,
) -> spinney::Result<(Vec<Coordinates>, Vec<PolygonLayer>)> {
    let read = |(document, crs, is_path): &Document| {
        work.check()?;
        let check_degrees = crs.is_none() && has_system;
        let options = FeatureOptions { memory, check_degrees, ..FeatureOptions::default() };
        if *is_path {
            read_polygons(Path::new(document), &options)
        } else {
            parse_polygons(document, &options)
        }
    };
    let mut all = documents.iter().map(read).collect::<spinney::Result<Vec<_>>>()?;
    PolygonLayer::select(&mut all, filter)?;
    let (mut systems, mut layers): (Vec<Coordinates>, Vec<PolygonLayer>) = (Vec::new(), Vec::new());
    for ((_, crs, _), layer) in documents.iter().zip(all) {
        let coordinates = match crs {
            Some(crs) => crs.parse()?,
            None if !has_system => Coordinates::World,
            None => layer.coordinates(),
        };
        match layers.last_mut() {
            // (Their attributes are no longer needed.)
            Some(last) if systems.last() == Some(&coordinates) => last.features.extend(layer.features),
            _ => {
                systems.push(coordinates);
                layers.push(layer);
            }
        }
    }
    Ok((systems, layers))
}

fn zone_to_python<'py>(py: Python<'py>, opened: &Opened, zone: &ZoneStatistics) -> PyResult<Zone<'py>> {
    let to_python = |number| opened.to_python(py, number);
    let values = |values: &ZoneValues| -> PyResult<ValueNumbers<'py>> {
        let (majority, minority) = (to_python(values.majority)?, to_python(values.minority)?);
        Ok((values.variety, majority, minority, values.median, values.quantiles.clone()))
    };
    let channels = zone.channels.iter().map(|c| {
        let values = c.values.as_ref().map(values).transpose()?;
        Ok((c.cells, to_python(c.min)?, to_python(c.max)?, c.mean, c.standard_deviation, c.sum, values))
    });
    let classes = zone.classes.iter().map(|(value, cells)| Ok((to_python(*value)?, *cells)));
    let (channels, classes) = (channels.collect::<PyResult<_>>()?, classes.collect::<PyResult<_>>()?);
    Ok(((zone.cells, zone.void_cells, zone.outside_cells), channels, classes))
}
