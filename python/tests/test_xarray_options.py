"""Datasets of the xarray engine: xarray's own options, types of integers, pickles, and names of
Dask arrays.
"""

from __future__ import annotations

import os
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinney

from conftest import FIXTURES, noise
from test_remote import serve

xr = pytest.importorskip("xarray")

WHOLE = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"]


@pytest.mark.parametrize("dtype", WHOLE)
@pytest.mark.parametrize("scaling", [{}, {"scales": [0.5]}, {"offsets": [10.0]}, {"scales": [0.25], "offsets": [-3.0]}])
def test_integers_become_what_xarray_makes_of_them(tmp_path: Path, dtype: str, scaling: dict[str, Any]) -> None:
    void = np.iinfo(dtype).max if dtype[0] == "u" else np.iinfo(dtype).min
    array = np.array([[1, 2, 3], [4, 5, void]], dtype)
    spinney.build(array, tmp_path / "t.goblin", nodata=void, **scaling)
    # xarray's own result for the same numbers and attributes.
    attrs = {"_FillValue": array.dtype.type(void)}
    attrs |= {name: scaling[key][0] for name, key in (("scale_factor", "scales"), ("add_offset", "offsets")) if key in scaling}
    expected = xr.decode_cf(xr.Dataset({"v": (("y", "x"), array, attrs)})).v
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney") as ds:
        found = ds.band_data[0]
        assert found.dtype == expected.dtype == (np.float32 if array.itemsize <= 2 and not scaling else np.float64)
        np.testing.assert_array_equal(found, expected)
        assert np.isnan(found[1, 2]) and int(found.isnull().sum()) == 1
        spinney.build(ds.band_data, tmp_path / "again.goblin")
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney", mask_and_scale=False) as ds:
        assert ds.band_data.dtype == dtype and int(ds.band_data.attrs["_FillValue"]) == void
        np.testing.assert_array_equal(ds.band_data[0], array)
        assert {key: ds.band_data.attrs[key] for key in attrs} == attrs
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney", decode_cf=False) as ds:
        assert ds.band_data.dtype == dtype


def test_integers_without_void_stay(tmp_path: Path) -> None:
    spinney.build(np.arange(6).reshape(2, 3), tmp_path / "t.goblin")
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney") as ds:
        assert ds.band_data.dtype == np.int64


def test_options_of_xarray(tmp_path: Path) -> None:
    series = xr.DataArray(noise((2, 8, 9), "float32"), {"time": np.array(["2024-01-05", "2024-02-05"], "M8[ns]")}, ("time", "y", "x"), "ndvi")
    spinney.build(series, tmp_path / "t.goblin", crs="EPSG:32628")
    path = tmp_path / "t.goblin"
    with xr.open_dataset(path, engine="spinney") as plain:
        for options in (
            {"decode_coords": "all"},
            {"decode_coords": True},
            {"decode_times": True},
            {"decode_timedelta": False},
            {"concat_characters": False},
            {"storage_options": {}},
            {"backend_kwargs": {"storage_options": {}}},
            {"no_remote": True, "no_external": True},
            {"decode_times": xr.coders.CFDatetimeCoder(time_unit="ns")},
        ):
            with xr.open_dataset(path, engine="spinney", **options) as ds:
                xr.testing.assert_identical(ds, plain)
    with xr.open_dataset(path, engine="spinney", decode_times=False) as ds:
        assert ds.time.dtype.kind in "if" and "since" in ds.time.attrs["units"]
        np.testing.assert_array_equal(xr.decode_cf(ds).time, series.time)
    with xr.open_dataset(path, engine="spinney", decode_coords=False) as ds:
        assert "spatial_ref" in ds.data_vars and ds.ndvi.attrs["grid_mapping"] == "spatial_ref" and set(ds.coords) == {"time", "x", "y"}
    with xr.open_datatree(path, engine="spinney", decode_times=False) as tree:
        assert tree["3"].time.dtype.kind in "if"
    with pytest.raises(ValueError, match="decode_coords"):
        xr.open_dataset(path, engine="spinney", decode_coords="some")


def test_storage_options_reach_the_store() -> None:
    # (An unknown option is refused before any request.)
    with pytest.raises(ValueError, match="no_such_option"):
        xr.open_dataset("s3://bucket/x.goblin", engine="spinney", storage_options={"no_such_option": 1})


def test_datasets_are_pickled(tmp_path: Path) -> None:
    array = noise((40, 50), "uint8")
    path = tmp_path / "t.goblin"
    spinney.build(array, path)
    for options in ({}, {"chunks": {}}, {"mask_and_scale": False}):
        with xr.open_dataset(path, engine="spinney", **options) as ds:
            for part in (ds, ds.isel(x=slice(3, 9)), ds.band_data, ds.mean("x")):
                again = pickle.loads(pickle.dumps(part))
                xr.testing.assert_identical(again.compute(), part.compute())
                again.close()
            loaded = ds.load()
        data = pickle.dumps(loaded)
    with xr.open_datatree(path, engine="spinney") as tree:
        assert pickle.loads(pickle.dumps(tree))["2"].band_data.shape == tree["2"].band_data.shape
    os.remove(path)
    np.testing.assert_array_equal(pickle.loads(data).band_data[0], array)


