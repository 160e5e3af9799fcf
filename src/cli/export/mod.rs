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

use anyhow::{Result, anyhow, bail, ensure};
use spinney::export::{MeshFormat, VectorFormat};
use spinney::raw::brep::is_model_file;
use spinney::raw::export::image::format_of;
use spinney::raw::export::tiles::TileTarget;
use spinney::raw::points::PointFormat;

use super::Global;
use super::args::{OutputFile, PartOptions, VECTOR_ENDINGS, VECTOR_FORMATS, ViewedTree};

/// Write a tree in other formats: web tiles, GeoTIFF, polygons, meshes, pages
///
/// The output's name selects the format, unless --format does.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    #[command(flatten)]
    output: OutputFile,
    /// Format: tif, chain, ply, obj, stl, off, glb, city.json, csg or html; of --polygons geojson,
    /// csv, svg, gpkg, fgb, shp, obj or ply [default: by the output's extension]
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

const EXAMPLES: &str = "\
Examples:
  spinney export world.goblin world.tif
  spinney export world.goblin world.pmtiles
  spinney export landcover.goblin regions.gpkg --polygons
  spinney export bunny.goblin bunny.ply
  spinney export landcover.goblin site/index.html";

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
    /// Features: only polygons of regions.
    Vector(VectorFormat),
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
    type Err = &'static str;

    fn from_str(name: &str) -> Result<Target, &'static str> {
        match name.to_ascii_lowercase().as_str() {
            "tif" | "tiff" | "cog" => Ok(Target::Cog),
            "chain" => Ok(Target::Chain),
            "glb" => Ok(Target::Glb),
            "csg" => Ok(Target::Csg),
            "html" | "htm" => Ok(Target::Page),
            other => match (other.parse::<MeshFormat>(), other.parse::<VectorFormat>()) {
                (Ok(format), _) => Ok(Target::Mesh(format)),
                (_, Ok(format)) => Ok(Target::Vector(format)),
                _ => Err(
                    "expected tif, chain, ply, obj, stl, off, glb, city.json, csg or html, or with --polygons geojson, csv, svg, gpkg, fgb, shp, obj or ply; tiles are named x.pmtiles, x.mbtiles, x/{z}/{x}/{y}.png or x/tileset.json, without --format",
                ),
            },
        }
    }
}

impl Target {
    /// Returns the format of polygons with this name.
    fn of_polygons(self) -> Result<VectorFormat> {
        match self {
            Target::Vector(format) => Ok(format),
            Target::Mesh(MeshFormat::Ply) => Ok(VectorFormat::Ply),
            Target::Mesh(MeshFormat::Obj) => Ok(VectorFormat::Obj),
            _ => bail!("--format: works with --polygons only as {}", VECTOR_FORMATS.join(", ")),
        }
    }
}

/// Returns the error for an output that no format of this command fits. Names the option or the
/// command that writes it.
fn unknown(args: &Args, global: &Global) -> anyhow::Error {
    let (name, file) = (args.output.path().display(), args.tree.file.display());
    let is_points = |format| matches!(format, PointFormat::Las | PointFormat::Laz);
    if format_of(args.output.path()).is_some() || PointFormat::of(args.output.path()).is_some_and(is_points) {
        return anyhow!(
            "{name}: `spinney export` does not write this format; use `spinney get {file} {name}`, or for images of solids `spinney render`"
        );
    }
    if is_model_file(&args.tree.file, global.access()).unwrap_or(false) {
        return anyhow!(
            "{name}: unknown format of exact models; use .ply, .obj, .stl, .off, .city.json, .glb, x/tileset.json or .html, \
             or --format"
        );
    }
    anyhow!(
        "{name}: unknown format; use .tif, .chain, .pmtiles, .mbtiles, a pattern with {{z}}, {{x}} and {{y}}, .ply, .obj, .stl, \
         .off, .glb, x/tileset.json, .csg or .html, with --polygons {VECTOR_ENDINGS}, or --format"
    )
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    ensure!(
        args.part.is_given() || args.part.coordinates().given().is_none(),
        "--in: works only with --window"
    );
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
        if let Some(option) = others.into_iter().chain([of_part, of_mesh]).flatten().next() {
            bail!("{option}: has no effect on --polygons; for a window, add --view window=...");
        }
        return polygons::run(args, global);
    }
    let tiles = if args.format.is_none() { TileTarget::of(args.output.path())? } else { None };
    let target = args.format.or_else(|| Target::of(args.output.path()));
    if tiles.is_none() && target.is_none() {
        return Err(unknown(args, global));
    }
    let target = target.filter(|_| tiles.is_none());
    if let Some(Target::Vector(_)) = target {
        bail!(
            "{}: is a format of features; add --polygons for regions of classes",
            args.output.path().display()
        );
    }
    let is_solid = matches!(target, Some(Target::Mesh(_) | Target::Tileset | Target::Glb));
    let is_chain = target == Some(Target::Chain);
    let is_page = target == Some(Target::Page);
    let of_mesh = args.mesh.given().filter(|option| !(is_chain && *option == "--level"));
    let misplaced = [
        (is_chain, args.polygons.given().or(args.chain.given()), "--polygons or .chain"),
        (tiles.is_some() || target == Some(Target::Cog), args.tiles.given(), "tiled rasters"),
        (
            tiles.is_some(),
            args.archive.given().filter(|option| !(is_page && ["--style", "--name"].contains(option))),
            "tiles of web maps",
        ),
        (is_page, args.page.given(), ".html"),
        (
            tiles.is_some()
                || args.tin.tin.is_none() && matches!(target, Some(Target::Mesh(_) | Target::Glb)),
            args.part.is_given().then_some("--window"),
            "tiles of web maps and meshes of exact models",
        ),
        (target == Some(Target::Cog), args.cog.given(), "cloud-optimized GeoTIFF"),
        (is_solid, of_mesh, "meshes of solids"),
        (
            matches!(target, Some(Target::Mesh(_))),
            args.tin.tin.map(|_| "--tin"),
            "surfaces in PLY, OBJ and OFF",
        ),
        (matches!(target, Some(Target::Tileset | Target::Glb)), args.gltf.given(), "3D Tiles and glTF"),
    ];
    if let Some((_, Some(option), whose)) = misplaced.iter().find(|(fits, given, _)| !fits && given.is_some())
    {
        let advice = if *option == "--window" { "; otherwise, add --view window=..." } else { "" };
        bail!("{}: {option} works only with {whose}{advice}", args.output.path().display());
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
