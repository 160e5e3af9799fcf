//! `spinney find` of objects: one of an exact model by its name, and pairs that overlap or touch.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, bail};
use serde_json::{Value, json};
use spinney::brep::Faces;
use spinney::raw::brep::query::PartMeasures;
use spinney::raw::brep::{ModelView, ObjectContact};
use spinney::raw::import::mesh;
use spinney::{ExactModel, Progress};

use super::super::Global;
use super::super::report::{Found, Work};

/// Lists the objects with a name, usually one.
pub(crate) fn find_object(
    view: &ModelView,
    name: &str,
    is_json: bool,
    memory: u64,
    global: &Global,
    found: &mut Found,
) -> Result<()> {
    let model = view.file();
    let parts = parts_named(model, name)?;
    let work = Work::start(global, "faces")?;
    let measures = view.part_measures(memory, &work)?;
    let values = FaceValues::of(model, &parts, &work)?;
    work.finish();
    for part in parts {
        let own = measures.iter().find(|measures| measures.part == part);
        let is_known = model.metadata().frame.cell_volume().is_ok();
        let about = model.part_attributes(part)?;
        let of_faces = values.as_json(part);
        let line = || {
            if is_json {
                object_as_json(part, name, (own, is_known), &about, &of_faces)
            } else {
                object_as_text(part, name, (own, is_known), &about, &of_faces)
            }
        };
        found.take(0, "", &line)?;
    }
    Ok(())
}

/// Values of the faces of some objects, each with the number of its faces.
struct FaceValues {
    columns: Vec<String>,
    /// By part and column; `None` for the values beyond the limit.
    counts: BTreeMap<(u32, usize), BTreeMap<Option<String>, u64>>,
}

impl FaceValues {
    /// Maximum number of different values in a column of an object.
    const MAX_VALUES: usize = 1000;

    /// Counts the values. Reads all faces, if faces have values.
    fn of(model: &ExactModel, parts: &[u32], progress: &dyn Progress) -> Result<FaceValues> {
        let mut found = FaceValues { columns: model.value_columns()?, counts: BTreeMap::new() };
        if found.columns.is_empty() {
            return Ok(found);
        }
        let names: Vec<&str> = found.columns.iter().map(String::as_str).collect();
        model.each_with_values(&names, &mut |face, values| {
            progress.check()?;
            if parts.contains(&face.part) {
                for (column, value) in values.iter().enumerate().filter(|(_, value)| value.is_some()) {
                    let counts = found.counts.entry((face.part, column)).or_default();
                    let is_known = counts.contains_key(value) || counts.len() < Self::MAX_VALUES;
                    *counts.entry(value.clone().filter(|_| is_known)).or_default() += 1;
                }
            }
            Ok(())
        })?;
        Ok(found)
    }

    /// Returns the counts of an object by column and value; `null` if its faces have no values.
    fn as_json(&self, part: u32) -> Value {
        let mut columns = serde_json::Map::new();
        for ((_, column), counts) in self.counts.range((part, 0)..=(part, usize::MAX)) {
            let name = |value: &Option<String>| match value.as_deref().map(serde_json::from_str) {
                Some(Ok(Value::String(text))) => text,
                Some(_) => value.clone().unwrap_or_default(),
                None => "(other values)".to_string(),
            };
            let counts = counts.iter().map(|(value, count)| (name(value), Value::from(*count)));
            columns.insert(self.columns[*column].clone(), Value::Object(counts.collect()));
        }
        if columns.is_empty() { Value::Null } else { Value::Object(columns) }
    }
}

/// Returns the numbers of the parts with a name.
///
/// # Errors
/// If there is none.
pub(crate) fn parts_named(model: &ExactModel, name: &str) -> Result<Vec<u32>> {
    let parts: Vec<u32> =
        (0..).zip(model.parts()).filter(|(_, own)| *own == name).map(|(part, _)| part).collect();
    if parts.is_empty() {
        let (file, near) = (model.path().display(), near_names(model.parts(), name).join(", "));
        if near.is_empty() {
            let count = model.parts().len();
            bail!("{file}: has no object {name} among its {count}; `spinney stats --each {file}` lists them");
        }
        bail!("{file}: has no object {name}; similar names are {near}");
    }
    Ok(parts)
}

