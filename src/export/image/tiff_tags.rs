//! The container of TIFF: tags, directories, and the tags that place a picture in the world.

use crate::space::Frame;

/// A tag's value.
pub(super) enum Field {
    Ascii(String),
    Short(Vec<u16>),
    Long(Vec<u32>),
    Double(Vec<f64>),
    Long8(Vec<u64>),
}

impl Field {
    /// The type's number, the count of its numbers and their bytes.
    fn encode(&self) -> (u16, u64, Vec<u8>) {
        match self {
            Field::Ascii(text) => (2, text.len() as u64 + 1, text.bytes().chain([0]).collect()),
            Field::Short(v) => (3, v.len() as u64, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
            Field::Long(v) => (4, v.len() as u64, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
            Field::Double(v) => (12, v.len() as u64, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
            Field::Long8(v) => (16, v.len() as u64, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
        }
    }
}

/// The file's first bytes, and where the place of the directory is to be filled in.
pub(super) fn header(big: bool) -> (&'static [u8], u64) {
    if big { (b"II\x2b\0\x08\0\0\0\0\0\0\0\0\0\0\0", 8) } else { (b"II\x2a\0\0\0\0\0", 4) }
}

/// An offset or count in the width of the file.
pub(super) fn word(number: u64, big: bool) -> Vec<u8> {
    let bytes = number.to_le_bytes();
    bytes[..if big { 8 } else { 4 }].to_vec()
}

/// The bytes of a directory that will stand at `at`, and of the values that are too long for it.
pub(super) fn directory(mut tags: Vec<(u16, Field)>, at: u64, big: bool) -> Vec<u8> {
    tags.sort_by_key(|(number, _)| *number);
    let (count_bytes, word_bytes) = if big { (8, 8) } else { (2, 4) };
    let entries_bytes = tags.len() * (4 + 2 * word_bytes);
    let mut entries = (tags.len() as u64).to_le_bytes()[..count_bytes].to_vec();
    let mut values = Vec::new();
    let values_at = at + (count_bytes + entries_bytes + word_bytes) as u64;
    for (number, field) in tags {
        let (kind, count, mut bytes) = field.encode();
        entries.extend(number.to_le_bytes());
        entries.extend(kind.to_le_bytes());
        entries.extend(word(count, big));
        if bytes.len() <= word_bytes {
            bytes.resize(word_bytes, 0);
            entries.extend(bytes);
        } else {
            entries.extend(word(values_at + values.len() as u64, big));
            // Values start at even offsets; so does the directory.
            bytes.resize(bytes.len().next_multiple_of(2), 0);
            values.extend(bytes);
        }
    }
    entries.extend(word(0, big)); // no next directory
    entries.extend(values);
    entries
}

/// GeoTIFF's tags.
pub(super) fn geo_tags(frame: &Frame) -> Vec<(u16, Field)> {
    const MODEL_PIXEL_SCALE: u16 = 33550;
    const MODEL_TIEPOINT: u16 = 33922;
    const MODEL_TRANSFORMATION: u16 = 34264;

    let mut tags = geo_keys(frame);
    if frame.is_identity() {
        return tags;
    }
    // Where samples are points, raster coordinates are those of the points.
    let origin = if frame.pixel_is_point { [0.5, 0.5, 0.0] } else { [0.0; 3] };
    let [a, b, c, d, e, f] = frame.shifted(origin).affine();
    if b == 0.0 && d == 0.0 && a > 0.0 && e < 0.0 {
        tags.push((MODEL_PIXEL_SCALE, Field::Double(vec![a, -e, 0.0])));
        tags.push((MODEL_TIEPOINT, Field::Double(vec![0.0, 0.0, 0.0, c, f, 0.0])));
    } else {
        let matrix = [[a, b, 0.0, c], [d, e, 0.0, f], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        tags.push((MODEL_TRANSFORMATION, Field::Double(matrix.concat())));
    }
    tags
}

/// The tags that name the coordinate system.
fn geo_keys(frame: &Frame) -> Vec<(u16, Field)> {
    const GEO_KEY_DIRECTORY: u16 = 34735;
    const GEO_ASCII_PARAMS: u16 = 34737;
    const MODEL_TYPE: u16 = 1024;
    const RASTER_TYPE: u16 = 1025;
    const CITATION: u16 = 1026;
    const GEOGRAPHIC_TYPE: u16 = 2048;
    const PROJECTED_TYPE: u16 = 3072;
    const USER_DEFINED: u16 = 32767;

    let epsg = frame.epsg.and_then(|code| u16::try_from(code).ok());
    let mut keys: Vec<[u16; 4]> = Vec::new();
    let mut key = |number, value| keys.push([number, 0, 1, value]);
    match epsg {
        Some(code) if crate::space::is_geographic(code) => {
            key(MODEL_TYPE, 2);
            key(GEOGRAPHIC_TYPE, code);
        }
        Some(code) => {
            key(MODEL_TYPE, 1);
            key(PROJECTED_TYPE, code);
        }
        None if frame.crs_name.is_some() => key(MODEL_TYPE, USER_DEFINED),
        None => {}
    }
    if !frame.is_identity() || epsg.is_some() {
        key(RASTER_TYPE, if frame.pixel_is_point { 2 } else { 1 });
    }
    let mut tags = Vec::new();
    if let Some(name) = &frame.crs_name {
        // The tag is 7-bit ASCII, and `|` ends a text in it.
        let plain = |c: char| if c.is_ascii() && c != '|' && c != '\0' { c } else { '?' };
        let text: String = name.chars().take(1000).map(plain).chain(['|']).collect();
        keys.push([CITATION, GEO_ASCII_PARAMS, text.len() as u16, 0]);
        tags.push((GEO_ASCII_PARAMS, Field::Ascii(text)));
    }
    if !keys.is_empty() {
        keys.sort();
        keys.insert(0, [1, 1, 0, keys.len() as u16]);
        tags.push((GEO_KEY_DIRECTORY, Field::Short(keys.concat())));
    }
    tags
}

/// GDAL's tag for nodata.
pub(super) fn nodata_tag(number: f64) -> (u16, Field) {
    (42113, Field::Ascii(if number.is_nan() { "nan".into() } else { number.to_string() }))
}

/// GDAL's tag for names of bands, if any has one.
pub(super) fn band_names_tag(names: &[String]) -> Option<(u16, Field)> {
    let escape = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let mut xml = String::from("<GDALMetadata>\n");
    for (band, name) in names.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
        // GDAL escapes twice, and so it reads.
        let name = escape(&escape(&name.replace('\0', "")));
        xml +=
            &format!("  <Item name=\"DESCRIPTION\" sample=\"{band}\" role=\"description\">{name}</Item>\n");
    }
    xml += "</GDALMetadata>\n";
    names.iter().any(|name| !name.is_empty()).then_some((42112, Field::Ascii(xml)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(tags: &[(u16, Field)], wanted: u16) -> Option<Vec<f64>> {
        let field = tags.iter().find(|(number, _)| *number == wanted)?;
        match &field.1 {
            Field::Double(numbers) => Some(numbers.clone()),
            Field::Short(numbers) => Some(numbers.iter().map(|&n| f64::from(n)).collect()),
            _ => None,
        }
    }

    #[test]
    fn north_up_points() {
        let mut frame = Frame::planar([1.0, 0.0, 7.5, 0.0, -1.0, 47.5]);
        frame.epsg = Some(4326);
        frame.pixel_is_point = true;
        let tags = geo_tags(&frame);
        assert_eq!(find(&tags, 33550), Some(vec![1.0, 1.0, 0.0]));
        assert_eq!(find(&tags, 33922), Some(vec![0.0, 0.0, 0.0, 8.0, 47.0, 0.0]));
        let keys = [[1, 1, 0, 3], [1024, 0, 1, 2], [1025, 0, 1, 2], [2048, 0, 1, 4326]].concat();
        assert_eq!(find(&tags, 34735), Some(keys.into_iter().map(f64::from).collect()));
    }

    #[test]
    fn rotated_and_projected() {
        let mut frame = Frame::planar([2.0, 0.5, 10.0, -0.5, -2.0, 20.0]);
        frame.epsg = Some(2056);
        let tags = geo_tags(&frame);
        let matrix = [[2.0, 0.5, 0.0, 10.0], [-0.5, -2.0, 0.0, 20.0], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        assert_eq!(find(&tags, 34264), Some(matrix.concat()));
        let keys = [[1, 1, 0, 3], [1024, 0, 1, 1], [1025, 0, 1, 1], [3072, 0, 1, 2056]].concat();
        assert_eq!(find(&tags, 34735), Some(keys.into_iter().map(f64::from).collect()));
        assert!(geo_tags(&Frame::identity()).is_empty());
    }

    #[test]
    fn long_values_stand_behind_the_directory() {
        let tags = vec![(300, Field::Short(vec![7, 8, 9])), (256, Field::Long(vec![5]))];
        let bytes = directory(tags, 100, false);
        let expected: [&[u8]; 5] = [
            &[2, 0],
            &[0, 1, 4, 0, 1, 0, 0, 0, 5, 0, 0, 0],
            &[44, 1, 3, 0, 3, 0, 0, 0, 130, 0, 0, 0],
            &[0, 0, 0, 0],
            &[7, 0, 8, 0, 9, 0],
        ];
        assert_eq!(bytes, expected.concat());
    }
}
