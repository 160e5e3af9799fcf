"""Integers of 8 and of 64 bits: exact to the last digit, with NumPy as the reference."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
import xarray
from conftest import run

import spinney

BASE = {"uint64": 2**63 + 3, "int64": -(2**62) - 3, "int8": -125}
"""Numbers that floats do not distinguish from their neighbours (except for int8)."""


def cells(dtype: str, size: tuple[int, ...] = (70, 90), spread: int = 200, seed: int = 1) -> np.ndarray:
    offsets = np.random.default_rng(seed).integers(0, spread, size)
    return (offsets.astype(object) + BASE[dtype]).astype(dtype)


@pytest.mark.parametrize("dtype", BASE)
def test_arrays_come_back(tmp_path: Path, dtype: str) -> None:
    array, path = cells(dtype), tmp_path / "a.goblin"
    hole = array[3, 4]
    spinney.build(array, path, nodata=hole)
    with spinney.open(path) as ds:
        assert ds.dtype == dtype and ds.nodata == int(hole) and isinstance(ds.nodata, int)
        # A number that coarser levels may have is not used for VOID.
        bounds = np.delete(array, np.flatnonzero(array == hole))
        is_free = not int(bounds.min()) <= int(hole) <= int(bounds.max())
        assert isinstance(ds.fill_value, int) and (ds.fill_value == int(hole)) == is_free
        filled = np.where(array == hole, np.array(ds.fill_value, dtype), array)
        assert np.array_equal(ds[...], filled)
        read = ds.read(1, masked=True)
        assert np.array_equal(read.mask, array == hole) and np.array_equal(read.data, filled)
        other = int(np.iinfo(dtype).max) - 1
        filled = ds.read(1, fill=other)
        assert filled.dtype == dtype and np.array_equal(filled, np.where(array == hole, np.array(other, dtype), array))
        ys, xs = np.divmod(np.arange(500) * 7 % array.size, array.shape[1])
        points = np.stack([xs, ys], axis=1) + 0.5
        found = ds.sample(points, coordinates="cells")
        found = np.asarray(found).reshape(-1)
        assert found.dtype == dtype and np.array_equal(found, np.where(array == hole, np.array(ds.fill_value, dtype), array)[ys, xs])
        valid = array[array != hole]
        stats = ds.stats()
        assert (stats.min, stats.max) == (int(valid.min()), int(valid.max())) and isinstance(stats.min, int)
        exact = sum(map(int, valid.ravel())) / valid.size
        assert stats.mean == pytest.approx(exact, rel=1e-15)
        # Each level is the mean of all cells below, rounded half up once.
        level = ds.level(ds.depth - 3)[...]
        for row, column in [(0, 0), (2, 5), (8, 11)]:
            below = [int(n) for n in array[8 * row : 8 * row + 8, 8 * column : 8 * column + 8].ravel() if n != hole]
            assert int(level[row, column]) == (2 * sum(below) + len(below)) // (2 * len(below))


@pytest.mark.parametrize("dtype", ["uint64", "int64"])
def test_searches_distinguish_neighbouring_integers(tmp_path: Path, dtype: str) -> None:
    array, path = cells(dtype, spread=5), tmp_path / "a.goblin"
    spinney.build(array, path, kind="categorical", categories={BASE[dtype]: "base", BASE[dtype] + 1: "next"})
    wanted = BASE[dtype] + 1
    with spinney.open(path) as ds:
        assert ds.categories == {BASE[dtype]: "base", wanted: "next"}
        counts = ds.stats().classes
        values, cells_of = np.unique(array, return_counts=True)
        assert counts == dict(zip(map(int, values), map(int, cells_of)))
        for condition, mask in [({"value": wanted}, array == wanted), ({"above": wanted}, array > wanted), ({"below": wanted}, array < wanted)]:
            blocks = ds.find(**condition)
            found = np.zeros(array.shape, bool)
            for (x, y, width, height), value, is_mixed in zip(blocks.boxes, blocks.values.data, np.ma.getmaskarray(blocks.values)):
                found[y : y + height, x : x + width] = True
                assert is_mixed or (array[y : y + height, x : x + width] == value).all()
            assert np.array_equal(found, mask)
            assert blocks.values.dtype == dtype
        zone = {"type": "Polygon", "coordinates": [[[0, 0], [90, 0], [90, 70], [0, 70], [0, 0]]]}
        (zoned,) = ds.zonal(zone, crs="world")
        assert zoned.min == int(values[0]) and zoned.max == int(values[-1]) and zoned.classes == counts


@pytest.mark.parametrize("dtype", ["uint64", "int64"])
def test_edits_have_all_digits(tmp_path: Path, dtype: str) -> None:
    array, path = cells(dtype), tmp_path / "a.autumn"
    spinney.build(array, path)
    number = BASE[dtype] + 1001
    with spinney.edit(path) as edit:
        edit.fill(number, window=(1, 2, 3, 4))
        edit.set([(50, 60), (51, 60)], [number + 1, number + 2])
        edit.set([(52, 60)], np.array([number + 3], dtype))
        edit[10:12, 20:22] = np.array([[number + 4, number + 5], [number + 6, number + 7]], dtype)
    array[2:6, 1:4] = number
    array[60, 50:53] = [number + 1, number + 2, number + 3]
    array[10:12, 20:22] = np.array([[number + 4, number + 5], [number + 6, number + 7]], dtype)
    with spinney.open(path) as ds:
        assert np.array_equal(ds[...], array)
    for wrong in (2**64, -(2**63) - 1, 0.5):
        with pytest.raises(ValueError, match=dtype[0]), spinney.edit(path) as edit:
            edit.fill(wrong, window=(0, 0, 1, 1))


@pytest.mark.parametrize("dtype", ["uint64", "int64"])
def test_files_are_those_of_rasterio(tmp_path: Path, dtype: str) -> None:
    array, path = cells(dtype), tmp_path / "a.tif"
    # (Rasterio writes the nodata number rounded to a float; the last digit is patched afterwards.)
    near = -(2**53) if dtype == "int64" else 2**53
    array[0, 0] = near + (near > 0) - (near < 0)
    profile = {"driver": "GTiff", "height": 70, "width": 90, "count": 1, "dtype": dtype, "nodata": near}
    with rasterio.open(path, "w", **profile) as file:
        file.write(array, 1)
    spinney.build(path, tmp_path / "near.goblin")
    with spinney.open(tmp_path / "near.goblin") as ds:
        assert ds.nodata == near and isinstance(ds.nodata, int)
    written = path.read_bytes()
    assert written.count(b"%d" % near) == 1
    path.write_bytes(written.replace(b"%d" % near, b"%d" % int(array[0, 0])))
    spinney.build(path, tmp_path / "a.goblin")
    with spinney.open(tmp_path / "a.goblin") as ds:
        assert ds.dtype == dtype and np.array_equal(ds[...], array) and ds.nodata == int(array[0, 0])
        ds.save(tmp_path / "b.tif")
        ds.save(tmp_path / "b.npy")
        ds.export(tmp_path / "c.tif")
    for name in ("b.tif", "c.tif"):
        with rasterio.open(tmp_path / name) as file:
            assert file.dtypes == (dtype,) and np.array_equal(file.read(1), array), name
    assert np.array_equal(np.load(tmp_path / "b.npy").reshape(array.shape), array)
    made = spinney.open(tmp_path / "a.goblin")
    # (Numbers with VOID become floats with NaN, as in xarray's decoding.)
    assert xarray.open_dataset(made.path, engine="spinney").band_data.dtype == "float64"
    again = xarray.open_dataset(made.path, engine="spinney", mask_and_scale=False).band_data
    assert again.dtype == dtype and np.array_equal(again.to_numpy()[0], array)
    assert int(again.attrs["_FillValue"]) == int(array[0, 0])
    spinney.build(again, tmp_path / "x.goblin")
    with spinney.open(tmp_path / "x.goblin") as ds:
        assert ds.dtype == dtype and np.array_equal(ds[...], array) and ds.nodata == int(array[0, 0])


def test_numbers_with_exponents_are_integers(tmp_path: Path) -> None:
    # (Rasterio writes 2^63 as 9.2233720368547758e+18.)
    array = np.full((4, 5), 2**63, "uint64")
    array[1, 2] = 2**63 + 1
    with rasterio.open(tmp_path / "a.tif", "w", driver="GTiff", height=4, width=5, count=1, dtype="uint64", nodata=2**63) as file:
        file.write(array, 1)
    assert b"e+18" in (tmp_path / "a.tif").read_bytes()
    spinney.build(tmp_path / "a.tif", tmp_path / "a.goblin")
    with spinney.open(tmp_path / "a.goblin") as ds:
        assert ds.nodata == 2**63 and isinstance(ds.nodata, int) and isinstance(ds.fill_value, int)
        assert ds.stats().cells == 1 and ds.stats().min == 2**63 + 1


def test_octrees_and_numpy_files(tmp_path: Path) -> None:
    array = cells("uint64", (20, 30, 40))
    np.save(tmp_path / "a.npy", array)
    spinney.build(tmp_path / "a.npy", tmp_path / "a.goblin", nodata=int(array[1, 2, 3]))
    with spinney.open(tmp_path / "a.goblin") as ds:
        assert ds.dtype == "uint64" and ds.nodata == int(array[1, 2, 3])
        assert np.array_equal(ds.read(1, masked=True).mask, array == array[1, 2, 3])
        assert np.array_equal(ds[...], array)


@pytest.mark.parametrize("dtype", ["uint64", "int64"])
@pytest.mark.parametrize("ending", ["goblin", "autumn"])
def test_all_interfaces_keep_all_digits(tmp_path: Path, program: str, dtype: str, ending: str) -> None:
    """A layer of a stack, in all functions with numbers: neighbours that floats do not distinguish,
    and VOID that is one of them.
    """
    array, path = cells(dtype, (70, 90), 4), tmp_path / f"s.{ending}"
    base, void = BASE[dtype], BASE[dtype] + 3
    names = {base: "the one", base + 1: "its neighbour"}
    spinney.build({"grey": array.astype("u1"), "id": array}, path, nodata={"id": void}, kind={"id": "categorical"}, categories={"id": names})
    valid = array != array.dtype.type(void)
    with spinney.open(path, layer="id") as ds:
        assert ds.nodata == void and ds.fill_value == void and ds.categories == names
        assert np.array_equal(ds[...], array) and np.array_equal(ds[5:60:7, ::-3], array[5:60:7, ::-3]) and int(ds[6, 7]) == int(array[6, 7])
        out = np.zeros((1, 20, 30), dtype)
        assert ds.read(window=(3, 4, 30, 20), out=out) is out and np.array_equal(out[0], array[4:24, 3:33])
        assert np.array_equal(ds.read(1, window=(-2, -2, 5, 5), boundless=True, fill=void - 1)[2:, 2:], np.where(valid, array, np.array(void - 1, dtype))[:3, :3])
        assert np.array_equal(np.from_dlpack(ds), array)
        mapped = ds.mapped((0, 0, 64, 64))
        assert mapped is None or np.array_equal(np.asarray(mapped)[..., :], array[:64, :64])
        # Coarser cells are existing classes.
        coarse = ds.read(1, level=3, masked=True)
        assert set(np.unique(coarse.compressed()).tolist()) <= set(np.unique(array[valid]).tolist())
        ys, xs = np.divmod(np.arange(0, array.size, 37), array.shape[1])
        positions = np.stack([xs, ys], axis=1) + 0.5
        assert np.array_equal(ds.sample(positions, coordinates="cells", bands=1), array[ys, xs])
        sampled = ds.sample(positions, coordinates="cells", bands=1, masked=True)
        assert np.array_equal(np.ma.getmaskarray(sampled), ~valid[ys, xs])
        classes, counts = np.unique(array[valid], return_counts=True)
        counted = dict(zip(classes.tolist(), counts.tolist()))
        stats = ds.stats((10, 20, 30, 40))
        inside = array[20:60, 10:40][valid[20:60, 10:40]]
        assert stats.classes == dict(zip(*(found.tolist() for found in np.unique(inside, return_counts=True)))) and stats.min == int(inside.min())
        assert ds.stats().classes == counted
        zone = {"type": "Polygon", "coordinates": [[[10, 20], [40, 20], [40, 60], [10, 60], [10, 20]]]}
        for edge in ("centre", "area"):
            (found,) = ds.zonal(zone, edge=edge, crs="world")  # type: ignore[arg-type]
            assert found.classes == stats.classes and (found.min, found.max) == (stats.min, stats.max)
            assert all(isinstance(number, int) for number in found.classes)
        (named,) = ds.zonal(zone, ["min", "max", "classes"], crs="world")
        assert (named["min"], named["max"], named["classes"]) == (stats.min, stats.max, stats.classes)
        blocks = ds.find(base + 1)
        assert len(blocks) and set(blocks.values.compressed().tolist()) == {base + 1}
        assert sum(int(width * height) for _, _, width, height in blocks.boxes) == counted[base + 1]
    # JSON, from the program and from Python.
    said = json.loads(run(program, "stats", f"{path}:id", "--json"))
    listed = {entry["value"]: entry["cells"] for entry in said["classes"]}
    assert listed == counted and all(isinstance(number, int) for number in listed)
    assert json.loads(json.dumps(stats.classes)) == {str(number): cells_of for number, cells_of in stats.classes.items()}
    assert run(program, "point", f"{path}:id", "--in", "cells", "7,6").strip() == (str(int(array[6, 7])) if valid[6, 7] else "void")
    lines = [json.loads(line) for line in run(program, "find", f"{path}:id", "--class", base + 1, "--json").splitlines()]
    assert len(lines) == len(blocks) and {line["value"] for line in lines} == {base + 1}
    # From file to file.
    copy = tmp_path / "copy.goblin"
    spinney.convert(f"{path}:id", copy)
    spinney.transform(f"{path}:id", ["window=10,20,30,40"], tmp_path / "part.goblin")
    with spinney.open(copy) as ds, spinney.open(tmp_path / "part.goblin") as part:
        assert np.array_equal(ds[...], array) and np.array_equal(part[...], array[20:60, 10:40])
    spinney.combine("max", [copy, tmp_path / "part.goblin"], tmp_path / "most.goblin")
    with spinney.open(tmp_path / "most.goblin") as ds:
        # (Only where both have values.)
        assert np.array_equal(ds.read(1, masked=True).compressed(), inside)
    pairs = {(a[0], b[0]): count for a, b, count in spinney.cross(copy, copy) if a is not None and b is not None}
    assert pairs == {(number, number): count for number, count in counted.items()}
    with xarray.open_dataset(path, engine="spinney") as ds:
        assert ds.id.dtype == dtype and np.array_equal(ds.id, array) and int(ds.id.attrs["_FillValue"]) == void
        assert ds.id.attrs["flag_values"].tolist() == list(names)
    # An edit of one layer.
    if ending == "autumn":
        before = array.copy()
        with spinney.edit(f"{path}:id") as edit:
            edit.set([(7, 6), (8, 6)], [base, base + 2])
            edit.fill(base + 1, window=(20, 30, 5, 5))
            edit.fill(None, window=(50, 50, 2, 2))
            edit[0:2, 0:2] = np.full((2, 2), base + 2, dtype)
        before[6, 7:9] = [base, base + 2]
        before[30:35, 20:25], before[50:52, 50:52], before[0:2, 0:2] = base + 1, void, base + 2
        with spinney.open(path) as ds:
            assert np.array_equal(ds["id"][...], before) and np.array_equal(ds["grey"][...], array.astype("u1"))
        difference = spinney.diff(f"{path}@1:id", f"{path}:id")
        assert difference.changed + difference.added + difference.removed == int((array != before).sum())
