//! `spinney transform` and `--view` on octrees, against arrays of cells.

use std::collections::HashSet;
use std::path::Path;

use spinney::Value;
use tempfile::TempDir;

use crate::common::command::{spinney, stderr, stdout};
use crate::common::octree::{frame, open, read, write};
use crate::common::{Cells, OCT, as_byte, assert_same, byte, made};

/// All sides differ.
const SIZE: [u64; 3] = [13, 9, 11];

/// A sequence of operations on an array.
type Model = fn(&Cells) -> Cells;

/// Returns input octrees: uncorrelated cells, large leaves next to detail, and the same with a VOID
/// margin.
fn inputs(directory: &TempDir) -> Vec<(String, Cells)> {
    let patches = Cells::random(OCT, 5, SIZE, 200, true);
    let inside = |cell: u64, axis: usize| cell > axis as u64 && cell + 3 < SIZE[axis];
    let island =
        made(OCT, SIZE, |cell| patches.get(cell).filter(|_| (0..3).all(|axis| inside(cell[axis], axis))));
    [("noise", Cells::noise(OCT, 6, SIZE, 200)), ("patches", patches), ("island", island)]
        .map(|(name, cells)| {
            let path = directory.path().join(format!("{name}.goblin"));
            write(&path, &cells, [0; 3]);
            (path.to_str().unwrap().to_string(), cells)
        })
        .into()
}

fn window(cells: &Cells, min: [i64; 3], size: [u64; 3]) -> Cells {
    made(OCT, size, |cell| cells.at(std::array::from_fn(|axis| cell[axis] as i64 + min[axis])))
}

/// Returns a result in which each cell comes from a source cell.
fn arranged(
    cells: &Cells,
    size: impl Fn([u64; 3]) -> [u64; 3],
    from: impl Fn([u64; 3], [u64; 3]) -> [u64; 3],
) -> Cells {
    made(OCT, size(cells.size), |cell| cells.get(from(cell, cells.size)))
}

/// Returns the means of the existing cells in blocks of 2 x 2 x 2.
fn halved(cells: &Cells) -> Cells {
    made(OCT, cells.size.map(|cells| cells.div_ceil(2)), |[x, y, z]| {
        let block =
            (0..8).filter_map(|i| cells.get([2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2)]));
        let values: Vec<u32> = block.map(|value| u32::from(as_byte(value))).collect();
        let count = values.len() as u32;
        (count > 0).then(|| byte(((2 * values.iter().sum::<u32>() + count) / (2 * count)) as u8))
    })
}

/// Returns the bounding box of all existing cells.
fn cropped(cells: &Cells) -> Cells {
    let (mut low, mut high) = ([u64::MAX; 3], [0; 3]);
    let size = cells.size;
    for (number, _) in cells.cells.iter().enumerate().filter(|(_, cell)| cell.is_some()) {
        let number = number as u64;
        let cell = [number % size[0], number / size[0] % size[1], number / size[0] / size[1]];
        low = std::array::from_fn(|axis| low[axis].min(cell[axis]));
        high = std::array::from_fn(|axis| high[axis].max(cell[axis] + 1));
    }
    window(cells, low.map(|cell| cell as i64), std::array::from_fn(|axis| high[axis] - low[axis]))
}

