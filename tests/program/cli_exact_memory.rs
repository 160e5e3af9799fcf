//! Memory of operations on exact models whose faces exceed the limit, measured in the program.

use std::path::Path;
use std::process::Command;

use crate::common::command::{complaint, peak_memory, stdout};

/// Allowance in bytes for the program, thread stacks and allocator overhead. (On a loaded machine
/// 32 MiB was once too little by less than one. The program of the tests is not optimised: its
/// own pages take most of this.)
const ALLOWANCE: u64 = 40 << 20;

/// The sort buffers of an export, which has no memory option.
const SORTS: u64 = 128 << 20;

/// Segments around the torus, and around its tube: 302,642 triangles, which take more than 60 MB in
/// memory.
const SIDE: i32 = 389;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Writes a translated torus as a PLY file.
fn torus(path: &Path, [x, y, z]: [f64; 3]) {
    let count = SIDE * SIDE;
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        2 * count
    )
    .into_bytes();
    let steps = || (0..SIDE).flat_map(|i| (0..SIDE).map(move |j| (i, j)));
    for (i, j) in steps() {
        let [u, v] = [i, j].map(|step| f64::from(step) * std::f64::consts::TAU / f64::from(SIDE));
        let radius = 300.0 + 100.0 * v.cos();
        let at = [radius * u.cos() + x, radius * u.sin() + y, 100.0 * v.sin() + z];
        bytes.extend(at.into_iter().flat_map(f64::to_le_bytes));
    }
    let corner = |i: i32, j: i32| i % SIDE * SIDE + j % SIDE;
    for (i, j) in steps() {
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        for corners in [[a, b, c], [a, c, d]] {
            bytes.push(3);
            bytes.extend(corners.into_iter().flat_map(i32::to_le_bytes));
        }
    }
    std::fs::write(path, bytes).unwrap();
}

#[test]
#[cfg(target_os = "linux")]
fn memory_of_exact_models_stays_within_its_budget() {
    let directory = tempfile::tempdir().unwrap();
    torus(&directory.path().join("a.ply"), [0.0; 3]);
    torus(&directory.path().join("b.ply"), [780.0, 3.0, 1.0]);
    let jobs: [(&[&str], u64); 7] = [
        (&["build", "a.ply", "-o", "a.goblin", "--brep", "--snap", "0.0001", "--memory", "16M"], 16 << 20),
        (&["build", "b.ply", "-o", "b.goblin", "--brep", "--snap", "0.0001", "--memory", "16M"], 16 << 20),
        (&["combine", "or", "a.goblin", "b.goblin", "-o", "or.goblin", "--memory", "16M"], 16 << 20),
        (&["transform", "a.goblin", "rotate=30,1,1,0", "-o", "turned.goblin", "--memory", "16M"], 16 << 20),
        (&["section", "a.goblin", "b.goblin", "-o", "seams.csv", "--memory", "16M"], 16 << 20),
        (&["section", "a.goblin", "z=-99..99/9", "-o", "slices.csv"], 16 << 20),
        (&["export", "a.goblin", "out.ply"], SORTS),
    ];
    for (job, memory) in jobs {
        let mut command = Command::new(env!("CARGO_BIN_EXE_spinney"));
        // Model files are small, and mapped pages would count.
        command.args(job).args(["-q", "--positioned"]).current_dir(directory.path());
        let peak = peak_memory(&mut command.spawn().unwrap());
        assert!(peak > 0 && peak < memory + ALLOWANCE, "{} MiB for {job:?}", peak >> 20);
    }
    let volume = |name: &str| {
        let stats = stdout(&["stats", "--json", text(&directory.path().join(name))]);
        serde_json::from_str::<serde_json::Value>(&stats).unwrap()["volume"].as_f64().unwrap()
    };
    let (a, b, both) = (volume("a.goblin"), volume("b.goblin"), volume("or.goblin"));
    assert!(both > a && both < 0.9999 * (a + b), "{a}, {b}, {both}");
}

/// Removes every 9001st triangle of a PLY file, and reverses every 7001st.
fn corrupt(path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    let head = 11 + bytes.windows(11).position(|word| word == b"end_header\n").unwrap();
    let start = head + 24 * (SIDE * SIDE) as usize;
    let mut faces: Vec<[u8; 13]> = bytes[start..].chunks(13).map(|face| face.try_into().unwrap()).collect();
    for face in faces.iter_mut().step_by(7001) {
        face[1..9].rotate_left(4);
    }
    let kept: Vec<u8> = faces
        .iter()
        .enumerate()
        .filter(|(number, _)| number % 9001 != 17)
        .flat_map(|(_, face)| *face)
        .collect();
    let text = String::from_utf8(bytes[..head].to_vec()).unwrap();
    let text = text.replace(&format!("face {}", 2 * SIDE * SIDE), &format!("face {}", kept.len() / 13));
    std::fs::write(path, [text.as_bytes(), &bytes[head..start], &kept].concat()).unwrap();
}

/// A repair that exceeds the memory streams the faces that meet no other.
#[test]
fn repairs_stay_within_their_memory() {
    let directory = tempfile::tempdir().unwrap();
    let mesh = directory.path().join("a.ply");
    torus(&mesh, [0.0; 3]);
    corrupt(&mesh);
    let mut found = Vec::new();
    for (name, memory) in [("small.goblin", 32u64), ("large.goblin", 512)] {
        let model = directory.path().join(name);
        let limit = format!("{memory}M");
        let words =
            ["build", text(&mesh), "-qo", text(&model), "--brep", "--snap", "0.0001", "--repair", "--close"];
        let mut command = Command::new(env!("CARGO_BIN_EXE_spinney"));
        let mut child = command.args(words).args(["--memory", &limit]).spawn().unwrap();
        #[cfg(target_os = "linux")]
        {
            let peak = peak_memory(&mut child);
            assert!(peak < (memory << 20) + ALLOWANCE, "{} MiB of {memory}", peak >> 20);
        }
        assert!(child.wait().unwrap().success());
        let facts: serde_json::Value =
            serde_json::from_str(&stdout(&["stats", "--json", text(&model)])).unwrap();
        found.push((facts["volume"].clone(), facts["topology"].clone()));
    }
    assert_eq!(found[0], found[1]);
    // (Faces without area could not be held in memory with less.)
    let words =
        ["build", text(&mesh), "-qo", "none.goblin", "--brep", "--repair", "--close", "--memory", "2M"];
    let said = complaint(&words, 1);
    assert!(said.contains("--memory"), "{said}");
}
