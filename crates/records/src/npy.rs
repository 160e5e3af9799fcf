//! Headers of NumPy's NPY files.

use std::io::{self, Read};
use std::path::Path;

use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// Magic number of NPY files.
pub const MAGIC: &[u8] = b"\x93NUMPY";

/// Maximum bytes of a header.
const MAX_HEADER: u32 = 1 << 16;

/// Item type of an array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Items {
    /// Samples of one type, by its name in NumPy: `<f4`.
    Samples(String),
    /// Records.
    Records(Vec<NpyField>),
}

/// Field of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NpyField {
    /// Name; empty for padding between fields.
    pub name: String,
    /// Name of its type.
    pub descr: String,
}

/// Header of an array.
#[derive(Debug)]
pub struct NpyHeader {
    /// Its item type.
    pub items: Items,
    /// Whether the first index varies fastest.
    pub fortran_order: bool,
    /// Length along each axis.
    pub shape: Vec<u64>,
}

impl NpyHeader {
    /// Reads the header of an array, of version 1.0, 2.0 or 3.0. Leaves `input` at the first
    /// sample.
    ///
    /// # Errors
    /// If there is none, it is longer than 64 KiB, or contains anything but named types, an order
    /// and a shape.
    pub fn read(input: &mut dyn Read, path: &Path) -> Result<NpyHeader> {
        let corrupt = |found: &str, expected: &str| Error::corrupt(path, "header", found, expected);
        let failed = |error: io::Error| match error.kind() {
            io::ErrorKind::UnexpectedEof => corrupt("the end of the file", "the header of an NPY file"),
            _ => Error::io(path, "read the header")(error),
        };
        let mut start = [0; 8];
        input.read_exact(&mut start).map_err(failed)?;
        if !start.starts_with(MAGIC) {
            return Err(corrupt("other first bytes", "the signature of an NPY file"));
        }
        let width = match (start[6], start[7]) {
            (1, 0) => 2,
            (2 | 3, 0) => 4,
            (major, minor) => {
                let found = format!("version {major}.{minor} of NPY");
                return Err(Error::unsupported(path, found, "save the array with numpy.save"));
            }
        };
        let mut length = [0; 4];
        input.read_exact(&mut length[..width]).map_err(failed)?;
        let length = u32::from_le_bytes(length);
        if length > MAX_HEADER {
            let found = format!("a header of {length} bytes");
            return Err(Error::unsupported(
                path,
                found,
                format!("save the array with a header of at most {MAX_HEADER} bytes"),
            ));
        }
        let mut bytes = vec![0; length as usize];
        input.read_exact(&mut bytes).map_err(failed)?;
        let text = String::from_utf8_lossy(&bytes);
        dictionary(&text).ok_or_else(|| {
            let found = format!("`{}`", text.chars().take(200).collect::<String>().trim().escape_debug());
            corrupt(&found, "a dictionary of descr, fortran_order and shape, with scalar fields only")
        })
    }

    /// Type name of the samples.
    ///
    /// # Errors
    /// If the array has records.
    pub fn samples(&self, path: &Path) -> Result<&str> {
        match &self.items {
            Items::Samples(descr) => Ok(descr),
            Items::Records(_) => {
                let advice = "save each field as a separate array: numpy.save(path, array['field'])";
                Err(Error::unsupported(path, "an array of records", advice))
            }
        }
    }

    /// The shape as a string: `(3, 4, 5)`.
    pub fn shape_text(&self) -> String {
        let lengths: Vec<String> = self.shape.iter().map(u64::to_string).collect();
        format!("({})", lengths.join(", "))
    }