/// Returns cells rotated by the right-hand rule about a direction through a centre (by default the
/// middle), by the formula of Rodrigues.
fn turned(cells: &Cells, degrees: f64, along: [f64; 3], centre: Option<[f64; 3]>) -> Cells {
    let centre = centre.unwrap_or(cells.size.map(|cells| cells as f64 / 2.0));
    let length = along.iter().map(|number| number * number).sum::<f64>().sqrt();
    let k = along.map(|number| number / length);
    let turn = |point: [f64; 3], degrees: f64| -> [f64; 3] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let v: [f64; 3] = std::array::from_fn(|axis| point[axis] - centre[axis]);
        let dot = (0..3).map(|axis| k[axis] * v[axis]).sum::<f64>();
        std::array::from_fn(|axis| {
            let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
            let cross = k[next] * v[last] - k[last] * v[next];
            v[axis] * cos + cross * sin + k[axis] * dot * (1.0 - cos) + centre[axis]
        })
    };
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for corner in 0..8 {
        let corner =
            std::array::from_fn(|axis| if corner >> axis & 1 > 0 { cells.size[axis] as f64 } else { 0.0 });
        let there = turn(corner, degrees);
        low = std::array::from_fn(|axis| low[axis].min(there[axis]));
        high = std::array::from_fn(|axis| high[axis].max(there[axis]));
    }
    let low = low.map(|cell| (cell + 1e-6).floor());
    let size = std::array::from_fn(|axis| ((high[axis] - 1e-6).ceil() - low[axis]) as u64);
    made(OCT, size, |cell| {
        let from = turn(std::array::from_fn(|axis| cell[axis] as f64 + 0.5 + low[axis]), -degrees);
        // On the border of two cells rounding decides, so that the result is not determined.
        assert!(
            from.iter().all(|number| (number - number.round()).abs() > 1e-9),
            "{cell:?} comes from {from:?}"
        );
        cells.at(from.map(|number| number.floor() as i64))
    })
}

