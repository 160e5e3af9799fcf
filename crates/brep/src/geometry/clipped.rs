//! Convex polygons: triangles clipped to cells and split by planes.

/// A point, in units of a cube's cells.
pub type Point = [f64; 3];

/// A convex polygon. A triangle that was clipped by up to six planes has up to 9 vertices. The
/// capacity is slightly larger, since rounding may make an almost parallel polygon cross a plane
/// more than twice. Vertices beyond the capacity are dropped; the lost area is negligible.
#[derive(Clone, Copy)]
pub struct ClippedPolygon {
    points: [Point; 12],
    len: usize,
}

impl ClippedPolygon {
    const NONE: ClippedPolygon = ClippedPolygon { points: [[0.0; 3]; 12], len: 0 };

    /// Converts a triangle of grid points to units of cells, which are `cell` grid units wide and
    /// begin at `min`.
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

    /// Returns the polygon's vertices.
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

    /// Returns the minimum and maximum coordinate along an axis.
    #[inline]
    pub fn range(&self, axis: usize) -> (f64, f64) {
        range(self.points().iter().map(|point| point[axis]))
    }

    /// Returns the mean of the vertices, a point of the polygon.
    #[inline]
    pub fn middle(&self) -> Point {
        let points = self.points();
        std::array::from_fn(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / points.len() as f64)
    }

    /// Splits the polygon into one or two polygons with free capacity for vertices.
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

    /// Splits the polygon at a plane across an axis: returns the fragments below and above it.
    #[inline]
    pub fn split(&self, axis: usize, plane: f64) -> (ClippedPolygon, ClippedPolygon) {
        self.split_by(|point| point[axis] - plane, |cut| cut[axis] = plane)
    }

    /// Splits the polygon at the zero of a linear function: returns the fragments with negative and
    /// positive values (Sutherland and Hodgman, 1974). `onto` moves a computed point to where the
    /// function is exactly zero.
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

/// Returns the minimum and maximum of some numbers.
#[inline]
pub fn range(numbers: impl Iterator<Item = f64>) -> (f64, f64) {
    numbers.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
}

/// Clips a polygon to the cells of a cube with `side` cells per axis. Visits each fragment with its
/// cell and a flag. The flag is false if the fragment is only in the cell's lower wall and does not
/// cut the cell.
pub fn clip(polygon: ClippedPolygon, side: usize, each: &mut impl FnMut(&ClippedPolygon, [usize; 3], bool)) {
    clip_along(polygon, side, 3, ([0; 3], true), each);
}

/// Clips a polygon along the first `axes` axes, the last one first.
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
        // In the cell's lower wall.
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
