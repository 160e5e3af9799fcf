"""Stacks: arrays as separate layers of one file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _native
from ._blocks import Blocks, usual_dims
from ._options import refuse
from ._progress import working
from ._meshes import is_mesh
from ._remote import is_path
from ._sources import is_rasterio, rasterio_layers
from ._times import short_of, text_of_time
from ._metadata import array_options
from ._types import Progress

USUAL = "band_data"
"""The name of an xarray variable without its own name."""

_BY_BAND = ("descriptions", "units", "scales", "offsets")
"""Arguments with a value for each band."""


class ArrayLayer(NamedTuple):
    """An array that becomes a layer."""

    name: str
    group: str
    """The name of the array or variable that it belongs to, by which options can be given."""
    array: Any
    seen: str | None = None
    """Acquisition time."""
    band: int | None = None
    """Its index from 0 among bands with per-band options."""


class _OneBand:
    """A band of an array that is read block by block."""

    def __init__(self, source: Any, axis: int, band: int) -> None:
        self.source, self.axis, self.band = source, axis, band
        self.shape = tuple(length for number, length in enumerate(source.shape) if number != axis)
        self.dtype = source.dtype

    def __getitem__(self, key: tuple[Any, ...]) -> Any:
        return self.source[(*key[: self.axis], self.band, *key[self.axis :])]


def layers_of(
    source: Any, stack: bool, labels: tuple[Sequence[str] | None, Sequence[str] | None], dims: str | None, descriptions: Any
) -> list[ArrayLayer] | None:
    """Returns the layers of a source in memory: from a mapping of names, arrays in a list, bands,
    variables, or times. Returns `None` for other sources: one tree, or files. `labels` are names
    and times of all layers.
    """
    if hasattr(source, "data_vars"):
        variables = {str(name): array for name, array in source.data_vars.items() if array.ndim >= 2}
        if not stack and not any(map(_time_axis, variables.values())):
            return None
        found = [layer for name, array in variables.items() for layer in _parts_of(_own(name), array, stack)]
    elif isinstance(source, Mapping):
        parts = {str(name): part for name, part in source.items()}
        if parts and all(map(is_path, parts.values())):
            return None
        found = [layer for name, array in parts.items() for layer in _parts_of(name, array, stack)]
    elif hasattr(source, "dims") and hasattr(source, "coords"):
        if not stack and _time_axis(source) is None:
            return None
        found = list(_parts_of(_own(source.name), source, stack))
    elif not stack or is_path(source) or is_mesh(source):
        return None
    elif is_rasterio(source):
        found = [ArrayLayer(name, "", array) for name, array in rasterio_layers(source)]
    elif isinstance(source, list | tuple):
        if source and all(map(is_path, source)):
            return None
        found = [layer for number, part in enumerate(source) for layer in _parts_of(f"band_{number + 1}", part, stack)]
    elif all(hasattr(source, name) for name in ("shape", "dtype", "__getitem__")) and not isinstance(source, _native.Tree):
        found = _bands_of(source, dims, descriptions)
    else:
        raise TypeError(f"stack: expected paths, arrays by their names, or an array with bands, got {source!r}")
    if not found:
        raise ValueError("stack: got no layers, expected at least one")
    for what, strings in zip(("names", "times"), labels):
        if strings is not None and len(strings) != len(found):
            raise ValueError(f"{what}: got {len(strings)}, expected one for each of {len(found)} layers")
    names, times = labels
    if names is not None:
        found = [layer._replace(name=str(name)) for layer, name in zip(found, names)]
    if times is not None:
        found = [layer._replace(seen=time) for layer, time in zip(found, times)]
    known: set[str] = set()
    for layer in found:
        if not layer.name.strip() or layer.name in known:
            raise ValueError(f"names: got `{layer.name}`, expected a unique name for each layer; give them as names=")
        known.add(layer.name)
    return found


def _own(name: Any) -> str:
    """Returns the name of a variable, or an empty string if it has only the default name."""
    return "" if name is None or name == USUAL else str(name)


def _time_axis(array: Any) -> str | None:
    """Returns the time axis of a DataArray."""
    for axis in array.dims:
        if axis == "time" or (axis in array.coords and array.coords[axis].dtype.kind == "M"):
            return str(axis)
    return None


def _parts_of(name: str, array: Any, stack: bool) -> Iterator[ArrayLayer]:
    """Yields the layers of a named array: each time of a DataArray is one, and with `stack` each
    band.
    """
    if isinstance(array, _native.Tree) or hasattr(array, "_as_tree"):
        raise TypeError(f"{name}: is a tree; spinney.add_layer adds trees to a file unchanged")
    if is_path(array):
        raise TypeError(f"{name}: is a path among arrays, expected only paths or only arrays")
    if is_rasterio(array):
        for band, part in rasterio_layers(array):
            yield ArrayLayer(name if array.count == len(part.bands) else f"{name}_{band}", name, part)
        return
    if not (hasattr(array, "dims") and hasattr(array, "coords")):
        yield ArrayLayer(name or USUAL, name, array if hasattr(array, "shape") else np.asarray(array))
        return
    axis = _time_axis(array)
    if axis is None:
        for band, part in _named_bands(array, stack):
            yield ArrayLayer("_".join(filter(None, (name, band))) or USUAL, name, part)
        return
    times = array.coords[axis].values if axis in array.coords else np.empty(0)
    if times.dtype.kind != "M":
        raise ValueError(f"axis {axis!r} of the DataArray: expected coordinates of datetime64, got {times.dtype if times.size else 'none'}")
    for number, time in enumerate(times):
        seen = text_of_time(time)
        for band, part in _named_bands(array.isel({axis: number}), stack):
            yield ArrayLayer("_".join(filter(None, (name, band, short_of(seen)))), name, part.drop_vars(axis), seen)


def _named_bands(array: Any, stack: bool) -> Iterator[tuple[str, Any]]:
    """Yields the bands of a DataArray with their names, or the whole without a name."""
    if not stack or "band" not in array.dims:
        yield "", array
        return
    labels = array.coords["band"].values if "band" in array.coords else np.arange(1, array.sizes["band"] + 1)
    are_names = labels.dtype.kind not in "iuf"
    strings = array.attrs.get("long_name")
    for number, label in enumerate(labels):
        text = str(label) if are_names else ""
        if not text and isinstance(strings, tuple | list | np.ndarray) and len(strings) == len(labels):
            text = str(strings[number]).split(",")[0].strip()
        part = array.isel(band=number)
        # (Names and units are selected by number.)
        yield text or f"band_{label}", part.assign_coords(band=number + 1) if are_names else part


def _bands_of(array: Any, dims: str | None, descriptions: Any) -> list[ArrayLayer]:
    """Returns the bands of an array without axis names."""
    shape = tuple(int(length) for length in array.shape)
    dims = dims or usual_dims(shape)
    if len(dims) != len(shape):
        raise ValueError(f"dims: got {dims!r}, which does not match an array of shape {shape}")
    if "b" not in dims:
        return [ArrayLayer("band_1", "", array)]
    axis = dims.index("b")
    given = list(descriptions) if descriptions is not None and not isinstance(descriptions, Mapping) else []
    if given and len(given) != shape[axis]:
        raise ValueError(f"descriptions: got {len(given)}, expected one for each of {shape[axis]} bands")
    names = [str(text or "").split(",")[0].strip() for text in given] or [""] * shape[axis]
    return [ArrayLayer(text or f"band_{band + 1}", "", _OneBand(array, axis, band), None, band) for band, text in enumerate(names)]


class InputLayers(NamedTuple):
    """Array layers with all options: the native module's input for a file."""

    layers: list[dict[str, Any]]
    depth: int | None

    def write(self, out: str, terms: tuple[Progress, int | None, int | str | None]) -> None:
        """Builds the file."""
        progress, threads, max_bytes = terms
        with working(progress, threads, max_bytes) as work:
            _native.build_layers(self.layers, out, self.depth, work)


