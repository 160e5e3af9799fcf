"""Packed dense blocks of numbers (section 39 of formats.md)."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from basics import check
from coder import Coder, Numbers, multiple, turned, wrap
from trees import CUT, LEAF, VOID, TreeHeader, Values, kids, states_above

Offset = tuple[int, ...]


class Plane(NamedTuple):
    """A child's predictors: siblings with weights, size bits, and children of neighbours with
    strides (x first), one or two with a weight."""

    child: int
    siblings: list[tuple[int, int]]
    bits: int
    near: list[tuple[list[tuple[int, Offset]], int]]

    def defaults(self, axes: int) -> list[int]:
        """Returns the default weights of features."""
        signs = self.signs(axes)
        across = [16 * signs[0] * signs[1]] if axes == 2 else []
        return [16 * sign for sign in signs] + across + [0] * axes + [w for _, w in self.siblings] + [w for _, w in self.near]

    def signs(self, axes: int) -> list[int]:
        return [1 if self.child >> a & 1 else -1 for a in range(axes)]


PLANES = {
    2: [
        Plane(0, [], 0, []),
        Plane(3, [(0, -12)], 5, [([(0, (1, 0)), (0, (0, 1))], 0), ([(0, (1, 1))], 0)]),
        Plane(1, [(0, -4), (3, -8)], 4, [([(0, (1, 0)), (3, (0, -1))], 2), ([(0, (0, 1)), (3, (-1, 0))], 0)]),
        Plane(2, [(0, -8), (3, -8), (1, -11)], 3, [([(0, (0, 1)), (3, (-1, 0))], 1)]),
    ],
    3: [
        Plane(0, [], 0, []),
        Plane(7, [(0, -12)], 5, [([(0, (1, 1, 1))], 0)]),
        Plane(1, [(0, 1), (7, -3)], 4, [([(0, (1, 0, 0))], 2)]),
        Plane(6, [(1, -10), (7, 1)], 3, [([(7, (-1, 0, 0))], 2)]),
        Plane(2, [(0, 1), (7, -1), (6, 1)], 3, [([(0, (0, 1, 0))], 2)]),
        Plane(5, [(2, -10), (7, 1)], 3, [([(7, (0, -1, 0))], 2)]),
        Plane(3, [(7, 4), (1, 4), (2, 4), (0, -4), (6, -4), (5, -4)], 3, [([(7, (0, 0, -1))], 2)]),
        Plane(4, [(3, -11), (0, -2), (7, -2), (1, -2), (6, -2), (2, -2), (5, -2)], 2, [([(0, (0, 0, 1))], 1)]),
    ],
}

# Bottom states of dense blocks, for clear and for set bits.
KINDS = [(VOID, VOID), (LEAF, LEAF), (CUT, CUT), (VOID, LEAF), (VOID, CUT), (LEAF, CUT)]
# The weights of tables, by index.
WEIGHTS = [*range(8), *((4 + k % 4) << k // 4 - 1 for k in range(8, 32))]

# fmt: off
# Default frequencies: of residuals in the first plane, in others, of sums, and of eight.
FIRST = [
    [241, 3, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 10],
    [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 256],
    [212, 23, 15, 2, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2],
    [179, 39, 24, 5, 6, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [132, 53, 41, 10, 11, 4, 3, 1, 0, 0, 0, 0, 0, 0, 0, 1],
    [94, 59, 48, 15, 20, 8, 7, 3, 1, 0, 0, 0, 0, 0, 0, 1],
    [66, 43, 37, 23, 32, 22, 18, 7, 5, 1, 1, 0, 0, 0, 0, 1],
    [41, 30, 27, 20, 35, 27, 32, 18, 14, 5, 4, 1, 1, 0, 0, 1],
    [22, 19, 19, 15, 27, 23, 37, 27, 31, 15, 11, 4, 3, 1, 0, 2],
    [22, 21, 19, 17, 30, 25, 37, 26, 28, 12, 9, 3, 2, 1, 2, 2],
    [22, 20, 19, 17, 31, 25, 37, 24, 27, 12, 10, 5, 4, 1, 1, 1],
    [18, 17, 17, 16, 29, 25, 38, 26, 29, 14, 13, 5, 4, 1, 1, 3],
]
OTHERS = [
    [255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [254, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [252, 2, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [244, 8, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [231, 16, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [162, 59, 29, 3, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [110, 73, 47, 12, 11, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [86, 63, 46, 22, 25, 8, 4, 1, 0, 0, 0, 0, 0, 0, 0, 1],
    [53, 45, 39, 27, 39, 23, 20, 6, 3, 0, 0, 0, 0, 0, 0, 1],
    [58, 49, 38, 29, 38, 20, 16, 5, 2, 0, 0, 0, 0, 0, 0, 1],
    [60, 51, 38, 29, 37, 19, 15, 4, 2, 0, 0, 0, 0, 0, 0, 1],
    [57, 51, 37, 29, 36, 21, 17, 5, 2, 0, 0, 0, 0, 0, 0, 1],
]
SUMS = [
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [65, 60, 49, 58, 13, 6, 3, 1, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [0, 0, 0, 0, 0, 227, 0, 28, 0, 0, 0, 0, 0, 0, 0, 1],
    [57, 56, 37, 76, 7, 16, 1, 5, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [2, 17, 0, 203, 0, 30, 0, 3, 0, 0, 0, 0, 0, 0, 0, 1],
    [50, 54, 29, 101, 5, 13, 1, 2, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [23, 71, 1, 157, 0, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [59, 69, 28, 90, 4, 4, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [253, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [211, 22, 18, 3, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [113, 53, 48, 32, 7, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [71, 3, 119, 0, 60, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [78, 34, 86, 24, 29, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [6, 4, 24, 0, 189, 0, 31, 0, 1, 0, 0, 0, 0, 0, 0, 1],
    [63, 34, 69, 26, 47, 0, 15, 0, 1, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [0, 8, 11, 0, 32, 0, 172, 0, 32, 0, 0, 0, 0, 0, 0, 1],
    [66, 39, 66, 30, 28, 1, 21, 0, 4, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [69, 49, 64, 38, 24, 1, 9, 0, 1, 0, 0, 0, 0, 0, 0, 1],
]
FLATS = [
    [254, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [255, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [255, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
]
# fmt: on


def shifted(values: Values, step: Offset) -> Values:
    """Returns the values at an offset (x first) from each position; values are repeated beyond the
    border."""
    return values[_at(values.shape, step)] if any(step) else values


@cache
def _at(shape: tuple[int, ...], step: Offset) -> tuple[Values, ...]:
    return np.ix_(*[np.clip(np.arange(n) + v, 0, n - 1) for n, v in zip(shape, step[::-1])])


def by_rows(values: Values) -> Values:
    """Returns a group's values in coding order: for each row the first block's, then the next
    block's."""
    return np.swapaxes(values, -1, -2)


