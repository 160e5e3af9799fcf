//! Packing of planes and vertices of exact faces, predicted by incidence.

use bnum::cast::As;
use bnum::types::I256;
use spinney_packing::Columns;

use super::super::exact::{number, push, short_number};
use super::words::{Words, push_words};
use crate::arrangement::{ExactPlane, ExactPoint, wide};
use crate::exact::bounds::{NORMAL_BITS, OFFSET_BITS};

/// Contexts of bits: whether a normal is that of the plane along an axis, whether its components
/// are 0 by axis and those before, whether its offset is that of a known point, and its sign; and
/// whether a vertex is the intersection of its planes.
const ALONG: usize = 0;
const ZERO: usize = ALONG + 1;
const PRODUCT: usize = ZERO + 7;
const SIGN: usize = PRODUCT + 1;
const COMMON: usize = SIGN + 1;
/// Contexts of numbers: coordinates by axis, and normal components.
const COORDINATE: usize = 0;
const PART: usize = COORDINATE + 3;
/// Contexts of bits, and of numbers.
pub(super) const CONTEXTS: (usize, usize) = (COMMON + 1, PART + 3);

/// Marks a missing vertex or plane.
const NONE: u32 = u32::MAX;

/// Incidences of vertices and planes, from the corners where they occur first.
pub(super) struct Incidences {
    /// For each plane, a grid vertex in it.
    points: Vec<u32>,
    /// For each plane, the ends of an edge between grid vertices, and the plane of its face.
    edges: Vec<[u32; 3]>,
    /// For each off-grid vertex, three planes that contain it.
    planes: Vec<[u32; 3]>,
}

impl Incidences {
    pub(super) fn new(planes: usize, vertices: usize) -> Incidences {
        Incidences {
            points: vec![NONE; planes],
            edges: vec![[NONE; 3]; planes],
            planes: vec![[NONE; 3]; vertices],
        }
    }

    /// Records a ring of a face; vertices below `grid` are on the grid. All numbers must be valid.
    pub(super) fn note(&mut self, plane: u32, ring: &[[u32; 2]], grid: u32) {
        for index in 0..ring.len() {
            let [vertex, line] = ring[index];
            let before = ring[(index + ring.len() - 1) % ring.len()][1];
            let to = ring[(index + 1) % ring.len()][0];
            let planes = [plane, before, line];
            if vertex < grid {
                for plane in planes {
                    let point = &mut self.points[plane as usize];
                    *point = if *point == NONE { vertex } else { *point };
                }
                let edge = &mut self.edges[line as usize];
                if *edge == [NONE; 3] && to < grid {
                    *edge = [vertex, to, plane];
                }
            } else {
                let known = &mut self.planes[(vertex - grid) as usize];
                *known = if *known == [NONE; 3] { planes } else { *known };
            }
        }
    }
}

/// Planes and vertices of a block.
pub(super) struct Points {
    planes: Vec<ExactPlane>,
    grid: Vec<[i32; 3]>,
    /// Coordinates and weights.
    vertices: Vec<([I256; 3], I256)>,
}

impl Points {
    /// Allocates zeros.
    pub(super) fn blank(planes: usize, grid: usize, vertices: usize) -> Points {
        let zero = wide(0);
        Points {
            planes: vec![ExactPlane { normal: [0; 3], offset: 0 }; planes],
            grid: vec![[0; 3]; grid],
            vertices: vec![([zero; 3], zero); vertices],
        }
    }

    pub(super) fn take(&mut self, words: &mut Words<'_>, [part, product, coordinate, weight]: [usize; 4]) {
        let mut take = |length: usize| {
            let mut bytes = [0; 32];
            words.bytes(&mut bytes[..length]);
            bytes
        };
        for plane in &mut self.planes {
            plane.normal = [0; 3].map(|_| short_number(&take(part)[..part]) as i64);
            plane.offset = short_number(&take(product)[..product]);
        }
        let word = |bytes: [u8; 32]| i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        self.grid.as_flattened_mut().iter_mut().for_each(|at| *at = word(take(4)));
        for (at, divisor) in &mut self.vertices {
            at.iter_mut().for_each(|at| *at = number(&take(coordinate)[..coordinate]));
            *divisor = number(&take(weight)[..weight]);
        }
    }

    pub(super) fn push(&self, bytes: &mut Vec<u8>, [part, product, coordinate, weight]: [usize; 4]) {
        for plane in &self.planes {
            plane.normal.iter().for_each(|at| bytes.extend_from_slice(&at.to_le_bytes()[..part]));
            bytes.extend_from_slice(&plane.offset.to_le_bytes()[..product]);
        }
        push_words(bytes, self.grid.as_flattened().iter().map(|at| *at as u32));
        for (at, divisor) in &self.vertices {
            at.iter().for_each(|at| push(bytes, at, coordinate));
            push(bytes, divisor, weight);
        }
    }

