#!/usr/bin/env python3
"""A million adjacent rings: a grid of 1000 x 1000 squares, as one multipolygon and as features with
a value each (one of 1,000), to quadtrees of 4000 x 4000 and of 32000 x 32000 cells, against
`gdal_rasterize`. The cells are checked: no gaps, and none assigned to a neighbour.

    SPINNEY=target/release/spinney benches/peers/touching.py [SIDE]
"""

import json
import os
import subprocess
import sys

from common import SPINNEY, WORK, costs, once, record, row, start, table

SIDE = int(sys.argv[1]) if len(sys.argv) > 1 else 1000

# In separate processes, whose memory does not count.
WRITE = """
import sys
path, side, kind = sys.argv[1], int(sys.argv[2]), sys.argv[3]
ring = lambda x, y: f"[[[{x},{y}],[{x+1},{y}],[{x+1},{y+1}],[{x},{y+1}],[{x},{y}]]]"
head = '{"type":"FeatureCollection","crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::25832"}},"features":['
feature = lambda value, geometry: '{"type":"Feature","properties":{"code":%d},"geometry":%s}' % (value, geometry)
positions = [(x, y) for y in range(side) for x in range(side)]
with open(path, "w") as file:
    file.write(head)
    if kind == "one":
        file.write(feature(7, '{"type":"MultiPolygon","coordinates":[' + ",".join(ring(*at) for at in positions) + "]}"))
    else:
        file.write(",\\n".join(feature((x * 31 + y * 17) % 1000, '{"type":"Polygon","coordinates":' + ring(x, y) + "}") for x, y in positions))
    file.write("]}")
"""


def described(kind):
    """Returns the file, made once."""
    path = WORK / f"squares_{kind}_{SIDE}.geojson"
    if not path.exists():
        subprocess.run([sys.executable, "-c", WRITE, path, str(SIDE), kind], check=True)
    return path


def check(tree, kind, width):
    """Checks a tree's cells: their number, and that of each value."""
    stats = json.loads(subprocess.check_output([SPINNEY, "stats", tree, "--json"]))
    cells = (SIDE * width) ** 2
    assert (stats["cells"], stats["void_cells"]) == (cells, 0), stats
    found = {int(own["value"]): own["cells"] for own in stats["classes"]}
    wanted = {}
    for x in range(SIDE if kind == "each" else 0):
        for y in range(SIDE):
            value = (x * 31 + y * 17) % 1000
            wanted[value] = wanted.get(value, 0) + width * width
    assert found == (wanted or {7: cells}), kind


start(data=False, peer="gdal_rasterize")
os.environ["OGR_GEOJSON_MAX_OBJ_SIZE"] = "0"
rows, results = [], []
squares = "a million squares" if SIDE == 1000 else f"{SIDE * SIDE:,} squares"
# A feature has to fit into half of the memory, by an upper bound on its parsed size: 597 MB for a
# million rings in GeoJSON; so do the edges of all features: 960 MB.
for kind, what, memories in (("one", "one multipolygon", ["2G"]), ("each", "a feature each", ["2G"])):
    path, mine = described(kind), {}
    for width in (4, 32):
        for memory in memories:
            tree = WORK / f"squares_{kind}.goblin"
            ours = once([SPINNEY, "-q", "build", path, "-o", tree, "--cell", 1 / width, "--value", "code", "--memory", memory])
            check(tree, kind, width)
            mine[width] = ours, tree.stat().st_size / 1e6
            rows.append([f"{what}, {width * SIDE}^2 cells, --memory {memory}", *(f"{v:.2f}" for v in ours), f"{mine[width][1]:.2f}"])
    raster = WORK / "squares.tif"
    raster.unlink(missing_ok=True)
    box = ["-te", 0, 0, SIDE, SIDE, "-ts", 4 * SIDE, 4 * SIDE, "-co", "TILED=YES", "-co", "COMPRESS=DEFLATE", "-co", "ZLEVEL=1"]
    theirs = once(["gdal_rasterize", "-q", "-a", "code", "-ot", "UInt16", *box, path, raster])
    rows.append([f"gdal_rasterize, {what}, {4 * SIDE}^2 cells, no levels", *(f"{v:.2f}" for v in theirs), f"{raster.stat().st_size / 1e6:.2f}"])
    for width, (ours, size) in mine.items():
        peer, its, its_size = ("gdal_rasterize", theirs, raster.stat().st_size / 1e6) if width == 4 else (None, (None,) * 3, None)
        job, more = f"{squares} that touch, {what}, {width * SIDE} x {width * SIDE}", {"note": "The peer makes no levels."} if peer else {}
        results += [*costs(job, ours, peer, its, wall=False, **more), row(f"{job}: bytes", "MB", size, peer, its_size, **more)]
table([f"{SIDE * SIDE:,} squares that touch", "CPU s", "wall s", "MiB", "MB"], rows)
record("features to cells", results)