def one_layer(source: Any, common: Mapping[str, Any], about: Mapping[str, Any]) -> InputLayers:
    """Returns the only layer of a file; `common` and `about` are arguments of `spinney.build`."""
    array, options = array_options(source, common, about)
    return InputLayers([{"name": "", "read": array.read, "coarser": 0, "options": options}], common["depth"])


def stack_layers(layers: Sequence[ArrayLayer], common: Mapping[str, Any], about: Mapping[str, Any]) -> InputLayers:
    """Returns the layers of a file; `common` and `about` are arguments of `spinney.build`, for all
    layers or by name.
    """
    refuse("an iterator of arrays", {"shape": about["shape"], "dtype": about["dtype"]})
    known = {name for layer in layers for name in (layer.name, layer.group) if name}
    planned = [_planned(layer, common, about, known) for layer in layers]
    _place([options for _, options in planned], layers, about["transform"])
    made = [
        {"name": layer.name, "read": blocks.read, "coarser": options.pop("coarser"), "options": options}
        for layer, (blocks, options) in zip(layers, planned)
    ]
    return InputLayers(made, common["depth"])


def _planned(layer: ArrayLayer, common: Mapping[str, Any], about: Mapping[str, Any], known: set[str]) -> tuple[Blocks, dict[str, Any]]:
    """Returns the blocks of a layer, and its options."""
    own = {name: _of_layer(name, value, layer, known) for name, value in {**common, **about}.items()}
    # (The transform is common to all layers, and is that of the finest cells.)
    own["transform"] = None
    array = layer.array
    if isinstance(array, _OneBand):
        own["dims"] = (own["dims"] or usual_dims(tuple(array.source.shape))).replace("b", "")
        if own["mask"] is not None and np.ndim(own["mask"]) == len(array.source.shape):
            own["mask"] = _OneBand(own["mask"], array.axis, array.band)
        for name in _BY_BAND:
            if own[name] is not None and layer.band is not None:
                count = array.source.shape[array.axis]
                if len(own[name]) != count:
                    raise ValueError(f"{name}: got {len(own[name])}, expected one for each of {count} bands")
                own[name] = [own[name][layer.band]]
    blocks, options = array_options(array, {name: own[name] for name in common}, {name: own[name] for name in about})
    if about["transform"] is not None:
        options["transform"] = None
    options["seen"] = layer.seen or options["seen"]
    return blocks, options


