//! Fills one block of cells inside a surface that is not closed.
//!
//! With its lids the surface is closed, and crossings tell winding numbers; the lids' winding field is taken off. Crossings
//! of the surface alone tell by how much the result steps there, so that what is left is smooth but near the rims of
//! holes: in cubes of cells away from these it is interpolated, with a bound of the error. Other cubes are divided, down to
//! cubes of 8 x 8 x 8 cells in which the field of triangles that are near is found for each cell. Cells whose field
//! is so near one half that the bound leaves it in doubt are decided by all lids.

use glam::DVec3;

use super::bits::Cells;
use super::coverage::{Cube, Test};
use super::cubic::{ALL, Cubic, LEAST};
use super::field::WindingField;
use super::fill::{Painter, change, occupancy, windings_at_centres};
use super::grid::Triangle;
use super::inside::{Attribute, Boundary, FULL, FillOptions, Inside, State};
use super::lids::{LID, Lids};
use super::nearest::NearestFace;
use super::rim::Rim;
use crate::import::mesh::face::triangle;
use crate::{Progress, Result};

/// Distance of the field from one half up to which a cell is in doubt: the answer is a guess there.
const DOUBT: f64 = 0.2;
/// Distances of groups of triangles, in their radii, from which on they are dipoles: at first, and where a cell is to
/// be decided. After that all triangles count.
const RATIOS: [f64; 2] = [3.0, 8.0];
/// Distance of triangles from a cube, in its half widths, from which on their field is interpolated in it.
const CLEAR: f64 = 3.0;
/// Error of interpolation up to which a cube is not divided, times its cells along an axis: the further away rims are,
/// the less the field changes from cell to cell.
const TOLERANCE: f64 = 0.16;

/// A surface that is not closed.
#[derive(Debug)]
pub(super) struct OpenSurface {
    lids: WindingField,
    rim: Rim,
    faces: NearestFace,
    /// Least and greatest coordinates of the surface.
    bounds: [[i32; 3]; 2],
    /// Grid steps along a cell.
    step: i32,
}

impl OpenSurface {
    /// Bytes of memory that a surface with these lids takes, besides the lids; `attributed` of its triangles have
    /// attributes that differ.
    pub(super) fn memory(lids: &Lids, attributed: usize) -> u64 {
        WindingField::memory(lids.triangles.len())
            + NearestFace::memory(attributed)
            + Rim::memory(lids.edges.len())
    }

    /// The surface of these triangles, with their lids.
    ///
    /// # Errors
    /// If there are more than 2^31, or on interruption.
    pub(super) fn new(
        triangles: &[Triangle],
        lids: &Lids,
        step: i32,
        progress: &dyn Progress,
    ) -> Result<OpenSurface> {
        let least = |axis| triangles.iter().map(|triangle| triangle.min(axis)).min().unwrap_or(0);
        let most = |axis| triangles.iter().map(|triangle| triangle.max(axis)).max().unwrap_or(0);
        let bounds = [std::array::from_fn(least), std::array::from_fn(most)];
        progress.check()?;
        Ok(OpenSurface {
            lids: WindingField::new(&lids.triangles, progress)?,
            rim: Rim::new(&lids.edges, f64::from(step)),
            faces: NearestFace::new(triangles, progress)?,
            bounds,
            step,
        })
    }

    /// Number of the lids.
    pub(super) fn lids(&self) -> usize {
        self.lids.triangles().len()
    }

    /// Whether a cube lies beside the box around the surface. Of a single sheet no more than half of the view is
    /// covered from there: nothing is inside, and a surface costs where it is.
    pub(super) fn is_beside(&self, min: [i32; 3], width: i32) -> bool {
        let [least, most] = self.bounds;
        let is_beside = |axis: usize| {
            let low = i64::from(min[axis]);
            low >= i64::from(most[axis]) || low + i64::from(width) <= i64::from(least[axis])
        };
        (0..3).any(is_beside)
    }

