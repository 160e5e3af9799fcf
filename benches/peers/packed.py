#!/usr/bin/env python3
"""Bytes of packed trees with all levels against cloud-optimized GeoTIFFs with overviews, and the
CPU time of making both; solids and labels against others.

    benches/peers/install.sh; pip install crackle-codec compresso numpy
    SPINNEY=target/release/spinney PYTHON=python benches/peers/packed.py [sizes] [octrees]
"""

import os
import subprocess
import sys

from common import CLASSES, DATA, EARTH, RELIEF, SHORELINE, SPINNEY, WORK, once, record, row, runs, start, table

PYTHON = os.environ.get("PYTHON", sys.executable)
RASTER = DATA.parent

# Name, file, options of the COG, options of `build`, and the maximum fraction of the COG's bytes.
RASTERS = [
    ("shoreline", SHORELINE, ["COMPRESS=ZSTD", "OVERVIEW_RESAMPLING=MODE"], [], 0.42),
    ("classes12", CLASSES, ["COMPRESS=ZSTD", "OVERVIEW_RESAMPLING=MODE"], [], 0.70),
    ("nlcd_zion", RASTER / "nlcd_zion" / "nlcd2011.tif", ["COMPRESS=ZSTD", "OVERVIEW_RESAMPLING=MODE"], [], 0.70),
    ("epitomes", RASTER / "epitomes" / "lc.tif", ["COMPRESS=ZSTD", "OVERVIEW_RESAMPLING=MODE"], ["--kind", "categorical"], 0.70),
    ("earth", EARTH, ["COMPRESS=ZSTD", "PREDICTOR=YES"], [], 0.80),
    ("relief", RELIEF, ["COMPRESS=ZSTD", "PREDICTOR=YES"], [], 0.78),
    ("SRTM", RASTER / "srtm3" / "N46E008.tif", ["COMPRESS=ZSTD", "PREDICTOR=YES"], [], 0.78),
    ("f32 elevation", RASTER / "spdatalarge" / "nz_elev.tif", ["COMPRESS=ZSTD", "PREDICTOR=YES"], [], None),
]


def cog_of(name, source, options):
    """Returns a COG and the CPU seconds of making it."""
    target = WORK / f"{name.replace(' ', '_')}_packed_peer.tif"
    words = [word for option in options for word in ("-co", option)]
    seconds = runs(["gdal_translate", "-q", "-of", "COG", *words, source, target])[0]
    return target.stat().st_size, seconds


def built(name, source, *options):
    """Returns a tree's bytes, and the CPU seconds of building it."""
    target = WORK / f"{name.replace(' ', '_')}_{'_'.join(options).replace('-', '')}.goblin"
    seconds = runs([SPINNEY, "-q", "build", source, "-o", target, *options])[0]
    return target, seconds


def verdict(ratio, target):
    return "" if target is None else f" ({'met' if ratio <= target else 'MISSED'}: {target})"


def sizes():
    rows, times, results = [], [], []
    for name, source, cog, options, target in RASTERS:
        if not source.exists():
            continue
        theirs, their_seconds = cog_of(name, source, cog)
        plain, plain_seconds = built(name, source, *options)
        cells = [name, theirs, plain.stat().st_size]
        clock = [name, f"{their_seconds:.2f}", f"{plain_seconds:.2f}"]
        tree, seconds = built(name, source, *options, "--codec", "packed")
        ratio = tree.stat().st_size / theirs
        cells.append(f"{tree.stat().st_size}: {ratio:.3f}{verdict(ratio, target)}")
        clock.append(f"{seconds:.2f}: {seconds / plain_seconds:.2f} of plain, {seconds / their_seconds:.2f} of COG's")
        rows.append(cells)
        times.append(clock)
        for form, path, own, area in [("plain", plain, plain_seconds, "building rasters"), ("packed", tree, seconds, "packed files")]:
            results += [row(f"bytes of {name}, {form}", "bytes", path.stat().st_size, "GDAL COG, ZSTD", theirs)]
            results += [row(f"build {name}, {form}", "CPU s", own, "GDAL COG, ZSTD", their_seconds, area=area)]
    table(["raster", "COG", "plain", "packed"], rows)
    table(["CPU s", "COG", "plain", "packed"], times)
    webp, _ = cog_of("earth webp", EARTH, ["COMPRESS=WEBP", "QUALITY=100", "WEBP_LOSSLESS=YES"])
    tree = WORK / "earth_codec_packed.goblin"
    ratio = tree.stat().st_size / webp
    print(f"earth: {ratio:.3f} of WebP lossless with overviews ({webp}){verdict(ratio, 1.2)}")
    results += [row("bytes of earth, packed", "bytes", tree.stat().st_size, "WebP lossless, with overviews", webp)]
    # The raster alone, without overviews.
    alone = WORK / "earth_alone.tif"
    once(["gdal_translate", "-q", "-of", "GTiff", "-co", "TILED=YES", "-co", "COMPRESS=WEBP", "-co", "WEBP_LOSSLESS=YES", EARTH, alone])
    ratio = tree.stat().st_size / alone.stat().st_size
    print(f"earth: {ratio:.3f} of WebP lossless without overviews ({alone.stat().st_size}){verdict(ratio, 1.2)}")
    results += [row("bytes of earth, packed", "bytes", tree.stat().st_size, "WebP lossless, without overviews", alone.stat().st_size)]
    record("packed files", results)


LABELS = """
import sys
import crackle, compresso, numpy
cells = numpy.load(sys.argv[1])
print(len(crackle.compress(cells)), len(compresso.compress(cells)))
"""


def octrees():
    from labels import BODIES

    rows, results = [], []
    mesh = RASTER.parent / "mesh" / "armadillo.ply"
    if mesh.exists():
        tree, seconds = built("armadillo", mesh, "--depth", "10", "--codec", "packed")
        size = tree.stat().st_size
        rows.append(["armadillo at 1024", size, "0.35 MB", "met" if size <= 350_000 else "MISSED", f"{seconds:.2f}"])
        results += [row("bytes of armadillo at 1024 cells, packed", "bytes", size)]
    cells = WORK / "bodies_512.npy"
    if not cells.exists():
        once([PYTHON, "-c", BODIES, cells, "512"])
    crackle, compresso = map(int, subprocess.check_output([PYTHON, "-c", LABELS, cells], text=True).split())
    tree, seconds = built("bodies", cells, "--kind", "categorical", "--nodata", "0", "--codec", "packed")
    ratio = tree.stat().st_size / crackle
    rows.append(["labels 512^3", tree.stat().st_size, f"crackle {crackle}, compresso {compresso}", f"{ratio:.3f}{verdict(ratio, 1.2)}", f"{seconds:.2f}"])
    table(["what", "bytes", "rival", "ratio", "CPU s"], rows)
    for peer, theirs in [("crackle", crackle), ("compresso", compresso)]:
        results += [row("bytes of labels, 512^3, packed", "bytes", tree.stat().st_size, peer, theirs)]
    record("packed files", results)


def main():
    start()
    chosen = sys.argv[1:] or ["sizes", "octrees"]
    for name in chosen:
        {"sizes": sizes, "octrees": octrees}[name]()


if __name__ == "__main__":
    main()
