"""Trees of arrays, picture files, models of solids and features."""

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
from ._metadata import check_bands, colours_of, crs_text, numbers_of, pairs_of, texts_of
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
      them. What is said here counts. Of one with an axis `time` each time becomes a layer, which tells it; with `stack` each band.
    - an iterator of arrays, one below the other, which together have `shape` and `dtype`.
    - the path of a raster file (TIFF, PNG, JPEG, WebP, OpenEXR, BMP, GIF, PNM, TGA, QOI, Radiance HDR, SRTM `.hgt`), or several of one grid (the last
      lies on top); `bands` (by number or name), `layer` (of OpenEXR), `pages` (of TIFF, the number of one from 0) and `keep_transparent` are for these, and `grid`: "xyz" (with `max_zoom`) or a tree file, to whose cells they are warped (`resampling`, `allow_ballpark`).
    - with `stack`, paths whose bands become layers beside each other, as `spinney build --stack` has them: `names` and `times` are theirs, and those on
      other grids are warped (`resampling`, `allow_ballpark`). `pages="layers"` makes a layer of each page, `pages="z"` a volume.
    - a mapping of names to arrays (or DataArrays, or all to paths), each of which becomes a layer with a type and a mask of its own.
      Smaller ones have cells 2, 4, 8 ... times as large. `nodata`, `kind`, `rule`, `mask`, `units`, `categories` and the like are for all
      of them, or mappings of names to what each has; `transform` is that of the finest cells. With `stack`, arrays in a list and
      the bands of an array are layers, too. `times`, as datetime64 or as ISO 8601 writes them, are those of what they show.
    - an open dataset of rasterio, whose bands, masks, place and names are those of the tree, or with `stack` of its layers; a Dataset of
      xarray, whose variables are the bands, or with `stack`, or an axis `time`, the layers.
    - the path of a volume, an NPY or NRRD file; with `pages="z"` paths of pictures, or of a folder of pictures, each of which is a plane.
    - a mesh: one of trimesh, anything with `vertices` and `faces`, or a pair of arrays of these; see models.
    - paths of files of features (GeoJSON, FlatGeobuf, GeoPackage, shapefile, CSV), or anything with a `__geo_interface__` (a GeoDataFrame,
      shapely): points, lines and polygons become the cells that they have, of the width `cell` in units of their coordinates, `cells` along
      the longer side, or those of a `grid`; with `value` (a number, or the name of an attribute), `overlaps`, `dtype`, `width` (of lines), `edge`, `fractions`, `where`
      (`"code=3,area>100"`) and `layer` as `spinney build` has them.
    - paths of models of solids (PLY, OBJ, STL, OFF, CityJSON): `cells` along the longest side or the width of a `cell` or
      those of another octree (`grid`), and `edge`, `attribute`, `shell`, `up` and `unit` as `spinney build` has them.

    `transform` has six numbers as rasterio's, or is a matrix of 3 x 4 or 4 x 4; `crs` anything whose text is a definition:
    `"EPSG:4326"`, WKT, a CRS of rasterio or pyproj. `memory` is what may be used beyond the source itself.
    With the `codec` "packed" segments of a .goblin file take few bytes, and are unpacked when they are used.
    `time` is that of the commit that an .autumn file begins with, in seconds since the beginning of 1970: that of SOURCE_DATE_EPOCH, if the
    environment has it, and otherwise none, so that the same source makes the same bytes. An output that would have more than `max_bytes`
    (`"2G"`) is an OSError. `threads` work on it, one for each processor if nothing is said; the file is the same whatever their number.

    The output appears when it is complete. Ctrl-C, and whatever else goes wrong, leaves nothing behind.
    """
    size = memory_of(memory)
    if depth is not None and not 0 <= depth <= 64:
        raise ValueError(f"depth: {depth}, expected a number of levels")
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
    refuse("the layers of a stack, if it is said by their names", {name: value for name, value in by_layer.items() if isinstance(value, Mapping)})
    if isinstance(source, Mapping) and not hasattr(source, "data_vars"):
        # (Files by the names of their layers.)
        source, names, stack = list(source.values()), names or [str(name) for name in source], True
    paths = paths_of(source)
    if paths is not None and any(map(_native.is_tree, paths)):
        if len(paths) > 1:
            raise ValueError("a tree as a source is the only one; spinney.combine lays trees over each other, spinney.add_layer adds one to a file")
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
        refuse("arrays; the cells of a tree are taken as they are", of_cells)
        refuse("files", for_files | of_stacks)
        for_tree = {name: common[name] for name in ("kind", "rule", "crs", "depth", "memory", "share", "packing", "time")} | {
            "transform": None if transform is None else numbers_of(transform),
            "categories": None if categories is None else dict(categories),
            "colormap": colours_of(colormap),
            "descriptions": texts_of(descriptions),
            "scale_offset": pairs_of(scales, offsets, source.scales, source.offsets),
            "units": texts_of(units),
            "tags": dict(tags or {}),
        }
        check_bands(for_tree, source.count)
        with working(progress, threads, max_bytes) as terms:
            return source._build(path_of(out), for_tree, terms)
    meshes = mesh_columns([(None, source)]) if is_mesh(source) else []
    if meshes:
        refuse("arrays", for_arrays | {"transform": transform})
        refuse("pictures", of_stacks)
        for_files["unit"] = unit or unit_of([(None, source)])
    if paths is not None or meshes:
        refuse("arrays", for_arrays | {"dtype": None})
        numbers = None if transform is None else numbers_of(transform)
        for_import = common | for_files | {"transform": numbers, "keep_transparent": keep_transparent, "shell": shell, "allow_ballpark": allow_ballpark, "fractions": bool(fractions)}
        for_import |= {"stack": stack, "names": None if names is None else names_of(names), "times": seen}
        for_import["bands"] = None if bands is None else list(bands)
        for_import["sample"] = None if dtype is None else np.dtype(dtype).name
        with working(progress, threads, max_bytes) as terms:
            return _native.build_files(paths or [], meshes, path_of(out), for_import, terms)
    if isinstance(source, list | tuple) and any(isinstance(part, Dataset) for part in source):
        raise TypeError("a tree as a source is the only one; spinney.combine lays trees over each other")
    refuse("files", for_files)
    refuse("stacks", {"names": names, "times": times})
    one_layer(source, common, for_arrays | {"transform": transform}).write(path_of(out), (progress, threads, max_bytes))
