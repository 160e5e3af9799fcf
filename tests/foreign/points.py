"""Reader of trees of points (sections 43 to 45 of formats.md), written only from that page.

    python tests/foreign/points.py FILE
"""

from __future__ import annotations

import math
import struct
import sys
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Iterable, Iterator, Sequence

from basics import Bytes, Code, CorruptFile, Header, Unknown, check, crc32c, metadata, spans, trailer
from tokens import numbers, signed

# Sample types by number, in `struct` notation.
SAMPLES = "BHhIifdbQq"
# Levels of a node's subdivisions that each have at most one point, and the maximum code level; by
# axes.
PARTS, DEEPEST = {2: 8, 3: 7}, {2: 29, 3: 19}
NOTHING = (1 << 63) - 1, -1 << 63

Number = int | float
# Grid units along x, y and z, then the values of attributes.
Point = tuple[Number, ...]


def ordered(value: Number, sample: str) -> int:
    """Returns the ordered number of a value."""
    if sample == "Q":
        return int(value) - (1 << 63)
    if sample not in "fd":
        return int(value)
    size = struct.calcsize(sample)
    bits = int.from_bytes(struct.pack("<" + sample, value), "little", signed=True)
    return bits ^ (1 << 8 * size - 1) - 1 if bits < 0 else bits


def value_of(number: int, sample: str) -> Number:
    """Returns the value of an ordered number."""
    try:
        if sample == "Q":
            return number + (1 << 63)
        if sample not in "fd":
            struct.pack("<" + sample, number)
            return number
        size = struct.calcsize(sample)
        bits = number ^ (1 << 8 * size - 1) - 1 if number < 0 else number
        return float(struct.unpack("<" + sample, bits.to_bytes(size, "little", signed=True))[0])
    except (struct.error, OverflowError):
        raise CorruptFile("a number is not of its column's type") from None


@dataclass
class Column:
    """An attribute, or the grid units along an axis."""

    name: str
    sample: str
    scale: tuple[float, float] | None = None
    description: str = ""
    no_data: int | None = None

    def meant(self, stored: Number) -> Number:
        """Returns the meaning of a stored value."""
        return stored * self.scale[0] + self.scale[1] if self.scale else stored


@dataclass
class Statistics:
    """Statistics of a column: count of numbers, minimum and maximum as ordered numbers, and sum."""

    count: int
    least: int
    most: int
    sum: float


@dataclass
class Block:
    """An entry of `PBLK`."""

    node: Code
    at: int
    size: int
    crc: int
    points: int
    least: tuple[int, int, int]
    most: tuple[int, int, int]


@dataclass
class Node:
    """An entry of `PNOD`, and the node's own blocks."""

    at: Code
    points: int
    columns: list[Statistics]
    blocks: list[Block] = field(default_factory=list)


