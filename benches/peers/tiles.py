#!/usr/bin/env python3
"""Tiles: pyramids of PNG tiles and PMTiles archives, zooms 0 to 6; processor time, wall time, peak
memory.

gdal2tiles and rio-pmtiles start from the map in degrees and warp it themselves: they are compared
with our whole pipeline from the same file to the tiles (`build --grid xyz` and `export`), and with
the export alone, since a tree is built once. `vips dzsave` supports no projections: it gets a map
in web mercator, and is compared with the export alone.

Needs gdal2tiles.py, vips, and rio-pmtiles with pmtiles in the Python given by PEERS_PYTHON
(default: this one).
"""

import os
import shutil
import sys
from pathlib import Path

from common import EARTH, SHORELINE, SPINNEY, WORK, once, record, row, start, table, verdict

ZOOMS = "0..6"
HALF = "20037508.342789244"
PYTHON = Path(os.environ.get("PEERS_PYTHON", sys.executable))
RIO = PYTHON.parent / "rio"


def made(target, *command):
    """Makes a file once."""
    if not target.exists():
        once([*command, target])
    return target


def fresh(path):
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def measured(command, *targets):
    """Returns medians of runs, each after removing the previous run's targets."""
    import statistics

    found = []
    for _ in range(int(os.environ.get("RUNS", 3))):
        for target in targets:
            fresh(target)
        found.append(once(command))
    return [statistics.median(column) for column in zip(*found)]


def main():
    start(peer="gdal2tiles.py")
    degrees = ["-a_srs", "EPSG:4326", "-a_ullr", "-180", "90", "180", "-90"]
    half = made(WORK / "shoreline_21600.tif", "gdal_translate", "-q", "-outsize", "21600", "10800", "-co", "TILED=YES",
                "-co", "COMPRESS=ZSTD", SHORELINE)
    # gdal2tiles and rio-pmtiles do not support palettes.
    colours = made(WORK / "shoreline_21600_rgb.tif", "gdal_translate", "-q", "-expand", "rgb", "-co", "TILED=YES",
                   "-co", "COMPRESS=ZSTD", half)
    mercator = made(WORK / "shoreline_mercator_rgb.tif", "gdalwarp", "-q", "-t_srs", "EPSG:3857", "-te", f"-{HALF}", f"-{HALF}",
                    HALF, HALF, "-ts", "16384", "16384", "-co", "TILED=YES", colours)
    earth = made(WORK / "earth_degrees.tif", "gdal_translate", "-q", *degrees, "-co", "TILED=YES", EARTH)

    tree, directory, archive = WORK / "xyz.goblin", WORK / "tiles", WORK / "tiles.pmtiles"
    pattern = f"{directory}/{{z}}/{{x}}/{{y}}.png"
    build = measured([SPINNEY, "-q", "build", half, "-o", tree, "--grid", "xyz", "--max-zoom", "6"], tree)
    export = measured([SPINNEY, "-q", "export", tree, pattern, "--zoom", ZOOMS], directory)
    packed = measured([SPINNEY, "-q", "export", tree, archive, "--zoom", ZOOMS], archive)
    theirs = WORK / "peer_tiles"
    os.environ.setdefault("GDAL_CACHEMAX", "512")
    gdal = measured(["gdal2tiles.py", "-q", "-z", "0-6", "--xyz", "-r", "near", "-w", "none", colours, theirs], theirs)
    vips = measured(["vips", "dzsave", mercator, theirs, "--layout", "google", "--suffix", ".png", "--tile-size", "256"], theirs)
    rows = [["PNG directory", "build --grid xyz", *figures(build), ""], ["", "export", *figures(export), ""]]
    both = build[0] + export[0]
    job = "shoreline to PNG tiles, zoom 0-6"
    results = [
        row(f"{job}, from the tree", "CPU s", export[0], "gdal2tiles", gdal[0]),
        row(f"{job}, with building", "CPU s", both, "gdal2tiles", gdal[0]),
        row(f"{job}, from the tree", "CPU s", export[0], "vips dzsave", vips[0], note="The peer does not warp."),
        row(f"{job}: memory", "MiB", export[2], "gdal2tiles", gdal[2]),
    ]
    rows.append(["", "gdal2tiles", *figures(gdal), f"{verdict(gdal[0] / export[0], 8)}; with build {gdal[0] / both:.3g}"])
    rows.append(["", "vips dzsave", *figures(vips), verdict(vips[0] / export[0], 2)])
    rows.append(["PMTiles", "export", *figures(packed), verdict(packed[2], 200, False)])
    both = build[0] + packed[0]
    if RIO.exists():
        rio = measured([RIO, "pmtiles", colours, WORK / "rio.pmtiles", "--zoom-levels", ZOOMS, "--format", "PNG",
                        "--resampling", "nearest", "-j", "1", "--silent"], WORK / "rio.pmtiles")
        job = "shoreline to PMTiles, zoom 0-6"
        results += [
            row(f"{job}, from the tree", "CPU s", packed[0], "rio-pmtiles", rio[0]),
            row(f"{job}, with building", "CPU s", both, "rio-pmtiles", rio[0]),
            row(f"{job}: memory", "MiB", packed[2], "rio-pmtiles", rio[2]),
        ]
        rows.append(["", "rio-pmtiles", *figures(rio), f"{verdict(rio[0] / packed[0], 10)}; with build {rio[0] / both:.3g}"])
    rows.append(["", "gdal2tiles, then pmtiles convert", f"more than {gdal[0]:.3g}", "", "",
                 f"more than {verdict(gdal[0] / packed[0], 10)}; with build {gdal[0] / both:.3g}"])
    table(["job", "who", "CPU s", "s", "MiB", "peer / ours"], rows)

    built = measured([SPINNEY, "-q", "build", earth, "-o", tree, "--grid", "xyz", "--max-zoom", "5"], tree)
    rows = [["earth, PNG, zooms 0 to 5", "build --grid xyz", *figures(built), ""]]
    ours = measured([SPINNEY, "-q", "export", tree, archive], archive)
    rows.append(["", "export", *figures(ours), ""])
    if RIO.exists():
        rio = measured([RIO, "pmtiles", earth, WORK / "rio.pmtiles", "--zoom-levels", "0..5", "--format", "PNG",
                        "--resampling", "bilinear", "-j", "1", "--silent"], WORK / "rio.pmtiles")
        results.append(row("earth to PMTiles, PNG, zoom 0-5, from the tree", "CPU s", ours[0], "rio-pmtiles", rio[0]))
        rows.append(["", "rio-pmtiles", *figures(rio), f"{verdict(rio[0] / ours[0], 3)}; with build {rio[0] / (built[0] + ours[0]):.3g}"])
        rows.append(["", "bytes", f"ours {archive.stat().st_size}, theirs {(WORK / 'rio.pmtiles').stat().st_size}", "", "", ""])
    table(["job", "who", "CPU s", "s", "MiB", "peer / ours"], rows)
    record("tiles, COG, warping", results)


def figures(measured):
    return [f"{number:.3g}" for number in measured]


if __name__ == "__main__":
    main()
