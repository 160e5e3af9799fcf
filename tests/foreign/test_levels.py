"""Levels of detail of exact models: the reader finds the surfaces that the program exports.

    SPINNEY_PROGRAM=target/debug/spinney pytest tests/foreign/test_levels.py

Tests that need the program are skipped if SPINNEY_PROGRAM does not name one.
"""

from __future__ import annotations

import json
import math
import os
import struct
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any, Iterable

import pytest
from basics import CorruptFile, Header, spans
from models import NEVER, NO_BLOCK, Face, Model
from sealing import resealed

Polygon = tuple[tuple[int, ...], ...]


@pytest.fixture
def program() -> str:
    path = os.environ.get("SPINNEY_PROGRAM", "")
    if not path:
        pytest.skip("SPINNEY_PROGRAM is not set")
    return str(Path(path).resolve())


def run(program: str, directory: Path, command: str) -> str:
    """Runs a command of the program in a directory; returns its output."""
    done = subprocess.run([program, *command.split()], cwd=directory, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def sphere(rows: int, columns: int) -> str:
    """Returns an OBJ file of a bumpy sphere of `2 columns (rows - 1)` triangles."""
    lines = []
    for i in range(rows + 1):
        for j in range(columns if 0 < i < rows else 1):
            u, v = math.pi * i / rows, 2 * math.pi * j / columns
            x, y, z = math.sin(u) * math.cos(v), math.sin(u) * math.sin(v), math.cos(u)
            r = 100 + 5 * math.sin(7 * x) * math.cos(9 * y + 3 * z)
            lines.append(f"v {r * x:.3f} {r * y:.3f} {r * z:.3f}")
    last = len(lines)

    def vertex(i: int, j: int) -> int:
        return 1 if i == 0 else last if i == rows else 2 + (i - 1) * columns + j % columns

    for i in range(rows):
        for j in range(columns):
            a, b, c, d = vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)
            lines += [f"f {a} {b} {c}"] if i < rows - 1 else []
            lines += [f"f {a} {c} {d}"] if i > 0 else []
    return "\n".join(lines) + "\n"


def city(count: int) -> str:
    """Returns an OBJ file of boxes, each an object of six faces."""
    lines = []
    for i in range(count):
        x, y, w, h = i % 8 * 20, i // 8 * 20, 5 + i % 7, 6 + i * i % 23
        lines.append(f"o box{i}")
        lines += [f"v {x + w * (k & 1)} {y + w * (k >> 1 & 1)} {h * (k >> 2)}" for k in range(8)]
        for face in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)):
            lines.append("f " + " ".join(str(8 * i + 1 + k) for k in face))
    return "\n".join(lines) + "\n"


def normal_form(ring: Iterable[tuple[int, ...]]) -> Polygon:
    """Returns a ring from its minimum vertex on."""
    points = list(ring)
    at = points.index(min(points))
    return tuple(points[at:] + points[:at])


def polygons(faces: list[Face]) -> Counter[Polygon]:
    assert all(len(face.rings) == 1 for face in faces)
    return Counter(normal_form(face.rings[0]) for face in faces)


def exported(path: Path, model: Model) -> Counter[Polygon]:
    """Returns the faces of an OBJ file, in grid coordinates."""
    points: list[tuple[int, ...]] = []
    found: Counter[Polygon] = Counter()
    for line in path.read_text().splitlines():
        kind, *rest = line.split() or [""]
        if kind == "v":
            position = [float(v) * model.divisor / model.step - o for v, o in zip(rest, model.origin)]
            assert all(abs(v - round(v)) < 1e-3 for v in position)
            points.append(tuple(map(round, position)))
        elif kind == "f":
            found[normal_form(points[int(v.split("/")[0]) - 1] for v in rest)] += 1
    return found


def open_edges(faces: list[Face]) -> int:
    """Returns the number of directed edges without an opposite one."""
    edges: Counter[Any] = Counter()
    for face in faces:
        for a, b in face.edges:
            edges[min(a, b), max(a, b)] += (a < b) - (a > b)
    return sum(map(abs, edges.values()))


