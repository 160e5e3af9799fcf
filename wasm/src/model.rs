//! Exact models: measures, sections, triangles, levels of detail.

use std::collections::HashMap;

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::{Error, Result};
use spinney_brep::query::{CuttingPlane, Location, ModelSurface, SurfaceDetail, Viewpoint};
use spinney_brep::{DetailLevel, ExactModel, Faces, ModelView, each_triangle};
use spinney_container::Tag;

use crate::result::{Found, bytes_of, count};

/// A plane across an axis, or one with a normal: the points whose product with it is `at`.
#[derive(Deserialize)]
pub(crate) struct Plane {
    axis: Option<crate::solid::Axis>,
    normal: Option<[f64; 3]>,
    at: f64,
}

/// A surface: its detail, at most one of the first four, and the box near which it is needed.
#[derive(Deserialize)]
pub(crate) struct SurfaceRequest {
    error: Option<f64>,
    faces: Option<u64>,
    level: Option<u8>,
    clusters: Option<Vec<u64>>,
    bounds: Option<[f64; 6]>,
}

/// A surface for a viewpoint.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct CutRequest {
    eye: [f64; 3],
    tolerance: f64,
    #[serde(default)]
    half_spaces: Vec<[f64; 4]>,
    faces: Option<u64>,
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
    each_triangle(model, &mut |face| {
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

/// Returns the levels of detail of a model, coarsest first.
pub(crate) fn levels(model: &ExactModel) -> Value {
    let width = model.grid().width();
    let level = |level: &DetailLevel| {
        json!({
            "faces": count(level.faces),
            "error": level.error * width,
            "bytes": count(level.bytes),
            "vanishedBodies": count(level.vanished),
            "vanishedDiameter": level.vanished_diameter * width,
        })
    };
    model.levels().iter().map(level).collect()
}

/// Returns the clusters of the surface for a viewpoint.
pub(crate) fn cut(view: &ModelView, request: CutRequest) -> Result<Found> {
    let model = view.as_model("levels of detail")?;
    let CutRequest { eye, tolerance, half_spaces, faces } = request;
    let viewpoint = Viewpoint { eye, tolerance, half_spaces, faces: faces.unwrap_or(u64::MAX) };
    let surface = model.at_view(&viewpoint)?;
    let (clusters, error) = (surface.numbers(), surface.error());
    Ok(json!({ "clusters": clusters, "faces": count(surface.len()), "error": error }).into())
}

/// Returns a surface at a level of detail as triangles: vertices relative to an origin, three
/// vertex numbers each, and their objects and colours. Requested clusters share no vertices.
pub(crate) fn mesh(view: &ModelView, request: &SurfaceRequest) -> Result<Found> {
    let model = view.as_model("triangles")?;
    let SurfaceRequest { error, faces, level, ref clusters, bounds } = *request;
    let within = bounds.map(|[a, b, c, d, e, f]| [[a, b, c], [d, e, f]]);
    let at = |detail| model.surface(detail, within, &());
    let surface = match (error, faces, level, clusters) {
        (None, None, None, None) => at(SurfaceDetail::Exact)?,
        (Some(error), None, None, None) => at(SurfaceDetail::Error(error))?,
        (None, Some(faces), None, None) => at(SurfaceDetail::Faces(faces))?,
        (None, None, Some(level), None) => at(SurfaceDetail::Level(level))?,
        (None, None, None, Some(numbers)) if bounds.is_none() => model.of_clusters(numbers)?,
        _ => {
            let found = "several of `error`, `faces`, `level` and `clusters`, or `clusters` and `bounds`";
            return Err(Error::invalid("mesh", found, "one of them"));
        }
    };
    let by_cluster = clusters.as_ref().map(|_| surface.by_cluster()).transpose()?;
    let sources: Vec<&ModelSurface<'_>> = match &by_cluster {
        Some(by_cluster) => by_cluster.iter().collect(),
        None => vec![&surface],
    };
    let ([low, _], grid) = (view.bounds()?, model.grid());
    let mut known: HashMap<[i32; 3], u32> = HashMap::new();
    let (mut positions, mut indices): (Vec<f32>, Vec<u32>) = (Vec::new(), Vec::new());
    let (mut objects, mut colours): (Vec<u32>, Vec<u8>) = (Vec::new(), Vec::new());
    let mut ends = Vec::new();
    for faces in sources {
        known.clear();
        each_triangle(faces, &mut |face| {
            for corner in face.points {
                let next = (positions.len() / 3) as u32;
                indices.push(*known.entry(*corner).or_insert_with(|| {
                    let at = grid.to_world(*corner);
                    positions.extend((0..3).map(|axis| (at[axis] - low[axis]) as f32));
                    next
                }));
            }
            objects.push(face.part);
            colours.extend_from_slice(face.colours.as_flattened());
            Ok(())
        })?;
        ends.push(objects.len());
    }
    let clusters = by_cluster.as_ref().map(|by_cluster| {
        let end_of = |(cluster, end): (&ModelSurface<'_>, &usize)| json!({ "number": cluster.numbers()[0], "end": end });
        by_cluster.iter().zip(&ends).map(end_of).collect::<Vec<_>>()
    });
    let has_colours = !objects.is_empty() && colours.len() == 9 * objects.len();
    let json = json!({
        "origin": low,
        "triangles": objects.len(),
        "names": model.parts(),
        "error": surface.error(),
        "hasColours": has_colours,
        "clusters": clusters,
    });
    let colours = if has_colours { colours } else { Vec::new() };
    let buffers = vec![
        bytes_of(&positions, f32::to_le_bytes),
        bytes_of(&indices, u32::to_le_bytes),
        bytes_of(&objects, u32::to_le_bytes),
        colours,
    ];
    Ok(Found { json, buffers })
}