def part(child: int, axes: int) -> tuple[slice, ...]:
    """Returns the position of a child among the nodes of its level."""
    return tuple(slice(child >> a & 1, None, 2) for a in reversed(range(axes)))


class Block:
    """A dense block of numbers: values level by level, and bits."""

    def __init__(self, form: TreeHeader, coder: Coder, root: tuple[int, ...], mark: int, deep: int) -> None:
        self.form, self.coder, self.axes, self.root = form, coder, form.axes, root
        clear, bit = KINDS[mark]
        self.may_be_void = mark > 2 and clear == VOID
        self.bits = self._bits(1 << deep) if mark > 2 else np.zeros((1 << deep,) * self.axes, np.uint8)
        self.bottom = np.where(self.bits, bit, clear).astype(np.uint8)
        # Which nodes are VOID, level by level.
        self.void = [self.bottom == VOID]
        for _ in range(deep - 1):
            self.void.insert(0, np.logical_and.reduce(kids(self.void[0], self.axes)))
        self.values: list[Values] = []

    def states(self) -> list[int]:
        """Returns the states of the root's children."""
        states = self.bottom
        for level in reversed(self.values[1:]):
            states = states_above(states, level, self.axes)
        found: list[int] = states.ravel().tolist()
        return found

    def _bits(self, side: int) -> Values:
        """Returns the bits of the bottom nodes, with a border of zeros."""
        b = [[[0] * (side + 3) for _ in range(side + 1)] for _ in range(side + 1 if self.axes == 3 else 2)]
        contexts = [("bit", near) for near in range(64)]
        for plane, before in zip(b[1:], b):
            for row, last, under in zip(plane[1:], plane, before[1:]):
                for x in range(2, side + 2):
                    near = row[x - 1] | row[x - 2] << 1 | last[x - 1] << 2 | last[x] << 3 | last[x + 1] << 4 | under[x] << 5
                    row[x] = self.coder.bit(contexts[near])
        return np.array(b, np.uint8)[1:, 1:, 2:-1].reshape((side,) * self.axes)


