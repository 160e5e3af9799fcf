//! Set operations on bodies: the sixteen of O. A. Tyukachev (2010), on surfaces, exact up to moving new vertices to the grid.
//!
//! A body is an oriented surface and a bit that says whether what is far away belongs to it. With that bit all sixteen
//! operations make bodies: nothing and everything have no faces and differ in the bit, and a complement has the same
//! faces turned round. The number of an operation is its truth table, and a face stays where the table has different
//! values in front of it and behind it (the index theorem; where faces of two bodies lie on each other, the windings of both
//! change, so that faces turned the same way and faces turned to each other come out right without a code of their own).

use super::arrangement::{Corner, ExactFace, ExactFaces, Operands, Rounded, Rounds, divide, round};
use super::attributes::DOMAIN;
use super::store::exact::ExactPart;
use super::{Attributes, BOOLEAN_FACES, BuildReport, ExactModel, Face, FaceList, Faces, Grid, ModelBuilder};
use std::path::Path;

use crate::io::Output;
use crate::store::{Metadata, TagScope};
use crate::{Error, Progress, Result};

/// Counts of a set operation on bodies.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct CombineReport {
    /// Faces of each body.
    pub before: Vec<u64>,
    /// Faces of the result.
    pub after: u64,
    /// Pairs of faces that touch or pass through each other.
    pub pairs: u64,
    /// Faces that were divided, or of which a part was taken away.
    pub divided: u64,
    /// The furthest that a new vertex was moved to the grid, in the models' unit.
    pub displacement: f64,
    /// The grid.
    pub grid: Grid,
    /// Whether what is far away belongs to the result.
    pub is_unbounded: bool,
    /// Counts of the octree.
    pub built: BuildReport,
}

/// Set operations, by their numbers: bit 0 says that what is in both bodies belongs to the result, bit 1 what is in the
/// first alone, bit 2 what is in the second alone, bit 3 what is in neither. Of more than two bodies there are 0, 1 (what is in
/// all), 2 (in the first alone), 6 (in an odd number of them), 7 (in any) and the complements of these; of one, all that
/// depend on no second: 0, 3, 12 and 15.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Table {
    number: u8,
    count: usize,
}

impl Table {
    fn new(number: u8, count: usize) -> Result<Table> {
        let (bodies, are_right) = match number {
            0 | 3 | 12 | 15 if count == 1 => ("one body or more", true),
            0 | 1 | 2 | 6 | 7 | 8 | 9 | 13 | 14 | 15 => ("two bodies or more", count >= 2),
            3 | 12 => ("one body or two", count <= 2 && count > 0),
            _ => ("two bodies", count == 2),
        };
        if number > 15 || !are_right {
            let found = format!("operation {number} of {count}");
            return Err(Error::invalid("bodies", found, format!("{bodies} for an operation from 0 to 15")));
        }
        Ok(Table { number, count })
    }

    /// Whether a place belongs to the result that lies in those of the bodies.
    fn is_inside(self, bodies: &[i32]) -> bool {
        let is_in = |body: usize| bodies.get(body).is_some_and(|winding| *winding > 0);
        if self.count <= 2 {
            let index = match (is_in(0), is_in(1)) {
                (true, true) => 0,
                (true, false) => 1,
                (false, true) => 2,
                (false, false) => 3,
            };
            return self.number >> index & 1 == 1;
        }
        // (Of two bodies these are the same as the table.)
        let (turned, base) =
            if self.number & 8 != 0 { (true, 15 - self.number) } else { (false, self.number) };
        let inside = match base {
            1 => (0..self.count).all(is_in),
            2 => is_in(0) && !(1..self.count).any(is_in),
            6 => (0..self.count).filter(|body| is_in(*body)).count() % 2 == 1,
            7 => (0..self.count).any(is_in),
            _ => false,
        };
        inside != turned
    }
}

