#!/usr/bin/env python3
"""Set operations on exact models: `spinney combine` against manifold3d and libigl's exact
arrangements.

    booleans.py             pairs, armadillo and coplanar
    booleans.py --large     two bumpy tori of 12.8 million triangles, too
    booleans.py pairs       only that (`pairs NAME ...`: these pairs);
                            also armadillo, coplanar, large

All sides get the same triangles, with vertices on a grid whose unit is a power of two. Reference
volumes are libigl's, in addition manifold3d's. Pairs and reference volumes are made once, in
benches/peers/work/booleans or in PAIRS; surfaces that are open or intersect themselves are repaired
by Spinney first, and all sides get the result. The program is target/release/spinney, or SPINNEY.
Each side has one thread.
"""

import json
import math
import os
import statistics
import subprocess
import sys
import time
import zlib
from pathlib import Path

from common import SPINNEY, WORK, record, row, runs, start, table
from exact import MESH, PYTHON, READ, TORUS, install, python, spinney

PAIRS = Path(os.environ.get("PAIRS", WORK / "booleans"))
VOLUMES = PAIRS / "volumes.json"
STEPS = 2**25  # grid units along the longest side of a pair's box, at most
GOAL = 1e-12  # maximum error of volumes
LIMIT = 150  # seconds allowed for a reference per pair
ROUNDS = 4  # repairs of a solid on one grid, at most
PATIENCE = 10  # CPU seconds allowed for building or repairing a solid of a pair
PLENTY = 120  # seconds allowed for libigl per measured operation
SHOWN = (1, 7, 2)
NAMES = {1: "A and B", 7: "A or B", 2: "A without B"}

# 74660.stl is left out: its surface is not resolved.
NASTY = ["1313535", "301921", "36088", "39926", "51334", "59082", "61459", "91946", "939888"]
NASTY = [f"nasty/{name}.stl" for name in NASTY]
NASTY += [f"nasty/{name}.obj" for name in ("Offset1", "Offset2", "self_intersectA", "self_intersectB")]
CLEAN = ["fandisk.ply", "rocker-arm.ply", "spot.ply", "bunny_hr.ply", "teapot.obj", "suzanne.ply"]
OTHERS = [
    ("fandisk.ply", "rocker-arm.ply"),
    ("spot.ply", "rocker-arm.ply"),
    ("bunny_hr.ply", "spot.ply"),
    ("armadillo.ply", "spot.ply"),
    *((NASTY[i], NASTY[i + 1]) for i in range(0, 12, 2)),
    (NASTY[11], NASTY[12]),
]
# Position of the second solid: `turned` is also rotated, `slid` is moved only along x, `adjacent`
# is moved by its width along x, `same` is at the same position, `within` is smaller and inside.
MADE = [
    ("cube", "cube", "turned"),
    ("cube", "cube", "adjacent"),
    ("cube", "cube", "within"),
    ("cube", "cube", "same"),
    ("torus", "torus", "turned"),
    ("torus", "cube", "turned"),
    ("heap", "heap", "turned"),
    ("heap", "torus", "turned"),
    ("heap", "heap", "slid"),
    ("fandisk.ply", "fandisk.ply", "slid"),
]


def pairs_of():
    """Name: first mesh, second mesh, position of the second."""
    found = {f"{Path(mesh).stem}": (mesh, mesh, "moved") for mesh in CLEAN + NASTY}
    for number, (a, b) in enumerate(OTHERS):
        found[f"{Path(a).stem}_{Path(b).stem}"] = (a, b, "turned" if number in (1, 3) else "scaled")
    for a, b, how in MADE:
        found[f"{Path(a).stem}_{Path(b).stem}_{how}"] = (a, b, how)
    return found


# The following functions, up to `inside`, run in separate processes with NumPy.


