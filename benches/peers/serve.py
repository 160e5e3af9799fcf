#!/usr/bin/env python3
"""The server: tiles per second, at 32 connections, and memory over mixed requests.

Tiles of 256 pixels of the trees' own grids: random ones of the two deepest zooms, 2,000 in turn, by
oha, or without it by clients in two processes. They are compared with titiler's tiles of the same
maps as COG, on the grid of degrees (WorldCRS84Quad), with which the maps are aligned, so that it
warps nothing, and with martin's tiles from PMTiles that we have drawn (web mercator). Then 10,000
mixed requests: windows, tiles of both grids, points, statistics of polygons, and ranges of files;
memory is the process's private memory (RssAnon) after each tenth of them.

    cargo install oha martin --locked

titiler.core and uvicorn are taken from the Python given by PEERS_PYTHON (default: this one), the
programs from the path or from OHA and MARTIN; missing peers are omitted. SECONDS is the time of
each measurement (5), REQUESTS the number of mixed ones (10000).
"""

import json
import multiprocessing
import os
import random
import selectors
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from common import RELIEF, SHORELINE, SPINNEY, WORK, private_memory, record, row, start, table, tree, verdict

SECONDS = float(os.environ.get("SECONDS", 5))
REQUESTS = int(os.environ.get("REQUESTS", 10_000))
PYTHON = Path(os.environ.get("PEERS_PYTHON", sys.executable))
OHA, MARTIN = (os.environ.get(name.upper(), shutil.which(name)) for name in ("oha", "martin"))
CONNECTIONS = 32
PROCESSES = 2

TITILER = """
import sys, uvicorn
from fastapi import FastAPI
from titiler.core.errors import DEFAULT_STATUS_CODES, add_exception_handlers
from titiler.core.factory import TilerFactory
app = FastAPI()
app.include_router(TilerFactory().router)
add_exception_handlers(app, DEFAULT_STATUS_CODES)
uvicorn.run(app, port=int(sys.argv[1]), log_level='error', access_log=False)
"""


COG = """
import sys
from rasterio.shutil import copy
copy(*sys.argv[1:3], driver='COG', COMPRESS='ZSTD', BLOCKSIZE=256, OVERVIEW_RESAMPLING=sys.argv[3])
"""


