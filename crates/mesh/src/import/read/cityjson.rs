//! CityJSON and CityJSONSeq: city objects whose surfaces are polygons with holes.
//!
//! A file is a sequence of JSON values (a single one for CityJSON). These are parsed as streams,
//! without building a document in memory: vertices go to their store, and surfaces are passed on
//! immediately.

use std::fmt;

use serde::de::{DeserializeSeed, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;

use super::city_geometry::Geometries;
use super::city_semantics::{LOD, Semantics};
use super::city_templates::{TemplateTransform, Templates, template_levels};
use super::corners::{Corners, MAX_CORNERS};
use super::model_file::ModelFile;
use super::parts::PartNames;
use super::vertices::{Coordinates, Table, VertexBounds, Vertices, VerticesBuilder};
use super::{MeshFace, Model, ModelInfo};
use spinney_base::{Error, Result};
use spinney_brep::Attributes;
use spinney_brep::attributes::{ObjectText, each_member, map_locations};
use spinney_container::OtherFormat;
use spinney_crs::Crs;
use spinney_records::text::{line_number, shown};

struct CityJson {
    source: ModelFile,
    info: ModelInfo,
    memory: u64,
    degenerate: u64,
    lost_values: u64,
}

/// CityJSON file, or a line of a CityJSONSeq.
#[derive(Deserialize)]
struct Document<'a> {
    #[serde(rename = "type")]
    kind: Option<String>,
    version: Option<String>,
    transform: Option<Transform>,
    #[serde(borrow)]
    metadata: Option<&'a RawValue>,
    #[serde(borrow)]
    extensions: Option<&'a RawValue>,
    #[serde(borrow, rename = "CityObjects")]
    objects: Option<&'a RawValue>,
    #[serde(borrow)]
    vertices: Option<&'a RawValue>,
    #[serde(borrow, rename = "geometry-templates")]
    templates: Option<&'a RawValue>,
}

#[derive(Clone, Copy, Deserialize)]
pub(super) struct Transform {
    scale: [f64; 3],
    translate: [f64; 3],
}

/// Visits all JSON values of a file, each with the transform that applies to it.
fn documents<'a>(
    source: &'a ModelFile,
    mut each: impl FnMut(&Document<'a>, Option<Transform>) -> Result<()>,
) -> Result<()> {
    let mut transform = None;
    let documents = serde_json::Deserializer::from_slice(source.bytes()).into_iter();
    for (number, document) in documents.enumerate() {
        let document: Document<'a> = document.map_err(|error| not_json(source, 1, &error))?;
        let (kind, version) = (document.kind.as_deref(), document.version.as_deref());
        let expected = if number == 0 { "CityJSON" } else { "CityJSONFeature" };
        if number == 0 && matches!(kind, Some("FeatureCollection" | "Feature")) {
            return Err(OtherFormat::refuse_source(source.path(), b"\"FeatureCollection\"", "a city model"));
        }
        if kind != Some(expected) {
            let found = format!("`type` {}", kind.map_or("missing".into(), |kind| shown(kind.as_bytes())));
            return Err(source.corrupt(
                format!("JSON value {}", number + 1),
                found,
                format!("\"{expected}\""),
            ));
        }
        if number == 0 {
            let version = version.unwrap_or("1.0");
            if !["1", "2"].contains(&version.split('.').next().unwrap_or_default()) {
                let found = format!("CityJSON version {}", shown(version.as_bytes()));
                return Err(Error::unsupported(source.path(), found, "convert it to CityJSON 2.0"));
            }
            transform = document.transform;
        }
        each(&document, transform)?;
    }
    Ok(())
}

/// JSON error in a text that starts in the given line of the file.
fn not_json(source: &ModelFile, first_line: u64, error: &serde_json::Error) -> Error {
    let text = error.to_string();
    let what = text.rsplit_once(" at line").map_or(text.as_str(), |(what, _)| what);
    let place = format!("line {}, column {}", first_line + (error.line() as u64).max(1) - 1, error.column());
    let most = what.char_indices().nth(200).map_or(what.len(), |(at, _)| at);
    source.corrupt(place, &what[..most], "CityJSON")
}

