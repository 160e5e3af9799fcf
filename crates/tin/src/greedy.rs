//! Approximation of rasters by surfaces of few triangles within a maximum error.

use std::collections::BinaryHeap;

use spade::handles::{FixedFaceHandle, InnerTag};
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use crate::grid::HeightGrid;
use crate::mesh::{Mesh, neighbours};
use crate::tin::{Tin, plane_height};
use spinney_base::sort::float_key;
use spinney_base::{Error, Progress, Result};

/// A raster cell as a vertex.
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

/// The cell of a triangle with the largest error. It is valid while the face's stamp is unchanged.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    error: u64,
    face: usize,
    stamp: u32,
    cell: [u32; 2],
}

/// Number of insertions between two checks for cancellation.
const OFTEN: u64 = 1 << 12;

/// Approximates a raster by a surface of few triangles. The surface's height at the centre of each
/// cell with a value differs from that value by at most `max_error`. The Delaunay triangulation
/// starts with the four corner cells. The cell with the largest error is inserted as a vertex until
/// no error exceeds the maximum (greedy insertion, Garland & Heckbert 1995). Triangles that cover
/// only cells without a value are left out. Other triangles may extend over such cells. Progress
/// counts cells.
///
/// # Errors
/// If the grid has fewer than two columns or rows, or no value; if `max_error` is not a finite
/// number from 0 on; on cancellation.
pub fn approximate(grid: &HeightGrid, max_error: f64, progress: &dyn Progress) -> Result<Tin> {
    if !(max_error >= 0.0 && max_error.is_finite()) {
        return Err(Error::invalid("max error", max_error.to_string(), "a finite number of at least 0"));
    }
    if grid.columns < 2 || grid.rows < 2 {
        let found = format!("{} x {} cells", grid.columns, grid.rows);
        return Err(Error::invalid("raster of a surface", found, "at least 2 columns and 2 rows"));
    }
    if !grid.heights.iter().any(|height| height.is_finite()) {
        return Err(Error::invalid("raster of a surface", "no cell with a value", "at least 1"));
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
    faces.into_iter().for_each(|face| greedy.update_candidate(face));
    let mut inserted = 0;
    while let Some(next) = greedy.heap.pop() {
        if greedy.stamps[next.face] != next.stamp {
            continue;
        }
        let [column, row] = next.cell;
        let height = grid.heights[row as usize * grid.columns + column as usize];
        let vertex = greedy.insert(next.cell, height)?;
        // Invariant: an insertion changes only the faces around the new vertex (edge flips stay
        // within them), and faces keep their indices. So candidates of all other faces remain
        // valid, and those of changed faces have an old stamp.
        let around: Vec<_> = greedy
            .delaunay
            .vertex(vertex)
            .out_edges()
            .filter_map(|edge| edge.face().as_inner())
            .map(|face| face.fix())
            .collect();
        around.into_iter().for_each(|face| greedy.update_candidate(face));
        inserted += 1;
        if u64::is_multiple_of(inserted, OFTEN) {
            progress.check()?;
        }
    }
    let cells = grid.heights.len() as u64;
    progress.advance(cells, cells);
    Ok(greedy.finish())
}

/// Returns the height of a cell, or of the nearest cell that has one.
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
    /// Number of changes of each face so far.
    stamps: Vec<u32>,
    heap: BinaryHeap<Candidate>,
}

impl Greedy<'_> {
    fn insert(&mut self, [column, row]: [u32; 2], height: f64) -> Result<spade::handles::FixedVertexHandle> {
        let inserted = self.delaunay.insert(Cell { column, row, height });
        inserted.map_err(|error| {
            Error::invalid("cell", format!("{column}, {row}: {error}"), "integer coordinates")
        })
    }

    /// Finds the cell of a triangle with the largest error, and queues it if the error exceeds the
    /// maximum.
    fn update_candidate(&mut self, face: FixedFaceHandle<InnerTag>) {
        let number = face.index();
        if self.stamps.len() <= number {
            self.stamps.resize(number + 1, 0);
        }
        self.stamps[number] += 1;
        let (corners, heights) = corners_of(&self.delaunay, face);
        let positions = corners.map(|corner| corner.map(|at| at as f64));
        let (mut largest_error, mut cell) = (self.max_error, None);
        each_cell(corners, &mut |column, row| {
            let height = self.grid.heights[row * self.grid.columns + column];
            let found = plane_height(positions, heights, [column as f64, row as f64]);
            // (The error of a cell without a value is NaN, which never compares as larger.)
            let error = (found - height).abs();
            if error > largest_error && !corners.contains(&[column as i64, row as i64]) {
                (largest_error, cell) = (error, Some([column as u32, row as u32]));
            }
        });
        if let Some(cell) = cell {
            let stamp = self.stamps[number];
            self.heap.push(Candidate { error: float_key(largest_error), face: number, stamp, cell });
        }
    }

    /// Returns the surface in world coordinates.
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
        // A vertex with a value whose triangles would all be dropped keeps one of them.
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

/// Returns the corners of a face as columns and rows, and their heights.
fn corners_of(
    delaunay: &DelaunayTriangulation<Cell>,
    face: FixedFaceHandle<InnerTag>,
) -> ([[i64; 2]; 3], [f64; 3]) {
    let vertices = delaunay.face(face).vertices();
    let positions = vertices.map(|vertex| [vertex.data().column.into(), vertex.data().row.into()]);
    (positions, vertices.map(|vertex| vertex.data().height))
}

/// Visits the cells of a triangle, including those on its edges. The triangle is counterclockwise
/// in columns and rows.
fn each_cell([a, b, c]: [[i64; 2]; 3], each: &mut dyn FnMut(usize, usize)) {
    let (first, last) = (a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]));
    for row in first..=last {
        let (mut low, mut high) = (a[0].min(b[0]).min(c[0]), a[0].max(b[0]).max(c[0]));
        for [[ax, ay], [bx, by]] in [[a, b], [b, c], [c, a]] {
            // Integer arithmetic: a cell on an edge is in both adjacent triangles, and no cell is
            // missed. Left of the edge or on it means (bx - ax)(row - ay) >= (by - ay)(x - ax).
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
