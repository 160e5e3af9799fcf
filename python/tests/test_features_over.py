"""Features rasterized to the cells of trees: filled, combined, searched."""

import json
from pathlib import Path

import numpy as np
import pytest

import spinney

CRS = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32633"}}


def square(x: float, y: float, size: float) -> dict:
    ring = [[x, y], [x + size, y], [x + size, y + size], [x, y + size], [x, y]]
    return {"type": "Polygon", "coordinates": [ring]}


def feature(name: str, code: int, geometry: dict | None) -> dict:
    return {"type": "Feature", "properties": {"name": name, "code": code}, "geometry": geometry}


class Frame:
    """A minimal GeoDataFrame: features, and their coordinate system."""

    def __init__(self, features: list[dict], crs: str | None) -> None:
        self.crs = crs
        self.__geo_interface__ = {"type": "FeatureCollection", "features": features}


FEATURES = [feature("wood", 3, square(10, 10, 50)), feature("lake", 4, square(40, 40, 30)), feature("wood", 9, None)]


@pytest.fixture
def ground(tmp_path: Path) -> np.ndarray:
    cells = np.random.default_rng(1).integers(1, 6, (100, 120)).astype(np.uint8)
    for name in ("map.goblin", "map.autumn"):
        spinney.build(
            cells, tmp_path / name, kind="categorical", crs="EPSG:32633", transform=(1, 0, 0, 0, -1, 100), categories={3: "wood", 4: "lake"}
        )
    return cells


def masks() -> tuple[np.ndarray, np.ndarray]:
    wood, lake = np.zeros((2, 100, 120), bool)
    wood[40:90, 10:60] = True
    lake[30:60, 40:70] = True
    return wood, lake


def sources(directory: Path) -> list:
    path = directory / "features.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": CRS, "features": FEATURES}))
    return [path, Frame(FEATURES, "EPSG:32633"), Frame(FEATURES, None)]


def test_features_fill_in_one_commit(tmp_path: Path, ground: np.ndarray) -> None:
    path = tmp_path / "map.autumn"
    wood, lake = masks()
    for source in sources(tmp_path):
        before = len(spinney.log(path))
        with spinney.edit(path) as edit:
            edit.fill(None, zones=source)
            edit.fill("name", zones=source, overlaps="first")
            edit.fill(2, zones=source, where={"name": "lake"}, edge="touch")
        assert len(spinney.log(path)) == before + 1
        expected = ground.copy()
        expected[wood], expected[lake] = 3, 2
        with spinney.open(path) as tree:
            np.testing.assert_array_equal(np.asarray(tree.read(1)), expected)
        with spinney.edit(path) as edit:
            edit.revert(1)
    with spinney.edit(path) as edit:
        edit.fill(None, zones=[square(0, 0, 5), square(90, 90, 5)], coordinates="world")
    with spinney.open(path) as tree:
        assert tree.stats().void_cells == 50
    with spinney.edit(path) as edit:
        for wrong in ({"zones": "a.geojson", "window": (0, 0, 1, 1)}, {"window": (0, 0, 1, 1), "edge": "touch"}):
            with pytest.raises(ValueError):
                edit.fill(1, **wrong)
        with pytest.raises(TypeError):
            edit.fill("name", window=(0, 0, 1, 1))


def test_features_are_combined_with_trees(tmp_path: Path, ground: np.ndarray) -> None:
    wood, lake = masks()
    out = tmp_path / "out.goblin"
    for source in sources(tmp_path):
        spinney.combine("and", [tmp_path / "map.goblin", source], out)
        with spinney.open(out) as tree:
            found = tree.read(1, masked=True)
        np.testing.assert_array_equal(np.ma.getmaskarray(found), ~(wood | lake))
        np.testing.assert_array_equal(found.filled(0), np.where(wood | lake, ground, 0))
        spinney.combine("over", [source, tmp_path / "map.goblin"], out, value="code", where="code=4")
        with spinney.open(out) as tree:
            np.testing.assert_array_equal(np.asarray(tree.read(1)), np.where(lake, 4, ground))
    with pytest.raises(ValueError, match="features"):
        spinney.combine("and", [tmp_path / "map.goblin"], out, where="code=4")
    with pytest.raises(ValueError, match="out: expected"):
        spinney.combine("and", [Frame(FEATURES, None)], out)


def test_searches_stay_within_features(tmp_path: Path, ground: np.ndarray) -> None:
    wood, lake = masks()
    for source in sources(tmp_path):
        for where, zone in ((None, wood | lake), ({"code": 4}, lake)):
            with spinney.open(tmp_path / "map.goblin") as tree:
                blocks = tree.find(2, within=source, where=where)
            found = np.zeros_like(wood)
            for x, y, width, height in blocks.boxes:
                assert not found[y : y + height, x : x + width].any()
                found[y : y + height, x : x + width] = True
            np.testing.assert_array_equal(found, zone & (ground == 2))
    with spinney.open(tmp_path / "map.goblin") as tree, pytest.raises(ValueError, match="within"):
        tree.find(2, edge="touch")
