"""xarray: lazily, with coordinates, coordinate systems and classes, under Dask's threads and
processes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import FIXTURES, noise

import spinney

xr = pytest.importorskip("xarray")
pytest.importorskip("dask")
rioxarray = pytest.importorskip("rioxarray")


@pytest.mark.parametrize("name", ["island_classes", "island_elevation", "island_rgb"])
def test_datasets_are_those_of_rioxarray(name: str, tmp_path: Path) -> None:
    source = FIXTURES / (f"{name}.png" if name == "island_rgb" else f"{name}.tif")
    spinney.build(source, tmp_path / "t.goblin")
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney", mask_and_scale=False) as ours:
        with rioxarray.open_rasterio(source) as theirs:
            data = ours.band_data
            assert data.dims == theirs.dims and data.dtype == theirs.dtype
            assert np.array_equal(data.values, theirs.values, equal_nan=data.dtype.kind == "f")
            if theirs.rio.crs is not None:
                assert np.allclose(data.x, theirs.x) and np.allclose(data.y, theirs.y)
                assert data.rio.crs == theirs.rio.crs
                assert data.rio.transform() == theirs.rio.transform()
            assert data.rio.nodata == theirs.rio.nodata or name == "island_rgb"


def test_void_becomes_nan(relief: str) -> None:
    with xr.open_dataset(relief, engine="spinney") as ds, spinney.open(relief) as tree:
        masked = tree.read(masked=True)
        assert np.array_equal(np.isnan(ds.band_data.values), masked.mask)
        assert np.array_equal(ds.band_data.values[~masked.mask], masked.compressed())


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])
def test_integers_of_all_widths_are_masked_and_scaled(tmp_path: Path, dtype: str) -> None:
    array = np.array([[1, 2, 3], [4, 5, 100]], dtype)
    path = tmp_path / "t.goblin"
    spinney.build(array, path, kind="continuous", nodata=100, scales=[0.5])
    with xr.open_dataset(path, engine="spinney") as ds:
        data = ds.band_data
        assert data.dtype.kind == "f" and (data.dtype == np.float64 or np.dtype(dtype).itemsize < 4)
        assert float(data.mean()) == 1.5 and int(np.isnan(data).sum()) == 1
    with xr.open_dataset(path, engine="spinney", mask_and_scale=False) as ds:
        data = ds.band_data
        assert data.dtype == np.dtype(dtype) and data.attrs["scale_factor"] == 0.5
        assert np.array_equal(data.values[0], array) and data.attrs["_FillValue"] == 100


def test_values_that_equal_nodata_stay_values(tmp_path: Path) -> None:
    # The mean of -10 and 10 is the nodata number.
    array = np.tile(np.array([[-10, 10], [10, -10]], "i2"), (4, 4))
    array[0, 0] = 0
    path = tmp_path / "t.goblin"
    spinney.build(array, path, kind="continuous", nodata=0)
    with spinney.open(path) as ds:
        assert ds.fill_value == np.iinfo("i2").min
        assert (ds.read(1, level=ds.depth - 1) == 0).sum() == 15
        with pytest.raises(ValueError, match="within the values"):
            ds.save(tmp_path / "a.tif", nodata=0)
    with xr.open_dataset(path, engine="spinney", level=2) as found:
        assert int((found.band_data == 0).sum()) == 15


def test_arrays_without_a_free_number_are_masked(tmp_path: Path) -> None:
    array = np.ma.masked_array(np.arange(272, dtype="u2").astype("u1").reshape(16, 17), False)
    array[0, 0] = np.ma.masked
    path = tmp_path / "t.goblin"
    spinney.build(array, path, kind="continuous")
    with spinney.open(path) as ds:
        with pytest.raises(ValueError, match="masked=True"):
            ds.read(1)
        assert ds.read(1, masked=True).mask.sum() == 1 and ds.read(1, fill=7)[0, 0] == 7
        with pytest.raises(ValueError, match="every number of type u8 is a value"):
            ds.save(tmp_path / "a.npy")


def test_classes_have_names(tmp_path: Path) -> None:
    array = np.array([[1, 2], [2, 3]], "u1")
    path = tmp_path / "t.goblin"
    spinney.build(array, path, categories={1: "water", 2: "open land", 3: "rock"}, crs="EPSG:32628", transform=(2, 0, 5, 0, -2, 9))
    with xr.open_dataset(path) as ds:
        attrs = ds.band_data.attrs
        assert attrs["flag_values"].tolist() == [1, 2, 3] and attrs["flag_meanings"] == "water open_land rock"
        assert ds.band_data.dtype == np.uint8
        assert ds.x.values.tolist() == [6, 8] and ds.y.values.tolist() == [8, 6]


def test_levels_are_a_tree(island: str) -> None:
    from spinney.xarray import open_levels

    with spinney.open(island) as ds:
        for tree in (open_levels(island), xr.open_datatree(island, engine="spinney")):
            assert sorted(tree.children, key=int) == [str(level) for level in range(ds.levels)]
            for level in (0, 3, 8):
                assert np.array_equal(tree[f"{level}/band_data"].values, ds.read(level=level))
            width = float(tree["7"].x[1] - tree["7"].x[0])
            assert width == 100
            tree.close()


@pytest.mark.parametrize("scheduler", ["threads", "processes", "synchronous"])
def test_dask(tmp_path: Path, scheduler: str) -> None:
    import dask

    array = np.stack([noise((1500, 1300), "uint16", seed) for seed in (1, 2)])
    path = tmp_path / "t.goblin"
    spinney.build(array, path)
    with xr.open_dataset(path, engine="spinney", chunks={}) as ds:
        assert ds.band_data.chunks == ((2,), (1024, 476), (1024, 276))
        with dask.config.set(scheduler=scheduler, num_workers=2):
            assert int(ds.band_data.astype("i8").sum()) == int(array.astype("i8").sum())
            found = ds.band_data.isel(band=1, y=slice(3, 1400, 7), x=[5, 9, 1200]).values
    assert np.array_equal(found, array[1, 3:1400:7][:, [5, 9, 1200]])


def test_octrees_and_coarser_levels(tmp_path: Path) -> None:
    array = noise((40, 30, 20), "uint8")
    path = tmp_path / "t.goblin"
    spinney.build(array, path, dims="zyx")
    with xr.open_dataset(path, engine="spinney") as ds:
        assert ds.band_data.dims == ("band", "z", "y", "x") and np.array_equal(ds.band_data[0], array)
        assert ds.z.values[:2].tolist() == [0.5, 1.5]
    with xr.open_dataset(path, engine="spinney", level=3) as ds, spinney.open(path) as tree:
        assert np.array_equal(ds.band_data[0], tree.read(1, level=3))


def test_round_trips(island: str, relief: str, tmp_path: Path) -> None:
    import dask

    solid = tmp_path / "solid.goblin"
    spinney.build(noise((20, 30, 40), "uint16"), solid, dims="zyx", transform=np.diag([2.0, 3.0, -4.0, 1.0])[:3])
    for path in (island, relief, str(solid)):
        for chunks in (None, {}):
            with xr.open_dataset(path, engine="spinney", mask_and_scale=False, chunks=chunks) as ds:
                with dask.config.set(scheduler="threads"):
                    spinney.build(ds.band_data, tmp_path / "again.goblin")
            with spinney.open(path) as ours, spinney.open(tmp_path / "again.goblin") as again:
                assert np.array_equal(ours[...], again[...], equal_nan=ours.dtype.kind == "f")
                assert (ours.transform, ours.nodata, ours.crs) == (again.transform, again.nodata, again.crs)
                assert np.allclose(ours.matrix, again.matrix) and ours.stats().cells == again.stats().cells
    with rioxarray.open_rasterio(FIXTURES / "island_elevation.tif") as array:
        spinney.build(array, tmp_path / "rio.goblin")
    with spinney.open(relief) as ours, spinney.open(tmp_path / "rio.goblin") as other:
        assert np.array_equal(ours[...], other[...], equal_nan=True) and ours.crs == other.crs
    with pytest.raises(ValueError, match="axis"):
        spinney.build(xr.DataArray(np.ones((3, 3), "u1"), dims=("a", "b")), tmp_path / "x.goblin")
    with pytest.raises(ValueError, match="evenly"):
        spinney.build(xr.DataArray(np.ones((1, 3), "u1"), {"y": [1], "x": [1, 2, 4]}, ("y", "x")), tmp_path / "x.goblin")


def keys_of_nsidc(path: Path) -> None:
    """Writes a TIFF whose coordinate system its keys define by parameters: polar stereographic on
    an unnamed ellipsoid.
    """
    rasterio = pytest.importorskip("rasterio")
    crs = rasterio.CRS.from_user_input("+proj=stere +lat_0=-90 +lat_ts=-70 +a=6378273 +rf=298.279411123064")
    transform = rasterio.Affine(25000, 0, -3950000, 0, -25000, 4350000)
    with rasterio.open(path, "w", "GTiff", 5, 4, 1, crs, transform, "uint8") as file:
        file.write(np.arange(20, dtype="u1").reshape(1, 4, 5))


def test_systems_without_a_number_reach_xarray(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    keys_of_nsidc(tmp_path / "t.tif")
    spinney.build(tmp_path / "t.tif", tmp_path / "t.goblin")
    with spinney.open(tmp_path / "t.goblin") as ds:
        assert ds.crs is not None and ds.crs.startswith("PROJCRS[")
        place = pyproj.Transformer.from_crs("EPSG:4326", ds.crs, always_xy=True).transform(10, -80)
    with rioxarray.open_rasterio(tmp_path / "t.tif") as theirs, xr.open_dataset(tmp_path / "t.goblin", engine="spinney") as ours:
        expected = pyproj.Transformer.from_crs("EPSG:4326", theirs.rio.crs, always_xy=True).transform(10, -80)
        again = pyproj.Transformer.from_crs("EPSG:4326", ours.rio.crs, always_xy=True).transform(10, -80)
        assert np.allclose([place, again], [expected, expected], rtol=0, atol=1e-3)
        axes = [[axis.direction for axis in pyproj.CRS(text).axis_info] for text in (ours.spatial_ref.attrs["crs_wkt"], theirs.rio.crs.to_wkt())]
        assert axes[0] == axes[1] == ["north", "north"]


def test_losses_are_reported(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    definition = '{"type": "OtherCRS", "name": "a yard"}'
    spinney.build(np.zeros((3, 3), "u1"), tmp_path / "t.goblin", crs=definition)
    with pytest.warns(UserWarning, match="spinney_crs"), xr.open_dataset(tmp_path / "t.goblin", engine="spinney") as ds:
        assert ds.spatial_ref.attrs["spinney_crs"] == definition and "crs_wkt" not in ds.spatial_ref.attrs
