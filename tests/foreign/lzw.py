"""LZW as in TIFF files (section 63 of formats.md)."""

from __future__ import annotations

from typing import Iterator

from basics import check

CLEAR, END = 256, 257


class Codes:
    """Codes of a growing number of bits."""

    def __init__(self, data: bytes) -> None:
        self.is_old = data[:1] == b"\0" and len(data) > 1 and data[1] & 1 == 1
        self.data, self.bit = data, 0

    def next(self, bits: int) -> int | None:
        first, end = self.bit // 8, self.bit + bits
        if end > 8 * len(self.data):
            return None
        part = self.data[first : -(-end // 8)]
        if self.is_old:
            found = int.from_bytes(part, "little") >> self.bit % 8
        else:
            found = int.from_bytes(part, "big") >> -end % 8
        self.bit = end
        return found & (1 << bits) - 1


def strings(data: bytes) -> Iterator[bytes]:
    """Yields the strings of the codes."""
    codes = Codes(data)
    early = 0 if codes.is_old else 1
    table: list[bytes] = []
    bits, last = 9, b""
    while (code := codes.next(bits)) is not None and code != END:
        if code == CLEAR:
            table, bits, last = [bytes([i]) for i in range(256)] + [b"", b""], 9, b""
            continue
        check(table and code < len(table) + bool(last), "a code of LZW that does not exist yet")
        string = table[code] if code < len(table) else last + last[:1]
        if last:
            table.append(last + string[:1])
        last = string
        bits = min(12, max(9, (len(table) + early).bit_length()))
        yield string


def decompress(data: bytes, size: int) -> bytes:
    """Returns the first `size` bytes, or all if there are fewer."""
    found = bytearray()
    for string in strings(data):
        found += string
        if len(found) >= size:
            break
    return bytes(found[:size])
