//! Cells as rows of NumPy arrays.

use std::io::Read;
use std::path::Path;

use super::coordinate;
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_engine::ops::CellValue;
use spinney_records::npy::NpyHeader;

/// Decodes one number of a type.
type Decode = fn(&[u8]) -> Number;

macro_rules! decoders {
    ($($name:literal $type:ty),*) => {
        &[$(($name, size_of::<$type>(), |bytes| <$type>::from_le_bytes(bytes.try_into().expect("chunks have the size of the type")).into())),*]
    };
}

const TYPES: &[(&str, usize, Decode)] = decoders!(
    "|u1" u8, "|i1" i8, "<u2" u16, "<i2" i16, "<u4" u32, "<i4" i32, "<u8" u64, "<i8" i64, "<f4" f32, "<f8" f64
);

/// Yields one cell per row. The array must have two dimensions, with coordinates before values. A
/// cell whose values are not numbers is VOID.
pub(super) fn rows<R: Read>(
    mut input: R,
    path: &Path,
    axes: usize,
    channels: usize,
) -> Result<impl Iterator<Item = Result<CellValue>> + use<R>> {
    let unsupported = |found: String| {
        let advice = format!("save rows of {} little-endian numbers, in C order", axes + channels);
        Error::unsupported(path, found, advice)
    };
    let header = NpyHeader::read(&mut input, path)?;
    let descr = header.samples(path)?;
    let Some((_, size, decode)) = TYPES.iter().find(|(known, _, _)| *known == descr) else {
        return Err(unsupported(format!("an array of type `{descr}`")));
    };
    let columns = axes + channels;
    let count = match header.shape[..] {
        [rows, width] if width == columns as u64 && !header.fortran_order => rows,
        _ => return Err(unsupported(format!("an array of shape {}", header.shape_text()))),
    };
    let (path, size, decode) = (path.to_path_buf(), *size, *decode);
    let mut row = vec![0; columns * size];
    let mut number = 0;
    Ok(std::iter::from_fn(move || {
        if number == count {
            return None;
        }
        number += 1;
        if let Err(error) = input.read_exact(&mut row) {
            number = count;
            return Some(Err(Error::io(&path, "read")(error)));
        }
        let numbers: Vec<Number> = row.chunks(size).map(decode).collect();
        let mut cell = [0; 3];
        for (axis, found) in cell[..axes].iter_mut().zip(&numbers) {
            match coordinate(found.to_f64()) {
                Some(found) => *axis = found,
                None => {
                    let place = format!("row {}", number - 1);
                    return Some(Err(Error::corrupt(
                        &path,
                        place,
                        found.to_string(),
                        "a cell number from 0 on",
                    )));
                }
            }
        }
        let values = numbers[axes..].to_vec();
        Some(Ok((cell, Some(values).filter(|values| !values.iter().any(|value| value.is_nan())))))
    }))
}
