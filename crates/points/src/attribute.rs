//! Point attributes and their layout in rows of bytes.

use spinney_base::value::SampleType;

/// Attribute that every point of a tree has.
#[derive(Clone, Debug, PartialEq)]
pub struct PointAttribute {
    /// Name. LAS attributes are named `intensity`, `return_number`, `classification`, `gps_time`
    /// and so on.
    pub name: String,
    /// Type of the stored numbers.
    pub sample: SampleType,
    /// Scale and offset, if any: the quantity is `number * scale + offset`.
    pub scale_offset: Option<(f64, f64)>,
    /// Description in words, if the input has one.
    pub description: String,
    /// Number that encodes "no value", in the order of [`ordered_number`], as in LAS extra bytes.
    /// It is excluded from statistics, satisfies no condition, and is NaN as a quantity.
    pub(crate) no_data: Option<i64>,
}

impl PointAttribute {
    /// Creates an attribute with a name and a type.
    pub fn new(name: impl Into<String>, sample: SampleType) -> PointAttribute {
        PointAttribute {
            name: name.into(),
            sample,
            scale_offset: None,
            description: String::new(),
            no_data: None,
        }
    }

    /// Returns the number that encodes "no value", as stored, without scale and offset.
    pub fn no_data(&self) -> Option<f64> {
        self.no_data.map(|number| to_f64(self.sample, number))
    }

    /// Converts a number to its quantity; NaN if it encodes "no value".
    #[inline]
    pub(crate) fn quantity(&self, number: i64) -> f64 {
        if self.no_data == Some(number) {
            return f64::NAN;
        }
        let number = to_f64(self.sample, number);
        self.scale_offset.map_or(number, |(scale, offset)| number * scale + offset)
    }
}

/// Location of an attribute's number in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowField {
    /// Offset of its first byte.
    pub offset: usize,
    /// Lowest bit and bit count, if the number is a bit field within one byte.
    pub bits: Option<(u8, u8)>,
}

/// Row layout of a point: x, y and z on the grid as little-endian `i32`, then attributes.
#[derive(Clone, Debug, PartialEq)]
pub struct RowLayout {
    /// Bytes per row.
    pub size: usize,
    /// Attributes, in order.
    pub attributes: Vec<PointAttribute>,
    /// Location of each attribute in a row.
    pub fields: Vec<RowField>,
}

/// Size of a row's coordinates in bytes.
pub const POSITION_BYTES: usize = 12;

impl RowLayout {
    /// Creates a layout in which the attributes are contiguous.
    pub fn packed(attributes: Vec<PointAttribute>) -> RowLayout {
        let mut size = POSITION_BYTES;
        let fields = attributes.iter().map(|attribute| {
            let offset = size;
            size += attribute.sample.size();
            RowField { offset, bits: None }
        });
        let fields = fields.collect();
        RowLayout { size, attributes, fields }
    }

    /// Returns the index of the attribute with this name.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.attributes.iter().position(|attribute| attribute.name == name)
    }

    /// Returns an attribute's numbers in many rows, in the order of [`ordered`].
    pub(crate) fn numbers<'r>(&self, attribute: usize, rows: impl Iterator<Item = &'r [u8]>) -> Vec<i64> {
        // The type is matched outside the loop over the rows, so that each type gets its own loop.
        macro_rules! all {
            ($($sample:ident)*) => {
                match (self.fields[attribute], self.attributes[attribute].sample) {
                    (RowField { offset, bits: Some((shift, count)) }, _) => {
                        let mask = ((1u16 << count) - 1) as u8;
                        rows.map(|row| i64::from(row[offset] >> shift & mask)).collect()
                    }
                    $((RowField { offset, .. }, SampleType::$sample) => {
                        rows.map(|row| ordered(SampleType::$sample, &row[offset..])).collect()
                    })*
                }
            };
        }
        all!(U8 U16 I16 U32 I32 F32 F64 I8 U64 I64)
    }

    /// Writes an attribute's number into a row.
    #[inline]
    pub(crate) fn set_number(&self, attribute: usize, row: &mut [u8], number: i64) {
        let RowField { offset, bits } = self.fields[attribute];
        match bits {
            Some((shift, count)) => {
                let mask = (((1u16 << count) - 1) as u8) << shift;
                row[offset] = row[offset] & !mask | (number as u8) << shift & mask;
            }
            None => {
                let sample = self.attributes[attribute].sample;
                let bytes = bytes_of(sample, number);
                row[offset..offset + sample.size()].copy_from_slice(&bytes[..sample.size()]);
            }
        }
    }
}

/// Returns the coordinates of a row.
#[inline]
pub(crate) fn position_of(row: &[u8]) -> [i32; 3] {
    std::array::from_fn(|axis| {
        i32::from_le_bytes(row[4 * axis..4 * axis + 4].try_into().expect("four bytes"))
    })
}

