//! The surface of an octree as a mesh: PLY, OBJ, STL or OFF; exact models, as CityJSON too (`exact/`);
//! and octrees for viewers, as glTF and 3D Tiles (`gltf/`).
//!
//! Isosurfaces of other values than coverage are a room of their own (`isosurfaces/`).
//!
//! Two surfaces can be had. The *faces* of the cells, merged to rectangles, enclose exactly the solid cells.
//! The *smooth* surface (Gibson's surface nets) runs between them, where the tree's coverage passes one half.
//!
//! Both are closed: every edge is passed as often in one direction as in the other, and faces are
//! counterclockwise when viewed from outside. For rectangles this takes some care, since where two meet one,
//! the one's edge has a point that it would not have by itself (a T-junction). Faces are merged within blocks
//! of 32 x 32 x 32 cells only, so that a block's rectangles follow from the block and the cells that touch
//! it; then each rectangle gets the corners of all rectangles around it as points of its own ring, those of
//! the 26 blocks around its block included. That is exact wherever blocks meet, merges whatever is flat, and
//! needs a few blocks at a time; the price is that some rectangles have more than four points (all but STL
//! can hold these; for STL, or if asked for, they are cut into triangles).
//!
//! Blocks are visited in Z order, and whatever is uniformly solid or empty with its surroundings is passed
//! over, so that time goes with the surface. Vertices that blocks share are remembered until the last of
//! these blocks is done: memory goes with the edge of what is done, never with the mesh.

mod arrays;
mod exact;
mod faces;
mod gltf;
mod isosurfaces;
mod net_normals;
mod nets;
mod numbers;
mod obj;
mod off;
mod ply;
mod points;
mod rings;
mod sink;
mod stl;
mod visit;

use std::path::Path;
use std::str::FromStr;

use spinney_base::io::Output;
use spinney_base::value::{Kind, Rule, SampleType};
use spinney_base::{Error, Progress, Result};
use spinney_crs::Frame;
use spinney_engine::dataset::Dataset;
use spinney_engine::query::cell_blocks::{Carry, CellBlocks, can_carry_value};

pub use arrays::SurfaceMesh;
pub use exact::{ExactSummary, export_exact};
pub use gltf::{GltfOptions, TilesetSummary, export_glb, export_tileset};
pub use isosurfaces::{IsosurfaceSummary, export_isosurfaces, isosurface_mesh};
pub use ply::FaceAttribute;
use sink::{Mesh, Sink};

/// Kind of surface, and level of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MeshRequest {
    /// Level whose cells are meant; the tree's depth if not given. INNER nodes of the level count by their
    /// representatives: solid if at least half full in trees of [`Rule::Occupancy`], always in others.
    pub level: Option<u8>,
    /// The smooth surface instead of the cells' faces.
    pub smooth: bool,
    /// Triangles only, also where the format knows polygons.
    pub triangles: bool,
}

impl MeshRequest {
    /// The faces of the finest cells.
    pub fn new() -> MeshRequest {
        MeshRequest::default()
    }
}

/// A mesh format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// PLY, binary little-endian, with the cells' values or colours as properties of faces.
    Ply,
    /// Wavefront OBJ, text.
    Obj,
    /// STL, binary: triangles in single precision.
    Stl,
    /// OFF, text.
    Off,
    /// CityJSON 2.0: for exact models only, which have polygons with holes, and parts.
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
    /// The format by a file name's extension.
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

/// Writes the surface of an octree, or of a view of one, in the coordinates of its world. A tree without
/// solid cells gives a mesh without faces.
///
/// PLY files have the cells' values: three or four channels of u8 as colours of faces, as OFF files too, classes of
/// u8 or u16 as a property `value`. Faces of different values are not merged then.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::mesh::{MeshFormat, MeshRequest, export_mesh};
/// use spinney::io::Output;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("ball.ply");
/// let ball = spinney::open("fixtures/v1/ball.goblin")?;
/// export_mesh(&ball, &MeshRequest::default(), Output::create(&path)?, MeshFormat::Ply, &())?;
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is a quadtree, has no such level, or is damaged; if its frame is flat; if the format cannot
/// hold so many faces or such coordinates; if the output cannot be written; or on interruption.
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
        _ if header.kind != Kind::Categorical || !can_carry_value(header.form.value) => FaceAttribute::None,
        (SampleType::U8, _) => FaceAttribute::Byte,
        _ => FaceAttribute::Short,
    };
    let carry = match attribute {
        FaceAttribute::None if request.smooth && header.rule == Rule::Occupancy => Carry::Coverage,
        FaceAttribute::None => Carry::Nothing,
        _ => Carry::Value,
    };
    let mut blocks = tree.cell_blocks(level, carry)?;
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    export_blocks(&mut *blocks, attribute, &frame, request, output, format, progress)
}

