#!/usr/bin/env python3
"""Labels of a segmentation of 1024 x 1024 x 1024 cells: `spinney transform components=6`, file to
file, against cc3d, which has all cells in memory.

    pip install numpy connected-components-3d
    SPINNEY=target/release/spinney PYTHON=python benches/peers/labels.py [side]

The segmentation is generated reproducibly: thousands of bodies with curved faces, every eighth of
them background.
"""

import os
import statistics
import sys

from common import SPINNEY, WORK, costs, once, record, row, runs, start, table, tree, verdict

PYTHON = os.environ.get("PYTHON", sys.executable)

# Bodies: Voronoi cells of a jittered grid of points, with coordinates distorted by waves. Blocks
# are made one by one.
BODIES = """
import sys
import numpy
path, side, cube = sys.argv[1], int(sys.argv[2]), 64
random = numpy.random.default_rng(1)
count = side // cube
points = (random.uniform(0.1, 0.9, (count, count, count, 3)) + numpy.moveaxis(numpy.indices((count,) * 3), 0, 3)).astype("f4") * cube
# (Bodies of the same label are one where they touch.)
labels = random.integers(1, 1000, (count,) * 3, dtype="u2")
labels[random.random((count,) * 3) < 1 / 8] = 0
cells = numpy.lib.format.open_memmap(path, "w+", "u2", (side,) * 3)
for z in range(count):
    for y in range(count):
        for x in range(count):
            first = numpy.array([z, y, x])
            at = [axis.astype("f4") + cube * place for axis, place in zip(numpy.indices((cube,) * 3), (z, y, x))]
            at = [one + 4 * numpy.sin(other / 9) + numpy.sin(another / 3) for one, other, another in zip(at, at[1:] + at[:1], at[2:] + at[:2])]
            nearest, body = numpy.full((cube,) * 3, numpy.inf, "f4"), numpy.zeros((cube,) * 3, "u2")
            for step in numpy.ndindex(3, 3, 3):
                place = tuple(first + step - 1)
                if min(place) < 0 or max(place) >= count:
                    continue
                away = sum((axis - point) ** 2 for axis, point in zip(at, points[place]))
                closer = away < nearest
                numpy.copyto(nearest, away, where=closer)
                numpy.copyto(body, labels[place], where=closer)
            cells[tuple(slice(cube * place, cube * (place + 1)) for place in (z, y, x))] = body
"""

THEIRS = """
import sys, time
import cc3d, numpy
cells = numpy.load(sys.argv[1])
began = time.process_time()
found = cc3d.connected_components(cells, connectivity=6, out_dtype="u4")
print(time.process_time() - began)
if len(sys.argv) > 2:
    numpy.save(sys.argv[2], numpy.ascontiguousarray(found))
"""

# Labels are compared up to renumbering.
COMPARE = """
import sys
import numpy
ours, theirs = (numpy.load(path, mmap_mode="r") for path in sys.argv[1:])
count = max(int(plane.max()) for plane in theirs)
names = numpy.zeros(count + 1, "u4")
for a, b in zip(ours, theirs):
    names[b] = a
differ = sum(int((names[b] != a).sum()) for a, b in zip(ours, theirs)) + count + 1 - len(numpy.unique(names))
print(f"{count:,} components; cells and labels that differ: {differ}", flush=True)
"""


def main():
    start(data=False, peer=PYTHON)
    side = int(sys.argv[1]) if len(sys.argv) > 1 else 1024
    cells, made, labels = (WORK / f"bodies_{side}{ending}" for ending in (".npy", ".goblin", "_labels.goblin"))
    if not cells.exists():
        once([PYTHON, "-c", BODIES, cells, side])
    tree(cells, made, "--kind", "categorical", "--nodata", "0")
    work = [SPINNEY, "-q", "transform", made, "components=6", "-o", labels]
    peer = [PYTHON, "-c", THEIRS, cells]
    # With mapped files, page cache counts as memory, too, which the system can reclaim at any time.
    rows = [("ours", runs(work)), ("ours, `--positioned`", runs([*work, "--positioned"]))]
    said = WORK / "labels.txt"
    with open(said, "w") as file:
        rows.append(("cc3d, with reading", runs(peer, stdout=file)))
    alone = statistics.median(map(float, said.read_text().split()))
    ratio, memory = verdict(rows[0][1][0] / alone, 1.5, False), verdict(rows[1][1][2], 256, False)
    table(
        [f"labels of {side} x {side} x {side} cells, {made.stat().st_size / 1e6:.1f} MB", "CPU s", "wall s", "MiB"],
        [
            *([name, *(f"{value:.3g}" for value in each)] for name, each in rows),
            ["cc3d, its call alone", f"{alone:.3g}", "", ""],
            ["ours / cc3d's call alone", ratio, "", memory],
        ],
    )
    (_, plain), (_, positioned), (_, whole) = rows
    job, peer = f"components of labels, {side}^3", "cc3d, with reading"
    record("polygons, components, sieves, labels", [
        row(job, "CPU s", plain[0], "cc3d, call alone", alone, note="Ours reads and writes files."),
        *costs(job, plain, peer, whole),
        *costs(f"{job}, --positioned", positioned, peer, whole, wall=False),
    ])
    mine, other = (WORK / f"bodies_{side}_{name}.npy" for name in ("ours", "theirs"))
    once([SPINNEY, "-q", "get", labels, mine])
    once([*peer, other])
    once([PYTHON, "-c", COMPARE, mine, other], stdout=None)
    mine.unlink()
    other.unlink()


if __name__ == "__main__":
    main()
