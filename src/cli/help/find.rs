//! Topics of `spinney help find`.

use super::{Topic, Topics};

pub(super) const TOPICS: Topics =
    Topics { heading: "What to find", topics: &[CELLS, MODEL, CONTACTS], refused: &[] };

const CELLS: Topic = Topic {
    name: "cells",
    summary: "blocks of cells whose values satisfy a condition: --above, --below, --class",
    about: "\
Find the blocks of a quadtree or octree whose cells all satisfy a condition.

Every cell that satisfies the condition is in exactly one block, and no block is part of a larger one. Blocks are \
in the order of their FD codes (Z order), or with --largest by size.

A line has the block's FD code, level, first column and row, columns and rows, its box in the tree's coordinates \
(west, south, east, north, as --in world --window takes it; of octrees minimum and maximum x, y, z), and its value \
if it has only one.",
    options: &[
        ("above", ""),
        ("below", ""),
        ("class", ""),
        ("within", ""),
        ("edge", ""),
        ("where", "With --within: only features for which all conditions hold, as in 'type=park,area>=2'"),
        ("largest", ""),
    ],
    examples: &[
        "spinney find relief.goblin --above 4000",
        "spinney find landcover.goblin --class 11 --largest 10",
        "spinney find landcover.goblin --class 11 --in world --window 5,44,17,48 --json > blocks.txt",
        "spinney find landcover.goblin --class 11 --within parks.gpkg --where 'kind=national'",
    ],
};

const MODEL: Topic = Topic {
    name: "exact",
    summary: "leaves and objects of exact models: --leaf, --object",
    about: "\
Find leaves or an object of an exact model.

--leaf lists leaves of the octree. A line has the leaf's FD code, level, kind, position among the cells of its \
level, its box in the model's coordinates, and the number of faces that cut it.

--object finds an object by its name. A line has its number, its box (minimum and maximum x, y, z), its volume (- \
if it is not closed), and, separated by tabs, its name and its attributes as JSON.",
    options: &[("leaf", ""), ("object", "")],
    examples: &[
        "spinney find bracket.goblin --leaf edge,vertex --limit 20",
        "spinney find city.goblin --object 'town hall'",
    ],
};

const CONTACTS: Topic = Topic {
    name: "contacts",
    summary: "pairs of objects that touch or overlap, of an exact model or a mesh file: --contacts",
    about: "\
Find pairs of objects that touch or overlap.

Objects of an exact model can only touch; those of a mesh file, such as CityJSON, can overlap, too. A line has the \
relation (touch; overlap; contains: the second object is in the first; within: the first is in the second; equal), \
the common volume, the area of common faces, a common point, and, separated by tabs, the names.",
    options: &[("contacts", ""), ("snap", "")],
    examples: &["spinney find city.city.json --contacts --snap 0.001"],
};
