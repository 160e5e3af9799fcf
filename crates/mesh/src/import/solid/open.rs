//! Fills a block of cells inside a surface that is not closed.
//!
//! Away from the edges of its holes, a surface is locally closed. Without the jumps at the
//! surface's crossings, the winding field is smooth there. In cubes away from such edges, the field
//! is evaluated at a few cells and interpolated, and the jumps are added again. Other cubes are
//! subdivided, down to 8 x 8 x 8 cells, where the field is evaluated at each cell.
//!
//! Cells whose winding field differs from one half by less than 0.01 may be inside or outside: see
//! [`local`](super::local).

use glam::DVec3;

use super::bits::{Bits, Cells};
use super::coverage::{Cube, Test};
use super::cubic::{ALL, Cubic, NODES, interpolate};
use super::field::{DOUBT, WindingField, wide};
use super::fill::{Painter, cut_cells, occupancy};
use super::grid::Triangle;
use super::inside::{Attribute, FULL, FillOptions, Inside, State};
use super::local::{LocalField, Range};
use super::rim::Rim;
use super::windings::{change, windings_at_centres};
use spinney_base::Result;
use spinney_base::space::EdgeRule;
use spinney_brep::exact::lattice::Lattice;
use spinney_brep::geometry::triangle;

/// Maximum interpolation error bound at which a cube is not subdivided.
const TOLERANCE: f64 = 0.01;
/// Cells along an axis for which near triangles are collected together.
const TOGETHER: usize = 4;
/// Sample points per cell and axis, for coverage that cannot be exact.
const SAMPLES: usize = 4;

/// Cells of a block by a winding field. Also returns the number of cells without faces whose state
/// is in doubt.
pub(super) fn block(
    fill: &FillOptions<'_>,
    field: &WindingField,
    triangles: &[Triangle],
    min: [i32; 3],
    height: u8,
) -> Result<(Cells, u64)> {
    let mut painter = Painter::new(fill, height);
    if fill.edge == EdgeRule::Area {
        painter.values = Some(vec![0; 1 << (3 * height)]);
    }
    let cubics = (Cubic::LEAST..=height).map(Cubic::new).collect();
    let mut open = Open { fill, field, min, painter, cubics, undecided: 0 };
    let region = open.cube_at([0; 3], height);
    let (middle, half) = open.middle(region);
    let rim = field.rims.around(middle, half);
    open.cube(&field.local(middle, half, fill.cell()), &rim, triangles, region)?;
    let Open { mut painter, undecided, .. } = open;
    painter.surface(triangles, min)?;
    Ok((painter.finish(), undecided))
}

struct Open<'a> {
    fill: &'a FillOptions<'a>,
    field: &'a WindingField,
    min: [i32; 3],
    painter: Painter<'a>,
    /// Interpolation in cubes, by height, from the smallest on.
    cubics: Vec<Cubic>,
    undecided: u64,
}

/// Cube of cells in the block.
#[derive(Clone, Copy)]
struct CellCube {
    /// First cell of the cube.
    at: [usize; 3],
    height: u8,
    /// Grid point of the cube's minimum corner.
    corner: [i32; 3],
}

impl CellCube {
    /// Cell with this index in the cube; x fastest, then y, then z.
    fn cell(&self, number: usize) -> [usize; 3] {
        let mask = (1usize << self.height) - 1;
        [number & mask, number >> self.height & mask, number >> (2 * self.height)]
    }
}

/// Field at the cells of a cube.
struct Fields {
    values: Vec<f32>,
    region: CellCube,
}

impl Fields {
    /// Values of a subcube.
    fn part(&self, part: CellCube) -> Vec<f32> {
        let height = self.region.height;
        let first: [usize; 3] = std::array::from_fn(|axis| part.at[axis] - self.region.at[axis]);
        let of = |number: usize| {
            let cell = part.cell(number);
            let [x, y, z] = std::array::from_fn(|axis| first[axis] + cell[axis]);
            self.values[(z << height | y) << height | x]
        };
        (0..1 << (3 * part.height)).map(of).collect()
    }
}

