"""Packed segments of small trees, against the length and the checksum of what was packed.

    pytest tests/foreign
    python tests/foreign/test_packed.py

Files of packed segments are among the frozen ones, which test_reader.py verifies, if there are any.
"""

from __future__ import annotations

import random
import struct
import sys
from itertools import dropwhile, takewhile
from pathlib import Path
from typing import Hashable, NamedTuple

import pytest
from basics import GOBLIN, Code, Damaged, Header, Unknown, crc32c
from coder import Coder
from packed import unpack
from reader import Goblin
from trees import Form, Run
from verify import verify_segments, verify_tree


class Sample(NamedTuple):
    """A tree of one segment: the first half of its header, its extent, the plain segment and the packed one."""

    axes: int
    header: str
    extent: tuple[int, int, int]
    size: int
    crc: int
    packed: str

    @property
    def form(self) -> Form:
        raw = bytes.fromhex(self.header)
        start = GOBLIN + struct.pack("<HHBBBxI", 1, 0, self.axes, 0, raw[5], 1)
        return Form(raw + struct.pack("<3Q", *self.extent), Header.read(start + struct.pack("<I", crc32c(start))))

    def plain(self, packed: bytes) -> bytes:
        form = self.form
        return unpack(form, form.depth, packed, self.size)


# Classes, numbers with VOID among them, the same in several blocks with records around, multiples of 1/4, three channels, an octree
# of numbers, a solid.
SAMPLES = {
    "names": Sample(
        2,
        "000101000004080200100000000000000000000000000000",
        (16, 16, 1),
        276,
        0xED2F7AB1,
        ("b17a2fed005cde71bc4e109d06df7eaf1201000000aaa4307d68940c6f5913dcc2f8aeb0b5e8c00922f4f26783c76fa89c140800000302040a"),
    ),
    "heights": Sample(
        2,
        "020100010004080200100000000000000000000000000000",
        (16, 16, 1),
        720,
        0x8E7F9176,
        (
            "76917f8e01c25e3ad504000000d180d0c41400000029250e24e7345868aa2d09153a4e64efe7e39cae05d6294ac3c56f380edf5c3641e0dca8a34541ee7c3d6278"
            "2291c0a0f058752b40751945339fa30d139b97ab5807c88c1f1d28ca8078c89ada447f08ef2748373db4dfa23a716be23a0415e5ec3273772428af64e2cd2f3ed8"
            "14f2ac759f8002ca1a0a5e66e1b04750066ec1f0f105405bc0b522153378838c15f431f4db4e0587fd02ad1510558a3826fb92359e356618145d65e0c09db3e1c8"
            "6ae289398c1ff01886190085f4d2"
        ),
    ),
    "islands": Sample(
        2,
        "020100010005080200100000000000000000000000000000",
        (32, 32, 1),
        1752,
        0x08D73F0B,
        (
            "0b3fd70801a2fd71aa0300000081623ef2c2f368ee7af81a349f0d671f02816df76d85f17b67b4db4bd7e2aedaf7aaeed8b0ca247788d3557b40786d1ac7f89b85"
            "9675eba9162450085aaa50c3673c1f31b4a289e252883c2b2a621014c5469e85e1982d3bc2eeb0460465abfba6a86c44d1c1daaf69cbabb5f93769151e0539cef3"
            "abf40ef47bd7e90bdfad914c6aaf434a60453eaa8b22fedb8a6bcec34d1dd2a803c75345bbfe3c50d19ebee1324222470c96a48c29a6f40bbf8a972b53e6b7780e"
            "6e91888d26fc4e8abbb4da47d655c0027c0014e8c59d5a41463a8e80b22ed025c29b743c62d98084ed4f"
        ),
    ),
    "quarters": Sample(
        2,
        "050100010004080200100000000000000000000000000000",
        (16, 16, 1),
        1380,
        0xEFCE01B0,
        (
            "b001ceef01823e9acdbe0100001ce4f279060000003b7d15c67ce0cae0f35140c6a7354a00e3fb6ae5a900d17bcd022cd4ae0e0529b31bd4c8df27f52d738a0cf9"
            "272aef36e337e4e4d0817560100150ec501321f2348d1a9ed2000000f9d30044738314c8ae438f3003efa7e4111556f509fb435e222017a0e5548801d45f0d0e00"
            "8406ed"
        ),
    ),
    "colours": Sample(
        2,
        "000300010004080200100000000000000000000000000000",
        (16, 16, 1),
        1024,
        0x435F905A,
        (
            "5a905f43012c7f829a0500000086997e62050000004b7807eb55f8c59639a1d4478d963fc1236f043af5255cf4de554232a880c9fe0439325ed52454e575ac6157"
            "a63664ea4e69865e9077f0c1494b3c190ac3526650e97fd304b2164e84bf700d495e20d9ea0990deb21f06bda734aa22c1ccfad59a9420a9cb35e95b5808548ca2"
            "b918b67aad9f8122491c9492708d238269584cc76e5c59b7ba918a338bc94cef7d8b6c9609320e16ad5d07ed00000000f0dfb64fbd4f0000e0effce0bf0a000418"
            "0800f20f471021ca0300d5ff078030fe7f550023072b"
        ),
    ),
    "octree": Sample(
        3,
        "020100010003060200100000000000000000000000000000",
        (8, 8, 8),
        1176,
        0x266C6B69,
        (
            "696b6c26019c70ba5b8a030000c0f23f5c5d0200007cea5c0303ff8323d094844577e147b6c7c8cc817db0fa7668f551c4cdfc687f6d09e596c8d187470b00f358"
            "663aadc153946b41d615d97dbb0c5bc21859a9c9bf08192789ba85bc17e9a08c1274e14d679714affa5d29cd2694aa8a345357f8739bfbc572939d234b5d641eb8"
            "2e1e6d67879df459d4bbd55945b4d5aa0047544d7d55b8ff2839082c3b8c5322147fc5662b9379348d3a4caa52c6719031f1641e48eda9400100003039998940a3"
            "fd0325c0261900668e39"
        ),
    ),
    "solid": Sample(
        3,
        "000106010004060200100000000000000000000000000000",
        (12, 12, 12),
        1280,
        0xFAA5AD20,
        (
            "20ada5fa02caba78d1b17f0900ab4d18c1c3220000bf20914a6914b044c84d7e92cc1f1093506912372f4d99cdcd1ff8c46a4a99e97be79a75d72f540fdf475c77"
            "d5f381d9ef32ec9a813b13bc07af56e0ea5b09a56e14800ce26088a6264f8706a128aafa8109ff01"
        ),
    ),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_plain_segments_come_out(name: str) -> None:
    sample = SAMPLES[name]
    plain = sample.plain(bytes.fromhex(sample.packed))
    assert len(plain) == sample.size and crc32c(plain) == sample.crc
    if sample.form.classes:
        plain = plain[: -4 * 9]
    assert Run(sample.form, plain, Code(0, (0,) * sample.axes)).block(0).k >= 1


@pytest.mark.parametrize("name", SAMPLES)
def test_flipped_bits_are_noticed(name: str) -> None:
    sample, rng = SAMPLES[name], random.Random(12)
    packed = bytes.fromhex(sample.packed)
    noticed = 0
    for at in range(len(packed)):
        damaged = bytearray(packed)
        damaged[at] ^= 1 << rng.randrange(8)
        try:
            # (A number may be told in more bits than it needs, a table have values that nothing has.)
            assert crc32c(sample.plain(bytes(damaged))) == sample.crc
        except Damaged:
            noticed += 1
    assert noticed > 0.9 * len(packed)


@pytest.mark.parametrize("name", SAMPLES)
def test_other_lengths_are_damage(name: str) -> None:
    sample = SAMPLES[name]
    packed = bytes.fromhex(sample.packed)
    for other in [b"", packed[:20], packed[:-1], packed[:-4], packed + bytes(4), packed + bytes(sample.size)]:
        with pytest.raises(Damaged):
            sample.plain(other)
    for size in (0, sample.size - 1, sample.size + 1, 1 << 27):
        with pytest.raises(Damaged):
            unpack(sample.form, sample.form.depth, packed, size)


def page(before: str, first: str) -> list[str]:
    """The lines of formats.md that begin like the first one, behind a place in it."""
    _, _, text = (Path(__file__).parents[2] / "formats.md").read_text().partition(before)
    assert text, before
    return list(takewhile(lambda line: line.startswith(first), dropwhile(lambda line: not line.startswith(first), text.splitlines())))


def dumped() -> bytes:
    """The packed segment of formats.md."""
    data = b""
    for line in page("<!-- dump: packed segment -->", "00"):
        offset, bytes_, _ = line.split("  ", 2)
        assert int(offset, 16) == len(data), line
        data += bytes.fromhex(bytes_)
    return data


def test_decisions_are_those_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    decisions: list[list[str]] = []
    bit = Coder.bit

    def told(coder: Coder, context: Hashable) -> int:
        state, p = coder.state, coder.bits.get(context, [1 << 15, 0])[0]
        found = bit(coder, context)
        row = [f"`{state:x}`", str(state & 0xFFFF), str(p), str(found), f"`{coder.other:x}`", str(coder.bits[context][0])]
        decisions.append([str(len(decisions) + 1), *row])
        return found

    monkeypatch.setattr(Coder, "bit", told)
    file = (Path(__file__).parents[2] / "fixtures" / "v1" / "classic.goblin").read_bytes()
    unpack(Goblin(file).layers[0].form, 3, dumped(), 107)
    # (Behind the two lines of the table's head.)
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page("## 40.", "| ")[2:]]
    assert len(rows) == 19 and [row[:1] + row[2:] for row in rows] == decisions[:19] and len(decisions) == 86


def test_readers_unpack_segments() -> None:
    """The segment of classic.goblin is packed."""
    file = (Path(__file__).parents[2] / "fixtures" / "v1" / "classic.goblin").read_bytes()
    (plain,), (layer,) = Goblin(file).layers, Goblin(file).layers
    packed = dumped()
    (entry,) = layer.entries
    layer.run = packed + layer.run[len(packed) :]
    entry.codec, entry.size, entry.crc = 1, len(packed), crc32c(packed)
    with pytest.raises(Damaged):
        # (The tree's header does not tell of packed segments.)
        layer.segment(entry)
    layer.form.codec = 1
    assert layer.segment(entry) == plain.segment(plain.entries[0])
    verify_segments(layer, verify_tree(layer))
    entry.codec = 2
    with pytest.raises(Unknown):
        layer.segment(entry)


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
