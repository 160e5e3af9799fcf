//! `spinney combine` on octrees at any offset in one grid, against arrays of cells.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use spinney::{Crs, DataKind, Frame, Rule, SampleType, Value};
use tempfile::TempDir;

use crate::common::command::{complaint, spinney, stderr, stdout};
use crate::common::octree::{frame, open, read, write};
use crate::common::{Cells, OCT, QUAD, as_byte, assert_same, byte, made, oct, write_goblin};

/// An array, and its first cell in the grid.
struct OffsetCells {
    cells: Cells,
    at: [i64; 3],
}

impl OffsetCells {
    /// Returns the value at a cell of the grid.
    fn get(&self, cell: [i64; 3]) -> Cell {
        self.cells.at(std::array::from_fn(|axis| cell[axis] - self.at[axis]))
    }

    fn end(&self, axis: usize) -> i64 {
        self.at[axis] + self.cells.size[axis] as i64
    }
}

/// Returns the bounding box of several arrays: its first cell and size.
fn around(all: &[&OffsetCells]) -> ([i64; 3], [u64; 3]) {
    let low = std::array::from_fn(|axis| all.iter().map(|one| one.at[axis]).min().unwrap());
    let high = |axis: usize| all.iter().map(|one| one.end(axis)).max().unwrap();
    (low, std::array::from_fn(|axis| (high(axis) - low[axis]) as u64))
}

/// Combines two arrays cell by cell.
fn joined(a: &OffsetCells, b: &OffsetCells, rule: impl Fn(Cell, Cell) -> Cell) -> Cells {
    let (low, size) = around(&[a, b]);
    made(OCT, size, |cell| {
        let cell = std::array::from_fn(|axis| cell[axis] as i64 + low[axis]);
        rule(a.get(cell), b.get(cell))
    })
}

type Cell = Option<Value>;

struct Setting {
    directory: TempDir,
    a: OffsetCells,
    b: OffsetCells,
}

impl Setting {
    /// Returns two octrees, each partially outside of the other, in `a.goblin` and `b.goblin`.
    fn new() -> Setting {
        let a = OffsetCells { cells: Cells::random(OCT, 31, [13, 9, 11], 6, true), at: [0; 3] };
        let b = OffsetCells { cells: Cells::random(OCT, 33, [10, 12, 8], 6, true), at: [5, -2, 4] };
        // The data have cells in both, in either one and in none, with equal values and different
        // ones.
        let kinds = joined(&a, &b, |a, b| {
            Some(byte(match (a, b) {
                (Some(a), Some(b)) => u8::from(a == b),
                (Some(_), None) => 2,
                (None, Some(_)) => 3,
                (None, None) => 4,
            }))
        });
        for kind in 0..5 {
            let count = kinds.cells.iter().filter(|cell| **cell == Some(byte(kind))).count();
            assert!(count > 20, "{count} cells of kind {kind}");
        }
        let directory = tempfile::tempdir().unwrap();
        write(&directory.path().join("a.goblin"), &a.cells, a.at);
        write(&directory.path().join("b.goblin"), &b.cells, b.at);
        Setting { directory, a, b }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_string()
    }

    /// Returns the cells of the combined files.
    fn combine(&self, operation: &str, files: &[&str], more: &[&str]) -> Cells {
        let names: Vec<String> = files.iter().map(|file| self.name(file)).collect();
        let out = self.name("out.goblin");
        let mut arguments = vec!["-q", "combine", operation];
        arguments.extend(names.iter().map(String::as_str));
        arguments.extend(["-o", &out]);
        arguments.extend(more);
        // All cells of the trees' boxes, not of the root.
        if ["nor", "xnor", "nand", "all", "not-a", "not-b", "not"].contains(&operation) {
            arguments.extend(["--margin", "0"]);
        }
        spinney(&arguments).success();
        read(Path::new(&out))
    }

    fn transform(&self, from: &str, steps: &[&str], to: &str) {
        let names = [self.name(from), self.name(to)];
        let mut arguments = vec!["-q", "transform", &names[0]];
        arguments.extend(steps);
        arguments.extend(["-o", &names[1]]);
        spinney(&arguments).success();
    }
}

