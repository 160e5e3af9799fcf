#!/usr/bin/env python3
"""Majority at every level: ours and GDAL's MODE overviews against brute-force counts of all cells.
"""

import subprocess
import sys

from common import CLASSES, SHORELINE, SPINNEY, WORK, cog, record, row, start, table, tree


def pair(counts):
    """Returns counts of blocks twice as large; the last axes are rows and columns."""
    pads = [(0, 0)] + [(0, size % 2) for size in counts.shape[1:]]
    if any(end for _, end in pads):
        counts = numpy.pad(counts, pads)
    rows = counts[:, 0::2] + counts[:, 1::2]
    return rows[:, :, 0::2] + rows[:, :, 1::2]


def judge(counts, level):
    """Returns our errors, pixels, mixed pixels and GDAL's errors among them, in a band of a level.
    """
    most = counts.max(axis=0)
    # Any of the most frequent classes is right, for both.
    own = numpy.take_along_axis(counts, level["ours"][None].astype(numpy.intp), axis=0)[0]
    wrong = int((own < most).sum())
    mixed = most < counts.sum(axis=0)
    bad = None
    if level["gdal"] is not None:
        held = numpy.take_along_axis(counts, level["gdal"][None].astype(numpy.intp), axis=0)[0]
        bad = int((mixed & (held < most)).sum())
    return numpy.array([wrong, most.size, int(mixed.sum()), bad or 0])


def check(name, source):
    goblin, overviews = WORK / f"{name}_majority.goblin", WORK / f"{name}_zstd.tif"
    tree(source, goblin, "--rule", "majority")
    cog(source, overviews, "COMPRESS=ZSTD", "OVERVIEW_RESAMPLING=MODE")
    with rasterio.open(source) as file, rasterio.open(overviews) as peer:
        width, height = file.width, file.height
        classes = 12 if name == "classes12" else 5
        depth = (max(width, height) - 1).bit_length()
        factors = peer.overviews(1)
        levels = {}
        for shift in range(1, depth + 1):
            array = WORK / "level.npy"
            subprocess.run([SPINNEY, "-q", "get", goblin, array, "--level", str(depth - shift)], check=True)
            gdal = None
            # Overviews of odd sizes are not made of whole blocks.
            if 1 << shift in factors and width % (1 << shift) == 0 and height % (1 << shift) == 0:
                with rasterio.open(overviews, OVERVIEW_LEVEL=factors.index(1 << shift)) as overview:
                    gdal = overview.read(1)
            levels[shift] = {"ours": numpy.load(array).squeeze(), "gdal": gdal, "sum": numpy.zeros(4, int)}
            levels[shift]["ours"] = numpy.atleast_2d(levels[shift]["ours"])
        # Bands of blocks of 256 cells; larger blocks are computed from their counts.
        waiting = []
        for top in range(0, height, 256):
            rows = min(256, height - top)
            cells = file.read(1, window=((top, top + rows), (0, width)))
            if cells.max() >= classes:
                sys.exit(f"{name}: more classes than expected")
            counts = (cells[None] == numpy.arange(classes, dtype=numpy.uint8)[:, None, None]).astype(numpy.uint8)
            for shift in range(1, 9):
                if shift == 4:
                    counts = counts.astype(numpy.uint32)
                counts = pair(counts)
                first = top >> shift
                level = levels[shift]
                part = {key: None if level[key] is None else level[key][first:first + counts.shape[1]]
                        for key in ("ours", "gdal")}
                level["sum"] += judge(counts, part)
            waiting.append(counts)
        counts = numpy.concatenate(waiting, axis=1)
        for shift in range(9, depth + 1):
            counts = pair(counts)
            levels[shift]["sum"] += judge(counts, levels[shift])
    rows, results, alone = [], [], []
    for shift, level in levels.items():
        wrong, pixels, mixed, bad = map(int, level["sum"])
        if level["gdal"] is None:
            alone.append((depth - shift, wrong))
        else:
            shares = [100 * count / max(mixed, 1) for count in (wrong, bad)]
            results.append(row(f"wrong majorities, {name}, level {depth - shift}", "% of mixed pixels", shares[0], "GDAL COG, MODE", shares[1]))
        gdal = "-" if level["gdal"] is None else f"{100 * bad / max(mixed, 1):.2f} %"
        rows.append([name, depth - shift, 1 << shift, pixels, mixed, wrong, gdal])
    results.append(row(f"wrong majorities, {name}, levels {alone[0][0]} to 0", "pixels", sum(wrong for _, wrong in alone)))
    record("majorities", results)
    return rows


start()
import numpy
import rasterio

rows = check("classes12", CLASSES) + check("shoreline", SHORELINE)
table(["raster", "level", "cells per side", "pixels", "mixed", "ours wrong", "GDAL MODE wrong of mixed"], rows)
wrong = sum(row[5] for row in rows)
print(f"Ours wrong: {wrong} ({'met' if wrong == 0 else 'MISSED'})")
