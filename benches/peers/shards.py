#!/usr/bin/env python3
"""Building in shards: its cost compared with one process, two Dask workers compared with one, and
with rioxarray and Dask; plans of many files.

    benches/peers/shards.py [costs] [dask] [disk] [plan]

- `costs`: processor seconds of one process, and of plan, shards and merge; bytes of shard
  summaries; whether the bytes are the same.
- `dask`: a mosaic of SIDE x SIDE (4 x 4) rasters of 33.6 million cells of 12 classes on a local
  cluster of one worker and of two, and the same job by rioxarray and Dask, which write a COG. Needs
  spinney, distributed, rioxarray and rasterio in the Python given by PYTHON.
- `disk`: disk space of a merge that removes shards of that mosaic as it copies them, compared with
  the file alone.
- `plan`: a plan of 10,000 files (FILES) compared with gdalbuildvrt.
"""

import contextlib
import os
import subprocess
import sys
import time

from common import CLASSES, RELIEF, SHORELINE, SPINNEY, WORK, costs, once, record, row, start, table, verdict

PYTHON = os.environ.get("PYTHON", sys.executable)
FILES = int(os.environ.get("FILES", 10_000))
SIDE = int(os.environ.get("SIDE", 4))
PARTS = sys.argv[1:] or ["costs", "dask", "disk", "plan"]


def said(command):
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True).stdout


def emptied(path):
    subprocess.run(["rm", "-rf", path], check=True)
    return path


def whole_job():
    rows, results = [], []
    for raster in (SHORELINE, CLASSES, RELIEF):
        for codec in ("plain", "packed"):
            whole, merged, job = WORK / "whole.goblin", WORK / "merged.goblin", emptied(WORK / "job")
            one, _, one_peak = once([SPINNEY, "-q", "--threads", "1", "build", raster, "-o", whole, "--codec", codec])
            plan, _, _ = once([SPINNEY, "-q", "shard", "plan", raster, "-o", job, "--codec", codec, "--shards", "16"])
            shards = [once([SPINNEY, "-q", "--threads", "1", "shard", "build", job, number]) for number in range(16)]
            merge, _, merge_peak = once([SPINNEY, "-q", "--threads", "1", "shard", "merge", job, "-o", merged])
            assert merged.read_bytes() == whole.read_bytes()
            light = sum(path.stat().st_size for path in (job / "shards").glob("*.summary"))
            built = sum(cpu for cpu, _, _ in shards)
            job, most = f"{raster.name.split('_')[0]}, {codec}", max(peak for _, _, peak in shards)
            results += [
                row(f"{job}: plan, 16 shards, merge", "CPU s", plan + built + merge, "one process of Spinney", one),
                row(f"{job}: memory of a shard", "MiB", most, "one process of Spinney", one_peak),
                row(f"{job}: memory of merging", "MiB", merge_peak),
            ]
            rows.append([
                raster.name.split("_")[0], codec, f"{one:.2f}", f"{plan:.2f}", f"{built:.2f}", f"{merge:.2f}",
                verdict((plan + merge) / (plan + built + merge), 0.05, least=False), f"{(plan + built + merge) / one:.2f}",
                f"{most:.0f} of {one_peak:.0f}", f"{merge_peak:.0f}",
                f"{light:,}", verdict(light / whole.stat().st_size, 0.01, least=False),
            ])
    table(["raster", "codec", "one process, CPU s", "plan", "16 shards", "merge", "plan and merge of all (0.05)", "all / one", "MiB of a shard, of one process", "of merge", "summary bytes", "of the file (0.01)"], rows)
    record("building in shards", results)


MOSAIC = """
import sys, rasterio
from rasterio.transform import from_origin
with rasterio.open(sys.argv[1]) as source:
    data, profile = source.read(1), source.profile
profile.update(driver='GTiff', tiled=True, blockxsize=256, blockysize=256, compress='deflate', crs='EPSG:32633')
side = int(sys.argv[3])
for number in range(side * side):
    x, y = number % side, number // side
    profile['transform'] = from_origin(500000 + 10 * source.width * x, 9000000 - 10 * source.height * y, 10, 10)
    with rasterio.open(f'{sys.argv[2]}/tile_{number:02}.tif', 'w', **profile) as out:
        out.write(data, 1)
"""

