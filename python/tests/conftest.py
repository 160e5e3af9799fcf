"""Common fixtures: paths, the program, random trees."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import spinney

ROOT = Path(__file__).parents[2]
FIXTURES = ROOT / "fixtures"
FILES = sorted(path for path in (FIXTURES / "v1").glob("*.*") if not path.stem.startswith(("chapel", "crossing")))
STACKS = [path for path in FILES if path.stem == "stack"]
TREES = [path for path in FILES if path not in STACKS] + [Path(f"{path}:{name}") for path in STACKS for name in spinney.open(path).names]
QUADTREES = [path for path in TREES if path.stem not in ("ball", "segments")]

BOX = (
    np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0], [0, 0, 4], [2, 0, 4], [2, 3, 4], [0, 3, 4]], float),
    np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], *([a, b, b + 4] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))),
              *([a, b + 4, a + 4] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)))]),
)
"""Vertices and triangles of a box of 2 x 3 x 4."""

settings.register_profile(
    "spinney", derandomize=True, deadline=None, suppress_health_check=list(HealthCheck), max_examples=60, database=None
)
settings.load_profile("spinney")


@pytest.fixture
def enabled_ctrl_c() -> Iterator[None]:
    """Enables Ctrl-C, which shells disable for background processes."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    # (An exception during the garbage collector's callbacks is lost.)
    gc.disable()
    yield
    gc.enable()
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def island(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A tree of the island's classes."""
    path = str(tmp_path_factory.mktemp("island") / "island.goblin")
    spinney.build(FIXTURES / "island_classes.tif", path)
    return path


@pytest.fixture(scope="session")
def relief(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A tree of the island's elevation."""
    path = str(tmp_path_factory.mktemp("relief") / "relief.goblin")
    spinney.build(FIXTURES / "island_elevation.tif", path)
    return path


@pytest.fixture
def history(tmp_path: Path) -> str:
    """A copy of an Autumnal file."""
    path = tmp_path / "history.autumn"
    path.write_bytes((FIXTURES / "v1" / "history.autumn").read_bytes())
    return str(path)


@pytest.fixture(scope="session")
def program() -> str:
    """The program, if it has been built."""
    path = os.environ.get("SPINNEY_PROGRAM", str(ROOT / "target" / "debug" / "spinney"))
    if not os.path.exists(path):
        pytest.skip(f"there is no program at {path}; set SPINNEY_PROGRAM")
    return path


def run(program: str, *words: object) -> str:
    """Returns the program's standard output."""
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def noise(shape: tuple[int, ...], dtype: str, seed: int = 1) -> np.ndarray:
    """Returns samples with uniform blocks and noise."""
    random = np.random.default_rng(seed)
    small = random.integers(0, 200, tuple(-(-length // 16) for length in shape))
    array = small
    for axis, length in enumerate(shape):
        array = np.repeat(array, 16, axis=axis).take(range(length), axis=axis)
    specks = random.random(shape) < 0.05
    array = np.where(specks, random.integers(0, 250, shape), array)
    return array.astype(dtype)
