//! Pairs of faces that intersect or touch, of a surface that need not fit into memory.
//!
//! Faces are sorted along the longest axis of the surface. A plane sweeps along this axis, a slab
//! of faces at a time. A slab consists of new faces, and of earlier ones that reach into it.

use std::path::Path;

use super::spool::FaceSpool;
use crate::arrangement::{ExactFaces, FACE, Operands, contacts_of};
use crate::boxes::bounds_of;
use crate::exact::normal::ring_normal;
use crate::face_order::{StoredFace, write_face};
use crate::face_set::FaceSet;
use crate::{FaceList, Faces};
use spinney_base::io::Sorter;
use spinney_base::{Error, Progress, Result};

/// Faces with contacts: more in common with another face than neighbours have.
pub(super) struct Touching {
    pub(super) set: FaceSet,
    /// The contacts.
    pub(super) pairs: Vec<[u32; 2]>,
}

/// Faces that the plane sweeps over.
struct Slab {
    list: FaceList,
    numbers: Vec<u32>,
    /// Faces of earlier slabs, which come first.
    earlier: usize,
}

impl Slab {
    fn bytes(&self) -> u64 {
        self.list.len() * (FACE + 5) + self.list.bytes()
    }

    /// Passes the pairs with a new face to `each`.
    fn pairs(
        self,
        path: &Path,
        memory: u64,
        progress: &dyn Progress,
        each: &mut dyn FnMut([u32; 2]) -> Result<()>,
    ) -> Result<Slab> {
        let Slab { list, numbers, earlier } = self;
        let count = list.len() as u32;
        let changed: Vec<bool> = (0..numbers.len()).map(|index| index >= earlier).collect();
        let operands = Operands {
            ends: &[count],
            far: &[0],
            changed: &changed,
            unites_equal_faces: true,
            ..Operands::NONE
        };
        let faces = ExactFaces::of_grid(list);
        for contact in contacts_of(&faces, &operands, path, memory, progress)? {
            each(contact.faces.map(|face| numbers[face as usize]))?;
        }
        Ok(Slab { list: faces.list, numbers, earlier })
    }

    /// Keeps the faces that reach to a coordinate along an axis.
    fn carried(self, axis: usize, to: i32) -> Slab {
        let mut next = Slab {
            list: FaceList::new(self.list.grid().clone(), Vec::new()),
            numbers: Vec::new(),
            earlier: 0,
        };
        for (index, number) in self.numbers.iter().enumerate() {
            let face = self.list.get(index);
            if bounds_of(face.points, 0)[1][axis] >= to {
                next.list.push(&face);
                next.numbers.push(*number);
            }
        }
        next.earlier = next.numbers.len();
        next
    }
}

/// Finds the faces with contacts. There may be at most `most` contacts. Progress counts faces.
///
/// # Errors
/// If there are too many contacts, if a slab or the contacts exceed `memory`, if temporary files
/// cannot be used, or on cancellation.
pub(super) fn touching(
    faces: &FaceSpool,
    most: u64,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Touching> {
    let [low, high] = faces.bounds;
    let axis = (0..3).rev().max_by_key(|axis| high[*axis].abs_diff(low[*axis])).unwrap_or(0);
    let mut sorter = Sorter::new(&faces.directory, memory / 4);
    let mut item = Vec::new();
    faces.each(progress, &mut |face, _| {
        if ring_normal(face.rings().next().unwrap_or_default()) == [0; 3] {
            return Ok(());
        }
        item.clear();
        write_face(face, &[], &mut item);
        let start = face.points.iter().map(|point| point[axis]).min().unwrap_or_default();
        sorter.push(start.max(0) as u64, &item)
    })?;
    let mut found = Touching { set: FaceSet::new(faces.len), pairs: Vec::new() };
    let mut add = |pair: [u32; 2]| {
        pair.iter().for_each(|face| found.set.set((*face).into(), true));
        found.pairs.push(pair);
        let bytes = size_of_val(&found.pairs[..]) as u64;
        if found.pairs.len() as u64 > most {
            return Err(super::refused(
                path,
                format!("its {} faces meet in more than {most} pairs, so the inside is ambiguous", faces.len),
                "remove the overlapping faces, or build cells of it (without --brep)",
            ));
        }
        if bytes > memory / 8 {
            Err(too_large(path, "the pairs of faces that meet", bytes, memory))
        } else {
            Ok(())
        }
    };
    let empty = FaceList::new(faces.grid.clone(), Vec::new());
    let mut slab = Some(Slab { list: empty, numbers: Vec::new(), earlier: 0 });
    let (mut face, mut done) = (StoredFace::default(), 0);
    sorter.finish(&mut |item| {
        face.read(item);
        let face = face.face();
        let mut open = slab.take().expect("it is put back");
        if open.bytes() > memory / 4 {
            progress.advance(open.list.len() - open.earlier as u64, faces.len);
            done += open.list.len() - open.earlier as u64;
            let start = face.points.iter().map(|point| point[axis]).min().unwrap_or_default();
            open = open.pairs(path, memory / 2, progress, &mut add)?.carried(axis, start);
            let (bytes, limit) = (open.bytes(), memory / 4);
            if bytes > limit / 4 * 3 {
                let what =
                    "dividing the surface, many of whose faces are side by side along its longest axis,";
                return Err(too_large(path, what, 4 * bytes, memory));
            }
        }
        open.list.push(&face);
        open.numbers.push(face.number as u32);
        slab = Some(open);
        Ok(())
    })?;
    if let Some(open) = slab {
        open.pairs(path, memory / 2, progress, &mut add)?;
    }
    progress.advance(faces.len - done, faces.len);
    Ok(found)
}

pub(super) fn too_large(path: &Path, what: &str, needed: u64, limit: u64) -> Error {
    let advice = "allow more with --memory".into();
    Error::TooLarge { path: path.to_path_buf(), what: what.into(), needed, limit, advice }
}
