//! GeoTIFF keys, which define coordinate reference systems (OGC 19-008r4).

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use super::epsg::is_geographic;
use super::{Epsg, number_text, unit_of_angle, unit_of_length};

/// Key numbers, with names as in GeoTIFF 1.1.
pub(crate) mod key {
    pub(crate) const MODEL_TYPE: u16 = 1024;
    pub(crate) const RASTER_TYPE: u16 = 1025;
    pub(crate) const CITATION: u16 = 1026;
    pub(crate) const GEODETIC_CRS: u16 = 2048;
    pub(crate) const GEODETIC_CITATION: u16 = 2049;
    pub(crate) const GEODETIC_DATUM: u16 = 2050;
    pub(crate) const PRIME_MERIDIAN: u16 = 2051;
    pub(crate) const ANGULAR_UNITS: u16 = 2054;
    pub(crate) const ANGULAR_UNIT_SIZE: u16 = 2055;
    pub(crate) const ELLIPSOID: u16 = 2056;
    pub(crate) const SEMI_MAJOR_AXIS: u16 = 2057;
    pub(crate) const SEMI_MINOR_AXIS: u16 = 2058;
    pub(crate) const INVERSE_FLATTENING: u16 = 2059;
    pub(crate) const PRIME_MERIDIAN_LONGITUDE: u16 = 2061;
    pub(crate) const TO_WGS84: u16 = 2062;
    pub(crate) const PROJECTED_CRS: u16 = 3072;
    pub(crate) const PROJECTED_CITATION: u16 = 3073;
    pub(crate) const PROJECTION: u16 = 3074;
    pub(crate) const PROJECTION_METHOD: u16 = 3075;
    pub(crate) const LINEAR_UNITS: u16 = 3076;
    pub(crate) const LINEAR_UNIT_SIZE: u16 = 3077;
    pub(crate) const FALSE_EASTING: u16 = 3082;
    pub(crate) const FALSE_NORTHING: u16 = 3083;
    pub(crate) const VERTICAL: u16 = 4096;
    pub(crate) const VERTICAL_CITATION: u16 = 4097;
    pub(crate) const VERTICAL_DATUM: u16 = 4098;
    pub(crate) const VERTICAL_UNITS: u16 = 4099;
}

// Values of the model type.
pub(crate) const PROJECTED: u16 = 1;
pub(crate) const GEOGRAPHIC: u16 = 2;
const GEOCENTRIC: u16 = 3;

/// EPSG codes of units.
mod unit {
    pub(super) const METRE: u16 = 9001;
    pub(super) const FOOT: u16 = 9002;
    pub(super) const US_FOOT: u16 = 9003;
    pub(super) const KILOMETRE: u16 = 9036;
    pub(super) const DEGREE: u16 = 9102;
    /// Degrees in any notation.
    pub(super) const SOME_DEGREE: u16 = 9122;
}

/// Value of a key that other keys define.
pub(crate) const USER_DEFINED: u16 = 32767;

/// Tags that contain the values of keys. (With tag 0, the entry itself contains the value.)
const DOUBLES_TAG: u16 = 34736;
const STRINGS_TAG: u16 = 34737;

/// Maximum number of keys that are read; the specification has fewer than a hundred.
const MAX_KEYS: usize = 1024;
/// Maximum total number of doubles and bytes of strings in the values of all keys.
const BUDGET: usize = 1 << 18;

/// The keys of a GeoTIFF file that define its coordinate reference system, unchanged: all keys
/// except the raster type, which is about pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GeoKeys {
    /// Version, revision and minor revision of the directory.
    version: [u16; 3],
    /// Key, tag, count, and value or index in the tag.
    entries: Vec<[u16; 4]>,
    doubles: Vec<f64>,
    /// Without the NUL at the end.
    #[serde(rename = "texts")]
    strings: Vec<u8>,
}

