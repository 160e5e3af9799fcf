//! Models on one grid.

use crate::arrangement::{Corner, ExactFace, ExactPoint};
use crate::query::half_of;
use crate::{ExactModel, Faces, Grid, MAX_BITS, ModelNode, ModelNodeState};
use spinney_base::{Error, Result};
use spinney_container::Tag;
use spinney_crs::Crs;

/// Models on one grid.
pub(super) struct Placed {
    pub(super) grid: Grid,
    grids: Vec<Grid>,
    /// Of each model: steps of the grid in one of its own, and what is added then.
    shifts: Vec<(i64, [i64; 3])>,
}

impl Placed {
    /// Finds the grid that holds all models: that of the first, if it does.
    pub(super) fn of(models: &[&ExactModel]) -> Result<Placed> {
        check_systems(models)?;
        let grids: Vec<&Grid> = models.iter().map(|model| model.grid()).collect();
        let finest =
            grids.iter().copied().reduce(|best, grid| if grid.width() < best.width() { grid } else { best });
        let finest = finest.expect("operations have one body or more");
        let mut shifts = Vec::new();
        for model in models {
            let grid = model.grid();
            let times = grid.steps_of(finest).ok_or_else(|| {
                let found = format!("{}: steps of {}", model.path().display(), grid.width());
                let expected = format!(
                    "multiples of {}, as the others have: build the models on one grid, for example with --snap {}",
                    finest.width(),
                    grids.iter().map(|grid| grid.width()).fold(0.0, f64::max)
                );
                Error::invalid("grid", found, expected)
            })?;
            let origin = grid.origin.map(|at| i128::from(at) * i128::from(times));
            if origin.iter().any(|at| at.unsigned_abs() > 1 << 62) {
                return Err(too_far(&grids));
            }
            shifts.push((times, origin.map(|at| at as i64)));
        }
        let placed = |model: usize, corner: [i32; 3]| {
            let (times, origin) = shifts[model];
            [0, 1, 2].map(|axis| origin[axis] + times * i64::from(corner[axis]))
        };
        let box_of = |model: usize| -> Result<Option<[[i64; 3]; 2]>> {
            Ok(bounds(models[model])?.map(|corners| corners.map(|corner| placed(model, corner))))
        };
        // The first model's own grid, if there is room for all.
        let ((times, mut origin), mut bits) = (shifts[0], models[0].grid().bits);
        let fits = |[low, high]: [[i64; 3]; 2]| {
            (0..3).all(|axis| low[axis] >= origin[axis] && high[axis] - origin[axis] < 1 << bits)
        };
        let mut is_own = times == 1;
        for (model, file) in models.iter().enumerate() {
            let last = ((1u64 << file.grid().bits) - 1) as i32;
            // (That all of its grid has room is known without a look at faces.)
            is_own = is_own
                && (fits([[0; 3], [last; 3]].map(|corner| placed(model, corner)))
                    || box_of(model)?.is_none_or(fits));
        }
        if !is_own {
            let (mut least, mut most) = ([i64::MAX; 3], [i64::MIN; 3]);
            for model in 0..models.len() {
                let [low, high] = box_of(model)?.unwrap_or([least, most]);
                least = [0, 1, 2].map(|axis| least[axis].min(low[axis]));
                most = [0, 1, 2].map(|axis| most[axis].max(high[axis]));
            }
            // (No model may have a face.)
            if least[0] <= most[0] {
                origin = least;
            }
            let extent = (0..3).map(|axis| most[axis].saturating_sub(least[axis]).max(0)).max().unwrap_or(0);
            bits = (64 - extent.leading_zeros() as u8).max(1);
        }
        if bits > MAX_BITS || origin.iter().any(|at| at.unsigned_abs() > 1 << 53) {
            return Err(too_far(&grids));
        }
        let grid = Grid { bits, origin, step: finest.step, divisor: finest.divisor };
        for (_, shift) in &mut shifts {
            (0..3).for_each(|axis| shift[axis] -= origin[axis]);
        }
        Ok(Placed { grid, grids: grids.into_iter().cloned().collect(), shifts })
    }

    /// Some of the models, on the same grid.
    pub(super) fn of_those(&self, those: &[usize]) -> Placed {
        Placed {
            grid: self.grid.clone(),
            grids: those.iter().map(|number| self.grids[*number].clone()).collect(),
            shifts: those.iter().map(|number| self.shifts[*number]).collect(),
        }
    }

    /// Steps of the common grid in one of a model's own.
    pub(super) fn times(&self, model: usize) -> i64 {
        self.shifts[model].0
    }

    /// A point of a model on the common grid.
    pub(super) fn point(&self, model: usize, point: [i32; 3]) -> [i32; 3] {
        let (times, shift) = self.shifts[model];
        [0, 1, 2].map(|axis| (times * i64::from(point[axis]) + shift[axis]) as i32)
    }

    /// The cell of a model's node in half steps of the common grid.
    pub(super) fn half_units(&self, model: usize, node: &ModelNode<'_>) -> [[i64; 3]; 2] {
        let (times, shift) = self.shifts[model];
        let bounds = node.bounds(&self.grids[model]);
        bounds.map(|corner| [0, 1, 2].map(|axis| times * corner[axis] + 2 * shift[axis]))
    }

    /// The winding number of a model's surface all over the cell that has a point of the common grid, in half steps; `None` if faces are
    /// in the cell or near it.
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

    /// A point beside a model's grid on the common one.
    pub(super) fn exact_point(&self, model: usize, point: ExactPoint) -> ExactPoint {
        let (times, shift) = self.shifts[model];
        point.placed(times, shift)
    }

    /// A face with corners beside a model's grid on the common one.
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

/// Least and greatest coordinates of a model on its grid: what is thinner than a step may be nowhere in the octree.
fn bounds(model: &ExactModel) -> Result<Option<[[i32; 3]; 2]>> {
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
    Ok(found)
}

/// Fails if models tell different coordinate systems or units of length.
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

/// The error of models that no grid of so many points holds.
fn too_far(grids: &[&Grid]) -> Error {
    let widths: Vec<String> = grids.iter().map(|grid| grid.width().to_string()).collect();
    let side = grids.iter().map(|grid| (1u64 << grid.bits) as f64 * grid.width()).fold(0.0, f64::max);
    // Room for several of the largest side by side.
    let wider = (side / (1u64 << 24) as f64).log2().ceil().exp2();
    Error::invalid(
        "grid",
        format!("steps of {} over models that are far apart", widths.join(", ")),
        format!(
            "at most 2^26 steps from end to end: build the models on a coarser grid, for example with --snap {wider}"
        ),
    )
}
