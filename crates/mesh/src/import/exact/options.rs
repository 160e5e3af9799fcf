//! Options for building an exact model, and the counts of a built one.

use std::collections::BTreeSet;

use spinney_base::space::Up;
use spinney_brep::{BuildReport, Grid, InsideRule, LEAF_SIZE, Repair};
use spinney_container::Codec;
use spinney_crs::Crs;

use super::SkippedObject;
use crate::import::DEFAULT_MEMORY;

/// Options for building an exact model.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ExactOptions {
    /// Grid unit, in units of the models. By default it is the grid of the files themselves, if
    /// they have a common one (CityJSON, exact models) that is not too fine. Otherwise it is the
    /// smallest power of two with which the longest side has at most about 2^24 grid units.
    pub snap: Option<f64>,
    /// Whether open surfaces are closed by triangles over their boundaries.
    pub close: bool,
    /// Whether a surface that intersects itself, overlaps itself, or is partly inside out is
    /// resolved: see [`RepairInput::repair`](spinney_brep::RepairInput::repair).
    pub repair: bool,
    /// Rule by which a repair determines the inside.
    pub inside: InsideRule,
    /// Parts to include, numbered consecutively over all files; by default all.
    pub parts: Option<BTreeSet<u32>>,
    /// Whether objects that are not bodies by themselves are left out: open objects unless `close`
    /// is set, and self-intersecting or inverted objects unless `repair` is set. Faces are then
    /// held in memory while objects are checked.
    pub skip_bad: bool,
    /// Maximum number of faces in a leaf cell, regardless of whether their planes intersect: see
    /// [`ModelBuilder::leaf_size`](spinney_brep::ModelBuilder::leaf_size).
    pub leaf_size: usize,
    /// Axis of the models that points up; y is rotated to z.
    pub up: Up,
    /// Unit of length of the models' coordinates, stored in the file.
    pub unit: Option<String>,
    /// Coordinate system; by default the models' own.
    pub crs: Option<Crs>,
    /// Compression of the file.
    pub codec: Codec,
    /// Total memory in bytes.
    pub memory: u64,
}

impl Default for ExactOptions {
    fn default() -> Self {
        let (snap, close, repair, inside) = (None, false, false, InsideRule::default());
        let (parts, skip_bad) = (None, false);
        let (up, unit, crs) = (Up::default(), None, None);
        let (leaf_size, codec, memory) = (LEAF_SIZE, Codec::default(), DEFAULT_MEMORY);
        ExactOptions { snap, close, repair, inside, parts, skip_bad, leaf_size, up, unit, crs, codec, memory }
    }
}

impl ExactOptions {
    /// Unchanged faces on the finest grid.
    pub fn new() -> ExactOptions {
        ExactOptions::default()
    }
}

/// Counts of an exact model that was built.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ExactReport {
    /// Faces that were read.
    pub read: u64,
    /// Faces of the model.
    pub faces: u64,
    /// Faces that were left out: on the grid they are points or lines whose edges cancel.
    pub collapsed: u64,
    /// Faces of the model without area on the grid; they keep adjacent faces connected.
    pub slivers: u64,
    /// Faces that are not planar on the grid and were triangulated.
    pub cut: u64,
    /// Faces whose rings intersect and were cut into triangle fans.
    pub fanned: u64,
    /// Objects of the model.
    pub objects: u64,
    /// Objects that were left out because they are not bodies.
    pub skipped: Vec<SkippedObject>,
    /// Parts with attributes.
    pub attributes: u64,
    /// Values of faces that were dropped because they are invalid or too long.
    pub lost_values: u64,
    /// Boundaries that were closed, and the triangles that close them.
    pub closed: (u64, u64),
    /// Counts of the repair, if one was requested.
    pub repair: Option<Repair>,
    /// If the surface was repaired or closed: the volume of the models' cells, by winding numbers
    /// with 128 cells along the longest side, and its maximum error.
    pub cells: Option<[f64; 2]>,
    /// Maximum distance that a vertex was moved to the grid, in the models' unit.
    pub displacement: f64,
    /// The grid.
    pub grid: Grid,
    /// Unit of length of the models, if known: "mm".
    pub unit: Option<String>,
    /// Counts of the octree.
    pub built: BuildReport,
}
