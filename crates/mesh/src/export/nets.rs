//! Surface nets. Each cube between eight neighbouring cell centres has a vertex per [sheet](Sheets)
//! of the surface that crosses it. Each edge between two centres that the surface crosses has a
//! quadrangle.
//!
//! A cube is named by its last corner. Nearly all data that it needs is then in its block and in
//! the layer of cells before it, and its quadrangles join cubes that precede it.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;

use super::isosurfaces::cube::EDGES;
use super::net_normals::NetNormals;
use super::numbers::{Shared, z_order};
use super::sheets::Sheets;
use super::sink::{Mesh, Vertex};
use super::visit::{Reach, visit};
use spinney_base::{Error, Progress, Result};
use spinney_engine::query::cell_blocks::{Block, BlockAttribute, CellBlocks, SIDE};

/// Cells along a side of a block, as an index.
const CELLS: usize = SIDE as usize;
/// Cells along a side of a block and the layer before it.
const WIDE: usize = CELLS + 1;
/// Coverage at the surface, 0 to 255. No cell has this coverage.
const HALF: f64 = 127.5;

/// Flag in [`Nets::vertices`]: the cube has a vertex per edge.
const SPLIT: u32 = 1 << 31;

/// Writes the smooth surface. Vertices keep `margin` cells from the cubes' walls. Cells are full or
/// empty unless `blocks` carries their coverage.
pub(super) fn write(
    blocks: &mut dyn CellBlocks,
    margin: f64,
    mesh: &mut Mesh<'_>,
    progress: &dyn Progress,
) -> Result<()> {
    let mut nets = Nets {
        mesh,
        has_coverage: blocks.carry() == BlockAttribute::Coverage,
        margin,
        sheets: Sheets::all(),
        shared: Shared::default(),
        split: Default::default(),
        vertices: vec![0; CELLS * CELLS * CELLS],
        found: Vec::new(),
        used: Vec::new(),
        before: HashMap::new(),
    };
    visit(blocks, Reach::Nets, progress, |blocks, block| nets.write_block(blocks, block))
}

struct Nets<'a, 'b> {
    mesh: &'a mut Mesh<'b>,
    has_coverage: bool,
    /// Minimum distance of a vertex from its cube's walls, in cells.
    margin: f64,
    /// Sheets of cubes, by their solid corners.
    sheets: Box<[Sheets]>,
    /// Vertices of cubes in the last layers of blocks; `split` holds those of cubes with several
    /// sheets, by edge.
    shared: Shared,
    split: [Shared; EDGES],
    /// Vertices by cube of the block: 0 for no vertex, else the index in `found` plus 1. With
    /// [`SPLIT`] added, it is the index of the first edge's vertex, and those of all other edges
    /// follow.
    vertices: Vec<u32>,
    found: Vec<Vertex>,
    /// Indices of the cubes that have a vertex.
    used: Vec<usize>,
    /// Blocks before the first blocks of a partial export, whose vertices also belong to its
    /// surface.
    before: HashMap<[i64; 3], CellLayer>,
}

/// Vertices of a cube.
enum CubeVertices {
    One(Vertex),
    /// Vertex of each edge.
    ByEdge(Box<[Vertex; EDGES]>),
}

/// Block and the layer of cells before it.
struct CellLayer {
    /// Position of the block at the block level.
    at: [i64; 3],
    /// Block and its neighbours. Index bits are the axes along which the neighbour precedes the
    /// block.
    blocks: Vec<Arc<Block>>,
    /// Solid cells: bit x of row `z * WIDE + y`.
    solid: Vec<u64>,
    has_coverage: bool,
    /// Normals of vertices, if requested.
    normals: Option<NetNormals>,
}

impl CellLayer {
    fn read(
        blocks: &mut dyn CellBlocks,
        at: [i64; 3],
        has_coverage: bool,
        with_normals: bool,
    ) -> Result<CellLayer> {
        let normals = if with_normals { Some(NetNormals::read(blocks, at, has_coverage)?) } else { None };
        let before = |step: i64| [0, 1, 2].map(|axis: usize| at[axis] - (step >> axis & 1));
        let blocks: Result<Vec<_>> = (0..8).map(|step| blocks.block(before(step))).collect();
        let blocks = blocks?;
        let mut solid = vec![0; WIDE * WIDE];
        for z in 0..WIDE {
            for y in 0..WIDE {
                let step = usize::from(y == 0) << 1 | usize::from(z == 0) << 2;
                let row = (z + CELLS - 1) % CELLS * CELLS + (y + CELLS - 1) % CELLS;
                let (own, before) = (blocks[step].solid[row], blocks[step | 1].solid[row]);
                solid[z * WIDE + y] = u64::from(own) << 1 | u64::from(before >> (CELLS - 1));
            }
        }
        Ok(CellLayer { at, blocks, solid, has_coverage, normals })
    }