    /// Encodes the header as version 1.0, or 2.0 if it is long, padded so that the samples begin at
    /// a multiple of 64 bytes.
    pub fn bytes(&self) -> Vec<u8> {
        let items = match &self.items {
            Items::Samples(descr) => format!("'{descr}'"),
            Items::Records(fields) => {
                let field = |field: &NpyField| {
                    let name = field.name.replace('\\', "\\\\").replace('\'', "\\'");
                    format!("('{name}', '{}')", field.descr)
                };
                format!("[{}]", fields.iter().map(field).collect::<Vec<_>>().join(", "))
            }
        };
        let order = if self.fortran_order { "True" } else { "False" };
        let comma = if self.shape.len() == 1 { "," } else { "" };
        let shape = self.shape_text().replace(')', &format!("{comma})"));
        let dictionary = format!("{{'descr': {items}, 'fortran_order': {order}, 'shape': {shape}, }}");
        let length = |start: usize| (start + dictionary.len() + 1).next_multiple_of(64) - start;
        let mut header = MAGIC.to_vec();
        let length = match u16::try_from(length(10)) {
            Ok(length) => {
                header.extend([1, 0]);
                header.extend(length.to_le_bytes());
                usize::from(length)
            }
            Err(_) => {
                let length = length(12);
                header.extend([2, 0]);
                header.extend((length as u32).to_le_bytes());
                length
            }
        };
        let end = header.len() + length;
        header.extend(dictionary.bytes());
        header.resize(end - 1, b' ');
        header.push(b'\n');
        header
    }
}

/// NumPy name of a sample type, little-endian.
pub fn descr_of(sample: SampleType) -> &'static str {
    match sample {
        SampleType::U8 => "|u1",
        SampleType::U16 => "<u2",
        SampleType::I16 => "<i2",
        SampleType::U32 => "<u4",
        SampleType::I32 => "<i4",
        SampleType::F32 => "<f4",
        SampleType::F64 => "<f8",
        SampleType::I8 => "|i1",
        SampleType::U64 => "<u8",
        SampleType::I64 => "<i8",
    }
}

/// Parses type, order and shape from a Python dictionary. Each key must occur exactly once, and no
/// others may.
fn dictionary(text: &str) -> Option<NpyHeader> {
    let mut literal = Literal(text);
    let (mut items, mut fortran_order, mut shape) = (None, None, None);
    literal.expect("{")?;
    while !literal.take("}") {
        let name = literal.string()?;
        literal.expect(":")?;
        let is_again = match name {
            "descr" => items.replace(literal.items()?).is_some(),
            "fortran_order" => fortran_order.replace(literal.truth()?).is_some(),
            "shape" => shape.replace(literal.tuple()?).is_some(),
            _ => true,
        };
        if is_again || !literal.goes_on("}") {
            return None;
        }
    }
    // NumPy arrays have at most 64 dimensions, and no supported type name is longer than 64 bytes.
    let is_short = |descr: &String| descr.len() <= 64;
    let items = items.filter(|items| match items {
        Items::Samples(descr) => is_short(descr),
        Items::Records(fields) => fields.iter().all(|field| is_short(&field.descr)),
    });
    let shape = shape.filter(|shape: &Vec<u64>| shape.len() <= 64);
    let header = NpyHeader { items: items?, fortran_order: fortran_order?, shape: shape? };
    literal.0.trim_ascii().is_empty().then_some(header)
}

/// The rest of a Python literal.
struct Literal<'a>(&'a str);

impl<'a> Literal<'a> {
    /// Skips blanks and a token if it comes next; returns whether it did.
    fn take(&mut self, token: &str) -> bool {
        let rest = self.0.trim_ascii_start().strip_prefix(token);
        self.0 = rest.unwrap_or(self.0);
        rest.is_some()
    }

    fn expect(&mut self, token: &str) -> Option<()> {
        self.take(token).then_some(())
    }

    /// Skips a comma after an item. Returns whether it was there, or the end comes next.
    fn goes_on(&mut self, end: &str) -> bool {
        self.take(",") || self.0.trim_ascii_start().starts_with(end)
    }

