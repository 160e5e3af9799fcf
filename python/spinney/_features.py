"""Features rasterized to the cells of trees."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import numpy as np

from . import _native
from ._remote import is_path, path_of
from ._types import Path
from ._zonal import documents_of, values_of

Edge = Literal["centre", "touch", "area"]
Overlaps = Literal["last", "first", "min", "max", "sum", "count", "mean"]


def is_features(source: Any) -> bool:
    """Returns whether a source is features, or a file with the name of a feature file, and not a
    tree.
    """
    if is_path(source):
        return bool(_native.is_feature_file(path_of(source)))
    return hasattr(source, "__geo_interface__") or isinstance(source, Mapping)


@contextmanager
def features_over(
    source: Any,
    *,
    coordinates: Any = None,
    where: Mapping[str, Any] | str | None = None,
    edge: str | None = None,
    value: float | str | Sequence[float] | None = None,
    overlaps: str | None = None,
    has_own_system: bool = False,
) -> Iterator[dict[str, Any]]:
    """Yields the native module's description of features: an unchanged path, or a temporary GeoJSON
    file for all other sources.

    With `has_own_system` the file itself specifies the coordinate system.
    """
    conditions = where if isinstance(where, str | None) else ",".join(f"{name}={text}" for name, text in values_of(where))
    strings = None
    if value is not None:
        strings = [value] if isinstance(value, str) else [str(number) for number in np.atleast_1d(np.asarray(value, dtype=object))]
    description = {"coordinates": coordinates, "where": conditions or None, "edge": edge, "value": strings, "overlaps": overlaps}
    if is_path(source):
        yield description | {"path": path_of(source)}
        return
    documents = documents_of(source)
    if not documents:
        raise ValueError("features: got none, expected at least one")
    systems = {crs for _, crs, _ in documents}
    if any(is_file for _, _, is_file in documents) or len(systems) > 1:
        raise ValueError("features: expected one path, or geometries of one coordinate system")
    (crs,) = systems
    document = documents[0][0] if len(documents) == 1 else json.dumps(_collection([text for text, _, _ in documents]))
    if has_own_system and crs is not None:
        named = {"type": "name", "properties": {"name": crs}}
        document = json.dumps(_collection([document]) | {"crs": named})
        crs = None
    # (The file is closed before it is read, as some systems require.)
    with tempfile.TemporaryDirectory(prefix="spinney-") as directory:
        path = os.path.join(directory, "features.geojson")
        with open(path, "w", encoding="utf-8") as file:
            file.write(document)
        yield description | {"path": path, "coordinates": crs if coordinates is None else coordinates}


def _collection(documents: Sequence[str]) -> dict[str, Any]:
    """Returns one collection of the features and geometries of several documents."""
    features: list[Any] = []
    for text in documents:
        document = json.loads(text)
        match document.get("type"):
            case "FeatureCollection":
                features += document["features"]
            case "Feature":
                features.append(document)
            case _:
                features.append({"type": "Feature", "properties": {}, "geometry": document})
    return {"type": "FeatureCollection", "features": features}


def divided(operands: Sequence[Any]) -> tuple[list[Path], list[tuple[int, Any]]]:
    """Returns the trees among operands, and the features with their indices among all."""
    features = [(place, operand) for place, operand in enumerate(operands) if is_features(operand)]
    positions = {place for place, _ in features}
    return [operand for place, operand in enumerate(operands) if place not in positions], features
