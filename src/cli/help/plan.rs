//! Topics of `spinney help shard plan`.

use super::build::{POINTS, RASTER, SOLIDS, VOLUMES};
use super::{Topic, Topics};

pub(super) const TOPICS: Topics = Topics {
    heading: "Kinds of input",
    topics: &[
        Topic {
            summary: "as for `spinney build`, on one grid; trees",
            examples: &["spinney shard plan @tiles.txt -o job/ --shards 64"],
            ..RASTER
        },
        Topic { examples: &["spinney shard plan scan.nrrd -o job/ --codec packed"], ..VOLUMES },
        Topic {
            summary: "closed models: PLY, OBJ, STL, OFF, glTF, CityJSON, CityJSONSeq",
            about: "Plan an octree of the cells that a closed model fills.",
            options: &[
                ("cells", "Cells along the longest side [default: 256]"),
                ("cell", ""),
                ("edge", SOLIDS.options[2].1),
                ("shell", ""),
                ("attribute", SOLIDS.options[4].1),
                ("up", ""),
                ("unit", ""),
            ],
            examples: &["spinney shard plan bridge.ply -o job/ --cell 0.01 --edge area"],
            ..SOLIDS
        },
        Topic {
            summary: "LAS, LAZ",
            options: &[
                ("attribute", POINTS.options[1].1),
                ("where", POINTS.options[2].1),
                ("leaf-size", POINTS.options[3].1),
            ],
            examples: &["spinney shard plan scans/*.laz -o job/ --where classification=2"],
            ..POINTS
        },
    ],
    refused: &[
        "share",
        "time",
        "grid",
        "max-bytes",
        "max-zoom",
        "stats",
        "brep",
        "levels",
        "snap",
        "deviation",
        "close",
        "repair",
        "inside",
        "skip-bad",
    ],
};
