"""Trees as lazy xarray datasets.

`xarray.open_dataset("map.goblin", engine="spinney")` opens the cells, or those of a coarser
`level=`, as the variable `band_data` with the axes `band`, (`z`,) `y` and `x`, as rioxarray's
engine does: coordinates are cell centres, the coordinate system is stored where rioxarray expects
it, and `chunks={}` makes Dask arrays whose chunks are the file's segments. All levels together are
a tree of datasets: `open_levels(path)`, or `xarray.open_datatree(path, engine="spinney")`.

Layers of a file become variables with their names. Layers that have times, and are equal in
everything else, form one variable with an axis `time`; `layers="band"` concatenates all along an
axis `band` with their names, `layers="variable"` keeps them separate. A layer is read on access.
"""

from __future__ import annotations

import json
import os
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import xarray as xr
from xarray.backends import BackendEntrypoint
from xarray.core import indexing

from ._cells import Cells, Void, void_of
from ._dataset import Dataset, open
from ._remote import is_path
from ._times import text_of_time, time_of_text
from ._types import Path

SEGMENT = {2: 1024, 3: 128}
"""Cells along a side of a chunk, by number of axes."""


class SpinneyBackendEntrypoint(BackendEntrypoint):
    """Opens .goblin and .autumn files, and commits of these (`map.autumn@3`)."""

    description = "Goblin and Autumnal trees, at any level of detail"
    url = ""
    open_dataset_parameters = (
        "filename_or_obj",
        "drop_variables",
        "level",
        "view",
        "commit",
        "positioned",
        "layer",
        "layers",
        "storage_options",
        "no_remote",
        "no_external",
        "mask_and_scale",
        "decode_times",
        "decode_timedelta",
        "use_cftime",
        "concat_characters",
        "decode_coords",
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
        layer: str | int | None = None,
        layers: Literal["time", "band", "variable"] | None = None,
        storage_options: Mapping[str, Any] | None = None,
        no_remote: bool = False,
        no_external: bool = False,
        mask_and_scale: bool | None = None,
        decode_times: Any = True,
        decode_timedelta: Any = None,
        use_cftime: bool | None = None,
        concat_characters: bool = True,
        decode_coords: bool | Literal["coordinates", "all"] = True,
    ) -> xr.Dataset:
        """Opens the cells of a level. With `mask_and_scale` VOID becomes NaN and scales are
        applied; this is the default for continuous values, but not for classes. As in xarray's
        decoding of other files, integers then become floating: `float32` those of 8 and 16 bits
        without a scale, `float64` all others, 64-bit ones included.

        `decode_times`, `decode_timedelta` and `use_cftime` are those of xarray: with
        `decode_times=False` times are numbers with `units`. With `decode_coords=False` only axes
        are coordinates; `spatial_ref` and the time of a single layer are variables.
        `concat_characters` has no effect. `storage_options`, `no_remote` and `no_external` are
        those of `spinney.open`.

        In a file of several layers each is a variable with its name; layers of larger cells than
        the finest have their own axes. Layers with times that have the same type and size and,
        except for the time, the same name, are one variable with an axis `time` (`"band_data"`, if
        their names are only times). With `layers` "band" all are `band_data`, with their names as
        the coordinates of its axis `band`; with "variable" each is a variable, whatever its time;
        with "time" it is an error if times do not form an axis. A single `layer` is `band_data`.
        """
        options: Any = {"storage_options": storage_options, "no_remote": no_remote, "no_external": no_external}
        tree = open(filename_or_obj, view=view, commit=commit, positioned=positioned, layer=layer, **options)
        trees = {"": tree}
        if layer is None and not _names_layer(filename_or_obj) and (layers is not None or len(tree.names) > 1):
            from ._layers import dataset_of_layers, trees_of

            layered = trees_of(tree)
            trees |= layered
            made = dataset_of_layers(layered, level, layers, mask_and_scale)
        elif layers is not None:
            raise ValueError("layers: is for files, got one layer")
        else:
            made = _dataset_of(tree, tree.depth if level is None else level, void_of(tree), mask_and_scale)
        made = _finished(made.drop_vars(drop_variables or [], errors="ignore"), decode_times, decode_timedelta, use_cftime, decode_coords)
        made.set_close(_Closing(trees.values()))
        return made

    def open_groups_as_dict(
        self,
        filename_or_obj: Any,
        *,
        drop_variables: str | Iterable[str] | None = None,
        view: str | Sequence[str] = (),
        commit: int | None = None,
        positioned: bool = False,
        layer: str | int | None = None,
        layers: Literal["time", "band", "variable"] | None = None,
        storage_options: Mapping[str, Any] | None = None,
        no_remote: bool = False,
        no_external: bool = False,
        mask_and_scale: bool | None = None,
        decode_times: Any = True,
        decode_timedelta: Any = None,
        use_cftime: bool | None = None,
        concat_characters: bool = True,
        decode_coords: bool | Literal["coordinates", "all"] = True,
    ) -> dict[str, xr.Dataset]:
        """Returns the levels as groups, named by their numbers; files of several layers are as in
        `open_dataset`.
        """
        options: Any = {"storage_options": storage_options, "no_remote": no_remote, "no_external": no_external}
        tree = open(filename_or_obj, view=view, commit=commit, positioned=positioned, layer=layer, **options)
        root, trees = xr.Dataset(attrs=_attributes(tree)), {"": tree}
        groups = {"/": root}
        if layer is None and not _names_layer(filename_or_obj) and (layers is not None or len(tree.names) > 1):
            from ._layers import dataset_of_layers, trees_of

            layered = trees_of(tree)
            trees |= layered
            made_of = [dataset_of_layers(layered, level, layers, mask_and_scale) for level in range(max(each.levels for each in layered.values()))]
        elif layers is not None:
            raise ValueError("layers: is for files, got one layer")
        else:
            void = void_of(tree)
            made_of = [_dataset_of(tree, level, void, mask_and_scale) for level in range(tree.levels)]
        root.set_close(_Closing(trees.values()))
        for level, made in enumerate(made_of):
            made = made.drop_vars(drop_variables or [], errors="ignore")
            groups[f"/{level}"] = _finished(made, decode_times, decode_timedelta, use_cftime, decode_coords)
        return groups

    def open_datatree(self, filename_or_obj: Any, **options: Any) -> xr.DataTree:
        """Returns the levels as a tree of datasets, named by their numbers."""
        return xr.DataTree.from_dict(self.open_groups_as_dict(filename_or_obj, **options))

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Returns whether the name is that of a tree file."""
        if not is_path(filename_or_obj):
            return False
        name = str(filename_or_obj.path) if hasattr(filename_or_obj, "fs") else os.fsdecode(filename_or_obj)
        return re.search(r"\.(goblin|autumn)(@\d+)?(:[^/]+)?$", name) is not None


class _Closing:
    """Closes trees. A pickled instance holds none: unpickled arrays open their trees again, which
    are closed when they are collected, and a loaded dataset needs no file.
    """

    def __init__(self, trees: Iterable[Dataset] = ()) -> None:
        self.trees = list(trees)

    def __call__(self) -> None:
        for tree in self.trees:
            tree.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return _Closing, ()


class FileVariable(xr.Variable):
    """A variable whose cells are in a file: its Dask arrays are named by the version of the file,
    not only by its path.
    """

    __slots__ = ()

    def chunk(self, *args: Any, **options: Any) -> Any:
        given = dict(options.get("from_array_kwargs") or {})
        name = given.get("name") or options.get("name")
        if isinstance(self._data, indexing.ExplicitlyIndexed) and isinstance(name, str):
            from dask.base import tokenize

            given["name"] = f"{name}-{tokenize(self._data)}"
            options = {**options, "from_array_kwargs": given}
            options.pop("name", None)
        made = super().chunk(*args, **options)
        return xr.Variable(made.dims, made._data, made._attrs, made._encoding, fastpath=True)


def _finished(made: xr.Dataset, decode_times: Any, decode_timedelta: Any, use_cftime: bool | None, decode_coords: Any) -> xr.Dataset:
    """Applies the decoding options of xarray to a dataset."""
    if decode_coords not in (True, False, None, "coordinates", "all"):
        raise ValueError(f"decode_coords: got {decode_coords!r}, expected True, False, 'coordinates' or 'all'")
    if "time" in made.coords and (decode_times is not True or use_cftime is not None):
        encoded = made[["time"]].assign_coords(time=xr.conventions.encode_cf_variable(made["time"].variable, name="time"))
        if decode_times is not False:
            encoded = xr.decode_cf(encoded, decode_times=decode_times, use_cftime=use_cftime)
        made = made.assign_coords(time=encoded["time"].variable)
    if decode_timedelta not in (None, False):
        made = xr.decode_cf(made, mask_and_scale=False, decode_times=False, decode_coords=False, decode_timedelta=decode_timedelta)
    if decode_coords is False:
        made = made.reset_coords([name for name in made.coords if name not in made.dims])
    for name, array in made.data_vars.items():
        variable = array.variable
        if decode_coords is False and "grid_mapping" in variable.encoding:
            variable.attrs["grid_mapping"] = variable.encoding.pop("grid_mapping")
        if isinstance(variable._data, indexing.ExplicitlyIndexed):
            made[name] = FileVariable(variable.dims, variable._data, variable._attrs, variable._encoding, fastpath=True)
    return made


def _names_layer(path: Any) -> bool:
    """Returns whether a path names a layer."""
    if not isinstance(path, str | os.PathLike):
        return False
    return ":" in os.path.basename(str(path)) and not os.path.exists(str(path))


def open_levels(path: Path, **options: Any) -> xr.DataTree:
    """Opens all levels of a tree, `"0"` (one cell) to the cells, as datasets; options are those of
    `open_dataset`.
    """
    return SpinneyBackendEntrypoint().open_datatree(path, **options)


def _dataset_of(tree: Dataset, level: int, void: Void, mask_and_scale: bool | None) -> xr.Dataset:
    cells = Cells(tree, level, void)
    axes = ("band", "z", "y", "x") if tree.ndim == 3 else ("band", "y", "x")
    attrs = _attributes(tree) | _meaning(tree, level, void)
    side = SEGMENT[tree.ndim]
    chunks = {"band": tree.count} | {
        axis: min(side, length) for axis, length in zip(axes[1:], cells.shape[1:])
    }
    encoding = {"preferred_chunks": chunks, "grid_mapping": "spatial_ref"}
    variable = xr.Variable(axes, indexing.LazilyIndexedArray(cells), attrs, encoding)
    coordinates: dict[str, Any] = {"band": ("band", np.arange(1, tree.count + 1))}
    coordinates |= _centres(tree, level, cells.shape)
    coordinates["spatial_ref"] = ((), 0, _reference(tree, level))
    seen = time_of_text(tree.time)
    if seen is not None:
        coordinates["time"] = ((), seen)
    elif tree.time is not None:
        attrs["time"] = tree.time
    made = xr.Dataset({"band_data": variable}, coordinates, _attributes(tree) | {"level": level})
    return decoded(made) if masks_of(tree, mask_and_scale) else made


def masks_of(tree: Dataset, mask_and_scale: bool | None) -> bool:
    """Returns whether VOID becomes NaN and scales are applied."""
    return tree.kind == "continuous" if mask_and_scale is None else mask_and_scale


def decoded(made: xr.Dataset) -> xr.Dataset:
    """Returns a dataset whose VOID is NaN, and whose scales are applied."""
    return xr.decode_cf(made, mask_and_scale=True, decode_times=False, decode_coords=False)


def _meaning(tree: Dataset, level: int, void: Void) -> dict[str, Any]:
    """Returns the meaning of a tree's values as attributes: those of the CF conventions and
    rioxarray or, where these have none, of this package.
    """
    attrs: dict[str, Any] = {"spinney_kind": tree.kind, "spinney_rule": tree.rule}
    if tree.categories:
        attrs["flag_values"] = np.array(list(tree.categories), dtype=void.dtype)
        attrs["flag_meanings"] = " ".join(map(_word, tree.categories.values()))
        if any(_word(name).replace("_", " ") != name for name in tree.categories.values()):
            attrs["spinney_categories"] = json.dumps(tree.categories, ensure_ascii=False)
    if tree.colormap:
        attrs["spinney_colormap"] = " ".join("#%02x%02x%02x%02x" % tree.colormap[value] for value in sorted(tree.colormap))
    for name, strings in (("long_name", tree.descriptions), ("units", tree.units)):
        if any(strings):
            attrs[name] = strings[0] if tree.count == 1 else tuple(text or "" for text in strings)
    if len({unit for unit in tree.units}) == 1 and tree.units[0]:
        attrs["units"] = tree.units[0]
    if void.number is not None:
        attrs["_FillValue"] = void.dtype.type(void.number)
    for one, several, numbers, usual in (
        ("scale_factor", "scales", tree.scales, 1.0),
        ("add_offset", "offsets", tree.offsets, 0.0),
    ):
        if len(set(numbers)) > 1:
            attrs[several] = numbers
        elif numbers[0] != usual:
            attrs[one] = numbers[0]
    others = {name: text for name, text in tree.tags.items() if name not in _attributes(tree)}
    if others:
        attrs["spinney_tags"] = json.dumps(others, ensure_ascii=False)
    if void.dtype != tree.dtype:
        attrs["spinney_dtype"] = tree.dtype.name
    alpha = tree._facts()["alpha"]
    if alpha is not None:
        attrs["spinney_alpha"] = alpha + 1
    # (Coordinates of centres are rounded, and a rotated grid has none.)
    scale = 2.0 ** (tree.depth - level)
    matrix = tree.matrix[:3] * [*([scale] * tree.ndim), *([1.0] * (3 - tree.ndim)), 1.0]
    if np.any(matrix != np.eye(4)[:3]):
        attrs["spinney_matrix"] = [float(number) for number in matrix.ravel()]
    attrs["spinney_shape"] = list(tree._shape_at(level))
    return attrs


def _word(name: str) -> str:
    """Returns a name without blanks."""
    return re.sub(r"\s+", "_", name.strip()) or "_"


def _attributes(tree: Dataset) -> dict[str, Any]:
    """Returns the tags, except for those that xarray would interpret as properties of samples."""
    return {name: text for name, text in tree.tags.items() if not name.startswith("spinney_") and name not in (*_INTERPRETED, *_DECODED)}


def _centres(tree: Dataset, level: int, shape: tuple[int, ...]) -> dict[str, Any]:
    """Returns the coordinates of cell centres, where each depends on a single axis."""
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
    """Returns a DataArray's own properties, as arguments of `spinney.build`."""
    names = {"band": "b", "z": "z", "y": "y", "x": "x", "lat": "y", "lon": "x", "latitude": "y", "longitude": "x"}
    try:
        dims = "".join(names[str(name)] for name in array.dims)
    except KeyError as error:
        raise ValueError(f"axis {error} of the DataArray: expected band, z, y and x; transpose and rename them") from None
    attrs, encoding = array.attrs, array.encoding
    bands = _bands_of(array)
    mapping = array.coords.get({**attrs, **encoding}.get("grid_mapping", "spatial_ref"))
    properties: dict[str, Any] = {"dims": dims, "kind": attrs.get("spinney_kind"), "rule": attrs.get("spinney_rule"), "crs": None}
    if mapping is not None:
        about = mapping.attrs
        properties["crs"] = about.get("crs_wkt") or about.get("spatial_ref") or about.get("spinney_crs")
    properties["transform"] = _declared_transform(array, dims, mapping)
    properties |= _declared_void(array) | _declared_classes(attrs, array.dtype)
    if properties["categories"] and properties["kind"] is None:
        properties["kind"] = "categorical"
    properties["descriptions"] = _by_band(attrs.get("long_name", attrs.get("descriptions")), bands)
    properties["units"] = _by_band(attrs.get("units"), bands, repeated=True)
    properties["scales"] = _by_band(attrs.get("scales", attrs.get("scale_factor")), bands, repeated=True)
    properties["offsets"] = _by_band(attrs.get("offsets", attrs.get("add_offset")), bands, repeated=True)
    alpha = attrs.get("spinney_alpha")
    properties["alpha"] = bands.index(alpha) if alpha in bands and len(bands) > 1 else None
    strings = {name: value for name, value in attrs.items() if isinstance(value, str) and name not in _INTERPRETED}
    if len(bands) > 1 and isinstance(attrs.get("long_name"), str):
        strings["long_name"] = attrs["long_name"]
    properties["seen"] = _seen_of(array)
    if properties["seen"] is not None and strings.get("time") == properties["seen"]:
        del strings["time"]
    properties["tags"] = {str(name): text for name, text in strings.items() if not str(name).startswith(("STATISTICS_", "spinney_"))}
    properties["tags"] |= _strings_of(attrs, "spinney_tags")
    return properties


