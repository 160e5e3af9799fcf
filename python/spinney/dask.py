"""Distributed builds, exports and statistics on a Dask cluster (with the package distributed).

::

    from dask.distributed import Client
    import spinney.dask

    client = Client("tcp://scheduler:8786")
    spinney.dask.build("tiles/*.tif", "country.goblin", codec="packed")
    spinney.dask.build(xarray.open_zarr("s3://bucket/cube.zarr", chunks={}), "cube.goblin")
    spinney.dask.transform("country.goblin", "warp=EPSG:3035,cell=30", "europe.goblin")
    spinney.dask.combine("changed", ["2020.goblin", "2025.goblin"], "changes.goblin")
    spinney.dask.export_tiles("country.goblin", "country.pmtiles", zoom=(0, 14))
    spinney.dask.zonal("country.goblin", "districts.geojson", ["sum", "classes"])

Workers must see inputs and outputs at the same paths, or URLs. The results are byte-identical to
those of one machine. Each unit of work is one task in the dashboard; if its worker dies or it
fails, only that task is repeated.
"""

from __future__ import annotations

import builtins
import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from itertools import islice, pairwise
from typing import Any

from . import _native
from . import shards as _shards
from ._dataset import open
from ._files import MEMORY
from ._array_input import chunks_of, input_layers
from ._options import packing_of
from ._progress import ALONE, progress_callback
from ._remote import is_path, kept_name, path_of
from ._sources import paths_of
from ._stack import InputLayers
from ._types import Path, Progress
from ._zonal import definition_of, is_frame, measures_of, table_of

__all__ = ["build", "combine", "export_tiles", "transform", "zonal"]

#: Default number of tasks per thread of the cluster, which balances their load.
_TASKS_PER_THREAD = 4


