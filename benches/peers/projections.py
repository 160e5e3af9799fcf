"""Projections against PROJ, by pyproj.

    benches/peers/projections.py            # 10^5 points in 27 systems, the largest distance in each
    benches/peers/projections.py --verify   # every system of EPSG, five points each; prints the ranges of src/space/projection/verified.rs

Needs pyproj (`pip install pyproj`). Distances are in metres on the ground; PROJ has no grids of shifts here.
"""

import argparse
import math
import random
import re
import subprocess
import time
import warnings
from pathlib import Path

import pyproj
from pyproj.database import query_crs_info

PROJECT = Path(__file__).resolve().parents[2]
SYSTEMS = [4326, 4258, 4269, 3857, 32632, 32733, 25833, 3035, 3034, 2154, 5070, 3413, 3031, 2193, 28355, 3395, 6933, 3347,
           26912, 2056, 21781, 31370, 3067, 8857, 2180, 3006, 5041]


def points_of(crs, count, random_):
    """Places in a system's area."""
    area = crs.area_of_use
    east = area.east + (360 if area.east < area.west else 0)
    for _ in range(count):
        longitude = random_.uniform(area.west, east)
        yield (longitude + 180) % 360 - 180, random_.uniform(max(area.south, -85), min(area.north, 85))


def ours(lines):
    """What the example makes of places."""
    command = ["cargo", "run", "--quiet", "--release", "--example", "project", "--", "--allow-ballpark"]
    begin = time.perf_counter()
    done = subprocess.run(command, input="\n".join(lines) + "\n", capture_output=True, text=True, check=True, cwd=PROJECT)
    return done.stdout.splitlines(), time.perf_counter() - begin


def distance(crs, place, expected, answer):
    """Metres between PROJ's point and ours, and between a place and what our point is."""
    try:
        x, y, longitude, latitude = map(float, answer.split())
    except ValueError:
        return math.inf, math.inf
    metres = 111_320.0 if crs.is_geographic else crs.axis_info[0].unit_conversion_factor
    there = math.hypot(x - expected[0], y - expected[1]) * metres
    turned = (longitude - place[0] + 540) % 360 - 180
    back = math.hypot(turned * math.cos(math.radians(place[1])), latitude - place[1]) * 111_320.0
    return there, back


def compare(codes, count):
    """The largest distances in each system."""
    random_ = random.Random(7)
    work = []
    for code in codes:
        try:
            crs = pyproj.CRS.from_epsg(code)
            transformer = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
            if crs.axis_info[0].unit_name == "grad":
                continue
            for place in points_of(crs, count, random_):
                work.append((code, crs, place, transformer.transform(*place)))
        except (pyproj.exceptions.ProjError, AttributeError, IndexError):
            continue
    answers, seconds = ours(f"EPSG:{code} {place[0]!r} {place[1]!r}" for code, _, place, _ in work)
    worst = {}
    for (code, crs, place, expected), answer in zip(work, answers, strict=True):
        there, back = distance(crs, place, expected, answer)
        before = worst.get(code, (0, 0))
        worst[code] = (max(before[0], there), max(before[1], back))
    return worst, len(work), seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--verify", action="store_true")
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    print(f"pyproj {pyproj.__version__}, PROJ {pyproj.proj_version_str}")
    if not options.verify:
        worst, count, seconds = compare(SYSTEMS, 100_000 // len(SYSTEMS) + 1)
        for code, (there, back) in worst.items():
            print(f"EPSG:{code:<6} {there:.1e} m from PROJ, {back:.1e} m there and back")
        print(f"{count} points, at most {max(there for there, _ in worst.values()):.1e} m, {seconds:.1f} s with starting")
        return
    kinds = [pyproj.enums.PJType.PROJECTED_CRS, pyproj.enums.PJType.GEOGRAPHIC_2D_CRS]
    codes = sorted({int(info.code) for info in query_crs_info(auth_name="EPSG", pj_types=kinds, allow_deprecated=True)})
    worst, _, _ = compare([code for code in codes if code < 32768], 5)
    # (A shift that is good to metres is the same if it is within a centimetre, and back, without heights, within a metre.)
    good = {code for code, (there, back) in worst.items() if there < 1e-2 and back < 1}
    ranges = []
    for code in codes:
        if code not in good:
            ranges.append(None)
        elif ranges and ranges[-1]:
            ranges[-1] = (ranges[-1][0], code)
        else:
            ranges.append((code, code))
    found = [pair for pair in ranges if pair]
    print(f"{len(good)} systems in {len(found)} ranges")
    text = " ".join(f"{pair}," for pair in found)
    print("\n".join(re.findall(r".{1,112}(?:\s+|$)", text)))


if __name__ == "__main__":
    main()
