#!/usr/bin/env python3
"""Buildings of city files: which are solids and their volumes, by `spinney build --brep --skip-bad`
and `stats --each`, against trimesh and cjval.

    verdicts.py
    verdicts.py lines     with cjval's verdict of each building, which takes it a tenth of a second

Files are those of Delft and Rotterdam in ../shared/data. What is compared, and what is not:

- trimesh does not read CityJSON: the file is read here, each ring becomes a fan of triangles over
  the file's own vertices (equal ones are merged; rings that return to a point are split), and an
  object is closed if trimesh finds each edge twice, in opposite directions (`is_watertight`,
  `is_winding_consistent`). It does not check whether faces intersect, for which we reject an
  object: those that only one of us accepts are listed by name. Volumes are compared for objects
  that both accept.
- cjval checks the schema, relations, and vertex numbers, not geometry: its verdict does not cover
  solids. It has one for a file, or for each line of a CityJSONSeq file, which is written here with
  a building per line.

Processor seconds are those of whole processes with one thread: ours to build and to measure,
cjval's of the file, and Python's without its imports. `cargo install cjval --features
build-binary`, and trimesh as for exact.py. The program is target/release/spinney, or SPINNEY; cjval
is taken from the path, or CJVAL.
"""

import csv
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

os.environ["RAYON_NUM_THREADS"] = "1"

from common import ROOT, SPINNEY, WORK, record, row, start, table, verdict
from exact import PYTHON, install

DATA = ROOT.parent / "shared" / "data"
FILES = [DATA / "mesh/cityjson/delft.json", DATA / "mesh/cityjson/rotterdam_subset.json", DATA / "hostile/mesh/DELFSHAVEN.city.json"]
CJVAL = os.environ.get("CJVAL", "cjval")


def buildings(city):
    """Returns buildings with a geometry, and their surfaces as lists of rings of vertex numbers."""
    for name, about in city["CityObjects"].items():
        surfaces = []
        for geometry in about.get("geometry", []) if about["type"] == "Building" else []:
            for part in geometry["boundaries"]:
                surfaces += part if geometry["type"] == "Solid" else [part]
        if surfaces:
            yield name, surfaces


def loops(ring):
    """Splits a ring that returns to a point, such as a hole joined by a bridge; removes edges
    traversed forth and back."""
    found, path = [], []
    for at in ring:
        if at in path:
            start = path.index(at)
            found.append(path[start:])
            del path[start:]
        path.append(at)
    return [loop for loop in [*found, path] if len(loop) > 2]


def peer():
    """Prints trimesh's result for each building: whether it is closed, and its volume; and
    processor seconds."""
    import time

    import numpy as np
    import trimesh

    began = time.process_time()
    city = json.loads(Path(sys.argv[2]).read_text())
    grid = np.array(city["vertices"], dtype="f8")
    step = np.array(city["transform"]["scale"])
    points, same = np.unique(grid, axis=0, return_inverse=True)
    same = same.ravel().tolist()
    found = {}
    for name, surfaces in buildings(city):
        rings = [loop for rings in surfaces for ring in rings for loop in loops([same[at] for at in ring])]
        fans = np.array([(ring[0], ring[i], ring[i + 1]) for ring in rings for i in range(1, len(ring) - 1)])
        # Relative to one of its own vertices, so that volumes lose no digits far from the origin.
        used, fans = np.unique(fans, return_inverse=True)
        mesh = trimesh.Trimesh((points[used] - points[used[0]]) * step, fans.reshape(-1, 3), process=False)
        closed = bool(mesh.is_watertight and mesh.is_winding_consistent)
        found[name] = float(mesh.volume) if closed else None
    print(json.dumps({"objects": found, "seconds": time.process_time() - began}))


def measured(command, **more):
    """Returns a finished process, and its processor seconds."""

    def spent():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before = spent()
    made = subprocess.run([str(word) for word in command], check=False, capture_output=True, text=True, **more)
    return made, spent() - before


