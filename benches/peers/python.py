#!/usr/bin/env python3
"""The Python package against rasterio and NumPy: windows, averaged sizes, points, statistics; one
thread of one process.

Run it with a Python that has both (`pip install ./python rasterio`), all files in the system's
cache. Windows are 256 x 256 cells anywhere, at levels that the COG has, the same in each pass: all
blocks are in GDAL's cache after the first. Times are processor time, medians of three passes after
a first one.
"""

import os
import random
import statistics
import time

import numpy
import rasterio
import spinney
from common import EARTH, RELIEF, SHORELINE, WORK, cog, record, row, start, table, verdict
from rasterio.enums import Resampling
from rasterio.windows import Window

PASSES, WINDOWS, POINTS = 4, 1000, 1_000_000


def rate(calls):
    """Returns calls per second of processor time: the median of all passes except the first."""
    rates = []
    for _ in range(PASSES):
        began = time.process_time()
        for call in calls:
            call()
        rates.append(len(calls) / (time.process_time() - began))
    return statistics.median(rates[1:])


def overhead(ds):
    """Returns microseconds of a call that reads one cell, which takes the library hardly any time.
    """
    return 1e6 / rate([lambda: ds.read(1, window=(0, 0, 1, 1))] * 20000)


def us(rate):
    return f"{1e6 / rate:,.1f} us"


def averages(ds, file, raster):
    """Averaged sizes: times, and the deviation from the exact means of the cells, for ours and for
    rasterio's results from overviews."""
    rows, results = [], []
    for side, size in ((640, 50), (2160, 256)):
        part = (300, 0, side, side)
        shape = {"out_shape": (size, size)}
        ours = lambda: ds.read(1, window=part, **shape)
        theirs = lambda: file.read(1, window=Window(*part), resampling=Resampling.average, **shape)
        exact = ds.read(1, window=part, exact=True, **shape).astype(float)
        off = [numpy.sqrt(((read().astype(float) - exact) ** 2).mean()) for read in (theirs, ours)]
        found = [rate([read] * (400 if size < 100 else 60)) for read in (theirs, ours)]
        errors = f"{off[0]:.3g}, {off[1]:.3g}"
        rows.append([f"{raster}: {side} -> {size}", *map(us, found), verdict(found[0] / found[1], 2, least=False), errors])
        job = f"averaged, {raster}, {side} -> {size} pixels"
        results.append(row(job, "us", 1e6 / found[1], "rasterio", 1e6 / found[0]))
        results.append(row(f"{job}: error", "RMS", float(off[1]), "rasterio", float(off[0])))
    return rows, results


def main():
    start()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    rows, sizes, limits, results, calls_us = [], [], [], [], []
    for name, source, kind, resampling, options in (
        ("shoreline", SHORELINE, "categorical", "MODE", []),
        ("relief", RELIEF, "continuous", "AVERAGE", ["PREDICTOR=YES"]),
        ("earth", EARTH, "continuous", "AVERAGE", ["PREDICTOR=YES"]),
    ):
        goblin, raster = WORK / f"{name}.goblin", WORK / f"{name}_zstd.tif"
        if not goblin.exists():
            spinney.build(source, goblin, kind=kind)
        cog(source, raster, "COMPRESS=ZSTD", f"OVERVIEW_RESAMPLING={resampling}", *options)
        ds = spinney.open(goblin)
        files = [rasterio.open(raster)]
        files += [rasterio.open(raster, OVERVIEW_LEVEL=up) for up in range(len(files[0].overviews(1)))]
        usable = [up for up, file in enumerate(files) if min(file.width, file.height) >= 256]
        bands = 1 if files[0].count == 1 else None
        random.seed(1)
        ours, theirs = [], []
        for _ in range(WINDOWS):
            up = random.choice(usable)
            level, file = ds.depth - up, files[up]
            x, y = (random.randrange(side - 255) for side in (file.width, file.height))
            part = tuple(number << up for number in (x, y, 256, 256))
            ours.append(lambda part=part, level=level: ds.read(bands, window=part, level=level))
            theirs.append(lambda file=file, x=x, y=y: file.read(bands, window=Window(x, y, 256, 256)))
        found = [rate(calls) for calls in (theirs, ours)]
        rows.append([f"{name}: windows", *(f"{number:,.0f} /s" for number in found), verdict(found[1] / found[0], 1.3)])
        note = "All blocks are decoded in GDAL's cache."
        results.append(row(f"windows of 256 x 256, {name}, from Python", "/s", found[1], "rasterio, COG ZSTD", found[0], note=note))
        if files[0].crs:
            box = files[0].bounds
            points = numpy.random.default_rng(2).uniform(box[:2], box[2:], (POINTS, 2))
            few = points[: POINTS // 20].tolist()
            found = [len(few) * rate([lambda: list(files[0].sample(few))]), POINTS * rate([lambda: ds.sample(points)])]
            rows.append([f"{name}: points", *(f"{number:,.0f} /s" for number in found), f"{found[1] / found[0]:.3g}"])
            results.append(row(f"points, {name}, from Python", "/s", found[1], "rasterio, COG ZSTD", found[0]))
        if name == "relief":
            sizes, averaged = averages(ds, files[0], name)
            results += averaged
            part = (300, 700, 500, 500)
            numpy.save(WORK / "relief.npy", ds.read(1))
            cells = numpy.load(WORK / "relief.npy", mmap_mode="r")[700:1200, 300:800]
            measure = lambda: (cells.min(), cells.max(), cells.mean(), cells.std())
            found = [rate([measure] * 300), rate([lambda: ds.stats(part)] * 300)]
            rows.append(["relief: statistics of 500 x 500", *map(us, found), verdict(found[0] / found[1], 1, least=False)])
            results.append(row("statistics of 500 x 500, relief, from Python", "us", 1e6 / found[1], "NumPy, mapped", 1e6 / found[0]))
        if name == "shoreline":
            found = rate([lambda: ds[::1000, ::1000]] * 20)
            rows.append(["shoreline: [::1000, ::1000]", "-", us(found), verdict(1e3 / found, 20, least=False) + " ms"])
            results.append(row("[::1000, ::1000] of the shoreline, from Python", "us", 1e6 / found))
        calls_us.append(overhead(ds))
        limits.append([name, f"{calls_us[-1]:.2f}"])
    table(["job", "rasterio, COG ZSTD (statistics: NumPy, mapped)", "spinney", "ours / theirs"], rows)
    table(["averaged size", "rasterio", "spinney", "time ours / theirs", "off by (root mean square): rasterio, spinney"], sizes)
    table(["raster", "a read of one cell, us"], limits)
    note = f"{min(calls_us):.2g} to {max(calls_us):.2g}."
    record("windows and points", [*results, row("a call that reads one cell, from Python", "us", max(calls_us), note=note)])


if __name__ == "__main__":
    main()
