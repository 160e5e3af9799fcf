//! Export of exact models as meshes. Polygons stay polygons where readers of the format agree on
//! what they cover. Colours and parts are kept as far as the format can store them, in a form that
//! this library's readers read back.
//!
//! Faces are read four times: to count the triangles, for a survey, to number the vertices with an
//! external sort, and to write them. CityJSON needs one more pass, to find the shells of solids.
//! Memory does not grow with the model, except for four bytes per face for CityJSON. At most two
//! sorts of 64 MiB each run at a time.

mod city_json;
mod city_objects;
mod face_columns;
mod material_library;
mod numbering;
mod polygons;
mod semantics;
mod shells;
mod surfaces;
mod survey;
mod triangles;

use self::face_columns::FaceColumns;
use super::MeshFormat;
use super::losses::Losses;
use super::units::length;
use spinney_base::io::Output;
use spinney_base::{Progress, Result};
use spinney_brep::{AttributedFaceVisitor, Face, Faces, Triangulated};

/// Size of a written model, and what its format could not store.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ExactSummary {
    /// Vertices, each counted once; 0 for STL, whose triangles do not share vertices.
    pub vertices: u64,
    /// Faces; triangles for STL.
    pub faces: u64,
    /// Whether colours were lost.
    pub lost_colours: bool,
    /// Number of parts and files whose attributes were lost.
    pub lost_attributes: u64,
    /// Whether values of faces were lost.
    pub lost_values: bool,
    /// OBJ: whether colours are those of materials, in a library next to the file.
    pub has_library: bool,
    /// Whether there were several parts that the file does not distinguish.
    pub lost_parts: bool,
    /// STL: triangle vertices that rounding to single precision moved.
    pub moved: u64,
    /// STL: maximum distance that a vertex was moved, in world units.
    pub farthest: f64,
    /// STL: triangles left out because two of their vertices are equal in single precision. The
    /// other triangles are as closed as before.
    pub collapsed: u64,
    /// STL: triangles that rounding to single precision reversed. They are thinner than the
    /// precision, and lie on their neighbours.
    pub reversed: u64,
}

