"""Terms of long jobs: threads, limits, times, and Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from conftest import BOX, FIXTURES, noise, run

import spinney


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Slow inputs: maps, one to edit, octrees, a surface of many triangles."""
    made = tmp_path_factory.mktemp("work")
    random = np.random.default_rng(7)
    for name in ("first", "second"):
        spinney.build(random.integers(0, 4, (4096, 4096), "u1"), made / f"{name}.goblin", kind="categorical")
    spinney.convert(made / "first.goblin", made / "map.autumn")
    spinney.build(noise((2000, 2000), "f4", 3), made / "heights.goblin", crs="EPSG:3857", transform=(100, 0, 0, 0, -100, 0))
    spinney.build(random.integers(0, 2, (256, 256, 256)).astype(bool), made / "sponge.goblin", dims="zyx")
    z, y, x = np.indices((160, 160, 160), dtype="f4") - 80
    bumps = 10 * np.sin(x / 3) * np.sin(y / 3) * np.sin(z / 3)
    spinney.build(np.sqrt(x**2 + y**2 + z**2) + bumps < 60, made / "ball.goblin", dims="zyx")
    with spinney.open(made / "ball.goblin") as ball:
        spinney.build_brep(ball.mesh(6, smooth=True), made / "model.goblin")
    np.save(made / "many.npy", noise((5000, 4000), "u2"))
    return made


# Threads


def make_all(directory: Path, threads: int | None) -> list[Path]:
    """Writes every output that many threads can write, in the current directory."""
    outputs: list[Path] = []

    def file(name: str) -> Path:
        outputs.append(Path(name))
        return outputs[-1]

    first, second = file("first.goblin"), file("second.goblin")
    spinney.build(noise((1200, 900), "u1", 1), first, kind="categorical", threads=threads)
    spinney.build(noise((1200, 900), "u1", 2), second, threads=threads, kind="categorical")
    spinney.build(FIXTURES / "island_elevation.tif", file("raster.goblin"), threads=threads)
    spinney.build(FIXTURES / "island_elevation.tif", file("warped.goblin"), grid="xyz", threads=threads)
    spinney.transform(first, ["rotate=20", "crop"], file("turned.goblin"), threads=threads)
    spinney.combine("a-b", [first, second], file("combined.goblin"), threads=threads)
    spinney.convert(first, file("converted.autumn"), threads=threads)
    spinney.compact("converted.autumn", file("compact.autumn"), threads=threads)
    spinney.blame("converted.autumn", file("blame.goblin"), threads=threads)
    assert spinney.verify(first, threads=threads) == []
    with spinney.open("raster.goblin") as relief:
        relief.save(file("relief.png"), shape=(90, 70), exact=True, threads=threads)
        relief.export(file("relief.tif"), threads=threads)
        relief.contours(file("lines.csv"), every=20, threads=threads)
        relief.legend(file("legend.svg"), "terrain", threads=threads)
        box = [(303000, 3194000), (307000, 3194000), (307000, 3198000), (303000, 3194000)]
        zones = relief.zonal({"type": "Polygon", "coordinates": [box]}, edge="area", threads=threads)
        file("zones.txt").write_text(repr(zones))
        relief.export(file("relief.pmtiles"), threads=threads)
    with spinney.open(directory / "ball.goblin") as ball:
        ball.render(file("ball.png"), size=(100, 80), threads=threads)
        ball.export(file("ball.ply"), smooth=True, threads=threads)
        file("ball.txt").write_text(repr((ball.solid(surface=True, threads=threads), ball.mesh(5, threads=threads))))
    with spinney.open_brep(directory / "model.goblin") as model:
        points = np.random.default_rng(3).uniform(20, 140, (1500, 3))
        found = [
            model.locate(points, threads=threads),
            model.contains(points, threads=threads),
            model.distance(points, threads=threads),
            model.nearest(points, threads=threads).points,
            model.rays(points, (1, 0, 0), threads=threads).points,
            model.triangles(threads=threads).vertices,
            model.faces(threads=threads).vertices,
        ]
        results = (model.mass(threads=threads), model.euler(threads=threads), model.coverage(3, (2, 2, 2), threads=threads))
        file("model.txt").write_text(repr(results))
        np.savez(file("found.npz"), *found)
        model.export(file("model.off"), threads=threads)
        model.section(file("section.csv"), "z=30..130/10", threads=threads)
    spinney.build_brep("model.off", file("rebuilt.goblin"), threads=threads)
    history = file("edited.autumn")
    history.write_bytes((FIXTURES / "v1" / "history.autumn").read_bytes())
    with spinney.edit(history, author="", time=7, threads=threads) as edit:
        edit.paste(noise((4, 3), "u1"), at=(3, 2))
        edit.fill(2, window=(0, 0, 5, 5))
    return outputs


