//! Some faces of a block of faces with off-grid vertices, as a block. Planes and vertices are
//! copied as bytes, not decoded.

use super::exact::{COLOURED, ExactBlock, GRID_VERTEX};
use super::exact_lists::ExactLists;
use super::used_entries::UsedEntries;

impl ExactBlock<'_> {
    /// Returns the lists of a block of some faces of a checked block, by their indices, of which
    /// there must be one. Errors describe an invalid face.
    pub(crate) fn subset(&self, faces: &[usize]) -> Result<ExactLists, String> {
        let [_, plane_count, grid_count, vertex_count, ..] = self.layout.counts;
        // (Each entry takes several bytes of the block, so that the memory is limited by these.)
        let mut planes = UsedEntries::new(plane_count);
        let mut grid_points = UsedEntries::new(grid_count);
        let mut vertices = UsedEntries::new(vertex_count);
        let (mut face_planes, mut parts, mut sources) = (Vec::new(), Vec::new(), Vec::new());
        let (mut face_ends, mut ring_ends) = (Vec::new(), Vec::<u32>::new());
        let (mut corners, mut colours) = (Vec::new(), Vec::new());
        let plane_of = |planes: &mut UsedEntries, plane: usize| {
            planes.number(plane).ok_or_else(|| format!("plane {plane} of {plane_count}"))
        };
        for &face in faces {
            face_planes.push(plane_of(&mut planes, self.number(3, face))?);
            parts.push(self.part(face));
            sources.push(self.source(face));
            for ring in self.between(6, face) {
                let range = self.between(7, ring);
                for corner in range.clone() {
                    let vertex = self.number(8, 2 * corner);
                    let is_on_grid = vertex < grid_count;
                    let new = match is_on_grid {
                        true => grid_points.number(vertex),
                        false => vertices.number(vertex - grid_count),
                    };
                    let new =
                        new.ok_or_else(|| format!("vertex {vertex} of {}", grid_count + vertex_count))?;
                    corners.push((is_on_grid, new, plane_of(&mut planes, self.number(8, 2 * corner + 1))?));
                }
                if self.layout.has(COLOURED) {
                    let at = self.layout.lists[9] + 3 * range.start;
                    let own = self.bytes.get(at..at + 3 * range.len()).ok_or("colours beyond the block")?;
                    colours.extend_from_slice(own);
                }
                ring_ends.push(corners.len() as u32);
            }
            face_ends.push(ring_ends.len() as u32);
        }
        let widths = self.layout.widths;
        let copied = |used: &UsedEntries, list: usize, size: usize| {
            let bytes = used.bytes(&self.bytes, self.layout.lists[list], size);
            bytes.ok_or_else(|| "lists that do not fit".to_string())
        };
        Ok(ExactLists {
            planes: copied(&planes, 0, 3 * widths[0] + widths[1])?,
            grid_points: copied(&grid_points, 1, GRID_VERTEX)?,
            vertices: copied(&vertices, 2, 3 * widths[2] + widths[3])?,
            widths,
            face_planes,
            parts,
            sources,
            face_ends,
            ring_ends,
            corners,
            colours,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrangement::{Corner, ExactFace, ExactPlane, ExactPoint};
    use crate::store::exact::{ExactBlockBuilder, encode};
    use spinney_base::io::FileBytes;

    /// Faces of a subset are those of the block, whatever the parts, colours and rings.
    #[test]
    fn subsets_have_the_faces_of_the_block() {
        let face = |number: i64, colours: bool, scale: i64| {
            // (Walls through halves and thirds of a unit: off the grid.)
            let walls = [([1, 0, 0], 0), ([0, 1, 0], 1 + number), ([3, 1, 0], 40), ([1, 1, 0], 31)];
            let walls = walls.map(|(normal, offset)| ExactPlane { normal, offset: offset.into() });
            let own = ExactPlane { normal: [0, 0, scale], offset: (number * scale).into() };
            let count = 3 + number as usize % 2;
            let corners = (0..count).map(|index| {
                let (wall, line) = (walls[index], walls[(index + 1) % count]);
                Corner { point: ExactPoint::of_planes([&own, &wall, &line]).settled(), line }
            });
            ExactFace {
                plane: own,
                corners: corners.collect(),
                ring_ends: vec![count],
                colours: if colours { vec![[number as u8, 1, 2]; count] } else { Vec::new() },
                part: number as u32 % 2,
                source: number as u64 * 7,
            }
        };
        for colours in [false, true] {
            let faces: Vec<ExactFace> = (0..9).map(|number| face(number, colours, 1)).collect();
            let bytes = encode(&faces);
            let block = ExactBlock::new(FileBytes::Mapped(&bytes), 8).unwrap();
            assert_eq!(block.subset(&(0..9).collect::<Vec<_>>()).unwrap().to_bytes(), bytes);
            // (The last face has wider numbers.)
            let far = ExactFace { source: 1 << 40, ..face(20, colours, 100_000) };
            for chosen in [vec![0], vec![8], vec![1, 3, 5], vec![0, 1, 2, 6, 7]] {
                let mut builder = ExactBlockBuilder::default();
                builder.append(block.subset(&chosen).unwrap());
                builder.append(block.subset(&[4, 2]).unwrap());
                builder.push(far.clone());
                let (first, joined) = builder.finish();
                assert!(first == 0 && builder.is_empty() && builder.len() == chosen.len() as u64 + 3);
                let found = ExactBlock::new(FileBytes::Mapped(&joined), 8).unwrap();
                found.check(2).unwrap();
                let expected: Vec<ExactFace> = chosen
                    .iter()
                    .chain(&[4, 2])
                    .map(|index| faces[*index].clone())
                    .chain([far.clone()])
                    .collect();
                let decoded: Vec<ExactFace> =
                    (0..found.len()).map(|index| found.face(index).unwrap()).collect();
                assert_eq!(encode(&decoded), encode(&expected));
            }
        }
    }
}
