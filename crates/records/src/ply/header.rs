//! The header of a PLY file: its elements and their properties.

use crate::text::{Lines, shown, whole, words};
use spinney_base::{Error, Result};
use std::path::Path;

/// Encoding of the numbers after the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Text.
    Ascii,
    /// Binary, little-endian.
    Little,
    /// Binary, big-endian.
    Big,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    /// Signed integer of one byte.
    I8,
    /// Unsigned integer of one byte.
    U8,
    /// Signed integer of two bytes.
    I16,
    /// Unsigned integer of two bytes.
    U16,
    /// Signed integer of four bytes.
    I32,
    /// Unsigned integer of four bytes.
    U32,
    /// Float of four bytes.
    F32,
    /// Float of eight bytes.
    F64,
}

impl Scalar {
    fn parse(word: &[u8]) -> Option<Scalar> {
        Some(match word {
            b"char" | b"int8" => Scalar::I8,
            b"uchar" | b"uint8" => Scalar::U8,
            b"short" | b"int16" => Scalar::I16,
            b"ushort" | b"uint16" => Scalar::U16,
            b"int" | b"int32" => Scalar::I32,
            b"uint" | b"uint32" => Scalar::U32,
            b"float" | b"float32" => Scalar::F32,
            b"double" | b"float64" => Scalar::F64,
            _ => return None,
        })
    }

    /// Bytes of a number in a binary file.
    pub fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    /// Returns whether it is an integer type.
    pub fn is_whole(self) -> bool {
        !matches!(self, Scalar::F32 | Scalar::F64)
    }
}

/// Property of an element.
#[derive(Clone, Debug)]
pub struct Property {
    /// Its name.
    pub name: String,
    /// Type of a list's length; `None` for a single number.
    pub length: Option<Scalar>,
    /// Type of the number or of the list's items.
    pub scalar: Scalar,
}

/// An element of the file: `count` records with the same properties.
#[derive(Clone, Debug)]
pub struct Element {
    /// Its name.
    pub name: String,
    /// Number of records.
    pub count: u64,
    /// Properties of each record.
    pub properties: Vec<Property>,
}

impl Element {
    /// Returns the index of a property that is a single number, by any of these names.
    pub fn number(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| p.length.is_none() && names.contains(&p.name.as_str()))
    }

    /// Indices of the properties red, green and blue.
    pub fn colour(&self) -> Option<[usize; 3]> {
        Some([
            self.number(&["red", "diffuse_red"])?,
            self.number(&["green", "diffuse_green"])?,
            self.number(&["blue", "diffuse_blue"])?,
        ])
    }

    /// Bytes of a record in a binary file; `None` if it contains lists.
    pub fn fixed_size(&self) -> Option<usize> {
        self.properties.iter().map(|p| p.length.is_none().then_some(p.scalar.size())).sum()
    }

    /// Minimum number of bytes of a record.
    fn least_size(&self, encoding: Encoding) -> u64 {
        match encoding {
            // A digit and a separator.
            Encoding::Ascii => 2 * self.properties.len() as u64,
            _ => self.properties.iter().map(|p| p.length.unwrap_or(p.scalar).size() as u64).sum(),
        }
    }
}

/// A PLY header.
#[derive(Debug)]
pub struct PlyHeader {
    /// Encoding of the numbers.
    pub encoding: Encoding,
    /// Elements, in file order.
    pub elements: Vec<Element>,
    /// Offset of the first element in the file.
    pub body: usize,
}

/// Maximum bytes of a header, which also bounds the number of elements and properties.
const MAX_BYTES: usize = 1 << 20;

