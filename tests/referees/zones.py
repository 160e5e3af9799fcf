#!/usr/bin/env python3
"""Statistics of zones (`stats --zones`) against exactextract, by exact area, and against rasterio
masks, by centre: generated rasters and zones.

    python tests/referees/zones.py PATH/TO/spinney DIRECTORY

Needs exactextract, rasterio and NumPy; without them it reports so and ends. Cell fractions are
those of exactextract; measures are its own and those that NumPy computes from the fractions. Its
median and quantiles weigh fractions differently: they must be within a cell of ours, which are
checked against their definition in docs/maps.md. Fails at the first one that does not.
"""

import json
import math
import pathlib
import subprocess
import sys

try:
    import numpy as np
    import rasterio
    import rasterio.features
    from exactextract import exact_extract
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit()

program, directory = sys.argv[1], pathlib.Path(sys.argv[2])
directory.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(11)
ROWS, COLUMNS, CELL, WEST, NORTH = 150, 210, 20.0, 400_000.0, 5_500_000.0
TRANSFORM = rasterio.transform.from_origin(WEST, NORTH, CELL, CELL)
LEVELS = [0.0, 0.05, 0.25, 0.5, 0.9, 1.0]
MEASURES = "count,void,outside,sum,min,max,mean,std,majority,minority,variety,median,classes"


def rasters():
    """Returns heights, few integers, and classes; each with some cells VOID."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    smooth = 300 * np.sin(x / 31) * np.cos(y / 23) + rng.normal(0, 20, x.shape)
    blocks = rng.integers(0, 9, (ROWS // 5 + 1, COLUMNS // 5 + 1)).repeat(5, 0).repeat(5, 1)[:ROWS, :COLUMNS]
    noisy = np.where(rng.random(x.shape) < 0.1, rng.integers(0, 9, x.shape), blocks)
    kinds = {"heights": (smooth.astype("f4"), -9999), "numbers": ((smooth / 25).astype("i2"), -999), "classes": (noisy.astype("u1"), 0)}
    for name, (cells, nodata) in kinds.items():
        cells[40:70, 60:95] = nodata
        cells[rng.random(cells.shape) < 0.02] = nodata
        path = directory / f"{name}.tif"
        with rasterio.open(path, "w", driver="GTiff", height=ROWS, width=COLUMNS, count=1, dtype=cells.dtype, nodata=nodata, crs="EPSG:25832", transform=TRANSFORM) as file:
            file.write(cells, 1)
        tree = directory / f"{name}.goblin"
        kind = ["--kind", "categorical"] if name == "classes" else []
        subprocess.run([program, "-q", "build", path, *kind, "-o", tree], check=True)
        yield name, path, tree, np.ma.masked_equal(cells, nodata)


def star(x, y, reach, corners):
    turns = np.sort(rng.uniform(0, 2 * math.pi, corners))
    away = reach * rng.uniform(0.4, 1, corners)
    ring = np.stack([x + away * np.cos(turns), y + away * np.sin(turns)], -1).tolist()
    return [*ring, ring[0]]


def box(west, south, east, north):
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


def zones():
    """Returns polygons of all sizes: also smaller than a cell, with holes, of several parts, along
    the cells' sides, and across the raster's edge."""
    width, height = COLUMNS * CELL, ROWS * CELL
    made = []
    for number in range(120):
        x, y = WEST + rng.uniform(-0.03, 1.03) * width, NORTH - rng.uniform(-0.03, 1.03) * height
        reach = CELL * math.exp(rng.uniform(math.log(0.3), math.log(60)))
        made.append({"type": "Polygon", "coordinates": [star(x, y, reach, int(rng.integers(5, 40)))]})
    for number in range(20):
        x, y, reach = WEST + rng.uniform(0.2, 0.8) * width, NORTH - rng.uniform(0.2, 0.8) * height, rng.uniform(3, 25) * CELL
        rings = [box(x - reach, y - reach, x + reach, y + reach), star(x, y, reach * 0.9, 12)[::-1]]
        far = [[[px + 3 * reach, py] for px, py in ring] for ring in rings]
        made.append({"type": "MultiPolygon", "coordinates": [rings, far]})
    for number in range(20):
        column, row, wide, high = (int(rng.integers(0, most)) for most in (COLUMNS, ROWS, 30, 30))
        west, north = WEST + column * CELL, NORTH - row * CELL
        made.append({"type": "Polygon", "coordinates": [box(west, north - (high + 1) * CELL, west + (wide + 1) * CELL, north)]})
    path = directory / "zones.geojson"
    features = [{"type": "Feature", "id": number, "properties": {"number": number}, "geometry": own} for number, own in enumerate(made)]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return path, features


def statistics(tree, path, edge):
    words = [program, "stats", tree, "--zones", path, "--edge", edge, "--measure", MEASURES, "--quantiles", ",".join(map(str, LEVELS)), "--json"]
    return json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)["zones"]


def near(found, wanted, what, bound=1e-9):
    assert found is not None and abs(found - wanted) <= bound * max(abs(wanted), 1), (*what, found, wanted)


def quantile(values, weights, level):
    """Lays out all values in order, each as long as its weight in cells; returns the mean from q (n
    - 1) to one cell further."""
    ends = np.cumsum(weights)
    start = level * max(ends[-1] - 1, 0)
    stop = min(start + 1, ends[-1])
    lengths = np.clip(np.minimum(ends, stop) - np.maximum(ends - weights, start), 0, None)
    return float((lengths * values).sum() / lengths.sum())


def bracket(values, weights, level):
    """Returns the minimum and maximum value within two cells of a quantile's position."""
    ends = np.cumsum(weights)
    place = level * ends[-1]
    inside = (ends >= place - 2) & (ends - weights <= place + 2)
    return values[inside].min(), values[inside].max()


