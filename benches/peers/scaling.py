#!/usr/bin/env python3
"""Scaling of `spinney build` with raster size: time at most linear, memory constant.

`scaling.py [MOST]`: the largest rasters have 2^MOST cells along a side (16). 2^16 speckled cells
would need more than 10 GB of disk and are left out.
"""

import subprocess
import sys

from common import SPINNEY, WORK, costs, record, row, runs, start, table, verdict

# In a separate process: see `once`.
WRITER = r"""
import sys
import numpy, rasterio
from rasterio.windows import Window
path, side, kind = sys.argv[1], int(sys.argv[2]), sys.argv[3]
options = dict(driver="GTiff", width=side, height=side, count=1, dtype="uint8", tiled=True, blockxsize=512,
               blockysize=512, compress="zstd", zstd_level=1, BIGTIFF="YES")
random = numpy.random.default_rng(1)
if kind == "speckle":
    # Bands out of a pool; no two neighbours alike in place.
    pool = random.integers(0, 12, (512, side + 4096), dtype=numpy.uint8)
else:
    x = numpy.arange(side) / side
    columns = (60 + 40 * numpy.sin(17 * x) + 20 * numpy.sin(71 * x)).astype(numpy.uint8)
    rows = (60 + 40 * numpy.cos(13 * x) + 20 * numpy.sin(53 * x)).astype(numpy.uint8)
    classes = (numpy.arange(256) // 22).astype(numpy.uint8)
with rasterio.open(path, "w", **options) as file:
    for top in range(0, side, 512):
        if kind == "speckle":
            shift = int(random.integers(0, 4096))
            band = pool[random.permutation(512), shift:shift + side]
        else:
            band = classes[rows[top:top + 512, None] + columns[None]]
        file.write(band, 1, window=Window(0, top, side, 512))
"""


def main():
    start(data=False)
    most = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    rows, results = [], []
    for kind in ("smooth", "speckle"):
        before = None
        for power in range(14, most + 1):
            if kind == "speckle" and power > 15:
                continue
            source, goblin = WORK / f"{kind}{power}.tif", WORK / "scaling.goblin"
            if not source.exists():
                subprocess.run([sys.executable, "-c", WRITER, str(source), str(1 << power), kind], check=True)
            command = [SPINNEY, "-q", "build", source, "-o", goblin, "--kind", "categorical", "--rule", "majority"]
            cpu, _, memory = found = runs(command, 3 if power < 15 else 1)
            job = f"build {kind} cells, side 2^{power}"
            results += [*costs(job, found, wall=False), row(f"{job}: bytes", "MB", goblin.stat().st_size / 1e6)]
            rows.append([kind, f"2^{power}", f"{cpu:.2f}", f"{4**power / cpu / 1e6:.0f}", f"{memory:.0f}",
                         f"{goblin.stat().st_size / 1e6:.1f}",
                         # A tolerance of a tenth for noise.
                         verdict(cpu / before[0], 4.4, False) if before else "-",
                         f"{memory / before[1]:.2f}" if before else "-"])
            before = (cpu, memory)
            goblin.unlink()
            source.unlink()
    table(["cells", "side", "CPU s", "Mcells per CPU s", "peak MiB", "file MB", "CPU / size before", "memory / size before"],
          rows)
    record("building rasters", results)


main()
