//! Units of measure by the names used in files.

/// The quantity that a unit measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    Length,
    Temperature,
    Speed,
    Pressure,
    Ratio,
}

/// A unit of measure: `n` units are `n * factor + offset` of the quantity's base unit (m, K, m/s,
/// Pa, 1).
///
/// ```
/// use spinney_container::Unit;
/// let (feet, celsius) = (Unit::parse("Feet").unwrap(), Unit::parse("degC").unwrap());
/// assert_eq!((feet.factor, celsius.offset), (0.3048, 273.15));
/// assert!(Unit::parse("bushels").is_none());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    quantity: Quantity,
    /// Base units per unit.
    pub factor: f64,
    /// Value in base units of zero units.
    pub offset: f64,
}

/// Quantity, factor, offset and lower-case names of a unit.
type Row = (Quantity, f64, f64, &'static [&'static str]);

#[rustfmt::skip]
const UNITS: [Row; 23] = [
    (Quantity::Length, 1.0, 0.0, &["m", "metre", "meter", "metres", "meters"]),
    (Quantity::Length, 0.001, 0.0, &["mm", "millimetre", "millimeter", "millimetres", "millimeters"]),
    (Quantity::Length, 0.01, 0.0, &["cm", "centimetre", "centimeter", "centimetres", "centimeters"]),
    (Quantity::Length, 0.1, 0.0, &["dm", "decimetre", "decimeter", "decimetres", "decimeters"]),
    (Quantity::Length, 1e-6, 0.0, &["um", "µm", "micron", "micrometre", "micrometer", "microns"]),
    (Quantity::Length, 1000.0, 0.0, &["km", "kilometre", "kilometer", "kilometres", "kilometers"]),
    (Quantity::Length, 0.3048, 0.0, &["ft", "foot", "feet", "international foot"]),
    (Quantity::Length, 1200.0 / 3937.0, 0.0, &["us-ft", "us survey foot", "ftus", "sfoot", "us_survey_foot", "foot_us"]),
    (Quantity::Length, 0.0254, 0.0, &["in", "inch", "inches"]),
    (Quantity::Length, 0.9144, 0.0, &["yd", "yard", "yards"]),
    (Quantity::Length, 1609.344, 0.0, &["mi", "mile", "miles"]),
    (Quantity::Length, 1852.0, 0.0, &["nmi", "nautical mile", "nautical miles"]),
    (Quantity::Temperature, 1.0, 0.0, &["k", "kelvin", "degk"]),
    (Quantity::Temperature, 1.0, 273.15, &["degc", "°c", "celsius", "deg c", "degree_celsius", "degrees_celsius", "degrees celsius"]),
    (Quantity::Temperature, 5.0 / 9.0, 459.67 * 5.0 / 9.0, &["degf", "°f", "fahrenheit", "deg f", "degree_fahrenheit", "degrees_fahrenheit"]),
    (Quantity::Speed, 1.0, 0.0, &["m/s", "m s-1", "m s**-1", "metres per second", "meters per second"]),
    (Quantity::Speed, 1.0 / 3.6, 0.0, &["km/h", "kph", "km h-1"]),
    (Quantity::Speed, 1852.0 / 3600.0, 0.0, &["kn", "knot", "knots", "kt"]),
    (Quantity::Pressure, 1.0, 0.0, &["pa", "pascal"]),
    (Quantity::Pressure, 100.0, 0.0, &["hpa", "mbar", "millibar", "hectopascal"]),
    (Quantity::Pressure, 1000.0, 0.0, &["kpa", "kilopascal"]),
    (Quantity::Ratio, 1.0, 0.0, &["1"]),
    (Quantity::Ratio, 0.01, 0.0, &["%", "percent"]),
];

impl Unit {
    /// Returns the unit with this name, ignoring case; `None` if the name is unknown.
    pub fn parse(name: &str) -> Option<Unit> {
        let name = name.trim().to_lowercase();
        let (quantity, factor, offset, _) = *UNITS.iter().find(|(.., names)| names.contains(&&*name))?;
        Some(Unit { quantity, factor, offset })
    }

    /// Metres per unit; `None` if it does not measure length.
    pub fn metres(self) -> Option<f64> {
        (self.quantity == Quantity::Length).then_some(self.factor)
    }

    /// Scale and offset that convert numbers of `other` to this unit; `None` if the two measure
    /// different quantities.
    pub fn from(self, other: Unit) -> Option<(f64, f64)> {
        let is_same = self.quantity == other.quantity;
        is_same.then(|| (other.factor / self.factor, (other.offset - self.offset) / self.factor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_converted() {
        let convert = |from: &str, to: &str, number: f64| {
            let (factor, summand) = Unit::parse(to)?.from(Unit::parse(from)?)?;
            Some(number * factor + summand)
        };
        let close = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-9;
        assert!(close(convert("ft", "M", 100.0), 30.48));
        assert!(close(convert("degF", "°C", 212.0), 100.0));
        assert!(close(convert("K", "degC", 0.0), -273.15));
        assert!(close(convert("hPa", "Pa", 1013.0), 101_300.0));
        assert_eq!(convert("m", "degC", 1.0), None);
        assert_eq!(convert("m", "league", 1.0), None);
    }
}
