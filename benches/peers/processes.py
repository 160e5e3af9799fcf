#!/usr/bin/env python3
"""Four Python processes on one file against one: windows per second, and proportional memory (PSS).

Run it with a Python that has the package: python benches/peers/processes.py
"""

import multiprocessing
import random
import time

import spinney
from common import SHORELINE, WORK, record, row, start

SECONDS = 4.0


def pss():
    """Returns proportional bytes of this process: shared pages count fractionally."""
    with open("/proc/self/smaps_rollup") as file:
        return next(int(line.split()[1]) * 1024 for line in file if line.startswith("Pss:"))


def read(path, seed, begin, results):
    random.seed(seed)
    with spinney.open(path) as ds:
        ds.read(1, window=(0, 0, 256, 256))
        begin.wait()
        ends, count = time.monotonic() + SECONDS, 0
        while time.monotonic() < ends:
            level = random.randrange(ds.depth - 7, ds.depth + 1)
            height, width = ds.level(level).shape
            x, y = random.randrange(max(1, width - 256)), random.randrange(max(1, height - 256))
            ds.level(level)[y : y + 256, x : x + 256]
            count += 1
        begin.wait()
        results.put((count / SECONDS, pss()))
        begin.wait()


def run(path, processes):
    context = multiprocessing.get_context("spawn")
    begin, results = context.Barrier(processes), context.Queue()
    started = [context.Process(target=read, args=(path, seed, begin, results)) for seed in range(processes)]
    for process in started:
        process.start()
    found = [results.get() for _ in started]
    for process in started:
        process.join()
    return sum(rate for rate, _ in found), sum(memory for _, memory in found)


def main():
    start()
    path = str(WORK / "shoreline.goblin")
    if not (WORK / "shoreline.goblin").exists():
        spinney.build(SHORELINE, path, kind="categorical")
    one, four = run(path, 1), run(path, 4)
    print(f"one process: {one[0]:,.0f} windows/s, {one[1] / 1e6:.1f} MB; four: {four[0]:,.0f} windows/s, {four[1] / 1e6:.1f} MB")
    print(f"rate {four[0] / one[0]:.2f} times, memory {four[1] / one[1]:.2f} times")
    job = "windows, shoreline, four processes"
    record("windows and points", [row(job, "/s", four[0]), row(f"{job}: proportional memory", "MB", four[1] / 1e6)])


if __name__ == "__main__":
    main()
