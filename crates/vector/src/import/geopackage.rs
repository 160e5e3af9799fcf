//! `GeoPackage` (OGC 12-128): feature tables in an `SQLite` database.

use std::path::{Path, PathBuf};

use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, OptionalExtension, Row};

use super::feature::{
    AttributeType, Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader, FeatureSchema,
    RequestedAttributes,
};
use super::heights::Heights;
use super::wkb;
use crate::export::GeometryKind;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

pub(super) struct GeoPackage {
    connection: Connection,
    path: PathBuf,
    schema: FeatureSchema,
    /// Query of the first row from a row id on.
    select: String,
    /// Minimum id of the next row; `None` after the maximum id.
    next: Option<i64>,
    memory: u64,
    number: u64,
}

/// Memory per byte of a value: in the database, as read, and as points.
const BYTES_FOR_BYTE: u64 = 4;

/// Quotes an SQL identifier.
fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

/// Converts a database error while reading.
fn failed(path: &Path, place: String, memory: u64) -> impl FnOnce(rusqlite::Error) -> Error {
    move |error| match error.sqlite_error_code() {
        Some(ErrorCode::TooBig) => Error::TooLarge {
            path: path.into(),
            what: place,
            needed: memory.saturating_add(1),
            limit: memory,
            advice: "allow more memory, or divide the feature".into(),
        },
        Some(
            ErrorCode::CannotOpen
            | ErrorCode::SystemIoFailure
            | ErrorCode::PermissionDenied
            | ErrorCode::DatabaseBusy
            | ErrorCode::DatabaseLocked
            | ErrorCode::ReadOnly,
        ) => Error::io(path, "read")(std::io::Error::other(error)),
        _ => Error::corrupt(path, place, error.to_string(), "a table of features (GeoPackage)"),
    }
}

impl GeoPackage {
    pub(super) fn open(
        path: &Path,
        layer: Option<&str>,
        options: &FeatureOptions,
        wanted: &mut RequestedAttributes,
    ) -> Result<GeoPackage> {
        let memory = options.memory;
        let broken = |place: &str| failed(path, place.to_owned(), memory);
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(broken("file"))?;
        // Do not call functions that the file defines, and limit the size of values.
        connection
            .execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON;")
            .map_err(broken("file"))?;
        let most = i32::try_from(memory / BYTES_FOR_BYTE).unwrap_or(i32::MAX).max(1 << 16);
        connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, most).map_err(broken("file"))?;
        let table = table_of(&connection, path, layer, memory)?;
        let geometry: (String, String, i64) = connection
            .query_row(
                "SELECT column_name, geometry_type_name, srs_id FROM gpkg_geometry_columns WHERE table_name = ?1 LIMIT 1",
                [&table],
                |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)),
            )
            .map_err(broken("gpkg_geometry_columns"))?;
        let (column, kind, system) = geometry;
        let root: Option<i64> = connection
            .query_row(
                "SELECT rootpage FROM sqlite_master WHERE type = 'table' AND name = ?1",
                [&table],
                |row| row.get(0),
            )
            .optional()
            .map_err(broken("sqlite_master"))?;
        // A view or a virtual table could run a query that never ends.
        if root.is_none_or(|root| root <= 0) {
            let advice = format!("convert it to a table (ogr2ogr table.gpkg {} {table})", path.display());
            return Err(Error::unsupported(path, format!("layer {table}, a view,"), advice));
        }
        let columns = columns_of(&connection, &table).map_err(broken("columns"))?;
        let rowid = ["rowid", "_rowid_", "oid"];
        let is_free = |name: &&str| columns.iter().all(|(own, _, _)| !own.eq_ignore_ascii_case(name));
        let rowid = rowid.into_iter().find(is_free);
        let rowid = rowid.ok_or_else(|| {
            let found = "a table with columns rowid, _rowid_ and oid";
            Error::unsupported(path, found, "rename one of the columns")
        })?;
        let mut attributes = Vec::new();
        for (name, declared, is_key) in &columns {
            // The primary key is the feature's id.
            if !name.eq_ignore_ascii_case(&column) && !is_key && wanted.takes(name) {
                attributes.push((name.clone(), kind_of(declared)));
            }
        }
        let names: String = attributes.iter().map(|(name, _)| format!(", {}", quoted(name))).collect();
        let select = format!(
            "SELECT {rowid}, {}{names} FROM {} WHERE {rowid} >= ?1 ORDER BY {rowid} LIMIT 1",
            quoted(&column),
            quoted(&table)
        );
        connection.prepare_cached(&select).map_err(broken("columns"))?;
        let schema = FeatureSchema {
            name: table,
            crs: system_of(&connection, path, system, memory)?,
            attributes,
            kind: match kind.to_ascii_uppercase().as_str() {
                "POINT" | "MULTIPOINT" => Some(GeometryKind::Point),
                "LINESTRING" | "MULTILINESTRING" => Some(GeometryKind::Line),
                "POLYGON" | "MULTIPOLYGON" => Some(GeometryKind::Polygon),
                _ => None,
            },
            count: None,
        };
        Ok(GeoPackage {
            connection,
            path: path.into(),
            schema,
            select,
            next: Some(i64::MIN),
            memory,
            number: 1,
        })
    }
}

