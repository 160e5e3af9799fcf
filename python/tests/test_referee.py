"""Random stacks against NumPy: cells, windows, levels, statistics, and the independence of
layers.
"""

from __future__ import annotations

import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import run

import spinney

TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64")


@dataclass
class Layer:
    name: str
    cells: np.ndarray
    valid: np.ndarray
    nodata: Any
    coarser: int
    kind: str
    rule: str

    @property
    def masked(self) -> np.ma.MaskedArray:
        return np.ma.array(self.cells, mask=~self.valid)


def random_cells(random: np.random.Generator, dtype: np.dtype, shape: tuple[int, int]) -> np.ndarray:
    """Returns samples of a type, from few values or from all; patches of one value give all kinds
    of nodes.
    """
    if dtype.kind == "f":
        cells = random.normal(0, 10.0 ** random.integers(-3, 6), shape).astype(dtype)
    else:
        limits, few = np.iinfo(dtype), random.random() < 0.5
        low, high = (max(limits.min, -3), 9) if few else (limits.min, limits.max)
        cells = random.integers(low, high, shape, dtype=dtype, endpoint=True)
    for _ in range(random.integers(0, 6)):
        y, x = (random.integers(0, length) for length in shape)
        cells[y : y + random.integers(1, 60), x : x + random.integers(1, 60)] = cells[y, x]
    return cells


def random_layer(random: np.random.Generator, name: str, shape: tuple[int, int]) -> Layer:
    dtype = np.dtype(TYPES[random.integers(len(TYPES))])
    coarser = int(random.choice([0, 0, 0, 1, 2]))
    cells = random_cells(random, dtype, tuple(-(-length >> coarser) for length in shape))  # type: ignore[arg-type]
    valid, nodata = np.ones(cells.shape, bool), None
    if random.random() < 0.5:
        valid &= random.random(cells.shape) > random.random()
    if random.random() < 0.5:
        y, x = (random.integers(0, length) for length in cells.shape)
        valid[y : y + random.integers(1, 80), x : x + random.integers(1, 80)] = False
    if random.random() < 0.5:
        nodata = cells.flat[0].item()
        valid &= cells != cells.dtype.type(nodata)
    if dtype.kind == "f" and random.random() < 0.5:
        cells[~valid] = np.nan
        valid &= ~np.isnan(cells)
    kind = "categorical" if dtype.kind != "f" and random.random() < 0.3 and len(np.unique(cells)) < 300 else "continuous"
    rule = "majority" if kind == "categorical" else str(random.choice(["mean", "mean", "min", "max"]))
    return Layer(name, cells, valid, nodata, coarser, kind, rule)


def random_stack(seed: int) -> list[Layer]:
    random = np.random.default_rng(seed)
    count = int(random.choice([1, 2, 3, 7, 40])) if seed else 40
    most = 60 if count == 40 else 300
    shape = tuple(int(length) for length in random.integers(8, most, 2))
    layers = [random_layer(random, f"layer {number}", shape) for number in range(count)]  # type: ignore[arg-type]
    # (At least one has the finest cells, which determine the positions of the others.)
    layers[0] = random_layer(random, "layer 0", shape) if layers[0].coarser == 0 else layers[0]  # type: ignore[arg-type]
    while layers[0].coarser:
        layers[0] = random_layer(random, "layer 0", shape)  # type: ignore[arg-type]
    return layers


def built(layers: list[Layer], path: Path, **more: Any) -> None:
    # (The numbers of masked cells do not matter.)
    spinney.build(
        {layer.name: layer.masked for layer in layers},
        path,
        nodata={layer.name: layer.nodata for layer in layers if layer.nodata is not None},
        kind={layer.name: layer.kind for layer in layers},  # type: ignore[arg-type]
        rule={layer.name: layer.rule for layer in layers},
        **more,
    )


