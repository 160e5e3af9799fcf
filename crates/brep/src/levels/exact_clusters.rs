//! Clusters of the exact surface: its faces along a space-filling curve.

use std::ops::Range;
use std::path::Path;

use super::triangles::{TRIANGLE, Triangle};
use super::{CLUSTER_FACES, group};
use crate::closure::{Closure, Seed};
use crate::triangulated::FaceTriangulator;
use crate::{ExactModel, Faces, curve};
use spinney_base::io::Sorter;
use spinney_base::{Progress, Result};

/// Consecutive faces along the curve, triangulated.
#[derive(Default)]
pub(super) struct ExactCluster {
    /// The positions on the curve of its faces; no other face has one of these.
    pub(super) keys: Range<u64>,
    /// Number of its faces in the octree.
    pub(super) faces: u32,
    /// All triangles.
    pub(super) triangles: Vec<Triangle>,
    /// Those of faces without an area, which are not in the octree.
    pub(super) slivers: Vec<Triangle>,
}

/// Bytes of a sorted item: key, triangle, and flags.
const ITEM: usize = 8 + TRIANGLE + 1;
/// Flag: the triangle belongs to a face without an area.
const SLIVER: u8 = 1;
/// Flag: the triangle is the first of its face.
const FIRST: u8 = 2;

/// Sorts the triangles of a model along the curve. Also returns the object of each part: itself, or
/// [`group::OPEN`].
pub(super) fn sorted(
    model: &ExactModel,
    directory: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(Sorter, Vec<u32>)> {
    let parts = model.parts().len();
    let mut sorter = Sorter::new(directory, memory);
    let mut closures = vec![Closure::new(Seed::new()); parts];
    let mut triangulator = FaceTriangulator::default();
    let mut item = Vec::with_capacity(ITEM);
    model.each(&mut |face| {
        if face.number.is_multiple_of(1 << 12) {
            progress.check()?;
        }
        let (key, part) = (curve::position(face, model.grid().bits), face.part as usize);
        let mut flags = if face.has_area() { FIRST } else { SLIVER };
        closures[part].add(face);
        for triangle in triangulator.triangles(face) {
            let points = triangle.map(|corner| face.points[corner as usize]);
            let colours =
                triangle.map(|corner| face.colours.get(corner as usize).copied().unwrap_or_default());
            item.clear();
            item.extend_from_slice(&key.to_le_bytes());
            Triangle { points, colours, part: face.part }.write(&mut item);
            item.push(flags);
            flags &= !FIRST;
            sorter.push(key, &item)?;
        }
        Ok(())
    })?;
    let object = |(part, closure): (u32, &Closure)| if closure.is_closed() { part } else { group::OPEN };
    Ok((sorter, (0..).zip(&closures).map(object).collect()))
}

/// Divides sorted triangles into clusters, and passes these to a function.
pub(super) fn each_cluster(sorter: Sorter, each: &mut dyn FnMut(ExactCluster) -> Result<()>) -> Result<()> {
    // Triangles with their keys and flags that are in no cluster yet.
    let mut open: Vec<(u64, Triangle, u8)> = Vec::new();
    let mut first_key = 0;
    let mut finish = |triangles: &[(u64, Triangle, u8)], next_key: u64| {
        let mut cluster = ExactCluster { keys: first_key..next_key, ..ExactCluster::default() };
        for (_, triangle, flags) in triangles {
            cluster.faces += u32::from(flags & FIRST != 0);
            cluster.triangles.push(*triangle);
            cluster.slivers.extend((flags & SLIVER != 0).then_some(*triangle));
        }
        first_key = next_key;
        each(cluster)
    };
    sorter.finish(&mut |item| {
        let key = u64::from_le_bytes(item[..8].try_into().expect("eight bytes"));
        let is_cut = open.len() >= CLUSTER_FACES && open[open.len() - 1].0 != key;
        open.push((key, Triangle::read(&item[8..]), item[8 + TRIANGLE]));
        if is_cut {
            // Cut where the curve leaves the largest cell.
            let from = (CLUSTER_FACES / 4).max(1);
            let leaving = |at: &usize| (open[*at - 1].0 ^ open[*at].0).leading_zeros();
            let cut = (from..open.len()).rev().min_by_key(leaving).expect("at least two triangles");
            finish(&open[..cut], open[cut].0)?;
            open.drain(..cut);
        }
        Ok(())
    })?;
    if open.is_empty() { Ok(()) } else { finish(&open, 1 << 63) }
}
