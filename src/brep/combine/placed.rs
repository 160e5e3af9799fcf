//! Models on one grid, and all their faces.

use std::path::Path;

use crate::brep::arrangement::{Corner, ExactFace, ExactFaces};
use crate::brep::store::exact::ExactPart;
use crate::brep::{ExactModel, Face, FaceList, Faces, Grid, MOST_BITS};
use crate::{Error, Progress, Result};

/// Models on one grid.
pub(super) struct Placed {
    pub(super) grid: Grid,
    /// Of each model: steps of the grid in one of its own, and what is added then.
    shifts: Vec<(i64, [i64; 3])>,
}

impl Placed {
    pub(super) fn of(models: &[&ExactModel]) -> Result<Placed> {
        let grids: Vec<&Grid> = models.iter().map(|model| model.grid()).collect();
        let finest =
            grids.iter().copied().reduce(|best, grid| if grid.width() < best.width() { grid } else { best });
        let finest = finest.expect("operations have one body or more");
        let mut least = [i64::MAX; 3];
        let mut most = [i64::MIN; 3];
        let mut shifts = Vec::new();
        for model in models {
            let grid = model.grid();
            let times = grid.steps_of(finest).ok_or_else(|| {
                let found = format!("{}: steps of {}", model.path().display(), grid.width());
                let expected = format!(
                    "multiples of {}, as the others have: build the models on one grid, for example with --grid {}",
                    finest.width(),
                    grids.iter().map(|grid| grid.width()).fold(0.0, f64::max)
                );
                Error::invalid("grid", found, expected)
            })?;
            let origin = grid.origin.map(|at| i128::from(at) * i128::from(times));
            if origin.iter().any(|at| at.unsigned_abs() > 1 << 62) {
                return Err(too_far(&grids));
            }
            let origin = origin.map(|at| at as i64);
            shifts.push((times, origin));
            if let Some([low, high]) = model.grid_bounds()? {
                for axis in 0..3 {
                    least[axis] = least[axis].min(origin[axis] + times * i64::from(low[axis]));
                    most[axis] = most[axis].max(origin[axis] + times * i64::from(high[axis]));
                }
            }
        }
        if least[0] > most[0] {
            // No model has a face.
            (least, most) = (shifts[0].1, shifts[0].1);
        }
        // The first model's own grid, if there is room for all.
        let first = shifts[0].1;
        let side = 1i64 << models[0].grid().bits;
        let is_own = shifts[0].0 == 1
            && (0..3).all(|axis| least[axis] >= first[axis] && most[axis] - first[axis] < side);
        let (origin, bits) = match is_own {
            true => (first, models[0].grid().bits),
            false => {
                let extent = (0..3).map(|axis| most[axis].abs_diff(least[axis])).max().unwrap_or(0);
                (least, (64 - extent.leading_zeros() as u8).max(1))
            }
        };
        if bits > MOST_BITS || origin.iter().any(|at| at.unsigned_abs() > 1 << 53) {
            return Err(too_far(&grids));
        }
        let grid = Grid { bits, origin, step: finest.step, divisor: finest.divisor };
        for (_, shift) in &mut shifts {
            (0..3).for_each(|axis| shift[axis] -= origin[axis]);
        }
        Ok(Placed { grid, shifts })
    }

    /// The faces of all models in a list, and where those of each end.
    pub(super) fn faces(
        &self,
        models: &[&ExactModel],
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<(ExactFaces, Vec<u32>)> {
        let parts = models.iter().flat_map(|model| model.parts().iter().cloned()).collect();
        let mut found = ExactFaces::of_grid(FaceList::new(self.grid.clone(), parts));
        let mut is_coloured = false;
        for model in models {
            is_coloured |= model.is_coloured()?;
        }
        let mut ends = Vec::new();
        let (mut first_part, mut first_source) = (0, 0);
        let mut points = Vec::new();
        for (model, (times, shift)) in models.iter().zip(&self.shifts) {
            let mut sources = 0;
            // (A face has about as many bytes in the section as in memory.)
            check_room(model.path(), &found, 2 * model.exact_bytes(), memory)?;
            let ExactPart { faces: exact, stand_ins } = model.exact_part()?;
            let mut stand_ins = stand_ins.into_iter().map(u64::from).peekable();
            let white = |count: usize| vec![[255; 3]; count];
            model.each(&mut |face| {
                if found.list.len().is_multiple_of(1 << 12) {
                    progress.check()?;
                    check_room(model.path(), &found, 0, memory)?;
                }
                sources = sources.max(face.source.saturating_add(1));
                if stand_ins.next_if_eq(&face.number).is_some() {
                    return Ok(());
                }
                points.clear();
                points.extend(face.points.iter().map(|point| {
                    [0, 1, 2].map(|axis| (times * i64::from(point[axis]) + shift[axis]) as i32)
                }));
                let colours;
                let colours = match (is_coloured, face.colours) {
                    (true, []) => {
                        colours = white(points.len());
                        &colours
                    }
                    (_, colours) => colours,
                };
                let (part, source) = (first_part + face.part, face.source.saturating_add(first_source));
                found.list.push(&Face { points: &points, colours, part, source, ..*face });
                Ok(())
            })?;
            for face in exact {
                let colours = match (is_coloured, face.colours.len()) {
                    (true, 0) => white(face.corners.len()),
                    _ => face.colours,
                };
                let corner = |corner: Corner| Corner {
                    point: corner.point.placed(*times, *shift),
                    line: corner.line.placed(*times, *shift),
                };
                sources = sources.max(face.source.saturating_add(1));
                found.push(ExactFace {
                    plane: face.plane.placed(*times, *shift),
                    corners: face.corners.into_iter().map(corner).collect(),
                    ring_ends: face.ring_ends,
                    colours,
                    part: first_part + face.part,
                    source: face.source.saturating_add(first_source),
                });
            }
            check_room(model.path(), &found, 0, memory)?;
            first_part += model.parts().len() as u32;
            first_source = sources.saturating_add(first_source);
            ends.push(found.list.len() as u32);
        }
        Ok((found, ends))
    }
}

/// Fails if faces, and so many bytes more, are too much.
fn check_room(path: &Path, faces: &ExactFaces, more: u64, memory: u64) -> Result<()> {
    let needed = faces.list.bytes().saturating_add(more);
    if needed <= memory && faces.list.len() < 1 << 31 {
        return Ok(());
    }
    Err(Error::TooLarge {
        path: path.to_path_buf(),
        what: "the faces of the models that are to be combined".into(),
        needed,
        limit: memory,
        advice: "allow more with --memory".into(),
    })
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
            "at most 2^26 steps from end to end: build the models on a coarser grid, for example with --grid {wider}"
        ),
    )
}
