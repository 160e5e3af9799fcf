"""Jobs whose rasters, directories and outputs are in buckets: the bytes are those of one process,
whatever fails meanwhile.
"""

from __future__ import annotations

import concurrent.futures
import itertools
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

import spinney
import spinney.dask
from spinney import shards

from conftest import ROOT
from test_shards import ELEVATION, tiles

sys.path.insert(0, str(ROOT / "tests" / "servers"))
from bucket import Bucket, bucket  # noqa: E402
from ranges import serve  # noqa: E402

pytest.importorskip("moto.server")
pytest.importorskip("boto3")


@pytest.fixture(scope="module")
def maps(program: str) -> Iterator[Bucket]:
    said = subprocess.run([program, "info", "s3://none/none.goblin"], capture_output=True, text=True).stderr
    if "support for remote files" in said:
        pytest.skip("the program was built without `remote`")
    with bucket() as maps:
        yield maps


class Runner:
    """Runs the program with the bucket."""

    def __init__(self, program: str, maps: Bucket) -> None:
        self.program, self.maps = program, maps
        own = {name: value for name, value in os.environ.items() if not name.startswith("AWS_")}
        self.environment = {**own, **maps.environment}

    def __call__(self, *words: object, **environment: str) -> str:
        """Runs a subcommand that must succeed; returns its messages."""
        done = self.start(*words, **environment)
        said = done.communicate(timeout=120)[1]
        assert done.returncode == 0, (words, said)
        return said

    def fails(self, *words: object, **environment: str) -> str:
        """Runs a subcommand that must fail; returns its messages."""
        done = self.start(*words, **environment)
        said = done.communicate(timeout=120)[1]
        assert done.returncode == 1, (words, done.returncode, said)
        return said

    def start(self, *words: object, **environment: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [self.program, *map(str, words)], env={**self.environment, **environment}, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )


@pytest.fixture
def run(program: str, maps: Bucket) -> Iterator[Runner]:
    yield Runner(program, maps)
    maps.mend()
    for name in maps.names():
        maps.client.delete_object(Bucket="maps", Key=name)


def read(maps: Bucket, place: object) -> bytes:
    """Returns the bytes of a local file or of one in the bucket."""
    name = str(place)
    return maps.get(name.removeprefix("s3://maps/")) if name.startswith("s3:") else Path(name).read_bytes()


def put_tiles(maps: Bucket, directory: Path, **options: Any) -> list[str]:
    return [maps.put(f"in/{path.name}", path.read_bytes()) for path in tiles(directory, **options)]


def noise(path: Path, side: int) -> Path:
    """Writes a raster that does not get smaller as a tree."""
    samples = np.random.default_rng(1).integers(0, 256, (side, side), dtype=np.uint8)
    with rasterio.open(path, "w", driver="GTiff", width=side, height=side, count=1, dtype="uint8", tiled=True, nodata=0) as out:
        out.write(samples, 1)
    return path


@pytest.mark.parametrize("positions", list(itertools.product(["here", "there"], repeat=3)), ids="-".join)
def test_the_bytes_are_those_of_one_process(tmp_path: Path, maps: Bucket, run: Runner, positions: tuple[str, str, str]) -> None:
    near = tiles(tmp_path / "tiles")
    sources: list[Any] = near if positions[0] == "here" else [maps.put(f"in/{path.name}", path.read_bytes()) for path in near]
    job, out = (f"s3://maps/{name}" if place == "there" else tmp_path / name for place, name in zip(positions[1:], ["job", "out.goblin"], strict=True))
    run("build", *sources, "-o", tmp_path / "whole.goblin", "--kind", "categorical", "--codec", "packed")
    run("shard", "plan", *sources, "-o", job, "--shards", 5, "--kind", "categorical", "--codec", "packed")
    for number in range(5):
        run("shard", "build", job, number)
    run("shard", "merge", job, "-o", out)
    assert read(maps, out) == (tmp_path / "whole.goblin").read_bytes()
    assert not maps.uploads()


