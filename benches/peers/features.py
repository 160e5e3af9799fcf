#!/usr/bin/env python3
"""Features to quadtrees: a shoreline of a million vertices on 43200 x 21600 cells against
`gdal_rasterize` and a COG with overviews by mode; cell shares of 1,000 polygons against
exactextract.

    pip install numpy rasterio exactextract
    SPINNEY=target/release/spinney PYTHON=python benches/peers/features.py
"""

import json
import math
import os
import random
import subprocess
import sys

from common import SPINNEY, WORK, costs, once, record, row, runs, start, table, verdict

PYTHON = os.environ.get("PYTHON", sys.executable)
CORNERS = 1_000_000
CELL = 1 / 120

EXTRACT = """
import json, sys
from exactextract import exact_extract
from exactextract.raster import NumPyRasterSource
import numpy as np
zones = json.load(open(sys.argv[1]))["features"]
raster = NumPyRasterSource(np.zeros((2160, 4320), "u1"), 0, 0, 4320, 2160)
found = exact_extract(raster, zones, ["coverage", "cell_id"])
print(sum(float(np.sum(zone["properties"]["coverage"])) for zone in found))
"""


# A ring with detail at all scales, in degrees; two vertices extend its box to the whole world.
SHORELINE = """
import json, math, sys
def at(number):
    turn = 2 * math.pi * number / int(sys.argv[2])
    away = 60 + 25 * sum(math.sin(turn * 2**k + 3 * k) * 0.5**k for k in range(1, 14))
    return [round(2 * away * math.cos(turn), 6), round(away * math.sin(turn), 6)]
corners = [[-180, -90], [-179.99, -90], [-179.99, -89.99]], [[180, 90], [179.99, 90], [179.99, 89.99]]
parts = [[[*ring, ring[0]]] for ring in (*corners, [at(number) for number in range(int(sys.argv[2]))])]
feature = {"type": "Feature", "properties": {"code": 3}, "geometry": {"type": "MultiPolygon", "coordinates": parts}}
json.dump({"type": "FeatureCollection", "features": [feature]}, open(sys.argv[1], "w"))
"""


def rasterized():
    path, tree, raster, cog = WORK / "shore.geojson", WORK / "shore.goblin", WORK / "shore.tif", WORK / "shore_cog.tif"
    if not path.exists():
        subprocess.run([PYTHON, "-c", SHORELINE, path, str(CORNERS)], check=True)
    ours = runs([SPINNEY, "-q", "build", path, "-o", tree, "--cell", CELL, "--value", "code"], 3)
    box = ["-te", -180, -90, 180, 90, "-ts", 43200, 21600]
    a = runs(["gdal_rasterize", "-q", "-a", "code", "-ot", "Byte", *box, "-co", "TILED=YES", "-co", "COMPRESS=DEFLATE", "-co", "ZLEVEL=1", path, raster], 1)
    b = runs(["gdal_translate", "-q", "-of", "COG", "-co", "COMPRESS=ZSTD", "-co", "OVERVIEW_RESAMPLING=MODE", raster, cog], 1)
    theirs = a[0] + b[0]
    job, peer = "ring of a million vertices, 43200 x 21600 cells", "gdal_rasterize and GDAL COG, ZSTD"
    sizes = [path.stat().st_size / 1e6 for path in (tree, cog)]
    record("features to cells", [*costs(job, ours, peer, (theirs, a[1] + b[1], max(a[2], b[2]))), row(f"{job}: bytes", "MB", sizes[0], peer, sizes[1])])
    table(["shoreline, 43200 x 21600", "CPU s", "wall s", "MiB", "MB"],
          [["ours", *(f"{v:.2f}" for v in ours), f"{sizes[0]:.2f}"],
           ["gdal_rasterize + COG", f"{theirs:.2f}", f"{a[1] + b[1]:.2f}", f"{max(a[2], b[2]):.0f}", f"{sizes[1]:.2f}"],
           ["ours / theirs", verdict(ours[0] / theirs, 1 / 20, False), "", f"{'met' if ours[2] <= 200 else 'MISSED'}", ""]])


def fractions(count=1000):
    rng, path, tree = random.Random(5), WORK / "stars.geojson", WORK / "shares.goblin"

    def star():
        x, y, n = rng.uniform(120, 4200), rng.uniform(120, 2040), rng.randrange(5, 60)
        ring = [[x + rng.uniform(30, 110) * math.cos(2 * math.pi * i / n), y + rng.uniform(30, 110) * math.sin(2 * math.pi * i / n)] for i in range(n)]
        return {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}}

    features = [star() for _ in range(count)]
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": None, "features": features}))
    grid = WORK / "grid.goblin"
    make = "import numpy, spinney, sys; spinney.build(numpy.ones((2160, 4320), 'u1'), sys.argv[1], transform=(1, 0, 0, 0, -1, 2160))"
    subprocess.run([PYTHON, "-c", make, grid], check=True)
    ours = runs([SPINNEY, "-q", "build", path, "-o", tree, "--grid", grid, "--fractions"], 3)
    theirs = once([PYTHON, "-c", EXTRACT, path])
    table(["shares of cells of 1,000 polygons", "CPU s", "wall s", "MiB"],
          [["ours, a file with all levels", *(f"{v:.2f}" for v in ours)], ["exactextract, arrays", *(f"{v:.2f}" for v in theirs)],
           ["ours / theirs", verdict(ours[0] / theirs[0], 1 / 10, False), "", ""]])
    record("features to cells", costs(f"shares of the cells of {count:,} polygons, 4320 x 2160 cells", ours, "exactextract, arrays in memory", theirs))


def main():
    start()
    rasterized()
    fractions()


main()
