#!/usr/bin/env python3
"""Set operations of polygons (`combine`) against GEOS, by shapely 2: real and difficult pairs, and
generated layers.

    python tests/referees/overlay.py PATH/TO/spinney DIRECTORY

Needs shapely and NumPy; without them it reports so and ends. For GEOS, invalid polygons are made
valid by their lines (even-odd). Results must be valid, and may differ from those of GEOS by the
area that the grid may change, times a small factor for GEOS's own rounding. Fails at the first one
that does not.
"""

import json
import pathlib
import subprocess
import sys

try:
    import numpy as np
    import shapely
    from shapely.geometry import mapping, shape
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit()

program, directory = sys.argv[1], pathlib.Path(sys.argv[2])
directory.mkdir(parents=True, exist_ok=True)
pairs_directory = pathlib.Path(__file__).parents[2] / ".." / "shared" / "data" / "poly2d" / "booleanop"
OPERATIONS = {
    "and": lambda a, b: a & b,
    "union": lambda a, b: a | b,
    "a-b": lambda a, b: a - b,
    "b-a": lambda a, b: b - a,
    "xor": lambda a, b: a ^ b,
}


def written(name, geometries):
    path = directory / f"{name}.geojson"
    features = [{"type": "Feature", "properties": {"number": number}, "geometry": own if isinstance(own, dict) else mapping(own)}
                for number, own in enumerate(geometries)]
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": None, "features": features}))
    return path


def combined(operation, *paths, options=()):
    output = directory / "out.geojson"
    process = subprocess.run([program, "combine", operation, *map(str, paths), "-o", str(output), *options], check=True, capture_output=True, text=True)
    bound = next(float(line.split()[-1]) for line in process.stderr.splitlines() if line.startswith("grid"))
    return json.loads(output.read_text())["features"], bound


def valid(geometries):
    """Returns the union of polygons, each by the even-odd rule."""
    made = [shapely.make_valid(own, method="linework") for own in geometries]
    return shapely.union_all([shapely.unary_union([part for part in shapely.get_parts(own) if part.area > 0]) for own in made])


def closed(geometry):
    """Returns a geometry with closed rings."""
    def ring(points):
        return points if points[0] == points[-1] else [*points, points[0]]
    polygons = geometry["coordinates"] if geometry["type"] == "MultiPolygon" else [geometry["coordinates"]]
    # Each polygon is a separate part: the overlap of two is in both.
    return [shapely.Polygon(ring(rings[0]), [ring(hole) for hole in rings[1:]]) for rings in polygons if rings and rings[0]]


def check(name, operation, features, bound, wanted):
    parts = [shape(feature["geometry"]) for feature in features]
    for part in parts:
        assert part.is_valid, (name, operation, shapely.is_valid_reason(part))
        assert part.geom_type in ("Polygon", "MultiPolygon")
    whole = shapely.union_all(parts) if parts else shapely.Polygon()
    assert abs(sum(part.area for part in parts) - whole.area) <= 1e-9 * max(whole.area, 1), (name, operation, "parts overlap")
    off = shapely.symmetric_difference(whole, wanted).area
    scale = max(wanted.length, whole.length, 1) * np.nanmax(np.abs([*whole.bounds, *wanted.bounds, 1])) * 2e-15
    assert off <= 4 * bound + scale, (name, operation, off, bound)


def difficult_pairs():
    count = 0
    for path in sorted(pairs_directory.glob("*.geojson")) if pairs_directory.exists() else []:
        features = json.loads(path.read_text())["features"]
        if len(features) < 2:
            continue
        first, second = features[0]["geometry"], features[1]["geometry"]
        a, b = written("a", [first]), written("b", [second])
        whole = [valid(closed(own)) for own in (first, second)]
        for operation, geos in OPERATIONS.items():
            found, bound = combined(operation, a, b)
            check(path.name, operation, found, bound, geos(*whole))
            count += 1
    print(f"{count} operations on difficult pairs" if count else "skipped: no shared data")


def layers():
    rng = np.random.default_rng(7)
    for round in range(6):
        def layer(count):
            made = []
            for _ in range(count):
                centre, corners = rng.uniform(0, 100, 2), rng.integers(3, 40)
                turns = np.sort(rng.uniform(0, 2 * np.pi, corners))
                away = rng.uniform(2, 15, corners)
                made.append(shapely.Polygon(centre + np.stack([np.cos(turns) * away, np.sin(turns) * away], -1)))
            return made
        first, second = layer(40), layer(60)
        a, b = written("a", first), written("b", second)
        whole = [valid(own) for own in (first, second)]
        options = ["--snap", "0.25"] if round % 3 == 2 else []
        for operation, geos in OPERATIONS.items():
            found, bound = combined(operation, a, b, options=options)
            check(f"layers {round}", operation, found, bound, geos(*whole))
        region = shapely.box(-20, -20, 120, 120)
        found, bound = combined("nor", a, b, options=[*options, "--within=-20,-20,120,120"])
        check(f"layers {round}", "nor", found, bound, region - (whole[0] | whole[1]))
        found, bound = combined("partition", a, b, options=options)
        check(f"layers {round}", "partition", found, bound, whole[0] | whole[1])
        # Each part is in all features that it names, and in no other.
        alone = [[valid([own]) for own in owns] for owns in (first, second)]
        for feature in found:
            place = shape(feature["geometry"]).representative_point()
            own = feature["properties"]
            for number, (key, all_own) in enumerate(zip(("features_1", "features_2"), alone)):
                wanted = [index + 1 for index, other in enumerate(all_own) if other.covers(place)]
                names = [int(text) for text in (own[key] or "").split(",") if text]
                if options and names != wanted:
                    continue  # On a coarse grid a small part may be displaced by more than its size.
                assert names == wanted, (round, names, wanted)
    print("layers of polygons, and all their parts")


difficult_pairs()
layers()
