"""Quadtrees of features; GDAL's rasterizer is the reference."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIXTURES, run

import spinney

SIDE = 300


def star(random: np.random.Generator) -> list[list[list[float]]]:
    """Returns a ring around a point, and sometimes a hole."""
    middle, radius = random.uniform(-20, SIDE + 20, 2), random.uniform(2, 90)
    rings = []
    for least, most in [(0.4, 1.0), (0.05, 0.3)][: random.integers(1, 3)]:
        angles = np.sort(random.uniform(0, 2 * np.pi, random.integers(4, 60)))
        away = radius * random.uniform(least, most, len(angles))
        ring = middle + np.stack([away * np.cos(angles), away * np.sin(angles)], axis=-1)
        rings.append([*ring.tolist(), ring[0].tolist()])
    return rings


def layer(random: np.random.Generator, count: int) -> dict[str, Any]:
    """Random polygons, in metres."""

    def feature(number: int) -> dict[str, Any]:
        parts = [star(random) for _ in range(random.integers(1, 3))]
        return {"type": "Feature", "properties": {"v": number + 1}, "geometry": {"type": "MultiPolygon", "coordinates": parts}}

    crs = {"type": "name", "properties": {"name": "EPSG:32633"}}
    return {"type": "FeatureCollection", "crs": crs, "features": [feature(number) for number in range(count)]}


def grid(directory: Path) -> Path:
    """Builds a tree to whose cells features are rasterized."""
    path = directory / "grid.goblin"
    spinney.build(np.ones((SIDE, SIDE), "u1"), path, transform=(1, 0, 0, 0, -1, SIDE), crs="EPSG:32633")
    return path


def test_cells_are_those_of_gdal(tmp_path: Path) -> None:
    features = pytest.importorskip("rasterio.features")
    like, path, out = grid(tmp_path), tmp_path / "f.geojson", tmp_path / "o.goblin"
    for seed in range(30):
        document = layer(np.random.default_rng(seed), 12)
        path.write_text(json.dumps(document))
        # (Features extend beyond the other tree, and enlarge the result.)
        spinney.build(path, tmp_path / "all.goblin", grid=like, value="v")
        spinney.transform(tmp_path / "all.goblin", f"like={like},extent=a", out)
        with spinney.open(out) as ds:
            found = ds.read(masked=True)[0].filled(0)
        # (Each polygon of a multipolygon by itself: GDAL cancels overlaps.)
        shapes = [
            ({"type": "Polygon", "coordinates": part}, feature["properties"]["v"])
            for feature in document["features"]
            for part in feature["geometry"]["coordinates"]
        ]
        single = {**document, "features": [{"type": "Feature", "properties": {"v": v}, "geometry": g} for g, v in shapes]}
        path.write_text(json.dumps(single))
        # (Features extend beyond the other tree, and enlarge the result.)
        spinney.build(path, tmp_path / "all.goblin", grid=like, value="v")
        spinney.transform(tmp_path / "all.goblin", f"like={like},extent=a", out)
        with spinney.open(out) as ds:
            found_single = ds.read(masked=True)[0].filled(0)
        expected = features.rasterize(shapes, (SIDE, SIDE), transform=(1, 0, 0, 0, -1, SIDE), dtype="uint8")
        assert np.array_equal(found_single, expected), seed
        assert (found > 0).sum() <= (expected > 0).sum()


def test_shares_add_up(tmp_path: Path) -> None:
    like, path, out = grid(tmp_path), tmp_path / "f.geojson", tmp_path / "o.goblin"
    random = np.random.default_rng(1)
    for _ in range(10):
        ring = star(random)[0]
        x, y = np.array(ring).T
        inside = [[float(np.clip(a, 0, SIDE)), float(np.clip(b, 0, SIDE))] for a, b in zip(x, y)]
        polygon = {"type": "Polygon", "coordinates": [inside]}
        path.write_text(json.dumps({"type": "FeatureCollection", "crs": layer(random, 0)["crs"], "features": [{"type": "Feature", "properties": {}, "geometry": polygon}]}))
        spinney.build(path, out, grid=like, fractions=True)
        with spinney.open(out) as ds:
            shares = ds[...].astype("f8")
        x, y = np.array(inside).T
        area = abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2
        assert shares.sum() == pytest.approx(area, rel=1e-5, abs=0.01) and shares.min() >= 0 and shares.max() <= 1


def test_frames_of_geometries(tmp_path: Path, program: str) -> None:
    class Frame:
        """A minimal GeoDataFrame."""

        crs = "EPSG:32633"

        def __init__(self, document: dict[str, Any]) -> None:
            self.__geo_interface__ = {key: value for key, value in document.items() if key != "crs"}

    document, path = layer(np.random.default_rng(3), 5), tmp_path / "f.geojson"
    path.write_text(json.dumps(document))
    mine, theirs = tmp_path / "mine.goblin", tmp_path / "theirs.goblin"
    spinney.build(Frame(document), mine, cell=2, value="v", where="v>2", overlaps="first")
    run(program, "-q", "build", path, "-o", theirs, "--cell", "2", "--value", "v", "--where", "v>2", "--overlaps", "first")
    with spinney.open(mine) as a, spinney.open(theirs) as b:
        assert a.crs == b.crs and a.transform == b.transform
        one, other = a.read(masked=True), b.read(masked=True)
        assert np.array_equal(one.mask, other.mask) and np.array_equal(one.filled(0), other.filled(0))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["f.geojson", "mine.goblin", "theirs.goblin"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({}, "cells"),
        ({"cell": 1, "cells": 5}, "one of"),
        ({"cell": 1, "value": "none"}, "no feature has"),
        ({"cell": 1, "overlaps": "all"}, "overlaps"),
        ({"cell": 1, "nodata": 3}, "nodata"),
        ({"cell": 1, "where": "v"}, "where|condition|expected"),
        ({"grid": "xyz"}, "max_zoom"),
    ],
)
def test_refusals(tmp_path: Path, options: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        spinney.build(FIXTURES / "island_districts.geojson", tmp_path / "o.goblin", **options)
    with pytest.raises(ValueError, match="features"):
        spinney.build(FIXTURES / "island_classes.tif", tmp_path / "o.goblin", value=3)
    assert list(tmp_path.iterdir()) == []


def test_lines_have_a_width(tmp_path: Path) -> None:
    line = {"type": "LineString", "coordinates": [[10, 20], [30, 20]]}
    features = [{"type": "Feature", "properties": {"w": 6}, "geometry": line}]
    path = tmp_path / "line.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": None, "features": features}))
    for width in (6, "w"):
        spinney.build(path, tmp_path / "line.goblin", cell=1, width=width)
        with spinney.open(tmp_path / "line.goblin") as tree:
            cells = tree.stats().cells
        # Six rows of twenty cells, and round ends.
        x, y = np.meshgrid(np.arange(40) + 0.5, np.arange(40) + 0.5)
        away = np.hypot(np.maximum(np.maximum(10 - x, x - 30), 0), y - 20)
        assert cells == (away <= 3).sum()
