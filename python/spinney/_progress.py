"""Progress of long work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from ._types import Progress


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
    if isinstance(memory, int):
        size = memory
    else:
        units = {"": 0, "b": 0, "k": 1, "m": 2, "g": 3, "t": 4}
        text = memory.strip().lower().removesuffix("ib").removesuffix("b")
        unit = text[-1:] if text[-1:].isalpha() else ""
        try:
            size = int(float(text[: len(text) - len(unit)]) * 1024 ** units[unit])
        except (ValueError, KeyError, OverflowError):
            raise ValueError(f"memory: {memory!r}, expected a number of bytes, such as 256M or 2G") from None
    if not 0 < size < 1 << 62:
        raise ValueError(f"memory: {memory!r} is out of range")
    return size
