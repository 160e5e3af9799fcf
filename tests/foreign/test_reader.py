"""Checks formats.md against the frozen files, with a reader written only from that page.

    pytest tests/foreign
    python tests/foreign/test_reader.py
"""

from __future__ import annotations

import random
import re
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from autumnal import FIRST, Autumn
from basics import Code, CorruptFile, Unknown, crc32c
from models import Model
from reader import Goblin
from trees import INNER, VOID, Tree, raw_bits
from verify import verify

ROOT = Path(__file__).parents[2]
FIXTURES = ROOT / "fixtures" / "v1"
MODELS = ["chapel.goblin", "crossing.goblin", "chapel_packed.goblin", "crossing_packed.goblin"]
CELLS = sorted(path.name for path in FIXTURES.glob("*.goblin") if path.name not in MODELS)
HISTORIES = sorted(path.name for path in FIXTURES.glob("*.autumn"))
CLASSIC = np.array(
    [[int(v) for v in row.split()] for row in re.findall(r"^    ((?:\d ){7}\d)$", (ROOT / "docs/format/goblin.md").read_text(), re.M)[:8]], np.uint8
)
# Maximum number of nodes of a level that are looked up individually; of more, a random sample of
# this size.
NODES = 1 << 15


def fixture(name: str) -> bytes:
    return (FIXTURES / name).read_bytes()


def compare_ways(tree: Tree) -> None:
    """Checks that windows of all levels have the values found node by node, and contain their
    sub-windows."""
    f, rng = tree.form, random.Random(7)
    for level in range(f.depth + 1):
        values, states = tree.window(level)
        assert values.shape == (1 << level,) * f.axes + (f.channels,)
        offsets = range(states.size) if states.size <= NODES else rng.sample(range(states.size), NODES)
        for place in offsets:
            at = np.unravel_index(place, states.shape)
            expected = values[at].tobytes() if states[at] != VOID else None
            assert tree.value(Code(level, tuple(int(v) for v in at[::-1]))) == expected, (level, at)
        for _ in range(5):
            low, high = zip(*[sorted((rng.randrange(1 << level), rng.randrange(1 << level))) for _ in range(f.axes)])
            high = tuple(v + 1 for v in high)
            part = tuple(slice(a, b) for a, b in zip(low, high))[::-1]
            found = tree.window(level, low, high)
            assert (raw_bits(found[0]) == raw_bits(values[part])).all() and (found[1] == states[part]).all()


def notices(data: bytes, at: int, bit: int = 0) -> bool:
    """Whether a file with one flipped bit is rejected."""
    changed = bytearray(data)
    changed[at] ^= 1 << bit
    try:
        if data[:8] == b"\x93Autumn\n":
            Autumn(bytes(changed)).verify()
        elif data[13] == 2:
            model = Model(bytes(changed))
            assert model.leaves and model.parts and model.tables
        else:
            verify(Goblin(bytes(changed)))
    except (CorruptFile, Unknown):
        return True
    return False


def test_words_of_the_page() -> None:
    assert crc32c(b"123456789") == 0xE3069283
    assert Code(1, (1, 1)).code == 0x6000000000000001 and Code(1, (1, 1, 1)).code == 0x7000000000000001
    assert Code(4, (9, 3)).code == 0x2580000000000004 and Code(4, (9, 3, 0)).code == 0x1098000000000004
    assert Code.of(0x1098000000000004, 3) == Code(4, (9, 3, 0)) and Code(4, (9, 3)).path == [1, 0, 2, 3]
    with pytest.raises(CorruptFile):
        Code.of(0x6000000000000000, 2)


def test_there_are_files() -> None:
    assert len(CELLS) >= 6 and HISTORIES and all((FIXTURES / name).exists() for name in MODELS)


@pytest.mark.parametrize("name", CELLS)
def test_all_of_a_file_is_right(name: str) -> None:
    verify(Goblin(fixture(name)))


@pytest.mark.parametrize("name", CELLS)
def test_both_ways_find_the_same(name: str) -> None:
    for layer in Goblin(fixture(name)).layers:
        compare_ways(layer)


@pytest.mark.parametrize("name", CELLS)
def test_the_index_leads_to_the_deepest_segment(name: str) -> None:
    rng = random.Random(8)
    for layer in Goblin(fixture(name)).layers:
        for _ in range(300):
            level = rng.randrange(layer.form.depth + 1)
            node = Code(level, tuple(rng.randrange(1 << level) for _ in range(layer.form.axes)))
            above = [e for e in layer.entries if e.node.level <= level and node.up(level - e.node.level) == e.node]
            assert layer.find(node).node == max(above, key=lambda e: e.node.level).node


