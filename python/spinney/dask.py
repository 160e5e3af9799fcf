"""Work of many machines, by a cluster of Dask (with the package distributed).

::

    from dask.distributed import Client
    import spinney.dask

    client = Client("tcp://scheduler:8786")
    spinney.dask.build("tiles/*.tif", "country.goblin", codec="packed")
    spinney.dask.zonal("country.goblin", "districts.gpkg", ["sum", "classes"])

Workers see inputs and outputs by the same paths, or URLs. The results are those of one machine, bytes and all. Each piece of work is a task of its own in the
dashboard; those whose worker dies or fails are done again, and nothing else.
"""

from __future__ import annotations

import builtins
import json
import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from . import _native
from . import shards as _shards
from ._dataset import open
from ._elsewhere import kept_name
from ._files import MEMORY
from ._progress import telling
from ._types import Path, Progress

__all__ = ["build", "zonal"]

#: Pieces of work for each thread of the cluster, if nothing is said: so many that none has much more to do than others.
_PIECES_A_THREAD = 4


def build(
    sources: Path | Sequence[Path],
    out: Path,
    *,
    client: Any = None,
    job: Path | None = None,
    shards: int | None = None,
    retries: int = 2,
    memory: int | str = MEMORY,
    max_bytes: int | str | None = None,
    progress: Progress = None,
    **options: Any,
) -> None:
    """Makes a tree of pictures, as `spinney.build` makes it, by shards on a cluster.

    The cluster is that of `client`, or of the current client. `options` are those of `spinney.shards.plan`. The job is a folder that all workers see, or a place in a bucket, if none
    is given one beside the output; it is planned here, and removed when the output is there. If it is there already, because an
    earlier run was cut off, only what is missing is built. A shard is built by one thread, with `memory`; one that fails is tried
    `retries` times more, one whose worker has died always. `progress` counts shards.
    """
    cluster = _client(client)
    folder = kept_name(job if job is not None else f"{os.fspath(out)}.job", None)
    # (A job that goes on has its shards, however large the cluster was that began it.)
    usual = _shards.Job(folder).shards if _native.is_job(folder) else max(1, _PIECES_A_THREAD * sum(cluster.nthreads().values()))
    planned = _shards.plan(sources, folder, shards=shards or usual, **options)
    missing = planned.missing()
    # (Names of tasks are for the dashboard; another job of the same folder has other ones.)
    run = os.urandom(8).hex()
    names = [f"spinney-shard-{run}-{number}" for number in missing]
    tasks = cluster.map(_build, missing, folder=folder, memory=memory, key=names, pure=False, retries=retries)
    _wait(cluster, tasks, progress)
    merge = cluster.submit(_merge, folder, kept_name(out, None), memory, max_bytes, key=f"spinney-merge-{run}", pure=False, retries=retries)
    _wait(cluster, [merge], None)
    planned.remove()


def _build(number: int, folder: str, memory: int | str) -> int:
    _shards.Job(folder).build(number, memory=memory, threads=1)
    return number


def _merge(folder: str, out: str, memory: int | str, max_bytes: int | str | None) -> None:
    _shards.Job(folder).merge(out, memory=memory, max_bytes=max_bytes, threads=1)


def zonal(
    path: Path,
    geometries: Any,
    measures: Sequence[str] | None = None,
    *,
    client: Any = None,
    parts: int | None = None,
    retries: int = 2,
    progress: Progress = None,
    **options: Any,
) -> list[Any]:
    """Statistics of polygons, as `Dataset.zonal` tells them, some of the polygons on each thread of a cluster.

    Geometries are a list of polygons (of shapely, GeoJSON, ...), or a collection of features: GeoJSON as a dictionary, the path of such a file, or what has one as its
    `__geo_interface__`. `measures` and `options` are those of `Dataset.zonal`. There are `parts`, four for each thread if nothing is said.
    """
    cluster = _client(client)
    whole = _collection(geometries)
    all_of_them: Sequence[Any] = geometries if whole is None else whole["features"]
    if not all_of_them:
        return []
    count = min(len(all_of_them), parts or _PIECES_A_THREAD * sum(cluster.nthreads().values()))
    ends = [len(all_of_them) * part // count for part in range(count + 1)]
    pieces: list[Any] = [list(all_of_them[start:end]) for start, end in pairwise(ends)]
    if whole is not None:
        pieces = [{**whole, "features": piece} for piece in pieces]
    asked = (kept_name(path, None), None if measures is None else list(measures), options)
    name = f"spinney-zonal-{os.urandom(8).hex()}"
    tasks = cluster.map(_zonal, pieces, [asked] * len(pieces), key=[f"{name}-{part}" for part in range(count)], pure=False, retries=retries)
    _wait(cluster, tasks, progress)
    return [row for rows in cluster.gather(tasks) for row in rows]


def _zonal(piece: Any, asked: tuple[str, list[str] | None, dict[str, Any]]) -> list[Any]:
    path, measures, options = asked
    with open(path) as tree:
        ask: Any = tree.zonal
        return list(ask(piece, measures, threads=1, **options))


def _collection(geometries: Any) -> dict[str, Any] | None:
    """The collection of features that is meant; nothing if it is a list of geometries."""
    if isinstance(geometries, str | os.PathLike):
        if not os.fspath(geometries).lower().endswith((".json", ".geojson")):
            raise ValueError(f"geometries: {os.fspath(geometries)}: is no GeoJSON; read it with geopandas, and give the frame")
        with builtins.open(geometries, encoding="utf-8") as file:
            geometries = json.load(file)
    # (A frame tells its system beside its features.)
    own = getattr(geometries, "crs", None)
    document = getattr(geometries, "__geo_interface__", geometries)
    if not isinstance(document, Mapping):
        return None
    if document.get("type") != "FeatureCollection":
        raise TypeError("geometries: expected a list of polygons, or a collection of features")
    if own is not None:
        raise TypeError("geometries: of a frame with a system give `list(frame.geometry)`, and the system as `crs`")
    return dict(document)


def _distributed() -> Any:
    """The package distributed. (It has few types.)"""
    import distributed

    return distributed


def _client(client: Any) -> Any:
    """The client that is given, or the current one."""
    cluster = client or _distributed().get_client()
    if not cluster.nthreads():
        raise RuntimeError("the cluster has no workers")
    return cluster


def _wait(cluster: Any, tasks: list[Any], progress: Progress) -> None:
    """Waits for tasks; the first that fails, or Ctrl-C, ends all others."""
    with telling(progress) as tell:
        try:
            for done, task in enumerate(_distributed().as_completed(tasks), 1):
                task.result()
                if tell is not None:
                    tell(done, len(tasks))
        except BaseException:
            cluster.cancel(tasks)
            raise
