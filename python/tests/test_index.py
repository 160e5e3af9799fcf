"""Indexes of GeoTIFF files, whose cells stay in these."""

from __future__ import annotations

import json
import os
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
import spinney
from spinney import shards

FIXTURES = Path(__file__).parents[2] / "fixtures"


@pytest.fixture
def source(tmp_path: Path) -> Path:
    return Path(shutil.copy(FIXTURES / "island_classes.tif", tmp_path / "classes.tif"))


def test_an_index_equals_a_tree(source: Path, tmp_path: Path) -> None:
    spinney.index(source, tmp_path / "index.goblin")
    spinney.build(source, tmp_path / "tree.goblin")
    with spinney.open(tmp_path / "index.goblin") as index, spinney.open(tmp_path / "tree.goblin") as tree:
        assert index.shape == tree.shape
        for level in range(tree.depth + 1):
            np.testing.assert_array_equal(index.read(level=level), tree.read(level=level))
        assert index.stats() == tree.stats()
    assert spinney.verify(tmp_path / "index.goblin") == []


def test_files_are_found_by_patterns_and_from_levels_on(source: Path, tmp_path: Path) -> None:
    sizes = []
    for levels in (1, 2, 4):
        spinney.index(str(tmp_path / "*.tif"), tmp_path / "index.goblin", stored_level=levels)
        sizes.append(os.path.getsize(tmp_path / "index.goblin"))
    # (The only block has no coarser segment.)
    assert min(sizes) > 0
    with pytest.raises(ValueError, match="stored_level"):
        spinney.index(source, tmp_path / "index.goblin", stored_level=3)  # type: ignore[arg-type]


def test_updates_read_what_was_changed(source: Path, tmp_path: Path) -> None:
    index = tmp_path / "index.goblin"
    spinney.index(source, index)
    assert spinney.update_index(index) == spinney.IndexUpdate(1, 0, 0, 0)
    os.utime(source, (1, 1))
    assert spinney.update_index(index).changed == 1
    moved = tmp_path / "moved"
    moved.mkdir()
    source.rename(moved / source.name)
    with pytest.raises(OSError, match="classes.tif"):
        spinney.update_index(index)
    report = spinney.update_index(index, out=tmp_path / "new.goblin", source_prefix={"classes": "moved/classes"})
    assert report.unchanged == 1
    assert spinney.verify(tmp_path / "new.goblin") == []


def test_stac_items_name_sources_and_times(source: Path, tmp_path: Path) -> None:
    asset = {"href": source.name, "type": "image/tiff; application=geotiff", "roles": ["data"]}
    item = {"type": "Feature", "stac_version": "1.0.0", "id": "a", "assets": {"cover": asset}, "links": []}
    items = tmp_path / "items.json"
    items.write_text(json.dumps(item | {"properties": {"datetime": "2024-05-31T10:30:00Z"}}))
    spinney.index(items, tmp_path / "index.goblin", asset="cover", stack=True)
    with spinney.open(tmp_path / "index.goblin") as index:
        assert index.time == "2024-05-31T10:30:00Z"
    with pytest.raises(ValueError, match="asset"):
        spinney.index(source, tmp_path / "index.goblin", asset="cover")
    with pytest.raises(ValueError, match="sources"):
        spinney.update_index(tmp_path / "index.goblin", [])


def test_a_changed_source_is_a_warning(source: Path, tmp_path: Path) -> None:
    spinney.index(source, tmp_path / "index.goblin")
    os.utime(source, (1, 1))
    with spinney.open(tmp_path / "index.goblin") as index:
        with pytest.warns(UserWarning, match="classes.tif: has another length or modification time"):
            cells = index.read()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            np.testing.assert_array_equal(index.read(), cells)


def test_sources_are_not_overwritten(source: Path, tmp_path: Path) -> None:
    spinney.index(source, tmp_path / "index.goblin")
    before = source.read_bytes()
    with spinney.open(tmp_path / "index.goblin") as index:
        for write in (index.export, index.save):
            with pytest.raises(ValueError, match="has cells of"):
                write(source)
    with pytest.raises(ValueError, match="has cells of"):
        spinney.update_index(tmp_path / "index.goblin", out=source)
    assert source.read_bytes() == before


def test_shards_make_the_same_index(source: Path, tmp_path: Path) -> None:
    spinney.index(source, tmp_path / "index.goblin")
    job = shards.plan(source, tmp_path / "job", shards=2, index=True)
    for number in range(job.shards):
        job.build(number)
    job.merge(tmp_path / "merged.goblin")
    assert (tmp_path / "merged.goblin").read_bytes() == (tmp_path / "index.goblin").read_bytes()
    with pytest.raises(ValueError, match="stored_level"):
        shards.plan(source, tmp_path / "other", stored_level=2)
