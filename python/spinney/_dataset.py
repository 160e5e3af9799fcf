"""Open trees."""

from __future__ import annotations

import asyncio
import os
import tempfile
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path as FilePath
from typing import Any, BinaryIO, Literal, Self, overload

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import coordinates_of_points, points_of, rows_of
from ._remote import access_again, content_token, kept_name, remote_access_of
from ._files import MEMORY, log
from ._features import Edge, features_over
from ._progress import memory_of, working
from ._types import (
    Array,
    BandStatistics,
    Blocks,
    Box,
    Commit,
    Coordinates,
    Hits,
    Labels,
    LevelCounts,
    Path,
    Points,
    Progress,
    Solid,
    Statistics,
    Transform,
    Window,
)
from ._zonal import definition_of
from ._zones import Zones


def open(
    path: Path | BinaryIO,
    *,
    view: str | Sequence[str] = (),
    commit: int | None = None,
    positioned: bool = False,
    layer: str | int | None = None,
    storage_options: Mapping[str, Any] | None = None,
    no_remote: bool = False,
    no_external: bool = False,
) -> Dataset:
    """Opens a tree file of either format, or a commit of one: `map.autumn@12`, or `commit=12`.

    In a file of several layers the first is opened, or the one with the name or index (from 0)
    `layer`, which the path can contain: `stack.goblin:B08`. `names` lists all layers. `ds["B08"]`
    is another one; `ds[["B08", "B04", "B03"]]` has two to four layers as its bands, whatever their
    cell sizes.

    `view` is a list of operations as in `spinney transform`, which are applied on access, such as
    `"rotate=30"` or `["window=0,0,512,512", "scale=0.5"]`. They can calculate, with bands and with
    other files: `"calc=(b4-b3)/(b4+b3)"`, `"calc=(nir-b1)/(nir+b1),nir=B08.goblin"`,
    `"reduce=median,type=u16"`. A coarse level of such a view is calculated from the numbers of that
    level (`Level.is_approximate`); statistics, zones and searches are calculated from the cells.

    Remote files are opened by their URLs (`https://`, `s3://`, `gs://`, `az://`), with the
    credentials that the store's own programs use, or with `storage_options`, by their names in
    object_store (`{"aws_region": "eu-north-1", "skip_signature": True}`) or in fsspec (`{"anon":
    True, "client_kwargs": {"region_name": "eu-north-1"}}`). Files of fsspec
    (`fsspec.open("github://...")`, or only the URL, such as `"github://..."`) and open binary files
    (`io.BytesIO(data)`) are opened, too. A query fetches only what it needs, in few batches of
    parallel requests, and caches it. With `no_remote` any use of a remote file is an error; with
    `no_external` files whose data are in other files are. For builds and other functions see
    `restricted`.

    Files are mapped. If a mapped file is truncated or its disk fails, the system ends the whole
    process (SIGBUS). With `positioned=True` files are read without mapping; use it for files that
    may be replaced in place, or that are on network file systems.

    Raises FileNotFoundError or another OSError if the file cannot be read, is not a tree file or is
    corrupt, ValueError for an impossible operation.
    """
    steps = [view] if isinstance(view, str) else list(view)
    layer = None if layer is None else str(layer)
    name, remote = remote_access_of(path, storage_options, no_remote, no_external)
    try:
        return Dataset(name, steps, commit, positioned, layer, remote)
    except OSError:
        if commit is not None and (os.path.exists(name) or "://" in name):
            with Dataset(name, steps, None, positioned, layer, remote) as ds:
                if ds.commit is None:
                    raise ValueError(f"{ds.path}: has no commits, since it is a {ds.format} file; omit commit") from None
        raise


