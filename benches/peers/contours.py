#!/usr/bin/env python3
"""Contour lines of the relief, every 100 m, from a tree, against gdal_contour from the TIFF.

Both read the raster in their own format and write the same format. gdal_contour resolves saddles
differently, so its number of lines differs slightly. (Its bands, with -p, take so long that they
are left out.)
"""

from common import RELIEF, SPINNEY, WORK, costs, once, record, runs, start, table, tree

start(peer="gdal_contour")
goblin = WORK / "relief.goblin"
tree(RELIEF, goblin)
rows, results = [], []
for ending, format in [("geojson", "GeoJSON"), ("gpkg", "GeoPackage")]:
    out, other = WORK / f"contours.{ending}", WORK / f"contours_gdal.{ending}"
    mine = runs([SPINNEY, "-q", "contours", goblin, "--every", "100", "-o", out])
    # It does not replace files.
    other.unlink(missing_ok=True)
    gdal = once(["gdal_contour", "-q", "-i", "100", "-a", "value", RELIEF, other])
    rows.append([ending, *(f"{number:.2f}" for pair in zip(mine[:2], gdal[:2]) for number in pair),
                 f"{mine[2]:.0f}", f"{gdal[2]:.0f}", f"{gdal[0] / mine[0]:.1f}", f"{mine[2] / gdal[2]:.2f}"])
    results += costs(f"contours of the relief, {format}", mine, "gdal_contour", gdal)
    out.unlink()
    other.unlink()
table(["format", "CPU s", "GDAL", "wall s", "GDAL", "MiB", "GDAL", "times as fast", "memory of GDAL's"], rows)
record("contours and isosurfaces", results)
