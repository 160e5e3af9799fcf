//! Models on one grid, and all their faces.

use std::path::Path;

use super::overlap::{Fate, Overlap};
use super::table::Table;
use crate::brep::arrangement::{Corner, ExactFace, ExactFaces, Turner};
use crate::brep::store::exact::ExactPart;
use crate::brep::{ExactModel, Face, FaceList, Faces, Grid, MOST_BITS, Node, NodeState};
use crate::geometry::crossing::ring_normal;
use crate::{Error, Progress, Result};

/// Models on one grid.
pub(super) struct Placed {
    pub(super) grid: Grid,
    grids: Vec<Grid>,
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

    /// A point of a model on the common grid.
    pub(super) fn point(&self, model: usize, point: [i32; 3]) -> [i32; 3] {
        let (times, shift) = self.shifts[model];
        [0, 1, 2].map(|axis| (times * i64::from(point[axis]) + shift[axis]) as i32)
    }

    /// The cell of a model's node in half steps of the common grid.
    pub(super) fn half_units(&self, model: usize, node: &Node<'_>) -> [[i64; 3]; 2] {
        let (times, shift) = self.shifts[model];
        let bounds = node.bounds(&self.grids[model]);
        bounds.map(|corner| [0, 1, 2].map(|axis| times * corner[axis] + 2 * shift[axis]))
    }

    /// Whether the cell of a model that has a place, in half steps of the common grid, is inside (1) or outside (0); `None` if faces cut it.
    fn place(&self, number: usize, model: &ExactModel, at: [i64; 3]) -> Result<Option<i32>> {
        let mut node = model.root()?;
        let has = |node: &Node<'_>| {
            let [low, high] = self.half_units(number, node);
            (0..3).all(|axis| low[axis] <= at[axis] && at[axis] < high[axis])
        };
        if !has(&node) {
            return Ok(Some(model.far_winding()));
        }
        loop {
            match node.state() {
                NodeState::Void => return Ok(Some(0)),
                NodeState::Full => return Ok(Some(1)),
                NodeState::Leaf { .. } => return Ok(None),
                NodeState::Inner => {
                    let [low, high] = self.half_units(number, &node);
                    let upper = |axis: usize| usize::from(2 * at[axis] >= low[axis] + high[axis]) << axis;
                    node = model.child(&node, upper(0) | upper(1) | upper(2))?;
                }
            }
        }
    }

    /// A face with corners beside a model's grid on the common one.
    fn exact(&self, model: usize, face: ExactFace) -> ExactFace {
        let (times, shift) = self.shifts[model];
        let corner = |corner: Corner| Corner {
            point: corner.point.placed(times, shift),
            line: corner.line.placed(times, shift),
        };
        ExactFace {
            plane: face.plane.placed(times, shift),
            corners: face.corners.into_iter().map(corner).collect(),
            ..face
        }
    }
}

/// Models whose faces are read one after the other, as those of one.
pub(super) struct Bodies<'a> {
    models: &'a [&'a ExactModel],
    placed: &'a Placed,
    table: Table,
    overlaps: Vec<Overlap>,
    /// Whether all faces are taken as near: where corners lie beside the grid, octrees are only those of the faces that stand for
    /// others, which may be some steps off, or nowhere.
    pub(super) are_all_near: bool,
    is_coloured: bool,
    /// Numbers of each model's first part and first source.
    first: Vec<(u32, u64)>,
}

