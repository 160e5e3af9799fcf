//! Arrays as layers: one tree, or several in one file, whole or in shards.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use spinney::raw::shards::{ArrayLayers, Job, plan_arrays};
use spinney::raw::store::{TreeTarget, depth_for};
use spinney::{Dimension, Progress};

use crate::build::{ArrayOptions, ArrayTree};
use crate::error::invalid;
use crate::jobs::{self, Terms, Work, access};
use crate::packing::Packing;

/// An array that becomes a layer.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ArrayLayer {
    /// Name of the layer; may be empty for an only layer.
    name: String,
    /// Function that returns blocks of the array: see [`crate::build::ArraySlabs`].
    read: Py<PyAny>,
    /// Number of levels that this layer has fewer than the finest one.
    coarser: u8,
    options: ArrayOptions,
}

/// Progress of one layer, added to that of all.
struct LayerWork<'w> {
    work: &'w Work,
    /// Cells of all layers.
    total: u64,
}

impl Progress for LayerWork<'_> {
    fn advance(&self, done: u64, total: u64) {
        self.work.advance(done, self.total.max(total));
    }

    fn warn(&self, file: &Path, text: &str) {
        self.work.warn(file, text);
    }

    fn interrupted(&self) -> bool {
        self.work.interrupted()
    }
}

/// Layers in one space, with parsed options.
struct PlannedLayers {
    dimension: Dimension,
    /// Levels of the finest layer.
    depth: u8,
    layers: Vec<(ArrayLayer, ArrayTree)>,
}

impl PlannedLayers {
    /// Plans layers, the finest of which have `depth` levels if that is given.
    fn new(layers: Vec<ArrayLayer>, depth: Option<u8>) -> PyResult<PlannedLayers> {
        let most = layers.iter().map(|layer| depth_for(layer.options.extent()) + layer.coarser).max();
        let depth = depth.or(most).unwrap_or(0);
        let mut plans = Vec::new();
        for layer in layers {
            let mut tree = layer.options.plan()?;
            tree.build.depth = depth.checked_sub(layer.coarser).ok_or_else(|| {
                invalid(format!(
                    "depth: got {depth}, but the cells of `{}` are 2^{} times as large",
                    layer.name, layer.coarser
                ))
            })?;
            tree.build.metadata.name.clone_from(&layer.name);
            plans.push((layer, tree));
        }
        let Some((_, first)) = plans.first() else {
            return Err(invalid("stack: got no layers, expected at least one"));
        };
        Ok(PlannedLayers { dimension: first.form.dimension, depth, layers: plans })
    }

    /// Returns the bytes of all cells.
    fn bytes(&self) -> u64 {
        let bytes = |(layer, tree): &(ArrayLayer, ArrayTree)| {
            let cells = layer.options.extent().iter().fold(1u64, |cells, along| cells.saturating_mul(*along));
            cells.saturating_mul(tree.form.value.size() as u64)
        };
        self.layers.iter().map(bytes).fold(0, u64::saturating_add)
    }

    /// Writes the layers, or the requested shard of them.
    fn write(&self, target: TreeTarget, work: &Work) -> spinney::Result<()> {
        let is_whole = target.whole().is_some();
        let cells = |(layer, _): &(ArrayLayer, ArrayTree)| layer.options.extent().iter().product::<u64>();
        let total = if is_whole { self.layers.iter().map(cells).fold(0, u64::saturating_add) } else { 0 };
        let mut file = target.start((self.dimension, self.depth), self.layers.len() as u32)?;
        let progress = LayerWork { work, total };
        for (layer, ArrayTree { form, nodata, build }) in &self.layers {
            match file.run() {
                None => file.write_layer_header(*form, layer.options.extent(), build)?,
                Some(run) => {
                    let mut slabs = layer.options.slabs(&layer.read, (*form, build.depth, run), work);
                    file.slabs(*form, &mut slabs, *nodata, build, &progress)?;
                }
            }
        }
        file.finish()
    }
}

/// Builds a file with a layer per array. There is at least one, all trees share one space, and the
/// finest have `depth` levels if that is given.
#[pyfunction]
#[pyo3(signature = (layers, out, depth, terms))]
pub(crate) fn build_layers(
    py: Python<'_>,
    layers: Vec<ArrayLayer>,
    out: PathBuf,
    depth: Option<u8>,
    terms: Terms,
) -> PyResult<()> {
    let layers = PlannedLayers::new(layers, depth)?;
    jobs::run(py, terms, |work| layers.write(work.create_tree(&out)?.into(), work))
}

/// Plans a job for such a file; returns whether the same job was there already.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as in Python
pub(crate) fn plan_layers(
    py: Python<'_>,
    layers: Vec<ArrayLayer>,
    job: PathBuf,
    depth: Option<u8>,
    token: String,
    packing: Packing,
    shards: Option<u32>,
    terms: Terms,
) -> PyResult<bool> {
    let layers = PlannedLayers::new(layers, depth)?;
    jobs::run(py, terms, |work| {
        let given = ArrayLayers { token: &token, packing: packing.0, bytes: layers.bytes() };
        Ok(plan_arrays(given, &job, shards, access(), &mut |target| layers.write(target, work))?.existed)
    })
}

/// Builds a shard of such a job unless it exists already; returns whether it was built, and the
/// bytes of its segments.
#[pyfunction]
pub(crate) fn build_layers_shard(
    py: Python<'_>,
    layers: Vec<ArrayLayer>,
    job: PathBuf,
    depth: Option<u8>,
    token: String,
    number: u32,
    terms: Terms,
) -> PyResult<(bool, u64)> {
    let layers = PlannedLayers::new(layers, depth)?;
    jobs::run(py, terms, |work| {
        let mut write = |target| layers.write(target, work);
        let built = Job::open_with(&job, access())?.build_arrays(number, &token, &mut write)?;
        Ok((built.existed, built.bytes))
    })
}
