#!/usr/bin/env python3
"""Makes three images of the README from the fixtures and from formulas, and prints the numbers for
the caption of the class map:

    `docs/images/make.py target/debug/spinney`

Needs GDAL's programs (for its overviews), and Pillow and NumPy for Python.
"""

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy
from PIL import Image

HERE = Path(__file__).resolve().parent
FIXTURES = HERE.parents[1] / "fixtures"
SPINNEY = Path(sys.argv[1]).resolve()

RELIEF = {
    "nodata": "#9fc3d6",
    "layers": [
        {
            "draw": "ramp",
            "ramp": [[0, "#5b9a5f"], [150, "#93b56b"], [400, "#d3c98a"], [800, "#c09a6c"], [1500, "#a58a78"], [2600, "#f4f4f2"]],
        },
        {"draw": "hillshade", "z": 0.5, "light": "combined", "blend": "multiply", "opacity": 0.9},
    ],
}


def spinney(*words):
    subprocess.run([SPINNEY, "-q", *map(str, words)], check=True)


def relief(work):
    """Elevation of 50 m cells, resampled to finer cells (cubic), with colours and hillshade."""
    tree, fine, style, drawn = (work / name for name in ("relief.goblin", "fine.goblin", "style.json", "relief.png"))
    style.write_text(json.dumps(RELIEF))
    spinney("build", FIXTURES / "island_elevation.tif", "-o", tree)
    spinney("transform", tree, "grid=xyz,13", "crop", "--resampling", "cubic", "-o", fine)
    spinney("get", fine, drawn, "--style", style)
    image = Image.open(drawn).convert("RGB")
    framed = Image.new("RGB", (image.width + 40, image.height + 40), RELIEF["nodata"])
    framed.paste(image, (20, 20))
    framed = framed.resize((framed.width * 2 // 3, framed.height * 2 // 3), Image.LANCZOS)
    framed.quantize(256, dither=Image.Dither.NONE).save(HERE / "relief.png", optimize=True)


def classes(work, factor=4, zoom=6, gap=12):
    """One coarse level of a class map: Spinney's, GDAL's, and the pixels where GDAL's class does
    not have the highest cell count.
    """
    source, tree, cog, ours = FIXTURES / "island_classes.tif", work / "c.goblin", work / "c.tif", work / "ours.tif"
    spinney("build", source, "-o", tree)
    depth = 8
    spinney("get", tree, ours, "--level", depth - int(math.log2(factor)))
    options = ["OVERVIEW_RESAMPLING=MODE", "BLOCKSIZE=128", "OVERVIEW_COUNT=4"]
    words = [word for option in options for word in ("-co", option)]
    subprocess.run(["gdal_translate", "-q", "-of", "COG", *words, source, cog], check=True)
    theirs = work / "theirs.tif"
    level = int(math.log2(factor)) - 1
    subprocess.run(["gdal_translate", "-q", "-oo", f"OVERVIEW_LEVEL={level}", cog, theirs], check=True)
    cells = numpy.array(Image.open(source))
    height, width = (side // factor for side in cells.shape)
    ours, theirs = (numpy.array(Image.open(path)) for path in (ours, theirs))
    assert ours.shape == theirs.shape == (height, width)
    blocks = cells.reshape(height, factor, width, factor).swapaxes(1, 2).reshape(height, width, -1)
    # Class 0 is nodata, and is not counted.
    counts = numpy.stack([(blocks == value).sum(2) for value in range(1, 8)])
    most, held = counts.max(0), lambda values: numpy.take_along_axis(counts, numpy.maximum(values, 1)[None].astype(int) - 1, 0)[0]
    mixed = (counts > 0).sum(0) > 1
    assert ((theirs == 0) == (most == 0)).all() and ((ours == 0) == (most == 0)).all()
    assert (held(ours) == most).all(), "ours is wrong"
    wrong = mixed & (held(theirs) < most)
    print(f"cells of {factor} x {factor}: {mixed.sum()} of several classes, {wrong.sum()} of these wrong by GDAL, {100 * wrong.sum() / mixed.sum():.1f} %")

    palette = numpy.array(Image.open(source).getpalette(), dtype=numpy.uint8).reshape(-1, 3)
    palette[0] = 255
    drawn = [palette[ours], palette[theirs]]
    grey = palette[ours].mean(2, keepdims=True) * 0.25 + 185
    grey[ours == 0] = 255
    marked = numpy.repeat(grey, 3, axis=2).astype(numpy.uint8)
    marked[wrong] = (214, 30, 40)
    drawn.append(marked)
    strip = Image.new("RGB", (3 * width * zoom + 2 * gap, height * zoom), "white")
    for number, panel in enumerate(drawn):
        image = Image.fromarray(panel).resize((width * zoom, height * zoom), Image.NEAREST)
        strip.paste(image, (number * (width * zoom + gap), 0))
    strip.quantize(32, dither=Image.Dither.NONE).save(HERE / "majority.png", optimize=True)


def write_off(path, points, faces):
    lines = ["OFF", f"{len(points)} {len(faces)} 0", *(" ".join(map(repr, point)) for point in points)]
    lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    path.write_text("\n".join(lines) + "\n")


def cube(path, half):
    points = [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    write_off(path, points, [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


def ball(path, radius, around=120, along=60):
    points = [(0.0, 0.0, -radius)]
    for ring in range(1, along):
        high, wide = -radius * math.cos(math.pi * ring / along), radius * math.sin(math.pi * ring / along)
        turns = [2 * math.pi * step / around for step in range(around)]
        points += [(wide * math.cos(turn), wide * math.sin(turn), high) for turn in turns]
    points.append((0.0, 0.0, radius))
    at = lambda ring, step: 1 + (ring - 1) * around + step % around
    faces = [(0, at(1, step + 1), at(1, step)) for step in range(around)]
    faces += [(len(points) - 1, at(along - 1, step), at(along - 1, step + 1)) for step in range(around)]
    for ring in range(1, along - 1):
        for step in range(around):
            a, b, c, d = at(ring, step), at(ring, step + 1), at(ring + 1, step + 1), at(ring + 1, step)
            faces += [(a, b, c), (a, c, d)]
    write_off(path, points, faces)


def rod(path, radius, half, axis, around=120):
    turns = [2 * math.pi * step / around for step in range(around)]
    points = [(radius * math.cos(turn), radius * math.sin(turn), end) for end in (-half, half) for turn in turns]
    # The axes are permuted cyclically, so that faces stay counterclockwise.
    points = [tuple(point[(coordinate - axis - 1) % 3] for coordinate in range(3)) for point in points]
    faces = [tuple(range(around - 1, -1, -1)), tuple(range(around, 2 * around))]
    for step in range(around):
        after = (step + 1) % around
        faces.append((step, after, around + after, around + step))
    write_off(path, points, faces)


def boolean(work):
    """Intersection of a cube and a ball, minus three rods, by exact set operations on surfaces."""
    cube(work / "cube.off", 1.0)
    ball(work / "ball.off", 1.36)
    for axis in range(3):
        rod(work / f"rod{axis}.off", 0.55, 1.5, axis)
    names = ["cube", "ball", "rod0", "rod1", "rod2"]
    # Snapping vertices to the grid makes the rods' sides non-planar: they are built as triangles.
    for name in names:
        spinney("build", work / f"{name}.off", "-o", work / f"{name}.goblin", "--brep", "--snap", 2.0**-20)
    files = {name: work / f"{name}.goblin" for name in [*names, "round", "part"]}
    spinney("combine", "and", files["cube"], files["ball"], "-o", files["round"])
    spinney("combine", "a-b", files["round"], files["rod0"], files["rod1"], files["rod2"], "-o", files["part"])
    subprocess.run([SPINNEY, "stats", files["part"]], check=True)
    drawn = work / "part.png"
    spinney("render", files["part"], drawn, "--size", "1040x1000", "--from", "215,32", "--scale", "1.25", "--samples", "2")
    image = Image.open(drawn).convert("RGB").resize((520, 500), Image.LANCZOS)
    image.quantize(128, dither=Image.Dither.NONE).save(HERE / "boolean.png", optimize=True)


with tempfile.TemporaryDirectory() as directory:
    for draw in (relief, classes, boolean):
        draw(Path(directory))
