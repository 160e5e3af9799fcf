//! Rules for which cells belong to a solid, and for their values.

use std::str::FromStr;
use std::sync::Arc;

use super::field::WindingField;
use super::grid::Grid;
use serde::{Deserialize, Serialize};
use spinney_base::space::EdgeRule;
use spinney_base::{Error, Progress, Result};
use spinney_brep::exact::lattice::Lattice;

/// Occupancy of a full cell.
pub(super) const FULL: u32 = 255;

/// Meaning of the values of a solid's cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Attribute {
    /// Filled fraction of the cell, from 0 to 255.
    #[default]
    Occupancy,
    /// Colour of the surface. Interior cells have the colour of a face. In open objects, it is the
    /// nearest face with the cell on its inner side. In closed objects, it is the face through
    /// which the scan along z, y and x last entered the solid.
    Colour,
    /// Number of the part of the model, from 1.
    #[serde(rename = "part")]
    PartNumber,
}

impl Attribute {
    /// All attributes.
    pub const ALL: [Attribute; 3] = [Attribute::Occupancy, Attribute::Colour, Attribute::PartNumber];

    /// Name on the command line.
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

/// Rule for what is inside a surface.
#[derive(Clone, Debug)]
pub(super) enum Inside {
    /// Nonzero winding numbers.
    Winding,
    /// Odd number of crossings.
    Parity,
    /// Winding field of at least one half or at most minus one half, within the surface's bounding
    /// box. For surfaces that are not closed.
    Field(Arc<WindingField>),
}

/// Parameters for filling nodes.
#[derive(Clone)]
pub(super) struct FillOptions<'a> {
    pub(super) grid: Grid,
    pub(super) lattice: Lattice,
    pub(super) edge: EdgeRule,
    pub(super) attribute: Attribute,
    /// Whether to fill only the cells that the surface cuts.
    pub(super) shell: bool,
    /// Checked for cancellation at each triangle and cube of cells: a single block with very many
    /// triangles can take a minute.
    pub(super) progress: &'a dyn Progress,
}

impl FillOptions<'_> {
    /// Width of a cell in grid units.
    pub(super) fn cell(&self) -> i32 {
        self.grid.cell()
    }
}

impl Inside {
    /// Whether a winding number means inside.
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
    /// Attribute of the face through which the solid was last entered.
    pub(super) attribute: u32,
    /// Whether only parity counts, for faces of inconsistent orientation. Winding numbers are then
    /// 0 or 1.
    pub(super) by_parity: bool,
}

impl State {
    /// State outside of the solid.
    pub(super) fn outside(inside: &Inside) -> State {
        State { by_parity: matches!(inside, Inside::Parity), ..State::default() }
    }

    /// Crosses a face.
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
