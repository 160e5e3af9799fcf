"""The rules of section 13: nodes, representatives and statistics of a tree, computed from its
cells."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from basics import Code
from numpy.typing import NDArray
from trees import INNER, LEAF, VOID, Statistics, TreeHeader, Values, kids, raw_bits, states_above

Array = NDArray[Any]
Pair = tuple[Array, Array]


def keys(values: Values) -> Array:
    """Returns sort keys in the order of section 7: by value, for floating-point values the total
    order."""
    if values.dtype.kind != "f":
        return values
    bits = np.ascontiguousarray(values).view(f"i{values.dtype.itemsize}")
    return bits ^ (bits >> 8 * values.dtype.itemsize - 1 & np.iinfo(bits.dtype).max)


# Double-double and triple-double numbers.


def pair(h: Array, l: Array) -> Pair:
    s = h + l
    finite = np.isfinite(s)
    return s, np.where(finite, l - (s - h), 0.0)


def two(a: Array, b: Array) -> Pair:
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def first(a: Array, b: Array) -> Pair:
    s = a + b
    return s, b - (s - a)


def triple(h: Array, m: Array, l: Array) -> tuple[Array, Array, Array]:
    start = h
    for _ in range(2):
        m, l = first(m, l)
        h, m = first(h, m)
    m, l = first(m, l)
    finite = np.isfinite(h)
    return np.where(finite, h, start), np.where(finite, m, 0.0), np.where(finite, l, 0.0)


def add(a: Any, b: Any) -> Any:
    """Returns the sum of two numbers with as many components."""
    if len(a) == 3:
        (h, m, l), (H, M, L) = a, b
        s, e = two(h, H)
        t, f = two(m, M)
        u, g = two(t, e)
        return triple(s, u, (l + L) + (f + g))
    (h, l), (H, L) = a, b
    s = h + H
    finite = np.isfinite(s)
    b_ = s - h
    high, low = pair(s, ((h - (s - b_)) + (H - b_)) + (l + L))
    return np.where(finite, high, s), np.where(finite, low, 0.0)


def square(x: Array) -> Pair:
    """Returns the square of an `f64`."""
    t = x * 134217729.0
    u = t - (t - x)
    v = x - u
    p = x * x
    e = v * v - (((p - u * u) - v * u) - u * v)
    return pair(p, np.where(np.isfinite(e), e, 0.0))


def squares_of(values: Values, there: Array) -> tuple[Array, ...]:
    """Returns the squares of floating-point samples, in components."""
    x = np.where(there, values.astype(np.float64), 0.0)
    zero = np.zeros(x.shape)
    return (x * x, zero) if values.dtype.itemsize == 4 else (*square(x), zero)


def fold(parts: list[Any], plus: Any) -> Any:
    """Returns the sum of children, added in pairs."""
    while len(parts) > 1:
        parts = [plus(parts[i], parts[i + 1]) for i in range(0, len(parts), 2)]
    return parts[0]


def best(below: list[tuple[Values, Array]], maximum: bool) -> tuple[Values, Array]:
    """Returns the smallest or largest samples of children, and whether there are any."""
    found, there = below[0]
    for values, has in below[1:]:
        better = keys(values) > keys(found) if maximum else keys(values) < keys(found)
        found = np.where(has & (better | ~there), values, found)
        there = there | has
    return found, there


class Level:
    """The statistics of one level's nodes, each an array by z, y, x (and channel)."""

    states: Array
    values: Values
    cells: Array
    present: Array
    sums: Any
    squares: Any
    least: tuple[Values, Array]
    most: tuple[Values, Array]
    counts: Array
    nodes: Array


