//! Models on one grid.

use crate::arrangement::{Corner, ExactFace, ExactPoint};
use crate::build::BaseRoot;
use crate::query::half_of;
use crate::{ExactModel, Faces, Grid, MAX_BITS, ModelNode, ModelNodeState};
use spinney_base::{Error, Result};
use spinney_container::Tag;
use spinney_crs::Crs;

/// Models on one grid.
pub(super) struct CommonGrid {
    pub(super) grid: Grid,
    grids: Vec<Grid>,
    /// Per model: common grid units per unit of its own grid, then the offset in common grid units.
    shifts: Vec<(i64, [i64; 3])>,
}

impl CommonGrid {
    /// Finds a grid on which all models' coordinates are exact. It is chosen so that the octree of
    /// the largest model with the common unit (the first of several) can be copied: its grid if
    /// that covers all models, otherwise a larger grid of which its grid is a cell. `None` if the
    /// units have no common divisor that leaves few enough units along the longest side.
    ///
    /// The unit is a fraction of the common one: one of `parts` equal parts.
    pub(super) fn of(models: &[&ExactModel], parts: i64) -> Result<Option<CommonGrid>> {
        check_systems(models)?;
        let grids: Vec<&Grid> = models.iter().map(|model| model.grid()).collect();
        let Some(mut finest) = finest_unit(&grids) else { return Ok(None) };
        match finest.divisor == 1.0 {
            true => finest.step /= parts as f64,
            false => finest.divisor *= parts as f64,
        }
        let mut shifts = Vec::new();
        for grid in &grids {
            let Some(times) = grid.steps_of(&finest) else { return Ok(None) };
            let origin = grid.origin.map(|at| i128::from(at) * i128::from(times));
            if origin.iter().any(|at| at.unsigned_abs() > 1 << 62) {
                return Ok(None);
            }
            shifts.push((times, origin.map(|at| at as i64)));
        }
        let to_common = |model: usize, corner: [i32; 3]| {
            let (times, origin) = shifts[model];
            [0, 1, 2].map(|axis| origin[axis] + times * i64::from(corner[axis]))
        };
        let box_of = |model: usize| -> Result<Option<[[i64; 3]; 2]>> {
            Ok(bounds(models[model])?.map(|corners| corners.map(|corner| to_common(model, corner))))
        };
        let largest = (0..models.len())
            .rev()
            .filter(|model| shifts[*model].0 == 1)
            .max_by_key(|model| models[*model].len());
        // (Each unit may be a multiple of the common one.)
        let anchor = largest.unwrap_or(0);
        let (mut origin, mut bits) = (shifts[anchor].1, models[anchor].grid().bits);
        let fits = |[low, high]: [[i64; 3]; 2]| {
            (0..3).all(|axis| low[axis] >= origin[axis] && high[axis] - origin[axis] < 1 << bits)
        };
        let mut is_own = largest.is_some();
        for (model, file) in models.iter().enumerate() {
            let last = ((1u64 << file.grid().bits) - 1) as i32;
            // (A grid that covers the other model's whole grid needs no bounds of faces.)
            is_own = is_own
                && (fits([[0; 3], [last; 3]].map(|corner| to_common(model, corner)))
                    || box_of(model)?.is_none_or(fits));
        }
        if !is_own {
            let (mut least, mut most) = ([i64::MAX; 3], [i64::MIN; 3]);
            for model in 0..models.len() {
                let [low, high] = box_of(model)?.unwrap_or([least, most]);
                least = [0, 1, 2].map(|axis| least[axis].min(low[axis]));
                most = [0, 1, 2].map(|axis| most[axis].max(high[axis]));
            }
            // (Octrees of models with exact faces are copied on their own grids only.)
            let cells = largest.filter(|model| !models[*model].has_exact_faces());
            match cells.and_then(|_| grid_around((origin, bits), [least, most])) {
                Some(around) => (origin, bits) = around,
                None => {
                    // (All models may be without faces.)
                    if least[0] <= most[0] {
                        origin = least;
                    }
                    let extents = (0..3).map(|axis| most[axis].saturating_sub(least[axis]).max(0));
                    bits = (64 - extents.max().unwrap_or(0).leading_zeros() as u8).max(1);
                }
            }
        }
        if bits > MAX_BITS || origin.iter().any(|at| at.unsigned_abs() > 1 << 53) {
            return Ok(None);
        }
        let grid = Grid { bits, origin, step: finest.step, divisor: finest.divisor };
        for (_, shift) in &mut shifts {
            (0..3).for_each(|axis| shift[axis] -= origin[axis]);
        }
        Ok(Some(CommonGrid { grid, grids: grids.into_iter().cloned().collect(), shifts }))
    }

