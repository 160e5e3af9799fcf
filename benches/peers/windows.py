#!/usr/bin/env python3
"""Reading: random 256 x 256 windows at random levels, histograms of large windows, many points; one thread.

rasterio reads from COGs through GDAL's block cache (default size, warmed by as many other windows); ours are plain
files, mapped. Both are given to one core; times are processor time.
"""

import os
import re
import statistics
import subprocess
import sys

from common import EARTH, RELIEF, ROOT, SHORELINE, SPINNEY, WORK, cog, once, start, table, tree, verdict

# Times the peer in a process of its own: a fresh block cache.
PEER = r"""
import random, sys, time
import numpy, rasterio
from rasterio.windows import Window
path, count, factors, boxes = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
files = [rasterio.open(path)]
levels = files[0].overviews(1)[:factors - 1]
files += [rasterio.open(path, OVERVIEW_LEVEL=level) for level in range(len(levels))]
random.seed(1)
def one():
    file = random.choice(files)
    column = random.randrange(-(-file.width // 256)) * 256
    row = random.randrange(-(-file.height // 256)) * 256
    wide, high = min(256, file.width - column), min(256, file.height - row)
    return file, Window(column, row, wide, high)
rates = []
for turn in range(4):
    work = [one() for _ in range(count)]
    start = time.process_time()
    for file, window in work:
        file.read(window=window)
    if turn:
        rates.append(count / (time.process_time() - start))
rate = sorted(rates)[1]
counted = 0
if boxes:
    side = 4096
    file = files[0]
    work = [Window(random.randrange(file.width - side), random.randrange(file.height - side), side, side)
            for _ in range(boxes)]
    start = time.process_time()
    for window in work:
        numpy.bincount(file.read(1, window=window).ravel(), minlength=256)
    counted = boxes / (time.process_time() - start)
print(rate, counted, 1 + len(levels))
"""


def pinned(command):
    return ["taskset", "-c", str(min(os.sched_getaffinity(0))), *map(str, command)]


def peer(path, levels, boxes=0, cache=None, count=1000):
    environment = {**os.environ, "GDAL_NUM_THREADS": "1"}
    if cache:
        environment["GDAL_CACHEMAX"] = str(cache)
    command = pinned([sys.executable, "-c", PEER, path, count, levels, boxes])
    words = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.split()
    return float(words[0]), float(words[1]), int(words[2])


def rates(path, levels):
    """Our text and the numbers in it."""
    bench = os.environ.get("RATES")
    if not bench:
        built = subprocess.run(["cargo", "bench", "--bench", "rates", "--no-run"], cwd=ROOT, check=True,
                               capture_output=True, text=True).stderr
        bench = ROOT / re.search(r"\((\S*rates-\w+)\)", built)[1]
        os.environ["RATES"] = str(bench)
    text = subprocess.run(pinned([bench, "--levels", levels, path]), check=True, capture_output=True, text=True).stdout
    number = lambda pattern: float(re.search(pattern, text)[1])
    return text, {
        "windows": number(r" aligned windows: ([\d.]+)"),
        "p99": number(r" aligned windows: .*p99 ([\d.]+)"),
        "segments": number(r" aligned windows: .*at most (\d+)"),
        "slowest": number(r"slowest level / median level: ([\d.]+)"),
        "cell": number(r"single cells: ([\d.]+)"),
        "boxes": number(r"statistics of .*: ([\d.]+)"),
    }


def points(goblin):
    """Points a second of processor time on one thread, and of time on all."""
    import random

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
    rows, limits, texts = [], [], []
    cases = [
        ("shoreline", SHORELINE, "majority", "MODE", [("ZSTD", 5, None), ("NONE", 3, None), ("ZSTD", None, 64)]),
        ("earth", EARTH, "mean", "AVERAGE", [("ZSTD", 2, None), ("ZSTD", None, 16)]),
        ("relief", RELIEF, "mean", "AVERAGE", [("ZSTD", 5, None), ("ZSTD", None, 16)]),
    ]
    bulk = None
    for name, source, rule, resampling, peers in cases:
        goblin = WORK / f"{name}.goblin"
        tree(source, goblin, "--rule", rule)
        for compression, target, cache in peers:
            picture = WORK / f"{name}_{compression.lower()}.tif"
            predictor = ["PREDICTOR=YES"] if compression == "ZSTD" and rule == "mean" else []
            cog(source, picture, f"COMPRESS={compression}", f"OVERVIEW_RESAMPLING={resampling}", *predictor)
            boxes = 10 if name == "shoreline" and compression == "ZSTD" and not cache else 0
            theirs, counted, levels = peer(picture, 64, boxes, cache)
            # Ours at the levels that the COG has.
            text, ours = rates(goblin, levels)
            ratio = ours["windows"] / theirs
            cached = f"cache {cache} MB" if cache else "default cache"
            rows.append([name, f"rasterio, COG {compression}, {cached}", f"{theirs:.0f}", f"{ours['windows']:.0f}",
                         verdict(ratio, target) if target else f"{ratio:.3g}"])
            if boxes:
                rows.append([name, "histograms of 4096 x 4096: rasterio + bincount", f"{counted:.2f}",
                             f"{ours['boxes']:.0f}", verdict(ours["boxes"] / counted, 100)])
        text, ours = rates(goblin, 64)
        texts.append(text)
        for what, key, most in (("p99, us", "p99", 300), ("slowest level / median level", "slowest", 3),
                                ("most segments of an aligned window", "segments", 5), ("single cell, ns", "cell", 1000)):
            aimed = most if name == "shoreline" or key == "cell" else None
            limits.append([name, what, verdict(ours[key], aimed, False) if aimed else f"{ours[key]:.3g}"])
        if name == "shoreline":
            bulk = points(goblin)
    table(["picture", "peer", "peer/s", "ours/s", "ours / peer"], rows)
    table(["picture", "ours", "figure"], limits)
    print(f"`spinney point`, 4 million lines: {verdict(bulk[1] / 1e6, 2)} million/s with all threads (time), "
          f"{bulk[0] / 1e6:.3g} million per CPU second on one\n")
    print("```\n" + "".join(texts) + "```")


main()
