#!/usr/bin/env python3
"""Building: `spinney build` against GDAL's COG writer and libvips pyramids; file sizes."""

from common import CLASSES, EARTH, RELIEF, SHORELINE, SPINNEY, WORK, cog, costs, record, row, runs, start, table, verdict

# Name, input, our options, GDAL's options, maximum share of GDAL's CPU time, maximum share of its
# memory, or MiB.
CASES = [
    ("shoreline", SHORELINE, ["--rule", "majority"], ["OVERVIEW_RESAMPLING=MODE"], 1 / 8, 200),
    ("earth", EARTH, ["--rule", "mean"], ["OVERVIEW_RESAMPLING=AVERAGE", "PREDICTOR=YES"], 1 / 2, None),
    ("relief", RELIEF, ["--rule", "mean"], ["OVERVIEW_RESAMPLING=AVERAGE", "PREDICTOR=YES"], 1 / 2, None),
    ("classes12", CLASSES, ["--rule", "majority"], ["OVERVIEW_RESAMPLING=MODE"], None, None),
]


def main():
    start()
    rows, sizes, results = [], [], []
    for name, source, ours, theirs, cpu, memory in CASES:
        tree = WORK / f"{name}.goblin"
        fresh = WORK / f"{name}_fresh.tif"
        raster = WORK / f"{name}_zstd.tif"
        pyramid = WORK / f"{name}_vips.tif"
        options = ["COMPRESS=ZSTD", *theirs]
        words = [word for option in options for word in ("-co", option)]
        a = runs([SPINNEY, "-q", "build", source, "-o", tree, *ours])
        single = runs([SPINNEY, "-q", "--threads", "1", "build", source, "-o", tree, *ours])
        b = runs(["gdal_translate", "-q", "-of", "COG", *words, source, fresh])
        fresh.replace(raster)
        v = runs(["vips", "tiffsave", source, pyramid, "--tile", "--pyramid", "--compression", "zstd"], 1)
        rows.append([
            name,
            f"{a[0]:.2f}", f"{a[1]:.2f}", f"{a[2]:.0f}",
            f"{single[0]:.2f}", f"{single[2]:.0f}",
            f"{b[0]:.2f}", f"{b[2]:.0f}",
            f"{v[0]:.2f}", f"{v[2]:.0f}",
            verdict(a[0] / b[0], cpu, False) if cpu else f"{a[0] / b[0]:.3g}",
            f"{a[2]:.0f} MiB ({'met' if a[2] <= memory else 'MISSED'})" if memory
            else verdict(a[2] / b[2], 1 / 3, False) if cpu else f"{a[2] / b[2]:.3g}",
        ])
        plain = WORK / f"{name}_none.tif"
        cog(source, plain, "COMPRESS=NONE", theirs[0])
        # In MB.
        size = [path.stat().st_size / 1e6 for path in (tree, raster, plain)]
        ratio = size[0] / size[2]
        gdal, vips = (costs(f"build {name}, plain", a, peer, theirs, wall=False) for peer, theirs in [("GDAL COG, ZSTD", b), ("libvips", v)])
        # packed.py records the seconds of GDAL's.
        results += [gdal[1], *vips, row(f"bytes of {name}, plain", "MB", size[0], "GDAL COG, NONE", size[2], area="packed files")]
        sizes.append([name, *(f"{number:.2f}" for number in size),
                      verdict(ratio, 1 / 60, False) if name == "shoreline" else f"{ratio:.3g}"])
    table(["raster", "CPU s", "wall s", "MiB", "CPU s, 1 thread", "MiB, 1 thread", "COG CPU s", "COG MiB",
           "vips CPU s", "vips MiB", "CPU ours / COG", "memory ours / COG"], rows)
    table(["raster", "ours, plain MB", "COG ZSTD MB", "COG NONE MB", "ours / COG NONE"], sizes)
    record("building rasters", results)


main()
