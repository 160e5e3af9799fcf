#!/usr/bin/env python3
"""Two files: 100 pairs of rasters, combined by `over`, `max`, `mask` and `diff`, against NumPy,
rasterio and pyproj.

Pairs differ in one property or several: extent, grid, type, scale and offset, unit, names of
classes, coordinate system. The expected result is computed cell by cell from the meaning of the
numbers: cells of the second file are resampled to the first's grid (own area means, bilinear
interpolation with pyproj for other systems), numbers are converted by scale and unit, classes by
name. Pairs on one grid are also merged by `rasterio.merge`.

    pip install numpy rasterio pyproj
    SPINNEY=target/release/spinney benches/peers/together.py [PAIRS]
"""

from __future__ import annotations

import json
import math
import os
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rasterio
from common import record, row
from pyproj import Transformer
from rasterio.merge import merge
from rasterio.transform import Affine

SPINNEY = os.environ.get("SPINNEY", "target/release/spinney")
UTM = "EPSG:32632"
FEET = 0.3048
Grid = tuple[float, float, float]
"""Cell, left and top."""


@dataclass
class Raster:
    """A raster as stored, and its meaning."""

    stored: npt.NDArray[Any]
    valid: npt.NDArray[np.bool_]
    cell: float
    left: float
    top: float
    crs: str = UTM
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""
    names: dict[int, str] = field(default_factory=dict)

    @property
    def is_classes(self) -> bool:
        return bool(self.names)

    def write(self, path: Path) -> None:
        nodata = 0 if self.is_classes else (-9999 if self.stored.dtype.kind == "f" else np.iinfo(self.stored.dtype).min)
        if self.stored.dtype.kind == "u" and not self.is_classes:
            nodata = np.iinfo(self.stored.dtype).max
        cells = np.where(self.valid, self.stored, nodata).astype(self.stored.dtype)
        transform = Affine(self.cell, 0, self.left, 0, -self.cell, self.top)
        with rasterio.open(
            path, "w", driver="GTiff", height=cells.shape[0], width=cells.shape[1], count=1, dtype=cells.dtype, crs=self.crs, transform=transform, nodata=nodata
        ) as out:
            out.write(cells, 1)
            out.scales, out.offsets = (self.scale,), (self.offset,)
            if self.unit:
                out.units = (self.unit,)
        if self.names:
            labels = "".join(f"<Category>{self.names.get(number, '')}</Category>" for number in range(max(self.names) + 1))
            aux = f'<PAMDataset><PAMRasterBand band="1"><CategoryNames>{labels}</CategoryNames></PAMRasterBand></PAMDataset>'
            Path(f"{path}.aux.xml").write_text(aux)

    def meaning(self) -> npt.NDArray[np.float64]:
        return self.stored.astype(np.float64) * self.scale + self.offset


def shares(first: float, cell: float, count: int, start: int, cells: int) -> npt.NDArray[np.float64]:
    """Returns the overlap of each source cell with each target cell, along an axis: target cells
    are 1 wide and begin at `start`."""
    covered = np.zeros((cells, count))
    for target in range(cells):
        for source in range(count):
            low, high = first + source * cell, first + (source + 1) * cell
            covered[target, source] = max(0.0, min(high, start + target + 1) - max(low, start + target))
    covered[covered < 1e-9] = 0.0
    return covered


def whole(low: float, high: float) -> tuple[int, int]:
    """Returns the cells at least half covered by a range."""
    first, last = math.floor(low + 1e-3 + 0.5), math.floor(high - 1e-3 + 0.5)
    return (first, last) if first < last else (math.floor(low), math.ceil(high))


