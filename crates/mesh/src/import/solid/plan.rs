//! Plans of solids: from models and options to the grid of cells.

use std::collections::BTreeSet;
use std::path::Path;

use super::grid::Grid;
use super::inside::Attribute;
use super::survey::SolidSurvey;
use crate::import::Model;
use serde::{Deserialize, Serialize};
use spinney_base::space::EdgeRule;
use spinney_base::space::{Dimension, Up};
use spinney_base::value::{DataKind, Rule};
use spinney_base::{Error, Result};
use spinney_brep::exact::lattice::Lattice;
use spinney_container::{Metadata, Tag};
use spinney_crs::{Crs, Frame};
use spinney_engine::store::{BuildOptions, Packing, depth_for};

/// Default memory in bytes.
pub const DEFAULT_MEMORY: u64 = 256 << 20;

/// Resolution of the cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resolution {
    /// Number of cells along the longest side of the models' bounding box.
    Cells(u64),
    /// Width of the cells, in units of the models. Cell walls are at multiples of it, so that all
    /// trees with one width align.
    Cell(#[serde(with = "spinney_base::text_fields")] f64),
    /// Depth of the tree, which is as wide as the models.
    Depth(u8),
    /// Cells of another tree: its frame and depth.
    #[serde(skip)]
    Like(Frame, u8),
}

/// Options for building a solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct SolidOptions {
    /// Resolution of the cells.
    pub resolution: Resolution,
    /// Rule for the cells that the surface cuts.
    ///
    /// With [`EdgeRule::Area`], closed surfaces are clipped to the cells, which is exact, also
    /// where bodies overlap. Cells with more than 48 faces of opposing orientations are subdivided
    /// into 4 x 4 x 4 subcells, at most twice. Of open surfaces, cells at the edges of holes are
    /// sampled by 4 x 4 x 4 points of the winding field. In cells that several objects fill partly,
    /// the inside of any object counts; this is exact away from holes and inverted faces.
    pub edge: EdgeRule,
    /// Meaning of the cells' values.
    pub attribute: Attribute,
    /// Whether to fill only the cells that the surface cuts, instead of the whole solid.
    pub shell: bool,
    /// Axis of the models that points up; y is rotated to z.
    pub up: Up,
    /// Unit of length of the models' coordinates, stored in the file.
    pub unit: Option<String>,
    /// Coordinate system; by default the models' own.
    pub crs: Option<Crs>,
    /// Total memory in bytes.
    #[serde(skip)]
    pub memory: u64,
    /// Whether equal subtrees are stored once, in Autumnal files.
    #[serde(skip)]
    pub share: bool,
    /// Time of the first commit of an Autumnal file, in seconds since 1970-01-01.
    #[serde(skip)]
    pub time: Option<i64>,
    /// Compression of the file, and the loss that it allows.
    pub packing: Packing,
}

impl Default for SolidOptions {
    fn default() -> Self {
        SolidOptions {
            resolution: Resolution::Cells(256),
            edge: EdgeRule::default(),
            attribute: Attribute::default(),
            shell: false,
            up: Up::default(),
            unit: None,
            crs: None,
            memory: DEFAULT_MEMORY,
            share: false,
            time: None,
            packing: Packing::default(),
        }
    }
}

impl SolidOptions {
    /// A solid whose longest side has 256 cells.
    pub fn new() -> SolidOptions {
        SolidOptions::default()
    }

    /// Whether all cells count that the surface cuts.
    pub(super) fn marks_cut_cells(&self) -> bool {
        self.shell || self.edge == EdgeRule::Touch
    }
}

