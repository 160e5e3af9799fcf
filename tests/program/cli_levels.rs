//! Levels of detail of exact models on the command line.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde_json::Value as Json;

use crate::common::command::{command, complaint, spinney, stderr, stdout};
use crate::common::directory::TestDirectory;

const BALL: &str = "fixtures/v1/ball.goblin";
const RASTER: &str = "fixtures/v1/classic.goblin";

/// A torus of 2nm triangles with bumps.
pub(crate) fn bumpy_torus(n: u32, m: u32) -> String {
    let mut text = String::from("o torus\n");
    for i in 0..n {
        for j in 0..m {
            let [u, v] =
                [(i, n), (j, m)].map(|(at, of)| f64::from(at) / f64::from(of) * std::f64::consts::TAU);
            let r = 1.0 + 0.05 * (12.0 * u).sin() * (7.0 * v).cos();
            let wide = 3.0 + r * v.cos();
            let [x, y, z] = [wide * u.cos(), wide * u.sin(), r * v.sin()];
            writeln!(text, "v {x:.4} {y:.4} {z:.4}").unwrap();
        }
    }
    let at = |i: u32, j: u32| 1 + i % n * m + j % m;
    for i in 0..n {
        for j in 0..m {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}").unwrap();
        }
    }
    text
}

const RASTERIZED: &str = "raster=mean,cell=200";
const BREP: [&str; 3] = ["--brep", "--snap", "0.001"];

/// Returns a directory with a mesh `torus.obj`, and exact models of it with and without levels.
fn models() -> (TestDirectory, String, String) {
    let directory = TestDirectory::new();
    let mesh = directory.write("torus.obj", bumpy_torus(60, 40));
    let plain = directory.built(&mesh, "plain.goblin", &BREP);
    let levels = directory.built(&mesh, "levels.goblin", &[&BREP[..], &["--levels"]].concat());
    (directory, plain, levels)
}

fn info(file: &str) -> Json {
    serde_json::from_str(&stdout(&["info", "--json", file])).unwrap()
}

fn levels_of(file: &str) -> Vec<Json> {
    info(file)["levels"].as_array().unwrap().clone()
}

/// Returns the number of faces that a PLY file declares.
fn faces_of(mesh: &str) -> u64 {
    let bytes = fs::read(mesh).unwrap();
    let header = String::from_utf8_lossy(&bytes[..bytes.len().min(2000)]).into_owned();
    let line = header.lines().find_map(|line| line.strip_prefix("element face ")).expect("a PLY header");
    line.parse().unwrap()
}

/// Returns the error that an export reports; `None` if it reports none.
fn error_of(message: &str) -> Option<f64> {
    let line = message.lines().find_map(|line| line.strip_prefix("error"))?;
    line.trim().strip_prefix("at most ")?.split(' ').next()?.parse().ok()
}

#[test]
fn builds_and_transforms_add_the_same_levels() {
    let (directory, plain, levels) = models();
    let later = directory.name("later.goblin");
    let message = stderr(spinney(&["transform", &plain, "levels", "-o", &later]).success());
    let found = levels_of(&levels);
    assert!(found.len() > 2, "{found:?}");
    assert_eq!(levels_of(&later), found);
    assert_eq!(levels_of(&plain), Vec::<Json>::new());
    let text = |file: &str| stdout(&["info", file]);
    assert!(!text(&plain).contains("\n  levels "));
    for (number, level) in found.iter().enumerate() {
        let line = format!("{number}: {} faces, at most", level["faces"]);
        let is_exact = number + 1 == found.len();
        assert_eq!(text(&levels).contains(&line), !is_exact, "{line}");
        assert_eq!(message.contains(&format!("level {number}")), !is_exact, "{message}");
        if is_exact {
            assert_eq!((level["error"].as_f64(), &level["faces"]), (Some(0.0), &info(&plain)["faces"]));
            assert!(text(&levels).contains(&format!("{number}: the exact surface")));
        } else {
            let next = &found[number + 1];
            assert!(level["faces"].as_u64() < next["faces"].as_u64());
            assert!(level["error"].as_f64() > next["error"].as_f64());
            assert!(level["bytes"].as_u64() > Some(0));
        }
    }
    // Exact queries have the same results with levels, which are replaced by a second run.
    let of = |file: &str| stdout(&["stats", file]);
    assert_eq!(of(&levels), of(&plain));
    let again = directory.name("again.goblin");
    spinney(&["transform", "-q", &levels, "levels", "-o", &again]).success().stderr("");
    assert!(fs::read(&again).unwrap() == fs::read(&later).unwrap());
    let packed = directory.name("packed.goblin");
    spinney(&["transform", "-q", &plain, "levels", "-o", &packed, "--codec", "packed"]).success().stderr("");
    let of_packed = info(&packed);
    assert_eq!(of_packed["codec"], "packed");
    assert!(of_packed["bytes"].as_u64().unwrap() * 2 < info(&levels)["bytes"].as_u64().unwrap());
    let counts = |levels: &[Json]| levels.iter().map(|level| level["faces"].clone()).collect::<Vec<_>>();
    assert_eq!(counts(&levels_of(&packed)), counts(&found));
    for file in [&levels, &later, &again, &packed] {
        spinney(&["verify", "-q", file]).success();
    }
}

