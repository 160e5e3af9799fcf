//! `FlatGeobuf`: contiguous features after a spatial index, which sequential reading skips.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use flatgeobuf::{
    ColumnType, Geometry, GeometryType, size_prefixed_root_as_feature, size_prefixed_root_as_header,
};

use super::feature::{
    AttributeType, Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader, FeatureSchema,
    RequestedAttributes,
};
use super::heights::Heights;
use super::wkb::MAX_DEPTH;
use crate::export::GeometryKind;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Maximum size of a header in bytes.
const MAX_HEADER: u64 = 10 << 20;

/// Size of an index node in bytes: a box and an offset.
const NODE: u64 = 40;

pub(super) struct FlatGeobuf {
    input: BufReader<File>,
    path: PathBuf,
    schema: FeatureSchema,
    /// Types of all columns, and their indices among the requested attributes.
    columns: Vec<(ColumnType, Option<usize>)>,
    /// Type of all geometries, or unknown.
    kind: GeometryType,
    /// Whether points have heights, and measures or times.
    has_heights: bool,
    has_measures: bool,
    /// Bytes not yet read.
    left: u64,
    memory: u64,
    number: u64,
    bytes: Vec<u8>,
}

/// Memory per byte of a feature: as read, as points, and as values.
const BYTES_FOR_BYTE: u64 = 4;

type Parsed<T> = std::result::Result<T, String>;

/// Returns whether a file has the magic bytes of version 3.
pub(super) fn is_one(first: &[u8]) -> bool {
    first.starts_with(b"fgb\x03fgb")
}

impl FlatGeobuf {
    pub(super) fn open(
        file: File,
        path: &Path,
        options: &FeatureOptions,
        wanted: &mut RequestedAttributes,
    ) -> Result<FlatGeobuf> {
        let length = file.metadata().map_err(Error::io(path, "read"))?.len();
        let mut input = BufReader::with_capacity(1 << 16, file);
        let wrong = |found: String| Error::corrupt(path, "header", found, "the header of a FlatGeobuf file");
        let mut head = [0; 12];
        input.read_exact(&mut head).map_err(Error::io(path, "read the header"))?;
        let bytes = u64::from(u32::from_le_bytes([head[8], head[9], head[10], head[11]]));
        if bytes > MAX_HEADER || bytes > length - 12 || bytes < 8 {
            return Err(wrong(format!("a header of {bytes} bytes in a file of {length}")));
        }
        // Alignment is relative to the size field.
        let mut head = head[8..].to_vec();
        head.resize(4 + bytes as usize, 0);
        input.read_exact(&mut head[4..]).map_err(Error::io(path, "read the header"))?;
        let header = size_prefixed_root_as_header(&head).map_err(|error| wrong(error.to_string()))?;
        let count = header.features_count();
        let index = index_bytes(count, header.index_node_size());
        let index = index.filter(|index| *index <= length - 12 - bytes);
        let index = index.ok_or_else(|| wrong(format!("{count} features in a file of {length} bytes")))?;
        input.seek_relative(index as i64).map_err(Error::io(path, "read"))?;
        let (mut columns, mut attributes) = (Vec::new(), Vec::new());
        for column in header.columns().iter().flatten() {
            let place = wanted.takes(column.name()).then_some(attributes.len());
            if place.is_some() {
                attributes.push((column.name().to_owned(), kind_of(column.type_())));
            }
            columns.push((column.type_(), place));
        }
        let own = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let name =
            header.name().filter(|name| !name.is_empty()).map(str::to_owned).or(own).unwrap_or_default();
        let kind = header.geometry_type();
        let schema = FeatureSchema {
            name,
            crs: system(header.crs()).map_err(wrong)?,
            attributes,
            kind: match kind {
                GeometryType::Point | GeometryType::MultiPoint => Some(GeometryKind::Point),
                GeometryType::LineString | GeometryType::MultiLineString => Some(GeometryKind::Line),
                GeometryType::Polygon | GeometryType::MultiPolygon => Some(GeometryKind::Polygon),
                _ => None,
            },
            // Streamed files do not declare the count.
            count: (count > 0).then_some(count),
        };
        let left = length - 12 - bytes - index;
        let has_heights = header.has_z();
        let has_measures = header.has_m() || header.has_t() || header.has_tm();
        let (path, memory, bytes) = (path.into(), options.memory, Vec::new());
        Ok(FlatGeobuf {
            input,
            path,
            schema,
            columns,
            kind,
            has_heights,
            has_measures,
            left,
            memory,
            number: 1,
            bytes,
        })
    }

