//! Headers of LAS files that are written from a tree.

use std::io::Cursor;
use std::path::Path;

use las::{Version, raw};

use super::format::{
    MAX_FORMAT, SCAN_ANGLE, SCAN_ANGLE_RANK, angle_of_rank, describe_extra, record_bytes, record_layout,
};
use crate::attribute::{PointAttribute, RowLayout};
use crate::grid::PointGrid;
use crate::source::{both_bounds, bounds_of};
use crate::store::PointTree;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_container::Metadata;

/// Header of a file to be written, and the counts that go into it.
pub(crate) struct LasFile {
    header: raw::Header,
    records: Vec<raw::Vlr>,
    layout: RowLayout,
    grid: PointGrid,
    format: u8,
    points: u64,
    by_return: [u64; 15],
    bounds: Option<[[i32; 3]; 2]>,
    return_number: Option<usize>,
}

/// Mapping of a tree's columns to record fields.
pub(crate) struct Fields {
    layout: RowLayout,
    /// Column and conversion of each record attribute; `None` where the tree has no such attribute.
    columns: Vec<Option<(usize, Conversion)>>,
}

/// Conversion of an attribute's numbers to those of a record.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Conversion {
    /// No conversion.
    None,
    /// 8-bit colours have 16 bits in LAS: 255 becomes 65535.
    Colour,
    /// Scan angles in degrees become units of 0.006 degrees, for point formats 6 and above.
    ScanAngle,
}

impl Conversion {
    #[inline]
    fn of(self, number: i64) -> i64 {
        match self {
            Conversion::None => number,
            Conversion::Colour => number * 257,
            Conversion::ScanAngle => angle_of_rank(number),
        }
    }
}

const COLOURS: [&str; 3] = ["red", "green", "blue"];

impl Fields {
    /// Converts columns to records.
    pub(crate) fn rows(&self, columns: &[Vec<i64>], rows: &mut Vec<u8>) {
        rows.clear();
        rows.resize(columns[0].len() * self.layout.size, 0);
        let chunks = |rows: &mut Vec<u8>, put: &mut dyn FnMut(usize, &mut [u8])| {
            rows.chunks_exact_mut(self.layout.size).enumerate().for_each(|(point, row)| put(point, row));
        };
        for (axis, numbers) in columns[..3].iter().enumerate() {
            let at = 4 * axis;
            chunks(rows, &mut |point, row| {
                row[at..at + 4].copy_from_slice(&(numbers[point] as i32).to_le_bytes())
            });
        }
        for (attribute, column) in self.columns.iter().enumerate() {
            if let Some((column, conversion)) = column {
                chunks(rows, &mut |point, row| {
                    self.layout.set_number(attribute, row, conversion.of(columns[*column][point]))
                });
            }
        }
    }
}

/// An attribute to be written, with its minimum and maximum.
#[derive(Clone, Copy)]
struct OutputAttribute<'t> {
    attribute: &'t PointAttribute,
    least: i64,
    most: i64,
}

impl OutputAttribute<'_> {
    /// Returns the index of the format's attribute with the same name, if its type can represent
    /// all numbers.
    fn index(&self, format: &RowLayout) -> Option<usize> {
        let index = format.position(&self.attribute.name)?;
        let own = format.attributes[index].sample;
        let (least, most) = match (format.fields[index].bits, own) {
            (Some((_, bits)), _) => (0, (1 << bits) - 1),
            (None, SampleType::U8) => (0, u8::MAX.into()),
            (None, SampleType::I8) => (i8::MIN.into(), i8::MAX.into()),
            (None, SampleType::U16) => (0, u16::MAX.into()),
            (None, SampleType::I16) => (i16::MIN.into(), i16::MAX.into()),
            (None, SampleType::U32) => (0, u32::MAX.into()),
            (None, _) => return Some(index).filter(|_| own == self.attribute.sample),
        };
        // For these types, ordered numbers equal the numbers.
        let is_whole = !matches!(self.attribute.sample, SampleType::F32 | SampleType::F64 | SampleType::U64);
        let fits = least <= self.least && self.most <= most || self.least > self.most;
        let is_plain = self.attribute.scale_offset.is_none() && self.attribute.no_data.is_none();
        (is_whole && fits && is_plain).then_some(index)
    }
}

