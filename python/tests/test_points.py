"""Point trees: built from arrays and files, and queried; SciPy is the reference if it is
installed.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

import spinney


@pytest.fixture(scope="module")
def cloud() -> np.ndarray:
    random = np.random.default_rng(3)
    rows = np.zeros(5000, dtype=[("x", "f8"), ("y", "f8"), ("z", "f8"), ("intensity", "u2"), ("gps_time", "f8"), ("ground", "?")])
    rows["x"] = np.round(random.uniform(0, 500, 5000), 2)
    rows["y"] = np.round(random.uniform(0, 300, 5000), 2)
    rows["z"] = np.round(rows["x"] / 10 + random.normal(0, 1, 5000), 3)
    rows["intensity"] = random.integers(0, 65536, 5000)
    rows["gps_time"] = 1e5 + np.arange(5000) / 8
    rows["ground"] = random.random(5000) < 0.3
    return rows


@pytest.fixture(scope="module")
def tree(cloud: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("points") / "cloud.goblin"
    built = spinney.build_points(cloud, path, leaf_size=200, crs="EPSG:32632")
    assert built == spinney.BuiltPoints(5000, 0)
    return path


def in_order(rows: np.ndarray) -> np.ndarray:
    return np.sort(rows["gps_time"])


def test_points_come_back(cloud: np.ndarray, tree: Path) -> None:
    with spinney.open_points(tree) as points:
        assert len(points) == 5000 and points.crs == "EPSG:32632"
        assert points.attributes == ["intensity", "gps_time", "ground"]
        found = points.read()
        assert found.dtype == points.dtype and found.dtype["intensity"] == np.uint16
        found, expected = (np.sort(rows, order="gps_time") for rows in (found, cloud))
        for name in ("x", "y", "z"):
            np.testing.assert_allclose(found[name], expected[name], atol=1e-9)
        for name in ("intensity", "gps_time", "ground"):
            np.testing.assert_array_equal(found[name], expected[name])
        stats = points.stats()
        assert stats["intensity"] is not None
        assert stats["intensity"].max == cloud["intensity"].max() and stats["intensity"].mean == pytest.approx(cloud["intensity"].mean())
    assert spinney.verify(tree) == []


def test_selections_match_a_full_scan(cloud: np.ndarray, tree: Path) -> None:
    with spinney.open_points(tree) as points:
        inside = (cloud["x"] >= 100) & (cloud["x"] <= 220.5) & (cloud["y"] >= 50) & (cloud["y"] <= 130)
        found = points.read(window=(100, 50, 220.5, 130), where="ground=1", attributes=["gps_time"])
        np.testing.assert_array_equal(in_order(found), in_order(cloud[inside & cloud["ground"]]))
        assert points.count(window=(100, 50, 220.5, 130)) == inside.sum()
        ring = [(50.001, 50.001), (250.001, 50.001), (50.001, 250.001)]
        inside = (cloud["x"] > 50.001) & (cloud["y"] > 50.001) & (cloud["x"] + cloud["y"] < 300.002)
        assert points.count(polygons=[[ring]]) == inside.sum()
        distance = np.sqrt((cloud["x"] - 200) ** 2 + (cloud["y"] - 100) ** 2 + (cloud["z"] - 20) ** 2)
        assert points.count(ball=((200, 100, 20), 40)) == (distance <= 40).sum()
        levels = [points.count(level=level) for level in range(points.depth + 1)]
        assert levels == sorted(levels) and levels[-1] == 5000
        with pytest.raises(ValueError, match="intensity"):
            points.read(where="height=3")


def test_nearest_points_are_those_of_scipy(cloud: np.ndarray, tree: Path) -> None:
    spatial = pytest.importorskip("scipy.spatial")
    positions = np.random.default_rng(1).uniform((-50, -50, -10), (550, 350, 60), (400, 3))
    theirs = spatial.cKDTree(np.column_stack([cloud["x"], cloud["y"], cloud["z"]]))
    with spinney.open_points(tree) as points:
        for k, radius in ((1, np.inf), (4, 25.0)):
            distances, found = points.nearest(positions, k=k, radius=radius)
            expected, _ = theirs.query(positions, k=k, distance_upper_bound=radius)
            np.testing.assert_allclose(distances, expected.reshape(400, k), atol=1e-9)
            assert found.shape == (400, k, 3) and (np.isnan(found[..., 0]) == np.isinf(distances)).all()


def test_files_go_out_and_in(cloud: np.ndarray, tree: Path, tmp_path: Path) -> None:
    with spinney.open_points(tree) as points:
        for name in ("a.laz", "a.las", "a.csv", "a.ply", "a.npy"):
            assert points.write(tmp_path / name, where="ground=1") == cloud["ground"].sum()
        rows = np.load(tmp_path / "a.npy")
        np.testing.assert_array_equal(in_order(rows), in_order(cloud[cloud["ground"]]))
        points.raster(tmp_path / "mean.goblin", "mean", 10)
    spinney.build_points(tmp_path / "a.laz", tmp_path / "b.goblin")
    with spinney.open_points(tmp_path / "b.goblin") as points:
        np.testing.assert_array_equal(in_order(points.read()), in_order(rows))
        assert points.crs is not None
    with spinney.open(tmp_path / "mean.goblin") as cells:
        column, row = 7, 12
        inside = (cloud["x"] // 10 == column) & (np.ceil(cloud["y"] / 10) == np.ceil(cloud["y"].max() / 10) - row)
        assert float(cells.read(1, window=(column, row, 1, 1))[0, 0]) == pytest.approx(cloud["z"][inside].mean(), abs=1e-3)


def test_laspy_reads_what_is_written(tree: Path, cloud: np.ndarray, tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    with spinney.open_points(tree) as points:
        points.write(tmp_path / "a.las")
    las = laspy.read(tmp_path / "a.las")
    order = np.argsort(las.gps_time)
    np.testing.assert_allclose(np.asarray(las.x)[order], cloud["x"], atol=1e-9)
    np.testing.assert_array_equal(np.asarray(las.intensity)[order], cloud["intensity"])
    np.testing.assert_array_equal(np.asarray(las["ground"])[order], cloud["ground"])


def test_rows_of_two_are_a_quadtree(tmp_path: Path) -> None:
    spinney.build_points(np.array([[0.5, 1], [2, 3], [2, 3]]), tmp_path / "flat.goblin")
    with spinney.open_points(tmp_path / "flat.goblin") as points:
        assert points.duplicates == 1
        distances, found = points.nearest([(2, 2)])
        assert distances[0, 0] == 1 and found[0, 0].tolist() == [2, 3, 0]
    for wrong in (np.zeros((3, 5)), np.array([(1, 2)], dtype=[("a", "f8"), ("b", "f8")])):
        with pytest.raises(ValueError, match="source"):
            spinney.build_points(wrong, tmp_path / "x.goblin")


def las_with_no_data(path: Path, heights: list[int]) -> None:
    """Writes a LAS 1.4 file of points with an extra attribute `height` of type i32, in which -99
    means no value.
    """
    extra = bytearray(192)
    extra[2:4] = bytes([6, 1])
    extra[4:10] = b"height"
    extra[40:48] = np.int64(-99).tobytes()
    record = struct.pack("<H16sHH32s", 0, b"LASF_Spec", 4, 192, b"") + bytes(extra)
    header = bytearray(375)
    header[0:4], header[24:26] = b"LASF", bytes([1, 4])
    struct.pack_into("<HIIBHI", header, 94, 375, 375 + len(record), 1, 0, 24, len(heights))
    struct.pack_into("<12d", header, 131, *[0.01] * 3, *[0.0] * 3, 9, 0, 9, 0, 9, 0)
    struct.pack_into("<Q", header, 247, len(heights))
    points = b"".join(struct.pack("<iii8xi", 100 * number, 0, 0, height) for number, height in enumerate(heights))
    path.write_bytes(bytes(header) + record + points)


def test_numbers_for_no_data_are_shown(tmp_path: Path) -> None:
    las_with_no_data(tmp_path / "p.las", [5, -99, 7])
    spinney.build_points(tmp_path / "p.las", tmp_path / "p.goblin")
    with spinney.open_points(tmp_path / "p.goblin") as points:
        assert points.no_data == {"height": -99} and len(points) == 3
        found = points.stats()["height"]
        assert found is not None and (found.count, found.min, found.mean) == (2, 5, 6)
        assert points.count(where="height<100") == 2
