#!/usr/bin/env python3
"""Operations: `spinney combine` and `spinney transform`, file to file, against rasterio + NumPy,
GDAL and cp.

Where processor time (user and system) counts, both sides get one core. Where cp is the peer, wall
time counts and neither is pinned. Files are in the system's cache. GDAL runs with its default block
cache, for speed and as most users run it, and with one of 64 MB, which takes less memory and often
less system time. Results are compared: every cell, and the cells of each class as counted by
`spinney stats`.
"""

import json
import math
import os
import statistics
import subprocess
import sys

from common import SHORELINE, SPINNEY, WORK, costs, once, record, row, runs, start, table, tree, verdict

WIDTH, HEIGHT = 43200, 21600

# All NumPy code runs in separate processes: see `once`.
COMMON = r"""
import json, subprocess, sys
import numpy, rasterio
from rasterio.windows import Window

def create(path, **more):
    # Plain tiled files, no overviews.
    return rasterio.open(path, "w", driver="GTiff", count=1, dtype="uint8", tiled=True, blockxsize=512,
                         blockysize=512, compress="zstd", BIGTIFF="IF_SAFER", **more)

def strips(width, height, step=512):
    return [Window(0, top, width, min(step, height - top)) for top in range(0, height, step)]
"""

# B: A moved right and down by so many cells, filled with 0.
SHIFT = COMMON + r"""
target, source, right, down = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
with rasterio.open(source) as file:
    cells = file.read(1)
    moved = numpy.zeros_like(cells)
    moved[down:, right:] = cells[:-down, :-right]
    with create(target, width=file.width, height=file.height, crs=file.crs, transform=file.transform, nodata=0) as out:
        out.write(moved, 1)
"""

# No merging is possible: the same share of each of 12 classes everywhere, as in scaling.py.
SPECKLE = COMMON + r"""
target, side = sys.argv[1], int(sys.argv[2])
random = numpy.random.default_rng(1)
pool = random.integers(0, 12, (512, side + 4096), dtype=numpy.uint8)
with create(target, width=side, height=side, zstd_level=1) as file:
    for strip in strips(side, side):
        shift = int(random.integers(0, 4096))
        file.write(pool[random.permutation(512), shift:shift + side], 1, window=strip)
"""

# The peer's set operations, in strips of whole tiles.
SETS = COMMON + r"""
operation = {"union": lambda a, b: numpy.where(a != 0, a, b), "and": lambda a, b: numpy.where(b != 0, a, 0),
             "a-b": lambda a, b: numpy.where(b == 0, a, 0)}[sys.argv[1]]
with rasterio.open(sys.argv[2]) as a, rasterio.open(sys.argv[3]) as b:
    with create(sys.argv[4], width=a.width, height=a.height, crs=a.crs, transform=a.transform, nodata=0) as out:
        for strip in strips(a.width, a.height):
            out.write(operation(a.read(1, window=strip), b.read(1, window=strip)), 1, window=strip)
"""

# The peer's quarter turn, clockwise as ours.
QUARTER = COMMON + r"""
with rasterio.open(sys.argv[1]) as file:
    cells = numpy.rot90(file.read(1), k=-1)
with create(sys.argv[2], width=cells.shape[1], height=cells.shape[0], nodata=0) as out:
    out.write(cells, 1)
"""

# Compares our file with the peer's: the number of differing cells, the total, and whether its class
# counts equal our statistics.
COMPARE = COMMON + r"""
spinney, ours, theirs = sys.argv[1:4]
run_spinney = lambda *words: subprocess.run([spinney, "-q", *words], check=True, stdout=subprocess.PIPE).stdout
size = json.loads(run_spinney("info", ours, "--json"))["size"]
expected = json.loads(run_spinney("stats", ours, "--json"))
differing, counts = 0, numpy.zeros(256, int)
with rasterio.open(theirs) as file:
    if [file.width, file.height] != size:
        sys.exit(f"{ours} has {size} cells, {theirs} has {[file.width, file.height]}")
    for strip in strips(file.width, file.height, 2048):
        window = f"0,{strip.row_off},{strip.width},{strip.height}"
        a = numpy.frombuffer(run_spinney("get", ours, "-", "--format", "raw", "--nodata", "0", "--window", window), numpy.uint8)
        b = file.read(1, window=strip).ravel()
        differing += int(numpy.count_nonzero(a != b))
        counts += numpy.bincount(b, minlength=256)
said = numpy.zeros(256, int)
said[0] = expected["void_cells"]
for entry in expected["classes"]:
    said[int(entry["value"])] += entry["cells"]
print(json.dumps([differing, size[0] * size[1], bool((said == counts).all())]))
"""


