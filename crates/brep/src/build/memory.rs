//! Defects of faces in memory, without a file.

use std::sync::Mutex;

use super::arena::Arena;
use super::cells::{Cell, CellBuilder};
use super::items::Items;
use super::near::NearFaces;
use super::spread::Spread;
use super::subtree_faces::{FaceWords, SpoolTarget, SubtreeFacesBuilder};
use super::{Defect, LEAF_SIZE};
use crate::face_check::{FaceCheck, FaceFlaw};
use crate::geometry::Stages;
use crate::{FaceList, Faces};
use spinney_base::{Error, Progress, Result};

/// Returns the first positions where the surface bounds no solid, the same as a build finds.
///
/// # Errors
/// If a face is invalid, or on cancellation.
pub(crate) fn defects_of(faces: &FaceList, progress: &dyn Progress) -> Result<Vec<Defect>> {
    let grid = faces.grid();
    let mut check = FaceCheck::new(grid.bits);
    let mut run = SubtreeFacesBuilder::new(usize::MAX, SpoolTarget::Directory(std::env::temp_dir()));
    let mut words = Vec::new();
    faces.each(&mut |face| {
        let has_area = check.has_area(face).map_err(|FaceFlaw { found, expected }| {
            Error::invalid(format!("face {}", face.number), found, expected)
        })?;
        if has_area {
            words.clear();
            FaceWords::write(face.number as u32, face.points, face.ring_ends, &mut words);
            run.push(FaceWords(&words))?;
        }
        Ok(())
    })?;
    let items = Items::of(run.finish()?.0)?;
    let (near, stages) = (NearFaces::new(1), Mutex::new(Stages::default()));
    let cell_builder = CellBuilder {
        items: &items,
        near: &near,
        bits: grid.bits,
        depth: grid.depth(),
        leaf_size: LEAF_SIZE,
        finds_folds: false,
        stages: &stages,
        progress,
    };
    let root = Cell { level: 0, position: [0; 3], winding: 0 };
    let all: Vec<u32> = (0..items.len() as u32).collect();
    let spread = Spread::new(all.len() as u64, LEAF_SIZE);
    let mut arena = Arena::default();
    cell_builder.cell(&root, all, (&[], spread), &mut arena)?;
    Ok(arena.defects.list.into_iter().map(|found| found.in_world(grid)).collect())
}
