//! Features of trees of lines, and points with the lines nearest to them, as files of features.

use std::path::Path;

use crate::export::{
    AttributeType, AttributeValue, FeatureParts, GeometryKind, VectorFeature, VectorFormat, VectorLayer,
    VectorWriter, bounds_of, push_attribute,
};
use crate::import::feature::{Feature, FeatureGeometry, FeatureOptions, open_features};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_lines::{LineFeature, LineTree, LineValue, NearLine, ValueKind};

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

/// Name of a file's only layer.
fn layer_name(path: &Path) -> String {
    path.file_stem().map_or_else(|| "lines".into(), |stem| stem.to_string_lossy().into_owned())
}

/// Places of attributes by their names; of all if none are named.
fn chosen_of(tree: &LineTree, names: Option<&[String]>) -> Result<Vec<usize>> {
    let own = tree.attributes();
    let Some(names) = names else { return Ok((0..own.len()).collect()) };
    let place = |name: &String| {
        own.iter().position(|attribute| attribute.name == *name).ok_or_else(|| {
            let known: Vec<&str> = own.iter().map(|attribute| attribute.name.as_str()).collect();
            let expected = format!("one that features have: {}", known.join(", "));
            Error::invalid("attribute", format!("`{name}`"), expected)
        })
    };
    names.iter().map(place).collect()
}

