//! CityJSON export of exact models: an object per part, surfaces with holes and semantics, vertices
//! as integers on the grid.

use std::io::Write;
use std::path::Path;

use super::city_objects::{CityObjects, extent_of, extent_text, member};
use super::face_columns::FaceColumns;
use super::numbering::CornerNumbers;
use super::semantics::COLUMNS;
use super::shells::{Shell, Shells};
use super::surfaces::{List, Surfaces};
use super::survey::{Survey, join_bounds};
use super::{ExactSummary, Job};
use crate::export::sink::failed;
use crate::export::units::length;
use spinney_base::io::Output;
use spinney_base::{Error, Result};
use spinney_brep::Faces;
use spinney_brep::attributes::each_member;
use spinney_crs::Crs;

pub(super) fn write(job: &Job<'_>, mut output: Output) -> Result<ExactSummary> {
    let factor = unit_factor(job, output.path())?;
    let survey = Survey::of(job)?;
    let directory = output.temporary_directory();
    let mut shells = Shells::of(job, &survey, &directory)?;
    let path = output.path().to_path_buf();
    let mut text = |text: &str| output.write_all(text.as_bytes()).map_err(failed(&path));
    let grid = job.faces.grid();
    let (width, origin) = (grid.width() * factor, grid.to_world([0; 3]).map(|at| at * factor));
    text(&format!(
        "{{\"type\":\"CityJSON\",\"version\":\"2.0\",\"transform\":{{\"scale\":{},\"translate\":{}}},\n\"vertices\":[",
        numbers([width; 3]),
        numbers(origin)
    ))?;
    let mut separator = "\n";
    let mut vertex = |[x, y, z]: [i64; 3], text: &mut dyn FnMut(&str) -> Result<()>| -> Result<()> {
        text(&format!("{separator}[{x},{y},{z}]"))?;
        separator = ",\n";
        Ok(())
    };
    let mut corners =
        CornerNumbers::of(job, false, &directory, &mut |(point, _)| vertex(point.map(i64::from), &mut text))?;
    let mut city_objects = CityObjects::new(job, &survey, factor, corners.vertices);
    city_objects.each_address_point(&mut |point| vertex(point, &mut text))?;
    text("\n],\n")?;
    let parts = u32::try_from(job.faces.parts().len()).unwrap_or(u32::MAX);
    let bounds = (0..parts).map(|part| survey.bounds(part)).fold(None, join_bounds);
    let extent = bounds.map(|bounds| extent_of(bounds, grid, factor));
    let (about, lost_files) = about_file(&job.faces.file_attributes()?, job.faces.crs(), extent);
    text(&about)?;
    text("\"CityObjects\":{")?;
    let mut surfaces = Surfaces::new(&directory, &mut shells)?;
    let mut found = Vec::new();
    let mut faces = 0;
    let columns = job.faces.value_columns()?;
    let lost_columns = columns.iter().any(|name| !COLUMNS.contains(&name.as_str()));
    let wanted = if columns.is_empty() { &[][..] } else { &COLUMNS[..] };
    job.each_with_values(wanted, &mut |face, values| {
        faces += 1;
        corners.next(face.points.len(), &mut found)?;
        surfaces.push(face, &found, values)
    })?;
    let mut open: Option<(Shell, List)> = None;
    let mut next_part = 0;
    // Writes the objects before part `until` and returns the level of detail of the last one.
    // (Parts without faces are objects without geometry.)
    let mut objects = |until: u32, text: &mut dyn FnMut(&str) -> Result<()>| -> Result<String> {
        let mut lod = String::new();
        while next_part < until {
            text(if next_part == 0 { "\n" } else { ",\n" })?;
            let (start, own) = city_objects.start(next_part)?;
            text(&start)?;
            lod = own;
            next_part += 1;
            if next_part < until {
                text("}")?;
            }
        }
        Ok(lod)
    };
    let kind = |shell: Shell| match (survey.is_closed(shell.part), shell.solids) {
        (false, _) => ("MultiSurface", "[", "]"),
        (true, 0 | 1) => ("Solid", "[[", "]]"),
        (true, _) => ("MultiSolid", "[[[", "]]]"),
    };
    let end = |(shell, list): (Shell, List)| {
        let semantics = if list == List::Boundaries { "" } else { "}" };
        format!("{}{semantics}}}]}}", kind(shell).2)
    };
    let lost_values = surfaces.finish(job, &mut |shell, list, bytes| {
        let (name, begin, close) = kind(shell);
        match open {
            Some((now, before)) if now.part == shell.part && before == list => text(match list {
                List::Semantics => ",",
                _ if now.number == shell.number => ",",
                _ if now.solid == shell.solid => "],[",
                _ => "]],[[",
            })?,
            Some((now, _)) if now.part == shell.part => match list {
                List::Values => text(&format!("],\"values\":{begin}"))?,
                _ => text(&format!("{close},\"semantics\":{{\"surfaces\":["))?,
            },
            _ => {
                if let Some(before) = open {
                    text(&end(before))?;
                }
                let lod = serde_json::Value::from(objects(shell.part + 1, &mut text)?);
                text(&format!(",\"geometry\":[{{\"type\":\"{name}\",\"lod\":{lod},\"boundaries\":{begin}"))?;
            }
        }
        open = Some((shell, list));
        text(bytes)
    })?;
    if let Some(last) = open {
        text(&end(last))?;
    }
    if open.is_none_or(|(last, _)| last.part + 1 < parts) {
        objects(parts, &mut text)?;
        text("}")?;
    }
    text("\n}}\n")?;
    output.commit()?;
    Ok(ExactSummary {
        vertices: corners.vertices,
        faces,
        lost_colours: survey.has_colours,
        lost_attributes: lost_files + city_objects.lost,
        lost_values: lost_values > 0 || lost_columns,
        ..ExactSummary::default()
    })
}

