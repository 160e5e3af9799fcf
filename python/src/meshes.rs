//! Meshes in memory, as Python programs have them.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::raw::import::mesh::{MeshArrays, MeshColours, Model};

use crate::error::invalid;

/// Copies the arrays of meshes, which `_meshes.py` has checked and named.
pub(crate) fn arrays_of(meshes: &[Bound<'_, PyDict>]) -> PyResult<Vec<MeshArrays>> {
    meshes.iter().map(mesh_of).collect()
}

/// Converts meshes to importable models.
pub(crate) fn models_of(meshes: Vec<MeshArrays>) -> spinney::Result<Vec<Box<dyn Model>>> {
    meshes.into_iter().map(MeshArrays::model).collect()
}

fn mesh_of(given: &Bound<'_, PyDict>) -> PyResult<MeshArrays> {
    let item = |name: &str| {
        given.get_item(name)?.ok_or_else(|| invalid(format!("mesh: has no {name}, expected arrays by name")))
    };
    let mut mesh = MeshArrays::default();
    mesh.name = item("name")?.extract()?;
    let vertices: PyReadonlyArray2<'_, f64> = item("vertices")?.extract()?;
    mesh.vertices = vertices.as_slice()?.as_chunks().0.to_vec();
    let numbers = |name: &str| -> PyResult<Vec<u32>> {
        let numbers: PyReadonlyArray1<'_, u32> = item(name)?.extract()?;
        Ok(numbers.as_slice()?.to_vec())
    };
    let ends = |name: &str| -> PyResult<Vec<usize>> {
        let ends: PyReadonlyArray1<'_, u64> = item(name)?.extract()?;
        Ok(ends.as_slice()?.iter().map(|end| *end as usize).collect())
    };
    (mesh.corners, mesh.face_parts) = (numbers("corners")?, numbers("face_parts")?);
    (mesh.ring_ends, mesh.face_ends) = (ends("ring_ends")?, ends("face_ends")?);
    let colours: Option<(String, PyReadonlyArray2<'_, u8>)> = item("colours")?.extract()?;
    if let Some((of, rows)) = colours {
        let rows = rows.as_slice()?.as_chunks().0.to_vec();
        mesh.colours = match of.as_str() {
            "vertices" => MeshColours::OfVertices(rows),
            "faces" => MeshColours::OfFaces(rows),
            _ => MeshColours::OfCorners(rows),
        };
    }
    (mesh.parts, mesh.attributes) = (item("parts")?.extract()?, item("attributes")?.extract()?);
    Ok(mesh)
}
