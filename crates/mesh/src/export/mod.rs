//! Surfaces of octrees as meshes: PLY, OBJ, STL or OFF. Exact models are also exported as CityJSON
//! (`exact/`), and for viewers as glTF and 3D Tiles (`model_gltf/`), octrees likewise (`gltf/`).
//! Isosurfaces of values other than coverage have their own module (`isosurfaces/`).
//!
//! There are two kinds of surfaces. The *faces* of the cells, merged to rectangles, enclose exactly
//! the solid cells. The *smooth* surface (Gibson's surface nets) runs between the cell centres,
//! where the tree's coverage crosses one half.
//!
//! Both surfaces are closed: every edge occurs equally often in both directions. Faces are
//! counterclockwise seen from outside. The smooth surface is a manifold: its edges have two faces
//! each (`sheets.rs`). In the surface of faces, an edge at which two cells touch has four faces.
//!
//! Merged rectangles need care to avoid T-junctions: where two rectangles meet one, the one's side
//! contains a corner of the others. Faces are merged only within blocks of 32 x 32 x 32 cells, so
//! that a block's rectangles depend only on the block and the cells adjacent to it. Then the ring
//! of each rectangle gets the corners of all rectangles around it as points, including those of the
//! 26 adjacent blocks. This is exact at block boundaries, merges all flat regions within a block,
//! and holds only a few blocks in memory. The price is that some rectangles have more than four
//! points. All formats but STL can store these; for STL, or on request, they are triangulated.
//!
//! Blocks are visited in Z order. Regions that are uniformly solid or empty including their
//! surroundings are skipped, so time is proportional to the surface. Vertices shared by several
//! blocks are kept until the last of these blocks is done. Memory grows with the boundary of the
//! finished region, not with the mesh.

mod arrays;
mod exact;
mod faces;
mod gltf;
mod isosurfaces;
mod losses;
mod model_gltf;
mod net_normals;
mod nets;
mod numbers;
mod obj;
mod off;
mod ply;
mod points;
mod rings;
mod sheets;
mod sink;
mod stl;
mod triangles;
mod units;
mod visit;

use std::path::Path;
use std::str::FromStr;

use spinney_base::io::Output;
use spinney_base::value::{DataKind, Rule, SampleType};
use spinney_base::{Error, Progress, Result};
use spinney_crs::Frame;
use spinney_engine::dataset::Dataset;
use spinney_engine::query::cell_blocks::{BlockAttribute, CellBlocks, can_be_block_attribute};

pub use arrays::SurfaceMesh;
pub use exact::{ExactSummary, export_exact};
pub use gltf::{GltfOptions, TilesetSummary, export_glb, export_tileset};
pub use isosurfaces::{IsosurfaceSummary, export_isosurfaces, isosurface_mesh};
use losses::Losses;
pub use model_gltf::{ModelTilesSummary, export_model_glb, export_model_tileset};
pub use ply::FaceAttribute;
use sink::{Mesh, Sink};
pub use triangles::export_triangles;

/// Kind of surface, and level of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MeshRequest {
    /// Level whose cells are exported; by default the tree's depth. INNER nodes at the level count
    /// by their representatives: in trees of [`Rule::Occupancy`] they are solid if at least half
    /// full, in other trees always.
    pub level: Option<u8>,
    /// Whether to export the smooth surface instead of the cells' faces.
    pub smooth: bool,
    /// Whether to write only triangles, even if the format supports polygons.
    pub triangles: bool,
}

impl MeshRequest {
    /// Faces of the finest cells.
    pub fn new() -> MeshRequest {
        MeshRequest::default()
    }
}

/// Mesh format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// PLY, binary little-endian, with the cells' values or colours as face properties.
    Ply,
    /// Wavefront OBJ, text.
    Obj,
    /// STL, binary: triangles in single precision.
    Stl,
    /// OFF, text.
    Off,
    /// CityJSON 2.0, only for exact models, which have parts and polygons with holes.
    CityJson,
}

impl FromStr for MeshFormat {
    type Err = Error;

    fn from_str(name: &str) -> Result<MeshFormat> {
        match name.to_ascii_lowercase().as_str() {
            "ply" => Ok(MeshFormat::Ply),
            "obj" => Ok(MeshFormat::Obj),
            "stl" => Ok(MeshFormat::Stl),
            "off" => Ok(MeshFormat::Off),
            "city.json" | "cityjson" | "json" => Ok(MeshFormat::CityJson),
            _ => Err(Error::invalid("mesh format", format!("`{name}`"), "ply, obj, stl, off or city.json")),
        }
    }
}

impl MeshFormat {
    /// Format of a file name's extension.
    pub fn of(path: &Path) -> Option<MeshFormat> {
        path.extension()?.to_str()?.parse().ok()
    }
}

/// Size of a written mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshSummary {
    /// Vertices, each counted once.
    pub vertices: u64,
    /// Faces.
    pub faces: u64,
}

