"""Answers about the surfaces of exact models: their shells, and where rays pass through them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class SurfaceHits:
    """Where rays meet a surface, one per row of the arrays."""

    distance: npt.NDArray[np.float64]
    """Lengths of the direction; NaN where nothing is hit."""
    points: npt.NDArray[np.float64]
    """Coordinates in the world; NaN where nothing is hit."""
    faces: npt.NDArray[np.int64]
    """Numbers of the faces; -1 where nothing is hit."""
    parts: npt.NDArray[np.int64]
    """Numbers of the parts to which they belong; -1 where nothing is hit."""
    entering: npt.NDArray[np.bool_]
    """Whether the ray comes from outside."""

    @property
    def hit(self) -> npt.NDArray[np.bool_]:
        """Whether each ray hits anything."""
        return ~np.isnan(self.distance)


@dataclass(frozen=True, eq=False)
class RayCrossings:
    """Places where rays pass through a surface, one per row of the arrays; those of a ray follow each other."""

    rays: npt.NDArray[np.int64]
    """Numbers of the rays, ascending."""
    distance: npt.NDArray[np.float64]
    """Lengths of the direction."""
    points: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int64]
    parts: npt.NDArray[np.int64]
    entering: npt.NDArray[np.bool_]
    """Whether the ray comes from outside."""


@dataclass(frozen=True, eq=False)
class Shells:
    """Surfaces that hang together, one per row of the arrays, in the order of their first faces."""

    vertices: npt.NDArray[np.int64]
    edges: npt.NDArray[np.int64]
    faces: npt.NDArray[np.int64]
    inner_rings: npt.NDArray[np.int64]
    """Rings beside the first of each face."""
    boundaries: npt.NDArray[np.int64]
    """0 of closed ones."""
    genus: npt.NDArray[np.int64]
    """Handles; -1 where that is no number."""
    volume: npt.NDArray[np.float64]
    """Volume that each encloses, rounded once; negative of cavities."""
    of_faces: npt.NDArray[np.int64]
    """For each face of the model the number of its shell."""

    def __len__(self) -> int:
        return len(self.volume)

    @property
    def bodies(self) -> int:
        """How many of them are the outsides of bodies, and not cavities."""
        return int(np.count_nonzero(self.volume > 0))