def _seen_of(array: xr.DataArray) -> str | None:
    """Returns the acquisition time in a coordinate or an attribute."""
    time = array.coords.get("time")
    if time is not None and time.ndim == 0 and time.dtype.kind == "M" and not np.isnat(time.values):
        return text_of_time(time.values)
    text = array.attrs.get("time")
    return text if isinstance(text, str) and time_of_text(text) is not None else None


_DECODED = ("scale_factor", "add_offset", "scales", "offsets", "dtype", "_Unsigned", "calendar", "fill_value")
"""Names of attributes that xarray and rioxarray interpret as properties of samples, in addition to
those in `_INTERPRETED`.
"""

_INTERPRETED = (
    "_FillValue",
    "missing_value",
    "nodata",
    "long_name",
    "descriptions",
    "units",
    "flag_values",
    "flag_meanings",
    "flag_colors",
    "grid_mapping",
    "coordinates",
)


def _bands_of(array: xr.DataArray) -> list[int]:
    """Returns the numbers of the bands, counted from 1."""
    count = array.sizes.get("band", 1)
    numbers = np.atleast_1d(array.coords["band"]) if "band" in array.coords else np.arange(1, count + 1)
    whole = numbers.dtype.kind in "iu" and len(numbers) == count
    return [int(number) for number in (numbers if whole else np.arange(1, count + 1))]


