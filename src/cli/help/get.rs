//! Topics of `spinney help get`.

use super::{Topic, Topics};

pub(super) const TOPICS: Topics =
    Topics { heading: "Other trees and outputs", topics: &[ARRAYS, POINTS, LINES, MODELS], refused: &[] };

const ARRAYS: Topic = Topic {
    name: "arrays",
    summary: "octrees and slices of them; exact averages, nodata: .npy, .nrrd, .raw, .tif, .exr",
    about: "\
Write cells as an array, or a slice of an octree as an image.

Several layers are bands of a .tif, .npy or .raw file, on the grid of the layer with the smallest cells. An octree \
without --slice is an array of the axes z, y, x in .npy, .nrrd and .raw files; .nrrd also has origin, units and \
names.

A slice across x or y has columns along y or x, and rows along z: the first row of an image is the highest, that of \
an array the lowest. --window counts in the columns and rows of the slice.",
    options: &[("slice", ""), ("exact", ""), ("nodata", "")],
    examples: &[
        "spinney get world.goblin part.npy --window 20000,5000,4096,4096 --level 12",
        "spinney get house.goblin cut.png --slice y=120 --size 800x600",
        "spinney get house.goblin floor.png --slice z=2.5 --in world",
        "spinney get house.goblin solid.npy --level 7",
        "spinney get house.goblin door.npy --window 100,40,0,64,64,32",
    ],
};

const POINTS: Topic = Topic {
    name: "points",
    summary: "trees of points: .las, .laz, .csv, .ply, .npy",
    about: "\
Write points of a tree of points.

--window is minimum and maximum coordinates. --level N selects the points that are spread evenly at that level and \
above: each deeper level adds some.",
    options: &[
        ("within", ""),
        ("ball", ""),
        ("where", "Only points for which all conditions hold, as in 'classification=2,intensity>100'"),
        ("attribute", "Attributes of points to write, as in intensity,classification [default: all]"),
    ],
    examples: &[
        "spinney get scan.goblin street.laz --window 500100,5200100,500300,5200250 --where classification=2",
        "spinney get scan.goblin overview.ply --level 4",
        "spinney get scan.goblin parcel.laz --within parcels.gpkg",
    ],
};

const LINES: Topic = Topic {
    name: "lines",
    summary: "trees of lines: .geojson, .gpkg, .fgb, .shp, .csv, .svg, .obj, .ply",
    about: "\
Write features of a tree of lines: the whole features of which a line passes through --window, or crosses the \
lines of a file (--crossing), or is near them (--radius). Lines without heights cross at any height.",
    options: &[
        ("crossing", ""),
        ("radius", ""),
        ("attribute", "Attributes of lines to write, as in name,class [default: all]"),
    ],
    examples: &[
        "spinney get roads.goblin centre.gpkg --window 682000,246000,684000,248000",
        "spinney get roads.goblin bridges.gpkg --crossing rivers.gpkg",
        "spinney get pipes.goblin near.gpkg --crossing drillings.gpkg --radius 2.5",
    ],
};

const MODELS: Topic = Topic {
    name: "models",
    summary: "exact models: .ply, .obj, .off, .stl, .city.json",
    about: "\
Write faces of an exact model.

--window is minimum and maximum coordinates: the faces in this box are written, and some that are close to it. \
--level is a level of detail, from 0, the coarsest, to the exact surface, which is the default. `export` writes all \
faces, or those for an error.",
    options: &[],
    examples: &[
        "spinney get city.goblin street.obj --window 0,0,0,200,100,50",
        "spinney get city.goblin rough.ply --window 0,0,0,200,100,50 --level 2",
    ],
};
