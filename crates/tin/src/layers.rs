//! Layers between surfaces as closed solids of an exact model.

use std::collections::BTreeMap;

use crate::mesh::{Lines, Mesh, NONE};
use crate::surface::{DistinctPoints, Duplicates, SurfaceReport, inside, ring_segments};
use crate::tin::Tin;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_brep::{BuildReport, Face, Grid, ModelBuilder};
use spinney_container::{Codec, Metadata, Tag};
use spinney_crs::{Crs, PolygonParts};

/// A surface that bounds layers.
#[derive(Clone, Debug, Default)]
pub struct LayerSurface {
    /// Name of the surface.
    pub name: String,
    /// Points of the surface.
    pub points: Vec<[f64; 3]>,
}

/// The surfaces between which layers lie, with breaklines and outlines.
#[derive(Clone, Debug, Default)]
pub struct LayerInput {
    /// Two or more surfaces, from top to bottom.
    pub surfaces: Vec<LayerSurface>,
    /// Lines that become edges of all surfaces, such as faults.
    pub breaklines: Vec<Vec<[f64; 2]>>,
    /// Polygons that bound the layers horizontally. Without any, layers extend to the convex hull
    /// of all points.
    pub outlines: PolygonParts,
    /// Rule for points of a surface at the same position with different heights.
    pub duplicates: Duplicates,
}

/// Options for building layers.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LayerOptions {
    /// Width of a grid unit. Default: a quarter of the smallest power of two with which the longest
    /// side has at most about 2^24 units, or that power of two if no grid with a quarter of it
    /// fits.
    pub snap: Option<f64>,
    /// Coordinate reference system.
    pub crs: Option<Crs>,
    /// Unit of length, stored in the file.
    pub unit: Option<String>,
    /// Compression of the file.
    pub codec: Codec,
    /// Memory limit, in bytes.
    pub memory: u64,
    /// Provenance of the surfaces, stored in the file if not empty.
    pub provenance: String,
}

impl Default for LayerOptions {
    fn default() -> Self {
        let (snap, crs, unit, codec) = (None, None, None, Codec::default());
        LayerOptions { snap, crs, unit, codec, memory: 1 << 30, provenance: String::new() }
    }
}

impl LayerOptions {
    /// Returns the default options, with the finest grid.
    pub fn new() -> LayerOptions {
        LayerOptions::default()
    }
}

/// Measures of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerMeasure {
    /// Names of the surfaces above and below the layer.
    pub name: String,
    /// Volume, in cubic units of the coordinates.
    pub volume: f64,
    /// Horizontal area that the layer covers, in square units of the coordinates.
    pub area: f64,
}

/// Statistics of layers.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LayerReport {
    /// The layers, from top to bottom. A layer without a volume is not in the model.
    pub layers: Vec<LayerMeasure>,
    /// Number of faces of the model.
    pub faces: u64,
    /// Number of vertices at which an upper surface was below a lower one and was moved up to it.
    pub clipped: u64,
    /// Statistics of the points of all surfaces. `extended` counts, over all surfaces, vertices of
    /// the common triangulation outside of the convex hull of the surface's points.
    pub surface: SurfaceReport,
    /// Maximum displacement of a point by snapping to the grid, in units of the coordinates.
    pub displacement: f64,
    /// Statistics of the octree.
    pub built: BuildReport,
}

