"""Set operations of polygons of files and objects."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import spinney


def square(west: float, south: float, side: float) -> dict[str, Any]:
    east, north = west + side, south + side
    ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    return {"type": "Polygon", "coordinates": [ring]}


def collection(**squares: tuple[float, float, float]) -> dict[str, Any]:
    features = [{"type": "Feature", "properties": {"name": name}, "geometry": square(*at)} for name, at in squares.items()]
    return {"type": "FeatureCollection", "features": features}


class Frame:
    """A minimal GeoDataFrame."""

    def __init__(self, document: dict[str, Any], crs: str) -> None:
        self.__geo_interface__ = document
        self.crs = crs


def test_polygons_are_combined(tmp_path: Path) -> None:
    first = tmp_path / "a.geojson"
    first.write_text(json.dumps(collection(a=(0, 0, 4), b=(4, 0, 4))))
    second = collection(x=(2, 1, 4))
    out = tmp_path / "c.geojson"
    made = spinney.combine("and", [first, second], out)
    assert isinstance(made, spinney.CombinedPolygons)
    assert (made.features, made.polygons, made.area, made.shared) == (2, 2, 4.0 * 3, 0)
    found = json.loads(out.read_text())["features"]
    assert [feature["properties"] for feature in found] == [{"name_1": "a", "name_2": "x"}, {"name_1": "b", "name_2": "x"}]
    made = spinney.combine("and", [first, second], out, where="name!=b")
    assert isinstance(made, spinney.CombinedPolygons) and (made.features, made.area) == (1, 6.0)
    made = spinney.combine("nor", [first, second], out, within=[-1, -1, 9, 6])
    assert isinstance(made, spinney.CombinedPolygons) and made.area == 10 * 7 - 32 - 4
    made = spinney.combine("partition", [first, second], out, snap=0.5, within=first)
    assert isinstance(made, spinney.CombinedPolygons) and (made.area, made.cell) == (32.0, 0.5)
    # An object has its own coordinate system, and the result is in that of the first.
    made = spinney.combine("union", [Frame(second, "EPSG:25832")], tmp_path / "d.gpkg")
    assert isinstance(made, spinney.CombinedPolygons) and made.area == 16
    with pytest.raises(ValueError, match="region"):
        spinney.combine("nor", [first, second], out)
    with pytest.raises(ValueError, match="expected one for polygons"):
        spinney.combine("over", [first, second], out)
    with pytest.raises(ValueError, match="edge: not for polygons"):
        spinney.combine("and", [first, second], out, edge="touch")
    with pytest.raises(ValueError, match="out: expected"):
        spinney.combine("and", [first, second], tmp_path / "c.tif")
