"""Properties of an array, from arguments and from the array itself, for the native module."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ._blocks import Blocks
from ._sources import RasterioArray, is_rasterio, one_array


def array_options(source: Any, common: Mapping[str, Any], about: Mapping[str, Any]) -> tuple[Blocks, dict[str, Any]]:
    """Returns the blocks of an array and its properties. `common` and `about` are arguments of
    `spinney.build`, which take precedence over the array's own properties.
    """
    told: dict[str, Any] = {}
    said, nodata = dict(about), common["nodata"]
    shared = dict(common)
    if hasattr(source, "data_vars"):
        source = one_array(source)
    if is_rasterio(source):
        source = RasterioArray(source)
    if isinstance(source, RasterioArray):
        told = source.told()
    elif hasattr(source, "dims") and hasattr(source, "coords"):
        from .xarray import described

        told = described(source)
        source = source.variable
    if told:
        kind, rule = shared["kind"], shared["rule"]
        if nodata is not None:
            told["void_number"] = None
        nodata = told["nodata"] if nodata is None else nodata
        if kind is None or kind == told["kind"]:
            kind, rule = told["kind"], rule or told["rule"]
        elif np.dtype(source.dtype).kind == "f":
            told["dtype"] = None
        shared |= {"kind": kind, "rule": rule, "nodata": nodata, "crs": shared["crs"] or crs_text(told["crs"])}
        said["dims"] = said["dims"] or told["dims"]
        for name in ("transform", "categories", "colormap", "descriptions", "units", "scales", "offsets"):
            said[name] = told[name] if said[name] is None else said[name]
        said["tags"] = {**told["tags"], **(said["tags"] or {})}
    array = Blocks(source, said["dims"], said["shape"], said["dtype"], said["mask"], nodata, told)
    if array.is_solid:
        shared["rule"] = shared["rule"] or "occupancy"
    elif array.is_mask:
        shared["kind"] = shared["kind"] or "categorical"
    options: dict[str, Any] = shared | {
        "extent": array.extent,
        "octree": array.axes == 3,
        "dtype": array.dtype.name,
        "channels": array.channels,
        "in_order": array.in_order,
        "transform": None if said["transform"] is None else numbers_of(said["transform"]),
        "void_number": told.get("void_number"),
        "alpha": told.get("alpha"),
        "categories": dict(said["categories"] or {}),
        "colormap": colours_of(said["colormap"]),
        "descriptions": texts_of(said["descriptions"]) or [],
        "scale_offset": pairs_of(said["scales"], said["offsets"], (1.0,) * array.channels, (0.0,) * array.channels) or [],
        "units": texts_of(said["units"]) or [],
        "tags": dict(said["tags"] or {}),
        "seen": told.get("seen"),
    }
    check_bands(options, array.channels)
    return array, options


def texts_of(texts: Any) -> list[str] | None:
    return None if texts is None else [text or "" for text in texts]


def pairs_of(
    scales: Any, offsets: Any, usual_scales: Any, usual_offsets: Any
) -> list[tuple[float, float]] | None:
    """Returns scales and offsets by band; nothing if neither is given."""
    if scales is None and offsets is None:
        return None
    scales, offsets = usual_scales if scales is None else scales, usual_offsets if offsets is None else offsets
    if len(scales) != len(offsets):
        raise ValueError(f"scales and offsets: {len(scales)} and {len(offsets)} given")
    return [(float(scale), float(offset)) for scale, offset in zip(scales, offsets)]


def check_bands(options: dict[str, Any], bands: int) -> None:
    for name in ("descriptions", "scale_offset", "units"):
        if options[name] is not None and len(options[name]) not in (0, bands):
            raise ValueError(f"{name}: {len(options[name])} given, there are {bands} bands")


def crs_text(crs: Any) -> str | None:
    """Returns the definition of a coordinate system, from a string or an object of rasterio or
    pyproj.
    """
    if crs is None or isinstance(crs, str):
        return crs
    if isinstance(crs, int):
        return f"EPSG:{crs}"
    number = crs.to_epsg() if hasattr(crs, "to_epsg") else None
    if number is not None:
        return f"EPSG:{number}"
    if hasattr(crs, "to_wkt"):
        return str(crs.to_wkt())
    raise TypeError(f"crs: expected text, a number or an object with a definition, got {crs!r}")


def numbers_of(transform: Any) -> list[float]:
    """Returns six numbers, or those of a matrix's three rows."""
    numbers = np.asarray(transform, dtype=float)
    if numbers.ndim == 1 and len(numbers) == 9:
        # (`affine.Affine` iterates over 9 numbers, of which the last row is constant.)
        numbers = numbers[:6]
    if numbers.shape == (4, 4):
        numbers = numbers[:3]
    if numbers.shape not in ((6,), (3, 4)):
        raise ValueError(f"transform: expected six numbers, or a matrix of 3 x 4 or 4 x 4, got {transform!r}")
    return [float(number) for number in numbers.ravel()]


def colours_of(colormap: Any) -> list[list[int]] | None:
    if not colormap:
        return None
    if not 0 <= min(colormap) <= max(colormap) < 65536:
        raise ValueError("colormap: values are 0 to 65535")
    colours = [[0, 0, 0, 0] for _ in range(max(colormap) + 1)]
    for value, colour in colormap.items():
        channels = [int(channel) for channel in colour]
        if len(channels) not in (3, 4) or not all(0 <= channel <= 255 for channel in channels):
            raise ValueError(f"colormap: {colour!r}, expected red, green, blue and perhaps opacity, 0 to 255")
        colours[value] = channels if len(channels) == 4 else [*channels, 255]
    return colours