def _by_band(attribute: Any, bands: list[int], repeated: bool = False) -> list[Any] | None:
    """Returns an attribute's value for each band: a single value is `repeated`, or applies to an
    only band.
    """
    if attribute is None or (isinstance(attribute, str) and not attribute):
        return None
    if isinstance(attribute, str | int | float | np.number):
        value = attribute if isinstance(attribute, str) else float(attribute)
        return [value] * len(bands) if repeated or len(bands) == 1 else None
    each = [value if isinstance(value, str) or value is None else float(value) for value in attribute]
    if len(each) == len(bands) and max(bands) > len(each):
        return each
    return [each[band - 1] for band in bands] if 1 <= min(bands) <= max(bands) <= len(each) else None


def _number(attribute: Any) -> float | None:
    """Returns a number, or nothing if it is not one."""
    try:
        number = np.asarray(attribute).item()
        number = number if isinstance(number, int) else float(number)
    except (TypeError, ValueError):
        return None
    return None if np.isnan(number) else number


def _declared_void(array: xr.DataArray) -> dict[str, Any]:
    """Returns the number of VOID: among the samples, or, if VOID is NaN in these, its encoded
    number; and the original sample type of classes that were converted to floating or wider types
    to represent VOID.
    """
    attrs, encoding = array.attrs, array.encoding
    names = ("_FillValue", "missing_value", "fill_value", "nodata")
    number = next((_number(attrs[name]) for name in names if name in attrs), None)
    encoded = next((_number(encoding[name]) for name in names if name in encoding), None)
    properties: dict[str, Any] = {"nodata": None, "void_number": None, "dtype": None, "void_sample": None}
    narrow = attrs.get("spinney_dtype")
    if narrow is None and array.dtype.kind == "f" and attrs.get("spinney_kind") == "categorical":
        is_scaled = any(encoding.get(name, usual) != usual for name, usual in (("scale_factor", 1), ("add_offset", 0)))
        before = np.dtype(encoding.get("dtype", array.dtype))
        narrow = before.name if before.kind in "iu" and not is_scaled else None
    if narrow is not None and (array.dtype.kind in "iu" or attrs.get("spinney_kind") == "categorical"):
        dtype = np.dtype(narrow)
        limits = np.iinfo(dtype)
        void = number if array.dtype.kind in "iu" else encoded
        properties |= {"dtype": dtype, "void_sample": void if array.dtype.kind in "iu" else None}
        properties["void_number"] = void if void is not None and limits.min <= void <= limits.max else None
        return properties
    if narrow is not None and encoded is not None and not np.iinfo(narrow).min <= encoded <= np.iinfo(narrow).max:
        encoded = None
    if number is not None:
        held = array.dtype.kind == "f" or (
            array.dtype.kind in "iu" and float(number).is_integer() and np.iinfo(array.dtype).min <= number <= np.iinfo(array.dtype).max
        )
        properties["nodata"] = number if held else None
    elif encoded is not None and array.dtype.kind == "f" and not {"scale_factor", "add_offset"} & set(encoding):
        # (If there are several bands, some may lack values that others have: their samples become
        # that number again.)
        properties["nodata" if array.sizes.get("band", 1) > 1 else "void_number"] = encoded
    return properties


