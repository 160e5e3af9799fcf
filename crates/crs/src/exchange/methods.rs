//! Projection methods under the names and numbers that other programs know: those of WKT 2 (EPSG's and PROJ's), of Esri's WKT 1 and of
//! GeoTIFF's keys.

use crate::projection::methods::{Measure, Values};

/// A method, and what its parameters are called.
#[derive(Debug)]
pub(super) struct Written {
    /// In PROJ's words.
    words: &'static str,
    /// Name in WKT 2, and number in the EPSG registry, or 0.
    pub(super) name: &'static str,
    pub(super) number: u16,
    parameters: &'static [ParameterName],
    /// Esri's name; empty if there is none.
    pub(super) esri: &'static str,
    /// PROJ's words for parameters, or numbers, and Esri's names.
    esri_parameters: &'static [(&'static str, &'static str)],
    /// Number in GeoTIFF's keys, or 0.
    pub(super) key: u16,
    keys: &'static [(&'static str, u16)],
}

/// PROJ's word for a parameter, its name in WKT 2, and its number in the EPSG registry, or 0.
type ParameterName = (&'static str, &'static str, u16);

/// A parameter with its value in degrees, metres or ones.
pub(super) struct Parameter<N> {
    pub(super) name: N,
    pub(super) measure: Measure,
    pub(super) value: f64,
}

const LAT_0: ParameterName = ("lat_0", "Latitude of natural origin", 8801);
const LON_0: ParameterName = ("lon_0", "Longitude of natural origin", 8802);
const K_0: ParameterName = ("k_0", "Scale factor at natural origin", 8805);
const X_0: ParameterName = ("x_0", "False easting", 8806);
const Y_0: ParameterName = ("y_0", "False northing", 8807);
const LAT_TS: ParameterName = ("lat_ts", "Latitude of 1st standard parallel", 8823);
const SCALED: &[ParameterName] = &[LAT_0, LON_0, K_0, X_0, Y_0];
const AT_ORIGIN: &[ParameterName] = &[LAT_0, LON_0, X_0, Y_0];
const AT_MERIDIAN: &[ParameterName] = &[LON_0, X_0, Y_0];
const CONIC: &[ParameterName] = &[
    ("lat_0", "Latitude of false origin", 8821),
    ("lon_0", "Longitude of false origin", 8822),
    ("lat_1", "Latitude of 1st standard parallel", 8823),
    ("lat_2", "Latitude of 2nd standard parallel", 8824),
    ("x_0", "Easting at false origin", 8826),
    ("y_0", "Northing at false origin", 8827),
];
const LAT_C: ParameterName = ("lat_0", "Latitude of projection centre", 8811);
const LON_C: ParameterName = ("lonc", "Longitude of projection centre", 8812);
const ALPHA: ParameterName = ("alpha", "Azimuth at projection centre", 8813);
const GAMMA: ParameterName = ("gamma", "Angle from Rectified to Skew Grid", 8814);
const K_C: ParameterName = ("k_0", "Scale factor at projection centre", 8815);

type EsriName = (&'static str, &'static str);
const ESRI_X: EsriName = ("x_0", "False_Easting");
const ESRI_Y: EsriName = ("y_0", "False_Northing");
const ESRI_LON: EsriName = ("lon_0", "Central_Meridian");
const ESRI_LAT: EsriName = ("lat_0", "Latitude_Of_Origin");
const ESRI_K: EsriName = ("k_0", "Scale_Factor");
const ESRI_1: EsriName = ("lat_1", "Standard_Parallel_1");
const ESRI_2: EsriName = ("lat_2", "Standard_Parallel_2");
const ESRI_TS: EsriName = ("lat_ts", "Standard_Parallel_1");
const ESRI_CENTRE: &[EsriName] =
    &[ESRI_X, ESRI_Y, ("lon_0", "Longitude_Of_Center"), ("lat_0", "Latitude_Of_Center")];
const ESRI_SCALED: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON, ESRI_K, ESRI_LAT];
const ESRI_CONIC: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON, ESRI_1, ESRI_2, ESRI_LAT];
const ESRI_ORIGIN: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON, ESRI_LAT];
const ESRI_MERIDIAN: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON];
const ESRI_PARALLEL: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON, ESRI_TS];
const ESRI_OBLIQUE: &[EsriName] = &[
    ESRI_X,
    ESRI_Y,
    ESRI_K,
    ("alpha", "Azimuth"),
    ("lonc", "Longitude_Of_Center"),
    ("lat_0", "Latitude_Of_Center"),
    ("gamma", "XY_Plane_Rotation"),
];

