#!/usr/bin/env python3
"""Files on a web server with a latency of 50 ms per response: tiles, class areas of countries and
random points, each with empty caches, against rasterio and exactextract on COGs (ZSTD) from the
same server.

    pip install numpy rasterio exactextract titiler.core uvicorn
    npm, for the countries (world-atlas, of Natural Earth)
    cargo build --release --features remote
    PYTHON=python [CODEC=packed] benches/peers/remote.py [tiles] [countries] [points] [titiler]

Seconds are wall time, since waiting is what is measured. Ours are whole runs of the program; the
others' begin after all imports.

`titiler`, which is not in the default set, sends the same class areas to titiler's POST
`/statistics`: whole cells of each class, at the file's resolution and at that of 1024 pixels, and
cells by their inside share, with an expression for each class. It writes `work/countries.geojson`
for pages.mjs.
"""

import json
import math
import os
import random
import re
import statistics
import subprocess
import sys
import time
import urllib.parse
import urllib.request
from pathlib import Path

from common import RELIEF, ROOT, SHORELINE, SPINNEY, WORK, cog, once, record, row, start, table, tree, verdict
from serve import TITILER, free_port, wait_for

sys.path.insert(0, str(ROOT / "tests" / "servers"))
from ranges import serve  # noqa: E402

PYTHON = os.environ.get("PYTHON", sys.executable)
LATENCY = 0.05
# How segments are packed.
CODEC = os.environ.get("CODEC", "plain")

# Nothing is cached between queries.
COLD = {"CPL_VSIL_CURL_NON_CACHED": "/vsicurl/", "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR", "VSI_CACHE": "FALSE"}

TILES = """
import json, sys, time
import rasterio
from rasterio.windows import Window
times = []
for left, top, cells, factor in json.load(sys.stdin):
    began = time.perf_counter()
    with rasterio.open(sys.argv[1]) as raster:
        raster.read(1, window=Window(left, top, cells, cells), out_shape=(256, 256))
    times.append(time.perf_counter() - began)
print(json.dumps(times))
"""

COUNTRIES = """
import json, sys, time
from exactextract import exact_extract
times, areas = [], []
for country in json.load(sys.stdin):
    began = time.perf_counter()
    found = exact_extract(sys.argv[1], [country], ["unique", "frac", "count"])[0]["properties"]
    times.append(time.perf_counter() - began)
    areas.append({int(u): float(x) * found["count"] for u, x in zip(found["unique"], found["frac"])})
print(json.dumps([times, areas]))
"""

POINTS = """
import json, sys, time
import rasterio
points = json.load(sys.stdin)
began = time.perf_counter()
with rasterio.open(sys.argv[1]) as raster:
    values = [int(value[0]) for value in raster.sample(points)]
print(json.dumps([time.perf_counter() - began, values]))
"""


def peer(script, url, given):
    """Returns the output of a Python script."""
    run = subprocess.run([PYTHON, "-c", script, url], input=json.dumps(given), capture_output=True, text=True, env={**os.environ, **COLD})
    if run.returncode:
        sys.exit(f"failed: {run.stderr}")
    return json.loads(run.stdout)


def ours(*words, given=None):
    """Returns the seconds of a run of the program, its output, and batches, requests and bytes."""
    began = time.perf_counter()
    run = subprocess.run([SPINNEY, "-v", *words], input=given, capture_output=True, text=True)
    seconds = time.perf_counter() - began
    if run.returncode:
        sys.exit(f"failed: {' '.join(map(str, words))}: {run.stderr}")
    return seconds, run.stdout, list(map(int, re.search(r"(\d+) batches, (\d+) requests, (\d+) bytes", run.stderr).groups()))


def made(raster, name):
    """Returns the name of a raster's tree, which is built if it does not exist."""
    name = f"{name}.goblin" if CODEC == "plain" else f"{name}_{CODEC}.goblin"
    tree(raster, WORK / name, "--codec", CODEC)
    return name