def triangulated(ring, flat):
    """Returns a polygon's triangles, none without area, by ear clipping; `flat` are its vertices as
    integers, counterclockwise."""

    def area(a, b, c):
        (ax, ay), (bx, by), (cx, cy) = flat[a], flat[b], flat[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    def is_ear(a, b, c):
        around = (d for d in left if d not in (a, b, c))
        return area(a, b, c) > 0 and not any(min(area(a, b, d), area(b, c, d), area(c, a, d)) >= 0 for d in around)

    left, found = list(ring), []
    while len(left) > 3:
        ends = [(left[at - 1], left[at], left[(at + 1) % len(left)]) for at in range(len(left))]
        # A reversed pair of edges encloses nothing; an ear is a triangle.
        at = next((at for at, (a, b, c) in enumerate(ends) if a == c), None)
        if at is None:
            at = next((at for at, end in enumerate(ends) if is_ear(*end)), None)
            if at is None:
                raise subprocess.SubprocessError("a rounded polygon intersects itself")
            found.append(ends[at])
            del left[at]
        else:
            left = [left[i] for i in range(len(left)) if i not in (at, (at + 1) % len(left))]
    return [*found, left] if len(set(left)) == 3 else found


def read_off(path):
    """Returns points, and faces as lists."""
    import numpy as np

    lines = [line for line in Path(path).read_text().split("\n")[1:] if line and not line.startswith("#")]
    vertices, faces = map(int, lines[0].split()[:2])
    points = np.array([line.split()[:3] for line in lines[1 : 1 + vertices]], "f8").reshape(-1, 3)
    words = (line.split() for line in lines[1 + vertices : 1 + vertices + faces])
    return points, [list(map(int, face[1 : 1 + int(face[0])])) for face in words]


def write_off(path, points, faces):
    with open(path, "w") as out:
        out.write(f"OFF\n{len(points)} {len(faces)} 0\n")
        out.writelines("%r %r %r\n" % tuple(point) for point in points.tolist())
        out.writelines("3 %d %d %d\n" % tuple(face) for face in faces.tolist())


def write_ply(path, points, faces):
    import numpy as np

    rows = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    with open(path, "wb") as out:
        out.write(b"ply\nformat binary_little_endian 1.0\nelement vertex %d\n" % len(points))
        out.write(b"".join(b"property double %c\n" % axis for axis in b"xyz"))
        out.write(b"element face %d\nproperty list uchar int vertex_indices\nend_header\n" % len(faces))
        out.write(points.astype("<f8").tobytes())
        out.write(rows.tobytes())


def read_ply(path):
    import numpy as np

    there = {}
    exec(READ, there)
    points, faces = there["read"](path)
    return np.array(points, "f8"), np.array(faces, "i8")


def read(path):
    import numpy as np

    if Path(path).suffix == ".ply":
        return read_ply(path)
    points, faces = read_off(path)
    return points, np.array(faces, "i8").reshape(-1, 3)


def volume(points, faces):
    import numpy as np

    if len(faces) == 0:
        return 0.0
    points = points - points[faces[0][0]]
    a, b, c = (points[faces[:, i]] for i in range(3))
    return math.fsum(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6


def raw(name, rng):
    """Returns a mesh of the test data, or a generated one: a cube, a torus, a heap of tetrahedra,
    many of which overlap."""
    import igl
    import numpy as np

    if name == "cube":
        points = np.array([[corner >> axis & 1 for axis in range(3)] for corner in range(8)], "f8")
        squares = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
        return points, np.concatenate([squares[:, :3], squares[:, [0, 2, 3]]])
    if name == "torus":
        path = PAIRS / "torus.ply"
        subprocess.run([sys.executable, "-c", TORUS, "120", "50", path], check=True)
        return read_ply(path)
    if name == "heap":
        points = (rng.uniform(0, 1, (60, 1, 3)) + rng.uniform(-0.15, 0.15, (60, 4, 3))).reshape(-1, 3)
        tetrahedra = np.arange(240).reshape(-1, 4)
        a, b, c, d = (points[tetrahedra[:, i]] for i in range(4))
        mirrored = np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a)) < 0
        tetrahedra[mirrored] = tetrahedra[mirrored][:, [1, 0, 2, 3]]
        return points, tetrahedra[:, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]].reshape(-1, 3)
    points, faces = igl.read_triangle_mesh(str(MESH / name))[:2]
    return np.array(points, "f8"), np.array(faces, "i8")


def extent(points):
    return (points.max(0) - points.min(0)).max()


