//! `GeoPackage` 1.3 (OGC 12-128r17): one table of features in an `SQLite` database, without an index.

use std::path::{Path, PathBuf};

use rusqlite::types::Value;
use rusqlite::{Connection, params, params_from_iter};

use super::text::joined;
use super::{AttributeType, AttributeValue, FormatWriter, Geometry, GeometryKind, VectorLayer};
use spinney_base::io::Output;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Well-known text of WGS 84.
const WGS84: &str = "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563,AUTHORITY[\"EPSG\",\"7030\"]],\
  AUTHORITY[\"EPSG\",\"6326\"]],PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],UNIT[\"degree\",0.0174532925199433,\
  AUTHORITY[\"EPSG\",\"9122\"]],AUTHORITY[\"EPSG\",\"4326\"]]";

/// Tables that every file has. The number of the application is `GPKG`.
const SCHEMA: &str = "
PRAGMA application_id = 0x47504b47;
PRAGMA user_version = 10300;
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')), min_x DOUBLE,
  min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL UNIQUE REFERENCES gpkg_contents(table_name),
  column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL REFERENCES gpkg_spatial_ref_sys(srs_id),
  z TINYINT NOT NULL, m TINYINT NOT NULL, PRIMARY KEY (table_name, column_name));
INSERT INTO gpkg_spatial_ref_sys VALUES ('Undefined cartesian SRS', -1, 'NONE', -1, 'undefined', NULL);
INSERT INTO gpkg_spatial_ref_sys VALUES ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL);
";

/// Number of a coordinate system that has none in a registry.
const OWN: i64 = 100_000;

/// The time of all files: the same input makes the same bytes.
const TIME: &str = "2000-01-01T00:00:00.000Z";

/// Bytes of a geometry that are held; larger ones are written piece by piece.
const HELD: u64 = 1 << 20;

pub(super) struct GeoPackage {
    output: Output,
    path: PathBuf,
    connection: Connection,
    layer: VectorLayer,
    srs: i64,
    insert: String,
}

fn failed(path: &Path) -> impl FnOnce(rusqlite::Error) -> Error {
    let path = path.to_path_buf();
    move |error| {
        let cause = match error.sqlite_error_code() {
            Some(rusqlite::ErrorCode::DiskFull) => {
                std::io::Error::new(std::io::ErrorKind::StorageFull, error)
            }
            _ => std::io::Error::other(error),
        };
        Error::Io { path, doing: "write", cause }
    }
}

/// A name as SQL has it.
fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

impl GeoPackage {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<GeoPackage> {
        let Some(path) = output.unfinished_path().map(Path::to_path_buf) else {
            let advice = "give the name of a file: it is a database";
            return Err(Error::unsupported(output.path(), "writing GeoPackage to a stream", advice));
        };
        let connection = Connection::open(&path).map_err(failed(&path))?;
        // A file that nobody sees yet needs no journal of the database's own.
        let settings =
            "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; PRAGMA cache_size = -16384; BEGIN;";
        connection.execute_batch(&format!("{settings}{SCHEMA}")).map_err(failed(&path))?;
        let table = quoted(&layer.name);
        let column = |(name, kind): &(String, AttributeType)| {
            let kind = if *kind == AttributeType::Number { "DOUBLE" } else { "TEXT" };
            format!(", {} {kind}", quoted(name))
        };
        let geometry_type = match layer.kind {
            Some(GeometryKind::Point) => "POINT",
            Some(GeometryKind::Line) => "LINESTRING",
            Some(GeometryKind::Polygon) => "POLYGON",
            None => "GEOMETRY",
        };
        let columns: String = layer.attributes.iter().map(column).collect();
        let create =
            format!("CREATE TABLE {table} (fid INTEGER PRIMARY KEY NOT NULL, geom {geometry_type}{columns})");
        let places = ", ?".repeat(layer.attributes.len());
        let insert = format!("INSERT INTO {table} VALUES (NULL, ?{places})");
        let insert_srs = "INSERT INTO gpkg_spatial_ref_sys VALUES (?1, ?2, ?3, ?4, ?5, NULL)";
        let srs = srs_of(layer.crs.as_ref());
        let run = || -> rusqlite::Result<()> {
            connection.execute(insert_srs, params!["WGS 84", 4326, "EPSG", 4326, WGS84])?;
            if let Some((name, number, organization, definition)) = &srs
                && *number != 4326
            {
                connection.execute(insert_srs, params![name, number, organization, number, definition])?;
            }
            let number = srs.as_ref().map_or(-1, |(_, number, ..)| *number);
            let [[west, south], [east, north]] = layer.bounds;
            connection.execute(
                "INSERT INTO gpkg_contents VALUES (?1, 'features', ?1, '', ?2, ?3, ?4, ?5, ?6, ?7)",
                params![layer.name, TIME, west, south, east, north, number],
            )?;
            connection.execute(
                "INSERT INTO gpkg_geometry_columns VALUES (?1, 'geom', ?2, ?3, ?4, 0)",
                params![layer.name, geometry_type, number, u8::from(layer.has_z)],
            )?;
            connection.execute_batch(&create)
        };
        run().map_err(failed(&path))?;
        let srs = srs.map_or(-1, |(_, number, ..)| number);
        Ok(GeoPackage { output, path, connection, layer, srs, insert })
    }
}

