#!/usr/bin/env python3
"""Measures the comparisons of the README's table, and updates it, with date, machine and commit:

    readme_table.py PROGRAM [--rates BENCH] [--commit ID] [--print]

PROGRAM is a release build of `spinney`, BENCH the executable that `cargo bench --bench rates
--no-run` prints; without it the rows of windows are omitted. ID is the commit that they were built
from, if it is not the one that is checked out. The Python that runs this needs rasterio,
manifold3d, libigl (which reads meshes) and exactextract; gdal_translate and gdal_contour must be
installed, and the data of ../shared/data must exist. Processor seconds, medians of three runs;
gdal_contour runs once. Takes five minutes.
"""

import argparse
import datetime
import json
import os
import re
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PEERS = {"rasterio": "rasterio", "manifold3d": "manifold3d", "exactextract": "exactextract"}
BEGIN, END = "<!-- table: made by benches/peers/readme_table.py -->", "<!-- end of table -->"

parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
parser.add_argument("program", type=Path)
parser.add_argument("--rates", type=Path)
parser.add_argument("--commit")
parser.add_argument("--print", action="store_true", help="print the table instead of writing it into the README")
parser.add_argument("--part", help=argparse.SUPPRESS)
arguments = parser.parse_args()
os.environ["SPINNEY"] = str(arguments.program.resolve())
if arguments.rates:
    os.environ["RATES"] = str(arguments.rates.resolve())

from common import RELIEF, ROOT, SHORELINE, SPINNEY, WORK, cog, once, runs, start, tree  # noqa: E402


def part(name):
    """Runs a function of this file in a separate process: NumPy imports would count in the memory
    of processes started later."""
    options = ["--rates", arguments.rates] if arguments.rates else []
    command = [sys.executable, "-W", "ignore", __file__, arguments.program, *options, "--part", name]
    return json.loads(subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True).stdout)


def script(name, *words):
    """Returns the output of another script here."""
    command = [sys.executable, "-W", "ignore", HERE / name, *words]
    return subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True).stdout


def cost(run):
    """Returns processor seconds and memory."""
    seconds, _, memory = run
    return f"{seconds:.3g} s, {memory:,.0f} MiB" if seconds < 99.5 else f"{seconds:.0f} s, {memory:,.0f} MiB"


def rate(number):
    digits = 10 ** (len(str(int(number))) - 3)
    return f"{round(number / digits) * digits:,.0f} /s"


# Each of these returns rows of the table: job, peer, the peer's figure, ours.


def building():
    rows = []
    for job, source, name, rule, options in [
        ("build a class map of 933 million cells, all levels", SHORELINE, "shoreline", "majority", ["OVERVIEW_RESAMPLING=MODE"]),
        ("build an elevation model of 9 million cells, all levels", RELIEF, "relief", "mean", ["OVERVIEW_RESAMPLING=AVERAGE", "PREDICTOR=YES"]),
    ]:
        goblin, raster = WORK / f"{name}.goblin", WORK / f"{name}_zstd.tif"
        ours = runs([SPINNEY, "-q", "build", source, "-o", goblin, "--rule", rule])
        words = [word for option in ["COMPRESS=ZSTD", *options] for word in ("-co", option)]
        theirs = runs(["gdal_translate", "-q", "-of", "COG", *words, source, raster])
        rows.append([job, "GDAL, COG with ZSTD", cost(theirs), cost(ours)])
        packed = goblin.with_name(f"{goblin.stem}_packed.goblin")
        if not packed.exists():
            once([SPINNEY, "-q", "convert", goblin, packed, "--codec", "packed"])
        theirs, plain, small = (f"{path.stat().st_size / 1e6:.1f} MB" for path in (raster, goblin, packed))
        size = [theirs, f"{plain}, packed {small}"]
        rows.append([f"bytes of that {'class map' if rule == 'majority' else 'elevation model'}", "GDAL, COG with ZSTD", *size])
    return rows


def majorities():
    shares = []
    for line in script("majority.py").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        # Blocks of 2 x 2 cells are made of the cells themselves.
        if len(cells) == 7 and cells[1].isdigit():
            assert cells[5] == "0", line
            if cells[6].endswith("%") and int(cells[2]) > 2:
                shares.append(float(cells[6].rstrip(" %")))
    figures = f"{min(shares):.0f} to {max(shares):.0f} %"
    return [["coarse pixels of several classes that hold a wrong one", "GDAL, mode, from 4 x 4 cells on", figures, "none"]]


def windows():
    import windows

    rows = []
    for name, job in [("shoreline", "windows of the class map, at any level"), ("relief", "windows of the elevation model, at any level")]:
        raster = WORK / f"{name}_zstd.tif"
        windows_file = windows.listed(raster, name)
        theirs = windows.peer(raster, windows_file, "other")
        ours = windows.rates(WORK / f"{name}.goblin", "--only", "windows", "--windows", windows_file)[1]["windows"]
        rows.append([job, "rasterio, COG with ZSTD", rate(theirs), rate(ours)])
    return rows


