//! Lines, polygons and points with attributes, as files of other programs: one layer of features each.
//!
//! Features are written as they come, points as they are handed out, so that none has to be held. For GeoPackage a feature is
//! held, up to a mebibyte of it; for Shapefile a part of a feature; for FlatGeobuf a feature.
//!
//! ```
//! use spinney::export::VectorFormat;
//! use spinney::raw::export::vector::{AttributeType, AttributeValue, GeometryKind, VectorLayer, VectorWriter};
//! use spinney::Output;
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("paths.geojson");
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
pub use self::polygons::export_polygons;
pub use self::sections::{SectionPlanes, SectionSummary, export_section};
pub use self::smooth::Smoothed;
pub use self::zones::{export_zones, quantile_name};
pub use crate::objects::export_objects;

use self::geometry::Shape;
use self::losses::Losses;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};

/// Format of a file of lines, polygons or points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VectorFormat {
    /// `GeoJSON` (RFC 7946): coordinates as they are, with the member `crs` of the format's first version (2008) where they are in another
    /// coordinate system than WGS 84 whose number is known.
    GeoJson,
    /// Comma-separated values, with geometries in well-known text.
    Csv,
    /// A drawing: y goes up, attributes are `data-` attributes.
    Svg,
    /// `GeoPackage`, version 1.3 (feature `mbtiles`).
    GeoPackage,
    /// `FlatGeobuf` with an index (feature `flatgeobuf`): of features of at most 2^22 points; without an index
    /// if some have no geometry.
    FlatGeobuf,
    /// Shapefile (feature `raster`): also the files `.shx`, `.dbf` and `.cpg` beside it, and `.prj` with the coordinate system in Esri's
    /// well-known text. Each of them appears whole; the one that was asked for is the last.
    Shapefile,
    /// Wavefront OBJ: an object for each feature, with lines, outlines as lines, and points; attributes are comments.
    Obj,
    /// PLY, binary: vertices, and edges of lines and outlines with their feature's number (`feature`, from 0), its attributes that are
    /// numbers, and their own. Points are vertices without edges; texts are left out.
    Ply,
}

impl VectorFormat {
    /// The format of a file by its name's ending; `None` if it is another one.
    pub fn of(path: &Path) -> Option<VectorFormat> {
        path.extension()?.to_str()?.parse().ok()
    }

    /// Whether a layer's bounds must be known before its features, and not only those of what is written.
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

/// A feature that is written.
pub struct VectorFeature<'a> {
    /// Its id, a number or a text, for formats that have ids: GeoJSON, and of GeoPackage whole numbers.
    pub id: Option<&'a serde_json::Value>,
    /// Kind and geometry, if it has one.
    pub geometry: Option<(GeometryKind, &'a dyn Geometry)>,
    /// Its attributes, as many as the layer has, and of their types or none.
    pub attributes: &'a [AttributeValue<'a>],
}

/// A file of a format in the making.
trait FormatWriter {
    fn write(
        &mut self,
        id: Option<&serde_json::Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()>;
    fn finish(self: Box<Self>) -> Result<()>;
}

/// A layer that is being written. The file appears when it is finished.
pub struct VectorWriter {
    writer: Box<dyn FormatWriter>,
    path: PathBuf,
    kind: Option<GeometryKind>,
    is_multi: bool,
    attributes: Vec<(String, AttributeType)>,
    /// Remarks on what the file cannot tell of the layer, and of its features.
    remarks: Vec<String>,
    losses: Losses,
}

impl VectorWriter {
    /// Starts a file of a layer. Attributes whose names the format cannot have get others.
    ///
    /// # Errors
    /// If the output cannot be written, or is a stream and the format is a database; or if the format has no features of several kinds, or no
    /// points.
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

    /// Writes a feature of the layer's kind with its attributes, which are as many as the layer has, and of their types or none.
    ///
    /// # Errors
    /// If it has other attributes, the layer has features of several kinds, the feature's points cannot be read, or the output cannot be
    /// written.
    pub fn write(&mut self, geometry: &dyn Geometry, attributes: &[AttributeValue<'_>]) -> Result<()> {
        match self.kind {
            Some(kind) => {
                self.write_feature(&VectorFeature { id: None, geometry: Some((kind, geometry)), attributes })
            }
            None => Err(Error::invalid("kind of a feature", "none", "one, since the layer has several")),
        }
    }

    /// Writes a feature of any kind that the layer may have, with its id, or without a geometry; otherwise as [`VectorWriter::write`].
    ///
    /// # Errors
    /// Those of [`VectorWriter::write`]; if the layer is of another kind, or has no features of several points, lines or polygons; if the format
    /// cannot have the id, or has it already.
    pub fn write_feature(&mut self, feature: &VectorFeature<'_>) -> Result<()> {
        let attributes = feature.attributes;
        let fits = |((_, kind), value): (&(String, AttributeType), &AttributeValue<'_>)| value.fits(*kind);
        if attributes.len() != self.attributes.len() || !self.attributes.iter().zip(attributes).all(fits) {
            let found = format!("{attributes:?}");
            return Err(Error::invalid("attributes of a feature", found, "those of the layer, in order"));
        }
        let shape = feature.geometry.map(|(kind, geometry)| Shape::of(geometry, kind));
        if let Some(shape) = &shape {
            if self.kind.is_some() && shape.kind != self.kind {
                let found = shape.kind.map_or_else(|| "several".into(), |kind| format!("{kind:?}"));
                return Err(Error::invalid("kind of a feature", found, format!("{:?}", self.kind)));
            }
            if self.kind.is_some() && !self.is_multi && shape.members.len() > 1 {
                let found = format!("{} geometries", shape.members.len());
                return Err(Error::invalid("geometry of a feature", found, "one, since the layer says so"));
            }
        }
        self.writer.write(feature.id, shape.as_ref(), attributes)?;
        self.losses.count(feature, shape.as_ref(), &self.attributes);
        Ok(())
    }

    /// Ends the file and puts it in its place; warns of all that it cannot tell of what was written to it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self, progress: &dyn Progress) -> Result<()> {
        let VectorWriter { writer, path, remarks, losses, .. } = self;
        writer.finish()?;
        remarks.iter().chain(&losses.told()).for_each(|text| progress.warn(&path, text));
        Ok(())
    }
}
