"""Arrays: masks, windows that extend beyond the raster, points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from operator import index
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from ._types import Array, Points

if TYPE_CHECKING:
    from ._dataset import Dataset


def masked(array: Array, void: npt.NDArray[np.bool_], missing: float | None, fill: float) -> Any:
    """Returns a masked array of bands, from the flags of VOID cells and the number that marks
    missing samples.
    """
    mask = np.array(np.broadcast_to(void, array.shape))
    if missing is not None:
        mask |= array == array.dtype.type(missing)
    result: Any = np.ma.MaskedArray(array, mask=mask)
    result.fill_value = np.array(fill).astype(array.dtype)
    return result


SPARSE = 64
"""Cells per requested cell from which cells are read one by one."""


def corner(window: Any, axes: int) -> tuple[list[float], list[float]]:
    """Returns the first cell and the size of a window, x first."""
    if hasattr(window, "col_off"):
        window = (window.col_off, window.row_off, window.width, window.height)
    numbers = np.asarray(window, dtype=float)
    if numbers.shape == (2, 2):
        (top, bottom), (left, right) = numbers
        numbers = np.array([left, top, right - left, bottom - top])
    if numbers.shape not in ((4,), (6,)) or not np.isfinite(numbers).all():
        raise TypeError(f"window: expected (column, row, width, height) in cells, got {window!r}")
    if len(numbers) != 2 * axes:
        raise ValueError(f"window: got {len(numbers) // 2} axes, expected {axes}")
    first, size = numbers[:axes].tolist(), numbers[axes:].tolist()
    if min(size) <= 0:
        raise ValueError(f"window: got {' x '.join(f'{length:g}' for length in size)} cells, expected more than 0 along each axis")
    return first, size


Sizes = tuple[int | None, Any, bool]
"""Level, output shape, and exactness of a read."""


def boundless(tree: Dataset, bands: int | list[int] | None, window: Any, sizes: Sizes, want_mask: bool, fill: float | None, _: bool) -> Any:
    """Reads a window with integer bounds that may extend beyond the raster, where everything is
    VOID.
    """
    level, out_shape, exact = sizes
    begin, lengths = corner(window, tree.ndim)
    first, size = [int(at) for at in begin], [int(length) for length in lengths]
    shape = tree._shape_at(None)[::-1]
    fill = _fill(tree, fill, want_mask, _sticks_out(first, size, shape))
    if exact and out_shape is None:
        raise ValueError("exact: needs out_shape")
    if out_shape is not None:
        if level is not None:
            raise ValueError("out_shape, level: got both, expected one of them")
        return _boundless_resampled(tree, bands, (first, size, shape), _out_size(tree, bands, out_shape), exact, want_mask, fill)
    shift = _shift(tree, level)
    # In cells of the level: those that the window covers, and those of them in the raster.
    low = [start >> shift for start in first]
    high = [-(-(start + length) >> shift) for start, length in zip(first, size)]
    ends = [-(-cells >> shift) for cells in shape]
    inside = [(max(a, 0), min(b, end)) for a, b, end in zip(low, high, ends)]
    result = _void(tree, bands, [b - a for a, b in zip(low[::-1], high[::-1])], want_mask, fill)
    if all(a < b for a, b in inside):
        # (In deepest cells: the window's bounds are multiples of the level's cells, except at the
        # raster's edge.)
        begin = [a << shift for a, _ in inside]
        end = [min(b << shift, cells) for (_, b), cells in zip(inside, shape)]
        part = tree.read(
            bands,
            window=(*begin, *(b - a for a, b in zip(begin, end))),
            level=level,
            masked=want_mask,
            fill=fill,
        )
        place = [slice(a - start, b - start) for (a, b), start in zip(inside[::-1], low[::-1])]
        result[(..., *place)] = part
    return result


def _boundless_resampled(
    tree: Dataset,
    bands: int | list[int] | None,
    within: tuple[list[int], list[int], list[int]],
    out_size: tuple[int, int],
    exact: bool,
    want_mask: bool,
    fill: float | None,
) -> Any:
    """Reads a window of any size as `out_size` pixels. If it extends beyond the raster, it is read
    from a view whose canvas contains it.
    """
    first, size, shape = within
    options: dict[str, Any] = {"out_shape": out_size, "exact": exact, "masked": want_mask, "fill": fill}
    if not _sticks_out(first, size, shape):
        return tree.read(bands, window=(*first, *size), **options)
    if any(start + length <= 0 or start >= cells for start, length, cells in zip(first, size, shape)):
        return _void(tree, bands, out_size, want_mask, fill)
    step = f"window={','.join(map(str, (*first, *size)))}"
    with type(tree)(tree.path, [*tree.view, step], tree.commit, tree.positioned, tree.layer or None, tree._remote) as seen:
        return seen.read(bands, **options)


def fractional(tree: Dataset, bands: int | list[int] | None, window: Any, sizes: Sizes, want_mask: bool, fill: float | None, may_stick_out: bool) -> Any:
    """Reads a window with fractional bounds as rasterio does: pixels divide it equally, and each is
    the cell at its centre. Their number is the window's lengths, rounded, or `out_shape`.
    """
    level, out_shape, exact = sizes
    if exact:
        raise ValueError("exact: needs a window of whole cells")
    first, size = corner(window, tree.ndim)
    shape = tree._shape_at(None)[::-1]
    sticks_out = _sticks_out(first, size, shape)
    if not may_stick_out and sticks_out:
        all_cells = " x ".join(map(str, shape))
        raise IndexError(f"window: extends beyond the {all_cells} cells; boundless=True reads VOID there")
    fill, shift = _fill(tree, fill, want_mask, sticks_out), _shift(tree, level)
    if out_shape is not None and level is not None:
        raise ValueError("out_shape, level: got both, expected one of them")
    start = np.array(first[::-1]) / 2.0**shift
    length = np.array(size[::-1]) / 2.0**shift
    wanted = [max(1, int(np.floor(cells + 0.5))) for cells in length] if out_shape is None else list(_out_size(tree, bands, out_shape))
    limits = tree._shape_at(level)
    cells = [np.floor(at + (np.arange(count) + 0.5) * (long / count) + 1e-10).astype(np.int64) for at, long, count in zip(start, length, wanted)]
    if not may_stick_out:
        cells = [np.clip(along, 0, limit - 1) for along, limit in zip(cells, limits)]
    # (Cells ascend, so that existing ones are contiguous.)
    parts = [slice(*np.searchsorted(along, (0, limit)).tolist()) for along, limit in zip(cells, limits)]
    found = [along[part] for along, part in zip(cells, parts)]
    result = _void(tree, bands, wanted, want_mask, fill)
    if all(len(along) for along in found):
        result[(..., *parts)] = _picked(tree, bands, found, level, shift, want_mask, fill)
    return result


def _picked(
    tree: Dataset, bands: int | list[int] | None, cells: list[npt.NDArray[np.int64]], level: int | None, shift: int, want_mask: bool, fill: float | None
) -> Any:
    """Returns the cells of a level at ascending rows and columns."""
    spans = [int(along[-1] - along[0]) + 1 for along in cells]
    count = int(np.prod([len(along) for along in cells]))
    if float(np.prod(np.array(spans, dtype=float))) > SPARSE * count:
        centres = np.meshgrid(*((along + 0.5) * 2.0**shift for along in cells), indexing="ij")
        points = np.stack([axis.ravel() for axis in centres[::-1]], axis=1)
        values: Any = cast(Any, tree).sample(points, bands=bands, level=level, coordinates="cells", masked=want_mask, fill=fill)
        return (values if values.ndim == 1 else values.T).reshape(*(() if values.ndim == 1 else (values.shape[1],)), *map(len, cells))
    low = [int(along[0]) << shift for along in cells]
    high = [min((int(along[-1]) + 1) << shift, limit) for along, limit in zip(cells, tree._shape_at(None))]
    window = (*low[::-1], *(end - start for start, end in zip(low[::-1], high[::-1])))
    read: Any = tree.read(bands, window=window, level=level, masked=want_mask, fill=fill)
    return read[(..., *np.ix_(*(along - along[0] for along in cells)))]


def _sticks_out(first: Sequence[float], size: Sequence[float], shape: Sequence[int]) -> bool:
    # (Windows computed from coordinates have rounding errors.)
    return any(start < -1e-6 or start + length > cells + 1e-6 for start, length, cells in zip(first, size, shape))


def _fill(tree: Dataset, fill: float | None, want_mask: bool, sticks_out: bool) -> float | None:
    """Returns the number for cells outside: the caller's, or an unused one."""
    if fill is not None or not sticks_out:
        return fill
    if not want_mask and not tree._has_free_number():
        raise ValueError(f"VOID cells: every number of {tree.dtype} is a value, so no number can represent VOID; read with masked=True, or give a number as fill=")
    return tree.fill_value


