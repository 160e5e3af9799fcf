"""Exact models: the boundaries of bodies, kept as they are and not as cells."""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Self, overload

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import points_of, rows_of
from ._metadata import crs_text
from ._remote import access_again, kept_name, path_of, remote_access_of, token_of
from ._sources import paths_of
from ._files import MEMORY
from ._meshes import mesh_columns, meshes_of, unit_of
from ._options import packing_of, refuse
from ._progress import memory_of, working
from ._show import shown
from ._surfaces import RayCrossings, Shells, SurfaceHits
from ._types import (
    BBox,
    Box,
    BuiltModel,
    Codec,
    Coverage,
    Euler,
    Faces,
    Finding,
    Inside,
    Mass,
    Mesh,
    ObjectContact,
    Path,
    Points,
    Progress,
    Section,
    Surface,
    SurfaceIntersection,
)


def build_brep(
    models: Path | Sequence[Path] | Any,
    out: Path,
    *,
    snap: float | None = None,
    close: bool = False,
    repair: bool = False,
    inside: Inside = "nonzero",
    where: str | None = None,
    skip_bad: bool = False,
    colours: npt.ArrayLike | None = None,
    parts: npt.ArrayLike | None = None,
    names: Sequence[str] | None = None,
    attributes: Sequence[Mapping[str, Any] | None] | Mapping[str, Mapping[str, Any]] | None = None,
    leaf_size: int | None = None,
    up: Literal["y", "z"] | None = None,
    unit: str | None = None,
    crs: Any = None,
    memory: int | str = MEMORY,
    codec: Codec = "plain",
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> BuiltModel:
    """Makes an exact model, a .goblin file, of one or several mesh files (PLY, OBJ, STL, OFF, CityJSON, exact models), or of a mesh: one
    of trimesh, anything with `vertices` and `faces`, or a pair of these: rows of x, y and z, and rows, or lists of any lengths, of the numbers
    of three or more vertices, counterclockwise seen from outside; or `Faces` of an exact model, polygons with holes. Several meshes, in a
    list, by their names in a mapping, or in a scene of trimesh, are objects, each of them a part of the model::

        spinney.build_brep((vertices, triangles), "a.goblin", colours=reds, parts=numbers, names=["roof", "wall"])
        spinney.build_brep({"left": mesh, "right": other}, "b.goblin", attributes={"left": {"height": 5.5}})

    Meshes of trimesh keep colours, names and units. Of a single mesh, `colours` are rows of red, green and blue from 0 to 255, one for each
    vertex, and `parts` are numbers from 0, one for each face, of parts that are groups of one object. `names` are those of the parts, which are
    called by their numbers without them, and `attributes` what is said of each: of all in their order, or by name.

    Corners are moved to a grid of whole steps; everything after that is exact. `snap` is the width of a step, otherwise
    that of the files' own grid or the finest one. `close` closes open surfaces with triangles over their boundaries;
    `repair` resolves those that pass through themselves, lie on themselves, or are inside out: bodies that are inside out are turned, and places are
    `inside` where the surface goes around them ("nonzero", as cells have it), once or more ("positive"), or an odd number of times ("odd"). `where` takes
    objects alone for which conditions hold, as in "type=Building,measuredHeight>5" (`id` is the name), and `skip_bad` leaves out those that are no bodies by themselves, which are then told. Without these, such
    surfaces are a ValueError that tells the places, and there is no file. Cells of the octree with up to `leaf_size` faces are not divided. `up`, `unit`,
    `crs`, `memory` and `max_bytes` are as for `build`. With the `codec` "packed" the file takes fewer bytes, which are unpacked when they are used.
    """
    paths, meshes = paths_of(models), meshes_of(models)
    if paths is None and meshes is None:
        raise TypeError(f"models: expected the path of a mesh file, or several, or meshes, got {models!r}")
    of_meshes: dict[str, Any] = {"colours": colours, "parts": parts, "names": names, "attributes": attributes}
    if meshes is None:
        refuse("meshes in memory", of_meshes)
    columns = mesh_columns(meshes, **of_meshes) if meshes else []
    if leaf_size is not None and leaf_size < 0:
        raise ValueError(f"leaf_size: {leaf_size}, expected a number of faces")
    options = {
        "snap": None if snap is None else float(snap),
        "close": close,
        "repair": repair,
        "inside": inside,
        "where": where,
        "skip_bad": skip_bad,
        "leaf_size": leaf_size,
        "up": up,
        "unit": unit or unit_of(meshes or []),
        "crs": crs_text(crs),
        "packing": packing_of(codec, None),
        "memory": memory_of(memory),
    }
    with working(progress, threads, max_bytes) as terms:
        facts = _native.build_brep(paths or [], columns, path_of(out), options, terms)
    return BuiltModel(**facts)


def object_contacts(
    models: Path | Sequence[Path],
    *,
    snap: float | None = None,
    memory: int | str = MEMORY,
    threads: int | None = None,
    progress: Progress = None,
) -> list[ObjectContact]:
    """The pairs of objects of mesh files, such as CityJSON, that overlap or touch, by their numbers, on the grid that `build_brep` would take, also of
    steps `snap`. Objects that are open are left out with a warning. (Of exact models see `ExactModel.contacts`.)"""
    paths = paths_of(models)
    if paths is None:
        raise TypeError(f"models: expected the path of a mesh file, or several, got {models!r}")
    with working(progress, threads) as terms:
        return _contacts(_native.object_contacts(paths, snap, memory_of(memory), terms))


def _contacts(found: list[Any]) -> list[ObjectContact]:
    rows = ((kind, tuple(names), tuple(parts), volume, area, tuple(place)) for names, parts, kind, volume, area, place in found)
    return [ObjectContact(*row) for row in rows]


def open_brep(
    path: Path, *, view: str | Sequence[str] = (), positioned: bool = False, storage_options: Mapping[str, Any] | None = None
) -> ExactModel:
    """Opens a file of an exact model, made by `build_brep` or `spinney build --brep`.

    Files are mapped; `positioned=True` reads those that may be replaced in place, or that lie on network folders, without
    mapping them. URLs and files of fsspec are opened, too (see `open`).

    `view` are steps of `spinney transform` through which the model is seen, such as `"rotate=90,x"`: points, distances, rays, measures, sections by
    planes, boxes and contacts are those of what would be moved, exactly through quarter turns, mirrors, whole steps of the grid and one factor (see
    `ExactModel.rounding`). What has no answer through a map is a ValueError, such as distances through different factors; faces, `export`,
    `coverage` and sections by other models want shifts by whole steps and one factor.

    Raises FileNotFoundError or another OSError if it cannot be read, is damaged, or is a tree of cells (which `open` opens).
    """
    name, remote = remote_access_of(path, storage_options)
    return ExactModel(name, positioned, remote, [view] if isinstance(view, str) else list(view))


class ExactModel(_native.Model):
    """An open exact model: see `open_brep`. Its length is the number of its faces.

    All coordinates are those of the world, and points are arrays with a row each. What is decided is decided in whole
    numbers; lengths and volumes are rounded. Questions about many points run on all processors without the interpreter's
    lock, can be stopped by Ctrl-C, and read only what they have to do with.

    It can be used by any number of threads at the same time, is pickled by its path, and may be used by forked processes.
    Where the path of a model is expected, as by `combine`, it stands for its file. Closed, it raises ValueError.
    """

    def __fspath__(self) -> str:
        if self.view:
            raise ValueError(f"{_native.shown(str(self.path))}: is seen through {', '.join(self.view)}: make a file of it with `transform`")
        return os.fspath(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        storage, file, refused = self._remote
        return _reopen, (kept_name(self.path, file), self.positioned, storage, file and file[2], self.view, refused)

    def __repr__(self) -> str:
        name = _native.shown(str(self.path))
        if self.closed:
            return f"<spinney.ExactModel {name!r}, closed>"
        unit = f" {self.unit}" if self.unit else ""
        steps = f" through {', '.join(self.view)}" if self.view else ""
        return f"<spinney.ExactModel {name!r}{steps}: {len(self)} faces, grid of {self.step:g}{unit}, depth {self.depth}>"

    def __dask_tokenize__(self) -> Any:
        return type(self).__name__, self.view, token_of(self)

    def __bool__(self) -> bool:
        return True

    @property
    def depth(self) -> int:
        """Levels of the octree."""
        return int(self._facts()["depth"])

    @property
    def bits(self) -> int:
        """Bits of the grid's coordinates: levels of cells down to one grid point, as `coverage` has them."""
        return int(self._facts()["bits"])

    @property
    def step(self) -> float:
        """Width of the grid's steps."""
        return float(self._facts()["step"])

    @property
    def origin(self) -> tuple[float, float, float]:
        """The grid's least point."""
        x, y, z = self._facts()["origin"]
        return x, y, z

    @property
    def parts(self) -> list[str]:
        """Names of the parts (objects, groups, materials), to which `Faces.parts` leads."""
        return list(self._facts()["parts"])

    @property
    def nodes(self) -> dict[str, int]:
        """Nodes of the octree by kind: void, full, inner, face, edge, vertex, boolean."""
        return dict(self._facts()["nodes"])

    @property
    def crs(self) -> str | None:
        """The definition of the coordinate system."""
        crs: str | None = self._facts()["crs"]
        return crs

    @property
    def unit(self) -> str | None:
        """The unit of length, where it is known."""
        unit: str | None = self._facts()["unit"]
        return unit

    @property
    def tags(self) -> dict[str, str]:
        """Anything else, by name."""
        return dict(self._facts()["tags"])

    @property
    def provenance(self) -> list[str]:
        """Where the model comes from."""
        return list(self._facts()["provenance"])

    @property
    def rounding(self) -> float:
        """The most that places are off, or somewhat more, where the model is seen through a `view`; 0 where nothing is rounded."""
        return float(self._facts()["rounding"])

    @property
    def bounds(self) -> Box:
        """Least and greatest coordinates of the surface, exact."""
        low, high = self._bounds()
        return Box(*low, *high)

    def verify(self, *, threads: int | None = None, progress: Progress = None) -> list[Finding]:
        """Checks every checksum, that the faces bound a body, and that the octree is theirs; an empty list is good."""
        with working(progress, threads) as terms:
            found = _native.verify(os.fspath(self.path), False, memory_of(MEMORY), terms)
        return [Finding(place, problem) for place, problem in found]

    def mass(self, *, threads: int | None = None, progress: Progress = None) -> Mass:
        """Volume, area, centre of gravity and moments, of a density of 1."""
        with working(progress, threads) as terms:
            facts = self._mass(terms)
        centre = facts.pop("centre")
        second, inertia = (np.array(facts.pop(name)) for name in ("second_moments", "inertia"))
        return Mass(centre=None if centre is None else tuple(centre), second_moments=second, inertia=inertia, **facts)

    @property
    def volume(self) -> float:
        """The volume, by all faces: see `mass`."""
        return self.mass().volume

    @property
    def area(self) -> float:
        """The area of the surface, by all faces: see `mass`."""
        return self.mass().area

    def euler(self, *, memory: int | str = "1G", threads: int | None = None, progress: Progress = None) -> Euler:
        """Numbers of vertices, edges, faces, shells, and handles: how the surface hangs together."""
        with working(progress, threads) as terms:
            return Euler(**self._euler(memory_of(memory), terms))

    def shells(self, *, memory: int | str = "1G", threads: int | None = None, progress: Progress = None) -> Shells:
        """The surfaces that hang together: numbers of their entities, their volumes, and which one each face belongs to."""
        with working(progress, threads) as terms:
            return Shells(**self._shells(memory_of(memory), terms))

    def objects(self, *, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None) -> list[dict[str, Any]]:
        """The parts in their order, as `Faces.parts` counts them, a row for each, as `pandas.json_normalize` takes them: `name`, what is said
        of it (`type`, `attributes`, `parents`, ... of CityJSON's objects), and of those with faces `closed`, `volume` (`None` if it is not
        closed for itself), `area` and `bounds`."""
        with working(progress, threads) as terms:
            found = self._objects(memory_of(memory), terms)
        rows = []
        for name, told, measures in found:
            row = {**json.loads(told or "{}"), "name": name}
            if measures is not None:
                closed, volume, area, bounds = measures
                row.update(closed=closed, volume=volume, area=area, bounds=bounds and Box(*bounds[0], *bounds[1]))
            rows.append(row)
        return rows

    def find_object(
        self, name: str, *, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None
    ) -> dict[str, Any]:
        """The part with a name, a row as `objects` has them, with its number as `part`: the first, if several have it. Without one it is a
        KeyError, which tells names that are like it."""
        names = self.parts
        if name not in names:
            near = ", ".join(difflib.get_close_matches(name, names, 5, 0) or names[:5])
            raise KeyError(f"{_native.shown(str(self.path))}: has no object {name!r}; there are {near}")
        part = names.index(name)
        return {"part": part, **self.objects(memory=memory, threads=threads, progress=progress)[part]}

    def contacts(
        self, *, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None
    ) -> list[ObjectContact]:
        """The pairs of parts that touch, by their numbers. Parts that are not closed for themselves are left out with a warning. (Parts of an exact
        model do not overlap; for objects that do, and of which none can be built, see `object_contacts`.)"""
        with working(progress, threads) as terms:
            return _contacts(self._contacts(memory_of(memory), terms))

    @property
    def face_columns(self) -> list[str]:
        """Names of the columns of values of faces: of CityJSON's surfaces `surface`, `type`, `parent` and `attributes`."""
        return self._face_columns()

    def face_values(self, column: str, *, threads: int | None = None, progress: Progress = None) -> dict[int, Any]:
        """The values of faces in a column of `face_columns`, by the numbers of the faces (`Faces.numbers`), of those that have one."""
        names = self.face_columns
        if column not in names:
            raise KeyError(f"{_native.shown(str(self.path))}: has no values of faces {column!r}; there are {', '.join(names) or 'none'}")
        with working(progress, threads) as terms:
            found = self._face_values(names.index(column), terms)
        # (Faces of one surface have the same text.)
        values = {text: json.loads(text) for text in {text for _, text in found}}
        return {face: values[text] for face, text in found}

    def locate(self, points: Points, *, threads: int | None = None, progress: Progress = None) -> npt.NDArray[np.int8]:
        """1 for points inside the body, 0 on its surface, -1 outside; exact for the doubles that are given."""
        with working(progress, threads) as terms:
            return self._locate(points_of(points, 3), terms)

    def contains(
        self, points: Points, *, boundary: bool = True, threads: int | None = None, progress: Progress = None
    ) -> npt.NDArray[np.bool_]:
        """Whether points are in the body; `boundary` tells whether those on its surface are."""
        least = 0 if boundary else 1
        found: npt.NDArray[np.bool_] = self.locate(points, threads=threads, progress=progress) >= least
        return found

    def distance(
        self, points: Points, *, signed: bool = True, threads: int | None = None, progress: Progress = None
    ) -> npt.NDArray[np.float64]:
        """Distances of points from the surface: negative inside, if they are `signed`; NaN of what is no number."""
        with working(progress, threads) as terms:
            distance, _, _ = self._nearest(points_of(points, 3), signed, terms)
        return distance

    def nearest(self, points: Points, *, threads: int | None = None, progress: Progress = None) -> Surface:
        """The points of the surface that are nearest to points."""
        with working(progress, threads) as terms:
            distance, nearest, faces = self._nearest(points_of(points, 3), False, terms)
        return Surface(distance, nearest, faces)

    def rays(self, origins: Points, directions: Points, *, threads: int | None = None, progress: Progress = None) -> SurfaceHits:
        """Where rays meet the surface first; no ray slips through between two faces. One origin or one direction serves
        all rays. Coordinates that are no numbers, and directions of length 0, are a ValueError."""
        with working(progress, threads) as terms:
            return SurfaceHits(*self._cast_rays(*_rays(origins, directions), terms))

    def crossings(self, origins: Points, directions: Points, *, threads: int | None = None, progress: Progress = None) -> RayCrossings:
        """All places where rays, given as to `rays`, pass through the surface, those of each in their order: an odd number if it begins
        inside, else an even one, also through edges and corners."""
        with working(progress, threads) as terms:
            counts, found = self._cross_rays(*_rays(origins, directions), terms)
        return RayCrossings(np.repeat(np.arange(len(counts)), counts), *found)

    def ray(self, origin: Sequence[float], direction: Sequence[float]) -> SurfaceHits | None:
        """Where one ray meets the surface first (with arrays of one row); `None` if it does not."""
        hits = self.rays([origin], [direction])
        return hits if hits.hit[0] else None

    def locate_box(self, box: BBox) -> Literal["inside", "outside", "cut"]:
        """Whether a box (least and then greatest x, y, z) lies inside or outside of the body, or is cut by its surface."""
        low, high = _box(box)
        place: Literal["inside", "outside", "cut"] = self._place_of_box(low, high)
        return place

    def coverage(
        self, level: int, cell: Sequence[int], *, threads: int | None = None, progress: Progress = None
    ) -> Coverage:
        """The part of a cell (x, y, z of a level, 0 to `bits`) that is inside, exact but for rounding."""
        x, y, z = (int(at) for at in cell)
        if not 0 <= level <= 255 or not all(0 <= at < 1 << 32 for at in (x, y, z)):
            raise ValueError(f"cell: {(x, y, z)} of level {level}, expected levels of 0 to {self.bits}")
        with working(progress, threads) as terms:
            share, volume, centre = self._coverage(level, [x, y, z], terms)
        return Coverage(share, volume, None if centre is None else (centre[0], centre[1], centre[2]))

    def faces(self, box: BBox | None = None, *, threads: int | None = None, progress: Progress = None) -> Faces:
        """The faces as polygons with holes: all, or those whose own boxes meet a box (of these, faces without area are
        left out)."""
        with working(progress, threads) as terms:
            return Faces(**self._face_arrays(None if box is None else _box(box), terms))

    def triangles(self, box: BBox | None = None, *, threads: int | None = None, progress: Progress = None) -> Mesh:
        """The faces cut into triangles: `trimesh.Trimesh(*model.triangles())`. Of a box as `faces`."""
        with working(progress, threads) as terms:
            vertices, triangles, _ = self._triangle_arrays(None if box is None else _box(box), terms)
        return Mesh(vertices, triangles)

    def export(self, path: Path, *, threads: int | None = None, progress: Progress = None) -> tuple[int, int]:
        """Writes the faces as a mesh, .ply, .obj, .stl, .off or .city.json; returns how many vertices and faces that are.

        Polygons stay polygons, but in STL, which has triangles in single precision (and no numbered vertices: 0). What the format
        has no room for, such as colours, parts, the coordinate system or the unit of length, is told in a warning."""
        with working(progress, threads) as terms:
            vertices, faces, _ = self._export(path_of(path), terms)
        return vertices, faces

    def show(self, *, height: int = 500) -> Any:
        """The model in a notebook: a page that turns and cuts it, whose bytes the kernel reads (with the package anywidget)."""
        path = os.fspath(self)
        return shown(path, {"layer": None, "commit": None, "style": None}, height)

    @overload
    def section(
        self,
        out: Path,
        by: str | Sequence[str],
        *,
        flat: bool = False,
        memory: int | str = MEMORY,
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> Section: ...

    @overload
    def section(
        self,
        out: Path,
        by: ExactModel | os.PathLike[str],
        *,
        memory: int | str = MEMORY,
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> SurfaceIntersection: ...

    def section(
        self,
        out: Path,
        by: str | Sequence[str] | ExactModel | os.PathLike[str],
        *,
        flat: bool = False,
        memory: int | str = MEMORY,
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> Section | SurfaceIntersection:
        """Writes where planes cut the model, or what its surface and that of another one have in common, as features (.geojson, .csv,
        .svg, .gpkg, .fgb, .shp of planes, .obj, .ply), as `spinney section` does::

            model.section("outline.svg", "z=12.5")
            model.section("slices.geojson", ["z=0..50/0.2", "plane=1,1,0,7.5"]).area
            with spinney.open_brep("tool.goblin") as tool:
                model.section("lines.ply", tool).crossings

        Planes are `"z=12.5"`, many at a time `"z=0..50/0.2"`, or `"plane=NX,NY,NZ,D"` with the normal and its product with the plane's
        points. The section is that just below the plane: what ends there counts, what stands on it does not. Attributes are `plane`
        (x, y, z, or the normal), `at` and `area`. Points are in space; with `flat` coordinates are those in the plane (y and z where x is
        given, z and x where y is, x and y where z is), as an SVG always has them.

        Of two models, the other being open or the path of a file (a `pathlib.Path`), features are lines where the surfaces pass through each other (`kind` crossing:
        closed, with what of this model's surface is inside of the other on the left) or touch, areas in which they lie on each other
        (overlap) and lone points; `a_left`, `a_right`, `b_left` and `b_right` are the faces of both beside each segment, by their numbers
        in the files that the models were built from. They are found exactly, and points are rounded once; this alone needs `memory`.

        An output that would have more than `max_bytes` is an OSError, and leaves nothing behind.
        """
        given = [by] if isinstance(by, str | os.PathLike | ExactModel) else list(by)
        if not given:
            raise ValueError("by: expected planes such as 'z=12.5', or another model")
        with working(progress, threads, max_bytes) as terms:
            made = self._write_section(path_of(out), given, flat, memory_of(memory), terms)
        return Section(**made) if "planes" in made else SurfaceIntersection(**made)


def _rays(origins: Points, directions: Points) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    starts, ways = np.broadcast_arrays(rows_of(origins, "origins"), rows_of(directions, "directions"))
    return np.ascontiguousarray(starts), np.ascontiguousarray(ways)


def _box(box: BBox) -> tuple[list[float], list[float]]:
    numbers = [float(at) for at in box]
    if len(numbers) != 6 or not all(low <= high for low, high in zip(numbers[:3], numbers[3:])):
        raise ValueError(f"box: {box!r}, expected least and then greatest x, y, z")
    return numbers[:3], numbers[3:]


def _reopen(
    path: str,
    positioned: bool,
    storage: list[tuple[str, str]] | None = None,
    file: Any = None,
    view: Sequence[str] = (),
    refused: tuple[bool, bool] = (False, False),
) -> ExactModel:
    return ExactModel(path, positioned, access_again(file, storage, refused), list(view))