impl Open<'_> {
    fn cube_at(&self, at: [usize; 3], height: u8) -> CellCube {
        let corner = std::array::from_fn(|axis| self.min[axis] + at[axis] as i32 * self.fill.cell());
        CellCube { at, height, corner }
    }

    /// Cube of a single cell.
    fn cell(&self, region: CellCube, number: usize) -> CellCube {
        let cell = region.cell(number);
        self.cube_at(std::array::from_fn(|axis| region.at[axis] + cell[axis]), 0)
    }

    /// Centre of a cube, and half of its width.
    fn middle(&self, region: CellCube) -> (DVec3, f64) {
        let half = f64::from(self.fill.cell() << region.height) / 2.0;
        (wide(region.corner) + half, half)
    }

    /// Fills a cube of cells, from the triangles that reach into it and the field in it.
    fn cube(
        &mut self,
        local: &LocalField<'_>,
        rim: &Rim,
        triangles: &[Triangle],
        region: CellCube,
    ) -> Result<()> {
        self.fill.progress.check()?;
        let CellCube { height, corner, .. } = region;
        if self.field.is_outside_bounds(corner, self.fill.cell() << height) {
            return Ok(());
        }
        if height < Cubic::LEAST {
            return self.near(local, rim, triangles, region);
        }
        let (middle, half) = self.middle(region);
        let spread = self.cubic(height).spread;
        let error = spread * rim.bend(middle, half, TOLERANCE / spread);
        if error <= TOLERANCE && self.smooth(local, triangles, region, error)? {
            return Ok(());
        }
        if height == Cubic::LEAST {
            return self.near(local, rim, triangles, region);
        }
        let rim = rim.narrow(&self.field.rims, middle, half);
        for (region, inner) in self.parts(region, triangles) {
            let (middle, half) = self.middle(region);
            self.cube(&local.narrow(middle, half), &rim, &inner, region)?;
        }
        Ok(())
    }

    fn cubic(&self, height: u8) -> &Cubic {
        &self.cubics[usize::from(height - Cubic::LEAST)]
    }

    /// Fills a cube without rims near it, by interpolation of the field without its jumps. Returns
    /// `false` if the cube has to be subdivided.
    fn smooth(
        &mut self,
        local: &LocalField<'_>,
        triangles: &[Triangle],
        region: CellCube,
        error: f64,
    ) -> Result<bool> {
        let CellCube { height, corner, .. } = region;
        let (lattice, progress) = (&self.fill.lattice, self.fill.progress);
        // Winding numbers relative to that of the first cell.
        let mut windings =
            windings_at_centres(lattice, triangles, corner, height, State::default(), progress)?;
        let cubic = self.cubic(height);
        let axes = self.centres(region).map(|axis| cubic.cells.map(|cell| axis[cell]));
        let mut nodes: [f32; ALL] = [0.0; ALL];
        nodes.copy_from_slice(&local.at_lattice([&axes[0], &axes[1], &axes[2]], NODES / 2, progress)?);
        for (number, node) in nodes.iter_mut().enumerate() {
            let cell = [number % NODES, number / NODES % NODES, number / NODES / NODES];
            let [x, y, z] = cell.map(|node| cubic.cells[node]);
            *node -= windings[(z << height | y) << height | x] as f32;
        }
        let range = Range::of(&nodes, cubic.sum, error);
        let is_covered = self.fill.edge == EdgeRule::Area && !triangles.is_empty();
        if range.distance_from_half() > DOUBT as f32 {
            let off = range.middle.round() as i32;
            windings.iter_mut().for_each(|winding| *winding += off);
            if is_covered {
                self.cover(triangles, &windings, region)?;
            } else {
                self.whole(&windings, triangles, region);
            }
        } else if is_covered && height > Cubic::LEAST {
            return Ok(false);
        } else {
            let mut values = cubic.values(&nodes);
            for (value, winding) in values.iter_mut().zip(&windings) {
                *value += *winding as f32;
            }
            let counts = if is_covered { self.sampled(&nodes, triangles, region)? } else { Vec::new() };
            self.fields(&values, triangles, &|_, number| Ok(usize::from(counts[number])), region)?;
        }
        Ok(true)
    }

    /// Coordinates of the centres of a cube's cells.
    fn centres(&self, region: CellCube) -> [Vec<i32>; 3] {
        let cell = self.fill.cell();
        region.corner.map(|corner| (0..1 << region.height).map(|at| corner + at * cell + cell / 2).collect())
    }

    /// Fills a cube by winding numbers.
    fn whole(&mut self, windings: &[i32], triangles: &[Triangle], region: CellCube) {
        let number = windings.iter().position(|winding| *winding != 0);
        let Some(number) = number else { return };
        // All cells of a cube without faces have the same nearest face, approximately.
        let middle = self.middle(region).0;
        let attribute = triangles.is_empty().then(|| self.attribute(middle, windings[number] < 0));
        for (number, winding) in windings.iter().enumerate().filter(|(_, winding)| **winding != 0) {
            self.set(self.cell(region, number), FULL, attribute, *winding < 0);
        }
    }

    /// Fills a cube of cells with their coverage.
    fn cover(&mut self, triangles: &[Triangle], windings: &[i32], region: CellCube) -> Result<()> {
        let cube = Cube { triangles, min: region.corner, cell: self.fill.cell(), height: region.height };
        let test = Test { inside: &Inside::Winding, progress: self.fill.progress };
        let values = cube.shares(windings, test)?.into_iter().map(occupancy);
        for (number, value) in values.enumerate().filter(|(_, value)| *value > 0) {
            self.set(self.cell(region, number), value, None, windings[number] < 0);
        }
        Ok(())
    }

    /// Fills a cube by the field at each cell.
    fn near(
        &mut self,
        local: &LocalField<'_>,
        rim: &Rim,
        triangles: &[Triangle],
        region: CellCube,
    ) -> Result<()> {
        let [x, y, z] = self.centres(region);
        let values = local.at_lattice([&x, &y, &z], TOGETHER, self.fill.progress)?;
        if self.fill.edge == EdgeRule::Area {
            return self.covered(local, rim, &Fields { values, region }, triangles, region);
        }
        self.fields(&values, triangles, &|_, _| Ok(0), region)
    }

    /// Fills a subcube with the cells' coverage, from the field at each cell. Coverage is exact if
    /// there is no rim and the field is nearly integral; other cut cells are sampled.
    fn covered(
        &mut self,
        local: &LocalField<'_>,
        rim: &Rim,
        fields: &Fields,
        triangles: &[Triangle],
        region: CellCube,
    ) -> Result<()> {
        let values = fields.part(region);
        if triangles.is_empty() || region.height == 0 {
            let sample = |open: &Self, number: usize| {
                let cell = open.cell(region, number);
                let axes = cell.corner.map(|corner| open.samples(corner, 1));
                let values = local.at_lattice([&axes[0], &axes[1], &axes[2]], SAMPLES, open.fill.progress)?;
                Ok(values.iter().filter(|value| value.abs() >= 0.5).count())
            };
            return self.fields(&values, triangles, &sample, region);
        }
        let (middle, half) = self.middle(region);
        let rim = rim.narrow(&self.field.rims, middle, half);
        if !rim.is_within() {
            let (lattice, progress) = (&self.fill.lattice, self.fill.progress);
            let state = State::default();
            let mut windings =
                windings_at_centres(lattice, triangles, region.corner, region.height, state, progress)?;
            let off = (values[0] - windings[0] as f32).round();
            let is_whole = |(value, winding): (&f32, &i32)| {
                (value - *winding as f32 - off).abs() <= (0.5 - DOUBT) as f32
            };
            if values.iter().zip(&windings).all(is_whole) {
                windings.iter_mut().for_each(|winding| *winding += off as i32);
                return self.cover(triangles, &windings, region);
            }
        }
        for (part, inner) in self.parts(region, triangles) {
            self.covered(local, &rim, fields, &inner, part)?;
        }
        Ok(())
    }

    /// Eight octants of a cube, with the triangles that reach into them.
    fn parts(&self, region: CellCube, triangles: &[Triangle]) -> [(CellCube, Vec<Triangle>); 8] {
        std::array::from_fn(|child| {
            let height = region.height - 1;
            let part = self.cube_at(
                std::array::from_fn(|axis| region.at[axis] + ((child >> axis & 1) << height)),
                height,
            );
            let (low, width) = (part.corner.map(i64::from), i64::from(self.fill.cell() << height));
            let high = low.map(|low| low + width);
            let reaches = |triangle: &&Triangle| {
                triangle::cuts(&triangle.corners.map(|corner| corner.map(i64::from)), low, high)
            };
            (part, triangles.iter().filter(reaches).copied().collect())
        })
    }

    /// Coordinates of the sample points of several cells in a row.
    fn samples(&self, corner: i32, cells: usize) -> Vec<i32> {
        let step = self.fill.cell() / SAMPLES as i32;
        (0..cells * SAMPLES).map(|at| corner + at as i32 * step + step / 2).collect()
    }

    /// Counts the sample points of each cell of a cube that are inside. The field without its jumps
    /// is interpolated from the nodes; the jumps are added again at the sample points.
    fn sampled(&self, nodes: &[f32; ALL], triangles: &[Triangle], region: CellCube) -> Result<Vec<u8>> {
        let CellCube { height, corner, .. } = region;
        let cell = self.fill.cell();
        let lattice = Lattice { per_cell: [0; 3], step: [cell / SAMPLES as i32; 3] };
        let fine = height + SAMPLES.ilog2() as u8;
        // Relative to the same cell as at the nodes.
        let mut at = corner.map(|corner| corner + cell / 2);
        let first = lattice.first(corner);
        let winding = change::<0>(triangles, &mut at, first)
            + change::<1>(triangles, &mut at, first)
            + change::<2>(triangles, &mut at, first);
        let state = State { winding, ..State::default() };
        let windings = windings_at_centres(&lattice, triangles, corner, fine, state, self.fill.progress)?;
        let finer = self.cubic(height).finer(SAMPLES);
        let mut counts = vec![0; 1 << (3 * height)];
        for (number, value) in interpolate(nodes, [&finer; 3]).into_iter().enumerate() {
            let [x, y, z] = CellCube { height: fine, ..region }.cell(number).map(|at| at / SAMPLES);
            counts[(z << height | y) << height | x] +=
                u8::from((value + windings[number] as f32).abs() >= 0.5);
        }
        Ok(counts)
    }

    /// Fills a cube from the field at its cells. The coverage of cut cells is the number of their
    /// sample points that are inside.
    fn fields(
        &mut self,
        values: &[f32],
        triangles: &[Triangle],
        samples: &dyn Fn(&Self, usize) -> Result<usize>,
        region: CellCube,
    ) -> Result<()> {
        let cell = self.fill.cell();
        let is_doubtful = |value: &f32| (value.abs() - 0.5).abs() < DOUBT as f32;
        let is_covered = self.fill.edge == EdgeRule::Area;
        let mut cut = Bits::new(region.height);
        if is_covered || values.iter().any(is_doubtful) {
            cut = cut_cells(triangles, region.corner, cell, region.height, self.fill.progress)?;
        }
        for (number, value) in values.iter().enumerate() {
            let is_cut = cut.get(region.cell(number));
            let (is_inside, is_open) = (value.abs() >= 0.5, !is_cut && is_doubtful(value));
            if !(is_inside || is_open || is_covered && is_cut) {
                continue;
            }
            let cell = self.cell(region, number);
            if self.field.is_outside_bounds(cell.corner, self.fill.cell()) {
                continue;
            }
            self.undecided += u64::from(is_open);
            if is_covered && is_cut {
                let count = samples(self, number)? as u32;
                if count > 0 {
                    let all = (SAMPLES * SAMPLES * SAMPLES) as u32;
                    self.set(cell, (count * FULL + all / 2) / all, None, *value < 0.0);
                }
            } else if is_inside {
                self.set(cell, FULL, None, *value < 0.0);
            }
        }
        Ok(())
    }

    /// Attribute at a point: that of the nearest face.
    fn attribute(&self, point: DVec3, is_inverted: bool) -> u32 {
        if self.fill.attribute == Attribute::Occupancy { 0 } else { self.field.attribute(point, is_inverted) }
    }

    /// Sets a cell's occupancy or attribute. If `attribute` is `None`, it is that at the cell's
    /// centre.
    fn set(&mut self, cell: CellCube, occupancy: u32, attribute: Option<u32>, is_inverted: bool) {
        let (height, [x, y, z]) = (self.painter.cells.height, cell.at);
        self.painter.cells.set(cell.at);
        let is_occupancy = self.fill.attribute == Attribute::Occupancy;
        let nearest = || self.attribute(self.middle(cell).0, is_inverted);
        let value = if is_occupancy { occupancy } else { attribute.unwrap_or_else(nearest) };
        if let Some(values) = &mut self.painter.values {
            values[(z << height | y) << height | x] = value;
        }
    }
}