def test_classic_is_the_raster_of_the_page() -> None:
    (layer,) = Goblin(fixture("classic.goblin")).layers
    assert CLASSIC.shape == (8, 8)
    assert (layer.window(3)[0][..., 0] == CLASSIC).all()
    assert layer.meta["counts"] == [(0, 0, 1), (0, 1, 3), (0, 6, 6), (0, 24, 0)]
    (entry,) = layer.entries
    assert layer.counts(entry) == [(b"\1", 40), (b"\2", 15), (b"\3", 9)]
    assert (entry.statistics.sums, entry.statistics.squares) == ([97], [181])


def test_metadata() -> None:
    (layer,) = Goblin(fixture("classes.goblin")).layers
    meta = layer.meta
    assert meta["frame"]["matrix"][0] == (50.0, 0.0, 0.0, 300000.0) and meta["frame"]["crs"]["keys"][2] == [3072, 0, 1, 32628]
    assert meta["classes"][4] == "forest" and meta["palette"][1] == (74, 142, 178, 255) and meta["nodata"] == 0
    assert meta["bands"] == ["land cover"] and meta["tags"] == {"AREA_OR_POINT": "Area"} and meta["repeated"] == 1
    (layer,) = Goblin(fixture("elevation.goblin")).layers
    assert layer.meta["scales"] == [(1.0, 0.0)] and layer.meta["nodata"] == -9999


def test_each_flipped_byte_of_classic_is_noticed() -> None:
    # A checksum covers each byte, including those that readers ignore (15 of the header and
    # others).
    data = fixture("classic.goblin")
    assert [at for at in range(len(data)) if not notices(data, at, at % 8)] == []


def test_corruption_with_valid_checksums_is_detected() -> None:
    """Corrupts each byte of the run of classic.goblin in turn, with valid checksums."""
    data = fixture("classic.goblin")

    def put(changed: bytearray, at: int, start: int, end: int) -> None:
        changed[at : at + 4] = struct.pack("<I", crc32c(bytes(changed[start:end])))

    for at in range(0x18, 0xD9):
        changed = bytearray(data)
        changed[at] ^= 4
        if not 0xAB <= at < 0xAF:
            put(changed, 0xAB, 0x18, 0x83)
        # The page's checksum is in the top level, the top level's in the layer table.
        put(changed, 0x16A, 0x83, 0xD9)
        put(changed, 0x1F2, 0x156, 0x16E)
        put(changed, 0x22E, 0x16E, 0x206)
        put(changed, 0x246, 0x206, 0x242)
        try:
            verify(Goblin(bytes(changed)))
        except (CorruptFile, Unknown) as error:
            # Only the checksum of a segment, when it is corrupted itself, may report an error.
            assert "checksum" not in str(error) or 0xAB <= at < 0xAF, (hex(at), error)
        else:
            # Zeros of the page, which readers ignore, and the number of a table that no codec uses.
            assert 0x87 <= at < 0x8B or at == 0xAA, hex(at)


@pytest.mark.parametrize("name", HISTORIES)
def test_histories(name: str) -> None:
    file = Autumn(fixture(name))
    file.verify()
    for commit in file.commits:
        for layer in commit.layers:
            compare_ways(layer)


def test_commits_of_the_history() -> None:
    commits = Autumn(fixture("history.autumn")).commits
    rasters = [commit.layers[0].window(3)[0][..., 0] for commit in commits]
    assert [c.message for c in commits] == ["", "Fill a box", "Set two cells", "Back to the beginning"]
    assert [(c.sequence, c.time, c.cells, c.layers[0].inner) for c in commits] == [(1, None, 64, 10), (2, 1, 64, 11), (3, 2, 63, 12), (4, 3, 64, 10)]
    filled = CLASSIC.copy()
    filled[2:5, 2:6] = 3
    cells = filled.copy()
    cells[0, 0], cells[7, 7] = 0, 2
    for raster, expected in zip(rasters, [CLASSIC, filled, cells, CLASSIC]):
        assert (raster == expected).all()
    assert commits[2].layers[0].window(3)[1][0, 0] == VOID and commits[3].layers[0].root == commits[0].layers[0].root