    /// Reads a string without escapes.
    fn string(&mut self) -> Option<&'a str> {
        let quote = if self.take("'") { '\'' } else { self.expect("\"").map(|()| '"')? };
        let (text, rest) = self.0.split_once(quote)?;
        self.0 = rest;
        (!text.contains('\\')).then_some(text)
    }

    /// Reads a type name, or a list of pairs of field name and type name.
    fn items(&mut self) -> Option<Items> {
        if !self.take("[") {
            return self.string().map(|descr| Items::Samples(descr.into()));
        }
        let mut fields = Vec::new();
        while !self.take("]") {
            self.expect("(")?;
            let name = self.string()?.into();
            self.expect(",")?;
            let descr = self.string()?.into();
            self.expect(")")?;
            fields.push(NpyField { name, descr });
            self.goes_on("]").then_some(())?;
        }
        Some(Items::Records(fields))
    }

    fn truth(&mut self) -> Option<bool> {
        if self.take("True") { Some(true) } else { self.expect("False").map(|()| false) }
    }

    /// Reads a tuple of integers.
    fn tuple(&mut self) -> Option<Vec<u64>> {
        self.expect("(")?;
        let mut numbers = Vec::new();
        while !self.take(")") {
            let text = self.0.trim_ascii_start();
            let end = text.find(|c: char| !c.is_ascii_digit())?;
            numbers.push(text[..end].parse().ok()?);
            // Python 2 appended an L to long integers.
            self.0 = text[end..].strip_prefix('L').unwrap_or(&text[end..]);
            self.goes_on(")").then_some(())?;
        }
        Some(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(text: &str) -> Option<(Items, bool, Vec<u64>)> {
        dictionary(text).map(|header| (header.items, header.fortran_order, header.shape))
    }

    fn records(fields: &[(&str, &str)]) -> Items {
        let field =
            |(name, descr): &(&str, &str)| NpyField { name: name.to_string(), descr: descr.to_string() };
        Items::Records(fields.iter().map(field).collect())
    }

    #[test]
    fn dictionaries_are_read() {
        let expected = Some((Items::Samples("<f4".into()), false, vec![3, 4, 5]));
        for text in [
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5), }    \n",
            "{\"shape\":(3L,4L,5,),\"descr\":\"<f4\",\"fortran_order\":False}",
        ] {
            assert_eq!(parts(text), expected, "{text}");
        }
        let empty = parts("{'descr':'|u1','fortran_order':True,'shape':()}");
        assert_eq!(empty, Some((Items::Samples("|u1".into()), true, vec![])));
        let text = "{'descr': [('x', '<f8'), ('', '|V4')], 'fortran_order': False, 'shape': (7,), }";
        assert_eq!(parts(text), Some((records(&[("x", "<f8"), ("", "|V4")]), false, vec![7])));
    }

    #[test]
    fn headers_come_back() {
        let many: Vec<(String, &str)> = (0..9000).map(|number| (format!("f{number}"), "<i4")).collect();
        let many: Vec<(&str, &str)> = many.iter().map(|(name, descr)| (name.as_str(), *descr)).collect();
        for items in
            [Items::Samples("<f4".into()), records(&[("x", "<f8"), ("class", "|u1")]), records(&many[..2000])]
        {
            let header = NpyHeader { items, fortran_order: false, shape: vec![7] };
            let bytes = header.bytes();
            assert_eq!((bytes.len() % 64, bytes.last()), (0, Some(&b'\n')));
            let again = NpyHeader::read(&mut &bytes[..], Path::new("a.npy")).unwrap();
            assert_eq!((again.items, again.shape), (header.items, header.shape));
        }
        // Longer than what `read` accepts.
        let header = NpyHeader { items: records(&many), fortran_order: false, shape: vec![7] };
        assert_eq!(header.bytes()[6], 2);
    }

    #[test]
    fn invalid_headers_are_refused() {
        for text in [
            "",
            "{",
            "{}",
            "{'descr'",
            "{'descr': '<f4}",
            "{'descr': '<f4', 'fortran_order': False}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5)",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5)} x",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5), 'more': 1}",
            "{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5)}",
            "{'descr': '<f4' 'fortran_order': False, 'shape': (3, 4, 5)}",
            "{'descr': '<f4', 'fortran_order': false, 'shape': (3, 4, 5)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': [3, 4, 5]}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, -4, 5)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4.0, 5)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3,, 5)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3 4)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (18446744073709551616, 4, 5)}",
            &format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({})}}", "1, ".repeat(65)),
            "{'descr': '\\x3cf4', 'fortran_order': False, 'shape': (3, 4, 5)}",
            "{'descr': [('a', '<f4', (3,))], 'fortran_order': False, 'shape': (3, 4, 5)}",
            "{'descr': [('a', [('b', '<f4')])], 'fortran_order': False, 'shape': (3, 4, 5)}",
            "{'descr': [('a', '<f4'], 'fortran_order': False, 'shape': (3, 4, 5)}",
            "__import__('os').system('true')",
        ] {
            assert_eq!(parts(text), None, "{text}");
        }
    }
}
