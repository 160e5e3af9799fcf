//! Selection of city object geometries.

use std::fmt;

use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;

use super::city_templates::Instance;

#[derive(Deserialize)]
pub(super) struct Geometry<'a> {
    #[serde(rename = "type")]
    kind: String,
    lod: Option<Lod>,
    #[serde(borrow)]
    pub(super) boundaries: Option<&'a RawValue>,
    #[serde(borrow)]
    pub(super) semantics: Option<&'a RawValue>,
    /// Template instances only: the template's index, and the transformation matrix, row by row.
    pub(super) template: Option<usize>,
    #[serde(rename = "transformationMatrix")]
    pub(super) matrix: Option<[f64; 16]>,
}

/// Level of detail: a string since version 1.1, a number before.
#[derive(Deserialize)]
#[serde(untagged)]
enum Lod {
    Number(f64),
    Text(String),
}

/// Surfaces of a geometry, as JSON.
#[derive(Clone, Copy)]
pub(super) struct SurfaceJson<'a> {
    /// Nesting depth of the surfaces.
    pub(super) depth: u8,
    /// Nested lists of vertex indices.
    pub(super) boundaries: &'a RawValue,
    /// Semantics of the surfaces.
    pub(super) semantics: Option<&'a RawValue>,
}

/// Geometries of an object that have surfaces, at the highest level of detail.
#[derive(Default)]
pub(super) struct Geometries<'a> {
    pub(super) lod: Option<f64>,
    pub(super) surfaces: Vec<SurfaceJson<'a>>,
    /// Instances of templates, of any level of detail.
    pub(super) instances: Vec<Instance<'a>>,
}

/// Maximum number of geometries of an object with the same level of detail.
const MAX_GEOMETRIES: usize = 1 << 16;

impl<'a> Geometry<'a> {
    /// Surfaces, if the geometry has any.
    pub(super) fn surfaces(&self) -> Option<SurfaceJson<'a>> {
        let (depth, semantics) = (self.depth()?, self.semantics);
        Some(SurfaceJson { depth, boundaries: self.boundaries?, semantics })
    }

    /// Nesting depth of the surfaces, if the geometry is of a type with surfaces.
    fn depth(&self) -> Option<u8> {
        match self.kind.as_str() {
            "MultiSurface" | "CompositeSurface" => Some(3),
            "Solid" => Some(4),
            "MultiSolid" | "CompositeSolid" => Some(5),
            _ => None,
        }
    }

    /// Level of detail; negative infinity if there is none.
    pub(super) fn level<E: serde::de::Error>(&self) -> Result<f64, E> {
        match &self.lod {
            Some(Lod::Number(number)) => Ok(*number),
            Some(Lod::Text(text)) => {
                text.parse().map_err(|_| E::custom("a level of detail that is no number"))
            }
            None => Ok(f64::NEG_INFINITY),
        }
    }
}

impl<'a> Geometries<'a> {
    fn add<E: serde::de::Error>(&mut self, geometry: Geometry<'a>) -> Result<(), E> {
        if geometry.kind == "GeometryInstance" {
            if self.instances.len() == MAX_GEOMETRIES {
                return Err(E::custom("more than 65536 geometries of an object"));
            }
            self.instances.push(Instance::of(&geometry)?);
            return Ok(());
        }
        let Some(depth) = geometry.depth() else { return Ok(()) };
        let lod = geometry.level()?;
        if self.lod.is_none_or(|best| lod > best) {
            self.lod = Some(lod);
            self.surfaces.clear();
        }
        // If an object has both solids and surfaces at the same level, its surfaces duplicate the
        // solid's.
        let deepest = self.surfaces.first().map_or(0, |surfaces| surfaces.depth);
        if self.lod == Some(lod) && (depth > 3) >= (deepest > 3) {
            if depth > 3 && deepest == 3 {
                self.surfaces.clear();
            }
            if self.surfaces.len() == MAX_GEOMETRIES {
                return Err(E::custom("more than 65536 geometries of an object"));
            }
            self.surfaces.extend(geometry.surfaces());
        }
        Ok(())
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for Geometries<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Choose;

        impl<'de> Visitor<'de> for Choose {
            type Value = Geometries<'de>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list of geometries")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Geometries<'de>, A::Error> {
                let mut geometries = Geometries::default();
                while let Some(geometry) = list.next_element()? {
                    geometries.add(geometry)?;
                }
                Ok(geometries)
            }
        }

        deserializer.deserialize_seq(Choose)
    }
}
