//! Fills one block: from the triangles that touch it to its cells.
//!
//! The winding number at the block's first lattice point is known. Crossings along z lead to the first point
//! of every slice, from there crossings along y to the first point of every row, and crossings along x
//! through the rows.

use super::bits::{Bits, Cells};
use super::coverage::{Cube, Test};
use super::grid::Triangle;
use super::inside::{Attribute, Boundary, FULL, FillOptions, Inside, State};
use spinney_base::{Progress, Result, sort};
use spinney_brep::exact::lattice::{Lattice, Projected};
use spinney_brep::exact::vector::ascending_others;
use spinney_brep::geometry::triangle;

/// Crossing of a line with a triangle.
#[derive(Clone, Copy)]
struct Crossing {
    /// Number of the line.
    line: u32,
    /// Lattice points before it.
    before: u16,
    change: i32,
    attribute: u32,
}

/// Crossings that are kept before those at one point are added up: many triangles that all cover the
/// block must not take more memory than its lattice.
const MANY: usize = 1 << 20;

/// Adds up the changes at one point and of one attribute.
fn add_up(crossings: &mut Vec<Crossing>) {
    let key = |crossing: &Crossing| (crossing.line, crossing.before, crossing.attribute);
    crossings.sort_unstable_by_key(key);
    crossings.dedup_by(|next, sum| {
        let same = key(next) == key(sum);
        if same {
            sum.change += next.change;
        }
        same
    });
    crossings.retain(|crossing| crossing.change != 0);
}

/// Crossings of many lines, in the order in which one meets them.
struct Crossings {
    sorted: Vec<Crossing>,
    /// Index of each line's first crossing; one more than there are lines.
    starts: Vec<u32>,
}

impl Crossings {
    /// Sorts by line, along the line, and where several triangles meet it at one point, those that are left
    /// first: touching bodies are left before the next is entered.
    fn new(crossings: &[Crossing], lines: usize) -> Crossings {
        let mut starts = vec![0u32; lines + 1];
        for crossing in crossings {
            starts[crossing.line as usize + 1] += 1;
        }
        for line in 0..lines {
            starts[line + 1] += starts[line];
        }
        let mut next = starts.clone();
        let nothing = Crossing { line: 0, before: 0, change: 0, attribute: 0 };
        let mut sorted = vec![nothing; crossings.len()];
        for crossing in crossings {
            let index = &mut next[crossing.line as usize];
            sorted[*index as usize] = *crossing;
            *index += 1;
        }
        for line in 0..lines {
            let range = starts[line] as usize..starts[line + 1] as usize;
            if range.len() > 1 {
                sort::by_wide_key(&mut sorted[range], |crossing| {
                    let upper =
                        u64::from(crossing.before) << 32 | u64::from(crossing.change as u32 ^ 1 << 31);
                    u128::from(upper) << 32 | u128::from(crossing.attribute)
                });
            }
        }
        Crossings { sorted, starts }
    }

    fn of(&self, line: usize) -> &[Crossing] {
        &self.sorted[self.starts[line] as usize..self.starts[line + 1] as usize]
    }
}

/// The crossings of a lattice's lines along `D`, `count` of them along the other two axes, with all
/// triangles.
fn cross<const D: usize>(
    triangles: &[Triangle],
    lattice: &Lattice,
    first: [i32; 3],
    count: [usize; 2],
    points: usize,
    progress: &dyn Progress,
) -> Result<Crossings> {
    let mut crossings = Vec::new();
    let mut many = MANY;
    for triangle in triangles {
        if crossings.len() > many {
            add_up(&mut crossings);
            many = MANY.max(2 * crossings.len());
        }
        // Most triangles do not reach the few lines along y and z.
        let alone = |axis: usize| triangle.min(axis) <= first[axis] && first[axis] <= triangle.max(axis);
        if (D == 1 && !alone(0)) || (D == 2 && !(alone(0) && alone(1))) {
            continue;
        }
        let Some(projected) = Projected::<D>::new(&triangle.corners) else { continue };
        progress.check()?;
        let change = projected.change();
        projected.rows(lattice, first, count, points, |u, v, before| {
            // Those before the first point or behind the last change nothing here.
            if before > 0 && before < points {
                let line = (v * count[0] + u) as u32;
                let attribute = triangle.attribute;
                crossings.push(Crossing { line, before: before as u16, change, attribute });
            }
        });
    }
    Ok(Crossings::new(&crossings, count[0] * count[1]))
}

