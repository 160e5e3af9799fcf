//! Coverage of cells by a closed surface: exact, from its faces clipped to the cells.
//!
//! Let `c` be the share of a cell that is inside, `a` the area of the faces in it that bound the inside, seen along an
//! axis, counted by the change of inside behind them and in areas of a cell's wall, and `b` the same with each bit
//! of area weighted by the share of the cell behind it. Then `c - b` is the share of the wall where the cell begins
//! that is inside, and
//!
//! ```text
//! (c - b) + a  =  c' - b'
//! ```
//!
//! holds for the next cell along the axis, since that one begins where this one ends: what font rasterizers
//! do with the areas under outlines, in space and from any neighbour. Cells without faces are inside or outside as
//! their centre is, so that cells next to them are known, then cells next to those. Cells for which that does not
//! tell are divided, and so are those with more faces than can be compared with each other.

use super::boundary::Neighbourhood;
use super::face_sums::FaceSums;
use super::grid::Triangle;
use super::inside::{Inside, State};
use super::windings::windings_at_centres;
use spinney_base::{Progress, Result, sort};
use spinney_brep::exact::lattice::Lattice;
use spinney_brep::geometry::clipped::{ClippedPolygon, clip};

/// A cube of cells and the triangles that reach into it.
#[derive(Clone, Copy)]
pub(super) struct Cube<'a> {
    pub(super) triangles: &'a [Triangle],
    /// The grid point at which it begins.
    pub(super) min: [i32; 3],
    /// Grid steps along a cell.
    pub(super) cell: i32,
    /// There are `2^height` cells along each axis.
    pub(super) height: u8,
}

/// The way to tell inside from outside.
#[derive(Clone, Copy)]
pub(super) struct Test<'a> {
    pub(super) inside: &'a Inside,
    pub(super) progress: &'a dyn Progress,
}

/// Parts of triangles that are listed at a time; where there are more the cube is worked on in eight parts, so that
/// memory does not grow with triangles that reach into very many cells.
const MANY: usize = 1 << 21;

/// How often a cell is divided at most, into 4 x 4 x 4 parts each time. What is still not known then, at a sixteenth of
/// the cell, is as its centre is.
const DIVISIONS: u8 = 2;

/// Shares that are beyond 0 or 1 by this much are wrong, as those of cells are whose winding numbers are other than
/// their faces tell; by less, they are rounded.
const TOLERANCE: f64 = 1e-3;

