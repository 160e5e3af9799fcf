#!/usr/bin/env python3
"""Many zones: areas of classes of 10,000 zones on the shoreline, and means of as many on the
relief, against exactextract; means of 1,000 zones on the relief against extractrs, which gets the
polygons as WKB and the raster as an array.

    pip install numpy rasterio exactextract extractrs
    SPINNEY=target/release/spinney PYTHON=python \\
        benches/peers/zones.py [shoreline] [relief] [extractrs]
"""

import json
import math
import os
import random
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from common import RELIEF, SHORELINE, SPINNEY, WORK, costs, once, record, runs, start, table, tree, verdict

PYTHON = os.environ.get("PYTHON", sys.executable)

CLASSES = """
import json, sys
from exactextract import exact_extract
zones = json.load(open(sys.argv[2]))["features"]
found = exact_extract(sys.argv[1], zones, ["unique", "frac", "count"])
areas = [f["properties"] for f in found]
print(json.dumps([{int(u): float(x) * f["count"] for u, x in zip(f["unique"], f["frac"])} for f in areas]))
"""

MEANS = """
import json, sys
from exactextract import exact_extract
zones = json.load(open(sys.argv[2]))["features"]
print(json.dumps([f["properties"]["mean"] for f in exact_extract(sys.argv[1], zones, ["mean"])]))
"""

# Rings are encoded as WKB directly, which is faster than by shapely.
EXTRACTRS = """
import json, struct, sys, time
import numpy, rasterio, extractrs
with rasterio.open(sys.argv[1]) as raster:
    cells, bounds, (dx, dy) = raster.read(1).astype(float), raster.bounds, raster.res
    nodata = raster.nodata if raster.nodata is not None else -1e300
def wkb(rings):
    parts = [struct.pack("<I", len(ring)) + numpy.array(ring, "<f8").tobytes() for ring in rings]
    return struct.pack("<BII", 1, 3, len(rings)) + b"".join(parts)
zones = [wkb(f["geometry"]["coordinates"]) for f in json.load(open(sys.argv[2]))["features"]]
began = time.process_time()
cache = extractrs.build_cache(zones, list(range(len(zones))), *bounds, dx, dy)
means = extractrs.apply_stat(cache, cells, nodata, "mean")
print(time.process_time() - began, file=sys.stderr)
print(json.dumps(means.tolist()))
"""


def in_own_process(work, *words):
    """Runs work in a separate process, whose memory does not count."""
    with ProcessPoolExecutor(1, get_context("fork")) as pool:
        return pool.submit(work, *words).result()


def zones(raster, name, count, radii, cell):
    """Returns stars of random sizes, in the raster's coordinate system, reproducible. Without radii
    all are large and spiky, as in features.py."""
    path = WORK / f"{name}.geojson"
    info = json.loads(subprocess.check_output(["gdalinfo", "-json", raster]))
    left, width, _, top, _, height = info["geoTransform"]
    columns, rows = info["size"]
    rng = random.Random(1)

    def star():
        radius = math.exp(rng.uniform(*map(math.log, radii))) if radii else 110
        x, y = left + rng.uniform(0.05, 0.95) * columns * width, top + rng.uniform(0.1, 0.9) * rows * height
        corners = rng.randrange(8, 60)
        least = 0.5 if radii else 0.3
        away = [(radius * cell * rng.uniform(least, 1), 2 * math.pi * number / corners) for number in range(corners)]
        ring = [[x + reach * math.cos(turn), y + reach * math.sin(turn)] for reach, turn in away]
        return {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}}

    path.write_text(json.dumps({"type": "FeatureCollection", "features": [star() for _ in range(count)]}))
    return path


def ours(made, path, times=3):
    out, words = WORK / "zones.json", [SPINNEY, "-q", "stats", made, "--zones", path, "--edge", "area", "--json"]
    with open(out, "w") as file:
        once(words, stdout=file)
    # Each run writes its own file, as theirs does.
    measured = runs(words, times, stdout=open(WORK / "again.json", "w"))
    return measured, out


def theirs(code, *words):
    out = WORK / "theirs.json"
    with open(out, "w") as file:
        measured = once([PYTHON, "-c", code, *words], stdout=file)
    return measured, out


def compared(job, peer, mine, other, off, target):
    record("zonal statistics", costs(job, mine, peer, other, wall=False, memory=False, note="Peer with the interpreter and rasterio."))
    rows = [[name, *(f"{v:.3f}" for v in measured)] for name, measured in (("ours", mine), (peer, other))]
    table([job, "CPU s", "wall s", "MiB"], [*rows, ["ours / theirs", verdict(mine[0] / other[0], target, False), "", f"results differ by {off:.2g} at most"]])


def shoreline():
    made = WORK / "shoreline.goblin"
    tree(SHORELINE, made)
    path = in_own_process(zones, SHORELINE, "shoreline_zones", 10_000, (30, 1000), 1 / 120)
    mine, found = ours(made, path)
    other, areas = theirs(CLASSES, SHORELINE, path)
    off = in_own_process(areas_differ, found, areas)
    compared("class areas of 10,000 zones, shoreline", "exactextract", mine, other, off, 1 / 50)


def areas_differ(found, areas):
    void = str(json.loads(subprocess.check_output(["gdalinfo", "-json", SHORELINE]))["bands"][0].get("noDataValue"))
    off = 0.0
    for zone, area in zip(json.loads(found.read_text())["zones"], json.loads(areas.read_text())):
        cells = {str(each["value"]): each["cells"] for each in zone["classes"]}
        for value in {*cells, *area} - {void}:
            off = max(off, abs(cells.get(value, 0) - area.get(value, 0)) / (1 + area.get(value, 0)))
    return off


def means_differ(found, means):
    channels = (zone["channels"] for zone in json.loads(found.read_text())["zones"])
    mine = [first[0]["mean"] if first else math.nan for first in channels]
    return max(abs(a - b) for a, b in zip(mine, json.loads(means.read_text())) if b is not None and not math.isnan(b))


def relief(count, radii, peer, code, target):
    made = WORK / "relief.goblin"
    tree(RELIEF, made)
    path = in_own_process(zones, RELIEF, f"relief_zones_{count}", count, radii, 1 / 12)
    mine, found = ours(made, path)
    other, means = theirs(code, RELIEF, path)
    compared(f"means of {count:,} {'' if radii else 'large '}zones, relief", peer, mine, other, in_own_process(means_differ, found, means), target)


JOBS = {
    "shoreline": shoreline,
    "relief": lambda: relief(10_000, (10, 150), "exactextract", MEANS, 1 / 5),
    "extractrs": lambda: relief(1_000, None, "extractrs", EXTRACTRS, 1 / 4),
}


def main():
    start()
    for name in sys.argv[1:] or JOBS:
        JOBS[name]()


main()
