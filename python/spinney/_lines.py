"""Line trees: line features with their attributes, in a spatial index."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import coordinates_of_points, points_of
from ._block_trees import BlockTree
from ._features import features_over
from ._files import MEMORY
from ._options import names_of
from ._progress import memory_of, working
from ._metadata import crs_text
from ._remote import is_path, path_of, remote_access_of
from ._types import Coordinates, Path, Points, Progress
from ._zonal import definition_of


@dataclass(frozen=True)
class BuiltLines:
    """Counts of a new line tree."""

    features: int
    segments: int
    """Segments between two vertices."""
    length: float


@dataclass(frozen=True)
class LineLevel:
    """Counts of the nodes of one level of a line tree."""

    nodes: int
    segments: int
    """Segments stored in these nodes themselves; `length` is their length."""
    length: float
    most_segments: int
    """Maximum number of segments, and of features, in a node and all below it."""
    most_features: int


@dataclass(frozen=True)
class LineCrossings:
    """Crossings of a tree's lines with other lines, in the order of the others."""

    features: npt.NDArray[np.int64]
    """Numbers of the tree's features."""
    lines: npt.NDArray[np.int64]
    """Numbers of the other lines."""
    positions: npt.NDArray[np.float64]
    """Coordinates of the crossings, of shape (n, 2), in a tree with heights (n, 3)."""
    distances: npt.NDArray[np.float64]
    """Distances from the other lines; 0 where they cross or touch."""

    def __len__(self) -> int:
        return len(self.features)


def build_lines(
    source: Path | Any,
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
) -> BuiltLines:
    """Builds a line tree, a .goblin file, from a file of line features (GeoPackage, GeoJSON,
    FlatGeobuf, shapefile, CSV with WKT), or from features with a `__geo_interface__`, such as a
    GeoDataFrame::

        spinney.build_lines("roads.gpkg", "roads.goblin", where="lanes>=2", attributes=["name"])

    A mesh file (PLY, OBJ, STL ...) becomes a tree of its edges, with the attributes `object` and
    `faces`. If all vertices have heights, the tree has three axes. Conditions (`where`) select
    features, and `attributes` selects some of their attributes. Any number of features is built
    within `memory`. Nodes of up to `leaf_size` segments (1024) are not divided.
    """
    names = None if attributes is None else names_of(attributes)
    origin = path_of(source) if is_path(source) else "features"
    given = (leaf_size, crs_text(crs), names, memory_of(memory), where, origin)
    with features_over(source, has_own_system=True) as features_file, working(progress, threads, max_bytes) as terms:
        return BuiltLines(*_native.build_line_file(features_file["path"], path_of(out), given, terms))


def open_lines(path: Path, *, positioned: bool = False, storage_options: Mapping[str, Any] | None = None) -> LineTree:
    """Opens a line tree, also a remote one (`https://`, `s3://` ...): see `open`."""
    name, remote = remote_access_of(path, storage_options)
    return LineTree(name, positioned, remote)


