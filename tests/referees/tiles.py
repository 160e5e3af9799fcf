#!/usr/bin/env python3
"""Tiles as other readers see them: the `pmtiles` packages for Python and JavaScript, SQLite, GDAL.

    tests/referees/tiles.py PATH/TO/spinney

Needs Python with numpy, pillow and pmtiles. Optional: node with the package `pmtiles` (in the
directory NODE_DIRECTORY), GDAL's programs.
"""

import io
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from pmtiles.reader import MmapSource, Reader, all_tiles
from pmtiles.tile import tileid_to_zxy, zxy_to_tileid

SPINNEY = Path(sys.argv[1]).resolve()
HALF = 20037508.342789244
SIDE, ZOOMS = 2048, 3

JAVASCRIPT = """
const {PMTiles} = require('pmtiles'); const fs = require('fs');
class FileSource {
  constructor(path) { this.path = path; this.file = fs.openSync(path, 'r'); }
  getKey() { return this.path; }
  async getBytes(offset, length) {
    const buffer = Buffer.alloc(length);
    const read = fs.readSync(this.file, buffer, 0, length, offset);
    return {data: buffer.buffer.slice(buffer.byteOffset, buffer.byteOffset + read)};
  }
}
(async () => {
  const archive = new PMTiles(new FileSource(process.argv[1]));
  const header = await archive.getHeader(), metadata = await archive.getMetadata();
  const tiles = {};
  for (let z = 0; z <= header.maxZoom; z++) for (let x = 0; x < 1 << z; x++) for (let y = 0; y < 1 << z; y++) {
    const tile = await archive.getZxy(z, x, y);
    if (tile) tiles[`${z}/${x}/${y}`] = Buffer.from(tile.data).toString('base64');
  }
  console.log(JSON.stringify({header, metadata, tiles}));
})();
"""


def run(*words, **more):
    return subprocess.run([str(word) for word in words], check=True, **more)


def spinney(*words):
    run(SPINNEY, "-q", *words)


