//! CSV tables, with geometries in WKT or WKB, or points in two columns.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::feature::{
    AttributeType, Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader, FeatureSchema,
    RequestedAttributes,
};
use super::heights::Heights;
use super::rows::Rows;
use super::{wkb, wkt};
use crate::export::GeometryKind;
use spinney_base::io::shown;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Names of geometry columns and of coordinate pairs, matched in any case.
const GEOMETRIES: [&str; 6] = ["wkt", "wkb", "geometry", "geom", "the_geom", "wkb_geometry"];
const DEGREES: [[&str; 2]; 4] = [["lon", "lat"], ["longitude", "latitude"], ["lng", "lat"], ["long", "lat"]];
const PLANE: [&str; 2] = ["x", "y"];

/// Maximum number of columns.
const MAX_COLUMNS: usize = 4096;

/// Columns of the geometry.
#[derive(Clone, Copy)]
enum GeometryColumns {
    Geometry(usize),
    Point { columns: [usize; 2] },
}

pub(super) struct Csv {
    rows: Rows,
    path: PathBuf,
    schema: FeatureSchema,
    geometry_columns: GeometryColumns,
    /// Column indices of the attributes.
    columns: Vec<usize>,
    /// Number of all columns.
    width: usize,
    number: u64,
    assumes_degrees: bool,
}

impl Csv {
    pub(super) fn open(
        file: File,
        path: &Path,
        options: &FeatureOptions,
        wanted: &mut RequestedAttributes,
    ) -> Result<Csv> {
        let mut rows = Rows::open(file, path, options.memory)?;
        rows.step(1)?;
        let width = rows.len();
        if width > MAX_COLUMNS {
            return Err(Error::unsupported(
                path,
                format!("a table of {width} columns"),
                "remove some of them",
            ));
        }
        let heading = |index: usize| rows.field(index).0.trim_start_matches('\u{feff}').trim().to_owned();
        let names: Vec<String> = (0..width).map(heading).collect();
        let (geometry_columns, degrees) = geometry_columns_of(&names).ok_or_else(|| {
            let found = format!("the columns {}", names.join(", ").chars().take(400).collect::<String>());
            let expected = "a geometry column wkt, wkb, geometry, geom or the_geom, or coordinate columns x and y, or lon and lat";
            Error::invalid(format!("{}: first row", shown(path)), found, expected)
        })?;
        let is_attribute =
            |index: &usize| !matches!(geometry_columns, GeometryColumns::Geometry(own) if own == *index);
        let columns: Vec<usize> =
            (0..width).filter(is_attribute).filter(|index| wanted.takes(&names[*index])).collect();
        // Column types, and the coordinate system that geometries may specify.
        let mut kinds: Vec<Option<AttributeType>> = vec![None; columns.len()];
        let (mut number, mut system) = (1, None);
        while rows.step(number)? {
            for (kind, column) in kinds.iter_mut().zip(&columns) {
                let (text, is_quoted) = rows.field(*column);
                if *kind != Some(AttributeType::Text) && (is_quoted || !text.is_empty()) {
                    *kind = Some(kind.map_or(kind_of(&text), |known| joined(known, kind_of(&text))));
                }
            }
            if let GeometryColumns::Geometry(column) = geometry_columns {
                let own = system_of(&rows.field(column).0).map_err(|found| wrong(path, number, found))?;
                if number > 1 && own != system {
                    return Err(wrong(
                        path,
                        number,
                        "a coordinate system that differs from that of earlier features".into(),
                    ));
                }
                system = own;
            }
            number += 1;
        }
        rows.rewind()?;
        rows.step(1)?;
        let crs = match (system, degrees) {
            (Some(number), _) => Some(Crs::epsg(number)),
            (None, true) => Some(Crs::epsg(4326)),
            (None, false) => super::sidecar::definition(path)?,
        };
        let attributes = columns.iter().zip(kinds);
        let schema = FeatureSchema {
            name: path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default(),
            crs,
            attributes: attributes
                .map(|(column, kind)| (names[*column].clone(), kind.unwrap_or(AttributeType::Text)))
                .collect(),
            kind: matches!(geometry_columns, GeometryColumns::Point { .. }).then_some(GeometryKind::Point),
            count: Some(number - 1),
        };
        let (path, assumes_degrees) = (path.into(), degrees && system.is_none());
        Ok(Csv { rows, path, schema, geometry_columns, columns, width, number: 1, assumes_degrees })
    }

    fn geometry(&self) -> std::result::Result<(Option<FeatureGeometry>, Heights), String> {
        match self.geometry_columns {
            GeometryColumns::Geometry(column) => {
                let text = self.rows.field(column).0;
                match text.trim() {
                    "" => Ok((None, Heights::default())),
                    text => match wkb::bytes_of_digits(text) {
                        Some(bytes) => wkb::parse(&bytes)?.checked(),
                        None => wkt::parse(text)?.checked(),
                    },
                }
            }
            GeometryColumns::Point { columns } => {
                let [x, y] = columns.map(|column| self.rows.field(column).0);
                if x.trim().is_empty() && y.trim().is_empty() {
                    return Ok((None, Heights::default()));
                }
                let number =
                    |text: &str| text.trim().parse::<f64>().map_err(|_| format!("`{text}` as a coordinate"));
                let point = FeatureGeometry::Points(vec![[number(&x)?, number(&y)?]]);
                point.checked().map(|point| (Some(point), Heights::default()))
            }
        }
    }
}

