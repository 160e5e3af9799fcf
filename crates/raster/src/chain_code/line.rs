//! Lines as 8-connected chains of cells (Bresenham).

use super::code_of;

/// A section of a line inside the raster: consecutive cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct CellChain {
    pub(super) start: [i64; 2],
    /// Codes of the steps with their repeat counts.
    pub(super) steps: Vec<(u8, u64)>,
}

/// Returns the sections of a line inside a raster of `size`. Vertices are in cells.
pub(super) fn chains_of(points: &[[f64; 2]], size: [u64; 2]) -> Vec<CellChain> {
    let mut chains: Vec<CellChain> = Vec::new();
    // The last cell of the previous segment, if the line continues there.
    let mut at: Option<[i64; 2]> = None;
    let single = if let [point] = points { Some([*point; 2]) } else { None };
    let segments = points.windows(2).filter_map(|ends| <[[f64; 2]; 2]>::try_from(ends).ok());
    for ends in segments.chain(single) {
        let Some(inside) = clipped(ends, size) else {
            at = None;
            continue;
        };
        let [from, to] = inside.map(|point| point.map(|at| at.floor() as i64));
        if at != Some(from) {
            chains.push(CellChain { start: from, steps: Vec::new() });
        }
        if let Some(chain) = chains.last_mut() {
            draw(from, to, &mut chain.steps);
        }
        at = (inside[1] == ends[1]).then_some(to);
    }
    chains
}

/// Clips a segment to the raster (Liang and Barsky 1984).
fn clipped([a, b]: [[f64; 2]; 2], size: [u64; 2]) -> Option<[[f64; 2]; 2]> {
    let (mut first, mut last) = (0.0f64, 1.0f64);
    // The upper border is exclusive.
    let ends = size.map(|cells| (cells as f64).next_down());
    for axis in 0..2 {
        let along = b[axis] - a[axis];
        for (speed, distance) in [(-along, a[axis]), (along, ends[axis] - a[axis])] {
            if speed == 0.0 {
                if distance < 0.0 {
                    return None;
                }
            } else if speed < 0.0 {
                first = first.max(distance / speed);
            } else {
                last = last.min(distance / speed);
            }
        }
    }
    // Comparisons with NaN, from ends that are not finite, are false as well.
    let is_inside = first <= last && a.iter().chain(&b).all(|number| number.is_finite());
    // Clamp, whatever was rounded and however distant an end is.
    let within =
        |point: [f64; 2]| -> [f64; 2] { std::array::from_fn(|axis| point[axis].clamp(0.0, ends[axis])) };
    let at = |share: f64| std::array::from_fn(|axis| a[axis] + share * (b[axis] - a[axis]));
    let start = within(if first == 0.0 { a } else { at(first) });
    let end = within(if last == 1.0 { b } else { at(last) });
    is_inside.then_some([start, end])
}

/// Appends the steps from one cell to another.
fn draw(from: [i64; 2], to: [i64; 2], steps: &mut Vec<(u8, u64)>) {
    let across = [to[0] - from[0], to[1] - from[1]];
    let (size, unit) = (across.map(i64::abs), across.map(i64::signum));
    let main = usize::from(size[1] > size[0]);
    let (most, least) = (size[main], size[1 - main]);
    let mut error = most / 2;
    for _ in 0..most {
        error -= least;
        let mut step = [0; 2];
        step[main] = unit[main];
        if error < 0 {
            error += most;
            step[1 - main] = unit[1 - main];
        }
        let code = code_of(step);
        match steps.last_mut() {
            Some((last, count)) if *last == code => *count += 1,
            _ => steps.push((code, 1)),
        }
    }
}
