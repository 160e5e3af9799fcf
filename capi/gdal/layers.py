#!/usr/bin/env python3
"""Compares GDAL's view of files with several layers with the program's results for each layer.

    capi/gdal/layers.py SPINNEY DIRECTORY FILE ...

DIRECTORY is for temporary files.
"""

import array
import json
import math
import pathlib
import struct
import subprocess
import sys

# Sample types: their names in GDAL, and their codes in Python's array module.
TYPES = {"u8": ("Byte", "B"), "f32": ("Float32", "f"), "u64": ("UInt64", "Q"), "i16": ("Int16", "h")}


def output_of(*words):
    return subprocess.check_output([str(word) for word in words])


class Layer:
    """A layer on the raster's cells, computed only from the program's output."""

    def __init__(self, file, info, raster, depth):
        self.path, self.info, self.raster, self.depth = f"{file}:{info['layer']}", info, raster, depth
        name, _, channels = info["value"].partition("x")
        self.type, self.code, self.channels = *TYPES[name], int(channels or 1)
        self.nodata, self.void = info["nodata"], info["nodata"] or 0

    def band(self, channel, coarser):
        """Rows of a channel's samples on the raster's cells, or `coarser` levels above these."""
        level = self.depth - coarser
        own = min(level, self.info["depth"])
        raw = DIRECTORY / "layer.raw"
        output_of(SPINNEY, "get", "-q", self.path, raw, "--level", own, "--nodata", self.void)
        samples = array.array(self.code, raw.read_bytes())[channel :: self.channels]
        width, height = (ceiling(size, self.info["depth"] - own) for size in self.info["size"])
        assert len(samples) == width * height
        columns, rows = (ceiling(size, coarser) for size in self.raster)
        lines = {}
        for row in range(rows):
            y = row >> (level - own)
            if y not in lines:
                line = samples[y * width : (y + 1) * width] if y < height else []
                at = [x >> (level - own) for x in range(columns)]
                lines[y] = array.array(self.code, [line[x] if x < len(line) else self.void for x in at])
            yield lines[y]


