"""Features in GeoPackage and FlatGeobuf: every function that takes features reads back what was
written.
"""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest

import spinney

from conftest import FIXTURES

DISTRICTS = FIXTURES / "island_districts.geojson"
ENDINGS = ("gpkg", "fgb")


@pytest.mark.parametrize("ending", ENDINGS)
def test_zones_are_read_back(island: str, tmp_path: Path, ending: str) -> None:
    zones = tmp_path / f"zones.{ending}"
    with spinney.open(island) as ds:
        expected = ds.zonal(DISTRICTS, edge="area")
        assert ds.zonal(DISTRICTS, ["count"], edge="area", out=zones) == len(expected)
        assert ds.zonal(zones, edge="area") == expected
        names = [feature["properties"]["name"] for feature in json.loads(DISTRICTS.read_text())["features"]]
        assert ds.zonal(zones, edge="area", where={"name": names[1]}) == [expected[1]]
    if ending == "gpkg":
        with sqlite3.connect(zones) as database:
            assert database.execute("SELECT table_name FROM gpkg_contents").fetchall() == [("island_districts",)]
        with spinney.open(island) as ds:
            assert ds.zonal(f"{zones}:island_districts", edge="area") == expected


@pytest.mark.parametrize("ending", ENDINGS)
def test_lines_are_read_back(tmp_path: Path, ending: str) -> None:
    random = np.random.default_rng(3)
    lines = np.round(np.cumsum(random.normal(0, 9, (40, 5, 2)), axis=1), 2)
    roads = [
        {"type": "Feature", "properties": {"number": number}, "geometry": {"type": "LineString", "coordinates": line.tolist()}}
        for number, line in enumerate(lines)
    ]
    collection = {"type": "FeatureCollection", "features": roads}
    spinney.build_lines(collection, tmp_path / "roads.goblin", crs="EPSG:25833")
    file = tmp_path / f"roads.{ending}"
    with spinney.open_lines(tmp_path / "roads.goblin") as tree:
        assert tree.write(file) == len(roads)
        expected = tree.features()
    spinney.build_lines(file, tmp_path / "again.goblin")
    with spinney.open_lines(tmp_path / "again.goblin") as tree:
        # (FlatGeobuf stores its features in index order.)
        found = sorted(tree.features(), key=lambda feature: feature["properties"]["number"])
        assert tree.crs == "EPSG:25833"
    assert [(one["properties"], one["geometry"]) for one in found] == [(one["properties"], one["geometry"]) for one in expected]


@pytest.mark.parametrize("ending", ENDINGS)
def test_regions_and_contours_become_features(island: str, relief: str, tmp_path: Path, ending: str) -> None:
    with spinney.open(island) as ds, spinney.open(relief) as heights:
        count = ds.export(tmp_path / f"regions.{ending}", polygons=True, level=5)
        assert isinstance(count, int) and count > 1
        assert heights.contours(tmp_path / f"contours.{ending}", every=200) > 1
    made = spinney.combine("and", [tmp_path / f"regions.{ending}", DISTRICTS], tmp_path / f"both.{ending}")
    assert isinstance(made, spinney.CombinedPolygons) and made.features > 1
    spinney.build_lines(tmp_path / f"contours.{ending}", tmp_path / "contours.goblin")
    with spinney.open_lines(tmp_path / "contours.goblin") as tree:
        assert len(tree) > 1


def test_features_are_brought_to_another_system(tmp_path: Path) -> None:
    radius = 6378137
    feature = {"type": "Feature", "id": 4, "properties": {"name": "a"}, "geometry": {"type": "Point", "coordinates": [8.5, 47.25, 3]}}
    given, made = tmp_path / "given.geojson", tmp_path / "made.geojson"
    given.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    assert spinney.transform(given, "warp=EPSG:3857", made) == 1
    found = json.loads(made.read_text())["features"][0]
    expected = (radius * np.radians(8.5), radius * np.arctanh(np.sin(np.radians(47.25))), 3)
    assert found["geometry"]["coordinates"] == pytest.approx(expected, abs=1e-6)
    assert (found["id"], found["properties"]) == (4, {"name": "a"})
    with pytest.raises(ValueError, match="move"):
        spinney.transform(given, "warp=EPSG:3857", made, move=True)
