//! Section that describes the lines.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::attribute::{LineAttribute, ValueKind};
use crate::codec::MAX_SEGMENTS;
use crate::grid::LineGrid;
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_container::VersionedSection;

/// Maximum size of the section in bytes.
const LIMIT: usize = 1 << 20;
const SECTION: VersionedSection<LIMIT> = VersionedSection { name: "lines", version: 2 };
/// Maximum number of attributes.
const MAX_ATTRIBUTES: usize = 4096;

/// Description of the lines of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Summary {
    /// Number of features, and of line segments.
    pub features: u64,
    pub segments: u64,
    /// Maximum number of segments in a leaf node, and in a block.
    pub leaf_size: u32,
    /// Grid: see [`LineGrid`].
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    pub corner: [i32; 3],
    pub bits: u8,
    pub(crate) has_one_unit: bool,
    /// Names of attributes, and the numbers of their kinds.
    pub attributes: Vec<(String, u8)>,
}

impl Summary {
    pub(crate) fn new(
        grid: &LineGrid,
        attributes: &[LineAttribute],
        (features, segments): (u64, u64),
        leaf_size: usize,
    ) -> Summary {
        let LineGrid { scale, offset, corner, bits, has_one_unit, dimension: _ } = grid.clone();
        let attribute = |attribute: &LineAttribute| (attribute.name.clone(), attribute.kind as u8);
        let attributes = attributes.iter().map(attribute).collect();
        let leaf_size = leaf_size as u32;
        Summary { features, segments, leaf_size, scale, offset, corner, bits, has_one_unit, attributes }
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

    /// Decodes and validates the section of a tree of two or three axes.
    pub(crate) fn from_bytes(
        path: &Path,
        bytes: &[u8],
        dimension: Dimension,
    ) -> Result<(Summary, LineGrid, Vec<LineAttribute>)> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "lines", found, expected);
        let (summary, _): (Summary, usize) = SECTION.decode(path, bytes)?;
        let Summary { scale, offset, corner, bits, has_one_unit, leaf_size, .. } = summary;
        let is_scale = |scale: &f64| scale.is_finite() && *scale > 0.0;
        let are_equal = scale[0] == scale[1] && (!has_one_unit || scale[0] == scale[2]);
        if !(scale.iter().all(is_scale) && are_equal && offset.iter().all(|at| at.is_finite())) {
            let found = format!("scale {scale:?}, offset {offset:?}");
            return Err(corrupt(
                found,
                "finite numbers, and scales above 0 that are equal along axes of one unit",
            ));
        }
        if bits > 32 || summary.attributes.len() > MAX_ATTRIBUTES {
            let found = format!("{bits} bits, {} attributes", summary.attributes.len());
            return Err(corrupt(found, &format!("at most 32 bits and {MAX_ATTRIBUTES} attributes")));
        }
        if !(1..=MAX_SEGMENTS).contains(&(leaf_size as usize)) {
            let found = format!("a leaf size of {leaf_size} segments");
            return Err(corrupt(found, &format!("1 to {MAX_SEGMENTS}")));
        }
        let attribute = |(name, kind): &(String, u8)| {
            let kind = ValueKind::ALL.get(usize::from(*kind)).copied();
            let kind =
                kind.ok_or_else(|| corrupt(format!("attribute {name} of an unknown type"), "types 0 to 5"))?;
            Ok(LineAttribute { name: name.clone(), kind })
        };
        let attributes = summary.attributes.iter().map(attribute).collect::<Result<Vec<_>>>()?;
        Ok((summary, LineGrid { scale, offset, corner, bits, dimension, has_one_unit }, attributes))
    }
}
