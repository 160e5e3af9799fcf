"""Common base of open point trees and line trees."""

from __future__ import annotations

import os
from typing import Any, Self

from ._remote import access_again, kept_name, token_of


def _reopen(
    kind: type,
    path: str,
    positioned: bool,
    storage: list[tuple[str, str]] | None = None,
    file: Any = None,
    refused: tuple[bool, bool] = (False, False),
) -> Any:
    return kind(path, positioned, access_again(file, storage, refused))


class BlockTree:
    """An open file of blocks: a context manager that is pickled by its path. Subclasses also
    inherit from a native class, which has `path`, `_facts` and the rest.
    """

    def __fspath__(self: Any) -> str:
        path: str = os.fspath(self.path)
        return path

    def __enter__(self) -> Self:
        return self

    def __exit__(self: Any, *_: object) -> None:
        self.close()

    def __reduce__(self: Any) -> tuple[Any, ...]:
        storage, file, refused = self._remote
        return _reopen, (type(self), kept_name(self.path, file), self.positioned, storage, file and file[2], refused)

    def __dask_tokenize__(self) -> Any:
        return type(self).__name__, token_of(self)

    def __bool__(self) -> bool:
        return True

    @property
    def crs(self: Any) -> str | None:
        """The coordinate system, if known."""
        crs: str | None = self._facts()["crs"]
        return crs

    @property
    def tags(self: Any) -> dict[str, str]:
        """Further metadata of the file, by name."""
        return dict(self._facts()["tags"])
