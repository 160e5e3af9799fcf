"""A small tree of lines: the reader finds the original features, and detects corruption.

    pytest tests/foreign
    python tests/foreign/test_lines.py

python/tests/test_foreign.py compares files made by the program with the program's own results.
"""

from __future__ import annotations

import base64
import sys
import zlib
from typing import Any

import pytest
from basics import Bytes, Code, CorruptFile, Header, Unknown, spans
from lines import Json, Lines, read_column
from sealing import resealed

# Features, and their number of nodes of 25 line segments.
FEATURES, NODES = 40, 23
# fmt: off
FILE = zlib.decompress(base64.b64decode(
    "eNqVWAtcFNUa/87M7rAuy7IujxBJiQwB7xUfcEVNWRVBFJEySMqrgGFIgCiS/XwUIgKSDwTloiCCICqg4gtNDVEzEDGwsof4K0pTUigSVBa0vefMnNldtuh2z3rmzJz5z/f9v+cM"
    "ZvstjYhZEidHAMBIrIGMTVGPlCADBoQhcUy6JqnchRLe4EASxUHQv1PGghWw5Ak8ZZkwGhz8VJ+AAxuvqBmtXa44bRbNzqxUh37rZBVu834GA4kwAiNr8ETp8RPXpf3lMPMf1b0C"
    "1Qz7BcVv9Q8oNV+QZXd5B5w7sLDlh78eRQ+lktGQjjQNo4NqHY4Pvmc+LGILmnjXrrqSAfsxcph8IWJSDfNk+OpTHrnZa7osAxeFpB9c7ef0wNe5QXeQs3v/29bvV1qH+RTP2/Cy"
    "R9jUzIyonCGlLV4FJRIz682SxGqtVcLOKzfvOb3GJW+sfHp824ZFYerKJ/ORffz61N1Njbc+CZ2mKnxB5tGS+v5d5892jamui7j/pjt4tnALNbqG2fmekWu2Xbae7SX3kKwbvGaK"
    "dwIb11Rp5dF2h4IznB1eqmtR3Woxj5IxT5qxvLmfPhcacD2luDB8eJMqJc/rnfpupw9dd8VbY0DPt4rWPR9tPF66ac5UC6y2tXE+wttYdm9s3I8VrrfNC4t0H2suBTYJKPdjuXsH"
    "+BWhcVjS4Php5JGuseOWfQVx4IQjk0WiUzjqgqmXPY5WmUboi4KOjptDYODW/xHJtLSX79qlL3LcguatB1VCw+gZvmOytuW7z5jsvHXreM66QwGLFg/l7s6u/VqbuODwERSeeeH1"
    "VxaUXugtflz97NgTh71XazNeChyys9v1Zs76tSnt51/3ZfLnr/2tuvLBmvqz46zOLPe0ePbsuRmxC0MevdUxrTzaY57N70fLhjfvC/64KiTSYt6NbP/w4Ovbg68vxoCuuODO5rIt"
    "s/Ep01Tmlhp84Z8V96/8OD4ksTjkJ5+qsuETR72xw7U8+ge8+41PudPL5avsMfa3vcEbUXnG3PJVx1bVliWNKd/VUFbQNit0R1pM8My3g+c89j1UdjU82KWmrCBGWXH/SJXb+pjg"
    "ORxIQRwSVSGpL2Gie2Z10mtoF1OALkjm56BstoatlJ5j8qSP0HF2E6eVrJN2SZvZQ8xt6R1UJ6lj8iRollbqOvUk28Q+lFayj9jnD6KdZh8yfYsUkQLT9arwFZ7dAOwzHR7ekj8O"
    "Fn6pam6vaj7UkITqSrKulGQdlJ0kG+05iF+q8pQCot1O2K9yFi6rFDphDLgl4F46JezbJgnDopSIu3IHbSNLyUMpv2T97MgvV1KcBLmbzWr5DX9B2h7ZPuH2RGyTfozSvM0sG4uy"
    "/tMW4l79XQiSIdyjuL+aCJRKDpWiVnQHXUR38a9ef5XKVjP16HM2mSllQM73L34EhSFo3glVoVqdu3rtXhYmdo93bfvVKH52Ycbx4/DDotvBMcyT/WYnvOtsduJhQ7v/6GuHRj72"
    "QBzHoSoUdgYfIsjhrTMIYXYyBfQ9gtFR3GFBwQ+WOrT1A3riLHpYWGpk9JrruxayiCN+YoBh8ERKR87EBY+Rz0Xks0KDyc3T3EL30Tf4dwb1UN8gJbaSQbovwgGl3pYRs/G9rzIQ"
    "fwOnmgLnF4Mn0ULeAfyP3KnYyJ2v4ODXkdDyNQPnJxN44yZ0LI3bfwnB7nYGTm1HsM6V7HexhUM7RgL+VzMZRA3QI6wmB2QPSgAFKPBRjvi3lBLrVDBEu5IPBmIEk8kFZsWfSRhU"
    "U8El/SKFRkvYk8NC5T0Gvr/KZdYxsGforWQWtl5mgVzh5zH3nxolhC6cOI+g9HmoyEV5M8nGo91SKFkGB2oY/jaCJktM/5Z54VDCvWYyXrtY/gyAv6EnrsU/Y1tEI/tY18l2skim"
    "BFtbJTFTCdbYVLk1WCvRKCHJBFczQjyBOBYPEp6OTDlPCY/6LZgZZkD0f2JVMXj7i5iWgYXWwAWBwlatVitxNNWGWoMxeiUM1dSUylJddKD0VHNRHz+6WBOdT93ujGmYcGJq/kzs"
    "I1PtpjyUoLbGPFQqtYKQYfjX0BAjdTiIHMMYseIpJT1hcIbB7YMsjqIe25FmgV2ixdx+HGDMEWEiHSMFhnygTKmKkSBh6GT7oYy5gjUmC0p85BnjNgD8F5CCz0EaKOpCIf8YuUi7"
    "I3sAyUHgkw1nIL82prLN5sJzW+sY1HNb5H12CfR0M9D5hIXkYqY8l9qSd1aKaOYRC4SEw/UDfR0PhqzSG2Q4GN0RfiQQaoUtNoxkH/7u481TKmRIDo7QNxhG6YEyiywFk/SALfks"
    "/FzG9EkQQhj+ND+MOGn/3OH2hJUau1qlVKEAvie17FcDygngk87Qk+wxUZVAEARiOC9I9ylrkULDBGjcyOAvm6HGjcaot5CugoU4YCGkqVFblYxoL68UP53Ug4jBvM3oTqkEfr+G"
    "Y/klC8cGUZOJDmIittkoToZwGJTySnDSqHGxK2xtQY0Uo/BLg6jCveBEmezoINTFdrEI8CXIkEL/uhEYYoKcWKb8KU9SzCYdrgJsfq8bBmJZhoC0piA+QpcykRCavmER0smYNdXa"
    "t1dhStZyWxIZpQq7To7LAolVa+hUJBSVh23oPt83S+ot9Fx69yPhLWCgoO9XxukpxMhWYWetAqwQBE1Izedg0llb/qrtmAW/irmV8qqRDCTD+aMQTbESyhYc8Exo9sznX+RXO3WX"
    "7BC/PpiIQCJAXNwpdj2ei9HhHoVRtjteBQi5CBSb5HKMYh/g2XbSy4YYHnQJYPAEAE0OAq0lEj8oXHebCSdhxA8RuaUDqMzaKQii7QC2p4tYR9dnFLsZz496XY+QTnMgHGDvfARe"
    "tbj2U0RsmGsG/XQ6QhidOpU4kGK7i3AONQKEN4q2JbmOp0p/wLMsfUOryHdYl8D3u0Y9Xzd7uYGDdsKDkYTDjFYEudi2Dn8G3DNA5Ou2X27w76Pn824Q/xKMuRVufqEMjP2XiNW4"
    "XaLY6XjOe+/cao7KtTmNU/UJAnMLvW1uMprbH+A5MHTUIgWV67kRwOssA6Gg5zsijWJJqkQt6noqcvDDtXR/JgO75Hr/jthHsUV4ntl//gMVxRJ58ekMPA7UcxjhSxMgGk/LJQ+9"
    "Cf3ccgZOJ+NP788YOHND798RlRTrReStO9pIZBDMlzjvL77AQlWFoUkW09WFrstnwOUCh/Uako/kmuCJbPEJRt+SjYeTxjSP6X3HIooYbiz/y2SN+KQon8p1+bt4+gXtsoDuD6Lr"
    "oUlff6pDK/V4MZ/EuhLriJYMrL1elxC9LEDTX22JTUSsk3dU7QXT972uMa0vKt9V9CMtHVjs7VOwwG6hRqwxsRbEehxg4teE7qkfz7WcrOmvJpUm+Lv+PS9++LOfpr+6HEhx4l8c"
    "h063jU/3FvB/Vps2Jv4ZNtmvZN9AwV7j+qTy3KZRnMgrtvTV1NWBsRpSS6TuxHhR/7g5URwtP2j3lWwGlzA9ntSTofbAzdTe3iva4bO00zX99QDT/KzUoQ5djaumvz7AmfinM1F1"
    "63yYRtNfLxDzh9oDN9/kPE7dmKYx7Qf0/ggHihP/oNvx676TGT2vacQ6F2tX7B+MaXx3e4+dE3Tbu78eojLhX3/4nHScwyxNf31EbiK/aVHKKxOem6Tpr5dITfxZNqm5s8LfU9Nf"
    "P7ET44QfvB9b7eMCfxzIpXjQ04O/fT47Isjb9N5T3RIswpqTroxaGhMJXFxibETkciRZEfneCka6YnniiihWEp2wNE5ilhD5buTy8BgpVd7hDX9r/P84BL13VUb0zeMiV4x8O3Ip"
    "ocFvZPfzH5mJNobgB0wNmDWxxau1lWbQdhqBgMA5PjarVn6xhn7PBtHMCfCdPsU5dtiNBivh+h9Ue4B/4NzFx8/+1E3359D92dNfm3KgetqnfoJ6SKb7+eTFNeFmlTxuSUzEUr/s"
    "/wJLZ4th"
))
# fmt: on


