"""Files on web servers, and in fsspec file systems: the same results as from local files."""

import asyncio
import datetime
import ipaddress
import pickle
import ssl
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
    # (A recently opened file is not opened again, hence another name.)
    server.counts()
    ds = spinney.open(f"{server.url}/stack.goblin?few")
    assert server.counts()["requests"] == 2
    ds.read(window=(0, 0, 20, 20))
    assert server.counts()["requests"] <= 3


def test_queries_in_an_event_loop(server):
    ds, near = spinney.open(f"{server.url}/elevation.goblin"), spinney.open(FIXTURES / "elevation.goblin")
    zone = {"type": "Polygon", "coordinates": [[[301000, 3191000], [304000, 3192000], [302000, 3198000], [301000, 3191000]]]}

    async def query():
        windows = [ds.aread(window=(8 * i, 10, 20, 30)) for i in range(5)]
        return await asyncio.gather(*windows, ds.asample([(30, 30)], coordinates="cells"), ds.azonal(zone, edge="area"))

    *windows, samples, zones = asyncio.run(query())
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
    memory.pipe(f"/directory/{file}", (FIXTURES / file).read_bytes())
    commit = int(name.split("@")[1]) if "@" in name else None
    layer = name.split(":")[1] if ":" in name else None
    far = spinney.open(fsspec.open(f"memory://directory/{file}"), commit=commit, layer=layer)
    near = spinney.open(FIXTURES / name)
    np.testing.assert_array_equal(far.read(), near.read())
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(far)).read(), near.read())
    assert "memory" in repr(far)
    memory.rm(f"/directory/{file}")


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    """Writes a self-signed certificate of 127.0.0.1, and its key."""
    x509 = pytest.importorskip("cryptography.x509")
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "127.0.0.1")])
    now = datetime.datetime.now(datetime.timezone.utc)
    made = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]), critical=False)
        .sign(key, hashes.SHA256())
    )
    path = tmp_path_factory.mktemp("certificate") / "server.pem"
    encoding = serialization.Encoding.PEM
    private = key.private_bytes(encoding, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    path.write_bytes(private + made.public_bytes(encoding))
    return path


def test_servers_show_a_certificate_that_is_known(certificate, monkeypatch):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate)
    with serve(FIXTURES) as server:
        server.socket = context.wrap_socket(server.socket, server_side=True)
        url = f"{server.url.replace('http:', 'https:')}/elevation.goblin"
        with pytest.raises(OSError, match="certificate"):
            spinney.open(url)
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
        for version in (ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3):
            context.minimum_version = context.maximum_version = version
            # (A recently opened file is not opened again, hence another name.)
            far = spinney.open(f"{url}?{version.name}")
            np.testing.assert_array_equal(far.read(), spinney.open(FIXTURES / "elevation.goblin").read())


def test_unreadable_files_are_reported(server):
    with pytest.raises(FileNotFoundError, match="missing.goblin"):
        spinney.open(f"{server.url}/missing.goblin")
    with pytest.raises(ValueError, match="storage option: got `no_such_option`"):
        spinney.open("s3://bucket/x.goblin", storage_options={"no_such_option": 1})
    with pytest.raises(OSError):
        spinney.open("http://127.0.0.1:1/x.goblin")
