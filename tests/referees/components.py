#!/usr/bin/env python3
"""Component labels against SciPy's, and sieved maps against those of gdal_sieve.

    python tests/referees/components.py PATH/TO/spinney DIRECTORY

Needs NumPy and SciPy; without gdal_sieve.py or SciPy, it reports what is skipped. SciPy labels one
class at a time, in rows; labels are compared as partitions of the map, and then by the order of
their first cells along the Z curve. gdal_sieve merges each small polygon into the neighbour that
was the largest before any merge, so the compared maps have no small polygons that touch. Fails at
the first map that differs.
"""

import pathlib
import shutil
import subprocess
import sys

try:
    import numpy as np
    from PIL import Image
    from scipy import ndimage
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit()

program, directory = sys.argv[1], pathlib.Path(sys.argv[2])
directory.mkdir(parents=True, exist_ok=True)


def spinney(*arguments):
    subprocess.run([program, "-q", *map(str, arguments)], check=True)


def z_order(shape):
    """Returns the index of each cell along the Z curve."""
    order = np.zeros(shape, np.uint64)
    for axis, numbers in enumerate(reversed(np.indices(shape, dtype=np.uint64))):
        for bit in range(12):
            order |= (numbers >> np.uint64(bit) & np.uint64(1)) << np.uint64(bit * len(shape) + axis)
    return order


def expected_labels(cells, neighbours):
    """Returns labels by SciPy, 0 for VOID, numbered by their first cells along the Z curve."""
    reach = 1 if neighbours in (4, 6) else cells.ndim
    near = ndimage.generate_binary_structure(cells.ndim, reach)
    labels, count = np.zeros(cells.shape, np.int64), 0
    for value in np.unique(cells[cells > 0]):
        own, found = ndimage.label(cells == value, near)
        labels[own > 0] = own[own > 0] + count
        count += found
    firsts = ndimage.minimum(z_order(cells.shape), labels, np.arange(1, count + 1))
    ranks = np.zeros(count + 1, np.int64)
    ranks[1 + np.argsort(firsts)] = np.arange(1, count + 1)
    return ranks[labels]


def built(cells):
    tree, source = directory / "cells.goblin", directory / ("cells.png" if cells.ndim == 2 else "cells.npy")
    Image.fromarray(cells).save(source) if cells.ndim == 2 else np.save(source, cells)
    spinney("build", source, "-o", tree, "--nodata", "0", "--kind", "categorical")
    return tree


def made(tree, *steps, options=()):
    """Returns the file that operations make of a tree."""
    result = directory / "result.goblin"
    spinney("transform", tree, *steps, "-o", result, *options)
    return result


def cells_of(tree):
    back = directory / "back.npy"
    spinney("get", tree, back)
    return np.load(back)


def blobs(random, shape, classes):
    """Returns patches of classes with some noise, and VOID."""
    smooth = ndimage.gaussian_filter(random.normal(size=shape), random.integers(1, 12))
    cells = np.digitize(smooth, np.quantile(smooth, np.linspace(0, 1, classes + 2)[1:-1])).astype(np.uint8)
    noise = ndimage.gaussian_filter(random.normal(size=shape), 20) > 0
    cells[noise] = random.integers(0, classes + 1, shape)[noise]
    return cells


random = np.random.default_rng(4)
for seed in range(16):
    if seed % 4 == 3:
        shape, ways = tuple(random.integers(40, 140, 3)), (6, 26)
    else:
        shape, ways = tuple(random.integers(200, 700, 2)), (4, 8)
    cells = blobs(random, shape, int(random.integers(2, 9)))
    tree = built(cells)
    for neighbours in ways:
        result = made(tree, f"components={neighbours}")
        if not np.array_equal(cells_of(result), expected_labels(cells, neighbours)):
            sys.exit(f"labels differ: map {seed} of {shape}, {neighbours} neighbours")
        first = result.read_bytes()
        if first != made(tree, f"components={neighbours}", options=("--threads", 1, "--memory", "1MiB")).read_bytes():
            sys.exit(f"bytes depend on memory or threads: map {seed}")
print("labels are those of SciPy")

if not shutil.which("gdal_sieve.py") or not shutil.which("gdal_translate"):
    print("skipped: gdal_sieve.py is not there")
    sys.exit()
for seed in range(8):
    shape = tuple(random.integers(200, 700, 2))
    squares = np.kron(random.integers(1, 5, (14, 14)), np.ones((50, 50), int))[: shape[0], : shape[1]].astype(np.uint8)
    # Specks of up to 3 x 3 cells, each of its own class, that touch neither each other nor the
    # border of a square.
    for y, x in np.argwhere(random.random((700 // 10, 700 // 10)) < 0.5) * 10 + 3:
        if y + 4 < shape[0] and x + 4 < shape[1]:
            squares[y : y + random.integers(1, 4), x : x + random.integers(1, 4)] = 9
    least, tree = int(random.integers(2, 10)), built(squares)
    for option, step in (("-4", f"sieve={least}"), ("-8", f"sieve={least},connect=8")):
        mine = cells_of(made(tree, step))
        header = f"P5 {shape[1]} {shape[0]} 255\n".encode()
        (directory / "cells.pgm").write_bytes(header + squares.tobytes())
        theirs = directory / "sieved.tif"
        subprocess.run(["gdal_translate", "-q", directory / "cells.pgm", directory / "cells.tif"], check=True)
        subprocess.run(
            ["gdal_sieve.py", "-q", option, "-st", str(least), directory / "cells.tif", "-nomask", "-of", "ENVI", theirs],
            check=True,
        )
        found = np.frombuffer(theirs.read_bytes(), np.uint8).reshape(shape)
        if not np.array_equal(mine, found):
            sys.exit(f"sieved maps differ: map {seed} of {shape}, {least} cells, {option}")
print("sieved maps are those of gdal_sieve")
