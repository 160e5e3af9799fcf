//! Meshes in memory, of which exact models are built.

use std::ffi::{CStr, c_char, c_void};

use engine::import::mesh::{ExactOptions, import_exact};
use engine::raw::brep::InsideRule;
use engine::raw::import::mesh::{ExactReport, MeshArrays, MeshColours, Model};
use engine::{Crs, Output};

use crate::dataset::path_of;
use crate::model::check_size;
use crate::questions::items;
use crate::status::{Failure, guarded, spinney_status};
use crate::warnings::Warnings;

/// A mesh in the caller's memory: vertices, and faces over them. Zeros and NULL are for what there is not, as in
/// `spinney_mesh mesh = {0};`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_mesh {
    /// Name, for errors, and of the only part of a mesh without `part_names`; NULL for "mesh".
    pub name: *const c_char,
    /// Coordinates of the vertices: x, y and z of each.
    pub vertices: *const f64,
    /// Number of vertices.
    pub vertex_count: usize,
    /// Colours: red, green and blue of each vertex; NULL for none.
    pub colours: *const u8,
    /// Corners of all faces, by the numbers of their vertices from 0: counterclockwise seen from outside.
    pub corners: *const c_void,
    /// Number of corners: three of each triangle, where there are no `ring_ends`.
    pub corner_count: usize,
    /// Bytes of each of these numbers: 4 (uint32_t) or 8 (uint64_t).
    pub corner_size: usize,
    /// Ends of the rings in `corners`, ascending, of faces that are polygons of any number of corners.
    pub ring_ends: *const u64,
    /// Number of rings; 0 where all faces are triangles.
    pub ring_count: usize,
    /// Ends of the faces among the rings, ascending, where faces have holes: the first ring of each is its outer one, its holes go the
    /// other way round.
    pub face_ends: *const u64,
    /// Number of faces that `face_ends` has; 0 where each ring is a face.
    pub face_count: usize,
    /// Number of the part of each face, from 0; NULL where all are of the first.
    pub parts: *const u32,
    /// Names of the parts.
    pub part_names: *const *const c_char,
    /// Attributes of the parts: of each a JSON object such as {"attributes":{"height":5}}, or NULL. NULL where no part has any.
    pub part_attributes: *const *const c_char,
    /// Number of parts that have names.
    pub part_count: usize,
}

/// For `inside` of spinney_mesh_options: inside are the places that a surface goes around, as cells have it.
pub const SPINNEY_INSIDE_NONZERO: u32 = 0;

/// Places that a surface goes around once or more.
pub const SPINNEY_INSIDE_POSITIVE: u32 = 1;

/// Places that a surface goes around an odd number of times.
pub const SPINNEY_INSIDE_ODD: u32 = 2;

/// Options for building an exact model. Zeros are for what is usual, as in `spinney_mesh_options options = {0};`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_mesh_options {
    /// Width of the grid's steps, to which corners are moved; 0 for the least power of two that leaves about 2^24 steps along the
    /// longest side.
    pub snap: f64,
    /// Bytes of memory beside a copy of the meshes; 0 for 256 MiB. What does not fit goes to a temporary file beside the output.
    pub memory: u64,
    /// The rule by which a repair tells what is inside: SPINNEY_INSIDE_NONZERO, SPINNEY_INSIDE_POSITIVE or SPINNEY_INSIDE_ODD.
    pub inside: u32,
    /// Whether open surfaces are closed by triangles over their boundaries.
    pub close: bool,
    /// Whether surfaces that pass through themselves, lie on themselves or are inside out are resolved.
    pub repair: bool,
    /// Unit of length, such as "mm"; NULL if it is not known.
    pub unit: *const c_char,
    /// Definition of the coordinate system, such as "EPSG:25832"; NULL if it is not known.
    pub crs: *const c_char,
}

