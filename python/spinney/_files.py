"""Operations from files to files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, Literal, cast

from . import _native
from ._features import Edge, Overlaps, divided, features_over
from ._options import packing_of
from ._progress import ALONE, bytes_of, memory_of, working
from ._remote import is_path, path_of
from ._types import (
    ClassMatching,
    Extent,
    Units,
    Codec,
    CombinedModel,
    CombinedPolygons,
    Commit,
    Differences,
    Finding,
    MovedModel,
    Outcome,
    Path,
    Progress,
    Resampling,
    commit_of,
    outcome_of,
)

MEMORY = "256M"


def transform(
    path: Path,
    steps: str | Sequence[str],
    out: Path,
    *,
    resampling: Resampling | None = None,
    allow_ballpark: bool = False,
    move: bool = False,
    snap: float | None = None,
    unit: str | None = None,
    memory: int | str = MEMORY,
    codec: Codec = "plain",
    max_error: float | None = None,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> Outcome | MovedModel | int:
    """Builds a tree from a region of another one, moved, scaled, mirrored or rotated.

    Operations are those of `spinney transform` (`spinney help transform` lists them):
    `"rotate=30"`, `["crop", "scale=0.5"]`. New cells get their values by the file's rule, or with
    `resampling` "nearest" from their centres; `like=`, `warp=` and `grid=` support further
    resampling methods. The raster keeps its world coordinates unless `move` is set. An output
    larger than `max_bytes` raises OSError, and leaves no partial output.

    Exact models are transformed in world coordinates (`translate=`, `scale=`, `rotate=`, `mirror=`,
    `transpose`, `axes=`, `affine=`, `crs=`). Shifts by grid units, quarter turns, mirrors and
    uniform scales are exact; other transformations snap vertices to a grid, of `snap` units if
    given. `unit` names the result's unit of length. World coordinates of octrees of cells are
    converted to it. The last operation may be `levels`, which adds
    levels of detail (see `ExactModel.mesh`): `transform("x.goblin", "levels", "y.goblin")`.

    Feature files are written in another coordinate system (`"warp=EPSG:25832"`; `"crs=EPSG:4326"`
    specifies their own one): `transform("x.gpkg", "warp=EPSG:25832", "y.gpkg")` returns the number
    of features. Each vertex is transformed by itself.
    """
    chain = [steps] if isinstance(steps, str) else list(steps)
    if _native.is_feature_file(path_of(path)):
        given = {"resampling": resampling, "move": move or None, "snap": snap, "unit": unit, "max_error": max_error, "codec": None if codec == "plain" else codec}
        if wrong := [name for name, value in given.items() if value is not None]:
            raise ValueError(f"{', '.join(wrong)}: does not apply to a file of features")
        with working(progress, threads, max_bytes) as terms:
            return _native.reproject(path_of(path), chain, path_of(out), allow_ballpark, memory_of(memory), terms)
    with working(progress, threads, max_bytes) as terms:
        made = _native.transform(
            path_of(path), chain, path_of(out), resampling, allow_ballpark, move, (snap, unit), memory_of(memory), packing_of(codec, max_error), terms
        )
    return MovedModel(**made) if "faces" in made else outcome_of(made)


def combine(
    operation: str | int,
    paths: Sequence[Any],
    out: Path,
    *,
    values: Literal["first", "second"] = "first",
    fill: float | None = None,
    within: Sequence[float] | Path | None = None,
    margin: int | None = None,
    extent: Extent = "union",
    classes: ClassMatching = "name",
    units: Units = "convert",
    snap: float | None = None,
    value: float | str | None = None,
    overlaps: Overlaps | None = None,
    where: Mapping[str, Any] | str | None = None,
    edge: Edge | None = None,
    memory: int | str = MEMORY,
    codec: Codec = "plain",
    max_error: float | None = None,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> Outcome | CombinedModel | CombinedPolygons:
    """Combines trees into one: `"union"`, `"and"`, `"a-b"`, `"over"`, `"min"`, `"changed"`, ...

    The operations are those of `spinney combine`; set operations also have numbers (0 to 15).
    `values` decides whose value is used where a set operation finds both. `fill` is the value of
    cells that it makes of nothing, and `within` (a box in world coordinates) or `margin` (cells
    around the files) limits where it does that.

    The result has the first file's cells, over the `extent` of the first (`"a"`), of the others
    (`"b"`), of all, or their `"intersection"`. The others are converted to it: from other cells and
    coordinate systems, types, scales, units and class numbers; `conversions` of the result lists
    what was converted. With `classes` or `units` as `"number"` stored numbers are used unchanged.
    Exact models, also open ones, are combined exactly, as surfaces (set operations only, and none
    of these options).

    Features among the `paths` (files of them, or anything with a `__geo_interface__`) are
    rasterized to the cells of the trees, with a `value` (a number, or an attribute whose strings
    are names of the trees' categories), `overlaps`, `where` and `edge` as for `build`.

    If all `paths` are features, their polygons are combined exactly and without cells, also by
    `"partition"`, and written to a feature file. `where` selects features, and `within` (a box, or
    a file of polygons) limits the result. Its vertices are on a grid of `snap` units, or of the
    next smaller power of two.
    """
    if values not in ("first", "second"):
        raise ValueError(f"values: got {values!r}, expected 'first' or 'second'")
    operation, limit = str(operation), cast(Any, within)
    trees, features = divided(paths)
    if features and not trees:
        given = {"values": values != "first", "fill": fill, "margin": margin, "value": value, "overlaps": overlaps, "edge": edge, "extent": extent != "union", "classes": classes != "name", "units": units != "convert", "codec": codec != "plain", "max_error": max_error}
        if refused := [name for name, own in given.items() if own not in (None, False)]:
            raise ValueError(f"{', '.join(refused)}: not for polygons")
        region = path_of(limit) if is_path(limit) else None if limit is None else list(limit)
        with ExitStack() as stack:
            files = [stack.enter_context(features_over(source, where=where, has_own_system=True)) for _, source in features]
            terms = stack.enter_context(working(progress, threads, max_bytes))
            sources = [file["path"] for file in files]
            facts = _native.combine_polygons(operation, sources, path_of(out), files[0]["where"], region, snap, memory_of(memory), terms)
        return CombinedPolygons(**facts)
    if snap is not None:
        raise ValueError("snap: is for polygons")
    if is_path(limit):
        raise ValueError("within: got a file of polygons, expected a box; polygons limit operations on polygons only")
    box = None if limit is None else list(limit)
    if not features and (value is not None or overlaps is not None or where is not None or edge is not None):
        raise ValueError("value, overlaps, where, edge: are for features that are combined with trees")
    names = [path_of(path) for path in trees]
    with ExitStack() as stack:
        over = {"value": value, "overlaps": overlaps, "where": where, "edge": edge}
        overlaid = [(place, stack.enter_context(features_over(source, **over))) for place, source in features]  # type: ignore[arg-type]
        terms = stack.enter_context(working(progress, threads, max_bytes))
        made = _native.combine(
            operation, names, path_of(out), values == "second", fill, box, margin, (extent, classes, units, False), overlaid, memory_of(memory), packing_of(codec, max_error), terms
        )
    return CombinedModel(**made) if "faces" in made else outcome_of(made)


def cross(
    first: Path, second: Path, *, extent: Extent = "union", classes: ClassMatching = "name"
) -> list[tuple[list[float] | None, list[float] | None, int]]:
    """Counts which values of one tree coincide with which of another, and in how many cells; `None`
    is VOID. Classes of the second have the numbers of the first.
    """
    return _native.cross(path_of(first), path_of(second), (extent, classes, "convert", False), ALONE)


def diff(
    first: Path,
    second: Path,
    *,
    ranges: bool = False,
    extent: Extent = "union",
    classes: ClassMatching = "name",
    units: Units = "convert",
) -> Differences:
    """Compares two trees in world coordinates, most often two commits of one file; with `ranges`
    the result has the differing ranges of FD paths.

    The second is converted to the first's cells and values, as by `combine`.
    """
    sums, found = _native.diff(path_of(first), path_of(second), ranges, (extent, classes, units, False), ALONE)
    added, removed, changed, blocks, runs = sums
    return Differences(added, removed, changed, blocks, runs, found)


def verify(
    path: Path, *, quick: bool = False, memory: int | str = MEMORY, threads: int | None = None, progress: Progress = None
) -> list[Finding]:
    """Checks every checksum and every invariant of the tree. An empty list means that there are no
    defects. `quick` skips trees of older commits.
    """
    with working(progress, threads) as terms:
        findings = _native.verify(path_of(path), quick, memory_of(memory), terms)
    return [Finding(place, problem) for place, problem in findings]


def convert(
    path: Path,
    out: Path,
    *,
    share: bool = False,
    memory: int | str = MEMORY,
    codec: Codec = "plain",
    max_error: float | None = None,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> None:
    """Writes a tree, or one of its commits, in the format of the output's name: .goblin or .autumn.

    Segments are packed with `codec`, whatever the file's own codec is.
    """
    with working(progress, threads, max_bytes) as terms:
        _native.convert(path_of(path), path_of(out), share, memory_of(memory), packing_of(codec, max_error), terms)


def add_layer(
    path: Path,
    tree: Path,
    name: str,
    *,
    view: str | Sequence[str] = (),
    message: str = "",
    author: str = "",
    time: int | None = None,
    memory: int | str = MEMORY,
    codec: Codec = "plain",
    max_error: float | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> int | None:
    """Adds a tree, or a view of one, to a file as a layer. Its cells must be aligned with the
    file's, or 2, 4, 8 ... times as large.

    A Goblin file is rewritten, with its other layers unchanged, packed or not; an Autumnal file
    gets a commit, whose number is returned.
    """
    steps = [view] if isinstance(view, str) else list(view)
    note = (time, author, message or f"Add layer {name}")
    with working(progress, threads, None) as terms:
        return _native.add_layer(path_of(path), path_of(tree), name, steps, note, memory_of(memory), packing_of(codec, max_error), terms)


def drop_layer(
    path: Path,
    name: str,
    *,
    message: str = "",
    author: str = "",
    time: int | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> int | None:
    """Removes a layer from a file; returns the number of the commit in an Autumnal file."""
    note = (time, author, message or f"Drop layer {name}")
    with working(progress, threads, None) as terms:
        return _native.drop_layer(path_of(path), name, note, terms)


def blame(
    path: Path,
    out: Path,
    *,
    memory: int | str = MEMORY,
    codec: Codec = "plain",
    max_error: float | None = None,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> None:
    """Builds a tree of the numbers of the commits that last changed each cell of an Autumnal
    file.
    """
    with working(progress, threads, max_bytes) as terms:
        _native.blame(path_of(path), path_of(out), memory_of(memory), packing_of(codec, max_error), terms)


def compact(
    path: Path,
    out: Path,
    *,
    keep: int = 1,
    commits: Sequence[int] | None = None,
    share: bool = False,
    pack: bool = False,
    memory: int | str = MEMORY,
    max_bytes: int | str | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> list[Commit]:
    """Writes the `keep` newest commits of an Autumnal file, or those with the given numbers, to a
    new file.

    With ``pack``, data that only older commits use are compressed; they take longer to read.
    """
    numbers = None if commits is None else list(commits)
    with working(progress, threads, max_bytes) as terms:
        made = _native.compact(
            path_of(path), path_of(out), keep, numbers, share, pack, memory_of(memory), terms
        )
    return [commit_of(facts) for facts in made]


def recover(path: Path, to: int, *, threads: int | None = None, progress: Progress = None) -> Commit:
    """Makes an older commit the newest if later ones are corrupt."""
    with working(progress, threads) as terms:
        return commit_of(_native.recover(path_of(path), to, terms))


def log(path: Path) -> list[Commit]:
    """Returns the commits of an Autumnal file, newest first."""
    return [commit_of(facts) for facts in _native.log(path_of(path))]


def set_cache_memory(bytes: int | str) -> None:
    """Sets the size of this process's cache of unpacked segments; the default is 64 MiB."""
    _native.set_cache_memory(bytes_of(bytes, "bytes"))