CLUSTER = """
import sys, time
from distributed import Client, LocalCluster
if __name__ == '__main__':
    workers, how, directory, out = int(sys.argv[1]), *sys.argv[2:5]
    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        began = time.perf_counter()
        if how == 'spinney':
            import spinney.dask
            spinney.dask.build(directory + '/tile_*.tif', out, client=client, codec=sys.argv[5], kind='categorical')
        else:
            import glob, rioxarray, xarray
            from distributed import Lock
            tiles = [rioxarray.open_rasterio(path, chunks=(1, 2048, 2048), lock=False) for path in sorted(glob.glob(directory + '/tile_*.tif'))]
            side = round(len(tiles) ** 0.5)
            rows = [xarray.concat(tiles[side * row:side * row + side], 'x') for row in range(side)]
            whole = xarray.concat(rows, 'y')
            whole.rio.to_raster(out, tiled=True, lock=Lock('write'), compress='zstd', driver='GTiff', BIGTIFF='YES')
            import subprocess
            subprocess.run(['gdal_translate', '-q', '-of', 'COG', '-co', 'COMPRESS=ZSTD', '-co', 'OVERVIEW_RESAMPLING=MODE', '-co', 'BIGTIFF=YES', out, out + '.cog.tif'], check=True)
        print(time.perf_counter() - began)
"""


def mosaic():
    directory = WORK / f"mosaic_{SIDE}"
    if not directory.exists():
        directory.mkdir()
        subprocess.run([PYTHON, "-c", MOSAIC, CLASSES, directory, str(SIDE)], check=True)
    return directory


def dask():
    directory, script = mosaic(), WORK / "cluster.py"
    script.write_text(CLUSTER)
    tiles, rows, found, results = sorted(directory.glob("tile_*.tif")), [], {}, []

    def cluster(name, workers, how, out, codec):
        seconds = WORK / "seconds"
        with seconds.open("w") as file:
            cpu, _, _ = once([PYTHON, script, workers, how, directory, emptied(out), codec], stdout=file)
        size = out.with_name(out.name + ".cog.tif" if how == "rioxarray" else out.name).stat().st_size
        found[name] = cpu, float(seconds.read_text().split()[-1]), size
        rows.append([name, f"{cpu:.1f}", f"{found[name][1]:.1f}", f"{size:,}", ""])

    peer = "rioxarray and GDAL's COG, two workers"
    cluster(peer, 2, "rioxarray", WORK / "mosaic.tif", "")
    for codec in ("plain", "packed"):
        whole, merged = WORK / "whole.goblin", WORK / "merged.goblin"
        one, wall, _ = once([SPINNEY, "-q", "--threads", "1", "build", *tiles, "-o", whole, "--codec", codec, "--kind", "categorical"])
        rows.append([f"{codec}: spinney build --threads 1", f"{one:.1f}", f"{wall:.1f}", f"{whole.stat().st_size:,}", ""])
        for workers in (1, 2):
            cluster(f"{codec}: {workers} of spinney.dask.build", workers, "spinney", merged, codec)
            assert merged.read_bytes() == whole.read_bytes()
        (alone, first, _), (cpu, second, size) = (found[f"{codec}: {workers} of spinney.dask.build"] for workers in (1, 2))
        job, known, theirs = f"mosaic of {SIDE * SIDE} x 33.6 million cells, {codec}", "rioxarray with Dask, GDAL COG", found[peer]
        results += [
            row(f"{job}, spinney build --threads 1", "CPU s", one),
            *costs(f"{job}, one worker", (alone, first, None), memory=False),
            *costs(f"{job}, two workers", (cpu, second, None), known, theirs, memory=False),
            row(f"{job}: bytes", "bytes", size, known, theirs[2]),
        ]
        rows[-1][-1] = f"one worker / two: {verdict(first / second, 1.6)}; of the COG's CPU: {verdict(cpu / found[peer][0], 0.2, least=False)}"
    table([f"mosaic of {SIDE * SIDE} x 33.6 million cells", "CPU s, with the cluster", "s, without its start", "bytes", ""], rows)
    record("building in shards", results)


