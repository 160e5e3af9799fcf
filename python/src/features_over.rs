//! Features rasterized to the cells of a tree, for edits, combinations and searches.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use spinney::import::feature::{FeatureValue, RasterizeOptions, plan_features};
use spinney::raw::import::rasterize::FeatureTree;
use spinney::raw::ops::MadeOperand;
use spinney::{Coordinates, Header, Metadata, Number, Progress, Rule};

use crate::error::{OrRaise, invalid};
use crate::region::coordinates_of;

/// Feature file, and the options of its rasterization, by their names in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct FeatureTerms<'py> {
    path: PathBuf,
    coordinates: Option<Bound<'py, PyAny>>,
    #[pyo3(item("where"))]
    filter: Option<String>,
    edge: Option<String>,
    value: Option<Vec<String>>,
    overlaps: Option<String>,
}

/// Features to be rasterized to a tree's cells.
pub(crate) struct Features {
    pub(crate) path: PathBuf,
    coordinates: Option<Coordinates>,
    options: ParsedOptions,
}

/// Parsed options.
struct ParsedOptions {
    filter: spinney::import::feature::FeatureFilter,
    edge: spinney::query::EdgeRule,
    overlaps: spinney::raw::import::rasterize::Overlaps,
    value: Option<FeatureValue>,
}

impl FeatureTerms<'_> {
    /// Parses the options.
    pub(crate) fn read(self) -> PyResult<Features> {
        let filter = self.filter.map(|text| text.parse()).transpose().or_raise()?.unwrap_or_default();
        let edge = self.edge.map(|text| text.parse()).transpose().or_raise()?.unwrap_or_default();
        let overlaps = self.overlaps.map(|text| text.parse()).transpose().or_raise()?.unwrap_or_default();
        let value = self.value.map(|strings| value_of(&strings)).transpose()?;
        let coordinates = self.coordinates.as_ref().map(coordinates_of).transpose()?;
        Ok(Features {
            path: self.path,
            coordinates,
            options: ParsedOptions { filter, edge, overlaps, value },
        })
    }
}

/// Returns the value of features: a number for each channel, or the name of an attribute.
fn value_of(strings: &[String]) -> PyResult<FeatureValue> {
    let numbers: Result<Vec<Number>, _> = strings.iter().map(|text| text.parse::<Number>()).collect();
    match (numbers, strings) {
        (Ok(numbers), [_]) => Ok(FeatureValue::Number(numbers[0])),
        (Ok(numbers), _) => Ok(FeatureValue::Samples(numbers)),
        (Err(_), [name]) => Ok(FeatureValue::Attribute(name.clone())),
        (Err(error), _) => Err(invalid(format!("value: {error}"))),
    }
}

impl Features {
    /// Rasterizes the features to the cells of a tree with this header and metadata.
    pub(crate) fn over(
        &self,
        header: &Header,
        metadata: &Metadata,
        memory: u64,
        work: &dyn Progress,
    ) -> spinney::Result<FeatureTree> {
        let mut options = RasterizeOptions::over(header, metadata, self.coordinates.clone())?;
        let full = || Number::from(if header.rule == Rule::Occupancy { 255u64 } else { 1 });
        options.value = self.options.value.clone().unwrap_or_else(|| FeatureValue::Number(full()));
        (options.edge, options.overlaps) = (self.options.edge, self.options.overlaps);
        options.features.filter = self.options.filter.clone();
        options.memory = memory;
        plan_features(std::slice::from_ref(&self.path), &options, work)?.tree(work)
    }
}

/// Returns the operand at an index: a tree, or features.
pub(crate) fn operand<'a>(
    place: usize,
    path: &Path,
    make: &'a dyn Fn(&Header, &Metadata) -> spinney::Result<spinney::raw::ops::ViewSource>,
) -> MadeOperand<'a> {
    MadeOperand { place, name: path.display().to_string(), make }
}

/// Returns whether a file's name is that of a feature file.
#[pyfunction]
#[pyo3(name = "is_feature_file")]
pub(crate) fn is_features(py: Python<'_>, path: PathBuf) -> bool {
    py.detach(|| spinney::raw::import::feature::is_feature_file(&path))
}
