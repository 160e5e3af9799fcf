"""Items of docs/literature.md on operations on cells: see literature.py."""

from itertools import product
from math import cos, radians, sin

import numpy as np
import structures as own
from harness import CLASSIC, build, cells_of, classes, df, fresh, info, item, near, printed_df, rasters, run, same, transformed


def window_of(cells, low, size):
    """Returns a box of cells, VOID outside."""
    box = np.zeros(size, cells.dtype)
    inside = [(max(at, 0), min(at + wide, have)) for at, wide, have in zip(low, size, cells.shape)]
    if all(first < last for first, last in inside):
        box[tuple(slice(first - at, last - at) for (first, last), at in zip(inside, low))] = cells[tuple(slice(*pair) for pair in inside)]
    return box


@item("19: windows of any position")
def windows():
    rng = np.random.default_rng(20)
    for cells in [CLASSIC, *rasters(20, 6), *rasters(21, 3, 3, 9)]:
        tree = build(cells)
        for _ in range(3):
            size = [int(rng.integers(1, wide + 3)) for wide in cells.shape]
            low = [int(rng.integers(max(-3, 1 - span), wide)) for span, wide in zip(size, cells.shape)]
            box = ",".join(map(str, [*low[::-1], *size[::-1]]))
            wanted = window_of(cells, low, size)
            result = transformed(tree, f"window={box}")
            same(cells_of(result), wanted, "transform window", box)
            same(printed_df(result), df(wanted), "window", box)
            # (`get` has windows from cell 0 on, and of octrees those within the tree.)
            inside = [min(at + wide, have) - at for at, wide, have in zip(low, size, cells.shape)]
            if min(low) >= 0:
                if cells.ndim == 3:
                    box, wanted = ",".join(map(str, [*low[::-1], *inside[::-1]])), window_of(cells, low, inside)
                same(cells_of(tree, "--window", box), wanted, "get --window", box)


