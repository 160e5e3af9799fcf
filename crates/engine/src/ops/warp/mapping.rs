//! The map from cells of the target to cells of the source.

use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame, Projection};

/// The map from coordinates in cells of the target to coordinates in cells of the source (of the level that is read).
pub(super) struct CellMap {
    target: Frame,
    source: Frame,
    /// Projections of target and source, where these differ.
    projections: Option<(Projection, Projection)>,
    /// Columns of the source after which it comes again, if it is in degrees; and the first of those that are taken for its own.
    turn: Option<(f64, f64)>,
}

impl CellMap {
    /// The map from a target to a source of so many columns.
    ///
    /// # Errors
    /// If one of the two has no place in the world, or a projection is not to be had.
    pub(super) fn new(target: &Frame, source: &Frame, columns: u64, allow_ballpark: bool) -> Result<CellMap> {
        for (name, frame) in [("target", target), ("source", source)] {
            if frame.to_cells([0.0; 3]).is_none() {
                let found = format!("{:?}", frame.matrix);
                return Err(Error::invalid(format!("frame of the {name}"), found, "one that has an inverse"));
            }
        }
        let (Some(there), Some(here)) = (&target.crs, &source.crs) else {
            let expected =
                "one; `spinney build --crs EPSG:NUMBER` or the step `crs=EPSG:NUMBER` says which it is";
            let whose = if target.crs.is_none() { "the grid" } else { "the raster" };
            return Err(Error::invalid(format!("coordinate system of {whose}"), "none", expected));
        };
        let open = |crs: &Crs| Projection::new(crs, allow_ballpark);
        let projections = if there.is_same(here) { None } else { Some((open(there)?, open(here)?)) };
        let is_geographic = here.unit() == Some("degrees");
        let [[across, b, _, _], [d, ..], _] = source.matrix;
        let turn = (is_geographic && b == 0.0 && d == 0.0).then(|| {
            let turn = 360.0 / across.abs();
            // (The seam lies opposite to the data.)
            (turn, (columns as f64 - turn) / 2.0)
        });
        Ok(CellMap { target: target.clone(), source: source.clone(), projections, turn })
    }

    /// Remarks on how well the systems are known.
    pub(super) fn remarks(&self) -> Vec<String> {
        let of = |projection: &Projection, frame: &Frame| {
            let crs = frame.crs.as_ref().map_or(String::new(), Crs::to_string);
            projection.remark().map(|remark| format!("{crs}: {remark}"))
        };
        let Some((target, source)) = &self.projections else { return Vec::new() };
        [of(target, &self.target), of(source, &self.source)].into_iter().flatten().collect()
    }

    /// Columns of the source after which it comes again, if that is a whole number of them.
    pub(super) fn whole_turn(&self) -> Option<i64> {
        let (turn, _) = self.turn?;
        ((turn - turn.round()).abs() < 1e-6 && turn < 1e12).then_some(turn.round() as i64)
    }

    /// Whether columns depend on columns alone, and rows on rows.
    pub(super) fn is_separable(&self) -> bool {
        let is_upright = |frame: &Frame| frame.matrix[0][1] == 0.0 && frame.matrix[1][0] == 0.0;
        let cylindrical = |(a, b): &(Projection, Projection)| a.is_cylindrical() && b.is_cylindrical();
        is_upright(&self.target)
            && is_upright(&self.source)
            && self.projections.as_ref().is_none_or(cylindrical)
    }

    /// Longitude is what the target's first coordinate is, and comes again.
    pub(super) fn target_turns(&self) -> bool {
        self.projections.as_ref().is_none_or(|(target, _)| target.is_geographic())
    }

    /// The place in the source of a place in the target, both in cells; `None` where there is none.
    pub(super) fn to_source(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y, _] = self.target.to_world([x, y, 0.0]);
        let [x, y] = match &self.projections {
            None => [x, y],
            Some((target, source)) => {
                let place = target.inverse([x, y])?;
                let point = source.forward(place)?;
                // Formulas that are asked beyond their domain may give a point of another place.
                let back = source.inverse(point)?;
                let turned = (back[0] - place[0] + 540.0).rem_euclid(360.0) - 180.0;
                let near_pole = place[1].abs() > 89.999_999;
                ((turned.abs() < 1e-6 || near_pole) && (back[1] - place[1]).abs() < 1e-6).then_some(point)?
            }
        };
        let [column, row, _] = self.source.to_cells([x, y, 0.0])?;
        let column = match self.turn {
            Some((turn, first)) => first + (column - first).rem_euclid(turn),
            None => column,
        };
        (column.is_finite() && row.is_finite()).then_some([column, row])
    }

    /// The place in the target of a place in the source, both in cells; `None` where there is none.
    pub(super) fn to_target(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y, _] = self.source.to_world([x, y, 0.0]);
        let [x, y] = match &self.projections {
            None => [x, y],
            Some((target, source)) => {
                let [longitude, latitude] = source.inverse([x, y])?;
                target.forward([(longitude + 180.0).rem_euclid(360.0) - 180.0, latitude])?
            }
        };
        let [column, row, _] = self.target.to_cells([x, y, 0.0])?;
        (column.is_finite() && row.is_finite()).then_some([column, row])
    }

    /// Cells of the source along a side of a cell of the target at a place in it: the root of their number.
    pub(super) fn ratio_at(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let at = |dx: f64, dy: f64| self.to_source([x + dx, y + dy]);
        let ([a, b], [c, d]) =
            ((at(-0.5, 0.0)?, at(0.5, 0.0)?).into(), (at(0.0, -0.5)?, at(0.0, 0.5)?).into());
        let (along, down): ([f64; 2], [f64; 2]) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
        let area = (along[0] * down[1] - along[1] * down[0]).abs();
        (area > 0.0 && area.is_finite()).then(|| area.sqrt())
    }
}
