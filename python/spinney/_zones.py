"""Queries for the cells in polygons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, overload

from ._features import Edge, features_over
from ._files import MEMORY
from ._options import names_of
from ._progress import memory_of, working
from ._remote import path_of
from ._types import Path, Progress, ZoneStatistics
from ._writers import Writers
from ._zonal import definition_of, documents_of, is_frame, measures_of, named, table_of, values_of, zone_of


class Zones(Writers):
    """Zonal queries of a dataset."""

    #: Whether it is an error if all polygons are outside. (On a cluster, they may be a subset of
    #: many.)
    _outside_is_error = True

    @overload
    def zonal(
        self,
        geometries: Any,
        measures: None = None,
        *,
        quantiles: float | Sequence[float] = (),
        edge: Edge = "centre",
        crs: Any = None,
        where: Mapping[str, Any] | str | None = None,
        memory: int | str = MEMORY,
        layers: None = None,
        out: None = None,
        attribute: None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> list[ZoneStatistics]: ...

    @overload
    def zonal(
        self,
        geometries: Any,
        measures: str | Sequence[str],
        *,
        quantiles: float | Sequence[float] = (),
        edge: Edge = "centre",
        crs: Any = None,
        where: Mapping[str, Any] | str | None = None,
        memory: int | str = MEMORY,
        layers: None = None,
        out: None = None,
        attribute: None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> list[dict[str, Any]]: ...

    @overload
    def zonal(
        self,
        geometries: Any,
        measures: None = None,
        *,
        quantiles: float | Sequence[float] = (),
        edge: Edge = "centre",
        crs: Any = None,
        where: Mapping[str, Any] | str | None = None,
        memory: int | str = MEMORY,
        layers: Sequence[str],
        out: None = None,
        attribute: None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> dict[str, list[ZoneStatistics]]: ...

    @overload
    def zonal(
        self,
        geometries: Any,
        measures: str | Sequence[str],
        *,
        quantiles: float | Sequence[float] = (),
        edge: Edge = "centre",
        crs: Any = None,
        where: Mapping[str, Any] | str | None = None,
        memory: int | str = MEMORY,
        layers: Sequence[str],
        out: None = None,
        attribute: None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> dict[str, list[dict[str, Any]]]: ...

    @overload
    def zonal(
        self,
        geometries: Any,
        measures: str | Sequence[str] | None = None,
        *,
        quantiles: float | Sequence[float] = (),
        edge: Edge = "centre",
        crs: Any = None,
        where: Mapping[str, Any] | str | None = None,
        memory: int | str = MEMORY,
        layers: Sequence[str] | None = None,
        out: Path,
        attribute: str | Sequence[str] | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> int: ...

    def zonal(
        self,
        geometries: Any,
        measures: str | Sequence[str] | None = None,
        *,
        quantiles: float | Sequence[float] = (),
        edge: Edge = "centre",
        crs: Any = None,
        where: Mapping[str, Any] | str | None = None,
        memory: int | str = MEMORY,
        layers: Sequence[str] | None = None,
        out: Path | None = None,
        attribute: str | Sequence[str] | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> Any:
        """Returns statistics of the cells in each of many polygons. The tree is read only along the
        polygons' edges.

        Geometries are polygons (also with holes and several outer rings): anything with a
        `__geo_interface__` (of shapely, a GeoDataFrame, ...), GeoJSON as dictionaries, the path of
        a feature file (GeoJSON, GeoPackage, also `x.gpkg:LAYER`, FlatGeobuf, shapefile, CSV), or a
        list of such. They are transformed to the tree's coordinate system from their own (a
        GeoDataFrame's `crs`, a file's own; features of GeoJSON are in degrees unless a member `crs`
        says otherwise; bare geometries are in the tree's own), or from `crs`, if given:
        "EPSG:4326", WKT, a pyproj object, or "world" for the tree's own. If all polygons lie
        outside of the tree, that is an error. Cells at edges count fully if their `"centre"` is
        inside or if they `"touch"` the polygon, or by the exact share of their `"area"` that is
        inside. `where` selects features by attribute values: `{"kind": "lake", "code": 2}`, or by
        conditions that must all hold: `"kind!=lake,code>=2"`. The features of a file must fit into
        `memory`; values that do not fit into it go to temporary files.

        With the names of some `measures` (one, a list, or several in a string, `"min mean"`;
        "count", "void", "void_share", "outside", "sum", "min", "max", "mean", "std", "majority",
        "minority", "variety", "median", "classes") the result is a dictionary of these for each
        polygon, of the first band, and of `quantiles`, from 0 to 1, by names such as "q10" for 0.1.
        Quantiles are those of `numpy.quantile`, weighted by the cells' shares. "majority",
        "minority", "variety", "median" and quantiles need all values of a polygon, which are read
        unless the file counts classes; without names they are in `ZoneBand.values` if there are
        `quantiles`.

        For a GeoDataFrame, or another frame with a `__geo_interface__`, the result is a pandas
        DataFrame with its index: a column for each measure and quantile, and for the cells of each
        class. The default columns are count, void, sum, min, max, mean and std, or count, void and
        classes for files that count classes.

        With names of `layers` (`ds.names` lists all) the result is a mapping of each name to its
        list (or table); `ds[name].time` is a layer's acquisition time. The polygons' cells are
        found once, so that a hundred layers cost little more than reading their cells.

        With `out`, a file by its name's ending (.gpkg, .fgb, .geojson, .csv, .shp, .svg), the
        features are written there unchanged, with their ids and attributes (or only those in
        `attribute`), joined with the results of all bands, as by `spinney stats --zones -o`;
        returns the number of features. A file can then have any number of features, which are read
        in batches that fit into `memory`, and features that are not polygons are kept, without
        cells. A warning lists what the format cannot store.
        """
        if isinstance(layers, str):
            raise TypeError("layers: expected a list of names, such as ds.names")
        names, levels = measures_of(measures, quantiles)
        if is_frame(geometries) and where is not None:
            raise ValueError("where: is for files; select rows of the frame beforehand, as in frame[frame.kind == 'lake']")
        if out is not None:
            return self._write_joined(geometries, (names, levels), edge, crs, where, memory, layers, (out, attribute), (progress, threads))
        if attribute is not None:
            raise TypeError("attribute: is for out=, whose features have attributes")
        with working(progress, threads) as terms:
            documents = documents_of(geometries, None if crs is None else definition_of(crs))
            chosen = where if isinstance(where, str) else values_of(where)
            query = (chosen, memory_of(memory), names, levels)
            found = self._zones(documents, edge, query, None if layers is None else list(layers), self._outside_is_error, terms)
        statistics = [[zone_of(zone, levels) for zone in zones] for zones in found]

        def result_of(zones: list[ZoneStatistics]) -> Any:
            rows: Any = zones if measures is None or (is_frame(geometries) and not names) else named(zones, names, levels)
            return table_of(geometries, rows, names, levels) if is_frame(geometries) else rows

        return result_of(statistics[0]) if layers is None else {layer: result_of(zones) for layer, zones in zip(layers, statistics)}

    def _write_joined(
        self,
        geometries: Any,
        query: tuple[list[str], list[float]],
        edge: Edge,
        crs: Any,
        where: Mapping[str, Any] | str | None,
        memory: int | str,
        layers: Sequence[str] | None,
        written: tuple[Path, str | Sequence[str] | None],
        terms: tuple[Progress, int | None],
    ) -> int:
        """Writes features with their statistics."""
        (out, attribute), (progress, threads) = written, terms
        coordinates = None if crs is None else definition_of(crs)
        chosen = where if isinstance(where, str) else values_of(where)
        with features_over(geometries, coordinates=coordinates) as statistics, working(progress, threads) as work:
            return self._write_zones(
                (statistics["path"], statistics["coordinates"]),
                edge,
                (chosen, memory_of(memory), *query),
                None if attribute is None else names_of(attribute),
                None if layers is None else list(layers),
                path_of(out),
                work,
            )
