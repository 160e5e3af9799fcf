"""Indexes that the program makes, read as sections 58 to 65 of formats.md specify.

    pytest tests/foreign/test_index.py
    SPINNEY_PROGRAM=target/debug/spinney python tests/foreign/test_index.py

Tests that need the program are skipped if SPINNEY_PROGRAM does not name one.
"""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from basics import Bytes, CorruptFile, Point, Unknown, crc32c
from index import DEFLATE as ZLIB
from index import Format, Index, Location, Rule, Source, read_table
from lzw import decompress
from reader import Entry, Goblin, Layer
from test_manifest import program, run
from tiffs import DEFLATE, LZW, Tiff, compress_lzw
from trees import INNER, REFERENCE, VOID, Values, raw_bits
from verify import verify

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "format" / "index.md").read_text()
__all__ = ["program"]

# Columns and rows of most sources: 2 x 2 blocks, of which three are not whole.
WIDTH, HEIGHT = 300, 280


def image(kind: str, channels: int = 1, bits: int = 0, width: int = WIDTH, height: int = HEIGHT) -> Values:
    """Returns an image with areas of equal and of different values, the latter mostly at the corner
    of four blocks."""
    y, x = np.mgrid[:height, :width]
    wave = np.sin(x / 23) * np.cos(y / 31) + np.where((x // 40 + y // 50) % 3 == 0, (x * 7 + y * 3) % 5, 0)
    wave = np.where((x > 170) & (y > 180) | (x < 40) & (y < 30), wave, 0.5)
    planes = np.stack([wave * (c + 1) - c for c in range(channels)], -1)
    dtype = np.dtype(kind)
    if dtype.kind == "f":
        # (Eight bits of fraction fit 24 and 16 bits.)
        return (np.round(planes * 64) / 64).astype(dtype)
    most = (1 << (bits or 8 * dtype.itemsize - (dtype.kind == "i"))) - 1
    scaled = np.clip((planes - planes.min()) / np.ptp(planes) * min(most, 999), 0, most)
    return np.round(scaled).astype(dtype) - (100 if dtype.kind == "i" else 0)


def write(directory: Path, name: str, data: bytes) -> None:
    (directory / name).write_bytes(data)
    os.utime(directory / name, ns=(0, 1_704_067_200_000_000_000))


def made(program: str, directory: Path, sources: str, options: str = "") -> Index:
    """Returns the index of sources, which has the same levels as a tree of them."""
    run(program, directory, f"index {sources} -o index.goblin {options}")
    run(program, directory, f"build {sources} -o tree.goblin {options.replace('--stored-level 1', '').replace('--stored-level 4', '')}")
    index, tree = Index(str(directory / "index.goblin")), Goblin((directory / "tree.goblin").read_bytes())
    assert all(layer.form.codec == REFERENCE and layer.form.heavy == 0 for layer in index.layers)
    for layer, other in zip(index.layers, tree.layers):
        depth, stored = layer.form.depth, layer.form.depth - layer.form.stride
        for level in range(max(stored, 0) + 1):
            compare(layer.window(level), other.window(level))
        # The others block by block.
        for entry in layer.entries:
            for level in range(max(stored, entry.node.level), depth + 1) if layer.is_reference(entry) else ():
                shift = level - entry.node.level
                low, high = (tuple(v + i << shift for v in entry.node.at) for i in (0, 1))
                compare(part_of(layer, entry, level, low, high), other.window(level, low, high))
        cells, known = other.window(depth, (0, 0), layer.form.extent[:2])
        compare(index.cells(0, (0, 0, *layer.form.extent[:2])), (cells, known))
    return index


def part_of(layer: Layer, entry: Entry, level: int, low: Point, high: Point) -> tuple[Values, Values]:
    """Returns values and states of the nodes of a level below a block, from its own segment."""
    values = np.zeros((*(b - a for a, b in zip(low[::-1], high[::-1])), layer.form.channels), layer.form.type)
    states = np.full(values.shape[:2], INNER, np.uint8)
    if level > entry.node.level:
        layer.paint(layer.start(layer.records(entry)), level, low, high, values, states)
        return values, states
    return layer.window(level, low, high)


def compare(found: tuple[Values, Values], expected: tuple[Values, Values]) -> None:
    assert (raw_bits(found[0]) == raw_bits(expected[0])).all() and (found[1] == expected[1]).all()


def array(program: str, directory: Path, options: str = "") -> Values:
    """Returns cells, or nodes of a level, as the program reads them from an index."""
    run(program, directory, f"get index.goblin level.npy {options}")
    return np.load(directory / "level.npy")


VARIANTS: dict[str, tuple[Tiff, Values, str]] = {
    "strips": (Tiff(), image("u1"), "--stored-level 1"),
    "large": (Tiff((320, 288)), image("u1", bits=2), "--kind categorical --stored-level 4"),
    "tiles": (Tiff((48, 32), DEFLATE, 2, is_big=True), image("<u2"), ""),
    "signed": (Tiff((0, 100), LZW, 2), image("<i2"), "--stored-level 4"),
    "floats": (Tiff((112, 16), DEFLATE, 3, is_big=True), image("<f4"), ""),
    "doubles": (Tiff((0, 280), LZW, 3), image("<f8"), ""),
    "halves": (Tiff((64, 64), DEFLATE, bits=16), image("<f4"), ""),
    "three bytes": (Tiff((64, 64), DEFLATE, bits=24, is_big=True), image("<f4"), ""),
    "wide": (Tiff((64, 64), DEFLATE, 2), image("<u8"), ""),
    "interleaved": (Tiff((48, 32), LZW, 2), image("u1", 3), ""),
    "planes": (Tiff((48, 32), DEFLATE, 2, is_planar=True), image("u1", 3), ""),
    "bits": (Tiff((0, 9), DEFLATE, bits=1, is_lowest_first=True), image("u1", bits=1), "--kind categorical"),
    "nibbles": (Tiff((32, 16), LZW, bits=4), image("u1", bits=4), "--kind categorical --rule dominant"),
    "twelve": (Tiff((32, 16), bits=12), image("<u2", 3, bits=12), ""),
    "three unsigned bytes": (Tiff((32, 16), DEFLATE, bits=24), image("<u4", bits=24), ""),
    "old": (Tiff((0, 50), LZW, is_old_lzw=True), image("u1", bits=3), "--kind categorical"),
    "opacity": (Tiff((48, 32), DEFLATE, has_opacity=True), np.where(image("u1", 4) < 90, 0, image("u1", 4)), ""),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_an_index_is_a_tree_of_its_source(program: str, tmp_path: Path, name: str) -> None:
    tiff, pixels, options = VARIANTS[name]
    write(tmp_path, "source.tif", tiff.file(pixels))
    index = made(program, tmp_path, "source.tif", options)
    if name == "large":
        verify(index.file)
    values, states = index.cells(0, (0, 0, WIDTH, HEIGHT))
    # Values of colours may be VOID by their opacity.
    assert name == "opacity" or (states != VOID).all()
    assert (np.where((states != VOID)[..., None], values, pixels) == pixels).all()
    if name != "opacity":
        found = array(program, tmp_path).reshape(HEIGHT, WIDTH, -1)
        assert (found == values).all()


def test_parts_of_cells(program: str, tmp_path: Path) -> None:
    write(tmp_path, "source.tif", Tiff((48, 32), DEFLATE, 2).file(image("<u2")))
    index = made(program, tmp_path, "source.tif")
    rng = np.random.default_rng(1)
    for _ in range(20):
        x, y = int(rng.integers(WIDTH - 1)), int(rng.integers(HEIGHT - 1))
        width, height = int(rng.integers(1, WIDTH - x)), int(rng.integers(1, HEIGHT - y))
        assert (index.cells(0, (x, y, width, height))[0] == image("<u2")[y : y + height, x : x + width]).all()


def test_later_sources_cover_earlier_ones(program: str, tmp_path: Path) -> None:
    """Nodata of a source shows what is below."""
    expected = np.full((330, 340), 77, np.uint8)
    for number, (x, y) in enumerate([(0, 0), (100, 50), (40, 130)]):
        pixels = image("u1", bits=3, width=240, height=200) + number
        pixels[20:90, 30:120] = 9
        chunk = [(48, 32), (0, 11), (64, 16)][number]
        write(tmp_path, f"{number}.tif", Tiff(chunk, [1, DEFLATE, LZW][number], nodata="9", at=(x, y)).file(pixels))
        part = expected[y : y + 200, x : x + 240]
        part[...] = np.where(pixels[..., 0] != 9, pixels[..., 0], part)
    index = made(program, tmp_path, "0.tif 1.tif 2.tif", "--kind categorical")
    assert index.count == 3 and len(index.placements[0]) == 3
    values, states = index.cells(0, (0, 0, 340, 330))
    assert (np.where(states != VOID, values[..., 0], 77) == expected).all()
    assert (array(program, tmp_path, "--nodata 77") == expected).all()
    # A hidden source is not needed.
    (tmp_path / "0.tif").unlink()
    assert Index(str(tmp_path / "index.goblin")).cells(0, (150, 140, 20, 20))[1].all()
    with pytest.raises(FileNotFoundError):
        Index(str(tmp_path / "index.goblin")).cells(0, (0, 0, 20, 20))


@pytest.mark.parametrize("kind", ["u1", "<f4"])
def test_masks_nodata_and_chunks_that_were_never_written(program: str, tmp_path: Path, kind: str) -> None:
    pixels = image(kind, bits=6)
    mask = ((np.mgrid[:HEIGHT, :WIDTH][1] // 17) % 4 != 0).astype(np.uint8)[..., None] * 255
    pixels[100:140, 100:150] = 5
    if kind != "u1":
        pixels[:5, :9] = np.nan
    write(tmp_path, "mask.tif", Tiff((48, 32), DEFLATE).file(pixels, mask))
    write(tmp_path, "nodata.tif", Tiff((48, 32), LZW, nodata="5", holes={1, 9, 40}).file(pixels))
    write(tmp_path, "zeros.tif", Tiff((48, 32), LZW, holes={1, 9, 40}).file(pixels))
    holes = np.zeros((HEIGHT, WIDTH), bool)
    for number in (1, 9, 40):
        y, x = number // 7 * 32, number % 7 * 48
        holes[y : y + 32, x : x + 48] = True
    missing = np.isnan(pixels[..., 0])
    for name, void in [
        ("mask", (mask[..., 0] == 0) | missing),
        ("nodata", holes | (pixels[..., 0] == 5) | missing),
        ("zeros", missing & ~holes),
    ]:
        index = made(program, tmp_path, f"{name}.tif")
        values, states = index.cells(0, (0, 0, WIDTH, HEIGHT))
        assert ((states == VOID) == void).all(), name
        expected = np.where(holes, 0, pixels[..., 0]) if name == "zeros" else pixels[..., 0]
        assert (values[..., 0][~void] == expected[~void]).all(), name
        assert (array(program, tmp_path, "--nodata 77") == np.where(void, 77, expected)).all(), name


def test_few_cells_and_no_cells(program: str, tmp_path: Path) -> None:
    write(tmp_path, "small.tif", Tiff((0, 1)).file(image("u1", width=9, height=3)))
    index = made(program, tmp_path, "small.tif")
    assert len(index.layers[0].entries) == 1
    verify(index.file)
    write(tmp_path, "equal.tif", Tiff().file(np.full((512, 512, 1), 3, np.uint8)))
    assert made(program, tmp_path, "equal.tif").layers[0].entries == []


def test_many_blocks_and_chunks(program: str, tmp_path: Path) -> None:
    """More than a page of entries, and of chunks."""
    pixels = np.zeros((3100, 3200, 1), np.uint8)
    pixels[::97, ::89] = (np.arange(36) % 7)[:, None]
    pixels[2048:2304, 1664:1700] = 9
    write(tmp_path, "source.tif", Tiff((32, 32), DEFLATE).file(pixels))
    run(program, tmp_path, "index source.tif -o index.goblin --kind categorical")
    index = Index(str(tmp_path / "index.goblin"))
    layer, source = index.layers[0], index.source(0)
    assert len(layer.entries) > 128 and source.images[0].chunks == 9700
    assert all(isinstance(page, Location) for page in source.images[0].table)
    region = (1500, 2500, 300, 400)
    assert (index.cells(0, region)[0] == pixels[2500:2900, 1500:1800]).all()
    for level in (3, 5, layer.form.depth - 2):
        found = array(program, tmp_path, f"--level {level}")
        size = found.shape[::-1]
        assert (layer.window(level, (0, 0), size)[0][..., 0] == found).all()
    for entry in layer.entries[::9]:
        assert layer.find(entry.node) == entry
    for entry in layer.entries[::40]:
        assert layer.segment(entry)


def test_a_changed_source(program: str, tmp_path: Path) -> None:
    """A chunk with other bytes is refused, but only if it is needed. Another time is a warning."""
    write(tmp_path, "source.tif", Tiff((48, 32), DEFLATE, 2).file(image("<u2")))
    path = str(made(program, tmp_path, "source.tif").path)
    source = Index(path).source(0)
    chunk = Index(path).chunk(source.images[0], 30)
    assert chunk
    data = bytearray((tmp_path / "source.tif").read_bytes())
    (tmp_path / "source.tif").write_bytes(data)
    with pytest.warns(UserWarning, match="another length or time"):
        assert Index(path).cells(0, (0, 0, WIDTH, HEIGHT))[1].all()
    data[chunk[0] + chunk[1] // 2] ^= 4
    write(tmp_path, "source.tif", bytes(data))
    x, y = 30 % 7 * 48, 30 // 7 * 32
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (Index(path).cells(0, (0, 0, WIDTH, y))[0] == image("<u2")[:y]).all()
    with pytest.raises(CorruptFile, match="not the one that was indexed"):
        Index(path).cells(0, (x, y, 1, 1))
    # The program reads whole blocks.
    for window, code in ((f"256,0,{WIDTH - 256},{HEIGHT}", 0), (f"{x},{y},1,1", 1)):
        command = [program, "-q", "get", path, str(tmp_path / "part.npy"), "--window", window]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert min(done.returncode, 1) == code, done.stderr
        assert code == 0 or "source.tif" in done.stderr and "index --update" in done.stderr
    # A shorter file, too.
    (tmp_path / "source.tif").write_bytes(data[: chunk[0]])
    with pytest.warns(UserWarning), pytest.raises(CorruptFile, match="beyond the end"):
        Index(path).cells(0, (x, y, 1, 1))


def test_bits_of_the_sections_matter(program: str, tmp_path: Path) -> None:
    """Flipped bits of an index are noticed: checksums cover all."""
    write(tmp_path, "source.tif", Tiff((0, 5)).file(image("u1", bits=2, width=20, height=18)))
    path = Path(made(program, tmp_path, "source.tif", "--kind categorical").path)
    data = path.read_bytes()
    ignored = 0
    for at in range(24, len(data), 3):
        changed = bytearray(data)
        changed[at] ^= 1 << at % 8
        path.write_bytes(changed)
        try:
            verify(Index(str(path)).file)
            ignored += 1
        except (CorruptFile, Unknown):
            pass
    assert ignored == 0


def with_list(data: bytes, change: Any) -> bytes:
    """Returns an index whose list of sources is changed, with right checksums."""
    size = struct.unpack("<I", data[-16:-12])[0]
    trailer = bytearray(data[-16 - size : -16])
    for at in range(36, size, 24):
        if trailer[at : at + 4] == b"SRCS":
            start, length = struct.unpack("<QQ", trailer[at + 8 : at + 24])
            found = change(data[start : start + length])
            # (At the end, since its length differs.)
            moved = data[: -16 - size] + found
            trailer[at + 4 : at + 24] = struct.pack("<IQQ", crc32c(found), len(data) - 16 - size, len(found))
            trailer[24:32] = struct.pack("<Q", len(moved) + size + 16)
            return moved + bytes(trailer) + struct.pack("<II", size, crc32c(bytes(trailer))) + data[-8:]
    raise AssertionError("no list of sources")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("01 00 00 00 00 00 00 01", "01 00 00 01 01 00 00 00 01"),
        ("01 00 00 00 00 00 00 01", "01 00 00 00 00 01 01 00 01"),
        ("01 01 00 08", "02 01 00 08"),
        ("08 04 01 01", "00 04 01 01"),
        ("08 04 01 01", "fc 00 00 00 80 04 01 01"),
        ("01 01 00 08 00", "01 02 00 08 00"),
        ("01 01 00 08 00", "01 01 03 08 00"),
        ("01 01 00 08 00", "01 01 02 08 00"),
        ("01 01 00 08 00 00", "01 01 00 08 00 01"),
        ("01 01 00 08 00 00 00", "01 01 00 08 00 00 03"),
        ("01 01 00 01 00 01", "02 01 00 01 00 01"),
        ("01 01 00 01 00 01", "01 02 00 01 00 01"),
        # The program accepts nodata of another length, without an effect.
        ("01 00 01 14", "01 01 02 05 05 01 14"),
        ("01 00 01 14", "01 00 02 14"),
        ("01 01 00 45", "02 01 00 45"),
        ("01 01 00 45", "01 02 00 45"),
        ("", "00"),
    ],
)
def test_invalid_lists_are_refused(program: str, tmp_path: Path, before: str, after: str) -> None:
    data = example(program, tmp_path)
    path = tmp_path / "changed.goblin"
    path.write_bytes(with_list(data, bytes))
    assert Index(str(path)).cells(0, (0, 0, 8, 8))[1].all()

    def change(stored: bytes) -> bytes:
        assert bytes.fromhex(before) in stored
        if not before:
            return stored + bytes.fromhex(after)
        return stored.replace(bytes.fromhex(before), bytes.fromhex(after), 1)

    path.write_bytes(with_list(data, change))
    with pytest.raises(CorruptFile):
        Index(str(path)).cells(0, (0, 0, 8, 8))
    command = [program, "-q", "get", str(path), str(tmp_path / "cells.npy")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "panicked" not in done.stderr, done.stderr


def test_lzw() -> None:
    rng = np.random.default_rng(2)
    for data in (b"", b"a", b"aaaaaaaa" * 99, bytes(rng.integers(0, 256, 20000, np.uint8)), bytes(rng.integers(0, 3, 90000, np.uint8))):
        for is_old in (False, True):
            packed = compress_lzw(data, is_old)
            assert decompress(packed, len(data)) == data and decompress(packed, len(data) // 2) == data[: len(data) // 2]
            assert len(decompress(packed[: len(packed) // 2], len(data))) < max(len(data), 1)
    with pytest.raises(CorruptFile):
        decompress(bytes.fromhex("80 7f ff"), 9)


def example(program: str, directory: Path) -> bytes:
    """Returns the index of section 67, which the commands there make."""
    text = (ROOT / "docs" / "format" / "goblin.md").read_text()
    cells = bytes(int(v) for row in re.findall(r"^    ((?:\d ){7}\d)$", text, re.M)[:8] for v in row.split())
    tags = [(256, 3, 1, 8), (257, 3, 1, 8), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 2, 186)]
    tags += [(277, 3, 1, 1), (278, 3, 1, 4), (279, 4, 2, 194)]
    directories = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + bytes(4)
    write(directory, "classic.tif", b"II*\0" + struct.pack("<I", 72) + cells + directories + struct.pack("<4I", 8, 40, 32, 32))
    for command in re.findall("^spinney (.*)$", PAGE.partition("## 67.")[2], re.M):
        run(program, directory, command)
    return (directory / "classic.index.goblin").read_bytes()


def dumped() -> list[tuple[int, bytes, str]]:
    """Returns the lines of the dump of section 67 except dots: offset, bytes, meaning."""
    block = PAGE.partition("<!-- dump: index -->")[2].partition("```text\n")[2].partition("\n```")[0]
    rows = [line.split("  ", 2) for line in block.split("\n") if line != "..."]
    return [(int(offset, 16), bytes.fromhex(raw), meaning.strip()) for offset, raw, meaning in rows]


def test_the_example_of_the_page(program: str, tmp_path: Path) -> None:
    data = example(program, tmp_path)
    for at, raw, meaning in dumped():
        assert data[at : at + len(raw)] == raw, meaning
    verify(Index(str(tmp_path / "classic.index.goblin")).file)
    tree = Goblin((ROOT / "fixtures" / "v1" / "classic.goblin").read_bytes()).layers[0]
    layer = Index(str(tmp_path / "classic.index.goblin")).layers[0]
    assert layer.segment(layer.entries[0]) == tree.segment(tree.entries[0])
    assert layer.window(3)[0].tolist() == tree.window(3)[0].tolist()


def section(first: str, last: str) -> Bytes:
    """Returns the bytes of consecutive lines of the dump, by their meanings."""
    rows = dumped()
    start = next(i for i, row in enumerate(rows) if row[2].startswith(first))
    end = next(i for i in range(start, len(rows)) if rows[i][2].startswith(last))
    assert all(a[0] + len(a[1]) == b[0] for a, b in zip(rows[start:end], rows[start + 1 :]))
    return Bytes(b"".join(raw for _, raw, _ in rows[start : end + 1]))


def test_the_dump_is_read_as_specified() -> None:
    """Decodes the dump without the program."""
    b = section("SRCP", "no decoder")
    assert (b.unsigned(), b.unsigned()) == (1, 1)
    source = Source.read(b)
    assert b.at == len(b.data) and (source.name, source.size, source.version) == ("classic.tif", (8, 8), 1_704_067_200_000_000_000)
    (table,) = source.images[0].table
    assert isinstance(table, bytes)
    chunks = read_table(table, 2)
    assert [chunk and chunk[:2] for chunk in chunks] == [(8, 32), (40, 32)]
    for count in (1, 3):
        with pytest.raises(CorruptFile):
            read_table(table, count)
    b = section("SRCS", "its checksum")
    assert (b.unsigned(), b.unsigned()) == (1, 1)
    form = Format.read(b)
    assert (form.width, form.height, form.type, form.compression != ZLIB) == (8, 4, np.dtype("u1"), True)
    assert b.unsigned() == 1 and Rule.read(b) == Rule(None, False, None, False, None, False)
    b = section("reference", "no VOID cells")
    assert b.data.hex() == "ed587cf9" + "0128" + "020f" + "03" + "060000"


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