impl PlyHeader {
    /// Parses the header of a file from the file's bytes.
    ///
    /// # Errors
    /// If it is corrupt, of another version, or declares more data than the file has.
    pub fn read(bytes: &[u8], path: &Path) -> Result<PlyHeader> {
        let start = &bytes[..bytes.len().min(MAX_BYTES)];
        let mut lines = Lines::new(start, 0);
        lines.next();
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut number = 1;
        loop {
            number += 1;
            let line_start = lines.offset;
            let line = lines.next();
            let place = || format!("PLY header, line {number}");
            let wrong =
                |expected: &str| Error::corrupt(path, place(), shown(line.unwrap_or_default()), expected);
            let Some(line) = line else {
                let expected = "a header of at most 1 MiB that ends with `end_header`";
                return Err(Error::corrupt(path, place(), "no `end_header` in the first MiB", expected));
            };
            let mut words = words(line);
            let mut next = || words.next().unwrap_or_default();
            match next() {
                b"" | b"comment" | b"obj_info" => {}
                b"format" => {
                    encoding = Some(match next() {
                        b"ascii" => Encoding::Ascii,
                        b"binary_little_endian" => Encoding::Little,
                        b"binary_big_endian" => Encoding::Big,
                        _ => {
                            return Err(wrong(
                                "`format ascii`, `binary_little_endian` or `binary_big_endian`",
                            ));
                        }
                    });
                    let version = next();
                    if version != b"1.0" {
                        let found = format!("PLY version {}", shown(version));
                        return Err(Error::unsupported(path, found, "convert it to PLY 1.0"));
                    }
                }
                b"element" => {
                    let (name, count) = (name(next()), whole(next()).and_then(|n| u64::try_from(n).ok()));
                    let (Some(name), Some(count)) = (name, count) else {
                        return Err(wrong("`element`, a name and a number"));
                    };
                    elements.push(Element { name, count, properties: Vec::new() });
                }
                b"property" => {
                    let Some(element) = elements.last_mut() else {
                        return Err(wrong("an `element` line before it"));
                    };
                    let expected = "`property`, a type or `list` and two types, and a name";
                    let (length, scalar) = match next() {
                        b"list" => {
                            let Some(length) = Scalar::parse(next()).filter(|length| length.is_whole())
                            else {
                                return Err(wrong("an integer type for the list length"));
                            };
                            (Some(length), Scalar::parse(next()))
                        }
                        word => (None, Scalar::parse(word)),
                    };
                    let (Some(scalar), Some(name)) = (scalar, name(next())) else {
                        return Err(wrong(expected));
                    };
                    element.properties.push(Property { name, length, scalar });
                }
                b"end_header" => {
                    let encoding = encoding.ok_or_else(|| wrong("a `format` line before it"))?;
                    // If lines end with a single CR, a following LF is the first byte of a number.
                    let is_bare = start.get(3) == Some(&b'\r') && start.get(4) != Some(&b'\n');
                    let body = if is_bare { line_start + line.len() + 1 } else { lines.offset };
                    let header = PlyHeader { encoding, elements, body: body.min(bytes.len()) };
                    header.check_size(bytes, path)?;
                    return Ok(header);
                }
                _ => return Err(wrong("`comment`, `element`, `property` or `end_header`")),
            }
        }
    }

    /// Checks that the file is long enough for its elements. Afterwards, element counts are bounded
    /// by the file size.
    fn check_size(&self, bytes: &[u8], path: &Path) -> Result<()> {
        let there = (bytes.len() - self.body) as u128;
        let mut needed = 0;
        for element in &self.elements {
            needed += u128::from(element.count) * u128::from(element.least_size(self.encoding));
            // The last number of a text file needs no separator.
            if needed > there + u128::from(self.encoding == Encoding::Ascii) {
                let found = format!("{there} bytes");
                let expected = format!("at least {needed} for {} x `{}`", element.count, element.name);
                return Err(Error::corrupt(path, "PLY body", found, expected));
            }
        }
        Ok(())
    }

    /// Index of the element with this name.
    pub fn element(&self, name: &str) -> Option<usize> {
        self.elements.iter().position(|element| element.name == name)
    }
}

fn name(word: &[u8]) -> Option<String> {
    (!word.is_empty()).then(|| String::from_utf8_lossy(word).into_owned())
}