    fn is_solid(&self, [x, y, z]: [usize; 3]) -> bool {
        self.solid[z * WIDE + y] >> x & 1 > 0
    }

    /// Block that contains a cell, and the cell's coordinates in it.
    fn locate(&self, cell: [usize; 3]) -> (&Block, [u32; 3]) {
        let step = (0..3).fold(0, |step, axis| step | usize::from(cell[axis] == 0) << axis);
        (&self.blocks[step], cell.map(|cell| ((cell + CELLS - 1) % CELLS) as u32))
    }

    /// Attribute of a cell.
    fn attribute(&self, cell: [usize; 3]) -> u32 {
        let (block, cell) = self.locate(cell);
        block.attribute(cell)
    }

    /// Coverage of a cell, 0 to 255.
    fn coverage(&self, cell: [usize; 3]) -> f64 {
        match self.has_coverage {
            true => f64::from(self.attribute(cell)),
            false if self.is_solid(cell) => 255.0,
            false => 0.0,
        }
    }

    /// Bits of the cubes of a row that have both solid and empty corners.
    fn mixed(&self, y: usize, z: usize) -> u32 {
        let rows = [z * WIDE + y, z * WIDE + y + 1, (z + 1) * WIDE + y, (z + 1) * WIDE + y + 1];
        let [a, b, c, d] = rows.map(|row| self.solid[row]);
        // Each bit is a cell; shifting aligns the next cell along x. A cube is mixed if any of its
        // eight corners is solid and not all are.
        let (any, all) = (a | b | c | d, a & b & c & d);
        ((any | any >> 1) & !(all & all >> 1)) as u32
    }

    /// Bit per solid corner of a cube. The cube may extend beyond the block and the layer before
    /// it.
    fn corners(&self, blocks: &mut dyn CellBlocks, first: [i64; 3]) -> Result<u8> {
        let mut solid = 0;
        for corner in 0..8 {
            let cell: [i64; 3] = std::array::from_fn(|axis| first[axis] + (corner >> axis & 1));
            let is_solid = if cell.iter().all(|cell| (0..WIDE as i64).contains(cell)) {
                self.is_solid(cell.map(|cell| cell as usize))
            } else {
                // (The first cell of this layer is the last one of the preceding block.)
                let side = i64::from(SIDE);
                let block = blocks
                    .block(std::array::from_fn(|axis| self.at[axis] + (cell[axis] - 1).div_euclid(side)))?;
                let [x, y, z] = cell.map(|cell| (cell - 1).rem_euclid(side) as usize);
                block.solid[z * CELLS + y] >> x & 1 > 0
            };
            solid |= u8::from(is_solid) << corner;
        }
        Ok(solid)
    }

    /// Mean of the points where the edges of a sheet cross half coverage, by linear interpolation;
    /// in cells from the cube's first corner.
    fn middle(&self, first: [usize; 3], sheets: &Sheets, sheet: u8) -> [f64; 3] {
        let corner = |i: usize| [0, 1, 2].map(|axis| first[axis] + (i >> axis & 1));
        let coverage: [f64; 8] = std::array::from_fn(|i| self.coverage(corner(i)));
        let mut sum = [0.0; 3];
        let mut crossings = 0.0;
        for axis in 0..3 {
            for from in (0..8).filter(|corner| corner >> axis & 1 == 0) {
                let (a, b) = (coverage[from], coverage[from | 1 << axis]);
                if (a > HALF) != (b > HALF) && sheets.of_edge[axis * 8 + from] == sheet {
                    crossings += 1.0;
                    for (i, sum) in sum.iter_mut().enumerate() {
                        *sum += if i == axis { (HALF - a) / (b - a) } else { (from >> i & 1) as f64 };
                    }
                }
            }
        }
        sum.map(|sum| sum / crossings)
    }
}