def _declared_classes(attrs: Mapping[Any, Any], dtype: np.dtype[Any]) -> dict[str, Any]:
    """Returns names and colours of classes."""
    properties: dict[str, Any] = {"categories": None, "colormap": None}
    colours = str(attrs.get("spinney_colormap", "")).split()
    if colours:
        properties["colormap"] = dict(enumerate(map(_colour, colours)))
    if "flag_values" not in attrs or "flag_meanings" not in attrs or "flag_masks" in attrs:
        return properties
    listed = attrs["flag_values"]
    values = [int(value) for value in (listed.replace(",", " ").split() if isinstance(listed, str) else np.atleast_1d(listed))]
    words = str(attrs["flag_meanings"]).split()
    exact = {int(value): name for value, name in _strings_of(attrs, "spinney_categories").items() if value.lstrip("-").isdecimal()}
    # (A meaning that was edited takes precedence.)
    named = {value: exact[value] if _word(exact.get(value, "")) == word else word.replace("_", " ") for value, word in zip(values, words)}
    properties["categories"] = {value: "" if name == " " else name for value, name in named.items()}
    flag_colours = str(attrs.get("flag_colors", "")).split()
    if not colours and len(flag_colours) == len(values) and all(0 <= value < 65536 for value in values):
        properties["colormap"] = dict(zip(values, map(_colour, flag_colours)))
    return properties


