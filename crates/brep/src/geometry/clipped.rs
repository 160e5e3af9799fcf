//! Convex polygons: triangles clipped to cells and cut by planes.

/// A point, in cells of a cube.
pub type Point = [f64; 3];

/// A convex polygon: a triangle cut by up to six planes has up to 9 corners. (There is room for a few more,
/// since rounding may make a polygon that is parallel to a plane cross it more than twice; what does not fit
/// then has no area to speak of.)
#[derive(Clone, Copy)]
pub struct ClippedPolygon {
    points: [Point; 12],
    len: usize,
}

impl ClippedPolygon {
    const NONE: ClippedPolygon = ClippedPolygon { points: [[0.0; 3]; 12], len: 0 };

    /// A triangle of grid points, in cells of so many grid steps from a grid point.
    #[inline]
    pub fn of_triangle(corners: &[[i32; 3]; 3], min: [i32; 3], cell: i32) -> ClippedPolygon {
        let scale = 1.0 / f64::from(cell);
        let point = |corner: [i32; 3]| -> Point {
            std::array::from_fn(|axis| (corner[axis] as i64 - min[axis] as i64) as f64 * scale)
        };
        ClippedPolygon::of_points(&corners.map(point))
    }

    pub(crate) fn of_points(points: &[Point]) -> ClippedPolygon {
        let mut polygon = ClippedPolygon::NONE;
        points.iter().for_each(|point| polygon.push(*point));
        polygon
    }

    /// Corners of the polygon.
    #[inline]
    pub fn points(&self) -> &[Point] {
        &self.points[..self.len]
    }

    #[inline]
    fn push(&mut self, point: Point) {
        if let Some(free) = self.points.get_mut(self.len) {
            *free = point;
            self.len += 1;
        }
    }

    /// Least and greatest coordinate along an axis.
    #[inline]
    pub fn range(&self, axis: usize) -> (f64, f64) {
        range(self.points().iter().map(|point| point[axis]))
    }

    /// The mean of the corners, a point of the polygon.
    #[inline]
    pub fn middle(&self) -> Point {
        let points = self.points();
        std::array::from_fn(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / points.len() as f64)
    }

    /// The polygon in parts that have room for more corners.
    pub fn halves(&self) -> impl Iterator<Item = ClippedPolygon> {
        let points = self.points();
        let middle = if points.len() > 8 { points.len() / 2 } else { points.len() - 1 };
        let rest = (middle + 1 < points.len()).then(|| {
            let mut rest = ClippedPolygon::of_points(&points[middle..]);
            rest.push(points[0]);
            rest
        });
        [Some(ClippedPolygon::of_points(&points[..=middle])), rest].into_iter().flatten()
    }

    /// Clips the polygon at a plane across an axis: the parts below and above it.
    #[inline]
    pub fn split(&self, axis: usize, plane: f64) -> (ClippedPolygon, ClippedPolygon) {
        self.split_by(|point| point[axis] - plane, |cut| cut[axis] = plane)
    }

    /// Clips the polygon where a linear function is zero: the parts where it is below and above (Sutherland and
    /// Hodgman, 1974). `onto` moves a point that was found to where it is zero exactly.
    #[inline]
    pub fn split_by(
        &self,
        distance: impl Fn(&Point) -> f64,
        onto: impl Fn(&mut Point),
    ) -> (ClippedPolygon, ClippedPolygon) {
        let (mut below, mut above) = (ClippedPolygon::NONE, ClippedPolygon::NONE);
        let Some(mut from) = self.points().last().copied() else { return (below, above) };
        for to in self.points() {
            let (a, b) = (distance(&from), distance(to));
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                let share = a / (a - b);
                let mut cut: Point = std::array::from_fn(|i| from[i] + (to[i] - from[i]) * share);
                onto(&mut cut);
                below.push(cut);
                above.push(cut);
            }
            if b <= 0.0 {
                below.push(*to);
            }
            if b >= 0.0 {
                above.push(*to);
            }
            from = *to;
        }
        (below, above)
    }
}

/// Least and greatest of some numbers.
#[inline]
pub fn range(numbers: impl Iterator<Item = f64>) -> (f64, f64) {
    numbers.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
}

/// Cuts a polygon into what lies in each cell of a cube with so many along each axis: hands out the part, its cell, and
/// whether it cuts the cell and does not only lie in the wall at which the cell begins.
pub fn clip(polygon: ClippedPolygon, side: usize, each: &mut impl FnMut(&ClippedPolygon, [usize; 3], bool)) {
    clip_along(polygon, side, 3, ([0; 3], true), each);
}

/// Cuts a polygon along the first `axes` axes, one after the other.
#[inline]
fn clip_along(
    polygon: ClippedPolygon,
    side: usize,
    axes: usize,
    (cell, is_cut): ([usize; 3], bool),
    each: &mut impl FnMut(&ClippedPolygon, [usize; 3], bool),
) {
    let Some(axis) = axes.checked_sub(1) else {
        if polygon.points().len() > 2 {
            each(&polygon, cell, is_cut);
        }
        return;
    };
    let (low, high) = polygon.range(axis);
    let at = |index: usize| {
        let mut cell = cell;
        cell[axis] = index;
        cell
    };
    if high < 0.0 || low >= side as f64 {
        return;
    }
    let first = low.max(0.0) as usize;
    if low == high && low == low.trunc() {
        // In the wall at which a cell begins.
        return clip_along(polygon, side, axis, (at(first), false), each);
    }
    let end = (high.ceil() as usize).min(side);
    let mut rest = if low < 0.0 { polygon.split(axis, 0.0).1 } else { polygon };
    for index in first..end {
        let wall = (index + 1) as f64;
        if high <= wall {
            return clip_along(rest, side, axis, (at(index), is_cut), each);
        }
        let (below, above) = rest.split(axis, wall);
        clip_along(below, side, axis, (at(index), is_cut), each);
        rest = above;
    }
}