def script(text, *words):
    return [sys.executable, "-W", "ignore", "-c", text, *map(str, words)]


def made(target, text, *words):
    """Makes a raster once with NumPy; it gets its name only when complete."""
    if not target.exists():
        part = target.with_name("ops_part.tif")
        subprocess.run(script(text, part, *words), check=True)
        part.replace(target)
    return target


def pinned(command):
    return ["taskset", "-c", str(min(os.sched_getaffinity(0))), *map(str, command)]


def ours(*words):
    return [SPINNEY, "-q", *words]


def json_of(command):
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def info(goblin):
    return json_of(ours("info", goblin, "--json"))


def against(name, command, out, peer, theirs, raster, most, memory=None):
    """Adds rows to the first table: ours against the peer with both caches; pinned."""
    cpu, _, peak = runs(pinned(command))
    rows = []
    for cache in (None, 64):
        setting = ["env", f"GDAL_CACHEMAX={cache}"] if cache else []
        their_cpu, _, their_peak = found = runs([*setting, *pinned(theirs)])
        known = f"{peer}, {'cache 64 MB' if cache else 'default cache'}"
        record("operations on rasters", costs(name, (cpu, None, peak), known, found, wall=False))
        rows.append([name, known, f"{their_cpu:.2f}",
                     f"{their_peak:.0f}", f"{cpu:.2f}",
                     f"{peak:.0f}" + (f" ({'met' if peak <= memory else 'MISSED'})" if memory else ""),
                     verdict(cpu / their_cpu, most, False)])
    differing, cells, equal = json_of(script(COMPARE, SPINNEY, out, raster))
    share = f"{differing} ({differing / cells:.2g})" if differing else "none"
    return [[*row, share, "equal" if equal else "DIFFERENT"] for row in rows]


def copying(name, command, out, most=None):
    """Adds a row to the second table: ours against cp of the result; each writes a new file, to an
    idle disk."""
    copy = WORK / "ops_copy"
    measured = []
    for words, target in ((command, out), (["cp", out, copy], copy)):
        several = []
        for _ in range(min(3, int(os.environ.get("RUNS", 3)))):
            target.unlink(missing_ok=True)
            os.sync()
            several.append(once(words))
        measured.append([statistics.median(column) for column in zip(*several)])
    size = out.stat().st_size
    copy.unlink()
    (cpu, wall, peak), (their_cpu, their_wall, _) = measured
    ratio = wall / their_wall
    known = costs(name, measured[0], "cp", measured[1], memory=False) if most else [row(name, "CPU s", cpu)]
    record("operations on rasters", known)
    return [name, f"{size / 1e6:.0f}", f"{their_cpu:.2f}", f"{their_wall:.2f}", f"{cpu:.2f}", f"{wall:.2f}",
            f"{peak:.0f}", f"{cpu / their_cpu:.3g}", verdict(ratio, most, False) if most else f"{ratio:.3g}"]


def turned(degrees):
    """Returns a raster rotated clockwise about its centre: a VRT with the result's cells as its
    world coordinates, and its size.

    The result's first cell is the corner of the rotated raster's bounding box, rounded outwards.
    """
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    x, y = WIDTH / 2, HEIGHT / 2
    across, down = cos * x + sin * y, sin * x + cos * y
    left, top = math.floor(x - across), math.floor(y - down)
    width, height = math.ceil(x + across) - left, math.ceil(y + down) - top
    first = (x - cos * x + sin * y - left, y - sin * x - cos * y - top)
    # GDAL's northing is upwards: minus our rows.
    place = (first[0], cos, -sin, -first[1], -sin, -cos)
    vrt = WORK / "ops_turned.vrt"
    vrt.write_text(f"""<VRTDataset rasterXSize="{WIDTH}" rasterYSize="{HEIGHT}">
  <GeoTransform>{', '.join(map(repr, place))}</GeoTransform>
  <VRTRasterBand dataType="Byte" band="1">
    <SimpleSource><SourceFilename>{SHORELINE}</SourceFilename><SourceBand>1</SourceBand></SimpleSource>
  </VRTRasterBand>
</VRTDataset>
""")
    return vrt, width, height