/// Goes along a line from a state: hands out the state and where it ends, for each run, and returns the
/// last.
fn walk(
    mut state: State,
    line: &[Crossing],
    mut each: impl FnMut(State, usize, usize),
    points: usize,
) -> State {
    let mut from = 0;
    for crossing in line {
        let to = crossing.before as usize;
        if to > from {
            each(state, from, to);
            from = to;
        }
        state.pass(crossing.change, crossing.attribute);
    }
    each(state, from, points);
    state
}

/// Hands out the runs of all rows of a block's lattice along which the state is the same: the row along
/// y and z, where it begins and ends along x, and the state. Rows without a crossing and with no winding are
/// left out.
pub(super) fn each_run(
    lattice: &Lattice,
    triangles: &[Triangle],
    min: [i32; 3],
    height: u8,
    state: State,
    progress: &dyn Progress,
    mut each: impl FnMut(usize, usize, usize, usize, State),
) -> Result<()> {
    let first = lattice.first(min);
    let points = lattice.per_cell.map(|bits| 1usize << (height + bits));
    let along_z = cross::<2>(triangles, lattice, first, [1, 1], points[2], progress)?;
    let along_y = cross::<1>(triangles, lattice, first, [1, points[2]], points[1], progress)?;
    let along_x = cross::<0>(triangles, lattice, first, [points[1], points[2]], points[0], progress)?;
    let mut slices = vec![state; points[2]];
    walk(state, along_z.of(0), |state, from, to| slices[from..to].fill(state), points[2]);
    let mut rows = vec![state; points[1]];
    for (z, slice) in slices.into_iter().enumerate() {
        progress.check()?;
        walk(slice, along_y.of(z), |state, from, to| rows[from..to].fill(state), points[1]);
        for (y, row) in rows.iter().enumerate() {
            let line = along_x.of(z * points[1] + y);
            if !line.is_empty() || row.winding != 0 {
                walk(*row, line, |state, from, to| each(y, z, from, to, state), points[0]);
            }
        }
    }
    Ok(())
}

/// The winding numbers at a block's lattice points, x fastest, then y, then z; the lattice has one in each cell.
pub(super) fn windings_at_centres(
    lattice: &Lattice,
    triangles: &[Triangle],
    min: [i32; 3],
    height: u8,
    state: State,
    progress: &dyn Progress,
) -> Result<Vec<i32>> {
    let mut windings = vec![0; 1 << (3 * height)];
    each_run(lattice, triangles, min, height, state, progress, |y, z, from, to, state| {
        windings[(z << height | y) << height..][from..to].fill(state.winding);
    })?;
    Ok(windings)
}

/// The cells of a block with their coverage.
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

/// The occupancy of a cell of which so much is inside.
pub(super) fn occupancy(share: f64) -> u32 {
    (share * f64::from(FULL)).round() as u32
}

/// Change of the winding number from one point to the coordinate of another along the axis `D`; moves the
/// first point there.
pub(super) fn change<const D: usize>(triangles: &[Triangle], from: &mut [i32; 3], to: [i32; 3]) -> i32 {
    let mut end = *from;
    end[D] = to[D];
    let [u, v] = ascending_others(D);
    // Most are somewhere else.
    let is_near = |triangle: &&Triangle| {
        [u, v].iter().all(|axis| triangle.min(*axis) <= end[*axis] && end[*axis] <= triangle.max(*axis))
    };
    let passed = triangles.iter().filter(is_near).filter_map(|triangle| {
        let projected = Projected::<D>::new(&triangle.corners).filter(|projected| projected.is_met(end))?;
        Some(
            projected.change()
                * (i32::from(projected.is_beyond(end)) - i32::from(projected.is_beyond(*from))),
        )
    });
    let change = passed.sum();
    *from = end;
    change
}

