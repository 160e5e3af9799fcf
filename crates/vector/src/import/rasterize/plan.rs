//! Plans of trees built from features: a first pass finds their bounding box and values, a second
//! pass reads their shapes.

use std::path::{Path, PathBuf};

use spinney_base::io::{Output, shown};
use spinney_base::space::{Dimension, EdgeRule};
use spinney_base::value::{DataKind, Number, Palette, ValueType};
use spinney_base::{Error, Progress, Result, TreeType};
use spinney_container::Metadata;
use spinney_crs::{CellLocator, Coordinates, Crs, Frame};
use spinney_engine::ops::{Blockwise, ViewSource, WarpGrid, grid_like};
use spinney_engine::store::builder::BuildOptions;
use spinney_engine::store::{build, depth_for};

use super::colours;
use super::edge::{MAX_CELLS, PARTS};
use super::load::Loader;
use super::node_cache::NodeCache;
use super::options::{FeatureGrid, FeatureValue, LineWidth, Overlaps, RasterizeOptions};
use super::shapes::Shapes;
use super::source::{Paint, ShapeTree};
use super::survey::Survey;
use super::values::Values;
use crate::import::feature::{FeatureAttribute, FeatureOptions, FeatureReader, open_features};
use crate::import::zones::invalid_polygons;