class Points:
    """A tree of points."""

    def __init__(self, data: bytes) -> None:
        self.header = Header.read(data)
        self.axes = self.header.axes
        if self.header.content != 3:
            raise Unknown("no tree of points")
        check(self.header.layers == 0, "layers of a tree of points")
        self.data, self.sections = data, trailer(data, self.header)
        check(all(tag in self.sections for tag in (b"PNTS", b"PBLK", b"PNOD", b"META")), "sections")
        check(len(self.sections[b"META"]) <= 1 << 24, "metadata are too large")
        self.meta = metadata(self.sections[b"META"])
        self._read_points(Bytes(self.sections[b"PNTS"]))
        self._read_nodes(Bytes(self.sections[b"PNOD"]))
        self._read_blocks(Bytes(self.sections[b"PBLK"]), spans(data, self.header)[b"PBLK"][0])

    def _read_points(self, b: Bytes) -> None:
        if b.unsigned() != 1:
            raise Unknown("points of another version")
        self.count, self.repeated, self.leaf_size = (b.unsigned() for _ in range(3))
        self.scale, self.offset = b.get("3d"), b.get("3d")
        self.corner = tuple(b.signed() for _ in range(3))
        self.bits = b.get("B")
        self.columns = [Column(axis, "i") for axis in "xyz"] + b.many(lambda: self._column(b))
        check(1 <= self.leaf_size <= 1 << 20 and self.bits <= 32, "leaf size or bits")
        check(all(-1 << 31 <= c < 1 << 31 for c in self.corner), "the corner")
        check(all(map(math.isfinite, self.scale + self.offset)) and min(self.scale) > 0, "scale or offset")
        self.deepest = min(self.bits, DEEPEST[self.axes])
        self.parts = PARTS[self.axes]
        check(self.header.depth == max(0, self.deepest - self.parts), "the depth of the header")

    def _column(self, b: Bytes) -> Column:
        name, sample = b.text(), b.get("B")
        if sample >= len(SAMPLES):
            raise Unknown("a type of an attribute")
        return Column(name, SAMPLES[sample], b.option(lambda: b.get("2d")), b.text(), b.option(b.signed))

    def _read_nodes(self, b: Bytes) -> None:
        size = 16 + 32 * len(self.columns)
        check(len(b.data) % size == 0, "bytes of nodes")
        self.nodes: dict[Code, Node] = {}
        last = -1
        while b.at < len(b.data):
            code, points = b.get("QQ")
            at = Code.of(code, self.axes)
            check(code > last and at.level <= self.header.depth and points, "nodes")
            check(not at.level or at.up(1) in self.nodes, "a node without the one above it")
            columns = [Statistics(*b.get("Qqqd")) for _ in self.columns]
            for column in columns:
                check(column.count <= points, "more numbers than points")
                check(column.least <= column.most if column.count else (column.least, column.most) == NOTHING, "extremes")
            self.nodes[at] = Node(at, points, columns)
            last = code
        root = self.nodes.get(self.root)
        check((root.points if root else 0) == self.count, "points of the root")
        check(self.repeated <= max(self.count - 1, 0), "points at the place of another one")

    def _read_blocks(self, b: Bytes, end: int) -> None:
        check(len(b.data) % 52 == 0, "bytes of blocks")
        last, whole = -1, 0
        while b.at < len(b.data):
            code, at, size, crc, points, *box = b.get("QQIII6i")
            node = Code.of(code, self.axes)
            check(code >= last and node in self.nodes, "a block of no node")
            check(24 <= at and at + size <= end, "a block is out of bounds")
            check(1 <= points <= 1 << 20, "points of a block")
            least, most = tuple(box[:3]), tuple(box[3:])
            check(all(a <= e for a, e in zip(least, most)), "extremes of a block")
            self.nodes[node].blocks.append(Block(node, at, size, crc, points, least, most))
            last, whole = code, whole + size
        check(whole <= end - 24, "blocks have more bytes than there are")
        below = {of.at: sum(block.points for block in of.blocks) for of in self.nodes.values()}
        for of in reversed(self.nodes.values()):
            check(below[of.at] == of.points, "points of a node and those below")
            if of.at.level:
                below[of.at.up(1)] += of.points

    @property
    def root(self) -> Code:
        return Code(0, (0,) * self.axes)

    def world(self, point: Sequence[Number]) -> list[float]:
        """Returns the world position of a point."""
        return [x * scale + offset for x, scale, offset in zip(point, self.scale, self.offset)]

    def code(self, point: Sequence[Number]) -> int:
        """Returns the code of a point."""
        coordinates = [int(x) - corner for x, corner in zip(point[: self.axes], self.corner)]
        check(all(0 <= x < 1 << self.bits for x in coordinates), "a point is not inside")
        return Code(self.deepest, tuple(x >> self.bits - self.deepest for x in coordinates)).code

    @cached_property
    def order(self) -> list[int]:
        """Returns the columns in block order."""
        names, last = [column.name for column in self.columns], range(len(self.columns))
        clock = names.index("gps_time", 3) if "gps_time" in names[3:] else None
        labels = [i for i in last[3:] if self.columns[i].sample == "B" and i != clock]
        first = labels if clock is None else [clock, *labels]
        return first + [i for i in last if i not in first]

    @cached_property
    def clock(self) -> int | None:
        """Returns the clock column, if any."""
        return self.order[0] if self.columns[self.order[0]].name == "gps_time" and self.order[0] > 2 else None

    # Section 44.

    def ordered_numbers(self, block: Block) -> list[list[int]]:
        """Returns a block's ordered numbers, by column."""
        data = self.data[block.at : block.at + block.size]
        check(crc32c(data) == block.crc, "checksum of a block")
        b = Bytes(data)
        sizes = [b.get("I") for _ in self.columns]
        check(b.at + sum(sizes) == len(data), "lengths of columns")
        found: list[list[int]] = [[] for _ in self.columns]
        for column, size in zip(self.order, sizes):
            known = [found[i] for i in self.order[: self.order.index(column)]]
            labels = [i for i, k in enumerate(self.order[: len(known)]) if self.columns[k].sample == "B"]
            clock = found[self.clock] if self.clock is not None and column != self.clock else None
            found[column] = read_column(Bytes(b.take(size)), block.points, clock, known, labels)
        return found

    def points_of(self, block: Block) -> list[Point]:
        """Returns the points of a block, each with its grid units and attribute values."""
        columns = self.ordered_numbers(block)
        values = [[value_of(n, column.sample) for n in of] for column, of in zip(self.columns, columns)]
        extremes = tuple(map(min, columns[:3])), tuple(map(max, columns[:3]))
        check((block.least, block.most) == extremes, "extremes of a block")
        return list(zip(*values))

    def points(self, node: Node) -> list[Point]:
        """Returns a node's own points."""
        return [point for block in node.blocks for point in self.points_of(block)]

    def walk(self) -> Iterator[tuple[Node, list[Point]]]:
        """Yields all nodes by code, with the points of each."""
        for node in self.nodes.values():
            yield node, self.points(node)

    # Verification.

    def verify(self) -> None:
        """Checks that points are in the specified nodes and blocks, and that the nodes' summaries
        are right."""
        of_nodes = {node.at: [self.points_of(block) for block in node.blocks] for node in self.nodes.values()}
        rows = sorted((self.code(point), node.code) for node, blocks in of_nodes.items() for points in blocks for point in points)
        positions = {point[:3] for blocks in of_nodes.values() for points in blocks for point in points}
        check(len(rows) - len(positions) == self.repeated, "points at the place of another one")
        self._verify_levels(rows)
        for blocks in of_nodes.values():
            self._verify_blocks(blocks)
        self._verify_statistics(of_nodes)

    def _verify_levels(self, rows: list[tuple[int, int]]) -> None:
        """Checks that each point is in the node of its level, or in an ancestor that its subtree
        was merged into; by codes."""
        deepest = self.deepest
        at = [Code.of(code, self.axes) for code, _ in rows]
        # The node of each point, and the number of points in each subtree, before merging.
        first = []
        below: dict[Code, int] = {}
        for before, own in zip([None, *at], at):
            common = -1
            if before:
                common = next(l for l in range(deepest, -1, -1) if own.up(deepest - l) == before.up(deepest - l))
            level = min(max(0, common + 1 - self.parts), self.header.depth)
            first.append(own.up(deepest - level))
            for l in range(level + 1):
                node = own.up(deepest - l)
                below[node] = below.get(node, 0) + 1
        # Points with equal codes are not distinguished: only their number per node counts.
        taken = []
        for node in first:
            above = (node.up(node.level - l) for l in range(node.level + 1))
            taken.append(next((up for up in above if below[up] <= self.leaf_size), node))
        check(sorted((code, node.code) for (code, _), node in zip(rows, taken)) == rows, "points are in other nodes")
        check(set(self.nodes) == {node.up(levels) for node in set(taken) for levels in range(node.level + 1)}, "nodes")

    def _verify_blocks(self, blocks: list[list[Point]]) -> None:
        """Checks that a node's points are split into blocks in code order."""
        check(all(len(points) == self.leaf_size for points in blocks[:-1]), "points of blocks")
        check(all(len(points) <= self.leaf_size for points in blocks[-1:]), "points of the last block")
        codes = [sorted(map(self.code, points)) for points in blocks]
        check(all(a[-1] <= e[0] for a, e in pairwise(codes)), "the order of blocks")

    def _verify_statistics(self, of_nodes: dict[Code, list[list[Point]]]) -> None:
        """Checks that a node's summary matches the points of its subtree."""
        below: dict[Code, list[Node]] = {}
        for at, blocks in reversed(of_nodes.items()):
            for i, column in enumerate(self.columns):
                is_value = lambda value: not math.isnan(value) and ordered(value, column.sample) != column.no_data
                values = [[point[i] for point in points if is_value(point[i])] for points in blocks]
                # The child nodes' summaries have been checked.
                more = [node.columns[i] for node in reversed(below.get(at, []))]
                keys = [ordered(value, column.sample) for of in values for value in of]
                keys += [key for summary in more for key in (summary.least, summary.most) if summary.count]
                summary = self.nodes[at].columns[i]
                check(summary.count == sum(map(len, values)) + sum(of.count for of in more), "numbers of a column")
                check((summary.least, summary.most) == ((min(keys), max(keys)) if keys else NOTHING), "extremes of a column")
                total = added(sum_of(of, column.sample) for of in values) + added(of.sum for of in more)
                check(summary.sum == total or math.isnan(summary.sum) and math.isnan(total), "the sum of a column")
            if at.level:
                below.setdefault(at.up(1), []).append(self.nodes[at])


