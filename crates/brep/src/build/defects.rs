//! Defects of surfaces that bound no solid: positions and faces.

use std::fmt;
use std::path::Path;

use super::BuildReport;
use crate::Grid;
use spinney_base::Error;

/// Maximum number of defects that are kept.
pub(super) const MAX_LISTED: usize = 100;

/// Number of defects after which a subtree is not checked any further: of equal bodies in one
/// position, any two faces overlap.
const ENOUGH: u64 = 1000;

/// A position where a surface does not bound a solid.
#[derive(Clone, Debug, PartialEq)]
pub struct Defect {
    /// Kind of the defect.
    pub kind: DefectKind,
    /// A point of the defect, in world coordinates.
    pub place: [f64; 3],
    /// Numbers of the faces involved, from 0 in the order of reading.
    pub faces: Vec<u64>,
}

/// Kinds of defects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DefectKind {
    /// Two faces intersect.
    Crossing,
    /// Two faces overlap and have the same orientation.
    Overlap,
    /// Two faces meet only each other at an edge, and are folded flat there: they lie on the same
    /// side of the edge, in one plane.
    Fold,
    /// The surface has this winding number, where 0 or 1 is valid: bodies overlap, or are inside
    /// out.
    Winding(i32),
    /// A chain of this many edges that have a face on one side only.
    Boundary(usize),
}

impl BuildReport {
    /// Maximum depth of intersections that rounding may have caused, in grid units: two vertices
    /// that rounding moved by up to a unit each.
    pub const THIN: f64 = 2.0;

    /// Returns the error of a surface with these defects, for the model file `path`.
    pub fn error(&self, path: &Path, what: &str, advice: &str) -> Error {
        Error::NotASolid {
            path: path.to_path_buf(),
            what: what.into(),
            locations: self.defects.iter().map(Defect::to_string).collect(),
            count: self.defect_count,
            advice: advice.into(),
        }
    }
}

impl fmt::Display for DefectKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DefectKind::Crossing => write!(f, "faces that intersect"),
            DefectKind::Overlap => write!(f, "faces that overlap"),
            DefectKind::Fold => write!(f, "faces that are folded onto each other"),
            DefectKind::Winding(times) => {
                write!(f, "winding number {times}, expected 0 or 1,")
            }
            DefectKind::Boundary(edges) => write!(f, "a boundary of {edges} edges"),
        }
    }
}

impl fmt::Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {}", self.kind, format_position(self.place))?;
        if self.faces.is_empty() {
            return Ok(());
        }
        let faces: Vec<String> = self.faces.iter().map(u64::to_string).collect();
        write!(f, " (face {})", faces.join(", "))
    }
}

/// Formats coordinates with single precision.
pub fn format_position(point: [f64; 3]) -> String {
    let [x, y, z] = point.map(|at| (at as f32).to_string());
    format!("{x}, {y}, {z}")
}

/// The first defects of a subtree.
#[derive(Default)]
pub(super) struct Defects {
    /// Positions in grid units, and face numbers.
    pub(super) list: Vec<GridDefect>,
    pub(super) count: u64,
    /// Whether there are thin intersections, and others.
    thin: bool,
    deep: bool,
}

/// A defect on the grid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GridDefect {
    pub(super) kind: DefectKind,
    /// A point, in grid units.
    pub(super) at: [f64; 3],
    pub(super) faces: Vec<u32>,
    /// Whether it is an intersection that rounding may have caused; `None` if it is none.
    pub(super) is_thin: Option<bool>,
}

impl GridDefect {
    /// A wrong winding number at a point.
    pub(super) fn winding(number: i32, at: [f64; 3], faces: Vec<u32>) -> GridDefect {
        GridDefect { kind: DefectKind::Winding(number), at, faces, is_thin: None }
    }

    pub(super) fn in_world(self, grid: &Grid) -> Defect {
        Defect {
            kind: self.kind,
            place: grid.to_world_between(self.at),
            faces: self.faces.into_iter().map(u64::from).collect(),
        }
    }
}

impl Defects {
    pub(super) fn push(&mut self, found: GridDefect) {
        self.thin |= found.is_thin == Some(true);
        self.deep |= found.is_thin == Some(false);
        // (A pair of faces is tested in every cell that both cut.)
        if self
            .list
            .iter()
            .any(|known| known.kind == found.kind && known.faces == found.faces && !found.faces.is_empty())
        {
            return;
        }
        self.count += 1;
        if self.list.len() < MAX_LISTED {
            self.list.push(found);
        }
    }

    /// Returns whether all intersections are thin, and there are any. (Wrong winding numbers follow
    /// from intersections, or the surface is inside out.)
    pub(super) fn are_thin(&self) -> bool {
        // (Beyond the maximum, not all were found.)
        self.thin && !self.deep && !self.are_enough()
    }

    /// Returns whether further defects make no difference.
    pub(super) fn are_enough(&self) -> bool {
        self.count >= ENOUGH
    }

    pub(super) fn append(&mut self, other: Defects) {
        let beyond = other.count - other.list.len() as u64;
        other.list.into_iter().for_each(|found| self.push(found));
        self.count += beyond;
        self.thin |= other.thin;
        self.deep |= other.deep;
    }
}
