#!/usr/bin/env python3
"""`ExactModel.rays` of many rays against trimesh with Embree: processor time of the calls, one
thread; the tree and the file are built before.

Run it with a Python that has both (`pip install ./python trimesh embreex`):

    python benches/peers/rays.py [RAYS]

Rays of a camera start at one point, in rows; others start anywhere around the model and pass
through any point of its box. Both sides return positions and triangles. Theirs are in single
precision, ours are exact: the printed differences are those of distances for common hits.
"""

import os
import sys
import tempfile
import time

import numpy as np
import spinney
import trimesh
from common import ROOT, record, row, table

MESHES = [ROOT.parent / "shared" / "data" / "mesh" / f"{name}.ply" for name in ("armadillo", "bunny_hr", "fandisk")]
RAYS = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000


def timed(call):
    """Returns the minimum processor time of three calls, and the last result."""
    least = np.inf
    for _ in range(3):
        began = time.process_time()
        found = call()
        least = min(least, time.process_time() - began)
    return least, found


def rays(bounds):
    low, high = bounds
    size, middle, random = high - low, (low + high) / 2, np.random.default_rng(1)
    longest, side = size.max(), int(RAYS**0.5)
    rows, columns = (at.ravel() / side - 0.5 for at in np.indices((side, side)))
    eye = np.tile(middle + (0, 0, 2 * longest), (side * side, 1))
    yield "camera", eye, np.stack([columns * 0.6, rows * 0.6, -np.ones_like(rows)], 1)
    origins = middle + (random.random((RAYS, 3)) - 0.5) * 2 * longest
    yield "anywhere", origins, low + random.random((RAYS, 3)) * size - origins


def main():
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    lines, results = [], []
    with tempfile.TemporaryDirectory() as directory:
        for mesh in filter(lambda mesh: mesh.exists(), MESHES):
            spinney.build_brep(mesh, f"{directory}/model.goblin")
            with spinney.open_brep(f"{directory}/model.goblin") as model:
                peer = trimesh.Trimesh(*model.triangles(), process=False)
                peer.ray.intersects_first([(0, 0, 0)], [(0, 0, 1)])
                for name, origins, ways in rays(peer.bounds):
                    ours, hits = timed(lambda: model.rays(origins, ways, threads=1))
                    theirs, (points, index, _) = timed(lambda: peer.ray.intersects_location(origins, ways, multiple_hits=False))
                    differ = np.zeros(len(origins), bool)
                    differ[index] = True
                    differ ^= hits.hit
                    both = hits.hit[index]
                    difference = np.linalg.norm(hits.points[index[both]] - points[both], axis=1).max() / peer.scale
                    count = len(origins) / 1e6
                    figures = [f"{ours / count:.2f}", f"{theirs / count:.2f}", f"{ours / theirs:.1f}"]
                    results.append(row(f"ray, {mesh.stem}, {name}", "us", ours / count, "Embree", theirs / count))
                    lines.append([mesh.stem, len(peer.faces), name, *figures, int(differ.sum()), f"{difference:.0e}"])
    print(f"{RAYS} rays, {type(peer.ray).__module__}")
    table(["model", "triangles", "rays", "ours, us a ray", "Embree, us a ray", "ours / theirs", "hit in one alone", "difference, of the size"], lines)
    record("exact models", results)


if __name__ == "__main__":
    main()
