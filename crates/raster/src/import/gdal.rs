//! GDAL's XML descriptions of a raster: the TIFF tag GDAL_METADATA, and elements that sidecars have
//! as well.

use super::RasterInfo;
use super::xml::{XmlElement, unescaped};
use spinney_base::value::{Number, SampleType};
use spinney_container::TagScope;

/// Domains about the file or its pixel positions, which do not apply to derived data.
const DOMAINS_OF_THE_FILE: [&str; 5] =
    ["IMAGE_STRUCTURE", "SUBDATASETS", "DERIVED_SUBDATASETS", "RPC", "GEOLOCATION"];

/// Parses the nodata number as GDAL writes it.
pub(super) fn nodata(text: &str, sample: SampleType) -> Option<Number> {
    let text = text.trim().to_lowercase();
    // Microsoft's C library writes 1.#INF and -1.#IND.
    let number = match text.as_str() {
        "1.#inf" | "+1.#inf" => f64::INFINITY.into(),
        "-1.#inf" => f64::NEG_INFINITY.into(),
        _ if text.contains("nan") || text.contains(".#") => Number::NAN,
        // As in C, parse the longest number at the start; 400 characters hold any number.
        _ => (1..=text.len().min(400)).rev().find_map(|end| text.get(..end)?.trim().parse().ok())?,
    };
    Some(match sample {
        // Decimals that approximate the maximum f32 must not become infinite.
        SampleType::F32 if number.is_finite() => {
            (number.to_f64().clamp(f32::MIN.into(), f32::MAX.into()) as f32).into()
        }
        _ => number,
    })
}

/// Applies the tag GDAL_METADATA.
pub(super) fn apply(text: &str, info: &mut RasterInfo) {
    for root in XmlElement::document(text).named("GDALMetadata") {
        for element in root.children() {
            match element.name {
                "Item" => apply_item(&element, info),
                "GDALRasterAttributeTable" => take_class_names(info, 0, class_names(&element)),
                _ => {}
            }
        }
    }
}

fn apply_item(item: &XmlElement<'_>, info: &mut RasterInfo) {
    let Some(name) = item.attribute("name") else { return };
    // GDAL escapes values twice.
    let value = unescaped(&item.text());
    let channel = match item.attribute("sample").map(|number| number.parse::<usize>()) {
        None => None,
        Some(Ok(channel)) if channel < info.channels => Some(channel),
        Some(_) => return,
    };
    match (channel, item.attribute("role").as_deref()) {
        (Some(channel), Some("description")) => info.band_names[channel] = value,
        (Some(channel), Some("colorinterp")) => set_colour_role(info, channel, value),
        (Some(channel), Some("unittype")) => info.units[channel] = value,
        (Some(channel), Some("scale")) => set_number(&mut info.scale_offset[channel].0, &value),
        (Some(channel), Some("offset")) => set_number(&mut info.scale_offset[channel].1, &value),
        _ => put_tag(info, channel, &item.attribute("domain").unwrap_or_default(), name, value),
    }
}

/// Sets the role of a channel, and whether it is opacity.
pub(super) fn set_colour_role(info: &mut RasterInfo, channel: usize, role: String) {
    match role.as_str() {
        "Alpha" => info.alpha = Some(channel),
        _ if info.alpha == Some(channel) => info.alpha = None,
        _ => {}
    }
    info.colour_roles[channel] = role;
}

/// Parses a number; keeps the old one on failure.
pub(super) fn set_number(number: &mut f64, text: &str) {
    *number = text.trim().parse().unwrap_or(*number);
}

/// Stores a metadata item of the image or a channel. Statistics are dropped: they would be wrong
/// for a region, and trees have their own.
pub(super) fn put_tag(
    info: &mut RasterInfo,
    channel: Option<usize>,
    domain: &str,
    name: String,
    value: String,
) {
    if DOMAINS_OF_THE_FILE.contains(&domain) || name.starts_with("STATISTICS_") {
        return;
    }
    if channel.is_none() && domain.is_empty() {
        info.tags.insert(name, value);
    } else if let Ok(channel) = channel.map(u16::try_from).transpose() {
        let scope = TagScope { channel, domain: domain.into() };
        info.scoped_tags.entry(scope).or_default().insert(name, value);
    }
}

/// Stores the names of a channel's values, unless they are empty or an earlier channel has names.
pub(super) fn take_class_names(info: &mut RasterInfo, channel: usize, names: Vec<(Number, String)>) {
    if !names.is_empty() && (info.class_names.is_empty() || info.class_channel >= channel) {
        (info.class_names, info.class_channel) = (names, channel);
    }
}

/// Names of values from a raster attribute table: its columns for the value (or minimum) and the
/// name.
pub(super) fn class_names(table: &XmlElement<'_>) -> Vec<(Number, String)> {
    let usages: Vec<_> = table
        .named("FieldDefn")
        .map(|field| field.named("Usage").next().map_or(String::new(), |usage| usage.text()))
        .collect();
    let column = |wanted: &[&str]| usages.iter().position(|usage| wanted.contains(&usage.trim()));
    // GDAL's codes: 2 is Name, 3 is Min, 5 is MinMax.
    let (Some(value), Some(name)) = (column(&["5", "3"]), column(&["2"])) else { return Vec::new() };
    let row = |row: XmlElement<'_>| {
        let fields: Vec<_> = row.named("F").collect();
        let number: Number = fields.get(value)?.text().trim().parse().ok()?;
        // Floating-point tables may have values that are not integers.
        let number = if number.to_integer().is_some() { number } else { (number.to_f64() as i64).into() };
        Some((number, fields.get(name)?.text()))
    };
    table.named("Row").filter_map(row).collect()
}