/// Builder of keys, which may be added in any order.
#[derive(Default)]
pub(crate) struct GeoKeysBuilder {
    entries: BTreeMap<u16, [u16; 3]>,
    doubles: Vec<f64>,
    strings: Vec<u8>,
}

impl GeoKeysBuilder {
    pub(crate) fn number(&mut self, key_number: u16, value: u16) {
        self.entries.insert(key_number, [0, 1, value]);
    }

    pub(crate) fn double(&mut self, key_number: u16, values: &[f64]) {
        // (A system has at most about thirty of them.)
        self.entries.insert(key_number, [DOUBLES_TAG, values.len() as u16, self.doubles.len() as u16]);
        self.doubles.extend(values);
    }

    /// Adds a string. Removes characters that are not printable ASCII, as the format requires, and
    /// shortens it to 400 characters.
    pub(crate) fn text(&mut self, key_number: u16, text: &str) {
        let text: String = text.chars().filter(|c| c.is_ascii() && !c.is_ascii_control()).take(400).collect();
        let start = self.strings.len() as u16;
        self.strings.extend(text.bytes().chain(*b"|"));
        self.entries.insert(key_number, [STRINGS_TAG, text.len() as u16 + 1, start]);
    }

    pub(crate) fn finish(self) -> GeoKeys {
        let entries =
            self.entries.into_iter().map(|(key_number, [tag, count, value])| [key_number, tag, count, value]);
        GeoKeys {
            version: [1, 1, 0],
            entries: entries.collect(),
            doubles: self.doubles,
            strings: self.strings,
        }
    }
}

