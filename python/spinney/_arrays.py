"""Arrays: masks, windows that stick out, points."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._types import Array, Points

if TYPE_CHECKING:
    from ._native import Tree


def masked(array: Array, void: npt.NDArray[np.bool_], missing: float | None, fill: float) -> Any:
    """A masked array of bands, from flags of cells that are VOID and the number of samples that are missing."""
    mask = np.array(np.broadcast_to(void, array.shape))
    if missing is not None:
        mask |= array == array.dtype.type(missing)
    result: Any = np.ma.MaskedArray(array, mask=mask)
    result.fill_value = np.array(fill).astype(array.dtype)
    return result


def corner(window: Any) -> tuple[list[int], list[int]]:
    """First cell and size of a window, x first."""
    if hasattr(window, "col_off"):
        window = (window.col_off, window.row_off, window.width, window.height)
    numbers = np.asarray(window, dtype=float)
    if numbers.shape == (2, 2):
        (top, bottom), (left, right) = numbers
        numbers = np.array([left, top, right - left, bottom - top])
    if numbers.shape not in ((4,), (6,)) or not np.array_equal(numbers, np.round(numbers)):
        raise TypeError(f"window: expected (column, row, width, height) in whole cells, got {window!r}")
    axes = len(numbers) // 2
    first, size = ([int(number) for number in part] for part in (numbers[:axes], numbers[axes:]))
    if min(size) < 1:
        raise ValueError(f"window: {' x '.join(map(str, size))} cells, at least 1 along each axis needed")
    return first, size


def boundless(
    tree: Tree,
    bands: int | list[int] | None,
    window: Any,
    level: int | None,
    out_shape: Any,
    exact: bool,
    want_mask: bool,
    fill: float | None,
) -> Any:
    """Reads a window that may stick out of the picture, where everything is VOID."""
    if out_shape is not None or exact:
        raise ValueError("boundless: is for windows of cells, without out_shape")
    first, size = corner(window)
    shape = tree._shape_at(None)[::-1]
    if len(first) != len(shape):
        raise ValueError(f"window: {len(first)} axes, the tree has {len(shape)}")
    depth = tree.depth
    shift = 0 if level is None else depth - level
    if not 0 <= shift <= depth:
        raise ValueError(f"level: {level}, the tree's levels are 0 to {depth}")
    # In cells of the level: those that the window covers, and those of them that there are.
    low = [start >> shift for start in first]
    high = [-(-(start + length) >> shift) for start, length in zip(first, size)]
    ends = [-(-cells >> shift) for cells in shape]
    inside = [(max(a, 0), min(b, end)) for a, b, end in zip(low, high, ends)]
    count = [] if isinstance(bands, int) else [tree.count if bands is None else len(bands)]
    whole = (*count, *(b - a for a, b in zip(low[::-1], high[::-1])))
    void = tree.fill_value if fill is None else fill
    result: Any = np.full(whole, np.array(void).astype(tree.dtype), dtype=tree.dtype)
    if want_mask:
        result = np.ma.MaskedArray(result, mask=np.ones(whole, dtype=bool))
        result.fill_value = np.array(tree.fill_value).astype(tree.dtype)
    if all(a < b for a, b in inside):
        # (Deepest cells: a window that begins and ends with cells of the level, but for the picture's edge.)
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


def points_of(points: Points, axes: int, name: str = "points") -> npt.NDArray[np.float64]:
    """Points as an array with a row each."""
    given: Any = points
    if not hasattr(given, "__array__") and isinstance(given, Iterable):
        given = list(given)
    try:
        array = np.ascontiguousarray(np.real(given), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected rows of {axes} numbers: {error}") from None
    if np.iscomplexobj(given):
        raise TypeError(f"{name}: expected rows of {axes} numbers, got complex ones")
    if array.size == 0:
        array = array.reshape(0, axes)
    if array.ndim != 2 or array.shape[1] != axes:
        raise ValueError(f"{name}: expected an array of shape (n, {axes}), got {array.shape}")
    return array


def rows_of(points: Any, name: str) -> npt.NDArray[np.float64]:
    """Points as rows; one alone is a row."""
    array = np.asarray(points if hasattr(points, "__array__") else list(points))
    return points_of(array[None] if array.ndim == 1 and array.size else array, 3, name)


def of_layers(tree: Any, layers: Any, options: dict[str, Any]) -> Array:
    """Cells of several layers of a file, one behind the other along the first axis."""
    if isinstance(layers, str):
        raise TypeError("layers: expected a list of names")
    opened = [tree[str(name)] for name in layers]
    if not opened:
        raise ValueError("layers: expected at least one name")
    if len({layer.shape for layer in opened}) > 1 and options.get("out_shape") is None:
        raise ValueError("layers: of cells of different sizes; give out_shape and coordinates, or read them one by one")
    if len({layer.shape for layer in opened}) > 1 and options.get("window") is not None and options.get("coordinates") is None:
        raise ValueError("layers: of cells of different sizes; give the window in other coordinates, such as 'world'")
    parts = [layer.read(**options) for layer in opened]
    parts = [part if part.ndim > tree.ndim else part[np.newaxis] for part in parts]
    join: Any = np.ma.concatenate if options.get("masked") else np.concatenate
    joined: Array = join(parts)
    return joined
