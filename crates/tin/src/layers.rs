//! Layers between surfaces as closed bodies: exact models.

use std::collections::BTreeMap;

use crate::mesh::{Lines, Mesh, NONE};
use crate::surface::{Duplicates, Places, SurfaceReport, inside, ring_segments};
use crate::tin::Tin;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_brep::{BuildReport, Face, Grid, ModelBuilder};
use spinney_container::{Codec, Metadata, Tag};
use spinney_crs::{Crs, PolygonParts};

/// A surface that bounds layers.
#[derive(Clone, Debug, Default)]
pub struct LayerSurface {
    /// Its name.
    pub name: String,
    /// Its points.
    pub points: Vec<[f64; 3]>,
}

/// Surfaces between which layers lie, and how these are made.
#[derive(Clone, Debug, Default)]
pub struct LayerInput {
    /// Two surfaces or more, from the top down.
    pub surfaces: Vec<LayerSurface>,
    /// Lines that become edges of all surfaces, such as faults.
    pub breaklines: Vec<Vec<[f64; 2]>>,
    /// Polygons outside of which there are no layers; without any they end at the convex hull of all points.
    pub outlines: PolygonParts,
    /// Points of a surface in one place with different heights.
    pub duplicates: Duplicates,
}

/// Options of layers.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LayerOptions {
    /// Width of the grid's steps; otherwise the least power of two with which the longest side has at most about 2^24 steps.
    pub snap: Option<f64>,
    /// The coordinate system.
    pub crs: Option<Crs>,
    /// Unit of length, to be kept in the file.
    pub unit: Option<String>,
    /// Packing of the file.
    pub codec: Codec,
    /// Bytes of memory for everything.
    pub memory: u64,
    /// Provenance of the surfaces.
    pub provenance: String,
}

impl Default for LayerOptions {
    fn default() -> Self {
        let (snap, crs, unit, codec) = (None, None, None, Codec::default());
        LayerOptions { snap, crs, unit, codec, memory: 1 << 30, provenance: String::new() }
    }
}

impl LayerOptions {
    /// On the finest grid.
    pub fn new() -> LayerOptions {
        LayerOptions::default()
    }
}

/// A layer that was made.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerMeasure {
    /// The names of the surfaces above and below it.
    pub name: String,
    /// Its volume.
    pub volume: f64,
    /// The area of the plane that it covers.
    pub area: f64,
}

/// Counts of layers.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LayerReport {
    /// The layers, from the top down. One without a volume is not in the model.
    pub layers: Vec<LayerMeasure>,
    /// Faces of the model.
    pub faces: u64,
    /// Places where an upper surface was below a lower one, and lies on it instead.
    pub clipped: u64,
    /// Remarks on the points of all surfaces. Corners that were extended are those of all that were outside of the convex hull of a
    /// surface's points.
    pub surface: SurfaceReport,
    /// The furthest that a point was moved to the grid.
    pub displacement: f64,
    /// Counts of the octree.
    pub built: BuildReport,
}

/// Makes a model of the layers between surfaces, each of which is an object. All surfaces are triangulated together: in one triangulation of the
/// points of all, in which each has the heights of its own triangles where it has no point, and beside these that of the nearest place that it has.
/// Where a surface is below the next one, the lower one stays and the upper one lies on it: the layer between them has no thickness there, and ends
/// where they cross.
///
/// # Errors
/// If there are less than two surfaces, one cannot be triangulated, lines cross, no layer has a volume, the file cannot be written, or on
/// interruption. There is no file then.
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
        let found = "none with a thickness anywhere";
        return Err(Error::invalid("layers", found, "surfaces from the top down, with space between them"));
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
        let advice = "take a coarser grid with --snap, or leave out points that are very near to each other";
        return Err(built.error(&path, "a layer passes through itself on the grid", advice));
    }
    Ok(LayerReport { layers, faces, clipped, surface, displacement, built })
}

/// Surfaces on one triangulation, in steps of a grid.
struct Stack {
    grid: Grid,
    mesh: Mesh,
    places: Vec<[i32; 2]>,
    /// Of each surface, from the top down, at each vertex.
    heights: Vec<Vec<i32>>,
}