def _strings_of(attrs: Mapping[Any, Any], name: str) -> dict[str, str]:
    """Returns strings by name, from an attribute that this package has written."""
    try:
        return {str(key): str(text) for key, text in json.loads(attrs.get(name, "{}")).items()}
    except (TypeError, ValueError, AttributeError):
        return {}


def _colour(text: str) -> tuple[int, ...]:
    """Parses red, green, blue and opacity in `#rrggbb` or `#rrggbbaa`."""
    digits = text.removeprefix("#")
    if not re.fullmatch("([0-9a-fA-F]{2}){3,4}", digits):
        raise ValueError(f"attributes of the DataArray: got colour {text!r}, expected #rrggbb or #rrggbbaa")
    return (*bytes.fromhex(digits if len(digits) == 8 else digits + "ff"),)


def _declared_transform(array: xr.DataArray, dims: str, mapping: xr.DataArray | None) -> Any:
    """Returns the cell-to-world transform: the attribute's, if it agrees with the coordinates or
    there are none, else that of the coordinates.
    """
    found = _transform_of(array, dims)
    attrs = array.attrs
    is_whole = list(attrs.get("spinney_shape", [])) == [array.sizes[axis] for axis, name in zip(array.dims, dims) if name != "b"]
    declared: Any = None
    matrix = np.asarray(attrs.get("spinney_matrix", []), dtype=float)
    if matrix.size == 12 and is_whole:
        declared = matrix.reshape(3, 4)
    elif mapping is not None and "z" not in dims and "spinney_shape" not in attrs:
        numbers = [_number(word) for word in str(mapping.attrs.get("GeoTransform", "")).split()]
        if len(numbers) == 6 and None not in numbers:
            c, a, b, f, d, e = numbers
            declared = [a, b, c, d, e, f]
    if found is None:
        if declared is None and "spinney_matrix" in attrs and not is_whole:
            warnings.warn(
                "the DataArray is a part of an array with a rotated or sheared transform, so its position is unknown; give transform=",
                UserWarning,
                stacklevel=4,
            )
        return declared
    if declared is not None:
        axes = 3 if "z" in dims else 2
        ours, theirs = (np.asarray(_rows(rows))[:axes] for rows in (found, declared))
        # (They agree if they differ by far less than a cell throughout the array.)
        differences = np.abs(ours - theirs)[:, [*range(axes), 3]]
        near = differences @ [*([max(array.shape)] * axes), 1.0] < 1e-6 * np.abs(theirs[:, :3]).sum(axis=1)
        return declared if near.all() else found
    return found