def rebuilt(path: Path, seed: int) -> np.ndarray:
    array = noise((60, 70), "uint8", seed)
    spinney.build(array, path)
    return array


def test_tokens_of_dask_are_those_of_the_version(tmp_path: Path) -> None:
    dask = pytest.importorskip("dask.base")
    da = pytest.importorskip("dask.array")
    path, other = tmp_path / "t.goblin", tmp_path / "other.goblin"
    rebuilt(other, 9)
    seen: dict[str, list[Any]] = {}
    for seed in (1, 2, 3):
        array = rebuilt(path, seed)
        with spinney.open(path) as ds, spinney.open(path, view="window=1,2,30,40") as view, spinney.open(path) as same:
            seen.setdefault("dataset", []).append(dask.tokenize(ds))
            seen.setdefault("view", []).append(dask.tokenize(view))
            seen.setdefault("array", []).append(da.from_array(ds, chunks=32).name)
            seen.setdefault("level", []).append(da.from_array(ds.level(3), chunks=4).name)
            assert dask.tokenize(same) == dask.tokenize(ds) != dask.tokenize(view)
            assert dask.tokenize(pickle.loads(pickle.dumps(ds))) == dask.tokenize(ds)
        # (For a name with a layer or a commit xarray has no modification time.)
        with spinney.open(path) as ds:
            named = f"{path}:{ds.names[0]}" if ds.names[0] else f"{path}:0"
        for name in (path, named):
            with xr.open_dataset(name, engine="spinney", chunks={}) as ds:
                seen.setdefault(f"engine {name}", []).append(ds.band_data.data.name)
                np.testing.assert_array_equal(ds.band_data.values.ravel(), array.ravel())
            with xr.open_dataset(name, engine="spinney") as ds:
                seen.setdefault(f"chunked {name}", []).append(ds.chunk({"x": 30}).band_data.data.name)
                assert type(ds.chunk({"x": 30}).band_data.variable) is xr.Variable
    assert all(len(set(names)) == 3 for names in seen.values()), seen
    tokens = []
    for height in (1.0, 2.0):
        spinney.build_points([(1, 2, height)], tmp_path / "p.goblin")
        with spinney.open_points(tmp_path / "p.goblin") as points, spinney.open_points(tmp_path / "p.goblin") as same_points:
            tokens.append(dask.tokenize(points))
            assert tokens[-1] == dask.tokenize(same_points)
    assert tokens[0] != tokens[1]
    # A view names other files, too.
    with spinney.open(path, view=f"calc=b1+other,other={other}") as both:
        before = dask.tokenize(both)
        rebuilt(other, 10)
        assert dask.tokenize(both) != before


def test_a_remote_file_that_was_replaced(tmp_path: Path) -> None:
    dask = pytest.importorskip("dask.base")
    for name in ("elevation.goblin", "history.autumn", "chapel.goblin"):
        shutil.copy(FIXTURES / "v1" / name, tmp_path / name)
    with serve(tmp_path) as server:
        tokens = []
        for _ in range(2):
            # (A recently opened file is not opened again, hence another name.)
            ds = spinney.open(f"{server.url}/elevation.goblin?{len(tokens)}")
            ds.check_unchanged()
            server.counts()
            ds.check_unchanged()
            assert server.counts() == {"batches": 1, "requests": 1, "bytes": 1}
            tokens.append(str(ds._versions()))
            assert dask.tokenize(ds) == dask.tokenize(pickle.loads(pickle.dumps(ds)))
            shutil.copy(FIXTURES / "v1" / "rgba.goblin", tmp_path / "new")
            os.replace(tmp_path / "new", tmp_path / "elevation.goblin")
            with pytest.raises(OSError, match="overwritten"):
                ds.check_unchanged()
            os.utime(tmp_path / "elevation.goblin", (1, 1))
        assert len(set(tokens)) == 2
        autumn, model = spinney.open(f"{server.url}/history.autumn"), spinney.open_brep(f"{server.url}/chapel.goblin")
        view = spinney.open(f"{server.url}/history.autumn", view="rotate=90")
        for opened in (autumn, model, view):
            opened.check_unchanged()
        for name in ("history.autumn", "chapel.goblin"):
            os.utime(tmp_path / name, (5, 5))
        for opened in (autumn, model, view):
            with pytest.raises(OSError, match="overwritten"):
                opened.check_unchanged()
        os.remove(tmp_path / "elevation.goblin")
        with pytest.raises(OSError):
            ds.check_unchanged()
