//! Opening and querying of exact models.

use std::ffi::{CStr, c_char};

use engine::brep::{Faces, Hit, Location, MassProperties};
use engine::{ExactModel, OpenOptions};

use crate::dataset::{SPINNEY_POSITIONED, path_of};
use crate::queries::{buffer, items};
use crate::status::{Failure, guarded, spinney_status};

/// An exact model: the boundary of a body, stored unchanged, not as cells.
pub struct spinney_model {
    model: ExactModel,
}

/// Counts and grid of an exact model.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_model_info {
    /// Number of faces.
    pub faces: u64,
    /// Number of octree nodes.
    pub nodes: u64,
    /// Number of parts. Each face belongs to one.
    pub parts: u64,
    /// Levels of the octree.
    pub depth: u32,
    /// Bits of the grid's coordinates: there are 2^bits points along each axis.
    pub bits: u32,
    /// Width of a grid unit in the world.
    pub step: f64,
    /// The grid's minimum corner in the world.
    pub origin: [f64; 3],
}

/// Measures of an exact model, for a density of 1: computed exactly on its grid, and rounded once
/// (except the area).
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_mass {
    pub volume: f64,
    pub area: f64,
    /// Centre of gravity; zeros if has_centre is false, which means that there is no volume.
    pub centre: [f64; 3],
    /// Integrals of the products of two coordinates about the centre, row by row.
    pub second_moments: [f64; 9],
    /// Inertia tensor about the centre, row by row.
    pub inertia: [f64; 9],
    pub has_centre: bool,
}

/// Location of a point, by spinney_model_locate(): outside of the body.
pub const SPINNEY_OUTSIDE: i8 = -1;

/// On a face, an edge or a vertex.
pub const SPINNEY_BOUNDARY: i8 = 0;

/// Inside the body.
pub const SPINNEY_INSIDE: i8 = 1;

/// The first hit of a ray.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_hit {
    /// Distance from the ray's origin, in lengths of the ray's direction.
    pub distance: f64,
    /// Position in the world.
    pub point: [f64; 3],
    /// Index of the face.
    pub face: u64,
    /// Index of its part.
    pub part: u32,
    /// Whether the ray enters the body there.
    pub is_entry: bool,
    /// Whether the ray hits the surface; otherwise all other fields are zeros.
    pub is_hit: bool,
}