def test_threads_change_nothing(directory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    contents: list[dict[str, bytes]] = []
    for threads in (1, 3, None):
        made = tmp_path / str(threads)
        made.mkdir()
        # (Files record the names of their inputs.)
        monkeypatch.chdir(made)
        contents.append({path.name: path.read_bytes() for path in make_all(directory, threads)})
    assert len(contents[0]) > 20
    for name, content in contents[0].items():
        assert contents[1][name] == content == contents[2][name], name


COUNTED = """
import os, sys, threading, time, spinney
def count():
    return len(os.listdir("/proc/self/task"))
def watch():
    while not done:
        seen.append(count())
        time.sleep(0.005)
seen, done = [], []
watcher = threading.Thread(target=watch)
watcher.start()
here = count()
spinney.transform(sys.argv[1], "scale=0.5", sys.argv[2], threads=7)
done.append(True)
watcher.join()
print(max(seen) - here)
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="there is no /proc")
def test_the_requested_number_of_threads_run(directory: Path, tmp_path: Path) -> None:
    words = [sys.executable, "-P", "-c", COUNTED, directory / "first.goblin", tmp_path / "t.goblin"]
    # (One more waits for them.)
    assert int(subprocess.check_output(words)) == 8


@pytest.mark.parametrize("threads", [0, -1, 1.5, "2", True, 1j])
def test_invalid_numbers_of_threads_are_rejected(relief: str, tmp_path: Path, threads: Any) -> None:
    with pytest.raises(ValueError, match=r"threads: .*expected an integer, 1 or more"):
        spinney.convert(relief, tmp_path / "never.goblin", threads=threads)
    with spinney.open(relief) as ds, pytest.raises(ValueError, match="threads"):
        ds.save(tmp_path / "never.png", threads=threads)
    assert not list(tmp_path.iterdir())


# Limits and times


def test_outputs_keep_to_their_limit(island: str, relief: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    history = tmp_path_factory.mktemp("history") / "island.autumn"
    spinney.convert(island, history)
    never = tmp_path / "never.goblin"
    works: list[Callable[..., Any]] = [
        lambda **limit: spinney.build(noise((900, 700), "u2"), never, **limit),
        lambda **limit: spinney.build(island, never, **limit),
        lambda **limit: spinney.build(FIXTURES / "island_elevation.tif", never, **limit),
        lambda **limit: spinney.transform(island, "rotate=20", never, **limit),
        lambda **limit: spinney.combine("and", [island, island], never, **limit),
        lambda **limit: spinney.convert(island, never, **limit),
        lambda **limit: spinney.compact(history, tmp_path / "never.autumn", **limit),
        lambda **limit: spinney.blame(history, never, **limit),
        lambda **limit: spinney.build_brep(BOX, never, **limit),
        lambda **limit: spinney.open(relief).contours(tmp_path / "never.csv", every=5, **limit),
    ]
    for number, work in enumerate(works):
        for limit in (100, "0.1k"):
            with pytest.raises(OSError, match="allowed"):
                work(max_bytes=limit)
            assert not list(tmp_path.iterdir()), number
    spinney.convert(island, never, max_bytes="1G")
    for nonsense in (0, -1, "much"):
        with pytest.raises(ValueError, match="max_bytes"):
            spinney.convert(island, never, max_bytes=nonsense)


def test_the_first_commit_has_a_time(program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raster = FIXTURES / "island_classes.tif"

    def first(name: str, source: Any = raster, **time: int) -> float | None:
        spinney.build(source, tmp_path / name, **time)
        commit = spinney.log(tmp_path / name)[-1]
        return None if commit.time is None else commit.time.timestamp()

    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    assert first("none.autumn") is None
    assert first("five.autumn", time=1_600_000_005) == 1_600_000_005
    assert first("array.autumn", noise((50, 60), "u1"), time=7) == 7
    assert first("tree.autumn", tmp_path / "five.autumn", time=-8) == -8
    run(program, "build", raster, "-o", tmp_path / "theirs.autumn", "--time", "1600000005")
    assert (tmp_path / "five.autumn").read_bytes() == (tmp_path / "theirs.autumn").read_bytes()
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1500000000")
    assert first("epoch.autumn") == 1_500_000_000
    assert first("said.autumn", time=3) == 3
    with spinney.edit(tmp_path / "none.autumn") as edit:
        edit.fill(99, window=(0, 0, 9, 9))
    assert edit.made is not None and edit.made.time is not None and edit.made.time.timestamp() == 1_500_000_000
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(ValueError, match="SOURCE_DATE_EPOCH: got 'yesterday'"):
        first("never.autumn")
    assert not (tmp_path / "never.autumn").exists()


def test_nodes_are_counted(program: str, island: str, history: str) -> None:
    for path in (island, history):
        with spinney.open(path) as ds:
            counts = ds.level_counts()
            assert len(counts) <= ds.levels and sum(counts[0]) == 1 and counts[-1].inner == 0
            expected = json.loads(run(program, "info", path, "--levels", "--json"))["levels"]
            assert [(c.void, c.leaf, c.inner) for c in counts] == [(t["void"], t["leaf"], t["inner"]) for t in expected]
            for above, below in zip(counts, counts[1:]):
                assert sum(below) == 4 * above.inner
    with spinney.open(island, view="rotate=90") as view, pytest.raises(ValueError, match="is a view"):
        view.level_counts()


def test_features_are_chosen_by_values(program: str, island: str) -> None:
    path = FIXTURES / "island_districts.geojson"
    document = json.loads(path.read_text())
    for number, feature in enumerate(document["features"]):
        feature["properties"] |= {"number": number, "even": number % 2 == 0, "odd": number if number % 2 else None}
    names = [feature["properties"]["name"] for feature in document["features"]]
    with spinney.open(island) as ds:
        every = ds.zonal(document)
        assert ds.zonal(document, where={"name": names[1]}) == [every[1]]
        assert ds.zonal(document, where={"number": 1.0}) == [every[1]]
        assert ds.zonal(document, where={"even": True}) == every[::2]
        assert ds.zonal(document, where={"odd": None}) == every[::2]
        assert ds.zonal(document, ["count"], where={"even": False, "number": 1}) == [{"count": every[1].cells}]
        with pytest.raises(ValueError, match="missing"):
            ds.zonal(document, where={"name": "missing"})
        with pytest.raises(ValueError, match="place, which no feature has.*name"):
            ds.zonal(document, where={"place": "x"})
        # (The program's option separates several names by commas.)
        number = next(number for number, name in enumerate(names) if "," not in name)
        expected = json.loads(run(program, "stats", island, "--zones", path, "--json", "--where", f"name={names[number]}"))
        assert [zone["cells"] for zone in expected["zones"]] == [every[number].cells]
        assert ds.zonal(document, where="number>=1") == every[1:] and ds.zonal(document, where="number<1,even=true") == every[:1]
        with pytest.raises(ValueError, match="as in type=Building"):
            ds.zonal(document, where="number")


def test_zones_are_read_from_files(tmp_path: Path, island: str) -> None:
    path = FIXTURES / "island_districts.geojson"
    document = json.loads(path.read_text())
    lines = tmp_path / "lines.geojsonl"
    lines.write_text("\n".join(json.dumps(feature | {"crs": document["crs"]}) for feature in document["features"]))
    table = tmp_path / "table.csv"
    shapes = [shapely.geometry.shape(feature["geometry"]) for feature in document["features"]]
    table.write_text("name,wkb\n" + "".join(f"{number},{shape.wkb_hex}\n" for number, shape in enumerate(shapes)))
    with spinney.open(island) as ds:
        every = ds.zonal(document)
        assert ds.zonal(path) == ds.zonal(str(path)) == ds.zonal(lines) == every
        assert ds.zonal(table) == ds.zonal(table, crs="EPSG:32628") == every
        assert ds.zonal([path, document]) == every * 2
        assert ds.zonal(path, ["count"], where={"name": document["features"][1]["properties"]["name"]}) == [{"count": every[1].cells}]
        with pytest.raises(FileNotFoundError):
            ds.zonal(tmp_path / "none.gpkg:layer")
        (tmp_path / "points.csv").write_text("x,y\n1,2\n")
        with pytest.raises(Exception, match="zones are polygons"):
            ds.zonal(tmp_path / "points.csv")
        # A frame of features has its coordinate system as an attribute.
        features = {"type": "FeatureCollection", "features": document["features"]}
        assert ds.zonal(SimpleNamespace(crs="EPSG:32628", __geo_interface__=features)) == every


# Ctrl-C

Work = Callable[[Path, Path], Any]


def triangles() -> list[dict]:
    """Returns many polygons of a map."""
    random = np.random.default_rng(8)
    corners = random.uniform(0, 2500, (2000, 1, 2)) + random.uniform(0, 500, (2000, 3, 2))
    return [{"type": "Polygon", "coordinates": [[*ring.tolist(), ring[0].tolist()]]} for ring in corners]


def points(count: int, axes: int, most: float) -> np.ndarray:
    return np.random.default_rng(9).uniform(0, most, (count, axes))


def rows() -> Any:
    """Yields rows of an array, one at a time."""
    row = noise((1, 4000), "u2")
    for _ in range(9000):
        yield row


def many_cells(directory: Path, to: Path) -> None:
    copy = to / "edit.autumn"
    copy.write_bytes((directory / "map.autumn").read_bytes())
    with spinney.edit(copy) as edit:
        edit.set(points(150_000, 2, 4096).astype(int), [7])


def pasted(directory: Path, to: Path) -> None:
    copy = to / "edit.autumn"
    copy.write_bytes((directory / "map.autumn").read_bytes())
    with spinney.edit(copy) as edit:
        edit.paste(directory / "second.goblin")


def tree(path: Path, *view: str) -> spinney.Dataset:
    return spinney.open(path, view=view)


LONG: dict[str, Work] = {
    # Exact models
    "locate": lambda directory, _: spinney.open_brep(directory / "model.goblin").locate(points(2_000_000, 3, 160)),
    "contains": lambda directory, _: spinney.open_brep(directory / "model.goblin").contains(points(2_000_000, 3, 160)),
    "distance": lambda directory, _: spinney.open_brep(directory / "model.goblin").distance(points(20_000, 3, 160)),
    "nearest": lambda directory, _: spinney.open_brep(directory / "model.goblin").nearest(points(20_000, 3, 160)),
    "rays to a model": lambda directory, _: spinney.open_brep(directory / "model.goblin").rays(points(240_000, 3, 160), (1, 2, 3)),
    "section": lambda directory, to: spinney.open_brep(directory / "model.goblin").section(to / "s.csv", "z=30..130/0.1"),
    "build_brep": lambda directory, to: spinney.build_brep(tree(directory / "ball.goblin").mesh(), to / "m.goblin"),
    "combine of models": lambda directory, to: spinney.combine("union", [directory / "model.goblin"] * 2, to / "u.goblin"),
    # Octrees
    "rays": lambda directory, _: tree(directory / "ball.goblin").rays(points(400_000, 3, 160), (1, 2, 3)),
    "smooth rays": lambda directory, _: tree(directory / "ball.goblin").rays(points(200_000, 3, 160), (1, 2, 3), smooth=True),
    "rays to a view": lambda directory, _: tree(directory / "ball.goblin", "rotate=30").rays(points(3_000, 3, 160), (1, 2, 3)),
    "contains of a view": lambda directory, _: tree(directory / "ball.goblin", "rotate=30").contains(points(60_000, 3, 160)),
    "solid": lambda directory, _: tree(directory / "sponge.goblin").solid(7, surface=True),
    "mesh": lambda directory, _: tree(directory / "sponge.goblin").mesh(6),
    "export of a mesh": lambda directory, to: tree(directory / "sponge.goblin").export(to / "m.ply", level=7),
    "export of glTF": lambda directory, to: tree(directory / "sponge.goblin").export(to / "m.glb", level=7),
    "render": lambda directory, to: tree(directory / "ball.goblin").render(to / "b.png", size=(400, 300), samples=2),
    "read of a view of an octree": lambda directory, _: tree(directory / "sponge.goblin", "rotate=30").read(),
    # Maps
    "sample": lambda directory, _: tree(directory / "first.goblin").sample(points(4_000_000, 2, 4096)),
    "sample of a view": lambda directory, _: tree(directory / "first.goblin", "rotate=30").sample(points(60_000, 2, 4096)),
    "read of a view": lambda directory, _: tree(directory / "first.goblin", "scale=0.7").read(window=(0, 0, 900, 900)),
    "find": lambda directory, _: tree(directory / "first.goblin").find(2, window=(1, 1, 2000, 2000)),
    "stats of a view": lambda directory, _: tree(directory / "first.goblin", "rotate=30").stats((1, 1, 2500, 2500)),
    "histogram of a view": lambda directory, _: tree(directory / "heights.goblin", "rotate=30").histogram(9, (0, 9), window=(1, 1, 2000, 2000)),
    "find in a view": lambda directory, _: tree(directory / "first.goblin", "rotate=30").find(255, window=(0, 0, 2500, 2500)),
    "zonal": lambda directory, _: tree(directory / "first.goblin").zonal(triangles(), edge="area"),
    "contours": lambda directory, to: tree(directory / "heights.goblin").contours(to / "c.csv", every=150),
    "export of tiles": lambda directory, to: tree(directory / "heights.goblin").export(to / "t.pmtiles"),
    "build": lambda directory, to: spinney.build(np.load(directory / "many.npy", mmap_mode="r"), to / "b.goblin"),
    "build of rows": lambda directory, to: spinney.build(rows(), to / "b.goblin", shape=(9000, 4000), dtype="u2"),
    "transform": lambda directory, to: spinney.transform(directory / "first.goblin", ["window=0,0,1400,1400", "scale=0.7"], to / "t.goblin"),
    "combine": lambda directory, to: spinney.combine("max", [directory / "first.goblin", directory / "second.goblin"], to / "c.goblin"),
    "convert": lambda directory, to: spinney.convert(directory / "first.goblin", to / "c.autumn"),
    "compact": lambda directory, to: spinney.compact(directory / "map.autumn", to / "c.autumn"),
    "blame": lambda directory, to: spinney.blame(directory / "map.autumn", to / "b.goblin"),
    "diff": lambda directory, _: spinney.diff(directory / "first.goblin", directory / "second.goblin"),
    "ranges of diff": lambda directory, _: spinney.diff(directory / "first.goblin", directory / "second.goblin", ranges=True),
    "cross": lambda directory, _: spinney.cross(directory / "first.goblin", directory / "second.goblin"),
    "verify": lambda directory, _: spinney.verify(directory / "map.autumn"),
    "level_counts": lambda directory, _: tree(directory / "map.autumn").level_counts(),
    "set": many_cells,
    "paste": pasted,
}


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.usefixtures("enabled_ctrl_c")
@pytest.mark.parametrize("name", LONG)
def test_ctrl_c_ends_work(directory: Path, tmp_path: Path, name: str) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    begin = time.monotonic()
    LONG[name](directory, first)
    whole = time.monotonic() - begin
    timer = threading.Timer(whole / 5, os.kill, (os.getpid(), signal.SIGINT))
    outcome, begin = "has come to its end", time.monotonic()
    try:
        timer.start()
        try:
            LONG[name](directory, second)
        except KeyboardInterrupt:
            outcome = "was interrupted"
        except BaseException:
            timer.cancel()
            raise
        took = time.monotonic() - begin
        timer.join()
        # (So that it is not raised anywhere else.)
        time.sleep(0.01)
    except KeyboardInterrupt:
        pass
    assert outcome == "was interrupted"
    # (Code that did not check signals raises them at the end.)
    assert took < max(0.8 * whole, 0.3), f"{took:.2f} of {whole:.2f} s"
    assert {path.name for path in second.iterdir()} <= {"edit.autumn"}
