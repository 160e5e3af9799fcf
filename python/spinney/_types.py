"""Types of arguments and results."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
"""An array of samples, of the file's type."""


class FileSystemPath(Protocol):
    """An fsspec file (`fsspec.open("s3://...")`), or a universal_pathlib path."""

    @property
    def fs(self) -> Any:
        """The file system."""

    @property
    def path(self) -> Any:
        """The path in the file system."""


Path = str | os.PathLike[str] | FileSystemPath
"""Name of a file; `map.autumn@3` is commit 3 of `map.autumn`. Also an fsspec file that is local or
has a URL (`https`, `s3`, `gs`, `az`).
"""
Progress = Callable[[int, int], object] | bool | Any | None
"""A function that is called with the completed and the total work, a tqdm bar, or `True` for a new
bar: a tqdm one if that is installed (`pip install tqdm`), else a line in the terminal.
"""
Window = Any
"""Cells: `(column, row, width, height)`, in octrees `(x, y, z, width, height, depth)`, or a
rasterio window.
"""
Coordinates = Any
"""Coordinates: `"cells"`, `"world"` (the tree's own system), `"lonlat"` (degrees, WGS 84), or a
coordinate system: a string such as `"EPSG:3035"`, or an object of pyproj or rasterio. A window in
coordinates other than cells has minimum, then maximum ones.
"""
Codec = Literal["plain", "packed"]
Inside = Literal["nonzero", "positive", "odd"]
"""Packing of segments: plain ones are used in place, packed ones are smaller."""
Resampling = Literal["nearest", "bilinear", "cubic", "area", "majority"]
"""Resampling methods."""
Style = str | Mapping[str, Any] | os.PathLike[str]
"""Colours: a style's name, its document as a dictionary or JSON, or a file with it."""
BBox = Sequence[float]
"""A box in world coordinates: `(left, bottom, right, top)`, in octrees minimum, then maximum `x, y,
z`.
"""
Points = npt.ArrayLike | Iterable[Sequence[float]]
"""Points: an array with a row each, or any iterable of coordinates."""


class Transform(NamedTuple):
    """Transform from columns and rows to world coordinates: `x = a col + b row + c`, `y = d col + e
    row + f`.

    The order is that of rasterio: `affine.Affine(*ds.transform)`.
    """

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float


class BoundingBox(NamedTuple):
    """A box in world coordinates, as in rasterio."""

    left: float
    bottom: float
    right: float
    top: float


class Box(NamedTuple):
    """A box in world coordinates of an octree."""

    min_x: float
    min_y: float
    min_z: float
    max_x: float
    max_y: float
    max_z: float

    @property
    def left(self) -> float:
        """Minimum x, as in `BoundingBox`."""
        return self.min_x

    @property
    def bottom(self) -> float:
        """Minimum y."""
        return self.min_y

    @property
    def right(self) -> float:
        """Maximum x."""
        return self.max_x

    @property
    def top(self) -> float:
        """Maximum y."""
        return self.max_y


Extent = Literal["a", "b", "union", "intersection"]
"""Extent of a result: that of the first file, of the others, the union, or the intersection of
all.
"""
ClassMatching = Literal["name", "number"]
"""How classes of two files are matched."""
Units = Literal["convert", "number"]
"""Whether numbers are converted by scale, offset and unit, or used as stored."""


@dataclass(frozen=True)
class BandStatistics:
    """Statistics of one band; the standard deviation is that of the population."""

    cells: int
    min: float
    """The minimum sample: an exact int if samples are integers."""
    max: float
    """The maximum sample, as `min`."""
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
        """The minimum sample of the first band."""
        return self.first.min

    @property
    def max(self) -> float:
        """The maximum sample of the first band."""
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
    """Exact statistics of the cells of a region."""

    cells: int
    """Cells that are not VOID."""
    void_cells: int
    """Cells of the region that are VOID."""
    bands: tuple[BandStatistics, ...]
    """Statistics of each band; empty if there are no cells."""
    classes: dict[float, int]
    """Cells of each class, by ascending value; only for files that count classes."""


@dataclass(frozen=True)
class ZoneValues:
    """Value statistics of a band in a polygon."""

    variety: int
    """The number of different samples."""
    majority: float
    """The most frequent sample; of several the smallest."""
    minority: float
    """The least frequent sample; of several the smallest."""
    median: float
    """The quantile 0.5."""
    quantiles: dict[float, float]
    """The requested quantiles, as in `numpy.quantile`, weighted by the cells' shares."""


@dataclass(frozen=True)
class ZoneBand(BandStatistics):
    """Statistics of one band in a polygon; `cells` need not be an integer."""

    sum: float = 0.0
    """The sum of the samples."""
    values: ZoneValues | None = None
    """Value statistics, if requested."""


