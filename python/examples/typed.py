"""A tour of the package, which `mypy --strict` checks: `python typed.py MAP.tif`."""

import sys

import numpy as np
import numpy.typing as npt

import spinney


def tour(raster: str) -> float:
    """Builds a tree from a raster, queries and edits it, and returns the share of changed cells."""
    spinney.build(raster, "map.goblin", memory="256M")
    with spinney.open("map.goblin") as ds:
        window: npt.NDArray[np.generic] = ds.read(1, window=(0, 0, 64, 64))
        coarse = ds.level(max(ds.depth - 3, 0))[...]
        left, bottom, right, top = ds.bounds.left, ds.bounds.bottom, ds.bounds.right, ds.bounds.top
        hidden = ds.read(1, masked=True).mask
        values = ds.sample([((left + right) / 2, (bottom + top) / 2)])
        inner: list[int] = [level.inner for level in ds.level_counts()]
        ds.legend("legend.svg", {"draw": "ramp", "ramp": "viridis", "domain": [0, sum(inner)]})
        statistics: spinney.Statistics = ds.stats((left, bottom, right, top), coordinates="world")
        print(ds, window.shape, np.count_nonzero(hidden), coarse.shape, values, statistics.mean)
        for code, level, box in zip(*(lambda found: (found.codes, found.levels, found.boxes))(ds.find(above=1, largest=3))):
            print(code, level, box)
    spinney.convert("map.goblin", "map.autumn", threads=2, max_bytes="1G")
    with spinney.edit("map.autumn", message="A corner") as edit:
        edit.fill(1, window=(0, 0, 8, 8))
    commit: spinney.Commit | None = edit.made
    print(commit and commit.message, [entry.number for entry in spinney.log("map.autumn")])
    changes: spinney.Differences = spinney.diff("map.autumn@1", "map.autumn")
    return (changes.added + changes.changed) / statistics.cells


def slices(part: str, tool: str) -> tuple[float, int]:
    """Returns the area of slices of a model, and the number of crossing lines with another model's
    surface.
    """
    with spinney.open_brep(part) as model, spinney.open_brep(tool) as other:
        section: spinney.Section = model.section("slices.geojson", ["z=0..50/0.2", "plane=1,1,0,7.5"], flat=True)
        found: spinney.SurfaceIntersection = model.section("lines.ply", other)
        return section.area, found.crossings


if __name__ == "__main__":
    print(tour(sys.argv[1]))
