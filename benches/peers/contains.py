#!/usr/bin/env python3
"""`Dataset.contains` of many points in a solid, against trimesh with Embree's rays; one thread of
one process.

Run it with a Python that has both (`pip install ./python trimesh embreex`):

    python benches/peers/contains.py [MODEL.ply] [POINTS]

Ours looks up cells of a tree of 1024 cells along the longest side, theirs casts rays at the model's
triangles: results differ for points within a cell of the surface.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy
import spinney
import trimesh
from common import record, row

MODEL = sys.argv[1] if len(sys.argv) > 1 else "../shared/data/mesh/armadillo.ply"
POINTS = int(sys.argv[2]) if len(sys.argv) > 2 else 10_000_000
THEIRS = min(POINTS, 500_000)


def timed(call):
    began = time.process_time()
    result = call()
    return time.process_time() - began, result


def main():
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory() as directory:
        path = f"{directory}/solid.goblin"
        seconds, _ = timed(lambda: spinney.build(MODEL, path, cells=1024))
        print(f"build: {seconds:.2f} s")
        mesh = trimesh.load(MODEL, process=True)
        points = numpy.random.default_rng(1).uniform(*mesh.bounds, (POINTS, 3))
        with spinney.open(path) as ds:
            seconds, ours = timed(lambda: ds.contains(points))
            ours_rate = POINTS / seconds
            print(f"spinney: {ours_rate / 1e6:.2f} million points/s")
        mesh.ray.contains_points(points[:1000])
        seconds, theirs = timed(lambda: mesh.ray.contains_points(points[:THEIRS]))
        rate = THEIRS / seconds
        same = (ours[:THEIRS] == theirs).mean()
        print(f"trimesh, {type(mesh.ray).__module__}: {rate / 1e6:.3f} million points/s; {100 * same:.2f} % of the results are the same")
        print(f"ours / theirs: {ours_rate / rate:.0f}")
    job, note = f"{POINTS / 1e6:g} million points, {Path(MODEL).stem} at 1024, one thread", f"Ours are cells; {100 * same:.2f} % of the results are the same."
    record("solids of cells", [row(job, "million/s", ours_rate / 1e6, "trimesh with Embree", rate / 1e6, note=note)])


if __name__ == "__main__":
    main()
