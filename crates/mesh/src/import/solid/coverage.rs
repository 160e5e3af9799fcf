//! Coverage of cells by a closed surface: exact, from its faces clipped to the cells.
//!
//! Let `c` be the fraction of a cell that is inside. Let `a` be the area of the bounding faces in
//! it, projected along an axis, with the sign of the change of inside along the axis, in units of a
//! cell wall's area. Let `b` be the same with each area element weighted by its distance to the
//! cell's end along the axis, in cells. Then `c - b` is the fraction of the cell's first wall that
//! is inside, and
//!
//! ```text
//! (c - b) + a  =  c' - b'
//! ```
//!
//! holds for the next cell along the axis, since that cell starts where this one ends. Font
//! rasterizers do the same with areas under outlines; this is the method in 3D and from any
//! neighbour.
//!
//! Cells without faces are inside or outside like their centres. This determines cells next to
//! them, then the cells next to those. Cells that remain undetermined are subdivided, and so are
//! cells with too many faces to compare with each other.

use super::boundary::Neighbourhood;
use super::face_sums::FaceSums;
use super::grid::Triangle;
use super::inside::{Inside, State};
use super::windings::windings_at_centres;
use spinney_base::{Progress, Result, sort};
use spinney_brep::exact::lattice::Lattice;
use spinney_brep::geometry::clipped::{ClippedPolygon, clip};

/// Cube of cells, and the triangles that reach into it.
#[derive(Clone, Copy)]
pub(super) struct Cube<'a> {
    pub(super) triangles: &'a [Triangle],
    /// Grid point of the cube's minimum corner.
    pub(super) min: [i32; 3],
    /// Width of a cell in grid units.
    pub(super) cell: i32,
    /// Base-2 logarithm of the number of cells along each axis.
    pub(super) height: u8,
}

/// Rule for what is inside, and progress for cancellation.
#[derive(Clone, Copy)]
pub(super) struct Test<'a> {
    pub(super) inside: &'a Inside,
    pub(super) progress: &'a dyn Progress,
}

/// Maximum number of face fragments that are listed at a time. A cube with more is processed as
/// eight octants, so that memory does not grow with triangles that reach into very many cells.
const MANY: usize = 1 << 21;

/// Maximum number of times that a cell is subdivided, into 4 x 4 x 4 subcells each time. A subcell
/// that is still undetermined, at a sixteenth of the cell's width, counts as its centre does.
const DIVISIONS: u8 = 2;

/// Tolerance of fractions beyond 0 or 1. Larger deviations mean a wrong result, such as for cells
/// whose winding numbers contradict their faces; smaller ones are rounding errors.
const TOLERANCE: f64 = 1e-3;

impl Cube<'_> {
    /// Fraction of each cell that is inside, x fastest, then y, then z. `windings` are the winding
    /// numbers at the cells' centres.
    pub(super) fn shares(&self, windings: &[i32], test: Test<'_>) -> Result<Vec<f64>> {
        let mut shares = vec![0.0; windings.len()];
        self.cover(windings, test, DIVISIONS, &mut |cell, share| shares[cell] = share)?;
        Ok(shares)
    }

    /// Passes each cell's index and fraction to `each`.
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

    /// Covers the eight octants of the cube in turn.
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

    /// Fraction of a cell by subdivision.
    fn divided(
        &self,
        cell: usize,
        triangles: &[Triangle],
        winding: i32,
        test: Test<'_>,
        divisions: u8,
    ) -> Result<f64> {
        /// 4 x 4 x 4 subcells.
        const HEIGHT: u8 = 2;
        // (Subcells need a centre on the grid.)
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

    /// Cell with the triangles that reach into it.
    fn neighbourhood<'a>(&self, cell: usize, triangles: &'a [Triangle], winding: i32) -> Neighbourhood<'a> {
        let at = cell_of(cell, self.height);
        let min = std::array::from_fn(|axis| self.min[axis] + at[axis] as i32 * self.cell);
        Neighbourhood { triangles, min, cell: self.cell, winding }
    }
}

/// Index of a cell.
fn number_of([x, y, z]: [usize; 3], height: u8) -> usize {
    (z << height | y) << height | x
}

/// Cell of an index.
fn cell_of(number: usize, height: u8) -> [usize; 3] {
    let mask = (1usize << height) - 1;
    [number & mask, number >> height & mask, number >> (2 * height)]
}

