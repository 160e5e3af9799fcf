"""A web server of the files in a directory, which serves ranges, delays each response, and counts.

    python3 tests/servers/ranges.py DIRECTORY [LATENCY [BANDWIDTH]]

prints its URL. LATENCY is in seconds, BANDWIDTH in bytes per second of all responses together.
`URL/-counts` returns requests, bytes and batches since the last call, as JSON; a batch starts with
a request that arrives while no other is served. In Python: `with serve(directory) as server:`.
"""

from __future__ import annotations

import contextlib
import http.server
import json
import math
import re
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any


class _Server(http.server.ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 128

    def __init__(self, directory: str | Path, latency: float, bandwidth: float) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.directory, self.latency, self.bandwidth = Path(directory), latency, bandwidth
        self.lock, self.requests, self.bytes, self.batches = threading.Lock(), 0, 0, 0
        # Requests that are being served, and when the simulated connection is free.
        self.served, self.free = 0, 0.0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def counts(self) -> dict[str, int]:
        """Returns requests, bytes and batches since the last call."""
        with self.lock:
            counts = {"requests": self.requests, "bytes": self.bytes, "batches": self.batches}
            self.requests = self.bytes = self.batches = 0
        return counts

    def transfer(self, length: int) -> None:
        """Waits as long as a response of this length takes, after those before it."""
        with self.lock:
            self.bytes += length
            self.free = max(self.free, time.monotonic()) + length / self.bandwidth
            pause = self.free - time.monotonic()
        if pause > 0:
            time.sleep(pause)


class _Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    server: _Server

    def log_message(self, *_: Any) -> None:
        pass

    def do_HEAD(self) -> None:
        self.respond(False)

    def do_GET(self) -> None:
        self.respond(True)

    def send(self, status: int, body: bytes = b"", length: int | None = None, **headers: str) -> None:
        # (Clients send the next request as soon as they have the response.)
        with self.server.lock:
            self.server.served -= 1
        self.send_response(status)
        self.send_header("Content-Length", str(len(body) if length is None else length))
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(body)

    def respond(self, has_body: bool) -> None:
        with self.server.lock:
            is_counted = self.path != "/-counts"
            self.server.requests += is_counted
            self.server.batches += is_counted and self.server.served == 0
            self.server.served += 1
        if not is_counted:
            return self.send(200, json.dumps(self.server.counts()).encode())
        time.sleep(self.server.latency)
        file = self.server.directory / self.path.split("?")[0].lstrip("/")
        if not file.is_file():
            return self.send(404)
        state = file.stat()
        first, end = 0, state.st_size
        requested = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
        if requested and requested[1]:
            first, end = int(requested[1]), min(int(requested[2]) + 1 if requested[2] else end, end)
        elif requested:
            first = max(0, end - int(requested[2]))
        if requested and first >= state.st_size:
            return self.send(416)
        headers = {"ETag": f'"{state.st_mtime_ns:x}-{state.st_size:x}"', "Accept_Ranges": "bytes"}
        if requested:
            headers["Content_Range"] = f"bytes {first}-{end - 1}/{state.st_size}"
        body = b""
        if has_body:
            with file.open("rb") as bytes_of_file:
                bytes_of_file.seek(first)
                body = bytes_of_file.read(end - first)
            self.server.transfer(len(body))
        self.send(206 if requested else 200, body, end - first, **headers)


@contextlib.contextmanager
def serve(directory: str | Path, latency: float = 0.0, bandwidth: float = math.inf) -> Iterator[_Server]:
    """Yields a running server."""
    server = _Server(directory, latency, bandwidth)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()


if __name__ == "__main__":
    limits = [float(number) for number in sys.argv[2:]]
    started = _Server(sys.argv[1], *limits, *[0.0, math.inf][len(limits) :])
    print(started.url, flush=True)
    started.serve_forever()
