"""GeoDataFrames and GeoSeries as polygons and as points."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinney
import spinney.dask

from conftest import FIXTURES
from test_dask import client  # noqa: F401 (a fixture)

geopandas = pytest.importorskip("geopandas")
shapely = pytest.importorskip("shapely")


@pytest.fixture(scope="module")
def districts() -> Any:
    return geopandas.read_file(FIXTURES / "island_districts.geojson")


@pytest.fixture(scope="module")
def ds(relief: str) -> Iterator[spinney.Dataset]:
    with spinney.open(relief) as opened:
        yield opened


def test_empty_frames_have_their_columns(ds: spinney.Dataset, island: str, districts: Any) -> None:
    empty = districts[:0]
    table = ds.zonal(empty, ["mean", "count"], quantiles=[0.1])
    assert list(table.columns) == ["mean", "count", "q10"] and len(table) == 0 and table["mean"].dtype == float
    assert list(ds.zonal(empty).columns) == list(ds.zonal(districts).columns)
    assert list(ds.zonal(empty.geometry, ["mean"]).columns) == ["mean"]
    of_layers = ds.zonal(empty, ["max"], layers=ds.names)
    assert [list(table.columns) for table in of_layers.values()] == [["max"]]
    with spinney.open(island) as classes:
        assert list(classes.zonal(empty, ["count", "classes"]).columns) == ["count"]


def test_polygons_outside_are_in_the_system_that_the_error_names(ds: spinney.Dataset, districts: Any, tmp_path: Path) -> None:
    outside = districts.set_geometry(districts.translate(1e6, 0))
    with pytest.raises(ValueError, match=r"in EPSG:32628.*, all outside"):
        ds.zonal(outside, "mean")
    with pytest.raises(ValueError, match=r"in EPSG:32628.*, all outside"):
        ds.zonal(outside, "mean", out=tmp_path / "x.geojson")
    with pytest.raises(ValueError, match=r"in EPSG:3857.*, all outside"):
        ds.zonal(list(outside.geometry), "mean", crs="EPSG:3857")


def test_measures_are_names_or_a_string_of_names(ds: spinney.Dataset, districts: Any) -> None:
    table = ds.zonal(districts, ["mean", "max"], quantiles=[0.5])
    assert ds.zonal(districts, "mean max", quantiles=0.5).equals(table) and ds.zonal(districts, "mean, max", quantiles=[0.5]).equals(table)
    assert list(ds.zonal(districts, "mean").columns) == ["mean"]
    polygons = list(districts.to_crs(ds.crs).geometry)
    assert ds.zonal(polygons, "mean") == ds.zonal(polygons, ["mean"])
    with pytest.raises(ValueError, match="measures: got average, expected names among count"):
        ds.zonal(districts, "average")
    with pytest.raises(ValueError, match="measures: got average"):
        ds.zonal(districts, ["mean", "average"])


def test_one_name_of_an_attribute(ds: spinney.Dataset, districts: Any, tmp_path: Path) -> None:
    ds.zonal(districts, ["mean"], out=tmp_path / "joined.geojson", attribute="name")
    features = json.loads((tmp_path / "joined.geojson").read_text())["features"]
    assert {"name"} < features[0]["properties"].keys() and len(features) == len(districts)
    rows = np.zeros(3, dtype=[("x", "f8"), ("y", "f8"), ("intensity", "u2")])
    rows["intensity"] = [4, 5, 6]
    spinney.build_points(rows, tmp_path / "p.goblin", attributes="intensity")
    with spinney.open_points(tmp_path / "p.goblin") as points:
        assert points.read(attributes="intensity").dtype.names == ("x", "y", "z", "intensity")


def test_a_cluster_takes_frames(relief: str, island: str, districts: Any, client: Any) -> None:  # noqa: F811
    pandas = pytest.importorskip("pandas")
    for path, measures in ((relief, "mean"), (relief, None), (relief, ["median", "count"]), (island, None), (island, ["classes", "count"])):
        with spinney.open(path) as tree:
            for frame in (districts, districts.to_crs(3857).set_index("name"), districts.geometry, districts[:0]):
                found = spinney.dask.zonal(path, frame, measures, client=client, parts=3, edge="area")
                pandas.testing.assert_frame_equal(found, tree.zonal(frame, measures, edge="area"))
    with spinney.open(relief) as tree:
        layers = spinney.dask.zonal(relief, districts, ["mean"], client=client, layers=tree.names)
        for name, table in tree.zonal(districts, ["mean"], layers=tree.names).items():
            pandas.testing.assert_frame_equal(layers[name], table)
        polygons = list(districts.to_crs(tree.crs).geometry)
        assert spinney.dask.zonal(relief, polygons, "mean", client=client) == tree.zonal(polygons, "mean")
    # Some may be outside, even all of one task.
    far = geopandas.GeoDataFrame(geometry=[*districts.geometry, *districts.translate(1e6, 0)], crs=districts.crs)
    with spinney.open(relief) as tree:
        pandas.testing.assert_frame_equal(spinney.dask.zonal(relief, far, "count mean", client=client, parts=len(far)), tree.zonal(far, "count mean"))
    with pytest.raises(ValueError, match="all outside of the tree"):
        spinney.dask.zonal(relief, far[len(districts) :], "count", client=client, parts=2)
    with pytest.raises(TypeError, match="out: not supported for statistics by a cluster"):
        spinney.dask.zonal(relief, districts, "mean", client=client, out="x.gpkg")


def test_points_of_series_are_in_their_own_system(ds: spinney.Dataset, districts: Any) -> None:
    centroids = districts.to_crs(ds.crs).centroid
    rows = np.column_stack([centroids.x, centroids.y])
    expected = ds.sample(rows)
    for points in (centroids, centroids.to_frame("geometry"), list(centroids), shapely.MultiPoint(rows), centroids.set_crs(None, allow_override=True)):
        np.testing.assert_array_equal(ds.sample(points), expected)
    # (After a round trip through another system points have rounding errors.)
    np.testing.assert_allclose(ds.sample(centroids.to_crs(4326)), expected, rtol=0, atol=1)
    np.testing.assert_array_equal(ds.sample(centroids.to_crs(4326), masked=True).mask, ds.sample(rows, masked=True).mask)
    lonlat = json.loads(centroids.to_crs(4326).to_json())
    np.testing.assert_allclose(ds.sample({key: lonlat[key] for key in ("type", "features")}), expected, rtol=0, atol=1)
    # An empty point has no coordinates.
    np.testing.assert_array_equal(ds.sample(geopandas.GeoSeries([shapely.Point(), *centroids], crs=centroids.crs), masked=True).mask[0], True)
    with pytest.raises(TypeError, match="centroid"):
        ds.sample(districts)
    with pytest.raises(TypeError, match="expected a point"):
        ds.sample([shapely.box(0, 0, 1, 1)])
    with pytest.raises(TypeError, match="coordinate system of their own"):
        spinney._arrays.points_of(centroids, 2)
