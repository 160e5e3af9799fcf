"""Zonal statistics: polygons from other packages, and measures by name."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ._remote import is_path, path_of
from ._types import ZoneBand, ZoneStatistics, ZoneValues

MEASURES: dict[str, Callable[[ZoneStatistics, ZoneBand], Any]] = {
    "count": lambda zone, band: zone.cells,
    "void": lambda zone, band: zone.void_cells,
    "void_share": lambda zone, band: zone.void_share,
    "outside": lambda zone, band: zone.outside_cells,
    "sum": lambda zone, band: band.sum,
    "min": lambda zone, band: band.min,
    "max": lambda zone, band: band.max,
    "mean": lambda zone, band: band.mean,
    "std": lambda zone, band: band.std,
    "majority": lambda zone, band: _of(band).majority,
    "minority": lambda zone, band: _of(band).minority,
    "variety": lambda zone, band: _of(band).variety,
    "median": lambda zone, band: _of(band).median,
    "classes": lambda zone, band: zone.classes,
}
"""Measures by name, from a polygon and its first band."""

NAN = float("nan")
NOTHING = ZoneBand(0, NAN, NAN, NAN, NAN)
NO_VALUES = ZoneValues(0, NAN, NAN, NAN, {})


def _of(band: ZoneBand) -> ZoneValues:
    return band.values or NO_VALUES


def documents_of(geometries: Any, crs: str | None = None) -> list[tuple[str, str | None, bool]]:
    """Returns documents of geometries, with one or several polygons each, their coordinate systems,
    and whether they are files.

    `world` is the system of the tree; `None` is that of the document.
    """
    if is_path(geometries):
        return [(path_of(geometries), crs, True)]
    own = getattr(geometries, "crs", None)
    if crs is None and own is not None:
        crs = definition_of(own)
    document = getattr(geometries, "__geo_interface__", geometries)
    if isinstance(document, Mapping):
        if crs is None and ("crs" not in document) and not str(document.get("type", "")).startswith("Feature"):
            crs = "world"
        # (A GeoDataFrame without a coordinate system is a feature collection, but not one in
        # degrees.)
        if crs is None and document is not geometries:
            crs = "world"
        # (shapely and others have tuples where GeoJSON has arrays; JSON does not distinguish them.)
        return [(json.dumps(document, default=str), crs, False)]
    if isinstance(document, bytes) or not isinstance(document, Iterable):
        kind = type(geometries).__name__
        raise TypeError(f"geometries: got {kind}, expected polygons with a __geo_interface__, GeoJSON, a path, or a list of these")
    return [part for geometry in document for part in documents_of(geometry, crs)]


def values_of(where: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """Returns values of attributes as strings; nothing for `None`."""

    def text(value: Any) -> str:
        if isinstance(value, bool):
            return str(value).lower()
        return "" if value is None else str(value)

    return [(name, text(value)) for name, value in (where or {}).items()]


def definition_of(crs: Any) -> str:
    """Returns the definition of a coordinate system: of a pyproj object, a string, or an EPSG
    number.
    """
    if isinstance(crs, int):
        return f"EPSG:{crs}"
    return str(crs.to_wkt()) if hasattr(crs, "to_wkt") else str(crs)


def measures_of(measures: str | Iterable[str] | None, quantiles: float | Sequence[float]) -> tuple[list[str], list[float]]:
    """Checks names of measures, and quantiles; several names in a string are separated by blanks or
    commas.
    """
    names = re.findall(r"[^\s,]+", measures) if isinstance(measures, str) else [str(name) for name in measures or ()]
    if unknown := [name for name in names if name not in MEASURES]:
        raise ValueError(f"measures: got {', '.join(unknown)}, expected names among {', '.join(MEASURES)}")
    return names, [float(quantile) for quantile in np.atleast_1d(np.asarray(quantiles, dtype=float))]


def column_of(quantile: float) -> str:
    """Returns the name of a quantile: `q2.5` is that of 0.025."""
    return f"q{round(quantile * 100, 6):g}"


def named(zones: Sequence[ZoneStatistics], measures: Sequence[str], quantiles: Sequence[float]) -> list[dict[str, Any]]:
    """Returns the named measures, and quantiles, of each zone."""

    def row_of(zone: ZoneStatistics) -> dict[str, Any]:
        band = zone.bands[0] if zone.bands else NOTHING
        found = {name: MEASURES[name](zone, band) for name in measures}
        return found | {column_of(quantile): _of(band).quantiles.get(quantile, NAN) for quantile in quantiles}

    return [row_of(zone) for zone in zones]


def zone_of(raw: Any, quantiles: Sequence[float]) -> ZoneStatistics:
    """Converts the statistics of a zone from the native module."""
    (cells, void, outside), bands, classes = raw

    def band_of(cells: float, low: float, high: float, mean: float, std: float, total: float, values: Any) -> ZoneBand:
        if values is not None:
            variety, majority, minority, median, found = values
            values = ZoneValues(variety, majority, minority, median, dict(zip(quantiles, found)))
        return ZoneBand(cells, low, high, mean, std, total, values)  # type: ignore[arg-type]

    return ZoneStatistics(cells, void, tuple(band_of(*band) for band in bands), dict(classes), outside)


def usual_of(zones: Sequence[ZoneStatistics]) -> list[str]:
    """Returns the default measures of a table."""
    if any(zone.classes for zone in zones):
        return ["count", "void", "classes"]
    return ["count", "void", "sum", "min", "max", "mean", "std"]


def is_frame(geometries: Any) -> bool:
    """Returns whether an object is a data frame of geometries, with a table's index."""
    return hasattr(geometries, "__geo_interface__") and hasattr(geometries, "index") and hasattr(geometries, "iloc")


def table_of(frame: Any, zones: Sequence[Any], names: Sequence[str], quantiles: Sequence[float]) -> Any:
    """Returns a pandas DataFrame of zones, or of measures if there are names of these, with the
    index of a frame and a column for each measure and quantile; the cells of each class have their
    own column. A frame without rows has the columns, but none of classes.
    """
    import pandas  # type: ignore[import-untyped]

    measures = list(names) or usual_of(zones)
    rows: Sequence[dict[str, Any]] = zones if names else named(zones, measures, quantiles)
    classes = sorted({value for row in rows for value in row.get("classes", ())})

    def flat(row: dict[str, Any]) -> dict[str, Any]:
        cells = row.get("classes")
        plain = {name: value for name, value in row.items() if name != "classes"}
        return plain if cells is None else plain | {f"cells_{value:g}": cells.get(value, 0.0) for value in classes}

    if not rows:
        columns = [*(name for name in measures if name != "classes"), *map(column_of, quantiles)]
        return pandas.DataFrame(index=frame.index, columns=columns, dtype=float)
    return pandas.DataFrame([flat(row) for row in rows], index=frame.index)
