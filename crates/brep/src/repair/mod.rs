//! Repair of surfaces that intersect or overlap themselves, or are partly inside out. Faces are
//! split along their intersections. Faces remain if they bound the inside, which a rule on winding
//! numbers defines.
//!
//! A surface that fits into memory is arranged as a whole ([`repair`]). Of a larger one, only the
//! faces that meet others and those near them are arranged, [in regions](regions).

mod components;
mod edges;
mod input;
mod rays;
mod regions;
mod slabs;
mod spool;
#[cfg(test)]
mod tests;

use std::path::Path;

pub use self::input::RepairInput;
use crate::arrangement::{ExactFaces, FACE, Operands, Resolved, Seams, Surroundings, divide, round};
use crate::closure::SurfaceClosure;
use crate::{FaceList, Faces, ModelBuilder};
use spinney_base::{Error, Progress, Result, SubProgress};

/// Rule that decides from a surface's winding number around a point whether the point is inside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InsideRule {
    /// Any number but 0; cells use this rule.
    #[default]
    Nonzero,
    /// Numbers above 0.
    Positive,
    /// Odd numbers.
    Odd,
}

impl InsideRule {
    /// Returns the rule's name: "nonzero".
    pub fn name(self) -> &'static str {
        match self {
            InsideRule::Nonzero => "nonzero",
            InsideRule::Positive => "positive",
            InsideRule::Odd => "odd",
        }
    }

    fn is_inside(self, winding: i32) -> bool {
        match self {
            InsideRule::Nonzero => winding != 0,
            InsideRule::Positive => winding > 0,
            InsideRule::Odd => winding % 2 != 0,
        }
    }
}

impl std::str::FromStr for InsideRule {
    type Err = Error;

    fn from_str(text: &str) -> Result<InsideRule> {
        let all = [InsideRule::Nonzero, InsideRule::Positive, InsideRule::Odd];
        let known = all.into_iter().find(|rule| rule.name() == text);
        known.ok_or_else(|| Error::invalid("inside rule", text, "nonzero, positive or odd"))
    }
}

/// Statistics of a surface's repair.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Repair {
    /// Faces of the input surface.
    pub faces: u64,
    /// Bodies that were inside out and were reversed together with their contents; and the faces of
    /// both.
    pub turned: (u64, u64),
    /// Pairs of faces that intersect in more than the common boundary of neighbours. Of equal
    /// faces, only the first is in pairs with others, and each other one is in a pair with the
    /// first.
    pub pairs: u64,
    /// Faces that were split, or partly removed.
    pub divided: u64,
    /// Faces that were removed entirely.
    pub removed: u64,
    /// Removed faces that have the outside on both sides.
    pub outside: u64,
    /// Their share of the surface's area. It is at most a half: a surface that would lose more is
    /// rejected.
    pub outside_share: f64,
    /// Volume of the input surface after bodies were reversed, in cubed units of the models.
    /// Regions with winding number 2 count twice.
    pub volume_before: f64,
    /// Volume of the result, in cubed units of the models.
    pub volume: f64,
    /// Volume that cells would have, whose rule is `nonzero`.
    pub cells_volume: f64,
    /// Maximum distance between a new vertex and the grid point that represents it, in the models'
    /// unit. (The vertex itself is exact.)
    pub displacement: f64,
}

impl Repair {
    /// Returns whether the surface needed no repair.
    pub fn is_nothing(&self) -> bool {
        self.turned.0 + self.divided + self.removed == 0
    }
}

/// Maximum share of a surface's area, or of the cells' volume, that a repair may lose.
const MAX_LOST: f64 = 0.5;

/// Minimum share of the surface or the volume whose change causes a warning.
const WORTH_A_WARNING: f64 = 0.01;

/// Maximum number of pairs of faces that may meet: a constant plus a number per face. The intended
/// shape of a surface with more is unknowable.
const MAX_CONTACTS: u64 = 1 << 20;
const MAX_CONTACTS_OF_A_FACE: u64 = 256;

