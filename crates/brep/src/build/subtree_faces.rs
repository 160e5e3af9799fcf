//! Face lists of a subtree, in memory, or in a temporary file if they are too long.

use std::path::PathBuf;
use std::sync::Arc;

use spinney_base::Result;
use spinney_base::io::{Spool, SpooledWords, WordSpooler};

/// A face as words: number, vertex count, then, unless it is a triangle, ring count and ring ends,
/// then the coordinates.
#[derive(Clone, Copy)]
pub(super) struct FaceWords<'a>(pub(super) &'a [u32]);

/// Words of a triangle.
pub(super) const TRIANGLE_WORDS: usize = 11;

impl<'a> FaceWords<'a> {
    pub(super) fn number(self) -> u32 {
        self.0[0]
    }

    /// Returns the ends of the rings (`None` for a triangle), and the coordinates.
    fn parts(self) -> (Option<&'a [u32]>, &'a [u32]) {
        match self.0[1] {
            3 => (None, &self.0[2..]),
            _ => {
                let (ends, points) = self.0[3..].split_at(self.0[2] as usize);
                (Some(ends), points)
            }
        }
    }

    /// Returns the vertices of a triangle, or `None` for any other face.
    #[inline]
    pub(super) fn triangle(self) -> Option<[[i32; 3]; 3]> {
        let points: &[u32; 9] = self.0.get(2..TRIANGLE_WORDS).filter(|_| self.0[1] == 3)?.try_into().ok()?;
        Some(std::array::from_fn(|corner| std::array::from_fn(|axis| points[3 * corner + axis] as i32)))
    }

    /// Returns the vertices and ring ends of any face.
    pub(super) fn rings(self) -> (Vec<[i32; 3]>, Vec<usize>) {
        let (ends, points) = self.parts();
        let ends = ends.map_or(vec![3], |ends| ends.iter().map(|end| *end as usize).collect());
        (points.chunks_exact(3).map(|at| [at[0] as i32, at[1] as i32, at[2] as i32]).collect(), ends)
    }

    /// Appends the words of a face.
    pub(super) fn write(number: u32, points: &[[i32; 3]], ring_ends: &[usize], words: &mut Vec<u32>) {
        words.extend([number, points.len() as u32]);
        if points.len() != 3 {
            words.push(ring_ends.len() as u32);
            words.extend(ring_ends.iter().map(|end| *end as u32));
        }
        words.extend(points.as_flattened().iter().map(|at| *at as u32));
    }

    /// Returns the faces of a list.
    pub(super) fn all(words: &[u32]) -> impl Iterator<Item = FaceWords<'_>> {
        let mut rest = words;
        std::iter::from_fn(move || {
            let (face, after) = rest.split_at(FaceWords::length(rest)?);
            rest = after;
            Some(FaceWords(face))
        })
    }

    /// Returns the number of words of a list's first face, if the list has enough words to decide
    /// it.
    fn length(words: &[u32]) -> Option<usize> {
        let corners = *words.get(1)? as usize;
        if corners == 3 {
            return Some(TRIANGLE_WORDS);
        }
        Some(3 + *words.get(2)? as usize + 3 * corners)
    }
}

/// Faces of a subtree.
pub(super) enum SubtreeFaces {
    InMemory(Vec<u32>),
    Spooled(SpooledWords, usize),
}

impl SubtreeFaces {
    /// Returns the number of words.
    pub(super) fn len(&self) -> usize {
        match self {
            SubtreeFaces::InMemory(words) => words.len(),
            SubtreeFaces::Spooled(_, len) => *len,
        }
    }

    /// Loads the words of all faces in order.
    pub(super) fn into_words(self) -> Result<Vec<u32>> {
        match self {
            SubtreeFaces::InMemory(words) => Ok(words),
            SubtreeFaces::Spooled(list, len) => {
                let mut words = Vec::with_capacity(len);
                list.each(&mut |chunk| {
                    words.extend_from_slice(chunk);
                    Ok(())
                })?;
                Ok(words)
            }
        }
    }

