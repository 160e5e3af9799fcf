"""Objects of other packages as input of builds."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ._remote import is_path, path_of
from ._types import Array, Path
from ._zonal import documents_of


def paths_of(source: Any) -> list[str] | None:
    """Returns file names, if the source is one or several paths."""
    if is_path(source):
        return [path_of(source)]
    if isinstance(source, list | tuple) and source and all(map(is_path, source)):
        return [path_of(path) for path in source]
    return None


def is_rasterio(source: Any) -> bool:
    """Returns whether an object is an open rasterio dataset."""
    return all(hasattr(source, name) for name in ("indexes", "read", "profile", "dtypes"))


class RasterioArray:
    """Bands of a rasterio dataset, read block by block: all, or those with given indices from 0.
    Its masks define VOID.
    """

    def __init__(self, dataset: Any, bands: Sequence[int] | None = None) -> None:
        self.dataset = dataset
        self.bands = list(range(dataset.count) if bands is None else bands)
        self.shape = (len(self.bands), dataset.height, dataset.width)
        types = [str(dataset.dtypes[band]) for band in self.bands]
        self.dtype = np.dtype(types[0])
        if len(set(types)) > 1:
            raise TypeError(f"source: got bands of several types, {', '.join(types)}; give stack=True for a layer per band")
        every = [role.name.capitalize() for role in dataset.colorinterp]
        self.roles = [every[band] for band in self.bands]
        self.alpha = self.roles.index("Alpha") if "Alpha" in self.roles and len(self.roles) > 1 else None
        # The opacity band, unless it is among the bands: as the last one it is stored with the
        # colours before it.
        self.opacity = every.index("Alpha") if "Alpha" in every and self.roles[-1] != "Alpha" else None

    def __getitem__(self, key: tuple[slice, slice, slice]) -> Array:
        _, rows, columns = key
        window = ((rows.start, rows.stop), (columns.start, columns.stop))
        numbers = [band + 1 for band in self.bands]
        if self.opacity is None:
            masked = self.roles[-1] != "Alpha"
            found: Array = self.dataset.read(numbers, window=window, masked=masked)
            return found
        # (Masks derived from opacity do not cover the opacity band.)
        samples = self.dataset.read(numbers, window=window)
        opacity = self.dataset.read(self.opacity + 1, window=window)
        return np.ma.MaskedArray(samples, mask=np.broadcast_to(opacity == 0, samples.shape))

    def properties(self) -> dict[str, Any]:
        """Returns the dataset's properties, as arguments of `spinney.build`."""
        dataset = self.dataset
        placed = dataset.crs is not None or not dataset.transform.is_identity
        colours = dataset.colormap(self.bands[0] + 1) if self.roles == ["Palette"] else None
        descriptions, units, scales, offsets, nodata = (
            tuple(of[band] for band in self.bands)
            for of in (dataset.descriptions, dataset.units, dataset.scales, dataset.offsets, dataset.nodatavals)
        )
        scaled = set(scales) != {1.0} or set(offsets) != {0.0}
        tags = {name: text for name, text in dataset.tags().items() if name != "AREA_OR_POINT"}
        usual = [["Red", "Green", "Blue", "Alpha"][: len(self.roles)], ["Gray", "Undefined", "Undefined", "Undefined"][: len(self.roles)]]
        if self.roles not in usual and not {"Gray", "Palette", "Undefined"}.issuperset(self.roles):
            tags["colour_roles"] = ",".join(self.roles)
        lost = [what for what, there in (("ground control points", dataset.gcps[0]), ("rational polynomials", dataset.rpcs)) if there]
        if lost:
            warnings.warn(f"{dataset.name}: {' and '.join(lost)} of a rasterio dataset are not stored; build from its path", stacklevel=3)
        return {
            "dims": "byx",
            "kind": "categorical" if colours else None,
            "rule": None,
            "transform": dataset.transform if placed else None,
            "crs": dataset.crs,
            "nodata": nodata[0],
            "alpha": self.alpha,
            "categories": None,
            "colormap": colours,
            "descriptions": descriptions if any(descriptions) else None,
            "units": units if any(units) else None,
            "scales": scales if scaled else None,
            "offsets": offsets if scaled else None,
            "tags": tags,
        }