def added(values: Iterable[Number]) -> float:
    """Returns the sum of `f64` numbers, in this order."""
    total = 0.0
    for value in values:
        total += float(value)
    return total


def sum_of(values: list[Number], sample: str) -> float:
    """Returns the sum of a block's values."""
    return added(values) if sample in "fdQ" else float(sum(values))


def rounded(value: float) -> int:
    """Returns the value that a prediction adds, modulo 2^64."""
    value += 0.5
    if math.isnan(value):
        return 0
    return math.floor(min(max(value, -(2.0**63)), 2.0**63)) - (value >= 2.0**63 or value < -(2.0**63))


class Line:
    """Linear extrapolation of the last points, by the clock."""

    def __init__(self) -> None:
        self.w = self.t = self.q = self.n = self.p = 0.0

    def next(self, d: float) -> float:
        self.d = d
        far = d * d * self.w > 64 * self.q
        if far and self.q > 0:
            self.w = self.t = self.q = self.n = self.p = 0.0
        w, t, n, p = self.w, self.t, self.n, self.p
        s = w * self.q - t * t
        if d == 0 or not s > 0 or far:
            return 0.0
        b = (w * p - t * n) * (1 / s)
        return (n - b * t) * (1 / w) + b * d

    def learn(self, c: float) -> None:
        d, w, t = self.d, self.w, self.t
        if w == 0:
            self.n = self.p = 0.0
        else:
            self.p = (self.p - d * self.n - c * t + d * c * w) * 0.875
            self.n = (self.n - c * w) * 0.875
        self.q = (self.q - 2 * d * t + d * d * w) * 0.875
        self.t = (t - d * w) * 0.875
        self.w = w * 0.875 + 1


