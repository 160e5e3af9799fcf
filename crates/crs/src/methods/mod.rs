//! Projection methods and their parameters under the names of all formats: PROJ's words, the EPSG
//! registry (WKT 2), WKT 1 of GDAL and of Esri, and the numbers of GeoTIFF keys.
//!
//! `benches/peers/projections.py --definitions` compared the results with PROJ. Methods and
//! parameters that are not in the table are rejected.

mod read;
mod table;
mod write;

pub(crate) use read::{coded, find, key};
pub(crate) use write::{find_words, pole, words_of};

/// Co-latitude of the axis of Krovak's cone in degrees, 30° 17' 17.30311", the only one that the
/// method has.
pub(crate) const KROVAK_COLATITUDE: f64 = 30.288_139_752_777_8;

/// Parameters with their values: PROJ's words, and numbers in degrees, metres or ones.
pub(crate) type Values = Vec<(&'static str, f64)>;

/// Kind of quantity of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Measure {
    Angle,
    Length,
    Scale,
}

/// A projection method. It is read under all of its names, and written under the name that each
/// format has for it.
#[derive(Debug)]
pub(crate) struct Method {
    /// PROJ's words. If several methods have the same words, an additional word distinguishes them.
    words: &'static str,
    /// Normalized names in definitions; empty if another method is read in its place.
    names: &'static [&'static str],
    form: WordMapping,
    roles: &'static [&'static [Role]],
    /// Name in WKT 2.
    pub(crate) name: &'static str,
    pub(crate) number: u16,
    parameters: &'static [ParameterName],
    /// Esri's name; empty if there is none.
    esri: &'static str,
    esri_parameters: &'static [EsriName],
    /// Number in GeoTIFF keys, or 0.
    pub(crate) key: u16,
    keys: &'static [ParameterKey],
}

/// A parameter of a method in definitions: PROJ's word for it, and its names.
#[derive(Debug)]
pub(crate) struct Role {
    pub(crate) word: &'static str,
    pub(crate) measure: Measure,
    need: Need,
    names: &'static [&'static str],
}

/// Whether a method needs a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Need {
    Required,
    /// Optional, with a default.
    Or(f64),
    /// Optional, without a default.
    Free,
    /// Must be absent, or have this value, which has no effect.
    Only(f64),
}

/// Conversion of a method to PROJ's words.
#[derive(Clone, Copy, Debug, PartialEq)]
enum WordMapping {
    /// Unchanged.
    Plain,
    /// The method with axes to the west and south.
    South,
    /// Lambert's conic with one standard parallel, at the origin.
    OneParallel,
    /// One or two standard parallels, for which Esri has a common name.
    OneOrTwoParallels,
    /// The latitude determines the pole, or the sign of the parallel of true scale.
    Polar,
    /// The method's name determines the pole; the number is its latitude.
    Pole(f64),
    /// Oblique Mercator whose false origin is where the initial line crosses the equator of the
    /// aposphere.
    ObliqueOrigin,
    /// Oblique Mercator whose false origin is the projection centre.
    ObliqueCentre,
    /// Krovak's conic: south and west as originally defined, or east and north, depending on Esri's
    /// axis factors and rotation.
    Krovak,
}

/// PROJ's word for a parameter, or a constant value; its name in WKT 2; and its EPSG code, or 0.
type ParameterName = (&'static str, &'static str, u16);
/// PROJ's word or a constant value, and Esri's name.
type EsriName = (&'static str, &'static str);
/// PROJ's word, and the number of a GeoTIFF key.
type ParameterKey = (&'static str, u16);

impl Method {
    /// Returns PROJ's word for the method.
    fn word(&self) -> &'static str {
        self.words.split(' ').next().unwrap_or_default()
    }
}

/// Returns the directions of the axes according to PROJ's words for a method. `None` if they are
/// east and north, or along meridians.
pub(crate) fn axes_of_words(words: &str) -> Option<[&'static str; 2]> {
    let known = [("+axis=wsu", ["west", "south"]), ("+axis=swu", ["south", "west"])];
    known.into_iter().find(|(word, _)| words.contains(word)).map(|(_, axes)| axes)
}