/// Writes an exact model as a mesh in world coordinates.
///
/// | format | polygons | holes | coordinates | colours | parts | values of faces |
/// | --- | --- | --- | --- | --- | --- | --- |
/// | PLY | triangles | | double precision | of faces; of vertices if a face has several | no | numbers |
/// | OBJ | if convex | | shortest round-trip decimals | of vertices or materials | objects | `material` |
/// | OFF | if convex | | as OBJ | as PLY | no | no |
/// | STL | triangles | | single precision; see [`ExactSummary::moved`] | no | no | no |
/// | CityJSON | yes | yes | integers with a transform | no | objects | semantics |
///
/// A reader of CityJSON may compute coordinates that differ in the last bit.
///
/// Whatever the format cannot store is also reported as a [warning](Progress::warn). The warning
/// includes the name of a single part, the coordinate system and the unit of length.
///
/// Faces that are not convex, or have holes, are triangulated in OBJ and OFF: many readers divide
/// polygons into fans, which would cover other areas. Some readers of PLY need faces of equal
/// length, so all faces are triangulated there. Triangles have no new vertices; see
/// [`Triangulated`]. Those of STL are computed from coordinates in single precision. Vertices are
/// sorted by their coordinates within blocks of at most 32 x 32 x 32 grid units.
///
/// Face values in the columns `type`, `surface`, `parent` and `attributes` become surface semantics
/// of CityJSON if the face has a type. Columns of numbers become properties of PLY faces: `int` if
/// all faces have integers of 32 bits, or else `double`, where NaN marks faces without a number.
/// The column `material` becomes the materials of OBJ. If each material has one colour, the colours
/// are in a library next to the OBJ file, with the extension `.mtl`. Only CityJSON stores
/// attributes of parts. It also stores the attributes of the source file if the model was built
/// from a single file.
///
/// A part becomes a CityJSON `Solid` if its faces are closed, with one shell for its exterior and
/// one for each cavity. It becomes a `MultiSolid` if it has several bodies, and a `MultiSurface` if
/// its faces are not closed. They are closed if every edge occurs equally often in both directions;
/// a sum of hashes determines this. The level of detail is that of the source file, by default 2.
/// Address points are vertices. Extents of objects are those of their faces. Coordinates are in the
/// unit of the coordinate system, or in metres if there is none. Models in other units of length
/// are converted. Models in degrees are rejected. Repeated names get a number as a suffix. In OBJ
/// names, `_` replaces characters that would end the line or the name.
///
/// ```
/// use spinney::brep::{Face, Grid};
/// use spinney::raw::brep::FaceList;
/// use spinney::export::{MeshFormat, export_exact};
/// use spinney::Output;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("triangle.ply");
/// let mut faces = FaceList::new(Grid::over([[0.0; 3], [1.0; 3]], Some(0.001))?, vec!["roof".into()]);
/// let points = [[0, 0, 0], [1000, 0, 0], [0, 1000, 0]];
/// faces.push(&Face { number: 0, points: &points, ring_ends: &[3], colours: &[], part: 0, source: 0 });
/// let summary = export_exact(&faces, MeshFormat::Ply, Output::create(&path)?, &())?;
/// assert_eq!((summary.vertices, summary.faces), (3, 1));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the format cannot hold so many faces or vertices; for STL, if single precision has less than
/// 4096 coordinates along the model, which is far from the origin then; if faces cannot be read; if
/// the output cannot be written; or on cancellation.
pub fn export_exact(
    faces: &dyn Faces,
    format: MeshFormat,
    output: Output,
    progress: &dyn Progress,
) -> Result<ExactSummary> {
    let passes = match format {
        MeshFormat::Stl => 2,
        MeshFormat::CityJson => 5,
        // (Materials and numbers take another pass.)
        MeshFormat::Ply | MeshFormat::Obj => 3 + u64::from(!faces.value_columns()?.is_empty()),
        MeshFormat::Off => 3,
    };
    let divided = match format {
        MeshFormat::Ply => Some(Triangulated::of(faces)?),
        MeshFormat::Obj | MeshFormat::Off => Some(Triangulated::of_concave(faces)?),
        // (STL has triangles of its own.)
        MeshFormat::Stl | MeshFormat::CityJson => None,
    };
    let faces = divided.as_ref().map_or(faces, |divided| divided);
    let job = Job { faces, progress, passes };
    let mut losses = Losses::of(&output);
    let columns = match format {
        MeshFormat::CityJson => city_json::other_columns(faces)?,
        _ => FaceColumns::of(&job, format)?,
    };
    let mut summary = match format {
        MeshFormat::CityJson => city_json::write(&job, output)?,
        MeshFormat::Stl => triangles::write(&job, output)?,
        MeshFormat::Ply | MeshFormat::Obj | MeshFormat::Off => {
            polygons::write(&job, format, &columns, output)?
        }
    };
    let (is_city, crs) = (format == MeshFormat::CityJson, faces.crs());
    if !is_city {
        summary.lost_attributes = faces.parts_with_attributes()? + faces.file_attributes()?.len() as u64;
        summary.lost_values = !columns.lost.is_empty();
    }
    losses.add(summary.lost_colours, "colours");
    losses.add(summary.lost_parts, "parts");
    let has_names = is_city || format == MeshFormat::Obj;
    losses.add(!has_names && !summary.lost_parts && job.names_something(), "the name of the part");
    let lost = summary.lost_attributes;
    losses.add(lost > 0, format!("the attributes of {lost} parts and files"));
    losses.add(summary.lost_values, lost_values(&columns.lost));
    let characters = "control characters, outer blanks and final backslashes of material names";
    losses.add(columns.has_changed_names, characters);
    losses.add_crs(crs.filter(|crs| !(is_city && city_json::reference_system(crs).is_some())));
    losses.add_unit(faces.unit(), faces.unit().filter(|unit| is_city && length(Some(unit)).is_some()));
    losses.report(progress);
    Ok(summary)
}

/// Describes values of faces in columns.
fn lost_values(columns: &[String]) -> String {
    /// Maximum number of listed names.
    const MAX_NAMES: usize = 8;
    let names: Vec<&str> = columns.iter().take(MAX_NAMES).map(String::as_str).collect();
    let more = if columns.len() > names.len() { ", ..." } else { "" };
    match names[..] {
        [] => "values of faces".into(),
        _ => format!("values of faces ({}{more})", names.join(", ")),
    }
}

/// Faces that are traversed several times, with progress.
struct Job<'a> {
    faces: &'a dyn Faces,
    progress: &'a dyn Progress,
    passes: u64,
}

impl Job<'_> {
    /// Reads all faces once.
    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        self.each_with_values(&[], &mut |face, _| each(face))
    }

    /// Reads all faces once, with their values in some columns.
    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        /// Faces between two checks for cancellation.
        const OFTEN: u64 = 1024;
        let total = self.faces.len() * self.passes;
        let mut count = 0u64;
        self.faces.each_with_values(columns, &mut |face, values| {
            count += 1;
            if count.is_multiple_of(OFTEN) {
                self.progress.check()?;
                self.progress.advance(OFTEN, total);
            }
            each(face, values)
        })?;
        self.progress.check()?;
        self.progress.advance(count % OFTEN, total);
        Ok(())
    }

    /// Whether a part has a name other than the readers' default.
    fn names_something(&self) -> bool {
        self.faces.parts().iter().any(|name| name != "mesh")
    }

    /// Whether there is more than one part.
    fn has_parts(&self) -> bool {
        self.faces.parts().len() > 1
    }
}

/// Widens points to the coordinate type of the geometry functions.
fn wide(points: &[[i32; 3]], out: &mut Vec<[i64; 3]>) {
    out.clear();
    out.extend(points.iter().map(|point| point.map(i64::from)));
}
