//! Meshes in memory, from which exact models are built.

use std::ffi::{CStr, c_char, c_void};

use engine::import::mesh::{ExactOptions, import_exact};
use engine::raw::brep::InsideRule;
use engine::raw::import::mesh::{ExactReport, MeshArrays, MeshColours, Model};
use engine::{Crs, Output};

use crate::dataset::path_of;
use crate::model::check_size;
use crate::queries::items;
use crate::status::{Failure, guarded, spinney_status};
use crate::warnings::Warnings;

/// A mesh in the caller's memory: vertices, and faces over them. Absent values are zeros and NULL,
/// as in `spinney_mesh mesh = {0};`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_mesh {
    /// Name, for error messages, and for the only part of a mesh without `part_names`; NULL for
    /// "mesh".
    pub name: *const c_char,
    /// Coordinates of the vertices: x, y and z of each.
    pub vertices: *const f64,
    /// Number of vertices.
    pub vertex_count: usize,
    /// Colours: red, green and blue of each vertex; NULL for none.
    pub colours: *const u8,
    /// Face corners: indices of vertices from 0, counterclockwise seen from outside.
    pub corners: *const c_void,
    /// Number of corners: three per triangle, if there are no `ring_ends`.
    pub corner_count: usize,
    /// Bytes per index: 4 (uint32_t) or 8 (uint64_t).
    pub corner_size: usize,
    /// For polygons of any number of corners: the rings' ends in `corners`, ascending.
    pub ring_ends: *const u64,
    /// Number of rings; 0 if all faces are triangles.
    pub ring_count: usize,
    /// For faces with holes: the faces' ends in `ring_ends`, ascending. A face's first ring is the
    /// outer one; holes have the opposite direction.
    pub face_ends: *const u64,
    /// Number of faces in `face_ends`; 0 if each ring is a face.
    pub face_count: usize,
    /// Part index of each face, from 0; NULL if all faces belong to the first part.
    pub parts: *const u32,
    /// Names of the parts.
    pub part_names: *const *const c_char,
    /// Attributes of the parts: for each a JSON object such as {"attributes":{"height":5}}, or
    /// NULL. NULL if no part has attributes.
    pub part_attributes: *const *const c_char,
    /// Number of named parts.
    pub part_count: usize,
}

/// For `inside` of spinney_mesh_options: points with a nonzero winding number are inside, as in
/// trees of cells.
pub const SPINNEY_INSIDE_NONZERO: u32 = 0;

/// Points with a positive winding number are inside.
pub const SPINNEY_INSIDE_POSITIVE: u32 = 1;

/// Points with an odd winding number are inside.
pub const SPINNEY_INSIDE_ODD: u32 = 2;

/// Options for building an exact model. Zeros are the defaults, as in `spinney_mesh_options options
/// = {0};`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_mesh_options {
    /// Width of a grid unit: vertices are snapped to the grid. 0 for the smallest power of two that
    /// leaves about 2^24 units along the longest side.
    pub snap: f64,
    /// Bytes of memory in addition to a copy of the meshes; 0 for 256 MiB. Data that do not fit go
    /// to a temporary file next to the output.
    pub memory: u64,
    /// Inside rule of a repair: SPINNEY_INSIDE_NONZERO, SPINNEY_INSIDE_POSITIVE or
    /// SPINNEY_INSIDE_ODD.
    pub inside: u32,
    /// Whether to close open surfaces by triangles over their boundaries.
    pub close: bool,
    /// Whether to repair surfaces that intersect themselves, overlap themselves or are inside out.
    pub repair: bool,
    /// Unit of length, such as "mm"; NULL if unknown.
    pub unit: *const c_char,
    /// Definition of the coordinate reference system, such as "EPSG:25832"; NULL if unknown.
    pub crs: *const c_char,
}

