//! The file section that describes the points.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::attribute::{PointAttribute, RowLayout};
use crate::build::BuildSummary;
use crate::build::Encoder;
use crate::codec::MAX_POINTS;
use crate::grid::PointGrid;
use spinney_base::space::Dimension;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_container::VersionedSection;

/// Maximum size of the section in bytes.
const LIMIT: usize = 1 << 20;
const SECTION: VersionedSection<LIMIT> = VersionedSection { name: "points", version: 1 };
/// Maximum number of attributes.
pub(crate) const MAX_ATTRIBUTES: usize = 4096;

/// Description of the points of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Summary {
    /// Number of points, and of those that repeat the position of another one.
    pub points: u64,
    pub duplicates: u64,
    /// Maximum number of points in a block.
    pub leaf_size: u32,
    /// The grid: see [`PointGrid`].
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    pub corner: [i32; 3],
    pub bits: u8,
    pub attributes: Vec<StoredAttribute>,
}

/// An attribute: see [`PointAttribute`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredAttribute {
    pub name: String,
    pub sample: u8,
    pub scale_offset: Option<(f64, f64)>,
    pub description: String,
    pub(crate) no_data: Option<i64>,
}

impl Summary {
    /// Creates the description of an encoder's blocks.
    pub(crate) fn new(encoder: &Encoder, leaf_size: usize, summary: BuildSummary) -> Summary {
        let attribute = |attribute: &PointAttribute| StoredAttribute {
            name: attribute.name.clone(),
            sample: attribute.sample as u8,
            scale_offset: attribute.scale_offset,
            description: attribute.description.clone(),
            no_data: attribute.no_data,
        };
        let PointGrid { scale, offset, corner, bits, .. } = encoder.grid.clone();
        Summary {
            points: summary.points,
            duplicates: summary.duplicates,
            leaf_size: leaf_size as u32,
            scale,
            offset,
            corner,
            bits,
            attributes: encoder.layout.attributes.iter().map(attribute).collect(),
        }
    }

    /// Encodes the section.
    pub(crate) fn to_bytes(&self, path: &Path) -> Result<Vec<u8>> {
        let bytes = SECTION.encode(self).filter(|_| self.attributes.len() <= MAX_ATTRIBUTES);
        bytes.ok_or_else(|| Error::TooLarge {
            path: path.to_path_buf(),
            what: "the list of attributes".into(),
            needed: LIMIT as u64 + 1,
            limit: LIMIT as u64,
            advice: "select fewer attributes with --attribute".into(),
        })
    }

    /// Decodes and checks the section of a tree of this dimension.
    pub(crate) fn from_bytes(
        path: &Path,
        bytes: &[u8],
        dimension: Dimension,
    ) -> Result<(Summary, PointGrid, RowLayout)> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "points", found, expected);
        let (summary, _): (Summary, usize) = SECTION.decode(path, bytes)?;
        let numbers = summary.scale.iter().chain(&summary.offset);
        if !numbers.clone().all(|number| number.is_finite())
            || summary.scale.iter().any(|scale| *scale <= 0.0)
        {
            let found = format!("scale {:?}, offset {:?}", summary.scale, summary.offset);
            return Err(corrupt(found, "finite numbers, and scales above 0"));
        }
        if summary.bits > 32 || summary.attributes.len() > MAX_ATTRIBUTES {
            let found = format!("{} bits, {} attributes", summary.bits, summary.attributes.len());
            return Err(corrupt(found, &format!("at most 32 bits and {MAX_ATTRIBUTES} attributes")));
        }
        if !(1..=MAX_POINTS).contains(&(summary.leaf_size as usize)) {
            return Err(corrupt(
                format!("a leaf size of {} points", summary.leaf_size),
                &format!("1 to {MAX_POINTS}"),
            ));
        }
        let attribute = |stored: &StoredAttribute| {
            let sample = SampleType::ALL.get(usize::from(stored.sample)).copied();
            let sample = sample.ok_or_else(|| corrupt(format!("sample type {}", stored.sample), "0 to 9"))?;
            let StoredAttribute { name, scale_offset, description, no_data, .. } = stored.clone();
            Ok(PointAttribute { name, sample, scale_offset, description, no_data })
        };
        let attributes = summary.attributes.iter().map(attribute).collect::<Result<Vec<_>>>()?;
        let Summary { scale, offset, corner, bits, .. } = summary.clone();
        let grid = PointGrid { scale, offset, corner, bits, dimension };
        Ok((summary, grid, RowLayout::packed(attributes)))
    }
}
