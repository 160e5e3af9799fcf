"""Arrays that are read block by block."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ._types import Array


class Blocks:
    """An array that is read block by block, with bands last, in a sample type that trees have."""

    def __init__(
        self,
        source: Any,
        dims: str | None,
        shape: tuple[int, ...] | None,
        dtype: npt.DTypeLike | None,
        mask: Any,
        nodata: float | None,
        properties: dict[str, Any],
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
        self.mask = None if mask is np.ma.nomask else mask
        full = tuple(int(length) for length in source.shape)
        self.dims = dims or usual_dims(full)
        if len(self.dims) != len(full) or self.dims not in ("yx", "byx", "yxb", "zyx", "bzyx", "zyxb"):
            raise ValueError(f"dims: got {self.dims!r}, which does not match an array of shape {full}")
        if self.in_order and self.dims not in ("yx", "yxb", "zyx", "zyxb"):
            raise ValueError(f"dims: got {self.dims!r}, expected 'yx', 'yxb', 'zyx' or 'zyxb': iterators yield rows or planes, with bands last")
        sizes = dict(zip(self.dims, full))
        self.axes = 3 if "z" in sizes else 2
        self.channels = sizes.get("b", 1)
        if not 1 <= self.channels <= 4:
            octree = " (an octree is dims='zyx')" if self.dims == "byx" else ""
            raise ValueError(f"array of shape {full}: got {self.channels} bands, expected 1 to 4{octree}")
        if min(full) < 1:
            raise ValueError(f"array of shape {full}: has no cells")
        self.extent = [sizes["x"], sizes["y"], sizes.get("z", 1)]
        given = np.dtype(source.dtype)
        self.is_mask = given == np.bool_ and self.channels == 1
        self.is_solid = self.is_mask and self.axes == 3
        # Samples that were widened to have a number for VOID get their own type again.
        self.narrow: np.dtype[Any] | None = properties.get("dtype")
        self.void = properties.get("void_sample")
        # Whether VOID cells are zeros: without colour and opacity, or empty in a solid.
        self.is_zero_void = properties.get("alpha") is not None or properties.get("rule") == "occupancy"
        self.nodata = None if nodata is None or np.isnan(nodata) else nodata
        self.dtype = _kept(given) if self.narrow is None else self.narrow
        if mask is not None and mask is not np.ma.nomask:
            _check_mask(mask, self.extent[: self.axes][::-1])

    def read(self, origin: list[int], size: list[int]) -> tuple[Array, npt.NDArray[np.bool_] | None]:
        """Returns the samples of a block, and flags of those that are not VOID."""
        along = {name: slice(first, first + cells) for name, first, cells in zip("xyz", origin, size)}
        block = _loaded(self.source[tuple(along.get(name, slice(None)) for name in self.dims)])
        hidden = np.ma.getmaskarray(block) if isinstance(block, np.ma.MaskedArray) else None
        array = np.asarray(block.data if hidden is not None else block)
        if "b" in self.dims:
            axis = self.dims.index("b")
            array = np.moveaxis(array, axis, -1)
            hidden = None if hidden is None else np.moveaxis(hidden, axis, -1)
        wanted = (*reversed(size[: self.axes]), *([self.channels] if "b" in self.dims else []))
        if array.shape != wanted:
            raise ValueError(f"the source returned a block of shape {array.shape}, expected {wanted}")
        shown: npt.NDArray[np.bool_] | None = None
        if self.mask is not None:
            cut = _loaded(self.mask[tuple(along[name] for name in "zyx"[3 - self.axes :])])
            shown = ~np.asarray(cut, dtype=bool)
        lacking = _either(hidden, self._void_samples(array))
        if lacking is not None and "b" in self.dims:
            array, lacking = self._of_all_bands(array, lacking, shown, origin)
        shown = _either(shown, None if lacking is None else ~lacking, np.logical_and)
        if self.is_zero_void:
            shown = _either(shown, (array != 0).any(axis=-1) if "b" in self.dims else array != 0, np.logical_and)
        samples = self._as_kept(array, shown)
        if self.is_solid:
            shown = _either(shown, samples != 0, np.logical_and)
            samples = samples * np.uint8(255)
        return samples, None if shown is None else np.ascontiguousarray(shown)

    def _void_samples(self, array: Array) -> npt.NDArray[np.bool_] | None:
        """Returns which samples have no value."""
        if self.void is not None:
            return np.asarray(array == self.void)
        if array.dtype.kind == "f" and ("b" in self.dims or self.dtype.kind != "f"):
            nan = np.isnan(array)
            return nan if nan.any() else None
        return None

    def _of_all_bands(
        self,
        array: Array,
        lacking: npt.NDArray[np.bool_],
        shown: npt.NDArray[np.bool_] | None,
        origin: list[int],
    ) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Returns which cells have no value in any band. Cells that lack only some bands are
        refused, or get the nodata number.
        """
        void = np.asarray(lacking.all(axis=-1))
        partial = lacking.any(axis=-1) & ~void
        if shown is not None:
            partial &= shown
        if not partial.any():
            return array, void
        if self.nodata is None:
            cell = [int(index) + first for index, first in zip(np.argwhere(partial)[0], origin[: self.axes][::-1])]
            axes = ("plane", "row", "column")[3 - self.axes :]
            place = ", ".join(f"{axis} {index}" for axis, index in zip(axes, cell))
            raise ValueError(
                f"bands differ in their masks: the cell at {place} has a value in some bands and is masked or NaN in others, but a tree "
                "has one mask for all bands. Give a number that no sample has as nodata=, to fill such samples; "
                "or give stack=True for a layer per band"
            )
        array = np.where(lacking & partial[..., None], np.asarray(self.nodata).astype(array.dtype), array)
        return array, void

    def _as_kept(self, array: Array, shown: npt.NDArray[np.bool_] | None) -> Array:
        """Converts samples to the type that is stored."""
        if self.narrow is None:
            return np.ascontiguousarray(array, dtype=self.dtype)
        limits = np.iinfo(self.dtype)
        fits = (array >= limits.min) & (array <= limits.max) & (array == np.floor(array))
        values = fits if shown is None else fits | ~(shown[..., None] if "b" in self.dims else shown)
        if not values.all():
            what = f"{array[~values].flat[0]} is not a {self.dtype}"
            raise ValueError(f"the attributes of the DataArray declare values of {self.dtype}, but {what}; give kind= to build it unchanged")
        return np.ascontiguousarray(np.where(fits, array, 0), dtype=self.dtype)


