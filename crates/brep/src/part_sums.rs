//! Sums over the faces of each part of a model, in bounded memory: volume, moments, area, bounds,
//! and whether the part is closed.

use std::collections::{HashMap, HashSet, hash_map::Entry};
use std::path::Path;

use crate::Face;
use crate::arrangement::ExactFace;
use crate::closure::EdgeHashes;
use crate::query::MassSums;
use crate::store::sums::{MAX_RECORD, StoredSums};
use spinney_base::Result;
use spinney_base::io::Sorter;

/// Sums over some faces of a part.
#[derive(Clone, Debug, Default)]
struct OpenSums {
    mass: MassSums,
    /// Sum of the edge hashes: 0 if the faces are closed.
    edges: u64,
}

/// Bytes of partial sums on disk: part, sum of edge hashes, and a padded record.
const ITEM: usize = 4 + 8 + MAX_RECORD;
/// Approximate bytes of a part's sums in memory.
const BYTES: u64 = 640;

impl OpenSums {
    fn add(&mut self, other: &OpenSums) {
        self.mass.add(&other.mass);
        self.edges = self.edges.wrapping_add(other.edges);
    }

    fn stored(&self) -> StoredSums {
        StoredSums { mass: self.mass.clone(), is_closed: self.edges == 0 }
    }

    fn to_item(&self, part: u32) -> Vec<u8> {
        let mut item = [&part.to_le_bytes()[..], &self.edges.to_le_bytes()].concat();
        item.extend(self.stored().to_bytes());
        item.resize(ITEM, 0);
        item
    }

    fn from_item(item: &[u8]) -> Option<(u32, OpenSums)> {
        let part = u32::from_le_bytes(item.get(..4)?.try_into().ok()?);
        let edges = u64::from_le_bytes(item.get(4..12)?.try_into().ok()?);
        let (StoredSums { mass, .. }, _) = StoredSums::read(item.get(12..)?)?;
        Some((part, OpenSums { mass, edges }))
    }
}

/// Sums over the faces of each part, which are added in any order.
pub(crate) struct SumsOfParts {
    hashes: EdgeHashes,
    /// Bits of the grid.
    bits: u8,
    open: HashMap<u32, OpenSums>,
    /// Partial sums, if those in memory had become too many.
    spilled: Option<Sorter>,
    /// Maximum number of parts in memory.
    most: usize,
    /// Parts to which faces were added, if they are recorded.
    touched: Option<HashSet<u32>>,
}

impl SumsOfParts {
    /// Creates empty sums that are held in memory, however many parts there are.
    pub(crate) fn in_memory(bits: u8) -> SumsOfParts {
        SumsOfParts {
            hashes: EdgeHashes::new(),
            bits,
            open: HashMap::new(),
            spilled: None,
            most: usize::MAX,
            touched: None,
        }
    }

    /// Creates empty sums that take about `memory` bytes, and temporary files for more.
    pub(crate) fn new(directory: &Path, bits: u8, memory: u64) -> SumsOfParts {
        let most = (memory / 2 / BYTES).max(64) as usize;
        SumsOfParts { spilled: Some(Sorter::new(directory, memory / 2)), most, ..Self::in_memory(bits) }
    }

    /// Records the parts to which faces are added from now on: see [`SumsOfParts::is_touched`].
    pub(crate) fn record_touched(&mut self) {
        self.touched = Some(HashSet::new());
    }

    /// Returns whether faces were added to a part since parts are recorded.
    pub(crate) fn is_touched(&self, part: u32) -> bool {
        self.touched.as_ref().is_some_and(|touched| touched.contains(&part))
    }