#[test]
fn exports_have_a_level_an_error_or_a_number_of_faces() {
    let (directory, plain, levels) = models();
    let found = levels_of(&levels);
    let out = directory.name("out.ply");
    let export = |options: &[&str]| {
        let _ = fs::remove_file(&out);
        let message = stderr(spinney(&[&["export", &levels, &out], options].concat()).success());
        (faces_of(&out), error_of(&message))
    };
    let exact = export(&[]);
    assert_eq!(exact, (4800, None));
    let size = fs::metadata(&out).unwrap().len();
    for (number, level) in found.iter().enumerate() {
        let (faces, error) = export(&["--level", &number.to_string()]);
        assert_eq!(Some(faces), level["faces"].as_u64(), "level {number}");
        let expected = level["error"].as_f64().unwrap();
        // (It is shown with four digits.)
        assert!((error.unwrap_or(0.0) - expected).abs() <= 1e-3 * expected, "{error:?} {expected}");
    }
    // The last level has the exact faces, in another order.
    assert_eq!(fs::metadata(&out).unwrap().len(), size);
    let mut last = u64::MAX;
    for limit in [0.0, 0.003, 0.02, 0.1, 10.0] {
        let (faces, error) = export(&["--error", &limit.to_string()]);
        assert!(error.unwrap_or(0.0) <= limit && faces <= last, "{limit}: {faces} faces, {error:?}");
        last = faces;
    }
    assert_eq!(Some(last), found[0]["faces"].as_u64());
    for limit in [400, 1000, 3000, 5000] {
        let (faces, _) = export(&["--faces", &limit.to_string()]);
        assert!(faces <= limit && faces * 8 >= limit.min(4800), "{limit}: {faces} faces");
    }
    // Other formats, and a coarse mesh as a model of its own.
    for name in ["out.obj", "out.stl", "out.off", "out.glb", "out.city.json"] {
        spinney(&["export", "-q", &levels, &directory.name(name), "--faces", "1000"]).success();
    }
    for name in ["out.obj", "out.glb"] {
        let coarse = directory.name("coarse.goblin");
        spinney(&["build", "-q", &directory.name(name), "-o", &coarse, "--brep"]).success();
        assert!(info(&coarse)["faces"].as_u64() <= Some(1000), "{name}");
        let [volume_of, exact] = [&coarse, &plain].map(|file| volume(file));
        fs::remove_file(&coarse).unwrap();
        assert!((volume_of - exact).abs() < 0.05 * exact, "{name}: {volume_of}, {exact}");
    }
    // Views move coarse surfaces and scale their errors.
    let (twice, error) = export(&["--error", "0.2", "--view", "scale=2"]);
    let (once, half) = export(&["--error", "0.1"]);
    assert!(twice == once && (error.unwrap() - 2.0 * half.unwrap()).abs() < 1e-3, "{error:?} {half:?}");
    // Standard output.
    let piped = spinney(&["export", "-q", &levels, "-", "--format", "ply", "--level", "1"]).success();
    export(&["--level", "1"]);
    assert!(piped.get_output().stdout == fs::read(&out).unwrap());
}

