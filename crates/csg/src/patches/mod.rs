//! Solids that are enclosed by biquadratic and bicubic Bezier patches.
//!
//! A shell is a closed and connected surface of patches (`Shell`, in this file). Patches are
//! adjacent where they have equal boundary curves. Facets approximate a shell (`facetting.rs`), and
//! cells are tested against facets (`facet_tree.rs`). Patches come from CSG text, or from files of
//! patches (`file.rs`).

mod facet_tree;
mod facetting;
mod file;
mod patch;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::path::Path;

pub(crate) use self::facet_tree::FacetTree;
pub(crate) use self::file::{csg_of_patches, is_patch_file};
use self::patch::Curve;
pub(crate) use self::patch::{Patch, Point};
use crate::syntax::wrong;
use spinney_base::Result;

/// Names of a patch's sides, in the order of [`Patch::boundary`].
const SIDES: [&str; 4] = ["v = 0", "u = 1", "v = 1", "u = 0"];

/// Maximum volume of a shell that encloses nothing, relative to the cube of its size: sums of
/// products of three coordinates have a relative error of about 2^-50 for each of thousands of
/// patches.
const NO_VOLUME: f64 = 1e-12;
/// Maximum second derivative of a flat patch with straight sides, relative to the coordinates: the
/// error of differences of control points.
const STRAIGHT: f64 = 1e-14;
/// Maximum number of divisions of a patch into quarters that bound its extents.
const MAX_DIVISIONS: usize = 4;
/// Number of parts of a shell's patches up to which these are divided again.
const MAX_PARTS: usize = 1 << 12;

/// A side of a patch in a shell.
#[derive(Clone, Copy, Debug)]
enum ShellSide {
    /// The side is a single point.
    Pole,
    /// The side is a boundary curve, by its number, or that curve in the opposite direction.
    Curve(u32, bool),
}

/// A patch in a shell.
#[derive(Clone, Debug)]
struct ShellPatch {
    patch: Patch,
    sides: [ShellSide; 4],
    /// Whether the normal, the product of the derivatives in u and v, points inwards.
    is_reversed: bool,
}

/// A closed and connected surface of patches.
#[derive(Clone, Debug)]
pub(crate) struct Shell {
    patches: Vec<ShellPatch>,
    curves: Vec<Curve>,
    /// The volume that it encloses.
    pub(crate) volume: f64,
    /// Points whose convex hull contains the shell, and is close to its extents.
    pub(crate) hull: Vec<Point>,
}

/// A use of a boundary curve: patch, side, and whether the curve has the direction of the side.
#[derive(Clone, Copy)]
struct CurveUse {
    patch: usize,
    side: usize,
    is_forward: bool,
}

/// Formats a point for messages.
fn shown([x, y, z]: Point) -> String {
    format!("({x}, {y}, {z})")
}

/// Groups patches into shells.
///
/// # Errors
/// If a boundary curve belongs to one patch only or to more than two, if a curve returns along
/// itself, if a shell has no outside (as a Klein bottle) or no volume. Messages name patches by
/// their number, from 1.
pub(crate) fn shells(path: &Path, patches: Vec<Patch>) -> Result<Vec<Shell>> {
    let mut curves: Vec<Curve> = Vec::new();
    let mut uses: Vec<Vec<CurveUse>> = Vec::new();
    let mut numbers = HashMap::new();
    let mut sides = vec![[ShellSide::Pole; 4]; patches.len()];
    for (number, patch) in patches.iter().enumerate() {
        for (side, shell_side) in sides[number].iter_mut().enumerate() {
            let curve = patch.boundary(side);
            if curve.is_point() {
                continue;
            }
            let (own, reversed) = (curve.key(), curve.reversed().key());
            if own == reversed {
                let found = format!(
                    "the boundary {} of patch {}, which returns along itself,",
                    SIDES[side],
                    number + 1
                );
                return Err(wrong(
                    path,
                    patch.at,
                    found,
                    "a curve from one point to another, a loop, or a point",
                ));
            }
            let is_forward = own < reversed;
            let key = if is_forward { own } else { reversed };
            let index = *numbers.entry(key).or_insert(curves.len());
            if index == curves.len() {
                curves.push(if is_forward { curve } else { curve.reversed() });
                uses.push(Vec::new());
            }
            uses[index].push(CurveUse { patch: number, side, is_forward });
            *shell_side = ShellSide::Curve(index as u32, is_forward);
        }
    }
    check_pairs(path, &patches, &curves, &uses)?;
    // Adjacent patches have the same orientation if they use their common curve in opposite
    // directions.
    let mut is_reversed: Vec<Option<bool>> = vec![None; patches.len()];
    let mut components = Vec::new();
    for first in 0..patches.len() {
        if is_reversed[first].is_some() {
            continue;
        }
        is_reversed[first] = Some(false);
        let (mut component, mut next) = (vec![first], 0);
        while next < component.len() {
            let patch = component[next];
            next += 1;
            for side in sides[patch] {
                let ShellSide::Curve(index, _) = side else { continue };
                let [one, other] = uses[index as usize][..] else { continue };
                let (one, other) = if one.patch == patch { (one, other) } else { (other, one) };
                let own = is_reversed[patch] == Some(true);
                let expected = own != (one.is_forward == other.is_forward);
                match is_reversed[other.patch] {
                    None => {
                        is_reversed[other.patch] = Some(expected);
                        component.push(other.patch);
                    }
                    Some(found) if found == expected => {}
                    Some(_) => {
                        let found = format!(
                            "patches {} and {} on a surface with a single side",
                            patch + 1,
                            other.patch + 1
                        );
                        return Err(wrong(path, patches[patch].at, found, "a surface around a solid"));
                    }
                }
            }
        }
        component.sort_unstable();
        components.push(component);
    }
    components
        .iter()
        .map(|component| shell(path, component, &patches, &sides, &curves, &is_reversed))
        .collect()
}

