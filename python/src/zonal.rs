//! Statistics of the cells in polygons.

use pyo3::prelude::*;
use spinney::import::geojson::{PolygonFeature, parse_polygons};
use spinney::query::{ZoneRule, ZoneStatistics};

use crate::error::OrRaise;
use crate::jobs;
use crate::tree::Tree;

/// Cells, VOID cells, numbers of each channel, and cells of each class.
type Zone = (f64, f64, Vec<(f64, f64, f64, f64, f64)>, Vec<(f64, f64)>);

#[pymethods]
impl Tree {
    /// Statistics of the cells in each polygon of some GeoJSON documents, in the tree's coordinate system.
    #[pyo3(signature = (documents, by_area, progress=None))]
    #[pyo3(name = "_zones")]
    fn zones(
        &self,
        py: Python<'_>,
        documents: Vec<String>,
        by_area: bool,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Vec<Zone>> {
        let opened = self.get()?;
        let frame = &opened.tree.metadata().frame;
        let mut polygons = Vec::new();
        for document in &documents {
            let features = parse_polygons(document).or_raise()?;
            let cells = features.iter().map(|feature: &PolygonFeature| feature.in_cells(frame));
            polygons.extend(cells.collect::<spinney::Result<Vec<_>>>().or_raise()?);
        }
        let rule = if by_area { ZoneRule::Area } else { ZoneRule::Centre };
        let zones = jobs::run(py, progress, |work| {
            let zones = opened.tree.zonal(&polygons, rule, work)?;
            opened.tree.check_unchanged()?;
            Ok(zones)
        })?;
        Ok(zones.into_iter().map(told).collect())
    }
}

fn told(zone: ZoneStatistics) -> Zone {
    let channels = zone.channels.iter();
    let channels = channels.map(|c| (c.cells, c.min, c.max, c.mean, c.standard_deviation)).collect();
    (zone.cells, zone.void_cells, channels, zone.classes)
}