/// Columns of face values that are not semantics.
pub(super) fn other_columns(faces: &dyn Faces) -> Result<FaceColumns> {
    let mut lost = faces.value_columns()?;
    lost.retain(|name| !COLUMNS.contains(&name.as_str()));
    Ok(FaceColumns { lost, ..FaceColumns::default() })
}

/// Units of the file per unit of the model. CityJSON coordinates are in the unit of the coordinate
/// system, or in metres if there is none.
fn unit_factor(job: &Job<'_>, path: &Path) -> Result<f64> {
    let (crs, unit) = (job.faces.crs(), job.faces.unit());
    let own = crs.and_then(Crs::unit);
    if own == Some("degrees") {
        let found =
            format!("CityJSON with coordinates in degrees ({})", crs.map(Crs::to_string).unwrap_or_default());
        let advice = "heights are not in degrees: build the model in a projected coordinate system, or write PLY or OBJ";
        return Err(Error::unsupported(path, found, advice));
    }
    let is_written = crs.is_some_and(|crs| reference_system(crs).is_some());
    let to = if is_written { length(own) } else { Some(1.0) };
    Ok(length(unit).zip(to).map_or(1.0, |(from, to)| from / to))
}

/// Lines with the metadata and the extensions, and the number of source files whose attributes are
/// left out. `extent` is the model's extent in units of the file.
fn about_file(files: &[String], crs: Option<&Crs>, extent: Option<[f64; 6]>) -> (String, u64) {
    let (mut metadata, mut lines) = (Vec::new(), String::new());
    let mut lost = 0;
    // With several source files, none describes the whole model.
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
    if let Some(extent) = extent {
        metadata.push(member("geographicalExtent", &extent_text(extent)));
    }
    if !metadata.is_empty() {
        lines.push_str(&format!("\"metadata\":{{{}}},\n", metadata.join(",")));
    }
    (lines, lost)
}

/// URL of a coordinate system that has a single EPSG code.
pub(super) fn reference_system(crs: &Crs) -> Option<String> {
    let numbers = crs.numbers().filter(|numbers| numbers.vertical.is_none())?;
    Some(format!("https://www.opengis.net/def/crs/EPSG/0/{}", numbers.horizontal))
}

/// Numbers as JSON that parses to the same values.
fn numbers(numbers: [f64; 3]) -> String {
    let [x, y, z] = numbers.map(|number| serde_json::Value::from(number).to_string());
    format!("[{x},{y},{z}]")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Malformed metadata.
    #[test]
    fn invalid_json_is_omitted() {
        let about = |documents: &[&str]| {
            about_file(&documents.iter().map(|text| text.to_string()).collect::<Vec<_>>(), None, None)
        };
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
