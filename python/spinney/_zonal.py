"""Zonal statistics: polygons that other packages have, and answers by name."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ._types import BandStatistics, ZoneStatistics

STATISTICS: dict[str, Callable[[ZoneStatistics, BandStatistics], Any]] = {
    "count": lambda zone, band: zone.cells,
    "void": lambda zone, band: zone.void_cells,
    "sum": lambda zone, band: band.mean * band.cells if band.cells else 0.0,
    "min": lambda zone, band: band.min,
    "max": lambda zone, band: band.max,
    "mean": lambda zone, band: band.mean,
    "std": lambda zone, band: band.std,
    "classes": lambda zone, band: zone.classes,
}
"""What can be asked for by name: of a polygon, and of its first band."""

NOTHING = BandStatistics(0, float("nan"), float("nan"), float("nan"), float("nan"))


def documents_of(geometries: Any, crs: str | None = None) -> list[tuple[str, str | None, bool]]:
    """Documents of whatever has geometries, one or several polygons each, their coordinate systems, and whether they are files.

    `world` is the system of the tree; nothing is what the document says.
    """
    if isinstance(geometries, (str, os.PathLike)):
        return [(os.fspath(geometries), crs, True)]
    own = getattr(geometries, "crs", None)
    if crs is None and own is not None:
        crs = definition_of(own)
    document = getattr(geometries, "__geo_interface__", geometries)
    if isinstance(document, Mapping):
        if crs is None and ("crs" not in document) and not str(document.get("type", "")).startswith("Feature"):
            crs = "world"
        # (A frame of geometries without a system is a collection of features, but no document of degrees.)
        if crs is None and document is not geometries:
            crs = "world"
        # (shapely and others have tuples where GeoJSON has arrays, which JSON does not tell apart.)
        return [(json.dumps(document, default=str), crs, False)]
    if isinstance(document, bytes) or not isinstance(document, Iterable):
        kind = type(geometries).__name__
        raise TypeError(f"geometries: got {kind}, expected polygons with a __geo_interface__, GeoJSON, a path, or a list of these")
    return [part for geometry in document for part in documents_of(geometry, crs)]


def values_of(where: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """Values of attributes as text; nothing for `None`."""

    def text(value: Any) -> str:
        if isinstance(value, bool):
            return str(value).lower()
        return "" if value is None else str(value)

    return [(name, text(value)) for name, value in (where or {}).items()]


def definition_of(crs: Any) -> str:
    """The definition of a coordinate system of pyproj, or one that is text or a number of the EPSG registry already."""
    if isinstance(crs, int):
        return f"EPSG:{crs}"
    return str(crs.to_wkt()) if hasattr(crs, "to_wkt") else str(crs)


def named(zones: Sequence[ZoneStatistics], stats: Sequence[str]) -> list[dict[str, Any]]:
    """The statistics of these names, of each zone."""
    unknown = [name for name in stats if name not in STATISTICS]
    if isinstance(stats, str) or unknown:
        raise ValueError(f"stats: {unknown or stats!r}, expected a list of {', '.join(STATISTICS)}")
    first = [zone.bands[0] if zone.bands else NOTHING for zone in zones]
    return [{name: STATISTICS[name](zone, band) for name in stats} for zone, band in zip(zones, first)]
