"""Reader of trees of lines (sections 45 and 46 of formats.md), written only from that page.

    python tests/foreign/lines.py FILE
"""

from __future__ import annotations

import math
import struct
import sys
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Iterator, NamedTuple, Sequence

from basics import Bytes, Code, CorruptFile, Header, Unknown, check, crc32c, metadata, spans, trailer
from tokens import folded, signed, unfolded

# Maximum depth, by the number of axes.
DEEPEST = {2: 29, 3: 19}
# Maximum number of features in a block.
MAX_FEATURES = 1 << 12
# Kinds of values, by their mark.
NONE, WHOLE, NUMBER, TEXT, FALSE, TRUE, JSON = range(7)
# Marks that an attribute's values can have, by its kind.
KINDS = [{WHOLE}, {WHOLE, NUMBER}, {TEXT}, {FALSE, TRUE}, {JSON}, {WHOLE, NUMBER, TEXT, FALSE, TRUE, JSON}]

Vertex = tuple[int, ...]
# Minimum and maximum corner, each with x, y and z.
Box = tuple[Vertex, Vertex]


class Json(str):
    """JSON, as opposed to a string."""


@dataclass
class Attribute:
    """An attribute of features."""

    name: str
    kind: int


@dataclass
class Feature:
    """A feature: its lines, and the values of its attributes."""

    lines: list[list[Vertex]]
    values: list[Any]


class Segment(NamedTuple):
    """A line segment: feature number, number of its first vertex, both vertices, and first
    level."""

    feature: int
    place: int
    start: Vertex
    end: Vertex
    first: int

    @property
    def box(self) -> Box:
        return around((raised(end), raised(end)) for end in (self.start, self.end))


@dataclass
class Block:
    """An entry of `LBLK` or `LFEA`."""

    key: int
    at: int
    size: int
    crc: int
    count: int
    box: Box | None


@dataclass
class Node:
    """An entry of `LNOD`, and the node's own blocks."""

    at: Code
    segments: int
    features: int
    length: float
    box: Box
    blocks: list[Block] = field(default_factory=list)


