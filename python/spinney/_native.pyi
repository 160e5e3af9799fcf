"""Native part of the package."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, final, overload

import numpy as np
import numpy.typing as npt
from typing_extensions import disjoint_base

from ._elsewhere import Elsewhere
from ._types import Array

version: str

_ZoneBand = tuple[float, float, float, float, float, float, tuple[int, float, float, float, list[float]] | None]
_Packing = tuple[str, str | None, float | None]
_Contact = tuple[list[str], list[int], str, float, float, list[float]]
_Terms = tuple[Callable[[int, int], object] | None, int | None, int | None]

@disjoint_base
class Tree:
    def __new__(
        cls,
        path: Any,
        view: list[str],
        commit: int | None,
        positioned: bool,
        layer: str | None,
        elsewhere: Elsewhere = ...,
        beside: Tree | None = None,
    ) -> Tree: ...
    @property
    def _elsewhere(self) -> Elsewhere: ...
    def close(self) -> None: ...
    @property
    def closed(self) -> bool: ...
    def refresh(self) -> bool: ...
    def check_unchanged(self) -> None: ...
    @property
    def path(self) -> Path | str: ...
    @property
    def view(self) -> list[str]: ...
    @property
    def positioned(self) -> bool: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def layer(self) -> str: ...
    @property
    def time(self) -> str | None: ...
    @property
    def commit(self) -> int | None: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...
    @property
    def count(self) -> int: ...
    @property
    def depth(self) -> int: ...
    def _is_approximate(self, level: int) -> bool: ...
    def _shape_at(self, level: int | None) -> list[int]: ...
    @property
    def _frame(self) -> list[list[float]]: ...
    @property
    def _world_box(self) -> list[list[float]]: ...
    @property
    def crs(self) -> str | None: ...
    @property
    def _crs_wkt(self) -> str | None: ...
    @property
    def nodata(self) -> float | None: ...
    @property
    def fill_value(self) -> float: ...
    @property
    def _missing(self) -> float | None: ...
    def _facts(self) -> dict[str, Any]: ...
    @overload
    def read(
        self,
        bands: int | list[int] | tuple[int, ...] | None = None,
        *,
        layers: list[str] | tuple[str, ...] | None = None,
        window: Any = None,
        coordinates: Any = None,
        level: int | None = None,
        out_shape: tuple[int, ...] | None = None,
        exact: bool = False,
        masked: Literal[False] = False,
        fill: float | None = None,
        boundless: bool = False,
        out: Array | None = None,
    ) -> Array: ...
    @overload
    def read(
        self,
        bands: int | list[int] | tuple[int, ...] | None = None,
        *,
        layers: list[str] | tuple[str, ...] | None = None,
        window: Any = None,
        coordinates: Any = None,
        level: int | None = None,
        out_shape: tuple[int, ...] | None = None,
        exact: bool = False,
        masked: Literal[True],
        fill: float | None = None,
        boundless: bool = False,
        out: Array | None = None,
    ) -> np.ma.MaskedArray[Any, Any]: ...
    @overload
    def read(
        self,
        bands: int | list[int] | tuple[int, ...] | None = None,
        *,
        layers: list[str] | tuple[str, ...] | None = None,
        window: Any = None,
        coordinates: Any = None,
        level: int | None = None,
        out_shape: tuple[int, ...] | None = None,
        exact: bool = False,
        masked: bool,
        fill: float | None = None,
        boundless: bool = False,
        out: Array | None = None,
    ) -> Array: ...
    def __getitem__(self, key: Any, /) -> Any: ...
    def _at_index(self, level: int | None, key: Any) -> Any: ...
    def _sample_points(
        self, points: npt.NDArray[np.float64], level: int | None, coordinates: Any, fill: float | None
    ) -> tuple[Array, npt.NDArray[np.bool_]]: ...
    def _build(self, out: Any, options: dict[str, Any], terms: _Terms) -> None: ...
    def _statistics(self, window: Any = None, coordinates: Any = None) -> dict[str, Any]: ...
    def _mapped(self, window: Any = None, coordinates: Any = None, level: int | None = None) -> Array | None: ...
    def _zones(
        self,
        documents: list[tuple[str, str | None, bool]],
        edge: str,
        asked: tuple[str | list[tuple[str, str]], int, list[str], list[float]],
        layers: list[str] | None,
        terms: _Terms,
    ) -> list[list[tuple[tuple[float, float, float], list[_ZoneBand], list[tuple[float, float]]]]]: ...
    def _write_zones(
        self,
        features: tuple[str, str | None],
        edge: str,
        asked: tuple[str | list[tuple[str, str]], int, list[str], list[float]],
        attributes: list[str] | None,
        layers: list[str] | None,
        out: Any,
        terms: _Terms,
    ) -> int: ...
    def _labels(
        self, connect: int | None, neighbours: bool, memory: int, terms: _Terms
    ) -> tuple[
        npt.NDArray[Any],
        npt.NDArray[Any] | None,
        npt.NDArray[np.uint64],
        npt.NDArray[np.int64],
        npt.NDArray[np.int64],
        npt.NDArray[Any],
        npt.NDArray[np.uint64],
        float | None,
    ]: ...
    def _level_counts(self, terms: _Terms) -> list[list[int]]: ...
    def _count_bins(
        self, bins: int, low: float, high: float, window: Any = None, coordinates: Any = None
    ) -> npt.NDArray[np.uint64]: ...
    def _find_blocks(
        self,
        condition: str,
        number: float,
        window: Any = None,
        coordinates: Any = None,
        limit: int | None = None,
        largest: int | None = None,
        within: dict[str, Any] | None = None,
        memory: int | None = None,
    ) -> tuple[list[str], npt.NDArray[np.uint8], npt.NDArray[np.int64], npt.NDArray[Any], npt.NDArray[np.bool_]]: ...
    def _measure(self, level: int | None, surface: bool, terms: _Terms) -> dict[str, Any]: ...
    def _cast_rays(
        self,
        origins: npt.NDArray[np.float64],
        directions: npt.NDArray[np.float64],
        level: int | None,
        smooth: bool,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64]]: ...
    def _slice_across(
        self, across: int, at: float, coordinates: str, level: int | None, masked: bool, fill: float | None
    ) -> Array: ...
    def _surface_arrays(
        self, level: int | None, smooth: bool, terms: _Terms
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]: ...
    def _write_mesh(
        self, path: Any, level: int | None, smooth: bool, triangles: bool, terms: _Terms
    ) -> tuple[int, int]: ...
    def _write_render(
        self,
        path: Any,
        size: tuple[int, int],
        direction: tuple[float, float],
        level: int | None,
        scale: float,
        orthographic: bool,
        up: str,
        background: tuple[int, int, int] | None,
        samples: int,
        terms: _Terms,
    ) -> int: ...
    def _write_window(
        self,
        path: Any,
        window: Any,
        coordinates: Any,
        level: int | None,
        shape: tuple[int, int] | None,
        exact: bool,
        nodata: float | None,
        range: tuple[float, float] | None,
        style: str | None,
        terms: _Terms,
    ) -> None: ...
    def _write_legend(self, path: Any, style: str | None, scale: int, terms: _Terms) -> None: ...
    def _write_cog(
        self, path: Any, tile_size: int | None, compression: str | None, nodata: float | None, terms: _Terms
    ) -> None: ...
    def _write_contours(self, path: Any, options: dict[str, Any], terms: _Terms) -> int: ...
    def _write_polygons(
        self,
        path: Any,
        classes: list[float] | None,
        connect: int,
        simplify: float | None,
        level: int | None,
        terms: _Terms,
    ) -> int: ...
    def _write_chain_code(
        self,
        path: Any,
        classes: list[float] | None,
        connect: int,
        directions: int,
        level: int | None,
        terms: _Terms,
    ) -> int: ...
    def _write_gltf(self, path: Any, level: int | None, smooth: bool, terms: _Terms) -> int: ...
    @staticmethod
    def _is_tiles(path: Any) -> bool: ...
    def _write_tiles(
        self, path: Any, window: Any, coordinates: Any, options: dict[str, Any], terms: _Terms
    ) -> int: ...

@disjoint_base
class Model:
    def __new__(cls, path: Any, positioned: bool, elsewhere: Elsewhere = ..., steps: list[str] = ...) -> Model: ...
    @property
    def view(self) -> list[str]: ...
    @property
    def _elsewhere(self) -> Elsewhere: ...
    def close(self) -> None: ...
    @property
    def closed(self) -> bool: ...
    @property
    def path(self) -> Path | str: ...
    @property
    def positioned(self) -> bool: ...
    def check_unchanged(self) -> None: ...
    def __len__(self) -> int: ...
    def _facts(self) -> dict[str, Any]: ...
    def _bounds(self) -> list[list[float]]: ...
    def _mass(self, terms: _Terms) -> dict[str, Any]: ...
    def _euler(self, memory: int, terms: _Terms) -> dict[str, Any]: ...
    def _locate(self, points: npt.NDArray[np.float64], terms: _Terms) -> npt.NDArray[np.int8]: ...
    def _nearest(
        self, points: npt.NDArray[np.float64], signed: bool, terms: _Terms
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64]]: ...
    def _cast_rays(
        self, origins: npt.NDArray[np.float64], directions: npt.NDArray[np.float64], terms: _Terms
    ) -> tuple[
        npt.NDArray[np.float64],
        npt.NDArray[np.float64],
        npt.NDArray[np.int64],
        npt.NDArray[np.int64],
        npt.NDArray[np.bool_],
    ]: ...
    def _cross_rays(
        self, origins: npt.NDArray[np.float64], directions: npt.NDArray[np.float64], terms: _Terms
    ) -> tuple[
        npt.NDArray[np.int64],
        tuple[
            npt.NDArray[np.float64],
            npt.NDArray[np.float64],
            npt.NDArray[np.int64],
            npt.NDArray[np.int64],
            npt.NDArray[np.bool_],
        ],
    ]: ...
    def _shells(self, memory: int, terms: _Terms) -> dict[str, Any]: ...
    def _objects(
        self, memory: int, terms: _Terms
    ) -> list[tuple[str, str | None, tuple[bool, float | None, float, list[list[float]] | None] | None]]: ...
    def _face_columns(self) -> list[str]: ...
    def _face_values(self, column: int, terms: _Terms) -> list[tuple[int, str]]: ...
    def _contacts(self, memory: int, terms: _Terms) -> list[_Contact]: ...
    def _place_of_box(self, min: list[float], max: list[float]) -> Any: ...
    def _coverage(
        self, level: int, position: list[int], terms: _Terms
    ) -> tuple[float, float, list[float] | None]: ...
    def _export(self, path: Any, terms: _Terms) -> tuple[int, int, int]: ...
    def _write_section(
        self, path: Any, cutters: list[Any], flat: bool, memory: int, terms: _Terms
    ) -> dict[str, Any]: ...
    def _face_arrays(self, part: Any, terms: _Terms) -> dict[str, Any]: ...
    def _triangle_arrays(
        self, part: Any, terms: _Terms
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64]]: ...

@final
class Editor:
    def __new__(cls, path: Any, memory: int) -> Editor: ...
    def paste(
        self, patch: Any, steps: list[str], at: list[int] | None, where_valid: bool, terms: _Terms
    ) -> None: ...
    def fill(
        self,
        value: list[float] | None,
        window: Any,
        coordinates: Any,
        polygon: list[list[tuple[float, float]]] | None,
        block: str | None,
        terms: _Terms,
    ) -> None: ...
    def fill_zones(self, zones: dict[str, Any], is_void: bool, memory: int, terms: _Terms) -> None: ...
    def set(
        self, cells: npt.NDArray[np.int64], values: npt.NDArray[Any] | None, terms: _Terms
    ) -> None: ...
    def combine(self, operation: str, other: Any, terms: _Terms) -> None: ...
    def revert(self, commit: int, terms: _Terms) -> None: ...
    def commit(self, message: str, author: str, time: int | None) -> dict[str, Any] | None: ...
    def close(self) -> None: ...

def build_array(
    read: Callable[[list[int], list[int]], tuple[Array, npt.NDArray[np.bool_] | None]],
    out: Any,
    options: dict[str, Any],
    terms: _Terms,
) -> None: ...
def build_layers(layers: list[dict[str, Any]], out: Any, depth: int | None, terms: _Terms) -> None: ...
_Wanted = tuple[Any, Any, Any, int | None, str | None]
_PointTerms = tuple[int | None, str | None, list[str] | None, int, str | None]

@disjoint_base
class Points:
    def __new__(cls, path: Any, positioned: bool, elsewhere: Elsewhere = ...) -> Points: ...
    @property
    def _elsewhere(self) -> Elsewhere: ...
    def close(self) -> None: ...
    @property
    def closed(self) -> bool: ...
    @property
    def path(self) -> Path | str: ...
    @property
    def positioned(self) -> bool: ...
    def __len__(self) -> int: ...
    def _facts(self) -> dict[str, Any]: ...
    def _read(self, wanted: _Wanted, names: list[str] | None, terms: _Terms) -> npt.NDArray[np.uint8]: ...
    def _count(self, wanted: _Wanted, terms: _Terms) -> int: ...
    def _statistics(self, wanted: _Wanted, terms: _Terms) -> tuple[int, list[tuple[int, float, float, float] | None]]: ...
    def _nearest(
        self, places: npt.NDArray[np.float64], most: int, radius: float, memory: int, terms: _Terms
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
    def _write(self, out: Any, wanted: _Wanted, names: list[str] | None, terms: _Terms) -> int: ...
    def _raster(self, out: Any, step: str, filter: str | None, memory: int, terms: _Terms) -> list[int]: ...

def is_points(path: Any) -> bool: ...
def build_point_files(paths: list[Any], out: Any, given: _PointTerms, terms: _Terms) -> tuple[int, int]: ...
def build_point_array(
    places: npt.NDArray[np.float64], columns: list[tuple[str, str, npt.NDArray[np.uint8]]], out: Any, given: _PointTerms, terms: _Terms
) -> tuple[int, int]: ...
def is_tree(path: Any) -> bool: ...
def is_feature_file(path: Any) -> bool: ...
def build_files(
    paths: list[Any], meshes: list[dict[str, Any]], out: Any, options: dict[str, Any], terms: _Terms
) -> None: ...
def object_contacts(paths: list[Any], snap: float | None, memory: int, terms: _Terms) -> list[_Contact]: ...
def build_brep(
    paths: list[Any], meshes: list[dict[str, Any]], out: Any, options: dict[str, Any], terms: _Terms
) -> dict[str, Any]: ...
def transform(
    path: Any,
    steps: list[str],
    out: Any,
    resampling: str | None,
    allow_ballpark: bool,
    moves: bool,
    of_model: tuple[float | None, str | None],
    memory: int,
    packing: _Packing,
    terms: _Terms,
) -> dict[str, Any]: ...
def combine(
    operation: str,
    paths: list[Any],
    out: Any,
    prefer_second: bool,
    fill: float | None,
    within: list[float] | None,
    margin: int | None,
    features: list[tuple[int, dict[str, Any]]],
    memory: int,
    packing: _Packing,
    terms: _Terms,
) -> dict[str, Any]: ...
def combine_polygons(
    operation: str,
    paths: list[Any],
    out: Any,
    filter: str | None,
    within: list[float] | str | None,
    snap: float | None,
    memory: int,
    terms: _Terms,
) -> dict[str, Any]: ...
def cross(first: Any, second: Any, terms: _Terms) -> list[tuple[list[float] | None, list[float] | None, int]]: ...
def diff(first: Any, second: Any, ranges: bool, terms: _Terms) -> tuple[list[int], npt.NDArray[np.uint64] | None]: ...
def verify(path: Any, quick: bool, memory: int, terms: _Terms) -> list[tuple[str, str]]: ...
def add_layer(
    path: Any,
    tree: Any,
    name: str,
    steps: list[str],
    note: tuple[int | None, str, str],
    memory: int,
    packing: _Packing,
    terms: _Terms,
) -> int | None: ...
def drop_layer(
    path: Any, name: str, note: tuple[int | None, str, str], memory: int, terms: _Terms
) -> int | None: ...
def convert(path: Any, out: Any, share: bool, memory: int, packing: _Packing, terms: _Terms) -> None: ...
def set_cache_memory(bytes: int) -> None: ...
def blame(path: Any, out: Any, memory: int, packing: _Packing, terms: _Terms) -> None: ...
def compact(
    path: Any,
    out: Any,
    keep: int,
    commits: list[int] | None,
    share: bool,
    pack: str | None,
    memory: int,
    terms: _Terms,
) -> list[dict[str, Any]]: ...
def recover(path: Any, to: int, terms: _Terms) -> dict[str, Any]: ...
def log(path: Any) -> list[dict[str, Any]]: ...
