#!/usr/bin/env python3
"""A tree of 100 GB on a web server with a latency of 50 ms per response: opening it, a tile, and
2,000 random points, with the memory that this takes.

    pip install numpy crc32c
    cargo build --release --features remote
    benches/peers/sparse.py

The file is made here as formats.md specifies: 2^18 x 2^18 cells, all of them 0, with a segment for
each node as if all differed. It is sparse: it takes 5 GB of disk space, which are freed at the end.
"""

import os
import random
import re
import struct
import subprocess
import sys
import tempfile

import numpy as np
from crc32c import crc32c

from common import ROOT, SPINNEY, WORK, record, row, table

sys.path.insert(0, str(ROOT / "tests" / "servers"))
from ranges import serve  # noqa: E402

DEPTH, REACH, STRIDE = 18, 8, 2
BLOCKS = DEPTH - REACH
SLOTS, RECORD = 10923, 8
SEGMENT = SLOTS * RECORD
PAGE, INDEX_PAGE = 128, 256


def segment(kind):
    """Returns a dense block of 8 levels, all zeros: mark 1 has cells at its bottom, mark 2 nodes
    that are cut off."""
    record = bytes(4) + b"\xaa" + struct.pack("<I", SLOTS | kind << 21)[:3]
    return record + bytes(SEGMENT - len(record))


def codes(level):
    """Returns FD codes of all nodes of a level, ascending."""
    paths = np.arange(4**level, dtype=np.uint64)
    return (paths << np.uint64(63 - 2 * level) if level else paths) | np.uint64(level)


def make(path, model):
    """Writes the file; header and metadata are those of a small one."""
    small = model.read_bytes()
    length = struct.unpack("<I", small[-16:-12])[0]
    trailer = small[-16 - length : -16]
    at, size = struct.unpack("<QQ", trailer[44:60])
    layers = bytearray(small[at : at + size])
    metadata_at, metadata_bytes = struct.unpack("<QI", layers[136:148])
    metadata = small[metadata_at : metadata_at + metadata_bytes]

    levels = [0, *range(BLOCKS % STRIDE or STRIDE, BLOCKS + 1, STRIDE)]
    code = np.concatenate([codes(level) for level in levels])
    level = np.concatenate([np.full(4**level, level, np.uint64) for level in levels])
    order = np.argsort(code)
    code, level = code[order], level[order]
    # In postorder, the top levels after all others.
    span = np.uint64(1) << (np.uint64(63) - np.uint64(2) * level)
    last = (code & ~np.uint64(31)) + np.where(level == 0, np.uint64(2**63), span) - np.uint64(32)
    top_level = np.uint64(max(BLOCKS - 6, min(BLOCKS, 3)))
    key = (last & ~np.uint64(31)) | (np.uint64(31) - level) | np.where(level < top_level, np.uint64(2**63), np.uint64(0))
    offset = np.empty(len(code), np.uint64)
    offset[np.argsort(key)] = np.arange(len(code), dtype=np.uint64) * np.uint64(SEGMENT)
    bottom = level == BLOCKS
    sums = [crc32c(segment(kind)) for kind in (1, 2)]
    entry = np.zeros(len(code), np.dtype([("code", "<u8"), ("offset", "<u8"), ("length", "<u8"), ("slots", "<u4"), ("classes", "<u2"), ("codec", "<u2"), ("sum", "<u4"), ("cells", "<u8"), ("rest", "S34")]))
    entry["code"], entry["offset"], entry["length"], entry["slots"] = code, offset, SEGMENT, SLOTS
    entry["sum"], entry["cells"] = np.where(bottom, *sums), np.uint64(4) ** (np.uint64(DEPTH) - level)

    directory_at = len(code) * SEGMENT
    pages = []
    for first in range(0, len(code), PAGE):
        own = int(code[first])
        above = []
        for upper in levels:
            if upper < int(level[first]):
                mask = ~((1 << (63 - 2 * upper)) - 1) if upper else 0
                above.append(int(np.searchsorted(code, np.uint64(own & mask & (2**63 - 1) | upper))))
        above.sort()
        entries = entry[first : first + PAGE]
        page = struct.pack("<HHI", len(above), len(entries), 0) + struct.pack(f"<{len(above)}Q", *above)
        pages.append((own, page + entry[above].tobytes() + entries.tobytes()))
    run, index = [], pages
    at = directory_at
    while True:
        index_rows = []
        for first, page in index:
            index_rows.append(struct.pack("<QQII", first, at, len(page), crc32c(page)))
            run.append(page)
            at += len(page)
        if len(index_rows) <= INDEX_PAGE:
            top = b"".join(index_rows)
            break
        groups = [index_rows[group : group + INDEX_PAGE] for group in range(0, len(index_rows), INDEX_PAGE)]
        index = [(struct.unpack("<Q", group[0][:8])[0], b"".join(group)) for group in groups]

    header = bytearray(small[:24])
    header[14] = DEPTH
    header[20:24] = struct.pack("<I", crc32c(bytes(header[:20])))
    layers[5:8] = bytes([DEPTH, REACH, STRIDE])
    layers[24:48] = struct.pack("<3Q", 2**DEPTH, 2**DEPTH, 1)
    layers[48] = 2
    layers[72:152] = bytes(80)
    layers[54:72] = bytes(18)
    layers = bytes(layers[:152])
    above_top_level = sum(4**upper for upper in levels if upper < int(top_level))
    metadata_at = 24 + at
    top_at = metadata_at + len(metadata)
    numbers = struct.pack("<6Q", len(code), len(code) * SLOTS, 24, at, (len(code) - above_top_level) * SEGMENT, directory_at)
    numbers += struct.pack("<QIIQII", top_at, len(top), crc32c(top), metadata_at, len(metadata), crc32c(metadata))
    layers = layers[:72] + numbers
    layers_at = top_at + len(top)
    total = layers_at + len(layers) + 60 + 16
    trailer = bytes(header) + struct.pack("<QI", total, 1) + b"LAYR" + struct.pack("<IQQ", crc32c(layers), layers_at, len(layers))
    end = trailer + struct.pack("<II", len(trailer), crc32c(trailer)) + small[-8:]

    with open(path, "wb") as out:
        out.write(header)
        out.truncate(total)
        file = out.fileno()
        heads = [segment(kind)[:8] for kind in (2, 1)]
        for start, is_bottom in zip(offset.tolist(), bottom.tolist()):
            os.pwrite(file, heads[is_bottom], 24 + start)
        os.pwrite(file, b"".join(run) + metadata + top + layers + end, 24 + directory_at)
    return total


