//! Stacks of arrays: each is a layer of one file.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use spinney::Progress;
use spinney::store::{TreeWriter, depth_for};

use crate::build::{ArrayOptions, ArrayTree};
use crate::error::invalid;
use crate::jobs::{self, Terms, Work};

/// An array that becomes a layer.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ArrayLayer {
    name: String,
    /// A function that hands out its blocks: see [`crate::build::ArraySlabs`].
    read: Py<PyAny>,
    /// Levels that its tree has less than one of the finest cells.
    coarser: u8,
    options: ArrayOptions,
}

/// A layer of a stack: what its progress adds to that of all.
struct LayerWork<'w> {
    work: &'w Work,
    /// Cells of all layers.
    total: u64,
}

impl Progress for LayerWork<'_> {
    fn advance(&self, done: u64, _: u64) {
        self.work.advance(done, self.total);
    }

    fn warn(&self, file: &Path, text: &str) {
        self.work.warn(file, text);
    }

    fn interrupted(&self) -> bool {
        self.work.interrupted()
    }
}

/// Builds a file of arrays, each of which is a layer: one at least, of trees of one space whose finest have `depth` levels, if that is said.
#[pyfunction]
#[pyo3(signature = (layers, out, depth, terms))]
pub(crate) fn build_layers(
    py: Python<'_>,
    layers: Vec<ArrayLayer>,
    out: PathBuf,
    depth: Option<u8>,
    terms: Terms,
) -> PyResult<()> {
    let most = layers.iter().map(|layer| depth_for(layer.options.extent()) + layer.coarser).max();
    let depth = depth.or(most).unwrap_or(0);
    let cells = |layer: &ArrayLayer| layer.options.extent().iter().product::<u64>();
    let total = layers.iter().map(cells).fold(0, u64::saturating_add);
    let mut plans = Vec::new();
    for layer in layers {
        let ArrayTree { form, nodata, mut build } = layer.options.plan()?;
        build.depth = depth.checked_sub(layer.coarser).ok_or_else(|| {
            invalid(format!(
                "depth: {depth}, the cells of `{}` are 2^{} times as large",
                layer.name, layer.coarser
            ))
        })?;
        build.metadata.name.clone_from(&layer.name);
        plans.push((layer, ArrayTree { form, nodata, build }));
    }
    let Some(dimension) = plans.first().map(|(_, plan)| plan.form.dimension) else {
        return Err(invalid("a stack without layers"));
    };
    jobs::run(py, terms, move |work| {
        let mut file = TreeWriter::create(work.create_tree(&out)?, (dimension, depth), plans.len() as u32)?;
        let progress = LayerWork { work, total };
        for (layer, ArrayTree { form, nodata, build }) in plans {
            let mut slabs = layer.options.slabs(layer.read, form, work);
            file.slabs(form, &mut slabs, nodata, &build, &progress)?;
        }
        file.finish()
    })
}
