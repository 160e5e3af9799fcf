#!/usr/bin/env python3
"""Trees of points against COPC (copclib's writer, laspy's reader) and SciPy's cKDTree: a synthetic
scan over the relief.

    python benches/peers/points.py [POINTS]        (default: 20 million; 100 million for RESULTS.md)

Needs a Python with the package and the peers: pip install ./python numpy "laspy[lazrs]" scipy
copclib pillow. Everything runs on one thread; processor seconds.

The scan: flight lines with a zigzag scanner, 4 points per square metre over land of the relief,
several returns at trees, in LAS of point format 6 with a resolution of 1 cm. copclib only packs and
writes: the nodes are made in NumPy, which counts, as its users have to do so.
"""

import json
import os
import subprocess
import sys
import time

import numpy as np
from common import DATA, RELIEF, SPINNEY, WORK, once, record, row, start, table, verdict

COUNT = int(float(sys.argv[1])) if len(sys.argv) == 2 else 20_000_000
# Points of the peer's file: NumPy has all of them in memory.
PEERS = min(COUNT, 10_000_000)
BATCH = 1_000_000
BOXES = 40
NAMES = {10**power: f"10^{power}" for power in range(6, 10)}


def heights():
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None
    cells = np.array(Image.open(RELIEF))[400:1000, 2200:2800] * 0.3

    def height(x, y):
        fx, fy = x / 12, y / 12
        ix, iy = np.minimum(fx.astype(int), 598), np.minimum(fy.astype(int), 598)
        u, v = fx - ix, fy - iy
        u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
        upper = cells[iy, ix] * (1 - u) + cells[iy, ix + 1] * u
        lower = cells[iy + 1, ix] * (1 - u) + cells[iy + 1, ix + 1] * u
        return upper * (1 - v) + lower * v

    return height


