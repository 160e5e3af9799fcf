//! Operands whose grids have no common unit: choice of a common unit, and the operands moved to it.

use std::path::{Path, PathBuf};

use super::common_grid::{bounds, world_box};
use crate::motion::regrid;
use crate::{ExactModel, Faces, Grid, MAX_BITS};
use spinney_base::io::{FileAccess, Output};
use spinney_base::{Error, Progress, Result};
use tempfile::TempDir;

/// Operands on grids with one unit. Operands with another unit are moved, in temporary files.
pub(super) struct Aligned {
    /// Per operand: index of the moved model, if it was moved.
    moved: Vec<Option<usize>>,
    models: Vec<ExactModel>,
    /// Maximum distance that a vertex was moved, in the models' unit of length.
    pub(super) displacement: f64,
    /// (Dropped last, so that the directory is removed after the models are closed.)
    _directory: TempDir,
}

impl Aligned {
    /// Moves as few operands as possible, by as little as possible. The common unit is an operand's
    /// unit times a power of two.
    pub(super) fn of(
        models: &[&ExactModel],
        directory: &Path,
        access: &FileAccess,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Aligned> {
        let unit = common_unit(models)?;
        let directory =
            tempfile::tempdir_in(directory).map_err(Error::io(directory, "make a temporary directory"))?;
        let (mut moved, mut found) = (Vec::new(), Vec::new());
        let mut displacement = 0.0f64;
        for (index, model) in models.iter().enumerate() {
            if let Some(same) = models[..index].iter().position(|other| std::ptr::eq(*other, *model)) {
                moved.push(moved[same]);
                continue;
            }
            if model.grid().steps_of(&unit).is_some() {
                moved.push(None);
                continue;
            }
            let path: PathBuf = directory.path().join(format!("{index}.goblin"));
            let output = || Output::create(&path);
            let by = regrid(model, &unit, &output, memory, progress)
                .map_err(|error| unlike(error, model, &unit))?;
            displacement = displacement.max(by);
            moved.push(Some(found.len()));
            found.push(ExactModel::open(&path, &access.into())?.named(model.path()));
        }
        let units: Vec<String> = distinct(models).iter().map(|grid| grid.width().to_string()).collect();
        let text = format!(
            "{} of {} models were moved to a common grid with unit {}, by at most {displacement}: their own units are {} \
             (to choose it, snap copies of all: `spinney transform MODEL --snap {} -o COPY.goblin`)",
            moved.iter().flatten().count(),
            models.len(),
            unit.width(),
            shortened(&units),
            unit.width()
        );
        let first = moved.iter().position(Option::is_some).unwrap_or(0);
        progress.warn(models[first].path(), &text);
        Ok(Aligned { moved, models: found, displacement, _directory: directory })
    }

    /// Returns the operands in their original order.
    pub(super) fn models<'a>(&'a self, originals: &[&'a ExactModel]) -> Vec<&'a ExactModel> {
        let moved = self.moved.iter().zip(originals);
        moved.map(|(moved, original)| moved.map_or(*original, |index| &self.models[index])).collect()
    }
}

/// Returns the grids with distinct units, finest first.
fn distinct<'a>(models: &[&'a ExactModel]) -> Vec<&'a Grid> {
    let mut grids: Vec<&Grid> = models.iter().map(|model| model.grid()).collect();
    let key = |grid: &Grid| (grid.width(), grid.step, grid.divisor);
    grids.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
    grids.dedup_by(|a, b| key(a) == key(b));
    grids
}

/// Coordinate bits that are reserved for further operands, unless a grid needs them.
const SPARE_BITS: u8 = 2;

/// Joins the first units' names for a message.
fn shortened(units: &[String]) -> String {
    /// Maximum count of listed units.
    const MAX_UNITS: usize = 4;
    let more = if units.len() > MAX_UNITS { ", ..." } else { "" };
    format!("{}{more}", units[..units.len().min(MAX_UNITS)].join(", "))
}

/// Returns a grid over all models. Its unit leaves the maximum number of models unmoved; ties go to
/// the finest unit.
fn common_unit(models: &[&ExactModel]) -> Result<Grid> {
    let grids = distinct(models);
    let mut all: Option<[[f64; 3]; 2]> = None;
    for model in models {
        let Some(corners) = bounds(model)? else { continue };
        let own = world_box(model.grid(), corners);
        let [low, high] = all.get_or_insert(own);
        for axis in 0..3 {
            low[axis] = low[axis].min(own[0][axis]);
            high[axis] = high[axis].max(own[1][axis]);
        }
    }
    // (Models without faces allow any unit.)
    let all = all.unwrap_or([[0.0; 3]; 2]);
    let longest = (0..3).map(|axis| all[1][axis] - all[0][axis]).fold(0.0, f64::max);
    if !longest.is_finite() {
        return Err(Error::invalid("models", "coordinates that are not finite", "finite ones"));
    }
    let finest = grids[0].width();
    let stay = |unit: &Grid| models.iter().filter(|model| model.grid().steps_of(unit).is_some()).count();
    let candidates = grids.iter().filter_map(|grid| unit_over(all, grid, finest, longest));
    let best = candidates.map(|unit| (stay(&unit), unit)).reduce(|best, other| {
        let is_better = other.0 > best.0 || other.0 == best.0 && other.1.width() < best.1.width();
        if is_better { other } else { best }
    });
    let no_unit = || {
        Error::invalid("models", "bounds too large for any grid of 2^26 units", "models of the same region")
    };
    Ok(best.ok_or_else(no_unit)?.1)
}

/// Returns the finest grid over a box whose unit is `grid`'s unit times a power of two. It is not
/// finer than `finest` and [`SPARE_BITS`] require.
fn unit_over(all: [[f64; 3]; 2], grid: &Grid, finest: f64, longest: f64) -> Option<Grid> {
    let units = |bits: u8| longest / (1u64 << bits) as f64;
    let least = finest.min(units(MAX_BITS - SPARE_BITS)).max(units(MAX_BITS));
    let least = if least > 0.0 { least } else { finest };
    let mut power = (least / grid.width()).log2().floor();
    // (Large origins, or a box whose size is an exact multiple, may need a coarser unit.)
    for _ in 0..MAX_BITS + 4 {
        let step = grid.step * power.exp2();
        // (If all models are points, any unit is fine enough.)
        if (step / grid.divisor).is_normal()
            && let Some(unit) = Grid::fit(widened(all, step / grid.divisor), step, grid.divisor)
        {
            return Some(unit);
        }
        power += 1.0;
    }
    None
}

/// Enlarges a box, for vertices that move to the grid and for proxies of exact faces.
fn widened([low, high]: [[f64; 3]; 2], unit: f64) -> [[f64; 3]; 2] {
    const UNITS: f64 = 2.0;
    [low.map(|at| at - UNITS * unit), high.map(|at| at + UNITS * unit)]
}

/// Adds advice to the error of an operand that is too small or too thin for the common grid.
fn unlike(error: Error, model: &ExactModel, unit: &Grid) -> Error {
    let Error::NotASolid { what, locations, count, .. } = error else { return error };
    let advice = "the models are too far from each other, or differ too much in size, for one grid of 2^26 units: combine cells of \
                  them (build without --brep), or only models that are near each other";
    Error::NotASolid {
        path: model.path().to_path_buf(),
        what: format!("on the common grid of unit {}, {what}", unit.width()),
        locations,
        count,
        advice: advice.into(),
    }
}
