//! Export of features of line trees, and joins of feature files with them.

mod crossing;
mod joined;
mod nearest;

use std::path::Path;

use crate::export::{
    AttributeType, AttributeValue, GeometryKind, VectorFeature, VectorFormat, VectorLayer, VectorWriter,
};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_lines::{LineFeature, LineTree, LineValue, ValueKind};

pub use crossing::{CrossingSummary, join_crossing_lines};
pub use nearest::{JoinSummary, join_nearest_lines};

fn type_of(kind: ValueKind) -> AttributeType {
    match kind {
        ValueKind::Integer => AttributeType::Integer,
        ValueKind::Number => AttributeType::Number,
        ValueKind::Text => AttributeType::Text,
        ValueKind::Boolean => AttributeType::Boolean,
        ValueKind::Json => AttributeType::Json,
        ValueKind::Mixed => AttributeType::Mixed,
    }
}

fn value_of(value: &LineValue) -> AttributeValue<'_> {
    match value {
        LineValue::None => AttributeValue::None,
        LineValue::Integer(number) => AttributeValue::Integer(*number),
        LineValue::Number(number) => AttributeValue::Number(*number),
        LineValue::Text(text) => AttributeValue::Text(text),
        LineValue::Boolean(is) => AttributeValue::Boolean(*is),
        LineValue::Json(text) => AttributeValue::Json(text),
    }
}

/// Returns the name of a file's only layer; `lines` for standard output.
fn layer_name(path: &Path) -> String {
    let stem = path.file_stem().filter(|stem| *stem != "-");
    stem.map_or_else(|| "lines".into(), |stem| stem.to_string_lossy().into_owned())
}

/// Returns the indices of attributes by their names; of all without names.
fn chosen_of(tree: &LineTree, names: Option<&[String]>) -> Result<Vec<usize>> {
    let own = tree.attributes();
    let Some(names) = names else { return Ok((0..own.len()).collect()) };
    let index = |name: &String| {
        own.iter().position(|attribute| attribute.name == *name).ok_or_else(|| {
            let known: Vec<&str> = own.iter().map(|attribute| attribute.name.as_str()).collect();
            let expected = format!("one of the features' attributes: {}", known.join(", "));
            Error::invalid("attribute", format!("`{name}`"), expected)
        })
    };
    names.iter().map(index).collect()
}

/// Writes complete features of a line tree: all, or those with the given numbers, which ascend;
/// with all or some attributes. Returns their number.
///
/// # Errors
/// If an attribute name is unknown, the tree is corrupt or cannot be read, or the output cannot be
/// written.
pub fn export_lines(
    tree: &LineTree,
    numbers: Option<&[u64]>,
    names: Option<&[String]>,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<u64> {
    let chosen = chosen_of(tree, names)?;
    let count = numbers.map_or(tree.len(), |numbers| numbers.len() as u64);
    let all = || -> Box<dyn Iterator<Item = u64>> {
        match numbers {
            Some(numbers) => Box::new(numbers.iter().copied()),
            None => Box::new(0..tree.len()),
        }
    };
    // The properties of the layer must be known before the first feature is written.
    let (mut is_multi, mut bounds) = (false, None::<[[i32; 3]; 2]>);
    tree.features(&mut all(), &mut |_, feature| {
        is_multi |= feature.lines.len() > 1;
        for vertex in feature.lines.iter().flatten() {
            let [least, most] = bounds.get_or_insert([*vertex; 2]);
            for axis in 0..3 {
                least[axis] = least[axis].min(vertex[axis]);
                most[axis] = most[axis].max(vertex[axis]);
            }
        }
        Ok(())
    })?;
    let attributes = chosen.iter().map(|index| {
        let attribute = &tree.attributes()[*index];
        (attribute.name.clone(), type_of(attribute.kind))
    });
    let layer = VectorLayer {
        name: layer_name(output.path()),
        kind: Some(GeometryKind::Line),
        is_multi,
        has_z: tree.grid().axes() == 3,
        attributes: attributes.collect(),
        crs: tree.metadata().frame.crs.clone(),
        bounds: in_plane(bounds.map(|bounds| bounds.map(|corner| tree.grid().to_world(corner)))),
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let mut done = 0;
    tree.features(&mut all(), &mut |_, feature| {
        let values: Vec<AttributeValue<'_>> = chosen
            .iter()
            .map(|index| feature.values.get(*index).map_or(AttributeValue::None, value_of))
            .collect();
        let lines = geometry_of(tree, feature);
        writer.write_feature(&VectorFeature {
            id: None,
            geometry: if lines.is_empty() { None } else { Some((GeometryKind::Line, &lines)) },
            attributes: &values,
        })?;
        done += 1;
        if done % 1024 == 0 {
            progress.check()?;
            progress.advance(1024, count);
        }
        Ok(())
    })?;
    writer.finish(progress)?;
    Ok(done)
}

fn geometry_of(tree: &LineTree, feature: &LineFeature) -> Vec<Vec<[f64; 3]>> {
    let line = |line: &Vec<[i32; 3]>| line.iter().map(|vertex| tree.grid().to_world(*vertex)).collect();
    feature.lines.iter().map(line).collect()
}

/// Returns bounds of a layer: those in x and y, zeros if there are none.
fn in_plane(bounds: Option<[[f64; 3]; 2]>) -> [[f64; 2]; 2] {
    bounds.unwrap_or_default().map(|[x, y, _]| [x, y])
}
