"""Scripts that index.py runs in processes of their own, so that their memory does not count as its
own: input for the jobs, the peers, and referees."""

# Makes a COG.
COG = """
import sys
from rasterio.shutil import copy
source, target, *options = sys.argv[1:]
copy(source, target, driver="COG", **dict(option.split("=") for option in options))
"""

# Class areas of polygons, in one process, after the imports: seconds, and cells of each class.
CLASSES = """
import json, sys, time
from exactextract import exact_extract
zones = json.load(sys.stdin)
began = time.perf_counter()
found = [zone["properties"] for zone in exact_extract(sys.argv[1], zones, ["unique", "frac", "count"])]
seconds = time.perf_counter() - began
areas = [{int(u): float(x) * zone["count"] for u, x in zip(zone["unique"], zone["frac"])} for zone in found]
print(json.dumps([seconds, areas]))
"""

# Means of polygons, likewise.
MEANS = """
import json, sys, time
from exactextract import exact_extract
zones = json.load(sys.stdin)
began = time.perf_counter()
found = [zone["properties"]["mean"] for zone in exact_extract(sys.argv[1], zones, ["mean"])]
print(json.dumps([time.perf_counter() - began, found]))
"""

# Means and medians of the polygons in a file, for `once`.
MEDIANS = """
import json, sys
from exactextract import exact_extract
zones = json.load(open(sys.argv[2]))["features"]
print(json.dumps([[zone["properties"][name] for name in ("mean", "median")] for zone in exact_extract(sys.argv[1], zones, ["mean", "median"])]))
"""

# Tiles of 256 x 256 pixels, each after opening the file: a window a line, its seconds a line.
TILES = """
import json, sys, time
import rasterio
from rasterio.windows import Window
for line in sys.stdin:
    window = json.loads(line)
    began = time.perf_counter()
    with rasterio.open(sys.argv[1]) as raster:
        raster.read(1, window=Window(*window), out_shape=(256, 256))
    print(time.perf_counter() - began, flush=True)
"""

# Referee of class areas: shapely divides polygons by blocks and, at borders, by cells. `null` is an
# invalid polygon, which each tool repairs in its own way.
AREAS = """
import json, sys
import numpy, rasterio, shapely
from shapely.geometry import shape
with rasterio.open(sys.argv[1]) as raster:
    cells, scale, (left, top) = raster.read(1), raster.width / 360, (-180, 90)
    size = numpy.array([raster.width, raster.height])

def areas(polygon):
    found = numpy.zeros(256)
    side = 512
    west, north, east, south = polygon.bounds
    columns = numpy.arange(west // side, east // side + 1)
    rows = numpy.arange(north // side, south // side + 1)
    corners = numpy.stack(numpy.meshgrid(columns, rows), -1).reshape(-1, 2).astype(int) * side
    parts = numpy.full(len(corners), polygon)
    while len(corners):
        boxes = shapely.box(*corners.T, *(corners + side).T)
        parts = shapely.intersection(parts, boxes)
        if side == 1:
            inside = (corners >= 0).all(1) & (corners < size).all(1)
            column, row = corners[inside].T
            return found + numpy.bincount(cells[row, column], shapely.area(parts[inside]), 256)
        is_whole, is_empty = shapely.covers(parts, boxes), shapely.area(parts) == 0
        for column, row in numpy.maximum(corners[is_whole], 0):
            found += numpy.bincount(cells[row:row + side, column:column + side].ravel(), minlength=256)
        is_mixed = ~is_whole & ~is_empty
        side //= 2
        corners = (corners[is_mixed][:, None] + numpy.array([[0, 0], [side, 0], [0, side], [side, side]])).reshape(-1, 2)
        parts = numpy.repeat(parts[is_mixed], 4)
    return found

results = []
for zone in json.load(sys.stdin):
    polygon = shape(zone["geometry"])
    if not polygon.is_valid:
        results.append(None)
        continue
    in_cells = shapely.transform(polygon, lambda points: (points - [left, top]) * [scale, -scale])
    found = areas(in_cells)
    results.append({int(value): found[value] for value in found.nonzero()[0]})
print(json.dumps(results))
"""

# Referee of coarse levels: pixels of tiles that have another class than the one of most cells, and
# those of the overviews. Of each tile a line: its file, and left, top, cells, cells.
MAJORITIES = """
import json, sys
import numpy, rasterio
from rasterio.windows import Window
wrong = [0, 0]
with rasterio.open(sys.argv[1]) as raster:
    for line in sys.stdin:
        path, window = json.loads(line)
        factor = window[2] // 256
        cells = raster.read(1, window=Window(*window))
        tiles = [numpy.load(path).reshape(256, 256), raster.read(1, window=Window(*window), out_shape=(256, 256))]
        blocks = cells.reshape(256, factor, 256, factor)
        most, counts = 0, [0, 0]
        for value in numpy.unique(cells):
            count = (blocks == value).sum((1, 3))
            most = numpy.maximum(most, count)
            counts = [numpy.where(tile == value, count, own) for tile, own in zip(tiles, counts)]
        wrong = [all + int((own < most).sum()) for all, own in zip(wrong, counts)]
print(json.dumps(wrong))
"""

