//! Plane sections of exact models.

use engine::brep::CuttingPlane;

use crate::model::{check_size, opened, output, spinney_model};
use crate::queries::{buffer, items};
use crate::status::{guarded, spinney_status};

/// A ring of a section.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_ring {
    /// Index of its polygon, from 0. A polygon's rings are consecutive: first the outer one,
    /// counterclockwise as seen from the side to which the plane's normal points, then the holes,
    /// clockwise.
    pub polygon: u64,
    /// End of its points, which begin at the end of the previous ring. The last point repeats the
    /// first one.
    pub end: u64,
    /// Area of the polygon without its holes; 0 for holes, so that the sum is the section's area.
    pub area: f64,
}

/// Cuts the body by the plane through `point` with the normal `normal` (x, y, z each): polygons
/// with holes. `rings` gets their rings, each of `ring_size` bytes, `sizeof(spinney_ring)`.
/// `points` gets the points of all rings, consecutively, in space (x, y, z each). The capacities
/// are `ring_capacity` rings and `point_capacity` points. `ring_count` and `point_count` are set to
/// the total counts; pass NULL and 0 to get only these.
///
/// The section is the one just below the plane: it includes solids that end at the plane from
/// below, not those that begin there. Reads only nodes that the plane cuts. SPINNEY_UNSUPPORTED for
/// unbounded bodies.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_section(
    model: *const spinney_model,
    point: *const f64,
    normal: *const f64,
    rings: *mut spinney_ring,
    ring_capacity: usize,
    ring_size: usize,
    ring_count: *mut usize,
    points: *mut f64,
    point_capacity: usize,
    point_count: *mut usize,
) -> spinney_status {
    guarded(|| {
        check_size("rings", ring_size, size_of::<spinney_ring>())?;
        // SAFETY: the caller has three coordinates each there, or NULL, which is detected.
        let (model, point, normal) =
            unsafe { (opened(model)?, items("point", point, 3)?, items("normal", normal, 3)?) };
        // SAFETY: see `output`.
        let (ring_count, point_count) =
            unsafe { (output("ring_count", ring_count)?, output("point_count", point_count)?) };
        // SAFETY: the caller has the stated capacities there; NULL with a capacity above 0 is
        // detected.
        let (rings, points) = unsafe {
            let rings = buffer("rings", rings, ring_capacity, None)?;
            (rings, buffer("points", points.cast::<[f64; 3]>(), point_capacity, None)?)
        };
        let distance = point.iter().zip(normal).map(|(at, along)| at * along).sum();
        let normal = [normal[0], normal[1], normal[2]];
        let found = model.section(&CuttingPlane { normal, distance }, &())?;
        model.check_unchanged()?;
        (*ring_count, *point_count) = (0, 0);
        for (number, polygon) in (0..).zip(&found) {
            for (hole, ring) in polygon.rings.iter().enumerate() {
                let outputs = points.iter_mut().skip(*point_count);
                outputs.zip(ring).for_each(|(output, point)| *output = *point);
                *point_count += ring.len();
                if let Some(output) = rings.get_mut(*ring_count) {
                    let area = if hole == 0 { polygon.area } else { 0.0 };
                    *output = spinney_ring { polygon: number, end: *point_count as u64, area };
                }
                *ring_count += 1;
            }
        }
        Ok(())
    })
}
