"""Native part of the package."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, final

import numpy as np
import numpy.typing as npt
from typing_extensions import disjoint_base

from ._types import Array

version: str

_Tell = Callable[[int, int], object] | None

@disjoint_base
class Tree:
    def __new__(cls, path: Any, view: list[str], commit: int | None, positioned: bool) -> Tree: ...
    def close(self) -> None: ...
    @property
    def closed(self) -> bool: ...
    def refresh(self) -> bool: ...
    def check_unchanged(self) -> None: ...
    @property
    def path(self) -> Path: ...
    @property
    def view(self) -> list[str]: ...
    @property
    def positioned(self) -> bool: ...
    @property
    def commit(self) -> int | None: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...
    @property
    def count(self) -> int: ...
    @property
    def depth(self) -> int: ...
    def _shape_at(self, level: int | None) -> list[int]: ...
    @property
    def _frame(self) -> list[list[float]]: ...
    @property
    def _world_box(self) -> list[list[float]]: ...
    @property
    def crs(self) -> str | None: ...
    @property
    def nodata(self) -> float | None: ...
    @property
    def fill_value(self) -> float: ...
    @property
    def _missing(self) -> float | None: ...
    def _facts(self) -> dict[str, Any]: ...
    def read(
        self,
        bands: int | list[int] | tuple[int, ...] | None = None,
        *,
        window: Any = None,
        bbox: Any = None,
        level: int | None = None,
        out_shape: tuple[int, ...] | None = None,
        exact: bool = False,
        masked: bool = False,
        fill: float | None = None,
        boundless: bool = False,
        out: Array | None = None,
    ) -> Array: ...
    def __getitem__(self, key: Any, /) -> Any: ...
    def _at_index(self, level: int | None, key: Any) -> Any: ...
    def _sample_points(
        self, points: npt.NDArray[np.float64], level: int | None, in_cells: bool, fill: float | None
    ) -> tuple[Array, npt.NDArray[np.bool_]]: ...
    def _statistics(self, window: Any = None, bbox: Any = None) -> dict[str, Any]: ...
    def _mapped(self, window: Any = None, bbox: Any = None, level: int | None = None) -> Array | None: ...
    def _zones(
        self, documents: list[str], by_area: bool, progress: Any = None
    ) -> list[tuple[float, float, list[tuple[float, float, float, float, float]], list[tuple[float, float]]]]: ...
    def _count_bins(
        self, bins: int, low: float, high: float, window: Any = None, bbox: Any = None
    ) -> npt.NDArray[np.uint64]: ...
    def _find_blocks(
        self,
        condition: str,
        number: float,
        window: Any = None,
        bbox: Any = None,
        limit: int | None = None,
        largest: int | None = None,
    ) -> tuple[list[str], npt.NDArray[np.uint8], npt.NDArray[np.int64], npt.NDArray[np.float64]]: ...
    def _measure(self, level: int | None, surface: bool, progress: _Tell) -> dict[str, Any]: ...
    def _cast_rays(
        self,
        origins: npt.NDArray[np.float64],
        directions: npt.NDArray[np.float64],
        level: int | None,
        smooth: bool,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64]]: ...
    def _slice_across(
        self, across: int, at: float, world: bool, level: int | None, masked: bool, fill: float | None
    ) -> Array: ...
    def _surface_arrays(
        self, level: int | None, smooth: bool, progress: _Tell
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]: ...
    def _write_mesh(
        self, path: Any, level: int | None, smooth: bool, triangles: bool, progress: _Tell
    ) -> tuple[int, int]: ...
    def _write_render(
        self,
        path: Any,
        size: tuple[int, int],
        direction: tuple[float, float],
        level: int | None,
        zoom: float,
        orthographic: bool,
        up: str,
        background: tuple[int, int, int] | None,
        samples: int,
        progress: _Tell,
    ) -> int: ...
    def _write_window(
        self,
        path: Any,
        window: Any,
        bbox: Any,
        level: int | None,
        shape: tuple[int, int] | None,
        exact: bool,
        nodata: float | None,
        range: tuple[float, float] | None,
        progress: _Tell,
    ) -> None: ...

@final
class Editor:
    def __new__(cls, path: Any, memory: int) -> Editor: ...
    def paste(
        self, patch: Any, steps: list[str], at: list[int] | None, where_valid: bool, progress: _Tell
    ) -> None: ...
    def fill(
        self,
        value: list[float] | None,
        window: Any,
        bbox: Any,
        polygon: list[list[tuple[float, float]]] | None,
        block: str | None,
        progress: _Tell,
    ) -> None: ...
    def set(
        self, cells: npt.NDArray[np.int64], values: npt.NDArray[np.float64] | None, progress: _Tell
    ) -> None: ...
    def combine(self, operation: str, other: Any, progress: _Tell) -> None: ...
    def revert(self, commit: int) -> None: ...
    def commit(self, message: str, author: str, time: int | None) -> dict[str, Any] | None: ...
    def close(self) -> None: ...

def build_array(
    read: Callable[[list[int], list[int]], tuple[Array, npt.NDArray[np.bool_] | None]],
    out: Any,
    options: dict[str, Any],
    progress: _Tell,
) -> None: ...
def build_files(paths: list[Any], out: Any, options: dict[str, Any], progress: _Tell) -> None: ...
def transform(
    path: Any, steps: list[str], out: Any, nearest: bool, moves: bool, memory: int, progress: _Tell
) -> dict[str, Any]: ...
def combine(
    operation: str,
    paths: list[Any],
    out: Any,
    prefer_second: bool,
    fill: float | None,
    within: list[float] | None,
    margin: int | None,
    memory: int,
    progress: _Tell,
) -> dict[str, Any]: ...
def cross(first: Any, second: Any) -> list[tuple[list[float] | None, list[float] | None, int]]: ...
def diff(first: Any, second: Any, ranges: bool) -> tuple[list[int], npt.NDArray[np.uint64] | None]: ...
def verify(path: Any, quick: bool, memory: int, progress: _Tell) -> list[tuple[str, str]]: ...
def publish(path: Any, out: Any, share: bool, memory: int, progress: _Tell) -> None: ...
def compact(
    path: Any, out: Any, keep: int, commits: list[int] | None, share: bool, memory: int, progress: _Tell
) -> list[dict[str, Any]]: ...
def recover(path: Any, to: int, progress: _Tell) -> dict[str, Any]: ...
def log(path: Any) -> list[dict[str, Any]]: ...
