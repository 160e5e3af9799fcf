"""A tour of the package, which `mypy --strict` checks: `python typed.py MAP.tif`."""

import sys

import numpy as np
import numpy.typing as npt

import spinney


def tour(picture: str) -> float:
    """Builds a tree of a picture, asks and changes it, and tells the share of cells that are other ones then."""
    spinney.build(picture, "map.goblin", memory="256M")
    with spinney.open("map.goblin") as ds:
        window: npt.NDArray[np.generic] = ds.read(1, window=(0, 0, 64, 64))
        coarse = ds.level(max(ds.depth - 3, 0))[...]
        left, bottom, right, top = ds.bounds.left, ds.bounds.bottom, ds.bounds.right, ds.bounds.top
        hidden = ds.read(1, masked=True).mask
        values = ds.sample([((left + right) / 2, (bottom + top) / 2)])
        statistics: spinney.Statistics = ds.stats((left, bottom, right, top), coordinates="world")
        print(ds, window.shape, np.count_nonzero(hidden), coarse.shape, values, statistics.mean)
        for code, level, box in zip(*(lambda found: (found.codes, found.levels, found.boxes))(ds.find(above=1, largest=3))):
            print(code, level, box)
    spinney.convert("map.goblin", "map.autumn")
    with spinney.edit("map.autumn", message="A corner") as edit:
        edit.fill(1, window=(0, 0, 8, 8))
    commit: spinney.Commit | None = edit.made
    print(commit and commit.message, [entry.number for entry in spinney.log("map.autumn")])
    changes: spinney.Differences = spinney.diff("map.autumn@1", "map.autumn")
    return (changes.added + changes.changed) / statistics.cells


if __name__ == "__main__":
    print(tour(sys.argv[1]))
