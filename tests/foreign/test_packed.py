"""Packed segments of small trees, against the length and the checksum of the originals.

    pytest tests/foreign
    python tests/foreign/test_packed.py

The frozen files, which test_reader.py verifies, may include files of packed segments.
"""

from __future__ import annotations

import random
import struct
import sys
from itertools import dropwhile, takewhile
from pathlib import Path
from typing import Hashable, NamedTuple

import pytest
from basics import GOBLIN, Code, CorruptFile, Header, Unknown, crc32c
from coder import Coder
from packed import unpack
from reader import Goblin
from trees import RunRecords, TreeHeader
from verify import verify_segments, verify_tree


class Sample(NamedTuple):
    """A tree of one segment: the first half of its header, its extent, the plain segment and the
    packed one."""

    axes: int
    header: str
    extent: tuple[int, int, int]
    size: int
    crc: int
    packed: str

    @property
    def form(self) -> TreeHeader:
        raw = bytes.fromhex(self.header)
        start = GOBLIN + struct.pack("<HHBBBxI", 1, 0, self.axes, 0, raw[5], 1)
        return TreeHeader(raw + struct.pack("<3Q", *self.extent), Header.read(start + struct.pack("<I", crc32c(start))))

    def plain(self, packed: bytes) -> bytes:
        form = self.form
        return unpack(form, form.depth, packed, self.size)


