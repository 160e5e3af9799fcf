"""Properties of trees: size, meaning, georeferencing."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from . import _native
from ._types import BoundingBox, Box, Transform


class Properties(_native.Tree):
    """Descriptive properties of a dataset."""

    # Size and meaning

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns; in octrees planes come first."""
        return tuple(self._shape_at(None))

    @property
    def ndim(self) -> int:
        """2, or 3 for octrees."""
        return len(self._shape_at(None))

    @property
    def size(self) -> int:
        """The number of cells."""
        size = 1
        for length in self._shape_at(None):
            size *= length
        return size

    @property
    def width(self) -> int:
        """The number of columns."""
        return self.shape[-1]

    @property
    def height(self) -> int:
        """The number of rows."""
        return self.shape[-2]

    @property
    def indexes(self) -> tuple[int, ...]:
        """Numbers of the bands, from 1."""
        return tuple(range(1, self.count + 1))

    @property
    def dtypes(self) -> tuple[str, ...]:
        """The type of each band, by name."""
        return (self.dtype.name,) * self.count

    @property
    def levels(self) -> int:
        """The number of levels: level 0 is a single cell, level `depth` has the cells."""
        return self.depth + 1

    @property
    def kind(self) -> str:
        """`"categorical"` (classes) or `"continuous"` (measurements)."""
        return str(self._facts()["kind"])

    @property
    def rule(self) -> str:
        """The rule that computes the value of a coarser cell: mean, majority, ..."""
        return str(self._facts()["rule"])

    @property
    def format(self) -> str:
        """`"Goblin"` or `"Autumnal"`."""
        return str(self._facts()["format"])

    @property
    def file_size(self) -> int:
        """The size of the file in bytes."""
        return int(self._facts()["file_size"])

    @property
    def tags(self) -> dict[str, str]:
        """Further metadata, by name."""
        return dict(self._facts()["tags"])

    @property
    def colormap(self) -> dict[int, tuple[int, int, int, int]] | None:
        """Red, green, blue and opacity by value."""
        colours = self._facts()["colormap"]
        return None if colours is None else dict(colours)

    @property
    def categories(self) -> dict[int, str]:
        """Names of values."""
        return dict(self._facts()["categories"])

    @property
    def descriptions(self) -> tuple[str | None, ...]:
        """Names of the bands."""
        return self._by_band("descriptions")

    @property
    def units(self) -> tuple[str | None, ...]:
        """Units of the bands, after scale and offset."""
        return self._by_band("units")

    @property
    def scales(self) -> tuple[float, ...]:
        """Factors from samples to physical units."""
        pairs = self._facts()["scale_offset"] or [(1.0, 0.0)] * self.count
        return tuple(scale for scale, _ in pairs)

    @property
    def offsets(self) -> tuple[float, ...]:
        """Offsets added to samples times `scales`."""
        pairs = self._facts()["scale_offset"] or [(1.0, 0.0)] * self.count
        return tuple(offset for _, offset in pairs)

    @property
    def provenance(self) -> list[str]:
        """The data's provenance, a line per input or operation."""
        return list(self._facts()["provenance"])

    def _by_band(self, name: str) -> tuple[str | None, ...]:
        strings = self._facts()[name] or [""] * self.count
        return tuple(text or None for text in strings)

    # Georeferencing

    @property
    def transform(self) -> Transform:
        """The transform from columns and rows to world coordinates, in rasterio's order; in octrees
        that of x and y of the lowest plane.
        """
        x, y, _ = self._frame
        return Transform(x[0], x[1], x[3], y[0], y[1], y[3])

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """The matrix from cells (x, y, z, 1) to world coordinates, 4 x 4 as in trimesh."""
        return np.array([*self._frame, [0.0, 0.0, 0.0, 1.0]])

    @property
    def res(self) -> tuple[float, float]:
        """The width and height of a cell in world units."""
        a, b, _, d, e, _ = self.transform
        return float(np.hypot(a, d)), float(np.hypot(b, e))

    @property
    def bounds(self) -> BoundingBox | Box:
        """Minimum and maximum world coordinates."""
        low, high = self._world_box
        return BoundingBox(*low[:2], *high[:2]) if self.ndim == 2 else Box(*low, *high)

    def xy(self, row: float, col: float) -> tuple[float, float]:
        """Returns the world coordinates of a cell's centre."""
        a, b, c, d, e, f = self.transform
        col, row = col + 0.5, row + 0.5
        return a * col + b * row + c, d * col + e * row + f

    def index(self, x: float, y: float) -> tuple[int, int]:
        """Returns the row and column of the cell at world coordinates, which may be outside of the
        tree.
        """
        a, b, c, d, e, f = self.transform
        det = a * e - b * d
        if det == 0.0:
            raise ValueError("the file's transform has no inverse")
        col, row = (e * (x - c) - b * (y - f)) / det, (a * (y - f) - d * (x - c)) / det
        return int(np.floor(row)), int(np.floor(col))
