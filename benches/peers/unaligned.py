#!/usr/bin/env python3
"""Reading: random 256 x 256 windows at random positions (not aligned to tiles) of random levels;
one thread.

For rasterio, either all tiles that are read are in GDAL's cache, or the cache has 64 MB;
TensorStore reads zarr3 arrays of 256 x 256 chunks, one per level, from its own cache. Ours are
plain Goblin and Autumnal files, mapped. All read the same windows on one core; times are processor
time.
"""

import os
import random
import subprocess
import sys

import numpy
import rasterio
from common import EARTH, RELIEF, SHORELINE, WORK, cog, record, row, start, table, tree, verdict
from windows import listed, peer, pinned, rates

# A pyramid of zarr3 arrays of the COG's levels, read from TensorStore's cache.
TENSORSTORE = r"""
import sys, time
import numpy, rasterio, tensorstore
path, listed, directory = sys.argv[1:4]
files = [rasterio.open(path)]
files += [rasterio.open(path, OVERVIEW_LEVEL=level) for level in range(len(files[0].overviews(1)))]
context = tensorstore.Context({"cache_pool": {"total_bytes_limit": 4 << 30}, "data_copy_concurrency": {"limit": 1}})
arrays = []
for up, file in enumerate(files):
    values = file.read()
    spec = {"driver": "zarr3", "kvstore": {"driver": "file", "path": f"{directory}/{up}"},
            "recheck_cached_data": False,
            "metadata": {"shape": values.shape, "data_type": str(values.dtype),
                         "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [len(values), 256, 256]}}}}
    array = tensorstore.open(spec, create=True, delete_existing=True, context=context).result()
    array.write(values).result()
    array.read().result()
    arrays.append(array)
with open(listed) as lines:
    positions = [tuple(map(int, line.split())) for line in lines]
rates = []
for turn in range(3):
    began = time.process_time()
    for up, column, row in positions[:1000]:
        arrays[up][:, row:row + 256, column:column + 256].read().result()
    rates.append(min(1000, len(positions)) / (time.process_time() - began))
print(sorted(rates)[1])
"""


def tensorstore(path, windows_file, name):
    command = pinned([sys.executable, "-W", "ignore", "-c", TENSORSTORE, path, windows_file, WORK / f"{name}.zarr"])
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def noise():
    """A raster of bytes with uncorrelated cells."""
    path = WORK / "noise.tif"
    if not path.exists():
        values = numpy.random.default_rng(1).integers(0, 256, (4096, 8192), dtype=numpy.uint8)
        with rasterio.open(path, "w", driver="GTiff", height=4096, width=8192, count=1, dtype="uint8") as file:
            file.write(values, 1)
    return path


def main():
    start()
    rows, results = [], []
    # The target rates, and target ratios to rasterio from its cache, with 64 MB of it, and to
    # TensorStore.
    cases = [
        ("relief", RELIEF, "mean", 30_000, 0.7, None, 3),
        ("earth", EARTH, "mean", 25_000, 1.4, 5, 3),
        ("shoreline", SHORELINE, "majority", 60_000, None, None, None),
        ("noise", noise(), "mean", 60_000, None, None, 3),
    ]
    for name, source, rule, rate, cached, small, store in cases:
        resampling = {"mean": "AVERAGE", "majority": "MODE"}[rule]
        raster = WORK / f"{name}_zstd.tif"
        cog(source, raster, "COMPRESS=ZSTD", f"OVERVIEW_RESAMPLING={resampling}")
        windows_file = listed(raster, name, aligned=False)
        ours = {}
        for format in ("goblin", "autumn"):
            tree(source, WORK / f"{name}.{format}", "--rule", rule)
            ours[format] = rates(WORK / f"{name}.{format}", "--only", "windows", "--windows", windows_file)[1]["windows"]
        windows = ours["goblin"]
        rows.append([name, "-", "-", f"{windows:.0f}", verdict(windows, rate)])
        slower = windows / ours["autumn"]
        rows.append([name, "the same, .autumn", f"{ours['autumn']:.0f}", f"{windows:.0f}", verdict(slower, 1.5, False)])
        peers = [("rasterio, COG, all in GDAL's cache", lambda: peer(raster, windows_file, "again", 4096), cached),
                 ("rasterio, COG, cache 64 MB", lambda: peer(raster, windows_file, "other", 64), small)]
        if name != "shoreline":
            peers.append(("TensorStore, all in its cache", lambda: tensorstore(raster, windows_file, name), store))
        for what, measure, aim in peers:
            theirs = measure()
            ratio = windows / theirs
            results.append(row(f"unaligned windows of 256 x 256, {name}", "/s", windows, what, theirs))
            rows.append([name, what, f"{theirs:.0f}", f"{windows:.0f}", verdict(ratio, aim) if aim else f"{ratio:.3g}"])
    table(["raster", "peer", "peer/s", "ours/s", "ours / peer"], rows)
    record("windows and points", results)


if __name__ == "__main__":
    main()
