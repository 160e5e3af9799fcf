//! Export of points as binary tables with a header: PLY and NPY.

use std::io::Write;

use super::PointSink;
use crate::attribute::PointAttribute;
use crate::grid::PointGrid;
use crate::query::PointColumns;
use crate::store::PointTree;
use spinney_base::io::Output;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_records::npy::{Items, NpyField, NpyHeader, descr_of};

/// Writes rows of x, y and z as doubles, then attributes, little-endian.
pub(super) struct TableSink {
    out: Output,
    grid: PointGrid,
    /// All attributes, and the indices of those that are written.
    attributes: Vec<PointAttribute>,
    chosen: Vec<usize>,
    bytes: Vec<u8>,
}

/// Returns the type in which an attribute is written.
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

    /// Creates a PLY file of `count` points.
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
                        let advice = "select other attributes with --attribute, or write .npy, .csv or .las";
                        let found = format!("the 64-bit attribute {} in PLY", attribute.name);
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

    /// Creates an NPY file of `count` points: a structured array.
    pub(super) fn npy(tree: &PointTree, chosen: Vec<usize>, count: u64, out: Output) -> Result<TableSink> {
        TableSink::new(tree, chosen, out, |attributes| {
            let field = |name: &str, sample| NpyField { name: name.into(), descr: descr_of(sample).into() };
            let coordinates = ["x", "y", "z"].map(|axis| field(axis, SampleType::F64));
            let others = attributes.iter().map(|attribute| field(&attribute.name, written_as(attribute)));
            let items = Items::Records(coordinates.into_iter().chain(others).collect());
            Ok(NpyHeader { items, fortran_order: false, shape: vec![count] }.bytes())
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