/// Faces of a cube of cells.
struct Coverage {
    height: u8,
    /// Index in `faces` plus one, by cell; 0 if the cell has no faces.
    numbers: Vec<u32>,
    faces: Vec<FaceSums>,
    /// Fragments as sorted pairs: index in `faces` in the upper half, index of a triangle that
    /// reaches into that cell in the lower half.
    fragments: Vec<u64>,
    /// First fragment of each cell with faces, then the total number of fragments.
    starts: Vec<u32>,
}

impl Coverage {
    /// Clips the triangles to the cells; `None` if there are too many fragments.
    fn new(cube: &Cube<'_>, progress: &dyn Progress) -> Result<Option<Coverage>> {
        let height = cube.height;
        let numbers = vec![0; 1 << (3 * height)];
        let (faces, fragments, starts) = (Vec::new(), Vec::new(), Vec::new());
        let mut coverage = Coverage { height, numbers, faces, fragments, starts };
        for (number, triangle) in (0..).zip(cube.triangles) {
            progress.check()?;
            let polygon = ClippedPolygon::of_triangle(&triangle.corners, cube.min, cube.cell);
            clip(polygon, 1 << height, &mut |polygon, cell, is_cut| {
                coverage.add(polygon, number, cell, is_cut);
            });
            // (A single cell cannot be divided here.)
            if coverage.fragments.len() > MANY && height > 0 {
                return Ok(None);
            }
        }
        sort::numbers64(&mut coverage.fragments);
        coverage.fragments.dedup();
        let cells = 0..=coverage.faces.len() as u64;
        coverage.starts = cells
            .map(|cell| coverage.fragments.partition_point(|fragment| fragment >> 32 < cell) as u32)
            .collect();
        Ok(Some(coverage))
    }

    /// Adds a fragment in one cell.
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
        self.fragments.push(sort::pair_key([number, triangle]));
    }

    fn is_cut(&self, cell: usize) -> bool {
        self.numbers[cell].checked_sub(1).is_some_and(|number| self.faces[number as usize].is_cut)
    }

    /// Triangles that reach into a cell with faces.
    fn triangles<'a>(&'a self, cube: &Cube<'a>, number: usize) -> impl Iterator<Item = Triangle> + 'a {
        let range = self.starts[number] as usize..self.starts[number + 1] as usize;
        let triangles = cube.triangles;
        self.fragments[range].iter().map(|fragment| triangles[*fragment as u32 as usize])
    }

    /// Reduces each cell's sums to the faces that bound the inside, where these can be determined.
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
                faces.area.iter_mut().chain(&mut faces.volume_after).for_each(|sum| *sum *= weight);
                faces.is_settled = true;
            } else if let Some(bounding) = around.bounding_faces(test.inside) {
                (faces.area, faces.volume_after) = (bounding.area, bounding.volume_after);
                faces.is_settled = true;
            }
        }
        Ok(())
    }

    /// Derives the fractions of cells with faces from their neighbours, as far as possible.
    fn solve(&mut self, windings: &[i32], test: Test<'_>) -> Result<()> {
        let mut open: Vec<u32> = (0..)
            .zip(&self.faces)
            .filter(|(_, faces)| faces.is_cut && faces.is_settled)
            .map(|(number, _)| number)
            .collect();
        let mut before = usize::MAX;
        while open.len() < before {
            test.progress.check()?;
            // Each wave is computed as a whole before its results are stored, so the order of faces
            // has no influence.
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

    /// Fraction of a cell with faces, from a neighbour with a known fraction.
    fn next(&self, number: u32, windings: &[i32], test: Test<'_>) -> Option<f64> {
        let faces = &self.faces[number as usize];
        let cell = faces.cell as usize;
        let at = cell_of(cell, self.height);
        (0..3).find_map(|axis| {
            let step = 1usize << (axis as u8 * self.height);
            let before = (at[axis] > 0).then(|| self.known(cell - step, windings, test)).flatten();
            let begins = before.map(|(share, other)| share - other.volume_after[axis] + other.area[axis]);
            let begins = begins.or_else(|| {
                let is_last = at[axis] + 1 == 1 << self.height;
                let after = (!is_last).then(|| self.known(cell + step, windings, test)).flatten();
                after.map(|(share, other)| share - other.volume_after[axis] - faces.area[axis])
            });
            begins.map(|begins| begins + faces.volume_after[axis])
        })
    }

    /// Fraction of a cell and its faces, if the fraction is known.
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
