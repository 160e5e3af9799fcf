//! Borders of nodes: runs of cells at their faces, which wait for the adjacent nodes.

use spinney_base::value::Value;

/// Interval of a line of cells.
pub(super) trait Span {
    fn start(&self) -> u32;

    fn end(&self) -> u32;
}

/// Length of the overlap of two intervals on adjacent lines.
pub(super) fn in_common<T: Span>(a: &T, b: &T) -> u64 {
    a.end().min(b.end()).saturating_sub(a.start().max(b.start())).into()
}

/// Calls `meet` for all pairs of intervals on two adjacent lines that touch: those that overlap, or
/// are at most `reach` cells apart diagonally.
#[inline]
pub(super) fn touching<T: Span>(a: &[T], b: &[T], reach: u32, mut meet: impl FnMut(&T, &T)) {
    let (mut i, mut j) = (0, 0);
    while let (Some(one), Some(other)) = (a.get(i), b.get(j)) {
        let touches = |a: &T, b: &T| a.start() < b.end() + reach && b.start() < a.end() + reach;
        if touches(one, other) {
            meet(one, other);
        }
        // Invariant: of two intervals with different ends, the one that ends first touches nothing
        // after the other. If both end at the same position, each may touch the other's successor
        // across the corner, if corners count.
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

/// Cells of a row of a face that belong to one component.
#[derive(Clone, Debug)]
pub(super) struct ComponentSpan {
    pub(super) start: u32,
    pub(super) end: u32,
    /// Number of the component.
    pub(super) id: u64,
    pub(super) value: Value,
}

impl Span for ComponentSpan {
    fn start(&self) -> u32 {
        self.start
    }

    fn end(&self) -> u32 {
        self.end
    }
}

/// Receives pairs of runs that touch, and the number of cell faces that they share: none if only
/// corners touch.
pub(super) type Meet<'a> = dyn FnMut(&ComponentSpan, &ComponentSpan, u64) + 'a;

/// Consecutive equal rows of a face.
#[derive(Clone, Debug)]
struct Band {
    start: u32,
    end: u32,
    runs: Vec<ComponentSpan>,
}

impl Span for Band {
    fn start(&self) -> u32 {
        self.start
    }

    fn end(&self) -> u32 {
        self.end
    }
}

/// Cells at one face of a node, except for VOID ones. Columns are along the first of the other
/// axes, rows along the second. In a quadtree a face has one row.
#[derive(Clone, Debug, Default)]
pub(super) struct Face {
    bands: Vec<Band>,
}

impl Face {
    /// Appends a row.
    pub(super) fn push_row(&mut self, row: u32, runs: Vec<ComponentSpan>) {
        if !runs.is_empty() {
            self.bands.push(Band { start: row, end: row + 1, runs });
        }
    }

    /// Appends a cell to a row, which must be the last one.
    pub(super) fn push_cell(&mut self, row: u32, cell: ComponentSpan) {
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
            bands: vec![Band {
                start: 0,
                end: rows,
                runs: vec![ComponentSpan { start: 0, end: columns, id, value }],
            }],
        }
    }

    /// This face, followed by the rows of another one.
    fn append_rows(mut self, other: Face, rows: u32) -> Face {
        self.bands.extend(other.bands.into_iter().map(|mut band| {
            (band.start, band.end) = (band.start + rows, band.end + rows);
            band
        }));
        self
    }

    /// This face, followed by the columns of another one.
    fn append_columns(self, other: Face, columns: u32) -> Face {
        let mut bands: Vec<Band> = Vec::with_capacity(self.bands.len().max(other.bands.len()));
        let mut left = self.bands.into_iter().peekable();
        let mut right = other.bands.into_iter().peekable();
        // (Rows before this one are done.)
        let mut done = 0;
        loop {
            let starts = [left.peek(), right.peek()].map(|band| band.map(|band| band.start.max(done)));
            let Some(start) = starts.into_iter().flatten().min() else { return Face { bands } };
            // Up to the next row at which a band begins or ends.
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

    /// Maps the numbers of the runs' components to `ids`.
    fn renumber(&mut self, ids: &[u64]) {
        for run in self.bands.iter_mut().flat_map(|band| &mut band.runs) {
            run.id = ids[run.id as usize];
        }
    }
}

/// Runs of the rows from `start` to `end` of the next band, if it covers them; a band that ends
/// there is removed.
fn take_rows(
    bands: &mut std::iter::Peekable<std::vec::IntoIter<Band>>,
    start: u32,
    end: u32,
) -> Vec<ComponentSpan> {
    match bands.peek() {
        Some(band) if band.start <= start && band.end > end => band.runs.clone(),
        Some(band) if band.start <= start => bands.next().map(|band| band.runs).unwrap_or_default(),
        _ => Vec::new(),
    }
}

/// Faces of a node: along each axis those at its minimum and maximum coordinate.
#[derive(Clone, Debug, Default)]
pub(super) struct Borders {
    pub(super) faces: [[Face; 2]; 3],
}

impl Borders {
    /// Borders of a node whose cells all belong to one component.
    pub(super) fn uniform(axes: usize, side: u32, id: u64, value: Value) -> Borders {
        let rows = if axes > 2 { side } else { 1 };
        let face = |axis: usize| match axis < axes {
            true => [0; 2].map(|_| Face::uniform(side, rows, id, value)),
            false => Default::default(),
        };
        Borders { faces: std::array::from_fn(face) }
    }

    /// Maps the component numbers to `ids`.
    pub(super) fn renumber(&mut self, ids: &[u64]) {
        self.faces.iter_mut().flatten().for_each(|face| face.renumber(ids));
    }

    /// Joins two adjacent nodes with `side` cells along an axis: reports runs that touch, and keeps
    /// the outer faces.
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
                [low.append_columns(other_low, side), high.append_columns(other_high, side)]
            } else {
                [low.append_rows(other_low, side), high.append_rows(other_high, side)]
            };
        }
        joined
    }
}
