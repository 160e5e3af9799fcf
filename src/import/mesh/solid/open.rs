//! Fills one block of cells inside a surface that is not closed.
//!
//! A surface without the edges of its holes is closed as far as one can see from within a box: winding
//! numbers change by the surface's crossings there, and what comes from holes far away changes slowly. So in
//! boxes without such an edge the winding field is asked for at a few points, tells how much it is off the
//! number of crossings, and if that is nearly the same whole number everywhere, crossings decide all cells.
//! Other boxes are divided, down to single cells whose field is asked for.

use glam::DVec3;

use super::bits::Cells;
use super::coverage::{Cube, Test};
use super::field::{DOUBT, LocalField, WindingField};
use super::fill::{Painter, occupancy, windings_at_centres};
use super::grid::Triangle;
use super::inside::{Attribute, Boundary, FULL, FillOptions, Inside, State};
use crate::Result;
use crate::import::mesh::face::triangle;

/// The cells of a block by a winding field; also how many cells without a face it could not tell apart from
/// others for sure.
pub(super) fn block(
    fill: &FillOptions<'_>,
    field: &WindingField,
    triangles: &[Triangle],
    min: [i32; 3],
    height: u8,
) -> Result<(Cells, u64)> {
    let mut painter = Painter::new(fill, height);
    if fill.boundary == Boundary::Coverage {
        painter.values = Some(vec![0; 1 << (3 * height)]);
    }
    let mut open = Open { fill, field, min, painter, undecided: 0 };
    open.cube(&field.everywhere(), triangles, height, [0; 3])?;
    let Open { mut painter, undecided, .. } = open;
    painter.surface(triangles, min)?;
    Ok((painter.finish(), undecided))
}

struct Open<'a> {
    fill: &'a FillOptions<'a>,
    field: &'a WindingField,
    min: [i32; 3],
    painter: Painter<'a>,
    undecided: u64,
}