    /// Reads the bytes of the next feature; returns whether there is one.
    fn step(&mut self) -> Result<bool> {
        match self.schema.count {
            Some(count) if self.number > count => return Ok(false),
            None if self.left == 0 => return Ok(false),
            _ => {}
        }
        let mut size = [0; 4];
        if self.left < 4 {
            return Err(self.wrong(format!("{} bytes before the end of the file", self.left)));
        }
        self.input.read_exact(&mut size).map_err(Error::io(&self.path, "read"))?;
        let size = u64::from(u32::from_le_bytes(size));
        self.left -= 4;
        if size > self.left {
            return Err(self.wrong(format!("a size of {size} bytes with {} left in the file", self.left)));
        }
        if size.saturating_mul(BYTES_FOR_BYTE) > self.memory {
            return Err(Error::TooLarge {
                path: self.path.clone(),
                what: format!("feature {}", self.number),
                needed: size.saturating_mul(BYTES_FOR_BYTE),
                limit: self.memory,
                advice: "allow more memory, or divide the feature".into(),
            });
        }
        self.left -= size;
        self.bytes.clear();
        self.bytes.extend_from_slice(&(size as u32).to_le_bytes());
        self.bytes.resize(4 + size as usize, 0);
        self.input.read_exact(&mut self.bytes[4..]).map_err(Error::io(&self.path, "read"))?;
        Ok(true)
    }

    fn wrong(&self, found: String) -> Error {
        let place = format!("feature {}", self.number);
        Error::corrupt(&self.path, place, found, "a feature of points, lines or polygons in FlatGeobuf")
    }

    fn feature(&self) -> Parsed<Feature> {
        let feature = size_prefixed_root_as_feature(&self.bytes).map_err(|error| error.to_string())?;
        if feature.columns().is_some_and(|columns| !columns.is_empty()) {
            return Err("columns that differ from the header's".into());
        }
        // Parts may be referenced more than once, so their total is limited.
        let mut left = self.bytes.len() / 8 + 1;
        let own = feature.geometry();
        let geometry =
            own.as_ref().map(|own| geometry_of(own, self.kind, &mut left, 0)).transpose()?.flatten();
        let mut attributes = vec![FeatureAttribute::None; self.schema.attributes.len()];
        let mut bytes = feature.properties().map(|own| own.bytes()).unwrap_or_default();
        while !bytes.is_empty() {
            let column = usize::from(u16::from_le_bytes(take(&mut bytes)?));
            let (kind, place) =
                *self.columns.get(column).ok_or_else(|| format!("an unknown column {column}"))?;
            let value = value(kind, &mut bytes)?;
            if let Some(place) = place {
                attributes[place] = value;
            }
        }
        let geometry = geometry.map(FeatureGeometry::checked).transpose()?;
        let mut heights = Heights::default();
        if geometry.is_some() {
            (heights.are_there, heights.have_measures) = (self.has_heights, self.has_measures);
        }
        if let (true, Some(geometry), Some(own)) = (self.has_heights, &geometry, &own) {
            let count = geometry.points().count();
            heights_of(own, count, &mut heights.of_points);
            if heights.of_points.len() != count {
                return Err(format!("{count} points and {} heights", heights.of_points.len()));
            }
        }
        Ok(Feature { id: None, attributes, geometry, heights })
    }
}

impl FeatureReader for FlatGeobuf {
    fn schema(&self) -> &FeatureSchema {
        &self.schema
    }

    fn next(&mut self) -> Result<Option<Feature>> {
        if !self.step()? {
            return Ok(None);
        }
        let feature = self.feature().map_err(|found| self.wrong(found))?;
        self.number += 1;
        Ok(Some(feature))
    }
}