def snapped(points, faces, width):
    """Snaps to the grid, merges equal points, and drops degenerate faces."""
    import numpy as np

    points, at = np.unique(np.round(points / width) * width + 0.0, axis=0, return_inverse=True)
    faces = at.reshape(-1)[faces]
    return points, faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]


def triangles_of(ring, whole):
    """Returns the triangles of a polygon whose vertices are integers."""
    if len(ring) == 3:
        return [ring]
    corners = [list(map(int, whole[corner])) for corner in ring]
    # Newell's normal, in integers.
    normal = [0, 0, 0]
    for p, q in zip(corners, corners[1:] + corners[:1]):
        for axis in range(3):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            normal[axis] += p[i] * q[j] - p[j] * q[i]
    axis = max(range(3), key=lambda axis: abs(normal[axis]))
    i, j = [(axis + 1) % 3, (axis + 2) % 3][:: 1 if normal[axis] > 0 else -1]
    return triangulated(ring, {at: (corner[i], corner[j]) for at, corner in zip(ring, corners)})


def body(points, faces, width):
    """Returns the same on the grid, repaired by `spinney build --close --repair` until it is a
    solid."""
    import resource

    import numpy as np

    points, faces = snapped(points, faces, width)
    off, model = PAIRS / "body.off", PAIRS / "body.goblin"
    build = [SPINNEY, "-q", "build", off, "-o", model, "--brep", "--snap", repr(width)]
    # The export rounds the vertices of a repaired surface to the grid. Faces that are thinner than
    # a grid unit may intersect by that, so the result is checked and repaired again.
    patient = {"check": True, "preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))}
    for _ in range(ROUNDS):
        write_off(off, points, faces)
        try:
            subprocess.run(build, stderr=subprocess.DEVNULL, **patient)
            break
        except subprocess.SubprocessError as error:
            refused = error
        subprocess.run([*build, "--close", "--repair"], **patient)
        subprocess.run([SPINNEY, "-q", "export", model, off], check=True)
        points, polygons = read_off(off)
        whole = points / width
        assert (whole == np.round(whole)).all(), "vertices off the grid"
        faces = np.array([triangle for ring in polygons for triangle in triangles_of(ring, whole)])
    else:
        raise refused
    off.unlink(missing_ok=True)
    model.unlink(missing_ok=True)
    return points, faces


def make(name, first, second, how, ending=".off", fraction=None):
    """Writes NAME_a and NAME_b, and prints the grid unit and the numbers of triangles."""
    import numpy as np

    rng = np.random.default_rng(zlib.crc32(name.encode()))
    a, a_faces = raw(first, rng)
    b, b_faces = raw(second, rng)
    if how == "turned":
        b = b @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
        if volume(a, a_faces) * volume(b, b_faces) < 0:
            b_faces = b_faces[:, ::-1]
    if how in ("turned", "scaled", "within"):
        b = b * (extent(a) / extent(b) * (0.37 if how == "within" else rng.uniform(0.6, 1.1)))
    space = (2 if how == "adjacent" else 1.4) * max(extent(a), extent(b))
    # A surface may be resolvable on one grid, and not on another.
    for step in range(4):
        width = 2.0 ** (math.ceil(math.log2(space / STEPS)) + step)
        try:
            first = body(a, a_faces, width)
            second = first if how in ("moved", "slid", "adjacent", "same") else body(b, b_faces, width)
            break
        except subprocess.SubprocessError:
            if step == 3:
                raise
    (a, a_faces), (b, b_faces) = first, second
    middle = (a.min(0) + a.max(0) - b.min(0) - b.max(0)) / 2
    away = (3 if how == "turned" else 1) * rng.uniform(0.02, 0.12, 3) * rng.choice([-1, 1], 3) * np.minimum(np.ptp(a, 0), np.ptp(b, 0))
    along = np.array([1, 0, 0])
    shift = {"slid": middle + along * away, "adjacent": along * np.ptp(a, 0), "same": 0 * middle, "within": middle}.get(how, middle + away)
    b = b + np.round(shift / width) * width
    both = np.concatenate([a, b])
    assert extent(both) <= STEPS * width and (both / width == np.round(both / width)).all()
    write = write_off if ending == ".off" else write_ply
    write(PAIRS / f"{name}_a{ending}", a, a_faces)
    write(PAIRS / f"{name}_b{ending}", b, b_faces)
    print(json.dumps({"grid": width, "triangles": len(a_faces) + len(b_faces)}))


def as_manifold(points, faces):
    from manifold3d import Manifold, Mesh64

    found = Manifold(Mesh64(vert_properties=points, tri_verts=faces.astype("u8")))
    return found, found.status().name


def referee(peer, a, b):
    """Prints the volumes of A and B, A without B, B without A; of the solids themselves; and the
    seconds."""
    (a, a_faces), (b, b_faces) = read(a), read(b)
    found = {}
    if peer == "libigl":
        from igl.copyleft.cgal import mesh_boolean

        began = time.process_time()
        there, back = (a, a_faces, b, b_faces), (b, b_faces, a, a_faces)
        for key, words, name in [("both", there, "intersect"), ("a_only", there, "minus"), ("b_only", back, "minus")]:
            found[key] = volume(*mesh_boolean(*words, name)[:2])
    else:
        began = time.process_time()
        (first, why), (second, why_not) = as_manifold(a, a_faces), as_manifold(b, b_faces)
        if (why, why_not) != ("NoError", "NoError"):
            return print(json.dumps({"refused": f"{why}, {why_not}"}))
        for key, result in [("both", first ^ second), ("a_only", first - second), ("b_only", second - first)]:
            mesh = result.to_mesh64()
            found[key] = volume(mesh.vert_properties[:, :3], mesh.tri_verts.astype("i8"))
    found["seconds"] = round(time.process_time() - began, 3)
    print(json.dumps({**found, "a": volume(a, a_faces), "b": volume(b, b_faces)}))


def closed(*paths):
    """Prints which files use each directed edge as often as its opposite, by coordinates."""
    import numpy as np

    found = []
    for path in paths:
        points, faces = read_off(path)
        number = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1) if len(points) else np.zeros(0, "i8")
        starts = number[[corner for face in faces for corner in face]] if faces else number[:0]
        ends = number[[corner for face in faces for corner in face[1:] + face[:1]]] if faces else number[:0]
        size = max(len(points), 1)
        found.append(bool((np.sort(starts * size + ends) == np.sort(ends * size + starts)).all()))
    print(json.dumps(found))


