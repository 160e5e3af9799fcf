"""Trees built from arrays and trees on a Dask cluster: the bytes are those of one machine."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinney
import spinney.dask
from spinney import shards
from spinney._array_input import Chunks

from test_dask import client  # noqa: F401 (a fixture)
from test_shards import CLASSES, tiles

da = pytest.importorskip("dask.array")
xr = pytest.importorskip("xarray")


def squares(shape: tuple[int, ...], seed: int = 1) -> Any:
    """Returns numbers in squares of eight cells, some of which are uniform."""
    random = np.random.default_rng(seed)
    small = random.integers(0, 6, tuple(-(-length // 8) for length in shape), dtype=np.uint8)
    for axis in range(len(shape)):
        small = small.repeat(8, axis)
    return small[tuple(slice(length) for length in shape)]


def same(directory: Path) -> bool:
    return (directory / "merged.goblin").read_bytes() == (directory / "whole.goblin").read_bytes()


@pytest.mark.parametrize("codec", ["plain", "packed"])
def test_an_array_of_dask(tmp_path: Path, client: Any, codec: Any) -> None:  # noqa: F811
    cells = squares((1300, 1100))
    # Chunks that cross the borders of shards and blocks.
    array = da.from_array(cells, chunks=(300, 450))
    options: dict[str, Any] = {"codec": codec, "nodata": 3, "kind": "categorical", "transform": (2, 0, 5, 0, -2, 9), "crs": "EPSG:32633"}
    spinney.build(cells, tmp_path / "whole.goblin", **options)
    spinney.dask.build(array, tmp_path / "merged.goblin", client=client, shards=7, **options)
    assert same(tmp_path)
    # One shard, more shards than nodes, and an array that is persisted on the cluster.
    for count, source in [(1, array), (64, array), (5, array.persist())]:
        spinney.dask.build(source, tmp_path / "merged.goblin", client=client, shards=count, memory="32M", **options)
        assert same(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["merged.goblin", "whole.goblin"]


def test_bands_masks_and_octrees(tmp_path: Path, client: Any) -> None:  # noqa: F811
    bands = squares((3, 700, 900)).astype(np.float32)
    bands[:, 100:300, 50:80] = np.nan
    mask = squares((700, 900), 2) == 2
    spinney.build(bands, tmp_path / "whole.goblin", mask=mask, descriptions=["a", "b", "c"])
    lazy = da.from_array(bands, chunks=(1, 256, 400))
    spinney.dask.build(lazy, tmp_path / "merged.goblin", client=client, shards=4, mask=da.from_array(mask, chunks=200), descriptions=["a", "b", "c"])
    assert same(tmp_path)
    masked = np.ma.masked_equal(squares((500, 600), 3), 4)
    spinney.build(masked, tmp_path / "whole.goblin")
    spinney.dask.build(da.from_array(masked, chunks=170), tmp_path / "merged.goblin", client=client, shards=3)
    assert same(tmp_path)
    volume = squares((200, 300, 260), 4)
    spinney.build(volume, tmp_path / "whole.goblin", dims="zyx", codec="packed")
    spinney.dask.build(da.from_array(volume, chunks=90), tmp_path / "merged.goblin", client=client, shards=7, dims="zyx", codec="packed")
    assert same(tmp_path)
    with spinney.open(tmp_path / "merged.goblin") as tree:
        assert np.array_equal(tree.read()[0], volume)


def test_datasets_of_xarray(tmp_path: Path, client: Any) -> None:  # noqa: F811
    steps = {"y": 9000 - 10 * np.arange(640.0), "x": 500 + 10 * np.arange(800.0)}
    times = np.array(["2024-05-01", "2024-06-01"], dtype="datetime64[ns]")
    cube = xr.DataArray(
        np.stack([squares((640, 800), seed) for seed in (5, 6)]), dims=("time", "y", "x"), coords={"time": times, **steps}, name="cover", attrs={"nodata": 0}
    )
    spinney.build(cube, tmp_path / "whole.goblin")
    spinney.dask.build(cube.chunk({"y": 200, "x": 300}), tmp_path / "merged.goblin", client=client, shards=6)
    assert same(tmp_path)
    # From a store, chunk by chunk, and lazy without Dask.
    pytest.importorskip("zarr")
    cube.isel(time=0, drop=True).to_dataset().to_zarr(tmp_path / "cube.zarr")
    for chunks in ({}, None):
        with xr.open_zarr(tmp_path / "cube.zarr", chunks=chunks) as opened:
            spinney.build(opened["cover"], tmp_path / "whole.goblin")
            spinney.dask.build(opened["cover"], tmp_path / "merged.goblin", client=client, shards=5)
        assert same(tmp_path)
    layers = {"a": da.from_array(squares((500, 500), 7), chunks=200), "b": squares((250, 250), 8).astype(np.uint16)}
    spinney.build(layers, tmp_path / "whole.goblin")
    spinney.dask.build(layers, tmp_path / "merged.goblin", client=client, shards=4)
    assert same(tmp_path)


def test_a_job_of_arrays_goes_on_and_is_not_mixed(tmp_path: Path, client: Any) -> None:  # noqa: F811
    cells = squares((1300, 1100))
    spinney.build(cells, tmp_path / "whole.goblin")
    array = da.from_array(cells, chunks=300)
    broken = array.map_blocks(lambda block, block_info: 1 / 0 if block_info[0]["chunk-location"] == (4, 3) else block, dtype=np.uint8)
    job = tmp_path / "job"
    with pytest.raises(ZeroDivisionError):
        spinney.dask.build(broken, tmp_path / "merged.goblin", client=client, job=job, shards=6, retries=0)
    assert not (tmp_path / "merged.goblin").exists()
    # Another array than the job's.
    with pytest.raises((OSError, ValueError), match="job"):
        spinney.dask.build(array, tmp_path / "merged.goblin", client=client, job=job)
    # (Shards of arrays can only be built by a process that has the arrays.)
    left = shards.Job(job).missing()
    with pytest.raises((OSError, ValueError), match="arrays"):
        shards.Job(job).build(left[-1])
    spinney.dask.build(array, tmp_path / "merged.goblin", client=client, shards=6)
    assert same(tmp_path)
    with pytest.raises(TypeError, match="grid"):
        spinney.dask.build(array, tmp_path / "merged.goblin", client=client, grid="xyz")
    with pytest.raises(TypeError, match="iterator"):
        spinney.dask.build(iter([cells]), tmp_path / "merged.goblin", client=client)


def test_workers_that_are_killed_in_the_middle_of_arrays(tmp_path: Path, client: Any) -> None:  # noqa: F811
    cells = squares((1500, 1500), 3)
    spinney.build(cells, tmp_path / "whole.goblin")
    slow = da.from_array(cells, chunks=250).map_blocks(lambda block: (time.sleep(0.02), block)[1], dtype=np.uint8)
    stop = threading.Event()
    killed: list[int] = []

    def kill() -> None:
        directory = tmp_path / "merged.goblin.job" / "shards"
        while not stop.is_set() and (not directory.exists() or len(list(directory.glob("*.summary"))) < 3):
            time.sleep(0.01)
        pids = list(client.run(os.getpid).values())
        if pids and not stop.is_set():
            killed.append(pids[0])
            os.kill(pids[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        spinney.dask.build(slow, tmp_path / "merged.goblin", client=client, shards=16)
    finally:
        stop.set()
        killer.join()
    assert killed
    assert same(tmp_path)


def test_trees_are_transformed_and_combined(tmp_path: Path, client: Any) -> None:  # noqa: F811
    spinney.build(CLASSES, tmp_path / "island.goblin")
    paths = tiles(tmp_path / "tiles", side=700)
    for number in (0, 1):
        spinney.build(paths[number], tmp_path / f"{number}.goblin", nodata=number)
    steps = ["window=10,20,600,500", "rotate=90"]
    spinney.transform(tmp_path / "0.goblin", steps, tmp_path / "whole.goblin", codec="packed")
    spinney.dask.transform(tmp_path / "0.goblin", steps, tmp_path / "merged.goblin", client=client, shards=5, codec="packed")
    assert same(tmp_path)
    both = [tmp_path / "0.goblin", tmp_path / "1.goblin"]
    spinney.combine("xor", both, tmp_path / "whole.goblin", values="second")
    spinney.dask.combine("xor", both, tmp_path / "merged.goblin", client=client, shards=5, values="second")
    assert same(tmp_path)
    spinney.combine("not", both[:1], tmp_path / "whole.goblin", margin=5, fill=9)
    job = shards.plan_combine("not", both[:1], tmp_path / "job", shards=3, margin=5, fill=9)
    for number in job.missing():
        job.build(number)
    job.merge(tmp_path / "merged.goblin")
    assert same(tmp_path)
    with pytest.raises((OSError, ValueError), match="components=4"):
        shards.plan_transform(tmp_path / "island.goblin", "components=4", tmp_path / "other")


def test_tiles_are_those_of_one_machine(tmp_path: Path, client: Any) -> None:  # noqa: F811
    spinney.build(CLASSES, tmp_path / "island.goblin")
    with spinney.open(tmp_path / "island.goblin") as tree:
        count = tree.export(tmp_path / "whole.pmtiles", zoom=(0, 11), style="viridis")
        # In a single process, and in another order.
        for number in (2, 0, 1):
            tree.export(tmp_path / f"{number}.pmtiles", zoom=(0, 11), style="viridis", part=(number, 3))
        parts = [tmp_path / f"{number}.pmtiles" for number in range(3)]
        assert tree.export(tmp_path / "merged.pmtiles", zoom=(0, 11), style="viridis", parts=parts) == count
        with pytest.raises(ValueError, match="every part once"):
            tree.export(tmp_path / "other.pmtiles", zoom=(0, 11), style="viridis", parts=parts[:2])
        with pytest.raises((OSError, ValueError), match="another export"):
            tree.export(tmp_path / "other.pmtiles", zoom=(0, 10), style="viridis", parts=parts)
    whole = (tmp_path / "whole.pmtiles").read_bytes()
    assert (tmp_path / "merged.pmtiles").read_bytes() == whole
    done: list[tuple[int, int]] = []
    options: dict[str, Any] = {"client": client, "parts": 7, "zoom": (0, 11), "style": "viridis", "progress": lambda now, all: done.append((now, all))}
    assert spinney.dask.export_tiles(tmp_path / "island.goblin", tmp_path / "merged.pmtiles", **options) == count
    assert done[-1] == (7, 7)
    assert (tmp_path / "merged.pmtiles").read_bytes() == whole
    assert spinney.dask.export_tiles(tmp_path / "island.goblin", tmp_path / "map/{z}/{x}/{y}.png", client=client, parts=3, zoom=(0, 9)) > 9
    with spinney.open(tmp_path / "island.goblin") as tree:
        tree.export(tmp_path / "one/{z}/{x}/{y}.png", zoom=(0, 9))
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(tmp_path / "map") for path in (tmp_path / "map").rglob("*") if path.is_file())
    assert all((tmp_path / "one" / file).read_bytes() == (tmp_path / "map" / file).read_bytes() for file in files)
    assert not list(tmp_path.glob("*.job"))


def test_chunks_are_computed_once_while_there_is_memory() -> None:
    counted: list[tuple[int, ...]] = []

    def count(block: Any, block_info: Any) -> Any:
        counted.append(block_info[0]["chunk-location"])
        return block

    cells = squares((100, 130))
    array = da.from_array(cells, chunks=(30, 40), meta=np.empty((0, 0), np.uint8)).map_blocks(count, dtype=np.uint8, meta=np.empty((0, 0), np.uint8))
    chunks = Chunks(array, 1 << 20)
    chunks.scheduler = "single-threaded"
    for y in range(0, 100, 16):
        for x in range(0, 130, 16):
            key = (slice(y, min(y + 16, 100)), slice(x, min(x + 16, 130)))
            assert np.array_equal(chunks[key], cells[key])
    assert len(counted) == len(set(counted)) == 16
    # With little memory, chunks are computed again, and are still correct.
    few = Chunks(array, 2000)
    few.scheduler = "single-threaded"
    assert np.array_equal(few[10:90, 5:125], cells[10:90, 5:125])
    assert sum(chunk.nbytes for chunk in few.kept.values()) <= 2000