/// An operation on two cells.
type Join = fn(Cell, Cell) -> Cell;

fn number(a: Cell, b: Cell, join: fn(u8, u8) -> u8) -> Cell {
    Some(byte(join(as_byte(a?), as_byte(b?))))
}

const OPERATIONS: [(&str, &[&str], Join); 26] = [
    ("union", &[], |a, b| a.or(b)),
    ("7", &["--values", "b"], |a, b| b.or(a)),
    ("intersection", &[], |a, b| a.filter(|_| b.is_some())),
    ("and", &["--values", "b"], |a, b| b.filter(|_| a.is_some())),
    ("difference", &[], |a, b| a.filter(|_| b.is_none())),
    ("b-a", &[], |a, b| b.filter(|_| a.is_none())),
    ("xor", &[], Option::xor),
    ("a", &[], |a, _| a),
    // If both have a value, the first one's counts by default, also here.
    ("b", &[], |a, b| a.or(b).filter(|_| b.is_some())),
    ("b", &["--values", "b"], |_, b| b),
    ("none", &[], |_, _| None),
    ("nor", &[], |a, b| a.or(b).map_or(Some(byte(255)), |_| None)),
    ("nor", &["--fill", "7"], |a, b| a.or(b).map_or(Some(byte(7)), |_| None)),
    ("xnor", &["--fill", "7"], |a, b| if a.is_some() == b.is_some() { a.or(Some(byte(7))) } else { None }),
    (
        "nand",
        &["--fill", "7"],
        |a, b| if a.is_some() && b.is_some() { None } else { a.or(b).or(Some(byte(7))) },
    ),
    ("all", &["--fill", "7"], |a, b| a.or(b).or(Some(byte(7)))),
    ("mask", &[], |a, b| a.filter(|_| b.is_some())),
    ("over", &[], |a, b| a.or(b)),
    ("min", &[], |a, b| number(a, b, u8::min)),
    ("max", &[], |a, b| number(a, b, u8::max)),
    ("add", &[], |a, b| number(a, b, u8::saturating_add)),
    ("subtract", &[], |a, b| number(a, b, u8::saturating_sub)),
    ("equal", &[], |a, b| a.filter(|_| a == b)),
    ("changed", &[], |a, b| if a == b { None } else { b.or(a) }),
    ("not-b", &["--fill", "9"], |a, b| if b.is_some() { None } else { a.or(Some(byte(9))) }),
    ("not-a", &["--fill", "9"], |a, b| if a.is_some() { None } else { b.or(Some(byte(9))) }),
];

#[test]
fn octrees_side_by_side() {
    let setting = Setting::new();
    let (low, _) = around(&[&setting.a, &setting.b]);
    for (operation, more, join) in OPERATIONS {
        let found = setting.combine(operation, &["a.goblin", "b.goblin"], more);
        let expected = joined(&setting.a, &setting.b, join);
        assert_same(&found, &expected, &format!("{operation} {more:?}"));
        let there = open(&setting.path("out.goblin")).metadata().frame.clone();
        assert_eq!(there.matrix, frame().shifted(low.map(|cell| cell as f64)).matrix, "{operation}");
    }
}

#[test]
fn octrees_that_are_turned_or_coarse() {
    let setting = Setting::new();
    // Its world position does not depend on the order of its cells.
    for step in ["rotate=90,x", "rotate=90,y", "axes=-z,+x,-y", "mirror=z"] {
        setting.transform("b.goblin", &[step], "turned.goblin");
        let [(_, _, union), (_, _, subtract)] = [OPERATIONS[0], OPERATIONS[21]];
        for (operation, join) in [("union", union), ("subtract", subtract)] {
            let found = setting.combine(operation, &["a.goblin", "turned.goblin"], &[]);
            assert_same(&found, &joined(&setting.a, &setting.b, join), &format!("{operation}, {step}"));
        }
    }
    // Cells twice as large count as blocks of 2 x 2 x 2. If they come first, the result has their
    // size, and the others' means.
    let small = Cells::noise(OCT, 34, [4, 7, 3], 50);
    let coarse = frame().shifted([-2.0, 3.0, 6.0]).coarser(1);
    let path = setting.path("coarse.goblin");
    write_goblin(&path, &small, (Rule::Mean, DataKind::Continuous), coarse);
    let fine = made(OCT, small.size.map(|cells| 2 * cells), |cell| small.get(cell.map(|cell| cell / 2)));
    let blocks = OffsetCells { cells: fine, at: [-2, 3, 6] };
    for (operation, _, join) in [OPERATIONS[0], OPERATIONS[4], OPERATIONS[19]] {
        let found = setting.combine(operation, &["a.goblin", "coarse.goblin"], &[]);
        assert_same(&found, &joined(&setting.a, &blocks, join), &format!("{operation}, second coarse"));
    }
}

