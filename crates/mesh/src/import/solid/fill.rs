//! Fills a block of cells from the triangles that touch it.

use super::bits::{Bits, Cells};
use super::coverage::{Cube, Test};
use super::grid::Triangle;
use super::inside::{Attribute, FULL, FillOptions, Inside, State};
use super::windings::{each_run, windings_at_centres};
use spinney_base::space::EdgeRule;
use spinney_base::{Progress, Result};
use spinney_brep::geometry::triangle;

/// Cells of a block with their coverage.
fn covered(
    (fill, inside): (&FillOptions<'_>, &Inside),
    triangles: &[Triangle],
    min: [i32; 3],
    height: u8,
    state: State,
) -> Result<Cells> {
    let windings = windings_at_centres(&fill.lattice, triangles, min, height, state, fill.progress)?;
    let cube = Cube { triangles, min, cell: fill.cell(), height };
    let shares = cube.shares(&windings, Test { inside, progress: fill.progress })?;
    let values: Vec<u32> = shares.into_iter().map(occupancy).collect();
    let mut bits = Bits::new(height);
    for (row, values) in bits.rows.iter_mut().zip(values.chunks_exact(1 << height)) {
        *row = values.iter().enumerate().fold(0, |bits, (x, value)| bits | u64::from(*value > 0) << x);
    }
    Ok(Cells { bits, values: Some(values) })
}

/// Occupancy of a cell, from the fraction that is inside.
pub(super) fn occupancy(share: f64) -> u32 {
    (share * f64::from(FULL)).round() as u32
}

/// Cells of a block whose minimum corner is the grid point `min`, with `2^height` cells along each
/// axis. `state` is the state at its first lattice point.
pub(super) fn block(
    (fill, inside): (&FillOptions<'_>, &Inside),
    triangles: &[Triangle],
    min: [i32; 3],
    height: u8,
    state: State,
) -> Result<Cells> {
    if fill.edge == EdgeRule::Area && !fill.shell {
        return covered((fill, inside), triangles, min, height, state);
    }
    let mut painter = Painter::new(fill, height);
    if !fill.shell {
        each_run(&fill.lattice, triangles, min, height, state, fill.progress, |y, z, from, to, state| {
            if inside.has(state.winding) {
                painter.row(y, z, from, to, state.attribute);
            }
        })?;
    }
    painter.surface(triangles, min)?;
    Ok(painter.finish())
}

/// Cells and values of a block while it is filled.
pub(super) struct Painter<'a> {
    fill: &'a FillOptions<'a>,
    pub(super) cells: Bits,
    pub(super) values: Option<Vec<u32>>,
}

/// Triangle that may cut several cells.
struct Cut {
    corners: [[i64; 3]; 3],
    /// Minimum corner of the first cell, and the width of a cell.
    min: [i32; 3],
    cell: i32,
    /// Cells that its bounding box reaches: the first, and the end (exclusive).
    from: [usize; 3],
    to: [usize; 3],
}

/// Passes the cells that a triangle cuts to `each`, in a block that starts at `min` and has
/// `2^height` cells along each axis.
fn each_cut(triangle: &Triangle, min: [i32; 3], cell: i32, height: u8, each: &mut dyn FnMut([usize; 3])) {
    let side = 1i32 << height;
    let mut from = [0usize; 3];
    let mut to = [0usize; 3];
    for axis in 0..3 {
        let (low, high) =
            (triangle.min(axis) as i64 - min[axis] as i64, triangle.max(axis) as i64 - min[axis] as i64);
        let cell = cell as i64;
        // Cells are open sets: a triangle that ends at a wall, or lies in it, does not reach the
        // cell beyond.
        let first = low.div_euclid(cell).max(0);
        let end = (high + cell - 1).div_euclid(cell).min(side as i64);
        if first >= end || (low == high && low.rem_euclid(cell) == 0) {
            return;
        }
        (from[axis], to[axis]) = (first as usize, end as usize);
    }
    if (0..3).all(|axis| to[axis] - from[axis] == 1) {
        // The triangle is in a single cell, and not in its walls.
        return each(from);
    }
    // (Widened, since the cut test multiplies differences.)
    let corners = triangle.corners.map(|corner| corner.map(i64::from));
    Cut { corners, min, cell, from, to }.descend([0; 3], height, each);
}

impl Cut {
    /// Visits the cut cells in the node whose first cell is `at`.
    fn descend(&self, at: [usize; 3], height: u8, each: &mut dyn FnMut([usize; 3])) {
        let side = 1usize << height;
        if (0..3).any(|axis| at[axis] >= self.to[axis] || at[axis] + side <= self.from[axis]) {
            return;
        }
        let cell = i64::from(self.cell);
        let low: [i64; 3] = std::array::from_fn(|axis| i64::from(self.min[axis]) + at[axis] as i64 * cell);
        let high = low.map(|low| low + side as i64 * cell);
        if !triangle::cuts(&self.corners, low, high) {
            return;
        }
        if height == 0 {
            return each(at);
        }
        for child in 0..8 {
            let at = std::array::from_fn(|axis| at[axis] + (child >> axis & 1) * side / 2);
            self.descend(at, height - 1, each);
        }
    }
}

/// Cells of a block that triangles cut.
pub(super) fn cut_cells(
    triangles: &[Triangle],
    min: [i32; 3],
    cell: i32,
    height: u8,
    progress: &dyn Progress,
) -> Result<Bits> {
    let mut cut = Bits::new(height);
    for triangle in triangles {
        progress.check()?;
        each_cut(triangle, min, cell, height, &mut |at| cut.set(at));
    }
    Ok(cut)
}

impl<'a> Painter<'a> {
    pub(super) fn new(fill: &'a FillOptions<'a>, height: u8) -> Self {
        let values = (fill.attribute != Attribute::Occupancy).then(|| vec![0; 1 << (3 * height)]);
        Painter { fill, cells: Bits::new(height), values }
    }

    /// Marks the cells `from .. to` of a row as inside.
    #[inline]
    fn row(&mut self, y: usize, z: usize, from: usize, to: usize, attribute: u32) {
        let height = self.cells.height;
        let row = z << height | y;
        self.cells.rows[row] |= Bits::run(from, to);
        if let Some(values) = &mut self.values {
            values[row << height..][from..to].fill(attribute);
        }
    }

    /// Rasterizes the surface: marks the cells that it cuts, or applies its colour to cells of the
    /// solid.
    pub(super) fn surface(&mut self, triangles: &[Triangle], min: [i32; 3]) -> Result<()> {
        let fill = self.fill;
        if fill.shell || fill.edge == EdgeRule::Touch || fill.attribute == Attribute::Colour {
            for triangle in triangles {
                fill.progress.check()?;
                let height = self.cells.height;
                each_cut(triangle, min, fill.cell(), height, &mut |at| self.mark(at, triangle.attribute));
            }
        }
        Ok(())
    }

    fn mark(&mut self, at: [usize; 3], attribute: u32) {
        let fill = self.fill;
        let is_new = !self.cells.get(at);
        if is_new && !fill.shell && fill.edge != EdgeRule::Touch {
            return;
        }
        self.cells.set(at);
        let Some(values) = &mut self.values else { return };
        let height = self.cells.height;
        let value = &mut values[(at[2] << height | at[1]) << height | at[0]];
        if fill.attribute == Attribute::Colour {
            *value = blend(*value, attribute);
        } else if is_new {
            *value = attribute;
        } else if fill.shell {
            // The minimum of several parts, so that the order of triangles does not matter.
            *value = attribute.min(*value);
        }
    }

    pub(super) fn finish(mut self) -> Cells {
        if self.fill.attribute == Attribute::Colour {
            self.values.iter_mut().flatten().for_each(|value| *value &= COLOUR);
        }
        Cells { bits: self.cells, values: self.values }
    }
}

/// Colour bits of a value. The bits above are the number of blended colours.
const COLOUR: u32 = 0x00ff_ffff;

/// Mean of the colours that are already blended and another one.
fn blend(value: u32, colour: u32) -> u32 {
    // The count has 8 bits. From the 255th colour on, each further colour has a weight of 1/255.
    let count = (value >> 24).min(254);
    let channel = |shift: u32| {
        let (old, new) = (value >> shift & 255, colour >> shift & 255);
        ((old * count + new + count.div_ceil(2)) / (count + 1)) << shift
    };
    (count + 1) << 24 | channel(16) | channel(8) | channel(0)
}
