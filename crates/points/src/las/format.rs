//! LAS point formats: the layout of records.

use crate::attribute::{PointAttribute, RowField, RowLayout, bytes_of, ordered, to_f64};
use spinney_base::value::SampleType;

/// Scan angle attributes: `SCAN_ANGLE` is in units of 0.006 degrees (point formats 6 and above),
/// `SCAN_ANGLE_RANK` in degrees (older formats).
pub(crate) const SCAN_ANGLE: &str = "scan_angle";
pub(crate) const SCAN_ANGLE_RANK: &str = "scan_angle_rank";

/// Converts a scan angle from degrees to units of 0.006 degrees.
pub(crate) fn angle_of_rank(rank: i64) -> i64 {
    (rank as f64 / 0.006).round() as i64
}

/// Highest number of a point format.
pub(crate) const MAX_FORMAT: u8 = 10;

/// Collects the attributes of a record, and the names of extra dimensions that had to be renamed.
struct Record(Vec<(PointAttribute, RowField)>, Vec<String>);

impl Record {
    /// Returns a name for an extra dimension that differs from all attributes and coordinates.
    fn free_name(&mut self, name: String) -> String {
        let is_taken = |name: &str| {
            name.is_empty()
                || ["x", "y", "z"].iter().any(|axis| name.eq_ignore_ascii_case(axis))
                || self.0.iter().any(|(other, _)| other.name == name)
        };
        if !is_taken(&name) {
            return name;
        }
        let others = (2..).map(|number| format!("extra_{name}_{number}"));
        let free = std::iter::once(format!("extra_{name}")).chain(others).find(|name| !is_taken(name));
        self.1.push(name);
        free.unwrap_or_default()
    }

    fn whole(&mut self, name: &str, sample: SampleType, offset: usize) {
        self.0.push((PointAttribute::new(name, sample), RowField { offset, bits: None }));
    }

    /// Adds the bit fields of a byte, from the lowest bit up, by name and number of bits.
    fn parts(&mut self, offset: usize, parts: &[(&str, u8)]) {
        let mut shift = 0;
        for (name, bits) in parts {
            self.0.push((
                PointAttribute::new(*name, SampleType::U8),
                RowField { offset, bits: Some((shift, *bits)) },
            ));
            shift += bits;
        }
    }

    fn colours(&mut self, offset: usize) {
        for (index, name) in ["red", "green", "blue"].into_iter().enumerate() {
            self.whole(name, SampleType::U16, offset + 2 * index);
        }
    }

    fn wave(&mut self, offset: usize) {
        self.whole("wavepacket_index", SampleType::U8, offset);
        self.whole("wavepacket_offset", SampleType::U64, offset + 1);
        self.whole("wavepacket_size", SampleType::U32, offset + 9);
        for (index, name) in ["return_point_wave_location", "x_t", "y_t", "z_t"].into_iter().enumerate() {
            self.whole(name, SampleType::F32, offset + 13 + 4 * index);
        }
    }
}

/// Returns the record size of a format without extra bytes; `None` for an unknown format.
pub(crate) fn record_bytes(format: u8) -> Option<usize> {
    [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67].get(usize::from(format)).copied()
}

/// Adds the attributes of a format, named as in laspy and PDAL's documentation of dimensions.
fn add_format(record: &mut Record, format: u8) {
    use SampleType::{F64, I8, I16, U8, U16};
    record.whole("intensity", U16, 12);
    if format < 6 {
        record.parts(
            14,
            &[
                ("return_number", 3),
                ("number_of_returns", 3),
                ("scan_direction_flag", 1),
                ("edge_of_flight_line", 1),
            ],
        );
        record.parts(15, &[("classification", 5), ("synthetic", 1), ("key_point", 1), ("withheld", 1)]);
        record.whole("scan_angle_rank", I8, 16);
        record.whole("user_data", U8, 17);
        record.whole("point_source_id", U16, 18);
        let timed = [1, 3, 4, 5].contains(&format);
        if timed {
            record.whole("gps_time", F64, 20);
        }
        match format {
            2 => record.colours(20),
            3 => record.colours(28),
            4 => record.wave(28),
            5 => {
                record.colours(28);
                record.wave(34);
            }
            _ => {}
        }
        return;
    }
    record.parts(14, &[("return_number", 4), ("number_of_returns", 4)]);
    record.parts(
        15,
        &[
            ("synthetic", 1),
            ("key_point", 1),
            ("withheld", 1),
            ("overlap", 1),
            ("scanner_channel", 2),
            ("scan_direction_flag", 1),
            ("edge_of_flight_line", 1),
        ],
    );
    record.whole("classification", U8, 16);
    record.whole("user_data", U8, 17);
    record.whole("scan_angle", I16, 18);
    record.whole("point_source_id", U16, 20);
    record.whole("gps_time", F64, 22);
    match format {
        7 => record.colours(30),
        8 => {
            record.colours(30);
            record.whole("nir", U16, 36);
        }
        9 => record.wave(30),
        10 => {
            record.colours(30);
            record.whole("nir", U16, 36);
            record.wave(38);
        }
        _ => {}
    }
}

/// Returns the record layout of a format with extra bytes, described as far as possible by a VLR.
pub(crate) fn record_layout(format: u8, size: usize, described: &[u8]) -> RowLayout {
    described_layout(format, size, described).0
}

