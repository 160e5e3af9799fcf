"""Trees in an S3 bucket: written by upload, read in ranges, with moto as the bucket.

    pip install 'moto[s3,server]' boto3 numpy
    tests/referees/buckets.py PROGRAM FIXTURES

PROGRAM must have support for remote files (the Cargo feature `remote`).
"""

from __future__ import annotations

import json
import logging
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

try:
    import boto3
    import numpy as np
    from moto import settings
    from moto.server import ThreadedMotoServer
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit()

PROGRAM, FIXTURES = sys.argv[1], Path(sys.argv[2])
REGION = "eu-north-1"


def run(*words: str | Path, code: int = 0, **environment: str) -> str:
    """Returns the program's output, or its messages on failure."""
    done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, env={**os.environ, **environment})
    assert done.returncode == code, (words, done.returncode, done.stderr)
    return done.stderr if code else done.stdout


class SlowProxy:
    """Forwards bytes to a server and back, slowly towards the server."""

    def __init__(self, port: int) -> None:
        self.to, self.listener = port, socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.bytes = 0
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self) -> None:
        while True:
            near, _ = self.listener.accept()
            far = socket.create_connection(("127.0.0.1", self.to))
            threading.Thread(target=self.copy, args=(near, far, 0.02), daemon=True).start()
            threading.Thread(target=self.copy, args=(far, near, 0.0), daemon=True).start()

    def copy(self, source: socket.socket, target: socket.socket, pause: float) -> None:
        try:
            while data := source.recv(1 << 16):
                target.sendall(data)
                self.bytes += len(data)
                time.sleep(pause * len(data) / (1 << 16))
        except OSError:
            pass
        for end in (source, target):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass


