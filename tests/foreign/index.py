"""Reader of indexes, written only from sections 58 to 65 of formats.md.

    python tests/foreign/index.py INDEX.goblin COLUMN ROW

It reads local sources without compression, with DEFLATE and with LZW, and without conversion of
colours.
"""

from __future__ import annotations

import math
import os.path
import sys
import warnings
import zlib
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from basics import Bytes, Code, Unknown, check, crc32c
from lzw import decompress as lzw
from manifest import resolve
from numpy.typing import NDArray
from packed_models import Columns
from reader import Entry, Goblin, Layer, Reference
from rules import Pyramid
from tokens import signed
from trees import INNER, LEAF, REFERENCE, VOID, Values, raw_bits
from verify import Writer

# Variants of enums.
UNSIGNED, SIGNED, FLOATING = range(3)
NONE, DEFLATE, ZSTANDARD, LZW, PACK_BITS, FAX, WEBP, JPEG = range(8)
NO_PREDICTOR, HORIZONTAL, FLOAT_PREDICTOR = range(3)
NO_COLOUR, JPEG_COLOUR, BLOCKS, CMYK = range(4)
MODIFIED, TAG = range(2)

MAX_LIST, MAX_PAGE, MAX_TABLE, MAX_CHUNK = 1 << 28, 1 << 24, 1 << 16, 1 << 28
MAX_SIDE = 1 << 31
TABLE_CHUNKS = 1024

Flags = NDArray[np.bool_]
# Column, row, columns, rows.
Region = tuple[int, int, int, int]


def intersection(a: Region, b: Region) -> Region | None:
    left, top = max(a[0], b[0]), max(a[1], b[1])
    right, bottom = min(a[0] + a[2], b[0] + b[2]), min(a[1] + a[3], b[1] + b[3])
    return (left, top, right - left, bottom - top) if left < right and top < bottom else None


def columns(data: bytes) -> Columns:
    """Returns the reader of columns (section 60)."""
    check(len(data) >= 16 and len(data) % 4 == 0, "bytes of columns")
    # As in a packed chunk, which has a head.
    return Columns(bytes(9) + data)


def one_of(b: Bytes, variants: int) -> int:
    """Returns the variant of an enum."""
    variant = b.unsigned()
    check(variant < variants, "an enum has no such variant")
    return variant


def nested(b: Bytes) -> list[Any]:
    return b.many(lambda: b.many(b.unsigned))


