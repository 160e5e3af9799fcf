//! Components of one block's cells, found by the runs of equal cells in its rows.

use std::ops::Range;

use super::border::{Borders, ComponentSpan, Span, in_common, touching};
use spinney_base::sort;
use spinney_base::space::{Dimension, morton_encode};
use spinney_base::value::Value;

/// Run of equal cells in a row that are not VOID.
struct LocalSpan {
    start: u16,
    end: u16,
    component: u32,
}

impl Span for LocalSpan {
    fn start(&self) -> u32 {
        self.start.into()
    }

    fn end(&self) -> u32 {
        self.end.into()
    }
}

/// Component of a block's cells.
#[derive(Clone, Debug)]
pub(super) struct Component {
    /// Index of its first cell in Z order.
    pub(super) first: u64,
    pub(super) cells: u64,
    pub(super) value: Value,
    /// Whether it has cells at the block's border.
    pub(super) is_at_border: bool,
}

/// Size of the cache of recent pairs, a power of two.
const RECENT_PAIRS: usize = 1024;

/// Two components of a block that touch, the lower number first, and the number of cell faces that
/// they share.
#[derive(Clone, Copy)]
pub(super) struct Pair {
    pub(super) components: [u32; 2],
    pub(super) faces: u64,
}

/// Components of a block, ordered by their first cells in Z order.
pub(super) struct Local {
    axes: usize,
    side: u32,
    /// First run of each row, and the end of the last.
    rows: Vec<u32>,
    runs: Vec<LocalSpan>,
    pub(super) components: Vec<Component>,
}

impl Local {
    /// Components of a block with `height` levels, whose cells are given in rows. Cells touch
    /// others that are at most `reach` cells away along the other axes.
    pub(super) fn new(
        dimension: Dimension,
        height: u8,
        width: usize,
        (values, valid): (&[u8], &[bool]),
        reach: u32,
    ) -> Local {
        let side = 1u32 << height;
        let mut local =
            Local { axes: dimension.axes(), side, rows: vec![0], runs: Vec::new(), components: Vec::new() };
        let parents = match width {
            1 => local.find_runs::<1>(values, valid, reach),
            2 => local.find_runs::<2>(values, valid, reach),
            3 => local.find_runs::<3>(values, valid, reach),
            4 => local.find_runs::<4>(values, valid, reach),
            6 => local.find_runs::<6>(values, valid, reach),
            8 => local.find_runs::<8>(values, valid, reach),
            12 => local.find_runs::<12>(values, valid, reach),
            _ => local.find_runs::<16>(values, valid, reach),
        };
        local.number(dimension, width, values, parents);
        local
    }

    /// Finds the runs of all rows. Returns the union-find parent of each: an earlier run, or
    /// itself. Compiled for each width of values.
    fn find_runs<const WIDTH: usize>(&mut self, values: &[u8], valid: &[bool], reach: u32) -> Vec<u32> {
        let (values, _) = values.as_chunks::<WIDTH>();
        let side = self.side as usize;
        let mut parents: Vec<u32> = Vec::new();
        let mut changes = vec![0u8; side.next_multiple_of(8)];
        for (row, (cells, valid)) in values.chunks_exact(side).zip(valid.chunks_exact(side)).enumerate() {
            // (Changes are marked first, without an early exit, so that the compiler vectorizes the
            // loop.)
            let pairs = cells.iter().zip(&cells[1..]).zip(valid.iter().zip(&valid[1..]));
            for (change, ((a, b), (is_a, is_b))) in changes[1..].iter_mut().zip(pairs) {
                *change = u8::from(a != b) | u8::from(is_a != is_b);
            }
            let mut start = 0;
            let mut end_at = |end: usize| {
                if valid[start] {
                    let component = self.runs.len() as u32;
                    self.runs.push(LocalSpan { start: start as u16, end: end as u16, component });
                    parents.push(component);
                }
                start = end;
            };
            for (at, eight) in changes.as_chunks::<8>().0.iter().enumerate() {
                let mut left = u64::from_le_bytes(*eight);
                while left > 0 {
                    end_at(8 * at + left.trailing_zeros() as usize / 8);
                    left &= left - 1;
                }
            }
            end_at(side);
            self.rows.push(self.runs.len() as u32);
            for before in self.rows_before(row, reach) {
                touching(&self.runs[self.row(before)], &self.runs[self.row(row)], reach, |a, b| {
                    let value_of_a = values[before * side + usize::from(a.start)];
                    // (Most runs that touch have the same parent already.)
                    if value_of_a == values[row * side + usize::from(b.start)]
                        && parents[a.component as usize] != parents[b.component as usize]
                    {
                        let (a, b) = (root(&mut parents, a.component), root(&mut parents, b.component));
                        parents[a.max(b) as usize] = a.min(b);
                    }
                });
            }
        }
        parents
    }

