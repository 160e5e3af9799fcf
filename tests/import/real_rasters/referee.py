"""Checks exported arrays of operations with NumPy.

Every line of standard input is a case: name, tolerance, nodata value, output file, expression of
the expected contents, and the input files, named a, b ... in the expression.
"""

import sys

import numpy as np


def load(path, void):
    return np.ma.masked_equal(np.load(path), void)


def over(a, b):
    return np.ma.where(np.ma.getmaskarray(a), b, a)


def xor(a, b):
    here, there = ~np.ma.getmaskarray(a), ~np.ma.getmaskarray(b)
    return np.ma.masked_array(over(a, b).data, ~(here ^ there))


def only(a, keep):
    return np.ma.masked_array(a.data, np.ma.getmaskarray(a) | ~keep)


def subtract(a, b):
    if a.dtype.kind == "f":
        return a - b
    limits = np.iinfo(a.dtype)
    return np.ma.clip(a.astype(np.int64) - b, limits.min, limits.max)


def box(a, col, row, width, height):
    """Returns a window that may extend beyond the array."""
    result = np.ma.masked_all((height, width), a.dtype)
    rows = slice(max(row, 0), min(row + height, a.shape[0]))
    cols = slice(max(col, 0), min(col + width, a.shape[1]))
    result[rows.start - row : rows.stop - row, cols.start - col : cols.stop - col] = a[rows, cols]
    return result


def enlarge(a, x, y):
    data, mask = (np.repeat(np.repeat(part, x, axis=1), y, axis=0) for part in (a.data, np.ma.getmaskarray(a)))
    return np.ma.masked_array(data, mask)


def blocks(a, n):
    """Returns the cells of each block of n x n as a third axis; missing cells at the edge are
    masked."""
    height, width = -(-a.shape[0] // n), -(-a.shape[1] // n)
    full = box(a, 0, 0, width * n, height * n)
    return full.reshape(height, n, width, n).swapaxes(1, 2).reshape(height, width, n * n)


def mean(a, n):
    """Integers are rounded to the nearest, halves upwards."""
    result = blocks(a, n).mean(axis=2, dtype=np.float64)
    return result if a.dtype.kind == "f" else np.ma.floor(result + 0.5)


def majority(a, n):
    """Returns the most frequent value. Ties are decided by a node's children (4 x 4), or by the
    first cell."""
    cells = blocks(a, n)
    data, there = cells.data, ~np.ma.getmaskarray(cells)
    count = np.stack([((data == data[..., i : i + 1]) & there).sum(axis=2) for i in range(n * n)], axis=2)
    count = np.where(there, count, -1)
    best = count == count.max(axis=2, keepdims=True)
    result = np.take_along_axis(data, best.argmax(axis=2)[..., None], axis=2)[..., 0]
    if n == 4:
        children = blocks(majority(a, 2), 2)
        for at in np.argwhere((there & best & (data != result[..., None])).any(axis=2)):
            at = tuple(at)
            tied = sorted(set(data[at][best[at] & there[at]].tolist()))
            deciding = children[at].compressed().tolist()
            hashed = int(count[at].max())
            for value in deciding:
                hashed = (hashed ^ value) * 0x9E3779B97F4A7C15 % 2**64
                hashed ^= hashed >> 32
            result[at] = next((value for value in deciding if value in tied), tied[hashed % len(tied)])
    return np.ma.masked_array(result, ~there.any(axis=2))


bad = 0
for line in sys.stdin:
    name, tolerance, void, made, expression, *files = line.rstrip("\n").split("\t")
    found = load(made, float(void))
    expected = eval(expression, dict(globals(), **dict(zip("abc", (load(file, float(void)) for file in files)))))
    same = found.shape == expected.shape and bool(
        np.array_equal(np.ma.getmaskarray(found), np.ma.getmaskarray(expected))
        and np.ma.allclose(found.astype(np.float64), expected.astype(np.float64), rtol=0, atol=float(tolerance))
    )
    if not same:
        bad += 1
        print(f"{name}: NumPy has something else for {expression}: {found.shape}, {expected.shape}")
sys.exit(bad > 0)