def test_each_flipped_byte_of_the_history_is_noticed() -> None:
    # Readers ignore the bytes between the header page's numbers and the first slot, and between
    # extents.
    data = fixture("history.autumn")
    file = Autumn(data)
    file.verify()
    bytes_that_count = {*range(24), *range(64, 72), *range(4096, 4136), *range(8192, 8232)}
    for at, (_, content) in file.cache.items():
        bytes_that_count.update(range(at, at + 32 + len(content)))
    # Four commits, the records of three, and metadata.
    assert len(file.cache) == 8
    assert [at for at in sorted(bytes_that_count) if not notices(data, at, at % 8)] == []
    others = [at for at in range(len(data)) if at not in bytes_that_count]
    assert not any(notices(data, at) for at in random.Random(9).sample(others, 50))


def test_a_corrupt_slot() -> None:
    data = bytearray(fixture("history.autumn"))
    newest, older = 8192, 4096
    for slot in (newest, older):
        changed = data.copy()
        changed[slot + 9] ^= 1
        file = Autumn(bytes(changed))
        # The newest commit is found after the known one.
        assert [c.sequence for c in file.commits] == [1, 2, 3, 4] and not file.slots_are_whole
    changed[newest + 9] ^= 1
    with pytest.raises(CorruptFile):
        Autumn(bytes(changed))
    # Data after the newest commit's end is not a commit, and may be anything.
    assert len(Autumn(bytes(data + bytes(5000))).commits) == 4 and file.commits[0].at >= FIRST


@pytest.mark.parametrize("name", MODELS)
def test_models(name: str) -> None:
    model = Model(fixture(name))
    model.verify()
    rng, most = random.Random(10), (2 << model.bits) + 8
    inside = 0
    for _ in range(300):
        p = rng.randrange(-8, most), rng.randrange(-8, most), rng.randrange(-8, most)
        is_inside = model.inside(p)
        assert is_inside is None or is_inside == (model.winding(p) == 1), p
        inside += is_inside is True
    assert inside
    for face in model.faces:
        assert model.inside(tuple(2 * v for v in face.rings[0][0])) is None or not any(face.normal)


@pytest.mark.parametrize("name", ["chapel", "crossing"])
def test_packed_models_are_the_plain_ones(name: str) -> None:
    plain, packed = (Model(fixture(f"{name}{end}.goblin")) for end in ("", "_packed"))
    assert (plain.codec, packed.codec) == (0, 1) and plain.lists == packed.lists
    assert len(packed.data) < 0.7 * len(plain.data)


def test_what_models_say() -> None:
    model = Model(fixture("crossing.goblin"))
    assert model.formula == [2, [7, "(memory)", "(memory)", "(memory)", "(memory)"], "(memory)"]
    assert [name for name, _ in model.parts] == ["tower", "spire", "mast"]
    assert model.parts[1][1] == {"type": "BuildingPart", "parents": ["tower"], "attributes": {"height": 21.0}}
    chapel = Model(fixture("chapel.goblin"))
    assert [name for name, _ in chapel.parts] == ["nave", "dome"] and chapel.meta["frame"]["crs"] == {"epsg": 2056, "heights": None}
    assert chapel.world((0, 0, 0)) == (2650000.0, 1250000.0, -1.0) and chapel.world((10, 1, 0))[0] == 2650000.1


@pytest.mark.parametrize("name", MODELS)
def test_flipped_bytes_of_models_are_noticed(name: str) -> None:
    data, rng = fixture(name), random.Random(11)
    offsets = [*range(24), *range(len(data) - 16, len(data)), *rng.sample(range(len(data)), 60)]
    assert [at for at in offsets if not notices(data, at, at % 8)] == []


@pytest.mark.skipif("stack.goblin" not in CELLS or "stack.autumn" not in HISTORIES, reason="no files of several layers")
def test_both_formats_have_the_same_layers() -> None:
    layers, commit = Goblin(fixture("stack.goblin")).layers, Autumn(fixture("stack.autumn")).commits[-1]
    assert [layer.name for layer in layers] == [layer.name for layer in commit.layers] and len(layers) > 1
    for one, other in zip(layers, commit.layers):
        assert one.form.depth == other.form.depth and one.root_state == INNER
        for level in range(one.form.depth + 1):
            (values, states), (others, of_others) = one.window(level), other.window(level)
            assert values.dtype == others.dtype and (raw_bits(values) == raw_bits(others)).all() and (states == of_others).all()


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
