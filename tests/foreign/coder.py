"""The coder of packed segments and extents (section 37 of formats.md), and residuals (section
38)."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import accumulate
from typing import Hashable

import numpy as np
from basics import Bytes, check
from trees import TreeHeader, Values

NAMES, SOLID, NUMBERS = 0, 2, 4

# Adaptation step of a bit's probability, by count.
STEPS = [(1 << 17) // (2 * n + 3) for n in range(128)]
# Targets of the symbols' starts after each symbol, adaptation steps, and initial starts.
GOALS = [[6 * i if i <= k else (1 << 15) - 6 * (16 - i) for i in range(16)] for k in range(16)]
RATES = [4 if n < 8 else 5 if n < 24 else 6 if n < 80 else 7 for n in range(81)]
EVEN = [2048 * i for i in range(16)]


def starts(lengths: list[int]) -> list[int]:
    """Returns the starts of symbols with the given lengths."""
    return [0, *accumulate(lengths)][:16]


# fmt: off
# Lengths of residual symbols, in the size contexts 0 to 13, then in larger even ones and larger odd
# ones.
RESIDUALS = [
    [15472, 4646, 3873, 1555, 1555, 782, 782, 628, 628, 473, 473, 396, 396, 318, 318, 473],
    [32064, 293, 211, 33, 44, 21, 18, 11, 10, 9, 9, 9, 9, 9, 9, 9],
    [31831, 386, 313, 49, 55, 25, 22, 12, 11, 10, 9, 9, 9, 9, 9, 9],
    [29287, 1725, 1314, 121, 139, 56, 36, 15, 11, 10, 9, 9, 9, 9, 9, 9],
    [26461, 3141, 2454, 236, 233, 81, 63, 21, 14, 10, 9, 9, 9, 9, 9, 9],
    [24911, 3691, 3073, 373, 420, 117, 77, 25, 15, 10, 10, 10, 9, 9, 9, 9],
    [24993, 3598, 2782, 479, 546, 158, 97, 32, 17, 11, 10, 9, 9, 9, 9, 9],
    [20461, 5337, 4327, 894, 1057, 327, 208, 61, 29, 12, 10, 9, 9, 9, 9, 9],
    [18860, 5846, 4728, 1071, 1288, 454, 311, 90, 44, 16, 12, 10, 10, 9, 9, 10],
    [15674, 7361, 5612, 1258, 1555, 571, 431, 156, 69, 21, 13, 10, 10, 9, 9, 9],
    [13243, 7758, 6259, 1701, 2073, 716, 570, 232, 117, 32, 18, 11, 10, 10, 9, 9],
    [11375, 7526, 6209, 2453, 2860, 936, 758, 301, 204, 63, 29, 13, 12, 10, 10, 9],
    [9819, 7041, 5824, 2665, 3468, 1706, 1225, 448, 323, 115, 72, 20, 13, 10, 10, 9],
    [8790, 6430, 5278, 2894, 3958, 2054, 1755, 667, 519, 197, 129, 44, 20, 12, 10, 11],
    [8032, 6374, 4693, 3274, 4014, 2245, 2178, 875, 596, 212, 155, 52, 33, 14, 11, 10],
    [5829, 5121, 4217, 3297, 4681, 2887, 3156, 1501, 1179, 391, 288, 102, 68, 24, 16, 11],
]
# fmt: on
RESIDUAL_STARTS = [starts(row) for row in RESIDUALS]


def turned(n: int) -> int:
    """Decodes a zigzag number."""
    return -(n >> 1) - 1 if n & 1 else n >> 1


def wrap(n: int, bits: int) -> int:
    """Wraps a number to a signed one of `bits` bits."""
    return (n + (1 << bits - 1) & (1 << bits) - 1) - (1 << bits - 1)


def context_of(size: int) -> int:
    """Returns the context of a size."""
    if size < 2:
        return size
    bits = size.bit_length()
    return 2 * bits - 2 + (size >> bits - 2 & 1)


def leb128(data: bytes, at: int) -> tuple[int, int]:
    """Returns a LEB128 number, and the offset after it."""
    found = 0
    for shift in range(0, 35, 7):
        check(at < len(data), "a packed segment ends too early")
        found |= (data[at] & 0x7F) << shift
        at += 1
        if data[at - 1] < 0x80:
            return found, at
    check(False, "a length of a packed segment")
    return 0, at


class Coder:
    """Consecutive decisions and their probabilities."""

    def __init__(self, data: bytes) -> None:
        head = Bytes(data)
        self.checksum, self.model = head.get("IB")
        check(self.model in (NAMES, SOLID, NUMBERS), "a packed segment of no model")
        at, lengths = 5, [len(data) - 5, 0]
        if self.model == NUMBERS:
            for number in range(2):
                lengths[number], at = leb128(data, at)
        nodes, self.header = (data[at : at + lengths[0]], data[at + lengths[0] : at + sum(lengths)])
        self.streams = data[at + sum(lengths) :]
        check(at + sum(lengths) <= len(data) and len(nodes) >= 16 and len(nodes) % 4 == 0, "parts of a packed segment")
        self.state, self.other = Bytes(nodes).get("QQ")
        self.words: list[int] = np.frombuffer(nodes, "<u4", offset=16).tolist()
        self.front, self.back = 0, len(self.words)
        self.left, self.left_bits = 0, 0
        self.bits: dict[Hashable, list[int]] = {}
        self.symbols: dict[Hashable, tuple[list[int], list[int]]] = {}
        check(min(self.state, self.other) >= 1 << 32, "states of a packed segment")

    def _next(self, state: int) -> None:
        """Continues with the other state after a state was used."""
        if state < 1 << 32:
            check(self.front < self.back, "a packed segment ends too early")
            state = state << 32 | self.words[self.front]
            self.front += 1
        self.state, self.other = self.other, state

    def bit(self, context: Hashable) -> int:
        chance = self.bits.get(context)
        if chance is None:
            chance = self.bits[context] = [1 << 15, 0]
        p, n = chance
        state, low = self.state >> 16, self.state & 0xFFFF
        chance[1] = min(n + 1, 127)
        if low < p:
            chance[0] = p + ((65503 - p) * STEPS[n] >> 16)
            self._next(p * state + low)
            return 1
        chance[0] = p - ((p - 32) * STEPS[n] >> 16)
        self._next((65536 - p) * state + low - p)
        return 0

    def symbol(self, context: Hashable, first: list[int] = EVEN) -> int:
        found = self.symbols.get(context)
        if found is None:
            found = self.symbols[context] = list(first), [0]
        s, seen = found
        low = self.state & 0xFFFF
        k = bisect_right(s, low >> 1) - 1
        end = s[k + 1] if k < 15 else 1 << 15
        self._next(2 * (end - s[k]) * (self.state >> 16) + low - 2 * s[k])
        rate = RATES[min(seen[0], 80)]
        s[:] = [v + (g - v >> rate) for v, g in zip(s, GOALS[k])]
        seen[0] += 1
        return k

    def tree(self, context: Hashable, bits: int) -> int:
        """Returns bits, the highest first, each in the context of the previous ones."""
        found = 1
        for _ in range(bits):
            found = found << 1 | self.bit((context, found))
        return found - (1 << bits)

    def raw(self, bits: int) -> int:
        while self.left_bits < bits:
            check(self.front < self.back, "a packed segment ends too early")
            self.back -= 1
            self.left |= self.words[self.back] << self.left_bits
            self.left_bits += 32
        found = self.left & (1 << bits) - 1
        self.left >>= bits
        self.left_bits -= bits
        return found

    def number(self) -> int:
        bits = self.raw(7)
        check(bits <= 64, "a number has more than 64 bits")
        return self.raw(bits)

    def signed(self) -> int:
        return turned(self.number())

    def residual(self, context: Hashable, c: int) -> int:
        """Returns a residual in the size context `c`."""
        k = max(c - 14 >> 1, 0)
        symbol = self.symbol((context, c), RESIDUAL_STARTS[c if c < 14 else 14 + c % 2])
        if symbol < 4:
            return turned(symbol << k | self.raw(k))
        if symbol == 15:
            return turned(self.number() << k | self.raw(k))
        more = (symbol >> 1) - 1 + k
        return turned((2 | symbol & 1) << more | self.raw(more))

    def finish(self) -> None:
        """Checks that no data remains."""
        check(self.front == self.back and not self.left, "something is left of a packed segment")
        check(self.state == self.other == 1 << 32, "last states of a packed segment")


class Numbers:
    """Samples as integers: their bits, the channel order, and the channels predicted from channel
    1."""

    def __init__(self, form: TreeHeader) -> None:
        self.sample, small = form.type, form.type.itemsize <= 2
        self.bits = 32 if small else 64
        self.type = np.dtype(f"i{self.bits // 8}")
        # Bits of the lanes used to compute dense blocks.
        self.lanes = 8 * max(form.type.itemsize, 2)
        self.relative_channels = (0, 2) if small and form.channels > 2 else ()
        self.order = [1, 0, 2, 3][: form.channels] if self.relative_channels else list(range(form.channels))

    def samples(self, numbers: Values, power: int | None = None) -> Values:
        """Returns the samples of integers, or of their multiples."""
        if self.sample.kind != "f":
            return numbers.astype(self.sample)
        if power is not None:
            with np.errstate(over="ignore"):
                return np.ldexp(numbers.astype("f8"), -power).astype(self.sample)
        whole = numbers.astype(f"i{self.sample.itemsize}")
        return np.where(whole < 0, whole ^ np.iinfo(whole.dtype).max, whole).view(self.sample)


def multiple(sample: Values, power: int) -> int:
    """Returns the integer of a floating-point sample that is a multiple of a power of two."""
    with np.errstate(over="ignore"):
        scaled = float(np.ldexp(np.float64(sample), power))
    return 0 if math.isnan(scaled) else int(min(max(scaled, -(2.0**63)), 2.0**63)) - (scaled >= 2.0**63)
