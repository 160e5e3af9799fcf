"""Building trees from arrays, raster files, models of solids and features."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _native
from ._dataset import Dataset, Level
from ._files import MEMORY
from ._meshes import is_mesh, mesh_columns, unit_of
from ._options import names_of, packing_of, refuse, time_of
from ._progress import memory_of, working
from ._remote import path_of
from ._sources import feature_file, paths_of
from ._stack import layers_of, one_layer, stack_layers
from ._times import text_of_time
from ._metadata import check_bands, colours_of, crs_text, numbers_of, pairs_of, strings_of
from ._types import Codec, Path, Progress, Resampling
from ._zonal import values_of

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
    kind: Literal["categorical", "continuous"] | Mapping[str, str] | None = None,
    rule: str | Mapping[str, str] | None = None,
    nodata: float | Mapping[str, float] | None = None,
    transform: Sequence[float] | npt.ArrayLike | None = None,
    crs: Any = None,
    depth: int | None = None,
    memory: int | str = MEMORY,
    share: bool = False,
    codec: Codec = "plain",
    max_error: float | None = None,
    time: int | None = None,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
    categories: Mapping[int, str] | Mapping[str, Mapping[int, str]] | None = None,
    colormap: Mapping[int, Sequence[int]] | Mapping[str, Mapping[int, Sequence[int]]] | None = None,
    descriptions: Sequence[str | None] | Mapping[str, Sequence[str | None]] | None = None,
    scales: Sequence[float] | Mapping[str, Sequence[float]] | None = None,
    offsets: Sequence[float] | Mapping[str, Sequence[float]] | None = None,
    units: Sequence[str | None] | Mapping[str, Sequence[str | None]] | None = None,
    tags: Mapping[str, str] | Mapping[str, Mapping[str, str]] | None = None,
    bands: Sequence[int | str] | None = None,
    layer: str | None = None,
    pages: int | Literal["layers", "z"] | None = None,
    stack: bool = False,
    names: Sequence[str] | None = None,
    times: Sequence[Any] | None = None,
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
    value: float | str | None = None,
    overlaps: Literal["last", "first", "min", "max", "sum", "count", "mean"] | None = None,
    width: float | str | None = None,
    fractions: bool = False,
    where: Mapping[str, Any] | str | None = None,
) -> None:
    """Builds a tree, `out`: a .goblin file, compact and read-only, or an .autumn file, which can be
    edited.

    The source is

    - a tree: a `Dataset` (also a view), a `Level` of one, or the path of a file. The new tree has
      the same cells, at every level of detail, and the same metadata, unless arguments replace it.
      With another `rule` coarser levels are recomputed.
    - an array, or anything that has `shape`, `dtype` and slices: NumPy (mapped files, too), Dask,
      zarr, h5py. It is read block by block. `dims` names its axes: `"yx"`, `"byx"` (the default for
      three axes, as in rasterio), `"yxb"`, or for octrees `"zyx"`, `"bzyx"`, `"zyxb"`. Cells are
      VOID where a masked array or `mask` is true, and where all bands have the number `nodata` or
      NaN. Booleans are classes, 0 and 1; octrees of them are solids. Cells that lack only some of
      their bands are refused; with a `nodata` these samples become that number.
    - an xarray DataArray. Its axes (`band`, `z`, `y`, `x`), transform, coordinate system, nodata
      number, scales, units, band and class names, kind and rule are read as written by rioxarray,
      the CF conventions and this package's engine; arguments take precedence. With an axis `time`
      each time becomes a layer that records it; with `stack` each band does.
    - an iterator of arrays, stacked vertically, which together have `shape` and `dtype`.
    - the path of a raster file (TIFF, PNG, JPEG, WebP, OpenEXR, BMP, GIF, PNM, TGA, QOI, Radiance
      HDR, SRTM `.hgt`), or several of one grid (the last is on top). For these there are `bands`
      (by number or name), `layer` (of OpenEXR), `pages` (of TIFF, a page number from 0) and
      `keep_transparent`, and `grid`: "xyz" (with `max_zoom`) or a tree file, to whose cells they
      are warped (`resampling`, `allow_ballpark`).
    - with `stack`, paths of rasters whose bands become separate layers, as with `spinney build
      --stack`; `names` and `times` are those of the layers. Rasters on other grids are warped
      (`resampling`, `allow_ballpark`). `pages="layers"` makes a layer of each page, `pages="z"` a
      volume.
    - a mapping of names to arrays (or DataArrays, or all to paths), each of which becomes a layer
      with its own type and mask. Smaller ones have cells 2, 4, 8 ... times as large. `nodata`,
      `kind`, `rule`, `mask`, `units`, `categories` and the like apply to all layers, or are
      mappings by layer name; `transform` is that of the finest cells. With `stack`, arrays in a
      list and the bands of an array are layers, too. `times`, as datetime64 or ISO 8601 strings,
      are acquisition times.
    - an open rasterio dataset, whose bands, masks, georeferencing and names become those of the
      tree, or with `stack` of its layers; an xarray Dataset, whose variables are the bands, or with
      `stack`, or an axis `time`, the layers.
    - the path of a volume, an NPY or NRRD file; with `pages="z"` paths of images, or of a directory
      of images, each of which is a plane.
    - a mesh: a trimesh mesh, anything with `vertices` and `faces`, or a pair of arrays of these;
      see models.
    - paths of feature files (GeoJSON, FlatGeobuf, GeoPackage, shapefile, CSV), or anything with a
      `__geo_interface__` (a GeoDataFrame, shapely). Points, lines and polygons are rasterized, to
      cells of the width `cell` in units of their coordinates, to `cells` along the longer side, or
      to those of a `grid`; `value` (a number, or the name of an attribute), `overlaps`, `dtype`,
      `width` (of lines), `edge`, `fractions`, `where` (`"code=3,area>100"`) and `layer` are as for
      `spinney build`.
    - paths of models of solids (PLY, OBJ, STL, OFF, glTF, CityJSON): `cells` along the longest
      side, the width of a `cell`, or the cells of another octree (`grid`); `edge`, `attribute`,
      `shell`, `up` and `unit` are as for `spinney build`.

    `transform` has six numbers as in rasterio, or is a matrix of 3 x 4 or 4 x 4. `crs` is anything
    whose string is a definition: `"EPSG:4326"`, WKT, a CRS of rasterio or pyproj. `memory` is the
    limit in addition to the source itself. With the `codec` "packed" segments of a .goblin file are
    compressed, and unpacked when they are used. `time` is that of an .autumn file's first commit,
    in seconds since 1970. Its default is SOURCE_DATE_EPOCH if the environment has it, and otherwise
    none, so that equal sources give equal bytes. An output larger than `max_bytes` (`"2G"`) raises
    OSError. `threads` is by default one per processor; the file does not depend on their number.

    The output appears when it is complete. Ctrl-C or an error leaves no partial output.
    """
    size = memory_of(memory)
    if depth is not None and not 0 <= depth <= 64:
        raise ValueError(f"depth: got {depth}, expected a number of levels")
    system = crs_text(crs)
    conditions = where if isinstance(where, str | None) else ",".join(f"{name}={text}" for name, text in values_of(where))
    common: dict[str, Any] = {"kind": kind, "rule": rule, "nodata": nodata, "crs": system, "depth": depth, "memory": size, "share": share, "packing": packing_of(codec, max_error), "time": time_of(time)}
    for_files = {
        "bands": bands,
        "layer": layer,
        "pages": pages,
        "cells": cells,
        "cell": cell,
        "grid": None if grid is None else path_of(grid),
        "max_zoom": max_zoom,
        "resampling": resampling,
        "edge": edge,
        "attribute": attribute,
        "up": up,
        "unit": unit,
        "value": None if value is None else str(value),
        "overlaps": overlaps,
        "width": None if width is None else str(width),
        "where": conditions,
        "fractions": fractions or None,
    }
    seen = None if times is None else [time if isinstance(time, str) else text_of_time(time) for time in times]
    of_stacks = {"stack": stack or None, "names": names, "times": times}
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
    layers = layers_of(source, stack, (names, seen), dims, descriptions)
    if layers is not None:
        refuse("files", for_files)
        about = for_arrays | {"transform": transform}
        return stack_layers(layers, common, about).write(path_of(out), (progress, threads, max_bytes))
    by_layer = {"nodata": nodata, "kind": kind, "rule": rule, "descriptions": descriptions, "scales": scales, "offsets": offsets, "units": units}
    refuse("the layers of a stack, if it is given by layer name", {name: value for name, value in by_layer.items() if isinstance(value, Mapping)})
    if isinstance(source, Mapping) and not hasattr(source, "data_vars"):
        # (Files by the names of their layers.)
        source, names, stack = list(source.values()), names or [str(name) for name in source], True
    paths = paths_of(source)
    if paths is not None and any(map(_native.is_tree, paths)):
        if len(paths) > 1:
            raise ValueError("source: got a tree among several sources; spinney.combine overlays trees, spinney.add_layer adds one to a file")
        source = Dataset(paths[0], [], None, False, None)
    if hasattr(source, "__geo_interface__") and not is_mesh(source):
        refuse("arrays", for_arrays | {"transform": transform, "dtype": None})
        with feature_file(source, out) as (path, own):
            said: dict[str, Any] = {name: given for name, given in for_files.items() if name != "pages"} | {"value": value, "fractions": fractions, "dtype": dtype}
            return build(path, out, kind=kind, rule=rule, crs=own if crs is None else crs, depth=depth, memory=memory, share=share, codec=codec, max_error=max_error, time=time, max_bytes=max_bytes, threads=threads, progress=progress, **said)
    if isinstance(source, Level):
        source = source._as_tree()
    if isinstance(source, Dataset):
        of_cells = {"dims": dims, "shape": shape, "dtype": dtype, "mask": mask, "nodata": nodata}
        refuse("arrays; the cells of a tree are used unchanged", of_cells)
        refuse("files", for_files | of_stacks)
        for_tree = {name: common[name] for name in ("kind", "rule", "crs", "depth", "memory", "share", "packing", "time")} | {
            "transform": None if transform is None else numbers_of(transform),
            "categories": None if categories is None else dict(categories),
            "colormap": colours_of(colormap),
            "descriptions": strings_of(descriptions),
            "scale_offset": pairs_of(scales, offsets, source.scales, source.offsets),
            "units": strings_of(units),
            "tags": dict(tags or {}),
        }
        check_bands(for_tree, source.count)
        with working(progress, threads, max_bytes) as terms:
            return source._build(path_of(out), for_tree, terms)
    meshes = mesh_columns([(None, source)]) if is_mesh(source) else []
    if meshes:
        refuse("arrays", for_arrays | {"transform": transform})
        refuse("rasters", of_stacks)
        for_files["unit"] = unit or unit_of([(None, source)])
    if paths is not None or meshes:
        refuse("arrays", for_arrays | {"dtype": None})
        numbers = None if transform is None else numbers_of(transform)
        for_import = common | for_files | {"transform": numbers, "keep_transparent": keep_transparent, "shell": shell, "allow_ballpark": allow_ballpark, "fractions": bool(fractions)}
        for_import |= {"stack": stack, "names": None if names is None else names_of(names), "times": seen}
        for_import["bands"] = None if bands is None else list(bands)
        for_import["sample"] = None if dtype is None else np.dtype(dtype).name
        for_import["referenced"] = None
        with working(progress, threads, max_bytes) as terms:
            return _native.build_files(paths or [], meshes, path_of(out), for_import, terms)
    if isinstance(source, list | tuple) and any(isinstance(part, Dataset) for part in source):
        raise TypeError("source: got a tree among several sources; spinney.combine overlays trees")
    refuse("files", for_files)
    refuse("stacks", {"names": names, "times": times})
    one_layer(source, common, for_arrays | {"transform": transform}).write(path_of(out), (progress, threads, max_bytes))
