"""Manifests of frozen files, and of files that the program makes, read as section 47 of formats.md
specifies.

    pytest tests/foreign/test_manifest.py
    SPINNEY_PROGRAM=target/debug/spinney python tests/foreign/test_manifest.py

Tests that need the program are skipped if SPINNEY_PROGRAM does not name one.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from basics import Code, CorruptFile, Unknown
from manifest import Manifest, intersection, is_manifest, resolve, tag, volume, without
from reader import Goblin
from trees import VOID, Values

ROOT = Path(__file__).parents[2]
FIXTURES = ROOT / "fixtures" / "v1"
PAGE = (ROOT / "docs" / "format" / "manifest.md").read_text()
EXAMPLE = PAGE.partition("```json\n")[2].partition("```")[0]


@pytest.fixture
def program() -> str:
    path = os.environ.get("SPINNEY_PROGRAM", "")
    if not path:
        pytest.skip("SPINNEY_PROGRAM is not set")
    return str(Path(path).resolve())


def run(program: str, directory: Path, command: str) -> None:
    """Runs a command of the program in a directory."""
    done = subprocess.run([program, "-q", *command.split()], cwd=directory, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


def write(directory: Path, text: str) -> str:
    path = directory / "test.manifest.json"
    path.write_text(text)
    return str(path)


@pytest.fixture
def frozen(tmp_path: Path) -> dict[str, Any]:
    """A manifest of two frozen files that cover the same cells, and of one of them again, moved by
    some cells. The moved file is the lowest."""
    for name in ("classes", "stack"):
        shutil.copy(FIXTURES / f"{name}.goblin", tmp_path / "copies.goblin" if name == "stack" else tmp_path)
    document: dict[str, Any] = json.loads(EXAMPLE)
    document |= {"depth": 9, "extent": [290, 213, 1], "rule": "majority"}
    classes = {"path": "classes.goblin", "size": [256, 200, 1], "depth": 8, "bytes": 25962, "tag": "f9cc6455"}
    cover = {"path": "copies.goblin", "layer": "cover", "size": [256, 200, 1], "depth": 8, "bytes": 171212, "tag": "98919872"}
    label = dict(classes, path=str(FIXTURES / "classes.goblin"))
    document["files"] = [{**label, "at": [34, 13, 0]}, {**classes, "at": [0, 0, 0]}, {**cover, "at": [0, 0, 0]}]
    return document


def test_tags_on_the_page() -> None:
    stack = (FIXTURES / "stack.goblin").read_bytes()
    assert f"{len(stack):,} bytes, is\n  `{tag(stack):08x}`" in PAGE
    classic = json.loads(EXAMPLE)["files"][0]
    data = (FIXTURES / "classic.goblin").read_bytes()
    assert (classic["bytes"], classic["tag"]) == (len(data), f"{tag(data):08x}")
    # The bytes before the tag's do not matter.
    assert tag(stack) == tag(stack[-4112:]) != tag(stack[-4111:])


def test_paths() -> None:
    for path, manifest, expected in [
        ("a.goblin", "m.json", "a.goblin"),
        ("../b/a.goblin", "/maps/m.json", "/maps/../b/a.goblin"),
        ("/b/a.goblin", "/maps/m.json", "/b/a.goblin"),
        ("S3://b/a.goblin", "/maps/m.json", "S3://b/a.goblin"),
        ("a.goblin", "https://example.com/maps/m.json?key=a/b#c", "https://example.com/maps/a.goblin?key=a/b#c"),
        ("sub/a.goblin", "s3://maps/m.json", "s3://maps/sub/a.goblin"),
        ("gs://b/a.goblin", "s3://maps/m.json", "gs://b/a.goblin"),
    ]:
        assert resolve(path, manifest) == expected
    for path in ("/etc/a.goblin", "file:///a.goblin"):
        with pytest.raises(CorruptFile):
            resolve(path, "https://example.com/m.json")


def test_boxes() -> None:
    rng = random.Random(1)
    for _ in range(300):
        low, high = zip(*[sorted(rng.sample(range(9), 2)) for _ in range(3)])
        start, end = zip(*[sorted(rng.sample(range(9), 2)) for _ in range(3)])
        hole = intersection((low, high), (start, end))
        if hole:
            parts = list(without((low, high), hole))
            assert volume(hole) + sum(map(volume, parts)) == volume((low, high)) and len(parts) <= 6
            assert not any(intersection(a, b) for a in [hole, *parts] for b in parts if a is not b)


def test_later_files_cover_earlier_ones(tmp_path: Path, frozen: dict[str, Any]) -> None:
    manifest = Manifest(write(tmp_path, json.dumps(frozen)))
    trees = [Goblin(data).layers[0] for data in ((FIXTURES / f"{name}.goblin").read_bytes() for name in ("classes", "stack"))]
    assert trees[1].name == "cover" and manifest.document["files"][2]["layer"] == "cover"
    expected, states = np.zeros((512, 512), np.uint8), np.zeros((512, 512), np.uint8)
    for tree, x, y in [(trees[0], 34, 13), (trees[0], 0, 0), (trees[1], 0, 0)]:
        values, own = (a.reshape(256, 256)[:200] for a in tree.window(8))
        there = own != VOID
        expected[y : y + 200, x : x + 256][there] = values[there]
        states[y : y + 200, x : x + 256][there] = own[there]
    found, there = manifest.cells((0, 0), (512, 512))
    assert (found[..., 0] == expected).all() and (there == states).all()
    # A pixel that only the lowest file has, and one of the topmost.
    assert manifest.value(Code(9, (289, 150))) is None or states[150, 289]
    rng = random.Random(2)
    for _ in range(200):
        x, y = rng.randrange(290), rng.randrange(213)
        value = manifest.value(Code(9, (x, y)))
        assert value == expected[y, x] if value is not None else not states[y, x]


def test_levels_of_a_single_file_are_its_own(tmp_path: Path, frozen: dict[str, Any]) -> None:
    frozen["files"] = frozen["files"][1:2]
    manifest, tree = Manifest(write(tmp_path, json.dumps(frozen))), Goblin((FIXTURES / "classes.goblin").read_bytes()).layers[0]
    rng = random.Random(3)
    for level in range(9):
        for _ in range(20):
            at = tuple(rng.randrange(1 << level) for _ in range(2))
            value, own = manifest.value(Code(level + 1, at)), tree.value(Code(level, at))
            assert (value is None) == (own is None) and (value is None or value.tobytes() == own)
    # The root has the same cells as its only child that is not VOID.
    assert manifest.value(Code(0, (0, 0))) == np.frombuffer(tree.root_value, np.uint8)[0]


@pytest.mark.parametrize("layout", [dict(indent=1), dict(separators=(",", ":"))])
def test_layout_does_not_matter(tmp_path: Path, frozen: dict[str, Any], layout: dict[str, Any]) -> None:
    rest = {key: frozen[key] for key in reversed(frozen) if key != "spinney_manifest"}
    text = json.dumps({"spinney_manifest": 1, **rest, "nodata": None, "tags": {"a": "b"}}, **layout)
    assert Manifest(write(tmp_path, f"\n\t {text}\r\n")).value(Code(9, (128, 100))) is not None
    assert not is_manifest(b'{"axes": 2, "spinney_manifest": 1}') and not is_manifest(b" " * 512 + text.encode())


def changed(document: dict[str, Any], path: list[Any], value: Any) -> str:
    """Returns a document with another value at a path; without the key, if the value is `...`."""
    document = json.loads(json.dumps(document))
    parent = document
    for key in path[:-1]:
        parent = parent[key]
    if value is ...:
        del parent[path[-1]]
    else:
        parent[path[-1]] = value
    return json.dumps(document)


INVALID: list[tuple[list[Any], Any]] = [
    *((["files", 0, key], ...) for key in ("path", "at", "size", "depth", "bytes", "tag")),
    *(([key], ...) for key in ("axes", "values", "kind", "rule", "depth", "extent", "frame", "files")),
    (["odd"], 1),
    (["files", 0, "odd"], 1),
    (["values", "mask"], ...),
    (["values", "mask"], "Alpha"),
    (["values", "mask"], {"Missing": [0] * 7}),
    (["values", "sample"], "u8"),
    (["values", "channels"], 5),
    (["kind"], "Categorical"),
    (["rule"], "average"),
    (["axes"], 4),
    (["axes"], 2.0),
    (["depth"], 8),
    (["depth"], 30),
    (["extent"], [290, 213, 2]),
    (["extent"], [289, 213, 1]),
    (["nodata"], 0),
    (["nodata"], "none"),
    (["class_names"], {"sea": "0"}),
    (["frame", "pixel_is_point"], ...),
    (["frame", "matrix", 1], [0, 1, 0]),
    (["frame", "crs"], "EPSG:4326"),
    (["palette"], {"colours": [[0, 0, 0, 256]]}),
    (["files"], []),
    (["files", 0, "at"], [35, 13, 0]),
    (["files", 0, "at"], [34, 13, 1]),
    (["files", 0, "at"], [-1, 13, 0]),
    (["files", 0, "size"], [0, 200, 1]),
    (["files", 0, "size"], [1 << 64, 200, 1]),
    (["files", 0, "depth"], 7),
    (["files", 0, "tag"], "f9cc645"),
    (["files", 0, "path"], ""),
    (["files", 0, "path"], "classes.goblin"),
]


@pytest.mark.parametrize(("path", "value"), INVALID)
def test_invalid_documents_are_refused(tmp_path: Path, frozen: dict[str, Any], path: list[Any], value: Any) -> None:
    with pytest.raises(CorruptFile):
        Manifest(write(tmp_path, changed(frozen, path, value)))


def test_other_versions_and_other_text_are_refused(tmp_path: Path, frozen: dict[str, Any]) -> None:
    # The version counts, whatever other keys there are.
    with pytest.raises(Unknown):
        Manifest(write(tmp_path, '{"spinney_manifest": 2, "new": 0}'))
    text = json.dumps(frozen)
    for wrong in (text[:-1], text + "x", "\ufeff" + text, text.replace('"axes"', '"axes": 2, "axes"'), text.replace("200", "NaN")):
        with pytest.raises(CorruptFile):
            Manifest(write(tmp_path, wrong))


@pytest.mark.parametrize(
    ("key", "value"), [("tag", "f9cc6456"), ("bytes", 25963), ("depth", 9), ("size", [255, 200, 1]), ("path", "copies.goblin"), ("layer", "height")]
)
def test_files_that_differ_are_refused(tmp_path: Path, frozen: dict[str, Any], key: str, value: Any) -> None:
    manifest = Manifest(write(tmp_path, changed(frozen, ["files", 1, key], value)))
    with pytest.raises(CorruptFile):
        manifest.layer(manifest.files[1])
    # The other files can be read.
    assert manifest.layer(manifest.files[0]).form.depth == 8


def test_the_example_of_the_page(program: str, tmp_path: Path) -> None:
    shutil.copy(FIXTURES / "classic.goblin", tmp_path)
    for command in re.findall("^spinney (.*)$", PAGE.partition("## 50.")[2], re.M):
        run(program, tmp_path, command)
    written = tmp_path / "classic.manifest.json"
    assert written.read_text() == EXAMPLE
    manifest, after = Manifest(str(written)), PAGE.partition("of height 1:")[2]
    rows = [[int(v) for v in row.split()] for row in after.partition("```text\n")[2].partition("\n```")[0].split("\n")]
    assert [row[:8] for row in rows] == level_of(manifest, 3)[..., 0].tolist()
    assert [row[8:] for row in rows[:4]] == level_of(manifest, 2)[..., 0].tolist()
    corner = manifest.layer(manifest.files[1])
    assert corner.value(Code(2, (0, 0))) == b"\1" and manifest.value(Code(3, (3, 2))) == 1


def level_of(manifest: Manifest, level: int, void: int = 0) -> Values:
    """Returns the values of the nodes of a level within the extent, by z, y, x."""
    f = manifest.form
    size = [-(-cells >> f.depth - level) for cells in f.extent[: f.axes]][::-1]
    found = np.full((*size, f.channels), void, f.type)
    for at in np.ndindex(*size):
        value = manifest.value(Code(level, at[::-1]))
        found[at] = void if value is None else value
    return found


def array(program: str, directory: Path, level: int, void: int) -> Values:
    """Returns the nodes of a level of a manifest, as the program writes them."""
    run(program, directory, f"get all.manifest.json level.npy --level {level} --nodata {void}")
    return np.load(directory / "level.npy")


# Windows of a tree that make a manifest, from bottom to top.
ALIGNED = ["0,0,64,128", "64,0,64,128", "0,128,128,72", "128,64,64,64"]
SHIFTED = ["3,5,100,90", "103,2,50,90", "10,95,97,101"]
OVERLAPPING = ["0,0,150,200", "100,40,156,100", "130,17,90,160"]


@pytest.mark.parametrize("windows", [ALIGNED, SHIFTED, OVERLAPPING])
@pytest.mark.parametrize("rule", ["majority", "mean", "min", "max", "dominant", "nearest", "occupancy"])
def test_levels_are_those_of_the_program(program: str, tmp_path: Path, windows: list[str], rule: str) -> None:
    kind = "categorical" if rule in ("majority", "dominant") else "continuous"
    run(program, tmp_path, f"build {FIXTURES / 'classes.goblin'} -o whole.goblin --rule {rule} --kind {kind}")
    names = [f"part{number}.goblin" for number in range(len(windows))]
    for name, window in zip(names, windows):
        run(program, tmp_path, f"transform whole.goblin window={window} -o {name}")
    run(program, tmp_path, f"manifest {' '.join(names)} -o all.manifest.json")
    manifest = Manifest(str(tmp_path / "all.manifest.json"))
    for level in [0, 1, 2, 3, 4, 5, manifest.form.depth]:
        expected = array(program, tmp_path, level, 99)
        if level < manifest.form.depth:
            assert (level_of(manifest, level, 99)[..., 0] == expected).all(), level
        else:
            values, states = manifest.cells((0, 0), manifest.form.extent[:2])
            assert (np.where(states != VOID, values[..., 0], 99) == expected).all()


def test_large_nodes_of_overlapping_files(program: str, tmp_path: Path) -> None:
    """Nodes of more than 65,536 cells, in which hidden cells may count."""
    run(program, tmp_path, f"build {FIXTURES / 'classes.goblin'} -o small.goblin --rule mean --kind continuous")
    run(program, tmp_path, "transform small.goblin scale=5 -o whole.goblin")
    names = []
    for number, window in enumerate(["0,0,1000,1000", "500,100,300,800", "520,90,31,33", "300,400,700,600", "511,511,1,1"]):
        names.append(f"part{number}.goblin")
        run(program, tmp_path, f"transform whole.goblin window={window} -o {names[-1]}")
    run(program, tmp_path, f"manifest {' '.join(names)} -o all.manifest.json")
    manifest = Manifest(str(tmp_path / "all.manifest.json"))
    root = Code(0, (0, 0))
    cells, (_, states) = manifest.statistics(root), manifest.cells((0, 0), manifest.form.extent[:2])
    assert len(cells) > (states != VOID).sum()
    for level in range(4):
        assert (level_of(manifest, level, 200)[..., 0] == array(program, tmp_path, level, 200)).all(), level


def test_volumes(program: str, tmp_path: Path) -> None:
    shutil.copy(FIXTURES / "ball.goblin", tmp_path)
    for number, window in enumerate(["0,0,0,16,32,32", "16,0,0,16,32,32", "9,9,9,11,7,5"]):
        run(program, tmp_path, f"transform ball.goblin window={window} -o part{number}.goblin")
    run(program, tmp_path, "manifest part0.goblin part1.goblin part2.goblin -o all.manifest.json")
    manifest = Manifest(str(tmp_path / "all.manifest.json"))
    assert manifest.form.axes == 3 and manifest.files[2].at[0] == 9
    for level in range(5):
        assert (level_of(manifest, level, 7)[..., 0] == array(program, tmp_path, level, 7)).all(), level


def test_layers_and_colours(program: str, tmp_path: Path) -> None:
    shutil.copy(FIXTURES / "stack.goblin", tmp_path)
    run(program, tmp_path, f"transform {FIXTURES / 'rgb.goblin'} window=10,20,30,30 -o part.goblin")
    run(program, tmp_path, "manifest stack.goblin:colour part.goblin -o all.manifest.json")
    manifest = Manifest(str(tmp_path / "all.manifest.json"))
    assert [file.layer for file in manifest.files] == ["colour", None] and manifest.form.channels == 3
    for level in range(6):
        assert (level_of(manifest, level) == array(program, tmp_path, level, 0)).all(), level


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