/// Converts the number in the first bytes to an order-preserving integer. Floating-point numbers
/// are ordered by their bits.
#[inline(always)]
pub(crate) fn ordered(sample: SampleType, bytes: &[u8]) -> i64 {
    fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
        bytes[..N].try_into().expect("as long as it is")
    }
    match sample {
        SampleType::U8 => bytes[0].into(),
        SampleType::I8 => (bytes[0] as i8).into(),
        SampleType::U16 => u16::from_le_bytes(first(bytes)).into(),
        SampleType::I16 => i16::from_le_bytes(first(bytes)).into(),
        SampleType::U32 => u32::from_le_bytes(first(bytes)).into(),
        SampleType::I32 => i32::from_le_bytes(first(bytes)).into(),
        // Flipping the top bit maps unsigned order to signed order.
        SampleType::U64 => (u64::from_le_bytes(first(bytes)) ^ 1 << 63) as i64,
        SampleType::I64 => i64::from_le_bytes(first(bytes)),
        SampleType::F32 => {
            let bits = i32::from_le_bytes(first(bytes));
            (bits ^ ((bits >> 31) as u32 >> 1) as i32).into()
        }
        SampleType::F64 => {
            let bits = i64::from_le_bytes(first(bytes));
            bits ^ ((bits >> 63) as u64 >> 1) as i64
        }
    }
}

/// Converts the little-endian number in the first bytes to an integer. Integers of one type sort
/// like the numbers that they encode.
///
/// # Panics
/// If there are fewer bytes than the type has.
pub fn ordered_number(sample: SampleType, bytes: &[u8]) -> i64 {
    ordered(sample, bytes)
}

/// Returns the bytes of a number, the inverse of [`ordered`].
#[inline]
pub(crate) fn bytes_of(sample: SampleType, number: i64) -> [u8; 8] {
    match sample {
        SampleType::U64 => (number as u64 ^ 1 << 63).to_le_bytes(),
        SampleType::F32 => {
            let bits = number as i32;
            i64::from(bits ^ ((bits >> 31) as u32 >> 1) as i32).to_le_bytes()
        }
        SampleType::F64 => (number ^ ((number >> 63) as u64 >> 1) as i64).to_le_bytes(),
        _ => number.to_le_bytes(),
    }
}

/// Converts an ordered number to `f64`.
#[inline]
pub(crate) fn to_f64(sample: SampleType, number: i64) -> f64 {
    match sample {
        SampleType::U64 => (number as u64 ^ 1 << 63) as f64,
        SampleType::F32 => {
            f32::from_le_bytes(bytes_of(sample, number)[..4].try_into().expect("four bytes")).into()
        }
        SampleType::F64 => f64::from_le_bytes(bytes_of(sample, number)),
        _ => number as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_order_and_come_back() {
        let floats = [f64::NEG_INFINITY, -2.5, -0.0, 0.0, 1e-310, 3.0, f64::INFINITY];
        for sample in [SampleType::F64, SampleType::F32] {
            let bytes = |number: f64| match sample {
                SampleType::F32 => (number as f32).to_le_bytes().to_vec(),
                _ => number.to_le_bytes().to_vec(),
            };
            let numbers = floats.map(|number| ordered(sample, &bytes(number)));
            assert!(numbers.is_sorted(), "{numbers:?}");
            for (number, float) in numbers.into_iter().zip(floats) {
                assert_eq!(&bytes_of(sample, number)[..sample.size()], bytes(float));
                assert_eq!(
                    to_f64(sample, number),
                    if sample == SampleType::F32 { f64::from(float as f32) } else { float }
                );
            }
        }
        let numbers =
            [0, 1, 1 << 63, u64::MAX].map(|number: u64| ordered(SampleType::U64, &number.to_le_bytes()));
        assert!(numbers.is_sorted());
        assert_eq!(bytes_of(SampleType::U64, numbers[3]), [0xff; 8]);
        for sample in SampleType::ALL {
            for pattern in [[0; 8], [0x7f; 8], [0x80; 8], [1, 2, 3, 4, 5, 6, 7, 8]] {
                let number = ordered(sample, &pattern);
                assert_eq!(bytes_of(sample, number)[..sample.size()], pattern[..sample.size()], "{sample:?}");
            }
        }
    }

    #[test]
    fn fields_of_bits_leave_the_others_alone() {
        let attributes = ["a", "b"].map(|name| PointAttribute::new(name, SampleType::U8)).to_vec();
        let fields = [(0, 3), (3, 5)].map(|bits| RowField { offset: 12, bits: Some(bits) }).to_vec();
        let layout = RowLayout { size: 13, attributes, fields };
        let mut row = [0xff; 13];
        layout.set_number(0, &mut row, 2);
        let numbers = |row: &[u8]| [0, 1].map(|attribute| layout.numbers(attribute, std::iter::once(row))[0]);
        assert_eq!(numbers(&row), [2, 31]);
        layout.set_number(1, &mut row, 9);
        assert_eq!(numbers(&row), [2, 9]);
    }
}
