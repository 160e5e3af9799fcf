//! Outer faces of cells, merged to rectangles within blocks.

use std::collections::HashMap;
use std::rc::Rc;

use super::numbers::{Shared, z_order};
use super::points::{CELLS, POINTS, Points};
use super::rings::{Rectangle, ring, triangulate};
use super::sink::{Mesh, Vertex};
use super::visit::{FACES, Reach, visit};
use spinney_base::{Progress, Result};
use spinney_engine::query::cell_blocks::{Block, BlockAttributeValues, BlockState, CellBlocks, SIDE};

/// Merged outer faces of a block's solid cells.
struct Merged {
    rectangles: Vec<Rectangle>,
    corners: Points,
}

/// Writes the faces of all solid cells.
pub(super) fn write(blocks: &mut dyn CellBlocks, mesh: &mut Mesh<'_>, progress: &dyn Progress) -> Result<()> {
    let last = (1u32 << blocks.block_level()) - 1;
    let mut faces = Faces {
        mesh,
        last,
        merged: Default::default(),
        shared: Shared::default(),
        vertices: vec![0; POINTS * POINTS * POINTS],
        found: Vec::new(),
        used: Vec::new(),
    };
    visit(blocks, Reach::Faces, progress, |blocks, block| faces.write_block(blocks, block))
}

/// Number of merged blocks in each of the two generations of the cache.
const MERGED: usize = 1024;

/// Merged faces by block; `None` if a block has no faces.
type MergedBlocks = HashMap<[i64; 3], Option<Rc<Merged>>>;

struct Faces<'a, 'b> {
    mesh: &'a mut Mesh<'b>,
    /// Last block along each axis.
    last: u32,
    /// Cache of merged blocks in two generations: the current and the previous one.
    merged: [MergedBlocks; 2],
    shared: Shared,
    /// Vertices by grid point of the block: 0 for no vertex, else its index in `found` plus 1.
    vertices: Vec<u32>,
    found: Vec<Vertex>,
    /// Indices of the grid points that have a vertex.
    used: Vec<usize>,
}

impl Faces<'_, '_> {
    fn write_block(&mut self, blocks: &mut dyn CellBlocks, block: [u32; 3]) -> Result<()> {
        let here = block.map(i64::from);
        if let Some(own) = self.merged(blocks, here)? {
            // Corners of rectangles in adjacent blocks may lie on the sides of this block's
            // rectangles. Each becomes a point of their rings, which avoids T-junctions. 13 of 0 to
            // 26 is the block itself.
            let mut points = own.corners.clone();
            for step in (0..27).filter(|step| *step != 13) {
                let by = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
                if let Some(other) = self.merged(blocks, std::array::from_fn(|axis| here[axis] + by[axis]))? {
                    points.add_shared(&other.corners, by);
                }
            }
            let mut corners = Vec::new();
            for rectangle in &own.rectangles {
                corners.clear();
                ring(rectangle, &points, &mut corners);
                self.write_face(block, rectangle, &corners)?;
            }
            self.used.drain(..).for_each(|point| self.vertices[point] = 0);
            self.found.clear();
        }
        self.shared.done(z_order(block));
        Ok(())
    }

    fn write_face(&mut self, block: [u32; 3], rectangle: &Rectangle, corners: &[[u8; 3]]) -> Result<()> {
        let mut vertices = Vec::with_capacity(corners.len());
        for corner in corners {
            vertices.push(self.vertex(block, *corner)?);
        }
        if !self.mesh.triangles {
            return self.mesh.face(vertices.iter().copied(), rectangle.attribute);
        }
        let flat: Vec<[i32; 2]> = corners.iter().map(|corner| rectangle.flat(*corner)).collect();
        for triangle in triangulate(&flat) {
            self.mesh.face(triangle.into_iter().map(|corner| vertices[corner]), rectangle.attribute)?;
        }
        Ok(())
    }

    /// Vertex at a grid point of a block.
    fn vertex(&mut self, block: [u32; 3], at: [u8; 3]) -> Result<Vertex> {
        let [x, y, z] = at.map(usize::from);
        let index = (z * POINTS + y) * POINTS + x;
        if let Some(known) = self.vertices[index].checked_sub(1) {
            return Ok(self.found[known as usize]);
        }
        let point: [u32; 3] = std::array::from_fn(|axis| block[axis] * SIDE + u32::from(at[axis]));
        let is_shared = at.iter().any(|cell| u32::from(*cell) % SIDE == 0);
        let known = if is_shared { self.shared.get(point) } else { None };
        let vertex = match known {
            Some(vertex) => vertex,
            None => {
                let vertex = self.mesh.vertex(point.map(f64::from))?;
                if is_shared {
                    // Last in Z order of the up to eight blocks that share the point.
                    let last = point.map(|cell| (cell / SIDE).min(self.last));
                    self.shared.put(point, vertex, z_order(last));
                }
                vertex
            }
        };
        self.found.push(vertex);
        self.vertices[index] = self.found.len() as u32;
        self.used.push(index);
        Ok(vertex)
    }

    fn merged(&mut self, blocks: &mut dyn CellBlocks, at: [i64; 3]) -> Result<Option<Rc<Merged>>> {
        if let Some(known) = self.merged[0].get(&at) {
            return Ok(known.clone());
        }
        let merged = match self.merged[1].remove(&at) {
            Some(known) => known,
            None => merge(blocks, at)?.map(Rc::new),
        };
        if self.merged[0].len() >= MERGED {
            self.merged[1] = std::mem::take(&mut self.merged[0]);
        }
        self.merged[0].insert(at, merged.clone());
        Ok(merged)
    }
}

