#!/usr/bin/env python3
"""Isosurfaces: `spinney contours` of octrees against scikit-image's marching cubes on the same
volumes in memory.

    isosurfaces.py [SIDE]

Ours is the whole program, from the tree to a PLY file; theirs is reported alone, and with reading
NPY and writing PLY. Volumes of f32 are a ball and a gyroid, whose surface fills the space. The
program is target/release/spinney, or SPINNEY. Vertices and area are compared with theirs.
"""

import json
import subprocess
import sys

from common import SPINNEY, WORK, costs, once, record, row, runs, start, table

VENV = WORK / "skimage_venv"
PYTHON = VENV / "bin" / "python"

MAKE = """
import sys
import numpy as np
kind, side, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
x = (np.arange(side, dtype='<f4') + 0.5) / side
turn = np.float32(2 * np.pi * 6) * x
with open(out, 'wb') as file:
    np.lib.format.write_array_header_1_0(file, {'descr': '<f4', 'fortran_order': False, 'shape': (side, side, side)})
    for z, t in zip(x, turn):
        if kind == 'ball':
            plane = np.float32(0.4) - np.sqrt((x[None, :] - 0.5) ** 2 + (x[:, None] - 0.5) ** 2 + (z - 0.5) ** 2)
        else:
            plane = np.sin(turn)[None, :] * np.cos(turn)[:, None] + np.sin(turn)[:, None] * np.cos(t) + np.sin(t) * np.cos(turn)[None, :]
        file.write(plane.astype('<f4').tobytes())
"""

# In the tree's order and coordinates: x, y, z, with cell centres at halves.
PEER = """
import json, sys, time
import numpy as np
from skimage.measure import marching_cubes
raw, out = sys.argv[1], sys.argv[2]
volume = np.load(raw)
began = time.process_time()
points, faces = marching_cubes(volume, 0.0)[:2]
alone = time.process_time() - began
points = points[:, ::-1] + np.float32(0.5)
rows = np.empty(len(faces), np.dtype([('n', 'u1'), ('v', '<i4', 3)]))
rows['n'], rows['v'] = 3, faces
with open(out, 'wb') as file:
    head = 'ply\\nformat binary_little_endian 1.0\\nelement vertex %d\\nproperty float x\\nproperty float y\\nproperty float z\\n'
    head += 'element face %d\\nproperty list uchar int vertex_indices\\nend_header\\n'
    file.write((head % (len(points), len(faces))).encode())
    file.write(points.astype('<f4').tobytes())
    file.write(rows.tobytes())
print(json.dumps(alone))
"""

COMPARE = """
import json, sys
import numpy as np
def read(path):
    data = open(path, 'rb').read()
    end = data.index(b'end_header\\n') + 11
    count = lambda name: int(next(line for line in data[:end].decode().split('\\n') if line.startswith('element ' + name)).split()[2])
    points = np.frombuffer(data, '<f4', count('vertex') * 3, end).reshape(-1, 3).astype('f8')
    faces = np.frombuffer(data, np.dtype([('n', 'u1'), ('v', '<i4', 3)]), count('face'), end + points.shape[0] * 12)['v']
    a, b, c = (points[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return points, len(faces), np.linalg.norm(normals, axis=1).sum() / 2
(ours, *mine), (theirs, *others) = read(sys.argv[1]), read(sys.argv[2])
# By the edges that they are on: what is not whole between centres is a place on one.
def rounded(points):
    at = points - 0.5
    axis = np.abs(at - at.round()).argmax(axis=1)
    cells = at.round().astype('i8')
    rows = np.arange(len(at))
    cells[rows, axis] = np.floor(at[rows, axis])
    key = ((cells[:, 2] << 20 | cells[:, 1]) << 20 | cells[:, 0]) * 3 + axis
    order = np.argsort(key)
    return key[order], points[order]
(a, p), (b, q) = rounded(ours), rounded(theirs)
same, i, j = np.intersect1d(a, b, return_indices=True)
distance = float(np.abs(p[i] - q[j]).max()) if len(same) else 0.0
print(json.dumps([len(ours), len(theirs), len(same), distance, mine, others]))
"""


def main():
    start(data=False, peer="python3")
    side = int(sys.argv[1]) if len(sys.argv) > 1 else 512
    if not PYTHON.exists():
        subprocess.run([sys.executable, "-m", "venv", VENV], check=True)
    subprocess.run([PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "scikit-image", "numpy"], check=True)
    print("scikit-image " + subprocess.run([PYTHON, "-c", "import skimage; print(skimage.__version__)"], check=True, capture_output=True, text=True).stdout)
    rows, results = [], []
    for kind in ("ball", "gyroid"):
        raw, tree = WORK / f"{kind}.npy", WORK / f"{kind}.goblin"
        ours, theirs, result = WORK / f"{kind}.ply", WORK / f"{kind}_peer.ply", WORK / "isosurface.json"
        subprocess.run([PYTHON, "-c", MAKE, kind, str(side), raw], check=True)
        subprocess.run([SPINNEY, "-q", "build", raw, "-o", tree], check=True)
        # Mapped files count as memory.
        cpu, wall, peak = runs([SPINNEY, "-q", "contours", tree, "--at", "0", "-o", ours, "--positioned"])
        with open(result, "w") as file:
            whole, slow, more = once([PYTHON, "-c", PEER, raw, theirs], stdout=file)
        alone = json.loads(result.read_text())
        found = subprocess.run([PYTHON, "-c", COMPARE, ours, theirs], check=True, capture_output=True, text=True).stdout
        mine, others, same, distance, (count, area), (faces, their_area) = json.loads(found)
        rows.append(
            [f"{kind}, {side}^3", count, faces, f"{cpu:.2f}", f"{wall:.2f}", f"{peak:.0f}", f"{alone:.2f}", f"{whole:.2f}", f"{slow:.2f}", f"{more:.0f}"]
            + [f"{same} of {max(mine, others)}", f"{distance:.1e}", f"{abs(area / their_area - 1):.1e}"]
        )
        job = f"isosurface of a {kind}, {side}^3"
        results += costs(job, (cpu, wall, peak), "scikit-image, with files", (whole, slow, more))
        results.append(row(job, "CPU s", cpu, "scikit-image, in memory", alone))
        for file in (raw, tree, ours, theirs, result):
            file.unlink()
    head = ["volume", "triangles", "theirs", "ours, CPU s", "wall", "MiB", "theirs alone, CPU s", "with files", "wall", "MiB"]
    table([*head, "same vertices", "distance, cells", "areas differ"], rows)
    record("contours and isosurfaces", results)


if __name__ == "__main__":
    main()