def scan(path, count):
    """Writes the scan."""
    import laspy

    height, side = heights(), min(np.sqrt(count / 4.0), 598 * 12)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.01] * 3, [500000, 5200000, 0]
    lines = max(1, int(np.ceil(side / 400)))
    with laspy.open(path, "w", header=header) as out:
        for line in range(lines):
            points = count // lines + (count % lines if line == 0 else 0)
            left, width = line * 400, min(500.0, side - line * 400)
            for first in range(0, points, BATCH):
                random = np.random.default_rng((1, line, first))
                number = np.arange(first, min(first + BATCH, points))
                pulse = (number / 1.25).astype(np.int64)
                is_later = np.concatenate([[False], pulse[1:] == pulse[:-1]])
                is_first = np.concatenate([is_later[1:], [False]])
                phase = pulse % 800 / 800
                across = np.where(pulse // 800 % 2 == 0, phase, 1 - phase)
                along = pulse / (points / 1.25) * side
                noise = random.normal(0, 0.08, (2, len(number)))
                noise = np.where(is_later, np.roll(noise, 1, axis=1), noise)
                x = np.clip(left + across * width + noise[0], 0, side)
                y = np.clip((side - along if line % 2 else along) + noise[1], 0, side)
                is_wood = np.sin(x / 37) + np.sin(y / 53) > 0.5
                above = np.where(is_wood & ~is_later, random.gamma(2, 3, len(number)), 0)
                rows = laspy.ScaleAwarePointRecord.zeros(len(number), header=header)
                rows.x, rows.y = 500000 + x, 5200000 + y
                rows.z = height(x, y) + random.normal(0, 0.03, len(number)) + above
                rows.classification = np.where(above > 0.5, 5, 2)
                rows.intensity = np.clip(random.normal(np.where(above > 0.5, 400, 900), 120), 0, 65535).astype(np.uint16)
                rows.return_number = np.where(is_later, 2, 1)
                rows.number_of_returns = np.where(is_later | is_first, 2, 1)
                rows.scan_direction_flag = pulse // 800 % 2
                rows.scan_angle = ((across - 0.5) * 40 / 0.006).astype(np.int16)
                rows.point_source_id = np.full(len(number), line + 1)
                rows.gps_time = 3e8 + line * 600 + pulse / 4e5
                out.write_points(rows)


def copc(source, target):
    """Makes a COPC file of a scan: runs as a separate process, whose processor time counts."""
    import copclib
    import laspy

    las = laspy.read(source)
    rows = las.points.array
    positions = np.stack([rows[axis].astype(np.int64) for axis in "XYZ"], 1)
    corner, span = positions.min(0), int((positions.max(0) - positions.min(0)).max()) + 1
    depth = int(span - 1).bit_length()
    cells = positions - corner
    level = np.full(len(rows), -1)
    # The first point for each of 128 subdivisions of a side, from the root down.
    for at in range(0, 8):
        left = np.flatnonzero(level < 0)
        shift = max(depth - at - 7, 0)
        part = cells[left] >> shift
        key = part[:, 0] | part[:, 1] << 21 | part[:, 2] << 42
        _, first = np.unique(key, return_index=True)
        level[left[first]] = at
        node = cells[left] >> (depth - at)
        if at == 7 or np.unique(node[:, 0] | node[:, 1] << 21 | node[:, 2] << 42, return_counts=True)[1].max() < 50_000:
            level[left] = np.where(level[left] < 0, at, level[left])
            break
    config = copclib.CopcConfigWriter(6, (0.01,) * 3, tuple(las.header.offsets))
    least = np.array(las.header.mins)
    config.las_header.min, config.las_header.max = tuple(las.header.mins), tuple(las.header.maxs)
    half = (1 << depth) * 0.005
    config.copc_info.halfsize, config.copc_info.spacing = half, half * 2 / 128
    config.copc_info.center_x, config.copc_info.center_y, config.copc_info.center_z = (float(c) + half for c in least)
    writer = copclib.FileWriter(str(target), config)
    key = (cells[:, 0] >> (depth - level)) | (cells[:, 1] >> (depth - level)) << 19 | (cells[:, 2] >> (depth - level)) << 38 | level << 57
    order = np.lexsort((rows["gps_time"], key))
    ends = np.flatnonzero(np.diff(key[order], append=-1)) + 1
    before = 0
    for end in ends:
        chosen = order[before:end]
        before = end
        at = int(level[chosen[0]])
        place = cells[chosen[0]] >> (depth - at)
        bytes_ = copclib.VectorChar(np.frombuffer(rows[chosen].tobytes(), dtype=np.int8))
        packed = copclib.CompressBytes(bytes_, config.las_header)
        writer.AddNodeCompressed(copclib.VoxelKey(at, *map(int, place)), packed, len(chosen))
    writer.Close()


def own(words):
    """Returns processor seconds of a job of this file, in a separate process."""
    return once([sys.executable, __file__, "--job", json.dumps(words)])


def job(name, *words):
    if name == "scan":
        scan(words[0], words[1])
    elif name == "copc":
        copc(*words)
    elif name == "laz":
        import laspy

        laspy.read(words[0]).write(words[1])
    else:
        print(json.dumps(globals()[name](*words)))


def measured(call):
    began = time.process_time()
    found = call()
    return time.process_time() - began, found


def nearest(tree, count):
    """Returns seconds of a million nearest neighbours: ours, building SciPy's tree, its queries;
    and the maximum difference of results."""
    import spinney
    from scipy.spatial import cKDTree

    with spinney.open_points(tree) as points:
        rows = points.read(attributes=[])
        low, high = (np.array([getattr(points.stats()[name], end) for name in "xyz"]) for end in ("min", "max"))
        positions = np.random.default_rng(5).uniform(low, high, (count, 3))
        ours, (distances, _) = measured(lambda: points.nearest(positions, threads=1))
    building, theirs = measured(lambda: cKDTree(np.stack([rows[name] for name in "xyz"], 1)))
    querying, (expected, _) = measured(lambda: theirs.query(positions))
    return [ours, building, querying, float(np.abs(distances[:, 0] - expected).max())]


def boxes(tree, peer, count):
    """Returns seconds of many boxes: ours, laspy's over COPC; and the points of both."""
    import laspy
    import spinney

    random = np.random.default_rng(6)
    found = []
    with spinney.open_points(tree) as points, laspy.CopcReader.open(peer) as reader:
        stats = points.stats()
        low, high = (np.array([getattr(stats[name], end) for name in "xy"]) for end in ("min", "max"))
        corners = random.uniform(low, high - 100, (count, 2))
        began = time.process_time()
        found.append(sum(len(points.read(window=(x, y, x + 100, y + 100), threads=1)) for x, y in corners))
        middle = time.process_time()
        found.append(sum(len(reader.query(laspy.copc.Bounds(mins=[x, y], maxs=[x + 100, y + 100]))) for x, y in corners))
        return [middle - began, time.process_time() - middle, *found]


def run_self(*words):
    """Returns the output of a job of this file, in a separate process."""
    output = subprocess.run([sys.executable, __file__, "--job", json.dumps(words)], check=True, capture_output=True, text=True).stdout
    return json.loads(output.splitlines()[-1])


def main():
    start(peer="true")
    os.environ["RAYON_NUM_THREADS"] = "1"
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    large, small = WORK / f"scan_{COUNT}.las", WORK / f"scan_{PEERS}.las"
    for path, count in ((large, COUNT), (small, PEERS)):
        if not path.exists():
            own(["scan", str(path), count])
    trees, rows, results = {}, [], []
    small_name = NAMES.get(PEERS, f"{PEERS:,}")
    for path, count in ((large, COUNT), (small, PEERS)):
        laz, tree = path.with_suffix(".laz"), path.with_suffix(".goblin")
        if not laz.exists():
            own(["laz", str(path), str(laz)])
        seconds, _, memory = once([SPINNEY, "--quiet", "build", path, "-o", tree, "--memory", "512M"])
        bytes_ = tree.stat().st_size / laz.stat().st_size
        rows.append([f"{count / 1e6:.0f} M points", "spinney, from LAS", f"{seconds:.1f}", verdict(count / seconds / 1e6, 3), f"{memory:.0f}", verdict(bytes_, 1.25, least=False)])
        name = NAMES.get(count, f"{count:,}")
        results.append(row(f"bytes of {name} points", "bytes", tree.stat().st_size, "LAZ", laz.stat().st_size))
        if count > PEERS:
            results.append(row(f"{name} points of LAS to a tree, --memory 512M", "CPU s", seconds))
            results.append(row(f"{name} points of LAS to a tree: memory", "MiB", memory))
        trees[path] = tree
        if path == large and COUNT == PEERS:
            break
    peer, our_seconds, our_bytes = small.with_suffix(".copc.laz"), seconds, bytes_
    seconds, _, memory = own(["copc", str(small), str(peer)])
    bytes_ = peer.stat().st_size / small.with_suffix(".laz").stat().st_size
    rows.append([f"{PEERS / 1e6:.0f} M points", "NumPy and copclib", f"{seconds:.1f}", f"{PEERS / seconds / 1e6:.2f}", f"{memory:.0f}", f"{bytes_:.3f}"])
    note = "The peer works in memory."
    results.append(row(f"{small_name} points of LAS to a tree", "CPU s", our_seconds, "NumPy and copclib, COPC", seconds, note=note))
    results.append(row(f"bytes of {small_name} points", "of LAZ's bytes", our_bytes, "COPC", bytes_))
    table(["scan", "who", "CPU s", "M points/s", "MiB", "bytes, of LAZ"], rows)
    tree = str(trees.get(small, trees[large]))
    ours, building, querying, difference = run_self("nearest", tree, 1_000_000)
    table(["10^6 nearest neighbours", "CPU s"], [["spinney, from the file", f"{ours:.2f}"], ["cKDTree, building", f"{building:.2f}"], ["cKDTree, querying", f"{querying:.2f}"], ["cKDTree / spinney, querying alone", verdict(querying / ours, 1)], ["difference", f"{difference:.1e}"]])
    results.append(row(f"10^6 nearest neighbours of {small_name} points", "CPU s", ours, "SciPy cKDTree, queries alone", querying))
    ours, theirs, found, expected = run_self("boxes", tree, str(peer), BOXES)
    table([f"{BOXES} boxes of 100 m", "CPU s", "points"], [["spinney", f"{ours:.2f}", found], ["laspy over COPC", f"{theirs:.2f}", expected], ["ratio", verdict(theirs / ours, 5), ""]])
    results.append(row(f"{BOXES} boxes of 100 m of {small_name} points", "CPU s", ours, "laspy over COPC", theirs))
    record("trees of points and lines", results)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--job"]:
        job(*json.loads(sys.argv[2]))
    else:
        main()
