//! Parts of a model and their attributes, stored in columns: one column per member of the JSON
//! objects, and one per member of their `attributes`.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::OnceLock;

use serde_json::value::RawValue;

use super::chunks::ChunkList;
use super::reader::ExactModel;
use super::segment::{push_number, take_number};
use super::sums::PART_SUMS;
use super::table::{COLUMN_NAMES, ChunkVisitor, FIRST_NAMED, MAX_NAMED, TableWriter};
use crate::attributes::each_member;
use spinney_base::sort;
use spinney_base::{Progress, Result};

/// Tag of the section with the chunk list of the parts table.
pub(crate) const OBJECTS: [u8; 4] = *b"OBJE";
/// Tag of the section with the chunk list of the faces table.
pub(crate) const FACE_VALUES: [u8; 4] = *b"FVAL";

/// Columns of the parts table without names. This one has the names of the parts.
const NAMES: u32 = 0;
/// Numbers of the parts, sorted by name.
const ORDER: u32 = 1;
/// Lists of columns, in the order of an object's members; each part has the number of one list in
/// `SHAPE`.
const SHAPES: u32 = 3;
const SHAPE: u32 = 4;
/// Attributes of a part whose members are not in columns.
const WHOLE: u32 = 5;
/// Metadata of source files.
const FILES: u32 = 6;

/// Maximum number of column lists.
const MAX_SHAPES: usize = 4096;

/// The member whose own members have columns.
const ATTRIBUTES: &str = "attributes";

/// Writes a parts table.
#[derive(Default)]
pub(crate) struct ObjectWriter {
    table: TableWriter,
    names: Vec<String>,
    has_attributes: bool,
    columns: ColumnNames,
    shapes: HashMap<Vec<u32>, u32>,
    files: u32,
}

/// Names of columns, as JSON lists of one or two strings, and their numbers.
#[derive(Default)]
pub(crate) struct ColumnNames {
    numbers: HashMap<String, u32>,
    list: Vec<String>,
}

impl ColumnNames {
    /// Returns the number of a column, or `None` if there are too many columns.
    pub(crate) fn number(&mut self, name: &str) -> Option<u32> {
        if let Some(number) = self.numbers.get(name) {
            return Some(*number);
        }
        let number = self.list.len() as u32;
        (number < MAX_NAMED).then(|| {
            self.numbers.insert(name.into(), number);
            self.list.push(name.into());
            number
        })
    }

    /// Writes the names.
    pub(crate) fn write(&self, table: &mut TableWriter, take: &mut ChunkVisitor<'_>) -> Result<()> {
        let mut names = (0..).zip(&self.list);
        names.try_for_each(|(row, name)| table.push(COLUMN_NAMES, row, name.as_bytes(), take))
    }
}

impl ObjectWriter {
    /// Adds a part, with its JSON object if it has attributes.
    pub(crate) fn part(
        &mut self,
        name: &str,
        attributes: Option<&str>,
        take: &mut ChunkVisitor<'_>,
    ) -> Result<()> {
        let part = self.names.len() as u32;
        self.names.push(name.into());
        let Some(text) = attributes else { return Ok(()) };
        self.has_attributes = true;
        let split = split(text, true).or_else(|| split(text, false));
        let Some((shape, values)) = split.and_then(|members| self.shape(members)) else {
            return self.table.push(WHOLE, part, text.as_bytes(), take);
        };
        let mut number = Vec::new();
        push_number(&mut number, shape);
        self.table.push(SHAPE, part, &number, take)?;
        for (column, value) in values {
            self.table.push(FIRST_NAMED + column, part, value.as_bytes(), take)?;
        }
        Ok(())
    }

