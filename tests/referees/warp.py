#!/usr/bin/env python3
"""Warped rasters against GDAL's warper, cell by cell.

    python tests/referees/warp.py PATH/TO/spinney FOLDER

Needs rasterio (and with it NumPy), and GDAL's programs, without which it says that it is skipped. Cells of the target are smaller than those of the source, so that GDAL's kernels are not
stretched. Fails at the first raster that differs.
"""

import math
import pathlib
import shutil
import subprocess
import sys

import numpy
import rasterio
from rasterio.transform import Affine
from rasterio.warp import transform_bounds

program, folder = sys.argv[1], pathlib.Path(sys.argv[2])
HALF = 20037508.342789244
WAYS = {"nearest": "near", "bilinear": "bilinear", "cubic": "cubic"}


def run(*words):
    subprocess.run([program, "-q", *map(str, words)], check=True)


def compare(name, crs, transform, zoom, kind="int16"):
    """A raster of noise over waves, warped by both."""
    rows, columns = numpy.mgrid[0:150, 0:200]
    noise = numpy.random.default_rng(7).integers(0, 400, rows.shape)
    values = (2000 * numpy.sin(columns / 17) * numpy.cos(rows / 23) + noise).astype(kind)
    source = folder / f"{name}.tif"
    profile = dict(driver="GTiff", width=200, height=150, count=1, dtype=kind, crs=crs, transform=transform)
    with rasterio.open(source, "w", **profile) as file:
        file.write(values, 1)
        bounds = transform_bounds(crs, "EPSG:3857", *file.bounds)
    cell = 2 * HALF / 2 ** (zoom + 8)
    first = [math.floor((bounds[0] + HALF) / cell) - 3, math.floor((HALF - bounds[3]) / cell) - 3]
    size = [math.ceil((bounds[2] + HALF) / cell) + 3 - first[0], math.ceil((HALF - bounds[1]) / cell) + 3 - first[1]]
    west, north = first[0] * cell - HALF, HALF - first[1] * cell
    box = [west, north - size[1] * cell, west + size[0] * cell, north]
    for way, resampling in WAYS.items():
        tree, array = folder / f"{name}.goblin", folder / f"{name}.npy"
        run("build", source, "-o", tree, "--grid", "xyz", "--max-zoom", zoom, "--resampling", way)
        run("get", tree, array, "--window", ",".join(map(str, first + size)), "--nodata", "-32768")
        ours = numpy.load(array)
        warped = folder / f"{name}_{way}.tif"
        options = ["-q", "-overwrite", "-r", resampling, "-et", "0", "-wo", "XSCALE=1", "-wo", "YSCALE=1"]
        target = ["-t_srs", "EPSG:3857", "-te", *box, "-ts", *size, "-dstnodata", "-32768"]
        subprocess.run(["gdalwarp", *options, *map(str, target), source, warped], check=True)
        with rasterio.open(warped) as file:
            theirs = file.read(1)
        differ = numpy.abs(ours.astype(numpy.int64) - theirs)
        # (At ties of rounding a ten-thousandth of a cell decides.)
        share = numpy.count_nonzero(differ) / differ.size
        inside = numpy.minimum(ours, theirs) > -32768
        assert share < 5e-3, f"{name} {way}: {share:.2%} of {differ.size} cells differ"
        assert way == "nearest" or differ[inside].max() <= 1, f"{name} {way}: by {differ[inside].max()}"
        assert inside.any()
        print(f"{name}, {way}: {numpy.count_nonzero(differ)} of {differ.size} cells differ")


if shutil.which("gdalwarp") is None:
    print("skipped: no gdalwarp")
    sys.exit()
folder.mkdir(exist_ok=True)
compare("utm", "EPSG:32632", Affine(30, 0, 400000, 0, -30, 5400000), 13)
compare("degrees", "EPSG:4326", Affine(0.01, 0, 7, 0, -0.01, 47), 8)
compare("turned", "EPSG:3035", Affine(25, 9, 4321000, 8, -25, 3210000), 14)
compare("polar", "EPSG:3413", Affine(1000, 0, -900000, 0, -1000, -1200000), 7)
compare("swiss", "EPSG:2056", Affine(100, 0, 2600000, 0, -100, 1200000), 11)