class Pyramid:
    """All levels of a tree, computed from its cells."""

    def __init__(self, form: TreeHeader, cells: Values, states: Array) -> None:
        self.form = form
        wide = form.type.kind != "f" and 16 * form.type.itemsize + form.axes * form.depth > 62
        self.whole: Any = object if wide else np.int64
        self.classes = np.empty((0, form.channels), form.type)
        with np.errstate(all="ignore"):
            self.levels = [self._cells(cells, states)]
            for _ in range(form.depth):
                self.levels.insert(0, self._above(self.levels[0], len(self.levels)))

    def _cells(self, values: Values, states: Array) -> Level:
        f, found = self.form, Level()
        there = np.repeat((states != VOID)[..., None], f.channels, -1)
        if f.missing:
            lack = np.frombuffer(f.lack[: f.type.itemsize], f.type)
            there &= raw_bits(values) != raw_bits(lack)
        if f.alpha:
            there &= values[..., -1:] != 0
        found.states, found.values = states, values
        found.cells, found.nodes = (states != VOID).astype(np.int64), np.zeros(states.shape, np.int64)
        found.present = there.astype(np.int64)
        floating = f.type.kind == "f"
        if floating:
            found.sums = (np.where(there, values.astype(np.float64) + 0.0, 0.0), np.zeros(values.shape))
        else:
            found.sums = np.where(there, values.astype(self.whole), 0)
        found.squares = squares_of(values, there) if floating else found.sums * found.sums
        zero = np.where(there, values, np.zeros(1, f.type))
        found.least = found.most = zero, there
        if f.classes:
            flat = keys(values)[states != VOID]
            order = np.unique(flat, axis=0, return_index=True)[1]
            self.classes = values[states != VOID][order]
            each = [(raw_bits(values) == raw_bits(c)).all(-1) & (states != VOID) for c in self.classes]
            found.counts = np.array(each, np.int64).reshape(len(each), *states.shape)
        return found

    def _above(self, below: Level, depth: int) -> Level:
        f, axes, found = self.form, self.form.axes, Level()
        of = lambda a: kids(a, axes)  # noqa: E731
        plain = lambda a: np.add.reduce(of(a))  # noqa: E731
        parts = lambda p: fold(list(zip(*(of(part) for part in p))), add)  # noqa: E731
        found.states = states_above(below.states, below.values, axes)
        found.cells, found.present = plain(below.cells), plain(below.present)
        found.nodes = plain(below.nodes) + (found.states == INNER)
        found.sums = parts(below.sums) if isinstance(below.sums, tuple) else plain(below.sums)
        found.squares = parts(below.squares) if isinstance(below.squares, tuple) else plain(below.squares)
        found.least = best(list(zip(of(below.least[0]), of(below.least[1]))), False)
        found.most = best(list(zip(of(below.most[0]), of(below.most[1]))), True)
        if f.classes:
            found.counts = np.array([plain(c) for c in below.counts]).reshape(len(below.counts), *found.states.shape)
        values = self._representatives(found, below, depth)
        leaves, void = found.states == LEAF, found.states == VOID
        values = np.where(leaves[..., None], of(below.values)[0], values)
        found.values = np.where(void[..., None], np.zeros(1, f.type), values)
        return found

    def _representatives(self, found: Level, below: Level, depth: int) -> Values:
        f = self.form
        values, states = kids(below.values, f.axes), kids(below.states, f.axes)
        if f.rule in ("mean", "occupancy"):
            n = found.present if f.rule == "mean" else np.full_like(found.present, f.children**depth)
            some = np.maximum(n, 1)
            if isinstance(found.sums, tuple):
                mean = (found.sums[0] / some).astype(f.type)
                nan = np.array([0x7FC00000 if f.type.itemsize == 4 else 0x7FF8000000000000], f"<u{f.type.itemsize}")
                mean = np.where(np.isnan(mean), nan.view(f.type), mean)
            else:
                some = some.astype(self.whole)
                mean = ((2 * found.sums + some) // (2 * some)).astype(f.type)
            return np.where(n > 0, mean, self._lack())
        if f.rule in ("min", "max"):
            kept, there = found.least if f.rule == "min" else found.most
            return np.where(there, kept, self._lack())
        if f.rule == "majority":
            return self._majorities(found, values, states) if len(self.classes) else values[0]
        weights = [np.where(s == LEAF, 3, np.where(s == VOID, 0, 2)) for s in states]
        if f.rule == "nearest":
            choice = (np.array(weights) > 0).argmax(0)
        else:
            same = lambda a, b: (raw_bits(a) == raw_bits(b)).all(-1)  # noqa: E731
            totals = [(s > 0) * sum(w * same(a, b) for b, w in zip(values, weights)) for a, s in zip(values, states)]
            choice = np.array(totals).argmax(0)
        return np.take_along_axis(np.array(values), choice[None, ..., None], 0)[0]

    def _majorities(self, found: Level, values: list[Values], states: list[Array]) -> Values:
        """Returns, of the tied classes, the first child's that has one of them, otherwise one
        chosen by a hash of the children's values."""
        most = found.counts.max(0)
        tied = found.counts == most
        ties = tied.sum(0)
        with np.errstate(all="ignore"):
            mixed = most.astype(np.uint64)
            for value, state in zip(values, states):
                parts = np.zeros((*state.shape, 16), np.uint8)
                raw = np.ascontiguousarray(value).view(np.uint8)
                parts[..., : raw.shape[-1]] = raw
                words = parts.view("<u8")
                new = (mixed ^ words[..., 0] ^ words[..., 1]) * np.uint64(0x9E3779B97F4A7C15)
                mixed = np.where(state == VOID, mixed, new ^ (new >> np.uint64(32)))
        # The chosen class among the tied ones.
        chosen = (mixed % np.maximum(ties, 1).astype(np.uint64)).astype(np.int64)
        turn = np.cumsum(tied, 0) - 1
        number = (tied & (turn == chosen)).argmax(0)
        for value, state in reversed(list(zip(values, states))):
            own = np.array([(raw_bits(value) == raw_bits(c)).all(-1) for c in self.classes]) & tied & (state != VOID)
            number = np.where(own.any(0), own.argmax(0), number)
        return self.classes[number]

    def _lack(self) -> Values:
        f = self.form
        return np.frombuffer(f.lack[: f.type.itemsize], f.type) if f.missing else np.zeros(1, f.type)

    def counts(self) -> list[tuple[int, int, int]]:
        """Returns the VOID, LEAF and INNER nodes per level, down to the deepest non-empty level."""
        found, nodes = [], np.ones(self.levels[0].states.shape, bool)
        for level in self.levels:
            states = level.states[nodes]
            if not len(states):
                break
            found.append((int((states == VOID).sum()), int((states == LEAF).sum()), int((states == INNER).sum())))
            inner = nodes & (level.states == INNER)
            for axis in range(self.form.axes):
                inner = np.repeat(inner, 2, axis)
            nodes = inner
        return found

    def statistics(self, node: Code) -> Statistics:
        """Returns the statistics that a segment index must have for a node."""
        level, at = self.levels[node.level], node.at[::-1]
        zero = np.zeros(1, self.form.type)
        least, most = (np.where(there[at], kept[at], zero) for kept, there in (level.least, level.most))
        return Statistics(int(level.cells[at]), least, most, self._sums(level.sums, at), self._sums(level.squares, at), level.present[at].tolist())

    def classes_of(self, node: Code) -> list[tuple[bytes, int]]:
        """Returns the class counts of a node."""
        at: Any = (slice(None), *node.at[::-1])
        counts = self.levels[node.level].counts[at]
        return [(c.tobytes(), int(n)) for c, n in zip(self.classes, counts) if n]

    @staticmethod
    def _sums(sums: Any, at: tuple[int, ...]) -> list[Any]:
        if not isinstance(sums, tuple):
            return [int(v) for v in sums[at]]
        numbers = [tuple(float(part) for part in number) for number in zip(*(part[at] for part in sums))]
        return [(float("nan"), *(0.0 for _ in rest)) if high != high else (high, *rest) for high, *rest in numbers]


def same(a: Statistics, b: Statistics) -> bool:
    """Whether statistics are bit-identical."""
    bits = lambda sums: [struct.pack(f"<{len(s)}d", *s) if isinstance(s, tuple) else s for s in sums]  # noqa: E731
    return (
        (a.cells, a.present, bits(a.sums), bits(a.squares)) == (b.cells, b.present, bits(b.sums), bits(b.squares))
        and (raw_bits(a.least) == raw_bits(b.least)).all()
        and bool((raw_bits(a.most) == raw_bits(b.most)).all())
    )
