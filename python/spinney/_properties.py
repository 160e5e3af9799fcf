"""Properties of trees: size, meaning, place in the world."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from . import _native
from ._types import BoundingBox, Box, Transform


class Properties(_native.Tree):
    """The part of a dataset that describes it."""

    # Size and meaning

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns; planes first in octrees."""
        return tuple(self._shape_at(None))

    @property
    def ndim(self) -> int:
        """2, or 3 of octrees."""
        return len(self._shape_at(None))

    @property
    def size(self) -> int:
        """Number of cells."""
        size = 1
        for length in self._shape_at(None):
            size *= length
        return size

    @property
    def width(self) -> int:
        """Columns."""
        return self.shape[-1]

    @property
    def height(self) -> int:
        """Rows."""
        return self.shape[-2]

    @property
    def indexes(self) -> tuple[int, ...]:
        """Numbers of the bands."""
        return tuple(range(1, self.count + 1))

    @property
    def dtypes(self) -> tuple[str, ...]:
        """The type of each band, by name."""
        return (self.dtype.name,) * self.count

    @property
    def levels(self) -> int:
        """Number of levels: 0 is one cell for everything, `depth` are the cells."""
        return self.depth + 1

    @property
    def kind(self) -> str:
        """`"categorical"` (classes) or `"continuous"` (amounts)."""
        return str(self._facts()["kind"])

    @property
    def rule(self) -> str:
        """How one value stands for many at coarser levels: mean, majority, ..."""
        return str(self._facts()["rule"])

    @property
    def format(self) -> str:
        """`"Goblin"` or `"Autumnal"`."""
        return str(self._facts()["format"])

    @property
    def file_size(self) -> int:
        """Bytes of the file."""
        return int(self._facts()["file_size"])

    @property
    def tags(self) -> dict[str, str]:
        """Anything else that is told of the data."""
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
        """Units of the bands, of what scales and offsets make."""
        return self._by_band("units")

    @property
    def scales(self) -> tuple[float, ...]:
        """Factors that make physical units of samples."""
        pairs = self._facts()["scale_offset"] or [(1.0, 0.0)] * self.count
        return tuple(scale for scale, _ in pairs)

    @property
    def offsets(self) -> tuple[float, ...]:
        """What is added to samples times `scales`."""
        pairs = self._facts()["scale_offset"] or [(1.0, 0.0)] * self.count
        return tuple(offset for _, offset in pairs)

    @property
    def provenance(self) -> list[str]:
        """Where the data came from, a line per input or operation."""
        return list(self._facts()["provenance"])

    def _by_band(self, name: str) -> tuple[str | None, ...]:
        texts = self._facts()[name] or [""] * self.count
        return tuple(text or None for text in texts)

    # Place in the world

    @property
    def transform(self) -> Transform:
        """From columns and rows to the world, in rasterio's order; of octrees x and y of the lowest plane."""
        x, y, _ = self._frame
        return Transform(x[0], x[1], x[3], y[0], y[1], y[3])

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """From cells x, y, z, 1 to the world, 4 x 4 as trimesh has it."""
        return np.array([*self._frame, [0.0, 0.0, 0.0, 1.0]])

    @property
    def res(self) -> tuple[float, float]:
        """Width and height of a cell in the world."""
        a, b, _, d, e, _ = self.transform
        return float(np.hypot(a, d)), float(np.hypot(b, e))

    @property
    def bounds(self) -> BoundingBox | Box:
        """Least and greatest coordinates in the world."""
        low, high = self._world_box
        return BoundingBox(*low[:2], *high[:2]) if self.ndim == 2 else Box(*low, *high)

    def xy(self, row: float, col: float) -> tuple[float, float]:
        """The world coordinates of a cell's centre."""
        a, b, c, d, e, f = self.transform
        col, row = col + 0.5, row + 0.5
        return a * col + b * row + c, d * col + e * row + f

    def index(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell at a place in the world; there may be no such cell."""
        a, b, c, d, e, f = self.transform
        det = a * e - b * d
        if det == 0.0:
            raise ValueError("the file's transform has no inverse")
        col, row = (e * (x - c) - b * (y - f)) / det, (a * (y - f) - d * (x - c)) / det
        return int(np.floor(row)), int(np.floor(col))