def tiles(server):
    rows, results = [], []
    for name, raster, size in [("relief", RELIEF, (4320, 2160)), ("shoreline", SHORELINE, (43200, 21600))]:
        cog(raster, WORK / f"{name}_zstd.tif", "COMPRESS=ZSTD", "PREDICTOR=YES")
        goblin = made(raster, name)
        rng = random.Random(5)
        wanted = []
        for _ in range(20):
            factor = 2 ** rng.randrange(4 if name == "relief" else 7)
            cells = 256 * factor
            wanted.append((rng.randrange(max(1, size[0] - cells)), rng.randrange(max(1, size[1] - cells)), cells, factor))
        depth = json.loads(subprocess.check_output([SPINNEY, "info", "--json", WORK / goblin]))["depth"]
        server.counts()
        theirs = peer(TILES, f"{server.url}/{name}_zstd.tif", wanted)
        their_kib = server.counts()["bytes"] / len(wanted) / 1024
        found = []
        for left, top, cells, factor in wanted:
            level = depth - factor.bit_length() + 1
            found.append(ours("get", f"{server.url}/{goblin}", WORK / "tile.npy", "--window", f"{left},{top},{cells},{cells}", "--level", str(level)))
        seconds = statistics.median(seconds for seconds, _, _ in found)
        batches = [counts[0] for _, _, counts in found]
        kib = statistics.median(counts[2] for _, _, counts in found) / 1024
        mean = statistics.mean(counts[2] for _, _, counts in found) / 1024
        ratio = seconds / statistics.median(theirs)
        if CODEC == "plain":
            results += [
                row(f"cold open and a tile of 256 x 256, {name}, plain", "s", seconds, "rasterio", statistics.median(theirs)),
                row(f"cold tile, {name}, plain: batches", "batches", statistics.median(batches)),
                row(f"cold tile, {name}, plain: bytes", "KiB", kib),
            ]
        else:
            job = f"cold tile of 256 x 256, {name}, {CODEC}"
            results.append(row(job, "s", seconds, "rasterio", statistics.median(theirs)))
            results.append(row(f"{job}: bytes", "KiB", mean, "rasterio", their_kib))
        rows.append([name, f"{seconds:.3f}", f"{statistics.median(theirs):.3f}", verdict(ratio, 0.7, least=False), f"{statistics.median(batches)}, at most {max(batches)}", f"{kib:.0f}, of all {mean:.0f}", f"{their_kib:.0f}"])
    table(["cold open and a tile of 256 x 256", "ours, s", "rasterio, s", "ratio (0.7)", "batches (3)", "KiB, median and mean", "rasterio, mean KiB"], rows)
    record("remote files", results)


def all_countries():
    """Returns features of all countries, from the npm package."""
    directory = WORK / "world-atlas"
    if not directory.exists():
        subprocess.run(["npm", "install", "--silent", "--no-save", "--prefix", directory, "world-atlas@2"], check=True)
    world = json.loads((directory / "node_modules" / "world-atlas" / "countries-110m.json").read_text())
    scale, move = world["transform"]["scale"], world["transform"]["translate"]
    arcs = []
    for arc in world["arcs"]:
        x = y = 0
        points = []
        for dx, dy in arc:
            x, y = x + dx, y + dy
            points.append([x * scale[0] + move[0], y * scale[1] + move[1]])
        arcs.append(points)

    def ring(numbers):
        points = []
        for number in numbers:
            arc = arcs[number] if number >= 0 else arcs[~number][::-1]
            points += arc[1 if points else 0 :]
        return points

    found = []
    for country in world["objects"]["countries"]["geometries"]:
        polygons = country["arcs"] if country["type"] == "MultiPolygon" else [country["arcs"]]
        rings = [[ring(numbers) for numbers in polygon] for polygon in polygons]
        geometry = {"type": "MultiPolygon", "coordinates": rings}
        found.append({"type": "Feature", "properties": {"name": country["properties"]["name"]}, "geometry": geometry})
    return found


