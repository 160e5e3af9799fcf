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
  spinney contours layers.goblin --every 5 --object 'coal to base' --side bottom -o base.gpkg
  spinney contours scan.goblin --at 127.5 -o bone.ply
  spinney contours scan.goblin --at 300,1200 --ends close --level 7 -o parts.obj

Values are interpolated between the centres of cells. A value that is equal to a level counts as
above it; saddles of four cells are resolved by their mean. Lines of a level never touch: they keep
a distance of a millionth of a cell from the centres of cells. Higher values are to the right of a
line. At the edge of the raster, lines continue to the edge of its cells.

Isosurfaces of an octree are triangles, counterclockwise seen from where values are lower. They end
at the centres of the last cells unless --ends is close. For integers, use a level between two of
them. Several levels are objects in OBJ, and a property \"level\" of faces in PLY.

GeoJSON has the coordinates of the file's own coordinate system; if that is not WGS 84, a member
\"crs\" names it, as in the format's version of 2008.";

/// Write contour lines of a raster, the areas between them, or isosurfaces
///
/// Rasters are read at any level of detail. Octrees have isosurfaces. Isolines of a triangulated
/// surface (TIN: a PLY, OBJ or OFF file, such as `export --tin` writes, or a side of an exact
/// model) are exact.
///
/// The values are those of the first channel. Subtrees whose extremes exclude all levels are not
/// read. Lines have the attribute value; areas, which are polygons with holes, min and max. Memory
/// does not grow with the raster's area; with --filled it grows with the number of holes in
/// incomplete polygons. Incomplete lines are kept in a temporary file next to the output.
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
    /// an octree .ply, .obj, .stl or .off; - is standard output
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: PathBuf,
    /// Format [default: by the output's extension]
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
    /// Name of the object of an exact model, or of a mesh file, whose surface has isolines
    /// [default: all objects]
    #[arg(long, value_name = "NAME")]
    pub(super) object: Option<String>,
    /// Side of an exact model whose isolines are written [default: top]
    #[arg(long, value_name = "SIDE")]
    pub(super) side: Option<Side>,
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
    #[arg(long, value_name = "INTERVAL")]
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

/// The faces of a model that point up, or down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Side {
    /// Faces that point up
    Top,
    /// Faces that point down
    Bottom,
}

impl Side {
    pub(super) fn name(self) -> &'static str {
        match self {
            Side::Top => "top",
            Side::Bottom => "bottom",
        }
    }
}
