#!/usr/bin/env python3
"""Coordinate systems as we write them against PROJ, by pyproj and rasterio.

    benches/peers/systems.py [--every N]
        # systems of EPSG without their numbers, in all forms, as WKT 2, Esri's WKT and geokeys
    benches/peers/systems.py --files
        # the systems of the test rasters as printed by `info --json`, against GDAL's

PROJ must read each text as the same system as the original: axes with their directions and units
(except in Esri's text and in keys, which have none), the ellipsoid, and five points within a
millimetre. Esri's text is compared with the one that PROJ writes. Fails if one differs. Needs
pyproj and rasterio.
"""

import argparse
import collections
import json
import math
import random
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import pyproj
from pyproj.database import query_crs_info
from pyproj.enums import PJType

from common import ROOT, SPINNEY, record, row
from projections import stripped, text_of

FORMS = ["wkt2", "esri", "keys"]
NAMES = {"WKT1_GDAL": "WKT 1 of GDAL", "WKT1_ESRI": "WKT 1 of Esri", "PROJJSON": "PROJJSON", "PROJ": "PROJ strings"}
EVERY = 10
WORLD = pyproj.CRS("EPSG:4326")


def ours(lines, form):
    """Returns each system in another form; a line that begins with `error` if that is impossible.
    """
    command = ["cargo", "run", "--quiet", "--release", "--example", "project", "--", "--as", form]
    done = subprocess.run(command, input="\n".join(lines) + "\n", capture_output=True, text=True, check=True, cwd=ROOT)
    return done.stdout.splitlines()


def axes(crs):
    return [(axis.direction, round(axis.unit_conversion_factor, 13)) for axis in crs.axis_info]


def difference(known, written, area, with_axes):
    """Returns the differences; empty if they are one system."""
    if with_axes and axes(known) != axes(written):
        return f"axes {axes(known)}, not {axes(written)}"
    figures = [(one.ellipsoid.semi_major_metre, one.ellipsoid.inverse_flattening) for one in (known, written) if one.ellipsoid]
    if len(figures) == 2 and any(abs(a - b) > 1e-8 for a, b in zip(*figures)):
        return f"ellipsoids {figures}"
    if not figures:
        return None
    try:
        transformers = [pyproj.Transformer.from_crs(WORLD, known, always_xy=True)]
    except pyproj.exceptions.ProjError:
        # PROJ itself has no operation there.
        return None
    transformers.append(pyproj.Transformer.from_crs(WORLD, written, always_xy=True))
    factor = known.axis_info[0].unit_conversion_factor
    metres = factor if known.is_projected or (known.is_compound and known.sub_crs_list[0].is_projected) else factor * 6.4e6
    random_ = random.Random(3)
    west, south, east, north = area
    east += 360 if east < west else 0
    for _ in range(5):
        place = (random_.uniform(west, east) + 180) % 360 - 180, random_.uniform(max(south, -85), min(north, 85))
        a, b = (transformer.transform(*place) for transformer in transformers)
        if not (math.isinf(a[0]) and math.isinf(b[0])) and not math.hypot(a[0] - b[0], a[1] - b[1]) * metres < 1e-3:
            return f"{math.hypot(a[0] - b[0], a[1] - b[1]) * metres:.3g} m at {place}"
    return None


def definitions(every):
    """Yields form, text, system and area of what is compared."""
    for kind in [PJType.PROJECTED_CRS, PJType.GEOGRAPHIC_2D_CRS, PJType.COMPOUND_CRS]:
        for info in query_crs_info(auth_name="EPSG", pj_types=[kind])[::every]:
            crs = pyproj.CRS.from_epsg(int(info.code))
            area = crs.area_of_use and (crs.area_of_use.west, crs.area_of_use.south, crs.area_of_use.east, crs.area_of_use.north)
            if int(info.code) < 32767:
                yield "EPSG", f"EPSG:{info.code}", crs, area or (-10, 30, 20, 60)
            for form in ["WKT1_GDAL", "WKT1_ESRI", "WKT2_2019", "PROJJSON", "PROJ"]:
                text = text_of(crs, form)
                if text:
                    text = stripped(text).replace("\n", " ")
                    yield form, text, pyproj.CRS(text), area or (-10, 30, 20, 60)


def of_registry(every):
    compared, bad = list(definitions(every)), 0
    for form in FORMS:
        counts = collections.defaultdict(collections.Counter)
        for (source, text, crs, area), written in zip(compared, ours([text for _, text, _, _ in compared], form), strict=True):
            if written.startswith("error"):
                counts[source]["refused"] += 1
                continue
            esri = text_of(crs, "WKT1_ESRI") if form == "esri" else None
            known = pyproj.CRS(esri) if esri else crs
            found = difference(known, pyproj.CRS(written), area, form == "wkt2")
            counts[source]["other" if found else "same"] += 1
            if found:
                bad += 1
                print(f"{form} of {source}: {found}\n    {text[:300]}\n    {written[:600]}")
        print(f"{form}:", "; ".join(f"{source} {dict(count)}" for source, count in counts.items()))
        if form == "wkt2" and every == EVERY:
            record("coordinate systems", [
                row(f"systems without identifiers read equally, {name}", "systems", counts[source]["same"],
                    note=f"{counts[source]['other']} other, {counts[source]['refused']} refused.")
                for source, name in NAMES.items()
            ])
    return bad


def of_files():
    import rasterio

    bad = compared = 0
    directory = ROOT.parent / "shared" / "data"
    with tempfile.TemporaryDirectory() as work:
        for path in sorted([*(directory / "raster").rglob("*.tif*"), *(directory / "hostile" / "raster").rglob("*.tif*")]):
            tree = Path(work) / "t.goblin"
            tree.unlink(missing_ok=True)
            if "large" in path.parts or subprocess.run([SPINNEY, "build", "-q", path, "-o", tree], capture_output=True).returncode:
                continue
            stored = json.loads(subprocess.run([SPINNEY, "info", "--json", tree], capture_output=True, check=True).stdout)["crs"]
            try:
                with rasterio.Env(GTIFF_REPORT_COMPD_CS="YES"), rasterio.open(path) as file:
                    known = file.crs and pyproj.CRS.from_wkt(file.crs.to_wkt(version="WKT2_2019"))
                    bounds = file.bounds
            except rasterio.errors.RasterioError:
                continue
            if not known or not stored:
                continue
            compared += 1
            if stored["text"] is None:
                found = stored["problem"]
            else:
                flat = known.to_2d() if known.ellipsoid else None
                x, y = pyproj.Transformer.from_crs(flat, WORLD, always_xy=True).transform(*file_middle(bounds)) if flat else (0, 0)
                x, y = (x, y) if math.isfinite(x) else (10, 50)
                found = difference(known, pyproj.CRS(stored["text"]), (x - 0.5, max(y - 0.5, -85), x + 0.5, min(y + 0.5, 85)), True)
            if found:
                bad += 1
                print(f"{path.name}: {found}")
    print(f"{compared} files, {bad} differ")
    record("coordinate systems", [row(f"systems of {compared} test TIFFs that differ from rasterio's", f"of {compared}", bad)])
    return bad


def file_middle(bounds):
    return (bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=EVERY)
    parser.add_argument("--files", action="store_true")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    sys.exit(bool(of_files() if args.files else of_registry(args.every)))


if __name__ == "__main__":
    main()
