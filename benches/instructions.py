#!/usr/bin/env python3
"""Counts the instructions of program and library jobs, and compares two states of the project.

Times on a busy machine vary by more than a typical slowdown; instruction counts are reproducible to
a few thousandths of a percent. Each row of the table is one run under valgrind, on one thread:

- `build`, `convert`, `combine`, `transform`, `edit`, `verify` and other commands of the program,
  with rasters and solids of all kinds of values, to Goblin and to Autumnal files. The cost of
  starting and stopping the program is subtracted.
- Queries on the resulting files, made by `benches/instructions.rs` through the library. The cost of
  opening the file is subtracted.

It needs valgrind and NumPy, and takes 10 to 20 minutes on one processor. Inputs are made in advance
in benches/peers/work/instructions, or in the directory given by --work, and kept for the next run:
remove the directory when this script's inputs change. The rows on solids are omitted if
../shared/data (or $SPINNEY_DATA) has no meshes.

    cargo build --release
    cargo bench --no-run --bench instructions       # prints the name of the query program
    benches/instructions.py --program target/release/spinney \\
        --bench target/release/deps/instructions-HASH --out after.json
    benches/instructions.py --compare before.json after.json

--only REGEX counts the rows with matching names; --list prints all names; --native measures times
instead of instructions, to check the sizes of jobs. The comparison prints instructions before and
after and their ratio, the largest first, and marks increases over 3 %, results that differ, and
rows that only one of the files has. Its exit code is 1 if there are any.
"""

import argparse
import hashlib
import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("SPINNEY_DATA", ROOT.parent / "shared" / "data"))
WORK = ROOT / "benches" / "peers" / "work" / "instructions"
# A row whose instructions grow by more than this factor is marked, unless there are only a few.
MOST, FEW = 1.03, 100_000
# Operations of `transform` with previous or future names.
NAMES = {"nest": ["nest", "embed"], "root": ["root", "subtree"]}
ENVIRONMENT = {**os.environ, "RAYON_NUM_THREADS": "1", "SOURCE_DATE_EPOCH": "0", "SPINNEY_AUTHOR": "bench"}


# Rasters


def tiff(path, pixels, nodata=None, alpha=False):
    """Writes an array as an uncompressed TIFF in strips of 64 rows; with `alpha` the last channel
    is opacity."""
    pixels = numpy.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[:, :, None])
    rows, columns, channels = pixels.shape
    little = pixels.astype(pixels.dtype.newbyteorder("<"), copy=False)
    strips = [little[row : row + 64].tobytes() for row in range(0, rows, 64)]
    colours = 3 if channels >= 3 else 1
    sample = {"u": 1, "i": 2, "f": 3}[pixels.dtype.kind]
    extra = [2 if alpha and channel == channels - 1 else 0 for channel in range(colours, channels)]
    tags = [
        (256, "I", [columns]), (257, "I", [rows]), (258, "H", [8 * pixels.dtype.itemsize] * channels), (259, "H", [1]),
        (262, "H", [2 if colours == 3 else 1]), (273, "I", None), (277, "H", [channels]), (278, "I", [64]),
        (279, "I", [len(strip) for strip in strips]), (284, "H", [1]),
        *([(338, "H", extra)] if extra else []), (339, "H", [sample] * channels),
        *([(42113, "s", f"{nodata}\0".encode())] if nodata is not None else []),
    ]  # fmt: skip
    # The directory, its out-of-line values, the strips.
    strips_at = 8 + 2 + 12 * len(tags) + 4
    directory, rest = len(tags).to_bytes(2, "little"), b""
    size = {"H": 2, "I": 4, "s": 1}
    wanted = {tag: size[kind] * len(values if values is not None else strips) for tag, kind, values in tags}
    data = strips_at + sum(length + length % 2 for length in wanted.values() if length > 4)
    offsets = [data + sum(len(strip) for strip in strips[:index]) for index in range(len(strips))]
    for tag, kind, values in tags:
        values = offsets if values is None else values
        if kind == "s":
            field = values
        else:
            field = b"".join(value.to_bytes(size[kind], "little") for value in values)
        number = {"H": 3, "I": 4, "s": 2}[kind]
        directory += tag.to_bytes(2, "little") + number.to_bytes(2, "little") + len(values).to_bytes(4, "little")
        if len(field) <= 4:
            directory += field.ljust(4, b"\0")
        else:
            directory += (strips_at + len(rest)).to_bytes(4, "little")
            rest += field + b"\0" * (len(field) % 2)
    head = b"II*\0" + (8).to_bytes(4, "little")
    path.write_bytes(head + directory + (0).to_bytes(4, "little") + rest + b"".join(strips))