const NATURAL_KEYS: &[(&str, u16)] =
    &[("lon_0", 3080), ("lat_0", 3081), ("x_0", 3082), ("y_0", 3083), ("k_0", 3092)];
const CENTRE_KEYS: &[(&str, u16)] = &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088), ("lat_0", 3089)];
const CONIC_KEYS: &[(&str, u16)] =
    &[("lat_1", 3078), ("lat_2", 3079), ("lon_0", 3080), ("lat_0", 3081), ("x_0", 3082), ("y_0", 3083)];
const OBLIQUE_KEYS: &[(&str, u16)] = &[
    ("x_0", 3082),
    ("y_0", 3083),
    ("lonc", 3088),
    ("lat_0", 3089),
    ("k_0", 3093),
    ("alpha", 3094),
    ("gamma", 3096),
];

#[allow(clippy::too_many_arguments)] // a row of the table
const fn row(
    words: &'static str,
    (name, number, parameters): (&'static str, u16, &'static [ParameterName]),
    (esri, esri_parameters): (&'static str, &'static [EsriName]),
    (key, keys): (u16, &'static [(&'static str, u16)]),
) -> Written {
    Written { words, name, number, parameters, esri, esri_parameters, key, keys }
}

const NONE: (&str, &[EsriName]) = ("", &[]);