impl Nets<'_, '_> {
    fn write_block(&mut self, blocks: &mut dyn CellBlocks, block: [u32; 3]) -> Result<()> {
        let field =
            CellLayer::read(blocks, block.map(i64::from), self.has_coverage, self.mesh.wants_normals())?;
        for z in 0..CELLS {
            for y in 0..CELLS {
                let mut mixed = field.mixed(y, z);
                while mixed != 0 {
                    let x = mixed.trailing_zeros() as usize;
                    mixed &= mixed - 1;
                    self.write_vertices(blocks, &field, block, [x, y, z])?;
                    self.write_faces(blocks, &field, block, [x, y, z])?;
                }
            }
        }
        self.used.drain(..).for_each(|cube| self.vertices[cube] = 0);
        self.found.clear();
        for shared in self.split.iter_mut().chain([&mut self.shared]) {
            shared.done(z_order(block));
        }
        Ok(())
    }

    fn write_vertices(
        &mut self,
        blocks: &mut dyn CellBlocks,
        field: &CellLayer,
        block: [u32; 3],
        cube: [usize; 3],
    ) -> Result<()> {
        let name = name(block, cube.map(|cube| cube as i64));
        let vertices = self.vertices_at(blocks, field, name, cube)?;
        let first = self.found.len() as u32 + 1;
        let index = index_of(cube);
        match &vertices {
            CubeVertices::One(vertex) => {
                self.found.push(*vertex);
                self.vertices[index] = first;
            }
            CubeVertices::ByEdge(vertices) => {
                self.found.extend_from_slice(&**vertices);
                self.vertices[index] = first | SPLIT;
            }
        }
        self.used.push(index);
        // Only cubes in the last layers have neighbours in later blocks. The last of these is the
        // next block along all axes in which the cube is in the last layer.
        if cube.contains(&(CELLS - 1)) {
            self.share(name, &vertices, z_order(name.map(|cell| (cell + 1) / SIDE)));
        }
        Ok(())
    }

    /// Keeps the vertices of a cube until the block at position `last` in Z order is done.
    fn share(&mut self, name: [u32; 3], vertices: &CubeVertices, last: u64) {
        match vertices {
            CubeVertices::One(vertex) => self.shared.put(name, *vertex, last),
            CubeVertices::ByEdge(vertices) => {
                for (shared, vertex) in self.split.iter_mut().zip(&**vertices) {
                    shared.put(name, *vertex, last);
                }
            }
        }
    }

    /// Sheets of a cube of the field.
    fn sheets_of(&self, blocks: &mut dyn CellBlocks, field: &CellLayer, cube: [usize; 3]) -> Result<Sheets> {
        let first = cube.map(|cube| cube as i64);
        let solid = field.corners(blocks, first)?;
        let sheets = self.sheets[usize::from(solid)];
        if let Some(face) = sheets.pinched {
            let mut beyond = first;
            beyond[face / 2] += if face & 1 > 0 { 1 } else { -1 };
            let other = field.corners(blocks, beyond)?;
            if self.sheets[usize::from(other)].pinched == Some(face ^ 1) {
                return Ok(Sheets::of(solid, Some(face)));
            }
        }
        Ok(sheets)
    }

    /// Writes the vertices of a cube of the field.
    fn vertices_at(
        &mut self,
        blocks: &mut dyn CellBlocks,
        field: &CellLayer,
        name: [u32; 3],
        cube: [usize; 3],
    ) -> Result<CubeVertices> {
        let sheets = self.sheets_of(blocks, field, cube)?;
        let mut write = |sheet: u8| {
            let middle = field.middle(cube, &sheets, sheet);
            // The first corner is the centre of the cell before the naming cell. (-1 is 2^32 - 1.)
            let at = std::array::from_fn(|axis| {
                f64::from(name[axis] as i32) - 0.5 + middle[axis].clamp(self.margin, 1.0 - self.margin)
            });
            if let Some(normals) = &field.normals {
                // (The coverage gradient fits none of several sheets, so they get the normals of
                // their faces.)
                self.mesh.normal(if sheets.count > 1 { [0.0; 3] } else { normals.at(cube) })?;
            }
            self.mesh.vertex(at)
        };
        let first = write(0)?;
        if sheets.count == 1 {
            return Ok(CubeVertices::One(first));
        }
        let mut all = vec![first];
        for sheet in 1..sheets.count {
            all.push(write(sheet)?);
        }
        Ok(CubeVertices::ByEdge(Box::new(sheets.of_edge.map(|sheet| all[usize::from(sheet)]))))
    }