def cells(side, shift=0):
    """Returns columns and rows, shifted."""
    return numpy.meshgrid(numpy.arange(side) + 37 * shift, numpy.arange(side) + 23 * shift)


def mix(x, y):
    """Returns position-dependent random numbers."""
    with numpy.errstate(over="ignore"):
        z = x.astype("u8") * numpy.uint64(0x9E3779B97F4A7C15) ^ y.astype("u8") * numpy.uint64(0xC2B2AE3D27D4EB4F)
        z = (z ^ (z >> numpy.uint64(30))) * numpy.uint64(0xBF58476D1CE4E5B9)
    return z ^ (z >> numpy.uint64(31))


def noise(x, y, most):
    return (mix(x, y) % numpy.uint64(most)).astype("i8")


def waves(x, y):
    """Returns a smooth field with detail at several scales, about -1.7 to 1.7."""
    parts = [(700, 1.0), (150, 0.4), (31, 0.15), (7, 0.06)]
    return sum((numpy.sin(x / period) + numpy.cos(y / period * 1.3)) * size for period, size in parts)


def coastline(side, shift=0):
    """Two classes and a fractal border between them."""
    x, y = cells(side, shift)
    return (waves(2 * x, 2 * y) > 0.4).astype("u1")


def land(side, shift=0):
    """Land of six classes with a fractal border; the sea is 0."""
    x, y = cells(side, shift)
    return numpy.where(waves(x, y) > 0.2, 1 + (waves(y * 2, x * 3) * 3).astype("i8") % 6, 0).astype("u1")


def speckle(side):
    """Twelve random classes."""
    return noise(*cells(side), 12).astype("u1")


