"""Unpacks packed segments and extents (sections 37 to 39 and 41 of formats.md) to plain ones."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

import numpy as np
from basics import check, crc32c
from coder import NUMBERS, SOLID, Coder, Numbers, context_of, wrap
from planes import KINDS, Block, part, read_numbers
from trees import CUT, INNER, LEAF, VOID, TreeHeader, Values

# The symbol of VOID, and the index of missing children.
NONE = -1


@dataclass
class Ways:
    """Neighbour directions: their number, the number of them across faces, and for each child and
    direction whether it leads to a sibling, the parent's direction otherwise, and the child number
    there."""

    count: int
    faces: int
    steps: list[list[tuple[bool, int, int]]]

    @classmethod
    def of(cls, axes: int) -> Ways:
        every = [d[::-1] for d in product((-1, 0, 1), repeat=axes)]
        directions = [d for n in (1, 2) for d in every if sum(map(abs, d)) == n]
        steps: list[list[tuple[bool, int, int]]] = []
        for child in range(1 << axes):
            steps.append([])
            for d in directions:
                at = [(child >> a & 1) + v for a, v in enumerate(d)]
                leaves = tuple(v >> 1 for v in at)
                there = sum((v & 1) << a for a, v in enumerate(at))
                steps[-1].append((False, directions.index(leaves), there) if any(leaves) else (True, 0, there))
        return cls(len(directions), 2 * axes, steps)

    def of_child(self, of_parent: list[int], kids: list[int], first: int, child: int, known: int) -> list[int]:
        """Returns a child's neighbours, given the parent's; siblings from `known` on are
        unknown."""
        found = []
        for sibling, leaves, there in self.steps[child]:
            if sibling:
                found.append(first + there if there < known else 0)
            else:
                near = of_parent[leaves]
                found.append(near if kids[near] < 0 else kids[near] + there)
        return found

    def pattern(self, true: list[bool]) -> int:
        """Returns the bit pattern of the neighbours with a property."""
        number = 0
        for one in true[:6] if self.faces == 6 else true:
            number = number << 1 | one
        return number << 2 | min(sum(true[6:]) // 3, 3) if self.faces == 6 else number


WAYS = {axes: Ways.of(axes) for axes in (2, 3)}


@dataclass
class Nodes:
    """Nodes in decoding order. 0 is outside or not decoded yet; 1 is the segment's own node."""

    symbols: list[int] = field(default_factory=lambda: [NONE, NONE])
    states: list[int] = field(default_factory=lambda: [LEAF, INNER])
    kids: list[int] = field(default_factory=lambda: [NONE, NONE])
    levels: list[int] = field(default_factory=lambda: [0, 0])
    # Marks and levels of dense blocks, by their root nodes.
    dense: dict[int, tuple[int, int]] = field(default_factory=dict)


class Packing:
    """The state of one coder, for a segment or an extent's runs: contexts, values and their table
    continue from run to run."""

    def __init__(self, form: TreeHeader, data: bytes) -> None:
        self.form, self.coder = form, Coder(data)
        self.ways, self.numbers = WAYS[form.axes], Numbers(form)
        self.continuous, self.solid = self.coder.model == NUMBERS, self.coder.model == SOLID
        check(not self.solid or form.channels == 1 and form.type == np.uint8, "a solid of other values")
        self.table: list[tuple[int, ...]] = []
        # Values of symbols, and symbols of decoded values. VOID has zeros.
        self.values: list[tuple[int, ...]] = [(0,) * form.channels]
        self.known: dict[tuple[int, ...], int] = {}

    # Section 37.

    def read_table(self, size: int) -> None:
        """Reads the table of values, for at most `size` bytes."""
        count, last = self.coder.number(), [0] * self.form.channels
        check(count * self.form.width <= size, "more values than bytes")
        for _ in range(count):
            last = [wrap(v + self.coder.signed(), self.numbers.bits) for v in last]
            self.table.append(tuple(last))
        self.values += [] if self.continuous else self.table

    # Section 38.

    def new(self, tried: list[int], inner: bool) -> int:
        """Returns the symbol of a value that no candidate has."""
        if self.continuous:
            return self._new_number(tried, inner)
        symbol = self.coder.tree("new", len(self.table).bit_length())
        check(symbol <= len(self.table), "a value is not in the table")
        check(symbol or not inner, "an INNER node has no value")
        return symbol

    def _new_number(self, tried: list[int], inner: bool) -> int:
        if not inner and self.coder.bit("void"):
            return VOID
        found, moved = [0] * self.form.channels, 0
        rows = [self.values[s] for s in tried if s]
        for channel in self.numbers.order:
            numbers = [row[channel] for row in rows]
            mean = sum(numbers) // len(numbers) if numbers else 0
            size = max(numbers) - min(numbers) if numbers else 0
            shift = moved if channel in self.numbers.relative_channels else 0
            residual = self.coder.residual(("new", channel), context_of(size))
            found[channel] = wrap(mean + shift + residual, self.numbers.bits)
            if channel == 1:
                moved = found[1] - mean
        symbol = self.known.setdefault(tuple(found), len(self.values))
        if symbol == len(self.values):
            self.values.append(tuple(found))
        return symbol

    def samples(self, symbols: list[int]) -> Values:
        """Returns the samples of values. VOID has zeros."""
        return self.numbers.samples(np.array([self.values[max(s, 0)] for s in symbols], np.int64).reshape(-1, self.form.channels))


