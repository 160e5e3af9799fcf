#!/usr/bin/env python3
"""Nearest lines of points, and windows: trees of lines against shapely's STRtree.

    SPINNEY=target/release/spinney python benches/peers/lines.py [POINTS] [ROADS]

The default is a million points and 100,000 roads.
Needs a Python with the peer: pip install numpy shapely pyogrio. Roads are random walks of 20
vertices, with points among them; both have a resolution of 1 cm, and are reproducible. Reports
medians of three runs of whole processes, processor seconds next to wall seconds; the results are
compared. The peer reads the roads and builds its tree each time, as it has no file format for it;
its queries alone are reported separately.
"""

import json
import os
import statistics
import subprocess
import sys
import time

from common import SPINNEY, WORK, costs, once, record, row, table, verdict

POINTS = int(float(sys.argv[1])) if len(sys.argv) > 1 and sys.argv[1] != "--job" else 1_000_000
ROADS = int(float(sys.argv[2])) if len(sys.argv) > 2 and sys.argv[1] != "--job" else 100_000
SIDE, VERTICES, STEP = 100_000, 20, 50
WINDOWS = 2000


def make(roads, points, windows, counts):
    """Writes roads as GeoPackage, points as CSV, windows as JSON."""
    import numpy as np
    import pyogrio
    import shapely

    random = np.random.default_rng(7)
    heading = random.uniform(0, 2 * np.pi, (counts[0], 1)) + np.cumsum(random.normal(0, 0.3, (counts[0], VERTICES - 1)), axis=1)
    steps = random.uniform(0.3, 1.7, heading.shape)[..., None] * STEP * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    start = random.uniform(0, SIDE, (counts[0], 1, 2))
    positions = np.round(np.concatenate([start, start + np.cumsum(steps, axis=1)], axis=1), 2)
    lines = shapely.linestrings(positions.reshape(-1, 2), indices=np.repeat(np.arange(counts[0]), VERTICES))
    names = np.array([f"road {number}" for number in range(counts[0])], dtype=object)
    lanes = random.integers(1, 5, counts[0])
    pyogrio.raw.write(roads, shapely.to_wkb(lines), [names, lanes], ["name", "lanes"], geometry_type="LineString", crs="EPSG:25833", driver="GPKG")
    positions = np.round(random.uniform(0, SIDE, (counts[1], 2)), 2)
    with open(points, "w") as file:
        file.write("x,y,house\n")
        file.writelines(f"{x:.2f},{y:.2f},{number}\n" for number, (x, y) in enumerate(positions))
    corners = random.uniform(0, SIDE * 0.99, (WINDOWS, 2)).round(2)
    with open(windows, "w") as file:
        json.dump(np.concatenate([corners, corners + SIDE * 0.01], axis=1).tolist(), file)


def peer(roads, points, windows, out):
    """Runs the same with shapely, in a separate process; prints the seconds of its phases."""
    import numpy as np
    import pyogrio
    import shapely

    figures, began = {}, time.process_time()

    def part(name):
        nonlocal began
        figures[name], began = time.process_time() - began, time.process_time()

    _, _, wkb, (names, lanes) = pyogrio.raw.read(roads)
    lines = shapely.from_wkb(wkb)
    part("read roads")
    tree = shapely.STRtree(lines)
    tree.query(shapely.box(0, 0, 1, 1))
    part("build")
    if windows:
        with open(windows) as file:
            boxes = [shapely.box(*corners) for corners in json.load(file)]
        began = time.process_time()
        found = [len(tree.query(box, predicate="intersects")) for box in boxes]
        part("windows")
        figures["features"] = sum(found)
        print(json.dumps(figures))
        return
    rows = np.loadtxt(points, delimiter=",", skiprows=1)
    positions = shapely.points(rows[:, :2])
    part("read points")
    nearest = tree.nearest(positions)
    part("nearest")
    distances = shapely.distance(positions, lines[nearest])
    part("distances")
    with open(out, "w") as file:
        file.write("wkt,house,line,distance,name,lanes\n")
        whole = zip(rows.tolist(), nearest.tolist(), distances.tolist(), names[nearest].tolist(), lanes[nearest].tolist())
        file.writelines(f"POINT ({x} {y}),{house:.0f},{line},{distance},{name},{lane}\n" for (x, y, house), line, distance, name, lane in whole)
    part("write")
    print(json.dumps(figures))