def measured(peer, code, a, b):
    """Runs one operation: prints the seconds of reading, of importing, and of the operation alone;
    peak MiB, triangles, volume."""
    import resource

    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    code = int(code)
    if peer == "libigl":
        from igl.copyleft.cgal import mesh_boolean
    else:
        import manifold3d  # noqa: F401
    marks = [time.process_time()]
    (a, a_faces), (b, b_faces) = read(a), read(b)
    marks.append(time.process_time())
    if peer == "libigl":
        marks.append(time.process_time())
        points, faces = mesh_boolean(a, a_faces, b, b_faces, {1: "intersect", 7: "union", 2: "minus"}[code])[:2]
        marks.append(time.process_time())
    else:
        (first, why), (second, why_not) = as_manifold(a, a_faces), as_manifold(b, b_faces)
        assert (why, why_not) == ("NoError", "NoError"), (why, why_not)
        del a, a_faces, b, b_faces
        marks.append(time.process_time())
        result = {1: first.__xor__, 7: first.__add__, 2: first.__sub__}[code](second)
        result.num_tri()
        marks.append(time.process_time())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if peer != "libigl":
        mesh = result.to_mesh64()
        points, faces = mesh.vert_properties[:, :3], mesh.tri_verts.astype("i8")
    seconds = [after - before for before, after in zip(marks, marks[1:])]
    print(json.dumps({"seconds": seconds, "peak": peak, "triangles": len(faces), "volume": volume(points, faces)}))


def tori(path, other):
    """Writes a bumpy torus on a grid, and a shifted copy; prints the grid unit."""
    import numpy as np

    points, faces = read_ply(path)
    width = 2.0 ** math.ceil(math.log2(1.2 * extent(points) / STEPS))
    points = np.round(points / width) * width
    write_ply(path, points, faces)
    write_ply(other, points + np.round(np.array([0.3713, -0.2119, 0.1307]) / width) * width, faces)
    print(json.dumps(width))


