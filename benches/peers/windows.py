#!/usr/bin/env python3
"""Reading: random 256 x 256 windows at random levels, histograms of large windows, many points; one
thread.

rasterio reads from COGs through GDAL's block cache, ours are plain files, mapped; files are in the
system's cache. Both read the same aligned windows, entirely inside the raster, on one core; times
are processor time. The peer's windows differ in each pass, or, where noted, are the same again, so
that GDAL only copies decoded blocks.
"""

import os
import random
import re
import statistics
import subprocess
import sys

import rasterio
from common import EARTH, RELIEF, ROOT, SHORELINE, SPINNEY, WORK, cog, once, record, row, start, table, tree, verdict

# Times the peer in a separate process, with an empty block cache.
PEER = r"""
import random, sys, time
import numpy, rasterio
from rasterio.windows import Window
path, listed, what = sys.argv[1:4]
random.seed(3)
files = [rasterio.open(path)]
files += [rasterio.open(path, OVERVIEW_LEVEL=level) for level in range(len(files[0].overviews(1)))]
with open(listed) as lines:
    positions = [tuple(map(int, line.split())) for line in lines]
work = [(files[up], Window(column, row, 256, 256)) for up, column, row in positions]
if what == "boxes":
    side, count = 4096, 20
    file = files[0]
    work = [Window(random.randrange(file.width - side), random.randrange(file.height - side), side, side)
            for _ in range(count)]
    start = time.process_time()
    for window in work:
        numpy.bincount(file.read(1, window=window).ravel(), minlength=256)
    print(count / (time.process_time() - start))
else:
    rates, share = [], len(work) // 4
    for turn in range(4):
        part = work[:share] if what == "again" else work[turn * share:][:share]
        start = time.process_time()
        for file, window in part:
            file.read(window=window)
        if turn:
            rates.append(share / (time.process_time() - start))
    print(sorted(rates)[1])
"""


def pinned(command):
    return ["taskset", "-c", str(min(os.sched_getaffinity(0))), *map(str, command)]


