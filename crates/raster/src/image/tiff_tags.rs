//! The TIFF container: tags, directories, and the tags that georeference an image.

use std::collections::BTreeMap;

use spinney_base::sort;
use spinney_base::value::Number;
use spinney_chunks::spec::{field_type, tag};
use spinney_crs::{ControlPoint, ControlPoints, Crs, Frame, GeoKeys};

/// GeoKey of the raster type and its values, by their names in GeoTIFF 1.1.
const RASTER_TYPE: u16 = 1025;
const RASTER_PIXEL_IS_AREA: u16 = 1;
const RASTER_PIXEL_IS_POINT: u16 = 2;

/// A tag's value.
#[derive(Clone)]
pub(crate) enum IfdField {
    /// Without the terminating NUL.
    Ascii(Vec<u8>),
    Short(Vec<u16>),
    Long(Vec<u32>),
    Double(Vec<f64>),
    Long8(Vec<u64>),
    /// Numbers that are written later, at offset `at`. If they fit, they are in the directory
    /// itself, as zeros at first.
    Later {
        width: WordWidth,
        count: u64,
        at: u64,
    },
}

/// Width of unsigned numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WordWidth {
    Four = 4,
    Eight = 8,
}

impl IfdField {
    /// Returns the field type, the count of numbers, and their bytes.
    fn encode(&self) -> (u16, u64, Vec<u8>) {
        use field_type::{ASCII, DOUBLE, LONG, LONG8, SHORT};
        match self {
            IfdField::Ascii(text) => {
                (ASCII, text.len() as u64 + 1, text.iter().copied().chain([0]).collect())
            }
            IfdField::Short(v) => (SHORT, v.len() as u64, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
            IfdField::Long(v) => (LONG, v.len() as u64, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
            IfdField::Double(v) => (DOUBLE, v.len() as u64, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
            IfdField::Long8(v) => (LONG8, v.len() as u64, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
            IfdField::Later { width: WordWidth::Four, count, .. } => (LONG, *count, Vec::new()),
            IfdField::Later { width: WordWidth::Eight, count, .. } => (LONG8, *count, Vec::new()),
        }
    }
}

/// Returns the file header and the position in it of the first directory's offset, which is filled
/// in at the end.
pub(crate) fn header(big: bool) -> (&'static [u8], u64) {
    if big { (b"II\x2b\0\x08\0\0\0\0\0\0\0\0\0\0\0", 8) } else { (b"II\x2a\0\0\0\0\0", 4) }
}

/// Encodes an offset or count in the word width of the file.
pub(crate) fn word(number: u64, big: bool) -> Vec<u8> {
    let bytes = number.to_le_bytes();
    bytes[..if big { 8 } else { 4 }].to_vec()
}

/// Bytes of a directory's entry count, and of an offset.
fn widths(big: bool) -> (usize, usize) {
    if big { (8, 8) } else { (2, 4) }
}

/// Returns the file offset of a tag's value field, in a directory at offset `at`.
pub(crate) fn value_place(tags: &[(u16, IfdField)], wanted: u16, at: u64, big: bool) -> u64 {
    let before = tags.iter().filter(|(number, _)| *number < wanted).count();
    let (count_bytes, word_bytes) = widths(big);
    at + (count_bytes + before * (4 + 2 * word_bytes) + 4 + word_bytes) as u64
}

/// Encodes a directory for offset `at`, followed by the values that do not fit its entries. `next`
/// is the offset of the next directory, or 0.
pub(crate) fn directory(mut tags: Vec<(u16, IfdField)>, at: u64, next: u64, big: bool) -> Vec<u8> {
    sort::by_key(&mut tags, |(number, _)| u64::from(*number));
    let (count_bytes, word_bytes) = widths(big);
    let entries_bytes = tags.len() * (4 + 2 * word_bytes);
    let mut entries = (tags.len() as u64).to_le_bytes()[..count_bytes].to_vec();
    let mut values = Vec::new();
    let values_at = at + (count_bytes + entries_bytes + word_bytes) as u64;
    for (number, field) in tags {
        let (kind, count, mut bytes) = field.encode();
        entries.extend(number.to_le_bytes());
        entries.extend(kind.to_le_bytes());
        entries.extend(word(count, big));
        if let IfdField::Later { width, at, .. } = field
            && count.saturating_mul(width as u64) > word_bytes as u64
        {
            entries.extend(word(at, big));
        } else if bytes.len() <= word_bytes {
            bytes.resize(word_bytes, 0);
            entries.extend(bytes);
        } else {
            entries.extend(word(values_at + values.len() as u64, big));
            // TIFF requires even offsets of values and directories.
            bytes.resize(bytes.len().next_multiple_of(2), 0);
            values.extend(bytes);
        }
    }
    entries.extend(word(next, big));
    entries.extend(values);
    entries
}

/// Returns the GeoTIFF tags of a frame.
pub(super) fn geo_tags(frame: &Frame) -> Vec<(u16, IfdField)> {
    let mut tags = geo_key_tags(frame);
    if frame.is_identity() {
        return tags;
    }
    // If samples are points, and a key states that, raster coordinates refer to the points.
    let has_keys = !tags.is_empty();
    let origin = if frame.pixel_is_point && has_keys { [0.5, 0.5, 0.0] } else { [0.0; 3] };
    let [a, b, c, d, e, f] = frame.shifted(origin).affine();
    if b == 0.0 && d == 0.0 && a > 0.0 && e < 0.0 {
        tags.push((tag::MODEL_PIXEL_SCALE, IfdField::Double(vec![a, -e, 0.0])));
        tags.push((tag::MODEL_TIEPOINT, IfdField::Double(vec![0.0, 0.0, 0.0, c, f, 0.0])));
    } else {
        let matrix = [[a, b, 0.0, c], [d, e, 0.0, f], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        tags.push((tag::MODEL_TRANSFORMATION, IfdField::Double(matrix.concat())));
    }
    tags
}

/// GeoTIFF tags of ground control points: tie points without a scale.
pub(super) fn control_point_tags(points: &ControlPoints) -> Vec<(u16, IfdField)> {
    // Positions refer to pixel corners, as for pixels that are areas.
    let mut tags = geo_key_tags(&Frame { crs: points.crs.clone(), ..Frame::identity() });
    let tie_point = |point: &ControlPoint| {
        let ([column, row], [x, y, z]) = (point.cell, point.world);
        [column, row, 0.0, x, y, z]
    };
    tags.push((tag::MODEL_TIEPOINT, IfdField::Double(points.points.iter().flat_map(tie_point).collect())));
    tags
}

/// Returns the keys that define a coordinate system: its original keys, its EPSG code, or its
/// parameters. `None` if keys cannot express it.
pub(crate) fn geo_keys(crs: &Crs) -> Option<GeoKeys> {
    crs.to_geo_keys().ok()
}

/// The tags that define the coordinate system and the raster type.
fn geo_key_tags(frame: &Frame) -> Vec<(u16, IfdField)> {
    // Without a coordinate system no keys are written: readers would turn a lone raster type key
    // into a local system.
    let Some(crs) = &frame.crs else { return Vec::new() };
    let raster_type = if frame.pixel_is_point { RASTER_PIXEL_IS_POINT } else { RASTER_PIXEL_IS_AREA };
    let Some(keys) = geo_keys(crs) else {
        // The sidecar has the coordinate system and takes precedence.
        let points = IfdField::Short(vec![1, 1, 0, 1, RASTER_TYPE, 0, 1, RASTER_PIXEL_IS_POINT]);
        return if frame.pixel_is_point { vec![(tag::GEO_KEY_DIRECTORY, points)] } else { Vec::new() };
    };
    let mut tags = vec![(tag::GEO_KEY_DIRECTORY, IfdField::Short(keys.directory(raster_type)))];
    if !keys.doubles().is_empty() {
        tags.push((tag::GEO_DOUBLE_PARAMS, IfdField::Double(keys.doubles().to_vec())));
    }
    if !keys.strings().is_empty() {
        tags.push((tag::GEO_ASCII_PARAMS, IfdField::Ascii(keys.strings().to_vec())));
    }
    tags
}

/// GDAL's tag for nodata.
pub(super) fn nodata_tag(number: Number) -> (u16, IfdField) {
    (
        tag::GDAL_NODATA,
        IfdField::Ascii(if number.is_nan() { "nan".into() } else { number.to_string().into_bytes() }),
    )
}

/// Text tags, by GDAL's names.
pub(super) fn text_tags(text_by_name: &BTreeMap<String, String>) -> Vec<(u16, IfdField)> {
    let tags = [
        (tag::DOCUMENT_NAME, "TIFFTAG_DOCUMENTNAME"),
        (tag::IMAGE_DESCRIPTION, "TIFFTAG_IMAGEDESCRIPTION"),
        (tag::SOFTWARE, "TIFFTAG_SOFTWARE"),
        (tag::DATE_TIME, "TIFFTAG_DATETIME"),
        (tag::ARTIST, "TIFFTAG_ARTIST"),
        (tag::HOST_COMPUTER, "TIFFTAG_HOSTCOMPUTER"),
        (tag::COPYRIGHT, "TIFFTAG_COPYRIGHT"),
    ];
    tags.into_iter()
        .filter_map(|(tag, name)| {
            Some((tag, IfdField::Ascii(text_by_name.get(name)?.replace('\0', "").into_bytes())))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(tags: &[(u16, IfdField)], wanted: u16) -> Option<Vec<f64>> {
        let field = tags.iter().find(|(number, _)| *number == wanted)?;
        match &field.1 {
            IfdField::Double(numbers) => Some(numbers.clone()),
            IfdField::Short(numbers) => Some(numbers.iter().map(|&n| f64::from(n)).collect()),
            _ => None,
        }
    }

    #[test]
    fn north_up_points() {
        let mut frame = Frame::planar([1.0, 0.0, 7.5, 0.0, -1.0, 47.5]);
        frame.crs = Some(Crs::epsg(4326));
        frame.pixel_is_point = true;
        let tags = geo_tags(&frame);
        assert_eq!(find(&tags, 33550), Some(vec![1.0, 1.0, 0.0]));
        assert_eq!(find(&tags, 33922), Some(vec![0.0, 0.0, 0.0, 8.0, 47.0, 0.0]));
        let keys = [[1, 1, 0, 3], [1024, 0, 1, 2], [1025, 0, 1, 2], [2048, 0, 1, 4326]].concat();
        assert_eq!(find(&tags, 34735), Some(keys.into_iter().map(f64::from).collect()));
    }

    #[test]
    fn geo_keys_without_a_coordinate_system() {
        let mut frame = Frame::planar([1.0, 0.0, 7.5, 0.0, -1.0, 47.5]);
        frame.pixel_is_point = true;
        // No key states that these are points, so positions are written as those of areas.
        assert_eq!(find(&geo_tags(&frame), 34735), None);
        assert_eq!(find(&geo_tags(&frame), 33922), Some(vec![0.0, 0.0, 0.0, 7.5, 47.5, 0.0]));
        frame.crs = Some(Crs::Wkt("LOCAL_CS[\"site\",UNIT[\"metre\",1]]".into()));
        assert_eq!(find(&geo_tags(&frame), 34735), Some(vec![1.0, 1.0, 0.0, 1.0, 1025.0, 0.0, 1.0, 2.0]));
        assert_eq!(find(&geo_tags(&frame), 33922), Some(vec![0.0, 0.0, 0.0, 8.0, 47.0, 0.0]));
    }

    #[test]
    fn rotated_and_projected() {
        let mut frame = Frame::planar([2.0, 0.5, 10.0, -0.5, -2.0, 20.0]);
        frame.crs = Some(Crs::epsg(2056));
        let tags = geo_tags(&frame);
        let matrix = [[2.0, 0.5, 0.0, 10.0], [-0.5, -2.0, 0.0, 20.0], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        assert_eq!(find(&tags, 34264), Some(matrix.concat()));
        let keys = [[1, 1, 0, 3], [1024, 0, 1, 1], [1025, 0, 1, 1], [3072, 0, 1, 2056]].concat();
        assert_eq!(find(&tags, 34735), Some(keys.into_iter().map(f64::from).collect()));
        assert!(geo_tags(&Frame::identity()).is_empty());
    }

    #[test]
    fn control_points_are_tie_points_without_a_scale() {
        let crs = Some(Crs::epsg(4326));
        let point = ControlPoint { cell: [0.5, 2.0], world: [7.0, 8.0, 9.0] };
        let tags = control_point_tags(&ControlPoints { crs, points: vec![point, point] });
        assert_eq!(find(&tags, 33922), Some([[0.5, 2.0, 0.0, 7.0, 8.0, 9.0]; 2].concat()));
        assert_eq!(find(&tags, 33550), None);
        assert_eq!(find(&tags, 34735).map(|keys| keys.len()), Some(16));
    }

    #[test]
    fn long_values_follow_the_directory() {
        let tags = vec![(300, IfdField::Short(vec![7, 8, 9])), (256, IfdField::Long(vec![5]))];
        let bytes = directory(tags, 100, 0, false);
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
