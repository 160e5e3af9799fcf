//! Windows as image files, and legends.

use std::path::PathBuf;

use pyo3::prelude::*;
use spinney::export::{ArrayRequest, Detail, WindowRequest, export_array, export_window};
use spinney::raw::export::image::{Format, format_of};
use spinney::raw::export::{LegendFormat, export_legend};
use spinney::raw::style::StylePainter;
use spinney::style::Style;

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms};
use crate::numbers::PyNumber;
use crate::region::{at_level, level_of, region_of};
use crate::tree::Tree;

#[pymethods]
impl Tree {
    /// Writes a region as an image or array file. PNG of samples other than 8 and 16 bits is
    /// rendered in the tree's default style, or grey within `range`.
    #[allow(clippy::too_many_arguments)] // as in Python
    #[pyo3(name = "_write_window")]
    fn write_window(
        &self,
        py: Python<'_>,
        path: PathBuf,
        window: Option<&Bound<'_, PyAny>>,
        coordinates: Option<&Bound<'_, PyAny>>,
        level: Option<i64>,
        shape: Option<[u64; 2]>,
        exact: bool,
        nodata: Option<PyNumber>,
        range: Option<[f64; 2]>,
        style: Option<&str>,
        terms: Terms,
    ) -> PyResult<()> {
        let opened = self.get()?;
        let tree = &opened.tree;
        check_output(&[tree.name().to_path_buf()], &path)?;
        let format = format_of(&path);
        let known = "use .png, .webp, .tif, .exr, .npy, .nrrd or .raw";
        let format = format.ok_or_else(|| invalid(format!("{}: unknown format; {known}", path.display())))?;
        let part = region_of(tree, window, coordinates)?.unwrap_or(tree.header().extent_bounds());
        if opened.axes() == 3 && matches!(format, Format::Npy | Format::Nrrd | Format::Raw) && shape.is_none()
        {
            let level = level_of(tree, level)?;
            let mut request = ArrayRequest::new(at_level(tree, part, level), level);
            request.nodata = nodata.map(|number| number.0);
            return jobs::run(py, terms, |work| {
                export_array(tree, &request, work.create(&path)?, format, work)
            });
        }
        let detail = match shape {
            Some(_) if level.is_some() => {
                return Err(invalid("shape, level: got both, expected one of them"));
            }
            Some([rows, columns]) if exact => Detail::Exact(columns, rows),
            Some([rows, columns]) => Detail::Size(columns, rows),
            None => Detail::Level(level_of(tree, level)?),
        };
        let mut request = WindowRequest::new(part, detail);
        request.style = match (style, range) {
            (Some(_), Some(_)) => return Err(invalid("style, range: got both, expected one of them")),
            (Some(style), None) => Some(Style::given(style).or_raise()?),
            (None, range) => range.map(|range| Style::stretched(tree, range)),
        };
        request.nodata = nodata.map(|number| number.0);
        jobs::run(py, terms, |work| export_window(tree, &request, work.create(&path)?, format, work))
    }
    /// Writes the legend of a style, by default the tree's own.
    #[pyo3(name = "_write_legend")]
    fn write_legend(
        &self,
        py: Python<'_>,
        path: PathBuf,
        style: Option<&str>,
        scale: u8,
        terms: Terms,
    ) -> PyResult<()> {
        let opened = self.get()?;
        let tree = &opened.tree;
        check_output(&[tree.name().to_path_buf()], &path)?;
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        let format = LegendFormat::named(ending, scale)
            .ok_or_else(|| invalid(format!("{}: unknown format; use .png, .svg or .json", path.display())))?;
        let style = match style {
            Some(text) => Style::given(text).or_raise()?,
            None => Style::default_for(tree),
        };
        jobs::run(py, terms, |work| {
            let legend = StylePainter::new(&style, tree, work)?.legend(tree)?;
            tree.check_unchanged()?;
            export_legend(&legend, work.create(&path)?, format)
        })
    }
}