/// The cells of a block that begins at the grid point `min` and has `2^height` cells along each axis; `state`
/// is that of its first lattice point.
pub(super) fn block(
    (fill, inside): (&FillOptions<'_>, &Inside),
    triangles: &[Triangle],
    min: [i32; 3],
    height: u8,
    state: State,
) -> Result<Cells> {
    if fill.boundary == Boundary::Coverage && !fill.surface {
        return covered((fill, inside), triangles, min, height, state);
    }
    let mut painter = Painter::new(fill, height);
    if !fill.surface {
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

/// A triangle that may cut several cells.
struct Cut {
    corners: [[i64; 3]; 3],
    /// The first cell's corner, and the width of a cell.
    min: [i32; 3],
    cell: i32,
    /// The cells that its box reaches: from the first up to, not including, the last.
    from: [usize; 3],
    to: [usize; 3],
}

/// Hands out the cells that a triangle cuts, of a block that begins at `min` and has `2^height` cells along each axis.
fn each_cut(triangle: &Triangle, min: [i32; 3], cell: i32, height: u8, each: &mut dyn FnMut([usize; 3])) {
    let side = 1i32 << height;
    let mut from = [0usize; 3];
    let mut to = [0usize; 3];
    for axis in 0..3 {
        let (low, high) =
            (triangle.min(axis) as i64 - min[axis] as i64, triangle.max(axis) as i64 - min[axis] as i64);
        let cell = cell as i64;
        // Open cells: a triangle that ends on a wall does not reach the cell behind it, nor does one that
        // lies in it.
        let first = low.div_euclid(cell).max(0);
        let end = (high + cell - 1).div_euclid(cell).min(side as i64);
        if first >= end || (low == high && low.rem_euclid(cell) == 0) {
            return;
        }
        (from[axis], to[axis]) = (first as usize, end as usize);
    }
    if (0..3).all(|axis| to[axis] - from[axis] == 1) {
        // A triangle in one cell, and not in its walls.
        return each(from);
    }
    // (Wide: the cut test multiplies differences.)
    let corners = triangle.corners.map(|corner| corner.map(i64::from));
    Cut { corners, min, cell, from, to }.descend([0; 3], height, each);
}

impl Cut {
    /// Hands out those of a node of cells whose first cell is at `at`.
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

/// The cells of a block that triangles cut.
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

    /// Cells `from .. to` of a row are inside.
    #[inline]
    fn row(&mut self, y: usize, z: usize, from: usize, to: usize, attribute: u32) {
        let height = self.cells.height;
        let row = z << height | y;
        self.cells.rows[row] |= Bits::run(from, to);
        if let Some(values) = &mut self.values {
            values[row << height..][from..to].fill(attribute);
        }
    }

    /// Rasterises the surface: marks the cells that it cuts, or gives cells of the solid its colour.
    pub(super) fn surface(&mut self, triangles: &[Triangle], min: [i32; 3]) -> Result<()> {
        let fill = self.fill;
        if fill.surface || fill.boundary == Boundary::Full || fill.attribute == Attribute::Colour {
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
        if is_new && !fill.surface && fill.boundary != Boundary::Full {
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
        } else if fill.surface {
            // The least of several parts, whatever the order of the triangles.
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

/// The bits of a value that are a colour; above them stands how many colours were blended.
const COLOUR: u32 = 0x00ff_ffff;

/// The mean of the colours that were blended already and another one.
fn blend(value: u32, colour: u32) -> u32 {
    // The count has 8 bits: from 255 colours on, each further one has the weight of a 255th.
    let count = (value >> 24).min(254);
    let channel = |shift: u32| {
        let (old, new) = (value >> shift & 255, colour >> shift & 255);
        ((old * count + new + count.div_ceil(2)) / (count + 1)) << shift
    };
    (count + 1) << 24 | channel(16) | channel(8) | channel(0)
}
