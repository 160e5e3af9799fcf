//! The faces at each edge of a surface that need not fit into memory.

use super::spool::FaceSpool;
use crate::closure::{Seed, edges};
use spinney_base::io::{Sorter, Spool, SpooledWords, WordSpooler};
use spinney_base::{Progress, Result, sort};

/// The faces at each undirected edge, in a temporary file.
pub(super) struct EdgeFaces {
    /// Of each edge, the number of faces and their numbers.
    words: SpooledWords,
}

/// Bytes of an edge in the sorter: its key, its ends in ascending order, and its face.
const EDGE: usize = 8 + 24 + 4;

impl EdgeFaces {
    /// Sorts the edges of all faces, with about `memory` bytes of memory.
    ///
    /// # Errors
    /// If temporary files cannot be used, or on cancellation.
    pub(super) fn of(faces: &FaceSpool, memory: u64, progress: &dyn Progress) -> Result<EdgeFaces> {
        let mut sorter = Sorter::new(&faces.directory, memory);
        let seed = Seed::new();
        faces.each(progress, &mut |face, _| {
            for [from, to] in edges(face) {
                let (key, _) = seed.edge(from, to);
                let mut item = [0; EDGE];
                item[..8].copy_from_slice(&key.to_le_bytes());
                let ends = if from < to { [from, to] } else { [to, from] };
                for (bytes, at) in item[8..32].chunks_exact_mut(4).zip(ends.as_flattened()) {
                    bytes.copy_from_slice(&at.to_le_bytes());
                }
                item[32..].copy_from_slice(&(face.number as u32).to_le_bytes());
                sorter.push(key, &item)?;
            }
            Ok(())
        })?;
        let mut out = WordSpooler::new(&Spool::create(&faces.directory, 1)?);
        // Edges with the same key; almost always, they are the same edge.
        let mut same: Vec<([u8; 24], u32)> = Vec::new();
        let (mut last, mut count, mut words) = (None, 0u64, Vec::new());
        let mut settle = |same: &mut Vec<([u8; 24], u32)>| {
            sort::by(same, &mut |a, b| a.cmp(b));
            for edge in same.chunk_by(|a, b| a.0 == b.0) {
                words.clear();
                words.push(edge.len() as u32);
                words.extend(edge.iter().map(|(_, face)| *face));
                out.push(&words)?;
            }
            same.clear();
            Ok(())
        };
        sorter.finish(&mut |item| {
            count += 1;
            if count.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            let (key, rest) = item.split_at(8);
            let key: [u8; 8] = key.try_into().expect("eight bytes");
            if last != Some(key) {
                settle(&mut same)?;
                last = Some(key);
            }
            let (ends, face) = rest.split_at(24);
            let face = u32::from_le_bytes(face.try_into().expect("four bytes"));
            same.push((ends.try_into().expect("24 bytes"), face));
            Ok(())
        })?;
        settle(&mut same)?;
        Ok(EdgeFaces { words: out.finish()? })
    }

    /// Passes the faces at each edge to a function. A face that has the edge twice is there twice.
    ///
    /// # Errors
    /// If the temporary file cannot be read, those of the function, or on cancellation.
    pub(super) fn each(
        &self,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&[u32]) -> Result<()>,
    ) -> Result<()> {
        let (mut open, mut left) = (Vec::new(), 0);
        self.words.each(&mut |words| {
            progress.check()?;
            for &word in words {
                if left == 0 {
                    left = word;
                    open.clear();
                    continue;
                }
                open.push(word);
                left -= 1;
                if left == 0 {
                    each(&open)?;
                }
            }
            Ok(())
        })
    }
}
