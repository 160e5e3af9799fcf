"""Points, statistics, histograms, searches: against NumPy."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.features
import shapely
from conftest import FIXTURES, TREES, noise, run
from hypothesis import given
from hypothesis import strategies as st

import spinney


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, spinney.Dataset]:
    """A masked, georeferenced array, and a tree of it."""
    array = np.ma.masked_equal(noise((170, 230), "int16", 5), 33)
    path = tmp_path_factory.mktemp("tree") / "t.goblin"
    spinney.build(array, path, transform=(2, 0, 1000, 0, -3, 5000), crs="EPSG:32628")
    return array, spinney.open(path)


@given(data=st.data())
def test_statistics_of_any_window(tree: tuple, data: st.DataObject) -> None:
    array, ds = tree
    x, y = data.draw(st.integers(0, 229)), data.draw(st.integers(0, 169))
    w, h = data.draw(st.integers(1, 230 - x)), data.draw(st.integers(1, 170 - y))
    part = array[y : y + h, x : x + w]
    found = ds.stats(window=(x, y, w, h))
    assert (found.cells, found.void_cells) == (part.count(), part.size - part.count())
    box = (1000 + 2 * x, 5000 - 3 * (y + h), 1000 + 2 * (x + w), 5000 - 3 * y)
    assert ds.stats(box, coordinates="world") == found
    if part.count():
        assert (found.min, found.max) == (part.min(), part.max())
        assert np.isclose(found.mean, part.mean()) and np.isclose(found.std, part.std())
        counts, edges = ds.histogram(10, (0, 250), window=(x, y, w, h))
        assert np.array_equal(counts, np.histogram(part.compressed(), edges)[0])
        counts, edges = ds.histogram(window=(x, y, w, h))
        assert counts.sum() == part.count() and len(edges) == len(counts) + 1
    else:
        with pytest.raises(ValueError):
            found.mean


@given(seed=st.integers(0, 1 << 30))
def test_zones_are_as_rasterio_and_shapely_have_them(tree: tuple, seed: int) -> None:
    array, ds = tree
    random = np.random.default_rng(seed)
    polygons = []
    for _ in range(4):
        middle = random.uniform((1000, 4490), (1460, 5000))
        angles = np.sort(random.uniform(0, 2 * np.pi, 12))
        ring = middle + np.stack([np.cos(angles), np.sin(angles)], 1) * random.uniform(30, 150, (12, 1))
        polygons.append(shapely.Polygon(ring))
    transform = rasterio.Affine(2, 0, 1000, 0, -3, 5000)
    zones = ds.zonal(polygons)
    for polygon, zone in zip(polygons, zones):
        inside = rasterio.features.geometry_mask([polygon], (170, 230), transform, invert=True)
        cells = array[inside]
        assert (zone.cells, zone.void_cells) == (cells.count(), inside.sum() - cells.count())
        if cells.count():
            assert (zone.min, zone.max) == (cells.min(), cells.max())
            assert np.isclose(zone.mean, cells.mean()) and np.isclose(zone.std, cells.std())
    extent = shapely.box(1000, 4490, 1460, 5000)
    for polygon, zone in zip(polygons, ds.zonal(polygons, edge="area")):
        if polygon.is_valid:
            area = polygon.intersection(extent).area / 6
            assert np.isclose(zone.cells + zone.void_cells, area, atol=1e-6)


def test_zones_of_all_kinds_of_geometries(tree: tuple) -> None:
    _, ds = tree
    square, hole = shapely.box(1100, 4700, 1200, 4850), shapely.box(1120, 4730, 1150, 4760)
    parts = shapely.MultiPolygon([square - hole, hole])
    whole = ds.zonal(square)[0]
    assert whole == ds.zonal([square])[0] == ds.zonal(square.__geo_interface__)[0]
    box = ds.stats((1100, 4700, 1200, 4850), coordinates="world")
    assert (whole.cells, whole.mean) == (box.cells, box.mean)
    feature = {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(square)}
    features = {"type": "FeatureCollection", "features": [feature, feature]}
    assert ds.zonal(features, crs="world") == [whole, whole]
    assert np.isclose(ds.zonal(parts, edge="area")[0].cells, ds.zonal(square, edge="area")[0].cells)
    assert ds.zonal(parts)[0].cells == whole.cells
    touched = ds.zonal(square, edge="touch")[0].cells
    assert ds.zonal(square, edge="area")[0].cells <= touched <= whole.cells + 2 * (50 + 50) + 4
    found = ds.zonal([square, shapely.box(0, 0, 1, 1)], ["count", "mean", "sum", "void"])
    assert found[0] == {"count": whole.cells, "mean": whole.mean, "sum": whole.bands[0].sum, "void": whole.void_cells}
    assert np.isclose(found[0]["sum"], whole.mean * whole.first.cells)
    assert found[1]["count"] == 0 and np.isnan(found[1]["mean"])
    assert ds.zonal([]) == []
    with pytest.raises(ValueError, match="outside of the tree"):
        ds.zonal(shapely.box(0, 0, 1, 1))
    for wrong, error in [(shapely.Point(1, 2), ValueError), (7, TypeError), ("no such file", FileNotFoundError), ([None], TypeError)]:
        with pytest.raises(error):
            ds.zonal(wrong)
    with pytest.raises(ValueError):
        ds.zonal(square, ["middle"])
    with pytest.raises(ValueError, match="from 0 to 1"):
        ds.zonal(square, quantiles=[1.5])
    with pytest.raises(ValueError):
        ds.zonal(square, edge="half")


class Frame:
    """A minimal GeoDataFrame."""

    crs = None

    def __init__(self, geometries: list, index: list) -> None:
        self.geometries, self.index, self.iloc = geometries, index, None

    @property
    def __geo_interface__(self) -> dict:
        features = [{"type": "Feature", "properties": {}, "geometry": g and shapely.geometry.mapping(g)} for g in self.geometries]
        return {"type": "FeatureCollection", "features": features}


def test_values_of_zones_are_those_of_numpy(tree: tuple) -> None:
    array, ds = tree
    transform = rasterio.transform.from_origin(1000, 5000, 2, 3)
    polygons = [shapely.Point(1000 + 40 * i, 4950 - 30 * i).buffer(9 + 12 * i) for i in range(8)]
    levels = [0.9, 0.1, 0.5, 0, 1, 0.025]
    names = ["sum", "majority", "minority", "variety", "median", "void_share"]
    found = ds.zonal(polygons, names, quantiles=levels)
    for polygon, zone, alone in zip(polygons, found, ds.zonal(polygons, quantiles=levels), strict=True):
        inside = rasterio.features.geometry_mask([polygon], (170, 230), transform, invert=True)
        cells = array[inside].compressed()
        assert len(cells)
        values, counts = np.unique(cells, return_counts=True)
        wanted = (cells.sum(dtype=float), values[counts.argmax()], values[counts.argmin()], len(values), np.median(cells))
        assert tuple(zone[name] for name in names[:-1]) == wanted
        assert np.isclose(zone["void_share"], 1 - len(cells) / inside.sum())
        columns = ["q90", "q10", "q50", "q0", "q100", "q2.5"]
        assert np.allclose([zone[name] for name in columns], np.quantile(cells, levels))
        assert alone.bands[0].values.quantiles == {level: zone[name] for level, name in zip(levels, columns)}


def test_frames_get_tables(tree: tuple) -> None:
    _, ds = tree
    square = shapely.box(1100, 4700, 1200, 4850)
    frame = Frame([square, None, shapely.box(900, 4700, 1100, 4850)], ["a", "b", "c"])
    table = ds.zonal(frame, ["mean", "outside"], quantiles=[0.25], edge="area")
    assert list(table.index) == ["a", "b", "c"] and list(table.columns) == ["mean", "outside", "q25"]
    zone = ds.zonal(square, quantiles=[0.25], edge="area")[0]
    assert (table.loc["a", "mean"], table.loc["a", "q25"]) == (zone.mean, zone.bands[0].values.quantiles[0.25])
    assert table.loc["b"].isna().tolist() == [True, False, True]
    # (100 wide and 150 high, in cells of 2 x 3.)
    assert table["outside"].tolist() == pytest.approx([0, 0, 2500])
    assert list(ds.zonal(frame).columns) == ["count", "void", "sum", "min", "max", "mean", "std"]
    with pytest.raises(ValueError, match="rows of the frame"):
        ds.zonal(frame, where={"a": 1})


@given(seed=st.integers(0, 1 << 30))
def test_samples_of_any_points(tree: tuple, seed: int) -> None:
    array, ds = tree
    points = np.random.default_rng(seed).uniform((990, 4400), (1500, 5020), (300, 2))
    rows, columns = (np.floor((5000 - points[:, 1]) / 3).astype(int), np.floor((points[:, 0] - 1000) / 2).astype(int))
    inside = (rows >= 0) & (rows < 170) & (columns >= 0) & (columns < 230)
    wanted = array[rows.clip(0, 169), columns.clip(0, 229)]
    wanted[~inside] = np.ma.masked
    found = ds.sample(points, masked=True)
    assert found.shape == (300, 1) and found.dtype == np.int16
    assert np.array_equal(found.mask[:, 0], np.ma.getmaskarray(wanted)) and np.array_equal(found[:, 0].compressed(), wanted.compressed())
    assert (ds.sample(points, fill=-7)[found.mask[:, 0]] == -7).all()
    cells = np.stack([columns, rows], 1) + 0.25
    assert np.array_equal(ds.sample(iter(cells.tolist()), coordinates="cells"), ds.sample(points))
    level = ds.depth - 2
    coarse = ds.sample(points[inside], level=level, fill=-1)[:, 0]
    assert np.array_equal(coarse, ds.read(1, level=level, fill=-1)[rows[inside] >> 2, columns[inside] >> 2])


@pytest.mark.parametrize("count", [1, 20, 100, 1000, 30_000])
def test_samples_of_noise(tmp_path: Path, count: int) -> None:
    array = np.random.default_rng(1).integers(0, 255, (900, 1024), "u1")
    spinney.build(array, tmp_path / "t.goblin")
    cells = np.random.default_rng(2).integers(0, (1024, 900), (count, 2))
    with spinney.open(tmp_path / "t.goblin") as ds:
        assert np.array_equal(ds.sample(cells + 0.5)[:, 0], array[cells[:, 1], cells[:, 0]])


def test_odd_points(tree: tuple) -> None:
    _, ds = tree
    assert ds.sample([]).shape == (0, 1)
    assert ds.sample([(np.nan, 1), (np.inf, 1), (-1e300, 1e300)], masked=True).mask.all()


@pytest.mark.parametrize("path", TREES, ids=lambda path: path.name)
def test_statistics_are_those_of_the_program(path: Path, program: str) -> None:
    wanted = json.loads(run(program, "stats", path, "--json"))
    with spinney.open(path) as ds:
        found = ds.stats()
        assert (found.cells, found.void_cells) == (wanted["cells"], wanted["void_cells"])
        assert {entry["value"]: entry["cells"] for entry in wanted["classes"]} == found.classes
        for band, channel in zip(found.bands, wanted["channels"], strict=True):
            assert (band.cells, band.min, band.max) == (channel["cells"], channel["min"], channel["max"])
            assert np.isclose(band.mean, channel["mean"]) and np.isclose(band.std, channel["standard_deviation"])
        if "solid" in wanted:
            solid = ds.solid()
            assert np.isclose(solid.volume, wanted["solid"]["volume"]) and solid.cells == wanted["solid"]["occupied_cells"]
            assert solid.centre == pytest.approx(wanted["solid"]["centre"])


@pytest.mark.parametrize("words", [("--class", 6), ("--above", 4), ("--below", 3)], ids=str)
def test_blocks_are_those_of_the_program(island: str, program: str, words: tuple) -> None:
    name = {"--class": "value", "--above": "above", "--below": "below"}[words[0]]
    for more, options in [((), {}), (("--limit", 5), {"limit": 5}), (("--largest", 4), {"largest": 4})]:
        lines = [json.loads(line) for line in run(program, "find", island, "--json", *words, *more).splitlines()]
        with spinney.open(island) as ds:
            found = ds.find(**{name: words[1]}, **options)
            assert found.codes.tolist() == [line["code"] for line in lines] and len(found) == len(lines)
            assert found.levels.tolist() == [line["level"] for line in lines]
            assert found.boxes.tolist() == [line["min"] + line["size"] for line in lines]
            assert np.allclose(found.world, [line["world"][0] + line["world"][1] for line in lines])
            assert [None if np.isnan(value) else value for value in found.values] == [line["value"] for line in lines]
            if words[0] == "--class":
                assert all((ds.read(window=box) == 6).all() for box in found.boxes[:5])
    with spinney.open(island) as ds:
        assert len(ds.find(200)) == 0 and ds.find(200).boxes.shape == (0, 4)


def test_zones_of_layers_are_those_of_each() -> None:
    districts = json.loads((FIXTURES / "island_districts.geojson").read_text())
    for name in ("stack.goblin", "stack.autumn"):
        with spinney.open(FIXTURES / "v1" / name) as stack:
            for edge in ("centre", "touch", "area"):
                found = stack.zonal(districts, edge=edge, layers=stack.names)
                assert list(found) == stack.names
                for layer, zones in found.items():
                    for zone, alone in zip(zones, stack[layer].zonal(districts, edge=edge), strict=True):
                        assert zone.classes == pytest.approx(alone.classes)
                        assert (zone.cells, zone.mean) == pytest.approx((alone.cells, alone.mean))
            means = stack.zonal(districts, ["mean", "count"], layers=["height"])
            assert means == {"height": stack["height"].zonal(districts, ["mean", "count"])}
            assert stack.zonal(districts) == stack.zonal(districts, layers=stack.names[:1])[stack.names[0]]
            with pytest.raises(TypeError, match=r"ds\.names"):
                stack.zonal(districts, layers="height")
            with pytest.raises((ValueError, OSError, KeyError), match="nothing"):
                stack.zonal(districts, layers=["nothing"])
        with spinney.open(FIXTURES / "v1" / name, view="mirror=x") as turned:
            found = turned.zonal(districts, layers=["height", "cover"])
            alone = spinney.open(FIXTURES / "v1" / name, view="mirror=x", layer="height").zonal(districts)
            assert found["height"][0].mean == pytest.approx(alone[0].mean)


def test_layers_are_bands_of_one_dataset() -> None:
    for name in ("stack.goblin", "stack.autumn"):
        with spinney.open(FIXTURES / "v1" / name) as stack, stack[["cover", "colour.b2", "cover"]] as bands:
            assert (bands.count, bands.shape, bands.descriptions) == (3, stack.shape, ("cover", bands.descriptions[1], "cover"))
            cover, colour = stack["cover"].read(1, masked=True), stack["colour"].read(2, masked=True)
            colour = np.ma.masked_array(np.repeat(np.repeat(colour.data, 4, 0), 4, 1), np.repeat(np.repeat(np.ma.getmaskarray(colour), 4, 0), 4, 1))
            found = bands.read(masked=True)
            for band, expected in zip(found, (cover, colour, cover), strict=True):
                assert np.array_equal(np.ma.getmaskarray(band), np.ma.getmaskarray(expected))
                assert np.array_equal(band.compressed(), expected.compressed())
            with spinney.open(FIXTURES / "v1" / name, view="composite=cover,colour.b2,cover") as view:
                assert np.array_equal(view.read(), bands.read())
            with pytest.raises(ValueError, match="one type"):
                stack[["cover", "height"]]
            with pytest.raises(ValueError, match="2 to 4 layers"):
                stack[["cover"]]
