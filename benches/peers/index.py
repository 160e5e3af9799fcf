#!/usr/bin/env python3
"""Indexes of GeoTIFF files (`spinney index`) against rasterio, exactextract and GDAL on the same
files.

    benches/peers/install.sh; pip install numpy rasterio exactextract shapely
    npm, for the countries (world-atlas, of Natural Earth)
    cargo build --release --features remote
    PYTHON=python benches/peers/index.py [making] [classes] [means] [relief] [tiles] [windows]
        [files] [--quick]

The script first makes COGs of the shoreline and the relief, in `work`. Remote files are on a server
with a latency of 50 ms per response and 10 MB/s for all responses together; nothing is cached
between jobs, except where a row says so. Bytes and batches of the peers are the server's counts.
Their seconds begin after all imports; ours are whole runs of the program.

- `making`: bytes of the index and of the COG; CPU time and memory of making both.
- `classes`: class areas of 40 countries, in one run, compared with shapely's.
- `means`: means of the 40 largest countries on a raster of ARCSECONDS (3) that the script makes, of
  1 GB. It has tiles where the countries are. With 3, exactextract reads 16 billion cells.
- `relief`: means and medians of 1,000 polygons, local.
- `tiles`: tiles of 256 x 256 at random positions, per level, each cold.
- `windows`: windows of 256 x 256, per level, local and warm. Needs `cargo bench` (or RATES, the
  program that it built).
- `files`: FILES (10,000) COGs of 512 x 512 as one index, and batches of a point in it.

`--quick` uses small input, for trying the script; its figures mean nothing and are not recorded.
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
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import common
import index_scripts as scripts
from common import RELIEF, ROOT, SHORELINE, SPINNEY, WORK, costs, once, row, runs, start, table, verdict
from remote import COLD, LATENCY, all_countries, countries

sys.path.insert(0, str(ROOT / "tests" / "servers"))
from ranges import serve  # noqa: E402

PYTHON = os.environ.get("PYTHON", sys.executable)
BANDWIDTH = 10_000_000
QUICK = "--quick" in sys.argv
FILES = int(os.environ.get("FILES", 100 if QUICK else 10_000))
ARCSECONDS = float(os.environ.get("ARCSECONDS", 60 if QUICK else 3))
RASTERS = {"shoreline": SHORELINE, "relief": RELIEF}
# Options of the COGs, and the maximum of the index's bytes, as a share of the COG's.
COGS = {"shoreline": (["COMPRESS=ZSTD", "OVERVIEW_RESAMPLING=MODE"], 0.18), "relief": (["COMPRESS=ZSTD", "PREDICTOR=YES"], 0.10)}


def record(rows):
    if not QUICK:
        common.record("indexes of GeoTIFF files", rows)


def cog(name):
    """Returns a COG in `work`, which is made if it does not exist."""
    target = WORK / f"index_{name}{'_quick' if QUICK else ''}.tif"
    if not target.exists():
        source = RASTERS[name]
        if QUICK and name == "shoreline":
            source = WORK / "index_quick.tif"
            once(["gdal_translate", "-q", "-outsize", "25%", "25%", RASTERS[name], source])
        once([PYTHON, "-c", scripts.COG, source, target, *COGS[name][0]])
    return target


def index(source, **more):
    """Makes an index of a file next to it, and returns its path and what making it cost."""
    target = source.with_suffix(".goblin")
    return target, once([SPINNEY, "-q", "index", source, "-o", target], **more)


def child(script, *words, given=None):
    """Returns the output of a Python script, which reads remote files with cold caches."""
    words = [PYTHON, "-W", "ignore", "-c", script, *map(str, words)]
    run = subprocess.run(words, input=json.dumps(given), capture_output=True, text=True, env={**os.environ, **COLD})
    if run.returncode:
        sys.exit(f"failed: {run.stderr}")
    return json.loads(run.stdout)


def ours(*words):
    """Returns the seconds of a run of the program, its output, and batches, requests and bytes."""
    began = time.perf_counter()
    run = subprocess.run([str(word) for word in [SPINNEY, "-v", *words]], capture_output=True, text=True)
    seconds = time.perf_counter() - began
    if run.returncode:
        sys.exit(f"failed: {' '.join(map(str, words))}: {run.stderr}")
    return seconds, run.stdout, list(map(int, re.search(r"(\d+) batches, (\d+) requests, (\d+) bytes", run.stderr).groups()))


def features(name, zones):
    """Writes features to a file."""
    path = WORK / f"{name}.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": zones}))
    return path


def making(_):
    sizes, makes, results = [], [], []
    for name, (options, share) in COGS.items():
        source, again = cog(name), WORK / "index_again.tif"
        raster = WORK / "index_quick.tif" if QUICK and name == "shoreline" else RASTERS[name]
        theirs = runs([PYTHON, "-c", scripts.COG, raster, again, *options], 1)
        mine = runs([SPINNEY, "-q", "index", source, "-o", source.with_suffix(".goblin")])
        own, other = source.with_suffix(".goblin").stat().st_size, source.stat().st_size
        sizes.append([name, f"{own:,}", f"{other:,}", verdict(own / other, share, least=False)])
        makes.append([name, f"{mine[0]:.2f}", f"{theirs[0]:.2f}", verdict(mine[0] / theirs[0], 0.3, least=False), verdict(mine[2], 64, least=False), f"{theirs[2]:.0f}"])
        results += [row(f"bytes of an index, {name}", "bytes", own, "its COG", other)]
        results += costs(f"making an index, {name}", mine, "writing the COG, rasterio", theirs)
    table(["index of", "bytes", "bytes of the COG", "share (0.18; 0.10)"], sizes)
    table(["making an index of", "CPU s", "writing the COG, CPU s", "ratio (0.3)", "MiB (64)", "of the COG"], makes)
    record(results)


def compared(job, server, target, zones, words, script, bytes_share, time_share):
    """Returns the program's zones and the peer's results; prints and records what both cost."""
    goblin, _ = index(target)
    url = f"{server.url}/{target.name}"
    path = features(target.stem, zones)
    server.counts()
    their_seconds, found = child(script, url, given=zones)
    theirs = server.counts()
    seconds, text, _ = ours("stats", f"{server.url}/{goblin.name}", "--zones", path, "--edge", "area", "--json", *words)
    mine = server.counts()
    rows = [
        ["bytes", f"{mine['bytes']:,}", f"{theirs['bytes']:,}", verdict(mine["bytes"] / theirs["bytes"], bytes_share, least=False)],
        ["s", f"{seconds:.2f}", f"{their_seconds:.2f}", verdict(seconds / their_seconds, time_share, least=False)],
        ["requests", mine["requests"], theirs["requests"], ""],
        ["batches", mine["batches"], theirs["batches"], ""],
    ]
    table([f"{job}, cold", "ours", "rasterio + exactextract", f"ratio (bytes {bytes_share:.2g}, time {time_share:.2g})"], rows)
    record([
        row(f"{job}, cold", "s", seconds, "exactextract", their_seconds),
        row(f"{job}, cold: bytes", "MB", mine["bytes"] / 1e6, "exactextract", theirs["bytes"] / 1e6),
        row(f"{job}, cold: requests", "requests", mine["requests"], "exactextract", theirs["requests"]),
        row(f"{job}, cold: batches", "batches", mine["batches"], "exactextract", theirs["batches"]),
    ])
    return json.loads(text)["zones"], found


def differ(found, expected):
    """Returns the maximum error of the cells of a class, as a share of a zone's cells."""
    shares = [0.0]
    for one, other in zip(found, expected):
        if other is not None:
            shares += [abs(one.get(value, 0) - other.get(value, 0)) / sum(other.values()) for value in {*one, *other}]
    return max(shares)


