//! LAS headers and their variable-length records.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use las::raw;

use super::format::{MAX_FORMAT, described_layout, record_bytes};
use crate::attribute::RowLayout;
use spinney_base::guard::guard;
use spinney_base::io::open_input;
use spinney_base::{Error, Result};
use spinney_container::{FIRST_BYTES, OtherFormat};
use spinney_crs::{Crs, GeoKeys};

/// Everything in a file before its points.
pub(crate) struct LasHeader {
    pub(crate) header: raw::Header,
    /// Number of points.
    pub(crate) points: u64,
    pub(crate) layout: RowLayout,
    /// LASzip record, which describes the compression; `None` for uncompressed points.
    pub(crate) laszip: Option<Vec<u8>>,
    pub(crate) crs: Option<Crs>,
    pub(crate) tags: BTreeMap<String, String>,
    /// Remarks on what is not kept.
    pub(crate) losses: Vec<String>,
}

/// Maximum size in bytes of a variable-length record that is read, and maximum number of records.
const MAX_RECORD: u64 = 1 << 20;
const MAX_RECORDS: u64 = 1 << 12;
/// Maximum bytes of unknown records that are kept.
const MAX_CACHED: usize = 64 << 10;

/// Variable-length record.
struct VariableRecord {
    user: String,
    number: u16,
    /// Declared size in bytes; large records are not read.
    length: u64,
    data: Vec<u8>,
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().to_string()
}

impl LasHeader {
    /// Reads and checks a file's header.
    pub(crate) fn read(path: &Path) -> Result<(LasHeader, BufReader<File>)> {
        let file = open_input(path)?;
        let length = file.metadata().map_err(Error::io(path, "read"))?.len();
        let mut file = BufReader::with_capacity(1 << 20, file);
        let start = file.fill_buf().map_err(Error::io(path, "read"))?;
        if !start.starts_with(b"LASF") {
            let start = &start[..start.len().min(FIRST_BYTES)];
            let found = format!("`{}`", start[..start.len().min(4)].escape_ascii());
            let other = || Error::corrupt(path, "header", found, "the signature of a LAS file, `LASF`");
            return Err(OtherFormat::refuse_content(path, start, "a LAS or LAZ file").unwrap_or_else(other));
        }
        let header = guard(path, "header", || {
            raw::Header::read_from(&mut file).map_err(|error| {
                Error::corrupt(path, "header", error.to_string(), "the header of a LAS file")
            })
        })?;
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "header", found, expected);
        // The two highest bits flag compressed points.
        let format = header.point_data_record_format & 0x3f;
        let own = record_bytes(format).filter(|_| format <= MAX_FORMAT);
        let Some(own) = own else {
            let advice = format!("convert the file to a point format from 0 to {MAX_FORMAT}");
            return Err(Error::unsupported(path, format!("point format {format}"), advice));
        };
        let size = usize::from(header.point_data_record_length);
        if size < own {
            return Err(corrupt(
                format!("records of {size} bytes"),
                &format!("{own} bytes or more for point format {format}"),
            ));
        }
        let scales = [header.x_scale_factor, header.y_scale_factor, header.z_scale_factor];
        let offsets = [header.x_offset, header.y_offset, header.z_offset];
        let are_good = scales.iter().chain(&offsets).all(|number| number.is_finite())
            && scales.iter().all(|scale| *scale > 0.0);
        if !are_good {
            return Err(corrupt(
                format!("scales {scales:?} and offsets {offsets:?}"),
                "finite numbers, and scales above 0",
            ));
        }
        let large = header.large_file.map(|large| large.number_of_point_records);
        let points = large.filter(|points| *points > 0).unwrap_or(header.number_of_point_records.into());
        let is_packed = header.point_data_record_format & 0x80 != 0;
        let start = u64::from(header.offset_to_point_data);
        let space = length.saturating_sub(start);
        if start > length || !is_packed && points.checked_mul(size as u64).is_none_or(|bytes| bytes > space) {
            let found = format!("{points} points of {size} bytes from byte {start}");
            return Err(corrupt(found, &format!("points that fit into the file of {length} bytes")));
        }
        let records = variable_records(path, &mut file, &header, length)?;
        let find = |user: &str, number: u16| {
            records
                .iter()
                .find(|record| record.user == user && record.number == number)
                .map(|record| &record.data)
        };
        let laszip = find("laszip encoded", 22204).cloned();
        if is_packed && laszip.is_none() {
            return Err(corrupt(
                "compressed points without a LASzip record".into(),
                "a `laszip encoded` record",
            ));
        }
        let described = find("LASF_Spec", 4).map_or(&[][..], |data| data);
        let (layout, renamed) = described_layout(format, size, described);
        let (crs, crs_is_lost) = crs_of(&find, header.global_encoding);
        let mut tags = tags_of(&header, format);
        let mut losses = keep_records(&records, crs_is_lost, &mut tags);
        losses.extend(renamed.iter().map(|name| {
            format!("its extra dimension `{name}` is stored as `extra_{name}`, since the name is taken")
        }));
        let laszip = laszip.filter(|_| is_packed);
        Ok((LasHeader { header, points, layout, laszip, crs, tags, losses }, file))
    }

    /// Returns the scale and the offset of the grid, in world units.
    pub(crate) fn scale_offset(&self) -> ([f64; 3], [f64; 3]) {
        let header = &self.header;
        (
            [header.x_scale_factor, header.y_scale_factor, header.z_scale_factor],
            [header.x_offset, header.y_offset, header.z_offset],
        )
    }

    /// Returns the minimum and maximum position on the grid, according to the header.
    pub(crate) fn bounds(&self) -> [[i32; 3]; 2] {
        let header = &self.header;
        let (scale, offset) = self.scale_offset();
        let world = [[header.min_x, header.min_y, header.min_z], [header.max_x, header.max_y, header.max_z]];
        world.map(|corner| {
            std::array::from_fn(|axis| ((corner[axis] - offset[axis]) / scale[axis]).round() as i32)
        })
    }
}