def photograph(side, shift=0):
    """A smooth field with noise in the low bits."""
    x, y = cells(side, shift)
    return ((x // 37 + y // 23) % 200 + noise(x, y, 5) + 20).astype("u1")


def colours(side, shift=0):
    """A drawing with large areas of one colour, and a photograph in it; its sky is white."""
    x, y = cells(side, shift)
    grey = photograph(side, shift).astype("i8")
    image = numpy.stack([grey, 255 - grey // 2, (grey + x // 64) % 256], axis=2)
    flat = numpy.stack([x // 128 * 30 % 256, y // 128 * 50 % 256, (x + y) // 256 * 70 % 256], axis=2)
    drawn = numpy.where((waves(3 * x, 3 * y) > 0)[:, :, None], flat, image)
    return numpy.where((waves(3 * y, 4 * x) > 0.9)[:, :, None], 255, drawn).astype("u1")


def opaque_colours(side, shift=0):
    """Colours, and an opacity that is 0 in some regions."""
    x, y = cells(side, shift)
    opacity = numpy.clip((waves(3 * x, 3 * y) + 0.8) * 200, 0, 255).astype("u1")
    return numpy.concatenate([colours(side, shift), opacity[:, :, None]], axis=2)


def relief(side, shift=0):
    """Heights with a flat sea."""
    x, y = cells(side, shift)
    return numpy.maximum((waves(x / 2, y / 2) * 1500).astype("i8") + noise(x, y, 3), 0)


def measured(side, shift=0):
    """Floating-point numbers with gaps."""
    x, y = cells(side, shift)
    return numpy.where(waves(3 * y, x * 2) > 1, numpy.nan, waves(x, y) * 100 + noise(x, y, 1000) / 1000)


# Name: samples, side, options of `build`, options of `tiff`. Those with `shift` exist twice, the
# second as `NAME_b`.
RASTERS = {
    "uniform": (lambda side: numpy.full((side, side), 7, "u1"), 2048, "--kind categorical", {}),
    "coastline": (coastline, 2048, "--kind categorical", {}),
    "land": (land, 2048, "--kind categorical", {"nodata": 0}),
    "speckle": (speckle, 1024, "--kind categorical", {}),
    "photograph": (photograph, 1024, "", {}),
    "rgb": (colours, 1024, "--nodata 255", {}),
    "rgba": (opaque_colours, 1024, "", {"alpha": True}),
    "grey_alpha": (lambda side: opaque_colours(side)[:, :, 2:], 1024, "", {"alpha": True}),
    "u16": (lambda side: (relief(side) * 7).astype("u2"), 1024, "", {}),
    "u16x3": (lambda side: colours(side).astype("u2") * 257, 1024, "", {}),
    "i16": (lambda side: (relief(side) - 500).astype("i2"), 1024, "--nodata -500", {}),
    "u32": (lambda side: (relief(side) // 50 * 70000).astype("u4"), 1024, "--kind categorical", {}),
    "i32": (lambda side: (relief(side) - 500).astype("i4"), 1024, "", {}),
    "f32": (lambda side, shift=0: measured(side, shift).astype("f4"), 1024, "", {}),
    "f32x3": (lambda side: numpy.stack([measured(side, n) for n in range(3)], axis=2).astype("f4"), 768, "", {}),
    "f64": (measured, 1024, "", {}),
}
SHIFTED = ["land", "photograph", "rgb", "f32"]
# Name: type, channels, kind, rule, function.
VOLUMES = {
    "volume_f32": ("f32", 1, "continuous", "mean"),
    "volume_u16": ("u16", 1, "continuous", "max"),
    "volume_u8": ("u8", 1, "categorical", "majority"),
}
VOLUME_SIDE = 96


def volume(name):
    """Returns rows of X, Y, Z, VALUE: a ball of values."""
    side = VOLUME_SIDE
    z, y, x = (axis.ravel() for axis in numpy.meshgrid(*[numpy.arange(side)] * 3, indexing="ij"))
    field = waves(x * 6, y * 6) + numpy.sin(z / 9)
    random = noise(x + side * z, y, 100)
    values = {
        "volume_f32": lambda: field + random / 1000,
        "volume_u16": lambda: ((field + 4) * 2000 + random).astype("i8") * (field > -1),
        "volume_u8": lambda: (field * 4).astype("i8") % 7 + random // 98,
    }[name]()
    middle = (side - 1) / 2
    inside = (x - middle) ** 2 + (y - middle) ** 2 + (z - middle) ** 2 < (side * 0.48) ** 2
    return numpy.stack([x, y, z, values], axis=1)[inside].astype("f4")


# Empty trees, to be filled by edits, since no importer makes volumes.

TYPES = ["u8", "u16", "i16", "u32", "i32", "f32", "f64"]
RULES = ["mean", "majority", "dominant", "min", "max", "nearest", "occupancy"]


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def empty_tree(path, extent, sample, channels, kind, rule):
    """Writes a Goblin file that is VOID; see formats.md."""
    number = int.to_bytes
    axes = 3 if extent[2] > 1 else 2
    depth = max(cells - 1 for cells in extent).bit_length()
    reach = 8 if axes == 2 else 6
    header = b"\x93Goblin\n" + number(1, 2, "little") + number(0, 2, "little")
    kinds = ["categorical", "continuous"]
    header += bytes([axes, TYPES.index(sample), channels, RULES.index(rule), kinds.index(kind), 0, depth, reach, 2])
    header += bytes(3) + number(4096, 4, "little") + bytes(4)
    header += b"".join(number(cells, 8, "little") for cells in extent)
    header += number(crc32c(header), 4, "little")
    frame = numpy.eye(4)[:3].astype("<f8").tobytes()
    # Version 1, the frame, no other metadata; one level, with one VOID node.
    metadata = b"\x01" + frame + bytes(9) + b"\x01" + b"\x01\x00\x00" + bytes(3)
    end = 60 + len(metadata)
    whole = end + 68 + 2 * 24 + 16
    trailer = bytes(40) + b"".join(number(field, 8, "little") for field in [0, 0, whole]) + number(2, 4, "little")
    for name, section, start in [(b"DIRE", b"", 60), (b"META", metadata, 60)]:
        trailer += name + number(crc32c(section), 4, "little")
        trailer += number(start, 8, "little") + number(len(section), 8, "little")
    trailer += number(len(trailer), 4, "little") + number(crc32c(trailer), 4, "little") + b"\nnilboG\x93"
    path.write_bytes(header + metadata + trailer)


# Rows


class Bench:
    def __init__(self, options):
        self.options = options
        self.work = options.work
        self.work.mkdir(parents=True, exist_ok=True)
        # Valgrind reads debug information, which takes longer than most jobs.
        self.program = self.stripped(options.program, "spinney")
        self.bench = self.stripped(options.bench, "instructions")
        self.made = set()
        self.known = {}

    def stripped(self, program, name):
        if program is None:
            return None
        copy = self.work / "programs" / name
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(program, copy)
        subprocess.run(["strip", "--strip-debug", copy], check=True)
        return copy

    def path(self, name):
        return self.work / name

    def native(self, *words):
        """Runs the program natively, to make inputs of jobs."""
        done = subprocess.run([self.program, "-q", *map(str, words)], env=ENVIRONMENT, cwd=self.work, capture_output=True)
        if done.returncode:
            raise Failure(f"spinney {' '.join(map(str, words))}: {done.stderr.decode().strip()}")

    def once(self, name, make):
        """Makes a file once per run; rasters stay for the next run."""
        path = self.path(name)
        if name not in self.made:
            if not name.endswith((".tif", ".npy")):
                path.unlink(missing_ok=True)
            if not path.exists():
                unfinished = path.with_name(f"unfinished_{name}")
                unfinished.unlink(missing_ok=True)
                make(unfinished)
                unfinished.rename(path)
            self.made.add(name)
        return name

    def image(self, name):
        base, shift = name.removesuffix("_b"), int(name.endswith("_b"))
        make, side, _, more = RASTERS[base]
        shifted = (side, shift) if shift else (side,)
        return self.once(f"{name}.tif", lambda path: tiff(path, make(*shifted), **more))

    def words(self, name):
        """Returns the `build` options of an input."""
        if name in VOLUMES:
            raise KeyError(name)
        if name.startswith("solid"):
            mesh, cells, *boundary = SOLIDS[name]
            return [DATA / "mesh" / mesh, "--cells", cells, *(["--edge", *boundary] if boundary else [])]
        return [self.image(name), *RASTERS[name.removesuffix("_b")][2].split()]

    def tree(self, name):
        """Returns a tree by its name: `rgb.goblin`, `rgb.autumn`, `rgb.share.autumn`."""
        base = name.split(".")[0]
        share = ["--share"] if ".share." in name else []
        if base in VOLUMES and name.endswith(".autumn"):

            def fill(path):
                void = self.once(f"{base}.void.goblin", lambda path: empty_tree(path, [VOLUME_SIDE] * 3, *VOLUMES[base]))
                self.native("convert", void, path.name, *share)
                self.native("edit", path.name, "set", self.rows(base))

            return self.once(name, fill)
        if base in VOLUMES:
            return self.once(name, lambda path: self.native("convert", self.tree(f"{base}.autumn"), path.name))
        if base in MADE:
            command, *words = MADE[base]
            words = [self.tree(word) if word.endswith(".goblin") else word for word in words]
            return self.once(name, lambda path: self.native(command, *words, "-o", path.name))
        return self.once(name, lambda path: self.native("build", *self.words(base), "-o", path.name, *share))

    def rows(self, name):
        return self.once(f"{name}.npy", lambda path: write_array(path, volume(name)))

    def fresh(self, name):
        """Returns a copy that may be changed."""
        copy = self.path("edited.autumn")
        shutil.copy(self.path(self.tree(name)), copy)
        return copy.name

    def count(self, command):
        """Returns the instructions of a run and its output."""
        log = self.work / "valgrind.log"
        valgrind = ["valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]
        words = [*([] if self.options.native else [*valgrind, f"--log-file={log}"]), *map(str, command)]
        start = time.perf_counter()
        done = subprocess.run(words, env=ENVIRONMENT, cwd=self.work, capture_output=True)
        took = time.perf_counter() - start
        if done.returncode:
            raise Failure(done.stderr.decode().strip()[-300:])
        digest = hashlib.sha256(done.stdout).hexdigest()[:16]
        if self.options.native:
            return int(took * 1e6), digest
        return int(re.search(r"I\s+refs:\s+([\d,]+)", log.read_text())[1].replace(",", "")), digest

    def idle(self, *command):
        """Returns the instructions of a run that only starts and stops."""
        if command not in self.known:
            self.known[command] = self.count(command)[0]
        return self.known[command]

    def run(self, row):
        return row(self)


class Failure(Exception):
    pass


def write_array(path, array):
    with path.open("wb") as file:
        numpy.save(file, array)


def spellings(words):
    """Yields a command with all names that its operations may have."""
    for index, word in enumerate(words):
        names = NAMES.get(str(word).split("=")[0], []) if "=" in str(word) else []
        if names:
            rest = str(word).split("=", 1)[1]
            return [[*words[:index], f"{name}={rest}", *words[index + 1 :]] for name in names]
    return [words]


def program(*words, trees=(), makes=None, edits=None):
    """A row for a command of the program. Words with `{}` are the trees, or the edited file."""

    def row(bench):
        names = [bench.tree(tree) for tree in trees]
        filled = [str(word() if callable(word) else word).format(*names, edited="edited.autumn") for word in words]
        failure = None
        for spelt in spellings(filled):
            if makes:
                bench.path(makes).unlink(missing_ok=True)
                spelt = [*spelt, *(["-o"] if words[0] in ["build", "transform", "combine", "compact"] else []), makes]
            if edits:
                bench.fresh(edits)
            command = [bench.program, "-q", "--threads", "1", *spelt]
            try:
                count, digest = bench.count(command)
            except Failure as error:
                failure = failure or error
                continue
            count -= bench.idle(bench.program, "--version")
            made = bench.path(makes or "edited.autumn")
            size = made.stat().st_size if makes or edits else 0
            return {"instructions": count, "digest": digest, "bytes": size}
        raise failure

    return row


def build(name, output, *more):
    def row(bench):
        return program("build", *bench.words(name), *more, makes=output)(bench)

    return row


def paste(name, target, *more):
    """Pastes an unchanged raster."""
    return lambda bench: program("edit", "{edited}", "paste", bench.image(name), *more, edits=target)(bench)


def set_cells(target, side, axes, channels, count):
    """Sets random cells of an edited tree."""

    def row(bench):
        def make(path):
            random = numpy.random.default_rng(8)
            columns = [random.integers(0, side, (count, axes)), random.integers(0, 6, (count, channels))]
            write_array(path, numpy.concatenate(columns, axis=1).astype("f4"))

        array = bench.once(f"set_{side}_{axes}_{channels}_{count}.npy", make)
        return program("edit", "{edited}", "set", array, edits=target)(bench)

    return row


def fill_volume(name):
    """Sets all cells of a volume in a VOID tree."""

    def row(bench):
        bench.tree(f"{name}.autumn")
        shutil.copy(bench.path(f"{name}.void.goblin"), bench.path("void.goblin"))
        bench.path("void.autumn").unlink(missing_ok=True)
        bench.native("convert", "void.goblin", "void.autumn")
        bench.made.add("void.autumn")
        return program("edit", "{edited}", "set", bench.rows(name), edits="void.autumn")(bench)

    return row


def query(job, tree, count):
    def row(bench):
        name = bench.tree(tree)
        instructions, digest = bench.count([bench.bench, job, name, count])
        return {"instructions": instructions - bench.idle(bench.bench, "open", name), "digest": digest}

    return row


# Name: file, cells, boundary.
SOLIDS = {
    "solid": ("armadillo.ply", 256),
    "solid_coverage": ("armadillo.ply", 128, "area"),
    "solid_rocker": ("rocker-arm.obj", 128),
    "solid_dirty": ("nasty/301921.stl", 128),
    "solid_open": ("bunny.ply", 128),
}
# Name: how it is made from other trees.
MADE = {
    "solid_b": ("transform", "solid.goblin", "--move", "translate=21,13,6"),
    "solid_cut": ("transform", "solid.goblin", "window=9,5,3,200,240,190"),
    "land_far": ("transform", "land_b.goblin", "--move", "translate=301,205"),
    "rgb_far": ("transform", "rgb_b.goblin", "--move", "translate=301,205"),
}
COMBINED = ["union", "and", "a-b", "xor", "over", "min", "add", "changed"]
# Queries per file; a third of them for Autumnal files, and more for fast queries.
MANY = {"uniform": 30, "coastline": 2}
JOBS = {
    "descent": 150_000,
    "coarse": 150_000,
    "points": 400_000,
    "tiles": 250,
    "unaligned": 200,
    "tiles-valid": 250,
    "walk": 150,
    "histogram": 40,
    "find": 60,
}


def rows():
    """Returns all rows by name, as functions of a bench."""
    table = {}

    def add(name, row):
        assert name not in table, name
        table[name] = row

    has_meshes = (DATA / "mesh").is_dir()
    solids = list(SOLIDS) if has_meshes else []
    for name in [*RASTERS, *solids]:
        add(f"build {name}", build(name, "out.goblin"))
    for name in ["coastline", "land", "photograph", "rgb", "f64", *solids[:2]]:
        add(f"build {name}.autumn", build(name, "out.autumn"))
        add(f"build {name}.share.autumn", build(name, "out.autumn", "--share"))
    for rule in ["majority", "dominant", "min", "max", "nearest"]:
        add(f"build photograph --rule {rule}", build("photograph", "out.goblin", "--rule", rule))
    add("build land --memory 1M", build("land", "out.goblin", "--memory", "1M"))
    add("build rgb --band 3,1", build("rgb", "out.goblin", "--band", "3,1"))
    if has_meshes:
        add("build solid_rocker --shell", build("solid_rocker", "out.goblin", "--shell"))
        add("build solid_rocker --attribute part", build("solid_rocker", "out.goblin", "--attribute", "part"))

    solid, coverage = (["solid"], ["solid_coverage"]) if has_meshes else ([], [])
    for name in ["land", "photograph", "rgb", "f64", *solid, "volume_f32", "volume_u16"]:
        add(f"convert {name}.autumn", program("convert", "{0}", trees=[f"{name}.autumn"], makes="out.goblin"))
        add(f"convert {name}.goblin", program("convert", "{0}", trees=[f"{name}.goblin"], makes="out.autumn"))
    for name in ["land", *solid]:
        row = program("convert", "{0}", "--share", trees=[f"{name}.goblin"], makes="out.autumn")
        add(f"convert {name}.goblin --share", row)
        row = program("convert", "{0}", trees=[f"{name}.share.autumn"], makes="out.goblin")
        add(f"convert {name}.share.autumn", row)
        row = program("compact", "{0}", trees=[f"{name}.autumn"], makes="out.autumn")
        add(f"compact {name}.autumn", row)

    for operation in COMBINED:
        for name in ["land", "photograph", "rgb", "f32", *solid]:
            trees = [f"{name}.goblin", f"{name}_b.goblin"]
            add(f"combine {operation} {name}", program("combine", operation, "{0}", "{1}", trees=trees, makes="out.goblin"))
    for operation in ["union", "a-b"]:
        for name in ["land", "rgb"]:
            row = program("combine", operation, "{0}", "{1}", trees=[f"{name}.goblin", f"{name}_far.goblin"], makes="out.goblin")
            add(f"combine {operation} {name} far", row)
        for name in ["land", *solid]:
            trees = [f"{name}.autumn", f"{name}_b.goblin"]
            row = program("combine", operation, "{0}", "{1}", trees=trees, makes="out.autumn")
            add(f"combine {operation} {name}.autumn", row)
    add("combine not land", program("combine", "not", "{0}", trees=["land.goblin"], makes="out.goblin"))
    add("combine cross land", program("combine", "cross", "{0}", "{1}", trees=["land.goblin", "land_b.goblin"]))

    def transform(name, *steps, kind=".goblin", output="out.goblin"):
        row = program("transform", "{0}", *steps, trees=[f"{name}{kind}"], makes=output)
        add(f"transform {' '.join(steps)} {name}{kind.removesuffix('.goblin')}", row)

    for name in ["land", "photograph", "rgb", "f32"]:
        transform(name, "window=133,77,640,650")
        transform(name, "window=256,256,512,512")
        transform(name, "window=100,100,500,500", "rotate=30")
        transform(name, "rotate=90")
        transform(name, "scale=0.5")
        transform(name, "window=0,0,512,512", "scale=1.7")
        transform(name, "window=0,0,512,512", "translate=0.5,0.5")
        transform(name, "nest=/2")
        transform(name, "root=/1")
    transform("photograph", "rotate=30", "--resampling", "nearest")
    transform("land", "depth=8")
    transform("land", "depth=12")
    transform("land", "crop")
    transform("land", "mirror=x", "transpose")
    for kind in [".autumn", ".share.autumn"]:
        transform("land", "window=133,77,640,650", kind=kind)
        transform("land", "window=100,100,500,500", "rotate=30", kind=kind)
        transform("land", "rotate=90", kind=kind, output="out.autumn")
    # Boxes that contain some surface.
    boxes = {"solid": ("45,60,50,120,130,110", "64,64,64,64,128,64"), "volume_f32": ("13,7,21,64,64,64", "0,0,0,64,64,64")}
    inside = {"solid": "window=60,90,60,80,90,80", "volume_f32": "window=16,16,16,40,40,40"}
    for name in [*solid, "volume_f32"]:
        for box in boxes[name]:
            transform(name, f"window={box}")
        transform(name, inside[name], "rotate=30,z")
        transform(name, inside[name], "rotate=30,1,1,0")
        transform(name, "axes=+y,-x,+z")
        transform(name, "scale=0.5")
        transform(name, inside[name], "scale=1.7")
        transform(name, inside[name], "translate=0.5,0.5,0.5")
        transform(name, "nest=/2")
        transform(name, "root=/1")

    trees = ["land.goblin", "photograph.goblin", "rgb.goblin", "f64.goblin", "land.autumn", "rgb.share.autumn"]
    for tree in [*trees, *[f"{name}.goblin" for name in [*solid, "volume_f32"]]]:
        add(f"verify {tree}", program("verify", "{0}", trees=[tree]))
    for tree in ["land.goblin", "photograph.goblin", "rgb.goblin", "f64.goblin", "land.autumn"]:
        add(f"stats {tree}", program("stats", "{0}", "--window", "13,57,731,650", trees=[tree]))
    row = program("stats", "{0}", "--view", "window=133,77,640,650", trees=["land.goblin"])
    add("stats --view window land.goblin", row)
    row = program("stats", "{0}", "--view", "window=133,77,300,300", "--view", "rotate=30", trees=["f32.goblin"])
    add("stats --view rotate f32.goblin", row)
    for tree in [f"{name}.goblin" for name in [*solid, *coverage]]:
        add(f"stats {tree}", program("stats", "{0}", trees=[tree]))

    for name, value in [("land", "3"), ("photograph", "3"), ("rgb", "1,2,3"), ("f64", "2.5")]:
        region = ["--window", "101,57,700,800", "--value", value]
        add(f"edit fill {name}", program("edit", "{edited}", "fill", *region, edits=f"{name}.autumn"))
        patch = f"{name}_b.goblin" if name in SHIFTED else f"{name}.goblin"
        for how, more in [("", []), (" --at", ["--at", "301,203"]), (" --void", ["--void"])]:
            row = program("edit", "{edited}", "paste", "{0}", *more, trees=[patch], edits=f"{name}.autumn")
            add(f"edit paste{how} {name}", row)
    add("edit paste image land", paste("land_b", "land.autumn"))
    polygon = "100.5,100.5 900.2,150.3 700.9,800.1; 300,300 400,300 400,400"
    add("edit fill --polygon land", program("edit", "{edited}", "fill", "--polygon", polygon, "--value", "2", edits="land.autumn"))
    add("edit fill --block land", program("edit", "{edited}", "fill", "--block", "/0312", "--void", edits="land.autumn"))
    add("edit set land", set_cells("land.autumn", 2048, 2, 1, 20_000))
    add("edit set land.share", set_cells("land.share.autumn", 2048, 2, 1, 20_000))
    add("edit set rgb", set_cells("rgb.autumn", 1024, 2, 3, 20_000))
    add("edit set f64", set_cells("f64.autumn", 1024, 2, 1, 20_000))
    for operation in ["union", "a-b", "min"]:
        for name in ["land", *solid]:
            row = program("edit", "{edited}", "apply", operation, "{0}", trees=[f"{name}_b.goblin"], edits=f"{name}.autumn")
            add(f"edit apply {operation} {name}", row)
    for name in solid:
        add("edit set solid", set_cells("solid.autumn", 140, 3, 1, 20_000))
        region = ["--window", "31,17,40,90,101,80", "--value", "255"]
        add("edit fill solid", program("edit", "{edited}", "fill", *region, edits="solid.autumn"))
    for name in VOLUMES:
        add(f"edit set all {name}", fill_volume(name))

    for first, second in [("land", "land_b"), ("rgb", "rgb_b"), *[(name, "solid_cut") for name in solid]]:
        add(f"diff {first}", program("diff", "{0}", "{1}", trees=[f"{first}.goblin", f"{second}.goblin"]))
    for name in ["land", "photograph", "rgb", "f32"]:
        ending = "png" if name in ["land", "rgb"] else "npy"
        window = ["--view", "window=100,100,600,600"]
        row = program("get", "{0}", f"out.{ending}", *window, "--view", "rotate=30", trees=[f"{name}.goblin"])
        add(f"get --view rotate {name}", row)
        row = program("get", "{0}", "out.npy", *window, trees=[f"{name}.goblin"])
        add(f"get --view window {name}", row)
        add(f"get --size {name}", program("get", "{0}", "out.npy", "--size", "700x700", trees=[f"{name}.goblin"]))
    for name in [*solid, "volume_f32"]:
        add(f"get array {name}", program("get", "{0}", "out.npy", trees=[f"{name}.goblin"]))
        add(f"get slice {name}", program("get", "{0}", "out.npy", "--slice", "z=40", trees=[f"{name}.goblin"]))
        view = ["--view", inside[name], "--view", "rotate=30,x"]
        add(f"get --view rotate {name}", program("get", "{0}", "out.npy", *view, trees=[f"{name}.goblin"]))
    for name in [*solid, *coverage]:
        add(f"export {name}", program("export", "{0}", "out.ply", trees=[f"{name}.goblin"]))
        add(f"export --smooth {name}", program("export", "{0}", "out.stl", "--smooth", trees=[f"{name}.goblin"]))
        row = program("render", "{0}", "out.png", "--size", "160x120", trees=[f"{name}.goblin"])
        add(f"render {name}", row)
    add("export volume_u8", program("export", "{0}", "out.obj", trees=["volume_u8.goblin"]))

    for name in RASTERS:
        for job, count in JOBS.items():
            add(f"query {job} {name}", query(job, f"{name}.goblin", count * (MANY.get(name, 1) if job != "points" else 1)))
    for name in [*solid, *coverage, *VOLUMES]:
        for job, count in JOBS.items():
            if job != "coarse":
                add(f"query {job} {name}", query(job, f"{name}.goblin", count))
        add(f"query solid {name}", query("solid", f"{name}.goblin", 1))
    for name in ["land", "rgb", "f64", "land.share", *solid, "volume_f32"]:
        for job, count in JOBS.items():
            if job != "coarse":
                add(f"query {job} {name}.autumn", query(job, f"{name}.autumn", count // 3))
    for tree in ["land.goblin", "land.autumn", "f64.goblin"]:
        add(f"query open {tree}", query("open", tree, 300))
    return table


def measure(options):
    bench = Bench(options)
    wanted = {name: row for name, row in rows().items() if re.search(options.only, name)}
    found = {}
    start = time.monotonic()
    for index, (name, row) in enumerate(wanted.items(), 1):
        try:
            found[name] = bench.run(row)
            text = f"{found[name]['instructions']:>16,}"
        except Failure as error:
            found[name] = {"failed": str(error)}
            text = f"{'failed':>16}"
            print(f"{name}: {error}", file=sys.stderr)
        print(f"{index:>4}/{len(wanted)} {time.monotonic() - start:6.0f} s {text}  {name}", flush=True)
        if options.out:
            said = {"program": str(options.program), "bench": str(options.bench), "rows": found}
            options.out.write_text(json.dumps(said, indent=1) + "\n")
    failed = [name for name, row in found.items() if "failed" in row]
    if failed:
        sys.exit(f"{len(failed)} of {len(found)} rows failed")


def compare(before, after, only):
    a, b = (json.loads(path.read_text())["rows"] for path in (before, after))
    a, b = ({name: row for name, row in rows.items() if re.search(only, name)} for rows in (a, b))
    good = [name for name in a if name in b and "failed" not in a[name] and "failed" not in b[name]]
    bad = False
    for name in [name for name in {**a, **b} if name not in good]:
        outcomes = [rows.get(name, {"failed": "not there"}).get("failed", "good") for rows in (a, b)]
        bad |= outcomes[0] != outcomes[1]
        print(f"NOT COMPARED {name}: before {outcomes[0]}; after {outcomes[1]}")
    ratios = {name: max(b[name]["instructions"], 1) / max(a[name]["instructions"], 1) for name in good}
    print(f"{'before':>16} {'after':>16} {'ratio':>7}  job")
    for name in sorted(good, key=lambda name: -ratios[name]):
        marks = []
        if ratios[name] > MOST and b[name]["instructions"] - a[name]["instructions"] > FEW:
            marks.append("SLOWER")
        if a[name]["digest"] != b[name]["digest"]:
            marks.append("OTHER RESULT")
        bad |= bool(marks)
        counts = f"{a[name]['instructions']:>16,} {b[name]['instructions']:>16,}"
        print(f"{counts} {ratios[name]:7.4f}  {'  '.join([name, *marks])}")
    if good:
        sums = [sum(rows[name]["instructions"] for name in good) for rows in (a, b)]
        mean = math.exp(sum(math.log(ratio) for ratio in ratios.values()) / len(good))
        print(f"{sums[0]:>16,} {sums[1]:>16,} {sums[1] / sums[0]:7.4f}  sum of {len(good)}")
        slower = sum(ratio > MOST for ratio in ratios.values())
        print(f"{'':>33} {mean:7.4f}  geometric mean; {slower} over {MOST}")
    sys.exit(1 if bad else 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, help="the program `spinney`")
    parser.add_argument("--bench", type=Path, help="the bench program `instructions`")
    parser.add_argument("--out", type=Path, help="the JSON file to make")
    parser.add_argument("--only", default="", metavar="REGEX", help="rows to count or to compare")
    parser.add_argument("--work", type=Path, default=WORK, help="directory for inputs and outputs")
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("BEFORE", "AFTER"), help="compare two JSON files")
    parser.add_argument("--list", action="store_true", help="print the names of all rows")
    parser.add_argument("--native", action="store_true", help="take microseconds instead of counting")
    options = parser.parse_args()
    options.work = options.work.resolve()
    if options.list:
        print("\n".join(rows()))
    elif options.compare:
        compare(*options.compare, options.only)
    elif options.program and options.bench:
        measure(options)
    else:
        parser.error("give --program and --bench, or --compare")


if __name__ == "__main__":
    main()
