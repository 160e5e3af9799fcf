//! Export of lines, polygons and points with attributes to vector formats, one layer per file.
//!
//! Features and their points are streamed. Some formats buffer: GeoPackage up to 1 MiB of a
//! feature, Shapefile one part of a feature, FlatGeobuf one feature.
//!
//! ```
//! use spinney::export::VectorFormat;
//! use spinney::raw::export::vector::{AttributeType, AttributeValue, GeometryKind, VectorLayer, VectorWriter};
//! use spinney::Output;
//!
//! # let directory = tempfile::tempdir().unwrap();
//! # let path = directory.path().join("paths.geojson");
//! let layer = VectorLayer {
//!     name: "paths".into(),
//!     kind: Some(GeometryKind::Line),
//!     is_multi: false,
//!     has_z: false,
//!     attributes: vec![("length".into(), AttributeType::Number)],
//!     crs: None,
//!     bounds: [[0.0, 0.0], [3.0, 4.0]],
//! };
//! let mut writer = VectorWriter::create(Output::create(&path)?, VectorFormat::GeoJson, layer)?;
//! let path_of_points = [vec![[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]];
//! writer.write(&path_of_points, &[AttributeValue::Number(5.0)])?;
//! writer.finish(&())?;
//! # let text = std::fs::read_to_string(path).unwrap();
//! # assert!(text.contains(r#""properties":{"length":5},"geometry":{"type":"LineString","coordinates":[[0,0],[3,4]]}"#), "{text}");
//! # Ok::<(), spinney::Error>(())
//! ```

mod contours;
mod csv;
mod features;
#[cfg(feature = "flatgeobuf")]
mod flatgeobuf;
mod geojson;
mod geometry;
#[cfg(feature = "geopackage")]
mod geopackage;
mod intersection;
mod layer;
mod line_sections;
mod losses;
mod names;
mod obj;
mod ply;
mod polygons;
mod sections;
mod shapefile;
mod smooth;
mod svg;
mod text;
mod zones;

use std::path::{Path, PathBuf};
use std::str::FromStr;

pub use self::contours::{ContourFeatures, export_contours};
pub use self::features::FeatureParts;
pub(crate) use self::features::bounds_of;
pub use self::geometry::Geometry;
pub use self::intersection::{IntersectionSummary, export_intersection};
pub(crate) use self::layer::push_attribute;
pub use self::layer::{AttributeType, AttributeValue, GeometryKind, VectorLayer};
pub use self::line_sections::{
    LineSectionFigure, LineSectionOptions, LineSectionSummary, SectionLine, export_line_section, line_section,
};
pub use self::polygons::export_polygons;
pub use self::sections::{SectionPlanes, SectionSummary, export_section};
pub use self::smooth::Smoothed;
pub use self::zones::{export_zones, quantile_name};
pub use crate::objects::export_objects;

use self::geometry::Shape;
use self::losses::Losses;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};

/// Vector file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VectorFormat {
    /// `GeoJSON` (RFC 7946). Coordinates stay unchanged. In coordinate systems other than WGS 84,
    /// the file has the member `crs` of the 2008 version.
    GeoJson,
    /// Comma-separated values, with geometries as WKT.
    Csv,
    /// SVG drawing: y points up, attributes become `data-` attributes.
    Svg,
    /// `GeoPackage`, version 1.3 (feature `mbtiles`).
    GeoPackage,
    /// `FlatGeobuf` (feature `flatgeobuf`), with at most 2^22 points per feature. It has a spatial
    /// index unless some features have no geometry.
    FlatGeobuf,
    /// Shapefile (feature `raster`), with its `.shx`, `.dbf` and `.cpg` files, and the coordinate
    /// system as Esri WKT in `.prj`. The files are published atomically, the `.shp` file last.
    Shapefile,
    /// Wavefront OBJ: one object per feature, with lines, outlines as lines, and points. Attributes
    /// become comments.
    Obj,
    /// Binary PLY: vertices, and the edges of lines and outlines. An edge has its feature's index
    /// (`feature`, from 0), the feature's numeric attributes, and its own. Points are vertices
    /// without edges; strings are dropped.
    Ply,
}

impl VectorFormat {
    /// Returns the format for a file extension; `None` if it is unknown.
    pub fn of(path: &Path) -> Option<VectorFormat> {
        path.extension()?.to_str()?.parse().ok()
    }

    /// Returns whether the format needs a layer's bounds before its features.
    pub(crate) fn wants_bounds(self) -> bool {
        matches!(self, VectorFormat::Svg | VectorFormat::FlatGeobuf)
    }
}

impl FromStr for VectorFormat {
    type Err = Error;

    fn from_str(name: &str) -> Result<VectorFormat> {
        match name.to_ascii_lowercase().as_str() {
            "geojson" | "json" => Ok(VectorFormat::GeoJson),
            "csv" => Ok(VectorFormat::Csv),
            "svg" => Ok(VectorFormat::Svg),
            "gpkg" => Ok(VectorFormat::GeoPackage),
            "fgb" => Ok(VectorFormat::FlatGeobuf),
            "shp" => Ok(VectorFormat::Shapefile),
            "obj" => Ok(VectorFormat::Obj),
            "ply" => Ok(VectorFormat::Ply),
            _ => Err(Error::invalid("format", name, "geojson, csv, svg, gpkg, fgb, shp, obj or ply")),
        }
    }
}

