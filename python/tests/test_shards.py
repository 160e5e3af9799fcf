"""Trees built by many processes: the bytes are those of one process."""

from __future__ import annotations

import concurrent.futures
import os
from pathlib import Path

import numpy as np
import pytest
import rasterio

import spinney
from spinney import shards

ROOT = Path(__file__).parents[2]
ELEVATION = ROOT / "fixtures/island_elevation.tif"
CLASSES = ROOT / "fixtures/island_classes.tif"


def tiles(directory: Path, side: int = 300, seed: int = 1) -> list[Path]:
    """Writes four adjacent rasters in their own directory."""
    directory.mkdir()
    random = np.random.default_rng(seed)
    paths = []
    for number in range(4):
        x, y = number % 2, number // 2
        path = directory / f"tile_{number}.tif"
        transform = rasterio.Affine(10, 0, 5000 + 10 * side * x, 0, -10, 9000 - 10 * side * y)
        with rasterio.open(path, "w", driver="GTiff", width=side, height=side, count=1, dtype="uint8", crs="EPSG:32633", transform=transform, tiled=True) as out:
            out.write(random.integers(0, 4, (side // 4, side // 4), dtype=np.uint8).repeat(4, 0).repeat(4, 1), 1)
        paths.append(path)
    return paths


@pytest.mark.parametrize("number", [1, 2, 7])
@pytest.mark.parametrize("codec", ["plain", "packed"])
def test_the_bytes_are_those_of_one_process(tmp_path: Path, number: int, codec: str) -> None:
    paths = tiles(tmp_path / "tiles")
    spinney.build(paths, tmp_path / "whole.goblin", kind="categorical", codec=codec)  # type: ignore[arg-type]
    job = shards.plan(paths, tmp_path / "job", shards=number, kind="categorical", codec=codec)  # type: ignore[arg-type]
    assert (job.shards, job.missing()) == (number, sorted(job.missing()))
    with concurrent.futures.ProcessPoolExecutor(2) as pool:
        assert not any(pool.map(job.build, job.missing()))
    assert job.missing() == []
    assert all(job.build(each) for each in range(number))
    job.merge(tmp_path / "merged.goblin")
    assert (tmp_path / "merged.goblin").read_bytes() == (tmp_path / "whole.goblin").read_bytes()


def test_layers_and_patterns(tmp_path: Path) -> None:
    spinney.build([ELEVATION, CLASSES], tmp_path / "whole.goblin", stack=True, names=["height", "cover"], times=["2020", np.datetime64("2021-05-01")])
    job = shards.plan([ELEVATION, CLASSES], tmp_path / "job", shards=3, stack=True, names=["height", "cover"], times=["2020", np.datetime64("2021-05-01")])
    for number in range(job.shards):
        job.build(number, threads=1)
    job.merge(tmp_path / "merged.goblin")
    assert (tmp_path / "merged.goblin").read_bytes() == (tmp_path / "whole.goblin").read_bytes()
    tiles(tmp_path / "tiles")
    assert shards.plan(str(tmp_path / "tiles" / "*.tif"), tmp_path / "other").input_bytes > 0
    with pytest.raises(FileNotFoundError):
        shards.plan(str(tmp_path / "nothing" / "*.tif"), tmp_path / "third")


def test_mismatched_inputs_are_rejected(tmp_path: Path) -> None:
    paths = tiles(tmp_path / "tiles")
    job = shards.plan(paths, tmp_path / "job", shards=4)
    with pytest.raises(ValueError, match="0 to 3 are missing"):
        job.merge(tmp_path / "merged.goblin")
    assert not (tmp_path / "merged.goblin").exists()
    # The same plan again, and another one.
    assert os.fspath(shards.plan(paths, tmp_path / "job", shards=4)) == os.fspath(job)
    with pytest.raises((OSError, ValueError), match="another job was planned"):
        shards.plan(paths[:2], tmp_path / "job", shards=4)
    # A changed input.
    os.utime(paths[0], ns=(1, 1))
    with pytest.raises(OSError, match="tile_0"):
        for number in job.missing():
            job.build(number)
    with pytest.raises(ValueError, match="without a job"):
        shards.Job(tmp_path / "none")
