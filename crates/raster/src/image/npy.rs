//! NumPy arrays: a short header, then the samples.

use std::io::Write;

use super::{ImageSpec, RowWriter, raw};
use spinney_base::io::Output;
use spinney_base::value::{SampleType, ValueType};
use spinney_base::{Error, Result};

pub(super) fn create(mut output: Output, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    let header = array_header(spec.value, &[spec.height, spec.width]);
    output.write_all(&header).map_err(Error::io(output.path(), "write"))?;
    raw::create(output, spec)
}

/// The header of an array of such a shape; values of several channels have one more dimension.
///
/// Version 1.0: a Python dictionary, filled up so that the samples start at a multiple of 64 bytes.
pub(crate) fn array_header(value: ValueType, shape: &[u64]) -> Vec<u8> {
    let sample = match value.sample {
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
    };
    let channels = (value.channels > 1).then_some(u64::from(value.channels));
    let shape: Vec<String> = shape.iter().copied().chain(channels).map(|number| number.to_string()).collect();
    let shape = shape.join(", ");
    let dictionary = format!("{{'descr': '{sample}', 'fortran_order': False, 'shape': ({shape}), }}");
    let length = (dictionary.len() + 11).next_multiple_of(64) - 10;
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend((length as u16).to_le_bytes());
    header.extend(format!("{dictionary:width$}\n", width = length - 1).bytes());
    header
}