/// Checks that each boundary curve belongs to two patches.
fn check_pairs(path: &Path, patches: &[Patch], curves: &[Curve], uses: &[Vec<CurveUse>]) -> Result<()> {
    let single = |index: &usize| uses[*index].len() == 1;
    let ends = |index: usize| {
        let [from, to] = curves[index].ends();
        format!("from {} to {}", shown(from), shown(to))
    };
    for (index, uses_of) in uses.iter().enumerate() {
        let CurveUse { patch, side, .. } = uses_of[0];
        let (at, name) = (patches[patch].at, SIDES[side]);
        if uses_of.len() > 2 {
            let numbers: Vec<String> =
                uses_of.iter().take(8).map(|used| (used.patch + 1).to_string()).collect();
            let found = format!(
                "a boundary curve {} of {} patches: {}",
                ends(index),
                uses_of.len(),
                numbers.join(", ")
            );
            return Err(wrong(path, at, found, "two patches at each boundary curve"));
        }
        if uses_of.len() == 1 {
            // A second curve without a counterpart between the same points should have been equal.
            let points = |index: usize| {
                let mut ends = curves[index].ends().map(|point| point.map(f64::to_bits));
                ends.sort_unstable();
                ends
            };
            let similar =
                (index + 1..curves.len()).filter(single).find(|other| points(*other) == points(index));
            let (found, expected) = match similar {
                Some(other) => (
                    format!(
                        "different boundary curves of the patches {} and {}, {}",
                        patch + 1,
                        uses[other][0].patch + 1,
                        ends(index)
                    ),
                    "equal control points where patches are adjacent",
                ),
                None => (
                    format!(
                        "an open shell: the boundary {name} of patch {}, {}, has no other patch",
                        patch + 1,
                        ends(index)
                    ),
                    "a closed shell, in which each boundary curve belongs to two patches",
                ),
            };
            return Err(wrong(path, at, found, expected));
        }
    }
    Ok(())
}

/// Creates the shell of a component.
fn shell(
    path: &Path,
    component: &[usize],
    patches: &[Patch],
    sides: &[[ShellSide; 4]],
    curves: &[Curve],
    is_reversed: &[Option<bool>],
) -> Result<Shell> {
    let mut made = Shell { patches: Vec::new(), curves: Vec::new(), volume: 0.0, hull: Vec::new() };
    let mut renumbered = HashMap::new();
    for number in component {
        let sides = sides[*number].map(|side| match side {
            ShellSide::Pole => ShellSide::Pole,
            ShellSide::Curve(index, is_forward) => {
                let new = *renumbered.entry(index).or_insert_with(|| {
                    made.curves.push(curves[index as usize].clone());
                    made.curves.len() as u32 - 1
                });
                ShellSide::Curve(new, is_forward)
            }
        });
        let is_reversed = is_reversed[*number] == Some(true);
        made.patches.push(ShellPatch { patch: patches[*number].clone(), sides, is_reversed });
    }
    let [low, high] = made.bounds();
    let middle = [0, 1, 2].map(|axis| low[axis] / 2.0 + high[axis] / 2.0);
    let sizes = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let flux = |ShellPatch { patch, is_reversed, .. }: &ShellPatch| {
        if *is_reversed { -patch.flux(middle) } else { patch.flux(middle) }
    };
    made.volume = made.patches.iter().map(flux).sum();
    // (A flat or doubly covered shell has a volume of rounding errors.)
    let largest = sizes.iter().fold(0.0, |most: f64, size| most.max(*size)).powi(3);
    if made.volume.abs() <= largest * NO_VOLUME || !made.volume.is_finite() {
        let found = format!("a shell of {} patches without a volume", made.patches.len());
        return Err(wrong(path, made.patches[0].patch.at, found, "patches that enclose a solid"));
    }
    if made.volume < 0.0 {
        made.volume = -made.volume;
        made.patches.iter_mut().for_each(|patch| patch.is_reversed = !patch.is_reversed);
    }
    let divisions =
        (0..MAX_DIVISIONS).take_while(|divisions| component.len() << (2 * divisions) < MAX_PARTS).count();
    made.hull = made.patches.iter().flat_map(|patch| patch.patch.hull(divisions as u32)).collect();
    Ok(made)
}

impl Shell {
    /// Returns the number of patches.
    pub(crate) fn len(&self) -> usize {
        self.patches.len()
    }

    /// Returns all control points.
    pub(crate) fn points(&self) -> impl Iterator<Item = &Point> {
        self.patches.iter().flat_map(|patch| patch.patch.points())
    }

    /// Returns the minimum and maximum coordinates of the control points.
    fn bounds(&self) -> [Point; 2] {
        self.points().fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], point| {
            [
                [0, 1, 2].map(|axis| low[axis].min(point[axis])),
                [0, 1, 2].map(|axis| high[axis].max(point[axis])),
            ]
        })
    }

    /// Whether facets only approximate the shell. (Control points that divide straight lines evenly
    /// do so except for rounding.)
    pub(crate) fn is_curved(&self) -> bool {
        let largest = self.points().flatten().fold(0.0, |most: f64, at| most.max(at.abs()));
        self.patches.iter().any(|patch| {
            let derivatives = patch.patch.derivatives();
            derivatives.uu.max(derivatives.uv).max(derivatives.vv) > largest * STRAIGHT
        })
    }
}