def ours(*words, given=None):
    run = subprocess.run(["/usr/bin/time", "-f", "%M", SPINNEY, "-v", *words], input=given, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"failed: {' '.join(map(str, words))}: {run.stderr}")
    *output, peak = run.stderr.strip().splitlines()
    batches, requests, size = map(int, re.search(r"(\d+) batches, (\d+) requests, (\d+) bytes", "\n".join(output)).groups())
    return batches, requests, round(size / 1024), round(int(peak) / 1024)


if __name__ == "__main__":
    WORK.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=WORK) as directory:
        model, path = WORK / "model.goblin", f"{directory}/sparse.goblin"
        cells = f"{directory}/cells.pgm"
        with open(cells, "wb") as raster:
            raster.write(b"P5 64 64 255\n" + np.random.default_rng(1).integers(0, 255, 4096, np.uint8).tobytes())
        raw = f"{directory}/cells.tif"
        subprocess.run(["gdal_translate", "-q", cells, raw], check=True)
        subprocess.run([SPINNEY, "-q", "build", raw, "--kind", "continuous", "-o", model], check=True)
        size = make(path, model)
        rng = random.Random(3)
        side = 2**DEPTH
        points = "".join(f"{rng.randrange(side)},{rng.randrange(side)}\n" for _ in range(2000))
        with serve(directory, 0.05) as server:
            url = f"{server.url}/sparse.goblin"
            rows = [["a point in no cell (opening)", *ours("point", url, "--in", "cells", f"{side},{side}")]]
            x, y = rng.randrange(side - 256), rng.randrange(side - 256)
            rows.append(["a tile of 256 x 256", *ours("get", url, f"{directory}/tile.npy", "--window", f"{x},{y},256,256")])
            rows.append(["2,000 random points", *ours("point", url, "--in", "cells", given=points)])
        print(f"{size / 1e9:.1f} GB")
        table(["with nothing held", "batches", "requests", "KiB", "peak MiB"], rows)
        results = []
        for name, (_, batches, _, kib, mib) in zip(("opening", "a tile of 256 x 256", "2,000 random points"), rows):
            for end, unit, figure in [("batches", "batches", batches), ("bytes", "KiB", kib), ("memory", "MiB", mib)]:
                results.append(row(f"tree of {size / 1e9:.1f} GB, {name}: {end}", unit, figure))
        record("remote files", results)