def groups_of(blocks: list[Block], axes: int) -> list[list[int]]:
    """Returns the groups of blocks that are coded together: with equal levels, all with VOID nodes
    or all without, and at most 65536 bottom nodes."""
    alike: dict[tuple[int, bool], list[int]] = {}
    for number, block in enumerate(blocks):
        alike.setdefault((-len(block.void), block.may_be_void), []).append(number)
    groups = []
    for (levels, _), numbers in sorted(alike.items()):
        most = max(65536 >> -levels * axes, 1)
        groups += [numbers[at : at + most] for at in range(0, len(numbers), most)]
    return groups


class Bits:
    """Bits from the lowest of the first byte up."""

    def __init__(self, data: bytes, first: int = 0) -> None:
        self.bits, self.at, self.size = int.from_bytes(data, "little"), first, 8 * len(data)

    def take(self, count: int) -> int:
        self.at += count
        check(self.at <= self.size, "bits of dense blocks end too early")
        return self.bits >> self.at - count & (1 << count) - 1

    def finish(self) -> None:
        check(self.size - self.at < 8 and not self.bits >> self.at, "bits of dense blocks are left")


def read_numbers(form: TreeHeader, coder: Coder, blocks: list[Block]) -> None:
    """Reads the numbers of all dense blocks of a coder."""
    if not blocks:
        check(not coder.header and not coder.streams, "numbers of no dense blocks")
        return
    header, streams = Bits(coder.header), Streams(coder.streams)
    order, groups = Numbers(form), groups_of(blocks, form.axes)
    numbers: dict[int, list[list[Values]]] = {}
    samples: dict[int, list[list[Values]]] = {}
    for channel in order.order:
        lanes, power = order.lanes, None
        if form.type.kind == "f" and header.take(1):
            power = wrap(header.take(8), 8)
            lanes = 64 if header.take(1) else 32
        mantissa = np.finfo(form.type).nmant if form.type.kind == "f" and power is None else None
        starts = []
        for block in blocks:
            start = block.root[channel]
            if power is not None:
                start = multiple(order.samples(np.array(start)), power)
            starts.append(start - block.root[1] if channel in order.relative_channels else start)
        reader = Channel(form, header, streams, (lanes, mantissa), [blocks[group[0]] for group in groups])
        numbers[channel], samples[channel] = [[] for _ in blocks], [[] for _ in blocks]
        for group in groups:
            together = reader.group([starts[number] for number in group], [blocks[number] for number in group])
            for at, number in enumerate(group):
                found = [level[..., at] for level in together]
                if channel in order.relative_channels:
                    found = [a + b for a, b in zip(found, numbers[1][number])]
                numbers[channel][number] = found
                samples[channel][number] = [order.samples(level, power) for level in found]
    for number, block in enumerate(blocks):
        block.values = [np.stack(level, -1) for level in zip(*(samples[channel][number] for channel in range(form.channels)))]
        for level, void in zip(block.values, block.void):
            level[void] = 0
    header.finish()
    streams.finish()


class Streams:
    """State bits and raw bits."""

    def __init__(self, data: bytes) -> None:
        check(len(data) >= 13, "streams of dense blocks end too early")
        self.states, size = list(data[:8]), int.from_bytes(data[8:12], "little")
        self.bits, self.raw = Bits(data[13 : 13 + size], data[12] % 32), Bits(data[13 + size :])
        check(13 + size <= len(data), "streams of dense blocks end too early")

    def symbol(self, table: list[tuple[int, int, int]], state: int) -> int:
        symbol, bits, following = table[self.states[state]]
        self.states[state] = following + self.bits.take(bits)
        return symbol

    def finish(self) -> None:
        check(not any(self.states), "last states of dense blocks")
        check(self.bits.at == self.bits.size, "bits of states are left")
        self.raw.finish()


