"""What the checks of docs/literature.md have in common: running the program on generated files, and
counting comparisons."""

import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile
import traceback
from collections import Counter

import numpy as np
import structures as own

PROGRAM = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "spinney").resolve()
temporary = tempfile.TemporaryDirectory()
DIRECTORY = pathlib.Path(temporary.name)
# The example of the two tables of ten records.
CLASSIC = own.cells_of_df("GG1G13331G3312GG31331G3222G11221G221G1211", 3, 2)
ITEMS = []
checks = Counter()


def item(name, *needs):
    """Registers a check of an item, with the modules that it needs."""

    def register(function):
        ITEMS.append((name, needs, function))
        return function

    return register


def same(found, wanted, *what):
    checks["now"] += 1
    if isinstance(wanted, np.ndarray) or isinstance(found, np.ndarray):
        is_same = np.array_equal(found, wanted)
    else:
        is_same = found == wanted
    if not is_same:
        raise AssertionError(f"{' '.join(map(str, what))}\n   got {found}\nwanted {wanted}")


def near(found, wanted, bound, *what):
    checks["now"] += 1
    if found is None or not abs(found - wanted) <= bound * max(abs(wanted), 1):
        raise AssertionError(f"{' '.join(map(str, what))}: got {found}, wanted {wanted}")


def run(*words):
    """Runs the program; returns its output."""
    done = subprocess.run([PROGRAM, "-q", *map(str, words)], capture_output=True, text=True, cwd=DIRECTORY)
    if done.returncode:
        raise AssertionError(f"spinney {' '.join(map(str, words))}: {done.stderr.strip()}")
    return done.stdout


def info(tree):
    return json.loads(run("info", tree, "--json"))


def fresh(name):
    """Returns a file name that no file has."""
    (DIRECTORY / name).unlink(missing_ok=True)
    return name


def build(cells, *options, to="a.goblin", kind="categorical", transform=None):
    """Builds a tree of cells, which are 0 where they are VOID."""
    if cells.ndim == 2:
        source = "cells.pgm"
        (DIRECTORY / source).write_bytes(b"P5 %d %d 255\n" % cells.shape[::-1] + cells.astype(np.uint8).tobytes())
    else:
        source = "cells.npy"
        np.save(DIRECTORY / source, cells.astype(np.uint8))
    more = ["--transform", transform] if transform else []
    run("build", source, "-o", fresh(to), "--kind", kind, "--nodata", 0, *options, *more)
    return to


def cells_of(tree, *options):
    run("get", tree, fresh("got.npy"), *options)
    return np.load(DIRECTORY / "got.npy")


def transformed(tree, *operations, to="b.goblin"):
    run("transform", tree, *operations, "-o", fresh(to))
    return to


def write_table(name, columns, rows):
    lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
    (DIRECTORY / name).write_text("\n".join(lines) + "\n")


def write_off(name, vertices, faces):
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0", *(" ".join(map(str, vertex)) for vertex in vertices)]
    lines += [f"{len(face)} {' '.join(map(str, face))}" for face in faces]
    (DIRECTORY / name).write_text("\n".join(lines) + "\n")


def df(cells, depth=None):
    """Returns the DF-expression that `dump --as df` prints of cells."""
    return own.df_expression(own.build(cells, "nearest", depth), cells.ndim)


def printed_df(tree):
    """Returns the symbols that `dump --as df` prints, after the word that describes the cells."""
    return run("dump", tree, "--as", "df").split(maxsplit=1)[1].strip()


def classes(rng, shape, most=3, void=True):
    """Returns random classes in blocks of several widths, so that trees are of all depths."""
    cells = np.ones(shape, np.uint8)
    for _ in range(int(rng.integers(3, 12))):
        side = 1 << int(rng.integers(0, 4))
        low = [int(rng.integers(0, size)) // side * side for size in shape]
        cells[tuple(slice(at, at + side) for at in low)] = rng.integers(0 if void else 1, most + 1)
    return cells


def rasters(seed, count, axes=2, bound=20, **options):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield classes(rng, tuple(int(size) for size in rng.integers(1, bound, axes)), **options)


def check_all(numbers):
    """Runs all checks, or those of some items; returns the number of lines that fail."""
    failed = 0
    for name, needs, function in ITEMS:
        if numbers and not set(numbers) & set(name.split(":")[0].split()):
            continue
        missing = [module for module in needs if importlib.util.find_spec(module) is None]
        if missing:
            print(f"{name}: skipped, without {' and '.join(missing)}")
            continue
        checks["now"] = 0
        try:
            function()
            print(f"{name}: {checks['now']} checks", flush=True)
        except Exception as error:
            failed += 1
            frames = traceback.extract_tb(error.__traceback__)
            lines = [str(frame.lineno) for frame in frames if frame.name == function.__name__]
            print(f"{name}: FAILED in {function.__name__}, line {lines[0]}: {type(error).__name__}: {error}", flush=True)
    return failed
