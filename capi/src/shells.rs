//! Exact models: shells, and set operations.

use std::ffi::{CStr, c_char};
use std::slice;

use engine::brep::{Faces, combine};
use engine::raw::brep::topology::{Topology, TopologyOptions};
use engine::{Codec, ExactModel, Output, SetOperation};

use crate::dataset::path_of;
use crate::model::{check_size, opened, output, spinney_model};
use crate::queries::buffer;
use crate::status::{Failure, guarded, spinney_status};
use crate::warnings::Warnings;

/// Topological counts of a shell, a connected surface.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_shell {
    pub vertices: u64,
    pub edges: u64,
    pub faces: u64,
    /// Rings after the first of each face: holes in faces.
    pub inner_rings: u64,
    /// Number of boundaries; 0 for a closed shell.
    pub boundaries: u64,
    /// Number of handles; -1 if it is undefined.
    pub genus: i64,
    /// Enclosed volume, rounded once. Negative for a cavity; the shells of bodies have positive
    /// volumes.
    pub volume: f64,
}

/// Measures each shell, in the order of their first faces. `shells` has a capacity of `capacity`
/// structs, each of `shell_size` bytes, `sizeof(spinney_shell)`. `count` is set to the shell count.
/// Uses at most `memory` bytes, about 60 per face corner; reads all faces twice.
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
        // SAFETY: see `opened` and `output`.
        let (model, count) = unsafe { (opened(model)?, output("count", count)?) };
        // SAFETY: the caller has the stated capacity there; NULL with a capacity above 0 is
        // detected.
        let shells = unsafe { buffer("shells", shells, capacity, None)? };
        let options = TopologyOptions { memory, path: model.path().to_path_buf() };
        let topology = Topology::of(model, &options, &())?;
        let cube = model.grid().width().powi(3) / 6.0;
        for (number, (output, found)) in (0..).zip(shells.iter_mut().zip(topology.counts_by_shell())) {
            *output = spinney_shell {
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

/// Writes the result of an exact set operation on `count` models to a file, as `spinney combine`
/// does. `operation` is its index, from 0 to 15: 1 is the intersection, 2 the first without the
/// second, 6 the symmetric difference, 7 the union, 12 the complement. The grids must have the same
/// unit width. Uses at most `memory` bytes for faces that are near faces of other models. No file
/// is left if the call fails. spinney_warnings() reports which properties of the models are lost.
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
            let text =
                format!("spinney_model_combine: got NULL or {count} models, expected models and a path");
            return Err(Failure::invalid(text));
        }
        let operation = u8::try_from(operation)
            .ok()
            .and_then(SetOperation::from_index)
            .ok_or_else(|| Failure::invalid(format!("operation: got {operation}, expected 0 to 15")))?;
        // SAFETY: the caller has `count` pointers there.
        let models = unsafe { slice::from_raw_parts(models, count) };
        // SAFETY: each is NULL, which is detected, or comes from spinney_model_open().
        let models = models.iter().map(|model| unsafe { opened(*model) });
        let models: Vec<&ExactModel> = models.collect::<Result<_, Failure>>()?;
        // SAFETY: the caller passes a zero-terminated string.
        let path = path_of(unsafe { CStr::from_ptr(path) })?;
        if models.iter().any(|model| model.path() == path) {
            return Err(Failure::invalid("path: got that of one of the models, expected another file"));
        }
        combine(operation, &models, Output::create(&path)?, Codec::Plain, memory, &warnings)?;
        Ok(())
    })
}