/// Returns the minimum memory of [`repair`] in bytes: that of splitting a surface, and of the
/// faces.
pub(crate) fn repair_bytes(faces: &FaceList) -> u64 {
    faces.len() * FACE + faces.bytes()
}

/// Number of times that a repair's progress counts each face.
pub const REPAIR_PASSES: u64 = 5;

/// Adds a closed surface to a model's builder, without faces that bound no solid; `is_unbounded` if
/// the surface bounds a body that includes infinity. First, outermost components that are inside
/// out are reversed, together with their contents. New vertices at intersections stay exact. `path`
/// is the model's, for errors.
///
/// All faces are held in memory, at most `memory` bytes. Progress counts each face
/// [`REPAIR_PASSES`] times.
///
/// # Errors
/// [`Error::NotASolid`] if nothing is inside, or more than half of the surface or the volume would
/// be lost. Also if the memory is not enough, if the file cannot be written, or on cancellation.
pub(crate) fn repair(
    (faces, is_unbounded): (FaceList, bool),
    rule: InsideRule,
    builder: ModelBuilder,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(ModelBuilder, Repair)> {
    let (width, count) = (faces.grid().width(), faces.len());
    let faces = ExactFaces::of_grid(faces);
    let part = |passes: u64| SubProgress::new(progress, passes * count, REPAIR_PASSES * count);
    let Divided { exact, done, volume, cells_volume } =
        divided((&faces, is_unbounded), rule, path, memory, &part(REPAIR_PASSES - 1))?;
    let Resolved { pairs, divided, removed, outside, outside_share, turned } = done;
    drop(faces);
    warn_of_changes(outside_share, volume / cells_volume, path, progress);
    let mut rounded = round(exact, progress)?;
    let crossings = rounded.crossings(path, memory, progress)?;
    let mut seams = Seams::default();
    seams.add_all(&rounded.faces, progress)?;
    let whole = Surroundings { is_unbounded, reach: 1, rest: None };
    let rounded = rounded.stitch_and_mend(seams, crossings, &whole, path, memory, progress)?;
    let mut surface = SurfaceClosure::new(!rounded.exact.is_empty());
    rounded.faces.each(&mut |face| {
        if face.number.is_multiple_of(1 << 12) {
            progress.check()?;
        }
        surface.add(face, rounded.is_proxy[face.number as usize]);
        Ok(())
    })?;
    rounded.exact.iter().try_for_each(|face| surface.add_exact(face, progress))?;
    refuse_flaw(surface, path)?;
    let displacement = rounded.displacement * width;
    let cube = width.powi(3);
    let repaired = Repair {
        faces: count,
        turned: (turned.roots, turned.faces),
        pairs,
        divided,
        removed,
        outside,
        outside_share,
        volume_before: turned.volume * cube,
        volume: volume * cube,
        cells_volume: cells_volume * cube,
        displacement,
    };
    Ok((builder.push_rounded(rounded, &part(1))?, repaired))
}

/// The result of splitting a surface, with its volume and that of cells, in cubed grid units.
pub(crate) struct Divided {
    exact: ExactFaces,
    done: Resolved,
    volume: f64,
    cells_volume: f64,
}

/// Splits a closed surface, and removes faces that bound no solid; see [`repair`]. Progress counts
/// faces.
pub(crate) fn divided(
    (faces, is_unbounded): (&ExactFaces, bool),
    rule: InsideRule,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Divided> {
    let (width, count) = (faces.list.grid().width(), faces.list.len());
    let all = Operands {
        ends: &[count as u32],
        far: &[i32::from(is_unbounded)],
        turns_roots: !is_unbounded,
        unites_equal_faces: true,
        most_contacts: MAX_CONTACTS_OF_A_FACE * count + MAX_CONTACTS,
        is_inside: &|windings| rule.is_inside(windings[0]),
        ..Operands::NONE
    };
    let times = if rule == InsideRule::Nonzero { 1 } else { 2 };
    let part = || SubProgress::new(progress, count, times * count);
    let (exact, done) = divide(faces, &all, path, memory, &part())?;
    if exact.list.is_empty() {
        return Err(nothing_inside(rule, path));
    }
    let volume = volume(&exact);
    let cells_volume = match rule {
        InsideRule::Nonzero => volume,
        _ => {
            let as_cells = Operands { is_inside: &|windings| windings[0] != 0, ..all };
            self::volume(&divide(faces, &as_cells, path, memory, &part())?.0)
        }
    };
    let volumes = [volume, cells_volume].map(|volume| volume * width.powi(3));
    refuse_losses(rule, (done.outside, count), done.outside_share, volumes, path)?;
    Ok(Divided { exact, done, volume, cells_volume })
}

/// Fails if a repair would lose too much. `outside` are the faces that bound nothing, and all
/// faces. The volume is compared with that of cells: a rule that takes much less is probably not
/// the intended one.
fn refuse_losses(
    rule: InsideRule,
    (outside, count): (u64, u64),
    outside_share: f64,
    [volume, cells_volume]: [f64; 2],
    path: &Path,
) -> Result<()> {
    let lost = outside_share.max(1.0 - volume / cells_volume);
    if lost <= MAX_LOST {
        return Ok(());
    }
    let percent = (lost * 100.0).floor();
    let what = format!(
        "{percent} percent of it would be lost: by the rule {}, {outside} of {count} faces bound nothing, and the volume is \
         {volume} instead of the {cells_volume} of cells, in cubes of the model's unit",
        rule.name(),
    );
    Err(refused(path, what, "choose another rule with --inside"))
}

/// Returns the error for a surface without inside.
fn nothing_inside(rule: InsideRule, path: &Path) -> Error {
    let what = format!("nothing is inside by the rule {}", rule.name());
    refused(path, what, "choose another rule with --inside, or close the surface with --close")
}

/// Warns of unexpected changes.
fn warn_of_changes(outside_share: f64, of_cells: f64, path: &Path, progress: &dyn Progress) {
    if outside_share > WORTH_A_WARNING {
        let percent = outside_share * 100.0;
        progress.warn(path, &format!("{percent:.1} percent of the surface bound nothing and were left out"));
    }
    let change = of_cells - 1.0;
    if change.abs() > WORTH_A_WARNING {
        let percent = change * 100.0;
        progress.warn(
            path,
            &format!("the volume differs by {percent:+.1} percent from that of cells of the models"),
        );
    }
}

/// Fails if the result is not a solid.
fn refuse_flaw(surface: SurfaceClosure, path: &Path) -> Result<()> {
    let Some(flaw) = surface.flaw() else { return Ok(()) };
    let what = format!("the result would not be a solid: {flaw}");
    Err(refused(path, what, "build cells of it (without --brep), and report it"))
}

fn refused(path: &Path, what: String, advice: &str) -> Error {
    let (locations, count) = (Vec::new(), 0);
    Error::NotASolid { path: path.to_path_buf(), what, locations, count, advice: advice.into() }
}

/// Returns the approximate volume within a surface, in cubed grid units.
pub(crate) fn volume(faces: &ExactFaces) -> f64 {
    six_volumes(faces, 0) / 6.0
}

/// Returns six times the volume, with `more` from other faces.
fn six_volumes(faces: &ExactFaces, more: i128) -> f64 {
    let on_grid = (0..faces.list.len() as u32).filter(|number| !faces.exact.contains_key(number));
    let whole: i128 = on_grid.map(|number| faces.list.get(number as usize).six_volumes()).sum();
    // (In the order of their numbers, since the rounding of sums depends on it.)
    let mut numbers: Vec<u32> = faces.exact.keys().copied().collect();
    numbers.sort_unstable();
    let off_grid: f64 = numbers.iter().map(|number| faces.exact[number].six_volumes()).sum();
    (whole + more) as f64 + off_grid
}