def on_grid(a: Raster, b: Raster) -> tuple[tuple[int, int], tuple[int, int], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Returns columns and rows of the union on the first's grid, and the second's numbers there (as
    stored) with their validity."""
    if a.crs != b.crs:
        return warped(a, b)
    x, y, size = (b.left - a.left) / a.cell, (a.top - b.top) / a.cell, b.cell / a.cell
    rows, columns = b.stored.shape
    across, down = whole(x, x + size * columns), whole(y, y + size * rows)
    left, right = min(0, across[0]), max(a.stored.shape[1], across[1])
    top, bottom = min(0, down[0]), max(a.stored.shape[0], down[1])
    wide, high = shares(x, size, columns, left, right - left), shares(y, size, rows, top, bottom - top)
    if b.is_classes:
        found = np.zeros((bottom - top, right - left))
        area = np.zeros_like(found)
        for number in np.unique(b.stored[b.valid]):
            of_class = high @ ((b.stored == number) & b.valid).astype(float) @ wide.T
            better = of_class > area + 1e-9
            found, area = np.where(better, number, found), np.where(better, of_class, area)
        return (left, right), (top, bottom), found, area > 1e-9
    weights = high @ b.valid.astype(float) @ wide.T
    sums = high @ np.where(b.valid, b.stored, 0).astype(np.float64) @ wide.T
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.where(weights > 1e-9, sums / weights, 0.0)
    return (left, right), (top, bottom), found, weights > 1e-9


def warped(a: Raster, b: Raster) -> Any:
    """Bilinear interpolation at the centres of the first's cells; the extent is the first's
    (--extent a)."""
    rows, columns = a.stored.shape
    x = a.left + (np.arange(columns) + 0.5) * a.cell
    y = a.top - (np.arange(rows) + 0.5) * a.cell
    place = Transformer.from_crs(a.crs, b.crs, always_xy=True).transform(*np.meshgrid(x, y))
    column, row = (place[0] - b.left) / b.cell - 0.5, (b.top - place[1]) / b.cell - 0.5
    height, width = b.stored.shape
    inside = (np.floor(column + 0.5) >= 0) & (np.floor(column + 0.5) < width) & (np.floor(row + 0.5) >= 0) & (np.floor(row + 0.5) < height)
    total, weights = np.zeros((rows, columns)), np.zeros((rows, columns))
    for dy in (0, 1):
        for dx in (0, 1):
            r, c = np.floor(row).astype(int) + dy, np.floor(column).astype(int) + dx
            weight = np.abs(1 - dy - (row - np.floor(row))) * np.abs(1 - dx - (column - np.floor(column)))
            there = (r >= 0) & (r < height) & (c >= 0) & (c < width)
            value = b.stored[np.clip(r, 0, height - 1), np.clip(c, 0, width - 1)]
            total += np.where(there, weight * value, 0)
            weights += np.where(there, weight, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (0, columns), (0, rows), total / weights, inside & (weights > 0)


def expected(a: Raster, b: Raster) -> dict[str, Any]:
    """Returns the meaning of the result's cells by operation; for classes their names."""
    across, down, second, has_second = on_grid(a, b)
    shape = (down[1] - down[0], across[1] - across[0])
    first, has_first = np.zeros(shape), np.zeros(shape, bool)
    rows, columns = a.stored.shape
    part = np.s_[-down[0] : rows - down[0], -across[0] : columns - across[0]]
    first[part], has_first[part] = a.meaning() if not a.is_classes else a.stored, a.valid
    if a.is_classes:
        name = {**{number: text for number, text in a.names.items()}}
        labels = np.vectorize(lambda number: name.get(int(number), ""), otypes=[object])(first)
        others = np.vectorize(lambda number: b.names.get(int(number), ""), otypes=[object])(second)
        differ = has_first & has_second & (labels != others)
        return {"over": (np.where(has_first, labels, others), has_first | has_second), "mask": (labels, has_first & has_second), "diff": counts(has_first, has_second, differ)}
    second = second * b.scale + b.offset
    if a.unit and b.unit and a.unit != b.unit:
        second = second * (FEET if b.unit == "ft" else 1 / FEET)
    differ = has_first & has_second & ~np.isclose(first, second, rtol=1e-9, atol=1e-9)
    return {
        "over": (np.where(has_first, first, second), has_first | has_second),
        "max": (np.maximum(first, second), has_first & has_second),
        "mask": (first, has_first & has_second),
        "diff": counts(has_first, has_second, differ),
    }


def counts(a: npt.NDArray[np.bool_], b: npt.NDArray[np.bool_], differ: npt.NDArray[np.bool_]) -> dict[str, int]:
    return {"added": int((b & ~a).sum()), "removed": int((a & ~b).sum()), "changed": int(differ.sum())}


def run(*words: str) -> str:
    done = subprocess.run([SPINNEY, "-q", *words], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr}")
    return done.stdout


TYPES = ["u1", "u2", "i2", "i4", "f4", "f8"]
CLASSES = ["forest", "lake", "meadow", "rock", "town", "road"]


def values(rng: random.Random, shape: tuple[int, int], dtype: str) -> npt.NDArray[Any]:
    cells = np.array([[rng.randrange(1, 250) for _ in range(shape[1])] for _ in range(shape[0])])
    return (cells / 4 if dtype.startswith("f") else cells).astype(dtype)


def raster(rng: random.Random, dtype: str, grid: Grid, **more: Any) -> Raster:
    cell, left, top = grid
    shape = (rng.randrange(8, 24), rng.randrange(8, 24))
    valid = np.array([[rng.random() > 0.2 for _ in range(shape[1])] for _ in range(shape[0])])
    return Raster(values(rng, shape, dtype), valid, cell, left, top, **more)


def classes(rng: random.Random, grid: Grid) -> Raster:
    names = rng.sample(CLASSES, 4)
    made = raster(rng, "u1", grid, names={number + 1: name for number, name in enumerate(names)})
    made.stored = (1 + made.stored % 4).astype("u1")
    return made


def pair(rng: random.Random, number: int) -> tuple[str, Raster, Raster]:
    """Returns a pair that differs in the property selected by its number, at nearby positions."""
    here = (10.0, 500000.0, 5200000.0)
    shift = (10.0 * rng.randrange(-15, 16), 10.0 * rng.randrange(-15, 16))
    aligned = (10.0, here[1] + shift[0], here[2] + shift[1])
    kind = ["extent", "type", "scale", "fine scale", "unit", "classes", "coarser", "finer", "part of a cell", "other cells", "classes off the grid", "system"][number % 12]
    any_type = rng.choice(TYPES)
    if kind == "extent":
        return kind, raster(rng, any_type, here), raster(rng, any_type, aligned)
    if kind == "type":
        return kind, raster(rng, any_type, here), raster(rng, rng.choice(TYPES), aligned)
    if kind == "scale":
        return kind, raster(rng, "i2", here, scale=0.1, offset=5.0), raster(rng, "i2", aligned, scale=rng.choice([0.1, 0.5, 1.0, 2.0]), offset=rng.choice([0.0, 5.0, -20.0]))
    if kind == "fine scale":
        return kind, raster(rng, "i2", here, scale=0.1), raster(rng, rng.choice(["i2", "u1"]), aligned, scale=rng.choice([0.01, 0.25, 0.03]))
    if kind == "unit":
        first, second = rng.choice([("m", "ft"), ("ft", "m"), ("m", ""), ("", "m"), ("m", "m")])
        return kind, raster(rng, "f4", here, unit=first), raster(rng, rng.choice(["f4", "i2"]), aligned, unit=second)
    if kind == "classes":
        return kind, classes(rng, here), classes(rng, aligned)
    if kind == "coarser":
        return kind, raster(rng, any_type, here), raster(rng, any_type, (20.0, here[1] + 20 * rng.randrange(-5, 6), here[2] + 20 * rng.randrange(-5, 6)))
    if kind == "finer":
        return kind, raster(rng, "f8", here), raster(rng, "f8", (5.0, here[1] + 10 * rng.randrange(-3, 4), here[2] + 10 * rng.randrange(-3, 4)))
    off = (here[1] + shift[0] + rng.choice([1.0, 3.0, 4.0, 7.0]), here[2] + shift[1] + rng.choice([-2.0, 1.0, 4.0]))
    if kind == "part of a cell":
        return kind, raster(rng, "f8", here), raster(rng, "f8", (10.0, *off))
    if kind == "other cells":
        return kind, raster(rng, "f8", here), raster(rng, "f8", (rng.choice([3.0, 7.0, 12.0, 17.0]), *off))
    if kind == "classes off the grid":
        return kind, classes(rng, here), classes(rng, (10.0, here[1] + shift[0] + 3.0, here[2] + shift[1] - 2.0))
    lon, lat = Transformer.from_crs(UTM, "EPSG:4326", always_xy=True).transform(here[1], here[2])
    return kind, raster(rng, "f8", here), Raster(values(rng, (30, 40), "f8"), np.ones((30, 40), bool), 0.0001, lon - 0.0005, lat + 0.0005, crs="EPSG:4326")


def check(directory: Path, kind: str, a: Raster, b: Raster) -> list[str]:
    wrong = []
    for name, one in (("a", a), ("b", b)):
        one.write(directory / f"{name}.tif")
        more = ["--kind", "categorical"] if one.is_classes else ["--kind", "continuous"]
        run("build", str(directory / f"{name}.tif"), "-o", str(directory / f"{name}.goblin"), *more)
    trees = [str(directory / "a.goblin"), str(directory / "b.goblin")]
    # For another coordinate system the first's extent is compared: cells beyond depend on how a box
    # is transformed.
    more = ["--extent", "a"] if a.crs != b.crs else []
    tolerance = 2e-2 if a.crs != b.crs else 1e-6
    for operation, result in expected(a, b).items():
        if operation == "diff":
            found = json.loads(run("diff", *trees, "--json", *more))
            found = {name: found[name] for name in ("added", "removed", "changed")}
            # Means that differ only in their last digits may count.
            few = 2 if kind in ("other cells", "part of a cell") else 0
            is_same = all(abs(found[name] - result[name]) <= (few if name == "changed" else 0) for name in result)
            if a.crs == b.crs and not is_same:
                wrong.append(f"diff {found}, expected {result}")
            continue
        out = directory / "out.goblin"
        out.unlink(missing_ok=True)
        run("combine", operation, *trees, "-o", str(out), *more)
        numbers, valid = result
        read = directory / "out.npy"
        run("get", str(out), str(read))
        found = np.load(read, allow_pickle=False)
        found = found.reshape(found.shape[-2:])
        facts = json.loads(run("info", str(out), "--json"))
        facts = facts["layers"][0] if "layers" in facts else facts
        stored = subprocess.run([SPINNEY, "-q", "get", str(out), str(directory / "out.tif")], capture_output=True, text=True)
        if stored.returncode:
            wrong.append(f"{operation}: {stored.stderr}")
            continue
        with rasterio.open(directory / "out.tif") as tif:
            cells, mask = tif.read(1), tif.read_masks(1) > 0
            scale, offset = tif.scales[0], tif.offsets[0]
        if cells.shape != numbers.shape:
            wrong.append(f"{operation}: {cells.shape} cells, expected {numbers.shape}")
            continue
        if (mask != valid).any():
            wrong.append(f"{operation}: {(mask != valid).sum()} cells are VOID in one of the two alone")
        both = mask & valid
        if a.is_classes:
            legend = {int(row["value"]): row["name"] for row in facts_of_classes(out)}
            labels = np.vectorize(lambda number: legend.get(int(number), ""), otypes=[object])(cells)
            differ = both & (labels != numbers)
        else:
            meaning = cells.astype(np.float64) * scale + offset
            differ = both & ~np.isclose(meaning, np.where(both, numbers, 0.0), rtol=tolerance, atol=tolerance)
        if differ.any():
            at = tuple(int(axis[0]) for axis in np.nonzero(differ))
            wrong.append(f"{operation}: {differ.sum()} of {both.sum()} cells differ, the first at {at}: {cells[at]} for {numbers[at]}")
    if kind in ("extent",):
        wrong += merged(directory, a, b)
    return wrong


def facts_of_classes(path: Path) -> list[dict[str, Any]]:
    rows = json.loads(run("stats", str(path), "--json"))
    rows = rows.get("classes", rows)
    return [{"value": row["value"], "name": row.get("name", "")} for row in rows]


def merged(directory: Path, a: Raster, b: Raster) -> list[str]:
    """Compares `over` with rasterio's merge of the two."""
    with rasterio.open(directory / "a.tif") as first, rasterio.open(directory / "b.tif") as second:
        cells, _ = merge([first, second], method="first")
        nodata = first.nodata
    run("combine", "over", str(directory / "a.goblin"), str(directory / "b.goblin"), "-o", str(directory / "merged.goblin"))
    run("get", str(directory / "merged.goblin"), str(directory / "merged.tif"))
    with rasterio.open(directory / "merged.tif") as tif:
        found, mask = tif.read(1), tif.read_masks(1) > 0
    is_same = cells[0].shape == found.shape and ((cells[0] != nodata) == mask).all() and (cells[0][mask] == found[mask]).all()
    return [] if is_same else ["over: not what rasterio.merge has"]


def main() -> None:
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    rng, failed, begin = random.Random(63), 0, time.process_time()
    kinds: dict[str, int] = {}
    for number in range(pairs):
        kind, a, b = pair(rng, number)
        with tempfile.TemporaryDirectory() as name:
            wrong = check(Path(name), kind, a, b)
        kinds[kind] = kinds.get(kind, 0) + 1
        if wrong:
            failed += 1
            print(f"pair {number}, {kind}, {a.stored.dtype} and {b.stored.dtype}: " + "; ".join(wrong))
    print(", ".join(f"{count} of {kind}" for kind, count in kinds.items()))
    print(f"{pairs - failed} of {pairs} pairs equal, {time.process_time() - begin:.0f} s in Python")
    rows = [
        row("pairs of rasters with the values of NumPy, rasterio and pyproj", f"of {pairs}", pairs - failed),
        row(f"{pairs} pairs of rasters, the script", "s", time.process_time() - begin),
    ]
    record("operations on rasters", rows)
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
