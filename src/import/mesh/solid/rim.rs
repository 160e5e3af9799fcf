//! The rims of a surface's holes: where its winding field is not smooth.
//!
//! But for the steps by one at the surface itself, a winding field changes as the magnetic field of a current along the
//! rims is (Biot and Savart): its gradient at a point is the sum over all pieces of a rim of the piece times the
//! direction to it over the square of its distance, and each further derivative takes another distance.

use std::sync::Arc;

use glam::DVec3;

/// Greatest length of a piece, in cells.
const LENGTH: f64 = 4.0;
/// Pieces that are looked at together.
const CHUNK: usize = 64;
/// Distance of a piece from a cube, in half widths of the cube, from which on it is the same for all of the cube.
const FAR: f64 = 4.0;

/// A piece of a rim, or several: all of it is within `radius` of the middle.
#[derive(Clone, Copy, Debug)]
struct Piece {
    middle: DVec3,
    radius: f64,
    length: f64,
}

/// Pieces of rims in a cube and around it; lengths are cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Rim {
    pieces: Arc<Vec<Piece>>,
    /// Each [`CHUNK`] of the pieces as one: they come edge by edge, so that most are near each other.
    chunks: Arc<Vec<Piece>>,
    /// Sums over the pieces further away: of their length by the second and the fifth power of their distance.
    far: [f64; 2],
}

impl Rim {
    /// The rims with these edges, on a grid with so many steps along a cell.
    pub(super) fn new(edges: &[[[i32; 3]; 2]], step: f64) -> Rim {
        let mut pieces = Vec::new();
        for edge in edges {
            let [from, to] = edge.map(|end| DVec3::from_array(end.map(f64::from)) / step);
            let length = from.distance(to);
            let count = (length / LENGTH).ceil().clamp(1.0, 1e6);
            for number in 0..count as usize {
                let middle = from.lerp(to, (number as f64 + 0.5) / count);
                pieces.push(Piece { middle, radius: length / count / 2.0, length: length / count });
            }
        }
        Rim::of(pieces, [0.0; 2])
    }

    fn of(pieces: Vec<Piece>, far: [f64; 2]) -> Rim {
        let chunk = |pieces: &[Piece]| {
            let middle = pieces[0].middle;
            let reach = |piece: &Piece| piece.middle.distance(middle) + piece.radius;
            let radius = pieces.iter().map(reach).fold(0.0, f64::max);
            Piece { middle, radius, length: pieces.iter().map(|piece| piece.length).sum() }
        };
        let chunks: Vec<Piece> = pieces.chunks(CHUNK).map(chunk).collect();
        Rim { pieces: pieces.into(), chunks: chunks.into(), far }
    }

    /// Bytes of memory that rims of this number of edges take.
    pub(super) fn memory(edges: usize) -> u64 {
        (edges * 2 * size_of::<Piece>()) as u64
    }

    /// The rims as seen from a cube with this middle and half width; a cube in it has the same or nearer ones.
    pub(super) fn narrow(&self, middle: DVec3, half: f64) -> Rim {
        let (mut far, mut near) = (self.far, Vec::new());
        let gap = |piece: &Piece| gap(piece, middle, half);
        for (chunk, whole) in self.pieces.chunks(CHUNK).zip(self.chunks.iter()) {
            if gap(whole) > FAR * half {
                add(&mut far, whole.length, gap(whole));
                continue;
            }
            for piece in chunk {
                if gap(piece) > FAR * half {
                    add(&mut far, piece.length, gap(piece));
                } else {
                    near.push(*piece);
                }
            }
        }
        Rim::of(near, far)
    }

    /// Bounds in such a cube of the gradient, and of the fourth derivatives by 24, of a field that is smooth there;
    /// infinite if a rim may go through it.
    pub(super) fn derivatives(&self, middle: DVec3, half: f64) -> [f64; 2] {
        let mut sums = self.far;
        for piece in self.pieces.iter() {
            add(&mut sums, piece.length, gap(piece, middle, half).max(0.0));
        }
        sums.map(|sum| sum / (4.0 * std::f64::consts::PI))
    }
}

/// Distance from which on a piece lies from a cube.
fn gap(piece: &Piece, middle: DVec3, half: f64) -> f64 {
    ((piece.middle - middle).abs() - half).max(DVec3::ZERO).length() - piece.radius
}

fn add(sums: &mut [f64; 2], length: f64, distance: f64) {
    sums[0] += length / distance.powi(2);
    sums[1] += length / distance.powi(5);
}
