//! Tables of properties of features (EXT_structural_metadata): names and attributes.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;
use serde_json::Value as Json;
use serde_json::value::RawValue;

use super::super::model_file::ModelFile;
use super::buffers::Buffers;
use super::document::item;
use super::property::{Column, ColumnViews, Enumeration, Property};
use spinney_base::{Error, Result};
use spinney_brep::attributes::ObjectText;

/// Maximum memory of parsed definitions per byte of their text.
const EXPANSION: u64 = 32;
/// Bytes that parsed definitions may take whatever the memory limit is.
const SMALL: u64 = 16 << 20;

/// Definitions of all tables.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct PropertyTables {
    #[serde(default)]
    schema: Schema,
    schema_uri: Option<String>,
    #[serde(default)]
    property_tables: Vec<TableDefinition>,
}

#[derive(Default, Deserialize)]
struct Schema {
    #[serde(default)]
    classes: BTreeMap<String, Class>,
    #[serde(default)]
    enums: BTreeMap<String, Enumeration>,
}

#[derive(Deserialize)]
struct Class {
    #[serde(default)]
    properties: BTreeMap<String, Property>,
}

#[derive(Deserialize)]
struct TableDefinition {
    name: Option<String>,
    class: String,
    count: u64,
    #[serde(default)]
    properties: BTreeMap<String, ColumnViews>,
}

impl PropertyTables {
    /// Parses the definitions.
    pub(super) fn of(source: &ModelFile, text: Option<&RawValue>, memory: u64) -> Result<PropertyTables> {
        let Some(text) = text.map(RawValue::get) else { return Ok(PropertyTables::default()) };
        let (needed, limit) = (text.len() as u64 * EXPANSION, memory.max(SMALL));
        if needed > limit {
            return Err(Error::TooLarge {
                path: source.path().to_path_buf(),
                what: "the definitions of properties".into(),
                needed,
                limit,
                advice: "allow more memory, or split the file".into(),
            });
        }
        serde_json::from_str(text).map_err(|error| {
            let error: String = error.to_string().chars().take(200).collect();
            source.corrupt("EXT_structural_metadata", error, "property tables")
        })
    }

    /// Adds the buffer views that a table uses.
    pub(super) fn add_views(&self, source: &ModelFile, table: u32, views: &mut BTreeSet<u32>) -> Result<()> {
        let definition = self.definition(source, table)?;
        views.extend(definition.properties.values().flat_map(ColumnViews::views));
        Ok(())
    }

    fn definition(&self, source: &ModelFile, table: u32) -> Result<&TableDefinition> {
        item(source, &self.property_tables, ("property table", table), &"EXT_mesh_features")
    }

    /// Returns a table, whose views must have been loaded.
    pub(super) fn table<'a>(
        &'a self,
        source: &'a ModelFile,
        buffers: &'a Buffers,
        number: u32,
    ) -> Result<PropertyTable<'a>> {
        let definition = self.definition(source, number)?;
        let place = format!("property table {number}");
        let class = self.schema.classes.get(&definition.class);
        if class.is_none() && self.schema_uri.is_none() {
            let found = format!("the class {:?}", definition.class);
            return Err(source.corrupt(place, found, "a class of the schema"));
        }
        let (mut columns, mut unread) = (Vec::new(), 0);
        for (id, views) in &definition.properties {
            // (A schema in another file is not read.)
            let Some(class) = class else {
                unread += 1;
                continue;
            };
            let property = class.properties.get(id).ok_or_else(|| {
                source.corrupt(&place, format!("the property {id:?}"), "a property of its class")
            })?;
            let place = format!("{place}, property {id:?}");
            let column = Column::of(
                source,
                buffers,
                (id, property, views),
                &self.schema.enums,
                (definition.count, &place),
            )?;
            match column {
                Some(column) => columns.push(column),
                None => unread += 1,
            }
        }
        let name = definition.name.as_deref().unwrap_or(&definition.class);
        let names = name_column(&columns);
        Ok(PropertyTable { name, count: definition.count, columns, names, unread })
    }
}

/// Returns the column with the names of features: the one that is declared to have names or
/// identifiers, or else one with a usual name.
fn name_column(columns: &[Column<'_>]) -> Option<usize> {
    let declared = ["NAME", "ID"].into_iter().map(|semantic| {
        columns.iter().position(|column| column.property.semantic.as_deref() == Some(semantic))
    });
    let usual = ["name", "id", "gml_id", "gml:id", "gmlid"]
        .into_iter()
        .map(|name| columns.iter().position(|column| column.name.eq_ignore_ascii_case(name)));
    declared.chain(usual).flatten().next()
}

/// A table whose columns are within their views.
pub(super) struct PropertyTable<'a> {
    name: &'a str,
    pub(super) count: u64,
    columns: Vec<Column<'a>>,
    /// Index of the column with names.
    names: Option<usize>,
    /// Number of columns that are not read.
    pub(super) unread: u64,
}

impl PropertyTable<'_> {
    /// Returns the name of a feature.
    pub(super) fn name(&self, row: u64) -> String {
        let name = self.names.and_then(|column| self.columns[column].value(row));
        match name {
            Some(Json::String(name)) if !name.is_empty() => name,
            Some(value @ Json::Number(_)) => value.to_string(),
            _ => format!("{} {row}", self.name),
        }
    }

    /// Returns the attributes of a feature as the JSON of an object; empty if there are none.
    pub(super) fn attributes(&self, row: u64) -> ObjectText {
        let (mut object, mut attributes) = (ObjectText::default(), ObjectText::default());
        for column in &self.columns {
            if column.property.semantic.as_deref() == Some("NAME") {
                continue;
            }
            let Some(value) = column.value(row) else { continue };
            let text = if column.property.is_member() { &mut object } else { &mut attributes };
            text.push(column.name, &value.to_string());
        }
        if !attributes.is_empty() {
            object.push("attributes", &attributes.to_string());
        }
        object
    }
}