const CHAINS: [(&[&str], Model); 36] = [
    (&[], Cells::clone),
    (&["window=2,1,3,6,5,3"], |c| window(c, [2, 1, 3], [6, 5, 3])),
    (&["window=-2,-1,-3,9,20,8"], |c| window(c, [-2, -1, -3], [9, 20, 8])),
    // Four numbers: columns of any height.
    (&["window=3,2,5,4"], |c| window(c, [3, 2, 0], [5, 4, 11])),
    // Six numbers: only the slices that are given.
    (&["window=3,2,0,5,4,1"], |c| window(c, [3, 2, 0], [5, 4, 1])),
    (&["rotate=90"], |c| arranged(c, |[w, h, d]| [h, w, d], |[x, y, z], [_, h, _]| [y, h - 1 - x, z])),
    (&["rotate=90,z"], |c| arranged(c, |[w, h, d]| [h, w, d], |[x, y, z], [_, h, _]| [y, h - 1 - x, z])),
    (&["rotate=90,x"], |c| arranged(c, |[w, h, d]| [w, d, h], |[x, y, z], [_, _, d]| [x, z, d - 1 - y])),
    (&["rotate=90,y"], |c| arranged(c, |[w, h, d]| [d, h, w], |[x, y, z], [w, _, _]| [w - 1 - z, y, x])),
    (&["rotate=-90,x@1,2,3"], |c| {
        arranged(c, |[w, h, d]| [w, d, h], |[x, y, z], [_, h, _]| [x, h - 1 - z, y])
    }),
    (&["rotate=180,y"], |c| arranged(c, |size| size, |[x, y, z], [w, _, d]| [w - 1 - x, y, d - 1 - z])),
    (&["rotate=120,1,1,1"], |c| arranged(c, |[w, h, d]| [d, w, h], |[x, y, z], _| [y, z, x])),
    (&["mirror=x"], |c| arranged(c, |size| size, |[x, y, z], [w, _, _]| [w - 1 - x, y, z])),
    (&["mirror=y"], |c| arranged(c, |size| size, |[x, y, z], [_, h, _]| [x, h - 1 - y, z])),
    (&["mirror=z"], |c| arranged(c, |size| size, |[x, y, z], [_, _, d]| [x, y, d - 1 - z])),
    (&["transpose"], |c| arranged(c, |[w, h, d]| [h, w, d], |[x, y, z], _| [y, x, z])),
    (&["axes=+z,-x,-y"], |c| {
        arranged(c, |[w, h, d]| [d, w, h], |[x, y, z], [w, h, _]| [w - 1 - y, h - 1 - z, x])
    }),
    (&["axes=-y,+x"], |c| arranged(c, |[w, h, d]| [h, w, d], |[x, y, z], [_, h, _]| [y, h - 1 - x, z])),
    // x from y, y from z reversed, z from x; the translation does not matter.
    (&["affine=0,1,0,0,0,0,-1,20,1,0,0,0"], |c| {
        arranged(c, |[w, h, d]| [h, d, w], |[x, y, z], [_, _, d]| [z, x, d - 1 - y])
    }),
    (&["translate=3,0,2"], |c| window(c, [-3, 0, -2], [16, 9, 13])),
    (&["translate=-4,2,-1"], |c| window(c, [4, -2, 1], [9, 11, 10])),
    (&["translate=2,1"], |c| window(c, [-2, -1, 0], [15, 10, 11])),
    (&["scale=2"], |c| arranged(c, |size| size.map(|n| 2 * n), |cell, _| cell.map(|n| n / 2))),
    (&["scale=2,1,3"], |c| arranged(c, |[w, h, d]| [2 * w, h, 3 * d], |[x, y, z], _| [x / 2, y, z / 3])),
    (&["scale=0.5"], halved),
    (&["depth=3"], halved),
    (&["crop"], cropped),
    (&["tree-depth=6"], Cells::clone),
    // Children 5 and 6 of the root, which has 16 cells along each axis.
    (&["subtree=/5"], |c| window(c, [8, 0, 8], [5, 8, 3])),
    (&["embed=/6"], |c| window(c, [0, -16, -16], [13, 25, 27])),
    (&["rotate=30,1,1,0"], |c| turned(c, 30.0, [1.0, 1.0, 0.0], None)),
    (&["rotate=-50,0,1,-2@3.2,4.1,1.7"], |c| turned(c, -50.0, [0.0, 1.0, -2.0], Some([3.2, 4.1, 1.7]))),
    (&["rotate=33,x"], |c| turned(c, 33.0, [1.0, 0.0, 0.0], None)),
    (&["window=2,1,3,7,5,3", "rotate=40,y"], |c| {
        turned(&window(c, [2, 1, 3], [7, 5, 3]), 40.0, [0.0, 1.0, 0.0], None)
    }),
    (&["mirror=z", "scale=2", "window=5,4,3,12,11,10", "rotate=71,2,-1,3"], |c| {
        let mirrored = arranged(c, |size| size, |[x, y, z], [_, _, d]| [x, y, d - 1 - z]);
        let scaled = arranged(&mirrored, |size| size.map(|n| 2 * n), |cell, _| cell.map(|n| n / 2));
        turned(&window(&scaled, [5, 4, 3], [12, 11, 10]), 71.0, [2.0, -1.0, 3.0], None)
    }),
    (&["transpose", "translate=1,0,4", "rotate=90,y", "mirror=x"], |c| {
        // Rotated about y and mirrored in x: x and z are swapped, and only the new z is reversed.
        let moved =
            window(&arranged(c, |[w, h, d]| [h, w, d], |[x, y, z], _| [y, x, z]), [-1, 0, -4], [10, 13, 15]);
        arranged(&moved, |[w, h, d]| [d, h, w], |[x, y, z], [w, _, d]| [w - 1 - z, y, d - 1 - x])
    }),
];

#[test]
fn transformed_octrees() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("out.goblin");
    for (file, cells) in inputs(&directory) {
        for (steps, model) in CHAINS {
            let mut arguments = vec!["-q", "transform", &file];
            arguments.extend(steps);
            arguments.extend(["-o", out.to_str().unwrap()]);
            spinney(&arguments).success();
            assert_same(&read(&out), &model(&cells), &format!("{file}: {steps:?}"));
        }
    }
    let depth = |name: &str| open(&directory.path().join(name)).depth();
    spinney(&["-q", "transform", &inputs(&directory)[0].0, "tree-depth=6", "-o", out.to_str().unwrap()])
        .success();
    assert_eq!((depth("noise.goblin"), depth("out.goblin")), (4, 6));
}

