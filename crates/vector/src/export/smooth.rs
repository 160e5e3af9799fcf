//! Line smoothing by corner cutting (Chaikin, 1974).

use super::Geometry;
use spinney_base::Result;

type Point = [f64; 3];

/// Smoothed geometry. Each pass replaces every segment by its middle half, which doubles the points
/// and rounds corners. A pass moves a line by at most a quarter of a segment. Ends of open lines
/// are kept, and closed lines stay closed.
pub struct Smoothed<'a> {
    geometry: &'a dyn Geometry,
    is_closed: bool,
    times: u8,
}

impl<'a> Smoothed<'a> {
    /// Smooths a geometry whose parts are either all closed or all open; `times` is the number of
    /// passes.
    pub fn new(geometry: &'a dyn Geometry, is_closed: bool, times: u8) -> Smoothed<'a> {
        Smoothed { geometry, is_closed, times }
    }
}

/// Number of points yielded at a time.
const PART: usize = 1 << 10;

impl Geometry for Smoothed<'_> {
    fn parts(&self) -> usize {
        self.geometry.parts()
    }

    fn count(&self, part: usize) -> u64 {
        let count = self.geometry.count(part);
        // The last point of a ring repeats the first.
        let smoothed = |count: u64, _| count.saturating_mul(2).saturating_sub(u64::from(self.is_closed));
        if count < 2 { count } else { (0..self.times).fold(count, smoothed) }
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        if self.geometry.count(part) < 2 {
            return self.geometry.points(part, each);
        }
        let mut passes: Vec<Pass> = (0..self.times).map(|_| Pass::new(self.is_closed)).collect();
        let mut smooth = Vec::with_capacity(PART);
        self.geometry.points(part, &mut |points| {
            for point in points {
                push(&mut passes, *point, &mut smooth);
                if smooth.len() >= PART {
                    each(&smooth)?;
                    smooth.clear();
                }
            }
            Ok(())
        })?;
        for pass in 0..passes.len() {
            if let Some(last) = passes[pass].end() {
                push(&mut passes[pass + 1..], last, &mut smooth);
            }
        }
        each(&smooth)
    }
}

/// State of one smoothing pass.
struct Pass {
    is_closed: bool,
    /// Last input point.
    last: Option<Point>,
    /// First output point.
    first: Option<Point>,
}

impl Pass {
    fn new(is_closed: bool) -> Pass {
        Pass { is_closed, last: None, first: None }
    }

    /// Takes an input point, and returns the next output points.
    fn next(&mut self, point: Point) -> [Option<Point>; 2] {
        let Some(last) = self.last.replace(point) else {
            return [(!self.is_closed).then_some(point), None];
        };
        let at = |share: f64| std::array::from_fn(|axis| last[axis] + share * (point[axis] - last[axis]));
        let middle = [at(0.25), at(0.75)];
        self.first.get_or_insert(middle[0]);
        middle.map(Some)
    }

    /// Returns the final output point.
    fn end(&self) -> Option<Point> {
        if self.is_closed { self.first } else { self.last }
    }
}

/// Pushes a point through all passes.
fn push(passes: &mut [Pass], point: Point, smooth: &mut Vec<Point>) {
    let Some((pass, rest)) = passes.split_first_mut() else { return smooth.push(point) };
    for point in pass.next(point).into_iter().flatten() {
        push(rest, point, smooth);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smoothed(line: &[Point], is_closed: bool, times: u8) -> Vec<Point> {
        let geometry = [line.to_vec()];
        let smoothed = Smoothed::new(&geometry, is_closed, times);
        let mut all = Vec::new();
        let mut each = |points: &[Point]| {
            all.extend_from_slice(points);
            Ok(())
        };
        smoothed.points(0, &mut each).unwrap();
        assert_eq!(all.len() as u64, smoothed.count(0));
        all
    }

    #[test]
    fn corners_are_cut() {
        let line = [[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [4.0, 4.0, 1.0]];
        let flat = |points: Vec<Point>| points.into_iter().map(|[x, y, _]| [x, y]).collect::<Vec<_>>();
        let once = [[0.0, 0.0], [1.0, 0.0], [3.0, 0.0], [4.0, 1.0], [4.0, 3.0], [4.0, 4.0]];
        assert_eq!(flat(smoothed(&line, false, 1)), once);
        let ring = [line[0], line[1], line[2], line[0]];
        for times in 0..4 {
            let open = smoothed(&line, false, times);
            assert_eq!((open[0], open[open.len() - 1]), (line[0], line[2]));
            let closed = smoothed(&ring, true, times);
            assert_eq!(closed[0], closed[closed.len() - 1]);
            // No point is repeated.
            assert!(closed.windows(2).all(|pair| pair[0] != pair[1]));
        }
        assert_eq!(smoothed(&line[..1], false, 3), line[..1]);
    }
}
