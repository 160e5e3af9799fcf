"""Options of functions with several modes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any


def refuse(what: str, options: Mapping[str, Any]) -> None:
    """Fails if options were given that this mode does not have."""
    for name, value in options.items():
        if value is not None:
            raise TypeError(f"{name}: is for {what}")


def names_of(names: str | Iterable[Any]) -> list[str]:
    """Returns names as a list: a string is one name."""
    return [names] if isinstance(names, str) else [str(name) for name in names]


def time_of(time: int | None) -> int | None:
    """Returns the time of a commit, in seconds since 1970: the given one, or the environment's
    SOURCE_DATE_EPOCH, as in the program.
    """
    if time is not None:
        return time
    text = os.environ.get("SOURCE_DATE_EPOCH")
    try:
        return None if text is None else int(text)
    except ValueError:
        raise ValueError(f"SOURCE_DATE_EPOCH: got {text!r}, expected an integer number of seconds") from None


def packing_of(codec: str, max_error: float | None) -> tuple[str, float | None]:
    """Returns the packing: the checked codec, and the maximum error."""
    if codec not in ("plain", "packed"):
        raise ValueError(f"codec: got {codec!r}, expected plain or packed")
    return codec, max_error
