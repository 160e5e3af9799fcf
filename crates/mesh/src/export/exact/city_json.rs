//! Exact models as CityJSON: an object per part, surfaces with holes, vertices as whole numbers on the grid.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::numbering::CornerNumbers;
use super::survey::Survey;
use super::{ExactSummary, Job, temporary_folder};
use crate::export::sink::failed;
use spinney_base::io::{Output, Sorter};
use spinney_base::{Error, Result};
use spinney_brep::Face;
use spinney_brep::attributes::each_member;
use spinney_crs::Crs;

/// Bytes after which a run ends.
const MOST_BYTES: u64 = 1 << 20;

/// Bytes of memory in which runs of faces of one part are sorted.
const MEMORY: u64 = 64 << 20;

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
    job.each(&mut |face| {
        faces += 1;
        corners.next(face.points.len(), &mut found)?;
        surfaces.push(face, &found)
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
    let end = |part: u32| if survey.is_closed(part) { "]]}]}" } else { "]}]}" };
    surfaces.finish(job, |part, bytes| {
        if open != Some(part) {
            if let Some(before) = open {
                text(end(before))?;
            }
            open = Some(part);
            objects(part + 1, &mut text)?;
            let (kind, brackets) =
                if survey.is_closed(part) { ("Solid", "[[") } else { ("MultiSurface", "[") };
            text(&format!(",\"geometry\":[{{\"type\":\"{kind}\",\"lod\":\"2\",\"boundaries\":{brackets}"))?;
        } else {
            text(",")?;
        }
        text(bytes)
    })?;
    if let Some(last) = open {
        text(end(last))?;
    }
    let parts = u32::try_from(all.len()).unwrap_or(u32::MAX);
    if open.is_none_or(|last| last + 1 < parts) {
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

fn member(key: &str, json: &str) -> String {
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

/// Texts of surfaces in a temporary file, until all of a part are there.
struct Surfaces {
    folder: PathBuf,
    file: BufWriter<File>,
    runs: Sorter,
    /// Number of runs: of surfaces of the same part, and not too many.
    count: u64,
    part: Option<u32>,
    start: u64,
    at: u64,
    text: String,
}

impl Surfaces {
    fn new(folder: &Path) -> Result<Surfaces> {
        let file = tempfile::tempfile_in(folder).map_err(Error::io(folder, "use a temporary file"))?;
        Ok(Surfaces {
            folder: folder.to_path_buf(),
            file: BufWriter::with_capacity(1 << 20, file),
            runs: Sorter::new(folder, 20, MEMORY),
            count: 0,
            part: None,
            start: 0,
            at: 0,
            text: String::new(),
        })
    }

    /// Adds a surface whose corners have such numbers.
    fn push(&mut self, face: &Face<'_>, numbers: &[u64]) -> Result<()> {
        if self.part != Some(face.part) || self.at - self.start > MOST_BYTES {
            self.end_run()?;
            self.part = Some(face.part);
        }
        self.text.clear();
        if self.at > self.start {
            self.text.push(',');
        }
        let mut start = 0;
        for &end in face.ring_ends {
            self.text.push_str(if start == 0 { "[[" } else { ",[" });
            for (i, number) in numbers[start..end].iter().enumerate() {
                if i > 0 {
                    self.text.push(',');
                }
                self.text.push_str(&number.to_string());
            }
            self.text.push(']');
            start = end;
        }
        self.text.push_str(if start == 0 { "[]\n" } else { "]\n" });
        self.at += self.text.len() as u64;
        self.file.write_all(self.text.as_bytes()).map_err(Error::io(&self.folder, "use a temporary file"))
    }

    fn end_run(&mut self) -> Result<()> {
        let Some(part) = self.part.filter(|_| self.at > self.start) else { return Ok(()) };
        // Parts one after the other, each with its runs in order; there cannot be 2^32 of them in a model that
        // numbers of this size hold.
        let key = u64::from(part) << 32 | self.count & u64::from(u32::MAX);
        let mut item = Vec::with_capacity(20);
        item.extend(part.to_le_bytes());
        item.extend(self.start.to_le_bytes());
        item.extend((self.at - self.start).to_le_bytes());
        self.count += 1;
        self.start = self.at;
        self.runs.push(key, item)
    }

    /// Hands out all surfaces, part by part, in pieces of text; commas between runs are left to the caller.
    fn finish(mut self, job: &Job<'_>, mut each: impl FnMut(u32, &str) -> Result<()>) -> Result<()> {
        self.end_run()?;
        let failed = || Error::io(&self.folder, "use a temporary file");
        let mut file = self.file.into_inner().map_err(io::IntoInnerError::into_error).map_err(failed())?;
        let mut bytes = Vec::new();
        self.runs.finish(&mut |item| {
            job.progress.check()?;
            let eight = |at: usize| u64::from_le_bytes(item[at..at + 8].try_into().unwrap_or_default());
            let part = u32::from_le_bytes(item[..4].try_into().unwrap_or_default());
            let (start, len) = (eight(4), eight(12));
            file.seek(SeekFrom::Start(start)).map_err(failed())?;
            bytes.clear();
            (&mut file).take(len).read_to_end(&mut bytes).map_err(failed())?;
            each(part, str::from_utf8(&bytes).unwrap_or_default())
        })
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