class LineTree(BlockTree, _native.Lines):
    """An open line tree, see `open_lines`; a context manager. Features are numbered from 0, in
    input order::

        with spinney.open_lines("roads.goblin") as roads:
            roads.features(window=(302450, 3193000, 302700, 3194000))
            distances, features, positions = roads.nearest(houses, k=2, radius=500)
            roads.crossings([(301000, 3193500), (304000, 3193500)]).positions
    """

    def __repr__(self) -> str:
        return f"<spinney.LineTree {_native.shown(str(self.path))}: {'closed' if self.closed else f'{len(self)} features'}>"

    @property
    def attributes(self) -> list[str]:
        """Names of the attributes."""
        return list(self._facts()["attributes"])

    @property
    def axes(self) -> int:
        """The number of axes: 2, or 3 if the lines have heights."""
        return int(self._facts()["axes"])

    @property
    def bounds(self) -> tuple[float, ...] | None:
        """Minimum and then maximum coordinates along the axes; None if there are no lines."""
        bounds: tuple[float, ...] | None = self._facts()["bounds"]
        return bounds

    @property
    def segments(self) -> int:
        """The number of segments between two vertices."""
        return int(self._facts()["segments"])

    @property
    def length(self) -> float:
        """The length of all lines, in units of the coordinates; in x and y if these are degrees."""
        return float(self._facts()["length"])

    def levels(self) -> list[LineLevel]:
        """Returns counts and lengths for each level, root first, without reading lines."""
        return [LineLevel(*level) for level in self._levels()]

    def find(
        self, window: Sequence[float], *, threads: int | None = None, progress: Progress = None
    ) -> npt.NDArray[np.int64]:
        """Returns the ascending numbers of the features that have a line through a window (minimum
        and maximum coordinates), its border included. A window of four numbers has all heights.
        """
        corners = [float(number) for number in window]
        if len(corners) == 4:
            [west, south, east, north] = corners
            corners = [west, south, -np.inf, east, north, np.inf]
        elif len(corners) != 6 or self.axes == 2:
            numbers = "4" if self.axes == 2 else "4 or 6"
            raise ValueError(f"window: got {len(corners)} numbers, expected {numbers}: minimum, then maximum coordinates")
        with working(progress, threads) as terms:
            return self._window(corners, terms)

    def features(
        self,
        *,
        window: Sequence[float] | None = None,
        crossing: Any = None,
        radius: float = 0,
        attributes: Sequence[str] | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> list[dict[str, Any]]:
        """Returns whole features as in GeoJSON, with their number as id: all, those that intersect
        a `window`, or those that other lines cross (`crossing` and `radius`, as for `crossings`);
        with all or some `attributes`.
        """
        numbers = self._chosen(window, crossing, radius, threads)
        names = self.attributes
        chosen = range(len(names)) if attributes is None else [_position(names, name) for name in attributes]
        with working(progress, threads) as terms:
            rows = self._features(numbers, terms)
        return [
            {
                "type": "Feature",
                "id": number,
                "properties": {names[place]: values[place] for place in chosen},
                "geometry": _geometry(lines),
            }
            for number, lines, values in rows
        ]

    def nearest(
        self,
        positions: Points,
        *,
        k: int = 1,
        radius: float = np.inf,
        coordinates: Coordinates = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Returns for each point the k nearest features, nearest first: their distances, of shape
        (n, k), their numbers, (n, k), and the nearest positions on them, (n, k, 2), in a tree with
        heights (n, k, 3). If there are fewer within the `radius`, these are infinity, -1 and NaN.
        Distances of rows of x, y and z are those in space; those of rows of x and y, and of lines
        in degrees, ignore heights. Coordinates are in the file's own system, those of a GeoSeries
        in its `crs`, or in other `coordinates` ("lonlat", "EPSG:3035", any coordinate system);
        results are always in the file's own.
        """
        if k < 1:
            raise ValueError(f"k: got {k}, expected 1 or more")
        rows, own = _with_heights(positions, self.axes, "positions")
        if coordinates is None:
            coordinates = "world" if own is None or self.crs is None else definition_of(own)
        with working(progress, threads) as terms:
            distances, features, found = self._nearest(rows, k, float(radius), coordinates, terms)
        return distances, features, found.reshape(len(rows), k, self.axes)

    def crossings(
        self, lines: Any, *, radius: float = 0, threads: int | None = None, progress: Progress = None
    ) -> LineCrossings:
        """Returns the points where other lines cross the tree's, or touch them, or with a `radius`
        all pairs of segments that are at most so far apart. Lines are one line, as rows of x and y,
        or several; in a tree with heights also rows of x, y and z. Lines without z cross at any
        height.
        """
        axes = self.axes
        with working(progress, threads) as terms:
            features, numbers, distances, positions = self._crossings(_lines_of(lines, axes), float(radius), terms)
        return LineCrossings(features, numbers, positions.reshape(-1, axes), distances)

    def write(
        self,
        out: Path,
        *,
        window: Sequence[float] | None = None,
        crossing: Any = None,
        radius: float = 0,
        attributes: Sequence[str] | None = None,
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> int:
        """Writes whole features (.geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply), selected
        as by `features`; returns their number.
        """
        numbers = self._chosen(window, crossing, radius, threads)
        names = None if attributes is None else names_of(attributes)
        with working(progress, threads, max_bytes) as terms:
            return self._write(path_of(out), numbers, names, terms)

    def _chosen(
        self, window: Sequence[float] | None, crossing: Any, radius: float, threads: int | None
    ) -> list[int] | None:
        if radius and crossing is None:
            raise ValueError("radius: works only with crossing")
        if window is not None and crossing is not None:
            raise ValueError("window, crossing: got both, expected one of them")
        if window is not None:
            return [int(number) for number in self.find(window, threads=threads)]
        if crossing is not None:
            return [int(number) for number in np.unique(self.crossings(crossing, radius=radius, threads=threads).features)]
        return None


def _position(names: Sequence[str], name: str) -> int:
    if name not in names:
        raise ValueError(f"attribute `{name}`: expected one that features have: {', '.join(names)}")
    return names.index(name)


def _geometry(lines: list[list[list[float]]]) -> dict[str, Any] | None:
    match lines:
        case []:
            return None
        case [line]:
            return {"type": "LineString", "coordinates": line}
        case _:
            return {"type": "MultiLineString", "coordinates": lines}


def _lines_of(lines: Any, axes: int) -> list[npt.NDArray[np.float64]]:
    """Returns one or several lines as arrays of x, y and z."""
    given = list(lines)
    many = [given] if given and np.ndim(given[0]) == 1 else given
    return [_with_heights(line, axes, "lines")[0] for line in many]


def _with_heights(points: Any, axes: int, name: str) -> tuple[npt.NDArray[np.float64], Any]:
    """Returns points as rows of x, y and z, with their coordinate system if they have one. z is NaN
    without heights.
    """
    try:
        given, own = coordinates_of_points(points, axes)
    except ValueError:
        # Some points have no height.
        given, own = coordinates_of_points(points, 2)
    if not hasattr(given, "__array__"):
        given = list(given)
    has_heights = axes == 3 and len(given) > 0 and np.shape(given[0]) == (3,)
    rows = points_of(given, 3 if has_heights else 2, name)
    if not has_heights:
        rows = np.column_stack([rows, np.full(len(rows), np.nan)])
    return rows, own