/// Builds a model of the layers between surfaces. Each layer with a volume is a part of the model.
/// All surfaces share one triangulation of the points of all. A surface's height at a point of
/// another surface is interpolated in the surface's own triangles; outside of these it is the
/// height of the nearest point on their boundary. Where a surface is below the next one, the lower
/// one is kept and the upper one is moved up to it. The layer between them has no thickness there
/// and ends where they cross.
///
/// # Errors
/// If there are fewer than two surfaces; if one cannot be triangulated; if breaklines cross; if no
/// layer has a volume; if the file cannot be written; on cancellation. No output file is left then.
pub fn build_layers(
    input: &LayerInput,
    options: &LayerOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<LayerReport> {
    let mut surface = SurfaceReport::default();
    let (mut stack, displacement) = Stack::new(input, options.snap, &mut surface)?;
    progress.check()?;
    let clipped = stack.put_in_order()?;
    progress.check()?;
    let path = output.path().to_path_buf();
    let mut builder = ModelBuilder::new(output, stack.grid.clone(), options.memory)?.codec(options.codec);
    let (mut layers, mut part) = (Vec::new(), 0);
    for (upper, pair) in input.surfaces.windows(2).enumerate() {
        progress.check()?;
        let name = format!("{} to {}", pair[0].name, pair[1].name);
        let before = builder.faces();
        let (volume, area) = stack.push_layer(upper, part, &mut builder)?;
        if builder.faces() > before {
            builder.part(&name, None)?;
            part += 1;
        }
        layers.push(LayerMeasure { name, volume, area });
    }
    if part == 0 {
        let found = "no layer with a thickness";
        return Err(Error::invalid("layers", found, "surfaces from top to bottom, with space between them"));
    }
    let faces = builder.faces();
    let mut metadata = Metadata { frame: stack.grid.frame(options.crs.clone()), ..Metadata::default() };
    metadata.provenance =
        Some(options.provenance.clone()).filter(|text| !text.is_empty()).into_iter().collect();
    metadata.set_tag(Tag::ModelDisplacement, displacement.to_string());
    metadata.set_tag(Tag::ModelCutFaces, 0.to_string());
    metadata.set_tag(Tag::ModelSlivers, 0.to_string());
    if let Some(unit) = &options.unit {
        metadata.set_tag(Tag::Unit, unit);
    }
    let built = builder.finish(&mut metadata, progress, &mut |_, _| ())?;
    if built.defect_count > 0 {
        let advice = "use a coarser grid with --snap, or remove points that are very close to each other";
        return Err(built.error(&path, "a layer intersects itself on the grid", advice));
    }
    Ok(LayerReport { layers, faces, clipped, surface, displacement, built })
}

/// Surfaces on a common triangulation, in grid units.
struct Stack {
    grid: Grid,
    mesh: Mesh,
    positions: Vec<[i32; 2]>,
    /// Heights of each surface, from top to bottom, at each vertex.
    heights: Vec<Vec<i32>>,
}

impl Stack {
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
        let mut heights = Vec::new();
        for tin in &tins {
            let (boundary, mut near) = (tin.mesh.boundary(), 0);
            let above = mesh.points.iter().map(|position| {
                let (height, is_outside) = tin.extended(*position, &mut near, &boundary);
                report.extended += u64::from(is_outside);
                height.round_ties_even() as i32
            });
            heights.push(above.collect());
        }
        Ok((Stack { grid, mesh, positions: snapped, heights }, furthest))
    }

    /// Returns the height of a surface above the next one at a vertex.
    fn above(&self, upper: usize, vertex: u32) -> i64 {
        i64::from(self.heights[upper][vertex as usize]) - i64::from(self.heights[upper + 1][vertex as usize])
    }

    /// Makes the surfaces ordered, from the lowest one up: divides triangles where two surfaces
    /// cross, and moves the upper one to the lower one where it is below. Returns the number of
    /// vertices that were moved.
    fn put_in_order(&mut self) -> Result<u64> {
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

    fn twice_area(&self, corners: [u32; 3]) -> i64 {
        let [a, b, c] = corners.map(|corner| self.positions[corner as usize].map(i64::from));
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }

    /// Adds the faces of the layer below a surface: top faces, bottom faces, and walls where the
    /// layer has a thickness at the boundary. Returns its volume and the horizontal area that it
    /// covers.
    fn push_layer(&self, upper: usize, part: u32, builder: &mut ModelBuilder) -> Result<(f64, f64)> {
        let is_thick = |triangle: usize| {
            self.mesh.triangles[triangle].iter().any(|corner| self.above(upper, *corner) > 0)
        };
        let corner = |surface: usize, vertex: u32| {
            let [x, y] = self.positions[vertex as usize];
            [x, y, self.heights[surface][vertex as usize]]
        };
        let mut push = |points: &[[i32; 3]]| {
            let number = builder.faces();
            let ring_ends = &[points.len()];
            builder.push(&Face { number, points, ring_ends, colours: &[], part, source: number })
        };
        let (mut six_volumes, mut twice_areas) = (0i128, 0i128);
        for (triangle, corners) in self.mesh.triangles.iter().enumerate() {
            if !is_thick(triangle) {
                continue;
            }
            let area = i128::from(self.twice_area(*corners));
            let thickness: i64 = corners.iter().map(|corner| self.above(upper, *corner)).sum();
            six_volumes += area * i128::from(thickness);
            twice_areas += area;
            let [a, b, c] = *corners;
            push(&[a, b, c].map(|vertex| corner(upper, vertex)))?;
            push(&[c, b, a].map(|vertex| corner(upper + 1, vertex)))?;
            for (edge, [from, to]) in [[a, b], [b, c], [c, a]].into_iter().enumerate() {
                let beyond = self.mesh.neighbours[triangle][edge];
                if beyond != NONE && is_thick(beyond as usize) {
                    continue;
                }
                let mut wall = vec![corner(upper + 1, from), corner(upper + 1, to)];
                wall.extend(Some(corner(upper, to)).filter(|_| self.above(upper, to) > 0));
                wall.extend(Some(corner(upper, from)).filter(|_| self.above(upper, from) > 0));
                if wall.len() > 2 {
                    push(&wall)?;
                }
            }
        }
        let width = self.grid.width();
        Ok((six_volumes as f64 / 6.0 * width.powi(3), twice_areas as f64 / 2.0 * width.powi(2)))
    }
}

/// Interpolates between two numbers at `part / whole`, rounded to the nearest integer.
fn share(from: i32, to: i32, part: i64, whole: i64) -> i32 {
    let (from, to, part, whole) = (i128::from(from), i128::from(to), i128::from(part), i128::from(whole));
    let (part, whole) = if whole < 0 { (-part, -whole) } else { (part, whole) };
    // (Adding one half and rounding down rounds halves up, whatever their sign.)
    ((2 * (from * (whole - part) + to * part) + whole).div_euclid(2 * whole)) as i32
}
