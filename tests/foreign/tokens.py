"""Numbers coded as tokens (section 45 of formats.md): columns of trees of points and of lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

from basics import Bytes, check

# The sum of a context's frequencies, and the minimum state.
WHOLE, LEAST = 1 << 12, 1 << 16


def signed(n: int) -> int:
    """Returns a number modulo 2^64 as a signed one."""
    return (n + (1 << 63) & (1 << 64) - 1) - (1 << 63)


def unfolded(n: int) -> int:
    """Decodes a folded number."""
    return -(n >> 1) - 1 if n & 1 else n >> 1


class Bits:
    """Bits, from the lowest of each byte up."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, count: int) -> int:
        end = self.at + count
        check(end <= 8 * len(self.data), "bits end too early")
        found = int.from_bytes(self.data[self.at >> 3 : end + 7 >> 3], "little") >> (self.at & 7)
        self.at = end
        return found & (1 << count) - 1

    def finish(self) -> None:
        """Checks that only padding of the last byte remains."""
        left = 8 * len(self.data) - self.at
        check(left < 8 and not self.take(left), "something is left of bits")


@dataclass
class Table:
    """The tokens of a context: the token of each of 4096 slots, and starts and frequencies by
    token."""

    parts: list[int]
    start: dict[int, int]
    frequency: dict[int, int]

    @staticmethod
    def read(bits: Bits, most: int) -> Table:
        """Reads the next table, of tokens up to `most`."""
        first, last = bits.take(10), bits.take(10)
        table = Table([], {}, {})
        if (first, last) == (1, 0):
            return table
        check(first <= last <= most, "tokens of a context")
        token = first
        while token <= last:
            size = bits.take(4)
            if size:
                table.start[token] = len(table.parts)
                table.frequency[token] = count = 1 << size - 1 | bits.take(size - 1)
                check(len(table.parts) + count <= WHOLE, "frequencies of a context")
                table.parts += [token] * count
            else:
                token += bits.take(4)
            token += 1
        check(token == last + 1 and len(table.parts) == WHOLE, "frequencies of a context")
        return table


def numbers(data: Bytes, contexts: Sequence[int]) -> list[int]:
    """Reads as many numbers as contexts, each in its own context."""
    return [unfolded(n) for n in folded(data, contexts)]


def folded(data: Bytes, contexts: Sequence[int]) -> list[int]:
    """Returns numbers before they are unfolded."""
    tables_size, words, rests_size = data.get("HII")
    bits = Bits(data.take(tables_size))
    fine = 9 if bits.take(1) else 4
    maximum = (1 << fine) + 4 * (63 - fine) + 3
    tables = [Table.read(bits, maximum) for _ in range(max(contexts, default=-1) + 1)]
    bits.finish()
    states = list(data.get("2I"))
    check(min(states) >= LEAST, "states of numbers")
    left = Bytes(data.take(2 * words))
    rests = Bits(data.take(rests_size))
    found = []
    for i, context in enumerate(contexts):
        table, state = tables[context], states[i & 1]
        check(table.parts, "a context without tokens")
        token = table.parts[state % WHOLE]
        frequency = table.frequency[token]
        if frequency < WHOLE:
            state = frequency * (state // WHOLE) + state % WHOLE - table.start[token]
            if state < LEAST:
                state = state << 16 | left.get("H")
            states[i & 1] = state
        if token >> fine:
            step = token - (1 << fine)
            more = fine + step // 4 - 2
            token = (4 | step % 4) << more | rests.take(more)
        found.append(token)
    check(states == [LEAST, LEAST] and left.at == len(left.data), "numbers end at another offset")
    rests.finish()
    return found
