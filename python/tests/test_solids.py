"""Octrees: measures, points, rays, slices, surfaces, renderings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import FIXTURES, run

import spinney

BALL = FIXTURES / "v1" / "ball.goblin"


@pytest.fixture(scope="module")
def cross(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, spinney.Dataset]:
    """A solid of booleans in translated and mirrored coordinates, and an octree of it."""
    z, y, x = np.indices((30, 40, 50))
    solid = (abs(x - 25) < 6) & (abs(y - 20) < 15) | ((x - 25) ** 2 + (y - 20) ** 2 + (z - 15) ** 2 < 100)
    path = tmp_path_factory.mktemp("solid") / "t.goblin"
    matrix = [[0.5, 0, 0, 10], [0, -0.5, 0, 20], [0, 0, 0.5, 30], [0, 0, 0, 1]]
    spinney.build(solid, path, dims="zyx", transform=matrix)
    return solid, spinney.open(path)


def test_measures(cross: tuple) -> None:
    solid, ds = cross
    assert ds.ndim == 3 and ds.shape == solid.shape and ds.rule == "occupancy"
    assert ds.bounds == (10, 0, 30, 35, 20, 45) and ds.matrix[1].tolist() == [0, -0.5, 0, 20]
    assert np.array_equal(ds[...], solid * np.uint8(255))
    assert ds.volume() == solid.sum() / 8
    for level in range(ds.levels):
        # (Representatives are rounded once: that of the root is about 6.)
        assert ds.volume(level) == pytest.approx(solid.sum() / 8, rel=0.1)
    found = ds.solid(surface=True)
    faces = sum(np.diff(np.pad(solid, 1).astype(int), axis=axis).astype(bool).sum() for axis in range(3))
    assert found.block_area == pytest.approx(faces / 4) and 0 < found.area < found.block_area
    z, y, x = np.nonzero(solid)
    wanted = ds.matrix @ [x.mean() + 0.5, y.mean() + 0.5, z.mean() + 0.5, 1]
    assert found.centre == pytest.approx(wanted[:3])
    assert found.bounds == (10 + x.min() / 2, 20 - (y.max() + 1) / 2, 30, 10 + (x.max() + 1) / 2, 20 - y.min() / 2, 45)


def test_points_are_inside_or_not(cross: tuple) -> None:
    solid, ds = cross
    cells = np.random.default_rng(1).uniform(-5, 55, (3000, 3))
    points = cells @ ds.matrix[:3, :3].T + ds.matrix[:3, 3]
    x, y, z = np.floor(cells).astype(int).T
    inside = (np.floor(cells) >= 0).all(1) & (x < 50) & (y < 40) & (z < 30)
    wanted = np.zeros(3000, bool)
    wanted[inside] = solid[z[inside], y[inside], x[inside]]
    assert np.array_equal(ds.contains(points), wanted)


def test_rays_hit_cells(cross: tuple) -> None:
    solid, ds = cross
    # Straight down on every column.
    y, x = np.indices((40, 50)).reshape(2, -1)
    starts = np.stack([x + 0.5, y + 0.5, np.full_like(x, 100)], 1) @ ds.matrix[:3, :3].T + ds.matrix[:3, 3]
    hits = ds.rays(starts, (0, 0, -2))
    any_cell = solid.any(0)
    top = 30 - np.argmax(solid[::-1], axis=0)
    assert np.array_equal(hits.hit, any_cell.ravel())
    assert np.allclose(hits.distance[hits.hit], ((100 - top) / 4)[any_cell])
    assert np.array_equal(hits.cells[hits.hit], np.stack([x, y, top.ravel() - 1], 1)[hits.hit])
    assert np.allclose(hits.points[hits.hit][:, 2], 30 + top[any_cell] / 2) and (hits.cells[~hits.hit] == -1).all()
    smooth = ds.rays(starts, [(0, 0, -1)], smooth=True)
    assert np.nanmax(abs(smooth.points[:, 2] - hits.points[:, 2])) < 1
    with pytest.raises(ValueError):
        ds.rays([(0, 0, 0)], [(0, 0, 0)])


def test_slices(cross: tuple) -> None:
    solid, ds = cross
    full = solid * np.uint8(255)
    assert np.array_equal(ds.slice(z=7), full[7])
    assert np.array_equal(ds.slice(x=25), full[:, :, 25])
    assert np.array_equal(ds.slice(y=3), full[:, 3])
    assert np.array_equal(ds.slice(y=20 - 3.7 / 2, coordinates="world"), full[:, 3])
    assert ds.slice(z=4, level=3).shape == tuple(ds.level(3).shape[1:])
    for wrong in ({"z": 30}, {"x": -1}, {"y": 0.5}):
        with pytest.raises(IndexError):
            ds.slice(**wrong)
    with pytest.raises(ValueError):
        ds.slice(x=1, y=2)


def test_surfaces_are_closed_and_of_the_right_volume(cross: tuple, tmp_path: Path, program: str) -> None:
    solid, ds = cross
    for smooth in (False, True):
        vertices, faces = ds.mesh(smooth=smooth)
        assert vertices.dtype == np.float64 and faces.shape[1] == 3 and faces.max() == len(vertices) - 1
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        there, back = (sorted(map(tuple, pairs.tolist())) for pairs in (edges, edges[:, ::-1]))
        assert there == back
        a, b, c = vertices[faces].transpose(1, 0, 2)
        volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
        assert volume == pytest.approx(solid.sum() / 8, rel=1e-9 if not smooth else 0.1)
    ds.export(tmp_path / "ours.ply", smooth=True)
    run(program, "export", ds.path, tmp_path / "theirs.ply", "--smooth")
    assert (tmp_path / "ours.ply").read_bytes() == (tmp_path / "theirs.ply").read_bytes()
    assert len(ds.mesh(3).faces) < len(ds.mesh().faces)


def test_images(tmp_path: Path, program: str) -> None:
    with spinney.open(BALL) as ds:
        image = ds.render(size=(40, 30))
        assert image is not None and image.shape == (30, 40, 3) and image.dtype == np.uint8
        assert ds.render(size=(40, 30), background=None).shape == (30, 40, 4)
        ds.render(tmp_path / "ours.png", size=(80, 60), azimuth=100, elevation=20)
        run(program, "render", BALL, tmp_path / "theirs.png", "--size", "80x60", "--from", "100,20")
        assert (tmp_path / "ours.png").read_bytes() == (tmp_path / "theirs.png").read_bytes()
        assert ds._repr_png_().startswith(b"\x89PNG") and "octree" in repr(ds)
        with pytest.raises(ValueError):
            ds.read(out_shape=(4, 4))
