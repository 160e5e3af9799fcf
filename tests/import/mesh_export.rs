//! Meshes of octrees: counted, measured and read back.

use assert_cmd::Command;
use spinney::export::{MeshFormat, MeshRequest, export_mesh};
use spinney::raw::export::mesh::{FaceAttribute, MeshSummary, export_blocks};
use spinney::raw::query::cell_blocks::BlockAttribute;
use spinney::raw::store::{build_tree, depth_for};
use spinney::{DataKind, Dataset, Frame, Output, Rule, SampleType, Value};

use crate::common::mesh_file::{Read, cross, dot, minus, read_obj, read_off, read_ply, read_stl};
use crate::common::{
    Cells, OCT, QUAD, Random, as_byte, byte, dataset, goblin_bytes, made, oct, opened, options, with,
};

/// The files of a tree in all formats.
struct Job {
    level: u8,
    frame: Frame,
    carry: BlockAttribute,
    attribute: FaceAttribute,
    smooth: bool,
    triangles: bool,
}

impl Job {
    fn new(level: u8) -> Job {
        Job {
            level,
            frame: Frame::identity(),
            carry: BlockAttribute::Nothing,
            attribute: FaceAttribute::None,
            smooth: false,
            triangles: false,
        }
    }

    fn run(&self, tree: &Dataset, format: MeshFormat) -> Read {
        let mut blocks = tree.cell_blocks(self.level, self.carry).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("mesh");
        let request = with(MeshRequest::new(), |it| {
            it.level = None;
            it.smooth = self.smooth;
            it.triangles = self.triangles;
        });
        let summary = export_blocks(
            &mut *blocks,
            self.attribute,
            &self.frame,
            &request,
            Output::create(&path).unwrap(),
            format,
            &(),
        )
        .unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let read = match format {
            MeshFormat::Ply => read_ply(&bytes),
            MeshFormat::Obj => read_obj(&bytes),
            MeshFormat::Stl => read_stl(&bytes),
            MeshFormat::Off => read_off(&bytes),
            MeshFormat::CityJson => unreachable!("trees are not written as CityJSON"),
        };
        let found = MeshSummary { vertices: read.points.len() as u64, faces: read.faces.len() as u64 };
        assert_eq!(found, summary);
        if self.triangles {
            assert!(read.faces.iter().all(|face| face.len() == 3));
        }
        read
    }
}

/// Returns an octree of a depth.
fn tree_of(depth: u8, cells: &Cells, rule: Rule) -> Dataset {
    opened(|path| {
        let output = Output::create(path).unwrap();
        let options = options(rule, DataKind::Continuous, depth);
        build_tree(&cells.tree_of_depth(depth, rule), cells.size, &options, output, &()).unwrap();
    })
}

/// Returns the number of cells, and of cell faces per axis and direction.
fn expected(size: [u64; 3], solid: impl Fn([u64; 3]) -> bool) -> (f64, [f64; 6]) {
    let (mut volume, mut areas) = (0.0, [0.0; 6]);
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                if solid([x, y, z]) {
                    volume += 1.0;
                    for side in 0..6 {
                        let mut neighbour = [x, y, z];
                        let by = if side % 2 == 0 { u64::MAX } else { 1 };
                        neighbour[side / 2] = neighbour[side / 2].wrapping_add(by);
                        let inside = (0..3).all(|axis| neighbour[axis] < size[axis]);
                        areas[side] += f64::from(u8::from(!inside || !solid(neighbour)));
                    }
                }
            }
        }
    }
    (volume, areas)
}

const FORMATS: [MeshFormat; 4] = [MeshFormat::Ply, MeshFormat::Obj, MeshFormat::Stl, MeshFormat::Off];

/// Checks the faces of full cells in all formats.
fn check_faces(depth: u8, size: [u64; 3], solid: impl Fn([u64; 3]) -> bool, what: &str) -> Read {
    let cells = made(OCT, size, |cell| solid(cell).then(|| byte(255)));
    let tree = tree_of(depth, &cells, Rule::Occupancy);
    let (volume, areas) = expected(size, &solid);
    for format in FORMATS {
        for triangles in [false, true] {
            let read = Job { triangles, ..Job::new(depth) }.run(&tree, format);
            let what = format!("{what}, {format:?}");
            read.check_closed(&what);
            assert_eq!(read.volume(), volume, "{what}");
            assert_eq!(read.areas(), areas, "{what}");
        }
    }
    Job::new(depth).run(&tree, MeshFormat::Ply)
}

