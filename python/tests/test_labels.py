"""Tables of labels against sums over arrays; regions as polygons."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import spinney


def touching(cells: np.ndarray) -> dict[tuple[int, int], int]:
    """Returns the faces that each pair of labels shares, in both orders; 0 is VOID."""
    found: dict[tuple[int, int], int] = {}
    for axis in range(cells.ndim):
        low, high = (np.moveaxis(cells, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
        for a, b in zip(low.ravel().tolist(), high.ravel().tolist()):
            if a != b and a and b:
                found[a, b] = found.get((a, b), 0) + 1
                found[b, a] = found.get((b, a), 0) + 1
    return found


@pytest.mark.parametrize("shape", [(90, 130), (20, 33, 17)])
def test_labels(tmp_path: Path, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(5)
    cells = np.kron(rng.integers(0, 5, [-(-n // 4) for n in shape]), np.ones([4] * len(shape), int))[tuple(slice(n) for n in shape)]
    cells = cells.astype(np.uint16)
    path = tmp_path / "cells.goblin"
    dims = "yx" if cells.ndim == 2 else "zyx"
    spinney.build(cells, path, dims=dims, nodata=0, kind="categorical", crs="EPSG:32632", transform=(2, 0, 10, 0, -2, 20) if cells.ndim == 2 else None)
    ds = spinney.open(path)
    table = ds.labels()
    assert table.labels.dtype == np.uint16 and table.labels.tolist() == [1, 2, 3, 4] and len(table) == 4
    assert table.classes is None
    assert table.cells.tolist() == [int((cells == label).sum()) for label in table.labels]
    assert np.array_equal(table.areas, table.cells * (4.0 if cells.ndim == 2 else 1.0))
    for label, box in zip(table.labels, table.boxes):
        positions = np.argwhere(cells == label)[:, ::-1]
        assert box.tolist() == [*positions.min(axis=0), *(positions.max(axis=0) - positions.min(axis=0) + 1)]
    expected = touching(cells)
    assert dict(zip(map(tuple, table.pairs.tolist()), table.edges.tolist())) == expected
    assert list(map(tuple, table.pairs.tolist())) == sorted(expected)

    ways = 4 if cells.ndim == 2 else 6
    labels = tmp_path / "labels.goblin"
    spinney.transform(path, f"components={ways}", labels)
    components = ds.labels(connect=ways, memory="64K")
    assert components.labels.dtype == np.uint64 and components.classes is not None
    with spinney.open(labels) as other:
        made = other.labels(classes=ds)
        assert made.classes is not None and np.array_equal(made.classes, components.classes)
        for name in ("labels", "cells", "areas", "boxes", "world", "pairs", "edges"):
            assert np.array_equal(getattr(made, name), getattr(components, name)), name
        read = other.read(fill=0)
        read = read[0] if read.ndim > cells.ndim else read
    for label, value in zip(components.labels, components.classes):
        assert (cells[read == label] == value).all()
    assert len(ds.labels(connect=ways, neighbours=False).pairs) == 0
    with pytest.raises(ValueError, match="connect and classes"):
        ds.labels(connect=ways, classes=ds)
    with pytest.raises(ValueError):
        ds.labels(connect=5)


def test_polygons(tmp_path: Path) -> None:
    cells = np.array([[1, 0, 1, 2], [0, 1, 2, 2], [1, 0, 1, 0]], np.uint8)
    spinney.build(cells, tmp_path / "map.goblin", nodata=0, kind="categorical", crs="EPSG:32633", transform=(10, 0, 0, 0, -10, 30))
    ds = spinney.open(tmp_path / "map.goblin")
    path = tmp_path / "regions.geojson"
    assert ds.export(path, polygons=True) == len(ds.labels(connect=4)) == 6
    assert ds.export(path, polygons=True, connect=8) == len(ds.labels(connect=8)) == 2
    features = json.loads(path.read_text())["features"]
    assert sorted(feature["properties"]["area_m2"] for feature in features) == [300, 500]
    assert ds.export(path, polygons=True, classes=[2]) == 1
    assert ds.export(path, polygons=True, level=1, simplify=1.0) > 0
    for directions in (4, 8):
        chains = tmp_path / "regions.chain"
        assert ds.export(chains, connect=8, directions=directions) == 2
        spinney.build(chains, tmp_path / "again.goblin")
        assert (spinney.open(tmp_path / "again.goblin").read(fill=0) == cells).all()
    with pytest.raises(TypeError):
        ds.export(path, polygons=True, directions=8)
    with pytest.raises(ValueError):
        ds.export(path, polygons=True, connect=6)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        ds.export(path, connect=8)
    with pytest.raises(TypeError):
        ds.export(path, polygons=True, zoom=3)
