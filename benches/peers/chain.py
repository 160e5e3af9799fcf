#!/usr/bin/env python3
"""A thousand consecutive set operations on an exact model, in a process each: `spinney combine`,
from file to file.

    chain.py [COUNT]

Tetrahedra are subtracted from a box (`carve`), and random operations (or, or without) are applied
to tetrahedra in a row (`mixed`), with a fixed seed, on a grid of a thousandth. Reports for both:
processor seconds of all operations and of the last ten; the volume next to that of manifold3d,
which does the same in one process; the classification of a thousand points, compared with the
operations applied to each tetrahedron's classification (except points within 0.01 of any plane);
and `spinney verify` of every hundredth result. The peers are installed as for exact.py. The program
is target/release/spinney, or SPINNEY.
"""

import json
import os
import random
import subprocess
import sys
import time

from common import SPINNEY, WORK, record, row, start, table
from exact import PYTHON, install

STEP = 0.001
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
SIDE = 400
OPERATIONS = {"carve": ["a-b"], "mixed": ["or", "or", "a-b"]}
JOBS = {"carve": "taken from a box", "mixed": "united or taken away"}


def box():
    at = [(x, y, z) for x in (0, SIDE) for y in (0, SIDE) for z in (0, SIDE)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return at, [part for a, b, c, d in quads for part in ((a, b, c), (a, c, d))]


def tetrahedron():
    x, y, z = (random.randint(-20, SIDE - 20) for _ in range(3))
    s = random.randint(20, 60)
    return [(x, y, z), (x + s, y + 1, z + 2), (x + 2, y + s, z + 1), (x + 1, y + 2, z + s)]


def inside(corners, point):
    """Whether a point is in a tetrahedron; None within 0.01 of a plane."""
    found = True
    for a, b, c in ([corners[i] for i in face] for face in FACES):
        u, v = ([q - p for p, q in zip(a, to)] for to in (b, c))
        normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        height = sum(n * (q - p) for n, p, q in zip(normal, a, point)) / sum(n * n for n in normal) ** 0.5
        if abs(height) < 0.01:
            return None
        found &= height < 0
    return found


def apply(operation, a, b):
    return {"or": a or b, "a-b": a and not b}[operation]


def peer():
    """Prints the volume and the processor seconds of manifold3d, for solids and operations on
    standard input."""
    import numpy as np
    from manifold3d import Manifold, Mesh64

    def solid(points, faces):
        return Manifold(Mesh64(vert_properties=np.array(points, "f8"), tri_verts=np.array(faces, "u8")))

    bodies, operations = json.load(sys.stdin)
    began = time.process_time()
    found = solid(*bodies[0])
    for operation, body in zip(operations, bodies[1:]):
        other = solid(*body)
        found = found + other if operation == "or" else found - other
    print(json.dumps([found.volume(), time.process_time() - began]))


def build(points, faces, target):
    mesh = target.with_suffix(".off")
    lines = [f"OFF\n{len(points)} {len(faces)} 0", *(" ".join(map(str, at)) for at in points), *("3 %d %d %d" % face for face in faces)]
    mesh.write_text("\n".join(lines) + "\n")
    subprocess.run([SPINNEY, "-q", "build", "--brep", "--snap", str(STEP), mesh, "-o", target], check=True)


def seconds():
    times = os.times()
    return times.children_user + times.children_system


def chain(name, count):
    random.seed(5)
    directory = WORK / "chain"
    directory.mkdir(parents=True, exist_ok=True)
    whole, other, new = (directory / f"{part}.goblin" for part in ("whole", "other", "new"))
    first = box() if name == "carve" else (tetrahedron(), FACES)
    bodies, operations, spent = [first], [], []
    build(*first, whole)
    for number in range(count):
        bodies.append((tetrahedron(), FACES))
        operations.append(random.choice(OPERATIONS[name]))
        build(*bodies[-1], other)
        before = seconds()
        subprocess.run([SPINNEY, "-q", "combine", operations[-1], whole, other, "-o", new], check=True)
        spent.append(seconds() - before)
        new.replace(whole)
        if number % 100 == 99:
            subprocess.run([SPINNEY, "-q", "verify", whole], check=True)
    points = []
    while len(points) < 1000:
        point = [random.uniform(0, SIDE) for _ in range(3)]
        if len(points) % 2:
            corners = random.choice(bodies)[0]
            point = [sum(axis) / len(corners) + random.uniform(-8, 8) for axis in zip(*corners)]
        positions = [all(0 < at < SIDE for at in point)] if name == "carve" else [inside(first[0], point)]
        positions += [inside(corners, point) for corners, _ in bodies[1:]]
        if None in positions:
            continue
        expected = positions[0]
        for operation, place in zip(operations, positions[1:]):
            expected = apply(operation, expected, place)
        points.append((point, expected))
    lines = "".join("%r,%r,%r\n" % tuple(point) for point, _ in points)
    outputs = subprocess.run([SPINNEY, "point", whole], input=lines, capture_output=True, text=True, check=True).stdout.splitlines()
    correct = [("inside" in output) == expected for output, (_, expected) in zip(outputs, points)]
    info = json.loads(subprocess.run([SPINNEY, "stats", "--json", whole], capture_output=True, text=True, check=True).stdout)
    theirs, cpu = json.loads(
        subprocess.run([PYTHON, __file__, "--peer"], input=json.dumps([bodies, operations]), capture_output=True, text=True, check=True).stdout
    )
    job = f"{count:,} tetrahedra {JOBS[name]}"
    record("exact models", [
        row(job, "CPU s", sum(spent), "manifold3d, in one process", cpu, note="Ours is a process and a file per operation."),
        row(f"{job}: first ten, each", "CPU s", sum(spent[:10]) / 10),
        row(f"{job}: last ten, each", "CPU s", sum(spent[-10:]) / 10),
        row(f"{job}: bytes at the end", "MB", whole.stat().st_size / 1e6),
        row(f"{job}: points classified correctly", f"of {len(points)}", sum(correct)),
    ])
    return [
        f"{name}, {count}",
        f"{sum(spent):.1f}",
        f"{sum(spent[:10]) / 10:.3f}",
        f"{sum(spent[-10:]) / 10:.3f}",
        f"{whole.stat().st_size / 1e6:.2f}",
        f"{abs(info['volume'] / theirs - 1):.1e}",
        f"{sum(correct)} of {len(points)} ({sum(expected for _, expected in points)} inside)",
        f"{cpu:.2f}",
    ]


def main():
    start(data=False, peer="cargo")
    install()
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    head = ["operations", "CPU s", "first ten, each", "last ten, each", "MB at the end", "volume differs from manifold3d's", "points classified right", "manifold3d, CPU s"]
    table(head, [chain(name, count) for name in OPERATIONS])


if sys.argv[1:] == ["--peer"]:
    peer()
else:
    main()