def level_of(layer: Layer, shift: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the cells of a coarser level and whether they are not VOID."""
    side = 1 << shift
    height, width = (-(-length >> shift) for length in layer.cells.shape)
    values = np.zeros((height, width), layer.cells.dtype)
    valid = np.zeros((height, width), bool)
    for row in range(height):
        for column in range(width):
            part = np.s_[row * side : (row + 1) * side, column * side : (column + 1) * side]
            below = layer.cells[part][layer.valid[part]]
            if below.size:
                valid[row, column] = True
                whole = np.s_[row * side : row * side + side, column * side : column * side + side]
                values[row, column] = majority_of(layer, whole, side) if layer.rule == "majority" else one_of(below, layer.rule)
    return values, valid


def majority_of(layer: Layer, part: tuple[slice, slice], side: int) -> Any:
    """Returns the most frequent class of a node; None if it has no cells. Ties are decided by the
    first child that has one of them, or by a hash of all children.
    """
    found: np.ndarray = layer.cells[part][layer.valid[part]]
    if not found.size or side == 1:
        return found.flat[0] if found.size else None
    half = side // 2
    quarters = [
        majority_of(layer, np.s_[row : row + half, column : column + half], half)
        for row in (part[0].start, part[0].start + half)
        for column in (part[1].start, part[1].start + half)
    ]
    children = [child for child in quarters if child is not None]
    classes, counts = np.unique(found, return_counts=True)
    tied = classes[counts == counts.max()]
    for child in children:
        if child in tied:
            return child
    mixed = int(counts.max())
    for child in children:
        raw = np.asarray(child).tobytes().ljust(8, b"\0")
        mixed = (mixed ^ int.from_bytes(raw, "little")) * 0x9E3779B97F4A7C15 % 2**64
        mixed ^= mixed >> 32
    return tied[mixed % len(tied)]


def one_of(below: np.ndarray, rule: str) -> Any:
    if rule != "mean":
        return getattr(below, rule)()
    if below.dtype.kind == "f":
        return below.astype(np.float64).mean()
    total, count = sum(below.tolist()), below.size
    return (2 * total + count) // (2 * count)


def close(found: np.ndarray, wanted: np.ndarray) -> bool:
    if wanted.dtype.kind != "f":
        return np.array_equal(found, wanted)
    rtol = 3e-7 if wanted.dtype == np.float32 else 1e-12
    return np.allclose(found, wanted, rtol=rtol, atol=rtol * (np.abs(wanted).max() if wanted.size else 0))


def check(ds: spinney.Dataset, layer: Layer, random: np.random.Generator) -> None:
    assert (ds.dtype, ds.shape, ds.kind, ds.rule) == (layer.cells.dtype, layer.cells.shape, layer.kind, layer.rule)
    if layer.nodata is not None:
        assert ds.nodata == layer.nodata and type(ds.nodata) is type(layer.nodata)
    read = ds.read(1, masked=True)
    assert np.array_equal(np.ma.getmaskarray(read), ~layer.valid)
    assert np.array_equal(read.data[layer.valid], layer.cells[layer.valid])
    height, width = layer.cells.shape
    for _ in range(4):
        y, x = int(random.integers(0, height)), int(random.integers(0, width))
        h, w = int(random.integers(1, height - y + 1)), int(random.integers(1, width - x + 1))
        part = np.s_[y : y + h, x : x + w]
        window = ds.read(1, window=(x, y, w, h), masked=True)
        assert np.array_equal(window.mask, ~layer.valid[part]) and np.array_equal(window.compressed(), layer.cells[part][layer.valid[part]])
        check_statistics(ds.stats((x, y, w, h)), layer, layer.cells[part][layer.valid[part]], h * w)
    for shift in range(1, ds.depth + 1, 1 if height * width < 5000 else 3):
        values, valid = level_of(layer, shift)
        level = ds.depth - shift
        found = ds.read(1, level=level, masked=True)
        assert found.shape == values.shape and np.array_equal(np.ma.getmaskarray(found), ~valid), shift
        assert close(found.data[valid], values[valid]), shift
        # A window at the level: its cells are those that the window touches.
        rows, columns = sorted(random.integers(0, values.shape[0], 2)), sorted(random.integers(0, values.shape[1], 2))
        part = np.s_[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1]
        first = columns[0] << shift, rows[0] << shift
        last = min((columns[1] + 1) << shift, width), min((rows[1] + 1) << shift, height)
        window = ds.read(1, window=(*first, last[0] - first[0], last[1] - first[1]), level=level, masked=True)
        assert np.array_equal(np.ma.getmaskarray(window), ~valid[part])
        assert np.array_equal(window.compressed(), found[part].compressed())


def check_statistics(stats: spinney.Statistics, layer: Layer, cells: np.ndarray, count: int) -> None:
    assert (stats.cells, stats.void_cells) == (cells.size, count - cells.size)
    if not cells.size:
        assert stats.bands == () and stats.classes == {}
        return
    assert (stats.min, stats.max) == (cells.min().item(), cells.max().item())
    numbers = [int(number) for number in cells.tolist()] if cells.dtype.kind != "f" else cells.astype(np.float64).tolist()
    mean = sum(numbers) / len(numbers)
    scale = max(map(abs, numbers)) or 1
    assert abs(stats.mean - mean) <= 1e-12 * scale
    std = (sum((number - mean) ** 2 for number in numbers) / len(numbers)) ** 0.5
    assert abs(stats.std - std) <= 1e-7 * scale
    if layer.kind == "categorical":
        classes, counts = np.unique(cells, return_counts=True)
        assert stats.classes == dict(zip(classes.tolist(), counts.tolist()))


@pytest.mark.parametrize("seed", range(8))
def test_stacks_of_arrays(tmp_path: Path, seed: int) -> None:
    layers, random = random_stack(seed), np.random.default_rng(100 + seed)
    path = tmp_path / ("s.autumn" if seed % 2 else "s.goblin")
    built(layers, path)
    with spinney.open(path) as ds:
        assert ds.names == [layer.name for layer in layers]
        for layer in layers:
            check(ds[layer.name], layer, random)
    assert spinney.verify(path) == []


@pytest.mark.parametrize("seed", range(20, 24))
def test_stacks_of_files(tmp_path: Path, program: str, seed: int) -> None:
    rasterio = pytest.importorskip("rasterio")
    layers, random = random_stack(seed), np.random.default_rng(seed)
    paths = []
    for number, layer in enumerate(layers):
        # (The program needs kind and rule for all layers, and a file needs a number for VOID, which
        # a float must represent exactly.)
        layer.kind, layer.rule, number_of_void = "continuous", "mean", 0 if layer.nodata is None else layer.nodata
        if layer.cells.dtype.itemsize == 8 and layer.cells.dtype.kind != "f":
            number_of_void = int(layer.cells.dtype.type(0))
        number_of_void = layer.cells.dtype.type(number_of_void).item()
        layer.cells[~layer.valid] = number_of_void
        layer.nodata = number_of_void
        layer.valid = layer.cells != layer.cells.dtype.type(number_of_void)
        paths.append(tmp_path / f"layer {number}.tif")
        height, width = layer.cells.shape
        step = 10.0 * 2**layer.coarser
        about = {"driver": "GTiff", "height": height, "width": width, "count": 1, "dtype": layer.cells.dtype, "nodata": number_of_void}
        about |= {"compress": str(random.choice(["none", "deflate", "zstd"])), "tiled": bool(number % 2)}
        if number % 2:
            about |= {"blockxsize": 64, "blockysize": 64}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with rasterio.open(paths[-1], "w", crs="EPSG:32628", transform=rasterio.Affine(step, 0, 5e5, 0, -step, 4e6), **about) as file:
                file.write(layer.cells, 1)
    out = tmp_path / "s.goblin"
    run(program, "-q", "build", *paths, "-o", out, "--stack", "--kind", "continuous")
    with spinney.open(out) as ds:
        for layer in layers:
            check(ds[layer.name] if len(layers) > 1 else ds, layer, random)
    assert spinney.verify(out) == []


def runs(path: Path) -> dict[str, bytes]:
    """Returns the bytes of the layers of a Goblin file, with their segment indexes, as defined in
    formats.md.
    """
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, len(data) - 16)
    trailer = data[-16 - length : -16]
    (sections,) = struct.unpack_from("<I", trailer, 32)
    positions = [struct.unpack_from("<4sIQQ", trailer, 36 + 24 * number) for number in range(sections)]
    ((start, size),) = [(start, size) for tag, _, start, size in positions if tag == b"LAYR"]
    (layers,) = struct.unpack_from("<I", data, 16)
    found, name_at = {}, start + 152 * layers
    for entry in range(start, start + 152 * layers, 152):
        (name_length,) = struct.unpack_from("<H", data, entry + 54)
        first, bytes_ = struct.unpack_from("<QQ", data, entry + 88)
        found[data[name_at : name_at + name_length].decode()] = data[first : first + bytes_]
        name_at += name_length
    assert name_at == start + size
    return found


@pytest.mark.parametrize("seed", [1, 2, 3, 5, 6])
def test_layers_know_nothing_of_each_other(tmp_path: Path, seed: int) -> None:
    layers = random_stack(seed)[:9]
    path, alone = tmp_path / "s.goblin", tmp_path / "alone.goblin"
    built(layers, path)
    together = runs(path)
    assert list(together) == [layer.name for layer in layers]
    for layer in layers:
        built([layer], alone)
        assert runs(alone) == {layer.name: together[layer.name]}, layer
        # Independent of memory and the number of threads.
        built([layer], alone, memory="4M", threads=1)
        assert runs(alone) == {layer.name: together[layer.name]}
    # Layers that are removed and added again (on cells that others have, too).
    if any(layer.coarser == 0 for layer in layers[1:]):
        before, moved = path.read_bytes(), layers[0]
        spinney.convert(f"{path}:{moved.name}", alone)
        spinney.drop_layer(path, moved.name)
        assert runs(path) == {name: bytes_ for name, bytes_ in together.items() if name != moved.name}
        spinney.add_layer(path, alone, moved.name)
        assert runs(path) == together
        built([*layers[1:], moved], alone)
        assert path.read_bytes() != before and runs(path) == runs(alone)
        # And after conversion to the other format and back.
        spinney.convert(path, tmp_path / "s.autumn")
        spinney.convert(tmp_path / "s.autumn", alone)
        assert runs(alone) == together
    assert spinney.verify(path) == []
