"""Names of files: paths, URLs, fsspec files, open files; options of stores; and files that are
refused.
"""

from __future__ import annotations

import io
import json
import pickle
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinney
from spinney._remote import path_of, storage_of

from conftest import BOX, FIXTURES
from test_remote import serve

fsspec = pytest.importorskip("fsspec")

V1 = FIXTURES / "v1"


@pytest.mark.parametrize("name", ["classes.goblin", "history.autumn", "rgba.goblin"])
def test_open_files(name: str) -> None:
    data = (V1 / name).read_bytes()
    near = spinney.open(V1 / name)
    file = io.BytesIO(data)
    file.seek(17)
    with spinney.open(file) as ds:
        np.testing.assert_array_equal(ds.read(), near.read())
        assert ds.stats() == near.stats() and ds.crs == near.crs
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(ds)).read(), near.read())
        assert file.tell() == 17 and repr(ds).startswith("<spinney.Dataset 'BytesIO::memory")
        ds.check_unchanged()
    with open(V1 / name, "rb") as opened, spinney.open(opened) as ds:
        found: list[Any] = []
        threads = [threading.Thread(target=lambda: found.append(ds.read(window=(1, 2, 5, 4)))) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert all(np.array_equal(part, near.read(window=(1, 2, 5, 4))) for part in found) and len(found) == 8
    with pytest.raises(TypeError, match="text file"):
        spinney.open(io.StringIO("text"))
    with pytest.raises(OSError):
        spinney.open(io.BytesIO(b"no tree"))
    with pytest.raises(OSError):
        spinney.open(io.BytesIO(data[: len(data) // 2]))


def test_open_files_of_other_kinds(tmp_path: Path) -> None:
    model = spinney.open_brep(io.BytesIO((V1 / "chapel.goblin").read_bytes()))
    assert model.volume == spinney.open_brep(V1 / "chapel.goblin").volume
    spinney.build_points(np.random.default_rng(1).random((100, 3)), tmp_path / "p.goblin")
    assert len(spinney.open_points(io.BytesIO((tmp_path / "p.goblin").read_bytes()))) == 100
    xr = pytest.importorskip("xarray")
    with xr.open_dataset(io.BytesIO((V1 / "classes.goblin").read_bytes()), engine="spinney", chunks={}) as ds:
        assert ds.band_data.shape[1:] == spinney.open(V1 / "classes.goblin").shape
        with xr.open_dataset(io.BytesIO((V1 / "rgba.goblin").read_bytes()), engine="spinney", chunks={}) as other:
            assert other.band_data.data.name != ds.band_data.data.name
    with pytest.raises(TypeError, match="expected the name of a file"):
        spinney.verify(io.BytesIO())  # type: ignore[arg-type]


def test_files_of_fsspec_name_files(tmp_path: Path) -> None:
    files = fsspec.filesystem("file")
    local = fsspec.open(str(tmp_path / "t.goblin"), "wb")
    spinney.build(np.arange(20).reshape(4, 5), local)
    with spinney.open(local) as ds:
        assert ds.path == tmp_path / "t.goblin" and ds.mapped is not None
    assert spinney.verify(local) == [] and spinney.diff(local, local).changed == 0
    spinney.transform(local, "mirror=x", fsspec.open(str(tmp_path / "m.goblin"), "wb"))
    spinney.combine("union", [local, tmp_path / "m.goblin"], str(tmp_path / "u.goblin"))
    spinney.build_brep(BOX, fsspec.open(str(tmp_path / "box.goblin"), "wb"))
    assert files.exists(str(tmp_path / "u.goblin")) and spinney.open_brep(fsspec.open(str(tmp_path / "box.goblin"))).volume == 24
    polygons = fsspec.open(str(FIXTURES / "island_districts.geojson"))
    spinney.build(FIXTURES / "island_elevation.tif", tmp_path / "e.goblin")
    with spinney.open(tmp_path / "e.goblin") as ds:
        assert ds.zonal(polygons, "mean") == ds.zonal(FIXTURES / "island_districts.geojson", "mean")
    with serve(tmp_path) as server:
        url = f"{server.url}/t.goblin"
        http = fsspec.open(url)
        assert path_of(http) == url and spinney.verify(http) == []
        np.testing.assert_array_equal(spinney.open(http).read(), spinney.open(local).read())
    memory = fsspec.filesystem("memory")
    memory.pipe("/data/t.goblin", (tmp_path / "t.goblin").read_bytes())
    with pytest.raises(ValueError, match="only Python reads"):
        spinney.verify(fsspec.open("memory://data/t.goblin"))
    with pytest.raises(ValueError, match="compression"):
        spinney.open(fsspec.open("memory://data/t.goblin", compression="gzip"))
    # URLs that only fsspec knows.
    np.testing.assert_array_equal(spinney.open("simplecache::memory://data/t.goblin").read(), spinney.open(local).read())
    with pytest.raises(ValueError, match="fsspec|Protocol"):
        spinney.open("nothing-of-the-kind://x.goblin")
    # A file that was replaced is another version.
    ds = spinney.open(fsspec.open("memory://data/t.goblin"))
    ds.check_unchanged()
    memory.pipe("/data/t.goblin", (V1 / "classes.goblin").read_bytes())
    with pytest.raises(OSError, match="overwritten"):
        ds.check_unchanged()
    memory.rm("/data", recursive=True)


def test_options_by_the_names_of_fsspec() -> None:
    s3 = {"key": "K", "secret": "S", "token": "T", "anon": False, "client_kwargs": {"region_name": "eu-north-1", "endpoint_url": "http://h:9"}, "default_block_size": 9, "endpoint_url": None}
    assert dict(storage_of("s3://b/x", s3)) == {
        "access_key_id": "K",
        "secret_access_key": "S",
        "session_token": "T",
        "skip_signature": "false",
        "region": "eu-north-1",
        "endpoint": "http://h:9",
        "allow_http": "true",
    }
    assert dict(storage_of("s3://b/x", {"aws_region": "eu-north-1", "anon": True, "use_ssl": False})) == {"aws_region": "eu-north-1", "skip_signature": "true", "allow_http": "true"}
    assert storage_of("gs://b/x", {"token": "anon", "project": "p"}) == [("skip_signature", "true")]
    assert storage_of("gs://b/x", {"token": "google_default"}) == []
    assert storage_of("gcs://b/x", {"token": "/keys/me.json"}) == [("google_service_account", "/keys/me.json")]
    ((name, text),) = storage_of("gs://b/x", {"token": {"type": "service_account"}})
    assert name == "google_service_account_key" and json.loads(text) == {"type": "service_account"}
    azure = {"account_name": "a", "account_key": "k", "sas_token": "s", "anon": True}
    assert dict(storage_of("abfs://c/x", azure)) == {"account_name": "a", "account_key": "k", "sas_token": "s", "skip_signature": "true"}
    assert dict(storage_of("az://c/x", {"connection_string": "AccountName=a;AccountKey=k==;EndpointSuffix=core.windows.net"})) == {"account_name": "a", "account_key": "k=="}
    for url, options in (("s3://b/x", {"client_kwargs": {"verify": False}}), ("s3://b/x", {"profile": "p"}), ("gs://b/x", {"token": "browser"}), ("https://h/x", {"client_kwargs": {"auth": 1}})):
        with pytest.raises(ValueError, match="storage_options"):
            storage_of(url, options)


VRT = '<VRTDataset rasterXSize="256" rasterYSize="200"><VRTRasterBand dataType="Byte" band="1"><SimpleSource><SourceFilename>{}</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>'


def test_files_of_unknown_origin(tmp_path: Path) -> None:
    vrt = tmp_path / "t.vrt"
    vrt.write_text(VRT.format(FIXTURES / "island_classes.tif"))
    spinney.build(vrt, tmp_path / "t.goblin")
    with spinney.restricted(no_external=True):
        with pytest.raises(ValueError, match="--no-external"):
            spinney.build(vrt, tmp_path / "x.goblin")
        with spinney.restricted(no_remote=True), pytest.raises(ValueError, match="--no-external"):
            spinney.build(vrt, tmp_path / "x.goblin", threads=2)
        spinney.build(FIXTURES / "island_classes.tif", tmp_path / "x.goblin")
    spinney.build(vrt, tmp_path / "x.goblin")
    with serve(tmp_path) as server:
        url = f"{server.url}/t.goblin"
        with pytest.raises(ValueError, match="--no-remote"):
            spinney.open(url, no_remote=True)
        with spinney.restricted(no_remote=True):
            for use in (spinney.open, spinney.verify, spinney.open_points, spinney.open_brep):
                with pytest.raises(ValueError, match="--no-remote"):
                    use(url)
        # Objects that were opened with it keep it: for files that a view names, for copies, and for
        # other layers.
        with spinney.open(tmp_path / "t.goblin", no_remote=True) as ds:
            again = pickle.loads(pickle.dumps(ds))
            assert again._remote[2] == (True, False)
        with pytest.raises(ValueError, match="--no-remote"):
            spinney.open(tmp_path / "t.goblin", view=f"calc=b1+far,far={url}", no_remote=True)
        assert spinney.open(tmp_path / "t.goblin", view=f"calc=b1+far,far={url}").count == 1
        assert spinney.open(url).count == 1
        # Other threads are not restricted.
        with spinney.restricted(no_remote=True):
            found: list[Any] = []
            thread = threading.Thread(target=lambda: found.append(spinney.open(url).count))
            thread.start()
            thread.join()
            assert found == [1]