impl Open<'_> {
    /// The grid point at which a cell of the block begins.
    fn corner(&self, at: [usize; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| self.min[axis] + at[axis] as i32 * self.fill.cell())
    }

    /// The corners of a cube of cells, on the grid.
    fn bounds(&self, at: [usize; 3], height: u8) -> ([i64; 3], [i64; 3]) {
        (wide(self.corner(at)), wide(self.corner(at.map(|at| at + (1 << height)))))
    }

    /// The middle of a cube of cells.
    fn middle(&self, at: [usize; 3], height: u8) -> DVec3 {
        let half = f64::from(self.fill.cell()) * f64::from(1u32 << height) / 2.0;
        DVec3::from_array(self.corner(at).map(f64::from)) + half
    }

    /// Fills a cube of cells that begins at a cell of the block, from the triangles that reach into it and
    /// the field around it.
    fn cube(
        &mut self,
        around: &LocalField<'_>,
        triangles: &[Triangle],
        height: u8,
        at: [usize; 3],
    ) -> Result<()> {
        self.fill.progress.check()?;
        if self.field.is_beside(self.corner(at), self.fill.cell() << height) {
            return Ok(());
        }
        let middle = self.middle(at, height);
        let local =
            around.narrow(middle, (middle - self.middle(at, 0)).length() + f64::from(self.fill.cell()));
        if height == 0 {
            self.cell(&local, triangles, at);
            return Ok(());
        }
        let (low, high) = self.bounds(at, height);
        let has_boundary = triangles
            .iter()
            .flat_map(|triangle| self.field.boundary_edges(triangle))
            .any(|[a, b]| triangle::segment_cuts(wide(a), wide(b), low, high));
        if !has_boundary && self.by_crossings(&local, triangles, height, at)? {
            return Ok(());
        }
        for child in 0..8 {
            let at = std::array::from_fn(|axis| at[axis] + ((child >> axis & 1) << (height - 1)));
            let (low, high) = self.bounds(at, height - 1);
            let reaches = |triangle: &&Triangle| triangle::cuts(&triangle.corners.map(wide), low, high);
            let inner: Vec<Triangle> = triangles.iter().filter(reaches).copied().collect();
            self.cube(&local, &inner, height - 1, at)?;
        }
        Ok(())
    }

    /// Fills a cube by the crossings of its rows, if the winding field agrees with them.
    fn by_crossings(
        &mut self,
        local: &LocalField<'_>,
        triangles: &[Triangle],
        height: u8,
        at: [usize; 3],
    ) -> Result<bool> {
        let (side, min, progress) = (1usize << height, self.corner(at), self.fill.progress);
        // Winding numbers against that of the first cell.
        let lattice = &self.fill.lattice;
        let mut windings = windings_at_centres(lattice, triangles, min, height, State::default(), progress)?;
        let mut off = None;
        let corners = (0..8).map(|corner| [0, 1, 2].map(|axis| (corner >> axis & 1) * (side - 1)));
        for cell in corners.chain([[side / 2; 3]]) {
            let winding = windings[(cell[2] << height | cell[1]) << height | cell[0]];
            let field = local.at(self.middle(std::array::from_fn(|axis| at[axis] + cell[axis]), 0));
            let difference = field - f64::from(winding);
            let whole = difference.round();
            if (difference - whole).abs() > 0.5 - DOUBT || off.is_some_and(|off| off != whole) {
                return Ok(false);
            }
            off = Some(whole);
        }
        let off = off.map_or(0, |off| off as i32);
        if self.fill.boundary == Boundary::Coverage && !triangles.is_empty() {
            windings.iter_mut().for_each(|winding| *winding += off);
            self.cover(triangles, &windings, height, at)?;
            return Ok(true);
        }
        // All of a cube without faces is behind the same one, as far as that can be said.
        let attribute = triangles.is_empty().then(|| self.attribute(self.middle(at, height)));
        for (row, windings) in windings.chunks_exact(side).enumerate() {
            for (x, _) in windings.iter().enumerate().filter(|(_, winding)| *winding + off != 0) {
                self.set([at[0] + x, at[1] + row % side, at[2] + row / side], FULL, attribute);
            }
        }
        Ok(true)
    }

    /// Fills a cube of cells with their coverage.
    fn cover(&mut self, triangles: &[Triangle], windings: &[i32], height: u8, at: [usize; 3]) -> Result<()> {
        let cube = Cube { triangles, min: self.corner(at), cell: self.fill.cell(), height };
        let test = Test { inside: &Inside::Winding, progress: self.fill.progress };
        let values = cube.shares(windings, test)?.into_iter().map(occupancy);
        let mask = (1usize << height) - 1;
        for (index, value) in values.enumerate().filter(|(_, value)| *value > 0) {
            let cell = [index & mask, index >> height & mask, index >> (2 * height)];
            self.set(std::array::from_fn(|axis| at[axis] + cell[axis]), value, None);
        }
        Ok(())
    }

    /// Fills a single cell.
    fn cell(&mut self, local: &LocalField<'_>, triangles: &[Triangle], at: [usize; 3]) {
        let field = local.at(self.middle(at, 0)).abs();
        if triangles.is_empty() && (field - 0.5).abs() < DOUBT {
            self.undecided += 1;
        }
        if self.fill.boundary != Boundary::Coverage || triangles.is_empty() {
            if field >= 0.5 {
                self.set(at, FULL, None);
            }
            return;
        }
        let corner = DVec3::from_array(self.corner(at).map(f64::from));
        let width = f64::from(self.fill.cell());
        let points = (0..64).map(|i| DVec3::new((i & 3) as f64, (i >> 2 & 3) as f64, (i >> 4) as f64));
        let is_inside = |point: &DVec3| local.at(corner + (*point + 0.5) * (width / 4.0)).abs() >= 0.5;
        let count = points.filter(is_inside).count() as u32;
        if count > 0 {
            self.set(at, (count * FULL + 32) / 64, None);
        }
    }

    /// The attribute at a point: that of the nearest face.
    fn attribute(&self, point: DVec3) -> u32 {
        if self.fill.attribute == Attribute::Occupancy { 0 } else { self.field.attribute(point) }
    }

    /// Gives a cell its occupancy, or an attribute: that at its middle if none is known.
    fn set(&mut self, at: [usize; 3], occupancy: u32, attribute: Option<u32>) {
        let height = self.painter.cells.height;
        self.painter.cells.set(at);
        let is_occupancy = self.fill.attribute == Attribute::Occupancy;
        let value = || attribute.unwrap_or_else(|| self.attribute(self.middle(at, 0)));
        let value = if is_occupancy { occupancy } else { value() };
        if let Some(values) = &mut self.painter.values {
            values[(at[2] << height | at[1]) << height | at[0]] = value;
        }
    }
}

fn wide(corner: [i32; 3]) -> [i64; 3] {
    corner.map(i64::from)
}
