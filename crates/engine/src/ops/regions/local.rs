//! Components of the cells of one block, found by the runs of equal cells in its rows.

use super::border::{Borders, Run, Span, in_common, touching};
use spinney_base::sort;
use spinney_base::space::{Dimension, morton_encode};
use spinney_base::value::Value;

/// Some cells of a row that are alike and not VOID.
struct LocalRun {
    start: u32,
    end: u32,
    component: u32,
}

impl Span for LocalRun {
    fn start(&self) -> u32 {
        self.start
    }

    fn end(&self) -> u32 {
        self.end
    }
}

/// A component of a block's cells.
#[derive(Clone, Debug)]
pub(super) struct Component {
    /// Place of its first cell in Z order.
    pub(super) first: u64,
    pub(super) cells: u64,
    pub(super) value: Value,
    /// Whether it has cells at the block's border.
    pub(super) is_at_border: bool,
}

/// Two components of a block that touch, the lower number first, and how many faces of cells they have in common.
pub(super) struct Pair {
    pub(super) components: [u32; 2],
    pub(super) faces: u64,
}

/// The components of a block, by their first cells in Z order.
pub(super) struct Local {
    axes: usize,
    side: u32,
    /// The first run of each row, and the end of the last.
    rows: Vec<u32>,
    runs: Vec<LocalRun>,
    pub(super) components: Vec<Component>,
}

