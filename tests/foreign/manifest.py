"""Reader of manifests, written only from sections 47 to 49 of formats.md.

    python tests/foreign/manifest.py MANIFEST LEVEL X Y [Z]

It reads local files only, and trees without missing samples and opacity where it computes coarser
levels.
"""

from __future__ import annotations

import json
import math
import os.path
import re
import struct
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Iterator

import numpy as np
from basics import GOBLIN, Code, CorruptFile, Header, Point, Unknown, check, crc32c
from reader import Goblin, Layer
from rules import Pyramid, keys
from trees import LEAF, RULES, VOID, TreeHeader, Values, raw_bits

MAX_BYTES, MAX_FILES, MAX_COLOURS = 1 << 28, 1 << 20, 1 << 16
# Maximum bytes of a trailer, and the bytes after it.
TAIL = 4096 + 16
SCHEMES = ["http", "https", "s3", "s3a", "gs", "gcs", "az", "adl", "azure", "abfs", "abfss", "memory"]
SAMPLES = {"U8": 0, "U16": 1, "I16": 2, "U32": 3, "I32": 4, "F32": 5, "I8": 7, "F64": 10, "U64": 11, "I64": 12}
KINDS = ["categorical", "continuous"]
# Maximum files of a node whose boxes are compared; cells of a node that are counted one by one
# where boxes intersect; boxes that a larger node is divided into.
MAX_COMPARED, MAX_EXACT, MAX_BOXES = 64, 1 << 16, 32

Box = tuple[Point, Point]
Is = Callable[[Any], bool]
# Type of a key's value; whether it is required.
Keys = dict[str, tuple[Is, bool]]


def is_integer(value: Any) -> bool:
    return type(value) is int and 0 <= value < 1 << 64


def is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)


def is_string(value: Any) -> bool:
    return isinstance(value, str)


def is_number_text(value: Any) -> bool:
    return isinstance(value, str) and re.fullmatch(r"[+-]?(\d+(\.\d*)?([eE][+-]?\d+)?|inf)|NaN", value) is not None


def is_list(of: Is, length: int | None = None) -> Is:
    return lambda value: isinstance(value, list) and length in (None, len(value)) and all(map(of, value))


def is_map(key: Is, of: Is) -> Is:
    return lambda value: isinstance(value, dict) and all(map(key, value)) and all(map(of, value.values()))


def or_null(of: Is) -> Is:
    return lambda value: value is None or of(value)


def is_mask(value: Any) -> bool:
    return value in ("None", "Alpha") or is_map(lambda key: key == "Missing", is_list(is_integer, 8))(value) and len(value) == 1


def is_system(value: Any) -> bool:
    """Whether a value defines a coordinate system."""
    keys: dict[str, Is] = {
        "Epsg": lambda found: isinstance(found, dict) and is_integer(found.get("horizontal")),
        "GeoKeys": lambda found: isinstance(found, dict) and found.keys() >= {"version", "entries", "doubles", "texts"},
        **{name: is_string for name in ("Wkt", "ProjJson", "Proj")},
    }
    return isinstance(value, dict) and len(value) == 1 and all(name in keys and keys[name](found) for name, found in value.items())