impl<'a> Bodies<'a> {
    /// Goes through all octrees.
    pub(super) fn new(
        models: &'a [&'a ExactModel],
        placed: &'a Placed,
        table: Table,
        progress: &dyn Progress,
    ) -> Result<Bodies<'a>> {
        let (mut overlaps, mut is_coloured) = (Vec::new(), false);
        let mut first = Vec::new();
        let mut parts = 0;
        let are_all_near = models.iter().any(|model| model.exact_bytes() > 0);
        for (number, model) in models.iter().enumerate() {
            if !are_all_near {
                overlaps.push(Overlap::of(number, models, placed, table, progress)?);
            }
            is_coloured |= model.is_coloured()?;
            first.push((parts, 0));
            parts += model.parts().len() as u32;
        }
        Ok(Bodies { models, placed, table, overlaps, are_all_near, is_coloured, first })
    }

    /// The faces that are near other bodies; and where those of each model end.
    pub(super) fn near(&mut self, memory: u64, progress: &dyn Progress) -> Result<(ExactFaces, Vec<u32>)> {
        let parts = self.models.iter().flat_map(|model| model.parts().iter().cloned()).collect();
        let mut found = ExactFaces::of_grid(FaceList::new(self.placed.grid.clone(), parts));
        let (mut ends, mut first_source) = (Vec::new(), 0u64);
        for (number, model) in self.models.iter().enumerate() {
            self.first[number].1 = first_source;
            let mut sources = 0;
            // (A face has about as many bytes in the section as in memory.)
            check_room(model.path(), &found, 2 * model.exact_bytes(), memory)?;
            let ExactPart { faces: exact, stand_ins } = model.exact_part()?;
            let mut stand_ins = stand_ins.into_iter().map(u64::from).peekable();
            self.each(number, progress, &mut |face, fate| {
                sources = sources.max(face.source.saturating_add(1));
                if stand_ins.next_if_eq(&face.number).is_none() && fate.is_none() {
                    found.list.push(face);
                    if found.list.len().is_multiple_of(1 << 12) {
                        check_room(model.path(), &found, 0, memory)?;
                    }
                }
                Ok(())
            })?;
            for mut face in exact {
                if self.is_coloured && face.colours.is_empty() {
                    face.colours = vec![[255; 3]; face.corners.len()];
                }
                let face = self.placed.exact(number, face);
                let part = face.part.saturating_add(self.first[number].0);
                sources = sources.max(face.source.saturating_add(1));
                found.push(ExactFace { part, source: face.source.saturating_add(first_source), ..face });
            }
            check_room(model.path(), &found, 0, memory)?;
            first_source = sources;
            ends.push(found.list.len() as u32);
        }
        Ok((found, ends))
    }

    /// Hands out what becomes of the faces that are not near other bodies.
    pub(super) fn settled(
        &self,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let mut turner = Turner::default();
        for number in 0..self.models.len() {
            self.each(number, progress, &mut |face, fate| match fate {
                Some(Fate::Kept) => each(face),
                Some(Fate::Turned) => each(&turner.turn(face)),
                _ => Ok(()),
            })?;
        }
        Ok(())
    }

    /// What becomes of the faces that are not near other bodies, in a list; `None` if that would be larger than `memory`.
    pub(super) fn all_settled(&self, memory: u64, progress: &dyn Progress) -> Result<Option<FaceList>> {
        // (A triangle takes about as much.)
        const TRIANGLE: u64 = 80;
        if self.models.iter().map(|model| model.len()).sum::<u64>() * TRIANGLE > memory {
            return Ok(None);
        }
        let mut list = FaceList::new(self.placed.grid.clone(), Vec::new());
        self.settled(progress, &mut |face| {
            list.push(face);
            Ok(())
        })?;
        Ok(Some(list))
    }

    /// Hands out the faces of a model on the common grid, with what becomes of those that are not near other bodies.
    fn each(
        &self,
        number: usize,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&Face<'_>, Option<Fate>) -> Result<()>,
    ) -> Result<()> {
        let model = self.models[number];
        let overlap = self.overlaps.get(number);
        let (first_part, first_source) = self.first[number];
        let (mut points, mut white) = (Vec::new(), Vec::new());
        model.each(&mut |face| {
            if face.number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            let fate = match overlap.filter(|overlap| !overlap.near.has(face.number)) {
                None => None,
                Some(overlap) if face.points.len() == 3 && ring_normal(face.points) != [0; 3] => {
                    Some(overlap.fate(face.number))
                }
                Some(overlap) => self.fate_of_sliver(number, face, overlap)?,
            };
            if fate == Some(Fate::Dropped) {
                return each(face, fate);
            }
            points.clear();
            points.extend(face.points.iter().map(|point| self.placed.point(number, *point)));
            white.resize(if self.is_coloured { points.len() } else { 0 }, [255; 3]);
            let colours = if face.colours.is_empty() { &white[..] } else { face.colours };
            let (part, source) =
                (face.part.saturating_add(first_part), face.source.saturating_add(first_source));
            each(&Face { points: &points, colours, part, source, ..*face }, fate)
        })
    }

    /// What becomes of a face, which may have no area: such faces are in no cell, and go where their corners are.
    fn fate_of_sliver(&self, number: usize, face: &Face<'_>, overlap: &Overlap) -> Result<Option<Fate>> {
        if ring_normal(face.rings().next().unwrap_or_default()) != [0; 3] {
            return Ok(Some(overlap.fate(face.number)));
        }
        let at = self.placed.point(number, face.points[0]).map(|at| 2 * i64::from(at));
        let mut places = Vec::new();
        for (other, model) in self.models.iter().enumerate() {
            if other == number {
                places.push(0);
                continue;
            }
            match self.placed.place(other, model, at)? {
                Some(place) => places.push(place),
                None => return Ok(None),
            }
        }
        Ok(Some(self.table.fate(number, &places)))
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
