//! Shells of exact models, parts with their attributes, and contacts between parts.

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::Progress;
use spinney::brep::Faces;
use spinney::import::mesh::ExactOptions;
use spinney::raw::brep::ObjectContact;
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::import::mesh;

use crate::jobs::{self, Terms, access};
use crate::model::Model;

/// Measures of an object: whether it is closed, its volume, its area, and its minimum and maximum
/// coordinates.
type Measures = (bool, Option<f64>, f64, Option<[[f64; 3]; 2]>);

/// Name, attributes, and measures.
type Object = (String, Option<String>, Option<Measures>);

/// Names and numbers of two objects, their kind of contact, their common volume and area, and a
/// point of the contact.
type Contact = ([String; 2], [u32; 2], &'static str, f64, f64, [f64; 3]);

fn contact_of(names: [String; 2], contact: &ObjectContact) -> Contact {
    let ObjectContact { parts, kind, volume, area, place, .. } = contact;
    (names, *parts, kind.name(), *volume, *area, *place)
}

/// Returns pairs of objects in mesh files that overlap or touch.
#[pyfunction]
#[pyo3(signature = (paths, snap, memory, terms))]
pub(crate) fn object_contacts(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    snap: Option<f64>,
    memory: u64,
    terms: Terms,
) -> PyResult<Vec<Contact>> {
    let mut options = ExactOptions::new();
    (options.snap, options.memory) = (snap, memory);
    jobs::run(py, terms, |work| {
        let mut all = Vec::new();
        mesh::model_contacts(
            spinney::raw::import::mesh::open_all_with(&paths, memory, access())?,
            &options,
            work,
            &mut |found| {
                all.push(contact_of(found.names.clone(), &found.contact));
                Ok(true)
            },
        )?;
        Ok(all)
    })
}

#[pymethods]
impl Model {
    /// Returns per shell the entity counts, handles (-1 if that is not an integer), and volume, and
    /// the shell of each face.
    #[pyo3(name = "_shells")]
    fn shells<'py>(&self, py: Python<'py>, memory: u64, terms: Terms) -> PyResult<Bound<'py, PyDict>> {
        let view = self.get()?;
        let model = view.file();
        let options = TopologyOptions { memory, path: model.path().to_path_buf() };
        let (counts, volumes, of_faces) = jobs::run(py, terms, |work| {
            let topology = Topology::of(model, &options, work)?;
            model.check_unchanged()?;
            let cube = model.grid().width().powi(3) * view.volume_factor() / 6.0;
            let volumes = (0..topology.shells()).map(|shell| topology.six_volumes(shell) as f64 * cube);
            let volumes: Vec<f64> = volumes.collect();
            let of_faces = (0..topology.faces()).map(|face| i64::from(topology.shell_of_face(face)));
            Ok((topology.counts_by_shell(), volumes, of_faces.collect::<Vec<_>>()))
        })?;
        let facts = PyDict::new(py);
        facts.set_item(
            "vertices",
            PyArray1::from_iter(py, counts.iter().map(|shell| shell.vertices as i64)),
        )?;
        facts.set_item("edges", PyArray1::from_iter(py, counts.iter().map(|shell| shell.edges as i64)))?;
        facts.set_item("faces", PyArray1::from_iter(py, counts.iter().map(|shell| shell.faces as i64)))?;
        facts.set_item(
            "inner_rings",
            PyArray1::from_iter(py, counts.iter().map(|shell| shell.rings as i64)),
        )?;
        facts.set_item(
            "boundaries",
            PyArray1::from_iter(py, counts.iter().map(|shell| shell.boundaries as i64)),
        )?;
        let genus = counts.iter().map(|shell| shell.genus().map_or(-1, |genus| genus as i64));
        facts.set_item("genus", PyArray1::from_iter(py, genus))?;
        facts.set_item("volume", PyArray1::from_vec(py, volumes))?;
        facts.set_item("of_faces", PyArray1::from_vec(py, of_faces))?;
        Ok(facts)
    }

    /// Returns for each part its name and attributes (a JSON object), and for parts with faces
    /// whether they are closed, their volume (`None` if open), area, and minimum and maximum
    /// coordinates.
    #[pyo3(name = "_objects")]
    fn objects(&self, py: Python<'_>, memory: u64, terms: Terms) -> PyResult<Vec<Object>> {
        let view = self.get()?;
        let model = view.file();
        jobs::run(py, terms, |work| {
            let measures = view.part_measures(memory, work)?;
            let mut measures = measures.into_iter().peekable();
            let parts = model.parts().iter().zip(0..).map(|(name, part)| {
                work.check()?;
                let own = measures.next_if(|own| own.part == part).map(|own| {
                    let volume = own.is_closed.then_some(own.measures.volume);
                    (own.is_closed, volume, own.measures.area, own.measures.bounds)
                });
                Ok((name.clone(), model.part_attributes(part)?, own))
            });
            parts.collect()
        })
    }

    /// Returns pairs of objects that touch.
    #[pyo3(name = "_contacts")]
    fn contacts(&self, py: Python<'_>, memory: u64, terms: Terms) -> PyResult<Vec<Contact>> {
        let view = self.get()?;
        jobs::run(py, terms, |work| {
            let (mut all, model) = (Vec::new(), view.file());
            let name = |part: u32| model.parts().get(part as usize).cloned().unwrap_or_default();
            view.object_contacts(memory, work, &mut |contact| {
                all.push(contact_of(contact.parts.map(name), contact));
                Ok(true)
            })?;
            model.check_unchanged()?;
            Ok(all)
        })
    }
}