/// Returns the table of a layer, or the only table.
fn table_of(connection: &Connection, path: &Path, layer: Option<&str>, memory: u64) -> Result<String> {
    /// Maximum number of layer names in an error message.
    const MAX_NAMES_LISTED: usize = 100;
    let find = || {
        let query = "SELECT table_name FROM gpkg_contents WHERE lower(data_type) = 'features' ORDER BY table_name LIMIT 10000";
        let mut statement = connection.prepare(query)?;
        let names = statement.query_map([], |row| row.get::<_, String>(0))?;
        names.collect::<rusqlite::Result<Vec<_>>>()
    };
    let mut names = find().map_err(failed(path, "gpkg_contents".into(), memory))?;
    let listed = |names: &[String]| {
        names.iter().take(MAX_NAMES_LISTED).map(String::as_str).collect::<Vec<_>>().join(", ")
    };
    match (layer, names.len()) {
        (_, 0) => {
            Err(Error::unsupported(path, "a GeoPackage without features", "it has only tiles or tables"))
        }
        (Some(name), _) => match names.iter().any(|own| own == name) {
            true => Ok(name.into()),
            false => Err(Error::invalid("layer", name, format!("one of {}", listed(&names)))),
        },
        (None, 1) => Ok(names.remove(0)),
        (None, count) => {
            let expected =
                format!("one of {} after a colon, such as {}:{}", listed(&names), path.display(), names[0]);
            Err(Error::invalid("layer", format!("none for a file with {count} layers"), expected))
        }
    }
}

/// Returns names and declared types of a table's columns, and whether they are its integer key.
fn columns_of(connection: &Connection, table: &str) -> rusqlite::Result<Vec<(String, String, bool)>> {
    let mut statement = connection.prepare(&format!("PRAGMA table_info({})", quoted(table)))?;
    let columns = statement.query_map([], |row| {
        let (name, declared): (String, String) = (row.get(1)?, row.get(2)?);
        let is_key = row.get::<_, i64>(5)? > 0 && declared.eq_ignore_ascii_case("INTEGER");
        Ok((name, declared, is_key))
    })?;
    columns.collect()
}

fn system_of(connection: &Connection, path: &Path, number: i64, memory: u64) -> Result<Option<Crs>> {
    // -1 and 0 are the ids of undefined systems.
    if number <= 0 {
        return Ok(None);
    }
    let query = "SELECT organization, organization_coordsys_id, definition FROM gpkg_spatial_ref_sys WHERE srs_id = ?1";
    let row: Option<(String, i64, String)> = connection
        .query_row(query, [number], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))
        .optional()
        .map_err(failed(path, "gpkg_spatial_ref_sys".into(), memory))?;
    let wrong = |found: String| {
        Error::corrupt(path, "gpkg_spatial_ref_sys", found, "the coordinate system of the layer")
    };
    let (organization, code, definition) = row.ok_or_else(|| wrong(format!("no srs_id {number}")))?;
    match u32::try_from(code) {
        Ok(code @ 1..) if organization.eq_ignore_ascii_case("EPSG") => Ok(Some(Crs::epsg(code))),
        _ if definition.is_empty() || definition.eq_ignore_ascii_case("undefined") => Ok(None),
        _ => Crs::parse(&definition).map(Some).map_err(|error| wrong(error.to_string())),
    }
}

