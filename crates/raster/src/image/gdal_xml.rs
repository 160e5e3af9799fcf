//! GDAL's XML metadata of an image and its channels, for the TIFF tag GDAL_METADATA and for
//! sidecars.

use std::collections::BTreeMap;
use std::fmt::Write;

use spinney_base::value::{Number, SampleType};
use spinney_container::{Metadata, Tag};
use spinney_crs::Crs;

/// Upper bound of the values in a list of categories, which has a line for each value from 0 on.
const CATEGORIES: i64 = 1 << 16;

/// Content of the tag GDAL_METADATA, or `None` without metadata. `with_classes` adds an attribute
/// table with the names of values, which not all programs read from there.
pub(super) fn metadata(metadata: &Metadata, with_classes: bool) -> Option<String> {
    let mut xml = String::new();
    for (name, value) in &metadata.tags {
        // These have tags of their own.
        if !name.starts_with("TIFFTAG_") && name != "AREA_OR_POINT" && name != Tag::ColourRoles.key() {
            push_item(&mut xml, (name, value), "", "");
        }
    }
    for (scope, tags) in &metadata.scoped_tags {
        let sample = scope.channel.map_or(String::new(), |channel| format!(" sample=\"{channel}\""));
        for (name, value) in tags {
            push_item(&mut xml, (name, value), &sample, &scope.domain);
        }
    }
    let roles = metadata.colour_roles();
    let channels =
        [metadata.band_names.len(), metadata.units.len(), metadata.scale_offset.len(), roles.len()];
    for channel in 0..channels.into_iter().max().unwrap_or(0) {
        let mut push = |name: &str, value: &str| {
            let place = format!(" sample=\"{channel}\" role=\"{}\"", name.to_lowercase());
            push_item(&mut xml, (name, value), &place, "");
        };
        if let Some(role) = roles.get(channel) {
            push("COLORINTERP", role);
        }
        if let Some((scale, offset)) = metadata.scale_offset.get(channel).filter(|pair| **pair != (1.0, 0.0))
        {
            push("OFFSET", &offset.to_string());
            push("SCALE", &scale.to_string());
        }
        for (name, strings) in [("UNITTYPE", &metadata.units), ("DESCRIPTION", &metadata.band_names)] {
            if let Some(text) = strings.get(channel).filter(|text| !text.is_empty()) {
                push(name, text);
            }
        }
    }
    if with_classes && !metadata.class_names.is_empty() {
        push_attribute_table(&mut xml, &metadata.class_names);
    }
    (!xml.is_empty()).then(|| format!("<GDALMetadata>\n{xml}</GDALMetadata>\n"))
}

/// Content of a sidecar with a coordinate system and the names of values, or `None` if there is
/// neither.
pub(super) fn sidecar(metadata: &Metadata, crs: Option<&Crs>) -> Option<String> {
    let mut xml = String::new();
    if let Some(crs) = crs {
        let _ = writeln!(xml, "  <SRS>{}</SRS>", escaped(&crs.definition()));
    }
    push_names(&mut xml, &metadata.class_names);
    (!xml.is_empty()).then(|| format!("<PAMDataset>\n{xml}</PAMDataset>\n"))
}

/// Adds the names of values, if there are any.
fn push_names(xml: &mut String, names: &BTreeMap<Number, String>) {
    let (Some(first), Some(last)) = (names.keys().next().copied(), names.keys().next_back().copied()) else {
        return;
    };
    *xml += "  <PAMRasterBand band=\"1\">\n";
    if first >= Number::default()
        && last < CATEGORIES.into()
        && names.keys().all(|value| value.to_integer().is_some())
    {
        *xml += "    <CategoryNames>\n";
        for value in (0..CATEGORIES).take_while(|value| Number::from(*value) <= last) {
            let name = names.get(&value.into()).map(String::as_str).unwrap_or_default();
            let _ = writeln!(xml, "      <Category>{}</Category>", escaped(name));
        }
        *xml += "    </CategoryNames>\n";
    } else {
        push_attribute_table(xml, names);
    }
    *xml += "  </PAMRasterBand>\n";
}

/// Adds an item. `place` is a list of attributes that is written unchanged.
fn push_item(xml: &mut String, (name, value): (&str, &str), place: &str, domain: &str) {
    let name = escaped(name);
    let domain = if domain.is_empty() { String::new() } else { format!(" domain=\"{}\"", escaped(domain)) };
    // GDAL escapes values twice, and reads them so.
    let value = escaped(&escaped(value));
    let _ = writeln!(xml, "  <Item name=\"{name}\"{place}{domain}>{value}</Item>");
}

/// Adds an attribute table with one row per value and its name.
fn push_attribute_table(xml: &mut String, names: &BTreeMap<Number, String>) {
    // GDAL's codes: column type 0 is 32-bit integers, 1 floating-point numbers, 2 strings; usage is
    // 5 for values and 2 for names.
    let are_small = names.keys().all(|value| SampleType::I32.can_hold(*value));
    *xml += "  <GDALRasterAttributeTable tableType=\"thematic\">\n";
    for (index, name, kind, usage) in [(0, "Value", if are_small { 0 } else { 1 }, 5), (1, "Class", 2, 2)] {
        let _ = writeln!(
            xml,
            "    <FieldDefn index=\"{index}\"><Name>{name}</Name><Type>{kind}</Type><Usage>{usage}</Usage></FieldDefn>"
        );
    }
    for (row, (value, name)) in names.iter().enumerate() {
        let _ = writeln!(xml, "    <Row index=\"{row}\"><F>{value}</F><F>{}</F></Row>", escaped(name));
    }
    *xml += "  </GDALRasterAttributeTable>\n";
}

/// Escapes a string for an element or attribute. Drops NUL, which would end a tag.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\0' => {}
            character => out.push(character),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_equals_that_of_gdal() {
        let mut about = Metadata { band_names: vec!["".into(), "a<b".into()], ..Metadata::default() };
        about.units = vec!["m".into()];
        about.scale_offset = vec![(1.0, 0.0), (0.5, -1e-3)];
        about.tags = [("k\"".into(), "&\0".into()), ("TIFFTAG_SOFTWARE".into(), "s".into())].into();
        let expected = "<GDALMetadata>\n  <Item name=\"k&quot;\">&amp;amp;</Item>\n  \
            <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">m</Item>\n  \
            <Item name=\"OFFSET\" sample=\"1\" role=\"offset\">-0.001</Item>\n  \
            <Item name=\"SCALE\" sample=\"1\" role=\"scale\">0.5</Item>\n  \
            <Item name=\"DESCRIPTION\" sample=\"1\" role=\"description\">a&amp;lt;b</Item>\n</GDALMetadata>\n";
        assert_eq!(metadata(&about, true).as_deref(), Some(expected));
        assert_eq!(metadata(&Metadata::default(), true), None);
    }

    #[test]
    fn class_names_of_small_values_are_categories() {
        let with =
            |value: Number| Metadata { class_names: [(value, "a & b".into())].into(), ..Metadata::default() };
        let lines =
            |value: u64| sidecar(&with(value.into()), None).map(|xml| xml.matches("<Category>").count());
        assert_eq!([0, 2, 65535].map(lines), [Some(1), Some(3), Some(65536)]);
        for value in [Number::from(-1), 65536.into(), i64::MIN.into(), u64::MAX.into()] {
            let xml = sidecar(&with(value), None).unwrap();
            assert!(xml.contains(&format!("<F>{value}</F><F>a &amp; b</F>")), "{xml}");
        }
        assert_eq!(sidecar(&Metadata::default(), None), None);
    }
}
