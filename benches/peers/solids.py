#!/usr/bin/env python3
"""Solids: `spinney build` and `combine` against OpenVDB (level set, interior mask, file) on the
same meshes.

    solids.py          the table
    solids.py long     the armadillo at 16384 cells; with a number, at so many

Meshes are the armadillo of ../shared/data/mesh and finer ones made from it by halving edges.
"""

import subprocess
import sys
from pathlib import Path

from common import ROOT, SPINNEY, WORK, costs, once, record, row, runs, start, table, verdict

MESH = ROOT.parent / "shared" / "data" / "mesh"
OPENVDB = WORK / "openvdb_solid"

# Halves all edges repeatedly; in a separate process, so that NumPy does not count in the peak
# memory of others.
REFINE = """
import sys
import numpy as np
source, times, ply, stl = sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4]
data = open(source, 'rb').read()
end = data.index(b'end_header\\n') + 11
head = data[:end].decode().split('\\n')
count = lambda name: int(next(line for line in head if line.startswith('element ' + name)).split()[2])
assert 'format binary_little_endian 1.0' in head and head.count('property float x') == 1
points = np.frombuffer(data, '<f4', count('vertex') * 3, end).reshape(-1, 3).astype('f8')
faces = np.frombuffer(data, np.dtype([('n', 'u1'), ('v', '<i4', 3)]), count('face'), end + points.shape[0] * 12)['v'].astype('i8')
for _ in range(times):
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    keys, at = np.unique(edges[:, 0] * len(points) + edges[:, 1], return_inverse=True)
    first, second = keys // len(points), keys % len(points)
    a, b, c = (at[i * len(faces):(i + 1) * len(faces)] + len(points) for i in range(3))
    points = np.concatenate([points, (points[first] + points[second]) / 2])
    x, y, z = faces.T
    faces = np.concatenate([np.stack(t, 1) for t in [(x, a, c), (a, y, b), (c, b, z), (a, b, c)]])
points = points.astype('<f4')
with open(ply, 'wb') as out:
    out.write(('ply\\nformat binary_little_endian 1.0\\nelement vertex %d\\nproperty float x\\nproperty float y\\nproperty float z\\n'
               'element face %d\\nproperty list uchar int vertex_indices\\nend_header\\n' % (len(points), len(faces))).encode())
    out.write(points.tobytes())
    rows = np.zeros(len(faces), np.dtype([('n', 'u1'), ('v', '<i4', 3)]))
    rows['n'], rows['v'] = 3, faces
    out.write(rows.tobytes())
if stl != '-':
    rows = np.zeros(len(faces), np.dtype([('n', '<f4', 3), ('v', '<f4', (3, 3)), ('a', '<u2')]))
    rows['v'] = points[faces]
    with open(stl, 'wb') as out:
        out.write(bytes(80) + np.uint32(len(faces)).tobytes() + rows.tobytes())
print(len(faces), 'triangles')
"""


def refined(times, stl=False):
    ply = WORK / f"armadillo_{times}.ply"
    other = ply.with_suffix(".stl")
    if not ply.exists() or (stl and not other.exists()):
        command = [sys.executable, "-c", REFINE, MESH / "armadillo.ply", times, ply, other if stl else "-"]
        subprocess.run([str(word) for word in command], check=True)
    return ply


def openvdb():
    source = Path(__file__).parent / "openvdb" / "solid.cc"
    if not OPENVDB.exists() or OPENVDB.stat().st_mtime < source.stat().st_mtime:
        command = ["g++", "-O2", "-std=c++17", source, "-o", OPENVDB, "-lopenvdb", "-ltbb", "-lImath-3_1"]
        subprocess.run([str(word) for word in command], check=True)


def build(model, cells, memory, out):
    return runs([SPINNEY, "-q", "build", model, "-o", out, "--cells", cells, "--memory", memory])


