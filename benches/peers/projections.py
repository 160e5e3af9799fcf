"""Projections against PROJ, by pyproj.

    benches/peers/projections.py
        # 10^5 points in 27 systems, the largest distance in each
    benches/peers/projections.py --verify
        # every system of EPSG, five points each; prints the ranges of
        # crates/crs/src/projection/verified.rs
    benches/peers/projections.py --datums
        # every geographic system, sixty points each; prints the names of .../datum_names.rs
    benches/peers/projections.py --definitions [--every N]
        # systems of EPSG and Esri without their numbers, in all forms

The last one strips all identifiers from definitions, and compares with PROJ's results for the same
text: each must be within a millimetre, or rejected; it fails if one is wrong. Needs pyproj (`pip
install pyproj`). Distances are in metres on the ground; PROJ has no shift grids here.
"""

import argparse
import collections
import json
import math
import random
import re
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pyproj
from common import record, row
from pyproj.database import query_crs_info

PROJECT = Path(__file__).resolve().parents[2]
SYSTEMS = [4326, 4258, 4269, 3857, 32632, 32733, 25833, 3035, 3034, 2154, 5070, 3413, 3031, 2193, 28355, 3395, 6933, 3347,
           26912, 2056, 21781, 31370, 3067, 8857, 2180, 3006, 5041]


PROGRAM = ["cargo", "run", "--quiet", "--release", "--example", "project", "--"]
# A shift that no datum has.
SHIFT = "+towgs84=100.5,-50.25,30.125,0.1,-0.2,0.3,4"


def points_of(crs, count, random_):
    """Returns positions in a system's area."""
    area = crs.area_of_use
    east = area.east + (360 if area.east < area.west else 0)
    for _ in range(count):
        longitude = random_.uniform(area.west, east)
        yield (longitude + 180) % 360 - 180, random_.uniform(max(area.south, -85), min(area.north, 85))


def ours(lines, *options):
    """Returns the example's results for positions."""
    command = [*PROGRAM, *options]
    begin = time.perf_counter()
    done = subprocess.run(command, input="\n".join(lines) + "\n", capture_output=True, text=True, check=True, cwd=PROJECT)
    return done.stdout.splitlines(), time.perf_counter() - begin


def distance(crs, place, expected, output):
    """Returns the metres between PROJ's point and ours, and between a position and the inverse of
    our point."""
    try:
        x, y, longitude, latitude = map(float, output.split())
    except ValueError:
        return math.inf, math.inf
    metres = 111_320.0 if crs.is_geographic else crs.axis_info[0].unit_conversion_factor
    there = math.hypot(x - expected[0], y - expected[1]) * metres
    turned = (longitude - place[0] + 540) % 360 - 180
    back = math.hypot(turned * math.cos(math.radians(place[1])), latitude - place[1]) * 111_320.0
    return there, back


def compare(codes, count):
    """Prints the largest distances in each system."""
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
    outputs, seconds = ours((f"EPSG:{code} {place[0]!r} {place[1]!r}" for code, _, place, _ in work), "--allow-ballpark")
    worst = {}
    for (code, crs, place, expected), output in zip(work, outputs, strict=True):
        there, back = distance(crs, place, expected, output)
        before = worst.get(code, (0, 0))
        worst[code] = (max(before[0], there), max(before[1], back))
    return worst, len(work), seconds


# Names for which PROJ's shift depends on the position.
BY_PLACE = {"pulkovo1995", "sjtskjtsk03", "systemoftheunifiedtrigonometricalcadastralnetworkjtsk03"}


