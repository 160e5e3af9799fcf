//! Positions of a raster's data in another coordinate system.

use super::mapping::CellMap;
use spinney_base::space::Bounds;
use spinney_crs::{AreaOfUse, Crs, Frame, Projection};

/// Extent of a raster's data in another system.
pub(super) struct Landing {
    pub(super) low: [f64; 2],
    pub(super) high: [f64; 2],
    /// Side of a square with the area of a raster cell, in the middle of the data.
    pub(super) unit: f64,
}

/// Intervals along each side of the data between computed positions.
const STEPS: usize = 128;

/// Maximum second difference of a line of positions that counts as straight, in cells.
const STRAIGHT: f64 = 1e-3;

/// Target system, limited to where it is suitable for maps.
struct Target<'a> {
    /// Projections of the target and of the raster, and the target's area of use, if the two
    /// systems differ.
    clipping: Option<(&'a Projection, &'a Projection, AreaOfUse)>,
    /// Middle of the world, and the period of the first coordinate, if it is periodic.
    turn: Option<[f64; 2]>,
}

impl<'a> Target<'a> {
    fn new(map: &'a CellMap, crs: &Crs) -> Target<'a> {
        match map.projections() {
            Some((target, own)) => {
                Target { clipping: Some((target, own, target.area_of_use())), turn: target.turn() }
            }
            None => Target { clipping: None, turn: crs.turn().map(|turn| [0.0, turn]) },
        }
    }

    /// Whether a world position is in the area of use; `None` if it has no longitude and latitude.
    fn has(&self, world: [f64; 2]) -> Option<bool> {
        let (_, own, area) = self.clipping.as_ref()?;
        own.inverse(world).map(|place| area.contains(place))
    }

    /// Coordinates of the position in the area of use that is nearest to a position of the raster.
    fn nearest(&self, world: [f64; 2]) -> Option<[f64; 2]> {
        let (target, own, area) = self.clipping.as_ref()?;
        target.forward(area.nearest(own.inverse(world)?))
    }
}

/// Position of a point of the data.
#[derive(Clone, Copy)]
enum Position {
    /// Coordinates in the target; outside of the area of use, those of its nearest edge.
    At([f64; 2]),
    /// Beyond the area of use.
    Beyond,
    /// Undefined: the formula has no result.
    Nowhere,
}

impl Position {
    fn at(self) -> Option<[f64; 2]> {
        if let Position::At(place) = self { Some(place) } else { None }
    }
}

impl Landing {
    /// Landing of a box of cells; `None` if no point of it has a position in the system. If the
    /// data are only partly in the area of use, that part counts. Periodic first coordinates are
    /// moved next to the middle's, or span the whole period if data are on all sides.
    pub(super) fn of(map: &CellMap, frame: &Frame, data: &Bounds, crs: &Crs) -> Option<Landing> {
        let target = &Target::new(map, crs);
        let cell = |column: usize, row: usize| {
            let at = |axis: usize, step: usize| {
                data.min[axis] as f64 + (data.max[axis] - data.min[axis]) as f64 * step as f64 / STEPS as f64
            };
            [at(0, column), at(1, row)]
        };
        let world = |[column, row]: [f64; 2]| {
            let [x, y, _] = frame.to_world([column, row, 0.0]);
            [x, y]
        };
        let steps = || (0..=STEPS).flat_map(|row| (0..=STEPS).map(move |column| (column, row)));
        let in_area: Vec<Option<bool>> =
            steps().map(|(column, row)| target.has(world(cell(column, row)))).collect();
        // (If all data are beyond the area of use, they are mapped without clipping.)
        let is_clipped = in_area.contains(&Some(true)) && in_area.contains(&Some(false));
        let used =
            |column: usize, row: usize| !is_clipped || in_area[row * (STEPS + 1) + column] != Some(false);
        let place = |column: usize, row: usize| {
            let here = cell(column, row);
            if used(column, row) {
                return map.to_target(here).map_or(Position::Nowhere, Position::At);
            }
            let near = |at: usize| at.saturating_sub(1)..=(at + 1).min(STEPS);
            let is_next_to_used = near(row).any(|row| near(column).any(|column| used(column, row)));
            let edge = if is_next_to_used { target.nearest(world(here)) } else { None };
            edge.map_or(Position::Beyond, Position::At)
        };
        let (middle, unit) = middle_and_unit(map, &cell, &used, target)?;
        let near_middle = |[x, y]: [f64; 2]| match target.turn {
            Some([_, turn]) => [middle[0] + (x - middle[0] + turn / 2.0).rem_euclid(turn) - turn / 2.0, y],
            None => [x, y],
        };
        let positions: Vec<Position> = steps()
            .map(|(column, row)| match place(column, row) {
                Position::At(place) => Position::At(near_middle(place)),
                other => other,
            })
            .collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for place in positions.iter().filter_map(|place| place.at()) {
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(place[axis]), high[axis].max(place[axis]));
            }
        }
        let bend = bend(&positions);
        if !bend.iter().all(|bend| *bend < unit * STRAIGHT) {
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis] - bend[axis] / 4.0, high[axis] + bend[axis] / 4.0);
            }
        }
        if is_clipped {
            (low, high) = within_area(target, (low, high));
        }
        let Some([world, turn]) = target.turn else { return Some(Landing { low, high, unit }) };
        // The whole period, once. (Data around a pole span it up to the pole.)
        if high[0] - low[0] > 0.9 * turn {
            (low[0], high[0]) = (world - turn / 2.0, world + turn / 2.0);
        }
        if turn == 360.0 {
            for (pole, end) in [([0.0, -90.0], 0), ([0.0, 90.0], 1)] {
                let is_in = |[column, row]: [f64; 2]| {
                    (data.min[0] as f64..data.max[0] as f64).contains(&column)
                        && (data.min[1] as f64..data.max[1] as f64).contains(&row)
                };
                if map.to_source(pole).is_some_and(is_in) {
                    if end == 0 { low[1] = -90.0 } else { high[1] = 90.0 }
                }
            }
            (low[1], high[1]) = (low[1].max(-90.0), high[1].min(90.0));
        }
        Some(Landing { low, high, unit })
    }
}

