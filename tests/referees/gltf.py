#!/usr/bin/env python3
"""Octrees and exact models as 3D Tiles and binary glTF, as other programs see them: trimesh; in
JavaScript gltf-validator, 3d-tiles-tools, loaders.gl and CesiumJS.

    tests/referees/gltf.py PATH/TO/spinney

Needs Python with numpy and trimesh. With node, gltf.mjs in this directory is run with the packages
in the directory NODE_DIRECTORY; with the package cesium and chromium, cesium.mjs is run as well.
"""

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh

SPINNEY = Path(sys.argv[1]).resolve()
HERE = Path(__file__).resolve().parent


def spinney(*arguments):
    done = subprocess.run([SPINNEY, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, f"{arguments}: {done.stderr}"


def placed(file):
    """Returns the mesh of a file in scene coordinates."""
    return trimesh.load(file, force="mesh", process=False)


def check_volume(mesh, expected, tolerance, what):
    mesh.merge_vertices(merge_norm=True, merge_tex=True, digits_vertex=6)
    assert mesh.is_winding_consistent, what
    assert abs(mesh.volume / expected - 1) < tolerance, f"{what}: {mesh.volume}, not {expected}"


# From y upwards, as in glTF, to z upwards.
Z_UP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])


def tiles_of(tile, directory, above):
    """Visits a tile and those below: geometric error, and mesh in coordinates of the tileset."""
    transform = above @ np.array(tile.get("transform", np.eye(4).ravel())).reshape(4, 4).T
    if "content" in tile:
        mesh = placed(directory / tile["content"]["uri"])
        mesh.apply_transform(transform @ Z_UP)
        yield tile["geometricError"], mesh
    for child in tile.get("children", []):
        yield from tiles_of(child, directory, transform)


def check_models(work, volume, area):
    """An exact model with levels of detail, as glTF, and as tiles of all levels."""
    model = work / "model.goblin"
    spinney("build", work / "bodies.obj", "-o", model, "--brep", "--levels")
    spinney("export", model, work / "model.glb")
    check_volume(placed(work / "model.glb"), volume, 1e-4, "exact model")
    directory = work / "model-tiles"
    spinney("export", model, directory / "tileset.json")
    levels = {}
    for error, mesh in tiles_of(json.loads((directory / "tileset.json").read_text())["root"], directory, np.eye(4)):
        levels.setdefault(error, []).append(mesh)
    assert len(levels) > 1 and 0 in levels, levels
    for error, meshes in levels.items():
        mesh = trimesh.util.concatenate(meshes)
        check_volume(mesh, volume, 1e-4 + error * area / volume, f"level with error {error}")
        assert mesh.is_watertight, f"level with error {error}"
    print(f"exact model: trimesh finds closed bodies with their volume in each of {len(levels)} levels")


def main():
    work = Path(tempfile.mkdtemp())
    # Two solids, of 64 cells and more, so that tile borders cut them.
    ball = trimesh.creation.icosphere(subdivisions=5, radius=40.0)
    ball.apply_translation([45.3, 50.1, 44.7])
    box = trimesh.creation.box(extents=[20.0, 61.0, 33.0])
    box.apply_translation([110.2, 50.0, 40.0])
    lines, first = [], 1
    for name, mesh in [("ball", ball), ("box", box)]:
        lines += [f"o {name}", *(f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist())]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + first).tolist()]
        first += len(mesh.vertices)
    (work / "bodies.obj").write_text("\n".join(lines) + "\n")
    spinney("build", work / "bodies.obj", "-o", work / "shape.goblin", "--cells", 128, "--edge", "area")
    spinney("build", work / "bodies.obj", "-o", work / "parts.goblin", "--cells", 128, "--attribute", "part")
    volume = 4 / 3 * math.pi * 40.0**3 + 20 * 61 * 33

    for name, options, tolerance in [("shape", ["--smooth"], 0.02), ("shape", [], 0.01), ("parts", [], 0.01)]:
        file = work / "whole.glb"
        spinney("export", work / f"{name}.goblin", file, *options)
        mesh = placed(file)
        check_volume(mesh, volume, tolerance, f"{name} {options}")
        # With y upwards.
        cell = 2.0
        least, most = np.array([5.3, 10.1, 4.7]) - cell, np.array([120.2, 90.1, 84.7]) + cell
        turned = np.column_stack([mesh.vertices[:, 0], -mesh.vertices[:, 2], mesh.vertices[:, 1]])
        assert (turned > least).all() and (turned < most).all(), name
    print("binary glTF: trimesh finds both bodies in their place")

    check_models(work, ball.volume + box.volume, ball.area + box.area)
    sets = []
    # A coarse cell of parts is solid if any of its cells is.
    for name, options, tolerance in [("shape", ["--smooth"], 0.02), ("parts", [], 0.05)]:
        directory = work / f"{name}-tiles"
        spinney("export", work / f"{name}.goblin", directory / "tileset.json", *options)
        spinney("export", work / f"{name}.goblin", work / f"{name}-tiles.meshopt" / "tileset.json", *options, "--meshopt")
        sets.append(directory)
        tileset = json.loads((directory / "tileset.json").read_text())
        transform = np.array(tileset["root"]["transform"]).reshape(4, 4).T
        levels = tileset["root"]["children"][0]["implicitTiling"]["availableLevels"]
        for level in range(levels):
            files = sorted((directory / "content" / str(level)).glob("*/*/*.glb"))
            mesh = trimesh.util.concatenate([placed(file) for file in files])
            # From z upwards to world coordinates.
            mesh.apply_transform(transform @ Z_UP)
            check_volume(mesh, volume, tolerance * 2 ** (levels - 1 - level), f"{directory.name}, level {level}")
        print(f"{directory.name}: trimesh finds the bodies' volume in each of {levels} levels")

    modules = os.environ.get("NODE_DIRECTORY")
    if not modules or not shutil.which("node"):
        print("readers in JavaScript are left out: there is no node, or NODE_DIRECTORY names no packages")
        return
    subprocess.run(["node", HERE / "gltf.mjs", *sets], check=True)
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if not chromium or not Path(modules, "node_modules/cesium").exists():
        print("Cesium is left out: there is no chromium, or no package")
        return
    for directory in sets:
        for one in [directory, f"{directory}.meshopt"]:
            subprocess.run(["node", HERE / "cesium.mjs", chromium, one], check=True)
    shutil.rmtree(work)


main()