def compare(ours, theirs):
    """Prints how many points have another line, and the maximum difference of distances; runs in a
    separate process."""
    import csv

    others, most = 0, 0.0
    with open(ours, newline="") as one, open(theirs, newline="") as other:
        for mine, its in zip(csv.DictReader(one), csv.DictReader(other), strict=True):
            others += mine["line"] != its["line"]
            most = max(most, abs(float(mine["distance"]) - float(its["distance"])))
    print(f"{others} points have another line; distances differ by {most:.2g} at most\n")


def job(*words):
    return [sys.executable, __file__, "--job", json.dumps(words)]


def three(command, stdin=None):
    """Returns medians of processor seconds, wall seconds and MiB of three runs, and the last
    output."""
    measured = []
    for _ in range(int(os.environ.get("RUNS", 3))):
        with open(WORK / "said", "wb") as said, open(stdin or os.devnull, "rb") as given:
            measured.append(once(command, stdin=given, stdout=said))
    return [statistics.median(column) for column in zip(*measured)], (WORK / "said").read_text()


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    roads, points, windows = (WORK / f"lines_{POINTS}_{ROADS}.{kind}" for kind in ("gpkg", "csv", "json"))
    if not windows.exists():
        subprocess.run(job("make", str(roads), str(points), str(windows), (ROADS, POINTS)), check=True)
    tree = WORK / "lines.goblin"
    built = once([SPINNEY, "-q", "build", roads, "-o", tree, "--index", "lines"])
    print(f"{ROADS} roads of {VERTICES} vertices: {roads.stat().st_size:,} bytes, as a tree {tree.stat().st_size:,} in {built[0]:.2f} s\n")
    ours, theirs = WORK / "lines_ours.csv", WORK / "lines_theirs.csv"
    own, _ = three([SPINNEY, "-q", "stats", tree, "--nearest", points, "-o", ours])
    alone, _ = three([SPINNEY, "-q", "stats", tree, "--nearest", points])
    its, said = three(job("peer", str(roads), str(points), None, str(theirs)))
    figures = json.loads(said)
    rows = [
        ["spinney, from file to file", *(f"{number:.2f}" for number in own)],
        ["spinney, distances alone", *(f"{number:.2f}" for number in alone)],
        ["shapely, from file to file", *(f"{number:.2f}" for number in its)],
        *([f"shapely, {name}", f"{seconds:.2f}", "", ""] for name, seconds in figures.items()),
    ]
    table([f"{POINTS} points", "CPU s", "s", "MiB"], rows)
    name = f"nearest of {ROADS:,} roads for {'a million' if POINTS == 1_000_000 else f'{POINTS:,}'} points"
    results = [
        *costs(name, own, "shapely, from file to file", its),
        row(f"{name}, distances alone", "CPU s", alone[0], "shapely STRtree.nearest alone", figures["nearest"], note="Ours reads the points."),
        row(f"{name}, distances alone: memory", "MiB", alone[2]),
        row(f"{ROADS:,} roads to a tree", "s", built[1]),
        row(f"bytes of {ROADS:,} roads", "MB", tree.stat().st_size / 1e6),
    ]
    print(f"from file to file, CPU: {verdict(its[0] / own[0], 2)}; time that passes: {its[1] / own[1]:.3g}")
    print(f"shapely's STRtree.nearest alone over all that spinney does for distances, CPU: {verdict(figures['nearest'] / alone[0], 2)}\n")
    subprocess.run(job("compare", str(ours), str(theirs)), check=True)
    _, said = three(job("peer", str(roads), None, str(windows), None))
    figures = json.loads(said)
    found, began = 0, time.perf_counter()
    corners = json.loads(windows.read_text())[:200]
    seconds = 0.0
    for window in corners:
        (cpu, _, _), output = three([SPINNEY, "-q", "stats", tree, "--json", "--window", ",".join(map(str, window))])
        seconds += cpu
        found += json.loads(output)["features"]
    print(f"{len(corners)} windows of a hundredth of the side, a process each: {seconds / len(corners) * 1000:.2f} ms, {found} features")
    print(f"{WINDOWS} windows with shapely: {figures['windows'] / WINDOWS * 1000:.3f} ms, {figures['features']} features; reading and building {figures['read roads'] + figures['build']:.2f} s before")
    own, its = seconds / len(corners) * 1000, figures["windows"] / WINDOWS * 1000
    note = "Ours is a process that opens the tree."
    results.append(row(f"window of {found / len(corners):.0f} roads", "ms", own, "shapely, roads in memory", its, note=note))
    record("trees of points and lines", results)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--job"]:
        name, *words = json.loads(sys.argv[2])
        globals()[name](*words)
    else:
        main()
