"""Exact models, read by the reader in tests/foreign, which implements formats.md independently."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, run

import spinney

sys.path.append(str(ROOT / "tests" / "foreign"))


def off(points: list, faces: list) -> str:
    lines = [f"OFF\n{len(points)} {len(faces)} 0"]
    lines += [" ".join(map(str, point)) for point in points]
    lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    return "\n".join(lines) + "\n"


def torus() -> str:
    n, m = 60, 30
    u, v = np.indices((n, m)).reshape(2, -1) * np.array([[2 * np.pi / n], [2 * np.pi / m]])
    points = np.round(np.stack([(3 + np.cos(v)) * np.cos(u), (3 + np.cos(v)) * np.sin(u), np.sin(v)], 1), 4)
    i, j = np.indices((n, m)).reshape(2, -1)
    a, b, c, d = (x % n * m + y % m for x, y in [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)])
    return off(points.tolist(), [*np.stack([a, b, c], 1).tolist(), *np.stack([a, c, d], 1).tolist()])


def frame() -> str:
    """Returns a block with a tunnel; the tunnel's ends are holes, which bridges connect to their
    faces.
    """
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    points = [(x * 8 - 3, y * 8, z * 4 + 100) for z in (0, 1) for x, y in square]
    points += [(x * 3 - 1, y * 3 + 2, z * 4 + 100) for z in (0, 1) for x, y in square]
    faces = [[0, 3, 2, 1, 0, 8, 9, 10, 11, 8], [4, 5, 6, 7, 4, 12, 15, 14, 13, 12]]
    for first, turn in [(0, 1), (8, -1)]:
        walls = [[first + i, first + (i + 1) % 4, first + 4 + (i + 1) % 4, first + 4 + i] for i in range(4)]
        faces += [wall[::turn] for wall in walls]
    return off(points, faces)


@pytest.mark.parametrize("leaf_size", [0, 12])
@pytest.mark.parametrize(("make", "options"), [(torus, []), (torus, ["--snap", "0.001"]), (frame, ["--snap", "1"])])
def test_foreign_reader(program: str, tmp_path: Path, make: Callable[[], str], options: list[str], leaf_size: int) -> None:
    from models import Model

    mesh, path = tmp_path / "t.off", tmp_path / "t.goblin"
    mesh.write_text(make())
    run(program, "-q", "build", mesh, "-o", path, "--brep", *options, "--leaf-size", leaf_size)
    model = Model(path.read_bytes())
    assert sum(8 ** (model.depth - leaf.at.level) for leaf in model.leaves) == 8**model.depth
    model.verify_exact_surface()
    if make is frame:
        model.verify()
        assert {len(face.rings) for face in model.faces} == {1, 2}
    elif leaf_size == 0:
        assert len(model.segments) > 1
    # Points anywhere, on vertices, between them, and on many cell walls: in halves of the grid
    # unit.
    random = np.random.default_rng(5)
    corners = 2 * np.array([ring[:3] for face in model.faces for ring in face.rings], np.int64).reshape(-1, 3)
    near = random.choice(corners, 100)
    halves = near + random.integers(-1, 2, near.shape)
    points = np.concatenate([random.integers(-4, corners.max(0) + 4, (200, 3)), near, (near + random.choice(corners, 100)) // 2, halves])
    results = [model.inside(tuple(map(int, point))) for point in points]
    world = (points / 2 + model.origin) * model.step / model.divisor
    text = "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in world.tolist())
    done = subprocess.run([program, "point", str(path)], input=text, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [{None: "boundary", True: "inside", False: "outside"}[result] for result in results]
    with spinney.open_brep(path) as opened:
        assert opened.locate(world).tolist() == [{None: 0, True: 1, False: -1}[result] for result in results]
    assert {None, True, False} == set(results)
    # The octree agrees with the winding number of all faces.
    for point, result in list(zip(points, results))[:: 12 if make is torus else 3]:
        assert result is None or result == (model.winding(tuple(map(int, point))) == 1)


def test_models_are_moved(program: str, tmp_path: Path) -> None:
    from models import Model

    mesh, path, moved = (tmp_path / name for name in ("frame.off", "frame.goblin", "moved.goblin"))
    mesh.write_text(frame())
    run(program, "build", mesh, "-o", path, "--brep", "--snap", "1")
    made = spinney.transform(path, ["rotate=90,x", "mirror=z"], moved)
    assert isinstance(made, spinney.MovedModel)
    assert (made.before, made.faces, made.is_exact, made.displacement) == (10, 10, True, 0.0)
    with spinney.open_brep(path) as one, spinney.open_brep(moved) as other:
        assert one.mass().volume == other.mass().volume
    model = Model(moved.read_bytes())
    assert model.formula == [[1, 0, 0, 0, 0, 0, -1, 0, 0, -1, 0, 0], str(path)]
    made = spinney.transform(path, "rotate=30", moved, snap=0.001, unit="mm")
    assert isinstance(made, spinney.MovedModel)
    assert not made.is_exact
    assert 0 < made.displacement < 0.001
    for wrong in ({"move": True}, {"resampling": "nearest"}, {"snap": -1.0}):
        with pytest.raises(ValueError):
            spinney.transform(path, "rotate=30", moved, **wrong)
