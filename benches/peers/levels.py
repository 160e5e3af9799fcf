#!/usr/bin/env python3
"""Levels of detail of exact models: `spinney transform FILE levels` against meshoptimizer's
clusterlod, which makes all levels in memory, without bounds and without a file; distances that are
sampled, against the stored bounds; bytes of packed models, against the mesh, gzip and Draco; images
of a large model, and coarse surfaces of it from a web server; a city as 3D Tiles, against glTF of
cjio.

    levels.py            all jobs
    levels.py time       the torus of 5.5 million triangles; also distances, bytes, images, remote,
                         city

clusterlod is that of the crate meshoptimizer-rs, as a program in benches/peers/work. Distances need
trimesh and rtree, bytes DracoPy, the city cjio, triangle and mapbox-earcut, in the Python of
exact.py or of PYTHON. The program is target/release/spinney, or SPINNEY. One thread.
"""

import gzip
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

os.environ["RAYON_NUM_THREADS"] = "1"

from common import ROOT, SPINNEY, WORK, once, record, row, start, table  # noqa: E402
from exact import MESH, PYTHON as EXACT_PYTHON, TORUS  # noqa: E402
from remote import ours, serve  # noqa: E402

PYTHON = os.environ.get("PYTHON", EXACT_PYTHON)

MANIFEST = """[package]
name = "clusterlod"
version = "0.1.0"
edition = "2024"
[dependencies]
meshoptimizer-rs = { version = "=0.2.17", default-features = false, features = ["std", "clusterlod"] }
[workspace]
"""

PROGRAM = """use meshoptimizer_rs::{Workspace, clusterlod};

// Reads a binary PLY file of triangles, and makes all levels.
fn main() {
    let bytes = std::fs::read(std::env::args().nth(1).unwrap()).unwrap();
    let end = bytes.windows(11).position(|at| at == b"end_header\\n").unwrap() + 11;
    let head = std::str::from_utf8(&bytes[..end]).unwrap();
    let count = |name: &str| -> usize {
        let line = head.lines().find_map(|line| line.strip_prefix(&format!("element {name} ")));
        line.unwrap().parse().unwrap()
    };
    let (vertices, faces) = (count("vertex"), count("face"));
    let four = |at: usize| <[u8; 4]>::try_from(&bytes[at..at + 4]).unwrap();
    let point = |at: usize| [0, 4, 8].map(|axis| f32::from_le_bytes(four(end + 12 * at + axis)));
    let mut positions: Vec<[f32; 3]> = (0..vertices).map(point).collect();
    let from = end + 12 * vertices;
    let index = |at: usize| u32::from_le_bytes(four(from + 13 * (at / 3) + 1 + 4 * (at % 3)));
    let indices: Vec<u32> = (0..3 * faces).map(index).collect();
    let mesh = clusterlod::Mesh {
        indices: &indices,
        positions: &mut positions,
        attributes: None,
        vertex_lock: None,
        attribute_weights: &[],
        attribute_protect_mask: 0,
    };
    let config = clusterlod::default_config(128).unwrap();
    let groups = clusterlod::build(config, mesh, &mut Workspace::default()).unwrap();
    println!("{} groups", groups.len());
}
"""

# Distances both ways between a level and the exact surface at sampled points.
DISTANCES = """
import sys
import numpy as np, trimesh
exact, level = (trimesh.load(path, process=False) for path in sys.argv[1:3])
def farthest(a, b):
    points = np.concatenate([a.vertices[:5000], trimesh.sample.sample_surface(a, 5000, seed=1)[0]])
    return trimesh.proximity.closest_point(b, points)[1].max()
print(max(farthest(exact, level), farthest(level, exact)))
"""


def python(script, *words):
    command = [PYTHON, "-c", script, *words]
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True).stdout


def torus(n=2345, m=1173):
    mesh = WORK / f"torus_{2 * n * m}.ply"
    if not mesh.exists():
        python(TORUS, n, m, mesh)
    return mesh


