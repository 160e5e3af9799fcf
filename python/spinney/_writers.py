"""Exports of trees to other formats, and renderings and meshes of them."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from operator import index
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _native
from ._options import refuse
from ._progress import memory_of, working
from ._properties import Properties
from ._show import shown, title_of
from ._remote import path_of
from ._types import Coordinates, Mesh, Path, Progress, Resampling, Style, Window


class Writers(Properties):
    """Export methods of a dataset."""

    def save(
        self,
        path: Path,
        *,
        window: Window | None = None,
        coordinates: Coordinates = None,
        level: int | None = None,
        shape: tuple[int, int] | None = None,
        exact: bool = False,
        nodata: float | None = None,
        range: tuple[float, float] | None = None,
        style: Style | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> None:
        """Writes a region as an image or array file (.png, .webp, .tif, .exr, .npy, .raw, in
        octrees .nrrd), as `spinney get` does.

        `shape` is the rows and columns of the result, `range` the numbers that become black and
        white in images, `style` a style's name ("viridis", "terrain", "hillshade", "relief" ...),
        its document as a dictionary or JSON, or a file with it.
        """
        with working(progress, threads) as terms:
            self._write_window(path_of(path), window, coordinates, level, shape, exact, nodata, range, _style_text(style), terms)

    def mesh(self, level: int | None = None, *, smooth: bool = False, threads: int | None = None, progress: Progress = None) -> Mesh:
        """Returns the surface of an octree as triangles: the faces of cells, or with `smooth` the
        surface between them.
        """
        with working(progress, threads) as terms:
            return Mesh(*self._surface_arrays(level, smooth, terms))

    def export(
        self,
        path: Path,
        *,
        level: int | None = None,
        smooth: bool = False,
        triangles: bool = False,
        meshopt: bool = False,
        polygons: bool = False,
        classes: Sequence[float] | None = None,
        connect: Literal[4, 8] = 4,
        simplify: float | None = None,
        directions: Literal[4, 8] | None = None,
        window: Window | None = None,
        coordinates: Coordinates = None,
        tile_size: int | None = None,
        compression: Literal["deflate", "zstd", "none"] | None = None,
        nodata: float | None = None,
        zoom: int | tuple[int, int] | None = None,
        style: Style | None = None,
        tile_format: Literal["png", "webp", "jpg", "npy", "tif"] | None = None,
        png_effort: int | None = None,
        quality: int | None = None,
        resampling: Resampling | None = None,
        allow_ballpark: bool = False,
        name: str | None = None,
        attribution: str | None = None,
        resume: bool = False,
        update: Path | bool = False,
        since: Path | None = None,
        restyle: bool = False,
        part: tuple[int, int] | None = None,
        parts: Sequence[Path] | None = None,
        self_contained: bool = False,
        threads: int | None = None,
        progress: Progress = None,
    ) -> tuple[int, int] | int | None:
        """Writes a file in another format, as `spinney export` does. The format is that of the
        name.

        - .ply, .obj, .stl, .off: the surface of an octree, at a `level`, `smooth` or of its cells,
          on request only as `triangles`; returns the numbers of vertices and faces.
        - .glb and x/tileset.json: the same for viewers, as binary glTF and 3D Tiles, with `meshopt`
          compressed (EXT_meshopt_compression); returns the number of triangles.
        - .tif: a cloud-optimized GeoTIFF of a raster (`tile_size`, `compression`, `nodata`).
        - with `polygons` regions of a map of classes, as .gpkg, .fgb, .geojson, .shp, .csv or .svg:
          connected cells of one class with common edges (`connect=8`: or corners), with class,
          cells, area, name and colour; only of some `classes`, at a `level`, with borders moved by
          no more than `simplify`; returns their number.
        - .chain: the same regions as Freeman chain codes, of 4 `directions` (the default), along
          the sides of cells, or 8, from cell to cell; returns the number of regions.
        - .html: a page that shows the file in a browser, in a `style` and with a `name`. Its own
          files are in a directory next to it, with a copy of the data; with `self_contained` it is
          one file. Returns the number of files.
        - .pmtiles, .mbtiles and patterns such as "map/{z}/{x}/{y}.png": web map tiles, of some
          zooms (`zoom=(0, 6)`), of a region, in a `style` (see `save`); returns their number. A
          cancelled export leaves no partial output or, with `resume`, what the next one continues
          from. `update` redraws only those tiles of an older commit's export that edits have
          touched: `ds.export("map.pmtiles", update=True)`. `update="old.pmtiles"` copies the rest
          from another archive; `since` is the file that the tiles were made from, if it is not a
          commit of the same file. Colours keep the percentile values of that export, unless
          `restyle` redraws all tiles. Several processes can share one export: each writes a `part`
          to an archive, `(3, 64)` being number 3 of 64, from 0. The archives of all `parts` are
          then merged into the tiles, with the bytes of an export in a single process
          (`spinney.dask.export_tiles` does both).

        A warning lists what the format cannot store, such as colours, values, the coordinate system
        or the unit of length. Options of other formats than that of the name raise TypeError.
        """
        to = path_of(path)
        of_tiles = {
            "zoom": (zoom, zoom) if isinstance(zoom, int) else zoom,
            "style": _style_text(style),
            "tile_format": tile_format,
            "png_effort": png_effort,
            "quality": quality,
            "resampling": resampling,
            "name": name,
            "attribution": attribution,
            "update": update or None,
            "since": None if since is None else path_of(since),
            "restyle": restyle or None,
            "part": part,
            "parts": parts,
        }
        of_surfaces = {"level": level, "smooth": smooth or None, "triangles": triangles or None, "meshopt": meshopt or None}
        of_cog = {"compression": compression, "nodata": nodata}
        only_tiles = of_tiles | {"window": window, "resume": resume or None, "allow_ballpark": allow_ballpark or None}
        of_polygons = {"classes": classes, "connect": None if connect == 4 else connect, "simplify": simplify}
        of_others = {"smooth": smooth or None, "triangles": triangles or None, "meshopt": meshopt or None, "tile_size": tile_size}
        with working(progress, threads) as terms:
            if polygons:
                refuse("chain codes", {"directions": directions})
                refuse("other files than polygons", of_others | of_cog | only_tiles)
                return self._write_polygons(to, None if classes is None else list(classes), connect, simplify, level, terms)
            if to.lower().endswith(".chain"):
                refuse("other files than chain codes", of_others | of_cog | only_tiles)
                refuse("polygons", {"simplify": simplify})
                return self._write_chain_code(to, None if classes is None else list(classes), connect, directions or 4, level, terms)
            refuse("polygons", of_polygons)
            refuse("chain codes", {"directions": directions})
            if to.lower().endswith((".html", ".htm")):
                refuse("other files than pages", of_others | of_cog | only_tiles | {"style": None, "name": None})
                path, start = self._page_start(style)
                return _native.write_page(path, to, name or title_of(path), start, self_contained, terms)
            refuse("pages", {"self_contained": self_contained or None})
            if self._is_tiles(to):
                refuse("solids and GeoTIFF", of_surfaces | of_cog)
                if not update and (since is not None or restyle):
                    raise ValueError("since, restyle: are for an update")
                if update and resume:
                    raise ValueError("update, resume: got both, expected one of them")
                old = None if isinstance(update, bool) else path_of(update)
                options = of_tiles | {"tile_size": tile_size, "allow_ballpark": allow_ballpark, "resume": resume}
                if update and (part is not None or parts is not None):
                    raise ValueError("update, part, parts: an update is of all tiles")
                names = [path_of(archive) for archive in parts or []]
                options |= {"update": bool(update), "old": old, "restyle": restyle, "parts": names}
                return self._write_tiles(to, window, coordinates, options, terms)
            refuse("tiles", only_tiles)
            if to.lower().endswith((".tif", ".tiff")):
                refuse("solids", of_surfaces)
                self._write_cog(to, tile_size, compression, nodata, terms)
                return None
            refuse("rasters", of_cog | {"tile_size": tile_size})
            if to.lower().endswith(".glb") or os.path.basename(to) == "tileset.json":
                refuse("meshes of other formats; glTF always has triangles", {"triangles": triangles or None})
                return self._write_gltf(to, level, smooth, meshopt, terms)
            refuse("meshes of other formats than glTF", {"meshopt": meshopt or None})
            return self._write_mesh(to, level, smooth, triangles, terms)

    def show(self, *, style: Style | None = None, height: int = 500) -> Any:
        """Displays the file in a notebook: the page that `export` writes. The kernel reads the file
        for it (with the package anywidget).

        A polygon drawn on the page is available in Python: `page.polygon` is GeoJSON in coordinates
        of `page.crs`, `page.statistics` are the statistics on the page; `ds.zonal([page.polygon],
        crs=page.crs, edge="area")` returns the same.
        """
        path, start = self._page_start(style)
        return shown(path, start, height)

    def _page_start(self, style: Style | None) -> tuple[str, dict[str, Any]]:
        """Returns the file, and the initial state of a page."""
        if self.view:
            raise ValueError("a page shows an unmodified file; write this view to a file first, with transform")
        start = {"layer": self.layer or None, "commit": self.commit, "style": _style_text(style)}
        return os.fspath(self.path), start

    def contours(
        self,
        path: Path,
        at: float | Sequence[float] | None = None,
        *,
        every: float | None = None,
        base: float = 0.0,
        filled: bool = False,
        level: int | None = None,
        ends: Literal["open", "extend", "close"] = "open",
        smooth: int = 0,
        has_z: bool = False,
        memory: int | str = "256M",
        max_bytes: int | str | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> int:
        """Writes contours of the first band as features (.geojson, .csv, .svg, .gpkg, .fgb, .shp,
        .obj, .ply), in octrees isosurfaces as a mesh (.ply, .obj, .stl, .off); returns the number
        of lines, polygons or triangles.

        Contours are at the values `at`, or at an interval of `every`, counted from `base`. With
        `filled` they are the areas between these values. Lines `ends` at VOID (`"open"`),
        `"extend"` to the edge of the last cells or `"close"` along it. `smooth` is the number of
        rounds of corner cutting; with `has_z` points have the value as their third coordinate. An
        output larger than `max_bytes` raises OSError, and leaves no partial output.
        """
        options = {
            "at": None if at is None else [float(value) for value in np.atleast_1d(np.asarray(at, dtype=float))],
            "every": every,
            "base": base,
            "filled": filled,
            "level": level,
            "ends": ends,
            "smooth": smooth,
            "has_z": has_z,
            "memory": memory_of(memory),
        }
        with working(progress, threads, max_bytes) as terms:
            return self._write_contours(path_of(path), options, terms)

    def legend(
        self,
        out: Path,
        style: Style | None = None,
        *,
        scale: int = 2,
        threads: int | None = None,
        progress: Progress = None,
    ) -> None:
        """Writes the legend of a style, the meaning of its colours, as an image (.png, .svg) or for
        programs (.json), as `spinney legend` does: `ds.legend("legend.png", "terrain")`. The
        default `style` (see `save`) is the tree's own. `scale` enlarges a .png, 1 to 8 times.
        """
        if not 1 <= index(scale) <= 8:
            raise ValueError(f"scale: got {scale}, expected 1 to 8")
        with working(progress, threads) as terms:
            self._write_legend(path_of(out), _style_text(style), index(scale), terms)

    def render(
        self,
        path: Path | None = None,
        *,
        size: tuple[int, int] = (1024, 768),
        azimuth: float = 215.0,
        elevation: float = 30.0,
        level: int | None = None,
        scale: float = 1.0,
        orthographic: bool = False,
        up: Literal["y", "z"] = "z",
        background: tuple[int, int, int] | None = (255, 255, 255),
        samples: int = 2,
        threads: int | None = None,
        progress: Progress = None,
    ) -> npt.NDArray[np.uint8] | None:
        """Renders an octree's solid as a shaded image: an array of rows, columns and colours, or a
        file if `path` is given.

        `size` is columns and rows; the viewer is at compass direction `azimuth` (0 is north, along
        y), `elevation` degrees above the horizon. Without a background the image has opacity as a
        fourth channel.
        """
        with working(progress, threads) as terms, tempfile.TemporaryDirectory(prefix="spinney-") as directory:
            to = os.path.join(directory, "image.npy") if path is None else path_of(path)
            direction = (azimuth, elevation)
            self._write_render(
                to, size, direction, level, scale, orthographic, up, background, samples, terms
            )
            if path is not None:
                return None
            image: npt.NDArray[np.uint8] = np.load(to)
            return image


def _style_text(style: Style | None) -> str | None:
    """Returns a style as the program accepts it."""
    if style is None or isinstance(style, str):
        return style
    return json.dumps(dict(style)) if isinstance(style, Mapping) else path_of(style)