def rasterio_layers(dataset: Any) -> Iterator[tuple[str, RasterioArray]]:
    """Yields the layers of a rasterio dataset with their names: each band, or all bands together
    for a colour image.
    """
    stem = os.path.splitext(os.path.basename(str(dataset.name)))[0] or "band"
    roles = [role.name for role in dataset.colorinterp]
    if roles in (["red", "green", "blue"], ["red", "green", "blue", "alpha"], ["gray", "alpha"]) and set(dataset.dtypes) in ({"uint8"}, {"uint16"}, {"float32"}):
        yield stem, RasterioArray(dataset)
        return
    for band in range(dataset.count):
        text = str(dataset.descriptions[band] or "").split(",")[0].strip()
        yield stem if dataset.count == 1 else text or f"{stem}_{band + 1}", RasterioArray(dataset, [band])


def one_array(dataset: Any) -> Any:
    """Returns the variables of an xarray dataset as one DataArray: the only one, or several as its
    bands.
    """
    names = [name for name, array in dataset.data_vars.items() if array.ndim >= 2]
    if not names:
        raise ValueError("source: got an xarray dataset without a variable that has rows and columns")
    if len(names) == 1:
        return dataset[names[0]]
    first = dataset[names[0]]
    arrays = [dataset[name] for name in names]
    if any(array.dtype != first.dtype or array.dims != first.dims for array in arrays):
        raise ValueError(f"source: got variables of several types or axes, {', '.join(map(str, names))}; give stack=True for a layer per variable")
    about = [{**array.encoding, **array.attrs} for array in arrays]
    for key in ("_FillValue", "missing_value", "nodata", "flag_values", "flag_meanings"):
        if any(str(other.get(key)) != str(about[0].get(key)) for other in about):
            raise ValueError(f"source: got variables that differ in {key}, {', '.join(map(str, names))}; give stack=True for a layer per variable")
    made = dataset[names].to_dataarray("band")
    # Common attributes are those of the whole; some others become values per band.
    by_band = {"units": "", "scale_factor": 1.0, "add_offset": 0.0}
    alike = {key for key in first.attrs if all(str(array.attrs.get(key)) == str(first.attrs[key]) for array in arrays)}
    made.attrs = {key: first.attrs[key] for key in alike}
    for key, usual in by_band.items():
        if any(key in other for other in about):
            made.attrs[{"scale_factor": "scales", "add_offset": "offsets"}.get(key, key)] = tuple(other.get(key, usual) for other in about)
    made.attrs["long_name"] = tuple(str(array.attrs.get("long_name", name)) for name, array in zip(names, arrays))
    lost = sorted({str(key) for array in arrays for key in array.attrs if key not in alike and key not in {"long_name", *by_band}})
    if lost:
        warnings.warn(f"attributes that not all variables share are not stored: {', '.join(lost)}", stacklevel=3)
    made.encoding = {key: value for key, value in first.encoding.items() if key not in by_band}
    return made


@contextmanager
def feature_file(source: Any, out: Path) -> Iterator[tuple[str, str | None]]:
    """Yields a temporary GeoJSON file of features, in the output's directory, and the definition of
    their coordinate system if they have one.
    """
    (document, crs, _), *_ = documents_of(source)
    if crs == "world":
        # (Without a known system, coordinates are not assumed to be degrees.)
        document = json.dumps({**json.loads(document), "crs": None})
    directory = os.path.dirname(os.path.abspath(path_of(out)))
    with tempfile.NamedTemporaryFile("w", encoding="utf-8", suffix=".geojson", dir=directory) as file:
        file.write(document)
        file.flush()
        yield file.name, None if crs == "world" else crs
