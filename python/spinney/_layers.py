"""Layers of a file as variables of an xarray dataset, along times, or as bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from xarray.core import indexing

from ._cells import Cells, Series, void_of
from ._dataset import Dataset
from ._stack import USUAL
from ._times import group_of, time_of_text
from .xarray import _attributes, _dataset_of, _meaning, decoded, masks_of


def trees_of(first: Dataset) -> dict[str, Dataset]:
    """Returns all layers of a tree's file."""
    # (An only layer without a name is the tree itself.)
    return {name: first[name] if name else first for name in first.names}


def dataset_of_layers(trees: Mapping[str, Dataset], level: int | None, layers: str | None, mask_and_scale: bool | None) -> xr.Dataset:
    """Returns all layers of a file as one dataset."""
    if layers not in (None, "time", "band", "variable"):
        raise ValueError(f"layers: got {layers!r}, expected 'time', 'band' or 'variable'")
    wanted = max(tree.depth for tree in trees.values()) if level is None else level
    if layers == "band":
        return _bands(trees, wanted, mask_and_scale)
    series = {} if layers == "variable" else _series_of(trees)
    if layers is None and all(len(names) == 1 for names in series.values()):
        # (A single time becomes an axis only on request.)
        series = {}
    if layers == "time" and not series:
        path = next(iter(trees.values())).path
        raise ValueError(f"{path}: its layers have no times, or differ in other properties; omit layers to have variables")
    made = _Variables(wanted, [*trees, *(group or USUAL for group in series)])
    taken: set[str] = set()
    # (In layer order.)
    for name in trees:
        group = next((group for group, names in series.items() if name in names), None)
        if group is None:
            made.add(name, _dataset_of(trees[name], min(wanted, trees[name].depth), void_of(trees[name]), mask_and_scale), trees[name])
        elif group not in taken:
            taken.add(group)
            members = [trees[name] for name in series[group]]
            made.add(group or USUAL, _along(members, wanted, "time", _times_of(members), mask_and_scale), members[0])
    return xr.Dataset(made.variables, made.coordinates, made.attributes)


_AXES = ("time", "band", "z", "y", "x", "spatial_ref")
"""Names of coordinates, which no variable may have."""


class _Variables:
    """Variables of a dataset that is assembled."""

    def __init__(self, wanted: int, names: Sequence[str]) -> None:
        self.wanted = wanted
        self.names = {*names, *_AXES}
        self.variables: dict[str, Any] = {}
        self.coordinates: dict[str, Any] = {}
        self.attributes: dict[str, Any] = {}

    def add(self, name: str, made: xr.Dataset, tree: Dataset) -> None:
        """Adds the variable of a single-variable dataset."""
        cells = made[USUAL]
        if "band" in cells.dims and tree.count == 1:
            cells = cells.isel(band=0, drop=True)
        # (Cells of another size have other coordinates, even if another grid has equally many.)
        own = min(self.wanted, tree.depth)
        sizes = {axis: self.coordinates[axis].sizes[axis] for axis in ("z", "y", "x") if axis in self.coordinates and self.coordinates[axis].ndim}
        differs = own != self.wanted or any(axis in cells.dims and cells.sizes[axis] != size for axis, size in sizes.items())
        renamed: dict[str, str] = {axis: self.free(f"{axis}_{name}") for axis in ("z", "y", "x") if axis in cells.dims} if differs else {}
        if "band" in cells.dims and "band" in self.coordinates and self.coordinates["band"].size != cells.sizes["band"]:
            renamed["band"] = self.free(f"band_{name}")
        cells = cells.rename(renamed)
        if "time" in cells.coords and "time" not in cells.dims:
            # (Other layers have other times.)
            cells = cells.drop_vars("time")
            cells.attrs["time"] = tree.time
        if not self.attributes:
            self.attributes = dict(made.attrs)
        for axis, values in cells.coords.items():
            self.coordinates.setdefault(str(axis), values)
        self.variables[self.free(name) if name in _AXES else name] = cells.variable

    def free(self, name: str) -> str:
        """Returns an unused name, derived from this one."""
        while name in self.names:
            name += "_"
        self.names.add(name)
        return name


