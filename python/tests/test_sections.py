"""Sections of exact models, legends, and updates of tiles, compared with the program's."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conftest import BOX, FIXTURES, run

import spinney

def box(path: Path, move: tuple[float, float, float] = (0, 0, 0)) -> Path:
    """Builds an exact model of a translated box."""
    vertices, triangles = BOX
    spinney.build_brep((vertices + move, triangles), path, snap=0.5)
    return path


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return box(tmp_path / "box.goblin")


def features(path: Path) -> list[dict]:
    return json.loads(path.read_text())["features"]


def test_planes_cut_a_box(model: Path, tmp_path: Path) -> None:
    with spinney.open_brep(model) as opened:
        made = opened.section(tmp_path / "one.geojson", "y=1.25")
        assert made == spinney.Section(planes=1, polygons=1, area=8.0)
        (feature,) = features(tmp_path / "one.geojson")
        assert feature["properties"] == {"plane": "y", "at": 1.25, "area": 8}
        assert {point[1] for point in feature["geometry"]["coordinates"][0]} == {1.25}
        # In the plane: z and x.
        opened.section(tmp_path / "flat.geojson", "y=1.25", flat=True)
        (feature,) = features(tmp_path / "flat.geojson")
        assert {tuple(point) for point in feature["geometry"]["coordinates"][0]} >= {(0, 0), (4, 0), (4, 2), (0, 2)}
        many = opened.section(tmp_path / "many.csv", ["z=0.2..3.8/0.2", "plane=1,1,1,3", "x=9"])
        assert (many.planes, many.polygons) == (21, 20)
        assert many.area == pytest.approx(19 * 6 + opened.section(tmp_path / "slant.csv", "plane=1,1,1,3").area)


@pytest.mark.parametrize("ending", ["geojson", "csv", "svg", "ply", "obj", "shp"])
def test_sections_are_those_of_the_program(program: str, model: Path, tmp_path: Path, ending: str) -> None:
    ours, theirs = tmp_path / f"a.{ending}", tmp_path / f"b.{ending}"
    with spinney.open_brep(model) as opened:
        opened.section(ours, ["z=0..4/0.5", "x=1"])
    run(program, "section", model, "z=0..4/0.5", "x=1", "-o", theirs)
    assert ours.read_bytes() == theirs.read_bytes()


def test_intersections_of_two_models(program: str, model: Path, tmp_path: Path) -> None:
    other = box(tmp_path / "other.goblin", (1, 1, 1))
    adjacent = box(tmp_path / "adjacent.goblin", (2, 0, 0))
    with spinney.open_brep(model) as a, spinney.open_brep(other) as b:
        made = a.section(tmp_path / "lines.geojson", b)
        assert (made.crossings, made.touches, made.overlaps, made.points) == (1, 0, 0, 0)
        assert made.crossing_length == pytest.approx(2 * (1 + 2 + 3))
        run(program, "section", model, other, "-o", tmp_path / "theirs.geojson")
        assert (tmp_path / "lines.geojson").read_bytes() == (tmp_path / "theirs.geojson").read_bytes()
        kinds = {feature["properties"]["kind"] for feature in features(tmp_path / "lines.geojson")}
        assert kinds == {"crossing"}
        # (By its name, and a model that touches its wall.)
        assert a.section(tmp_path / "again.csv", other) == made
        wall = a.section(tmp_path / "wall.csv", adjacent)
        assert (wall.crossings, wall.overlaps, wall.overlap_area) == (0, 1, 12)


def test_invalid_sections_are_rejected(model: Path, tmp_path: Path) -> None:
    never = tmp_path / "never.csv"
    with spinney.open_brep(model) as opened:
        for planes in ("z", "z=", "w=1", "z=0..1", "z=0..1/0", "plane=1,2,3"):
            with pytest.raises(ValueError, match="planes: got .*expected"):
                opened.section(never, planes)
        with pytest.raises(ValueError, match="normal"):
            opened.section(never, "plane=0,0,0,1")
        with pytest.raises(ValueError, match="give it as a Path"):
            opened.section(never, str(model))
        with pytest.raises(ValueError, match="one other model"):
            opened.section(never, [opened, "z=1"])  # type: ignore[list-item]
        with pytest.raises(ValueError, match="flat"):
            opened.section(never, opened, flat=True)  # type: ignore[call-overload]
        with pytest.raises(ValueError, match="expected planes"):
            opened.section(never, [])
        with pytest.raises(ValueError, match="unknown format"):
            opened.section(tmp_path / "never.txt", "z=1")
        with pytest.raises(ValueError, match="is an input and the output"):
            opened.section(model, "z=1")
        with pytest.raises(OSError, match="are allowed"):
            opened.section(never, "z=0..4/0.001", max_bytes="4k")
    assert not never.exists()


def test_legends_are_those_of_the_program(program: str, relief: str, island: str, tmp_path: Path) -> None:
    with spinney.open(relief) as ds:
        ds.legend(tmp_path / "a.png", "terrain", scale=3)
        ds.legend(tmp_path / "a.json", {"draw": "ramp", "ramp": "viridis", "domain": [0, 100]})
    run(program, "legend", relief, "-o", tmp_path / "b.png", "--style", "terrain", "--scale", "3")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert json.loads((tmp_path / "a.json").read_text())
    with spinney.open(island) as ds:
        ds.legend(tmp_path / "own.svg")
        for name in ds.categories.values():
            assert name in (tmp_path / "own.svg").read_text()
        for scale in (0, 9):
            with pytest.raises(ValueError, match="scale"):
                ds.legend(tmp_path / "never.png", scale=scale)
        with pytest.raises(ValueError, match="unknown format"):
            ds.legend(tmp_path / "never.txt")
        with pytest.raises(ValueError, match="nothing"):
            ds.legend(tmp_path / "never.png", "nothing")
    assert not list(tmp_path.glob("never*"))


@pytest.fixture
def edited(tmp_path: Path) -> Path:
    """A map, its tiles, and a later edit."""
    path = tmp_path / "map.autumn"
    spinney.build(FIXTURES / "island_classes.tif", path)
    with spinney.open(path) as ds:
        ds.export(tmp_path / "map.pmtiles")
    with spinney.edit(path) as edit:
        edit.fill(3, window=(64, 64, 30, 20))
    return path


def test_tiles_are_updated(program: str, edited: Path, tmp_path: Path) -> None:
    tiles, redrawn = tmp_path / "map.pmtiles", tmp_path / "redrawn.pmtiles"
    before = tiles.read_bytes()
    with spinney.open(edited) as ds:
        count = ds.export(redrawn)
        # Another archive, from the old one.
        assert ds.export(tmp_path / "copy.pmtiles", update=tiles) == count
        assert (tmp_path / "copy.pmtiles").read_bytes() == redrawn.read_bytes() and tiles.read_bytes() == before
        ds.export(tiles, update=True)
    assert tiles.read_bytes() == redrawn.read_bytes() != before
    run(program, "export", edited, "-o", tmp_path / "theirs.pmtiles", "--update", tmp_path / "copy.pmtiles")
    assert (tmp_path / "theirs.pmtiles").read_bytes() == redrawn.read_bytes()


def test_tiles_of_another_file_and_style(edited: Path, tmp_path: Path) -> None:
    tiles = tmp_path / "map.pmtiles"
    other = tmp_path / "other.goblin"
    spinney.convert(edited, other)
    with spinney.open(other) as ds:
        with pytest.raises(ValueError, match="made it|made of|commits"):
            ds.export(tiles, update=True)
        ds.export(tiles, update=True, since=f"{edited}@1")
        ds.export(tmp_path / "redrawn.pmtiles")
        assert tiles.read_bytes() == (tmp_path / "redrawn.pmtiles").read_bytes()
        with pytest.raises(ValueError, match="style"):
            ds.export(tiles, update=True, style="grey")
        ds.export(tiles, update=True, style="grey", restyle=True)
        ds.export(tmp_path / "grey.pmtiles", style="grey")
        assert tiles.read_bytes() == (tmp_path / "grey.pmtiles").read_bytes()
        with pytest.raises(ValueError, match="for an update"):
            ds.export(tiles, restyle=True)
        with pytest.raises(ValueError, match="expected one of them"):
            ds.export(tiles, update=True, resume=True)
        with pytest.raises(TypeError, match="update"):
            ds.export(tmp_path / "never.tif", update=True)
    with spinney.open(other, view="window=0,0,128,128") as view, pytest.raises(ValueError, match="view"):
        view.export(tiles, update=True)