def _of_layer(name: str, value: Any, layer: ArrayLayer, known: set[str]) -> Any:
    """Returns a layer's option, which is given for all layers or by name."""
    if not isinstance(value, Mapping):
        return value
    # (Names and colours of values, and tags, are mappings themselves.)
    of_one = name in ("categories", "colormap", "tags")
    if of_one and not (value and all(isinstance(part, Mapping) for part in value.values())):
        return value
    for key in value:
        if key not in known:
            raise ValueError(f"{name}: got an unknown layer {key!r}, expected one of {', '.join(sorted(known))}")
    return value.get(layer.name, value.get(layer.group))


def _place(planned: Sequence[dict[str, Any]], layers: Sequence[ArrayLayer], transform: Any) -> None:
    """Computes how many levels each layer has fewer than the finest, from its transform if it has
    one, else from its size. Sets all transforms to that of the finest cells.
    """
    if len({options["octree"] for options in planned}) > 1:
        raise ValueError("stack: got rasters and volumes, expected layers of one dimension")
    systems = {options["crs"] for options in planned} - {None}
    if len(systems) > 1:
        raise ValueError(f"stack: got layers in different coordinate systems, {', '.join(sorted(systems))}; reproject them first, or give crs=")
    matrices = [None if options["transform"] is None else _matrix(options["transform"]) for options in planned]
    axes = 3 if planned[0]["octree"] else 2
    given = transform is not None
    finest = _matrix(transform) if given else min((matrix for matrix in matrices if matrix is not None), key=lambda matrix: _width(matrix, axes), default=np.eye(4)[:3])
    coarser = [None if matrix is None else _levels_between(finest, matrix, axes, layer) for matrix, layer in zip(matrices, layers)]
    sizes = [options["extent"] for options in planned]
    # The extent in finest cells: of layers known to have these, or of the largest layer without a
    # transform.
    exact = [size for size, levels in zip(sizes, coarser) if levels == 0] or sizes
    extent = [max(size[axis] for size in exact) for axis in range(3)]
    for layer, options, size, levels in zip(layers, planned, sizes, coarser):
        if levels is None:
            levels = _levels_of(size, extent, layer)
        scale = np.array([*([2.0**levels] * axes), *([1.0] * (3 - axes)), 1.0])
        matrix = finest * scale
        options["coarser"] = levels
        options["crs"] = next(iter(systems), None)
        if levels or given or any(other is not None for other in matrices):
            options["transform"] = matrix.ravel().tolist() if axes == 3 else [*matrix[0, [0, 1, 3]].tolist(), *matrix[1, [0, 1, 3]].tolist()]