@dataclass(frozen=True)
class ZoneStatistics(_OfBands):
    """Exact statistics of the cells in a polygon. If cells count by area, their numbers need not be
    integers.
    """

    cells: float
    """Cells that are not VOID."""
    void_cells: float
    """Cells of the polygon, within the tree's extent, that are VOID."""
    bands: tuple[ZoneBand, ...]
    """Statistics of each band; empty if there are no cells."""
    classes: dict[float, float]
    """Cells of each class, by ascending value; only for files that count classes."""
    outside_cells: float = 0.0
    """Area of the polygon outside of the tree's extent, in cells."""

    @property
    def void_share(self) -> float:
        """The share of the cells within the extent that is VOID; NaN if there are none."""
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
    """Cells of the deepest level: first column and row, width and height (in octrees x, y, z and
    three lengths). A row is a `window` for `read`.
    """
    world: npt.NDArray[np.float64]
    """Boxes in world coordinates: left, bottom, right, top, or minimum, then maximum x, y, z."""
    values: npt.NDArray[Any]
    """Values as float64, NaN if a block has several; in trees of int64 or uint64 of that type, and
    masked instead.
    """

    def __len__(self) -> int:
        return len(self.codes)


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of a tree, or components of its cells: one per row of the arrays."""

    labels: npt.NDArray[Any]
    """Labels in ascending order: values, or numbers from 1."""
    classes: npt.NDArray[Any] | None
    """The class of each label, a number (a row if there are several bands): the value of a
    component's cells, or that of another tree, masked if it is VOID; None if unknown.
    """
    cells: npt.NDArray[np.uint64]
    """The number of cells."""
    areas: npt.NDArray[np.float64]
    """Areas in square metres, NaN if unknown; in octrees volumes, in the unit of the tree's
    coordinates.
    """
    boxes: npt.NDArray[np.int64]
    """Bounding boxes of the cells: first column and row, width and height (in octrees x, y, z and
    three lengths). A row is a `window` for `read`.
    """
    world: npt.NDArray[np.float64]
    """The same in world coordinates: left, bottom, right, top, or minimum, then maximum x, y, z."""
    pairs: npt.NDArray[Any]
    """Pairs of adjacent labels, a row each, in both orders, sorted."""
    edges: npt.NDArray[np.uint64]
    """The number of cell edges (faces, in octrees) that each pair shares."""

    def __len__(self) -> int:
        return len(self.labels)


@dataclass(frozen=True)
class Commit:
    """A state of an Autumnal file that stays readable."""

    number: int
    time: datetime | None
    """When the commit was made, in UTC."""
    author: str
    message: str
    cells: int
    """Cells that are not VOID."""
    records: int
    """INNER nodes of its tree."""
    bytes: int
    """The bytes that it added to the file."""


@dataclass(frozen=True)
class Differences:
    """Totals of the differences between two trees."""

    added: int
    """Cells that were VOID and have a value now."""
    removed: int
    """Cells that have become VOID."""
    changed: int
    """Cells whose value has changed."""
    blocks: int
    """Differing blocks that are uniform in both trees."""
    runs: int
    """Ranges of differing cells in FD order."""
    ranges: npt.NDArray[np.uint64] | None = None
    """The ranges, if requested: paths of the first and the last cell."""

    def __bool__(self) -> bool:
        return self.blocks > 0


@dataclass(frozen=True)
class Finding:
    """A defect of a file."""

    place: str
    problem: str


@dataclass(frozen=True)
class Outcome:
    """Measures of a tree that was derived from others."""

    shape: tuple[int, ...]
    """Rows and columns; in octrees planes come first."""
    depth: int
    before: tuple[int, ...]
    """Cells of each input that are not VOID."""
    cells: int
    """Cells of the result that are not VOID."""
    conversions: tuple[str, ...] = ()
    """Conversions of inputs, a line for each."""


@dataclass(frozen=True)
class Solid:
    """Measures of a solid, in world units."""

    level: int
    cells: int
    """Cells of the level that are not empty."""
    volume: float
    """NaN, as areas are, if world coordinates are in degrees, since heights have another unit."""
    volume_cells: float
    """The volume in cells of the level."""
    centre: tuple[float, float, float] | None
    """Centre of gravity; `None` for an empty solid."""
    bounds: Box | None
    area: float | None
    """Area of the smooth surface between the cells, if requested."""
    block_area: float | None
    """Area of the cells' faces, if requested."""