DOCUMENT: Keys = {
    "spinney_manifest": (is_integer, True),
    "axes": (is_integer, True),
    "values": (lambda value: isinstance(value, dict), True),
    "kind": (is_string, True),
    "rule": (is_string, True),
    "depth": (is_integer, True),
    "extent": (is_list(is_integer, 3), True),
    "frame": (lambda value: isinstance(value, dict), True),
    "nodata": (or_null(is_number_text), False),
    "class_names": (is_map(is_number_text, is_string), False),
    "palette": (or_null(lambda value: isinstance(value, dict)), False),
    "band_names": (is_list(is_string), False),
    "scale_offset": (is_list(is_list(is_number, 2)), False),
    "units": (is_list(is_string), False),
    "alpha": (or_null(is_integer), False),
    "time": (or_null(is_string), False),
    "tags": (is_map(is_string, is_string), False),
    "files": (is_list(lambda value: isinstance(value, dict)), True),
}
VALUES: Keys = {"sample": (is_string, True), "channels": (is_integer, True), "mask": (is_mask, True)}
FRAME: Keys = {"matrix": (is_list(is_list(is_number, 4), 3), True), "crs": (or_null(is_system), False), "pixel_is_point": (lambda value: type(value) is bool, True)}
PALETTE: Keys = {"colours": (is_list(is_list(lambda value: is_integer(value) and value < 256, 4)), True)}
FILE: Keys = {
    "path": (is_string, True),
    "layer": (or_null(is_string), False),
    "at": (is_list(is_integer, 3), True),
    "size": (is_list(is_integer, 3), True),
    "depth": (is_integer, True),
    "bytes": (is_integer, True),
    "tag": (lambda value: isinstance(value, str) and re.fullmatch("[0-9a-fA-F]{8}", value) is not None, True),
}


def check_keys(found: dict[str, Any], known: Keys, what: str, refuses_unknown: bool = True) -> None:
    """Checks the keys of an object, and the types of their values."""
    check(not refuses_unknown or found.keys() <= known.keys(), f"an unknown key of {what}")
    for key, (is_type, is_required) in known.items():
        check(key in found or not is_required, f"no key {key} of {what}")
        check(key not in found or is_type(found[key]), f"{key} of {what}")


def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Returns an object that has no key twice."""
    check(len({key for key, _ in pairs}) == len(pairs), "a key is there twice")
    return dict(pairs)


def no_constant(name: str) -> None:
    raise CorruptFile(f"{name} is not JSON")


def is_manifest(data: bytes) -> bool:
    """Whether the first bytes of a file are those of a manifest."""
    return re.match(rb'[ \t\n\r]*\{[ \t\n\r]*"spinney_manifest', data[:512]) is not None


def is_url(path: str) -> bool:
    scheme, mark, _ = path.partition("://")
    return mark != "" and scheme.lower() in SCHEMES


def resolve(path: str, manifest: str) -> str:
    """Returns the path or URL of a listed file, given that of the manifest."""
    if is_url(path):
        return path
    if is_url(manifest):
        check(not path.startswith(("/", "file:")), "a remote manifest names a local file")
        end = min(manifest.find(mark) % (len(manifest) + 1) for mark in "?#")
        base, query = manifest[:end], manifest[end:]
        return base[: base.rindex("/") + 1] + path + query
    return os.path.join(os.path.dirname(manifest), path)


def tag(data: bytes) -> int:
    """Returns the tag of a file."""
    return crc32c(data[-TAIL:])


@dataclass
class File:
    """A listed file. Its position and size have as many numbers as the mosaic has axes."""

    path: str
    layer: str | None
    at: Point
    size: Point
    depth: int
    bytes: int
    tag: int

    @property
    def box(self) -> Box:
        return self.at, tuple(a + s for a, s in zip(self.at, self.size))


def intersection(a: Box, b: Box) -> Box | None:
    """Returns the common box of two boxes, if there is one."""
    low, high = tuple(map(max, a[0], b[0])), tuple(map(min, a[1], b[1]))
    return (low, high) if all(x < y for x, y in zip(low, high)) else None


def volume(box: Box) -> int:
    return math.prod(high - low for low, high in zip(*box))


def without(box: Box, hole: Box) -> Iterator[Box]:
    """Yields boxes that are a box without a box inside of it."""
    low, high = map(list, box)
    for axis in range(len(low)):
        for start, end in ((low[axis], hole[0][axis]), (hole[1][axis], high[axis])):
            if start < end:
                yield tuple([*low[:axis], start, *low[axis + 1 :]]), tuple([*high[:axis], end, *high[axis + 1 :]])
        low[axis], high[axis] = hole[0][axis], hole[1][axis]


def header(document: dict[str, Any], depth: int, extent: list[int], rule: str) -> TreeHeader:
    """Returns the header of a tree with a manifest's values (section 5)."""
    values, axes = document["values"], document["axes"]
    sample, mask = values["sample"], values["mask"]
    check(axes in (2, 3) and depth <= (29 if axes == 2 else 19), "axes or depth")
    check(sample in SAMPLES and rule in RULES and document["kind"] in KINDS, "sample type, rule or kind")
    check(values["channels"] < 256, "channels")
    lack = mask["Missing"] if isinstance(mask, dict) else []
    check(all(byte < 256 for byte in lack), "the missing sample")
    raw = struct.pack(
        "<8BIB3x8s3Q",
        *(SAMPLES[sample], values["channels"], RULES.index(rule), KINDS.index(document["kind"])),
        *(0, depth, 8 if axes == 2 else 6, 2, 4096),
        *(1 if lack else 2 if mask == "Alpha" else 0, bytes(lack), *extent),
    )
    return TreeHeader(raw, Header(GOBLIN, axes, 0, depth, 1))