def known_datums():
    """Returns names of datums, as the code has them, whose systems agree; and a system for each."""
    random_ = random.Random(11)
    kinds = [pyproj.enums.PJType.GEOGRAPHIC_2D_CRS]
    systems, work = {}, []
    for info in query_crs_info(auth_name="EPSG", pj_types=kinds, allow_deprecated=True):
        crs = pyproj.CRS.from_epsg(int(info.code))
        if int(info.code) < 32768 and crs.area_of_use and crs.axis_info[0].unit_name == "degree":
            systems[int(info.code)] = (crs, info.deprecated)
            transformer = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
            positions = [place for place in points_of(crs, 60, random_) if info.code != "4269" or not in_islands(place)]
            work += [(int(info.code), place, transformer.transform(*place)) for place in positions]
    outputs, _ = ours(f"EPSG:{code} {place[0]!r} {place[1]!r}" for code, place, _ in work)
    bad = set()
    for (code, place, expected), output in zip(work, outputs, strict=True):
        if not distance(systems[code][0], place, expected, output)[0] < 1e-3:
            bad.add(code)
    names = collections.defaultdict(list)
    for code, (crs, deprecated) in systems.items():
        own = {crs.datum.name}
        for version in ["WKT1_GDAL", "WKT1_ESRI"]:
            own.update(re.findall(r'DATUM\["([^"]+)"', text_of(crs, version) or ""))
        for name in {re.sub("[^a-z0-9]", "", re.sub("^D_| ensemble$", "", name).lower()) for name in own}:
            names[name].append((deprecated, code))
    for name, found in sorted(names.items()):
        # Non-deprecated systems take precedence, if there is one.
        found = [one for one in sorted(found) if not one[0]] or sorted(found)
        if name not in BY_PLACE and not any(code in bad for _, code in found):
            yield name, found[0][1]


def in_islands(place):
    """Hawaii and the Aleutian Islands, where PROJ shifts NAD83 by 0.8 m."""
    return (place[0] < -150 or place[0] > 170) and (place[1] < 30 or 50 < place[1] < 57)


def text_of(crs, form):
    """Returns a system in a form; `None` if it has none."""
    try:
        if form == "PROJJSON":
            return crs.to_json()
        return crs.to_proj4() if form == "PROJ" else crs.to_wkt(form)
    except pyproj.exceptions.ProjError:
        return None


def stripped(text):
    """Returns a definition without identifiers, at any depth."""
    if text.startswith("{"):
        def strip(value):
            if isinstance(value, dict):
                return {name: strip(inner) for name, inner in value.items() if name not in ("id", "ids")}
            return [strip(inner) for inner in value] if isinstance(value, list) else value

        return json.dumps(strip(json.loads(text)))
    return re.sub(r',(AUTHORITY|ID)\["[^"]*",("[^"]*"|[0-9.]+)(,[^\[\]]*|,URI\[[^\]]*\])*\]', "", text)


def definitions(every):
    """Yields systems in all forms without identifiers: form, name, text, and the system itself."""
    kinds = [pyproj.enums.PJType.PROJECTED_CRS, pyproj.enums.PJType.GEOGRAPHIC_2D_CRS]
    forms = ["WKT1_GDAL", "WKT1_ESRI", "WKT2_2015", "WKT2_2019", "PROJJSON", "PROJ"]
    for authority in ["EPSG", "ESRI"]:
        infos = query_crs_info(auth_name=authority, pj_types=kinds, allow_deprecated=True)
        for info in infos[::every]:
            crs = pyproj.CRS.from_authority(authority, info.code)
            if crs.area_of_use is None:
                continue
            name = f"{authority}:{info.code}"
            for form in forms:
                text = text_of(crs, form)
                if text:
                    yield form, name, stripped(text), crs
            plain = text_of(crs, "PROJ")
            if not plain or "nadgrids" in plain or "towgs84" in plain:
                continue
            plain = plain.replace("+datum=WGS84", "+ellps=WGS84").replace("+datum=NAD83", "+ellps=GRS80")
            if "+datum" in plain:
                continue
            try:
                shifted = pyproj.CRS(plain.replace(" +no_defs", f" {SHIFT} +no_defs"))
            except pyproj.exceptions.ProjError:
                continue
            for form in forms:
                text = text_of(shifted, form)
                if text and form != "WKT1_ESRI":
                    yield f"{form} shifted", name, stripped(text), crs


