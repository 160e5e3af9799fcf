#!/usr/bin/env python3
"""All parts of two layers of 100,000 polygons each (`combine partition`) against GEOS by shapely 2
and GeoPandas (`overlay`, how="union").

    pip install geopandas pyogrio shapely numpy
    SPINNEY=target/release/spinney PYTHON=python benches/peers/overlay.py
"""

import json
import os
import subprocess
import sys

from common import SPINNEY, WORK, costs, record, row, runs, table, verdict

PYTHON = os.environ.get("PYTHON", sys.executable)
SIDE = 316

# Grid cells with irregular borders: neighbours share every vertex.
LAYER = """
import json, math, random, sys
import numpy as np
path, side, seed, turn = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
rng = np.random.default_rng(seed)
nodes = np.stack(np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0), indexing="ij"), -1) + rng.uniform(-.2, .2, (side + 1, side + 1, 2))
parts = 6
def winding(a, b):
    t = np.arange(1, parts)[:, None] / parts
    inner = a[..., None, :] * (1 - t) + b[..., None, :] * t
    return inner + rng.uniform(-.03, .03, inner.shape)
east, north = winding(nodes[:-1], nodes[1:]), winding(nodes[:, :-1], nodes[:, 1:])
c, s = math.cos(turn) * 100, math.sin(turn) * 100
def place(points):
    x, y = points[:, 0] - side / 2, points[:, 1] - side / 2
    return np.stack([500000 + c * x - s * y, 5000000 + s * x + c * y], -1).round(4).tolist()
with open(path, "w") as out:
    for i in range(side):
        for j in range(side):
            ring = np.concatenate([nodes[i, j][None], east[i, j], nodes[i + 1, j][None], north[i + 1, j], nodes[i + 1, j + 1][None], east[i, j + 1][::-1], nodes[i, j + 1][None], north[i, j][::-1]])
            ring = place(ring)
            feature = {"type": "Feature", "properties": {"id": i * side + j}, "geometry": {"type": "Polygon", "coordinates": [ring + ring[:1]]}}
            out.write(json.dumps(feature) + "\\n")
"""

# Conversion to what GeoPandas reads fastest.
TO_GPKG = """
import sys, geopandas
geopandas.read_file(sys.argv[1]).set_crs(25832, allow_override=True).to_file(sys.argv[2], layer="a")
"""

OVERLAY = """
import sys, geopandas
a, b = (geopandas.read_file(path, engine="pyogrio") for path in sys.argv[1:3])
made = geopandas.overlay(a, b, how="union", keep_geom_type=True)
made.to_file(sys.argv[3], engine="pyogrio")
print(len(made), made.area.sum())
"""


def main():
    paths = []
    for name, seed, turn in [("overlay_a", 1, 0.0), ("overlay_b", 2, 0.3)]:
        text, path = WORK / f"{name}.geojsonl", WORK / f"{name}.gpkg"
        if not path.exists():
            subprocess.run([PYTHON, "-c", LAYER, text, str(SIDE), str(seed), str(turn)], check=True)
            subprocess.run([PYTHON, "-c", TO_GPKG, text, path], check=True)
        paths.append(path)
    ours = runs([SPINNEY, "-q", "combine", "partition", *paths, "-o", WORK / "overlay.gpkg", "--memory", "4G"], 3)
    theirs = runs([PYTHON, "-c", OVERLAY, *paths, WORK / "overlay_geos.gpkg"], 1)
    sizes = [(WORK / name).stat().st_size / 1e6 for name in ("overlay.gpkg", "overlay_geos.gpkg")]
    table(["2 x 100,000 polygons, all parts", "CPU s", "wall s", "MiB", "MB"],
          [["ours", *(f"{v:.2f}" for v in ours), f"{sizes[0]:.0f}"],
           ["GeoPandas, GEOS", *(f"{v:.2f}" for v in theirs), f"{sizes[1]:.0f}"],
           ["ours / theirs", verdict(ours[0] / theirs[0], 1, False), "", "", ""]])
    job, peer = "2 x 100,000 polygons, GeoPackage to GeoPackage", "GeoPandas overlay"
    record("overlays of polygons", [*costs(job, ours, peer, theirs), row(f"{job}: bytes", "MB", sizes[0], peer, sizes[1])])


if __name__ == "__main__":
    main()