def in_common(form: TreeHeader) -> tuple[int, bytes]:
    """Returns what the trees of all files share: axes, values, rule and kind."""
    return form.axes, form.raw[:4] + form.raw[12:21]


class Manifest:
    """The files of a manifest as one tree."""

    def __init__(self, path: str) -> None:
        data = Path(path).read_bytes()
        check(is_manifest(data), "no manifest")
        check(len(data) <= MAX_BYTES, "the manifest is too long")
        try:
            document = json.loads(data.decode(), object_pairs_hook=unique, parse_constant=no_constant)
        except (ValueError, RecursionError):
            raise CorruptFile("no JSON") from None
        version = document.get("spinney_manifest")
        if is_integer(version) and version != 1:
            raise Unknown("a manifest of another version")
        check_keys(document, DOCUMENT, "the manifest")
        check_keys(document["values"], VALUES, "the values", False)
        check_keys(document["frame"], FRAME, "the frame", False)
        if document.get("palette") is not None:
            check_keys(document["palette"], PALETTE, "the palette", False)
            check(len(document["palette"]["colours"]) <= MAX_COLOURS, "too many colours")
        check(1 <= len(document["files"]) <= MAX_FILES, "the number of files")
        self.path, self.document = path, document
        self.form = header(document, document["depth"], document["extent"], document["rule"])
        self.files = [self._file(item) for item in document["files"]]
        check(len({(file.path, file.layer) for file in self.files}) == len(self.files), "a file is listed twice")
        self.opened: dict[int, Layer] = {}

    def _file(self, item: dict[str, Any]) -> File:
        check_keys(item, FILE, "a file")
        axes, depth = self.form.axes, item["depth"]
        check(depth <= (29 if axes == 2 else 19), "the depth of a file")
        for axis, (at, size, extent) in enumerate(zip(item["at"], item["size"], self.form.extent)):
            check(size >= 1 and at + size <= extent, "a file is outside the mosaic")
            check(axis >= axes or size <= 1 << depth, "a file is larger than its tree")
        check(item["path"] != "" and "\0" not in item["path"], "a path")
        at, size = (tuple(item[key][:axes]) for key in ("at", "size"))
        return File(item["path"], item.get("layer"), at, size, depth, item["bytes"], int(item["tag"], 16))

    def layer(self, file: File) -> Layer:
        """Returns the tree of a listed file."""
        number = next(i for i, other in enumerate(self.files) if other is file)
        if number not in self.opened:
            data = Path(resolve(file.path, self.path)).read_bytes()
            check((len(data), tag(data)) == (file.bytes, file.tag), f"{file.path} is not the file that is listed")
            layers = Goblin(data).layers
            names = [layer.name for layer in layers]
            index = 0
            if file.layer is not None:
                is_number = re.fullmatch(r"\d+", file.layer) is not None and file.layer not in names
                index = int(file.layer) if is_number else names.index(file.layer) if file.layer in names else -1
                check(0 <= index < len(layers), "no such layer")
            form = layers[index].form
            same = (form.depth, form.extent[: form.axes]) == (file.depth, file.size)
            check(same and in_common(form) == in_common(self.form), f"{file.path} has another tree")
            self.opened[number] = layers[index]
        return self.opened[number]

    def cells(self, low: Point, high: Point) -> tuple[Values, Values]:
        """Returns values and states of the cells in a box, by z, y, x."""
        f, size = self.form, tuple(b - a for a, b in zip(low, high))[::-1]
        values, states = np.zeros((*size, f.channels), f.type), np.full(size, VOID, np.uint8)
        for file in self.files:
            common = intersection((low, high), file.box)
            if common:
                part = tuple(slice(a - start, b - start) for start, a, b in zip(low, *common))[::-1]
                own, found = self.cells_of(file, common)
                values[part] = np.where((found != VOID)[..., None], own, values[part])
                states[part] = np.where(found != VOID, found, states[part])
        return values, states

    def cells_of(self, file: File, box: Box) -> tuple[Values, Values]:
        """Returns values and states of a file's cells in a box of the mosaic."""
        low, high = (tuple(v - a for v, a in zip(corner, file.at)) for corner in box)
        return self.layer(file).window(file.depth, low, high)

    def value(self, node: Code) -> Values | None:
        """Returns the value of a node; None for VOID."""
        box, height = self.box(node), self.form.depth - node.level
        files = [file for file in self.files if intersection(box, file.box)]
        if height == 0:
            values, states = self.cells(*box)
            return values.reshape(-1) if states.reshape(-1)[0] else None
        if self.form.rule in ("dominant", "nearest"):
            found = [value for value in (self.value_in(file, node) for file in files) if value is not None]
            return found[-1] if found else None
        if len(files) == 1 and height <= files[0].depth:
            return self.value_in(files[0], node)
        if not files:
            return None
        cells = self.statistics(node)
        if not len(cells):
            return None
        return self.representative(cells, lambda: map(self.value, children(node)), 1 << self.form.axes * height)

    def box(self, node: Code) -> Box:
        height = self.form.depth - node.level
        return tuple(v << height for v in node.at), tuple(v + 1 << height for v in node.at)

    def value_in(self, file: File, node: Code) -> Values | None:
        """Returns the value of a node by one file; None for VOID."""
        f, layer, t = self.form, self.layer(file), self.form.depth - node.level
        if t <= file.depth and not any(a & (1 << t) - 1 for a in file.at):
            at = tuple(v - (a >> t) for v, a in zip(node.at, file.at))
            raw = layer.value(Code(file.depth - t, at))
            return f.values(raw, 0, 1)[0] if raw is not None else None
        d = min(t, max(2, t - file.depth))
        h = t - d
        first = tuple(a + ((1 << h) >> 1) >> h for a in file.at)
        last = tuple(a - (-size >> h) for a, size in zip(first, file.size))
        start = tuple(v << d for v in node.at)
        shape = (1 << d,) * f.axes
        values, states = np.zeros((*shape, f.channels), f.type), np.full(shape, VOID, np.uint8)
        common = intersection((start, tuple(v + (1 << d) for v in start)), (first, last))
        if common:
            part = tuple(slice(a - s, b - s) for s, a, b in zip(start, *common))[::-1]
            low, high = (tuple(v - a for v, a in zip(corner, first)) for corner in common)
            values[part], states[part] = layer.window(file.depth - h, low, high)
        samples = values[states != VOID]
        if not len(samples):
            return None
        is_uniform = bool((raw_bits(samples) == raw_bits(samples[:1])).all())
        if is_uniform and (f.rule != "occupancy" or (states != VOID).all()):
            return samples[0]
        if f.rule == "majority":
            form = header(self.document, d, [*shape, 1][:3], f.rule)
            tree = Pyramid(form, values, np.where(states != VOID, LEAF, VOID).astype(np.uint8))
            return tree.levels[0].values.reshape(-1)
        return self.representative(samples, lambda: iter(samples), 1 << f.axes * d)

    def statistics(self, node: Code) -> Values:
        """Returns the values of the cells that count in a node."""
        box, height = self.box(node), self.form.depth - node.level
        files = [file for file in self.files if intersection(box, file.box)]
        boxes = [part for part in (intersection(box, file.box) for file in files) if part]
        alone = len(files) <= MAX_COMPARED and not any(intersection(a, b) for i, a in enumerate(boxes) for b in boxes[:i])
        if alone:
            return self.joined([self.counted(file, part) for file, part in zip(files, boxes)])
        if volume(box) <= MAX_EXACT:
            values, states = self.cells(*box)
            return values[states != VOID]
        if height > max(file.depth for file in files):
            return self.joined(list(map(self.statistics, children(node))))
        rest, found = [box], []
        for file in reversed(files):
            remaining: list[Box] = []
            for part in rest:
                own = intersection(part, file.box)
                if not own:
                    remaining.append(part)
                    continue
                found.append(self.counted(file, own))
                hides = len(found[-1]) == volume(own) and len(remaining) < MAX_BOXES
                remaining += without(part, own) if hides else [part]
            rest = remaining
        return self.joined(found)

    def joined(self, parts: list[Values]) -> Values:
        return np.concatenate([np.empty((0, self.form.channels), self.form.type), *parts])

    def counted(self, file: File, box: Box) -> Values:
        """Returns the values of a file's cells in a box of the mosaic, without VOID ones."""
        values, states = self.cells_of(file, box)
        return values[states != VOID]

    def representative(self, cells: Values, below: Callable[[], Iterator[Values | None]], count: int) -> Values:
        """Returns the representative of a node of `count` cells (section 13), of which some are not
        VOID. `below` yields the values of its children. Floating sums are not in the order of one
        file."""
        f = self.form
        if f.masked:
            raise Unknown("masks are not read here")
        if f.rule in ("min", "max"):
            order = keys(cells)
            return cells[order.argmin(0) if f.rule == "min" else order.argmax(0), np.arange(f.channels)]
        if f.rule in ("mean", "occupancy"):
            n = len(cells) if f.rule == "mean" else count
            if f.type.kind == "f":
                return (cells.sum(0, np.float64) / n).astype(f.type)
            return np.array([(2 * sum(map(int, column)) + n) // (2 * n) for column in cells.T]).astype(f.type)
        classes, first, counts = np.unique(keys(cells), axis=0, return_index=True, return_counts=True)
        tied = [cells[i] for i, number in zip(first, counts) if number == counts.max()]
        values = [value for value in below() if value is not None] if len(tied) > 1 else []
        for value in values:
            if any((raw_bits(value) == raw_bits(other)).all() for other in tied):
                return value
        mixed = int(counts.max())
        for value in values:
            a, b = struct.unpack("<QQ", value.tobytes().ljust(16, b"\0"))
            mixed = (mixed ^ a ^ b) * 0x9E3779B97F4A7C15 & (1 << 64) - 1
            mixed ^= mixed >> 32
        return tied[mixed % len(tied)]


def children(node: Code) -> Iterator[Code]:
    """Yields the children of a node, in order."""
    for child in range(1 << len(node.at)):
        yield Code(node.level + 1, tuple(v << 1 | child >> axis & 1 for axis, v in enumerate(node.at)))


if __name__ == "__main__":
    name, level, *at = sys.argv[1:]
    print(Manifest(name).value(Code(int(level), tuple(map(int, at)))))
