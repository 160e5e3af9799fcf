"""Terms of long jobs: progress callback and limits."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from numbers import Integral
from typing import Any

from ._types import Progress

Terms = tuple[Callable[[int, int], object] | None, int | None, int | None]
"""Progress callback (completed and total work), number of threads, and maximum size of the output
in bytes.
"""

ALONE: Terms = (None, None, None)
"""Default terms, without progress callback."""


@contextmanager
def working(progress: Progress, threads: int | None = None, max_bytes: int | str | None = None) -> Iterator[Terms]:
    """Yields the terms of a job from the arguments of a public function."""
    limit = None if max_bytes is None else bytes_of(max_bytes, "max_bytes")
    if threads is not None and (isinstance(threads, bool) or not isinstance(threads, Integral) or threads < 1):
        raise ValueError(f"threads: got {threads!r}, expected an integer, 1 or more")
    with progress_callback(progress) as callback:
        yield callback, None if threads is None else int(threads), limit


@contextmanager
def progress_callback(progress: Progress) -> Iterator[Callable[[int, int], object] | None]:
    """Yields a progress callback: that of a new bar if `progress` is `True`, or of a tqdm bar."""
    if progress is None or progress is False:
        yield None
    elif progress is True:
        try:
            from tqdm.auto import tqdm  # type: ignore[import-untyped,unused-ignore]
        except ImportError:
            with _line() as callback:
                yield callback
        else:
            with tqdm(unit="cells", unit_scale=True) as bar:
                yield _updates_of(bar)
    elif hasattr(progress, "update"):
        yield _updates_of(progress)
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress: expected a function of two numbers, True or None, got {progress!r}")


def _updates_of(bar: Any) -> Callable[[int, int], object]:
    """Returns a callback that updates a tqdm bar."""

    def show(done: int, total: int) -> None:
        bar.total = total
        bar.update(done - bar.n)

    return show


@contextmanager
def _line() -> Iterator[Callable[[int, int], object] | None]:
    """Progress without tqdm: one line on standard error if that is a terminal, else nothing."""
    stream, shown = sys.stderr, ""
    if stream is None or not stream.isatty():
        yield None
        return

    def show(done: int, total: int) -> None:
        nonlocal shown
        line = f"{done:,} of {total:,} ({done / total:.0%})" if total else f"{done:,}"
        stream.write("\r" + line.ljust(len(shown)))
        stream.flush()
        shown = line

    try:
        yield show
    finally:
        if shown:
            stream.write("\n")


def memory_of(memory: int | str) -> int:
    """Returns a number of bytes: 268435456 or "256M"."""
    return bytes_of(memory, "memory")


def bytes_of(given: int | str, name: str) -> int:
    """Returns the number of bytes in an argument."""
    if isinstance(given, int):
        size = given
    else:
        units = {"": 0, "b": 0, "k": 1, "m": 2, "g": 3, "t": 4}
        text = given.strip().lower().removesuffix("ib").removesuffix("b")
        unit = text[-1:] if text[-1:].isalpha() else ""
        try:
            size = int(float(text[: len(text) - len(unit)]) * 1024 ** units[unit])
        except (ValueError, KeyError, OverflowError):
            raise ValueError(f"{name}: got {given!r}, expected a number of bytes, such as 256M or 2G") from None
    if not 0 < size < 1 << 62:
        raise ValueError(f"{name}: got {given!r}, which is out of range")
    return size