fn check_ball(read: &Read, radius: f64, cell: f64, what: &str) {
    read.check_closed(what);
    let ratio = read.volume() / (4.0 / 3.0 * std::f64::consts::PI * radius.powi(3));
    println!(
        "{what}: {} points, {} faces, volume {ratio} of the ball's",
        read.points.len(),
        read.faces.len()
    );
    // The loss by flat faces is quadratic in their size.
    assert!((ratio - 1.0).abs() < 0.01 + 1.5 * (cell / radius).powi(2), "{what}: {ratio}");
}

fn in_ball(cell: [u64; 3], centre: f64, radius: f64) -> bool {
    cell.iter().map(|cell| (*cell as f64 + 0.5 - centre).powi(2)).sum::<f64>() < radius * radius
}

#[test]
fn a_cube_has_six_faces() {
    for depth in 0..=5 {
        let side = 1 << depth;
        let read = check_faces(depth, [side; 3], |_| true, &format!("cube of {side}"));
        assert_eq!((read.points.len(), read.faces.len()), (8, 6), "depth {depth}");
    }
    // Blocks have 32 cells along an edge.
    let read = check_faces(6, [64; 3], |_| true, "cube of 64");
    assert_eq!((read.points.len(), read.faces.len()), (26, 24));
    // In the middle of a larger space.
    let inside = |cell: [u64; 3]| cell.iter().all(|cell| (20..50).contains(cell));
    let read = check_faces(7, [64; 3], inside, "cube in space");
    assert_eq!((read.points.len(), read.faces.len()), (26, 24));
    assert_eq!(check_faces(4, [16; 3], |_| false, "nothing").faces.len(), 0);
}

#[test]
fn cavities_and_edges_where_four_faces_meet() {
    let cavity = |cell: [u64; 3]| cell.iter().all(|cell| *cell < 8) && cell != [3, 4, 5];
    let read = check_faces(3, [8; 3], cavity, "cavity");
    assert_eq!(read.faces.len(), 12);
    let wide = |cell: [u64; 3]| cell.iter().any(|cell| !(10..41).contains(cell));
    check_faces(6, [50; 3], wide, "wide cavity");
    for side in [6, 24] {
        let checks = |[x, y, z]: [u64; 3]| (x + y + z) % 2 == 0;
        let read = check_faces(6, [side; 3], checks, "checkerboard");
        assert_eq!(read.faces.len() as u64, side.pow(3) / 2 * 6);
    }
    let stairs = |[x, y, z]: [u64; 3]| x + y + 2 * z < 60;
    check_faces(6, [50; 3], stairs, "stairs");
}

#[test]
fn random_solids() {
    let mut random = Random(31);
    for seed in 0..24 {
        let size: [u64; 3] = std::array::from_fn(|_| 1 + random.below(if seed < 18 { 14 } else { 60 }));
        let cells = Cells::random(OCT, seed, size, 2, true);
        let dense = seed % 3;
        let solid = |cell| match dense {
            0 => cells.get(cell) == Some(byte(1)),
            1 => cells.get(cell).is_some(),
            _ => cells.get(cell) != Some(byte(1)),
        };
        let depth = depth_for(size) + random.below(2) as u8;
        let read = check_faces(depth, size, solid, &format!("seed {seed}"));
        let longest = read.faces.iter().map(Vec::len).max().unwrap_or(0);
        println!("{size:?}: {} points, {} faces of up to {longest}", read.points.len(), read.faces.len());
    }
}

#[test]
fn levels_and_coverage() {
    let cells = Cells::random(OCT, 5, [60, 41, 50], 3, true);
    let coverage = [40, 128, 255];
    let cells =
        made(OCT, cells.size, |cell| cells.get(cell).map(|value| byte(coverage[as_byte(value) as usize])));
    for rule in [Rule::Occupancy, Rule::Max] {
        let tree = tree_of(6, &cells, rule);
        for level in 0..=6u8 {
            let side = 1u64 << (6 - level);
            let solid = |cell: [u64; 3]| {
                let (mut sum, mut any) = (0, false);
                for i in 0..side.pow(3) {
                    let below = [i % side, i / side % side, i / side / side];
                    let found = cells.get([0, 1, 2].map(|axis| cell[axis] * side + below[axis]));
                    any |= found.is_some();
                    sum += found.map_or(0, |value| u64::from(as_byte(value)));
                }
                let mean = (sum as f64 / side.pow(3) as f64 + 0.5).floor();
                if rule == Rule::Occupancy { mean >= 128.0 } else { any }
            };
            let (volume, areas) = expected([1 << level; 3], solid);
            let read = Job::new(level).run(&tree, MeshFormat::Ply);
            read.check_closed("level");
            assert_eq!((read.volume(), read.areas()), (volume, areas), "{rule}, level {level}");
            let smooth = Job { smooth: true, carry: BlockAttribute::Coverage, ..Job::new(level) };
            smooth.run(&tree, MeshFormat::Obj).check_closed("smooth level");
        }
    }
}

