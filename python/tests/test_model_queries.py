"""Rays, shells, objects and set operations of exact models; the references are brute force over all
triangles, and integers.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import threading
import time
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIXTURES

import spinney

CHAPEL = FIXTURES / "v1" / "chapel.goblin"

CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
QUADS = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def build(directory: Path, name: str, vertices: np.ndarray, faces: list | np.ndarray, **options: object) -> spinney.ExactModel:
    spinney.build_brep((vertices, faces), directory / f"{name}.goblin", snap=1 / 64, **options)  # type: ignore[arg-type]
    return spinney.open_brep(directory / f"{name}.goblin")


def cube(directory: Path, name: str, low: float, high: float) -> spinney.ExactModel:
    return build(directory, name, CORNERS * (high - low) + low, np.array(QUADS))


@pytest.fixture(scope="module")
def hollow(tmp_path_factory: pytest.TempPathFactory) -> spinney.ExactModel:
    """A cube of 8 with a cavity of 4."""
    cavity = [face[::-1] for face in QUADS]
    faces = np.array(QUADS + [[corner + 8 for corner in face] for face in cavity])
    return build(tmp_path_factory.mktemp("hollow"), "hollow", np.concatenate([CORNERS * 8, CORNERS * 4 + 2]), faces)


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> spinney.ExactModel:
    """A triangulated ball whose vertices are on the grid."""
    n, m = 40, 20
    u, v = np.arange(n) / n * 2 * np.pi, (np.arange(m - 1) + 1) / m * np.pi
    rings = np.stack([np.outer(np.sin(v), np.cos(u)), np.outer(np.sin(v), np.sin(u)), np.outer(np.cos(v), np.ones(n))], -1)
    points = np.concatenate([rings.reshape(-1, 3), [(0, 0, 1), (0, 0, -1)]])
    points = np.round(points * 5 * 64) / 64
    top, bottom, faces = len(points) - 2, len(points) - 1, []
    for j in range(n):
        k = (j + 1) % n
        faces += [[top, j, k], [bottom, (m - 2) * n + k, (m - 2) * n + j]]
        for i in range(m - 2):
            a, b, c, d = i * n + j, (i + 1) * n + j, (i + 1) * n + k, i * n + k
            faces += [[a, b, c], [a, c, d]]
    return build(tmp_path_factory.mktemp("ball"), "ball", points, np.array(faces))


def whole(numbers: Any) -> list[int]:
    """Converts multiples of 1/8192 to integers: their products are much faster than those of
    fractions.
    """
    found = [8192 * Fraction(number) for number in numbers]
    assert all(number.denominator == 1 for number in found)
    return [number.numerator for number in found]


def shares(triangles: list, origin: list[int], way: list[int]) -> list[Fraction]:
    """Returns where a ray that passes through no edge crosses triangles with integer vertices, in
    rational numbers (Moeller and Trumbore).
    """

    def cross(a: list, b: list) -> list:
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    def dot(a: list, b: list) -> int:
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    found = []
    for a, b, c in triangles:
        e1, e2, t = ([p - q for p, q in zip(u, v)] for u, v in ((b, a), (c, a), (origin, a)))
        p, q = cross(way, e2), cross(t, e1)
        det = dot(e1, p)
        if det:
            u, v, s = Fraction(dot(t, p), det), Fraction(dot(way, q), det), Fraction(dot(e2, q), det)
            assert u and v and u + v != 1, "a ray through an edge"
            if u > 0 and v > 0 and u + v < 1 and s > 0:
                found.append(s)
    return sorted(found)


def test_rays_are_those_of_rational_numbers(ball: spinney.ExactModel, hollow: spinney.ExactModel) -> None:
    random = np.random.default_rng(1)
    for model in (ball, hollow):
        mesh = model.triangles()
        triangles = [[whole(mesh.vertices[corner]) for corner in face] for face in mesh.faces]
        low, high = np.reshape(model.bounds, (2, 3))
        # (With offsets from the grid, so that no ray passes through an edge.)
        origins = np.round(random.uniform(low - 3, high + 3, (60, 3)) * 64) / 64 + np.array([1, 3, 5]) / 8192
        ways = (np.round(random.uniform(low, high, (60, 3)) * 64) / 64 + np.array([7, 11, 2]) / 8192) - origins
        hits, all_hits = model.rays(origins, ways), model.crossings(origins, ways)
        inside = model.contains(origins)
        for index, (origin, way) in enumerate(zip(origins, ways)):
            expected = shares(triangles, whole(origin), whole(way))
            own = all_hits.rays == index
            assert all_hits.distance[own] == pytest.approx([float(share) for share in expected], rel=1e-6)
            assert own.sum() % 2 == inside[index]
            if expected:
                assert hits.distance[index] == all_hits.distance[own][0] and hits.faces[index] == all_hits.faces[own][0]
                assert np.array_equal(hits.points[index], all_hits.points[own][0])
            assert hits.hit[index] == bool(expected) and hits.parts[index] == (0 if expected else -1)


def test_rays_along_edges_and_through_corners_count_as_points_lie(ball: spinney.ExactModel, hollow: spinney.ExactModel) -> None:
    random = np.random.default_rng(2)
    for model in (ball, hollow):
        mesh = model.triangles()
        corners = mesh.vertices[mesh.faces]
        faces = random.integers(0, len(corners), 400)
        a, b = corners[faces, 0], corners[faces, 1]
        inner = np.array([1.0, 1.0, 1.0]) if model is hollow else np.zeros(3)
        # From inside through vertices and edge midpoints; along edges from outside; from vertex to
        # vertex.
        origins = np.concatenate([np.broadcast_to(inner, (800, 3)), a - 3 * (b - a), a - 4 * (np.roll(a, 1, 0) - a)])
        ways = np.concatenate([a - inner, (a + b) / 2 - inner, b - a, np.roll(a, 1, 0) - a])
        meant = (ways != 0).any(1)
        origins, ways = origins[meant], ways[meant]
        positions = model.locate(origins)
        counts = np.bincount(model.crossings(origins, ways).rays, minlength=len(origins))
        clear = positions != 0
        assert clear.sum() > 1200 and np.array_equal(counts[clear] % 2 == 1, positions[clear] > 0)
        # Rays enter and leave alternately.
        found = model.crossings(origins[clear], ways[clear])
        follows = found.rays[1:] == found.rays[:-1]
        assert (found.distance[1:] >= found.distance[:-1])[follows].all()
        assert (found.entering[1:] != found.entering[:-1])[follows].all()


def test_one_call_is_many_and_arrays_of_any_order_will_do(ball: spinney.ExactModel) -> None:
    random = np.random.default_rng(3)
    origins, ways = random.uniform(-9, 9, (3000, 3)), random.normal(size=(3000, 3))
    hits = ball.rays(origins, ways)
    assert hits.hit.any() and not hits.hit.all()
    for threads in (1, 2):
        again = ball.rays(np.asfortranarray(origins), np.repeat(ways, 2, 0)[::2], threads=threads)
        for name in ("distance", "points", "faces", "parts", "entering"):
            assert np.array_equal(getattr(again, name), getattr(hits, name), equal_nan=name in ("distance", "points"))
    for index in range(0, 3000, 97):
        one = ball.ray(origins[index], ways[index])
        assert (one is None) == (not hits.hit[index])
        assert one is None or one.distance[0] == hits.distance[index]
    assert ball.rays([(0, 0, 0)], np.array([(1, 0, 0), (0, 1, 0)], dtype=np.int32)).hit.all()
    assert ball.rays(np.float32([(0, 0, 0)]), (1, 0, 0)).distance[0] == ball.rays([(0, 0, 0)], (1, 0, 0)).distance[0]
    assert len(ball.rays(np.empty((0, 3)), np.empty((0, 3))).faces) == 0


@pytest.mark.parametrize("method", ["rays", "crossings"])
def test_invalid_rays_are_rejected(ball: spinney.ExactModel, method: str) -> None:
    cast = getattr(ball, method)
    for origin, way in [((np.nan, 0, 0), (1, 0, 0)), ((0, 0, 0), (np.inf, 0, 0)), ((0, 0, 0), (0, 0, 0)), ((0, 0, 0), (-0.0, 0, 0))]:
        with pytest.raises(ValueError, match="rays: expected finite origins"):
            cast([origin], [way])
    with pytest.raises(ValueError, match="shape"):
        cast(np.zeros((4, 2)), np.ones((4, 3)))
    with pytest.raises(ValueError):
        cast(np.zeros((4, 3)), np.ones((5, 3)))
    with pytest.raises((TypeError, ValueError)):
        cast([("a", "b", "c")], [(1, 0, 0)])
    with pytest.raises(TypeError, match="complex"):
        cast(np.zeros((1, 3)), np.ones((1, 3), dtype=complex) * 1j)


def test_points_on_the_surface_and_in_the_cavity(hollow: spinney.ExactModel) -> None:
    points = [(0, 0, 0), (8, 4, 4), (4, 8, 0), (2, 3, 3), (4, 4, 4), (1, 4, 4), (9, 4, 4), (9, 9, 4)]
    assert hollow.distance(points) == pytest.approx([0, 0, 0, 0, 2, -1, 1, np.sqrt(2)])
    assert hollow.locate(points).tolist() == [0, 0, 0, 0, -1, 1, -1, -1]
    assert np.isnan(hollow.distance([(np.nan, 0, 0)]))[0]
    assert hollow.distance(points, signed=False).min() == 0


def test_shells_have_volumes_of_their_own(hollow: spinney.ExactModel) -> None:
    shells = hollow.shells()
    assert (len(shells), shells.bodies, shells.volume.tolist()) == (2, 1, [512.0, -64.0])
    assert shells.vertices.tolist() == [8, 8] and shells.edges.tolist() == [12, 12] and shells.faces.tolist() == [6, 6]
    assert not shells.genus.any() and not shells.boundaries.any() and not shells.inner_rings.any()
    assert np.array_equal(shells.of_faces, np.repeat([0, 1], 6))
    with spinney.open_brep(CHAPEL) as chapel:
        shells, euler = chapel.shells(), chapel.euler()
        assert (len(shells), shells.faces.sum(), shells.genus.sum()) == (euler.shells, euler.faces, euler.genus)
        assert shells.volume.sum() == pytest.approx(chapel.volume) and np.bincount(shells.of_faces).tolist() == shells.faces.tolist()
    with pytest.raises(ValueError, match="memory"):
        hollow.shells(memory=100)


def test_objects_are_rows(hollow: spinney.ExactModel, tmp_path: Path) -> None:
    with spinney.open_brep(CHAPEL) as chapel:
        rows = chapel.objects()
        assert [row["name"] for row in rows] == chapel.parts
        assert sum(row["area"] for row in rows) == pytest.approx(chapel.area)
        if all(row["closed"] for row in rows):
            assert sum(row["volume"] for row in rows) == pytest.approx(chapel.volume)
    assert [(row["closed"], row["volume"], row["area"]) for row in hollow.objects()] == [(True, 448.0, 6 * 64.0 + 6 * 16.0)]
    hollow.export(tmp_path / "hollow.city.json")
    document = json.loads((tmp_path / "hollow.city.json").read_text())
    (own,) = document["CityObjects"].values()
    own.update(type="Building", attributes={"height": 8.5, "name": "block", "floors": [1, 2]})
    (tmp_path / "hollow.city.json").write_text(json.dumps(document))
    spinney.build_brep(tmp_path / "hollow.city.json", tmp_path / "city.goblin")
    with spinney.open_brep(tmp_path / "city.goblin") as city:
        rows = [row for row in city.objects() if "type" in row]
        assert [(row["type"], row["attributes"], row["name"]) for row in rows] == [("Building", own["attributes"], rows[0]["name"])]
        assert rows[0]["name"] in city.parts


@pytest.mark.parametrize("number", range(16))
def test_operations_are_those_of_their_tables(tmp_path: Path, number: int) -> None:
    a, b = cube(tmp_path, "a", 0, 4), cube(tmp_path, "b", 2, 6)
    made = spinney.combine(number, [a, b], tmp_path / "c.goblin")
    assert isinstance(made, spinney.CombinedModel) and made.is_unbounded == bool(number & 8)
    points = np.random.default_rng(number).uniform(-1, 7, (300, 3))
    of_a, of_b = a.contains(points), b.contains(points)
    expected = np.select([of_a & of_b, of_a, of_b], [number & 1, number >> 1 & 1, number >> 2 & 1], number >> 3) > 0
    with spinney.open_brep(tmp_path / "c.goblin") as c:
        assert np.array_equal(c.contains(points), expected)
        rays = c.crossings(points, [(0.3, 0.5, 0.7)])
        assert np.array_equal(np.bincount(rays.rays, minlength=300) % 2, expected ^ bool(number & 8))
        if len(c) == 0:
            assert not c.rays(points, (1, 0, 0)).hit.any() and len(c.shells()) == 0 and len(c.objects()) == len(c.parts)
            assert np.isnan(c.distance(points)).all() or np.isinf(c.distance(points)).all()
    with pytest.raises(ValueError, match="operation"):
        spinney.combine(16, [a, b], tmp_path / "d.goblin")


def test_several_models_are_combined(tmp_path: Path) -> None:
    models = [cube(tmp_path, str(at), at, at + 2) for at in range(4)]
    spinney.combine("or", models, tmp_path / "all.goblin")
    assert spinney.open_brep(tmp_path / "all.goblin").volume == 4 * 8 - 3
    with pytest.raises(ValueError, match="output"):
        spinney.combine("or", models, models[0])


def test_polygons_of_any_lengths_become_models(tmp_path: Path) -> None:
    # A house: walls, gables of five vertices, a floor and two roofs.
    points = np.array([(0, 0, 0), (4, 0, 0), (4, 6, 0), (0, 6, 0), (0, 0, 3), (4, 0, 3), (4, 6, 3), (0, 6, 3), (2, 0, 5), (2, 6, 5)])
    faces = [[0, 3, 2, 1], [0, 1, 5, 8, 4], [3, 7, 9, 6, 2], [1, 2, 6, 5], [0, 4, 7, 3], [5, 6, 9, 8], [4, 8, 9, 7]]
    model = build(tmp_path, "house", points, faces)
    assert (len(model), model.volume) == (7, 4 * 6 * 3 + 4 * 2 / 2 * 6)
    assert [len(model.faces().rings(index)[0]) for index in range(7)] == [4, 5, 5, 4, 4, 4, 4]
    for wrong, error in [([[0, 1], [0, 1, 2]], ValueError), ([[0, 1, 2], [0, 1, 2, 99]], IndexError), ([[0, 1, 2], [0.5, 1, 2, 3]], ValueError)]:
        with pytest.raises(error, match="faces"):
            spinney.build_brep((points, wrong), tmp_path / "wrong.goblin")
    assert not (tmp_path / "wrong.goblin").exists()


@pytest.mark.usefixtures("enabled_ctrl_c")
def test_a_million_rays_can_be_stopped(ball: spinney.ExactModel) -> None:
    origins = np.random.default_rng(4).uniform(-9, 9, (3_000_000, 3))
    timer = threading.Timer(0.3, signal.raise_signal, [signal.SIGINT])
    timer.start()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        for _ in range(100):
            ball.rays(origins, -origins)
    timer.join()
    assert time.monotonic() - begun < 5


def test_queries_of_models_under_affine_maps(hollow: spinney.ExactModel, tmp_path: Path) -> None:
    points = np.random.default_rng(4).uniform(-10, 10, (200, 3))
    for view in ("rotate=90,x", ["mirror=x", "translate=8,0,3"], ["scale=2", "axes=+z,-x,+y"]):
        spinney.transform(hollow.path, view, tmp_path / "moved.goblin")
        with spinney.open_brep(tmp_path / "moved.goblin") as moved, spinney.open_brep(hollow.path, view=view) as seen:
            assert seen.rounding == 0 and seen.view == ([view] if isinstance(view, str) else view)
            assert seen.bounds == moved.bounds and seen.volume == moved.volume and seen.area == moved.area
            assert seen.mass().centre == moved.mass().centre and seen.objects() == moved.objects()
            assert (seen.locate(points) == moved.locate(points)).all()
            assert np.allclose(seen.distance(points), moved.distance(points), atol=1e-12)
            there = np.roll(points, 1, 0) - points
            assert np.allclose(seen.rays(points, there).distance, moved.rays(points, there).distance, equal_nan=True)
            assert np.allclose(seen.crossings(points, there).distance, moved.crossings(points, there).distance)
            low = np.array(moved.bounds[:3])
            assert seen.locate_box((*(low + 0.5), *(low + 1))) == "inside"
            cuts = [model.section(tmp_path / "cut.csv", "z=-0.7") for model in (seen, moved)]
            assert cuts[0].polygons == cuts[1].polygons and cuts[0].area == pytest.approx(cuts[1].area)
            assert list(seen.shells().volume) == list(moved.shells().volume)
            again = pickle.loads(pickle.dumps(seen))
            assert again.view == seen.view and (again.locate(points) == seen.locate(points)).all()
            with pytest.raises(ValueError, match="transform"):
                os.fspath(seen)
    with spinney.open_brep(hollow.path, view="rotate=30,1,2,3") as turned:
        assert 0 < turned.rounding < 1e-10
        assert turned.volume == pytest.approx(hollow.volume) and turned.area == pytest.approx(hollow.area)
        for query in (turned.faces, lambda: turned.locate_box((0, 0, 0, 1, 1, 1)), lambda: turned.export(tmp_path / "a.ply")):
            with pytest.raises(ValueError, match="affine=.*spinney transform"):
                query()
    with spinney.open_brep(hollow.path, view="scale=1,2,3") as stretched:
        assert stretched.volume == pytest.approx(6 * hollow.volume)
        with pytest.raises(ValueError, match="distances .*spinney transform"):
            stretched.distance(points)
    with pytest.raises(ValueError, match="crop"):
        spinney.open_brep(hollow.path, view="crop")