    /// The field in a cube that neither the surface nor a lid reaches into, if it is on one side of one half all over,
    /// and in no doubt; the winding number with the lids is the same all over.
    pub(super) fn uniform(&self, min: [i32; 3], width: i32, winding: i32) -> Option<f64> {
        let middle = min.map(|min| min + width / 2);
        let (half, step) = (f64::from(width) / 2.0, f64::from(self.step));
        let centre = DVec3::from_array(middle.map(f64::from)) / step;
        let [slope, _] = self.rim.narrow(centre, half / step).derivatives(centre, half / step);
        let spread = slope * half / step * 3f64.sqrt();
        if spread > 0.5 {
            return None;
        }
        let around = self.lids.around(middle, 0.0, step, RATIOS[0], 0.0);
        let (mut lids, mut rounding) = ([0.0], [0.0]);
        around.add_near(&[[0.0; 3]], &mut lids, &mut rounding);
        around.add_far(&[[0.0; 3]], &mut lids);
        let field = f64::from(winding) - f64::from(lids[0]);
        let error = f64::from(around.error() + rounding[0]);
        ((field.abs() - 0.5).abs() > spread + error + DOUBT).then_some(field)
    }

    /// The attribute at a point: that of the nearest face that it lies behind.
    pub(super) fn attribute(&self, point: DVec3, is_inverted: bool) -> u32 {
        self.faces.attribute(point, is_inverted)
    }
}

/// The cells of a block inside an open surface, given with the lids that reach into it, and the state of the two
/// together at its first lattice point; also how many cells are in doubt.
pub(super) fn block(
    fill: &FillOptions<'_>,
    surface: &OpenSurface,
    triangles: &[Triangle],
    min: [i32; 3],
    height: u8,
    state: State,
) -> Result<(Cells, u64)> {
    let mut painter = Painter::new(fill, height);
    if fill.boundary == Boundary::Coverage {
        painter.values = Some(vec![0; 1 << (3 * height)]);
    }
    let faces: Vec<Triangle> = triangles.iter().filter(|triangle| triangle.part != LID).copied().collect();
    let windings = windings_at_centres(&fill.lattice, triangles, min, height, state, fill.progress)?;
    let steps = if faces.len() == triangles.len() {
        None
    } else {
        let outside = State::default();
        Some(windings_at_centres(&fill.lattice, &faces, min, height, outside, fill.progress)?)
    };
    let cubics = (LEAST..=height).map(Cubic::new).collect();
    let mut open = Open { fill, surface, min, painter, windings, steps, cubics, undecided: 0 };
    let cells = open.part(triangles, [0; 3], height);
    open.cube(&surface.rim, &cells, height, [0; 3])?;
    let Open { mut painter, undecided, .. } = open;
    painter.surface(&faces, min)?;
    Ok((painter.finish(), undecided))
}

struct Open<'a> {
    fill: &'a FillOptions<'a>,
    surface: &'a OpenSurface,
    min: [i32; 3],
    painter: Painter<'a>,
    /// Winding numbers of the block's cells with the lids, and of the surface alone against the first cell; none if
    /// there are no lids in the block: the two are the same then, but for a number.
    windings: Vec<i32>,
    steps: Option<Vec<i32>>,
    /// Interpolation in cubes, from the least on.
    cubics: Vec<Cubic>,
    undecided: u64,
}

