//! Rays from many sample points through a surface, in one pass over its faces.
//!
//! A set operation follows a ray through an octree. A surface that is repaired has none yet. So
//! samples are collected, and all faces pass them once.

use std::cell::RefCell;
use std::collections::HashMap;
use std::hash::{BuildHasher, RandomState};
use std::sync::Mutex;

use super::spool::FaceSpool;
use crate::arrangement::{SamplePoint, StoredSample};
use crate::boxes::{Bounds, BoxTree, bounds_of, touch};
use crate::{Face, FaceList, Faces};
use spinney_base::{Progress, Result, parallel, sort};

/// A face that contains a sample or is above it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Index of the sample.
    pub(super) sample: u32,
    pub(super) face: u32,
    /// Orientation of the face along the sample's axis: 1 or -1.
    pub(super) up: i32,
    /// Whether the face contains the sample.
    pub(super) is_at: bool,
}

/// Samples, in a tree for each axis of their rays.
struct Rays<'a> {
    samples: &'a [StoredSample],
    trees: [BoxTree; 3],
}

/// Returns the projection of a box along an axis.
fn projected([low, high]: Bounds, axis: usize) -> Bounds {
    [low, high].map(|mut corner| {
        corner[axis] = 0;
        corner
    })
}

impl Rays<'_> {
    fn of(samples: &[StoredSample]) -> Rays<'_> {
        let trees = [0, 1, 2].map(|axis| {
            let boxes = (0..).zip(samples).map(|(number, sample)| (number, sample.point()));
            let boxes = boxes.filter(|(_, point)| point.axis == axis).map(|(number, point)| {
                // (Larger than the error of approximations.)
                let corners = [-1.0, 1.0].map(|more| point.near.map(|at| (at + more).floor() as i32));
                (number, projected(bounds_of(&corners, 0), axis))
            });
            BoxTree::of(boxes.collect())
        });
        Rays { samples, trees }
    }

    /// Appends the samples that a face contains, or is above.
    fn meet(&self, number: u32, face: &Face<'_>, hits: &mut Vec<Hit>) {
        let bounds = bounds_of(face.points, 1);
        let mut plane = None;
        for axis in 0..3 {
            let own = projected(bounds, axis);
            self.trees[axis].each(&|bounds| touch(bounds, &own), |sample| {
                let point = self.samples[sample as usize].point();
                if point.near[axis] > f64::from(bounds[1][axis]) {
                    return;
                }
                let Some(plane) = plane.get_or_insert_with(|| face.plane()) else { return };
                let up = plane.normal[axis].signum() as i32;
                if up == 0 || !point.meets(face.points, face.ring_ends) {
                    return;
                }
                let side = point.side(plane) * up;
                if side <= 0 {
                    hits.push(Hit { sample, face: number, up, is_at: side == 0 });
                }
            });
        }
    }
}

/// Passes all hits of samples and faces to a function, in the order of the faces.
///
/// # Errors
/// If the faces cannot be read, or on cancellation.
pub(super) fn cast(
    faces: &FaceSpool,
    samples: &[StoredSample],
    progress: &dyn Progress,
    each: &mut dyn FnMut(Hit),
) -> Result<()> {
    /// Faces in memory, and faces of a task.
    const BATCH: u64 = 1 << 14;
    const TASK: usize = 1 << 10;
    let rays = Rays::of(samples);
    let empty = || FaceList::new(faces.grid.clone(), Vec::new());
    let batch = RefCell::new((0u32, empty()));
    let mut settle = || {
        let (first, list) = batch.replace((0, empty()));
        let starts: Vec<usize> = (0..list.len() as usize).step_by(TASK).collect();
        let found = parallel::map(&starts, |start| {
            let mut hits = Vec::new();
            for index in *start..(start + TASK).min(list.len() as usize) {
                rays.meet(first + index as u32, &list.get(index), &mut hits);
            }
            sort::by_key(&mut hits, |hit| u64::from(hit.face) << 32 | u64::from(hit.sample));
            hits
        });
        found.into_iter().flatten().for_each(&mut *each);
    };
    faces.each(progress, &mut |face, _| {
        let is_full = {
            let (first, list) = &mut *batch.borrow_mut();
            if list.is_empty() {
                *first = face.number as u32;
            }
            list.push(face);
            list.len() == BATCH
        };
        if is_full {
            settle();
        }
        Ok(())
    })?;
    settle();
    Ok(())
}

/// Changes of winding numbers above samples, which are known after a pass over all faces.
///
/// Work that needs such changes is run, and run again: samples that are not known yet are recorded,
/// and count as 0. The results of a run count only if nothing was recorded.
pub(super) struct Changes {
    hashers: [RandomState; 2],
    known: HashMap<u128, i32>,
    wanted: Mutex<Vec<(u128, StoredSample)>>,
    /// Maximum number of recorded samples per run.
    most: usize,
}

/// Bytes of a recorded sample, in lists and trees.
const SAMPLE: u64 = size_of::<(u128, StoredSample)>() as u64 * 2 + 64;

impl Changes {
    /// Uses about `memory` bytes for recorded samples.
    pub(super) fn new(memory: u64) -> Changes {
        let most = (memory / SAMPLE).max(1 << 10) as usize;
        let hashers = [RandomState::new(), RandomState::new()];
        Changes { hashers, known: HashMap::new(), wanted: Mutex::default(), most }
    }

    /// Returns the change above a sample; 0 if it is recorded.
    pub(super) fn above(&self, sample: &SamplePoint<'_>) -> i32 {
        let [high, low] = self.hashers.each_ref().map(|state| {
            let mut hasher = state.build_hasher();
            sample.hash(&mut hasher);
            std::hash::Hasher::finish(&hasher)
        });
        let key = u128::from(high) << 64 | u128::from(low);
        self.known.get(&key).copied().unwrap_or_else(|| {
            let mut wanted = self.wanted.lock().expect("no thread panics while it holds this lock");
            if wanted.len() < self.most {
                wanted.push((key, sample.stored()));
            }
            0
        })
    }

    /// Runs work until it needs no more samples. `weight` is how often a face counts.
    ///
    /// # Errors
    /// Those of the last run; if the faces cannot be read; or on cancellation.
    pub(super) fn settle<R>(
        &mut self,
        faces: &FaceSpool,
        weight: &mut dyn FnMut(u32) -> i32,
        progress: &dyn Progress,
        run: &dyn Fn(&Changes) -> Result<R>,
    ) -> Result<R> {
        loop {
            let found = run(self);
            let wanted = std::mem::take(&mut self.wanted)
                .into_inner()
                .expect("no thread panics while it holds this lock");
            if wanted.is_empty() {
                return found;
            }
            drop(found);
            progress.check()?;
            let (keys, samples): (Vec<u128>, Vec<StoredSample>) = wanted.into_iter().unzip();
            let mut sums = vec![0; samples.len()];
            cast(faces, &samples, progress, &mut |hit| {
                if !hit.is_at {
                    sums[hit.sample as usize] += hit.up * weight(hit.face);
                }
            })?;
            self.known.extend(keys.into_iter().zip(sums));
        }
    }
}