impl Stack {
    /// Triangulates the points of all surfaces, moved to a grid.
    fn new(input: &LayerInput, snap: Option<f64>, report: &mut SurfaceReport) -> Result<(Stack, f64)> {
        if input.surfaces.len() < 2 {
            let found = input.surfaces.len().to_string();
            return Err(Error::invalid("surfaces of layers", found, "two or more, from the top down"));
        }
        let lines = input.breaklines.iter().flatten().chain(input.outlines.iter().flatten().flatten());
        let all = || input.surfaces.iter().flat_map(|surface| &surface.points);
        if let Some(point) = all().find(|point| point.iter().any(|at| !at.is_finite())) {
            return Err(Error::invalid("point of a surface", format!("{point:?}"), "finite numbers"));
        }
        if let Some(corner) = lines.clone().find(|corner| corner.iter().any(|at| !at.is_finite())) {
            return Err(Error::invalid("corner of a line", format!("{corner:?}"), "finite numbers"));
        }
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        let mut reach = |axis: usize, at: f64| {
            bounds[0][axis] = bounds[0][axis].min(at);
            bounds[1][axis] = bounds[1][axis].max(at);
        };
        all().for_each(|point| (0..3).for_each(|axis| reach(axis, point[axis])));
        lines.clone().for_each(|corner| (0..2).for_each(|axis| reach(axis, corner[axis])));
        if bounds[0][2] > bounds[1][2] {
            return Err(Error::invalid(
                "points of a surface",
                "none",
                "three or more that are not in one line",
            ));
        }
        let grid = match snap {
            Some(_) => Grid::over(bounds, snap)?,
            // The finest grid that the box can have, since surfaces have triangles that are thin.
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
            let places = Places::of(&points, input.duplicates, report).map_err(named)?;
            everywhere.extend(places.places.iter().map(|[x, y]| [*x, *y, 0.0]));
            let mesh = Mesh::new(&places.places, &free).map_err(named)?;
            tins.push(Tin { mesh, heights: places.heights });
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
        let places = Places::of(&everywhere, Duplicates::Mean, &mut SurfaceReport::default())?;
        let ends = breaklines.iter().flat_map(|line| line.windows(2));
        let segments: Vec<[u32; 2]> =
            ends.filter_map(|ends| Some([places.number(ends[0])?, places.number(ends[1])?])).collect();
        let rings = ring_segments(&outlines, &places);
        let mut mesh = Mesh::new(&places.places, &Lines { breaklines: &segments, outlines: &rings })?;
        report.crossings = (mesh.points.len() - places.places.len()) as u64;
        if !outlines.is_empty() {
            let inside = inside(&mesh, &outlines);
            mesh.keep(&|triangle| inside[triangle]);
        }
        if mesh.triangles.is_empty() {
            return Err(Error::invalid("outline", "one without an area", "polygons with an area"));
        }
        // (Points that were made lie between those of the grid.)
        let snapped: Vec<[i32; 2]> =
            mesh.points.iter().map(|place| place.map(|at| at.round_ties_even() as i32)).collect();
        let mut heights = Vec::new();
        for tin in &tins {
            let (boundary, mut near) = (tin.mesh.boundary(), 0);
            let above = mesh.points.iter().map(|place| {
                let (height, is_beside) = tin.extended(*place, &mut near, &boundary);
                report.extended += u64::from(is_beside);
                height.round_ties_even() as i32
            });
            heights.push(above.collect());
        }
        Ok((Stack { grid, mesh, places: snapped, heights }, furthest))
    }

    /// How far a surface is above the next one.
    fn above(&self, upper: usize, vertex: u32) -> i64 {
        i64::from(self.heights[upper][vertex as usize]) - i64::from(self.heights[upper + 1][vertex as usize])
    }

    /// Lets no surface be below the next one: from the lowest on, triangles are divided where two cross, and the upper one takes the heights of the
    /// lower one where it is below. Returns how many vertices were.
    fn put_in_order(&mut self) -> Result<u64> {
        let mut clipped = 0;
        for upper in (0..self.heights.len() - 1).rev() {
            self.divide(upper)?;
            for vertex in 0..self.places.len() {
                if self.above(upper, vertex as u32) < 0 {
                    self.heights[upper][vertex] = self.heights[upper + 1][vertex];
                    clipped += 1;
                }
            }
        }
        Ok(clipped)
    }

    /// Divides triangles along the line where a surface crosses the next one.
    // Invariant: surfaces in order stay so: heights of new vertices are rounded from the same shares of an edge, which keeps an order that both of
    // its ends have.
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
                    let place = self.between(a, b, from, from - to);
                    // A crossing that is moved to the end of its edge is there.
                    match [a, b].into_iter().find(|end| self.places[*end as usize] == place) {
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
            *number = self.places.len() as u32;
            let place = self.between(a, b, from, from - to);
            for heights in &mut self.heights {
                heights.push(share(heights[a as usize], heights[b as usize], from, from - to));
            }
            self.places.push(place);
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
            // The corners of one side are between the two where surfaces meet: first those on one side, and then those on the other.
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
                let [x, y] = self.places[corners[0] as usize];
                let [x, y, _] = self.grid.to_world([x, y, 0]);
                let found = format!("a triangle that is thinner than a step of the grid, near {x}, {y}");
                return Err(Error::invalid(
                    "layers",
                    found,
                    "points that are farther from each other, or a finer grid",
                ));
            }
        }
        Ok(())
    }

    /// The place at a share of an edge.
    fn between(&self, a: u32, b: u32, part: i64, whole: i64) -> [i32; 2] {
        let (from, to) = (self.places[a as usize], self.places[b as usize]);
        [0, 1].map(|axis| share(from[axis], to[axis], part, whole))
    }

    fn twice_area(&self, corners: [u32; 3]) -> i64 {
        let [a, b, c] = corners.map(|corner| self.places[corner as usize].map(i64::from));
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }

    /// Adds the faces of the layer below a surface: those above, those below, and walls where it has a thickness at the end of what there is.
    /// Returns its volume, and the area that it covers.
    fn push_layer(&self, upper: usize, part: u32, builder: &mut ModelBuilder) -> Result<(f64, f64)> {
        let is_thick = |triangle: usize| {
            self.mesh.triangles[triangle].iter().any(|corner| self.above(upper, *corner) > 0)
        };
        let corner = |surface: usize, vertex: u32| {
            let [x, y] = self.places[vertex as usize];
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

/// Number at a share of the way between two numbers, rounded.
fn share(from: i32, to: i32, part: i64, whole: i64) -> i32 {
    let (from, to, part, whole) = (i128::from(from), i128::from(to), i128::from(part), i128::from(whole));
    let (part, whole) = if whole < 0 { (-part, -whole) } else { (part, whole) };
    // (Half a step more, and down: halves go up, whatever their sign.)
    ((2 * (from * (whole - part) + to * part) + whole).div_euclid(2 * whole)) as i32
}