class Below:
    """The subtree of one node being unpacked: the segment's own node, or a record's.

    `height` is the number of levels from it to the cells, `reach` that to the CUT nodes, `size` the
    maximum number of bytes, `own` the node's symbol.
    """

    def __init__(self, packing: Packing, height: int, reach: int, size: int, own: int = NONE) -> None:
        self.packing, self.form, self.coder, self.ways = packing, packing.form, packing.coder, packing.ways
        self.height, self.reach, self.size, self.capacity = height, reach, size, size
        self.nodes = Nodes(symbols=[NONE, own])
        # Occupancy of a solid's INNER and CUT nodes.
        self.fullness: dict[int, int] = {}
        self._nodes()
        if packing.solid:
            self._fill()
        self.samples = packing.samples(self.nodes.symbols)
        for node, value in self.fullness.items():
            self.samples[node] = value
        # The segment's own node has no value, as VOID.
        value_of = lambda node: packing.values[max(self.nodes.symbols[node], 0)]  # noqa: E731
        dense = self.nodes.dense.items() if packing.continuous else ()
        self.blocks = {node: Block(self.form, self.coder, value_of(node), mark, deep) for node, (mark, deep) in dense}

    def records(self) -> bytes:
        """Returns all records. The numbers of dense blocks are decoded now."""
        blocks = {node: self._dense(node, mark, deep) for node, (mark, deep) in self.nodes.dense.items()}
        parts: list[bytes] = []
        self._records(1, blocks, parts)
        return b"".join(parts)

    # Section 38.

    def _nodes(self) -> None:
        nodes, inner = self.nodes, [1]
        around = {1: [0] * self.ways.count}
        # Nodes in dense blocks, with the levels from them to the bottom.
        inside: dict[int, int] = {}
        for level in range(1, self.height + 1):
            parents: dict[int, tuple[int, int]] = {}
            for node in inner:
                deep = inside.pop(node, 0)
                if not deep:
                    deep = self._block(node, self.height - level)
                    if deep and self.packing.continuous:
                        continue
                first = nodes.kids[node] = len(nodes.symbols)
                check((first - 2 + self.form.children) * self.form.width <= self.size, "more nodes than bytes")
                for child in range(self.form.children):
                    self._child(node, child, level, around[node])
                    if nodes.states[-1] == INNER:
                        check(deep != 1, "an INNER node at the bottom of a dense block")
                        parents[first + child] = node, child
                        if deep:
                            inside[first + child] = deep - 1
            # The whole level is decoded now.
            inner, before = list(parents), around
            around = {}
            for node, (parent, child) in parents.items():
                around[node] = self.ways.of_child(before[parent], nodes.kids, nodes.kids[parent], child, self.form.children)
        check(not inner, "a cell is INNER")

    def _block(self, node: int, height: int) -> int:
        """Returns the levels of the dense block at a node, or 0; `height` is the number of levels
        from the children to the cells."""
        low = min(height, 7)
        if not self.coder.bit(("dense", low)):
            return 0
        both = self.coder.tree(("kind", low), 6)
        mark, deep = both & 7, (both >> 3) + 1
        least, most = (3, 8) if self.form.axes == 2 else (2, 4)
        check(1 <= mark <= 5 and least <= deep <= most and deep <= height + 1, "a dense block that is none")
        self.capacity -= self.form.width * sum(self.form.children**j for j in range(1, deep + 1))
        check(self.capacity >= 0, "dense blocks are larger than the segment")
        self.nodes.dense[node] = mark, deep
        return deep

    def _child(self, parent: int, child: int, level: int, around: list[int]) -> None:
        nodes, coder = self.nodes, self.coder
        first, low = nodes.kids[parent], min(self.height - level, 7)
        near = self.ways.of_child(around, nodes.kids, first, child, child)
        states, symbols = [nodes.states[n] for n in near], [nodes.symbols[n] for n in near]
        state, symbol = LEAF, NONE
        if low and coder.bit(("inner", low, child, self.ways.pattern([s >= INNER for s in states]))):
            state = CUT if level == self.reach and coder.bit(("cut", child)) else INNER
        if state == LEAF or not self.packing.solid:
            symbol = self._value(nodes.symbols[parent], symbols, state >= INNER, low == 0, child)
        if symbol == VOID:
            state = VOID
        if state == CUT and self.packing.solid:
            faces = list(zip(states, symbols))[: self.ways.faces]
            leaves, voids = sum(s == LEAF and v > 0 for s, v in faces), sum(s == VOID for s, _ in faces)
            high = coder.symbol(("high", leaves, voids))
            self.fullness[len(nodes.symbols)] = high << 4 | coder.symbol(("low", high))
        nodes.symbols.append(symbol)
        nodes.states.append(state)
        nodes.kids.append(NONE)
        nodes.levels.append(level)

    def _value(self, above: int, near: list[int], inner: bool, cell: bool, child: int) -> int:
        """Returns the symbol of a child, given those of the parent and the neighbours."""
        tried: list[int] = []
        for n, symbol in enumerate([above, *near]):
            if symbol < inner or symbol in tried:
                continue
            rank = 0 if n == 0 else min(len(tried) + 1, 3)
            if self.coder.bit(("value", inner, cell, child, rank, self.ways.pattern([s == symbol for s in near]))):
                return symbol
            tried.append(symbol)
            if len(tried) == 4:
                break
        return self.packing.new(tried, inner)

    def _fill(self) -> None:
        """Decodes the occupancy of a solid's INNER nodes."""
        nodes, children = self.nodes, self.form.children
        # For each node the sum of its cells, and whether one of its descendants is CUT.
        sums, cut = [0] * len(nodes.symbols), [False] * len(nodes.symbols)
        for node in range(len(nodes.symbols) - 1, 1, -1):
            cells, state = children ** (self.height - nodes.levels[node]), nodes.states[node]
            if state == LEAF:
                sums[node] = cells * self.packing.values[nodes.symbols[node]][0]
            elif state == CUT:
                sums[node], cut[node] = cells * self.fullness[node], True
            elif state == INNER:
                below = slice(nodes.kids[node], nodes.kids[node] + children)
                sums[node], cut[node] = sum(sums[below]), any(cut[below])
                value = (2 * sums[node] + cells) // (2 * cells)
                if cut[node]:
                    symbol = self.coder.symbol("fill")
                    value += symbol - 8 if symbol else self.coder.symbol("fill more") << 4 | self.coder.raw(4)
                self.fullness[node] = value & 255

    # Sections 6 and 7.

    def _record(self, states: list[int], values: Values, skip: int, mark: int) -> bytes:
        check(skip < 1 << self.form.skips, "a skip is too large")
        axes, all_states, last = self.form.axes, sum(s << 2 * i for i, s in enumerate(states)), skip | mark << self.form.skips
        return values.tobytes() + all_states.to_bytes(1 if axes == 2 else 4, "little") + last.to_bytes(axes + 1, "little")

    def _records(self, node: int, blocks: dict[int, bytes], parts: list[bytes]) -> int:
        """Appends the records of a node and its descendants, and returns their number."""
        if node in blocks:
            parts.append(blocks[node])
            return len(blocks[node]) // self.form.record
        at, skip, first = len(parts), 1, self.nodes.kids[node]
        parts.append(b"")
        states = self.nodes.states[first : first + self.form.children]
        for child, state in enumerate(states, first):
            if state == INNER:
                skip += self._records(child, blocks, parts)
        parts[at] = self._record(states, self.samples[first : first + self.form.children], skip, 0)
        return skip

    def _dense(self, node: int, mark: int, deep: int) -> bytes:
        """Returns a dense block: one of numbers, or one whose nodes were decoded like all
        others."""
        if self.packing.continuous:
            block = self.blocks[node]
            states, values, bits = block.states(), block.values, block.bits
        else:
            states, values, bits = self._rows(node, mark, deep)
        rows = b"".join(level.tobytes() for level in values[1:])
        if mark > 2:
            rows += np.packbits(bits.ravel(), bitorder="little").tobytes()
        slots = 1 - -len(rows) // self.form.record
        return self._record(states, values[0], slots, mark) + rows.ljust((slots - 1) * self.form.record, b"\0")

    def _rows(self, root: int, mark: int, deep: int) -> tuple[list[int], list[Values], Values]:
        """Returns the states of the children of a dense block's root, values of its levels and its
        bits."""
        axes, children, values = self.form.axes, self.form.children, []
        kids, states = np.array(self.nodes.kids), np.array(self.nodes.states)
        at = np.full((1,) * axes, root)
        for _ in range(deep):
            below = np.empty([2 * n for n in at.shape], np.int64)
            for child in range(children):
                # Nodes inside a VOID or LEAF have its value.
                below[part(child, axes)] = np.where(kids[at] < 0, at, kids[at] + child)
            at = below
            values.append(self.samples[at])
        clear, bit = KINDS[mark]
        check(np.isin(states[at], (clear, bit)).all(), "states at the bottom of a dense block")
        first = self.nodes.kids[root]
        return self.nodes.states[first : first + children], values, states[at] == bit

    def counts(self) -> bytes:
        """Returns the class counts."""
        table = self.packing.table
        if self.coder.raw(1):
            cells = [self.coder.number() for _ in table]
        else:
            nodes = self.nodes
            check(not self.packing.continuous and CUT not in nodes.states, "cells that do not follow from the nodes")
            cells = [0] * len(table)
            for symbol, state, level in zip(nodes.symbols[2:], nodes.states[2:], nodes.levels[2:]):
                if state == LEAF:
                    cells[symbol - 1] += self.form.children ** (self.height - level)
        values = self.packing.numbers.samples(np.array(table, np.int64).reshape(-1, self.form.channels))
        return b"".join(value.tobytes() + n.to_bytes(8, "little") for value, n in zip(values, cells) if n)


