"""Building: from arrays of any kind, block by block, and from files; cancellation leaves no partial
output.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import FIXTURES, noise, run
from hypothesis import given
from hypothesis import strategies as st

import spinney


def cells(path: Path | str) -> np.ndarray:
    """Returns all cells of a tree, bands first."""
    with spinney.open(path) as ds:
        return ds.read()


def test_all_metadata_is_stored(tmp_path: Path) -> None:
    path = tmp_path / "t.goblin"
    array = noise((30, 40), "uint8") % 4
    spinney.build(
        array,
        path,
        nodata=0,
        transform=(2, 0, 5, 0, -2, 9),
        crs="EPSG:32628",
        categories={1: "water", 2: "wood"},
        colormap={1: (0, 0, 255), 2: (0, 99, 0, 128)},
        descriptions=["cover"],
        units=["class"],
        scales=[2],
        offsets=[1],
        tags={"AREA_OR_POINT": "Area", "source": "noise"},
    )
    with spinney.open(path) as ds:
        assert (ds.kind, ds.rule, ds.nodata, ds.crs, ds.transform) == ("categorical", "majority", 0, "EPSG:32628", (2, 0, 5, 0, -2, 9))
        assert ds.categories == {1: "water", 2: "wood"} and ds.tags == {"AREA_OR_POINT": "Area", "source": "noise"}
        assert ds.colormap == {0: (0, 0, 0, 0), 1: (0, 0, 255, 255), 2: (0, 99, 0, 128)}
        assert (ds.descriptions, ds.units, ds.scales, ds.offsets) == (("cover",), ("class",), (2,), (1,))
        assert ds.stats().void_cells == (array == 0).sum() and np.array_equal(ds[...], array)
        assert ds.stats().classes == {value: (array == value).sum() for value in (1, 2, 3)}


def test_coordinate_systems_of_others(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    affine = pytest.importorskip("affine")
    custom = "+proj=laea +lat_0=10 +lon_0=20 +datum=WGS84"
    for crs in (32628, pyproj.CRS("EPSG:32628"), pyproj.CRS(custom)):
        spinney.build(np.ones((3, 3), "u1"), tmp_path / "t.goblin", crs=crs, transform=affine.Affine(2, 0, 5, 0, -2, 9))
        with spinney.open(tmp_path / "t.goblin") as ds:
            assert pyproj.CRS(ds.crs) == pyproj.CRS(crs) and affine.Affine(*ds.transform) == affine.Affine(2, 0, 5, 0, -2, 9)


class Counted:
    """An array on disk that counts the cells that are held at a time."""

    def __init__(self, array: np.ndarray) -> None:
        self.array, self.shape, self.dtype, self.most = array, array.shape, array.dtype, 0

    def __getitem__(self, key: tuple) -> np.ndarray:
        part = self.array[key]
        self.most = max(self.most, part.size)
        return part


@given(
    shape=st.tuples(st.integers(1, 700), st.integers(1, 700)),
    dtype=st.sampled_from(["u1", "<u2", ">u2", "i2", "u4", ">i4", "f4", "f8", "?", "i1", "f2"]),
    order=st.sampled_from("CF"),
)
def test_arrays_of_any_shape_and_order(tmp_path_factory: pytest.TempPathFactory, shape: tuple, dtype: str, order: str) -> None:
    array = (noise(shape, "u1") % 120).astype(dtype, order=order)
    path = tmp_path_factory.getbasetemp() / "any.goblin"
    source = Counted(array)
    spinney.build(source, path, memory="1M")
    assert np.array_equal(cells(path)[0], array) and source.most <= 1 << 16
    spinney.build(iter(array[row : row + 100] for row in range(0, shape[0], 100)), path, shape=shape, dtype=dtype)
    assert np.array_equal(cells(path)[0], array)


@pytest.mark.parametrize("dims", ["byx", "yxb", "zyx", "bzyx", "zyxb"])
def test_axes_in_any_order(tmp_path: Path, dims: str) -> None:
    sizes = {"b": 3, "z": 70, "y": 90, "x": 80}
    array = noise(tuple(sizes[name] for name in dims), "uint8")
    spinney.build(array, tmp_path / "t.goblin", dims=dims, memory="1M")
    wanted = [name for name in "bzyx" if name in dims]
    ordered = array.transpose([dims.index(name) for name in wanted])
    found = cells(tmp_path / "t.goblin")
    assert np.array_equal(found if "b" in dims else found[0], ordered)
    with pytest.raises(ValueError):
        spinney.build(array, tmp_path / "u.goblin", dims="yx")


def test_bytes_are_the_same_whatever_the_source(tmp_path: Path, program: str) -> None:
    zarr = pytest.importorskip("zarr")
    dask = pytest.importorskip("dask.array")
    array = noise((600, 1100), "uint16")
    mapped = np.memmap(tmp_path / "m.raw", "u2", "w+", shape=array.shape)
    mapped[:] = array
    stored = zarr.create_array(str(tmp_path / "z.zarr"), shape=array.shape, chunks=(256, 256), dtype="u2")
    stored[:] = array
    built = set()
    for source in (array, mapped, stored, dask.from_array(array, chunks=(100, 300)), array.tolist() and np.ma.array(array)):
        for memory in ("1M", "1G"):
            spinney.build(source, tmp_path / "t.goblin", memory=memory)
            built.add((tmp_path / "t.goblin").read_bytes())
    assert len(built) == 1


def test_masks(tmp_path: Path) -> None:
    array, mask = noise((90, 70), "float32"), noise((90, 70), "uint8", 3) > 120
    array[3, 4] = np.nan
    for source, options in ((array, {"mask": mask}), (np.ma.array(array, mask=mask), {})):
        spinney.build(source, tmp_path / "t.goblin", **options)
        with spinney.open(tmp_path / "t.goblin") as ds:
            masked = ds.read(1, masked=True)
            assert np.array_equal(masked.mask, mask | np.isnan(array)) and np.array_equal(masked.compressed(), array[~masked.mask])


def test_refusals(tmp_path: Path) -> None:
    out, good = tmp_path / "t.goblin", np.ones((4, 4), "u1")
    for kind, source, options in [
        (TypeError, np.ones((2, 4, 4), "f8"), {}),
        (TypeError, np.ones((4, 4), "c8"), {}),
        (ValueError, np.ones((9, 4, 4), "u1"), {}),
        (ValueError, np.ones(4, "u1"), {}),
        (ValueError, np.ones((0, 4), "u1"), {}),
        (ValueError, good, {"nodata": 300}),
        (ValueError, good, {"transform": (1, 2, 3)}),
        (ValueError, good, {"transform": (0, 0, 0, 0, 0, 0)}),
        (ValueError, good, {"crs": "nonsense"}),
        (ValueError, good, {"rule": "best"}),
        (ValueError, good, {"depth": 1}),
        (ValueError, good, {"depth": 300}),
        (ValueError, good, {"memory": "much"}),
        (ValueError, good, {"mask": np.ones((4, 5), bool)}),
        (ValueError, good, {"descriptions": ["a", "b"]}),
        (TypeError, good, {"cells": 12}),
        (TypeError, good, {"shape": (4, 4)}),
        (TypeError, iter([good]), {}),
        (ValueError, iter([good]), {"shape": (5, 4), "dtype": "u1"}),
        (ValueError, iter([good]), {"shape": (3, 4), "dtype": "u1"}),
        (ValueError, iter([good]), {"shape": (4, 4), "dtype": "u2"}),
        (TypeError, 5, {}),
        (FileNotFoundError, tmp_path / "none.tif", {}),
        (TypeError, FIXTURES / "island_rgb.png", {"tags": {"a": "b"}}),
        (TypeError, good, {"progress": 7}),
    ]:
        with pytest.raises(kind):
            spinney.build(source, out, **options)
        assert os.listdir(tmp_path) == []
    with pytest.raises(OSError):
        spinney.build(good, tmp_path / "none" / "t.goblin")


def test_exceptions_of_sources_and_callbacks_are_raised(tmp_path: Path) -> None:
    class Broken(Counted):
        def __getitem__(self, key: tuple) -> np.ndarray:
            raise LookupError("the disk is gone")

    with pytest.raises(LookupError, match="the disk is gone"):
        spinney.build(Broken(np.ones((600, 600), "u1")), tmp_path / "t.goblin")
    updates: list[tuple[int, int]] = []
    spinney.build(noise((2000, 2000), "uint8"), tmp_path / "t.goblin", progress=lambda *numbers: updates.append(numbers))
    assert updates and updates[-1] == (4_000_000, 4_000_000)

    tqdm = pytest.importorskip("tqdm")
    with tqdm.tqdm(disable=False, file=open(os.devnull, "w")) as bar:
        spinney.transform(tmp_path / "t.goblin", "mirror=x", tmp_path / "m.goblin", progress=bar)
        assert bar.n == bar.total and bar.n > 0
    (tmp_path / "m.goblin").unlink()
    spinney.transform(tmp_path / "t.goblin", "mirror=x", tmp_path / "m.goblin", progress=True)
    (tmp_path / "m.goblin").unlink()

    def refuse(done: int, total: int) -> None:
        raise ArithmeticError("enough")

    class Slow(Counted):
        def __getitem__(self, key: tuple) -> np.ndarray:
            time.sleep(0.02)
            return super().__getitem__(key)

    with pytest.raises(ArithmeticError):
        spinney.build(Slow(noise((3000, 3000), "uint8")), tmp_path / "u.goblin", progress=refuse, memory="1M")
    assert os.listdir(tmp_path) == ["t.goblin"]


ENDLESS = """
import signal, sys, numpy as np, spinney
# (Jobs in the background inherit that interrupts are ignored.)
signal.signal(signal.SIGINT, signal.default_int_handler)
class Endless:
    shape, dtype = (1 << 20, 1 << 20), np.dtype("u1")
    def __getitem__(self, key):
        print("begun", flush=True)
        return np.random.default_rng(1).integers(0, 255, [part.stop - part.start for part in key], "u1")