/// The surface of an octree as triangles in memory, otherwise as [`export_mesh`] writes it without values;
/// [`MeshRequest::triangles`] does not matter.
///
/// # Errors
/// Those of [`export_mesh`]; also if there are more than 2^32 vertices.
pub fn surface_mesh(tree: &Dataset, request: &MeshRequest, progress: &dyn Progress) -> Result<SurfaceMesh> {
    let level = request.level.unwrap_or(tree.depth());
    let is_occupancy = tree.header().rule == Rule::Occupancy;
    let carry = if request.smooth && is_occupancy { Carry::Coverage } else { Carry::Nothing };
    let mut blocks = tree.cell_blocks(level, carry)?;
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    Precision::of(&frame, level)?;
    let (sink, made) = arrays::Arrays::new();
    write_surface(&mut *blocks, Mesh::new(Box::new(sink), &frame, true), request.smooth, progress)?;
    Ok(arrays::Arrays::take(made))
}

/// Writes the surface of the cells that any source has in blocks; `frame` is that of these cells, and
/// [`MeshRequest::level`] does not matter. An attribute needs blocks that carry [`Carry::Value`].
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
    let attribute = if carry == Carry::Value { attribute } else { FaceAttribute::None };
    let sink = sink_of(output, format, attribute, precision)?;
    let triangles = request.triangles || format == MeshFormat::Stl;
    write_surface(blocks, Mesh::new(sink, frame, triangles), request.smooth, progress)
}

/// Starts a file of a format.
fn sink_of(
    output: Output,
    format: MeshFormat,
    attribute: FaceAttribute,
    precision: Precision,
) -> Result<Box<dyn Sink>> {
    Ok(match format {
        MeshFormat::Ply => Box::new(ply::Ply::new(output, attribute, precision != Precision::Single)?),
        MeshFormat::Obj => Box::new(obj::Obj::new(output)?),
        MeshFormat::Stl if precision == Precision::Double => {
            let found =
                "coordinates so large that neighbours are the same in single precision, as STL has it";
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

fn write_surface(
    blocks: &mut dyn CellBlocks,
    mut mesh: Mesh<'_>,
    smooth: bool,
    progress: &dyn Progress,
) -> Result<MeshSummary> {
    if smooth {
        let is_coverage = blocks.carry() == Carry::Coverage;
        nets::write(blocks, is_coverage, &mut mesh, progress)?;
    } else {
        faces::write(blocks, &mut mesh, progress)?;
    }
    progress.check()?;
    blocks.check_unchanged()?;
    mesh.finish()
}

/// Precision of coordinates that keeps vertices distinct.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Precision {
    /// f32 holds coordinates to a small part of a cell.
    Single,
    /// f32 holds whole cells, but not much more.
    Rough,
    /// f64.
    Double,
}

impl Precision {
    fn of(frame: &Frame, level: u8) -> Result<Precision> {
        let m = &frame.matrix;
        let det = frame.linear().determinant();
        if !det.is_finite() || det == 0.0 || m.iter().flatten().any(|number| !number.is_finite()) {
            return Err(Error::invalid("frame", format!("{m:?}"), "one that is not flat"));
        }
        let side = (1u64 << level) as f64;
        let row_most = |row: &[f64; 4]| row[3].abs() + side * row[..3].iter().map(|x| x.abs()).sum::<f64>();
        let spacing = m.iter().map(row_most).fold(0.0, f64::max) * f64::from(f32::EPSILON);
        let cell = (0..3).map(|axis| frame.linear().col(axis).length()).fold(f64::INFINITY, f64::min);
        Ok(match cell / spacing {
            ratio if ratio >= 64.0 => Precision::Single,
            ratio if ratio >= 2.0 => Precision::Rough,
            _ => Precision::Double,
        })
    }
}
