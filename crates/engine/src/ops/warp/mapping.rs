//! Map from target cells to source cells.

use spinney_base::{Error, Result};
use spinney_crs::{Frame, Projection, Transformation};

/// Map from coordinates in target cells to coordinates in source cells (of the level that is read).
pub(super) struct CellMap {
    target: Frame,
    source: Frame,
    /// From the target's coordinate system to the source's; `None` if neither is known, and both
    /// are taken to be the same.
    systems: Option<Transformation>,
    /// Period of the source in columns, if it is periodic, and the first column of the range that
    /// is used.
    turn: Option<(f64, f64)>,
    target_turns: bool,
}

impl CellMap {
    /// Map from a target to a source with this number of columns.
    ///
    /// # Errors
    /// If one of the frames is not invertible, or a projection is not available.
    pub(super) fn new(target: &Frame, source: &Frame, columns: u64, allow_ballpark: bool) -> Result<CellMap> {
        for (name, frame) in [("target", target), ("source", source)] {
            if frame.to_cells([0.0; 3]).is_none() {
                let found = format!("{:?}", frame.matrix);
                return Err(Error::invalid(format!("frame of the {name}"), found, "an invertible map"));
            }
        }
        let systems = match (&target.crs, &source.crs) {
            (Some(there), Some(here)) => Some(Transformation::new(there, here, allow_ballpark)?),
            (None, None) => None,
            (there, _) => {
                let expected = "a coordinate system; set it with `spinney build --crs EPSG:NUMBER` or the operation `crs=EPSG:NUMBER`";
                let whose = if there.is_none() { "the grid" } else { "the raster" };
                return Err(Error::invalid(format!("coordinate system of {whose}"), "none", expected));
            }
        };
        let [[across, b, _, _], [d, ..], _] = source.matrix;
        let is_upright = b == 0.0 && d == 0.0;
        let turn = source.crs.as_ref().and_then(|here| here.turn()).filter(|_| is_upright).map(|turn| {
            let turn = turn / across.abs();
            // (The seam is opposite to the data.)
            (turn, (columns as f64 - turn) / 2.0)
        });
        let target_turns = target.crs.as_ref().is_some_and(|there| there.unit() == Some("degrees"));
        Ok(CellMap { target: target.clone(), source: source.clone(), systems, turn, target_turns })
    }

    /// Projections of the target and of the source, if they differ.
    pub(super) fn projections(&self) -> Option<(&Projection, &Projection)> {
        self.systems.as_ref()?.projections()
    }

    /// Warnings about the accuracy of the systems.
    pub(super) fn remarks(&self) -> Vec<String> {
        self.systems.as_ref().map_or(Vec::new(), Transformation::remarks)
    }

    /// Period of the source in columns, if it is an integer.
    pub(super) fn whole_turn(&self) -> Option<i64> {
        let (turn, _) = self.turn?;
        ((turn - turn.round()).abs() < 1e-6 && turn < 1e12).then_some(turn.round() as i64)
    }

    /// Whether source columns depend on target columns only, and rows on rows.
    pub(super) fn is_separable(&self) -> bool {
        let is_upright = |frame: &Frame| frame.matrix[0][1] == 0.0 && frame.matrix[1][0] == 0.0;
        let are_separable = self.systems.as_ref().is_none_or(Transformation::is_separable);
        are_separable && is_upright(&self.target) && is_upright(&self.source)
    }

    /// Whether the target's first coordinate is periodic, as longitudes are.
    pub(super) fn target_turns(&self) -> bool {
        self.target_turns
    }

    /// Source position of a target position, both in cells; `None` if it is undefined.
    pub(super) fn to_source(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y, _] = self.target.to_world([x, y, 0.0]);
        let [x, y] = self.systems.as_ref().map_or(Some([x, y]), |systems| systems.forward([x, y]))?;
        let [column, row, _] = self.source.to_cells([x, y, 0.0])?;
        let column = match self.turn {
            Some((turn, first)) => first + (column - first).rem_euclid(turn),
            None => column,
        };
        (column.is_finite() && row.is_finite()).then_some([column, row])
    }

    /// Target position of a source position, both in cells; `None` if it is undefined.
    pub(super) fn to_target(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y, _] = self.source.to_world([x, y, 0.0]);
        let [x, y] = self.systems.as_ref().map_or(Some([x, y]), |systems| systems.backward([x, y]))?;
        let [column, row, _] = self.target.to_cells([x, y, 0.0])?;
        (column.is_finite() && row.is_finite()).then_some([column, row])
    }

    /// Number of source cells along a side of a target cell at a position: the square root of the
    /// area ratio.
    pub(super) fn ratio_at(&self, place: [f64; 2]) -> Option<f64> {
        self.ratio_over(place, 1.0)
    }

    /// [`CellMap::ratio_at`], measured over `width` target cells around the position.
    pub(super) fn ratio_over(&self, [x, y]: [f64; 2], width: f64) -> Option<f64> {
        let half = width / 2.0;
        let at = |dx: f64, dy: f64| self.to_source([x + dx, y + dy]);
        let ([a, b], [c, d]) =
            ((at(-half, 0.0)?, at(half, 0.0)?).into(), (at(0.0, -half)?, at(0.0, half)?).into());
        let (along, down): ([f64; 2], [f64; 2]) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
        let area = (along[0] * down[1] - along[1] * down[0]).abs();
        (area > 0.0 && area.is_finite()).then(|| area.sqrt() / width)
    }
}