@item("20 21 40: translation, scaling, subtrees")
def moved():
    rng = np.random.default_rng(22)
    for cells in [CLASSIC, *rasters(23, 6), *rasters(24, 4, 3, 9)]:
        axes, tree = cells.ndim, build(cells, "--rule", "nearest")
        shift = [int(at) for at in rng.integers(0, 6, axes)]
        wanted = np.pad(cells, [(at, 0) for at in shift])
        result = transformed(tree, "translate=" + ",".join(map(str, shift[::-1])))
        same(cells_of(result), wanted, "translate", shift)
        same(printed_df(result), df(wanted), "translate", shift)
        double = cells.repeat(2, 0).repeat(2, 1)
        double = double.repeat(2, 2) if axes == 3 else double
        result = transformed(tree, "scale=2")
        same(cells_of(result), double, "scale=2")
        # The tree of cells of twice the width is the subtree of a tree.
        depth = own.depth_of(cells.shape)
        same(printed_df(result), df(cells, depth), "scale=2", cells.tolist())
        if depth == 0:
            continue
        # At half the scale, cells are the means of four or eight.
        even = cells[tuple(slice(0, size // 2 * 2) for size in cells.shape)]
        if even.any():
            values = np.where(even, rng.integers(1, 255, even.shape), 0).astype(np.uint8)
            result = transformed(build(values, kind="continuous", to="c.goblin"), "scale=0.5")
            same(cells_of(result), own.level(values, own.depth_of(values.shape) - 1, "mean"), "scale=0.5", values.tolist())
        for number in rng.choice(1 << axes, 3, False):
            part = own.parts(own.padded(cells, depth))[number]
            low = [(number >> (axes - 1 - axis) & 1) << depth - 1 for axis in range(axes)]
            if all(at < size for at, size in zip(low, cells.shape)):
                result = transformed(tree, f"subtree=/{number}")
                wide = [min(1 << depth - 1, size - at) for at, size in zip(low, cells.shape)]
                same(cells_of(result), part[tuple(slice(0, at) for at in wide)], "subtree", number)
                same(printed_df(result), df(part, depth - 1), "subtree", number)
            result = transformed(tree, f"embed=/{number}")
            inner, white = ("G", "W") if axes == 2 else ("M", "V")
            text = inner + "".join(df(cells) if other == number else white for other in range(1 << axes))
            same(printed_df(result), text if cells.any() else white, "embed", number, cells.tolist())


# Rotations about x, y and z, of octants numbered 4x + 2y + z.
PI = {0: 1, 1: 3, 2: 0, 3: 2, 4: 5, 5: 7, 6: 4, 7: 6}
ABOUT_Y = {0: 4, 1: 0, 2: 6, 3: 2, 4: 5, 5: 1, 6: 7, 7: 3}
ABOUT_Z = {0: 2, 1: 3, 2: 6, 3: 7, 4: 0, 5: 1, 6: 4, 7: 5}


@item("22 39: quarter turns")
def quarter_turns():
    # NW becomes SW, NE NW, SE NE and SW SE: counterclockwise.
    found = cells_of(transformed(build(np.array([[1, 2], [3, 4]], np.uint8)), "rotate=-90")).ravel().tolist()
    same([found.index(value) for value in (1, 2, 4, 3)], [2, 0, 1, 3], "quadrants")
    for turn, name in ((PI, "x"), (ABOUT_Y, "y"), (ABOUT_Z, "z")):
        cells = np.array([[[1 + 4 * x + 2 * y + z for x in (0, 1)] for y in (0, 1)] for z in (0, 1)], np.uint8)
        found = cells_of(transformed(build(cells), f"rotate=-90,{name}"))
        turned = {int(found[z, y, x]) - 1: 4 * x + 2 * y + z for z, y, x in np.ndindex(2, 2, 2)}
        same(turned, turn, "octants about", name)
    for cells in [CLASSIC, *rasters(25, 5)]:
        tree = build(cells)
        turns = {f"rotate={90 * turn}": np.rot90(cells, -turn) for turn in (-1, 1, 2, 3)}
        for operation, wanted in {**turns, "mirror=x": cells[:, ::-1], "mirror=y": cells[::-1], "transpose": cells.T}.items():
            result = transformed(tree, operation)
            same(cells_of(result), wanted, operation)
            same(printed_df(result), df(wanted), operation, cells.tolist())
    for cells in rasters(26, 3, 3, 9):
        tree = build(cells)
        # From y to z about x, from z to x about y, from x to y about z: axes of arrays are z, y, x.
        for name, plane in {"x": (1, 0), "y": (0, 2), "z": (2, 1)}.items():
            for turn in (1, 2, -1):
                wanted = np.rot90(cells, turn, plane)
                result = transformed(tree, f"rotate={90 * turn},{name}")
                same(cells_of(result), wanted, name, turn, cells.tolist())
                same(printed_df(result), df(wanted), name, turn)


@item("23: turning by any angle")
def turning():
    rng = np.random.default_rng(27)
    for cells in [CLASSIC, *rasters(27, 6, void=False)]:
        tree = build(cells)
        for degrees in (30, -45, float(rng.integers(1, 3600)) / 10):
            result = transformed(tree, f"rotate={degrees}")
            found = cells_of(result)
            a, b, left, d, e, top = info(result)["transform"]
            # Clockwise, as rows go down: a cell's centre comes from the turn back.
            c, s = cos(radians(degrees)), sin(radians(degrees))
            for number, wanted in zip((a, b, d, e), (c, s, -s, c)):
                near(number, wanted, 1e-9, "matrix of", degrees)
            rows, columns = np.mgrid[: found.shape[0], : found.shape[1]] + 0.5
            x, y = a * columns + b * rows + left, d * columns + e * rows + top
            is_inside = (x >= 0) & (y >= 0) & (x < cells.shape[1]) & (y < cells.shape[0])
            nearest = (np.clip(at, 0, size - 1).astype(int) for at, size in zip((y, x), cells.shape))
            wanted = np.where(is_inside, cells[tuple(nearest)], 0)
            clear = (np.abs(x - np.round(x)) > 1e-9) & (np.abs(y - np.round(y)) > 1e-9)
            same(found[clear], wanted[clear], degrees, cells.tolist())
            # The middle stays, and no corner is lost.
            near(a * found.shape[1] / 2 + b * found.shape[0] / 2 + left, cells.shape[1] / 2, 1.5, "middle")
            for column, row in product((0, cells.shape[1]), (0, cells.shape[0])):
                at = c * (column - left) - s * (row - top), s * (column - left) + c * (row - top)
                assert all(-1e-6 <= where <= size + 1e-6 for where, size in zip(at, found.shape[::-1])), (degrees, at, found.shape)
            same(printed_df(result), df(found), degrees)


def of_sets(number, a, b, fill):
    """Returns the set operation of that number: 1 is both, 2 A only, 4 B only, 8 neither."""
    index = np.where(a != 0, np.where(b != 0, 0, 1), np.where(b != 0, 2, 3))
    return np.where(number >> index & 1, np.where(a != 0, a, np.where(b != 0, b, fill)), 0).astype(np.uint8)


@item("24 38 55: sixteen set operations of cells")
def set_operations():
    rng = np.random.default_rng(28)
    for axes in (2, 2, 3):
        size = tuple(int(wide) for wide in rng.integers(3, 17 if axes == 2 else 9, axes))
        a, b = classes(rng, size), classes(rng, size)
        first, second = build(a, to="a.goblin"), build(b, to="c.goblin")
        for number in range(16):
            more = ["--margin", 0] if number >= 8 else []
            run("combine", number, first, second, "-o", fresh("b.goblin"), *more)
            wanted = of_sets(number, a, b, 255)
            same(cells_of("b.goblin"), wanted, "operation", number, a.tolist(), b.tolist())
            same(printed_df("b.goblin"), df(wanted), "condensed, operation", number)
    a, b = (np.array(sets, np.uint8).reshape(2, 2) for sets in ([1, 1, 0, 0], [1, 0, 1, 0]))
    first, second = build(a, to="a.goblin"), build(b, to="c.goblin")
    for number in range(16):
        run("combine", number, first, second, "-o", fresh("b.goblin"), *(["--margin", 0] if number >= 8 else []))
        found = cells_of("b.goblin").ravel()
        same(sum(1 << index for index in range(4) if found[index]), number, "index of sets")


@item("25: set operations of trees that are not aligned")
def not_aligned():
    rng = np.random.default_rng(29)
    for _ in range(5):
        a, b = (classes(rng, tuple(int(wide) for wide in rng.integers(2, 14, 2))) for _ in range(2))
        dx, dy = (int(at) for at in rng.integers(-5, 8, 2))
        first = build(a, to="a.goblin", transform="1,0,0,0,1,0")
        second = build(b, to="c.goblin", transform=f"1,0,{dx},0,1,{dy}")
        for number in (1, 2, 4, 6, 7):
            run("combine", number, first, second, "-o", fresh("b.goblin"))
            _, _, left, _, _, top = info("b.goblin")["transform"]
            found = cells_of("b.goblin")
            own_a, own_b = (window_of(cells, [int(top) - y, int(left) - x], found.shape) for cells, x, y in ((a, 0, 0), (b, dx, dy)))
            same(found, of_sets(number, own_a, own_b, 255), "operation", number, "shifted by", dx, dy)
            # No cell of the result is outside of its extent.
            wide = [window_of(cells, [-20 - y, -20 - x], (60, 60)) for cells, x, y in ((a, 0, 0), (b, dx, dy))]
            same(np.count_nonzero(found), np.count_nonzero(of_sets(number, *wide, 255)), "cells of operation", number)


@item("45: components")
def component_labels():
    for cells in [CLASSIC, *rasters(45, 8), *rasters(46, 5, 3, 9)]:
        for connect in (4, 8) if cells.ndim == 2 else (6, 26):
            labels = own.components(cells, connect in (8, 26))
            result = transformed(build(cells), f"components={connect}")
            same(cells_of(result), labels, connect, cells.tolist())
