"""Trees of lines: features of lines with their attributes, found by where they pass."""

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
    """What came of building a tree of lines."""

    features: int
    segments: int
    """Pieces of lines between two vertices."""
    length: float


@dataclass(frozen=True)
class LineLevel:
    """What the nodes of a level of a tree of lines have."""

    nodes: int
    segments: int
    """Pieces of lines that these nodes themselves have, and their length."""
    length: float
    most_segments: int
    """Pieces and features in a node and those below, at most."""
    most_features: int


@dataclass(frozen=True)
class LineCrossings:
    """Places where lines of a tree and other lines meet, in the order of the others."""

    features: npt.NDArray[np.int64]
    """Numbers of the tree's features."""
    lines: npt.NDArray[np.int64]
    """Numbers of the other lines."""
    places: npt.NDArray[np.float64]
    """Where they meet, of shape (n, 2)."""

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
    """Makes a tree of lines, a .goblin file: of a file of features that are lines (GeoPackage, GeoJSON, FlatGeobuf, shapefile, CSV with WKT), or of features as
    `__geo_interface__` has them, such as a GeoDataFrame::

        spinney.build_lines("roads.gpkg", "roads.goblin", where="lanes>=2", attributes=["name"])

    Features for which conditions hold (`where`), with all or some `attributes`, of any number, in bounded `memory`. Nodes of at most `leaf_size` pieces of lines (1024) are not divided.
    """
    names = None if attributes is None else names_of(attributes)
    origin = path_of(source) if is_path(source) else "features"
    given = (leaf_size, crs_text(crs), names, memory_of(memory), where, origin)
    with features_over(source, has_own_system=True) as told, working(progress, threads, max_bytes) as terms:
        return BuiltLines(*_native.build_line_file(told["path"], path_of(out), given, terms))


def open_lines(path: Path, *, positioned: bool = False, storage_options: Mapping[str, Any] | None = None) -> LineTree:
    """Opens a tree of lines, also elsewhere (`https://`, `s3://` ...): see `open`."""
    name, remote = remote_access_of(path, storage_options)
    return LineTree(name, positioned, remote)


class LineTree(BlockTree, _native.Lines):
    """A tree of lines in a file, as `open_lines` opens it; a context manager. Features have numbers from 0, in the order in which they came::

        with spinney.open_lines("roads.goblin") as roads:
            roads.features(window=(302450, 3193000, 302700, 3194000))
            distances, features, places = roads.nearest(houses, k=2, radius=500)
            roads.crossings([(301000, 3193500), (304000, 3193500)]).places
    """

    def __repr__(self) -> str:
        return f"<spinney.LineTree {_native.shown(str(self.path))}: {'closed' if self.closed else f'{len(self)} features'}>"

    @property
    def attributes(self) -> list[str]:
        """Names of the attributes."""
        return list(self._facts()["attributes"])

    @property
    def bounds(self) -> tuple[float, float, float, float] | None:
        """Least and greatest coordinates of all lines; None if there are none."""
        bounds: tuple[float, float, float, float] | None = self._facts()["bounds"]
        return bounds

    @property
    def segments(self) -> int:
        """Number of pieces of lines between two vertices."""
        return int(self._facts()["segments"])

    @property
    def length(self) -> float:
        """Length of all lines, in units of the coordinates."""
        return float(self._facts()["length"])

    def levels(self) -> list[LineLevel]:
        """Counts and lengths level by level, from the root down, without reading lines."""
        return [LineLevel(*level) for level in self._levels()]

    def find(
        self, window: Sequence[float], *, threads: int | None = None, progress: Progress = None
    ) -> npt.NDArray[np.int64]:
        """Numbers of the features of which a line passes through a window (least and greatest coordinates), its border included; they ascend."""
        corners = [float(number) for number in window]
        if len(corners) != 4:
            raise ValueError(f"window: {len(corners)} numbers, expected least and greatest coordinates, four")
        with working(progress, threads) as terms:
            return self._window(corners, terms)

    def features(
        self,
        *,
        window: Sequence[float] | None = None,
        crossing: Any = None,
        attributes: Sequence[str] | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> list[dict[str, Any]]:
        """Whole features as those of GeoJSON, with their number as id: all, those that pass through a `window`, or those that other lines cross (`crossing`, as
        `crossings` takes them); with all or some `attributes`."""
        numbers = self._chosen(window, crossing, threads)
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
        places: Points,
        *,
        k: int = 1,
        radius: float = np.inf,
        coordinates: Coordinates = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Distances of the lines of the k features nearest to each place, of shape (n, k), the numbers of these features, (n, k), and the nearest places on them, (n, k, 2),
        the nearest first; infinite, -1 and NaN where fewer are within the `radius`. Coordinates are in the file's own system, those of a GeoSeries in its `crs`, or in other `coordinates`
        ("lonlat", "EPSG:3035", any coordinate system); results are always in the file's own."""
        if k < 1:
            raise ValueError(f"k: {k}, expected 1 or more")
        given, own = coordinates_of_points(places, 2)
        rows = points_of(given, 2, "places")
        if coordinates is None:
            coordinates = "world" if own is None or self.crs is None else definition_of(own)
        with working(progress, threads) as terms:
            distances, features, found = self._nearest(rows, k, float(radius), coordinates, terms)
        return distances, features, found.reshape(len(rows), k, 2)

    def crossings(self, lines: Any, *, threads: int | None = None, progress: Progress = None) -> LineCrossings:
        """Where other lines cross the tree's, or touch them: one line, as rows of x and y, or several such."""
        with working(progress, threads) as terms:
            features, numbers, places = self._crossings(_lines_of(lines), terms)
        return LineCrossings(features, numbers, places.reshape(-1, 2))

    def write(
        self,
        out: Path,
        *,
        window: Sequence[float] | None = None,
        crossing: Any = None,
        attributes: Sequence[str] | None = None,
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> int:
        """Writes whole features (.geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply), chosen as `features` does; returns how many."""
        numbers = self._chosen(window, crossing, threads)
        names = None if attributes is None else names_of(attributes)
        with working(progress, threads, max_bytes) as terms:
            return self._write(path_of(out), numbers, names, terms)

    def _chosen(self, window: Sequence[float] | None, crossing: Any, threads: int | None) -> list[int] | None:
        if window is not None and crossing is not None:
            raise ValueError("window, crossing: expected one of them")
        if window is not None:
            return [int(number) for number in self.find(window, threads=threads)]
        if crossing is not None:
            return [int(number) for number in np.unique(self.crossings(crossing, threads=threads).features)]
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


def _lines_of(lines: Any) -> list[npt.NDArray[np.float64]]:
    """One line, or several, as arrays."""
    given = list(lines)
    if given and np.ndim(given[0]) == 1:
        return [points_of(given, 2, "lines")]
    return [points_of(line, 2, "lines") for line in given]