/// Features after the first pass, ready to be built into a tree: see [`FeatureImport::build`].
pub struct FeatureImport {
    inputs: Vec<PathBuf>,
    options: RasterizeOptions,
    frame: Frame,
    extent: [u64; 3],
    depth: u8,
    /// Coordinate system of the features.
    crs: Option<Crs>,
    values: Values,
    value_type: ValueType,
    kind: DataKind,
    survey: Survey,
    description: Vec<(&'static str, String)>,
}

/// Features as a tree on the cells of another one.
#[derive(Debug)]
#[non_exhaustive]
pub struct FeatureTree {
    /// The tree.
    pub tree: ViewSource,
    /// Number of features with a geometry and a value.
    pub features: u64,
    /// Number of geometries that extend beyond the raster, where they are clipped.
    pub beyond: u64,
}

/// Shapes as a tree, with the numbers of all geometries, of those that extend beyond its raster,
/// and of those outside of it.
struct LoadedShapes {
    tree: ShapeTree,
    geometries: u64,
    beyond: u64,
    outside: u64,
}

/// Number of features read between checks for cancellation.
const CHECKED: u64 = 256;

/// Memory per vertex in bytes: an edge of 32 bytes, its number in the lists of one node per level
/// down to a block, and spare vector capacity.
const BYTES_EACH: u64 = 96;

/// Runs the first pass over feature files; features of later files are on top.
///
/// # Errors
/// If the options contradict each other, a file cannot be read, has no feature with a geometry and
/// a value, or the features do not fit the cells or the memory; on cancellation.
pub fn plan_features(
    inputs: &[PathBuf],
    options: &RasterizeOptions,
    progress: &dyn Progress,
) -> Result<FeatureImport> {
    options.check()?;
    let (mut values, mut crs) = (Values::default(), options.crs.clone());
    let mut survey = Survey::new();
    let mut first: Option<&Path> = None;
    for input in inputs {
        let mut reader = open_features(input, &feature_options(options))?;
        if options.crs.is_none() {
            let found = &reader.schema().crs;
            match first {
                None => crs.clone_from(found),
                Some(first) => Crs::check_same(
                    (&first.display().to_string(), crs.as_ref()),
                    (&input.display().to_string(), found.as_ref()),
                )?,
            }
            first = first.or(Some(input));
        }
        for number in 1u64.. {
            if number.is_multiple_of(CHECKED) {
                progress.check()?;
            }
            let Some(feature) = reader.next()? else { break };
            survey.add(&feature, &mut values, options)?;
        }
    }
    if let FeatureValue::Attribute(name) = &options.value {
        values.finish(name, options)?;
    }
    let name = inputs.first().cloned().unwrap_or_default();
    if survey.features == 0 || !survey.bounds[0][0].is_finite() {
        let (found, expected) =
            ("no feature with a geometry and a value", "at least one; check layer and conditions");
        return Err(Error::invalid(shown(&name), found, expected));
    }
    let needed = survey.vertices * BYTES_EACH;
    if needed > options.memory / 2 {
        return Err(Error::TooLarge {
            path: name,
            what: format!("geometry with {} vertices", survey.vertices),
            needed: 2 * needed,
            limit: options.memory,
            advice: "allow more memory, or build trees of selected features (--where) and combine them"
                .into(),
        });
    }
    let (frame, extent, depth) = fit(&survey, options, (&name, crs.as_ref()))?;
    let frame = match options.grid {
        FeatureGrid::Like(_) | FeatureGrid::Extended(_) => frame,
        _ => Frame { crs: crs.clone(), ..frame },
    };
    let (value_type, kind) = values.form(options);
    if options.ground.is_none()
        && let Some(rule) = options.rule
    {
        kind.check_rule(rule, &name)?;
    }
    let mut import = FeatureImport {
        inputs: inputs.to_vec(),
        options: options.clone(),
        frame,
        extent,
        depth,
        crs,
        values,
        value_type,
        kind,
        survey,
        description: Vec::new(),
    };
    import.description = import.describe();
    Ok(import)
}

/// Returns the options for reading each file: only the attributes for value and width are read.
fn feature_options(options: &RasterizeOptions) -> FeatureOptions {
    let mut attributes = match &options.value {
        FeatureValue::Number(_) | FeatureValue::Samples(_) => Vec::new(),
        FeatureValue::Attribute(name) => vec![name.clone()],
    };
    if let Some(LineWidth::Attribute(name)) = &options.width {
        attributes.push(name.clone());
    }
    // The system of the files is not used if another one is given, or the grid has none.
    let is_given = match (&options.ground, &options.grid) {
        (Some(ground), _) => ground.coordinates.is_some() || ground.metadata.frame.crs.is_none(),
        (None, FeatureGrid::Like(grid) | FeatureGrid::Extended(grid)) => grid.frame.crs.is_none(),
        (None, FeatureGrid::Cells(_) | FeatureGrid::Cell(_)) => false,
    };
    let check_degrees = options.features.check_degrees && options.crs.is_none() && !is_given;
    let (attributes, memory) = (Some(attributes), options.memory / 2);
    FeatureOptions { attributes, memory, check_degrees, ..options.features.clone() }
}

/// Rejects a cell that is larger than all features if coordinates are in degrees: it was probably
/// meant in metres.
fn check_degrees(cell: f64, [min, max]: [[f64; 2]; 2], (name, crs): (&Path, Option<&Crs>)) -> Result<()> {
    let size = [max[0] - min[0], max[1] - min[1]];
    let longest = size[0].max(size[1]);
    if crs.and_then(Crs::unit) != Some("degrees") || cell <= longest || longest == 0.0 {
        return Ok(());
    }
    /// Number of cells along the longer side in the suggestion.
    const PROPOSED: f64 = 256.0;
    let found = format!("{cell} degrees for features of {:.6} x {:.6} degrees", size[0], size[1]);
    let stem = name.file_stem().unwrap_or_default().to_string_lossy();
    let digits = -((longest / PROPOSED).log10().floor());
    let proposed = (longest / PROPOSED * 10f64.powf(digits)).round() / 10f64.powf(digits);
    let middle = [(min[0] + max[0]) / 2.0, (min[1] + max[1]) / 2.0];
    let expected = format!(
        "a width in degrees, such as --cell {proposed}; for metres, transform the features first: \
         `spinney transform {} warp=EPSG:{} -o {stem}_metres.geojson`",
        name.display(),
        utm_zone(middle)
    );
    Err(Error::invalid("cell width", found, expected))
}

/// Returns the EPSG code of the UTM zone (WGS 84) for a longitude and latitude.
fn utm_zone([longitude, latitude]: [f64; 2]) -> u32 {
    let zone = ((longitude + 180.0).rem_euclid(360.0) / 6.0).floor() as u32 + 1;
    zone + if latitude < 0.0 { 32700 } else { 32600 }
}

/// Lays cells over the bounding box of features.
fn fit(
    survey: &Survey,
    options: &RasterizeOptions,
    (name, crs): (&Path, Option<&Crs>),
) -> Result<(Frame, [u64; 3], u8)> {
    let [min, max] = survey.bounds;
    let size = [max[0] - min[0], max[1] - min[1]];
    let most = 1u64 << Dimension::Quad.max_depth();
    /// Fraction of a cell by which a box may exceed it due to rounding of decimals, as in 0.1 * 3;
    /// the same as for solids.
    const TOUCH: f64 = 1e-6;
    let (cell, origin) = match &options.grid {
        FeatureGrid::Like(grid) => {
            let depth = options.depth.unwrap_or(depth_for(grid.extent).max(1));
            return Ok((grid.frame.clone(), grid.extent, depth));
        }
        FeatureGrid::Extended(grid) => {
            /// Subdivisions of each side of the box, for transforming it to another coordinate
            /// system.
            const PARTS: u64 = 256;
            let side = |axis: usize| {
                let least = f64::EPSILON * min[axis].abs().max(max[axis].abs()).max(1.0);
                size[axis].max(least) / PARTS as f64
            };
            let frame = Frame::planar([side(0), 0.0, min[0], 0.0, -side(1), max[1]]);
            // If the grid's coordinate system is unknown, features are in its coordinates.
            let crs = grid.frame.crs.as_ref().map(|own| crs.unwrap_or(own).clone());
            let frame = Frame { crs, ..frame };
            let own = WarpGrid { frame, extent: [PARTS, PARTS, 1] };
            let WarpGrid { frame, extent } =
                grid_like(("the grid", grid), (&name.display().to_string(), &own), false)?;
            return Ok((frame, extent, options.depth.unwrap_or(depth_for(extent).max(1))));
        }
        FeatureGrid::Cells(cells) => {
            if !(1..=most).contains(cells) {
                let expected = format!("1 to {most} (2^29)");
                return Err(Error::invalid("cells along the longer side", cells.to_string(), expected));
            }
            // A single point has no extent, and gets a cell of size 1.
            let longest = size[0].max(size[1]);
            let cell = if longest > 0.0 { longest / *cells as f64 } else { 1.0 };
            (cell, [min[0], max[1]])
        }
        FeatureGrid::Cell(cell) => {
            if !(cell.is_finite() && *cell > 0.0) {
                return Err(Error::invalid("cell width", cell.to_string(), "a number above zero"));
            }
            check_degrees(*cell, survey.bounds, (name, crs))?;
            (*cell, [(min[0] / cell + TOUCH).floor() * cell, (max[1] / cell - TOUCH).ceil() * cell])
        }
    };
    let reach = [max[0] - origin[0], origin[1] - min[1]];
    let extent = reach.map(|reach| (reach / cell - TOUCH).ceil().clamp(1.0, 1e18) as u64);
    if let Some(cells) = extent.iter().find(|cells| **cells > most) {
        let found = format!("{cell:e}, which gives {cells} cells along an axis");
        return Err(Error::invalid("cell width", found, format!("at most {most} (2^29) cells")));
    }
    // A point on the right or lower side is in an additional cell.
    let frame = Frame::planar([cell, 0.0, origin[0], 0.0, -cell, origin[1]]);
    let extent = [extent[0], extent[1], 1];
    Ok((frame, extent, options.depth.unwrap_or(depth_for(extent).max(1))))
}

impl FeatureImport {
    /// Returns the description of the plan: pairs of heading and text.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    fn describe(&self) -> Vec<(&'static str, String)> {
        let Survey { features, empty, valueless, vertices, .. } = &self.survey;
        let mut lines: Vec<(&'static str, String)> =
            self.inputs.iter().take(20).map(|input| ("input", input.display().to_string())).collect();
        lines.push(("features", format!("{features} with {vertices} vertices")));
        for (count, what) in [(empty, "no geometry"), (valueless, "no value")] {
            if *count > 0 {
                lines.push(("left out", format!("{count} features with {what}")));
            }
        }
        let [width, height, _] = self.extent;
        lines.push(("size", format!("{width} x {height} cells in a tree of depth {}", self.depth)));
        lines.push(("CRS", self.frame.crs.as_ref().map_or("none".into(), Crs::to_string)));
        lines.push(("values", format!("{} ({})", self.value_type, self.kind)));
        let edge = match self.options.edge {
            _ if self.options.fractions => "shares of cells",
            EdgeRule::Centre => "cells whose centre is inside",
            EdgeRule::Touch => "cells that features touch",
            EdgeRule::Area => "cells by the largest share",
        };
        lines.push(("fill", edge.into()));
        lines
    }

