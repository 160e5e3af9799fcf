//! Features: objects, with names and attributes, and faces, by their values.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use serde_json::{Map, Value as Json, json};

use super::super::gltf::buffer::GlbBuffer;
use spinney_base::Result;
use spinney_brep::Faces;

/// A table of the parts of a model.
pub(super) struct PartTable {
    /// Row of each part.
    pub(super) rows: BTreeMap<u32, u32>,
    pub(super) table: FeatureTable,
}

/// A table of features.
#[derive(Default)]
pub(super) struct FeatureTable {
    pub(super) count: usize,
    names: Vec<String>,
    columns: BTreeMap<Column, Vec<Option<Json>>>,
}

/// Different values of faces, such as `RoofSurface` of the column `semantics`. Rows are numbered in
/// the order in which they occur.
#[derive(Default)]
pub(super) struct FaceValues {
    columns: Vec<String>,
    rows: HashMap<Vec<Option<String>>, u32>,
}

impl FaceValues {
    pub(super) fn of_columns(columns: Vec<String>) -> FaceValues {
        FaceValues { columns, ..FaceValues::default() }
    }

    /// Returns the row of values, which are JSON; adds it if it is new.
    pub(super) fn row(&mut self, values: &[Option<String>]) -> u32 {
        if let Some(row) = self.rows.get(values) {
            return *row;
        }
        let row = self.rows.len() as u32;
        self.rows.insert(values.to_vec(), row);
        row
    }

    /// Returns the table.
    pub(super) fn table(&self) -> FeatureTable {
        let mut table = FeatureTable { count: self.rows.len(), ..FeatureTable::default() };
        for (index, name) in self.columns.iter().enumerate() {
            let mut values = vec![None; table.count];
            for (row, number) in &self.rows {
                let value = row[index].as_deref().and_then(|text| serde_json::from_str(text).ok());
                values[*number as usize] = value;
            }
            table.columns.insert(Column { is_attribute: true, name: name.clone() }, values);
        }
        table
    }
}

/// A column: a member of objects, such as `type`, or one of their attributes.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Column {
    is_attribute: bool,
    name: String,
}

impl PartTable {
    /// Reads names and attributes of parts.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(super) fn of(faces: &dyn Faces, parts: &BTreeSet<u32>) -> Result<PartTable> {
        let rows: BTreeMap<u32, u32> = parts.iter().copied().zip(0..).collect();
        let mut table = FeatureTable { count: parts.len(), ..FeatureTable::default() };
        for (row, part) in parts.iter().enumerate() {
            table.names.push(faces.parts().get(*part as usize).cloned().unwrap_or_default());
            let Some(text) = faces.part_attributes(*part)? else { continue };
            let Ok(Json::Object(object)) = serde_json::from_str::<Json>(&text) else { continue };
            for (column, value) in values(object) {
                let column = table.columns.entry(column).or_insert_with(|| vec![None; parts.len()]);
                column[row] = Some(value);
            }
        }
        Ok(PartTable { rows, table })
    }
}

/// Returns the extension of the root: tables, each with the name of its class. Their columns are
/// added to a buffer.
pub(super) fn extension(tables: &[(&str, &FeatureTable)], buffer: &mut GlbBuffer) -> Json {
    let (mut classes, mut found) = (Map::new(), Vec::new());
    for (class, table) in tables {
        let (properties, columns) = table.columns(buffer);
        classes.insert((*class).into(), json!({ "properties": properties }));
        found.push(json!({ "class": class, "count": table.count, "properties": columns }));
    }
    json!({ "schema": { "id": "features", "classes": classes }, "propertyTables": found })
}

