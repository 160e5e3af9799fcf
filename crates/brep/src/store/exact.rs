//! The section of faces with corners beside the grid, for which others stand in the octree: see `formats.md`.

use std::collections::HashMap;
use std::path::Path;

use bnum::cast::As;
use bnum::types::I256;

use crate::arrangement::{Corner, ExactFace, ExactPlane, ExactPoint, Vertices};
use crate::exact::bounds::{NORMAL_BITS, OFFSET_BITS, WEIGHT_BITS};
use spinney_base::{Error, Result};

/// Tag of the section.
pub(crate) const EXACT: [u8; 4] = *b"EXAC";

/// Bytes of the head, a plane, a vertex, a face and a corner.
const HEAD: usize = 32;
const PLANE: usize = 40;
const VERTEX: usize = 97;
const FACE: usize = 16;
const CORNER: usize = 8;

/// Bytes of a vertex' coordinates, and of its weight.
const COORDINATE: usize = 25;
const WEIGHT: usize = 22;

/// Faces with corners beside the grid, and numbers, ascending, of those that stand for them in the octree.
#[derive(Debug, Default)]
pub(crate) struct ExactPart {
    pub faces: Vec<ExactFace>,
    pub stand_ins: Vec<u32>,
}

impl ExactPart {
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut numbers: HashMap<([i64; 3], i128), u32> = HashMap::new();
        let mut planes: Vec<ExactPlane> = Vec::new();
        let mut plane = |plane: &ExactPlane| {
            *numbers.entry((plane.normal, plane.offset)).or_insert_with(|| {
                planes.push(*plane);
                planes.len() as u32 - 1
            })
        };
        let mut vertices = Vertices::default();
        let (mut faces, mut ends, mut ring_ends) = (Vec::new(), Vec::new(), Vec::new());
        let (mut corners, mut colours) = (Vec::new(), Vec::new());
        let (mut rings, mut count) = (0u32, 0u32);
        for face in &self.faces {
            faces.extend_from_slice(&plane(&face.plane).to_le_bytes());
            faces.extend_from_slice(&face.part.to_le_bytes());
            faces.extend_from_slice(&face.source.to_le_bytes());
            rings += face.ring_ends.len() as u32;
            ends.extend_from_slice(&rings.to_le_bytes());
            for end in &face.ring_ends {
                ring_ends.extend_from_slice(&(count + *end as u32).to_le_bytes());
            }
            count += face.corners.len() as u32;
            for corner in &face.corners {
                corners.extend_from_slice(&vertices.number(corner.point).to_le_bytes());
                corners.extend_from_slice(&plane(&corner.line).to_le_bytes());
            }
            colours.extend_from_slice(face.colours.as_flattened());
        }
        let lengths = [self.faces.len(), planes.len(), vertices.list().len(), rings as usize, count as usize];
        let mut bytes = Vec::new();
        lengths.iter().for_each(|length| bytes.extend_from_slice(&(*length as u32).to_le_bytes()));
        bytes.extend_from_slice(&(self.stand_ins.len() as u32).to_le_bytes());
        bytes.extend_from_slice(&u32::from(!colours.is_empty()).to_le_bytes());
        bytes.extend_from_slice(&[0; 4]);
        for plane in &planes {
            plane.normal.iter().for_each(|part| bytes.extend_from_slice(&part.to_le_bytes()));
            bytes.extend_from_slice(&plane.offset.to_le_bytes());
        }
        for point in vertices.list() {
            point.at.iter().for_each(|at| push(&mut bytes, at, COORDINATE));
            push(&mut bytes, &point.weight, WEIGHT);
        }
        [faces, ends, ring_ends, corners, colours].into_iter().for_each(|list| bytes.extend(list));
        self.stand_ins.iter().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        bytes
    }

    /// Reads the section of a model with so many faces and parts, on a grid of so many bits.
    pub(crate) fn from_bytes(
        path: &Path,
        bytes: &[u8],
        faces: u64,
        parts: u64,
        bits: u8,
    ) -> Result<ExactPart> {
        let corrupt =
            |found: String| Error::corrupt(path, "exact faces", found, "a section as formats.md has it");
        let four = |bytes: &[u8], index: usize| {
            u32::from_le_bytes(bytes[4 * index..4 * index + 4].try_into().expect("four bytes"))
        };
        if bytes.len() < HEAD {
            return Err(corrupt(format!("{} bytes", bytes.len())));
        }
        let [count, planes, vertices, rings, corners, stand_ins, flags] =
            [0, 1, 2, 3, 4, 5, 6].map(|index| four(bytes, index) as usize);
        let colours = if flags == 1 { 3 * corners } else { 0 };
        let sizes = [PLANE * planes, VERTEX * vertices, FACE * count, 4 * count, 4 * rings, CORNER * corners];
        let all = HEAD + sizes.iter().sum::<usize>() + colours + 4 * stand_ins;
        if flags > 1 || all != bytes.len() {
            return Err(corrupt(format!("{} bytes for lists of {all}", bytes.len())));
        }
        let mut rest = &bytes[HEAD..];
        let mut list = |size: usize| {
            let (list, after) = rest.split_at(size);
            rest = after;
            list
        };
        let [plane_bytes, vertex_bytes, face_bytes, ends, ring_ends, corner_bytes] = sizes.map(&mut list);
        let (colour_bytes, stand_in_bytes) = (list(colours), list(4 * stand_ins));
        let planes: Vec<ExactPlane> = plane_bytes.chunks_exact(PLANE).map(plane_of).collect();
        // What the widths of numbers are made for.
        let is_plane = |plane: &ExactPlane| {
            plane.normal != [0; 3]
                && plane.normal.iter().all(|part| part.unsigned_abs() < 1 << NORMAL_BITS)
                && plane.offset.unsigned_abs() < 1 << OFFSET_BITS
        };
        if let Some(plane) = planes.iter().find(|plane| !is_plane(plane)) {
            return Err(corrupt(format!("{plane:?}")));
        }
        let side = (1u64 << bits) as f64;
        let points: Option<Vec<ExactPoint>> = vertex_bytes
            .chunks_exact(VERTEX)
            .map(|bytes| {
                let at = [0, 1, 2].map(|axis| number(&bytes[COORDINATE * axis..COORDINATE * (axis + 1)]));
                let weight = number(&bytes[3 * COORDINATE..]);
                // (Numbers of more bits have no room where they are multiplied.)
                let is_positive =
                    !weight.is_negative() && !weight.is_zero() && (weight >> WEIGHT_BITS).is_zero();
                let point = is_positive.then(|| ExactPoint::of(at, weight))?;
                // (It may lie half a step beside the first or the last points.)
                point.near.iter().all(|at| (-1.0..side).contains(at)).then_some(point)
            })
            .collect();
        let points = points.ok_or_else(|| corrupt("a vertex beside the grid's cells".into()))?;
        let ends: Vec<usize> = (0..count).map(|face| four(ends, face) as usize).collect();
        let ring_ends: Vec<usize> = (0..rings).map(|ring| four(ring_ends, ring) as usize).collect();
        let ascend = |list: &[usize], least: usize, last: usize| {
            let starts = std::iter::once(0).chain(list.iter().copied());
            starts.zip(list).all(|(start, end)| end.checked_sub(start).is_some_and(|length| length >= least))
                && list.last().copied().unwrap_or(0) == last
        };
        if !ascend(&ends, 1, rings) || !ascend(&ring_ends, 3, corners) {
            return Err(corrupt("ends of rings that do not ascend".into()));
        }
        let mut found = ExactPart::default();
        let (mut ring, mut corner) = (0, 0);
        for (face, &end) in face_bytes.chunks_exact(FACE).zip(&ends) {
            let plane = *planes.get(four(face, 0) as usize).ok_or_else(|| corrupt("no such plane".into()))?;
            let part = four(face, 1);
            if u64::from(part) >= parts {
                return Err(corrupt(format!("part {part} of {parts}")));
            }
            let source = u64::from_le_bytes(face[8..].try_into().expect("eight bytes"));
            let (first, first_ring) = (corner, ring);
            let mut own = Vec::new();
            while ring < end {
                let last = ring_ends[ring];
                for place in corner..last {
                    let read = |place: usize| {
                        let bytes = &corner_bytes[CORNER * place..];
                        Some((points.get(four(bytes, 0) as usize)?, planes.get(four(bytes, 1) as usize)?))
                    };
                    let next = if place + 1 == last { corner } else { place + 1 };
                    let (Some((point, line)), Some((next, _))) = (read(place), read(next)) else {
                        return Err(corrupt("no such vertex".into()));
                    };
                    let is_on = plane.side(point) == 0 && line.side(point) == 0 && line.side(next) == 0;
                    if !is_on || plane.is(line) || point.is(next) {
                        return Err(corrupt(format!("a corner at {:?} that is not on its edge", point.near)));
                    }
                    own.push(Corner { point: *point, line: *line });
                }
                corner = last;
                ring += 1;
            }
            let colours = colour_bytes.get(3 * first..3 * corner).unwrap_or_default();
            found.faces.push(ExactFace {
                plane,
                corners: own,
                ring_ends: ring_ends[first_ring..ring].iter().map(|end| end - first).collect(),
                colours: colours.chunks_exact(3).map(|colour| [colour[0], colour[1], colour[2]]).collect(),
                part,
                source,
            });
        }
        found.stand_ins = (0..stand_ins).map(|index| four(stand_in_bytes, index)).collect();
        let last = found.stand_ins.last().copied().unwrap_or(0);
        let ascend = found.stand_ins.windows(2).all(|pair| pair[0] < pair[1]);
        if !ascend || (stand_ins > 0 && u64::from(last) >= faces) {
            return Err(corrupt(format!("faces up to {last} that stand for others")));
        }
        Ok(found)
    }
}

fn plane_of(bytes: &[u8]) -> ExactPlane {
    let eight =
        |axis: usize| i64::from_le_bytes(bytes[8 * axis..8 * axis + 8].try_into().expect("eight bytes"));
    let offset = i128::from_le_bytes(bytes[24..].try_into().expect("sixteen bytes"));
    ExactPlane { normal: [0, 1, 2].map(eight), offset }
}

/// Appends the lowest bytes of a number.
fn push(bytes: &mut Vec<u8>, number: &I256, count: usize) {
    bytes.extend((0..count).map(|byte| -> u8 { (*number >> (8 * byte as u32)).as_() }));
}

/// A number of fewer bytes, with its sign.
fn number(bytes: &[u8]) -> I256 {
    let mut found: I256 = (*bytes.last().unwrap_or(&0) as i8).as_();
    for byte in bytes.iter().rev().skip(1) {
        let low: I256 = (*byte).as_();
        found = (found << 8u32) + low;
    }
    found
}