class Dataset(Zones):
    """An open tree, or a view of one: see `spinney.open`.

    Indices are those of cells: `ds[y0:y1, x0:x1]`, in octrees `ds[z, y, x]`, with strides and `...`
    as in NumPy. If there are several bands, they are the first axis of the result, as in
    `numpy.asarray(ds)`. A closed dataset raises ValueError.

    A dataset can be used by any number of threads at the same time, is pickled by path, view and
    commit, and may be used by forked processes.
    """

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        # (With the commit that is read, so that the copy sees the same state.)
        storage, file, refused = self._remote
        name = kept_name(self.path, file)
        return _reopen, (name, self.view, self.commit, self.positioned, self.layer or None, storage, file and file[2], refused)

    def __dask_tokenize__(self) -> Any:
        # (With the version of the file, since another file may get its name.)
        _, file, _ = self._remote
        content = None if file is None else content_token(file[2])
        return type(self).__name__, str(self.path), self.view, self.commit, self.layer, self._versions(), content

    def __repr__(self) -> str:
        name = _native.shown(str(self.path))
        if self.closed:
            return f"<spinney.Dataset {name!r}, closed>"
        commit = "" if self.commit is None else f"@{self.commit}"
        commit += f":{self.layer}" if self.layer else ""
        steps = f" through {', '.join(self.view)}" if self.view else ""
        kind = "quadtree" if self.ndim == 2 else "octree"
        size = " x ".join(map(str, reversed(self.shape)))
        bands = "" if self.count == 1 else f"{self.count} bands of "
        place = f", {self.crs}" if self.crs and len(self.crs) < 40 else ""
        return (
            f"<spinney.Dataset {name + commit!r}{steps}: {kind} of {size} cells, "
            f"{bands}{self.dtype}, {self.kind}, depth {self.depth}{place}>"
        )

    # Cells

    def level(self, level: int) -> Level:
        """Returns an indexable object of the cells of a level: `ds.level(9)[0:256, 0:256]`."""
        return Level(self, level)

    def mapped(
        self, window: Window | None = None, *, coordinates: Coordinates = None, level: int | None = None
    ) -> Array | None:
        """Returns cells of the mapped file as a read-only array, without a copy; `None` if that is
        impossible.

        It is possible for a region within one dense block of a Goblin file: where no two cells are
        alike, within aligned windows of up to 256 x 256 cells (16 x 16 x 16 in octrees). `read`
        reads any region. The mapping exists for as long as such an array does, also after the
        dataset is closed.
        """
        return self._mapped(window, coordinates, level)

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> Array:
        return _as_array(self[...], dtype, copy)

    def __dlpack__(self, **options: Any) -> Any:
        return self[...].__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        return 1, 0

    def __len__(self) -> int:
        return self.shape[0]

    # Queries

    @overload
    def sample(
        self,
        points: Points,
        *,
        bands: int | Sequence[int] | None = None,
        level: int | None = None,
        coordinates: Coordinates = None,
        masked: Literal[False] = False,
        fill: float | None = None,
    ) -> Array: ...
    @overload
    def sample(
        self,
        points: Points,
        *,
        bands: int | Sequence[int] | None = None,
        level: int | None = None,
        coordinates: Coordinates = None,
        masked: Literal[True],
        fill: float | None = None,
    ) -> np.ma.MaskedArray[Any, Any]: ...
    def sample(
        self,
        points: Points,
        *,
        bands: int | Sequence[int] | None = None,
        level: int | None = None,
        coordinates: Coordinates = None,
        masked: bool = False,
        fill: float | None = None,
    ) -> Array | np.ma.MaskedArray[Any, Any]:
        """Returns the values at points: an array with a row per point and a column per band.
        `bands` are numbers counted from 1; a single one gives an array without columns.

        Points are `(x, y)` in world coordinates, in octrees `(x, y, z)`, or in other `coordinates`:
        "cells" are columns and rows of the deepest level, "lonlat" degrees of longitude and
        latitude, and any coordinate system is accepted. Unless `coordinates` is given, a GeoSeries
        or GeoDataFrame of points is in its own `crs`, features of GeoJSON are in degrees, and
        points of shapely are in world coordinates. At a coarser `level` the value is that of the
        block around the point. VOID, and points outside, have the number `fill` (by default
        `fill_value`), or are masked.
        """
        rows, own = coordinates_of_points(points, self.ndim)
        array = points_of(rows, self.ndim)
        if coordinates is None:
            coordinates = "world" if own is None or self.crs is None else definition_of(own)
        values, found = self._sample_points(array, level, coordinates, fill)
        result: Any = values
        if masked:
            mask = np.array(np.broadcast_to(~found[:, None], values.shape))
            if self._missing is not None:
                mask |= values == values.dtype.type(self._missing)
            result = np.ma.MaskedArray(values, mask=mask)
        if bands is None:
            return result  # type: ignore[no-any-return]
        wanted = np.asarray(bands)
        if wanted.dtype.kind not in "iu" or wanted.ndim > 1:
            raise TypeError("bands: expected a number, counted from 1, or a list of numbers")
        if wanted.size and not 1 <= wanted.min() <= wanted.max() <= self.count:
            raise IndexError(f"bands: got {bands}, expected 1 to {self.count}")
        return result[:, wanted - 1]  # type: ignore[no-any-return]

    async def aread(self, *args: Any, **options: Any) -> Any:
        """Runs `read` on a thread outside of the event loop: many calls fetch their regions of a
        remote file at the same time.
        """
        return await asyncio.to_thread(self.read, *args, **options)

    async def asample(self, points: Points, **options: Any) -> Any:
        """Runs `sample` on a thread outside of the event loop."""
        return await asyncio.to_thread(lambda: self.sample(points, **options))

    async def azonal(self, geometries: Any, *args: Any, **options: Any) -> Any:
        """Runs `zonal` on a thread outside of the event loop."""
        return await asyncio.to_thread(self.zonal, geometries, *args, **options)

    def stats(self, window: Window | None = None, *, coordinates: Coordinates = None) -> Statistics:
        """Returns exact statistics of a region. The cost depends on the length of its border, not
        on its area.

        The region is a window of cells, or with other `coordinates` ("world", "lonlat",
        "EPSG:3035") minimum and maximum ones.
        """
        facts = self._statistics(window, coordinates)
        bands = tuple(BandStatistics(*band) for band in facts["channels"])
        return Statistics(facts["cells"], facts["void_cells"], bands, dict(facts["classes"]))

    def level_counts(self, *, progress: Progress = None) -> list[LevelCounts]:
        """Returns the nodes of each level of the file's tree, root first:
        `ds.level_counts()[-1].leaf` is the number of cells with a value of their own.

        Goblin files store these counts; those of Autumnal files are computed by reading every
        record. A view raises ValueError.
        """
        with working(progress) as terms:
            return [LevelCounts(*nodes) for nodes in self._level_counts(terms)]

    def histogram(
        self,
        bins: int = 16,
        range: tuple[float, float] | None = None,
        *,
        window: Window | None = None,
        coordinates: Coordinates = None,
    ) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.float64]]:
        """Counts a region's cells in equal bins of a range of the first band; returns counts and
        bin edges, as `numpy.histogram`.

        The default range is that of the region's samples; samples outside of the range count for
        the first or the last bin.
        """
        if range is None:
            bands = self.stats(window, coordinates=coordinates).bands
            low, high = (bands[0].min, bands[0].max) if bands else (0.0, 1.0)
            if not low < high:
                low, high = low - 0.5, high + 0.5
        else:
            low, high = range
        counts = self._count_bins(bins, low, high, window, coordinates)
        return counts, np.linspace(low, high, bins + 1)

    def find(
        self,
        value: float | None = None,
        *,
        above: float | None = None,
        below: float | None = None,
        window: Window | None = None,
        coordinates: Coordinates = None,
        limit: int | None = None,
        largest: int | None = None,
        within: Any = None,
        where: Mapping[str, Any] | str | None = None,
        edge: Edge | None = None,
        memory: int | str = MEMORY,
    ) -> Blocks:
        """Returns the largest blocks of the tree whose cells all have a value, or one above or
        below a number (first band).

        They are in FD order, at most `limit` of them; or, with `largest`, only that many, largest
        first. With features `within` (the path of a file, or anything with a `__geo_interface__`)
        only cells of those that meet `where` are searched.
        """
        if within is None and (where is not None or edge is not None):
            raise ValueError("where, edge: select features, expected within")
        given = [(name, number) for name, number in (("equal", value), ("above", above), ("below", below))]
        given = [(name, number) for name, number in given if number is not None]
        if len(given) != 1:
            raise ValueError("find: expected one of value, above and below")
        if limit is not None and largest is not None:
            raise ValueError("find: got limit and largest, expected one of them")
        ((name, number),) = given
        assert number is not None
        if within is None:
            blocks = self._find_blocks(name, number, window, coordinates, limit, largest)
        else:
            own = coordinates if window is None else None
            with features_over(within, coordinates=own, where=where, edge=edge) as features:
                blocks = self._find_blocks(name, number, window, coordinates, limit, largest, features, memory_of(memory))
        codes, levels, boxes, found, has_value = blocks
        if self.dtype in (np.uint64, np.int64):
            values: Any = np.ma.MaskedArray(found, mask=~has_value)
        else:
            values = np.where(has_value, found.astype(np.float64), np.nan)
        return Blocks(np.array(codes, dtype=np.str_), levels, boxes, self._world_of(boxes), values)

    def labels(
        self,
        *,
        connect: int | None = None,
        classes: Dataset | None = None,
        neighbours: bool = True,
        memory: int | str = MEMORY,
        threads: int | None = None,
        progress: Progress = None,
    ) -> Labels:
        """Returns a table of labels, which are the values of the cells: the number of cells of each
        label, their bounding box, and the adjacent labels.

        With `connect` (4 or 8, in octrees 6 or 26) labels are connected components of equal cells,
        numbered as by `transform(..., "components=4")`, and their values are the classes. Otherwise
        a label's class is the value of `classes`, a tree of the same cells, at the label's first
        cell. `neighbours=False` omits the adjacent labels. Sums are kept within `memory`, with
        temporary files if needed; the resulting arrays are not included in this limit.
        """
        if connect is not None and classes is not None:
            raise ValueError("labels: got connect and classes, expected one of them; components have classes of their own")
        if classes is not None and (classes.shape != self.shape or not np.array_equal(classes.matrix, self.matrix)):
            raise ValueError(f"classes: got a tree of {classes.shape} cells, expected {self.shape} at the same position")
        with working(progress, threads) as terms:
            labels, own, cells, boxes, firsts, pairs, edges, each = self._labels(connect, neighbours, memory_of(memory), terms)
        values: Any = own
        if classes is not None:
            values = classes.sample(firsts, coordinates="cells", masked=True)
        if values is not None and values.shape[1] == 1:
            values = values[:, 0]
        areas = cells * np.float64(np.nan if each is None else each)
        return Labels(labels, values, cells, areas, boxes, self._world_of(boxes), pairs, edges)

    def _world_of(self, boxes: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Converts boxes of cells, each a corner and sizes, to world coordinates."""
        axes = self.ndim
        low, high = boxes[:, :axes], boxes[:, :axes] + boxes[:, axes:]
        matrix = self.matrix
        linear = matrix[:axes, :axes]
        # (A box's minimum comes from the end of each edge that is lower.)
        least = np.minimum(low[:, None, :] * linear, high[:, None, :] * linear).sum(axis=2)
        most = np.maximum(low[:, None, :] * linear, high[:, None, :] * linear).sum(axis=2)
        return np.hstack([least, most]) + np.tile(matrix[:axes, 3], 2)

    def log(self) -> list[Commit]:
        """Returns the commits of the file, newest first."""
        return log(self.path)

    # Octrees

    def volume(self, level: int | None = None) -> float:
        """Returns the volume of an octree's solid, in cubic world units; coarser levels have the
        same volume.
        """
        return self.solid(level).volume

    def solid(self, level: int | None = None, *, surface: bool = False, threads: int | None = None, progress: Progress = None) -> Solid:
        """Returns volume, centre of gravity and bounds of an octree's solid, with `surface` also
        its surface area.
        """
        with working(progress, threads) as terms:
            facts = self._measure(level, surface, terms)
        box = facts.pop("bounds")
        centre = facts.pop("centre")
        bounds = None if box is None else Box(*box[0], *box[1])
        return Solid(bounds=bounds, centre=None if centre is None else tuple(centre), **facts)

    def contains(self, points: Points, *, level: int | None = None) -> npt.NDArray[np.bool_]:
        """Returns whether points `(x, y, z)` in world coordinates lie in cells that are at least
        half full (in trees without occupancy, in cells that are not VOID).
        """
        if self.ndim != 3:
            raise ValueError(f"{_native.shown(str(self.path))}: is a quadtree, expected an octree")
        values, found = self._sample_points(points_of(points, 3), level, "world", None)
        if self.rule == "occupancy":
            found &= values[:, 0] >= 128
        return found

    def rays(
        self, origins: Points, directions: Points, *, level: int | None = None, smooth: bool = False
    ) -> Hits:
        """Returns the first hits of rays in world coordinates: cells that are at least half full,
        or with `smooth` the surface between them. A single origin or direction applies to all rays.
        """
        starts, ways = np.broadcast_arrays(rows_of(origins, "origins"), rows_of(directions, "directions"))
        distance, points, cells = self._cast_rays(
            np.ascontiguousarray(starts), np.ascontiguousarray(ways), level, smooth
        )
        return Hits(distance, points, cells)

    def slice(
        self,
        *,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
        coordinates: Literal["cells", "world"] = "cells",
        level: int | None = None,
        masked: bool = False,
        fill: float | None = None,
    ) -> Array:
        """Returns a slice of an octree at a cell of the deepest level along x, y or z, or with
        `coordinates` "world" at a coordinate.

        A slice across z has rows along y; others have rows along z, lowest first.
        """
        given = [(axis, at) for axis, at in enumerate((x, y, z)) if at is not None]
        if len(given) != 1:
            raise ValueError("slice: expected one of x, y and z")
        ((axis, at),) = given
        return self._slice_across(axis, at, coordinates, level, masked, fill)

    # Notebooks

    def _repr_png_(self) -> bytes | None:
        if self.closed:
            return None
        with tempfile.TemporaryDirectory(prefix="spinney-") as directory:
            path = os.path.join(directory, "image.png")
            if self.ndim == 3:
                self.render(path, size=(320, 240), samples=1)
            else:
                most = max(self.shape)
                rows, columns = (max(1, min(length, length * 320 // most)) for length in self.shape)
                self.save(path, shape=(rows, columns))
            return FilePath(path).read_bytes()

    def _repr_html_(self) -> str:
        from base64 import b64encode

        png = self._repr_png_()
        image = "" if png is None else f'<img src="data:image/png;base64,{b64encode(png).decode()}"/><br/>'
        return f"{image}<code>{escape(repr(self))}</code>"


class Level:
    """The cells of one level of a dataset, which can be indexed like an array."""

    def __init__(self, dataset: Dataset, level: int) -> None:
        self.dataset = dataset
        self.level = level
        self.shape = tuple(dataset._shape_at(level))
        """Rows and columns; in octrees planes come first."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the samples."""
        return self.dataset.dtype

    @property
    def ndim(self) -> int:
        """2, or 3 for octrees."""
        return len(self.shape)

    @property
    def is_approximate(self) -> bool:
        """Whether the cells are calculated (`view="calc=..."`) from the numbers of this level, not
        from the tree's cells.
        """
        return self.dataset._is_approximate(self.level)

    @property
    def transform(self) -> Transform:
        """The transform from columns and rows of the level to world coordinates."""
        a, b, c, d, e, f = self.dataset.transform
        scale = 2.0 ** (self.dataset.depth - self.level)
        return Transform(a * scale, b * scale, c, d * scale, e * scale, f)

    def _as_tree(self) -> Dataset:
        """Returns the level's cells as a dataset."""
        ds = self.dataset
        steps = [] if self.level == ds.depth else [f"depth={self.level}"]
        if not steps:
            return ds
        return Dataset(str(ds.path), [*ds.view, *steps], ds.commit, ds.positioned, ds.layer or None, ds._remote)

    def __dask_tokenize__(self) -> Any:
        return type(self).__name__, self.level, self.dataset.__dask_tokenize__()

    def __getitem__(self, key: Any) -> Any:
        return self.dataset._at_index(self.level, key)

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> Array:
        return _as_array(self[...], dtype, copy)

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        size = " x ".join(map(str, reversed(self.shape)))
        return f"<level {self.level} of {_native.shown(str(self.dataset.path))!r}: {size} cells>"


def _reopen(
    path: str,
    view: list[str],
    commit: int | None,
    positioned: bool,
    layer: str | None = None,
    storage: list[tuple[str, str]] | None = None,
    file: Any = None,
    refused: tuple[bool, bool] = (False, False),
) -> Dataset:
    return Dataset(path, view, commit, positioned, layer, access_again(file, storage, refused))


def _as_array(array: Array, dtype: npt.DTypeLike | None, copy: bool | None) -> Array:
    """Implements `__array__`: cells are always read, so there is no array without a copy."""
    if copy is False:
        raise ValueError("copy=False: cells are read from a file, which needs a copy")
    return array if dtype is None else array.astype(dtype, copy=False)
