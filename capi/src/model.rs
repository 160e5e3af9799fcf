//! Exact models: opening files of them, and questions.

use std::ffi::{CStr, c_char};

use engine::brep::{Faces, Hit, Location, MassProperties};
use engine::{ExactModel, OpenOptions};

use crate::dataset::{SPINNEY_POSITIONED, path_of};
use crate::questions::{buffer, items};
use crate::status::{Failure, guarded, spinney_status};

/// An exact model: the boundary of a body, kept as it is and not as cells.
pub struct spinney_model {
    model: ExactModel,
}

/// Numbers of an exact model.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_model_info {
    /// Number of faces.
    pub faces: u64,
    /// Number of the octree's nodes.
    pub nodes: u64,
    /// Number of the parts to which faces belong.
    pub parts: u64,
    /// Levels of the octree.
    pub depth: u32,
    /// Bits of the grid's coordinates: there are 2^bits points along each axis.
    pub bits: u32,
    /// Width of the grid's steps in the world.
    pub step: f64,
    /// The grid's least point in the world.
    pub origin: [f64; 3],
}

/// Measures of an exact model, of a density of 1: exact numbers for its grid, each rounded once (but for the area).
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_mass {
    pub volume: f64,
    pub area: f64,
    /// Centre of gravity; zeros if has_centre is false, since there is no volume.
    pub centre: [f64; 3],
    /// Integrals of the products of two coordinates about the centre, row by row.
    pub second_moments: [f64; 9],
    /// Inertia tensor about the centre, row by row.
    pub inertia: [f64; 9],
    pub has_centre: bool,
}

/// Place of a point, by spinney_model_locate(): outside of the body.
pub const SPINNEY_OUTSIDE: i8 = -1;

/// On a face, an edge or a vertex.
pub const SPINNEY_BOUNDARY: i8 = 0;

/// Inside the body.
pub const SPINNEY_INSIDE: i8 = 1;

/// What a ray meets first.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_hit {
    /// How far away it is, in lengths of the ray's direction.
    pub distance: f64,
    /// The place in the world.
    pub point: [f64; 3],
    /// Number of the face.
    pub face: u64,
    /// Number of its part.
    pub part: u32,
    /// Whether the ray comes from outside.
    pub is_entry: bool,
    /// Whether anything is met; else the rest is zeros.
    pub is_hit: bool,
}

/// Opens the file of an exact model, as `spinney build --brep` makes them. `flags` is 0 or SPINNEY_POSITIONED. The model is to
/// be closed by spinney_model_close(). Trees of cells are SPINNEY_CORRUPT: spinney_open() is for these.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_open(
    path: *const c_char,
    flags: u32,
    model: *mut *mut spinney_model,
) -> spinney_status {
    guarded(|| {
        if path.is_null() || model.is_null() {
            let text = "spinney_model_open: got NULL, expected a path and a place for the model";
            return Err(Failure::invalid(text));
        }
        if flags & !SPINNEY_POSITIONED != 0 {
            let text = format!("spinney_model_open: got flags {flags}, expected 0 or SPINNEY_POSITIONED");
            return Err(Failure::invalid(text));
        }
        // SAFETY: the caller passes a zero-terminated text.
        let path = path_of(unsafe { CStr::from_ptr(path) })?;
        let mut options = OpenOptions::new();
        if flags & SPINNEY_POSITIONED != 0 {
            options.access = options.access.positioned(None);
        }
        let handle = Box::new(spinney_model { model: ExactModel::open(&path, &options)? });
        // SAFETY: it is not NULL, and the caller has a pointer there.
        unsafe { model.write(Box::into_raw(handle)) };
        Ok(())
    })
}

/// Closes a model; NULL is nothing to close.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_close(model: *mut spinney_model) {
    guarded(|| {
        if !model.is_null() {
            // SAFETY: it comes from spinney_model_open(), and nobody uses it any more.
            drop(unsafe { Box::from_raw(model) });
        }
        Ok(())
    });
}

/// The model behind a handle.
pub(crate) unsafe fn opened<'a>(model: *const spinney_model) -> Result<&'a ExactModel, Failure> {
    // SAFETY: it is NULL, or comes from spinney_model_open() and is not closed.
    let handle = unsafe { model.as_ref() };
    let handle =
        handle.ok_or_else(|| Failure::invalid("model: got NULL, expected one from spinney_model_open"))?;
    Ok(&handle.model)
}

