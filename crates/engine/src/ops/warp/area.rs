//! Values of areas: source cells weighted by the exact area that a target cell covers of each.

use smallvec::SmallVec;

use super::average::average;
use super::lattice::Lattice;
use super::window::{Window, floor};
use crate::tree::CellBlock;
use spinney_base::value::{Rule, Value};

/// Source cell, by its index in the window, and its covered area.
type Share = (usize, f64);

/// Relative tolerance of areas, as a fraction of the cell: smaller differences are rounding errors.
const TINY: f64 = 1e-9;

/// Sets each cell to the mean of the source cells that it covers, or to the value with the largest
/// area. `lattice` has the cells' corners.
pub(super) fn cover(
    window: &Window,
    lattice: &Lattice,
    [width, height]: [usize; 2],
    rule: Rule,
    block: &mut CellBlock,
) {
    let bytes_each = window.value.size();
    let mut shares = Vec::new();
    let mut outline = Outline::default();
    let mut sums = Sums::default();
    let spans = match lattice {
        Lattice::Separable { columns, rows } => Some((spans(columns), spans(rows))),
        Lattice::Points { .. } => None,
    };
    if rule == Rule::Mean
        && let Some((columns, rows)) = &spans
    {
        average(window, columns, rows, block);
    }
    let mut runs = UniformRuns::default();
    let settles = UniformRuns::settle(window, rule);
    for y in 0..height {
        if !block.present[y * width..(y + 1) * width].contains(&false) {
            continue;
        }
        let span = spans.as_ref().filter(|_| settles).map(|(columns, rows)| (columns, &rows[y]));
        if let Some((_, rows)) = span {
            runs.find(window, rows);
        }
        for x in 0..width {
            let index = y * width + x;
            if block.present[index] {
                continue;
            }
            if let Some((columns, (top, _))) = span
                && let Some(found) = runs.uniform(window, &columns[x], *top)
            {
                if let Some(value) = found {
                    block.values[index * bytes_each..(index + 1) * bytes_each].copy_from_slice(value);
                    block.present[index] = true;
                }
                continue;
            }
            shares.clear();
            let whole = match &spans {
                Some((columns, rows)) => rectangle(window, &columns[x], &rows[y], &mut shares),
                None => {
                    let corners =
                        [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)].map(|(x, y)| lattice.at(x, y));
                    outline.cover(window, corners, &mut shares)
                }
            };
            if shares.is_empty() {
                continue;
            }
            let value = sums.value(window, &shares, whole, rule);
            value.write(&mut block.values[index * bytes_each..(index + 1) * bytes_each]);
            block.present[index] = true;
        }
    }
}

/// Cells along one axis that an interval between two positions covers: the first, and the covered
/// length of each.
pub(super) type Span = (i64, SmallVec<[f64; 4]>);

fn spans(positions: &[f64]) -> Vec<Span> {
    let span = |pair: &[f64]| -> Span {
        let (from, to) = (pair[0].min(pair[1]), pair[0].max(pair[1]));
        if !(from.is_finite() && to.is_finite()) {
            return (0, SmallVec::new());
        }
        let tiny = TINY * (to - from).min(1.0);
        let first = floor(from + tiny);
        let last = floor(to - tiny).max(first);
        let part = |cell: i64| (to.min(cell as f64 + 1.0) - from.max(cell as f64)).max(0.0);
        (first, (first..=last).map(part).collect())
    };
    positions.windows(2).map(span).collect()
}

/// Runs of window columns that are uniform over some rows: a rectangle within one run needs no
/// areas.
#[derive(Default)]
struct UniformRuns {
    /// For each column of the window, whether all of the rows have one value, or all are VOID.
    is_one: Vec<bool>,
    /// For each column, the index of its run.
    run: Vec<u32>,
}

impl UniformRuns {
    /// Whether a rectangle of one value gets exactly that value.
    fn settle(window: &Window, rule: Rule) -> bool {
        match rule {
            Rule::Occupancy => false,
            Rule::Mean => !window.value.sample.is_float(),
            _ => true,
        }
    }