class Lines:
    """A tree of lines."""

    def __init__(self, data: bytes) -> None:
        self.header = Header.read(data)
        if self.header.content != 4:
            raise Unknown("no tree of lines")
        check(self.header.axes in DEEPEST and self.header.layers == 0, "axes or layers of a tree of lines")
        self.axes = self.header.axes
        self.data, self.sections = data, trailer(data, self.header)
        check(all(tag in self.sections for tag in (b"LINS", b"LBLK", b"LNOD", b"LFEA", b"META")), "sections")
        check(len(self.sections[b"META"]) <= 1 << 24, "metadata are too large")
        self.meta = metadata(self.sections[b"META"])
        self._read_lines(Bytes(self.sections[b"LINS"]))
        self._read_nodes(Bytes(self.sections[b"LNOD"]))
        self._read_blocks(spans(data, self.header)[b"LBLK"][0])

    def _read_lines(self, b: Bytes) -> None:
        if b.unsigned() != 2:
            raise Unknown("lines of another version")
        self.features, self.segments, self.leaf_size = (b.unsigned() for _ in range(3))
        self.scale, self.offset = b.get("3d"), b.get("3d")
        self.corner = tuple(b.signed() for _ in range(3))
        self.bits, unit = b.get("B"), b.get("B")
        check(unit <= 1, "the unit of z")
        self.has_one_unit = bool(unit)
        self.attributes = b.many(lambda: Attribute(b.text(), b.get("B")))
        check(1 <= self.leaf_size <= 1 << 16 and self.bits <= 32, "leaf size or bits")
        check(all(-1 << 31 <= c < 1 << 31 for c in self.corner), "the corner")
        check(all(map(math.isfinite, (*self.scale, *self.offset))) and min(self.scale) > 0, "scale or offset")
        check(self.scale[0] == self.scale[1] and (self.scale[0] == self.scale[2] or not self.has_one_unit), "scales of axes")
        if any(attribute.kind >= len(KINDS) for attribute in self.attributes):
            raise Unknown("a kind of an attribute")
        check(self.header.depth == min(self.bits, DEEPEST[self.axes]), "the depth of the header")

    def _read_nodes(self, b: Bytes) -> None:
        check(len(b.data) % 56 == 0, "bytes of nodes")
        self.nodes: dict[Code, Node] = {}
        last = -1
        while b.at < len(b.data):
            code, segments, features, length, *box = b.get("QQQd6i")
            at = Code.of(code, self.axes)
            check(code > last and at.level <= self.header.depth, "nodes")
            check(not at.level or at.up(1) in self.nodes, "a node without the one above it")
            check(1 <= features <= segments and features <= self.features and 0 <= length < math.inf, "counts of a node")
            self.nodes[at] = Node(at, segments, features, length, box_of(box))
            last = code
        root = self.nodes.get(Code(0, (0,) * self.axes))
        check((root.segments if root else 0) == self.segments, "segments of the root")

    def _read_blocks(self, end: int) -> None:
        blocks = self._blocks(self.sections[b"LBLK"], end, 1 << 16)
        for key, block in blocks:
            node = self.nodes.get(Code.of(key, self.axes))
            check(node, "a block of no node")
            if node:
                node.blocks.append(block)
        check(all(a <= e for (a, _), (e, _) in pairwise(blocks)), "the order of blocks")
        below = {node.at: sum(block.count for block in node.blocks) for node in self.nodes.values()}
        for node in reversed(self.nodes.values()):
            check(below[node.at] == node.segments, "segments of a node and those below")
            if node.at.level:
                below[node.at.up(1)] += node.segments
        of_features = self._blocks(self.sections[b"LFEA"], end, MAX_FEATURES)
        self.of_features = [block for _, block in of_features]
        firsts = [0, *accumulate(block.count for block in self.of_features)]
        check([*(key for key, _ in of_features), self.features] == firsts, "blocks of features")
        whole = sum(block.size for _, block in blocks + of_features)
        check(whole <= end - 24, "blocks have more bytes than there are")

    def _blocks(self, data: bytes, end: int, most: int) -> list[tuple[int, Block]]:
        check(len(data) % 52 == 0, "bytes of blocks")
        found = []
        for key, at, size, crc, count, *box in struct.iter_unpack("<QQIII6i", data):
            check(24 <= at and at + size <= end, "a block is out of bounds")
            check(1 <= count <= most, "how much a block has")
            # Entries of features have zeros, which readers ignore.
            found.append((key, Block(key, at, size, crc, count, box_of(box) if most > MAX_FEATURES else None)))
        return found

    def block(self, block: Block) -> Bytes:
        """Returns the bytes of a block."""
        data = self.data[block.at : block.at + block.size]
        check(crc32c(data) == block.crc, "checksum of a block")
        return Bytes(data)

    def world(self, vertex: Vertex) -> tuple[float, ...]:
        """Returns the world position of a vertex."""
        divisors = map(divisor, self.scale)
        numbers = zip(vertex, self.scale, self.offset, divisors)
        return tuple((x + offset * n) / n if n else x * scale + offset for x, scale, offset, n in numbers)

    def segments_of(self, block: Block) -> list[Segment]:
        """Returns the line segments of a block."""
        b = self.block(block)
        count = block.count
        features = list(accumulate(read_column(b, [0] * count)))
        same = [a == e for a, e in pairwise([0, *features])]
        more = read_column(b, [0] * count)
        positions: list[int] = []
        for i in range(count):
            positions.append(more[i] + (positions[-1] if i and same[i] else 0))
        contexts = [int(same[i] and more[i] == 1) for i in range(count)]
        starts = [read_column(b, contexts) for _ in range(self.axes)]
        ends = [read_column(b, [0] * count) for _ in range(self.axes)]
        firsts = read_column(b, [0] * count)
        check(b.at == len(b.data), "something is left of a block")
        found: list[Segment] = []
        end: Vertex = (0,) * self.axes
        for i in range(count):
            start = tuple(x + column[i] for x, column in zip(end, starts))
            end = tuple(x + column[i] for x, column in zip(start, ends))
            found.append(Segment(features[i], positions[i], start, end, firsts[i]))
        check(all(self.inside(p) for segment in found for p in (segment.start, segment.end)), "a vertex is not inside")
        check(all(0 <= f < self.features for f in features) and min(positions) >= 0, "features of segments")
        check(found == sorted(found, key=lambda segment: segment[:2]), "the order of segments")
        check(around(segment.box for segment in found) == block.box, "extremes of a block")
        return found

    def inside(self, vertex: Vertex) -> bool:
        return all(0 <= x - corner < 1 << self.bits for x, corner in zip(vertex, self.corner))

    def features_of(self, block: Block) -> list[Feature]:
        """Returns the features of a block, in their order."""
        b = self.block(block)
        lines = read_column(b, [0] * block.count)
        check(min(lines) >= 0 and sum(lines) <= 1 << 23, "lines of features")
        sizes = read_column(b, [0] * sum(lines))
        check(min(sizes, default=2) >= 2 and sum(sizes) <= 1 << 24, "vertices of lines")
        contexts = [int(i == 0) for size in sizes for i in range(size)]
        vertices = list(zip(*[accumulate(read_column(b, contexts)) for _ in range(self.axes)]))
        check(all(map(self.inside, vertices)), "a vertex is not inside")
        at = iter(vertices)
        rows = iter([[next(at) for _ in range(size)] for size in sizes])
        columns = [self._values(b, block.count, attribute) for attribute in self.attributes]
        check(b.at == len(b.data), "something is left of a block")
        return [Feature([next(rows) for _ in range(n)], list(values)) for n, *values in zip(lines, *columns)]

    def _values(self, b: Bytes, count: int, attribute: Attribute) -> list[Any]:
        """Returns the values of an attribute."""
        marks = read_column(b, [0] * count)
        check(set(marks) <= KINDS[attribute.kind] | {NONE}, "marks of values")
        wholes = iter(read_column(b, [0] * marks.count(WHOLE)))
        numbers = iter(read_column(b, [0] * marks.count(NUMBER)))
        of_strings = marks.count(TEXT) + marks.count(JSON)
        strings: Iterator[str] = iter(())
        if of_strings:
            (different,) = read_column(b, [0])
            check(1 <= different <= of_strings, "different strings")
            which = read_column(b, [0] * of_strings)
            check(all(0 <= i < different for i in which), "numbers of strings")
            sizes = read_column(b, [0] * different)
            check(min(sizes) >= 0 and sum(sizes) <= 1 << 24, "bytes of strings")
            letters = read_column(b, [0] * sum(sizes))
            check(all(0 <= letter < 256 for letter in letters), "bytes of strings")
            ends = list(accumulate(sizes))
            try:
                distinct_strings = [bytes(letters[end - size : end]).decode() for size, end in zip(sizes, ends)]
            except UnicodeDecodeError:
                raise CorruptFile("a text is not UTF-8") from None
            strings = iter([distinct_strings[i] for i in which])
        found: list[Any] = []
        for mark in marks:
            if mark == WHOLE:
                found.append(next(wholes))
            elif mark == NUMBER:
                found.append(struct.unpack("<d", struct.pack("<q", next(numbers)))[0])
            elif mark in (TEXT, JSON):
                text = next(strings)
                found.append(text if mark == TEXT else Json(text))
            else:
                found.append({NONE: None, FALSE: False, TRUE: True}[mark])
        return found

    def walk(self) -> Iterator[tuple[Node, list[Segment]]]:
        """Yields all nodes by code, with the line segments of each."""
        for node in self.nodes.values():
            yield node, [segment for block in node.blocks for segment in self.segments_of(block)]

    def each_feature(self) -> Iterator[Feature]:
        """Yields all features in their order."""
        for block in self.of_features:
            yield from self.features_of(block)

    # Verification.

    def code(self, segment: Segment) -> Code:
        """Returns the node of a line segment, before nodes are merged."""
        ends = [tuple(x - corner for x, corner in zip(end, self.corner)) for end in (segment.start, segment.end)]
        size = max(abs(x - u) for x, u in zip(*ends))
        level = next(l for l in range(self.header.depth, -1, -1) if 1 << self.bits - l >= size)
        return Code(level, tuple((x + u) // 2 >> self.bits - level for x, u in zip(*ends)))

    def verify(self) -> None:
        """Checks that line segments match the features, that nodes and blocks are as specified, and
        that the nodes' summaries are right."""
        of_nodes = {node.at: [self.segments_of(block) for block in node.blocks] for node in self.nodes.values()}
        made = [segment for i, feature in enumerate(self.each_feature()) for segment in self._segments(i, feature)]
        found = [segment for blocks in of_nodes.values() for segments in blocks for segment in segments]
        check(sorted(found) == sorted(made), "segments are not those of features")
        below: dict[Code, int] = {}
        for segment in made:
            own = self.code(segment)
            for level in range(own.level + 1):
                node = own.up(own.level - level)
                below[node] = below.get(node, 0) + 1
        taken = set()
        for at, blocks in of_nodes.items():
            for own in {self.code(segment) for segments in blocks for segment in segments}:
                above = (own.up(own.level - level) for level in range(own.level + 1))
                check(next((up for up in above if below[up] <= self.leaf_size), own) == at, "a segment is in another node")
            taken.add(at)
            self._verify_blocks(blocks)
        check(set(self.nodes) == taken and all(self.nodes[at].segments == below[at] for at in taken), "nodes")
        self._verify_nodes(of_nodes)

    def _segments(self, number: int, feature: Feature) -> list[Segment]:
        """Returns the line segments of a feature, with their first levels."""
        found, place = [], 0
        for line in feature.lines:
            found += [Segment(number, place + i, a, e, 0) for i, (a, e) in enumerate(pairwise(line))]
            place += len(line)
        found.sort(key=lambda segment: (self.code(segment).code, segment.place))
        for i in range(len(found) - 1, 0, -1):
            own, before = self.code(found[i]), self.code(found[i - 1])
            least = min(own.level, before.level)
            common = next(l for l in range(least, -1, -1) if own.up(own.level - l) == before.up(before.level - l))
            found[i] = found[i]._replace(first=common + 1)
        return found

    def _verify_blocks(self, blocks: list[list[Segment]]) -> None:
        """Checks that a node's line segments are split into blocks in the order of codes, features
        and vertex numbers."""
        check(all(len(segments) == self.leaf_size for segments in blocks[:-1]), "segments of blocks")
        check(all(len(segments) <= self.leaf_size for segments in blocks[-1:]), "segments of the last block")
        keys = [sorted((self.code(segment).code, *segment[:2]) for segment in segments) for segments in blocks]
        check(all(a[-1] < e[0] for a, e in pairwise(keys)), "the order of blocks")

    def _verify_nodes(self, of_nodes: dict[Code, list[list[Segment]]]) -> None:
        """Checks that lengths, extremes and feature numbers match the line segments of nodes and
        their descendants."""
        below: dict[Code, list[Node]] = {}
        segments_below: dict[Code, list[Segment]] = {}
        for at, blocks in reversed(of_nodes.items()):
            node, kids = self.nodes[at], below.get(at, [])[::-1]
            segments = segments_below.setdefault(at, []) + [segment for of in blocks for segment in of]
            check(node.features == len({segment.feature for segment in segments}), "features of a node")
            check(node.features == sum(segment.first <= at.level for segment in segments), "first levels")
            check(around(segment.box for segment in segments) == node.box, "extremes of a node")
            own = added([added([self.length(segment) for segment in of]) for of in blocks])
            check(node.length == own + added([kid.length for kid in kids]), "the length of a node")
            if at.level:
                below.setdefault(at.up(1), []).append(node)
                segments_below.setdefault(at.up(1), []).extend(segments)

    def length(self, segment: Segment) -> float:
        """Returns the length of a line segment in world units."""
        x, y, z = [float(a - e) for a, e in zip(raised(segment.start), raised(segment.end))]
        z = z if self.has_one_unit else 0.0
        steps = math.sqrt(x * x + y * y + z * z)
        n = divisor(self.scale[0])
        return steps / n if n else steps * self.scale[0]


def divisor(scale: float) -> float | None:
    """Returns the integer of which a scale is the reciprocal."""
    n = round(1 / scale)
    return float(n) if n and 1 / n == scale else None


def raised(vertex: Vertex) -> Vertex:
    """Returns a vertex with a z of 0 if it has none."""
    return (*vertex, 0)[:3]


def box_of(numbers: Sequence[int]) -> Box:
    low, high = tuple(numbers[:3]), tuple(numbers[3:])
    check(all(a <= e for a, e in zip(low, high)), "extremes")
    return low, high


def around(boxes: Iterator[Box]) -> Box:
    """Returns the bounding box of all boxes."""
    low, high = zip(*boxes)
    return tuple(map(min, zip(*low))), tuple(map(max, zip(*high)))


def added(numbers: list[float]) -> float:
    """Returns the sum of `f64` numbers, in this order."""
    total = 0.0
    for number in numbers:
        total += number
    return total


def read_column(b: Bytes, contexts: Sequence[int]) -> list[int]:
    """Returns the numbers of a column, one per context."""
    if not contexts:
        return []
    way = b.get("B")
    check(way < 4, "a way that is none")
    numbers = [unfolded(n) for n in folded(b, contexts)] if way & 1 == 0 else [unfolded(b.leb(10)) for _ in contexts]
    check(all(-1 << 63 <= n < 1 << 63 for n in numbers), "a number has more than 64 bits")
    return [signed(n) for n in accumulate(numbers)] if way & 2 else numbers


if __name__ == "__main__":
    tree = Lines(Path(sys.argv[1]).read_bytes())
    print(*(attribute.name for attribute in tree.attributes), "wkt", sep="\t")
    for feature in tree.each_feature():
        lines = ", ".join("(" + ", ".join(" ".join(map(repr, tree.world(vertex))) for vertex in line) + ")" for line in feature.lines)
        print(*feature.values, f"MULTILINESTRING {'Z ' if tree.axes == 3 else ''}({lines})", sep="\t")
