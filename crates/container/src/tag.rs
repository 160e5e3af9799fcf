//! Metadata tags that Spinney itself writes.

use super::metadata::Metadata;

/// A tag that Spinney writes. All other [`Metadata::tags`] come from the input data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tag {
    /// Unit of length of world coordinates, if no coordinate reference system defines it.
    Unit,
    /// Colour role of each channel, unless the roles are the usual ones: see
    /// [`colour_roles`](Metadata::colour_roles).
    ColourRoles,
    /// Maximum error of cell samples due to rounding.
    MaxError,
    /// Maximum distance by which a vertex of an exact model was moved, in its unit of length.
    ModelDisplacement,
    /// Number of faces of an exact model that are not planar on the grid and were cut into
    /// triangles.
    ModelCutFaces,
    /// Number of faces of an exact model without area on the grid.
    ModelSlivers,
    /// Number of triangles that close boundaries of an exact model.
    ModelClosingTriangles,
    /// Number of faces of an exact model that repairs divided or removed.
    ModelRepairedFaces,
    /// Number of locations where an exact model's surface intersects itself because its vertices
    /// were moved to the grid.
    ModelIntersections,
    /// Source text of the primitives and operations that define a solid or an exact model.
    Csg,
    /// Rule for cells on a solid's boundary.
    SolidBoundary,
    /// Test that decided what lies inside a solid.
    SolidSurface,
    /// Number of triangles of a solid's surface.
    SolidTriangles,
    /// Maximum distance by which a vertex of a solid's surface was moved, in its unit of length.
    SolidDisplacement,
    /// Number of duplicate triangles of a solid's surface, not counting the first of each.
    SolidDoubledTriangles,
    /// Number of faces of a solid's surface that intersected themselves or lost their area on the
    /// grid.
    SolidRepairedFaces,
    /// Number of cells far from a solid's surface whose state is a guess, because they lie in its
    /// holes.
    SolidUndecidedCells,
}

impl Tag {
    /// Key of the tag in files.
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
            Tag::ModelIntersections => "model.thin_places",
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
    /// Value of a tag; `None` if there is no such tag.
    pub fn tag(&self, tag: Tag) -> Option<&str> {
        self.tags.get(tag.key()).map(String::as_str)
    }

    /// Sets a tag and replaces its previous value.
    pub fn set_tag(&mut self, tag: Tag, text: impl Into<String>) {
        self.tags.insert(tag.key().into(), text.into());
    }

    /// Adds `most` to the recorded maximum error of cell samples.
    pub fn add_error(&mut self, most: f64) {
        let before = self.tag(Tag::MaxError).and_then(|text| text.parse().ok()).unwrap_or(0.0);
        self.set_tag(Tag::MaxError, (before + most).to_string());
    }
}