INSIDE = {"make": make, "referee": referee, "closed": closed, "measured": measured, "tori": tori}


def inside(*words, timeout=None):
    """Runs a function of the above in the virtual environment, and returns its output."""
    command = [PYTHON, "-B", __file__, "inside", *map(str, words)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True, timeout=timeout).stdout)


def prepared(requested):
    """Returns all pairs, with the reference volumes."""
    PAIRS.mkdir(parents=True, exist_ok=True)
    known = json.loads(VOLUMES.read_text()) if VOLUMES.exists() else {}
    for name, words in pairs_of().items():
        if name in known or (requested and name not in requested):
            continue
        if any("." in mesh and not (MESH / mesh).exists() for mesh in words[:2]):
            continue
        try:
            facts = inside("make", name, *words)
        except subprocess.CalledProcessError:
            # No grid has both solids; `model_of` refuses this one.
            known[name] = {"grid": 0.0, "triangles": "-"}
            continue
        a, b = (PAIRS / f"{name}_{side}.off" for side in "ab")
        for peer in ("libigl", "manifold3d"):
            try:
                found = inside("referee", peer, a, b, timeout=LIMIT)
            except subprocess.TimeoutExpired:
                found = {"refused": f"over {LIMIT} s"}
            except subprocess.CalledProcessError as error:
                found = {"refused": (error.stderr.strip().split("\n") or ["failed"])[-1][:200]}
            facts.update(found if peer == "libigl" else {"manifold": found})
        known[name] = facts
        VOLUMES.write_text(json.dumps(known, indent=1))
    return {name: known[name] for name in pairs_of() if name in known and (not requested or name in requested)}


def model_of(mesh, width):
    model = mesh.with_suffix(".goblin")
    spinney("-q", "build", mesh, "-o", model, "--brep", "--snap", repr(width))
    return model


def facts_of(model):
    return json.loads(spinney("stats", model, "--json"))


def minterms(code, of):
    """Returns a result's volume: with bit 8 the exterior belongs to it, which counts as zero, and
    missing regions count negative."""
    parts = [of["both"], of["a_only"], of["b_only"]]
    return math.fsum(part * ((code >> bit & 1) - (code >> 3)) for bit, part in enumerate(parts))


def residual(of, a, b):
    """Returns the deviation of the sum of the components from the whole, relative to A or B."""
    whole = of["both"] + of["a_only"] + of["b_only"]
    return max(abs(of["both"] + of["a_only"] - a), abs(of["both"] + of["b_only"] - b)) / whole


