"""Exact models: built, opened and queried; NumPy and trimesh are the references."""

from __future__ import annotations

import pickle
import threading
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import FIXTURES

import spinney

CHAPEL = FIXTURES / "v1" / "chapel.goblin"


def solids() -> dict[str, trimesh.Trimesh]:
    """Closed bodies whose vertices are on a grid of 1/1024."""
    made = {
        "ball": trimesh.creation.icosphere(subdivisions=3, radius=5.0),
        "ring": trimesh.creation.annulus(r_min=2.0, r_max=4.0, height=3.0, sections=24),
        "box": trimesh.creation.box(extents=(2.0, 3.0, 4.0)),
    }
    for mesh in made.values():
        mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
        mesh.vertices = np.round(mesh.vertices * 1024) / 1024
    return made


@pytest.fixture(scope="module")
def bodies(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[trimesh.Trimesh, spinney.ExactModel]]:
    directory = tmp_path_factory.mktemp("bodies")
    opened = {}
    for name, mesh in solids().items():
        mesh.export(directory / f"{name}.off", digits=12)
        built = spinney.build_brep(directory / f"{name}.off", directory / f"{name}.goblin", snap=1 / 1024)
        assert (built.read, built.faces, built.displacement) == (len(mesh.faces), len(mesh.faces), 0.0)
        assert built.step == 1 / 1024 and sum(built.nodes.values()) > 0
        opened[name] = (mesh, spinney.open_brep(directory / f"{name}.goblin"))
    return opened


def test_the_chapel() -> None:
    with spinney.open_brep(CHAPEL) as model:
        assert len(model) == 187 and model.parts == ["nave", "dome"] and (model.unit, model.crs) == ("m", "EPSG:2056")
        assert (model.depth, model.bits, model.step, model.origin) == (12, 12, 0.01, (2650000.0, 1250000.0, -1.0))
        assert model.verify() == [] and spinney.verify(CHAPEL) == []
        assert model.bounds == (2650001.0, 1250001.0, 0.0, 2650028.0, 1250021.0, 13.0)
        assert model.provenance == ["made by examples/make_fixtures"] and model.tags == {"unit": "m"}
        faces = model.faces()
        assert len(faces) == 187 and np.array_equal(faces.numbers, np.arange(187))
        gable = faces.rings(0)
        assert [len(ring) for ring in gable] == [5, 4] and len(faces.rings(-1)) == 1
        assert np.array_equal(gable[0][3] - model.origin, [6.0, 1.0, 14.0])
        assert faces.parts[0] == 0 and faces.parts[-1] == 1 and faces.sources[-1] == 188
        assert faces.colours is not None and faces.colours[0].tolist() == [200, 190, 170]
        euler = model.euler()
        assert (euler.shells, euler.genus, euler.inner_rings, euler.boundaries) == (4, 1, 2, 0)
        assert euler.vertices - euler.edges + euler.faces - euler.inner_rings == 2 * (euler.shells - 1)
        repeated = pickle.loads(pickle.dumps(model))
        assert repeated.bounds == model.bounds
        assert "187 faces" in repr(model)
    assert model.closed and "closed" in repr(model)
    with pytest.raises(ValueError, match="is closed"):
        model.locate([(0, 0, 0)])


def test_measures_are_those_of_the_triangles(bodies: dict) -> None:
    for mesh, model in bodies.values():
        mass = model.mass()
        assert mass.volume == pytest.approx(mesh.volume, rel=1e-12) == model.volume
        assert mass.area == pytest.approx(mesh.area, rel=1e-12) == model.area
        assert mass.centre == pytest.approx(mesh.center_mass, abs=1e-12)
        assert mass.inertia == pytest.approx(mesh.moment_inertia, rel=1e-9, abs=1e-9)
        trace = np.trace(mass.second_moments) * np.eye(3) - mass.second_moments
        assert trace == pytest.approx(mass.inertia, rel=1e-12, abs=1e-12)
        assert np.array_equal(np.reshape(model.bounds, (2, 3)), mesh.bounds)
        assert model.euler().vertices == len(mesh.vertices)


def ordered(triangles: np.ndarray) -> np.ndarray:
    """Triangles in the order of coordinates, each from its first corner in that order."""
    least = [min(range(3), key=lambda corner: tuple(triangle[corner])) for triangle in triangles]
    turned = [np.roll(triangle, -corner, axis=0).ravel() for triangle, corner in zip(triangles, least, strict=True)]
    return np.array(sorted(map(tuple, turned)))


