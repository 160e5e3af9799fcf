"""Trees of lines with heights, and of edges of meshes: NumPy and trimesh are the references."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import spinney

Points = npt.NDArray[np.float64]


def walks(seed: int, count: int) -> list[Points]:
    """Random walks, verticals and long lines, with two decimals."""
    rng = np.random.default_rng(seed)
    lines = []
    for number in range(count):
        start = rng.uniform(-100, 100, 3)
        if number % 5 == 0:
            line = np.array([start, start + [0, 0, -80]])
        elif number % 5 == 1:
            line = np.array([start, rng.uniform(-100, 100, 3)])
        else:
            line = start + np.cumsum(rng.normal(0, 4, (8, 3)), axis=0)
        lines.append(np.round(line, 2))
    return lines


def features(lines: list[Points]) -> list[dict[str, Any]]:
    return [{"type": "Feature", "properties": {"n": i}, "geometry": {"type": "LineString", "coordinates": line.tolist()}} for i, line in enumerate(lines)]


def to_points(points: Points, a: Points, b: Points) -> Points:
    """Distances of points from segments, by broadcasting."""
    along = b - a
    share = np.clip(np.sum((points - a) * along, -1) / np.maximum(np.sum(along * along, -1), 1e-300), 0, 1)
    distances: Points = np.linalg.norm(points - a - share[..., None] * along, axis=-1)
    return distances


def between(a: Points, b: Points, c: Points, d: Points) -> Points:
    """Distances between segments: at ends, or where both parameters of the common normal are
    inside."""
    p, q, r = b - a, d - c, a - c
    pp, qq, pq, pr, qr = (np.sum(x * y, -1) for x, y in [(p, p), (q, q), (p, q), (p, r), (q, r)])
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (pq * qr - qq * pr) / (pp * qq - pq * pq), (pp * qr - pq * pr) / (pp * qq - pq * pq)
        inside = (s > 0) & (s < 1) & (t > 0) & (t < 1)
        middle = np.where(inside, np.linalg.norm(r + s[..., None] * p - t[..., None] * q, axis=-1), np.inf)
    ends = [to_points(a, c, d), to_points(b, c, d), to_points(c, a, b), to_points(d, a, b)]
    distances: Points = np.minimum(middle, np.minimum.reduce(ends))
    return distances


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    path = tmp_path / "walks.goblin"
    built = spinney.build_lines({"type": "FeatureCollection", "features": features(walks(3, 300))}, path, crs="EPSG:25833", leaf_size=20)
    assert built.features == 300
    return path


def test_queries_are_those_of_numpy(tree: Path) -> None:
    lines = walks(3, 300)
    rng = np.random.default_rng(4)
    with spinney.open_lines(tree) as opened:
        assert opened.axes == 3
        low, high = np.concatenate(lines).min(0), np.concatenate(lines).max(0)
        assert opened.bounds == (*low, *high)
        assert opened.length == pytest.approx(sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines), rel=1e-12)
        assert [np.array_equal(np.array(row["geometry"]["coordinates"]), line) for row, line in zip(opened.features(), lines)] == [True] * 300
        points = rng.uniform(-120, 120, (50, 3))
        expected = np.array([[to_points(point, line[:-1], line[1:]).min() for line in lines] for point in points])
        distances, numbers, positions = opened.nearest(points, k=3)
        assert np.array_equal(numbers, np.argsort(expected, axis=1)[:, :3])
        np.testing.assert_allclose(distances, np.sort(expected, axis=1)[:, :3], rtol=1e-5)
        # (Points are rounded to 2^-16 of a grid unit.)
        np.testing.assert_allclose(np.linalg.norm(positions - points[:, None], axis=2), distances, atol=1e-6)
        # In the plane, with rows of x and y.
        flat = np.array([[to_points(point[:2], line[:-1, :2], line[1:, :2]).min() for line in lines] for point in points])
        distances, numbers, positions = opened.nearest(points[:, :2])
        np.testing.assert_allclose(distances[:, 0], flat.min(axis=1), rtol=1e-4, atol=1e-6)
        assert positions.shape == (50, 1, 3)


def test_crossings_within_a_distance_are_those_of_numpy(tree: Path) -> None:
    lines, others = walks(3, 300), walks(5, 20)
    with spinney.open_lines(tree) as opened:
        found = opened.crossings(others, radius=12.5)
        pairs = set(zip(found.features.tolist(), found.lines.tolist()))
        expected = {
            (i, j): between(line[:-1, None], line[1:, None], other[:-1], other[1:]).min() for i, line in enumerate(lines) for j, other in enumerate(others)
        }
        assert pairs == {pair for pair, distance in expected.items() if distance <= 12.5}
        assert len(pairs) > 50
        for pair in pairs:
            own = found.distances[(found.features == pair[0]) & (found.lines == pair[1])]
            assert own.min() == pytest.approx(expected[pair], rel=1e-4, abs=1e-6)
        # Lines of features meet themselves, and their ends do.
        meets = opened.crossings(lines[7])
        assert 7 in meets.features and (meets.distances == 0).all()
        assert len(opened.crossings([(0, 0, 500), (1, 1, 500)])) == 0
        assert len(opened.features(crossing=others, radius=12.5)) == len({i for i, _ in pairs})
        with pytest.raises(ValueError, match="crossing"):
            opened.features(radius=12.5)
        with pytest.raises(ValueError, match="at least 0"):
            opened.crossings(others, radius=-1)


def test_windows_have_two_or_three_axes(tree: Path) -> None:
    lines = walks(3, 300)
    with spinney.open_lines(tree) as opened:
        # Each vertex is in the window around it.
        for number, line in list(enumerate(lines))[::10]:
            x, y, z = line[0]
            assert number in opened.find((x, y, z, x, y, z))
            assert number in opened.find((x, y, x, y))
            assert number not in opened.find((x, y, line[:, 2].max() + 1, x, y, line[:, 2].max() + 2))
        with pytest.raises(ValueError, match="4 or 6"):
            opened.find((0, 0, 1))


def test_edges_are_those_of_trimesh(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.icosphere(subdivisions=3)
    mesh.vertices = np.round(mesh.vertices * 100, 2)
    mesh.update_faces(np.arange(len(mesh.faces)) % 7 != 0)
    path, out = tmp_path / "sphere.ply", tmp_path / "edges.goblin"
    mesh.export(path)
    built = spinney.build_lines(path, out)
    edges = mesh.edges_unique
    counts = np.bincount(mesh.edges_unique_inverse)
    assert built.features == built.segments == len(edges)
    assert built.length == pytest.approx(mesh.edges_unique_length.sum(), rel=1e-5)
    with spinney.open_lines(out) as opened:
        rows = opened.features()
        found = {tuple(sorted(map(tuple, np.round(row["geometry"]["coordinates"], 2)))): row["properties"]["faces"] for row in rows}
        expected = {tuple(sorted(map(tuple, np.round(mesh.vertices[edge], 2)))): count for edge, count in zip(edges, counts)}
        assert found == expected
        assert opened.attributes == ["object", "faces"]
