//! Lines, polygons and points with attributes, as files of other programs: one layer of features each.
//!
//! Features are written as they come, points as they are handed out, so that none has to be held. For GeoPackage a feature is
//! held, up to a mebibyte of it; for Shapefile a part of a feature.
//!
//! ```
//! use spinney::export::vector::{AttributeType, AttributeValue, GeometryKind, VectorFormat, VectorLayer, VectorWriter};
//! use spinney::io::Output;
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("paths.geojson");
//! let layer = VectorLayer {
//!     name: "paths".into(),
//!     kind: Some(GeometryKind::Line),
//!     has_z: false,
//!     attributes: vec![("length".into(), AttributeType::Number)],
//!     crs: None,
//!     bounds: [[0.0, 0.0], [3.0, 4.0]],
//! };
//! let mut writer = VectorWriter::create(Output::create(&path)?, VectorFormat::GeoJson, layer)?;
//! let path_of_points = [vec![[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]];
//! writer.write(&path_of_points, &[AttributeValue::Number(5.0)])?;
//! writer.finish()?;
//! # let text = std::fs::read_to_string(path).unwrap();
//! # assert!(text.contains(r#""properties":{"length":5},"geometry":{"type":"LineString","coordinates":[[0,0],[3,4]]}"#), "{text}");
//! # Ok::<(), spinney::Error>(())
//! ```

mod contours;
mod csv;
#[cfg(feature = "flatgeobuf")]
mod flatgeobuf;
mod geojson;
#[cfg(feature = "geopackage")]
mod geopackage;
mod intersection;
mod obj;
mod ply;
mod polygons;
mod sections;
mod shapefile;
mod smooth;
mod svg;
mod text;

use std::path::Path;
use std::str::FromStr;

pub use self::contours::{ContourFeatures, export_contours};
pub use self::intersection::{IntersectionSummary, export_intersection};
pub use self::polygons::export_polygons;
pub use self::sections::{SectionPlanes, SectionSummary, export_section};
pub use self::smooth::Smoothed;

use spinney_base::io::Output;
use spinney_base::{Error, Result};
use spinney_crs::Crs;
use spinney_engine::query::Contour;

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
    /// `FlatGeobuf` with an index (feature `flatgeobuf`): at most 2^21 features of at most 2^22 points.
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

/// Kind of a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeometryKind {
    /// A point: the only part has it.
    Point,
    /// A line: the only part has its points.
    Line,
    /// A polygon: the first part is the outer ring, all others are holes. Rings end with the point that they begin with.
    Polygon,
}

/// Type of an attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AttributeType {
    /// Numbers.
    Number,
    /// Texts.
    Text,
    /// Whole numbers, one for each segment of a line: texts with blanks between them where a format has no lists, integers of edges in PLY.
    PerSegment,
}

/// An attribute of a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AttributeValue<'a> {
    /// A number; one that is not finite is none.
    Number(f64),
    /// A text.
    Text(&'a str),
    /// A number for each segment of a line.
    PerSegment(&'a [u64]),
    /// Nothing.
    None,
}

/// Description of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorLayer {
    /// Its name.
    pub name: String,
    /// Kind of all features; `None` if they are of several kinds.
    pub kind: Option<GeometryKind>,
    /// Whether points have a third coordinate.
    pub has_z: bool,
    /// Names and types of the attributes.
    pub attributes: Vec<(String, AttributeType)>,
    /// The coordinate system, where known.
    pub crs: Option<Crs>,
    /// Least and greatest x and y of all features, or of what is around them.
    pub bounds: [[f64; 2]; 2],
}

impl VectorLayer {
    /// What a file of the format cannot tell of the layer's coordinate system, for whoever reads it: nothing if it tells all.
    pub fn remark(&self, format: VectorFormat) -> Option<String> {
        let crs = self.crs.as_ref()?;
        let is_told = match format {
            VectorFormat::GeoJson => crs.numbers().is_some(),
            VectorFormat::GeoPackage | VectorFormat::FlatGeobuf => {
                crs.numbers().is_some() || crs.to_wkt2().is_ok() || crs.foreign_text().is_some()
            }
            VectorFormat::Shapefile => shapefile::definition(crs).is_some(),
            // (These have no place for one.)
            VectorFormat::Csv | VectorFormat::Svg | VectorFormat::Obj | VectorFormat::Ply => true,
        };
        (!is_told)
            .then(|| format!("the coordinate system is not in the file, which has no words for it: {crs}"))
    }
}

/// The geometry of a feature.
pub trait Geometry {
    /// Number of parts.
    fn parts(&self) -> usize;

