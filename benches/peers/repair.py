#!/usr/bin/env python3
"""Meshes that are not solids: `spinney build --brep --repair` against libigl's exact arrangements
and manifold3d's import.

    repair.py [NAME ...]
    repair.py --torus [N M]

All scans, dirty scans and the bodies of ../shared/data/mesh and `hostile/bodies`, the buildings of
its city files, and 40 constructions: heaps of boxes and balls that are rotated, nested, inside out
and duplicated, with a fixed seed. Reports for each: processor seconds with reading and writing, and
volumes. libigl resolves by winding numbers above 0, so its volume is compared with ours by
`--inside positive`; inside-out solids are empty to it. manifold3d reports whether it accepts the
mesh. The peers are installed as for exact.py (and libigl).

With --torus: a bumpy torus of 2 N M = 5,500,000 triangles, of which 1,000 are removed and 1,000
reversed, within --memory 256M, against pymeshfix. Reports processor seconds, memory without mapped
files, and volumes next to the whole torus's. The program is target/release/spinney, or SPINNEY. One
thread.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

os.environ["RAYON_NUM_THREADS"] = "1"

from common import ROOT, SPINNEY, WORK, private_memory, record, row, start, table  # noqa: E402
from exact import MESH, PYTHON, READ, TORUS, install, python  # noqa: E402

CONSTRUCTIONS = 40
MADE = WORK / "dirty"
# Seconds allowed for a peer.
PLENTY = 300
# Seconds allowed for the peer of the torus.
LONG = 1800

# Removes 1,000 triangles of a PLY file, and reverses 1,000 others; prints the volume before that.
DIRTY = (
    READ
    + """
points, faces = read(sys.argv[1])
a, b, c = (points[faces[:, corner]].astype('f8') for corner in range(3))
print(np.einsum('ij,ij->', a, np.cross(b, c)) / 6)
chosen = np.random.default_rng(11).permutation(len(faces))[:2000]
rows = np.zeros(len(faces), [('n', 'u1'), ('v', '<i4', 3)])
rows['n'], rows['v'] = 3, faces
rows['v'][chosen[1000:]] = rows['v'][chosen[1000:], ::-1]
rows = np.delete(rows, chosen[:1000])
with open(sys.argv[2], 'wb') as out:
    out.write(('ply\\nformat binary_little_endian 1.0\\nelement vertex %d\\nproperty float x\\nproperty float y\\nproperty float z\\n'
               'element face %d\\nproperty list uchar int vertex_indices\\nend_header\\n' % (len(points), len(rows))).encode())
    out.write(points.tobytes())
    out.write(rows.tobytes())
"""
)

# Repairs a mesh by pymeshfix: prints the volume, processor seconds and peak MiB.
MESHFIX = (
    READ
    + """
