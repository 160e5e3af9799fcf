//! Packing of vertex positions and colours, predicted by neighbouring vertices.

use spinney_packing::Columns;

use super::corners::Corners;

/// Number of prediction methods.
const WAYS: usize = 5;
/// Contexts of bits: whether a coordinate is as predicted, by method, axis, and the results of the
/// axes before.
const SAME: usize = 7;
/// Contexts of numbers: colours by channel, and coordinates by method and axis.
const COLOUR: usize = 0;
const POSITION: usize = COLOUR + 3;
/// Contexts of bits, and of numbers.
pub(super) const CONTEXTS: (usize, usize) = (WAYS * SAME, POSITION + 3 * WAYS);

/// Vertices whose positions are known.
pub(super) struct VertexPositions {
    bits: usize,
    numbers: usize,
    strides: [Stride; 3],
    known: usize,
}

impl VertexPositions {
    /// Codes the common stride of the coordinates per axis, before any position. Returns `None` if
    /// the strides are too large.
    pub(super) fn new(
        columns: &mut Columns<'_>,
        bits: usize,
        numbers: usize,
        positions: &[[i32; 3]],
    ) -> Option<VertexPositions> {
        let mut stride = |axis: usize| Stride::code(columns, positions.iter().map(|at| at[axis]));
        let strides = [stride(0)?, stride(1)?, stride(2)?];
        Some(VertexPositions { bits, numbers, strides, known: 0 })
    }

    /// Codes position and colour of the vertex at a corner of a ring, if it is the next unknown
    /// vertex.
    pub(super) fn code(
        &mut self,
        columns: &mut Columns<'_>,
        corners: &Corners,
        (ring, index): (&[u32], usize),
        positions: &mut [[i32; 3]],
        colours: &mut [[u8; 3]],
    ) {
        let new = self.known;
        if ring[index] as usize != new {
            return;
        }
        let at = |more: usize| ring[(index + more) % ring.len()];
        let is_known = |vertex: &u32| (*vertex as usize) < new;
        let (before, after) = (at(ring.len() - 1), at(1));
        let near = [before, after].into_iter().find(is_known).map(|vertex| vertex as usize);
        let near = near.or(new.checked_sub(1));
        let of = |vertex: u32| positions[vertex as usize].map(i64::from);
        let are_known = is_known(&before) && is_known(&after);
        let opposite = match ring.len() {
            3 if are_known => corners.corner_after(before, after).map(|vertex| (0, vertex)),
            4 if are_known => Some((1, at(2))).filter(|(_, vertex)| is_known(vertex)),
            _ => None,
        };
        let (way, expected) = match opposite {
            Some((way, opposite)) => {
                // A parallelogram, across the edge of another triangle or in the face itself.
                let [a, b, c] = [before, after, opposite].map(of);
                (way, [0, 1, 2].map(|axis| a[axis] + b[axis] - c[axis]))
            }
            None if are_known => {
                let [a, b] = [before, after].map(of);
                (2, [0, 1, 2].map(|axis| (a[axis] + b[axis]) >> 1))
            }
            None => {
                let way = if is_known(&before) || is_known(&after) { 3 } else { 4 };
                (way, near.map_or([0; 3], |vertex| positions[vertex].map(i64::from)))
            }
        };
        let mut same = 0;
        for (axis, at) in positions[new].iter_mut().enumerate() {
            let expected = self.strides[axis].number(expected[axis]);
            let error = self.strides[axis].number((*at).into()).wrapping_sub(expected);
            let context = self.bits + SAME * way + (1 << axis) - 1 + same;
            let is_same = columns.bit(context, error == 0);
            same |= usize::from(is_same) << axis;
            let error = match is_same {
                true => 0,
                false => columns.near(self.numbers + POSITION + 3 * way + axis, error),
            };
            *at = self.strides[axis].coordinate(expected.wrapping_add(error));
        }
        if !colours.is_empty() {
            let expected = near.map_or([0; 3], |vertex| colours[vertex]);
            for (channel, (value, expected)) in colours[new].iter_mut().zip(expected).enumerate() {
                let error = value.wrapping_sub(expected) as i8;
                let error = columns.near(self.numbers + COLOUR + channel, error.into());
                *value = expected.wrapping_add(error as u8);
            }
        }
        self.known += 1;
    }
}

/// The stride of coordinates along an axis: they are a first coordinate plus multiples of it.
struct Stride {
    first: i32,
    stride: i64,
}

impl Stride {
    /// Codes the largest common stride of coordinates.
    fn code(columns: &mut Columns<'_>, coordinates: impl Iterator<Item = i32> + Clone) -> Option<Stride> {
        let first = coordinates.clone().next().unwrap_or(0);
        let gcd =
            |stride: u32, at: i32| if stride == 1 { 1 } else { common_divisor(stride, at.abs_diff(first)) };
        let stride = columns.number(coordinates.fold(0, gcd).into());
        let first = columns.number((first as u32).into());
        let [stride, first] = [stride, first].map(u32::try_from);
        Some(Stride { first: first.ok()? as i32, stride: stride.ok()?.max(1).into() })
    }

    /// Returns a coordinate in strides, rounded down.
    fn number(&self, coordinate: i64) -> i64 {
        (coordinate - i64::from(self.first)).div_euclid(self.stride)
    }

    fn coordinate(&self, number: i64) -> i32 {
        number.wrapping_mul(self.stride).wrapping_add(self.first.into()) as i32
    }
}

fn common_divisor(mut a: u32, mut b: u32) -> u32 {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}
