//! Headers of NumPy's NPY files.

use std::io::{self, Read};
use std::path::Path;

use spinney_base::{Error, Result};

/// The first bytes of every NPY file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// Bytes that a header may have.
const MOST: u32 = 1 << 16;

/// Header of an array.
pub(super) struct Header {
    /// Name of the samples' type, as NumPy writes it: `<f4`.
    pub(super) descr: String,
    /// Whether the first index runs fastest.
    pub(super) fortran_order: bool,
    /// Length along each axis.
    pub(super) shape: Vec<u64>,
}

impl Header {
    /// Reads the header of an array, of version 1.0, 2.0 or 3.0; the first sample comes next.
    ///
    /// # Errors
    /// If there is none, it is longer than 64 KiB, or tells anything but a type by its name, an order and a shape.
    pub(super) fn read(input: &mut dyn Read, path: &Path) -> Result<Header> {
        let corrupt = |found: &str, expected: &str| Error::corrupt(path, "the header", found, expected);
        let failed = |error: io::Error| match error.kind() {
            io::ErrorKind::UnexpectedEof => corrupt("the end of the file", "the header of an array"),
            _ => Error::io(path, "read the header")(error),
        };
        let mut start = [0; 8];
        input.read_exact(&mut start).map_err(failed)?;
        if !start.starts_with(MAGIC) {
            return Err(corrupt("other first bytes", "those of an NPY file"));
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
        if length > MOST {
            let found = format!("a header of {length} bytes");
            return Err(Error::unsupported(path, found, format!("at most {MOST} are read")));
        }
        let mut bytes = vec![0; length as usize];
        input.read_exact(&mut bytes).map_err(failed)?;
        let text = String::from_utf8_lossy(&bytes);
        let Some((descr, fortran_order, shape)) = dictionary(&text) else {
            // (Nothing else has brackets.)
            if text.contains('[') {
                let advice = "save a field as an array of its own: numpy.save(path, array['field'])";
                return Err(Error::unsupported(path, "an array of records", advice));
            }
            let found = format!("`{}`", text.chars().take(200).collect::<String>().trim().escape_debug());
            return Err(corrupt(&found, "a dictionary of descr, fortran_order and shape"));
        };
        Ok(Header { descr: descr.into(), fortran_order, shape })
    }

    /// The shape in words: `(3, 4, 5)`.
    pub(super) fn shape_text(&self) -> String {
        let lengths: Vec<String> = self.shape.iter().map(u64::to_string).collect();
        format!("({})", lengths.join(", "))
    }
}

/// Type, order and shape from a dictionary as Python writes it; each has to be there once, and nothing else.
fn dictionary(text: &str) -> Option<(&str, bool, Vec<u64>)> {
    let mut literal = Literal(text);
    let (mut descr, mut fortran_order, mut shape) = (None, None, None);
    literal.expect("{")?;
    while !literal.take("}") {
        let name = literal.string()?;
        literal.expect(":")?;
        let is_again = match name {
            "descr" => descr.replace(literal.string()?).is_some(),
            "fortran_order" => fortran_order.replace(literal.truth()?).is_some(),
            "shape" => shape.replace(literal.tuple()?).is_some(),
            _ => true,
        };
        if is_again || !literal.goes_on("}") {
            return None;
        }
    }
    let is_all = literal.0.trim_ascii().is_empty();
    // No array of NumPy has more dimensions, and no type that anybody reads a longer name.
    let is_short = |(descr, _, shape): &(&str, bool, Vec<u64>)| descr.len() <= 64 && shape.len() <= 64;
    Some((descr?, fortran_order?, shape?)).filter(|found| is_all && is_short(found))
}

/// The rest of a text in Python's notation.
struct Literal<'a>(&'a str);

impl<'a> Literal<'a> {
    /// Steps over blanks and a token, if it comes next.
    fn take(&mut self, token: &str) -> bool {
        let rest = self.0.trim_ascii_start().strip_prefix(token);
        self.0 = rest.unwrap_or(self.0);
        rest.is_some()
    }

    fn expect(&mut self, token: &str) -> Option<()> {
        self.take(token).then_some(())
    }

    /// Steps over a comma after an item; whether it is there, or the end comes next.
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

    fn truth(&mut self) -> Option<bool> {
        if self.take("True") { Some(true) } else { self.expect("False").map(|()| false) }
    }

    /// Reads whole numbers in parentheses.
    fn tuple(&mut self) -> Option<Vec<u64>> {
        self.expect("(")?;
        let mut numbers = Vec::new();
        while !self.take(")") {
            let text = self.0.trim_ascii_start();
            let end = text.find(|c: char| !c.is_ascii_digit())?;
            numbers.push(text[..end].parse().ok()?);
            // (Python 2 wrote long numbers with an L.)
            self.0 = text[end..].strip_prefix('L').unwrap_or(&text[end..]);
            self.goes_on(")").then_some(())?;
        }
        Some(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dictionaries_are_read() {
        let expected = Some(("<f4", false, vec![3, 4, 5]));
        for text in [
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5), }    \n",
            "{\"shape\":(3L,4L,5,),\"descr\":\"<f4\",\"fortran_order\":False}",
        ] {
            assert_eq!(dictionary(text), expected, "{text}");
        }
        assert_eq!(
            dictionary("{'descr':'|u1','fortran_order':True,'shape':()}"),
            Some(("|u1", true, vec![]))
        );
    }

    #[test]
    fn other_texts_are_refused() {
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
            "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (3, 4, 5)}",
            "__import__('os').system('true')",
        ] {
            assert_eq!(dictionary(text), None, "{text}");
        }
    }
}
