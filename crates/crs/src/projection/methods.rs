//! Projection methods and their parameters, by the names that they have in definitions.
//!
//! Names are those of the EPSG registry, of GDAL's WKT 1 and of Esri's. Each was compared with PROJ by `benches/peers/projections.py
//! --definitions`; what is not in these tables is refused.

use super::axis::Axis;

/// Parameters with their values: PROJ's words, and degrees, metres or ones.
pub(crate) type Values = Vec<(&'static str, f64)>;

/// Kind of measure of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Measure {
    Angle,
    Length,
    Scale,
}

/// A parameter: PROJ's word for it, and its names in definitions.
#[derive(Debug)]
pub(super) struct Role(&'static str, Measure, Need, &'static [&'static str]);

/// A parameter's place in a method.
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

/// A method.
#[derive(Debug)]
pub(super) struct Method {
    names: &'static [&'static str],
    kind: Form,
    roles: &'static [&'static [Role]],
}

/// The way a method becomes PROJ's words.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// As it is.
    Plain(&'static str),
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
    /// Krovak's with eastings and northings.
    Krovak,
}

use Form::*;
use Measure::*;
use Need::*;

const NAT_LAT: &[&str] = &[
    "latitudeofnaturalorigin",
    "latitudeoforigin",
    "latitudeoffalseorigin",
    "latitudeofcenter",
    "latitudeofprojectioncentre",
];
const NAT_LON: &[&str] = &[
    "longitudeofnaturalorigin",
    "centralmeridian",
    "longitudeoffalseorigin",
    "longitudeofcenter",
    "longitudeoforigin",
    "longitudeofprojectioncentre",
];
const SCALES: &[&str] = &["scalefactoratnaturalorigin", "scalefactor", "scalefactoratprojectioncentre"];
const PARALLEL_1: &[&str] = &["latitudeof1ststandardparallel", "standardparallel1"];
const PARALLEL_2: &[&str] = &["latitudeof2ndstandardparallel", "standardparallel2"];

const LAT_0: Role = Role("lat_0", Angle, Given, NAT_LAT);
const LON_0: Role = Role("lon_0", Angle, Given, NAT_LON);
const EQUATOR: Role = Role("lat_0", Angle, Only(0.0), NAT_LAT);
const K_0: Role = Role("k_0", Scale, Or(1.0), SCALES);
const NO_SCALE: Role = Role("k_0", Scale, Only(1.0), SCALES);
const LAT_1: Role = Role("lat_1", Angle, Given, PARALLEL_1);
const LAT_2: Role = Role("lat_2", Angle, Given, PARALLEL_2);
const LAT_TS: Role = Role("lat_ts", Angle, Given, PARALLEL_1);
const FALSE: &[Role] = &[
    Role("x_0", Length, Or(0.0), &["falseeasting", "eastingatfalseorigin", "eastingatprojectioncentre"]),
    Role("y_0", Length, Or(0.0), &["falsenorthing", "northingatfalseorigin", "northingatprojectioncentre"]),
];
const OBLIQUE: &[Role] = &[
    Role("lat_0", Angle, Given, NAT_LAT),
    Role("lonc", Angle, Given, NAT_LON),
    Role("alpha", Angle, Given, &["azimuthatprojectioncentre", "azimuth"]),
    Role("gamma", Angle, Free, &["anglefromrectifiedtoskewgrid", "rectifiedgridangle", "xyplanerotation"]),
    K_0,
];
const ORIGIN: &[Role] = &[LAT_0, LON_0];
const SCALED: &[Role] = &[LAT_0, LON_0, K_0];
const MERIDIAN: &[Role] = &[LON_0];
const PARALLEL: &[Role] = &[LAT_1];
const PARALLELS: &[Role] = &[LAT_1, LAT_2];

const fn method(names: &'static [&'static str], kind: Form, roles: &'static [&'static [Role]]) -> Method {
    Method { names, kind, roles }
}