class ObjectContact(NamedTuple):
    """Two objects that overlap or touch."""

    kind: Literal["touch", "overlap", "contains", "within", "equal"]
    """The kind of contact: "contains" if the second is in the first, "within" if the first is in
    the second.
    """
    names: tuple[str, str]
    """Their names."""
    parts: tuple[int, int]
    """Their numbers, the smaller one first."""
    volume: float
    """The common volume; 0 if they touch."""
    area: float
    """The area in which touching surfaces coincide; 0 if there is a common volume."""
    place: tuple[float, float, float]
    """A common point."""


class Mesh(NamedTuple):
    """A closed surface of triangles: `trimesh.Trimesh(*mesh)`."""

    vertices: npt.NDArray[np.float64]
    """World coordinates, a row each."""
    faces: npt.NDArray[np.int64]
    """Vertices of the triangles, counterclockwise seen from outside."""


@dataclass(frozen=True, eq=False)
class Hits:
    """Hits of rays, one per row of the arrays."""

    distance: npt.NDArray[np.float64]
    """Distance in units of the direction's length; NaN without a hit."""
    points: npt.NDArray[np.float64]
    """World coordinates; NaN without a hit."""
    cells: npt.NDArray[np.int64]
    """The cell x, y, z of the level; -1 without a hit."""

    @property
    def hit(self) -> npt.NDArray[np.bool_]:
        """Whether each ray hits anything."""
        return ~np.isnan(self.distance)


@dataclass(frozen=True)
class BuiltModel:
    """Counts of a new exact model."""

    read: int
    """Faces in the files."""
    faces: int
    """Faces of the model."""
    collapsed: int
    """Faces that are points or lines on the grid, and were left out."""
    slivers: int
    """Faces without area on the grid, which are kept and bound nothing."""
    cut: int
    """Faces that are not planar on the grid, cut into triangles."""
    fanned: int
    """Faces that intersect themselves, cut into triangles."""
    closed_boundaries: int
    """Boundaries that were closed."""
    closing_triangles: int
    """Triangles that close boundaries."""
    repaired_faces: int
    """Faces that were divided or removed because the surface intersected itself."""
    lost_faces: int
    """Those of them that bounded nothing."""
    skipped: list[tuple[str, str]]
    """Objects that were left out because they are not valid bodies: names and reasons."""
    turned_bodies: int
    """Inverted bodies that were flipped, together with their contents."""
    displacement: float
    """The maximum distance between a vertex and its grid point."""
    step: float
    """The width of a grid unit."""
    bits: int
    """The bits of a grid coordinate."""
    nodes: dict[str, int]
    """Nodes of the octree by kind."""


@dataclass(frozen=True)
class CombinedModel:
    """Counts of an exact model that was combined from others."""

    before: list[int]
    """Faces of each input."""
    faces: int
    """Faces of the result."""
    pairs: int
    """Pairs of faces that touch or intersect."""
    divided: int
    """Faces that were divided, or partly removed."""
    displacement: float
    """The maximum distance between a new vertex and its grid point."""
    snapped: float
    """The maximum distance by which a vertex was moved to a common grid, if the grids have no
    common unit; else 0.
    """
    is_unbounded: bool
    """Whether the result includes points at infinity."""
    defects: int
    """Self-intersections of the surface on the grid, where it is thinner than the grid unit."""


@dataclass(frozen=True)
class MovedModel:
    """Counts of an exact model that was transformed."""

    before: int
    """Faces before."""
    faces: int
    """Faces of the result."""
    is_exact: bool
    """Whether the shape is preserved exactly."""
    displacement: float
    """The maximum distance between a vertex and its exactly transformed position."""
    cut: int
    """Faces that were cut into triangles, since their vertices are not planar on the grid."""
    collapsed: int
    """Faces that were left out, being points or lines on the grid."""
    rounded: int
    """Faces with off-grid vertices that are gone, since proxies on the grid replace them."""


@dataclass(frozen=True)
class CombinedPolygons:
    """Counts of the polygons of an overlay."""

    features: int
    """Features that were written."""
    polygons: int
    """Polygons in them."""
    area: float
    """Their area, in square units of the coordinates."""
    shared: int
    """Features within several features of one file, the last of which provided the attributes."""
    edges: int
    """Edges of all polygons; shared edges are counted once."""
    crossings: int
    """Crossings of edges between their ends."""
    repeated_corners: int
    """Vertices that repeated the previous one."""
    cell: float
    """The width of the grid on which all vertices are."""
    area_bound: float
    """An upper bound of the resulting error of areas."""


@dataclass(frozen=True, eq=False)
class Mass:
    """Measures of an exact model: exact on its grid, each rounded once (except for the area).
    Volume and area are NaN if world coordinates are in degrees, since heights have another unit.
    """

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
    """Entity counts of a surface: V - E + F - R + B = 2 (S - G)."""

    vertices: int
    edges: int
    faces: int
    inner_rings: int
    """The number of inner rings of faces."""
    shells: int
    boundaries: int
    """The number of boundaries: 0 for a closed surface."""
    genus: int | None
    """The handles of all shells; `None` if that is not an integer."""