def time():
    program = WORK / "clusterlod"
    (program / "src").mkdir(parents=True, exist_ok=True)
    (program / "Cargo.toml").write_text(MANIFEST)
    (program / "src" / "main.rs").write_text(PROGRAM)
    subprocess.run(["cargo", "build", "--release", "-q"], cwd=program, check=True)
    mesh = torus()
    model, levels = WORK / "torus.goblin", WORK / "torus_levels.goblin"
    once([SPINNEY, "-q", "build", mesh, "-o", model, "--brep"])
    ours = once([SPINNEY, "-q", "transform", model, "levels", "-o", levels, "--memory", "256MiB"])
    theirs = once([program / "target/release/clusterlod", mesh])[0]
    table(
        ["job", "ours, CPU s", "MiB", "clusterlod, s", "ratio"],
        [["levels of 5.5 million triangles", f"{ours[0]:.1f}", f"{ours[2]:.0f}", f"{theirs:.1f}", f"{ours[0] / theirs:.2f}"]],
    )
    record(
        "exact models",
        [
            row("levels of 5.5 million triangles, CPU", "s", ours[0], "clusterlod", theirs),
            row("levels of 5.5 million triangles, memory", "MiB", ours[2]),
            row("levels of 5.5 million triangles, bytes added", "MB", (levels.stat().st_size - model.stat().st_size) / 1e6),
        ],
    )