    /// Returns the grid for a subset of the models, by their numbers. The grid stays the same.
    pub(super) fn subset(&self, numbers: &[usize]) -> CommonGrid {
        CommonGrid {
            grid: self.grid.clone(),
            grids: numbers.iter().map(|number| self.grids[*number].clone()).collect(),
            shifts: numbers.iter().map(|number| self.shifts[*number]).collect(),
        }
    }

    /// Returns the cell of the common grid's octree that is a model's grid, if any. (Grids without
    /// faces or of few units may be smaller than all cells.)
    pub(super) fn base_root(&self, model: usize) -> Option<BaseRoot> {
        let ((times, shift), bits) = (self.shifts[model], self.grids[model].bits);
        let level =
            self.grid.bits.checked_sub(bits).filter(|level| times == 1 && *level <= self.grid.depth())?;
        // (A shift below zero is no position.)
        let is_cell = |at: i64| at & ((1 << bits) - 1) == 0 && (0..1 << level).contains(&(at >> bits));
        shift
            .into_iter()
            .all(is_cell)
            .then(|| BaseRoot { level, position: shift.map(|at| (at >> bits) as u32) })
    }

    /// Returns the common grid's units per unit of a model's own grid.
    pub(super) fn times(&self, model: usize) -> i64 {
        self.shifts[model].0
    }

    /// Converts a point of a model's grid to the common grid.
    pub(super) fn point(&self, model: usize, point: [i32; 3]) -> [i32; 3] {
        let (times, shift) = self.shifts[model];
        [0, 1, 2].map(|axis| (times * i64::from(point[axis]) + shift[axis]) as i32)
    }

    /// Returns a model's cell in half units of the common grid.
    pub(super) fn half_units(&self, model: usize, node: &ModelNode<'_>) -> [[i64; 3]; 2] {
        let (times, shift) = self.shifts[model];
        let bounds = node.bounds(&self.grids[model]);
        bounds.map(|corner| [0, 1, 2].map(|axis| times * corner[axis] + 2 * shift[axis]))
    }

    /// Returns the winding number of a model's surface in the cell that contains a point, given in
    /// half units of the common grid. `None` if faces are in that cell, or exact faces are near it.
    /// So the number is that of the exact surface, also in models with intersecting proxies.
    pub(super) fn winding_at(
        &self,
        models: &[&ExactModel],
        model: usize,
        at: [i64; 3],
    ) -> Result<Option<i32>> {
        let mut node = models[model].root()?;
        let mut cell = self.half_units(model, &node);
        if (0..3).any(|axis| at[axis] < cell[0][axis] || at[axis] > cell[1][axis]) {
            return Ok(Some(models[model].far_winding()));
        }
        while node.state() == ModelNodeState::Inner {
            let is_upper = |axis: usize| 2 * at[axis] >= cell[0][axis] + cell[1][axis];
            let child = (0..3).map(|axis| usize::from(is_upper(axis)) << axis).sum();
            cell = half_of(&cell, child);
            node = models[model].child(&node, child)?;
        }
        Ok(node.winding())
    }

    /// Converts an exact point of a model to the common grid.
    pub(super) fn exact_point(&self, model: usize, point: ExactPoint) -> ExactPoint {
        let (times, shift) = self.shifts[model];
        point.placed(times, shift)
    }

    /// Converts an exact face of a model to the common grid.
    pub(super) fn exact(&self, model: usize, face: ExactFace) -> ExactFace {
        let (times, shift) = self.shifts[model];
        let corner = |corner: Corner| Corner {
            point: self.exact_point(model, corner.point),
            line: corner.line.placed(times, shift),
        };
        ExactFace {
            plane: face.plane.placed(times, shift),
            corners: face.corners.into_iter().map(corner).collect(),
            ..face
        }
    }
}

/// Returns the origin and bits of the smallest grid that covers a box and of whose octree a given
/// grid is a cell. `None` if it would have too many units, or if the box is empty.
fn grid_around((origin, bits): ([i64; 3], u8), [least, most]: [[i64; 3]; 2]) -> Option<([i64; 3], u8)> {
    if (0..3).any(|axis| least[axis] > most[axis]) {
        return None;
    }
    (bits..=MAX_BITS).find_map(|larger| {
        let mut corner = origin;
        for axis in 0..3 {
            // Cells below the given one, as few as possible.
            let below = i128::from(origin[axis]) - i128::from(least[axis]);
            let cells = (below.max(0) + (1 << bits) - 1) >> bits;
            let start = i128::from(origin[axis]) - (cells << bits);
            if cells >= 1 << (larger - bits) || i128::from(most[axis]) - start >= 1 << larger {
                return None;
            }
            corner[axis] = i64::try_from(start).ok()?;
        }
        Some((corner, larger))
    })
}

