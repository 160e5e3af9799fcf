#!/usr/bin/env python3
"""Contour lines against those of gdal_contour, segment by segment.

    python tests/referees/contours.py PATH/TO/spinney DIRECTORY

Needs GDAL's programs; without them it reports that it is skipped. GDAL joins the lines through a
saddle always in the same way, whatever the mean of the four values is: in such squares only the
number of segments is compared. Fails at the first raster that differs.
"""

import collections
import csv
import math
import pathlib
import random
import re
import shutil
import subprocess
import sys

program, directory = sys.argv[1], pathlib.Path(sys.argv[2])
csv.field_size_limit(1 << 30)
VOID = -9999


def random_rows(seed, longest):
    """Noise, sometimes with holes, in float so that no value equals a level."""
    noise = random.Random(seed)
    size = [noise.randrange(2, longest), noise.randrange(2, 60)]
    width, height = size if seed % 2 else size[::-1]
    holes = 0.1 if seed % 3 else 0.0
    number = lambda: VOID if noise.random() < holes else round(8 * noise.random(), 5)
    return [[number() for _ in range(width)] for _ in range(height)]


def segments(path, rows):
    """Returns the segments in squares without a saddle, and the number of segments in each of the
    others."""
    plain, saddles = collections.Counter(), collections.Counter()
    for row in csv.DictReader(open(path, newline="")):
        value, text = float(row["value"]), row["WKT"]
        points = [tuple(map(float, point.split())) for point in text[text.index("(") + 1 : text.rindex(")")].split(",")]
        for a, b in zip(points, points[1:]):
            if math.dist(a, b) < 1e-4:
                continue
            column, line = math.floor((a[0] + b[0]) / 2 - 0.5), math.floor(len(rows) - (a[1] + b[1]) / 2 - 0.5)
            corners = [rows[y][x] if 0 <= y < len(rows) and 0 <= x < len(rows[0]) else VOID
                       for x, y in [(column, line), (column + 1, line), (column + 1, line + 1), (column, line + 1)]]
            high = [corner >= value for corner in corners]
            # A quarter of a square with a VOID corner may be a saddle, too.
            if VOID in corners and corners.count(VOID) == 1 or high[0] == high[2] != high[1] == high[3]:
                saddles[value, column, line] += 1
            else:
                plain[value, *(round(number, 2) for number in a + b)] += 1
    return plain, saddles


def compare(seed, longest=400):
    rows = random_rows(seed, longest)
    ascii_grid, source, tree = directory / "in.asc", directory / "in.tif", directory / "in.goblin"
    head = f"ncols {len(rows[0])}\nnrows {len(rows)}\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value {VOID}\n"
    ascii_grid.write_text(head + "".join(" ".join(map(str, row)) + "\n" for row in rows))
    subprocess.run(["gdal_translate", "-q", "-ot", "Float64", ascii_grid, source], check=True)
    ours, theirs = directory / "ours.csv", directory / "theirs.csv"
    theirs.unlink(missing_ok=True)
    subprocess.run([program, "-q", "build", source, "-o", tree], check=True)
    subprocess.run([program, "-q", "contours", tree, "--every", "1", "--ends", "extend", "-o", ours], check=True)
    csv_options = ["-f", "CSV", "-lco", "GEOMETRY=AS_WKT"]
    subprocess.run(["gdal_contour", "-q", "-i", "1", "-a", "value", *csv_options, source, theirs], check=True)
    (mine, saddles), (other, other_saddles) = segments(ours, rows), segments(theirs, rows)
    count = sum(mine.values())
    # Allows positions rounded to either side, and points closer than a tenth of a millimetre.
    differ = sum(((mine - other) + (other - mine)).values())
    assert differ <= 2 + count / 1000, f"{seed}: {differ} of {count} segments differ"
    wrong = sum(((saddles - other_saddles) + (other_saddles - saddles)).values())
    assert wrong <= 2 + sum(saddles.values()) / 1000, f"{seed}: {wrong} segments of saddles differ"
    return count, sum(saddles.values())


def formats(seed):
    """Lines and bands in all formats that GDAL reads, against our own CSV."""
    source, tree = directory / "in.tif", directory / "in.goblin"
    compare(seed, 100)
    checked = 0
    for options in ([], ["--filled"], ["--3d"]):
        expected = None
        for ending in ("csv", "geojson", "gpkg", "fgb", "shp"):
            ours, read = directory / f"formats.{ending}", directory / "read.csv"
            read.unlink(missing_ok=True)
            subprocess.run([program, "-q", "contours", tree, "--every", "1", "-o", ours, *options], check=True)
            subprocess.run(["ogr2ogr", "-q", "-f", "CSV", "-lco", "GEOMETRY=AS_WKT", "-lco", "SEPARATOR=COMMA", read, ours], check=True)
            # Shapefile readers take several parts of one ring each as one polygon, whose rings
            # begin anywhere.
            numbers = re.compile(r"-?[0-9.]+(?:e-?[0-9]+)?")
            points = lambda row: sorted({tuple(round(float(number), 4) for number in numbers.findall(point)) for point in row["WKT"].split(",")})
            value = lambda row: tuple(round(float(row[name]), 6) for name in row if name in ("value", "min", "max") and row[name])
            found = sorted((value(row), points(row)) for row in csv.DictReader(open(read, newline="")))
            expected = expected or found
            assert found and found == expected, f"{seed}: {ours} differs"
            checked += len(found)
    return checked


if not shutil.which("gdal_contour"):
    print("contours: skipped, gdal_contour is not there")
    sys.exit(0)
directory.mkdir(parents=True, exist_ok=True)
total = [sum(column) for column in zip(*(compare(seed) for seed in range(12)))]
total.append(formats(3))
print(f"contours: {total[2]} features are the same in all formats")
print(f"contours: {total[0]} segments are gdal_contour's, and {total[1]} in saddles")