/// Counts of an exact model that was built.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_mesh_report {
    /// Faces that were read, without those that have fewer than three different corners.
    pub read: u64,
    /// Faces of the model.
    pub faces: u64,
    /// Faces that are points or lines on the grid, and were left out.
    pub collapsed: u64,
    /// Faces without area on the grid, which stay and bound nothing.
    pub slivers: u64,
    /// Faces that the grid has bent, cut into triangles.
    pub cut: u64,
    /// Faces that cross themselves, cut into triangles.
    pub fanned: u64,
    /// Boundaries that were closed, and the triangles that close them.
    pub closed_boundaries: u64,
    pub closing_triangles: u64,
    /// Faces that a repair has divided or taken away, those of them that bounded nothing, and bodies that it has turned.
    pub repaired_faces: u64,
    pub lost_faces: u64,
    pub turned_bodies: u64,
    /// Volumes of a repaired surface: as it came, what is inside now, and what cells would have inside; zeros where nothing is repaired.
    pub volume_before: f64,
    pub volume: f64,
    pub cells_volume: f64,
    /// The farthest that a corner was moved to the grid.
    pub displacement: f64,
    /// Width of the grid's steps.
    pub step: f64,
}

/// Builds the file of an exact model of `count` meshes, one or more, as `spinney build --brep` does of files: each is an object, whose part
/// or parts have names. `mesh_size` is `sizeof(spinney_mesh)`. `options` may be NULL for what is usual, and `report` where nobody asks; else
/// `options_size` is `sizeof(spinney_mesh_options)`, and `report_size` `sizeof(spinney_mesh_report)`.
///
/// A surface that is open, passes through itself or is inside out bounds no body: SPINNEY_INVALID, with the places, up to 100 of them, in
/// spinney_error(). Where it fails there is no file. spinney_warnings() tells where a repair has changed the surface or its volume by more than a
/// hundredth, and the like.
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
        // SAFETY: the caller has so many there.
        let meshes = unsafe { items("meshes", meshes, count)? };
        // SAFETY: these are NULL, or structs of the caller's, of whose sizes it is sure.
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
            return Err(Failure::invalid("path: got NULL, expected one"));
        }
        // SAFETY: as these say.
        let options = unsafe { options.map_or_else(|| Ok(ExactOptions::new()), |options| options.exact())? };
        // SAFETY: the caller passes a zero-terminated text.
        let path = path_of(unsafe { CStr::from_ptr(path) })?;
        let models: Vec<Box<dyn Model>> = meshes
            .iter()
            // SAFETY: the caller has what its structs say.
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
    /// The library's options.
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
        // SAFETY: these are NULL, or zero-terminated texts.
        let (unit, crs) = unsafe { (text("unit", self.unit)?, text("crs", self.crs)?) };
        options.unit = unit.map(String::from);
        options.crs = crs.map(Crs::parse).transpose()?;
        Ok(options)
    }
}

impl spinney_mesh {
    /// A copy of the caller's arrays.
    unsafe fn arrays(&self) -> Result<MeshArrays, Failure> {
        let mut mesh = MeshArrays::default();
        // SAFETY: the caller has as much there as it says, or NULL and nothing, which is found.
        unsafe {
            mesh.name = text("name", self.name)?.unwrap_or("mesh").into();
            mesh.vertices = items("vertices", self.vertices.cast::<[f64; 3]>(), self.vertex_count)?.to_vec();
            mesh.corners = match self.corner_size {
                4 => items("corners", self.corners.cast::<u32>(), self.corner_count)?.to_vec(),
                8 => items("corners", self.corners.cast::<u64>(), self.corner_count)?
                    .iter()
                    // (Those that are out of range are found with the others, and there are fewer vertices than 2^32.)
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
                for told in items("part_attributes", self.part_attributes, self.part_count)? {
                    mesh.attributes.push(text("part_attributes", *told)?.map(String::from));
                }
            }
        }
        Ok(mesh)
    }
}

/// Ends as the library has them.
fn ends(ends: &[u64]) -> Vec<usize> {
    ends.iter().map(|end| usize::try_from(*end).unwrap_or(usize::MAX)).collect()
}

/// A text of the caller's, if it is there.
unsafe fn text<'a>(name: &str, text: *const c_char) -> Result<Option<&'a str>, Failure> {
    if text.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller passes a zero-terminated text.
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