class Client:
    """A connection with sequential requests."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.buffer = b""

    def send(self, request):
        self.socket.sendall(request)
        self.buffer = b""
        self.wanted = None

    def receive(self):
        """Reads available data; returns status and bytes once the response is complete."""
        received = self.socket.recv(1 << 18)
        if not received:
            raise ConnectionError("the server closed the connection")
        self.buffer += received
        if self.wanted is None:
            end = self.buffer.find(b"\r\n\r\n")
            if end < 0:
                return None
            head = self.buffer[:end].lower()
            at = head.find(b"content-length:")
            length = int(head[at + 15:].split(b"\r\n")[0]) if at >= 0 else 0
            self.status = int(self.buffer[9:12])
            self.wanted = end + 4 + length
        return (self.status, len(self.buffer)) if len(self.buffer) >= self.wanted else None


def get(target, more=""):
    return f"GET {target} HTTP/1.1\r\nHost: 127.0.0.1\r\n{more}\r\n".encode()


def work(port, requests, connections, seconds, results):
    """Sends requests in turn for some seconds, on some connections; puts the number of responses,
    and their bytes, into the queue `results`."""
    selector, turn = selectors.DefaultSelector(), 0
    for _ in range(connections):
        client = Client(port)
        client.send(requests[turn % len(requests)])
        turn += 1
        selector.register(client.socket, selectors.EVENT_READ, client)
    began, count, total, bad = time.perf_counter(), 0, 0, 0
    while (now := time.perf_counter()) - began < seconds:
        for key, _ in selector.select(1):
            result = key.data.receive()
            if result:
                count, total, bad = count + 1, total + result[1], bad + (result[0] >= 400)
                key.data.send(requests[turn % len(requests)])
                turn += 1
    results.put((count / (now - began), total, bad))


def rate_by_oha(port, targets):
    """Returns tiles per second, as oha counts them."""
    file = WORK / "addresses.txt"
    file.write_text("".join(f"http://127.0.0.1:{port}{target}\n" for target in targets))
    words = [OHA, "--urls-from-file", file, "-c", str(CONNECTIONS), "-z", f"{SECONDS}s", "--no-tui", "--output-format", "json"]
    report = json.loads(subprocess.check_output(words))
    if set(report["statusCodeDistribution"]) != {"200"}:
        sys.exit(f"requests failed: {report['statusCodeDistribution']}")
    return report["summary"]["requestsPerSec"], report["summary"]["sizePerRequest"]


def rate(port, targets):
    """Returns responses per second, and the mean bytes of one."""
    if OHA:
        return rate_by_oha(port, targets)
    requests = [get(target) for target in targets]
    results = multiprocessing.Queue()
    def start(part):
        process = multiprocessing.Process(target=work, args=(port, part, CONNECTIONS // PROCESSES, SECONDS, results))
        process.start()
        return process
    processes = [start(requests[number::PROCESSES]) for number in range(PROCESSES)]
    found = [results.get() for _ in processes]
    for process in processes:
        process.join()
    if any(bad for _, _, bad in found):
        sys.exit(f"requests failed: {found}")
    per_second = sum(count for count, _, _ in found)
    return per_second, sum(total for _, total, _ in found) / max(1, per_second * SECONDS)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait_for(port):
    for _ in range(600):
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            return
        except OSError:
            time.sleep(0.1)
    sys.exit("the server does not listen")


def processor(pid):
    """Returns the processor seconds that a process has taken."""
    words = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def send(client, request):
    client.send(request)
    while not (result := client.receive()):
        pass
    if result[0] >= 400:
        sys.exit(f"{result[0]}: {request[:200]}: {client.buffer[-300:]}")


def ours(name, count=2000):
    """Returns tiles of a tree's own grid: random ones of its two deepest zooms."""
    generator, (columns, rows), depth = random.Random(7), SIZES[name], DEPTHS[name]
    def tile():
        zoom = depth - 8 - generator.randrange(2)
        side = 256 << (depth - 8 - zoom)
        x, y = generator.randrange(columns // side), generator.randrange(rows // side)
        return f"/tiles/{name}/{zoom}/{x}/{y}.png?grid=native"
    return [tile() for _ in range(count)]


def theirs(name, path, count=2000):
    """Returns as many tiles of about the same size on the grid of degrees."""
    generator, (columns, _) = random.Random(7), SIZES[name]
    deepest = max(zoom for zoom in range(20) if 512 << zoom <= columns * 1.5)
    def tile():
        zoom = deepest - generator.randrange(2)
        x, y = generator.randrange(2 << zoom), generator.randrange(1 << zoom)
        scale = "&rescale=-8000,6000" if name == "relief" else ""
        return f"/tiles/WorldCRS84Quad/{zoom}/{x}/{y}.png?url={path}{scale}"
    return [tile() for _ in range(count)]


def drawn(name, deepest, count=2000):
    """Returns as many tiles of an archive in web mercator."""
    generator = random.Random(7)
    def tile():
        zoom = deepest - generator.randrange(2)
        return f"/{name}/{zoom}/{generator.randrange(1 << zoom)}/{generator.randrange(1 << zoom)}"
    return [tile() for _ in range(count)]


SIZES = {"shoreline": (43200, 21600), "relief": (4320, 2160)}
DEPTHS = {"shoreline": 16, "relief": 13}


def mixed(generator):
    """Returns a random request of any kind."""
    name = generator.choice(["shoreline", "relief"])
    lon, lat = generator.uniform(-170, 160), generator.uniform(-80, 75)
    kind = generator.randrange(6)
    if kind == 0:
        return get(f"/point/{name}?x={lon}&y={lat}&crs=lonlat")
    if kind == 1:
        size = generator.choice([64, 200, 512])
        style = generator.choice(["", "&style=viridis"]) if name == "relief" else ""
        return get(f"/window/{name}?bounds={lon},{lat},{lon + 10},{lat + 5}&crs=lonlat&size={size}{style}")
    if kind == 2:
        return get(*ours(name, 1))
    if kind == 3:
        zoom = generator.randrange(5)
        return get(f"/tiles/{name}/{zoom}/{generator.randrange(1 << zoom)}/{generator.randrange(1 << zoom)}.png")
    if kind == 4:
        first = generator.randrange(1 << 20)
        return get(f"/{name}.goblin", f"Range: bytes={first}-{first + generator.randrange(1 << 17)}\r\n")
    ring = [[lon, lat], [lon + 4, lat], [lon + 3, lat + 4], [lon, lat]]
    body = json.dumps({"type": "Polygon", "coordinates": [ring]})
    return f"POST /zonal/{name}?edge=area HTTP/1.1\r\nHost: x\r\nContent-Length: {len(body)}\r\n\r\n{body}".encode()


def main():
    start(peer="python3")
    directory = WORK / "served"
    directory.mkdir(exist_ok=True)
    for name, source in [("shoreline", SHORELINE), ("relief", RELIEF)]:
        tree(source, directory / f"{name}.goblin")
    server = subprocess.Popen([SPINNEY, "serve", "-q", "--port", "0", directory], stdout=subprocess.PIPE, text=True)
    port = int(server.stdout.readline().rstrip("/\n").rsplit(":", 1)[1])
    found, rows = {}, []
    for name, targets in [*((f"tiles of {name}", ours(name)) for name in SIZES), ("/healthz", ["/healthz"] * PROCESSES)]:
        before = processor(server.pid)
        per_second, size = found[name] = rate(port, targets)
        each = (processor(server.pid) - before) / (per_second * SECONDS)
        rows.append([f"{name}, {CONNECTIONS} connections", f"{per_second:,.0f} /s", f"{size:,.0f} B", f"{each * 1e3:.2g} ms of processor time each"])

    generator, client, memory = random.Random(3), Client(port), []
    began = time.perf_counter()
    for number in range(REQUESTS):
        send(client, mixed(generator))
        if (number + 1) % (REQUESTS // 10) == 0:
            memory.append(private_memory(server.pid))
    took = time.perf_counter() - began
    rows.append([f"{REQUESTS:,} mixed requests, one connection", f"{REQUESTS / took:,.0f} /s", "", ""])
    flat = max(memory[4:]) / memory[4]
    rows.append(["private memory after each tenth of these, MiB", " ".join(f"{mib:.0f}" for mib in memory), f"{flat:.3g} of that after half", verdict(max(memory), 150, False)])
    server.terminate()
    server.wait()
    jobs = {name: f"tiles, {name}, {CONNECTIONS} connections" for name in SIZES}
    results = [
        row("/healthz", "/s", found["/healthz"][0]),
        row(f"{REQUESTS:,} mixed requests: memory", "MiB", max(memory), note=f"{min(memory):.0f} to {max(memory):.0f}."),
        row(f"{REQUESTS:,} mixed requests, one connection", "/s", REQUESTS / took),
    ]

    has_titiler = subprocess.run([PYTHON, "-c", "import titiler.core, uvicorn"], stderr=subprocess.DEVNULL).returncode == 0
    if has_titiler:
        other_port = free_port()
        environment = {**os.environ, "GDAL_CACHEMAX": "512", "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR"}
        other = subprocess.Popen([PYTHON, "-c", TITILER, str(other_port)], env=environment)
        wait_for(other_port)
        for name, source in [("shoreline", SHORELINE), ("relief", RELIEF)]:
            path = WORK / f"served_{name}_cog.tif"
            if not path.exists():
                averaged = "MODE" if name == "shoreline" else "AVERAGE"
                subprocess.run([PYTHON, "-c", COG, source, path, averaged], check=True)
            per_second, size = rate(other_port, theirs(name, path))
            results.append(row(jobs[name], "/s", found[f"tiles of {name}"][0], "titiler, COG", per_second))
            rows.append([f"titiler, tiles of {name}", f"{per_second:,.0f} /s", f"{size:,.0f} B", verdict(found[f"tiles of {name}"][0] / per_second, 8)])
        other.terminate()
        other.wait()
    else:
        print("skipped: titiler is not there")
    if MARTIN:
        archives = [WORK / f"{name}.pmtiles" for name in SIZES]
        for name, archive in zip(SIZES, archives):
            if not archive.exists():
                subprocess.run([SPINNEY, "export", "-q", directory / f"{name}.goblin", archive], check=True)
        other_port = free_port()
        other = subprocess.Popen([MARTIN, "--listen-addresses", f"127.0.0.1:{other_port}", *archives], stdout=subprocess.DEVNULL)
        wait_for(other_port)
        for name in SIZES:
            deepest = json.load(urllib.request.urlopen(f"http://127.0.0.1:{other_port}/{name}"))["maxzoom"]
            per_second, size = rate(other_port, drawn(name, deepest))
            results.append(row(jobs[name], "/s", found[f"tiles of {name}"][0], "martin, PMTiles in memory", per_second))
            rows.append([f"martin, tiles of {name}", f"{per_second:,.0f} /s", f"{size:,.0f} B", verdict(found[f"tiles of {name}"][0] / per_second, 0.5)])
        other.terminate()
        other.wait()
    else:
        print("skipped: martin is not there")
    table(["what", "figure", "bytes of one", "verdict"], rows)
    record("server", results)


if __name__ == "__main__":
    main()