/// Methods by PROJ's words; where these are several, by [`variant`].
#[rustfmt::skip]
const METHODS: &[Written] = &[
    row("tmerc", ("Transverse Mercator", 9807, SCALED), ("Transverse_Mercator", ESRI_SCALED), (1, NATURAL_KEYS)),
    row("tmerc +axis=wsu", ("Transverse Mercator (South Orientated)", 9808, SCALED), NONE, (0, &[])),
    row("lcc2", ("Lambert Conic Conformal (2SP)", 9802, CONIC), ("Lambert_Conformal_Conic", ESRI_CONIC),
        (8, &[("lat_1", 3078), ("lat_2", 3079), ("lon_0", 3084), ("lat_0", 3085), ("x_0", 3086), ("y_0", 3087)])),
    row("lcc1", ("Lambert Conic Conformal (1SP)", 9801, SCALED),
        ("Lambert_Conformal_Conic", &[ESRI_X, ESRI_Y, ESRI_LON, ("lat_0", "Standard_Parallel_1"), ESRI_K, ESRI_LAT]), (9, NATURAL_KEYS)),
    row("aea", ("Albers Equal Area", 9822, CONIC), ("Albers", ESRI_CONIC), (11, CONIC_KEYS)),
    row("eqdc", ("Equidistant Conic", 1119, CONIC), ("Equidistant_Conic", ESRI_CONIC), (13, CONIC_KEYS)),
    row("laea", ("Lambert Azimuthal Equal Area", 9820, AT_ORIGIN), ("Lambert_Azimuthal_Equal_Area", ESRI_ORIGIN), (10, CENTRE_KEYS)),
    row("aeqd", ("Azimuthal Equidistant", 1125, AT_ORIGIN), ("Azimuthal_Equidistant", ESRI_ORIGIN), (12, CENTRE_KEYS)),
    row("gnom", ("Gnomonic", 0, AT_ORIGIN), ("Gnomonic", ESRI_CENTRE), (19, CENTRE_KEYS)),
    row("ortho", ("Orthographic", 9840, AT_ORIGIN), NONE, (21, CENTRE_KEYS)),
    row("sterea", ("Oblique Stereographic", 9809, SCALED), ("Double_Stereographic", ESRI_SCALED), (16, NATURAL_KEYS)),
    row("stere", ("Stereographic", 0, SCALED), ("Stereographic", ESRI_SCALED),
        (14, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088), ("lat_0", 3089), ("k_0", 3092)])),
    row("stere pole", ("Polar Stereographic (variant A)", 9810, SCALED), ("Stereographic", ESRI_SCALED),
        (15, &[("lat_0", 3081), ("x_0", 3082), ("y_0", 3083), ("k_0", 3092), ("lon_0", 3095)])),
    row("stere parallel", ("Polar Stereographic (variant B)", 9829,
            &[("lat_ts", "Latitude of standard parallel", 8832), ("lon_0", "Longitude of origin", 8833), X_0, Y_0]),
        ("Stereographic_North_Pole", ESRI_PARALLEL),
        (15, &[("lat_ts", 3081), ("x_0", 3082), ("y_0", 3083), ("1", 3092), ("lon_0", 3095)])),
    row("cass", ("Cassini-Soldner", 9806, AT_ORIGIN), ("Cassini", &[ESRI_X, ESRI_Y, ESRI_LON, ("1", "Scale_Factor"), ESRI_LAT]),
        (18, &[("lon_0", 3080), ("lat_0", 3081), ("x_0", 3082), ("y_0", 3083)])),
    row("poly", ("American Polyconic", 9818, AT_ORIGIN), ("Polyconic", ESRI_ORIGIN),
        (22, &[("lon_0", 3080), ("lat_0", 3081), ("x_0", 3082), ("y_0", 3083), ("1", 3092)])),
    row("omerc +no_uoff", ("Hotine Oblique Mercator (variant A)", 9812, &[LAT_C, LON_C, ALPHA, GAMMA, K_C, X_0, Y_0]),
        ("Rectified_Skew_Orthomorphic_Natural_Origin", ESRI_OBLIQUE), (3, OBLIQUE_KEYS)),
    row("omerc", ("Hotine Oblique Mercator (variant B)", 9815, &[LAT_C, LON_C, ALPHA, GAMMA, K_C,
            ("x_0", "Easting at projection centre", 8816), ("y_0", "Northing at projection centre", 8817)]),
        ("Rectified_Skew_Orthomorphic_Center", ESRI_OBLIQUE), (9815, OBLIQUE_KEYS)),
    row("somerc", ("Hotine Oblique Mercator (variant B)", 9815, &[LAT_C, ("lon_0", LON_C.1, LON_C.2), ("90", ALPHA.1, ALPHA.2),
            ("90", GAMMA.1, GAMMA.2), K_C, ("x_0", "Easting at projection centre", 8816), ("y_0", "Northing at projection centre", 8817)]),
        ("Hotine_Oblique_Mercator_Azimuth_Center", &[ESRI_X, ESRI_Y, ESRI_K, ("90", "Azimuth"), ("lon_0", "Longitude_Of_Center"), ("lat_0", "Latitude_Of_Center")]),
        (9815, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088), ("lat_0", 3089), ("k_0", 3093), ("90", 3094), ("90", 3096)])),
    row("krovak", ("Krovak (North Orientated)", 1041, &[("lat_0", LAT_C.1, LAT_C.2), ("lon_0", "Longitude of origin", 8833),
            ("30.2881397527778", "Co-latitude of cone axis", 1036), ("78.5", "Latitude of pseudo standard parallel", 8818),
            ("k_0", "Scale factor on pseudo standard parallel", 8819), X_0, Y_0]), NONE, (0, &[])),
    row("merc", ("Mercator (variant A)", 9804, &[("0", LAT_0.1, LAT_0.2), LON_0, K_0, X_0, Y_0]),
        ("Mercator", &[ESRI_X, ESRI_Y, ESRI_LON, ("0", "Standard_Parallel_1")]), (7, &[("lon_0", 3080), ("0", 3081), ("x_0", 3082), ("y_0", 3083), ("k_0", 3092)])),
    row("merc parallel", ("Mercator (variant B)", 9805, &[LAT_TS, LON_0, X_0, Y_0]), ("Mercator", ESRI_PARALLEL),
        (7, &[("lat_ts", 3078), ("lon_0", 3080), ("x_0", 3082), ("y_0", 3083)])),
    row("webmerc", ("Popular Visualisation Pseudo Mercator", 1024, &[("0", LAT_0.1, LAT_0.2), LON_0, X_0, Y_0]),
        ("Mercator_Auxiliary_Sphere", &[ESRI_X, ESRI_Y, ESRI_LON, ("0", "Standard_Parallel_1"), ("0", "Auxiliary_Sphere_Type")]), (0, &[])),
    row("cea", ("Lambert Cylindrical Equal Area", 9835, &[LAT_TS, LON_0, X_0, Y_0]), ("Cylindrical_Equal_Area", ESRI_PARALLEL),
        (28, &[("lat_ts", 3078), ("lon_0", 3080), ("x_0", 3082), ("y_0", 3083)])),
    row("eqc", ("Equidistant Cylindrical", 1028, &[LAT_TS, ("0", LAT_0.1, LAT_0.2), LON_0, X_0, Y_0]), ("Equidistant_Cylindrical", ESRI_PARALLEL),
        (17, &[("lat_ts", 3078), ("x_0", 3082), ("y_0", 3083), ("lon_0", 3088), ("0", 3089)])),
    row("eqearth", ("Equal Earth", 1078, AT_MERIDIAN), ("Equal_Earth", ESRI_MERIDIAN), (0, &[])),
    row("moll", ("Mollweide", 0, AT_MERIDIAN), ("Mollweide", ESRI_MERIDIAN), (0, &[])),
    row("robin", ("Robinson", 0, AT_MERIDIAN), ("Robinson", ESRI_MERIDIAN), (23, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088)])),
    row("sinu", ("Sinusoidal", 0, AT_MERIDIAN), ("Sinusoidal", ESRI_MERIDIAN), (24, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088)])),
    row("mill", ("Miller Cylindrical", 0, AT_MERIDIAN), ("Miller_Cylindrical", ESRI_MERIDIAN), (20, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088)])),
];

