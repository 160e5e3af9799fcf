//! Coverage of cells that several surfaces fill partly: the union of their insides.
//!
//! Such a cell is evaluated again in 4 x 4 x 4 subcells. If each surface has integral winding
//! numbers of one sign, the sum of these is nonzero wherever any of them is. The faces of all
//! surfaces are then clipped to the subcells as if they were one surface, which is exact, as
//! [`coverage`](super::coverage) is. Otherwise, next to holes and inverted faces, the surfaces are
//! assumed to be independent within each subcell. This is inexact only in the few subcells that
//! several of them cut.

use std::collections::BTreeMap;

use super::bits::Cells;
use super::coverage::{Cube, Test};
use super::field::{DOUBT, wide};
use super::fill::occupancy;
use super::grid::Triangle;
use super::inside::{FULL, FillOptions, Inside, State};
use super::windings::{change, windings_at_centres};
use spinney_base::Result;
use spinney_brep::exact::lattice::Lattice;

/// Base-2 logarithm of the subcells along an axis, and the number of all subcells.
const HEIGHT: u8 = 2;
const PARTS: usize = 1 << (3 * HEIGHT);

/// Surface in a block.
pub(super) struct SurfaceInBlock<'a> {
    pub(super) inside: &'a Inside,
    pub(super) triangles: Vec<Triangle>,
    /// State at the block's first lattice point.
    pub(super) state: State,
}

/// Cells of a block that several surfaces fill partly.
#[derive(Default)]
pub(super) struct Overlaps {
    /// First surface that fills each cell partly; empty while that is surface 0 everywhere.
    firsts: Vec<u32>,
    /// Surfaces by their index in the block, with their occupancies, by cell.
    cells: BTreeMap<usize, Vec<(u32, u32)>>,
}

impl Overlaps {
    /// Records the cells that this surface and earlier ones fill partly. `others` are the cells of
    /// the earlier surfaces, before this one is added.
    pub(super) fn note(&mut self, others: &Cells, number: u32, cells: &Cells) {
        let (Some(known), Some(values)) = (&others.values, &cells.values) else { return };
        let is_part = |value: u32| (1..FULL).contains(&value);
        for (cell, value) in values.iter().enumerate().filter(|(_, value)| is_part(**value)) {
            if is_part(known[cell]) {
                let first = self.firsts.get(cell).copied().unwrap_or(0);
                self.cells.entry(cell).or_insert_with(|| vec![(first, known[cell])]).push((number, *value));
            } else if known[cell] == 0 {
                self.firsts.resize(values.len(), 0);
                self.firsts[cell] = number;
            }
        }
    }

    /// Sets these cells to the fraction that is inside of any surface, unless one surface fills the
    /// cell.
    pub(super) fn settle(
        self,
        fill: &FillOptions<'_>,
        surfaces_in_block: &[SurfaceInBlock<'_>],
        min: [i32; 3],
        all: &mut Cells,
    ) -> Result<()> {
        let height = all.bits.height;
        let Some(values) = &mut all.values else { return Ok(()) };
        for (cell, parts) in self.cells {
            fill.progress.check()?;
            if values[cell] == FULL {
                continue;
            }
            let mask = (1usize << height) - 1;
            let at = [cell & mask, cell >> height & mask, cell >> (2 * height)];
            let corner = std::array::from_fn(|axis| min[axis] + at[axis] as i32 * fill.cell());
            let found: Vec<InCell> = parts
                .iter()
                .map(|(number, _)| InCell::of(fill, &surfaces_in_block[*number as usize], min, corner))
                .collect::<Result<_>>()?;
            let shares = parts.iter().map(|(_, value)| f64::from(*value) / f64::from(FULL));
            let (least, most) = (shares.clone().fold(0.0, f64::max), shares.sum::<f64>().min(1.0));
            let share = match exact(fill, &found, corner)? {
                Some(share) => share,
                None => by_parts(fill, &found, corner)?,
            };
            values[cell] = occupancy(share.clamp(least, most));
        }
        Ok(())
    }
}

/// Surface in a cell.
struct InCell<'a> {
    /// Triangles that reach into the cell.
    triangles: Vec<Triangle>,
    at_parts: AtParts<'a>,
}

/// State at the centre of each subcell.
enum AtParts<'a> {
    /// Winding numbers, and the rule for them.
    Windings(Vec<i32>, &'a Inside),
    /// Winding field, if it is not integral.
    Fields(Vec<f32>),
}