/// Returns the bounds of a model on its grid. They come from the faces, since the octree may miss
/// what is thinner than a grid unit. Exact vertices get a margin of one unit, since they round by
/// less than that, but to several units of a finer grid.
pub(super) fn bounds(model: &ExactModel) -> Result<Option<[[i32; 3]; 2]>> {
    let mut found = model.grid_bounds()?;
    model.each_exact(&mut |face| {
        for at in face.rounded() {
            let [low, high] = found.get_or_insert([at; 2]);
            for axis in 0..3 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        }
        Ok(())
    })?;
    let margin = i32::from(model.has_exact_faces());
    Ok(found.map(|[low, high]| [low.map(|at| at - margin), high.map(|at| at + margin)]))
}

/// Fails if the models' coordinate systems or units of length differ.
fn check_systems(models: &[&ExactModel]) -> Result<()> {
    let names: Vec<String> = models.iter().map(|model| model.path().display().to_string()).collect();
    let mut known: Option<(&str, &Crs)> = None;
    let mut unit: Option<(&str, &str)> = None;
    for (model, name) in models.iter().zip(&names) {
        if let (Some((first, crs)), Some(other)) = (known, model.crs()) {
            Crs::check_same((first, Some(crs)), (name, Some(other)))?;
        }
        known = known.or(model.crs().map(|crs| (name.as_str(), crs)));
        let own = model.metadata().tag(Tag::Unit);
        if let (Some((first, unit)), Some(own)) =
            (unit, own.filter(|own| unit.is_some_and(|(_, unit)| unit != *own)))
        {
            let found = format!("{name}: {own}");
            return Err(Error::invalid("unit", found, format!("{unit}, as {first} has")));
        }
        unit = unit.or(own.map(|unit| (name.as_str(), unit)));
    }
    Ok(())
}

/// Returns the finest grid, or a grid with the coarsest fraction of its unit that divides all
/// units. `None` if no fraction of at most `MAX_PARTS` does.
fn finest_unit(grids: &[&Grid]) -> Option<Grid> {
    /// Maximum denominator of the fraction, such as 5 for units of 0.01 and 0.025.
    const MAX_PARTS: u32 = 1000;
    let finest =
        grids.iter().copied().reduce(|best, grid| if grid.width() < best.width() { grid } else { best })?;
    let of_parts = |parts: u32| Grid { divisor: finest.divisor * f64::from(parts), ..finest.clone() };
    // (Divisors are integers or small. Products beyond that are not exact, and so not found.)
    (1..=MAX_PARTS).map(of_parts).find(|unit| grids.iter().all(|grid| grid.steps_of(unit).is_some()))
}

/// Converts a box on a grid to world coordinates.
pub(super) fn world_box(grid: &Grid, corners: [[i32; 3]; 2]) -> [[f64; 3]; 2] {
    corners.map(|corner| grid.to_world(corner))
}

/// Returns the error for grids without a common unit, where models must not be moved.
pub(super) fn incompatible_grids(models: &[&ExactModel]) -> Error {
    let widths: Vec<String> = models.iter().map(|model| model.grid().width().to_string()).collect();
    let corners = models.iter().flat_map(|model| {
        let last = ((1u64 << model.grid().bits) - 1) as i32;
        [model.grid().to_world([0; 3]), model.grid().to_world([last; 3])]
    });
    let corners: Vec<[f64; 3]> = corners.collect();
    let extents = (0..3).map(|axis| {
        let along = corners.iter().map(|corner| corner[axis]);
        along.clone().fold(f64::MIN, f64::max) - along.fold(f64::MAX, f64::min)
    });
    let extent = extents.fold(0.0, f64::max);
    let wider = (extent / (1u64 << (MAX_BITS - 1)) as f64).log2().ceil().exp2();
    let grids: Vec<&Grid> = models.iter().map(|model| model.grid()).collect();
    let (found, expected) = match finest_unit(&grids) {
        Some(unit) => (
            format!("an extent of {extent} together, in units of {}", unit.width()),
            "at most 2^26 units from end to end",
        ),
        None => (
            format!(
                "units of {}, which have no common unit with at most 2^26 units from end to end",
                widths.join(" and ")
            ),
            "grids with the same unit",
        ),
    };
    let names: Vec<String> = models.iter().map(|model| model.path().display().to_string()).collect();
    let expected = format!(
        "{expected}: snap copies of the models, which moves vertices by up to 0.87 units: `spinney transform MODEL --snap \
         {wider} -o COPY.goblin`"
    );
    Error::invalid(format!("{}: grids", names.join(", ")), found, expected)
}
