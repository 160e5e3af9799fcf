#!/usr/bin/env python3
"""Rasters warped to web mercator, with all levels, against gdalwarp of the same cells, which makes
one level.

`build --grid xyz` reads the raster, makes its own tree in a temporary file, warps it and averages
all levels; `transform grid=xyz` starts from a tree. gdalwarp computes exact positions, as ours do
(-et 0), and approximate ones, its default (off by up to an eighth of a pixel).
"""

from common import RELIEF, SHORELINE, SPINNEY, WORK, record, row, runs, start, table, tree, verdict

HALF = "20037508.342789244"

start(peer="gdalwarp")
rows, ratios, results = [], [], []
for name, source, zoom, way, gdal_way, goal in [
    ("shoreline, classes", SHORELINE, 7, "nearest", "near", 4),
    ("relief, continuous", RELIEF, 4, "bilinear", "bilinear", 2),
]:
    side = str(256 << zoom)
    native, out = WORK / f"{source.stem}_native.goblin", WORK / "warped.goblin"
    tree(source, native)
    built = runs([SPINNEY, "-q", "build", source, "-o", out, "--grid", "xyz", "--max-zoom", zoom, "--resampling", way])
    size = out.stat().st_size
    warped = runs([SPINNEY, "-q", "transform", native, f"grid=xyz,{zoom}", "--resampling", way, "-o", out])
    peer = ["gdalwarp", "-q", "-overwrite", "-t_srs", "EPSG:3857", "-te", f"-{HALF}", f"-{HALF}", HALF, HALF, "-ts", side, side,
            "-r", gdal_way, "-wo", "XSCALE=1", "-wo", "YSCALE=1", "-co", "TILED=YES", "-co", "SPARSE_OK=TRUE"]
    tif = WORK / "warped.tif"
    exact = runs([*peer, "-et", "0", source, tif])
    usual = runs([*peer, source, tif])
    rows.append([name, f"{built[0]:.2f}", f"{warped[0]:.2f}", f"{exact[0]:.2f}", f"{usual[0]:.2f}",
                 f"{max(built[2], warped[2]):.0f}", f"{exact[2]:.0f}", size, tif.stat().st_size])
    ratios += [(f"{name}, with reading", exact[0] / built[0], goal), (f"{name}, from the tree", exact[0] / warped[0], goal)]
    job, exact_peer = f"{source.stem.split('_')[0]} to web mercator", "gdalwarp -et 0"
    for end, found in [("with building", built), ("from the tree", warped)]:
        results.append(row(f"{job}, zoom {zoom}, {way}, {end}", "CPU s", found[0], exact_peer, exact[0], note="The peer makes one level."))
    results.append(row(f"{job}: memory", "MiB", max(built[2], warped[2]), exact_peer, exact[2]))
    out.unlink()
    tif.unlink()
table(["raster", "build, CPU s", "transform, CPU s", "gdalwarp -et 0", "gdalwarp", "MiB", "gdalwarp", "bytes, all levels",
       "gdalwarp, one level"], rows)
for name, ratio, goal in ratios:
    print(f"{name}: {verdict(ratio, goal)} times less than gdalwarp -et 0")
record("tiles, COG, warping", results)
