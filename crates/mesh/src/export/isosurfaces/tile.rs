//! The surface in a tile: the cubes whose last corners are its cells, with the layer of cells before them.

use super::cube::{Ring, rings};
use super::walk::{IsosurfaceGround, TILE, Tile};
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_engine::query::level_share;

/// Bytes that a tile takes while it is worked on, besides its surface.
pub(super) const TILE_BYTES: u64 = 8 << 20;

/// Bytes of a surface that goes through every cube.
pub(super) const MAX_SURFACE_BYTES: u64 = 64 << 20;

/// The numbers of a tile's cells.
pub(super) struct TileCells {
    /// The first cell; -1 is before the space.
    first: [i64; 3],
    size: [usize; 3],
    /// x runs fastest, then y, then z; what has no number, or was not read, is not one, or less than all.
    numbers: Vec<f64>,
}

/// A point of the surface in a tile.
pub(super) struct TilePoint {
    /// Its place, in cells.
    pub(super) at: [f64; 3],
    /// The axis and the first cell of the edge that it lies on, if tiles after or before this one have that, too; -1 is 2^32 - 1.
    pub(super) shared: Option<(usize, [u32; 3])>,
}

/// Triangles in a tile, counterclockwise seen from where values are lower.
#[derive(Default)]
pub(super) struct TileSurface {
    pub(super) points: Vec<TilePoint>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl TileSurface {
    /// Bytes that it takes.
    pub(super) fn bytes(&self) -> u64 {
        (self.points.capacity() * size_of::<TilePoint>() + self.triangles.capacity() * size_of::<[u32; 3]>())
            as u64
    }
}

impl TileCells {
    /// Reads the cells of a tile and those before it, or only what lies along the latter where the surface cannot be anywhere else.
    ///
    /// # Errors
    /// If the tree is damaged there.
    pub(super) fn read(ground: &IsosurfaceGround<'_>, tile: &Tile) -> Result<TileCells> {
        let first = tile.at.map(|at| (i64::from(at) << TILE) - 1);
        // One layer behind the last cells is enough for what closes the surface.
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

    /// Reads so many cells along each axis, from the first on. What is no finite number is what VOID is.
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

    /// The surface where values pass a level, with points so far from the ends of their edges.
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

/// A row of cells, a bit for each.
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

    /// Cubes between four rows that have high corners and others, and a number at each.
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
    /// Per axis, the point on the edge that begins at each cell: its number plus 1.
    known: [Vec<u32>; 3],
    made: TileSurface,
}

impl Tracer<'_> {
    /// Adds the pieces of surface in a cube that begins at a cell.
    fn add_cube(&mut self, first: [usize; 3]) {
        let cell = |corner: usize| std::array::from_fn(|axis| first[axis] + (corner >> axis & 1));
        let numbers = std::array::from_fn(|corner| self.cells.numbers[self.cells.index(cell(corner))]);
        rings(&numbers, self.level, |ring| {
            let ends = |axis: usize, corner: usize| [numbers[corner], numbers[corner | 1 << axis]];
            self.add_ring(&ring, |axis, corner| (cell(corner), ends(axis, corner)));
        });
    }

    /// Adds the triangles of a ring, of whose edges `edge` knows the first cell and the numbers at its ends.
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
        // Quadrangles are cut along the shorter diagonal.
        if let [a, b, c, d] = *points
            && self.distance(b, d) < self.distance(a, c)
        {
            points.rotate_left(1);
        }
        self.made.triangles.extend((2..count).map(|index| [points[0], points[index - 1], points[index]]));
    }

    /// The point on an edge between two cells, which is made if it is not there yet.
    fn point(&mut self, axis: usize, cell: [usize; 3], ends: [f64; 2]) -> u32 {
        let index = self.cells.index(cell);
        if let Some(known) = self.known[axis][index].checked_sub(1) {
            return known;
        }
        // What is closed ends between the cells.
        let share = if ends.iter().all(|end| end.is_finite()) { level_share(self.level, ends) } else { 0.5 };
        let first: [i64; 3] = std::array::from_fn(|axis| self.cells.first[axis] + cell[axis] as i64);
        let mut at = first.map(|cell| cell as f64 + 0.5);
        at[axis] += share.clamp(self.margin, 1.0 - self.margin);
        // Edges between the first or last cells are those of other tiles, too.
        let last = (1 << TILE) - 1;
        let is_shared = (0..3).any(|other| other != axis && first[other] & last == last);
        let shared = is_shared.then(|| (axis, first.map(|cell| cell as u32)));
        self.made.points.push(TilePoint { at, shared });
        let number = self.made.points.len() as u32;
        self.known[axis][index] = number;
        number - 1
    }

    /// Adds the point in the middle of others.
    fn middle(&mut self, points: &[u32]) -> u32 {
        let share = 1.0 / points.len() as f64;
        let sum =
            |axis: usize| points.iter().map(|point| self.made.points[*point as usize].at[axis]).sum::<f64>();
        let at = [0, 1, 2].map(|axis| share * sum(axis));
        self.made.points.push(TilePoint { at, shared: None });
        self.made.points.len() as u32 - 1
    }

    /// Square of the distance between two points, in cells.
    fn distance(&self, a: u32, b: u32) -> f64 {
        let [a, b] = [a, b].map(|point| self.made.points[point as usize].at);
        (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum()
    }
}
