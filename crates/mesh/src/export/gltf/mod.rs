//! Octrees for viewers: 3D Tiles 1.1, and single levels as binary glTF.
//!
//! A tileset is the octree itself (implicit tiling). A tile is a node, with the surface of its 64 x
//! 64 x 64 cells six levels below. Viewers replace it by its eight children when they come closer.
//! Tiles are generated independently, on all threads. They meet without cracks because all tiles of
//! a level share one lattice.

pub(super) mod buffer;
pub(super) mod glb;
pub(super) mod globe;
mod subtree;
mod tile_cells;
mod tile_mesh;
mod tiles;
mod tileset;

use std::io::Write as _;

use self::glb::{Glb, y_up};
use self::tile_mesh::TileMesh;
use self::tiles::{Tile, TileMaker};
use super::MeshRequest;
use super::losses::Losses;
use spinney_base::io::Output;
use spinney_base::parallel::{self, Pool};
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;

pub use tileset::{TilesetSummary, export_tileset};

/// Options of written glTF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct GltfOptions {
    /// Compress vertices and triangles (`EXT_meshopt_compression`); readers must support the
    /// extension.
    pub meshopt: bool,
}

impl GltfOptions {
    /// glTF that most readers support.
    pub fn new() -> GltfOptions {
        GltfOptions::default()
    }

    pub(super) fn check(self) -> Result<()> {
        if self.meshopt && !cfg!(feature = "meshopt") {
            let found = "a build without meshopt compression";
            return Err(Error::invalid(
                "option meshopt",
                found,
                "a build with the feature `meshopt`, or no compression",
            ));
        }
        Ok(())
    }
}

/// Maximum size of a single model in bytes: it is built in memory.
const MAX_GLB: usize = 1 << 30;
/// Tiles that are generated at a time.
const BATCH: usize = 256;

/// Writes one level of an octree, or of a view of one, as binary glTF in world coordinates in
/// metres, with y up as in glTF. Other units of length are converted; without a unit, coordinates
/// are taken as metres. The file has a node for each tile of 64 x 64 x 64 cells, with normals,
/// colours, and classes as features. The model is built in memory. Returns the number of triangles.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::{GltfOptions, MeshRequest, export_glb};
/// use spinney::Output;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("ball.glb");
/// let ball = spinney::open("fixtures/v1/ball.goblin")?;
/// let output = Output::create(&path)?;
/// assert!(export_glb(&ball, &MeshRequest::new(), &GltfOptions::new(), output, &())? > 0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is a quadtree, has no such level, or is corrupt; if its frame is flat; if the model
/// would exceed 1 GiB; if the output cannot be written; or on cancellation.
pub fn export_glb(
    tree: &Dataset,
    request: &MeshRequest,
    options: &GltfOptions,
    mut output: Output,
    progress: &dyn Progress,
) -> Result<u64> {
    options.check()?;
    super::warn_full(tree, progress)?;
    let maker = TileMaker::new(tree, request)?;
    let planned = maker.finest(progress)?;
    let pool = Pool::default();
    let mut meshes: Vec<(Tile, TileMesh)> = Vec::new();
    let mut bytes = 0;
    for batch in planned.chunks(BATCH) {
        let made = parallel::map(batch, |tile| {
            progress.check()?;
            let mesh = maker.mesh(&pool, *tile)?;
            progress.advance(1, planned.len() as u64);
            Ok((*tile, mesh))
        });
        for made in made.into_iter().collect::<Result<Vec<_>>>()? {
            bytes += made.1.bytes();
            // (glTF primitives must have triangles, so tiles without any get no node.)
            if !made.1.triangles.is_empty() {
                meshes.push(made);
            }
        }
        if bytes > MAX_GLB {
            return Err(Error::TooLarge {
                path: tree.name().to_path_buf(),
                what: format!("a glTF model of level {}", maker.level()),
                needed: bytes as u64,
                limit: MAX_GLB as u64,
                advice: "choose a coarser level, or write a tileset (x/tileset.json)".into(),
            });
        }
    }
    let attributes = meshes.iter().flat_map(|(_, mesh)| mesh.attributes());
    let mut glb = Glb::new(maker.attribute(), options, tree.metadata(), y_up(&maker.in_metres()), attributes);
    let mut triangles = 0;
    for (tile, mesh) in &meshes {
        triangles += mesh.triangles.len() as u64;
        maker.push(&mut glb, *tile, mesh);
    }
    let mut losses = Losses::of(&output);
    maker.add_losses(&mut losses)?;
    losses.add_crs(tree.metadata().frame.crs.as_ref());
    tree.check_unchanged()?;
    output.write_all(&glb.finish()).map_err(Error::io(output.path(), "write"))?;
    output.commit()?;
    losses.report(progress);
    Ok(triangles)
}
