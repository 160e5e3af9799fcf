//! Options of trees of features.

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

/// Bytes of memory used if nothing is said.
const DEFAULT_MEMORY: u64 = 256 << 20;

/// The value that a feature gives its cells.
#[derive(Clone, Debug, PartialEq)]
pub enum FeatureValue {
    /// A number, of all features.
    Number(Number),
    /// The value of an attribute. Texts become classes, numbered from 1 in the order of the alphabet, with names; over a tree they are names of
    /// its classes.
    Attribute(String),
    /// A number for each channel of the tree that features are laid over.
    Samples(Vec<Number>),
}

impl Default for FeatureValue {
    fn default() -> FeatureValue {
        FeatureValue::Number(Number::Unsigned(1))
    }
}

impl FromStr for FeatureValue {
    type Err = Error;

    /// Reads a number, or the name of an attribute.
    fn from_str(text: &str) -> Result<FeatureValue> {
        if text.is_empty() {
            return Err(Error::invalid("value", "nothing", "a number, or the name of an attribute"));
        }
        Ok(text.parse().map_or_else(|_| FeatureValue::Attribute(text.into()), FeatureValue::Number))
    }
}

/// The width of lines, in units of the tree's coordinates.
#[derive(Clone, Debug, PartialEq)]
pub enum LineWidth {
    /// A number, of all lines.
    Number(f64),
    /// The value of an attribute. Lines without one, or of 0, have the cells that their points are in.
    Attribute(String),
}

impl FromStr for LineWidth {
    type Err = Error;

    /// Reads a number, or the name of an attribute.
    fn from_str(text: &str) -> Result<LineWidth> {
        match text.parse::<f64>() {
            Ok(width) if width.is_finite() && width > 0.0 => Ok(LineWidth::Number(width)),
            Err(_) if !text.is_empty() => Ok(LineWidth::Attribute(text.into())),
            _ => Err(Error::invalid("width", text, "a number above zero, or the name of an attribute")),
        }
    }
}

/// The value of cells where features lie on top of each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overlaps {
    /// The value of the last one in the file.
    #[default]
    Last,
    /// That of the first one.
    First,
    /// The least.
    Min,
    /// The greatest.
    Max,
    /// The sum of all.
    Sum,
    /// The number of features; of points each counts.
    Count,
    /// The mean of all.
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

    /// Whether numbers are computed of all features over a cell.
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

/// The cells of a tree of features.
#[derive(Clone, Debug, PartialEq)]
pub enum FeatureGrid {
    /// So many cells along the longer side of the box around all features.
    Cells(u64),
    /// Cells of this width, in units of the features' system; sides of cells lie at its multiples, so that all trees of one width fit
    /// together.
    Cell(f64),
    /// The cells of another tree, wherever the features lie.
    Like(WarpGrid),
    /// The cells of another tree, over its extent and that of the features.
    Extended(WarpGrid),
}

impl FeatureGrid {
    /// The cells of web maps to a zoom, whose tiles of 256 x 256 cells are the deepest.
    ///
    /// # Errors
    /// If a quadtree has no room for them: the deepest zoom is 21.
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

/// The tree that features are laid over.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    pub(super) header: Header,
    pub(super) metadata: Metadata,
    /// The features' coordinates; those of their file if nothing is said.
    pub(super) coordinates: Option<Coordinates>,
}

/// Options for a tree of features.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RasterizeOptions {
    /// The value that features give their cells.
    pub value: FeatureValue,
    /// The value of cells where features lie on top of each other.
    pub overlaps: Overlaps,
    /// Rule for cells at the edges of polygons. [`EdgeRule::Area`] gives each cell the value that has the largest share of it, nothing being one of
    /// them; polygons of one value that overlap are united. (Lines are in all cells that their points are in.)
    pub edge: EdgeRule,
    /// The width of lines: they have the cells whose centres are no farther from them than half of it. Without one they have all cells that
    /// their points are in.
    pub width: Option<LineWidth>,
    /// Cells get the share of them that features have, from 0 to 1, instead of a value. Polygons that overlap are united.
    pub fractions: bool,
    /// The cells.
    pub grid: FeatureGrid,
    /// Type of the values; that of the attribute if not given: i32 or i64 of integers, f64 of real numbers.
    pub sample: Option<SampleType>,
    /// Kind of the values; texts and a number for all are classes if not given, numbers of an attribute continuous values.
    pub kind: Option<DataKind>,
    /// Rule for coarser cells; the kind's if nothing is said.
    pub rule: Option<Rule>,
    /// Levels of the tree; as few as hold the cells if nothing is said.
    pub depth: Option<u8>,
    /// The system of the features' coordinates; otherwise the files'.
    pub crs: Option<Crs>,
    /// Which features of the files count.
    pub features: FeatureOptions,
    /// Bytes of memory for everything.
    pub memory: u64,
    /// Whether equal subtrees are stored once, in Autumnal files.
    pub share: bool,
    /// Time of the commit that an Autumnal file begins with, in seconds since the beginning of 1970.
    pub time: Option<i64>,
    /// How few bytes the file is to take, and what it may lose for that.
    pub packing: Packing,
    pub(super) ground: Option<Box<Ground>>,
}

impl RasterizeOptions {
    /// Ones where features are, of cells by their centres.
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

    /// Ones where features are, on the cells of a tree with such a header and metadata, and in its form: for
    /// [`FeatureImport::tree`](super::FeatureImport::tree). Features are in some coordinates; in their file's if nothing is said.
    ///
    /// # Errors
    /// If it is an octree.
    pub fn over(
        header: &Header,
        metadata: &Metadata,
        coordinates: Option<Coordinates>,
    ) -> Result<RasterizeOptions> {
        if header.form.axes() != 2 {
            return Err(Error::invalid("tree", "an octree", "a quadtree, over which features can be laid"));
        }
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

    /// Half of the width of a feature's lines; `None` if they have none, or what is wrong with it. (Its attribute is the last of those that are
    /// read.)
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
            let expected = "nothing: the value with the largest share of a cell wins, and shares of all features are added up";
            let found = format!("{}, with shares of cells", self.overlaps);
            return Err(Error::invalid("overlaps", found, expected));
        }
        if self.width.is_some() && (self.fractions || self.edge == EdgeRule::Area) {
            let expected = "cells by their centres, as the only ones that a line of some width has";
            return Err(Error::invalid("width", "a width of lines, with shares of cells", expected));
        }
        if self.fractions && self.value != FeatureValue::default() {
            return Err(Error::invalid(
                "value",
                "one, with fractions",
                "nothing: cells get the share of them that features have",
            ));
        }
        if self.sample.is_some() && (self.fractions || self.overlaps.is_computed()) {
            let expected = "none: numbers that are computed have one of their own";
            return Err(Error::invalid("type", "one, with fractions, sums, counts or means", expected));
        }
        let Some(ground) = &self.ground else {
            if let (FeatureValue::Number(number), Some(sample)) = (&self.value, self.sample)
                && !sample.can_hold(*number)
            {
                let found = format!("{}, which cannot hold {number}", sample.name());
                return Err(Error::invalid("type", found, "one that holds the value"));
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
                return Err(Error::invalid("value", found, format!("1 number, or {channels}")));
            }
            FeatureValue::Attribute(_) => &[],
        };
        let is_fit = |number: &Number| value_type.sample.is_float() || value_type.sample.can_hold(*number);
        match numbers.iter().find(|number| !is_fit(number)) {
            Some(number) => {
                Err(Error::invalid("value", number.to_string(), format!("what {value_type} can hold")))
            }
            None => Ok(()),
        }
    }
}
