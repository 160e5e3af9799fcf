#!/usr/bin/env python3
"""Cloud-optimized GeoTIFF as rio-cogeo, rasterio and GDAL's driver read it, against `spinney get`
of every level.

    python tests/referees/cog.py PATH/TO/spinney DIRECTORY

Needs rio-cogeo (and with it rasterio and NumPy). Fails at the first difference.
"""

import pathlib
import shutil
import subprocess
import sys

import numpy
import rasterio
from rio_cogeo.cogeo import cog_validate

program, directory = sys.argv[1], pathlib.Path(sys.argv[2])
fixtures = pathlib.Path(__file__).resolve().parents[2] / "fixtures" / "v1"


def run(*words):
    subprocess.run([program, "-q", *map(str, words)], check=True)


def made(name, array, nodata=None, colours=None, *options):
    """Builds a tree of an array, located in Switzerland."""
    if array.ndim == 2:
        array = array[None]
    source, tree = directory / f"{name}_in.tif", directory / f"{name}.goblin"
    bands, height, width = array.shape
    place = rasterio.transform.from_origin(2_600_000, 1_200_000, 10, 10)
    profile = dict(driver="GTiff", width=width, height=height, count=bands, dtype=array.dtype, nodata=nodata)
    with rasterio.open(source, "w", crs="EPSG:2056", transform=place, **profile) as file:
        file.write(array)
        if colours:
            file.write_colormap(1, colours)
    run("build", source, "-o", tree, *options)
    return tree


def check(tree, *options):
    out = tree.with_suffix(".cog.tif")
    run("export", tree, out, *options)
    is_valid, errors, warnings = cog_validate(str(out), strict=True)
    assert is_valid and not errors and not warnings, (tree, errors, warnings)
    with rasterio.open(out) as file:
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG", tree
        factors = file.overviews(1)
        for band in file.indexes:
            assert "STATISTICS_MEAN" in file.tags(band), tree
        # Rasterio's statistics of the samples equal the tree's.
        cells = file.read(1, masked=True)
        if cells.count():
            assert float(file.tags(1)["STATISTICS_MINIMUM"]) == cells.min(), tree
            assert float(file.tags(1)["STATISTICS_MAXIMUM"]) == cells.max(), tree
            assert numpy.isclose(float(file.tags(1)["STATISTICS_MEAN"]), cells.mean(dtype=numpy.float64)), tree
        profile = file.profile
    depth = int(subprocess.run([program, "info", "--json", str(tree)], check=True, capture_output=True,
                               text=True).stdout.split('"depth":')[1].split(",")[0])
    for number in range(len(factors) + 1):
        more = {"OVERVIEW_LEVEL": number - 1} if number else {}
        array = directory / "level.tif"
        run("get", tree, array, "--level", depth - number)
        with rasterio.open(out, **more) as ours, rasterio.open(array) as expected:
            assert ours.shape == expected.shape, (tree, number)
            samples, wanted = ours.read(), expected.read()
            shown, visible = ours.dataset_mask() > 0, expected.dataset_mask() > 0
            if ours.nodata is not None or expected.nodata is None:
                same = (samples == wanted) | (samples != samples) & (wanted != wanted)
                assert same.all(), (tree, number)
            if expected.nodata is not None:
                assert (shown == visible).all(), (tree, number)
    print(f"{tree.stem}: {1 + len(factors)} levels, {profile['width']} x {profile['height']} {profile['dtype']}")
    return out


random = numpy.random.default_rng(1)
rows, columns = numpy.mgrid[0:1300, 0:1700]
waves = (numpy.sin(rows / 90) + numpy.cos(columns / 130)) * 900
holes = (rows // 100 + columns // 170) % 5 == 0
check(made("relief", numpy.where(holes, -32768, waves).astype("int16"), -32768))
check(made("continuous", numpy.where(holes, numpy.nan, waves).astype("float32"), numpy.nan), "--compression", "zstd")
classes = (numpy.abs(waves) // 400 + 1).astype("uint8")
colours = {value: (40 * value, 255 - 40 * value, 90, 255) for value in range(6)}
out = check(made("classes", classes, None, colours, "--rule", "majority"), "--tile-size", "256")
with rasterio.open(out) as file:
    assert file.crs.to_epsg() == 2056 and file.transform.a == 10
    assert file.colormap(1)[2] == colours[2]
photograph = numpy.stack([waves, -waves, waves // 3]).astype("int64").astype("uint8")
check(made("photograph", photograph))
check(made("wide", classes[:7, :]), "--compression", "none")
check(made("dot", classes[:1, :1]))
for name in ["classes", "elevation", "rgb"]:
    check(pathlib.Path(shutil.copy(fixtures / f"{name}.goblin", directory / f"fixture_{name}.goblin")))
# Every value occurs, and VOID: masks.
full = made("full", (rows * 31 + columns * 17).astype("uint8"), None, None, "--rule", "majority")
edited = directory / "full.autumn"
run("transform", full, "-o", edited)
run("edit", edited, "fill", "--window", "100,200,700,600", "--void")
out = directory / "masked.tif"
run("export", edited, out, "--tile-size", "256")
assert cog_validate(str(out), strict=True)[0]
with rasterio.open(out) as file:
    shown = file.dataset_mask() > 0
    assert file.nodata is None and not shown[200:800, 100:800].any()
    assert shown.sum() == shown.size - 600 * 700
    assert (file.read(1)[shown] == (rows * 31 + columns * 17).astype("uint8")[shown]).all()
print("cloud-optimized GeoTIFF is as others read it")
