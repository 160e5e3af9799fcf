"""Terms of long work: who is told about its progress, and what it may use."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from numbers import Integral
from typing import Any

from ._types import Progress

Terms = tuple[Callable[[int, int], object] | None, int | None, int | None]
"""A function that is called with what is done and the total, threads to work with, and bytes that the output may have."""

ALONE: Terms = (None, None, None)
"""Terms of work of which nobody is told."""


@contextmanager
def working(progress: Progress, threads: int | None = None, max_bytes: int | str | None = None) -> Iterator[Terms]:
    """The terms of work with such arguments."""
    limit = None if max_bytes is None else bytes_of(max_bytes, "max_bytes")
    if threads is not None and (isinstance(threads, bool) or not isinstance(threads, Integral) or threads < 1):
        raise ValueError(f"threads: {threads!r}, expected a whole number, 1 or more")
    with telling(progress) as tell:
        yield tell, None if threads is None else int(threads), limit


@contextmanager
def telling(progress: Progress) -> Iterator[Callable[[int, int], object] | None]:
    """A function to be called with what is done and the total: that of a bar of tqdm, if `progress` is one or `True`."""
    if progress is None or progress is False:
        yield None
    elif progress is True or hasattr(progress, "update"):
        from tqdm.auto import tqdm  # type: ignore[import-untyped,unused-ignore]

        bar: Any
        with tqdm(unit="cells", unit_scale=True) if progress is True else nullcontext(progress) as bar:

            def show(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            yield show
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress: expected a function of two numbers, True or None, got {progress!r}")


def memory_of(memory: int | str) -> int:
    """A number of bytes: 268435456 or "256M"."""
    return bytes_of(memory, "memory")


def bytes_of(given: int | str, name: str) -> int:
    """A number of bytes, that of an argument."""
    if isinstance(given, int):
        size = given
    else:
        units = {"": 0, "b": 0, "k": 1, "m": 2, "g": 3, "t": 4}
        text = given.strip().lower().removesuffix("ib").removesuffix("b")
        unit = text[-1:] if text[-1:].isalpha() else ""
        try:
            size = int(float(text[: len(text) - len(unit)]) * 1024 ** units[unit])
        except (ValueError, KeyError, OverflowError):
            raise ValueError(f"{name}: {given!r}, expected a number of bytes, such as 256M or 2G") from None
    if not 0 < size < 1 << 62:
        raise ValueError(f"{name}: {given!r} is out of range")
    return size