fn volume(file: &str) -> f64 {
    let text = stdout(&["stats", file]);
    let line = text.lines().find_map(|line| line.trim().strip_prefix("volume")).expect("a volume");
    line.split_whitespace().next().unwrap().parse().unwrap()
}

/// Faces in a window, of the exact surface and of a coarse one.
#[test]
fn windows_have_all_faces_that_meet_them() {
    let (directory, plain, levels) = models();
    let (part, all) = (directory.name("part.obj"), directory.name("all.obj"));
    let window = ["--window", "2.5,-1,0.1,5,1.25,0.75"];
    let (low, high) = ([2.5, -1.0, 0.1], [5.0, 1.25, 0.75]);
    for (file, detail) in [(&plain, &[][..]), (&levels, &[]), (&levels, &["--level", "0"])] {
        command(&["get", "-q", file, &part]).args(window).args(detail).assert().success();
        command(&["export", "-q", file, &all]).args(detail).assert().success();
        let [part, all] = [&part, &all].map(|path| triangles_of(Path::new(path)));
        // (A coarse surface of so few faces has few clusters.)
        assert!(part.iter().all(|face| all.contains(face)));
        assert!(part.len() < all.len() || !detail.is_empty());
        // (A vertex in the window is a point of the face in it.)
        let is_inside = |at: &[f64; 3]| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&at[axis]));
        let inside: Vec<_> = all.iter().filter(|face| face.iter().any(is_inside)).collect();
        assert!(inside.len() > 3 && inside.iter().all(|face| part.contains(face)), "{detail:?}");
        // Of the exact surface there are only faces whose boxes touch the window.
        let touches = |face: &[[f64; 3]; 3]| {
            (0..3).all(|axis| {
                let [least, most] =
                    [f64::min, f64::max].map(|of| face.iter().map(|at| at[axis]).reduce(of).unwrap());
                least <= high[axis] && most >= low[axis]
            })
        };
        assert!(!detail.is_empty() || part.iter().all(touches));
    }
    let empty = stderr(spinney(&["get", &levels, &part, "--window", "50,50,50,60,60,60"]).success());
    assert!(empty.contains("has no faces"), "{empty}");
    for (options, expected) in [
        (&["--window", "1,1,1,0,2,2"][..], "expected minimum coordinates"),
        (&["--window", "0,0,0,1,1,1", "--in", "lonlat"], "expected world"),
        (&["--window", "0,0,0,1,1,1", "--size", "10"], "--size"),
        (&["--in", "world"], "--in: works only with --window"),
    ] {
        let text = complaint(&[&["get", &levels, &part], options].concat(), 1);
        assert!(text.contains(expected), "{text}");
    }
    let text = complaint(&["get", &levels, &directory.name("x.png")], 1);
    assert!(text.contains("has no cells") && text.contains("FACES.ply --window"), "{text}");
    let tiles = directory.name("tiles/tileset.json");
    let text = complaint(&["export", &levels, &tiles, "--window", "0,0,0,1,1,1"], 1);
    assert!(text.contains("meshes of exact models"), "{text}");
    let text = complaint(&["export", BALL, &part, "--window", "0,0,0,1,1,1"], 1);
    assert!(text.contains("--view window="), "{text}");
}

/// Returns the triangles of an OBJ file.
fn triangles_of(path: &Path) -> Vec<[[f64; 3]; 3]> {
    let text = fs::read_to_string(path).unwrap();
    let lines = |kind: &'static str| {
        text.lines().filter_map(move |line| line.strip_prefix(kind)).map(|line| line.split_whitespace())
    };
    let points: Vec<[f64; 3]> = lines("v ")
        .map(|words| {
            words.take(3).map(|word| word.parse().unwrap()).collect::<Vec<f64>>().try_into().unwrap()
        })
        .collect();
    let corner = |word: &str| points[word.split('/').next().unwrap().parse::<usize>().unwrap() - 1];
    lines("f ").map(|words| words.map(corner).collect::<Vec<_>>().try_into().unwrap()).collect()
}