def pairs(requested):
    facts = prepared(requested)
    rows, failed, disputes, worst, theirs_worst = [], {"open": 0, "refused": 0, "off": 0}, [], 0.0, 0.0
    for name, of in facts.items():
        a, b = (PAIRS / f"{name}_{side}.off" for side in "ab")
        out = WORK / "result.goblin"
        try:
            a, b = model_of(a, of["grid"]), model_of(b, of["grid"])
        except (subprocess.CalledProcessError, OSError):
            failed["refused"] += 16
            rows.append([name, of["triangles"], "not built"] + ["-"] * 7)
            continue
        volumes, files, seconds = {}, [], 0.0
        for code in range(16):
            began = os.times()
            command = [str(word) for word in (SPINNEY, "-q", "combine", code, a, b, "-o", out)]
            refused = subprocess.run(command, capture_output=True, text=True)
            ended = os.times()
            seconds += ended.children_user + ended.children_system - began.children_user - began.children_system
            if refused.returncode:
                print(f"{name}, {code}: {(refused.stderr.strip().split(chr(10)) or [''])[0]}", file=sys.stderr)
                continue
            files.append(WORK / f"result_{code}.off")
            spinney("-q", "export", out, files[-1])
            volumes[code] = facts_of(out)["volume"] or 0.0
        is_open = sum(not fine for fine in inside("closed", *files)) if files else 0
        known = {peer: found for peer, found in [("libigl", of), ("manifold", of["manifold"])] if "both" in found}
        union = next((sum(found[key] for key in ("both", "a_only", "b_only")) for found in known.values()), math.nan)
        errors = {
            peer: max((abs(value - minterms(code, found)) / union for code, value in volumes.items()), default=math.nan)
            for peer, found in known.items()
        }
        # A and B together are their union plus their intersection.
        volumes_of_inputs, whole, parts = [facts_of(model)["volume"] for model in (a, b)], volumes.get(7, math.nan), (1, 2, 4)
        ours = {key: volumes.get(code, math.nan) for key, code in zip(("both", "a_only", "b_only"), parts)}
        sums = [abs(whole + ours["both"] - sum(volumes_of_inputs)) / union, residual(ours, *volumes_of_inputs), abs(sum(ours.values()) - whole) / union]
        sums += [abs(volumes[code] + volumes[15 - code]) / union for code in range(8) if {code, 15 - code} <= volumes.keys()]
        theirs = {peer: residual(found, found["a"], found["b"]) for peer, found in known.items()}
        error = errors.get("libigl", errors.get("manifold", math.nan))
        if len(known) == 2 and volumes:
            differ = max(abs(known["libigl"][key] - known["manifold"][key]) for key in ("both", "a_only", "b_only")) / union
            theirs_worst = max(theirs_worst, differ)
            if differ > GOAL:
                near = min(errors, key=errors.get)
                sound = min(theirs, key=theirs.get)
                disputes.append([name, f"{differ:.1e}", near, f"{errors[near]:.1e}", sound, f"{theirs[sound]:.1e}"])
        failed["open"] += is_open
        failed["refused"] += 16 - len(volumes)
        failed["off"] += not error <= GOAL
        worst = max(worst, error)
        show = lambda found, peer: f"{found[peer]:.1e}" if peer in found else "-"  # noqa: E731
        rows.append(
            [name, of["triangles"], show(errors, "libigl"), show(errors, "manifold"), f"{max(sums):.1e}"]
            + [show(theirs, "libigl"), show(theirs, "manifold"), is_open, 16 - len(volumes), f"{seconds:.2f}"]
        )
        for file in [*files, a, b, out]:
            file.unlink(missing_ok=True)
    head = ["pair", "triangles", "off libigl's volumes, largest of 16", "off manifold3d's", "sums: ours", "libigl", "manifold3d"]
    table([*head, "not closed", "refused", "ours, 16 operations, CPU s"], rows)
    print(f"{len(rows)} pairs, {16 * len(rows)} operations: {failed['open']} not closed, {failed['refused']} refused;", end=" ")
    print(f"volumes of {failed['off']} pairs are off by more than {GOAL:g}, the largest by {worst:.1e} of A or B")
    print()
    if len(rows) == 40:
        record("exact models", [
            row("forty pairs, sixteen operations: refused or open results", f"of {16 * len(rows)}", failed["refused"] + failed["open"]),
            row("forty pairs, sixteen operations: maximum error of volumes", "of the volume", worst, "manifold3d", theirs_worst,
                note="Against sums of libigl's minterms."),
        ])
    if disputes:
        table(["libigl and manifold3d differ", "by", "ours is nearer to", "off by", "sums are right by", "off by"], disputes)


def peer_median(peer, code, a, b, times):
    """Returns None if libigl is too slow."""
    try:
        found = [inside("measured", peer, code, a, b, timeout=PLENTY if peer == "libigl" else None) for _ in range(times)]
    except subprocess.TimeoutExpired:
        return None
    seconds = [statistics.median(column) for column in zip(*(run["seconds"] for run in found))]
    return {**found[0], "seconds": seconds, "peak": statistics.median(run["peak"] for run in found)}


