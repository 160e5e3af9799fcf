"""Arithmetic with cells: every operator against NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import spinney

SHAPE = (90, 140)
NODATA = -7


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str, dict[str, np.ndarray]]:
    """A file of one band and another one of two, with VOID cells, and their numbers, NaN for
    VOID.
    """
    directory = tmp_path_factory.mktemp("scene")
    random = np.random.default_rng(1991)
    one = random.integers(-6, 9, SHAPE).astype(np.int16)
    one[random.random(SHAPE) < 0.2] = NODATA
    one[10:60, 20:90] = 3
    two = random.integers(0, 5, (2, *SHAPE)).astype(np.float32) / 2
    two[:, 50:, :40] = np.nan
    paths = str(directory / "one.goblin"), str(directory / "two, bands.goblin")
    spinney.build(one, paths[0], nodata=NODATA)
    spinney.build(two, paths[1])
    numbers = {
        "b1": np.where(one == NODATA, np.nan, one).astype(float),
        "o.b1": two[0].astype(float),
        "o.b2": two[1].astype(float),
    }
    return *paths, numbers


def divide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        return np.where(b == 0, np.nan, a / b)


def void_of(*of: np.ndarray) -> np.ndarray:
    return np.any([np.isnan(each) for each in np.broadcast_arrays(*of)], axis=0)


def logical(function: object):
    return lambda *of: np.where(void_of(*of), np.nan, function(*of).astype(float))  # type: ignore[operator]


def skipping(function: object):
    """Returns a reducer that does not warn about cells that are VOID in all bands."""

    def reduce(*of: np.ndarray) -> np.ndarray:
        stack = np.stack(np.broadcast_arrays(*of))
        found = np.full(stack.shape[1:], np.nan)
        some = ~np.isnan(stack).all(axis=0)
        found[some] = function(stack[:, some], axis=0)  # type: ignore[operator]
        return found

    return reduce


def where(c: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(c), np.nan, np.where(c != 0, a, b))


def sqrt(a: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        return np.sqrt(a)


OPERATORS = [
    ("b1 + o.b1", lambda a, b, c: a + b),
    ("b1 - o.b1", lambda a, b, c: a - b),
    ("b1 * o.b1", lambda a, b, c: a * b),
    ("b1 / o.b1", lambda a, b, c: divide(a, b)),
    ("-b1", lambda a, b, c: -a),
    ("b1 < o.b1", lambda a, b, c: logical(np.less)(a, b)),
    ("b1 <= o.b1", lambda a, b, c: logical(np.less_equal)(a, b)),
    ("b1 > o.b1", lambda a, b, c: logical(np.greater)(a, b)),
    ("b1 >= o.b1", lambda a, b, c: logical(np.greater_equal)(a, b)),
    ("b1 == o.b1", lambda a, b, c: logical(np.equal)(a, b)),
    ("b1 != o.b1", lambda a, b, c: logical(np.not_equal)(a, b)),
    ("b1 and o.b1", lambda a, b, c: logical(np.logical_and)(a, b)),
    ("b1 & o.b1", lambda a, b, c: logical(np.logical_and)(a, b)),
    ("b1 or o.b1", lambda a, b, c: logical(np.logical_or)(a, b)),
    ("b1 | o.b1", lambda a, b, c: logical(np.logical_or)(a, b)),
    ("not b1", lambda a, b, c: logical(np.logical_not)(a)),
    ("abs(b1)", lambda a, b, c: abs(a)),
    ("sqrt(b1)", lambda a, b, c: sqrt(a)),
    ("where(o.b1 > 1, b1, o.b2)", lambda a, b, c: where(logical(np.greater)(b, 1), a, c)),
    ("min(b1, o.b1, o.b2)", lambda a, b, c: skipping(np.nanmin)(a, b, c)),
    ("max(b1, o.b1)", lambda a, b, c: skipping(np.nanmax)(a, b)),
    ("mean(b1, o.b1, o.b2)", lambda a, b, c: skipping(np.nanmean)(a, b, c)),
    ("median(b1, o.b1, o.b2)", lambda a, b, c: skipping(np.nanmedian)(a, b, c)),
    ("median(b1, o.b1)", lambda a, b, c: skipping(np.nanmedian)(a, b)),
    ("count(b1, o.b1, o.b2)", lambda a, b, c: (~np.isnan(np.stack([a, b, c]))).sum(axis=0).astype(float)),
    ("(o.b1 - b1) / (o.b1 + b1)", lambda a, b, c: divide(b - a, b + a)),
    ("min(max(b1, 0), 1)", lambda a, b, c: np.clip(a, 0, 1)),
]


@pytest.mark.parametrize(("text", "expected"), OPERATORS, ids=[text for text, _ in OPERATORS])
def test_operators_are_those_of_numpy(scene, text, expected) -> None:
    path, other, numbers = scene
    view = f"calc={text}" + (f',o="{other}"' if "o." in text else "")
    cells = expected(*numbers.values())
    with spinney.open(path, view=view) as ds:
        assert ds.dtype == np.float32 and ds.shape == SHAPE
        np.testing.assert_array_equal(ds.read(1, masked=True).filled(np.nan), cells.astype(np.float32))
        stats = ds.stats()
        assert stats.cells == np.isfinite(cells).sum()
        assert abs(stats.mean - np.nanmean(cells.astype(np.float32).astype(float))) < 1e-6


@pytest.mark.parametrize("reducer", ["median", "mean", "min", "max", "count"])
def test_reductions_are_of_all_bands(scene, reducer: str, tmp_path: Path) -> None:
    path, other, numbers = scene
    stack = np.stack(list(numbers.values()))
    if reducer == "count":
        cells = (~np.isnan(stack)).sum(axis=0).astype(float)
    else:
        cells = skipping(getattr(np, f"nan{reducer}"))(*stack)
    made = str(tmp_path / "made.goblin")
    spinney.transform(path, [f'reduce={reducer},o="{other}",type=f64'], made)
    with spinney.open(made) as ds:
        assert ds.dtype == np.float64
        np.testing.assert_allclose(ds.read(1, masked=True).filled(np.nan), cells, rtol=1e-15)


@pytest.mark.parametrize("dtype", ["u8", "u16", "i16", "u32", "i32", "f32", "f64"])
def test_types_hold_the_nearest_numbers(scene, dtype: str) -> None:
    path, _, numbers = scene
    cells = numbers["b1"] * 100 / 8
    with spinney.open(path, view=f"calc=b1*100/8,type={dtype}") as ds:
        found = ds.read(1, masked=True)
    named = np.dtype({"u": "uint", "i": "int", "f": "float"}[dtype[0]] + dtype[1:])
    assert found.dtype == named
    if named.kind != "f":
        limits = np.iinfo(named)
        cells = np.clip(np.floor(cells + 0.5), limits.min, limits.max)
    np.testing.assert_array_equal(found.astype(float).filled(np.nan), cells)


def test_levels_are_calculated_from_levels(scene) -> None:
    path, other, _ = scene
    with spinney.open(path) as one, spinney.open(other) as two, spinney.open(path, view=f'calc=b1-o.b2,o="{other}"') as ds:
        for level in range(ds.depth + 1):
            bands = [tree.read(band, level=level, masked=True).astype(float).filled(np.nan) for tree, band in ((one, 1), (two, 2))]
            found = ds.read(1, level=level, masked=True).filled(np.nan)
            np.testing.assert_array_equal(found, (bands[0] - bands[1]).astype(np.float32))
            assert ds.level(level).is_approximate == (level < ds.depth)
        assert not one.level(0).is_approximate


@given(st.text(alphabet="b1o.(),+-*/<>=!&|\"' andorotwhermixsq0e", max_size=40))
def test_random_expressions_are_rejected_or_evaluated(text: str) -> None:
    path = Path(__file__).parents[2] / "fixtures" / "v1" / "elevation.goblin"
    try:
        with spinney.open(path, view=f"calc={text}") as ds:
            ds.read(1, level=3)
    except (ValueError, OSError):
        pass
