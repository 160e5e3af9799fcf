"""Levels of detail of exact models, compared with the program's and with the exact surface."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import BOX, FIXTURES, run

import spinney

STEP = 1 / 1024


def torus(at: float) -> tuple[np.ndarray, np.ndarray]:
    n, m = 64, 40
    u, v = np.indices((n, m)).reshape(2, -1) * np.array([[2 * np.pi / n], [2 * np.pi / m]])
    points = np.stack([(3 + np.cos(v)) * np.cos(u) + at, (3 + np.cos(v)) * np.sin(u), np.sin(v)], 1)
    i, j = np.indices((n, m)).reshape(2, -1)
    a, b, c, d = (x % n * m + y % m for x, y in [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)])
    return np.round(points / STEP) * STEP, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two coloured tori, a part each, with levels."""
    path = tmp_path_factory.mktemp("levels") / "tori.goblin"
    (left, triangles), (right, _) = torus(0.0), torus(9.0)
    vertices, faces = np.concatenate([left, right]), np.concatenate([triangles, triangles + len(left)])
    parts, reds = np.repeat([0, 1], len(triangles)), np.repeat([[9, 8, 7], [200, 0, 50]], len(left), axis=0)
    built = spinney.build_brep((vertices, faces), path, snap=STEP, colours=reds, parts=parts, names=["left", "right"], levels=True)
    assert built.faces == len(faces)
    return path


def triangles(mesh: Any) -> Counter[tuple[float, ...]]:
    """Returns the triangles' coordinates, each from its least vertex on."""
    found: Counter[tuple[float, ...]] = Counter()
    for corners in mesh.vertices[mesh.faces].tolist():
        first = corners.index(min(corners))
        found[tuple(np.ravel(corners[first:] + corners[:first]).tolist())] += 1
    return found


def is_closed(faces: np.ndarray) -> bool:
    """Returns whether each edge is used once in each direction, or as often."""
    edges = Counter((a, b) for face in faces.tolist() for a, b in zip(face, face[1:] + face[:1]))
    return all(edges[b, a] == count for (a, b), count in edges.items())


def exported(program: str, path: Path, *options: object) -> spinney.Mesh:
    """Returns the triangles that the program exports."""
    out = path.with_suffix(".off")
    run(program, "-q", "export", path, out, "--triangles", *options)
    lines = [line for line in out.read_text().split("\n") if not line.startswith("#")]
    vertices, faces, _ = map(int, lines[1].split())
    rows = [[float(word) for word in line.split()[:3]] for line in lines[2 : 2 + vertices]]
    corners = [[int(word) for word in line.split()[1:4]] for line in lines[2 + vertices : 2 + vertices + faces]]
    return spinney.Mesh(np.array(rows), np.array(corners))


def test_levels_are_those_of_the_program(program: str, path: Path) -> None:
    with spinney.open_brep(path) as model:
        levels = model.levels
        assert len(levels) > 2 and all(isinstance(level, spinney.DetailLevel) for level in levels)
        assert (levels[-1].faces, levels[-1].error) == (len(model), 0.0)
        assert [level.faces for level in levels] == sorted(level.faces for level in levels)
        assert [level._asdict() for level in levels] == json.loads(run(program, "info", "--json", path))["levels"]
        for number, level in enumerate(levels):
            mesh = model.mesh(level=number)
            assert (len(mesh.faces), mesh.error) == (level.faces, level.error)
            assert is_closed(mesh.faces) and triangles(mesh) == triangles(exported(program, path, "--level", number))
            assert len(mesh.parts) == level.faces and mesh.colours is not None
            for part, colour, x in ((0, [9, 8, 7], 0.0), (1, [200, 0, 50], 9.0)):
                own = mesh.faces[mesh.parts == part]
                assert is_closed(own) and (mesh.colours[mesh.parts == part] == colour).all()
                assert (abs(mesh.vertices[own, 0] - x) <= 4 + mesh.error).all()
            assert abs(model.distance(mesh.vertices)).max() <= level.error
        # Without a detail, the surface is that of `triangles`.
        whole, exact = model.mesh(), model.triangles()
        assert whole.error == 0.0 and np.array_equal(whole.vertices, exact.vertices) and np.array_equal(whole.faces, exact.faces)


def test_errors_and_numbers_of_faces(program: str, path: Path, tmp_path: Path) -> None:
    with spinney.open_brep(path) as model:
        coarsest = model.levels[0]
        found = []
        for error in (0.0, 0.002, 0.01, 0.1, 2 * coarsest.error):
            mesh = model.mesh(error)
            assert mesh.error <= error and is_closed(mesh.faces)
            assert triangles(mesh) == triangles(exported(program, path, "--error", error))
            found.append(len(mesh.faces))
        assert found == sorted(found, reverse=True) and found[-1] == coarsest.faces < found[0]
        for faces in (coarsest.faces, 2 * coarsest.faces, len(model)):
            mesh = model.mesh(faces=faces)
            assert len(mesh.faces) <= faces and is_closed(mesh.faces)
            assert triangles(mesh) == triangles(exported(program, path, "--faces", faces))
        # Files are those of the program.
        for option, detail in (("--level", {"level": 0}), ("--error", {"error": 0.01}), ("--faces", {"faces": coarsest.faces})):
            vertices, count = model.export(tmp_path / "ours.ply", **detail)
            run(program, "-q", "export", path, tmp_path / "theirs.ply", option, *detail.values())
            assert (tmp_path / "ours.ply").read_bytes() == (tmp_path / "theirs.ply").read_bytes()
            mesh = model.mesh(**detail)
            assert (vertices, count) == (len(mesh.vertices), len(mesh.faces))