#[test]
fn blocks_of_an_octree_are_combined_to_the_original() {
    let setting = Setting::new();
    // Split along every axis, not aligned to nodes; the last box overlaps others.
    for (name, window) in [
        ("1.goblin", "window=0,0,0,13,9,5"),
        ("2.goblin", "window=0,0,5,6,9,6"),
        ("3.goblin", "window=6,0,5,7,4,6"),
        ("4.goblin", "window=5,3,4,8,6,7"),
    ] {
        setting.transform("a.goblin", &[window], name);
    }
    let blocks = ["4.goblin", "2.goblin", "1.goblin", "3.goblin"];
    for operation in ["union", "over"] {
        assert_same(&setting.combine(operation, &blocks, &[]), &setting.a.cells, operation);
    }
    // VOID in all operands stays VOID; a minimum ignores VOID.
    let parts: Vec<OffsetCells> = [([5, 3, 4], [8, 6, 7]), ([6, 0, 5], [7, 4, 6])]
        .map(|(at, size): ([i64; 3], [u64; 3])| {
            let cells =
                made(OCT, size, |cell| setting.a.get(std::array::from_fn(|i| cell[i] as i64 + at[i])));
            OffsetCells { cells, at }
        })
        .into();
    let expected = joined(&parts[0], &parts[1], |a, b| number(a, b, u8::min));
    assert!(expected.cells.iter().flatten().count() > 10);
    assert_same(&setting.combine("min", &["4.goblin", "3.goblin"], &[]), &expected, "min of blocks");
}

#[test]
fn the_complement_of_one_octree() {
    let setting = Setting::new();
    let expected =
        made(OCT, setting.a.cells.size, |cell| setting.a.cells.get(cell).map_or(Some(byte(255)), |_| None));
    assert_same(&setting.combine("not", &["a.goblin"], &[]), &expected, "not");
    // The ball of the fixtures has all symmetries of the cube about its centre.
    let ball = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/ball.goblin");
    std::fs::copy(ball, setting.path("ball.goblin")).unwrap();
    let whole = read(&setting.path("ball.goblin"));
    for step in ["rotate=90,x", "rotate=120,1,1,1", "rotate=180,1,0,1", "affine=1,0,0,0,0,1,0,0,0,0,-1,32"] {
        setting.transform("ball.goblin", &[step, "--move"], "turned.goblin");
        let left = setting.combine("xor", &["ball.goblin", "turned.goblin"], &[]);
        assert_eq!(left.cells.iter().flatten().count(), 0, "{step}");
    }
    setting.transform("ball.goblin", &["translate=3,0,-5", "--move"], "moved.goblin");
    let left = setting.combine("difference", &["ball.goblin", "moved.goblin"], &[]);
    let [ball, moved] = [[0; 3], [3, 0, -5]].map(|at| OffsetCells { cells: whole.clone(), at });
    // Cells moved before the first cell are cut off, with their space.
    let expected = joined(&ball, &moved, |a, b| a.filter(|_| b.is_none()));
    let beyond = |cell: [u64; 3]| [cell[0], cell[1], cell[2] + 5];
    let expected = made(OCT, [35, 32, 32], |cell| expected.get(beyond(cell)));
    assert_same(&left, &expected, "ball without ball");
}