def classes(server):
    zones = countries()
    found, theirs = compared("class areas of 40 countries, shoreline", server, cog("shoreline"), zones, [], scripts.CLASSES, 1 / 5, 0.6)
    mine = [{int(each["value"]): each["cells"] for each in zone["classes"]} for zone in found]
    theirs = [{int(value): cells for value, cells in zone.items()} for zone in theirs]
    exact = child(scripts.AREAS, cog("shoreline"), given=zones)
    exact = [zone and {int(value): cells for value, cells in zone.items()} for zone in exact]
    checked = sum(zone is not None for zone in exact)
    off, peer_off = differ(mine, exact), differ(theirs, exact)
    print(f"class areas of {checked} valid countries, from shapely's: ours {verdict(off, 1e-9, least=False)} of a zone's cells, exactextract {peer_off:.2g}\n")
    record([row("class areas of countries, shoreline: maximum error", "of a zone's cells", off, "exactextract", peer_off)])


def means(server):
    target, listed = WORK / f"index_heights_{ARCSECONDS:g}.tif", WORK / f"index_heights_{ARCSECONDS:g}.json"
    if not listed.exists():
        listed.write_text(json.dumps(child(scripts.HEIGHTS, target, ARCSECONDS, 40, given=all_countries())))
    zones = json.loads(listed.read_text())
    print(f"raster of {ARCSECONDS:g} arc seconds: {target.stat().st_size:,} bytes\n")
    goblin, used = index(target)
    table(["its index", "bytes", "CPU s", "MiB"], [["", f"{goblin.stat().st_size:,}", f"{used[0]:.1f}", f"{used[2]:.0f}"]])
    job = f"means of the 40 largest countries, {ARCSECONDS:g} arc seconds"
    found, expected = compared(job, server, target, zones, ["--measure", "mean"], scripts.MEANS, 1 / 10, 1 / 5)
    mine = [zone["channels"][0]["mean"] for zone in found]
    off = max(abs(one - other) / abs(other) for one, other in zip(mine, expected))
    print(f"means differ by {off:.2g} of a mean at most\n")


