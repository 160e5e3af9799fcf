"""Packed dense blocks of numbers (section 39 of formats.md)."""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from basics import check
from coder import Coder, Numbers, context_of, multiple, starts, wrap
from trees import CUT, LEAF, VOID, Form, Values, kids, states_above

ViewStep = tuple[int, ...]


class Weights(NamedTuple):
    """A plane: the child, its siblings with weights, their factor, and children of neighbours with steps (x first) and weights."""

    child: int
    siblings: list[tuple[int, int]]
    factor: int
    near: list[tuple[int, ViewStep, int]]

    def weights(self, axes: int) -> list[tuple[int, ViewStep, int]]:
        """All of them, siblings with a step to where they are."""
        return [(child, (0,) * axes, weight) for child, weight in self.siblings] + self.near


PLANES = {
    2: [
        Weights(0, [], 0, []),
        Weights(3, [(0, -12)], 32, [(0, (1, 0), 0), (0, (0, 1), 0), (0, (1, 1), 0)]),
        Weights(1, [(0, -4), (3, -8)], 16, [(0, (1, 0), 2), (3, (0, -1), 2)]),
        Weights(2, [(0, -8), (3, -8), (1, -11)], 11, [(0, (0, 1), 1), (3, (-1, 0), 1)]),
    ],
    3: [
        Weights(0, [], 0, []),
        Weights(7, [(0, -12)], 32, [(0, (1, 1, 1), 0)]),
        Weights(1, [(0, 1), (7, -3)], 16, [(0, (1, 0, 0), 2)]),
        Weights(6, [(1, -10), (7, 1)], 11, [(7, (-1, 0, 0), 2)]),
        Weights(2, [(0, 1), (7, -1), (6, 1)], 11, [(0, (0, 1, 0), 2)]),
        Weights(5, [(2, -10), (7, 1)], 8, [(7, (0, -1, 0), 2)]),
        Weights(3, [(7, 4), (1, 4), (2, 4), (0, -4), (6, -4), (5, -4)], 6, [(7, (0, 0, -1), 2)]),
        Weights(4, [(3, -11), (0, -2), (7, -2), (1, -2), (6, -2), (2, -2), (5, -2)], 5, [(0, (0, 0, 1), 1)]),
    ],
}


def shifted(values: Values, step: ViewStep) -> Values:
    """Of each place the value at a step (x first) from it; beyond the border, values are repeated."""
    return values[_at(values.shape, step)] if any(step) else values


@cache
def _at(shape: tuple[int, ...], step: ViewStep) -> tuple[Values, ...]:
    return np.ix_(*[np.clip(np.arange(n) + v, 0, n - 1) for n, v in zip(shape, step[::-1])])


# fmt: off
# Lengths of symbols of sums, by the number of halves from -4 to 4.
SUMS = [
    [2245, 25, 27, 34, 63, 202, 6857, 7184, 7488, 6157, 1612, 271, 39, 32, 37, 495],
    [52, 10, 20, 34, 289, 1224, 9691, 7628, 7371, 5230, 924, 178, 19, 12, 16, 70],
    [32, 11, 11, 18, 133, 1328, 12848, 7206, 6215, 4048, 694, 130, 18, 14, 13, 49],
    [23, 10, 11, 11, 36, 423, 10806, 9394, 7511, 3742, 620, 117, 16, 11, 10, 27],
    [16, 10, 10, 10, 15, 70, 1992, 3554, 22706, 3640, 589, 99, 15, 11, 10, 21],
    [21, 10, 10, 11, 18, 75, 3066, 4380, 8940, 11078, 4463, 602, 39, 12, 11, 32],
    [33, 11, 12, 11, 17, 72, 3762, 4872, 7482, 8752, 5635, 1861, 151, 23, 12, 62],
    [53, 11, 12, 12, 19, 79, 4488, 5759, 8770, 8719, 2745, 1663, 297, 36, 14, 91],
    [255, 26, 26, 29, 32, 106, 4790, 6454, 8444, 8104, 2473, 544, 78, 55, 43, 1309],
]
# fmt: on
SUM_STARTS = [starts(row) for row in SUMS]

# States of the bottom nodes of dense blocks whose bit is not set, and is.
KINDS = [(VOID, VOID), (LEAF, LEAF), (CUT, CUT), (VOID, LEAF), (VOID, CUT), (LEAF, CUT)]


def part(child: int, axes: int) -> tuple[slice, ...]:
    """Where a child stands among the nodes of its level."""
    return tuple(slice(child >> a & 1, None, 2) for a in reversed(range(axes)))


