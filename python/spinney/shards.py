"""Trees that many processes build, on one machine or on many.

A job is planned, each of its shards is built by itself, and shards are put together. The bytes are those of `spinney.build`, `spinney.transform` or `spinney.combine`::

    from spinney import shards

    job = shards.plan("tiles/*.tif", "job", shards=64, codec="packed")
    for number in range(job.shards):        # each may be another process, in any order, and may be run again
        job.build(number)
    job.merge("country.goblin")

The program's `spinney shard` does the same with the same folders; `spinney.dask.build` lets a cluster of Dask do it.
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

#: Options of features and models, which shards are not made of.
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
    threads: int | None = None,
    progress: Progress = None,
) -> Job:
    """Plans what is built of pictures, and by which shards, in a folder, which is made if there is none; no pixel is read.

    Sources are paths or URLs, or a pattern such as "tiles/*.tif", whose files are taken by their names; the folder may be a URL, too, such as
    s3://bucket/job. The options are those of `spinney.build`
    for pictures. Without a number of `shards` there is one for each GiB of input. The same plan may be made again; a folder that has
    another one is left as it is, which is an error.
    """
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
    """Plans what is made of a tree, as `spinney.transform` makes it, but for steps that go through all cells first (`components=`, `sieve=`). See `plan`."""
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
    """Plans what is made of several trees, as `spinney.combine` makes it. See `plan`."""
    if values not in ("first", "second"):
        raise ValueError(f"values: {values!r}, expected 'first' or 'second'")
    box = None if within is None else list(within)
    names = [path_of(path) for path in paths]
    with working(progress, threads) as terms:
        _native.plan_combine(
            str(operation), names, path_of(job), values == "second", fill, box, margin, packing_of(codec, max_error), shards, terms
        )
    return Job(job)


def _files_of(sources: Path | Sequence[Path]) -> list[str]:
    """The paths that are meant."""
    if not is_path(sources):
        return [path_of(source) for source in cast(Sequence[Path], sources)]
    path = path_of(sources)
    if "://" in path or os.path.exists(path) or not glob.has_magic(path):
        return [path]
    found = sorted(glob.glob(path))
    if not found:
        raise FileNotFoundError(f"{path}: there are no such files")
    return found


class Job:
    """A job that is planned: a folder, or a place in a bucket, which any process that sees it and the inputs by the same paths can work on."""

    def __init__(self, path: Path) -> None:
        self.path = path_of(path)
        self.shards, self.busy_shards, self.input_bytes = _native.look_at_job(self.path)

    def __fspath__(self) -> str:
        return self.path

    def __repr__(self) -> str:
        return f"<Job {_native.shown(str(self.path))}: {self.shards} shards>"

    def build(self, number: int, *, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None) -> bool:
        """Builds a shard, from 0, unless it is made already, which is told. An error if an input is not the one that was planned."""
        with working(progress, threads) as terms:
            was_there, _ = _native.build_shard(self.path, number, memory_of(memory), terms)
        return was_there

    def missing(self) -> list[int]:
        """Numbers of the shards that are not made."""
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
        """Puts the shards together, all of which must be made. The job stays, or with `remove_shards` goes, shard by shard, as its bytes come to be in the output,
        so that there is room for one of both; what is cut off then goes on when it is done again, with a file whose name ends with .partial."""
        with working(progress, threads, max_bytes) as terms:
            _native.merge_shards(self.path, path_of(out), remove_shards, memory_of(memory), terms)

    def remove(self) -> None:
        """Removes the job, here or in its bucket: all files of it, and the folder unless there is something else in it."""
        _native.remove_job(self.path)
