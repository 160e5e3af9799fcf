//! Reads PROJ strings, restricted to what PROJ and its port interpret in the same way.

use std::fmt::Write as _;

use proj4rs::Proj;

use super::datum::Datum;
use super::definition::Definition;
use super::shift::Shift;
use super::system::{helmert, is_global};
use super::words;
use crate::definition::{metres_of_unit, parse_proj_string, proj_value};
use crate::methods::{KROVAK_COLATITUDE, Values, words_of};

/// Returns the words that a method takes in addition to the common ones; none for longitude and
/// latitude. `None` if the method does not exist.
fn taken_words(method: &str) -> Option<Vec<&'static str>> {
    match method {
        "longlat" | "latlong" | "lonlat" | "latlon" => Some(Vec::new()),
        "utm" => Some(vec!["zone", "south"]),
        "etmerc" => words_of("tmerc"),
        "omerc" => words_of("omerc").map(|words| [&words[..], &["no_uoff", "no_off"]].concat()),
        _ => words_of(method),
    }
}

/// Words of the ellipsoid and of the datum.
const FIGURES: [&str; 8] = ["ellps", "datum", "R", "a", "b", "rf", "towgs84", "nadgrids"];
/// Words with numeric values, and their maximum magnitudes.
const NUMBERS: [(&str, f64); 18] = [
    ("lat_0", 90.0),
    ("lat_1", 90.0),
    ("lat_2", 90.0),
    ("lat_ts", 90.0),
    ("lon_0", 360.0),
    ("lonc", 360.0),
    ("alpha", 360.0),
    ("gamma", 360.0),
    ("zone", 60.0),
    ("k", 1e3),
    ("k_0", 1e3),
    ("x_0", 1e10),
    ("y_0", 1e10),
    ("R", 1e9),
    ("a", 1e9),
    ("b", 1e9),
    ("rf", 1e9),
    ("to_meter", 1e7),
];
/// Words that do not affect horizontal coordinates.
const IGNORED_WORDS: [&str; 3] = ["no_defs", "wktext", "title"];
/// Named prime meridians, whose longitudes are those of PROJ.
const MERIDIANS: [&str; 13] = [
    "greenwich",
    "lisbon",
    "paris",
    "bogota",
    "madrid",
    "rome",
    "bern",
    "jakarta",
    "ferro",
    "brussels",
    "stockholm",
    "athens",
    "oslo",
];

/// PROJ's names of datums, and geographic systems of the EPSG registry that have them.
const DATUMS: [(&str, u16); 10] = [
    ("WGS84", 4326),
    ("NAD83", 4269),
    ("NAD27", 4267),
    ("GGRS87", 4121),
    ("potsdam", 4314),
    ("carthage", 4223),
    ("hermannskogel", 4312),
    ("ire65", 4299),
    ("nzgd49", 4272),
    ("OSGB36", 4277),
];

/// The components of a PROJ string.
#[derive(Debug)]
pub(crate) struct ProjParts {
    /// Half axes in metres.
    pub(crate) ellipsoid: [f64; 2],
    /// Geographic system of the EPSG registry that has the named datum.
    pub(crate) datum: Option<u16>,
    /// Degrees east of Greenwich.
    pub(crate) prime_meridian: f64,
    /// The method's words and parameters; `None` for geographic systems.
    pub(crate) projection: Option<(String, Values)>,
    /// Size of the horizontal unit in metres.
    pub(crate) unit: f64,
    pub(crate) shift: Option<Shift>,
}

