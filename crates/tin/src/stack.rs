//! Several surfaces on a common triangulation, ordered from top to bottom.

use std::collections::BTreeMap;

use crate::layers::{LayerInput, LayerOptions, LayerSurface};
use crate::mesh::{Lines, Mesh, NONE};
use crate::smooth::{Smoothing, smooth};
use crate::surface::{DistinctPoints, Duplicates, SurfaceReport, inside, order, ring_segments};
use crate::tin::Tin;
use spinney_base::{Error, Progress, Result};
use spinney_brep::Grid;

/// Surfaces on a common triangulation, from top to bottom, of which none is below the next one.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OrderedSurfaces {
    /// The surfaces, all with the same triangles.
    pub tins: Vec<Tin>,
    /// Number of vertices at which an upper surface was below a lower one and was moved up to it.
    pub clipped: u64,
    /// Statistics of the points: see [`LayerReport::surface`](crate::LayerReport::surface).
    pub surface: SurfaceReport,
    /// Maximum displacement of a point by snapping to the grid, in units of the coordinates.
    pub displacement: f64,
    /// Maximum movement of a height by smoothing.
    pub smoothed: f64,
}

/// Triangulates the surfaces between which layers lie: those that the layers of
/// [`build_layers`](crate::build_layers) have as tops and bases, on the same grid.
///
/// # Errors
/// If there are fewer than two surfaces; if one cannot be triangulated; if breaklines cross; on
/// cancellation.
pub fn order_surfaces(
    input: &LayerInput,
    options: &LayerOptions,
    progress: &dyn Progress,
) -> Result<OrderedSurfaces> {
    let (stack, StackReport { surface, displacement, smoothed, clipped }) =
        Stack::ordered(input, options, progress)?;
    let world = |position: [i32; 2], height: i32| stack.grid.to_world([position[0], position[1], height]);
    let flat = |position: &[i32; 2]| {
        let [x, y, _] = world(*position, 0);
        [x, y]
    };
    let mut mesh = Mesh { points: stack.positions.iter().map(flat).collect(), ..Mesh::default() };
    mesh.triangles.clone_from(&stack.mesh.triangles);
    mesh.neighbours.clone_from(&stack.mesh.neighbours);
    let heights = stack.heights.iter().map(|heights| {
        let heights = stack.positions.iter().zip(heights);
        heights.map(|(position, height)| world(*position, *height)[2]).collect()
    });
    let tins = heights.map(|heights| Tin { mesh: mesh.clone(), heights }).collect();
    Ok(OrderedSurfaces { tins, clipped, surface, displacement, smoothed })
}

/// Surfaces on a common triangulation, in grid units.
pub(crate) struct Stack {
    pub(crate) grid: Grid,
    pub(crate) mesh: Mesh,
    pub(crate) positions: Vec<[i32; 2]>,
    /// Heights of each surface, from top to bottom, at each vertex.
    pub(crate) heights: Vec<Vec<i32>>,
    /// Whether each vertex is a point of a surface, per surface.
    are_points: Vec<Vec<bool>>,
}

/// Statistics of surfaces that were put in order.
pub(crate) struct StackReport {
    pub(crate) surface: SurfaceReport,
    /// Maximum displacement of a point by snapping to the grid, in units of the coordinates.
    pub(crate) displacement: f64,
    /// Maximum movement of a height by smoothing, in units of the coordinates.
    pub(crate) smoothed: f64,
    /// Vertices at which an upper surface was moved up to a lower one.
    pub(crate) clipped: u64,
}

impl Stack {
    /// Triangulates surfaces, smooths them if `options` say so, and moves those that are below the
    /// next one.
    pub(crate) fn ordered(
        input: &LayerInput,
        options: &LayerOptions,
        progress: &dyn Progress,
    ) -> Result<(Stack, StackReport)> {
        let mut surface = SurfaceReport::default();
        let (mut stack, displacement) = Stack::new(input, options.snap, &mut surface)?;
        progress.check()?;
        let smoothed = stack.smooth(options.smoothing.as_ref(), progress)?;
        let clipped = stack.put_in_order()?;
        progress.check()?;
        Ok((stack, StackReport { surface, displacement, smoothed, clipped }))
    }

