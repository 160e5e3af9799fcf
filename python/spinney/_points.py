"""Point trees: each point is stored once, in the coarsest node whose spacing it keeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import points_of
from ._block_trees import BlockTree
from ._files import MEMORY
from ._options import names_of
from ._progress import memory_of, working
from ._remote import path_of, remote_access_of
from ._sources import paths_of
from ._metadata import crs_text
from ._types import Coordinates, Path, Points, Progress

Polygons = Sequence[Sequence[Points]]
"""Polygons, each an outer ring and its holes: rows of x and y."""

NAMES = {"u8": "u1", "u16": "u2", "i16": "i2", "u32": "u4", "i32": "i4", "f32": "f4", "f64": "f8", "i8": "i1", "u64": "u8", "i64": "i8"}
"""NumPy types by the library's names."""


@dataclass(frozen=True)
class BuiltPoints:
    """Counts of a new point tree."""

    points: int
    duplicates: int
    """Points with the coordinates of another one: for each position, all but one."""


@dataclass(frozen=True)
class PointColumn:
    """Summary of a coordinate or an attribute of points."""

    count: int
    """The number of values that are numbers."""
    min: float
    max: float
    mean: float


def build_points(
    source: Path | Sequence[Path] | Any,
    out: Path,
    *,
    where: str | None = None,
    attributes: Sequence[str] | None = None,
    leaf_size: int | None = None,
    crs: Any = None,
    memory: int | str = MEMORY,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> BuiltPoints:
    """Builds a point tree, a .goblin file, from one or several LAS or LAZ files; a PLY or NPY file;
    a file of point features (CSV, GeoPackage, GeoJSON, FlatGeobuf, shapefile), whose numbers become
    attributes, and whose heights, or else an attribute `z`, the third coordinate; or an array. An
    array has rows of x and y, or x, y and z, or is structured with such fields, and its other
    fields become attributes::

        spinney.build_points(
            "scan.laz", "scan.goblin", where="classification=2", attributes=["intensity"]
        )
        spinney.build_points(xyz, "cloud.goblin", crs="EPSG:32632")

    Conditions (`where`) select points, and `attributes` selects some of their attributes. Any
    number of points is built within `memory`. Nodes of up to `leaf_size` points (50,000) are not
    divided.
    """
    paths = paths_of(source)
    given = (leaf_size, crs_text(crs), None if attributes is None else names_of(attributes), memory_of(memory), where)
    with working(progress, threads, max_bytes) as terms:
        if paths is not None:
            return BuiltPoints(*_native.build_point_files(paths, path_of(out), given, terms))
        positions, columns = _columns(source)
        return BuiltPoints(*_native.build_point_array(positions, columns, path_of(out), given, terms))


def _columns(source: Any) -> tuple[npt.NDArray[np.float64], list[tuple[str, str, npt.NDArray[np.uint8]]]]:
    """Returns coordinates, and names, types and bytes of attributes."""
    array = np.asarray(source)
    if array.dtype.names is None:
        axes = 2 if array.ndim == 2 and array.shape[1] == 2 else 3
        return points_of(array, axes, "source"), []
    names = list(array.dtype.names)
    coordinates = [name for name in ("x", "y", "z") if name in names]
    if coordinates[:2] != ["x", "y"] or array.ndim != 1:
        raise ValueError(f"source: got fields {', '.join(names)}, expected x and y among them")
    positions = np.ascontiguousarray(np.stack([array[name].astype(np.float64) for name in coordinates], axis=1))
    known = {np.dtype(code): name for name, code in NAMES.items()}
    columns = []
    for name in names:
        if name in coordinates:
            continue
        column = array[name].astype("u1") if array.dtype[name] == np.bool_ else array[name]
        kind = known.get(column.dtype.newbyteorder("="))
        if kind is None:
            raise TypeError(f"{name}: numbers of type {column.dtype} cannot be stored; convert them with astype")
        little = np.ascontiguousarray(column.astype(column.dtype.newbyteorder("<")))
        columns.append((name, kind, little.view(np.uint8)))
    return positions, columns


def open_points(path: Path, *, positioned: bool = False, storage_options: Mapping[str, Any] | None = None) -> PointTree:
    """Opens a point tree, also a remote one (`https://`, `s3://` ...): see `open`."""
    name, remote = remote_access_of(path, storage_options)
    return PointTree(name, positioned, remote)


class PointTree(BlockTree, _native.Points):
    """An open point tree, see `open_points`; a context manager.

    Queries return all points, or those in a `window` (minimum and maximum coordinates, of two or
    three axes), in `polygons`, or in a `ball` (a centre and a radius), down to a `level`, that meet
    conditions (`where="classification=2,intensity>100"`)::

        with spinney.open_points("scan.goblin") as points:
            points.read(window=(500100, 5200100, 500300, 5200250), attributes=["intensity"])
            points.read(level=2)                    # a sketch of all of it
            points.nearest(positions, k=3)
    """

    def __repr__(self) -> str:
        return f"<spinney.PointTree {_native.shown(str(self.path))}: {'closed' if self.closed else f'{len(self)} points'}>"

    @property
    def attributes(self) -> list[str]:
        """Names of the attributes."""
        return [name for name, *_ in self._facts()["attributes"]]

    @property
    def no_data(self) -> dict[str, float]:
        """Numbers that encode "no value", for attributes that have one (`no_data` of extra bytes of
        LAS), as they are stored: without scale and offset. `read` returns NaN for them if the
        attribute has a scale; `stats` and conditions ignore them.
        """
        numbers = {name: number for name, _, _, number in self._facts()["attributes"] if number is not None}
        return {name: int(number) if float(number).is_integer() else number for name, number in numbers.items()}

    @property
    def dtype(self) -> np.dtype[Any]:
        """The dtype of the rows that `read` returns: x, y and z, then the attributes."""
        return self._dtype(None)

    @property
    def depth(self) -> int:
        """The deepest level of nodes."""
        return int(self._facts()["depth"])

    @property
    def duplicates(self) -> int:
        """The number of points with the coordinates of another one: for each position, all but
        one.
        """
        return int(self._facts()["duplicates"])

    def read(
        self,
        *,
        window: Sequence[float] | None = None,
        polygons: Polygons | None = None,
        ball: tuple[Sequence[float], float] | None = None,
        level: int | None = None,
        where: str | None = None,
        attributes: Sequence[str] | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> npt.NDArray[Any]:
        """Returns points as a structured array with fields x, y and z, and all or some attributes.
        Points of coarse levels come first.
        """
        names = None if attributes is None else names_of(attributes)
        with working(progress, threads) as terms:
            rows = self._read(_wanted(window, polygons, ball, level, where), names, terms)
        return rows.view(self._dtype(names))

    def count(
        self,
        *,
        window: Sequence[float] | None = None,
        polygons: Polygons | None = None,
        ball: tuple[Sequence[float], float] | None = None,
        level: int | None = None,
        where: str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> int:
        """Returns the number of points. Nodes that are entirely within a window are counted without
        reading them.
        """
        with working(progress, threads) as terms:
            return self._count(_wanted(window, polygons, ball, level, where), terms)

    def stats(
        self,
        *,
        window: Sequence[float] | None = None,
        polygons: Polygons | None = None,
        ball: tuple[Sequence[float], float] | None = None,
        level: int | None = None,
        where: str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> dict[str, PointColumn | None]:
        """Returns minima, maxima and means of the coordinates and attributes, by name; None for
        columns without numbers.
        """
        with working(progress, threads) as terms:
            _, columns = self._statistics(_wanted(window, polygons, ball, level, where), terms)
        names = ["x", "y", "z", *self.attributes]
        return {name: None if found is None else PointColumn(*found) for name, found in zip(names, columns, strict=True)}

    def nearest(
        self,
        positions: Points,
        *,
        k: int = 1,
        radius: float = np.inf,
        coordinates: Coordinates = None,
        memory: int | str = MEMORY,
        threads: int | None = None,
        progress: Progress = None,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Returns for each query point the k nearest points, nearest first: their distances, of
        shape (n, k), and their coordinates, (n, k, 3). If there are fewer within the `radius`,
        these are infinity and NaN. In a quadtree z does not count; for query points of x and y
        distances are horizontal. Query points are in the file's own coordinate system, or in other
        `coordinates` ("lonlat", "EPSG:3035", any coordinate system), with z unchanged; results are
        always in the file's own.
        """
        if k < 1:
            raise ValueError(f"k: got {k}, expected 1 or more")
        given = np.asarray(positions, dtype=np.float64)
        if given.ndim == 2 and given.shape[1] == 2:
            given = np.column_stack([given, np.full(len(given), np.nan)])
        rows = points_of(given, 3, "positions")
        with working(progress, threads) as terms:
            distances, found = self._nearest(rows, k, float(radius), memory_of(memory), "world" if coordinates is None else coordinates, terms)
        return distances, found.reshape(len(rows), k, 3)

    def write(
        self,
        out: Path,
        *,
        window: Sequence[float] | None = None,
        polygons: Polygons | None = None,
        ball: tuple[Sequence[float], float] | None = None,
        level: int | None = None,
        where: str | None = None,
        attributes: Sequence[str] | None = None,
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> int:
        """Writes points as .las, .laz, .csv, .ply or .npy; returns their number."""
        names = None if attributes is None else names_of(attributes)
        with working(progress, threads, max_bytes) as terms:
            return self._write(path_of(out), _wanted(window, polygons, ball, level, where), names, terms)

    def raster(
        self,
        out: Path,
        rule: Literal["min", "max", "mean", "count"],
        cell: float,
        *,
        attribute: str | None = None,
        where: str | None = None,
        memory: int | str = MEMORY,
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> None:
        """Rasterizes points to a quadtree with cells of width `cell`. A cell aggregates z, or an
        attribute, of its points by `rule`; cells without points are VOID.
        """
        step = f"{rule},cell={float(cell)!r}" + ("" if attribute is None else f",attribute={attribute}")
        with working(progress, threads, max_bytes) as terms:
            self._raster(path_of(out), step, where, memory_of(memory), terms)

    def _dtype(self, names: Sequence[str] | None) -> np.dtype[Any]:
        kinds = {name: NAMES[kind] for name, kind, *_ in self._facts()["attributes"]}
        fields = [(name, "<f8") for name in "xyz"]
        return np.dtype([*fields, *((name, f"<{kinds[name]}") for name in (kinds if names is None else names))])


def _wanted(
    window: Sequence[float] | None,
    polygons: Polygons | None,
    ball: tuple[Sequence[float], float] | None,
    level: int | None,
    where: str | None,
) -> tuple[Any, Any, Any, int | None, str | None]:
    """Returns the native module's description of a selection."""
    if sum(given is not None for given in (window, polygons, ball)) > 1:
        raise ValueError("window, polygons, ball: got several, expected one of them")
    corners = None
    if window is not None:
        numbers = [float(number) for number in window]
        if len(numbers) not in (4, 6):
            raise ValueError(f"window: got {len(numbers)} numbers, expected 4 or 6: minimum, then maximum coordinates")
        half = len(numbers) // 2
        low, high = numbers[:half], numbers[half:]
        corners = ([*low, -np.inf], [*high, np.inf]) if half == 2 else (low, high)
    rings = None if polygons is None else [[points_of(ring, 2, "polygons").tolist() for ring in part] for part in polygons]
    around = None if ball is None else ([float(number) for number in ball[0]], float(ball[1]))
    return corners, rings, around, level, where
