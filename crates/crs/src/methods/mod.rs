//! Projection methods and their parameters under all of their names: PROJ's words, those of the EPSG registry (WKT 2), of WKT 1 by GDAL
//! and by Esri, and the numbers of GeoTIFF's keys.
//!
//! What definitions have was compared with PROJ by `benches/peers/projections.py --definitions`; what is not in the table is refused.

mod read;
mod table;
mod write;

pub(crate) use read::{coded, find, key};
pub(crate) use write::{find_words, pole, words_of};

/// Co-latitude of the axis of Krovak's cone in degrees, 30 degrees 17' 17.30311": the method has no other one.
pub(crate) const KROVAK_COLATITUDE: f64 = 30.288_139_752_777_8;

/// Parameters with their values: PROJ's words, and degrees, metres or ones.
pub(crate) type Values = Vec<(&'static str, f64)>;

/// Kind of measure of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Measure {
    Angle,
    Length,
    Scale,
}

/// A method. It is read under its names, and written under those that a format has for it.
#[derive(Debug)]
pub(crate) struct Method {
    /// PROJ's words; where several methods have the same, a word more tells them apart.
    words: &'static str,
    /// Names in definitions; none where another method is read in its place.
    names: &'static [&'static str],
    form: TreeType,
    roles: &'static [&'static [Role]],
    /// Name in WKT 2, and number in the EPSG registry, or 0.
    pub(crate) name: &'static str,
    pub(crate) number: u16,
    parameters: &'static [ParameterName],
    /// Esri's name; empty if there is none.
    esri: &'static str,
    esri_parameters: &'static [EsriName],
    /// Number in GeoTIFF's keys, or 0.
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
    Given,
    /// A number where it is not given.
    Or(f64),
    /// There or not.
    Free,
    /// Not there, or of this value, which changes nothing.
    Only(f64),
}

/// The way a method becomes PROJ's words.
#[derive(Clone, Copy, Debug, PartialEq)]
enum TreeType {
    /// As it is.
    Plain,
    /// Method with the axes turned round.
    South,
    /// Lambert's conic with one parallel, at the origin.
    OneParallel,
    /// Either, as Esri has them under one name.
    OneOrTwoParallels,
    /// The pole by the latitude, or by the sign of the parallel of true scale.
    Polar,
    /// The pole by the method's name: its latitude.
    Pole(f64),
    /// Oblique Mercator whose false origin is where the initial line crosses the equator of the aposphere.
    ObliqueOrigin,
    /// Oblique Mercator whose false origin is the centre.
    ObliqueCentre,
    /// Krovak's conic: south and west as it was defined, or east and north by Esri's factors of the axes and their rotation.
    Krovak,
}

/// PROJ's word for a parameter, or a number that it always has, its name in WKT 2, and its number in the EPSG registry, or 0.
type ParameterName = (&'static str, &'static str, u16);
/// Its word or number, and Esri's name.
type EsriName = (&'static str, &'static str);
/// Its words, and the number of a GeoTIFF key.
type ParameterKey = (&'static str, u16);

impl Method {
    /// PROJ's word for the method.
    fn word(&self) -> &'static str {
        self.words.split(' ').next().unwrap_or_default()
    }
}

/// Directions of the axes by PROJ's words for a method; nothing where these are east and north, or along meridians.
pub(crate) fn axes_of_words(words: &str) -> Option<[&'static str; 2]> {
    let known = [("+axis=wsu", ["west", "south"]), ("+axis=swu", ["south", "west"])];
    known.into_iter().find(|(word, _)| words.contains(word)).map(|(_, axes)| axes)
}
