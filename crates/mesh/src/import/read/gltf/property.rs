//! Columns of property tables: numbers, strings, booleans and enumerations.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value as Json;

use super::super::model_file::ModelFile;
use super::buffers::Buffers;
use spinney_base::Result;

/// Definition of a property.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Property {
    name: Option<String>,
    pub(super) semantic: Option<String>,
    #[serde(rename = "type")]
    kind: String,
    component_type: Option<String>,
    enum_type: Option<String>,
    #[serde(default)]
    array: bool,
    #[serde(default)]
    normalized: bool,
    offset: Option<Json>,
    scale: Option<Json>,
    no_data: Option<Json>,
    default: Option<Json>,
    extras: Option<Json>,
}

impl Property {
    /// Whether the column has a member of objects instead of an attribute, in our own files.
    pub(super) fn is_member(&self) -> bool {
        self.is_marked("member")
    }

    fn is_marked(&self, mark: &str) -> bool {
        self.extras.as_ref().is_some_and(|extras| extras[mark] == true)
    }
}

/// Definition of an enumeration.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Enumeration {
    value_type: Option<String>,
    #[serde(default)]
    values: Vec<EnumerationValue>,
}

#[derive(Deserialize)]
struct EnumerationValue {
    name: String,
    value: i64,
}

/// Views of a column.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct ColumnViews {
    values: u32,
    array_offsets: Option<u32>,
    string_offsets: Option<u32>,
    string_offset_type: Option<String>,
    offset: Option<Json>,
    scale: Option<Json>,
}

impl ColumnViews {
    pub(super) fn views(&self) -> impl Iterator<Item = u32> {
        [Some(self.values), self.array_offsets, self.string_offsets].into_iter().flatten()
    }
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Component {
    Signed(usize),
    Unsigned(usize),
    Float(usize),
}

impl Component {
    fn of(name: &str) -> Option<Component> {
        Some(match name {
            "INT8" => Component::Signed(1),
            "INT16" => Component::Signed(2),
            "INT32" => Component::Signed(4),
            "INT64" => Component::Signed(8),
            "UINT8" => Component::Unsigned(1),
            "UINT16" => Component::Unsigned(2),
            "UINT32" => Component::Unsigned(4),
            "UINT64" => Component::Unsigned(8),
            "FLOAT32" => Component::Float(4),
            "FLOAT64" => Component::Float(8),
            _ => return None,
        })
    }

    fn size(self) -> usize {
        let (Component::Signed(size) | Component::Unsigned(size) | Component::Float(size)) = self;
        size
    }

    /// Returns the element at an index below the count.
    fn read(self, bytes: &[u8], index: u64) -> Json {
        let size = self.size();
        let own = &bytes[index as usize * size..][..size];
        // (Sign extension of the most significant byte.)
        let is_negative = matches!(self, Component::Signed(_)) && own[size - 1] & 0x80 != 0;
        let mut wide = if is_negative { [0xff; 8] } else { [0; 8] };
        wide[..size].copy_from_slice(own);
        match self {
            Component::Signed(_) => i64::from_le_bytes(wide).into(),
            Component::Unsigned(_) => u64::from_le_bytes(wide).into(),
            // (The shortest decimal of a number in single precision has fewer digits.)
            Component::Float(4) => {
                let number = f32::from_bits(u64::from_le_bytes(wide) as u32);
                number.to_string().parse::<f64>().map_or(Json::Null, Json::from)
            }
            Component::Float(_) => f64::from_le_bytes(wide).into(),
        }
    }