@pytest.mark.parametrize("shards", [1, 2, 7, 64])
def test_any_number_of_shards(tmp_path: Path, maps: Bucket, run: Runner, shards: int) -> None:
    urls = put_tiles(maps, tmp_path / "tiles")
    run("build", *urls, "-o", tmp_path / "whole.goblin")
    run("shard", "plan", *urls, "-o", "s3://maps/job/", "--shards", shards)
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda number: run("shard", "build", "s3://maps/job/", number), range(shards)))
    run("shard", "merge", "s3://maps/job", "-o", "s3://maps/out.goblin")
    assert maps.get("out.goblin") == (tmp_path / "whole.goblin").read_bytes()
    # Existing shards are not built again.
    before = {name: maps.client.head_object(Bucket="maps", Key=name)["LastModified"] for name in maps.names("job/")}
    maps.counts()
    assert "was built already" in run("shard", "build", "s3://maps/job", 0)
    assert "planned before" in run("shard", "plan", *urls, "-o", "s3://maps/job", "--shards", shards)
    assert "PUT" not in maps.counts()
    assert before.keys() == set(maps.names("job/"))


def test_layers_formats_and_sidecar_files(tmp_path: Path, maps: Bucket, run: Runner) -> None:
    # A virtual raster of two images, one of which has a world file, a coordinate system and a
    # sidecar file, and an image that is read top down.
    samples = np.random.default_rng(2).integers(0, 255, (120, 160), dtype=np.uint8)
    for name, driver in [("a.png", "PNG"), ("b.tif", "GTiff")]:
        with rasterio.open(tmp_path / name, "w", driver=driver, width=160, height=120, count=1, dtype="uint8") as out:
            out.write(samples, 1)
    (tmp_path / "a.pgw").write_text("10\n0\n0\n-10\n500005\n4999995\n")
    (tmp_path / "a.prj").write_text(rasterio.CRS.from_epsg(32633).to_wkt())
    (tmp_path / "b.tif.aux.xml").write_text("<PAMDataset><Metadata><MDI key='made'>by hand</MDI></Metadata></PAMDataset>")
    band = "".join(
        f"<SimpleSource><SourceFilename relativeToVRT='1'>{name}</SourceFilename><SrcRect xOff='0' yOff='0' xSize='160' ySize='120'/>"
        f"<DstRect xOff='{160 * place}' yOff='0' xSize='160' ySize='120'/></SimpleSource>"
        for place, name in enumerate(["a.png", "b.tif"])
    )
    text = f"<VRTDataset rasterXSize='320' rasterYSize='120'><VRTRasterBand dataType='Byte' band='1'>{band}</VRTRasterBand></VRTDataset>"
    (tmp_path / "both.vrt").write_text(text)
    for path in [path for path in tmp_path.iterdir() if path.is_file()]:
        maps.put(f"in/{path.name}", path.read_bytes())
    for name in ["a.png", "b.tif", "both.vrt"]:
        near, far = tmp_path / name, f"s3://maps/in/{name}"
        run("build", far, "-o", tmp_path / "far.goblin")
        run("build", near, "-o", tmp_path / "near.goblin")
        outputs = [subprocess.run([run.program, "stats", "--json", tmp_path / tree], capture_output=True, text=True).stdout for tree in ("far.goblin", "near.goblin")]
        assert outputs[0].replace("far.goblin", "near.goblin") == outputs[1]
        run("shard", "plan", far, "-o", f"s3://maps/job-{name}", "--shards", 2)
        files = maps.get(f"job-{name}/plan.json").decode()
        assert ("a.pgw" in files and "a.prj" in files) == (name != "b.tif") and ("b.tif.aux.xml" in files) == (name != "a.png")
        for number in range(2):
            run("shard", "build", f"s3://maps/job-{name}", number)
        run("shard", "merge", f"s3://maps/job-{name}", "-o", f"s3://maps/{name}.goblin")
        assert maps.get(f"{name}.goblin") == (tmp_path / "far.goblin").read_bytes()
    # A sidecar file that was added after planning is a changed input.
    maps.put("in/both.prj", b"")
    run("shard", "plan", "s3://maps/in/b.tif", "-o", "s3://maps/other", "--shards", 1)
    maps.put("in/b.tfw", b"10\n0\n0\n-10\n5\n-5\n")
    assert "b.tfw" in run.fails("shard", "build", "s3://maps/other", 0)