/// The methods.
#[rustfmt::skip]
const METHODS: &[Method] = &[
    method(&["transversemercator", "gausskruger"], Plain("+proj=tmerc"), &[SCALED, FALSE]),
    method(&["transversemercatorsouthorientated"], South, &[SCALED, FALSE]),
    method(&["lambertconicconformal2sp", "lambertconformalconic2sp"], Plain("+proj=lcc"), &[ORIGIN, PARALLELS, FALSE]),
    method(&["lambertconicconformal1sp", "lambertconformalconic1sp"], OneParallel, &[SCALED, FALSE]),
    method(&["lambertconformalconic"], OneOrTwoParallels, &[SCALED, PARALLEL, &[Role("lat_2", Angle, Free, PARALLEL_2)], FALSE]),
    method(&["albersequalarea", "albersconicequalarea", "albers"], Plain("+proj=aea"), &[ORIGIN, PARALLELS, FALSE]),
    method(&["equidistantconic"], Plain("+proj=eqdc"), &[ORIGIN, PARALLELS, FALSE]),
    method(&["lambertazimuthalequalarea"], Plain("+proj=laea"), &[ORIGIN, FALSE]),
    method(&["azimuthalequidistant"], Plain("+proj=aeqd"), &[ORIGIN, FALSE]),
    method(&["gnomonic"], Plain("+proj=gnom"), &[ORIGIN, FALSE]),
    method(&["orthographic"], Plain("+proj=ortho"), &[ORIGIN, FALSE]),
    method(&["obliquestereographic", "doublestereographic"], Plain("+proj=sterea"), &[SCALED, FALSE]),
    method(&["stereographic"], Plain("+proj=stere"), &[SCALED, FALSE]),
    method(&["polarstereographicvarianta"], Polar, &[SCALED, FALSE]),
    method(&["polarstereographicvariantb", "polarstereographic"], Polar, &[
        &[Role("lat_0", Angle, Given, &["latitudeofstandardparallel", "latitudeoforigin", "latitudeofnaturalorigin"]), LON_0, K_0], FALSE]),
    method(&["stereographicnorthpole"], Pole(90.0), &[&[LAT_TS, LON_0, NO_SCALE], FALSE]),
    method(&["stereographicsouthpole"], Pole(-90.0), &[&[LAT_TS, LON_0, NO_SCALE], FALSE]),
    method(&["cassinisoldner", "cassini"], Plain("+proj=cass"), &[ORIGIN, &[NO_SCALE], FALSE]),
    method(&["americanpolyconic", "polyconic"], Plain("+proj=poly"), &[ORIGIN, &[NO_SCALE], FALSE]),
    method(&["hotineobliquemercatorvarianta", "hotineobliquemercator", "hotineobliquemercatorazimuthnaturalorigin",
        "rectifiedskeworthomorphicnaturalorigin"], ObliqueOrigin, &[OBLIQUE, FALSE]),
    method(&["hotineobliquemercatorvariantb", "hotineobliquemercatorazimuthcenter", "rectifiedskeworthomorphiccenter"],
        ObliqueCentre, &[OBLIQUE, FALSE]),
    method(&["krovaknorthorientated"], Krovak, &[&[LAT_0, LON_0,
        Role("", Angle, Only(30.288_139_752_777_8), &["colatitudeofconeaxis"]),
        Role("lat_1", Angle, Only(78.5), &["latitudeofpseudostandardparallel"]),
        Role("k_0", Scale, Given, &["scalefactoronpseudostandardparallel"])], FALSE]),
    method(&["mercatorvarianta", "mercator1sp"], Plain("+proj=merc"), &[&[EQUATOR, LON_0, K_0], FALSE]),
    method(&["mercatorvariantb", "mercator2sp", "mercator"], Plain("+proj=merc"), &[&[EQUATOR, LAT_TS, LON_0, NO_SCALE], FALSE]),
    method(&["popularvisualisationpseudomercator", "mercatorauxiliarysphere"], Plain("+proj=webmerc"), &[&[
        EQUATOR, LON_0, Role("lat_ts", Angle, Only(0.0), PARALLEL_1), Role("", Scale, Only(0.0), &["auxiliaryspheretype"])], FALSE]),
    method(&["lambertcylindricalequalarea", "cylindricalequalarea"], Plain("+proj=cea"), &[&[EQUATOR, LAT_TS, LON_0], FALSE]),
    method(&["equidistantcylindrical", "equirectangular"], Plain("+proj=eqc"), &[&[
        Role("lat_0", Angle, Only(0.0), NAT_LAT), Role("lat_ts", Angle, Or(0.0), PARALLEL_1), LON_0], FALSE]),
    method(&["platecarree"], Plain("+proj=eqc"), &[MERIDIAN, FALSE]),
    method(&["equalearth"], Plain("+proj=eqearth"), &[MERIDIAN, FALSE]),
    method(&["mollweide"], Plain("+proj=moll"), &[MERIDIAN, FALSE]),
    method(&["robinson"], Plain("+proj=robin"), &[MERIDIAN, FALSE]),
    method(&["sinusoidal"], Plain("+proj=sinu"), &[MERIDIAN, FALSE]),
];