def _series_of(trees: Mapping[str, Dataset]) -> dict[str, list[str]]:
    """Returns names of layers in order of time, by their names without times; nothing if they do
    not form one time axis.
    """
    groups: dict[str, list[str]] = {}
    for name, tree in trees.items():
        if time_of_text(tree.time) is not None:
            groups.setdefault(group_of(name, str(tree.time)), []).append(name)
    if not groups or any(group in trees for group in groups if group not in groups[group]):
        return {}
    for names in groups.values():
        names.sort(key=lambda name: _times_of([trees[name]])[0])
    axes = []
    for names in groups.values():
        members = [trees[name] for name in names]
        times = _times_of(members)
        if len(np.unique(times)) < len(times) or any(_alike(tree) != _alike(members[0]) for tree in members):
            return {}
        axes.append(times)
    return groups if all(np.array_equal(times, axes[0]) for times in axes) else {}


def _times_of(trees: Sequence[Dataset]) -> Any:
    return np.array([time_of_text(tree.time) for tree in trees], dtype="M8[ns]")


def _alike(tree: Dataset) -> Any:
    """Returns what all layers along an axis must have in common: types, georeferencing, and the
    meaning of numbers.
    """
    facts = tree._facts()
    return (
        (tree.dtype, tree.count, tree.depth, tree.shape, tree.kind, tree.rule, tree.crs, tree.matrix.tolist()),
        (tree.categories, tree.colormap, tree.units, tree.scales, tree.offsets, facts["alpha"]),
    )


def _along(trees: Sequence[Dataset], wanted: int, axis: str, positions: Any, mask_and_scale: bool | None) -> xr.Dataset:
    """Returns layers with equal properties as one variable, along a new axis."""
    level, void = min(wanted, trees[0].depth), void_of(*trees)
    first = _dataset_of(trees[0], level, void, False)
    like = first[USUAL]
    if trees[0].count == 1:
        like = like.isel(band=0, drop=True)
    cells = Series([Cells(tree, level, void) for tree in trees])
    each = [_attributes(tree) | _meaning(tree, level, void) for tree in trees]
    attrs = {key: value for key, value in like.attrs.items() if all(str(other.get(key)) == str(value) for other in each)}
    attrs.pop("time", None)
    chunks = {axis: 1} | {name: like.encoding["preferred_chunks"][name] for name in like.dims}
    encoding = {"preferred_chunks": chunks, "grid_mapping": "spatial_ref"}
    variable = xr.Variable((axis, *like.dims), indexing.LazilyIndexedArray(cells), attrs, encoding)
    coordinates = {name: values for name, values in like.coords.items() if name not in (axis, "time")}
    made = xr.Dataset({USUAL: variable}, coordinates | {axis: (axis, positions)}, first.attrs)
    return decoded(made) if masks_of(trees[0], mask_and_scale) else made


def _bands(trees: Mapping[str, Dataset], wanted: int, mask_and_scale: bool | None) -> xr.Dataset:
    """Returns all layers along an axis of bands, with their names."""
    first = next(iter(trees.values()))
    for name, tree in trees.items():
        about = (tree.dtype, tree.count, tree.shape, tree.kind)
        if about != (first.dtype, first.count, first.shape, first.kind) or tree.count > 1:
            size = " x ".join(map(str, reversed(tree.shape)))
            raise ValueError(
                f"{first.path}: `{name}` has {size} cells of {tree.count} x {tree.dtype}, {tree.kind}: layers as bands have one band each, and one "
                "size, type and kind; omit layers to have variables"
            )
    members = list(trees.values())
    if any(_scaling(tree) != _scaling(first) for tree in members):
        raise ValueError(f"{first.path}: scales and offsets of its layers differ; omit layers to have variables")
    made = _along(members, wanted, "band", np.array(list(trees), dtype=np.str_), mask_and_scale)
    times = [time_of_text(tree.time) for tree in members]
    if all(time is not None for time in times):
        made = made.assign_coords(time=("band", np.array(times, dtype="M8[ns]")))
    return made


def _scaling(tree: Dataset) -> Any:
    return tree.scales, tree.offsets, tree.categories
