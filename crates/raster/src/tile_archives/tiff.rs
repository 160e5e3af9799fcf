//! A tile's samples as a small GeoTIFF file: one uncompressed strip in web mercator.

use spinney_base::sort;
use spinney_base::value::{SampleType, Value, ValueType};
use spinney_crs::{WEB_MERCATOR, WEB_MERCATOR_HALF};
use spinney_tiles::TileId;

/// Types of TIFF fields.
const ASCII: u16 = 2;
const SHORT: u16 = 3;
const LONG: u16 = 4;
const DOUBLE: u16 = 12;

/// Encodes a tile of `side` cells per side, whose VOID cells have the value `void`.
pub(super) fn tile(
    value: ValueType,
    side: usize,
    tile: TileId,
    void: Option<Value>,
    samples: &[u8],
) -> Vec<u8> {
    let channels = usize::from(value.channels);
    let (kind, bits) = (
        match value.sample {
            SampleType::U8 | SampleType::U16 | SampleType::U32 | SampleType::U64 => 1u16,
            SampleType::I8 | SampleType::I16 | SampleType::I32 | SampleType::I64 => 2,
            SampleType::F32 | SampleType::F64 => 3,
        },
        8 * value.sample.size() as u16,
    );
    let cell = 2.0 * WEB_MERCATOR_HALF / (f64::from(1u32 << tile.zoom) * side as f64);
    let west = f64::from(tile.column) * side as f64 * cell - WEB_MERCATOR_HALF;
    let north = WEB_MERCATOR_HALF - f64::from(tile.row) * side as f64 * cell;
    let text = void.map(|void| format!("{}\0", value.first_number(void)).to_lowercase());
    // Model type projected (1024 = 1), raster type area (1025 = 1), EPSG code (3072).
    let keys = [1u16, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, WEB_MERCATOR as u16];
    let shorts =
        |numbers: &[u16]| -> Vec<u8> { numbers.iter().flat_map(|number| number.to_le_bytes()).collect() };
    let longs = |number: usize| (number as u32).to_le_bytes().to_vec();
    let doubles =
        |numbers: &[f64]| -> Vec<u8> { numbers.iter().flat_map(|number| number.to_le_bytes()).collect() };
    let mut fields: Vec<(u16, u16, u32, Vec<u8>)> = vec![
        (256, LONG, 1, longs(side)),
        (257, LONG, 1, longs(side)),
        (258, SHORT, channels as u32, shorts(&vec![bits; channels])),
        (259, SHORT, 1, shorts(&[1])),
        // RGB if there are at least three channels.
        (262, SHORT, 1, shorts(&[if channels >= 3 { 2 } else { 1 }])),
        (273, LONG, 1, longs(8)),
        (277, SHORT, 1, shorts(&[channels as u16])),
        (278, LONG, 1, longs(side)),
        (279, LONG, 1, longs(samples.len())),
        (284, SHORT, 1, shorts(&[1])),
        (339, SHORT, channels as u32, shorts(&vec![kind; channels])),
        (33550, DOUBLE, 3, doubles(&[cell, cell, 0.0])),
        (33922, DOUBLE, 6, doubles(&[0.0, 0.0, 0.0, west, north, 0.0])),
        (34735, SHORT, keys.len() as u32, shorts(&keys)),
    ];
    fields.extend(text.map(|text| (42113, ASCII, text.len() as u32, text.into_bytes())));
    let usual = if channels >= 3 { 3 } else { 1 };
    if channels > usual {
        // Opacity that colours are not premultiplied with.
        fields.push((338, SHORT, (channels - usual) as u32, shorts(&vec![2; channels - usual])));
        sort::by_key(&mut fields, |field| u64::from(field.0));
    }
    // The samples, the directory, and the values that do not fit into it.
    let directory = (8 + samples.len()).next_multiple_of(2);
    let mut next_offset = directory + 2 + 12 * fields.len() + 4;
    let mut file = b"II\x2a\0".to_vec();
    file.extend((directory as u32).to_le_bytes());
    file.extend_from_slice(samples);
    file.resize(directory, 0);
    file.extend((fields.len() as u16).to_le_bytes());
    let mut rest = Vec::new();
    for (tag, kind, count, mut bytes) in fields {
        file.extend(tag.to_le_bytes());
        file.extend(kind.to_le_bytes());
        file.extend(count.to_le_bytes());
        if bytes.len() <= 4 {
            bytes.resize(4, 0);
            file.extend(bytes);
        } else {
            file.extend((next_offset as u32).to_le_bytes());
            bytes.resize(bytes.len().next_multiple_of(2), 0);
            next_offset += bytes.len();
            rest.extend(bytes);
        }
    }
    file.extend([0; 4]);
    file.extend(rest);
    file
}
