#!/usr/bin/env python3
"""Zones whose rings cross, overlap and touch, against shapely: 10,000 random multipolygons over
five contents, each in four storages.

Rings of a part are combined even-odd, parts are united. Cells, VOID cells and cells outside must
equal shapely's areas to 1e-9 of the zone's, sums and means `math.fsum` of shapely's shares to 1e-9,
and all numbers of one content must be bit-identical in every storage.

    pip install numpy shapely
    SPINNEY=target/release/spinney benches/peers/invalid_zones.py [ZONES]
"""

import json
import math
import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from common import record, row

SPINNEY = os.environ.get("SPINNEY", "target/release/spinney")
WIDTH, HEIGHT, NODATA = 24, 20, 255

CONTENTS: dict[str, Callable[[int, int], int]] = {
    "uniform": lambda x, y: 7,
    "noise": lambda x, y: (x * 7919 + y * 104729 + x * x * y) % 251,
    "blocks of 16": lambda x, y: 10 * (x // 16 + 2 * (y // 16)) + 1,
    "VOID": lambda x, y: NODATA if (x * 5 + y * 3) % 7 < 2 or x > 20 else (x + y) % 200,
    "classes": lambda x, y: 1 + (x // 5 + y // 3) % 4,
}


def ring(rng: random.Random) -> list[list[float]]:
    """Returns a ring whose vertices are often on a grid of half cells, so that all kinds of
    contacts are frequent."""
    size, left, low = 3 + rng.randrange(20), rng.randrange(-6, 20), rng.randrange(-6, 16)
    on_grid = rng.random() < 0.5

    def at() -> list[float]:
        x, y = rng.random() * size, rng.random() * size
        return [left + round(2 * x) / 2, low + round(2 * y) / 2] if on_grid else [left + x, low + y]

    if rng.random() < 0.3:
        (x, y), w, h = at(), 1 + rng.randrange(size), 1 + rng.randrange(size)
        return [[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]]
    points = [at() for _ in range(3 + rng.randrange(5))]
    return [*points, points[0]]


def zone(rng: random.Random) -> list[list[list[list[float]]]]:
    return [[ring(rng) for _ in range(1 + rng.randrange(2))] for _ in range(1 + rng.randrange(3))]


def is_inside(rings: list[list[list[float]]], point: Any) -> bool:
    """Whether an odd number of edges is to the right of a point."""
    edges = ((a, b) for points in rings for a, b in zip(points, points[1:]) if (a[1] > point.y) != (b[1] > point.y))
    return sum(point.x < a[0] + (point.y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) for a, b in edges) % 2 == 1


def region(parts: list[list[list[list[float]]]]) -> Any:
    """Returns the same region by shapely. `make_valid` is not even-odd if a ring has an edge twice,
    so faces between all edges are selected instead."""
    chosen = []
    for rings in parts:
        lines = shapely.node(shapely.MultiLineString(rings))
        faces = shapely.get_parts(shapely.polygonize([lines]))
        chosen += [face for face in faces if is_inside(rings, face.representative_point())]
    return shapely.unary_union(chosen)


def run(*words: str) -> str:
    return subprocess.run([SPINNEY, "-q", *words], check=True, capture_output=True, text=True).stdout


def expected(area: Any, shares: Any, cells: Any, statistics: dict[str, Any], what: str) -> None:
    """Compares a zone's numbers with sums over cells."""
    present = cells != NODATA
    slack = 1e-9 * max(area.area, 1.0)
    counts = {
        "cells": math.fsum(shares[present]),
        "void_cells": math.fsum(shares[~present]),
        "outside_cells": area.area - math.fsum(shares.ravel()),
    }
    for name, count in counts.items():
        assert abs(statistics[name] - count) <= slack, (what, name, statistics[name], count)
    if counts["cells"] > 1e-6:
        total = math.fsum((shares[present] * cells[present]).tolist())
        (channel,) = statistics["channels"]
        assert abs(channel["sum"] - total) <= 1e-9 * max(abs(total), 1.0), (what, channel["sum"], total)
        mean = total / counts["cells"]
        assert abs(channel["mean"] - mean) <= 1e-9 * max(abs(mean), 1.0), (what, channel["mean"], mean)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    rng = random.Random(1)
    zones = [zone(rng) for _ in range(count)]
    boxes = np.array([[shapely.box(x, y, x + 1, y + 1) for x in range(WIDTH)] for y in range(HEIGHT)])
    regions = [region(parts) for parts in zones]
    shares = [shapely.area(shapely.intersection(area, boxes)) for area in regions]
    with tempfile.TemporaryDirectory() as directory:
        at = lambda name: str(Path(directory) / name)  # noqa: E731
        features = [
            {"type": "Feature", "properties": {}, "geometry": {"type": "MultiPolygon", "coordinates": parts}} for parts in zones
        ]
        Path(at("zones.geojson")).write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        for name, content in CONTENTS.items():
            cells = np.array([[content(x, y) for x in range(WIDTH)] for y in range(HEIGHT)], np.uint8)
            Path(at("cells.pgm")).write_bytes(b"P5 %d %d 255\n" % (WIDTH, HEIGHT) + cells.tobytes())
            kind = "categorical" if name == "classes" else "continuous"
            files = [at(file) for file in ("plain.goblin", "packed.goblin", "edited.autumn")]
            for file in files:
                Path(file).unlink(missing_ok=True)
            run("build", at("cells.pgm"), "-o", files[0], "--nodata", str(NODATA), "--kind", kind)
            run("transform", files[0], "-o", files[1], "--codec", "packed")
            run("transform", files[0], "-o", files[2])
            found = [
                run("stats", file, *view, "--zones", at("zones.geojson"), "--in", "cells", "--edge", "area", "--json")
                for file, view in [*((file, ()) for file in files), (files[0], ("--view", "translate=0,0"))]
            ]
            assert len({json.dumps(json.loads(text)["zones"]) for text in found}) == 1, f"{name}: storages differ"
            for number, statistics in enumerate(json.loads(found[0])["zones"]):
                expected(regions[number], shares[number], cells, statistics, f"{name}, zone {number} of seed 1")
            print(f"{name}: {count} zones, equal in four storages")
    record("zonal statistics", [row(f"{count:,} random invalid multipolygons that differ by 1e-9 or more", "zones", 0, "shapely")])


if __name__ == "__main__":
    main()
