#!/usr/bin/env python3
"""A cloud-optimized GeoTIFF with exact overviews from a tree, against GDAL's COG driver with MODE
from the TIFF."""

from common import CLASSES, SHORELINE, SPINNEY, WORK, costs, record, row, runs, start, table, tree, verdict

start()
rows, ratios, results, most = [], [], [], 0
for name, source in [("shoreline", SHORELINE), ("classes12", CLASSES)]:
    goblin, out = WORK / f"{name}_majority.goblin", WORK / f"{name}_export.tif"
    tree(source, goblin, "--rule", "majority")
    peaks = []
    for method in ["deflate", "zstd"]:
        ours = runs([SPINNEY, "-q", "export", goblin, out, "--compression", method])
        size = out.stat().st_size
        gdal = ["gdal_translate", "-q", "-of", "COG", "-co", f"COMPRESS={method.upper()}", "-co", "OVERVIEW_RESAMPLING=MODE"]
        theirs = runs([*gdal, source, out])
        rows.append([name, method, f"{ours[0]:.2f}", f"{theirs[0]:.2f}", f"{ours[1]:.2f}", f"{theirs[1]:.2f}",
                     f"{ours[2]:.0f}", f"{theirs[2]:.0f}", size, out.stat().st_size])
        ratios.append((name, method, ours[0] / theirs[0]))
        most = max(most, ours[2])
        results += costs(f"{name} to COG, {method.replace('zstd', 'ZSTD')}", ours, "GDAL COG, MODE", theirs, wall=False, memory=False)
        peaks.append((ours[2], theirs[2]))
        out.unlink()
    mine, others = map(max, zip(*peaks))
    results.append(row(f"{name} to COG: memory", "MiB", mine, "GDAL COG, MODE", others))
table(["raster", "compression", "CPU s", "GDAL", "wall s", "GDAL", "MiB", "GDAL", "bytes", "GDAL"], rows)
for name, method, ratio in ratios:
    print(f"{name}, {method}: CPU of GDAL's {verdict(ratio, 1 / 3, least=False)}")
print(f"memory: {verdict(most, 200, least=False)} MiB")
record("tiles, COG, warping", results)