def _either(a: Any, b: Any, join: Callable[..., Any] = np.logical_or) -> Any:
    """Joins two arrays of flags, each of which may be `None`."""
    return b if a is None else a if b is None else join(a, b)


def _loaded(block: Any) -> Any:
    """Returns a region of a source as an array in memory."""
    if hasattr(block, "dims") and hasattr(block, "data"):
        block = block.data
    # (Dask: `numpy.asarray` would drop masks.)
    return block.compute() if hasattr(block, "compute") else block


def _check_mask(mask: Any, cells: list[int]) -> None:
    shape = tuple(int(length) for length in np.shape(mask))
    if shape != tuple(cells):
        bands = "; a tree has one mask for all bands" if len(shape) > len(cells) else ""
        raise ValueError(f"mask: got shape {shape}, expected {tuple(cells)}{bands}")
    kind = getattr(mask, "dtype", None) or np.asarray(mask).dtype
    if kind != np.bool_:
        # (GDAL masks are inverted: they are 0 for cells without data.)
        raise TypeError(f"mask: expected booleans, true where a cell is VOID, got {kind}")


def _kept(given: np.dtype[Any]) -> np.dtype[Any]:
    """Returns the type of samples in a tree of such an array."""
    wider = {"bool": "uint8", "float16": "float32"}
    advice = {
        "V": "build one of its fields, such as array['name']",
        "c": "build its parts as bands (numpy.stack([array.real, array.imag])), or numpy.abs(array)",
        "f": "convert it to float64",
    }
    kept = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64")
    name = wider.get(given.name, given.name)
    if name not in kept:
        usual = f"convert it to one of {', '.join(kept)}"
        raise TypeError(f"an array of {given} cannot be stored: {advice.get(given.kind, usual)}")
    return np.dtype(name)


def usual_dims(shape: tuple[int, ...]) -> str:
    usual: dict[int, str] = {2: "yx", 3: "byx", 4: "bzyx"}
    if len(shape) not in usual:
        raise ValueError(f"array of shape {shape}: expected 2, 3 or 4 axes")
    return usual[len(shape)]


class _Bands:
    """Arrays stacked vertically, as one array that is read top down."""

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
                    f"the iterator yielded {part.dtype} of shape {part.shape}, expected {self.dtype} of "
                    f"shape (n, {', '.join(map(str, self.shape[1:]))})"
                )
            fits = part[: wanted - have]
            if len(part) > len(fits):
                self.rest = part[len(fits) :]
            taken.append(fits)
            have += len(fits)
        self.row = rows.stop
        if self.row == self.shape[0] and (self.rest is not None or next(self.parts, None) is not None):
            raise ValueError(f"the iterator yielded more than {self.shape[0]} rows")
        if len(taken) == 1:
            return taken[0]
        join: Callable[[list[Any]], Any] = (
            np.ma.concatenate if any(isinstance(part, np.ma.MaskedArray) for part in taken) else np.concatenate
        )
        return join(taken)
