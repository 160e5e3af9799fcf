#!/usr/bin/env python3
"""Tables of the EPSG registry, by pyproj: the contents of `crates/crs/src/registry/`.

    benches/peers/registry.py geodetic     # ellipsoids, prime meridians and geographic systems
    benches/peers/registry.py projected    # geographic system and axes of each one, by ranges
    benches/peers/registry.py vertical     # vertical systems

Needs pyproj (`pip install pyproj`). Run `rustfmt` on the result.
"""

import re
import sys
import warnings

import pyproj
from pyproj.database import query_crs_info
from pyproj.enums import PJType

warnings.simplefilter("ignore")
# Units of vertical systems by their registry names.
LENGTHS = {"metre": 1.0, "foot": 0.3048, "US survey foot": 1200 / 3937, "British foot (1936)": 0.3048007491}
# Axes as written in the code, by their directions.
AXES = {("east", "north"): "EastNorth", ("north", "east"): "NorthEast", ("west", "south"): "WestSouth"}


def systems(kind):
    """Returns EPSG codes below 32767 of a kind, and their systems."""
    for info in sorted(query_crs_info(auth_name="EPSG", pj_types=[kind], allow_deprecated=True), key=lambda info: int(info.code)):
        if int(info.code) < 32767:
            yield int(info.code), pyproj.CRS.from_epsg(int(info.code))


def measure(value):
    """Returns a length in metres, or an angle in degrees."""
    if isinstance(value, dict):
        factor = value["unit"]["conversion_factor"]
        return value["value"] * (round(factor / 0.017453292519943295, 12) if value["unit"]["type"] == "AngularUnit" else factor)
    return value


def esri(crs, keyword):
    """Returns Esri's name for a component."""
    try:
        found = re.search(rf'{keyword}\["([^"]+)"', crs.to_wkt("WKT1_ESRI"))
    except pyproj.exceptions.CRSError:
        return ""
    return found[1] if found else ""


def text(name):
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def own(esri_name, name):
    """Returns Esri's name, if it is not the other one with underscores."""
    return "" if esri_name == re.sub("[^A-Za-z0-9]+", "_", name).strip("_") else esri_name


def geodetic():
    ellipsoids, meridians, rows = {}, {}, []
    for number, crs in systems(PJType.GEOGRAPHIC_2D_CRS):
        definition = crs.to_json_dict()
        datum = definition.get("datum") or definition["datum_ensemble"]
        figure, meridian = datum["ellipsoid"], crs.prime_meridian
        size = measure(figure.get("radius", figure.get("semi_major_axis")))
        if "semi_minor_axis" in figure:
            inverse = size / (size - measure(figure["semi_minor_axis"]))
        else:
            inverse = figure.get("inverse_flattening", 0.0)
        code = crs.ellipsoid.to_json_dict()["id"]["code"]
        ellipsoids[code] = (figure["name"], own(esri(crs, "SPHEROID"), figure["name"]), size, inverse)
        turn = datum.get("prime_meridian", {"longitude": 0.0})["longitude"]
        zero = meridian.to_json_dict()["id"]["code"]
        meridians[zero] = (meridian.name, float(measure(turn)))
        name = datum["name"].removesuffix(" ensemble")
        datum_number = crs.datum.to_json_dict()["id"]["code"]
        esri_name = own(esri(crs, "DATUM").removeprefix("D_"), name)
        rows.append((number, definition["name"], datum_number, name, esri_name, own(esri(crs, "GEOGCS").removeprefix("GCS_"), definition["name"]), code, zero))
    print("/// Ellipsoids: number, name, Esri's name where it is another one, half axis in metres, inverse flattening (0 of spheres).")
    for code, (name, theirs, size, inverse) in sorted(ellipsoids.items()):
        print(f"({code}, {text(name)}, {text(theirs)}, {float(size)!r}, {float(inverse)!r}),")
    print("/// Prime meridians: number, name, degrees east of Greenwich.")
    for code, (name, turn) in sorted(meridians.items()):
        print(f"({code}, {text(name)}, {turn!r}),")
    print("/// Geographic systems: number, name, the datum's number, name and Esri's name, Esri's name of the system, ellipsoid, prime meridian.")
    for number, name, datum, datum_name, theirs, their_system, ellipsoid, meridian in rows:
        print(f"({number}, {text(name)}, {datum}, {text(datum_name)}, {text(theirs)}, {text(their_system)}, {ellipsoid}, {meridian}),")


def projected():
    found = []
    for number, crs in systems(PJType.PROJECTED_CRS):
        definition = crs.to_json_dict()
        axes = tuple(axis["direction"] for axis in definition["coordinate_system"]["axis"])
        base = definition["base_crs"].get("id") or {}
        if base.get("authority") == "EPSG":
            found.append((number, base["code"], AXES.get(axes, "Other")))
    ranges = []
    for number, *rest in found:
        # Unassigned numbers in between may be included.
        if ranges and ranges[-1][2] == rest:
            ranges[-1][1] = number
        else:
            ranges.append([number, number, rest])
    for first, last, (base, axes) in ranges:
        print(f"({first}, {last}, {base}, {axes}),")


def vertical():
    for number, crs in systems(PJType.VERTICAL_CRS):
        definition = crs.to_json_dict()
        datum = definition.get("datum") or definition["datum_ensemble"]
        [axis] = definition["coordinate_system"]["axis"]
        unit = axis["unit"] if isinstance(axis["unit"], str) else axis["unit"]["name"]
        if unit in LENGTHS and axis["direction"] in ("up", "down"):
            code = crs.datum.to_json_dict()["id"]["code"] if crs.datum else 0
            up = "true" if axis["direction"] == "up" else "false"
            name = datum["name"].removesuffix(" ensemble")
            print(f"({number}, {text(definition['name'])}, {code}, {text(name)}, {LENGTHS[unit]!r}, {up}),")


if __name__ == "__main__":
    tables = {"geodetic": geodetic, "projected": projected, "vertical": vertical}
    if len(sys.argv) != 2 or sys.argv[1] not in tables:
        sys.exit(__doc__)
    tables[sys.argv[1]]()
