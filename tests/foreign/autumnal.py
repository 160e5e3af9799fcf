"""Reader of Autumnal files, written from sections 18 to 26 and 41 of formats.md; see reader.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from basics import Bytes, Code, Header, Unknown, check, check_names, crc32c, metadata
from coder import turned
from packed import unpack_runs
from rules import Pyramid, same
from trees import INNER, VOID, RunRecords, Statistics, Tree, TreeHeader, sum_of
from verify import Writer, verify_tree

MAGIC = b"\x93Autumn\n"
RECORDS, COMMIT, METADATA, PACKED = range(4)
FIRST = 12288


def heights(form: TreeHeader, levels: int) -> list[int]:
    """Heights of the nodes with records, ascending, for runs of `levels` levels."""
    return [*range(levels, form.depth, 2), form.depth]


def pointed(form: TreeHeader, levels: int, height: int) -> int:
    """Levels from a node to the nodes its record points to; 0 if it has no pointers."""
    check(height in heights(form, levels), "a node of this height has no record")
    return height - max(h for h in heights(form, levels) if h < height) if height > levels else 0


def zoned(form: TreeHeader, levels: int, height: int) -> bool:
    """Whether a node's record has a zone."""
    return height > levels and (height >= (7 if form.axes == 2 else 5) or height == form.depth)


@dataclass
class Record:
    """A record with pointers: its address, its run, the records it points to by node number, and
    its zone."""

    at: int
    node: Code
    value: bytes
    run: RunRecords
    below: int
    pointers: dict[int, int]
    zone: tuple[int, Statistics, list[tuple[bytes, int]] | None] | None