    /// Returns the numbers of the members' columns, and of the list of these columns; `None` if
    /// there are too many.
    fn shape<'a>(&mut self, members: Vec<(String, &'a str)>) -> Option<(u32, Vec<(u32, &'a str)>)> {
        let numbered = |(name, value): (String, &'a str)| Some((self.columns.number(&name)?, value));
        let values: Vec<(u32, &'a str)> = members.into_iter().map(numbered).collect::<Option<_>>()?;
        let shape: Vec<u32> = values.iter().map(|(column, _)| *column).collect();
        let next = self.shapes.len();
        if next == MAX_SHAPES && !self.shapes.contains_key(&shape) {
            return None;
        }
        Some((*self.shapes.entry(shape).or_insert(next as u32), values))
    }

    /// Adds the metadata of a source file.
    pub(crate) fn file(&mut self, text: &str, take: &mut ChunkVisitor<'_>) -> Result<()> {
        self.files += 1;
        self.table.push(FILES, self.files - 1, text.as_bytes(), take)
    }

    /// Adds the stored sums of a part, by ascending part numbers. If there is only one part, they
    /// are not stored: the sums over all faces are those of the part.
    pub(crate) fn sums(&mut self, part: u32, sums: &[u8], take: &mut ChunkVisitor<'_>) -> Result<()> {
        if self.names.len() > 1 { self.table.push(PART_SUMS, part, sums, take) } else { Ok(()) }
    }

    /// Writes the remaining columns; returns the number of parts.
    pub(crate) fn finish(self, take: &mut ChunkVisitor<'_>) -> Result<u64> {
        let ObjectWriter { mut table, names, has_attributes, columns, shapes, files } = self;
        if !has_attributes && files == 0 && (names.is_empty() || names == [ONLY_PART]) {
            return Ok(1);
        }
        let names = if names.is_empty() { vec![ONLY_PART.into()] } else { names };
        let mut order: Vec<u32> = (0..names.len() as u32).collect();
        sort::by(&mut order, &mut |a, b| (&names[*a as usize], a).cmp(&(&names[*b as usize], b)));
        for (row, name) in (0..).zip(&names) {
            table.push(NAMES, row, name.as_bytes(), take)?;
        }
        for (row, part) in (0..).zip(&order) {
            table.push(ORDER, row, &part.to_le_bytes(), take)?;
        }
        columns.write(&mut table, take)?;
        let shapes: BTreeMap<u32, Vec<u32>> =
            shapes.into_iter().map(|(shape, number)| (number, shape)).collect();
        for (number, shape) in shapes {
            let mut bytes = Vec::new();
            shape.iter().for_each(|column| push_number(&mut bytes, *column));
            table.push(SHAPES, number, &bytes, take)?;
        }
        table.finish(take)?;
        Ok(names.len() as u64)
    }
}

/// Name of the only part of a model without names.
pub(super) const ONLY_PART: &str = "mesh";

/// Splits a JSON object into its members with their column names. Returns `None` if joining them
/// would not restore the same string.
fn split(text: &str, with_attributes: bool) -> Option<Vec<(String, &str)>> {
    let key = |key: &str| serde_json::Value::from(key).to_string();
    let mut members = Vec::new();
    let top = each_member(text, |name, value| {
        let outer = key(name);
        let before = members.len();
        if name == ATTRIBUTES && with_attributes {
            let inner = each_member(value, |name, value| {
                members.push((format!("[{outer},{}]", key(name)), value));
            });
            if inner.is_ok() && members.len() > before {
                return;
            }
            members.truncate(before);
        }
        members.push((format!("[{outer}]"), value));
    });
    top.ok()?;
    let named: Option<Vec<(ColumnName, &str)>> =
        members.iter().map(|(name, value)| Some((ColumnName::of(name)?, *value))).collect();
    let is_same = join(named?.iter().map(|(name, value)| (name, *value))) == text;
    is_same.then_some(members)
}

/// The name of a column: JSON strings, as in the objects.
#[derive(Debug)]
struct ColumnName {
    member: String,
    inner: Option<String>,
}

impl ColumnName {
    fn of(name: &str) -> Option<ColumnName> {
        let names: Vec<Box<RawValue>> = serde_json::from_str(name).ok()?;
        let are_strings = names.iter().all(|name| serde_json::from_str::<String>(name.get()).is_ok());
        let mut names = names.iter().map(|name| name.get().to_string());
        let found = ColumnName { member: names.next()?, inner: names.next() };
        (are_strings && names.next().is_none()).then_some(found)
    }
}

/// Joins members to a JSON object: consecutive members with two names and the same first name are
/// in one nested object.
fn join<'a>(members: impl Iterator<Item = (&'a ColumnName, &'a str)>) -> String {
    let mut text = String::from("{");
    let mut open: Option<&str> = None;
    let mut separator = "";
    for (ColumnName { member, inner }, value) in members {
        if open.is_some() && (inner.is_none() || open != Some(member)) {
            text.push('}');
            open = None;
        }
        text.push_str(separator);
        separator = ",";
        match inner {
            None => text.push_str(&format!("{member}:{value}")),
            Some(inner) if open.is_some() => text.push_str(&format!("{inner}:{value}")),
            Some(inner) => {
                text.push_str(&format!("{member}:{{{inner}:{value}"));
                open = Some(member);
            }
        }
    }
    text.push_str(if open.is_some() { "}}" } else { "}" });
    text
}

/// Column names and column lists of a parts table.
#[derive(Debug)]
pub(super) struct Schema {
    columns: Vec<ColumnName>,
    shapes: Vec<Vec<u32>>,
}

/// A schema that is read on first use.
pub(super) type SchemaCell = OnceLock<Schema>;

impl ExactModel {
    /// Reads the names of all parts.
    pub(super) fn read_parts(&self) -> Result<Vec<String>> {
        if self.objects.len() == 0 && self.summary.parts == 1 {
            return Ok(vec![ONLY_PART.into()]);
        }
        let names = self.list_of_strings(&self.objects, NAMES, self.summary.parts)?;
        if names.len() as u64 != self.summary.parts {
            let found = format!("{} names of {} parts", names.len(), self.summary.parts);
            return Err(self.corrupt("parts".into(), found, "a name for each part"));
        }
        Ok(names)
    }

    fn wrong_objects(&self, found: impl Into<String>) -> spinney_base::Error {
        self.corrupt("attributes".into(), found, "columns as in formats.md")
    }

    fn schema(&self) -> Result<&Schema> {
        if let Some(schema) = self.schema.get() {
            return Ok(schema);
        }
        let names = self.list_of_strings(&self.objects, COLUMN_NAMES, MAX_NAMED.into())?;
        let named =
            |name: &String| ColumnName::of(name).ok_or_else(|| self.wrong_objects("a column without a name"));
        let columns: Vec<ColumnName> = names.iter().map(named).collect::<Result<_>>()?;
        let mut shapes: Vec<Vec<u32>> = Vec::new();
        self.each_value(&self.objects, SHAPES, &mut |row, mut bytes| {
            let mut shape = Vec::new();
            let mut taken = HashSet::new();
            while !bytes.is_empty() {
                let column = take_number(&mut bytes).filter(|column| (*column as usize) < columns.len());
                // (Each column once, so that no object is longer than the file.)
                let column = column.filter(|column| taken.insert(*column));
                shape.push(column.ok_or_else(|| {
                    self.wrong_objects("a list with repeated columns, or columns that do not exist")
                })?);
            }
            if row as usize != shapes.len() || shapes.len() == MAX_SHAPES {
                return Err(self.wrong_objects(format!("list of columns {row} after {}", shapes.len())));
            }
            shapes.push(shape);
            Ok(())
        })?;
        Ok(self.schema.get_or_init(|| Schema { columns, shapes }))
    }

    /// Reads the JSON object of a part.
    pub(super) fn read_part_attributes(&self, part: u32) -> Result<Option<String>> {
        let Some(shape) = self.value(&self.objects, SHAPE, part)? else {
            let whole = self.value(&self.objects, WHOLE, part)?;
            return whole.map(|text| self.text(&self.objects, text)).transpose();
        };
        let schema = self.schema()?;
        let number = take_number(&mut &shape[..]);
        let shape = number.and_then(|number| schema.shapes.get(number as usize));
        let shape =
            shape.ok_or_else(|| self.wrong_objects(format!("part {part} without a list of columns")))?;
        let mut values = Vec::with_capacity(shape.len());
        for &column in shape {
            let value = self.value(&self.objects, FIRST_NAMED + column, part)?;
            let missing = || self.wrong_objects(format!("part {part} without a value in column {column}"));
            values.push(self.text(&self.objects, value.ok_or_else(missing)?)?);
        }
        let names = shape.iter().map(|column| &schema.columns[*column as usize]);
        Ok(Some(join(names.zip(values.iter().map(String::as_str)))))
    }

    /// Returns the number of parts with attributes.
    pub(super) fn count_parts_with_attributes(&self) -> Result<u64> {
        let mut count = 0;
        for column in [SHAPE, WHOLE] {
            self.each_value(&self.objects, column, &mut |_, _| {
                count += 1;
                Ok(())
            })?;
        }
        Ok(count)
    }

    /// Reads the metadata of the source files.
    pub(super) fn read_file_attributes(&self) -> Result<Vec<String>> {
        self.list_of_strings(&self.objects, FILES, u64::from(u32::MAX))
    }

    /// Returns the number of the first part with a name.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn part_number(&self, name: &str) -> Result<Option<u32>> {
        if self.objects.len() == 0 {
            return Ok((name == ONLY_PART).then_some(0));
        }
        let (mut low, mut high) = (0, self.parts.len() as u32);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.parts[self.part_in_order(middle)? as usize].as_str() < name {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        if low as usize == self.parts.len() {
            return Ok(None);
        }
        let part = self.part_in_order(low)?;
        Ok((self.parts[part as usize] == name).then_some(part))
    }

    /// Returns the part at an index in the order of the names.
    fn part_in_order(&self, index: u32) -> Result<u32> {
        let value = self.value(&self.objects, ORDER, index)?;
        let part = value.and_then(|value| Some(u32::from_le_bytes(value.try_into().ok()?)));
        let part = part.filter(|part| (*part as usize) < self.parts.len());
        part.ok_or_else(|| self.wrong_objects(format!("no part at index {index} of the name order")))
    }

    /// Returns the names of the columns of part attributes. A column of a JSON member has its name;
    /// a column of a member of `attributes` has two names, `attributes` and the member's.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn part_columns(&self) -> Result<Vec<Vec<String>>> {
        self.column_names(&self.objects)
    }

    /// Returns the names of the columns of face values.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn face_columns(&self) -> Result<Vec<Vec<String>>> {
        self.column_names(&self.face_values)
    }

    fn column_names(&self, table: &ChunkList) -> Result<Vec<Vec<String>>> {
        let names = self.list_of_strings(table, COLUMN_NAMES, MAX_NAMED.into())?;
        let decoded = |name: &String| {
            serde_json::from_str(name).map_err(|_| self.wrong_objects("a column without a name"))
        };
        names.iter().map(decoded).collect()
    }

    /// Visits the values of a column of [`ExactModel::part_columns`], in JSON, by ascending part
    /// numbers. Objects that are not stored in columns have no values.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn each_part_value(&self, column: u32, each: &mut dyn FnMut(u32, &str) -> Result<()>) -> Result<()> {
        self.each_named_value(&self.objects, column, each)
    }

    /// Visits the values of a column of [`ExactModel::face_columns`], in JSON, by ascending face
    /// numbers.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn each_face_value(&self, column: u32, each: &mut dyn FnMut(u32, &str) -> Result<()>) -> Result<()> {
        self.each_named_value(&self.face_values, column, each)
    }

    fn each_named_value(
        &self,
        table: &ChunkList,
        column: u32,
        each: &mut dyn FnMut(u32, &str) -> Result<()>,
    ) -> Result<()> {
        let wrong = |_| self.corrupt(table.name().into(), "bytes that are not UTF-8", "UTF-8");
        self.each_value(table, FIRST_NAMED.saturating_add(column), &mut |row, value| {
            each(row, str::from_utf8(value).map_err(wrong)?)
        })
    }

    /// Returns the value of a face in a column, in JSON.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn face_value(&self, column: u32, face: u32) -> Result<Option<String>> {
        let value = self.value(&self.face_values, FIRST_NAMED.saturating_add(column), face)?;
        value.map(|value| self.text(&self.face_values, value)).transpose()
    }

    /// Checks the tables beyond single chunks; fails if they are invalid, or on cancellation.
    pub(super) fn check_tables(&self, progress: &dyn Progress) -> Result<()> {
        let check_often = |row: u32| if row.is_multiple_of(1 << 12) { progress.check() } else { Ok(()) };
        let json = |text: &str, index: &dyn Fn() -> String| match serde_json::from_str::<&RawValue>(text) {
            Ok(_) => Ok(()),
            Err(_) => Err(self.wrong_objects(format!("{} with a value that is not JSON", index()))),
        };
        for (table, rows) in [(&self.objects, self.summary.parts), (&self.face_values, self.summary.faces)] {
            for column in 0..self.column_names(table)?.len() as u32 {
                self.each_named_value(table, column, &mut |row, value| {
                    check_often(row)?;
                    if u64::from(row) >= rows {
                        return Err(self.wrong_objects(format!("row {row} of {rows} in column {column}")));
                    }
                    json(value, &|| format!("row {row} of column {column}"))
                })?;
            }
        }
        for column in [SHAPE, WHOLE] {
            self.each_value(&self.objects, column, &mut |part, _| {
                check_often(part)?;
                if u64::from(part) >= self.summary.parts {
                    return Err(self.wrong_objects(format!("part {part} of {}", self.summary.parts)));
                }
                let text = self.read_part_attributes(part)?;
                each_member(text.as_deref().unwrap_or_default(), |_, _| ())
                    .map_err(|_| self.wrong_objects(format!("part {part} without a JSON object")))
            })?;
        }
        for text in self.read_file_attributes()? {
            each_member(&text, |_, _| ()).map_err(|_| self.wrong_objects("a file without a JSON object"))?;
        }
        // Strictly ascending pairs of name and number: every part occurs exactly once.
        let mut before: Option<(&str, u32)> = None;
        for index in 0..if self.objects.len() == 0 { 0 } else { self.parts.len() as u32 } {
            check_often(index)?;
            let part = self.part_in_order(index)?;
            let own = (self.parts[part as usize].as_str(), part);
            if before.is_some_and(|before| before >= own) {
                return Err(self
                    .wrong_objects(format!("part {part} out of order at index {index} of the name order")));
            }
            before = Some(own);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_split_where_they_come_back() {
        let columns = |text: &str| -> Option<String> {
            let members = split(text, true).or_else(|| split(text, false))?;
            Some(members.iter().map(|(name, value)| format!("{name}{value};")).collect())
        };
        for (text, expected) in [
            ("{}", Some("")),
            ("{\"type\":\"Road\"}", Some("[\"type\"]\"Road\";")),
            (
                "{\"a\":1.10,\"attributes\":{\"x\":[1,{}],\"y\":1e400},\"b\":{}}",
                Some("[\"a\"]1.10;[\"attributes\",\"x\"][1,{}];[\"attributes\",\"y\"]1e400;[\"b\"]{};"),
            ),
            ("{\"attributes\":{}}", Some("[\"attributes\"]{};")),
            ("{\"attributes\":7,\"z\":0}", Some("[\"attributes\"]7;[\"z\"]0;")),
            // Keys with another spelling, or duplicate keys: attributes stay in one column.
            ("{\"attributes\":{\"\\u0061\":1}}", Some("[\"attributes\"]{\"\\u0061\":1};")),
            ("{\"attributes\":{\"a\":1,\"a\":2}}", Some("[\"attributes\"]{\"a\":1,\"a\":2};")),
            ("{\"\\u0061\":1}", None),
            ("{\"a\": 1}", None),
            ("[]", None),
        ] {
            assert_eq!(columns(text).as_deref(), expected, "{text}");
        }
    }
}
