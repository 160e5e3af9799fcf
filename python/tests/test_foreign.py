"""Point trees and line trees, read by the readers in tests/foreign, which implement formats.md
independently.
"""

from __future__ import annotations

import csv
import io
import json
import math
import random
import struct
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from conftest import FIXTURES, ROOT, run

sys.path.append(str(ROOT / "tests" / "foreign"))

if TYPE_CHECKING:
    from points import Points


def program_points(program: str, path: Path, tree: Points) -> Counter[tuple[float | str, ...]]:
    """Returns the points that the program writes as CSV, in grid units."""
    rows = csv.DictReader(io.StringIO(run(program, "-q", "get", path, "-", "--format", "csv")))
    assert rows.fieldnames == [column.name for column in tree.columns]
    found: Counter[tuple[float | str, ...]] = Counter()
    for row in rows:
        numbers = [float(number) for number in row.values()]
        steps = [(x - offset) / scale for x, offset, scale in zip(numbers, tree.offset, tree.scale)]
        assert all(abs(step - round(step)) < 1e-4 for step in steps)
        found[comparable([*map(round, steps), *numbers[3:]])] += 1
    return found


def comparable(point: list[float]) -> tuple[float | str, ...]:
    """Returns a point in which NaN equals itself."""
    return tuple("NaN" if math.isnan(number) else number for number in point)


def compared(program: str, path: Path) -> Points:
    """Checks that a tree has the program's points, in valid positions."""
    from points import Points

    tree = Points(path.read_bytes())
    read = [point for _, points in tree.walk() for point in points]
    assert Counter(comparable(list(point)) for point in read) == program_points(program, path, tree)
    tree.verify()
    return tree


@pytest.mark.parametrize("leaf_size", [50000, 100])
def test_points_of_a_scan(program: str, tmp_path: Path, leaf_size: int) -> None:
    path = tmp_path / "scan.goblin"
    run(program, "-q", "build", FIXTURES / "island_points.laz", "-o", path, "--leaf-size", leaf_size)
    tree = compared(program, path)
    assert (tree.count, tree.axes, tree.columns[tree.clock or 0].name) == (13587, 3, "gps_time")
    assert (len(tree.nodes) > 1) == (leaf_size == 100)


def test_scaled_attributes(program: str, tmp_path: Path) -> None:
    """Two extra attributes of a LAS file, with a scale and an offset, and with a scale only."""
    from points import Points

    extra = b"".join(
        struct.pack("<2xBB32s76xd16xd16x32s", kind, 8 + 16 * (summand != 0), name, scale, summand, text)
        for kind, name, scale, summand, text in [(4, b"height", 0.25, -100.0, b"above ground"), (1, b"share", 0.5, 0.0, b"")]
    )
    record = struct.pack("<2x16sHH32s", b"LASF_Spec", 4, len(extra), b"") + extra
    rows = [(struct.pack("<iii18x", i, 2 * i, 3 * i), -i, i % 7) for i in range(300)]
    points = b"".join(place + struct.pack("<hB", height, share) for place, height, share in rows)
    head = struct.pack("<4s4x16xBB32s32sHHHIIBHI20x", b"LASF", 1, 4, b"", b"", 1, 2026, 375, 375 + len(record), 1, 6, 33, 0)
    head += struct.pack("<12dQQIQ120x", *[0.5] * 3, *[10.0] * 3, *[1000.0, 0] * 3, 0, 0, 0, 300)
    (tmp_path / "t.las").write_bytes(head + record + points)
    run(program, "-q", "build", tmp_path / "t.las", "-o", tmp_path / "t.goblin", "--attribute", "height,share")
    tree = Points((tmp_path / "t.goblin").read_bytes())
    height, share = tree.columns[3:]
    assert (height.scale, share.scale, height.description) == ((0.25, -100.0), (0.5, 0.0), "above ground")
    found = [(height.meant(point[3]), share.meant(point[4])) for _, points in tree.walk() for point in points]
    assert sorted(found) == sorted((-i / 4 - 100, i % 7 / 2) for i in range(300))
    table = csv.DictReader(io.StringIO(run(program, "-q", "get", tmp_path / "t.goblin", "-", "--format", "csv")))
    assert sorted((float(row["height"]), float(row["share"])) for row in table) == sorted(found)
    assert tree.nodes[tree.root].columns[3].sum == -sum(range(300))
    tree.verify()


@pytest.mark.parametrize("axes", [2, 3])
def test_points_of_a_table(program: str, tmp_path: Path, axes: int) -> None:
    """Points in clusters, some of them repeated, with attributes that are negative, fractional, or
    missing.
    """
    table, path, rng = tmp_path / "t.csv", tmp_path / "t.goblin", random.Random(axes)
    rows: list[list[object]] = []
    while len(rows) < 5000:
        clump, width = rng.randrange(-900, 900), rng.choice([0.2, 5, 2000])
        place = [round(clump + rng.uniform(0, width), 2) for _ in range(axes)]
        for _ in range(rng.choice([1, 1, 1, 4])):
            rows.append([*place, rng.randrange(-70, 70), rng.choice([rng.gauss(0, 1), ""]), rng.randrange(3)])
    rows += [[*rows[7][:axes], n, n / 3, 0] for n in range(150)]
    with table.open("w", newline="") as out:
        csv.writer(out).writerows([[*"xyz"[:axes], "whole", "part", "kind"], *rows])
    run(program, "-q", "build", table, "-o", path, "--index", "points", "--leaf-size", 100)
    tree = compared(program, path)
    assert tree.axes == axes and tree.count == len(rows) and tree.repeated > 1000
    assert len({node.at.level for node in tree.nodes.values()}) > 3
    assert tree.nodes[tree.root].columns[4].count == sum(row[axes + 1] != "" for row in rows)