def ours(path):
    """Returns volumes of the solids, reasons why the others are none, and processor seconds."""
    model = WORK / "verdicts.goblin"
    model.unlink(missing_ok=True)
    made, seconds = measured([SPINNEY, "build", path, "-o", model, "--brep", "--skip-bad", "--where", "type=Building"])
    lines = made.stderr.splitlines() + made.stdout.splitlines()
    if made.returncode:
        assert "none of its objects is a body" in made.stderr, made.stderr
        return {}, seconds
    out, more = measured([SPINNEY, "stats", "--each", model])
    assert out.returncode == 0, out.stderr
    # A solid of several touching components counts as a solid as well.
    rows = csv.DictReader(out.stdout.splitlines())
    volumes = {row["id"]: float(row["volume"]) for row in rows if row["closed"] == "true"}
    left_out = sum(line.startswith("skipped") for line in lines)
    assert left_out + len(volumes) == len(dict(buildings(json.loads(path.read_text())))), (left_out, len(volumes))
    return volumes, seconds + more


def sequence(path):
    """Writes a CityJSONSeq file with a building per line, each with its own vertices."""
    city = json.loads(path.read_text())
    lines = [json.dumps({**{key: city[key] for key in ("type", "version", "transform")}, "CityObjects": {}, "vertices": []})]

    def numbered(boundaries, numbers):
        if isinstance(boundaries, int):
            return numbers.setdefault(boundaries, len(numbers))
        return [numbered(part, numbers) for part in boundaries]

    for name, _ in buildings(city):
        about, numbers = city["CityObjects"][name], {}
        # Textures are ignored.
        geometry = [{**{key: it[key] for key in ("type", "lod", "semantics") if key in it}, "boundaries": numbered(it["boundaries"], numbers)} for it in about["geometry"]]
        feature = {"type": "CityJSONFeature", "id": name, "CityObjects": {name: {**about, "geometry": geometry}}}
        lines.append(json.dumps({**feature, "vertices": [city["vertices"][at] for at in numbers]}))
    target = WORK / f"{path.stem}.city.jsonl"
    target.write_text("\n".join(lines) + "\n")
    return target


def main():
    start(data=False, peer="python3")
    install()
    rows, results = [], []
    for path in FILES:
        volumes, seconds = ours(path)
        said = json.loads(measured([PYTHON, __file__, "--peer", path])[0].stdout)
        theirs = {name: volume for name, volume in said["objects"].items() if volume is not None}
        both = volumes.keys() & theirs.keys()
        off = max((abs(volumes[name] / theirs[name] - 1) for name in both), default=0.0)
        print(f"{path.name}: ours alone {sorted(volumes.keys() - theirs.keys())}, trimesh alone {sorted(theirs.keys() - volumes.keys())}")
        report, cjval = measured([CJVAL, "--report", path])
        report = json.loads(report.stdout)
        print(f"  cjval: valid {report['valid']}, warnings {report['has_warnings']}")
        if sys.argv[1:] == ["lines"]:
            with sequence(path).open() as lines:
                made, more = measured([CJVAL, "--summary"], stdin=lines)
            print(f"  cjval, a building a line, {more:.1f} CPU s: {' '.join(made.stdout.split())}")
        counts = [len(said["objects"]), len(volumes), len(theirs), len(both), f"{off:.1e}"]
        peers = [said["seconds"], cjval]
        job = f"verdicts and volumes of buildings, {path.name}"
        results.append(row(job, "CPU s", seconds, "trimesh", said["seconds"]))
        results.append(row(job, "CPU s", seconds, "cjval", cjval, note="The peer checks no geometry."))
        rows.append([path.name, *counts, *(f"{own:.3f}" for own in [seconds, *peers]), *(verdict(seconds / own, 0.2, least=False) for own in peers)])
    head = ["file", "buildings", "bodies: ours", "trimesh", "both", "volumes differ", "CPU s: ours", "trimesh", "cjval", "ours / trimesh", "ours / cjval"]
    table(head, rows)
    record("exact models", results)


if __name__ == "__main__":
    peer() if sys.argv[1:2] == ["--peer"] else main()
