#!/usr/bin/env python3
"""Exact models: `spinney build --brep` against reading into manifold3d, octrees of cells, points
against trimesh and libigl, volumes, repair against libigl's exact union.

    exact.py             all, building from 200,000 triangles
    exact.py --large     building from 12.8 million, too
    exact.py points      that alone; also building, volumes, octrees, repair

The peers are installed into a virtual environment in benches/peers/work; unavailable ones are
skipped with a message. The program is target/release/spinney, or SPINNEY. Meshes are those of
../shared/data/mesh, if it exists, and some generated ones. One thread.
"""

import json
import math
import os
import subprocess
import sys

os.environ["RAYON_NUM_THREADS"] = "1"

from common import ROOT, SPINNEY, WORK, costs, once, record, row, start, table  # noqa: E402

MESH = ROOT.parent / "shared" / "data" / "mesh"
VENV = WORK / "exact"
PYTHON = VENV / "bin" / "python"
POINTS = 1_000_000

# A bumpy torus of 2nm triangles. NumPy runs in separate processes, so that it does not count in the
# peak memory of others.
TORUS = """
import sys
import numpy as np
n, m, path = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
u, v = np.arange(n) / n * 2 * np.pi, np.arange(m) / m * 2 * np.pi
u, v = np.meshgrid(u, v, indexing='ij')
r = 1 + 0.05 * np.sin(40 * u) * np.cos(25 * v)
points = np.stack([(3 + r * np.cos(v)) * np.cos(u), (3 + r * np.cos(v)) * np.sin(u), r * np.sin(v)], -1).reshape(-1, 3).astype('<f4')
i, j = np.arange(n)[:, None], np.arange(m)[None, :]
a, b, c, d = (x % n * m + y % m for x, y in [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)])
# Neighbours stay together.
faces = np.stack([np.stack(t, -1).reshape(-1, 3) for t in [(a, b, c), (a, c, d)]], 1).reshape(-1, 3)
rows = np.zeros(len(faces), [('n', 'u1'), ('v', '<i4', 3)])
rows['n'], rows['v'] = 3, faces
with open(path, 'wb') as out:
    out.write(('ply\\nformat binary_little_endian 1.0\\nelement vertex %d\\nproperty float x\\nproperty float y\\nproperty float z\\n'
               'element face %d\\nproperty list uchar int vertex_indices\\nend_header\\n' % (len(points), len(faces))).encode())
    out.write(points.tobytes())
    out.write(rows.tobytes())
"""

# Reads a PLY file of triangles like the one above, or as `spinney export` writes it.
READ = """
import sys
import numpy as np
def read(path):
    data = np.memmap(path, 'u1')
    head = bytes(data[:2000])
    end = head.index(b'end_header\\n') + 11
    count = lambda name: int(next(line for line in head.split(b'\\n') if line.startswith(b'element ' + name)).split()[2])
    kind = 'f8' if b'property double x' in head else '<f4'
    vertices, faces = count(b'vertex'), count(b'face')
    points = np.frombuffer(data, kind, 3 * vertices, end).reshape(-1, 3)
    index = '<u4' if b'list uchar uint' in head else '<i4'
    rows = np.frombuffer(data, [('n', 'u1'), ('v', index, 3)], faces, end + points.nbytes)
    assert (rows['n'] == 3).all() and end + points.nbytes + rows.nbytes == len(data)
    return points, rows['v']
"""

MANIFOLD = (
    READ
    + """
from manifold3d import Manifold, Mesh
points, faces = read(sys.argv[1])
body = Manifold(Mesh(vert_properties=points.astype('f4'), tri_verts=faces.astype('u4')))
print(body.status(), body.num_tri(), 'triangles')
"""
)

# Random points in and around the bounds of a mesh: as text, and as numbers for the others.
SCATTER = (
    READ
    + """
points, _ = read(sys.argv[1])
found = np.random.default_rng(1).uniform(points.min(0), points.max(0), (int(sys.argv[2]), 3))
np.save(sys.argv[3], found)
with open(sys.argv[4], 'w') as out:
    out.writelines('%r,%r,%r\\n' % tuple(point) for point in found.tolist())
"""
)

