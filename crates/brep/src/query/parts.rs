//! Measures of the single parts of a model, for models that are sets of objects.

use std::collections::BTreeMap;

use super::mass::{MassProperties, MassSums};
use crate::closure::{ExactClosure, Seed};
use crate::{ExactModel, Faces};
use spinney_base::{Error, Progress, Result};

/// Measures of a part.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PartMeasures {
    /// Number of the part: an index into [`Faces::parts`].
    pub part: u32,
    /// Whether its faces are closed by themselves. Otherwise, volume, centre and moments are
    /// meaningless.
    pub is_closed: bool,
    /// Its measures.
    pub measures: MassProperties,
}

/// Sums over the faces of a part.
struct Sums {
    mass: MassSums,
    /// Six times the volume of the faces with off-grid vertices, minus that of their proxies.
    off_grid_volume: f64,
    closure: ExactClosure,
}

/// Approximate bytes of a part's sums.
const PART: u64 = 1 << 10;

impl ExactModel {
    /// Measures all parts that have faces, in the order of their numbers. Reads all faces once;
    /// sums take about a kilobyte per part.
    ///
    /// # Errors
    /// If `memory` bytes are not enough, if the file cannot be read or is corrupt, or on
    /// cancellation.
    pub fn part_measures(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<PartMeasures>> {
        let seed = Seed::new();
        let mut sums: BTreeMap<u32, Sums> = BTreeMap::new();
        let mut read = 0u64;
        let mut sums_of = |part: u32, add: &mut dyn FnMut(&mut Sums)| -> Result<()> {
            read += 1;
            if read.is_multiple_of(1024) {
                progress.check()?;
                progress.advance(1024, self.len());
            }
            let (count, is_new) = (sums.len() as u64 + 1, !sums.contains_key(&part));
            if is_new && count * PART > memory {
                return Err(Error::TooLarge {
                    path: self.path().to_path_buf(),
                    what: format!("computing the measures of {count} or more objects"),
                    needed: count * PART,
                    limit: memory,
                    advice: "allow more with --memory".into(),
                });
            }
            let none =
                || Sums { mass: MassSums::new(), off_grid_volume: 0.0, closure: ExactClosure::new(seed) };
            add(sums.entry(part).or_insert_with(none));
            Ok(())
        };
        self.each_face(&mut |face, is_proxy| {
            sums_of(face.part, &mut |sums| {
                sums.mass.add_face(face);
                match is_proxy {
                    true => sums.off_grid_volume -= face.six_volumes() as f64,
                    false => sums.closure.add(face),
                }
            })
        })?;
        self.each_exact(&mut |face| {
            sums_of(face.part, &mut |sums| {
                sums.off_grid_volume += face.six_volumes();
                sums.closure.add_exact(&face);
            })
        })?;
        let grid = self.grid();
        let cube = grid.width().powi(3);
        let measures = sums.into_iter().map(|(part, Sums { mass, off_grid_volume, closure })| {
            let mut measures = mass.measures(grid);
            measures.volume += off_grid_volume / 6.0 * cube;
            PartMeasures { part, is_closed: closure.is_closed(), measures }
        });
        Ok(measures.collect())
    }
}
