//! Interface of the readers of mesh formats: a stream of faces that can be read any number of times.

use std::path::PathBuf;

use spinney_base::Result;
use spinney_brep::Attributes;
use spinney_crs::Crs;

/// A planar face with its holes, as a reader hands it out.
#[derive(Clone, Copy, Debug)]
pub struct MeshFace<'a> {
    /// Corners of all rings in the file's own coordinates, the outer ring's first; a ring does not repeat its
    /// first corner at its end. Counterclockwise seen from outside the solid, holes the other way round.
    pub points: &'a [[f64; 3]],
    /// End of each ring in `points`; one entry for a face without holes.
    pub ring_ends: &'a [usize],
    /// A colour per corner, red, green, blue; nothing where the file has none. In a file where only some
    /// faces have one, the others are white.
    pub colours: &'a [[u8; 3]],
    /// Number of the part that the face belongs to: see [`ModelInfo::parts`].
    pub part: u32,
    /// Values of the face: names of columns, each once, and JSON texts.
    pub values: &'a [(&'a str, &'a str)],
}

/// Properties of a model that are known before its faces are read.
#[derive(Clone, Debug)]
pub struct ModelInfo {
    /// The file.
    pub path: PathBuf,
    /// Its format in words: "PLY, binary little-endian".
    pub format: String,
    /// Faces, where the file tells before they are read: with those that cover nothing, which are not handed
    /// out.
    pub faces: Option<u64>,
    /// Least and greatest coordinate of all vertices along each axis, of those that no face uses, too: such as
    /// the file has them, and not what cells are laid over.
    pub bounds: [[f64; 3]; 2],
    /// The coordinate system, where known.
    pub crs: Option<Crs>,
    /// Name of the unit of length, where the file tells: "mm".
    pub unit: Option<String>,
    /// Width of the grid that the file's coordinates are whole multiples of, but for a shift, where it tells.
    pub step: Option<f64>,
    /// Names of the parts: objects, groups, materials. A face's part is an index into this list; never empty.
    pub parts: Vec<String>,
    /// Whether the parts are groups of faces of one object, and not objects by themselves.
    pub is_grouped: bool,
    /// Attributes of the parts, by their numbers.
    pub attributes: Attributes,
    /// Whether faces come with colours.
    pub is_coloured: bool,
    /// Bytes of the file.
    pub bytes: u64,
}

/// A boundary representation in a file.
pub trait Model: Send {
    /// Properties of the model.
    fn info(&self) -> &ModelInfo;

    /// Reads all faces, in the file's order, and hands them out one by one; may be called again, and gives
    /// the same faces then.
    ///
    /// Faces with fewer than three different corners cover nothing and are left out; so are corners that
    /// repeat the one before them.
    ///
    /// # Errors
    /// If the file cannot be read or breaks its format's rules (indices out of range, coordinates that are
    /// not finite numbers, faces of more than 2^20 corners), or what `each` returns.
    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()>;

    /// Number of faces that were left out when all of them were read last, because they have fewer than three
    /// different corners; 0 before that.
    fn degenerate(&self) -> u64 {
        0
    }

    /// Remarks on what of the file is not read, for warnings.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }

    /// Number of values of faces that were not handed out when all of them were read last, because they make no sense or are too long; 0 before
    /// that.
    fn lost_values(&self) -> u64 {
        0
    }
}

/// Names of the parts of some models, those of one behind those of the one before, and what is said of each.
pub fn parts_of(models: &[Box<dyn Model>]) -> (Vec<String>, Vec<Option<String>>) {
    let infos = models.iter().map(|model| model.info());
    let parts = infos.flat_map(|info| (0..).zip(&info.parts).map(move |(part, name)| (info, part, name)));
    parts.map(|(info, part, name)| (name.clone(), info.attributes.part(part).map(String::from))).unzip()
}