/// The caller's place for an answer.
pub(crate) unsafe fn place<'a, T>(name: &str, place: *mut T) -> Result<&'a mut T, Failure> {
    // SAFETY: it is NULL, or a place of the caller's.
    unsafe { place.as_mut() }.ok_or_else(|| Failure::invalid(format!("{name}: got NULL, expected a place")))
}

/// The caller's place for a struct, of whose size it is sure.
unsafe fn sized<'a, T>(name: &str, answer: *mut T, size: usize) -> Result<&'a mut T, Failure> {
    check_size(name, size, size_of::<T>())?;
    // SAFETY: as that says.
    unsafe { place(name, answer) }
}

/// Fails if a struct has another size for the caller.
pub(crate) fn check_size(name: &str, size: usize, expected: usize) -> Result<(), Failure> {
    if size == expected {
        return Ok(());
    }
    Err(Failure::invalid(format!("{name}: got {size} bytes, expected a place of {expected}")))
}

/// Points of the caller's: so many, of three coordinates each.
unsafe fn points_at<'a>(points: *const f64, count: usize) -> Result<&'a [[f64; 3]], Failure> {
    // SAFETY: the caller has so many there.
    unsafe { items("points", points.cast(), count) }
}

/// Fails with SPINNEY_CHANGED if the file was overwritten or cut short since it was opened.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_check_unchanged(model: *const spinney_model) -> spinney_status {
    // SAFETY: as `opened` says.
    guarded(|| Ok(unsafe { opened(model) }?.check_unchanged()?))
}

/// Tells a model's numbers. `info_size` is `sizeof(spinney_model_info)`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_describe(
    model: *const spinney_model,
    info: *mut spinney_model_info,
    info_size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: as these say.
        let (model, info) = unsafe { (opened(model)?, sized("info", info, info_size)?) };
        let grid = model.grid();
        *info = spinney_model_info {
            faces: model.len(),
            nodes: model.nodes().total(),
            parts: model.parts().len() as u64,
            depth: model.depth().into(),
            bits: grid.bits.into(),
            step: grid.width(),
            origin: grid.to_world([0; 3]),
        };
        Ok(())
    })
}

/// Least and greatest coordinates of the surface, exact: `bounds` has room for three and three.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_bounds(
    model: *const spinney_model,
    bounds: *mut [f64; 6],
) -> spinney_status {
    guarded(|| {
        // SAFETY: as these say.
        let (model, bounds) = unsafe { (opened(model)?, place("bounds", bounds)?) };
        let found = model.bounds()?;
        bounds.copy_from_slice(found.as_flattened());
        Ok(())
    })
}

/// Measures the body. `mass_size` is `sizeof(spinney_mass)`. Reads all faces.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_measure(
    model: *const spinney_model,
    mass: *mut spinney_mass,
    mass_size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: as these say.
        let (model, mass) = unsafe { (opened(model)?, sized("mass", mass, mass_size)?) };
        let found = MassProperties::of(model, &())?;
        let rows = |matrix: [[f64; 3]; 3]| std::array::from_fn(|i| matrix[i / 3][i % 3]);
        *mass = spinney_mass {
            volume: found.volume,
            area: found.area,
            centre: found.centre.unwrap_or_default(),
            second_moments: rows(found.second_moments),
            inertia: rows(found.inertia),
            has_centre: found.centre.is_some(),
        };
        Ok(())
    })
}

/// Tells of each of `count` points (x, y, z in the world) where it lies: SPINNEY_OUTSIDE, SPINNEY_BOUNDARY or SPINNEY_INSIDE in each of as many bytes. Exact. Works in the
/// calling thread; several may ask at once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_locate(
    model: *const spinney_model,
    points: *const f64,
    count: usize,
    locations: *mut i8,
    location_count: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: as these say.
        let (model, points) = unsafe { (opened(model)?, points_at(points, count)?) };
        // SAFETY: as that says.
        let locations = unsafe { buffer("locations", locations, location_count, Some(count as u64))? };
        let mut found = Vec::with_capacity(BATCH.min(count));
        for (points, locations) in points.chunks(BATCH).zip(locations.chunks_mut(BATCH)) {
            found.clear();
            model.locate_all(points, &mut found)?;
            for (location, found) in locations.iter_mut().zip(&found) {
                *location = match found {
                    Location::Inside => SPINNEY_INSIDE,
                    Location::Boundary => SPINNEY_BOUNDARY,
                    Location::Outside => SPINNEY_OUTSIDE,
                };
            }
        }
        Ok(())
    })
}

