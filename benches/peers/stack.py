#!/usr/bin/env python3
"""Layers: a stack of 13 bands of 16 bits against `gdalbuildvrt -separate` and a COG; windows of a
band against rasterio; NDVI against `gdal_calc.py`; means of zones in a series of 100 rasters
against exactextract.

    pip install numpy rasterio exactextract
    SPINNEY=target/release/spinney python benches/peers/stack.py [SIDE]

The bands are made of ../shared/data/raster/large/earth_8192x4096_rgb.jpg with noise, on the grids
of Sentinel-2: SIDE pixels of 10 m (10980), and half and a sixth as many of 20 and 60 m. Windows are
read by Python on both sides, by the package `spinney` of PYTHON (default: this Python).
"""

import json
import os
import random
import subprocess
import sys

from common import EARTH, SPINNEY, WORK, costs, once, record, row, runs, start, table, verdict

SIDE = int(sys.argv[1]) if len(sys.argv) > 1 else 10980
BANDS = {"B02": 1, "B03": 1, "B04": 1, "B08": 1, "B05": 2, "B06": 2, "B07": 2, "B8A": 2, "B11": 2, "B12": 2, "B01": 6, "B09": 6, "B10": 6}
PYTHON = os.environ.get("PYTHON", sys.executable)

MAKE = """
import sys, numpy as np, rasterio
from rasterio.enums import Resampling
from rasterio.transform import Affine
source, target, number, side, factor = sys.argv[1], sys.argv[2], *map(int, sys.argv[3:])
size = side // factor
random = np.random.default_rng(number)
with rasterio.open(source) as raster:
    window = rasterio.windows.Window(2000 + 20 * number, 500, 2745, 2745)
    light = raster.read(1 + number % 3, window=window, out_shape=(size, size), resampling=Resampling.bilinear)
cells = light.astype(np.float32) * 30 + 1000 + random.normal(0, 8, (size, size)).astype(np.float32)
place = Affine(10 * factor, 0, 300000, 0, -10 * factor, 4900020)
with rasterio.open(target, "w", driver="GTiff", width=size, height=size, count=1, dtype="uint16", crs="EPSG:32633", transform=place,
                   tiled=True, blockxsize=512, blockysize=512, compress="deflate", predictor=2, zlevel=1, nodata=0) as out:
    out.write(cells.clip(1, 65535).astype(np.uint16), 1)
"""

WINDOWS = """
import random, sys, time
kind, path, side = sys.argv[1], sys.argv[2], int(sys.argv[3])
rng = random.Random(5)
positions = [(rng.randrange(side - 256), rng.randrange(side - 256)) for _ in range(2000)]
if kind == "ours":
    import spinney
    band = spinney.open(path)["B08"]
    read = lambda x, y: band.read(window=(x, y, 256, 256))
else:
    import rasterio
    from rasterio.windows import Window
    raster = rasterio.open(path)
    read = lambda x, y: raster.read(4, window=Window(x, y, 256, 256))
for x, y in positions:
    read(x, y)
began = time.process_time()
for x, y in positions:
    read(x, y)
print(len(positions) / (time.process_time() - began))
"""

SERIES = """
import json, sys, numpy as np, rasterio
from rasterio.transform import Affine
directory, count, side = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
random = np.random.default_rng(7)
y, x = np.mgrid[0:side, 0:side]
for number in range(count):
    cells = 2000 + 1000 * np.sin(x / 90 + number / 9) + 800 * np.cos(y / 70) + random.normal(0, 20, x.shape)
    with rasterio.open(f"{directory}/t{number:03}.tif", "w", driver="GTiff", width=side, height=side, count=1, dtype="uint16", crs="EPSG:32633",
                       transform=Affine(10, 0, 300000, 0, -10, 5000000), tiled=True, compress="deflate", predictor=2) as out:
        out.write(cells.astype(np.uint16), 1)
"""

EXTRACT = """
import json, sys
from exactextract import exact_extract
zones = json.load(open(sys.argv[1]))["features"]
means = [[f["properties"]["mean"] for f in exact_extract(path, zones, ["mean"])] for path in sys.argv[2:]]
print(json.dumps(means))
"""


def python(code, *words):
    return subprocess.run([PYTHON, "-c", code, *map(str, words)], check=True, stdout=subprocess.PIPE, text=True).stdout


def stack():
    files = []
    for number, (band, factor) in enumerate(BANDS.items()):
        path = WORK / f"{band}.tif"
        if not path.exists():
            python(MAKE, EARTH, path, number, SIDE, factor)
        files.append(path)
    tree, vrt, cog = WORK / "stack.goblin", WORK / "stack.vrt", WORK / "stack_zstd.tif"
    a = runs([SPINNEY, "-q", "build", *files, "-o", tree, "--stack", "--memory", "192MiB"], 3)
    one = once([SPINNEY, "-q", "--threads", "1", "build", *files, "-o", tree, "--stack", "--memory", "192MiB"])
    once(["gdalbuildvrt", "-q", "-separate", "-resolution", "highest", vrt, *files])
    options = ["COMPRESS=ZSTD", "PREDICTOR=YES", "OVERVIEW_RESAMPLING=AVERAGE", "BIGTIFF=YES"]
    words = [word for option in options for word in ("-co", option)]
    b = runs(["gdal_translate", "-q", "-of", "COG", *words, vrt, cog], 1)
    sizes = [path.stat().st_size / 1e6 for path in (tree, cog)]
    job, peer = "13 bands of u16", "gdalbuildvrt and GDAL COG, ZSTD"
    results = [*costs(job, a, peer, b), row(f"{job}: bytes", "MB", sizes[0], peer, sizes[1]), row(f"{job}, 1 thread", "CPU s", one[0])]
    table(
        ["13 x u16", "CPU s", "wall s", "MiB", "MB", "CPU, 1 thread"],
        [["ours", *(f"{v:.2f}" for v in a), f"{sizes[0]:.0f}", f"{one[0]:.2f}"],
         ["gdalbuildvrt + COG ZSTD", *(f"{v:.2f}" for v in b), f"{sizes[1]:.0f}", ""],
         ["ours / theirs", verdict(a[0] / b[0], 1 / 4, False), f"{a[1] / b[1]:.3g}", f"{a[2]:.0f} ({'met' if a[2] <= 256 else 'MISSED'})", "", ""]],
    )
    return tree, cog, results