/// Reads the components of a PROJ string. The error describes what was found.
pub(crate) fn parts(text: &str) -> Result<ProjParts, String> {
    let all = parse_proj_string(text)?;
    let get = |name: &str| proj_value(&all, name);
    let has = |name: &str| all.iter().any(|(own, _)| *own == name);
    let number = |name: &str| get(name).and_then(|value| value.parse::<f64>().ok());
    if is_web_mercator(text) {
        let projection = Some(("+proj=webmerc".into(), Values::new()));
        let ellipsoid = super::system::half_axes(6_378_137.0, 298.257_223_563)?;
        return Ok(ProjParts {
            ellipsoid,
            datum: Some(4326),
            prime_meridian: 0.0,
            projection,
            unit: 1.0,
            shift: None,
        });
    }
    // (Rejects words that are ambiguous or not supported.)
    let words = read(text)?.words;
    let proj = Proj::from_proj_string(&words).map_err(|error| format!("`{words}`: {error}"))?;
    let (a, b) = proj.ellipse_parameters();
    let named = get("datum").and_then(|name| DATUMS.iter().find(|(own, _)| *own == name));
    let shift = match (get("towgs84"), get("nadgrids")) {
        (_, Some(grid)) => Some(Shift::Grid(grid.into())),
        (Some(numbers), None) => {
            let numbers: Result<Vec<f64>, _> = numbers.split(',').map(str::parse).collect();
            Some(Shift::Helmert(numbers.map_err(|error| error.to_string())?))
        }
        (None, None) => None,
    };
    let roles = ["lat_0", "lon_0", "lat_1", "lat_2", "lat_ts", "lonc", "alpha", "gamma", "x_0", "y_0"];
    let mut values: Values = roles.into_iter().filter_map(|role| Some((role, number(role)?))).collect();
    values.extend(number("k_0").or(number("k")).map(|scale| ("k_0", scale)));
    let unit = get("units").and_then(metres_of_unit).or(number("to_meter")).unwrap_or(1.0);
    let method = get("proj").unwrap_or_default();
    let projection = match method {
        "longlat" | "latlong" | "lonlat" | "latlon" => None,
        "utm" => {
            let zone = number("zone").ok_or("no zone")?;
            let northing = if has("south") { 1e7 } else { 0.0 };
            let values =
                [("lon_0", 6.0 * zone - 183.0), ("k_0", 0.9996), ("x_0", 500_000.0), ("y_0", northing)];
            Some(("+proj=tmerc".into(), values.into()))
        }
        "tmerc" | "etmerc" if get("axis") == Some("wsu") => Some(("+proj=tmerc +axis=wsu".into(), values)),
        "etmerc" => Some(("+proj=tmerc".into(), values)),
        "krovak" => {
            values.retain(|(word, _)| *word != "alpha");
            let axes = if get("axis") == Some("swu") { " +axis=swu" } else { "" };
            Some((format!("+proj=krovak{axes}"), values))
        }
        "omerc" if has("no_uoff") || has("no_off") => Some(("+proj=omerc +no_uoff".into(), values)),
        other => Some((format!("+proj={other}"), values)),
    };
    Ok(ProjParts {
        ellipsoid: [a, b],
        datum: named.map(|(_, number)| *number),
        prime_meridian: proj.from_greenwich().to_degrees(),
        projection,
        unit,
        shift,
    })
}

/// Returns the UTM zone and hemisphere.
pub(crate) fn utm_zone(text: &str) -> Option<(&str, char)> {
    let words = parse_proj_string(text).ok().filter(|words| proj_value(words, "proj") == Some("utm"))?;
    let half = if words.iter().any(|(name, _)| *name == "south") { 'S' } else { 'N' };
    Some((proj_value(&words, "zone")?, half))
}

/// Whether a PROJ string is Web Mercator in the form that PROJ 4 required.
pub(crate) fn is_web_mercator(text: &str) -> bool {
    let Ok(words) = parse_proj_string(text) else { return false };
    let is =
        |name: &str, number: f64| proj_value(&words, name).is_none_or(|value| value.parse() == Ok(number));
    let radius = |name: &str| proj_value(&words, name).is_some_and(|value| value.parse() == Ok(6_378_137.0));
    let zeros = ["lat_ts", "lon_0", "x_0", "y_0"].iter().all(|name| is(name, 0.0));
    proj_value(&words, "proj") == Some("merc")
        && proj_value(&words, "nadgrids") == Some("@null")
        && proj_value(&words, "units").is_none_or(|unit| unit == "m")
        && radius("a")
        && radius("b")
        && zeros
        && is("k", 1.0)
}