def main():
    start(data=False, peer="g++")
    if not MESH.is_dir():
        sys.exit("skipped: no test data in ../shared/data/mesh")
    if sys.argv[1:2] == ["long"]:
        cells = int(sys.argv[2]) if len(sys.argv) > 2 else 16384
        memory = "256M" if cells <= 16384 else "1G"
        out = WORK / "long.goblin"
        cpu, wall, peak = once([SPINNEY, "build", refined(0), "-o", out, "--cells", cells, "--memory", memory])
        table(["cells", "CPU s", "wall s", "peak MiB", "GB"],
              [[cells, f"{cpu:.1f}", f"{wall:.1f}", f"{peak:.0f}", f"{out.stat().st_size / 1e9:.2f}"]])
        job = f"build armadillo at {cells}"
        record("solids of cells", [*costs(job, (cpu, wall, peak)), row(f"{job}: bytes", "GB", out.stat().st_size / 1e9)])
        out.unlink()
        return
    openvdb()
    coarse, fine = refined(0), refined(3, stl=True)
    rows, results = [], []
    for name, model, cells, memory, share, most, ours_only in [
        ("armadillo", coarse, 1024, "40M", 15, 64, None),
        ("armadillo", coarse, 4096, "128M", 12, 256, None),
        ("5.5 million triangles, PLY", fine, 1024, "128M", 15, 256, None),
        ("5.5 million triangles, STL", fine, 1024, "128M", 15, 256, fine.with_suffix(".stl")),
    ]:
        out = WORK / "solid.goblin"
        cpu, wall, peak = build(ours_only or model, cells, memory, out)
        theirs = once([OPENVDB, "mesh", model, cells, WORK / "solid.vdb"])
        job = f"{name}, at {cells}" if "," in name else f"{name} at {cells}"
        sizes = [path.stat().st_size / 1e6 for path in (out, WORK / "solid.vdb")]
        results += [
            *costs(f"build {job}", (cpu, wall, peak), "OpenVDB", theirs, wall=False),
            row(f"build {job}, wall", "s", wall),
            row(f"bytes of {job}", "MB", sizes[0], "OpenVDB", sizes[1]),
        ]
        rows.append([name, cells, f"{cpu:.2f}", f"{wall:.2f}", f"{peak:.0f}", f"{theirs[0]:.1f}", f"{theirs[2]:.0f}",
                     verdict(theirs[0] / cpu, share), f"{peak:.0f} MiB ({'met' if peak <= most else 'MISSED'})",
                     *(f"{size:.0f}" for size in sizes)])
    table(["model", "cells", "CPU s", "wall s", "MiB", "OpenVDB CPU s", "MiB", "OpenVDB / ours", "peak", "MB", "VDB MB"], rows)

    # A union of two solids on one grid: the armadillo and itself, moved by a fraction of its size.
    a, b, c = (WORK / f"{name}.goblin" for name in "abc")
    once([SPINNEY, "-q", "build", coarse, "-o", a, "--cells", 1024])
    once([SPINNEY, "-q", "transform", a, "translate=37,21,11", "depth=10", "--move", "-o", b])
    cpu, wall, peak = runs([SPINNEY, "-q", "combine", "union", a, b, "-o", c, "--memory", "16M"])
    x, y = WORK / "x.vdb", WORK / "y.vdb"
    once([OPENVDB, "mesh", coarse, 1024, x])
    once([OPENVDB, "mesh", coarse, 1000, y])
    theirs = runs([OPENVDB, "union", x, y, WORK / "z.vdb"])
    table(["union at 1024", "CPU s", "MiB", "OpenVDB CPU s", "MiB", "ours / OpenVDB"],
          [["two armadillos", f"{cpu:.3f}", f"{peak:.0f}", f"{theirs[0]:.2f}", f"{theirs[2]:.0f}",
            verdict(cpu / theirs[0], 0.1, least=False)]])
    results += costs("union of two armadillos at 1024", (cpu, wall, peak), "OpenVDB", theirs, wall=False)
    record("solids of cells", results)


main()
