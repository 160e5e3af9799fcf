#!/usr/bin/env python3
"""Results of set operations through each format of meshes and back, without --repair.

    round_trips.py [SEED ...]

300 results, with fixed seeds: two operations on three random solids (boxes, cylinders, tubes,
balls) in PLY files, every second one on a coarse grid. Each result is exported in each format,
built again, and combined with a fourth solid. Reports for each format how many were built and
combined, and the maximum difference of volumes from the result's own, relative to its area to the
power of 1.5. manifold3d computes the results' volumes, too. The program is target/release/spinney,
or SPINNEY.
"""

import json
import subprocess
import sys

from common import SPINNEY, WORK, record, row, start, table
from exact import PYTHON, install

COUNT = 300
FORMATS = ["ply", "obj", "off", "stl", "glb", "city.json"]
OPERATIONS = ["a-b", "and", "or", "xor"]
PLACE = WORK / "round_trips"


def construct(seeds):
    """Writes four solids of each seed, and prints its operations, with manifold3d's volume."""
    import numpy as np
    import trimesh
    from manifold3d import Manifold, Mesh64

    def solid(random):
        kind = random.integers(4)
        if kind == 0:
            made = trimesh.creation.box(extents=random.uniform(10, 60, 3))
        elif kind == 1:
            made = trimesh.creation.cylinder(radius=random.uniform(4, 20), height=random.uniform(10, 80), sections=int(random.integers(5, 65)))
        elif kind == 2:
            inner = random.uniform(3, 12)
            made = trimesh.creation.annulus(inner, inner + random.uniform(2, 12), random.uniform(10, 60), sections=int(random.integers(8, 48)))
        else:
            made = trimesh.creation.icosphere(subdivisions=int(random.integers(1, 4)), radius=random.uniform(8, 25))
        if random.random() < 0.7:
            made.apply_transform(trimesh.transformations.random_rotation_matrix(random.random(3)))
        made.apply_translation(random.uniform(-12, 12, 3))
        return made

    def manifold(mesh):
        return Manifold(Mesh64(vert_properties=np.asarray(mesh.vertices, "f8"), tri_verts=np.asarray(mesh.faces, "u8")))

    def write(mesh, path):
        lines = [f"{x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()] + [f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist()]
        head = ["ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}", *(f"property double {axis}" for axis in "xyz")]
        head += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices", "end_header"]
        path.write_text("\n".join([*head, *lines, ""]))

    rules = {"a-b": lambda a, b: a - b, "and": lambda a, b: a ^ b, "or": lambda a, b: a + b, "xor": lambda a, b: (a - b) + (b - a)}
    for seed in seeds:
        random = np.random.default_rng(seed)
        meshes = [solid(random) for _ in range(4)]
        if seed % 2:
            # On a coarse grid of 1/64, on which all solids can be combined.
            for mesh in meshes:
                mesh.vertices = np.round(mesh.vertices * 64) / 64
        for number, mesh in enumerate(meshes):
            write(mesh, PLACE / f"{seed}_{number}.ply")
        operations = [OPERATIONS[index] for index in random.integers(4, size=3)]
        first, second, third, _ = map(manifold, meshes)
        whole = rules[operations[1]](rules[operations[0]](first, second), third)
        print(json.dumps({"seed": seed, "operations": operations, "volume": whole.volume()}), flush=True)


def run(*words):
    """Returns the error's first line, or None."""
    done = subprocess.run([str(word) for word in (SPINNEY, "-q", *words)], capture_output=True, text=True)
    return None if done.returncode == 0 else " ".join(done.stderr.split())


def stats(model):
    return json.loads(subprocess.check_output([SPINNEY, "stats", model, "--json"]))


def build(path, model, *options):
    return run("build", path, "-o", model, "--brep", *options)


def main():
    start(data=False, peer="python3")
    install()
    PLACE.mkdir(exist_ok=True)
    seeds = [int(word) for word in sys.argv[1:]] or list(range(COUNT))
    listed = subprocess.run([PYTHON, __file__, "--construct", *map(str, seeds)], check=True, capture_output=True, text=True)
    counts = {form: {"built": 0, "combined": 0, "worst": 0.0} for form in FORMATS}
    results, against_peer = 0, 0.0
    for line in listed.stdout.splitlines():
        case = json.loads(line)
        seed, (first, second, last) = case["seed"], case["operations"]
        parts = [PLACE / f"{seed}_{number}.goblin" for number in range(4)]
        options = ["--snap", 1 / 64] if seed % 2 else []
        result, between, back, again, direct = (PLACE / f"{name}.goblin" for name in ("result", "between", "back", "again", "direct"))
        steps = [lambda part=part: build(part.with_suffix(".ply"), part, *options) for part in parts]
        steps += [lambda: run("combine", first, *parts[:2], "-o", between), lambda: run("combine", second, between, parts[2], "-o", result)]
        steps += [lambda: run("combine", last, result, parts[3], "-o", direct)]
        error = next((error for error in (step() for step in steps) if error), None)
        if error:
            print(f"{seed}: {case['operations']}: {error}", flush=True)
            continue
        whole, wanted = stats(result), stats(direct)["volume"]
        results += 1
        if not whole["surface"]:
            # Nothing to export.
            for count in counts.values():
                count["built"] += 1
                count["combined"] += 1
            continue
        scale = whole["surface"] ** 1.5
        against_peer = max(against_peer, abs(whole["volume"] - case["volume"]) / scale)
        for form, count in counts.items():
            path = PLACE / f"result.{form}"
            error = run("export", result, path) or build(path, back)
            if error:
                print(f"{seed} .{form}: {error}", flush=True)
                continue
            count["built"] += 1
            count["worst"] = max(count["worst"], abs(stats(back)["volume"] - whole["volume"]) / scale)
            error = run("combine", last, back, parts[3], "-o", again)
            if error:
                print(f"{seed} .{form}: combine {last}: {error}", flush=True)
                continue
            count["combined"] += 1
            count["worst"] = max(count["worst"], abs(stats(again)["volume"] - wanted) / scale)
        for part in parts:
            part.unlink()
    print(f"{results} results of {len(seeds)}; volumes differ from manifold3d's by {against_peer:.1e} of the area to the power of 1.5")
    table(["format", "built", "combined", "volumes differ"], [[form, count["built"], count["combined"], f"{count['worst']:.1e}"] for form, count in counts.items()])
    if len(seeds) == COUNT:
        rows = [row(f"round trips of {COUNT} results, .{form}", "combined again", count["combined"]) for form, count in counts.items()]
        record("exact models", [*rows, row(f"round trips of {COUNT} results: operations", "results", results)])


if __name__ == "__main__":
    construct(map(int, sys.argv[2:])) if sys.argv[1:2] == ["--construct"] else main()
