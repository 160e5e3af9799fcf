"""Reader of Goblin files in Python and NumPy, written only from sections 1 to 15 of formats.md.

It shows that the page is complete, and is a start for readers in other languages. It reads a whole
file into memory and is not optimized. Common parts of files are in basics.py, trees in trees.py,
Autumnal files in autumnal.py, exact models in models.py, the rules of section 13 in rules.py,
packed segments and extents in packed.py, trees of points in points.py, of lines in lines.py,
manifests in manifest.py, indexes in index.py, and the verification of whole files in verify.py.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Callable, Iterator

import numpy as np
from basics import Bytes, Code, CorruptFile, Header, Unknown, check, check_names, crc32c, metadata, trailer
from packed import unpack
from tokens import numbers, signed
from trees import CUT, INNER, REFERENCE, VOID, RunRecords, Statistics, Tree, TreeHeader, sum_of

NO_COUNTS = 0xFFFF

# The index entry of a page: code, offset in the run, length, checksum.
PageLocation = tuple[int, int, int, int]


@dataclass
class Entry:
    """An entry of the segment index."""

    raw: bytes
    node: Code
    start: int
    size: int
    slots: int
    classes: int
    codec: int
    crc: int
    statistics: Statistics


@dataclass
class Reference:
    """A segment whose cells are in other files: the checksum of the plain segment, value and cells
    of each class, and numbers of nodes."""

    checksum: int
    counts: list[tuple[bytes, int]]
    nodes: list[int]


class Layer(Tree):
    """A layer of a Goblin file."""

    def __init__(self, file: bytes, header: Header, raw: bytes) -> None:
        self.file = file
        self.form = form = TreeHeader(raw[:48], header)
        self.root_state = raw[48]
        b = Bytes(raw, 54)
        self.name_size = b.get("H")
        self.root_value = raw[56 : 56 + form.width]
        b.at = 72
        self.segments, self.slots, run_at, run_size, self.top_levels, self.directory = b.get("6Q")
        top_at, top_size, top_crc, meta_at, meta_size, meta_crc = b.get("QIIQII")
        check(self.root_state < CUT and (self.root_state != VOID or not any(raw[56:72])), "the root")
        check(not any(raw[56 + form.width : 72]), "bytes after the root's value")
        check((self.segments > 0) == (self.root_state == INNER) and (form.depth or not self.segments), "segments of the root")
        self.entry_size = 44 + (16 + form.square + 2 * form.type.itemsize + (8 if form.masked else 0)) * form.channels
        check(self.top_levels <= self.directory <= run_size, "offsets of the top levels and the segment index")
        self.run = self.part(run_at, run_size, None)
        check(meta_size <= 1 << 24, "metadata are too large")
        self.meta = metadata(self.part(meta_at, meta_size, meta_crc))
        # Number of pages in each level of the index, that of the segment index's pages first.
        self.levels = [-(-self.segments // 128)]
        while self.levels[-1] > 256:
            self.levels.append(-(-self.levels[-1] // 256))
        self.is_index = form.codec == REFERENCE
        entries = 16 * self.levels[0] if self.is_index else self.segments * self.entry_size
        check(entries <= run_size - self.directory, "the segment index does not fit")
        self.top = self.part(top_at, top_size, top_crc)
        check(len(self.top) == 24 * self.levels[-1], "the top of the index has another size")
        self.pages: dict[int, tuple[list[tuple[int, Entry]], list[Entry]]] = {}
        self.runs: dict[int, RunRecords] = {}
        self.unpacked: dict[int, bytes] = {}
        # Returns the plain segment of a block whose cells are in other files.
        self.referenced: Callable[[Entry, Reference], bytes] | None = None

    def part(self, at: int, size: int, crc: int | None) -> bytes:
        check(24 <= at and at + size <= len(self.file), "something lies outside the file")
        data = self.file[at : at + size]
        check(crc is None or crc32c(data) == crc, "a checksum")
        return data

    def paged(self, place: PageLocation) -> bytes:
        """Returns the page of an index entry."""
        _, at, size, crc = place
        check(self.directory <= at and at + size <= len(self.run), "a page is out of bounds")
        data = self.run[at : at + size]
        check(crc32c(data) == crc, "checksum of a page")
        return data

    def entry(self, raw: bytes) -> Entry:
        f, b = self.form, Bytes(raw)
        code, start, size, slots, classes, codec, _, crc, cells = b.get("QQQIHBBIQ")
        least, most, sums, squares = [], [], [], []
        for _ in range(f.channels):
            least.append(b.take(f.type.itemsize))
            most.append(b.take(f.type.itemsize))
            sums.append(sum_of(b.take(16), f.type.kind == "f"))
            squares.append(sum_of(b.take(f.square), f.type.kind == "f"))
        present = [b.get("Q") if f.masked else cells for _ in range(f.channels)]
        check(all(n <= cells for n in present), "more samples than cells")
        extremes = (np.frombuffer(b"".join(e), f.type) for e in (least, most))
        statistics = Statistics(cells, next(extremes), next(extremes), sums, squares, present)
        return Entry(raw, Code.of(code, f.axes), start, size, slots, classes, codec, crc, statistics)

    def page(self, number: int, place: PageLocation) -> tuple[list[tuple[int, Entry]], list[Entry]]:
        """Returns a page of the segment index: copies with their numbers, and its own entries."""
        if number not in self.pages:
            b = Bytes(self.paged(place))
            copies, own = b.get("HH4x")
            check(copies <= 31 and own == min(128, self.segments - 128 * number), "entries of a page")
            copied = [b.get("Q") for _ in range(copies)]
            check(all(a < e for a, e in zip(copied, [*copied[1:], 128 * number])), "numbers of copies")
            if self.is_index:
                b = Bytes(self.unpack_entries(b, copies + own))
            check(len(b.data) - b.at == (copies + own) * self.entry_size, "bytes of a page")
            entries = [self.entry(b.take(self.entry_size)) for _ in range(copies + own)]
            check(entries[copies].node.code == place[0], "the index has another code")
            self.pages[number] = list(zip(copied, entries)), entries[copies:]
        return self.pages[number]

    def unpack_entries(self, packed: Bytes, count: int) -> bytes:
        """Returns the entries of a packed page."""
        f = self.form
        channel = [f.type.itemsize, f.type.itemsize, *[8] * (2 + f.square // 8)]
        widths = [8, 8, 8, 4, 2, 2, 4, 8, *channel * f.channels, *[8] * (f.channels if f.masked else 0)]
        columns = [numbers(packed, [0] * count) for _ in widths]
        check(packed.at == len(packed.data), "bytes after packed entries")
        columns[0] = [signed(code) for code in accumulate(columns[0])]
        fields = [[(n & (1 << 64) - 1).to_bytes(8, "little")[:width] for n in column] for width, column in zip(widths, columns)]
        return b"".join(b"".join(entry) for entry in zip(*fields))

    def index(self) -> Iterator[tuple[int, PageLocation]]:
        """Yields all pages of the segment index, by the index over them."""
        locations: list[PageLocation] = list(struct.iter_unpack("<QQII", self.top))
        for count in reversed(self.levels[:-1]):
            below: list[PageLocation] = []
            for location in locations:
                rows = list(struct.iter_unpack("<QQII", self.paged(location)))
                check(rows[0][0] == location[0], "the index has another code")
                below += rows
            check(len(below) == count, "the index has another number of pages")
            locations = below
        yield from enumerate(locations)

    @cached_property
    def entries(self) -> list[Entry]:
        """Returns all entries of the segment index, by ascending code."""
        return [entry for number, place in self.index() for entry in self.page(number, place)[1]]

    def find(self, node: Code) -> Entry:
        """Returns the deepest segment of a node or its ancestors (section 12)."""
        code, rows, number = node.code, list(struct.iter_unpack("<QQII", self.top)), 0
        for level in range(len(self.levels) - 1, -1, -1):
            last = sum(row[0] <= code for row in rows) - 1
            check(last >= 0, "no page has the code")
            number = number * 256 + last
            place: PageLocation = rows[last]
            if level:
                rows = list(struct.iter_unpack("<QQII", self.paged(place)))
        copies, own = self.page(number, place)
        for entry in reversed([entry for _, entry in copies] + own):
            if entry.node.level <= node.level and node.up(node.level - entry.node.level) == entry.node:
                return entry
        raise CorruptFile("no segment contains a node")

    def segment(self, entry: Entry) -> bytes:
        """Returns the bytes of a segment, checked and unpacked."""
        if entry.codec > REFERENCE:
            raise Unknown("the codec of a segment")
        check(entry.codec <= self.form.codec, "a packed segment among plain ones")
        if self.is_reference(entry):
            if self.referenced is None:
                raise Unknown("cells in other files")
            if entry.start not in self.unpacked:
                self.unpacked[entry.start] = self.referenced(entry, self.reference(entry))
            return self.unpacked[entry.start]
        f, counts = self.form, 0 if entry.classes == NO_COUNTS else entry.classes
        size = entry.slots * f.record + counts * (f.width + 8)
        check(entry.slots and (entry.codec or entry.size == size), "bytes of a segment")
        data = self.stored(entry)
        if not entry.codec:
            return data
        if entry.start not in self.unpacked:
            self.unpacked[entry.start] = unpack(f, f.depth - entry.node.level, data, size)
        return self.unpacked[entry.start]

    def stored(self, entry: Entry) -> bytes:
        check(entry.start + entry.size <= self.directory, "a segment is out of bounds")
        data = self.run[entry.start : entry.start + entry.size]
        check(crc32c(data) == entry.crc, "checksum of a segment")
        return data

    def is_reference(self, entry: Entry) -> bool:
        is_block = self.is_index and entry.node.level == max(self.form.depth - self.form.reach, 0)
        check((entry.codec == REFERENCE) == is_block, "a reference that is no block, or a block that is none")
        return is_block

    def reference(self, entry: Entry) -> Reference:
        """Returns a segment that is a reference (section 59)."""
        b, left = Bytes(self.stored(entry)), entry.statistics.cells
        count = 0 if entry.classes == NO_COUNTS else entry.classes
        numbers = 2 * self.form.stride - 1
        check(entry.size <= 4 + count * (self.form.width + 9) + 9 * numbers, "a reference is too long")
        found = Reference(b.get("I"), [], [])
        for number in range(count):
            value = b.take(self.form.width)
            cells = b.leb(9) if number + 1 < count else left
            left -= cells
            found.counts.append((value, cells))
        found.nodes += [b.leb(9) for _ in range(numbers)]
        check(b.at == len(b.data) and left >= 0, "numbers of a reference")
        return found

    def records(self, entry: Entry) -> RunRecords:
        code = entry.node.code
        if code not in self.runs:
            self.runs[code] = RunRecords(self.form, self.segment(entry)[: entry.slots * self.form.record], entry.node)
        return self.runs[code]

    def counts(self, entry: Entry) -> list[tuple[bytes, int]] | None:
        """Returns the class counts of a segment: value and cells; None if there are too many."""
        if entry.classes == NO_COUNTS or not self.form.classes:
            return None
        if self.is_reference(entry):
            return self.reference(entry).counts
        b = Bytes(self.segment(entry), entry.slots * self.form.record)
        return [(b.take(self.form.width), b.get("Q")) for _ in range(entry.classes)]

    def first(self) -> RunRecords:
        return self.records(self.find(Code(0, (0,) * self.form.axes)))

    def deeper(self, run: RunRecords, node: Code) -> RunRecords:
        entry = self.find(node)
        check(entry.node.level > run.node.level, "no deeper segment at a CUT")
        return self.records(entry)

    def value(self, node: Code) -> bytes | None:
        if self.root_state != INNER or node.level == 0:
            return self.root_value if self.root_state else None
        run = self.records(self.find(node.up(1)))
        state, value = run.find_node(node.path[run.node.level :])
        return value if state else None


class Goblin:
    """A Goblin file of trees of cells."""

    def __init__(self, data: bytes) -> None:
        self.data, self.header = data, Header.read(data)
        self.sections = trailer(data, self.header)
        if self.header.content:
            raise Unknown("an exact model")
        count, table = self.header.layers, self.sections.get(b"LAYR", b"")
        check(1 <= count <= 65536 and len(table) >= 152 * count, "the table of layers")
        self.layers = [Layer(data, self.header, table[152 * i : 152 * (i + 1)]) for i in range(count)]
        names = Bytes(table, 152 * count)
        for layer in self.layers:
            try:
                layer.name = names.take(layer.name_size).decode()
            except UnicodeDecodeError:
                raise CorruptFile("a name is not UTF-8") from None
        check(names.at == len(table), "bytes after the names")
        check_names([layer.name for layer in self.layers])
