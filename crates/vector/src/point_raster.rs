//! Rasterization of point trees, by statistics of the points in each cell.

use std::str::FromStr;

use spinney_base::io::Output;
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::{DataKind, Rule, SampleType, ValueType};
use spinney_base::{Error, Progress, Result, SilentProgress, TreeType};
use spinney_container::Metadata;
use spinney_crs::Frame;
use spinney_engine::store::{BuildOptions, Packing, Slab, Slabs, build_slabs, depth_for};
use spinney_points::{PointCondition, PointRegion, PointTree, Selection, attribute_index};

/// Rule for a cell's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellRule {
    /// Minimum.
    Min,
    /// Maximum.
    Max,
    /// Mean.
    Mean,
    /// Number of points.
    Count,
}

impl CellRule {
    const ALL: [CellRule; 4] = [CellRule::Min, CellRule::Max, CellRule::Mean, CellRule::Count];

    /// Returns the rule's name.
    pub fn name(self) -> &'static str {
        ["min", "max", "mean", "count"][self as usize]
    }
}

impl FromStr for CellRule {
    type Err = Error;

    fn from_str(name: &str) -> Result<CellRule> {
        let found = CellRule::ALL.into_iter().find(|rule| rule.name() == name);
        found.ok_or_else(|| Error::invalid("raster", format!("`{name}`"), "min, max, mean or count"))
    }
}

/// Raster of points.
#[derive(Clone, Debug)]
pub struct PointRaster {
    /// Rule for cells.
    pub rule: CellRule,
    /// Cell width, in units of the points' coordinates.
    pub cell: f64,
    /// Name of the attribute; `None` for z.
    pub attribute: Option<String>,
    /// Conditions on points.
    pub conditions: Vec<PointCondition>,
}

/// Parses an operation of `transform`: `mean,cell=1` or `max,cell=0.5,attribute=intensity`.
impl FromStr for PointRaster {
    type Err = Error;

    fn from_str(text: &str) -> Result<PointRaster> {
        let wrong = |found: &str| {
            let expected = "min, max, mean or count, and the cell width: mean,cell=1; append ,attribute=NAME to use an attribute instead of z";
            Error::invalid("raster", format!("`{found}`"), expected)
        };
        let mut parts = text.split(',').map(str::trim);
        let rule = parts.next().unwrap_or_default().parse()?;
        let (mut cell, mut attribute) = (None, None);
        for part in parts {
            match part.split_once('=') {
                Some(("cell", width)) => {
                    cell = width.parse().ok().filter(|width: &f64| *width > 0.0 && width.is_finite())
                }
                Some(("attribute", name)) if !name.is_empty() => attribute = Some(name.to_string()),
                _ => return Err(wrong(part)),
            }
        }
        let cell = cell.ok_or_else(|| wrong(text))?;
        Ok(PointRaster { rule, cell, attribute, conditions: Vec::new() })
    }
}

/// Cells of the raster. North is up, and cell borders are at multiples of the cell width.
struct Grid {
    west: f64,
    north: f64,
    cell: f64,
    columns: u64,
    rows: u64,
}

impl Grid {
    fn new(tree: &PointTree, cell: f64) -> Result<Grid> {
        let statistics = tree.statistics(&Selection::default(), &())?;
        let ends = |axis: usize| statistics.columns[axis].map_or((0.0, 0.0), |found| (found.min, found.max));
        let ((least_x, most_x), (least_y, most_y)) = (ends(0), ends(1));
        let west = (least_x / cell).floor() * cell;
        let north = (most_y / cell).ceil() * cell;
        let mut grid = Grid { west, north, cell, columns: 0, rows: 0 };
        let (Some(column), Some(row)) = (grid.column(most_x), grid.row(least_y)) else {
            let found = format!("{cell} for points from {least_x},{least_y} to {most_x},{most_y}");
            return Err(Error::invalid(
                "cell width",
                found,
                "a width that gives at most 2^29 cells per axis",
            ));
        };
        (grid.columns, grid.rows) = (column + 1, row + 1);
        Ok(grid)
    }

    fn column(&self, x: f64) -> Option<u64> {
        whole((x - self.west) / self.cell)
    }

    fn row(&self, y: f64) -> Option<u64> {
        whole((self.north - y) / self.cell)
    }
}

/// Converts a number of cells to an integer; `None` beyond the maximum of a tree. Values below 0,
/// due to rounding, become 0.
fn whole(cells: f64) -> Option<u64> {
    (cells < (1u64 << Dimension::Quad.max_depth()) as f64).then_some(cells.max(0.0) as u64)
}

/// Maximum number of levels of a block that is computed at a time.
const SIDE: u8 = 10;

/// The raster, block by block.
struct Blocks<'a> {
    tree: &'a PointTree,
    raster: &'a PointRaster,
    grid: Grid,
    /// Index of the attribute; `None` for z.
    attribute: Option<usize>,
    sample: SampleType,
    depth: u8,
    /// Nodes to be visited, in reverse order.
    open: Vec<Code>,
    progress: &'a dyn Progress,
}

impl Slabs for Blocks<'_> {
    fn extent(&self) -> [u64; 3] {
        [self.grid.columns, self.grid.rows, 1]
    }

    fn are_in_order(&self) -> bool {
        true
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let extent = Bounds { min: [0; 3], max: self.extent() };
        while let Some(code) = self.open.pop() {
            let bounds = code.bounds(self.depth).intersect(&extent);
            if bounds.is_empty() {
                continue;
            }
            if code.level() + SIDE < self.depth {
                self.open.extend((0..4).rev().map(|child| code.child(child)));
                continue;
            }
            self.fill(&bounds, slab)?;
            return Ok(true);
        }
        Ok(false)
    }
}

