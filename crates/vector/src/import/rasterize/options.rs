//! Options of trees built from features.

use std::fmt;
use std::str::FromStr;

use spinney_base::space::{Dimension, EdgeRule};
use spinney_base::value::{DataKind, Number, Rule, SampleType};
use spinney_base::{Error, Result};
use spinney_container::{Header, Metadata};
use spinney_crs::{Coordinates, Crs, web_mercator};
use spinney_engine::ops::WarpGrid;
use spinney_engine::store::Packing;

use crate::import::feature::{Feature, FeatureAttribute, FeatureOptions};

/// Default memory limit in bytes.
const DEFAULT_MEMORY: u64 = 256 << 20;

/// Cell value of a feature.
#[derive(Clone, Debug, PartialEq)]
pub enum FeatureValue {
    /// One number for all features.
    Number(Number),
    /// Value of an attribute. Strings become named classes, numbered from 1 in alphabetical order;
    /// over a tree, they are names of its classes.
    Attribute(String),
    /// One number per channel of the tree that features are laid over.
    Samples(Vec<Number>),
}

impl Default for FeatureValue {
    fn default() -> FeatureValue {
        FeatureValue::Number(Number::Unsigned(1))
    }
}

impl FromStr for FeatureValue {
    type Err = Error;

    /// Parses a number or an attribute name.
    fn from_str(text: &str) -> Result<FeatureValue> {
        if text.is_empty() {
            return Err(Error::invalid("value", "an empty string", "a number, or the name of an attribute"));
        }
        Ok(text.parse().map_or_else(|_| FeatureValue::Attribute(text.into()), FeatureValue::Number))
    }
}

/// Width of lines, in units of the tree's coordinates.
#[derive(Clone, Debug, PartialEq)]
pub enum LineWidth {
    /// One number for all lines.
    Number(f64),
    /// Value of an attribute. Lines without one, or with 0, cover the cells that contain their
    /// points.
    Attribute(String),
}

impl FromStr for LineWidth {
    type Err = Error;

    /// Parses a number or an attribute name.
    fn from_str(text: &str) -> Result<LineWidth> {
        match text.parse::<f64>() {
            Ok(width) if width.is_finite() && width > 0.0 => Ok(LineWidth::Number(width)),
            Err(_) if !text.is_empty() => Ok(LineWidth::Attribute(text.into())),
            _ => Err(Error::invalid("width", text, "a number above zero, or the name of an attribute")),
        }
    }
}

/// Value of cells where features overlap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overlaps {
    /// Value of the last feature in the file.
    #[default]
    Last,
    /// Value of the first feature in the file.
    First,
    /// Minimum.
    Min,
    /// Maximum.
    Max,
    /// Sum.
    Sum,
    /// Number of features; each point of a multipoint counts.
    Count,
    /// Mean.
    Mean,
}

impl Overlaps {
    const ALL: [(&'static str, Overlaps); 7] = [
        ("last", Overlaps::Last),
        ("first", Overlaps::First),
        ("min", Overlaps::Min),
        ("max", Overlaps::Max),
        ("sum", Overlaps::Sum),
        ("count", Overlaps::Count),
        ("mean", Overlaps::Mean),
    ];

    /// Returns whether the value is computed from all features in a cell.
    pub(super) fn is_computed(self) -> bool {
        matches!(self, Overlaps::Sum | Overlaps::Count | Overlaps::Mean)
    }
}

impl fmt::Display for Overlaps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Overlaps::ALL.iter().find(|(_, own)| own == self).map_or("", |(name, _)| name);
        f.write_str(name)
    }
}

impl FromStr for Overlaps {
    type Err = Error;

    fn from_str(text: &str) -> Result<Overlaps> {
        let found = Overlaps::ALL.iter().find(|(name, _)| *name == text).map(|(_, overlaps)| *overlaps);
        found.ok_or_else(|| Error::invalid("overlaps", text, "last, first, min, max, sum, count or mean"))
    }
}