def check(name, edge, number, zone, values, weights, own=None):
    """Checks a zone against its cells' values and inside fractions, and against exactextract's own
    results."""
    what = (name, edge, number)
    values, weights = values[weights > 0].astype(float), weights[weights > 0]
    count = weights.sum()
    near(zone["cells"], count, (*what, "count"), 1e-9 if edge == "centre" else 1e-7)
    if count < 1e-6:
        return False
    order = np.argsort(values, kind="stable")
    values, weights = values[order], weights[order]
    mean = float((values * weights).sum() / count)
    channel, scale = zone["channels"][0], np.abs(values).max()
    wanted = {
        "min": values.min(),
        "max": values.max(),
        "mean": mean,
        "sum": float((values * weights).sum()),
        "standard_deviation": math.sqrt(float((weights * (values - mean) ** 2).sum() / count)),
        "median": quantile(values, weights, 0.5),
    }
    for measure, number in wanted.items():
        bound = 1e-6 * scale * (count if measure == "sum" else 1) / max(abs(number), 1)
        near(channel[measure], number, (*what, measure), max(bound, 1e-7))
    distinct, inverse = np.unique(values, return_inverse=True)
    cells = np.bincount(inverse, weights)
    assert channel["variety"] == len(distinct), (*what, "variety", channel["variety"], len(distinct))
    # The smallest of tied values; sums of fractions are rounded.
    for measure, most in (("majority", cells.max()), ("minority", cells.min())):
        equal = distinct[np.abs(cells - most) <= 1e-6]
        assert channel[measure] in equal, (*what, measure, channel[measure], equal)
        assert len(equal) == 1 or edge != "centre" or channel[measure] == equal[0], (*what, measure)
    quantiles = {float(level): found for level, found in channel["quantiles"].items()}
    steps = np.diff(distinct).max(initial=0)
    for level in LEVELS:
        # A position at the end of a value may be on either side of it, within the error of the
        # fractions.
        near(quantiles[level], quantile(values, weights, level), (*what, "quantile", level), 1e-6 * max(steps, 1) + 1e-7)
    if zone["classes"]:
        assert [own["value"] for own in zone["classes"]] == distinct.tolist(), (*what, "classes")
        for own_class, wanted in zip(zone["classes"], cells):
            near(own_class["cells"], wanted, (*what, "class"), 1e-6)
            near(own_class["area_m2"], wanted * CELL * CELL, (*what, "area"), 1e-6)
    if own is not None:
        for theirs, ours in (("count", zone["cells"]), ("sum", channel["sum"]), ("mean", channel["mean"]), ("stdev", channel["standard_deviation"])):
            near(ours, own[theirs], (*what, "exactextract", theirs), 1e-6 * max(scale, 1) * (count if theirs == "sum" else 1) / max(abs(own[theirs]), 1) + 1e-6)
        near(channel["min"], own["min"], (*what, "exactextract", "min"))
        near(channel["max"], own["max"], (*what, "exactextract", "max"))
        assert channel["variety"] == own["variety"], (*what, "exactextract", "variety")
        for theirs in ("majority", "minority"):
            at = [cells[list(distinct).index(value)] for value in (own[theirs], channel[theirs])]
            near(at[0], at[1], (*what, "exactextract", theirs), 1e-5)
        if count >= 1:
            for level, theirs in [(0.5, own["median"]), (0.25, own["quantile_25"]), (0.9, own["quantile_90"])]:
                low, high = bracket(values, weights, level)
                assert low - 1e-9 * scale <= quantiles[level] <= high + 1e-9 * scale, (*what, "bracket", level)
                # Between two values of many cells each it finds others, and for integers only
                # integers.
                at = np.searchsorted(distinct, [low, high])
                low, high = distinct[max(at[0] - 1, 0)], distinct[min(at[1] + 1, len(distinct) - 1)]
                assert low - 1e-9 * scale <= theirs <= high + 1e-9 * scale, (*what, "exactextract", level, theirs, low, high)
    return True


def by_area(name, raster, tree, path, features):
    measures = ["values", "coverage", "count", "sum", "mean", "stdev", "min", "max", "variety", "majority", "minority", "median", "quantile(q=0.25)", "quantile(q=0.9)"]
    found = exact_extract(str(raster), features, measures, include_cols=["number"])
    theirs = {feature["properties"]["number"]: feature["properties"] for feature in found}
    assert len(theirs) == len(features)
    compared = 0
    for number, zone in enumerate(statistics(tree, path, "area")):
        own = theirs[number]
        values, weights = np.ma.asarray(own["values"]), np.asarray(own["coverage"], float)
        valid = ~np.ma.getmaskarray(values)
        compared += check(name, "area", number, zone, np.asarray(values)[valid], weights[valid], own)
    return compared


def by_centre(name, cells, tree, path, features):
    compared = 0
    for number, (zone, feature) in enumerate(zip(statistics(tree, path, "centre"), features, strict=True)):
        inside = rasterio.features.geometry_mask([feature["geometry"]], (ROWS, COLUMNS), TRANSFORM, invert=True)
        void = np.ma.getmaskarray(cells)
        values = np.asarray(cells)[inside & ~void]
        near(zone["void_cells"], (inside & void).sum(), (name, "centre", number, "void"))
        compared += check(name, "centre", number, zone, values, np.ones(len(values)))
    return compared


path, features = zones()
for name, raster, tree, cells in rasters():
    area, centre = by_area(name, raster, tree, path, features), by_centre(name, cells, tree, path, features)
    assert area > 120 and centre > 100, (area, centre)
    print(f"{name}: {area} zones by area, {centre} by centre")
