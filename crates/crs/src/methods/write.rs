//! Projection methods under the names of each format.

use super::table::METHODS;
use super::{Measure, Method, Values};

/// A parameter with its value in degrees, metres or ones.
pub(crate) struct Parameter<N> {
    pub(crate) name: N,
    pub(crate) measure: Measure,
    pub(crate) value: f64,
}

fn value(values: &Values, word: &str) -> Option<f64> {
    values.iter().find(|(own, _)| *own == word).map(|(_, value)| *value)
}

/// Returns the latitude of the pole of a polar stereographic projection, and `None` for other
/// projections.
pub(crate) fn pole(words: &str, values: &Values) -> Option<f64> {
    let latitude = value(values, "lat_0").filter(|latitude| (latitude.abs() - 90.0).abs() < 1e-10)?;
    (words == "+proj=stere").then_some(latitude)
}

/// Returns the method for PROJ's words and parameters.
pub(crate) fn find_words(words: &str, values: &Values) -> Result<&'static Method, String> {
    let has = |word| value(values, word).is_some();
    let name = words.strip_prefix("+proj=").unwrap_or(words);
    let variant = match name {
        "lcc" if has("lat_2") => "lcc 2",
        "lcc" => "lcc 1",
        "merc" if value(values, "lat_ts").is_some_and(|parallel| parallel != 0.0) => "merc parallel",
        "stere" if pole(words, values).is_none() => "stere",
        "stere" if has("lat_ts") => "stere parallel",
        "stere" => "stere pole",
        "eqc" if value(values, "lat_0").is_some_and(|latitude| latitude != 0.0) => {
            return Err("the method Equidistant Cylindrical with a latitude of origin".into());
        }
        other => other,
    };
    METHODS
        .iter()
        .find(|method| method.words.strip_prefix("+proj=") == Some(variant) && !method.name.is_empty())
        .ok_or_else(|| format!("the method {words}"))
}

/// Returns PROJ's words for the parameters of a method, except those of the false origin. `None` if
/// the method does not exist.
pub(crate) fn words_of(name: &str) -> Option<Vec<&'static str>> {
    let methods = METHODS.iter().filter(|method| method.word().strip_prefix("+proj=") == Some(name));
    let words = methods.flat_map(|method| method.parameters).map(|(word, ..)| *word);
    let words: Vec<_> =
        words.filter(|word| word.parse::<f64>().is_err() && !["x_0", "y_0"].contains(word)).collect();
    (!words.is_empty()).then_some(words)
}

impl Method {
    /// Returns the parameters with their names and EPSG codes in WKT 2.
    pub(crate) fn parameters<'a>(
        &self,
        values: &'a Values,
    ) -> impl Iterator<Item = Parameter<(&'static str, u16)>> + 'a {
        self.parameters.iter().map(|(word, name, number)| parameter(values, word, (*name, *number)))
    }

    /// Returns the parameters with Esri's names.
    pub(crate) fn esri_parameters(
        &self,
        values: &Values,
    ) -> Result<(&'static str, Vec<Parameter<&'static str>>), String> {
        let of_mercator =
            self.words == "+proj=merc" && value(values, "k_0").is_some_and(|scale| scale != 1.0);
        if self.esri.is_empty() || of_mercator {
            return Err(format!("the method {}, which Esri's WKT has not", self.name));
        }
        let is_south = self.words == "+proj=stere parallel" && value(values, "lat_0") == Some(-90.0);
        let name = if is_south { "Stereographic_South_Pole" } else { self.esri };
        Ok((name, self.esri_parameters.iter().map(|(word, name)| parameter(values, word, *name)).collect()))
    }

    /// Returns the parameters with their GeoTIFF keys.
    pub(crate) fn keys<'a>(&self, values: &'a Values) -> impl Iterator<Item = Parameter<u16>> + 'a {
        self.keys.iter().map(|(word, key)| parameter(values, word, *key))
    }
}

/// Creates a parameter from PROJ's word or from a constant value.
fn parameter<N>(values: &Values, word: &str, name: N) -> Parameter<N> {
    if let Ok(value) = word.parse() {
        return Parameter {
            name,
            measure: if value == 1.0 { Measure::Scale } else { Measure::Angle },
            value,
        };
    }
    let given = value(values, word);
    let (measure, value) = match word {
        "k_0" => (Measure::Scale, given.unwrap_or(1.0)),
        "x_0" | "y_0" => (Measure::Length, given.unwrap_or(0.0)),
        // (The default rotation of the grid is the azimuth.)
        "gamma" => (Measure::Angle, given.or(value(values, "alpha")).unwrap_or(0.0)),
        _ => (Measure::Angle, given.unwrap_or(0.0)),
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
            assert!(find_words(&format!("+proj={name}"), &Values::new()).is_ok(), "{name}");
        }
    }
}