/// Cell grid of a tree built from features.
#[derive(Clone, Debug, PartialEq)]
pub enum FeatureGrid {
    /// Number of cells along the longer side of the features' bounding box.
    Cells(u64),
    /// Cell width, in units of the features' coordinate system. Cell borders are at its multiples,
    /// so that all trees of one width align.
    Cell(f64),
    /// Cells and extent of another tree, regardless of the features' extent.
    Like(WarpGrid),
    /// Cells of another tree; its extent is extended by that of the features.
    Extended(WarpGrid),
}

impl FeatureGrid {
    /// Returns the cells of web map tiles of 256 x 256 cells, with `zoom` as the deepest.
    ///
    /// # Errors
    /// If a quadtree cannot hold them: the maximum zoom is 21.
    pub fn web_mercator(zoom: u8) -> Result<FeatureGrid> {
        const TILE_LEVELS: u8 = 8;
        let most = Dimension::Quad.max_depth() - TILE_LEVELS;
        if zoom > most {
            return Err(Error::invalid("zoom", zoom.to_string(), format!("0 to {most}")));
        }
        let depth = zoom + TILE_LEVELS;
        let extent = [1 << depth, 1 << depth, 1];
        Ok(FeatureGrid::Like(WarpGrid { frame: web_mercator(depth), extent }))
    }
}

/// Tree that features are laid over.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    pub(super) header: Header,
    pub(super) metadata: Metadata,
    /// Coordinates of the features; `None` for those of their file.
    pub(super) coordinates: Option<Coordinates>,
}

/// Options of a tree built from features.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RasterizeOptions {
    /// Cell value of features.
    pub value: FeatureValue,
    /// Value of cells where features overlap.
    pub overlaps: Overlaps,
    /// Rule for cells at the edges of polygons. [`EdgeRule::Area`] gives each cell the value with
    /// the largest share of it, where nodata counts as a value; overlapping polygons of one value
    /// are united. Lines are in all cells that contain their points.
    pub edge: EdgeRule,
    /// Width of lines: a line covers the cells whose centres are within half of it. `None` for
    /// lines that cover all cells that contain their points.
    pub width: Option<LineWidth>,
    /// Writes the covered share of each cell, from 0 to 1, instead of a value. Overlapping polygons
    /// are united.
    pub fractions: bool,
    /// Cell grid.
    pub grid: FeatureGrid,
    /// Sample type. By default that of the attribute: i32 or i64 for integers, f64 for
    /// floating-point numbers.
    pub sample: Option<SampleType>,
    /// Data kind. By default, strings and a number for all features are categorical; numeric
    /// attributes are continuous.
    pub kind: Option<DataKind>,
    /// Rule for coarser cells; by default that of the kind.
    pub rule: Option<Rule>,
    /// Depth of the tree; by default the minimum that holds the cells.
    pub depth: Option<u8>,
    /// Coordinate system of the features; by default that of the files.
    pub crs: Option<Crs>,
    /// Selection of features.
    pub features: FeatureOptions,
    /// Memory limit in bytes.
    pub memory: u64,
    /// Whether equal subtrees are stored once, in Autumnal files.
    pub share: bool,
    /// Time of an Autumnal file's first commit, in seconds since 1970.
    pub time: Option<i64>,
    /// Compression level, and permitted loss.
    pub packing: Packing,
    pub(super) ground: Option<Box<Ground>>,
}

impl RasterizeOptions {
    /// Creates options that set cells to 1 whose centres are in a feature.
    pub fn new(grid: FeatureGrid) -> RasterizeOptions {
        RasterizeOptions {
            value: FeatureValue::default(),
            overlaps: Overlaps::default(),
            edge: EdgeRule::default(),
            width: None,
            fractions: false,
            grid,
            sample: None,
            kind: None,
            rule: None,
            depth: None,
            crs: None,
            features: FeatureOptions::default(),
            memory: DEFAULT_MEMORY,
            share: false,
            time: None,
            packing: Packing::default(),
            ground: None,
        }
    }