/// Counts of an exact model that was built.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_mesh_report {
    /// Faces that were read, without those that have fewer than three different vertices.
    pub read: u64,
    /// Faces of the model.
    pub faces: u64,
    /// Faces that snapping collapsed to points or lines. They are not in the model.
    pub collapsed: u64,
    /// Faces without area on the grid. They stay in the model and bound no volume.
    pub slivers: u64,
    /// Faces that snapping made non-planar, cut into triangles.
    pub cut: u64,
    /// Faces that intersect themselves, cut into triangles.
    pub fanned: u64,
    /// Boundaries that were closed, and the triangles that close them.
    pub closed_boundaries: u64,
    pub closing_triangles: u64,
    /// Faces that a repair split or removed, those of them that bounded nothing, and bodies that it
    /// reversed.
    pub repaired_faces: u64,
    pub lost_faces: u64,
    pub turned_bodies: u64,
    /// Volumes of a repaired surface: before the repair, after it, and by the inside rule of cells.
    /// Zeros without repair.
    pub volume_before: f64,
    pub volume: f64,
    pub cells_volume: f64,
    /// Maximum distance by which a vertex was snapped.
    pub displacement: f64,
    /// Width of a grid unit.
    pub step: f64,
}

/// Builds the file of an exact model from `count` meshes, one or more, as `spinney build --brep`
/// does from files. Each mesh is an object, whose part or parts have names. `mesh_size` is
/// `sizeof(spinney_mesh)`. `options` may be NULL for the defaults, `report` may be NULL; otherwise
/// `options_size` is `sizeof(spinney_mesh_options)`, and `report_size`
/// `sizeof(spinney_mesh_report)`.
///
/// A surface that is open, intersects itself or is inside out bounds no body: SPINNEY_INVALID, with
/// up to 100 locations in spinney_error(). No file is left if the call fails. spinney_warnings()
/// reports whether a repair has changed the surface or its volume by more than a hundredth, and
/// similar remarks.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_model_build(
    meshes: *const spinney_mesh,
    count: usize,
    mesh_size: usize,
    options: *const spinney_mesh_options,
    options_size: usize,
    path: *const c_char,
    report: *mut spinney_mesh_report,
    report_size: usize,
) -> spinney_status {
    guarded(|| {
        let warnings = Warnings::begin();
        check_size("meshes", mesh_size, size_of::<spinney_mesh>())?;
        // SAFETY: the caller has `count` meshes there.
        let meshes = unsafe { items("meshes", meshes, count)? };
        // SAFETY: these are NULL, or the caller's structs, whose sizes are checked.
        let (options, report) = unsafe {
            if !options.is_null() {
                check_size("options", options_size, size_of::<spinney_mesh_options>())?;
            }
            if !report.is_null() {
                check_size("report", report_size, size_of::<spinney_mesh_report>())?;
            }
            (options.as_ref(), report.as_mut())
        };
        if path.is_null() {
            return Err(Failure::invalid("path: got NULL, expected a path"));
        }
        // SAFETY: the pointers in the options are valid or NULL.
        let options = unsafe { options.map_or_else(|| Ok(ExactOptions::new()), |options| options.exact())? };
        // SAFETY: the caller passes a zero-terminated string.
        let path = path_of(unsafe { CStr::from_ptr(path) })?;
        let models: Vec<Box<dyn Model>> = meshes
            .iter()
            // SAFETY: the caller's structs describe its arrays.
            .map(|mesh| Ok(unsafe { mesh.arrays()? }.model()?))
            .collect::<Result<_, Failure>>()?;
        let built = import_exact(models, &options, Output::create(&path)?, &warnings)?;
        if let Some(report) = report {
            *report = report_of(&built);
        }
        Ok(())
    })
}

impl spinney_mesh_options {
    /// Converts to the library's options.
    unsafe fn exact(&self) -> Result<ExactOptions, Failure> {
        let mut options = ExactOptions::new();
        options.snap = (self.snap != 0.0).then_some(self.snap);
        if self.memory != 0 {
            options.memory = self.memory;
        }
        options.inside = match self.inside {
            SPINNEY_INSIDE_NONZERO => InsideRule::Nonzero,
            SPINNEY_INSIDE_POSITIVE => InsideRule::Positive,
            SPINNEY_INSIDE_ODD => InsideRule::Odd,
            other => {
                return Err(Failure::invalid(format!(
                    "inside: got {other}, expected one of SPINNEY_INSIDE_*"
                )));
            }
        };
        (options.close, options.repair) = (self.close, self.repair);
        // SAFETY: these are NULL, or zero-terminated strings.
        let (unit, crs) = unsafe { (text("unit", self.unit)?, text("crs", self.crs)?) };
        options.unit = unit.map(String::from);
        options.crs = crs.map(Crs::parse).transpose()?;
        Ok(options)
    }
}

