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
    properties: dict[str, Any] = {}
    said, nodata = dict(about), common["nodata"]
    shared = dict(common)
    if hasattr(source, "data_vars"):
        source = one_array(source)
    if is_rasterio(source):
        source = RasterioArray(source)
    if isinstance(source, RasterioArray):
        properties = source.properties()
    elif hasattr(source, "dims") and hasattr(source, "coords"):
        from .xarray import described

        properties = described(source)
        source = source.variable
    if properties:
        kind, rule = shared["kind"], shared["rule"]
        if nodata is not None:
            properties["void_number"] = None
        nodata = properties["nodata"] if nodata is None else nodata
        if kind is None or kind == properties["kind"]:
            kind, rule = properties["kind"], rule or properties["rule"]
        elif np.dtype(source.dtype).kind == "f":
            properties["dtype"] = None
        shared |= {"kind": kind, "rule": rule, "nodata": nodata, "crs": shared["crs"] or crs_text(properties["crs"])}
        said["dims"] = said["dims"] or properties["dims"]
        for name in ("transform", "categories", "colormap", "descriptions", "units", "scales", "offsets"):
            said[name] = properties[name] if said[name] is None else said[name]
        said["tags"] = {**properties["tags"], **(said["tags"] or {})}
    array = Blocks(source, said["dims"], said["shape"], said["dtype"], said["mask"], nodata, properties)
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
        "void_number": properties.get("void_number"),
        "alpha": properties.get("alpha"),
        "categories": dict(said["categories"] or {}),
        "colormap": colours_of(said["colormap"]),
        "descriptions": strings_of(said["descriptions"]) or [],
        "scale_offset": pairs_of(said["scales"], said["offsets"], (1.0,) * array.channels, (0.0,) * array.channels) or [],
        "units": strings_of(said["units"]) or [],
        "tags": dict(said["tags"] or {}),
        "seen": properties.get("seen"),
    }
    check_bands(options, array.channels)
    return array, options


def strings_of(strings: Any) -> list[str] | None:
    return None if strings is None else [text or "" for text in strings]


def pairs_of(
    scales: Any, offsets: Any, usual_scales: Any, usual_offsets: Any
) -> list[tuple[float, float]] | None:
    """Returns scales and offsets by band; nothing if neither is given."""
    if scales is None and offsets is None:
        return None
    scales, offsets = usual_scales if scales is None else scales, usual_offsets if offsets is None else offsets
    if len(scales) != len(offsets):
        raise ValueError(f"scales, offsets: got {len(scales)} and {len(offsets)}, expected as many of each")
    return [(float(scale), float(offset)) for scale, offset in zip(scales, offsets)]


def check_bands(options: dict[str, Any], bands: int) -> None:
    for name in ("descriptions", "scale_offset", "units"):
        if options[name] is not None and len(options[name]) not in (0, bands):
            raise ValueError(f"{name}: got {len(options[name])}, expected one for each of {bands} bands")


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
    raise TypeError(f"crs: expected a string, a number or an object with a definition, got {crs!r}")


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
        raise ValueError("colormap: expected values from 0 to 65535")
    colours = [[0, 0, 0, 0] for _ in range(max(colormap) + 1)]
    for value, colour in colormap.items():
        channels = [int(channel) for channel in colour]
        if len(channels) not in (3, 4) or not all(0 <= channel <= 255 for channel in channels):
            raise ValueError(f"colormap: got {colour!r}, expected red, green, blue and optionally opacity, 0 to 255")
        colours[value] = channels if len(channels) == 4 else [*channels, 255]
    return colours