    /// Writes the quadrangles around the edges that meet in a cube's first corner. All cubes around
    /// these edges already have vertices.
    fn write_faces(
        &mut self,
        blocks: &mut dyn CellBlocks,
        field: &CellLayer,
        block: [u32; 3],
        cube: [usize; 3],
    ) -> Result<()> {
        let is_solid = field.is_solid(cube);
        for axis in 0..3 {
            let mut end = cube;
            end[axis] += 1;
            if field.is_solid(end) == is_solid {
                continue;
            }
            let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut around = |back: [i64; 2]| {
                let mut cube = cube.map(|cube| cube as i64);
                cube[b] -= back[0];
                cube[c] -= back[1];
                let corner = (back[0] as usize) << b | (back[1] as usize) << c;
                self.vertex(blocks, block, cube, axis * 8 + corner)
            };
            let ring = [around([1, 1])?, around([0, 1])?, around([0, 0])?, around([1, 0])?];
            let attribute = field.attribute(if is_solid { cube } else { end });
            self.write_face(ring, is_solid, attribute)?;
        }
        Ok(())
    }

    /// Writes a quadrangle, reversed unless the solid is before it along its axis.
    fn write_face(&mut self, mut ring: [Vertex; 4], up: bool, attribute: u32) -> Result<()> {
        if !up {
            ring.reverse();
        }
        if !self.mesh.triangles {
            return self.mesh.face(ring.into_iter(), attribute);
        }
        // Split along the shorter diagonal.
        let distance = |a: Vertex, b: Vertex| DVec3::from(a.at).distance_squared(DVec3::from(b.at));
        let [a, b, c, d] = ring;
        let triangles =
            if distance(a, c) <= distance(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        triangles.into_iter().try_for_each(|triangle| self.mesh.face(triangle.into_iter(), attribute))
    }

    /// Vertex on an edge of a cube that was visited before, or that precedes the blocks of a
    /// partial export.
    fn vertex(
        &mut self,
        blocks: &mut dyn CellBlocks,
        block: [u32; 3],
        cube: [i64; 3],
        edge: usize,
    ) -> Result<Vertex> {
        let known = if cube.contains(&-1) {
            let name = name(block, cube);
            match self.shared(name, edge) {
                None if name.contains(&u32::MAX) => {
                    self.write_before(blocks, block, cube, name)?;
                    self.shared(name, edge)
                }
                known => known,
            }
        } else {
            let known = self.vertices[index_of(cube.map(|cube| cube as usize))];
            let step = if known & SPLIT > 0 { edge } else { 0 };
            (known & !SPLIT).checked_sub(1).map(|known| self.found[known as usize + step])
        };
        // Only a source whose cells change between reads gets here.
        known.ok_or_else(|| Error::invalid("tree", "cells that changed while they were read", "others"))
    }

    /// Vertex of a cube that several blocks share.
    fn shared(&self, name: [u32; 3], edge: usize) -> Option<Vertex> {
        self.shared.get(name).or_else(|| self.split[edge].get(name))
    }

    /// Writes the vertices of a cube in a block before those of a partial export. (Cubes next to
    /// the first block of the space are empty.)
    fn write_before(
        &mut self,
        blocks: &mut dyn CellBlocks,
        block: [u32; 3],
        cube: [i64; 3],
        name: [u32; 3],
    ) -> Result<()> {
        let at = std::array::from_fn(|axis| i64::from(block[axis]) - i64::from(cube[axis] < 0));
        let field = match self.before.remove(&at) {
            Some(field) => field,
            None => CellLayer::read(blocks, at, self.has_coverage, self.mesh.wants_normals())?,
        };
        let cube = cube.map(|cube| cube.rem_euclid(CELLS as i64) as usize);
        let vertices = self.vertices_at(blocks, &field, name, cube)?;
        self.before.insert(at, field);
        self.share(name, &vertices, u64::MAX);
        Ok(())
    }
}

/// Cell that names a cube: its last corner; -1 is 2^32 - 1.
fn name(block: [u32; 3], cube: [i64; 3]) -> [u32; 3] {
    std::array::from_fn(|axis| (i64::from(block[axis] * SIDE) + cube[axis]) as u32)
}

/// Index of a cube of the block in [`Nets::vertices`].
fn index_of([x, y, z]: [usize; 3]) -> usize {
    (z * CELLS + y) * CELLS + x
}
