//! Octrees for viewers: 3D Tiles 1.1, and single levels as binary glTF.
//!
//! A tileset is the octree itself (implicit tiling): a tile is a node, and has the surface of the 64 x 64 x 64 cells that lie
//! so many levels below it, in place of which viewers load its eight children when they come nearer. Tiles are made each by
//! itself, on all threads, and meet without cracks: all of a level are on one lattice.

mod buffer;
mod glb;
mod globe;
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

/// Kind of glTF that is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct GltfOptions {
    /// Vertices and triangles compressed (`EXT_meshopt_compression`), which readers must know.
    pub meshopt: bool,
}

impl GltfOptions {
    /// glTF that most readers know.
    pub fn new() -> GltfOptions {
        GltfOptions::default()
    }

    fn check(self) -> Result<()> {
        if self.meshopt && !cfg!(feature = "meshopt") {
            let found = "a build without meshopt compression";
            return Err(Error::invalid("option meshopt", found, "a build that has it, or no compression"));
        }
        Ok(())
    }
}

/// Bytes that a single model may have: it is made in memory.
const MAX_GLB: usize = 1 << 30;
/// Tiles that are made at a time.
const BATCH: usize = 256;

/// Writes one level of an octree, or of a view of one, as binary glTF, in the coordinates of its world (with y upwards, as
/// glTF has it): a node for each part of 64 x 64 x 64 cells, with normals, colours, and classes as features. The model is made in
/// memory. Returns the number of its triangles.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::{GltfOptions, MeshRequest, export_glb};
/// use spinney::Output;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("ball.glb");
/// let ball = spinney::open("fixtures/v1/ball.goblin")?;
/// let output = Output::create(&path)?;
/// assert!(export_glb(&ball, &MeshRequest::new(), &GltfOptions::new(), output, &())? > 0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is a quadtree, has no such level, or is damaged; if its frame is flat; if the model would have more than 1 GiB,
/// or cannot be written; or on interruption.
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
            // (A primitive has triangles, and a node that has a mesh is there for them.)
            if !made.1.triangles.is_empty() {
                meshes.push(made);
            }
        }
        if bytes > MAX_GLB {
            return Err(Error::TooLarge {
                path: tree.name().to_path_buf(),
                what: format!("a model of level {}", maker.level()),
                needed: bytes as u64,
                limit: MAX_GLB as u64,
                advice: "choose a coarser level, or write a tileset (x/tileset.json)".into(),
            });
        }
    }
    let attributes = meshes.iter().flat_map(|(_, mesh)| mesh.attributes());
    let mut glb = Glb::new(maker.attribute(), options, tree.metadata(), y_up(maker.frame()), attributes);
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
    losses.tell(progress);
    Ok(triangles)
}
