"""Trees of arrays, picture files and models of solids."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _native
from ._files import MEMORY
from ._progress import memory_of, telling
from ._types import Array, Path, Progress

Dims = Literal["yx", "byx", "yxb", "zyx", "bzyx", "zyxb"]
"""Axes of an array, in order: bands, planes, rows, columns."""


def build(
    source: Any,
    out: Path,
    *,
    dims: Dims | None = None,
    shape: tuple[int, ...] | None = None,
    dtype: npt.DTypeLike | None = None,
    mask: Any = None,
    kind: Literal["categorical", "continuous"] | None = None,
    rule: str | None = None,
    nodata: float | None = None,
    transform: Sequence[float] | npt.ArrayLike | None = None,
    crs: Any = None,
    depth: int | None = None,
    memory: int | str = MEMORY,
    share: bool = False,
    progress: Progress = None,
    categories: Mapping[int, str] | None = None,
    colormap: Mapping[int, Sequence[int]] | None = None,
    descriptions: Sequence[str | None] | None = None,
    scales: Sequence[float] | None = None,
    offsets: Sequence[float] | None = None,
    units: Sequence[str | None] | None = None,
    tags: Mapping[str, str] | None = None,
    bands: Sequence[int] | None = None,
    layer: str | None = None,
    keep_transparent: bool = False,
    cells: int | None = None,
    cell: float | None = None,
    like: Path | None = None,
    boundary: Literal["full", "centre", "coverage"] | None = None,
    attribute: Literal["occupancy", "colour", "part"] | None = None,
    surface: bool = False,
    up: Literal["y", "z"] | None = None,
    unit: str | None = None,
) -> None:
    """Makes a tree, `out`: a .goblin file, compact and read-only, or an .autumn file, which can be edited.

    The source is

    - an array, or anything that has `shape`, `dtype` and slices: NumPy (mapped files, too), Dask, zarr, h5py. It is read
      block by block. `dims` names its axes: `"yx"`, `"byx"` (the usual of three axes, as rasterio has them), `"yxb"`, or of
      octrees `"zyx"`, `"bzyx"`, `"zyxb"`. Cells are VOID where a masked array or `mask` is true, where all bands have the
      number `nodata`, and where any is NaN. Octrees of booleans are solids.
    - a DataArray of xarray, which tells its axes (`band`, `z`, `y`, `x`), transform, coordinate system, nodata number, scale and
      class names itself, as rioxarray and this package's engine have them.
    - an iterator of arrays, one below the other, which together have `shape` and `dtype`.
    - the path of a picture file, or several of one grid (the last lies on top); `bands`, `layer` and `keep_transparent` are
      for these.
    - paths of models of solids (PLY, OBJ, STL, OFF, CityJSON): `cells` along the longest side or the width of a `cell` or
      those of another octree (`like`), and `boundary`, `attribute`, `surface`, `up` and `unit` as `spinney build` has them.

    `transform` has six numbers as rasterio's, or is a matrix of 3 x 4 or 4 x 4; `crs` anything whose text is a definition:
    `"EPSG:4326"`, WKT, a CRS of rasterio or pyproj. `memory` is what may be used beyond the source itself.

    The output appears when it is complete. Ctrl-C, and whatever else goes wrong, leaves nothing behind.
    """
    size = memory_of(memory)
    if depth is not None and not 0 <= depth <= 64:
        raise ValueError(f"depth: {depth}, expected a number of levels")
    system = crs_text(crs)
    common: dict[str, Any] = {"kind": kind, "rule": rule, "nodata": nodata, "crs": system, "depth": depth, "memory": size, "share": share}
    for_files = {
        "bands": bands,
        "layer": layer,
        "cells": cells,
        "cell": cell,
        "like": like,
        "boundary": boundary,
        "attribute": attribute,
        "up": up,
        "unit": unit,
    }
    for_arrays = {
        "dims": dims,
        "shape": shape,
        "dtype": dtype,
        "mask": mask,
        "categories": categories,
        "colormap": colormap,
        "descriptions": descriptions,
        "scales": scales,
        "offsets": offsets,
        "units": units,
        "tags": tags,
    }
    paths = paths_of(source)
    if paths is not None:
        _refuse("arrays", for_arrays)
        six = None if transform is None else _six(transform)
        for_import = common | for_files | {"transform": six, "keep_transparent": keep_transparent, "surface": surface}
        for_import["bands"] = None if bands is None else list(bands)
        with telling(progress) as tell:
            return _native.build_files(paths, os.fspath(out), for_import, tell)
    _refuse("files", for_files)
    if hasattr(source, "dims") and hasattr(source, "coords"):
        from .xarray import described

        told = described(source)
        source = source.variable
        # (What is said here counts.)
        dims, kind, nodata = dims or told["dims"], kind or told["kind"], told["nodata"] if nodata is None else nodata
        transform = told["transform"] if transform is None else transform
        common |= {"kind": kind, "nodata": nodata, "crs": system or crs_text(told["crs"])}
        categories = categories or told["categories"]
        scales, offsets = scales or told["scales"], offsets or told["offsets"]
    array = _Blocks(source, dims, shape, dtype, mask)
    if array.is_solid:
        common["rule"] = common["rule"] or "occupancy"
    pairs = None
    if scales is not None or offsets is not None:
        pairs = list(zip(scales or [1.0] * array.channels, offsets or [0.0] * array.channels))
    options: dict[str, Any] = common | {
        "extent": array.extent,
        "octree": array.axes == 3,
        "dtype": array.dtype.name,
        "channels": array.channels,
        "in_order": array.in_order,
        "transform": None if transform is None else _numbers(transform),
        "categories": dict(categories or {}),
        "colormap": _colours(colormap),
        "descriptions": [name or "" for name in descriptions or []],
        "scale_offset": pairs or [],
        "units": [name or "" for name in units or []],
        "tags": dict(tags or {}),
    }
    for name in ("descriptions", "scale_offset", "units"):
        if len(options[name]) not in (0, array.channels):
            raise ValueError(f"{name}: {len(options[name])} given, the array has {array.channels} bands")
    with telling(progress) as tell:
        _native.build_array(array.read, os.fspath(out), options, tell)


def paths_of(source: Any) -> list[str] | None:
    """Names of files, if the source is that."""
    if isinstance(source, str | os.PathLike):
        return [str(os.fspath(source))]
    if isinstance(source, list | tuple) and source and all(isinstance(s, str | os.PathLike) for s in source):
        return [str(os.fspath(path)) for path in source]
    return None


def _refuse(what: str, options: dict[str, Any]) -> None:
    for name, value in options.items():
        if value is not None:
            raise TypeError(f"{name}: is for {what}")


def crs_text(crs: Any) -> str | None:
    """The definition of a coordinate system, from text or what rasterio and pyproj have."""
    if crs is None or isinstance(crs, str):
        return crs
    if isinstance(crs, int):
        return f"EPSG:{crs}"
    number = crs.to_epsg() if hasattr(crs, "to_epsg") else None
    if number is not None:
        return f"EPSG:{number}"
    if hasattr(crs, "to_wkt"):
        return str(crs.to_wkt())
    raise TypeError(f"crs: expected text, a number or an object with a definition, got {crs!r}")


def _numbers(transform: Any) -> list[float]:
    """Six numbers, or those of three rows of a matrix."""
    numbers = np.asarray(transform, dtype=float)
    if numbers.ndim == 1 and len(numbers) == 9:
        # (As `affine.Affine` has them: the last row says nothing.)
        numbers = numbers[:6]
    if numbers.shape == (4, 4):
        numbers = numbers[:3]
    if numbers.shape not in ((6,), (3, 4)):
        raise ValueError(f"transform: expected six numbers, or a matrix of 3 x 4 or 4 x 4, got {transform!r}")
    return [float(number) for number in numbers.ravel()]


def _six(transform: Any) -> list[float]:
    numbers = _numbers(transform)
    if len(numbers) != 6:
        raise ValueError("transform: pictures take six numbers")
    return numbers


def _colours(colormap: Mapping[int, Sequence[int]] | None) -> list[list[int]] | None:
    if not colormap:
        return None
    if not 0 <= min(colormap) <= max(colormap) < 65536:
        raise ValueError("colormap: values are 0 to 65535")
    colours = [[0, 0, 0, 0] for _ in range(max(colormap) + 1)]
    for value, colour in colormap.items():
        channels = [int(channel) for channel in colour]
        if len(channels) not in (3, 4) or not all(0 <= channel <= 255 for channel in channels):
            raise ValueError(f"colormap: {colour!r}, expected red, green, blue and perhaps opacity, 0 to 255")
        colours[value] = channels if len(channels) == 4 else [*channels, 255]
    return colours


class _Blocks:
    """An array that is read block by block, with bands last and of a type that trees have."""

    def __init__(
        self,
        source: Any,
        dims: str | None,
        shape: tuple[int, ...] | None,
        dtype: npt.DTypeLike | None,
        mask: Any,
    ) -> None:
        self.in_order = not hasattr(source, "shape")
        if self.in_order:
            if shape is None or dtype is None:
                if isinstance(source, Iterator):
                    raise TypeError("build: an iterator of arrays needs shape and dtype")
                if not isinstance(source, Iterable):
                    raise TypeError(f"build: expected an array, paths or an iterator of arrays, got {source!r}")
                source = np.asarray(source)
                self.in_order = False
            else:
                source = _Bands(iter(source), tuple(shape), np.dtype(dtype))
        elif shape is not None:
            raise TypeError("shape: is for iterators of arrays")
        elif dtype is not None:
            raise TypeError("dtype: is for iterators of arrays")
        self.source = source
        self.mask = mask
        full = tuple(int(length) for length in source.shape)
        self.dims = dims or _usual_dims(full)
        if len(self.dims) != len(full) or self.dims not in ("yx", "byx", "yxb", "zyx", "bzyx", "zyxb"):
            raise ValueError(f"dims: {self.dims!r} does not fit an array of shape {full}")
        if self.in_order and self.dims not in ("yx", "yxb", "zyx", "zyxb"):
            raise ValueError("dims: iterators hand out rows (or planes) with bands last: 'yx', 'yxb', 'zyx' or 'zyxb'")
        sizes = dict(zip(self.dims, full))
        self.axes = 3 if "z" in sizes else 2
        self.channels = sizes.get("b", 1)
        if not 1 <= self.channels <= 4:
            octree = " (an octree is dims='zyx')" if self.dims == "byx" else ""
            raise ValueError(f"array of shape {full}: {self.channels} bands, 1 to 4 can be kept{octree}")
        if min(full) < 1:
            raise ValueError(f"array of shape {full}: there are no cells")
        self.extent = [sizes["x"], sizes["y"], sizes.get("z", 1)]
        given = np.dtype(source.dtype)
        self.is_solid = given == np.bool_ and self.axes == 3 and self.channels == 1
        wider = {"bool": "uint8", "int8": "int16", "float16": "float32"}
        self.dtype = np.dtype(wider.get(given.name, given.name)).newbyteorder("=")
        if mask is not None and tuple(np.shape(mask)) != tuple(reversed(self.extent[: self.axes])):
            raise ValueError(f"mask: has the shape {np.shape(mask)}, the cells {self.extent[: self.axes][::-1]}")

    def read(self, origin: list[int], size: list[int]) -> tuple[Array, npt.NDArray[np.bool_] | None]:
        """The samples of a block, and flags of those that are not VOID."""
        along = {name: slice(first, first + cells) for name, first, cells in zip("xyz", origin, size)}
        block = self.source[tuple(along.get(name, slice(None)) for name in self.dims)]
        flags: Any = None
        if isinstance(block, np.ma.MaskedArray):
            hidden = np.ma.getmaskarray(block)
            flags = ~(hidden.all(axis=self.dims.index("b")) if "b" in self.dims else hidden)
            block = block.data
        array = np.asarray(block)
        if "b" in self.dims:
            array = np.moveaxis(array, self.dims.index("b"), -1)
        samples = np.ascontiguousarray(array, dtype=self.dtype)
        if self.is_solid:
            inside = samples != 0
            flags = inside if flags is None else flags & inside
            samples = samples * np.uint8(255)
        if self.mask is not None:
            cut = self.mask[tuple(along[name] for name in "zyx"[3 - self.axes :])]
            shown = ~np.asarray(cut, dtype=bool)
            flags = shown if flags is None else flags & shown
        wanted = (*reversed(size[: self.axes]), *([self.channels] if "b" in self.dims else []))
        if samples.shape != wanted:
            raise ValueError(f"the source gave a block of shape {samples.shape}, expected {wanted}")
        return samples, None if flags is None else np.ascontiguousarray(flags)


def _usual_dims(shape: tuple[int, ...]) -> str:
    usual: dict[int, str] = {2: "yx", 3: "byx", 4: "bzyx"}
    if len(shape) not in usual:
        raise ValueError(f"array of shape {shape}: expected 2, 3 or 4 axes")
    return usual[len(shape)]


class _Bands:
    """Arrays that come one below the other, as one array that is read from the top down."""

    def __init__(self, parts: Iterator[Any], shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        self.parts = parts
        self.shape = shape
        self.dtype = dtype
        self.row = 0
        self.rest: Any = None

    def __getitem__(self, key: tuple[slice, ...]) -> Any:
        rows = key[0]
        if rows.start != self.row:
            raise RuntimeError("bands are read from the top down")
        wanted = rows.stop - rows.start
        taken: list[Any] = []
        have = 0
        while have < wanted:
            part = self.rest if self.rest is not None else next(self.parts, None)
            self.rest = None
            if part is None:
                raise ValueError(f"the iterator ended after {self.row + have} of {self.shape[0]} rows")
            part = part if isinstance(part, np.ma.MaskedArray) else np.asarray(part)
            if part.shape[1:] != self.shape[1:] or part.dtype != self.dtype:
                raise ValueError(
                    f"the iterator gave {part.dtype} of shape {part.shape}, expected {self.dtype} of "
                    f"shape (n, {', '.join(map(str, self.shape[1:]))})"
                )
            fits = part[: wanted - have]
            if len(part) > len(fits):
                self.rest = part[len(fits) :]
            taken.append(fits)
            have += len(fits)
        self.row = rows.stop
        if self.row == self.shape[0] and (self.rest is not None or next(self.parts, None) is not None):
            raise ValueError(f"the iterator gave more than {self.shape[0]} rows")
        if len(taken) == 1:
            return taken[0]
        join: Callable[[list[Any]], Any] = (
            np.ma.concatenate if any(isinstance(part, np.ma.MaskedArray) for part in taken) else np.concatenate
        )
        return join(taken)
