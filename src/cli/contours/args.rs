//! Options of `spinney contours`.

use std::path::PathBuf;

use clap::ValueEnum;

use crate::cli::args::{Memory, OutputLimit, ViewedTree, number};

const EXAMPLES: &str = "Examples:
  spinney contours dem.goblin --every 100 -o contours.geojson
  spinney contours dem.goblin --every 100 --base 50 --level 9 -o overview.svg
  spinney contours dem.goblin --at 0,200,500,1000 -o contours.gpkg
  spinney contours dem.goblin --at 0,200,500,1000 --filled -o zones.gpkg
  spinney contours dem.goblin --every 20 --view window=5,44,17,48,in=world -o alps.csv
  spinney contours relief.ply --every 10 -o lines.gpkg
  spinney contours scan.goblin --at 127.5 -o bone.ply
  spinney contours scan.goblin --at 300,1200 --ends close --level 7 -o parts.obj

Values go straight from one cell's centre to the next. One that is equal to a level counts as above it;
four cells that make a saddle, by their mean. Lines of a level never touch: they stay a millionth of a
cell away from the centres of cells. Higher values are to the right of a line. At the edge of the
picture lines go on to the edge of its cells.

Of an octree the surfaces are triangles, counterclockwise seen from where values are lower, and end at
the centres of the last cells unless they are closed there. Of whole numbers, take a level between two
of them. Several levels are objects in OBJ, and a property \"level\" of faces in PLY.

GeoJSON has the coordinates of the file's own coordinate system; if that is not WGS 84, it is named in
a member \"crs\", as in the format's version of 2008.";

/// Write contour lines of a raster at any level of detail, the areas between them, or isosurfaces
/// of an octree
///
/// Isolines of a triangulated surface (TIN: a PLY, OBJ or OFF file, such as `export --tin` writes)
/// are exact.
///
/// The values are those of the first channel. Subtrees whose extremes exclude all levels are not
/// read. Lines have the attribute value; areas, which are polygons with holes, min and max. Memory
/// does not grow with the raster's area; with --filled it grows with the number of holes in
/// polygons that are not complete yet. Incomplete lines are kept in a temporary file next to the
/// output.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    pub(super) tree: ViewedTree,
    #[command(flatten)]
    pub(super) values: LevelOptions,
    /// Value that --every counts from
    #[arg(long, value_name = "V", default_value_t = 0.0, allow_hyphen_values = true, requires = "every")]
    pub(super) base: f64,
    /// File to write: .geojson, .csv (well-known text), .svg, .gpkg, .fgb, .shp, .obj or .ply, of
    /// an octree .ply, .obj, .stl or .off; with - standard output
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: PathBuf,
    /// Format, if the output's name does not say
    #[arg(long, value_parser = ["geojson", "csv", "svg", "gpkg", "fgb", "shp", "obj", "ply", "stl", "off"])]
    pub(super) format: Option<String>,
    /// Areas between neighbouring levels instead of lines
    #[arg(long)]
    pub(super) filled: bool,
    /// Level of detail: 0 is one cell for everything, the file's depth (the default) is the
    /// original cells
    #[arg(long)]
    pub(super) level: Option<u8>,
    /// Ends of lines and surfaces near VOID cells; areas always extend to the edge of the last
    /// cells
    #[arg(long, value_name = "WHAT", default_value = "open", conflicts_with = "filled")]
    pub(super) ends: Ends,
    /// Smooth lines: number of corner-cutting passes, each of which doubles the points (Chaikin
    /// 1974)
    #[arg(long, value_name = "TIMES", default_value_t = 0, conflicts_with = "filled")]
    #[arg(value_parser = clap::value_parser!(u8).range(0..=8))]
    pub(super) smooth: u8,
    /// Points with a third coordinate: the value, of areas the minimum
    #[arg(long = "3d")]
    pub(super) has_z: bool,
    #[command(flatten)]
    pub(super) limit: OutputLimit,
    #[command(flatten)]
    pub(super) memory: Memory,
}

/// Values of the contour levels.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
pub(super) struct LevelOptions {
    /// Distance between neighbouring levels
    #[arg(long, value_name = "STEP")]
    pub(super) every: Option<f64>,
    /// At which values
    #[arg(long, value_name = "V,...", value_delimiter = ',', allow_hyphen_values = true, value_parser = number::<f64>)]
    pub(super) at: Option<Vec<f64>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Ends {
    /// Stop: no line between four cells of which one is VOID, and no surface between eight
    Open,
    /// Extend to the edge of the last cells, as in gdal_contour; lines only
    Extend,
    /// Continue along the edge of the last cells, and of the extent, so that everything is closed
    Close,
}
