#!/usr/bin/env python3
"""Warped rasters against GDAL's warper, cell by cell.

    python tests/referees/warp.py PATH/TO/spinney DIRECTORY

Needs rasterio (and with it NumPy), and GDAL's programs, without which it reports that it is
skipped. Target cells are smaller than source cells, so that GDAL's kernels are not stretched. Fails
at the first raster that differs.
"""

import math
import pathlib
import shutil
import subprocess
import sys

import numpy
import rasterio
from rasterio.transform import Affine
from rasterio.crs import CRS
from rasterio.warp import transform, transform_bounds

program, directory = sys.argv[1], pathlib.Path(sys.argv[2])
HALF = 20037508.342789244
WAYS = {"nearest": "near", "bilinear": "bilinear", "cubic": "cubic"}


def run(*words):
    subprocess.run([program, "-q", *map(str, words)], check=True)


def compare(name, crs, place, zoom, kind="int16", declared=None):
    """Compares a raster of noise over waves, warped by both; `declared` is our coordinate system,
    if the file is to have none."""
    rows, columns = numpy.mgrid[0:150, 0:200]
    noise = numpy.random.default_rng(7).integers(0, 400, rows.shape)
    values = (2000 * numpy.sin(columns / 17) * numpy.cos(rows / 23) + noise).astype(kind)
    source = directory / f"{name}.tif"
    profile = dict(driver="GTiff", width=200, height=150, count=1, dtype=kind, crs=crs, transform=place)
    with rasterio.open(source, "w", **profile) as file:
        file.write(values, 1)
        bounds = transform_bounds(crs, "EPSG:3857", *file.bounds)
    if declared:
        bare = directory / f"{name}_bare.tif"
        with rasterio.open(bare, "w", **{**profile, "crs": None}) as file:
            file.write(values, 1)
    cell = 2 * HALF / 2 ** (zoom + 8)
    first = [math.floor((bounds[0] + HALF) / cell) - 3, math.floor((HALF - bounds[3]) / cell) - 3]
    size = [math.ceil((bounds[2] + HALF) / cell) + 3 - first[0], math.ceil((HALF - bounds[1]) / cell) + 3 - first[1]]
    west, north = first[0] * cell - HALF, HALF - first[1] * cell
    box = [west, north - size[1] * cell, west + size[0] * cell, north]
    for way, resampling in WAYS.items():
        tree, array = directory / f"{name}.goblin", directory / f"{name}.npy"
        here = [bare, "--crs", declared] if declared else [source]
        run("build", *here, "-o", tree, "--grid", "xyz", "--max-zoom", zoom, "--resampling", way)
        run("get", tree, array, "--window", ",".join(map(str, first + size)), "--nodata", "-32768")
        ours = numpy.load(array)
        warped = directory / f"{name}_{way}.tif"
        options = ["-q", "-overwrite", "-r", resampling, "-et", "0", "-wo", "XSCALE=1", "-wo", "YSCALE=1"]
        target = ["-t_srs", "EPSG:3857", "-te", *box, "-ts", *size, "-dstnodata", "-32768"]
        subprocess.run(["gdalwarp", *options, *map(str, target), source, warped], check=True)
        with rasterio.open(warped) as file:
            theirs = file.read(1)
        differ = numpy.abs(ours.astype(numpy.int64) - theirs)
        # At rounding ties a ten-thousandth of a cell decides.
        share = numpy.count_nonzero(differ) / differ.size
        inside = numpy.minimum(ours, theirs) > -32768
        assert share < 5e-3, f"{name} {way}: {share:.2%} of {differ.size} cells differ"
        # At the raster's border the same decides which cells a kernel has.
        different = numpy.count_nonzero(differ[inside] > 1)
        assert way == "nearest" or different <= 2, f"{name} {way}: {different} cells by up to {differ[inside].max()}"
        assert inside.any()
        print(f"{name}, {way}: {numpy.count_nonzero(differ)} of {differ.size} cells differ")


if shutil.which("gdalwarp") is None:
    print("skipped: no gdalwarp")
    sys.exit()
directory.mkdir(exist_ok=True)
compare("utm", "EPSG:32632", Affine(30, 0, 400000, 0, -30, 5400000), 13)
compare("degrees", "EPSG:4326", Affine(0.01, 0, 7, 0, -0.01, 47), 8)
compare("turned", "EPSG:3035", Affine(25, 9, 4321000, 8, -25, 3210000), 13)
compare("polar", "EPSG:3413", Affine(1000, 0, -900000, 0, -1000, -1200000), 6)
compare("swiss", "EPSG:2056", Affine(100, 0, 2600000, 0, -100, 1200000), 11)