/// Maps attributes to those of a format, one to one; `None` for those that become extra bytes.
fn matching_fields(
    attributes: &[OutputAttribute<'_>],
    format: &RowLayout,
) -> Vec<Option<(usize, Conversion)>> {
    let is_short = |name: &&str| {
        let mut own = attributes.iter().filter(|written| written.attribute.name == **name);
        own.all(|written| written.attribute.sample == SampleType::U8)
    };
    let are_short = COLOURS.iter().all(is_short);
    let mut found: Vec<Option<(usize, Conversion)>> = Vec::new();
    for written in attributes {
        let is_colour = are_short && COLOURS.contains(&written.attribute.name.as_str());
        let conversion = if is_colour { Conversion::Colour } else { Conversion::None };
        let index = written.index(format).map(|index| (index, conversion));
        found.push(index.filter(|(index, _)| found.iter().flatten().all(|(other, _)| other != index)));
    }
    // Scan angles of old formats map to those of new formats, unless these are taken.
    let angle = format.position(SCAN_ANGLE);
    let is_free = found.iter().flatten().all(|(index, _)| Some(*index) != angle);
    let rank = attributes.iter().position(|written| {
        written.attribute.name == SCAN_ANGLE_RANK
            && *written.attribute == PointAttribute::new(SCAN_ANGLE_RANK, SampleType::I8)
    });
    if let (Some(angle), Some(rank), true) = (angle, rank, is_free) {
        found[rank] = Some((angle, Conversion::ScanAngle));
    }
    found
}

/// Returns the point format that has fields for the most attributes. Of several, it prefers the
/// input's format, then the lowest number.
fn best_format(attributes: &[OutputAttribute<'_>], came_in: Option<u8>) -> u8 {
    let candidates: Vec<u8> = came_in.into_iter().chain(6..=MAX_FORMAT).collect();
    let matches = |format: &u8| {
        let layout = record_layout(*format, record_bytes(*format).unwrap_or(0), &[]);
        matching_fields(attributes, &layout).into_iter().flatten().count()
    };
    let most = candidates.iter().map(matches).max().unwrap_or(0);
    candidates.into_iter().find(|format| matches(format) == most).unwrap_or(6)
}

fn tag<'m>(metadata: &'m Metadata, key: &str) -> Option<&'m str> {
    metadata.tags.get(&format!("las.{key}")).map(String::as_str)
}

fn bytes_of_hexadecimal(text: &str) -> Option<Vec<u8>> {
    let digit = |byte: u8| char::from(byte).to_digit(16).map(|digit| digit as u8);
    let pairs = text.as_bytes().as_chunks::<2>();
    pairs
        .0
        .iter()
        .map(|[high, low]| Some(digit(*high)? << 4 | digit(*low)?))
        .collect::<Option<Vec<u8>>>()
        .filter(|_| pairs.1.is_empty())
}

fn padded<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    let count = text.len().min(N);
    bytes[..count].copy_from_slice(&text.as_bytes()[..count]);
    bytes
}

fn record(user: &str, number: u16, description: &str, data: Vec<u8>) -> raw::Vlr {
    raw::Vlr {
        reserved: 0,
        user_id: padded(user),
        record_id: number,
        record_length_after_header: raw::vlr::RecordLength::Vlr(data.len().min(u16::MAX.into()) as u16),
        description: padded(description),
        data,
    }
}

