#!/usr/bin/env python3
"""Intersection curves of two scans: `spinney section A B` against CGAL and libigl.

    intersections.py

CGAL (libcgal-dev, compiled here with g++ -O2) returns polylines: surface_intersection of
Surface_mesh, with the kernel of inexact constructions and with the exact one. libigl splits both
meshes along the curve (intersect_other), and returns triangles; it has nothing closer, and trimesh
has no equivalent. Both work on meshes in memory, and reading them is not counted; ours reads the
files of exact models, and writes PLY. All sides get the same triangles, with vertices on a grid.
The program is target/release/spinney, or SPINNEY. One thread.
"""

import json
import math
import os
import subprocess
import sys

os.environ["RAYON_NUM_THREADS"] = "1"

from booleans import PAIRS, inside, model_of  # noqa: E402
from common import SPINNEY, WORK, once, record, row, runs, start, table  # noqa: E402
from exact import MESH, PYTHON, install  # noqa: E402

BODIES = [("armadillo with bunny", "armadillo.ply", "bunny_hr.ply", "scaled"), ("armadillo with itself, moved", "armadillo.ply", "armadillo.ply", "moved")]

CGAL = r"""
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Polygon_mesh_processing/IO/polygon_mesh_io.h>
#include <CGAL/Polygon_mesh_processing/intersection.h>
#include <cmath>
#include <ctime>
#include <cstdio>
#include <string>

template <class Kernel> int run(char **argv) {
  using Mesh = CGAL::Surface_mesh<typename Kernel::Point_3>;
  namespace PMP = CGAL::Polygon_mesh_processing;
  Mesh a, b;
  if (!PMP::IO::read_polygon_mesh(argv[1], a) || !PMP::IO::read_polygon_mesh(argv[2], b)) return 1;
  std::vector<std::vector<typename Kernel::Point_3>> lines;
  std::clock_t began = std::clock();
  PMP::surface_intersection(a, b, std::back_inserter(lines));
  double seconds = double(std::clock() - began) / CLOCKS_PER_SEC, length = 0;
  int closed = 0;
  for (auto &line : lines) {
    for (size_t i = 1; i < line.size(); ++i) length += std::sqrt(CGAL::to_double(CGAL::squared_distance(line[i - 1], line[i])));
    closed += line.front() == line.back();
  }
  std::printf("{\"seconds\": %.6f, \"lines\": %zu, \"closed\": %d, \"length\": %.17g}\n", seconds, lines.size(), closed, length);
  return 0;
}

int main(int argc, char **argv) {
  if (argc != 4) return 2;
  return argv[3] == std::string("exact") ? run<CGAL::Exact_predicates_exact_constructions_kernel>(argv) : run<CGAL::Exact_predicates_inexact_constructions_kernel>(argv);
}
"""

IGL = """
import json, sys, time
import numpy as np
sys.path.insert(0, sys.argv[1])
from booleans import read_ply
from igl.copyleft.cgal import intersect_other
(a, fa), (b, fb) = read_ply(sys.argv[2]), read_ply(sys.argv[3])
began = time.process_time()
found = intersect_other(a, fa, b, fb, stitch_all=True)
print(json.dumps({"seconds": time.process_time() - began, "pairs": len(found[0])}))
"""


def cgal():
    """Returns the CGAL program, if it can be built."""
    program, source = WORK / "cgal_intersection", WORK / "cgal_intersection.cpp"
    if not program.exists():
        subprocess.run(["apt-get", "install", "-y", "-q", "libcgal-dev", "g++"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        source.write_text(CGAL)
        built = subprocess.run(["g++", "-O2", "-DNDEBUG", "-w", source, "-o", program, "-lgmp", "-lmpfr"])
        if built.returncode:
            print("skipped: CGAL cannot be had")
            return None
    return program


def parsed(command):
    """Returns a peer's output, and its peak memory."""
    result = WORK / "intersection.json"
    with open(result, "w") as file:
        _, _, peak = once(command, stdout=file)
    return {**json.loads(result.read_text()), "peak": peak}


def best(command):
    """Returns the median of three runs."""
    found = sorted((parsed(command) for _ in range(int(os.environ.get("RUNS", 3)))), key=lambda run: run["seconds"])
    return found[len(found) // 2]


def main():
    start(data=False, peer="python3")
    if "igl" not in install():
        sys.exit("libigl is needed")
    if not (MESH / "armadillo.ply").exists():
        return print("skipped: no test data in ../shared/data/mesh")
    PAIRS.mkdir(parents=True, exist_ok=True)
    program, rows, results = cgal(), [], []
    for number, (name, first, second, how) in enumerate(BODIES):
        facts = inside("make", f"meeting_{number}", first, second, how, ".ply")
        a, b = (PAIRS / f"meeting_{number}_{side}.ply" for side in "ab")
        models, out = [model_of(mesh, facts["grid"]) for mesh in (a, b)], WORK / "meeting.geojson"
        cpu, _, peak = runs([SPINNEY, "-q", "--threads", 1, "section", *models, "-o", WORK / "meeting.ply"])
        once([SPINNEY, "-q", "section", *models, "-o", out])
        features = json.loads(out.read_text())["features"]
        lines = [feature["geometry"]["coordinates"] for feature in features if feature["properties"]["kind"] == "crossing"]
        length = math.fsum(math.dist(*ends) for line in lines for ends in zip(line, line[1:]))
        assert all(line[0] == line[-1] for line in lines)
        shown, job = [name, facts["triangles"], f"{len(lines)}, {sum(map(len, lines)) - len(lines)}", f"{cpu:.3f}", f"{peak:.0f}"], f"lines of intersection, {name}"

        def recorded(peer, found):
            results.append(row(job, "CPU s", cpu, f"{peer}, in memory", found["seconds"]))
            results.append(row(f"{job}: memory", "MiB", peak, f"{peer}, in memory", found["peak"]))

        for kernel, peer in (("inexact", "CGAL"), ("exact", "CGAL, exact")):
            found = program and best([program, a, b, kernel])
            if found:
                differ = f"{found['lines']} ({found['closed']} closed), {abs(found['length'] - length) / length:.1e}"
                recorded(peer, found)
                shown += [f"{found['seconds']:.3f}", f"{found['peak']:.0f}", f"{found['seconds'] / cpu:.1f}", differ]
            else:
                shown += ["-"] * 4
        found = best([PYTHON, "-c", IGL, os.path.dirname(__file__) or ".", a, b])
        recorded("libigl", found)
        rows.append([*shown, f"{found['seconds']:.2f}", f"{found['peak']:.0f}", f"{found['seconds'] / cpu:.1f}"])
        for file in (*models, out, WORK / "meeting.ply"):
            file.unlink()
    head = ["scans", "triangles", "lines, segments", "ours, CPU s", "MiB"]
    for kernel in ("CGAL", "CGAL, exact"):
        head += [f"{kernel}: CPU s", "MiB", "/ ours", "lines, and lengths differ by"]
    table([*head, "libigl: CPU s", "MiB", "/ ours"], rows)
    record("exact models", results)


if __name__ == "__main__":
    main()