#[test]
fn refusals_name_what_works() {
    let (directory, plain, levels) = models();
    let out = directory.name("out.ply");
    let tiles = directory.name("tiles/tileset.json");
    let points = directory.built("fixtures/island_points.laz", "points.goblin", &[]);
    let features = directory.write("points.csv", "x,y,a\n1,2,3\n4,5,6\n");
    let copy = directory.name("out.csv");
    let count = directory.files().len();
    let model = directory.name("out.goblin");
    let last = levels_of(&levels).len() - 1;
    let beyond = (last + 1).to_string();
    let refusals: [(&[&str], i32, &[&str]); 19] = [
        (&["export", &levels, &out, "--level", "1", "--error", "1"], 2, &["--level", "--error"]),
        (&["export", &levels, &out, "--level", "1", "--faces", "900"], 2, &["--level", "--faces"]),
        (&["export", &levels, &out, "--faces", "900", "--error", "1"], 2, &["--faces", "--error"]),
        (&["export", &levels, &out, "--level", &beyond], 1, &["level", &last.to_string()]),
        (&["export", &levels, &out, "--error=-1"], 1, &["error: got -1"]),
        (&["export", &levels, &out, "--faces", "5"], 1, &["faces: got 5", "at least"]),
        (&["export", BALL, &out, "--error", "1"], 1, &["--error", "exact models"]),
        (&["export", BALL, &out, "--faces", "100"], 1, &["--faces", "exact models"]),
        (&["export", RASTER, &out, "--error", "1"], 1, &["--error", "exact models"]),
        (&["export", RASTER, &out, "--tin", "1", "--error", "1"], 1, &["--error"]),
        (&["export", &levels, &tiles, "--level", "1"], 1, &["--level"]),
        (&["export", &levels, &out, "--smooth"], 1, &["--smooth"]),
        (&["transform", &plain, "levels", "rotate=90", "-o", &model], 1, &["levels", "last"]),
        (&["transform", BALL, "levels", "-o", &model], 1, &["ball.goblin", "not an exact model"]),
        (&["transform", &points, "levels", "-o", &model], 1, &["points"]),
        (&["transform", &points, RASTERIZED, "levels", "-o", &model], 1, &["levels", "exact model"]),
        (&["transform", &plain, RASTERIZED, "-o", &model], 1, &["raster=", "trees of points"]),
        (&["transform", &features, "crs=EPSG:3857", "levels", "-o", &copy], 1, &["levels", "exact model"]),
        (&["build", RASTER, "-o", &model, "--levels"], 2, &["--brep"]),
    ];
    for (arguments, code, words) in refusals {
        let text = complaint(arguments, code);
        assert!(words.iter().all(|word| text.contains(word)), "{arguments:?}: {text}");
        assert_eq!(directory.files().len(), count, "{arguments:?}: {:?}", directory.files());
    }
    // The advice works.
    for option in [["--level", "0"], ["--error", "1"], ["--faces", "1000"]] {
        let text = complaint(&[&["export", &plain, &out][..], &option].concat(), 1);
        assert!(text.contains("without levels of detail") && !Path::new(&out).exists(), "{text}");
        let advice = text.split('`').nth(1).expect("a command in the message");
        let advised: Vec<&str> = advice
            .split(' ')
            .skip(1)
            .map(|word| match word {
                "FILE" => &plain,
                "OUTPUT" | "OUT" => &model,
                word => word,
            })
            .collect();
        spinney(&advised).success();
        spinney(&[&["export", "-q", &model, &out][..], &option].concat()).success();
        [&out, &model].into_iter().for_each(|file| fs::remove_file(file).unwrap());
    }
}

/// Operations before `levels` are applied first, as if in two runs.
#[test]
fn operations_precede_levels() {
    let (directory, plain, _) = models();
    let [both, turned, later] = ["both.goblin", "turned.goblin", "later.goblin"].map(|at| directory.name(at));
    let turn = ["rotate=90,x", "translate=1,0,0.5"];
    spinney(&["transform", "-q", &plain, turn[0], turn[1], "levels", "-o", &both]).success().stderr("");
    spinney(&["transform", "-q", &plain, turn[0], turn[1], "-o", &turned]).success();
    spinney(&["transform", "-q", &turned, "levels", "-o", &later]).success();
    assert!(levels_of(&both).len() > 2);
    assert_eq!(levels_of(&both), levels_of(&later));
    assert!(fs::read(&both).unwrap() == fs::read(&later).unwrap());
    assert_eq!(levels_of(&turned), Vec::<Json>::new());
    spinney(&["verify", "-q", &both]).success();
    // A new grid and a unit.
    let fine = directory.name("fine.goblin");
    let options = ["rotate=30,1,1,0", "levels", "-o", &fine, "--snap", "0.0001", "--unit", "mm"];
    spinney(&[&["transform", "-q", &plain], &options[..]].concat()).success().stderr("");
    assert!(levels_of(&fine).len() > 2);
    assert!(stdout(&["info", &fine]).contains(" mm off"));
    assert!((volume(&fine) - volume(&plain)).abs() < 1e-3 * volume(&plain));
}

