//! `GeoPackage` 1.3 (OGC 12-128r17): one feature table in an `SQLite` database, without a spatial
//! index.

use std::ops::Range;
use std::path::{Path, PathBuf};

use rusqlite::types::Value as Cell;
use rusqlite::{Connection, params, params_from_iter};

use serde_json::Value;

use super::geometry::Shape;
use super::{AttributeType, AttributeValue, FormatWriter, GeometryKind, VectorLayer};
use spinney_base::io::Output;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// WKT of WGS 84.
const WGS84: &str = "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563,AUTHORITY[\"EPSG\",\"7030\"]],\
  AUTHORITY[\"EPSG\",\"6326\"]],PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],UNIT[\"degree\",0.0174532925199433,\
  AUTHORITY[\"EPSG\",\"9122\"]],AUTHORITY[\"EPSG\",\"4326\"]]";

/// Tables that every file has. The application id is `GPKG`.
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

/// SRS id of a coordinate system that is in no registry.
const OWN: i64 = 100_000;

/// Timestamp of all files, constant so that output is reproducible.
const TIME: &str = "2000-01-01T00:00:00.000Z";

/// Maximum size in bytes of a geometry that is buffered; larger ones are streamed.
const HELD: u64 = 1 << 20;

pub(super) struct GeoPackage {
    output: Output,
    path: PathBuf,
    connection: Connection,
    layer: VectorLayer,
    srs: i64,
    insert: String,
    /// Minimum and maximum x and y of all features so far.
    bounds: [f64; 4],
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

/// Quotes an SQL identifier.
fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

impl GeoPackage {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<GeoPackage> {
        let Some(path) = output.unfinished_path().map(Path::to_path_buf) else {
            let advice = "write to a named file: GeoPackage is a database";
            return Err(Error::unsupported(output.path(), "writing GeoPackage to a stream", advice));
        };
        let connection = Connection::open(&path).map_err(failed(&path))?;
        // The unpublished file needs no database journal.
        let settings =
            "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; PRAGMA cache_size = -16384; BEGIN;";
        connection.execute_batch(&format!("{settings}{SCHEMA}")).map_err(failed(&path))?;
        let table = quoted(&layer.name);
        let column = |(name, kind): &(String, AttributeType)| {
            let kind = match kind {
                AttributeType::Integer => "INTEGER",
                AttributeType::Number => "DOUBLE",
                AttributeType::Boolean => "BOOLEAN",
                AttributeType::Text
                | AttributeType::Json
                | AttributeType::Mixed
                | AttributeType::PerSegment => "TEXT",
            };
            format!(", {} {kind}", quoted(name))
        };
        let geometry_type = match (layer.kind, layer.is_multi) {
            (Some(GeometryKind::Point), false) => "POINT",
            (Some(GeometryKind::Line), false) => "LINESTRING",
            (Some(GeometryKind::Polygon), false) => "POLYGON",
            (Some(GeometryKind::Point), true) => "MULTIPOINT",
            (Some(GeometryKind::Line), true) => "MULTILINESTRING",
            (Some(GeometryKind::Polygon), true) => "MULTIPOLYGON",
            (None, _) => "GEOMETRY",
        };
        let columns: String = layer.attributes.iter().map(column).collect();
        let create =
            format!("CREATE TABLE {table} (fid INTEGER PRIMARY KEY NOT NULL, geom {geometry_type}{columns})");
        let placeholders = ", ?".repeat(layer.attributes.len());
        let insert = format!("INSERT INTO {table} VALUES (?, ?{placeholders})");
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
        let bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        Ok(GeoPackage { output, path, connection, layer, srs, insert, bounds })
    }
}

/// Returns name, id, registry and definition of a coordinate system.
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

/// Writer of well-known binary: a buffer, and the function that flushes it.
struct Binary<'a> {
    bytes: Vec<u8>,
    flush: &'a mut dyn FnMut(&mut Vec<u8>) -> Result<()>,
    axes: usize,
    /// Minimum and maximum x and y of all points so far.
    bounds: &'a mut [f64; 4],
}