/// The value of a key.
enum KeyValue<'a> {
    Number(u16),
    Doubles(&'a [f64]),
    Text(&'a [u8]),
    /// The entry of a value that is in other tags, or beyond the end of a tag.
    Unresolved(&'a [u16; 4]),
}

impl GeoKeys {
    /// Creates keys from the values of the tags GeoKeyDirectory, GeoDoubleParams and
    /// GeoAsciiParams. `None` if no key defines a coordinate reference system.
    ///
    /// Entries beyond the directory's own count are ignored. Of the other values, only those that
    /// keys can refer to are kept, so untrusted files use at most 1 MiB.
    pub fn new(directory: &[u16], doubles: &[f64], strings: &[u8]) -> Option<GeoKeys> {
        /// Range of values that keys can refer to, by an index and a count of 16 bits each.
        const REACH: usize = 2 * (u16::MAX as usize);
        let (entries, _) = directory.as_chunks::<4>();
        let ([version, revision, minor, count], entries) = entries.split_first()?;
        let entries = entries.iter().take(usize::from(*count).min(MAX_KEYS));
        let entries = entries.filter(|[number, ..]| *number != key::RASTER_TYPE).copied().collect();
        let end = strings.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        let keys = GeoKeys {
            version: [*version, *revision, *minor],
            entries,
            doubles: doubles[..doubles.len().min(REACH)].to_vec(),
            strings: strings[..end.min(REACH)].to_vec(),
        };
        let says = |[number, ..]: &[u16; 4]| ![0, key::MODEL_TYPE].contains(number);
        keys.entries.iter().any(says).then_some(keys)
    }

    /// Returns the keys for EPSG codes, or `None` if the codes do not fit into keys.
    pub fn of_epsg(epsg: Epsg) -> Option<GeoKeys> {
        let Epsg { horizontal, vertical } = epsg.in_parts();
        let number =
            |number: u32| u16::try_from(number).ok().filter(|number| (1024..USER_DEFINED).contains(number));
        let horizontal = number(horizontal)?;
        let (model, key_number) = match is_geographic(horizontal) {
            true => (GEOGRAPHIC, key::GEODETIC_CRS),
            false => (PROJECTED, key::PROJECTED_CRS),
        };
        let mut entries = vec![[key::MODEL_TYPE, 0, 1, model], [key_number, 0, 1, horizontal]];
        if let Some(vertical) = vertical {
            entries.push([key::VERTICAL, 0, 1, number(vertical)?]);
        }
        // Readers support EPSG codes of vertical systems from GeoTIFF 1.1 on.
        let minor = u16::from(vertical.is_some());
        Some(GeoKeys { version: [1, 1, minor], entries, doubles: Vec::new(), strings: Vec::new() })
    }

    /// Returns the value of the tag GeoKeyDirectory, including a key for the raster type.
    pub fn directory(&self, raster_type: u16) -> Vec<u16> {
        let mut entries: Vec<_> = self.entries.iter().take(MAX_KEYS).copied().collect();
        let index =
            entries.iter().position(|[number, ..]| *number > key::RASTER_TYPE).unwrap_or(entries.len());
        entries.insert(index, [key::RASTER_TYPE, 0, 1, raster_type]);
        let [version, revision, minor] = self.version;
        entries.insert(0, [version, revision, minor, entries.len() as u16]);
        entries.concat()
    }

    /// Returns the value of the tag GeoDoubleParams.
    pub fn doubles(&self) -> &[f64] {
        &self.doubles
    }

    /// Returns the value of the tag GeoAsciiParams, without the NUL at its end.
    pub fn strings(&self) -> &[u8] {
        &self.strings
    }

    /// Iterates over all keys in order, with their values.
    fn values(&self) -> impl Iterator<Item = (u16, KeyValue<'_>)> {
        // (Limited to what real files have, because many keys may share the same values.)
        let mut budget = BUDGET;
        self.entries.iter().take(MAX_KEYS).map(move |entry| {
            let [number, _, count, _] = *entry;
            let value = match self.value(entry) {
                value @ KeyValue::Number(_) => value,
                value if usize::from(count) <= budget => {
                    budget -= usize::from(count);
                    value
                }
                _ => KeyValue::Unresolved(entry),
            };
            (number, value)
        })
    }

    fn value<'a>(&'a self, entry: &'a [u16; 4]) -> KeyValue<'a> {
        let [_, tag, count, value] = *entry;
        let start = usize::from(value);
        let end = start + usize::from(count);
        match tag {
            0 => KeyValue::Number(value),
            DOUBLES_TAG => {
                self.doubles.get(start..end).map_or(KeyValue::Unresolved(entry), KeyValue::Doubles)
            }
            // (Some writers count one byte too many.)
            STRINGS_TAG => match self.strings.get(start..end.min(self.strings.len())) {
                Some(text) => KeyValue::Text(text),
                None => KeyValue::Unresolved(entry),
            },
            _ => KeyValue::Unresolved(entry),
        }
    }

    /// Returns the value of the first entry of a key that has a given kind, as readers do.
    fn find<'a, T>(&'a self, wanted: u16, kind: impl Fn(KeyValue<'a>) -> Option<T>) -> Option<T> {
        let mut entries = self.entries.iter().take(MAX_KEYS).filter(|entry| entry[0] == wanted);
        entries.find_map(|entry| kind(self.value(entry)))
    }

    /// Returns the short value of a key, if it has one.
    pub fn number(&self, wanted: u16) -> Option<u16> {
        self.find(wanted, |value| if let KeyValue::Number(number) = value { Some(number) } else { None })
    }

    /// Returns the first double of a key, if it has one.
    pub fn double(&self, wanted: u16) -> Option<f64> {
        self.doubles_of(wanted)?.first().copied()
    }

    pub(crate) fn doubles_of(&self, wanted: u16) -> Option<&[f64]> {
        self.find(wanted, |value| if let KeyValue::Doubles(values) = value { Some(values) } else { None })
    }

    /// Returns the string of a key, if it has one.
    pub fn text(&self, wanted: u16) -> Option<String> {
        self.find(wanted, |value| if let KeyValue::Text(text) = value { Some(plain(text)) } else { None })
    }

    /// Returns a key's value if it is a code of a registry.
    pub(crate) fn registered(&self, wanted: u16) -> Option<u16> {
        // (0 means undefined.)
        self.number(wanted).filter(|number| (1..USER_DEFINED).contains(number))
    }

    /// Whether a string value contains some words, in lower case.
    fn cites(&self, words: &str) -> bool {
        self.values().any(
            |(_, value)| matches!(value, KeyValue::Text(text) if plain(text).to_lowercase().contains(words)),
        )
    }

    /// ERDAS Imagine writes the code of the metric system for systems in feet.
    fn is_imagine_in_feet(&self) -> bool {
        self.cites("imagine geotiff support") && self.cites("feet")
    }

    fn model(&self) -> Option<u16> {
        let model = self.number(key::MODEL_TYPE).filter(|model| *model != 0);
        let by_keys = [(key::PROJECTED_CRS, PROJECTED), (key::GEODETIC_CRS, GEOGRAPHIC)];
        model.or_else(|| {
            by_keys
                .into_iter()
                .find(|(key_number, _)| self.number(*key_number).is_some())
                .map(|(_, model)| model)
        })
    }

    pub(super) fn epsg(&self) -> Option<Epsg> {
        // Smaller numbers are obsolete, such as those of ellipsoids.
        let number = |wanted| self.registered(wanted).filter(|number| *number >= 1024);
        // Some writers have their own names for Web Mercator.
        let is_web_mercator = self.cites("wgs_1984_web_mercator_auxiliary_sphere")
            || self.number(key::PROJECTION) == Some(3856);
        let horizontal = match self.model() {
            _ if is_web_mercator => return Some(Epsg::new(3857)),
            _ if self.is_imagine_in_feet() => return None,
            Some(PROJECTED) => number(key::PROJECTED_CRS)?,
            Some(GEOGRAPHIC | GEOCENTRIC) => number(key::GEODETIC_CRS)?,
            _ => return None,
        };
        let epsg = Epsg::new(horizontal.into());
        // A unit that differs from the system's unit makes another system.
        let agrees = |unit: Option<&str>| match (unit, epsg.unit()) {
            (Some(unit), Some(known)) => unit == known,
            _ => true,
        };
        if !agrees(if self.model() == Some(PROJECTED) { self.linear_unit() } else { self.angular_unit() }) {
            return None;
        }
        let vertical = match (horizontal, self.number(key::VERTICAL)) {
            (_, None | Some(0)) => return Some(epsg),
            // Heights above the ellipsoid: the code of the three-dimensional system, or the
            // obsolete number of the ellipsoid.
            (4326 | 4979, Some(4979 | 5030)) => return Some(Epsg::new(4979)),
            (_, Some(number)) => number,
        };
        // Numbers of ellipsoids and of sea levels, from before GeoTIFF 1.1.
        let is_obsolete = (5001..=5035).contains(&vertical) || (5101..=5106).contains(&vertical);
        let is_vertical =
            (1024..USER_DEFINED).contains(&vertical) && !is_obsolete && !is_geographic(vertical);
        let in_metres = self.number(key::VERTICAL_UNITS).is_none_or(|unit| unit == unit::METRE);
        (is_vertical && in_metres).then_some(Epsg { vertical: Some(vertical.into()), ..epsg })
    }

    pub(super) fn name(&self) -> Option<String> {
        let names = [key::CITATION, key::PROJECTED_CITATION, key::GEODETIC_CITATION];
        names.into_iter().find_map(|key_number| self.text(key_number))
    }

    /// Returns the unit of the horizontal axes according to the keys.
    pub(super) fn unit(&self) -> Option<&'static str> {
        if self.is_imagine_in_feet() {
            return Some(if self.cites("us_survey_feet") { "us-ft" } else { "ft" });
        }
        match self.model()? {
            GEOGRAPHIC => self.angular_unit(),
            _ => self.linear_unit(),
        }
    }

    fn linear_unit(&self) -> Option<&'static str> {
        match self.number(key::LINEAR_UNITS)? {
            unit::METRE => Some("m"),
            unit::FOOT => Some("ft"),
            unit::US_FOOT => Some("us-ft"),
            unit::KILOMETRE => Some("km"),
            USER_DEFINED => unit_of_length(self.double(key::LINEAR_UNIT_SIZE)?),
            _ => None,
        }
    }

    fn angular_unit(&self) -> Option<&'static str> {
        match self.number(key::ANGULAR_UNITS)? {
            unit::DEGREE | unit::SOME_DEGREE => Some("degrees"),
            USER_DEFINED => unit_of_angle(self.double(key::ANGULAR_UNIT_SIZE)?),
            _ => None,
        }
    }

    /// Returns the length in metres of the horizontal unit, if a citation names it.
    pub(crate) fn metres(&self) -> Option<f64> {
        let unit = self.is_imagine_in_feet().then(|| self.unit())??;
        super::proj_string::metres(unit)
    }

    /// Whether a citation specifies what the keys leave open, so that it belongs to the definition.
    fn defines(&self, key_number: u16, text: &str) -> bool {
        let model = self.model();
        let is_known = |keys: &[u16]| keys.iter().any(|key| self.registered(*key).is_some());
        let plane = || is_known(&[key::PROJECTED_CRS, key::PROJECTION, key::PROJECTION_METHOD]);
        text.starts_with("ESRI PE String")
            || match key_number {
                key::CITATION => match model {
                    Some(PROJECTED) => !plane(),
                    model => !matches!(model, Some(GEOGRAPHIC | GEOCENTRIC)),
                },
                key::PROJECTED_CITATION => model != Some(PROJECTED) || !plane(),
                key::GEODETIC_CITATION => {
                    let by_plane = model == Some(PROJECTED) && is_known(&[key::PROJECTED_CRS]);
                    !by_plane && !is_known(&[key::GEODETIC_CRS, key::GEODETIC_DATUM])
                }
                key::VERTICAL_CITATION => !is_known(&[key::VERTICAL, key::VERTICAL_DATUM]),
                // Not a key of the specification.
                _ => true,
            }
    }

    /// Returns a string that is equal for equivalent keys: sorted by key, without remarks and
    /// default values.
    pub(super) fn normalised(&self) -> String {
        let mut values = BTreeMap::new();
        for (number, value) in self.values() {
            let is_default = match (number, &value) {
                (0, _) => true,
                (key::ANGULAR_UNITS, KeyValue::Number(unit)) => *unit == unit::DEGREE,
                (key::LINEAR_UNITS | key::VERTICAL_UNITS, KeyValue::Number(unit)) => *unit == unit::METRE,
                (
                    key::PRIME_MERIDIAN_LONGITUDE | key::FALSE_EASTING | key::FALSE_NORTHING,
                    KeyValue::Doubles([zero]),
                ) => *zero == 0.0,
                (number, KeyValue::Text(text)) => !self.defines(number, &plain(text)),
                _ => false,
            };
            if !is_default {
                // If a key occurs several times, the first one counts, as for readers.
                values.entry(number).or_insert_with(|| value.to_string());
            }
        }
        values.into_iter().map(|(number, value)| format!("{number}={value} ")).collect()
    }
}

/// Returns a string without its terminators.
fn plain(text: &[u8]) -> String {
    String::from_utf8_lossy(text).trim_end_matches(['|', '\0', ' ']).to_string()
}

impl fmt::Display for KeyValue<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            KeyValue::Number(number) => number.fmt(f),
            KeyValue::Doubles(values) => {
                f.write_str(&values.iter().map(|value| number_text(*value)).collect::<Vec<_>>().join(","))
            }
            KeyValue::Text(text) => write!(f, "{:?}", plain(text)),
            KeyValue::Unresolved([_, tag, count, value]) => write!(f, "@{tag}:{count}:{value}"),
        }
    }
}

/// Formats `NUMBER=VALUE` for each key.
impl fmt::Display for GeoKeys {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let keys: Vec<_> = self.values().map(|(number, value)| format!("{number}={value}")).collect();
        f.write_str(&keys.join(" "))
    }
}