    /// Position of a row along the other axes.
    fn place(&self, row: usize) -> [u32; 2] {
        let row = row as u32;
        [row & (self.side - 1), row >> self.side.ilog2()]
    }

    /// Earlier rows whose cells touch those of a row.
    fn rows_before(&self, row: usize, reach: u32) -> impl Iterator<Item = usize> + use<> {
        let side = self.side as usize;
        let [y, z] = self.place(row);
        let diagonal = z > 0 && reach > 0;
        let candidates = [
            (y > 0).then(|| row - 1),
            (z > 0).then(|| row - side),
            (diagonal && y > 0).then(|| row - side - 1),
            (diagonal && y + 1 < self.side).then(|| row - side + 1),
        ];
        candidates.into_iter().flatten()
    }

    fn row(&self, row: usize) -> Range<usize> {
        self.rows[row] as usize..self.rows[row + 1] as usize
    }

    fn count_rows(&self) -> usize {
        self.rows.len() - 1
    }

    /// Numbers the components in Z order of their first cells.
    fn number(&mut self, dimension: Dimension, width: usize, values: &[u8], mut parents: Vec<u32>) {
        let side = self.side;
        // (Parents are earlier runs, which have their component already: its number replaces the
        // parent.)
        let encoded: Vec<u64> = (0..side).map(|place| morton_encode(dimension, place)).collect();
        let last = side - 1;
        for row in 0..self.count_rows() {
            let [y, z] = self.place(row);
            let high = encoded[y as usize] << 1 | if self.axes > 2 { encoded[z as usize] << 2 } else { 0 };
            let is_outer = y == 0 || y == last || self.axes > 2 && (z == 0 || z == last);
            for number in self.row(row) {
                let run = &mut self.runs[number];
                let at = row * side as usize + usize::from(run.start);
                let first = encoded[usize::from(run.start)] | high;
                let parent = parents[number];
                run.component = match parent as usize == number {
                    true => {
                        let value = Value::from_bytes(&values[at * width..][..width]);
                        self.components.push(Component { first, cells: 0, value, is_at_border: false });
                        self.components.len() as u32 - 1
                    }
                    false => parents[parent as usize],
                };
                parents[number] = run.component;
                let component = &mut self.components[run.component as usize];
                component.first = component.first.min(first);
                component.cells += u64::from(run.end - run.start);
                component.is_at_border |= is_outer || run.start == 0 || run.end() == side;
            }
        }
        let mut order: Vec<u32> = (0..self.components.len() as u32).collect();
        sort::by_key(&mut order, |number| self.components[*number as usize].first);
        let mut ranks = vec![0; order.len()];
        for (rank, number) in order.iter().enumerate() {
            ranks[*number as usize] = rank as u32;
        }
        self.components = order.iter().map(|number| self.components[*number as usize].clone()).collect();
        self.runs.iter_mut().for_each(|run| run.component = ranks[run.component as usize]);
    }

