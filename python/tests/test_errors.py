"""Errors: of the same classes as those of Python's own functions, without ending the process."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import FIXTURES, FILES
from hypothesis import given
from hypothesis import strategies as st

import spinney


def test_missing_and_corrupt_files(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere") as raised:
        spinney.open(tmp_path / "nowhere.goblin")
    assert raised.value.errno == 2
    with pytest.raises(OSError):
        spinney.open(tmp_path)
    (tmp_path / "text.goblin").write_text("no tree")
    with pytest.raises(OSError, match="text.goblin"):
        spinney.open(tmp_path / "text.goblin")
    with pytest.raises((OSError, ValueError)):
        spinney.open(FIXTURES / "v1" / "history.autumn", commit=999)
    for wrong in (3.5, None, object()):
        with pytest.raises(TypeError):
            spinney.open(wrong)  # type: ignore[arg-type]


@given(path=st.sampled_from(FILES), share=st.floats(0, 1), change=st.integers(1, 255))
def test_corruption_raises_or_is_harmless(tmp_path_factory: pytest.TempPathFactory, path: Path, share: float, change: int) -> None:
    data = bytearray(path.read_bytes())
    data[min(int(share * len(data)), len(data) - 1)] ^= change
    copy = tmp_path_factory.mktemp("corrupt") / path.name
    copy.write_bytes(data)
    try:
        with spinney.open(copy) as ds:
            ds.read(level=min(ds.depth, 6))
            ds.stats()
    except (OSError, ValueError):
        pass
    copy.unlink()


def test_closed(island: str) -> None:
    ds = spinney.open(island)
    level = ds.level(3)
    ds.close()
    ds.close()
    for query in (
        lambda: ds[0, 0],
        lambda: ds.read(),
        lambda: ds.shape,
        lambda: ds.stats(),
        lambda: ds.sample([(0, 0)]),
        lambda: level[...],
        lambda: np.asarray(ds),
        lambda: ds.refresh(),
    ):
        with pytest.raises(ValueError, match="closed"):
            query()


def test_wrong_arguments(island: str) -> None:
    ds = spinney.open(island)
    for kind, query in [
        (IndexError, lambda: ds.read(2)),
        (IndexError, lambda: ds.read(0)),
        (TypeError, lambda: ds.read("red")),
        (IndexError, lambda: ds.read(window=(250, 0, 10, 10))),
        (IndexError, lambda: ds.read(window=(-1, 0, 10, 10))),
        (ValueError, lambda: ds.read(window=(0, 0, 0, 10))),
        (TypeError, lambda: ds.read(window="all")),
        (ValueError, lambda: ds.read(coordinates="world")),
        (ValueError, lambda: ds.read(window=(0, 0, 1, 1), coordinates="world")),
        (ValueError, lambda: ds.read(window=(5, 0, 1, 1), coordinates="world")),
        (TypeError, lambda: ds.read(window=3, coordinates="world")),
        (ValueError, lambda: ds.read(level=9)),
        (ValueError, lambda: ds.read(level=-1)),
        (ValueError, lambda: ds.read(out_shape=(0, 5))),
        (ValueError, lambda: ds.read(out_shape=(1 << 40, 1 << 40))),
        (ValueError, lambda: ds.read(out_shape=(2, 3, 4))),
        (ValueError, lambda: ds.read(out_shape=(3, 4), level=2)),
        (ValueError, lambda: ds.read(out=np.zeros((1, 3, 3), "u1"))),
        (ValueError, lambda: ds.read(out=np.zeros((1, 200, 256), "u1"), masked=True)),
        (ValueError, lambda: ds.read(fill=-1)),
        (ValueError, lambda: ds.sample([(0, 0)], fill=0.5)),
        (TypeError, lambda: ds.read(out=np.zeros((1, 200, 256), "M8[s]"))),
        (IndexError, lambda: ds[200]),
        (IndexError, lambda: ds[0, 0, 0]),
        (TypeError, lambda: ds[[1, 2]]),
        (ValueError, lambda: ds["a"]),
        (TypeError, lambda: ds[1.5]),
        (IndexError, lambda: ds[..., ...]),
        (ValueError, lambda: ds.level(12)),
        (ValueError, lambda: ds.sample([(1, 2, 3)])),
        (TypeError, lambda: ds.sample(["a"])),
        (TypeError, lambda: ds.sample(np.ones((3, 2), complex))),
        (ValueError, lambda: ds.sample([(1, 2)], level=9)),
        (ValueError, lambda: ds.find()),
        (ValueError, lambda: ds.find(1, above=2)),
        (ValueError, lambda: ds.histogram(0)),
        (ValueError, lambda: ds.histogram(5, (3, 1))),
        (ValueError, lambda: ds.volume()),
        (ValueError, lambda: ds.mesh()),
        (ValueError, lambda: ds.slice(z=0)),
        (ValueError, lambda: spinney.open(island, view="rotate=x")),
        (ValueError, lambda: spinney.open(island, view="subtree=/9")),
        (ValueError, lambda: ds.save("image.xyz")),
    ]:
        with pytest.raises(kind):
            query()


def test_read_only_outputs_are_left_alone(island: str) -> None:
    out = np.zeros((1, 200, 256), "u1")
    out.flags.writeable = False
    with spinney.open(island) as ds, pytest.raises(ValueError):
        ds.read(out=out)
    assert not out.any()


def test_replaced_files_are_noticed(island: str, tmp_path: Path) -> None:
    path = tmp_path / "map.goblin"
    path.write_bytes(Path(island).read_bytes())
    with spinney.open(path, positioned=True) as ds:
        before = ds[...]
        assert np.array_equal(before, spinney.open(island)[...])
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])
        with pytest.raises(OSError):
            ds.stats()
            ds.check_unchanged()
