//! Exact models: shells, and set operations.

use std::ffi::{CStr, c_char};
use std::slice;

use engine::brep::{Faces, combine};
use engine::raw::brep::topology::{Topology, TopologyOptions};
use engine::{Codec, ExactModel, Output, SetOperation};

use crate::dataset::path_of;
use crate::model::{check_size, opened, place, spinney_model};
use crate::questions::buffer;
use crate::status::{Failure, guarded, spinney_status};
use crate::warnings::Warnings;

/// Numbers of the entities of a shell: a surface that hangs together.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_shell {
    pub vertices: u64,
    pub edges: u64,
    pub faces: u64,
    /// Rings beside the first of each face: holes in faces.
    pub inner_rings: u64,
    /// 0 of a closed shell.
    pub boundaries: u64,
    /// Number of handles; -1 where that is no number.
    pub genus: i64,
    /// Volume that it encloses, rounded once; negative of a cavity, so that a body is a shell of more than 0.
    pub volume: f64,
}

/// Tells of each shell, in the order of their first faces; there is room for `capacity` of them, each of `shell_size` bytes,
/// `sizeof(spinney_shell)`. `count` gets how many there are. Takes at most `memory` bytes, about 60 for each corner of a face; reads all faces twice.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_shells(
    model: *const spinney_model,
    memory: u64,
    shells: *mut spinney_shell,
    capacity: usize,
    shell_size: usize,
    count: *mut usize,
) -> spinney_status {
    guarded(|| {
        check_size("shells", shell_size, size_of::<spinney_shell>())?;
        // SAFETY: as these say.
        let (model, count) = unsafe { (opened(model)?, place("count", count)?) };
        // SAFETY: the caller has so much room there, or NULL and none, which is found.
        let shells = unsafe { buffer("shells", shells, capacity, None)? };
        let options = TopologyOptions { memory, path: model.path().to_path_buf() };
        let topology = Topology::of(model, &options, &())?;
        let cube = model.grid().width().powi(3) / 6.0;
        for (number, (place, found)) in (0..).zip(shells.iter_mut().zip(topology.counts_by_shell())) {
            *place = spinney_shell {
                vertices: found.vertices,
                edges: found.edges,
                faces: found.faces,
                inner_rings: found.rings,
                boundaries: found.boundaries,
                genus: found.genus().map_or(-1, |genus| genus as i64),
                volume: topology.six_volumes(number) as f64 * cube,
            };
        }
        *count = topology.shells() as usize;
        Ok(())
    })
}

/// Makes the file of the body of a set operation on `count` models, exactly, as `spinney combine` does; `operation` is its number, from 0 to 15: 1
/// is the intersection, 2 the first without the second, 6 the symmetric difference, 7 the union, 12 the complement. Grids must have the
/// same step. Takes at most `memory` bytes for the faces that are near each other's. Where it fails there is no file; spinney_warnings() tells what of
/// the models is not kept.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_combine(
    operation: u32,
    models: *const *const spinney_model,
    count: usize,
    path: *const c_char,
    memory: u64,
) -> spinney_status {
    guarded(|| {
        let warnings = Warnings::begin();
        if models.is_null()
            || path.is_null()
            || count > isize::MAX as usize / size_of::<*const spinney_model>()
        {
            let text = format!("spinney_model_combine: got NULL or {count} models, expected some and a path");
            return Err(Failure::invalid(text));
        }
        let operation = u8::try_from(operation)
            .ok()
            .and_then(SetOperation::from_index)
            .ok_or_else(|| Failure::invalid(format!("operation: got {operation}, expected 0 to 15")))?;
        // SAFETY: the caller has so many there.
        let models = unsafe { slice::from_raw_parts(models, count) };
        // SAFETY: each is NULL, which is found, or comes from spinney_model_open().
        let models = models.iter().map(|model| unsafe { opened(*model) });
        let models: Vec<&ExactModel> = models.collect::<Result<_, Failure>>()?;
        // SAFETY: the caller passes a zero-terminated text.
        let path = path_of(unsafe { CStr::from_ptr(path) })?;
        if models.iter().any(|model| model.path() == path) {
            return Err(Failure::invalid("path: is that of one of the models, expected another file"));
        }
        combine(operation, &models, Output::create(&path)?, Codec::Plain, memory, &warnings)?;
        Ok(())
    })
}