#[test]
fn which_values_meet() {
    let setting = Setting::new();
    let mut expected: BTreeMap<(Option<u8>, Option<u8>), u64> = BTreeMap::new();
    let (low, size) = around(&[&setting.a, &setting.b]);
    for number in 0..size.iter().product() {
        let cell = [number % size[0], number / size[0] % size[1], number / size[0] / size[1]];
        let cell = std::array::from_fn(|axis| cell[axis] as i64 + low[axis]);
        let pair = (setting.a.get(cell).map(as_byte), setting.b.get(cell).map(as_byte));
        if pair != (None, None) {
            *expected.entry(pair).or_default() += 1;
        }
    }
    let table = stdout(&["combine", "cross", &setting.name("a.goblin"), &setting.name("b.goblin"), "--json"]);
    let rows: Vec<serde_json::Value> = serde_json::from_str(&table).unwrap();
    let sample = |value: &serde_json::Value| value.get(0).map(|number| number.as_f64().unwrap() as u8);
    let found: Vec<_> = rows
        .iter()
        .map(|row| ((sample(&row["first"]), sample(&row["second"])), row["cells"].as_u64().unwrap()))
        .collect();
    assert_eq!(found, expected.into_iter().collect::<Vec<_>>());
}

#[test]
fn octrees_that_do_not_match() {
    let setting = Setting::new();
    let of_mean = (Rule::Mean, DataKind::Continuous);
    let (a, b, out) = (setting.name("a.goblin"), setting.name("b.goblin"), setting.name("out.goblin"));
    let plane = setting.name("plane.goblin");
    let flat = Cells::random(QUAD, 7, [13, 9, 1], 6, true);
    write_goblin(Path::new(&plane), &flat, of_mean, frame());
    let wide = setting.name("wide.goblin");
    let numbers = Cells::random(oct(SampleType::U16, 1), 7, [5; 3], 6, true);
    write_goblin(Path::new(&wide), &numbers, of_mean, frame());
    let other_crs = setting.name("other_crs.goblin");
    let [here, there] = [32632, 4326].map(|epsg| Frame { crs: Some(Crs::epsg(epsg)), ..frame() });
    let near = setting.name("near.goblin");
    write_goblin(Path::new(&near), &setting.a.cells, of_mean, here);
    write_goblin(Path::new(&other_crs), &setting.a.cells, of_mean, there);
    let before = std::fs::read(&a).unwrap();
    let says = |arguments: &[&str], words: &[&str]| {
        let text = stderr(spinney(arguments).code(1));
        assert!(words.iter().all(|word| text.contains(word)), "{arguments:?}: {text}");
        assert!(!Path::new(&out).exists(), "{arguments:?}");
    };
    for operation in ["union", "and", "xor", "subtract", "changed"] {
        let words = ["plane.goblin", "quadtree", "octree", "a.goblin"];
        says(&["combine", operation, &a, &plane, "-o", &out], &words);
        says(&["combine", operation, &plane, &a, "-o", &out], &["quadtree", "octree"]);
    }
    says(&["combine", "cross", &a, &plane], &["quadtree", "octree"]);
    says(&["combine", "over", &a, &b, &plane, "-o", &out], &["plane.goblin", "quadtree"]);
    says(&["combine", "union", &near, &other_crs, "-o", &out], &["EPSG:32632", "EPSG:4326"]);
    says(&["combine", "nor", &a, &b, "--fill", "300", "-o", &out], &["fill value", "300", "u8"]);
    says(&["combine", "b", &a, &b, &b, "-o", &out], &["two", "3"]);
    says(&["combine", "subtract", &a, &setting.name("none.goblin"), "-o", &out], &["none.goblin"]);
    // Other types, and offsets by a fraction of a cell only in z: both are converted to the first.
    let odd = setting.name("odd.goblin");
    let moved_frame = frame().shifted([0.0, 0.0, 0.5]);
    write_goblin(Path::new(&odd), &setting.b.cells, of_mean, moved_frame);
    for other in [&odd, &wide] {
        spinney(&["-q", "combine", "union", &a, other, "-o", &out]).success();
        std::fs::remove_file(&out).unwrap();
    }
    // An input as the output, by its own name or another: nothing is written.
    let dotted = format!("{}/./a.goblin", setting.directory.path().display());
    for output in [&a, &dotted] {
        says(&["combine", "union", &a, &b, "-o", output], &["a.goblin", "input and the output"]);
        says(&["combine", "union", &b, &a, "-o", output], &["a.goblin", "input and the output"]);
        says(&["combine", "not", &a, "-o", output], &["a.goblin", "input and the output"]);
    }
    #[cfg(unix)]
    {
        let link = setting.name("link.goblin");
        std::os::unix::fs::symlink(&a, &link).unwrap();
        says(&["combine", "union", &a, &b, "-o", &link], &["a.goblin", "input and the output"]);
        says(&["combine", "union", &link, &b, "-o", &a], &["link.goblin", "input and the output"]);
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
    }
    assert!(std::fs::read(&a).unwrap() == before, "the input is as it was");
}

