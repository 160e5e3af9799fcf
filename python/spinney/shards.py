"""Trees built by many processes, on one machine or on many.

A job is planned, each of its shards is built independently, and the shards are merged. The bytes
are those of `spinney.build`, `spinney.transform` or `spinney.combine`::

    from spinney import shards

    job = shards.plan("tiles/*.tif", "job", shards=64, codec="packed")
    for number in range(job.shards):        # in any process, in any order; can be repeated
        job.build(number)
    job.merge("country.goblin")

The program's `spinney shard` works on the same directories; `spinney.dask.build` runs jobs on a
Dask cluster.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from typing import Any, Literal, cast

from . import _native
from ._files import MEMORY
from ._options import names_of, packing_of
from ._progress import memory_of, working
from ._metadata import crs_text, numbers_of
from ._remote import is_path, path_of
from ._times import text_of_time
from ._types import Codec, Path, Progress, Resampling

__all__ = ["Job", "plan", "plan_combine", "plan_transform"]

#: Options of features and models, which shards do not support.
_OTHERS = ("cells", "cell", "grid", "max_zoom", "resampling", "edge", "attribute", "up", "unit", "value", "overlaps", "sample", "width", "where")


def plan(
    sources: Path | Sequence[Path],
    job: Path,
    *,
    shards: int | None = None,
    kind: Literal["categorical", "continuous"] | None = None,
    rule: str | None = None,
    bands: Sequence[int | str] | None = None,
    nodata: float | None = None,
    transform: Any = None,
    crs: Any = None,
    depth: int | None = None,
    layer: str | None = None,
    pages: int | Literal["layers"] | None = None,
    stack: bool = False,
    names: Sequence[str] | None = None,
    times: Sequence[Any] | None = None,
    keep_transparent: bool = False,
    codec: Codec = "plain",
    max_error: float | None = None,
    index: bool = False,
    stored_level: Literal[1, 2, 4] | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> Job:
    """Plans the build of a tree from rasters, and its shards, in a directory, which is created if
    needed; no pixel is read.

    Sources are paths or URLs, or a pattern such as "tiles/*.tif", whose files are sorted by name;
    the directory may be a URL, too, such as s3://bucket/job. The options are those of
    `spinney.build` for rasters. By default there is one of the `shards` per GiB of input. The same
    plan can be made again. If the directory has another plan, it is left unchanged, and that is an
    error. With `index`, the shards are those of an index, as by `spinney.index`.
    """
    if stored_level is not None and not index:
        raise ValueError("stored_level: is for index=True")
    given: dict[str, Any] = {
        "kind": kind,
        "rule": rule,
        "bands": None if bands is None else list(bands),
        "nodata": nodata,
        "transform": None if transform is None else numbers_of(transform),
        "crs": crs_text(crs),
        "depth": depth,
        "layer": layer,
        "pages": pages,
        "stack": stack,
        "names": None if names is None else names_of(names),
        "times": None if times is None else [time if isinstance(time, str) else text_of_time(time) for time in times],
        "keep_transparent": keep_transparent,
        "packing": packing_of(codec, max_error),
    }
    of_others = dict.fromkeys(_OTHERS) | {"shell": False, "fractions": False, "allow_ballpark": False}
    options = given | of_others | {"memory": memory_of(MEMORY), "share": False, "time": None}
    options["referenced"] = (stored_level or 2) if index else None
    with working(progress, threads) as terms:
        _native.plan_shards(_files_of(sources), path_of(job), options, shards, terms)
    return Job(job)


def plan_transform(
    path: Path,
    steps: str | Sequence[str],
    job: Path,
    *,
    shards: int | None = None,
    resampling: Resampling | None = None,
    allow_ballpark: bool = False,
    move: bool = False,
    codec: Codec = "plain",
    max_error: float | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> Job:
    """Plans the build of a tree from another one, as by `spinney.transform`, without operations
    that need all cells first (`components=`, `sieve=`). See `plan`.
    """
    chain = [steps] if isinstance(steps, str) else list(steps)
    with working(progress, threads) as terms:
        _native.plan_transform(
            path_of(path), chain, path_of(job), resampling, allow_ballpark, move, packing_of(codec, max_error), shards, terms
        )
    return Job(job)


def plan_combine(
    operation: str | int,
    paths: Sequence[Path],
    job: Path,
    *,
    shards: int | None = None,
    values: Literal["first", "second"] = "first",
    fill: float | None = None,
    within: Sequence[float] | None = None,
    margin: int | None = None,
    codec: Codec = "plain",
    max_error: float | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> Job:
    """Plans the combination of several trees, as by `spinney.combine`. See `plan`."""
    if values not in ("first", "second"):
        raise ValueError(f"values: got {values!r}, expected 'first' or 'second'")
    box = None if within is None else list(within)
    names = [path_of(path) for path in paths]
    with working(progress, threads) as terms:
        _native.plan_combine(
            str(operation), names, path_of(job), values == "second", fill, box, margin, packing_of(codec, max_error), shards, terms
        )
    return Job(job)


def _files_of(sources: Path | Sequence[Path]) -> list[str]:
    """Returns the paths of sources."""
    if not is_path(sources):
        return [path_of(source) for source in cast(Sequence[Path], sources)]
    path = path_of(sources)
    if "://" in path or os.path.exists(path) or not glob.has_magic(path):
        return [path]
    found = sorted(glob.glob(path))
    if not found:
        raise FileNotFoundError(f"{path}: no such files")
    return found


class Job:
    """A planned job: a directory, or a URL in a bucket. Any process that sees it and the inputs at
    the same paths can work on it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path_of(path)
        self.shards, self.busy_shards, self.input_bytes = _native.job_counts(self.path)

    def __fspath__(self) -> str:
        return self.path

    def __repr__(self) -> str:
        return f"<Job {_native.shown(str(self.path))}: {self.shards} shards>"

    def build(self, number: int, *, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None) -> bool:
        """Builds a shard, numbered from 0, unless it exists already; returns whether it existed. It
        is an error if an input is not the planned one.
        """
        with working(progress, threads) as terms:
            was_there, _ = _native.build_shard(self.path, number, memory_of(memory), terms)
        return was_there

    def missing(self) -> list[int]:
        """Returns the numbers of the missing shards."""
        return _native.missing_shards(self.path)

    def merge(
        self,
        out: Path,
        *,
        remove_shards: bool = False,
        memory: int | str = MEMORY,
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> None:
        """Merges the shards, all of which must exist. The job is kept; with `remove_shards` each
        shard is deleted as soon as its bytes are in the output, so that disk space for one of both
        is enough. A cancelled merge of that kind leaves a file whose name ends with .partial, and
        continues from it when it is repeated.
        """
        with working(progress, threads, max_bytes) as terms:
            _native.merge_shards(self.path, path_of(out), remove_shards, memory_of(memory), terms)

    def remove(self) -> None:
        """Removes the job, local or in its bucket: all its files, and the directory unless it has
        other contents.
        """
        _native.remove_job(self.path)