def world(directory):
    """Builds a map of classes of the world as a tree with the world as its root, without GDAL:
    noise, patches, and a hole."""
    random = np.random.default_rng(3)
    cells = np.repeat(np.repeat(random.integers(1, 7, (64, 64), np.uint8), SIDE // 64, 0), SIDE // 64, 1)
    cells[:600, :700] = random.integers(1, 7, (600, 700), np.uint8)
    cells[1024:, 1024:] = 0
    cells[1024:, :1024] = 5
    # A TIFF file of one strip, with a palette and a frame, and as few tags as possible.
    tags, out_of_line = [], b""
    start = 8 + cells.size
    palette = np.array([(number * 40 % 256, 255 - number, number * 97 % 256) for number in range(256)], np.uint16)
    cell = 2 * HALF / SIDE
    values = [
        (256, 4, [SIDE]), (257, 4, [SIDE]), (258, 3, [8]), (259, 3, [1]), (262, 3, [3]), (273, 4, [8]), (277, 3, [1]),
        (278, 4, [SIDE]), (279, 4, [cells.size]), (320, 3, list((palette.T * 257).ravel())),
        (33550, 12, [cell, cell, 0.0]), (33922, 12, [0.0, 0.0, 0.0, -HALF, HALF, 0.0]),
        (34735, 3, [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 3857]), (42113, 2, b"0\0"),
    ]
    kinds = {2: "S1", 3: "<u2", 4: "<u4", 12: "<f8"}
    after = start + 2 + 12 * len(values) + 4
    for tag, kind, value in values:
        data = value if kind == 2 else np.array(value, kinds[kind]).tobytes()
        if len(data) > 4:
            place = (after + len(out_of_line)).to_bytes(4, "little")
            out_of_line += data + b"\0" * (len(data) % 2)
        else:
            place = data.ljust(4, b"\0")
        tags.append(tag.to_bytes(2, "little") + kind.to_bytes(2, "little") + len(value).to_bytes(4, "little") + place)
    tiff = directory / "world.tif"
    tiff.write_bytes(b"II*\0" + start.to_bytes(4, "little") + cells.tobytes() + len(tags).to_bytes(2, "little")
                     + b"".join(tags) + bytes(4) + out_of_line)
    tree = directory / "world.goblin"
    spinney("build", tiff, "-o", tree)
    return tree


def pixels(data):
    return np.array(Image.open(io.BytesIO(data)).convert("RGBA"))


def expected(directory, tree, z, x, y):
    """Returns what `get` draws for a tile's node."""
    image = directory / "part.png"
    side = SIDE >> z
    spinney("get", tree, image, "--window", f"{x * side},{y * side},{side},{side}", "--level", str(z + 8))
    return pixels(image.read_bytes())


def main():
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        tree = world(directory)
        archive, database = directory / "t.pmtiles", directory / "t.mbtiles"
        for target in (archive, database, f"{directory}/t/{{z}}/{{x}}/{{y}}.png"):
            spinney("export", tree, target, "--attribution", "the authors", "--name", "Classes")
        for target in (archive, database, directory / "t"):
            spinney("verify", target)

        with open(archive, "rb") as file:
            source = MmapSource(file)
            reader = Reader(source)
            header, metadata = reader.header(), reader.metadata()
            tiles = {place: data for place, data in all_tiles(source)}
            for (z, x, y), data in tiles.items():
                assert reader.get(z, x, y) == data
                assert tileid_to_zxy(zxy_to_tileid(z, x, y)) == (z, x, y)
        assert (header["version"], header["clustered"], header["min_zoom"], header["max_zoom"]) == (3, True, 0, ZOOMS)
        assert header["addressed_tiles_count"] == len(tiles)
        assert header["tile_contents_count"] == len(set(tiles.values())) < len(tiles)
        assert (metadata["name"], metadata["attribution"]) == ("Classes", "the authors")
        assert abs(header["min_lat_e7"] + 850511288) <= 1 and header["max_lon_e7"] == 1800000000
        missing = [(z, x, y) for z in range(ZOOMS + 1) for x in range(1 << z) for y in range(1 << z)
                   if (z, x, y) not in tiles]
        assert all(2 * x >= 1 << z and 2 * y >= 1 << z for z, x, y in missing) and missing
        for (z, x, y), data in tiles.items():
            here, there = pixels(data), expected(directory, tree, z, x, y)
            here[here[..., 3] == 0] = there[there[..., 3] == 0] = 0
            assert (here == there).all(), (z, x, y)
            assert (directory / "t" / str(z) / str(x) / f"{y}.png").read_bytes() == data
        print(f"pmtiles (Python): {len(tiles)} tiles are what get draws")

        connection = sqlite3.connect(database)
        rows = connection.execute("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles").fetchall()
        assert {(z, x, (1 << z) - 1 - y): data for z, x, y, data in rows} == tiles
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        facts = dict(connection.execute("SELECT name, value FROM metadata"))
        assert (facts["format"], facts["minzoom"], facts["maxzoom"], facts["name"]) == ("png", "0", str(ZOOMS), "Classes")
        assert len(facts["bounds"].split(",")) == 4 and len(facts["center"].split(",")) == 3
        connection.close()
        print("sqlite3: the same tiles")

        if shutil.which("gdalinfo"):
            facts = json.loads(run("gdalinfo", "-json", database, capture_output=True).stdout)
            assert facts["driverShortName"] == "MBTiles" and facts["size"] == [SIDE, SIDE], facts["size"]
            image = directory / "whole.png"
            run("gdal_translate", "-q", "-of", "PNG", database, image)
            here = pixels(image.read_bytes())
            for (z, x, y), data in tiles.items():
                if z == ZOOMS:
                    there = pixels(data)
                    part = here[y * 256:y * 256 + 256, x * 256:x * 256 + 256].copy()
                    part[part[..., 3] == 0] = there[there[..., 3] == 0] = 0
                    assert (part == there).all(), (z, x, y)
            print("GDAL: MBTiles as one image is the same")

        modules = os.environ.get("NODE_DIRECTORY")
        if modules and shutil.which("node"):
            result = run("node", "-e", JAVASCRIPT, archive, cwd=modules, capture_output=True).stdout
            result = json.loads(result)
            import base64
            found = {tuple(map(int, place.split("/"))): base64.b64decode(data) for place, data in result["tiles"].items()}
            assert found == tiles and result["metadata"]["name"] == "Classes"
            print("pmtiles (JavaScript): the same tiles")
        else:
            print("skipped: no node with pmtiles (NODE_DIRECTORY)")


if __name__ == "__main__":
    main()