impl<'a> InCell<'a> {
    /// Surface of a block that starts at `min`, in the cell that starts at `corner`.
    fn of(
        fill: &FillOptions<'_>,
        surface: &SurfaceInBlock<'a>,
        min: [i32; 3],
        corner: [i32; 3],
    ) -> Result<InCell<'a>> {
        let (cell, progress) = (fill.cell(), fill.progress);
        let part = cell >> HEIGHT;
        let lattice = Lattice { per_cell: [0; 3], step: [part; 3] };
        let reaches = |triangle: &&Triangle| {
            (0..3).all(|axis| triangle.min(axis) <= corner[axis] + cell && triangle.max(axis) >= corner[axis])
        };
        let triangles: Vec<Triangle> = surface.triangles.iter().filter(reaches).copied().collect();
        let Inside::Field(field) = surface.inside else {
            let (mut at, first) = (fill.lattice.first(min), lattice.first(corner));
            let winding = surface.state.winding
                + change::<0>(&surface.triangles, &mut at, first)
                + change::<1>(&surface.triangles, &mut at, first)
                + change::<2>(&surface.triangles, &mut at, first);
            let winding = if surface.state.by_parity { winding & 1 } else { winding };
            let state = State { winding, ..surface.state };
            let windings = windings_at_centres(&lattice, &triangles, corner, HEIGHT, state, progress)?;
            return Ok(InCell { triangles, at_parts: AtParts::Windings(windings, surface.inside) });
        };
        let half = f64::from(cell) / 2.0;
        let middle = wide(corner) + half;
        let axes = corner.map(|corner| [0, 1, 2, 3].map(|at| corner + at * part + part / 2));
        let fields =
            field.local(middle, half, cell).at_lattice([&axes[0], &axes[1], &axes[2]], 4, progress)?;
        // Relative to the winding number of the first subcell.
        let state = State::default();
        let mut windings = windings_at_centres(&lattice, &triangles, corner, HEIGHT, state, progress)?;
        let off = (fields[0] - windings[0] as f32).round();
        let is_whole =
            |(field, winding): (&f32, &i32)| (field - *winding as f32 - off).abs() <= (0.5 - DOUBT) as f32;
        let has_rim = field.rims.around(middle, half).is_within();
        let at_parts = if !has_rim && fields.iter().zip(&windings).all(is_whole) {
            windings.iter_mut().for_each(|winding| *winding += off as i32);
            AtParts::Windings(windings, &Inside::Winding)
        } else {
            AtParts::Fields(fields)
        };
        Ok(InCell { triangles, at_parts })
    }

    /// Triangles and winding numbers, oriented such that these are not negative. `None` if winding
    /// numbers are not integral, have both signs, or are parities.
    fn upward(&self) -> Option<(Vec<Triangle>, Vec<i32>)> {
        let AtParts::Windings(windings, Inside::Winding) = &self.at_parts else { return None };
        if windings.iter().all(|winding| *winding >= 0) {
            return Some((self.triangles.clone(), windings.clone()));
        }
        let is_below = windings.iter().all(|winding| *winding <= 0);
        let turned = self.triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.corners;
            Triangle { corners: [a, c, b], ..*triangle }
        });
        is_below.then(|| (turned.collect(), windings.iter().map(|winding| -winding).collect()))
    }

    /// Fraction of each subcell that is inside.
    fn shares(&self, fill: &FillOptions<'_>, corner: [i32; 3]) -> Result<Vec<f64>> {
        match &self.at_parts {
            AtParts::Windings(windings, inside) => shares(fill, &self.triangles, corner, windings, inside),
            AtParts::Fields(fields) => {
                Ok(fields.iter().map(|field| f64::from(u8::from(field.abs() >= 0.5))).collect())
            }
        }
    }
}

/// Fraction of each subcell that is inside the triangles. `windings` are the winding numbers at the
/// subcells' centres.
fn shares(
    fill: &FillOptions<'_>,
    triangles: &[Triangle],
    corner: [i32; 3],
    windings: &[i32],
    inside: &Inside,
) -> Result<Vec<f64>> {
    let cube = Cube { triangles, min: corner, cell: fill.cell() >> HEIGHT, height: HEIGHT };
    cube.shares(windings, Test { inside, progress: fill.progress })
}

/// Fraction of a cell that is inside any surface, if all have integral winding numbers of one sign.
fn exact(fill: &FillOptions<'_>, found: &[InCell<'_>], corner: [i32; 3]) -> Result<Option<f64>> {
    let (mut triangles, mut windings) = (Vec::new(), vec![0; PARTS]);
    for surface in found {
        let Some((own, upward)) = surface.upward() else { return Ok(None) };
        triangles.extend(own);
        windings.iter_mut().zip(upward).for_each(|(sum, winding)| *sum += winding);
    }
    let shares = shares(fill, &triangles, corner, &windings, &Inside::Winding)?;
    Ok(Some(shares.iter().sum::<f64>() / PARTS as f64))
}

/// Fraction of a cell that is inside any surface, from the fractions of its subcells.
fn by_parts(fill: &FillOptions<'_>, found: &[InCell<'_>], corner: [i32; 3]) -> Result<f64> {
    let mut outside = vec![1.0; PARTS];
    for surface in found {
        let shares = surface.shares(fill, corner)?;
        outside.iter_mut().zip(shares).for_each(|(outside, share)| *outside *= 1.0 - share);
    }
    Ok(1.0 - outside.iter().sum::<f64>() / PARTS as f64)
}
