//! Metadata of a file as JSON.

use std::ffi::CString;

use engine::raw::io::shown;
use engine::{Crs, Dataset};
use serde_json::{Map, Value, json};

/// Returns the JSON document of `spinney_metadata`.
pub(crate) fn json(dataset: &Dataset) -> CString {
    let (header, metadata) = (dataset.header(), dataset.metadata());
    let crs = metadata.frame.crs.as_ref().map(|crs| {
        json!({
            "form": crs.form(),
            "definition": crs.definition(),
            "name": crs.name(),
            "epsg": crs.numbers().map(|numbers| numbers.to_string()),
            "text": crs.to_text().ok().or_else(|| crs.foreign_text()),
            "problem": crs.to_text().err().map(|error| error.to_string()),
            "unit": Crs::unit(crs),
        })
    });
    let bands: Vec<Value> = (0..usize::from(header.form.value.channels))
        .map(|band| {
            let (scale, offset) = metadata.scale_offset.get(band).copied().unwrap_or((1.0, 0.0));
            json!({
                "name": metadata.band_names.get(band).filter(|name| !name.is_empty()),
                "unit": metadata.units.get(band).filter(|unit| !unit.is_empty()),
                "scale": scale,
                "offset": offset,
            })
        })
        .collect();
    let categories: Map<String, Value> =
        metadata.class_names.iter().map(|(value, name)| (value.to_string(), name.clone().into())).collect();
    let scoped: Vec<Value> = metadata
        .scoped_tags
        .iter()
        .map(|(scope, tags)| json!({ "channel": scope.channel, "domain": scope.domain, "tags": tags }))
        .collect();
    let document = json!({
        "path": dataset.path().map(|path| shown(path)),
        "name": Some(&metadata.name).filter(|name| !name.is_empty()),
        "time": metadata.time,
        "rule": header.rule.to_string(),
        "crs": crs,
        "bands": bands,
        "categories": categories,
        "palette": metadata.palette.as_ref().map(|palette| &palette.colours),
        "tags": metadata.tags,
        "scoped_tags": scoped,
        "provenance": metadata.clean_provenance(),
    });
    // (JSON has no zero bytes: they are escaped.)
    CString::new(document.to_string()).unwrap_or_default()
}