/// Maximum error of the co-latitude of Krovak's cone in degrees: definitions round its seconds to
/// three decimals.
const COLATITUDE_ERROR: f64 = 0.001 / 3600.0;

/// Whether an angle in degrees is the co-latitude of Krovak's cone.
fn is_colatitude(degrees: f64) -> bool {
    (degrees - KROVAK_COLATITUDE).abs() <= COLATITUDE_ERROR
}

/// Reads a definition. The error describes what was found.
pub(super) fn read(text: &str) -> Result<Definition, String> {
    let words = parse_proj_string(text)?;
    let get = |name: &str| proj_value(&words, name);
    let has = |name: &str| words.iter().any(|(own, _)| *own == name);
    let method = get("proj").unwrap_or_default();
    let takes = taken_words(method).ok_or_else(|| format!("the method {method}"))?;
    let number = |name: &str| get(name).and_then(|value| value.parse::<f64>().ok());
    let is_geographic = takes.is_empty();
    let mut text = format!("+proj={}", if is_geographic { "longlat" } else { method });
    for (name, value) in &words {
        let shown = format!("+{name}{}", value.map_or(String::new(), |value| format!("={value}")));
        let refused = || format!("`{shown}` in the method {method}");
        if let Some((_, most)) = NUMBERS.iter().find(|(own, _)| own == name) {
            // (PROJ also reads other notations.)
            let found = number(name).filter(|number| number.abs() <= *most);
            found.ok_or_else(|| format!("`{shown}`, which is no number in its range"))?;
        }
        let own = if *name == "k" { "k_0" } else { name };
        match (*name, *value) {
            ("proj", _) => {}
            (name, _) if IGNORED_WORDS.contains(&name) => {}
            ("type", Some("crs")) => {}
            // The default.
            ("axis", Some("enu")) => {}
            ("axis", Some("wsu")) if method == "tmerc" => text.push_str(" +axis=wsu"),
            ("axis", Some("swu")) if method == "krovak" => text.push_str(" +axis=swu"),
            ("units", Some(unit)) if !is_geographic && !has("to_meter") => {
                let metres = metres_of_unit(unit).ok_or_else(refused)?;
                let _ = write!(text, " +to_meter={metres:?}");
            }
            ("to_meter", Some(_)) if !is_geographic && !has("units") => {
                let metres = number("to_meter").filter(|metres| *metres > 1e-6).ok_or_else(refused)?;
                let _ = write!(text, " +to_meter={metres:?}");
            }
            ("units", Some("degrees" | "m")) if is_geographic => {}
            ("pm", Some(meridian)) => {
                let is_number = meridian.parse::<f64>().is_ok_and(|degrees| degrees.abs() <= 360.0);
                if !is_number && !MERIDIANS.contains(&meridian) {
                    return Err(refused());
                }
                let _ = write!(text, " {shown}");
            }
            (name, Some(_)) if FIGURES.contains(&name) => {
                let _ = write!(text, " {shown}");
            }
            ("x_0" | "y_0", Some(_)) if !is_geographic => {
                let _ = write!(text, " {shown}");
            }
            ("south" | "no_uoff" | "no_off", None) if takes.contains(name) => {
                let _ = write!(text, " {shown}");
            }
            (_, Some(_)) if takes.contains(&own) => {
                let _ = write!(text, " {shown}");
            }
            // (The method has only this cone.)
            ("alpha", Some(_)) if method == "krovak" && number(name).is_some_and(is_colatitude) => {}
            // A word that the method does not take, with a value that has no effect.
            ("lat_0" | "lat_ts" | "lon_0" | "x_0" | "y_0", Some(_)) if number(name) == Some(0.0) => {}
            ("k" | "k_0", Some(_)) if number(name) == Some(1.0) => {}
            _ => return Err(refused()),
        }
    }
    check_method(method, &number, &has)?;
    check_figure(&get, &has)?;
    let (words, datum) = (words::without_shift(&text), Datum::of(&text));
    let proj = Proj::from_proj_string(&words).map_err(|error| format!("`{words}`: {error}"))?;
    let (a, b) = proj.ellipse_parameters();
    super::system::check_ellipsoid([a, b])?;
    let datum = match (get("nadgrids"), get("towgs84"), datum) {
        (None, Some(numbers), _) => {
            let parsed: Result<Vec<f64>, _> = numbers.split(',').map(str::parse).collect();
            let parsed = parsed.ok().filter(|numbers| numbers.iter().all(|number| number.is_finite()));
            helmert(&parsed.ok_or_else(|| format!("`+towgs84={numbers}`"))?, [a, b])?
        }
        // The half axes of WGS 84 or GRS 1980 as numbers.
        (None, None, Datum::Unknown) if is_global([a, b]) => Datum::Wgs84,
        (_, _, datum) => datum,
    };
    Ok(Definition { words, datum })
}

