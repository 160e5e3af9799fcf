#!/usr/bin/env python3
"""Solids of primitives: `spinney build x.csg` against manifold3d (PyPI) and an even-odd scan of its
mesh in NumPy, at the same cells.

    PYTHON=python benches/peers/csg.py [CELLS]

Half of 1,000 primitives (balls, blocks, cylinders, tori at random positions) minus the other half,
at 1024 cells along a side by default. PYTHON has manifold3d and numpy. Facets of the mesh are
within a quarter of a cell of the surfaces; the scan writes no file, and counts cells.
"""

import json
import os
import random
import subprocess
import sys

from common import SPINNEY, WORK, costs, record, runs, start, table, verdict

PYTHON = os.environ.get("PYTHON", sys.executable)

PEER = r"""
import json, math, sys
import numpy as np
from manifold3d import CrossSection, Manifold, OpType
cells, shapes = int(sys.argv[1]), json.load(open(sys.argv[2]))
side = 1000.0
cell = side / cells

def segments(radius):
    return max(8, math.ceil(math.pi / math.acos(max(0.0, 1 - cell / 4 / radius))))

def along(direction):
    x, y, z = direction
    length = math.hypot(x, y, z)
    return [0, math.degrees(math.acos(z / length)), math.degrees(math.atan2(y, x))]

def solid(kind, *n):
    if kind == 'ball':
        return Manifold.sphere(n[3], 2 * math.ceil(segments(n[3]) / 2)).translate(n[:3])
    if kind == 'block':
        return Manifold.cube([b - a for a, b in zip(n[:3], n[3:])]).translate(n[:3])
    if kind == 'cylinder':
        axis = [b - a for a, b in zip(n[:3], n[3:6])]
        return Manifold.cylinder(math.hypot(*axis), n[6], circular_segments=segments(n[6])).rotate(along(axis)).translate(n[:3])
    ring, tube = n[6:]
    outline = CrossSection.circle(tube, segments(tube)).translate([ring, 0])
    return Manifold.revolve(outline, segments(ring + tube)).rotate(along(n[3:6])).translate(n[:3])

solids = [solid(*shape) for shape in shapes]
half = len(solids) // 2
whole = Manifold.batch_boolean(solids[:half], OpType.Add) - Manifold.batch_boolean(solids[half:], OpType.Add)
mesh = whole.to_mesh64()
points = np.asarray(mesh.vert_properties)[:, :3] / cell - 0.5
triangles = points[np.asarray(mesh.tri_verts)]
# Columns along z that a triangle may cross, and then those that it does; a slab of x at a time.
low = np.ceil(triangles[:, :, :2].min(1)).astype(int)
high = np.floor(triangles[:, :, :2].max(1)).astype(int)
full, slab = 0, 64
for first in range(0, cells, slab):
    last = min(first + slab, cells) - 1
    in_slab = np.flatnonzero((high[:, 0] >= first) & (low[:, 0] <= last))
    a, b = np.maximum(low[in_slab, 0], first), np.minimum(high[in_slab, 0], last)
    wide, deep = np.maximum(b - a + 1, 0), np.maximum(high[in_slab, 1] - low[in_slab, 1] + 1, 0)
    count = wide * deep
    which = np.repeat(np.arange(len(in_slab)), count)
    place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    x, y = a[which] + place // deep[which], low[in_slab, 1][which] + place % deep[which]
    p = triangles[in_slab][which]
    side_of = lambda i, j: (p[:, j, 0] - p[:, i, 0]) * (y - p[:, i, 1]) - (p[:, j, 1] - p[:, i, 1]) * (x - p[:, i, 0])
    u, v, w = side_of(1, 2), side_of(2, 0), side_of(0, 1)
    area = u + v + w
    met = ((u >= 0) & (v >= 0) & (w >= 0) | (u < 0) & (v < 0) & (w < 0)) & (area != 0)
    z = (u * p[:, 0, 2] + v * p[:, 1, 2] + w * p[:, 2, 2])[met] / area[met]
    change = np.zeros((slab, cells, cells + 1), np.uint8)
    inside = (y[met] >= 0) & (y[met] < cells)
    np.bitwise_xor.at(change, (x[met][inside] - first, y[met][inside], np.clip(np.ceil(z[inside]), 0, cells).astype(int)), 1)
    full += int(np.bitwise_xor.accumulate(change[:, :, :cells], axis=2).sum(dtype=np.int64))
print(full)
"""


def shapes(count):
    """Returns primitives with reproducible positions and sizes."""
    chance = random.Random(1)
    for number in range(count):
        radius = chance.uniform(10, 50)
        x, y, z = (chance.uniform(100, 900) for _ in range(3))
        yield [
            ("ball", x, y, z, radius),
            ("block", x - radius, y - radius, z - radius, x + radius, y + radius / 2, z + radius / 3),
            ("cylinder", x, y, z, x + 2 * radius, y + radius, z - radius, radius / 2),
            ("torus", x, y, z, 0.3, 0.5, 1.0, radius, radius / 3),
        ][number % 4]


def main():
    start(data=False, peer=PYTHON)
    cells = int(sys.argv[1]) if len(sys.argv) > 1 else 1024
    all_shapes = list(shapes(1000))
    text, other, out = WORK / "many.csg", WORK / "many.json", WORK / "many.goblin"
    words = [f"{kind}({', '.join(map(repr, numbers))})" for kind, *numbers in all_shapes]
    half = len(words) // 2
    join = ",\n".join
    text.write_text(f"bounds(0,0,0, 1000,1000,1000);\ndifference(union(\n{join(words[:half])}),\n{join(words[half:])});\n")
    other.write_text(json.dumps(all_shapes))
    cpu, wall, peak = runs([SPINNEY, "-q", "build", text, "-o", out, "--cells", cells])
    counted = WORK / "many.txt"
    with counted.open("w") as file:
        their_cpu, their_wall, their_peak = runs([PYTHON, "-c", PEER, cells, other], stdout=file)
    theirs = int(counted.read_text().split()[-1])
    printed = subprocess.check_output([SPINNEY, "stats", out], text=True)
    ours = int(printed.split("cells")[1].split(",")[0])
    table(
        ["", "CPU s", "wall s", "MiB", "full cells"],
        [
            ["spinney", f"{cpu:.2f}", f"{wall:.2f}", f"{peak:.0f}", ours],
            ["manifold3d and a scan", f"{their_cpu:.2f}", f"{their_wall:.2f}", f"{their_peak:.0f}", theirs],
            ["ours / theirs", verdict(cpu / their_cpu, 0.2, least=False), "", "", f"{ours / theirs:.5f}"],
        ],
    )
    theirs = their_cpu, their_wall, their_peak
    record("solids of cells", costs(f"500 primitives less 500 others, {cells}^3", (cpu, wall, peak), "manifold3d and a scan", theirs))


main()