try:
    spinney.build(Endless(), sys.argv[1])
except KeyboardInterrupt:
    sys.exit(42)
"""


def test_ctrl_c_leaves_nothing(tmp_path: Path) -> None:
    work = subprocess.Popen([sys.executable, "-P", "-c", ENDLESS, tmp_path / "t.goblin"], stdout=subprocess.PIPE)
    assert work.stdout is not None and work.stdout.readline() == b"begun\n"
    time.sleep(0.2)
    assert os.listdir(tmp_path)
    work.send_signal(signal.SIGINT)
    assert work.wait(20) == 42
    assert os.listdir(tmp_path) == []


def test_files_are_built_as_by_the_program(program: str, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.goblin", tmp_path / "theirs.goblin"
    rgb = FIXTURES / "island_rgb.png"
    for source, words, options in [
        (FIXTURES / "island_classes.tif", [], {}),
        (rgb, ["--band", "2,1", "--rule", "max", "--crs", "EPSG:3857"], {"bands": [2, 1], "rule": "max", "crs": "EPSG:3857"}),
    ]:
        run(program, "build", source, "-o", theirs, *words)
        spinney.build(source, ours, **options)
        assert ours.read_bytes() == theirs.read_bytes()
    model = tmp_path / "model.off"
    model.write_text("OFF\n4 4 0\n0 0 0\n4 0 0\n0 4 0\n0 0 4\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n")
    run(program, "build", model, "-o", theirs, "--cells", 64, "--edge", "area")
    spinney.build([model], ours, cells=64, edge="area")
    assert ours.read_bytes() == theirs.read_bytes()
    with spinney.open(ours) as ds:
        assert ds.volume() == pytest.approx(64 / 6, rel=0.01)


def bands(array: np.ndarray) -> Iterator[np.ndarray]:
    """Yields rows of an array, some at a time."""
    for row in range(0, len(array), 7):
        yield array[row : row + 7]


def test_generators(tmp_path: Path) -> None:
    array = noise((300, 50, 3), "uint8")
    spinney.build(bands(array), tmp_path / "t.goblin", dims="yxb", shape=array.shape, dtype="u1")
    assert np.array_equal(cells(tmp_path / "t.goblin"), array.transpose(2, 0, 1))


def test_exports_are_those_of_the_program(tmp_path: Path, program: str) -> None:
    tree = tmp_path / "island.goblin"
    spinney.build(FIXTURES / "island_classes.tif", tree)
    with spinney.open(tree) as ds:
        for name, options, words in [
            ("x.mbtiles", {"zoom": (0, 9), "name": "Island"}, ["--zoom", "0..9", "--name", "Island"]),
            ("x.tif", {"tile_size": 256, "compression": "zstd"}, ["--tile-size", "256", "--compression", "zstd"]),
            ("x.pmtiles", {"zoom": (0, 9), "name": "Island"}, ["--zoom", "0..9", "--name", "Island"]),
            ("z.pmtiles", {"zoom": 12, "window": (-17.05, 28.82, -16.985, 28.92), "coordinates": "lonlat"},
             ["--zoom", "12", "--in", "lonlat", "--window", "-17.05,28.82,-16.985,28.92"]),
            ("y.pmtiles", {"zoom": 8, "style": {"draw": "palette"}}, ["--zoom", "8", "--style", '{"draw": "palette"}']),
        ]:
            ours, theirs = tmp_path / name, tmp_path / f"their_{name}"
            made = ds.export(ours, **options)
            assert made is None or made > 0
            run(program, "export", tree, theirs, *words)
            assert ours.read_bytes() == theirs.read_bytes(), name
        ds.save(tmp_path / "ours.png", shape=(50, 64), style="viridis")
        run(program, "get", tree, tmp_path / "theirs.png", "--size", "64x50", "--style", "viridis")
        assert (tmp_path / "ours.png").read_bytes() == (tmp_path / "theirs.png").read_bytes()
        for name, options in [("x.tif", {"zoom": 3}), ("x.pmtiles", {"smooth": True}), ("x.ply", {"compression": "zstd"})]:
            with pytest.raises(TypeError):
                ds.export(tmp_path / name, **options)
    ball = FIXTURES / "v1" / "ball.goblin"
    with spinney.open(ball) as ds:
        assert ds.export(tmp_path / "ball.glb", smooth=True) > 100
        assert ds.export(tmp_path / "ball" / "tileset.json") > 100
        assert ds.export(tmp_path / "packed.glb", smooth=True, meshopt=True) > 100
        run(program, "export", ball, tmp_path / "theirs.glb", "--smooth", "--meshopt")
        assert (tmp_path / "packed.glb").read_bytes() == (tmp_path / "theirs.glb").read_bytes()
        assert (tmp_path / "packed.glb").stat().st_size < (tmp_path / "ball.glb").stat().st_size
        with pytest.raises(TypeError, match="meshopt"):
            ds.export(tmp_path / "ball.ply", meshopt=True)


def test_contours_are_those_of_the_program(tmp_path: Path, program: str, relief: str) -> None:
    for name, options, words in [
        ("a.geojson", {"every": 100}, ["--every", "100"]),
        ("b.csv", {"at": [200, 500.5], "ends": "close", "smooth": 2}, ["--at", "200,500.5", "--ends", "close", "--smooth", "2"]),
        ("c.geojson", {"at": [200, 500], "filled": True, "has_z": True}, ["--at", "200,500", "--filled", "--3d"]),
    ]:
        ours, theirs = tmp_path / name, tmp_path / f"their_{name}"
        with spinney.open(relief) as ds:
            assert ds.contours(ours, **options) > 0
        run(program, "contours", relief, *words, "-o", theirs)
        assert ours.read_bytes() == theirs.read_bytes(), name
    with spinney.open(FIXTURES / "v1" / "ball.goblin") as ball:
        assert ball.contours(tmp_path / "ball.ply", 127.5, ends="close") > 1000
    with spinney.open(relief) as ds:
        for wrong in ({}, {"at": 3, "every": 2}, {"at": 3, "ends": "ragged"}, {"at": 3, "level": 90}):
            with pytest.raises(ValueError):
                ds.contours(tmp_path / "no.geojson", **wrong)
        with pytest.raises(ValueError, match="unknown format"):
            ds.contours(tmp_path / "no.tif", 3)
    assert not list(tmp_path.glob("no.*"))


def test_volumes_in_nrrd_files(tmp_path: Path) -> None:
    nrrd = pytest.importorskip("nrrd")
    array = noise((20, 7, 9), "int16")
    directions = np.array([[0.5, 0, 0], [0, 0, 2], [0, 0.25, 0.125]])
    head = {"space": "left-posterior-superior", "space directions": directions, "space origin": [1, 2, 3], "encoding": "gzip", "scanner": "A: b"}
    nrrd.write(str(tmp_path / "a.nrrd"), array, head)
    spinney.build(tmp_path / "a.nrrd", tmp_path / "a.goblin")
    ds = spinney.open(tmp_path / "a.goblin")
    # (pynrrd has x first.)
    assert (ds.read() == array.transpose(2, 1, 0)).all()
    ds.save(tmp_path / "b.nrrd")
    again, header = nrrd.read(str(tmp_path / "b.nrrd"))
    assert (again == array).all()
    assert (header["space directions"] == directions).all()
    assert list(header["space origin"]) == [1, 2, 3]
    assert (header["space"], header["scanner"]) == ("left-posterior-superior", "A: b")


def test_sections_of_a_directory(tmp_path: Path) -> None:
    array = noise((11, 8, 9), "uint8")
    (tmp_path / "sections").mkdir()
    for number, plane in enumerate(array):
        spinney.build(plane, tmp_path / "plane.goblin")
        spinney.open(tmp_path / "plane.goblin").save(tmp_path / "sections" / f"z{number}.png")
    spinney.build(tmp_path / "sections", tmp_path / "a.goblin", pages="z")
    assert (cells(tmp_path / "a.goblin") == array).all()