/// Fails if PROJ and its port may interpret a method's words differently.
fn check_method(
    method: &str,
    number: &impl Fn(&str) -> Option<f64>,
    has: &impl Fn(&str) -> bool,
) -> Result<(), String> {
    let scale = number("k_0").or(number("k")).unwrap_or(1.0);
    let refused = |why: &str| Err(format!("the method {method} {why}"));
    if scale <= 0.0 || has("k") && has("k_0") {
        return refused("with an invalid scale");
    }
    match method {
        "utm" => match number("zone") {
            Some(zone) if zone >= 1.0 && zone.fract() == 0.0 => Ok(()),
            _ => refused("without a +zone of 1 to 60"),
        },
        "merc" if scale != 1.0 && number("lat_ts").is_some_and(|parallel| parallel != 0.0) => {
            refused("with a scale and a +lat_ts")
        }
        "stere" => {
            let pole = number("lat_0").unwrap_or(0.0);
            match number("lat_ts") {
                Some(parallel) if pole.abs() != 90.0 || scale != 1.0 || parallel * pole <= 0.0 => {
                    refused("with a +lat_ts, but not at its pole, or with a scale")
                }
                _ => Ok(()),
            }
        }
        "lcc" => match (number("lat_0"), number("lat_1"), number("lat_2")) {
            (Some(origin), Some(first), None) if origin == first => Ok(()),
            (Some(origin), Some(first), Some(second)) if first == second && origin == first => Ok(()),
            (Some(_), Some(first), Some(second)) if first != second && scale == 1.0 => Ok(()),
            _ => refused("with parallels that are neither one at +lat_0 nor two without a scale"),
        },
        "aea" | "eqdc" if !["lat_0", "lat_1", "lat_2"].iter().all(|name| has(name)) => {
            refused("without +lat_0, +lat_1 and +lat_2")
        }
        "omerc" if !["lat_0", "lonc", "alpha"].iter().all(|name| has(name)) => {
            refused("without +lat_0, +lonc and +alpha")
        }
        "krovak" if !["lat_0", "lon_0", "k"].iter().all(|name| has(name) || *name == "k" && has("k_0")) => {
            refused("without +lat_0, +lon_0 and +k")
        }
        _ => Ok(()),
    }
}

/// Fails if the ellipsoid is not defined, or in several ways that may not agree.
fn check_figure<'a>(
    get: &impl Fn(&str) -> Option<&'a str>,
    has: &impl Fn(&str) -> bool,
) -> Result<(), String> {
    let agrees = matches!(
        (get("datum"), get("ellps")),
        (None, _) | (_, None) | (Some("WGS84"), Some("WGS84")) | (Some("NAD83"), Some("GRS80"))
    );
    let sizes = [has("R"), has("a"), has("ellps") || has("datum")].into_iter().filter(|has| *has).count();
    let shapes = [has("b"), has("rf")].into_iter().filter(|has| *has).count();
    // (A datum has its own shift.)
    let shifts = get("datum").is_some_and(|_| {
        has("nadgrids")
            || get("towgs84").is_some_and(|numbers| numbers.split(',').any(|one| one.parse() != Ok(0.0)))
    });
    let fits = sizes == 1 && shapes == usize::from(has("a"));
    if agrees && fits && !shifts {
        return Ok(());
    }
    Err("no definition of the ellipsoid, or several that may disagree".into())
}