/// A name's letters, small, and digits, as the tables have it.
pub(super) fn key(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}

/// The method of a name.
pub(super) fn find(name: &str) -> Option<&'static Method> {
    let key = key(name);
    METHODS.iter().find(|method| method.names.contains(&key.as_str()))
}

impl Role {
    pub(super) fn word(&self) -> &'static str {
        self.0
    }

    pub(super) fn measure(&self) -> Measure {
        self.1
    }
}

impl Method {
    /// The parameter of a name.
    pub(super) fn role(&self, name: &str) -> Option<&'static Role> {
        let key = key(name);
        self.roles.iter().copied().flatten().find(|role| role.3.contains(&key.as_str()))
    }

    /// PROJ's words for the method, under the name that it has, and for its parameters.
    pub(super) fn words(&self, name: &str, values: Values) -> Result<(&'static str, Values), String> {
        let mut whole = Values::new();
        for Role(word, _, need, names) in self.roles.iter().copied().flatten() {
            let given = values.iter().find(|(own, _)| own == word).map(|(_, value)| *value);
            let parameter = names.first().unwrap_or(word);
            match (need, given) {
                (Given | Or(_) | Free, Some(value)) => whole.push((*word, value)),
                (Or(value), None) => whole.push((*word, *value)),
                (Free | Only(_), None) => {}
                (Only(value), Some(given)) if (given - value).abs() < 1e-9 => {}
                (Only(_), Some(given)) => {
                    return Err(format!("the method {name} with the {parameter} {given:?}"));
                }
                (Given, None) => return Err(format!("the method {name} without a {parameter}")),
            }
        }
        let get = |word: &str| whole.iter().find(|(own, _)| *own == word).map(|(_, value)| *value);
        for word in ["lat_0", "lat_1", "lat_2", "lat_ts"] {
            if get(word).is_some_and(|value| value.abs() > 90.0) {
                return Err(format!("the method {name} at a latitude of {:?} degrees", get(word)));
            }
        }
        let (lat_0, scale) = (get("lat_0").unwrap_or(0.0), get("k_0").unwrap_or(1.0));
        if scale <= 0.0 {
            return Err(format!("the method {name} with the scale {scale:?}"));
        }
        let words = match self.kind {
            Plain(words) => words,
            South => "+proj=tmerc +axis=wsu",
            OneParallel => {
                whole.push(("lat_1", lat_0));
                "+proj=lcc"
            }
            OneOrTwoParallels => {
                let fits = if get("lat_2").is_some() { scale == 1.0 } else { get("lat_1") == Some(lat_0) };
                if !fits {
                    return Err(format!("the method {name} with a scale apart from its parallels"));
                }
                "+proj=lcc"
            }
            Polar => {
                let at_pole = (lat_0.abs() - 90.0).abs() < 1e-10;
                if !at_pole {
                    if key(name) == "polarstereographicvarianta" || scale != 1.0 || lat_0 == 0.0 {
                        return Err(format!(
                            "the method {name} at the latitude {lat_0:?} with the scale {scale:?}"
                        ));
                    }
                    whole.retain(|(word, _)| *word != "lat_0");
                    whole.extend([("lat_0", 90f64.copysign(lat_0)), ("lat_ts", lat_0)]);
                }
                "+proj=stere"
            }
            Pole(pole) => {
                if get("lat_ts").is_none_or(|parallel| parallel * pole <= 0.0) {
                    return Err(format!("the method {name} with its parallel beyond the equator"));
                }
                whole.push(("lat_0", pole));
                "+proj=stere"
            }
            ObliqueOrigin | ObliqueCentre => {
                let alpha = get("alpha").unwrap_or_default();
                let gamma = get("gamma").unwrap_or(alpha);
                whole.retain(|(word, _)| *word != "gamma");
                whole.push(("gamma", gamma));
                let is_swiss = (alpha - 90.0).abs() < 1e-4 && (gamma - 90.0).abs() < 1e-4;
                match (self.kind, is_swiss) {
                    (ObliqueCentre, true) => {
                        whole.retain(|(word, _)| !["alpha", "gamma"].contains(word));
                        for (word, _) in &mut whole {
                            *word = if *word == "lonc" { "lon_0" } else { word };
                        }
                        "+proj=somerc"
                    }
                    (ObliqueCentre, false) => "+proj=omerc",
                    _ => "+proj=omerc +no_uoff",
                }
            }
            Krovak => "+proj=krovak",
        };
        Ok((words, whole))
    }

    /// Whether eastings and northings, or westings and southings where the method has these, are what the axes are.
    pub(super) fn takes(&self, axes: &[Axis], values: &Values) -> bool {
        let get = |word: &str| values.iter().find(|(own, _)| *own == word).map_or(0.0, |(_, value)| *value);
        let (pole, meridian) = (get("lat_0"), get("lon_0"));
        // Away from a pole both go north or south: the easting along the meridian that is a quarter of a turn from the middle one, or along
        // that of 90 degrees, whatever the middle one is, as many programs write.
        let is_along = |axis: &Axis, degrees: f64| {
            axis.meridian.is_some_and(|own| ((own - degrees).rem_euclid(360.0) - 180.0).abs() > 180.0 - 1e-6)
        };
        let is_polar = |[first, second]: [&Axis; 2]| {
            let straight = if pole > 0.0 { 180.0 } else { 0.0 };
            let has_quarter = is_along(first, meridian + 90.0);
            match (first.meridian, second.meridian) {
                (None, None) => ["easting", "e", "x"].contains(&key(&first.name).as_str()),
                // (Then PROJ takes the second for the easting.)
                _ if is_along(first, straight) && is_along(second, 90.0) => !has_quarter,
                _ => has_quarter || is_along(first, 90.0) && is_along(second, straight),
            }
        };
        let directions: Vec<_> = axes.iter().map(|axis| axis.direction.as_str()).collect();
        match directions[..] {
            [] => true,
            ["west", "south", ..] => self.kind == South,
            ["east", "north", ..] | ["north", "east", ..] => self.kind != South,
            ["south", "south", ..] => pole == 90.0 && is_polar([&axes[0], &axes[1]]),
            ["north", "north", ..] => pole == -90.0 && is_polar([&axes[0], &axes[1]]),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_keys_of_one_method_and_of_one_parameter() {
        let names: Vec<_> = METHODS.iter().flat_map(|method| method.names).collect();
        let mut sorted = names.clone();
        sorted.sort();
        sorted.dedup();
        assert_eq!(sorted.len(), names.len());
        for method in METHODS {
            let names: Vec<_> = method.roles.iter().copied().flatten().flat_map(|role| role.3).collect();
            for name in names.iter().chain(&method.names.iter().collect::<Vec<_>>()) {
                assert_eq!(**name, key(name));
            }
            assert!(
                names.iter().enumerate().all(|(place, name)| !names[..place].contains(name)),
                "{method:?}"
            );
        }
    }
}