impl Cube<'_> {
    /// The share of each cell that is inside, x fastest, then y, then z, from the winding numbers at the
    /// cells' centres.
    pub(super) fn shares(&self, windings: &[i32], test: Test<'_>) -> Result<Vec<f64>> {
        let mut shares = vec![0.0; windings.len()];
        self.cover(windings, test, DIVISIONS, &mut |cell, share| shares[cell] = share)?;
        Ok(shares)
    }

    /// Hands out the number of each cell and its share.
    fn cover(
        &self,
        windings: &[i32],
        test: Test<'_>,
        divisions: u8,
        each: &mut dyn FnMut(usize, f64),
    ) -> Result<()> {
        let Some(mut coverage) = Coverage::new(self, test.progress)? else {
            return self.cover_parts(windings, test, divisions, each);
        };
        coverage.settle(self, windings, test)?;
        coverage.solve(windings, test)?;
        for (cell, winding) in windings.iter().enumerate().filter(|(cell, _)| !coverage.is_cut(*cell)) {
            each(cell, f64::from(u8::from(test.inside.has(*winding))));
        }
        for (number, faces) in coverage.faces.iter().enumerate().filter(|(_, faces)| faces.is_cut) {
            let cell = faces.cell as usize;
            let is_right = |share: &f64| (-TOLERANCE..=1.0 + TOLERANCE).contains(share);
            let share = match faces.share.filter(is_right) {
                Some(share) => share,
                None => {
                    let triangles: Vec<Triangle> = coverage.triangles(self, number).collect();
                    self.divided(cell, &triangles, windings[cell], test, divisions)?
                }
            };
            each(cell, share.clamp(0.0, 1.0));
        }
        Ok(())
    }

    /// Covers the eight parts of the cube, one after the other.
    fn cover_parts(
        &self,
        windings: &[i32],
        test: Test<'_>,
        divisions: u8,
        each: &mut dyn FnMut(usize, f64),
    ) -> Result<()> {
        let half = 1usize << (self.height - 1);
        for part in 0..8 {
            let from: [usize; 3] = std::array::from_fn(|axis| (part >> axis & 1) * half);
            let min: [i32; 3] = std::array::from_fn(|axis| self.min[axis] + from[axis] as i32 * self.cell);
            let width = i64::from(self.cell) * half as i64;
            let reaches = |triangle: &&Triangle| {
                (0..3).all(|axis| {
                    i64::from(triangle.min(axis)) <= i64::from(min[axis]) + width
                        && triangle.max(axis) >= min[axis]
                })
            };
            let triangles: Vec<Triangle> = self.triangles.iter().filter(reaches).copied().collect();
            let index = |cell: usize| {
                let at = cell_of(cell, self.height - 1);
                number_of(std::array::from_fn(|axis| from[axis] + at[axis]), self.height)
            };
            let inner: Vec<i32> = (0..half.pow(3)).map(|cell| windings[index(cell)]).collect();
            let cube = Cube { triangles: &triangles, min, height: self.height - 1, ..*self };
            cube.cover(&inner, test, divisions, &mut |cell, share| each(index(cell), share))?;
        }
        Ok(())
    }

    /// The share of a cell, by dividing it.
    fn divided(
        &self,
        cell: usize,
        triangles: &[Triangle],
        winding: i32,
        test: Test<'_>,
        divisions: u8,
    ) -> Result<f64> {
        /// 4 x 4 x 4 parts.
        const HEIGHT: u8 = 2;
        // (Parts need a centre on the grid.)
        if divisions == 0 || self.cell < 2 << HEIGHT {
            return Ok(f64::from(u8::from(test.inside.has(winding))));
        }
        let around = self.neighbourhood(cell, triangles, winding);
        let part = self.cell >> HEIGHT;
        let lattice = Lattice { per_cell: [0; 3], step: [part; 3] };
        let cube = Cube { triangles, min: around.min, cell: part, height: HEIGHT };
        let winding = around.winding_at(lattice.first(cube.min));
        let by_parity = matches!(test.inside, Inside::Parity);
        let winding = if by_parity { winding & 1 } else { winding };
        let state = State { winding, by_parity, ..State::default() };
        let windings = windings_at_centres(&lattice, triangles, cube.min, HEIGHT, state, test.progress)?;
        let mut sum = 0.0;
        cube.cover(&windings, test, divisions - 1, &mut |_, share| sum += share)?;
        Ok(sum / windings.len() as f64)
    }

    /// A cell, with the triangles that reach into it.
    fn neighbourhood<'a>(&self, cell: usize, triangles: &'a [Triangle], winding: i32) -> Neighbourhood<'a> {
        let at = cell_of(cell, self.height);
        let min = std::array::from_fn(|axis| self.min[axis] + at[axis] as i32 * self.cell);
        Neighbourhood { triangles, min, cell: self.cell, winding }
    }
}

/// The number of a cell.
fn number_of([x, y, z]: [usize; 3], height: u8) -> usize {
    (z << height | y) << height | x
}

/// The cell of a number.
fn cell_of(number: usize, height: u8) -> [usize; 3] {
    let mask = (1usize << height) - 1;
    [number & mask, number >> height & mask, number >> (2 * height)]
}

/// The faces of a cube of cells.
struct Coverage {
    height: u8,
    /// One more than the index of a cell in `faces`, by cell; 0 where a cell has no face.
    numbers: Vec<u32>,
    faces: Vec<FaceSums>,
    /// Index in `faces` and, in the lower half, number of a triangle that reaches into that cell, in that order.
    pieces: Vec<u64>,
    /// Index of the first piece of each cell with faces; one more than there are cells.
    starts: Vec<u32>,
}

impl Coverage {
    /// Clips the triangles to the cells; `None` if there are too many parts.
    fn new(cube: &Cube<'_>, progress: &dyn Progress) -> Result<Option<Coverage>> {
        let height = cube.height;
        let numbers = vec![0; 1 << (3 * height)];
        let (faces, pieces, starts) = (Vec::new(), Vec::new(), Vec::new());
        let mut coverage = Coverage { height, numbers, faces, pieces, starts };
        for (number, triangle) in (0..).zip(cube.triangles) {
            progress.check()?;
            let polygon = ClippedPolygon::of_triangle(&triangle.corners, cube.min, cube.cell);
            clip(polygon, 1 << height, &mut |polygon, cell, is_cut| {
                coverage.add(polygon, number, cell, is_cut);
            });
            // (A single cell cannot be divided here.)
            if coverage.pieces.len() > MANY && height > 0 {
                return Ok(None);
            }
        }
        sort::numbers64(&mut coverage.pieces);
        coverage.pieces.dedup();
        let cells = 0..=coverage.faces.len() as u64;
        coverage.starts =
            cells.map(|cell| coverage.pieces.partition_point(|piece| piece >> 32 < cell) as u32).collect();
        Ok(Some(coverage))
    }

