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


# Classes, numbers with VOID among them, the same in several blocks with records around, multiples of 1/4, floats of all
# sizes, three channels, an octree of numbers, a solid.
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
            "76917f8e031c27d117727d2600000080afe01d6d00000010edace54a0a564580000000fc3cc127c2b00776d407ca51d08917677610cc802004412006460000835b"
            "000000000000189203ba75463f22d5783f640000000b00a8eb2eaf5b6f3226bd95ad087ba66908236a2441975c139ca1203a887622bb3ff3d2734ae50e5d91ed8b"
            "1cd9d35b6a10a55e8a0bb4016ccf6a84080fb8c6f28d18a0fdd120acf59e0370bf870916b3be50a969e1137c86ddb4e82fff651bbb2d41c261d2034c301b2624e5"
            "c25301028061121740bacc9b345aa04f357d1d347c9fc122e24bf4626b6ff68601a0b39c98c11d0bef903b30fcd6d96e39c6261831911870ee1dc4182e0fdfffad"
            "cd04"
        ),
    ),
    "islands": Sample(
        2,
        "020100010005080200100000000000000000000000000000",
        (32, 32, 1),
        1752,
        0x08D73F0B,
        (
            "0b3fd70803602084ffdb04827e1800ff63aaaaed03000057ee898cc6484e26e498d77e04b37c4b94988039a9a96e20fbf4116217022b4107e4a57fbbe1a7dd5337"
            "7234036808f2694ff9e527d0801c0c4ef5dfcfc009bc8e020000d025c29b743c62d98084ed4ffc483f38ceb2526e1608c6d1d5891a3882526c7624b759210a6001"
            "00000a7703d167bc3e47993e637400000008007f71b55927a50f54666706f4cd2e749b78f33dd77ced997feeaf2e30c4546dbd3836b63338d2ae5872d18271b6c7"
            "f0a7501425cc15ced403f4fbd7205da64f0538d98ae8bce7578438f85ffccf59a084bda4708dbae88ce840273438c212866ff1a4c96e3c98f787368d3136a63d60"
            "550a006f100035ca941200c8d00094785c00008034"
        ),
    ),
    "quarters": Sample(
        2,
        "050100010004080200100000000000000000000000000000",
        (16, 16, 1),
        1380,
        0xEFCE01B0,
        (
            "b001ceef03142e000002001000000000800200080000008000000011b0f3fc230ac3eb174e9e283fc8087a5eb9413004821004810a89860a9078a508010000000c"
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
            "c9e27f0f031412000002001000000000800200080000008000000000800000000000000000b5820a40ad35f30a175d16a67590a48c9400000005a07775dd8d80b3"
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
            "5a905f4303146a0000020010000000008002000800000080000000dc4c3008c2300c82d1179a250482570782910b8120864920e00083d7046ae51500087c703d38"
            "0d3c70000000089c0007020700045e3860000000008107ce550083a02cc3200879a29a422078812048bd10086299041606a0001a071554f000008103e05400380e"
            "008003175e8ec8c40791216000000009007a519b6c2f31c8e2fb0130ef45d304f33a1300bb2d958881d9e96241a9ed71f7394625f6f570db26d587124e5d6d9f82"
            "9fb5c3531f665319ac7278c3bc9b308e24b557edfe7b4535054061007901c02f1280d0024c0b51829b6e2a01c0ffff66008c01568c81b605a8fa7f80ff8f00f847"
            "0020048004100000005405521508000022880000c003"
        ),
    ),
    "octree": Sample(
        3,
        "020100010003060200100000000000000000000000000000",
        (8, 8, 8),
        1176,
        0x266C6B69,
        (
            "696b6c2603146000000200100000000080030008000000800000001c20cae67d71ec8e231889ff17bce418857fe0c2dbf85d5d1ae91e58826a8996706282269881"
            "271c4320e8b5e7096299f8302b087e9c2a862ae685200200002c5e2548a5711a614408800700a000000e00081c00f001008083062a680000d000ba28550b9710e4"
            "0b80000000078063f3baea853d11abce57253095dd77a8d3ed6977d9ac62a6cd0af4576d4df65bdb3b507797db487fac83ad4eff2b4c3085e97a5946099e84f7f6"
            "55d325a165086c3ec191c062613f1073cda97722306171bbe972e9cd81524112dd9eed3f7a1fc549c3f0de26d58af4e29199f3cd0eee069d3d57a485ac88944eca"
            "bc03de0e2c00500e4400000b4805de1f400400"
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