def _matrix(transform: Any) -> npt.NDArray[np.float64]:
    """Returns the three rows of a cell-to-world matrix."""
    numbers = np.asarray(transform, dtype=float)
    if numbers.ndim == 1 and len(numbers) in (6, 9):
        a, b, c, d, e, f = numbers[:6]
        return np.array([[a, b, 0.0, c], [d, e, 0.0, f], [0.0, 0.0, 1.0, 0.0]])
    if numbers.size not in (12, 16):
        raise ValueError(f"transform: expected six numbers, or a matrix of 3 x 4 or 4 x 4, got {transform!r}")
    return numbers.reshape(-1, 4)[:3]


def _width(matrix: npt.NDArray[np.float64], axes: int) -> float:
    return float(np.linalg.norm(matrix[:axes, :axes]))


def _levels_between(finest: npt.NDArray[np.float64], matrix: npt.NDArray[np.float64], axes: int, layer: ArrayLayer) -> int:
    """Returns how often the cells of a layer are doubled in size relative to the finest."""
    width = _width(finest, axes)
    levels = round(np.log2(_width(matrix, axes) / width)) if width > 0 else 0
    linear = matrix[:axes, :axes] - finest[:axes, :axes] * 2.0**levels
    corner = matrix[:axes, 3] - finest[:axes, 3]
    if np.abs(linear).max() > 1e-6 * width * 2.0**levels or np.abs(corner).max() > 1e-2 * width:
        raise ValueError(
            f"`{layer.name}` is on another grid: layers must start at the same corner, with cells as large as the finest ones or 2, 4, 8 ... times; "
            "resample it first, or give transform= for all layers"
        )
    return levels


def _levels_of(size: Sequence[int], extent: Sequence[int], layer: ArrayLayer) -> int:
    """Returns how often the cells of an array are doubled in size relative to the finest, from its
    size.
    """
    for levels in range(max(extent).bit_length() + 1):
        if all(-(-whole >> levels) == length for whole, length in zip(extent[: 2 if extent[2] == 1 and size[2] == 1 else 3], size)):
            return levels
    found, whole = (" x ".join(map(str, reversed(lengths[: 2 if extent[2] == 1 else 3]))) for lengths in (size, extent))
    raise ValueError(
        f"`{layer.name}` has {found} cells, the finest layer {whole}: layers of arrays must have as many, or those of cells 2, 4, 8 ... times as "
        "large; DataArrays with coordinates have positions of their own"
    )
