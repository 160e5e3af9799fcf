//! Borders of nodes: runs of cells at their faces, which wait for the nodes beside them.

use spinney_base::value::Value;

/// A piece of a line of cells.
pub(super) trait Span {
    fn start(&self) -> u32;

    fn end(&self) -> u32;
}

/// Places that two pieces of lines beside each other have in common.
pub(super) fn in_common<T: Span>(a: &T, b: &T) -> u64 {
    a.end().min(b.end()).saturating_sub(a.start().max(b.start())).into()
}

/// Hands out all pairs of pieces of two lines beside each other that touch: those that have cells of the same places, or of places
/// `reach` cells away.
#[inline]
pub(super) fn touching<T: Span>(a: &[T], b: &[T], reach: u32, mut meet: impl FnMut(&T, &T)) {
    let (mut i, mut j) = (0, 0);
    while let (Some(one), Some(other)) = (a.get(i), b.get(j)) {
        let touches = |a: &T, b: &T| a.start() < b.end() + reach && b.start() < a.end() + reach;
        if touches(one, other) {
            meet(one, other);
        }
        // Invariant: of two pieces that end at different places, the one that ends first touches nothing behind the other; where both end at
        // one place each may touch what follows the other, across the corner, if corners touch.
        if one.end() == other.end() {
            if reach > 0
                && let Some(next) = b.get(j + 1)
                && touches(one, next)
            {
                meet(one, next);
            }
            i += 1;
        } else if one.end() < other.end() {
            i += 1;
        } else {
            j += 1;
        }
    }
}

/// Cells of a row of a face that are of one component.
#[derive(Clone, Debug)]
pub(super) struct Run {
    pub(super) start: u32,
    pub(super) end: u32,
    /// Number of the component.
    pub(super) id: u64,
    pub(super) value: Value,
}

impl Span for Run {
    fn start(&self) -> u32 {
        self.start
    }

    fn end(&self) -> u32 {
        self.end
    }
}

/// A taker of runs that touch, and of how many faces of cells they have in common: none where only corners do.
pub(super) type Meet<'a> = dyn FnMut(&Run, &Run, u64) + 'a;

/// Rows of a face that are alike.
#[derive(Clone, Debug)]
struct Band {
    start: u32,
    end: u32,
    runs: Vec<Run>,
}

impl Span for Band {
    fn start(&self) -> u32 {
        self.start
    }

    fn end(&self) -> u32 {
        self.end
    }
}

/// The cells at one face of a node: all but VOID ones. Columns are along the first of the other axes, rows along the second; a
/// quadtree's have one row.
#[derive(Clone, Debug, Default)]
pub(super) struct Face {
    bands: Vec<Band>,
}

impl Face {
    /// Adds a row behind the last.
    pub(super) fn push_row(&mut self, row: u32, runs: Vec<Run>) {
        if !runs.is_empty() {
            self.bands.push(Band { start: row, end: row + 1, runs });
        }
    }

    /// Adds a cell behind the last of a row, which is the last.
    pub(super) fn push_cell(&mut self, row: u32, cell: Run) {
        match self.bands.last_mut().filter(|band| band.start == row) {
            None => self.push_row(row, vec![cell]),
            Some(band) => match band.runs.last_mut() {
                Some(last) if last.id == cell.id && last.end == cell.start => last.end = cell.end,
                _ => band.runs.push(cell),
            },
        }
    }

    fn uniform(columns: u32, rows: u32, id: u64, value: Value) -> Face {
        Face {
            bands: vec![Band { start: 0, end: rows, runs: vec![Run { start: 0, end: columns, id, value }] }],
        }
    }

    /// This face with another one behind its rows.
    fn below(mut self, other: Face, rows: u32) -> Face {
        self.bands.extend(other.bands.into_iter().map(|mut band| {
            (band.start, band.end) = (band.start + rows, band.end + rows);
            band
        }));
        self
    }

