//! The section that describes a model: its grid, and its face and node counts.

use std::path::Path;

use super::segment::NodeKind;
use crate::{Grid, MAX_BITS};
use spinney_base::{Error, Result};
use spinney_container::Codec;

/// Tag of the section.
pub(crate) const SUMMARY: [u8; 4] = *b"BREP";
/// Tag of the section with the segment list of the octree.
pub(crate) const DIRECTORY: [u8; 4] = *b"DIRE";
/// Tag of the metadata section.
pub(crate) const METADATA: [u8; 4] = *b"META";
/// Tag of the section with the list of face blocks.
pub(crate) const FACES: [u8; 4] = *b"FACE";

/// Node counts of a model's octree, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NodeCounts {
    /// Cells outside of the body.
    pub void: u64,
    /// Cells inside of the body.
    pub full: u64,
    /// Divided cells.
    pub inner: u64,
    /// Cells whose faces are in one plane.
    pub face: u64,
    /// Cells whose faces' planes share a line.
    pub edge: u64,
    /// Cells whose faces' planes share a point.
    pub vertex: u64,
    /// Leaves whose faces' planes share nothing.
    pub boolean: u64,
}

impl NodeCounts {
    /// Returns the number of all nodes.
    pub fn total(&self) -> u64 {
        self.named().into_iter().map(|(_, count)| count).sum()
    }

    /// Returns the counts with the nodes' names.
    pub fn named(&self) -> [(&'static str, u64); 7] {
        let NodeCounts { void, full, inner, face, edge, vertex, boolean } = *self;
        [
            ("VOID", void),
            ("FULL", full),
            ("INNER", inner),
            ("FACE", face),
            ("EDGE", edge),
            ("VERTEX", vertex),
            ("BOOLEAN", boolean),
        ]
    }

    /// Counts a leaf.
    pub fn count(&mut self, kind: NodeKind) {
        *match kind {
            NodeKind::Face => &mut self.face,
            NodeKind::Edge => &mut self.edge,
            NodeKind::Vertex => &mut self.vertex,
            NodeKind::Boolean => &mut self.boolean,
        } += 1;
    }

    /// Adds the counts of another subtree.
    pub fn add(&mut self, other: &NodeCounts) {
        self.void += other.void;
        self.full += other.full;
        self.inner += other.inner;
        self.face += other.face;
        self.edge += other.edge;
        self.vertex += other.vertex;
        self.boolean += other.boolean;
    }
}

/// The section, decoded.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Summary {
    pub grid: Grid,
    /// [`Codec::Packed`] if chunks may be packed.
    pub codec: Codec,
    pub faces: u64,
    /// Whether the body extends to infinity.
    pub is_unbounded: bool,
    pub nodes: NodeCounts,
    /// Number of faces with off-grid vertices, and of their proxies.
    pub exact_faces: u64,
    pub proxies: u64,
    /// Maximum distance between the proxies and their faces in grid units, at least 1.
    pub reach: u8,
    /// Number of parts.
    pub parts: u64,
}

/// Bytes of the section.
const SIZE: usize = 8 + 24 + 16 + 8 + 56 + 24;

impl Summary {
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes =
            vec![self.grid.bits, self.is_unbounded.into(), self.codec as u8, self.reach - 1, 0, 0, 0, 0];
        self.grid.origin.iter().for_each(|at| bytes.extend_from_slice(&at.to_le_bytes()));
        bytes.extend_from_slice(&self.grid.step.to_le_bytes());
        bytes.extend_from_slice(&self.grid.divisor.to_le_bytes());
        bytes.extend_from_slice(&self.faces.to_le_bytes());
        self.nodes.named().iter().for_each(|(_, count)| bytes.extend_from_slice(&count.to_le_bytes()));
        for count in [self.exact_faces, self.proxies, self.parts] {
            bytes.extend_from_slice(&count.to_le_bytes());
        }
        bytes
    }

    pub(crate) fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Summary> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "model", found, expected);
        if bytes.len() < SIZE {
            return Err(corrupt(format!("{} bytes", bytes.len()), "at least 136"));
        }
        let eight = |at: usize| <[u8; 8]>::try_from(&bytes[at..at + 8]).expect("eight bytes");
        let count = |index: usize| u64::from_le_bytes(eight(56 + 8 * index));
        let grid = Grid {
            bits: bytes[0],
            origin: [8, 16, 24].map(|at| i64::from_le_bytes(eight(at))),
            step: f64::from_le_bytes(eight(32)),
            divisor: f64::from_le_bytes(eight(40)),
        };
        let is_grid = (1..=MAX_BITS).contains(&grid.bits)
            && grid.origin.iter().all(|at| at.unsigned_abs() <= 1 << 53)
            && [grid.step, grid.divisor].iter().all(|number| number.is_normal() && *number > 0.0)
            && grid.width().is_normal();
        if !is_grid {
            return Err(corrupt(format!("{grid:?}"), "1 to 26 bits, origins up to 2^53, units above zero"));
        }
        let nodes = NodeCounts {
            void: count(0),
            full: count(1),
            inner: count(2),
            face: count(3),
            edge: count(4),
            vertex: count(5),
            boolean: count(6),
        };
        if nodes.named().iter().any(|(_, count)| *count > 1 << 58) {
            return Err(corrupt(format!("{nodes:?}"), "at most 2^58 nodes of each kind"));
        }
        let faces = u64::from_le_bytes(eight(48));
        if faces >= 1 << 32 {
            return Err(corrupt(format!("{faces} faces"), "fewer than 2^32"));
        }
        if bytes[1] > 1 {
            return Err(corrupt(format!("{} as the flag of unbounded bodies", bytes[1]), "0 or 1"));
        }
        let [exact_faces, proxies, parts] = [7, 8, 9].map(count);
        if exact_faces >= 1 << 32 || proxies > faces || !(1..1 << 32).contains(&parts) {
            let found = format!("{exact_faces} exact faces, {proxies} proxies, {parts} parts");
            return Err(corrupt(
                found,
                "fewer than 2^32 of each, no more proxies than faces, and at least one part",
            ));
        }
        let codec = match Codec::of_number(path, bytes[2], " of an exact model")? {
            Codec::Reference => {
                let advice = "install the version of Spinney that wrote the file, or a newer one";
                return Err(Error::unsupported(path, "codec number 2 of an exact model", advice));
            }
            codec => codec,
        };
        let (is_unbounded, reach) = (bytes[1] == 1, bytes[3].saturating_add(1));
        Ok(Summary { grid, codec, faces, is_unbounded, nodes, exact_faces, proxies, reach, parts })
    }
}
