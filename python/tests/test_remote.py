"""Files on web servers, and in the file systems of fsspec: the same answers as from files of this machine."""

import asyncio
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

import spinney

ROOT = Path(__file__).resolve().parents[2]
FIXTURES = ROOT / "fixtures" / "v1"
sys.path.insert(0, str(ROOT / "tests" / "servers"))
from ranges import serve  # noqa: E402


@pytest.fixture(scope="module")
def server():
    with serve(FIXTURES) as running:
        yield running


@pytest.mark.parametrize("name", ["classes.goblin", "elevation.goblin", "rgba.goblin", "history.autumn", "stack.goblin:height"])
def test_cells_are_those_of_the_file(server, name):
    near, far = spinney.open(FIXTURES / name), spinney.open(f"{server.url}/{name}")
    np.testing.assert_array_equal(far.read(), near.read())
    assert far.stats() == near.stats()
    assert far.names == near.names
    points = np.random.default_rng(3).uniform(0, 60, (500, near.ndim))
    np.testing.assert_array_equal(far.sample(points, coordinates="cells"), near.sample(points, coordinates="cells"))
    again = pickle.loads(pickle.dumps(far))
    np.testing.assert_array_equal(again.read(), near.read())


def test_views_and_commits(server):
    name = "history.autumn"
    near = spinney.open(FIXTURES / name, view=["rotate=30", "scale=0.5"], commit=1)
    far = spinney.open(f"{server.url}/{name}", view=["rotate=30", "scale=0.5"], commit=1)
    np.testing.assert_array_equal(far.read(), near.read())


def test_few_requests(server):
    # (What was opened a moment ago is not opened anew: another name.)
    server.counts()
    ds = spinney.open(f"{server.url}/stack.goblin?few")
    assert server.counts()["requests"] == 2
    ds.read(window=(0, 0, 20, 20))
    assert server.counts()["requests"] <= 3


def test_questions_of_an_event_loop(server):
    ds, near = spinney.open(f"{server.url}/elevation.goblin"), spinney.open(FIXTURES / "elevation.goblin")
    zone = {"type": "Polygon", "coordinates": [[[301000, 3191000], [304000, 3192000], [302000, 3198000], [301000, 3191000]]]}

    async def ask():
        windows = [ds.aread(window=(8 * i, 10, 20, 30)) for i in range(5)]
        return await asyncio.gather(*windows, ds.asample([(30, 30)], coordinates="cells"), ds.azonal(zone, edge="area"))

    *windows, samples, zones = asyncio.run(ask())
    for i, window in enumerate(windows):
        np.testing.assert_array_equal(window, near.read(window=(8 * i, 10, 20, 30)))
    np.testing.assert_array_equal(samples, near.sample([(30, 30)], coordinates="cells"))
    assert zones == near.zonal(zone, edge="area")


def test_exact_models(server):
    near, far = (spinney.open_brep(f"{place}/chapel.goblin") for place in (FIXTURES, server.url))
    assert far.mass().volume == near.mass().volume and far.mass().area == near.mass().area
    points = np.random.default_rng(1).uniform(-5, 15, (200, 3))
    np.testing.assert_array_equal(far.contains(points), near.contains(points))


@pytest.mark.parametrize("name", ["classes.goblin", "history.autumn@1", "stack.goblin:1"])
def test_files_of_fsspec(name):
    fsspec = pytest.importorskip("fsspec")
    file = name.split("@")[0].split(":")[0]
    memory = fsspec.filesystem("memory")
    memory.pipe(f"/folder/{file}", (FIXTURES / file).read_bytes())
    commit = int(name.split("@")[1]) if "@" in name else None
    layer = name.split(":")[1] if ":" in name else None
    far = spinney.open(fsspec.open(f"memory://folder/{file}"), commit=commit, layer=layer)
    near = spinney.open(FIXTURES / name)
    np.testing.assert_array_equal(far.read(), near.read())
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(far)).read(), near.read())
    assert "memory" in repr(far)
    memory.rm(f"/folder/{file}")


def test_what_cannot_be_read_is_told(server):
    with pytest.raises(FileNotFoundError, match="missing.goblin"):
        spinney.open(f"{server.url}/missing.goblin")
    with pytest.raises(ValueError, match="storage option: got `no_such_option`"):
        spinney.open("s3://bucket/x.goblin", storage_options={"no_such_option": 1})
    with pytest.raises(OSError):
        spinney.open("http://127.0.0.1:1/x.goblin")