def points():
    """Ours is the whole program, with text input and output; rasterio's is its call alone."""
    import random
    import time

    import rasterio
    import windows

    ours, _ = windows.points(WORK / "shoreline.goblin")
    random.seed(4)
    positions = [(random.uniform(-180, 180), random.uniform(-90, 90)) for _ in range(50_000)]
    with rasterio.open(WORK / "shoreline_zstd.tif") as file:
        rates = []
        for _ in range(3):
            began = time.process_time()
            list(file.sample(positions))
            rates.append(len(positions) / (time.process_time() - began))
        theirs = sorted(rates)[1]
    return [["points of the class map", "rasterio's `sample`", rate(theirs), rate(ours)]]


def zones():
    figures = dict(re.findall(r"^(\w+ \(area\)): ([\d.]+) s", script("zonal.py", SHORELINE.parent), re.MULTILINE))
    seconds = [f"{float(figures[f'{name} (area)']):.3g} s" for name in ("exactextract", "spinney")]
    return [["areas of the classes in 1,000 polygons, exactly", "exactextract", *seconds]]


def contours():
    goblin, out, other = WORK / "relief.goblin", WORK / "lines.geojson", WORK / "lines_gdal.geojson"
    ours = runs([SPINNEY, "-q", "contours", goblin, "--every", "100", "-o", out])
    other.unlink(missing_ok=True)
    theirs = once(["gdal_contour", "-q", "-i", "100", "-a", "value", RELIEF, other])
    for path in (out, other):
        path.unlink()
    return [["contour lines of the elevation model every 100 m", "gdal_contour, GeoJSON", cost(theirs), cost(ours)]]


def bodies():
    """Both sides have the same triangles, with vertices on one grid. manifold3d works in memory,
    and takes longer to read them."""

    def inside(*words):
        command = [sys.executable, "-B", HERE / "booleans.py", "inside", *words]
        return json.loads(subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True).stdout)

    import statistics

    pairs = WORK / "booleans"
    pairs.mkdir(exist_ok=True)
    facts = inside("make", "armadillo", "armadillo.ply", "bunny_hr.ply", "scaled", ".ply")
    meshes = [pairs / f"armadillo_{side}.ply" for side in "ab"]
    models = [mesh.with_suffix(".goblin") for mesh in meshes]
    for mesh, model in zip(meshes, models):
        once([SPINNEY, "-q", "build", mesh, "-o", model, "--brep", "--snap", repr(facts["grid"])])
    ours = runs([SPINNEY, "-q", "--threads", "1", "combine", "a-b", *models, "-o", WORK / "result.goblin"])
    theirs = [inside("measured", "manifold3d", 2, *meshes) for _ in range(3)]
    alone, whole, peak = (
        statistics.median(found)
        for found in ([run["seconds"][-1] for run in theirs], [sum(run["seconds"]) for run in theirs], [run["peak"] for run in theirs])
    )
    job = f"one scan without another ({facts['triangles']:,} triangles), from file to file"
    figures = f"{alone:.2f} s in memory, {whole:.2f} s with reading, {peak:.0f} MiB"
    return [[job, "manifold3d, in floating point", figures, cost(ours)]]


PARTS = {"windows": windows, "points": points}


def machine():
    model = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "unknown processor")
    memory = next(int(line.split()[1]) for line in open("/proc/meminfo") if line.startswith("MemTotal"))
    return f"{os.cpu_count()} cores ({model}), {memory / 2**20:.0f} GiB of memory"


def versions():
    gdal = subprocess.check_output(["gdalinfo", "--version"], text=True).split(",")[0]
    code = "import importlib.metadata as m, sys; print(', '.join(f'{name} {m.version(name)}' for name in sys.argv[1:]))"
    return f"{gdal}, " + subprocess.check_output([sys.executable, "-c", code, *PEERS], text=True).strip()


def main():
    start()
    load = os.getloadavg()[0]
    rows = [*building(), *bodies(), *majorities()]
    rows += part("windows") if arguments.rates else []
    rows += [*part("points"), *zones(), *contours()]
    commit = arguments.commit or subprocess.check_output(["git", "rev-parse", "--short=7", "HEAD"], cwd=ROOT, text=True).strip()
    lines = [BEGIN, "| job | peer | peer's figure | Spinney |", "| --- | --- | --- | --- |"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    figures = f"{datetime.date.today()}, commit {commit}, a machine with {machine()}, load {load:.1f} from other work; {versions()}."
    lines += ["", figures, END]
    if arguments.print:
        return print("\n".join(lines))
    readme = ROOT / "README.md"
    before, _, rest = readme.read_text().partition(BEGIN)
    _, found, after = rest.partition(END)
    if not found:
        sys.exit(f"README.md: the table's place, from `{BEGIN}` to `{END}`, is not there")
    readme.write_text(before + "\n".join(lines) + after)


if arguments.part:
    print(json.dumps(PARTS[arguments.part]()))
else:
    main()