/// Points that are answered at a time.
const BATCH: usize = 4096;

/// Tells how far each of `count` points is from the surface: negative inside, 0 on it, infinite for what is no number. Works in the
/// calling thread, as spinney_model_locate() does.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_distance(
    model: *const spinney_model,
    points: *const f64,
    count: usize,
    distances: *mut f64,
    distance_count: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: as these say.
        let (model, points) = unsafe { (opened(model)?, points_at(points, count)?) };
        // SAFETY: as that says.
        let distances = unsafe { buffer("distances", distances, distance_count, Some(count as u64))? };
        for (point, distance) in points.iter().zip(distances) {
            *distance = model.signed_distance(*point)?;
        }
        Ok(())
    })
}

/// Finds what a ray from `origin` along `direction` meets first; no ray slips through between two faces. `hit_size` is
/// `sizeof(spinney_hit)`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_ray(
    model: *const spinney_model,
    origin: *const f64,
    direction: *const f64,
    hit: *mut spinney_hit,
    hit_size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: as these say.
        let (model, hit) = unsafe { (opened(model)?, sized("hit", hit, hit_size)?) };
        // SAFETY: as that says.
        let (origin, direction) = unsafe { (points_at(origin, 1)?[0], points_at(direction, 1)?[0]) };
        check_ray(&origin, &direction)?;
        let (found, _) = model.ray(origin, direction)?;
        *hit = hit_of(found.as_ref());
        Ok(())
    })
}

/// Fails for what is no ray.
fn check_ray(origin: &[f64; 3], direction: &[f64; 3]) -> Result<(), Failure> {
    if origin.iter().chain(direction).all(|at| at.is_finite()) && *direction != [0.0; 3] {
        return Ok(());
    }
    let found = format!("{origin:?} and {direction:?}");
    Err(Failure::invalid(format!("ray: got {found}, expected a point and a direction")))
}

fn hit_of(found: Option<&Hit>) -> spinney_hit {
    let none =
        spinney_hit { distance: 0.0, point: [0.0; 3], face: 0, part: 0, is_entry: false, is_hit: false };
    found.map_or(none, |found| spinney_hit {
        distance: found.share,
        point: found.point,
        face: found.face,
        part: found.part,
        is_entry: found.is_entry,
        is_hit: true,
    })
}

/// Finds what each of `count` rays, from one of `origins` along one of `directions` (x, y, z each), meets first, to as many `hits`, each of
/// which has `hit_size` bytes, `sizeof(spinney_hit)`. Works in the calling thread; several may ask at once. Rays that follow each other take the
/// least time where they are near each other.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_rays(
    model: *const spinney_model,
    origins: *const f64,
    directions: *const f64,
    count: usize,
    hits: *mut spinney_hit,
    hit_count: usize,
    hit_size: usize,
) -> spinney_status {
    guarded(|| {
        check_size("hits", hit_size, size_of::<spinney_hit>())?;
        // SAFETY: as these say.
        let (model, origins) = unsafe { (opened(model)?, points_at(origins, count)?) };
        // SAFETY: as these say.
        let (directions, hits) =
            unsafe { (points_at(directions, count)?, buffer("hits", hits, hit_count, Some(count as u64))?) };
        origins.iter().zip(directions).try_for_each(|(origin, direction)| check_ray(origin, direction))?;
        let (mut caster, mut rays) = (model.rays(), Vec::with_capacity(BATCH.min(count)));
        let batches = origins.chunks(BATCH).zip(directions.chunks(BATCH)).zip(hits.chunks_mut(BATCH));
        for ((origins, directions), hits) in batches {
            rays.clear();
            rays.extend(origins.iter().zip(directions).map(|(origin, direction)| [*origin, *direction]));
            for (hit, found) in hits.iter_mut().zip(caster.first_of(&rays)?) {
                *hit = hit_of(found.as_ref());
            }
        }
        Ok(())
    })
}
