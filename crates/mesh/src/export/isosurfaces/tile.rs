//! Surface in a tile: the cubes whose last corners are the tile's cells. They need the layer of
//! cells before the tile.

use super::cube::{Ring, rings};
use super::traversal::{IsosurfaceGround, TILE, Tile};
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_engine::query::level_share;

/// Working memory of a tile in bytes, without its surface.
pub(super) const TILE_BYTES: u64 = 8 << 20;

/// Bytes of a surface that crosses every cube.
pub(super) const MAX_SURFACE_BYTES: u64 = 64 << 20;

/// Values of a tile's cells.
pub(super) struct TileCells {
    /// First cell; -1 is before the space.
    first: [i64; 3],
    size: [usize; 3],
    /// Values; x runs fastest, then y, then z. Cells without a value are `IsosurfaceGround::none`;
    /// cells that were not read are NaN.
    numbers: Vec<f64>,
}

/// Point of the surface in a tile.
pub(super) struct TilePoint {
    /// Position in cells.
    pub(super) at: [f64; 3],
    /// Axis and first cell of its edge if other tiles share the edge; -1 is stored as 2^32 - 1.
    pub(super) shared: Option<(usize, [u32; 3])>,
}

/// Triangles in a tile, counterclockwise seen from the lower values.
#[derive(Default)]
pub(super) struct TileSurface {
    pub(super) points: Vec<TilePoint>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl TileSurface {
    /// Size in bytes.
    pub(super) fn bytes(&self) -> u64 {
        (self.points.capacity() * size_of::<TilePoint>() + self.triangles.capacity() * size_of::<[u32; 3]>())
            as u64
    }
}

impl TileCells {
    /// Reads the cells of a tile and the layer before it. If the surface cannot cross the tile's
    /// own cells, reads only the first two layers along each axis.
    ///
    /// # Errors
    /// If the tree is corrupt there.
    pub(super) fn read(ground: &IsosurfaceGround<'_>, tile: &Tile) -> Result<TileCells> {
        let first = tile.at.map(|at| (i64::from(at) << TILE) - 1);
        // One layer after the last cells suffices for closing the surface.
        let end = |axis: usize| (first[axis] + 1 + (1 << TILE)).min(ground.whole[axis] as i64 + 1);
        let size = std::array::from_fn(|axis| (end(axis) - first[axis]).max(0) as usize);
        let mut cells = TileCells { first, size, numbers: vec![f64::NAN; size.iter().product()] };
        if tile.is_crossed {
            cells.read_box(ground, size)?;
            return Ok(cells);
        }
        for axis in 0..3 {
            let mut layers = size;
            layers[axis] = layers[axis].min(2);
            cells.read_box(ground, layers)?;
        }
        Ok(cells)
    }

    /// Reads `size` cells along each axis, from the first cell on. Values that are not finite count
    /// as VOID.
    fn read_box(&mut self, ground: &IsosurfaceGround<'_>, size: [usize; 3]) -> Result<()> {
        let none = ground.none;
        for z in 0..size[2] {
            for y in 0..size[1] {
                let start = self.index([0, y, z]);
                self.numbers[start..][..size[0]].fill(none);
            }
        }
        let min = self.first.map(|cell| cell.max(0) as u64);
        let end = |axis: usize| (self.first[axis] + size[axis] as i64).max(0) as u64;
        let max = std::array::from_fn(|axis| end(axis).min(ground.whole[axis]));
        let bounds = Bounds { min, max };
        if bounds.is_empty() {
            return Ok(());
        }
        let read = ground.relief.numbers(&bounds)?;
        let [width, height, _] = bounds.size().map(|side| side as usize);
        let [x, y, z] = [0, 1, 2].map(|axis| (min[axis] as i64 - self.first[axis]) as usize);
        for (row, numbers) in read.chunks_exact(width).enumerate() {
            let start = self.index([x, y + row % height, z + row / height]);
            for (cell, number) in self.numbers[start..][..width].iter_mut().zip(numbers) {
                *cell = if number.is_finite() { *number } else { none };
            }
        }
        Ok(())
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Surface at a level. Points stay at least `margin` from the ends of their edges.
    pub(super) fn surface(&self, level: f64, margin: f64) -> TileSurface {
        let rows: Vec<Row> = match self.size[0] {
            0 => Vec::new(),
            width => self.numbers.chunks_exact(width).map(|numbers| Row::of(numbers, level)).collect(),
        };
        let mut tracer = Tracer {
            cells: self,
            level,
            margin,
            known: [(); 3].map(|()| vec![0; self.numbers.len()]),
            made: TileSurface::default(),
        };
        let [_, height, depth] = self.size;
        for z in 1..depth {
            for y in 1..height {
                let row = |y: usize, z: usize| &rows[z * height + y];
                let mut crossed = Row::crossed([row(y - 1, z - 1), row(y, z - 1), row(y - 1, z), row(y, z)]);
                while crossed != 0 {
                    let x = crossed.trailing_zeros() as usize;
                    crossed &= crossed - 1;
                    tracer.add_cube([x, y - 1, z - 1]);
                }
            }
        }
        tracer.made
    }
}

/// Row of cells, one bit each.
struct Row {
    high: u128,
    there: u128,
}

impl Row {
    fn of(numbers: &[f64], level: f64) -> Row {
        let mut row = Row { high: 0, there: 0 };
        for (x, number) in numbers.iter().enumerate() {
            row.high |= u128::from(*number >= level) << x;
            row.there |= u128::from(!number.is_nan()) << x;
        }
        row
    }