/// Opens the file of an exact model, as built by `spinney build --brep`. `flags` is 0 or
/// SPINNEY_POSITIONED. Close the model with spinney_model_close(). SPINNEY_CORRUPT for trees of
/// cells: open them with spinney_open().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_open(
    path: *const c_char,
    flags: u32,
    model: *mut *mut spinney_model,
) -> spinney_status {
    guarded(|| {
        if path.is_null() || model.is_null() {
            let text = "spinney_model_open: got NULL, expected a path, and a pointer to the model";
            return Err(Failure::invalid(text));
        }
        if flags & !SPINNEY_POSITIONED != 0 {
            let text = format!("spinney_model_open: got flags {flags}, expected 0 or SPINNEY_POSITIONED");
            return Err(Failure::invalid(text));
        }
        // SAFETY: the caller passes a zero-terminated string.
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

/// Closes a model. Does nothing for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_close(model: *mut spinney_model) {
    guarded(|| {
        if !model.is_null() {
            // SAFETY: it comes from spinney_model_open(), and no other thread uses it any more.
            drop(unsafe { Box::from_raw(model) });
        }
        Ok(())
    });
}

/// Returns the model of a handle.
pub(crate) unsafe fn opened<'a>(model: *const spinney_model) -> Result<&'a ExactModel, Failure> {
    // SAFETY: it is NULL, or comes from spinney_model_open() and is not closed.
    let handle = unsafe { model.as_ref() };
    let handle =
        handle.ok_or_else(|| Failure::invalid("model: got NULL, expected one from spinney_model_open"))?;
    Ok(&handle.model)
}

/// Returns the caller's variable for a result.
pub(crate) unsafe fn output<'a, T>(name: &str, output: *mut T) -> Result<&'a mut T, Failure> {
    // SAFETY: it is NULL, or points to the caller's variable.
    unsafe { output.as_mut() }
        .ok_or_else(|| Failure::invalid(format!("{name}: got NULL, expected a pointer")))
}

/// Returns the caller's struct for a result, after a check of its size.
unsafe fn sized<'a, T>(name: &str, result: *mut T, size: usize) -> Result<&'a mut T, Failure> {
    check_size(name, size, size_of::<T>())?;
    // SAFETY: see `output`.
    unsafe { output(name, result) }
}

/// Fails if the caller's struct has another size.
pub(crate) fn check_size(name: &str, size: usize, expected: usize) -> Result<(), Failure> {
    if size == expected {
        return Ok(());
    }
    Err(Failure::invalid(format!("{name}: got {size} bytes, expected a pointer to {expected}")))
}

/// Returns the caller's points: `count` of them, three coordinates each.
unsafe fn points_at<'a>(points: *const f64, count: usize) -> Result<&'a [[f64; 3]], Failure> {
    // SAFETY: the caller has `count` points there.
    unsafe { items("points", points.cast(), count) }
}

/// Fails with SPINNEY_CHANGED if the file was overwritten or truncated after it was opened.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_check_unchanged(model: *const spinney_model) -> spinney_status {
    // SAFETY: see `opened`.
    guarded(|| Ok(unsafe { opened(model) }?.check_unchanged()?))
}

/// Writes counts and grid of a model to `info`. `info_size` is `sizeof(spinney_model_info)`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_describe(
    model: *const spinney_model,
    info: *mut spinney_model_info,
    info_size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `sized`.
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

/// Writes the exact bounding box of the surface to `bounds`: three minimum and three maximum
/// coordinates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_bounds(
    model: *const spinney_model,
    bounds: *mut [f64; 6],
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `output`.
        let (model, bounds) = unsafe { (opened(model)?, output("bounds", bounds)?) };
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
        // SAFETY: see `opened` and `sized`.
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

/// Locates each of `count` points (x, y, z in the world): writes SPINNEY_OUTSIDE, SPINNEY_BOUNDARY
/// or SPINNEY_INSIDE to one byte per point. Exact. Runs in the calling thread; several threads may
/// query at once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_locate(
    model: *const spinney_model,
    points: *const f64,
    count: usize,
    locations: *mut i8,
    location_count: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `points_at`.
        let (model, points) = unsafe { (opened(model)?, points_at(points, count)?) };
        // SAFETY: see `buffer`.
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

/// Points or rays that are processed together.
const BATCH: usize = 4096;

/// Writes each of `count` points' distance from the surface: negative inside, 0 on it, infinite for
/// points that are not finite. Runs in the calling thread, like spinney_model_locate().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_distance(
    model: *const spinney_model,
    points: *const f64,
    count: usize,
    distances: *mut f64,
    distance_count: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `points_at`.
        let (model, points) = unsafe { (opened(model)?, points_at(points, count)?) };
        // SAFETY: see `buffer`.
        let distances = unsafe { buffer("distances", distances, distance_count, Some(count as u64))? };
        for (point, distance) in points.iter().zip(distances) {
            *distance = model.signed_distance(*point)?;
        }
        Ok(())
    })
}

/// Finds the first hit of a ray from `origin` along `direction`. No ray passes between two adjacent
/// faces. `hit_size` is `sizeof(spinney_hit)`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_ray(
    model: *const spinney_model,
    origin: *const f64,
    direction: *const f64,
    hit: *mut spinney_hit,
    hit_size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `sized`.
        let (model, hit) = unsafe { (opened(model)?, sized("hit", hit, hit_size)?) };
        // SAFETY: see `points_at`.
        let (origin, direction) = unsafe { (points_at(origin, 1)?[0], points_at(direction, 1)?[0]) };
        check_ray(&origin, &direction)?;
        let (found, _) = model.ray(origin, direction)?;
        *hit = hit_of(found.as_ref());
        Ok(())
    })
}

/// Fails if a coordinate is not finite, or the direction is zero.
fn check_ray(origin: &[f64; 3], direction: &[f64; 3]) -> Result<(), Failure> {
    if origin.iter().chain(direction).all(|at| at.is_finite()) && *direction != [0.0; 3] {
        return Ok(());
    }
    let found = format!("{origin:?} and {direction:?}");
    Err(Failure::invalid(format!("ray: got {found}, expected a finite point and a direction other than 0")))
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

/// Finds the first hit of each of `count` rays, from one of `origins` along one of `directions` (x,
/// y, z each). Writes as many `hits`, each of `hit_size` bytes, `sizeof(spinney_hit)`. Runs in the
/// calling thread; several threads may query at once. Fastest if consecutive rays are near each
/// other.
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
        // SAFETY: see `opened` and `points_at`.
        let (model, origins) = unsafe { (opened(model)?, points_at(origins, count)?) };
        // SAFETY: see `points_at` and `buffer`.
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