impl Local {
    /// The components of a block with so many levels below it, whose cells are given in rows. Cells touch others up to so many cells
    /// away along the other axes.
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
        let length = side as usize;
        for (values, valid) in values.chunks_exact(length * width).zip(valid.chunks_exact(length)) {
            local.find_runs(width, values, valid);
            local.rows.push(local.runs.len() as u32);
        }
        local.unite(width, values, reach);
        local.number(dimension, width, values);
        local
    }

    fn find_runs(&mut self, width: usize, values: &[u8], valid: &[bool]) {
        match width {
            1 => self.runs_of::<1>(values, valid),
            2 => self.runs_of::<2>(values, valid),
            3 => self.runs_of::<3>(values, valid),
            4 => self.runs_of::<4>(values, valid),
            6 => self.runs_of::<6>(values, valid),
            8 => self.runs_of::<8>(values, valid),
            12 => self.runs_of::<12>(values, valid),
            _ => self.runs_of::<16>(values, valid),
        }
    }

    /// Adds the runs of a row. A mover: compiled for each width of values.
    fn runs_of<const WIDTH: usize>(&mut self, values: &[u8], valid: &[bool]) {
        let (values, _) = values.as_chunks::<WIDTH>();
        let mut start = 0;
        while start < valid.len() {
            if !valid[start] {
                start += 1;
                continue;
            }
            let value = values[start];
            let alike = values[start..]
                .iter()
                .zip(&valid[start..])
                .take_while(|(other, valid)| **valid && **other == value);
            let end = start + alike.count();
            self.runs.push(LocalRun {
                start: start as u32,
                end: end as u32,
                component: self.runs.len() as u32,
            });
            start = end;
        }
    }

    /// The rows before a row whose cells touch those of the row.
    fn rows_before(&self, row: usize, reach: u32) -> impl Iterator<Item = usize> + use<> {
        let (side, reach) = (self.side as i64, i64::from(reach));
        let layers = if self.axes > 2 { side } else { 1 };
        let (y, z) = (row as i64 % side, row as i64 / side);
        let beside = (-reach..=reach).map(|y| (y, -1));
        let touching = [(-1, 0)]
            .into_iter()
            .chain((layers > 1).then_some((0, -1)).into_iter().filter(move |_| reach == 0))
            .chain(beside.filter(move |_| reach > 0));
        touching
            .map(move |(dy, dz)| (y + dy, z + dz))
            .filter(move |(y, z)| (0..side).contains(y) && (0..layers).contains(z))
            .map(move |(y, z)| (z * side + y) as usize)
    }

    fn row(&self, row: usize) -> std::ops::Range<usize> {
        self.rows[row] as usize..self.rows[row + 1] as usize
    }

    fn count_rows(&self) -> usize {
        self.rows.len() - 1
    }

    /// Unites runs of equal values that touch: afterwards each leads to one before it, or to itself.
    fn unite(&mut self, width: usize, values: &[u8], reach: u32) {
        let side = self.side as usize;
        let mut parents: Vec<u32> = (0..self.runs.len() as u32).collect();
        for row in 0..self.count_rows() {
            for before in self.rows_before(row, reach) {
                let (a, b) = (self.row(before), self.row(row));
                let value = |row: usize, run: &LocalRun| {
                    &values[(row * side + run.start as usize) * width..][..width]
                };
                let mut unite = |a: &LocalRun, b: &LocalRun| {
                    if value(before, a) == value(row, b) {
                        let (a, b) = (root(&mut parents, a.component), root(&mut parents, b.component));
                        parents[a.max(b) as usize] = a.min(b);
                    }
                };
                touching(&self.runs[a], &self.runs[b], reach, &mut unite);
            }
        }
        for run in 0..self.runs.len() {
            self.runs[run].component = root(&mut parents, run as u32);
        }
    }

    /// Numbers the components in Z order of their first cells.
    fn number(&mut self, dimension: Dimension, width: usize, values: &[u8]) {
        let side = self.side;
        let mut numbers = vec![0u32; self.runs.len()];
        let last = side - 1;
        for row in 0..self.count_rows() {
            let (y, z) = (row as u32 % side, row as u32 / side);
            let high = morton_encode(dimension, y) << 1
                | if self.axes > 2 { morton_encode(dimension, z) << 2 } else { 0 };
            let is_outer = y == 0 || y == last || self.axes > 2 && (z == 0 || z == last);
            for number in self.row(row) {
                let run = &mut self.runs[number];
                let at = row * side as usize + run.start as usize;
                let first = morton_encode(dimension, run.start) | high;
                // (Runs lead to those before them, which have their component already.)
                if run.component as usize == number {
                    numbers[number] = self.components.len() as u32;
                    let value = Value::from_bytes(&values[at * width..][..width]);
                    self.components.push(Component { first, cells: 0, value, is_at_border: false });
                }
                run.component = numbers[run.component as usize];
                let component = &mut self.components[run.component as usize];
                component.first = component.first.min(first);
                component.cells += u64::from(run.end - run.start);
                component.is_at_border |= is_outer || run.start == 0 || run.end == side;
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

    /// Pairs of components that touch, each once.
    pub(super) fn pairs(&self, reach: u32) -> Vec<Pair> {
        let mut pairs: Vec<u128> = Vec::new();
        let mut pair = |a: &LocalRun, b: &LocalRun, faces: u64| {
            let (a, b) = (a.component.min(b.component), a.component.max(b.component));
            let key = u128::from(a) << 32 | u128::from(b);
            match pairs.last_mut() {
                _ if a == b => {}
                Some(last) if *last >> 64 == key => *last += u128::from(faces),
                _ => pairs.push(key << 64 | u128::from(faces)),
            }
        };
        for row in 0..self.count_rows() {
            let here = &self.runs[self.row(row)];
            for neighbours in here.windows(2).filter(|runs| runs[0].end == runs[1].start) {
                pair(&neighbours[0], &neighbours[1], 1);
            }
            for before in self.rows_before(row, reach) {
                let is_beside = self.is_beside(before, row);
                touching(&self.runs[self.row(before)], here, reach, &mut |a, b| {
                    pair(a, b, if is_beside { in_common(a, b) } else { 0 });
                });
            }
        }
        sort::numbers128(&mut pairs);
        let mut once: Vec<Pair> = Vec::new();
        for pair in pairs {
            let (components, faces) = ([(pair >> 96) as u32, (pair >> 64) as u32], pair as u64);
            match once.last_mut() {
                Some(last) if last.components == components => last.faces += faces,
                _ => once.push(Pair { components, faces }),
            }
        }
        once
    }

    /// Whether rows have faces in common, and not only edges.
    fn is_beside(&self, before: usize, row: usize) -> bool {
        let side = self.side as usize;
        before + 1 == row && !row.is_multiple_of(side) || before + side == row
    }

    /// The box of each component's cells in the block: its first cell along each axis, and the one behind its last.
    pub(super) fn boxes(&self) -> Vec<[[u32; 3]; 2]> {
        let mut boxes = vec![[[u32::MAX; 3], [0; 3]]; self.components.len()];
        for row in 0..self.count_rows() {
            let (y, z) = (row as u32 % self.side, row as u32 / self.side);
            for run in &self.runs[self.row(row)] {
                let [low, high] = &mut boxes[run.component as usize];
                *low = std::array::from_fn(|axis| low[axis].min([run.start, y, z][axis]));
                *high = std::array::from_fn(|axis| high[axis].max([run.end, y + 1, z + 1][axis]));
            }
        }
        boxes
    }

    /// The runs at the block's faces, with the numbers of their components.
    pub(super) fn borders(&self) -> Borders {
        let mut borders = Borders::default();
        let last = self.side - 1;
        for row in 0..self.count_rows() {
            let runs = &self.runs[self.row(row)];
            let (y, z) = (row as u32 % self.side, row as u32 / self.side);
            let run = |start: u32, end: u32, component: u32| Run {
                start,
                end,
                id: component.into(),
                value: self.components[component as usize].value,
            };
            let whole =
                || runs.iter().map(|local| run(local.start, local.end, local.component)).collect::<Vec<_>>();
            for (side, at) in [0, last].into_iter().enumerate() {
                if y == at {
                    borders.faces[1][side].push_row(z, whole());
                }
                if self.axes > 2 && z == at {
                    borders.faces[2][side].push_row(y, whole());
                }
            }
            // Cells of the first and the last column, one below the other.
            let ends = [runs.first().filter(|run| run.start == 0), runs.last().filter(|run| run.end > last)];
            for (side, end) in ends.into_iter().enumerate() {
                if let Some(end) = end {
                    borders.faces[0][side].push_cell(z, run(y, y + 1, end.component));
                }
            }
        }
        borders
    }

    /// Hands out the runs with their components: the place of the first cell in rows, and the end.
    pub(super) fn each_run(&self, mut each: impl FnMut(std::ops::Range<usize>, usize)) {
        for row in 0..self.count_rows() {
            let first = row * self.side as usize;
            for run in &self.runs[self.row(row)] {
                each(first + run.start as usize..first + run.end as usize, run.component as usize);
            }
        }
    }
}

/// The first of those that a run was united with; ways are made shorter as they are gone.
fn root(parents: &mut [u32], mut number: u32) -> u32 {
    while parents[number as usize] != number {
        let above = parents[parents[number as usize] as usize];
        parents[number as usize] = above;
        number = above;
    }
    number
}