#[test]
fn complements_have_a_universe() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    // A full box in a root of 16 cells along each axis, each half a metre wide, starting at
    // 100,200,300.
    let full = made(OCT, [16, 8, 4], |_| Some(byte(255)));
    let frame =
        Frame { matrix: [[0.5, 0.0, 0.0, 100.0], [0.0, 0.5, 0.0, 200.0], [0.0, 0.0, 0.5, 300.0]], ..frame() };
    write_goblin(
        directory.path().join("a.goblin").as_path(),
        &full,
        (Rule::Mean, DataKind::Continuous),
        frame,
    );
    let complement = |more: &[&str]| {
        let (a, out) = (name("a.goblin"), name("out.goblin"));
        let mut arguments = vec!["combine", "not", &a, "-o", &out];
        arguments.extend(more);
        let said = stderr(spinney(&arguments).success());
        let tree = open(Path::new(&out));
        let metadata = tree.metadata().clone();
        assert!(
            metadata.provenance.last().unwrap().contains("in a universe of"),
            "{:?}",
            metadata.provenance
        );
        let origin = metadata.frame.to_world([0.0; 3]);
        (said, tree.statistics(None, &()).unwrap().cells, tree.header().extent, origin, read(Path::new(&out)))
    };
    let (said, cells, extent, origin, found) = complement(&[]);
    assert!(said.contains("region     16 x 16 x 16 cells from 0,0,0: the region in which"), "{said}");
    assert_eq!((cells, extent, origin), (4096 - 512, [16; 3], [100.0, 200.0, 300.0]));
    let expected =
        made(OCT, [16; 3], |[x, y, z]| if x < 16 && y < 8 && z < 4 { None } else { Some(byte(255)) });
    assert_same(&found, &expected, "the root");
    assert_eq!(complement(&["--margin", "0"]).1, 0);
    let (_, cells, extent, origin, found) = complement(&["--margin", "2"]);
    assert_eq!((cells, extent, origin), (20 * 12 * 8 - 512, [20, 12, 8], [99.0, 199.0, 299.0]));
    let inside = |cell: [u64; 3]| (0..3).all(|axis| (2..2 + full.size[axis]).contains(&cell[axis]));
    let expected = made(OCT, [20, 12, 8], |cell| if inside(cell) { None } else { Some(byte(255)) });
    assert_same(&found, &expected, "a margin");
    // A world box partly beyond the tree: 8 x 4 x 8 cells, 4 x 4 x 4 of them full.
    let (said, cells, ..) = complement(&["--within", "98,201,298,102,203,302"]);
    assert!(said.contains("8 x 4 x 8 cells from 0,2,0"), "{said}");
    assert_eq!(cells, 8 * 4 * 8 - 4 * 4 * 4);
    let a = name("a.goblin");
    for wrong in [
        &["--within", "1,2,3"][..],
        &["--within", "5,5,5,1,1,1"],
        &["--within", "98,201,102,203"],
        &["--margin", "4294967295"],
    ] {
        let mut arguments = vec!["combine", "not", &a, "-o", "x.goblin"];
        arguments.extend(wrong);
        let code = if wrong[1] == "1,2,3" { 2 } else { 1 };
        complaint(&arguments, code);
    }
    complaint(&["combine", "union", &a, &a, "--margin", "1", "-o", "x.goblin"], 1);
}
