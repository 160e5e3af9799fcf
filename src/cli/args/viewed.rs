//! Files, and views of them, as arguments.

use std::path::PathBuf;

use clap::Args;
use spinney::brep::Faces;
use spinney::raw::brep::ModelView;
use spinney::raw::ops::{Calculation, LayerInfo, WarpTarget};
use spinney::raw::store::FileReference;
use spinney::{Dataset, Progress, Rule, ViewOperation};

use super::super::{Global, exact, open};
use super::{LayerOption, parse_crs};

/// A tree file, and the operations of a view.
#[derive(Args, Clone, Debug)]
pub(crate) struct ViewedTree {
    /// Tree file
    pub(crate) file: PathBuf,
    /// View the file through an operation of `transform`, such as rotate=30; repeatable. (Exact
    /// models: affine maps for numeric queries; only translate= and scale= with one factor for the
    /// rest)
    #[arg(long = "view", value_name = "OPERATION", value_parser = parse_step)]
    steps: Vec<ViewOperation>,
    #[command(flatten)]
    layer: LayerOption,
}

impl ViewedTree {
    /// Whether there are operations.
    pub(crate) fn is_viewed(&self) -> bool {
        !self.steps.is_empty()
    }

    /// Returns the argument of `--layer`, unparsed.
    pub(crate) fn layer_text(&self) -> Option<&str> {
        self.layer.text()
    }

    /// Warns about an exact model of which a drawing shows nothing.
    pub(crate) fn warn_of_no_faces(&self, model: &dyn Faces, progress: &dyn Progress) {
        if model.is_empty() {
            progress.warn(&self.file, "the model has no faces, so nothing is drawn");
        }
    }

    /// Warns about an octree of which a drawing shows nothing. (Not with operations: all cells of
    /// the view would be read.)
    pub(crate) fn warn_of_no_cells(&self, tree: &Dataset, progress: &dyn Progress) -> spinney::Result<()> {
        if self.is_viewed() {
            return Ok(());
        }
        let totals = tree.statistics(None, progress)?;
        let is_solid = tree.header().rule == Rule::Occupancy;
        let fullest = totals.channels.first().map(|channel| channel.max.to_f64());
        if totals.cells == 0 {
            progress.warn(&self.file, "the tree is empty, so nothing is drawn");
        } else if let (true, Some(fullest)) = (is_solid, fullest.filter(|fullest| *fullest < 128.0)) {
            let text = format!(
                "no cell is at least half full (the fullest is {fullest} of 255), so no solid is drawn; smaller cells show it: build with another --cell"
            );
            progress.warn(&self.file, &text);
        }
        Ok(())
    }

    /// Opens the file, viewed through the operations, if it is an exact model.
    pub(crate) fn open_model(&self, global: &Global) -> anyhow::Result<Option<ModelView>> {
        exact::open_viewed(&self.file, &self.steps, global)
    }

    /// Describes layers and view. The string differs if layers or operations differ.
    pub(crate) fn steps_text(&self) -> String {
        let steps = if self.steps.is_empty() { String::new() } else { format!(", view {:?}", self.steps) };
        let several = self.layer.text().filter(|names| names.contains(','));
        let layer = several.map(|names| format!(", layers {names}"));
        layer.unwrap_or_default() + &steps
    }

    /// Whether the operations calculate one tree from all layers.
    fn is_calculated(&self) -> bool {
        !self.layer.is_given() && self.steps.iter().any(|step| matches!(step, ViewOperation::Calculation(_)))
    }

    /// Opens the only chosen layer, viewed through the operations.
    pub(crate) fn open(&self, global: &Global) -> anyhow::Result<Dataset> {
        let path =
            if self.is_calculated() { self.file.clone() } else { self.layer.path(&self.file, global)? };
        self.through(open(&path, global.access())?)
    }

    /// Opens the first of the chosen layers, however many there are.
    pub(crate) fn open_any_layer(&self, global: &Global) -> anyhow::Result<Dataset> {
        let layers = self.layer.paths(&self.file, global)?;
        self.through(open(layers.first().unwrap_or(&self.file), global.access())?)
    }

    /// Whether several layers are named, which become the channels of an image.
    pub(crate) fn is_composite(&self, global: &Global) -> spinney::Result<bool> {
        Ok(self.layer.is_given() && self.layer.paths(&self.file, global)?.len() > 1)
    }

    /// Opens one tree for drawing: the only layer, or the two to four named layers as its channels.
    pub(crate) fn open_drawn(&self, global: &Global) -> anyhow::Result<Dataset> {
        if !self.is_composite(global)? {
            return self.open(global);
        }
        let paths = self.layer.paths(&self.file, global)?;
        let file = open(&paths[0], global.access())?;
        let layers = file.layers()?;
        let info = |path: &PathBuf| {
            let number = FileReference::of(path).layer_number(layers.iter().map(|layer| &*layer.name))?;
            Ok(&layers[number])
        };
        let named: Vec<&LayerInfo> = paths.iter().map(info).collect::<spinney::Result<_>>()?;
        let names: Vec<String> = named.iter().map(|layer| layer.name.clone()).collect();
        // Use the cells of the layer with the smallest cells.
        let depth = named.iter().map(|layer| layer.header.depth()).max();
        let finest = named.iter().find(|layer| Some(layer.header.depth()) == depth).map(|layer| &layer.name);
        let composite = ViewOperation::Calculation(Box::new(Calculation::composite(&names)?));
        let steps: Vec<ViewOperation> = [composite].into_iter().chain(self.steps.iter().cloned()).collect();
        Ok(file.layer(finest.unwrap_or(&names[0]))?.view(&steps)?)
    }

    /// Opens all chosen layers, each viewed through the operations.
    pub(crate) fn open_all(&self, global: &Global) -> anyhow::Result<Vec<Dataset>> {
        if self.is_calculated() {
            return Ok(vec![self.open(global)?]);
        }
        let paths = self.layer.paths(&self.file, global)?;
        // (Open the file once, however many layers are chosen.)
        let first = open(&paths[0], global.access())?;
        let others = paths[1..].iter().map(|path| {
            let name = FileReference::of(path).layer.unwrap_or_default();
            self.through(first.layer(&name)?)
        });
        let others = others.collect::<anyhow::Result<Vec<Dataset>>>()?;
        let mut all = vec![self.through(first)?];
        all.extend(others);
        Ok(all)
    }

    fn through(&self, tree: Dataset) -> anyhow::Result<Dataset> {
        // (Queries of a file are faster than those of a view of it.)
        if self.steps.is_empty() { Ok(tree) } else { Ok(tree.view(&self.steps)?) }
    }
}

/// Parses a view operation. A coordinate system may be in a file.
pub(crate) fn parse_step(text: &str) -> Result<ViewOperation, String> {
    if let Some(definition) = text.strip_prefix("crs=") {
        return parse_crs(definition).map(ViewOperation::Crs);
    }
    if let Some(target) = text.strip_prefix("warp=") {
        let (definition, cell, resampling) = WarpTarget::split(target).map_err(|error| error.to_string())?;
        return parse_crs(definition).map(|crs| ViewOperation::Warp(WarpTarget { crs, cell, resampling }));
    }
    text.parse().map_err(|error: spinney::Error| error.to_string())
}