def operations(bodies, peers=("manifold3d", "libigl"), codes=SHOWN):
    """Prints a table row for each operation: solids are names, mesh files and the grid unit."""
    rows, results, times = [], [], int(os.environ.get("RUNS", 3))
    for name, a, b, width in bodies:
        first, second, out = model_of(a, width), model_of(b, width), WORK / "result.goblin"
        slow = set()
        for code in codes:
            cpu, wall, peak = runs([SPINNEY, "-q", "--threads", 1, "combine", code, first, second, "--memory", "3G", "-o", out])
            ours = facts_of(out)["volume"] or 0.0
            shown, job = [name, NAMES[code], f"{cpu:.2f}", f"{peak:.0f}"], f"{name}: {NAMES[code]}"
            if len(codes) == 1:
                job = name
                results.append(row(f"{job}, wall", "s", wall))
            for peer in ("manifold3d", "libigl"):
                theirs = peer_median(peer, code, a, b, times) if peer in peers and peer not in slow else None
                if theirs is None:
                    shown += [f"over {PLENTY}" if peer in peers else "-"] + ["-"] * (6 if peer == "manifold3d" else 3)
                    slow.add(peer)
                    continue
                alone, total = theirs["seconds"][-1], sum(theirs["seconds"])
                differ = f"{abs(ours - theirs['volume']) / abs(theirs['volume'] or math.nan):.1e}"
                known = "manifold3d, with import" if peer == "manifold3d" else peer
                results.append(row(job, "CPU s", cpu, known, total if peer == "manifold3d" else alone))
                results.append(row(f"{job}: memory", "MiB", peak, known, theirs["peak"]))
                if peer == "manifold3d":
                    results.append(row(job, "CPU s", cpu, "manifold3d, in memory", alone, note="Ours is from file to file."))
                    shown += [f"{alone:.2f}", f"{total:.2f}", f"{theirs['peak']:.0f}", f"{cpu / alone:.2f}", f"{cpu / total:.2f}"]
                    shown += [f"{peak / theirs['peak']:.2f}", differ]
                else:
                    shown += [f"{alone:.2f}", f"{theirs['peak']:.0f}", f"{cpu / alone:.2f}", differ]
            rows.append(shown)
        for model in (first, second, out):
            model.unlink(missing_ok=True)
    head = ["bodies", "operation", "ours, CPU s", "MiB", "manifold3d, CPU s", "with import", "MiB", "CPU ours / theirs", "/ with import"]
    table([*head, "MiB ours / theirs", "volumes differ", "libigl, CPU s", "MiB", "CPU ours / theirs", "volumes differ"], rows)
    record("exact models", results)


def armadillo():
    if not (MESH / "armadillo.ply").exists():
        return print("skipped: no test data in ../shared/data/mesh\n")
    facts = inside("make", "armadillo", "armadillo.ply", "bunny_hr.ply", "scaled", ".ply")
    print(f"armadillo and bunny_hr, {facts['triangles']} triangles")
    print()
    operations([("armadillo, bunny", PAIRS / "armadillo_a.ply", PAIRS / "armadillo_b.ply", facts["grid"])])


def coplanar():
    """A solid with a copy that coincides with some of its own faces."""
    bodies = []
    for name, mesh, how in [("cubes", "cube", "slid"), ("fandisk", "fandisk.ply", "slid")]:
        if "." in mesh and not (MESH / mesh).exists():
            continue
        facts = inside("make", f"coplanar_{name}", mesh, mesh, how, ".ply")
        bodies.append((f"{name}, {how}", *(PAIRS / f"coplanar_{name}_{side}.ply" for side in "ab"), facts["grid"]))
    operations(bodies)


def large():
    """Only the union: libigl would take hours."""
    a, b = PAIRS / "torus_large_a.ply", PAIRS / "torus_large_b.ply"
    python(TORUS, 4000, 1600, a)
    width = inside("tori", a, b)
    operations([("union of two tori of 12.8 million triangles", a, b, width)], ("manifold3d",), (7,))
    a.unlink()
    b.unlink()


def main():
    if sys.argv[1:2] == ["inside"]:
        return INSIDE[sys.argv[2]](*sys.argv[3:])
    start(data=False, peer="python3")
    PAIRS.mkdir(parents=True, exist_ok=True)
    if not {"numpy", "manifold3d", "igl"} <= install():
        sys.exit("NumPy, manifold3d and libigl are needed")
    words = [word for word in sys.argv[1:] if not word.startswith("--")]
    parts = {"pairs": lambda: pairs([word for word in words if word not in parts]), "armadillo": armadillo}
    parts.update(coplanar=coplanar, large=large)
    requested = [part for part in parts if part in words] or ["pairs", "armadillo", "coplanar"]
    if "--large" in sys.argv and "large" not in requested:
        requested.append("large")
    for part in requested:
        parts[part]()


if __name__ == "__main__":
    main()