def frequencies(weights: list[int]) -> list[int]:
    """Returns the frequencies of weights."""
    total = sum(weights)
    if not total:
        return [256] + [0] * 15
    found = [max((256 * w + total // 2) // total, 1) if w else 0 for w in weights]
    found[found.index(max(found))] += 256 - sum(found)
    return found


def table_of(found: list[int]) -> list[tuple[int, int, int]]:
    """Returns for each state the symbol, the number of bits that follow, and the next state without
    them."""
    symbols = [0] * 256
    for at, symbol in enumerate(s for s, count in enumerate(found) for _ in range(count)):
        symbols[163 * at % 256] = symbol
    numbers, table = list(found), []
    for symbol in symbols:
        bits = 9 - numbers[symbol].bit_length()
        table.append((symbol, bits, (numbers[symbol] << bits) % 256))
        numbers[symbol] += 1
    return table


class Channel:
    """A channel of all blocks. `firsts` are the first blocks of all groups; the last axis of values
    is the block of a group."""

    def __init__(self, form: TreeHeader, header: Bits, streams: Streams, numbers: tuple[int, int | None], firsts: list[Block]) -> None:
        self.axes, self.mean, self.streams = form.axes, form.rule == "mean", streams
        lanes, self.mantissa = numbers
        self.lanes = lanes
        self.type = np.dtype(f"i{lanes // 8}")
        self.fraction = min(header.take(3) + 2, 6)
        self.weights = [plane.defaults(self.axes) for plane in PLANES[self.axes]]
        if header.take(1):
            self.weights = [[header.take(6) - 32 for _ in weights] for weights in self.weights]
        levels = [len(block.void) for block in firsts]
        self.steps = [header.take(6) if header.take(1) else 0 for count in levels for _ in range(count)]
        check(max(self.steps) < lanes, "numbers of too large a step")
        self.sizes = 16 if lanes == 16 else lanes + 1
        contexts = [rows[min(b, 11)] for rows in (FIRST, OTHERS) for b in range(self.sizes)] + SUMS + FLATS
        for context in range(header.take(8)):
            check(context < len(contexts), "tables of no context")
            if header.take(1):
                last = header.take(4)
                weights = [WEIGHTS[header.take(5)] for _ in range(last + 1)]
                contexts[context] = frequencies(weights + [0] * (15 - last))
        self.tables = [table_of(found) for found in contexts]

    def group(self, roots: list[int], blocks: list[Block]) -> list[Values]:
        """Returns the numbers of a group's blocks, level by level."""
        found = [np.array([wrap(root, self.lanes) for root in roots], self.type).reshape((1,) * self.axes + (-1,))]
        for voids in zip(*(block.void for block in blocks)):
            found.append(self._level(found[-1], np.stack(voids, -1), self.steps.pop(0)))
        return found[1:]

    def _shift(self, values: Values, bits: int) -> Values:
        return values << bits if bits > 0 else values >> -bits

    def _size(self, values: Values) -> Values:
        """Returns absolute values, as numbers whose sums do not overflow: see `_limit`."""
        if self.lanes == 16:
            return np.minimum(np.abs(values.astype("i8")), 32767)
        return np.abs(values).view(f"u{self.lanes // 8}").astype(object)

    def _limit(self, size: Values) -> Values:
        """Returns sums of sizes, which saturate or wrap."""
        return np.minimum(size, 32767) if self.lanes == 16 else size % (1 << self.lanes)

    def _grow(self, size: Values, bits: int) -> Values:
        """Returns a size times a power of two."""
        size = self._limit(size)
        if bits <= 0:
            # In wide lanes a size has a sign here.
            signed = size if self.lanes == 16 else (size + (1 << self.lanes - 1)) % (1 << self.lanes) - (1 << self.lanes - 1)
            return self._limit(signed >> -bits)
        return np.minimum(size, 32767 >> bits) << bits if self.lanes == 16 else self._limit(size << bits)

    def _level(self, parents: Values, void: Values, step: int) -> Values:
        """Returns the numbers of the parents' children."""
        axes, fraction = self.axes, self.fraction
        level, others, unlike = np.zeros(void.shape, self.type), np.zeros_like(parents), np.zeros_like(parents)
        slopes, curved, uneven = [], [], self._size(np.zeros_like(parents))
        for axis in range(axes):
            ahead = tuple(int(a == axis) for a in range(axes))
            up, down = shifted(parents, ahead) - parents, parents - shifted(parents, tuple(-v for v in ahead))
            slopes.append(self._shift(up + down, fraction - 3))
            curved.append(self._shift(up - down, fraction - 3))
            uneven = self._limit(uneven + self._size(up) + self._size(down) + 2 * self._size(up - down))
        even_parts = list(slopes)
        if axes == 2:
            corners = [shifted(parents, corner) for corner in ((1, 1), (-1, 1), (1, -1), (-1, -1))]
            even_parts.append(corners[0] - corners[1] - corners[2] + corners[3] >> 6 - fraction)
        deviations: dict[int, Values] = {}
        planes = PLANES[axes]
        for number, plane in enumerate(planes):
            near = [(pair, [shifted(deviations[child], s) for child, s in pair]) for pair, _ in plane.near]
            own = [deviations[child] for child, _ in plane.siblings]
            features = [[f] for f in even_parts + curved + own] + [rows for _, rows in near]
            prediction, terms, wide = np.zeros_like(parents), 0, "i8" if self.lanes == 16 else self.type
            for rows, weight in zip(features, self.weights[number]):
                for row in rows:
                    prediction = prediction + (row.astype(wide) * weight >> 6).astype(self.type)
                    terms += 1
            of_own = sum((self._size(row) for row in own), self._size(np.zeros_like(parents)))
            of_near = sum((self._size(row) for _, rows in near for row in rows), self._size(np.zeros_like(parents)))
            size = uneven + self._grow(of_own, plane.bits - fraction) + self._grow(of_near, 2 - fraction)
            bits = np.vectorize(lambda size: int(size).bit_length(), otypes=[int])(self._limit(size))
            is_last = self.mean and number + 1 == len(planes)
            summed = ~np.logical_or.reduce(kids(void, axes)) if is_last else np.zeros(parents.shape, bool)
            if self.mantissa is not None:
                summed &= unlike >> self.mantissa == 0
            expected, contexts = self._expect(number, step, parents, others, prediction, terms, bits, summed)
            plain, group = (2 * self.sizes + 16, 2) if is_last and not step else (self.sizes * min(number, 1), min(number, 1))
            here = part(plane.child, axes)
            there = by_rows(~void[here])
            differences = np.zeros_like(parents)
            found = self._read(by_rows(contexts)[there].tolist(), plain, 2 * self.sizes + 36 + group)
            by_rows(differences)[there] = by_rows(expected)[there] + (np.array(found, "O").astype(self.type) << step)
            even = np.zeros_like(parents)
            signs = plane.signs(axes)
            for sign, row in zip([*signs, signs[0] * signs[1]], even_parts):
                even = even + sign * row
            deviations[plane.child], others = (differences << fraction) - even, others + differences
            level[here] = parents + differences
            unlike |= level[here] ^ parents
        return level

    def _expect(
        self, number: int, step: int, parents: Values, others: Values, prediction: Values, terms: int, bits: Values, summed: Values
    ) -> tuple[Values, Values]:
        """Returns the expected differences of children from their parents, and contexts."""
        first, s = self.sizes * min(number, 1), self.fraction - 2
        expected = prediction + self.type.type(((1 << s) >> 1) + terms // 2) >> s
        sums = (others << s) + prediction + self.type.type((1 << max(s - 1, 0) >> 1) + terms // 2) << 1 >> s
        if not step:
            contexts = 2 * self.sizes + 16 + 4 * np.clip(sums, -4, 4).astype(int) + np.minimum(bits // 2, 3)
            return np.where(summed, -others, expected), np.where(summed, contexts, first + bits)
        nearest = np.where(summed, parents - others, parents + expected) + self.type.type(1 << step - 1) >> step << step
        return nearest - parents, np.where(summed, first, first + np.maximum(bits - step, 0))

    def _read(self, contexts: list[int], plain: int, eight: int) -> list[int]:
        """Returns the numbers of a plane, given their contexts."""
        streams, tables = self.streams, self.tables
        symbols = [0] * len(contexts)
        whole = len(contexts) // 8 * 8
        for at in range(0, whole, 8):
            if contexts[at : at + 8] == [plain] * 8 and not streams.symbol(tables[eight], 0):
                for lane in range(8):
                    symbols[at + lane] = -1
                continue
            for lane in range(8):
                symbols[at + lane] = streams.symbol(tables[contexts[at + lane]], lane)
        for at in range(whole, len(contexts)):
            symbols[at] = streams.symbol(tables[contexts[at]], 0)
        found = []
        for symbol, context in zip(symbols, contexts):
            is_residual = context < 2 * self.sizes
            noise = max(context % self.sizes - 8, 0) if is_residual else 0
            if symbol < 0:
                upper, raw = 0, 0
            elif symbol == 15:
                upper, raw = 0, self.lanes
            elif symbol < 4 or not is_residual:
                upper, raw = symbol, noise
            else:
                upper, raw = 2 | symbol & 1, symbol // 2 - 1 + noise
            found.append(wrap(turned(upper << raw | streams.raw.take(raw)), self.lanes))
        return found