# Containment of points by one of the peers: its processor seconds, and the number of results that
# differ from ours.
CONTAINS = (
    READ
    + """
import os, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
peer, count = sys.argv[1], int(sys.argv[5])
points, faces = read(sys.argv[2])
where = np.load(sys.argv[3])[:count]
ours = np.array(open(sys.argv[4]).read().split())[:count]
points, faces = points.astype('f8'), faces.astype('i8')
if peer == 'trimesh':
    import trimesh, embreex
    mesh = trimesh.Trimesh(points, faces, process=False)
    assert 'pyembree' in type(mesh.ray).__module__, type(mesh.ray)
    call = lambda where: mesh.ray.contains_points(where)
elif peer == 'fast':
    import igl
    call = lambda where: igl.fast_winding_number(points, faces, where) > 0.5
else:
    import igl
    call = lambda where: igl.winding_number(points, faces, where) > 0.5
if peer == 'trimesh':
    call(where[:100])
began = time.process_time()
found = np.asarray(call(where)).ravel()
seconds = time.process_time() - began
print(seconds, int((found != (ours == 'inside'))[ours != 'boundary'].sum()), int((ours == 'boundary').sum()))
"""
)

# The volume in rational numbers, rounded once.
VOLUME = (
    READ
    + """
from fractions import Fraction
points, faces = read(sys.argv[1])
# (Doubles are integer multiples of some power of two.)
scale = 2 ** 80
whole = [[int(Fraction(at) * scale) for at in point] for point in points.tolist()]
assert all(Fraction(w, scale) == Fraction(at) for p, q in zip(whole, points.tolist()) for w, at in zip(p, q))
total = 0
for a, b, c in faces.tolist():
    p, q, r = whole[a], whole[b], whole[c]
    total += p[0] * (q[1] * r[2] - q[2] * r[1]) + p[1] * (q[2] * r[0] - q[0] * r[2]) + p[2] * (q[0] * r[1] - q[1] * r[0])
print(repr(float(Fraction(total, 6 * scale ** 3))))
"""
)


# The region with a winding number of at least 1, by libigl's union with an empty mesh, in exact
# arithmetic: CPU seconds without reading, faces and volume.
UNION = """
import sys, time
import numpy as np
import igl
from igl.copyleft.cgal import mesh_boolean
points, faces = igl.read_triangle_mesh(sys.argv[1])[:2]
points, at = np.unique(points, axis=0, return_inverse=True)
faces = at.reshape(-1)[faces]
faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
start = time.process_time()
points, faces = mesh_boolean(points, faces.astype(np.int64), np.zeros((0, 3)), np.zeros((0, 3), np.int64), 'union')[:2]
a, b, c = (points[faces[:, i]] for i in range(3))
print(time.process_time() - start, len(faces), np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6)
"""

def python(script, *words):
    command = [PYTHON, "-c", script, *words]
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True).stdout


def install():
    """Returns the available peers."""
    if not PYTHON.exists():
        subprocess.run([sys.executable, "-m", "venv", VENV], check=True)
    there = set()
    for name, packages in [("numpy", ["numpy"]), ("manifold3d", ["manifold3d"]), ("trimesh", ["trimesh", "embreex", "rtree", "scipy"]), ("igl", ["libigl", "scipy"])]:
        pip = [PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages]
        if subprocess.run(pip).returncode == 0:
            there.add(name)
        else:
            print(f"skipped: {name} cannot be had")
    names = ("numpy", "manifold3d", "trimesh", "embreex", "libigl")
    listed = json.loads(subprocess.run([PYTHON, "-m", "pip", "list", "--format=json"], check=True, capture_output=True).stdout)
    print(", ".join(f"{package['name']} {package['version']}" for package in listed if package["name"] in names))
    print()
    return there


def spinney(*words, **more):
    return subprocess.run([str(word) for word in [SPINNEY, *words]], check=True, capture_output=True, text=True, **more).stdout


def exact(mesh, *options):
    out = WORK / f"{mesh.stem}_exact.goblin"
    return out, once([SPINNEY, "-q", "build", mesh, "-o", out, "--brep", *options])