/// Reads all variable-length records, including those after the points.
fn variable_records(
    path: &Path,
    file: &mut BufReader<File>,
    header: &raw::Header,
    length: u64,
) -> Result<Vec<VariableRecord>> {
    let mut records = Vec::new();
    let near = (u64::from(header.header_size), u64::from(header.number_of_variable_length_records), false);
    let far = header.evlr.map(|evlr| (evlr.start_of_first_evlr, u64::from(evlr.number_of_evlrs), true));
    for (mut at, count, is_far) in [near].into_iter().chain(far) {
        for _ in 0..count.min(MAX_RECORDS) {
            let mut head = [0; 60];
            let head = if is_far { &mut head[..60] } else { &mut head[..54] };
            file.seek(SeekFrom::Start(at)).map_err(Error::io(path, "read"))?;
            // Files with fewer records than declared are common.
            if at + head.len() as u64 > length || file.read_exact(head).is_err() {
                break;
            }
            let bytes = match is_far {
                true => u64::from_le_bytes(head[20..28].try_into().expect("eight bytes")),
                false => u16::from_le_bytes([head[20], head[21]]).into(),
            };
            let data_at = at + head.len() as u64;
            let Some(end) = data_at.checked_add(bytes).filter(|end| *end <= length) else { break };
            let number = u16::from_le_bytes([head[18], head[19]]);
            let user = text(&head[2..18]);
            at = end;
            let mut data = vec![0; if bytes > MAX_RECORD { 0 } else { bytes as usize }];
            file.read_exact(&mut data).map_err(Error::io(path, "read"))?;
            records.push(VariableRecord { user, number, length: bytes, data });
        }
    }
    Ok(records)
}

/// Returns the coordinate system of the records, and whether they contain one that cannot be read.
fn crs_of<'r>(find: &impl Fn(&str, u16) -> Option<&'r Vec<u8>>, encoding: u16) -> (Option<Crs>, bool) {
    const PROJECTION: &str = "LASF_Projection";
    let wkt = || find(PROJECTION, 2112).map(|data| Crs::parse(&text(data)).ok());
    let keys = || {
        find(PROJECTION, 34735).map(|directory| {
            let numbers: Vec<u16> =
                directory.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect();
            let doubles = find(PROJECTION, 34736).map_or(&[][..], |data| data);
            let doubles: Vec<f64> =
                doubles.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
            let strings = find(PROJECTION, 34737).map_or(&[][..], |data| data);
            GeoKeys::new(&numbers, &doubles, strings).map(Crs::GeoKeys)
        })
    };
    // Where a file has both, bit 4 says which one is valid.
    let found = if encoding & 0x10 != 0 { wkt().or_else(keys) } else { keys().or_else(wkt) };
    (found.clone().flatten(), found.is_some_and(|crs| crs.is_none()))
}

/// Returns the header's other fields as tags.
fn tags_of(header: &raw::Header, format: u8) -> BTreeMap<String, String> {
    let version = header.version;
    let mut tags = BTreeMap::from([
        ("las.version".to_string(), format!("{}.{}", version.major, version.minor)),
        ("las.point_format".into(), format.to_string()),
        ("las.global_encoding".into(), header.global_encoding.to_string()),
    ]);
    let mut put = |key: &str, value: String| {
        if !value.is_empty() {
            tags.insert(format!("las.{key}"), value);
        }
    };
    put("system_identifier", text(&header.system_identifier));
    put("generating_software", text(&header.generating_software));
    if header.file_creation_year != 0 {
        put("creation", format!("{}-{:03}", header.file_creation_year, header.file_creation_day_of_year));
    }
    if header.file_source_id != 0 {
        put("file_source_id", header.file_source_id.to_string());
    }
    if header.guid != [0; 16] {
        put("project_id", hexadecimal(&header.guid));
    }
    tags
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Keeps short unknown records as tags, in hexadecimal; returns remarks on those that are dropped.
fn keep_records(
    records: &[VariableRecord],
    crs_is_lost: bool,
    tags: &mut BTreeMap<String, String>,
) -> Vec<String> {
    let mut left = MAX_CACHED;
    let mut losses = Vec::new();
    if crs_is_lost {
        losses.push("its coordinate system cannot be read; set it with --crs".into());
    }
    for VariableRecord { user, number, length, data } in records {
        let is_known = match user.as_str() {
            "laszip encoded" => true,
            // Their offsets are invalid in another file.
            "copc" => true,
            "LASF_Spec" => *number == 4,
            "LASF_Projection" => !crs_is_lost,
            _ => false,
        };
        if is_known {
            continue;
        }
        if data.len() as u64 == *length && data.len() <= left {
            left -= data.len();
            tags.insert(format!("las.record.{user}.{number}"), hexadecimal(data));
        } else {
            losses.push(format!("its record {number} of {user} ({length} bytes) is not stored"));
        }
    }
    losses
}
