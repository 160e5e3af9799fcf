"""Common parts of files: numbers, checksums, codes of nodes, header, trailer and metadata (sections
2, 3, 5, 9 and 10 of formats.md)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Callable, NamedTuple

GOBLIN = b"\x93Goblin\n"

Point = tuple[int, ...]


class CorruptFile(Exception):
    """The file violates the specification."""


class Unknown(Exception):
    """The file has a later version, or a feature that readers of this version reject."""


def check(holds: object, what: str) -> None:
    """Raises unless a condition holds."""
    if not holds:
        raise CorruptFile(what)


def _table() -> list[int]:
    table = list(range(256))
    for _ in range(8):
        table = [n >> 1 ^ (0x82F63B78 if n & 1 else 0) for n in table]
    return table


TABLE = _table()


def crc32c(data: bytes) -> int:
    """Returns the checksum of section 2."""
    crc, table = 0xFFFFFFFF, TABLE
    for byte in data:
        crc = crc >> 8 ^ table[crc & 255 ^ byte]
    return crc ^ 0xFFFFFFFF


class Bytes:
    """Consecutive numbers, read with bounds checks."""

    def __init__(self, data: bytes, at: int = 0) -> None:
        self.data, self.at = data, at

    def take(self, count: int) -> bytes:
        check(0 <= count <= len(self.data) - self.at, "bytes end too early")
        self.at += count
        return self.data[self.at - count : self.at]

    def get(self, form: str) -> Any:
        """Returns a fixed-size number in `struct` notation: one, or a tuple."""
        found = struct.unpack("<" + form, self.take(struct.calcsize("<" + form)))
        return found[0] if len(found) == 1 else found

    def leb(self, most: int = 19) -> int:
        """Returns an integer of section 22."""
        number = 0
        for place in range(most):
            byte = self.get("B")
            number |= (byte & 127) << 7 * place
            if byte < 128:
                return number
        raise CorruptFile("a number is too long")

    # Bincode (section 9).

    def unsigned(self) -> int:
        first: int = self.get("B")
        check(first <= 0xFD, "a number has more than 64 bits")
        return first if first < 251 else self.get("HIQ"[first - 251])

    def signed(self) -> int:
        number = self.unsigned()
        return -(number >> 1) - 1 if number & 1 else number >> 1

    def boolean(self) -> bool:
        byte = self.get("B")
        check(byte < 2, "neither false nor true")
        return byte == 1

    def option(self, item: Callable[[], Any]) -> Any:
        return item() if self.boolean() else None

    def many(self, item: Callable[[], Any]) -> list[Any]:
        return [item() for _ in range(self.unsigned())]

    def blob(self) -> bytes:
        return self.take(self.unsigned())

    def text(self) -> str:
        try:
            return self.blob().decode()
        except UnicodeDecodeError:
            raise CorruptFile("a text is not UTF-8") from None

    def number(self) -> int | float:
        kind = self.unsigned()
        check(kind < 3, "a number is of no kind")
        return self.unsigned() if kind == 0 else self.signed() if kind == 1 else self.get("d")

    def pairs(self, key: Callable[[], Any], value: Callable[[], Any]) -> dict[Any, Any]:
        found = self.many(lambda: (key(), value()))
        check(len(dict(found)) == len(found), "a key is there twice")
        return dict(found)

    def system(self) -> dict[str, Any]:
        """Returns a coordinate system."""
        kind = self.unsigned()
        check(kind < 5, "a coordinate system is defined in a way that is not known")
        if kind == 0:
            return {"epsg": self.unsigned(), "heights": self.option(self.unsigned)}
        if kind == 1:
            unsigned = self.unsigned
            return {
                "version": [unsigned() for _ in range(3)],
                "keys": self.many(lambda: [unsigned() for _ in range(4)]),
                "doubles": self.many(lambda: self.get("d")),
                "text": self.blob(),
            }
        return {["wkt", "projjson", "proj"][kind - 2]: self.text()}

    def frame(self) -> dict[str, Any]:
        """Returns a frame: the matrix, its coordinate system, and whether pixels are points."""
        matrix = [self.get("4d") for _ in range(3)]
        return {"matrix": matrix, "crs": self.option(self.system), "points": self.boolean()}


def metadata(data: bytes) -> dict[str, Any]:
    """Returns all fields of section 9."""
    b = Bytes(data)
    if b.unsigned() != 1:
        raise Unknown("metadata of another version")
    strings = lambda: b.many(b.text)  # noqa: E731
    tags = lambda: b.pairs(b.text, b.text)  # noqa: E731
    return {
        "frame": b.frame(),
        "nodata": b.option(b.number),
        "palette": b.option(lambda: b.many(lambda: b.get("4B"))),
        "classes": b.pairs(b.number, b.text),
        "bands": strings(),
        "scales": b.many(lambda: b.get("2d")),
        "units": strings(),
        "alpha": b.option(lambda: b.get("B")),
        "counts": b.many(lambda: tuple(b.unsigned() for _ in range(3))),
        "provenance": strings(),
        "tags": tags(),
        "scoped": b.pairs(lambda: (b.option(b.unsigned), b.text()), tags),
        "controls": b.option(lambda: (b.frame(), b.many(lambda: b.get("5d")))),
        "time": b.option(b.text),
        "repeated": b.unsigned(),
    }


class Code(NamedTuple):
    """A node: its level and its coordinates there, x first."""

    level: int
    at: Point

    @property
    def code(self) -> int:
        """Returns the FD code of section 3."""
        k = len(self.at)
        return self.level | sum(child << 63 - k * (i + 1) for i, child in enumerate(self.path))

    @property
    def path(self) -> list[int]:
        """Returns the child numbers on the path from the root."""
        levels = range(self.level - 1, -1, -1)
        return [sum((v >> l & 1) << a for a, v in enumerate(self.at)) for l in levels]

    def up(self, levels: int) -> "Code":
        return Code(self.level - levels, tuple(v >> levels for v in self.at))

    @staticmethod
    def of(code: int, axes: int) -> "Code":
        level = code & 31
        check(level <= (29 if axes == 2 else 19), "a code has too deep a level")
        at = [0] * axes
        for step in range(level):
            for a in range(axes):
                at[a] = at[a] << 1 | code >> 63 - axes * (step + 1) + a & 1
        node = Code(level, tuple(at))
        check(node.code == code, "a number is no code")
        return node


@dataclass(frozen=True)
class Header:
    """The header of a file."""

    raw: bytes
    axes: int
    content: int
    depth: int
    layers: int

    @staticmethod
    def read(data: bytes, magic: bytes = GOBLIN) -> "Header":
        raw = data[:24]
        check(len(raw) == 24 and raw[:8] == magic, "no header")
        major, _, axes, content, depth, _, layers, crc = struct.unpack("<HHBBBBII", raw[8:])
        check(crc == crc32c(raw[:20]), "checksum of the header")
        if major != 1 or content not in (0, 2, 3, 4):
            raise Unknown("a later version, or another content")
        check(axes in (2, 3) and depth <= (29 if axes == 2 else 19), "axes or depth")
        return Header(raw, axes, content, depth, layers)


def check_names(names: list[str]) -> None:
    """Checks that names of layers are as section 10 requires."""
    check(len(names) == 1 or len(set(names)) == len(names) and "" not in names, "names of layers")


def spans(data: bytes, header: Header) -> dict[bytes, tuple[int, int, int]]:
    """Returns the position, length and checksum of each section in the trailer."""
    check(len(data) >= 40 and data[-8:] == GOBLIN[::-1], "no end")
    size, crc = struct.unpack("<II", data[-16:-8])
    check(36 <= size <= 4096 and size + 40 <= len(data), "the trailer does not fit")
    raw = data[-16 - size : -16]
    check(crc32c(raw) == crc, "checksum of the trailer")
    b = Bytes(raw)
    check(b.take(24) == header.raw, "the headers differ")
    whole, count = b.get("QI")
    check(whole == len(data) and size == 36 + 24 * count, "the file's length, or sections")
    found = {}
    for _ in range(count):
        tag, crc, at, size = b.get("4sIQQ")
        check(at + size <= len(data), "a section lies outside the file")
        found[tag] = at, size, crc
    return found


def trailer(data: bytes, header: Header) -> dict[bytes, bytes]:
    """Returns the sections in the trailer, checked."""
    found = {}
    for tag, (at, size, crc) in spans(data, header).items():
        found[tag] = data[at : at + size]
        check(crc32c(found[tag]) == crc, "checksum of a section")
    return found
