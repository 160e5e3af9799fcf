//! Normalized formulas of projections, which compare as equal if definitions in different words are
//! equivalent.

use std::collections::BTreeMap;

use proj4rs::Proj;

use super::datum::Datum;

/// Words that do not affect the formula, or whose effect is read from the projection itself.
const OTHER: [&str; 21] = [
    "proj",
    "zone",
    "south",
    "ellps",
    "datum",
    "a",
    "b",
    "rf",
    "f",
    "R",
    "pm",
    "units",
    "to_meter",
    "vunits",
    "vto_meter",
    "towgs84",
    "nadgrids",
    "no_defs",
    "type",
    "wktext",
    "over",
];

/// Tolerance of half axes and false origins, in metres.
const LENGTH: f64 = 1e-5;
/// Tolerance of angles in degrees.
const ANGLE: f64 = 1e-10;
const SCALE: f64 = 1e-11;

/// The formula of a projection, and its shift to WGS 84. Coordinates of two equal formulas agree
/// within some hundredths of a millimetre.
#[derive(Debug)]
pub(super) struct Formula {
    method: String,
    /// Parameters by name, without those that have their default values.
    numbers: BTreeMap<String, f64>,
    words: Vec<String>,
    /// Half axes of the ellipsoid, in metres.
    ellipsoid: [f64; 2],
    /// Prime meridian in degrees.
    meridian: f64,
    unit: f64,
    datum: Datum,
}

impl Formula {
    /// Creates the formula of a PROJ string; `proj` is its projection.
    pub(super) fn of(words: &str, proj: &Proj, datum: &Datum) -> Formula {
        let (mut method, mut numbers, mut others) = (String::new(), BTreeMap::new(), Vec::new());
        let (mut zone, mut is_south) = (None, false);
        for word in words.split_whitespace() {
            let (name, value) =
                word.trim_start_matches('+').split_once('=').unwrap_or((&word[1.min(word.len())..], ""));
            match (name, value.parse::<f64>()) {
                ("proj", _) => method = value.into(),
                ("zone", Ok(number)) => zone = Some(number),
                ("south", _) => is_south = true,
                (name, _) if OTHER.contains(&name) => {}
                ("k" | "k_0", Ok(number)) => drop(numbers.insert("k".to_owned(), number)),
                (name, Ok(number)) => drop(numbers.insert(name.into(), number)),
                _ => others.push(word.into()),
            }
        }
        // A UTM zone is a transverse Mercator projection.
        if let ("utm", Some(zone)) = (method.as_str(), zone) {
            let own = [
                ("lon_0", 6.0 * zone - 183.0),
                ("k", 0.9996),
                ("x_0", 5e5),
                ("y_0", if is_south { 1e7 } else { 0.0 }),
            ];
            numbers.extend(own.map(|(name, number)| (name.to_owned(), number)));
        }
        if matches!(method.as_str(), "utm" | "etmerc") {
            method = "tmerc".into();
        }
        numbers.retain(|name, number| *number != if name == "k" { 1.0 } else { 0.0 });
        others.sort_unstable();
        let (a, b) = proj.ellipse_parameters();
        let (meridian, unit) = (proj.from_greenwich().to_degrees(), proj.to_meter());
        Formula { method, numbers, words: others, ellipsoid: [a, b], meridian, unit, datum: datum.clone() }
    }

    /// Returns PROJ's name of the method; `tmerc` for all transverse Mercator methods.
    pub(super) fn method(&self) -> &str {
        &self.method
    }

    /// Returns a parameter by its name, 0 if it is not defined.
    pub(super) fn number(&self, name: &str) -> f64 {
        self.numbers.get(name).copied().unwrap_or(0.0)
    }

    /// Whether a parameter is defined and not 0.
    pub(super) fn has(&self, name: &str) -> bool {
        self.numbers.contains_key(name)
    }

    /// Returns the prime meridian in degrees.
    pub(super) fn meridian(&self) -> f64 {
        self.meridian
    }

    /// Whether this is Web Mercator on a sphere with a radius, for coordinates in WGS 84.
    pub(super) fn is_web_mercator(&self, radius: f64) -> bool {
        let is_plain =
            self.numbers.is_empty() && self.words.is_empty() && self.unit == 1.0 && self.meridian == 0.0;
        self.method == "webmerc" && is_plain && self.ellipsoid[0] == radius && self.datum == Datum::Wgs84
    }

    /// Whether two formulas are the same.
    pub(super) fn is_same(&self, other: &Formula) -> bool {
        let near = |a: f64, b: f64, bound: f64| (a - b).abs() <= bound;
        let numbers = |((own, a), (name, b)): ((&String, &f64), (&String, &f64))| {
            let bound = match own.as_str() {
                "x_0" | "y_0" => LENGTH,
                "k" => SCALE,
                _ => ANGLE,
            };
            own == name && near(*a, *b, bound)
        };
        self.method == other.method
            && self.words == other.words
            && self.numbers.len() == other.numbers.len()
            && self.numbers.iter().zip(&other.numbers).all(numbers)
            && (0..2).all(|axis| near(self.ellipsoid[axis], other.ellipsoid[axis], LENGTH))
            && near(self.meridian, other.meridian, ANGLE)
            && near(self.unit, other.unit, SCALE)
            && self.datum.words() == other.datum.words()
    }
}
