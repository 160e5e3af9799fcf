//! Exact models: measures, sections, triangles.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::{Error, Result};
use spinney_brep::query::{CuttingPlane, Location};
use spinney_brep::{Faces, ModelView, Triangulated};
use spinney_container::Tag;

use crate::result::{Found, bytes_of, count};

/// A plane across an axis, or one with a normal: the points whose product with it is `at`.
#[derive(Deserialize)]
pub(crate) struct Plane {
    axis: Option<crate::solid::Axis>,
    normal: Option<[f64; 3]>,
    at: f64,
}

/// Returns volume, surface area, centre and moments.
pub(crate) fn measures(view: &ModelView) -> Result<Found> {
    let (mass, model) = (view.mass(&())?, view.file());
    Ok(json!({
        "unit": model.metadata().tag(Tag::Unit),
        "volume": mass.volume,
        "surface": mass.area,
        "faces": count(mass.faces),
        "centre": mass.centre,
        "second_moments": mass.second_moments,
        "inertia": mass.inertia,
        "bounds": mass.bounds,
    })
    .into())
}

/// Classifies points.
pub(crate) fn contains(view: &ModelView, numbers: &[f64]) -> Result<Found> {
    let points: Vec<[f64; 3]> = numbers.chunks_exact(3).map(|point| [point[0], point[1], point[2]]).collect();
    let mut locations = Vec::new();
    view.locate_all(&points, &mut locations)?;
    let name = |location: &Location| match location {
        Location::Inside => "inside",
        Location::Outside => "outside",
        Location::Boundary => "boundary",
    };
    Ok(Value::from(locations.iter().map(name).collect::<Vec<_>>()).into())
}

/// Returns the section by a plane, as features whose geometries are polygons in space.
pub(crate) fn section(view: &ModelView, plane: &Plane) -> Result<Found> {
    let plane = match (plane.axis, plane.normal) {
        (Some(axis), None) => CuttingPlane::across(axis as usize, plane.at),
        (None, Some(normal)) => CuttingPlane { normal, distance: plane.at },
        _ => return Err(Error::invalid("plane", "neither or both of `axis` and `normal`", "one of the two")),
    };
    let polygons = view.section(&plane, &())?;
    let area: f64 = polygons.iter().map(|polygon| polygon.area).sum();
    let feature = |polygon: &spinney_brep::query::SectionPolygon| {
        json!({
            "type": "Feature",
            "properties": { "area": polygon.area },
            "geometry": { "type": "Polygon", "coordinates": polygon.rings },
        })
    };
    let features: Vec<Value> = polygons.iter().map(feature).collect();
    Ok(json!({ "type": "FeatureCollection", "area": area, "axes": plane.axes(), "features": features })
        .into())
}

/// Returns the faces as triangles, object by object: each triangle has its own vertices, relative
/// to an origin.
pub(crate) fn triangles(view: &ModelView) -> Result<Found> {
    let model = view.as_model("triangles")?;
    let [low, _] = view.bounds()?;
    let (mut positions, mut objects): (Vec<f32>, Vec<u32>) = (Vec::new(), Vec::new());
    let grid = model.grid();
    Triangulated::of(model)?.each(&mut |face| {
        for corner in face.points {
            let at = grid.to_world(*corner);
            positions.extend((0..3).map(|axis| (at[axis] - low[axis]) as f32));
        }
        objects.push(face.part);
        Ok(())
    })?;
    let json = json!({ "origin": low, "triangles": objects.len(), "names": model.parts() });
    Ok(Found {
        json,
        buffers: vec![bytes_of(&positions, f32::to_le_bytes), bytes_of(&objects, u32::to_le_bytes)],
    })
}