impl Blocks<'_> {
    /// Computes the cells of a box.
    fn fill(&self, bounds: &Bounds, slab: &mut Slab) -> Result<()> {
        let size = bounds.size();
        let cells = (size[0] * size[1]) as usize;
        let (mut counts, mut numbers) = (vec![0u32; cells], vec![0f64; cells]);
        let Grid { west, north, cell, .. } = self.grid;
        // The selection is half a cell larger on all sides, so that rounding loses no point; the
        // exact column and row decide.
        let x = |column: u64| west + (column as f64) * cell;
        let y = |row: u64| north - (row as f64) * cell;
        let least = [x(bounds.min[0]) - cell / 2.0, y(bounds.max[1]) - cell / 2.0, f64::NEG_INFINITY];
        let most = [x(bounds.max[0]) + cell / 2.0, y(bounds.min[1]) + cell / 2.0, f64::INFINITY];
        let conditions = self.raster.conditions.clone();
        let selection = Selection { region: PointRegion::Box([least, most]), level: None, conditions };
        let wanted: Vec<usize> = self.attribute.into_iter().collect();
        self.tree.select(&selection, Some(&wanted), &SilentProgress(self.progress), &mut |points| {
            for point in 0..points.len() {
                let place = self.tree.grid().to_world(points.position(point));
                let (Some(column), Some(row)) = (self.grid.column(place[0]), self.grid.row(place[1])) else {
                    continue;
                };
                if !(bounds.min[0]..bounds.max[0]).contains(&column)
                    || !(bounds.min[1]..bounds.max[1]).contains(&row)
                {
                    continue;
                }
                let at = ((row - bounds.min[1]) * size[0] + column - bounds.min[0]) as usize;
                let number = self
                    .attribute
                    .map_or(place[2], |attribute| points.quantity(self.tree.attributes(), attribute, point));
                if number.is_nan() {
                    continue;
                }
                let is_first = counts[at] == 0;
                counts[at] = counts[at].saturating_add(1);
                numbers[at] = match self.raster.rule {
                    CellRule::Min if !is_first => numbers[at].min(number),
                    CellRule::Max if !is_first => numbers[at].max(number),
                    CellRule::Min | CellRule::Max => number,
                    CellRule::Mean | CellRule::Count => numbers[at] + number,
                };
            }
            Ok(())
        })?;
        slab.origin = bounds.min;
        slab.size = size;
        slab.bytes.clear();
        for (count, number) in counts.iter().zip(&numbers) {
            let number = if self.raster.rule == CellRule::Mean {
                number / f64::from((*count).max(1))
            } else {
                *number
            };
            match self.sample {
                SampleType::U32 => slab.bytes.extend_from_slice(&count.to_le_bytes()),
                SampleType::F32 => slab.bytes.extend_from_slice(&(number as f32).to_le_bytes()),
                _ => slab.bytes.extend_from_slice(&number.to_le_bytes()),
            }
        }
        slab.valid = Some(counts.iter().map(|count| *count > 0).collect());
        Ok(())
    }
}

/// Rasterizes a point tree into a quadtree, by statistics of the points in each cell; cells without
/// points are VOID. Minimum, maximum and mean are f32 for z, f32 attributes and attributes of at
/// most 16 bits, and f64 for others; counts are u32. Coarser levels store means, also of counts.
/// Returns columns and rows.
///
/// Takes one pass over the points, some of which are read more than once, and memory for a block of
/// cells.
///
/// # Errors
/// If the attribute does not exist, there are too many cells, the tree is corrupt, or the output
/// cannot be written.
pub fn rasterize_points(
    tree: &PointTree,
    raster: &PointRaster,
    (memory, packing): (u64, Packing),
    output: Output,
    progress: &dyn Progress,
) -> Result<[u64; 2]> {
    let attribute =
        raster.attribute.as_deref().map(|name| attribute_index(tree.attributes(), name)).transpose()?;
    let grid = Grid::new(tree, raster.cell)?;
    let extent = [grid.columns, grid.rows, 1];
    let depth = depth_for(extent);
    let is_small = attribute.is_none_or(|place| {
        let attribute = &tree.attributes()[place];
        attribute.scale_offset.is_none()
            && (attribute.sample.size() <= 2 || attribute.sample == SampleType::F32)
    });
    let sample = match (raster.rule, is_small) {
        (CellRule::Count, _) => SampleType::U32,
        (_, true) => SampleType::F32,
        (_, false) => SampleType::F64,
    };
    let mut frame = Frame::planar([raster.cell, 0.0, grid.west, 0.0, -raster.cell, grid.north]);
    frame.crs = tree.metadata().frame.crs.clone();
    let what = raster.attribute.as_deref().unwrap_or("z");
    let name = match raster.rule {
        CellRule::Count => "count".into(),
        rule => format!("{} of {what}", rule.name()),
    };
    let mut provenance = tree.metadata().provenance.clone();
    provenance.push(format!("raster of points: {name}, cells of {}", raster.cell));
    let tags = tree.metadata().tags.clone();
    let metadata = Metadata { frame, band_names: vec![name], provenance, tags, ..Metadata::default() };
    let options = BuildOptions::new(DataKind::Continuous, depth)
        .rule(Rule::Mean)
        .memory(memory)
        .metadata(metadata)
        .packing(packing);
    let open = vec![Code::root(Dimension::Quad)];
    let mut blocks = Blocks { tree, raster, grid, attribute, sample, depth, open, progress };
    let form = TreeType::new(Dimension::Quad, ValueType::new(sample, 1));
    build_slabs(form, &mut blocks, None, &options, output, progress)?;
    Ok([extent[0], extent[1]])
}