/// Writes the surface of an octree, or of a view of one, in world coordinates. A tree without solid
/// cells results in a mesh without faces.
///
/// PLY files store the cells' values: three or four u8 channels as face colours (OFF does so, too),
/// u8 or u16 classes as a property `value`. Faces of different values are then not merged. Data
/// that the format cannot store (colours, values and their names, coordinate system, unit of
/// length) is reported as a [warning](Progress::warn).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::{MeshFormat, MeshRequest, export_mesh};
/// use spinney::Output;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("ball.ply");
/// let ball = spinney::open("fixtures/v1/ball.goblin")?;
/// export_mesh(&ball, &MeshRequest::default(), Output::create(&path)?, MeshFormat::Ply, &())?;
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is a quadtree, has no such level, or is corrupt; if its frame is flat; if the format
/// cannot hold so many faces or such coordinates; if the output cannot be written; or on
/// cancellation.
pub fn export_mesh(
    tree: &Dataset,
    request: &MeshRequest,
    output: Output,
    format: MeshFormat,
    progress: &dyn Progress,
) -> Result<MeshSummary> {
    let level = request.level.unwrap_or(tree.depth());
    let header = tree.header();
    let attribute = match (header.form.value.sample, header.form.value.channels) {
        _ if header.rule == Rule::Occupancy => FaceAttribute::None,
        (SampleType::U8, 3 | 4) if matches!(format, MeshFormat::Ply | MeshFormat::Off) => {
            FaceAttribute::Colour
        }
        _ if format != MeshFormat::Ply => FaceAttribute::None,
        _ if header.kind != DataKind::Categorical || !can_be_block_attribute(header.form.value) => {
            FaceAttribute::None
        }
        (SampleType::U8, _) => FaceAttribute::Byte,
        _ => FaceAttribute::Short,
    };
    let carry = match attribute {
        FaceAttribute::None if request.smooth && header.rule == Rule::Occupancy => BlockAttribute::Coverage,
        FaceAttribute::None => BlockAttribute::Nothing,
        _ => BlockAttribute::Value,
    };
    warn_full(tree, progress)?;
    let mut blocks = tree.cell_blocks(level, carry)?;
    let metadata = tree.metadata();
    let frame = metadata.frame.coarser(tree.depth() - level);
    let mut losses = Losses::of(&output);
    if header.rule != Rule::Occupancy {
        let is_colour =
            matches!((header.form.value.sample, header.form.value.channels), (SampleType::U8, 3 | 4));
        let has_none = attribute == FaceAttribute::None;
        losses.add(has_none && is_colour, "colours");
        if has_none && !is_colour {
            losses.add_values(tree, "values of cells")?;
        }
        losses.add(!metadata.class_names.is_empty(), "names of classes");
        losses.add(metadata.palette.is_some(), "the palette");
    }
    losses.add_place(metadata);
    let summary = export_blocks(&mut *blocks, attribute, &frame, request, output, format, progress)?;
    losses.report(progress);
    Ok(summary)
}

/// Returns the surface of an octree as triangles in memory, otherwise as [`export_mesh`] without
/// values. [`MeshRequest::triangles`] is ignored.
///
/// # Errors
/// Those of [`export_mesh`]; also if there are more than 2^32 vertices.
pub fn surface_mesh(tree: &Dataset, request: &MeshRequest, progress: &dyn Progress) -> Result<SurfaceMesh> {
    let level = request.level.unwrap_or(tree.depth());
    let is_occupancy = tree.header().rule == Rule::Occupancy;
    let carry =
        if request.smooth && is_occupancy { BlockAttribute::Coverage } else { BlockAttribute::Nothing };
    warn_full(tree, progress)?;
    let mut blocks = tree.cell_blocks(level, carry)?;
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    let margin = Precision::of(&frame, level)?.margin(MeshFormat::Obj);
    let (sink, made) = arrays::Arrays::new();
    let surface = if request.smooth { Surface::Smooth { margin } } else { Surface::Faces };
    write_surface(&mut *blocks, Mesh::new(Box::new(sink), &frame, true), surface, progress)?;
    Ok(arrays::Arrays::take(made))
}

/// Warns if the tree may be a volume whose 0 means no data, such as a mask of 0 and 255. Its
/// surface would be that of its bounding box.
fn warn_full(tree: &Dataset, progress: &dyn Progress) -> Result<()> {
    if tree.header().rule != Rule::Occupancy
        && let Some(text) = tree.void_advice()?
    {
        progress.warn(tree.name(), &text);
    }
    Ok(())
}

