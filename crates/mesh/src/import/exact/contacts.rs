//! Objects of mesh files that overlap or touch, on the grid of an exact model.

use super::super::Model;
use super::objects::Objects;
use super::snap::Snapper;
use super::{ExactOptions, check_memory, grid_of, read};
use spinney_base::{Error, Progress, Result, SilentProgress};
use spinney_brep::{Face, FaceList, ObjectContact, object_contacts};

/// Two objects of mesh files that overlap or touch.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ModelContact {
    /// Names of the objects, in the order of the files.
    pub names: [String; 2],
    /// Numbers of the objects, and how they overlap or touch.
    pub contact: ObjectContact,
}

/// Passes the pairs of objects that overlap or touch, on the grid of an exact model, to `each`, in
/// the order of their numbers. Stops when `each` returns false. Open objects are left out with a
/// warning. The options define the grid, the chosen parts, the up axis and the memory. Faces take
/// up to half of the memory.
///
/// # Errors
/// If the models cannot be read; if the memory is insufficient; on cancellation; or any error that
/// `each` returns.
pub fn model_contacts(
    mut models: Vec<Box<dyn Model>>,
    options: &ExactOptions,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&ModelContact) -> Result<bool>,
) -> Result<()> {
    let Some(first) = models.first() else {
        return Err(Error::invalid("models", "none", "one or more"));
    };
    let path = first.info().path.clone();
    let grid = grid_of(&mut models, options)?;
    let objects = Objects::of(&models, options.parts.as_ref())?;
    let mut faces = FaceList::new(grid.clone(), objects.names());
    let mut snapper = Snapper::new(grid, options.up);
    read(&mut models, &objects, &mut snapper, &SilentProgress(progress), &mut |face, _| {
        faces.push(&Face { part: objects.object(face.part), ..*face });
        check_memory(&path, faces.bytes(), options.memory / 2, "the list of faces of the tested objects")
    })?;
    let names = objects.names();
    object_contacts(faces, &path, options.memory, progress, &mut |contact| {
        let names = contact.parts.map(|object| names[object as usize].clone());
        each(&ModelContact { names, contact: *contact })
    })?;
    Ok(())
}
