//! Values of faces that come from materials and numeric properties.

use std::collections::HashSet;

use spinney_records::ply::{Element, Scalar};

/// Column of the name of a face's material.
pub(crate) const MATERIAL: &str = "material";

/// Maximum bytes of a value. Every face may repeat it, so a two-byte number in the file can expand
/// to this size.
pub(super) const MAX_VALUE_BYTES: usize = 4096;

/// Maximum number of columns.
const MAX_COLUMNS: usize = 4096;

/// Indices of the properties of a PLY element that become columns: one number each, with distinct
/// names, except colours.
pub(super) fn number_columns(element: &Element) -> Vec<usize> {
    let colour = element.colour().map_or(Vec::new(), |colour| colour.to_vec());
    let mut names = HashSet::new();
    let properties = element.properties.iter().enumerate();
    let own = properties.filter(|(index, property)| {
        !colour.contains(index) && property.length.is_none() && names.insert(property.name.as_str())
    });
    own.map(|(index, _)| index).take(MAX_COLUMNS).collect()
}

/// Numbers of a face as JSON, in the shortest decimals that denote them in their type.
#[derive(Default)]
pub(super) struct FaceNumbers {
    /// JSON of each column; empty if the face has no number there.
    json: Vec<String>,
    /// Number of infinities so far, which JSON does not have.
    pub(super) lost: u64,
}

impl FaceNumbers {
    pub(super) fn of_columns(count: usize) -> FaceNumbers {
        FaceNumbers { json: vec![String::new(); count], lost: 0 }
    }

    /// Sets the number of a column. NaN means that the face has none.
    pub(super) fn set(&mut self, column: usize, number: f64, scalar: Scalar) {
        let json = &mut self.json[column];
        json.clear();
        match scalar {
            _ if !number.is_finite() => self.lost += u64::from(number.is_infinite()),
            Scalar::F32 => json.push_str(&format!("{:?}", number as f32)),
            Scalar::F64 => json.push_str(&format!("{number:?}")),
            _ => json.push_str(&format!("{number:.0}")),
        }
    }

    /// The values of the face, by the names of the columns.
    pub(super) fn values<'a, 'n: 'a>(
        &'a self,
        names: impl Iterator<Item = &'n str>,
    ) -> Vec<(&'a str, &'a str)> {
        let all = names.zip(&self.json).map(|(name, json)| (name, json.as_str()));
        all.filter(|(_, json)| !json.is_empty()).collect()
    }
}