def test_rasters_of_a_web_server(tmp_path: Path, maps: Bucket, run: Runner) -> None:
    tiles(tmp_path / "tiles")
    with serve(tmp_path / "tiles") as server:
        urls = [f"{server.url}/tile_{number}.tif?signature=a.b/c" for number in range(4)]
        run("build", *urls, "-o", tmp_path / "whole.goblin")
        run("shard", "plan", *urls, "-o", tmp_path / "job", "--shards", 3)
        # URL queries, which may be signatures, are not in the plan.
        assert "--signed-urls" in run.fails("shard", "build", tmp_path / "job", 0)
        signed = tmp_path / "signed.txt"
        signed.write_text("\n".join(urls))
        given = {"SPINNEY_SIGNED_URLS": str(signed)}
        for number in range(3):
            run("shard", "build", tmp_path / "job", number, **given)
        run("shard", "merge", tmp_path / "job", "-o", "s3://maps/out.goblin")
        assert maps.get("out.goblin") == (tmp_path / "whole.goblin").read_bytes()
        # Another version of a raster.
        run("shard", "plan", *urls, "-o", tmp_path / "other", "--shards", 1)
        os.utime(tmp_path / "tiles" / "tile_2.tif", ns=(1, 1))
        assert "tile_2" in run.fails("shard", "build", tmp_path / "other", 0, **given)


def test_trees_in_buckets_are_transformed_and_combined(tmp_path: Path, maps: Bucket, run: Runner) -> None:
    run("build", ELEVATION, "-o", "s3://maps/a.goblin")
    for name, plan, whole in [
        ("part", ["plan-transform", "s3://maps/a.goblin", "window=31,17,150,120"], ["transform", "s3://maps/a.goblin", "window=31,17,150,120"]),
        ("less", ["plan-combine", "a-b", "s3://maps/a.goblin", tmp_path / "part.goblin"], ["combine", "a-b", "s3://maps/a.goblin", tmp_path / "part.goblin"]),
    ]:
        run(*whole, "-o", tmp_path / f"{name}.goblin")
        run("shard", *plan, "-o", f"s3://maps/{name}", "--shards", 3)
        for number in range(3):
            run("shard", "build", f"s3://maps/{name}", number)
        run("shard", "merge", f"s3://maps/{name}", "-o", f"s3://maps/{name}.goblin")
        assert maps.get(f"{name}.goblin") == (tmp_path / f"{name}.goblin").read_bytes()


def test_other_inputs_than_planned_are_refused(tmp_path: Path, maps: Bucket, run: Runner) -> None:
    urls = put_tiles(maps, tmp_path / "tiles")
    run("shard", "plan", *urls, "-o", "s3://maps/job", "--shards", 1)
    same = maps.get("in/tile_1.tif")
    other = bytearray(same)
    other[-1] ^= 1
    maps.put("in/tile_1.tif", bytes(other))
    said = run.fails("shard", "build", "s3://maps/job", 0)
    assert "in/tile_1.tif" in said and "with tag" in said and "was planned" in said
    assert not maps.names("job/shards/")
    maps.client.delete_object(Bucket="maps", Key="in/tile_1.tif")
    assert "there is no such file" in run.fails("shard", "build", "s3://maps/job", 0)
    # Equal bytes have an equal tag.
    maps.put("in/tile_1.tif", same)
    run("shard", "build", "s3://maps/job", 0)
    # An input that changes while a shard is built fails the shard.
    run("shard", "plan", *urls, "-o", "s3://maps/next", "--shards", 1)
    maps.fail("slow", lambda method, path: method == "GET" and "tile_3" in path, seconds=1)
    process = run.start("shard", "build", "s3://maps/next", 0)
    maps.put("in/tile_0.tif", bytes(other))
    assert process.wait(120) == 1
    assert not [name for name in maps.names("next/shards/") if name.endswith(".summary")]