def unpack(form: TreeHeader, height: int, data: bytes, size: int) -> bytes:
    """Unpacks a segment to a plain one of `size` bytes. `height` is the number of levels from its
    node to the cells."""
    check(len(data) < size <= min(1 << 26, 65536 + 4096 * len(data)), "bytes of a packed segment")
    packing = Packing(form, data)
    packing.read_table(size)
    below = Below(packing, height, form.reach, size)
    counts = below.counts()
    packing.coder.finish()
    read_numbers(form, packing.coder, list(below.blocks.values()))
    plain = below.records() + counts
    check(len(plain) == size and crc32c(plain) == packing.coder.checksum, "checksum of what is unpacked")
    return plain


# Section 41.


class Unpacked(NamedTuple):
    """A packed record of an extent: its height, its representative and its run."""

    height: int
    value: bytes
    run: bytes


def unpack_runs(form: TreeHeader, reach: int, count: int, data: bytes, most: int) -> tuple[list[Unpacked], bytes]:
    """Returns `count` records of an extent, and the bytes other than their runs. `most` limits the
    size of both."""
    packing = Packing(form, data)
    coder, last = packing.coder, NONE
    capacity = coder.number()
    check(capacity <= most, "records are larger than their extent")
    size = coder.number()
    check(size <= capacity, "the bytes between runs are larger than the records")
    side_bytes = bytearray()
    for _ in range(size):
        high = coder.symbol("side byte, high")
        side_bytes.append(high << 4 | coder.symbol(("side byte, low", high)))
    if not packing.continuous:
        packing.read_table(capacity)
    capacity -= size
    heads: list[tuple[int, bytes, Below]] = []
    for _ in range(count):
        height = coder.tree("height", 5)
        check(1 <= height <= form.depth, "a record of no such height")
        if packing.solid:
            value = bytes([coder.raw(8)])
        else:
            last = packing.new([] if last == NONE else [last], True)
            value = packing.samples([last]).tobytes()
        heads.append((height, value, Below(packing, height, reach, capacity, last)))
    coder.finish()
    read_numbers(form, coder, [block for _, _, below in heads for block in below.blocks.values()])
    found = [Unpacked(height, value, below.records()) for height, value, below in heads]
    check(sum(len(run.run) for run in found) == capacity, "runs are of another size than their extent says")
    checked = b"".join(bytes([height]) + value + run for height, value, run in found)
    check(crc32c(checked + side_bytes) == coder.checksum, "checksum of what is unpacked")
    return found, bytes(side_bytes)
