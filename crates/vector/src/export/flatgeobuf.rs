//! `FlatGeobuf` (version 3): features in Hilbert curve order, after an index of their bounding
//! boxes (a packed Hilbert R-tree, <https://flatgeobuf.org>).
//!
//! Features and index nodes are buffered in temporary files, so memory does not grow with either.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use flatbuffers::{FlatBufferBuilder, WIPOffset};
use flatgeobuf::{
    Column, ColumnArgs, ColumnType, Crs as FlatCrs, CrsArgs, Feature, FeatureArgs, Geometry as FlatGeometry,
    GeometryArgs, GeometryType, Header, HeaderArgs,
};
use serde_json::Value;

use super::geometry::Shape;
use super::{AttributeType, AttributeValue, FormatWriter, GeometryKind, VectorLayer};
use spinney_base::io::platform::read_exact_at;
use spinney_base::io::spill::failed;
use spinney_base::io::{Output, Sorter, Spool, SpooledWords, WordSpooler};
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Maximum number of points in a feature, which is assembled in memory.
const MAX_POINTS: u64 = 1 << 22;

/// Maximum number of children of an index node.
const NODE_SIZE: u64 = 16;

/// Memory for sorting, in bytes.
const MEMORY: u64 = 32 << 20;

/// Bytes of features that are written at a time.
const BUFFER: usize = 1 << 20;

/// Magic bytes of a file.
const MAGIC: &[u8] = b"fgb\x03fgb\x00";

/// Size of a sorted item in bytes: key, offset, size and box.
const ITEM: usize = 8 + 8 + 8 + 32;

pub(super) struct FlatGeobuf {
    output: Output,
    layer: VectorLayer,
    /// Temporary file of the features, in input order.
    file: File,
    /// The last features, which are not in the file yet.
    buffer: Vec<u8>,
    length: u64,
    items: Sorter,
    /// Whether all features have a geometry; otherwise there is no index.
    all_have_geometry: bool,
    extent: NodeBox,
    /// Bounding box of the current feature.
    around: NodeBox,
    builder: FlatBufferBuilder<'static>,
    coordinates: [Vec<f64>; 2],
    properties: Vec<u8>,
}

/// Minimum and maximum x and y.
#[derive(Clone, Copy)]
struct NodeBox([f64; 4]);

impl NodeBox {
    const NOTHING: NodeBox = NodeBox([f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY]);

    fn with(self, other: NodeBox) -> NodeBox {
        let (NodeBox([west, south, east, north]), NodeBox(own)) = (self, other);
        NodeBox([west.min(own[0]), south.min(own[1]), east.max(own[2]), north.max(own[3])])
    }

    fn bytes(&self) -> [u8; 32] {
        let mut bytes = [0; 32];
        for (slot, number) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(self.0) {
            *slot = number.to_le_bytes();
        }
        bytes
    }
}

impl FlatGeobuf {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<FlatGeobuf> {
        // Values refer to their columns by 16-bit numbers.
        if layer.attributes.len() > 1 << 16 {
            let found = format!("{} attributes", layer.attributes.len());
            return Err(Error::unsupported(
                output.path(),
                found,
                "select fewer attributes, or choose GeoJSON",
            ));
        }
        let directory = output.temporary_directory();
        let file =
            tempfile::tempfile_in(&directory).map_err(Error::io(&directory, "create a temporary file in"))?;
        Ok(FlatGeobuf {
            output,
            layer,
            file,
            buffer: Vec::new(),
            length: 0,
            items: Sorter::new(&directory, MEMORY),
            all_have_geometry: true,
            extent: NodeBox::NOTHING,
            around: NodeBox::NOTHING,
            builder: FlatBufferBuilder::new(),
            coordinates: [Vec::new(), Vec::new()],
            properties: Vec::new(),
        })
    }

