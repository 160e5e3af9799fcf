//! Attribute names that a format allows.

use std::collections::{BTreeMap, BTreeSet};

use super::{AttributeType, VectorFormat};

/// Maximum size of a field name in a dBASE table, in bytes.
const SHORT: usize = 10;

/// Naming rule of a format.
struct Rule {
    /// Whether a character is allowed.
    allows: fn(char) -> bool,
    /// Maximum size in bytes.
    most: usize,
    /// Reserved names.
    taken: &'static [&'static str],
    /// Whether names are case-insensitive.
    folds_case: bool,
}

impl Rule {
    fn of(format: VectorFormat) -> Rule {
        let any = Rule { allows: |_| true, most: usize::MAX, taken: &[], folds_case: false };
        let is_plain = |letter: char| !letter.is_control();
        let is_word = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
        match format {
            VectorFormat::GeoJson | VectorFormat::FlatGeobuf => any,
            VectorFormat::Csv => Rule { taken: &["WKT", "wkt"], ..any },
            VectorFormat::Obj => Rule { allows: is_plain, ..any },
            VectorFormat::Svg => Rule { allows: is_word, ..any },
            VectorFormat::Ply => Rule { allows: is_word, taken: &["vertex1", "vertex2", "feature"], ..any },
            VectorFormat::GeoPackage => Rule { taken: &["fid", "geom"], folds_case: true, ..any },
            VectorFormat::Shapefile => Rule { allows: is_plain, most: SHORT, taken: &[], folds_case: true },
        }
    }

    /// Returns the key of a name; the format considers names with equal keys identical.
    fn key(&self, name: &str) -> String {
        if self.folds_case { name.to_lowercase() } else { name.into() }
    }
}

/// Converts attribute names to unique names that the format allows. Invalid characters become
/// underscores, long names are truncated, and duplicates get a number at the end.
pub(super) fn of(format: VectorFormat, attributes: &[(String, AttributeType)]) -> Vec<String> {
    let rule = Rule::of(format);
    let mut taken: BTreeSet<String> = rule.taken.iter().map(|name| (*name).to_owned()).collect();
    // Remember the last number per prefix, since there may be very many duplicates.
    let mut last: BTreeMap<String, u64> = BTreeMap::new();
    let mut name_of = |own: &str| {
        let letters = own.chars().map(|letter| if (rule.allows)(letter) { letter } else { '_' });
        let plain: String = letters.collect();
        // JSON allows empty names.
        let needs_one = plain.is_empty() && !matches!(format, VectorFormat::GeoJson);
        let plain = if needs_one { "_".into() } else { plain };
        let mut name = cut(&plain, rule.most).to_owned();
        let number = last.entry(rule.key(&name)).or_insert(1);
        while !taken.insert(rule.key(&name)) {
            *number += 1;
            let end = format!("_{number}");
            name = format!("{}{end}", cut(&plain, rule.most.saturating_sub(end.len())));
        }
        name
    };
    attributes.iter().map(|(name, _)| name_of(name)).collect()
}

/// Truncates a string to at most `most` bytes.
pub(super) fn cut(text: &str, most: usize) -> &str {
    let end = (0..=most.min(text.len())).rev().find(|end| text.is_char_boundary(*end));
    &text[..end.unwrap_or(0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(format: VectorFormat, names: &[&str]) -> Vec<String> {
        let attributes: Vec<_> =
            names.iter().map(|name| ((*name).to_owned(), AttributeType::Integer)).collect();
        of(format, &attributes)
    }

    #[test]
    fn names_are_those_of_the_format() {
        let own = ["population_total", "population_totals", "Größenklasse", "name", "NAME", "fid", "a b", ""];
        assert_eq!(named(VectorFormat::GeoJson, &own), own);
        assert_eq!(
            named(VectorFormat::Shapefile, &own),
            ["population", "populati_2", "Größenkl", "name", "NAME_2", "fid", "a b", "_"]
        );
        assert_eq!(named(VectorFormat::GeoPackage, &own)[3..], ["name", "NAME_2", "fid_2", "a b", "_"]);
        assert_eq!(named(VectorFormat::Svg, &["a b", "a_b", "ä"]), ["a_b", "a_b_2", "_"]);
        assert_eq!(named(VectorFormat::Ply, &["feature"]), ["feature_2"]);
        // Many names with the same prefix.
        let many: Vec<String> = (0..1200).map(|number| format!("statistics_{number}")).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        let names = named(VectorFormat::Shapefile, &many);
        assert_eq!(names[..3], ["statistics", "statisti_2", "statisti_3"]);
        assert!(names.iter().all(|name| name.len() <= SHORT));
        assert_eq!(names.iter().collect::<std::collections::BTreeSet<_>>().len(), many.len());
    }
}