def test_plans_appear_once(tmp_path: Path, maps: Bucket, run: Runner) -> None:
    urls = put_tiles(maps, tmp_path / "tiles")
    plan = ["shard", "plan", *urls, "-o", "s3://maps/job", "--shards"]
    # Planning that fails before the plan is written leaves no job, and can be repeated.
    maps.fail("expired", lambda method, path: method == "PUT" and "plan.json" in path)
    assert "ExpiredToken" in run.fails(*plan, 3)
    assert maps.names("job/") == ["job/head.goblin"]
    assert "without a job" in run.fails("shard", "build", "s3://maps/job", 0)
    maps.mend()
    # Two processes at once.
    maps.fail("slow", lambda method, path: method == "PUT", seconds=0.5)
    both = [run.start(*plan, 3) for _ in range(2)]
    assert [process.wait(60) for process in both] == [0, 0]
    maps.mend()
    assert "another job was planned" in run.fails(*plan, 4)
    run(*plan, 3)


def test_requests_to_busy_or_failing_hosts_are_retried(tmp_path: Path, maps: Bucket, run: Runner) -> None:
    urls = put_tiles(maps, tmp_path / "tiles")
    run("build", *urls, "-o", tmp_path / "whole.goblin")
    # (A fault in one request, which is retried, of each kind, for each subcommand.)
    for _ in range(2):
        for method, kind in [("GET", "500"), ("HEAD", "500"), ("PUT", "500"), ("GET", "cut"), ("GET", "slow")]:
            maps.fail(kind, lambda verb, path, method=method: verb == method, after=2, times=2, seconds=0.3)
        run("shard", "plan", *urls, "-o", "s3://maps/job", "--shards", 2)
        for number in range(2):
            run("shard", "build", "s3://maps/job", number)
    run("shard", "merge", "s3://maps/job", "-o", "s3://maps/out.goblin")
    assert maps.get("out.goblin") == (tmp_path / "whole.goblin").read_bytes()


def test_failed_uploads_leave_no_files(tmp_path: Path, maps: Bucket, run: Runner) -> None:
    raster = noise(tmp_path / "noise.tif", 5000)
    run("build", raster, "-o", tmp_path / "whole.goblin")
    run("shard", "plan", raster, "-o", "s3://maps/job", "--shards", 2)

    def fails(*words: object, names: list[str]) -> None:
        said = run.fails(*words)
        assert "ExpiredToken" in said, said
        maps.mend()
        assert not maps.uploads() and maps.names("job/shards/") + maps.names("out") == names

    # A run file is a multipart upload: one part fails, and the completion fails.
    for method in ("PUT", "POST"):
        maps.fail("expired", lambda verb, path, method=method: verb == method and "uploadId" in path, after=1 if method == "PUT" else 0)
        fails("shard", "build", "s3://maps/job", 0, names=[])
    run("shard", "build", "s3://maps/job", 0)
    made = maps.names("job/shards/")
    assert any(name.endswith(".run") for name in made) and any(name.endswith(".summary") for name in made)
    # The summary is uploaded last.
    maps.fail("expired", lambda method, path: method == "PUT" and ".summary" in path)
    said = run.fails("shard", "build", "s3://maps/job", 1)
    maps.mend()
    assert "ExpiredToken" in said and "0001.summary" not in str(maps.names()) and not maps.uploads()
    assert "1 is missing" in run.fails("shard", "merge", "s3://maps/job", "-o", "s3://maps/out.goblin")
    run("shard", "build", "s3://maps/job", 1)
    made = maps.names("job/shards/")
    # Merging: a segment that cannot be read, and a part that cannot be uploaded.
    maps.fail("expired", lambda method, path: method == "GET" and "0001-0.run" in path, after=3)
    fails("shard", "merge", "s3://maps/job", "-o", "s3://maps/out.goblin", names=made)
    maps.fail("expired", lambda method, path: method == "PUT" and "uploadId" in path, after=1)
    fails("shard", "merge", "s3://maps/job", "-o", "s3://maps/out.goblin", names=made)
    # Two processes at once.
    both = [run.start("shard", "merge", "s3://maps/job", "-o", "s3://maps/out.goblin") for _ in range(2)]
    assert [process.wait(120) for process in both] == [0, 0]
    assert maps.get("out.goblin") == (tmp_path / "whole.goblin").read_bytes() and not maps.uploads()


