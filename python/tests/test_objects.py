"""Objects of exact models: selected, left out, repaired by a rule, measured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import spinney

SIDES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


@pytest.fixture
def street(tmp_path: Path) -> Path:
    """A cube, an open one, an inverted one, and one that half overlaps the first."""
    lines = []
    for number, (name, x) in enumerate([("right", 0), ("open", 20), ("turned", 40), ("half", 5)]):
        lines.append(f"o {name}")
        lines += [f"v {x + 10 * (i & 1)} {10 * (i >> 1 & 1)} {10 * (i >> 2)}" for i in range(8)]
        for side in SIDES[: 5 if name == "open" else 6]:
            corners = [str(8 * number + corner + 1) for corner in (side[::-1] if name == "turned" else side)]
            lines.append(f"f {' '.join(corners)}")
    path = tmp_path / "street.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_objects_are_chosen_and_left_out(street: Path, tmp_path: Path) -> None:
    out = tmp_path / "street.goblin"
    with pytest.raises(ValueError, match="of open"):
        spinney.build_brep(street, out)
    built = spinney.build_brep(street, out, repair=True, skip_bad=True)
    assert [name for name, _ in built.skipped] == ["open"] and "4 edges" in built.skipped[0][1]
    assert built.turned_bodies == 1
    with spinney.open_brep(out) as model:
        assert model.volume == 2500.0
        assert [row["name"] for row in model.objects()] == ["right", "turned", "half"]
    built = spinney.build_brep(street, out, where="id=right")
    assert built.skipped == [] and built.faces == 6
    with spinney.open_brep(out) as model:
        row = model.objects()[0]
        assert (row["closed"], row["volume"], row["area"]) == (True, 1000.0, 600.0)


def test_rules_are_named(street: Path, tmp_path: Path) -> None:
    out = tmp_path / "street.goblin"
    for rule, volume in [("nonzero", 3500.0), ("positive", 3500.0)]:
        spinney.build_brep(street, out, repair=True, close=True, inside=rule)  # type: ignore[arg-type]
        with spinney.open_brep(out) as model:
            assert model.volume == volume
    with pytest.warns(UserWarning, match="percent from that of cells"):
        spinney.build_brep(street, out, repair=True, close=True, inside="odd")
    with spinney.open_brep(out) as model:
        assert model.volume == 3000.0
    with pytest.raises(ValueError, match="nonzero, positive or odd"):
        spinney.build_brep(street, out, repair=True, close=True, inside="even")  # type: ignore[arg-type]


def test_objects_meet(street: Path, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="1 objects are open and were left out: open"):
        found = spinney.object_contacts(street)
    assert [(pair.kind, pair.names, pair.parts, pair.volume) for pair in found] == [("overlap", ("right", "half"), (0, 3), 500.0)]
    with pytest.raises(TypeError, match="mesh file"):
        spinney.object_contacts(3)  # type: ignore[arg-type]
    with pytest.warns(UserWarning, match="left out: open"):
        (coarse,) = spinney.object_contacts(street, snap=4)
    assert (coarse.names, coarse.volume) == (("right", "half"), 256.0)
    lines = []
    for number, (name, x) in enumerate([("left", 0), ("leaning", 10), ("far", 30)]):
        lines.append(f"o {name}")
        lines += [f"v {x + 10 * (i & 1)} {10 * (i >> 1 & 1)} {10 * (i >> 2)}" for i in range(8)]
        lines += [f"f {' '.join(str(8 * number + corner + 1) for corner in side)}" for side in SIDES]
    (tmp_path / "row.obj").write_text("\n".join(lines) + "\n")
    spinney.build_brep(tmp_path / "row.obj", tmp_path / "row.goblin")
    with spinney.open_brep(tmp_path / "row.goblin") as model:
        (pair,) = model.contacts()
        assert (pair.kind, pair.names, pair.volume, pair.area) == ("touch", ("left", "leaning"), 0.0, 100.0)
        assert pair.place[0] == 10.0 and spinney.object_contacts(tmp_path / "row.obj") == [pair]
        row = model.find_object("leaning")
        assert (row["part"], row["volume"], row["bounds"]) == (1, 1000.0, spinney.Box(10, 0, 0, 20, 10, 10))
        with pytest.raises(KeyError, match="has no object 'lean'; similar names are leaning"):
            model.find_object("lean")


def test_faces_have_values(tmp_path: Path) -> None:
    surfaces = [[[4, 5, 7, 6]], *([side] for side in SIDES if side != [4, 5, 7, 6])]
    semantics = {"surfaces": [{"type": "RoofSurface", "slope": 0.5}, {"type": "WallSurface"}], "values": [[0, 1, 1, None, 1, 1]]}
    solid = {"type": "Solid", "lod": "2", "boundaries": [surfaces], "semantics": semantics}
    city = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [1, 1, 1], "translate": [0, 0, 0]},
        "CityObjects": {"house": {"type": "Building", "geometry": [solid]}},
        "vertices": [[i & 1, i >> 1 & 1, i >> 2] for i in range(8)],
    }
    (tmp_path / "a.city.json").write_text(json.dumps(city))
    spinney.build_brep(tmp_path / "a.city.json", tmp_path / "a.goblin")
    with spinney.open_brep(tmp_path / "a.goblin") as model:
        assert sorted(model.face_columns) == ["attributes", "surface", "type"]
        wall = "WallSurface"
        assert model.face_values("type") == {0: "RoofSurface", 1: wall, 2: wall, 4: wall, 5: wall}
        assert model.face_values("attributes") == {0: {"slope": 0.5}}
        with pytest.raises(KeyError, match="there are surface, type"):
            model.face_values("material")
        model.export(tmp_path / "b.city.json")
    written = json.loads((tmp_path / "b.city.json").read_text())
    assert written["CityObjects"]["house"]["geometry"][0]["semantics"] == semantics