# Classes, numbers with some VOID, the same in several blocks with records around, multiples of 1/4,
# floats of all sizes, three channels, an octree of numbers, a solid.
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
            "76917f8e041c0fd117727d2600000080afe01d6d00000010edace54a0a56458000000084811100c0e01600000000000086e45d76019c3d0508e068000000180000"
            "00f6dd87983056da2e741f4118697e7673482ca85904117bbef796ad5566fa8776f580e76605b8da08c3c01e32a3a3c80b7532b37a9f76002083b62080ac998773"
            "c4a88a877c1300dd69354fcb224d8fa53a85798afeedadaa9b32d7c48bbe7699bd9740c261d203d0f00c13223187f1138eac160eb800e62c864457598d67cc8a57"
            "eb4b2b20aa94887d8156fa6d2b0c00ac661233bce196704d041ea7000309aeb02c8c2c981ac0abee0a0ce02972d4d9a66f1e"
        ),
    ),
    "islands": Sample(
        2,
        "020100010005080200100000000000000000000000000000",
        (32, 32, 1),
        1752,
        0x08D73F0B,
        (
            "0b3fd70804600284ffdb04827e1800ff63aaaaed03000057ee898cc6484e26e498d77e04b37c4b94988039a9a96e20fbf4116217022b4107e4a57fbbe1a7dd5337"
            "7234036808f2694ff9e527d0801c0c4ef5dfcfc009bc8e020000d025c29b743c62d98084ed4f0400d1e5f68ff42b84c0ac0000001c000000e0e16bf8422696f5b6"
            "5eddf45aa72040356690216778ac7bb9133372dc331dfc3611ec4fce521558eee4b96f3a3e5d613c49dd8a1f8481a8e40c865c7d0871f17241e35880c95a252208"
            "cd05547c60d0ae40e64c2caeca40adbcf1f8c424307608978629aac05033e1ec773a68232cf1d15259a4f91352081733f71d000409af1c1609472b13fd24ddc67a"
            "6f5840768c09da38be76c7beecaefb31adc96f1d9f3cea6ca5aede260430100034002e4dab379c2901b000202132272c390009"
        ),
    ),
    "quarters": Sample(
        2,
        "050100010004080200100000000000000000000000000000",
        (16, 16, 1),
        1380,
        0xEFCE01B0,
        (
            "b001ceef04142e000002001000000000800200080000008000000011b0f3fc230ac3ec174e9e283fc6087a5eb9413004821004810a89860a9078a508010000000c"
            "7e0e97a91c2e6f051795c012110c0cce3800000014000050ba6b7b2b68e059ec1442042e396cdbd52fa90046f39bab837d99e37846d55bc7df67166baada9da7f6"
            "942c665d3219877c48780000b4130000ace3c00000504e0100584c6f0567d2a756d859a817dbd2b7ac52851f55a6585c547061"
        ),
    ),
    "floats": Sample(
        2,
        "050100010004080200100000000000000000000000000000",
        (16, 16, 1),
        1380,
        0x0F7FE2C9,
        (
            "c9e27f0f041412000002001000000000800200080000008000000000800000000000000000b5820a40ad35f30a175d16a67590a48c9400000005a07775dd8d80b3"
            "bcf28201f0e8b5c8e807163ad359ecad182cd9dffdf07e5bd5dec84a97c0e5548684b3f99640b2780c6ab7255bf2e41e675cbbe0c93f747c0dd68bcec3f4f4ec66"
            "0910b94b3f82565e6e60535f24158c5cd29693107623bddcb713d89ffc1a4adbd54cb53e7cf7e6ad2d094cd9d8c3e7fdddb75baf7cd76342db551e7415089a3f95"
            "355c016bd1e0225906000020832d801c654b828ffffa80859d7280c86747e0e014bbb806c9e0a74d6f46386f821af01efe85fae8f7f4e4fe88bd0a286c88fe65c7"
            "a68d6e81324540e3aa850cb2353b8369d6890dfb5aff81e2fef1ef98c1922ab2e5637aec5900d1881e2f21c777ca892d84abd61a2645c3a4f3e344c22da5365092"
            "ec27474baf1470a0e017b19c0abade41348f7686cc8772964917bafc4672b67a957b4e2463a3f33afef7355f27680e265bd76ebd44834595f8036181a38b50b3fc"
            "d1af2417997387119e0cceea370255ef036f5ad929e332f7f35d32e8960d707e6781feda88bf106a867726677091848f8e0188e7a223fa5a345c322bcc30f36f04"
            "1ec91f853d6be0e9f129feda3f93cce8811d97e13b61283532e4e52bdb5d9f12b122b70bc61d9d8faef7f9a0edc21cc18aaec4c40713b21b9c960a0f14289e2d9d"
            "97f68814e16dd1114a20abbac7e22949c0224482c43cd187136afe122ea2e16d452e70d6851d64d0714ee0752c5979d6546046d8168f6d3e51d07a510cce084302"
            "91e9ec2877a801d81aea57339cbb93ad17b68e5a5ae3a462dc92c8a109a90559b0ab633882d43ebcb166c56cc844bbac346f0ed5c43d0043513814705bfa4729cc"
            "c0747a3825101b6fa6f9625d61e17dcb610fc4bb8abae0492e4516aed3e742c38102602b9b71678e00a651b277d040cd48a0c9f631b1562c2b1432ee7bf95dd2d0"
            "13e7a0e58b1534e933bc17e97f981100ce841daba059aededb7bf21c6a052a751e2a903852e73114ff6b26cf6221459ae50df15451b9d0de7553e858cfbbe1a81f"
            "2c150f675444fcd54d4d337f680e4c232561fa0f28e0f3a66b4eba418daacb657ab19f385815b52dc06b55ec1d2f8c070060dc369594f691b36726fcc0f83313bf"
            "064237107d1d847e20541990490c708d809c7c4899fa3a16c4a587848b90452e2ef1886ef913db6bfea10eabbd9eefe63034e9690e2c953c58bd08cacff5b60d13"
            "1d2a640161dfd43f736efc8aef4f11859eb6b82afc01b7e4a4a71ac377fff017f9b500b1120352c5ab8ca31bef463099ecf96c03d58d2ddaed1252a741663850f7"
            "9dd5c69fdbe7edb82cfb101699c81c91a9b7b63c8e79d0c8d88b89ac8a6a635570dbae52cf534393968d249e98e5b24502a0cd4e249066d4a370f2cf2dd1e8475a"
            "83b2fb2a0006ba41bca24441c703b40e4f0638080f08acbccd6315dad7437d54e5b3966495f6b561807c87bd7e71aaa2c970648c658b1dcba3ce3f6f6cc6e69f1a"
            "1e21f32000606308726250aa5eb16c91ba219b3c52897b3d5b49b00b11610208b4fb1200aa958e4711a4ac1798ee41"
        ),
    ),
    "colours": Sample(
        2,
        "000300010004080200100000000000000000000000000000",
        (16, 16, 1),
        1024,
        0x435F905A,
        (
            "5a905f4304145600000200100000000080020008000000800000000440c0e0355100380500021f3c27eea0cb000000048ec011380227c081c0010081170e180000"
            "0040e0817315c02028cb3008429ea8a610085e2008522f048258268185012880c64105153c0040e0003815008e0300e0ba833c8067bba5396c000000160000c015"
            "5bd393c581c9daf2180ca788fe794041f680b74241357efb2359f7cc5fc89e70b933b46241a9ed71f7394625f6f570db26d587124e5d6d9f829fb5c3531f665319"
            "ac7278c3bc9b308e24b557edfe7b4535054061007901c02f1280d0024c0b51829b6e2a01c0ffff66007230c6c0ffabaafe3f00803c008800f84700200480041000"
            "00005405521508000022880000c003"
        ),
    ),
    "octree": Sample(
        3,
        "020100010003060200100000000000000000000000000000",
        (8, 8, 8),
        1176,
        0x266C6B69,
        (
            "696b6c260414140000020010000000008003000800000080000000041c0000c0cabcca6600f000000000c0010010385d11cb983a57cb98a80000000900f462611b"
            "ac8ee4699af4bac933e258a844ca88346899479b55d52f8f65dd7386acdb9e09f349a587352897ea8201e0782c023909296a38a9b2cae1afa9c390e299607d7e4c"
            "92fccc9e83ed5acc1718cd3a47bfc5f1ffeea7e4c2ce24743619087a8691699ee2a9630d1695ff24ee786e8b1d1ec14ea1b27fd49a3222655d0d781b140acad059"
            "dbc650ec96b21fa58516885445996336fa0d031fad6dda89ccdc8aaa04157318002c00cc31270081052419d0682d202900dceecc3a06"
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
    assert RunRecords(sample.form, plain, Code(0, (0,) * sample.axes)).block(0).k >= 1


@pytest.mark.parametrize("name", SAMPLES)
def test_flipped_bits_are_noticed(name: str) -> None:
    sample, rng = SAMPLES[name], random.Random(12)
    packed = bytes.fromhex(sample.packed)
    noticed = 0
    for at in range(len(packed)):
        changed = bytearray(packed)
        changed[at] ^= 1 << rng.randrange(8)
        try:
            # A number may be coded in more bits than necessary, and a table may have unused values.
            assert crc32c(sample.plain(bytes(changed))) == sample.crc
        except CorruptFile:
            noticed += 1
    assert noticed > 0.9 * len(packed)


@pytest.mark.parametrize("name", SAMPLES)
def test_other_lengths_are_corrupt(name: str) -> None:
    sample = SAMPLES[name]
    packed = bytes.fromhex(sample.packed)
    for other in [b"", packed[:20], packed[:-1], packed[:-4], packed + bytes(4), packed + bytes(sample.size)]:
        with pytest.raises(CorruptFile):
            sample.plain(other)
    for size in (0, sample.size - 1, sample.size + 1, 1 << 27):
        with pytest.raises(CorruptFile):
            unpack(sample.form, sample.form.depth, packed, size)


def page(before: str, first: str) -> list[str]:
    """Returns consecutive lines of formats.md that begin like the first one, after a position."""
    _, _, text = (Path(__file__).parents[2] / "docs/format/packed.md").read_text().partition(before)
    assert text, before
    return list(takewhile(lambda line: line.startswith(first), dropwhile(lambda line: not line.startswith(first), text.splitlines())))


def dumped() -> bytes:
    """Returns the packed segment of formats.md."""
    data = b""
    for line in page("<!-- dump: packed segment -->", "00"):
        offset, bytes_, _ = line.split("  ", 2)
        assert int(offset, 16) == len(data), line
        data += bytes.fromhex(bytes_)
    return data


def test_decisions_are_those_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    decisions: list[list[str]] = []
    bit = Coder.bit

    def recorded(coder: Coder, context: Hashable) -> int:
        state, p = coder.state, coder.bits.get(context, [1 << 15, 0])[0]
        found = bit(coder, context)
        row = [f"`{state:x}`", str(state & 0xFFFF), str(p), str(found), f"`{coder.other:x}`", str(coder.bits[context][0])]
        decisions.append([str(len(decisions) + 1), *row])
        return found

    monkeypatch.setattr(Coder, "bit", recorded)
    file = (Path(__file__).parents[2] / "fixtures" / "v1" / "classic.goblin").read_bytes()
    unpack(Goblin(file).layers[0].form, 3, dumped(), 107)
    # After the two lines of the table's head.
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page("## 40.", "| ")[2:]]
    assert len(rows) == 19 and [row[:1] + row[2:] for row in rows] == decisions[:19] and len(decisions) == 86


def test_readers_unpack_segments() -> None:
    """Packs the segment of classic.goblin."""
    file = (Path(__file__).parents[2] / "fixtures" / "v1" / "classic.goblin").read_bytes()
    (plain,), (layer,) = Goblin(file).layers, Goblin(file).layers
    packed = dumped()
    (entry,) = layer.entries
    layer.run = packed + layer.run[len(packed) :]
    entry.codec, entry.size, entry.crc = 1, len(packed), crc32c(packed)
    with pytest.raises(CorruptFile):
        # The tree's header does not announce packed segments.
        layer.segment(entry)
    layer.form.codec = 1
    assert layer.segment(entry) == plain.segment(plain.entries[0])
    verify_segments(layer, verify_tree(layer))
    entry.codec = 2
    with pytest.raises(CorruptFile):
        # Only indexes have references.
        layer.segment(entry)
    entry.codec = 3
    with pytest.raises(Unknown):
        layer.segment(entry)


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