fn value(values: &Values, word: &str) -> Option<f64> {
    values.iter().find(|(own, _)| *own == word).map(|(_, value)| *value)
}

/// Whether a method is about a pole: its latitude.
pub(super) fn pole(words: &str, values: &Values) -> Option<f64> {
    let latitude = value(values, "lat_0").filter(|latitude| (latitude.abs() - 90.0).abs() < 1e-10)?;
    (words == "+proj=stere").then_some(latitude)
}

/// The method of PROJ's words with these parameters.
pub(super) fn find(words: &str, values: &Values) -> Result<&'static Written, String> {
    let has = |word| value(values, word).is_some();
    let name = words.strip_prefix("+proj=").unwrap_or(words);
    let variant = match name {
        "lcc" if has("lat_2") => "lcc2",
        "lcc" => "lcc1",
        "merc" if value(values, "lat_ts").is_some_and(|parallel| parallel != 0.0) => "merc parallel",
        "stere" if pole(words, values).is_none() => "stere",
        "stere" if has("lat_ts") => "stere parallel",
        "stere" => "stere pole",
        "eqc" if value(values, "lat_0").is_some_and(|latitude| latitude != 0.0) => {
            return Err("the method Equidistant Cylindrical with a latitude of origin".into());
        }
        other => other,
    };
    METHODS.iter().find(|method| method.words == variant).ok_or_else(|| format!("the method {words}"))
}

impl Written {
    /// Parameters under their names and numbers in WKT 2.
    pub(super) fn parameters<'a>(
        &self,
        values: &'a Values,
    ) -> impl Iterator<Item = Parameter<(&'static str, u16)>> + 'a {
        self.parameters.iter().map(|(word, name, number)| parameter(values, word, (*name, *number)))
    }

    /// Parameters under Esri's names.
    pub(super) fn esri_parameters(
        &self,
        values: &Values,
    ) -> Result<(&'static str, Vec<Parameter<&'static str>>), String> {
        let of_mercator = self.words == "merc" && value(values, "k_0").is_some_and(|scale| scale != 1.0);
        if self.esri.is_empty() || of_mercator {
            return Err(format!("the method {}, which Esri's WKT has not", self.name));
        }
        let is_south = self.words == "stere parallel" && value(values, "lat_0") == Some(-90.0);
        let name = if is_south { "Stereographic_South_Pole" } else { self.esri };
        Ok((name, self.esri_parameters.iter().map(|(word, name)| parameter(values, word, *name)).collect()))
    }

    /// Parameters by GeoTIFF's keys.
    pub(super) fn keys<'a>(&self, values: &'a Values) -> impl Iterator<Item = Parameter<u16>> + 'a {
        self.keys.iter().map(|(word, key)| parameter(values, word, *key))
    }
}

/// A parameter by PROJ's word, or a number that it always has.
fn parameter<N>(values: &Values, word: &str, name: N) -> Parameter<N> {
    if let Ok(value) = word.parse() {
        return Parameter {
            name,
            measure: if value == 1.0 { Measure::Scale } else { Measure::Angle },
            value,
        };
    }
    let told = value(values, word);
    let (measure, value) = match word {
        "k_0" => (Measure::Scale, told.unwrap_or(1.0)),
        "x_0" | "y_0" => (Measure::Length, told.unwrap_or(0.0)),
        // (Grids are turned by the azimuth if nothing is said.)
        "gamma" => (Measure::Angle, told.or(value(values, "alpha")).unwrap_or(0.0)),
        _ => (Measure::Angle, told.unwrap_or(0.0)),
    };
    Parameter { name, measure, value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_method_has_each_of_its_parameters_once() {
        let none = Values::new();
        for method in METHODS {
            let numbers: Vec<_> = method.parameters(&none).map(|parameter| parameter.name.1).collect();
            let keys: Vec<_> = method.keys(&none).map(|parameter| parameter.name).collect();
            assert!(keys.is_sorted_by(|a, b| a < b), "{method:?}");
            let mut sorted = numbers.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len(), numbers.len(), "{method:?}");
        }
    }

    #[test]
    fn every_method_of_the_projections_is_written() {
        for name in
            crate::PROJECTION_METHODS.iter().filter(|name| !["longlat", "utm", "etmerc"].contains(name))
        {
            assert!(find(&format!("+proj={name}"), &Values::new()).is_ok(), "{name}");
        }
    }
}
