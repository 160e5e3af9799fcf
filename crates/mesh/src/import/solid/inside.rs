//! Rules for which cells belong to a solid, and for their values.

use std::str::FromStr;
use std::sync::Arc;

use super::field::WindingField;
use super::grid::Grid;
use serde::{Deserialize, Serialize};
use spinney_base::space::EdgeRule;
use spinney_base::{Error, Progress, Result};
use spinney_brep::exact::lattice::Lattice;

/// Occupancy of a cell that is full.
pub(super) const FULL: u32 = 255;

/// Meaning of the values of a solid's cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Attribute {
    /// Share of the cell that is filled, from 0 to 255.
    #[default]
    Occupancy,
    /// Colour of the surface; inside, that of the face behind which a cell lies: the nearest such face in open
    /// objects, the last one before it in closed ones.
    Colour,
    /// Number of the part of the model, from 1.
    Part,
}

impl Attribute {
    /// All of them.
    pub const ALL: [Attribute; 3] = [Attribute::Occupancy, Attribute::Colour, Attribute::Part];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        ["occupancy", "colour", "part"][self as usize]
    }
}

impl FromStr for Attribute {
    type Err = Error;

    fn from_str(name: &str) -> Result<Attribute> {
        let found = Attribute::ALL.into_iter().find(|attribute| attribute.name() == name);
        let expected = || Attribute::ALL.map(Attribute::name).join(", ");
        found.ok_or_else(|| Error::invalid("attribute", format!("`{name}`"), expected()))
    }
}

/// Rule for what lies inside a surface.
#[derive(Clone, Debug)]
pub(super) enum Inside {
    /// Winding numbers other than zero.
    Winding,
    /// An odd number of crossings.
    Parity,
    /// A winding field of at least one half, or at most minus one half, within the box around the surface: for
    /// those that are not closed.
    Field(Arc<WindingField>),
}

/// Parameters for filling nodes.
#[derive(Clone)]
pub(super) struct FillOptions<'a> {
    pub(super) grid: Grid,
    pub(super) lattice: Lattice,
    pub(super) edge: EdgeRule,
    pub(super) attribute: Attribute,
    /// Only the cells that the surface cuts.
    pub(super) shell: bool,
    /// Asked for each triangle and cube of cells whether to go on: a single block can take a minute where very
    /// many triangles are.
    pub(super) progress: &'a dyn Progress,
}

impl FillOptions<'_> {
    /// Grid steps along a cell.
    pub(super) fn cell(&self) -> i32 {
        self.grid.cell()
    }
}

impl Inside {
    /// Whether a winding number is one of the inside.
    #[inline]
    pub(super) fn has(&self, winding: i32) -> bool {
        match self {
            Inside::Parity => winding & 1 != 0,
            _ => winding != 0,
        }
    }
}

/// Winding number and attribute at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct State {
    pub(super) winding: i32,
    /// Attribute of the face through which the solid was entered last.
    pub(super) attribute: u32,
    /// Whether only even and odd count, of faces that are turned either way: winding numbers are 0 or 1.
    pub(super) by_parity: bool,
}

impl State {
    /// The state outside.
    pub(super) fn outside(inside: &Inside) -> State {
        State { by_parity: matches!(inside, Inside::Parity), ..State::default() }
    }

    /// Goes through a face.
    #[inline]
    pub(super) fn pass(&mut self, change: i32, attribute: u32) {
        if self.winding == 0 {
            self.attribute = attribute;
        }
        self.winding += change;
        if self.by_parity {
            self.winding &= 1;
        }
    }
}
