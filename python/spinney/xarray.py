"""Trees as lazy datasets of xarray.

`xarray.open_dataset("map.goblin", engine="spinney")` opens the cells, or those of a coarser `level=`, as the variable
`band_data` with the axes `band`, (`z`,) `y` and `x`, as rioxarray's engine does: coordinates are those of cells' centres, the
coordinate system is where rioxarray looks for it, `chunks={}` makes Dask arrays whose chunks are the file's segments. All
levels at once are a tree of datasets: `open_levels(path)`, or `xarray.open_datatree(path, engine="spinney")`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray, BackendEntrypoint
from xarray.core import indexing

from ._dataset import Dataset, open
from ._types import Path

SEGMENT = {2: 1024, 3: 128}
"""Cells along a side of what is read together, by number of axes."""


class SpinneyBackendEntrypoint(BackendEntrypoint):
    """Opens .goblin and .autumn files, also commits of these (`map.autumn@3`)."""

    description = "Goblin and Autumnal trees, at any level of detail"
    url = ""
    open_dataset_parameters = (
        "filename_or_obj",
        "drop_variables",
        "level",
        "view",
        "commit",
        "positioned",
        "mask_and_scale",
    )
    supports_groups = True

    def open_dataset(
        self,
        filename_or_obj: Any,
        *,
        drop_variables: str | Iterable[str] | None = None,
        level: int | None = None,
        view: str | Sequence[str] = (),
        commit: int | None = None,
        positioned: bool = False,
        mask_and_scale: bool | None = None,
    ) -> xr.Dataset:
        """The cells of a level. VOID becomes NaN and scales are applied if `mask_and_scale` is set, which by default it
        is for amounts, and not for classes."""
        tree = open(filename_or_obj, view=view, commit=commit, positioned=positioned)
        made = _dataset_of(tree, tree.depth if level is None else level, _fill_of(tree), mask_and_scale)
        made.set_close(tree.close)
        return made.drop_vars(drop_variables or [], errors="ignore")

    def open_groups_as_dict(
        self,
        filename_or_obj: Any,
        *,
        drop_variables: str | Iterable[str] | None = None,
        view: str | Sequence[str] = (),
        commit: int | None = None,
        positioned: bool = False,
        mask_and_scale: bool | None = None,
    ) -> dict[str, xr.Dataset]:
        """The levels as groups, named by their numbers."""
        tree = open(filename_or_obj, view=view, commit=commit, positioned=positioned)
        root = xr.Dataset(attrs=_attributes(tree))
        root.set_close(tree.close)
        groups, fill = {"/": root}, _fill_of(tree)
        for level in range(tree.levels):
            made = _dataset_of(tree, level, fill, mask_and_scale)
            groups[f"/{level}"] = made.drop_vars(drop_variables or [], errors="ignore")
        return groups

    def open_datatree(self, filename_or_obj: Any, **options: Any) -> xr.DataTree:
        """The levels as a tree of datasets, named by their numbers."""
        return xr.DataTree.from_dict(self.open_groups_as_dict(filename_or_obj, **options))

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Whether the name is that of a tree file."""
        if not isinstance(filename_or_obj, str | os.PathLike):
            return False
        return re.search(r"\.(goblin|autumn)(@\d+)?$", str(os.fspath(filename_or_obj))) is not None


def open_levels(path: Path, **options: Any) -> xr.DataTree:
    """All levels of a tree, `"0"` (one cell) to the cells, as datasets; options are those of `open_dataset`."""
    return SpinneyBackendEntrypoint().open_datatree(path, **options)


class _Cells(BackendArray):
    """The cells of a level with an axis for bands, read when they are asked for."""

    def __init__(self, tree: Dataset, level: int) -> None:
        self.tree = tree
        self.level = level
        self.shape = (tree.count, *tree._shape_at(level))
        self.dtype = tree.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._read)

    def _read(self, key: tuple[Any, ...]) -> Any:
        band, *cells = key
        found = np.asarray(self.tree._at_index(self.level, tuple(cells)))
        return (found[np.newaxis] if self.tree.count == 1 else found)[band]


def _fill_of(tree: Dataset) -> float | None:
    """The number that stands for VOID; none where nothing is VOID, and in solids, where 0 is empty."""
    has_void = tree.rule != "occupancy" and (tree.nodata is not None or tree._statistics()["void_cells"] > 0)
    return tree.fill_value if has_void else None


def _dataset_of(tree: Dataset, level: int, fill: float | None, mask_and_scale: bool | None) -> xr.Dataset:
    cells = _Cells(tree, level)
    axes = ("band", "z", "y", "x") if tree.ndim == 3 else ("band", "y", "x")
    attrs: dict[str, Any] = {}
    facts = tree._facts()
    classes: dict[int, str] = facts["categories"]
    if classes:
        attrs["flag_values"] = np.array(list(classes), dtype=tree.dtype)
        attrs["flag_meanings"] = " ".join(re.sub(r"\s+", "_", name.strip()) or "_" for name in classes.values())
    names = [name for name in tree.descriptions if name]
    if names:
        attrs["long_name"] = names[0] if tree.count == 1 else tuple(name or "" for name in tree.descriptions)
    units = {unit for unit in tree.units if unit}
    if len(units) == 1:
        attrs["units"] = units.pop()
    if fill is not None:
        attrs["_FillValue"] = tree.dtype.type(fill)
    scales, offsets = set(tree.scales), set(tree.offsets)
    if len(scales) == 1 and len(offsets) == 1 and (scales, offsets) != ({1.0}, {0.0}):
        attrs["scale_factor"], attrs["add_offset"] = scales.pop(), offsets.pop()
    side = SEGMENT[tree.ndim]
    chunks = {"band": tree.count} | {
        axis: min(side, length) for axis, length in zip(axes[1:], cells.shape[1:])
    }
    encoding = {"preferred_chunks": chunks, "grid_mapping": "spatial_ref"}
    variable = xr.Variable(axes, indexing.LazilyIndexedArray(cells), attrs, encoding)
    coordinates: dict[str, Any] = {"band": ("band", np.arange(1, tree.count + 1))}
    coordinates |= _centres(tree, level, cells.shape)
    coordinates["spatial_ref"] = ((), 0, _reference(tree, level))
    made = xr.Dataset({"band_data": variable}, coordinates, _attributes(tree) | {"level": level})
    masks = facts["kind"] == "continuous" if mask_and_scale is None else mask_and_scale
    if masks:
        made = xr.decode_cf(made, mask_and_scale=True, decode_times=False, decode_coords=False)
    return made


