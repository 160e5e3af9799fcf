"""Writer of TIFF files for tests: tiles or strips, without compression, with DEFLATE or LZW."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import Any, Iterator

import numpy as np
from lzw import CLEAR, END
from trees import Values

NONE, LZW, DEFLATE = 1, 5, 8
SHORT, LONG, DOUBLE, ASCII = 3, 4, 12, 2
SIZES = {SHORT: "H", LONG: "I", DOUBLE: "d", ASCII: "B"}


def compress_lzw(data: bytes, is_old: bool = False) -> bytes:
    """Compresses bytes with codes from the highest bit down, or as the first libtiff did."""
    bits: list[str] = []

    def put(code: int, size: int) -> None:
        text = f"{code:0{size}b}"
        bits.append(text[::-1] if is_old else text)

    table, size, known = {bytes([i]): i for i in range(256)}, 9, b""
    put(CLEAR, 9)
    for byte in data:
        longer = known + bytes([byte])
        if longer in table:
            known = longer
            continue
        put(table[known], size)
        table[longer] = len(table) + 2
        known = bytes([byte])
        if len(table) + 2 > (1 << size) - (0 if is_old else 1):
            size += 1
        if len(table) + 2 >= 4094:
            put(CLEAR, 12)
            table, size = {bytes([i]): i for i in range(256)}, 9
    if known:
        put(table[known], size)
        size = min(12, size + (len(table) + 3 > (1 << size) - (0 if is_old else 1)))
    put(END, size)
    joined = "".join(bits)
    joined += "0" * (-len(joined) % 8)
    octets = [joined[i : i + 8] for i in range(0, len(joined), 8)]
    return bytes(int(octet[::-1] if is_old else octet, 2) for octet in octets)


@dataclass
class Tiff:
    """How an image is stored."""

    # Columns and rows of a tile, or 0 and the rows of a strip.
    chunk: tuple[int, int] = (0, 7)
    compression: int = NONE
    predictor: int = 1
    is_planar: bool = False
    is_big: bool = False
    # Bits of a sample, if these are not those of the array's type.
    bits: int = 0
    is_lowest_first: bool = False
    is_old_lzw: bool = False
    nodata: str | None = None
    # Numbers of chunks that are not written.
    holes: set[int] = field(default_factory=set)
    # Position of the upper left corner, in pixels.
    at: tuple[int, int] | None = None
    has_opacity: bool = False

    def packed(self, part: Values) -> bytes:
        """Returns the bytes of rows, columns and samples before compression."""
        kind, bits = part.dtype, self.bits or 8 * part.dtype.itemsize
        if bits != 8 * kind.itemsize and kind.kind == "u":
            whole = part.reshape(len(part), -1)
            each = np.stack([whole >> bits - 1 - i & 1 for i in range(bits)], -1)
            data: bytes = np.packbits(each.astype(np.uint8).reshape(len(part), -1), axis=1).tobytes()
        else:
            if bits == 16 and kind.kind == "f":
                part = part.astype(np.float16)
            size = part.dtype.itemsize
            if self.predictor == 2:
                numbers = part.view(f"u{size}")
                part = np.concatenate([numbers[:, :1], numbers[:, 1:] - numbers[:, :-1]], 1)
            data = part.astype(part.dtype.newbyteorder(">" if self.is_big else "<")).tobytes()
            if bits == 24:
                data = b"".join(float24(v, self.is_big) for v in part.reshape(-1))
            if self.predictor == 3:
                rows = np.frombuffer(part.astype(part.dtype.newbyteorder(">")).tobytes(), np.uint8).reshape(len(part), -1, size)
                rows = rows.transpose(0, 2, 1).reshape(len(part), -1, part.shape[2])
                data = np.concatenate([rows[:, :1], rows[:, 1:] - rows[:, :-1]], 1).tobytes()
        if self.compression == DEFLATE:
            data = zlib.compress(data, 6)
        elif self.compression == LZW:
            data = compress_lzw(data, self.is_old_lzw)
        return bytes(int(f"{byte:08b}"[::-1], 2) for byte in data) if self.is_lowest_first else data

    def chunks(self, image: Values) -> Iterator[bytes]:
        height, width, channels = image.shape
        across, down = self.chunk[0] or width, self.chunk[1]
        for plane in [slice(c, c + 1) for c in range(channels)] if self.is_planar else [slice(None)]:
            for y in range(0, height, down):
                for x in range(0, width, across):
                    part = image[y : y + down, x : x + across, plane]
                    if self.chunk[0]:
                        part = np.pad(part, [(0, down - part.shape[0]), (0, across - part.shape[1]), (0, 0)])
                    yield self.packed(part)

    def directory(self, image: Values, at: int, is_mask: bool) -> tuple[bytes, list[tuple[int, int, list[Any]]]]:
        """Returns the chunks of an image, the first at an offset, and the tags."""
        height, width, channels = image.shape
        data, offsets, counts = b"", [], []
        for number, chunk in enumerate(self.chunks(image)):
            is_hole = number in self.holes and not is_mask
            offsets.append(0 if is_hole else at + len(data))
            counts.append(0 if is_hole else len(chunk))
            data += b"" if is_hole else chunk
        bits = self.bits or 8 * image.dtype.itemsize
        tags: list[tuple[int, int, list[Any]]] = [
            (254, LONG, [4 if is_mask else 0]),
            (256, LONG, [width]),
            (257, LONG, [height]),
            (258, SHORT, [bits] * channels),
            (259, SHORT, [self.compression]),
            (262, SHORT, [4 if is_mask else 2 if channels > 2 else 1]),
            (266, SHORT, [2 if self.is_lowest_first else 1]),
            (277, SHORT, [channels]),
            (284, SHORT, [2 if self.is_planar else 1]),
            (317, SHORT, [self.predictor]),
            (339, SHORT, ["uif".index(image.dtype.kind) + 1] * channels),
        ]
        if self.chunk[0]:
            tags += [(322, LONG, [self.chunk[0]]), (323, LONG, [self.chunk[1]]), (324, LONG, offsets), (325, LONG, counts)]
        else:
            tags += [(273, LONG, offsets), (278, LONG, [self.chunk[1]]), (279, LONG, counts)]
        if self.has_opacity:
            tags.append((338, SHORT, [2]))
        if self.at:
            x, y = self.at
            tags += [(33550, DOUBLE, [1.0, 1.0, 0.0]), (33922, DOUBLE, [0.0, 0.0, 0.0, float(x), float(-y), 0.0])]
        if self.nodata is not None and not is_mask:
            tags.append((42113, ASCII, [*self.nodata.encode(), 0]))
        return data, sorted(tags)

    def file(self, image: Values, mask: Values | None = None) -> bytes:
        """Returns the file of an image (by row, column, channel), and of its mask."""
        order = ">" if self.is_big else "<"
        found = bytearray((b"MM\0*" if self.is_big else b"II*\0") + bytes(4))
        link = 4
        plain = Tiff(self.chunk, self.compression, is_big=self.is_big)
        images = [(self, image, False)] + ([(plain, mask, True)] if mask is not None else [])
        for writer, pixels, is_mask in images:
            data, tags = writer.directory(pixels, len(found), is_mask)
            found += data + bytes(len(data) % 2)
            start = len(found)
            found[link : link + 4] = struct.pack(order + "I", start)
            after = start + 2 + 12 * len(tags) + 4
            entries, values = struct.pack(order + "H", len(tags)), b""
            for tag, kind, numbers in tags:
                raw = struct.pack(f"{order}{len(numbers)}{SIZES[kind]}", *numbers)
                entries += struct.pack(order + "HHI", tag, kind, len(numbers))
                if len(raw) > 4:
                    entries += struct.pack(order + "I", after + len(values))
                    values += raw + bytes(len(raw) % 2)
                else:
                    entries += raw.ljust(4, b"\0")
            link = start + len(entries)
            found += entries + bytes(4) + values
        return bytes(found)


def float24(sample: Any, is_big: bool) -> bytes:
    """Returns a number in 24 bits: sign, 7 bits of exponent, 16 of mantissa. It must be
    representable."""
    (n,) = struct.unpack("<I", struct.pack("<f", sample))
    exponent = n >> 23 & 255
    small = 0 if exponent == 0 else 127 if exponent == 255 else exponent - 64
    raw = n >> 31 << 23 | small << 16 | n >> 7 & 0xFFFF
    return raw.to_bytes(3, "big" if is_big else "little")