/// Name, number, registry and definition of a coordinate system.
fn srs_of(crs: Option<&Crs>) -> Option<(String, i64, &'static str, String)> {
    let crs = crs?;
    let definition = match crs {
        Crs::Wkt(text) => Some(text.clone()),
        _ => crs.to_wkt2().ok().or_else(|| crs.foreign_text()),
    };
    match crs.numbers() {
        Some(epsg) => {
            let number = i64::from(epsg.horizontal);
            let definition = definition.unwrap_or_else(|| "undefined".into());
            Some((format!("EPSG:{number}"), number, "EPSG", definition))
        }
        None => Some((crs.name().unwrap_or_else(|| "own".into()), OWN, "NONE", definition?)),
    }
}

impl FormatWriter for GeoPackage {
    fn write(
        &mut self,
        kind: GeometryKind,
        geometry: &dyn Geometry,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let GeoPackage { path, connection, layer, srs, insert, .. } = self;
        let (parts, code, counts) = match kind {
            GeometryKind::Point => (1, 1u32, 0),
            GeometryKind::Line => (1, 2, 4),
            GeometryKind::Polygon => (geometry.parts(), 3, 4 + 4 * geometry.parts() as u64),
        };
        let width = if layer.has_z { 24 } else { 16 };
        let points = (0..parts).fold(0u64, |sum, part| sum.saturating_add(geometry.count(part)));
        let size = points.saturating_mul(width).saturating_add(8 + 5 + counts);
        if size > 1_000_000_000 {
            let advice = "choose another format: databases have features of at most 1 GB";
            return Err(Error::unsupported(self.output.path(), format!("a feature of {size} bytes"), advice));
        }
        // The header of the format, little-endian and without a box, then well-known binary.
        let mut bytes = b"GP\0\x01".to_vec();
        bytes.extend_from_slice(&(*srs as i32).to_le_bytes());
        bytes.push(1);
        let code = code + if layer.has_z { 1000 } else { 0 };
        bytes.extend_from_slice(&code.to_le_bytes());
        if kind == GeometryKind::Polygon {
            bytes.extend_from_slice(&(parts as u32).to_le_bytes());
        }
        let number = |value: &AttributeValue<'_>| match value {
            AttributeValue::Number(number) if number.is_finite() => Value::Real(*number),
            AttributeValue::Text(text) => Value::Text((*text).into()),
            AttributeValue::PerSegment(numbers) => Value::Text(joined(numbers)),
            AttributeValue::Number(_) | AttributeValue::None => Value::Null,
        };
        let attributes = attributes.iter().map(number);
        let axes = if layer.has_z { 3 } else { 2 };
        let each = |bytes: &mut Vec<u8>, flush: &mut dyn FnMut(&mut Vec<u8>) -> Result<()>| {
            for part in 0..parts {
                if kind != GeometryKind::Point {
                    bytes.extend_from_slice(&(geometry.count(part) as u32).to_le_bytes());
                }
                geometry.points(part, &mut |points| {
                    for coordinate in points.iter().flat_map(|point| &point[..axes]) {
                        bytes.extend_from_slice(&coordinate.to_le_bytes());
                    }
                    flush(bytes)
                })?;
            }
            Ok(())
        };
        if size <= HELD {
            each(&mut bytes, &mut |_| Ok(()))?;
            let row = std::iter::once(Value::Blob(bytes)).chain(attributes);
            let mut statement = connection.prepare_cached(insert).map_err(failed(path))?;
            return statement.execute(params_from_iter(row)).map(drop).map_err(failed(path));
        }
        // Zeros first, whose place the bytes take.
        let large = insert.replacen('?', "zeroblob(?)", 1);
        let row = std::iter::once(Value::Integer(size as i64)).chain(attributes);
        connection.execute(&large, params_from_iter(row)).map_err(failed(path))?;
        let fid = connection.last_insert_rowid();
        let mut blob =
            connection.blob_open("main", layer.name.as_str(), "geom", fid, false).map_err(failed(path))?;
        let mut at = 0;
        each(&mut bytes, &mut |bytes| {
            blob.write_all_at(bytes, at).map_err(failed(path))?;
            at += bytes.len();
            bytes.clear();
            Ok(())
        })?;
        blob.close().map_err(failed(path))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let GeoPackage { output, path, connection, .. } = *self;
        connection.execute_batch("COMMIT").map_err(failed(&path))?;
        connection.close().map_err(|(_, error)| failed(&path)(error))?;
        output.commit()
    }
}
