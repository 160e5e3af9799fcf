//! The volume that cells of models have inside: what exact models are compared with after their surface was repaired or closed.

use std::collections::BTreeSet;
use std::path::Path;

use super::plan::{Resolution, SolidImport, SolidOptions, plan_in};
use super::source::Solid;
use crate::import::Model;
use spinney_base::space::{EdgeRule, Up};
use spinney_base::{Error, Progress, Result};
use spinney_crs::Crs;
use spinney_engine::tree::{Child, Source, no_children};

/// Volume of the cells of models, by winding numbers.
#[derive(Clone, Copy, Debug)]
pub(in crate::import) struct CellVolume {
    /// In cubes of the models' unit.
    pub(in crate::import) volume: f64,
    /// How far that may be off.
    pub(in crate::import) error: f64,
}

/// Cells along the longest side.
const CELLS: u64 = 128;
/// How far the coverage of cells may be off, for each cell's side that the surface covers: of a closed surface it is rounded to bytes, and
/// may become 0; of an open one it is sampled, and depends on how holes are closed.
const CLOSED_ERROR: f64 = 1.0 / 128.0;
const OPEN_ERROR: f64 = 0.25;

/// Work that can be cancelled, and reports nothing.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// Parts of models: those that count, if these are not all, the object that each of all belongs to, and the box around their faces.
pub(in crate::import) struct ChosenParts {
    pub(in crate::import) some: Option<BTreeSet<u32>>,
    pub(in crate::import) objects: Vec<u32>,
    pub(in crate::import) bounds: [[f64; 3]; 2],
}

/// The volume of the cells of some models, or of some of their parts; `None` if the memory is not enough.
///
/// # Errors
/// If the models cannot be read, or on cancellation. (They are lost then.)
pub(in crate::import) fn cell_volume(
    models: &mut Vec<Box<dyn Model>>,
    ChosenParts { some, objects, bounds }: ChosenParts,
    (up, crs): (Up, Option<Crs>),
    memory: u64,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Option<CellVolume>> {
    let mut options = SolidOptions::new();
    (options.resolution, options.edge) = (Resolution::Cells(CELLS), EdgeRule::Area);
    (options.up, options.crs, options.memory) = (up, crs, memory);
    let mut import = plan_in(std::mem::take(models), &options, bounds)?;
    (import.only, import.objects) = (some, Some(objects));
    let found = import.cell_volume(folder, &Quiet(progress));
    *models = import.models;
    match found {
        Ok(found) => Ok(Some(found)),
        Err(Error::TooLarge { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

impl SolidImport {
    fn cell_volume(&mut self, folder: &Path, progress: &dyn Progress) -> Result<CellVolume> {
        let mut read = self.read(&|_| true, folder, progress)?;
        let is_closed = read.closure.is_closed();
        let mut area = 0.0;
        read.triangles.each(|_, triangle| {
            let normal = triangle.normal().map(|part| part as f64);
            area += normal.iter().map(|part| part * part).sum::<f64>().sqrt() / 2.0;
            Ok(())
        })?;
        let sides = area / f64::from(self.grid.cell()).powi(2);
        let decided = self.inside(&mut read, false, progress)?;
        let (form, _) = self.tree(&self.report(&read, &decided));
        let solid = self.solid(form, decided.surfaces, None, progress)?;
        let mut sum = CellSum { depth: self.grid.depth, share: 0.0 };
        sum.add(&solid, &solid.root()?, 0, progress)?;
        let cell = self.grid.frame.linear().determinant().abs();
        let error = if is_closed { CLOSED_ERROR } else { OPEN_ERROR };
        Ok(CellVolume { volume: sum.share * cell, error: sides * error * cell })
    }
}

struct CellSum {
    depth: u8,
    /// Cells, by how far they are inside.
    share: f64,
}

impl CellSum {
    fn add(
        &mut self,
        solid: &Solid<'_>,
        child: &Child<<Solid<'_> as Source>::Node>,
        level: u8,
        progress: &dyn Progress,
    ) -> Result<()> {
        match child {
            Child::Void => {}
            Child::Leaf(value) => {
                let value = value.to_bytes()[0];
                let cells = 8f64.powi(i32::from(self.depth - level));
                self.share += f64::from(value) / 255.0 * cells;
            }
            Child::Inner { node, .. } => {
                progress.check()?;
                let mut children = no_children();
                solid.children(node, &mut children)?;
                children.iter().try_for_each(|child| self.add(solid, child, level + 1, progress))?;
            }
        }
        Ok(())
    }
}
