"""Trees: headers, records and dense blocks, and windows of any level, which are drawn in the same
way from Goblin and Autumnal files (sections 5, 6 and 12 of formats.md)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from basics import Code, CorruptFile, Header, Point, Unknown, check
from numpy.typing import NDArray

VOID, LEAF, INNER, CUT = range(4)
PLAIN, PACKED, REFERENCE = range(3)
# By number. Three numbers belong to an earlier version.
SAMPLES = ["<u1", "<u2", "<i2", "<u4", "<i4", "<f4", None, "<i1", None, None, "<f8", "<u8", "<i8"]
RULES = ["mean", "majority", "dominant", "min", "max", "nearest", "occupancy"]

Values = NDArray[Any]


class TreeHeader:
    """A tree's header (section 5), and the derived sizes."""

    def __init__(self, raw: bytes, file: Header) -> None:
        (sample, self.channels, rule, kind, self.codec, self.depth, self.reach, self.stride, self.heavy, mask, self.lack, *extent) = (
            struct.unpack("<8BIB3x8s3Q", raw)
        )
        if sample >= len(SAMPLES) or SAMPLES[sample] is None or rule >= len(RULES) or kind > 1 or self.codec > REFERENCE:
            raise Unknown("a number of the tree's header is not known")
        # Everything except what readers ignore.
        self.raw = raw[:13] + raw[16:]
        self.axes = axes = file.axes
        self.type = np.dtype(SAMPLES[sample])
        self.rule, self.extent = RULES[rule], tuple(extent)
        self.masked, self.missing, self.alpha = mask > 0, mask == 1, mask == 2
        self.classes = kind == 0 or rule == 1
        check(1 <= self.channels <= (4 if sample in (0, 1, 5) else 1), "channels")
        check(self.depth <= file.depth, "a layer is deeper than its file")
        check(mask < 3 and (self.channels > 1 or not mask), "the mask")
        check(not any(self.lack[self.type.itemsize if self.missing else 0 :]), "the missing sample")
        check(1 <= self.stride < self.reach <= (10 if axes == 2 else 8) and self.reach % self.stride == 0, "reach and stride")
        self.children = 1 << axes
        check((self.heavy == 0) == (self.codec == REFERENCE) and (axes == 2 or self.heavy), "T")
        check(self.heavy <= 1 << 20 and self.heavy * self.children**self.stride <= 1 << (20 if axes == 2 else 28), "T")
        check(all(1 <= v <= 1 << self.depth for v in extent[:axes]) and (axes == 3 or extent[2] == 1), "extent")
        self.width = self.type.itemsize * self.channels
        self.square = 24 if self.type.itemsize == 8 else 16
        self.record = self.children * self.width + (4 if axes == 2 else 8)
        self.skips = 21 if axes == 2 else 29

    def values(self, data: bytes, at: int, count: int) -> Values:
        """Returns consecutive values."""
        check(at + count * self.width <= len(data), "values end too early")
        return np.frombuffer(data, self.type, count * self.channels, at).reshape(count, self.channels)

    def dense_levels(self, kind: int, slots: int) -> int:
        """Returns `k` of a dense block of `slots` records (section 6)."""
        for k in range(*((3, 9) if self.axes == 2 else (2, 5))):
            n = sum(self.children**j for j in range(2, k + 1))
            bits = self.children**k // 8 if kind > 2 else 0
            if slots == 1 - -(n * self.width + bits) // self.record:
                return k
        raise CorruptFile("a dense block has no such number of slots")


def raw_bits(values: Values) -> Values:
    """Returns values as unsigned integers, which are equal if all bits are."""
    return np.ascontiguousarray(values).view(f"u{values.dtype.itemsize}")


def kids(a: Values, axes: int) -> list[Values]:
    """Returns the values of child 0, 1 ... of each node of the next coarser level."""
    return [a[tuple(slice(i >> b & 1, None, 2) for b in reversed(range(axes)))] for i in range(1 << axes)]


def states_above(states: Values, values: Values, axes: int) -> Values:
    """Returns the states of nodes whose children have these."""
    below, of = kids(states, axes), [raw_bits(v) for v in kids(values, axes)]
    empty = np.logical_and.reduce([s == VOID for s in below])
    same = np.logical_and.reduce([(s == LEAF) & (v == of[0]).all(-1) for s, v in zip(below, of)])
    return np.where(empty, VOID, np.where(same, LEAF, INNER)).astype(np.uint8)


@dataclass
class Block:
    """A record or a dense block: values and states of the nodes 1 to `k` levels below its node, by
    z, y, x."""

    k: int
    values: list[Values]
    states: list[Values]
    slots: dict[Point, int]


