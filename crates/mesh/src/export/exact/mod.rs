//! Exact models as meshes: polygons stay polygons, with their colours and parts as far as a format has room for them,
//! such that the readers of this library understand them again.
//!
//! Faces are read three times: for a survey, to number the vertices by an external sort, and to be written. For CityJSON they are read
//! twice more, to find the shells of solids. Memory does not grow with the model, except by four bytes for each face there: there are two sorts at a time, of 64 MiB each.

mod city_json;
mod city_objects;
mod numbering;
mod polygons;
mod semantics;
mod shells;
mod surfaces;
mod survey;
mod triangles;

use std::path::PathBuf;

use super::MeshFormat;
use super::losses::Losses;
use spinney_base::io::Output;
use spinney_base::{Progress, Result};
use spinney_brep::{AttributedFaceVisitor, Face, Faces};

/// Size of a written model, and what its format had no room for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ExactSummary {
    /// Vertices, each counted once; 0 for STL, whose triangles have corners of their own.
    pub vertices: u64,
    /// Faces; for STL, triangles.
    pub faces: u64,
    /// Holes that are joined to the ring around them by bridges.
    pub bridged_holes: u64,
    /// Whether there were colours that are not in the file.
    pub lost_colours: bool,
    /// Parts and files whose attributes are not in the file.
    pub lost_attributes: u64,
    /// Whether there were values of faces that are not in the file.
    pub lost_values: bool,
    /// Whether there were parts that the file does not tell apart.
    pub lost_parts: bool,
    /// STL: corners of triangles that single precision has moved.
    pub moved: u64,
    /// STL: the farthest that a corner was moved, in units of the world.
    pub farthest: f64,
    /// STL: triangles that are left out since two of their corners are the same in single precision. The others are
    /// as closed as before.
    pub collapsed: u64,
}

/// Writes an exact model as a mesh in the coordinates of its world.
///
/// | format | polygons | holes | coordinates | colours | parts |
/// | --- | --- | --- | --- | --- | --- |
/// | PLY | yes | bridges | double precision | of faces, or of vertices where corners of a face differ | no |
/// | OBJ | yes | bridges | the shortest decimals that are read as the same number | of vertices | objects |
/// | OFF | yes | bridges | as OBJ | as PLY | no |
/// | STL | triangles | | single precision; [`ExactSummary::moved`] tells how many corners that moves | no | no |
/// | CityJSON | yes | yes | whole numbers with a transform, from which a reader may get the last bit differently | no | objects |
///
/// What a format has no room for is told as a [warning](Progress::warn), too, with a name of a single part, the coordinate system and the unit of length.
///
/// Where holes are bridges, they and the outer ring are one ring, as
/// [`join_rings`](spinney_brep::geometry::join_rings) makes it; [`split_bridges`](spinney_brep::geometry::split_bridges) gives the
/// rings again. Vertices stand in the order of their coordinates, within cells of 32 x 32 x 32 steps of the grid.
///
/// Values of faces in the columns `type`, `surface`, `parent` and `attributes`, of those that have a type, are the semantics of a CityJSON file's
/// surfaces; other formats have none. Attributes of parts are written to CityJSON files alone. What is said of the file that the model was built from is, too, unless
/// there were several.
///
/// A part of a CityJSON file is a `Solid` if its faces are closed (every edge is passed as often in one
/// direction as in the other, which is determined from a sum of hashes), with a shell for its exterior and one for each cavity; a
/// `MultiSolid` if these are several bodies; else a `MultiSurface`. Its level of detail is that of the file that the model was built from, or 2.
/// Points of addresses are vertices, and extents of objects those of their faces. Coordinates are in the unit of the coordinate system, in metres without
/// one: models in other units of length are converted, those in degrees are refused. Names that come
/// twice get a number after them. In OBJ names, what would end the line or the name is replaced by `_`.
///
/// ```
/// use spinney::brep::{Face, Grid};
/// use spinney::raw::brep::FaceList;
/// use spinney::export::{MeshFormat, export_exact};
/// use spinney::Output;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("triangle.ply");
/// let mut faces = FaceList::new(Grid::over([[0.0; 3], [1.0; 3]], Some(0.001))?, vec!["roof".into()]);
/// let points = [[0, 0, 0], [1000, 0, 0], [0, 1000, 0]];
/// faces.push(&Face { number: 0, points: &points, ring_ends: &[3], colours: &[], part: 0, source: 0 });
/// let summary = export_exact(&faces, MeshFormat::Ply, Output::create(&path)?, &())?;
/// assert_eq!((summary.vertices, summary.faces), (3, 1));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the format cannot hold so many faces or vertices; if faces cannot be read or the output not be written; or on
/// interruption.
pub fn export_exact(
    faces: &dyn Faces,
    format: MeshFormat,
    output: Output,
    progress: &dyn Progress,
) -> Result<ExactSummary> {
    let passes = match format {
        MeshFormat::Stl => 1,
        MeshFormat::CityJson => 5,
        _ => 3,
    };
    let job = Job { faces, progress, passes };
    let mut losses = Losses::of(&output);
    let mut summary = match format {
        MeshFormat::CityJson => city_json::write(&job, output)?,
        MeshFormat::Stl => triangles::write(&job, output)?,
        MeshFormat::Ply | MeshFormat::Obj | MeshFormat::Off => polygons::write(&job, format, output)?,
    };
    let (is_city, crs) = (format == MeshFormat::CityJson, faces.crs());
    if !is_city {
        summary.lost_attributes = faces.parts_with_attributes()? + faces.file_attributes()?.len() as u64;
        summary.lost_values = !faces.value_columns()?.is_empty();
    }
    losses.add(summary.lost_colours, "colours");
    losses.add(summary.lost_parts, "parts");
    let has_names = is_city || format == MeshFormat::Obj;
    losses.add(!has_names && !summary.lost_parts && job.names_something(), "the part's name");
    let lost = summary.lost_attributes;
    losses.add(lost > 0, format!("what is said of {lost} parts and files, beyond their names"));
    let holes = summary.bridged_holes;
    losses.add(holes > 0, format!("holes ({holes} are joined to the rings around them)"));
    losses.add(summary.lost_values, "values of faces");
    losses.add_crs(crs.filter(|crs| !(is_city && city_json::reference_system(crs).is_some())));
    losses.add_unit(faces.unit(), faces.unit().filter(|unit| is_city && city_json::metres(unit).is_some()));
    losses.tell(progress);
    Ok(summary)
}

/// Faces that are gone through several times, with progress.
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
        /// Faces between two looks at whether to go on.
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

    /// Whether a part has a name that readers do not give by themselves.
    fn names_something(&self) -> bool {
        self.faces.parts().iter().any(|name| name != "mesh")
    }

    /// Whether there is more than one part.
    fn has_parts(&self) -> bool {
        self.faces.parts().len() > 1
    }
}

/// Corners of a face as the geometry takes them.
fn wide(points: &[[i32; 3]], out: &mut Vec<[i64; 3]>) {
    out.clear();
    out.extend(points.iter().map(|point| point.map(i64::from)));
}

/// The folder for temporary files: the output's if it has one, since that is where there must be room.
fn temporary_folder(output: &Output) -> PathBuf {
    if output.is_file() {
        spinney_base::io::folder(output.path()).to_path_buf()
    } else {
        std::env::temp_dir()
    }
}
