"""Areas of classes in polygons: `spinney stats --zones` against exactextract and rasterstats on a
COG.

    pip install numpy rasterio shapely geopandas exactextract rasterstats
    SPINNEY=target/release/spinney python benches/peers/zonal.py [DATA] [POLYGONS]

DATA is the directory with shoreline_43200x21600_u8.tif (../shared/data/raster/large). Stars of
random sizes, reproducible; medians of processor seconds of whole processes. The results are
compared.
"""

import json
import math
import os
import random
import resource
import statistics
import subprocess
import sys
import tempfile

from common import record, row

SPINNEY = os.environ.get("SPINNEY", "target/release/spinney")
DATA = sys.argv[1] if len(sys.argv) > 1 else "../shared/data/raster/large"
COUNT = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
RUNS = 3

PEERS = {
    "exactextract (area)": """
import sys, json
from exactextract import exact_extract
zones = json.load(open(sys.argv[2]))["features"]
features = exact_extract(sys.argv[1], zones, ["unique", "frac", "count"])
print(json.dumps([dict(zip(map(int, f["properties"]["unique"]), (float(x) * f["properties"]["count"] for x in f["properties"]["frac"]))) for f in features]))
""",
    "rasterstats (centre)": """
import sys, json
from rasterstats import zonal_stats
print(json.dumps([{int(k): v for k, v in zone.items()} for zone in zonal_stats(sys.argv[2], sys.argv[1], categorical=True, nodata=-1)]))
""",
}


def star(rng, x, y, radius):
    count = rng.randrange(8, 60)
    ring = []
    for i in range(count):
        angle = 2 * math.pi * i / count
        away = radius * rng.uniform(0.5, 1.0)
        ring.append([x + away * math.cos(angle), y + away * math.sin(angle)])
    return ring + ring[:1]


def timed(command):
    times, output = [], None
    for _ in range(RUNS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        output = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return statistics.median(times), output


def main():
    with tempfile.TemporaryDirectory() as work:
        tif, cog, tree = f"{DATA}/shoreline_43200x21600_u8.tif", f"{work}/map.tif", f"{work}/map.goblin"
        subprocess.run(["gdal_translate", "-q", "-of", "COG", "-co", "COMPRESS=ZSTD", tif, cog], check=True)
        subprocess.run([SPINNEY, "build", "-q", tif, "-o", tree], check=True)
        info = json.loads(subprocess.check_output(["gdalinfo", "-json", cog]))
        left, width, _, top, _, height = info["geoTransform"]
        columns, rows = info["size"]
        rng = random.Random(1)
        features = []
        for number in range(COUNT):
            radius = 10 ** rng.uniform(1.5, 3) * abs(width)
            x = left + rng.uniform(0.05, 0.95) * columns * width
            y = top + rng.uniform(0.1, 0.9) * rows * height
            geometry = {"type": "Polygon", "coordinates": [star(rng, x, y, radius)]}
            features.append({"type": "Feature", "id": number, "properties": {}, "geometry": geometry})
        zones = f"{work}/zones.geojson"
        with open(zones, "w") as file:
            json.dump({"type": "FeatureCollection", "features": features}, file)
        ours, results = {}, []
        for border in ["area", "centre"]:
            seconds, output = timed([SPINNEY, "stats", tree, "--zones", zones, "--edge", border, "--json"])
            found = json.loads(output)["zones"]
            ours[border] = seconds, [{zone["value"]: zone["cells"] for zone in each["classes"]} for each in found]
            print(f"spinney ({border}): {seconds:.3f} s, {COUNT} polygons")
        for name, code in PEERS.items():
            border = name.split("(")[1].rstrip(")")
            seconds, output = timed([sys.executable, "-c", code, cog, zones])
            theirs = [{int(value): cells for value, cells in zone.items()} for zone in json.loads(output)]
            off = 0.0
            for mine, other in zip(ours[border][1], theirs):
                for value in set(mine) | set(other):
                    if value != info["bands"][0].get("noDataValue"):
                        off = max(off, abs(mine.get(value, 0) - other.get(value, 0)) / (1 + other.get(value, 0)))
            ratio = seconds / ours[border][0]
            job = f"class areas of {COUNT:,} stars, shoreline, by {border.replace('centre', 'centres')}"
            results.append(row(job, "CPU s", ours[border][0], name.split()[0], seconds))
            print(f"{name}: {seconds:.3f} s, {ratio:.1f} times as long; results differ by {off:.2g} at most")
        record("zonal statistics", results)


if __name__ == "__main__":
    main()