def countries():
    """Returns 40 countries."""
    return random.Random(7).sample(all_countries(), 40)


def class_areas(server):
    cog(SHORELINE, WORK / "shoreline_zstd.tif", "COMPRESS=ZSTD", "PREDICTOR=YES")
    goblin = made(SHORELINE, "shoreline")
    wanted = countries()
    server.counts()
    theirs, areas = peer(COUNTRIES, f"{server.url}/shoreline_zstd.tif", wanted)
    their_bytes = server.counts()["bytes"]
    found, worst = [], 0.0
    # Russia's rings intersect themselves, which each tool resolves differently.
    for country, expected in zip(wanted, areas):
        path = WORK / "country.geojson"
        path.write_text(json.dumps({"type": "FeatureCollection", "features": [country]}))
        seconds, text, counts = ours("stats", f"{server.url}/{goblin}", "--zones", str(path), "--edge", "area", "--json")
        classes = {int(c["value"]): c["cells"] for c in json.loads(text)["zones"][0]["classes"]}
        worst = max(worst, *(abs(classes.get(int(number), 0) - cells) / sum(expected.values()) for number, cells in expected.items())) if country["properties"]["name"] != "Russia" else worst
        found.append((seconds, counts))
    seconds = statistics.median(seconds for seconds, _ in found)
    batches, most = [counts[0] for _, counts in found], max(counts[2] for _, counts in found)
    ratio = sum(seconds for seconds, _ in found) / sum(theirs)
    shown = [f"{seconds:.3f}", f"{statistics.median(theirs):.3f}", f"{sum(s for s, _ in found):.1f} and {sum(theirs):.1f}", verdict(ratio, 1 / 20, least=False)]
    shown += [f"{statistics.median(batches)}, at most {max(batches)}", f"{statistics.median(c[2] for _, c in found) / 1e6:.2f}, at most {most / 1e6:.2f}", f"{worst:.1e}"]
    one_by_one = sum(counts[2] for _, counts in found)
    # One process for all of them caches what it has read.
    path.write_text(json.dumps({"type": "FeatureCollection", "features": wanted}))
    at_once = ours("stats", f"{server.url}/{goblin}", "--zones", str(path), "--edge", "area", "--json")[2][2]
    shown += [f"{one_by_one / 1e6:.2f}, at once {at_once / 1e6:.2f}; {their_bytes / 1e6:.2f}", verdict(one_by_one / their_bytes, 1 / 10, least=False), f"{at_once / their_bytes:.3f}"]
    table(["class areas of a country", "rasterio + exactextract, s", "all 40, s", "ratio (1/20)", "batches (4)", "MB (2)", "largest difference", "MB, all 40; theirs", "share (1/10)", "at once"], [shown])
    job, all_jobs, known = f"class areas of a country, shoreline, {CODEC}", f"class areas of {len(wanted)} countries", "rasterio and exactextract"
    record("remote files", [
        row(job, "s", seconds, known, statistics.median(theirs)),
        row(f"{job}: batches", "batches", statistics.median(batches)),
        row(f"{job}: bytes", "MB", statistics.median(counts[2] for _, counts in found) / 1e6),
        row(f"{all_jobs}, one by one, {CODEC}: bytes", "MB", one_by_one / 1e6, known, their_bytes / 1e6),
        row(f"{all_jobs} in one run, {CODEC}: bytes", "MB", at_once / 1e6, known, their_bytes / 1e6),
    ])


# The queries sent to titiler, and the classes in their results; an expression's sums are weighted
# by the inside share of a cell.
CLASSES = range(5)
STATISTICS = {
    "titiler, the file's resolution": "categorical=true",
    "titiler, max_size=1024": "categorical=true&max_size=1024",
    "titiler, an expression per class": "expression=" + urllib.parse.quote(";".join(f"where(b1=={value},1,0)" for value in CLASSES)),
}
# As its documentation advises.
ADVISED = {"GDAL_HTTP_MERGE_CONSECUTIVE_RANGES": "YES", "GDAL_INGESTED_BYTES_AT_OPEN": "32768"}


