//! Isosurfaces: where the values of an octree, interpolated linearly between cell centres, equal a
//! level.
//!
//! Marching cubes (`cube.rs`) generates them in tiles of 64 x 64 x 64 cubes between the centres of
//! eight neighbouring cells (`tile.rs`), on all threads. Tiles whose extremes exclude the level are
//! not read, or only their first layers of cells (`traversal.rs`). Tiles are visited in Z order.
//! Points on edges that several tiles share are kept until the last of these tiles is done, as for
//! other surfaces. Memory grows with the boundary of the finished region.

pub(super) mod cube;
mod tile;
mod traversal;

use self::tile::{MAX_SURFACE_BYTES, TILE_BYTES, TileCells, TileSurface};
use self::traversal::{IsosurfaceGround, TILE, TileTraversal};
use super::arrays::Arrays;
use super::losses::Losses;
use super::numbers::{Shared, z_order};
use super::sink::{Mesh, Vertex};
use super::{FaceAttribute, MeshFormat, Precision, SurfaceMesh, sink_of};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, parallel};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ContourEnds, ContourLevels, ContourRequest, Levels};

/// Size of isosurfaces, and what was read for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct IsosurfaceSummary {
    /// Surfaces: one per value, which may be empty.
    pub surfaces: u64,
    /// Vertices, each counted once.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Tiles of 64 x 64 x 64 cells in total, counted once per surface.
    pub tiles: u64,
    /// Tiles that were read: their extremes do not exclude the surface. This does not count tiles
    /// of which only the first layers of cells were read for the preceding tile.
    pub tiles_read: u64,
}

/// Writes isosurfaces of an octree's first channel, at any level of detail, in world coordinates.
///
/// Values are interpolated linearly between cell centres. A value equal to the level counts as
/// above it; a saddle of four cells counts as their mean. A surface therefore crosses the plane
/// through the centres of a layer of cells at the [contours](Dataset::contours) of this layer.
/// Triangles are counterclockwise seen from the lower values: higher values are enclosed. Vertices
/// lie on lines between the centres of neighbouring cells, at least a millionth of a cell from the
/// centres, except for a few inside of cubes. Every edge has two triangles with opposite
/// directions, or one at the end of the surface.
///
/// With [`ContourEnds::Open`], surfaces end at the centres of the last cells, and where one of
/// eight cells is VOID or not finite. With [`ContourEnds::Close`], they are closed there, midway
/// between cells with and without a value, as if the latter were lower than any value. In trees of
/// [`Rule::Occupancy`](spinney_base::value::Rule::Occupancy), VOID and the exterior are 0, so that
/// surfaces of solids are closed.
///
/// Several surfaces are written in ascending order of value. In OBJ they are objects (`o
/// level_0.5`; empty surfaces are left out), in PLY a face property `level`; other formats hold one
/// surface. Only nodes whose statistics do not exclude a surface are read, on all threads of the
/// current pool. The file's bytes depend only on the tree. In addition to `request.memory`, memory
/// grows with the points where the surface leaves the finished region.
/// [`ContourRequest::directory`] is ignored.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::MeshFormat;
/// use spinney::raw::export::mesh::export_isosurfaces;
/// use spinney::Output;
/// use spinney::query::{ContourLevels, ContourRequest};
/// use spinney::raw::query::ContourEnds;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("ball.ply");
/// let ball = spinney::open("fixtures/v1/ball.goblin")?;
/// // Around the cells that have a value.
/// let mut request = ContourRequest::new(ContourLevels::At(vec![127.5]));
/// request.ends = ContourEnds::Close;
/// let found = export_isosurfaces(&ball, &request, Output::create(&path)?, MeshFormat::Ply, &())?;
/// assert!(found.surfaces == 1 && found.triangles > 0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is a quadtree, categorical, has no such level, or is corrupt; if its frame is flat;
/// if values are missing, not finite, or too many; for [`ContourEnds::Extend`]; if the format
/// cannot hold so many faces, such coordinates, or several surfaces; if the output cannot be
/// written; or on cancellation.
pub fn export_isosurfaces(
    tree: &Dataset,
    request: &ContourRequest,
    output: Output,
    format: MeshFormat,
    progress: &dyn Progress,
) -> Result<IsosurfaceSummary> {
    let values = values(tree, request)?;
    let attribute = match format {
        _ if values.len() <= 1 => FaceAttribute::None,
        MeshFormat::Ply => FaceAttribute::Level,
        MeshFormat::Obj => FaceAttribute::None,
        _ => {
            let advice = "write PLY or OBJ, or one file per level";
            return Err(Error::unsupported(
                output.path(),
                "several surfaces in a format that stores one",
                advice,
            ));
        }
    };
    let level = request.level.unwrap_or(tree.depth());
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    let precision = Precision::of(&frame, level)?;
    let mut losses = Losses::of(&output);
    losses.add_place(tree.metadata());
    let sink = sink_of(output, format, attribute, precision, false)?;
    let mesh = Mesh::new(sink, &frame, true);
    let summary = write(tree, request, &values, mesh, precision.margin(format), progress)?;
    losses.report(progress);
    Ok(summary)
}

/// Returns isosurfaces as triangles in memory, all in one mesh; otherwise as
/// [`export_isosurfaces`].
///
/// # Errors
/// Those of [`export_isosurfaces`]; also if there are more than 2^32 vertices.
pub fn isosurface_mesh(
    tree: &Dataset,
    request: &ContourRequest,
    progress: &dyn Progress,
) -> Result<SurfaceMesh> {
    let values = values(tree, request)?;
    let level = request.level.unwrap_or(tree.depth());
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    let margin = Precision::of(&frame, level)?.margin(MeshFormat::Obj);
    let (sink, made) = Arrays::new();
    write(tree, request, &values, Mesh::new(Box::new(sink), &frame, true), margin, progress)?;
    Ok(Arrays::take(made))
}

