"""Two files together: differences are converted, or refused with advice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import spinney

UTM = "EPSG:32632"


def build(path: Path, value: float, dtype: str, *, left: float = 0.0, cell: float = 10.0, shape: tuple[int, int] = (10, 12), **more: object) -> Path:
    """Builds a tree whose stored numbers are all equal, in the first UTM zone of the examples."""
    transform = [cell, 0, 500000 + left, 0, -cell, 5200000]
    spinney.build(np.full(shape, value, dtype), path, transform=transform, crs=more.pop("crs", UTM), **more)  # type: ignore[arg-type]
    return path


def meanings(path: Path) -> list[float]:
    """Returns the physical values of a row of cells; NaN is VOID."""
    tree = spinney.open(path)
    cells = tree.read(masked=True)[0][4]
    scale, offset = tree.scales[0], tree.offsets[0]
    return [float(number) for number in np.ma.filled(cells.astype(float) * scale + offset, np.nan)]


def test_scales_units_and_types_are_converted(tmp_path: Path) -> None:
    a = build(tmp_path / "a.goblin", 75, "i2", scales=[0.1], units=["m"])
    for value, dtype, more in [
        (24, "i2", {}),
        (48, "i2", {"scales": [0.5]}),
        (24, "u1", {}),
        (24, "f4", {"units": ["m"]}),
        (2400, "i4", {"units": ["cm"]}),
        (1900, "i2", {"scales": [0.01], "offsets": [5.0]}),
    ]:
        b = build(tmp_path / "b.goblin", value, dtype, left=60, **more)
        made = spinney.combine("over", [a, b], tmp_path / "over.goblin")
        assert made.conversions, (dtype, more)
        np.testing.assert_allclose(meanings(tmp_path / "over.goblin"), 12 * [7.5] + 6 * [24], rtol=1e-6)
        spinney.combine("max", [a, b], tmp_path / "max.goblin")
        np.testing.assert_allclose(meanings(tmp_path / "max.goblin"), 6 * [np.nan] + 6 * [24] + 6 * [np.nan], rtol=1e-6)
        found = spinney.diff(a, b)
        assert (found.added, found.removed, found.changed) == (60, 60, 60)
        assert spinney.diff(a, b, extent="intersection").changed == 60
    spinney.combine("over", [a, b], tmp_path / "a_only.goblin", extent="a")
    assert len(meanings(tmp_path / "a_only.goblin")) == 12
    # Different quantities are not converted; stored numbers can be used unchanged.
    c = build(tmp_path / "c.goblin", 24, "i2", units=["degC"])
    with pytest.raises(ValueError, match="--units number"):
        spinney.combine("over", [a, c], tmp_path / "none.goblin")
    spinney.combine("max", [a, c], tmp_path / "stored.goblin", units="number")
    assert meanings(tmp_path / "stored.goblin") == 12 * [7.5]


def test_classes_are_matched_by_name(tmp_path: Path) -> None:
    a = build(tmp_path / "a.goblin", 1, "u1", kind="categorical", categories={1: "forest", 2: "lake"})
    b = build(tmp_path / "b.goblin", 1, "u1", left=120, kind="categorical", categories={1: "lake", 2: "meadow"})
    made = spinney.combine("over", [a, b], tmp_path / "over.goblin")
    assert any("lake 1 becomes 2" in line for line in made.conversions)
    assert spinney.open(tmp_path / "over.goblin").categories == {1: "forest", 2: "lake", 3: "meadow"}
    assert spinney.cross(a, b) == [(None, [2], 120), ([1], None, 120)]
    assert spinney.cross(a, b, classes="number") == [(None, [1], 120), ([1], None, 120)]
    spinney.combine("over", [a, b], tmp_path / "land.autumn")
    c = build(tmp_path / "c.goblin", 2, "u1", kind="categorical", categories={1: "lake", 2: "meadow"})
    with spinney.edit(tmp_path / "land.autumn") as edit:
        edit.paste(c)
    assert set(np.unique(spinney.open(tmp_path / "land.autumn").read()[0])) == {2, 3}


def test_edits_keep_their_type_and_void(tmp_path: Path) -> None:
    a = build(tmp_path / "a.autumn", 75, "i2", scales=[0.1])
    holes = np.ma.masked_array(np.full((10, 12), 24.25, "f4"), np.arange(120).reshape(10, 12) % 2 == 0)
    transform = [10, 0, 500000, 0, -10, 5200000]
    spinney.build(holes, tmp_path / "b.goblin", transform=transform, crs=UTM)
    with spinney.edit(a) as edit:
        with pytest.raises(ValueError, match="--round"):
            edit.paste(tmp_path / "b.goblin")
        edit.paste(tmp_path / "b.goblin", round=True)
    np.testing.assert_allclose(meanings(a), 6 * [7.5, 24.3], atol=0.051)
    with spinney.edit(a) as edit:
        edit.paste(tmp_path / "b.goblin", round=True, void=True)
    assert np.isnan(meanings(a)[::2]).all()


def test_cells_off_the_grid_are_resampled(tmp_path: Path) -> None:
    a = build(tmp_path / "a.goblin", 1, "f4")
    b = build(tmp_path / "b.goblin", 3, "f4", left=123)
    spinney.combine("over", [a, b], tmp_path / "over.goblin")
    assert meanings(tmp_path / "over.goblin") == 12 * [1] + 12 * [3]
    made = spinney.transform(b, f"like={a}", tmp_path / "like.goblin")
    assert (made.cells, made.shape) == (120, (10, 12))
    with pytest.raises(ValueError, match="extent=union"):
        spinney.transform(b, f"like={a},extent=a", tmp_path / "none.goblin")
    unknown = build(tmp_path / "c.goblin", 3, "f4", crs=None)
    with pytest.raises(ValueError, match="spinney transform .* 'crs=EPSG:32632'"):
        spinney.combine("over", [a, unknown], tmp_path / "none.goblin")