/// Opened and validated models, ready for building: see [`SolidImport::build`].
pub struct SolidImport {
    pub(super) models: Vec<Box<dyn Model>>,
    pub(super) options: SolidOptions,
    pub(super) grid: Grid,
    pub(super) lattice: Lattice,
    /// Bounding box of the faces.
    pub(super) bounds: [[f64; 3]; 2],
    /// Cells along each axis that can be other than VOID.
    pub(super) extent: [u64; 3],
    /// Parts whose faces count, numbered consecutively over the models; all if `None`.
    pub(super) only: Option<BTreeSet<u32>>,
    /// Object of each part, if objects are other than single parts or files.
    pub(super) objects: Option<Vec<u32>>,
    /// Survey of the whole surface, if only a shard of the tree is built.
    pub(super) survey: Option<SolidSurvey>,
    description: Vec<(&'static str, String)>,
}

impl SolidImport {
    /// Description of the plan: pairs of a heading and its text.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Depth of the tree.
    pub fn depth(&self) -> u8 {
        self.grid.depth
    }
}

/// Plans how the tree of the given models is built. Several models become one solid.
///
/// ```
/// use spinney::import::mesh::{Resolution, SolidOptions, open_all, plan_models};
/// use spinney::Output;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let [model, tree] = ["tetrahedron.off", "tetrahedron.goblin"].map(|name| folder.path().join(name));
/// let text = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
/// std::fs::write(&model, text).unwrap();
/// let mut options = SolidOptions::new();
/// options.resolution = Resolution::Cells(64);
/// plan_models(open_all(&[model], 64 << 20)?, &options)?.build(Output::create(&tree)?, &())?;
/// assert_eq!(spinney::open(&tree)?.depth(), 6);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the options do not fit the models, or if these cannot be read or have no faces. All models
/// are read to determine their bounding box.
pub fn plan_models(mut models: Vec<Box<dyn Model>>, options: &SolidOptions) -> Result<SolidImport> {
    check(&models, options)?;
    let bounds = bounds(&mut models, options.up)?;
    plan_in(models, options, bounds)
}

/// Plans a tree of models whose faces have these bounds.
pub(super) fn plan_in(
    models: Vec<Box<dyn Model>>,
    options: &SolidOptions,
    bounds: [[f64; 3]; 2],
) -> Result<SolidImport> {
    check(&models, options)?;
    let FittedCells { frame, depth, extent } = fit_cells(bounds, options)?;
    let crs = match &options.crs {
        Some(crs) => Some(crs.clone()),
        None => common_crs(&models, frame.crs)?,
    };
    let frame = Frame { crs, ..frame };
    let grid = Grid::new(depth, frame)?;
    let lattice = Lattice::new([0; 3], grid.fraction);
    let description = describe(&models, options, &grid, extent);
    let options = options.clone();
    Ok(SolidImport {
        models,
        options,
        grid,
        lattice,
        bounds,
        extent,
        only: None,
        objects: None,
        survey: None,
        description,
    })
}

/// Fails if the options do not fit the models.
fn check(models: &[Box<dyn Model>], options: &SolidOptions) -> Result<()> {
    let colourless = models.iter().find(|model| !model.info().is_coloured);
    if let (Attribute::Colour, Some(model)) = (options.attribute, colourless) {
        let advice = "omit --attribute colour, or choose --attribute part";
        return Err(Error::unsupported(
            &model.info().path,
            "the attribute colour for a model without colours",
            advice,
        ));
    }
    if options.attribute != Attribute::Occupancy && options.edge == EdgeRule::Area {
        let expected = "touch or centre; cells with colours or part numbers have no fraction";
        return Err(Error::invalid("edge", "area", expected));
    }
    Ok(())
}

/// Common coordinate system of all models, and of the tree to align with.
pub(in crate::import) fn common_crs(models: &[Box<dyn Model>], like: Option<Crs>) -> Result<Option<Crs>> {
    let mut known = like.map(|crs| ("the tree of --grid".to_string(), crs));
    for info in models.iter().map(|model| model.info()) {
        let name = info.path.display().to_string();
        match (&known, &info.crs) {
            (Some((first, crs)), Some(other)) => Crs::check_same((first, Some(crs)), (&name, Some(other)))?,
            (None, Some(crs)) => known = Some((name, crs.clone())),
            // Most formats cannot store a coordinate system; the others' then applies.
            (_, None) => {}
        }
    }
    Ok(known.map(|(_, crs)| crs))
}

/// Bounding box of the faces of all models. Unused vertices are ignored: a distant one would make
/// all cells large.
pub(in crate::import) fn bounds(models: &mut [Box<dyn Model>], up: Up) -> Result<[[f64; 3]; 2]> {
    let mut all = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for model in models.iter_mut() {
        let up = model.info().up(up);
        model.faces(&mut |face| {
            for corner in face.points.iter().map(|corner| up.to_z_up(*corner)) {
                for axis in 0..3 {
                    all[0][axis] = all[0][axis].min(corner[axis]);
                    all[1][axis] = all[1][axis].max(corner[axis]);
                }
            }
            Ok(())
        })?;
    }
    let is_box = (0..3).all(|axis| all[0][axis].is_finite() && all[1][axis].is_finite());
    let name = models.first().map(|model| model.info().path.clone()).unwrap_or_default();
    if !is_box && models.iter().all(|model| model.info().faces == Some(0)) {
        let found = "none: the model is empty, and so has no bounds for cells";
        return Err(Error::invalid(format!("{}: faces", name.display()), found, "a model with faces"));
    }
    if !is_box {
        return Err(Error::corrupt(name, "faces", "none with vertices", "a model with faces"));
    }
    if all[0] == all[1] {
        return Err(Error::corrupt(name, "vertices", "all in one point", "a model with an extent"));
    }
    Ok(all)
}

/// Error of a model whose faces are all points or lines on a grid with this unit.
pub(in crate::import) fn flat_faces(path: &Path, [min, max]: [[f64; 3]; 2], step: f64) -> Error {
    let place = |[x, y, z]: [f64; 3]| format!("{x:e}, {y:e}, {z:e}");
    let found = format!(
        "a model whose faces all collapse to points or lines on the grid (bounds {} to {}, grid unit {step:e})",
        place(min),
        place(max)
    );
    Error::unsupported(path, found, "remove distant outliers, scale the model, or give its faces an area")
}

/// Cells over a model.
pub struct FittedCells {
    /// Frame of the cells.
    pub frame: Frame,
    /// Depth of their tree.
    pub depth: u8,
    /// Cells along each axis that can be other than VOID.
    pub extent: [u64; 3],
}

impl FittedCells {
    /// Options for building a tree of these cells from a solid with known coverage. `provenance`
    /// and `tags` are added to the metadata that the options define.
    pub fn build_options(
        &self,
        options: &SolidOptions,
        provenance: String,
        tags: &[(Tag, &str)],
    ) -> BuildOptions {
        let mut metadata = Metadata { frame: self.frame.clone(), ..Metadata::default() };
        metadata.frame.crs = options.crs.clone().or_else(|| self.frame.crs.clone());
        metadata.provenance = vec![provenance];
        metadata.set_tag(Tag::SolidBoundary, options.edge.name());
        tags.iter().for_each(|(tag, text)| metadata.set_tag(*tag, *text));
        if let Some(unit) = &options.unit {
            metadata.set_tag(Tag::Unit, unit);
        }
        BuildOptions::new(DataKind::Continuous, self.depth)
            .rule(Rule::Occupancy)
            .memory(options.memory / 4)
            .metadata(metadata)
            .share(options.share)
            .time(options.time)
            .packing(options.packing)
    }
}

/// Lays cells over a box.
///
/// # Errors
/// If the options result in too many cells, or in cells that are too small.
pub fn fit_cells([min, max]: [[f64; 3]; 2], options: &SolidOptions) -> Result<FittedCells> {
    let size: [f64; 3] = std::array::from_fn(|axis| max[axis] - min[axis]);
    let longest = size.into_iter().fold(0.0, f64::max);
    let most = 1u64 << Dimension::Oct.max_depth();
    let count = |cells: u64| {
        if (1..=most).contains(&cells) {
            return Ok(cells);
        }
        Err(Error::invalid("cells along the longest side", cells.to_string(), format!("1 to {most} (2^19)")))
    };
    // Protrusions into a cell of less than this fraction of its width count as rounding errors, of
    // decimals in files or of computed coordinates. It is about a unit of the finest grid.
    const TOUCH: f64 = 1e-6;
    // Far from the origin, in cells, the rounding error of cell numbers is larger.
    let touch = |cells: f64| TOUCH.max(cells.abs() * ROUNDINGS * f64::EPSILON);
    const ROUNDINGS: f64 = 4.0;
    // A flat surface in a wall between cells would cut none; it is moved to the middle of its
    // cells.
    let around = |cell: f64| -> [f64; 3] {
        let is_moved = |axis: usize| options.marks_cut_cells() && size[axis] == 0.0;
        std::array::from_fn(|axis| min[axis] - if is_moved(axis) { cell / 2.0 } else { 0.0 })
    };
    let (cell, origin, longest_cells) = match &options.resolution {
        Resolution::Cells(cells) => {
            let cell = longest / count(*cells)? as f64;
            (cell, around(cell), *cells)
        }
        Resolution::Depth(depth) => {
            if !(1..=Dimension::Oct.max_depth()).contains(depth) {
                return Err(Error::invalid("depth", depth.to_string(), "1 to 19 for octrees"));
            }
            let cell = longest / (1u64 << depth) as f64;
            (cell, around(cell), 1 << depth)
        }
        Resolution::Cell(cell) => {
            if !(cell.is_finite() && *cell > 0.0) {
                return Err(Error::invalid("cell", cell.to_string(), "a width above zero"));
            }
            let origin = min.map(|min| (min / cell + touch(min / cell)).floor() * cell);
            let along = |axis: usize| {
                let cells = (max[axis] - origin[axis]) / cell - touch(max[axis] / cell);
                cells.ceil().clamp(1.0, 1e18) as u64
            };
            (*cell, origin, count((0..3).map(along).max().unwrap_or(1))?)
        }
        Resolution::Like(frame, depth) => {
            let extent = [1 << depth; 3];
            return Ok(FittedCells { frame: frame.clone(), depth: *depth, extent });
        }
    };
    let extent = std::array::from_fn(|axis| {
        let cells = (max[axis] - origin[axis]) / cell - touch(max[axis] / cell);
        (cells.ceil().max(1.0) as u64).min(longest_cells)
    });
    let mut frame = Frame::identity();
    for (axis, row) in frame.matrix.iter_mut().enumerate() {
        row[axis] = cell;
        row[3] = origin[axis];
    }
    if !frame.linear().determinant().is_normal() {
        let expected = "a width whose cube double precision can represent; scale the model";
        return Err(Error::invalid("cell width", format!("{cell:e}"), expected));
    }
    Ok(FittedCells { frame, depth: depth_for(extent).max(1), extent })
}

fn describe(
    models: &[Box<dyn Model>],
    options: &SolidOptions,
    grid: &Grid,
    extent: [u64; 3],
) -> Vec<(&'static str, String)> {
    let mut lines = Vec::new();
    for model in models {
        let info = model.info();
        let faces = info.faces.map_or(String::new(), |faces| format!(", {faces} faces"));
        lines.push(("input", format!("{} ({}{faces})", info.path.display(), info.format)));
    }
    let [x, y, z] = extent;
    let cell = grid.frame.matrix.map(|row| row[..3].iter().map(|x| x * x).sum::<f64>().sqrt());
    let cell =
        if cell[0] == cell[1] && cell[1] == cell[2] { format!("{}", cell[0]) } else { format!("{cell:?}") };
    let unit = options.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
    lines.push((
        "cells",
        format!("{x} x {y} x {z} in a tree of depth {}, each {cell}{unit} wide", grid.depth),
    ));
    let what = if options.shell { "the surface" } else { "the solid" };
    let edge = match options.edge {
        _ if options.shell => "cells that it cuts",
        EdgeRule::Touch => "cells inside or cut by the surface",
        EdgeRule::Centre => "cells whose centre is inside",
        EdgeRule::Area => "cells with the fraction that is inside",
    };
    let attribute = match options.attribute {
        Attribute::Occupancy => "",
        Attribute::Colour => ", with colours",
        Attribute::PartNumber => ", with part numbers",
    };
    lines.push(("fill", format!("{what}: {edge}{attribute}")));
    lines
}