/// Checks a request and returns the values of its surfaces in ascending order.
fn values(tree: &Dataset, request: &ContourRequest) -> Result<Vec<f64>> {
    let levels = Levels::new(&request.levels)?;
    if tree.header().form.axes() != 3 {
        let advice = "contours of a quadtree are lines: use `spinney contours` with a format of lines, or Dataset::contours";
        return Err(Error::unsupported(tree.name(), "isosurfaces of a quadtree", advice));
    }
    tree.check_continuous("isosurfaces")?;
    if request.ends == ContourEnds::Extend {
        let expected = "open or close; only contour lines of quadtrees extend to the edge of the last cells";
        return Err(Error::invalid("nodata", "extend", expected));
    }
    spinney_engine::query::check_level(request.level.unwrap_or(tree.depth()), tree.depth())?;
    // (Explicit levels need no bounds.)
    let bounds = match request.levels {
        ContourLevels::Every { .. } => tree.value_bounds()?.first().copied().unwrap_or((0.0, 0.0)),
        ContourLevels::At(_) => (0.0, 0.0),
    };
    levels.reached(bounds)
}

/// Writes the surfaces of values.
fn write(
    tree: &Dataset,
    request: &ContourRequest,
    values: &[f64],
    mesh: Mesh<'_>,
    margin: f64,
    progress: &dyn Progress,
) -> Result<IsosurfaceSummary> {
    let level = request.level.unwrap_or(tree.depth());
    let relief = tree.relief(level);
    let none = match request.ends {
        _ if relief.has_zeros => 0.0,
        ContourEnds::Close => f64::NEG_INFINITY,
        ContourEnds::Open | ContourEnds::Extend => f64::NAN,
    };
    let ground = IsosurfaceGround { relief: &relief, level, whole: tree.extent_at(level).max, none };
    let surfaces = values.len() as u64;
    let tiles = ground.tiles().iter().fold(surfaces, |all, tiles| all.saturating_mul(*tiles));
    let total = ground.cells(0, [0; 3]).saturating_mul(surfaces);
    // The first batch assumes the maximum. Later batches assume surfaces as large as those before.
    let mut surface_bytes = MAX_SURFACE_BYTES;
    let mut writer = Writer { mesh, name: None, shared: Default::default(), attribute: 0 };
    let mut tiles_read = 0;
    for value in values {
        if surfaces > 1 {
            writer.name = Some(format!("level_{value}"));
            writer.attribute = (*value as f32).to_bits();
        }
        let mut traversal = TileTraversal::new(&ground, *value);
        loop {
            let batch = request.memory / 2 / (TILE_BYTES + surface_bytes);
            let wanted = traversal.next(batch.clamp(1, 1 << 10) as usize, total, progress)?;
            if wanted.is_empty() {
                break;
            }
            let made = parallel::map(&wanted, |tile| {
                progress.check()?;
                // (Doubled, as points near one cell's centre may be on collinear or on
                // perpendicular edges.)
                Ok(TileCells::read(&ground, tile)?.surface(*value, 2.0 * margin))
            });
            surface_bytes = 0;
            for (tile, surface) in wanted.iter().zip(made) {
                progress.check()?;
                let surface = surface?;
                surface_bytes = surface_bytes.max(surface.bytes());
                writer.add(tile.at, &surface)?;
                progress.advance(ground.cells_of_tile(tile.at), total);
                tiles_read += u64::from(tile.is_crossed);
            }
        }
        writer.shared = Default::default();
    }
    progress.check()?;
    tree.check_unchanged()?;
    let summary = writer.mesh.finish()?;
    let (vertices, triangles) = (summary.vertices, summary.faces);
    Ok(IsosurfaceSummary { surfaces, vertices, triangles, tiles, tiles_read })
}

/// Writes the surfaces of tiles to a mesh.
struct Writer<'a> {
    mesh: Mesh<'a>,
    /// Name of one of several surfaces, until its first triangle is written; empty surfaces are
    /// left out.
    name: Option<String>,
    /// Points on edges that several tiles share, by axis.
    shared: [Shared; 3],
    /// Attribute of the faces.
    attribute: u32,
}

impl Writer<'_> {
    /// Writes the surface of a tile.
    fn add(&mut self, tile: [u32; 3], surface: &TileSurface) -> Result<()> {
        if let Some(name) = self.name.take_if(|_| !surface.triangles.is_empty()) {
            self.mesh.part(&name)?;
        }
        let mut vertices: Vec<Vertex> = Vec::with_capacity(surface.points.len());
        for point in &surface.points {
            let Some((axis, cell)) = point.shared else {
                vertices.push(self.mesh.vertex(point.at)?);
                continue;
            };
            if let Some(known) = self.shared[axis].get(cell) {
                vertices.push(known);
                continue;
            }
            let vertex = self.mesh.vertex(point.at)?;
            // The last tile that may request it is that of the cube that starts at this point.
            let last = z_order(cell.map(|cell| cell.wrapping_add(1) >> TILE));
            self.shared[axis].put(cell, vertex, last);
            vertices.push(vertex);
        }
        for triangle in &surface.triangles {
            let corners = triangle.iter().map(|corner| vertices[*corner as usize]);
            self.mesh.face(corners, self.attribute)?;
        }
        self.shared.iter_mut().for_each(|shared| shared.done(z_order(tile)));
        Ok(())
    }
}
