#!/usr/bin/env python3
"""3D Tiles of the armadillo in 4096 cells, compared with our own meshes of all its levels:
processor time, wall time, peak memory, bytes.

No peer makes tilesets of octrees: the baseline is the smooth meshes of the same levels as PLY, each
written separately.
"""

import shutil
import statistics

from common import ROOT, SPINNEY, WORK, costs, once, record, row, start, table, tree, verdict

MODEL = ROOT.parent / "shared" / "data" / "mesh" / "armadillo.ply"
LEVELS = range(6, 13)


def size(path):
    files = [path] if path.is_file() else path.rglob("*")
    return sum(file.stat().st_size for file in files if file.is_file()) / 2**20


def main():
    start(data=False, peer="python3")
    if not MODEL.exists():
        print("skipped: no test data in ../shared/data/mesh")
        return
    solid, directory, mesh = WORK / "armadillo_4096.goblin", WORK / "tileset", WORK / "level.ply"
    tree(MODEL, solid, "--cells", "4096")

    def export(*options):
        # A new directory each: after thousands of files are removed, a file system may take long to
        # create as many.
        found = []
        for number in range(3):
            target = directory.with_name(f"{directory.name}{number}")
            shutil.rmtree(target, ignore_errors=True)
            found.append([*once([SPINNEY, "-q", "export", solid, target / "tileset.json", "--smooth", *options]), size(target)])
        for number in range(3):
            shutil.rmtree(directory.with_name(f"{directory.name}{number}"))
        return [statistics.median(column) for column in zip(*found)]

    def meshes():
        found = []
        for level in LEVELS:
            found.append([*once([SPINNEY, "-q", "export", solid, mesh, "--smooth", "--level", str(level)]), size(mesh)])
            mesh.unlink()
        cpu, wall, memory, written = zip(*found)
        return [sum(cpu), sum(wall), max(memory), sum(written)]

    plain = [statistics.median(column) for column in zip(*(meshes() for _ in range(3)))]
    rows = [["PLY of levels 6 to 12", *plain, ""]]
    job = "3D Tiles of the armadillo, 4096 cells"
    results = [row("smooth PLY of levels 6 to 12 of the armadillo", "CPU s", plain[0])]
    for what, options in [("3D Tiles", []), ("one thread", ["--threads", "1"]), ("--meshopt", ["--meshopt"])]:
        found = export(*options)
        name = ", ".join([job, " ".join(options)] if options else [job])
        results += [*costs(name, found, memory=False), row(f"{name}: bytes", "GB", found[3] * 2**20 / 1e9)]
        rows.append([what, *found, f"{verdict(found[1] / plain[1], 2, False)}; CPU {found[0] / plain[0]:.3g}"])
    shown = [[row[0], *(f"{number:.3g}" for number in row[1:5]), row[5]] for row in rows]
    table(["smooth surface", "CPU s", "s", "MiB", "MiB written", "time by that of PLY"], shown)
    record("tiles, COG, warping", results)


if __name__ == "__main__":
    main()