@pytest.mark.parametrize("clock", [None, "f8", "f4", "i4", "u8"])
def test_points_of_arrays(program: str, tmp_path: Path, clock: str | None) -> None:
    """All types, with numbers up to their limits, and all dependencies between columns."""
    random, size = np.random.default_rng(6), 3000
    types = ["u1", "u2", "i2", "u4", "i4", "f4", "f8", "i1", "u8", "i8"]
    fields = [(axis, "f8") for axis in "xyz"] + [(f"a{t}", t) for t in types] + [(f"b{t}", t) for t in types]
    rows = np.zeros(size, fields + ([("gps_time", clock)] if clock else []))
    for axis in "xyz":
        rows[axis] = np.round(1000 * np.sin(np.arange(size) / 50 + ord(axis)) + random.normal(0, 0.1, size), 3)
    for t in types:
        column = np.frombuffer(random.bytes(size * np.dtype(t).itemsize), t)
        rows["a" + t] = np.where(np.isnan(column), np.nan, column) if t[0] == "f" else column
        rows["b" + t] = 5 * (np.arange(size) // 7 % 20) + random.integers(0, 2, size)
    if clock:
        rows["gps_time"] = np.arange(size) // 2 * 3
    np.save(tmp_path / "t.npy", rows)
    run(program, "-q", "build", tmp_path / "t.npy", "-o", tmp_path / "t.goblin", "--index", "points", "--leaf-size", 900)
    from points import Points

    tree = Points((tmp_path / "t.goblin").read_bytes())
    read = np.array([(*tree.world(point[:3]), *point[3:]) for _, points in tree.walk() for point in points], rows.dtype)
    order = ["bi8", "au8", "au4", "x"]
    read, rows = np.sort(read, order=order), np.sort(rows, order=order)
    for name in rows.dtype.names or ():
        np.testing.assert_allclose(read[name], rows[name], rtol=0, atol=1e-9 if name in "xyz" else 0)
    tree.verify()


def network(seed: int, size: int, width: float, digits: int) -> list[dict[str, Any]]:
    """Features with one line or several, long and short ones, and values of all kinds."""
    rng = random.Random(seed)
    features = []
    for i in range(size):
        lines = []
        for _ in range(rng.choice([1, 1, 3])):
            place, step = [rng.uniform(-width, width) for _ in range(2)], rng.choice([width / 1000, width / 10, width])
            line = [place]
            for _ in range(rng.choice([1, 2, 30])):
                place = [x + rng.uniform(-step, step) for x in place] if rng.random() < 0.95 else place
                line.append(place)
            lines.append([[round(x, digits) for x in vertex] for vertex in line])
        strings, wholes, numbers = ["", "road", "Straße", str(i), None], [i, -3, 2**62, None], [0.5 * i, -1e300, 5e-324, None]
        of: list[list[Any]] = [strings, wholes, numbers, [True, False, None], [[1, {"a": None}], {}, None]]
        values = [rng.choice(row) for row in [*of, [value for row in of for value in row]]]
        single = len(lines) == 1
        geometry = {"type": "LineString" if single else "MultiLineString", "coordinates": lines[0] if single else lines}
        properties = dict(zip(["text", "whole", "number", "truth", "json", "several"], values))
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return features


# Grid units of 0.01, on which everything is exact; of 32 bits that are all used; and units larger
# than 1.
@pytest.mark.parametrize(("width", "digits"), [(3000, 2), (190, 7), (1e11, 0)])
@pytest.mark.parametrize("leaf_size", [1, 40, 1024])
def test_lines(program: str, tmp_path: Path, width: float, digits: int, leaf_size: int) -> None:
    from lines import Json, Lines

    source, path, back = (tmp_path / name for name in ("t.geojson", "t.goblin", "back.geojson"))
    made = network(leaf_size, 200, width, digits)
    source.write_text(json.dumps({"type": "FeatureCollection", "crs": None, "features": made}))
    run(program, "-q", "build", source, "-o", path, "--index", "lines", "--leaf-size", leaf_size)
    run(program, "-q", "get", path, "-o", back)
    tree = Lines(path.read_bytes())
    exported = json.loads(back.read_text())["features"]
    features = list(tree.each_feature())
    assert len(features) == len(exported) == len(made) == tree.features
    for feature, other, first in zip(features, exported, made):
        lines = [[list(tree.world(vertex)) for vertex in line] for line in feature.lines]
        assert lines == (other["geometry"]["coordinates"] if len(lines) > 1 else [other["geometry"]["coordinates"]])
        values = [json.loads(value) if isinstance(value, Json) else value for value in feature.values]
        assert values == list(other["properties"].values()) == list(first["properties"].values())
    tree.verify()
    assert (len(tree.nodes) > 30) == (leaf_size < 1024)
