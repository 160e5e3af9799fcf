//! Objects as features: a table with the name and the attributes of each part.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value as Json, json};

use super::super::gltf::buffer::GlbBuffer;
use spinney_base::Result;
use spinney_brep::Faces;

/// Rows of parts, and their columns.
pub(super) struct Features {
    /// Row of each part.
    pub(super) rows: BTreeMap<u32, u32>,
    names: Vec<String>,
    columns: BTreeMap<String, Vec<Option<Json>>>,
}

impl Features {
    /// Reads names and attributes of parts.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(super) fn of(faces: &dyn Faces, parts: &BTreeSet<u32>) -> Result<Features> {
        let rows: BTreeMap<u32, u32> = parts.iter().copied().zip(0..).collect();
        let mut features = Features { rows, names: Vec::new(), columns: BTreeMap::new() };
        for (row, part) in parts.iter().enumerate() {
            features.names.push(faces.parts().get(*part as usize).cloned().unwrap_or_default());
            let Some(text) = faces.part_attributes(*part)? else { continue };
            let Ok(Json::Object(object)) = serde_json::from_str::<Json>(&text) else { continue };
            for (name, value) in values(object) {
                let column = features.columns.entry(name).or_insert_with(|| vec![None; parts.len()]);
                column[row] = Some(value);
            }
        }
        Ok(features)
    }

    /// Returns the extension of the root, whose columns are added to a buffer.
    pub(super) fn table(&self, buffer: &mut GlbBuffer) -> Json {
        let (mut properties, mut columns) = (Map::new(), Map::new());
        let mut add = |id: String, name: &str, (mut about, column): (Json, Json)| {
            about["name"] = name.into();
            properties.insert(id.clone(), about);
            columns.insert(id, column);
        };
        add("name".into(), "name", strings(&self.names, buffer));
        for (number, (name, values)) in self.columns.iter().enumerate() {
            // (Ids are restricted to letters, digits and underscores, and must differ.)
            let letter = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
            let id = format!("a{number}_{}", name.chars().map(letter).collect::<String>());
            let numbers: Option<Vec<f64>> =
                values.iter().map(|value| value.as_ref().and_then(Json::as_f64)).collect();
            let column = match numbers {
                Some(numbers) => {
                    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
                    let view = buffer.table(&bytes);
                    (json!({ "type": "SCALAR", "componentType": "FLOAT64" }), json!({ "values": view }))
                }
                None => {
                    let text = |value: &Option<Json>| match value {
                        None => String::new(),
                        Some(Json::String(text)) => text.clone(),
                        Some(value) => value.to_string(),
                    };
                    strings(&values.iter().map(text).collect::<Vec<_>>(), buffer)
                }
            };
            add(id, name, column);
        }
        json!({
            "schema": { "id": "objects", "classes": { "object": { "properties": properties } } },
            "propertyTables": [{ "class": "object", "count": self.names.len(), "properties": columns }],
        })
    }
}

/// Returns a column of strings: its definition and its views.
fn strings(values: &[String], buffer: &mut GlbBuffer) -> (Json, Json) {
    let (mut bytes, mut offsets) = (Vec::new(), vec![0u32]);
    for value in values {
        bytes.extend_from_slice(value.as_bytes());
        offsets.push(bytes.len() as u32);
    }
    if bytes.is_empty() {
        // (Views must not be empty.)
        bytes.push(0);
    }
    let offsets: Vec<u8> = offsets.iter().flat_map(|offset| offset.to_le_bytes()).collect();
    let [bytes, offsets] = [bytes, offsets].map(|bytes| buffer.table(&bytes));
    (json!({ "type": "STRING" }), json!({ "values": bytes, "stringOffsets": offsets }))
}

/// Returns the values of an object's members, and of the members of its `attributes`.
fn values(object: Map<String, Json>) -> Vec<(String, Json)> {
    let mut found = Vec::new();
    for (name, value) in object {
        match value {
            Json::Object(members) if name == "attributes" => found.extend(members),
            Json::Null => {}
            value => found.push((name, value)),
        }
    }
    found.retain(|(_, value)| !value.is_null());
    found
}