    /// Visits all faces in order.
    pub(super) fn each(&self, mut each: impl FnMut(FaceWords<'_>) -> Result<()>) -> Result<()> {
        match self {
            SubtreeFaces::InMemory(words) => FaceWords::all(words).try_for_each(each),
            SubtreeFaces::Spooled(list, _) => {
                // The beginning of a face that ends in a later chunk.
                let mut open: Vec<u32> = Vec::new();
                list.each(&mut |chunk| {
                    let mut rest = chunk;
                    if !open.is_empty() {
                        while FaceWords::length(&open).is_none_or(|length| open.len() < length) {
                            let Some((first, after)) = rest.split_first() else { return Ok(()) };
                            let wanted = FaceWords::length(&open).map_or(1, |length| length - open.len());
                            let taken = wanted.min(rest.len());
                            if taken <= 1 {
                                open.push(*first);
                                rest = after;
                            } else {
                                open.extend_from_slice(&rest[..taken]);
                                rest = &rest[taken..];
                            }
                        }
                        each(FaceWords(&open))?;
                        open.clear();
                    }
                    while let Some(length) = FaceWords::length(rest).filter(|length| *length <= rest.len()) {
                        let (face, after) = rest.split_at(length);
                        each(FaceWords(face))?;
                        rest = after;
                    }
                    open.extend_from_slice(rest);
                    Ok(())
                })
            }
        }
    }
}

/// Collects a run: in memory up to a limit, then in a temporary file.
pub(super) struct SubtreeFacesBuilder {
    /// Maximum number of words in memory.
    limit: usize,
    target: SpoolTarget,
    buffer: Vec<u32>,
    spooler: Option<WordSpooler>,
    len: usize,
}

/// Destination of runs that exceed memory.
#[derive(Clone)]
pub(super) enum SpoolTarget {
    /// A new file in this directory.
    Directory(PathBuf),
    /// An existing file that runs share.
    Spool(Arc<Spool>),
}

impl SubtreeFacesBuilder {
    pub(super) fn new(limit: usize, target: SpoolTarget) -> SubtreeFacesBuilder {
        SubtreeFacesBuilder { limit, target, buffer: Vec::new(), spooler: None, len: 0 }
    }

    pub(super) fn push(&mut self, face: FaceWords<'_>) -> Result<()> {
        self.len += face.0.len();
        if let Some(spooler) = &mut self.spooler {
            return spooler.push(face.0);
        }
        self.buffer.extend_from_slice(face.0);
        if self.buffer.len() > self.limit {
            let spool = match &self.target {
                SpoolTarget::Directory(directory) => Spool::create(directory, TRIANGLE_WORDS)?,
                SpoolTarget::Spool(spool) => spool.clone(),
            };
            self.target = SpoolTarget::Spool(spool.clone());
            let mut spooler = WordSpooler::new(&spool);
            spooler.push(&std::mem::take(&mut self.buffer))?;
            self.spooler = Some(spooler);
        }
        Ok(())
    }

    /// Returns the run, and the destination of runs that are derived from it.
    pub(super) fn finish(self) -> Result<(SubtreeFaces, SpoolTarget)> {
        let run = match self.spooler {
            Some(spooler) => SubtreeFaces::Spooled(spooler.finish()?, self.len),
            None => SubtreeFaces::InMemory(self.buffer),
        };
        Ok((run, self.target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_come_back_from_memory_and_from_disk() {
        let mut words = Vec::new();
        for number in 0..20_000u32 {
            let corners = if number % 3 == 0 { 4 + number as usize % 90 } else { 3 };
            let points: Vec<[i32; 3]> = (0..corners as i32).map(|i| [number as i32, i, 7]).collect();
            let ends = if corners > 6 { vec![3, corners] } else { vec![corners] };
            FaceWords::write(number, &points, &ends, &mut words);
        }
        for limit in [usize::MAX, 1000] {
            let mut builder = SubtreeFacesBuilder::new(limit, SpoolTarget::Directory(std::env::temp_dir()));
            SubtreeFaces::InMemory(words.clone()).each(|face| builder.push(face)).unwrap();
            let (run, _) = builder.finish().unwrap();
            assert_eq!(run.len(), words.len());
            assert_eq!(matches!(run, SubtreeFaces::InMemory(_)), limit == usize::MAX);
            let mut again = Vec::new();
            run.each(|face| {
                let (points, ends) = face.rings();
                assert_eq!(face.triangle().is_some(), points.len() == 3);
                FaceWords::write(face.number(), &points, &ends, &mut again);
                Ok(())
            })
            .unwrap();
            assert!(again == words);
        }
    }
}
