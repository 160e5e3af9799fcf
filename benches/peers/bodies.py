#!/usr/bin/env python3
"""Many bodies in one file: processor seconds of `spinney build --brep` for each body, which should
not depend on their number.

    bodies.py [KIND ...]

Kinds: boxes that are apart, touch in a wall, are nested in each other, or are equal and in one
position, and houses in a row as a city (CityJSON). Equal boxes are refused without --repair; the
others are built with it, too. One thread. The program is target/release/spinney, or SPINNEY.
"""

import json
import sys

from common import SPINNEY, WORK, once, record, row, start, table

COUNTS = [1000, 4000, 16000]
SIDES = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]


def corners(low, high):
    return [tuple((low, high)[i >> axis & 1][axis] for axis in range(3)) for i in range(8)]


def lattice(number, step):
    return tuple(step * (number // 32**axis % 32) for axis in range(3))


def boxes(kind, count):
    """Yields minimum and maximum corners, and -1 for boxes that are turned inside out, or 1."""
    for number in range(count):
        if kind == "nested":
            yield (number,) * 3, (4 * count - number,) * 3, -1 if number % 2 else 1
        else:
            low = {"apart": lattice(number, 10), "touching": lattice(number, 5), "equal": (0, 0, 0)}[kind]
            yield low, tuple(at + 5 for at in low), 1


def write_obj(kind, count):
    path = WORK / f"{kind}_{count}.obj"
    with path.open("w") as out:
        for number, (low, high, way) in enumerate(boxes(kind, count)):
            print(f"o box{number}", file=out)
            for corner in corners(low, high):
                print("v", *corner, file=out)
            for side in SIDES:
                print("f", *(8 * number + i for i in side[::way]), file=out)
    return path


def write_city(count):
    """Writes rows of houses that share walls, a solid each."""
    path = WORK / f"city_{count}.city.json"
    vertices, objects = [], {}
    for number in range(count):
        x, y, height = 8 * (number % 20) + 200 * (number // 20 % 20), 40 * (number // 400), 5 + number % 7
        faces = [[[8 * number + i - 1 for i in side]] for side in SIDES]
        vertices += corners((x, y, 0), (x + 8, y + 10, height))
        objects[f"house{number}"] = {"type": "Building", "geometry": [{"type": "Solid", "lod": "1", "boundaries": [faces]}]}
    city = {"type": "CityJSON", "version": "2.0", "transform": {"scale": [1, 1, 1], "translate": [0, 0, 0]}}
    path.write_text(json.dumps({**city, "CityObjects": objects, "vertices": vertices}))
    return path


def main():
    start(data=False, peer="true")
    rows, results, out = [], [], WORK / "bodies.goblin"
    for kind in sys.argv[1:] or ["apart", "touching", "nested", "equal", "city"]:
        for options in [[], ["--repair"]][kind == "equal" :]:
            each = []
            for count in COUNTS:
                path = write_city(count) if kind == "city" else write_obj(kind, count)
                cpu, _, peak = once([SPINNEY, "-q", "--threads", 1, "build", path, "-o", out, "--brep", *options])
                each.append(1e6 * cpu / count)
                path.unlink()
                out.unlink()
            name = " ".join([kind, *options])
            rows.append([name, *(f"{figure:.0f}" for figure in each), f"{each[-1] / each[0]:.2f}", f"{peak:.0f}"])
            results.append(row(f"many bodies, {name}: {COUNTS[-1]} bodies, each", "CPU us", each[-1], f"{COUNTS[0]} bodies", each[0]))
    table(["bodies", *(f"{count}, CPU us each" for count in COUNTS), "last / first", "MiB"], rows)
    record("exact models", results)


if __name__ == "__main__":
    main()
