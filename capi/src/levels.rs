//! Levels of detail of exact models, and surfaces as triangles.

use std::collections::HashMap;

use engine::brep::{Faces, SurfaceDetail};
use engine::raw::brep::each_triangle;

use crate::model::{check_size, opened, output, spinney_model};
use crate::queries::{buffer, items};
use crate::status::{Failure, guarded, spinney_status};

/// A level of detail of an exact model: a closed surface.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_detail_level {
    /// Number of faces. Those of coarser levels than the exact surface are triangles.
    pub faces: u64,
    /// Bound of the distance between the level and the exact surface, both ways, in the world.
    pub error: f64,
    /// Bytes of the faces that are stored for this level.
    pub bytes: u64,
    /// Number of connected surfaces of an object that have no faces in this level.
    pub vanished_bodies: u64,
    /// Bound of the largest diameter of these, in the world.
    pub vanished_diameter: f64,
}

/// For `by` of spinney_detail: the exact surface.
pub const SPINNEY_DETAIL_EXACT: u32 = 0;

/// As few faces as possible, whose distance from the exact surface is at most `error`.
pub const SPINNEY_DETAIL_ERROR: u32 = 1;

/// The smallest error for which there are at most `faces` faces.
pub const SPINNEY_DETAIL_FACES: u32 = 2;

/// Level `level`; level 0 is the coarsest.
pub const SPINNEY_DETAIL_LEVEL: u32 = 3;

/// How much detail a surface has, and where. Zeros mean the whole exact surface, as in
/// `spinney_detail detail = {0};`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_detail {
    /// One of SPINNEY_DETAIL_*, which decides which of the next three members is used.
    pub by: u32,
    /// Level of detail.
    pub level: u32,
    /// Maximum number of faces.
    pub faces: u64,
    /// Maximum distance from the exact surface, in the world.
    pub error: f64,
    /// A box: three minimum and three maximum coordinates in the world. The exact surface then
    /// consists of the faces whose own boxes touch it, another one of all clusters (of about 500
    /// faces) that touch it; it is open outside of the box. NULL for the whole surface.
    pub bounds: *const f64,
}

/// The caller's arrays for triangles, their capacities, and the total counts.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_triangles {
    /// Gets x, y and z of each vertex in the world.
    pub vertices: *mut f64,
    /// Capacity of `vertices`, in vertices.
    pub vertex_capacity: usize,
    /// Gets three vertex indices per triangle, counterclockwise seen from outside.
    pub corners: *mut u32,
    /// Gets the part index of each triangle; may be NULL.
    pub parts: *mut u32,
    /// Gets red, green and blue of the three corners of each triangle, nine bytes; may be NULL.
    /// Zeros for faces without colours.
    pub colours: *mut u8,
    /// Capacity of `corners`, `parts` and `colours`, in triangles.
    pub triangle_capacity: usize,
    /// Set to the number of vertices.
    pub vertex_count: usize,
    /// Set to the number of triangles.
    pub triangle_count: usize,
    /// Set to a bound of the distance between this surface and the exact one, both ways; 0 if it
    /// is exact.
    pub error: f64,
    /// Set to whether all faces have colours.
    pub has_colours: bool,
}

/// Writes the levels of detail of a model, coarsest first; the last one is the exact surface.
/// `levels` has a capacity of `capacity` structs, each of `level_size` bytes,
/// `sizeof(spinney_detail_level)`. `count` is set to the number of levels: 0 if the file has none.
/// `spinney transform FILE levels -o OUTPUT` adds them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_levels(
    model: *const spinney_model,
    levels: *mut spinney_detail_level,
    capacity: usize,
    level_size: usize,
    count: *mut usize,
) -> spinney_status {
    guarded(|| {
        check_size("levels", level_size, size_of::<spinney_detail_level>())?;
        // SAFETY: see `opened` and `output`.
        let (model, count) = unsafe { (opened(model)?, output("count", count)?) };
        // SAFETY: the caller has the stated capacity there; NULL with a capacity above 0 is
        // detected.
        let levels = unsafe { buffer("levels", levels, capacity, None)? };
        let width = model.grid().width();
        for (output, level) in levels.iter_mut().zip(model.levels()) {
            *output = spinney_detail_level {
                faces: level.faces,
                error: level.error * width,
                bytes: level.bytes,
                vanished_bodies: level.vanished,
                vanished_diameter: level.vanished_diameter * width,
            };
        }
        *count = model.levels().len();
        Ok(())
    })
}