impl Binary<'_> {
    /// Starts a geometry: byte order (little-endian) and type.
    fn begin(&mut self, code: u32) {
        self.bytes.push(1);
        let code = code + if self.axes == 3 { 1000 } else { 0 };
        self.bytes.extend_from_slice(&code.to_le_bytes());
    }

    fn number(&mut self, number: u64) {
        self.bytes.extend_from_slice(&(number as u32).to_le_bytes());
    }

    /// Writes a geometry, as a multi-geometry or collection if the layer or the geometry has
    /// several members.
    fn shape(&mut self, shape: &Shape<'_>, is_multi: bool) -> Result<()> {
        match (shape.kind, &shape.members[..]) {
            (Some(GeometryKind::Point), []) if !is_multi => {
                self.begin(1);
                let nowhere = f64::NAN.to_le_bytes().repeat(self.axes);
                self.bytes.extend_from_slice(&nowhere);
            }
            (Some(kind), []) if !is_multi => {
                self.begin(code(kind));
                self.number(0);
            }
            (Some(_), [(kind, parts)]) if !is_multi => self.member(shape, *kind, parts.clone())?,
            (kind, members) => {
                self.begin(kind.map_or(7, |kind| code(kind) + 3));
                self.number(members.len() as u64);
                members.iter().try_for_each(|(kind, parts)| self.member(shape, *kind, parts.clone()))?;
            }
        }
        Ok(())
    }

    fn member(&mut self, shape: &Shape<'_>, kind: GeometryKind, parts: Range<usize>) -> Result<()> {
        self.begin(code(kind));
        if kind == GeometryKind::Polygon {
            self.number(parts.len() as u64);
        }
        for part in parts {
            if kind != GeometryKind::Point {
                self.number(shape.geometry.count(part));
            }
            shape.geometry.points(part, &mut |points| {
                for [x, y, _] in points {
                    let [west, south, east, north] = *self.bounds;
                    *self.bounds = [west.min(*x), south.min(*y), east.max(*x), north.max(*y)];
                }
                for coordinate in points.iter().flat_map(|point| &point[..self.axes]) {
                    self.bytes.extend_from_slice(&coordinate.to_le_bytes());
                }
                (self.flush)(&mut self.bytes)
            })?;
        }
        Ok(())
    }
}

fn code(kind: GeometryKind) -> u32 {
    match kind {
        GeometryKind::Point => 1,
        GeometryKind::Line => 2,
        GeometryKind::Polygon => 3,
    }
}

/// Returns the size of a geometry in well-known binary.
fn size_of(shape: &Shape<'_>, is_multi: bool, axes: usize) -> u64 {
    let own = |(kind, parts): &(GeometryKind, Range<usize>)| match kind {
        GeometryKind::Point => 5,
        GeometryKind::Line => 9,
        GeometryKind::Polygon => 9 + 4 * parts.len() as u64,
    };
    let members: u64 = shape.members.iter().map(own).sum();
    let is_one = shape.kind.is_some() && shape.members.len() == 1 && !is_multi;
    let around = match (is_one, shape.kind) {
        (true, _) => 0,
        (false, Some(GeometryKind::Point)) if shape.members.is_empty() && !is_multi => 5 + 8 * axes as u64,
        (false, _) => 9,
    };
    shape.count().saturating_mul(8 * axes as u64).saturating_add(members + around)
}