def building(peers, large):
    rows, results = [], []
    for n, m, name in [(500, 200, "200,000 triangles"), (4000, 1600, "12.8 million triangles")][: 2 if large else 1]:
        mesh = WORK / f"torus_{2 * n * m}.ply"
        if not mesh.exists():
            python(TORUS, n, m, mesh)
        runs = range(1 if n > 1000 else 3)
        out, ours = min((exact(mesh) for _ in runs), key=lambda found: found[1])
        shown = [2 * n * m, f"{ours[0]:.2f}", f"{ours[2]:.0f}", f"{out.stat().st_size / 1e6:.1f}"]
        results.append(row(f"bytes of {name}", "MB", out.stat().st_size / 1e6))
        if "manifold3d" in peers:
            theirs = min(once([PYTHON, "-c", MANIFOLD, mesh]) for _ in runs)
            shown += [f"{theirs[0]:.2f}", f"{theirs[2]:.0f}", f"{ours[0] / theirs[0]:.2f}", f"{ours[2] / theirs[2]:.2f}"]
            results += costs(f"build, {name}", ours, "manifold3d", theirs, wall=False)
        rows.append(shown)
    table(["triangles", "ours, CPU s", "MiB", "file, MB", "manifold3d, CPU s", "MiB", "CPU ours / theirs", "MiB ours / theirs"], rows)
    record("exact models", results)


def turned_cube():
    """A cube rotated about x by 0.7, then about z by 0.4."""
    path = WORK / "turned_cube.off"
    (c, s), (C, S) = ((math.cos(angle), math.sin(angle)) for angle in (0.7, 0.4))
    axes = [(C, S, 0.0), (-S * c, C * c, s), (S * s, -C * s, c)]
    lines = ["OFF", "8 6 0"]
    for corner in range(8):
        lines.append(" ".join(repr(sum(axes[i][axis] * (corner >> i & 1) for i in range(3))) for axis in range(3)))
    for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]:
        lines.append(" ".join(map(str, [4, *face])))
    path.write_text("\n".join(lines) + "\n")
    return path


def octrees():
    meshes = [MESH / "fandisk.ply", MESH / "bunny_hr.ply", turned_cube()]
    rows, results = [], []
    for mesh in filter(lambda mesh: mesh.exists(), meshes):
        shown = [mesh.stem]
        for options, end in [([], ""), (["--leaf-size", "0"], ", --boolean 0")]:
            out, _ = exact(mesh, *options)
            info = json.loads(spinney("info", out, "--json"))
            shown.append(sum(info["nodes"].values()))
            results.append(row(f"nodes, {mesh.stem}{end}", "nodes", shown[-1]))
        shown += [info["grid"]["bits"], info["depth"]]
        nodes = []
        for depth in (10, 11, 12):
            cells = WORK / f"{mesh.stem}_{depth}.goblin"
            once([SPINNEY, "-q", "build", mesh, "-o", cells, "--cells", 1 << depth])
            levels = json.loads(spinney("info", cells, "--json"))["levels"]
            nodes.append(sum(level[state] for level in levels for state in ("void", "leaf", "inner")))
            cells.unlink()
        # Surface cells quadruple with each level.
        estimate = nodes[2] * 4 ** (info["depth"] - 12)
        rows.append([*shown, *nodes, f"{nodes[2] / nodes[1]:.2f}", f"{estimate:.1e}", f"{nodes[2] / shown[1]:.0f}", f"{nodes[2] / shown[2]:.0f}"])
    head = ["model", "exact, nodes", "with --leaf-size 0", "bits", "depth", "cells, depth 10", "11", "12", "12 / 11"]
    table([*head, "at the exact one's depth (four times more per level)", "12 / exact", "12 / --leaf-size 0"], rows)
    record("exact models", results)


