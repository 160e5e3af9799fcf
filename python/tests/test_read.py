"""Reading: against the arrays that trees were built from, and against the program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import FIXTURES, QUADTREES, TREES, noise, run
from hypothesis import given
from hypothesis import strategies as st

import spinney

TYPES = ["uint8", "uint16", "int16", "uint32", "int32", "float32", "float64", "int8", "uint64", "int64"]


@pytest.mark.parametrize("path", TREES, ids=lambda path: path.name)
def test_fixtures_read_as_the_program_writes_them(path: Path, program: str, tmp_path: Path) -> None:
    with spinney.open(path) as ds:
        for level in range(ds.levels):
            out = tmp_path / f"{level}.npy"
            run(program, "get", path, out, "--level", level)
            wanted = np.load(out)
            found = ds.read(level=level)
            if ds.count == 1:
                wanted = wanted[..., None]
            assert found.shape == (ds.count, *ds.level(level).shape)
            assert np.array_equal(np.moveaxis(found, 0, -1), wanted, equal_nan=found.dtype.kind == "f")
            assert np.array_equal(ds.level(level)[...], found if ds.count > 1 else found[0], equal_nan=found.dtype.kind == "f")


@pytest.mark.parametrize("path", QUADTREES, ids=lambda path: path.name)
def test_sizes_are_resampled_as_by_the_program(path: Path, program: str, tmp_path: Path) -> None:
    with spinney.open(path) as ds:
        for rows, columns in [(5, 7), (16, 16), (40, 3), (700, 600)]:
            run(program, "get", path, tmp_path / "a.npy", "--size", f"{columns}x{rows}")
            wanted = np.load(tmp_path / "a.npy")
            found = ds.read(out_shape=(rows, columns))
            found = found[0] if ds.count == 1 else np.moveaxis(found, 0, -1)
            assert np.array_equal(found, wanted, equal_nan=found.dtype.kind == "f")
            assert ds.read(out_shape=(ds.count, rows, columns)).shape == (ds.count, rows, columns)


@pytest.fixture(scope="module")
def arrays(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[np.ndarray, spinney.Dataset]]:
    """Arrays of every type, bands first, and trees of them."""
    directory = tmp_path_factory.mktemp("arrays")
    made = {}
    for dtype in TYPES:
        for bands in (1, 3) if dtype in ("uint8", "uint16", "float32") else (1,):
            array = np.stack([noise((150, 211), dtype, seed) for seed in range(bands)])
            path = directory / f"{dtype}{bands}.goblin"
            spinney.build(array, path)
            made[f"{dtype}{bands}"] = (array, spinney.open(path))
    solid = noise((40, 70, 50), "uint8")
    spinney.build(solid, directory / "solid.goblin", dims="zyx")
    made["octree"] = (solid[None], spinney.open(directory / "solid.goblin"))
    return made


NAMES = ["uint81", "uint83", "uint161", "uint163", "int161", "uint321", "int321", "float321", "float323", "float641", "int81", "uint641", "int641", "octree"]


@given(name=st.sampled_from(NAMES), data=st.data())
def test_any_index_is_that_of_numpy(arrays: dict, name: str, data: st.DataObject) -> None:
    array, ds = arrays[name]

    def along(length: int) -> st.SearchStrategy:
        return st.one_of(st.integers(-length, length - 1), st.slices(length))

    key = tuple(data.draw(along(length)) for length in ds.shape)
    keep = data.draw(st.integers(0, len(key)))
    key = key[:keep] if data.draw(st.booleans()) else (..., *key[len(key) - keep :])
    whole = array if ds.count > 1 else array[0]
    wanted = whole[(slice(None), *key) if ds.count > 1 and Ellipsis not in key else key]
    found = ds[key]
    assert np.shape(found) == np.shape(wanted) and np.array_equal(found, wanted)
    assert np.asarray(found).dtype == array.dtype


@given(name=st.sampled_from(NAMES[:-1]), data=st.data())
def test_any_window_is_that_part(arrays: dict, name: str, data: st.DataObject) -> None:
    array, ds = arrays[name]
    rows, columns = ds.shape
    x, y = data.draw(st.integers(0, columns - 1)), data.draw(st.integers(0, rows - 1))
    w, h = data.draw(st.integers(1, columns - x)), data.draw(st.integers(1, rows - y))
    wanted = array[:, y : y + h, x : x + w]
    assert np.array_equal(ds.read(window=(x, y, w, h)), wanted)
    assert np.array_equal(ds.read(window=((y, y + h), (x, x + w))), wanted)
    band = data.draw(st.integers(1, ds.count))
    assert np.array_equal(ds.read(band, window=(x, y, w, h)), wanted[band - 1])
    bands = data.draw(st.lists(st.integers(1, ds.count), min_size=1, max_size=4))
    assert np.array_equal(ds.read(bands, window=(x, y, w, h)), wanted[[band - 1 for band in bands]])
    out = np.zeros_like(wanted)
    assert ds.read(window=(x, y, w, h), out=out) is out and np.array_equal(out, wanted)
    # The raster's frame is that of cells.
    assert np.array_equal(ds.read(window=(x, y, x + w, y + h), coordinates="world"), wanted)
    level = data.draw(st.integers(0, ds.depth))
    coarse, shift = ds.read(level=level), ds.depth - level
    part = coarse[:, y >> shift : -(-(y + h) >> shift), x >> shift : -(-(x + w) >> shift)]
    assert np.array_equal(ds.read(window=(x, y, w, h), level=level), part)


@given(name=st.sampled_from(NAMES), data=st.data())
def test_windows_may_stick_out(arrays: dict, name: str, data: st.DataObject) -> None:
    array, ds = arrays[name]
    first = [data.draw(st.integers(-60, length + 20)) for length in ds.shape]
    size = [data.draw(st.integers(1, 90)) for _ in ds.shape]
    padding = [(0, 0)] + [(200, 200)] * ds.ndim
    window = (*first[::-1], *size[::-1])
    inside = (slice(None), *(slice(a + 200, a + 200 + n) for a, n in zip(first, size)))
    found = ds.read(window=window, boundless=True, fill=9)
    assert np.array_equal(found, np.pad(array, padding, constant_values=9)[inside])
    masked = ds.read(window=window, boundless=True, masked=True)
    assert np.array_equal(np.ma.getmaskarray(masked), np.pad(np.zeros(array.shape, bool), padding, constant_values=True)[inside])
    level = data.draw(st.integers(max(ds.depth - 3, 0), ds.depth))
    shift = ds.depth - level
    coarse = np.pad(ds.read(level=level), padding, constant_values=9)
    low, high = [a >> shift for a in first], [-(-(a + n) >> shift) for a, n in zip(first, size)]
    inside = (slice(None), *(slice(a + 200, b + 200) for a, b in zip(low, high)))
    assert np.array_equal(ds.read(window=window, boundless=True, fill=9, level=level), coarse[inside])


VIEWS = [["rotate=90"], ["mirror=x"], ["window=31,17,90,80"], ["rotate=30", "crop"], ["scale=0.5"], ["translate=3,4"]]


@pytest.mark.parametrize("steps", VIEWS, ids=str)
def test_views_are_those_of_the_program(island: str, program: str, tmp_path: Path, steps: list[str]) -> None:
    words = [word for step in steps for word in ("--view", step)]
    with spinney.open(island, view=steps) as ds:
        for level in (ds.depth, ds.depth - 2):
            run(program, "get", island, tmp_path / "a.npy", "--level", level, *words)
            assert np.array_equal(ds.read(1, level=level), np.load(tmp_path / "a.npy"))
        assert ds.view and all(step.split("=")[0] in repr(ds) for step in ds.view)


def test_void_is_masked_or_filled(relief: str, tmp_path: Path) -> None:
    with spinney.open(relief) as ds:
        plain, masked = ds.read(1), ds.read(1, masked=True)
        assert masked.mask.any() and np.array_equal(plain[masked.mask], np.full(masked.mask.sum(), ds.fill_value), equal_nan=True)
        assert masked.count() == ds.stats().cells
        filled = ds.read(1, fill=-5)
        assert (filled[masked.mask] == -5).all()
    array = np.ma.masked_less(noise((90, 80), "int16"), 60)
    spinney.build(array, tmp_path / "m.goblin")
    with spinney.open(tmp_path / "m.goblin") as ds:
        found = ds.read(1, masked=True)
        assert np.array_equal(found.mask, array.mask) and np.array_equal(found.compressed(), array.compressed())


def test_missing_samples_are_masked_by_band(tmp_path: Path) -> None:
    array = np.stack([noise((40, 50), "uint16", seed) for seed in (1, 2)])
    array[0, :, 7], array[:, 3] = 500, 500
    spinney.build(array, tmp_path / "m.goblin", nodata=500)
    with spinney.open(tmp_path / "m.goblin") as ds:
        masked = ds.read(masked=True)
        assert np.array_equal(masked.mask, array == 500) and np.array_equal(masked.data, array)
        sampled = ds.sample([(7.5, 1.5), (2.5, 3.5)], masked=True)
        assert sampled.mask.tolist() == [[True, False], [True, True]]
        points = [(2.5, 4.5), (9.5, 1.5)]
        assert np.array_equal(ds.sample(points, bands=2), array[1, [4, 1], [2, 9]])
        assert np.array_equal(ds.sample(points, bands=[2, 1]), array[::-1, [4, 1], [2, 9]].T)
        for kind, bands in ((IndexError, 0), (IndexError, [1, 3]), (TypeError, "red")):
            with pytest.raises(kind):
                ds.sample(points, bands=bands)


def test_arrays_of_numpy(island: str) -> None:
    with spinney.open(island) as ds:
        whole = ds.read(1)
        assert np.array_equal(np.asarray(ds), whole) and np.array_equal(np.array(ds, dtype="f4"), whole)
        with pytest.raises(ValueError):
            np.asarray(ds, copy=False)
        assert np.array_equal(np.asarray(ds.level(3)), ds.read(1, level=3))
        assert np.array_equal(np.from_dlpack(ds[...]), whole) and np.array_equal(np.from_dlpack(ds), whole)
        assert len(ds) == ds.height and len(ds.level(3)) == ds.level(3).shape[0]
        assert ds[5, 7] == whole[5, 7] and isinstance(ds[5, 7], np.uint8)


def test_facts(island: str) -> None:
    with spinney.open(island) as ds:
        assert (ds.shape, ds.width, ds.height, ds.count, ds.dtype) == ((200, 256), 256, 200, 1, np.uint8)
        assert ds.transform == (50, 0, 300000, 0, -50, 3200000) and ds.res == (50, 50)
        assert ds.bounds == (300000, 3190000, 312800, 3200000) and ds.bounds.left == 300000
        assert (ds.crs, ds.nodata, ds.depth, ds.levels, ds.kind, ds.rule) == ("EPSG:32628", 0, 8, 9, "categorical", "majority")
        assert ds.colormap is not None and ds.colormap[1] == (0x4A, 0x8E, 0xB2, 255)
        assert (ds.scales, ds.offsets, ds.units, ds.dtypes, ds.indexes) == ((1,), (0,), (None,), ("uint8",), (1,))
        assert ds.index(*ds.xy(5, 7)) == (5, 7)
        assert ds.format == "Goblin" and ds.commit is None and ds.file_size > 0 and ds.provenance
        assert "256 x 200" in repr(ds) and "quadtree" in repr(ds)
        png = ds._repr_png_()
        assert png is not None and png.startswith(b"\x89PNG") and "<img" in ds._repr_html_()
    assert "closed" in repr(ds) and ds.closed


def test_files_are_those_of_rasterio(island: str, relief: str) -> None:
    rasterio = pytest.importorskip("rasterio")
    for path, name in ((island, "island_classes"), (relief, "island_elevation")):
        with spinney.open(path) as ds, rasterio.open(FIXTURES / f"{name}.tif") as other:
            assert np.array_equal(ds.read(), other.read(), equal_nan=True)
            assert tuple(other.transform)[:6] == ds.transform and other.bounds == ds.bounds
            assert other.crs == rasterio.CRS.from_user_input(ds.crs) and other.nodata == ds.nodata
            window = rasterio.windows.Window(20, 30, 50, 40)
            assert np.array_equal(ds.read(1, window=window), other.read(1, window=window), equal_nan=True)
            points = np.random.default_rng(3).uniform(ds.bounds[:2], ds.bounds[2:], (500, 2))
            assert np.array_equal(ds.sample(points), np.array(list(other.sample(points))), equal_nan=True)


def test_images_are_saved(island: str, tmp_path: Path) -> None:
    with spinney.open(island) as ds:
        ds.save(tmp_path / "part.tif", window=(96, 64, 64, 64))
        ds.save(tmp_path / "small.npy", shape=(50, 64))
        assert np.array_equal(np.load(tmp_path / "small.npy"), ds.read(1, out_shape=(50, 64)))
        spinney.build(tmp_path / "part.tif", tmp_path / "part.goblin")
        with spinney.open(tmp_path / "part.goblin") as part:
            assert np.array_equal(part[...], ds[64:128, 96:160]) and part.crs == ds.crs


def test_dense_cells_are_shown_where_they_are(tmp_path: Path) -> None:
    for dtype, bands in [("uint8", 1), ("int16", 1), ("float64", 1), ("uint8", 3), ("float32", 2)]:
        array = np.random.default_rng(1).integers(0, 250, (bands, 256, 256)).astype(dtype)
        path = tmp_path / f"{dtype}{bands}.goblin"
        spinney.build(array if bands > 1 else array[0], path)
        ds = spinney.open(path)
        found = ds.mapped((10, 20, 90, 50))
        assert found is not None and found.dtype == dtype and not found.flags.writeable
        assert np.array_equal(found, ds[..., 20:70, 10:100])
        coarse = ds.mapped(level=5)
        assert coarse is not None and np.array_equal(coarse, ds.level(5)[...])
        # The array keeps the mapping.
        ds.close()
        assert np.array_equal(found, array[:, 20:70, 10:100] if bands > 1 else array[0, 20:70, 10:100])
        with pytest.raises(ValueError):
            ds.mapped()
        assert spinney.open(path, positioned=True).mapped() is None
    same = tmp_path / "same.goblin"
    spinney.build(np.ones((50, 50), "uint8"), same)
    assert spinney.open(same).mapped() is None
    with pytest.raises(IndexError):
        spinney.open(same).mapped((40, 40, 20, 20))


def test_large_strides_are_sampled(tmp_path: Path) -> None:
    array = noise((700, 900), "uint16")
    path = tmp_path / "map.goblin"
    spinney.build(array, path)
    bands = np.stack([array, array // 2, array // 3]).astype("uint8")
    spinney.build(bands, tmp_path / "bands.goblin")
    with spinney.open(path) as ds, spinney.open(tmp_path / "bands.goblin") as colours:
        for key in [np.s_[::100, ::100], np.s_[650::-90, 3::70], np.s_[5, ::80], np.s_[::300], np.s_[1::699, 899:0:-899]]:
            assert np.array_equal(ds[key], array[key]), key
            assert np.array_equal(colours[key], bands[(slice(None), *(key if isinstance(key, tuple) else (key,)))]), key
        assert np.array_equal(ds.level(ds.depth)[::100, ::100], array[::100, ::100])


@pytest.mark.parametrize("shape", [(1900, 1300), (3, 1100, 700), (200, 90, 60)])
@pytest.mark.parametrize("masked", [False, True])
def test_large_views_are_read_in_blocks(tmp_path: Path, shape: tuple[int, ...], masked: bool) -> None:
    array = np.random.default_rng(5).integers(1, 250, shape, "u1")
    hidden = array > 200
    dims = "zyx"[3 - len(shape) :]
    spinney.build(array, tmp_path / "t.goblin", dims=dims, mask=hidden, kind="categorical")
    with spinney.open(tmp_path / "t.goblin", view="rotate=180") as ds:
        # (Half a turn about z, as seen from above.)
        turned, void = (np.flip(given, (-1, -2)) for given in (array, hidden))
        found = ds.read(1, masked=masked)
        assert np.array_equal(np.asarray(found)[~void], turned[~void])
        assert not masked or np.array_equal(found.mask, void)
