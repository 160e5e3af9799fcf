"""Trees of arrays, picture files and models of solids."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _native
from ._blocks import Blocks
from ._dataset import Dataset, Level
from ._files import MEMORY
from ._options import refuse, time_of
from ._progress import memory_of, working
from ._sources import RasterioArray, is_mesh, is_rasterio, mesh_file, one_array, paths_of
from ._types import Path, Progress, Resampling

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
    time: int | None = None,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
    categories: Mapping[int, str] | None = None,
    colormap: Mapping[int, Sequence[int]] | None = None,
    descriptions: Sequence[str | None] | None = None,
    scales: Sequence[float] | None = None,
    offsets: Sequence[float] | None = None,
    units: Sequence[str | None] | None = None,
    tags: Mapping[str, str] | None = None,
    bands: Sequence[int | str] | None = None,
    layer: str | None = None,
    pages: int | None = None,
    keep_transparent: bool = False,
    cells: int | None = None,
    cell: float | None = None,
    grid: Literal["xyz"] | Path | None = None,
    max_zoom: int | None = None,
    resampling: Resampling | None = None,
    allow_ballpark: bool = False,
    edge: Literal["centre", "touch", "area"] | None = None,
    attribute: Literal["occupancy", "colour", "part"] | None = None,
    shell: bool = False,
    up: Literal["y", "z"] | None = None,
    unit: str | None = None,
) -> None:
    """Makes a tree, `out`: a .goblin file, compact and read-only, or an .autumn file, which can be edited.

    The source is

    - a tree: a `Dataset`, also a view, a `Level` of one, or the path of a file. The new one has the same cells, at every level of
      detail, and tells the same about them; what is said here counts. With another `rule` coarser levels are made anew.
    - an array, or anything that has `shape`, `dtype` and slices: NumPy (mapped files, too), Dask, zarr, h5py. It is read
      block by block. `dims` names its axes: `"yx"`, `"byx"` (the usual of three axes, as rasterio has them), `"yxb"`, or of
      octrees `"zyx"`, `"bzyx"`, `"zyxb"`. Cells are VOID where a masked array or `mask` is true, and where all bands have the
      number `nodata` or NaN. Booleans are classes, 0 and 1; octrees of them are solids. Cells that lack some of their bands,
      and not all, are refused; with a `nodata` these samples become that number.
    - a DataArray of xarray, which tells its axes (`band`, `z`, `y`, `x`), transform, coordinate system, nodata number, scales,
      units, names of bands and classes, kind and rule itself, as rioxarray, the CF conventions and this package's engine have
      them. What is said here counts.
    - an iterator of arrays, one below the other, which together have `shape` and `dtype`.
    - the path of a picture file, or several of one grid (the last lies on top); `bands` (by number or name), `layer` (of OpenEXR),
      `pages` (of TIFF, the number of one from 0) and `keep_transparent` are for these, and `grid`: "xyz" (with `max_zoom`) or a tree file, to whose cells they are warped (`resampling`, `allow_ballpark`).
    - an open dataset of rasterio, whose bands, masks, place and names are those of the tree; a Dataset of xarray, whose variables
      are the bands.
    - the path of a volume, an NPY file.
    - a mesh: one of trimesh, anything with `vertices` and `faces`, or a pair of arrays of these; see models.
    - paths of models of solids (PLY, OBJ, STL, OFF, CityJSON): `cells` along the longest side or the width of a `cell` or
      those of another octree (`grid`), and `edge`, `attribute`, `shell`, `up` and `unit` as `spinney build` has them.

    `transform` has six numbers as rasterio's, or is a matrix of 3 x 4 or 4 x 4; `crs` anything whose text is a definition:
    `"EPSG:4326"`, WKT, a CRS of rasterio or pyproj. `memory` is what may be used beyond the source itself.
    `time` is that of the commit that an .autumn file begins with, in seconds since the beginning of 1970: that of SOURCE_DATE_EPOCH, if the
    environment has it, and otherwise none, so that the same source makes the same bytes. An output that would have more than `max_bytes`
    (`"2G"`) is an OSError. `threads` work on it, one for each processor if nothing is said; the file is the same whatever their number.

    The output appears when it is complete. Ctrl-C, and whatever else goes wrong, leaves nothing behind.
    """
    size = memory_of(memory)
    if depth is not None and not 0 <= depth <= 64:
        raise ValueError(f"depth: {depth}, expected a number of levels")
    system = crs_text(crs)
    common: dict[str, Any] = {"kind": kind, "rule": rule, "nodata": nodata, "crs": system, "depth": depth, "memory": size, "share": share, "time": time_of(time)}
    for_files = {
        "bands": bands,
        "layer": layer,
        "pages": pages,
        "cells": cells,
        "cell": cell,
        "grid": None if grid is None else os.fspath(grid),
        "max_zoom": max_zoom,
        "resampling": resampling,
        "edge": edge,
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
    if paths is not None and any(map(_native.is_tree, paths)):
        if len(paths) > 1:
            raise ValueError("a tree as a source is the only one; spinney.combine lays trees over each other")
        source = Dataset(paths[0], [], None, False, None)
    if isinstance(source, Level):
        source = source._as_tree()
    if isinstance(source, Dataset):
        of_cells = {"dims": dims, "shape": shape, "dtype": dtype, "mask": mask, "nodata": nodata}
        refuse("arrays; the cells of a tree are taken as they are", of_cells)
        refuse("files", for_files)
        for_tree = {name: common[name] for name in ("kind", "rule", "crs", "depth", "memory", "share", "time")} | {
            "transform": None if transform is None else _numbers(transform),
            "categories": None if categories is None else dict(categories),
            "colormap": _colours(colormap),
            "descriptions": _texts(descriptions),
            "scale_offset": _pairs(scales, offsets, source.scales, source.offsets),
            "units": _texts(units),
            "tags": dict(tags or {}),
        }
        _check_bands(for_tree, source.count)
        with working(progress, threads, max_bytes) as terms:
            return source._build(os.fspath(out), for_tree, terms)
    if is_mesh(source):
        refuse("arrays", for_arrays)
        with mesh_file(source, out) as (path, told_unit):
            given: dict[str, Any] = {**for_files, "unit": unit or told_unit, "shell": shell, "threads": threads, "progress": progress}
            return build(path, out, rule=rule, kind=kind, crs=crs, depth=depth, memory=memory, share=share, time=time, max_bytes=max_bytes, **given)
    if paths is not None:
        refuse("arrays", for_arrays)
        numbers = None if transform is None else _numbers(transform)
        for_import = common | for_files | {"transform": numbers, "keep_transparent": keep_transparent, "shell": shell, "allow_ballpark": allow_ballpark}
        for_import["bands"] = None if bands is None else list(bands)
        with working(progress, threads, max_bytes) as terms:
            return _native.build_files(paths, os.fspath(out), for_import, terms)
    if isinstance(source, list | tuple) and any(isinstance(part, Dataset) for part in source):
        raise TypeError("a tree as a source is the only one; spinney.combine lays trees over each other")
    refuse("files", for_files)
    told: dict[str, Any] = {}
    if hasattr(source, "data_vars"):
        source = one_array(source)
    if is_rasterio(source):
        source = RasterioArray(source)
        told = source.told()
    elif hasattr(source, "dims") and hasattr(source, "coords"):
        from .xarray import described

        told = described(source)
        source = source.variable
    if told:
        dims = dims or told["dims"]
        if nodata is not None:
            told["void_number"] = None
        # (What is said here counts.)
        nodata = told["nodata"] if nodata is None else nodata
        transform = told["transform"] if transform is None else transform
        if kind is None or kind == told["kind"]:
            kind, rule = told["kind"], rule or told["rule"]
        elif np.dtype(source.dtype).kind == "f":
            told["dtype"] = None
        common |= {"kind": kind, "rule": rule, "nodata": nodata, "crs": system or crs_text(told["crs"])}
        categories = told["categories"] if categories is None else categories
        colormap = told["colormap"] if colormap is None else colormap
        descriptions = told["descriptions"] if descriptions is None else descriptions
        units = told["units"] if units is None else units
        scales = told["scales"] if scales is None else scales
        offsets = told["offsets"] if offsets is None else offsets
        tags = {**told["tags"], **(tags or {})}
    array = Blocks(source, dims, shape, dtype, mask, nodata, told)
    if array.is_solid:
        common["rule"] = common["rule"] or "occupancy"
    elif array.is_mask:
        common["kind"] = common["kind"] or "categorical"
    options: dict[str, Any] = common | {
        "extent": array.extent,
        "octree": array.axes == 3,
        "dtype": array.dtype.name,
        "channels": array.channels,
        "in_order": array.in_order,
        "transform": None if transform is None else _numbers(transform),
        "void_number": told.get("void_number"),
        "alpha": told.get("alpha"),
        "categories": dict(categories or {}),
        "colormap": _colours(colormap),
        "descriptions": _texts(descriptions) or [],
        "scale_offset": _pairs(scales, offsets, (1.0,) * array.channels, (0.0,) * array.channels) or [],
        "units": _texts(units) or [],
        "tags": dict(tags or {}),
    }
    _check_bands(options, array.channels)
    with working(progress, threads, max_bytes) as terms:
        _native.build_array(array.read, os.fspath(out), options, terms)


def _texts(texts: Sequence[str | None] | None) -> list[str] | None:
    return None if texts is None else [text or "" for text in texts]


def _pairs(
    scales: Sequence[float] | None, offsets: Sequence[float] | None, usual_scales: Any, usual_offsets: Any
) -> list[tuple[float, float]] | None:
    """Scales and offsets by band; nothing if neither is given."""
    if scales is None and offsets is None:
        return None
    scales, offsets = usual_scales if scales is None else scales, usual_offsets if offsets is None else offsets
    if len(scales) != len(offsets):
        raise ValueError(f"scales and offsets: {len(scales)} and {len(offsets)} given")
    return [(float(scale), float(offset)) for scale, offset in zip(scales, offsets)]


def _check_bands(options: dict[str, Any], bands: int) -> None:
    for name in ("descriptions", "scale_offset", "units"):
        if options[name] is not None and len(options[name]) not in (0, bands):
            raise ValueError(f"{name}: {len(options[name])} given, there are {bands} bands")


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
