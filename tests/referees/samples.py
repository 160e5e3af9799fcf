#!/usr/bin/env python3
"""Values within bodies against those of SciPy, cell by cell.

    python tests/referees/samples.py PATH/TO/spinney DIRECTORY

1,000 samples, points in space or intervals of vertical holes, are interpolated in a ball of cells
by `build --body`, and by the k-d tree of SciPy: the nearest sample, and the mean of the nearest
ones weighted by inverse squares of distances. Without SciPy it reports that it is skipped.
"""

import pathlib
import subprocess
import sys

try:
    import numpy as np
    from scipy.spatial import cKDTree
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit()

program, directory = sys.argv[1], pathlib.Path(sys.argv[2])
directory.mkdir(parents=True, exist_ok=True)
CELL = 0.5


def run(*words):
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def samples(seed, are_intervals):
    """Writes a table of samples; returns its path, their positions and their values."""
    noise = np.random.default_rng(seed)
    positions, values = noise.uniform(-11, 11, (1000, 3)), noise.normal(2.7, 0.4, 1000)
    path = directory / f"samples{seed}.csv"
    if not are_intervals:
        np.savetxt(path, np.column_stack([positions, values]), "%.17g", ",", header="x,y,z,density", comments="")
        return path, positions, values
    mouths = np.column_stack([positions[:, :2], np.full(1000, 12.0)])
    begin, length = noise.integers(0, 22, 1000), noise.integers(1, 5, 1000)
    rows = np.column_stack([mouths, begin, begin + length, values])
    np.savetxt(path, rows, "%.17g", ",", header="x,y,z,from,to,density", comments="")
    return path, mouths - np.column_stack([np.zeros((1000, 2)), begin + length / 2]), values


def weighted(distances, values):
    """Means weighted by inverse squares of distances; samples that are too far have infinity."""
    weights = 1 / distances**2
    return (weights * values).sum(axis=1) / weights.sum(axis=1)


def main():
    (directory / "ball.csg").write_text("ball(0,0,0, 10)")
    body = directory / "ball.goblin"
    run("build", "-q", directory / "ball.csg", "-o", body, "--brep", "--deviation", 0.01)
    count = 0
    for seed, (are_intervals, nearest, radius) in enumerate(
        [(False, 1, np.inf), (False, 12, np.inf), (True, 1, np.inf), (True, 8, np.inf), (False, 5, 1.5)]
    ):
        path, positions, values = samples(seed, are_intervals)
        out, array = directory / "out.goblin", directory / "out.npy"
        more = [] if np.isinf(radius) else ["--radius", radius]
        run("build", "-q", path, "-o", out, "--body", body, "--value", "density", "--cell", CELL, "--nearest", nearest, *more)
        run("get", "-q", out, array, "--nodata", "nan")
        found = np.load(array)
        depth, rows, columns = found.shape
        z, y, x = np.meshgrid(*[(np.arange(size) - size / 2 + 0.5) * CELL for size in (depth, rows, columns)], indexing="ij")
        centres = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
        distances, numbers = cKDTree(positions).query(centres, k=[*range(1, nearest + 1)], distance_upper_bound=radius)
        with np.errstate(invalid="ignore"):
            expected = weighted(distances, np.append(values, 0)[numbers])
        # (Facets are within the deviation of the ball.)
        outside, inside = (np.linalg.norm(centres, axis=1) > limit for limit in (10, 9.98))
        found, is_void = found.ravel(), np.isnan(expected)
        assert np.isnan(found[outside | is_void]).all(), "a value outside of the ball, or without a sample"
        compared = ~inside & ~is_void
        assert compared.sum() > (1000 if more else 30000), compared.sum()
        worst = np.abs(found - expected)[compared].max()
        assert worst < 1e-12, f"seed {seed}: {worst}"
        count += compared.sum()
        integral = float(run("stats", out).split("integral")[1].split()[0])
        assert np.isclose(integral, np.nansum(found) * CELL**3, rtol=1e-12)
    print(f"{count} interpolated cells are those of SciPy")


main()