    /// Returns the geometry type of the header.
    fn kind(&self) -> GeometryType {
        self.layer.kind.map_or(GeometryType::Unknown, |kind| type_of(kind, self.layer.is_multi))
    }

    /// Returns the header, preceded by its size.
    fn header(&self) -> Vec<u8> {
        let mut builder = FlatBufferBuilder::new();
        let crs = self.layer.crs.as_ref();
        let epsg = crs.and_then(Crs::numbers);
        let text = crs.and_then(|crs| crs.to_wkt2().ok().or_else(|| crs.foreign_text()));
        let name = crs.and_then(Crs::name);
        let crs = CrsArgs {
            org: epsg.map(|_| builder.create_string("EPSG")),
            code: epsg.map_or(0, |epsg| epsg.horizontal as i32),
            name: name.map(|name| builder.create_string(&name)),
            wkt: text.map(|text| builder.create_string(&text)),
            ..CrsArgs::default()
        };
        let crs = FlatCrs::create(&mut builder, &crs);
        let mut columns = Vec::new();
        for (name, kind) in &self.layer.attributes {
            let name = Some(builder.create_string(name));
            let column = ColumnArgs { name, type_: column_type(*kind), ..ColumnArgs::default() };
            columns.push(Column::create(&mut builder, &column));
        }
        let columns = builder.create_vector(&columns);
        let envelope = self.has_index().then(|| builder.create_vector(&self.extent.0));
        let name = builder.create_string(&self.layer.name);
        let header = HeaderArgs {
            name: Some(name),
            envelope,
            geometry_type: self.kind(),
            has_z: self.layer.has_z,
            columns: Some(columns),
            features_count: self.items.len(),
            index_node_size: if self.has_index() { NODE_SIZE as u16 } else { 0 },
            crs: Some(crs),
            ..HeaderArgs::default()
        };
        let header = Header::create(&mut builder, &header);
        builder.finish_size_prefixed(header, None);
        builder.finished_data().to_vec()
    }

    fn has_index(&self) -> bool {
        self.all_have_geometry && !self.items.is_empty()
    }

    /// Adds parts to the current feature, as one geometry.
    fn parts(
        &mut self,
        shape: &Shape<'_>,
        parts: std::ops::Range<usize>,
        kind: GeometryType,
    ) -> Result<WIPOffset<FlatGeometry<'static>>> {
        let ([flat, heights], around) = (&mut self.coordinates, &mut self.around);
        flat.clear();
        heights.clear();
        let has_z = self.layer.has_z;
        let mut ends = Vec::with_capacity(parts.len());
        for part in parts {
            shape.geometry.points(part, &mut |points| {
                for [x, y, z] in points {
                    *around = around.with(NodeBox([*x, *y, *x, *y]));
                    flat.extend_from_slice(&[*x, *y]);
                    if has_z {
                        heights.push(*z);
                    }
                }
                Ok(())
            })?;
            ends.push((flat.len() / 2) as u32);
        }
        let builder = &mut self.builder;
        // Without `ends`, all points belong to one part.
        let is_divided = ends.len() > 1 && kind != GeometryType::MultiPoint;
        let ends = is_divided.then(|| builder.create_vector(&ends));
        let xy = Some(builder.create_vector(flat));
        let z = has_z.then(|| builder.create_vector(heights));
        Ok(FlatGeometry::create(
            builder,
            &GeometryArgs { ends, xy, z, type_: kind, ..GeometryArgs::default() },
        ))
    }

    fn geometry(&mut self, shape: &Shape<'_>) -> Result<WIPOffset<FlatGeometry<'static>>> {
        let is_typed = self.layer.kind.is_some();
        let is_multi = if is_typed { self.layer.is_multi } else { shape.members.len() > 1 };
        let own = shape.kind.map_or(GeometryType::GeometryCollection, |kind| type_of(kind, is_multi));
        let members = match (shape.kind, is_multi) {
            (Some(GeometryKind::Polygon), true) | (None, _) => &shape.members[..],
            _ => return self.parts(shape, 0..shape.geometry.parts(), own),
        };
        let mut parts = Vec::with_capacity(members.len());
        for (kind, rings) in members {
            parts.push(self.parts(shape, rings.clone(), type_of(*kind, false))?);
        }
        let parts = Some(self.builder.create_vector(&parts));
        let geometry = GeometryArgs { parts, type_: own, ..GeometryArgs::default() };
        Ok(FlatGeometry::create(&mut self.builder, &geometry))
    }

    /// Returns the Hilbert curve position of a box's centre within the layer's bounds.
    fn key(&self, around: NodeBox) -> u64 {
        let [[west, south], [east, north]] = self.layer.bounds;
        let NodeBox([left, bottom, right, top]) = around;
        let cell = |at: f64, low: f64, high: f64| {
            // NaN and positions outside the bounds also get a key.
            (65_535.0 * ((at - low) / (high - low)).clamp(0.0, 1.0)) as u32
        };
        hilbert(cell((left + right) / 2.0, west, east), cell((bottom + top) / 2.0, south, north))
    }

    fn flush(&mut self) -> Result<()> {
        let written = self.file.write_all(&self.buffer);
        written.map_err(failed(self.output.path()))?;
        self.buffer.clear();
        Ok(())
    }
}

