//! Lists of triangles: in memory, or in a temporary file where there are too many.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::grid::Triangle;
use crate::io::platform::{read_exact_at, write_all_at};
use crate::{Error, Result};

/// Numbers of a triangle: three corners, the attribute and the part.
const WORDS: usize = 11;
/// Bytes of a triangle in the temporary file.
const BYTES: usize = 4 * WORDS;
/// Triangles that are written at a time.
const CHUNK: usize = 1024;

/// Triangles of a part of space.
#[derive(Clone, Debug)]
pub(super) enum Triangles {
    /// Some of those that lie in memory.
    Held(Arc<Vec<Triangle>>, Vec<u32>),
    /// In the temporary file.
    Spilled(Arc<Spilled>),
}

impl Triangles {
    pub(super) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Triangles::Held(_, picked) => picked.len(),
            Triangles::Spilled(spilled) => spilled.count,
        }
    }

    /// Hands out all of them, in order, with their numbers in memory where they have any.
    pub(super) fn each(&self, mut each: impl FnMut(u32, &Triangle) -> Result<()>) -> Result<()> {
        match self {
            Triangles::Held(all, picked) => {
                picked.iter().try_for_each(|number| each(*number, &all[*number as usize]))
            }
            Triangles::Spilled(spilled) => spilled.each(|triangle| each(0, triangle)),
        }
    }

    /// A list in memory.
    pub(super) fn of(all: Vec<Triangle>) -> Triangles {
        let picked = (0..all.len() as u32).collect();
        Triangles::Held(Arc::new(all), picked)
    }

    /// All of them in memory, in order, as long as nothing was sorted yet.
    pub(super) fn all(&self) -> Result<Arc<Vec<Triangle>>> {
        match self.clone().held()? {
            Triangles::Held(all, _) => Ok(all),
            Triangles::Spilled(_) => unreachable!("they were taken to memory"),
        }
    }

    /// Loads the triangles into memory, in their order.
    pub(super) fn held(self) -> Result<Triangles> {
        let Triangles::Spilled(spilled) = self else { return Ok(self) };
        let mut all = Vec::with_capacity(spilled.count);
        spilled.each(|triangle| {
            all.push(*triangle);
            Ok(())
        })?;
        Ok(Triangles::of(all))
    }
}

/// A temporary file of triangles, in chunks that are used again when their list is dropped.
#[derive(Debug)]
pub(super) struct Log {
    file: File,
    /// Folder of the file, for messages.
    folder: PathBuf,
    chunks: Mutex<Chunks>,
}

#[derive(Debug, Default)]
struct Chunks {
    free: Vec<u64>,
    used: u64,
}

impl Log {
    /// A log in a file without a name.
    pub(super) fn create(folder: &Path) -> Result<Arc<Log>> {
        let file = tempfile::tempfile_in(folder).map_err(Error::io(folder, "make a temporary file"))?;
        Ok(Arc::new(Log { file, folder: folder.to_path_buf(), chunks: Mutex::default() }))
    }

    fn take(&self) -> u64 {
        let mut chunks = self.chunks.lock().expect("nobody panics with this lock");
        chunks.free.pop().unwrap_or_else(|| {
            chunks.used += 1;
            chunks.used - 1
        })
    }
}

/// A list in a log.
#[derive(Debug)]
pub(super) struct Spilled {
    log: Arc<Log>,
    chunks: Vec<u64>,
    count: usize,
}

impl Spilled {
    fn each(&self, mut each: impl FnMut(&Triangle) -> Result<()>) -> Result<()> {
        let mut bytes = vec![0; CHUNK * BYTES];
        for (i, chunk) in self.chunks.iter().enumerate() {
            let here = (self.count - i * CHUNK).min(CHUNK) * BYTES;
            let read = read_exact_at(&self.log.file, &mut bytes[..here], chunk * (CHUNK * BYTES) as u64);
            read.map_err(Error::io(&self.log.folder, "read a temporary file"))?;
            for triangle in bytes[..here].chunks_exact(BYTES) {
                each(&decode(triangle))?;
            }
        }
        Ok(())
    }
}