def test_faces_and_triangles_come_back(bodies: dict, tmp_path: Path) -> None:
    for name, (mesh, model) in bodies.items():
        found = trimesh.Trimesh(*model.triangles(), process=False)
        assert found.is_watertight and found.volume == pytest.approx(mesh.volume, rel=1e-12)
        faces = model.faces()
        corners = np.array([faces.rings(index)[0] for index in range(len(faces))])
        # (The faces of meshes are sorted, and may begin at another corner.)
        assert np.array_equal(ordered(corners), ordered(mesh.triangles))
        assert faces.colours is None
        # A box: compared with NumPy's result from the vertices.
        low, high = mesh.bounds[0] + 0.4, mesh.bounds[1] - 1.1
        meets = ((corners.min(1) <= high) & (corners.max(1) >= low)).all(1)
        assert np.array_equal(model.faces((*low, *high)).numbers, np.flatnonzero(meets))
        vertices, faces_written = model.export(tmp_path / f"{name}.ply")
        again = trimesh.load(tmp_path / f"{name}.ply", process=False)
        assert (vertices, faces_written) == (len(mesh.vertices), len(mesh.faces))
        assert again.volume == pytest.approx(mesh.volume, rel=1e-12)
    with pytest.raises(ValueError, match="use .ply"):
        model.export(tmp_path / "x.png")


