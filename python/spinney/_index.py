"""Indexes: trees whose cells stay in GeoTIFF files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

from . import _native
from ._files import MEMORY
from ._metadata import crs_text
from ._options import names_of, packing_of
from ._progress import memory_of, working
from ._remote import path_of
from ._times import text_of_time
from ._types import Path, Progress
from .shards import _OTHERS, _files_of


class IndexUpdate(NamedTuple):
    """Numbers of files by what `update_index` did with them."""

    unchanged: int
    changed: int
    added: int
    removed: int


def index(
    sources: Path | Sequence[Path],
    out: Path,
    *,
    stored_level: Literal[1, 2, 4] = 2,
    kind: Literal["categorical", "continuous"] | None = None,
    rule: str | None = None,
    bands: Sequence[int | str] | None = None,
    nodata: float | None = None,
    crs: Any = None,
    pages: int | Literal["layers"] | None = None,
    stack: bool = False,
    names: Sequence[str] | None = None,
    times: Sequence[Any] | None = None,
    asset: str | None = None,
    memory: int | str = MEMORY,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> None:
    """Makes an index of GeoTIFF files or virtual rasters: a tree whose cells stay in these.

    The index has the coarser levels and exact statistics of all nodes. It is opened as any tree;
    cells are read from the files' own tiles where a result needs them. Sources are paths or URLs,
    patterns such as "tiles/*.tif" or "s3://maps/*.tif", or documents of STAC items with an `asset`;
    the last is on top. Layers of a stack of items have the items' times.

    The index stores levels from `stored_level` above the cells upward. Smaller numbers make larger
    indexes and faster views.
    """
    paths, found = _native.expand_sources(_files_of(sources), asset)
    seen = None if times is None else [text_of_time(time) for time in times]
    if stack and seen is None and all(time is not None for time in found):
        seen = [time for time in found if time is not None]
    options: dict[str, Any] = dict.fromkeys(_OTHERS) | {
        "kind": kind,
        "rule": rule,
        "bands": None if bands is None else list(bands),
        "nodata": nodata,
        "transform": None,
        "crs": crs_text(crs),
        "depth": None,
        "layer": None,
        "pages": pages,
        "stack": stack,
        "names": None if names is None else names_of(names),
        "times": seen,
        "keep_transparent": False,
        "packing": packing_of("plain", None),
        "memory": memory_of(memory),
        "share": False,
        "time": None,
        "shell": False,
        "fractions": False,
        "allow_ballpark": False,
        "referenced": stored_level,
    }
    with working(progress, threads, max_bytes) as terms:
        _native.build_index(paths, path_of(out), options, terms)


def update_index(
    index: Path,
    sources: Path | Sequence[Path] | None = None,
    out: Path | None = None,
    *,
    source_prefix: Mapping[str, str] | None = None,
    memory: int | str = MEMORY,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> IndexUpdate:
    """Updates an index: only files that were changed, added or removed are read.

    `sources` are all files that the index has afterwards, by default those that it has. The index
    is replaced, unless `out` names another file. `source_prefix` replaces the beginnings of the
    files' names in the index, after they have moved.
    """
    prefixes = list((source_prefix or {}).items())
    paths = None if sources is None else _native.expand_sources(_files_of(sources), None)[0]
    target = path_of(index if out is None else out)
    with working(progress, threads, max_bytes) as terms:
        numbers = _native.update_index(path_of(index), paths, target, prefixes, memory_of(memory), terms)
    return IndexUpdate(*numbers)
