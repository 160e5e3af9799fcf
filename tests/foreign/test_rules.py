"""The rules of section 13, which the frozen files cover only partially: rules.py, for all nodes at
once, against a node-by-node computation."""

from __future__ import annotations

import math
import random
import struct
from collections import Counter
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from basics import GOBLIN, Code, Header
from rules import Pyramid, same
from trees import INNER, LEAF, RULES, SAMPLES, VOID, Statistics, TreeHeader, raw_bits

LACK = 3


def form(axes: int, sample: int, channels: int, rule: int, depth: int, mask: int) -> TreeHeader:
    lack = np.array([LACK], SAMPLES[sample]).tobytes() if mask == 1 else b""
    raw = struct.pack("<8BIB3x8s3Q", sample, channels, rule, 0, 0, depth, 6, 2, 100, mask, lack, *[1 << depth] * 2, 1 << depth * (axes - 2))
    return TreeHeader(raw, Header(GOBLIN, axes, 0, depth, 1))


def pair(h: float, l: float) -> tuple[float, float]:
    s = h + l
    return (s, l - (s - h)) if math.isfinite(s) else (s, 0.0)


def two(a: float, b: float) -> tuple[float, float]:
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def triple(h: float, m: float, l: float) -> tuple[float, float, float]:
    start = h
    for _ in range(2):
        m, l = m + l, l - ((m + l) - m)
        h, m = h + m, m - ((h + m) - h)
    m, l = m + l, l - ((m + l) - m)
    return (h, m, l) if math.isfinite(h) else (start, 0.0, 0.0)


def add(a: Any, b: Any) -> Any:
    if not isinstance(a, tuple):
        return a + b
    s = a[0] + b[0]
    if not math.isfinite(s):
        return s, *(0.0 for _ in a[1:])
    if len(a) == 3:
        (s, e), (t, f) = two(a[0], b[0]), two(a[1], b[1])
        t, g = two(t, e)
        return triple(s, t, (a[2] + b[2]) + (f + g))
    d = s - a[0]
    return pair(s, ((a[0] - (s - d)) + (b[0] - d)) + (a[1] + b[1]))


def square(x: float) -> tuple[float, float]:
    t = x * 134217729.0
    u = t - (t - x)
    v, p = x - u, x * x
    e = v * v - (((p - u * u) - v * u) - u * v)
    return pair(p, e if math.isfinite(e) else 0.0)


class Node:
    """A node, made of its children or of a cell; missing samples are None."""

    cells: int
    inner: int
    size: int
    sums: list[Any]
    squares: list[Any]
    value: tuple[Any, ...] | None

    def __init__(self, f: TreeHeader, below: "list[Node]", cell: tuple[Any, ...] | None) -> None:
        self.f = f
        self.cells = sum(n.cells for n in below) if below else int(cell is not None)
        self.samples: list[list[Any]] = [[v for n in below for v in n.samples[c]] for c in range(f.channels)]
        self.all: Counter[Any] = sum((n.all for n in below), Counter())
        self.inner, self.size = sum(n.inner for n in below), sum(n.size for n in below) or 1
        self.sums = [self._sum([n.sums[c] for n in below]) for c in range(f.channels)] if below else []
        self.squares = [self._sum([n.squares[c] for n in below]) for c in range(f.channels)] if below else []
        self.value = cell
        if not below:
            for c in range(f.channels):
                x = cell[c] if cell is not None and counts(f, cell) else None
                self.samples[c] = [] if x is None else [x]
                floating = f.type.kind == "f"
                self.sums.append(((float(x) + 0.0 if x is not None else 0.0), 0.0) if floating else x or 0)
                self.squares.append(self._square(x))
            self.all = Counter() if cell is None else Counter([tuple(key(x) for x in cell)])
            self.state = VOID if cell is None else LEAF
        elif not self.cells:
            self.state = VOID
        elif all(n.state == LEAF and str(n.value) == str(below[0].value) for n in below):
            self.state, self.value = LEAF, below[0].value
        else:
            self.state, self.inner, self.value = INNER, self.inner + 1, self._representative(below)

    def _sum(self, parts: list[Any]) -> Any:
        while len(parts) > 1:
            parts = [add(parts[i], parts[i + 1]) for i in range(0, len(parts), 2)]
        return parts[0]

    def _square(self, x: Any) -> Any:
        if self.f.type.kind == "f":
            x = 0.0 if x is None else float(x)
            return (x * x, 0.0) if self.f.type.itemsize == 4 else (*square(x), 0.0)
        return (x or 0) ** 2

    def _representative(self, below: "list[Node]") -> tuple[Any, ...] | None:
        rule, there = self.f.rule, [n for n in below if n.state != VOID]
        if rule == "nearest":
            return there[0].value
        if rule == "majority":
            most = max(self.all.values())
            tied = [v for v in sorted(self.all) if self.all[v] == most]
            deciding = [tuple(key(x) for x in n.value or ()) for n in there]
            mixed = most
            for n in there:
                raw = n.bits().ljust(16, b"\0")
                mixed = (mixed ^ int.from_bytes(raw[:8], "little") ^ int.from_bytes(raw[8:], "little")) * 0x9E3779B97F4A7C15 % 2**64
                mixed ^= mixed >> 32
            chosen = next((v for v in deciding if v in tied), tied[mixed % len(tied)])
            return next((n.value for n in there if tuple(key(x) for x in n.value or ()) == chosen), tuple(x for x, _ in chosen))
        if rule == "dominant":
            weights: Counter[str] = Counter()
            for n in there:
                weights[str(n.value)] += 3 if n.state == LEAF else 2
            return max(there, key=lambda n: weights[str(n.value)]).value
        return tuple(self._sample(rule, c, [n.value[c] for n in there if n.value and n.value[c] is not None and counts(self.f, n.value)]) for c in range(self.f.channels))

    def _sample(self, rule: str, c: int, of: list[Any]) -> Any:
        if rule in ("min", "max"):
            return (min if rule == "min" else max)(of, key=key) if of else None
        n = len(self.samples[c]) if rule == "mean" else self.size
        if not n:
            return None
        if self.f.type.kind == "f":
            return float(np.float64(self.sums[c][0] / n).astype(self.f.type))
        return math.floor(Fraction(self.sums[c], n) + Fraction(1, 2))

    def bits(self) -> bytes:
        samples = self.value if self.value is not None else (0,) * self.f.channels
        lack = LACK if self.f.missing else 0
        return np.array([lack if x is None else x for x in samples], self.f.type).tobytes()