fn wrong(path: &Path, number: u64, found: String) -> Error {
    Error::corrupt(path, format!("feature {number}"), found, "a geometry in WKT or WKB, or a point")
}

/// Finds the geometry columns of a table, and returns whether they are in degrees.
fn geometry_columns_of(names: &[String]) -> Option<(GeometryColumns, bool)> {
    let column = |wanted: &str| names.iter().position(|name| name.eq_ignore_ascii_case(wanted));
    let pair = |[x, y]: [&str; 2]| Some(GeometryColumns::Point { columns: [column(x)?, column(y)?] });
    let geometry = GEOMETRIES
        .iter()
        .find_map(|name| column(name))
        .map(|column| (GeometryColumns::Geometry(column), false));
    let degrees = || DEGREES.into_iter().find_map(pair).map(|geometry_columns| (geometry_columns, true));
    geometry.or_else(|| pair(PLANE).map(|geometry_columns| (geometry_columns, false))).or_else(degrees)
}

/// Returns the EPSG code that a geometry specifies.
fn system_of(text: &str) -> std::result::Result<Option<u32>, String> {
    let text = text.trim();
    // Of WKB, the header suffices.
    match text.get(..18).and_then(wkb::bytes_of_digits).as_deref() {
        Some(&[1, _, _, _, marks, a, b, c, d]) if marks & 0x20 != 0 => {
            Ok(Some(u32::from_le_bytes([a, b, c, d])))
        }
        Some(&[0, marks, _, _, _, a, b, c, d]) if marks & 0x20 != 0 => {
            Ok(Some(u32::from_be_bytes([a, b, c, d])))
        }
        Some(_) => Ok(None),
        None => Ok(wkt::system_of(text)?.0),
    }
}

/// Returns the type of a field's text. Numbers with leading zeros are codes, thus strings.
fn kind_of(text: &str) -> AttributeType {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let is_number = digits.bytes().all(|byte| byte.is_ascii_digit() || b".eE+-".contains(&byte))
        && digits.starts_with(|first: char| first.is_ascii_digit() || first == '.')
        && !(digits.len() > 1 && digits.starts_with('0') && digits.as_bytes()[1].is_ascii_digit());
    match is_number {
        true if text.parse::<i64>().is_ok() => AttributeType::Integer,
        // Integers beyond 64 bits are kept as strings.
        true if digits.bytes().all(|byte| byte.is_ascii_digit()) => AttributeType::Text,
        true if text.parse::<f64>().is_ok_and(f64::is_finite) => AttributeType::Number,
        _ => AttributeType::Text,
    }
}

fn joined(one: AttributeType, other: AttributeType) -> AttributeType {
    match one.with(other) {
        AttributeType::Mixed => AttributeType::Text,
        kind => kind,
    }
}

impl FeatureReader for Csv {
    fn schema(&self) -> &FeatureSchema {
        &self.schema
    }

    fn assumes_degrees(&self) -> bool {
        self.assumes_degrees
    }

    fn next(&mut self) -> Result<Option<Feature>> {
        if !self.rows.step(self.number)? {
            return Ok(None);
        }
        if self.rows.len() > self.width {
            let found = format!("{} fields for {} columns", self.rows.len(), self.width);
            return Err(wrong(&self.path, self.number, found));
        }
        let (geometry, heights) = self.geometry().map_err(|found| wrong(&self.path, self.number, found))?;
        let value = |(column, (_, kind)): (&usize, &(String, AttributeType))| {
            let (text, is_quoted) = self.rows.field(*column);
            if text.is_empty() && !(is_quoted && *kind == AttributeType::Text) {
                return Ok(FeatureAttribute::None);
            }
            match kind {
                AttributeType::Integer => text.parse().map(FeatureAttribute::Integer).map_err(|_| ()),
                AttributeType::Number => text.parse().map(FeatureAttribute::Number).map_err(|_| ()),
                _ => Ok(FeatureAttribute::Text(text.into_owned())),
            }
        };
        let values = self.columns.iter().zip(&self.schema.attributes).map(value).collect::<Result<_, ()>>();
        // The file was checked in the first pass, so it has changed since.
        let changed = |()| Error::Changed { path: self.path.clone(), what: "was overwritten" };
        let attributes = values.map_err(changed)?;
        self.number += 1;
        Ok(Some(Feature { id: None, attributes, geometry, heights }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_have_the_kind_of_all_their_values() {
        use AttributeType::{Integer, Number, Text};
        for (text, kind) in [
            ("1", Integer),
            ("-12", Integer),
            ("0", Integer),
            ("0.5", Number),
            ("-1e3", Number),
            (".5", Number),
            ("007", Text),
            ("+5", Text),
            ("1-2", Text),
            ("99999999999999999999", Text),
            ("1e999", Text),
            ("nan", Text),
            ("1,5", Text),
            ("-", Text),
        ] {
            assert_eq!(kind_of(text), kind, "{text}");
        }
        assert_eq!((joined(Integer, Number), joined(Integer, Text)), (Number, Text));
    }
}
