//! Exact models for viewers: binary glTF of a surface, and 3D Tiles whose levels are the model's
//! levels of detail.

mod face_mesh;
mod features;
mod level_cells;
mod model_glb;
mod model_tiles;
mod position;

use std::io::Write as _;

use self::face_mesh::FaceMesh;
use self::features::FaceValues;
use self::model_glb::{ModelGlbOptions, model_glb};
use self::position::ModelPosition;
use super::GltfOptions;
use super::losses::Losses;
use super::units::length;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_brep::{Faces, Triangulated};

pub use model_tiles::{ModelTilesSummary, export_model_tileset};

/// Maximum bytes of a single file: it is built in memory.
const MAX_GLB: u64 = 1 << 30;
/// Approximate bytes of a triangle while a file is built.
const TRIANGLE: u64 = 160;
/// Maximum number of vertices of a node.
const NODE_VERTICES: usize = 65_000;

/// Writes a surface of an exact model as binary glTF, triangulated, in metres and with y up as in
/// glTF. Objects are features with their names and attributes; vertices have colours if the model
/// has any. Positions are relative to nodes, so that distant coordinates lose no precision. The
/// file is built in memory. Returns the number of triangles.
///
/// Other units of length are converted to metres; without a unit, coordinates are taken as metres.
/// Longitude and latitude become metres to the east and north of the model's centre.
///
/// # Errors
/// If the file would exceed 1 GiB; if longitude and latitude cannot be placed on the globe; if the
/// faces cannot be read; if the output cannot be written; or on cancellation.
pub fn export_model_glb(
    faces: &dyn Faces,
    options: &GltfOptions,
    mut output: Output,
    progress: &dyn Progress,
) -> Result<u64> {
    options.check()?;
    let triangles = Triangulated::of(faces)?;
    let needed = triangles.len() * TRIANGLE;
    if needed > MAX_GLB {
        return Err(Error::TooLarge {
            path: output.path().to_path_buf(),
            what: format!("a glTF model of {} triangles", triangles.len()),
            needed,
            limit: MAX_GLB,
            advice: "choose less detail (--error or --faces, with levels of detail), or write a tileset \
                     (x/tileset.json)"
                .into(),
        });
    }
    let position = ModelPosition::in_scene(faces, output.path())?;
    let place = |point: [i32; 3]| position.at(point);
    let mut meshes: Vec<FaceMesh> = Vec::new();
    let mut is_coloured = false;
    let columns = faces.value_columns()?;
    let mut values = FaceValues::of_columns(columns.clone());
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    triangles.each_with_values(&columns, &mut |face, own| {
        if face.number.is_multiple_of(1 << 12) {
            progress.check()?;
            progress.advance((1 << 12).min(triangles.len() - face.number), triangles.len());
        }
        is_coloured |= !face.colours.is_empty();
        if meshes.last().is_none_or(|mesh| mesh.vertices.len() >= NODE_VERTICES) {
            meshes.push(FaceMesh::at(place(face.points[0])?));
        }
        let row = if own.is_empty() { 0 } else { values.row(own) };
        meshes.last_mut().expect("one was added").push(face, row, &place)
    })?;
    let count = meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum();
    let about = position.about_scene(faces);
    let mut losses = Losses::of(&output);
    losses.add(!faces.file_attributes()?.is_empty(), "the metadata of source files");
    losses.add_crs(faces.crs().filter(|_| about.is_none()));
    losses.add_unit(faces.unit().filter(|unit| length(Some(unit)).is_none()), None);
    let options =
        ModelGlbOptions { is_coloured, meshopt: options.meshopt, about, values, ..Default::default() };
    let bytes = model_glb(faces, &meshes, options)?;
    output.write_all(&bytes).map_err(Error::io(output.path(), "write"))?;
    output.commit()?;
    losses.report(progress);
    Ok(count)
}
