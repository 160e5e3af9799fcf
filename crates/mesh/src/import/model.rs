//! Interface of the mesh readers: a stream of faces that can be read any number of times.

use std::path::PathBuf;

use spinney_base::Result;
use spinney_base::space::Up;
use spinney_brep::Attributes;
use spinney_crs::Crs;

/// Planar face with its holes, as returned by a reader.
#[derive(Clone, Copy, Debug)]
pub struct MeshFace<'a> {
    /// Vertices of all rings in the file's coordinates, the outer ring first. A ring does not
    /// repeat its first vertex at its end. The outer ring is counterclockwise seen from outside the
    /// solid, holes are clockwise.
    pub points: &'a [[f64; 3]],
    /// End of each ring in `points`; one entry for a face without holes.
    pub ring_ends: &'a [usize],
    /// Colour per corner: red, green, blue; empty if the file has no colours. If only some faces of
    /// a file have colours, the others are white.
    pub colours: &'a [[u8; 3]],
    /// Number of the part that the face belongs to: see [`ModelInfo::parts`].
    pub part: u32,
    /// Values of the face: column names, each at most once, and JSON values.
    pub values: &'a [(&'a str, &'a str)],
}

/// Properties of a model that are known before its faces are read.
#[derive(Clone, Debug)]
pub struct ModelInfo {
    /// Path of the file.
    pub path: PathBuf,
    /// Description of the format: "PLY, binary little-endian".
    pub format: String,
    /// Number of faces, if known before they are read. Includes degenerate faces, which are not
    /// visited.
    pub faces: Option<u64>,
    /// Minimum and maximum coordinates of all vertices, including those that no face uses. These
    /// are in the file's coordinates, and not the bounds over which cells are laid.
    pub bounds: [[f64; 3]; 2],
    /// Coordinate system, if known.
    pub crs: Option<Crs>,
    /// Unit of length, if the file declares it: "mm".
    pub unit: Option<String>,
    /// Grid unit of the file's coordinates: all are integer multiples of it plus an offset. `None`
    /// if the file does not declare it.
    pub step: Option<f64>,
    /// Names of the parts: objects, groups, materials. A face's part is an index into this list,
    /// which is never empty.
    pub parts: Vec<String>,
    /// Whether the parts are groups of faces of one object, rather than separate objects.
    pub is_grouped: bool,
    /// Whether coordinates have z up because the format defines which axis points up. Options for
    /// the axis then have no effect.
    pub is_z_up: bool,
    /// Attributes of the parts, by part number.
    pub attributes: Attributes,
    /// Whether faces have colours.
    pub is_coloured: bool,
    /// File size in bytes.
    pub bytes: u64,
}

impl ModelInfo {
    /// Axis of the coordinates that points up, if options say `up`.
    pub(in crate::import) fn up(&self, up: Up) -> Up {
        if self.is_z_up { Up::Z } else { up }
    }
}

/// Boundary representation in a file.
pub trait Model: Send {
    /// Returns the properties of the model.
    fn info(&self) -> &ModelInfo;

    /// Reads all faces in file order and passes each to the callback. May be called again, and then
    /// visits the same faces.
    ///
    /// Degenerate faces with fewer than three distinct vertices are left out. So are corners that
    /// repeat the previous one.
    ///
    /// # Errors
    /// If the file cannot be read or is invalid (indices out of range, coordinates that are not
    /// finite, faces of more than 2^20 corners), or any error that `each` returns.
    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()>;

    /// Number of faces that the last complete reading left out because they have fewer than three
    /// distinct vertices; 0 before that.
    fn degenerate(&self) -> u64 {
        0
    }

    /// Remarks on file content that is not read, for warnings.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }

    /// Number of face values that the last complete reading dropped because they are invalid or too
    /// long; 0 before that.
    fn lost_values(&self) -> u64 {
        0
    }
}

/// Names and attributes of the parts of several models, numbered consecutively over the models.
pub fn parts_of(models: &[Box<dyn Model>]) -> (Vec<String>, Vec<Option<String>>) {
    let infos = models.iter().map(|model| model.info());
    let parts = infos.flat_map(|info| (0..).zip(&info.parts).map(move |(part, name)| (info, part, name)));
    parts.map(|(info, part, name)| (name.clone(), info.attributes.part(part).map(String::from))).unzip()
}