def listed(path, name, count=4000, aligned=True):
    """Writes windows at random positions of random levels that the COG has, one list for both."""
    with rasterio.open(path) as file:
        sizes = [(file.width, file.height)]
        sizes += [(-(-file.width // factor), -(-file.height // factor)) for factor in file.overviews(1)]
    levels = [up for up, size in enumerate(sizes) if min(size) >= 256]
    random.seed(1)
    windows_file = WORK / f"{name}{'' if aligned else '.unaligned'}.windows"
    with open(windows_file, "w") as out:
        for _ in range(count):
            up = random.choice(levels)
            column, row = (random.randrange(side // 256) * 256 if aligned else random.randrange(side - 255)
                           for side in sizes[up])
            out.write(f"{up} {column} {row}\n")
    return windows_file


def peer(path, windows_file, what, cache=None):
    environment = {**os.environ, "GDAL_NUM_THREADS": "1"}
    if cache:
        environment["GDAL_CACHEMAX"] = str(cache)
    command = pinned([sys.executable, "-W", "ignore", "-c", PEER, path, windows_file, what])
    return float(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)


def rates(path, *options):
    """Returns our output and the numbers in it."""
    bench = os.environ.get("RATES")
    if not bench:
        built = subprocess.run(["cargo", "bench", "--bench", "rates", "--no-run"], cwd=ROOT, check=True,
                               capture_output=True, text=True).stderr
        bench = ROOT / re.search(r"\((\S*rates-\w+)\)", built)[1]
        os.environ["RATES"] = str(bench)
    text = subprocess.run(pinned([bench, *options, path]), check=True, capture_output=True, text=True).stdout
    number = lambda pattern: float(found[1]) if (found := re.search(pattern, text)) else None
    return text, {
        "windows": number(r" aligned windows: ([\d.]+)"),
        "p99": number(r" aligned windows: .*p99 ([\d.]+)"),
        "segments": number(r" aligned windows: .*at most (\d+)"),
        "slowest": number(r"slowest level / median level: ([\d.]+)"),
        "cell": number(r"single cells: ([\d.]+)"),
        "boxes": number(r"statistics of .*: ([\d.]+)"),
    }


def points(goblin):
    """Returns points per second of processor time on one thread, and of wall time on all."""
    random.seed(4)
    count, file = 4_000_000, WORK / "points.txt"
    if not file.exists():
        with open(file, "w") as out:
            for _ in range(count):
                out.write(f"{random.uniform(-180, 180):.5f},{random.uniform(-90, 90):.5f}\n")
    found = []
    for options in (["--threads", "1"], []):
        measured = []
        for _ in range(3):
            with open(file) as lines:
                measured.append(once([SPINNEY, "-q", *options, "point", goblin], stdin=lines))
        found.append([statistics.median(column) for column in zip(*measured)])
    return count / found[0][0], count / found[1][1]


def main():
    start()
    rows, limits, outputs, results = [], [], [], []
    # Compression, whether windows repeat, GDAL's cache in MB, and the target ratio.
    mean = [("ZSTD", "other", None), ("ZSTD", "other", 64), ("ZSTD", "again", None)]
    cases = [
        ("shoreline", SHORELINE, "majority", "MODE", [*mean, ("NONE", "other", None), ("NONE", "other", 64)], 5),
        ("earth", EARTH, "mean", "AVERAGE", mean, 2),
        ("relief", RELIEF, "mean", "AVERAGE", mean, 5),
    ]
    bulk = None
    for name, source, rule, resampling, peers, aim in cases:
        goblin = WORK / f"{name}.goblin"
        tree(source, goblin, "--rule", rule)
        for compression, what, cache in peers:
            raster = WORK / f"{name}_{compression.lower()}.tif"
            predictor = ["PREDICTOR=YES"] if compression == "ZSTD" and rule == "mean" else []
            cog(source, raster, f"COMPRESS={compression}", f"OVERVIEW_RESAMPLING={resampling}", *predictor)
            windows_file = listed(raster, name)
            theirs = peer(raster, windows_file, what, cache)
            text, ours = rates(goblin, "--only", "windows", "--windows", windows_file)
            cached = f"cache {cache} MB" if cache else "default cache"
            again = ", the same windows again" if what == "again" else ""
            known = f"rasterio, COG {compression}, {cached}{again}"
            results.append(row(f"windows of 256 x 256, {name}", "/s", ours["windows"], known, theirs))
            rows.append([name, known, f"{theirs:.0f}",
                         f"{ours['windows']:.0f}",
                         verdict(ours["windows"] / theirs, 3 if compression == "NONE" else aim)])
        if name == "shoreline":
            counted = peer(WORK / "shoreline_zstd.tif", windows_file, "boxes")
            boxes = rates(goblin, "--only", "statistics")[1]["boxes"]
            results.append(row(f"histograms of 4096 x 4096, {name}", "/s", boxes, "rasterio + bincount", counted))
            rows.append([name, "histograms of 4096 x 4096: rasterio + bincount", f"{counted:.2f}", f"{boxes:.0f}",
                         verdict(boxes / counted, 100)])
        text, ours = rates(goblin)
        outputs.append(text)
        results += [
            row(f"windows of 256 x 256, {name}: p99", "us", ours["p99"]),
            row(f"windows of 256 x 256, {name}: slowest level / median level", "times", ours["slowest"]),
            row(f"aligned window, {name}: maximum of segments read", "segments", ours["segments"]),
        ]
        if name == "earth":
            results.append(row("single cell, earth", "ns", ours["cell"]))
        for what, key, most in (("p99, us", "p99", 300), ("slowest level / median level", "slowest", 3),
                                ("most segments of an aligned window", "segments", 5), ("single cell, ns", "cell", 1000)):
            aimed = most if name == "shoreline" or key == "cell" else None
            limits.append([name, what, verdict(ours[key], aimed, False) if aimed else f"{ours[key]:.3g}"])
        if name == "shoreline":
            bulk = points(goblin)
    table(["raster", "peer", "peer/s", "ours/s", "ours / peer"], rows)
    table(["raster", "ours", "figure"], limits)
    print(f"`spinney point`, 4 million lines: {verdict(bulk[1] / 1e6, 2)} million/s with all threads (time), "
          f"{bulk[0] / 1e6:.3g} million per CPU second on one\n")
    print("```\n" + "".join(outputs) + "```")
    job = "spinney point, 4 million lines"
    results += [row(f"{job}, all threads", "million/s", bulk[1] / 1e6), row(f"{job}, per CPU second", "million/s", bulk[0] / 1e6)]
    record("windows and points", results)


if __name__ == "__main__":
    main()