    /// Number of points of a part.
    fn count(&self, part: usize) -> u64;

    /// Hands out the points of a part, in order, many at a time.
    ///
    /// # Errors
    /// If they cannot be read, or `each` fails.
    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()>;
}

impl Geometry for [Vec<[f64; 3]>] {
    fn parts(&self) -> usize {
        self.len()
    }

    fn count(&self, part: usize) -> u64 {
        self.get(part).map_or(0, |points| points.len() as u64)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        self.get(part).map_or(Ok(()), |points| each(points))
    }
}

impl<const PARTS: usize> Geometry for [Vec<[f64; 3]>; PARTS] {
    fn parts(&self) -> usize {
        PARTS
    }

    fn count(&self, part: usize) -> u64 {
        self[..].count(part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        self[..].points(part, each)
    }
}

impl Geometry for Contour<'_> {
    fn parts(&self) -> usize {
        Contour::parts(self)
    }

    fn count(&self, part: usize) -> u64 {
        Contour::count(self, part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        Contour::points(self, part, each)
    }
}

impl Geometry for spinney_brep::query::SectionPolygon {
    fn parts(&self) -> usize {
        self.rings.len()
    }

    fn count(&self, part: usize) -> u64 {
        self.rings[..].count(part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        self.rings[..].points(part, each)
    }
}

impl Geometry for spinney_brep::surface_intersection::IntersectionLine {
    fn parts(&self) -> usize {
        1
    }

    fn count(&self, part: usize) -> u64 {
        std::slice::from_ref(&self.points).count(part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        std::slice::from_ref(&self.points).points(part, each)
    }
}

/// A file of a format in the making.
trait FormatWriter {
    fn write(
        &mut self,
        kind: GeometryKind,
        geometry: &dyn Geometry,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()>;
    fn finish(self: Box<Self>) -> Result<()>;
}

/// A layer that is being written. The file appears when it is finished.
pub struct VectorWriter {
    writer: Box<dyn FormatWriter>,
    kind: Option<GeometryKind>,
    attributes: Vec<(String, AttributeType)>,
}

impl VectorWriter {
    /// Starts a file of a layer.
    ///
    /// # Errors
    /// If the output cannot be written, or is a stream and the format is a database; or if the format has no features of several kinds, or no
    /// points.
    pub fn create(output: Output, format: VectorFormat, layer: VectorLayer) -> Result<VectorWriter> {
        let (kind, attributes) = (layer.kind, layer.attributes.clone());
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
                let advice = "build the library with the features raster, mbtiles and flatgeobuf, or choose another format";
                return Err(Error::unsupported(output.path(), format!("writing {format:?}"), advice));
            }
        };
        Ok(VectorWriter { writer, kind, attributes })
    }

    /// Writes a feature of the layer's kind with its attributes, which are as many as the layer has, and of their types or none.
    ///
    /// # Errors
    /// If it has other attributes, the layer has features of several kinds, the feature's points cannot be read, or the output cannot be
    /// written.
    pub fn write(&mut self, geometry: &dyn Geometry, attributes: &[AttributeValue<'_>]) -> Result<()> {
        match self.kind {
            Some(kind) => self.write_as(kind, geometry, attributes),
            None => Err(Error::invalid("kind of a feature", "none", "one, since the layer has several")),
        }
    }

    /// Writes a feature of a kind, otherwise as [`VectorWriter::write`].
    ///
    /// # Errors
    /// Those of [`VectorWriter::write`]; if the layer is of another kind.
    pub fn write_as(
        &mut self,
        kind: GeometryKind,
        geometry: &dyn Geometry,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        if self.kind.is_some_and(|own| own != kind) {
            return Err(Error::invalid("kind of a feature", format!("{kind:?}"), format!("{:?}", self.kind)));
        }
        let fits = |((_, wanted), value): (&(String, AttributeType), &AttributeValue<'_>)| match value {
            AttributeValue::Number(_) => *wanted == AttributeType::Number,
            AttributeValue::Text(_) => *wanted == AttributeType::Text,
            AttributeValue::PerSegment(_) => *wanted == AttributeType::PerSegment,
            AttributeValue::None => true,
        };
        if attributes.len() != self.attributes.len() || !self.attributes.iter().zip(attributes).all(fits) {
            let found = format!("{attributes:?}");
            return Err(Error::invalid("attributes of a feature", found, "those of the layer, in order"));
        }
        self.writer.write(kind, geometry, attributes)
    }

    /// Ends the file and puts it in its place.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> Result<()> {
        self.writer.finish()
    }
}
