//! `spinney export`: writes trees in other programs' formats. Each kind of format has a module with
//! its own options. The output's name selects the module.

mod chain;
mod cog;
mod csg;
mod gltf;
mod mesh;
mod page;
mod polygons;
mod tiles;
mod tin;

use std::path::Path;
use std::str::FromStr;

use anyhow::{Result, bail, ensure};
use spinney::export::MeshFormat;
use spinney::raw::export::tiles::TileTarget;

use super::Global;
use super::args::{OutputFile, PartOptions, ViewedTree};

/// Write a tree in the format of other programs: tiles or a cloud-optimized GeoTIFF of a raster,
/// polygons or chain codes of classes, a mesh of a solid
///
/// The output's name selects the format, or else --format: .tif, .pmtiles, .mbtiles or a pattern
/// such as 'map/{z}/{x}/{y}.png' for rasters; .ply, .obj, .stl, .off, .glb or 'x/tileset.json' (3D
/// Tiles) for solids, for exact models .city.json, too; .csg is the CSG text that a solid was built
/// from; .html is a page that shows any of them.
///
/// A cloud-optimized GeoTIFF (.tif) has the tree's own levels as its overviews, in tiles, with the
/// tree's statistics, palette, names and coordinate system.
///
/// Tiles are squares of the world in web mercator, zoom by zoom: an archive (.pmtiles, .mbtiles),
/// or a directory with a file for each, by a pattern with {z}, {x} and {y}. Empty tiles are left
/// out, and equal ones are stored once. Memory does not grow with their number. A cancelled export
/// leaves nothing, or, with --resume, what the next one continues from.
///
/// With --polygons the regions of a tree of classes become polygons (.geojson, .gpkg, .fgb, .shp,
/// .csv or .svg), exactly along the sides of cells, with holes: one for each connected region,
/// whose cells share edges, of any level and view.
///
/// Freeman chain codes (.chain) of the same regions are a text format: the class of each region,
/// the start of its chain, the chain, and the chains of its holes; `build` makes the tree again.
/// docs/chain_codes.md has the grammar.
///
/// With --tin a raster becomes a surface of few triangles (.ply, .obj or .off) whose height error
/// at each cell is limited; `contours` has its isolines.
///
/// A mesh of an octree is closed, its faces are counterclockwise seen from outside, and its
/// coordinates are those of the world. By default it has the outer faces of the cells, merged to
/// rectangles; where rectangles of different sizes meet, a face has its neighbours' corners as
/// vertices of its own. Memory does not grow with the mesh.
///
/// For viewers, x/tileset.json is 3D Tiles 1.1: the octree in tiles of 64 cells, level by level, in
/// a new directory; x.glb is one level as binary glTF. Both have normals, colours, and classes as
/// features; the tiles lie on the globe if the file's coordinate system is known.
///
/// The faces of an exact model are written unchanged, including polygons with holes, and as
/// CityJSON (.city.json) as well.
///
/// A page (.html) shows the file in a browser: maps with legends, styles and the exact statistics
/// of polygons, solids and exact models in three dimensions. It needs only a web server with range
/// requests, which has the page, a directory `assets` and a copy of the file next to each other.
/// With --self-contained it is one file.
///
/// PLY is binary and has colours and classes as properties of faces; OBJ is text; OFF is text and
/// has colours of faces; STL is binary, in single precision.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    #[command(flatten)]
    output: OutputFile,
    /// Format, if the output's name does not say: tif, chain, ply, obj, stl, off, glb, city.json,
    /// csg or html
    #[arg(long)]
    format: Option<Target>,
    #[command(flatten)]
    part: PartOptions,
    #[command(flatten)]
    tiles: TileOptions,
    #[command(flatten)]
    archive: tiles::ArchiveOptions,
    #[command(flatten)]
    cog: cog::CogOptions,
    #[command(flatten)]
    mesh: mesh::MeshOptions,
    #[command(flatten)]
    gltf: gltf::GltfArgs,
    #[command(flatten)]
    polygons: polygons::PolygonOptions,
    #[command(flatten)]
    chain: chain::ChainOptions,
    #[command(flatten)]
    tin: tin::TinOptions,
    #[command(flatten)]
    page: page::PageOptions,
}

/// Options of all tiled rasters.
#[derive(clap::Args)]
#[command(next_help_heading = "Pictures in tiles")]
struct TileOptions {
    /// Columns and rows of a tile: 256 or 512 [default: 512 in .tif, else 256]
    #[arg(long, value_name = "PIXELS", value_parser = parse_tile_size)]
    tile_size: Option<u32>,
}

impl TileOptions {
    /// Returns the first given option.
    fn given(&self) -> Option<&'static str> {
        self.tile_size.map(|_| "--tile-size")
    }
}

/// Parses the size of a tile.
fn parse_tile_size(text: &str) -> Result<u32, &'static str> {
    match text {
        "256" => Ok(256),
        "512" => Ok(512),
        _ => Err("expected 256 or 512"),
    }
}

