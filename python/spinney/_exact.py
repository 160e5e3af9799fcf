"""Exact models: boundary representations of bodies, without conversion to cells."""

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
    DetailLevel,
    DetailMesh,
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
    levels: bool = False,
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
    """Builds an exact model, a .goblin file, from one or several mesh files (PLY, OBJ, STL, OFF,
    glTF, CityJSON, exact models), or from a mesh. A mesh is a trimesh mesh, anything with
    `vertices` and `faces`, or a pair of these: rows of x, y and z, and rows, or lists of any
    lengths, of three or more vertex numbers, counterclockwise seen from outside; or `Faces` of an
    exact model, polygons with holes. Several meshes, in a list, in a mapping by name, or in a
    trimesh scene, are objects, each of them a part of the model::

        spinney.build_brep(
            (vertices, triangles), "a.goblin", colours=reds, parts=numbers, names=["roof", "wall"]
        )
        spinney.build_brep(
            {"left": mesh, "right": other}, "b.goblin", attributes={"left": {"height": 5.5}}
        )

    Trimesh meshes keep colours, names and units. For a single mesh, `colours` are rows of red,
    green and blue from 0 to 255, one per vertex, and `parts` are numbers from 0, one per face, that
    group the faces of one object into parts. `names` are the names of the parts (by default their
    numbers), and `attributes` those of each part: a list in their order, or a mapping by name.

    Vertices are snapped to an integer grid; everything after that is exact. `snap` is the grid
    unit, by default that of the files' own grid or the finest possible one. `close` closes open
    surfaces with triangles over their boundaries. `repair` resolves surfaces that intersect
    themselves, overlap themselves, or are inside out: inverted bodies are flipped, and `inside`
    selects which points are inside, by winding number: nonzero ("nonzero", as for cells), positive
    ("positive"), or odd ("odd"). `where` selects objects by conditions, as in
    "type=Building,measuredHeight>5" (`id` is the name), and `skip_bad` leaves out objects that are
    not valid bodies, and reports them. Without these, an invalid surface raises a ValueError that
    lists the locations, and no file is written. `levels` adds levels of detail, coarser surfaces
    with bounds of their error (see `ExactModel.mesh`). Octree cells with up to `leaf_size` faces
    are not divided. `up`, `unit`, `crs`, `memory` and `max_bytes` are as for `build`. With the
    `codec` "packed" the file is compressed, and unpacked when it is used.
    """
    paths, meshes = paths_of(models), meshes_of(models)
    if paths is None and meshes is None:
        raise TypeError(f"models: expected the path of a mesh file, or several, or meshes, got {models!r}")
    of_meshes: dict[str, Any] = {"colours": colours, "parts": parts, "names": names, "attributes": attributes}
    if meshes is None:
        refuse("meshes in memory", of_meshes)
    columns = mesh_columns(meshes, **of_meshes) if meshes else []
    if leaf_size is not None and leaf_size < 0:
        raise ValueError(f"leaf_size: got {leaf_size}, expected a number of faces")
    options = {
        "snap": None if snap is None else float(snap),
        "close": close,
        "repair": repair,
        "inside": inside,
        "where": where,
        "skip_bad": skip_bad,
        "levels": levels,
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
    """Returns the pairs of objects in mesh files, such as CityJSON, that overlap or touch, by their
    numbers. Vertices are snapped to the grid that `build_brep` would use, or to one of `snap`
    units. Open objects are left out with a warning. (For exact models see `ExactModel.contacts`.)
    """
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

    Files are mapped; with `positioned=True` they are read without mapping, for files that may be
    replaced in place, or that are on network file systems. URLs and files of fsspec are opened, too
    (see `open`).

    `view` is a list of operations as in `spinney transform`, such as `"rotate=90,x"`: points,
    distances, rays, measures, sections by planes, boxes and contacts are those of the transformed
    model. They are exact for quarter turns, mirrors, shifts by grid units and a uniform scale (see
    `ExactModel.rounding`). Queries that a transformation does not allow raise ValueError, such as
    distances after non-uniform scaling; faces, `export`, `coverage` and sections by other models
    require shifts by grid units and a uniform scale.

    Raises FileNotFoundError or another OSError if the file cannot be read, is corrupt, or is a tree
    of cells (which `open` opens).
    """
    name, remote = remote_access_of(path, storage_options)
    return ExactModel(name, positioned, remote, [view] if isinstance(view, str) else list(view))


class ExactModel(_native.Model):
    """An open exact model: see `open_brep`. Its length is the number of its faces.

    All coordinates are world coordinates, and points are arrays with a row each. Predicates are
    decided in integers; lengths and volumes are rounded. Queries for many points run on all
    processors without the interpreter's lock, can be cancelled by Ctrl-C, and read only what they
    need.

    A model can be used by any number of threads at the same time, is pickled by its path, and may
    be used by forked processes. Functions that take the path of a model, such as `combine`, also
    take an open model. A closed model raises ValueError.
    """

    def __fspath__(self) -> str:
        if self.view:
            raise ValueError(f"{_native.shown(str(self.path))}: is a view ({', '.join(self.view)}); write it to a file first, with `transform`")
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
        """The number of levels of the octree."""
        return int(self._facts()["depth"])

    @property
    def bits(self) -> int:
        """The bits of a grid coordinate: the number of levels of cells down to one grid point, as
        in `coverage`.
        """
        return int(self._facts()["bits"])

    @property
    def step(self) -> float:
        """The width of a grid unit."""
        return float(self._facts()["step"])

    @property
    def origin(self) -> tuple[float, float, float]:
        """The minimum point of the grid."""
        x, y, z = self._facts()["origin"]
        return x, y, z

    @property
    def parts(self) -> list[str]:
        """Names of the parts (objects, groups, materials), which `Faces.parts` refers to."""
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
        """The unit of length, if known."""
        unit: str | None = self._facts()["unit"]
        return unit

    @property
    def tags(self) -> dict[str, str]:
        """Further metadata, by name."""
        return dict(self._facts()["tags"])

    @property
    def provenance(self) -> list[str]:
        """The model's provenance."""
        return list(self._facts()["provenance"])

    @property
    def rounding(self) -> float:
        """An upper bound of the rounding error of positions after the operations of a `view`; 0 if
        nothing is rounded.
        """
        return float(self._facts()["rounding"])

    @property
    def bounds(self) -> Box:
        """Exact minimum and maximum coordinates of the surface."""
        low, high = self._bounds()
        return Box(*low, *high)

    def verify(self, *, threads: int | None = None, progress: Progress = None) -> list[Finding]:
        """Checks every checksum, that the faces bound a body, and that the octree is consistent
        with them. An empty list means that there are no defects.
        """
        with working(progress, threads) as terms:
            found = _native.verify(os.fspath(self.path), False, memory_of(MEMORY), terms)
        return [Finding(place, problem) for place, problem in found]

    def mass(self, *, threads: int | None = None, progress: Progress = None) -> Mass:
        """Returns volume, area, centre of gravity and moments, for a density of 1."""
        with working(progress, threads) as terms:
            facts = self._mass(terms)
        centre = facts.pop("centre")
        second, inertia = (np.array(facts.pop(name)) for name in ("second_moments", "inertia"))
        return Mass(centre=None if centre is None else tuple(centre), second_moments=second, inertia=inertia, **facts)

    @property
    def volume(self) -> float:
        """The volume, from all faces: see `mass`."""
        return self.mass().volume

    @property
    def area(self) -> float:
        """The surface area, from all faces: see `mass`."""
        return self.mass().area

    def euler(self, *, memory: int | str = "1G", threads: int | None = None, progress: Progress = None) -> Euler:
        """Returns the numbers of vertices, edges, faces, shells and handles: the topology of the
        surface.
        """
        with working(progress, threads) as terms:
            return Euler(**self._euler(memory_of(memory), terms))

    def shells(self, *, memory: int | str = "1G", threads: int | None = None, progress: Progress = None) -> Shells:
        """Returns the connected components of the surface: their entity counts, their volumes, and
        the shell of each face.
        """
        with working(progress, threads) as terms:
            return Shells(**self._shells(memory_of(memory), terms))

    def objects(self, *, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None) -> list[dict[str, Any]]:
        """Returns the parts in the order of `Faces.parts`, a row for each, as accepted by
        `pandas.json_normalize`: `name`, the part's attributes (`type`, `attributes`, `parents`, ...
        of CityJSON objects), and for parts with faces `closed`, `volume` (`None` unless the part
        itself is closed), `area` and `bounds`.
        """
        with working(progress, threads) as terms:
            found = self._objects(memory_of(memory), terms)
        rows = []
        for name, attributes, measures in found:
            row = {**json.loads(attributes or "{}"), "name": name}
            if measures is not None:
                closed, volume, area, bounds = measures
                row.update(closed=closed, volume=volume, area=area, bounds=bounds and Box(*bounds[0], *bounds[1]))
            rows.append(row)
        return rows

    def find_object(
        self, name: str, *, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None
    ) -> dict[str, Any]:
        """Returns the first part with a name: a row as in `objects`, with its number as `part`. If
        there is none, raises a KeyError, with similar names if there are any.
        """
        names = self.parts
        if name not in names:
            near = ", ".join(difflib.get_close_matches(name, names, 5))
            others = f"similar names are {near}" if near else f"parts lists all {len(names)} names"
            raise KeyError(f"{_native.shown(str(self.path))}: has no object {name!r}; {others}")
        part = names.index(name)
        return {"part": part, **self.objects(memory=memory, threads=threads, progress=progress)[part]}

    def contacts(
        self, *, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None
    ) -> list[ObjectContact]:
        """Returns the pairs of parts that touch, by their numbers. Parts that are not closed by
        themselves are left out with a warning. (Parts of an exact model do not overlap; for objects
        that do, and of which no model can be built, see `object_contacts`.)
        """
        with working(progress, threads) as terms:
            return _contacts(self._contacts(memory_of(memory), terms))

    @property
    def face_columns(self) -> list[str]:
        """Names of the columns of face values: for CityJSON surfaces `surface`, `type`, `parent`
        and `attributes`.
        """
        return self._face_columns()

    def face_values(self, column: str, *, threads: int | None = None, progress: Progress = None) -> dict[int, Any]:
        """Returns the values in a column of `face_columns`, by face number (`Faces.numbers`), of
        faces that have one.
        """
        names = self.face_columns
        if column not in names:
            raise KeyError(f"{_native.shown(str(self.path))}: has no face values {column!r}; there are {', '.join(names) or 'none'}")
        with working(progress, threads) as terms:
            found = self._face_values(names.index(column), terms)
        # (Faces of one surface have the same string.)
        values = {text: json.loads(text) for text in {text for _, text in found}}
        return {face: values[text] for face, text in found}

    def locate(self, points: Points, *, threads: int | None = None, progress: Progress = None) -> npt.NDArray[np.int8]:
        """Returns 1 for points inside the body, 0 on its surface, -1 outside; exact for the given
        doubles.
        """
        with working(progress, threads) as terms:
            return self._locate(points_of(points, 3), terms)

    def contains(
        self, points: Points, *, boundary: bool = True, threads: int | None = None, progress: Progress = None
    ) -> npt.NDArray[np.bool_]:
        """Returns whether points are in the body; `boundary` decides whether those on its surface
        are.
        """
        least = 0 if boundary else 1
        found: npt.NDArray[np.bool_] = self.locate(points, threads=threads, progress=progress) >= least
        return found

    def distance(
        self, points: Points, *, signed: bool = True, threads: int | None = None, progress: Progress = None
    ) -> npt.NDArray[np.float64]:
        """Returns the distances of points from the surface: negative inside if `signed`; NaN for
        points with NaN.
        """
        with working(progress, threads) as terms:
            distance, _, _ = self._nearest(points_of(points, 3), signed, terms)
        return distance

    def nearest(self, points: Points, *, threads: int | None = None, progress: Progress = None) -> Surface:
        """Returns the points of the surface that are nearest to points."""
        with working(progress, threads) as terms:
            distance, nearest, faces = self._nearest(points_of(points, 3), False, terms)
        return Surface(distance, nearest, faces)

    def rays(self, origins: Points, directions: Points, *, threads: int | None = None, progress: Progress = None) -> SurfaceHits:
        """Returns the first hits of rays; no ray passes between two adjacent faces. A single origin
        or direction applies to all rays. Coordinates that are not finite, and directions of length
        0, raise ValueError.
        """
        with working(progress, threads) as terms:
            return SurfaceHits(*self._cast_rays(*_rays(origins, directions), terms))

    def crossings(self, origins: Points, directions: Points, *, threads: int | None = None, progress: Progress = None) -> RayCrossings:
        """Returns all points where rays, given as to `rays`, cross the surface, in order along each
        ray. Their number is odd if the ray starts inside, and otherwise even, also through edges
        and vertices.
        """
        with working(progress, threads) as terms:
            counts, found = self._cross_rays(*_rays(origins, directions), terms)
        return RayCrossings(np.repeat(np.arange(len(counts)), counts), *found)

    def ray(self, origin: Sequence[float], direction: Sequence[float]) -> SurfaceHits | None:
        """Returns the first hit of one ray (with arrays of one row); `None` if there is none."""
        hits = self.rays([origin], [direction])
        return hits if hits.hit[0] else None

    def locate_box(self, box: BBox) -> Literal["inside", "outside", "cut"]:
        """Returns whether a box (minimum, then maximum x, y, z) lies inside or outside of the body,
        or is cut by its surface.
        """
        low, high = _box(box)
        place: Literal["inside", "outside", "cut"] = self._place_of_box(low, high)
        return place

    def coverage(
        self, level: int, cell: Sequence[int], *, threads: int | None = None, progress: Progress = None
    ) -> Coverage:
        """Returns the share of a cell (x, y, z of a level, 0 to `bits`) that is inside, exact
        except for rounding.
        """
        x, y, z = (int(at) for at in cell)
        if not 0 <= level <= 255 or not all(0 <= at < 1 << 32 for at in (x, y, z)):
            raise ValueError(f"cell: got {(x, y, z)} of level {level}, expected levels 0 to {self.bits}")
        with working(progress, threads) as terms:
            share, volume, centre = self._coverage(level, [x, y, z], terms)
        return Coverage(share, volume, None if centre is None else (centre[0], centre[1], centre[2]))

    def faces(self, box: BBox | None = None, *, threads: int | None = None, progress: Progress = None) -> Faces:
        """Returns the faces as polygons with holes: all, or those whose own boxes intersect a box
        (then without faces of zero area).
        """
        with working(progress, threads) as terms:
            return Faces(**self._face_arrays(None if box is None else _box(box), terms))

    def triangles(self, box: BBox | None = None, *, threads: int | None = None, progress: Progress = None) -> Mesh:
        """Returns the triangulated faces: `trimesh.Trimesh(*model.triangles())`. `box` is as for
        `faces`.
        """
        with working(progress, threads) as terms:
            vertices, triangles, _ = self._triangle_arrays(None if box is None else _box(box), terms)
        return Mesh(vertices, triangles)

    @property
    def levels(self) -> list[DetailLevel]:
        """The levels of detail, coarsest first. The last one is the exact surface. Empty if the
        file has none: `build_brep(levels=True)` and `transform(path, "levels", out)` add them.
        """
        return [DetailLevel(*level) for level in self._levels()]

    def mesh(
        self,
        error: float | None = None,
        faces: int | None = None,
        level: int | None = None,
        box: BBox | None = None,
        *,
        threads: int | None = None,
        progress: Progress = None,
    ) -> DetailMesh:
        """Returns the surface as triangles, at a level of detail::

            spinney.transform("statue.goblin", "levels", "levels.goblin")
            with spinney.open_brep("levels.goblin") as model:
                coarse = model.mesh(error=0.01)
                coarse.error, len(coarse.faces), model.levels[0].faces

        At most one of three arguments selects the detail: `error` as few faces as possible whose
        distance from the exact surface is at most that; `faces` the smallest error with at most
        that number of faces; `level` an index of `levels`. These need a file with levels. By
        default, the surface is exact, as that of `triangles`.

        A surface is closed where the exact one is. Coarse surfaces may intersect themselves, within
        their error; they are for display. With a `box`, a coarse surface consists of all clusters
        of about 500 faces that touch the box, and an exact one of faces as for `faces`.
        """
        with working(progress, threads) as terms:
            return DetailMesh(**self._mesh_arrays((error, faces, level), None if box is None else _box(box), terms))

    def export(
        self,
        path: Path,
        *,
        error: float | None = None,
        faces: int | None = None,
        level: int | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> tuple[int, int]:
        """Writes the faces as a mesh, .ply, .obj, .stl, .off or .city.json; returns the number of
        vertices and faces. `error`, `faces` or `level` select the detail, as for `mesh`.

        Polygons stay polygons in CityJSON, and convex ones in OBJ and OFF; other faces are
        triangulated, all of them in PLY and in STL, which has single precision (and no numbered
        vertices: 0). A warning lists what the format cannot store, such as colours, parts,
        the coordinate system or the unit of length.
        """
        with working(progress, threads) as terms:
            vertices, count, _ = self._export(path_of(path), (error, faces, level), terms)
        return vertices, count

    def show(self, *, height: int = 500) -> Any:
        """Displays the model in a notebook: a page that rotates and cuts it. The kernel reads the
        file for the page (with the package anywidget).
        """
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
        """Writes the model's cuts by planes, or the intersection of its surface with that of
        another model, as features (.geojson, .csv, .svg, .gpkg, .fgb, .shp for planes, .obj, .ply),
        as `spinney section` does::

            model.section("outline.svg", "z=12.5")
            model.section("slices.geojson", ["z=0..50/0.2", "plane=1,1,0,7.5"]).area
            with spinney.open_brep("tool.goblin") as tool:
                model.section("lines.ply", tool).crossings

        Planes are `"z=12.5"`, many at a time `"z=0..50/0.2"`, or `"plane=NX,NY,NZ,D"` with the
        normal and its product with the plane's points. The section is the limit from below the
        plane: a body that ends at the plane is included, one that begins there is not. Attributes
        are `plane` (x, y, z, or the normal), `at` and `area`. Points are in space; with `flat`
        coordinates are those in the plane (y and z for a plane of x, z and x for y, x and y for z),
        as always in SVG.

        For two models, the other one being open or the path of a file (a `pathlib.Path`), features
        are lines where the surfaces cross (`kind` crossing: closed, with the region of this model's
        surface inside of the other on the left) or touch, areas in which they coincide (overlap),
        and isolated points. `a_left`, `a_right`, `b_left` and `b_right` are the faces of both
        models on each side of each segment, by their numbers in the files that the models were
        built from. Intersections are exact, and points are rounded once; only this query needs
        `memory`.

        An output larger than `max_bytes` raises OSError, and leaves no partial output.
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
        raise ValueError(f"box: got {box!r}, expected minimum x, y, z, then maximum x, y, z")
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