#[test]
fn the_value_at_the_centre() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("out.goblin");
    let (file, cells) = inputs(&directory).swap_remove(0);
    spinney(&[
        "-q",
        "transform",
        "--resampling",
        "nearest",
        &file,
        "scale=0.5,1,0.25",
        "-o",
        out.to_str().unwrap(),
    ])
    .success();
    // Sides of 13 and 11 cells are not divisible: the last cells' centres may be beyond the end.
    let expected = made(OCT, [7, 9, 3], |[x, y, z]| cells.get([2 * x + 1, y, 4 * z + 2]));
    assert_same(&read(&out), &expected, "nearest");
}

#[test]
fn slices_of_views() {
    let directory = tempfile::tempdir().unwrap();
    let (file, cells) = inputs(&directory).swap_remove(1);
    // Every third sequence, of all kinds.
    for (steps, model) in CHAINS.iter().skip(1).step_by(3) {
        let expected = model(&cells);
        let [width, height, depth] = expected.size;
        let views: Vec<&str> = steps.iter().flat_map(|step| ["--view", step]).collect();
        for slice in [0, depth / 2, depth - 1] {
            let number = slice.to_string();
            let mut arguments =
                vec!["get", &file, "-", "--format", "raw", "--nodata", "255", "--slice", &number];
            arguments.extend(&views);
            let found = spinney(&arguments).success().get_output().stdout.clone();
            let cells = made(OCT, [width, height, 1], |[x, y, _]| expected.get([x, y, slice]));
            let raw: Vec<u8> = cells.cells.iter().map(|cell| cell.map_or(255, as_byte)).collect();
            assert!(found == raw, "{steps:?}, slice {slice}");
        }
        let mut arguments = vec!["stats", &file, "--json"];
        arguments.extend(&views);
        let stats: serde_json::Value = serde_json::from_str(&stdout(&arguments)).unwrap();
        let count = expected.cells.iter().flatten().count();
        assert_eq!(stats["cells"], count, "{steps:?}: {stats}");
        let beyond = depth.to_string();
        let mut arguments = vec!["get", &file, "-", "--format", "raw", "--slice", &beyond];
        arguments.extend(&views);
        let text = stderr(spinney(&arguments).code(1));
        assert!(text.contains("--slice"), "{steps:?}: {text}");
    }
}

/// Returns the output of `spinney point` for all cell centres of a box, in world coordinates of
/// [`frame`].
fn at_centres(file: &str, more: &[&str], size: [u64; 3]) -> Vec<String> {
    let point = |number: u64| {
        let cell = [number % size[0], number / size[0] % size[1], number / size[0] / size[1]];
        let [x, y, z] = frame().to_world(cell.map(|cell| cell as f64 + 0.5));
        format!("{x},{y},{z}")
    };
    let points: Vec<String> = (0..size.iter().product()).map(point).collect();
    let mut arguments = vec!["point", file];
    arguments.extend(more);
    arguments.push("--");
    arguments.extend(points.iter().map(String::as_str));
    // The model does not distinguish VOID from outside of the tree.
    stdout(&arguments).lines().map(|line| line.replace("outside", "void")).collect()
}

