//! Rasters as surfaces of few triangles within an error.

use std::collections::BinaryHeap;

use spade::handles::{FixedFaceHandle, InnerTag};
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use crate::grid::HeightGrid;
use crate::mesh::{Mesh, neighbours};
use crate::tin::{Tin, plane_height};
use spinney_base::sort::float_key;
use spinney_base::{Error, Progress, Result};

/// A cell as a vertex.
struct Cell {
    column: u32,
    row: u32,
    height: f64,
}

impl HasPosition for Cell {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        Point2::new(f64::from(self.column), f64::from(self.row))
    }
}

/// A cell of a triangle that is off by most, as long as the triangle is what it was.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    error: u64,
    face: usize,
    stamp: u32,
    cell: [u32; 2],
}

/// Insertions between two looks at whether to go on.
const OFTEN: u64 = 1 << 12;

/// Makes a surface of few triangles whose height at the centre of each cell with a value is off by at most `max_error`: of the two halves of the
/// whole, the cell that is off by most becomes a vertex of the Delaunay triangulation, as long as one is off by more (greedy insertion, Garland &
/// Heckbert 1995). Triangles with cells without a value alone are left out; others reach over their edge. Progress counts cells.
///
/// # Errors
/// If the grid has less than two columns or rows, or no value, `max_error` is no number from 0 on, or on interruption.
pub fn approximate(grid: &HeightGrid, max_error: f64, progress: &dyn Progress) -> Result<Tin> {
    if !(max_error >= 0.0 && max_error.is_finite()) {
        return Err(Error::invalid("max error", max_error.to_string(), "a number from 0 on"));
    }
    if grid.columns < 2 || grid.rows < 2 {
        let found = format!("{} x {} cells", grid.columns, grid.rows);
        return Err(Error::invalid("raster of a surface", found, "two columns and two rows or more"));
    }
    if !grid.heights.iter().any(|height| height.is_finite()) {
        return Err(Error::invalid("raster of a surface", "no cell with a value", "one or more"));
    }
    let mut greedy = Greedy {
        grid,
        max_error,
        delaunay: DelaunayTriangulation::new(),
        stamps: Vec::new(),
        heap: BinaryHeap::new(),
    };
    let last = [grid.columns as u32 - 1, grid.rows as u32 - 1];
    for corner in [[0, 0], [last[0], 0], [0, last[1]], last] {
        let height = nearest(grid, corner);
        greedy.insert(corner, height)?;
    }
    let faces: Vec<_> = greedy.delaunay.inner_faces().map(|face| face.fix()).collect();
    faces.into_iter().for_each(|face| greedy.look(face));
    let mut inserted = 0;
    while let Some(next) = greedy.heap.pop() {
        if greedy.stamps[next.face] != next.stamp {
            continue;
        }
        let [column, row] = next.cell;
        let height = grid.heights[row as usize * grid.columns + column as usize];
        let vertex = greedy.insert(next.cell, height)?;
        // Invariant: inserting changes no face but those around the new vertex (flips of edges end there), and faces keep their numbers: candidates of all others are true as they stand,
        // and those of the faces that were changed have an old stamp.
        let around: Vec<_> = greedy
            .delaunay
            .vertex(vertex)
            .out_edges()
            .filter_map(|edge| edge.face().as_inner())
            .map(|face| face.fix())
            .collect();
        around.into_iter().for_each(|face| greedy.look(face));
        inserted += 1;
        if u64::is_multiple_of(inserted, OFTEN) {
            progress.check()?;
        }
    }
    let cells = grid.heights.len() as u64;
    progress.advance(cells, cells);
    Ok(greedy.finish())
}

/// The height of a cell, or of the nearest one that has one.
fn nearest(grid: &HeightGrid, [column, row]: [u32; 2]) -> f64 {
    let mut found = (f64::INFINITY, 0.0);
    for (at, height) in grid.heights.iter().enumerate().filter(|(_, height)| height.is_finite()) {
        let across = (at % grid.columns) as f64 - f64::from(column);
        let away = across.hypot((at / grid.columns) as f64 - f64::from(row));
        if away < found.0 {
            found = (away, *height);
        }
    }
    found.1
}

struct Greedy<'a> {
    grid: &'a HeightGrid,
    max_error: f64,
    delaunay: DelaunayTriangulation<Cell>,
    /// How often each face has become another one.
    stamps: Vec<u32>,
    heap: BinaryHeap<Candidate>,
}

