//! Exact models as CityJSON: an object per part, surfaces with holes and semantics, vertices as whole numbers on the grid.

use std::collections::HashSet;
use std::io::Write;

use super::numbering::CornerNumbers;
use super::semantics::COLUMNS;
use super::surfaces::{List, Surfaces};
use super::survey::Survey;
use super::{ExactSummary, Job, temporary_folder};
use crate::export::sink::failed;
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_brep::attributes::each_member;
use spinney_crs::Crs;

pub(super) fn write(job: &Job<'_>, mut output: Output) -> Result<ExactSummary> {
    let survey = Survey::of(job)?;
    let folder = temporary_folder(&output);
    let path = output.path().to_path_buf();
    let mut text = |text: &str| output.write_all(text.as_bytes()).map_err(failed(&path));
    let grid = job.faces.grid();
    let (width, origin) = (grid.width(), grid.to_world([0; 3]));
    text(&format!(
        "{{\"type\":\"CityJSON\",\"version\":\"2.0\",\"transform\":{{\"scale\":{},\"translate\":{}}},\n\"vertices\":[",
        numbers([width; 3]),
        numbers(origin)
    ))?;
    let mut separator = "\n";
    let mut corners = CornerNumbers::of(job, false, &folder, &mut |([x, y, z], _)| {
        text(&format!("{separator}[{x},{y},{z}]"))?;
        separator = ",\n";
        Ok(())
    })?;
    text("\n],\n")?;
    let (about, mut lost_attributes) = about_file(&job.faces.file_attributes()?, job.faces.crs());
    text(&about)?;
    text("\"CityObjects\":{")?;
    let mut surfaces = Surfaces::new(&folder)?;
    let mut found = Vec::new();
    let mut faces = 0;
    let columns = job.faces.value_columns()?;
    let wanted = if columns.is_empty() { &[][..] } else { &COLUMNS[..] };
    job.each_with_values(wanted, &mut |face, values| {
        faces += 1;
        corners.next(face.points.len(), &mut found)?;
        surfaces.push(face, &found, values)
    })?;
    let mut names = Names::default();
    let mut open = None;
    let mut next_part = 0;
    let all = job.faces.parts();
    // (Parts without faces are objects without geometry.)
    let mut objects = |until: u32, text: &mut dyn FnMut(&str) -> Result<()>| -> Result<()> {
        while next_part < until {
            let separator = if next_part == 0 { "\n" } else { ",\n" };
            let name = names.key(all.get(next_part as usize).map_or("", String::as_str));
            let object = job.faces.part_attributes(next_part)?;
            let object = object.as_deref().map(object_members);
            lost_attributes += u64::from(object == Some(None));
            let members = object.flatten().unwrap_or_else(|| format!("\"type\":{PLAIN}"));
            text(&format!("{separator}{name}:{{{members}"))?;
            next_part += 1;
            if next_part < until {
                text("}")?;
            }
        }
        Ok(())
    };
    let end_of_list = |part: u32| if survey.is_closed(part) { "]]" } else { "]" };
    let end = |(part, list): (u32, List)| {
        let semantics = if list == List::Boundaries { "" } else { "}" };
        format!("{}{semantics}}}]}}", end_of_list(part))
    };
    let lost_values = surfaces.finish(job, |part, list, bytes| {
        let (kind, brackets) = if survey.is_closed(part) { ("Solid", "[[") } else { ("MultiSurface", "[") };
        match open {
            Some(now) if now == (part, list) => text(",")?,
            Some((now, _)) if now == part => match list {
                List::Values => text(&format!("],\"values\":{brackets}"))?,
                _ => text(&format!("{},\"semantics\":{{\"surfaces\":[", end_of_list(part)))?,
            },
            _ => {
                if let Some(before) = open {
                    text(&end(before))?;
                }
                objects(part + 1, &mut text)?;
                text(&format!(
                    ",\"geometry\":[{{\"type\":\"{kind}\",\"lod\":\"2\",\"boundaries\":{brackets}"
                ))?;
            }
        }
        open = Some((part, list));
        text(bytes)
    })?;
    if let Some(last) = open {
        text(&end(last))?;
    }
    let parts = u32::try_from(all.len()).unwrap_or(u32::MAX);
    if open.is_none_or(|(last, _)| last + 1 < parts) {
        objects(parts, &mut text)?;
        text("}")?;
    }
    text("\n}}\n")?;
    output.commit()?;
    Ok(ExactSummary {
        vertices: corners.vertices,
        faces,
        lost_colours: survey.has_colours,
        lost_attributes,
        lost_values: lost_values > 0 || columns.iter().any(|name| !COLUMNS.contains(&name.as_str())),
        ..ExactSummary::default()
    })
}