#[test]
fn octrees_keep_or_change_their_world_position() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("out.goblin");
    let out = out.to_str().unwrap();
    let (file, cells) = inputs(&directory).swap_remove(0);
    let say = |cell: Option<Value>| cell.map_or("void".to_string(), |value| as_byte(value).to_string());
    let expected: Vec<String> = cells.cells.iter().map(|cell| say(*cell)).collect();
    assert_eq!(at_centres(&file, &[], SIZE), expected);
    assert!(expected.iter().collect::<HashSet<_>>().len() > 150, "values distinguish cells");
    for step in
        ["rotate=90,x", "rotate=-90,y", "axes=-z,+x,-y", "mirror=z", "scale=2", "translate=3,2,5", "embed=/7"]
    {
        assert_eq!(at_centres(&file, &["--view", step], SIZE), expected, "{step}");
        spinney(&["-q", "transform", &file, step, "-o", out]).success();
        assert_eq!(at_centres(out, &[], SIZE), expected, "{step}, in a file");
    }
    // Moved with its cells, also beyond the file's own extent.
    let moved = |step: &str, from: &dyn Fn([i64; 3]) -> [i64; 3]| {
        spinney(&["-q", "transform", "--move", &file, step, "-o", out]).success();
        let expected = made(OCT, SIZE, |cell| cells.at(from(cell.map(|cell| cell as i64))));
        let expected: Vec<String> = expected.cells.into_iter().map(say).collect();
        assert_eq!(at_centres(out, &[], SIZE), expected, "{step}");
    };
    moved("translate=3,2,5", &|[x, y, z]| [x - 3, y - 2, z - 5]);
    moved("mirror=z", &|[x, y, z]| [x, y, -1 - z]);
    moved("affine=1,0,0,0,0,1,0,0,0,0,-1,11", &|[x, y, z]| [x, y, 10 - z]);
    // About the centre of 9 x 11 cells: y to z, so that the new y is the reversed z.
    moved("rotate=90,x@0,4,5", &|[x, y, z]| [x, z - 5 + 4, 4 - y + 5 - 1]);
    moved("scale=2", &|cell| cell.map(|cell| cell / 2));
}

#[test]
fn octrees_and_steps_that_do_not_fit() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (file, _) = inputs(&directory).swap_remove(0);
    let before = std::fs::read(&file).unwrap();
    let out = path("out.goblin");
    let says = |arguments: &[&str], code: i32, words: &[&str]| {
        let text = stderr(spinney(arguments).code(code));
        assert!(words.iter().all(|word| text.contains(word)), "{arguments:?}: {text}");
        assert!(!Path::new(&out).exists(), "{arguments:?}");
    };
    for step in
        ["rotate=90,w", "rotate=90,1,1", "axes=+x,+x,+z", "axes=+x,-y,+w", "scale=1,2,3,4", "embed=/8"]
    {
        says(&["transform", &file, step, "-o", &out], 2, &["invalid value", step]);
    }
    let refused: [(&str, &[&str]); 8] = [
        ("rotate=90,0,0,0", &["axis of rotation"]),
        ("window=0,0,11,3,3,3", &["window", "13 x 9 x 11"]),
        ("translate=0,0,-11", &["translation"]),
        ("affine=1,0,0,0,0,1,0,0,0,1,0,0", &["invertible"]),
        ("scale=100000", &["size of the result", "524288"]),
        ("depth=20", &["size of the result"]),
        ("tree-depth=20", &["depth", "4 to 19"]),
        ("subtree=/01234", &["subtree", "at most 4"]),
    ];
    for (step, words) in refused {
        says(&["transform", &file, step, "-o", &out], 1, words);
        says(&["get", &file, &out, "--format", "raw", "--view", step], 1, words);
    }
    let empty = path("empty.goblin");
    write(Path::new(&empty), &made(OCT, SIZE, |_| None), [0; 3]);
    says(&["transform", &empty, "crop", "-o", &out], 1, &["crop", "VOID"]);
    // The same file by another name.
    let other = format!("{}/./noise.goblin", directory.path().display());
    says(&["transform", &file, "mirror=z", "-o", &other], 1, &["input and the output"]);
    says(&["get", &file, &other, "--format", "raw", "--view", "mirror=z"], 1, &["input and the output"]);
    // Corrupt in the middle: reported, and nothing is written.
    let mut truncated = before.clone();
    truncated.truncate(before.len() / 2);
    std::fs::write(path("truncated.goblin"), truncated).unwrap();
    says(&["transform", &path("truncated.goblin"), "mirror=z", "-o", &out], 1, &["truncated.goblin"]);
    assert!(std::fs::read(&file).unwrap() == before, "the input is as it was");
}