impl FeatureTable {
    /// Returns the definitions of the columns, and their views of a buffer, to which they are
    /// added.
    fn columns(&self, buffer: &mut GlbBuffer) -> (Map<String, Json>, Map<String, Json>) {
        let (mut properties, mut columns) = (Map::new(), Map::new());
        let mut add = |id: String, name: &str, (mut about, column): (Json, Json)| {
            about["name"] = name.into();
            properties.insert(id.clone(), about);
            columns.insert(id, column);
        };
        if !self.names.is_empty() {
            let (mut about, column) = strings(&self.names, buffer);
            about["semantic"] = "NAME".into();
            add("name".into(), "name", (about, column));
        }
        for (number, (Column { is_attribute, name }, values)) in self.columns.iter().enumerate() {
            // (Ids are restricted to letters, digits and underscores, and must differ.)
            let letter = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
            let id = format!("a{number}_{}", name.chars().map(letter).collect::<String>());
            let (mut about, column) = integers(values, buffer)
                .or_else(|| floats(values, buffer))
                .unwrap_or_else(|| mixed(values, buffer));
            if !is_attribute {
                about["extras"]["member"] = true.into();
            }
            add(id, name, (about, column));
        }
        (properties, columns)
    }
}

/// Returns a column of integers, if all values are integers of 32 bits.
fn integers(values: &[Option<Json>], buffer: &mut GlbBuffer) -> Option<(Json, Json)> {
    let integer = |value: &Json| value.as_i64().and_then(|value| i32::try_from(value).ok());
    numbers("INT32", (values, i32::MIN), integer, |value| value.to_le_bytes().to_vec(), buffer)
}

/// Returns a column of numbers in double precision, if these represent all values.
fn floats(values: &[Option<Json>], buffer: &mut GlbBuffer) -> Option<(Json, Json)> {
    let float = |value: &Json| {
        let number = value.as_f64()?;
        let is_exact = value.as_i64().is_none_or(|integer| number as i64 == integer && number.abs() < 9e15)
            && value.as_u64().is_none_or(|integer| number as u64 == integer && number < 9e15);
        is_exact.then_some(number)
    };
    numbers("FLOAT64", (values, f64::MIN), float, |value| value.to_le_bytes().to_vec(), buffer)
}

/// Returns a column of numbers: its definition and its view. `absent` is the number of missing
/// values. Returns `None` if a value is no such number.
fn numbers<T: Copy + PartialEq + Into<Json>>(
    component: &str,
    (values, absent): (&[Option<Json>], T),
    number: impl Fn(&Json) -> Option<T>,
    bytes: impl Fn(T) -> Vec<u8>,
    buffer: &mut GlbBuffer,
) -> Option<(Json, Json)> {
    let mut all = Vec::new();
    for value in values {
        let number = match value {
            None => absent,
            Some(value) => number(value).filter(|number| *number != absent)?,
        };
        all.extend(bytes(number));
    }
    let mut about = json!({ "type": "SCALAR", "componentType": component });
    if values.iter().any(Option::is_none) {
        about["noData"] = absent.into();
    }
    Some((about, json!({ "values": buffer.table(&all) })))
}

/// Returns a column of strings and, if there are other values, of JSON.
fn mixed(values: &[Option<Json>], buffer: &mut GlbBuffer) -> (Json, Json) {
    let is_json = values.iter().flatten().any(|value| !value.is_string());
    // (A string that looks like JSON is quoted, so that it is distinct from it.)
    let text = |value: &Json| match value {
        Json::String(text) if !is_json || serde_json::from_str::<Json>(text).is_err() => text.clone(),
        value => value.to_string(),
    };
    let found: Vec<Option<String>> = values.iter().map(|value| value.as_ref().map(text)).collect();
    let is_used = |text: &str| found.iter().flatten().any(|found| found == text);
    let mut absent = String::new();
    while is_used(&absent) {
        absent.push_str(if absent.is_empty() { "none" } else { "_" });
    }
    let all: Vec<String> = found.iter().map(|text| text.clone().unwrap_or_else(|| absent.clone())).collect();
    let (mut about, column) = strings(&all, buffer);
    if found.iter().any(Option::is_none) {
        about["noData"] = absent.into();
    }
    if is_json {
        about["extras"]["json"] = true.into();
    }
    (about, column)
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
fn values(object: Map<String, Json>) -> Vec<(Column, Json)> {
    let mut found = Vec::new();
    for (name, value) in object {
        match value {
            Json::Object(members) if name == "attributes" => {
                let column = |name| Column { is_attribute: true, name };
                found.extend(members.into_iter().map(|(name, value)| (column(name), value)));
            }
            value => found.push((Column { is_attribute: false, name }, value)),
        }
    }
    found.retain(|(_, value)| !value.is_null());
    found
}