    /// Builds the tree.
    ///
    /// # Errors
    /// If a file cannot be read or has changed, the output cannot be written, or on cancellation.
    /// In these cases there is no output.
    pub fn build(self, output: Output, progress: &dyn Progress) -> Result<()> {
        let depth = self.depth;
        if self.extent.iter().any(|cells| *cells > 1 << depth) {
            let expected = format!("at least {} for this extent", depth_for(self.extent));
            return Err(Error::invalid("depth", depth.to_string(), expected));
        }
        let tree = self.load(progress)?.tree;
        let metadata = Metadata {
            frame: self.frame.clone(),
            palette: self.palette(),
            class_names: self.values.class_names().collect(),
            provenance: self.inputs.iter().map(|input| self.provenance(input)).collect(),
            ..Metadata::default()
        };
        let RasterizeOptions { rule, memory, share, time, packing, .. } = &self.options;
        let used = self.survey.vertices * BYTES_EACH;
        let options = BuildOptions::new(self.kind, depth)
            .rule(rule.unwrap_or(self.kind.default_rule()))
            .memory(memory.saturating_sub(used).max(memory / 4))
            .metadata(metadata.clone())
            .share(*share)
            .time(*time)
            .packing(*packing);
        let header = options.header(TreeType::new(Dimension::Quad, self.value_type), self.extent)?;
        let tree = Blockwise::new(Box::new(tree), &self.inputs[0], header, metadata);
        build(&tree, self.extent, &options, output, progress).map(|_| ())
    }