def box_in_cells(country):
    """Returns columns and rows of the shoreline that a country's box touches."""
    corners = [corner for polygon in country["geometry"]["coordinates"] for ring in polygon for corner in ring]
    return [math.ceil(max(axis) * 120) - math.floor(min(axis) * 120) for axis in zip(*corners)]


def areas_of(query, result, country):
    """Returns cells of each class from titiler's response."""
    bands = result["properties"]["statistics"]
    if query.startswith("expression"):
        return {value: band["sum"] for value, band in zip(CLASSES, bands.values())}
    columns, rows = box_in_cells(country)
    factor = max(1, max(columns, rows) / 1024) if "max_size" in query else 1
    cells = columns / math.ceil(columns / factor) * rows / math.ceil(rows / factor)
    counts, values = bands["b1"]["histogram"]
    return {int(value): count * cells for value, count in zip(values, counts)}


def farthest(found, expected):
    """Returns the maximum error of the cells of a class, as a share of all cells."""
    return max(abs(found.get(value, 0) - expected.get(value, 0)) for value in CLASSES) / sum(expected.values())


def remote_statistics(server):
    name, raster = made(SHORELINE, "shoreline"), "served_shoreline_cog.tif"
    cog(SHORELINE, WORK / raster, "COMPRESS=ZSTD", "BLOCKSIZE=256", "OVERVIEW_RESAMPLING=MODE")
    # Their rings intersect themselves, which each tool resolves differently. Russia's box, 208
    # million cells, would also take titiler tens of GB.
    wanted = [country for country in countries() if country["properties"]["name"] not in ("Russia", "Sudan")]
    file = WORK / "countries.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": wanted}))
    server.counts()
    seconds, areas = peer(COUNTRIES, f"{server.url}/{raster}", wanted)
    areas = [{int(value): cells for value, cells in country.items()} for country in areas]
    counts = server.counts()
    rows = [["exactextract", f"{statistics.median(seconds):.2f}, at most {max(seconds):.2f}", "", f"{counts['requests'] / len(wanted):.0f}", f"{counts['bytes'] / len(wanted) / 1e6:.3f}", "", ""]]

    figures = {"exactextract": {
        ": median": ("s", statistics.median(seconds)), ": maximum": ("s", max(seconds)),
        ": requests": ("requests", counts["requests"] / len(wanted)), ": bytes": ("MB", counts["bytes"] / len(wanted) / 1e6),
    }}  # fmt: skip

    def add(name, found):
        """Adds a row of seconds, batches or requests, bytes, peak MiB and error shares, over the
        countries."""
        seconds, counts, size, peak, off = zip(*found)
        figures[name] = {
            ": median": ("s", statistics.median(seconds)), ": maximum": ("s", max(seconds)),
            ": requests": ("requests", statistics.median(counts)),
            ": bytes": ("MB", statistics.mean(size) / 1e6), ": bytes, maximum": ("MB", max(size) / 1e6),
            ": memory": ("MiB", statistics.median(peak)), ": memory, maximum": ("MiB", max(peak)),
            ": error, median": ("of the cells", statistics.median(off)), ": error, maximum": ("of the cells", max(off)),
        }  # fmt: skip
        at = off.index(max(off))
        worst = f"{statistics.median(off):.1e}, at most {max(off):.1e} ({wanted[at]['properties']['name']})"
        rows.append([name, f"{statistics.median(seconds):.2f}, at most {max(seconds):.2f}", "", f"{statistics.median(counts):.0f}, at most {max(counts)}",
                     f"{statistics.mean(size) / 1e6:.3f}, at most {max(size) / 1e6:.2f}", f"{statistics.median(peak):.0f}, at most {max(peak):.0f}", worst])
        return rows[-1]

    found = []
    for country, expected in zip(wanted, areas):
        one = WORK / "country.geojson"
        one.write_text(json.dumps(country))
        words = ["stats", f"{server.url}/{name}", "--zones", str(one), "--edge", "area", "--json"]
        seconds, text, (batches, requests, size) = ours(*words)
        classes = {int(c["value"]): c["cells"] for c in json.loads(text)["zones"][0]["classes"]}
        found.append((seconds, requests, size, once([SPINNEY, *words])[2], farthest(classes, expected)))
        found[-1] = (*found[-1], batches)
    add("ours", [line[:5] for line in found])[2] = f"at most {max(line[5] for line in found)}"

    port = free_port()
    process = subprocess.Popen([PYTHON, "-c", TITILER, str(port)], env={**os.environ, **COLD, **ADVISED})
    wait_for(port)
    for name, query in STATISTICS.items():
        found = []
        for country, expected in zip(wanted, areas):
            Path(f"/proc/{process.pid}/clear_refs").write_text("5")
            address = f"http://127.0.0.1:{port}/statistics?{query}&url={urllib.parse.quote(f'{server.url}/{raster}')}"
            request = urllib.request.Request(address, data=json.dumps(country).encode(), headers={"Content-Type": "application/json"})
            server.counts()
            began = time.perf_counter()
            result = json.load(urllib.request.urlopen(request))
            seconds = time.perf_counter() - began
            counts = server.counts()
            lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
            peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
            found.append((seconds, counts["requests"], counts["bytes"], peak, farthest(areas_of(query, result, country), expected)))
        add(name, found)
    process.terminate()
    process.wait()
    table([f"class areas of {len(wanted)} countries, each cold", "s, median", "batches", "requests", "MB, mean", "peak MiB", "off from exactextract, median"], rows)
    job, mine = f"class areas of {len(wanted)} countries, shoreline, {CODEC}", figures.pop("ours")
    record("remote files", [row(job + end, unit, mine[end][1], known, figure) for known, theirs in figures.items() for end, (unit, figure) in theirs.items()])