class Mean:
    """The running mean of the last numbers."""

    def __init__(self) -> None:
        self.w = self.n = 0.0

    def next(self, _: float) -> float:
        return self.n / self.w if self.w else 0.0

    def learn(self, c: float) -> None:
        self.n = (self.n - c * self.w) * 0.9375
        self.w = self.w * 0.9375 + 1


def read_column(b: Bytes, count: int, clock: list[int] | None, known: list[list[int]], labels: list[int]) -> list[int]:
    """Returns the ordered numbers of a column, given all its bytes, the clock's numbers, and the
    previous columns, some of which may be labels."""
    way, label = b.get("BB")
    check(way == 0x40 or way & 0x7C == 0, "a way that is none")
    check(label == 0 or label - 1 in labels, "a label that is none")
    if way == 0x40:
        found = [b.get("q")] * count
    else:
        first, size = b.get("qq") if way & 0x80 else (0, 1)
        still = [1, *(int(a == e) for a, e in pairwise(clock))] if clock else [0] * count
        of = known[label - 1] if label else [0] * count
        errors = numbers(b, [(4 if label else 1) * t + l % 4 for t, l in zip(still, of)])
        found = [signed(first + n * size) for n in predicted(errors, way & 3, clock)]
    check(b.at == len(b.data), "something is left of a column")
    return found


def predicted(errors: list[int], prediction: int, clock: list[int] | None) -> list[int]:
    """Returns the numbers, given residuals and a prediction."""
    if prediction == 0:
        return errors
    found: list[int] = []
    last, way = 0, None if prediction == 1 else Line() if prediction == 2 else Mean()
    for i, error in enumerate(errors):
        guess = 0
        if way:
            d = 0 if i == 0 else 1 if clock is None else signed(clock[i] - clock[i - 1])
            guess = rounded(way.next(float(d)))
        number = signed(last + (guess if i else 0) + error)
        if way:
            way.learn(float(signed(number - last)))
        found.append(number)
        last = number
    return found


if __name__ == "__main__":
    tree = Points(Path(sys.argv[1]).read_bytes())
    print(",".join(["level", *(column.name for column in tree.columns)]))
    for node, points in tree.walk():
        for point in points:
            values = (column.meant(stored) for column, stored in zip(tree.columns[3:], point[3:]))
            print(",".join(map(str, [node.at.level, *tree.world(point[:3]), *values])))