def build(
    sources: Any,
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
    """Builds a tree from rasters or arrays, as `spinney.build` does, by shards on a cluster.

    Sources are paths, or a pattern such as "tiles/*.tif", with the options of
    `spinney.shards.plan`; or arrays of Dask, DataArrays and Datasets of xarray, zarr and others,
    with those of `spinney.build` for arrays. The worker that builds a shard computes its Dask
    chunks, or fetches them if they are persisted on the cluster. A chunk that several shards need
    is computed by each of them.

    The cluster is that of `client`, or of the current client. The job is a directory that all
    workers see, or a URL in a bucket; by default it is next to the output. It is planned by the
    calling process, and removed when the output is complete. If it exists already, because an
    earlier run was cancelled, only missing shards are built. A shard is built by one thread, with
    `memory`; a failed one is retried `retries` times, one whose worker has died always. `progress`
    counts shards.
    """
    run = _ClusterJob(client, out, job, shards, retries, memory, max_bytes, progress)
    if is_path(sources) or paths_of(sources) is not None:
        return run.build(lambda count: _shards.plan(sources, run.directory, shards=count, **options))
    import dask
    import dask.base

    given = input_layers(sources, memory, **options)
    token = str(dask.base.tokenize(sources, sorted(options.items(), key=lambda option: option[0])))
    packing = packing_of(options.get("codec", "plain"), options.get("max_error"))

    def plan(count: int) -> _shards.Job:
        _native.plan_layers(given.layers, run.directory, given.depth, token, packing, count, ALONE)
        return _shards.Job(run.directory)

    is_persisted = bool(_distributed().client.futures_of([chunks.array for chunks in chunks_of(given)]))
    # (The result of a task, not client data, so that it is recomputed if a worker is lost.)
    held = run.cluster.submit(_identity, _distributed().protocol.pickle.dumps(given), key=f"spinney-arrays-{run.name}", pure=False)
    run.build(plan, lambda number, **terms: run.cluster.submit(_build_arrays, number, held, run.directory, token, is_persisted, **terms))


def transform(
    path: Path,
    steps: str | Sequence[str],
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
    """Builds a tree from another one, as `spinney.transform` does, by shards on a cluster: see
    `build`. `options` are those of `spinney.shards.plan_transform`.
    """
    run = _ClusterJob(client, out, job, shards, retries, memory, max_bytes, progress)
    run.build(lambda count: _shards.plan_transform(path, steps, run.directory, shards=count, **options))


def combine(
    operation: str | int,
    paths: Sequence[Path],
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
    """Combines trees into one, as `spinney.combine` does, by shards on a cluster: see `build`.
    `options` are those of `spinney.shards.plan_combine`.
    """
    run = _ClusterJob(client, out, job, shards, retries, memory, max_bytes, progress)
    run.build(lambda count: _shards.plan_combine(operation, paths, run.directory, shards=count, **options))


class _ClusterJob:
    """A job on a cluster, with the arguments that all kinds of jobs have."""

    def __init__(
        self,
        client: Any,
        out: Path,
        job: Path | None,
        shards: int | None,
        retries: int,
        memory: int | str,
        max_bytes: int | str | None,
        progress: Progress,
    ) -> None:
        self.cluster = _client(client)
        self.out = kept_name(out, None)
        self.directory = kept_name(job if job is not None else f"{path_of(out)}.job", None)
        self.shards, self.retries, self.memory, self.max_bytes, self.progress = shards, retries, memory, max_bytes, progress
        #: The prefix of task names in the dashboard, unique to this run of the job.
        self.name = os.urandom(8).hex()

    def build(self, plan: Callable[[int], _shards.Job], submit: Callable[..., Any] | None = None) -> None:
        """Plans the job with its shards, builds the missing ones, and merges them."""
        threads = max(1, sum(self.cluster.nthreads().values()))
        # (A resumed job keeps its shards, however large the cluster was that planned it.)
        planned = plan(self.shards or (_shards.Job(self.directory).shards if _native.is_job(self.directory) else _TASKS_PER_THREAD * threads))
        of_files = submit or (lambda number, **terms: self.cluster.submit(_build, number, self.directory, self.memory, **terms))

        def start(number: int) -> Any:
            return of_files(number, key=f"spinney-shard-{self.name}-{number}", pure=False, retries=self.retries)

        # A task that waits for the cluster's chunks releases its thread to other tasks: without a
        # limit all shards would start.
        _wait(self.cluster, start, planned.missing(), self.progress, None if submit is None else threads)
        merge = (self.directory, self.out, self.memory, self.max_bytes)
        terms = {"key": f"spinney-merge-{self.name}", "pure": False, "retries": self.retries}
        _wait(self.cluster, lambda _: self.cluster.submit(_merge, *merge, **terms), [0], None)
        if _native.is_job(self.directory):
            planned.remove()


def _build(number: int, directory: str, memory: int | str) -> int:
    _shards.Job(directory).build(number, memory=memory, threads=1)
    return number


def _identity(given: bytes) -> bytes:
    return given


def _build_arrays(number: int, held: bytes, directory: str, token: str, is_persisted: bool) -> int:
    """Builds a shard of arrays."""
    given: InputLayers = _distributed().protocol.pickle.loads(held)
    terms = (None, 1, None)
    if not is_persisted:
        for chunks in chunks_of(given):
            chunks.scheduler = "single-threaded"
        _native.build_layers_shard(given.layers, directory, given.depth, token, number, terms)
        return number
    with _distributed().worker_client() as client:
        for chunks in chunks_of(given):
            chunks.scheduler = client.get
        _native.build_layers_shard(given.layers, directory, given.depth, token, number, terms)
    return number


def _merge(directory: str, out: str, memory: int | str, max_bytes: int | str | None) -> None:
    # (A bucket only accepts a complete file.)
    _shards.Job(directory).merge(out, remove_shards="://" not in out, memory=memory, max_bytes=max_bytes, threads=1)


def export_tiles(
    path: Path,
    out: Path,
    *,
    client: Any = None,
    job: Path | None = None,
    parts: int | None = None,
    retries: int = 2,
    progress: Progress = None,
    **options: Any,
) -> int:
    """Writes web map tiles, as `Dataset.export` does, distributed over the threads of a cluster;
    returns their number.

    `out` is an archive (.pmtiles, .mbtiles) or a pattern of names ("map/{z}/{x}/{y}.png"),
    `options` are those of `Dataset.export` for tiles. There are `parts`, by default four per
    thread, each of which is an archive in the job's directory. All workers must see it; by default
    it is next to the output. Archives that exist already, because an earlier run was cancelled, are
    kept; the directory is removed when the output is complete.
    """
    cluster = _client(client)
    if refused := sorted(options.keys() & {"part", "parts", "update", "since", "restyle", "resume", "threads"}):
        raise TypeError(f"{', '.join(refused)}: not supported for tiles that a cluster draws")
    target = kept_name(out, None)
    directory = kept_name(job if job is not None else f"{target.split('/{', 1)[0]}.job", None)
    if "://" in directory:
        raise ValueError(f"job: {directory}: is remote, expected a local directory that all workers see")
    os.makedirs(directory, exist_ok=True)
    # (A resumed job keeps its number of archives.)
    count = _parts_there(directory) or parts or _TASKS_PER_THREAD * max(1, sum(cluster.nthreads().values()))
    names = [os.path.join(directory, f"{number:04}-{count:04}.pmtiles") for number in range(count)]
    missing = [number for number, name in enumerate(names) if not os.path.exists(name)]
    run = os.urandom(8).hex()
    source = kept_name(path, None)

    def start(number: int) -> Any:
        part = (source, names[number], {**options, "part": (number, count)})
        return cluster.submit(_export, *part, key=f"spinney-tiles-{run}-{number}", pure=False, retries=retries)

    _wait(cluster, start, missing, progress)
    whole = cluster.submit(_export, source, target, {**options, "parts": names}, key=f"spinney-tiles-{run}", pure=False, retries=retries)
    _wait(cluster, lambda _: whole, [0], None)
    for name in names:
        os.remove(name)
    os.rmdir(directory)
    return int(whole.result())


def _export(source: str, target: str, options: dict[str, Any]) -> int:
    with open(source) as tree:
        count: Any = tree.export(target, threads=1, **options)
        return int(count)


def _parts_there(directory: str) -> int:
    """Returns the number of archives of an earlier run."""
    found = {int(name[5:9]) for name in os.listdir(directory) if re.fullmatch(r"[0-9]{4}-[0-9]{4}\.pmtiles", name)}
    return found.pop() if len(found) == 1 else 0


def zonal(
    path: Path,
    geometries: Any,
    measures: str | Sequence[str] | None = None,
    *,
    client: Any = None,
    parts: int | None = None,
    retries: int = 2,
    progress: Progress = None,
    **options: Any,
) -> Any:
    """Returns statistics of polygons, as `Dataset.zonal` does, with the polygons distributed over
    the threads of a cluster.

    Geometries are a GeoDataFrame or GeoSeries, for which the result is a table with its index; a
    list of polygons (of shapely, GeoJSON, ...); or a feature collection: GeoJSON as a dictionary,
    the path of such a file, or an object that has one as its `__geo_interface__`. `measures` and
    `options` are those of `Dataset.zonal`, except for `out`. There are `parts` tasks, by default
    four per thread.
    """
    if refused := sorted(options.keys() & {"out", "attribute", "threads"}):
        raise TypeError(f"{', '.join(refused)}: not supported for statistics by a cluster; write the returned results, or use Dataset.zonal")
    cluster = _client(client)
    names, levels = measures_of(measures, options.get("quantiles", ()))
    layers = options.get("layers")
    if isinstance(layers, str):
        raise TypeError("layers: expected a list of names, such as ds.names")
    if frame := is_frame(geometries):
        if options.get("where") is not None:
            raise ValueError("where: is for files; select rows of the frame beforehand, as in frame[frame.kind == 'lake']")
        own = getattr(geometries, "crs", None)
        if options.get("crs") is None:
            options["crs"] = "world" if own is None else definition_of(own)
        whole: Any = dict(geometries.__geo_interface__)
    else:
        if options.get("crs") is not None:
            options["crs"] = definition_of(options["crs"])
        whole = _collection(geometries)
    all_of_them: Sequence[Any] = geometries if whole is None else whole["features"]

    def result_of(zones: list[Any]) -> Any:
        return table_of(geometries, zones, names, levels) if frame else zones

    if not all_of_them:
        return result_of([]) if layers is None else {str(layer): result_of([]) for layer in layers}
    count = min(len(all_of_them), parts or _TASKS_PER_THREAD * sum(cluster.nthreads().values()))
    ends = [len(all_of_them) * part // count for part in range(count + 1)]
    fragments: list[Any] = [list(all_of_them[start:end]) for start, end in pairwise(ends)]
    if whole is not None:
        fragments = [{**whole, "features": features} for features in fragments]
    request = (kept_name(path, None), None if measures is None or (frame and not names) else names, options)
    name = f"spinney-zonal-{os.urandom(8).hex()}"
    tasks = cluster.map(_zonal, fragments, [request] * len(fragments), key=[f"{name}-{part}" for part in range(count)], pure=False, retries=retries)
    _wait(cluster, tasks.__getitem__, range(count), progress)
    done = cluster.gather(tasks)
    if all(error is not None for _, error in done):
        raise done[0][1]
    found = [rows for rows, _ in done]
    if layers is None:
        return result_of([row for rows in found for row in rows])
    return {str(layer): result_of([row for rows in found for row in rows[layer]]) for layer in layers}


def _zonal(fragment: Any, request: tuple[str, list[str] | None, dict[str, Any]]) -> tuple[Any, ValueError | None]:
    path, measures, options = request
    with open(path) as tree:
        zonal_of: Any = tree.zonal
        try:
            return zonal_of(fragment, measures, threads=1, **options), None
        except ValueError as error:
            # (It is an error if all polygons are outside of the tree, including those of other
            # tasks. Other errors are raised again.)
            tree._outside_is_error = False
            return zonal_of(fragment, measures, threads=1, **options), error


def _collection(geometries: Any) -> dict[str, Any] | None:
    """Returns a source's feature collection; nothing if it is a list of geometries."""
    if is_path(geometries):
        if not path_of(geometries).lower().endswith((".json", ".geojson")):
            raise ValueError(f"geometries: {path_of(geometries)}: is not GeoJSON; read it with geopandas, and pass the frame")
        with builtins.open(geometries, encoding="utf-8") as file:
            geometries = json.load(file)
    document = getattr(geometries, "__geo_interface__", geometries)
    if not isinstance(document, Mapping):
        return None
    if document.get("type") != "FeatureCollection":
        raise TypeError("geometries: expected a list of polygons, or a collection of features")
    return dict(document)


def _distributed() -> Any:
    """Returns the package distributed, which is mostly untyped."""
    import distributed

    return distributed


def _client(client: Any) -> Any:
    """Returns the given client, or the current one."""
    cluster = client or _distributed().get_client()
    if not cluster.nthreads():
        raise RuntimeError("the cluster has no workers")
    return cluster


def _wait(cluster: Any, start: Callable[[int], Any], numbers: Sequence[int], progress: Progress, limit: int | None = None) -> None:
    """Starts tasks by their numbers, at most `limit` at a time if given, and waits for all.
    If one fails, or on Ctrl-C, all others are cancelled.
    """
    rest = iter(numbers)
    tasks = [start(number) for number in islice(rest, limit)]
    with progress_callback(progress) as callback:
        try:
            running = _distributed().as_completed(tasks)
            for done, task in enumerate(running, 1):
                task.result()
                for number in islice(rest, 1):
                    tasks.append(start(number))
                    running.add(tasks[-1])
                if callback is not None:
                    callback(done, len(numbers))
        except BaseException:
            cluster.cancel(tasks)
            raise