class LayerOfCommit(Tree):
    """A layer at a commit."""

    def __init__(self, file: "Autumn", commit: int, b: Bytes) -> None:
        self.file, self.commit = file, commit
        self.name = b.text()
        self.cells, self.inner = b.unsigned(), b.unsigned()
        header = b.blob()
        check(len(header) == 48, "a tree's header has another size")
        self.form = form = TreeHeader(header, file.header)
        check(not form.codec, "packed segments, where there are none")
        self.root_state, self.root_value, self.root = b.get("B"), b.blob(), b.unsigned()
        check(self.root_state <= INNER and len(self.root_value) == (form.width if self.root_state else 0), "the root")
        self.root_value = self.root_value or bytes(form.width)
        check(self.root_state < INNER or form.depth and self.root < commit, "the root's record")
        self.meta_at = b.unsigned()
        check(self.meta_at < commit, "the metadata follow the commit")
        self.cache: dict[tuple[int, Code], Record] = {}
        self.of_run: dict[int, Record] = {}

    @property
    def meta(self) -> dict[str, Any]:  # type: ignore[override]
        kind, data = self.file.extent(self.meta_at)
        check(kind == METADATA, "an extent of another kind")
        return metadata(data)

    def record(self, at: int, node: Code) -> Record:
        if (at, node) not in self.cache:
            self.cache[at, node] = record = self._record(at, node)
            self.of_run[id(record.run)] = record
        return self.cache[at, node]

    def _record(self, at: int, node: Code) -> Record:
        f, levels, height = self.form, self.file.levels, self.form.depth - node.level
        below, pointers = pointed(f, levels, height), {}
        b, alone = self.file.around(at, f, height)
        value = b.take(f.width)
        if below:
            size, count = b.get("B"), f.children**below
            check(1 <= size <= 8, "bytes of a pointer")
            bits = int.from_bytes(b.take(-(-count // 8)), "little")
            check(bits < 1 << count, "bits of nodes that there are not")
            for i in range(count):
                if bits >> i & 1:
                    pointers[i] = at - int.from_bytes(b.take(size), "little")
                    check(FIRST <= pointers[i] < at, "a pointer that leads nowhere")
        # The skip of the first record, in its last bytes, gives the run's length.
        end = b.at + f.record
        check(end <= len(b.data), "a record ends too early")
        skip = int.from_bytes(b.data[end - f.axes - 1 : end], "little") & (1 << f.skips) - 1
        check(1 <= skip <= (f.children ** min(height, levels) - 1) // (f.children - 1), "slots of a run")
        run = RunRecords(f, b.take(skip * f.record), node)
        zone = self._zone(b) if zoned(f, levels, height) else None
        check(not alone or b.at == len(b.data), "a record ends too late")
        return Record(at, node, value, run, below, pointers, zone)

    def _zone(self, b: Bytes) -> tuple[int, Statistics, list[tuple[bytes, int]] | None]:
        f, floating = self.form, self.form.type.kind == "f"
        records, cells = b.leb(), b.leb()
        present = [b.leb() if f.masked else cells for _ in range(f.channels)]
        least, most = (np.frombuffer(b.take(f.width), f.type) for _ in range(2))

        def square() -> Any:
            if f.square == 16:
                return sum_(floating)
            parts = [b.leb() for _ in range(3)]
            check(max(parts) < 1 << 64, "a sum is too large")
            return sum_of(b"".join(part.to_bytes(8, "little") for part in parts), floating)

        def sum_(double: bool) -> Any:
            number = b.leb()
            check(number < 1 << 128, "a sum is too large")
            number = -(number >> 1) - 1 if number & 1 else number >> 1
            return Bytes(number.to_bytes(16, "little", signed=True)).get("2d") if double else number

        sums = [sum_(floating) for _ in range(f.channels)]
        squares = [square() for _ in range(f.channels)]
        counts: list[tuple[bytes, int]] | None = [] if f.classes else None
        if counts is not None:
            classes = b.leb()
            if classes == 0xFFFFFFFF:
                counts = None
            else:
                check(classes <= 1024, "too many classes")
                counts = [(b.take(f.width), b.leb()) for _ in range(classes)]
        return records, Statistics(cells, least, most, sums, squares, present), counts

    def first(self) -> RunRecords:
        return self.record(self.root, Code(0, (0,) * self.form.axes)).run

    def next(self, record: Record, node: Code) -> Record | None:
        """Returns the record that a pointer leads to on the path to a node; None without a
        pointer."""
        to = node.up(node.level - record.node.level - record.below)
        number = 0
        for child in to.path[record.node.level :]:
            number = number * self.form.children + child
        return self.record(record.pointers[number], to) if number in record.pointers else None

    def deeper(self, run: RunRecords, node: Code) -> RunRecords:
        record = self.of_run[id(run)]
        below = self.next(record, node) if record.pointers else None
        check(below, "something INNER where there is no pointer")
        assert below is not None
        return below.run

    def value(self, node: Code) -> bytes | None:
        if self.root_state != INNER or node.level == 0:
            return self.root_value if self.root_state else None
        record = self.record(self.root, Code(0, (0,) * self.form.axes))
        while node.level - record.node.level > self.file.levels:
            below = self.next(record, node)
            if below is None:
                break
            record = below
        state, value = record.run.find_node(node.path[record.node.level :])
        return None if state == VOID else value

    def verify(self) -> Pyramid:
        """Checks all records, values and zones, and what follows from the cells; raises
        `CorruptFile`."""
        pyramid = verify_tree(self)
        root = pyramid.levels[0]
        check((self.cells, self.inner) == (int(root.cells.flat[0]), int(root.nodes.flat[0])), "cells or nodes of the layer")
        check(self.meta["counts"] == [], "counts of nodes that no node has")
        todo = [self.record(self.root, Code(0, (0,) * self.form.axes))] if self.root_state == INNER else []
        while todo:
            record = todo.pop()
            node, level = record.node, pyramid.levels[record.node.level]
            check(record.value == level.values[node.at[::-1]].tobytes(), "the representative of a record")
            check(record.run.data == Writer(self.form, pyramid).run(node, self.file.levels), "a run is written in another way")
            if record.below:
                to = Code(node.level + record.below, tuple(v << record.below for v in node.at))
                inner = [
                    Code(to.level, tuple(a + int(d) for a, d in zip(to.at, step[::-1])))
                    for step in np.ndindex((1 << record.below,) * self.form.axes)
                ]
                inner = [n for n in inner if pyramid.levels[to.level].states[n.at[::-1]] == INNER]
                found = [self.next(record, n) for n in inner]
                check(None not in found and len(found) == len(record.pointers), "pointers to other nodes")
                todo += [r for r in found if r]
            if record.zone:
                records, statistics, counts = record.zone
                check(records == level.nodes[node.at[::-1]], "INNER nodes of a zone")
                check(same(statistics, pyramid.statistics(node)), "statistics of a zone")
                expected = pyramid.classes_of(node) if self.form.classes else []
                check((counts or []) == (expected if len(expected) <= 1024 else []), "class counts of a zone")
        return pyramid


class Packed:
    """A packed extent (section 41), unpacked to records of section 21. Addresses count its
    records."""

    def __init__(self, file: "Autumn", start: int, data: bytes) -> None:
        self.first, self.levels = start + 32, file.levels
        b = Bytes(data)
        size, count, codec = b.get("IHBx")
        check(size <= 1 << 20 and 1 <= count <= 480, "numbers of a packed extent")
        if codec > 1:
            raise Unknown("the codec of a packed extent")
        self.form = form = TreeHeader(b.take(48), file.header)
        # Plain records do not store heights.
        self.heights: list[int | None] = [None] * count
        if codec:
            check(size <= 65536 + 4096 * (len(data) - 56), "bytes of records")
            runs, side_bytes = unpack_runs(form, file.levels, count, data[56:], 2 * size)
            around = Bytes(side_bytes)
            self.heights = [height for height, _, _ in runs]
            self.records = [value + b"".join(self._side_bytes(i, height, around, run)) for i, (height, value, run) in enumerate(runs)]
            check(around.at == len(side_bytes), "bytes are left over after the last run")
            check(sum(map(len, self.records)) == size, "bytes of records")
        else:
            starts = [*(b.get("I") for _ in range(count)), len(data) - 56]
            check(starts[0] == 4 * count and len(data) == 56 + 4 * count + size, "bytes of records")
            check(all(a < e for a, e in zip(starts, starts[1:])), "where records start")
            self.records = [data[56 + a : 56 + e] for a, e in zip(starts, starts[1:])]

    def _side_bytes(self, number: int, height: int, b: Bytes, run: bytes) -> list[bytes]:
        """Returns what follows the representative of a record."""
        f, below, at = self.form, pointed(self.form, self.levels, height), self.first + number
        found = []
        if below:
            bits = b.take(-(-(f.children**below) // 8))
            back, expected = [], at
            for _ in range(int.from_bytes(bits, "little").bit_count()):
                to = expected + turned(b.leb(10))
                check(FIRST <= to < at, "a pointer that leads nowhere")
                back.append(at - to)
                expected = to + 1
            size = max(1, -(-max(back, default=0).bit_length() // 8))
            found += [bytes([size]), bits, *(n.to_bytes(size, "little") for n in back)]
        found.append(run)
        if zoned(f, self.levels, height):
            found.append(b.take(b.leb(5)))
        return found

    def record(self, number: int, form: TreeHeader, height: int) -> bytes:
        """Returns the bytes of a node's record."""
        check(number in range(len(self.records)), "a record outside any extent")
        check(form.raw == self.form.raw and self.heights[number] in (None, height), "a record of another node")
        return self.records[number]


@dataclass
class Commit:
    """One state of all layers."""

    at: int
    number: int
    time: int | None
    author: str
    message: str
    cells: int
    inner: int
    written: tuple[int, ...]
    sequence: int
    layers: list[LayerOfCommit]
    previous: int
    older: tuple[int, int]


class Autumn:
    """An Autumnal file."""

    def __init__(self, data: bytes) -> None:
        check(len(data) >= FIRST, "a file without its pages")
        self.data, self.header = data, Header.read(data, MAGIC)
        if self.header.content:
            raise Unknown("an exact model")
        check(self.header.layers == 0, "layers in the header")
        check(crc32c(data[64:68]) == int.from_bytes(data[68:72], "little"), "checksum of the header page")
        self.shared, self.levels, self.packs = data[64] == 1, data[65], data[66] == 1
        check(data[64] < 2 and data[66] < 2 and self.levels in (range(2, 6) if self.header.axes == 2 else (2, 3)), "numbers of the header page")
        slots = [s for s in (self._slot(i) for i in range(2)) if s]
        check(slots, "no slot is whole")
        self.cache: dict[int, tuple[int, bytes]] = {}
        self.unpacked: dict[int, Packed] = {}
        self.sequence, self.newest, self.end = max(slots)
        check(self.end <= len(data), "the file ends before its newest commit")
        side_bytes = data[4096 * (1 + self.sequence % 2) :][:40]
        self.slots_are_whole = len(slots) == 2 or self.sequence == 1 and not any(side_bytes)
        if not self.slots_are_whole:
            self._find_newest()
        self.commits: list[Commit] = []
        at = self.newest
        while at:
            self.commits.insert(0, self._commit(at))
            at = self.commits[0].previous
        check(self.commits[-1].sequence == self.sequence, "the newest commit has another sequence")
        self._check_commits()

    def _slot(self, which: int) -> tuple[int, int, int] | None:
        b = Bytes(self.data[4096 * (which + 1) :][:40])
        magic, sequence, commit, end, _, crc = b.get("8sQQQII")
        whole = magic == b"AutuMeta" and crc == crc32c(b.data[:36]) and sequence and sequence % 2 == 1 - which
        return (sequence, commit, end) if whole and FIRST <= commit < end else None

    def _find_newest(self) -> None:
        """Finds the newest commit if its slot is corrupt: it follows the known one."""
        known = self.newest, self.sequence, self.end
        at, self.end = -(-self.end // 4096) * 4096, len(self.data)
        while head := self.head(at):
            end = -(-(at + 32 + head[1]) // 512) * 512
            if head[0] == COMMIT:
                commit = self._commit(at)
                if (commit.previous, commit.sequence) == (self.newest, self.sequence + 1):
                    self.newest, self.sequence, self.end = at, commit.sequence, end
                    return
                break
            if head[0] in (RECORDS, PACKED):
                self.extent(at)
            at = end
        self.newest, self.sequence, self.end = known

    def head(self, at: int) -> tuple[int, int] | None:
        """Returns kind and length of an extent, if its head is complete."""
        b = Bytes(self.data[at : at + 32])
        if at + 32 > self.end or b.take(4) != b"Extt":
            return None
        kind, own, length, _, crc = b.get("B3xQQII")
        whole = crc == crc32c(b.data[:28]) and own == at and length <= self.end - at - 32
        return (kind, length) if whole else None

    def extent(self, at: int) -> tuple[int, bytes]:
        """Returns kind and bytes of an extent, checked."""
        if at not in self.cache:
            head = self.head(at) if at >= FIRST and at % 512 == 0 else None
            check(head, "no extent where one must be")
            kind, length = head  # type: ignore[misc]
            data = self.data[at + 32 : at + 32 + length]
            check(length <= 1 << 24 and crc32c(data) == int.from_bytes(self.data[at + 24 : at + 28], "little"), "an extent")
            self.cache[at] = kind, data
        return self.cache[at]

    def around(self, at: int, form: TreeHeader, height: int) -> tuple[Bytes, bool]:
        """Returns the bytes that begin with a node's record, and whether they are only this
        record."""
        start = at // 512 * 512
        while start >= FIRST and not self.head(start):
            start -= 512
        check(start >= FIRST, "a record outside any extent")
        kind, data = self.extent(start)
        if kind == PACKED:
            if start not in self.unpacked:
                check(self.packs, "packed records, where there are none")
                self.unpacked[start] = Packed(self, start, data)
            return Bytes(self.unpacked[start].record(at - start - 32, form, height)), True
        check(kind == RECORDS and 0 <= at - start - 32 < len(data), "a record outside any extent")
        return Bytes(data, at - start - 32), False

    def _commit(self, at: int) -> Commit:
        kind, data = self.extent(at)
        check(kind == COMMIT, "a commit is none")
        b = Bytes(data)
        if b.unsigned() != 1:
            raise Unknown("a commit of another version")
        number, time, author, message = b.unsigned(), b.option(b.signed), b.text(), b.text()
        cells, inner, written = b.unsigned(), b.unsigned(), tuple(b.unsigned() for _ in range(4))
        sequence, layers = b.unsigned(), b.many(lambda: LayerOfCommit(self, at, b))
        previous, older = b.unsigned(), (b.unsigned(), b.unsigned())
        found = Commit(at, number, time, author, message, cells, inner, written, sequence, layers, previous, older)
        check(found.previous < at and found.older[1] < at, "an earlier commit is at a later offset")
        check(layers, "a commit without layers")
        check_names([layer.name for layer in layers])
        return found

    def _check_commits(self) -> None:
        older: dict[int, int] = {}
        for i, commit in enumerate(self.commits):
            check(commit.sequence == i + 1 and commit.at % 512 == 0, "sequences of commits")
            check(i == 0 or commit.number > self.commits[i - 1].number, "numbers of commits")
            # The older commit of the next one: c, or the older commit of c, if both distances are
            # equal.
            c = i
            far = older.get(c, 0)
            older[i + 1] = older[far] if far and older[far] and c - far == far - older[far] else c
            check(commit.older == (older[i + 1], self.commits[older[i + 1] - 1].at if older[i + 1] else 0), "the older commit")

    def verify(self) -> None:
        """Raises `CorruptFile` unless the whole file is valid."""
        check(self.slots_are_whole, "a meta slot is corrupt")
        for commit in self.commits:
            for layer in commit.layers:
                layer.verify()
            cells, inner = (sum(getattr(layer, part) for layer in commit.layers) for part in ("cells", "inner"))
            check((commit.cells, commit.inner) == (cells, inner), "cells or nodes of a commit")