/// JSON error in a fragment of a file.
pub(super) fn not_json_there(source: &ModelFile, text: &RawValue, error: &serde_json::Error) -> Error {
    let offset = text.get().as_ptr() as usize - source.bytes().as_ptr() as usize;
    not_json(source, line_number(source.bytes(), offset), error)
}

/// Deserializes a fragment of a file. `seed` stores errors that are not JSON errors in `failure`.
fn walk<'a>(
    source: &ModelFile,
    text: &'a RawValue,
    failure: &mut Option<Error>,
    seed: impl FnOnce(&mut Option<Error>, &mut Json<'a>) -> Result<(), serde_json::Error>,
) -> Result<()> {
    let outcome = seed(failure, &mut serde_json::Deserializer::from_str(text.get()));
    match (failure.take(), outcome) {
        (Some(error), _) => Err(error),
        (None, Err(error)) => Err(not_json_there(source, text, &error)),
        (None, Ok(())) => Ok(()),
    }
}

type Json<'a> = serde_json::Deserializer<serde_json::de::StrRead<'a>>;

/// Stores an error of this crate in `failure` and returns a placeholder through serde.
fn keep<T, E: serde::de::Error>(failure: &mut Option<Error>, result: Result<T>) -> Result<T, E> {
    result.map_err(|error| {
        *failure = Some(error);
        E::custom("stopped")
    })
}

/// Visitor of the list of vertices.
struct ReadVertices<'a> {
    source: &'a ModelFile,
    transform: Option<Transform>,
    bounds: &'a mut VertexBounds,
    vertices: &'a mut VerticesBuilder,
    failure: &'a mut Option<Error>,
}

impl<'de> Visitor<'de> for ReadVertices<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of vertices")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        let mut number = 0;
        while let Some(mut point) = list.next_element::<[f64; 3]>()? {
            if let Some(Transform { scale, translate }) = self.transform {
                point = [0, 1, 2].map(|axis| point[axis] * scale[axis] + translate[axis]);
            }
            if !point.iter().all(|coordinate| coordinate.is_finite()) {
                let place = format!("vertex {number}");
                let error = self.source.corrupt(place, format!("{point:?}"), "finite coordinates");
                keep(self.failure, Err(error))?;
            }
            self.bounds.add(point);
            keep(self.failure, self.vertices.push(point, [0; 3]))?;
            number += 1;
        }
        Ok(())
    }
}

fn read_vertices(
    source: &ModelFile,
    document: &Document<'_>,
    transform: Option<Transform>,
    bounds: &mut VertexBounds,
    memory: u64,
) -> Result<Vertices> {
    let mut vertices = VerticesBuilder::new(source.path(), Coordinates::F64, false, memory);
    if let Some(text) = document.vertices {
        read_list(source, text, transform, bounds, &mut vertices)?;
    }
    vertices.finish()
}

/// Reads a list of vertices.
pub(super) fn read_list(
    source: &ModelFile,
    text: &RawValue,
    transform: Option<Transform>,
    bounds: &mut VertexBounds,
    vertices: &mut VerticesBuilder,
) -> Result<()> {
    walk(source, text, &mut None, |failure, json| {
        json.deserialize_seq(ReadVertices { source, transform, bounds, vertices, failure })
    })
}

/// Metadata of a file: the coordinate system is returned, other metadata and extensions become
/// attributes.
fn read_metadata(
    source: &ModelFile,
    document: &Document<'_>,
    attributes: &mut Attributes,
) -> Result<Option<Crs>> {
    let (mut of_file, mut metadata) = (ObjectText::default(), ObjectText::default());
    let mut reference = None;
    if let Some(text) = document.metadata.filter(|text| text.get() != "null") {
        each_member(text.get(), |key, value| match key {
            "referenceSystem" => reference = Some(serde_json::from_str::<Option<String>>(value)),
            // (The extent of the model differs if vertices have moved or files are merged.)
            "geographicalExtent" => {}
            _ => metadata.push(key, value),
        })
        .map_err(|error| not_json_there(source, text, &error))?;
    }
    let reference = reference.transpose().map_err(|error| not_json(source, 1, &error))?.flatten();
    if !metadata.is_empty() {
        of_file.push("metadata", &metadata.to_string());
    }
    if let Some(text) = document.extensions {
        of_file.push("extensions", text.get());
    }
    if !of_file.is_empty() {
        attributes.push_file(source.path(), of_file.to_string())?;
    }
    Ok(reference.and_then(|reference| Crs::parse(&reference).ok()))
}

