//! Surfaces that are arranged together, and the rules by which their regions stay.

use super::owner::OwnerRule;
use super::sample::SamplePoint;
use spinney_base::Result;

/// Surfaces, in one list of faces, and the rule which points are inside the result.
#[derive(Clone, Copy)]
pub(crate) struct Operands<'a> {
    /// End index of each surface's faces in the list.
    pub(crate) ends: &'a [u32],
    /// Winding number of each surface at infinity: 0, or 1 if the surface bounds its exterior.
    pub(crate) far: &'a [i32],
    /// Whether each surface bounds a body: its winding numbers are 0 or 1, and its faces do not
    /// intersect each other.
    pub(crate) are_bodies: bool,
    /// Whether components that are inside out are reversed first, with all components inside of
    /// them.
    pub(crate) turns_roots: bool,
    /// Whether equal faces are arranged as one that counts several times: see [`Copies`]. For a
    /// single surface that is no body. (Equal faces of different surfaces change different winding
    /// numbers.)
    ///
    /// [`Copies`]: super::copies::Copies
    pub(crate) unites_equal_faces: bool,
    /// Maximum count of contacts, beyond which the work is refused; 0 for no limit.
    pub(crate) most_contacts: u64,
    /// Whether the lines at which a face is cut stay edges: adjacent regions that stay are not
    /// merged.
    pub(crate) keeps_cuts: bool,
    /// Whether the fate of each face is decided by itself. Otherwise faces without contacts share
    /// their fate across edges that two faces of the list have. In a list that is a part of one
    /// surface, these may be edges of more than two faces, whose fates differ.
    pub(crate) decides_each: bool,
    /// If not empty: which faces may intersect others. Pairs without such a face are not tested.
    pub(crate) changed: &'a [bool],
    /// Returns the winding number of a body just above a sample, where faces that contain the
    /// sample do not count; `None` if it must be counted along a ray through the list.
    pub(crate) winding: &'a (dyn Fn(usize, &SamplePoint<'_>) -> Option<Result<i32>> + Sync),
    /// The rule to which part a region of a face belongs; `None` if regions keep their parts.
    pub(crate) owners: Option<&'a OwnerRule<'a>>,
    /// If the list is only a part of one surface: the change of the winding number above a sample
    /// by the other faces. These should touch no face of the list, except for neighbours.
    pub(crate) rest: Option<&'a OtherFaces<'a>>,
    /// Whether points with these winding numbers, one per surface, are inside.
    pub(crate) is_inside: &'a (dyn Fn(&[i32]) -> bool + Sync),
}

impl Operands<'static> {
    /// No surfaces, with nothing inside: the rules of the simplest case, to start from.
    pub(crate) const NONE: Operands<'static> = Operands {
        ends: &[],
        far: &[],
        are_bodies: false,
        turns_roots: false,
        unites_equal_faces: false,
        most_contacts: 0,
        keeps_cuts: false,
        decides_each: false,
        changed: &[],
        winding: &|_, _| None,
        owners: None,
        rest: None,
        is_inside: &|_| false,
    };
}

/// Returns the change of a surface's winding number above a sample by faces that are in no list.
pub(crate) type OtherFaces<'a> = dyn Fn(&SamplePoint<'_>) -> Result<i32> + Sync + 'a;
