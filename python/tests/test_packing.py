"""Packed segments: the same cells in fewer bytes, in all functions that write trees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import FIXTURES

import spinney

CLASSES = str(FIXTURES / "island_classes.tif")


def patches() -> np.ndarray:
    """Returns patches of few values, in more than one segment."""
    rows, columns = np.mgrid[:600, :700]
    return ((rows // 7 * 31 + columns // 5 * 17) % 23).astype("u1")


def test_cells_are_the_same(tmp_path: Path) -> None:
    array = patches()
    paths = {name: tmp_path / f"{name}.goblin" for name in ("plain", "packed", "back", "moved", "both")}
    spinney.build(array, paths["plain"])
    spinney.build(array, paths["packed"], codec="packed")
    spinney.convert(paths["packed"], paths["back"])
    assert paths["back"].read_bytes() == paths["plain"].read_bytes()
    spinney.transform(paths["packed"], "mirror=x", paths["moved"], codec="packed")
    spinney.combine("and", [paths["packed"], paths["plain"]], paths["both"], codec="packed")
    for name in ("packed", "both"):
        assert paths[name].stat().st_size < paths["plain"].stat().st_size
        with spinney.open(paths[name]) as ds:
            assert np.array_equal(ds[...], array)
            positions = [(column, row) for row in range(0, 600, 37) for column in range(0, 700, 41)]
            assert [int(value[0]) for value in ds.sample(positions, coordinates="cells")] == [array[row, column] for column, row in positions]
        assert spinney.verify(paths[name]) == []
    with spinney.open(paths["moved"]) as ds:
        assert np.array_equal(ds[...], array[:, ::-1])


def test_files_and_layers(tmp_path: Path) -> None:
    plain, packed, stack = (tmp_path / f"{name}.goblin" for name in ("plain", "packed", "stack"))
    spinney.build(CLASSES, plain)
    spinney.build(CLASSES, packed, codec="packed")
    spinney.build(packed, tmp_path / "again.goblin", codec="packed", rule="nearest")
    spinney.build({"a": patches(), "b": patches()}, stack, codec="packed")
    assert packed.stat().st_size < plain.stat().st_size
    with spinney.open(plain) as a, spinney.open(packed) as b:
        assert np.array_equal(a[...], b[...]) and a.stats() == b.stats()
    assert spinney.verify(stack) == []


def test_exact_models_are_the_same(tmp_path: Path) -> None:
    plain, packed, both = (tmp_path / f"{name}.goblin" for name in ("plain", "packed", "both"))
    chapel = FIXTURES / "v1" / "chapel.goblin"
    spinney.build_brep(chapel, plain)
    spinney.build_brep(chapel, packed, codec="packed")
    spinney.combine("and", [packed, plain], both, codec="packed")
    for name in (packed, both):
        assert 3 * name.stat().st_size < 2 * plain.stat().st_size and spinney.verify(name) == []
        with spinney.open_brep(plain) as a, spinney.open_brep(name) as b:
            assert a.volume == pytest.approx(b.volume, rel=1e-12) and a.bounds == b.bounds
    with spinney.open_brep(plain) as a, spinney.open_brep(packed) as b:
        of_a, of_b = a.faces(), b.faces()
        assert all(np.array_equal(x, y) for i in range(len(a)) for x, y in zip(of_a.rings(i), of_b.rings(i), strict=True))
    with pytest.raises(ValueError, match="max_error"):
        spinney.combine("or", [plain, packed], both, codec="packed", max_error=1.0)


def test_invalid_options_are_rejected(tmp_path: Path) -> None:
    out = tmp_path / "t.goblin"
    with pytest.raises(ValueError, match="plain or packed"):
        spinney.build(patches(), out, codec="zip")  # type: ignore[arg-type]
    with pytest.raises(Exception, match="compact"):
        spinney.build(patches(), tmp_path / "t.autumn", codec="packed")
    assert list(tmp_path.iterdir()) == []


def test_history_is_packed(tmp_path: Path) -> None:
    path, plain, packed = (tmp_path / f"{name}.autumn" for name in ("t", "plain", "packed"))
    spinney.build(np.kron(patches(), np.ones((4, 4), np.uint8)), path)
    for number in range(4):
        with spinney.edit(path, message=f"{number}") as tree:
            tree[10 * number : 200, 7 : 90 + number] = number
    spinney.compact(path, plain, keep=9)
    commits = spinney.compact(path, packed, keep=9, pack=True)
    assert [commit.number for commit in commits] == [1, 2, 3, 4, 5]
    assert packed.stat().st_size < plain.stat().st_size
    for commit in commits:
        with spinney.open(f"{path}@{commit.number}") as a, spinney.open(f"{packed}@{commit.number}") as b:
            assert np.array_equal(a[...], b[...]) and a.stats() == b.stats()
    assert spinney.verify(packed) == []


def test_little_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "t.goblin"
    spinney.build(patches(), out, codec="packed")
    spinney.set_cache_memory(1)
    try:
        with spinney.open(out) as ds:
            assert np.array_equal(ds[...], patches())
    finally:
        spinney.set_cache_memory("64M")
