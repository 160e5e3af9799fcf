"""The code blocks of docs/python.md and README.md run in their order, and the examples run."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import pytest
from conftest import FIXTURES, ROOT


@pytest.mark.parametrize(("page", "least"), [("docs/python.md", 10), ("python/README.md", 1)])
def test_docs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, page: str, least: int) -> None:
    pytest.importorskip("xarray")
    (tmp_path / "fixtures").symlink_to(FIXTURES)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```$", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)
    assert len(blocks) >= least
    names: dict[str, object] = {}
    for number, block in enumerate(blocks, 1):
        exec(compile(block, f"{page}, block {number}", "exec"), names)


def test_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example = runpy.run_path(str(ROOT / "python" / "examples" / "typed.py"))
    monkeypatch.chdir(tmp_path)
    share = example["tour"](str(FIXTURES / "island_elevation.tif"))
    assert 0 < share < 1


def test_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xarray")
    (tmp_path / "fixtures").symlink_to(FIXTURES)
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((ROOT / "python" / "examples" / "tour.ipynb").read_text())
    names: dict[str, object] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
