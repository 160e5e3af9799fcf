"""What the scripts here share: places, measured runs, tables."""

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
SPINNEY = Path(os.environ.get("SPINNEY", ROOT / "target" / "release" / "spinney"))
SHORELINE = DATA / "shoreline_43200x21600_u8.tif"
CLASSES = DATA / "classes12_8192x4096_u8.tif"
EARTH = DATA / "earth_8192x4096_rgb.jpg"
RELIEF = DATA / "relief_4320x2160_i16.tif"


def start(data=True, peer="gdal_translate"):
    """Leaves, saying so, if the data are not there."""
    # Jobs in the background inherit ignored interrupts.
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
    """CPU seconds, wall seconds and peak MiB of one run.

    A child inherits its parent's peak: keep NumPy out of processes that call this.
    """
    import time

    began = time.perf_counter()
    # What it says on standard error shows.
    process = subprocess.Popen([str(word) for word in command], stdin=stdin, stdout=stdout)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"failed: {' '.join(map(str, command))}")
    return usage.ru_utime + usage.ru_stime, wall, usage.ru_maxrss / 1024


def runs(command, times=3, **more):
    """Medians of several runs; of RUNS if that is in the environment."""
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
    """A COG made by GDAL, if it is not there yet."""
    if not target.exists():
        once(["gdal_translate", "-q", "-of", "COG", *[word for option in options for word in ("-co", option)], source, target])


def tree(source, target, *options):
    if not target.exists():
        once([SPINNEY, "-q", "build", source, "-o", target, *options])