/// Returns the record layout of a format with extra bytes, and the names of the renamed extra
/// dimensions. A dimension is renamed if a standard dimension, a coordinate or another extra
/// dimension has the same name.
pub(crate) fn described_layout(format: u8, size: usize, described: &[u8]) -> (RowLayout, Vec<String>) {
    let mut record = Record(Vec::new(), Vec::new());
    add_format(&mut record, format);
    let own = record_bytes(format).unwrap_or(size);
    let mut offset = own;
    for descriptor in described.as_chunks::<192>().0 {
        offset = add_extra(&mut record, descriptor, offset, size);
    }
    // Undescribed bytes are kept, too.
    for (number, offset) in (offset..size).enumerate() {
        let name = record.free_name(format!("extra_bytes_{number}"));
        record.whole(&name, SampleType::U8, offset);
    }
    let (attributes, fields) = record.0.into_iter().unzip();
    (RowLayout { size, attributes, fields }, record.1)
}

/// Adds the extra bytes of a descriptor, if the record has space for them; returns the offset of
/// the next.
fn add_extra(record: &mut Record, descriptor: &[u8; 192], offset: usize, size: usize) -> usize {
    use SampleType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    let (kind, options) = (descriptor[2], descriptor[3]);
    let text = |bytes: &[u8]| {
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(&bytes[..end]).trim().to_string()
    };
    let (name, description) = (text(&descriptor[4..36]), text(&descriptor[160..192]));
    let types = [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64];
    // Type 0 is untyped bytes, whose number is in the options. Types 11 and above are arrays of two
    // or three numbers, deprecated in LAS 1.4 R15.
    let (sample, count) = match kind {
        0 => (U8, usize::from(options)),
        1..=30 => (types[usize::from(kind - 1) % 10], usize::from(kind - 1) / 10 + 1),
        _ => return offset,
    };
    if offset + sample.size() * count > size {
        return offset;
    }
    let double = |at: usize| f64::from_le_bytes(descriptor[at..at + 8].try_into().expect("eight bytes"));
    for number in 0..count {
        let name = if count == 1 { name.clone() } else { format!("{name}[{number}]") };
        let name = record.free_name(name);
        let mut attribute = PointAttribute::new(name, sample);
        attribute.description = description.clone();
        if kind != 0 && options & 1 != 0 {
            let at = 40 + 8 * number;
            attribute.no_data = narrowed(sample, descriptor[at..at + 8].try_into().expect("eight bytes"));
        }
        let (scale, summand) = (double(112 + 8 * number.min(2)), double(136 + 8 * number.min(2)));
        let is_scaled = kind != 0 && options & 0b1_1000 != 0;
        let scale = if options & 0b1000 != 0 { scale } else { 1.0 };
        let summand = if options & 0b1_0000 != 0 { summand } else { 0.0 };
        attribute.scale_offset =
            is_scaled.then_some((scale, summand)).filter(|_| scale.is_finite() && summand.is_finite());
        record.0.push((attribute, RowField { offset: offset + number * sample.size(), bits: None }));
    }
    offset + sample.size() * count
}

/// Converts an 8-byte `u64`, `i64` or `f64` to an ordered number of a type; `None` if it is out of
/// range.
fn narrowed(sample: SampleType, bytes: [u8; 8]) -> Option<i64> {
    let wide = match sample {
        SampleType::F32 | SampleType::F64 => SampleType::F64,
        SampleType::U64 => SampleType::U64,
        _ => SampleType::I64,
    };
    let number = match sample {
        SampleType::F32 => ordered(sample, &(f64::from_le_bytes(bytes) as f32).to_le_bytes()),
        _ => ordered(wide, &bytes),
    };
    let again = ordered(sample, &bytes_of(sample, number));
    (again == number).then_some(number)
}

/// Inverse of [`narrowed`].
fn widened(sample: SampleType, number: i64) -> [u8; 8] {
    match sample {
        SampleType::F32 => to_f64(sample, number).to_le_bytes(),
        _ => bytes_of(sample, number),
    }
}

/// Returns the extra bytes descriptor of an attribute.
pub(crate) fn describe_extra(attribute: &PointAttribute) -> [u8; 192] {
    use SampleType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    let mut bytes = [0; 192];
    let number = [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64]
        .iter()
        .position(|sample| *sample == attribute.sample);
    bytes[2] = number.map_or(1, |number| number as u8 + 1);
    let mut put = |at: usize, text: &str| {
        // Truncate at a character boundary.
        let end = (0..=text.len().min(32)).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
        bytes[at..at + end].copy_from_slice(&text.as_bytes()[..end]);
    };
    put(4, &attribute.name);
    put(160, &attribute.description);
    if let Some(no_data) = attribute.no_data {
        bytes[3] |= 1;
        bytes[40..48].copy_from_slice(&widened(attribute.sample, no_data));
    }
    if let Some((scale, offset)) = attribute.scale_offset {
        bytes[3] |= 0b1_1000;
        bytes[112..120].copy_from_slice(&scale.to_le_bytes());
        bytes[136..144].copy_from_slice(&offset.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_of_all_formats_are_full() {
        for format in 0..=MAX_FORMAT {
            let size = record_bytes(format).unwrap();
            let layout = record_layout(format, size, &[]);
            let mut bits = vec![0u32; size];
            bits[..12].fill(8);
            for (attribute, field) in layout.attributes.iter().zip(&layout.fields) {
                match field.bits {
                    Some((_, count)) => bits[field.offset] += u32::from(count),
                    None => bits[field.offset..field.offset + attribute.sample.size()]
                        .iter_mut()
                        .for_each(|byte| *byte += 8),
                }
            }
            assert_eq!(bits, vec![8; size], "{format}");
        }
        let last = record_layout(1, 30, &[]).attributes.pop();
        assert_eq!(last.map(|last| last.name), Some("extra_bytes_1".into()));
    }
}
