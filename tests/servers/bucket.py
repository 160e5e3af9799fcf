"""A local S3 bucket (moto), with a proxy in front that counts requests and injects faults.

`with bucket() as maps:` yields one; programs that run with its `environment` reach it as
`maps.url`. Needs moto[s3,server] and boto3.
"""

from __future__ import annotations

import contextlib
import http.client
import http.server
import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

NAME = "maps"
REGION = "eu-north-1"


@dataclass
class Fault:
    """A fault of a request: see `Bucket.fail`."""

    kind: str
    fits: Callable[[str, str], bool]
    after: int
    times: float
    seconds: float


class Bucket:
    """The bucket, with counts of its requests."""

    url = f"s3://{NAME}"

    def __init__(self, port: int) -> None:
        import boto3

        self.server = _Proxy(port, self)
        self.lock = threading.Lock()
        self.faults: list[Fault] = []
        self.environment = {
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": REGION,
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.server.server_address[1]}",
        }
        self.client: Any = boto3.client(
            "s3", endpoint_url=f"http://127.0.0.1:{port}", region_name=REGION, aws_access_key_id="test", aws_secret_access_key="test"
        )
        self.client.create_bucket(Bucket=NAME, CreateBucketConfiguration={"LocationConstraint": REGION})
        self.counts()

    def put(self, name: str, content: bytes) -> str:
        """Puts an object there; returns its URL."""
        self.client.put_object(Bucket=NAME, Key=name, Body=content)
        return f"{self.url}/{name}"

    def get(self, name: str) -> bytes:
        """Returns the bytes of an object."""
        return bytes(self.client.get_object(Bucket=NAME, Key=name)["Body"].read())

    def names(self, prefix: str = "") -> list[str]:
        """Returns the names of all objects."""
        pages = self.client.get_paginator("list_objects_v2").paginate(Bucket=NAME, Prefix=prefix)
        return [item["Key"] for page in pages for item in page.get("Contents", [])]

    def uploads(self) -> list[str]:
        """Returns the names of pending multipart uploads."""
        return [item["Key"] for item in self.client.list_multipart_uploads(Bucket=NAME).get("Uploads", [])]

    def counts(self) -> dict[str, int]:
        """Returns the requests by method, and the bytes "sent" and "received", since the last
        call."""
        with self.lock:
            counts = getattr(self, "counted", {})
            self.counted: dict[str, int] = {}
        return counts

    def count(self, what: str, number: int) -> None:
        with self.lock:
            self.counted[what] = self.counted.get(what, 0) + number

    def fail(self, kind: str, fits: Callable[[str, str], bool], *, after: int = 0, times: float = float("inf"), seconds: float = 0.0) -> None:
        """Makes requests fail from now on: `times` of those whose method and path fit, after the
        first `after` ones.

        Kinds: "500"; "cut", the response is truncated; "slow", it is delayed; "expired", the
        credentials are no longer valid.
        """
        with self.lock:
            self.faults.append(Fault(kind, fits, after, times, seconds))

    def mend(self) -> None:
        """Removes all faults."""
        with self.lock:
            self.faults = []

    def fault(self, method: str, path: str) -> Fault | None:
        with self.lock:
            for fault in self.faults:
                if not fault.fits(method, path):
                    continue
                if fault.after > 0:
                    fault.after -= 1
                elif fault.times > 0:
                    fault.times -= 1
                    return fault
        return None


class _Proxy(http.server.ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 128

    def __init__(self, port: int, bucket: Bucket) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.port, self.bucket = port, bucket
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def handle_error(self, *_: Any) -> None:
        # Clients that do not wait for a response are tested.
        pass


_EXPIRED = b"<?xml version='1.0'?><Error><Code>ExpiredToken</Code><Message>The provided token has expired.</Message></Error>"


class _Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    server: _Proxy

    def log_message(self, *_: Any) -> None:
        pass

    def hand_on(self) -> None:
        bucket = self.server.bucket
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        bucket.count(self.command, 1)
        bucket.count("sent", len(body))
        fault = bucket.fault(self.command, self.path)
        if fault is not None and fault.kind == "slow":
            time.sleep(fault.seconds)
        if fault is not None and fault.kind in ("500", "expired"):
            return self.respond(500 if fault.kind == "500" else 400, [], b"" if self.command == "HEAD" or fault.kind == "500" else _EXPIRED)
        far = http.client.HTTPConnection("127.0.0.1", self.server.port)
        far.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
        for name, value in self.headers.items():
            if name.lower() not in ("connection", "expect"):
                far.putheader(name, value)
        far.endheaders(body)
        reply = far.getresponse()
        came = reply.read()
        far.close()
        bucket.count("received", len(came))
        self.respond(reply.status, reply.getheaders(), came, is_cut=fault is not None and fault.kind == "cut")

    def respond(self, status: int, headers: list[tuple[str, str]], body: bytes, *, is_cut: bool = False) -> None:
        self.send_response(status)
        length = str(len(body))
        for name, value in headers:
            if self.command == "HEAD" and name.lower() == "content-length":
                length = value
            elif name.lower() not in ("content-length", "transfer-encoding", "connection", "date", "server"):
                self.send_header(name, value)
        self.send_header("Content-Length", length)
        self.end_headers()
        self.wfile.write(body[: len(body) // 2] if is_cut else body)
        self.close_connection = self.close_connection or is_cut

    do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = hand_on


@contextlib.contextmanager
def bucket() -> Iterator[Bucket]:
    """Yields a running bucket."""
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    running = Bucket(server.get_host_and_port()[1])
    try:
        yield running
    finally:
        running.server.shutdown()
        running.server.server_close()
        server.stop()