#[test]
fn mirrored_frames_keep_faces_outward() {
    let solid = |[x, y, z]: [u64; 3]| x < 20 && y < 3 + x && z < 37 && !(x == 7 && z == 9);
    let cells = made(OCT, [40; 3], |cell| solid(cell).then(|| byte(255)));
    let tree = tree_of(6, &cells, Rule::Occupancy);
    let (volume, _) = expected([40; 3], solid);
    let frames = [
        [[0.5, 0.0, 0.0, 100.0], [0.0, 2.0, 0.0, -7.0], [0.0, 0.0, 4.0, 0.0]],
        [[0.5, 0.0, 0.0, 100.0], [0.0, -2.0, 0.0, -7.0], [0.0, 0.0, 4.0, 0.0]],
        [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        [[1.0, 0.5, 0.0, 3.0], [0.25, 1.0, -1.0, 0.0], [0.0, 1.0, -2.0, 0.0]],
        [[0.5, 0.0, 0.0, 3e8], [0.0, -0.5, 0.0, 5e9], [0.0, 0.0, 0.5, 0.0]],
    ];
    for (i, matrix) in frames.into_iter().enumerate() {
        let frame = Frame { matrix, ..Frame::identity() };
        let cell = dot(
            [0, 1, 2].map(|axis| matrix[axis][0]),
            cross([0, 1, 2].map(|axis| matrix[axis][1]), [0, 1, 2].map(|axis| matrix[axis][2])),
        );
        for smooth in [false, true] {
            let job = Job { frame: frame.clone(), smooth, ..Job::new(6) };
            let mut volumes = Vec::new();
            for format in [MeshFormat::Ply, MeshFormat::Obj, MeshFormat::Stl] {
                // The last one has coordinates too large for f32.
                if i < 4 || format != MeshFormat::Stl {
                    let mut read = job.run(&tree, format);
                    read.check_closed("frame");
                    let origin = matrix.map(|row| row[3]);
                    read.points.iter_mut().for_each(|point| *point = minus(*point, origin));
                    volumes.push(read.volume() / cell.abs());
                }
            }
            let tolerance = if smooth { 0.05 * volume } else { 1e-6 * volume };
            println!("{matrix:?}, smooth {smooth}: {volumes:?} of {volume}");
            assert!(volumes.iter().all(|found| (found - volume).abs() < tolerance));
        }
    }
    let mut blocks = tree.cell_blocks(6, BlockAttribute::Nothing).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let flat = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0; 4]];
    for (matrix, words) in [(frames[4], "single precision"), (flat, "an invertible matrix")] {
        let error = export_blocks(
            &mut *blocks,
            FaceAttribute::None,
            &Frame { matrix, ..Frame::identity() },
            &MeshRequest::default(),
            Output::create(&directory.path().join("a.stl")).unwrap(),
            MeshFormat::Stl,
            &(),
        );
        assert!(error.unwrap_err().to_string().contains(words));
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn smooth_balls() {
    // Across block borders, and at the border of the space.
    for (size, centre, radius) in [(64, 32.0, 20.3), (64, 31.5, 31.5), (32, 16.0, 16.0), (100, 47.0, 40.0)] {
        let cells = made(OCT, [size; 3], |cell| in_ball(cell, centre, radius).then(|| byte(255)));
        let tree = tree_of(depth_for([size; 3]), &cells, Rule::Occupancy);
        for format in FORMATS {
            let job = Job { smooth: true, ..Job::new(depth_for([size; 3])) };
            check_ball(&job.run(&tree, format), radius, 1.0, &format!("ball of {radius}, {format:?}"));
        }
    }
    // Coverage interpolates vertices between cells, also at coarser levels.
    let radius = 50.0;
    let cells = made(OCT, [128; 3], |cell| in_ball(cell, 64.0, radius).then(|| byte(255)));
    let tree = tree_of(7, &cells, Rule::Occupancy);
    for level in [4, 5, 6] {
        let job = Job { smooth: true, carry: BlockAttribute::Coverage, ..Job::new(level) };
        let read = job.run(&tree, MeshFormat::Ply);
        let cell = 2f64.powi(7 - i32::from(level));
        check_ball(&read, radius / cell, 1.0, &format!("level {level}"));
        let distance =
            |point: &[f64; 3]| point.iter().map(|x| (x * cell - 64.0).powi(2)).sum::<f64>().sqrt() / cell;
        let worst =
            read.points.iter().map(|point| (distance(point) - radius / cell).abs()).fold(0.0, f64::max);
        println!("level {level}: points at most {worst} cells from the ball");
        assert!(worst < 0.3);
    }
}

#[test]
fn smooth_random_solids_are_closed() {
    for seed in 0..6 {
        let size = [40 + seed, 33, 64 - seed];
        let cells = Cells::random(OCT, seed, size, 2, true);
        let cells = made(OCT, size, |cell| cells.get(cell).map(|_| byte(255)));
        let tree = tree_of(6, &cells, Rule::Occupancy);
        for triangles in [false, true] {
            let read = Job { smooth: true, triangles, ..Job::new(6) }.run(&tree, MeshFormat::Ply);
            read.check_manifold(&format!("seed {seed}"));
            assert!(read.volume() > 0.0);
        }
    }
}

#[test]
fn smooth_surfaces_are_manifolds_in_every_format() {
    // Uncorrelated cells: all ways in which cells touch, and coverages close to one half, where
    // vertices almost coincide.
    let size = [35, 9, 7];
    for coverages in [&[255][..], &[1, 100, 127, 128, 129, 200, 255]] {
        let cells = made(OCT, size, |[x, y, z]| {
            let number = Random(x + size[0] * (y + size[1] * z)).next();
            (number >> 60 & 1 == 0).then(|| byte(coverages[(number >> 8) as usize % coverages.len()]))
        });
        let tree = tree_of(6, &cells, Rule::Occupancy);
        // Cells of one unit, at the limit of single precision, and rotated.
        let mut far = Frame::identity();
        (far.matrix[0][3], far.matrix[1][3]) = (130_000.3, -70_000.9);
        let mut turned = far.clone();
        (turned.matrix[0][0], turned.matrix[0][1]) = (0.8, -0.6);
        (turned.matrix[1][0], turned.matrix[1][1]) = (0.6, 0.8);
        for (format, frame) in FORMATS
            .into_iter()
            .flat_map(|format| [Frame::identity(), far.clone(), turned.clone()].map(|it| (format, it)))
        {
            let what = format!("{format:?}, coverages {coverages:?}, {:?}", frame.matrix);
            let job = Job { smooth: true, carry: BlockAttribute::Coverage, frame, ..Job::new(6) };
            job.run(&tree, format).check_manifold(&what);
            Job { triangles: true, ..job }.run(&tree, format).check_manifold(&what);
        }
    }
}

#[test]
fn smooth_surfaces_that_single_precision_cannot_hold_are_refused() {
    let tree = tree_of(3, &made(OCT, [8; 3], |_| Some(byte(255))), Rule::Occupancy);
    let mut frame = Frame::identity();
    frame.matrix[0][3] = 3_000_000.0;
    let write = |smooth: bool, format: MeshFormat| {
        let directory = tempfile::tempdir().unwrap();
        let output = Output::create(&directory.path().join("mesh")).unwrap();
        let mut blocks = tree.cell_blocks(3, BlockAttribute::Nothing).unwrap();
        let request = with(MeshRequest::new(), |it| it.smooth = smooth);
        export_blocks(&mut *blocks, FaceAttribute::None, &frame, &request, output, format, &())
    };
    // Single precision can represent whole cells, but not fractions of cells.
    write(false, MeshFormat::Stl).unwrap();
    let error = write(true, MeshFormat::Stl).unwrap_err().to_string();
    assert!(error.contains("single precision"), "{error}");
    write(true, MeshFormat::Ply).unwrap();
    // Coordinates above and below the range of single precision.
    for size in [1e38, 1e-45] {
        let mut frame = Frame::identity();
        (0..3).for_each(|axis| frame.matrix[axis][axis] = size);
        for (smooth, format) in [(false, MeshFormat::Ply), (true, MeshFormat::Obj), (true, MeshFormat::Ply)] {
            let job = Job { smooth, frame: frame.clone(), ..Job::new(3) };
            job.run(&tree, format).check_manifold(&format!("{size}, {format:?}"));
        }
        let mut blocks = tree.cell_blocks(3, BlockAttribute::Nothing).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let output = Output::create(&directory.path().join("mesh")).unwrap();
        let (none, request) = (FaceAttribute::None, MeshRequest::new());
        let error = export_blocks(&mut *blocks, none, &frame, &request, output, MeshFormat::Stl, &());
        assert!(error.is_err_and(|error| error.to_string().contains("single precision")), "{size}");
    }
}

#[test]
fn colours_and_values_are_per_face() {
    let cells = made(oct(SampleType::U8, 3), [40, 8, 8], |[x, y, z]| {
        let solid = y + z < 12;
        solid.then(|| Value::from(if x < 35 { [10u8, 20, 30] } else { [200, 100, 50] }))
    });
    let tree = tree_of(6, &cells, Rule::Mean);
    for smooth in [false, true] {
        let job =
            Job { carry: BlockAttribute::Value, attribute: FaceAttribute::Colour, smooth, ..Job::new(6) };
        for format in [MeshFormat::Ply, MeshFormat::Off] {
            let read = job.run(&tree, format);
            read.check_closed("colours");
            for (face, extra_numbers) in read.faces.iter().zip(&read.extra_numbers) {
                let x = face.iter().map(|i| read.points[*i][0]).sum::<f64>() / face.len() as f64;
                assert_eq!(*extra_numbers, if x < 35.0 { [10, 20, 30] } else { [200, 100, 50] }, "at {x}");
            }
        }
    }
    let cells = Cells::random(oct(SampleType::U16, 1), 3, [50, 20, 34], 500, true);
    let tree = tree_of(6, &cells, Rule::Majority);
    let job = Job { carry: BlockAttribute::Value, attribute: FaceAttribute::Short, ..Job::new(6) };
    let read = job.run(&tree, MeshFormat::Ply);
    read.check_closed("values");
    let (volume, areas) = expected(cells.size, |cell| cells.get(cell).is_some());
    assert_eq!((read.volume(), read.areas()), (volume, areas));
    for (face, extra_numbers) in read.faces.iter().zip(&read.extra_numbers) {
        // Just inside the face, near its first vertex.
        let [a, b, c] = [0, 1, face.len() - 1].map(|i| read.points[face[i]]);
        let (u, v) = (minus(b, a), minus(c, a));
        let normal = cross(u, v);
        let unit = |v: [f64; 3], i: usize| v[i] / dot(v, v).sqrt() / 2.0;
        let cell = [0, 1, 2].map(|i| (a[i] + unit(u, i) + unit(v, i) - unit(normal, i)).floor() as u64);
        assert_eq!(Some(Value::from([extra_numbers[0]])), cells.get(cell), "{cell:?}");
    }
}

#[test]
fn files_and_views_on_the_command_line() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let cells = made(OCT, [90, 70, 50], |cell| in_ball(cell, 25.0, 22.0).then(|| byte(255)));
    let file = path("ball.goblin");
    let bytes = goblin_bytes(&cells, Rule::Occupancy, DataKind::Continuous);
    std::fs::write(&file, &bytes).unwrap();
    let (volume, areas) = expected(cells.size, |cell| cells.get(cell).is_some());
    let spinney = |arguments: &[&str]| Command::cargo_bin("spinney").unwrap().args(arguments).assert();
    let out = path("ball.ply");
    let said = spinney(&["export", &file, &out]).success();
    let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
    let read = read_ply(&std::fs::read(&out).unwrap());
    read.check_closed("file");
    assert_eq!((read.volume(), read.areas()), (volume, areas));
    assert!(said.contains(&format!("{} faces, {} vertices", read.faces.len(), read.points.len())), "{said}");
    // Mirroring and moving does not change world coordinates.
    for steps in [["mirror=x", "window=3,0,0,87,70,50"], ["translate=5,6,7", "axes=+y,-x,+z"]] {
        let mut arguments = vec!["-q", "export", &file, &out];
        arguments.extend(steps.iter().flat_map(|step| ["--view", step]));
        spinney(&arguments).success();
        let view = read_ply(&std::fs::read(&out).unwrap());
        view.check_closed("view");
        assert_eq!((view.volume(), view.areas()), (volume, areas), "{steps:?}");
    }
    for (level, cell) in [("7", 1.0), ("6", 2.0), ("5", 4.0)] {
        let name = path("level.obj");
        spinney(&["-q", "export", &file, &name, "--level", level, "--smooth"]).success();
        check_ball(&read_obj(&std::fs::read(&name).unwrap()), 22.0, cell, &format!("level {level}"));
    }
    // A view has the cells of its level, whatever the file has there.
    let name = path("turned.obj");
    spinney(&["-q", "export", &file, &name, "--smooth", "--view", "rotate=30,1,1,0"]).success();
    check_ball(&read_obj(&std::fs::read(&name).unwrap()), 22.0, 1.0, "turned");
    let stl = spinney(&["export", &file, "-", "--format", "stl"]).success();
    assert_eq!(read_stl(&stl.get_output().stdout).volume(), volume);
    // Rejected exports leave no file.
    let quad = path("quad.goblin");
    let flat = Cells::random(QUAD, 1, [20, 20, 1], 3, true);
    std::fs::write(&quad, goblin_bytes(&flat, Rule::Mean, DataKind::Continuous)).unwrap();
    let same = path("same.ply");
    std::fs::copy(&file, &same).unwrap();
    let none = path("none.ply");
    let files = std::fs::read_dir(directory.path()).unwrap().count();
    let says = |arguments: &[&str], code: i32, words: &[&str]| {
        let failed = spinney(arguments).code(code);
        let text = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        assert!(words.iter().all(|word| text.contains(word)), "{arguments:?}: {text}");
    };
    says(&["export", &quad, &none], 1, &["a quadtree", "an octree"]);
    says(&["export", &same, &same], 1, &["input and the output"]);
    says(&["export", &file, &none, "--level", "8"], 1, &["level", "0 to 7"]);
    says(&["export", &file, &path("none.txt")], 1, &["unknown format", ".stl"]);
    says(&["export", &file, "-"], 1, &["--format"]);
    says(&["export", &path("missing.goblin"), &none], 1, &["missing.goblin"]);
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), files);
    assert_eq!(std::fs::read(&same).unwrap(), bytes);
}

