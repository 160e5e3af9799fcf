"""Edits of Autumnal files."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterable, Mapping, Sequence
from operator import index
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from . import _native
from ._build import build
from ._dataset import Dataset, open
from ._files import MEMORY
from ._options import time_of
from ._features import Edge, Overlaps, features_over
from ._progress import memory_of, working
from ._remote import is_path, path_of
from ._types import ClassMatching, Commit, Path, Progress, Units, Window, commit_of


def edit(
    path: Path,
    message: str | None = None,
    *,
    author: str | None = None,
    time: int | None = None,
    memory: int | str = MEMORY,
    threads: int | None = None,
    progress: Progress = None,
) -> Edit:
    """Opens an Autumnal file for editing::

        with spinney.edit("map.autumn", message="A new wood") as e:
            e.fill(3, window=(60, 60, 40, 40))
            e.paste("survey.goblin")

    All changes become one commit at the end of the block, or none if an exception leaves it.
    Without a block, `commit` commits the changes and `close` discards them. Cells can be assigned
    to, `e[y0:y1, x0:x1] = array`, which is what `dask.array.store` does. One process edits a file
    at a time, and any number of others can read it meanwhile. The default of `author` is the
    environment's SPINNEY_AUTHOR, that of `time` (seconds since 1970) its SOURCE_DATE_EPOCH, or now.

    Raises OSError if another process edits the file.
    """
    name = os.environ.get("SPINNEY_AUTHOR", "") if author is None else author
    return Edit(path, message, name, time_of(time), memory_of(memory), threads, progress)


class Edit:
    """An open file for editing: see `spinney.edit`."""

    def __init__(
        self, path: Path, message: str | None, author: str, time: int | None, memory: int, threads: int | None, progress: Progress
    ) -> None:
        self.path = path_of(path)
        self.message = message
        self.made: Commit | None = None
        """The commit that was made, when all is done; `None` if nothing has changed."""
        self._lock = threading.Lock()
        self._author, self._time, self._memory = author, time, memory
        self._threads, self._progress = threads, progress
        self._done: list[str] = []
        with open(self.path) as tree:
            self._ndim, self._dtype, self._kind, self._rule = tree.ndim, tree.dtype, tree.kind, tree.rule
            self._shape = tree.shape
            self._nodata, self._count = tree._missing, tree.count
        self._editor = _native.Editor(self.path, memory)
        self._is_closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self.close()
        else:
            self.commit()

    def commit(self) -> Commit | None:
        """Commits all changes, and closes the file. Returns `None` if nothing has changed, or if it
        is closed already.
        """
        if self._is_closed:
            return self.made
        message = self.message if self.message is not None else "; ".join(self._done)
        made = self._editor.commit(message, self._author, self._time)
        self._is_closed = True
        self.made = None if made is None else commit_of(made)
        return self.made

    def close(self) -> None:
        """Discards all changes that are not committed, and closes the file."""
        if not self._is_closed:
            self._is_closed = True
            self._editor.close()

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns; in octrees planes come first, and before all of these come bands if
        there are several.
        """
        return self._shape if self._count == 1 else (self._count, *self._shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the samples."""
        return self._dtype

    @property
    def ndim(self) -> int:
        """The number of axes."""
        return len(self.shape)

    def __setitem__(self, key: Any, value: Any) -> None:
        """Assigns an array, or one number, to the cells of an index of integers and slices without
        strides; masked cells become VOID. An array must have all bands.
        """
        first, size, shape = _region(key, self.shape)
        if 0 in size:
            return
        if self._count > 1:
            if first[0] != 0 or size[0] != self._count:
                raise IndexError(f"bands: expected values for all {self._count} bands")
            first = first[1:]
        values = np.ma.asarray(value) if isinstance(value, np.ma.MaskedArray) else np.asarray(value)
        values = np.broadcast_to(values, shape, subok=True).reshape(size)
        mask: Any = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
        if mask is not None and self._count > 1:
            mask = mask.all(axis=0)
        # (One at a time, whichever threads assign.)
        with self._lock:
            self.paste(np.ma.getdata(values), at=first[::-1], mask=mask, void=True)
            self._done[-1] = "Set cells of an array"

    def paste(
        self,
        source: Any,
        *,
        at: Sequence[int] | None = None,
        view: str | Sequence[str] = (),
        void: bool = False,
        mask: Any = None,
        classes: ClassMatching = "name",
        units: Units = "convert",
        round: bool = False,
    ) -> None:
        """Writes a tree file, an image or an array over a region of the tree.

        The region is where the source lies in world coordinates, or starts with the cell `at`,
        `(column, row)` or `(x, y, z)`, and must then be inside the tree; arrays (bands first) need
        `at`. Where the source is VOID the tree is unchanged; with `void` it becomes VOID there.

        The source is converted to the tree's cells and values: classes are matched by name, numbers
        converted by scale, offset and unit, and resampled if cells differ. With `classes` or
        `units` as `"number"` stored numbers are used unchanged; `round` rounds numbers that the
        tree's type cannot hold.
        """
        steps = [view] if isinstance(view, str) else list(view)
        place = None if at is None else [index(number) for number in at]
        if isinstance(source, Dataset):
            steps = [*source.view, *steps]
            source = f"{source.path}@{source.commit}" if source.commit is not None else source.path
        parent = os.path.dirname(os.path.abspath(self.path))
        with working(self._progress, self._threads) as terms, tempfile.TemporaryDirectory(prefix="spinney-", dir=parent) as directory:
            if is_path(source):
                name = path = path_of(source)
                if not _is_tree(path):
                    path = os.path.join(directory, "patch.goblin")
                    build(name, path, kind=self._kind, rule=self._rule, memory=self._memory, threads=self._threads)  # type: ignore[arg-type]
            else:
                if place is None:
                    raise ValueError("at: expected the target of the array's first cell")
                name, path = "an array", os.path.join(directory, "patch.goblin")
                self._build(source, path, mask)
            try:
                self._editor.paste(path, steps, place, void, ("a", classes, units, round), terms)
            except (ValueError, TypeError, OSError) as error:
                # (The caller does not know the temporary tree.)
                if path == name or path not in str(error):
                    raise
                raise type(error)(str(error).replace(path, name)) from None
        self._done.append(f"Paste {name}")

    def _build(self, array: Any, path: str, mask: Any) -> None:
        """Builds a tree of an array, with the kind and rule of the file's tree."""
        if not hasattr(array, "shape"):
            array = np.asarray(array)
        axes = "zyx"[3 - self._ndim :]
        dims: Any = axes if len(array.shape) == self._ndim else "b" + axes
        if not np.can_cast(array.dtype, self._dtype, "safe") and not _holds(array, self._dtype):
            raise TypeError(f"an array of {array.dtype} cannot be pasted into a tree of {self._dtype}")
        if array.dtype != self._dtype:
            array = array.astype(self._dtype)
        kind: Any = self._kind
        build(array, path, dims=dims, mask=mask, kind=kind, rule=self._rule, nodata=self._nodata, memory=self._memory, threads=self._threads)

    def fill(
        self,
        value: float | Sequence[float] | str | None,
        *,
        window: Window | None = None,
        coordinates: Any = None,
        polygon: Any = None,
        block: str | None = None,
        zones: Any = None,
        where: Mapping[str, Any] | str | None = None,
        edge: Edge | None = None,
        overlaps: Overlaps | None = None,
    ) -> None:
        """Sets a region to one value (one number, or one per band); `None` makes it VOID.

        The region is a `window` of cells, or with other `coordinates` ("world", "lonlat",
        "EPSG:3035") of minimum and maximum ones; a `polygon` in world coordinates or in these (a
        ring of vertices, a list of rings, or a shapely polygon); or a `block` of the tree by its FD
        code, such as `"/031"`.

        Or it is the cells of features, `zones`: the path of a file (GeoJSON, FlatGeobuf,
        GeoPackage, shapefile, CSV), anything with a `__geo_interface__` (a GeoDataFrame, shapely),
        or a list of these. `where` selects features, and `edge` decides which cells at the border
        of polygons are included: "centre", "touch" or "area". `value` may then be the name of an
        attribute, whose strings are names of the tree's categories; `overlaps` decides what cells
        get where features overlap.
        """
        if zones is not None:
            if window is not None or polygon is not None or block is not None:
                raise ValueError("fill: expected one of window, polygon, block and zones")
            with (
                features_over(zones, coordinates=coordinates, where=where, edge=edge, value=value, overlaps=overlaps) as features,
                working(self._progress, self._threads) as terms,
            ):
                self._editor.fill_zones(features, value is None, memory_of(self._memory), terms)
            self._done.append(f"Fill features with {'VOID' if value is None else value}")
            return
        if where is not None or edge is not None or overlaps is not None:
            raise ValueError("where, edge, overlaps: select features, expected zones")
        if isinstance(value, str):
            raise TypeError("value: got the name of an attribute, which needs zones")
        rings = None if polygon is None else _rings(polygon)
        if value is None:
            samples = None
        else:
            samples = list(np.atleast_1d(np.asarray(value, dtype=object)))
        with working(self._progress, self._threads) as terms:
            self._editor.fill(samples, window, coordinates, rings, block, terms)
        self._done.append(f"Fill with {'VOID' if value is None else value}")

    def set(self, cells: npt.ArrayLike, values: npt.ArrayLike | None) -> None:
        """Sets single cells, rows of `(column, row)` or `(x, y, z)`, to values: one for all, or a
        row for each; `None` makes them VOID. Of several values for one cell the last counts.
        """
        positions = np.asarray(cells)
        if positions.size == 0:
            return
        if positions.ndim != 2 or positions.shape[1] != self._ndim or positions.dtype.kind not in "iu":
            raise ValueError(f"cells: expected rows of {self._ndim} integers")
        numbers = None
        if values is not None:
            numbers = _numbers(values)
            if numbers.ndim == 1 and len(numbers) == len(positions):
                numbers = numbers[:, None]
            numbers = np.broadcast_to(numbers, (len(positions), numbers.shape[-1] if numbers.ndim else 1))
        with working(self._progress, self._threads) as terms:
            self._editor.set(np.ascontiguousarray(positions, dtype=np.int64), numbers, terms)
        self._done.append(f"Set {len(positions)} cells")

    def apply(
        self,
        operation: str,
        other: Path,
        *,
        classes: ClassMatching = "name",
        units: Units = "convert",
        round: bool = False,
    ) -> None:
        """Replaces the tree by the result of an operation (as in `combine`) on it and another one.
        The other one is taken at its world coordinates, and converted to the tree's cells and
        values as by `paste`.
        """
        with working(self._progress, self._threads) as terms:
            self._editor.combine(operation, path_of(other), ("a", classes, units, round), terms)
        self._done.append(f"Apply {operation} of {path_of(other)}")

    def revert(self, commit: int) -> None:
        """Restores the tree's state at another commit."""
        with working(self._progress, self._threads) as terms:
            self._editor.revert(commit, terms)
        self._done.append(f"Revert to commit {commit}")


def _numbers(values: npt.ArrayLike) -> npt.NDArray[Any]:
    """Returns numbers as an array of 64-bit integers if they are integers, or else of floats."""
    numbers = np.asarray(values) if hasattr(values, "dtype") else np.asarray(values, dtype=object)
    if numbers.dtype == object:
        # (NumPy converts a list of large integers of both signs to floats.)
        whole = all(isinstance(number, int | np.integer) for number in numbers.flat)
        least = min(map(int, numbers.flat), default=0) if whole else 0
        return numbers.astype((np.int64 if least < 0 else np.uint64) if whole else np.float64)
    return numbers.astype({"u": np.uint64, "b": np.uint64, "i": np.int64}.get(numbers.dtype.kind, np.float64))


def _region(key: Any, shape: tuple[int, ...]) -> tuple[list[int], list[int], list[int]]:
    """Returns the first cells, the numbers of cells along each axis, and the shape of an assigned
    region.
    """
    given = list(key) if isinstance(key, tuple) else [key]
    if Ellipsis in given:
        at = given.index(Ellipsis)
        given[at : at + 1] = [slice(None)] * (len(shape) - len(given) + 1)
    given += [slice(None)] * (len(shape) - len(given))
    if len(given) != len(shape):
        raise IndexError(f"index: got {len(given)} indices, expected {len(shape)}")
    first, size, left = [], [], []
    for part, length in zip(given, shape):
        if isinstance(part, slice):
            start, stop, step = part.indices(length)
            if step != 1:
                raise IndexError("index: got a slice with a step, expected steps of 1")
            left.append(max(stop - start, 0))
        else:
            start = index(part) + (length if index(part) < 0 else 0)
            if not 0 <= start < length:
                raise IndexError(f"index: got {part}, expected less than {length}")
            stop = start + 1
        first.append(start)
        size.append(max(stop - start, 0))
    return first, size, left


def _is_tree(path: str) -> bool:
    try:
        open(path).close()
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        # (For a corrupt tree, the tree reader's error is better than an image reader's.)
        return path.split("@")[0].endswith((".goblin", ".autumn")) or "commit" in str(error)
    return True


def _holds(array: Any, dtype: np.dtype[Any]) -> bool:
    """Returns whether all samples of an array in memory fit into another type."""
    if not isinstance(array, np.ndarray) or dtype.kind == "f" or array.dtype.kind == "f":
        return bool(np.can_cast(array.dtype, dtype, "same_kind"))
    limits = np.iinfo(dtype)
    return array.size == 0 or (int(array.min()) >= limits.min and int(array.max()) <= limits.max)


def _rings(polygon: Any) -> list[list[tuple[float, float]]]:
    """Returns the rings of a polygon."""
    if hasattr(polygon, "exterior"):
        given: Iterable[Any] = [polygon.exterior.coords, *(ring.coords for ring in polygon.interiors)]
    elif hasattr(polygon, "geoms"):
        return [ring for part in polygon.geoms for ring in _rings(part)]
    elif len(polygon) and np.ndim(polygon[0][0]) == 0:
        given = [polygon]
    else:
        given = polygon
    return [[(float(corner[0]), float(corner[1])) for corner in ring] for ring in given]
