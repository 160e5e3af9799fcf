//! Statistics of the cells in polygons.

use pyo3::prelude::*;
use spinney::import::geojson::{PolygonLayer, parse_polygons};
use spinney::query::ZoneStatistics;
use spinney::space::{Coordinates, EdgeRule, Places, Polygon};

use crate::error::OrRaise;
use crate::jobs;
use crate::tree::Tree;

/// Cells, VOID cells, numbers of each channel, and cells of each class.
type Zone = (f64, f64, Vec<(f64, f64, f64, f64, f64)>, Vec<(f64, f64)>);

#[pymethods]
impl Tree {
    /// Statistics of the cells in each polygon of some GeoJSON documents, each with the definition of its coordinate system: `world` is
    /// the tree's own, and without one it is what the document says.
    #[pyo3(signature = (documents, edge, progress=None))]
    #[pyo3(name = "_zones")]
    fn zones(
        &self,
        py: Python<'_>,
        documents: Vec<(String, Option<String>)>,
        edge: &str,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Vec<Zone>> {
        let opened = self.get()?;
        let (header, frame) = (opened.tree.header(), &opened.tree.metadata().frame);
        // Documents of one system after each other are one layer: all of it must lie outside for that to be an error.
        let mut layers: Vec<(Coordinates, PolygonLayer)> = Vec::new();
        for (document, crs) in &documents {
            let layer = parse_polygons(document).or_raise()?;
            let coordinates = match crs {
                Some(crs) => crs.parse().or_raise()?,
                None if frame.crs.is_none() => Coordinates::World,
                None => layer.coordinates(),
            };
            match layers.last_mut() {
                Some((last, all)) if *last == coordinates => all.features.extend(layer.features),
                _ => layers.push((coordinates, layer)),
            }
        }
        let mut polygons = Vec::new();
        for (coordinates, layer) in &layers {
            let places = Places::new(coordinates, frame, header.extent).or_raise()?;
            polygons.extend(layer.in_cells(&places, header.extent).or_raise()?);
        }
        let rule: EdgeRule = edge.parse().or_raise()?;
        let zones = jobs::run(py, progress, |work| {
            // (Polygons that lie outside of the tree have no cells.)
            let met: Vec<Polygon> = polygons.iter().flatten().cloned().collect();
            let mut found = opened.tree.zonal(&met, rule, work)?.into_iter();
            opened.tree.check_unchanged()?;
            let zone_of =
                |polygon: &Option<Polygon>| polygon.as_ref().and_then(|_| found.next()).unwrap_or_default();
            Ok(polygons.iter().map(zone_of).collect::<Vec<_>>())
        })?;
        Ok(zones.into_iter().map(told).collect())
    }
}

fn told(zone: ZoneStatistics) -> Zone {
    let channels = zone.channels.iter();
    let channels = channels.map(|c| (c.cells, c.min, c.max, c.mean, c.standard_deviation)).collect();
    (zone.cells, zone.void_cells, channels, zone.classes)
}