    /// Adds what lies in one cell.
    fn add(&mut self, polygon: &ClippedPolygon, triangle: u32, cell: [usize; 3], is_cut: bool) {
        let index = number_of(cell, self.height);
        let number = &mut self.numbers[index];
        if *number == 0 {
            self.faces.push(FaceSums { cell: index as u32, ..FaceSums::default() });
            *number = self.faces.len() as u32;
        }
        let number = *number - 1;
        let faces = &mut self.faces[number as usize];
        faces.is_cut |= is_cut;
        faces.in_wall |= !is_cut;
        faces.add(polygon, cell, 1.0);
        self.pieces.push(sort::pair_key([number, triangle]));
    }

    fn is_cut(&self, cell: usize) -> bool {
        self.numbers[cell].checked_sub(1).is_some_and(|number| self.faces[number as usize].is_cut)
    }

    /// The triangles that reach into a cell with faces.
    fn triangles<'a>(&'a self, cube: &Cube<'a>, number: usize) -> impl Iterator<Item = Triangle> + 'a {
        let range = self.starts[number] as usize..self.starts[number + 1] as usize;
        let triangles = cube.triangles;
        self.pieces[range].iter().map(|piece| triangles[*piece as u32 as usize])
    }

    /// Leaves of each cell's faces those that bound the inside, as far as that can be told.
    fn settle(&mut self, cube: &Cube<'_>, windings: &[i32], test: Test<'_>) -> Result<()> {
        let mut triangles = Vec::new();
        for number in 0..self.faces.len() {
            test.progress.check()?;
            triangles.clear();
            triangles.extend(self.triangles(cube, number));
            let faces = &mut self.faces[number];
            let cell = faces.cell as usize;
            let around = cube.neighbourhood(cell, &triangles, windings[cell]);
            if let Some(weight) = around.weight(test.inside).filter(|_| !faces.in_wall) {
                faces.area.iter_mut().chain(&mut faces.behind).for_each(|sum| *sum *= weight);
                faces.is_settled = true;
            } else if let Some(bounding) = around.bounding_faces(test.inside) {
                (faces.area, faces.behind) = (bounding.area, bounding.behind);
                faces.is_settled = true;
            }
        }
        Ok(())
    }

    /// Finds the shares of cells with faces, as far as they follow from those around them.
    fn solve(&mut self, windings: &[i32], test: Test<'_>) -> Result<()> {
        let mut open: Vec<u32> = (0..)
            .zip(&self.faces)
            .filter(|(_, faces)| faces.is_cut && faces.is_settled)
            .map(|(number, _)| number)
            .collect();
        let mut before = usize::MAX;
        while open.len() < before {
            test.progress.check()?;
            // A wave is worked out as a whole before any of it is kept: the order of the faces has no
            // influence.
            let known: Vec<Option<f64>> =
                open.iter().map(|number| self.next(*number, windings, test)).collect();
            before = open.len();
            let mut known = known.into_iter();
            let faces = &mut self.faces;
            open.retain(|number| {
                let share = known.next().flatten();
                faces[*number as usize].share = share;
                share.is_none()
            });
        }
        Ok(())
    }

    /// The share of a cell with faces, from a neighbour whose own is known.
    fn next(&self, number: u32, windings: &[i32], test: Test<'_>) -> Option<f64> {
        let faces = &self.faces[number as usize];
        let cell = faces.cell as usize;
        let at = cell_of(cell, self.height);
        (0..3).find_map(|axis| {
            let step = 1usize << (axis as u8 * self.height);
            let before = (at[axis] > 0).then(|| self.known(cell - step, windings, test)).flatten();
            let begins = before.map(|(share, other)| share - other.behind[axis] + other.area[axis]);
            let begins = begins.or_else(|| {
                let is_last = at[axis] + 1 == 1 << self.height;
                let after = (!is_last).then(|| self.known(cell + step, windings, test)).flatten();
                after.map(|(share, other)| share - other.behind[axis] - faces.area[axis])
            });
            begins.map(|begins| begins + faces.behind[axis])
        })
    }

    /// The share of a cell, if it is known, and its faces.
    fn known(&self, cell: usize, windings: &[i32], test: Test<'_>) -> Option<(f64, FaceSums)> {
        let faces = match self.numbers[cell] {
            0 => FaceSums::default(),
            number => self.faces[number as usize - 1],
        };
        if faces.is_cut || faces.in_wall && !faces.is_settled {
            return faces.share.map(|share| (share, faces));
        }
        Some((f64::from(u8::from(test.inside.has(windings[cell]))), faces))
    }
}