    /// This face with another one behind its columns.
    fn beside(self, other: Face, columns: u32) -> Face {
        let mut bands: Vec<Band> = Vec::with_capacity(self.bands.len().max(other.bands.len()));
        let mut left = self.bands.into_iter().peekable();
        let mut right = other.bands.into_iter().peekable();
        // (Rows up to here are done.)
        let mut done = 0;
        loop {
            let starts = [left.peek(), right.peek()].map(|band| band.map(|band| band.start.max(done)));
            let Some(start) = starts.into_iter().flatten().min() else { return Face { bands } };
            // Up to the next place at which a band begins or ends.
            let next = |band: &Band| if band.start > start { band.start } else { band.end };
            let ends = [left.peek().map(next), right.peek().map(next)];
            let end = ends.into_iter().flatten().min().unwrap_or(start);
            let mut runs = take_rows(&mut left, start, end);
            runs.extend(take_rows(&mut right, start, end).into_iter().map(|mut run| {
                (run.start, run.end) = (run.start + columns, run.end + columns);
                run
            }));
            bands.push(Band { start, end, runs });
            done = end;
        }
    }

    fn meet(&self, other: &Face, reach: u32, meet: &mut Meet<'_>) {
        touching(&self.bands, &other.bands, reach, |a, b| {
            let rows = in_common(a, b);
            touching(&a.runs, &b.runs, reach, |a, b| meet(a, b, rows * in_common(a, b)));
        });
    }

    /// Numbers the runs' components anew.
    fn renumber(&mut self, ids: &[u64]) {
        for run in self.bands.iter_mut().flat_map(|band| &mut band.runs) {
            run.id = ids[run.id as usize];
        }
    }
}

/// The runs of the rows from `start` to `end` of the next band, if it has them; a band that ends there is taken.
fn take_rows(bands: &mut std::iter::Peekable<std::vec::IntoIter<Band>>, start: u32, end: u32) -> Vec<Run> {
    match bands.peek() {
        Some(band) if band.start <= start && band.end > end => band.runs.clone(),
        Some(band) if band.start <= start => bands.next().map(|band| band.runs).unwrap_or_default(),
        _ => Vec::new(),
    }
}

/// The faces of a node, along each axis the one at its least coordinate and that at its greatest.
#[derive(Clone, Debug, Default)]
pub(super) struct Borders {
    pub(super) faces: [[Face; 2]; 3],
}

impl Borders {
    /// Those of a node all of whose cells are of one component.
    pub(super) fn uniform(axes: usize, side: u32, id: u64, value: Value) -> Borders {
        let rows = if axes > 2 { side } else { 1 };
        let face = |axis: usize| match axis < axes {
            true => [0; 2].map(|_| Face::uniform(side, rows, id, value)),
            false => Default::default(),
        };
        Borders { faces: std::array::from_fn(face) }
    }

    /// Numbers the components anew.
    pub(super) fn renumber(&mut self, ids: &[u64]) {
        self.faces.iter_mut().flatten().for_each(|face| face.renumber(ids));
    }

    /// Lays two nodes with so many cells along an axis beside each other: what touches is handed out, what is outside is kept.
    pub(super) fn join(
        self,
        other: Borders,
        axis: usize,
        side: u32,
        reach: u32,
        meet: &mut Meet<'_>,
    ) -> Borders {
        self.faces[axis][1].meet(&other.faces[axis][0], reach, meet);
        let mut joined = Borders::default();
        let pairs = self.faces.into_iter().zip(other.faces).zip(&mut joined.faces);
        for (normal, (([low, high], [other_low, other_high]), joined)) in pairs.enumerate() {
            // (The first of the axes along the face is that of its columns.)
            let columns = if normal == 0 { 1 } else { 0 };
            *joined = if normal == axis {
                [low, other_high]
            } else if axis == columns {
                [low.beside(other_low, side), high.beside(other_high, side)]
            } else {
                [low.below(other_low, side), high.below(other_high, side)]
            };
        }
        joined
    }
}
