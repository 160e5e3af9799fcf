//! Geometry templates of CityJSON: surfaces that are instantiated several times, each with its own
//! transformation.

use serde::Deserialize;
use serde_json::value::RawValue;

use super::city_geometry::{Geometry, SurfaceJson};
use super::cityjson::{not_json_there, read_list};
use super::model_file::ModelFile;
use super::vertices::{Coordinates, Table, VertexBounds, VertexLayout, Vertices, VerticesBuilder};
use spinney_base::Result;
use spinney_records::text::shown;

/// Maximum number of templates.
const MAX_TEMPLATES: usize = 1 << 20;

/// Templates of a file.
#[derive(Default)]
pub(super) struct Templates<'a> {
    vertices: Option<Vertices>,
    list: Vec<Template<'a>>,
}

/// Template: its level of detail, and its surfaces if it has any.
struct Template<'a> {
    lod: f64,
    surfaces: Option<SurfaceJson<'a>>,
}

#[derive(Deserialize)]
struct Document<'a> {
    #[serde(borrow)]
    templates: Vec<Geometry<'a>>,
    #[serde(borrow, rename = "vertices-templates")]
    vertices: Option<&'a RawValue>,
}

/// Geometry that is an instance of a template.
pub(super) struct Instance<'a> {
    template: Option<usize>,
    matrix: [f64; 16],
    /// JSON list with the index of one vertex: the position of the template's origin.
    anchor: Option<&'a RawValue>,
}

impl<'a> Instance<'a> {
    pub(super) fn of<E: serde::de::Error>(geometry: &Geometry<'a>) -> Result<Instance<'a>, E> {
        let Geometry { template, matrix, boundaries, .. } = geometry;
        let matrix = matrix.ok_or_else(|| E::custom("a template instance without a transformationMatrix"))?;
        Ok(Instance { template: *template, matrix, anchor: *boundaries })
    }

    /// Level of detail of its template, if that has surfaces. `levels` are those of all templates.
    pub(super) fn level(&self, levels: &[Option<f64>]) -> Option<f64> {
        levels.get(self.template?).copied().flatten()
    }
}

/// Transformation of an instance's points.
#[derive(Clone, Copy)]
pub(super) struct TemplateTransform {
    matrix: [f64; 16],
    anchor: [f64; 3],
}

impl TemplateTransform {
    /// Transforms a point of the template. Matrices are for homogeneous coordinates, so the last
    /// row is 0, 0, 0, 1.
    pub(super) fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|row| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|column| self.matrix[4 * row + column]);
            a * point[0] + b * point[1] + c * point[2] + d + self.anchor[row]
        })
    }
}

/// Template with the placement of an instance.
pub(super) struct TemplateInstance<'a> {
    pub(super) lod: f64,
    pub(super) surfaces: SurfaceJson<'a>,
    pub(super) template_transform: TemplateTransform,
}

/// Levels of detail of a file's templates; `None` for templates without surfaces.
pub(super) fn template_levels(source: &ModelFile, text: &RawValue) -> Result<Vec<Option<f64>>> {
    let found: Document<'_> =
        serde_json::from_str(text.get()).map_err(|error| not_json_there(source, text, &error))?;
    let level = |geometry: &Geometry<'_>| {
        let level = geometry.level().map_err(|error| not_json_there(source, text, &error))?;
        Ok(geometry.surfaces().map(|_| level))
    };
    found.templates.iter().map(level).collect()
}

impl<'a> Templates<'a> {
    /// Parses the templates of a file from JSON. Vertices use up to half of `memory` bytes and
    /// spill to disk beyond.
    pub(super) fn of(source: &ModelFile, text: &'a RawValue, memory: u64) -> Result<Templates<'a>> {
        let found: Document<'a> =
            serde_json::from_str(text.get()).map_err(|error| not_json_there(source, text, &error))?;
        if found.templates.len() > MAX_TEMPLATES {
            let count = found.templates.len();
            return Err(source.corrupt("geometry-templates", format!("{count} templates"), "at most 2^20"));
        }
        let mut vertices = VerticesBuilder::new(source.path(), Coordinates::F64, false, memory / 2);
        if let Some(text) = found.vertices {
            read_list(source, text, None, &mut VertexBounds::new(), &mut vertices)?;
        }
        let mut list = Vec::with_capacity(found.templates.len());
        for geometry in &found.templates {
            let lod = geometry.level().map_err(|error| not_json_there(source, text, &error))?;
            list.push(Template { lod, surfaces: geometry.surfaces() });
        }
        Ok(Templates { vertices: Some(vertices.finish()?), list })
    }

    /// Vertices of all templates.
    pub(super) fn vertices(&self) -> Table<'_> {
        let none = || Table::new(&[], VertexLayout::packed(Coordinates::F64, false));
        self.vertices.as_ref().map_or_else(none, Vertices::table)
    }

    /// Templates of an object's instances with their placements. Templates without surfaces are
    /// left out. `vertices` are those of the document.
    pub(super) fn placed(
        &self,
        source: &ModelFile,
        name: &str,
        vertices: Table<'_>,
        instances: &[Instance<'a>],
    ) -> Result<Vec<TemplateInstance<'a>>> {
        let place = || format!("object {}", shown(name.as_bytes()));
        let mut placed = Vec::new();
        for Instance { template, matrix, anchor } in instances {
            let found = template.and_then(|number| self.list.get(number));
            let Some(Template { lod, surfaces }) = found else {
                let found = template.map_or("no template".into(), |number| format!("template {number}"));
                let expected = format!("one of the {} templates of the file", self.list.len());
                return Err(source.corrupt(place(), format!("an instance of {found}"), expected));
            };
            let numbers: Vec<u64> =
                anchor.and_then(|text| serde_json::from_str(text.get()).ok()).unwrap_or_default();
            let [anchor] = numbers[..] else {
                let found = format!("an instance at {} vertices", numbers.len());
                return Err(source.corrupt(place(), found, "one"));
            };
            if anchor >= vertices.len() {
                let found = format!("an instance at vertex {anchor} of {}", vertices.len());
                return Err(source.corrupt(place(), found, "the index of a vertex in the list of vertices"));
            }
            let template_transform = TemplateTransform { matrix: *matrix, anchor: vertices.position(anchor) };
            placed.extend(surfaces.map(|surfaces| TemplateInstance {
                lod: *lod,
                surfaces,
                template_transform,
            }));
        }
        Ok(placed)
    }
}