@dataclass
class Format:
    """How chunks are stored."""

    width: int
    height: int
    samples: int
    planes: int
    kind: int
    bits: int
    compression: int
    predictor: int
    colour: int
    big_endian: bool
    lowest_first: bool

    @staticmethod
    def read(b: Bytes) -> Format:
        width, height, samples, planes = (b.unsigned() for _ in range(4))
        kind, bits, compression = one_of(b, 3), b.get("B"), one_of(b, 8)
        if compression == JPEG:
            b.blob()
        predictor, colour = one_of(b, 3), one_of(b, 4)
        if colour == BLOCKS:
            shares, block = b.get("3f"), {b.unsigned(), b.unsigned()}
            check(all(map(math.isfinite, shares)) and shares[1] and block <= {1, 2, 4}, "subsampled colour")
        form = Format(width, height, samples, planes, kind, bits, compression, predictor, colour, b.boolean(), b.boolean())
        form.check()
        return form

    def check(self) -> None:
        most = 65535 if self.compression == FAX else MAX_SIDE - 1
        check(all(1 <= side <= most for side in (self.width, self.height)), "columns or rows of chunks")
        check(1 <= self.samples <= 65535 and self.planes in (1, self.samples), "samples or planes")
        known = [{*range(1, 33), 64}, {8, 16, 32, 64}, {16, 24, 32, 64}]
        check(self.bits in known[self.kind], "bits of samples")
        if self.predictor:
            fits = self.bits in known[SIGNED] if self.predictor == HORIZONTAL else self.kind == FLOATING
            check(fits and self.compression in (DEFLATE, ZSTANDARD, LZW), "the predictor")
        if self.compression in (JPEG, WEBP):
            check(self.bits == 8 and not self.lowest_first, "bits of a JPEG or WebP image")
        if self.compression == FAX:
            check((self.kind, self.bits, self.samples) == (UNSIGNED, 1, 1), "samples of a fax")
        if self.colour:
            check((self.kind, self.bits, self.planes) == (UNSIGNED, 8, 1), "samples of colours")
            check(self.samples >= 4 if self.colour == CMYK else self.samples == 3, "number of colours")
            check(self.colour != JPEG_COLOUR or self.compression == JPEG, "colour of a JPEG image")
            plain = not self.predictor and self.compression not in (JPEG, WEBP)
            check(self.colour != BLOCKS or plain, "subsampled colour")
        most = self.width * self.height * max(8, self.type.itemsize * self.channels)
        check(most <= MAX_CHUNK, "the size of a chunk")

    @property
    def type(self) -> np.dtype[Any]:
        """The type of widened samples."""
        size = next(size for size in (1, 2, 4, 8) if self.bits <= 8 * size)
        return np.dtype(f"<{'uif'[self.kind]}{4 if self.kind == FLOATING and size < 4 else size}")

    @property
    def channels(self) -> int:
        return 4 if self.colour == CMYK else self.samples

    @property
    def chunk_samples(self) -> int:
        """Samples per pixel in a chunk."""
        return 1 if self.planes > 1 else self.samples

    @property
    def row_bytes(self) -> int:
        return -(-self.width * self.chunk_samples * self.bits // 8)

    def decode(self, stored: bytes, rows: int) -> Values:
        """Returns the widened samples of a chunk, by row, column, sample (section 63)."""
        if self.colour:
            raise Unknown("conversion of colours")
        if self.lowest_first:
            stored = bytes(int(f"{byte:08b}"[::-1], 2) for byte in stored)
        size = rows * self.row_bytes
        if self.compression == NONE:
            data = stored[:size]
        elif self.compression == DEFLATE:
            data = zlib.decompressobj().decompress(stored, size)
        elif self.compression == LZW:
            data = lzw(stored, size)
        else:
            raise Unknown("the compression of a source")
        check(len(data) == size, "a chunk ends too early")
        return self.samples_of(np.frombuffer(data, np.uint8).reshape(rows, self.row_bytes))

    def samples_of(self, rows: NDArray[np.uint8]) -> Values:
        k, shape = self.chunk_samples, (len(rows), self.width, self.chunk_samples)
        size = self.bits // 8
        if self.bits % 8 or (self.kind, self.bits) == (UNSIGNED, 24):
            bits = np.unpackbits(rows, axis=1)[:, : self.width * k * self.bits].reshape(*shape, self.bits)
            values = np.zeros(shape, np.uint64)
            for i in range(self.bits):
                values = values << np.uint64(1) | bits[..., i]
            return values.astype(self.type)
        swap = self.big_endian and self.predictor != FLOAT_PREDICTOR
        grouped = rows.reshape(len(rows), -1, size)
        rows = np.ascontiguousarray(grouped[:, :, ::-1] if swap else grouped).reshape(rows.shape)
        if self.predictor == FLOAT_PREDICTOR:
            sums = np.cumsum(rows.reshape(len(rows), -1, k), 1, np.uint8).reshape(len(rows), size, -1)
            rows = np.ascontiguousarray(sums[:, ::-1].transpose(0, 2, 1)).reshape(rows.shape)
        if (self.kind, self.bits) == (FLOATING, 24):
            return float24(rows.reshape(*shape, 3))
        if self.predictor == HORIZONTAL:
            kind = np.dtype(f"<u{size}")
            rows = np.cumsum(rows.view(kind).reshape(shape), 1, kind).astype(kind)
        stored = np.dtype(f"<{'uif'[self.kind]}{size}")
        return np.ascontiguousarray(rows).view(stored).reshape(shape).astype(self.type)


def float24(raw: NDArray[np.uint8]) -> Values:
    """Returns floating samples of 24 bits."""
    n = raw[..., 0].astype(np.uint32) | raw[..., 1].astype(np.uint32) << 8 | raw[..., 2].astype(np.uint32) << 16
    sign, exponent, mantissa = n >> 23 << 31, n >> 16 & 127, n & 0xFFFF
    special = np.where(exponent == 127, 255 << 23, exponent + 64 << 23) | mantissa << 7
    tiny = (mantissa.astype("<f4") * np.float32(2.0**-78)).view("<u4")
    return (sign | np.where(exponent == 0, tiny, special)).astype("<u4").view("<f4")


@dataclass
class Rule:
    """Which pixels are VOID."""

    nodata: bytes | None
    nan: bool
    opacity: int | None
    zeros: bool
    hidden_opacity: int | None
    no_mask: bool

    @staticmethod
    def read(b: Bytes) -> Rule:
        return Rule(b.option(b.blob), b.boolean(), b.option(b.unsigned), b.boolean(), b.option(b.unsigned), b.boolean())

    def void(self, pixels: Values) -> Flags:
        """Returns which pixels are VOID by their samples."""
        found = np.zeros(pixels.shape[:-1], bool)
        if self.nodata is not None:
            found |= equal(pixels, self.nodata)
        if self.nan:
            found |= is_nan(pixels)
        if self.opacity is not None:
            found |= pixels[..., self.opacity] == 0
        if self.zeros:
            found |= (raw_bits(pixels) == 0).all(-1)
        return found


def equal(pixels: Values, value: bytes) -> Flags:
    """Returns which pixels have the bytes of a value."""
    if len(value) != pixels.dtype.itemsize * pixels.shape[-1]:
        return np.zeros(pixels.shape[:-1], bool)
    found: Flags = (raw_bits(pixels) == raw_bits(np.frombuffer(value, pixels.dtype))).all(-1)
    return found


def is_nan(pixels: Values) -> Flags:
    found: Flags = (pixels != pixels).any(-1)
    return found


@dataclass
class Window:
    """A window of a source, and the cells that its pixels are: a placement."""

    source: int
    channels: int
    rule: int
    cells: Region
    start: tuple[int, int]


@dataclass
class Location:
    offset: int
    length: int
    checksum: int

    @staticmethod
    def read(b: Bytes) -> Location:
        return Location(b.unsigned(), b.unsigned(), b.unsigned())


# Offset, length and checksum of a chunk; None if it was never written.
Chunk = tuple[int, int, int] | None


@dataclass
class Image:
    format: int
    chunks: int
    table: list[bytes | Location]
    pages: dict[int, list[Chunk]] = field(default_factory=dict)

    @staticmethod
    def read(b: Bytes) -> Image:
        return Image(b.unsigned(), b.unsigned(), b.many(lambda: Location.read(b) if one_of(b, 2) else b.blob()))


def read_version(b: Bytes) -> int | str:
    return b.text() if one_of(b, 2) == TAG else b.signed()


@dataclass
class Source:
    name: str
    length: int
    version: int | str
    page: int
    size: tuple[int, int]
    images: list[Image]
    hole: bytes
    decoder: str | None
    data: bytes | None = None

    @staticmethod
    def read(b: Bytes) -> Source:
        name, length, version = b.text(), b.unsigned(), read_version(b)
        page, size, image = b.unsigned(), (b.unsigned(), b.unsigned()), Image.read(b)
        mask = b.option(lambda: Image.read(b))
        return Source(name, length, version, page, size, [image, mask] if mask else [image], b.blob(), b.option(b.text))


def read_table(data: bytes, count: int) -> list[Chunk]:
    """Returns a page of a table of chunks (section 61)."""
    b = Bytes(data)
    coded = columns(b.take(b.get("I")))
    found: list[Chunk] = []
    end = length = 0
    for _ in range(count):
        length = length + coded.near(1) & (1 << 64) - 1
        if not length:
            found.append(None)
            continue
        offset = end + coded.near(0) & (1 << 64) - 1
        end = offset + length
        check(end < 1 << 64, "the end of a chunk")
        found.append((offset, length, b.get("I")))
    coded.finish()
    check(b.at == len(data), "checksums of a table")
    return found


class Index:
    """A Goblin file, and the cells that are in other files."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.file = Goblin(Path(path).read_bytes())
        self.layers = self.file.layers
        check(all(layer.form.axes == 2 for layer in self.layers if layer.is_index), "an index that is no quadtree")
        if any(layer.is_index for layer in self.layers):
            self._read_list(self.file.sections.get(b"SRCS", b""))
        for number, layer in enumerate(self.layers):
            if layer.is_index:
                self._check_placements(number)
                layer.referenced = self._referenced(number)

    def _read_list(self, data: bytes) -> None:
        check(len(data) <= MAX_LIST, "the list of sources is too long")
        b = Bytes(data)
        if b.unsigned() != 1:
            raise Unknown("a list of sources of another version")
        self.formats: list[Format] = b.many(lambda: Format.read(b))
        self.rules: list[Rule] = b.many(lambda: Rule.read(b))
        self.channels: list[list[int]] = nested(b)
        cells = b.many(lambda: (b.option(b.blob), b.unsigned(), b.blob()))
        b.many(lambda: (b.text(), b.unsigned(), read_version(b)))  # virtual rasters
        self.count = b.unsigned()
        self.page_locations: list[tuple[int, Location]] = b.many(lambda: (b.unsigned(), Location.read(b)))
        check(b.at == len(data) and len(cells) == len(self.layers), "bytes or layers of the list of sources")
        numbers = [sources for sources, _ in self.page_locations]
        check(0 not in numbers and sum(numbers) == self.count, "sources of the pages")
        self.nodata: list[bytes | None] = [nodata for nodata, _, _ in cells]
        self.placements = [self._placements(count, coded) for _, count, coded in cells]
        self.sources: dict[int, Source] = {}

    def _placements(self, count: int, data: bytes) -> list[Window]:
        check(count <= min(1 << 22, 64 * len(data)), "too many placements")
        coded, found, fields = columns(data), [], [0] * 9
        for _ in range(count):
            fields = [field + coded.near(context) for context, field in enumerate(fields)]
            check(all(0 <= field < MAX_SIDE for field in fields), "numbers of a placement")
            source, channels, rule, x, y, width, height, left, top = fields
            check(source < self.count and channels < len(self.channels) and rule < len(self.rules), "a placement of nothing")
            check(width and height, "a placement without cells")
            found.append(Window(source, channels, rule, (x, y, width, height), (left, top)))
        coded.finish()
        return found

    def _check_placements(self, number: int) -> None:
        form, nodata = self.layers[number].form, self.nodata[number]
        check(nodata is None or len(nodata) == form.width, "bytes of nodata")
        for placement in self.placements[number]:
            x, y, width, height = placement.cells
            check(x + width <= form.extent[0] and y + height <= form.extent[1], "a placement beyond the extent")
            rule, channels = self.rules[placement.rule], self.channels[placement.channels]
            check(len(channels) == form.channels, "channels of a placement")
            check(rule.opacity is None or rule.opacity < form.channels, "the opacity of a rule")

    def page(self, at: Location, most: int) -> bytes:
        section = self.file.sections.get(b"SRCP", b"")
        check(at.offset + at.length <= len(section) and at.length <= most, "a page lies outside the section")
        data = section[at.offset : at.offset + at.length]
        check(crc32c(data) == at.checksum, "checksum of a page of sources")
        return data

    def source(self, number: int) -> Source:
        """Returns a source by number. Its file is not opened."""
        if number not in self.sources:
            first = 0
            for count, at in self.page_locations:
                if first + count > number:
                    break
                first += count
            b = Bytes(self.page(at, MAX_PAGE))
            if b.unsigned() != 1:
                raise Unknown("a page of sources of another version")
            sources = b.many(lambda: Source.read(b))
            check(len(sources) == count and b.at == len(b.data), "sources of a page")
            for i, source in enumerate(sources):
                self._check_source(source)
                self.sources[first + i] = source
        return self.sources[number]

    def _check_source(self, source: Source) -> None:
        check(all(1 <= side < MAX_SIDE for side in source.size), "size of a source")
        for image in source.images:
            check(image.format < len(self.formats), "a format that does not exist")
            f = self.formats[image.format]
            across, down = (-(-side // chunk) for side, chunk in zip(source.size, (f.width, f.height)))
            check(image.chunks == across * down * f.planes, "number of chunks")
            check(len(image.table) == -(-image.chunks // TABLE_CHUNKS), "pages of a table of chunks")
        check(len(source.hole) == self.formats[source.images[0].format].type.itemsize, "bytes of the hole")

    def chunk(self, image: Image, number: int) -> Chunk:
        """Returns where a chunk is, from the table."""
        page, within = divmod(number, TABLE_CHUNKS)
        if page not in image.pages:
            stored = image.table[page]
            data = self.page(stored, MAX_TABLE) if isinstance(stored, Location) else stored
            check(len(data) <= MAX_TABLE, "a table is too long")
            image.pages[page] = read_table(data, min(TABLE_CHUNKS, image.chunks - page * TABLE_CHUNKS))
        return image.pages[page][within]

    def bytes_of(self, source: Source) -> bytes:
        """Returns the bytes of a source's file."""
        if source.data is None:
            path = resolve(source.name, self.path)
            source.data = Path(path).read_bytes()
            known = (source.length, source.version)
            if (len(source.data), os.stat(path).st_mtime_ns) != known:
                warnings.warn(f"{path} has another length or time than when it was indexed")
        return source.data

    def decoded(self, source: Source, image: Image, plane: int, row: int, column: int) -> Values | None:
        """Returns the samples of a chunk; None if it was never written."""
        f = self.formats[image.format]
        across, down = (-(-side // chunk) for side, chunk in zip(source.size, (f.width, f.height)))
        chunk = self.chunk(image, (plane * down + row) * across + column)
        if chunk is None:
            return None
        offset, length, checksum = chunk
        check(length <= 2 * f.height * f.row_bytes + 65536, "a chunk is too long")
        data = self.bytes_of(source)
        check(offset + length <= len(data), f"a chunk of {source.name} is beyond the end")
        stored = data[offset : offset + length]
        check(crc32c(stored) == checksum, f"a chunk of {source.name} is not the one that was indexed")
        return f.decode(stored, min(f.height, source.size[1] - row * f.height))

    def pixels(self, source: Source, image: Image, channels: list[int], region: Region, hole: bytes) -> Values:
        """Returns channels of a region of an image, by row, column, channel."""
        f, (x, y, width, height) = self.formats[image.format], region
        found = np.zeros((height, width, len(channels)), f.type)
        for row in range(y // f.height, -(-(y + height) // f.height)):
            for column in range(x // f.width, -(-(x + width) // f.width)):
                part = intersection(region, (column * f.width, row * f.height, f.width, f.height))
                assert part
                to = (slice(part[1] - y, part[1] - y + part[3]), slice(part[0] - x, part[0] - x + part[2]))
                left, top = part[0] - column * f.width, part[1] - row * f.height
                own = (slice(top, top + part[3]), slice(left, left + part[2]))
                for i, channel in enumerate(channels):
                    # (With planes, the sample is the first of its chunk.)
                    plane, sample = (channel, 0) if f.planes > 1 else (0, channel)
                    samples = self.decoded(source, image, plane, row, column)
                    if samples is None:
                        found[(*to, i)] = np.frombuffer(hole, f.type)[0]
                    else:
                        found[(*to, i)] = samples[(*own, sample)]
        return found

    def cells(self, layer: int, region: Region) -> tuple[Values, Values]:
        """Returns values and states of the cells of a region, by row, column (section 62)."""
        form = self.layers[layer].form
        values = np.zeros((region[3], region[2], form.channels), form.type)
        known = np.zeros(values.shape[:2], bool)
        for placement in reversed(self.placements[layer]):
            part = intersection(placement.cells, region)
            if part is None or known.all():
                continue
            at = (slice(part[1] - region[1], part[1] - region[1] + part[3]), slice(part[0] - region[0], part[0] - region[0] + part[2]))
            pixels, void = self._window(placement, part, form.type)
            new = ~known[at] & ~void
            values[at] = np.where(new[..., None], pixels, values[at])
            known[at] |= new
        nodata = self.nodata[layer]
        void = ~known | is_nan(values)
        if nodata is not None:
            void |= equal(values, nodata)
        values[void] = 0
        return values, np.where(void, VOID, LEAF).astype(np.uint8)

    def _window(self, placement: Window, cells: Region, kind: np.dtype[Any]) -> tuple[Values, Flags]:
        """Returns the pixels of cells of a placement, and which are VOID."""
        source, rule = self.source(placement.source), self.rules[placement.rule]
        x, y = (c - first + start for c, first, start in zip(cells, placement.cells, placement.start))
        region, channels = (x, y, *cells[2:]), self.channels[placement.channels]
        f = self.formats[source.images[0].format]
        check(x + cells[2] <= source.size[0] and y + cells[3] <= source.size[1], "a placement beyond its source")
        check(f.type == kind and all(channel < f.channels for channel in channels), "samples of a source")
        pixels = self.pixels(source, source.images[0], channels, region, source.hole)
        void = rule.void(pixels)
        if (hidden := rule.hidden_opacity) is not None:
            check(hidden < f.channels, "the opacity of a source")
            void |= self.pixels(source, source.images[0], [hidden], region, source.hole)[..., 0] == 0
        if len(source.images) > 1 and not rule.no_mask:
            mask = self.formats[source.images[1].format]
            flags = self.pixels(source, source.images[1], list(range(mask.channels)), region, bytes(mask.type.itemsize))
            void |= (flags == 0).all(-1)
        return pixels, void

    def _referenced(self, layer: int) -> Any:
        return lambda entry, reference: self.plain_segment(layer, entry, reference)

    def plain_segment(self, layer: int, entry: Entry, reference: Reference) -> bytes:
        """Returns the plain segment of a block (section 59)."""
        form = copy(self.layers[layer].form)
        height = form.depth - entry.node.level
        x, y = (v << height for v in entry.node.at)
        region = intersection((x, y, 1 << height, 1 << height), (0, 0, *form.extent[:2]))
        check(region is not None, "a block beyond the extent")
        assert region
        values = np.zeros((1 << height, 1 << height, form.channels), form.type)
        states = np.full(values.shape[:2], VOID, np.uint8)
        inside = (slice(region[3]), slice(region[2]))
        values[inside], states[inside] = self.cells(layer, region)
        # The block as a tree of its own.
        form.depth = height
        pyramid, root = Pyramid(form, values, states), Code(0, (0, 0))
        check(pyramid.levels[0].states[0, 0] == INNER, "a block of equal cells")
        segment = Writer(form, pyramid).segment(root)
        check(reference.nodes == numbers_of_nodes(pyramid, form.stride), "numbers of nodes of a block")
        check(len(segment) == entry.slots * form.record, "record slots of a block")
        if form.classes and len(counts := pyramid.classes_of(root)) <= 1024:
            check(counts == reference.counts, "class counts of a block")
            segment += b"".join(value + cells.to_bytes(8, "little") for value, cells in counts)
        check(crc32c(segment) == reference.checksum, "a block has other values than those that were indexed")
        return segment


def numbers_of_nodes(pyramid: Pyramid, stride: int) -> list[int]:
    """Returns the numbers of nodes in the reference of a block (section 59)."""
    levels = pyramid.form.depth
    counts = pyramid.counts() + [(0, 0, 0)] * levels
    found: list[int] = []
    for level in range(max(levels - stride, 0) + 1, levels):
        found += [counts[level][INNER], counts[level][VOID]]
    found.append(counts[levels][VOID])
    return found + [0] * (2 * stride - 1 - len(found))


if __name__ == "__main__":
    name, *at = sys.argv[1:]
    found, there = Index(name).cells(0, (int(at[0]), int(at[1]), 1, 1))
    print(found[0, 0] if there[0, 0] else None)
