//! Measures of the single parts of a model, for models that are sets of objects.

use super::mass::MassProperties;
use crate::boxes::{Bounds, bounds_of, union};
use crate::part_sums::SumsOfParts;
use crate::store::sums::StoredSums;
use crate::{ExactModel, Faces};
use spinney_base::{Error, Progress, Result};
use std::collections::BTreeSet;

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

/// Approximate bytes of a part's sums.
const PART: u64 = 1 << 10;

impl ExactModel {
    /// Measures all parts that have faces, in the order of their numbers, from stored sums if the
    /// file has them. Otherwise reads all faces once; sums take about a kilobyte per part.
    ///
    /// # Errors
    /// If `memory` bytes are not enough, if the file cannot be read or is corrupt, or on
    /// cancellation.
    pub fn part_measures(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<PartMeasures>> {
        let check_memory = |count: usize| {
            let needed = count as u64 * PART;
            match needed <= memory {
                true => Ok(()),
                false => Err(Error::TooLarge {
                    path: self.path().to_path_buf(),
                    what: format!("computing the measures of {count} or more objects"),
                    needed,
                    limit: memory,
                    advice: "allow more with --memory".into(),
                }),
            }
        };
        let mut found = Vec::new();
        let mut take = |part: u32, sums: &StoredSums| {
            check_memory(found.len() + 1)?;
            if part.is_multiple_of(1024) {
                progress.check()?;
            }
            let measures = sums.mass.measures(self.grid());
            found.push(PartMeasures { part, is_closed: sums.is_closed, measures });
            Ok(())
        };
        if !self.each_part_sums(&mut take)? {
            self.sums_of_parts(&check_memory, progress)?.finish(&mut take)?;
        }
        Ok(found)
    }

    /// Returns the box around some parts in the world, from stored sums if the file has them.
    /// Otherwise reads all faces. `None` if the parts have no faces.
    ///
    /// # Errors
    /// If the file cannot be read or is corrupt, or on cancellation.
    pub fn bounds_of_parts(
        &self,
        parts: &BTreeSet<u32>,
        progress: &dyn Progress,
    ) -> Result<Option<[[f64; 3]; 2]>> {
        let mut all: Option<Bounds> = None;
        let mut add = |bounds: Bounds| all = Some(all.map_or(bounds, |all| union(all, &bounds)));
        let is_stored = self.each_part_sums(&mut |part, sums| {
            sums.mass.bounds.filter(|_| parts.contains(&part)).into_iter().for_each(&mut add);
            Ok(())
        })?;
        if !is_stored {
            self.each_face(&mut |face, _| {
                if parts.contains(&face.part) {
                    add(bounds_of(face.points, 0));
                }
                if face.number.is_multiple_of(1 << 12) { progress.check() } else { Ok(()) }
            })?;
        }
        Ok(all.map(|bounds| bounds.map(|corner| self.grid().to_world(corner))))
    }

    /// Computes the sums of all parts from their faces; `check_memory` gets the number of parts.
    fn sums_of_parts(
        &self,
        check_memory: &dyn Fn(usize) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<SumsOfParts> {
        let mut sums = SumsOfParts::in_memory(self.grid().bits);
        let mut read = 0u64;
        let mut check = |sums: &SumsOfParts| {
            read += 1;
            if read.is_multiple_of(1024) {
                progress.check()?;
                progress.advance(1024, self.len());
            }
            check_memory(sums.len())
        };
        self.each_face(&mut |face, is_proxy| {
            sums.add(face, is_proxy)?;
            check(&sums)
        })?;
        self.each_exact(&mut |face| {
            sums.add_exact(&face)?;
            check(&sums)
        })?;
        Ok(sums)
    }
}