    /// Adds the sums over all faces of a part, to which no face is added. The closedness of the
    /// sums over all parts has no meaning after that.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub(crate) fn carry(&mut self, part: u32, stored: &StoredSums) -> Result<()> {
        // (Any number but 0 is the sum of the edges of an open part.)
        let edges = u64::from(!stored.is_closed);
        self.of(part)?.add(&OpenSums { mass: stored.mass.clone(), edges });
        Ok(())
    }

    /// Returns the number of parts in memory.
    pub(crate) fn len(&self) -> usize {
        self.open.len()
    }

    /// Adds a face of the octree.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub(crate) fn add(&mut self, face: &Face<'_>, is_proxy: bool) -> Result<()> {
        let edges = if is_proxy { 0 } else { self.hashes.of_face(face) };
        let bits = self.bits;
        let sums = self.touch(face.part)?;
        sums.edges = sums.edges.wrapping_add(edges);
        sums.mass.add_face(face);
        if is_proxy {
            sums.mass.remove_proxy(face, bits);
        }
        Ok(())
    }

    /// Adds a face with off-grid vertices.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub(crate) fn add_exact(&mut self, face: &ExactFace) -> Result<()> {
        let edges = self.hashes.of_exact(face);
        let bits = self.bits;
        let sums = self.touch(face.part)?;
        sums.edges = sums.edges.wrapping_add(edges);
        sums.mass.add_exact(face, bits);
        Ok(())
    }

    /// Returns the sums of a part, for an added face.
    fn touch(&mut self, part: u32) -> Result<&mut OpenSums> {
        if let Some(touched) = &mut self.touched {
            touched.insert(part);
        }
        self.of(part)
    }

    fn of(&mut self, part: u32) -> Result<&mut OpenSums> {
        if self.open.len() >= self.most
            && !self.open.contains_key(&part)
            && let Some(spilled) = &mut self.spilled
        {
            // (Sums are integers: the result does not depend on the order.)
            for (part, sums) in self.open.drain() {
                spilled.push(part.into(), &sums.to_item(part))?;
            }
        }
        Ok(match self.open.entry(part) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(OpenSums::default()),
        })
    }

    /// Passes the sums of all parts with faces to a function, by ascending part numbers; returns
    /// the sums over all faces.
    ///
    /// # Errors
    /// Those of the function; also if a temporary file cannot be read.
    pub(crate) fn finish(self, each: &mut dyn FnMut(u32, &StoredSums) -> Result<()>) -> Result<StoredSums> {
        let SumsOfParts { mut open, spilled, .. } = self;
        let mut total = OpenSums::default();
        let mut take = |part: u32, sums: &OpenSums| {
            total.add(sums);
            each(part, &sums.stored())
        };
        match spilled.filter(|spilled| !spilled.is_empty()) {
            None => {
                let mut parts: Vec<u32> = open.keys().copied().collect();
                parts.sort_unstable();
                for part in parts {
                    take(part, &open[&part])?;
                }
            }
            Some(mut spilled) => {
                for (part, sums) in open.drain() {
                    spilled.push(part.into(), &sums.to_item(part))?;
                }
                let mut last: Option<(u32, OpenSums)> = None;
                spilled.finish(&mut |item| {
                    let (part, sums) = OpenSums::from_item(item).unwrap_or_default();
                    match &mut last {
                        Some((before, all)) if *before == part => all.add(&sums),
                        _ => {
                            if let Some((part, sums)) = last.replace((part, sums)) {
                                take(part, &sums)?;
                            }
                        }
                    }
                    Ok(())
                })?;
                if let Some((part, sums)) = last {
                    take(part, &sums)?;
                }
            }
        }
        Ok(total.stored())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums that were spilled to disk are those in memory.
    #[test]
    fn spilled_sums_are_those_in_memory() {
        let directory = std::env::temp_dir();
        let mut sums = [SumsOfParts::in_memory(10), SumsOfParts::new(&directory, 10, 0)];
        for number in 0..3000 {
            let at = (number * 7919 % 1000) as i32;
            let points = [[at, 0, 5], [9, at, 0], [0, 3, at]];
            let part = number as u32 * 31 % 257;
            let face = Face { number, points: &points, ring_ends: &[3], colours: &[], part, source: 0 };
            sums.iter_mut().for_each(|sums| sums.add(&face, number % 5 == 0).unwrap());
        }
        assert!(sums[0].len() == 257 && sums[1].len() <= 64);
        let [expected, found] = sums.map(|sums| {
            let mut list = Vec::new();
            let total = sums.finish(&mut |part, sums| {
                list.push((part, sums.clone()));
                Ok(())
            });
            (total.unwrap(), list)
        });
        assert!(found.1.is_sorted_by_key(|(part, _)| *part) && found.0.mass.faces == 3000);
        assert_eq!(found, expected);
    }
}