def counts(f: TreeHeader, cell: tuple[Any, ...]) -> bool:
    """Whether a cell's samples count, i.e. it is not transparent."""
    return not f.alpha or bool(cell[-1])


def key(x: Any) -> Any:
    """Returns the sort key of section 7: -0.0 before 0.0. Missing samples are the nodata value."""
    return (LACK, 1) if x is None else (x, math.copysign(1, x))


@pytest.mark.parametrize("sample", [number for number, name in enumerate(SAMPLES) if name])
@pytest.mark.parametrize("rule", range(len(RULES)))
def test_all_nodes_at_once_and_each_by_itself(sample: int, rule: int) -> None:
    rng = random.Random(sample * 10 + rule)
    for axes, depth, channels, mask in ((2, 3, 1, 0), (3, 2, 1, 0), (2, 3, 2, 1), (3, 2, 2, 1), (2, 3, 2, 2), (3, 2, 2, 2)):
        if channels > 1 and sample not in (0, 1, 5):
            continue
        f = form(axes, sample, channels, rule, depth, mask)
        choice: list[Any] = [0, 1, 2, 5, 100]
        if f.type.kind == "i":
            choice += [-1, -7, int(np.iinfo(f.type).min)]
        if f.type.kind == "f":
            choice += [float(np.array(v, f.type)) for v in (0.1, -0.7, 1e17, -0.0, 1e-30)]
        if f.type.kind != "f":
            choice += [int(np.iinfo(f.type).max)]
        some = rng.sample(choice, 3)
        size = (1 << depth,) * axes
        values, states = np.zeros((*size, channels), f.type), np.zeros(size, np.uint8)
        cells: dict[Any, Any] = {}
        for at in np.ndindex(*size):
            # Occasionally all of a node of level 1 has one value.
            block = random.Random(f"{at[0] >> depth - 1} {at[-1] >> depth - 1} {sample} {rule}").random() < 0.3
            cell = (some[0],) * channels if block else tuple(None if mask == 1 and rng.random() < 0.3 else rng.choice(some) for _ in range(channels))
            if not block and rng.random() < 0.3 or all(x is None for x in cell):
                continue
            cells[at[::-1]] = cell
            values[at], states[at] = [LACK if x is None else x for x in cell], LEAF
        pyramid = Pyramid(f, values, states)

        def make(node: Code) -> Node:
            steps = [tuple(i >> a & 1 for a in range(axes)) for i in range(1 << axes)] if node.level < depth else []
            below = [make(Code(node.level + 1, tuple(2 * v + b for v, b in zip(node.at, step)))) for step in steps]
            found = Node(f, below, cells.get(node.at) if node.level == depth else None)
            level, at = pyramid.levels[node.level], node.at[::-1]
            assert level.states[at] == found.state and level.nodes[at] == found.inner
            assert level.values[at].tobytes() == found.bits(), (node, level.values[at], found.value)
            extremes = [[kind(of, key=key) if of else 0 for of in found.samples] for kind in (min, max)]
            least, most = (np.array(e, f.type) for e in extremes)
            expected = Statistics(found.cells, least, most, found.sums, found.squares, [len(of) for of in found.samples])
            assert same(pyramid.statistics(node), expected), (node, pyramid.statistics(node), expected)
            classes = [(np.array([x for x, _ in v], f.type).tobytes(), n) for v, n in sorted(found.all.items())]
            assert pyramid.classes_of(node) == classes
            return found

        make(Code(0, (0,) * axes))
        assert (raw_bits(pyramid.levels[depth].values) == raw_bits(values)).all()