impl Greedy<'_> {
    fn insert(&mut self, [column, row]: [u32; 2], height: f64) -> Result<spade::handles::FixedVertexHandle> {
        let inserted = self.delaunay.insert(Cell { column, row, height });
        inserted
            .map_err(|error| Error::invalid("cell", format!("{column}, {row}: {error}"), "a whole number"))
    }

    /// Finds the cell of a triangle that is off by most.
    fn look(&mut self, face: FixedFaceHandle<InnerTag>) {
        let number = face.index();
        if self.stamps.len() <= number {
            self.stamps.resize(number + 1, 0);
        }
        self.stamps[number] += 1;
        let (corners, heights) = corners_of(&self.delaunay, face);
        let places = corners.map(|corner| corner.map(|at| at as f64));
        let (mut most, mut cell) = (self.max_error, None);
        each_cell(corners, &mut |column, row| {
            let height = self.grid.heights[row * self.grid.columns + column];
            let found = plane_height(places, heights, [column as f64, row as f64]);
            // (One that is no number is never off by more.)
            let error = (found - height).abs();
            if error > most && !corners.contains(&[column as i64, row as i64]) {
                (most, cell) = (error, Some([column as u32, row as u32]));
            }
        });
        if let Some(cell) = cell {
            let stamp = self.stamps[number];
            self.heap.push(Candidate { error: float_key(most), face: number, stamp, cell });
        }
    }

    /// The surface in the world.
    fn finish(self) -> Tin {
        let Greedy { grid, delaunay, .. } = self;
        let centre = |cell: &Cell| grid.centre(cell.column as usize, cell.row as usize);
        let points = delaunay.vertices().map(|vertex| centre(vertex.data())).collect();
        let heights: Vec<f64> = delaunay.vertices().map(|vertex| vertex.data().height).collect();
        let [a, b, _, d, e, _] = grid.transform;
        let is_turned = a * e - b * d < 0.0;
        let mut is_kept = Vec::new();
        let mut triangles = Vec::new();
        for face in delaunay.inner_faces() {
            let (corners, _) = corners_of(&delaunay, face.fix());
            let (mut has_value, mut has_none) = (false, false);
            each_cell(corners, &mut |column, row| {
                let is_value = grid.heights[row * grid.columns + column].is_finite();
                has_none |= !is_value;
                has_value |= is_value && !corners.contains(&[column as i64, row as i64]);
            });
            is_kept.push(has_value || !has_none);
            let [first, second, third] = face.vertices().map(|vertex| vertex.fix().index() as u32);
            triangles.push(if is_turned { [first, third, second] } else { [first, second, third] });
        }
        // A cell whose triangles would all go keeps one of them.
        let mut is_covered = vec![false; heights.len()];
        let kept = triangles.iter().zip(&is_kept).filter(|(_, is_kept)| **is_kept);
        kept.flat_map(|(corners, _)| corners).for_each(|corner| is_covered[*corner as usize] = true);
        for vertex in delaunay.vertices() {
            let cell = vertex.data();
            let is_value = grid.heights[cell.row as usize * grid.columns + cell.column as usize].is_finite();
            is_covered[vertex.fix().index()] |= !is_value;
        }
        for (corners, is_kept) in triangles.iter().zip(&mut is_kept) {
            if corners.iter().any(|corner| !is_covered[*corner as usize]) {
                *is_kept = true;
                corners.iter().for_each(|corner| is_covered[*corner as usize] = true);
            }
        }
        let mut mesh =
            Mesh { points, neighbours: neighbours(&triangles), triangles, constraints: Vec::new() };
        let kept = mesh.keep(&|triangle| is_kept[triangle]);
        let heights = kept.iter().map(|old| heights[*old as usize]).collect();
        Tin { mesh, heights }
    }
}

/// Corners of a face as columns and rows, and their heights.
fn corners_of(
    delaunay: &DelaunayTriangulation<Cell>,
    face: FixedFaceHandle<InnerTag>,
) -> ([[i64; 2]; 3], [f64; 3]) {
    let vertices = delaunay.face(face).vertices();
    let places = vertices.map(|vertex| [vertex.data().column.into(), vertex.data().row.into()]);
    (places, vertices.map(|vertex| vertex.data().height))
}

/// Goes through the cells of a triangle, which is counterclockwise in columns and rows, its edges included.
fn each_cell([a, b, c]: [[i64; 2]; 3], each: &mut dyn FnMut(usize, usize)) {
    let (first, last) = (a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]));
    for row in first..=last {
        let (mut low, mut high) = (a[0].min(b[0]).min(c[0]), a[0].max(b[0]).max(c[0]));
        for [[ax, ay], [bx, by]] in [[a, b], [b, c], [c, a]] {
            // In whole numbers, so that a cell on an edge is in both triangles beside it, and none is in neither. Left of the edge or on it: (bx - ax)(row - ay) >= (by - ay)(x - ax).
            let (rise, value) = (by - ay, (bx - ax) * (row - ay));
            if rise > 0 {
                high = high.min(ax + value.div_euclid(rise));
            } else if rise < 0 {
                low = low.max(ax - value.div_euclid(-rise));
            } else if value < 0 {
                high = low - 1;
            }
        }
        for column in low..=high {
            each(column as usize, row as usize);
        }
    }
}
