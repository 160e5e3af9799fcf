//! Drawings of the 1991 paper's solids: all edges, visible edges, and the octree's blocks.

use std::path::PathBuf;

use spinney::{DataKind, Frame, Rule};

use crate::common::command::{complaint, stdout};
use crate::common::{OCT, byte, made, write_goblin};

/// The solid with a hole of the paper's figure 26.
const HOLE: &str = "unit(mm); difference(block(0,0,0, 8,8,4), block(2,3,-1, 6,5,5))";
/// [`HOLE`] without the hole.
const BLOCK: &str = "unit(mm); block(0,0,0, 8,8,4)";
/// The concave solid of figure 27.
const CONCAVE: &str = "unit(mm); sweep([[0,0],[8,0],[8,3],[3,3],[3,5],[6,5],[6,8],[0,8]], 0,0,4)";

struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    fn new() -> TestDirectory {
        TestDirectory(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Builds a file from an expression with options.
    fn built(&self, name: &str, text: &str, options: &[&str]) -> String {
        let [csg, tree] = ["csg", "goblin"]
            .map(|ending| self.path(name).with_extension(ending).to_str().unwrap().to_string());
        std::fs::write(&csg, text).unwrap();
        stdout(&[&["build", "-q", &csg, "-o", &tree], options].concat());
        tree
    }

    fn exact(&self, name: &str, text: &str) -> String {
        self.built(name, text, &["--brep", "--deviation", "0.1"])
    }

    fn drawn(&self, tree: &str, name: &str, options: &[&str]) -> Vec<u8> {
        let path = self.path(name);
        stdout(
            &[&["render", "-q", tree, "-o", path.to_str().unwrap(), "--size", "320x240"], options].concat(),
        );
        std::fs::read(path).unwrap()
    }

    fn svg(&self, tree: &str, options: &[&str]) -> String {
        String::from_utf8(self.drawn(tree, "drawn.svg", options)).unwrap()
    }
}

/// Counts the line segments of a drawing.
fn segments(svg: &str) -> usize {
    svg.lines().filter(|line| line.contains("fill=\"none\"")).map(|line| line.matches('L').count()).sum()
}

/// Edges between coplanar faces are omitted, however faces were divided.
#[test]
fn item_53_wireframes_have_every_edge_once() {
    let directory = TestDirectory::new();
    for (name, text, edges) in [("hole", HOLE, 24), ("block", BLOCK, 12), ("concave", CONCAVE, 24)] {
        let svg = directory.svg(&directory.exact(name, text), &["--drawing", "wireframe"]);
        assert_eq!(segments(&svg), edges, "{name}: {svg}");
    }
}

/// A convex solid shows three faces, each with its outline; hidden edges are omitted.
#[test]
fn item_53_hidden_lines_are_hidden() {
    let directory = TestDirectory::new();
    let [hole, block, concave] = [("hole", HOLE), ("block", BLOCK), ("concave", CONCAVE)]
        .map(|(name, text)| directory.exact(name, text));
    assert_eq!(segments(&directory.svg(&block, &["--drawing", "hidden-lines"])), 12);
    // From the horizon, the front hides the hole, and from the west the notch; from above, and from
    // the east, they are visible.
    for projection in [&["--orthographic"][..], &[]] {
        let drawn = |tree: &str, from: &str, drawing: &str| {
            let options = [&["--drawing", drawing, "--from", from], projection].concat();
            directory.drawn(tree, "drawn.png", &options)
        };
        for (tree, hidden, seen) in [(&hole, "180,0", "180,90"), (&concave, "270,0", "90,0")] {
            assert!(drawn(tree, hidden, "hidden-lines") == drawn(&block, hidden, "hidden-lines"));
            assert!(drawn(tree, seen, "hidden-lines") != drawn(&block, seen, "hidden-lines"));
            assert!(drawn(tree, hidden, "wireframe") != drawn(&block, hidden, "wireframe"));
        }
    }
}

/// The drawing covers the same area as the solid seen from above, whatever the blocks are.
#[test]
fn item_53_octants() {
    let directory = TestDirectory::new();
    let covered = |tree: &str, level: &str| {
        let options = ["--drawing", "octants", "--from", "180,90", "--orthographic", "--level", level];
        let raw =
            directory.drawn(tree, "drawn.raw", &[&options[..], &["--background", "transparent"]].concat());
        raw.chunks_exact(4).map(|pixel| f64::from(pixel[3])).sum::<f64>()
    };
    for (options, level) in [(&["--cells", "8"][..], "3"), (&["--brep", "--deviation", "0.1"], "6")] {
        let full = covered(&directory.built("block", BLOCK, options), level);
        for (name, text, share) in [("hole", HOLE, 1.0 - 8.0 / 64.0), ("concave", CONCAVE, 48.0 / 64.0)] {
            let found = covered(&directory.built(name, text, options), level) / full;
            // Lines are slightly wider than the areas they enclose.
            assert!((found - share).abs() < 0.01, "{name}: {found} instead of {share}");
        }
    }
}

/// An inside block is drawn whole, also in a leaf with faces: the solid is four octants of level 2,
/// with eight visible sides.
#[test]
fn item_53_octants_are_as_large_as_they_can_be() {
    let directory = TestDirectory::new();
    let block = directory.exact("block", BLOCK);
    for level in ["2", "3", "5"] {
        let svg = directory.svg(&block, &["--drawing", "octants", "--level", level]);
        assert_eq!(segments(&svg), 4 * (4 + 2 + 2), "level {level}: {svg}");
    }
}

/// The 1991 paper numbers octants with x in the highest bit, and hides octant 4: that corresponds
/// to a view from the north-west and above.
#[test]
fn item_44_octant_4_is_hidden() {
    let directory = TestDirectory::new();
    let without = |octant: Option<u64>| {
        let number = |[x, y, z]: [u64; 3]| 4 * x + 2 * y + z;
        // Each has its own colour, otherwise all would be one block.
        let cells = made(OCT, [2; 3], |cell| {
            let number = number(cell);
            (Some(number) != octant).then(|| byte(100 + number as u8))
        });
        let tree = directory.path("octants.goblin");
        write_goblin(&tree, &cells, (Rule::Mean, DataKind::Continuous), Frame::identity());
        let options = ["--drawing", "octants", "--from", "315,30", "--level", "1", "--orthographic"];
        directory.drawn(tree.to_str().unwrap(), "drawn.png", &options)
    };
    let whole = without(None);
    let hidden: Vec<u64> = (0..8).filter(|octant| without(Some(*octant)) == whole).collect();
    assert_eq!(hidden, [4]);
}

/// Drawings that would be too large are rejected, and so are inputs without edges.
#[test]
fn item_53_limits() {
    let directory = TestDirectory::new();
    let out = directory.path("out.svg");
    let out = out.to_str().unwrap();
    let model = directory.exact("ball", "rotate(1,2,3, 40, block(0,0,0, 1,1,1))");
    let message = complaint(&["render", &model, "-o", out, "--drawing", "octants", "--level", "10"], 1);
    assert!(message.contains("more than 262144 blocks") && message.contains("--level"), "{message}");
    let message = complaint(&["render", &model, "-o", out, "--drawing", "wireframe", "--level", "3"], 1);
    assert!(message.contains("--level"), "{message}");
    let message = complaint(&["render", &model, "-o", out], 1);
    assert!(message.contains("--drawing"), "{message}");
    let cells = directory.built("cells", BLOCK, &["--cells", "8"]);
    let message = complaint(&["render", &cells, "-o", out, "--drawing", "hidden-lines"], 1);
    assert!(message.contains("--drawing octants"), "{message}");
    assert!(!directory.path("out.svg").exists());
}

/// Transparent background, white lines on black, and every format.
#[test]
fn item_53_paper() {
    let directory = TestDirectory::new();
    let model = directory.exact("hole", HOLE);
    let svg = directory.svg(&model, &["--drawing", "hidden-lines", "--background", "transparent"]);
    assert!(!svg.contains("<rect") && svg.contains("stroke=\"#000000\""), "{svg}");
    let svg = directory.svg(&model, &["--drawing", "hidden-lines", "--background", "black"]);
    assert!(svg.contains("<rect") && svg.contains("stroke=\"#ffffff\""), "{svg}");
    let raw =
        directory.drawn(&model, "drawn.raw", &["--drawing", "wireframe", "--background", "transparent"]);
    assert_eq!(raw.len(), 320 * 240 * 4);
    let pixels: Vec<&[u8]> = raw.chunks_exact(4).collect();
    assert!(pixels.iter().any(|pixel| pixel[3] > 200) && pixels[0] == [0; 4]);
    assert!(pixels.iter().all(|pixel| pixel[..3] == [0; 3]));
}
