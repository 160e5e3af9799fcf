//! Memory of operations on exact models whose faces exceed the limit, measured in the program.

use std::path::Path;
use std::process::Command;

use crate::common::command::{complaint, peak_memory, stdout};

/// Allowance in bytes for the program, thread stacks and allocator overhead. (On a loaded machine
/// 32 MiB was once too little by less than one.)
const ALLOWANCE: u64 = 36 << 20;

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

/// A repair holds the faces in memory, and reports insufficient memory before it splits any.
#[test]
fn repairs_without_memory_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let [mesh, model] = ["a.ply", "a.goblin"].map(|name| directory.path().join(name));
    torus(&mesh, [0.0; 3]);
    let words = ["build", text(&mesh), "-qo", text(&model), "--brep", "--snap", "0.0001", "--repair"];
    let said = complaint(&[&words[..], &["--memory", "64M"]].concat(), 1);
    assert!(said.contains("the list of faces to repair") && said.contains("--memory"), "{said}");
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
    #[cfg(target_os = "linux")]
    {
        let mut command = Command::new(env!("CARGO_BIN_EXE_spinney"));
        let peak = peak_memory(&mut command.args(words).args(["--memory", "192M"]).spawn().unwrap());
        assert!(peak < (192 << 20) + ALLOWANCE, "{} MiB", peak >> 20);
    }
}
