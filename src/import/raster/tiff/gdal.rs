//! GDAL's own tags: the number for missing samples, and metadata in XML.

use super::ifd::Directory;
use super::spec::tag;
use crate::Result;
use crate::import::raster::xml::{attribute, elements, unescape};
use crate::value::SampleType;

/// The number that marks missing samples.
pub(super) fn nodata(directory: &Directory<'_>, sample: SampleType) -> Result<Option<f64>> {
    let Some(text) = directory.text(tag::GDAL_NODATA)? else { return Ok(None) };
    let text = text.trim().to_lowercase();
    // Microsoft's C library writes 1.#INF and -1.#IND.
    let number = match text.as_str() {
        "1.#inf" | "+1.#inf" => f64::INFINITY,
        "-1.#inf" => f64::NEG_INFINITY,
        _ if text.contains("nan") || text.contains(".#") => f64::NAN,
        // As C would, take what is a number at the start.
        _ => match (1..=text.len()).rev().find_map(|end| text.get(..end)?.trim().parse().ok()) {
            Some(number) => number,
            None => return Ok(None),
        },
    };
    Ok(Some(match sample {
        // Decimals that are meant for the largest f32 must not become infinite.
        SampleType::F32 if number.is_finite() => number.clamp(f32::MIN.into(), f32::MAX.into()) as f32 as f64,
        _ => number,
    }))
}

/// Content of the tag GDAL_METADATA.
#[derive(Default)]
pub(super) struct GdalMetadata {
    /// By channel.
    pub(super) band_names: Vec<String>,
    /// By channel.
    pub(super) scale_offset: Vec<(f64, f64)>,
    pub(super) class_names: Vec<(i64, String)>,
    /// Everything else: name and value.
    pub(super) items: Vec<(String, String)>,
}

/// Reads the metadata of a file with `channels` channels.
pub(super) fn metadata(directory: &Directory<'_>, channels: usize) -> Result<GdalMetadata> {
    let mut metadata = GdalMetadata {
        band_names: vec![String::new(); channels],
        scale_offset: vec![(1.0, 0.0); channels],
        ..GdalMetadata::default()
    };
    let text = directory.text(tag::GDAL_METADATA)?.unwrap_or_default();
    for (attributes, value) in elements(&text, "Item") {
        let (Some(name), value) = (attribute(attributes, "name"), unescape(value)) else { continue };
        let band = attribute(attributes, "sample").and_then(|number| number.parse::<usize>().ok());
        let role = attribute(attributes, "role");
        match (band.filter(|band| *band < channels), role.as_deref(), value.trim().parse()) {
            (Some(band), Some("description"), _) => metadata.band_names[band] = value,
            (Some(band), Some("scale"), Ok(scale)) => metadata.scale_offset[band].0 = scale,
            (Some(band), Some("offset"), Ok(offset)) => metadata.scale_offset[band].1 = offset,
            (None, ..) => metadata.items.push((name, value)),
            (Some(band), ..) => metadata.items.push((format!("{name} (band {})", band + 1), value)),
        }
    }
    for (_, table) in elements(&text, "GDALRasterAttributeTable") {
        metadata.class_names = class_names(table);
    }
    Ok(metadata)
}

/// Names of values from a raster attribute table: its columns for the value (or smallest value) and name.
fn class_names(table: &str) -> Vec<(i64, String)> {
    let usages: Vec<_> = elements(table, "FieldDefn")
        .map(|(_, field)| elements(field, "Usage").next().map_or("", |(_, usage)| usage.trim()))
        .collect();
    let column = |wanted: &[&str]| usages.iter().position(|usage| wanted.contains(usage));
    // GDAL's numbers: 2 is Name, 3 is Min, 5 is MinMax.
    let (Some(value), Some(name)) = (column(&["5", "3"]), column(&["2"])) else { return Vec::new() };
    elements(table, "Row")
        .filter_map(|(_, row)| {
            let fields: Vec<_> = elements(row, "F").map(|(_, field)| field).collect();
            let number: f64 = fields.get(value)?.trim().parse().ok()?;
            Some((number as i64, unescape(fields.get(name)?)))
        })
        .collect()
}