def relief(_):
    target = cog("relief")
    goblin, _ = index(target)
    rng, cell, zones = random.Random(1), 1 / 12, []
    for _ in range(100 if QUICK else 1_000):
        radius, corners = math.exp(rng.uniform(math.log(10), math.log(150))), rng.randrange(8, 60)
        x, y = rng.uniform(-160, 160), rng.uniform(-72, 72)
        away = [(radius * cell * rng.uniform(0.5, 1), 2 * math.pi * number / corners) for number in range(corners)]
        ring = [[x + reach * math.cos(turn), y + reach * math.sin(turn)] for reach, turn in away]
        zones.append({"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}})
    path, own, other = features("index_stars", zones), WORK / "index_stars.json", WORK / "index_stars_peer.json"
    words = ["stats", goblin, "--zones", path, "--edge", "area", "--measure", "mean,median", "--json"]
    with open(own, "w") as out:
        once([SPINNEY, "-q", *words], stdout=out)
    mine = runs([SPINNEY, "-q", *words])
    with open(other, "w") as out:
        theirs = once([PYTHON, "-c", scripts.MEDIANS, target, path], stdout=out)
    found = [zone["channels"][0] for zone in json.loads(own.read_text())["zones"]]
    expected = json.loads(other.read_text())
    off = [max(abs(zone[name] - both[at]) for zone, both in zip(found, expected)) for at, name in enumerate(["mean", "median"])]
    job = f"means and medians of {len(zones):,} polygons, relief"
    table([f"{job}, local", "CPU s", "s", "MiB"], [
        ["ours", *(f"{figure:.2f}" for figure in mine)], ["exactextract on the COG", *(f"{figure:.2f}" for figure in theirs)],
        ["ratio (1/5)", verdict(mine[0] / theirs[0], 1 / 5, least=False), f"means differ by {off[0]:.2g} m at most", f"medians by {off[1]:.2g} m"],
    ])  # fmt: skip
    record(costs(job, mine, "exactextract on the COG", theirs))


def tiles(server):
    """Tiles at random positions. One level above the cells, they are made of four times as many."""
    results, rows, sums = [], [], []
    count = 3 if QUICK else 20
    for name in RASTERS:
        target = cog(name)
        goblin, _ = index(target)
        info = json.loads(subprocess.check_output([SPINNEY, "info", "--json", goblin]))
        depth, size = info["depth"], info["size"]
        environment = {**os.environ, **COLD}
        peer = subprocess.Popen([PYTHON, "-c", scripts.TILES, f"{server.url}/{target.name}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
        rng, checked = random.Random(5), []
        for up in range(9):
            cells = 256 << up
            if cells > min(size[:2]):
                break
            mine, theirs = [], []
            for number in range(count):
                left, top = (rng.randrange((side - cells >> up) + 1) << up for side in size[:2])
                server.counts()
                peer.stdin.write(f"{json.dumps([left, top, cells, cells])}\n")
                peer.stdin.flush()
                theirs.append((float(peer.stdout.readline()), server.counts()))
                tile = WORK / f"index_tile_{name}_{up}_{number}.npy"
                seconds, _, _ = ours("get", f"{server.url}/{goblin.name}", tile, "--window", f"{left},{top},{cells},{cells}", "--level", depth - up)
                mine.append((seconds, server.counts()))
                checked.append([str(tile), [left, top, cells, cells]])
            size_of = [statistics.mean(counts["bytes"] for _, counts in each) for each in (mine, theirs)]
            batches = [[counts["batches"] for _, counts in each] for each in (mine, theirs)]
            seconds = [statistics.median(seconds for seconds, _ in each) for each in (mine, theirs)]
            rows.append([
                name, f"N-{up}" if up else "N", f"{size_of[0] / 1024:.1f}", f"{size_of[1] / 1024:.1f}", verdict(size_of[0] / size_of[1], 4.4 if up == 1 else 1.1, least=False),
                f"{statistics.median(batches[0]):g}, at most {max(batches[0])}", f"{statistics.median(batches[1]):g}, at most {max(batches[1])}",
                verdict(statistics.median(batches[0]), statistics.median(batches[1]), least=False), f"{seconds[0]:.3f}", f"{seconds[1]:.3f}",
            ])  # fmt: skip
            job = f"cold tile of 256 x 256, {name}, level N-{up}"
            results += [
                row(job, "s", seconds[0], "rasterio", seconds[1]),
                row(f"{job}: bytes", "KiB", size_of[0] / 1024, "rasterio", size_of[1] / 1024),
                row(f"{job}: batches", "batches", statistics.median(batches[0]), "rasterio", statistics.median(batches[1])),
            ]
        peer.stdin.close()
        peer.wait()
        if name == "shoreline":
            sums = checked
    table(["cold tile", "level", "KiB, mean", "rasterio", "ratio (1.1; N-1: 4.4)", "batches, median", "rasterio", "batches (at most theirs)", "s, median", "rasterio"], rows)
    run = subprocess.run([PYTHON, "-c", scripts.MAJORITIES, cog("shoreline")], input="".join(f"{json.dumps(each)}\n" for each in sums), text=True, capture_output=True, check=True)
    wrong, theirs = json.loads(run.stdout)
    print(f"pixels of the shoreline's tiles with another class than that of most of their cells: {wrong} ({'met' if not wrong else 'MISSED'}), in the overviews {theirs}\n")
    record([*results, row("cold tiles, shoreline: pixels with a wrong class", "pixels", wrong, "GDAL's overviews, MODE", theirs)])


def windows(_):
    # (In a process of its own: `windows` imports NumPy.)
    with ProcessPoolExecutor(1, get_context("fork")) as pool:
        pool.submit(warm_windows).result()


def warm_windows():
    if QUICK and not os.environ.get("RATES"):
        print("windows: skipped, since --quick builds nothing\n")
        return
    import rasterio
    import windows as shared

    rows, results = [], []
    for name in RASTERS:
        target = cog(name)
        goblin, _ = index(target)
        with rasterio.open(target) as raster:
            size, overviews = (raster.width, raster.height), len(raster.overviews(1))
        for up in range(overviews + 1):
            sides = [-(-side >> up) for side in size]
            if min(sides) < 256:
                break
            rng = random.Random(1)
            lines = [f"{up} {rng.randrange(sides[0] // 256) * 256} {rng.randrange(sides[1] // 256) * 256}\n" for _ in range(100)]
            listed = WORK / "index_level.windows"
            # The peer reads the first quarter four times.
            listed.write_text("".join(lines * 4))
            theirs = shared.peer(target, listed, "again")
            listed.write_text("".join(lines))
            mine = shared.rates(goblin, "--only", "windows", "--windows", listed)[1]["windows"]
            rows.append([name, f"N-{up}" if up else "N", f"{mine:.0f}", f"{theirs:.0f}", verdict(mine / theirs, 1 if up < 2 else 1.3)])
            results.append(row(f"windows of 256 x 256, {name}, level N-{up}, warm", "/s", mine, "rasterio, all cached", theirs))
    table(["windows, local and warm", "level", "ours /s", "rasterio /s", "ours / theirs (1; from N-2: 1.3)"], rows)
    record(results)


def files(_):
    directory = WORK / f"index_files_{FILES}"
    listed, vrt = directory / "list.txt", directory / "all.vrt"
    if not listed.exists():
        directory.mkdir(exist_ok=True)
        once([PYTHON, "-W", "ignore", "-c", scripts.CUT, cog("shoreline"), directory, FILES])
        listed.write_text("".join(f"{path}\n" for path in sorted(directory.glob("*.tif"))))
    goblin = directory / "all.goblin"
    mine = once([SPINNEY, "-q", "index", f"@{listed}", "-o", goblin])
    for old in (vrt, Path(f"{vrt}.ovr")):
        old.unlink(missing_ok=True)
    built = once(["gdalbuildvrt", "-q", "-input_file_list", listed, vrt])
    side = math.isqrt(FILES) * 512
    factors = [2**up for up in range(1, 16) if side >> up >= 256]
    added = once(["gdaladdo", "-q", "-ro", "-r", "mode", "--config", "COMPRESS_OVERVIEW", "ZSTD", vrt, *factors])
    theirs = [built[0] + added[0], built[1] + added[1], max(built[2], added[2])]
    # A point outside of the cells needs no more than opening.
    rng, batches = random.Random(1), []
    with serve(directory, LATENCY, BANDWIDTH) as server:
        for inside in [False] + [True] * 5:
            x, y = (rng.randrange(side) for _ in "xy") if inside else (-1, -1)
            server.counts()
            ours("point", f"{server.url}/{goblin.name}", "--in", "cells", "--", f"{x},{y}")
            batches.append(server.counts()["batches"])
    opening, *points = batches
    job = f"{FILES:,} COGs of 512 x 512 as one"
    other = goblin.stat().st_size, vrt.stat().st_size + Path(f"{vrt}.ovr").stat().st_size
    table([job, "ours", "gdalbuildvrt + gdaladdo", "ratio"], [
        ["CPU s", f"{mine[0]:.2f}", f"{built[0]:.2f} + {added[0]:.2f}", f"{verdict(mine[0] / theirs[0], 1 / 3, least=False)}, target 1/3"],
        ["s", f"{mine[1]:.2f}", f"{theirs[1]:.2f}", ""],
        ["MiB", f"{mine[2]:.0f}", f"{theirs[2]:.0f}", f"{verdict(mine[2], 128, least=False)} MiB, target 128"],
        ["bytes", f"{other[0]:,}", f"{other[1]:,}", f"{other[0] / other[1]:.3g}"],
        ["batches of opening", opening, "", ""],
        ["batches of a point after opening", max(points) - opening, "", f"{verdict(max(points) - opening, 2, least=False)}, target 2"],
    ])  # fmt: skip
    record([
        *costs(job, mine, "gdalbuildvrt + gdaladdo", theirs),
        row(f"{job}: bytes", "bytes", other[0], "gdalbuildvrt + gdaladdo", other[1]),
        row(f"{job}: a point after opening", "batches", max(points) - opening),
    ])  # fmt: skip


def main():
    start()
    for name in COGS:
        cog(name)
    jobs = {work.__name__: work for work in (making, classes, means, relief, tiles, windows, files)}
    requested = [word for word in sys.argv[1:] if not word.startswith("-")]
    with serve(WORK, LATENCY, BANDWIDTH) as server:
        for name in requested or jobs:
            jobs[name](server)


if __name__ == "__main__":
    main()
