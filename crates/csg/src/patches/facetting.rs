//! Facets of shells within a distance of the patches, without cracks.
//!
//! Bound. Let f be a patch, T a triangle in its parameters with extents du and dv, l the linear
//! function with the values of f at the vertices of T, and p a point of T with weights w of the
//! vertices x. Taylor's formula at p says that l(p) - f(p) is the sum of w f''(x - p, x - p) / 2,
//! with f'' at points between p and x. The weights make p the mean of the vertices. So the squares
//! of their distances from p along u have a mean of at most du² / 4, and likewise along v. Hence
//!
//! |l - f| <= (|f_uu| du² + 2 |f_uv| du dv + |f_vv| dv²) / 8.
//!
//! The derivatives are bounded by differences of control points.
//!
//! The number of segments of a boundary curve depends on its control points only, so that adjacent
//! patches have equal vertices there. Its segments use half of the distance. If the grid of a patch
//! has other numbers of columns and rows, four strips join it to the boundary. They are narrow
//! enough to be within the distance: as the width of a strip decreases, its bound approaches that
//! of the boundary curve.

use std::collections::HashMap;

use super::patch::{Curve, Derivatives};
use super::{Point, Shell, ShellPatch, ShellSide};

/// Triangles of a shell, counterclockwise as seen from outside.
#[derive(Debug, Default)]
pub(crate) struct Facets {
    pub(crate) vertices: Vec<Point>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// Returns the number of segments of a boundary curve for a maximum distance of `within` / 2.
fn segments(curve: &Curve, within: f64) -> f64 {
    // (A chord of a loop would be a point, and two chords would enclose nothing.)
    let [from, to] = curve.ends();
    let least = if from == to { 3.0 } else { 1.0 };
    (curve.second() / (4.0 * within)).sqrt().ceil().max(least)
}

/// Subdivision of a patch.
struct Subdivision {
    /// Segments of the four sides; those of a pole are columns or rows of the grid.
    sides: [f64; 4],
    columns: f64,
    rows: f64,
}

impl Subdivision {
    fn of(patch: &ShellPatch, derivatives: &Derivatives, segments: &[f64], within: f64) -> Subdivision {
        let count = |side: usize| match patch.sides[side] {
            ShellSide::Pole => None,
            ShellSide::Curve(index, _) => Some(segments[index as usize]),
        };
        // (2 du dv <= du² + dv² separates the parameters. Each gets half of the distance.)
        let needed = |second: f64| ((second + derivatives.uv) / (4.0 * within)).sqrt().ceil();
        let along = |second: f64, sides: [usize; 2]| {
            sides.into_iter().filter_map(count).fold(needed(second).max(1.0), f64::max)
        };
        let (columns, rows) = (along(derivatives.uu, [0, 2]), along(derivatives.vv, [1, 3]));
        let sides = [0, 1, 2, 3].map(|side| count(side).unwrap_or([columns, rows][side % 2]));
        Subdivision { sides, columns, rows }
    }

    /// Whether the grid has the vertices of the boundary.
    fn is_regular(&self) -> bool {
        self.sides == [self.columns, self.rows, self.columns, self.rows]
    }

    /// Returns the number of triangles.
    fn triangles(&self) -> f64 {
        let strips = if self.is_regular() { 0.0 } else { 2.0 * (self.columns + self.rows) };
        2.0 * self.columns * self.rows + strips + self.sides.iter().sum::<f64>()
    }

    /// Returns the width of the strip at a side.
    fn strip(&self, side: usize, second_at_side: f64, derivatives: &Derivatives, within: f64) -> f64 {
        let Derivatives { uu, uv, vv, uuv, uvv } = *derivatives;
        let (along, across, change, across_count) = match side % 2 {
            0 => (uu, vv, uuv, self.rows),
            _ => (vv, uu, uvv, self.columns),
        };
        let step = 1.0 / self.sides[side];
        let mut width = (1.0 / across_count).min(0.25);
        let bound = |width: f64| {
            let second = (second_at_side + width * change).min(along);
            second * step * step + 2.0 * uv * step * width + across * width * width
        };
        // (The limit is not reached: at the side, the bound is at most half of the distance.)
        for _ in 0..64 {
            if bound(width) <= 8.0 * within {
                break;
            }
            width /= 2.0;
        }
        width
    }
}

impl Shell {
    /// Returns the number of facets within a distance, before those without area are left out.
    pub(crate) fn facet_count(&self, within: f64) -> f64 {
        let segments: Vec<f64> = self.curves.iter().map(|curve| segments(curve, within)).collect();
        let of = |patch: &ShellPatch| {
            Subdivision::of(patch, &patch.patch.derivatives(), &segments, within).triangles()
        };
        self.patches.iter().map(of).sum()
    }