def _attributes(tree: Dataset) -> dict[str, Any]:
    return {name: text for name, text in tree.tags.items() if isinstance(name, str)}


def _centres(tree: Dataset, level: int, shape: tuple[int, ...]) -> dict[str, Any]:
    """Coordinates of cells' centres, where each depends on one axis alone."""
    matrix = tree.matrix[: tree.ndim, : tree.ndim]
    if np.any(matrix != np.diag(np.diag(matrix))):
        return {}
    scale = 2.0 ** (tree.depth - level)
    made = {}
    for axis, name in enumerate("xyz"[: tree.ndim]):
        centres = (np.arange(shape[-1 - axis]) + 0.5) * scale * matrix[axis, axis] + tree.matrix[axis, 3]
        made[name] = (name, centres, {"axis": name.upper()})
    return made


def described(array: xr.DataArray) -> dict[str, Any]:
    """What a DataArray tells about itself, as arguments of `spinney.build`."""
    names = {"band": "b", "z": "z", "y": "y", "x": "x", "lat": "y", "lon": "x", "latitude": "y", "longitude": "x"}
    try:
        dims = "".join(names[str(name)] for name in array.dims)
    except KeyError as error:
        raise ValueError(f"axis {error} of the DataArray: expected band, z, y and x; transpose and rename them") from None
    attrs, encoding = array.attrs, array.encoding
    both = {**attrs, **encoding}
    mapping = array.coords.get(both.get("grid_mapping", "spatial_ref"))
    told: dict[str, Any] = {"dims": dims, "kind": None, "crs": None, "categories": None, "scales": None, "offsets": None}
    if mapping is not None:
        told["crs"] = mapping.attrs.get("crs_wkt") or mapping.attrs.get("spatial_ref")
    told["transform"] = _transform_of(array, dims)
    fill = attrs.get("_FillValue", encoding.get("_FillValue", attrs.get("nodata")))
    told["nodata"] = None if fill is None or np.isnan(fill) or "_FillValue" not in attrs else float(fill)
    if "flag_values" in attrs and "flag_meanings" in attrs:
        values, meanings = np.atleast_1d(attrs["flag_values"]), str(attrs["flag_meanings"]).split()
        told["categories"] = {int(value): name.replace("_", " ") for value, name in zip(values, meanings)}
        told["kind"] = "categorical"
    if "scale_factor" in attrs or "add_offset" in attrs:
        bands = array.sizes.get("band", 1)
        told["scales"] = [float(attrs.get("scale_factor", 1.0))] * bands
        told["offsets"] = [float(attrs.get("add_offset", 0.0))] * bands
    return told


def _transform_of(array: xr.DataArray, dims: str) -> list[Any] | None:
    """The map from cells to the world by coordinates of cells' centres; `None` if there are none."""
    steps, starts = [], []
    for name in "xyz"[: 3 if "z" in dims else 2]:
        axis = array.dims[dims.index(name)]
        if axis not in array.coords or not np.issubdtype(array.coords[axis].dtype, np.number):
            return None
        centres = np.asarray(array.coords[axis], dtype=float)
        step = (centres[-1] - centres[0]) / (len(centres) - 1) if len(centres) > 1 else 1.0
        wanted = centres[0] + step * np.arange(len(centres))
        if not np.allclose(centres, wanted, rtol=0, atol=abs(step) * 1e-3):
            raise ValueError(f"coordinates {axis!r} of the DataArray: not evenly spaced; resample them first")
        steps.append(step)
        starts.append(centres[0] - step / 2)
    if len(steps) == 2:
        return [steps[0], 0.0, starts[0], 0.0, steps[1], starts[1]]
    return [[*row, start] for row, start in zip(np.diag(steps).tolist(), starts)]


def _reference(tree: Dataset, level: int) -> dict[str, Any]:
    """Attributes of the coordinate system, as rioxarray and GDAL have them."""
    a, b, c, d, e, f = tree.level(level).transform
    attrs: dict[str, Any] = {"GeoTransform": " ".join(map(repr, map(float, (c, a, b, f, d, e))))}
    text = tree.crs
    if text is None:
        return attrs
    try:
        from pyproj import CRS
        from pyproj.exceptions import CRSError
    except ImportError:
        return attrs | ({"crs_wkt": text, "spatial_ref": text} if "[" in text and not text.startswith("{") else {})
    try:
        cf = CRS.from_user_input(text).to_cf()
    except CRSError:
        return attrs
    return cf | {"spatial_ref": cf["crs_wkt"]} | attrs
