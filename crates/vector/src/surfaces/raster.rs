//! Triangulated surfaces as rasters.

use spinney_base::io::Output;
use spinney_base::space::{Bounds, Dimension};
use spinney_base::value::{DataKind, Rule, SampleType, ValueType};
use spinney_base::{Error, Progress, Result, TreeType};
use spinney_container::Metadata;
use spinney_crs::{Crs, Frame};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::Relief;
use spinney_engine::store::{BuildOptions, Packing, Slab, Slabs, build_slabs, depth_for};
use spinney_tin::{HeightGrid, Tin};

/// Reads the first channel of a quadtree's level as heights.
///
/// # Errors
/// If it is an octree, categorical, or corrupt, the level does not exist, or the cells do not fit
/// into memory.
pub fn read_heights(tree: &Dataset, level: u8) -> Result<HeightGrid> {
    if tree.header().form.axes() != 2 {
        let advice = "triangulate a raster, or make isosurfaces of octrees with `spinney contours`";
        return Err(Error::unsupported(tree.name(), "an octree", advice));
    }
    tree.check_continuous("a surface")?;
    let coarser = tree.depth().saturating_sub(level);
    let [columns, rows, _] = tree.extent_at(level).max;
    let [across, down, _] = tree.metadata().frame.coarser(coarser).matrix;
    let transform = [across[0], across[1], across[3], down[0], down[1], down[3]];
    let mut grid = HeightGrid::new([columns, rows].map(|cells| cells as usize), transform)?;
    let bounds = Bounds { min: [0; 3], max: [columns, rows, 1] };
    grid.heights = tree.relief(level).numbers(&bounds)?;
    Ok(grid)
}

/// Number of rows yielded at a time, equal to the side of a block.
const ROWS: usize = 256;

/// Rows of a grid, many at a time.
struct Rows<'a> {
    grid: &'a HeightGrid,
    next: usize,
    progress: &'a dyn Progress,
}

impl Slabs for Rows<'_> {
    fn extent(&self) -> [u64; 3] {
        [self.grid.columns as u64, self.grid.rows as u64, 1]
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        self.progress.check()?;
        let (first, columns) = (self.next, self.grid.columns);
        let end = (first + ROWS).min(self.grid.rows);
        if first == end {
            return Ok(false);
        }
        let heights = &self.grid.heights[first * columns..end * columns];
        slab.origin = [0, first as u64, 0];
        slab.size = [columns as u64, (end - first) as u64, 1];
        slab.bytes.clear();
        for height in heights {
            let height = if height.is_nan() { 0.0 } else { *height as f32 };
            slab.bytes.extend_from_slice(&height.to_le_bytes());
        }
        slab.valid = Some(heights.iter().map(|height| !height.is_nan()).collect());
        self.next = end;
        Ok(true)
    }
}

/// Parameters of a surface raster.
#[derive(Clone, Debug)]
pub struct SurfaceRaster {
    /// Cell width.
    pub cell: f64,
    /// Name of the band.
    pub name: String,
    /// Coordinate system of the surface.
    pub crs: Option<Crs>,
    /// Line for the provenance.
    pub provenance: String,
    /// Memory limit in bytes.
    pub memory: u64,
    /// Codec of the file.
    pub packing: Packing,
}

/// Writes a surface as an f32 quadtree. Values are the heights at cell centres, linear within
/// triangles; VOID outside the surface. North is up, and cell borders are at multiples of the cell
/// width. The raster is held in memory. Returns columns and rows.
///
/// # Errors
/// If the width is not a positive number, there are too many cells, the output cannot be written,
/// or on cancellation.
pub fn write_surface(
    tin: &Tin,
    raster: SurfaceRaster,
    output: Output,
    progress: &dyn Progress,
) -> Result<[u64; 2]> {
    let SurfaceRaster { cell, name, crs, provenance, memory, packing } = raster;
    if !(cell > 0.0 && cell.is_finite()) {
        return Err(Error::invalid("cell width", cell.to_string(), "a number above zero"));
    }
    let mut ends = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for [x, y, _] in tin.vertices() {
        ends = [[ends[0][0].min(x), ends[0][1].min(y)], [ends[1][0].max(x), ends[1][1].max(y)]];
    }
    let [[west, south], [east, north]] = ends;
    let (west, north) = ((west / cell).floor() * cell, (north / cell).ceil() * cell);
    // The casts saturate, and the grid then reports that it is too large.
    let size =
        [((east - west) / cell).ceil().max(1.0) as usize, ((north - south) / cell).ceil().max(1.0) as usize];
    let transform = [cell, 0.0, west, 0.0, -cell, north];
    let mut grid = HeightGrid::new(size, transform)?;
    tin.fill(&mut grid);
    let extent = [size[0] as u64, size[1] as u64, 1];
    let mut frame = Frame::planar(transform);
    frame.crs = crs;
    let metadata =
        Metadata { frame, band_names: vec![name], provenance: vec![provenance], ..Metadata::default() };
    let options = BuildOptions::new(DataKind::Continuous, depth_for(extent))
        .rule(Rule::Mean)
        .memory(memory)
        .metadata(metadata)
        .packing(packing);
    let mut rows = Rows { grid: &grid, next: 0, progress };
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::F32, 1));
    build_slabs(form, &mut rows, None, &options, output, progress)?;
    Ok([extent[0], extent[1]])
}
