//! Well-known binary, in ISO form (13249-3) and with PostGIS flags, as in `GeoPackage` and tables.

use super::feature::FeatureGeometry;
use super::heights::Heights;

/// Maximum nesting depth of geometries.
pub(super) const MAX_DEPTH: usize = 16;

type Parsed<T> = Result<T, String>;

/// Parsed geometry, its SRID if it has one, and its heights.
#[derive(Debug, PartialEq)]
pub(super) struct ParsedGeometry {
    pub(super) geometry: FeatureGeometry,
    pub(super) system: Option<u32>,
    pub(super) heights: Heights,
}

/// Parses a geometry.
pub(super) fn parse(bytes: &[u8]) -> Parsed<ParsedGeometry> {
    let mut reader = Reader { bytes, is_little: true, heights: Heights::default() };
    let mut system = None;
    let geometry = reader.geometry(&mut system, 0)?;
    match reader.bytes.len() {
        0 => Ok(ParsedGeometry { geometry, system, heights: reader.heights }),
        more => Err(format!("{more} bytes after the geometry")),
    }
}

/// Decodes hexadecimal digits; `None` if they are invalid.
pub(super) fn bytes_of_digits(text: &str) -> Option<Vec<u8>> {
    let digit = |byte: u8| (byte as char).to_digit(16).map(|digit| digit as u8);
    let (pairs, rest) = text.as_bytes().as_chunks::<2>();
    let pair = |&[high, low]: &[u8; 2]| Some(digit(high)? << 4 | digit(low)?);
    if rest.is_empty() && !pairs.is_empty() { pairs.iter().map(pair).collect() } else { None }
}

struct Reader<'b> {
    /// Unread bytes.
    bytes: &'b [u8],
    is_little: bool,
    heights: Heights,
}

/// Coordinates of a point other than x and y.
#[derive(Clone, Copy)]
struct Axes {
    height: bool,
    measure: bool,
}

impl Axes {
    fn count(self) -> usize {
        2 + usize::from(self.height) + usize::from(self.measure)
    }
}

/// Header of a geometry.
struct Head {
    /// Type code, without flags.
    code: u32,
    axes: Axes,
}

impl ParsedGeometry {
    /// Removes empty parts; returns geometry and heights, or an error message.
    pub(super) fn checked(self) -> Parsed<(Option<FeatureGeometry>, Heights)> {
        self.geometry.checked().map(|geometry| (Some(geometry), self.heights))
    }
}

