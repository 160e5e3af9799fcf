//! Topics of `spinney help export`.

use super::{Topic, Topics};

pub(super) const TOPICS: Topics = Topics {
    heading: "Formats",
    topics: &[TILES, COG, POLYGONS, CHAIN, MESH, GLTF, SURFACE, PAGE],
    refused: &[],
};

const TILES: Topic = Topic {
    name: "tiles",
    summary: "tiles of web maps: .pmtiles, .mbtiles, 'map/{z}/{x}/{y}.png'",
    about: "\
Write tiles of a web map.

Tiles are squares of the world in web mercator, zoom by zoom: an archive (.pmtiles, .mbtiles), or a directory with a \
file for each tile, by a pattern with {z}, {x} and {y}. Empty tiles are left out, and equal ones are stored once. \
Memory does not grow with their number. A cancelled export leaves nothing, or with --resume a file from which the \
next one continues.",
    options: &[
        ("zoom", ""),
        ("window", ""),
        ("in", ""),
        ("style", ""),
        ("tile-size", "Columns and rows of a tile: 256 or 512 [default: 256]"),
        ("tile-format", ""),
        ("png-effort", ""),
        ("quality", ""),
        ("resampling", ""),
        ("allow-ballpark", ""),
        ("name", ""),
        ("attribution", ""),
        ("resume", ""),
        ("update", ""),
        ("since", ""),
        ("restyle", ""),
        ("part", ""),
        ("parts", ""),
    ],
    examples: &[
        "spinney export world.goblin world.pmtiles --attribution '(c) Survey'",
        "spinney export world.goblin alps.mbtiles --zoom 4..12 --in lonlat --window 5.9,45.8,10.5,47.8",
        "spinney export dem.goblin 'map/{z}/{x}/{y}.png' --style hillshade",
    ],
};

const COG: Topic = Topic {
    name: "cog",
    summary: "cloud-optimized GeoTIFF: .tif",
    about: "\
Write a cloud-optimized GeoTIFF, whose overviews are the tree's own levels, in tiles, with the tree's statistics, \
palette, names and coordinate system.",
    options: &[
        ("compression", ""),
        ("nodata", ""),
        ("tile-size", "Columns and rows of a tile: 256 or 512 [default: 512]"),
    ],
    examples: &[
        "spinney export world.goblin world.tif",
        "spinney export world.goblin world.tif --tile-size 256 --compression zstd",
    ],
};

const POLYGONS: Topic = Topic {
    name: "polygons",
    summary: "regions of classes (--polygons): .geojson, .gpkg, .fgb, .shp, .csv, .svg",
    about: "\
Write the connected regions of a tree of classes as polygons, exactly along the sides of cells, with holes.",
    options: &[("polygons", ""), ("class", ""), ("connect", ""), ("simplify", "")],
    examples: &[
        "spinney export landcover.goblin regions.gpkg --polygons",
        "spinney export landcover.goblin woods.geojson --polygons --class 3,4 --simplify 20",
    ],
};

const CHAIN: Topic = Topic {
    name: "chain",
    summary: "Freeman chain codes of regions or lines: .chain",
    about: "\
Write Freeman chain codes as text: the class of each region, the start of its chain, the chain, and the chains of \
its holes. `build` makes the tree again. docs/chain_codes.md has the grammar.",
    options: &[("class", ""), ("connect", ""), ("directions", ""), ("lines", "")],
    examples: &["spinney export landcover.goblin woods.chain --class 3 --directions 8"],
};

const MESH: Topic = Topic {
    name: "mesh",
    summary: "octrees and exact models: .ply, .obj, .stl, .off, .city.json; .csg",
    about: "\
Write a solid as a mesh.

A mesh of an octree is closed, its faces are counterclockwise seen from outside, and its coordinates are those of \
the tree. By default it has the outer faces of the cells, merged to rectangles; where rectangles of different sizes \
meet, the larger ones have the vertices of the smaller ones. Memory does not grow with the mesh.

The faces of an exact model keep their vertices. Polygons stay polygons in CityJSON (.city.json), and convex ones in \
OBJ and OFF; others become triangles, as do all in PLY and STL. CityJSON is in metres, or in the unit of the \
coordinate system; other formats do not store the unit. Of a model with levels of detail ('spinney transform FILE levels'), --level, --error or --faces choose a coarser \
surface. A .csg file has the CSG text that a solid was built from.

PLY is binary and has colours and classes of faces; OBJ is text; OFF is text and has colours of faces; STL is \
binary, in single precision.",
    options: &[("level", ""), ("error", ""), ("faces", ""), ("smooth", ""), ("triangles", ""), ("where", "")],
    examples: &[
        "spinney export bunny.goblin bunny.ply",
        "spinney export statue_levels.goblin coarse.ply --error 0.005",
        "spinney export bunny.goblin small.obj --level 6",
        "spinney export bunny.goblin print.stl --smooth",
        "spinney export city.goblin quarter.ply --view window=0,256,0,512,512,64",
        "spinney export bunny.goblin - --format stl > bunny.stl",
    ],
};

const GLTF: Topic = Topic {
    name: "gltf",
    summary: "octrees and exact models for viewers: .glb, 'x/tileset.json' (3D Tiles 1.1)",
    about: "\
Write an octree for viewers: x.glb is one level as binary glTF, x/tileset.json is 3D Tiles 1.1 in a new directory: \
the octree in tiles of 64 cells, level by level. Both are in metres and have normals, colours, and classes as \
features; tiles lie on the globe if the file's coordinate system is known.

The same of an exact model: objects are features with names and attributes, and a tileset has the model's levels of \
detail ('spinney transform FILE levels'), which --level, --error or --faces choose for .glb.",
    options: &[("level", ""), ("error", ""), ("faces", ""), ("smooth", ""), ("meshopt", ""), ("where", "")],
    examples: &[
        "spinney export bunny.goblin bunny-tiles/tileset.json --smooth --meshopt",
        "spinney export bunny.goblin bunny.glb --level 7",
        "spinney export statue_levels.goblin statue-tiles/tileset.json",
    ],
};

const SURFACE: Topic = Topic {
    name: "surface",
    summary: "triangulated surface of a raster (--tin): .ply, .obj, .off",
    about: "Write a raster as a surface of few triangles whose height error at each cell is limited.",
    options: &[("tin", "")],
    examples: &["spinney export dem.goblin relief.ply --tin 2"],
};

const PAGE: Topic = Topic {
    name: "page",
    summary: "a page for browsers: .html",
    about: "\
Write a page that shows the file in a browser: maps with legends, styles and exact statistics of polygons, solids \
and exact models in three dimensions.

It needs only a web server with range requests, which has the page, a directory `assets` and a copy of the file \
next to each other. With --self-contained it is one file.",
    options: &[("self-contained", ""), ("style", ""), ("name", "")],
    examples: &[
        "spinney export landcover.goblin site/index.html",
        "spinney export bunny.goblin bunny.html --self-contained",
    ],
};
