//! Trees built from trees: the same cells, optionally with other properties.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use spinney::raw::store::file_is_tree;
use spinney::raw::value::Palette;
use spinney::{BuildOptions, Crs, DataKind};

use crate::build::matrix_of;
use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms, access};
use crate::numbers::{PyNumber, names_of};
use crate::packing::Packing;
use crate::tree::Tree;

/// Properties of a tree that are replaced; all others are kept.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct TreeOptions {
    kind: Option<String>,
    rule: Option<String>,
    depth: Option<u8>,
    transform: Option<Vec<f64>>,
    crs: Option<String>,
    categories: Option<BTreeMap<PyNumber, String>>,
    colormap: Option<Vec<[u8; 4]>>,
    descriptions: Option<Vec<String>>,
    scale_offset: Option<Vec<(f64, f64)>>,
    units: Option<Vec<String>>,
    tags: BTreeMap<String, String>,
    memory: u64,
    share: bool,
    packing: Packing,
    time: Option<i64>,
}

impl TreeOptions {
    fn apply(self, options: &mut BuildOptions, tree: &Path) -> PyResult<()> {
        if let Some(kind) = self.kind {
            let kind: DataKind = kind.parse().or_raise()?;
            if kind != options.kind {
                (options.kind, options.rule) = (kind, kind.default_rule());
            }
        }
        if let Some(rule) = self.rule {
            options.rule = rule.parse().or_raise()?;
            options.kind.check_rule(options.rule, tree).or_raise()?;
        }
        options.depth = self.depth.unwrap_or(options.depth);
        (options.share, options.time) = (self.share, self.time);
        options.packing = self.packing.0;
        let metadata = &mut options.metadata;
        if let Some(numbers) = self.transform {
            metadata.frame.matrix = matrix_of(&numbers)?;
        }
        if let Some(crs) = self.crs {
            metadata.frame.crs = Some(Crs::parse(&crs).or_raise()?);
        }
        if let Some(colours) = self.colormap {
            metadata.palette = Some(Palette { colours });
        }
        if let Some(names) = &self.categories {
            metadata.class_names = names_of(names);
        }
        metadata.band_names = self.descriptions.unwrap_or(std::mem::take(&mut metadata.band_names));
        metadata.scale_offset = self.scale_offset.unwrap_or(std::mem::take(&mut metadata.scale_offset));
        metadata.units = self.units.unwrap_or(std::mem::take(&mut metadata.units));
        metadata.tags.extend(self.tags);
        Ok(())
    }
}

#[pymethods]
impl Tree {
    /// Builds a tree with the same cells; a view's cells are those after its operations.
    #[pyo3(name = "_build")]
    fn build(&self, py: Python<'_>, out: PathBuf, options: TreeOptions, terms: Terms) -> PyResult<()> {
        let opened = self.get()?;
        let tree = &opened.tree;
        check_output(&[tree.name().to_path_buf()], &out)?;
        let mut build = tree.build_options(options.memory);
        if let Some(line) = self.steps_text() {
            build.metadata.provenance.push(line);
        }
        if opened.axes() == 2 && options.transform.as_ref().is_some_and(|numbers| numbers.len() != 6) {
            return Err(invalid("transform: got a matrix, expected six numbers for a quadtree"));
        }
        options.apply(&mut build, tree.name())?;
        jobs::run(py, terms, |work| tree.build(&build, work.create_tree(&out)?, work))
    }
}

/// Returns whether a file, or a commit of one, is a tree of cells.
#[pyfunction]
#[pyo3(name = "is_tree")]
pub(crate) fn is_tree(py: Python<'_>, path: PathBuf) -> PyResult<bool> {
    py.detach(|| file_is_tree(&path, access())).or_raise()
}