/// Returns the attribute type for a declared column type.
fn kind_of(declared: &str) -> AttributeType {
    let declared = declared.to_ascii_uppercase();
    match declared.split('(').next().unwrap_or_default().trim() {
        "BOOLEAN" => AttributeType::Boolean,
        "TINYINT" | "SMALLINT" | "MEDIUMINT" | "INT" | "INTEGER" => AttributeType::Integer,
        "FLOAT" | "DOUBLE" | "REAL" => AttributeType::Number,
        "TEXT" | "DATE" | "DATETIME" | "BLOB" => AttributeType::Text,
        _ => AttributeType::Mixed,
    }
}

fn value_of(value: ValueRef<'_>, kind: AttributeType) -> FeatureAttribute {
    match value {
        ValueRef::Null => FeatureAttribute::None,
        ValueRef::Integer(number) if kind == AttributeType::Boolean => FeatureAttribute::Boolean(number != 0),
        ValueRef::Integer(number) if kind == AttributeType::Number => FeatureAttribute::Number(number as f64),
        ValueRef::Integer(number) => FeatureAttribute::Integer(number),
        ValueRef::Real(number) => FeatureAttribute::Number(number),
        ValueRef::Text(text) => FeatureAttribute::Text(String::from_utf8_lossy(text).into_owned()),
        ValueRef::Blob(bytes) => {
            FeatureAttribute::Text(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
        }
    }
}

/// Parses a geometry and its heights: well-known binary after a header.
fn geometry(value: ValueRef<'_>) -> std::result::Result<(Option<FeatureGeometry>, Heights), String> {
    let bytes = match value {
        ValueRef::Null => return Ok((None, Heights::default())),
        ValueRef::Blob(bytes) => bytes,
        _ => return Err("a value that is not a geometry".into()),
    };
    let (head, rest) = bytes.split_first_chunk::<8>().ok_or("a geometry without a header")?;
    if !head.starts_with(b"GP\0") {
        return Err("a geometry without the magic bytes `GP` and version 0".into());
    }
    let flags = head[3];
    if flags & 0x20 != 0 {
        return Err("a geometry of an extended type".into());
    }
    let extent = match flags >> 1 & 7 {
        0 => 0,
        1 => 32,
        2 | 3 => 48,
        4 => 64,
        other => return Err(format!("envelope type {other}")),
    };
    let rest = rest.get(extent..).ok_or("a truncated geometry header")?;
    wkb::parse(rest)?.checked()
}

impl FeatureReader for GeoPackage {
    fn schema(&self) -> &FeatureSchema {
        &self.schema
    }

    fn next(&mut self) -> Result<Option<Feature>> {
        let Some(next) = self.next else { return Ok(None) };
        let read = |row: &Row<'_>| {
            let id: i64 = row.get(0)?;
            let values = self.schema.attributes.iter().enumerate();
            let values = values.map(|(index, (_, kind))| Ok(value_of(row.get_ref(index + 2)?, *kind)));
            Ok((id, values.collect::<rusqlite::Result<Vec<_>>>()?, geometry(row.get_ref(1)?)))
        };
        let place = || format!("feature {}", self.number);
        let mut statement =
            self.connection.prepare_cached(&self.select).map_err(failed(&self.path, place(), self.memory))?;
        let row = statement.query_row([next], read).optional();
        let Some((id, attributes, geometry)) = row.map_err(failed(&self.path, place(), self.memory))? else {
            self.next = None;
            return Ok(None);
        };
        let wrong = |found: String| {
            Error::corrupt(&self.path, place(), found, "a feature of points, lines or polygons")
        };
        if id < next {
            return Err(wrong(format!("row {id} after row {}", next - 1)));
        }
        let (geometry, heights) = geometry.map_err(|found| wrong(format!("{found} (fid {id})")))?;
        drop(statement);
        self.next = id.checked_add(1);
        self.number += 1;
        Ok(Some(Feature { id: Some(id.into()), attributes, geometry, heights }))
    }
}
