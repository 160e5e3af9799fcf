"""Rasters and solids larger than memory, stored as quadtrees and octrees on disk.

Any region at any level of detail is read directly from the file::

    import spinney

    with spinney.open("island.goblin") as ds:
        ds.read(1, window=(96, 64, 64, 64))     # cells, as NumPy arrays
        ds[64:128, 96:160]                      # the same
        ds.level(5)[...]                        # coarser cells
        ds.sample([(305000, 3196000)])          # values at world coordinates
        ds.stats((303000, 3194000, 307000, 3198000), coordinates="world")

Exact models (boundary representations) are built by `build_brep` and opened by `open_brep`::

    with spinney.open_brep("house.goblin") as model:
        model.mass().volume
        model.contains(points)                  # exact, for an array of points
        trimesh.Trimesh(*model.triangles())

Point trees are built by `build_points` and opened by `open_points`::

    with spinney.open_points("scan.goblin") as points:
        points.read(window=(500100, 5200100, 500300, 5200250))
        points.nearest(positions, k=3)

Line trees are built by `build_lines` and opened by `open_lines`::

    with spinney.open_lines("roads.goblin") as roads:
        distances, features, positions = roads.nearest(houses)

Trees are built from raster files, models of solids and arrays (`build`) or from other trees
(`transform`, `combine`), and edited in place (`edit`). With xarray installed,
`xarray.open_dataset(path, engine="spinney")` opens them lazily.

Reads return new arrays: cells are unpacked from the tree. `out=` reads into an existing array;
`numpy.from_dlpack(ds)` and `numpy.asarray(ds)` read everything; `ds.mapped(...)` returns dense
cells of the mapped file without a copy.

Errors are Python's own: ValueError for invalid arguments, IndexError for cells that do not exist,
OSError (FileNotFoundError, ...) for files, each with the library's message. Ctrl-C cancels a long
job within a second and leaves no partial output. Almost all work runs without the interpreter's
lock, so threads run in parallel.
"""

from ._build import build
from ._dataset import Dataset, Level, open
from ._edit import Edit, edit
from ._exact import ExactModel, build_brep, object_contacts, open_brep
from ._files import add_layer, blame, combine, compact, convert, cross, diff, drop_layer, log, recover, set_cache_memory, transform, verify
from ._index import IndexUpdate, index, update_index
from ._lines import BuiltLines, LineCrossings, LineLevel, LineTree, build_lines, open_lines
from ._native import version as __version__
from ._points import BuiltPoints, PointColumn, PointTree, build_points, open_points
from ._remote import restricted
from ._surfaces import RayCrossings, Shells, SurfaceHits
from ._types import (
    BandStatistics,
    Blocks,
    BoundingBox,
    Box,
    BuiltModel,
    CombinedModel,
    CombinedPolygons,
    Commit,
    Coverage,
    DetailLevel,
    DetailMesh,
    Differences,
    Euler,
    Faces,
    Finding,
    Hits,
    Labels,
    LevelCounts,
    Mass,
    Mesh,
    MovedModel,
    ObjectContact,
    Outcome,
    Section,
    Solid,
    Statistics,
    Surface,
    SurfaceIntersection,
    Transform,
    ZoneBand,
    ZoneStatistics,
    ZoneValues,
)

__all__ = [
    "BandStatistics",
    "Blocks",
    "BoundingBox",
    "Box",
    "BuiltLines",
    "BuiltModel",
    "BuiltPoints",
    "CombinedModel",
    "CombinedPolygons",
    "Commit",
    "Coverage",
    "Dataset",
    "DetailLevel",
    "DetailMesh",
    "Differences",
    "Edit",
    "Euler",
    "ExactModel",
    "Faces",
    "Finding",
    "Hits",
    "IndexUpdate",
    "Labels",
    "Level",
    "LevelCounts",
    "LineCrossings",
    "LineLevel",
    "LineTree",
    "Mass",
    "Mesh",
    "MovedModel",
    "ObjectContact",
    "Outcome",
    "PointColumn",
    "PointTree",
    "RayCrossings",
    "Section",
    "Shells",
    "Solid",
    "Statistics",
    "Surface",
    "SurfaceHits",
    "SurfaceIntersection",
    "Transform",
    "ZoneBand",
    "ZoneStatistics",
    "ZoneValues",
    "__version__",
    "add_layer",
    "blame",
    "build",
    "build_brep",
    "build_lines",
    "build_points",
    "combine",
    "compact",
    "convert",
    "cross",
    "diff",
    "drop_layer",
    "edit",
    "index",
    "log",
    "object_contacts",
    "open",
    "open_brep",
    "open_lines",
    "open_points",
    "recover",
    "restricted",
    "set_cache_memory",
    "transform",
    "update_index",
    "verify",
]
