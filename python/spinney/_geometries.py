"""Polygons that other packages have."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any


def documents_of(geometries: Any) -> list[str]:
    """GeoJSON documents of whatever has geometries: one or several polygons each."""
    document = getattr(geometries, "__geo_interface__", geometries)
    if isinstance(document, Mapping):
        # (shapely and others have tuples where GeoJSON has arrays, which JSON does not tell apart.)
        return [json.dumps(document)]
    if isinstance(document, (str, bytes)) or not isinstance(document, Iterable):
        kind = type(geometries).__name__
        raise TypeError(f"geometries: got {kind}, expected polygons with a __geo_interface__, GeoJSON, or a list of these")
    return [part for geometry in document for part in documents_of(geometry)]