    /// Codes all planes and vertices. Returns `None` if a plane's numbers have too many bits, or a
    /// vertex is coded by planes that do not intersect in a point.
    pub(super) fn code(
        &mut self,
        columns: &mut Columns<'_>,
        contexts: (usize, usize),
        incidences: &Incidences,
        [_, _, coordinate, weight]: [usize; 4],
    ) -> Option<()> {
        let mut last = [0u32; 3];
        for point in &mut self.grid {
            for (axis, (at, last)) in point.iter_mut().zip(&mut last).enumerate() {
                let more = i64::from((*at as u32).wrapping_sub(*last) as i32);
                *last = last.wrapping_add(columns.near(contexts.1 + COORDINATE + axis, more) as u32);
                *at = *last as i32;
            }
        }
        for plane in 0..self.planes.len() {
            self.planes[plane] = self.plane(columns, contexts, incidences, plane)?;
        }
        for ((at, divisor), planes) in self.vertices.iter_mut().zip(&incidences.planes) {
            let common = point_of(&self.planes, planes);
            let times = common.and_then(|common| factor(&(*at, *divisor), &common));
            if columns.bit(contexts.0 + COMMON, times.is_some()) {
                let times = Some(columns.number(times.unwrap_or(0))).filter(|times| *times > 0)?;
                let times = wide(times.into());
                let (common, product) = common?;
                (*at, *divisor) = (common.map(|common| common / times), product / times);
            } else {
                at.iter_mut().for_each(|at| code_raw(columns, at, coordinate));
                code_raw(columns, divisor, weight);
            }
        }
        Some(())
    }

    fn plane(
        &self,
        columns: &mut Columns<'_>,
        (bits, numbers): (usize, usize),
        incidences: &Incidences,
        number: usize,
    ) -> Option<ExactPlane> {
        let given = &self.planes[number];
        let [from, to, face] = incidences.edges[number];
        // Planes of edges are parallel to the main axis of the face's normal.
        let along =
            self.planes[..number].get(face as usize).filter(|face| face.normal != [0; 3]).map(|face| {
                let [from, to] = [from, to].map(|vertex| self.grid[vertex as usize]);
                ExactPlane::along(face.main_axis(), from, to).normal
            });
        let normal = match along.filter(|along| columns.bit(bits + ALONG, *along == given.normal)) {
            Some(along) => along,
            None => {
                let (mut normal, mut zeros) = (given.normal, 0);
                for (axis, part) in normal.iter_mut().enumerate() {
                    let is_zero = columns.bit(bits + ZERO + (1 << axis) - 1 + zeros, *part == 0);
                    zeros |= usize::from(is_zero) << axis;
                    *part = if is_zero { 0 } else { columns.near(numbers + PART + axis, *part) };
                }
                normal
            }
        };
        if normal.iter().any(|part| part.unsigned_abs() >= 1 << NORMAL_BITS) {
            return None;
        }
        let point = self.grid.get(incidences.points[number] as usize);
        let product = point.map(|point| ExactPlane::through(*point, normal).offset);
        let offset = match product.filter(|product| columns.bit(bits + PRODUCT, *product == given.offset)) {
            Some(product) => product,
            None => {
                let is_negative = columns.bit(bits + SIGN, given.offset < 0);
                let size = given.offset.unsigned_abs();
                let [lower, upper] = [size, size >> 64].map(|part| columns.number(part as u64));
                let size = (u128::from(upper) << 64 | u128::from(lower)).min(1 << OFFSET_BITS) as i128;
                if is_negative { -size } else { size }
            }
        };
        (offset.unsigned_abs() < 1 << OFFSET_BITS).then_some(ExactPlane { normal, offset })
    }
}

/// Returns the intersection of three planes, not reduced: its coordinates, and their divisor.
fn point_of(all: &[ExactPlane], planes: &[u32; 3]) -> Option<([I256; 3], I256)> {
    let [a, b, c] = planes.map(|plane| all.get(plane as usize));
    let point = ExactPoint::of_planes([a?, b?, c?]);
    (!point.weight.is_zero()).then_some((point.at, point.weight))
}

/// Returns the factor between two homogeneous representations of the same point, if it is an
/// integer of at most 63 bits.
fn factor((at, divisor): &([I256; 3], I256), (common, product): &([I256; 3], I256)) -> Option<u64> {
    if divisor.is_zero() || divisor.is_negative() {
        return None;
    }
    let factor = *product / *divisor;
    if factor.is_zero() || !(factor >> 63u32).is_zero() {
        return None;
    }
    let is_of = |large: &I256, small: &I256| *large / factor == *small && (*large % factor).is_zero();
    let is_it = is_of(product, divisor) && common.iter().zip(at).all(|(large, small)| is_of(large, small));
    is_it.then(|| factor.as_())
}

/// Codes the low bytes of a number, eight at a time.
fn code_raw(columns: &mut Columns<'_>, value: &mut I256, width: usize) {
    let mut bytes = Vec::with_capacity(width);
    push(&mut bytes, value, width);
    for part in bytes.chunks_mut(8) {
        let mut word = [0; 8];
        word[..part.len()].copy_from_slice(part);
        let word = columns.number(u64::from_le_bytes(word)).to_le_bytes();
        part.copy_from_slice(&word[..part.len()]);
    }
    *value = number(&bytes);
}