def main() -> None:
    help_text = subprocess.run([PROGRAM, "info", "s3://maps/none.goblin"], capture_output=True, text=True).stderr
    if "support for remote files" in help_text:
        print("skipped: the program was built without `remote`")
        return
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    port = server.get_host_and_port()[1]
    endpoint = f"http://127.0.0.1:{port}"
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        del os.environ[name]
    keys = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_REGION": REGION}
    os.environ.update(keys, AWS_ENDPOINT_URL=endpoint, HOME=tempfile.gettempdir())
    client = boto3.client("s3", endpoint_url=endpoint, region_name=REGION)
    client.create_bucket(Bucket="maps", CreateBucketConfiguration={"LocationConstraint": REGION})

    def uploads() -> list[object]:
        return client.list_multipart_uploads(Bucket="maps").get("Uploads", [])

    def objects() -> list[str]:
        return [item["Key"] for item in client.list_objects_v2(Bucket="maps").get("Contents", [])]

    # Small files, each by one request.
    for name in ["classes.goblin", "elevation.goblin", "history.autumn"]:
        url = f"s3://maps/directory/{name}"
        run("convert", FIXTURES / name, "-o", url)
        near, far = json.loads(run("stats", "--json", FIXTURES / name)), json.loads(run("stats", "--json", url))
        near.pop("file", None), far.pop("file", None)
        assert near == far, name
        assert "good" in run("verify", url)
    assert objects() == [f"directory/{name}" for name in ("classes.goblin", "elevation.goblin", "history.autumn")]

    # Patterns of objects, more than a page of them, and an index next to its source.
    relief = (FIXTURES.parent / "island_elevation.tif").read_bytes()
    names = ["dem/a 1%.tif", "dem/a2.tif", "dem/b.tif", "dem/a/3.tif", "dem/e/3.tif", "many/z.tif", "one.tif"]
    for name in names:
        client.put_object(Bucket="maps", Key=name, Body=relief)
    for number in range(1005):
        client.put_object(Bucket="maps", Key=f"many/{number}.txt", Body=b"1")
    for pattern, count in [("dem/a*.tif", 2), ("dem/*.tif", 3), ("dem/*/3.tif", 2), ("many/*.tif", 1), ("one.tif", 1), ("*.tif", 1)]:
        index = "s3://maps/index.goblin"
        run("index", f"s3://maps/{pattern}", "-o", index)
        assert json.loads(run("info", "--json", index))["source_count"] == count, pattern
    assert "no file has such a name" in run("index", "s3://maps/dem/c*.tif", "-o", index, code=1)
    assert "a pattern of buckets" in run("index", "s3://m*/x.tif", "-o", index, code=1)
    refused = run("stats", "s3://maps/one.tif", code=1)
    assert "`spinney index s3://maps/one.tif -o s3://maps/one.tif.goblin`" in refused, refused
    run("index", "s3://maps/one.tif", "-o", "s3://maps/one.tif.goblin")
    printed = [json.loads(run("stats", "--json", name)) for name in ("s3://maps/one.tif", "s3://maps/one.tif.goblin")]
    for one in printed:
        one.pop("file", None)
    assert printed[0] == printed[1]
    asset = {"href": "./dem/b.tif", "type": "image/tiff; application=geotiff", "roles": ["data"]}
    item = {"type": "Feature", "stac_version": "1.0.0", "id": "b", "assets": {"dem": asset}, "links": []}
    client.put_object(Bucket="maps", Key="item.json", Body=json.dumps(item).encode())
    run("index", "s3://maps/item.json", "-o", index)
    assert [source["path"] for source in json.loads(run("info", "--json", index))["sources"]] == ["dem/b.tif"]

    with tempfile.TemporaryDirectory() as directory:
        # A large one, as a multipart upload.
        noise = Path(directory) / "noise.npy"
        np.save(noise, np.random.default_rng(1).integers(0, 255, (256, 300, 300), dtype=np.uint8))
        near = Path(directory) / "noise.goblin"
        run("build", noise, "-o", near)
        assert near.stat().st_size > 20 << 20
        run("convert", near, "-o", "s3://maps/noise.goblin")
        assert client.head_object(Bucket="maps", Key="noise.goblin")["ContentLength"] == near.stat().st_size
        copy = client.get_object(Bucket="maps", Key="noise.goblin")["Body"].read()
        assert copy == near.read_bytes() and not uploads()
        window = ("--window", "20,30,50,40", "--slice", "z=100")
        cells = [Path(directory) / name for name in ("near.npy", "far.npy")]
        run("get", near, cells[0], *window)
        completed = subprocess.run([PROGRAM, "-v", "get", "s3://maps/noise.goblin", cells[1], *window], capture_output=True, text=True)
        assert cells[0].read_bytes() == cells[1].read_bytes()
        assert int(completed.stderr.split(", ")[-1].split()[0]) < 8 << 20, completed.stderr

        # An interrupted upload leaves no object.
        proxy = SlowProxy(port)
        slow = {**os.environ, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{proxy.port}"}
        process = subprocess.Popen(
            [PROGRAM, "-q", "convert", str(near), "-o", "s3://maps/never.goblin"],
            env=slow,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        while proxy.bytes < 2 << 20:
            time.sleep(0.05)
            assert process.poll() is None, "it was done before it could be interrupted"
        process.send_signal(signal.SIGINT)
        began = time.monotonic()
        assert process.wait(60) == 130
        print(f"interrupted: {time.monotonic() - began:.1f} s")
        assert "never.goblin" not in objects() and not uploads()

    # Missing or invalid keys are rejected with a message.
    settings.INITIAL_NO_AUTH_ACTION_COUNT = 0
    refused = run("info", "s3://maps/directory/classes.goblin", code=1)
    assert "403" in refused and "s3://maps/directory/classes.goblin" in refused, refused
    refused = run("convert", FIXTURES / "classes.goblin", "-o", "s3://maps/no.goblin", code=1)
    assert "403" in refused, refused
    print("good")
    server.stop()


if __name__ == "__main__":
    main()