impl Reader<'_> {
    fn take<const BYTES: usize>(&mut self) -> Parsed<[u8; BYTES]> {
        let (taken, rest) = self.bytes.split_first_chunk().ok_or("a truncated geometry")?;
        self.bytes = rest;
        Ok(*taken)
    }

    fn number(&mut self) -> Parsed<u32> {
        let bytes = self.take()?;
        Ok(if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    fn head(&mut self, system: &mut Option<u32>) -> Parsed<Head> {
        self.is_little = match self.take::<1>()? {
            [0] => false,
            [1] => true,
            [other] => return Err(format!("byte order {other}")),
        };
        let number = self.number()?;
        let (plain, marks) = (number & 0x1fff_ffff, number >> 29);
        if marks & 1 != 0 {
            *system = Some(self.number()?);
        }
        let (thousands, code) = (plain / 1000, plain % 1000);
        if thousands > 3 {
            return Err(format!("a geometry of type {plain}"));
        }
        let has = |mark: u32, also: u32| marks & mark != 0 || thousands == also || thousands == 3;
        let axes = Axes { height: has(4, 1), measure: has(2, 2) };
        self.heights.are_there |= axes.height;
        self.heights.have_measures |= axes.measure;
        Ok(Head { code, axes })
    }

    /// Reads an element count; each element has at least `each` bytes.
    fn count(&mut self, each: usize) -> Parsed<usize> {
        let count = self.number()? as usize;
        match count <= self.bytes.len() / each {
            true => Ok(count),
            false => Err(format!("{count} points or parts in {} bytes", self.bytes.len())),
        }
    }

    /// Reads coordinates; missing ones are 0.
    fn coordinates(&mut self, axes: Axes) -> Parsed<[f64; 4]> {
        let mut point = [0.0; 4];
        for number in &mut point[..axes.count()] {
            let bytes = self.take()?;
            *number = if self.is_little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) };
        }
        Ok(point)
    }

    fn point(&mut self, axes: Axes) -> Parsed<[f64; 2]> {
        let [x, y, height, _] = self.coordinates(axes)?;
        self.heights.add_point(axes.height.then_some(height));
        Ok([x, y])
    }

    /// Reads a point geometry; a point with NaN coordinates is empty.
    fn point_geometry(&mut self, axes: Axes) -> Parsed<Option<[f64; 2]>> {
        let [x, y, height, _] = self.coordinates(axes)?;
        if x.is_nan() && y.is_nan() {
            return Ok(None);
        }
        self.heights.add_point(axes.height.then_some(height));
        Ok(Some([x, y]))
    }

    fn points(&mut self, axes: Axes) -> Parsed<Vec<[f64; 2]>> {
        let count = self.count(8 * axes.count())?;
        (0..count).map(|_| self.point(axes)).collect()
    }

    fn rings(&mut self, axes: Axes) -> Parsed<Vec<Vec<[f64; 2]>>> {
        let count = self.count(4)?;
        (0..count).map(|_| self.points(axes)).collect()
    }

    /// Reads geometries of one kind, each with its own header.
    fn members<T>(
        &mut self,
        kind: u32,
        mut member: impl FnMut(&mut Self, Axes) -> Parsed<T>,
    ) -> Parsed<Vec<T>> {
        let count = self.count(9)?;
        let each = |_| {
            let head = self.head(&mut None)?;
            match head.code == kind || (kind, head.code) == (3, 17) {
                true => member(self, head.axes),
                false => Err(format!("a geometry of type {} among those of type {kind}", head.code)),
            }
        };
        (0..count).map(each).collect()
    }

    fn geometry(&mut self, system: &mut Option<u32>, depth: usize) -> Parsed<FeatureGeometry> {
        let Head { code, axes } = self.head(system)?;
        match code {
            1 => Ok(FeatureGeometry::Points(self.point_geometry(axes)?.into_iter().collect())),
            2 => Ok(FeatureGeometry::Lines(vec![self.points(axes)?])),
            3 | 17 => Ok(FeatureGeometry::Polygons(vec![self.rings(axes)?])),
            4 => {
                let points = self.members(1, Reader::point_geometry)?;
                Ok(FeatureGeometry::Points(points.into_iter().flatten().collect()))
            }
            5 => Ok(FeatureGeometry::Lines(self.members(2, Reader::points)?)),
            6 => Ok(FeatureGeometry::Polygons(self.members(3, Reader::rings)?)),
            7 if depth == MAX_DEPTH => Err(format!("geometries nested {depth} deep")),
            7 => {
                let count = self.count(9)?;
                let members = (0..count).map(|_| self.geometry(&mut None, depth + 1));
                members.collect::<Parsed<_>>().map(FeatureGeometry::Collection)
            }
            8..=14 => Err("a curve (convert it to lines: ogr2ogr -nlt CONVERT_TO_LINEAR)".into()),
            15 | 16 => Err("a 3D surface (type 15 or 16)".into()),
            other => Err(format!("a geometry of type {other}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn geometries_of_all_writings() {
        let read = |digits: &str| parse(&bytes_of_digits(digits).unwrap());
        let point = FeatureGeometry::Points(vec![[1.0, 2.0]]);
        // Little- and big-endian; ISO and PostGIS flags of a third coordinate; with an SRID.
        for (digits, system) in [
            ("0101000000000000000000F03F0000000000000040", None),
            ("00000000013FF00000000000004000000000000000", None),
            ("01E9030000000000000000F03F00000000000000400000000000000840", None),
            ("0101000080000000000000F03F00000000000000400000000000000840", None),
            ("0101000020E6100000000000000000F03F0000000000000040", Some(4326)),
        ] {
            let found = read(digits).unwrap();
            assert_eq!((&found.geometry, found.system), (&point, system), "{digits}");
            let has_heights = digits.len() > 55;
            let expected = if has_heights { vec![3.0] } else { vec![] };
            assert_eq!(
                (found.heights.are_there, found.heights.of_points),
                (has_heights, expected),
                "{digits}"
            );
        }
        assert_eq!(
            read("0101000000000000000000F87F000000000000F87F").unwrap().geometry,
            FeatureGeometry::Points(vec![])
        );
        for wrong in
            ["01", "0201000000", "0101000000", "010200000000FFFFFF", "01FF000000", "010900000000000000"]
        {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        let deep = format!("{}{}", "010700000001000000".repeat(40), "010700000000000000");
        assert!(read(&deep).is_err_and(|error| error.contains("deep")));
        assert!(
            bytes_of_digits("0g").is_none()
                && bytes_of_digits("012").is_none()
                && bytes_of_digits("").is_none()
        );
    }
}
