"""Options of functions that do several things."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def refuse(what: str, options: Mapping[str, Any]) -> None:
    """Fails if options were given that are for something else."""
    for name, value in options.items():
        if value is not None:
            raise TypeError(f"{name}: is for {what}")
