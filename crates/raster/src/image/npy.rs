//! Writer of NumPy arrays: a short header, then the samples.

use std::io::Write;

use super::{ImageSpec, RowWriter, raw};
use spinney_base::io::Output;
use spinney_base::value::ValueType;
use spinney_base::{Error, Result};
use spinney_records::npy::{Items, NpyHeader, descr_of};

pub(super) fn create(mut output: Output, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    let header = array_header(spec.value, &[spec.height, spec.width]);
    output.write_all(&header).map_err(Error::io(output.path(), "write"))?;
    raw::create(output, spec)
}

/// The header of an array of this shape. Several channels add a dimension.
pub(crate) fn array_header(value: ValueType, shape: &[u64]) -> Vec<u8> {
    let channels = (value.channels > 1).then_some(u64::from(value.channels));
    let shape = shape.iter().copied().chain(channels).collect();
    let items = Items::Samples(descr_of(value.sample).into());
    NpyHeader { items, fortran_order: false, shape }.bytes()
}
