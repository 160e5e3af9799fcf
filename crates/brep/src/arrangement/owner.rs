//! Parts of the faces of a result, where they are not those of the faces that they come from.

use super::sample::SamplePoint;
use spinney_base::Result;

/// A face that contains a sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FaceAtSample {
    /// Number of the face in the list.
    pub(crate) face: u32,
    /// Number of its operand.
    pub(crate) operand: usize,
    pub(crate) part: u32,
    /// Whether the face is oriented upwards, along the sample's axis.
    pub(crate) is_up: bool,
}

/// The part of a region of a face.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FaceOwner {
    /// The part of a region that bounds the result, if it is not the part of the face.
    pub(crate) part: Option<u32>,
    /// If the result is on both sides, but in different objects: the faces that stay as a wall, and
    /// whether these are reversed.
    pub(crate) wall: Option<([u32; 2], bool)>,
}

/// Returns the part of a region, from a sample, the winding numbers of all operands above and below
/// it, and all faces that contain it.
pub(crate) type OwnerRule<'a> =
    dyn Fn(&SamplePoint<'_>, [&[i32]; 2], &[FaceAtSample]) -> Result<FaceOwner> + Sync + 'a;
