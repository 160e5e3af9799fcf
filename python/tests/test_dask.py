"""Jobs on a Dask cluster: results are those of one machine, also if workers die."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import spinney
import spinney.dask
from spinney import shards

from test_shards import CLASSES, ROOT, tiles

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_builds_are_those_of_one_machine(tmp_path: Path, client: Any) -> None:
    paths = tiles(tmp_path / "tiles")
    spinney.build(paths, tmp_path / "whole.goblin", codec="packed")
    done: list[tuple[int, int]] = []
    spinney.dask.build(paths, tmp_path / "merged.goblin", client=client, shards=5, codec="packed", progress=lambda now, all: done.append((now, all)))
    assert (tmp_path / "merged.goblin").read_bytes() == (tmp_path / "whole.goblin").read_bytes()
    assert done[-1][0] == done[-1][1] > 0
    # No file of the job is left.
    assert sorted(path.name for path in tmp_path.iterdir()) == ["merged.goblin", "tiles", "whole.goblin"]


def test_a_cancelled_run_is_resumed(tmp_path: Path, client: Any) -> None:
    paths = tiles(tmp_path / "tiles")
    spinney.build(paths, tmp_path / "whole.goblin")
    job = shards.plan(paths, tmp_path / "job", shards=6)
    made = job.missing()[:2]
    for number in made:
        job.build(number)
    left = len(job.missing())
    done: list[tuple[int, int]] = []
    spinney.dask.build(paths, tmp_path / "merged.goblin", client=client, job=tmp_path / "job", progress=lambda now, all: done.append((now, all)))
    assert done[-1] == (left, left)
    assert (tmp_path / "merged.goblin").read_bytes() == (tmp_path / "whole.goblin").read_bytes()


def test_a_killed_worker_loses_only_its_shards(tmp_path: Path, client: Any) -> None:
    paths = tiles(tmp_path / "tiles", side=1600)
    spinney.build(paths, tmp_path / "whole.goblin", codec="packed")
    stop = threading.Event()
    killed: list[int] = []

    def kill() -> None:
        directory = tmp_path / "job" / "shards"
        # (As soon as some shards exist, and again later.)
        for least in (1, 5):
            while not stop.is_set() and (not directory.exists() or len(list(directory.glob("*.summary"))) < least):
                time.sleep(0.01)
            # One worker stays: a cluster does not always replace all of them on a busy machine, and
            # tasks then wait for workers.
            while not stop.is_set() and len(pids := list(client.run(os.getpid).values())) < 2:
                time.sleep(0.1)
            if not stop.is_set():
                killed.append(pids[least % len(pids)])
                os.kill(killed[-1], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        spinney.dask.build(paths, tmp_path / "merged.goblin", client=client, job=tmp_path / "job", shards=16, codec="packed")
    finally:
        stop.set()
        killer.join()
    assert killed
    assert (tmp_path / "merged.goblin").read_bytes() == (tmp_path / "whole.goblin").read_bytes()


def test_failures_are_raised(tmp_path: Path, client: Any) -> None:
    paths = tiles(tmp_path / "tiles")
    paths[1].write_bytes(paths[1].read_bytes()[:5000])
    with pytest.raises((OSError, ValueError), match="tile_1"):
        spinney.dask.build(paths, tmp_path / "merged.goblin", client=client, job=tmp_path / "job", shards=4, retries=0)
    # Only the job is left, for another attempt.
    assert (tmp_path / "job" / "plan.json").exists()
    assert not (tmp_path / "merged.goblin").exists()


def test_zones_are_those_of_one_machine(tmp_path: Path, client: Any) -> None:
    spinney.build(CLASSES, tmp_path / "island.goblin")
    districts = ROOT / "fixtures/island_districts.geojson"
    with spinney.open(tmp_path / "island.goblin") as tree:
        expected = tree.zonal(districts, ["count", "classes"], edge="area")
        assert len(expected) > 1
    found = spinney.dask.zonal(tmp_path / "island.goblin", districts, ["count", "classes"], client=client, parts=2, edge="area")
    assert found == expected
    assert spinney.dask.zonal(tmp_path / "island.goblin", [], client=client) == []
    with pytest.raises(ValueError, match="not GeoJSON"):
        spinney.dask.zonal(tmp_path / "island.goblin", "zones.gpkg", client=client)