def winding(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Winding numbers by the solid angles of all triangles (van Oosterom and Strackee)."""
    a, b, c = (mesh.triangles[None, :, i] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    above = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
    dots = [np.einsum("ijk,ijk->ij", u, v) for u, v in ((a, b), (b, c), (c, a))]
    below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    return 2 * np.arctan2(above, below).sum(1) / (4 * np.pi)


def test_points_are_where_winding_numbers_say(bodies: dict) -> None:
    random = np.random.default_rng(3)
    for mesh, model in bodies.values():
        points = random.uniform(*(mesh.bounds * 1.1), (800, 3))
        inside = winding(mesh, points) > 0.5
        located = model.locate(points)
        assert located.dtype == np.int8 and np.array_equal(located, np.where(inside, 1, -1))
        assert np.array_equal(model.contains(points), inside)
        # Vertices are on the surface, and are included on request.
        assert not model.locate(mesh.vertices).any()
        assert model.contains(mesh.vertices).all() and not model.contains(mesh.vertices, boundary=False).any()
    assert model.locate(np.empty((0, 3))).shape == (0,)
    assert model.locate([(np.nan, 0, 0), (np.inf, 0, 0)]).tolist() == [-1, -1]
    with pytest.raises(ValueError, match="shape"):
        model.locate([(1.0, 2.0)])


def test_distances_are_those_of_all_triangles(bodies: dict) -> None:
    random = np.random.default_rng(4)
    for mesh, model in bodies.values():
        points = random.uniform(*(mesh.bounds * 1.5), (60, 3))
        wanted = [
            np.linalg.norm(
                trimesh.triangles.closest_point(mesh.triangles, np.tile(point, (len(mesh.faces), 1))) - point, axis=1
            ).min()
            for point in points
        ]
        assert model.distance(points, signed=False) == pytest.approx(wanted, abs=1e-9)
        assert model.distance(points) == pytest.approx(wanted * -model.locate(points), abs=1e-9)
        found = model.nearest(points)
        assert np.linalg.norm(found.points - points, axis=1) == pytest.approx(found.distance)
        assert model.distance(found.points, signed=False) == pytest.approx(0, abs=1e-9)
        assert found.faces.min() >= 0 and found.faces.max() < len(model)


def test_rays_meet_what_all_triangles_say(bodies: dict) -> None:
    random = np.random.default_rng(5)
    for mesh, model in bodies.values():
        origins = random.uniform(*(mesh.bounds * 2), (300, 3))
        ways = random.normal(size=(300, 3))
        hits = model.rays(origins, ways)
        # The ray-triangle intersection of Moeller and Trumbore.
        a, b, c = (mesh.triangles[None, :, i] for i in range(3))
        e1, e2, d = b - a, c - a, ways[:, None]
        p = np.cross(d, e2)
        t0 = origins[:, None] - a
        q = np.cross(t0, e1)
        with np.errstate(all="ignore"):
            det = (e1 * p).sum(2)
            u, v, t = (t0 * p).sum(2) / det, (d * q).sum(2) / det, (e2 * q).sum(2) / det
        t[~((u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0))] = np.inf
        first = t.min(1)
        assert np.array_equal(hits.hit, np.isfinite(first)) and hits.hit.any() and not hits.hit.all()
        hit = hits.hit
        assert hits.distance[hit] == pytest.approx(first[hit], abs=1e-6)
        assert np.array_equal(hits.entering[hit], model.locate(origins)[hit] < 0)
        assert (hits.faces[~hit] == -1).all() and np.isnan(hits.points[~hit]).all()
        one = model.ray(origins[hit][0], ways[hit][0])
        assert one is not None and one.distance[0] == hits.distance[hit][0]
        assert model.ray(mesh.bounds[1] + 1, (1, 1, 1)) is None
    with pytest.raises(ValueError, match="directions"):
        model.rays([(0, 0, 0)], [(0, 0, 0)])


def test_boxes_and_cells(bodies: dict) -> None:
    for mesh, model in bodies.values():
        side = model.step * 2**model.bits
        whole = model.coverage(0, (0, 0, 0))
        assert whole.volume == pytest.approx(mesh.volume, rel=1e-9)
        assert whole.share == pytest.approx(mesh.volume / side**3, rel=1e-9)
        assert whole.centre == pytest.approx(mesh.center_mass, abs=1e-6)
        halves = [model.coverage(1, (x, y, z)).volume for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        assert sum(halves) == pytest.approx(mesh.volume, rel=1e-9)
        assert model.locate_box((*mesh.bounds[0], *mesh.bounds[1])) == "cut"
        assert model.locate_box((*(mesh.bounds[1] + 1), *(mesh.bounds[1] + 2))) == "outside"
    _, ball = bodies["ball"]
    assert ball.locate_box((-1, -1, -1, 1, 1, 1)) == "inside"
    for wrong in [(0, 0, 0), (1, 1, 1, 0, 0, 0), (np.nan,) * 6]:
        with pytest.raises(ValueError, match="box"):
            ball.locate_box(wrong)
    for level, cell in [(99, (0, 0, 0)), (1, (2, 0, 0)), (300, (0, 0, 0)), (1, (-1, 0, 0))]:
        with pytest.raises(ValueError, match="cell"):
            ball.coverage(level, cell)


def test_open_surfaces_are_rejected_or_closed(tmp_path: Path) -> None:
    mesh = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    mesh.faces = mesh.faces[:-2]
    mesh.export(tmp_path / "open.off")
    out = tmp_path / "open.goblin"
    with pytest.raises(ValueError, match="open"):
        spinney.build_brep(tmp_path / "open.off", out)
    assert not out.exists()
    built = spinney.build_brep(tmp_path / "open.off", out, close=True, unit="m", leaf_size=0)
    assert (built.closed_boundaries, built.closing_triangles) == (1, 2)
    model = spinney.open_brep(out, positioned=True)
    assert model.volume == 8.0 and model.unit == "m" and model.positioned
    # From an exact model, and to cells.
    spinney.build_brep(out, tmp_path / "again.goblin")
    assert spinney.open_brep(tmp_path / "again.goblin").volume == 8.0
    spinney.build(out, tmp_path / "cells.goblin", cells=16)
    with spinney.open(tmp_path / "cells.goblin") as cells:
        assert cells.volume() == pytest.approx(8.0, rel=0.2)
    with pytest.raises(OSError, match="a tree of cells"):
        spinney.open_brep(tmp_path / "cells.goblin")
    with pytest.raises((ValueError, OSError), match="exact model"):
        spinney.open(out)
    with pytest.raises(FileNotFoundError):
        spinney.open_brep(tmp_path / "missing.goblin")
    with pytest.raises(ValueError, match="output"):
        spinney.build_brep(out, out)
    with pytest.raises(TypeError, match="models"):
        spinney.build_brep(3, out)  # type: ignore[arg-type]


def test_progress_is_reported_and_can_cancel(bodies: dict) -> None:
    _, model = bodies["ball"]
    points = np.random.default_rng(6).uniform(-6, 6, (300_000, 3))

    def stop(_done: int, _total: int) -> None:
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        model.locate(points, progress=stop)
    updates: list[tuple[int, int]] = []
    model.locate(points, progress=lambda done, total: updates.append((done, total)))
    assert updates[-1] == (len(points), len(points))


def test_threads_have_the_same_results(bodies: dict) -> None:
    mesh, model = bodies["ring"]
    points = np.random.default_rng(7).uniform(*mesh.bounds, (5000, 3))
    wanted = model.locate(points)
    wrong = []

    def query() -> None:
        if not np.array_equal(model.locate(points), wanted):
            wrong.append(1)

    threads = [threading.Thread(target=query) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