#[test]
fn corrupt_levels_are_found_and_leave_the_exact_surface() {
    let (directory, plain, levels) = models();
    let bytes = fs::read(&levels).unwrap();
    let first = fs::metadata(&plain).unwrap().len() as usize;
    let [exact, out] = ["exact.ply", "out.ply"].map(|at| directory.name(at));
    spinney(&["export", "-q", &plain, &exact]).success();
    let mut reported = 0;
    for at in (first..bytes.len() - 3000).step_by((bytes.len() - 3000 - first) / 12) {
        let mut corrupt = bytes.clone();
        corrupt[at] ^= 0x10;
        let file = directory.write("corrupt.goblin", corrupt);
        let verified = command(&["verify", &file]).assert();
        if verified.get_output().status.success() {
            continue;
        }
        reported += 1;
        let text = stderr(verified);
        assert!(!text.contains("panicked"), "{text}");
        spinney(&["export", "-q", &file, &out]).success();
        assert!(fs::read(&out).unwrap() == fs::read(&exact).unwrap(), "byte {at}");
        fs::remove_file(&out).unwrap();
        // A level that cannot be read leaves no file.
        for level in ["0", "1"] {
            let assert = command(&["export", &file, &out, "--level", level]).assert();
            let is_done = assert.get_output().status.success();
            assert_eq!(Path::new(&out).exists(), is_done, "byte {at}");
            let text = stderr(assert);
            assert!(is_done || text.contains("corrupt") && !text.contains("panicked"), "byte {at}: {text}");
            let _ = fs::remove_file(&out);
        }
    }
    assert!(reported > 6, "{reported}");
}

/// Files that exceed a limit of the shell leave nothing, and neither do signals.
#[cfg(unix)]
#[test]
fn full_disks_and_signals_leave_no_files() {
    use crate::common::command::interruptible;
    const PROGRAM: &str = env!("CARGO_BIN_EXE_spinney");
    let (_directory, plain, levels) = models();
    let out = TestDirectory::new();
    let [model, glb, tiles] = ["out.goblin", "out.glb", "tiles/tileset.json"].map(|at| out.name(at));
    let commands: [&[&str]; 3] = [
        &["transform", &plain, "levels", "-o", &model],
        &["export", &levels, &glb, "--error", "0.001"],
        &["export", &levels, &tiles],
    ];
    for arguments in commands {
        // (A block has 512 or 1024 bytes.)
        let output = std::process::Command::new("sh")
            .args(["-c", "trap '' XFSZ; ulimit -f 32; exec \"$@\"", "sh", PROGRAM])
            .args(arguments)
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && !text.contains("panicked"), "{arguments:?}: {text}");
        assert_eq!(out.files(), Vec::<String>::new(), "{arguments:?}: {text}");
    }
    let text = complaint(&["transform", &plain, "levels", "-o", &model, "--max-bytes", "20K"], 1);
    assert!(text.contains("--max-bytes") && out.files().is_empty(), "{text} {:?}", out.files());
    if interruptible(PROGRAM).is_none() {
        return;
    }
    let mut interrupted = 0;
    for wait in [1, 5, 20, 60, 120, 250, 400, 700] {
        let mut program = interruptible(PROGRAM).unwrap();
        program.args(["transform", "-q", &plain, "levels", "-o", &model]);
        let mut child = program.spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(wait));
        let pid = rustix::process::Pid::from_child(&child);
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::INT);
        let status = child.wait().unwrap();
        interrupted += u32::from(!status.success());
        assert_eq!(out.path("out.goblin").exists(), status.success(), "after {wait} ms");
        let _ = fs::remove_file(&model);
        assert_eq!(out.files(), Vec::<String>::new(), "after {wait} ms");
    }
    assert!(interrupted > 0);
}