/// Returns the Hilbert curve position of a cell in a grid of 2^16 x 2^16.
fn hilbert(mut x: u32, mut y: u32) -> u64 {
    let mut position = 0;
    for level in (0..16).rev() {
        let side = 1u32 << level;
        let (right, up) = (x & side > 0, y & side > 0);
        position = position << 2 | (u64::from(right) * 3) ^ u64::from(up);
        if !up {
            if right {
                (x, y) = (side.wrapping_sub(1).wrapping_sub(x), side.wrapping_sub(1).wrapping_sub(y));
            }
            (x, y) = (y, x);
        }
    }
    position
}

fn type_of(kind: GeometryKind, is_multi: bool) -> GeometryType {
    match (kind, is_multi) {
        (GeometryKind::Point, false) => GeometryType::Point,
        (GeometryKind::Line, false) => GeometryType::LineString,
        (GeometryKind::Polygon, false) => GeometryType::Polygon,
        (GeometryKind::Point, true) => GeometryType::MultiPoint,
        (GeometryKind::Line, true) => GeometryType::MultiLineString,
        (GeometryKind::Polygon, true) => GeometryType::MultiPolygon,
    }
}

fn column_type(kind: AttributeType) -> ColumnType {
    match kind {
        AttributeType::Integer => ColumnType::Long,
        AttributeType::Number => ColumnType::Double,
        AttributeType::Boolean => ColumnType::Bool,
        AttributeType::Json => ColumnType::Json,
        AttributeType::Text | AttributeType::Mixed | AttributeType::PerSegment => ColumnType::String,
    }
}