impl FormatWriter for GeoPackage {
    fn write(
        &mut self,
        id: Option<&Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let GeoPackage { path, connection, layer, srs, insert, bounds, .. } = self;
        let is_multi = layer.is_multi && layer.kind.is_some();
        let axes = if layer.has_z { 3 } else { 2 };
        let size = shape.map_or(0, |shape| size_of(shape, is_multi, axes).saturating_add(8));
        if size > 1_000_000_000 {
            let advice = "choose another format: SQLite values have at most 1 GB";
            return Err(Error::unsupported(self.output.path(), format!("a feature of {size} bytes"), advice));
        }
        let fid = match id {
            None => Cell::Null,
            Some(id) => match id.as_i64() {
                Some(id) => Cell::Integer(id),
                None => {
                    let expected = "an integer (write other ids as an attribute)";
                    return Err(Error::invalid("feature id in a GeoPackage", id.to_string(), expected));
                }
            },
        };
        let cell = |value: &AttributeValue<'_>| match value.finite_or_none() {
            AttributeValue::None => Cell::Null,
            AttributeValue::Integer(number) => Cell::Integer(number),
            AttributeValue::Number(number) => Cell::Real(number),
            AttributeValue::Boolean(is) => Cell::Integer(is.into()),
            other => Cell::Text(other.to_text()),
        };
        let cells = attributes.iter().map(cell);
        let failed = |error: rusqlite::Error| match (error.sqlite_error_code(), id) {
            (Some(rusqlite::ErrorCode::ConstraintViolation), Some(id)) => {
                Error::invalid("feature ids", format!("{id} more than once"), "unique ids in a GeoPackage")
            }
            _ => failed(path)(error),
        };
        let Some(shape) = shape else {
            let row = [fid, Cell::Null].into_iter().chain(cells);
            let mut statement = connection.prepare_cached(insert).map_err(failed)?;
            return statement.execute(params_from_iter(row)).map(drop).map_err(failed);
        };
        // The GeoPackage header, little-endian and without an envelope, is followed by well-known
        // binary.
        let mut header = b"GP\0".to_vec();
        header.push(if shape.members.is_empty() { 0x11 } else { 1 });
        header.extend_from_slice(&(*srs as i32).to_le_bytes());
        if size <= HELD {
            let mut binary = Binary { bytes: header, flush: &mut |_| Ok(()), axes, bounds };
            binary.shape(shape, is_multi)?;
            let row = [fid, Cell::Blob(binary.bytes)].into_iter().chain(cells);
            let mut statement = connection.prepare_cached(insert).map_err(failed)?;
            return statement.execute(params_from_iter(row)).map(drop).map_err(failed);
        }
        // Insert zeros, and overwrite them with the geometry.
        let large = insert.replacen("(?, ?", "(?, zeroblob(?)", 1);
        let row = [fid, Cell::Integer(size as i64)].into_iter().chain(cells);
        connection.execute(&large, params_from_iter(row)).map_err(failed)?;
        let fid = connection.last_insert_rowid();
        let mut blob =
            connection.blob_open("main", layer.name.as_str(), "geom", fid, false).map_err(failed)?;
        let mut at = 0;
        let mut flush = |bytes: &mut Vec<u8>| {
            blob.write_all_at(bytes, at).map_err(failed)?;
            at += bytes.len();
            bytes.clear();
            Ok(())
        };
        let mut binary = Binary { bytes: header, flush: &mut flush, axes, bounds };
        binary.shape(shape, is_multi)?;
        let mut rest = binary.bytes;
        flush(&mut rest)?;
        blob.close().map_err(failed)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let GeoPackage { output, path, connection, bounds, layer, .. } = *self;
        if bounds[0] <= bounds[2] {
            let update = "UPDATE gpkg_contents SET min_x = ?1, min_y = ?2, max_x = ?3, max_y = ?4 WHERE table_name = ?5";
            let [west, south, east, north] = bounds;
            connection
                .execute(update, params![west, south, east, north, layer.name])
                .map_err(failed(&path))?;
        }
        connection.execute_batch("COMMIT").map_err(failed(&path))?;
        connection.close().map_err(|(_, error)| failed(&path)(error))?;
        output.commit()
    }
}