    /// Triangulates the points of all surfaces, snapped to a grid. Also returns the maximum
    /// displacement.
    fn new(input: &LayerInput, snap: Option<f64>, report: &mut SurfaceReport) -> Result<(Stack, f64)> {
        if input.surfaces.len() < 2 {
            let found = input.surfaces.len().to_string();
            return Err(Error::invalid("surfaces of layers", found, "at least 2, from top to bottom"));
        }
        let lines = input.breaklines.iter().flatten().chain(input.outlines.iter().flatten().flatten());
        let all = || input.surfaces.iter().flat_map(|surface| &surface.points);
        if let Some(point) = all().find(|point| point.iter().any(|at| !at.is_finite())) {
            return Err(Error::invalid("point of a surface", format!("{point:?}"), "finite numbers"));
        }
        if let Some(corner) = lines.clone().find(|corner| corner.iter().any(|at| !at.is_finite())) {
            return Err(Error::invalid("vertex of a line", format!("{corner:?}"), "finite numbers"));
        }
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        let mut reach = |axis: usize, at: f64| {
            bounds[0][axis] = bounds[0][axis].min(at);
            bounds[1][axis] = bounds[1][axis].max(at);
        };
        all().for_each(|point| (0..3).for_each(|axis| reach(axis, point[axis])));
        lines.clone().for_each(|corner| (0..2).for_each(|axis| reach(axis, corner[axis])));
        if bounds[0][2] > bounds[1][2] {
            return Err(Error::invalid("points of a surface", "none", "at least 3 that are not on one line"));
        }
        let grid = match snap {
            Some(_) => Grid::over(bounds, snap)?,
            // A grid finer than the default if possible, because surfaces have thin triangles.
            None => {
                let usual = Grid::over(bounds, None)?;
                Grid::over(bounds, Some(usual.width() / 4.0)).unwrap_or(usual)
            }
        };
        let mut furthest = 0.0;
        let mut to_grid = |point: [f64; 3]| -> Result<[f64; 3]> {
            let snapped = grid.snap(point).ok_or_else(|| {
                Error::invalid("point of a surface", format!("{point:?}"), "points within the grid")
            })?;
            let there = grid.to_world(snapped);
            let squared: f64 = (0..3).map(|axis| (there[axis] - point[axis]).powi(2)).sum();
            furthest = f64::max(furthest, squared.sqrt());
            Ok(snapped.map(f64::from))
        };
        let mut tins = Vec::new();
        let mut everywhere: Vec<[f64; 3]> = Vec::new();
        let free = Lines { breaklines: &[], outlines: &[] };
        for LayerSurface { name, points } in &input.surfaces {
            let named = |error: Error| match error {
                Error::Invalid { what, found, expected } => {
                    Error::invalid(format!("surface {name}: {what}"), found, expected)
                }
                error => error,
            };
            let points: Vec<[f64; 3]> = points.iter().map(|point| to_grid(*point)).collect::<Result<_>>()?;
            let distinct = DistinctPoints::of(&points, input.duplicates, report).map_err(named)?;
            everywhere.extend(distinct.positions.iter().map(|[x, y]| [*x, *y, 0.0]));
            let mesh = Mesh::new(&distinct.positions, &free).map_err(named)?;
            tins.push(Tin { mesh, heights: distinct.heights });
        }
        let mut flat = |[x, y]: [f64; 2]| to_grid([x, y, bounds[0][2]]).map(|[x, y, _]| [x, y]);
        let mut breaklines: Vec<Vec<[f64; 2]>> = Vec::new();
        for line in &input.breaklines {
            breaklines.push(line.iter().map(|corner| flat(*corner)).collect::<Result<_>>()?);
        }
        let mut outlines = input.outlines.clone();
        for corner in outlines.iter_mut().flatten().flatten() {
            *corner = flat(*corner)?;
        }
        let corners = breaklines.iter().flatten().chain(outlines.iter().flatten().flatten());
        everywhere.extend(corners.map(|[x, y]| [*x, *y, 0.0]));
        let distinct = DistinctPoints::of(&everywhere, Duplicates::Mean, &mut SurfaceReport::default())?;
        let ends = breaklines.iter().flat_map(|line| line.windows(2));
        let segments: Vec<[u32; 2]> =
            ends.filter_map(|ends| Some([distinct.number(ends[0])?, distinct.number(ends[1])?])).collect();
        let rings = ring_segments(&outlines, &distinct);
        let mut mesh = Mesh::new(&distinct.positions, &Lines { breaklines: &segments, outlines: &rings })?;
        report.crossings = (mesh.points.len() - distinct.positions.len()) as u64;
        if !outlines.is_empty() {
            let inside = inside(&mesh, &outlines);
            mesh.keep(&|triangle| inside[triangle]);
        }
        if mesh.triangles.is_empty() {
            return Err(Error::invalid("outline", "an outline without area", "polygons with an area"));
        }
        // (Points created at crossings of lines are not on the grid.)
        let snapped: Vec<[i32; 2]> =
            mesh.points.iter().map(|position| position.map(|at| at.round_ties_even() as i32)).collect();
        let (mut heights, mut are_points) = (Vec::new(), Vec::new());
        for tin in &tins {
            // (Positions of a surface's points are in ascending order.)
            let is_point = |position: &[f64; 2]| {
                tin.mesh.points.binary_search_by(|other| order(other, position)).is_ok()
            };
            are_points.push(mesh.points.iter().map(is_point).collect());
            let (boundary, mut near) = (tin.mesh.boundary(), 0);
            let above = mesh.points.iter().map(|position| {
                let (height, is_outside) = tin.extended(*position, &mut near, &boundary);
                report.extended += u64::from(is_outside);
                height.round_ties_even() as i32
            });
            heights.push(above.collect());
        }
        Ok((Stack { grid, mesh, positions: snapped, heights, are_points }, furthest))
    }

