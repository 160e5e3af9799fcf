"""Cells of trees as lazy xarray arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from xarray.backends import BackendArray
from xarray.core import indexing

from ._dataset import Dataset


class Cells(BackendArray):
    """The cells of a level with an axis for bands, read on access."""

    def __init__(self, tree: Dataset, level: int, void: Void) -> None:
        self.tree = tree
        self.level = level
        self.shape = (tree.count, *tree._shape_at(level))
        self.dtype = void.dtype
        # The number for VOID, if it differs from the tree's own fill value.
        self.fill = None if void.number is None or _same(void.number, tree.fill_value) else void.number

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self.read)

    def __getstate__(self) -> dict[str, Any]:
        # (Copies do not need the version, but Dask tokens are computed from pickled bytes.)
        return {**self.__dict__, "version": self.tree.__dask_tokenize__()}

    def read(self, key: tuple[Any, ...]) -> Any:
        """Returns the cells at a basic index."""
        band, *cells = key
        if self.fill is not None:
            return self._filled(cells)[band]
        found = np.asarray(self.tree._at_index(self.level, tuple(cells)))
        return (found[np.newaxis] if self.tree.count == 1 else found)[band]

    def _filled(self, key: Sequence[Any]) -> Any:
        """Returns cells of all bands, with the number that was chosen for VOID."""
        first, last, parts = [], [], []
        for part, length in zip(key, self.shape[1:]):
            positions = range(length)[part]
            if isinstance(positions, int):
                positions, part = range(positions, positions + 1), 0
            elif positions:
                ends = (positions[0] - min(positions), positions[-1] - min(positions))
                stop = ends[1] + (1 if positions.step > 0 else -1)
                part = slice(ends[0], stop if stop >= 0 else None, positions.step)
            else:
                positions, part = range(1), slice(0, 0)
            first.append(min(positions))
            last.append(max(positions) + 1)
            parts.append(part)
        # (Windows are in cells of the deepest level, x first.)
        shift = self.tree.depth - self.level
        low = [cell << shift for cell in first]
        high = [min(cell << shift, length) for cell, length in zip(last, self.tree.shape)]
        window = (*low[::-1], *(end - start for start, end in zip(low[::-1], high[::-1])))
        read: Any = self.tree.read(window=window, level=self.level, masked=True)
        filled: Any = np.where(np.ma.getmaskarray(read), self.dtype.type(self.fill), read.data.astype(self.dtype))
        return filled[(slice(None), *parts)]


class Series(BackendArray):
    """Cells of several layers, concatenated along a new first axis; each layer is read on
    access.
    """

    def __init__(self, layers: Sequence[Cells]) -> None:
        self.layers = list(layers)
        # (A single band has no axis.)
        self.key = (0,) if layers[0].shape[0] == 1 else ()
        self.shape = (len(layers), *layers[0].shape[len(self.key) :])
        self.dtype = layers[0].dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._read)

    def _read(self, key: tuple[Any, ...]) -> Any:
        at, *cells = key
        if not isinstance(at, slice):
            return self.layers[at].read((*self.key, *cells))
        parts = [layer.read((*self.key, *cells)) for layer in self.layers[at]]
        # (`np.stack` needs at least one array.)
        return np.stack(parts) if parts else np.empty((0, *self.shape[1:]), self.dtype)[(slice(None), *cells)]


class Void(NamedTuple):
    """The number that represents VOID, and a sample type that holds it."""

    number: float | None
    dtype: np.dtype[Any]


def void_of(*trees: Dataset) -> Void:
    """Returns a number that means VOID, and nothing else, in all of several trees of one type.
    There is none if nothing is VOID, in solids, where 0 is empty, and with an opacity band, where
    VOID has opacity 0. If every number is in use, the result is one of a wider type.
    """
    tree = trees[0]
    if tree.rule == "occupancy" or tree._facts()["alpha"] is not None:
        return Void(None, tree.dtype)
    facts = [other._statistics() for other in trees]
    if all(other.nodata is None and not about["void_cells"] for other, about in zip(trees, facts)):
        return Void(None, tree.dtype)
    if tree.dtype.kind == "f":
        same = all(_same(other.fill_value, tree.fill_value) for other in trees)
        return Void(tree.fill_value if same else np.nan, tree.dtype)
    limits = np.iinfo(tree.dtype)
    numbers = [other.nodata for other in trees if other.nodata is not None and float(other.nodata).is_integer() and limits.min <= other.nodata <= limits.max]
    for number in (*dict.fromkeys(numbers), limits.min, limits.max):
        if all(_is_missing(other, number) or _is_free(number, about) for other, about in zip(trees, facts)):
            return Void(number, tree.dtype)
    if tree.dtype.itemsize == 8:
        raise ValueError(f"{tree.path}: the minimum and the maximum of {tree.dtype} occur as samples, and no wider type can represent VOID; read it with masked=True")
    return Void(limits.min - 1, np.dtype({1: np.int16, 2: np.int32, 4: np.int64}[tree.dtype.itemsize]))


def _is_free(number: float, facts: dict[str, Any]) -> bool:
    """Returns whether no sample is a number."""
    return not facts["cells"] or all(number < low or number > high for _, low, high, _, _ in facts["channels"])


def _is_missing(tree: Dataset, number: float) -> bool:
    """Returns whether a number marks samples that are missing in a band, whatever the other bands
    have.
    """
    return tree._missing is not None and tree._missing == number


def _same(a: float, b: float) -> bool:
    return a == b or (a != a and b != b)