/// Returns the index size for this number of features; `None` on overflow.
fn index_bytes(count: u64, node: u16) -> Option<u64> {
    if count == 0 || node == 0 {
        return Some(0);
    }
    if node == 1 {
        return None;
    }
    let (mut level, mut nodes) = (count, count);
    while level > 1 {
        level = level.div_ceil(u64::from(node));
        nodes = nodes.checked_add(level)?;
    }
    // The index of a single feature also has a root node.
    nodes.checked_add(u64::from(count == 1))?.checked_mul(NODE)
}

fn system(crs: Option<flatgeobuf::Crs<'_>>) -> Parsed<Option<Crs>> {
    let Some(crs) = crs else { return Ok(None) };
    let is_epsg = crs.org().is_none_or(|org| org.eq_ignore_ascii_case("EPSG"));
    match (u32::try_from(crs.code()), crs.wkt()) {
        (Ok(code @ 1..), _) if is_epsg => Ok(Some(Crs::epsg(code))),
        (_, Some(text)) if !text.is_empty() => Crs::parse(text).map(Some).map_err(|error| error.to_string()),
        (_, _) => match crs.code_string() {
            Some(text) if !text.is_empty() => Crs::parse(text).map(Some).map_err(|error| error.to_string()),
            _ => Ok(None),
        },
    }
}

fn kind_of(kind: ColumnType) -> AttributeType {
    match kind {
        ColumnType::Bool => AttributeType::Boolean,
        ColumnType::Float | ColumnType::Double => AttributeType::Number,
        ColumnType::String | ColumnType::DateTime | ColumnType::Binary => AttributeType::Text,
        ColumnType::Json => AttributeType::Json,
        _ => AttributeType::Integer,
    }
}

fn take<const BYTES: usize>(bytes: &mut &[u8]) -> Parsed<[u8; BYTES]> {
    let (taken, rest) = bytes.split_first_chunk().ok_or("truncated attributes")?;
    *bytes = rest;
    Ok(*taken)
}

fn value(kind: ColumnType, bytes: &mut &[u8]) -> Parsed<FeatureAttribute> {
    let whole = |number: i64| Ok(FeatureAttribute::Integer(number));
    match kind {
        ColumnType::Byte => whole(i8::from_le_bytes(take(bytes)?).into()),
        ColumnType::UByte => whole(u8::from_le_bytes(take(bytes)?).into()),
        ColumnType::Bool => Ok(FeatureAttribute::Boolean(take::<1>(bytes)? != [0])),
        ColumnType::Short => whole(i16::from_le_bytes(take(bytes)?).into()),
        ColumnType::UShort => whole(u16::from_le_bytes(take(bytes)?).into()),
        ColumnType::Int => whole(i32::from_le_bytes(take(bytes)?).into()),
        ColumnType::UInt => whole(u32::from_le_bytes(take(bytes)?).into()),
        ColumnType::Long => whole(i64::from_le_bytes(take(bytes)?)),
        ColumnType::ULong => {
            let number = u64::from_le_bytes(take(bytes)?);
            Ok(i64::try_from(number)
                .map_or_else(|_| FeatureAttribute::Json(number.to_string()), FeatureAttribute::Integer))
        }
        ColumnType::Float => Ok(FeatureAttribute::Number(f32::from_le_bytes(take(bytes)?).into())),
        ColumnType::Double => Ok(FeatureAttribute::Number(f64::from_le_bytes(take(bytes)?))),
        ColumnType::String | ColumnType::Json | ColumnType::DateTime | ColumnType::Binary => {
            let size = u32::from_le_bytes(take(bytes)?) as usize;
            let (own, rest) = bytes.split_at_checked(size).ok_or("truncated strings")?;
            *bytes = rest;
            match kind {
                ColumnType::Binary => {
                    Ok(FeatureAttribute::Text(own.iter().map(|byte| format!("{byte:02x}")).collect()))
                }
                ColumnType::Json => Ok(FeatureAttribute::Json(String::from_utf8_lossy(own).into_owned())),
                _ => Ok(FeatureAttribute::Text(String::from_utf8_lossy(own).into_owned())),
            }
        }
        other => Err(format!("an attribute of type {}", other.0)),
    }
}

