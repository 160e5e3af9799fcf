//! Solids interpolated by shape between outlines at given heights.

mod outline;
mod read;

use std::path::Path;

use self::read::{Section, read_sections};
use crate::linear::{Limits, Linear};
use crate::plan::{ReconstructionImport, check};
use crate::source::{Bits, Block, BlockState, Solid};
use spinney_base::{Error, Result};
use spinney_mesh::import::{SolidOptions, fit_cells};
use spinney_vector::import::feature::FeatureOptions;

/// Number of cells along a side of a block whose columns are evaluated at once.
const ALONG: usize = 8;

/// Reads polygons with a height attribute, and plans the octree of the solid whose sections they
/// are. Polygons of the same height are united. Between two heights, a cell is inside if the signed
/// distance of its centre from both outlines (positive inside), interpolated linearly in the
/// height, is positive (shape-based interpolation: S. P. Raya, J. K. Udupa, *Shape-based
/// interpolation of multidimensional objects*, 1990). Cells above the highest and below the lowest
/// outline are VOID. Outlines are held in memory, in up to half of the memory limit of the options.
///
/// ```
/// use spinney::import::mesh::{Resolution, SolidOptions};
/// use spinney::Output;
/// use spinney::raw::reconstruction::plan_outlines;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = |name: &str| directory.path().join(name);
/// // Nearly the frustum of a pyramid, whose volume is 28: its edges are rounded, because the
/// // contours of equal distance around corners are round.
/// let square = |half: f64| format!("\"POLYGON ((-{half} -{half}, {half} -{half}, {half} {half}, -{half} {half}, -{half} -{half}))\"");
/// std::fs::write(path("outlines.csv"), format!("wkt,z\n{},0\n{},3\n", square(2.0), square(1.0))).unwrap();
/// let mut options = SolidOptions::new();
/// options.resolution = Resolution::Cells(64);
/// let import = plan_outlines(&path("outlines.csv"), "z", &Default::default(), &options)?;
/// let cells = import.build(Output::create(&path("frustum.goblin"))?, &())?;
/// let volume = cells as f64 * (4.0f64 / 64.0).powi(3);
/// assert!((27.0..28.0).contains(&volume));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the file cannot be read or has features that are not polygons; if there are fewer than two
/// heights, or the polygons of one have no area; if the options are not supported or the memory
/// limit is too low.
pub fn plan_outlines(
    path: &Path,
    height: &str,
    features: &FeatureOptions,
    options: &SolidOptions,
) -> Result<ReconstructionImport> {
    check(path, options)?;
    let check_degrees = features.check_degrees && options.crs.is_none();
    let features = FeatureOptions { check_degrees, ..features.clone() };
    let found = read_sections(path, height, &features, options.memory / 2)?;
    let (Some(lowest), Some(highest)) = (found.sections.first(), found.sections.last()) else {
        return Err(without_heights(path, height, 0));
    };
    if found.sections.len() < 2 {
        return Err(without_heights(path, height, found.sections.len()));
    }
    let [[west, south], [east, north]] = found.bounds;
    let [low, high] = [lowest.height, highest.height];
    let bounds = [[west, south, low], [east, north, high]];
    let cells = fit_cells(bounds, options)?;
    let frame = &cells.frame.matrix;
    let along = f64::from(1u32 << cells.depth);
    let sides: u64 = found.sections.iter().map(|section| section.sides).sum();
    let without = match found.without {
        0 => String::new(),
        count => format!("; {count} features without a height or without vertices are left out"),
    };
    let input_description = vec![
        ("input", path.display().to_string()),
        (
            "outlines",
            format!("at {} heights from {low} to {high}, {sides} sides{without}", found.sections.len()),
        ),
        ("fill", "between outlines, by the distances from both: cells by their centres".into()),
    ];
    let provenance = format!("{}: outlines at heights {height}", path.display());
    let [x, y, z] =
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| Linear::new(axis, 0.0, frame, along));
    let solid = Sections { limits: Limits::new(bounds, frame, along), sections: found.sections, x, y, z };
    Ok(ReconstructionImport::new(
        Box::new(solid),
        cells,
        options.clone(),
        (found.crs, provenance, input_description),
    ))
}

fn without_heights(path: &Path, height: &str, count: usize) -> Error {
    let found = format!("outlines at {count} heights (attribute `{height}`)");
    Error::invalid(path.display().to_string(), found, "at least two heights: the solid is between them")
}

/// Outlines at heights, from the lowest to the highest.
struct Sections {
    limits: Limits,
    sections: Vec<Section>,
    x: Linear,
    y: Linear,
    z: Linear,
}

impl Sections {
    /// Returns the index of the last outline at or below a height that has a next one above.
    fn below(&self, height: f64) -> usize {
        let above = self.sections.partition_point(|section| section.height <= height);
        above.clamp(1, self.sections.len() - 1) - 1
    }