# Coordinate systems without an EPSG code: user-defined keys as GDAL writes them into the file, at a
# longitude and a latitude. (Not gnomonic, which PROJ before 9.2 supports only on spheres.)
BESSEL = "+ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7"
DEFINED = {
    "transverse_mercator": ("+proj=tmerc +lat_0=49 +lon_0=11.3 +k=0.99985 +x_0=300000 +y_0=10 " + BESSEL, 11, 50),
    "utm_in_feet": ("+proj=utm +zone=32 +datum=WGS84 +units=ft", 10, 47),
    "albers_us_feet": ("+proj=aea +lat_0=23 +lon_0=-96 +lat_1=29.5 +lat_2=45.5 +x_0=1000 +datum=NAD83 +units=us-ft", -100, 40),
    "conic_two": ("+proj=lcc +lat_0=40 +lon_0=5 +lat_1=43 +lat_2=62 +datum=WGS84", 8, 50),
    "conic_paris": ("+proj=lcc +lat_0=46.8 +lon_0=0 +lat_1=46.8 +k_0=0.9998 +ellps=clrk80ign +pm=paris +towgs84=-168,-60,320", 3, 47),
    "conic_equidistant": ("+proj=eqdc +lat_0=10 +lon_0=-61 +lat_1=20 +lat_2=30 +datum=WGS84", -60, 15),
    "equal_area": ("+proj=laea +lat_0=52 +lon_0=10 +datum=WGS84", 12, 48),
    "equidistant": ("+proj=aeqd +lat_0=30 +lon_0=5 +datum=WGS84", 7, 33),
    "polar_stereographic": ("+proj=stere +lat_0=-90 +lat_ts=-71 +lon_0=30 +datum=WGS84", 40, -70),
    "stereographic": ("+proj=sterea +lat_0=52.15 +lon_0=5.38 +k=0.9999 +x_0=155000 +y_0=463000 +ellps=bessel +towgs84=565,50,465", 5, 52),
    "oblique_centre": ("+proj=omerc +lat_0=4 +lonc=102.25 +alpha=323.02 +gamma=323.13 +k=0.99984 +x_0=804671 +datum=WGS84", 102, 5),
    "oblique_origin": ("+proj=omerc +no_uoff +lat_0=4 +lonc=102.25 +alpha=323.02 +gamma=323.13 +k=0.99984 +datum=WGS84", 102, 5),
    "cassini": ("+proj=cass +lat_0=10 +lon_0=-61 +datum=WGS84", -61, 11),
    "polyconic": ("+proj=poly +lat_0=10 +lon_0=-61 +datum=WGS84", -60, 12),
    "mercator_parallel": ("+proj=merc +lat_ts=30 +datum=WGS84", 20, 30),
    "mercator_scale": ("+proj=merc +k=0.9 +lon_0=100 +datum=WGS84", 120, 30),
    "cylindrical": ("+proj=cea +lat_ts=30 +datum=WGS84", 20, 30),
    "equirectangular": ("+proj=eqc +lat_ts=30 +datum=WGS84", 20, 30),
    "robinson": ("+proj=robin +lon_0=10 +datum=WGS84", 20, 30),
    "mollweide": ("+proj=moll +lon_0=10 +datum=WGS84", 20, 30),
    "sinusoidal": ("+proj=sinu +lon_0=10 +datum=WGS84", 20, 30),
    "web_mercator": ("+proj=merc +a=6378137 +b=6378137 +lat_ts=0 +lon_0=0 +x_0=0 +y_0=0 +k=1 +units=m +nadgrids=@null", 20, 30),
}
for name, (definition, longitude, latitude) in DEFINED.items():
    crs = CRS.from_string(definition)
    (x,), (y,) = transform("EPSG:4326", crs, [longitude], [latitude])
    cell = 100 / crs.linear_units_factor[1]
    place = Affine(cell, 0, x, 0, -cell, y)
    compare(name, crs, place, 10 if name == "polar_stereographic" else 11)
    if name in ("transverse_mercator", "albers_us_feet", "conic_paris"):
        compare(f"{name}_declared", crs, place, 11, declared=definition)
        compare(f"{name}_text", crs, place, 11, declared=crs.to_wkt())
compare("degrees_hayford", "+proj=longlat +ellps=intl +towgs84=-87,-98,-121", Affine(0.01, 0, 7, 0, -0.01, 47), 8)