def disk():
    """Returns the maximum total size of the file and the remaining job."""
    merged, job, tiles = emptied(WORK / "merged.goblin"), emptied(WORK / "job"), sorted(mosaic().glob("tile_*.tif"))
    said([SPINNEY, "-q", "shard", "plan", *tiles, "-o", job, "--shards", "64"])
    for number in range(64):
        said([SPINNEY, "-q", "--threads", "1", "shard", "build", job, number])
    most = 0
    with subprocess.Popen([SPINNEY, "-q", "shard", "merge", job, "-o", merged, "--remove-shards"]) as merging:
        while merging.poll() is None:
            files = [*job.rglob("*"), merged, merged.with_name(merged.name + ".partial")]
            sizes = []
            for path in files:
                with contextlib.suppress(FileNotFoundError):
                    sizes.append(path.stat().st_size if path.is_file() else 0)
            most = max(most, sum(sizes))
    job, size = "disk while 64 shards are merged and removed, maximum", merged.stat().st_size
    record("building in shards", [row(job, "bytes", most, "the merged file", size)])
    table(["disk while shards are merged and removed", "bytes", "of the file (1.05)"], [
        ["the file", f"{size:,}", ""],
        ["file and shards, at most", f"{most:,}", verdict(most / size, 1.05, least=False)],
    ])


MANY = """
import sys, numpy, rasterio
from rasterio.transform import from_origin
data = numpy.arange(64 * 64, dtype='uint8').reshape(64, 64)
for number in range(int(sys.argv[2])):
    x, y = number % 100, number // 100
    with rasterio.open(f'{sys.argv[1]}/{number:05}.tif', 'w', driver='GTiff', width=64, height=64, count=1, dtype='uint8', crs='EPSG:32633', transform=from_origin(640 * x, 9000000 - 640 * y, 10, 10)) as out:
        out.write(data, 1)
"""


def plan():
    directory, names = WORK / f"many_{FILES}", WORK / "many.txt"
    if not directory.exists():
        directory.mkdir()
        subprocess.run([PYTHON, "-c", MANY, directory, str(FILES)], check=True)
    names.write_text("".join(f"{path}\n" for path in sorted(directory.glob("*.tif"))))
    job = emptied(WORK / "job")
    cpu, wall, peak = once([SPINNEY, "-q", "shard", "plan", f"@{names}", "-o", job, "--shards", "64"])
    peer, peer_wall, peer_peak = once(["gdalbuildvrt", "-q", "-overwrite", "-input_file_list", names, WORK / "many.vrt"])
    name, theirs = f"plan of {FILES:,} files", (peer, peer_wall, peer_peak)
    record("building in shards", costs(name, (cpu, wall, peak), "gdalbuildvrt", theirs))
    began = time.perf_counter()
    said([SPINNEY, "-q", "shard", "build", job, "0"])
    shard = time.perf_counter() - began
    table([name, "CPU s", "s", "MiB"], [
        ["spinney shard plan", f"{cpu:.2f}", f"{wall:.2f}", f"{peak:.0f}"],
        ["gdalbuildvrt", f"{peer:.2f}", f"{peer_wall:.2f}", f"{peer_peak:.0f}"],
        ["ours / theirs (1)", verdict(cpu / peer, 1, least=False), verdict(wall / peer_wall, 1, least=False), ""],
        ["a shard of 64 of it", "", f"{shard:.2f}", ""],
    ])


start(peer="gdalbuildvrt")
for part in PARTS:
    {"costs": whole_job, "dask": dask, "disk": disk, "plan": plan}[part]()
