//! The faces of a surface to repair, in memory or in a temporary file.

use std::collections::BTreeMap;
use std::path::Path;

use super::regions::repair_in_regions;
use super::spool::FaceSpooler;
use super::{InsideRule, Repair, repair, repair_bytes};
use crate::{ColumnValues, Face, FaceList, Faces, Grid, ModelBuilder};
use spinney_base::{Progress, Result};

/// Collects the faces of a closed surface, and repairs it.
pub struct RepairInput {
    memory: u64,
    storage: Storage,
}

enum Storage {
    /// Faces, with the values of their sources, and the bytes of these values.
    Memory {
        list: FaceList,
        values: BTreeMap<u64, ColumnValues>,
        bytes: u64,
    },
    File(FaceSpooler),
}

impl RepairInput {
    /// Creates an empty surface. Collecting the faces and their repair take about `memory` bytes.
    pub fn new(grid: Grid, memory: u64) -> RepairInput {
        let list = FaceList::new(grid, Vec::new());
        RepairInput { memory, storage: Storage::Memory { list, values: BTreeMap::new(), bytes: 0 } }
    }

    /// Adds a face with its values: column names, and JSON strings. Faces with the same source have
    /// the same values. Faces go to a temporary file in `directory` if the memory is not enough to
    /// repair them there.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub fn push(&mut self, face: &Face<'_>, values: &[(&str, &str)], directory: &Path) -> Result<()> {
        let (list, known, bytes) = match &mut self.storage {
            Storage::File(file) => return file.push(face, values),
            Storage::Memory { list, values, bytes } => (list, values, bytes),
        };
        list.push(face);
        if !values.is_empty() && !known.contains_key(&face.source) {
            // (Includes the overhead of the containers.)
            let of = |(column, json): &(&str, &str)| (column.len() + json.len() + 64) as u64;
            *bytes += values.iter().map(of).sum::<u64>();
            let own = values.iter().map(|(column, json)| (column.to_string(), json.to_string()));
            known.insert(face.source, own.collect());
        }
        if repair_bytes(list) + *bytes <= self.memory {
            return Ok(());
        }
        let mut file = FaceSpooler::new(list.grid().clone(), directory)?;
        list.each(&mut |face| {
            let values = known.get(&face.source).map_or(&[][..], Vec::as_slice);
            let values: Vec<(&str, &str)> =
                values.iter().map(|(column, json)| (&column[..], &json[..])).collect();
            file.push(face, &values)
        })?;
        self.storage = Storage::File(file);
        Ok(())
    }

    /// Adds the repaired surface to a model's builder, without faces that bound no solid. First,
    /// outermost components that are inside out are reversed, together with their contents. New
    /// vertices at intersections stay exact. `path` is the model's, for errors. Progress counts
    /// each face [`REPAIR_PASSES`](super::REPAIR_PASSES) times.
    ///
    /// Memory: a surface that fits is held in it, with about 600 bytes for each face. Otherwise,
    /// 600 bytes for each face that meets another in more than the common boundary of neighbours,
    /// or is near such a face; and 4 bytes for each other one. The result is the same body; the
    /// order of the faces differs.
    ///
    /// # Errors
    /// [`Error::NotASolid`](spinney_base::Error::NotASolid) if nothing is inside, or more than half
    /// of the surface or the volume would be lost. Also if the memory is not enough, if files
    /// cannot be written, or on cancellation.
    pub fn repair(
        self,
        rule: InsideRule,
        builder: ModelBuilder,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<(ModelBuilder, Repair)> {
        match self.storage {
            Storage::Memory { list, values, .. } => {
                repair((list, false), rule, builder.values_by_source(values), path, self.memory, progress)
            }
            Storage::File(file) => {
                repair_in_regions(&file.finish()?, rule, builder, path, self.memory, progress)
            }
        }
    }
}