/// Visitor of the names and attributes of all city objects.
struct ReadNames<'a> {
    source: &'a ModelFile,
    vertices: Table<'a>,
    /// Levels of detail of the file's templates.
    levels: &'a [Option<f64>],
    parts: &'a mut PartNames,
    attributes: &'a mut Attributes,
    /// Part number of the next object.
    part: &'a mut u32,
    failure: &'a mut Option<Error>,
}

impl<'de> Visitor<'de> for ReadNames<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("city objects by name")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some((name, object)) = map.next_entry::<String, &'de RawValue>()? {
            keep(self.failure, self.parts.push(self.source, name))?;
            let mut text = ObjectText::default();
            // The default type of untyped objects carries no information.
            let (mut is_plain, mut has_address, mut lod) = (true, false, None);
            let members = each_member(object.get(), |key, value| match key {
                // (Errors in geometries are reported when the geometries are read.)
                "geometry" => {
                    if let Ok(Geometries { lod: own, instances, .. }) = serde_json::from_str(value) {
                        let of_templates =
                            instances.iter().filter_map(|instance| instance.level(self.levels));
                        lod = own.into_iter().chain(of_templates).reduce(f64::max);
                    }
                }
                LOD => {}
                _ => {
                    has_address |= key == "address";
                    is_plain &= key == "type" && value == "\"GenericCityObject\"";
                    text.push(key, value);
                }
            });
            let members = members.map_err(|error| not_json_there(self.source, object, &error));
            keep(self.failure, members)?;
            if let Some(lod) = lod.filter(|lod| lod.is_finite() && *lod != 2.0) {
                is_plain = false;
                text.push(LOD, &format!("\"{lod}\""));
            }
            if !is_plain {
                let mut text = text.to_string();
                if has_address {
                    text = keep(self.failure, address_points(self.source, self.vertices, object, &text))?;
                }
                let pushed = self.attributes.push_part(self.source.path(), *self.part, text);
                keep(self.failure, pushed)?;
            }
            *self.part += 1;
        }
        Ok(())
    }
}

/// Attributes of an object with coordinates instead of vertex indices as the points of its
/// addresses.
fn address_points(source: &ModelFile, vertices: Table<'_>, object: &RawValue, about: &str) -> Result<String> {
    let mut missing = None;
    let mapped = map_locations(about, &mut |numbers| {
        let Ok(numbers) = serde_json::from_str::<Vec<u64>>(numbers) else {
            missing = Some(shown(numbers.as_bytes()));
            return None;
        };
        let points = numbers.iter().map(|number| match *number < vertices.len() {
            true => serde_json::to_string(&vertices.position(*number)).ok(),
            false => {
                missing = Some(format!("vertex {number} of {}", vertices.len()));
                None
            }
        });
        Some(format!("[{}]", points.collect::<Option<Vec<_>>>()?.join(",")))
    });
    let mapped = mapped.map_err(|error| not_json_there(source, object, &error))?;
    match missing {
        None => Ok(mapped),
        Some(found) => {
            let offset = object.get().as_ptr() as usize - source.bytes().as_ptr() as usize;
            let position = format!("address of the object at line {}", line_number(source.bytes(), offset));
            Err(source.corrupt(position, found, "indices of vertices in the list of vertices"))
        }
    }
}

#[derive(Deserialize)]
struct CityObject<'a> {
    #[serde(borrow)]
    geometry: Option<Geometries<'a>>,
}

/// Visitor of the surfaces of all city objects.
struct ReadObjects<'a, 'b> {
    source: &'a ModelFile,
    vertices: Table<'a>,
    templates: &'b Templates<'a>,
    corners: &'b mut Corners,
    /// Part number of the next object.
    part: &'b mut u32,
    /// Number of dropped semantics of surfaces.
    lost: &'b mut u64,
    each: &'b mut dyn FnMut(&MeshFace<'_>) -> Result<()>,
    failure: &'b mut Option<Error>,
}

