//! Detection of equal faces in a cell.

use super::items::Items;
use crate::equal_faces::first_equal_faces;

/// The faces of a list that are equal to an earlier one: the same vertices in the same cyclic
/// order.
pub(super) struct EqualFaces {
    /// For each face, the first equal one; empty if no two are equal.
    first: Vec<u32>,
}

impl EqualFaces {
    /// Finds the equal faces of a list. In short lists, they are found by the pair tests instead.
    pub(super) fn of(items: &Items, list: &[u32]) -> EqualFaces {
        const MAX_COMPARED: usize = 64;
        if list.len() <= MAX_COMPARED {
            return EqualFaces { first: Vec::new() };
        }
        let first = first_equal_faces(list.len(), &|index| {
            let outline = items.outline(list[index]);
            (outline.points, outline.ring_ends)
        });
        EqualFaces { first }
    }

    /// Returns the index of the earlier face that is equal to this one.
    #[inline]
    pub(super) fn before(&self, index: usize) -> Option<usize> {
        self.first.get(index).map(|first| *first as usize).filter(|first| *first != index)
    }
}

#[cfg(test)]
mod tests {
    use spinney_base::io::Output;
    use spinney_container::Metadata;

    use crate::build::{Defect, DefectKind, ModelBuilder};
    use crate::{Face, FaceList, Faces, Grid};

    /// A part that is repeated 4,000 times has 128 million pairs of faces in each of many cells,
    /// none of which has all vertices.
    #[test]
    fn many_copies_of_a_face_are_found_without_testing_all_pairs() {
        const CORNERS: [[i32; 3]; 4] = [[0, 0, 0], [4000, 0, 0], [0, 4000, 0], [0, 0, 4000]];
        const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let grid = Grid { bits: 12, origin: [0; 3], step: 1.0, divisor: 1.0 };
        let mut list = FaceList::new(grid.clone(), vec!["body".into()]);
        for source in 0..4 * 4000 {
            let mut points = FACES[source % 4].map(|corner| CORNERS[corner]);
            points.rotate_left(source / 4 % 3);
            let source = source as u64;
            list.push(&Face { number: 0, points: &points, ring_ends: &[3], colours: &[], part: 0, source });
        }
        let directory = tempfile::tempdir().unwrap();
        let output = Output::create(&directory.path().join("x.goblin")).unwrap();
        let mut builder = ModelBuilder::new(output, grid, 64 << 20).unwrap();
        list.each(&mut |face| builder.push(face)).unwrap();
        let report = builder.finish(&mut Metadata::default(), &()).unwrap();
        assert!(report.defect_count >= 1000, "{}", report.defect_count);
        let is_of_equals = |defect: &Defect| {
            defect.kind == DefectKind::Overlap
                && defect.faces.windows(2).all(|pair| (pair[1] - pair[0]) % 4 == 0)
        };
        assert!(report.defects.iter().any(is_of_equals), "{:?}", report.defects);
    }
}
