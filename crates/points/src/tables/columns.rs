//! Assigns roles to table columns: coordinates or attributes.

use std::path::Path;

use crate::attribute::PointAttribute;
use spinney_base::space::Dimension;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// Role of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// A coordinate, by its axis.
    Coordinate(usize),
    /// An attribute, by its index.
    Attribute(usize),
}

/// Columns of a table.
pub(super) struct Columns {
    /// Role of each column, in table order.
    pub(super) roles: Vec<Role>,
    pub(super) attributes: Vec<PointAttribute>,
    pub(super) dimension: Dimension,
}

impl Columns {
    /// Finds coordinates by their names x, y and z, in either case. All other columns are
    /// attributes.
    ///
    /// # Errors
    /// If there is no x or y, or two columns have the same name.
    pub(super) fn of(columns: &[(&str, SampleType)], path: &Path) -> Result<Columns> {
        let axes =
            ["x", "y", "z"].map(|axis| columns.iter().position(|(name, _)| name.eq_ignore_ascii_case(axis)));
        let [Some(_), Some(_), height] = axes else {
            let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
            let found = format!("columns {}", names.join(", "));
            return Err(Error::corrupt(path, "the header", found, "columns x and y, and optionally z"));
        };
        let mut attributes: Vec<PointAttribute> = Vec::new();
        let mut roles = Vec::new();
        for (index, (name, sample)) in columns.iter().enumerate() {
            if let Some(axis) = axes.iter().position(|axis| *axis == Some(index)) {
                roles.push(Role::Coordinate(axis));
                continue;
            }
            if attributes.iter().any(|other| other.name == *name) {
                let found = format!("two columns `{name}`");
                return Err(Error::corrupt(path, "the header", found, "unique column names"));
            }
            roles.push(Role::Attribute(attributes.len()));
            attributes.push(PointAttribute::new(*name, *sample));
        }
        let dimension = if height.is_some() { Dimension::Oct } else { Dimension::Quad };
        Ok(Columns { roles, attributes, dimension })
    }
}
