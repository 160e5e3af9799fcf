"""Threads, processes, memory."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import spinney


def part_sum(ds: spinney.Dataset, row: int) -> int:
    """Returns the sum of a region, in another process."""
    return int(ds[row : row + 20].astype(int).sum()) + ds.stats().cells


@pytest.mark.parametrize("method", ["spawn", "fork", "forkserver"])
def test_datasets_are_pickled_to_processes(island: str, method: str) -> None:
    ds = spinney.open(island, view=["window=10,10,200,150"])
    # (Threads of the parent do not exist in forked processes.)
    spinney.transform(island, "depth=5", os.path.dirname(island) + "/t.goblin")
    wanted = [part_sum(ds, row) for row in range(0, 100, 20)]
    context = multiprocessing.get_context(method)
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        assert list(pool.map(part_sum, [ds] * 5, range(0, 100, 20))) == wanted


def test_pickles_keep_the_commit(history: str) -> None:
    ds = spinney.open(history)
    with spinney.edit(history) as e:
        e.fill(9, window=(0, 0, 5, 5))
    copy = pickle.loads(pickle.dumps(ds))
    assert copy.commit == ds.commit and np.array_equal(copy[...], ds[...])
    assert spinney.open(history).commit == ds.commit + 1 and ds.refresh() and not ds.refresh()
    assert (ds[:5, :5] == 9).all() and not (copy[:5, :5] == 9).all()


def test_forked_processes_build_and_measure(island: str, tmp_path: Path) -> None:
    array = np.arange(700 * 600, dtype="u2").reshape(700, 600)
    # The parent's threads exist now, and will not in the child.
    spinney.build(array, tmp_path / "parent.goblin")
    ds = spinney.open(island)
    child = os.fork()
    if child == 0:
        try:
            spinney.build(array, tmp_path / "child.goblin")
            spinney.transform(island, ["rotate=30", "crop"], tmp_path / "turned.goblin")
            good = np.array_equal(ds[...], spinney.open(island)[...])
            os._exit(0 if good else 1)
        except BaseException:
            os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert (tmp_path / "child.goblin").read_bytes() == (tmp_path / "parent.goblin").read_bytes()


EDITOR = """
import sys, spinney
for number in range(30):
    with spinney.edit(sys.argv[1], message=str(number)) as e:
        e.fill(number, window=(0, 0, 64, 64))
"""


def test_eight_threads_read_while_another_process_edits(tmp_path: Path) -> None:
    path = str(tmp_path / "map.autumn")
    spinney.build(np.full((64, 64), 99, "u1"), path)
    ds = spinney.open(path)
    editor = subprocess.Popen([sys.executable, "-P", "-c", EDITOR, path])

    def read(_: int) -> int:
        seen = 0
        while editor.poll() is None or seen < 50:
            own = spinney.open(path)
            for tree in (own, ds):
                cells = tree[...]
                # Readers see a commit completely.
                assert (cells == cells[0, 0]).all()
                found = tree.stats()
                assert found.min == found.max and found.cells == 64 * 64
            ds.refresh()
            seen += 1
        return seen

    with ThreadPoolExecutor(8) as pool:
        assert all(seen >= 50 for seen in pool.map(read, range(8)))
    assert editor.wait() == 0
    ds.refresh()
    assert (ds[...] == 29).all() and len(ds.log()) == 31


def test_threads_share_one_dataset(relief: str) -> None:
    ds = spinney.open(relief)
    whole = ds.read(1)

    def read(seed: int) -> None:
        random = np.random.default_rng(seed)
        for _ in range(300):
            y, x = random.integers(0, 100, 2)
            assert np.array_equal(ds[y : y + 50, x : x + 50], whole[y : y + 50, x : x + 50], equal_nan=True)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(read, range(8)))


def resident() -> int:
    """Returns the resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="there is no /proc")
@pytest.mark.parametrize("positioned", [False, True])
def test_nothing_is_leaked(island: str, positioned: bool) -> None:
    def round() -> None:
        with spinney.open(island, positioned=positioned) as ds:
            ds.read(1, window=(10, 10, 100, 100), masked=True)
            ds[3:9, ::2]
            ds.colormap, ds.kind
            try:
                ds.read(7)
            except IndexError:
                pass

    for _ in range(500):
        round()
    before = resident()
    # (A leak of 400 bytes per round would be too much.)
    for _ in range(3000):
        round()
    assert resident() - before < 5 << 18
