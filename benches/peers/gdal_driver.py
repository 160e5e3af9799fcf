#!/usr/bin/env python3
"""Reading through GDAL: random windows of our files by the driver, and of COGs by GDAL's own; one
core, processor time.

    benches/peers/gdal_driver.py [--prefix PREFIX] [--runs N]

PREFIX is that of capi/install.sh and capi/gdal/build.sh, with the library as users get it; by
default one is made. Both read the same windows of the same raster, alternating; rates are medians
of N runs, the ratio is the median of each pair's. COGs have deflated blocks of 256 x 256.
"""

import argparse
import os
import statistics
import subprocess
import sys
from pathlib import Path

from common import CLASSES, EARTH, RELIEF, ROOT, SPINNEY, WORK, record, row, start

WINDOWS = [
    ("aligned", 256, 256, "warm", "all"),
    ("anywhere", 256, 256, "warm", "all"),
    ("anywhere", 256, 256, "cold", "all"),
    ("anywhere", 1024, 1024, "warm", "all"),
    ("anywhere", 1024, 256, "warm", "all"),
    ("anywhere", 1000, 200, "warm", "all"),
    ("aligned", 256, 256, "warm", "band"),
]


def run(*command, **options):
    return subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True, **options).stdout


def files(name, raster, *options):
    """Returns a raster as our file and as theirs."""
    ours, theirs = WORK / f"driver_{name}.goblin", WORK / f"driver_{name}.tif"
    if options:
        source = WORK / f"driver_{name}_source.tif"
        if not source.exists():
            run("gdal_translate", "-q", *options, raster, source)
        raster = source
    if not ours.exists():
        run(SPINNEY, "build", "-q", raster, "-o", ours)
    if not theirs.exists():
        run("gdal_translate", "-q", "-of", "COG", "-co", "COMPRESS=DEFLATE", "-co", "BLOCKSIZE=256", raster, theirs)
    return ours, theirs


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prefix", type=Path)
    parser.add_argument("--runs", type=int, default=5)
    args = parser.parse_args()
    start()
    prefix = args.prefix or WORK / "driver"
    if not args.prefix:
        run(ROOT / "capi/install.sh", prefix)
        run(ROOT / "capi/gdal/build.sh", prefix)
    flags = run("gdal-config", "--cflags").split(), run("gdal-config", "--libs").split()
    program = WORK / "gdal_driver"
    run("c++", "-std=c++17", "-O2", *flags[0], Path(__file__).with_suffix(".cpp"), "-o", program, *flags[1])
    environment = os.environ | {"GDAL_DRIVER_PATH": str(prefix / "lib/gdalplugins")}
    core = ["taskset", "-c", min(os.sched_getaffinity(0))]
    rasters = {
        "relief, i16": files("relief", RELIEF),
        "relief, f32": files("float", RELIEF, "-ot", "Float32", "-scale", "-10000", "9000", "-3000.5", "3000.7"),
        "earth, 3 x u8": files("earth", EARTH),
        "classes, u8": files("classes", CLASSES),
    }
    print("| raster | windows | ours | COG | ratio |\n| --- | --- | ---: | ---: | ---: |")
    results = []
    for raster, paths in rasters.items():
        for where, side, out, state, bands in WINDOWS:
            rates = [
                [int(run(*core, program, path, where, side, out, state, bands, env=environment)) for path in paths]
                for _ in range(args.runs)
            ]
            ours, theirs = (statistics.median(column) for column in zip(*rates))
            ratio = statistics.median(a / b for a, b in rates)
            kind = f"{side}" if side == out else f"{side} -> {out}"
            print(f"| {raster} | {where}, {kind}, {state}, {bands} | {ours:.0f} | {theirs:.0f} | {ratio:.2f} |", flush=True)
            if bands == "all" or raster == "earth, 3 x u8":
                job = f"{raster}: {where} {kind}, {'' if bands == 'all' else 'one band, '}{state}"
                results.append(row(job, "/s", ours, "GDAL, COG", theirs, ratio=1 / ratio))
    record("windows through GDAL's driver", results)


if __name__ == "__main__":
    sys.exit(main())