const EXAMPLES: &str = "Examples:
  spinney export world.goblin world.tif
  spinney export world.goblin world.tif --tile-size 256 --compression zstd
  spinney export world.goblin world.pmtiles --attribution '(c) Survey'
  spinney export world.goblin alps.mbtiles --zoom 4..12 --in lonlat --window 5.9,45.8,10.5,47.8 --tile-format webp
  spinney export dem.goblin 'map/{z}/{x}/{y}.png' --style hillshade
  spinney export landcover.goblin regions.gpkg --polygons
  spinney export landcover.goblin woods.geojson --polygons --class 3,4 --simplify 20
  spinney export landcover.goblin woods.chain --class 3 --directions 8
  spinney export dem.goblin relief.ply --tin 2
  spinney export landcover.goblin site/index.html
  spinney export bunny.goblin bunny.html --self-contained
  spinney export bunny.goblin bunny.ply
  spinney export bunny.goblin small.obj --level 6
  spinney export bunny.goblin print.stl --smooth
  spinney export bunny.goblin bunny-tiles/tileset.json --smooth --meshopt
  spinney export bunny.goblin bunny.glb --level 7
  spinney export city.goblin quarter.ply --view window=0,256,0,512,512,64
  spinney export bunny.goblin - --format stl > bunny.stl";

/// Output formats. A new one is a module, a variant here, an arm in [`Target::of`] and [`FromStr`],
/// and one in [`run`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// Chain codes.
    Chain,
    Cog,
    Mesh(MeshFormat),
    /// 3D Tiles.
    Tileset,
    Glb,
    /// The CSG text that it was built from.
    Csg,
    /// A page that shows it in a browser.
    Page,
}

impl Target {
    /// Returns the format of a file by its name.
    fn of(path: &Path) -> Option<Target> {
        if path.file_name()? == "tileset.json" {
            return Some(Target::Tileset);
        }
        path.extension()?.to_str()?.parse().ok()
    }
}

impl FromStr for Target {
    type Err = spinney::Error;

    fn from_str(name: &str) -> spinney::Result<Target> {
        match name.to_ascii_lowercase().as_str() {
            "tif" | "tiff" | "cog" => Ok(Target::Cog),
            "chain" => Ok(Target::Chain),
            "glb" => Ok(Target::Glb),
            "csg" => Ok(Target::Csg),
            "html" | "htm" => Ok(Target::Page),
            _ => name.parse().map(Target::Mesh),
        }
    }
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    ensure!(args.part.is_given() || args.part.coordinates().given().is_none(), "--in is for --window");
    if args.polygons.polygons {
        let others = [
            args.tiles.given(),
            args.archive.given(),
            args.cog.given(),
            args.gltf.given(),
            args.chain.given(),
            args.tin.tin.map(|_| "--tin"),
            args.page.given(),
        ];
        let of_part = args.part.is_given().then_some("--window");
        let of_mesh = args.mesh.given().filter(|option| *option != "--level");
        let format = args.format.map(|_| "--format");
        if let Some(option) = others.into_iter().chain([of_part, of_mesh, format]).flatten().next() {
            bail!("{option} is not for --polygons; a window is a step: --view window=...");
        }
        return polygons::run(args, global);
    }
    let tiles = if args.format.is_none() { TileTarget::of(args.output.path())? } else { None };
    let target = args.format.or_else(|| Target::of(args.output.path()));
    if tiles.is_none() && target.is_none() {
        bail!(
            "{}: unknown format; use .tif, .chain, .pmtiles, .mbtiles, a pattern with {{z}}, {{x}} and {{y}}, .ply, .obj, .stl, \
             .off, .glb, x/tileset.json, .csg or .html, or --format",
            args.output.path().display()
        );
    }
    let target = target.filter(|_| tiles.is_none());
    let is_solid = matches!(target, Some(Target::Mesh(_) | Target::Tileset | Target::Glb));
    let is_chain = target == Some(Target::Chain);
    let is_page = target == Some(Target::Page);
    let of_mesh = args.mesh.given().filter(|option| !(is_chain && *option == "--level"));
    let misplaced = [
        (is_chain, args.polygons.given().or(args.chain.given()), "regions: --polygons, or .chain"),
        (tiles.is_some() || target == Some(Target::Cog), args.tiles.given(), "pictures in tiles"),
        (
            tiles.is_some(),
            args.archive.given().filter(|option| !(is_page && ["--style", "--name"].contains(option))),
            "tiles of web maps",
        ),
        (is_page, args.page.given(), "pages"),
        (
            tiles.is_some(),
            args.part.is_given().then_some("--window"),
            "tiles of web maps; see --view window=...",
        ),
        (target == Some(Target::Cog), args.cog.given(), "cloud-optimized GeoTIFF"),
        (is_solid, of_mesh, "solids"),
        (
            matches!(target, Some(Target::Mesh(_))),
            args.tin.tin.map(|_| "--tin"),
            "surfaces in PLY, OBJ and OFF",
        ),
        (matches!(target, Some(Target::Tileset | Target::Glb)), args.gltf.given(), "3D Tiles and glTF"),
    ];
    if let Some((_, Some(option), whose)) = misplaced.iter().find(|(fits, given, _)| !fits && given.is_some())
    {
        bail!("{option} is for {whose}; {} is none", args.output.path().display());
    }
    match (tiles, target) {
        (Some(tiles), _) => tiles::run(args, &tiles, global),
        (None, Some(Target::Chain)) => chain::run(args, global),
        (None, Some(Target::Mesh(format))) => match args.tin.tin {
            Some(most) => tin::run(args, most, format, global),
            None => mesh::run(args, format, global),
        },
        (None, Some(Target::Tileset)) => gltf::write_tileset(args, global),
        (None, Some(Target::Glb)) => gltf::write_glb(args, global),
        (None, Some(Target::Csg)) => csg::run(args, global),
        (None, Some(Target::Page)) => page::run(args, global),
        (None, _) => cog::run(args, global),
    }
}
