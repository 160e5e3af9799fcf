"""Windows with fractional bounds, or beyond the raster: as rasterio reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinney

from conftest import noise

rasterio = pytest.importorskip("rasterio")
Window = pytest.importorskip("rasterio.windows").Window

ROWS, COLUMNS, NODATA = 40, 50, 65535


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A raster as a TIFF opened by rasterio, and as a tree; each sample occurs once."""
    directory = tmp_path_factory.mktemp("windows")
    bands = np.arange(2 * ROWS * COLUMNS, dtype="u2").reshape(2, ROWS, COLUMNS)
    bands[:, 5:9, 20:30] = NODATA
    with rasterio.open(directory / "a.tif", "w", "GTiff", COLUMNS, ROWS, 2, None, rasterio.Affine(1, 0, 0, 0, -1, ROWS), "uint16", nodata=NODATA) as file:
        file.write(bands)
    spinney.build(directory / "a.tif", directory / "a.goblin", bands=[1, 2], kind="categorical")
    with rasterio.open(directory / "a.tif") as theirs, spinney.open(directory / "a.goblin") as ours:
        yield theirs, ours


def beyond(centres: np.ndarray, limit: int, reach: float) -> np.ndarray:
    """Returns which centres are outside, by no more than a cell or a pixel."""
    return ((centres < 0) & (centres > -reach)) | ((centres >= limit) & (centres < limit + reach))


def compare(both: Any, window: Any, **options: Any) -> None:
    theirs, ours = both
    for bands in (1, [2, 1], None):
        expected = theirs.read(bands, window=window, **options)
        found = ours.read(bands, window=window, fill=NODATA, **options)
        # (If a window extends beyond the raster, GDAL repeats the edge cells for pixels whose
        # centres are just outside; here they are VOID.)
        near = [
            beyond(start + (np.arange(count) + 0.5) * length / count, limit, max(1.0, length / count))
            for start, length, count, limit in zip((window.row_off, window.col_off), (window.height, window.width), found.shape[-2:], (ROWS, COLUMNS))
        ]
        np.testing.assert_array_equal(found, np.where(near[0][:, None] | near[1][None], NODATA, expected))
        masked = ours.read(bands, window=window, masked=True, **options)
        np.testing.assert_array_equal(masked.filled(NODATA), found)


def test_fractional_windows(both: Any) -> None:
    random = np.random.default_rng(62)
    for number in range(200):
        x, y = random.uniform(0, 30), random.uniform(0, 20)
        width, height = random.uniform(1, 19.9, 2)
        if number % 4 == 0:
            width, height = np.floor([width, height])
        window = Window(x, y, width, height)
        compare(both, window)
        compare(both, window, out_shape=(7, 9) if number % 2 else (30, 3))
        compare(both, window, boundless=True)


def test_fractional_windows_that_stick_out(both: Any) -> None:
    random = np.random.default_rng(63)
    for _ in range(200):
        x, y = random.uniform(-20, 45), random.uniform(-20, 35)
        window = Window(x, y, *random.uniform(2, 30, 2))
        compare(both, window, boundless=True)
        compare(both, window, boundless=True, out_shape=(6, 11))


def test_whole_windows_that_stick_out_with_another_size(both: Any) -> None:
    # (With pixels smaller than cells. Larger ones are read from coarser levels, in which classes
    # are the majority.)
    random = np.random.default_rng(64)
    for _ in range(100):
        x, y = random.integers(-20, 45), random.integers(-20, 35)
        # (Odd sizes, so that no pixel centre is on a cell edge.)
        width, height = 2 * random.integers(0, 15, 2) + 1
        compare(both, Window(x, y, width, height), boundless=True, out_shape=(61, 67))
    compare(both, Window(200, 300, 5, 5), boundless=True, out_shape=(3, 3))


def test_rounding_of_coordinates_is_no_fraction_that_matters(both: Any) -> None:
    _, ours = both
    window = Window(-1e-12, 3.0000000001, COLUMNS + 2e-12, 10)
    np.testing.assert_array_equal(ours.read(1, window=window, fill=0), ours.read(1, window=(0, 3, COLUMNS, 10), fill=0))
    with pytest.raises(IndexError, match="boundless=True"):
        ours.read(1, window=(0.5, 0, COLUMNS, 10))
    with pytest.raises(ValueError, match="more than 0"):
        ours.read(1, window=(0.5, 0, 0, 10))
    with pytest.raises(TypeError, match="window"):
        ours.read(1, window=(np.nan, 0, 1, 10), boundless=True)


def test_means_of_windows_that_stick_out_are_those_of_what_is_inside(tmp_path: Path) -> None:
    array = noise((64, 96), "float32")
    spinney.build(array, tmp_path / "t.goblin")
    with spinney.open(tmp_path / "t.goblin") as ds:
        inside = ds.read(1, window=(8, 16, 64, 32), out_shape=(8, 16))
        np.testing.assert_array_equal(ds.read(1, window=(8, 16, 64, 32), out_shape=(8, 16), boundless=True), inside)
        found = ds.read(window=(-32, -32, 64, 64), out_shape=(1, 8, 8), boundless=True, masked=True)[0]
        assert found.mask[:4].all() and found.mask[:, :4].all() and not found.mask[4:, 4:].any()
        np.testing.assert_allclose(found[4:, 4:], array[:32, :32].reshape(4, 8, 4, 8).mean(axis=(1, 3)), rtol=1e-6)
        nothing = ds.read(1, window=(-90, 0, 10, 10), out_shape=(3, 4), boundless=True)
        assert nothing.shape == (3, 4) and np.isnan(nothing).all()
        for wrong in ({"level": 3}, {"exact": False, "level": 2}):
            with pytest.raises(ValueError, match="out_shape, level: got both"):
                ds.read(1, window=(-1, 0, 10, 10), out_shape=(3, 4), boundless=True, **wrong)


def test_fractions_of_coarser_levels_views_and_large_windows(tmp_path: Path) -> None:
    array = noise((700, 900), "uint8")
    spinney.build(array, tmp_path / "t.goblin", kind="categorical")
    with spinney.open(tmp_path / "t.goblin") as ds, spinney.open(tmp_path / "t.goblin", view="window=10,20,600,500") as view:
        # (Few cells among many are read one by one.)
        rows, columns = (np.floor(0.25 + (np.arange(5) + 0.5) * size / 5).astype(int) for size in (690.5, 880.5))
        np.testing.assert_array_equal(ds.read(1, window=(0.25, 0.25, 880.5, 690.5), out_shape=(5, 5)), array[rows][:, columns])
        np.testing.assert_array_equal(view.read(1, window=(0.25, 0.25, 99, 99), boundless=True), array[20:119, 10:109])
        coarse = ds.read(1, level=ds.depth - 2)
        found = ds.read(1, window=(4.5, 8.5, 40, 80), level=ds.depth - 2)
        np.testing.assert_array_equal(found, coarse[2:22, 1:11])
        out = np.zeros((3, 3), "u1")
        ds.read(1, window=(0.5, 0.5, 3, 3), out=out)
        np.testing.assert_array_equal(out, array[1:4, 1:4])


def test_fractions_in_octrees(tmp_path: Path) -> None:
    array = noise((20, 30, 40), "uint8")
    spinney.build(array, tmp_path / "t.goblin", dims="zyx")
    with spinney.open(tmp_path / "t.goblin") as ds:
        np.testing.assert_array_equal(ds.read(1, window=(1.25, 2.25, 3.25, 5, 6, 7)), array[3:10, 2:8, 1:6])
