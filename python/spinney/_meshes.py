"""Meshes in memory as input of builds: arrays, trimesh meshes and scenes, faces of exact models."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ._options import names_of
from ._remote import is_path
from ._types import Array, Faces

_UNITS = {"millimeters": "mm", "centimeters": "cm", "meters": "m", "kilometers": "km", "inches": "in", "feet": "ft"}
_NOTHING = np.zeros(0, dtype="<u4")


def is_mesh(source: Any) -> bool:
    """Returns whether a source is a mesh: a trimesh mesh, or anything that has vertices and faces;
    faces of an exact model; or a pair of arrays.
    """
    if isinstance(source, tuple) and len(source) == 2 and not is_path(source[0]):
        if is_mesh(source[0]) or is_mesh(source[1]):
            return False
        vertices = np.asarray(source[0])
        if isinstance(source[1], list) and len({len(face) for face in source[1] if hasattr(face, "__len__")}) > 1:
            return vertices.ndim == 2 and vertices.shape[1] == 3
        faces = np.asarray(source[1])
        return vertices.ndim == faces.ndim == 2 and vertices.shape[1] == 3 and faces.dtype.kind in "iu"
    return isinstance(source, Faces) or (hasattr(source, "vertices") and hasattr(source, "faces"))


def meshes_of(source: Any) -> list[tuple[str | None, Any]] | None:
    """Returns the meshes of a source, with their names: one, several in a list or by name, or a
    trimesh scene.
    """
    if is_mesh(source):
        return [(None, source)]
    if hasattr(source, "graph") and hasattr(source, "dump"):
        # (Copies transformed to their positions in the scene, whose nodes have names of their own.)
        found = [(str(mesh.metadata["node"]), mesh) for mesh in source.dump()]
    elif isinstance(source, Mapping):
        found = [(str(name), mesh) for name, mesh in source.items()]
    elif isinstance(source, list) and any(map(is_mesh, source)):
        found = [(_name_of(mesh) or str(number), mesh) for number, mesh in enumerate(source)]
    else:
        return None
    for name, mesh in found:
        if not is_mesh(mesh):
            raise TypeError(f"models: {name!r} is of type {type(mesh).__name__}, expected a mesh")
    return list(found)


def unit_of(meshes: Sequence[tuple[str | None, Any]]) -> str | None:
    """Returns the unit of length of trimesh meshes."""
    units = {str(getattr(mesh, "units", None)) for _, mesh in meshes} - {"None"}
    if len(units) > 1:
        raise ValueError(f"models: got meshes in {' and '.join(sorted(units))}, expected one unit; convert them")
    return next((_UNITS.get(name) for name in units), None)


def mesh_columns(
    meshes: Sequence[tuple[str | None, Any]],
    colours: Any = None,
    parts: Any = None,
    names: Sequence[str] | None = None,
    attributes: Sequence[Mapping[str, Any] | None] | Mapping[str, Mapping[str, Any]] | None = None,
) -> list[dict[str, Any]]:
    """Returns the arrays of meshes, by name: of a single one with the attributes of its vertices,
    faces and parts, or of several that are a part each.
    """
    if len(meshes) == 1 and meshes[0][0] is None:
        ((_, mesh),) = meshes
        own = mesh.parts if parts is None and isinstance(mesh, Faces) else parts
        columns, count = _columns(mesh, colours)
        numbers = _NOTHING if own is None else _numbers(own, count, "parts", "faces")
        most = int(numbers.max(initial=0)) + 1
        called = names_of(names) if names is not None else [_name_of(mesh) or "mesh"] if own is None else [str(number) for number in range(most)]
        if len(called) < most:
            raise ValueError(f"names: got {len(called)}, expected one for each part, 0 to {most - 1}")
        return [columns | {"name": _name_of(mesh) or "mesh", "face_parts": numbers, "parts": called, "attributes": _attribute_json(attributes, called)}]
    if colours is not None or parts is not None:
        raise ValueError("colours, parts: are for a single mesh; several meshes have colours of their own, and are one part each")
    called = [str(name) for name, _ in meshes] if names is None else names_of(names)
    if len(called) != len(meshes):
        raise ValueError(f"names: got {len(called)}, expected one for each of {len(meshes)} meshes")
    every = []
    for name, text, (_, mesh) in zip(called, _attribute_json(attributes, called), meshes):
        columns, _ = _columns(mesh, None)
        every.append(columns | {"name": name, "face_parts": _NOTHING, "parts": [name], "attributes": [text]})
    return every


def _columns(mesh: Any, colours: Any) -> tuple[dict[str, Any], int]:
    """Returns vertices, faces and colours of a mesh, and the number of its faces."""
    if isinstance(mesh, Faces):
        points, corners = np.asarray(mesh.vertices), np.asarray(mesh.corners)
        ends, face_ends = mesh.ring_ends, mesh.face_ends
        own = ("corners", mesh.colours) if mesh.colours is not None and colours is None else None
    else:
        vertices, faces = mesh if isinstance(mesh, tuple) else (mesh.vertices, mesh.faces)
        points, (corners, ends), face_ends = np.asarray(vertices), _rings_of(faces), np.zeros(0, dtype=np.int64)
        own = _colours_of(mesh) if colours is None else None
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"vertices: expected rows of x, y and z, got an array of shape {points.shape}")
    if corners.size and not 0 <= int(corners.min()) <= int(corners.max()) < len(points):
        raise IndexError(f"faces: vertices are 0 to {len(points) - 1}, got {int(corners.min())} to {int(corners.max())}")
    of, rows = own or ("vertices", colours)
    columns = {
        "vertices": np.ascontiguousarray(points, dtype="<f8"),
        "corners": np.ascontiguousarray(corners, dtype="<u4"),
        "ring_ends": np.ascontiguousarray(ends, dtype="<u8"),
        "face_ends": np.ascontiguousarray(face_ends, dtype="<u8"),
        "colours": None if rows is None else (of, _channels(rows)),
    }
    return columns, len(face_ends) or len(ends) or len(corners) // 3


def _rings_of(faces: Any) -> tuple[Array, Array]:
    """Returns the vertices of polygons, and each polygon's end among them; no ends for
    triangles.
    """
    lengths = np.array([len(face) for face in faces]) if isinstance(faces, list) else np.empty(0, dtype=np.int64)
    is_ragged = len(np.unique(lengths)) > 1
    corners = np.concatenate([np.asarray(face) for face in faces]) if is_ragged else np.asarray(faces)
    least = int(lengths.min()) if is_ragged else corners.shape[-1]
    if corners.ndim != (1 if is_ragged else 2) or least < 3 or corners.dtype.kind not in "iu":
        raise ValueError(f"faces: expected rows of three or more vertices' numbers, got {corners.dtype} of shape {corners.shape}")
    if is_ragged:
        return corners, np.cumsum(lengths)
    count, width = corners.shape
    return corners.reshape(-1), np.arange(1, (0 if width == 3 else count) + 1) * width


def _colours_of(mesh: Any) -> tuple[str, Any] | None:
    """Returns the colours of a trimesh mesh's vertices or faces, if it has some. Textures are
    dropped with a warning.
    """
    visual = getattr(mesh, "visual", None)
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        warnings.warn("the mesh's texture is not stored; `mesh.visual.to_color()` converts it to colours", stacklevel=5)
    if kind in ("vertex", "face"):
        return ("vertices", visual.vertex_colors) if kind == "vertex" else ("faces", visual.face_colors)  # type: ignore[union-attr]
    return None


def _channels(rows: Any) -> npt.NDArray[np.uint8]:
    """Returns red, green and blue of integer rows. Opacity is dropped with a warning."""
    colours = np.asarray(rows)
    if colours.ndim != 2 or colours.shape[1] not in (3, 4) or colours.dtype.kind not in "iu":
        raise ValueError(f"colours: got {colours.dtype} of shape {colours.shape}, expected rows of red, green and blue, integers from 0 to 255")
    if colours.size and not 0 <= int(colours.min()) <= int(colours.max()) <= 255:
        raise ValueError(f"colours: got {int(colours.min())} to {int(colours.max())}, expected integers from 0 to 255")
    if colours.shape[1] == 4 and (colours[:, 3] != 255).any():
        warnings.warn("the opacity of colours is not stored", stacklevel=5)
    return np.ascontiguousarray(colours[:, :3], dtype=np.uint8)


def _numbers(given: Any, count: int, name: str, of: str) -> npt.NDArray[np.uint32]:
    """Checks `count` integers from 0."""
    numbers = np.asarray(given)
    if numbers.shape != (count,) or numbers.dtype.kind not in "iu" or (count and not 0 <= int(numbers.min()) <= int(numbers.max()) < 1 << 32):
        raise ValueError(f"{name}: got {numbers.dtype} of shape {numbers.shape}, expected a number from 0 for each of {count} {of}")
    return np.ascontiguousarray(numbers, dtype="<u4")


def _attribute_json(attributes: Any, names: Sequence[str]) -> list[str | None]:
    """Returns the attributes of each part, as JSON."""
    if isinstance(attributes, Mapping):
        unknown = [str(name) for name in attributes if name not in names]
        if unknown:
            raise ValueError(f"attributes: got an unknown part {unknown[0]!r}, expected one of {', '.join(map(repr, names[:20]))}")
        attributes = [attributes.get(name) for name in names]
    rows = [None] * len(names) if attributes is None else list(attributes)
    if len(rows) != len(names):
        raise ValueError(f"attributes: got {len(rows)}, expected one for each of {len(names)} parts")
    return [None if row is None else json.dumps({"attributes": dict(row)}, default=_plain, allow_nan=False) for row in rows]


def _plain(value: Any) -> Any:
    """Converts a NumPy scalar or array to Python."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"attributes: got {value!r}, expected a value that JSON can represent")


def _name_of(mesh: Any) -> str | None:
    """Returns the name in a trimesh mesh's metadata."""
    metadata = getattr(mesh, "metadata", None)
    name = metadata.get("name") if isinstance(metadata, Mapping) else None
    return None if name is None else str(name)