def _rows(transform: Any) -> list[list[float]]:
    """Returns the three rows of a cell-to-world matrix."""
    numbers = np.asarray(transform, dtype=float).ravel()
    if len(numbers) == 6:
        a, b, c, d, e, f = numbers
        return [[a, b, 0.0, c], [d, e, 0.0, f], [0.0, 0.0, 1.0, 0.0]]
    return numbers.reshape(3, 4).tolist()


def _transform_of(array: xr.DataArray, dims: str) -> list[Any] | None:
    """Returns the cell-to-world transform from the coordinates of cell centres; `None` if there are
    none.
    """
    steps, starts = [], []
    for name in "xyz"[: 3 if "z" in dims else 2]:
        axis = array.dims[dims.index(name)]
        if axis not in array.coords or not np.issubdtype(array.coords[axis].dtype, np.number):
            return None
        centres = np.asarray(array.coords[axis], dtype=float)
        step = (centres[-1] - centres[0]) / (len(centres) - 1) if len(centres) > 1 else 1.0
        wanted = centres[0] + step * np.arange(len(centres))
        if not np.allclose(centres, wanted, rtol=0, atol=abs(step) * 1e-3):
            raise ValueError(f"coordinates {axis!r} of the DataArray: are not evenly spaced; resample them first")
        steps.append(step)
        starts.append(centres[0] - step / 2)
    if len(steps) == 2:
        return [steps[0], 0.0, starts[0], 0.0, steps[1], starts[1]]
    return [[*row, start] for row, start in zip(np.diag(steps).tolist(), starts)]


def _undecoded_crs(text: str, error: Exception) -> dict[str, Any]:
    """Returns attributes of a coordinate system that xarray's users cannot read, and warns about
    it.
    """
    warnings.warn(f"the coordinate system is only in the attribute `spinney_crs`: {error}", UserWarning, stacklevel=2)
    return {"spinney_crs": text}


def _reference(tree: Dataset, level: int) -> dict[str, Any]:
    """Returns attributes of the coordinate system, as in rioxarray and GDAL."""
    a, b, c, d, e, f = tree.level(level).transform
    attrs: dict[str, Any] = {"GeoTransform": " ".join(map(repr, map(float, (c, a, b, f, d, e))))}
    text = tree.crs
    if text is None:
        return attrs
    try:
        from pyproj import CRS
        from pyproj.exceptions import CRSError
    except ImportError:
        try:
            wkt = tree._crs_wkt
        except ValueError as error:
            return attrs | _undecoded_crs(text, error)
        return attrs | {"crs_wkt": wkt, "spatial_ref": wkt}
    try:
        cf = CRS.from_user_input(text).to_cf()
    except CRSError as error:
        return attrs | _undecoded_crs(text, error)
    return cf | {"spatial_ref": cf["crs_wkt"]} | attrs
