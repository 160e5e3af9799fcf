//! Geographic systems of the EPSG registry.

use super::geodetic::{Ellipsoid, esri_name, meridian_numbered};
use super::geographic_table::{GEOGRAPHIC, Row};

/// A geographic system with two axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Geographic {
    pub(crate) number: u16,
    pub(crate) name: &'static str,
    pub(crate) datum_name: &'static str,
    /// Esri's names of the datum and of the system; empty if they are the registry's names with
    /// underscores.
    esri: [&'static str; 2],
    ellipsoid: u16,
    meridian: u16,
}

impl Geographic {
    /// Returns the system with an EPSG code.
    pub(crate) fn find(number: u16) -> Option<Geographic> {
        let index = GEOGRAPHIC.binary_search_by_key(&number, |row| row.0).ok()?;
        Some(Geographic::of_row(GEOGRAPHIC[index]))
    }

    /// Returns the first system whose datum has an EPSG code.
    pub(crate) fn of_datum(number: u16) -> Option<Geographic> {
        GEOGRAPHIC.iter().find(|row| row.2 == number).map(|row| Geographic::of_row(*row))
    }

    /// Returns the first matching system whose datum has a name in the registry or in Esri's list.
    /// `key` normalizes names.
    pub(crate) fn of_datum_named(
        name: &str,
        key: impl Fn(&str) -> String,
        fits: impl Fn(&Geographic) -> bool,
    ) -> Option<Geographic> {
        let wanted = key(name);
        let is_named = |row: &&Row| key(row.3) == wanted || !row.4.is_empty() && key(row.4) == wanted;
        GEOGRAPHIC.iter().filter(is_named).map(|row| Geographic::of_row(*row)).find(fits)
    }

    fn of_row((number, name, _, datum_name, esri_datum, esri, ellipsoid, meridian): Row) -> Geographic {
        Geographic { number, name, datum_name, esri: [esri_datum, esri], ellipsoid, meridian }
    }

    pub(crate) fn ellipsoid(&self) -> Option<&'static Ellipsoid> {
        Ellipsoid::find(self.ellipsoid)
    }

    /// Returns the name of the prime meridian, and its degrees east of Greenwich.
    pub(crate) fn meridian(&self) -> Option<(&'static str, f64)> {
        meridian_numbered(self.meridian)
    }

    /// Whether longitude is the first axis.
    pub(crate) fn is_longitude_first(&self) -> bool {
        self.name.ends_with("(lon-lat)")
    }

    pub(crate) fn esri_datum(&self) -> String {
        esri_name(self.esri[0], self.datum_name)
    }

    pub(crate) fn esri_name(&self) -> String {
        esri_name(self.esri[1], self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_sorted_and_have_their_ellipsoids_and_meridians() {
        assert!(GEOGRAPHIC.is_sorted_by_key(|row| row.0));
        for row in GEOGRAPHIC {
            let known = Geographic::find(row.0).unwrap();
            assert!(known.ellipsoid().is_some() && known.meridian().is_some(), "{known:?}");
        }
    }

    #[test]
    fn names_of_esri() {
        let known = |number| Geographic::find(number).unwrap();
        assert_eq!(known(4326).esri_datum(), "WGS_1984");
        assert_eq!(known(4267).esri_datum(), "North_American_1927");
        assert_eq!(known(4269).esri_name(), "North_American_1983");
        assert_eq!(esri_name("", "NTF (Paris)"), "NTF_Paris");
        assert_eq!(Geographic::of_datum(6267).unwrap().number, 4267);
    }
}