    /// Interpolates linearly at a height between the values at two outlines, the lower of which is
    /// `below`.
    fn between(&self, below: usize, height: f64, [low, high]: [f64; 2]) -> f64 {
        let [from, to] = [0, 1].map(|next| self.sections[below + next].height);
        (low * (to - height) + high * (height - from)) / (to - from)
    }

    /// Whether a world position between the lowest and the highest outline is inside.
    fn has(&self, [x, y, z]: [f64; 3]) -> bool {
        let below = self.below(z);
        let distances = [0, 1].map(|next| self.sections[below + next].outline.signed_distance([x, y]));
        self.between(below, z, distances) > 0.0
    }

    /// Whether each world axis is parallel to the corresponding axis of the cells, so that all
    /// cells of a column have the same x and y.
    fn is_upright(&self) -> bool {
        [&self.x, &self.y, &self.z].into_iter().enumerate().all(|(axis, linear)| linear.is_along(axis))
    }
}

impl Solid for Sections {
    fn input_count(&self) -> u32 {
        0
    }

    fn classify(&self, block: Block, _: &[u32], _: &mut Vec<u32>) -> BlockState {
        let state = self.limits.classify(block);
        if state == BlockState::Void {
            return state;
        }
        let centre = block.centre();
        let [x, y] = [self.x.at(centre), self.y.at(centre)];
        // (A distance function is 1-Lipschitz: it changes by at most the distance moved.)
        let reach = (self.x.reach(block) + self.x.slack).hypot(self.y.reach(block) + self.y.slack);
        let [low, high] = [0, self.sections.len() - 1].map(|end| self.sections[end].height);
        let [from, to] = self.z.range(block).map(|height| height.clamp(low, high));
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        let (first, last) = (self.below(from), self.below(to));
        let mut lower = self.sections[first].outline.signed_distance([x, y]);
        let mut rounding = 0.0f64;
        for below in first..=last {
            let upper = self.sections[below + 1].outline.signed_distance([x, y]);
            // Between two outlines values are linear in the height, so the extremes are at the
            // ends.
            let ends = [0, 1].map(|next| self.sections[below + next].height.clamp(from, to));
            for height in ends {
                let value = self.between(below, height, [lower, upper]);
                (least, most) = (least.min(value), most.max(value));
            }
            rounding = rounding.max(lower.abs().max(upper.abs()) / (1u64 << 44) as f64);
            if least <= reach + rounding && most >= -reach - rounding {
                return BlockState::Mixed;
            }
            lower = upper;
        }
        let reach = reach + rounding;
        match state {
            _ if most < -reach => BlockState::Void,
            BlockState::Full if least > reach => BlockState::Full,
            _ => BlockState::Mixed,
        }
    }

    fn cells(&self, block: Block, _: &[u32]) -> Bits {
        if !self.is_upright() {
            return Bits::of(block.width, &mut |position| {
                let centre = block.cell(position);
                self.limits.has(centre) && self.has([self.x.at(centre), self.y.at(centre), self.z.at(centre)])
            });
        }
        // Cache of the distances of all columns from the last two outlines. (Cells are visited by
        // height.)
        let mut known: [Option<(usize, Columns)>; 2] = [None, None];
        let mut columns = |number: usize| -> Columns {
            if let Some((_, columns)) = known[number % 2].as_ref().filter(|(own, _)| *own == number) {
                return *columns;
            }
            let columns = self.columns(block, number);
            known[number % 2] = Some((number, columns));
            columns
        };
        let mut layer: Option<(u32, usize, [Columns; 2])> = None;
        Bits::of(block.width, &mut |position| {
            let centre = block.cell(position);
            if !self.limits.has(centre) {
                return false;
            }
            let [x, y, z] = position;
            let height = self.z.at(centre);
            if layer.as_ref().is_none_or(|(own, ..)| *own != z) {
                let below = self.below(height);
                layer = Some((z, below, [columns(below), columns(below + 1)]));
            }
            layer.as_ref().is_some_and(|(_, below, columns)| {
                let distances = [0, 1].map(|end| columns[end][y as usize][x as usize]);
                self.between(*below, height, distances) > 0.0
            })
        })
    }
}

/// Distances of a block's columns from an outline, by rows.
type Columns = [[f64; ALONG]; ALONG];

impl Sections {
    /// Computes the distances of a block's columns from an outline.
    fn columns(&self, block: Block, number: usize) -> Columns {
        let outline = &self.sections[number].outline;
        let mut found = [[0.0; ALONG]; ALONG];
        for (y, row) in (0..block.width).zip(&mut found) {
            for (x, distance) in (0..block.width).zip(row) {
                let centre = block.cell([x, y, 0]);
                *distance = outline.signed_distance([self.x.at(centre), self.y.at(centre)]);
            }
        }
        found
    }
}
