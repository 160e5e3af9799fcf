"""Layers as axes of xarray: times and bands, lazily, and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import noise

import spinney
from spinney._times import group_of, short_of, text_of_time, time_of_text

xr = pytest.importorskip("xarray")
pytest.importorskip("dask")

TIMES = np.array(["2024-02-01T00:00:00.5", "2024-01-05", "2024-01-15T10:20:30"], "M8[ns]")


def series(dtype: str = "float32", name: str | None = "ndvi", times: np.ndarray = TIMES) -> xr.DataArray:
    cells = np.stack([noise((60, 70), dtype, seed) for seed in range(len(times))])
    if cells.dtype.kind == "f":
        cells[1, 20:30, 5:60] = np.nan
    axes = {"time": times, "y": 600 - 10 * (np.arange(60) + 0.5), "x": 10 * (np.arange(70) + 0.5)}
    return xr.DataArray(cells, axes, ("time", "y", "x"), name)


@pytest.mark.parametrize("ending", ["goblin", "autumn"])
@pytest.mark.parametrize("name", ["ndvi", None, "band_data"])
def test_times_are_an_axis(tmp_path: Path, name: str | None, ending: str) -> None:
    path, given = tmp_path / f"t.{ending}", series(name=name)
    given.attrs = {"units": "1", "source": "a satellite"}
    spinney.build(given, path, crs="EPSG:32628")
    prefix = "ndvi_" if name == "ndvi" else ""
    with spinney.open(path) as ds:
        assert ds.names == [f"{prefix}{time}" for time in ("20240201T000000_5", "20240105", "20240115T102030")]
        assert [ds[each].time for each in ds.names] == ["2024-02-01T00:00:00.5Z", "2024-01-05T00:00:00Z", "2024-01-15T10:20:30Z"]
        assert ds.units == ("1",) and ds.tags["source"] == "a satellite"
    with xr.open_dataset(path, engine="spinney") as found:
        array = found[name or "band_data"]
        assert list(found.data_vars) == [name or "band_data"] and array.dims == ("time", "y", "x")
        # Sorted by time, whatever the order of layers.
        xr.testing.assert_equal(array.drop_vars("spatial_ref").rename(None), given.sortby("time").rename(None))
        assert array.attrs["units"] == "1" and found.time.dtype == "M8[ns]"
        spinney.build(array, tmp_path / "again.goblin")
    with xr.open_dataset(path, engine="spinney") as one, xr.open_dataset(tmp_path / "again.goblin", engine="spinney") as other:
        xr.testing.assert_identical(one.load(), other.load())


def test_reading_one_time_reads_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, given = tmp_path / "t.goblin", series("uint8")
    spinney.build(given, path)
    given = given.sortby("time")
    read_layers: list[str] = []
    at_index = spinney.Dataset._at_index

    def noted(self: spinney.Dataset, level: int | None, key: object) -> object:
        read_layers.append(self.layer)
        return at_index(self, level, key)

    monkeypatch.setattr(spinney.Dataset, "_at_index", noted)
    for chunks in (None, {}):
        with xr.open_dataset(path, engine="spinney", mask_and_scale=False, chunks=chunks) as ds:
            assert read_layers == []
            one = ds.ndvi.isel(time=1).isel(y=slice(3, 40, 5), x=[1, 60, 7])
            assert np.array_equal(one.values, given.values[1, 3:40:5][:, [1, 60, 7]]) and set(read_layers) == {"ndvi_20240115T102030"}
            read_layers.clear()
            assert np.array_equal(ds.ndvi.isel(time=slice(None, None, -2), y=5).values, given.values[::-2, 5]) and len(set(read_layers)) == 2
            assert ds.ndvi.isel(time=slice(0, 0), x=3).values.shape == (0, 60)
            if chunks is not None:
                assert ds.ndvi.chunks == ((1, 1, 1), (60,), (70,))
        read_layers.clear()


def test_several_variables_share_the_axis(tmp_path: Path) -> None:
    path = tmp_path / "t.goblin"
    ndvi, counts = series(), series("int16", "counts")
    ground = ndvi.isel(time=1, drop=True) * 3
    given = xr.Dataset({"ndvi": ndvi, "counts": counts, "ground": ground})
    spinney.build(given, path)
    with spinney.open(path) as ds:
        assert len(ds.names) == 7 and ds["ground"].time is None
    wanted = given.sortby("time")
    with xr.open_dataset(path, engine="spinney", mask_and_scale=False) as found:
        assert {name: array.dims for name, array in found.data_vars.items()} == {"ndvi": ("time", "y", "x"), "counts": ("time", "y", "x"), "ground": ("y", "x")}
        xr.testing.assert_equal(found.drop_vars("spatial_ref").load(), wanted)
    with xr.open_dataset(path, engine="spinney", layers="variable") as found:
        assert len(found.data_vars) == 7 and found["ndvi_20240105"].attrs["time"] == "2024-01-05T00:00:00Z"
    with xr.open_datatree(path, engine="spinney") as levels:
        with spinney.open(path, layer="ndvi_20240115T102030") as ds:
            assert np.array_equal(levels["4/ndvi"].isel(time=1), ds.read(1, level=4), equal_nan=True)


def test_layers_without_a_common_axis_stay_separate(tmp_path: Path) -> None:
    path = tmp_path / "t.goblin"
    cells = series("uint8", None)
    first, second, third = (cells.isel(time=number, drop=True) for number in range(3))
    at = {name: np.datetime64(time, "ns") for name, time in (("a", "2024-01-05"), ("b", "2024-02-05"))}
    for parts in (
        {"a": first.assign_coords(time=at["a"]), "b": second.assign_coords(time=at["b"])},  # other names
        {"x_20240105": first.assign_coords(time=at["a"]), "x_20240205": second.astype("i2").assign_coords(time=at["b"])},  # other types
        {"x_20240105": first.assign_coords(time=at["a"]), "x_20240205": second.assign_coords(time=at["b"]).assign_attrs(units="m")},
        {"x_20240105": first.assign_coords(time=at["a"]), "x": second.assign_coords(time=at["b"])} | {"y_20240105": third.assign_coords(time=at["a"])},
        {"time": first.assign_coords(time=at["a"]), "b": second.assign_coords(time=at["b"])},
    ):
        spinney.build(parts, path)
        with xr.open_dataset(path, engine="spinney", mask_and_scale=False) as ds:
            # (Axes already have the names `x` and `time`.)
            called = {name: f"{name}_" if name in ("x", "time") else name for name in parts}
            assert set(ds.data_vars) == set(called.values()) and "time" not in ds.dims
            for name, part in parts.items():
                assert ds[called[name]].dims == ("y", "x") and np.array_equal(ds[called[name]], part), name
                assert ds[called[name]].attrs["time"].startswith("2024-0")
        with pytest.raises(ValueError, match="times"):
            xr.open_dataset(path, engine="spinney", layers="time")
    # Bands of one time.
    spinney.build({"a": first.assign_coords(time=at["a"]), "b": second.assign_coords(time=at["a"])}, path)
    with xr.open_dataset(path, engine="spinney", mask_and_scale=False) as ds:
        assert ds.a.dims == ds.b.dims == ("y", "x") and ds.a.attrs["time"] == "2024-01-05T00:00:00Z"
    with xr.open_dataset(path, engine="spinney", mask_and_scale=False, layers="time") as ds:
        assert ds.a.dims == ds.b.dims == ("time", "y", "x") and np.array_equal(ds.b[0], second)
    # A single layer with a time.
    spinney.build(first.assign_coords(time=at["a"]), path)
    with spinney.open(path) as tree:
        assert tree.time == "2024-01-05T00:00:00Z" and tree.tags == {}
    with xr.open_dataset(path, engine="spinney", mask_and_scale=False) as ds:
        assert ds.band_data.dims == ("band", "y", "x") and ds.time.values == at["a"]
    with xr.open_dataset(path, engine="spinney", mask_and_scale=False, layers="time") as ds:
        assert ds.band_data.dims == ("time", "y", "x") and ds.time.values == [at["a"]] and np.array_equal(ds.band_data[0], first)


def test_void_is_one_number_along_an_axis(tmp_path: Path) -> None:
    path = tmp_path / "t.goblin"
    cells = np.stack([noise((40, 40), "uint8", seed) for seed in range(3)])
    cells[0, 0, :2], cells[1, 0, :2] = (0, 200), (7, 255)
    masks = np.zeros(cells.shape, bool)
    masks[1, 5:9], masks[2, 2:30, 3] = True, True
    parts = {f"t{number}": np.ma.array(each, mask=mask) for number, (each, mask) in enumerate(zip(cells, masks))}
    spinney.build(parts, path, nodata={"t0": 3})
    masks[0] = cells[0] == 3
    for mask_and_scale in (None, False):
        with xr.open_dataset(path, engine="spinney", layers="band", mask_and_scale=mask_and_scale) as ds:
            data = ds.band_data
            assert data.band.values.tolist() == ["t0", "t1", "t2"]
            hidden = np.isnan(data.values) if mask_and_scale is None else data.values == data.attrs["_FillValue"]
            assert np.array_equal(hidden, masks) and np.array_equal(data.values[~masks], cells[~masks])
            assert data.sel(band="t1").values.shape == (40, 40)
    with xr.open_dataset(path, engine="spinney", layers="band", mask_and_scale=False) as ds:
        spinney.build(ds.band_data, tmp_path / "again.goblin", stack=True)
    with spinney.open(tmp_path / "again.goblin") as ds:
        assert ds.names == ["t0", "t1", "t2"] and ds.dtype == np.uint8
        for name, each, mask in zip(ds.names, cells, masks):
            found = ds[name].read(masked=True)[0]
            assert np.array_equal(found.mask, mask) and np.array_equal(found.compressed(), each[~mask])
    spinney.build({"a": cells[0], "b": cells[1].astype("i2")}, path)
    with pytest.raises(ValueError, match="`b` has 40 x 40 cells of 1 x int16"):
        xr.open_dataset(path, engine="spinney", layers="band")
    with pytest.raises(ValueError, match="layers"):
        xr.open_dataset(path, engine="spinney", layers="rows")
    with pytest.raises(ValueError, match="one layer"):
        xr.open_dataset(path, engine="spinney", layers="band", layer="a")


def test_closing_closes_all(tmp_path: Path) -> None:
    path = tmp_path / "t.goblin"
    spinney.build(series("uint8"), path)
    ds = xr.open_dataset(path, engine="spinney")
    ds.close()
    with pytest.raises(ValueError, match="closed"):
        ds.ndvi.isel(time=2).values


def test_axes_of_data_arrays_that_are_no_times(tmp_path: Path) -> None:
    given = series("uint8")
    for wrong, text in ((given.assign_coords(time=[1, 2, 3]), "datetime64"), (given.drop_vars("time"), "none"), (given.assign_coords(time=[TIMES[0], TIMES[1], np.datetime64("NaT", "ns")]), "NaT")):
        with pytest.raises(ValueError, match=text):
            spinney.build(wrong, tmp_path / "t.goblin")
    with pytest.raises(ValueError, match="another grid"):
        spinney.build({"a": given[0].drop_vars("time"), "b": given[1].drop_vars("time").assign_coords(x=given.x + 4)}, tmp_path / "t.goblin")
    # Cells twice as large have other coordinates.
    coarse = given[0].drop_vars("time").coarsen(y=2, x=2).max()
    spinney.build({"a": given[1].drop_vars("time"), "b": coarse[:20]}, tmp_path / "t.goblin")
    with spinney.open(tmp_path / "t.goblin") as ds:
        assert ds["b"].depth == ds.depth - 1 and np.array_equal(ds["b"][...], coarse[:20])
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney", mask_and_scale=False) as found:
        assert np.array_equal(found.b, coarse[:20]) and np.array_equal(found.y_b, coarse.y[:20])


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ("2024", "2024-01-01"),
        ("2024-05", "2024-05-01"),
        ("2024-05-06", "2024-05-06"),
        ("20240506", "2024-05-06"),
        ("2024-05-06T07:08:09Z", "2024-05-06T07:08:09"),
        ("2024-05-06T07:08:09.123456789Z", "2024-05-06T07:08:09.123456789"),
        ("2024-05-06T07:08:09,5+02:00", "2024-05-06T05:08:09.5"),
        ("2024-05-06 07:08", "2024-05-06T07:08"),
        ("12 o'clock", None),
        ("", None),
        ("0001-01-01", None),
        ("9999-12-31T23:59:59Z", None),
        ("2024-05-06T07:08:09+99:99", None),
        (None, None),
    ],
)
def test_times_from_strings(text: str | None, time: str | None) -> None:
    found = time_of_text(text)
    assert found == (None if time is None else np.datetime64(time, "ns"))
    if found is not None:
        assert time_of_text(text_of_time(found)) == found


def test_names_without_their_times() -> None:
    for name, text, group in [
        ("ndvi_20240105", "2024-01-05T00:00:00Z", "ndvi"),
        ("2024-01-05 B04", "2024-01-05", "B04"),
        ("S2_20240105T101112_B04", "2024-01-05T10:11:12Z", "S2_B04"),
        ("20240105T101112Z", "2024-01-05T10:11:12Z", ""),
        ("B04", "2024-01-05", "B04"),
    ]:
        assert group_of(name, text) == group
    assert short_of("2024-01-05T00:00:00Z") == "20240105"
