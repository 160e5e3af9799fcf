"""Common code of these scripts: paths, measured runs, tables, recorded results.

With RECORD=1 in the environment, a script also merges its figures into benches/results.json, and
writes benches/RESULTS.md. A script in another language passes its rows (JSON) on standard input:

    RECORD=1 python3 benches/peers/common.py AREA SCRIPT [ARGUMENT...]
"""

import datetime
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data" / "raster" / "large"
WORK = ROOT / "benches" / "peers" / "work"
RESULTS = ROOT / "benches" / "results.json"
# Fields of a row of results; those without a value are not stored.
FIELDS = ["area", "job", "peer", "peer_figure", "ours", "ratio", "unit", "command", "machine", "date", "commit", "note"]
# Variables that change what a script measures: a row's command has them.
SETTINGS = ["RUNS", "CODEC", "SIDE", "FILES", "SECONDS", "REQUESTS"]
SPINNEY = Path(os.environ.get("SPINNEY", ROOT / "target" / "release" / "spinney"))
SHORELINE = DATA / "shoreline_43200x21600_u8.tif"
CLASSES = DATA / "classes12_8192x4096_u8.tif"
EARTH = DATA / "earth_8192x4096_rgb.jpg"
RELIEF = DATA / "relief_4320x2160_i16.tif"


def start(data=True, peer="gdal_translate"):
    """Exits with a message if the data does not exist."""
    # Background jobs inherit ignored signals.
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    if data and not DATA.is_dir():
        print("skipped: no test data in ../shared/data/raster/large")
        sys.exit(0)
    WORK.mkdir(parents=True, exist_ok=True)
    if not SPINNEY.exists():
        subprocess.run(["cargo", "build", "--release"], cwd=ROOT, check=True)
    if not shutil.which(peer):
        sys.exit("run benches/peers/install.sh first")


def once(command, stdin=None, stdout=subprocess.DEVNULL):
    """Returns CPU seconds, wall seconds and peak MiB of one run.

    A child inherits its parent's peak memory: do not import NumPy in processes that call this.
    """
    import time

    began = time.perf_counter()
    # Its standard error is visible.
    process = subprocess.Popen([str(word) for word in command], stdin=stdin, stdout=stdout)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"failed: {' '.join(map(str, command))}")
    return usage.ru_utime + usage.ru_stime, wall, usage.ru_maxrss / 1024


def private_memory(pid):
    """Returns MiB of a process's memory, without mapped files; 0 after its end."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("RssAnon")), 0) / 1024


def runs(command, times=3, **more):
    """Returns medians of several runs; $RUNS limits their number."""
    times = min(times, int(os.environ.get("RUNS", times)))
    return [statistics.median(column) for column in zip(*(once(command, **more) for _ in range(times)))]


def table(head, rows):
    print("| " + " | ".join(head) + " |")
    print("|" + " --- |" * len(head))
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |", flush=True)
    print(flush=True)


def verdict(ratio, target, least=True):
    met = ratio >= target if least else ratio <= target
    return f"{ratio:.3g} ({'met' if met else 'MISSED'})"


def cog(source, target, *options):
    """Makes a COG with GDAL, if it does not exist."""
    if not target.exists():
        once(["gdal_translate", "-q", "-of", "COG", *[word for option in options for word in ("-co", option)], source, target])


def tree(source, target, *options):
    if not target.exists():
        once([SPINNEY, "-q", "build", source, "-o", target, *options])


def row(job, unit, ours, peer=None, theirs=None, **more):
    """Returns a row for `record`."""
    return {"job": job, "peer": peer, "peer_figure": theirs, "ours": ours, "unit": unit, **more}


def costs(job, ours, peer=None, theirs=(None,) * 3, wall=True, memory=True, **more):
    """Returns rows of CPU seconds, wall seconds and peak MiB, which `once` and `runs` return."""
    columns = [("", "CPU s", True), (", wall", "s", wall), (": memory", "MiB", memory)]
    return [row(job + end, unit, own, peer, other, **more) for (end, unit, used), own, other in zip(columns, ours, theirs) if used]


def rounded(value):
    return value if not isinstance(value, float) else round(value) if value >= 100 else float(f"{value:.3g}")


def record(area, rows):
    """With RECORD=1, merges rows into benches/results.json by (area, job, peer), and writes
    benches/RESULTS.md.

    The ratio is ours / peer_figure, of rates (units ending in /s) the inverse. COMMIT is the commit
    SPINNEY was built from; the default is HEAD.
    """
    if os.environ.get("RECORD") != "1":
        return

    def key(row):
        return row["area"], row["job"], row.get("peer")

    head = ["git", "rev-parse", "--short=8", "HEAD"]
    settings = [f"{name}={os.environ[name]}" for name in SETTINGS if name in os.environ]
    common = {
        "area": area,
        "command": " ".join([*settings, "benches/peers/" + Path(sys.argv[0]).name, *sys.argv[1:]]),
        "machine": f"{os.cpu_count()} cores",
        "date": str(datetime.date.today()),
        "commit": os.environ.get("COMMIT") or subprocess.check_output(head, cwd=ROOT, text=True).strip(),
    }
    merged = {key(row): row for row in json.loads(RESULTS.read_text(encoding="utf-8"))}
    for row in rows:
        row = common | row
        ours, theirs = row["ours"], row.get("peer_figure")
        if "ratio" not in row and ours is not None and theirs:
            row["ratio"] = float(f"{theirs / ours if row['unit'].endswith('/s') else ours / theirs:.3g}")
        merged[key(row)] = {field: rounded(row[field]) for field in FIELDS if row.get(field) is not None}
    lines = ",\n".join(json.dumps(row, ensure_ascii=False) for row in merged.values())
    RESULTS.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
    subprocess.run([sys.executable, ROOT / "benches" / "render_results.py"], check=True)


if __name__ == "__main__":
    _, area, *sys.argv = sys.argv
    record(area, json.load(sys.stdin))