/// The type of objects of which nothing else is known, in JSON.
const PLAIN: &str = "\"GenericCityObject\"";

/// The members of a city object from the text about a part, without its geometry; nothing if that is no JSON.
fn object_members(about: &str) -> Option<String> {
    let mut members = Vec::new();
    let mut kind = PLAIN.to_string();
    each_member(about, |key, value| match key {
        "type" => kind = value.into(),
        "geometry" => {}
        _ => members.push(member(key, value)),
    })
    .ok()?;
    members.insert(0, member("type", &kind));
    Some(members.join(","))
}

/// A member of a JSON object.
pub(super) fn member(key: &str, json: &str) -> String {
    format!("{}:{json}", serde_json::Value::from(key))
}

/// Lines with the metadata and the extensions, and the number of files of which what they say is left out.
fn about_file(files: &[String], crs: Option<&Crs>) -> (String, u64) {
    let (mut metadata, mut lines) = (Vec::new(), String::new());
    let mut lost = 0;
    // Of several files, none says what the model is.
    if let [about] = files {
        let outcome = each_member(about, |key, value| match key {
            "metadata" => {
                let members = each_member(value, |key, value| {
                    if !["referenceSystem", "geographicalExtent"].contains(&key) {
                        metadata.push(member(key, value));
                    }
                });
                lost = u64::from(members.is_err());
            }
            "extensions" => lines = format!("{},\n", member(key, value)),
            _ => {}
        });
        lost |= u64::from(outcome.is_err());
    } else {
        lost = files.len() as u64;
    }
    if let Some(url) = crs.and_then(reference_system) {
        metadata.push(member("referenceSystem", &serde_json::Value::from(url).to_string()));
    }
    if !metadata.is_empty() {
        lines.push_str(&format!("\"metadata\":{{{}}},\n", metadata.join(",")));
    }
    (lines, lost)
}

/// The name of a coordinate system, where it has one number.
pub(super) fn reference_system(crs: &Crs) -> Option<String> {
    let numbers = crs.numbers().filter(|numbers| numbers.vertical.is_none())?;
    Some(format!("https://www.opengis.net/def/crs/EPSG/0/{}", numbers.horizontal))
}

/// Numbers such that they are read as the same ones.
fn numbers(numbers: [f64; 3]) -> String {
    let [x, y, z] = numbers.map(|number| serde_json::Value::from(number).to_string());
    format!("[{x},{y},{z}]")
}

/// Keys of objects, none of which may come twice.
#[derive(Default)]
struct Names {
    taken: HashSet<String>,
}

impl Names {
    fn key(&mut self, name: &str) -> String {
        let mut unique = name.to_string();
        let mut number = 1;
        while self.taken.contains(&unique) {
            number += 1;
            unique = format!("{name} ({number})");
        }
        let key = serde_json::Value::from(unique.as_str()).to_string();
        self.taken.insert(unique);
        key
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Texts of files that somebody made up.
    #[test]
    fn what_is_no_json_is_left_out() {
        let members = |text: &str| object_members(text);
        assert_eq!(members("{}").unwrap(), "\"type\":\"GenericCityObject\"");
        let text = "{\"a\":[1.10],\"geometry\":[7],\"type\":\"Road\",\"type\":\"Bridge\"}";
        assert_eq!(members(text).unwrap(), "\"type\":\"Road\",\"a\":[1.10]");
        for wrong in ["", "{", "[]", "{\"a\":}", "{}}", "{\"a\":1},\"b\":{}"] {
            assert_eq!(members(wrong), None, "{wrong}");
        }
        let about =
            |texts: &[&str]| about_file(&texts.iter().map(|text| text.to_string()).collect::<Vec<_>>(), None);
        assert_eq!(about(&[]), (String::new(), 0));
        assert_eq!(about(&["{}"]), (String::new(), 0));
        let text = "{\"metadata\":{\"title\":\"x\",\"referenceSystem\":7},\"extensions\":{\"e\":1}}";
        let expected = "\"extensions\":{\"e\":1},\n\"metadata\":{\"title\":\"x\"},\n";
        assert_eq!(about(&[text]), (expected.into(), 0));
        assert_eq!(about(&[text, text]), (String::new(), 2));
        for wrong in ["no", "{\"metadata\":[]}"] {
            assert_eq!(about(&[wrong]), (String::new(), 1));
        }
    }
}