#[test]
fn ply_properties_follow_the_tree_type() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.ply");
    let export = |tree: &Dataset, format| {
        let output = Output::create(&path).unwrap();
        export_mesh(tree, &MeshRequest::default(), output, format, &()).unwrap();
        std::fs::read(&path).unwrap()
    };
    let header = |bytes: &[u8]| String::from_utf8_lossy(&bytes[..400.min(bytes.len())]).into_owned();
    let size = [9, 9, 9];
    let tree =
        dataset(&Cells::random(oct(SampleType::U8, 3), 2, size, 4, true), Rule::Mean, DataKind::Continuous);
    assert!(header(&export(&tree, MeshFormat::Ply)).contains("uchar red\nproperty uchar green\n"));
    read_obj(&export(&tree, MeshFormat::Obj)).check_closed("obj");
    assert!(
        read_off(&export(&tree, MeshFormat::Off))
            .extra_numbers
            .iter()
            .all(|extra_numbers| extra_numbers.len() == 3)
    );
    let json = Output::create(&directory.path().join("a.city.json")).unwrap();
    let error = export_mesh(&tree, &MeshRequest::default(), json, MeshFormat::CityJson, &()).unwrap_err();
    assert!(error.to_string().contains("PLY, OBJ, STL or OFF"), "{error}");
    let tree = dataset(&Cells::random(OCT, 2, size, 4, true), Rule::Majority, DataKind::Categorical);
    assert!(header(&export(&tree, MeshFormat::Ply)).contains("property uchar value\nend_header"));
    let tree = dataset(
        &Cells::random(oct(SampleType::U16, 1), 2, size, 4, true),
        Rule::Majority,
        DataKind::Categorical,
    );
    assert!(header(&export(&tree, MeshFormat::Ply)).contains("property ushort value\nend_header"));
    let tree =
        dataset(&Cells::random(oct(SampleType::F32, 1), 2, size, 4, true), Rule::Mean, DataKind::Continuous);
    assert!(header(&export(&tree, MeshFormat::Ply)).contains("vertex_indices\nend_header"));
}