/// Merges the faces of a block's solid cells.
fn merge(blocks: &mut dyn CellBlocks, at: [i64; 3]) -> Result<Option<Merged>> {
    let level = blocks.block_level();
    let state = blocks.state(level, at)?;
    if state == BlockState::Uniform(false) {
        return Ok(None);
    }
    let neighbours = FACES.map(|by| [0, 1, 2].map(|axis: usize| at[axis] + by[axis]));
    if state == BlockState::Uniform(true) {
        let mut buried = true;
        for neighbour in neighbours {
            buried &= blocks.state(level, neighbour)? == state;
        }
        if buried {
            return Ok(None);
        }
    }
    let block = blocks.block(at)?;
    let mut around = Vec::with_capacity(6);
    for neighbour in neighbours {
        around.push(blocks.block(neighbour)?);
    }
    let mut merged = Merged { rectangles: Vec::new(), corners: Points::none() };
    for normal in 0..3 {
        for up in [false, true] {
            let exposed = exposed(&block, &around[2 * normal + usize::from(up)], normal, up);
            for (slice, rows) in exposed.chunks_exact(CELLS).enumerate() {
                if rows.iter().any(|row| *row != 0) {
                    let rows: &[u32; CELLS] = rows.try_into().expect("as many rows");
                    merge_slice(&block, normal, up, slice as u8, *rows, &mut merged.rectangles);
                }
            }
        }
    }
    for rectangle in &merged.rectangles {
        rectangle.corners().into_iter().for_each(|corner| merged.corners.add(corner));
    }
    Ok((!merged.rectangles.is_empty()).then_some(merged))
}

/// Axes of a slice perpendicular to `normal`: along a row's bits, and from row to row.
fn axes(normal: usize) -> (usize, usize) {
    match normal {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}

/// Bit rows of the cells with an exposed face in one direction, slice by slice along `normal`.
fn exposed(block: &Block, neighbours: &Block, normal: usize, up: bool) -> Vec<u32> {
    let mut exposed = vec![0; CELLS * CELLS];
    let row = |block: &Block, y: usize, z: usize| block.solid[z * CELLS + y];
    let last = CELLS - 1;
    for z in 0..CELLS {
        for y in 0..CELLS {
            let own = row(block, y, z);
            if own == 0 {
                continue;
            }
            let neighbour = match (normal, up) {
                (0, false) => own << 1 | row(neighbours, y, z) >> last,
                (0, true) => own >> 1 | row(neighbours, y, z) << last,
                (1, false) if y == 0 => row(neighbours, last, z),
                (1, true) if y == last => row(neighbours, 0, z),
                (1, false) => row(block, y - 1, z),
                (1, true) => row(block, y + 1, z),
                (_, false) if z == 0 => row(neighbours, y, last),
                (_, true) if z == last => row(neighbours, y, 0),
                (_, false) => row(block, y, z - 1),
                (_, true) => row(block, y, z + 1),
            };
            let mut open = own & !neighbour;
            match normal {
                0 => {
                    while open != 0 {
                        let x = open.trailing_zeros() as usize;
                        open &= open - 1;
                        exposed[x * CELLS + z] |= 1 << y;
                    }
                }
                1 => exposed[y * CELLS + z] = open,
                _ => exposed[z * CELLS + y] = open,
            }
        }
    }
    exposed
}

/// Merges the exposed faces of a slice: maximal runs of cells in a row, extended over as many rows
/// as have the same cells. Only cells with equal attributes are merged.
fn merge_slice(
    block: &Block,
    normal: usize,
    up: bool,
    slice: u8,
    mut rows: [u32; CELLS],
    rectangles: &mut Vec<Rectangle>,
) {
    let (along, across) = axes(normal);
    let attribute = |bit: u32, row: usize| {
        let mut cell = [0; 3];
        (cell[normal], cell[along], cell[across]) = (u32::from(slice), bit, row as u32);
        block.attribute(cell)
    };
    let all_same = matches!(block.carried, BlockAttributeValues::Same(_));
    for first_row in 0..CELLS {
        while rows[first_row] != 0 {
            let first = rows[first_row].trailing_zeros();
            let value = attribute(first, first_row);
            let mut count = (rows[first_row] >> first).trailing_ones();
            if !all_same {
                count = (1..count).find(|i| attribute(first + i, first_row) != value).unwrap_or(count);
            }
            let bits = (u32::MAX >> (SIDE - count)) << first;
            let is_same = |row: usize| {
                rows[row] & bits == bits
                    && (all_same || (first..first + count).all(|bit| attribute(bit, row) == value))
            };
            let end_row = (first_row + 1..CELLS).find(|row| !is_same(*row)).unwrap_or(CELLS);
            rows[first_row..end_row].iter_mut().for_each(|row| *row &= !bits);
            let plane = slice + u8::from(up);
            let (mut min, mut max) = ([plane; 3], [plane; 3]);
            (min[along], max[along]) = (first as u8, (first + count) as u8);
            (min[across], max[across]) = (first_row as u8, end_row as u8);
            rectangles.push(Rectangle { normal, up, min, max, attribute: value });
        }
    }
}