def points(server):
    rows = []
    for name, raster in [("relief", RELIEF), ("shoreline", SHORELINE)]:
        cog(raster, WORK / f"{name}_zstd.tif", "COMPRESS=ZSTD", "PREDICTOR=YES")
        goblin = made(raster, name)
        rng = random.Random(2)
        positions = [(rng.uniform(-179.9, 179.9), rng.uniform(-89.9, 89.9)) for _ in range(10_000)]
        theirs, expected = peer(POINTS, f"{server.url}/{name}_zstd.tif", positions)
        text = "".join(f"{x!r},{y!r}\n" for x, y in positions)
        seconds, output, counts = ours("point", f"{server.url}/{goblin}", "--in", "world", given=text)
        values = [line.split()[-1] for line in output.splitlines()]
        same = sum(value == str(number) for value, number in zip(values, expected))
        job = f"10,000 random points, {name}, {CODEC}"
        record("remote files", [
            row(job, "s", seconds, "rasterio", theirs),
            row(f"{job}: batches", "batches", counts[0]),
            row(f"{job}: bytes", "MB", counts[2] / 1e6),
        ])
        rows.append([name, f"{seconds:.3f}", f"{theirs:.3f}", verdict(seconds / theirs, 1 / 20, least=False), counts[0], f"{counts[2] / 1e6:.1f}", same])
    table(["10,000 random points", "ours, s", "rasterio, s", "ratio (1/20)", "batches", "MB", "values alike"], rows)


if __name__ == "__main__":
    start()
    requested = sys.argv[1:] or ["tiles", "countries", "points"]
    with serve(WORK, LATENCY) as running:
        for name, work in [("tiles", tiles), ("countries", class_areas), ("points", points), ("titiler", remote_statistics)]:
            if name in requested:
                work(running)