    /// Returns the colours of the classes from string attributes, if cells contain classes.
    fn palette(&self) -> Option<Palette> {
        let has_classes = self.kind == DataKind::Categorical
            && !self.options.fractions
            && !self.options.overlaps.is_computed();
        colours::palette(if has_classes { self.values.class_names().count() } else { 0 })
    }

    /// Creates a lazily painted tree of the features, on the cells of the one that they are laid
    /// over: see [`RasterizeOptions::over`]. In an octree, features are columns of cells.
    ///
    /// # Errors
    /// If a file cannot be read or has changed, or on cancellation.
    ///
    /// # Panics
    /// If the options are not those of [`RasterizeOptions::over`].
    pub fn tree(&self, progress: &dyn Progress) -> Result<FeatureTree> {
        let ground = self.options.ground.as_ref().expect("options for features over a tree");
        let LoadedShapes { tree, geometries, beyond, outside } = self.load(progress)?;
        if outside == geometries {
            progress.warn(&self.inputs[0], "all features are outside the tree");
        }
        let tree =
            Blockwise::new(Box::new(tree), &self.inputs[0], ground.header.clone(), ground.metadata.clone());
        Ok(FeatureTree { tree: tree.into(), features: self.survey.features, beyond })
    }

    fn provenance(&self, input: &Path) -> String {
        let value = match &self.options.value {
            _ if self.options.fractions => "shares of cells".into(),
            FeatureValue::Number(number) => number.to_string(),
            FeatureValue::Attribute(name) => format!("`{name}`"),
            FeatureValue::Samples(numbers) => format!("{numbers:?}"),
        };
        format!("features of {}: {value}, {}, {}", input.display(), self.options.edge, self.options.overlaps)
    }

    /// Reads all shapes.
    fn load(&self, progress: &dyn Progress) -> Result<LoadedShapes> {
        let own = self.crs.clone().map_or(Coordinates::World, Coordinates::System);
        let own = if self.frame.crs.is_none() { Coordinates::World } else { own };
        let requested = self.options.ground.as_ref().and_then(|ground| ground.coordinates.clone());
        let coordinates = requested.unwrap_or(own);
        let locator = CellLocator::new(&coordinates, &self.frame, self.extent)?;
        locator.remarks().iter().for_each(|remark| progress.warn(&self.inputs[0], remark));
        let mut loader = Loader::new(locator, self.extent);
        for input in &self.inputs {
            let mut reader = open_features(input, &feature_options(&self.options))?;
            self.load_file(input, &mut *reader, &mut loader, progress)?;
        }
        if loader.lost > 0 {
            progress.warn(
                &self.inputs[0],
                &format!("{} vertices have no position in the tree's coordinate system", loader.lost),
            );
        }
        if loader.invalid > 0 {
            progress.warn(&self.inputs[0], &invalid_polygons(loader.invalid));
        }
        let Loader { mut shapes, values, beyond, outside, .. } = loader;
        let geometries = values.len() as u64;
        self.sort(&mut shapes, &values);
        let paint = match self.options.overlaps {
            _ if self.options.fractions => Paint::Share,
            _ if self.options.edge == EdgeRule::Area => Paint::LargestShare,
            Overlaps::Sum => Paint::Sum,
            Overlaps::Count => Paint::Count,
            Overlaps::Mean => Paint::Mean,
            Overlaps::Last | Overlaps::First | Overlaps::Min | Overlaps::Max => Paint::Top,
        };
        let (value_type, extent, depth) = (self.value_type, self.extent, self.depth);
        let node_cache = NodeCache::new((self.options.memory / 8) as usize);
        let fixed = match &self.options.value {
            FeatureValue::Samples(numbers) => Some(value_type.nearest_numbers(|channel| numbers[channel])),
            _ => None,
        };
        let edge = self.options.edge;
        shapes.centres_alone = paint.needs_centres_alone(edge);
        let dimension =
            self.options.ground.as_ref().map_or(Dimension::Quad, |ground| ground.header.form.dimension);
        let tree = ShapeTree {
            shapes,
            values,
            value_type,
            fixed,
            paint,
            edge,
            dimension,
            extent,
            depth,
            node_cache,
        };
        Ok(LoadedShapes { tree, geometries, beyond, outside })
    }