def main():
    start()
    out, raster = WORK / "ops_out.goblin", WORK / "ops_out.tif"
    shifted = made(WORK / "ops_b.tif", SHIFT, SHORELINE, 1001, 501)
    a, b = WORK / "ops_a.goblin", WORK / "ops_b.goblin"
    classes = ["--rule", "majority", "--kind", "categorical"]
    tree(SHORELINE, a, *classes, "--nodata", "0")
    tree(shifted, b, *classes, "--nodata", "0")

    rows = []
    for name, what in (("union", "union"), ("intersection", "and"), ("difference", "a-b")):
        rows += against(f"{name} of shorelines", ours("combine", what, a, b, "-o", out), out, "rasterio + NumPy",
                        script(SETS, what, SHORELINE, shifted, raster), raster, 1 / 20, 64)
    cog = ["-of", "COG", "-co", "COMPRESS=ZSTD", "-co", "OVERVIEWS=NONE"]
    rows += against("unaligned window of the shoreline", ours("transform", a, "window=5001,3003,30000,15000", "-o", out), out,
                    "gdal_translate", ["gdal_translate", "-q", "-srcwin", 5001, 3003, 30000, 15000, *cog, SHORELINE,
                                       raster], raster, 1 / 8)
    rows += against("rotate=90 of the shoreline", ours("transform", a, "rotate=90", "-o", out), out, "rasterio + NumPy",
                    script(QUARTER, SHORELINE, raster), raster, 1 / 10)
    vrt, width, height = turned(30)
    # Plain tiles are slightly cheaper than a COG.
    rows += against("rotate=30 --nearest of the shoreline", ours("transform", a, "rotate=30", "--resampling", "nearest", "-o", out), out, "gdalwarp",
                    ["gdalwarp", "-q", "-overwrite", "-r", "near", "-te", 0, -height, width, 0, "-ts", width, height,
                     "-dstnodata", 0, "-co", "TILED=YES", "-co", "COMPRESS=ZSTD", vrt, raster], raster, 1 / 3)
    table(["operation", "peer", "peer CPU s", "peer MiB", "ours CPU s", "ours MiB", "CPU ours / peer",
           "cells that differ", "cells of each class"], rows)

    # Some 90 million records that cannot be omitted.
    big, moved, left, right = (WORK / f"ops_{name}.goblin" for name in ("big", "nested", "left", "right"))
    if not big.exists():
        tree(made(WORK / "ops_big.tif", SPECKLE, 1 << 14), big, *classes)
        (WORK / "ops_big.tif").unlink()
    once(["cat", big])  # Load into the system's cache.
    rows = [copying("aligned window of 8192 x 8192, speckle, 191 MB", ours("transform", big, "window=8192,0,8192,8192", "-o", out), out, 1.5),
            copying("nest=/0, speckle, 764 MB", ours("transform", big, "nest=/0", "-o", moved), moved, 1.5)]
    moved.unlink()
    once(ours("transform", big, "window=0,0,8192,16384", "-o", left))
    once(ours("transform", big, "window=8192,0,8192,16384", "-o", right))
    rows.append(copying("union of two halves, 764 MB", ours("combine", "union", left, right, "-o", out), out))
    same = info(out)["classes"] == info(big)["classes"]
    table(["operation", "result MB", "cp CPU s", "cp wall s", "ours CPU s", "ours wall s", "ours MiB", "CPU ours / cp",
           "wall ours / cp"], rows)
    print(f"The halves' union has the classes of the whole: {'yes' if same else 'NO'}\n")
    for path in (left, right):
        path.unlink()

    # The records of the trees, without additional copies in a file.
    records = sum(info(path)["records"] for path in (a, b))
    cpu = runs(pinned(ours("--threads", "1", "combine", "union", a, b, "-o", out)))[0]
    print(f"Union of the shorelines: {verdict(records / cpu / 1e6, 20)} million records read per CPU second, "
          f"{records / 1e6:.2f} million in {cpu:.2f} s")
    for path in (out, raster, vrt):
        path.unlink(missing_ok=True)


main()
