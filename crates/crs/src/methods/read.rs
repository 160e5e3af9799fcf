//! Projection methods as they are in definitions.

use super::Need::*;
use super::WordMapping::*;
use super::table::METHODS;
use super::{Method, Role, Values};
use crate::projection::axis::Axis;

/// Normalizes a name to lower-case letters and digits, as in the tables.
pub(crate) fn key(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}

/// Returns the method with a name.
pub(crate) fn find(name: &str) -> Option<&'static Method> {
    let key = key(name);
    METHODS.iter().find(|method| method.names.contains(&key.as_str()))
}

/// Returns the method with a number in GeoTIFF keys.
pub(crate) fn coded(number: u16) -> Option<&'static Method> {
    METHODS.iter().find(|method| number != 0 && method.key == number && !method.names.is_empty())
}

impl Method {
    /// Returns the parameter with a name.
    pub(crate) fn role(&self, name: &str) -> Option<&'static Role> {
        let key = key(name);
        self.roles.iter().copied().flatten().find(|role| role.names.contains(&key.as_str()))
    }

    /// Returns PROJ's words for the method, under the given name, and for its parameters, in a
    /// system with the given axes.
    pub(crate) fn read_words(
        &self,
        name: &str,
        values: Values,
        axes: &[Axis],
    ) -> Result<(&'static str, Values), String> {
        let mut whole = Values::new();
        for Role { word, need, names, .. } in self.roles.iter().copied().flatten() {
            let given = values.iter().find(|(own, _)| own == word).map(|(_, value)| *value);
            let parameter = names.first().unwrap_or(word);
            match (need, given) {
                (Required | Or(_) | Free, Some(value)) => whole.push((*word, value)),
                (Or(value), None) => whole.push((*word, *value)),
                (Free | Only(_), None) => {}
                (Only(value), Some(given)) if (given - value).abs() < 1e-9 => {}
                (Only(_), Some(given)) => {
                    return Err(format!("the method {name} with the {parameter} {given:?}"));
                }
                (Required, None) => return Err(format!("the method {name} without a {parameter}")),
            }
        }
        let goes_east = axes.first().is_some_and(|axis| axis.direction == "east");
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
        let words = match self.form {
            Plain => self.word(),
            South => self.words,
            OneParallel => {
                whole.push(("lat_1", lat_0));
                self.word()
            }
            OneOrTwoParallels => {
                let fits = if get("lat_2").is_some() { scale == 1.0 } else { get("lat_1") == Some(lat_0) };
                if !fits {
                    return Err(format!("the method {name} with a scale apart from its parallels"));
                }
                self.word()
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
                self.word()
            }
            Pole(pole) => {
                if get("lat_ts").is_none_or(|parallel| parallel * pole <= 0.0) {
                    return Err(format!("the method {name} with its parallel beyond the equator"));
                }
                whole.push(("lat_0", pole));
                self.word()
            }
            ObliqueOrigin | ObliqueCentre => {
                let alpha = get("alpha").unwrap_or_default();
                let gamma = get("gamma").unwrap_or(alpha);
                whole.retain(|(word, _)| *word != "gamma");
                whole.push(("gamma", gamma));
                let is_swiss = (alpha - 90.0).abs() < 1e-4 && (gamma - 90.0).abs() < 1e-4;
                match (self.form, is_swiss) {
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
            Krovak => {
                let [x, y, turn] = ["x_scale", "y_scale", "turn"].map(|word| get(word).unwrap_or_default());
                whole.retain(|(word, _)| !["x_scale", "y_scale", "turn"].contains(word));
                // (In GDAL's variant the axes decide.)
                match [x, y, turn] {
                    [-1.0, 1.0, 90.0] => self.word(),
                    [1.0, 1.0, 0.0] if goes_east => self.word(),
                    [1.0, 1.0, 0.0] => self.words,
                    _ => {
                        let found = format!("axes times {x:?} and {y:?}, turned by {turn:?} degrees");
                        return Err(format!("the method {name} with {found}"));
                    }
                }
            }
        };
        Ok((words, whole))
    }

    /// Whether the axes have the directions that the method computes: east and north, or west and
    /// south for some methods.
    pub(crate) fn takes(&self, axes: &[Axis], values: &Values) -> bool {
        let get = |word: &str| values.iter().find(|(own, _)| *own == word).map_or(0.0, |(_, value)| *value);
        let (pole, meridian) = (get("lat_0"), get("lon_0"));
        // In polar systems both axes point north or both point south. The easting runs along the
        // meridian 90 degrees from the central one. In the output of many programs it runs along
        // the meridian of 90 degrees for any central meridian.
        let is_along = |axis: &Axis, degrees: f64| {
            axis.meridian.is_some_and(|own| ((own - degrees).rem_euclid(360.0) - 180.0).abs() > 180.0 - 1e-6)
        };
        let is_polar = |[first, second]: [&Axis; 2]| {
            let straight = if pole > 0.0 { 180.0 } else { 0.0 };
            let has_quarter = is_along(first, meridian + 90.0);
            match (first.meridian, second.meridian) {
                (None, None) => ["easting", "e", "x"].contains(&key(&first.name).as_str()),
                // (PROJ takes the second axis for the easting then.)
                _ if is_along(first, straight) && is_along(second, 90.0) => !has_quarter,
                _ => has_quarter || is_along(first, 90.0) && is_along(second, straight),
            }
        };
        let directions: Vec<_> = axes.iter().map(|axis| axis.direction.as_str()).collect();
        match directions[..] {
            [] => true,
            ["west", "south", ..] => self.form == South,
            ["south", "west", ..] => self.form == Krovak,
            ["east", "north", ..] | ["north", "east", ..] => self.form != South,
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
            let names: Vec<_> = method.roles.iter().copied().flatten().flat_map(|role| role.names).collect();
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
