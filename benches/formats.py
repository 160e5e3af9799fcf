#!/usr/bin/env python3
"""Both formats with the same trees: CPU time of building, bytes, and the savings from storing equal
subtrees once.

    python3 benches/formats.py

Solids need benches/peers/work/armadillo_0.ply, which benches/peers/solids.py makes.
"""

import json
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "peers"))
from common import CLASSES, EARTH, RELIEF, SHORELINE, SPINNEY, WORK, runs, start, table, verdict


def build(source, target, *options):
    """Returns median CPU seconds and peak MiB of building a file, and its bytes."""
    measured = []
    for _ in range(3):
        target.unlink(missing_ok=True)
        measured.append(runs([SPINNEY, "build", "-q", source, "-o", target, *options], times=1))
    cpu, _, peak = sorted(measured)[1]
    return cpu, peak, target.stat().st_size


def main():
    start(peer="true")
    inputs = [(source, source.name.split("_")[0], []) for source in (SHORELINE, EARTH, RELIEF, CLASSES)]
    solid = WORK / "armadillo_0.ply"
    if solid.exists():
        inputs += [(solid, f"armadillo at {cells}", ["--cells", str(cells)]) for cells in (1024, 4096)]
    rows, shares = [], []
    for source, name, options in inputs:
        goblin = build(source, WORK / "f.goblin", *options)
        plain = build(source, WORK / "f.autumn", *options)
        shared = build(source, WORK / "s.autumn", *options, "--share")
        info = json.loads(subprocess.check_output([SPINNEY, "info", "--json", WORK / "s.autumn"]))["commit"]
        rows.append([name, f"{goblin[0]:.2f}", f"{plain[0]:.2f}", verdict(plain[0] / goblin[0], 1.5, least=False),
                     f"{goblin[1]:.0f}", f"{plain[1]:.0f}", f"{plain[2] / goblin[2]:.2f}"])
        shares.append([name, info["records"], info["written_records"], f"{info['records'] / info['written_records']:.1f}",
                       f"{plain[2] / shared[2]:.1f}", f"{shared[0] / plain[0]:.2f}"])
    table(["build", "Goblin CPU s", "Autumnal CPU s", "ratio", "Goblin MiB", "Autumnal MiB", "bytes, Autumnal / Goblin"], rows)
    table(["--share", "records", "written", "ratio", "bytes, plain / shared", "CPU, shared / plain"], shares)


if __name__ == "__main__":
    main()