    /// Finds the runs in the covered rows.
    fn find(&mut self, window: &Window, (top, rows): &Span) {
        self.run.clear();
        let [columns, height] = window.size;
        let first = top - window.origin[1];
        if first < 0 || rows.is_empty() || first as usize + rows.len() > height {
            return;
        }
        let width = window.value.size();
        let row = |row: usize| {
            let cells = (first as usize + row) * columns..(first as usize + row + 1) * columns;
            (&window.bytes[cells.start * width..cells.end * width], &window.valid[cells])
        };
        let (values, valid) = row(0);
        self.is_one.clear();
        self.is_one.resize(columns, true);
        for (other, other_valid) in (1..rows.len()).map(row) {
            let same_valid = valid.iter().zip(other_valid).map(|(is, was)| is == was);
            let settled = self.is_one.iter_mut().zip(same_valid.zip(valid));
            // (Single bytes, as classes have, are the most frequent type.)
            if width == 1 {
                for ((is_one, (same, is)), (a, b)) in settled.zip(values.iter().zip(other)) {
                    *is_one &= same & ((a == b) | !is);
                }
            } else {
                let pairs = values.chunks_exact(width).zip(other.chunks_exact(width));
                for ((is_one, (same, is)), (a, b)) in settled.zip(pairs) {
                    *is_one &= same && (a == b || !is);
                }
            }
        }
        let cell = |column: usize| &values[column * width..(column + 1) * width];
        let mut number = 0;
        self.run.push(0);
        for column in 1..columns {
            let is_equal = if width == 1 {
                values[column - 1] == values[column]
            } else {
                cell(column - 1) == cell(column)
            };
            let is_next = (self.is_one[column - 1] & self.is_one[column])
                && valid[column - 1] == valid[column]
                && (is_equal || !valid[column]);
            number += u32::from(!is_next);
            self.run.push(number);
        }
    }

    /// Value of the cells that a rectangle covers in the rows, `Some(None)` if all are VOID; `None`
    /// if they differ, or reach beyond the window.
    fn uniform<'w>(&self, window: &'w Window, (left, columns): &Span, top: i64) -> Option<Option<&'w [u8]>> {
        let first = usize::try_from(left - window.origin[0]).ok()?;
        let last = first + columns.len().checked_sub(1)?;
        let is_one = self.run.get(first)? == self.run.get(last)? && self.is_one[first];
        let width = window.value.size();
        let index = (top - window.origin[1]) as usize * window.size[0] + first;
        let value = || window.valid[index].then(|| &window.bytes[index * width..(index + 1) * width]);
        is_one.then(value)
    }
}

/// Adds the cells that a rectangle covers; returns its area.
fn rectangle(window: &Window, (left, columns): &Span, (top, rows): &Span, shares: &mut Vec<Share>) -> f64 {
    for (y, down) in (*top..).zip(rows) {
        for (x, along) in (*left..).zip(columns) {
            shares.extend(window.present(x, y).map(|index| (index, down * along)));
        }
    }
    columns.iter().sum::<f64>() * rows.iter().sum::<f64>()
}

/// Areas of cells inside a polygon, by accumulating signed coverage of its edges from left to right
/// in each row, as font rasterizers do.
#[derive(Default)]
struct Outline {
    areas: Vec<f64>,
}

impl Outline {
    /// Adds the cells that a quadrangle covers; returns its area.
    fn cover(&mut self, window: &Window, corners: [[f64; 2]; 4], shares: &mut Vec<Share>) -> f64 {
        if corners.iter().flatten().any(|number| !number.is_finite()) {
            return 0.0;
        }
        let range = |axis: usize| {
            let numbers = corners.map(|corner| corner[axis]);
            (
                numbers.into_iter().fold(f64::INFINITY, f64::min),
                numbers.into_iter().fold(f64::NEG_INFINITY, f64::max),
            )
        };
        let ((left, right), (top, bottom)) = (range(0), range(1));
        // (The window contains the whole quadrangle, except for what lies beyond the source.)
        let first = [floor(left).max(window.origin[0]), floor(top).max(window.origin[1])];
        let end = [0, 1].map(|axis| {
            let last = floor([right, bottom][axis]) + 1;
            last.min(window.origin[axis] + window.size[axis] as i64)
        });
        if first[0] >= end[0] || first[1] >= end[1] {
            return 0.0;
        }
        let (columns, rows) = ((end[0] - first[0]) as usize, (end[1] - first[1]) as usize);
        // One extra column for what edges in the last column add after it.
        let stride = columns + 2;
        self.areas.clear();
        self.areas.resize(stride * rows, 0.0);
        let inside = corners.map(|[x, y]| {
            let x = (x - first[0] as f64).clamp(0.0, columns as f64);
            [x, (y - first[1] as f64).clamp(0.0, rows as f64)]
        });
        for (i, from) in inside.iter().enumerate() {
            self.edge(stride, *from, inside[(i + 1) % 4]);
        }
        // (Area of the quadrangle, by the cross product of its diagonals.)
        let across = |from: usize, to: usize| [0, 1].map(|axis| corners[to][axis] - corners[from][axis]);
        let (down, up) = (across(0, 2), across(1, 3));
        let tiny = TINY * ((down[0] * up[1] - down[1] * up[0]) / 2.0).abs().min(1.0);
        let mut whole = 0.0;
        for (row, areas) in self.areas.chunks_exact(stride).enumerate() {
            let mut sum = 0.0;
            for (column, change) in areas[..columns].iter().enumerate() {
                sum += change;
                let area = f64::abs(sum);
                whole += area;
                let index = window.present(first[0] + column as i64, first[1] + row as i64);
                shares.extend(index.map(|index| (index, area)).filter(|_| area > tiny));
            }
        }
        whole
    }

