"""Sources with metadata: trees, DataArrays, masks, and sample types that are kept or refused."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
import rasterio
import trimesh
import xarray
from conftest import FIXTURES, noise, run

import spinney

CLASSES = FIXTURES / "v1" / "classes.goblin"
FACTS = ("kind", "rule", "nodata", "crs", "transform", "colormap", "categories", "descriptions", "units", "scales", "offsets")


def same(a: spinney.Dataset, b: spinney.Dataset, levels: int | None = None) -> None:
    """Checks that trees have the same cells, at all levels or the finest ones, and the same
    metadata.
    """
    assert {name: getattr(a, name) for name in FACTS} == {name: getattr(b, name) for name in FACTS}
    assert np.array_equal(a.matrix, b.matrix) and a.dtype == b.dtype and a.depth == b.depth and a.tags == b.tags
    for level in range(0 if levels is None else a.levels - levels, a.levels):
        ours, theirs = (np.ma.filled(ds.read(level=level, masked=True).astype("f8"), -1e30) for ds in (a, b))
        assert np.array_equal(ours, theirs), level


def annotated(path: Path) -> Path:
    """A tree of classes with all kinds of metadata."""
    array = np.random.default_rng(5).integers(0, 256, (70, 90)).astype("uint8")
    array[:4].flat[:256] = range(256)
    spinney.build(
        np.ma.array(array, mask=noise(array.shape, "uint8") > 120),
        path,
        categories={1: "water", 2: "open  land", 3: "bog_wood", 250: "ice"},
        colormap={value: (value, 1, 2, 200 + value % 56) for value in range(256)},
        descriptions=["cover"],
        units=["class"],
        tags={"source": "noise", "units": "of a tag"},
        transform=(0.1, 0, 1 / 3, 0, -0.3, 7),
        crs="EPSG:32628",
        kind="categorical",
        rule="dominant",
    )
    return path


def test_classes_have_no_means(tmp_path: Path) -> None:
    array, expected = np.ones((4, 4), "uint8"), "the rule mean for categorical values .* --kind continuous"
    with pytest.raises(ValueError, match=expected):
        spinney.build(array, tmp_path / "o.goblin", rule="mean", kind="categorical")
    with pytest.raises(ValueError, match=expected):
        spinney.build(CLASSES, tmp_path / "o.goblin", rule="mean")
    spinney.build(CLASSES, tmp_path / "o.goblin", rule="mean", kind="continuous")


def test_trees_keep_their_meaning(tmp_path: Path, program: str, history: str) -> None:
    out, theirs = tmp_path / "o.goblin", tmp_path / "p.goblin"
    for source in (CLASSES, annotated(tmp_path / "t.goblin"), FIXTURES / "v1" / "rgb.goblin", FIXTURES / "v1" / "ball.goblin", f"{history}@1"):
        spinney.convert(source, theirs)
        run(program, "-q", "build", source, "-o", tmp_path / "q.goblin")
        with spinney.open(source) as ds:
            for given in (source, ds):
                spinney.build(given, out)
                assert out.read_bytes() == theirs.read_bytes() == (tmp_path / "q.goblin").read_bytes()
                with spinney.open(out) as made:
                    same(ds, made)
    with spinney.open(CLASSES, view=["mirror=x", "window=5,7,100,90"]) as view:
        spinney.build(view, out)
        with spinney.open(out) as made:
            # (Levels of a mirrored view are those of its file, in which another child may come
            # first if classes are tied.)
            same(view, made, levels=1)
            assert "mirror=x" in made.provenance[-1]
    with spinney.open(CLASSES) as ds:
        spinney.build(ds.level(5), out)
        with spinney.open(out) as made:
            assert np.array_equal(made[...], ds.level(5)[...]) and made.rule == ds.rule
            assert np.array_equal(made.level(2)[...], ds.level(2)[...])


def test_options_override_properties_of_trees(tmp_path: Path) -> None:
    array, out = noise((50, 60), "float32"), tmp_path / "o.autumn"
    spinney.build(array, tmp_path / "t.goblin", units=["m"], tags={"a": "1", "b": "2"})
    with spinney.open(tmp_path / "t.goblin") as ds:
        spinney.build(ds, out, rule="max", depth=8, crs="EPSG:3857", transform=(2, 0, 0, 0, -2, 0), descriptions=["x"], scales=[3], tags={"b": "3"})
        with spinney.open(out) as made:
            assert (made.rule, made.kind, made.depth, made.crs, made.descriptions) == ("max", "continuous", 8, "EPSG:3857", ("x",))
            assert (made.units, made.scales, made.offsets, made.tags) == (("m",), (3,), (0,), {"a": "1", "b": "3"})
            assert made.transform[:3] == (2, 0, 0) and made.level(0)[0, 0] == array.max() and np.array_equal(made[...], array)
            assert list(spinney.verify(out)) == []
        spinney.build(ds, tmp_path / "c.goblin", kind="categorical")
        with spinney.open(tmp_path / "c.goblin") as made:
            assert (made.kind, made.rule) == ("categorical", "majority")
        for error, options in [
            (TypeError, {"nodata": 0}),
            (TypeError, {"mask": np.zeros((50, 60), bool)}),
            (TypeError, {"bands": [1]}),
            (ValueError, {"units": ["m", "m"]}),
            (ValueError, {"depth": 3}),
            (ValueError, {"transform": np.diag([1.0, 1, 2, 1])}),
        ]:
            with pytest.raises(error):
                spinney.build(ds, tmp_path / "x.goblin", **options)
        with pytest.raises(ValueError, match="input and the output"):
            spinney.build(ds, tmp_path / "t.goblin")
        for several in ([ds, ds], [tmp_path / "t.goblin", CLASSES]):
            with pytest.raises((TypeError, ValueError), match="combine"):
                spinney.build(several, tmp_path / "x.goblin")
    assert not (tmp_path / "x.goblin").exists()


@pytest.mark.parametrize("masked", [None, False, True])
def test_data_arrays_keep_their_meaning(tmp_path: Path, masked: bool | None) -> None:
    xr = pytest.importorskip("xarray")
    pytest.importorskip("pyproj")
    heights = tmp_path / "heights.goblin"
    spinney.build(FIXTURES / "island_elevation.tif", heights)
    askew = tmp_path / "askew.goblin"
    spinney.transform(CLASSES, "rotate=30", askew)
    for source in (CLASSES, annotated(tmp_path / "t.goblin"), heights, askew, FIXTURES / "v1" / "rgb.goblin"):
        for chunks in (None, {}):
            with xr.open_dataset(source, engine="spinney", mask_and_scale=masked, chunks=chunks) as found:
                spinney.build(found.band_data, tmp_path / "o.goblin")
            with spinney.open(source) as ds, spinney.open(tmp_path / "o.goblin") as made:
                same(ds, made)
    # Edited attributes and arguments of `build` take precedence.
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney", mask_and_scale=masked) as found:
        array = found.band_data.isel(y=slice(10, 40))
        array.attrs["flag_meanings"] = "water open_land heath ice"
        spinney.build(array, tmp_path / "o.goblin", rule="nearest", units=["m"])
    with spinney.open(tmp_path / "t.goblin") as ds, spinney.open(tmp_path / "o.goblin") as made:
        assert made.categories == {**ds.categories, 3: "heath"} and (made.rule, made.units) == ("nearest", ("m",))
        assert made.transform == pytest.approx((0.1, 0, 1 / 3, 0, -0.3, 4)) and np.array_equal(made[...], ds[10:40])


def test_opacity_and_bands_of_data_arrays(tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray")
    rasterio = pytest.importorskip("rasterio")
    array = np.stack([noise((40, 50), "uint8", seed) for seed in (1, 2, 3, 4)])
    array[3][array[3] < 40] = 0
    about = {"count": 4, "dtype": "uint8", "width": 50, "height": 40, "transform": rasterio.Affine(2, 0, 9, 0, -2, 3)}
    with rasterio.open(tmp_path / "rgba.tif", "w", driver="GTiff", photometric="RGB", alpha="YES", **about) as file:
        file.write(array)
    spinney.build(tmp_path / "rgba.tif", tmp_path / "t.goblin")
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney") as found, spinney.open(tmp_path / "t.goblin") as ds:
        assert found.band_data.dtype == np.uint8
        spinney.build(found.band_data, tmp_path / "o.goblin")
        with spinney.open(tmp_path / "o.goblin") as made:
            same(ds, made)
            assert made._facts()["alpha"] == 3
    bands = xr.DataArray(
        noise((3, 20, 30), "uint16"),
        dims=("band", "y", "x"),
        attrs={"long_name": ("a", "b", "c"), "units": ("m", "", "s"), "scales": (1, 2, 3), "offsets": (0, 5, 0), "history": "made"},
    ).assign_coords(band=[1, 2, 3])
    spinney.build(bands.isel(band=[2, 0]), tmp_path / "o.goblin")
    with spinney.open(tmp_path / "o.goblin") as made:
        assert (made.descriptions, made.units, made.scales, made.offsets) == (("c", "a"), ("s", "m"), (3, 1), (0, 0))
        assert made.tags == {"history": "made"}


def test_conventions_of_others(tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray")
    rioxarray = pytest.importorskip("rioxarray")
    out = tmp_path / "o.goblin"
    cells = np.array([[1, 2, 9], [1, 7, 9]], "int16")
    for name in ("_FillValue", "missing_value", "nodata"):
        spinney.build(xr.DataArray(cells, dims=("lat", "lon"), attrs={name: 9, "units": "K", "long_name": "heat"}), out)
        with spinney.open(out) as ds:
            assert ds.read(1, masked=True).mask.tolist() == [[False, False, True]] * 2
            assert (ds.units, ds.descriptions, ds.kind, ds.nodata) == (("K",), ("heat",), "continuous", 9)
    for useless in (np.nan, 1e9, "none"):
        spinney.build(xr.DataArray(cells, dims=("y", "x"), attrs={"_FillValue": useless}), out)
        with spinney.open(out) as ds:
            assert ds.nodata is None and not ds.read(masked=True).mask.any()
    flags = {"flag_values": "1, 2", "flag_meanings": "one number_two", "flag_colors": "#102030 #aabbcc"}
    spinney.build(xr.DataArray(cells, dims=("y", "x"), attrs=flags), out)
    with spinney.open(out) as ds:
        assert (ds.kind, ds.rule, ds.categories) == ("categorical", "majority", {1: "one", 2: "number two"})
        assert ds.colormap is not None and ds.colormap[2] == (0xAA, 0xBB, 0xCC, 255)
    bits = {"flag_masks": [1, 2], "flag_values": [1, 2], "flag_meanings": "a b"}
    spinney.build(xr.DataArray(cells, dims=("y", "x"), attrs=bits), out)
    with spinney.open(out) as ds:
        assert ds.kind == "continuous" and not ds.categories
    # As masked by rioxarray: VOID is NaN, and its number is in the encoding.
    with rioxarray.open_rasterio(FIXTURES / "island_elevation.tif", masked=True) as array:
        spinney.build(array, out)
    spinney.build(FIXTURES / "island_elevation.tif", tmp_path / "t.goblin")
    with spinney.open(tmp_path / "t.goblin") as ds, spinney.open(out) as made:
        assert np.array_equal(ds.read(masked=True).mask, made.read(masked=True).mask) and made.nodata == ds.nodata == -9999
        assert (made.crs, made.transform) == (ds.crs, ds.transform)


def test_bands_that_differ_in_what_they_lack(tmp_path: Path) -> None:
    array, out = noise((3, 70, 80), "float32"), tmp_path / "o.goblin"
    mask = np.zeros(array.shape, bool)
    mask[:, 5:9, 7] = True
    spinney.build(np.ma.array(array, mask=mask, fill_value=17), out)
    with spinney.open(out) as ds:
        assert np.array_equal(ds.read(masked=True).mask, mask) and ds.nodata is None
    out.unlink()
    mask[1, 60, 70] = True
    lacking = np.where(mask, np.nan, array)
    for source in (np.ma.array(array, mask=mask), lacking, np.ma.array(lacking), np.ma.array(array.astype("uint8"), mask=mask)):
        with pytest.raises(ValueError, match="row 60, column 70.*nodata="):
            spinney.build(source, out)
        assert os.listdir(tmp_path) == []
        if source.dtype == np.float32:
            spinney.build(source, out, nodata=-1)
            with spinney.open(out) as ds:
                found = ds.read(masked=True)
                assert np.array_equal(found.mask, mask) and np.array_equal(found.compressed(), array[~mask])
            out.unlink()
    spinney.build(lacking, out, mask=mask.any(axis=0))
    with spinney.open(out) as ds:
        assert np.array_equal(ds.read(masked=True).mask, np.broadcast_to(mask.any(axis=0), mask.shape))


def test_masks_of_dask_and_masks_that_are_none(tmp_path: Path) -> None:
    dask = pytest.importorskip("dask.array")
    xr = pytest.importorskip("xarray")
    array, mask, out = noise((300, 290), "int16"), noise((300, 290), "uint8") > 120, tmp_path / "o.goblin"
    lazy = dask.from_array(array, chunks=100)
    masked = dask.ma.masked_array(lazy, mask=dask.from_array(mask, chunks=100))
    options: dict
    for source, options in [
        (masked, {}),
        (lazy, {"mask": dask.from_array(mask, chunks=90)}),
        (array, {"mask": xr.DataArray(mask, dims=("y", "x"))}),
        (xr.DataArray(masked, dims=("y", "x")), {}),
    ]:
        spinney.build(source, out, **options)
        with spinney.open(out) as ds:
            assert np.array_equal(ds.read(1, masked=True).mask, mask)
    spinney.build(array, out, mask=np.ma.nomask)
    out.unlink()
    with pytest.raises(TypeError, match="true where a cell is VOID"):
        spinney.build(array, out, mask=np.where(mask, 0, 255).astype("uint8"))
    with pytest.raises(ValueError, match="one mask for all bands"):
        spinney.build(np.stack([array] * 2).astype("u1"), out, mask=np.stack([mask] * 2))


@pytest.mark.parametrize(
    ("given", "kept"),
    [("?", "uint8"), ("i1", "int8"), (">i8", "int64"), (">u8", "uint64"), ("f2", "float32"), (">u2", "uint16"), (">i4", "int32"), (">f4", "float32"), (">f8", "float64")],
)
def test_types_of_samples_that_are_kept(tmp_path: Path, given: str, kept: str) -> None:
    array = (noise((40, 50), "uint8") % 2).astype(given)
    spinney.build(array, tmp_path / "o.goblin")
    with spinney.open(tmp_path / "o.goblin") as ds:
        assert ds.dtype == kept and np.array_equal(ds[...], array.astype(kept))
        # (Booleans are classes: their mean would be rounded to 0 or 1.)
        assert ds.kind == ("categorical" if given == "?" else "continuous")


@pytest.mark.parametrize(
    ("dtype", "advice"),
    [
        ([("a", "u1"), ("b", "f4")], "one of its fields"),
        ("c8", "array.real"),
        ("longdouble", "float64"),
        ("M8[s]", "convert"),
        ("O", "convert"),
        ("U3", "convert"),
    ],
)
def test_types_of_samples_that_are_refused(tmp_path: Path, dtype: object, advice: str) -> None:
    with pytest.raises(TypeError, match=advice):
        spinney.build(np.zeros((4, 4), dtype), tmp_path / "o.goblin")  # type: ignore[call-overload]
    assert os.listdir(tmp_path) == []


def test_invalid_sources_and_trees_are_rejected(tmp_path: Path) -> None:
    array = np.ones((4, 4), "u1")
    for name in ("o.tif", "o.PNG", "o.ply", "o.nc", "o.gpkg"):
        for make in (
            lambda out: spinney.build(array, out),
            lambda out: spinney.build(FIXTURES / "island_classes.tif", out),
            lambda out: spinney.build(CLASSES, out),
            lambda out: spinney.convert(CLASSES, out),
            lambda out: spinney.transform(CLASSES, "crop", out),
            lambda out: spinney.combine("over", [CLASSES, CLASSES], out),
        ):
            with pytest.raises(ValueError, match=r"\.goblin .*\.autumn"):
                make(tmp_path / name)
    assert os.listdir(tmp_path) == []
    with pytest.raises(OSError, match="is a TIFF image, not a Spinney file; build one: `spinney build"):
        spinney.open(FIXTURES / "island_classes.tif")
    (tmp_path / "a.las").write_bytes(b"LASF" + bytes(300))
    with pytest.raises(ValueError, match="tree of points"):
        spinney.build(tmp_path / "a.las", tmp_path / "o.goblin")


def test_pages_are_reported(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    pages = [noise((30, 40), "uint8", seed) for seed in (1, 2, 3)]
    about = {"count": 1, "dtype": "uint8", "width": 40, "height": 30, "driver": "GTiff"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for index, page in enumerate(pages):
            more = {"APPEND_SUBDATASET": "YES"} if index else {}
            with rasterio.open(tmp_path / "p.tif", "w", **about, **more) as file:
                file.write(page, 1)
    with pytest.raises(ValueError, match="3 pages.*pages="):
        spinney.build(tmp_path / "p.tif", tmp_path / "o.goblin")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number, page in enumerate(pages):
            spinney.build(tmp_path / "p.tif", tmp_path / "o.goblin", pages=number)
            with spinney.open(tmp_path / "o.goblin") as ds:
                assert np.array_equal(ds[...], page)
    with pytest.raises(ValueError, match="0 to 2"):
        spinney.build(tmp_path / "p.tif", tmp_path / "o.goblin", pages=3)


@pytest.mark.parametrize("masked", [None, False, True])
def test_void_among_values_that_are_all_in_use(tmp_path: Path, masked: bool | None) -> None:
    xr = pytest.importorskip("xarray")
    pytest.importorskip("pyproj")
    out = tmp_path / "o.goblin"
    random = np.random.default_rng(7)
    colours = random.integers(0, 256, (3, 80, 70)).astype("uint8")
    mask = np.broadcast_to(random.random((80, 70)) < 0.2, colours.shape)
    spinney.build(np.ma.array(colours, mask=mask), tmp_path / "t.goblin", transform=(2, 0, 1, 0, -2, 1))
    with xr.open_dataset(tmp_path / "t.goblin", engine="spinney", mask_and_scale=masked) as found:
        array = found.band_data
        wanted = np.where(mask, np.nan if masked is not False else -1, colours.astype("float32"))
        for key in (np.s_[:, :, :], np.s_[1, 70:3:-7, 69:2:-9], np.s_[:, 9, 5:5], np.s_[0:2, 79, ::3], np.s_[2, 7, 9]):
            assert np.array_equal(array[key].values, wanted[key], equal_nan=True)
        assert np.array_equal(array[:, [5, 3, 70]].values, wanted[:, [5, 3, 70]], equal_nan=True)
        spinney.build(array, out)
    with spinney.open(out) as made:
        read = made.read(masked=True)
        assert np.array_equal(read.mask, mask) and np.array_equal(read.compressed(), colours[~mask])
        assert made.dtype == ("uint8" if masked is False else "float32") and made.nodata is None
    # A solid: VOID is empty, also as an array.
    z, y, x = np.indices((20, 30, 40)) - 15
    spinney.build(x**2 + y**2 + z**2 < 90, tmp_path / "s.goblin", dims="zyx")
    with xr.open_dataset(tmp_path / "s.goblin", engine="spinney", mask_and_scale=masked) as found:
        spinney.build(found.band_data, out)
    with spinney.open(tmp_path / "s.goblin") as solid, spinney.open(out) as made:
        same(solid, made)
        assert solid.rule == "occupancy" and made.volume() == solid.volume()


def test_fractional_classes_are_rejected(tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray")
    pytest.importorskip("pyproj")
    with xr.open_dataset(CLASSES, engine="spinney", mask_and_scale=True) as found:
        array = found.band_data.load()
    assert array.dtype.kind == "f"
    array[0, 9, 9] = 2.5
    with pytest.raises(ValueError, match="2.5 is not a uint8; give kind="):
        spinney.build(array, tmp_path / "o.goblin")
    assert os.listdir(tmp_path) == []
    spinney.build(array, tmp_path / "o.goblin", kind="continuous")
    with spinney.open(tmp_path / "o.goblin") as made:
        assert made.dtype == array.dtype and made[9, 9] == 2.5 and made.rule == "mean"


def tetrahedron() -> trimesh.Trimesh:
    vertices = [[0, 0, 0], [6, 0, 0], [0, 6, 0], [0, 0, 6.0]]
    mesh = trimesh.Trimesh(vertices, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], process=False)
    mesh.units = "millimeters"
    return mesh


def test_meshes_are_sources(tmp_path: Path) -> None:
    mesh = tetrahedron()
    (tmp_path / "t.off").write_text("OFF\n4 4 0\n0 0 0\n6 0 0\n0 6 0\n0 0 6\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")
    spinney.build(tmp_path / "t.off", tmp_path / "file.goblin", cells=32, edge="area")
    spinney.build(mesh, tmp_path / "mesh.goblin", cells=32, edge="area")
    with spinney.open(tmp_path / "file.goblin") as ours, spinney.open(tmp_path / "mesh.goblin") as theirs:
        assert np.array_equal(ours[...], theirs[...]) and np.isclose(theirs.volume(), 36.0, rtol=1e-3)
        assert theirs.tags["unit"] == "mm"
    spinney.build_brep((mesh.vertices, mesh.faces), tmp_path / "exact.goblin", snap=1 / 1024)
    with spinney.open_brep(tmp_path / "exact.goblin") as model:
        assert model.volume == 36.0
    for wrong, error in [((mesh.vertices, mesh.faces + 3), IndexError), ((mesh.vertices, mesh.faces[:, :2]), ValueError)]:
        with pytest.raises(error):
            spinney.build(wrong, tmp_path / "no.goblin")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["exact.goblin", "file.goblin", "mesh.goblin", "t.off"]


def test_exact_models_are_combined(tmp_path: Path) -> None:
    mesh = tetrahedron()
    for name, by in [("a", 0.0), ("b", 1.0)]:
        spinney.build_brep((mesh.vertices + by, mesh.faces), tmp_path / f"{name}.goblin", snap=1 / 1024)
    paths = [tmp_path / "a.goblin", tmp_path / "b.goblin"]
    volumes = {}
    for operation in ("union", "and", "a-b"):
        made = spinney.combine(operation, paths, tmp_path / "c.goblin")
        assert isinstance(made, spinney.CombinedModel) and made.before == [4, 4] and not made.is_unbounded
        with spinney.open_brep(tmp_path / "c.goblin") as model:
            volumes[operation] = model.volume
    assert np.isclose(volumes["union"] + volumes["and"], 72.0) and np.isclose(volumes["a-b"] + volumes["and"], 36.0)
    with pytest.raises(ValueError, match="do not apply"):
        spinney.combine("union", paths, tmp_path / "d.goblin", fill=3)


def test_volumes_and_wide_numbers_are_sources(tmp_path: Path) -> None:
    array = np.arange(20 * 30 * 40).reshape(20, 30, 40) % 1000
    np.save(tmp_path / "scan.npy", array.astype("int16"))
    spinney.build(tmp_path / "scan.npy", tmp_path / "scan.goblin", nodata=0)
    with spinney.open(tmp_path / "scan.goblin") as ds:
        assert np.array_equal(ds.read(1, masked=True).filled(0), array)
    for name in ("int64", "uint64"):
        spinney.build(array[0].astype(name), tmp_path / f"{name}.goblin")
        with spinney.open(tmp_path / f"{name}.goblin") as ds:
            assert ds.dtype == name and np.array_equal(ds[...], array[0])


def test_datasets_of_rasterio_and_xarray_are_sources(tmp_path: Path) -> None:
    for name in ("island_elevation.tif", "island_classes.tif", "relief.tif"):
        if not (FIXTURES / name).exists():
            continue
        spinney.build(FIXTURES / name, tmp_path / "file.goblin")
        with rasterio.open(FIXTURES / name) as dataset:
            spinney.build(dataset, tmp_path / "r.goblin", kind=spinney.open(tmp_path / "file.goblin").kind)
        with spinney.open(tmp_path / "file.goblin") as ours, spinney.open(tmp_path / "r.goblin") as theirs:
            a, b = ours.read(masked=True), theirs.read(masked=True)
            assert np.array_equal(a.mask, b.mask) and np.array_equal(a.compressed(), b.compressed()), name
            assert (ours.crs, ours.transform, ours.nodata) == (theirs.crs, theirs.transform, theirs.nodata)
    samples = np.arange(2 * 300 * 400).reshape(2, 300, 400).astype("uint16")
    dataset = xarray.Dataset({name: (("y", "x"), samples[index]) for index, name in enumerate(["red", "green"])})
    spinney.build(dataset, tmp_path / "x.goblin")
    with spinney.open(tmp_path / "x.goblin") as ds:
        assert np.array_equal(ds.read(), samples) and ds.descriptions == ("red", "green")
    spinney.build(dataset[["red"]], tmp_path / "one.goblin")
    with spinney.open(tmp_path / "one.goblin") as ds:
        assert np.array_equal(ds[...], samples[0])


def test_datasets_lose_nothing_in_silence(tmp_path: Path) -> None:
    rgba = np.stack([noise((60, 70), "uint8", seed) for seed in range(4)])
    rgba[3, :20] = 0
    profile = {"driver": "GTiff", "height": 60, "width": 70, "count": 4, "dtype": "uint8"}
    with rasterio.open(tmp_path / "rgba.tif", "w", **profile, photometric="RGB", alpha="YES") as made:
        made.write(rgba)
    with rasterio.open(tmp_path / "nir.tif", "w", **(profile | {"count": 3})) as made:
        made.write(rgba[:3])
        made.colorinterp = [rasterio.enums.ColorInterp.blue, rasterio.enums.ColorInterp.green, rasterio.enums.ColorInterp.red]
    for name in ("rgba.tif", "nir.tif"):
        spinney.build(tmp_path / name, tmp_path / "file.goblin")
        with rasterio.open(tmp_path / name) as dataset:
            spinney.build(dataset, tmp_path / "dataset.goblin")
        with spinney.open(tmp_path / "file.goblin") as ours, spinney.open(tmp_path / "dataset.goblin") as theirs:
            assert np.array_equal(ours.read(masked=True).mask, theirs.read(masked=True).mask), name
            assert np.array_equal(ours.read(), theirs.read()), name
            assert ours.tags.get("colour_roles") == theirs.tags.get("colour_roles"), name
    with rasterio.open(FIXTURES / "island_classes.tif") as dataset:
        spinney.build(dataset, tmp_path / "classes.goblin")
    with spinney.open(tmp_path / "classes.goblin") as ds:
        assert ds.kind == "categorical" and len(ds.colormap) > 5


def test_variables_lose_nothing_in_silence(tmp_path: Path) -> None:
    samples = noise((30, 40), "float32")
    a = xarray.DataArray(samples, dims=("y", "x"), attrs={"units": "m", "long_name": "height", "survey": "1987"})
    b = xarray.DataArray(samples + 1, dims=("y", "x"), attrs={"units": "K", "survey": "1987", "sensor": "B"})
    with pytest.warns(UserWarning, match="sensor"):
        spinney.build(xarray.Dataset({"a": a, "b": b}), tmp_path / "t.goblin")
    with spinney.open(tmp_path / "t.goblin") as ds:
        assert ds.units == ("m", "K") and ds.descriptions == ("height", "b") and ds.tags["survey"] == "1987"
    with pytest.raises(ValueError, match="_FillValue"):
        spinney.build(xarray.Dataset({"a": a, "b": b.assign_attrs(_FillValue=-1)}), tmp_path / "no.goblin")


def test_colours_of_meshes_are_kept(tmp_path: Path) -> None:
    mesh = tetrahedron()
    mesh.visual.face_colors = [[200, 10, 20, 255]] * 4
    spinney.build(mesh, tmp_path / "red.goblin", cells=16, attribute="colour")
    with spinney.open(tmp_path / "red.goblin") as ds:
        found = ds.read(masked=True)
        assert ds.count == 3 and [int(band.max()) for band in found] == [200, 10, 20]