/// Returns the names that are most similar to one: first those that contain it or that make up most
/// of it, then those that have at least half of their characters in common with it, at the start
/// and at the end.
fn near_names<'a>(names: &'a [String], name: &str) -> Vec<&'a str> {
    /// Maximum number of names.
    const MAX_NAMES: usize = 5;
    let name = name.to_lowercase();
    let likeness = |other: &String| {
        let other = other.to_lowercase();
        let (most, least) = (other.len().max(name.len()), other.len().min(name.len()));
        let has = !name.is_empty()
            && (other.contains(&name) || 2 * other.len() >= name.len() && name.contains(&other));
        let same = |(a, b): &(u8, u8)| a == b;
        let start = other.bytes().zip(name.bytes()).take_while(same).count();
        let end = other.bytes().rev().zip(name.bytes().rev()).take_while(same).count();
        let common = (start + end).min(least);
        (has || 2 * common >= most).then_some((has, common))
    };
    let likely = names.iter().filter_map(|own| likeness(own).map(|likeness| (likeness, own.as_str())));
    let mut near: Vec<((bool, usize), &str)> = likely.collect();
    near.sort_by_key(|(likeness, _)| std::cmp::Reverse(*likeness));
    near.into_iter().take(MAX_NAMES).map(|(_, own)| own).collect()
}

/// Formats an object as a line of text; without its volume if the unit is unknown.
fn object_as_text(
    part: u32,
    name: &str,
    (measures, is_known): (Option<&PartMeasures>, bool),
    about: &Option<String>,
    of_faces: &Value,
) -> String {
    let none = || "-".to_string();
    let bounds =
        measures.and_then(|own| own.measures.bounds).map_or_else(none, |bounds| list(bounds.as_flattened()));
    let closed = measures.filter(|own| own.is_closed && is_known);
    let volume = closed.map_or_else(none, |own| own.measures.volume.to_string());
    let about = about.as_deref().map_or(String::new(), |about| format!("\t{about}"));
    let of_faces = if of_faces.is_null() { String::new() } else { format!("\tfaces {of_faces}") };
    format!("{part} {bounds} {volume}\t{name}{about}{of_faces}")
}

fn object_as_json(
    part: u32,
    name: &str,
    (measures, is_known): (Option<&PartMeasures>, bool),
    about: &Option<String>,
    of_faces: &Value,
) -> String {
    let closed = measures.filter(|own| own.is_closed);
    // (A string that is not JSON is returned as a JSON string.)
    let about = about.as_deref().map(|text| serde_json::from_str(text).unwrap_or_else(|_| Value::from(text)));
    let object = json!({
        "part": part,
        "name": name,
        "faces": measures.map_or(0, |own| own.measures.faces),
        "closed": closed.is_some(),
        "world": measures.and_then(|own| own.measures.bounds),
        "volume": closed.filter(|_| is_known).map(|own| own.measures.volume),
        "area": measures.filter(|_| is_known).map(|own| own.measures.area),
        "attributes": about,
        "face_values": of_faces,
    });
    object.to_string()
}

/// Lists the pairs of objects that overlap or touch, in an exact model, or else in a mesh file on a
/// grid of unit width `snap`.
pub(crate) fn find_contacts(
    view: Option<&ModelView>,
    file: &Path,
    is_json: bool,
    (snap, memory): (Option<f64>, u64),
    global: &Global,
    found: &mut Found,
) -> Result<()> {
    let mut take = |contact: &ObjectContact, names: [&str; 2]| {
        found.take(0, "", &|| {
            if is_json { contact_as_json(contact, names) } else { contact_as_text(contact, names) }
        })
    };
    if let Some(view) = view {
        if snap.is_some() {
            bail!(
                "{}: is an exact model, which has a grid; --snap works only with mesh files",
                file.display()
            );
        }
        let work = Work::start(global, "objects")?;
        let name = |part: u32| view.file().parts().get(part as usize).map_or("", String::as_str);
        view.object_contacts(memory, &work, &mut |contact| take(contact, contact.parts.map(name)))?;
    } else if mesh::is_model(file, global.access())? {
        let models =
            spinney::raw::import::mesh::open_all_with(&[file.to_path_buf()], memory, global.access())?;
        let mut options = spinney::import::mesh::ExactOptions::new();
        (options.snap, options.memory) = (snap, memory);
        let work = Work::start(global, "objects")?;
        mesh::model_contacts(models, &options, &work, &mut |found| {
            take(&found.contact, [&found.names[0], &found.names[1]])
        })?;
    } else {
        bail!("{}: is not an exact model or a mesh file, which --contacts needs", file.display());
    }
    Ok(())
}

fn list(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}

fn contact_as_text(contact: &ObjectContact, [first, second]: [&str; 2]) -> String {
    let ObjectContact { kind, volume, area, place, .. } = contact;
    format!("{} {volume} {area} {}\t{first}\t{second}", kind.name(), list(place))
}

fn contact_as_json(contact: &ObjectContact, names: [&str; 2]) -> String {
    let ObjectContact { parts, kind, volume, area, place, .. } = contact;
    json!({ "kind": kind.name(), "parts": parts, "names": names, "volume": volume, "area": area, "place": place })
        .to_string()
}
