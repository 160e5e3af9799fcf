"""Options of functions that do several things."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any


def refuse(what: str, options: Mapping[str, Any]) -> None:
    """Fails if options were given that are for something else."""
    for name, value in options.items():
        if value is not None:
            raise TypeError(f"{name}: is for {what}")


def names_of(names: str | Iterable[Any]) -> list[str]:
    """Names as a list: a string is one of them."""
    return [names] if isinstance(names, str) else [str(name) for name in names]


def time_of(time: int | None) -> int | None:
    """The time of a commit, in seconds since the beginning of 1970: the one that is given, or that of the environment
    (SOURCE_DATE_EPOCH), as the program has it."""
    if time is not None:
        return time
    text = os.environ.get("SOURCE_DATE_EPOCH")
    try:
        return None if text is None else int(text)
    except ValueError:
        raise ValueError(f"SOURCE_DATE_EPOCH: {text!r}, expected a whole number of seconds") from None


def packing_of(codec: str, max_error: float | None) -> tuple[str, float | None]:
    """How few bytes a tree is to take, and what it may lose for that."""
    if codec not in ("plain", "packed"):
        raise ValueError(f"codec: {codec!r}, expected plain or packed")
    return codec, max_error
