"""What questions are answered with."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
"""An array of samples, of whatever type the file has."""


class FileSystemPath(Protocol):
    """A file of fsspec (`fsspec.open("s3://...")`), or a path of universal_pathlib."""

    @property
    def fs(self) -> Any:
        """The file system."""

    @property
    def path(self) -> Any:
        """The path in it."""


Path = str | os.PathLike[str] | FileSystemPath
"""Name of a file; `map.autumn@3` is commit 3 of `map.autumn`. Also a file of fsspec that is local or has a URL (`https`, `s3`, `gs`, `az`)."""
Progress = Callable[[int, int], object] | bool | Any | None
"""A function that is called with what is done and the total, a bar of tqdm, or `True` for a new bar: one of tqdm if that is installed
(`pip install tqdm`), else a line in the terminal."""
Window = Any
"""Cells: `(column, row, width, height)`, of octrees `(x, y, z, width, height, depth)`, or a window of rasterio."""
Coordinates = Any
"""What coordinates count: `"cells"`, `"world"` (the tree's own system), `"lonlat"` (degrees, WGS 84), or a coordinate system: text such
as `"EPSG:3035"`, or an object of pyproj or rasterio. Of a window in others than cells least and then greatest ones are given."""
Codec = Literal["plain", "packed"]
Inside = Literal["nonzero", "positive", "odd"]
"""Packing of segments: plain ones are used where they are in the file, packed ones take few bytes."""
Resampling = Literal["nearest", "bilinear", "cubic", "area", "majority"]
"""Ways in which cells get their values from those of another grid."""
Style = str | Mapping[str, Any] | os.PathLike[str]
"""Colours: a style's name, its document as a dictionary or JSON, or a file with it."""
BBox = Sequence[float]
"""A box of the world: `(left, bottom, right, top)`, of octrees least and then greatest `x, y, z`."""
Points = npt.ArrayLike | Iterable[Sequence[float]]
"""Points: an array with a row each, or anything that hands out coordinates."""


class Transform(NamedTuple):
    """From columns and rows to the world: `x = a col + b row + c`, `y = d col + e row + f`.

    The order is that of rasterio: `affine.Affine(*ds.transform)`.
    """

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float


class BoundingBox(NamedTuple):
    """A box of the world, as rasterio has it."""

    left: float
    bottom: float
    right: float
    top: float


class Box(NamedTuple):
    """A box of the world of an octree."""

    min_x: float
    min_y: float
    min_z: float
    max_x: float
    max_y: float
    max_z: float

    @property
    def left(self) -> float:
        """Least x, as `BoundingBox` has it."""
        return self.min_x

    @property
    def bottom(self) -> float:
        """Least y."""
        return self.min_y

    @property
    def right(self) -> float:
        """Greatest x."""
        return self.max_x

    @property
    def top(self) -> float:
        """Greatest y."""
        return self.max_y


Extent = Literal["a", "b", "union", "intersection"]
"""Part of the world that a result covers: that of the first file, of the others, of all, or what all share."""
ClassMatching = Literal["name", "number"]
"""How classes of two files are matched."""
Units = Literal["convert", "number"]
"""Whether numbers are converted by scale, offset and unit, or taken as they are stored."""


@dataclass(frozen=True)
class BandStatistics:
    """Statistics of one band; the standard deviation is that of the population."""

    cells: int
    min: float
    """The least sample: an int, exact, where samples are integers."""
    max: float
    """The greatest sample, as `min`."""
    mean: float
    std: float


class _OfBands:
    """Statistics of several bands."""

    bands: tuple[BandStatistics, ...]

    @property
    def first(self) -> BandStatistics:
        """Statistics of the first band."""
        if not self.bands:
            raise ValueError("there are no cells")
        return self.bands[0]

    @property
    def min(self) -> float:
        """The least sample of the first band."""
        return self.first.min

    @property
    def max(self) -> float:
        """The greatest sample of the first band."""
        return self.first.max

    @property
    def mean(self) -> float:
        """The mean of the first band."""
        return self.first.mean

    @property
    def std(self) -> float:
        """The standard deviation of the first band."""
        return self.first.std


@dataclass(frozen=True)
class Statistics(_OfBands):
    """Exact statistics of the cells of a part."""

    cells: int
    """Cells that are not VOID."""
    void_cells: int
    """Cells of the part that are VOID."""
    bands: tuple[BandStatistics, ...]
    """Statistics of each band; nothing if there are no cells."""
    classes: dict[float, int]
    """Cells of each class, by ascending value; only of files that count classes."""


@dataclass(frozen=True)
class ZoneValues:
    """What the cells of each sample tell of a band in a polygon."""

    variety: int
    """Number of different samples."""
    majority: float
    """The sample that most cells have; of several the least."""
    minority: float
    """The sample that the fewest cells have; of several the least."""
    median: float
    """The quantile 0.5."""
    quantiles: dict[float, float]
    """Quantiles that were asked for: those of `numpy.quantile`, with the shares of cells as weights."""


@dataclass(frozen=True)
class ZoneBand(BandStatistics):
    """Statistics of one band in a polygon; `cells` need not be a whole number."""

    sum: float = 0.0
    """Sum of the samples."""
    values: ZoneValues | None = None
    """What single samples tell, if that was asked for."""


@dataclass(frozen=True)
class ZoneStatistics(_OfBands):
    """Exact statistics of the cells in a polygon. Where cells count by their area, numbers of cells need not be whole."""

    cells: float
    """Cells that are not VOID."""
    void_cells: float
    """Cells of the polygon, within the tree's picture, that are VOID."""
    bands: tuple[ZoneBand, ...]
    """Statistics of each band; nothing if there are no cells."""
    classes: dict[float, float]
    """Cells of each class, by ascending value; only of files that count classes."""
    outside_cells: float = 0.0
    """Area of the polygon outside of the tree's picture, in cells."""

    @property
    def void_share(self) -> float:
        """The part of the cells within the picture that is VOID; NaN if there are none."""
        within = self.cells + self.void_cells
        return self.void_cells / within if within else float("nan")


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of the tree, one per row of the arrays."""

    codes: npt.NDArray[np.str_]
    """FD codes: `/` and a digit per level."""
    levels: npt.NDArray[np.uint8]
    """Levels."""
    boxes: npt.NDArray[np.int64]
    """Cells of the deepest level: first column and row, width and height (of octrees x, y, z and three lengths). A row
    is a `window` for `read`."""
    world: npt.NDArray[np.float64]
    """Boxes in the world: left, bottom, right, top, or least and then greatest x, y, z."""
    values: npt.NDArray[Any]
    """Values, float64, NaN where a block has several; of trees of int64 or uint64 samples of the tree's type, masked there."""

    def __len__(self) -> int:
        return len(self.codes)


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of a tree, or components of its cells: one per row of the arrays."""

    labels: npt.NDArray[Any]
    """Labels in order: values, or numbers from 1."""
    classes: npt.NDArray[Any] | None
    """What they stand for, a number each (a row each where there are several bands): the value of a component's cells, or that of another
    tree, masked where it is VOID; None if it is not known."""
    cells: npt.NDArray[np.uint64]
    """Numbers of cells."""
    areas: npt.NDArray[np.float64]
    """Square metres, NaN where these are not known; of octrees volumes, in the unit of the tree's coordinates."""
    boxes: npt.NDArray[np.int64]
    """The smallest boxes around the cells: first column and row, width and height (of octrees x, y, z and three lengths). A row is a
    `window` for `read`."""
    world: npt.NDArray[np.float64]
    """The same in the world: left, bottom, right, top, or least and then greatest x, y, z."""
    pairs: npt.NDArray[Any]
    """Labels side by side, in rows of two, each pair in both orders, sorted."""
    edges: npt.NDArray[np.uint64]
    """Edges of cells (faces, of octrees) that each pair has in common."""

    def __len__(self) -> int:
        return len(self.labels)


@dataclass(frozen=True)
class Commit:
    """A state of an Autumnal file that stays readable."""

    number: int
    time: datetime | None
    """When it was made, in UTC."""
    author: str
    message: str
    cells: int
    """Cells that are not VOID."""
    records: int
    """INNER nodes of its tree."""
    bytes: int
    """Bytes that it took in the file."""


@dataclass(frozen=True)
class Differences:
    """Totals of the differences between two trees."""

    added: int
    """Cells that were VOID and are not any more."""
    removed: int
    """Cells that have become VOID."""
    changed: int
    """Cells whose value is another one."""
    blocks: int
    """Blocks in which the trees differ, uniform in both."""
    runs: int
    """Runs of cells in FD order in which they differ."""
    ranges: npt.NDArray[np.uint64] | None = None
    """The runs, if they were asked for: paths of the first and the last cell."""

    def __bool__(self) -> bool:
        return self.blocks > 0


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with a file."""

    place: str
    problem: str


@dataclass(frozen=True)
class Outcome:
    """Measures of a tree that was made of others."""

    shape: tuple[int, ...]
    """Rows and columns; planes first in octrees."""
    depth: int
    before: tuple[int, ...]
    """Cells of each input that are not VOID."""
    cells: int
    """Cells of the result that are not VOID."""
    conversions: tuple[str, ...] = ()
    """What was converted so that inputs mean the same, a line for each."""


@dataclass(frozen=True)
class Solid:
    """Measures of a solid, in the units of its world."""

    level: int
    cells: int
    """Cells of the level that are not empty."""
    volume: float
    """NaN, as areas are, where the world is in degrees, since heights have another unit."""
    volume_cells: float
    """Volume in cells of the level."""
    centre: tuple[float, float, float] | None
    """Centre of gravity; `None` if there is nothing."""
    bounds: Box | None
    area: float | None
    """Area of the smooth surface that the cells stand for, if it was asked for."""
    block_area: float | None
    """Area of the cells' faces, if it was asked for."""


class ObjectContact(NamedTuple):
    """Two objects that overlap or touch."""

    kind: Literal["touch", "overlap", "contains", "within", "equal"]
    """The way: "contains" is of the second one in the first, "within" of the first one in the second."""
    names: tuple[str, str]
    """Their names."""
    parts: tuple[int, int]
    """Their numbers, the lesser one first."""
    volume: float
    """Volume of what is inside of both; 0 where they touch."""
    area: float
    """Area in which surfaces that touch lie on each other; 0 where something is inside of both."""
    place: tuple[float, float, float]
    """A place that both have."""


class Mesh(NamedTuple):
    """A closed surface of triangles: `trimesh.Trimesh(*mesh)`."""

    vertices: npt.NDArray[np.float64]
    """Coordinates in the world, a row each."""
    faces: npt.NDArray[np.int64]
    """Vertices of the triangles, counterclockwise seen from outside."""


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays hit, one per row of the arrays."""

    distance: npt.NDArray[np.float64]
    """Lengths of the direction; NaN where nothing is hit."""
    points: npt.NDArray[np.float64]
    """Coordinates in the world; NaN where nothing is hit."""
    cells: npt.NDArray[np.int64]
    """The cell x, y, z of the level; -1 where nothing is hit."""

    @property
    def hit(self) -> npt.NDArray[np.bool_]:
        """Whether each ray hits anything."""
        return ~np.isnan(self.distance)


@dataclass(frozen=True)
class BuiltModel:
    """Counts of an exact model that was built."""

    read: int
    """Faces of the files."""
    faces: int
    """Faces of the model."""
    collapsed: int
    """Faces that are points or lines on the grid, and were left out."""
    slivers: int
    """Faces without area on the grid, which stay and bound nothing."""
    cut: int
    """Faces that the grid has bent, cut into triangles."""
    fanned: int
    """Faces that cross themselves, cut into triangles."""
    closed_boundaries: int
    """Boundaries that were closed."""
    closing_triangles: int
    """Triangles that close them."""
    repaired_faces: int
    """Faces that were divided or taken away where the surface passed through itself."""
    lost_faces: int
    """Those of them that bounded nothing."""
    skipped: list[tuple[str, str]]
    """Objects that were left out because they are no bodies: names, and why."""
    turned_bodies: int
    """Bodies that were inside out, and were turned with what is inside of them."""
    displacement: float
    """The farthest that a corner was moved to the grid."""
    step: float
    """Width of the grid's steps."""
    bits: int
    """Bits of the grid's coordinates."""
    nodes: dict[str, int]
    """Nodes of the octree by kind."""


@dataclass(frozen=True)
class CombinedModel:
    """Counts of an exact model that was made of others."""

    before: list[int]
    """Faces of each."""
    faces: int
    """Faces of the result."""
    pairs: int
    """Pairs of faces that touch or pass through each other."""
    divided: int
    """Faces that were divided, or of which a part was taken away."""
    displacement: float
    """The farthest that a new corner was moved to the grid."""
    snapped: float
    """The farthest that a corner of a model was moved to a common grid, where their grids have no unit in common; else 0."""
    is_unbounded: bool
    """Whether what is far away belongs to the result."""
    defects: int
    """Places where the surface passes through itself on the grid, being thinner than its step."""


@dataclass(frozen=True)
class MovedModel:
    """Counts of an exact model that was moved."""

    before: int
    """Faces before."""
    faces: int
    """Faces of the result."""
    is_exact: bool
    """Whether the body has the very shape that it had."""
    displacement: float
    """The farthest that a corner lies from where the steps take it."""
    cut: int
    """Faces that were cut into triangles, as their corners lie in no plane on the grid."""
    collapsed: int
    """Faces that were left out, being points or lines on the grid."""
    rounded: int
    """Faces with corners beside the grid that are gone, for those on the grid that stood in for them."""


@dataclass(frozen=True)
class CombinedPolygons:
    """Counts of the polygons that were made of others."""

    features: int
    """Features that were written."""
    polygons: int
    """Polygons in them."""
    area: float
    """Their area, in square units of the coordinates."""
    shared: int
    """Features that lie in several of one file, of which the last one gave the attributes."""
    edges: int
    """Edges of all polygons, those that several have counted once."""
    crossings: int
    """Places where edges cross in between their ends."""
    repeated_corners: int
    """Corners that repeated the one before."""
    cell: float
    """Width of the cells of the grid on which all corners lie."""
    area_bound: float
    """Most by which areas may be off for that."""


@dataclass(frozen=True, eq=False)
class Mass:
    """Measures of an exact model: exact numbers for its grid, each rounded once (but for the area). Volume and area are NaN where the world is in degrees, since
    heights have another unit."""

    volume: float
    area: float
    centre: tuple[float, float, float] | None
    """Centre of gravity; `None` if there is no volume."""
    second_moments: npt.NDArray[np.float64]
    """Integrals of the products of two coordinates about the centre."""
    inertia: npt.NDArray[np.float64]
    """Inertia tensor about the centre."""


@dataclass(frozen=True)
class Euler:
    """Numbers of the entities of a surface: V - E + F - R + B = 2 (S - G)."""

    vertices: int
    edges: int
    faces: int
    inner_rings: int
    """Rings beside the first of each face."""
    shells: int
    boundaries: int
    """0 of a closed surface."""
    genus: int | None
    """Handles of all shells; `None` if that is no number."""


class Coverage(NamedTuple):
    """The part of a cell that is inside."""

    share: float
    """Of the cell, 0 to 1."""
    volume: float
    centre: tuple[float, float, float] | None
    """Centre of gravity; `None` if there is nothing."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Points of a surface, one per row of the arrays."""

    distance: npt.NDArray[np.float64]
    """From the points that were asked for; NaN for what is no number."""
    points: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int64]
    """Numbers of the faces on which they lie; -1 where there is none."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Planar faces with holes: a face has rings, the outer one first, and a ring has corners, counterclockwise seen from
    outside (holes the other way round)."""

    vertices: npt.NDArray[np.float64]
    """Coordinates in the world, a row each."""
    corners: npt.NDArray[np.int64]
    """Vertices of all rings."""
    ring_ends: npt.NDArray[np.int64]
    """Where each ring ends in `corners`."""
    face_ends: npt.NDArray[np.int64]
    """Where each face ends in `ring_ends`."""
    numbers: npt.NDArray[np.int64]
    """Numbers of the faces in the model."""
    parts: npt.NDArray[np.int64]
    """Numbers of the parts to which they belong."""
    sources: npt.NDArray[np.int64]
    """Numbers of the faces of the file from which the model was made."""
    colours: npt.NDArray[np.uint8] | None
    """Red, green, blue of each corner."""

    def __len__(self) -> int:
        return len(self.numbers)

    def rings(self, index: int) -> list[npt.NDArray[np.float64]]:
        """The rings of a face by its place in these arrays, as coordinates."""
        index = range(len(self))[index]
        first = self.face_ends[index - 1] if index else 0
        ends = self.ring_ends[first : self.face_ends[index]]
        starts = [self.ring_ends[first - 1] if first else 0, *ends[:-1]]
        return [self.vertices[self.corners[start:end]] for start, end in zip(starts, ends)]