def test_a_killed_worker_loses_only_its_shard(tmp_path: Path, maps: Bucket, run: Runner) -> None:
    raster = noise(tmp_path / "noise.tif", 3000)
    run("build", raster, "-o", tmp_path / "whole.goblin")
    run("shard", "plan", raster, "-o", "s3://maps/job", "--shards", 2)
    arrived = threading.Event()

    def is_upload(method: str, path: str) -> bool:
        if method == "PUT" and ".run" in path:
            arrived.set()
        return method == "PUT" and ".run" in path

    maps.fail("slow", is_upload, seconds=2)
    process = run.start("shard", "build", "s3://maps/job", 0)
    assert arrived.wait(60)
    process.kill()
    process.wait()
    maps.mend()
    assert not [name for name in maps.names("job/shards/") if name.endswith(".summary")]
    for number in range(2):
        run("shard", "build", "s3://maps/job", number)
    run("shard", "merge", "s3://maps/job", "-o", "s3://maps/out.goblin")
    assert maps.get("out.goblin") == (tmp_path / "whole.goblin").read_bytes()


def test_dask_clusters_build_in_buckets(tmp_path: Path, maps: Bucket, run: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    for name, value in maps.environment.items():
        monkeypatch.setenv(name, value)
    urls = put_tiles(maps, tmp_path / "tiles")
    spinney.build(urls, tmp_path / "whole.goblin")
    expected = (tmp_path / "whole.goblin").read_bytes()
    job = shards.plan(urls, "s3://maps/job", shards=2)
    assert job.missing()
    for number in job.missing():
        job.build(number)
    job.merge("s3://maps/by_hand.goblin")
    assert maps.get("by_hand.goblin") == expected
    job.remove()
    assert not maps.names("job/")
    with pytest.raises(ValueError, match="without a job"):
        shards.Job("s3://maps/job")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        # A cancelled run continues with its shards.
        begun = shards.plan(urls, "s3://maps/out.goblin.job", shards=3)
        begun.build(begun.missing()[0])
        left = len(begun.missing())
        done: list[tuple[int, int]] = []
        spinney.dask.build(urls, "s3://maps/out.goblin", client=client, progress=lambda now, all: done.append((now, all)))
        assert done[-1] == (left, left)
        assert maps.get("out.goblin") == expected
        assert not maps.names("out.goblin.job") and not maps.uploads()
        square = {"type": "Polygon", "coordinates": [[[5100, 8000], [7000, 8000], [7000, 8900], [5100, 8900], [5100, 8000]]]}
        with spinney.open(tmp_path / "whole.goblin") as tree:
            assert spinney.dask.zonal("s3://maps/out.goblin", [square], ["count"], client=client) == tree.zonal([square], ["count"])