/// Appends the value of a column.
fn push_property(bytes: &mut Vec<u8>, column: usize, kind: AttributeType, value: AttributeValue<'_>) {
    let value = value.finite_or_none();
    if value == AttributeValue::None {
        return;
    }
    bytes.extend_from_slice(&(column as u16).to_le_bytes());
    match (kind, value) {
        (AttributeType::Number, AttributeValue::Number(number)) => {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        (AttributeType::Number, AttributeValue::Integer(number)) => {
            bytes.extend_from_slice(&(number as f64).to_le_bytes());
        }
        (AttributeType::Integer, AttributeValue::Integer(number)) => {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        (AttributeType::Boolean, AttributeValue::Boolean(is)) => bytes.push(is.into()),
        (_, value) => {
            let text = value.to_text();
            bytes.extend_from_slice(&(text.len() as u32).to_le_bytes());
            bytes.extend_from_slice(text.as_bytes());
        }
    }
}

impl FormatWriter for FlatGeobuf {
    fn write(
        &mut self,
        _id: Option<&Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let points = shape.map_or(0, Shape::count);
        if points > MAX_POINTS {
            let advice = "choose GeoPackage, which streams large features";
            let found = format!("a feature of {points} points");
            return Err(Error::unsupported(self.output.path(), found, advice));
        }
        self.builder.reset();
        self.around = NodeBox::NOTHING;
        let geometry = shape.map(|shape| self.geometry(shape)).transpose()?;
        let around = self.around;
        self.all_have_geometry &= points > 0;
        self.extent = self.extent.with(around);
        let mut properties = std::mem::take(&mut self.properties);
        properties.clear();
        for (column, ((_, kind), value)) in self.layer.attributes.iter().zip(attributes).enumerate() {
            push_property(&mut properties, column, *kind, *value);
        }
        let encoded = (!properties.is_empty()).then(|| self.builder.create_vector(&properties));
        self.properties = properties;
        let feature = FeatureArgs { geometry, properties: encoded, ..FeatureArgs::default() };
        let feature = Feature::create(&mut self.builder, &feature);
        self.builder.finish_size_prefixed(feature, None);
        let bytes = self.builder.finished_data();
        let size = bytes.len() as u64;
        self.buffer.extend_from_slice(bytes);
        let mut item = Vec::with_capacity(ITEM);
        for number in [self.key(around), self.length, size] {
            item.extend_from_slice(&number.to_be_bytes());
        }
        item.extend_from_slice(&around.bytes());
        let key = u64::from_be_bytes(item[..8].try_into().expect("eight bytes"));
        self.items.push(key, &item)?;
        self.length += size;
        if self.buffer.len() >= BUFFER { self.flush() } else { Ok(()) }
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.flush()?;
        let path = self.output.path().to_path_buf();
        let header = self.header();
        self.output.write_all(MAGIC).map_err(failed(&path))?;
        self.output.write_all(&header).map_err(failed(&path))?;
        let has_index = self.has_index();
        let FlatGeobuf { mut output, file, items, length, .. } = *self;
        let features = Features { file, path: path.clone() };
        if has_index {
            let directory = output.temporary_directory();
            let (index, order) = Index::of(items, &directory)?;
            index.write(&mut output)?;
            order.each(&mut |words| features.copy(&mut byte_ranges(words), &mut output))?;
        } else {
            features.copy(&mut std::iter::once((0, length)), &mut output)?;
        }
        output.commit()
    }
}

/// Decodes offsets and sizes of features.
fn byte_ranges(words: &[u32]) -> impl Iterator<Item = (u64, u64)> {
    let number = |words: [u32; 2]| u64::from(words[0]) | u64::from(words[1]) << 32;
    words.as_chunks::<4>().0.iter().map(move |[a, b, c, d]| (number([*a, *b]), number([*c, *d])))
}

fn words(number: u64) -> [u32; 2] {
    [number as u32, (number >> 32) as u32]
}

/// Buffered features in a temporary file.
struct Features {
    file: File,
    path: PathBuf,
}

impl Features {
    /// Copies features to the output in the given order. Contiguous ones are copied together.
    fn copy(&self, ranges: &mut dyn Iterator<Item = (u64, u64)>, output: &mut Output) -> Result<()> {
        let mut buffer = vec![0; BUFFER];
        let mut ranges = ranges.peekable();
        while let Some((from, size)) = ranges.next() {
            let mut until = from + size;
            while let Some((_, more)) = ranges.next_if(|(next, _)| *next == until) {
                until += more;
            }
            let mut at = from;
            while at < until {
                let chunk = &mut buffer[..(until - at).min(BUFFER as u64) as usize];
                read_exact_at(&self.file, chunk, at).map_err(failed(&self.path))?;
                output.write_all(chunk).map_err(failed(&self.path))?;
                at += chunk.len() as u64;
            }
        }
        Ok(())
    }
}

/// Index nodes of all levels, leaves first. A leaf stores its box and its feature's offset; an
/// inner node, its box and the index of its first child.
struct Index {
    levels: Vec<SpooledWords>,
}

/// Level under construction.
struct Level {
    nodes: WordSpooler,
    count: u64,
    /// Bounding box of the nodes since the last node of the level above.
    around: NodeBox,
}

/// Size of a node in 32-bit words.
const NODE: usize = 10;

impl Index {
    /// Builds the index of the features, and returns it with their offsets and sizes in index
    /// order.
    fn of(items: Sorter, directory: &Path) -> Result<(Index, SpooledWords)> {
        let spool = Spool::create(directory, NODE)?;
        let mut order = WordSpooler::new(&Spool::create(directory, 4)?);
        let new = || Level { nodes: WordSpooler::new(&spool), count: 0, around: NodeBox::NOTHING };
        let mut levels = vec![new()];
        let mut length = 0;
        items.finish(&mut |item| {
            let (numbers, around) = item.split_at(24);
            let numbers = numbers.as_chunks::<8>().0;
            let [offset, size] = [1, 2].map(|index| u64::from_be_bytes(numbers[index]));
            let numbers = around.as_chunks::<8>().0;
            let around = NodeBox(std::array::from_fn(|index| f64::from_le_bytes(numbers[index])));
            order.push([words(offset), words(size)].as_flattened())?;
            let (mut around, mut own) = (around, length);
            length += size;
            for depth in 0.. {
                if depth == levels.len() {
                    levels.push(new());
                }
                let level = &mut levels[depth];
                level.push(around, own)?;
                if level.count % NODE_SIZE != 0 {
                    break;
                }
                (around, own) =
                    (std::mem::replace(&mut level.around, NodeBox::NOTHING), level.count - NODE_SIZE);
            }
            Ok(())
        })?;
        // Incomplete nodes. There is at least one level above the features.
        let mut depth = 0;
        while depth + 1 < levels.len() || levels[depth].count > 1 || depth == 0 {
            if depth + 1 == levels.len() {
                levels.push(new());
            }
            let level = &mut levels[depth];
            let left = level.count % NODE_SIZE;
            if left > 0 {
                let (around, first) = (level.around, level.count - left);
                levels[depth + 1].push(around, first)?;
            }
            depth += 1;
        }
        let levels = levels.into_iter().map(|level| level.nodes.finish()).collect::<Result<_>>()?;
        Ok((Index { levels }, order.finish()?))
    }

    /// Writes the nodes, starting at the root.
    fn write(&self, output: &mut Output) -> Result<()> {
        let path = output.path().to_path_buf();
        // Child indices are also counted from the root.
        let mut first_child = 0;
        for (depth, level) in self.levels.iter().enumerate().rev() {
            first_child += (level.len() / NODE) as u64;
            level.each(&mut |nodes| {
                let mut bytes = Vec::with_capacity(4 * nodes.len());
                for node in nodes.as_chunks::<NODE>().0 {
                    let (around, own) = node.split_at(8);
                    let own = u64::from(own[0]) | u64::from(own[1]) << 32;
                    let own = if depth > 0 { own + first_child } else { own };
                    bytes.extend(around.iter().flat_map(|word| word.to_le_bytes()));
                    bytes.extend_from_slice(&own.to_le_bytes());
                }
                output.write_all(&bytes).map_err(failed(&path))
            })?;
        }
        Ok(())
    }
}

impl Level {
    fn push(&mut self, around: NodeBox, own: u64) -> Result<()> {
        let bytes = around.bytes();
        let mut node = [0; NODE];
        for (word, bytes) in node.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *word = u32::from_le_bytes(*bytes);
        }
        [node[8], node[9]] = words(own);
        self.count += 1;
        self.around = self.around.with(around);
        self.nodes.push(&node)
    }
}