def _void(tree: Dataset, bands: int | list[int] | None, shape: Sequence[int], want_mask: bool, fill: float | None) -> Any:
    """Returns an array of VOID."""
    count = [] if isinstance(bands, int) else [tree.count if bands is None else len(bands)]
    void = tree.fill_value if fill is None else fill
    result: Any = np.full((*count, *shape), np.array(void).astype(tree.dtype), dtype=tree.dtype)
    if want_mask:
        result = np.ma.MaskedArray(result, mask=np.ones(result.shape, dtype=bool))
        result.fill_value = np.array(tree.fill_value).astype(tree.dtype)
    return result


def _shift(tree: Dataset, level: int | None) -> int:
    """Returns the number of levels above the deepest one."""
    shift = 0 if level is None else tree.depth - level
    if not 0 <= shift <= tree.depth:
        raise ValueError(f"level: got {level}, expected 0 to {tree.depth}")
    return shift


def _out_size(tree: Dataset, bands: int | list[int] | None, shape: Any) -> tuple[int, int]:
    """Returns rows and columns from `(rows, columns)` or `(bands, rows, columns)`."""
    if tree.ndim == 3:
        raise ValueError("out_shape: got an octree, expected a quadtree; read octrees by level, or see `slice`")
    count = 1 if isinstance(bands, int) else tree.count if bands is None else len(bands)
    sizes = [index(length) for length in shape]
    if len(sizes) not in (2, 3) or (len(sizes) == 3 and sizes[0] != count) or min(sizes) < 1:
        raise ValueError(f"out_shape: got {shape!r}, expected (rows, columns) or ({count}, rows, columns)")
    return sizes[-2], sizes[-1]