impl<'de> Visitor<'de> for ReadObjects<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("city objects by name")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some((name, object)) = map.next_entry::<String, CityObject<'de>>()? {
            let Geometries { lod, surfaces, instances } = object.geometry.unwrap_or_default();
            let placed = self.templates.placed(self.source, &name, self.vertices, &instances);
            let mut placed = keep(self.failure, placed)?;
            // (Only the highest level of detail is used, as for other geometries.)
            let best =
                placed.iter().map(|placed| placed.lod).fold(lod.unwrap_or(f64::NEG_INFINITY), f64::max);
            placed.retain(|placed| placed.lod == best);
            let own = surfaces.into_iter().filter(|_| lod == Some(best));
            let own = own.map(|surfaces| (surfaces, self.vertices, None));
            let of_templates = placed
                .into_iter()
                .map(|placed| (placed.surfaces, self.templates.vertices(), Some(placed.template_transform)));
            let mut first_surface = 0;
            for (surfaces, vertices, template_transform) in own.chain(of_templates) {
                let (source, part, level) = (self.source, *self.part, surfaces.depth);
                let (corners, each) = (&mut *self.corners, &mut *self.each);
                let mut semantics = Semantics::of(surfaces.semantics, first_surface);
                let walked = walk(source, surfaces.boundaries, &mut None, |failure, json| {
                    let (name, semantics) = (&name, &mut semantics);
                    Boundaries {
                        source,
                        name,
                        vertices,
                        template_transform,
                        semantics,
                        corners,
                        part,
                        each,
                        failure,
                        level,
                    }
                    .deserialize(json)
                });
                keep(self.failure, walked)?;
                first_surface += semantics.len();
                *self.lost += semantics.lost();
            }
            *self.part += 1;
        }
        Ok(())
    }
}

/// Visitor of nested lists of vertex indices: level 1 is a ring, 2 a surface, higher levels are
/// shells and solids.
struct Boundaries<'a, 'b> {
    source: &'a ModelFile,
    name: &'b str,
    vertices: Table<'a>,
    /// Transformation of template vertices.
    template_transform: Option<TemplateTransform>,
    semantics: &'b mut Semantics<'a>,
    corners: &'b mut Corners,
    part: u32,
    each: &'b mut dyn FnMut(&MeshFace<'_>) -> Result<()>,
    failure: &'b mut Option<Error>,
    level: u8,
}

