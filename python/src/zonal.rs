//! Statistics of the cells in polygons.

use pyo3::prelude::*;
use spinney::Progress as _;
use spinney::import::geojson::{PolygonLayer, parse_polygons};
use spinney::query::ZoneStatistics;
use spinney::space::{Coordinates, EdgeRule, Places, Polygon};

use crate::error::OrRaise;
use crate::jobs::{self, Terms, Work};
use crate::tree::{Opened, Tree};

/// Cells, VOID cells, numbers of each channel, and cells of each class.
type Zone<'py> = (f64, f64, Vec<ZoneNumbers<'py>>, Vec<(Bound<'py, PyAny>, f64)>);

/// Cells, least and greatest sample, mean and standard deviation of a channel.
type ZoneNumbers<'py> = (f64, Bound<'py, PyAny>, Bound<'py, PyAny>, f64, f64);

#[pymethods]
impl Tree {
    /// Statistics of the cells in each polygon of some GeoJSON documents, each with the definition of its coordinate system: `world` is
    /// the tree's own, and without one it is what the document says. Features are those that have all values of some attributes.
    #[pyo3(name = "_zones")]
    fn zones<'py>(
        &self,
        py: Python<'py>,
        documents: Vec<(String, Option<String>)>,
        edge: &str,
        values: Vec<(String, String)>,
        terms: Terms,
    ) -> PyResult<Vec<Zone<'py>>> {
        let opened = self.get()?;
        let rule: EdgeRule = edge.parse().or_raise()?;
        let zones = jobs::run(py, terms, |work| {
            let (header, frame) = (opened.tree.header(), &opened.tree.metadata().frame);
            let (coordinates, mut layers) = layers_of(&documents, frame.crs.is_some(), work)?;
            PolygonLayer::select(&mut layers, &values)?;
            let mut polygons = Vec::new();
            for (coordinates, layer) in coordinates.iter().zip(&layers) {
                work.check()?;
                let places = Places::new(coordinates, frame, header.extent)?;
                polygons.extend(layer.in_cells(&places, header.extent)?);
            }
            // (Polygons that lie outside of the tree have no cells.)
            let met: Vec<Polygon> = polygons.iter().flatten().cloned().collect();
            let mut found = opened.tree.zonal(&met, rule, work)?.into_iter();
            opened.tree.check_unchanged()?;
            let zone_of =
                |polygon: &Option<Polygon>| polygon.as_ref().and_then(|_| found.next()).unwrap_or_default();
            Ok(polygons.iter().map(zone_of).collect::<Vec<_>>())
        })?;
        zones.iter().map(|zone| told(py, &opened, zone)).collect()
    }
}

/// The features of documents, and their coordinates. Those of one system after each other are one layer: all of it must lie outside of
/// the tree for that to be an error.
fn layers_of(
    documents: &[(String, Option<String>)],
    has_system: bool,
    work: &Work,
) -> spinney::Result<(Vec<Coordinates>, Vec<PolygonLayer>)> {
    let (mut systems, mut layers): (Vec<Coordinates>, Vec<PolygonLayer>) = (Vec::new(), Vec::new());
    for (document, crs) in documents {
        work.check()?;
        let layer = parse_polygons(document)?;
        let coordinates = match crs {
            Some(crs) => crs.parse()?,
            None if !has_system => Coordinates::World,
            None => layer.coordinates(),
        };
        match layers.last_mut() {
            Some(last) if systems.last() == Some(&coordinates) => last.features.extend(layer.features),
            _ => {
                systems.push(coordinates);
                layers.push(layer);
            }
        }
    }
    Ok((systems, layers))
}

fn told<'py>(py: Python<'py>, opened: &Opened, zone: &ZoneStatistics) -> PyResult<Zone<'py>> {
    let channels = zone.channels.iter().map(|c| {
        Ok((c.cells, opened.told(py, c.min)?, opened.told(py, c.max)?, c.mean, c.standard_deviation))
    });
    let classes = zone.classes.iter().map(|(value, cells)| Ok((opened.told(py, *value)?, *cells)));
    let (channels, classes) = (channels.collect::<PyResult<_>>()?, classes.collect::<PyResult<_>>()?);
    Ok((zone.cells, zone.void_cells, channels, classes))
}
