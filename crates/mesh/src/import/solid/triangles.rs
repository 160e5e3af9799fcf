//! Lists of triangles: in memory, or in a temporary file if there are too many.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::grid::Triangle;
use spinney_base::Result;
use spinney_base::io::{Spool, SpooledWords, WordSpooler};

/// Words of a triangle: three vertices, the attribute and the part.
const WORDS: usize = 11;
/// Triangles of a region.
#[derive(Clone, Debug)]
pub(super) enum Triangles {
    /// Indices into a shared list in memory.
    InMemory(Arc<Vec<Triangle>>, Vec<u32>),
    /// Triangles in the temporary file.
    Spilled(Arc<Spilled>),
}

impl Triangles {
    pub(super) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Triangles::InMemory(_, picked) => picked.len(),
            Triangles::Spilled(spilled) => spilled.len(),
        }
    }

    /// Visits all triangles in order, with their indices in memory, or 0 if they are spilled.
    pub(super) fn each(&self, mut each: impl FnMut(u32, &Triangle) -> Result<()>) -> Result<()> {
        match self {
            Triangles::InMemory(all, picked) => {
                picked.iter().try_for_each(|number| each(*number, &all[*number as usize]))
            }
            Triangles::Spilled(spilled) => spilled.each(|triangle| each(0, triangle)),
        }
    }

    /// List in memory.
    pub(super) fn of(all: Vec<Triangle>) -> Triangles {
        let picked = (0..all.len() as u32).collect();
        Triangles::InMemory(Arc::new(all), picked)
    }

    /// Loads all triangles into memory, in order. The list must not have been sorted into octants.
    pub(super) fn all(&self) -> Result<Arc<Vec<Triangle>>> {
        match self.clone().held()? {
            Triangles::InMemory(all, _) => Ok(all),
            Triangles::Spilled(_) => unreachable!("they were taken to memory"),
        }
    }

    /// Keeps only the triangles that `is_kept` selects.
    pub(super) fn retain(&mut self, is_kept: &dyn Fn(&Triangle) -> bool) -> Result<()> {
        let mut kept = Vec::new();
        self.each(|_, triangle| {
            kept.extend(is_kept(triangle).then_some(*triangle));
            Ok(())
        })?;
        *self = Triangles::of(kept);
        Ok(())
    }

    /// Loads the triangles into memory, in order.
    pub(super) fn held(self) -> Result<Triangles> {
        let Triangles::Spilled(spilled) = self else { return Ok(self) };
        let mut all = Vec::with_capacity(spilled.len());
        spilled.each(|triangle| {
            all.push(*triangle);
            Ok(())
        })?;
        Ok(Triangles::of(all))
    }
}

/// List in a spool. Lists that it is divided into go to the same spool.
#[derive(Debug)]
pub(super) struct Spilled {
    spool: Arc<Spool>,
    words: SpooledWords,
}

impl Spilled {
    fn len(&self) -> usize {
        self.words.len() / WORDS
    }

    fn each(&self, mut each: impl FnMut(&Triangle) -> Result<()>) -> Result<()> {
        self.words
            .each(&mut |words| words.chunks_exact(WORDS).try_for_each(|triangle| each(&decode(triangle))))
    }
}

fn decode(words: &[u32]) -> Triangle {
    let corner = |corner: usize| std::array::from_fn(|axis| words[3 * corner + axis] as i32);
    Triangle { corners: std::array::from_fn(corner), attribute: words[9], part: words[10] }
}

/// Writes one list to a spool.
pub(super) struct TriangleSpill {
    spool: Arc<Spool>,
    words: WordSpooler,
}

impl TriangleSpill {
    pub(super) fn new(spool: &Arc<Spool>) -> TriangleSpill {
        TriangleSpill { spool: spool.clone(), words: WordSpooler::new(spool) }
    }

    pub(super) fn push(&mut self, triangle: &Triangle) -> Result<()> {
        let mut words = [0; WORDS];
        let corners = triangle.corners.as_flattened().iter().map(|at| *at as u32);
        let all = corners.chain([triangle.attribute, triangle.part]);
        words.iter_mut().zip(all).for_each(|(word, number)| *word = number);
        self.words.push(&words)
    }

    pub(super) fn finish(self) -> Result<Triangles> {
        Ok(Triangles::Spilled(Arc::new(Spilled { spool: self.spool, words: self.words.finish()? })))
    }
}

/// Collects triangles in memory up to a limit, and in a spool beyond it.
pub(super) struct Collector {
    limit: usize,
    directory: PathBuf,
    held: Vec<Triangle>,
    spill: Option<TriangleSpill>,
}

impl Collector {
    pub(super) fn new(limit: usize, directory: &Path) -> Collector {
        Collector { limit, directory: directory.to_path_buf(), held: Vec::new(), spill: None }
    }

    pub(super) fn push(&mut self, triangle: Triangle) -> Result<()> {
        if let Some(spill) = &mut self.spill {
            return spill.push(&triangle);
        }
        self.held.push(triangle);
        if self.held.len() > self.limit {
            let mut spill = TriangleSpill::new(&Spool::create(&self.directory, WORDS)?);
            std::mem::take(&mut self.held).iter().try_for_each(|triangle| spill.push(triangle))?;
            self.spill = Some(spill);
        }
        Ok(())
    }

    pub(super) fn finish(self) -> Result<Triangles> {
        match self.spill {
            Some(spill) => spill.finish(),
            None => Ok(Triangles::of(self.held)),
        }
    }
}

/// Sorts triangles into eight lists that are stored like the source list.
pub(super) enum OctantSorter {
    InMemory(Arc<Vec<Triangle>>, [Vec<u32>; 8]),
    Spilled(Vec<TriangleSpill>),
}

impl OctantSorter {
    pub(super) fn of(list: &Triangles) -> OctantSorter {
        match list {
            Triangles::InMemory(all, _) => OctantSorter::InMemory(all.clone(), Default::default()),
            Triangles::Spilled(spilled) => {
                OctantSorter::Spilled((0..8).map(|_| TriangleSpill::new(&spilled.spool)).collect())
            }
        }
    }

    #[inline]
    pub(super) fn push(&mut self, child: usize, number: u32, triangle: &Triangle) -> Result<()> {
        match self {
            OctantSorter::InMemory(_, picked) => {
                picked[child].push(number);
                Ok(())
            }
            OctantSorter::Spilled(spills) => spills[child].push(triangle),
        }
    }

    pub(super) fn finish(self) -> Result<Vec<Triangles>> {
        match self {
            OctantSorter::InMemory(all, picked) => {
                Ok(picked.into_iter().map(|picked| Triangles::InMemory(all.clone(), picked)).collect())
            }
            OctantSorter::Spilled(spills) => spills.into_iter().map(TriangleSpill::finish).collect(),
        }
    }
}