impl<'de> DeserializeSeed<'de> for Boundaries<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Boundaries<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.level {
            1 => "a ring of vertices",
            2 => "a list of rings",
            _ => "a list of surfaces or shells",
        })
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        if self.level == 1 {
            while let Some(index) = list.next_element::<u64>()? {
                let place = || format!("object {}", shown(self.name.as_bytes()));
                if index >= self.vertices.len() || self.corners.len() >= MAX_CORNERS {
                    let found = format!("vertex {index} of {} in a face", self.vertices.len());
                    let expected = "at most 2^20 corners, each the index of a vertex in the list of vertices";
                    keep(self.failure, Err(self.source.corrupt(place(), found, expected)))?;
                }
                let point = self.vertices.position(index);
                let point = self
                    .template_transform
                    .map_or(point, |template_transform| template_transform.apply(point));
                if !point.iter().all(|coordinate| coordinate.is_finite()) {
                    let found = format!("vertex {index} of a template at {point:?}");
                    keep(self.failure, Err(self.source.corrupt(place(), found, "finite coordinates")))?;
                }
                self.corners.push(point);
            }
            self.corners.end_ring();
            return Ok(());
        }
        match self.level {
            2 => self.corners.clear(),
            _ => self.semantics.begin_list(),
        }
        loop {
            let inner = Boundaries {
                semantics: &mut *self.semantics,
                corners: &mut *self.corners,
                each: &mut *self.each,
                failure: &mut *self.failure,
                level: self.level - 1,
                ..self
            };
            if list.next_element_seed(inner)?.is_none() {
                break;
            }
        }
        if self.level > 2 {
            self.semantics.end_list();
            return Ok(());
        }
        let Boundaries { semantics, corners, part, each, failure, .. } = self;
        let values = semantics.next_face();
        keep(failure, corners.hand_out(part, &mut |face| each(&MeshFace { values: &values, ..*face })))
    }
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let mut bounds = VertexBounds::new();
    let mut parts = PartNames::new(memory);
    let mut attributes = Attributes::within(memory.max(1 << 20));
    let (mut count, mut part, mut version, mut crs) = (0, 0, None, None);
    // Grid unit, if all axes and all documents share one.
    let mut step: Option<Option<f64>> = None;
    let mut has_templates = false;
    let mut levels = Vec::new();
    documents(&source, |document, transform| {
        count += 1;
        has_templates |= document.templates.is_some();
        if let Some(text) = document.templates {
            levels = template_levels(&source, text)?;
        }
        let own = transform
            .map(|Transform { scale: [x, y, z], .. }| (x, x == y && y == z && x.is_normal() && x > 0.0));
        let own = own.and_then(|(width, is_one)| is_one.then_some(width));
        step = Some(own.filter(|_| step.is_none_or(|step| step == own)));
        let vertices = read_vertices(&source, document, transform, &mut bounds, memory)?;
        let vertices = vertices.table();
        if count == 1 {
            version.clone_from(&document.version);
            crs = read_metadata(&source, document, &mut attributes)?;
        }
        let Some(text) = document.objects else { return Ok(()) };
        walk(&source, text, &mut None, |failure, json| {
            let (source, parts, attributes) = (&source, &mut parts, &mut attributes);
            let (levels, part) = (&levels[..], &mut part);
            json.deserialize_map(ReadNames { source, vertices, levels, parts, attributes, part, failure })
        })
    })?;
    let vertex_bounds = bounds.get().ok_or_else(|| source.no_vertices())?;
    // Coordinates are in the unit of the coordinate system, or in metres if that is unknown.
    let unit = crs.as_ref().and_then(Crs::unit).unwrap_or("m");
    if unit == "degrees" {
        let name = crs.as_ref().map(Crs::to_string).unwrap_or_default();
        let found = format!("CityJSON with coordinates in degrees ({name})");
        let advice = "heights are not in degrees: reproject the file to a projected coordinate system first, for example with `cjio IN reproject 7415 save OUT`, or correct its referenceSystem";
        return Err(Error::unsupported(source.path(), found, advice));
    }
    let kind = if count > 1 { "CityJSONSeq" } else { "CityJSON" };
    let info = ModelInfo {
        path: source.path().to_path_buf(),
        format: format!("{kind} {}", version.unwrap_or_default()).trim_end().into(),
        faces: None,
        bounds: vertex_bounds,
        crs,
        unit: Some(unit.into()),
        step: step.flatten(),
        parts: parts.names(),
        is_grouped: false,
        is_z_up: false,
        attributes,
        is_coloured: false,
        bytes: source.bytes().len() as u64,
    };
    let mut model = CityJson { source, info, memory, degenerate: 0, lost_values: 0 };
    if has_templates {
        // (The vertices of templates are placed by their instances, outside of the bounds so far.)
        model.faces(&mut |face| {
            face.points.iter().for_each(|point| bounds.add(*point));
            Ok(())
        })?;
        model.info.bounds = bounds.get().unwrap_or(vertex_bounds);
    }
    Ok(Box::new(model))
}

impl Model for CityJson {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let (source, mut corners, mut part) = (&self.source, Corners::default(), 0);
        let mut lost = 0;
        // (Templates of the first document apply to all documents without own templates.)
        let mut templates = Templates::default();
        documents(source, |document, transform| {
            if let Some(text) = document.templates {
                templates = Templates::of(source, text, self.memory)?;
            }
            let vertices = read_vertices(source, document, transform, &mut VertexBounds::new(), self.memory)?;
            let Some(text) = document.objects else { return Ok(()) };
            walk(source, text, &mut None, |failure, json| {
                json.deserialize_map(ReadObjects {
                    source,
                    vertices: vertices.table(),
                    templates: &templates,
                    corners: &mut corners,
                    part: &mut part,
                    lost: &mut lost,
                    each: &mut *each,
                    failure,
                })
            })
        })?;
        self.lost_values = lost;
        self.degenerate = corners.degenerate;
        Ok(())
    }

    fn degenerate(&self) -> u64 {
        self.degenerate
    }

    fn lost_values(&self) -> u64 {
        self.lost_values
    }
}