    /// Adds the changes of an edge from each cell to the next: the edge's height in the cell's row,
    /// minus the part of the cell to the left of it.
    fn edge(&mut self, stride: usize, from: [f64; 2], to: [f64; 2]) {
        if from[1] == to[1] {
            return;
        }
        let (sign, [mut x, start], end) = if from[1] < to[1] { (1.0, from, to) } else { (-1.0, to, from) };
        let slope = (end[0] - x) / (end[1] - start);
        let rows = self.areas.len() / stride;
        for row in start as usize..(end[1].ceil() as usize).min(rows) {
            let height = end[1].min(row as f64 + 1.0) - start.max(row as f64);
            let next = if end[1] <= row as f64 + 1.0 { end[0] } else { x + slope * height };
            let (low, high) = (x.min(next), x.max(next));
            let areas = &mut self.areas[row * stride..(row + 1) * stride];
            let (first, last) = (low as usize, ((high - TINY).max(low)) as usize);
            if first == last {
                let left = ((low + high) / 2.0 - first as f64) * sign * height;
                areas[first] += sign * height - left;
                areas[first + 1] += left;
            } else {
                // Height of the edge in each cell that it crosses, and the part of that cell to its
                // left.
                let per_cell = sign * height / (high - low);
                for cell in first..=last {
                    let (enter, leave) = (low.max(cell as f64), high.min(cell as f64 + 1.0));
                    let part = per_cell * (leave - enter);
                    let left = part * ((enter + leave) / 2.0 - cell as f64);
                    areas[cell] += part - left;
                    areas[cell + 1] += left;
                }
            }
            x = next;
        }
    }
}

/// Sums of shares by value.
#[derive(Default)]
struct Sums {
    values: Vec<(Value, f64)>,
}

impl Sums {
    /// Value of an area's shares by a rule.
    fn value(&mut self, window: &Window, shares: &[Share], whole: f64, rule: Rule) -> Value {
        let (value_type, width) = (window.value, window.value.size());
        let value_at = |index: usize| Value::from_bytes(&window.bytes[index * width..(index + 1) * width]);
        let first = value_at(shares[0].0);
        if !matches!(rule, Rule::Mean | Rule::Occupancy) {
            self.values.clear();
            for (index, area) in shares {
                let value = value_at(*index);
                match self.values.iter_mut().find(|(other, _)| *other == value) {
                    Some((_, sum)) => *sum += area,
                    None => self.values.push((value, *area)),
                }
            }
            // Areas that differ by rounding errors only are equal. The first value in row order of
            // the source wins, so that no value is preferred for its number.
            let most = self.values.iter().map(|(_, area)| *area).fold(0.0, f64::max);
            return self
                .values
                .iter()
                .find(|(_, area)| *area >= most * (1.0 - TINY))
                .map_or(first, |(value, _)| *value);
        }
        // (A mean does not depend on the origin of its numbers; a sum does.)
        let base = if rule == Rule::Mean { first } else { Value::ZERO };
        let (mut sums, mut areas) = ([0.0; 4], [0.0; 4]);
        for (index, area) in shares {
            let value = value_at(*index);
            let (samples, present) = (value_type.samples_from(base, value), value_type.present(value));
            for (channel, sample) in samples.iter().enumerate() {
                if present[channel] && !sample.is_nan() {
                    sums[channel] += area * sample;
                    areas[channel] += area;
                }
            }
        }
        let raw = value_type.samples_from(base, first);
        value_type.nearest_from(base, |channel| {
            let area = if rule == Rule::Occupancy { whole } else { areas[channel] };
            // (A sample that is missing everywhere is left unchanged.)
            if areas[channel] == 0.0 {
                return raw[channel];
            }
            sums[channel] / area
        })
    }
}