    /// Pairs of components that touch. A pair may occur several times, but most occur once.
    pub(super) fn pairs(&self, reach: u32) -> Vec<Pair> {
        // Cache of recent pairs, by a hash of their numbers; replaced pairs go to the result.
        let none = Pair { components: [0, 0], faces: 0 };
        let mut recent = vec![none; RECENT_PAIRS];
        let mut pairs: Vec<Pair> = Vec::new();
        let mut pair = |a: &LocalSpan, b: &LocalSpan, faces: u64| {
            if a.component == b.component {
                return;
            }
            let components = [a.component.min(b.component), a.component.max(b.component)];
            let hash = components[0].wrapping_mul(0x9e37_79b1) ^ components[1].wrapping_mul(0x85eb_ca6b);
            let place = &mut recent[hash as usize >> (u32::BITS - RECENT_PAIRS.ilog2())];
            if place.components == components {
                place.faces += faces;
                return;
            }
            let before = std::mem::replace(place, Pair { components, faces });
            if before.components != none.components {
                pairs.push(before);
            }
        };
        for row in 0..self.count_rows() {
            let here = &self.runs[self.row(row)];
            for neighbours in here.windows(2).filter(|runs| runs[0].end == runs[1].start) {
                pair(&neighbours[0], &neighbours[1], 1);
            }
            for before in self.rows_before(row, reach) {
                let shares_faces = self.shares_faces(before, row);
                touching(&self.runs[self.row(before)], here, reach, |a, b| {
                    pair(a, b, if shares_faces { in_common(a, b) } else { 0 });
                });
            }
        }
        pairs.extend(recent.into_iter().filter(|pair| pair.components != none.components));
        pairs
    }

    /// Whether rows share faces, not only edges.
    fn shares_faces(&self, before: usize, row: usize) -> bool {
        let [y, _] = self.place(row);
        y > 0 && before + 1 == row || before + self.side as usize == row
    }

    /// Box of each component's cells in the block: its first cell along each axis, and the end
    /// after its last.
    pub(super) fn boxes(&self) -> Vec<[[u32; 3]; 2]> {
        let mut boxes = vec![[[u32::MAX; 3], [0; 3]]; self.components.len()];
        for row in 0..self.count_rows() {
            let [y, z] = self.place(row);
            for run in &self.runs[self.row(row)] {
                let [low, high] = &mut boxes[run.component as usize];
                *low = std::array::from_fn(|axis| low[axis].min([run.start(), y, z][axis]));
                *high = std::array::from_fn(|axis| high[axis].max([run.end(), y + 1, z + 1][axis]));
            }
        }
        boxes
    }

    /// Runs at the block's faces, with the numbers of their components.
    pub(super) fn borders(&self) -> Borders {
        let mut borders = Borders::default();
        let last = self.side - 1;
        for row in 0..self.count_rows() {
            let runs = &self.runs[self.row(row)];
            let [y, z] = self.place(row);
            let run = |start: u32, end: u32, component: u32| ComponentSpan {
                start,
                end,
                id: component.into(),
                value: self.components[component as usize].value,
            };
            let whole = || {
                runs.iter().map(|local| run(local.start(), local.end(), local.component)).collect::<Vec<_>>()
            };
            for (side, at) in [0, last].into_iter().enumerate() {
                if y == at {
                    borders.faces[1][side].push_row(z, whole());
                }
                if self.axes > 2 && z == at {
                    borders.faces[2][side].push_row(y, whole());
                }
            }
            // Cells of the first and the last column, in row order.
            let ends =
                [runs.first().filter(|run| run.start == 0), runs.last().filter(|run| run.end() > last)];
            for (side, end) in ends.into_iter().enumerate() {
                if let Some(end) = end {
                    borders.faces[0][side].push_cell(z, run(y, y + 1, end.component));
                }
            }
        }
        borders
    }

    /// Calls `each` for the runs of each row: row, cells and component.
    pub(super) fn each_run(&self, mut each: impl FnMut(usize, Range<u32>, u32)) {
        for row in 0..self.count_rows() {
            for run in &self.runs[self.row(row)] {
                each(row, run.start()..run.end(), run.component);
            }
        }
    }

    /// Cells along an edge of the block.
    pub(super) fn side(&self) -> u32 {
        self.side
    }
}

/// Root of a number in the forest; shortens the path on the way.
pub(super) fn root(parents: &mut [u32], mut number: u32) -> u32 {
    while parents[number as usize] != number {
        let above = parents[parents[number as usize] as usize];
        parents[number as usize] = above;
        number = above;
    }
    number
}
