"""Files on web servers, in buckets, and in the file systems of fsspec."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

# Options of the store; then the length of a file that Python reads, what reads it, and what it was given as.
RemoteAccess = tuple[list[tuple[str, str]], tuple[int, Callable[[list[int], list[int]], list[bytes]], Any] | None]


def remote_access_of(path: Any, storage_options: Mapping[str, Any] | None) -> tuple[str, RemoteAccess]:
    """The name of a file, and how it is read if it is not on this machine."""
    storage = [(str(key), _text(value)) for key, value in (storage_options or {}).items()]
    system, name = getattr(path, "fs", None), getattr(path, "path", None)
    if system is None or name is None or not hasattr(system, "cat_ranges"):
        return os.fsdecode(path), (storage, None)
    if storage:
        raise ValueError("storage_options: the file has a file system already, which has its own")

    def fetch(starts: list[int], ends: list[int]) -> list[bytes]:
        parts = system.cat_ranges([name] * len(starts), starts, ends, on_error="raise")
        return [bytes(part) for part in parts]

    return f"{_protocol(system)}::{name}", (storage, (int(system.size(name)), fetch, path))


def kept_name(path: Any, file: Any) -> str:
    """The name by which a file is opened again, wherever that is."""
    name = str(os.fspath(path))
    return name if file is not None or "://" in name else os.path.abspath(name)


def _protocol(system: Any) -> str:
    protocol = system.protocol
    return str(protocol if isinstance(protocol, str) else protocol[0])


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