# A raster of heights in tiles of 512 x 512 where the largest countries are, and no tiles where none
# is; the countries. (Those around the whole earth, and invalid ones, are left out.) Its tiles are
# copies of 64; those with a country are numbered, so that their means differ.
HEIGHTS = """
import json, struct, sys, zlib
import numpy, shapely
from shapely.geometry import shape
path, seconds, count = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
side, scale = 512, 3600 / seconds
width, height = round(360 * scale), round(180 * scale)
found = []
for zone in json.load(sys.stdin):
    polygon = shape(zone["geometry"])
    west, _, east, _ = polygon.bounds
    if polygon.is_valid and east - west < 180:
        on_earth = shapely.transform(polygon, lambda points: numpy.c_[points[:, 0], numpy.sin(numpy.radians(points[:, 1]))])
        found.append((on_earth.area, zone, polygon))
found = sorted(found, key=lambda each: -each[0])[:count]
columns, rows = -(-width // side), -(-height // side)
has_tile = numpy.zeros((rows, columns), bool)
degrees = side / scale
for _, _, polygon in found:
    west, south, east, north = polygon.bounds
    x, y = numpy.meshgrid(numpy.arange(int((west + 180) // degrees), min(columns - 1, int((east + 180) // degrees)) + 1),
                          numpy.arange(int((90 - north) // degrees), min(rows - 1, int((90 - south) // degrees)) + 1))
    shapely.prepare(polygon)
    boxes = shapely.box(x * degrees - 180, 90 - (y + 1) * degrees, (x + 1) * degrees - 180, 90 - y * degrees)
    touched = shapely.intersects(polygon, boxes)
    has_tile[y[touched], x[touched]] = True
rng = numpy.random.default_rng(1)
axis = numpy.arange(side) / side * 2 * numpy.pi
pool = []
for number in range(64):
    heights = numpy.full((side, side), 500.0 + 30 * number)
    for _ in range(3):
        a, b = rng.integers(1, 4, 2)
        heights += 600 / (a + b) * numpy.cos(a * axis + rng.uniform(0, 6))[:, None] * numpy.cos(b * axis + rng.uniform(0, 6))
    heights = (heights / 25).round().astype("<i2") * 25
    pool.append(zlib.compress(numpy.diff(heights, axis=1, prepend=numpy.int16(0)).tobytes(), 6))
numbers = numpy.where(has_tile, numpy.cumsum(has_tile.ravel()).reshape(has_tile.shape) * 37 % 64, -1).ravel()
sizes = numpy.array([len(tile) for tile in pool] + [0])[numbers].astype("<u4")
tags = []
def tag(number, form, values):
    tags.append((number, {"H": 3, "I": 4, "d": 12, "s": 2}[form], values, form))
for number, value in [(256, width), (257, height), (258, 16), (259, 8), (262, 1), (277, 1), (284, 1), (317, 2), (322, side), (323, side)]:
    tag(number, "I" if number in (256, 257) else "H", [value])
tag(324, "I", [0] * len(sizes))
tag(325, "I", sizes.tolist())
tag(339, "H", [2])
tag(33550, "d", [1 / scale, 1 / scale, 0.0])
tag(33922, "d", [0.0, 0.0, 0.0, -180.0, 90.0, 0.0])
tag(34735, "H", [1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326])
tag(42113, "s", b"-32768\\0")
def bytes_of(values, form):
    return values if form == "s" else struct.pack(f"<{len(values)}{form}", *values)
start = 8 + 2 + 12 * len(tags) + 4
end = start + sum(len(bytes_of(values, form)) + 1 & ~1 for _, _, values, form in tags)
offsets = end + numpy.cumsum(sizes, dtype=numpy.uint64) - sizes
assert not sizes.sum() or offsets[-1] < 2**32 - 2**24, "more than 4 GB"
tags = [(number, type, numpy.where(sizes > 0, offsets, 0).tolist() if number == 324 else values, form) for number, type, values, form in tags]
with open(path, "wb") as out:
    out.write(struct.pack("<2sHIH", b"II", 42, 8, len(tags)))
    data = b""
    for number, type, values, form in tags:
        packed = bytes_of(values, form)
        inline = packed.ljust(4, b"\\0") if len(packed) <= 4 else struct.pack("<I", start + len(data))
        out.write(struct.pack("<HHI", number, type, len(values)) + inline)
        data += packed + b"\\0" * (len(packed) % 2)
    out.write(struct.pack("<I", 0) + data.ljust(end - start, b"\\0"))
    for number in numbers[numbers >= 0]:
        out.write(pool[number])
print(json.dumps([zone for _, zone, _ in found]))
"""

# COGs of 512 x 512 pixels, cut from a raster (and again from its beginning).
CUT = """
import math, os, sys
import numpy, rasterio
from rasterio.io import MemoryFile
from rasterio.shutil import copy
from rasterio.transform import from_origin
source, directory, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
side, across = 512, math.isqrt(count)
with rasterio.open(source) as raster:
    columns, rows, palette = raster.width // side, raster.height // side, raster.colormap(1)
    profile = dict(driver="GTiff", width=side, height=side, count=1, dtype="uint8", crs="EPSG:32633")
    for number in range(count):
        x, y = number % across, number // across
        window = ((y % rows * side, (y % rows + 1) * side), (x % columns * side, (x % columns + 1) * side))
        profile["transform"] = from_origin(500000 + 10 * side * x, 9000000 - 10 * side * y, 10, 10)
        with MemoryFile() as memory:
            with memory.open(**profile) as out:
                out.write(raster.read(1, window=window), 1)
                out.write_colormap(1, palette)
            copy(memory.name, f"{directory}/{number:05}.tif", driver="COG", COMPRESS="ZSTD", BLOCKSIZE="512")
"""
