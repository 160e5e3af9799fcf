//! `FlatGeobuf`: features in the order of a space-filling curve, behind an index of their boxes (a packed Hilbert R-tree).

use flatgeobuf::geozero::error::GeozeroError;
use flatgeobuf::geozero::{ColumnValue, FeatureProcessor, GeomProcessor, PropertyProcessor};
use flatgeobuf::{ColumnType, FgbCrs, FgbWriter, FgbWriterOptions, GeometryType};

use super::text::joined;
use super::{AttributeType, AttributeValue, FormatWriter, Geometry, GeometryKind, VectorLayer};
use spinney_base::io::Output;
use spinney_base::io::spill::failed;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Points of a feature, which is put together in memory.
const MOST_POINTS: u64 = 1 << 22;

/// Features, of which the boxes are sorted in memory: about 150 bytes each.
const MOST_FEATURES: u64 = 1 << 21;

/// Features wait in a file in the folder of temporary files.
pub(super) struct FlatGeobuf {
    output: Output,
    layer: VectorLayer,
    writer: FgbWriter<'static>,
    features: u64,
}

impl FlatGeobuf {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<FlatGeobuf> {
        let name = layer.crs.as_ref().and_then(Crs::name);
        let epsg = layer.crs.as_ref().and_then(|crs| crs.numbers());
        let wkt = layer.crs.as_ref().and_then(|crs| crs.to_wkt2().ok().or_else(|| crs.foreign_text()));
        let crs = FgbCrs {
            org: epsg.map(|_| "EPSG"),
            code: epsg.map_or(0, |epsg| epsg.horizontal as i32),
            name: name.as_deref(),
            wkt: wkt.as_deref(),
            ..FgbCrs::default()
        };
        let options = FgbWriterOptions {
            detect_type: false,
            promote_to_multi: false,
            crs,
            has_z: layer.has_z,
            ..FgbWriterOptions::default()
        };
        let kind = match layer.kind {
            Some(GeometryKind::Point) => GeometryType::Point,
            Some(GeometryKind::Line) => GeometryType::LineString,
            Some(GeometryKind::Polygon) => GeometryType::Polygon,
            None => GeometryType::Unknown,
        };
        let mut writer = FgbWriter::create_with_options(&layer.name, kind, options)
            .map_err(|error| failed(output.path())(std::io::Error::other(error)))?;
        for (name, kind) in &layer.attributes {
            let kind = match kind {
                AttributeType::Number => ColumnType::Double,
                AttributeType::Text | AttributeType::PerSegment => ColumnType::String,
            };
            writer.add_column(name, kind, |_, _| {});
        }
        Ok(FlatGeobuf { output, layer, writer, features: 0 })
    }

    fn points(&mut self, geometry: &dyn Geometry, part: usize) -> Result<()> {
        let (writer, has_z, path) = (&mut self.writer, self.layer.has_z, self.output.path());
        let mut index = 0;
        geometry.points(part, &mut |points| {
            for &[x, y, z] in points {
                let added = match has_z {
                    true => writer.coordinate(x, y, Some(z), None, None, None, index),
                    false => writer.xy(x, y, index),
                };
                added.map_err(|error| unwritten(path, error))?;
                index += 1;
            }
            Ok(())
        })
    }

    /// Does a step of writing.
    fn step(
        &mut self,
        step: impl FnOnce(&mut FgbWriter<'static>) -> std::result::Result<(), GeozeroError>,
    ) -> Result<()> {
        step(&mut self.writer).map_err(|error| unwritten(self.output.path(), error))
    }

    fn geometry(&mut self, kind: GeometryKind, geometry: &dyn Geometry) -> Result<()> {
        let count = |part: usize| geometry.count(part) as usize;
        match kind {
            GeometryKind::Point => {
                self.step(|writer| writer.point_begin(0))?;
                self.points(geometry, 0)?;
                self.step(|writer| writer.point_end(0))
            }
            GeometryKind::Line => {
                self.step(|writer| writer.linestring_begin(true, count(0), 0))?;
                self.points(geometry, 0)?;
                self.step(|writer| writer.linestring_end(true, 0))
            }
            GeometryKind::Polygon => {
                self.step(|writer| writer.polygon_begin(true, geometry.parts(), 0))?;
                for part in 0..geometry.parts() {
                    self.step(|writer| writer.linestring_begin(false, count(part), part))?;
                    self.points(geometry, part)?;
                    self.step(|writer| writer.linestring_end(false, part))?;
                }
                self.step(|writer| writer.polygon_end(true, 0))
            }
        }
    }
}

fn unwritten(path: &std::path::Path, error: GeozeroError) -> Error {
    failed(path)(std::io::Error::other(error))
}

impl FormatWriter for FlatGeobuf {
    fn write(
        &mut self,
        kind: GeometryKind,
        geometry: &dyn Geometry,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let parts = if kind == GeometryKind::Polygon { geometry.parts() } else { 1 };
        let points = (0..parts).fold(0u64, |sum, part| sum.saturating_add(geometry.count(part)));
        if points > MOST_POINTS || self.features == MOST_FEATURES {
            let found = match points > MOST_POINTS {
                true => format!("a feature of {points} points"),
                false => format!("more than {MOST_FEATURES} features"),
            };
            let advice = "choose GeoPackage, which needs no memory for them";
            return Err(Error::unsupported(self.output.path(), found, advice));
        }
        self.geometry(kind, geometry)?;
        for (index, value) in attributes.iter().enumerate() {
            let list: String;
            let value = match value {
                AttributeValue::Number(number) if number.is_finite() => ColumnValue::Double(*number),
                AttributeValue::Text(text) => ColumnValue::String(text),
                AttributeValue::PerSegment(numbers) => {
                    list = joined(numbers);
                    ColumnValue::String(&list)
                }
                AttributeValue::Number(_) | AttributeValue::None => continue,
            };
            self.step(|writer| writer.property(index, "", &value).map(drop))?;
        }
        let number = self.features;
        self.features += 1;
        self.step(|writer| writer.feature_end(number))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let FlatGeobuf { mut output, writer, .. } = *self;
        let path = output.path().to_path_buf();
        writer.write(&mut output).map_err(|error| failed(&path)(std::io::Error::other(error)))?;
        output.commit()
    }
}