/// Writes a surface of a model as triangles, at a level of detail. `detail_size` is
/// `sizeof(spinney_detail)`; `detail` may be NULL for the whole exact surface. `triangles_size` is
/// `sizeof(spinney_triangles)`. Vertices and triangles beyond the capacities are only counted: pass
/// NULL and 0 to get the counts.
///
/// A coarse surface is closed where the exact one is, but may intersect itself, within its error:
/// it is for display. Reads only the clusters that the surface consists of. SPINNEY_UNSUPPORTED if
/// the file has no levels, unless the detail is the exact surface.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_triangles(
    model: *const spinney_model,
    detail: *const spinney_detail,
    detail_size: usize,
    triangles: *mut spinney_triangles,
    triangles_size: usize,
) -> spinney_status {
    guarded(|| {
        if !detail.is_null() {
            check_size("detail", detail_size, size_of::<spinney_detail>())?;
        }
        check_size("triangles", triangles_size, size_of::<spinney_triangles>())?;
        // SAFETY: see `opened` and `output`; `detail` is NULL or the caller's struct, whose size is
        // checked.
        let (model, detail, triangles) =
            unsafe { (opened(model)?, detail.as_ref(), output("triangles", triangles)?) };
        let bounds = match detail {
            Some(detail) if !detail.bounds.is_null() => {
                // SAFETY: the caller has six numbers there.
                let corners = unsafe { items("bounds", detail.bounds.cast::<[[f64; 3]; 2]>(), 1)? };
                corners.first().copied()
            }
            _ => None,
        };
        let wanted = detail.map_or(Ok(SurfaceDetail::Exact), spinney_detail::wanted)?;
        let surface = model.surface(wanted, bounds, &())?;
        // SAFETY: the caller's struct describes its arrays.
        unsafe { triangles.fill(&surface)? };
        model.check_unchanged()?;
        triangles.error = surface.error();
        Ok(())
    })
}

impl spinney_detail {
    /// Returns the detail.
    fn wanted(&self) -> Result<SurfaceDetail, Failure> {
        Ok(match self.by {
            SPINNEY_DETAIL_EXACT => SurfaceDetail::Exact,
            SPINNEY_DETAIL_ERROR => SurfaceDetail::Error(self.error),
            SPINNEY_DETAIL_FACES => SurfaceDetail::Faces(self.faces),
            SPINNEY_DETAIL_LEVEL => SurfaceDetail::Level(self.level.try_into().unwrap_or(u8::MAX)),
            other => {
                let text = format!("by: got {other}, expected one of SPINNEY_DETAIL_*");
                return Err(Failure::invalid(text));
            }
        })
    }
}

impl spinney_triangles {
    /// Writes the triangles of faces to the caller's arrays, and counts them.
    unsafe fn fill(&mut self, faces: &dyn Faces) -> Result<(), Failure> {
        // An array that may be NULL has no capacity then.
        let optional = |is_null: bool| if is_null { 0 } else { self.triangle_capacity };
        // SAFETY: the caller has the stated capacities there; NULL with a capacity above 0 is
        // detected.
        let (vertices, corners, parts, colours) = unsafe {
            (
                buffer("vertices", self.vertices.cast::<[f64; 3]>(), self.vertex_capacity, None)?,
                buffer("corners", self.corners.cast::<[u32; 3]>(), self.triangle_capacity, None)?,
                buffer("parts", self.parts, optional(self.parts.is_null()), None)?,
                buffer("colours", self.colours.cast::<[u8; 9]>(), optional(self.colours.is_null()), None)?,
            )
        };
        let mut known: HashMap<[i32; 3], u32> = HashMap::new();
        let (mut count, mut coloured) = (0, 0);
        let grid = faces.grid();
        each_triangle(faces, &mut |face| {
            let mut indices = [0; 3];
            for (index, point) in indices.iter_mut().zip(face.points) {
                let next = known.len();
                *index = *known.entry(*point).or_insert_with(|| {
                    if let Some(vertex) = vertices.get_mut(next) {
                        *vertex = grid.to_world(*point);
                    }
                    next as u32
                });
            }
            if let Some(output) = corners.get_mut(count) {
                *output = indices;
            }
            if let Some(output) = parts.get_mut(count) {
                *output = face.part;
            }
            if let Some(output) = colours.get_mut(count) {
                *output = [0; 9];
                output.iter_mut().zip(face.colours.as_flattened()).for_each(|(to, from)| *to = *from);
            }
            count += 1;
            coloured += usize::from(face.colours.len() == 3);
            Ok(())
        })?;
        if known.len() > u32::MAX as usize {
            let text = format!("triangles: there are {} vertices, expected fewer than 2^32", known.len());
            return Err(Failure::unsupported(text));
        }
        (self.vertex_count, self.triangle_count) = (known.len(), count);
        self.has_colours = count > 0 && coloured == count;
        Ok(())
    }
}