    fn load_file(
        &self,
        input: &Path,
        reader: &mut dyn FeatureReader,
        loader: &mut Loader,
        progress: &dyn Progress,
    ) -> Result<()> {
        let mut number = 0u64;
        while let Some(feature) = reader.next()? {
            number += 1;
            if number.is_multiple_of(CHECKED) {
                progress.check()?;
            }
            let Some(geometry) = &feature.geometry else { continue };
            let value = match &self.options.value {
                FeatureValue::Number(number) => Some(*number),
                FeatureValue::Samples(_) => Some(Number::default()),
                FeatureValue::Attribute(_) => {
                    let attribute = feature.attributes.first().unwrap_or(&FeatureAttribute::None);
                    let found = self.values.number(attribute);
                    if found.is_none()
                        && matches!(attribute, FeatureAttribute::Text(_) | FeatureAttribute::Json(_))
                    {
                        return Err(Error::Changed { path: input.into(), what: "was overwritten" });
                    }
                    found
                }
            };
            let Some(value) = value else { continue };
            loader.values.push(value);
            let name = || format!("{}: feature {number}", shown(input));
            let wrong = |found: String| Error::invalid(name(), found, "a line width of zero or more");
            let radius = self
                .options
                .half_width(&feature)
                .map_err(wrong)?
                .map(|half| self.radius(half))
                .transpose()?;
            let far = |found: String| Error::invalid(name(), found, "coordinates near the cells");
            loader.add(geometry, radius).map_err(far)?;
            if loader.shapes.edges.len() as u64 > 2 * self.survey.vertices + (1 << 20)
                && !matches!(self.options.grid, FeatureGrid::Like(_) | FeatureGrid::Extended(_))
            {
                return Err(Error::Changed { path: input.into(), what: "was overwritten" });
            }
        }
        Ok(())
    }

    /// Converts half a width to grid units.
    fn radius(&self, half: f64) -> Result<i64> {
        let [[a, b, ..], [c, d, ..], _] = self.frame.matrix;
        let (side, other) = (a.hypot(c), b.hypot(d));
        const ROUNDING: f64 = 1e-9;
        if (side - other).abs() > ROUNDING * side || (a * b + c * d).abs() > ROUNDING * side * other {
            let expected = "square cells, which line widths require";
            return Err(Error::invalid("width", "one for cells that are not square", expected));
        }
        let cells = half / side;
        if cells > MAX_CELLS / 4.0 {
            return Err(Error::invalid("width", format!("{:e} cells", 2.0 * cells), "a smaller width"));
        }
        Ok((cells * PARTS as f64).round() as i64)
    }

    /// Sorts shapes; the last one is on top.
    fn sort(&self, shapes: &mut Shapes, values: &[Number]) {
        let by_value = |shapes: &mut Shapes, is_rising: bool| {
            shapes.shapes.sort_by(|a, b| {
                let order = values[a.value as usize].cmp(&values[b.value as usize]);
                if is_rising { order } else { order.reverse() }
            });
        };
        match self.options.overlaps {
            _ if self.options.edge == EdgeRule::Area && !self.options.fractions => by_value(shapes, true),
            Overlaps::First => shapes.shapes.reverse(),
            Overlaps::Min => by_value(shapes, false),
            Overlaps::Max => by_value(shapes, true),
            Overlaps::Last | Overlaps::Sum | Overlaps::Count | Overlaps::Mean => {}
        }
    }
}
