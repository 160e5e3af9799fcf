//! The numbers after a PLY header, in any encoding.

use super::header::{Element, Encoding, Property, Scalar};
use crate::text::{Words, line_number, real_or_none, shown, whole};

/// Reason why a number could not be read.
#[derive(Debug)]
pub struct Fault {
    /// Line or byte.
    pub place: String,
    /// The bytes or number found.
    pub found: String,
    /// Description of what was expected.
    pub expected: &'static str,
}

/// Result of a read. The error is boxed to keep it small, because readers return it for millions of
/// numbers.
pub type Read<T> = Result<T, Box<Fault>>;

/// A sequence of numbers.
pub trait Body {
    /// Reads a number, which may be infinite or NaN.
    fn number(&mut self, scalar: Scalar) -> Read<f64>;

    /// Reads an integer. `scalar` must be an integer type.
    fn whole(&mut self, scalar: Scalar) -> Read<i64>;

    /// Skips numbers.
    fn skip(&mut self, scalar: Scalar, count: u64) -> Read<()>;

    /// Creates an error about what was read last.
    fn fault(&self, found: String, expected: &'static str) -> Box<Fault>;

    /// Offset of the next number.
    fn offset(&self) -> usize;

    /// Reads the length of a list.
    #[inline]
    fn length(&mut self, scalar: Scalar) -> Read<u64> {
        let length = self.whole(scalar)?;
        u64::try_from(length).map_err(|_| self.fault(format!("a list length of {length}"), "at least 0"))
    }

    /// Skips one value of a property.
    fn skip_property(&mut self, property: &Property) -> Read<()> {
        let count = match property.length {
            Some(length) => self.length(length)?,
            None => 1,
        };
        self.skip(property.scalar, count)
    }

    /// Skips all records of an element.
    fn skip_element(&mut self, element: &Element) -> Read<()> {
        // Records without properties take no space, however many there are.
        let count = if element.properties.is_empty() { 0 } else { element.count };
        for _ in 0..count {
            for property in &element.properties {
                self.skip_property(property)?;
            }
        }
        Ok(())
    }
}

/// Numbers as text.
struct Ascii<'a> {
    bytes: &'a [u8],
    words: Words<'a>,
}

impl<'a> Ascii<'a> {
    fn new(bytes: &'a [u8], offset: usize) -> Self {
        Ascii { bytes, words: Words::new(bytes, offset) }
    }

    fn next<T>(&mut self, read: impl FnOnce(&[u8]) -> Option<T>, expected: &'static str) -> Read<T> {
        let Some(word) = self.words.next() else {
            self.words.offset = self.bytes.len();
            return Err(self.fault("the end of the file".into(), expected));
        };
        read(word).ok_or_else(|| self.fault(shown(word), expected))
    }
}

impl Body for Ascii<'_> {
    fn number(&mut self, scalar: Scalar) -> Read<f64> {
        // Rounded to the type's precision, so that text and binary files of the same mesh agree.
        let number = self.next(real_or_none, "a number")?;
        Ok(if scalar == Scalar::F32 { f64::from(number as f32) } else { number })
    }

    fn whole(&mut self, _scalar: Scalar) -> Read<i64> {
        self.next(whole, "an integer")
    }

    fn skip(&mut self, _scalar: Scalar, count: u64) -> Read<()> {
        (0..count).try_for_each(|_| self.next(|_| Some(()), "a number"))
    }

    fn fault(&self, found: String, expected: &'static str) -> Box<Fault> {
        let place = format!("line {}", line_number(self.bytes, self.words.offset));
        Box::new(Fault { place, found, expected })
    }

    fn offset(&self) -> usize {
        self.words.offset
    }
}

/// Binary numbers, big-endian if `BIG`.
struct Binary<'a, const BIG: bool> {
    bytes: &'a [u8],
    offset: usize,
}

impl<'a, const BIG: bool> Binary<'a, BIG> {
    fn new(bytes: &'a [u8], offset: usize) -> Self {
        Binary { bytes, offset }
    }

    #[inline]
    fn take<const N: usize>(&mut self) -> Read<[u8; N]> {
        let Some(bytes) = self.bytes[self.offset..].first_chunk::<N>() else { return Err(self.end()) };
        self.offset += N;
        let mut bytes = *bytes;
        if BIG {
            bytes.reverse();
        }
        Ok(bytes)
    }

    #[cold]
    fn end(&self) -> Box<Fault> {
        self.fault("the end of the file".into(), "more numbers")
    }
}

impl<const BIG: bool> Body for Binary<'_, BIG> {
    #[inline]
    fn number(&mut self, scalar: Scalar) -> Read<f64> {
        match scalar {
            Scalar::F32 => self.take().map(|bytes| f32::from_le_bytes(bytes).into()),
            Scalar::F64 => self.take().map(f64::from_le_bytes),
            // Integers of at most 32 bits are exact in `f64`.
            _ => self.whole(scalar).map(|number| number as f64),
        }
    }

    #[inline]
    fn whole(&mut self, scalar: Scalar) -> Read<i64> {
        match scalar {
            Scalar::I8 => self.take().map(|bytes| i8::from_le_bytes(bytes).into()),
            Scalar::U8 => self.take().map(|bytes| u8::from_le_bytes(bytes).into()),
            Scalar::I16 => self.take().map(|bytes| i16::from_le_bytes(bytes).into()),
            Scalar::U16 => self.take().map(|bytes| u16::from_le_bytes(bytes).into()),
            Scalar::I32 => self.take().map(|bytes| i32::from_le_bytes(bytes).into()),
            Scalar::U32 => self.take().map(|bytes| u32::from_le_bytes(bytes).into()),
            Scalar::F32 | Scalar::F64 => Err(self.fault("a floating-point number".into(), "an integer")),
        }
    }

    fn skip(&mut self, scalar: Scalar, count: u64) -> Read<()> {
        let rest = self.bytes.len() - self.offset;
        match usize::try_from(count).ok().and_then(|count| count.checked_mul(scalar.size())) {
            Some(length) if length <= rest => {
                self.offset += length;
                Ok(())
            }
            _ => Err(self.end()),
        }
    }

    fn fault(&self, found: String, expected: &'static str) -> Box<Fault> {
        Box::new(Fault { place: format!("before byte {}", self.offset), found, expected })
    }

    fn offset(&self) -> usize {
        self.offset
    }
}

/// Operation on a body, generic over the encoding of its numbers.
pub trait Visit {
    /// Result type.
    type Output;

    /// Reads numbers from the body.
    fn visit(self, body: impl Body) -> Self::Output;
}

/// Skips all records of an element.
struct Skip<'a>(&'a Element);

impl Visit for Skip<'_> {
    type Output = Read<usize>;

    fn visit(self, mut body: impl Body) -> Read<usize> {
        body.skip_element(self.0)?;
        Ok(body.offset())
    }
}

/// Returns the offset after all records of an element.
///
/// # Errors
/// If the file ends too early, or contains something other than numbers.
pub fn offset_after(encoding: Encoding, bytes: &[u8], offset: usize, element: &Element) -> Read<usize> {
    visit(encoding, bytes, offset, Skip(element))
}

/// Runs an operation on the numbers from an offset on.
pub fn visit<V: Visit>(encoding: Encoding, bytes: &[u8], offset: usize, visit: V) -> V::Output {
    match encoding {
        Encoding::Ascii => visit.visit(Ascii::new(bytes, offset)),
        Encoding::Little => visit.visit(Binary::<false>::new(bytes, offset)),
        Encoding::Big => visit.visit(Binary::<true>::new(bytes, offset)),
    }
}
