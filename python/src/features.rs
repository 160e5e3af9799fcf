//! Options of trees built from features.

use pyo3::prelude::*;
use spinney::import::feature::RasterizeOptions;
use spinney::raw::import::raster::TargetGrid;
use spinney::raw::import::rasterize::FeatureGrid;
use spinney::{Crs, SampleType};

use crate::build::FileOptions;
use crate::error::{OrRaise, invalid};
use crate::samples::sample_of;

impl FileOptions {
    /// Returns the options for features.
    pub(crate) fn features(&self) -> PyResult<RasterizeOptions> {
        if self.bands.is_some()
            || self.nodata.is_some()
            || self.transform.is_some()
            || self.pages.is_some()
            || self.stack
            || self.names.is_some()
            || self.times.is_some()
            || self.keep_transparent
            || self.resampling.is_some()
            || self.allow_ballpark
            || self.shell
            || self.attribute.is_some()
            || self.up.is_some()
            || self.unit.is_some()
        {
            let text = "bands, nodata, transform, pages, stack, names, times, keep_transparent, resampling, allow_ballpark, shell, attribute, up and unit do not apply to features";
            return Err(invalid(text));
        }
        let grid = match (&self.grid, self.cells, self.cell) {
            (Some(path), None, None) if path.as_os_str() == "xyz" => {
                let Some(zoom) = self.max_zoom else {
                    return Err(invalid("grid=\"xyz\": for features, give the deepest zoom as max_zoom="));
                };
                FeatureGrid::web_mercator(zoom).or_raise()?
            }
            (_, None, None) if self.max_zoom.is_some() => {
                return Err(invalid("max_zoom: is for grid=\"xyz\""));
            }
            (Some(_), None, None) => match self.target()? {
                Some(TargetGrid::Like(cells)) => FeatureGrid::Extended(*cells),
                _ => return Err(invalid("grid: expected \"xyz\" or a tree file")),
            },
            (None, Some(cells), None) => FeatureGrid::Cells(cells),
            (None, None, Some(cell)) => FeatureGrid::Cell(cell),
            _ => return Err(invalid("features: expected one of cell=, cells= and grid=")),
        };
        let mut options = RasterizeOptions::new(grid);
        options.value =
            self.value.as_ref().map(|text| text.parse()).transpose().or_raise()?.unwrap_or_default();
        let overlaps = self.overlaps.as_ref().map(|text| text.parse()).transpose().or_raise()?;
        options.overlaps = overlaps.unwrap_or_default();
        options.sample = self.sample.as_deref().map(sample_type).transpose()?;
        options.width = self.width.as_ref().map(|text| text.parse()).transpose().or_raise()?;
        let edge = self.edge.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        (options.edge, options.fractions) = (edge.unwrap_or_default(), self.fractions);
        options.kind = self.kind.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        options.rule = self.rule.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        options.crs = self.crs.as_deref().map(Crs::parse).transpose().or_raise()?;
        options.features.layer.clone_from(&self.layer);
        options.features.filter =
            self.filter.as_ref().map(|text| text.parse()).transpose().or_raise()?.unwrap_or_default();
        (options.depth, options.memory, options.share) = (self.depth, self.memory, self.share);
        options.time = self.time;
        options.packing = self.packing.0;
        Ok(options)
    }

    /// Returns whether an option is set that only features have.
    pub(crate) fn has_feature_options(&self) -> bool {
        self.value.is_some()
            || self.overlaps.is_some()
            || self.sample.is_some()
            || self.width.is_some()
            || self.fractions
            || self.filter.is_some()
    }
}

/// Returns the sample type with this NumPy name.
fn sample_type(name: &str) -> PyResult<SampleType> {
    sample_of(name)
        .ok_or_else(|| invalid(format!("dtype: got {name}, expected a numeric type that trees support")))
}