    /// Bits of the cubes between four rows that have both high and low corners, and a value at each
    /// corner.
    fn crossed(rows: [&Row; 4]) -> u128 {
        let all = |of: &dyn Fn(&Row) -> u128| rows.iter().fold(u128::MAX, |all, row| all & of(row));
        let any = rows.iter().fold(0, |any, row| any | row.high);
        let (high, there) = (all(&|row| row.high), all(&|row| row.there));
        (any | any >> 1) & !(high & high >> 1) & (there & there >> 1)
    }
}

struct Tracer<'a> {
    cells: &'a TileCells,
    level: f64,
    margin: f64,
    /// Point on the edge that starts at each cell, by axis: its index plus 1, or 0.
    known: [Vec<u32>; 3],
    made: TileSurface,
}

impl Tracer<'_> {
    /// Adds the components of the surface in a cube that starts at cell `first`.
    fn add_cube(&mut self, first: [usize; 3]) {
        let cell = |corner: usize| std::array::from_fn(|axis| first[axis] + (corner >> axis & 1));
        let numbers = std::array::from_fn(|corner| self.cells.numbers[self.cells.index(cell(corner))]);
        rings(&numbers, self.level, |ring| {
            let ends = |axis: usize, corner: usize| [numbers[corner], numbers[corner | 1 << axis]];
            self.add_ring(&ring, |axis, corner| (cell(corner), ends(axis, corner)));
        });
    }

    /// Adds the triangles of a ring. `edge` returns an edge's first cell and the values at its
    /// ends.
    fn add_ring(&mut self, ring: &Ring, edge: impl Fn(usize, usize) -> ([usize; 3], [f64; 2])) {
        let mut points = [0; 12];
        let count = ring.edges().len();
        for (point, (axis, corner)) in points.iter_mut().zip(ring.edges()) {
            let (cell, ends) = edge(axis, corner);
            *point = self.point(axis, cell, ends);
        }
        let points = &mut points[..count];
        if ring.pinched.is_some() {
            let middle = self.middle(points);
            let next = |index: usize| points[(index + 1) % count];
            self.made.triangles.extend((0..count).map(|index| [middle, points[index], next(index)]));
            return;
        }
        // Quadrangles are split along the shorter diagonal.
        if let [a, b, c, d] = *points
            && self.distance(b, d) < self.distance(a, c)
        {
            points.rotate_left(1);
        }
        self.made.triangles.extend((2..count).map(|index| [points[0], points[index - 1], points[index]]));
    }

    /// Returns the point on an edge between two cells; adds it if it does not exist yet.
    fn point(&mut self, axis: usize, cell: [usize; 3], ends: [f64; 2]) -> u32 {
        let index = self.cells.index(cell);
        if let Some(known) = self.known[axis][index].checked_sub(1) {
            return known;
        }
        // Closed surfaces end midway between the cells.
        let share = if ends.iter().all(|end| end.is_finite()) { level_share(self.level, ends) } else { 0.5 };
        let first: [i64; 3] = std::array::from_fn(|axis| self.cells.first[axis] + cell[axis] as i64);
        let mut at = first.map(|cell| cell as f64 + 0.5);
        at[axis] += share.clamp(self.margin, 1.0 - self.margin);
        // Edges between the first or last cells are shared with other tiles.
        let last = (1 << TILE) - 1;
        let is_shared = (0..3).any(|other| other != axis && first[other] & last == last);
        let shared = is_shared.then(|| (axis, first.map(|cell| cell as u32)));
        self.made.points.push(TilePoint { at, shared });
        let number = self.made.points.len() as u32;
        self.known[axis][index] = number;
        number - 1
    }

    /// Adds the centroid of points.
    fn middle(&mut self, points: &[u32]) -> u32 {
        let share = 1.0 / points.len() as f64;
        let sum =
            |axis: usize| points.iter().map(|point| self.made.points[*point as usize].at[axis]).sum::<f64>();
        let at = [0, 1, 2].map(|axis| share * sum(axis));
        self.made.points.push(TilePoint { at, shared: None });
        self.made.points.len() as u32 - 1
    }

    /// Squared distance of two points, in cells.
    fn distance(&self, a: u32, b: u32) -> f64 {
        let [a, b] = [a, b].map(|point| self.made.points[point as usize].at);
        (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum()
    }
}
