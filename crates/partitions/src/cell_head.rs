//! Description of the cells of a tree, in the first word of a DF-expression:
//!
//! ```text
//! cells  = axes ":" depth ":" values ":" extent
//! axes   = "xy" | "xyz"
//! depth  = levels of the quadtree or octree
//! values = type ["x" channels] ["+alpha" | "+missing=" number]      as in u8, f32x3, u8x4+alpha
//! extent = cells along each axis, as in 200x150
//! ```

use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::{Mask, Number, SampleType, ValueType};

/// Type, depth and extent of a tree of cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CellHead {
    pub(crate) form: TreeType,
    pub(crate) depth: u8,
    pub(crate) extent: [u64; 3],
}

impl CellHead {
    /// Formats the description.
    pub(crate) fn text(&self) -> String {
        let TreeType { dimension, value } = self.form;
        let axes = if dimension == Dimension::Quad { "xy" } else { "xyz" };
        let extent: Vec<_> = self.extent[..dimension.axes()].iter().map(u64::to_string).collect();
        format!("{axes}:{}:{}:{}", self.depth, values_text(value), extent.join("x"))
    }

    /// Parses the four parts. Returns the first invalid one as an error.
    pub(crate) fn parse([axes, depth, values, extent]: [&str; 4]) -> Result<CellHead, &str> {
        let dimension = match axes {
            "xy" => Dimension::Quad,
            "xyz" => Dimension::Oct,
            _ => return Err(axes),
        };
        let known = depth.parse().ok().filter(|depth| *depth <= dimension.max_depth());
        let depth: u8 = known.ok_or(depth)?;
        let form = TreeType::new(dimension, parse_values(values).ok_or(values)?);
        let sizes: Option<Vec<u64>> = extent.split('x').map(|size| size.parse().ok()).collect();
        let sizes = sizes.filter(|sizes| {
            sizes.len() == dimension.axes() && sizes.iter().all(|size| (1..=1 << depth).contains(size))
        });
        let sizes = sizes.ok_or(extent)?;
        let mut extent = [1; 3];
        extent[..sizes.len()].copy_from_slice(&sizes);
        Ok(CellHead { form, depth, extent })
    }
}

fn values_text(value: ValueType) -> String {
    match (value.mask, value.all_missing()) {
        (Mask::Alpha, _) => format!("{value}+alpha"),
        (Mask::Missing(_), Some(missing)) => format!("{value}+missing={}", value.first_number(missing)),
        _ => value.to_string(),
    }
}

fn parse_values(text: &str) -> Option<ValueType> {
    let (name, mask) = text.split_once('+').unwrap_or((text, ""));
    let (sample, channels) = name.split_once('x').unwrap_or((name, "1"));
    let sample = SampleType::ALL.into_iter().find(|known| known.name() == sample)?;
    let plain = ValueType::new(sample, channels.parse().ok()?);
    let value = match mask.strip_prefix("missing=") {
        Some(number) => plain.with_missing(number.parse::<Number>().ok()?),
        None if mask == "alpha" => plain.with_alpha(),
        None => plain,
    };
    // Only the canonical spelling is accepted.
    (value.is_supported() && values_text(value) == text).then_some(value)
}
