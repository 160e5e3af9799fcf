"""Exact models of meshes in memory: arrays, trimesh meshes and scenes, faces of exact models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from conftest import BOX

import spinney

VERTICES, TRIANGLES = BOX
ENDS_AND_WALLS = [0] * 4 + [1] * 8


def colours_by_vertex(model: spinney.ExactModel) -> dict[tuple[float, ...], tuple[int, ...]]:
    """Returns the colour of each vertex, which is that of all its corners."""
    faces = model.faces()
    assert faces.colours is not None
    found: dict[tuple[float, ...], tuple[int, ...]] = {}
    for corner, colour in zip(faces.corners, faces.colours):
        at, rgb = tuple(faces.vertices[corner].tolist()), tuple(colour.tolist())
        assert found.setdefault(at, rgb) == rgb
    return found


def test_arrays_have_colours_parts_and_attributes(tmp_path: Path) -> None:
    reds = np.array([[20 * vertex, 7, 200] for vertex in range(8)])
    spinney.build_brep(
        BOX, tmp_path / "m.goblin", colours=reds, parts=ENDS_AND_WALLS, names=["ends", "walls"],
        attributes={"walls": {"height": np.float64(4.5), "kinds": np.array([1, 2])}},
    )
    with spinney.open_brep(tmp_path / "m.goblin") as model:
        assert model.volume == 24.0 and model.parts == ["ends", "walls"]
        assert model.faces().parts.tolist() == ENDS_AND_WALLS
        assert colours_by_vertex(model) == {tuple(at.tolist()): tuple(red.tolist()) for at, red in zip(VERTICES, reds)}
        rows = model.objects()
        assert "attributes" not in rows[0] and rows[1]["attributes"] == {"height": 4.5, "kinds": [1, 2]}
        assert [row["area"] for row in rows] == [12.0, 40.0]
    # Without names, and of a mesh that is a single part.
    spinney.build_brep(BOX, tmp_path / "m.goblin", parts=np.array(ENDS_AND_WALLS, dtype="u1"), attributes=[None, {"a": 1}])
    assert spinney.open_brep(tmp_path / "m.goblin").parts == ["0", "1"]
    spinney.build_brep(BOX, tmp_path / "m.goblin", names=["box"], attributes=[{"a": None}])
    with spinney.open_brep(tmp_path / "m.goblin") as model:
        assert model.parts == ["box"] and model.objects()[0]["attributes"] == {"a": None} and model.faces().colours is None


def test_meshes_of_trimesh_keep_names_and_colours(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    ball.metadata["name"] = "ball"
    ball.visual.vertex_colors = np.random.default_rng(1).integers(0, 255, (len(ball.vertices), 4)) | [0, 0, 0, 255]
    ball.units = "meters"
    spinney.build_brep(ball, tmp_path / "ball.goblin", snap=1 / 1024)
    with spinney.open_brep(tmp_path / "ball.goblin") as model:
        assert model.parts == ["ball"] and model.unit == "m"
        again = trimesh.Trimesh(*model.triangles(), process=False)
        assert again.is_watertight and np.isclose(again.volume, ball.volume, rtol=1e-3) and model.volume == pytest.approx(again.volume)
        # (Vertices are snapped to a grid that starts at its origin.)
        steps = np.round((ball.vertices - model.origin) * 1024) / 1024 + model.origin
        expected = {tuple(at): tuple(colour[:3]) for at, colour in zip(steps.tolist(), ball.visual.vertex_colors.tolist())}
        assert colours_by_vertex(model) == expected
    ball.visual.face_colors = [[1, 2, 3, 255]] * len(ball.faces)
    spinney.build_brep(ball, tmp_path / "ball.goblin")
    assert set(colours_by_vertex(spinney.open_brep(tmp_path / "ball.goblin")).values()) == {(1, 2, 3)}
    ball.visual.face_colors = [[1, 2, 3, 99]] * len(ball.faces)
    with pytest.warns(UserWarning, match="opacity"):
        spinney.build_brep(ball, tmp_path / "ball.goblin")


def test_scenes_and_several_meshes_become_parts(tmp_path: Path) -> None:
    block = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    block.visual.vertex_colors = [[9, 8, 7, 255]] * 8
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirrored[0, 3] = 10.0
    scene = trimesh.Scene()
    scene.add_geometry(block, node_name="here", geom_name="block")
    scene.add_geometry(block, node_name="there", geom_name="block", transform=mirrored)
    spinney.build_brep(scene, tmp_path / "scene.goblin")
    with spinney.open_brep(tmp_path / "scene.goblin") as model:
        assert (model.parts, model.volume, len(model)) == (["here", "there"], 16.0, 24)
        assert model.bounds == (-1.0, -1.0, -1.0, 11.0, 1.0, 1.0)
        assert set(colours_by_vertex(model).values()) == {(9, 8, 7)}
    other = (VERTICES + 20, TRIANGLES)
    both: list[tuple[Any, list[str]]] = [({"a": block, "b": other}, ["a", "b"]), ([block, other], ["0", "1"])]
    for meshes, names in both:
        spinney.build_brep(meshes, tmp_path / "both.goblin", attributes=[{"height": 2}, {"height": 4}])
        with spinney.open_brep(tmp_path / "both.goblin") as model:
            assert model.parts == names
            assert [(row["volume"], row["attributes"]["height"]) for row in model.objects()] == [(8.0, 2), (24.0, 4)]
        spinney.build_brep(meshes, tmp_path / "one.goblin", names=["x", "y"], attributes={"y": {"height": 4}}, where="height>3")
        with spinney.open_brep(tmp_path / "one.goblin") as model:
            assert model.parts == ["y"] and model.volume == 24.0
    # Errors name objects that are not valid bodies; they can be left out.
    hole = (VERTICES, TRIANGLES[1:])
    with pytest.raises(ValueError, match="a boundary of 3 edges from .*, of open"):
        spinney.build_brep({"whole": other, "open": hole}, tmp_path / "no.goblin")
    built = spinney.build_brep({"whole": other, "open": hole}, tmp_path / "some.goblin", skip_bad=True)
    assert [name for name, _ in built.skipped] == ["open"]
    assert spinney.open_brep(tmp_path / "some.goblin").parts == ["whole"]
    built = spinney.build_brep({"whole": other, "open": hole}, tmp_path / "some.goblin", close=True)
    assert built.closing_triangles == 1 and spinney.open_brep(tmp_path / "some.goblin").volume == 48.0
    assert not (tmp_path / "no.goblin").exists()


def test_faces_of_models_are_meshes(tmp_path: Path) -> None:
    block, rod = ((VERTICES - [1, 1.5, 2]) * 4, TRIANGLES), ((VERTICES - [1, 1.5, 2]) * [1, 1, 8], TRIANGLES)
    spinney.build_brep(block, tmp_path / "block.goblin", snap=0.25, colours=[[50, 60, 70]] * 8, names=["block"])
    spinney.build_brep(rod, tmp_path / "rod.goblin", snap=0.25, colours=[[80, 90, 99]] * 8, names=["rod"])
    spinney.combine("a-b", [tmp_path / "block.goblin", tmp_path / "rod.goblin"], tmp_path / "drilled.goblin")
    with spinney.open_brep(tmp_path / "drilled.goblin") as model:
        faces = model.faces()
        assert len(faces.ring_ends) == len(faces.face_ends) or model.volume == 8 * 12 * 16 - 2 * 3 * 16
        spinney.build_brep(faces, tmp_path / "again.goblin", snap=0.25, names=model.parts)
        with spinney.open_brep(tmp_path / "again.goblin") as again:
            assert (len(again), again.volume, again.area) == (len(model), model.volume, model.area)
            assert again.parts == model.parts
            own = again.faces()
            assert np.array_equal(own.parts, faces.parts) and np.array_equal(own.colours, faces.colours)
            assert np.array_equal(own.ring_ends, faces.ring_ends) and np.array_equal(own.face_ends, faces.face_ends)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"colours": [[1, 2, 3]] * 7}, "colours: got 7, expected one for each of 8 vertices"),
        ({"colours": [[1, 2]] * 8}, "rows of red, green and blue"),
        ({"colours": [[0.5, 1, 1]] * 8}, "integers"),
        ({"colours": [[256, 1, 1]] * 8}, "from 0 to 255"),
        ({"parts": [0] * 11}, "expected a number from 0 for each of 12 faces"),
        ({"parts": [-1] * 12}, "expected a number from 0"),
        ({"parts": [0.0] * 12}, "expected a number from 0"),
        ({"parts": ENDS_AND_WALLS, "names": ["ends"]}, "names: got 1, expected one for each part, 0 to 1"),
        ({"attributes": [{}, {}]}, "attributes: got 2, expected one for each of 1 parts"),
        ({"attributes": {"roof": {}}}, "unknown part 'roof', expected one of 'mesh'"),
        ({"attributes": [{"a": float("nan")}]}, "JSON"),
    ],
)
def test_invalid_mesh_attributes_are_rejected(tmp_path: Path, options: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        spinney.build_brep(BOX, tmp_path / "no.goblin", **options)
    assert not list(tmp_path.iterdir())


def test_values_that_are_not_meshes_are_rejected(tmp_path: Path) -> None:
    out = tmp_path / "no.goblin"
    with pytest.raises(TypeError, match="'b' is of type int, expected a mesh"):
        spinney.build_brep({"a": BOX, "b": 3}, out)
    with pytest.raises(TypeError, match="models"):
        spinney.build_brep([], out)
    with pytest.raises(ValueError, match="colours, parts: are for a single mesh"):
        spinney.build_brep([BOX, BOX], out, parts=[0] * 24)
    with pytest.raises(ValueError, match="names: got 1, expected one for each of 2 meshes"):
        spinney.build_brep([BOX, BOX], out, names=["a"])
    with pytest.raises(TypeError, match="colours: is for meshes in memory"):
        spinney.build_brep(tmp_path / "file.off", out, colours=[[1, 2, 3]])
    inches, metres = (trimesh.creation.box() for _ in range(2))
    inches.units, metres.units = "inches", "meters"
    with pytest.raises(ValueError, match="inches and meters"):
        spinney.build_brep([inches, metres], out)
    with pytest.raises(ValueError, match="finite"):
        spinney.build_brep((np.where(VERTICES == 3, np.nan, VERTICES), TRIANGLES), out)
    with pytest.raises(TypeError, match="transform"):
        spinney.build(BOX, out, transform=(1, 0, 0, 0, 1, 0))
    assert not list(tmp_path.iterdir())