def windows(tree, cog):
    ours, theirs = (float(python(WINDOWS, kind, path, SIDE)) for kind, path in (("ours", tree), ("theirs", cog)))
    table(["windows of B08, 256 x 256, warm", "per s of CPU"],
          [["ours", f"{ours:.0f}"], ["rasterio on the COG", f"{theirs:.0f}"], ["ours / theirs", verdict(ours / theirs, 1.5)]])
    note = "Peer's file is pixel-interleaved."
    return [row("windows of B08, 256 x 256, warm, from Python", "/s", ours, "rasterio, COG", theirs, note=note)]


def ndvi(tree, cog):
    ratio = "calc=(B08-B04)/(B08+B04)"
    screen = runs([SPINNEY, "-q", "get", tree, WORK / "ndvi.npy", "--view", ratio, "--size", "1024"], 3)
    file = runs([SPINNEY, "-q", "transform", tree, ratio, "-o", WORK / "ndvi.goblin"], 3)
    bands = ["-A", cog, "--A_band=4", "-B", cog, "--B_band=3", "--calc=(A.astype(numpy.float32)-B)/(A.astype(numpy.float32)+B)"]
    calc = runs(["gdal_calc.py", "--quiet", "--overwrite", *bands, "--type=Float32", f"--outfile={WORK / 'ndvi.tif'}"], 1)
    table(["NDVI", "CPU s", "wall s", "MiB", "ours / gdal_calc"],
          [["ours, 1024 pixels", *(f"{v:.2f}" for v in screen), verdict(screen[0] / calc[0], 1 / 20, False)],
           ["ours, a file with all levels", *(f"{v:.2f}" for v in file), verdict(file[0] / calc[0], 1 / 3, False)],
           ["gdal_calc.py", *(f"{v:.2f}" for v in calc), ""]])
    return [*costs("NDVI, 1024 pixels", screen, "gdal_calc", calc, wall=False), *costs("NDVI, a file with all levels", file, "gdal_calc", calc)]


def series(count=100, side=1000):
    directory = WORK / "series"
    directory.mkdir(exist_ok=True)
    files = [directory / f"t{number:03}.tif" for number in range(count)]
    if not files[-1].exists():
        python(SERIES, directory, count, side)
    rng = random.Random(3)
    squares = []
    for number in range(1000):
        x, y = 300000 + rng.uniform(200, 10 * side - 700), 5000000 - rng.uniform(700, 10 * side - 200)
        ring = [[x, y], [x + rng.uniform(50, 500), y + rng.uniform(0, 90)], [x + rng.uniform(50, 500), y + rng.uniform(100, 500)], [x, y]]
        squares.append({"type": "Feature", "properties": {"id": number}, "geometry": {"type": "Polygon", "coordinates": [ring]}})
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32633"}}
    zones = WORK / "zones.geojson"
    zones.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": squares}))
    tree = WORK / "series.goblin"
    once([SPINNEY, "-q", "build", *files, "-o", tree, "--stack"])
    with open(WORK / "means.csv", "w") as out:
        a = once([SPINNEY, "-q", "stats", tree, "--zones", zones, "--edge", "area", "--csv"], stdout=out)
    with open(WORK / "centre.csv", "w") as out:
        centre = once([SPINNEY, "-q", "stats", tree, "--zones", zones, "--csv"], stdout=out)
    with open(WORK / "means.json", "w") as out:
        b = once([PYTHON, "-c", EXTRACT, zones, *files], stdout=out)
    opened = runs([SPINNEY, "-q", "point", tree, "500,500"], 5)
    table(["100 layers", "CPU s", "wall s", "MiB", "ours / exactextract"],
          [["means of 1,000 zones, shares of cells", *(f"{v:.2f}" for v in a), verdict(a[0] / b[0], 1 / 10, False)],
           ["the same by centres of cells", *(f"{v:.2f}" for v in centre), f"{centre[0] / b[0]:.3g}"],
           ["exactextract, each file", *(f"{v:.2f}" for v in b), ""],
           ["a point of all layers, the whole program", *(f"{v:.4f}" for v in opened), ""]])
    job, point = "means of 1,000 zones of 100 layers", "a point of 100 layers"
    return [
        *costs(f"{job}, by area", a, "exactextract", b, wall=False),
        *costs(f"{job}, by centres", centre, "exactextract", b, wall=False),
        row(f"{point}, whole program", "CPU s", opened[0]),
        row(f"{point}: memory", "MiB", opened[2]),
    ]


def main():
    start()
    tree, cog, results = stack()
    results += [*windows(tree, cog), *ndvi(tree, cog), *series()]
    # Jobs are named for the default.
    if SIDE == 10980:
        record("layers", results)


main()
