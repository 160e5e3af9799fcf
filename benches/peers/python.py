#!/usr/bin/env python3
"""The Python package against rasterio: windows at random levels, and a million points; one thread of one process.

Run it with a Python that has both (`pip install ./python rasterio`). Both read the same aligned windows of 256 x 256 cells
at levels that the COG has, and the same points; files are in the system's cache. Times are processor time, medians of
three passes after a first one; windows are other ones in each pass.
"""

import os
import random
import statistics
import time

import numpy
import rasterio
import spinney
from common import RELIEF, SHORELINE, WORK, cog, start, table
from rasterio.windows import Window

PASSES, WINDOWS, POINTS = 4, 1000, 1_000_000


def rate(passes):
    """Things a second of processor time: the median of all passes but the first, each a list of calls."""
    rates = []
    for calls in passes:
        began = time.process_time()
        for call in calls:
            call()
        rates.append(len(calls) / (time.process_time() - began))
    return statistics.median(rates[1:])


def overhead(ds):
    """Microseconds of a call that reads one cell, which is nearly nothing to the library."""
    calls = [lambda: ds.read(1, window=(0, 0, 1, 1))] * 20000
    return 1e6 / rate([calls] * PASSES)


def main():
    start()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    rows, limits = [], []
    for name, source, kind, resampling, options in (
        ("shoreline", SHORELINE, "categorical", "MODE", []),
        ("relief", RELIEF, "continuous", "AVERAGE", ["PREDICTOR=YES"]),
    ):
        goblin, picture = WORK / f"{name}.goblin", WORK / f"{name}_zstd.tif"
        if not goblin.exists():
            spinney.build(source, goblin, kind=kind)
        cog(source, picture, "COMPRESS=ZSTD", f"OVERVIEW_RESAMPLING={resampling}", *options)
        ds = spinney.open(goblin)
        files = [rasterio.open(picture)]
        files += [rasterio.open(picture, OVERVIEW_LEVEL=up) for up in range(len(files[0].overviews(1)))]
        usable = [up for up, file in enumerate(files) if min(file.width, file.height) >= 256]
        random.seed(1)
        places = []
        for _ in range(PASSES * WINDOWS):
            file = files[up := random.choice(usable)]
            places.append((up, *(random.randrange(side // 256) * 256 for side in (file.width, file.height))))
        levels = {up: ds.level(ds.depth - up) for up in usable}
        ours = [lambda at=levels[up], x=x, y=y: at[y : y + 256, x : x + 256] for up, x, y in places]
        theirs = [lambda at=files[up], x=x, y=y: at.read(1, window=Window(x, y, 256, 256)) for up, x, y in places]
        in_passes = lambda calls: [calls[first : first + WINDOWS] for first in range(0, len(calls), WINDOWS)]
        found = [rate(in_passes(calls)) for calls in (theirs, ours)]
        rows.append([f"{name}: windows", *(f"{number:,.0f} /s" for number in found), f"{found[1] / found[0]:.3g}"])
        box = files[0].bounds
        points = numpy.random.default_rng(2).uniform(box[:2], box[2:], (POINTS, 2))
        few = points[: POINTS // 20].tolist()
        theirs = len(few) * rate([[lambda: list(files[0].sample(few))]] * 3)
        ours = POINTS * rate([[lambda: ds.sample(points)]] * PASSES)
        rows.append([f"{name}: points", f"{theirs:,.0f} /s", f"{ours:,.0f} /s", f"{ours / theirs:.3g}"])
        limits.append([name, f"{overhead(ds):.2f}"])
    table(["job", "rasterio, COG ZSTD", "spinney", "ours / theirs"], rows)
    table(["picture", "a read of one cell, us"], limits)


if __name__ == "__main__":
    main()
