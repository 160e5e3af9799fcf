"""Stacks: files, bands, arrays and times as the layers of one file, and as axes of xarray."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import FIXTURES, noise, run

import spinney

TRANSFORM = (10.0, 0.0, 500000.0, 0.0, -10.0, 4000000.0)


def read(path: Path, layer: str) -> np.ma.MaskedArray:
    with spinney.open(path, layer=layer) as ds:
        return ds.read(masked=True)[0]


def same(found: np.ma.MaskedArray, wanted: object) -> bool:
    """Returns whether cells are equal; NaN is VOID."""
    array = np.ma.asarray(wanted)
    hidden = np.ma.getmaskarray(array) | (np.isnan(array.data) if array.dtype.kind == "f" else False)
    return found.dtype == array.dtype and np.array_equal(np.ma.getmaskarray(found), hidden) and np.array_equal(found.data[~hidden], array.data[~hidden])


@pytest.mark.parametrize("ending", ["goblin", "autumn"])
def test_arrays_by_their_names(tmp_path: Path, ending: str) -> None:
    path, random = tmp_path / f"s.{ending}", np.random.default_rng(1)
    red, height = noise((150, 170), "uint16"), noise((150, 170), "float32", 2)
    height[40:60, 20:90] = np.nan
    cover = np.ma.array(noise((75, 85), "uint8", 3), mask=random.random((75, 85)) < 0.2)
    solid = noise((150, 170), "uint8", 4) > 100
    spinney.build(
        {"red": red, "height": height, "cover": cover, "wood": solid, "rgb": np.stack([red.astype("u1")] * 3)},
        path,
        crs="EPSG:32628",
        transform=TRANSFORM,
        nodata={"red": 7},
        kind={"cover": "categorical"},
        rule={"height": "max"},
        categories={"cover": {1: "water"}},
        units={"height": ["m"]},
        tags={"red": {"instrument": "A"}},
    )
    with spinney.open(path) as ds:
        assert ds.names == ["red", "height", "cover", "wood", "rgb"] and ds.layer == "red"
        assert (ds.nodata, ds["height"].nodata, ds["cover"].nodata) == (7, None, None)
        assert [ds[name].kind for name in ds.names] == ["continuous", "continuous", "categorical", "categorical", "continuous"]
        assert [ds[name].depth for name in ds.names] == [8, 8, 7, 8, 8] and ds["height"].rule == "max"
        assert ds["cover"].categories == {1: "water"} and ds["height"].units == ("m",) and ds.tags == {"instrument": "A"} and ds["cover"].tags == {}
        assert {ds[name].crs for name in ds.names} == {"EPSG:32628"}
        assert ds.transform[:6] == TRANSFORM and ds["cover"].transform[:6] == (20.0, 0.0, 500000.0, 0.0, -20.0, 4000000.0)
        assert ds["rgb"].count == 3
    for name, wanted in {"red": np.ma.masked_equal(red, 7), "height": height, "cover": cover, "wood": solid.astype("u1")}.items():
        assert same(read(path, name), wanted), name
    assert spinney.verify(path) == []


def test_bands_of_arrays_have_masks_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "s.goblin"
    array = np.ma.array(np.stack([noise((60, 70), "uint16", seed) for seed in range(6)]), mask=False)
    for band in range(6):
        array[band, band * 8 : band * 8 + 9] = np.ma.masked
    # (Together they do not form values of one tree.)
    with pytest.raises(ValueError, match="bands differ"):
        spinney.build(array[:3], path)
    for source, options in (
        (array, {}),
        (array.data, {"mask": array.mask}),
        (np.ma.array(np.moveaxis(array.data, 0, -1), mask=np.moveaxis(array.mask, 0, -1)), {"dims": "yxb"}),
        (list(array), {}),
    ):
        spinney.build(source, path, stack=True, **options)
        with spinney.open(path) as ds:
            assert ds.names == [f"band_{number}" for number in range(1, 7)]
        assert all(same(read(path, f"band_{band + 1}"), array[band]) for band in range(6))
    spinney.build(array, path, stack=True, descriptions=["B1, blue", "B2", "B3", "B4", None, "B6"], units=["a", "b", "c", "d", "e", "f"])
    with spinney.open(path) as ds:
        assert ds.names == ["B1", "B2", "B3", "B4", "band_5", "B6"] and ds["B4"].units == ("d",) and ds["B1"].descriptions == ("B1, blue",)
    spinney.build(array, path, stack=True, names=list("abcdef"), times=[f"2024-0{month}" for month in range(1, 7)])
    with spinney.open(path) as ds:
        assert ds["f"].time == "2024-06"
        assert ds.names == list("abcdef") and same(ds["f"].read(masked=True)[0], array[5])


def test_volumes_and_lazy_arrays(tmp_path: Path) -> None:
    da = pytest.importorskip("dask.array")
    path = tmp_path / "s.goblin"
    temperature, mark = noise((20, 30, 40), "float32"), noise((10, 15, 20), "uint8")
    spinney.build({"t": da.from_array(temperature, chunks=8), "m": mark}, path, dims="zyx")
    with spinney.open(path) as ds:
        assert np.array_equal(ds[...], temperature) and np.array_equal(ds["m"][...], mark) and ds["m"].depth == ds.depth - 1
        assert ds["m"].matrix[2, 2] == 2


@pytest.mark.parametrize(
    ("source", "options", "text"),
    [
        ({}, {}, "at least one"),
        ({"a": np.ones((4, 4)), "b": np.ones((3, 4))}, {}, "`b` has 3 x 4 cells"),
        ({"a": np.ones((4, 4)), "b": np.ones((4, 4))}, {"names": ["x", "x"]}, "`x`"),
        ({"a": np.ones((4, 4)), " ": np.ones((4, 4))}, {}, "expected a unique name"),
        ({"a": np.ones((4, 4))}, {"names": ["x", "y"]}, "got 2, expected one for each of 1 layers"),
        ({"a": np.ones((4, 4))}, {"nodata": {"b": 1}}, "unknown layer 'b'"),
        ({"a": np.ones((9, 9)), "b": np.ones((5, 5))}, {"depth": 3}, "expected"),
        ({"a": np.ones((4, 4)), "b": np.ones((4, 4, 4))}, {"dims": "zyx"}, "dims"),
        (np.ones((6, 4, 4)), {}, "bands"),
        (FIXTURES / "island_classes.tif", {"names": ["x"]}, "stack"),
        (FIXTURES / "island_classes.tif", {"pages": "all"}, "layers"),
        ([FIXTURES / "island_classes.tif"], {"stack": True, "grid": "xyz"}, "grid"),
        ([FIXTURES / "island_classes.tif"], {"stack": True, "names": ["x", "y"]}, "one per layer"),
        ([FIXTURES / "island_classes.tif"], {"stack": True, "times": ["in May"]}, "ISO 8601"),
        ({"a": np.ones((4, 4))}, {"times": ["2024", "2025"]}, "got 2, expected one for each of 1 layers"),
    ],
)
def test_refusals(tmp_path: Path, source: object, options: dict[str, object], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        spinney.build(source, tmp_path / "o.goblin", **options)  # type: ignore[arg-type]
    assert os.listdir(tmp_path) == []


def test_invalid_stacks_are_rejected(tmp_path: Path) -> None:
    good = np.ones((4, 4), "u1")
    tree = tmp_path / "t.goblin"
    spinney.build(good, tree)
    with spinney.open(tree) as ds:
        for source, options, text in [
            ({"a": ds}, {}, "add_layer"),
            ({"a": good, "b": str(tree)}, {}, "path"),
            ({"a": good}, {"cells": 3}, "cells"),
            (good, {"names": ["a"]}, "names"),
            (good, {"nodata": {"a": 1}}, "nodata: is for the layers"),
            (FIXTURES / "island_classes.tif", {"kind": {"a": "categorical"}}, "kind: is for the layers"),
            (iter([good]), {"stack": True, "shape": (4, 4), "dtype": "u1"}, "stack"),
            ({"a": good}, {"dtype": "u1"}, "dtype"),
            (ds, {"stack": True}, "stack"),
        ]:
            with pytest.raises(TypeError, match=text):
                spinney.build(source, tmp_path / "o.goblin", **options)


def test_a_failure_of_a_later_layer_leaves_no_file(tmp_path: Path) -> None:
    class Broken:
        shape, dtype = (300, 300), np.dtype("u1")

        def __getitem__(self, key: object) -> np.ndarray:
            raise RuntimeError("disk on fire")

    with pytest.raises(RuntimeError, match="on fire"):
        spinney.build({"a": noise((300, 300), "uint8"), "b": Broken()}, tmp_path / "o.goblin")
    assert os.listdir(tmp_path) == []
    updates: list[tuple[int, int]] = []
    spinney.build({"a": noise((300, 300), "uint8"), "b": noise((150, 150), "uint8")}, tmp_path / "o.goblin", progress=lambda *at: updates.append(at))
    assert updates[-1] == (300 * 300 + 150 * 150,) * 2


def tiff(path: Path, bands: np.ndarray, nodata: float | None = None, width: float = 10.0, names: list[str] | None = None, at: float = 500000.0, **more: str) -> Path:
    rasterio = pytest.importorskip("rasterio")
    about = {"driver": "GTiff", "height": bands.shape[1], "width": bands.shape[2], "count": len(bands), "dtype": bands.dtype, "nodata": nodata, **more}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path, "w", crs="EPSG:32628", transform=rasterio.Affine(width, 0, at, 0, -width, 4e6), **about) as file:
            file.write(bands)
            for number, name in enumerate(names or [], 1):
                file.set_band_description(number, name)
    return path


def test_files_are_stacked_as_by_the_program(tmp_path: Path, program: str) -> None:
    fine, coarse = noise((2, 120, 140), "uint16"), noise((1, 60, 70), "float32", 2)
    paths = [tiff(tmp_path / "fine.tif", fine, 7, names=["B02", "B03, green"]), tiff(tmp_path / "B05.tif", coarse, -1, width=20.0)]
    moved = tiff(tmp_path / "moved.tif", noise((1, 120, 140), "uint8", 3), width=10.0, at=500003.0)
    mine, theirs = tmp_path / "mine.goblin", tmp_path / "theirs.goblin"
    for inputs, options, words in [
        (paths, {}, []),
        (paths, {"names": ["a", "b", "c"]}, ["--names", "a,b,c"]),
        (paths, {"times": ["2024-05-01", "2024-06-01T10:30:00Z"]}, ["--times", "2024-05-01,2024-06-01T10:30:00Z"]),
        (paths[:1], {"bands": ["B03"]}, ["--band", "B03"]),
        (paths[:1], {"bands": ["B03", 1], "names": ["g", "b"], "kind": "categorical"}, ["--band", "B03,1", "--names", "g,b", "--kind", "categorical"]),
        ([*paths, moved], {"resampling": "nearest"}, ["--resampling", "nearest"]),
        ([*paths, moved], {"resampling": "bilinear", "allow_ballpark": True}, ["--resampling", "bilinear", "--allow-ballpark"]),
    ]:
        spinney.build(inputs, mine, stack=True, **options)  # type: ignore[arg-type]
        run(program, "-q", "build", *inputs, "-o", theirs, "--stack", *words)
        assert mine.read_bytes() == theirs.read_bytes(), words
    spinney.build(paths, mine, stack=True, times=np.array(["2024-05-01", "2024-06-01"], "M8[D]"))
    with spinney.open(mine) as ds:
        assert [ds[name].time for name in ds.names] == ["2024-05-01T00:00:00Z"] * 2 + ["2024-06-01T00:00:00Z"]
    spinney.build({"x": paths[1], "y": moved}, mine, resampling="nearest")
    with spinney.open(mine) as ds:
        assert ds.names == ["x", "y"]
    with pytest.raises(ValueError, match="moved"):
        spinney.build([*paths, moved], tmp_path / "o.goblin", stack=True)
    spinney.build(paths, mine, stack=True)
    with spinney.open(mine) as ds:
        assert ds.names == ["B02", "B03", "B05"] and ds["B05"].depth == ds.depth - 1
        assert same(ds["B03"].read(masked=True)[0], np.ma.masked_equal(fine[1], 7))


def test_datasets_of_rasterio_are_stacked_as_their_files(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    many = tiff(tmp_path / "many.tif", noise((5, 60, 70), "int16"), 9, names=["B1, blue", "B2", "B3", "", "B5"])
    rgba = tiff(tmp_path / "rgba.tif", noise((4, 60, 70), "uint8", 2), photometric="RGB", alpha="YES")
    opacity = (255 * (noise((60, 70), "uint16", 4) > 90)).astype("u2")
    grey = tiff(tmp_path / "grey.tif", np.stack([noise((60, 70), "uint16", 3), opacity]), alpha="YES")
    three = tiff(tmp_path / "three.tif", np.stack([*noise((2, 60, 70), "uint16", 3), opacity]), photometric="MINISBLACK", alpha="YES")
    for path in (many, rgba, grey, three):
        spinney.build(path, tmp_path / "file.goblin", stack=True)
        with rasterio.open(path) as file:
            spinney.build(file, tmp_path / "open.goblin", stack=True)
        with spinney.open(tmp_path / "file.goblin") as one, spinney.open(tmp_path / "open.goblin") as other:
            assert [name or path.stem for name in one.names] == other.names
            for name in one.names:
                first, second = one[name] if name else one, other[name or path.stem]
                assert (first.kind, first.nodata, first.dtype, first.crs, first.transform) == (second.kind, second.nodata, second.dtype, second.crs, second.transform)
                ours, theirs = first.read(masked=True), second.read(masked=True)
                assert np.array_equal(np.ma.getmaskarray(ours), np.ma.getmaskarray(theirs)) and np.array_equal(ours.compressed(), theirs.compressed()), (path, name)
    with rasterio.open(many) as file:
        spinney.build({"x": file, "y": noise((30, 35), "uint8")}, tmp_path / "open.goblin")
    with spinney.open(tmp_path / "open.goblin") as ds:
        assert ds.names == ["x_B1", "x_B2", "x_B3", "x_many_4", "x_B5", "y"] and ds["y"].transform[0] == 20


def test_pages_are_layers_or_planes(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    pages = [noise((30, 40), "uint8", seed) for seed in (1, 2, 3)]
    path = tmp_path / "p.tif"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for index, page in enumerate(pages):
            more = {"APPEND_SUBDATASET": "YES"} if index else {}
            with rasterio.open(path, "w", count=1, dtype="uint8", width=40, height=30, driver="GTiff", **more) as file:
                file.write(page, 1)
    spinney.build(path, tmp_path / "l.goblin", pages="layers")
    with spinney.open(tmp_path / "l.goblin") as ds:
        assert ds.names == ["p_0", "p_1", "p_2"] and all(np.array_equal(ds[name][...], page) for name, page in zip(ds.names, pages))
    spinney.build(path, tmp_path / "z.goblin", pages="z")
    with spinney.open(tmp_path / "z.goblin") as ds:
        assert np.array_equal(ds[...], np.stack(pages))


def test_layers_share_their_open_file(tmp_path: Path) -> None:
    path = tmp_path / "s.goblin"
    spinney.build({f"b{number}": np.full((8, 8), number, "u2") for number in range(300)}, path)
    with spinney.open(path, positioned=True) as ds:
        before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
        held = [ds[name] for name in ds.names]
        assert [int(layer[0, 0]) for layer in held] == list(range(300))
        assert not before or len(os.listdir("/proc/self/fd")) == before
    # (Each is open until it is closed itself.)
    assert int(held[7][0, 0]) == 7
    held[7].close()
    with pytest.raises(ValueError, match="closed"):
        held[7][0, 0]
