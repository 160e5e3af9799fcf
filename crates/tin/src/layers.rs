//! Layers between surfaces as closed solids of an exact model.

use crate::mesh::NONE;
use crate::smooth::Smoothing;
use crate::stack::{Stack, StackReport};
use crate::surface::{Duplicates, SurfaceReport};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_brep::{BuildReport, Face, ModelBuilder};
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
    /// Smoothing of the surfaces, before they are ordered.
    pub smoothing: Option<Smoothing>,
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
        let (snap, smoothing, crs, unit, codec) = (None, None, None, None, Codec::default());
        LayerOptions { snap, smoothing, crs, unit, codec, memory: 1 << 30, provenance: String::new() }
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
    /// Maximum movement of a height by smoothing, in units of the coordinates.
    pub smoothed: f64,
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
    let (stack, StackReport { surface, displacement, smoothed, clipped }) =
        Stack::ordered(input, options, progress)?;
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
    let built = builder.finish(&mut metadata, progress)?;
    if built.defect_count > 0 {
        let advice = "use a coarser grid with --snap, or remove points that are very close to each other";
        return Err(built.error(&path, "a layer intersects itself on the grid", advice));
    }
    Ok(LayerReport { layers, faces, clipped, surface, displacement, smoothed, built })
}

impl Stack {
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
