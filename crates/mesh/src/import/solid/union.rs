//! Coverage of cells of which several surfaces fill a part: what is inside any of them.
//!
//! Such a cell is looked at again, in 4 x 4 x 4 parts. Where each surface has whole winding numbers, of one sign, their sum is
//! other than zero where any of them is, and the faces of all are clipped to the parts as those of one: that is exact, as
//! [`coverage`](super::coverage) is. Elsewhere, next to holes and where faces are turned inside out, each part of the cell is as full as
//! if its surfaces had nothing to do with each other, which is in doubt only in those few parts that several of them cut.

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

/// Parts of a cell along an axis, as a power of two, and all of them.
const HEIGHT: u8 = 2;
const PARTS: usize = 1 << (3 * HEIGHT);

/// A surface in a block.
pub(super) struct Piece<'a> {
    pub(super) inside: &'a Inside,
    pub(super) triangles: Vec<Triangle>,
    /// State at the block's first lattice point.
    pub(super) state: State,
}

/// The cells of a block that are filled in part by several surfaces.
#[derive(Default)]
pub(super) struct Overlaps {
    /// The first surface that fills a part of each cell; not there as long as it is the first of all.
    firsts: Vec<u32>,
    /// Surfaces, by their number in the block, and their occupancies.
    cells: BTreeMap<usize, Vec<(u32, u32)>>,
}

impl Overlaps {
    /// Notes where a surface fills a part of cells that others, to which it is to be added, fill a part of.
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

    /// Gives these cells the share that is inside any of the block's surfaces, unless one fills all of them.
    pub(super) fn settle(
        self,
        fill: &FillOptions<'_>,
        pieces: &[Piece<'_>],
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
                .map(|(number, _)| InCell::of(fill, &pieces[*number as usize], min, corner))
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

/// A surface in a cell.
struct InCell<'a> {
    /// The triangles that reach into it.
    triangles: Vec<Triangle>,
    at_parts: AtParts<'a>,
}

/// What is known in the middle of each part of a cell.
enum AtParts<'a> {
    /// The winding number, and the rule for it.
    Windings(Vec<i32>, &'a Inside),
    /// The winding field, which is not whole.
    Fields(Vec<f32>),
}

impl<'a> InCell<'a> {
    /// A surface of a block that begins at `min`, in the cell that begins at `corner`.
    fn of(fill: &FillOptions<'_>, piece: &Piece<'a>, min: [i32; 3], corner: [i32; 3]) -> Result<InCell<'a>> {
        let (cell, progress) = (fill.cell(), fill.progress);
        let part = cell >> HEIGHT;
        let lattice = Lattice { per_cell: [0; 3], step: [part; 3] };
        let reaches = |triangle: &&Triangle| {
            (0..3).all(|axis| triangle.min(axis) <= corner[axis] + cell && triangle.max(axis) >= corner[axis])
        };
        let triangles: Vec<Triangle> = piece.triangles.iter().filter(reaches).copied().collect();
        let Inside::Field(field) = piece.inside else {
            let (mut at, first) = (fill.lattice.first(min), lattice.first(corner));
            let winding = piece.state.winding
                + change::<0>(&piece.triangles, &mut at, first)
                + change::<1>(&piece.triangles, &mut at, first)
                + change::<2>(&piece.triangles, &mut at, first);
            let winding = if piece.state.by_parity { winding & 1 } else { winding };
            let state = State { winding, ..piece.state };
            let windings = windings_at_centres(&lattice, &triangles, corner, HEIGHT, state, progress)?;
            return Ok(InCell { triangles, at_parts: AtParts::Windings(windings, piece.inside) });
        };
        let half = f64::from(cell) / 2.0;
        let middle = wide(corner) + half;
        let axes = corner.map(|corner| [0, 1, 2, 3].map(|at| corner + at * part + part / 2));
        let fields =
            field.local(middle, half, cell).at_lattice([&axes[0], &axes[1], &axes[2]], 4, progress)?;
        // Against that of the first part.
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

    /// The triangles, and the winding numbers, with these above zero; `None` if they are not whole, of both signs, or of faces turned
    /// either way.
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

    /// The share of each part that is inside.
    fn shares(&self, fill: &FillOptions<'_>, corner: [i32; 3]) -> Result<Vec<f64>> {
        match &self.at_parts {
            AtParts::Windings(windings, inside) => shares(fill, &self.triangles, corner, windings, inside),
            AtParts::Fields(fields) => {
                Ok(fields.iter().map(|field| f64::from(u8::from(field.abs() >= 0.5))).collect())
            }
        }
    }
}

/// The share of each part of a cell that is inside triangles, by the winding numbers in their middles.
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

/// The share of a cell that is inside any surface, if all have whole winding numbers of one sign.
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

/// The share of a cell that is inside any surface, from those of its parts.
fn by_parts(fill: &FillOptions<'_>, found: &[InCell<'_>], corner: [i32; 3]) -> Result<f64> {
    let mut outside = vec![1.0; PARTS];
    for surface in found {
        let shares = surface.shares(fill, corner)?;
        outside.iter_mut().zip(shares).for_each(|(outside, share)| *outside *= 1.0 - share);
    }
    Ok(1.0 - outside.iter().sum::<f64>() / PARTS as f64)
}
