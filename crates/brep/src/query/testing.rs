//! Bodies for tests.

use crate::exact::vector::{cross, dot, subtract};
use crate::{Face, FaceList, Grid};

pub(super) type Ring = Vec<[i32; 3]>;

/// Faces of rings on a grid of unit steps from the world's origin.
pub(super) struct Body {
    bits: u8,
    faces: Vec<Vec<Ring>>,
}

impl Body {
    pub(super) fn new(bits: u8) -> Body {
        Body { bits, faces: Vec::new() }
    }

    pub(super) fn with(mut self, faces: Vec<Vec<Ring>>) -> Body {
        self.faces.extend(faces);
        self
    }

    pub(super) fn list(&self) -> FaceList {
        self.list_on(Grid { bits: self.bits, origin: [0; 3], step: 1.0, divisor: 1.0 })
    }

    pub(super) fn list_on(&self, grid: Grid) -> FaceList {
        let mut list = FaceList::new(grid, vec!["part".into()]);
        for (number, rings) in (0..).zip(&self.faces) {
            let ends = rings.iter().scan(0, |end, ring| {
                *end += ring.len();
                Some(*end)
            });
            let (points, ring_ends) = (rings.concat(), ends.collect::<Vec<_>>());
            let (points, ring_ends) = (&points, &ring_ends);
            list.push(&Face { number, points, ring_ends, colours: &[], part: 0, source: number });
        }
        list
    }
}

/// The only face.
pub(super) fn face_of(list: &FaceList) -> Face<'_> {
    list.get(0)
}

/// A box of six rectangles, inside out for a cavity.
pub(super) fn cuboid(min: [i32; 3], max: [i32; 3], is_cavity: bool) -> Vec<Vec<Ring>> {
    let p = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { min[axis] } else { max[axis] });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let face = |mut quad: [usize; 4]| {
        if is_cavity {
            quad.reverse();
        }
        vec![quad.map(p).to_vec()]
    };
    quads.map(face).to_vec()
}

/// A tetrahedron with outward faces; `None` if it is flat.
pub(super) fn tetrahedron([a, b, c, d]: [[i32; 3]; 4]) -> Option<Vec<Vec<Ring>>> {
    let [u, v, w] = [b, c, d].map(|p| subtract(p.map(i128::from), a.map(i128::from)));
    let volume = dot(u, cross(v, w));
    let faces = [[a, c, b], [a, b, d], [b, c, d], [c, a, d]].map(|mut ring| {
        if volume < 0 {
            ring.reverse();
        }
        vec![ring.to_vec()]
    });
    (volume != 0).then(|| faces.to_vec())
}

/// Reproducible pseudo-random numbers (splitmix64).
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub(super) fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }

    pub(super) fn point(&mut self, bound: u64) -> [i32; 3] {
        [0; 3].map(|_| self.below(bound) as i32)
    }
}