/// Converts a geometry with at most `left` points and parts; `None` if there is none.
fn geometry_of(
    own: &Geometry<'_>,
    kind: GeometryType,
    left: &mut usize,
    depth: usize,
) -> Parsed<Option<FeatureGeometry>> {
    let kind = if own.type_() == GeometryType::Unknown { kind } else { own.type_() };
    let members = || own.parts().into_iter().flatten();
    if own.parts().is_some() && depth == MAX_DEPTH {
        return Err(format!("geometries nested {depth} deep"));
    }
    let mut take = |count: usize| {
        *left = left.checked_sub(count).ok_or("more points than the feature has bytes for")?;
        Ok::<(), String>(())
    };
    match kind {
        GeometryType::Unknown => Ok(None),
        GeometryType::Point | GeometryType::MultiPoint => {
            Ok(Some(FeatureGeometry::Points(points(own, &mut take)?)))
        }
        GeometryType::LineString => Ok(Some(FeatureGeometry::Lines(vec![points(own, &mut take)?]))),
        GeometryType::MultiLineString => Ok(Some(FeatureGeometry::Lines(rings(own, &mut take)?))),
        GeometryType::Polygon | GeometryType::Triangle => {
            Ok(Some(FeatureGeometry::Polygons(vec![rings(own, &mut take)?])))
        }
        GeometryType::MultiPolygon => {
            let mut parts = Vec::new();
            for part in members() {
                take(1)?;
                parts.push(rings(&part, &mut take)?);
            }
            Ok(Some(FeatureGeometry::Polygons(parts)))
        }
        GeometryType::GeometryCollection => {
            let mut found = Vec::new();
            take(members().count())?;
            for member in members() {
                found.extend(geometry_of(&member, GeometryType::Unknown, left, depth + 1)?);
            }
            Ok(Some(FeatureGeometry::Collection(found)))
        }
        GeometryType::PolyhedralSurface | GeometryType::TIN => Err("a 3D surface".into()),
        GeometryType(8..=14) => Err("a curve (convert it to lines: ogr2ogr -nlt CONVERT_TO_LINEAR)".into()),
        GeometryType(other) => Err(format!("a geometry of type {other}")),
    }
}

fn points(own: &Geometry<'_>, take: &mut dyn FnMut(usize) -> Parsed<()>) -> Parsed<Vec<[f64; 2]>> {
    let Some(numbers) = own.xy() else { return Ok(Vec::new()) };
    take(numbers.len() / 2)?;
    if numbers.len() % 2 == 1 {
        return Err("a point with one coordinate".into());
    }
    Ok((0..numbers.len() / 2).map(|index| [numbers.get(2 * index), numbers.get(2 * index + 1)]).collect())
}

/// Appends the heights of a geometry, up to `most + 1`. The recursion depth is bounded, since the
/// geometry has been read.
fn heights_of(own: &Geometry<'_>, most: usize, heights: &mut Vec<f64>) {
    for height in own.z().into_iter().flatten().take(most + 1 - heights.len().min(most + 1)) {
        heights.push(height);
    }
    for part in own.parts().into_iter().flatten() {
        if heights.len() > most {
            return;
        }
        heights_of(&part, most, heights);
    }
}

/// Returns the points, split into parts.
fn rings(own: &Geometry<'_>, take: &mut dyn FnMut(usize) -> Parsed<()>) -> Parsed<Vec<Vec<[f64; 2]>>> {
    let points = points(own, take)?;
    let Some(ends) = own.ends().filter(|ends| !ends.is_empty()) else { return Ok(vec![points]) };
    take(ends.len())?;
    let mut begin = 0;
    let ring = |end: u32| {
        let ring = points.get(begin..end as usize).map(<[_]>::to_vec);
        begin = end as usize;
        ring.ok_or_else(|| format!("a ring that ends at point {end} of {}", points.len()))
    };
    let rings: Vec<_> = ends.iter().map(ring).collect::<Parsed<_>>()?;
    if begin < points.len() { Err("points after the last ring".into()) } else { Ok(rings) }
}