class RunRecords:
    """Records and dense blocks below one node: those of a segment, or of a record with pointers."""

    def __init__(self, form: TreeHeader, data: bytes, node: Code) -> None:
        self.form, self.data, self.node = form, data, node
        self.blocks: dict[int, Block] = {}
        check(len(data) % form.record == 0 and self.head(0)[1] * form.record == len(data), "the first skip does not cover all slots")

    def head(self, place: int) -> tuple[int, int, int]:
        """Returns states, skip and mark of a record."""
        f = self.form
        check(0 <= place < len(self.data) // f.record, "a record is beyond the run")
        at = place * f.record + f.children * f.width
        states = int.from_bytes(self.data[at : at + f.axes - 1], "little")
        last = int.from_bytes(self.data[(place + 1) * f.record - f.axes - 1 : (place + 1) * f.record], "little")
        skip = last & (1 << f.skips) - 1
        check(0 < skip <= len(self.data) // f.record - place, "a skip leads out of the run")
        return states, skip, last >> f.skips

    def block(self, place: int) -> Block:
        """Returns the nodes below a record, and the indices of their records."""
        if place not in self.blocks:
            self.blocks[place] = self._block(place)
        return self.blocks[place]

    def _block(self, place: int) -> Block:
        f = self.form
        states, skip, mark = self.head(place)
        cube = (2,) * f.axes
        record = f.values(self.data, place * f.record, f.children).reshape(*cube, f.channels)
        own = np.array([states >> 2 * i & 3 for i in range(f.children)], np.uint8).reshape(cube)
        if mark == 0:
            follows, slots = place + 1, {}
            for i in range(f.children):
                if states >> 2 * i & 3 == INNER:
                    slots[tuple(i >> a & 1 for a in range(f.axes))] = follows
                    follows += self.head(follows)[1]
            check(follows == place + skip, "skips do not add up")
            return Block(1, [np.empty(0), record], [np.empty(0), own], slots)
        check(mark < 6, "a mark that is none")
        k = f.dense_levels(mark, skip)
        at, values = (place + 1) * f.record, [np.empty(0), record]
        for j in range(2, k + 1):
            values.append(f.values(self.data, at, f.children**j).reshape((1 << j,) * f.axes + (f.channels,)))
            at += f.children**j * f.width
        bottom = np.full((1 << k,) * f.axes, CUT if mark in (2, 4) else LEAF, np.uint8)
        if mark > 2:
            count = f.children**k // 8
            bits = np.unpackbits(np.frombuffer(self.data, np.uint8, count, at), bitorder="little").reshape(bottom.shape)
            at += count
            bottom = np.choose(bits, [[VOID, VOID, LEAF][mark - 3], [LEAF, CUT, CUT][mark - 3]]).astype(np.uint8)
        check(not any(self.data[at : (place + skip) * f.record]), "a dense block does not end in zeros")
        found = [bottom]
        for j in range(k - 1, 0, -1):
            found.insert(0, states_above(found[0], values[j + 1], f.axes))
        check((found[0] == own).all(), "states of a dense block contradict its record")
        return Block(k, values, [np.empty(0), *found], {})

    def find_node(self, path: list[int]) -> tuple[int, bytes]:
        """Returns state and value at the end of a path (section 12), byte by byte. In dense blocks
        INNER is any state except VOID."""
        f, place = self.form, 0
        for step, child in enumerate(path):
            states, skip, mark = self.head(place)
            state = states >> 2 * child & 3
            if state < INNER or step + 1 == len(path):
                at = place * f.record + child * f.width
                return state, self.data[at : at + f.width]
            check(state == INNER, "CUT on the way")
            if mark:
                return self._find_in_dense_block(place, skip, mark, path[step:])
            place += 1
            for i in range(child):
                if states >> 2 * i & 3 == INNER:
                    place += self.head(place)[1]
        raise AssertionError("an empty path")

    def _find_in_dense_block(self, place: int, skip: int, mark: int, path: list[int]) -> tuple[int, bytes]:
        f, j, k = self.form, len(path), self.form.dense_levels(mark, skip)
        check(j <= k, "a node is below the bottom of a dense block")
        at = [sum((child >> a & 1) << j - 1 - i for i, child in enumerate(path)) for a in range(f.axes)]
        index = sum(v << j * a for a, v in enumerate(at))
        start = (place + 1) * f.record
        value = start + (sum(f.children**i for i in range(2, j)) + index) * f.width
        bits = start + sum(f.children**i for i in range(2, k + 1)) * f.width
        there = mark in (1, 2, 5)
        for i in range(f.children ** (k - j) if not there else 0):
            below, rest = 0, i
            for a in range(f.axes):
                below |= (at[a] << k - j | rest & (1 << k - j) - 1) << k * a
                rest >>= k - j
            there = there or self.data[bits + below // 8] >> below % 8 & 1 == 1
        return INNER if there else VOID, self.data[value : value + f.width]


class Spot(NamedTuple):
    """An INNER node, `j` levels below the node of a block, at `at` there."""

    run: RunRecords
    block: Block
    j: int
    at: Point
    node: Code


class Tree:
    """A layer: common code of Goblin and Autumnal files. Subclasses continue at CUT nodes, and
    return a node's value."""

    form: TreeHeader
    name: str
    root_state: int
    root_value: bytes
    meta: dict[str, Any]

    def first(self) -> RunRecords:
        """Returns the run of the root."""
        raise NotImplementedError

    def deeper(self, run: RunRecords, node: Code) -> RunRecords:
        """Returns the run that continues below a node that is CUT in another one."""
        raise NotImplementedError

    def value(self, node: Code) -> bytes | None:
        """Returns the value of one node, found only along its path; None for VOID."""
        raise NotImplementedError

    def start(self, run: RunRecords) -> Spot:
        return Spot(run, run.block(0), 0, (0,) * self.form.axes, run.node)

    def step(self, spot: Spot, to: Code) -> Spot:
        """Returns an INNER node's child on the path to another node."""
        child = to.up(to.level - spot.node.level - 1)
        at = tuple(v << 1 | c & 1 for v, c in zip(spot.at, child.at))
        below = Spot(spot.run, spot.block, spot.j + 1, at, child)
        state = spot.block.states[below.j][at[::-1]]
        check(state >= INNER and child.level < self.form.depth, "a node without children has some")
        if below.j < spot.block.k:
            return below
        if state == INNER:
            check(at in spot.block.slots, "an INNER node at the bottom of a dense block")
            return Spot(spot.run, spot.run.block(spot.block.slots[at]), 0, (0,) * self.form.axes, child)
        return self.down(self.start(self.deeper(spot.run, child)), child)

    def window(self, level: int, low: Point | None = None, high: Point | None = None) -> tuple[Values, Values]:
        """Values and states of a level's nodes between two corners (x first), by z, y, x; by
        default all.

        Nodes inside a VOID or LEAF have its state.
        """
        f = self.form
        low, high = low or (0,) * f.axes, high or (1 << level,) * f.axes
        size = tuple(b - a for a, b in zip(low, high))[::-1]
        values, states = np.zeros((*size, f.channels), f.type), np.full(size, self.root_state, np.uint8)
        values[...] = f.values(self.root_value, 0, 1)[0]
        if self.root_state == INNER and level > 0:
            self.paint(self.start(self.first()), level, low, high, values, states)
            # Nodes below are in another segment, but still INNER.
            states[states == CUT] = INNER
        return values, states

    def paint(self, spot: Spot, level: int, low: Point, high: Point, values: Values, states: Values) -> None:
        """Draws the nodes of a level below an INNER node that are between two corners."""
        block, deep = spot.block, min(level - spot.node.level, spot.block.k - spot.j)
        more = level - spot.node.level - deep
        source, target, corner = [], [], []
        for a, b, own, at in zip(low, high, spot.node.at, spot.at):
            start, end = max(a >> more, own << deep), min((b - 1 >> more) + 1, own + 1 << deep)
            if start >= end:
                return
            shift = own - at << deep
            source.append(slice(start - shift, end - shift))
            target.append(np.arange(max(start << more, a), min(end << more, b)))
            corner.append(start)
        cut = block.states[spot.j + deep][tuple(source[::-1])]
        # Each cell has the value of the block's node that contains it.
        pick = np.ix_(*[(cells >> more) - start for cells, start in zip(target, corner)][::-1])
        place = np.ix_(*[cells - a for cells, a in zip(target, low)][::-1])
        values[place] = block.values[spot.j + deep][tuple(source[::-1])][pick]
        states[place] = cut[pick]
        if more:
            for index in np.argwhere(cut >= INNER):
                bottom = Code(spot.node.level + deep, tuple(int(v) + start for v, start in zip(index[::-1], corner)))
                self.paint(self.down(spot, bottom), level, low, high, values, states)

    def down(self, spot: Spot, node: Code) -> Spot:
        """Returns an INNER node's descendant."""
        while spot.node.level < node.level:
            spot = self.step(spot, node)
        return spot


@dataclass
class Statistics:
    """The statistics of a segment in the segment index, or of a node's zone: counts, and for each
    channel extremes, sums and sums of squares.

    Sums are integers, or pairs of floating-point numbers.
    """

    cells: int
    least: Values
    most: Values
    sums: list[Any]
    squares: list[Any]
    present: list[int]


def sum_of(raw: bytes, floating: bool) -> Any:
    """Returns a sum of 16 bytes, or a sum of squares, which may have 24."""
    return struct.unpack(f"<{len(raw) // 8}d", raw) if floating else int.from_bytes(raw, "little", signed=len(raw) == 16)