/// Position of the middle of the used data, or else of another cell, and the side of a cell there.
fn middle_and_unit(
    map: &CellMap,
    cell: &dyn Fn(usize, usize) -> [f64; 2],
    used: &dyn Fn(usize, usize) -> bool,
    target: &Target<'_>,
) -> Option<([f64; 2], f64)> {
    let mut sums = [0, 0, 0];
    for row in 0..=STEPS {
        for column in (0..=STEPS).filter(|column| used(*column, row)) {
            sums = [sums[0] + column, sums[1] + row, sums[2] + 1];
        }
    }
    let middle = [sums[0] / sums[2].max(1), sums[1] / sums[2].max(1)];
    let parts = [0.5, 0.25, 0.75, 0.1, 0.9].map(|part| (part * STEPS as f64) as usize);
    let others = parts.into_iter().flat_map(|row| parts.into_iter().map(move |column| [column, row]));
    let mut all = [middle].into_iter().chain(others).filter(|[column, row]| used(*column, *row));
    all.find_map(|[column, row]| {
        let middle = map.to_target(cell(column, row))?;
        // (A millionth of the target's turn, or one unit, exceeds rounding errors.)
        let ratio = map.ratio_over(middle, target.turn.map_or(1.0, |[_, turn]| turn * 1e-6))?;
        Some((middle, 1.0 / ratio))
    })
}

/// Maximum second difference of consecutive positions along each axis. A curve exceeds its
/// positions by about an eighth of that; the caller adds a quarter.
fn bend(positions: &[Position]) -> [f64; 2] {
    let mut bend = [0f64; 2];
    let side = STEPS + 1;
    let lines = (0..side).flat_map(|line| {
        let (row, column) = (positions[line * side..].iter(), positions[line..].iter());
        let row: Vec<Position> = row.take(side).copied().collect();
        [row, column.step_by(side).copied().collect()]
    });
    for line in lines {
        for three in line.windows(3) {
            match three {
                [Position::At(a), Position::At(b), Position::At(c)] => {
                    for axis in 0..2 {
                        bend[axis] = bend[axis].max((a[axis] - 2.0 * b[axis] + c[axis]).abs());
                    }
                }
                // Next to an undefined position, a curve may extend as far as the defined ones are
                // apart.
                [Position::At(a), Position::At(b), Position::Nowhere]
                | [Position::Nowhere, Position::At(b), Position::At(a)] => {
                    for axis in 0..2 {
                        bend[axis] = bend[axis].max(8.0 * (a[axis] - b[axis]).abs());
                    }
                }
                _ => {}
            }
        }
    }
    bend
}

/// Intersection of a box with the bounding box of the area of use.
fn within_area(target: &Target<'_>, (low, high): ([f64; 2], [f64; 2])) -> ([f64; 2], [f64; 2]) {
    let Some((system, _, area)) = &target.clipping else { return (low, high) };
    let (mut first, mut last) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for place in area.edge().into_iter().filter_map(|place| system.forward(place)) {
        for axis in 0..2 {
            (first[axis], last[axis]) = (first[axis].min(place[axis]), last[axis].max(place[axis]));
        }
    }
    let axes = [0, 1].map(|axis| (low[axis].max(first[axis]), high[axis].min(last[axis])));
    // (The edge of an area that spans the world may have no positions.)
    let [x, y] =
        [0, 1].map(|axis| if axes[axis].0 < axes[axis].1 { axes[axis] } else { (low[axis], high[axis]) });
    ([x.0, y.0], [x.1, y.1])
}