    /// Maximum of normalized integers; 1 for floats.
    fn maximum(self) -> f64 {
        match self {
            Component::Signed(size) => (1u64 << (8 * size - 1)) as f64 - 1.0,
            Component::Unsigned(size) => (2.0f64).powi(8 * size as i32) - 1.0,
            Component::Float(_) => 1.0,
        }
    }
}

/// Kind of a column's elements.
enum Kind<'a> {
    Number { component: Component, factor: f64, offset: f64 },
    Enumeration { component: Component, names: BTreeMap<i64, &'a str> },
    Boolean,
    String { offsets: &'a [u8], component: Component },
}

/// A column whose elements are within their views.
pub(super) struct Column<'a> {
    pub(super) name: &'a str,
    pub(super) property: &'a Property,
    kind: Kind<'a>,
    values: &'a [u8],
}

impl<'a> Column<'a> {
    /// Returns a column with `count` elements; `None` if its type is not read: arrays, vectors and
    /// matrices.
    pub(super) fn of(
        source: &'a ModelFile,
        buffers: &'a Buffers,
        (id, property, views): (&'a str, &'a Property, &'a ColumnViews),
        enumerations: &'a BTreeMap<String, Enumeration>,
        (count, place): (u64, &str),
    ) -> Result<Option<Column<'a>>> {
        let corrupt = |found: String, expected: &str| source.corrupt(place, found, expected);
        let component = |name: Option<&str>| {
            let component = name.and_then(Component::of);
            component.ok_or_else(|| corrupt(format!("the type {name:?}"), "a type of numbers"))
        };
        let number = |json: &Option<Json>, of_class: &Option<Json>, default: f64| {
            json.as_ref().or(of_class.as_ref()).and_then(Json::as_f64).unwrap_or(default)
        };
        let values = buffers.view(source, views.values);
        if property.array {
            return Ok(None);
        }
        let kind = match property.kind.as_str() {
            "SCALAR" => {
                let component = component(property.component_type.as_deref())?;
                let scale = number(&views.scale, &property.scale, 1.0);
                let factor = if property.normalized { scale / component.maximum() } else { scale };
                Kind::Number { component, factor, offset: number(&views.offset, &property.offset, 0.0) }
            }
            "ENUM" => {
                let enumeration = property.enum_type.as_ref().and_then(|name| enumerations.get(name));
                let Some(Enumeration { value_type, values }) = enumeration else {
                    return Err(corrupt(
                        format!("the enumeration {:?}", property.enum_type),
                        "one of the schema",
                    ));
                };
                let component = component(Some(value_type.as_deref().unwrap_or("UINT16")))?;
                let names = values.iter().map(|value| (value.value, value.name.as_str())).collect();
                Kind::Enumeration { component, names }
            }
            "BOOLEAN" => Kind::Boolean,
            "STRING" => {
                let component = component(Some(views.string_offset_type.as_deref().unwrap_or("UINT32")))?;
                let offsets =
                    views.string_offsets.ok_or_else(|| corrupt("no offsets".into(), "offsets of strings"))?;
                Kind::String { offsets: buffers.view(source, offsets), component }
            }
            _ => return Ok(None),
        };
        let fits = |count: Option<u64>, size: usize, bytes: &[u8]| {
            count
                .and_then(|count| count.checked_mul(size as u64))
                .is_some_and(|needed| needed <= bytes.len() as u64)
        };
        let is_within = match &kind {
            Kind::Number { component, .. } | Kind::Enumeration { component, .. } => {
                fits(Some(count), component.size(), values)
            }
            Kind::Boolean => fits(Some(count.div_ceil(8)), 1, values),
            Kind::String { offsets, component } => fits(count.checked_add(1), component.size(), offsets),
        };
        if !is_within {
            return Err(corrupt(format!("{count} rows"), "views with all rows"));
        }
        if let Kind::String { offsets, component } = &kind {
            let mut before = 0;
            for row in 0..=count {
                let Some(at) = component
                    .read(offsets, row)
                    .as_u64()
                    .filter(|at| (before..=values.len() as u64).contains(at))
                else {
                    let expected = format!("offsets of strings that increase up to {} bytes", values.len());
                    return Err(corrupt(format!("an invalid offset of row {row}"), &expected));
                };
                before = at;
            }
        }
        let name = property.name.as_deref().filter(|name| !name.is_empty()).unwrap_or(id);
        Ok(Some(Column { name, property, kind, values }))
    }

    /// Returns the value of a row below the count; `None` if it is missing or not valid.
    pub(super) fn value(&self, row: u64) -> Option<Json> {
        let Property { no_data, default, .. } = self.property;
        let stored = match &self.kind {
            Kind::Number { component, .. } => component.read(self.values, row),
            Kind::Enumeration { component, names } => {
                Json::from(*names.get(&component.read(self.values, row).as_i64()?)?)
            }
            Kind::Boolean => Json::from(self.values[row as usize / 8] >> (row % 8) & 1 == 1),
            Kind::String { offsets, component } => {
                let at = |row: u64| component.read(offsets, row).as_u64().map(|at| at as usize);
                String::from_utf8_lossy(self.values.get(at(row)?..at(row + 1)?)?).into()
            }
        };
        let is_single = matches!(self.kind, Kind::Number { component: Component::Float(4), .. });
        if no_data.as_ref().is_some_and(|no_data| is_equal(no_data, &stored, is_single)) {
            return default.clone();
        }
        match (&self.kind, stored) {
            (Kind::Number { factor, offset, .. }, number) if (*factor, *offset) != (1.0, 0.0) => {
                Some(Json::from(number.as_f64()? * factor + offset))
            }
            (_, Json::String(text)) if self.property.is_marked("json") => {
                Some(serde_json::from_str(&text).unwrap_or(Json::String(text)))
            }
            (_, value) => Some(value),
        }
        .filter(|value| !value.is_null())
    }
}

/// Whether two values are equal, as numbers in any notation, or in single precision.
fn is_equal(a: &Json, b: &Json, is_single: bool) -> bool {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a == b || is_single && a as f32 == b as f32,
        _ => a == b,
    }
}