impl Open<'_> {
    /// The grid point at which a cell of the block begins.
    fn corner(&self, at: [usize; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| self.min[axis] + at[axis] as i32 * self.fill.cell())
    }

    /// The middle of a cube of cells.
    fn middle(&self, at: [usize; 3], height: u8) -> [i32; 3] {
        self.corner(at).map(|corner| corner + (self.fill.cell() << height) / 2)
    }

    /// The triangles that reach into a cube of cells, for coverage, which alone needs them.
    fn part(&self, triangles: &[Triangle], at: [usize; 3], height: u8) -> Vec<Triangle> {
        if self.fill.boundary != Boundary::Coverage {
            return Vec::new();
        }
        let (low, width) = (self.corner(at), self.fill.cell() << height);
        let reaches = |triangle: &&Triangle| {
            (0..3).all(|axis| triangle.min(axis) <= low[axis] + width && triangle.max(axis) >= low[axis])
        };
        triangles.iter().filter(reaches).copied().collect()
    }

    /// Fills a cube of cells that begins at a cell of the block.
    fn cube(&mut self, rim: &Rim, triangles: &[Triangle], height: u8, at: [usize; 3]) -> Result<()> {
        self.fill.progress.check()?;
        if self.surface.is_beside(self.corner(at), self.fill.cell() << height) {
            return Ok(());
        }
        if height < LEAST {
            let fields = self.near(height, at, None);
            return self.decide(&fields, triangles, height, at, false);
        }
        let step = f64::from(self.fill.cell());
        let (middle, half) =
            (DVec3::from_array(self.middle(at, height).map(f64::from)) / step, f64::from(1 << height) / 2.0);
        let rim = rim.narrow(middle, half);
        let [_, bend] = rim.derivatives(middle, half);
        let error = bend * f64::from(self.cubics[usize::from(height - LEAST)].spread());
        if error * f64::from(1 << height) <= TOLERANCE {
            let fields = self.smooth(height, at, error as f32);
            return self.decide(&fields, triangles, height, at, true);
        }
        if height == LEAST {
            let fields = self.near(height, at, Some(height));
            return self.decide(&fields, triangles, height, at, false);
        }
        for child in 0..8 {
            let at = std::array::from_fn(|axis| at[axis] + ((child >> axis & 1) << (height - 1)));
            let inner = self.part(triangles, at, height - 1);
            self.cube(&rim, &inner, height - 1, at)?;
        }
        Ok(())
    }

    /// The number of a cell of a cube in the block.
    fn number(&self, at: [usize; 3], cell: [usize; 3]) -> usize {
        let height = self.painter.cells.height;
        let [x, y, z] = std::array::from_fn(|axis| at[axis] + cell[axis]);
        (z << height | y) << height | x
    }

    /// The field in a cube without rims near it, by interpolation of what is left without the surface's steps.
    fn smooth(&self, height: u8, at: [usize; 3], error: f32) -> Fields {
        let cubic = &self.cubics[usize::from(height - LEAST)];
        let steps = self.steps.as_ref().unwrap_or(&self.windings);
        let around = self.around(height, at, RATIOS[0], 0.0);
        let points: Vec<[f32; 3]> = cubic.cells().map(|cell| place(cell, height)).collect();
        let (mut lids, mut rounding) = ([0.0; ALL], [0.0; ALL]);
        around.add_near(&points, &mut lids, &mut rounding);
        around.add_far(&points, &mut lids);
        let mut nodes = [0.0; ALL];
        for ((node, cell), lids) in nodes.iter_mut().zip(cubic.cells()).zip(lids) {
            let number = self.number(at, cell);
            *node = (self.windings[number] - steps[number]) as f32 - lids;
        }
        let rounding = rounding.into_iter().fold(0.0, f32::max);
        let mut values = cubic.values(&nodes);
        for (index, value) in values.iter_mut().enumerate() {
            *value += steps[self.number(at, cell_of(index, height))] as f32;
        }
        // Rounding at a node counts as much as its weight, of which there are 2 or 3 along each axis.
        Fields { values, errors: Errors::Same(error + around.error() + 8.0 * rounding) }
    }

    /// The field in a small cube: of lids that are near for each cell, of others by interpolation.
    fn near(&self, height: u8, at: [usize; 3], interpolated: Option<u8>) -> Fields {
        let cubic = interpolated.map(|height| &self.cubics[usize::from(height - LEAST)]);
        let around = self.around(height, at, RATIOS[0], if cubic.is_some() { CLEAR } else { 0.0 });
        let count = 1usize << (3 * height);
        let points: Vec<[f32; 3]> = (0..count).map(|index| place(cell_of(index, height), height)).collect();
        let mut error = around.error();
        let mut lids = match cubic {
            Some(cubic) => {
                let mut nodes = [0.0; ALL];
                let places: Vec<[f32; 3]> = cubic.cells().map(|cell| place(cell, height)).collect();
                around.add_far(&places, &mut nodes);
                error += cubic.spread() * around.bend();
                cubic.values(&nodes)
            }
            None => {
                let mut lids = vec![0.0; count];
                around.add_far(&points, &mut lids);
                lids
            }
        };
        let mut errors = vec![error; count];
        around.add_near(&points, &mut lids, &mut errors);
        for (index, lids) in lids.iter_mut().enumerate() {
            *lids = self.windings[self.number(at, cell_of(index, height))] as f32 - *lids;
        }
        Fields { values: lids, errors: Errors::Each(errors) }
    }

    /// The lids around a cube of cells.
    fn around(
        &self,
        height: u8,
        at: [usize; 3],
        ratio: f64,
        clear: f64,
    ) -> super::surroundings::Surroundings {
        let step = self.fill.cell();
        let half = f64::from(step << height) / 2.0;
        self.surface.lids.around(self.middle(at, height), half, f64::from(step), ratio, clear)
    }

    /// Fills a cube of cells from their fields; those in doubt are made sure of before.
    fn decide(
        &mut self,
        fields: &Fields,
        triangles: &[Triangle],
        height: u8,
        at: [usize; 3],
        is_smooth: bool,
    ) -> Result<()> {
        let mut values = fields.values.clone();
        let mut doubtful = Vec::new();
        for (index, value) in values.iter().enumerate() {
            let off = (value.abs() - 0.5).abs();
            // (A number that is none is not sure.)
            let is_sure = off > fields.errors.of(index);
            if !is_sure && !self.is_beside(at, index, height) {
                doubtful.push(index);
            }
        }
        self.make_sure(&mut values, doubtful, height, at)?;
        let is_covered =
            self.fill.boundary == Boundary::Coverage && triangles.iter().any(|triangle| triangle.part != LID);
        if is_covered && is_smooth {
            // Steps at faces are whole, so that rounding tells inside and outside on either side of them.
            let mut windings: Vec<i32> = values.iter().map(|value| value.round() as i32).collect();
            self.count_doubt(&values, height, at);
            for (index, winding) in windings.iter_mut().enumerate() {
                if self.is_beside(at, index, height) {
                    *winding = 0;
                }
            }
            let faces: Vec<Triangle> =
                triangles.iter().filter(|triangle| triangle.part != LID).copied().collect();
            return self.cover(&faces, &windings, height, at);
        }
        self.count_doubt(&values, height, at);
        let cut = if is_covered { self.cut(triangles, height, at) } else { Vec::new() };
        // All of a cube without faces is behind the same one, as far as that can be said.
        for (index, value) in values.iter().enumerate() {
            if cut.get(index).is_some_and(|is_cut| *is_cut) {
                self.sample(triangles, height, at, index)?;
            } else if value.abs() >= 0.5 && !self.is_beside(at, index, height) {
                self.set(at, cell_of(index, height), FULL, *value < 0.0);
            }
        }
        Ok(())
    }

    /// Whether a cell of a cube lies beside the surface.
    fn is_beside(&self, at: [usize; 3], index: usize, height: u8) -> bool {
        let cell = cell_of(index, height);
        self.surface
            .is_beside(self.corner(std::array::from_fn(|axis| at[axis] + cell[axis])), self.fill.cell())
    }

    fn count_doubt(&mut self, values: &[f32], height: u8, at: [usize; 3]) {
        let is_doubtful = |value: &f32| (f64::from(value.abs()) - 0.5).abs() < DOUBT;
        let doubtful = values.iter().enumerate().filter(|(_, value)| is_doubtful(value));
        self.undecided += doubtful.filter(|(index, _)| !self.is_beside(at, *index, height)).count() as u64;
    }

    /// Finds the fields of some cells of a cube so exactly that one can say on which side of one half they are.
    fn make_sure(
        &self,
        values: &mut [f32],
        mut doubtful: Vec<usize>,
        height: u8,
        at: [usize; 3],
    ) -> Result<()> {
        for ratio in [RATIOS[1], f64::INFINITY] {
            if doubtful.is_empty() {
                return Ok(());
            }
            self.fill.progress.check()?;
            let around = self.around(height, at, ratio, 0.0);
            let mut rest = Vec::new();
            for cells in doubtful.chunks(64) {
                self.fill.progress.check()?;
                let points: Vec<[f32; 3]> =
                    cells.iter().map(|index| place(cell_of(*index, height), height)).collect();
                let (mut lids, mut rounding) = (vec![0.0; points.len()], vec![around.error(); points.len()]);
                around.add_near(&points, &mut lids, &mut rounding);
                around.add_far(&points, &mut lids);
                for ((index, lids), error) in cells.iter().zip(lids).zip(rounding) {
                    let value = self.windings[self.number(at, cell_of(*index, height))] as f32 - lids;
                    values[*index] = value;
                    let is_sure = (value.abs() - 0.5).abs() > error;
                    if !is_sure {
                        rest.push(*index);
                    }
                }
            }
            doubtful = rest;
        }
        for index in doubtful {
            self.fill.progress.check()?;
            let cell = cell_of(index, height);
            let middle = self.middle(std::array::from_fn(|axis| at[axis] + cell[axis]), 0);
            let value = f64::from(self.windings[self.number(at, cell)]) - self.surface.lids.exact(middle);
            // (What is exactly one half but for rounding is inside, as it is without rounding.)
            values[index] = if value.abs() >= 0.5 - 1e-9 {
                value.abs().max(0.5).copysign(value) as f32
            } else {
                value as f32 * 0.999_999
            };
        }
        Ok(())
    }

    /// Fills a cube of cells with their coverage.
    fn cover(&mut self, faces: &[Triangle], windings: &[i32], height: u8, at: [usize; 3]) -> Result<()> {
        let cube = Cube { triangles: faces, min: self.corner(at), cell: self.fill.cell(), height };
        let test = Test { inside: &Inside::Winding, progress: self.fill.progress };
        let values = cube.shares(windings, test)?.into_iter().map(occupancy);
        for (index, value) in values.enumerate().filter(|(_, value)| *value > 0) {
            self.set(at, cell_of(index, height), value, false);
        }
        Ok(())
    }

    /// Which cells of a cube faces cut.
    fn cut(&self, triangles: &[Triangle], height: u8, at: [usize; 3]) -> Vec<bool> {
        let faces: Vec<&Triangle> = triangles.iter().filter(|triangle| triangle.part != LID).collect();
        let is_cut = |index: usize| {
            let cell = cell_of(index, height);
            let low = self.corner(std::array::from_fn(|axis| at[axis] + cell[axis])).map(i64::from);
            let high = low.map(|low| low + i64::from(self.fill.cell()));
            faces
                .iter()
                .any(|face| triangle::cuts(&face.corners.map(|corner| corner.map(i64::from)), low, high))
        };
        (0..1 << (3 * height)).map(is_cut).collect()
    }

    /// Fills a cell at a rim by 4 x 4 x 4 points.
    fn sample(&mut self, triangles: &[Triangle], height: u8, at: [usize; 3], index: usize) -> Result<()> {
        let cell = cell_of(index, height);
        let here = std::array::from_fn(|axis| at[axis] + cell[axis]);
        let (corner, middle) = (self.corner(here), self.middle(here, 0));
        let triangles = self.part(triangles, here, 0);
        let step = self.fill.cell();
        let around = self.around(0, here, RATIOS[0], 0.0);
        let points: [[i32; 3]; 64] = std::array::from_fn(|i| {
            std::array::from_fn(|axis| corner[axis] + (2 * (i as i32 >> (2 * axis) & 3) + 1) * (step / 8))
        });
        let places =
            points.map(|point| std::array::from_fn(|axis| (point[axis] - middle[axis]) as f32 / step as f32));
        let (mut lids, mut rounding) = ([0.0; 64], [0.0; 64]);
        around.add_near(&places, &mut lids, &mut rounding);
        around.add_far(&places, &mut lids);
        let winding = self.windings[self.number(at, cell)];
        let is_inside = |(point, lids): (&[i32; 3], f32)| {
            let mut from = middle;
            let passed = change::<0>(&triangles, &mut from, *point)
                + change::<1>(&triangles, &mut from, *point)
                + change::<2>(&triangles, &mut from, *point);
            ((winding + passed) as f32 - lids).abs() >= 0.5
        };
        let count = points.iter().zip(lids).filter(|sample| is_inside(*sample)).count() as u32;
        if count > 0 {
            self.set(at, cell, (count * FULL + 32) / 64, false);
        }
        self.fill.progress.check()
    }

    /// Gives a cell of a cube its occupancy, or its attribute.
    fn set(&mut self, at: [usize; 3], cell: [usize; 3], occupancy: u32, is_inverted: bool) {
        let number = self.number(at, cell);
        let at = std::array::from_fn(|axis| at[axis] + cell[axis]);
        self.painter.cells.set(at);
        let is_occupancy = self.fill.attribute == Attribute::Occupancy;
        let middle = self.middle(at, 0);
        let attribute = || self.surface.attribute(DVec3::from_array(middle.map(f64::from)), is_inverted);
        let value = if is_occupancy { occupancy } else { attribute() };
        if let Some(values) = &mut self.painter.values {
            values[number] = value;
        }
    }
}

/// The winding field of the surface at the cells of a cube.
struct Fields {
    values: Vec<f32>,
    errors: Errors,
}

/// Bounds of errors.
enum Errors {
    Same(f32),
    Each(Vec<f32>),
}

impl Errors {
    fn of(&self, index: usize) -> f32 {
        match self {
            Errors::Same(error) => *error,
            Errors::Each(errors) => errors[index],
        }
    }
}

/// The cell with a number in a cube, x fastest, then y, then z.
fn cell_of(number: usize, height: u8) -> [usize; 3] {
    let mask = (1usize << height) - 1;
    [number & mask, number >> height & mask, number >> (2 * height)]
}

/// The centre of a cell of a cube, from the cube's middle.
fn place(cell: [usize; 3], height: u8) -> [f32; 3] {
    cell.map(|cell| cell as f32 + 0.5 - (1u32 << height) as f32 / 2.0)
}
