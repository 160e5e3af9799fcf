//! Topics of `spinney help build`.

use super::{Topic, Topics};

pub(super) const TOPICS: Topics = Topics {
    heading: "Kinds of input",
    topics: &[RASTER, VOLUMES, SOLIDS, EXACT, FEATURES, POINTS, LINES, SURFACES, BODIES],
    refused: &[],
};

pub(super) const RASTER: Topic = Topic {
    name: "raster",
    summary: "TIFF, VRT, PNG, JPEG, WebP, EXR, BMP, GIF, PNM, TGA, QOI, HDR, HGT; .chain; trees",
    about: "\
Build a quadtree of a raster, of several rasters on one grid, or of a stack of layers.

TIFF, VRT, PNG, OpenEXR and SRTM .hgt files may have any size; JPEG, WebP, BMP, GIF, PNM, TGA, QOI and \
Radiance HDR files must fit into --memory. Of several files the last lies on top.

Other inputs with these options: Freeman chain codes of regions (.chain, docs/chain_codes.md); text of \
`dump --as df`, `bintree` and `bsp` (.df, .bintree, .bsp); a tree, which is built again with another --kind, --rule, \
--transform, --depth or --crs.",
    options: &[
        ("kind", ""),
        ("rule", ""),
        ("band", ""),
        ("nodata", ""),
        (
            "transform",
            "Coordinates of the pixels: x = a col + b row + c, y = d col + e row + f [default: from the file]",
        ),
        ("layer", "Layer of an OpenEXR file [default: the first]"),
        ("pages", "Pages of a TIFF file: one by its number from 0, or `layers`: all of them as a stack"),
        ("stack", ""),
        ("names", ""),
        ("times", ""),
        ("keep-transparent", ""),
        ("max-zoom", ""),
        ("resampling", ""),
        ("allow-ballpark", ""),
    ],
    examples: &[
        "spinney build world.tif -o world.goblin",
        "spinney build landcover.tif -o landcover.goblin --kind categorical --nodata 0",
        "spinney build scene.tif -o colour.goblin --band 4,3,2",
        "spinney build N46E007.hgt N46E008.hgt -o alps.goblin --memory 1G",
        "spinney build @tiles.txt -o country.goblin",
        "spinney build B02.tif B03.tif B11.tif -o scene.goblin --stack",
        "spinney build scan.png -o scan.goblin --crs EPSG:3857 --transform 0.5,0,1000,0,-0.5,2000",
        "spinney build landcover.tif -o tiles.goblin --grid xyz",
        "spinney build dem.tif -o dem_tiles.goblin --grid xyz --max-zoom 12 --resampling cubic",
        "spinney build heights.goblin -o highest.goblin --rule max",
        "spinney build map.bintree -o map.goblin --kind categorical",
    ],
};

pub(super) const VOLUMES: Topic = Topic {
    name: "volumes",
    summary: "NPY, NRRD, raw samples (--raw-size), images of sections (--pages z)",
    about: "\
Build an octree of a volume, such as a CT scan or a block of measurements.

NPY files have the shape (z, y, x) in C order, as numpy.save writes them, or (z, y, x, channels). NRRD files, \
raw or compressed, have coordinates and units. Sections are images or pages of a TIFF file, one for each plane, \
from files or a directory. `get` writes NPY or NRRD again, `contours` makes isosurfaces.",
    options: &[
        ("kind", ""),
        ("rule", ""),
        ("nodata", "Nodata number: samples equal to it become VOID [default: from the file]"),
        ("transform", "Widths of a cell along x, y and z, or a 3 x 4 matrix, row by row [default: 1,1,1]"),
        (
            "pages",
            "With `z`: image files, the images of directories, or the pages of a TIFF file are the planes, in the \
             order of the numbers in their names (natural sort; signs, decimals and units of length count, missing \
             numbers are reported)",
        ),
        ("raw-size", ""),
        ("raw-type", ""),
        ("raw-skip", ""),
        ("big-endian", ""),
    ],
    examples: &[
        "spinney build scan.npy -o scan.goblin --nodata -1024 --transform 0.7,0.7,1.25",
        "spinney build head.nrrd -o head.goblin",
        "spinney build scan.raw -o scan.goblin --raw-size 512,512,300 --raw-type u16 --big-endian",
        "spinney build sections/ -o block.goblin --pages z --transform 0.01,0.01,0.05",
    ],
};