def errors_between(model: Model) -> list[float]:
    """Returns 0, errors between those of clusters, and one above all."""
    errors = sorted({cluster.error for cluster in model.clusters})
    between = [(a + b) / 2 for a, b in zip(errors, errors[1:])]
    return [0.0, *between[:: max(len(between) // 4, 1)], 2 * errors[-1] + 1]


@pytest.mark.parametrize("codec", ["plain", "packed"])
@pytest.mark.parametrize("name", ["sphere", "city", "groups"])
def test_levels_of_models_are_those_of_the_program(program: str, tmp_path: Path, name: str, codec: str) -> None:
    if (name, codec) == ("groups", "packed"):
        pytest.skip("large files are read plain only")
    text = {"sphere": lambda: sphere(39, 38), "city": lambda: city(40), "groups": lambda: sphere(101, 100)}[name]()
    (tmp_path / "a.obj").write_text(text)
    run(program, tmp_path, "-q build a.obj --brep -o a.goblin")
    run(program, tmp_path, f"-q transform a.goblin levels -o b.goblin --codec {codec}")
    model, plain = (Model((tmp_path / f"{file}.goblin").read_bytes()) for file in "ba")
    assert not plain.levels and not plain.clusters and model.codec == (codec == "packed")
    assert [face.rings for face in plain.faces] == [face.rings for face in model.faces]
    model.verify_levels()
    described = json.loads(run(program, tmp_path, "info b.goblin --json"))["levels"]
    assert len(described) == len(model.levels) > 2
    width = model.step / model.divisor
    surfaces = [(f"--level {i}", model.at_level(i)) for i in range(len(model.levels))]
    surfaces += [(f"--error {error * width!r}", model.at_error(error)) for error in errors_between(model)]
    for option, faces in surfaces:
        run(program, tmp_path, f"-q export b.goblin c.obj {option}")
        assert polygons(faces) == exported(tmp_path / "c.obj", model), option
        assert open_edges(faces) == 0, option
        parts = {face.part for face in faces}
        assert all(open_edges([face for face in faces if face.part == part]) == 0 for part in parts), option
    for level, about, (_, faces) in zip(model.levels, described, surfaces):
        assert about["faces"] == level.faces == len(faces)
        assert about["bytes"] == level.bytes and about["vanished_bodies"] == level.vanished
        assert math.isclose(about["error"], level.error * width) and math.isclose(about["vanished_diameter"], level.diameter * width)
        if name == "city":
            assert level.vanished == 40 - len({face.part for face in faces})
    assert polygons(model.at_level(len(model.levels) - 1)) == polygons(model.at_error(0.0)) == polygons(model.faces)
    if name == "groups":
        # Surfaces for an error mix levels.
        cuts = [{c.level for c in model.clusters if c.in_error(error)} for error in errors_between(model)]
        assert any(len(cut) > 1 for cut in cuts)


def test_corrupt_levels_are_noticed(program: str, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(city(40))
    run(program, tmp_path, "-q build a.obj --brep -o a.goblin")
    run(program, tmp_path, "-q transform a.goblin levels -o b.goblin --codec plain")
    file = (tmp_path / "b.goblin").read_bytes()
    model, sections = Model(file), spans(file, Header.read(file))
    summary, list_at = sections[b"LEVS"][0], sections[b"LEVC"][0]
    (table,) = struct.unpack_from("<Q", file, list_at + 8)
    last = len(model.levels) - 1
    coarse = next(i for i, c in enumerate(model.clusters) if 0 < c.level < last and c.replaced_at != NEVER)
    exact = next(i for i, c in enumerate(model.clusters) if c.level == last and c.replaced_at != NEVER)
    nan, inf = float("nan"), float("inf")
    # Offset from the start of the summary or the cluster, number, and its type.
    of_levels = [(0, 1 << 40, "Q"), (8, nan, "d"), (8, -1.0, "d"), (8, inf, "d"), (8, 0.0, "d"), (32, nan, "d"), (32, -1.0, "d"), (32, 1e39, "d")]
    of_clusters = [(0, nan, "f"), (0, -1.0, "f"), (0, 3e38, "f"), (4, nan, "f"), (4, 0.0, "f"), (4, inf, "f"), (8, last + 1, "B"), (9, last, "B")]
    of_clusters += [(9, NEVER, "B"), (12, NO_BLOCK, "I"), (12, len(model.lists[b"LEVF"]), "I"), (16, NO_BLOCK, "I"), (20, NO_BLOCK, "I")]
    of_clusters += [(24, -1, "i"), (28, (1 << 31) - 1, "i"), (44, 1 << model.bits, "i")]
    cases = [(summary + at, number, form) for at, number, form in of_levels]
    cases += [(table + 64 * coarse + at, number, form) for at, number, form in of_clusters]
    # The slivers of an exact cluster that has none, and the key of a table.
    cases += [(table + 64 * exact + 12, len(model.lists[b"LEVF"]), "I"), (list_at, 1024, "Q")]
    for at, number, form in cases:
        changed = bytearray(file)
        struct.pack_into("<" + form, changed, at, number)
        assert changed != file
        with pytest.raises(CorruptFile):
            corrupt = Model(resealed(changed, file))
            for level in range(len(corrupt.levels)):
                corrupt.at_level(level)
        # The program rejects the same.
        (tmp_path / "c.goblin").write_bytes(resealed(changed, file))
        done = subprocess.run([program, "-q", "verify", "c.goblin"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode and ("corrupt" in done.stderr + done.stdout or "expected" in done.stderr + done.stdout), (at, number, done)


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
