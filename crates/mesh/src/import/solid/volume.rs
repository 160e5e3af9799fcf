//! Volume of the models' cells: the reference for exact models after their surface was repaired or
//! closed.

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
    /// Volume in cubes of the models' unit.
    pub(in crate::import) volume: f64,
    /// Maximum error of the volume.
    pub(in crate::import) error: f64,
}

/// Cells along the longest side.
const CELLS: u64 = 128;
/// Maximum error of coverage, per cell wall area of the surface. Coverage of closed surfaces is
/// rounded to bytes and may become 0; that of open surfaces is sampled and depends on how holes are
/// closed.
const CLOSED_ERROR: f64 = 1.0 / 128.0;
const OPEN_ERROR: f64 = 0.25;

/// Progress that passes cancellation on, and reports nothing.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// Chosen parts of models: the parts that count (`None` for all), the object of each part, and the
/// bounding box of the faces.
pub(in crate::import) struct ChosenParts {
    pub(in crate::import) some: Option<BTreeSet<u32>>,
    pub(in crate::import) objects: Vec<u32>,
    pub(in crate::import) bounds: [[f64; 3]; 2],
}

/// Volume of the cells of models, or of the chosen parts; `None` if the memory is insufficient.
///
/// # Errors
/// If the models cannot be read, or on cancellation. (The models may be lost then.)
pub(in crate::import) fn cell_volume(
    models: &mut Vec<Box<dyn Model>>,
    ChosenParts { some, objects, bounds }: ChosenParts,
    (up, crs): (Up, Option<Crs>),
    memory: u64,
    directory: &Path,
    progress: &dyn Progress,
) -> Result<Option<CellVolume>> {
    let mut options = SolidOptions::new();
    (options.resolution, options.edge) = (Resolution::Cells(CELLS), EdgeRule::Area);
    (options.up, options.crs, options.memory) = (up, crs, memory);
    let mut import = plan_in(std::mem::take(models), &options, bounds)?;
    (import.only, import.objects) = (some, Some(objects));
    let found = import.cell_volume(directory, &Quiet(progress));
    *models = import.models;
    match found {
        Ok(found) => Ok(Some(found)),
        Err(Error::TooLarge { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

impl SolidImport {
    fn cell_volume(&mut self, directory: &Path, progress: &dyn Progress) -> Result<CellVolume> {
        let mut read = self.read(&|_| true, directory, progress)?;
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
    /// Sum of cells, weighted by the fraction that is inside.
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
