"""Features that are written with the statistics of their cells."""

from __future__ import annotations

import json
import subprocess
import warnings
from pathlib import Path

import pytest
import shapely

import spinney

from conftest import FIXTURES

DISTRICTS = FIXTURES / "island_districts.geojson"
ENDINGS = ("geojson", "csv", "gpkg", "fgb", "shp", "svg")


def written(path: Path) -> bytes:
    """Returns all bytes of a file and of its sidecar files."""
    return b"".join(own.read_bytes() for own in sorted(path.parent.glob(path.stem + ".*")))


@pytest.mark.parametrize("ending", ENDINGS)
def test_files_are_those_of_the_program(program: str, island: str, tmp_path: Path, ending: str) -> None:
    own, other = (tmp_path / directory / f"zones.{ending}" for directory in ("own", "other"))
    for path in (own, other):
        path.parent.mkdir()
    with spinney.open(island) as ds, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        count = ds.zonal(DISTRICTS, ["count", "majority", "classes"], quantiles=[0.5], edge="area", out=own)
    assert count == 2
    options = ["--measure", "count,majority,classes", "--quantiles", "0.5", "--edge", "area"]
    subprocess.run([program, "-q", "stats", island, "--zones", DISTRICTS, *options, "-o", other], check=True)
    assert written(own) == written(other) != b""


def test_features_keep_what_they_had(island: str, tmp_path: Path) -> None:
    districts = json.loads(DISTRICTS.read_text())
    square = districts["features"][0]["geometry"]
    features = [
        {"type": "Feature", "id": "a", "properties": {"kind": "wood", "list": [1, 2]}, "geometry": square},
        {"type": "Feature", "id": 7, "properties": {"kind": None, "list": None}, "geometry": None},
        {"type": "Feature", "id": "c", "properties": {"kind": "lake"}, "geometry": {"type": "Point", "coordinates": [0, 0]}},
    ]
    document = {"type": "FeatureCollection", "crs": districts["crs"], "features": features}
    alone = document | {"features": features[:1]}
    out = tmp_path / "out.geojson"
    with spinney.open(island) as ds:
        assert ds.zonal(document, ["count"], out=out) == 3
        (zone,) = ds.zonal(alone)
        found = json.loads(out.read_text())["features"]
        assert [feature["id"] for feature in found] == ["a", 7, "c"]
        assert [feature["properties"]["count"] for feature in found] == [zone.cells, 0, 0]
        assert [feature["properties"]["kind"] for feature in found] == ["wood", None, "lake"]
        assert found[0]["properties"]["list"] == [1, 2]
        assert (found[1]["geometry"], found[2]["geometry"]["type"]) == (None, "Point")
        assert ds.zonal(document, ["count"], where={"kind": "wood"}, attribute=["kind"], out=out) == 1
        (found,) = json.loads(out.read_text())["features"]
        assert found["properties"] == {"kind": "wood", "count": zone.cells}
        # Requested values are those of the result without a file.
        (expected,) = ds.zonal(alone, ["mean", "median"], quantiles=[0.25], edge="area")
        ds.zonal(alone, ["mean", "median"], quantiles=[0.25], edge="area", out=out)
        (found,) = json.loads(out.read_text())["features"]
        assert [found["properties"][name] for name in expected] == list(expected.values())


def test_geometries_are_in_the_system_of_the_tree(relief: str, tmp_path: Path) -> None:
    with spinney.open(relief) as ds:
        west, south, east, north = ds.bounds
        box = shapely.box(west, south, (west + east) / 2, north)
        out = tmp_path / "out.geojson"
        assert ds.zonal([box, box], ["count", "mean"], out=out) == 2
        document = json.loads(out.read_text())
        (expected,) = ds.zonal(box, ["count", "mean"])
        for feature in document["features"]:
            assert feature["properties"] == expected
            assert shapely.geometry.shape(feature["geometry"]).equals(box)
        # Written features have the same cells when they are read.
        assert ds.zonal(document, ["count", "mean"]) == [expected, expected]
        assert ds.zonal(out, ["count", "mean"]) == [expected, expected]


def test_invalid_outputs_are_rejected(island: str, tmp_path: Path) -> None:
    with spinney.open(island) as ds:
        with pytest.raises(ValueError, match="out: expected"):
            ds.zonal(DISTRICTS, out=tmp_path / "out.tif")
        with pytest.raises(ValueError, match="input and the output"):
            ds.zonal(DISTRICTS, out=DISTRICTS)
        with pytest.raises(TypeError, match="attribute"):
            ds.zonal(DISTRICTS, attribute=["name"])  # type: ignore[call-overload]
        with pytest.raises(ValueError, match="no feature has"):
            ds.zonal(DISTRICTS, attribute=["nothing"], out=tmp_path / "out.csv")
        with pytest.raises(ValueError, match="one coordinate system"):
            ds.zonal([DISTRICTS, DISTRICTS], out=tmp_path / "out.csv")
        far = shapely.box(1e8, 1e8, 2e8, 2e8)
        with pytest.raises(ValueError, match="outside of the tree"):
            ds.zonal(far, crs="world", out=tmp_path / "out.csv")
        assert list(tmp_path.iterdir()) == []


def test_what_is_lost_is_a_warning(island: str, tmp_path: Path) -> None:
    document = json.loads(DISTRICTS.read_text())
    for feature in document["features"]:
        feature["properties"]["description_of_it"] = "x" * 300
    with spinney.open(island) as ds:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            ds.zonal(document, ["count"], out=tmp_path / "out.shp")
        messages = " ".join(str(warning.message) for warning in caught)
        assert "`description_of_it` is `descriptio`" in messages and "truncated to 254 bytes: 2" in messages
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            ds.zonal(document, ["count"], out=tmp_path / "out.fgb")


def test_whole_numbers_of_64_bits_are_exact(tmp_path: Path) -> None:
    with spinney.open(FIXTURES / "v1" / "stack.goblin", layer="label") as ds:
        assert ds.dtype == "uint64"
        box = shapely.box(*ds.bounds)
        (expected,) = ds.zonal(box, ["min", "max", "majority"], crs="world")
        for ending in ("geojson", "gpkg"):
            out = tmp_path / f"out.{ending}"
            ds.zonal(box, ["min", "max", "majority"], crs="world", out=out)
        (found,) = json.loads((tmp_path / "out.geojson").read_text())["features"]
        assert max(expected.values()) > 2**53
        assert [int(found["properties"][name]) for name in expected] == list(expected.values())