def check_definitions(every):
    """Returns whether any definition gives coordinates that differ from PROJ's."""
    random_ = random.Random(5)
    work = []
    for form, name, text, crs in definitions(every):
        try:
            own = pyproj.CRS(text)
            transformer = pyproj.Transformer.from_crs("EPSG:4326", own, always_xy=True)
        except pyproj.exceptions.ProjError:
            continue
        is_nad83 = "4269" in (crs.geodetic_crs.to_json() if crs.geodetic_crs else "")
        for place in points_of(crs, 5, random_):
            expected = transformer.transform(*place)
            if all(map(math.isfinite, expected)) and not (is_nad83 and in_islands(place)):
                work.append((form, name, " ".join(text.split()), own, place, expected))
    outputs, _ = ours(f"{text} {place[0]!r} {place[1]!r}" for _, _, text, _, place, _ in work)
    found = collections.defaultdict(dict)
    for (form, name, text, own, place, expected), output in zip(work, outputs, strict=True):
        there, _ = distance(own, place, expected, output)
        is_refused = len(output.split()) > 4
        kind = "refused" if is_refused else "same" if there < 1e-3 else "wrong"
        before = found[form].get(name, (None, 0, None))
        if not before[0] or (not is_refused and there > before[1]):
            found[form][name] = (kind, there, f"{text}\n    {place}: {expected}, not {output}")
    wrong = 0
    for form, systems in found.items():
        counts = collections.Counter(kind for kind, _, _ in systems.values())
        worst = max((there for kind, there, _ in systems.values() if kind == "same"), default=0)
        print(f"{form:18} {counts['same']} the same (within {worst:.1e} m), {counts['refused']} refused, {counts['wrong']} wrong")
        for name, (kind, there, text) in systems.items():
            if kind == "wrong":
                wrong += 1
                print(f"{name} as {form}: {there:.2e} m off\n    {text}")
    reasons = collections.Counter()
    for (_, _, _, _, _, _), output in zip(work, outputs, strict=True):
        if len(output.split()) > 4:
            reasons[re.sub(r"^.*?: found | expected .*$", "", output)[:90]] += 1
    for reason, count in reasons.most_common(40):
        print(f"    {count:6} positions refused: {reason}")
    return wrong


def main():
    global PROGRAM
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--verify", action="store_true")
    parser.add_argument("--datums", action="store_true")
    parser.add_argument("--definitions", action="store_true")
    parser.add_argument("--every", type=int, default=8, metavar="N", help="take every Nth system only")
    parser.add_argument("--program", help="the example's program, if it is built already")
    options = parser.parse_args()
    PROGRAM = [options.program] if options.program else PROGRAM
    warnings.filterwarnings("ignore")
    print(f"pyproj {pyproj.__version__}, PROJ {pyproj.proj_version_str}")
    if options.definitions:
        sys.exit(check_definitions(options.every) > 0)
    if options.datums:
        text = " ".join(f'("{name}", {code}),'.replace(" ", "\0") for name, code in known_datums())
        print("\n".join(re.findall(r".{1,124}(?:\s+|$)", text)).replace("\0", " "))
        return
    if not options.verify:
        worst, count, seconds = compare(SYSTEMS, 100_000 // len(SYSTEMS) + 1)
        for code, (there, back) in worst.items():
            print(f"EPSG:{code:<6} {there:.1e} m from PROJ, {back:.1e} m there and back")
        print(f"{count} points, at most {max(there for there, _ in worst.values()):.1e} m, {seconds:.1f} s with starting")
        job, most = f"{count:,} points in {len(worst)} systems", max(there for code, (there, _) in worst.items() if code != 4269)
        note = "Except EPSG:4269, where PROJ uses another shift."
        record("coordinate systems", [row(f"{job} against PROJ: maximum error", "m", most, note=note), row(job, "s", seconds)])
        return
    kinds = [pyproj.enums.PJType.PROJECTED_CRS, pyproj.enums.PJType.GEOGRAPHIC_2D_CRS]
    codes = sorted({int(info.code) for info in query_crs_info(auth_name="EPSG", pj_types=kinds, allow_deprecated=True)})
    worst, _, _ = compare([code for code in codes if code < 32768], 5)
    # Shifts with an accuracy of metres are the same if they agree within a centimetre, and the
    # inverse, without heights, within a metre.
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
