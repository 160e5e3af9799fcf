"""Progress: with tqdm, without it, in a terminal or not, and by a function."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

import pytest

import spinney
from spinney import _progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def no_tqdm(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulates that tqdm is not installed."""
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)


def test_a_bar_of_tqdm(relief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tqdm")
    spinney.convert(relief, tmp_path / "relief.autumn", progress=True)
    assert "100%" in capsys.readouterr().err


@pytest.mark.usefixtures("no_tqdm")
def test_a_line_in_a_terminal(relief: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    spinney.convert(relief, tmp_path / "relief.autumn", progress=True)
    lines = terminal.getvalue()
    assert lines.startswith("\r") and lines.endswith("(100%)\n")


@pytest.mark.usefixtures("no_tqdm")
@pytest.mark.parametrize("stream", [io.StringIO(), None])
def test_nothing_where_there_is_no_terminal(relief: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stream: Any) -> None:
    monkeypatch.setattr(sys, "stderr", stream)
    spinney.convert(relief, tmp_path / "relief.autumn", progress=True)
    assert stream is None or stream.getvalue() == ""


def test_a_shorter_line_covers_a_longer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with _progress._line() as show:
        assert show is not None
        show(900, 1000)
        show(5, 5)
        show(7, 0)
    assert terminal.getvalue() == "\r900 of 1,000 (90%)\r5 of 5 (100%)     \r7            \n"


def test_every_kind_of_work_counts(island: str, relief: str, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []

    def count(done: int, total: int) -> None:
        calls.append((done, total))

    with spinney.open(relief) as heights:
        heights.export(tmp_path / "relief.pmtiles", progress=count)
        heights.contours(tmp_path / "contours.gpkg", every=100, progress=count)
    spinney.transform(island, "rotate=20", tmp_path / "turned.goblin", progress=count)
    spinney.verify(island, progress=count)
    assert len(calls) >= 4 and all(0 <= done <= total for done, total in calls)
    with pytest.raises(TypeError, match="progress"):
        spinney.verify(island, progress="much")


def test_an_exception_ends_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with pytest.raises(RuntimeError), _progress._line() as show:
        assert show is not None
        show(1, 2)
        raise RuntimeError
    assert terminal.getvalue() == "\r1 of 2 (50%)\n"