/// Writes whole features of a tree of lines: all, or those of which a line passes through a window; with some attributes, or all. Hands out how many.
///
/// # Errors
/// If there is no attribute of a name, the tree is damaged or cannot be read, or the output cannot be written.
pub fn export_lines(
    tree: &LineTree,
    window: Option<[[f64; 2]; 2]>,
    names: Option<&[String]>,
    (output, format): (Output, VectorFormat),
    progress: &dyn Progress,
) -> Result<u64> {
    let chosen = chosen_of(tree, names)?;
    let numbers = window.map(|window| tree.window(window, progress)).transpose()?;
    let count = numbers.as_ref().map_or(tree.len(), |numbers| numbers.len() as u64);
    let all = || -> Box<dyn Iterator<Item = u64>> {
        match &numbers {
            Some(numbers) => Box::new(numbers.iter().copied()),
            None => Box::new(0..tree.len()),
        }
    };
    // What the layer says of its features is known before the first is written.
    let (mut is_multi, mut bounds) = (false, None::<[[i32; 2]; 2]>);
    tree.features(&mut all(), &mut |_, feature| {
        is_multi |= feature.lines.len() > 1;
        for vertex in feature.lines.iter().flatten() {
            let [least, most] = bounds.get_or_insert([*vertex; 2]);
            for axis in 0..2 {
                least[axis] = least[axis].min(vertex[axis]);
                most[axis] = most[axis].max(vertex[axis]);
            }
        }
        Ok(())
    })?;
    let attributes = chosen.iter().map(|place| {
        let attribute = &tree.attributes()[*place];
        (attribute.name.clone(), type_of(attribute.kind))
    });
    let layer = VectorLayer {
        name: layer_name(output.path()),
        kind: Some(GeometryKind::Line),
        is_multi,
        has_z: false,
        attributes: attributes.collect(),
        crs: tree.metadata().frame.crs.clone(),
        bounds: bounds.map_or([[0.0; 2]; 2], |bounds| bounds.map(|corner| tree.grid().to_world(corner))),
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let mut done = 0;
    tree.features(&mut all(), &mut |_, feature| {
        let values: Vec<AttributeValue<'_>> = chosen
            .iter()
            .map(|place| feature.values.get(*place).map_or(AttributeValue::None, value_of))
            .collect();
        let geometry = geometry_of(tree, feature);
        let parts = FeatureParts::of(&geometry);
        let is_empty = feature.lines.is_empty();
        writer.write_feature(&VectorFeature {
            id: None,
            geometry: if is_empty { None } else { Some((GeometryKind::Line, &parts)) },
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

fn geometry_of(tree: &LineTree, feature: &LineFeature) -> FeatureGeometry {
    let line = |line: &Vec<[i32; 2]>| line.iter().map(|vertex| tree.grid().to_world(*vertex)).collect();
    FeatureGeometry::Lines(feature.lines.iter().map(line).collect())
}

/// What came of joining points with lines.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JoinSummary {
    /// Number of points.
    pub points: u64,
    /// Number of those that have a line that is near enough.
    pub joined: u64,
    /// The sum of their distances.
    pub sum: f64,
    /// The greatest of their distances.
    pub most: f64,
}

/// Points that are joined at a time.
const TOGETHER: usize = 1 << 16;

/// Joins each point of a file of features to the line nearest to it, of at most a distance: its attributes get the number of the line's feature (`line`, from 0), the
/// distance, and the attributes of that feature, or some of them. With an output, the points are written to it.
///
/// # Errors
/// If a feature is no single point, the systems differ, there is no attribute of a name, a file cannot be read, or the output cannot be written.
pub fn join_nearest_lines(
    tree: &LineTree,
    points: &Path,
    (within, names): (f64, Option<&[String]>),
    output: Option<(Output, VectorFormat)>,
    progress: &dyn Progress,
) -> Result<JoinSummary> {
    let chosen = chosen_of(tree, names)?;
    let mut reader = open_features(points, &FeatureOptions::default())?;
    let schema = reader.schema().clone();
    if let (Some(own), Some(other)) = (&tree.metadata().frame.crs, &schema.crs)
        && !own.is_same(other)
    {
        let advice = format!("bring them to the system of the lines first, {own}");
        return Err(Error::unsupported(points, format!("points in {other}"), advice));
    }
    let mut attributes = schema.attributes.clone();
    let added = chosen.iter().map(|place| &tree.attributes()[*place]);
    let added = added.map(|attribute| (attribute.name.clone(), type_of(attribute.kind)));
    let own = [("line".into(), AttributeType::Integer), ("distance".into(), AttributeType::Number)];
    for (name, kind) in own.into_iter().chain(added) {
        push_attribute(&mut attributes, name, kind);
    }
    let mut writer = None;
    if let Some((output, format)) = output {
        let bounds = bounds_in(points)?;
        let crs = schema.crs.clone().or(tree.metadata().frame.crs.clone());
        let (kind, name) = (Some(GeometryKind::Point), layer_name(output.path()));
        let layer = VectorLayer { name, kind, is_multi: false, has_z: false, attributes, crs, bounds };
        writer = Some(VectorWriter::create(output, format, layer)?);
    }
    let mut summary = JoinSummary::default();
    loop {
        let (mut features, mut places) = (Vec::new(), Vec::new());
        while features.len() < TOGETHER {
            let Some(feature) = reader.next()? else { break };
            let number = summary.points + features.len() as u64 + 1;
            places.extend(place_of(points, number, &feature)?);
            features.push(feature);
        }
        if features.is_empty() {
            break;
        }
        let mut near =
            tree.nearest(&places, (1, within), progress)?.into_iter().map(|near| near.first().copied());
        let near: Vec<Option<NearLine>> = features
            .iter()
            .map(|feature| feature.geometry.as_ref().and_then(|_| near.next().flatten()))
            .collect();
        for near in near.iter().flatten() {
            summary.joined += 1;
            summary.sum += near.distance;
            summary.most = summary.most.max(near.distance);
        }
        summary.points += features.len() as u64;
        if let Some(writer) = &mut writer {
            write_joined(tree, &chosen, &features, &near, writer)?;
        }
    }
    if let Some(writer) = writer {
        writer.finish(progress)?;
    }
    Ok(summary)
}

/// The place of a feature; none if it has none.
fn place_of(path: &Path, number: u64, feature: &Feature) -> Result<Option<[f64; 2]>> {
    match &feature.geometry {
        None => Ok(None),
        Some(FeatureGeometry::Points(points)) if points.len() == 1 => Ok(Some(points[0])),
        Some(_) => {
            let advice = "the nearest line is asked for of points alone";
            Err(Error::unsupported(path, format!("feature {number}, which is no single point,"), advice))
        }
    }
}

/// Least and greatest place of all points of a file.
fn bounds_in(path: &Path) -> Result<[[f64; 2]; 2]> {
    let mut reader = open_features(path, &FeatureOptions::default())?;
    let mut bounds: Option<[[f64; 2]; 2]> = None;
    let mut number = 0;
    while let Some(feature) = reader.next()? {
        number += 1;
        if let Some(place) = place_of(path, number, &feature)? {
            let around = bounds.get_or_insert([place; 2]);
            let corners = [around[0], around[1], place];
            *around = bounds_of(&mut corners.iter());
        }
    }
    Ok(bounds.unwrap_or_default())
}

/// Writes points with what is known of the lines nearest to them.
fn write_joined(
    tree: &LineTree,
    chosen: &[usize],
    features: &[Feature],
    near: &[Option<NearLine>],
    writer: &mut VectorWriter,
) -> Result<()> {
    // The features of the lines, each read once.
    let mut numbers: Vec<u64> = near.iter().flatten().map(|near| near.feature).collect();
    spinney_base::sort::numbers64(&mut numbers);
    numbers.dedup();
    let mut lines: Vec<Vec<LineValue>> = Vec::with_capacity(numbers.len());
    tree.features(&mut numbers.iter().copied(), &mut |_, feature| {
        let value = |place: &usize| feature.values.get(*place).cloned().unwrap_or(LineValue::None);
        lines.push(chosen.iter().map(value).collect());
        Ok(())
    })?;
    for (feature, near) in features.iter().zip(near) {
        let mut values: Vec<AttributeValue<'_>> =
            feature.attributes.iter().map(AttributeValue::from).collect();
        let line = near.and_then(|near| lines.get(numbers.binary_search(&near.feature).ok()?));
        values.push(near.map_or(AttributeValue::None, |near| AttributeValue::Integer(near.feature as i64)));
        values.push(near.map_or(AttributeValue::None, |near| AttributeValue::Number(near.distance)));
        match line {
            Some(line) => values.extend(line.iter().map(value_of)),
            None => values.extend(chosen.iter().map(|_| AttributeValue::None)),
        }
        let parts = feature.geometry.as_ref().map(FeatureParts::of);
        writer.write_feature(&VectorFeature {
            id: feature.id.as_ref(),
            geometry: parts.as_ref().map(|parts| (GeometryKind::Point, parts as _)),
            attributes: &values,
        })?;
    }
    Ok(())
}
