"""Recomputes the checksums of corrupt trees of points and of lines, and of levels of detail, so
that later checks are tested."""

from __future__ import annotations

import struct

from basics import Header, crc32c, spans

# Sections with an entry per block, and the entry size; offset, length and checksum of the block are
# at the same offsets in all.
BLOCKS = {b"PBLK": 52, b"LBLK": 52, b"LFEA": 52, b"LEVC": 24, b"LEVF": 24}


def resealed(changed: bytearray, was: bytes) -> bytes:
    """Returns a corrupt file with recomputed checksums, given the original file."""
    data, sections = bytearray(changed), spans(was, Header.read(was))
    trailer = len(data) - 16 - 36 - 24 * len(sections)

    def put(at: int, start: int, end: int) -> None:
        data[at : at + 4] = struct.pack("<I", crc32c(bytes(data[start:end])))

    for tag in BLOCKS.keys() & sections.keys():
        at, size, _ = sections[tag]
        for entry in range(at, at + size, BLOCKS[tag]):
            start, length = struct.unpack_from("<QI", data, entry + 8)
            put(entry + 20, start, start + length)
    put(20, 0, 20)
    data[trailer : trailer + 24] = data[:24]
    for i, (at, size, _) in enumerate(sections.values()):
        put(trailer + 40 + 24 * i, at, at + size)
    put(len(data) - 12, trailer, len(data) - 16)
    return bytes(data)
