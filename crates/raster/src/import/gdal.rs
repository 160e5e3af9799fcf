//! GDAL's descriptions of a raster in XML: in the TIFF tag GDAL_METADATA, and in parts that sidecars have as well.

use super::RasterInfo;
use super::xml::{XmlElement, unescaped};
use spinney_base::value::{Number, SampleType};
use spinney_container::TagScope;

/// Domains that are about the file or the place of its pixels in it, and would be wrong of what is made of them.
const DOMAINS_OF_THE_FILE: [&str; 5] =
    ["IMAGE_STRUCTURE", "SUBDATASETS", "DERIVED_SUBDATASETS", "RPC", "GEOLOCATION"];

/// The number that marks missing samples, as GDAL writes it.
pub(super) fn nodata(text: &str, sample: SampleType) -> Option<Number> {
    let text = text.trim().to_lowercase();
    // Microsoft's C library writes 1.#INF and -1.#IND.
    let number = match text.as_str() {
        "1.#inf" | "+1.#inf" => f64::INFINITY.into(),
        "-1.#inf" => f64::NEG_INFINITY.into(),
        _ if text.contains("nan") || text.contains(".#") => Number::NAN,
        // As C would, take what is a number at the start: it is no longer than the text of any number.
        _ => (1..=text.len().min(400)).rev().find_map(|end| text.get(..end)?.trim().parse().ok())?,
    };
    Some(match sample {
        // Decimals that are meant for the largest f32 must not become infinite.
        SampleType::F32 if number.is_finite() => {
            (number.to_f64().clamp(f32::MIN.into(), f32::MAX.into()) as f32).into()
        }
        _ => number,
    })
}

/// Takes over what the tag GDAL_METADATA says.
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

/// Takes over the role of a channel, which is opacity or is not.
pub(super) fn set_colour_role(info: &mut RasterInfo, channel: usize, role: String) {
    match role.as_str() {
        "Alpha" => info.alpha = Some(channel),
        _ if info.alpha == Some(channel) => info.alpha = None,
        _ => {}
    }
    info.colour_roles[channel] = role;
}

/// Sets a number to that of a text, if it is one.
pub(super) fn set_number(number: &mut f64, text: &str) {
    *number = text.trim().parse().unwrap_or(*number);
}

/// Keeps an item of metadata of the picture or a channel. Statistics are not kept: they would be wrong of a part, and
/// trees know their own.
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

/// Takes the names of a channel's values, if there are any and no channel before has some.
pub(super) fn take_class_names(info: &mut RasterInfo, channel: usize, names: Vec<(Number, String)>) {
    if !names.is_empty() && (info.class_names.is_empty() || info.class_channel >= channel) {
        (info.class_names, info.class_channel) = (names, channel);
    }
}

/// Names of values from a raster attribute table: its columns for the value (or smallest value) and name.
pub(super) fn class_names(table: &XmlElement<'_>) -> Vec<(Number, String)> {
    let usages: Vec<_> = table
        .named("FieldDefn")
        .map(|field| field.named("Usage").next().map_or(String::new(), |usage| usage.text()))
        .collect();
    let column = |wanted: &[&str]| usages.iter().position(|usage| wanted.contains(&usage.trim()));
    // GDAL's numbers: 2 is Name, 3 is Min, 5 is MinMax.
    let (Some(value), Some(name)) = (column(&["5", "3"]), column(&["2"])) else { return Vec::new() };
    let row = |row: XmlElement<'_>| {
        let fields: Vec<_> = row.named("F").collect();
        let number: Number = fields.get(value)?.text().trim().parse().ok()?;
        // (Tables of floating numbers may have classes that are none.)
        let number = if number.to_integer().is_some() { number } else { (number.to_f64() as i64).into() };
        Some((number, fields.get(name)?.text()))
    };
    table.named("Row").filter_map(row).collect()
}