class Block:
    """A dense block of numbers: values level by level, the states of the root's children, and bits."""

    def __init__(self, form: Form, coder: Coder, root: tuple[int, ...], mark: int, deep: int) -> None:
        self.form, self.coder, self.axes, self.numbers = form, coder, form.axes, Numbers(form)
        clear, bit = KINDS[mark]
        self.bits = self._bits(1 << deep) if mark > 2 else np.zeros((1 << deep,) * self.axes, np.uint8)
        states = np.where(self.bits, bit, clear).astype(np.uint8)
        # Where nodes are VOID, level by level.
        self.void = [states == VOID]
        for _ in range(deep - 1):
            self.void.insert(0, np.logical_and.reduce(kids(self.void[0], self.axes)))
        numbers: list[list[Values]] = [[] for _ in root]
        samples = numbers.copy()
        for channel in self.numbers.order:
            start, power = root[channel], None
            if channel in self.numbers.told:
                start -= root[1]
            elif form.type.kind == "f" and coder.bit(("power", channel)):
                power = wrap(coder.raw(8), 8)
                start = multiple(self.numbers.samples(np.array(start)), power)
            found = self._channel(channel, start)
            if channel in self.numbers.told:
                found = [a + b for a, b in zip(found, numbers[1])]
            numbers[channel] = found
            samples[channel] = [self.numbers.samples(level, power) for level in found]
        self.values = [np.stack(level, -1) for level in zip(*samples)]
        for level, void in zip(self.values, self.void):
            level[void] = 0
        for level in reversed(self.values[1:]):
            states = states_above(states, level, self.axes)
        self.states: list[int] = states.ravel().tolist()

    def _bits(self, side: int) -> Values:
        """Bits of the bottom nodes. (Around them is a border of zeros.)"""
        b = [[[0] * (side + 3) for _ in range(side + 1)] for _ in range(side + 1 if self.axes == 3 else 2)]
        contexts = [("bit", near) for near in range(64)]
        for plane, before in zip(b[1:], b):
            for row, last, under in zip(plane[1:], plane, before[1:]):
                for x in range(2, side + 2):
                    near = row[x - 1] | row[x - 2] << 1 | last[x - 1] << 2 | last[x] << 3 | last[x + 1] << 4 | under[x] << 5
                    row[x] = self.coder.bit(contexts[near])
        return np.array(b, np.uint8)[1:, 1:, 2:-1].reshape((side,) * self.axes)

    def _channel(self, channel: int, root: int) -> list[Values]:
        """Numbers of a channel, level by level."""
        found = [np.full((1,) * self.axes, wrap(root, self.numbers.bits), self.numbers.type)]
        for void in self.void:
            found.append(self._level(channel, found[-1], void))
        return found[1:]

    def _level(self, channel: int, parents: Values, void: Values) -> Values:
        """Numbers of the children of parents."""
        step = self.coder.raw(6) if self.coder.bit(("step", channel)) else 0
        check(step < self.numbers.bits, "numbers of too large a step")
        level, zeros = np.zeros(void.shape, self.numbers.type), np.zeros_like(parents)
        near = {step: shifted(parents, step) - parents for step in product((-1, 0, 1), repeat=self.axes)}
        uneven = unevenness(near, self.axes)
        wrong: dict[int, Values] = {}
        others = zeros
        for number, plane in enumerate(PLANES[self.axes]):
            even = evenly(near, plane.child, self.axes)
            expected = sum((weight * shifted(wrong[child], step) for child, step, weight in plane.weights(self.axes)), zeros)
            size = sum((np.abs(wrong[child]).view(uneven.dtype) * plane.factor for child, _ in plane.siblings), np.zeros_like(uneven))
            size = size + sum(4 * np.abs(shifted(wrong[child], step)).view(uneven.dtype) for child, step, _ in plane.near)
            empty = void[part(plane.child, self.axes)]
            summed = np.zeros_like(empty)
            if plane is PLANES[self.axes][-1] and self.form.rule == "mean":
                summed = ~np.logical_or.reduce(kids(void, self.axes))
            rows = [v.ravel().tolist() for v in (parents, even + (expected >> 4), uneven + (size >> 6), empty, summed, others)]
            found = [self._difference((channel, number), step, *of) for of in zip(*rows)]
            differences = np.array(found, parents.dtype).reshape(parents.shape)
            wrong[plane.child], others = 64 * differences - even, others + differences
            level[part(plane.child, self.axes)] = parents + differences
        return level

    def _difference(self, key: tuple[int, int], step: int, parent: int, expected: int, size: int, empty: bool, summed: bool, others: int) -> int:
        """How a child differs from its parent; `others` is what its siblings' differences add up to."""
        if empty:
            return 0
        bits, context = self.numbers.bits, context_of(size)
        whole = wrap(expected + 32, bits) >> 6
        if step:
            whole, context = (-others, 0) if summed else (whole, max(context - 2 * step, 0))
            nearest = wrap(parent + whole + (1 << step - 1), bits) >> step << step
            return wrap(nearest + (self.coder.error(("error", *key), context) << step) - parent, bits)
        if not summed:
            return wrap(whole + self.coder.error(("error", *key), context), bits)
        halves = min(max(wrap(64 * others + expected + 16, bits) >> 5, -4), 4)
        symbol = self.coder.symbol(("sum", key[0], halves, min(max(context >> 1, 1), 8)), SUM_STARTS[halves + 4])
        return wrap((symbol - 8 if symbol else self.coder.signed()) - others, bits)


def unevenness(near: dict[ViewStep, Values], axes: int) -> Values:
    """Of parents, by how their neighbours differ from them. Sizes have no sign."""
    size = lambda v: np.abs(v).view(f"u{v.itemsize}")  # noqa: E731
    found: Values = np.zeros_like(size(near[(0,) * axes]))
    for before, after in ends(axes):
        e, w = near[after], -near[before]
        found += size(e) + size(w) + 2 * size(e - w)
    if axes == 2:
        corners = [size(near[x, y]) for x, y in product((-1, 1), repeat=2)]
        found += corners[0] + corners[1] + corners[2] + corners[3] >> 1
    return found


def evenly(near: dict[ViewStep, Values], child: int, axes: int) -> Values:
    """The even differences of a child from its parents."""
    signs = [1 if child >> a & 1 else -1 for a in range(axes)]
    found: Values = np.zeros_like(near[(0,) * axes])
    for sign, (before, after) in zip(signs, ends(axes)):
        found += 8 * sign * (near[after] - near[before])
    if axes == 2:
        found += signs[0] * signs[1] * (near[1, 1] - near[-1, 1] - near[1, -1] + near[-1, -1])
    return found


def ends(axes: int) -> list[tuple[ViewStep, ViewStep]]:
    """The steps back and forth along each axis."""
    steps = [tuple(int(a == b) for b in range(axes)) for a in range(axes)]
    return [(tuple(-v for v in step), step) for step in steps]
