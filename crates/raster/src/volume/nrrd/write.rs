//! Writer of NRRD headers.

use std::fmt::Write as _;

use super::header::DOMAIN;
use spinney_base::value::{SampleType, ValueType};
use spinney_container::{Metadata, Tag, TagScope};
use spinney_crs::Frame;

/// Returns the header of a file whose little-endian samples follow it. `[x, y, z]` is the size in
/// cells.
pub(crate) fn nrrd_head(value: ValueType, [x, y, z]: [u64; 3], frame: &Frame, metadata: &Metadata) -> String {
    let kind = match value.sample {
        SampleType::U8 => "uint8",
        SampleType::I8 => "int8",
        SampleType::U16 => "uint16",
        SampleType::I16 => "int16",
        SampleType::U32 => "uint32",
        SampleType::I32 => "int32",
        SampleType::U64 => "uint64",
        SampleType::I64 => "int64",
        SampleType::F32 => "float",
        SampleType::F64 => "double",
    };
    let domain = TagScope { channel: None, domain: DOMAIN.into() };
    let space = metadata.scoped_tags.get(&domain).and_then(|fields| fields.get("space"));
    let space = space.map_or("space dimension: 3".into(), |space| format!("space: {}", line(space)));
    let has_channels = value.channels > 1;
    let (dimension, channels, no_direction, channel_kind) = match has_channels {
        true => (4, format!("{} ", value.channels), "none ", "vector "),
        false => (3, String::new(), "", ""),
    };
    let direction = |axis: usize| vector(frame.matrix.map(|row| row[axis]));
    let mut head = format!(
        "NRRD0005\ntype: {kind}\ndimension: {dimension}\n{space}\nsizes: {channels}{x} {y} {z}\nspace directions: {no_direction}{} {} {}\n\
         space origin: {}\nkinds: {channel_kind}domain domain domain\nendian: little\nencoding: raw\n",
        direction(0),
        direction(1),
        direction(2),
        // The origin is the centre of the first cell.
        vector(frame.to_world([0.5; 3]))
    );
    // Writing to a `String` cannot fail.
    if let Some(unit) = metadata.tag(Tag::Unit) {
        let _ = writeln!(head, "space units:{}", format!(" {:?}", line(unit)).repeat(3));
    }
    if let Some(unit) = metadata.units.first().filter(|unit| !unit.is_empty()) {
        let _ = writeln!(head, "sample units: {}", line(unit));
    }
    // A key with a colon would be read as a field.
    let others = metadata.tags.iter().filter(|(key, _)| **key != Tag::Unit.key() && !key.contains(':'));
    for (key, text) in others {
        let _ = writeln!(head, "{}:={}", escaped(key), escaped(text));
    }
    head.push('\n');
    head
}

fn vector([x, y, z]: [f64; 3]) -> String {
    format!("({x},{y},{z})")
}

/// Replaces control characters, so that the string fits one line.
fn line(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

/// Escapes a string for one line, so that the parser restores it.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('\n', "\\n")
}