def ceiling(size, levels):
    return -(-size // (1 << levels))


def read(file, *options):
    """Samples of all bands, band by band."""
    raster_file = DIRECTORY / "bands.tif"
    raster_file.unlink(missing_ok=True)
    plain = ["-of", "GTiff", "-mask", "none", "-co", "INTERLEAVE=BAND", "-co", "BLOCKYSIZE=1"]
    output_of("gdal_translate", "-q", *plain, *options, file, raster_file)
    # (GeoTIFF is GDAL's only uncompressed format with all types.) Its strips are rows, by band.
    tiff = raster_file.read_bytes()
    (directory,) = struct.unpack_from("<I", tiff, 4)
    tags = {}
    for entry in range(struct.unpack_from("<H", tiff, directory)[0]):
        tag, kind, count, value = struct.unpack_from("<HHII", tiff, directory + 2 + 12 * entry)
        if tag in (273, 279):
            code = {3: "H", 4: "I"}[kind]
            place = value if struct.calcsize(code) * count > 4 else directory + 10 + 12 * entry
            tags[tag] = struct.unpack_from(f"<{count}{code}", tiff, place)
    return b"".join(tiff[start : start + size] for start, size in zip(tags[273], tags[279]))


def compare(file):
    # (GDAL may have stored statistics in a sidecar file.)
    info = json.loads(output_of("gdalinfo", "-json", "-hist", "--config", "GDAL_PAM_ENABLED", "NO", file))
    layers = json.loads(output_of(SPINNEY, "info", "--json", file))["layers"]
    depth = max(layer["depth"] for layer in layers)
    finest = next(layer for layer in layers if layer["depth"] == depth)
    raster = info["size"]
    assert raster == finest["size"], (raster, finest["size"])
    a, b, c, d, e, f = finest["transform"]
    assert info["geoTransform"] == [c, a, b, f, d, e]

    names = info["metadata"]["SUBDATASETS"]
    assert len(names) == 2 * len(layers), names
    for number, layer in enumerate(layers, 1):
        name = names[f"SUBDATASET_{number}_NAME"]
        assert name == f"{file}:{layer['layer']}" and layer["layer"] in names[f"SUBDATASET_{number}_DESC"], names
        alone = json.loads(output_of("gdalinfo", "-json", name))
        assert alone["size"] == layer["size"] and "SUBDATASETS" not in alone["metadata"], alone
        (DIRECTORY / "alone.tif.aux.xml").unlink(missing_ok=True)
        output_of(SPINNEY, "get", "-q", name, DIRECTORY / "alone.tif", "--nodata", layer["nodata"] or 0)
        assert read(name) == read(DIRECTORY / "alone.tif"), f"{name}: other samples through GDAL"

    bands = iter(enumerate(info["bands"], 1))
    for each in layers:
        layer = Layer(file, each, raster, depth)
        for channel in range(layer.channels):
            number, band = next(bands)
            assert band["type"] == layer.type, band
            assert band.get("noDataValue") == layer.nodata, band
            name = each["bands"][channel] if each["bands"] else channel + 1
            expected = each["layer"] if layer.channels == 1 else f"{each['layer']}.{name}"
            assert band["description"] == expected, (band, expected)
            grey = "Palette" if "colorTable" in band else "Gray"
            roles = ["Red", "Green", "Blue"] if layer.channels == 3 else [grey]
            assert band["colorInterpretation"] == roles[channel], band
            cells = list(layer.band(channel, 0))
            check_bands(file, number, layer, channel, cells, band)
    assert next(bands, None) is None, info


def check_bands(file, number, layer, channel, cells, band):
    every = b"".join(row.tobytes() for row in cells)
    assert read(file, "-b", number) == every, f"{file}: band {number}: other samples through GDAL"
    for cache in [0, 1, 64]:
        x, y, width, height = layer.raster[0] // 3 + 1, 5, layer.raster[0] // 2, layer.raster[1] - 9
        window = ["-srcwin", x, y, width, height, "--config", "GDAL_CACHEMAX", cache]
        part = b"".join(row[x : x + width].tobytes() for row in cells[y : y + height])
        assert read(file, "-b", number, *window) == part, f"{file}: band {number}: another window with a cache of {cache}"
    sizes = [overview["size"] for overview in band.get("overviews", [])]
    for coarser, size in enumerate(sizes, 1):
        assert size == [ceiling(side, coarser) for side in layer.raster], band
        level = b"".join(row.tobytes() for row in layer.band(channel, coarser))
        assert read(file, "-b", number, "-outsize", *size) == level, f"{file}: band {number}: overview {coarser} differs"
    # Cells without a value are masked, also outside of the layer.
    mask = read(file, "-b", f"mask,{number}")
    samples = [sample for row in cells for sample in row]
    assert set(mask) <= {0, 255} and len(mask) == len(samples)
    reach = [size << (layer.depth - layer.info["depth"]) for size in layer.info["size"]]
    for place, (sample, valid) in enumerate(zip(samples, mask)):
        y, x = divmod(place, layer.raster[0])
        assert valid or sample == layer.void, (number, x, y)
        assert not valid or (x < reach[0] and y < reach[1]), (number, x, y)
    # Statistics are those of the raster's cells.
    values = [sample for sample, valid in zip(samples, mask) if valid]
    known = json.loads(output_of(SPINNEY, "stats", "--json", layer.path))
    if reach == layer.raster:
        assert len(values) == known["cells"] << 2 * (layer.depth - layer.info["depth"]), number
    mean = math.fsum(values) / len(values)
    if isinstance(values[0], int):
        # (Differences of large integers from a rounded mean would be inexact.)
        squares = len(values) * sum(value * value for value in values) - sum(values) ** 2
        deviation = math.sqrt(squares) / len(values)
    else:
        deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / len(values))
    statistics = band["metadata"][""]
    for key, expected in [("MEAN", mean), ("STDDEV", deviation), ("MINIMUM", min(values)), ("MAXIMUM", max(values))]:
        found = float(statistics[f"STATISTICS_{key}"])
        assert abs(found - expected) <= 1e-9 * max(1.0, abs(expected)), (file, number, key, found, expected)
    if layer.code != "Q" and channel == 0:
        assert sum(band["histogram"]["buckets"]) == len(values), (number, len(values))
    if layer.code == "B" and channel == 0:
        assert band["histogram"]["buckets"] == [values.count(value) for value in range(256)], number


if __name__ == "__main__":
    SPINNEY, DIRECTORY = sys.argv[1], pathlib.Path(sys.argv[2])
    for path in sys.argv[3:]:
        compare(path)