    /// Creates options that set cells to 1 where features are, on the cells of a tree with this
    /// header and metadata, and with its type: for
    /// [`FeatureImport::tree`](super::FeatureImport::tree). In an octree, a feature covers the
    /// columns of cells above and below it; its heights are ignored. `coordinates` are those of the
    /// features; `None` for those of their file.
    ///
    /// # Errors
    /// If it is an octree whose columns of cells are not vertical.
    pub fn over(
        header: &Header,
        metadata: &Metadata,
        coordinates: Option<Coordinates>,
    ) -> Result<RasterizeOptions> {
        metadata.frame.check_columns()?;
        let grid = FeatureGrid::Like(WarpGrid { frame: metadata.frame.clone(), extent: header.extent });
        let ground = Ground { header: header.clone(), metadata: metadata.clone(), coordinates };
        Ok(RasterizeOptions {
            kind: Some(header.kind),
            rule: Some(header.rule),
            depth: Some(header.depth()),
            ground: Some(Box::new(ground)),
            ..RasterizeOptions::new(grid)
        })
    }

    /// Returns half of the width of a feature's lines, `None` if they have no width, or an error
    /// message. The width attribute is the last one read.
    pub(super) fn half_width(&self, feature: &Feature) -> Result<Option<f64>, String> {
        match &self.width {
            None => Ok(None),
            Some(LineWidth::Number(width)) => Ok(Some(width / 2.0)),
            Some(LineWidth::Attribute(name)) => {
                let width = match feature.attributes.last() {
                    None | Some(FeatureAttribute::None) => return Ok(None),
                    Some(FeatureAttribute::Integer(width)) => *width as f64,
                    Some(FeatureAttribute::Number(width)) => *width,
                    Some(other) => return Err(format!("{}, as the width `{name}`", other.to_text())),
                };
                match width {
                    width if width.is_finite() && width >= 0.0 => Ok((width > 0.0).then_some(width / 2.0)),
                    width => Err(format!("{width}, as the width `{name}`")),
                }
            }
        }
    }

    /// Fails if options contradict each other.
    pub(super) fn check(&self) -> Result<()> {
        if (self.fractions || self.edge == EdgeRule::Area) && self.overlaps != Overlaps::Last {
            let expected =
                "no overlap rule: cells get the value with the largest share, or the sum of all shares";
            let found = format!("{} together with shares of cells", self.overlaps);
            return Err(Error::invalid("overlaps", found, expected));
        }
        if self.width.is_some() && (self.fractions || self.edge == EdgeRule::Area) {
            let expected = "no width: shares are not computed for lines with a width";
            return Err(Error::invalid("width", "one together with shares of cells", expected));
        }
        if self.fractions && self.value != FeatureValue::default() {
            return Err(Error::invalid(
                "value",
                "one together with fractions",
                "no value: cells get the share that features cover",
            ));
        }
        if self.sample.is_some() && (self.fractions || self.overlaps.is_computed()) {
            let expected = "no type: computed values have a fixed type";
            return Err(Error::invalid(
                "type",
                "one together with fractions, sums, counts or means",
                expected,
            ));
        }
        let Some(ground) = &self.ground else {
            if let (FeatureValue::Number(number), Some(sample)) = (&self.value, self.sample)
                && !sample.can_hold(*number)
            {
                let found = format!("{}, which cannot represent {number}", sample.name());
                return Err(Error::invalid("type", found, "a type that can represent the value"));
            }
            return match &self.value {
                FeatureValue::Samples(_) => {
                    Err(Error::invalid("value", "several numbers", "one number, or the name of an attribute"))
                }
                _ => Ok(()),
            };
        };
        let value_type = ground.header.form.value;
        let channels = usize::from(value_type.channels);
        let numbers = match &self.value {
            FeatureValue::Number(number) => std::slice::from_ref(number),
            FeatureValue::Samples(numbers) if numbers.len() == channels => numbers,
            FeatureValue::Samples(numbers) => {
                let found = format!("{} numbers", numbers.len());
                return Err(Error::invalid("value", found, format!("1 number or {channels} numbers")));
            }
            FeatureValue::Attribute(_) => &[],
        };
        let is_fit = |number: &Number| value_type.sample.is_float() || value_type.sample.can_hold(*number);
        match numbers.iter().find(|number| !is_fit(number)) {
            Some(number) => Err(Error::invalid(
                "value",
                number.to_string(),
                format!("a number that {value_type} can represent"),
            )),
            None => Ok(()),
        }
    }
}