class Coverage(NamedTuple):
    """The share of a cell that is inside."""

    share: float
    """The share of the cell, 0 to 1."""
    volume: float
    centre: tuple[float, float, float] | None
    """Centre of gravity; `None` if nothing is inside."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Points of a surface, one per row of the arrays."""

    distance: npt.NDArray[np.float64]
    """Distance from the query points; NaN for points with NaN."""
    points: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int64]
    """Numbers of the points' faces; -1 if there is none."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Planar faces with holes: a face has rings, the outer one first, and a ring has vertices,
    counterclockwise seen from outside (holes clockwise).
    """

    vertices: npt.NDArray[np.float64]
    """World coordinates, a row each."""
    corners: npt.NDArray[np.int64]
    """Vertices of all rings."""
    ring_ends: npt.NDArray[np.int64]
    """The end of each ring in `corners`."""
    face_ends: npt.NDArray[np.int64]
    """The end of each face in `ring_ends`."""
    numbers: npt.NDArray[np.int64]
    """Numbers of the faces in the model."""
    parts: npt.NDArray[np.int64]
    """Numbers of the faces' parts."""
    sources: npt.NDArray[np.int64]
    """Numbers of the faces in the file that the model was built from."""
    colours: npt.NDArray[np.uint8] | None
    """Red, green and blue of each corner."""

    def __len__(self) -> int:
        return len(self.numbers)

    def rings(self, index: int) -> list[npt.NDArray[np.float64]]:
        """Returns the rings of a face, by its index in these arrays, as coordinates."""
        index = range(len(self))[index]
        first = self.face_ends[index - 1] if index else 0
        ends = self.ring_ends[first : self.face_ends[index]]
        starts = [self.ring_ends[first - 1] if first else 0, *ends[:-1]]
        return [self.vertices[self.corners[start:end]] for start, end in zip(starts, ends)]


@dataclass(frozen=True)
class Section:
    """Totals of sections of a model by planes."""

    planes: int
    polygons: int
    """Polygons in all planes."""
    area: float
    """The sum of their areas, without those of holes."""


@dataclass(frozen=True)
class SurfaceIntersection:
    """Totals of the intersection of the surfaces of two models."""

    crossings: int
    """Lines where they cross."""
    crossing_length: float
    touches: int
    """Lines where they touch."""
    touch_length: float
    overlaps: int
    """Areas in which they coincide."""
    overlap_area: float
    points: int
    """Isolated points."""


class LevelCounts(NamedTuple):
    """Nodes of a level of a tree."""

    void: int
    """Nodes without data."""
    leaf: int
    """Nodes with one value throughout."""
    inner: int
    """Nodes with children."""


class DetailLevel(NamedTuple):
    """A level of detail of an exact model: a closed surface. The last one is the exact surface."""

    faces: int
    """Number of faces. Those of coarser levels are triangles."""
    error: float
    """Bound of the distance between the level and the exact surface, both ways, in the world."""
    bytes: int
    """Bytes of the faces that are stored for this level."""
    vanished_bodies: int
    """Connected surfaces of an object that have no faces in this level."""
    vanished_diameter: float
    """Bound of the largest diameter of these, in the world."""


@dataclass(frozen=True, eq=False)
class DetailMesh:
    """A surface of triangles at a level of detail: `trimesh.Trimesh(mesh.vertices, mesh.faces)`."""

    vertices: npt.NDArray[np.float64]
    """World coordinates, a row each."""
    faces: npt.NDArray[np.int64]
    """Vertices of the triangles, counterclockwise seen from outside."""
    parts: npt.NDArray[np.int64]
    """Numbers of the triangles' parts."""
    colours: npt.NDArray[np.uint8] | None
    """Red, green and blue of the three corners of each triangle."""
    error: float
    """Bound of the distance between this surface and the exact one, both ways; 0 if it is exact."""


def commit_of(facts: dict[str, Any]) -> Commit:
    """Converts a commit of the native module."""
    time = facts["time"]
    try:
        moment = None if time is None else datetime.fromtimestamp(time, timezone.utc)
    except (OverflowError, ValueError, OSError):
        moment = None
    return Commit(
        facts["number"], moment, facts["author"], facts["message"], facts["cells"], facts["records"], facts["bytes"]
    )


def outcome_of(facts: dict[str, Any]) -> Outcome:
    """Converts an outcome of the native module."""
    columns, rows, planes = facts["extent"]
    shape = (rows, columns) if planes == 1 else (planes, rows, columns)
    return Outcome(shape, facts["depth"], tuple(facts["before"]), facts["after"], tuple(facts["conversions"]))