/// Feature to be written.
pub struct VectorFeature<'a> {
    /// Id, a number or a string. GeoJSON stores both, GeoPackage integers only.
    pub id: Option<&'a serde_json::Value>,
    /// Kind and geometry, if it has one.
    pub geometry: Option<(GeometryKind, &'a dyn Geometry)>,
    /// Attributes, in number and types those of the layer, or no value.
    pub attributes: &'a [AttributeValue<'a>],
}

/// File of a format under construction.
trait FormatWriter {
    fn write(
        &mut self,
        id: Option<&serde_json::Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()>;
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Writer of a layer. The file is published when it is finished.
pub struct VectorWriter {
    writer: Box<dyn FormatWriter>,
    path: PathBuf,
    kind: Option<GeometryKind>,
    is_multi: bool,
    attributes: Vec<(String, AttributeType)>,
    /// Remarks on information about the layer that the file loses; `losses` counts that of its
    /// features.
    remarks: Vec<String>,
    losses: Losses,
}

impl VectorWriter {
    /// Starts a file of a layer. Attributes are renamed if the format does not allow their names.
    ///
    /// # Errors
    /// If the output cannot be written; if it is a stream and the format is a database; if the
    /// format does not support mixed kinds or points.
    pub fn create(output: Output, format: VectorFormat, mut layer: VectorLayer) -> Result<VectorWriter> {
        let path = output.path().to_path_buf();
        let names = names::of(format, &layer.attributes);
        let remarks = losses::of_layer(format, &layer, &names);
        layer.attributes.iter_mut().zip(names).for_each(|((own, _), name)| *own = name);
        let (kind, is_multi, attributes) = (layer.kind, layer.is_multi, layer.attributes.clone());
        let writer: Box<dyn FormatWriter> = match format {
            VectorFormat::GeoJson => Box::new(geojson::GeoJson::new(output, layer)?),
            VectorFormat::Csv => Box::new(csv::Csv::new(output, layer)?),
            VectorFormat::Svg => Box::new(svg::Svg::new(output, layer)?),
            VectorFormat::Obj => Box::new(obj::ObjLines::new(output, layer)?),
            VectorFormat::Ply => Box::new(ply::PlyEdges::new(output, layer)?),
            #[cfg(feature = "geopackage")]
            VectorFormat::GeoPackage => Box::new(geopackage::GeoPackage::new(output, layer)?),
            #[cfg(feature = "flatgeobuf")]
            VectorFormat::FlatGeobuf => Box::new(flatgeobuf::FlatGeobuf::new(output, layer)?),
            VectorFormat::Shapefile => Box::new(shapefile::Shapefile::new(output, layer)?),
            #[cfg(not(all(feature = "geopackage", feature = "flatgeobuf")))]
            format => {
                let advice = "use a build with support for it, or choose another format";
                return Err(Error::unsupported(output.path(), format!("writing {format:?}"), advice));
            }
        };
        Ok(VectorWriter { writer, path, kind, is_multi, attributes, remarks, losses: Losses::new(format) })
    }

    /// Writes a feature of the layer's kind with its attributes, in number and types those of the
    /// layer, or no value.
    ///
    /// # Errors
    /// If the attributes do not match, the layer has mixed kinds, the feature's points cannot be
    /// read, or the output cannot be written.
    pub fn write(&mut self, geometry: &dyn Geometry, attributes: &[AttributeValue<'_>]) -> Result<()> {
        match self.kind {
            Some(kind) => {
                self.write_feature(&VectorFeature { id: None, geometry: Some((kind, geometry)), attributes })
            }
            None => {
                Err(Error::invalid("geometry type of a feature", "none", "one, since the layer has several"))
            }
        }
    }

    /// Writes a feature of any kind that the layer allows, with its id, or without a geometry;
    /// otherwise like [`VectorWriter::write`].
    ///
    /// # Errors
    /// Those of [`VectorWriter::write`]; if the layer has another kind, or does not allow
    /// multi-geometries; if the format cannot store the id, or the id is a duplicate.
    pub fn write_feature(&mut self, feature: &VectorFeature<'_>) -> Result<()> {
        let attributes = feature.attributes;
        let fits = |((_, kind), value): (&(String, AttributeType), &AttributeValue<'_>)| value.fits(*kind);
        if attributes.len() != self.attributes.len() || !self.attributes.iter().zip(attributes).all(fits) {
            let found = format!("{attributes:?}");
            return Err(Error::invalid(
                "attributes of a feature",
                found,
                "values for the layer's attributes, in order",
            ));
        }
        let shape = feature.geometry.map(|(kind, geometry)| Shape::of(geometry, kind));
        if let Some(shape) = &shape {
            if self.kind.is_some() && shape.kind != self.kind {
                let found = shape.kind.map_or_else(|| "several".into(), |kind| format!("{kind:?}"));
                let expected = self.kind.map_or_else(String::new, |kind| format!("{kind:?}"));
                return Err(Error::invalid("geometry type of a feature", found, expected));
            }
            if self.kind.is_some() && !self.is_multi && shape.members.len() > 1 {
                let found = format!("{} geometries", shape.members.len());
                return Err(Error::invalid(
                    "geometry of a feature",
                    found,
                    "one, since the layer is not multi",
                ));
            }
        }
        self.writer.write(feature.id, shape.as_ref(), attributes)?;
        self.losses.count(feature, shape.as_ref(), &self.attributes);
        Ok(())
    }

    /// Completes and publishes the file; warns of all information that was lost.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self, progress: &dyn Progress) -> Result<()> {
        let VectorWriter { writer, path, remarks, losses, .. } = self;
        writer.finish()?;
        remarks.iter().chain(&losses.messages()).for_each(|text| progress.warn(&path, text));
        Ok(())
    }
}
