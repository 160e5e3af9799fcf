"""What other packages have, as something that trees are built of."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ._types import Array, Path


def paths_of(source: Any) -> list[str] | None:
    """Names of files, if the source is that."""
    if isinstance(source, str | os.PathLike):
        return [str(os.fspath(source))]
    if isinstance(source, list | tuple) and source and all(isinstance(s, str | os.PathLike) for s in source):
        return [str(os.fspath(path)) for path in source]
    return None


def is_mesh(source: Any) -> bool:
    """Whether something is a mesh: one of trimesh, or any that has vertices and faces; or a pair of arrays of them."""
    if isinstance(source, tuple) and len(source) == 2 and not isinstance(source[0], str | os.PathLike):
        vertices, faces = (np.asarray(part) for part in source)
        return vertices.ndim == faces.ndim == 2 and vertices.shape[1] == 3 and faces.dtype.kind in "iu"
    return hasattr(source, "vertices") and hasattr(source, "faces")


@contextmanager
def mesh_file(source: Any, out: Path) -> Iterator[tuple[str, str | None]]:
    """A file of a mesh, beside the output for as long as it is needed, and the unit of length that the mesh tells."""
    vertices, faces = source if isinstance(source, tuple) else (source.vertices, source.faces)
    points = np.ascontiguousarray(vertices, dtype="<f8")
    corners = np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"vertices: expected rows of x, y and z, got an array of shape {points.shape}")
    if corners.ndim != 2 or corners.shape[1] < 3 or corners.dtype.kind not in "iu":
        raise ValueError(f"faces: expected rows of three or more vertices' numbers, got {corners.dtype} of shape {corners.shape}")
    if corners.size and not 0 <= int(corners.min()) <= int(corners.max()) < len(points):
        raise IndexError(f"faces: vertices are 0 to {len(points) - 1}, got {int(corners.min())} to {int(corners.max())}")
    count = corners.shape[1]
    rows = np.empty(len(corners), dtype=[("count", "u1"), ("corners", "<i4", (count,))])
    rows["count"], rows["corners"] = count, corners
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(rows)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    beside = os.path.dirname(os.path.abspath(os.fspath(out)))
    with tempfile.TemporaryDirectory(prefix="spinney-", dir=beside) as folder:
        path = os.path.join(folder, "mesh.ply")
        with open(path, "wb") as file:
            file.write(header.encode())
            file.write(points.data)
            file.write(rows.tobytes())
        unit = {"millimeters": "mm", "centimeters": "cm", "meters": "m", "kilometers": "km", "inches": "in", "feet": "ft"}
        yield path, unit.get(str(getattr(source, "units", None)))


def is_rasterio(source: Any) -> bool:
    """Whether something is an open dataset of rasterio."""
    return all(hasattr(source, name) for name in ("indexes", "read", "profile", "dtypes"))


class RasterioArray:
    """The bands of a dataset of rasterio, to be read block by block; VOID is what its masks say."""

    def __init__(self, dataset: Any) -> None:
        self.dataset = dataset
        self.shape = (dataset.count, dataset.height, dataset.width)
        self.dtype = np.dtype(dataset.dtypes[0])
        if len(set(dataset.dtypes)) > 1:
            raise TypeError(f"bands of several types, {', '.join(dataset.dtypes)}: build a tree of each")

    def __getitem__(self, key: tuple[slice, slice, slice]) -> Array:
        _, rows, columns = key
        window = ((rows.start, rows.stop), (columns.start, columns.stop))
        found: Array = self.dataset.read(window=window, masked=True)
        return found

    def told(self) -> dict[str, Any]:
        """What the dataset tells about itself, as arguments of `spinney.build`."""
        dataset = self.dataset
        placed = dataset.crs is not None or not dataset.transform.is_identity
        colours = None
        if dataset.count == 1 and "palette" in str(dataset.colorinterp[0]):
            colours = dataset.colormap(1)
        scaled = set(dataset.scales) != {1.0} or set(dataset.offsets) != {0.0}
        return {
            "transform": dataset.transform if placed else None,
            "crs": dataset.crs,
            "nodata": dataset.nodata,
            "colormap": colours,
            "descriptions": dataset.descriptions if any(dataset.descriptions) else None,
            "units": dataset.units if any(dataset.units) else None,
            "scales": dataset.scales if scaled else None,
            "offsets": dataset.offsets if scaled else None,
            "tags": {name: text for name, text in dataset.tags().items() if name != "AREA_OR_POINT"},
        }


def one_array(dataset: Any) -> Any:
    """The variables of a dataset of xarray as one DataArray: that which there is, or several as its bands."""
    names = [name for name, array in dataset.data_vars.items() if array.ndim >= 2]
    if not names:
        raise ValueError("a dataset of xarray without a variable that has rows and columns")
    if len(names) == 1:
        return dataset[names[0]]
    first = dataset[names[0]]
    array = dataset[names].to_dataarray("band")
    if any(dataset[name].dtype != first.dtype or dataset[name].dims != first.dims for name in names):
        raise ValueError(f"variables of several types or axes, {', '.join(map(str, names))}: build a tree of each")
    array.attrs = {name: value for name, value in first.attrs.items() if name not in ("long_name", "units")}
    array.attrs["long_name"] = tuple(map(str, names))
    array.encoding = dict(first.encoding)
    return array