def coordinates_of_points(points: Any, axes: int) -> tuple[Any, Any]:
    """Returns points of shapely, geopandas and GeoJSON as rows of coordinates, with their
    coordinate system if they have one; other input is returned unchanged. Missing and empty points
    are NaN.
    """
    if hasattr(points, "geom_type") and hasattr(points, "crs"):
        series = points.geometry
        kinds = set(series.geom_type.dropna())
        if kinds - {"Point"}:
            raise TypeError(f"points: got geometries of type {', '.join(sorted(map(str, kinds)))}, expected points (`centroid`, `representative_point()`)")
        columns = [np.asarray(column, dtype=float) for column in ((series.x, series.y) if axes == 2 else (series.x, series.y, series.z))]
        return np.stack(columns, axis=1), series.crs
    document = points if isinstance(points, Mapping) else getattr(points, "__geo_interface__", None)
    if isinstance(document, Mapping) and document.get("type") != "MultiPoint":
        members = document["features"] if document.get("type") == "FeatureCollection" else [document]
        crs = document.get("crs", {})
        named = crs.get("properties", {}).get("name") if isinstance(crs, Mapping) else None
        is_feature = str(document.get("type", "")).startswith("Feature") and "crs" not in document
        return [_position(member, axes) for member in members], named or ("lonlat" if is_feature else None)
    if isinstance(document, Mapping):
        return [place[:axes] for place in document["coordinates"]], None
    if isinstance(points, list | tuple) and points and (isinstance(points[0], Mapping) or hasattr(points[0], "__geo_interface__")):
        return [_position(point, axes) for point in points], None
    return points, None


def _position(point: Any, axes: int) -> Sequence[float]:
    """Returns the coordinates of a shapely or GeoJSON point."""
    document = getattr(point, "__geo_interface__", point)
    document = (document.get("geometry") or {"type": "Point", "coordinates": ()}) if document.get("type") == "Feature" else document
    if document.get("type") != "Point":
        raise TypeError(f"points: got a geometry of type {document.get('type')}, expected a point")
    place: Sequence[float] = document["coordinates"] or (np.nan,) * axes
    if len(place) < axes:
        raise ValueError(f"points: got {len(place)} coordinates, expected {axes}")
    return place[:axes]


def points_of(points: Points, axes: int, name: str = "points") -> npt.NDArray[np.float64]:
    """Returns points as an array with a row each."""
    given, crs = coordinates_of_points(points, axes)
    if crs is not None:
        raise TypeError(f"{name}: got points with a coordinate system of their own, expected rows of {axes} numbers in the file's system; reproject them")
    if not hasattr(given, "__array__") and isinstance(given, Iterable):
        given = list(given)
    try:
        array = np.ascontiguousarray(np.real(given), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected rows of {axes} numbers: {error}") from None
    if np.iscomplexobj(given):
        raise TypeError(f"{name}: got complex numbers, expected rows of {axes} real numbers")
    if array.size == 0:
        array = array.reshape(0, axes)
    if array.ndim != 2 or array.shape[1] != axes:
        raise ValueError(f"{name}: expected an array of shape (n, {axes}), got {array.shape}")
    return array


def rows_of(points: Any, name: str) -> npt.NDArray[np.float64]:
    """Returns points as rows; a single point is one row."""
    array = np.asarray(points if hasattr(points, "__array__") else list(points))
    return points_of(array[None] if array.ndim == 1 and array.size else array, 3, name)


def of_layers(tree: Any, layers: Any, options: dict[str, Any]) -> Array:
    """Reads cells of several layers of a file, concatenated along the first axis."""
    if isinstance(layers, str):
        raise TypeError("layers: expected a list of names")
    opened = [tree[str(name)] for name in layers]
    if not opened:
        raise ValueError("layers: expected at least one name")
    if len({layer.shape for layer in opened}) > 1 and options.get("out_shape") is None:
        raise ValueError("layers: their cells have different sizes; give out_shape and coordinates, or read the layers one by one")
    if len({layer.shape for layer in opened}) > 1 and options.get("window") is not None and options.get("coordinates") is None:
        raise ValueError("layers: their cells have different sizes; give the window in other coordinates, such as 'world'")
    parts = [layer.read(**options) for layer in opened]
    parts = [part if part.ndim > tree.ndim else part[np.newaxis] for part in parts]
    join: Any = np.ma.concatenate if options.get("masked") else np.concatenate
    joined: Array = join(parts)
    return joined