def distances():
    rows, results = [], []
    for name in ["armadillo", "bunny_hr", "fandisk"]:
        if not (MESH / f"{name}.ply").exists():
            continue
        model = WORK / f"{name}_levels.goblin"
        once([SPINNEY, "-q", "build", MESH / f"{name}.ply", "-o", model, "--brep", "--levels"])
        levels = json.loads(subprocess.run([SPINNEY, "info", model, "--json"], check=True, capture_output=True).stdout)["levels"]
        meshes = []
        for level in range(len(levels)):
            meshes.append(WORK / f"{name}_{level}.ply")
            once([SPINNEY, "-q", "export", model, meshes[-1], "--level", level])
        for level, about in enumerate(levels[:-1]):
            far = float(python(DISTANCES, meshes[-1], meshes[level]))
            rows.append([name, level, about["faces"], f"{far:.3e}", f"{about['error']:.3e}", f"{about['error'] / far:.2f}"])
    table(["mesh", "level", "faces", "distance", "bound", "bound / distance"], rows)
    if rows:
        ratios = sorted(float(found[-1]) for found in rows)
        results.append(row("bound of a level / sampled distance, median", "times", ratios[len(ratios) // 2]))
        results.append(row("bound of a level / sampled distance, least", "times", ratios[0]))
        record("exact models", results)


# Bytes of a mesh in Draco, on the grid of a model: its unit, bits and origin.
DRACO = """
import sys
import DracoPy, trimesh
path, unit, bits, *origin = sys.argv[1:]
mesh = trimesh.load(path, process=False)
side = float(unit) * 2 ** int(bits)
packed = DracoPy.encode(
    mesh.vertices,
    mesh.faces,
    quantization_bits=int(bits),
    quantization_range=side,
    quantization_origin=[float(at) for at in origin],
    compression_level=10,
)
print(len(packed))
"""


def bytes_of_models():
    """Draco packs faces and vertices, on the same grid of 23 bits; we pack an octree as well."""
    mesh = MESH / "armadillo.ply"
    if not mesh.exists():
        return
    sizes = {"PLY": mesh.stat().st_size, "gzip -9": len(gzip.compress(mesh.read_bytes(), 9))}
    exact, levels = WORK / "packed.goblin", WORK / "packed_levels.goblin"
    for out, options in [(exact, []), (levels, ["--levels"])]:
        once([SPINNEY, "-q", "build", mesh, "-o", out, "--brep", "--codec", "packed", *options])
    grid = json.loads(subprocess.run([SPINNEY, "info", exact, "--json"], check=True, capture_output=True).stdout)["grid"]
    origin = [at * grid["step"] for at in grid["origin"]]
    sizes["Draco"] = int(python(DRACO, mesh, grid["step"], grid["bits"], *origin))
    ours = {"exact": exact.stat().st_size, "with levels": levels.stat().st_size}
    table(["armadillo", "bytes"], [[name, str(size)] for name, size in [*sizes.items(), *ours.items()]])
    rows = [row(f"packed armadillo, exact, against {name}", "MB", ours["exact"] / 1e6, name, size / 1e6) for name, size in sizes.items()]
    record("exact models", [*rows, row("packed armadillo, with levels", "MB", ours["with levels"] / 1e6)])


def large():
    """The torus of 24 million triangles, with levels."""
    model = WORK / "torus_24.goblin"
    if not model.exists():
        once([SPINNEY, "-q", "build", torus(4900, 2450), "-o", model, "--brep", "--levels"])
    return model


def images():
    """Images of a torus of 24 million triangles, at the level that pixels need."""
    image = WORK / "torus_24.png"
    found = once([SPINNEY, "-q", "render", large(), image, "--size", "1024x768"])
    table(["job", "CPU s", "MiB"], [["image of 24 million triangles", f"{found[0]:.2f}", f"{found[2]:.0f}"]])
    record(
        "exact models",
        [
            row("image of 24 million triangles, CPU", "s", found[0]),
            row("image of 24 million triangles, memory", "MiB", found[2]),
        ],
    )


def remote():
    """A coarse whole of a file of 0.8 GB on a server with a latency of 50 ms per response."""
    model, out = large(), WORK / "coarse.ply"
    with serve(WORK, 0.05) as server:
        seconds, _, [batches, requests, size] = ours("export", f"{server.url}/{model.name}", out, "--faces", "16000")
    table(["job", "s", "batches", "requests", "MB"], [["16,000 faces of 24 million", f"{seconds:.2f}", str(batches), str(requests), f"{size / 1e6:.2f}"]])
    name = "at most 16,000 faces of 24 million, from a server"
    record("exact models", [row(f"{name}, batches", "", batches), row(f"{name}, bytes", "MB", size / 1e6)])


def city():
    """853 buildings, closed and repaired: tiles of our model, and glTF of the same buildings."""
    source = ROOT.parent / "shared" / "data" / "hostile" / "mesh" / "DELFSHAVEN.city.json"
    if not source.exists():
        return
    model, tiles, glb = WORK / "city.goblin", WORK / "city_tiles", WORK / "city.glb"
    built = once([SPINNEY, "-q", "build", source, "-o", model, "--brep", "--close", "--repair", "--levels"])
    shutil.rmtree(tiles, ignore_errors=True)
    mine = once([SPINNEY, "-q", "export", model, tiles / "tileset.json"])
    glb.unlink(missing_ok=True)
    theirs = once([Path(PYTHON).parent / "cjio", source, "export", "glb", glb])
    assert glb.exists(), "cjio wrote no glTF"
    table(
        ["job", "build, CPU s", "tiles, CPU s", "cjio to glb, CPU s", "ratio"],
        [["city of 853 buildings", f"{built[0]:.2f}", f"{mine[0]:.2f}", f"{theirs[0]:.1f}", f"{(built[0] + mine[0]) / theirs[0]:.3f}"]],
    )
    record("exact models", [row("city of 853 buildings to 3D Tiles, with building, CPU", "s", built[0] + mine[0], "cjio, to glTF", theirs[0])])


if __name__ == "__main__":
    start(data=False, peer="cargo")
    jobs = {"time": time, "distances": distances, "bytes": bytes_of_models, "images": images, "remote": remote, "city": city}
    for name in sys.argv[1:] or jobs:
        jobs[name]()