def points(peers):
    rows, results = [], []
    for mesh in filter(lambda mesh: mesh.exists(), [MESH / "fandisk.ply", MESH / "armadillo.ply", MESH / "bunny_hr.ply"]):
        model, _ = exact(mesh)
        back, numbers, text, outputs = (WORK / f"{mesh.stem}.{end}" for end in ("back.ply", "npy", "csv", "txt"))
        # All sides get the faces on the grid.
        spinney("-q", "export", model, back)
        python(SCATTER, back, POINTS, numbers, text)
        with open(text) as lines_in, open(outputs, "w") as out:
            ours, _, _ = once([SPINNEY, "point", model, "--threads", 1], stdin=lines_in, stdout=out)
        # The cost of reading and printing without queries: points outside of the space.
        far = WORK / "far.csv"
        with open(text) as lines_in, open(far, "w") as out:
            out.writelines("9" + line.lstrip("-") for line in lines_in)
        with open(far) as lines_in:
            without, _, _ = once([SPINNEY, "point", model, "--threads", 1], stdin=lines_in)
        shown, job = [mesh.stem, f"{ours:.2f}", f"{ours - without:.2f}"], f"a million points, {mesh.stem}"
        results.append(row(f"{job}, without reading and printing", "CPU s", ours - without))
        for package, peer, count, name in [
            ("trimesh", "trimesh", POINTS, "trimesh with Embree"),
            ("igl", "fast", POINTS, "libigl, fast winding number"),
            ("igl", "exact", 2000, "libigl, winding number"),
        ]:
            if package not in peers:
                shown += ["-", "-"]
                continue
            seconds, differ, boundary = python(CONTAINS, peer, back, numbers, outputs, count).split()
            shown += [f"{float(seconds) * POINTS / count:.1f}", f"{differ} of {count}"]
            results.append(row(job, "CPU s", ours, f"{name}, call alone", float(seconds) * POINTS / count, note="Ours is the whole process."))
        rows.append([*shown, boundary])
    print(f"{POINTS} points; the exact winding number of 2000 of them")
    print()
    head = ["model", "ours, CPU s", "without text", "trimesh + embree", "differ", "igl, fast winding number", "differ", "igl, winding number", "differ"]
    table([*head, "on the boundary"], rows)
    record("exact models", results)


def volumes():
    rows = []
    names = ["fandisk.ply", "bunny_hr.ply", "armadillo.ply", "rocker-arm.ply", "spot.ply"]
    for mesh in filter(lambda mesh: mesh.exists(), [*(MESH / name for name in names), WORK / "torus_200000.ply"]):
        model, _ = exact(mesh)
        back = WORK / f"{mesh.stem}.back.ply"
        spinney("-q", "export", model, back)
        found = next(line.split()[1] for line in spinney("stats", model).splitlines() if "volume" in line)
        wanted = python(VOLUME, back).strip()
        rows.append([mesh.stem, found, wanted, "yes" if float(found) == float(wanted) else "NO"])
    table(["model", "volume", "in rational numbers", "equal"], rows)
    differ = sum(shown[-1] == "NO" for shown in rows)
    record("exact models", [row(f"volumes that differ from rational numbers, {len(rows)} models", f"of {len(rows)}", differ)])


def repair(peers):
    rows = []
    nasty = sorted((MESH / "nasty").iterdir()) if (MESH / "nasty").is_dir() else []
    for mesh in [*nasty, MESH / "bad_two_armadillos_overlap.ply"]:
        if not mesh.exists():
            continue
        model = WORK / "repaired.goblin"
        try:
            seconds, _, _ = once([SPINNEY, "build", mesh, "--brep", "--repair", "-o", model])
        except SystemExit:
            rows.append([mesh.name, "not resolved"] + ["-"] * 6)
            continue
        facts = json.loads(spinney("stats", model, "--json"))
        shown = [mesh.name, f"{seconds:.2f}", facts["topology"]["faces"], f"{facts['volume']:.9g}"]
        if "igl" not in peers:
            rows.append([*shown, "-", "-", "-", "-"])
            continue
        theirs, faces, volume = python(UNION, mesh).split()
        differ = abs(facts["volume"] - float(volume)) / float(volume)
        rows.append([*shown, f"{float(theirs):.2f}", faces, f"{float(volume):.9g}", f"{differ:.1e}"])
    table(["model", "ours, CPU s, with reading and the file", "faces", "volume", "libigl's union, CPU s", "faces", "volume", "differ"], rows)


def main():
    start(data=False, peer="python3")
    peers = install()
    if "numpy" not in peers:
        sys.exit("NumPy is needed")
    if not MESH.is_dir():
        print("no test data in ../shared/data/mesh: their rows are left out")
    parts = {
        "building": lambda: building(peers, "--large" in sys.argv),
        "volumes": volumes,
        "octrees": octrees,
        "points": lambda: points(peers),
        "repair": lambda: repair(peers),
    }
    requested = [part for part in parts if part in sys.argv]
    for part in requested or parts:
        parts[part]()


if __name__ == "__main__":
    main()