def feature(i: int) -> tuple[list[list[tuple[float, float]]], list[Any]]:
    """Returns lines and values of a feature."""
    k = i * i * 7919 % 1009
    x, y = (-800.0 if i == 7 else i % 8 * 25.0), k / 8
    lines = [[(x, y), (x + k % 5, y + 0.125), (x + k % 5, y + 9)]]
    if i % 3 == 0:
        lines.append([(x + j * j / 4, y - j * (k % 3) / 8) for j in range(k % 11 + 2)])
    strings = ["", "Strasse", "Stra\u00dfe", "\u9053", None]
    mixed = [i, i / 2 + 0.25, strings[k % 5], i % 2 == 0, Json('{"a": [1, null]}'), None]
    return lines, [k - 500, i - 2**40 if i % 2 else k / 7, strings[i % 5], None if i % 4 == 1 else k % 2 == 0, Json(f"[{i % 3}]"), mixed[i % 6]]


def test_features_come_out() -> None:
    tree = Lines(FILE)
    found = [([[tree.world(vertex) for vertex in line] for line in of.lines], of.values) for of in tree.each_feature()]
    made = [feature(i) for i in range(FEATURES)]
    assert found == made
    assert [[type(value) for value in values] for _, values in found] == [[type(value) for value in values] for _, values in made]
    assert (tree.features, len(tree.nodes)) == (FEATURES, NODES)
    assert [(of.name, of.kind) for of in tree.attributes] == list(zip(["whole", "number", "text", "truth", "json", "several"], range(6)))
    tree.verify()