    /// Smooths the heights of all surfaces, which may cross then. Returns the maximum movement, in
    /// units of the coordinates.
    pub(crate) fn smooth(&mut self, smoothing: Option<&Smoothing>, progress: &dyn Progress) -> Result<f64> {
        let Some(smoothing) = smoothing else { return Ok(0.0) };
        smoothing.check()?;
        if smoothing.keeps_points {
            let (mesh, middles) = self.mesh.divided();
            for [a, b] in middles {
                let position = self.between(a, b, 1, 2);
                self.positions.push(position);
                for heights in &mut self.heights {
                    heights.push(share(heights[a as usize], heights[b as usize], 1, 2));
                }
            }
            self.mesh = mesh;
        }
        let width = self.grid.width();
        // (Rounding to the grid must not exceed the limit; the cast saturates.)
        let limit = (smoothing.max_distance / width).floor() as i64;
        let in_units = Smoothing { max_distance: smoothing.max_distance / width, ..*smoothing };
        let mut moved = 0;
        for (heights, are_points) in self.heights.iter_mut().zip(&self.are_points) {
            let mut is_fixed = self.mesh.fixed();
            if smoothing.keeps_points {
                is_fixed.iter_mut().zip(are_points).for_each(|(is_fixed, is_point)| *is_fixed |= is_point);
            }
            let mut smoothed: Vec<f64> = heights.iter().map(|height| f64::from(*height)).collect();
            smooth(&self.mesh, &mut smoothed, &is_fixed, &in_units, progress)?;
            for (height, smoothed) in heights.iter_mut().zip(smoothed) {
                let by = (smoothed.round_ties_even() as i64 - i64::from(*height)).clamp(-limit, limit);
                moved = moved.max(by.abs());
                *height = (i64::from(*height) + by) as i32;
            }
        }
        Ok(moved as f64 * width)
    }

    /// Returns the height of a surface above the next one at a vertex.
    pub(crate) fn above(&self, upper: usize, vertex: u32) -> i64 {
        i64::from(self.heights[upper][vertex as usize]) - i64::from(self.heights[upper + 1][vertex as usize])
    }

    /// Makes the surfaces ordered, from the lowest one up: divides triangles where two surfaces
    /// cross, and moves the upper one to the lower one where it is below. Returns the number of
    /// vertices that were moved.
    pub(crate) fn put_in_order(&mut self) -> Result<u64> {
        let mut clipped = 0;
        for upper in (0..self.heights.len() - 1).rev() {
            self.divide(upper)?;
            for vertex in 0..self.positions.len() {
                if self.above(upper, vertex as u32) < 0 {
                    self.heights[upper][vertex] = self.heights[upper + 1][vertex];
                    clipped += 1;
                }
            }
        }
        Ok(clipped)
    }

