"""Query results for surfaces of exact models: shells, and crossings with rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class SurfaceHits:
    """First hits of rays on a surface, one per row of the arrays."""

    distance: npt.NDArray[np.float64]
    """Distance in units of the direction's length; NaN without a hit."""
    points: npt.NDArray[np.float64]
    """World coordinates; NaN without a hit."""
    faces: npt.NDArray[np.int64]
    """Numbers of the faces; -1 without a hit."""
    parts: npt.NDArray[np.int64]
    """Numbers of the faces' parts; -1 without a hit."""
    entering: npt.NDArray[np.bool_]
    """Whether the ray arrives from outside."""

    @property
    def hit(self) -> npt.NDArray[np.bool_]:
        """Whether each ray hits anything."""
        return ~np.isnan(self.distance)


@dataclass(frozen=True, eq=False)
class RayCrossings:
    """Crossings of rays with a surface, one per row of the arrays, sorted by ray."""

    rays: npt.NDArray[np.int64]
    """Numbers of the rays, ascending."""
    distance: npt.NDArray[np.float64]
    """Distance in units of the direction's length."""
    points: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int64]
    parts: npt.NDArray[np.int64]
    entering: npt.NDArray[np.bool_]
    """Whether the ray arrives from outside."""


@dataclass(frozen=True, eq=False)
class Shells:
    """Connected surfaces, one per row of the arrays, in the order of their first faces."""

    vertices: npt.NDArray[np.int64]
    edges: npt.NDArray[np.int64]
    faces: npt.NDArray[np.int64]
    inner_rings: npt.NDArray[np.int64]
    """The number of inner rings of faces."""
    boundaries: npt.NDArray[np.int64]
    """The number of boundaries: 0 for closed surfaces."""
    genus: npt.NDArray[np.int64]
    """The number of handles; -1 if that is not an integer."""
    volume: npt.NDArray[np.float64]
    """Enclosed volume, rounded once; negative for cavities."""
    of_faces: npt.NDArray[np.int64]
    """The shell number of each face of the model."""

    def __len__(self) -> int:
        return len(self.volume)

    @property
    def bodies(self) -> int:
        """The number of shells that are the outsides of bodies, not cavities."""
        return int(np.count_nonzero(self.volume > 0))