pub(super) const SOLIDS: Topic = Topic {
    name: "solids",
    summary: "PLY, OBJ, STL, OFF, glTF, CityJSON(Seq); .csg, .bpt, .euler, .views; --heights",
    about: "\
Build an octree of the cells that a solid fills.

The cells inside of a closed surface are exact, also with overlapping bodies and cavities; an open surface is \
decided by its winding field, to 0.01. Several models become one solid.

Other inputs: constructive solid geometry (.csg, docs/csg.md): block, ball, cylinder, cone, torus, half_space, \
prism, sweep, revolve and patches, transformed and combined. Files of Bezier patches (.bpt). Views of a solid (.views, docs/reconstruction.md): images, \
silhouettes or depths with their view directions; the octree has all cells that no view shows to be empty. \
Polygons at heights (--heights), such as sections of a body: the solid between them.",
    options: &[
        ("cells", "Cells along the longest side [default: 256]"),
        ("cell", ""),
        (
            "edge",
            "Cells that the surface cuts: centre (those whose centre is inside), touch (all of them) or area (each \
             by its share inside) [default: centre]",
        ),
        ("shell", ""),
        (
            "attribute",
            "Attribute that cells have: occupancy (255 is full), colour, or part (the number of an object, group \
             or material) [default: occupancy]",
        ),
        ("up", ""),
        ("unit", ""),
        ("stats", ""),
        ("heights", ""),
        ("where", "With --heights: only features for which all conditions hold"),
        ("layer", "With --heights: layer of a GeoPackage"),
    ],
    examples: &[
        "spinney build bunny.ply -o bunny.goblin --cells 1024",
        "spinney build part.stl -o part.goblin --cell 0.1mm --unit mm --edge area",
        "spinney build city.json -o city.goblin --cell 0.5 --attribute part",
        "spinney build bracket.csg -o bracket.goblin --cells 512",
        "spinney build bust.views -o bust.goblin --cells 512",
        "spinney build sections.csv -o body.goblin --heights z --cells 256",
    ],
};

const EXACT: Topic = Topic {
    name: "exact",
    summary: "solids with --brep: PLY, OBJ, STL, OFF, glTF, CityJSON(Seq), .csg, .bpt, .euler",
    about: "\
Build an exact model: the faces of a solid, on a fine grid, in an octree.

The faces must bound a body: closed, and without intersections deeper than two grid units. --close, --repair and \
--skip-bad are for others. \
Of CSG files, facets are within --deviation of curved surfaces. A .euler file (docs/euler.md) has Euler operators that \
build a body from nothing.",
    options: &[
        ("brep", ""),
        ("snap", ""),
        ("deviation", ""),
        ("close", ""),
        ("repair", ""),
        ("inside", ""),
        ("skip-bad", ""),
        (
            "leaf-size",
            "Maximum number of faces in a leaf, whatever their planes have in common; 0 splits nodes until their faces \
             have a common point, as in the literature [default: 12]",
        ),
        ("levels", ""),
        ("where", "Only objects, with their parts, for which all conditions hold; id and type count as attributes"),
        ("up", ""),
        ("unit", ""),
        ("stats", ""),
    ],
    examples: &[
        "spinney build part.stl -o exact.goblin --brep",
        "spinney build scan.ply -o exact.goblin --brep --close --repair",
        "spinney build city.json -o houses.goblin --brep --skip-bad --where 'type=Building'",
        "spinney build bracket.csg -o bracket.goblin --brep --deviation 0.01",
        "spinney build fixtures/hole.euler -o hole.goblin --brep",
    ],
};

const FEATURES: Topic = Topic {
    name: "features",
    summary: "GeoJSON, FlatGeobuf, GeoPackage (x.gpkg:LAYER), shapefile, CSV with geometries",
    about: "\
Build a quadtree of the cells that points, lines and polygons cover.

Features are rasterized exactly, without an intermediate raster. Cells have a number, or the value of an \
attribute. Their size is --cell, --cells or --grid.",
    options: &[
        ("cells", "Cells along the longer side of the box around the features"),
        (
            "cell",
            "Width of a cell, in units of the features' coordinates; trees with the same width are aligned",
        ),
        ("value", ""),
        (
            "edge",
            "Cells that a polygon's side cuts: centre (those whose centre is inside), touch (all of them) or area \
             (the value with the largest share) [default: centre]",
        ),
        ("overlaps", ""),
        ("fractions", ""),
        ("width", ""),
        ("type", ""),
        ("kind", ""),
        ("rule", ""),
        ("where", "Only features for which all conditions hold, as in 'code>=3,kind!=water'"),
        ("layer", "Layer of a GeoPackage"),
        ("max-zoom", "Zoom whose tiles of 256 x 256 cells are the deepest, with --grid xyz"),
    ],
    examples: &[
        "spinney build zones.gpkg -o zones.goblin --cell 10 --value code",
        "spinney build parcels.gpkg -o share.goblin --cell 30 --fractions",
        "spinney build roads.fgb -o roads.goblin --cells 4096 --width 5",
        "spinney build zones.gpkg -o zones.goblin --grid landcover.goblin --value code",
    ],
};