impl LasFile {
    /// Creates the file for a tree's points with some of its attributes, and the mapping of the
    /// attributes.
    pub(crate) fn of(tree: &PointTree, chosen: &[usize]) -> Result<(LasFile, Fields)> {
        let metadata = tree.metadata();
        let root = tree.root()?.map(|root| root.statistics);
        let written = |attribute: &usize| {
            let column = root.as_ref().map(|root| root.columns[3 + attribute]);
            let (least, most) = column.map_or((i64::MAX, i64::MIN), |column| (column.least, column.most));
            OutputAttribute { attribute: &tree.attributes()[*attribute], least, most }
        };
        let attributes: Vec<OutputAttribute<'_>> = chosen.iter().map(written).collect();
        let came_in = tag(metadata, "point_format")
            .and_then(|text| text.parse().ok())
            .filter(|format| *format <= MAX_FORMAT);
        let format = best_format(&attributes, came_in);
        let own = record_bytes(format).unwrap_or(0);
        let standard = record_layout(format, own, &[]);
        let own_columns = matching_fields(&attributes, &standard);
        let extra: Vec<(&usize, &OutputAttribute<'_>)> = chosen
            .iter()
            .zip(&attributes)
            .zip(&own_columns)
            .filter_map(|(written, index)| index.is_none().then_some(written))
            .collect();
        let descriptors: Vec<u8> =
            extra.iter().flat_map(|(_, written)| describe_extra(written.attribute)).collect();
        let size = own + extra.iter().map(|(_, written)| written.attribute.sample.size()).sum::<usize>();
        let Ok(record_length) = u16::try_from(size) else {
            let advice = "select fewer attributes with --attribute";
            return Err(Error::unsupported(tree.path(), format!("a LAS record of {size} bytes"), advice));
        };
        let layout = record_layout(format, size, &descriptors);
        // Extra attributes are identified by their order, since names may be truncated.
        let mut columns = vec![None; layout.attributes.len()];
        for (attribute, index) in chosen.iter().zip(&own_columns) {
            if let Some((index, conversion)) = index {
                columns[*index] = Some((3 + attribute, *conversion));
            }
        }
        for (index, (attribute, _)) in extra.iter().enumerate() {
            if let Some(column) = columns.get_mut(standard.attributes.len() + index) {
                *column = Some((3 + **attribute, Conversion::None));
            }
        }
        let mut records = Vec::new();
        let mut encoding =
            tag(metadata, "global_encoding").and_then(|text| text.parse::<u16>().ok()).unwrap_or(0);
        // Clear the bits for waveform data inside the file or in a separate one: waveforms are not
        // written.
        encoding &= !0b1_0110;
        // Files with formats 6 and above declare WKT even without a coordinate system.
        if format >= 6 {
            encoding |= WKT_BIT;
        }
        if let Some(crs) = &metadata.frame.crs {
            encoding |= add_crs(crs, format, &mut records)?;
        }
        if !descriptors.is_empty() {
            records.push(record("LASF_Spec", 4, "extra bytes", descriptors));
        }
        let kept = metadata.tags.iter().filter_map(|(key, text)| {
            let (user, number) = key.strip_prefix("las.record.")?.rsplit_once('.')?;
            let data = bytes_of_hexadecimal(text).filter(|data| data.len() <= u16::MAX.into())?;
            Some(record(user, number.parse().ok()?, "", data))
        });
        records.extend(kept);
        let header = header_of(metadata, format, encoding, record_length);
        let return_number = layout.position("return_number");
        let (points, by_return, bounds) = (0, [0; 15], None);
        let fields = Fields { layout: layout.clone(), columns };
        let grid = tree.grid().clone();
        let file =
            LasFile { header, records, layout, grid, format, points, by_return, bounds, return_number };
        Ok((file, fields))
    }

    /// Returns the number of the point format.
    pub(crate) fn format(&self) -> u8 {
        self.format
    }

    /// Returns the record size in excess of the format's size.
    pub(crate) fn extra_bytes(&self) -> u16 {
        (self.layout.size - record_bytes(self.format).unwrap_or(0)) as u16
    }

    /// Marks records as compressed, and adds the LASzip record.
    pub(crate) fn pack(&mut self, laszip: Vec<u8>) {
        self.header.point_data_record_format |= 0x80;
        self.records.push(record("laszip encoded", 22204, "by laszip of LAStools", laszip));
    }

    /// Counts written records.
    pub(crate) fn count(&mut self, rows: &[u8]) {
        let size = self.layout.size;
        self.points += (rows.len() / size) as u64;
        if let Some(attribute) = self.return_number {
            for number in self.layout.numbers(attribute, rows.chunks_exact(size)) {
                if let Some(count) = self.by_return.get_mut((number - 1).clamp(-1, 15) as usize) {
                    *count += 1;
                }
            }
        }
        self.bounds = both_bounds(self.bounds, bounds_of(rows, size));
    }

    /// Returns the header and the variable-length records, with the counts so far.
    pub(crate) fn to_bytes(&self, path: &Path) -> Result<Vec<u8>> {
        let mut header = self.header.clone();
        let records: usize = self.records.iter().map(|record| 54 + record.data.len()).sum();
        header.offset_to_point_data = (usize::from(header.header_size) + records) as u32;
        header.number_of_variable_length_records = self.records.len() as u32;
        let is_large = header.version == Version::new(1, 4);
        // Legacy counts: 0 if the count does not fit or old readers do not know the format.
        let is_old = self.format < 6 && self.points <= u32::MAX.into();
        if !is_large && !is_old {
            let advice = "write several windows of it (--window), or write .npy";
            return Err(Error::unsupported(
                path,
                format!("a LAS file of {} points in format {}", self.points, self.format),
                advice,
            ));
        }
        if is_old {
            header.number_of_point_records = self.points as u32;
            header.number_of_points_by_return = std::array::from_fn(|number| self.by_return[number] as u32);
        }
        if is_large {
            header.large_file = Some(raw::header::LargeFile {
                number_of_point_records: self.points,
                number_of_points_by_return: self.by_return,
            });
        }
        let (scale, offset) = (self.grid.scale, self.grid.offset);
        [header.x_scale_factor, header.y_scale_factor, header.z_scale_factor] = scale;
        [header.x_offset, header.y_offset, header.z_offset] = offset;
        if let Some([least, most]) = self.bounds.map(|bounds| bounds.map(|index| self.grid.to_world(index))) {
            [header.min_x, header.min_y, header.min_z] = least;
            [header.max_x, header.max_y, header.max_z] = most;
        }
        let mut bytes = Cursor::new(Vec::new());
        let failed =
            |error: las::Error| Error::unsupported(path, format!("a LAS header ({error})"), "write .npy");
        header.write_to(&mut bytes).map_err(failed)?;
        for record in &self.records {
            record.write_to(&mut bytes).map_err(failed)?;
        }
        Ok(bytes.into_inner())
    }
}

/// Bit of the global encoding that declares the coordinate system to be WKT.
const WKT_BIT: u16 = 0b1_0000;

/// Adds the records of the coordinate system; returns their bit of the global encoding.
fn add_crs(crs: &spinney_crs::Crs, format: u8, records: &mut Vec<raw::Vlr>) -> Result<u16> {
    const PROJECTION: &str = "LASF_Projection";
    // LAS 1.4 requires WKT for formats 6 and above.
    if format >= 6 {
        let mut text = crs.to_text()?.into_bytes();
        text.push(0);
        records.push(record(PROJECTION, 2112, "coordinate system", text));
        return Ok(WKT_BIT);
    }
    let keys = crs.to_geo_keys()?;
    let words = keys.directory(1).into_iter().flat_map(u16::to_le_bytes).collect();
    records.push(record(PROJECTION, 34735, "GeoKeyDirectory", words));
    if !keys.doubles().is_empty() {
        let doubles = keys.doubles().iter().flat_map(|number| number.to_le_bytes()).collect();
        records.push(record(PROJECTION, 34736, "GeoDoubleParams", doubles));
    }
    if !keys.strings().is_empty() {
        records.push(record(PROJECTION, 34737, "GeoAsciiParams", keys.strings().to_vec()));
    }
    Ok(0)
}

/// Returns the header as far as it is known before the points.
fn header_of(metadata: &Metadata, format: u8, encoding: u16, record_length: u16) -> raw::Header {
    let minor = tag(metadata, "version").and_then(|text| text.strip_prefix("1.")?.parse::<u8>().ok());
    let minor = if format >= 6 { 4 } else { minor.unwrap_or(2).clamp(if format >= 4 { 3 } else { 2 }, 4) };
    let version = Version::new(1, minor);
    let date = tag(metadata, "creation").and_then(|text| text.split_once('-'));
    let date = date.and_then(|(year, day)| Some((year.parse().ok()?, day.parse().ok()?)));
    let project =
        tag(metadata, "project_id").and_then(bytes_of_hexadecimal).and_then(|bytes| bytes.try_into().ok());
    raw::Header {
        file_source_id: tag(metadata, "file_source_id").and_then(|text| text.parse().ok()).unwrap_or(0),
        global_encoding: encoding,
        guid: project.unwrap_or([0; 16]),
        version,
        system_identifier: padded(tag(metadata, "system_identifier").unwrap_or_default()),
        generating_software: padded(concat!("spinney ", env!("CARGO_PKG_VERSION"))),
        file_creation_year: date.map_or(0, |(year, _)| year),
        file_creation_day_of_year: date.map_or(0, |(_, day)| day),
        header_size: version.header_size(),
        point_data_record_format: format,
        point_data_record_length: record_length,
        ..raw::Header::default()
    }
}
