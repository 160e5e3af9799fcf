#!/usr/bin/env python3
"""A thousand slices of a scan: `spinney section` against trimesh's section_multiplane.

    sections.py

trimesh slices a mesh in memory, and joins the segments to closed paths, whose areas are computed;
ours reads an exact model's file and writes polygons with holes and areas. The peer is installed as
for exact.py. The program is target/release/spinney, or SPINNEY. One thread.
"""

import csv
import json
import os
import subprocess
import sys

os.environ["RAYON_NUM_THREADS"] = "1"

from common import SPINNEY, WORK, once, record, row, runs, start, table  # noqa: E402
from exact import MESH, PYTHON, install  # noqa: E402

PLANES = 1000
AXIS = 1

TRIMESH = """
import json, sys, time
import numpy as np, trimesh
mesh = trimesh.load(sys.argv[1], process=True)
low, high, count, axis = float(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5])
normal = np.eye(3)[axis]
heights = low + (np.arange(count) + 0.5) * (high - low) / count
began = time.process_time()
found = mesh.section_multiplane(plane_origin=np.zeros(3), plane_normal=normal, heights=heights)
cut = time.process_time() - began
areas = sum(path.area for path in found if path is not None)
print(json.dumps([cut, time.process_time() - began, float(areas)]))
"""


def main():
    start(data=False, peer="python3")
    if "trimesh" not in install():
        sys.exit("trimesh is needed")
    subprocess.run([PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "shapely", "networkx"], check=True)
    rows, results = [], []
    for name, short in (("armadillo.ply", "armadillo"), ("bunny_hr.ply", "bunny")):
        mesh = MESH / name
        if not mesh.exists():
            print(f"skipped: no {mesh}")
            continue
        model, out = WORK / "section.goblin", WORK / "section.csv"
        once([SPINNEY, "-q", "build", mesh, "-o", model, "--brep"])
        stats = json.loads(subprocess.run([SPINNEY, "stats", model, "--json"], check=True, capture_output=True).stdout)
        low, high = (corner[AXIS] for corner in stats["bounds"])
        step = (high - low) / PLANES
        planes = f"y={low + step / 2!r}..{high - step / 4!r}/{step!r}"
        cpu, _, peak = runs([SPINNEY, "-q", "--threads", 1, "section", model, planes, "-o", out])
        csv.field_size_limit(1 << 30)
        with open(out) as file:
            areas = [float(row["area"]) for row in csv.DictReader(file)]
        result = WORK / "section.json"
        with open(result, "w") as file:
            whole, _, theirs = once([PYTHON, "-c", TRIMESH, mesh, low, high, PLANES, AXIS], stdout=file)
        cut, alone, area = json.loads(result.read_text())
        ours = sum(areas)
        volume = ours * step
        rows.append(
            [name, len(areas), f"{cpu:.2f}", f"{peak:.0f}", f"{cut:.2f}", f"{alone:.2f}", f"{whole:.2f}", f"{theirs:.0f}", f"{cut / cpu:.1f}", f"{alone / cpu:.1f}"]
            + [f"{abs(ours - area) / area:.1e}", f"{abs(volume - stats['volume']) / stats['volume']:.1e}"]
        )
        job = f"{PLANES:,} sections, {short}"
        for peer, seconds in [("with reading", whole), ("polygons", alone), ("segments alone", cut)]:
            results.append(row(job, "CPU s", cpu, f"trimesh, {peer}", seconds))
        results.append(row(f"{job}: memory", "MiB", peak, "trimesh", theirs))
        for file in (model, out, result):
            file.unlink()
    head = ["scan", "polygons", "ours, CPU s", "MiB", "trimesh, segments alone, CPU s", "with polygons", "and reading", "MiB", "segments / ours", "polygons / ours"]
    table([*head, "areas differ", "our areas from the volume"], rows)
    record("exact models", results)


if __name__ == "__main__":
    main()
