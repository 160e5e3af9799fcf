//! Winding numbers at the lattice points of a block, and along lines.
//!
//! The winding number at the block's first lattice point is known. Crossings along z lead to the
//! first point of every slice, from there crossings along y to the first point of every row, and
//! crossings along x through the rows.

use super::grid::Triangle;
use super::inside::State;
use spinney_base::{Progress, Result, sort};
use spinney_brep::exact::lattice::{Lattice, Projected};
use spinney_brep::exact::vector::ascending_others;

/// Crossing of a line with a triangle.
#[derive(Clone, Copy)]
struct Crossing {
    /// Index of the line.
    line: u32,
    /// Number of lattice points before it.
    before: u16,
    change: i32,
    attribute: u32,
}

/// Number of crossings that are buffered before those at one point are summed. Many triangles that
/// all cover the block must not take more memory than its lattice.
const MANY: usize = 1 << 20;

/// Sums the changes at one point with the same attribute.
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

/// Crossings of many lines, in order along each line.
struct Crossings {
    sorted: Vec<Crossing>,
    /// First crossing of each line, then the total number of crossings.
    starts: Vec<u32>,
}

impl Crossings {
    /// Sorts by line, then along the line. Where several triangles are met at one point, exits come
    /// first: touching bodies are left before the next one is entered.
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

/// Crossings of a lattice's lines along `D` with all triangles. `count` is the number of lines
/// along the other two axes.
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
            // Crossings before the first point or after the last one do not matter here.
            if before > 0 && before < points {
                let line = (v * count[0] + u) as u32;
                let attribute = triangle.attribute;
                crossings.push(Crossing { line, before: before as u16, change, attribute });
            }
        });
    }
    Ok(Crossings::new(&crossings, count[0] * count[1]))
}

/// Follows a line from a state. Passes each run of points and its state to `each`, and returns the
/// last state.
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

/// Passes the runs of constant state in all rows of a block's lattice to `each`: the row's position
/// along y and z, the run's start and end along x, and the state. Rows without crossings and with
/// winding number 0 are left out.
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

/// Winding numbers at a block's lattice points, x fastest, then y, then z. The lattice must have
/// one point per cell.
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

/// Change of the winding number from one point to the coordinate of another along the axis `D`.
/// Moves the first point there.
pub(super) fn change<const D: usize>(triangles: &[Triangle], from: &mut [i32; 3], to: [i32; 3]) -> i32 {
    let mut end = *from;
    end[D] = to[D];
    let [u, v] = ascending_others(D);
    // Most triangles are not near the line.
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