def test_nodes_summarize_what_is_below() -> None:
    tree = Lines(FILE)
    root = tree.nodes[Code(0, (0, 0))]
    assert (root.segments, root.features) == (tree.segments, FEATURES)
    assert sum(len(segments) for _, segments in tree.walk()) == tree.segments
    assert sum(len(line) - 1 for of in tree.each_feature() for line in of.lines) == tree.segments


def read(data: bytes) -> Lines:
    """Returns a tree after reading all of it."""
    tree = Lines(data)
    assert sum(len(segments) for _, segments in tree.walk()) == tree.segments
    assert len(list(tree.each_feature())) == tree.features
    return tree


def test_each_flipped_byte_is_noticed() -> None:
    # A checksum covers each byte of a file.
    for at in range(0, len(FILE), len(FILE) // 500):
        changed = bytearray(FILE)
        changed[at] ^= 1 << at % 8
        with pytest.raises((CorruptFile, Unknown)):
            read(bytes(changed))


def test_corruption_with_valid_checksums() -> None:
    """Corrupt bytes, one in each file, with valid checksums: an error, or the right number of
    features and line segments."""
    assert resealed(bytearray(FILE), FILE) == FILE
    errors, offsets = 0, range(0, len(FILE) - 16 - 36 - 24 * 5, len(FILE) // 250)
    for at in offsets:
        changed = bytearray(FILE)
        changed[at] ^= 1 << at % 7
        try:
            read(resealed(changed, FILE)).verify()
        except (CorruptFile, Unknown):
            errors += 1
    assert errors > 0.75 * len(offsets)


def test_other_contents_and_numbers_are_refused() -> None:
    at, size, _ = spans(FILE, Header.read(FILE))[b"LINS"]
    for place, value, error in [(13, 3, Unknown), (12, 3, CorruptFile), (14, 2, CorruptFile), (16, 1, CorruptFile), (at, 2, Unknown), (at + size - 1, 6, Unknown)]:
        changed = bytearray(FILE)
        changed[place] = value
        with pytest.raises(error):
            Lines(resealed(changed, FILE))


def test_columns() -> None:
    assert read_column(Bytes(b""), []) == []
    assert read_column(Bytes(b"\1\x02\x03\x80\x01"), [0] * 3) == [1, -2, 64]
    assert read_column(Bytes(b"\3\x02\x03\x80\x01"), [0] * 3) == [1, -1, 63]
    most = b"\xfe" + b"\xff" * 8 + b"\1"
    assert read_column(Bytes(b"\1" + most), [0]) == [2**63 - 1] and read_column(Bytes(b"\3" + most + b"\2"), [0, 0]) == [2**63 - 1, -(2**63)]
    for changed in (b"\4\0", b"\1", b"\1" + b"\xff" * 10, b"\1" + b"\xff" * 9 + b"\2"):
        with pytest.raises(CorruptFile):
            read_column(Bytes(changed), [0])


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