    /// Divides triangles along the line where a surface crosses the next one.
    // Invariant: ordered surfaces stay ordered. Heights of a new vertex are rounded from the same
    // position on an edge, which preserves an order that holds at both of the edge's ends.
    fn divide(&mut self, upper: usize) -> Result<()> {
        let mut crossings: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        loop {
            crossings.clear();
            let mut is_changed = false;
            for triangle in 0..self.mesh.triangles.len() {
                let [a, b, c] = self.mesh.triangles[triangle];
                for [a, b] in [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)]) {
                    let (from, to) = (self.above(upper, a), self.above(upper, b));
                    if from.signum() * to.signum() >= 0 {
                        continue;
                    }
                    let position = self.between(a, b, from, from - to);
                    // A crossing that snaps to an end of its edge is moved to that end.
                    match [a, b].into_iter().find(|end| self.positions[*end as usize] == position) {
                        None => _ = crossings.insert([a, b], NONE),
                        Some(end) => {
                            self.heights[upper][end as usize] = self.heights[upper + 1][end as usize];
                            is_changed = true;
                        }
                    }
                }
            }
            if !is_changed {
                break;
            }
        }
        for (edge, number) in &mut crossings {
            let [a, b] = *edge;
            let (from, to) = (self.above(upper, a), self.above(upper, b));
            *number = self.positions.len() as u32;
            let position = self.between(a, b, from, from - to);
            for heights in &mut self.heights {
                heights.push(share(heights[a as usize], heights[b as usize], from, from - to));
            }
            self.positions.push(position);
            self.heights[upper][*number as usize] = self.heights[upper + 1][*number as usize];
        }
        let mut triangles = Vec::with_capacity(self.mesh.triangles.len());
        for corners in &self.mesh.triangles {
            let [a, b, c] = *corners;
            let mut ring = Vec::with_capacity(5);
            for [from, to] in [[a, b], [b, c], [c, a]] {
                ring.push(from);
                ring.extend(crossings.get(&[from.min(to), from.max(to)]));
            }
            if ring.len() == 3 {
                triangles.push(*corners);
                continue;
            }
            // Rotate the ring to start at one of the two vertices where the surfaces meet. The
            // other one then separates the vertices on one side from those on the other.
            let first = (0..ring.len()).find(|at| self.above(upper, ring[*at]) == 0).unwrap_or(0);
            ring.rotate_left(first);
            let second = (1..ring.len()).find(|at| self.above(upper, ring[*at]) == 0).unwrap_or(1);
            let other: Vec<u32> = ring[second..].iter().chain(&ring[..1]).copied().collect();
            for part in [&ring[..=second], &other] {
                triangles.extend((1..part.len() - 1).map(|at| [part[0], part[at], part[at + 1]]));
            }
        }
        self.mesh.neighbours = crate::mesh::neighbours(&triangles);
        self.mesh.triangles = triangles;
        for corners in &self.mesh.triangles {
            if self.twice_area(*corners) < 0 {
                let [x, y] = self.positions[corners[0] as usize];
                let [x, y, _] = self.grid.to_world([x, y, 0]);
                let found = format!("a triangle thinner than a grid unit near {x}, {y}");
                return Err(Error::invalid("layers", found, "points farther apart, or a finer grid"));
            }
        }
        Ok(())
    }

    /// Returns the position at `part / whole` of an edge.
    fn between(&self, a: u32, b: u32, part: i64, whole: i64) -> [i32; 2] {
        let (from, to) = (self.positions[a as usize], self.positions[b as usize]);
        [0, 1].map(|axis| share(from[axis], to[axis], part, whole))
    }

    pub(crate) fn twice_area(&self, corners: [u32; 3]) -> i64 {
        let [a, b, c] = corners.map(|corner| self.positions[corner as usize].map(i64::from));
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }
}

/// Interpolates between two numbers at `part / whole`, rounded to the nearest integer.
fn share(from: i32, to: i32, part: i64, whole: i64) -> i32 {
    let (from, to, part, whole) = (i128::from(from), i128::from(to), i128::from(part), i128::from(whole));
    let (part, whole) = if whole < 0 { (-part, -whole) } else { (part, whole) };
    // (Adding one half and rounding down rounds halves up, whatever their sign.)
    ((2 * (from * (whole - part) + to * part) + whole).div_euclid(2 * whole)) as i32
}