import json, resource, time
import pymeshfix
began = time.process_time()
points, faces = read(sys.argv[1])
fixed = pymeshfix.MeshFix(points.astype('f8'), faces.astype('i4'))
fixed.repair(joincomp=True, remove_smallest_components=False)
points, faces = fixed.points, fixed.faces
seconds = time.process_time() - began
a, b, c = (points[faces[:, corner]] for corner in range(3))
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps([float(np.einsum('ij,ij->', a, np.cross(b, c)) / 6), seconds, peak]))
"""
)


def construct():
    """Writes the constructions as PLY files into a directory."""
    import numpy as np
    import trimesh

    rng = np.random.default_rng(7)
    for number in range(CONSTRUCTIONS):
        parts = []
        for _ in range(2 + number % 9):
            ball = rng.random() < 0.5
            part = trimesh.creation.icosphere(subdivisions=2) if ball else trimesh.creation.box(extents=rng.uniform(0.5, 2, 3))
            part.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
            part.apply_scale(rng.uniform(0.3, 1.5))
            part.apply_translation(rng.uniform(-1, 1, 3))
            if number % 4 == 1 and rng.random() < 0.4:
                part.invert()
            parts += [part] * (2 if number % 5 == 2 else 1)
        trimesh.util.concatenate(parts).export(Path(sys.argv[2]) / f"heap_{number:02}.ply")


def peer():
    """Prints volumes and processor seconds of libigl or manifold3d for a mesh."""
    import numpy as np
    import trimesh

    name, path = sys.argv[2:]
    began = time.process_time()
    mesh = trimesh.load(path, process=True, force="mesh")
    points, faces = np.asarray(mesh.vertices, dtype="f8", order="F"), np.asarray(mesh.faces, dtype="i8", order="F")
    found = {}
    if name == "libigl":
        from igl.copyleft.cgal import mesh_boolean

        points, faces = mesh_boolean(points, faces, np.zeros((0, 3)), np.zeros((0, 3), "i8"), "union")[:2]
    else:
        from manifold3d import Manifold, Mesh64

        solid = Manifold(Mesh64(vert_properties=np.ascontiguousarray(points), tri_verts=np.ascontiguousarray(faces.astype("u8"))))
        found["status"] = solid.status().name
        faces = faces[:0]
        if found["status"] == "NoError":
            found["volume"] = solid.volume()
    if name == "libigl":
        a, b, c = (points[faces[:, corner]] for corner in range(3))
        found["volume"] = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    found["seconds"] = time.process_time() - began
    print(json.dumps(found))


def run_peer(name, path):
    command = [PYTHON, __file__, "--peer", name, path]
    try:
        out = subprocess.run(command, capture_output=True, text=True, timeout=PLENTY).stdout.strip()
        return json.loads(out.splitlines()[-1]) if out else {"status": "failed"}
    except subprocess.TimeoutExpired:
        return {"status": f"over {PLENTY} s"}


def ours(path, *options):
    """Returns volume and processor seconds, or the first line of the error."""
    model = WORK / "repaired.goblin"
    model.unlink(missing_ok=True)
    command = [SPINNEY, "-q", "build", path, "-o", model, "--brep", "--repair", *options]
    before = os.times()
    made = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    after = os.times()
    seconds = after.children_user + after.children_system - before.children_user - before.children_system
    if made.returncode:
        return None, seconds, made.stderr.strip().splitlines()[0].split(": ", 2)[-1][:80]
    stats = subprocess.run([str(SPINNEY), "stats", str(model), "--json"], check=True, capture_output=True).stdout
    return json.loads(stats)["volume"], seconds, ""


def own_memory(command):
    """Runs a command; returns processor seconds and the maximum of its memory without mapped files,
    in MiB, sampled every 20 ms."""
    before, most = os.times(), 0
    process = subprocess.Popen([str(word) for word in command])
    while process.poll() is None:
        most = max(most, private_memory(process.pid))
        time.sleep(0.02)
    if process.returncode:
        sys.exit(f"failed: {command}")
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system, most


def torus(sizes):
    """Repairs a large torus with holes and reversed faces."""
    start(data=False, peer="python3")
    install()
    subprocess.run([PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "pymeshfix"], check=True)
    n, m = map(int, sizes or ["2750", "1000"])
    whole, dirty, model = WORK / "torus.ply", WORK / "dirty.ply", WORK / "repaired.goblin"
    python(TORUS, n, m, whole)
    volume = float(subprocess.run([PYTHON, "-c", DIRTY, whole, dirty], check=True, capture_output=True, text=True).stdout)
    model.unlink(missing_ok=True)
    options = ["--brep", "--close", "--repair", "--memory", "256M"]
    seconds, peak = own_memory([SPINNEY, "-q", "--threads", 1, "build", dirty, "-o", model, *options])
    found = json.loads(subprocess.check_output([SPINNEY, "stats", model, "--json"]))["volume"]
    rows = [["spinney, --memory 256M", f"{seconds:.1f}", f"{peak:.0f}", f"{abs(found / volume - 1):.1e}"]]
    theirs = [None] * 3
    try:
        out = subprocess.run([PYTHON, "-c", MESHFIX, dirty], capture_output=True, text=True, timeout=LONG)
        theirs = json.loads(out.stdout.splitlines()[-1]) if out.returncode == 0 else theirs
        print(out.stderr[-300:] if out.returncode else "", end="")
    except subprocess.TimeoutExpired:
        print(f"pymeshfix: over {LONG} s")
    if theirs[1] is not None:
        rows.append(["pymeshfix", f"{theirs[1]:.1f}", f"{theirs[2]:.0f}", f"{abs(theirs[0] / volume - 1):.1e}"])
    table([f"torus of {2 * n * m:,} triangles", "CPU s", "own MiB", "volume differs"], rows)
    if not sizes:
        job = "repair of a torus of 5.5 million triangles, 1,000 removed and 1,000 reversed"
        results = [row(job, "CPU s", seconds, "pymeshfix", theirs[1]), row(f"{job}: own memory", "MiB", peak, "pymeshfix", theirs[2])]
        record("exact models", results)


def main():
    start(data=False, peer="python3")
    install()
    subprocess.run([PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "libigl", "manifold3d"], check=True)
    MADE.mkdir(exist_ok=True)
    subprocess.run([PYTHON, __file__, "--construct", MADE], check=True)
    data = ROOT.parent / "shared" / "data"
    files = [*MESH.glob("*.*"), *MESH.glob("nasty/*.*"), *(data / "hostile/bodies").glob("*.*"), *MESH.glob("cityjson/*.json"), *MADE.glob("*.ply")]
    files = [path for path in sorted(files) if path.suffix in (".ply", ".stl", ".obj", ".json")]
    wanted = sys.argv[1:]
    rows, counts, groups = [], {"ours": 0, "libigl": 0, "manifold3d": 0}, {}
    names = {MESH: "scans, --close", MESH / "nasty": "dirty scans", data / "hostile/bodies": "malicious bodies",
             MESH / "cityjson": "city files, --close --skip-bad", MADE: "constructions"}
    for path in files:
        if wanted and not any(name in path.name for name in wanted):
            continue
        is_city = path.suffix == ".json"
        options = ["--close", "--skip-bad", "--where", "type=Building"] if is_city else ["--close"]
        volume, seconds, why = ours(path, *options)
        positive = ours(path, *options, "--inside", "positive")[0]
        igl, manifold = ({"status": "-"}, {"status": "-"}) if is_city else (run_peer("libigl", path), run_peer("manifold3d", path))
        is_made = {"ours": volume is not None, "libigl": igl.get("volume", 0) > 0, "manifold3d": "volume" in manifold}
        for name in counts:
            counts[name] += is_made[name]
        differs = abs(positive / igl["volume"] - 1) if positive and igl.get("volume") else None
        ratio = seconds / igl["seconds"] if igl.get("seconds") else None
        groups.setdefault(names[path.parent], []).append((is_made, ratio))
        rows.append([
            path.name, why or f"{volume:.9g}", f"{seconds:.2f}", igl.get("status", f"{igl.get('volume', 0):.9g}"), f"{igl.get('seconds', 0):.2f}",
            "" if differs is None else f"{differs:.1e}", "" if ratio is None else f"{ratio:.2f}", manifold.get("status", ""),
        ])  # fmt: skip
    head = ["mesh", "ours: volume", "CPU s", "libigl: volume", "CPU s", "positive differs", "ratio of CPU", "manifold3d"]
    table(head, rows)
    print(f"bodies of {len(rows)}: {counts}")
    results = []
    for name, found in groups.items():
        job, made = f"repair of {len(found)} {name}", {peer: sum(is_made[peer] for is_made, _ in found) for peer in counts}
        ratios = [ratio for _, ratio in found if ratio is not None]
        if ratios:
            note = f"{min(ratios):.2g} to {max(ratios):.2g} of the peer's."
            results.append(row(job, "CPU s", None, "libigl, exact union", ratio=max(ratios), note=note))
        peers = [(None, None)] if name.startswith("city") else [("libigl, exact union", made["libigl"]), ("manifold3d", made["manifold3d"])]
        results += [row(f"{job}: bodies made", "bodies", made["ours"], peer, theirs, ratio=None) for peer, theirs in peers]
    if not wanted:
        record("exact models", results)


if __name__ == "__main__":
    words = sys.argv[1:2]
    if words == ["--torus"]:
        torus(sys.argv[2:])
    else:
        construct() if words == ["--construct"] else peer() if words == ["--peer"] else main()
