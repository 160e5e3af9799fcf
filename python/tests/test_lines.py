"""Line trees: built from files and features, and queried; shapely is the reference if it is
installed.
"""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinney


@pytest.fixture(scope="module")
def roads() -> list[dict[str, Any]]:
    random = np.random.default_rng(5)
    start = random.uniform(0, 1000, (300, 1, 2))
    walks = np.round(start + np.cumsum(random.normal(0, 15, (300, 8, 2)), axis=1), 2)
    found = [
        {
            "type": "Feature",
            "properties": {"name": f"road {number}", "lanes": number % 4 or None},
            "geometry": {"type": "LineString", "coordinates": walk.tolist()},
        }
        for number, walk in enumerate(walks)
    ]
    # A multipart road, a road without a geometry, and a repeated one.
    found[7]["geometry"] = {"type": "MultiLineString", "coordinates": [walks[7, :3].tolist(), walks[7, 4:].tolist()]}
    found[9]["geometry"] = None
    found[20]["geometry"] = found[10]["geometry"]
    return found


@pytest.fixture(scope="module")
def tree(roads: list[dict[str, Any]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lines") / "roads.goblin"
    built = spinney.build_lines({"type": "FeatureCollection", "features": roads}, path, leaf_size=16, crs="EPSG:25833")
    assert (built.features, built.segments) == (300, 298 * 7 + 5)
    return path


def lines_of(feature: dict[str, Any]) -> list[Any]:
    if feature["geometry"] is None:
        return []
    coordinates = feature["geometry"]["coordinates"]
    return coordinates if feature["geometry"]["type"] == "MultiLineString" else [coordinates]


def test_features_come_back(roads: list[dict[str, Any]], tree: Path, tmp_path: Path) -> None:
    with spinney.open_lines(tree) as lines:
        assert len(lines) == 300 and lines.crs == "EPSG:25833" and lines.attributes == ["name", "lanes"]
        found = lines.features()
        assert [feature["id"] for feature in found] == list(range(300))
        for one, other in zip(found, roads, strict=True):
            assert one["properties"] == other["properties"]
            assert [[list(vertex) for vertex in line] for line in lines_of(one)] == lines_of(other)
        length = sum(np.sum(np.hypot(*np.diff(np.array(line), axis=0).T)) for road in roads for line in lines_of(road))
        assert lines.length == pytest.approx(length)
        levels = lines.levels()
        assert levels[0].nodes == 1 and sum(level.segments for level in levels) == lines.segments
        assert lines.write(tmp_path / "all.geojson", attributes=["name"]) == 300
        assert set(json.loads((tmp_path / "all.geojson").read_text())["features"][0]["properties"]) == {"name"}
        assert [feature["properties"] for feature in lines.features(window=(0, 0, 1, 1), attributes=[])] in ([], [{}])
        with pytest.raises(ValueError, match="name, lanes"):
            lines.features(attributes=["height"])
        again = pickle.loads(pickle.dumps(lines))
        assert len(again) == 300
        again.close()
        with pytest.raises(ValueError, match="closed"):
            again.find((0, 0, 1, 1))
    assert spinney.verify(tree) == []


def test_results_are_those_of_shapely(roads: list[dict[str, Any]], tree: Path) -> None:
    shapely = pytest.importorskip("shapely")
    shapes = [shapely.MultiLineString(lines_of(road)) for road in roads]
    random = np.random.default_rng(1)
    with spinney.open_lines(tree) as lines:
        for corner in random.uniform(0, 1000, (50, 2)):
            window = (*corner, *(corner + 60))
            expected = [number for number, shape in enumerate(shapes) if shape.intersects(shapely.box(*window))]
            assert lines.find(window).tolist() == expected
        positions = random.uniform(-50, 1050, (200, 2))
        away = shapely.distance(shapely.points(positions)[:, None], np.array(shapes)[None])
        away[np.isnan(away)] = np.inf
        for k, radius in ((1, np.inf), (5, 40.0)):
            distances, features, found = lines.nearest(positions, k=k, radius=radius)
            expected = np.sort(away, axis=1)[:, :k]
            expected[expected > radius] = np.inf
            np.testing.assert_allclose(distances, expected, atol=1e-5)
            np.testing.assert_array_equal(features < 0, np.isinf(expected))
            assert found.shape == (200, k, 2) and (np.isnan(found[..., 0]) == np.isinf(distances)).all()
        others = [random.uniform(0, 1000, (3, 2)) for _ in range(20)]
        crossed = lines.crossings(others)
        for number, other in enumerate(others):
            expected = {road for road, shape in enumerate(shapes) if shape.intersects(shapely.LineString(other))}
            assert set(crossed.features[crossed.lines == number].tolist()) == expected
            assert {feature["id"] for feature in lines.features(crossing=other)} == expected
        assert len(crossed) == len(crossed.positions)


def test_ties_give_the_first_feature(tree: Path, roads: list[dict[str, Any]]) -> None:
    with spinney.open_lines(tree) as lines:
        distances, features, positions = lines.nearest([roads[10]["geometry"]["coordinates"][3]], k=2)
        assert distances.tolist() == [[0, 0]] and features.tolist() == [[10, 20]]
        np.testing.assert_allclose(positions[0, 0], roads[10]["geometry"]["coordinates"][3])


def test_invalid_arguments_are_rejected(tree: Path, tmp_path: Path) -> None:
    point = {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [1, 2]}}
    with pytest.raises((ValueError, OSError), match="points"):
        spinney.build_lines(point, tmp_path / "x.goblin")
    assert not (tmp_path / "x.goblin").exists()
    with spinney.open_lines(tree) as lines:
        for wrong in ((1, 2, 3), (1, 2, 3, 4, 5)):
            with pytest.raises(ValueError, match="window"):
                lines.find(wrong)
        with pytest.raises(ValueError, match="k: got 0"):
            lines.nearest([(1, 2)], k=0)
        with pytest.raises(ValueError, match="position"):
            lines.nearest([(np.nan, 2)])
        with pytest.raises(ValueError, match="one of them"):
            lines.features(window=(0, 0, 1, 1), crossing=[(0, 0), (1, 1)])
    with pytest.raises(OSError):
        spinney.open_points(tree)


def test_positions_in_other_systems(tmp_path: Path) -> None:
    path = tmp_path / "mercator.goblin"
    line = {"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": [(0, 0), (1000, 0)]}}
    spinney.build_lines(line, path, crs="EPSG:3857")
    radius = 6378137
    degrees = [(np.degrees(300 / radius), np.degrees(np.arcsin(np.tanh(40 / radius))))]
    with spinney.open_lines(path) as lines:
        distances, features, positions = lines.nearest(degrees, coordinates="lonlat")
        assert distances[0, 0] == pytest.approx(40, abs=1e-4) and features[0, 0] == 0
        assert positions[0, 0] == pytest.approx((300, 0), abs=1e-4)
        with pytest.raises(ValueError, match="no cells"):
            lines.nearest(degrees, coordinates="cells")