    /// Returns facets within a distance of the shell. The caller has checked their number.
    pub(crate) fn facets(&self, within: f64) -> Facets {
        let mut made = Facetting { facets: Facets::default(), corners: HashMap::new() };
        let segments: Vec<f64> = self.curves.iter().map(|curve| segments(curve, within)).collect();
        let polylines: Vec<Vec<u32>> = self
            .curves
            .iter()
            .zip(&segments)
            .map(|(curve, count)| {
                let [from, to] = curve.ends().map(|point| made.corner(point));
                let inner = (1..*count as u32).map(|at| made.vertex(curve.at(f64::from(at) / count)));
                std::iter::once(from).chain(inner.collect::<Vec<_>>()).chain([to]).collect()
            })
            .collect();
        for patch in &self.patches {
            let derivatives = patch.patch.derivatives();
            let subdivision = Subdivision::of(patch, &derivatives, &segments, within);
            let boundary = [0, 1, 2, 3].map(|side| match patch.sides[side] {
                ShellSide::Pole => {
                    let pole = made.corner(patch.patch.boundary(side).points[0]);
                    vec![pole; subdivision.sides[side] as usize + 1]
                }
                ShellSide::Curve(index, true) => polylines[index as usize].clone(),
                ShellSide::Curve(index, false) => polylines[index as usize].iter().rev().copied().collect(),
            });
            let widths = match subdivision.is_regular() {
                true => None,
                false => Some([0, 1, 2, 3].map(|side| {
                    subdivision.strip(side, patch.patch.boundary(side).second(), &derivatives, within)
                })),
            };
            made.patch(patch, &subdivision, &boundary, widths);
        }
        made.facets
    }
}

/// Facets of a shell that are being made.
struct Facetting {
    facets: Facets,
    /// Vertices at the corners of patches, by the bits of their coordinates.
    corners: HashMap<[u64; 3], u32>,
}

/// A row of vertices with their parameters.
type Row = Vec<(f64, u32)>;

impl Facetting {
    fn vertex(&mut self, point: Point) -> u32 {
        self.facets.vertices.push(point);
        self.facets.vertices.len() as u32 - 1
    }

    /// Returns the vertex at a corner of patches.
    fn corner(&mut self, point: Point) -> u32 {
        let bits = point.map(f64::to_bits);
        if let Some(vertex) = self.corners.get(&bits) {
            return *vertex;
        }
        let vertex = self.vertex(point);
        self.corners.insert(bits, vertex);
        vertex
    }

    /// Adds a triangle, unless it has no area because two of its vertices are the same.
    fn triangle(&mut self, [a, b, c]: [u32; 3], is_reversed: bool) {
        if a != b && b != c && c != a {
            self.facets.triangles.push(if is_reversed { [a, c, b] } else { [a, b, c] });
        }
    }

    /// Adds the facets of a patch. `boundary` has the vertices of its sides, counterclockwise.
    /// `widths` has the widths of the strips between the boundary and the grid, if there are any.
    fn patch(
        &mut self,
        patch: &ShellPatch,
        subdivision: &Subdivision,
        boundary: &[Vec<u32>; 4],
        widths: Option<[f64; 4]>,
    ) {
        let (columns, rows) = (subdivision.columns as usize, subdivision.rows as usize);
        let [low_v, high_u, high_v, low_u] = widths.unwrap_or([0.0; 4]);
        let between = |low: f64, high: f64, at: usize, count: usize| {
            low + (1.0 - low - high) * (at as f64 / count as f64)
        };
        let u_of = |column: usize| between(low_u, high_u, column, columns);
        let v_of = |row: usize| between(low_v, high_v, row, rows);
        let mut grid = vec![0u32; (columns + 1) * (rows + 1)];
        for row in 0..=rows {
            for column in 0..=columns {
                let on_side = match (widths, column, row) {
                    (Some(_), ..) => None,
                    (None, column, 0) => Some((0, column)),
                    (None, column, row) if row == rows => Some((2, columns - column)),
                    (None, 0, row) => Some((3, rows - row)),
                    (None, column, row) if column == columns => Some((1, row)),
                    _ => None,
                };
                grid[row * (columns + 1) + column] = match on_side {
                    Some((side, index)) => boundary[side][index],
                    None => self.vertex(patch.patch.at(u_of(column), v_of(row))),
                };
            }
        }
        let at = |column: usize, row: usize| grid[row * (columns + 1) + column];
        for row in 0..rows {
            for column in 0..columns {
                let [a, b] = [at(column, row), at(column + 1, row)];
                let [c, d] = [at(column + 1, row + 1), at(column, row + 1)];
                self.triangle([a, b, c], patch.is_reversed);
                self.triangle([a, c, d], patch.is_reversed);
            }
        }
        if widths.is_none() {
            return;
        }
        let inner: [Row; 4] = [
            (0..=columns).map(|column| (u_of(column), at(column, 0))).collect(),
            (0..=rows).map(|row| (v_of(row), at(columns, row))).collect(),
            (0..=columns).rev().map(|column| (1.0 - u_of(column), at(column, rows))).collect(),
            (0..=rows).rev().map(|row| (1.0 - v_of(row), at(0, row))).collect(),
        ];
        for (outer, inner) in boundary.iter().zip(&inner) {
            let last = (outer.len() - 1) as f64;
            let outer: Row = (0..).zip(outer).map(|(at, vertex)| (f64::from(at) / last, *vertex)).collect();
            self.strip(&outer, inner, patch.is_reversed);
        }
    }

    /// Adds the triangles between two rows of vertices. In the direction of the rows, the inner one
    /// is on the left. A triangle extends along the rows by at most a step of one of them.
    fn strip(&mut self, outer: &[(f64, u32)], inner: &[(f64, u32)], is_reversed: bool) {
        let (mut on_outer, mut on_inner) = (0, 0);
        while on_outer + 1 < outer.len() || on_inner + 1 < inner.len() {
            let (from, to) = (outer[on_outer].1, inner[on_inner].1);
            let next = [outer.get(on_outer + 1), inner.get(on_inner + 1)];
            match next {
                [Some((at, vertex)), other] if other.is_none_or(|(other, _)| at <= other) => {
                    self.triangle([from, *vertex, to], is_reversed);
                    on_outer += 1;
                }
                [_, Some((_, vertex))] => {
                    self.triangle([from, *vertex, to], is_reversed);
                    on_inner += 1;
                }
                _ => return,
            }
        }
    }
}