def test_boxes_select_clusters(path: Path) -> None:
    low, high = np.array([3.0, -1.0, -0.25]), np.array([6.0, 1.0, 0.5])
    with spinney.open_brep(path) as model:
        for detail in ({"level": 0}, {"level": len(model.levels) - 1}, {"error": 0.01}):
            whole, some = model.mesh(**detail), model.mesh(**detail, box=(*low, *high))
            all_triangles, selected = triangles(whole), triangles(some)
            assert selected <= all_triangles
            corners = np.array([list(corners) for corners in all_triangles]).reshape(-1, 3, 3)
            touching = ((corners.min(1) <= high) & (corners.max(1) >= low)).all(1)
            assert all(tuple(corners[index].ravel().tolist()) in selected for index in np.flatnonzero(touching))
        level = len(model.levels) - 1
        assert 0 < len(model.mesh(level=level, box=(*low, *high)).faces) < len(model)
        assert len(model.mesh(level=level, box=(50, 50, 50, 51, 51, 51)).faces) == 0
        # An exact surface has those faces that touch the box.
        near = model.mesh(box=(*low, *high))
        assert np.array_equal(near.faces, model.triangles((*low, *high)).faces)


def test_levels_are_added(program: str, path: Path, tmp_path: Path) -> None:
    plain, ours, theirs = (tmp_path / name for name in ("plain.goblin", "ours.goblin", "theirs.goblin"))
    spinney.build_brep(torus(0.0), plain, snap=STEP)
    made = spinney.transform(plain, "levels", ours)
    assert isinstance(made, spinney.MovedModel)
    assert (made.before, made.faces, made.is_exact, made.displacement, made.cut) == (5120, 5120, True, 0.0, 0)
    run(program, "-q", "transform", plain, "levels", "-o", theirs)
    assert ours.read_bytes() == theirs.read_bytes()
    assert spinney.verify(ours) == []
    made = spinney.transform(plain, ["scale=2", "levels"], tmp_path / "wide.goblin")
    assert isinstance(made, spinney.MovedModel) and made.is_exact
    with spinney.open_brep(ours) as model, spinney.open_brep(tmp_path / "wide.goblin") as wide:
        assert [level.error for level in wide.levels] == [2 * level.error for level in model.levels]
        assert model.mesh(level=0).colours is None
    # Views have levels, too, in their own units.
    with spinney.open_brep(ours) as model, spinney.open_brep(ours, view=["scale=2"]) as view:
        assert [level.error for level in view.levels] == [2 * level.error for level in model.levels]
        assert np.allclose(view.mesh(0.02).vertices, 2 * model.mesh(0.01).vertices)
    with spinney.open_brep(ours, view="rotate=30") as view, pytest.raises(ValueError, match="levels"):
        view.levels
    with pytest.raises(ValueError, match="levels: is followed by another operation"):
        spinney.transform(plain, ["levels", "scale=2"], tmp_path / "no.goblin")
    with pytest.raises(ValueError, match="is not an exact model, which levels needs"):
        spinney.transform(FIXTURES / "v1" / "ball.goblin", "levels", tmp_path / "no.goblin")
    assert not (tmp_path / "no.goblin").exists()


def test_invalid_details_are_rejected(path: Path, tmp_path: Path) -> None:
    spinney.build_brep(BOX, tmp_path / "box.goblin", snap=STEP)
    with spinney.open_brep(tmp_path / "box.goblin") as model:
        assert model.levels == [] and len(model.mesh().faces) == 12 and model.mesh().colours is None
        assert is_closed(model.mesh().faces)
        with pytest.raises((ValueError, OSError), match="spinney transform FILE levels"):
            model.mesh(error=1.0)
    with spinney.open_brep(path) as model:
        for detail in ({"error": 1.0, "faces": 9}, {"level": 0, "faces": 9}, {"error": 1.0, "level": 0}):
            with pytest.raises(ValueError, match="got several, expected one of them"):
                model.mesh(**detail)
            with pytest.raises(ValueError, match="got several, expected one of them"):
                model.export(tmp_path / "no.ply", **detail)
        for detail in ({"error": -1.0}, {"error": float("nan")}, {"level": -1}, {"level": 77}, {"level": 1000}, {"faces": -1}, {"faces": 3}):
            with pytest.raises(ValueError, match=next(iter(detail))):
                model.mesh(**detail)
        with pytest.raises(ValueError, match="box"):
            model.mesh(level=0, box=(1, 1, 1, 0, 0, 0))
    assert not (tmp_path / "no.ply").exists()