pub(super) const POINTS: Topic = Topic {
    name: "points",
    summary: "LAS, LAZ; with --index points: PLY, NPY (x, y, z), features (points)",
    about: "\
Build a tree of points with their attributes.

Each point is stored once; coarse levels have an evenly spread subset.",
    options: &[
        ("index", "With `points`: a tree of the points of features, of PLY vertices or of NumPy arrays"),
        ("attribute", "Attributes to store, as in intensity,classification [default: all]"),
        ("where", "Only points for which all conditions hold, as in 'classification=2,intensity>100'"),
        ("leaf-size", "Points in a leaf node [default: 50000]"),
        ("layer", "Layer of a GeoPackage"),
    ],
    examples: &[
        "spinney build scan.laz -o scan.goblin --where classification=2 --attribute intensity",
        "spinney build wells.gpkg -o wells.goblin --index points",
    ],
};

const LINES: Topic = Topic {
    name: "lines",
    summary: "with --index lines: features (lines), or the edges of a mesh",
    about: "\
Build a tree of lines: features with their attributes, for the nearest line and for crossings. If all vertices have \
heights, the tree has three axes. Edges of a mesh have the attributes `object` and `faces`, the number of their faces.",
    options: &[
        ("index", "With `lines`: a tree of the features' lines, unchanged"),
        ("up", "Axis that points up in a mesh, y or z [default: z]"),
        ("attribute", "Attributes to store, as in name,class [default: all]"),
        ("where", "Only features for which all conditions hold, as in 'class=river'"),
        ("leaf-size", "Line segments in a leaf node [default: 1024]"),
        ("layer", "Layer of a GeoPackage"),
    ],
    examples: &[
        "spinney build roads.gpkg -o roads.goblin --index lines",
        "spinney build hall.ply -o edges.goblin --index lines",
    ],
};

const SURFACES: Topic = Topic {
    name: "surfaces",
    summary: "with --tin: features (points with heights)",
    about: "\
Build a triangulated surface of points with heights, such as boreholes: a raster of its heights, its triangles \
(-o NAME.ply, .obj or .off), or with --brep and several heights the layers between their surfaces as an exact \
model, each an object of its own (docs/surfaces.md).",
    options: &[
        (
            "tin",
            "Attribute with the heights; with --brep the attributes of several surfaces, from the top down",
        ),
        ("cell", "Width of the raster's cells, in units of the points' coordinates"),
        ("breaklines", ""),
        ("outline", ""),
        ("layer-attribute", ""),
        ("depth-attribute", ""),
        ("smooth", ""),
        ("smooth-distance", ""),
        ("keep-points", ""),
        ("brep", "Build the layers between the surfaces as an exact model, instead of a raster"),
        ("snap", ""),
        ("unit", "Unit of the layers' coordinates: mm, cm, m, km, in or ft"),
        ("where", "Only points for which all conditions hold, as in 'depth>10'"),
        ("layer", "Layer of a GeoPackage"),
    ],
    examples: &[
        "spinney build boreholes.csv -o surface.goblin --tin z --cell 10 --breaklines faults.geojson",
        "spinney build boreholes.csv -o coal.ply --tin coal --smooth 5 --smooth-distance 2",
        "spinney build boreholes.csv -o layers.goblin --tin top,coal,base --brep --outline area.geojson",
        "spinney build picks.csv -o layers.goblin --tin top,coal --brep --layer-attribute layer --depth-attribute depth",
    ],
};

const BODIES: Topic = Topic {
    name: "bodies",
    summary: "with --body: features (samples in space, intervals of holes)",
    about: "\
Build an octree of values within a body, such as an ore body whose density depends on the position: the cells whose \
centres are inside of an exact model, or of one of its objects, with values that are interpolated from samples \
(docs/surfaces.md).

Samples are points with heights or an attribute z; with attributes from and to they are intervals of vertical holes, \
at their middles.",
    options: &[
        ("body", ""),
        ("object", ""),
        ("value", "Value that samples have: an attribute"),
        ("nearest", ""),
        ("radius", ""),
        ("cell", ""),
        ("cells", "Cells along the longest side of the body [default: 256]"),
        ("type", "Sample type of the cells: f32 or f64 [default: f64]"),
        ("where", "Only samples for which all conditions hold, as in 'grade>0,lab=A'"),
        ("layer", "Layer of a GeoPackage"),
    ],
    examples: &[
        "spinney build assays.csv -o grade.goblin --body ore.goblin --value grade --cell 5",
        "spinney build assays.csv -o ash.goblin --body m.goblin --object coal --value ash --cells 512",
        "spinney build rock.gpkg -o rock.goblin --body ore.goblin --value rock --cell 2 --nearest 1",
    ],
};