impl spinney_mesh {
    /// Copies the caller's arrays.
    unsafe fn arrays(&self) -> Result<MeshArrays, Failure> {
        let mut mesh = MeshArrays::default();
        // SAFETY: the caller's arrays have the stated lengths; NULL with a length above 0 is
        // detected.
        unsafe {
            mesh.name = text("name", self.name)?.unwrap_or("mesh").into();
            mesh.vertices = items("vertices", self.vertices.cast::<[f64; 3]>(), self.vertex_count)?.to_vec();
            mesh.corners = match self.corner_size {
                4 => items("corners", self.corners.cast::<u32>(), self.corner_count)?.to_vec(),
                8 => items("corners", self.corners.cast::<u64>(), self.corner_count)?
                    .iter()
                    // (The model checks all indices. It has fewer than 2^32 vertices, so that
                    // u32::MAX is out of range.)
                    .map(|corner| u32::try_from(*corner).unwrap_or(u32::MAX))
                    .collect(),
                other => return Err(Failure::invalid(format!("corner_size: got {other}, expected 4 or 8"))),
            };
            mesh.ring_ends = ends(items("ring_ends", self.ring_ends, self.ring_count)?);
            mesh.face_ends = ends(items("face_ends", self.face_ends, self.face_count)?);
            if !self.colours.is_null() {
                let colours = items("colours", self.colours.cast::<[u8; 3]>(), self.vertex_count)?;
                mesh.colours = MeshColours::OfVertices(colours.to_vec());
            }
            if !self.parts.is_null() {
                let faces = match (self.ring_count, self.face_count) {
                    (0, _) => self.corner_count / 3,
                    (rings, 0) => rings,
                    (_, faces) => faces,
                };
                mesh.face_parts = items("parts", self.parts, faces)?.to_vec();
            }
            for name in items("part_names", self.part_names, self.part_count)? {
                let name = text("part_names", *name)?;
                let name = name.ok_or_else(|| Failure::invalid("part_names: got NULL, expected a name"))?;
                mesh.parts.push(name.into());
            }
            if !self.part_attributes.is_null() {
                for json in items("part_attributes", self.part_attributes, self.part_count)? {
                    mesh.attributes.push(text("part_attributes", *json)?.map(String::from));
                }
            }
        }
        Ok(mesh)
    }
}

/// Converts ends to the library's type.
fn ends(ends: &[u64]) -> Vec<usize> {
    ends.iter().map(|end| usize::try_from(*end).unwrap_or(usize::MAX)).collect()
}

/// Returns a string of the caller, if there is one.
unsafe fn text<'a>(name: &str, text: *const c_char) -> Result<Option<&'a str>, Failure> {
    if text.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller passes a zero-terminated string.
    let text = unsafe { CStr::from_ptr(text) }.to_str();
    text.map(Some).map_err(|_| Failure::invalid(format!("{name}: got other bytes, expected UTF-8")))
}

fn report_of(built: &ExactReport) -> spinney_mesh_report {
    let repair = built.repair.as_ref();
    spinney_mesh_report {
        read: built.read,
        faces: built.faces,
        collapsed: built.collapsed,
        slivers: built.slivers,
        cut: built.cut,
        fanned: built.fanned,
        closed_boundaries: built.closed.0,
        closing_triangles: built.closed.1,
        repaired_faces: repair.map_or(0, |done| done.divided + done.removed),
        lost_faces: repair.map_or(0, |done| done.outside),
        turned_bodies: repair.map_or(0, |done| done.turned.0),
        volume_before: repair.map_or(0.0, |done| done.volume_before),
        volume: repair.map_or(0.0, |done| done.volume),
        cells_volume: repair.map_or(0.0, |done| done.cells_volume),
        displacement: built.displacement,
        step: built.grid.width(),
    }
}
