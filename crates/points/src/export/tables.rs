//! Points as tables of numbers behind a header: PLY and NPY.

use std::io::Write;

use super::PointSink;
use crate::attribute::PointAttribute;
use crate::grid::PointGrid;
use crate::query::PointColumns;
use crate::store::PointTree;
use spinney_base::io::Output;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// Writes rows of x, y and z as doubles, then attributes, little-endian.
pub(super) struct TableSink {
    out: Output,
    grid: PointGrid,
    /// All attributes, and the places of those that are written.
    attributes: Vec<PointAttribute>,
    chosen: Vec<usize>,
    bytes: Vec<u8>,
}

/// The type in which an attribute is written.
fn written_as(attribute: &PointAttribute) -> SampleType {
    if attribute.scale_offset.is_some() { SampleType::F64 } else { attribute.sample }
}

impl TableSink {
    fn new(
        tree: &PointTree,
        chosen: Vec<usize>,
        mut out: Output,
        header: impl FnOnce(&[&PointAttribute]) -> Result<Vec<u8>>,
    ) -> Result<TableSink> {
        let attributes = tree.attributes().to_vec();
        let written: Vec<&PointAttribute> = chosen.iter().map(|place| &attributes[*place]).collect();
        let header = header(&written)?;
        out.write_all(&header).map_err(Error::io(out.path(), "write"))?;
        Ok(TableSink { out, grid: tree.grid().clone(), attributes, chosen, bytes: Vec::new() })
    }

    /// A PLY file of so many points.
    pub(super) fn ply(tree: &PointTree, chosen: Vec<usize>, count: u64, out: Output) -> Result<TableSink> {
        let path = out.path().to_path_buf();
        TableSink::new(tree, chosen, out, |attributes| {
            let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n");
            header.push_str("property double x\nproperty double y\nproperty double z\n");
            for attribute in attributes {
                let kind = match written_as(attribute) {
                    SampleType::U8 => "uchar",
                    SampleType::I8 => "char",
                    SampleType::U16 => "ushort",
                    SampleType::I16 => "short",
                    SampleType::U32 => "uint",
                    SampleType::I32 => "int",
                    SampleType::F32 => "float",
                    SampleType::F64 => "double",
                    SampleType::U64 | SampleType::I64 => {
                        let advice = "choose the others with --attribute, or write .npy, .csv or .las";
                        let found = format!("attribute {} of 64 bits in PLY", attribute.name);
                        return Err(Error::unsupported(path, found, advice));
                    }
                };
                let name: String =
                    attribute.name.chars().map(|c| if c.is_whitespace() { '_' } else { c }).collect();
                header.push_str(&format!("property {kind} {name}\n"));
            }
            header.push_str("end_header\n");
            Ok(header.into_bytes())
        })
    }

    /// An NPY file of so many points: version 2.0, a structured array.
    pub(super) fn npy(tree: &PointTree, chosen: Vec<usize>, count: u64, out: Output) -> Result<TableSink> {
        TableSink::new(tree, chosen, out, |attributes| {
            let mut fields = String::from("('x', '<f8'), ('y', '<f8'), ('z', '<f8')");
            for attribute in attributes {
                let sample = written_as(attribute);
                let kind = match sample {
                    SampleType::F32 | SampleType::F64 => 'f',
                    SampleType::U8 | SampleType::U16 | SampleType::U32 | SampleType::U64 => 'u',
                    _ => 'i',
                };
                let name = attribute.name.replace('\\', "\\\\").replace('\'', "\\'");
                fields.push_str(&format!(", ('{name}', '<{kind}{}')", sample.size()));
            }
            let mut text = format!("{{'descr': [{fields}], 'fortran_order': False, 'shape': ({count},), }}");
            // (The numbers begin at a multiple of 64.)
            let length = (12 + text.len() + 1).next_multiple_of(64) - 12;
            text.extend(std::iter::repeat_n(' ', length - text.len() - 1));
            text.push('\n');
            let mut header = b"\x93NUMPY\x02\x00".to_vec();
            header.extend_from_slice(&(text.len() as u32).to_le_bytes());
            header.extend_from_slice(text.as_bytes());
            Ok(header)
        })
    }
}

impl PointSink for TableSink {
    fn put(&mut self, points: &PointColumns) -> Result<()> {
        self.bytes.clear();
        points.rows(&self.grid, &self.attributes, &self.chosen, &mut self.bytes);
        self.out.write_all(&self.bytes).map_err(Error::io(self.out.path(), "write"))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.out.commit()
    }
}