@dataclass(frozen=True)
class Section:
    """Sums of the sections of a model by planes."""

    planes: int
    polygons: int
    """Polygons in all planes."""
    area: float
    """The sum of their areas, without those of holes."""


@dataclass(frozen=True)
class SurfaceIntersection:
    """Sums of what the surfaces of two models have in common."""

    crossings: int
    """Lines where they pass through each other."""
    crossing_length: float
    touches: int
    """Lines where they touch."""
    touch_length: float
    overlaps: int
    """Areas in which they lie on each other."""
    overlap_area: float
    points: int
    """Lone points."""


class LevelCounts(NamedTuple):
    """Nodes of a level of a tree."""

    void: int
    """Nodes without anything below them."""
    leaf: int
    """Nodes with one value all over."""
    inner: int
    """Nodes with more detail below them."""


def commit_of(facts: dict[str, Any]) -> Commit:
    """The commit that the native part describes."""
    time = facts["time"]
    try:
        moment = None if time is None else datetime.fromtimestamp(time, timezone.utc)
    except (OverflowError, ValueError, OSError):
        moment = None
    return Commit(
        facts["number"], moment, facts["author"], facts["message"], facts["cells"], facts["records"], facts["bytes"]
    )


def outcome_of(facts: dict[str, Any]) -> Outcome:
    """The outcome that the native part describes."""
    columns, rows, planes = facts["extent"]
    shape = (rows, columns) if planes == 1 else (planes, rows, columns)
    return Outcome(shape, facts["depth"], tuple(facts["before"]), facts["after"], tuple(facts["conversions"]))
