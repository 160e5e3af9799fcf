"""Random expressions over layers with VOID, against NumPy; and invalid expressions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import spinney

SHAPE = (70, 90)
NAMES = {"f": "float32", "d": "float64", "i": "int16", "c": "uint8", "s": "int8", "u": "uint32", "big number": "int64"}
Numbers = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def layers(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Numbers]:
    """A file of layers of several types, and their numbers as f64, NaN for VOID."""
    random, path = np.random.default_rng(1991), tmp_path_factory.mktemp("layers") / "layers.goblin"
    arrays, numbers = {}, {}
    for name, dtype in NAMES.items():
        if np.dtype(dtype).kind == "f":
            cells = (random.integers(-8, 9, SHAPE) / 4).astype(dtype)
            cells[random.random(SHAPE) < 0.1] = random.normal()
        else:
            cells = random.integers(0 if dtype[0] == "u" else -5, 7, SHAPE).astype(dtype)
        if name == "big number":
            cells += 2**50
        cells[10:50, 20:70] = cells[0, 0]
        void = random.random(SHAPE) < 0.15
        void[40:, 30:60] |= random.random() < 0.5
        arrays[name] = np.ma.array(cells, mask=void)
        numbers[name] = np.where(void, np.nan, cells.astype(np.float64))
    spinney.build(arrays, path)
    return path, numbers


def together(function: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """VOID if one of the operands is."""

    def result(*of: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            found = function(*of).astype(float)
        found[np.any([np.isnan(each) for each in of], axis=0) | ~np.isfinite(found)] = np.nan
        return found

    return result


def reduced(function: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """VOID operands are skipped."""

    def result(*of: np.ndarray) -> np.ndarray:
        stack = np.stack(of)
        found, some = np.full(SHAPE, np.nan), ~np.isnan(stack).all(axis=0)
        found[some] = function(stack[:, some], axis=0)
        return found

    return result


def count(*of: np.ndarray) -> np.ndarray:
    found: np.ndarray = (~np.isnan(np.stack(of))).sum(axis=0).astype(float)
    return found


def where(c: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(c), np.nan, np.where(c != 0, a, b))


BINARY: dict[str, Callable[..., np.ndarray]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": lambda a, b: np.where(b == 0, np.nan, a / b),
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "==": np.equal,
    "!=": np.not_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "&": np.logical_and,
    "|": np.logical_or,
}
# By precedence, loosest first; those of one row are left-associative.
ROWS = [("or", "|"), ("and", "&"), ("<", "<=", ">", ">=", "==", "!="), ("+", "-"), ("*", "/")]
REDUCERS = {"min": np.nanmin, "max": np.nanmax, "mean": np.nanmean, "median": np.nanmedian}


class Maker:
    """Generates random expressions, and their values by NumPy."""

    def __init__(self, seed: int, numbers: Numbers) -> None:
        self.random = np.random.default_rng(seed)
        self.numbers = numbers

    def name(self) -> tuple[str, np.ndarray]:
        name = str(self.random.choice(list(self.numbers)))
        return (f'"{name}"' if " " in name else name), self.numbers[name]

    def constant(self) -> tuple[str, np.ndarray]:
        text = str(self.random.choice(["0", "1", "2", "0.5", "3.25", "1e-1", "7."]))
        return text, np.full(SHAPE, float(text))

    def operand(self, depth: int) -> tuple[str, np.ndarray]:
        """Returns an operand of the highest precedence."""
        choice = self.random.random()
        if depth <= 0 or choice < 0.3:
            return self.name() if self.random.random() < 0.75 else self.constant()
        if choice < 0.45:
            text, cells = self.row(depth - 1)
            return f"({text})", cells
        if choice < 0.55:
            name = str(self.random.choice(["abs", "sqrt"]))
            text, cells = self.row(depth - 1)
            return f"{name}({text})", together(getattr(np, name))(cells)
        if choice < 0.7:
            parts = [self.row(depth - 1) for _ in range(3)]
            return f"where({', '.join(text for text, _ in parts)})", where(*(cells for _, cells in parts))
        if choice < 0.9:
            # (Numbers that are equal for all cells have their own test.)
            parts = [self.varying(depth - 1) for _ in range(self.random.integers(1, 5))]
            name = str(self.random.choice([*REDUCERS, "count"]))
            function = count if name == "count" else reduced(REDUCERS[name])
            return f"{name}({','.join(text for text, _ in parts)})", function(*(cells for _, cells in parts))
        text, cells = self.operand(depth - 1)
        if self.random.random() < 0.5:
            return f"-{text}", -cells
        return f"(not {text})", together(np.logical_not)(cells)

    def varying(self, depth: int) -> tuple[str, np.ndarray]:
        """Returns an operand that depends on cells."""
        text, cells = self.operand(depth)
        name, more = self.name()
        return f"{name} + {text}", together(np.add)(more, cells)

    def row(self, depth: int, row: int = 0) -> tuple[str, np.ndarray]:
        """Returns operands with operators of a row, or of higher precedence."""
        if row == len(ROWS) or self.random.random() < 0.3:
            return self.operand(depth)
        text, cells = self.row(depth, row + 1)
        # (Comparisons are not chained.)
        for _ in range(self.random.integers(0, 2 if row == 2 else 3)):
            operator = str(self.random.choice(ROWS[row]))
            other, more = self.row(depth, row + 1)
            text, cells = f"{text} {operator} {other}", together(BINARY[operator])(cells, more)
        return text, cells


@pytest.mark.parametrize("seed", range(120))
def test_expressions_are_those_of_numpy(layers: tuple[Path, Numbers], seed: int) -> None:
    path, numbers = layers
    text, cells = Maker(seed, numbers).varying(3)
    with spinney.open(path, view=f"calc={text},type=f64") as ds:
        found = ds.read(1, masked=True).astype(float).filled(np.nan)
        np.testing.assert_allclose(found, cells, rtol=1e-12, atol=1e-12, err_msg=text)
        stats = ds.stats((5, 6, 60, 50))
        assert stats.cells == np.isfinite(cells[6:56, 5:65]).sum()


def test_numbers_that_all_cells_share_do_not_count_alone(layers: tuple[Path, Numbers]) -> None:
    path, numbers = layers
    for text, cells in [
        ("max(i, 0)", np.maximum(numbers["i"], 0)),
        ("min(1 + 1, i, 3)", np.minimum(numbers["i"], 2)),
        ("mean(i, 4)", (numbers["i"] + 4) / 2),
        ("max(i, d, 0)", np.fmax(np.fmax(numbers["i"], numbers["d"]), np.where(np.isnan(numbers["i"]) & np.isnan(numbers["d"]), np.nan, 0))),
    ]:
        with spinney.open(path, view=f"calc={text},type=f64") as ds:
            np.testing.assert_array_equal(ds.read(1, masked=True).filled(np.nan), cells, err_msg=text)


NAMED = ["f", "i", "c", '"big number"', "b1", "f.b1", "nothing", "type=u8", ",type=f64", ",type=x", ",x=none.goblin", ",i="]
WRITTEN = ["0", "1", "2.5", "1e400", "1e-400", "1e", ".", "007", "9" * 400, "\u00e4", "\U0001f300", "\0", "\n", "\\", "%", "^", "[", "{", '"', "'"]
SIGNS = [*BINARY, "=", "!", "&&", "not", "(", ")", "((", "))", ",", ",,"]
TOKENS = np.array([*NAMED, *WRITTEN, *SIGNS, "where(", "abs(", "sqrt", "min(", "max(", "mean(", "median(", "count("])


@pytest.mark.parametrize("seed", range(2))
def test_invalid_expressions_only_raise_errors(layers: tuple[Path, Numbers], seed: int) -> None:
    path, _ = layers
    random, evaluated = np.random.default_rng(seed), 0
    expressions = ["".join(random.choice(TOKENS, random.integers(0, 14))) for _ in range(400)]
    # Almost valid expressions: with an additional token, or a missing one.
    for number in range(150):
        words = Maker(1000 * seed + number, {name: np.zeros(SHAPE) for name in NAMES}).row(2)[0].split(" ")
        place = int(random.integers(0, len(words)))
        expressions += [" ".join([*words[:place], str(random.choice(TOKENS)), *words[place:]]), " ".join([*words[:place], *words[place + 1 :]])]
    for text in expressions:
        for step in (f"calc={text}", f"reduce={text}"):
            try:
                with spinney.open(path, view=step) as ds:
                    ds.read(1, window=(3, 4, 20, 30))
                    evaluated += 1
            except (ValueError, OSError) as error:
                assert str(error)
    assert evaluated > 20


@pytest.mark.parametrize("length", [10, 1000, 100_000])
def test_long_and_deep_expressions(layers: tuple[Path, Numbers], length: int) -> None:
    path, _ = layers
    for text in (
        "(" * length + "i" + ")" * length,
        "(" * length,
        "-" * length + "i",
        "not " * length + "i",
        "+".join(["i"] * length),
        "i" + "-1" * length,
        "min(" * length + "i" + ")" * length,
        "max(" + ",".join(["i"] * length) + ")",
        "where(i,1," * length + "0" + ")" * length,
        "i" * length,
        '"' + "a" * length + '"',
        "1" * length,
        "." * length,
        "," * length,
    ):
        try:
            with spinney.open(path, view=f"calc={text}") as ds:
                ds.read(1, window=(0, 0, 4, 4))
        except (ValueError, OSError) as error:
            assert len(str(error)) < 2 * len(text) + 1000
