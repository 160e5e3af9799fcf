//! The tags that Spinney itself writes into metadata.

use super::metadata::Metadata;

/// A tag that Spinney writes. Whatever else [`Metadata::tags`] have came with the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tag {
    /// Unit of length of the world, where no coordinate system tells it.
    Unit,
    /// The role of each channel in a picture's colours, where it is not the usual one: see
    /// [`colour_roles`](Metadata::colour_roles).
    ColourRoles,
    /// By how much samples of cells may differ from what they were, since they were rounded.
    MaxError,
    /// The furthest that a corner of an exact model was moved, in its unit of length.
    ModelDisplacement,
    /// Faces of an exact model whose corners do not lie in one plane on the grid, which were cut into triangles.
    ModelCutFaces,
    /// Faces of an exact model that have no area on the grid.
    ModelSlivers,
    /// Triangles that close boundaries of an exact model.
    ModelClosingTriangles,
    /// Faces of an exact model that repairs divided or removed.
    ModelRepairedFaces,
    /// Places where an exact model's surface passes through itself, since its vertices were moved to the grid.
    ModelThinPlaces,
    /// The text of primitives and operations that a solid or an exact model was made of.
    Csg,
    /// The rule for cells on a solid's boundary.
    SolidBoundary,
    /// The test that decided what lies inside a solid.
    SolidSurface,
    /// Triangles of a solid's surface.
    SolidTriangles,
    /// The furthest that a vertex of a solid's surface was moved, in its unit of length.
    SolidDisplacement,
    /// Triangles of a solid's surface that were there more than once, for each time but the first.
    SolidDoubledTriangles,
    /// Faces of a solid's surface that crossed themselves, or lost their area on the grid.
    SolidRepairedFaces,
    /// Cells far from a solid's surface that lie in its holes, where the answer is a guess.
    SolidUndecidedCells,
}

impl Tag {
    /// The tag's key in files.
    pub fn key(self) -> &'static str {
        match self {
            Tag::Unit => "unit",
            Tag::ColourRoles => "colour_roles",
            Tag::MaxError => "max_error",
            Tag::ModelDisplacement => "model.displacement",
            Tag::ModelCutFaces => "model.cut_faces",
            Tag::ModelSlivers => "model.slivers",
            Tag::ModelClosingTriangles => "model.closing_triangles",
            Tag::ModelRepairedFaces => "model.repaired_faces",
            Tag::ModelThinPlaces => "model.thin_places",
            Tag::Csg => "csg",
            Tag::SolidBoundary => "solid.boundary",
            Tag::SolidSurface => "solid.surface",
            Tag::SolidTriangles => "solid.triangles",
            Tag::SolidDisplacement => "solid.displacement",
            Tag::SolidDoubledTriangles => "solid.doubled_triangles",
            Tag::SolidRepairedFaces => "solid.repaired_faces",
            Tag::SolidUndecidedCells => "solid.undecided_cells",
        }
    }
}

impl Metadata {
    /// The text of a tag; `None` if there is no such tag.
    pub fn tag(&self, tag: Tag) -> Option<&str> {
        self.tags.get(tag.key()).map(String::as_str)
    }

    /// Writes a tag, in place of what it said before.
    pub fn set_tag(&mut self, tag: Tag, text: impl Into<String>) {
        self.tags.insert(tag.key().into(), text.into());
    }

    /// Says that samples of cells differ by at most so much more from what they were.
    pub fn add_error(&mut self, most: f64) {
        let before = self.tag(Tag::MaxError).and_then(|text| text.parse().ok()).unwrap_or(0.0);
        self.set_tag(Tag::MaxError, (before + most).to_string());
    }
}