/// Writes the surface of the cells of any block source. `frame` is the frame of these cells, and
/// [`MeshRequest::level`] is ignored. An attribute requires blocks that carry
/// [`BlockAttribute::Value`].
///
/// # Errors
/// As [`export_mesh`].
pub fn export_blocks(
    blocks: &mut dyn CellBlocks,
    attribute: FaceAttribute,
    frame: &Frame,
    request: &MeshRequest,
    output: Output,
    format: MeshFormat,
    progress: &dyn Progress,
) -> Result<MeshSummary> {
    let precision = Precision::of(frame, blocks.level())?;
    let carry = blocks.carry();
    let attribute = if carry == BlockAttribute::Value { attribute } else { FaceAttribute::None };
    let margin = precision.margin(format);
    let sink = sink_of(output, format, attribute, precision, !request.smooth)?;
    let triangles = request.triangles || format == MeshFormat::Stl;
    let surface = if request.smooth { Surface::Smooth { margin } } else { Surface::Faces };
    write_surface(blocks, Mesh::new(sink, frame, triangles), surface, progress)
}

/// Starts a file of a format. `on_grid` means that all vertices are corners of cells.
fn sink_of(
    output: Output,
    format: MeshFormat,
    attribute: FaceAttribute,
    precision: Precision,
    on_grid: bool,
) -> Result<Box<dyn Sink>> {
    let is_precise_enough = if on_grid { precision.has_grid() } else { precision.is_single() };
    Ok(match format {
        MeshFormat::Ply => Box::new(ply::Ply::new(output, attribute, !precision.is_single())?),
        MeshFormat::Obj => Box::new(obj::Obj::new(output)?),
        MeshFormat::Stl if !is_precise_enough => {
            let found = "coordinates that the single precision of STL cannot distinguish";
            return Err(Error::unsupported(output.path(), found, "write PLY or OBJ"));
        }
        MeshFormat::Stl => Box::new(stl::Stl::new(output)?),
        MeshFormat::Off => Box::new(off::Off::new(output, attribute, false)?),
        MeshFormat::CityJson => {
            let found = "a tree of cells as CityJSON";
            return Err(Error::unsupported(output.path(), found, "write PLY, OBJ, STL or OFF"));
        }
    })
}

/// Kind of surface.
#[derive(Clone, Copy, Debug)]
enum Surface {
    Faces,
    /// Vertices keep a distance of at least `margin` cells from the walls of the cubes between cell
    /// centres, so that they remain distinct after rounding.
    Smooth {
        margin: f64,
    },
}

fn write_surface(
    blocks: &mut dyn CellBlocks,
    mut mesh: Mesh<'_>,
    surface: Surface,
    progress: &dyn Progress,
) -> Result<MeshSummary> {
    match surface {
        Surface::Smooth { margin } => nets::write(blocks, margin, &mut mesh, progress)?,
        Surface::Faces => faces::write(blocks, &mut mesh, progress)?,
    }
    progress.check()?;
    blocks.check_unchanged()?;
    mesh.finish()
}

/// Precision of coordinates: representable numbers per cell width, at the coarsest.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Precision {
    /// In single precision; 0 if coordinates are out of range.
    single: f64,
    /// In double precision.
    double: f64,
}

impl Precision {
    fn of(frame: &Frame, level: u8) -> Result<Precision> {
        let m = &frame.matrix;
        let linear = frame.linear();
        let side = (1u64 << level) as f64;
        let row_most = |row: &[f64; 4]| row[3].abs() + side * row[..3].iter().map(|x| x.abs()).sum::<f64>();
        let most = m.iter().map(row_most).fold(0.0, f64::max);
        // Distances between opposite walls of a cell. Unit columns are used, since products of
        // other columns may overflow.
        let lengths = [0, 1, 2].map(|axis| linear.col(axis).length());
        let unit = [0, 1, 2].map(|axis| linear.col(axis) / lengths[axis]);
        let volume = unit[0].cross(unit[1]).dot(unit[2]).abs();
        let height =
            |axis: usize| lengths[axis] * volume / unit[(axis + 1) % 3].cross(unit[(axis + 2) % 3]).length();
        let across = (0..3).map(height).fold(f64::INFINITY, f64::min);
        if !(across.is_finite() && across > 0.0) {
            return Err(Error::invalid("frame", format!("{m:?}"), "an invertible matrix"));
        }
        let is_beyond = most > f64::from(f32::MAX);
        let spacing = most.max(f32::MIN_POSITIVE.into()) * f64::from(f32::EPSILON);
        let single = if is_beyond { 0.0 } else { across / spacing };
        let double = across / (most * f64::EPSILON);
        if double < 64.0 {
            let expected = "coordinates for which double precision resolves 1/64 of a cell";
            return Err(Error::invalid("frame", format!("{m:?}"), expected));
        }
        Ok(Precision { single, double })
    }

    /// Whether single precision resolves small fractions of a cell.
    fn is_single(self) -> bool {
        self.single >= 64.0
    }

    /// Whether single precision resolves whole cells.
    fn has_grid(self) -> bool {
        self.single >= 2.0
    }

    /// Distance in cells from a plane that keeps points on its two sides distinct in a format.
    fn margin(self, format: MeshFormat) -> f64 {
        let is_single = format == MeshFormat::Stl || format == MeshFormat::Ply && self.is_single();
        1.0 / if is_single { self.single } else { self.double }
    }
}
