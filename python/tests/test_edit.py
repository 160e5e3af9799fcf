"""Edits, history, and operations from files to files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from conftest import noise, run

import spinney


@pytest.fixture
def tree(tmp_path: Path) -> tuple[np.ndarray, str]:
    """An array, and an Autumnal tree of it."""
    array = noise((90, 110), "uint8")
    path = str(tmp_path / "map.autumn")
    spinney.build(array, path, transform=(2, 0, 0, 0, -2, 180), crs="EPSG:32628")
    return array, path


def test_a_block_is_one_commit(tree: tuple[np.ndarray, str]) -> None:
    array, path = tree
    with spinney.edit(path, message="All at once", author="Ann", time=1_700_000_000) as e:
        e.fill(7, window=(10, 20, 30, 5))
        e.fill(None, window=(0, 160, 20, 180), coordinates="world")
        e.set([(100, 80), (101, 81)], [1, 2])
        e.set(np.array([(0, 89)]), 3)
        e.set([(1, 89)], None)
        e.paste(np.full((4, 5), 9, "u1"), at=(50, 60))
        e.fill(5, polygon=[(100, 101.5), (140, 101.5), (140, 61.5)])
    wanted = np.ma.array(array.copy())
    wanted[20:25, 10:40] = 7
    wanted[:10, :10] = np.ma.masked
    wanted[80, 100], wanted[81, 101], wanted[89, 0], wanted[89, 1] = 1, 2, 3, np.ma.masked
    wanted[60:64, 50:55] = 9
    y, x = np.indices((90, 110)) + 0.5
    inside = (2 * x < 140) & (180 - 2 * y < 101.5) & (2 * x - 100 > 101.5 - (180 - 2 * y))
    wanted[inside] = 5
    with spinney.open(path) as ds:
        found = ds.read(1, masked=True)
        assert np.array_equal(found.mask, wanted.mask) and np.array_equal(found.compressed(), wanted.compressed())
        newest, first = ds.log()
        assert (newest.number, newest.message, newest.author, newest.time.timestamp()) == (2, "All at once", "Ann", 1_700_000_000)
        assert e.made == newest and first.number == 1 and spinney.log(path) == ds.log()
    assert np.array_equal(spinney.open(path, commit=1)[...], array) and np.array_equal(spinney.open(path + "@1")[...], array)
    assert not spinney.verify(path)


def test_an_exception_is_no_commit(tree: tuple[np.ndarray, str]) -> None:
    array, path = tree
    with pytest.raises(ZeroDivisionError):
        with spinney.edit(path) as e:
            e.fill(7, window=(0, 0, 50, 50))
            1 / 0  # noqa: B018
    with pytest.raises(ValueError):
        with spinney.edit(path) as e:
            e.fill(300, window=(0, 0, 50, 50))
    with spinney.edit(path) as e:
        pass
    assert e.made is None and len(spinney.log(path)) == 1 and np.array_equal(spinney.open(path)[...], array)
    with pytest.raises(ValueError):
        e.fill(1, window=(0, 0, 1, 1))


def test_wrong_edits(tree: tuple[np.ndarray, str], island: str) -> None:
    _, path = tree
    with pytest.raises((OSError, ValueError)):
        spinney.edit(island)
    with spinney.edit(path) as e:
        with pytest.raises(OSError, match="edit"):
            spinney.edit(path)
        for kind, change in [
            (ValueError, lambda: e.fill(1)),
            (ValueError, lambda: e.fill(1, window=(0, 0, 1, 1), block="/0")),
            (IndexError, lambda: e.fill(1, window=(109, 0, 2, 1))),
            (ValueError, lambda: e.fill(1, block="/9")),
            (IndexError, lambda: e.set([(-1, 0)], 1)),
            (ValueError, lambda: e.set([(0, 110)], 1)),
            (ValueError, lambda: e.set([(0, 1, 2)], 1)),
            (ValueError, lambda: e.set([(0, 1)], [1, 2])),
            (ValueError, lambda: e.paste(np.ones((2, 2), "u1"))),
            (TypeError, lambda: e.paste(np.ones((2, 2), "f4"), at=(0, 0))),
            (FileNotFoundError, lambda: e.paste("nowhere.goblin")),
            (ValueError, lambda: e.paste(path)),
            (ValueError, lambda: e.apply("nonsense", island)),
            (ValueError, lambda: e.revert(77)),
        ]:
            with pytest.raises(kind):
                change()
    assert len(spinney.log(path)) == 1


def test_pastes_and_operations(tree: tuple[np.ndarray, str], tmp_path: Path) -> None:
    array, path = tree
    patch = np.ma.masked_less(noise((40, 30), "uint8", 9), 50)
    spinney.build(patch, tmp_path / "patch.goblin", transform=(2, 0, 20, 0, -2, 100), crs="EPSG:32628")
    with spinney.edit(path) as e:
        e.paste(tmp_path / "patch.goblin")
    wanted = array.copy()
    wanted[40:80, 10:40] = np.where(patch.mask, wanted[40:80, 10:40], patch.data)
    assert np.array_equal(spinney.open(path)[...], wanted)
    with spinney.edit(path) as e:
        e.apply("a-b", tmp_path / "patch.goblin")
    found = spinney.open(path).read(1, masked=True)
    assert np.array_equal(found.mask[40:80, 10:40], ~patch.mask) and not found.mask[:40].any()
    with spinney.edit(path, "Back") as e:
        e.revert(1)
    assert np.array_equal(spinney.open(path)[...], array) and spinney.log(path)[0].message == "Back"
    with spinney.edit(path) as e:
        e.paste(spinney.open(f"{path}@2", view="window=0,0,20,20"), at=(80, 60))
    assert np.array_equal(spinney.open(path)[60:80, 80:100], wanted[:20, :20])
    with spinney.edit(path) as e:
        with pytest.raises(IndexError, match="extend beyond"):
            e.paste(patch, at=(-10, 70))
        e.paste(patch[:20, 10:], at=(0, 70), void=True)
    assert np.array_equal(spinney.open(path).read(1, masked=True)[70:, :20].filled(0), patch[:20, 10:].filled(0))


def test_from_files_to_files(tree: tuple[np.ndarray, str], tmp_path: Path, program: str) -> None:
    array, path = tree
    ours, theirs = tmp_path / "ours.goblin", tmp_path / "theirs.goblin"

    def same(words: list[object]) -> bool:
        run(program, *words, "-o", theirs)
        return ours.read_bytes() == theirs.read_bytes()

    made = spinney.transform(path, ["rotate=30", "crop"], ours)
    assert made.before == (array.size,) and same(["transform", path, "rotate=30", "crop"])
    spinney.transform(path, "window=5,6,40,30", tmp_path / "part.goblin")
    made = spinney.combine("xor", [path, tmp_path / "part.goblin"], ours)
    assert made.shape == array.shape and made.cells == array.size - 1200
    assert same(["combine", "xor", path, tmp_path / "part.goblin"])
    pairs = spinney.cross(path, tmp_path / "part.goblin")
    assert sum(cells for _, _, cells in pairs) == array.size
    with spinney.edit(path) as e:
        e.fill(77, window=(0, 0, 9, 9))
    differences = spinney.diff(f"{path}@1", path, ranges=True)
    assert differences.changed == (array[:9, :9] != 77).sum() and len(differences.ranges) == differences.runs
    assert differences and not spinney.diff(path, path)
    spinney.convert(path, ours)
    assert np.array_equal(spinney.open(ours)[...], spinney.open(path)[...])
    kept = spinney.compact(path, tmp_path / "small.autumn", keep=1)
    assert [commit.number for commit in kept] == [2] == [c.number for c in spinney.log(tmp_path / "small.autumn")]
    assert spinney.verify(path) == [] == spinney.verify(ours, quick=True)
    data = bytearray(ours.read_bytes())
    data[len(data) // 3] ^= 1
    ours.write_bytes(data)
    assert spinney.verify(ours)[0].problem
    for wrong in (lambda: spinney.transform(path, [], path), lambda: spinney.combine("or", [path], path), lambda: spinney.convert(path, path)):
        with pytest.raises(ValueError, match="input and the output"):
            wrong()
    with pytest.raises(ValueError):
        spinney.combine("nonsense", [path], ours)
    with pytest.raises(FileNotFoundError):
        spinney.diff(path, tmp_path / "none.goblin")
    assert os.path.exists(path)


def test_cells_are_assigned_to(tree: tuple[np.ndarray, str]) -> None:
    array, path = tree
    e = spinney.edit(path)
    assert (e.shape, e.dtype, e.ndim) == ((90, 110), np.uint8, 2)
    e[10:20, -30:] = np.arange(300).reshape(10, 30) % 251
    e[5] = 9
    e[..., 3] = np.ma.MaskedArray(np.full(90, 4), mask=np.arange(90) >= 80)
    made = e.commit()
    assert made is not None and made.number == 2 and e.commit() == made
    expected = np.ma.MaskedArray(array.copy(), mask=np.zeros(array.shape, bool))
    expected[10:20, -30:] = np.arange(300).reshape(10, 30) % 251
    expected[5] = 9
    expected[:80, 3] = 4
    expected[80:, 3] = np.ma.masked
    found = spinney.open(path).read(1, masked=True)
    assert np.array_equal(found.mask, expected.mask) and np.array_equal(found.compressed(), expected.compressed())
    e = spinney.edit(path)
    e[0, 0] = 200
    e.close()
    assert len(spinney.log(path)) == 2
    with pytest.raises(ValueError):
        e[0, 0] = 1


def test_invalid_edits_are_rejected(tree: tuple[np.ndarray, str]) -> None:
    _, path = tree
    part = np.ones((10, 10), np.uint8)
    with spinney.edit(path) as e:
        for at in [(105, 0), (0, 85), (-1, 0)]:
            with pytest.raises(IndexError, match="extend beyond"):
                e.paste(part, at=at)
        with pytest.raises(TypeError):
            e.paste(part, at=(1.7, 2))
        for key in [np.s_[::2], np.s_[0, 0, 0], 90, np.s_[0, 110]]:
            with pytest.raises(IndexError):
                e[key] = 1
        with pytest.raises(ValueError):
            e[0:2, 0:2] = np.ones((3, 3))
    assert e.made is None
    goblin = path.replace(".autumn", ".goblin")
    spinney.convert(path, goblin)
    with pytest.raises(ValueError, match="has no commits"):
        spinney.open(goblin, commit=2)
    with pytest.raises(ValueError, match="commit"):
        spinney.open(path, commit=7)


def test_blame_is_that_of_the_program(tree: tuple[np.ndarray, str], tmp_path: Path, program: str) -> None:
    array, path = tree
    with spinney.edit(path) as e:
        e[10:30, 20:50] = 255
    spinney.blame(path, tmp_path / "ours.goblin")
    run(program, "blame", path, "-o", tmp_path / "theirs.goblin")
    assert (tmp_path / "ours.goblin").read_bytes() == (tmp_path / "theirs.goblin").read_bytes()
    expected = np.ones(array.shape)
    expected[10:30, 20:50][array[10:30, 20:50] != 255] = 2
    assert np.array_equal(spinney.open(tmp_path / "ours.goblin")[...], expected)


def test_dask_stores_into_edits(tree: tuple[np.ndarray, str]) -> None:
    dask_array = pytest.importorskip("dask.array")
    array, path = tree
    with spinney.edit(path) as e:
        dask_array.store(dask_array.from_array(255 - array, chunks=(40, 50)), e)
    assert np.array_equal(spinney.open(path)[...], 255 - array) and spinney.log(path)[0].number == 2
    colours = path.replace("map", "colours")
    bands = np.stack([array, array // 2, array // 3])
    spinney.build(bands, colours)
    with spinney.edit(colours) as e:
        e[:, 5:9, 7:11] = np.full((3, 4, 4), 9, np.uint8)
        with pytest.raises(IndexError, match="bands"):
            e[1, 5:9, 7:11] = 1
    bands[:, 5:9, 7:11] = 9
    assert np.array_equal(spinney.open(colours).read(), bands)