impl Drop for Spilled {
    fn drop(&mut self) {
        if let Ok(mut chunks) = self.log.chunks.lock() {
            chunks.free.append(&mut self.chunks);
        }
    }
}

fn decode(bytes: &[u8]) -> Triangle {
    let mut words =
        bytes.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().expect("four bytes")));
    let mut next = || words.next().expect("eleven words");
    let corners = std::array::from_fn(|_| std::array::from_fn(|_| next() as i32));
    Triangle { corners, attribute: next(), part: next() }
}

/// Writes one list to a log.
pub(super) struct TriangleSpill {
    list: Spilled,
    buffer: Vec<u8>,
}

impl TriangleSpill {
    pub(super) fn new(log: &Arc<Log>) -> TriangleSpill {
        let list = Spilled { log: log.clone(), chunks: Vec::new(), count: 0 };
        TriangleSpill { list, buffer: Vec::new() }
    }

    pub(super) fn push(&mut self, triangle: &Triangle) -> Result<()> {
        let corners = triangle.corners.as_flattened().iter().map(|at| *at as u32);
        for word in corners.chain([triangle.attribute, triangle.part]) {
            self.buffer.extend_from_slice(&word.to_le_bytes());
        }
        self.list.count += 1;
        if self.buffer.len() == CHUNK * BYTES { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<()> {
        let log = &self.list.log;
        let chunk = log.take();
        self.list.chunks.push(chunk);
        let written = write_all_at(&log.file, &self.buffer, chunk * (CHUNK * BYTES) as u64);
        written.map_err(Error::io(&log.folder, "write a temporary file"))?;
        self.buffer.clear();
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<Triangles> {
        if !self.buffer.is_empty() {
            self.flush()?;
        }
        Ok(Triangles::Spilled(Arc::new(self.list)))
    }
}

/// Collects triangles, in memory up to a limit and in a log beyond it.
pub(super) struct Collector {
    limit: usize,
    folder: PathBuf,
    held: Vec<Triangle>,
    spill: Option<TriangleSpill>,
}

impl Collector {
    pub(super) fn new(limit: usize, folder: &Path) -> Collector {
        Collector { limit, folder: folder.to_path_buf(), held: Vec::new(), spill: None }
    }

    pub(super) fn push(&mut self, triangle: Triangle) -> Result<()> {
        if let Some(spill) = &mut self.spill {
            return spill.push(&triangle);
        }
        self.held.push(triangle);
        if self.held.len() > self.limit {
            let mut spill = TriangleSpill::new(&Log::create(&self.folder)?);
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

/// Sorts triangles into eight lists that lie where the list they come from lies.
pub(super) enum OctantSorter {
    Held(Arc<Vec<Triangle>>, [Vec<u32>; 8]),
    Spilled(Vec<TriangleSpill>),
}

impl OctantSorter {
    pub(super) fn of(list: &Triangles) -> OctantSorter {
        match list {
            Triangles::Held(all, _) => OctantSorter::Held(all.clone(), Default::default()),
            Triangles::Spilled(spilled) => {
                OctantSorter::Spilled((0..8).map(|_| TriangleSpill::new(&spilled.log)).collect())
            }
        }
    }

    #[inline]
    pub(super) fn push(&mut self, child: usize, number: u32, triangle: &Triangle) -> Result<()> {
        match self {
            OctantSorter::Held(_, picked) => {
                picked[child].push(number);
                Ok(())
            }
            OctantSorter::Spilled(spills) => spills[child].push(triangle),
        }
    }

    pub(super) fn finish(self) -> Result<Vec<Triangles>> {
        match self {
            OctantSorter::Held(all, picked) => {
                Ok(picked.into_iter().map(|picked| Triangles::Held(all.clone(), picked)).collect())
            }
            OctantSorter::Spilled(spills) => spills.into_iter().map(TriangleSpill::finish).collect(),
        }
    }
}