/// Makes the body of a set operation on others, and writes it into a file; `operation` is a number from 0 to 15: bit 0 says that
/// what is in both bodies belongs to the result, bit 1 what is in the first alone, bit 2 what is in the second alone, bit 3
/// what is in neither. So 1 is the intersection, 2 and 4 are the differences, 6 the symmetric difference, 7 the union, 12
/// the complement of the first. Of more than two bodies there are 0, 1 (what is in all), 2 (in the first alone), 6 (in an odd
/// number of them), 7 (in any), and 8, 9, 13, 14, 15, the complements of these; of one 0, 3, 12 and 15.
///
/// Grids must have the same step, or steps that are multiples of the least; coordinates stay as they are but for new vertices,
/// which go to the nearest points of the grid. Names of parts are those of all bodies, one after the other. Memory:
/// all faces, with about 250 bytes each.
///
/// ```
/// use spinney::brep::{ExactModel, combine};
/// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// use spinney::io::Output;
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = |name: &str| folder.path().join(name);
/// # let text = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
/// # std::fs::write(path("a.off"), text).unwrap();
/// # import_exact(open_all(&[path("a.off")], 64 << 20)?, &ExactOptions::new(), Output::create(&path("a.goblin"))?, &())?;
/// let a = ExactModel::open(&path("a.goblin"), &Default::default())?;
/// let report = combine(2, &[&a, &a], Output::create(&path("nothing.goblin"))?, 64 << 20, &())?;
/// assert_eq!((report.after, report.is_unbounded), (0, false));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If there is no such operation of so many bodies, if the grids do not fit together, if the memory is not enough, if the grid
/// cannot hold the result, if files cannot be read or written, or on interruption. There is no file then.
pub fn combine(
    operation: u8,
    models: &[&ExactModel],
    output: Output,
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    let table = Table::new(operation, models.len())?;
    let first = models[0];
    let placed = Placed::of(models)?;
    let grid = placed.grid.clone();
    let (faces, ends) = placed.faces(models, memory / 2, progress)?;
    let far: Vec<i32> = models.iter().map(|model| model.is_unbounded().into()).collect();
    let operands = Operands {
        ends: &ends,
        far: &far,
        are_bodies: true,
        changed: &[],
        is_inside: &|windings| table.is_inside(windings),
    };
    let is_unbounded = table.is_inside(&far);
    let before = models.iter().map(|model| model.len()).collect();
    let (exact, mut done) = divide(&faces, &operands, first.path(), memory / 2, progress)?;
    drop(faces);
    let rounded = round(exact, is_unbounded, first.path(), memory / 2, progress, &mut done)?;
    let Rounded { faces, stands_in, exact } = rounded;
    let Rounds { pairs, divided, displacement, .. } = done;
    let displacement = displacement * grid.width();
    let after = faces.len();
    let stand_ins =
        (0..).zip(stands_in).filter_map(|(number, stands_in)| stands_in.then_some(number)).collect();
    let mut builder = ModelBuilder::new(output, grid.clone(), memory / 2)?
        .boolean_faces(BOOLEAN_FACES)
        .unbounded(is_unbounded)
        .exact(ExactPart { faces: exact, stand_ins });
    faces.each(&mut |face| builder.push(face))?;
    drop(faces);
    let mut metadata = metadata(operation, models, &grid);
    metadata.tags.insert("model.displacement".into(), displacement.to_string());
    let built = builder.finish(&mut metadata, progress, &mut |_, _| ())?;
    if built.defect_count > 0 {
        return Err(built.error(
            first.path(),
            "the grid cannot hold the result: where new vertices were moved to it, the surface passes through itself",
            "build the models on a finer grid (--grid)",
        ));
    }
    Ok(CombineReport { before, after, pairs, divided, displacement, grid, is_unbounded, built })
}

/// Names, attributes, unit and place of the result.
fn metadata(operation: u8, models: &[&ExactModel], grid: &Grid) -> Metadata {
    let first = models[0].metadata();
    let mut metadata = Metadata { frame: grid.frame(first.frame.crs.clone()), ..Metadata::default() };
    let names = models.iter().flat_map(|model| model.parts());
    metadata.class_names = (0..).zip(names.clone().cloned()).collect();
    metadata.provenance = models.iter().flat_map(|model| model.metadata().provenance.clone()).collect();
    let paths: Vec<String> = models.iter().map(|model| model.path().display().to_string()).collect();
    metadata.provenance.push(format!("operation {operation} of {}", paths.join(" ")));
    let unit = models.iter().find_map(|model| model.metadata().tags.get("unit"));
    metadata.tags.extend(unit.map(|unit| ("unit".to_string(), unit.clone())));
    let mut attributes = Attributes::beside(names.map(|name| name.len() + 10).sum());
    let mut parts = 0;
    for model in models {
        attributes.append(&model.attributes(), parts, model.parts().len() as u32);
        parts += model.parts().len() as u32;
    }
    if attributes.lost() > 0 {
        metadata.tags.insert("model.lost_attributes".into(), attributes.lost().to_string());
    }
    if !attributes.is_empty() {
        metadata.scoped_tags.insert(TagScope { channel: None, domain: DOMAIN.into() }, attributes.to_tags());
    }
    metadata
}

/// Models on one grid.
struct Placed {
    grid: Grid,
    /// Of each model: steps of the grid in one of its own, and what is added then.
    shifts: Vec<(i64, [i64; 3])>,
}

impl Placed {
    fn of(models: &[&ExactModel]) -> Result<Placed> {
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
        if bits > super::MOST_BITS || origin.iter().any(|at| at.unsigned_abs() > 1 << 53) {
            return Err(too_far(&grids));
        }
        let grid = Grid { bits, origin, step: finest.step, divisor: finest.divisor };
        for (_, shift) in &mut shifts {
            (0..3).for_each(|axis| shift[axis] -= origin[axis]);
        }
        Ok(Placed { grid, shifts })
    }

    /// The faces of all models in a list, and where those of each end.
    fn faces(
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Tyukachev's table of the sets: A and B, A alone, B alone, neither, as bits of the operation.
    #[test]
    fn tables_are_those_of_the_literature() {
        let places = [[1, 1], [1, 0], [0, 1], [0, 0]];
        for number in 0..16 {
            let table = Table::new(number, 2).unwrap();
            let found: u8 =
                (0..).zip(places).map(|(bit, place)| u8::from(table.is_inside(&place)) << bit).sum();
            assert_eq!(found, number);
            // Those of many are the same for two, and go on with the third where that is in nothing, or in what was there.
            let Ok(of_three) = Table::new(number, 3) else { continue };
            for [a, b] in places {
                let nothing = of_three.is_inside(&[a, b, 0]);
                if matches!(number, 0 | 2 | 6 | 7 | 8 | 9 | 13 | 15) {
                    assert_eq!(nothing, table.is_inside(&[a, b]), "{number}");
                }
            }
        }
        assert!(Table::new(16, 2).is_err() && Table::new(7, 0).is_err() && Table::new(4, 3).is_err());
        assert!(Table::new(12, 1).unwrap().is_inside(&[0]) && !Table::new(12, 1).unwrap().is_inside(&[1]));
    }
}
