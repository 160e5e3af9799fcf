//! Topics of `spinney help stats`.

use super::{Topic, Topics};

pub(super) const TOPICS: Topics =
    Topics { heading: "Statistics", topics: &[ZONES, LABELS, SOLIDS, OBJECTS, LINES], refused: &[] };

const ZONES: Topic = Topic {
    name: "zones",
    summary: "cells in each polygon of a file, with exact quantiles: --zones",
    about: "\
Print statistics of the cells in each polygon of a file, with its id and attributes.

Files are GeoJSON (also one feature per line), GeoPackage (x.gpkg:LAYER), FlatGeobuf, shapefile, or a table (.csv) \
with geometries in a column wkt, wkb, geometry, geom or the_geom. Their coordinates are in the file's own \
coordinate system, or in that of --in, and are reprojected to the tree's. Only cells at the polygons' borders are \
read. Of a file of several layers there is a row for each polygon and layer, with the layer's name and time.",
    options: &[
        ("zones", ""),
        ("edge", ""),
        ("measure", ""),
        ("quantiles", ""),
        ("where", "Only polygons for which all conditions hold, as in 'code>=3,kind!=water'"),
        (
            "attribute",
            "Attributes of the polygons in --json, --csv and --output, as in name,code [default: all; with --csv none]",
        ),
    ],
    examples: &[
        "spinney stats landcover.goblin --zones districts.geojson --edge area --json",
        "spinney stats landcover.goblin --zones survey.gpkg:parcels --where 'code>=3,kind!=water' --csv",
        "spinney stats landcover.goblin --zones districts.gpkg -o districts_landcover.gpkg",
        "spinney stats relief.goblin --zones districts.gpkg --measure majority,median --quantiles 0.1,0.9",
    ],
};

const LABELS: Topic = Topic {
    name: "labels",
    summary: "size, box and neighbours of each label or connected region: --labels",
    about: "\
Print a table of all values of the cells, each of which is a label.

A row has the number of cells, the area in square metres (of octrees the volume, in the model's unit), the box of \
the cells (first column and row, columns and rows, and the same in the tree's coordinates), and the adjacent \
labels, as LABEL:EDGES, with the number of common edges (in octrees faces) of cells. Tables of any length are made \
within --memory.",
    options: &[("labels", ""), ("connect", ""), ("classes", "")],
    examples: &[
        "spinney stats landcover.goblin --labels --connect 8 -o patches.csv",
        "spinney stats labels.goblin --labels --classes landcover.goblin -o patches.csv",
    ],
};

const SOLIDS: Topic = Topic {
    name: "solids",
    summary: "volume, centre, bounds and surface of octrees: --solid, --surface",
    about: "\
Print volume, centre of gravity and bounds of a solid, in the model's unit.

They are exact; coarser levels keep the volume. --surface adds the surface of the cells that are at least half \
full: of the cells as blocks, and of the smooth surface, each face weighted by the surface's normal. It reads all \
cells at the surface. In octrees of other values than occupancy, cells that are not VOID are full.",
    options: &[("solid", ""), ("surface", ""), ("level", "")],
    examples: &[
        "spinney stats house.goblin",
        "spinney stats house.goblin --surface",
        "spinney stats house.goblin --solid --level 7",
    ],
};

const OBJECTS: Topic = Topic {
    name: "objects",
    summary: "a row for each object of an exact model: --each",
    about: "\
Print a row for each object of an exact model.

Without --each, volume, centre of gravity, inertia and surface of the whole model are printed. All are exact, and \
rounded once (with vertices off the grid, as in results of `combine`, only the volume; the others are those of faces \
on the grid); they come from sums in the file, so that no faces are read. --topology adds the numbers of vertices, \
edges, shells and handles, for which all faces are read.",
    options: &[
        ("each", ""),
        ("topology", ""),
        ("where", "Only objects for which all conditions hold, as in 'type=Building'"),
    ],
    examples: &[
        "spinney stats city.goblin --topology",
        "spinney stats city.goblin --each --csv > buildings.csv",
        "spinney stats city.goblin --each --where 'type=Building' -o buildings.gpkg",
    ],
};

const LINES: Topic = Topic {
    name: "lines",
    summary: "nearest lines to points, and crossings with other lines: --nearest, --crossing",
    about: "\
Join points to the nearest lines of a tree of lines, or count crossings with other lines.

Files in another coordinate system are reprojected to the tree's; --radius and distances are in its units. Points \
that --nearest writes keep their own coordinates, those of --crossing have the tree's. In a tree with heights, \
distances are those in space; points and lines without heights are compared in x and y.",
    options: &[
        ("nearest", ""),
        ("radius", ""),
        ("crossing", ""),
        ("attribute", "Attributes of the lines that points get, as in name,class [default: all; with --csv none]"),
    ],
    examples: &[
        "spinney stats roads.goblin",
        "spinney stats roads.goblin --nearest houses.csv --radius 500 -o houses_roads.gpkg",
        "spinney stats roads.goblin --crossing rivers.gpkg -o bridges.gpkg",
    ],
};
