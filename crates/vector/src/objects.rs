//! Objects of models (city objects, groups, files): filters and tables.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use serde_json::Value;

use crate::export::{
    AttributeType, AttributeValue, Geometry, GeometryKind, VectorFeature, VectorFormat, VectorLayer,
    VectorWriter, push_attribute,
};
use crate::import::feature::FeatureAttribute;
use crate::import::filter::{AttributeCondition, FeatureFilter};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_brep::query::PartMeasures;
use spinney_brep::{ExactModel, Faces, ModelView};

/// Properties of all parts that count as attributes.
const OWN: [&str; 2] = ["id", "type"];
/// Maximum number of known names in an error message.
const MAX_REMEMBERED: usize = 200;

/// Returns the numbers of the parts for which all conditions hold, and of the parts of these.
/// Conditions apply to `id` (the name), `type`, and the attributes. `about` returns the metadata of
/// a part, if any, as a JSON object in the form of [`Attributes`](spinney_brep::Attributes).
///
/// # Errors
/// Those of `about`; if no part has an attribute of the conditions.
pub fn choose_objects(
    filter: &FeatureFilter,
    names: &[String],
    about: &dyn Fn(u32) -> Result<Option<String>>,
) -> Result<BTreeSet<u32>> {
    let mut found = BTreeSet::new();
    let mut parents: Vec<(u32, Vec<String>)> = Vec::new();
    let mut unknown: BTreeSet<&str> = filter.names().filter(|name| !OWN.contains(name)).collect();
    let mut known: BTreeSet<String> = OWN.map(String::from).into();
    for (part, name) in (0..).zip(names) {
        let about = parsed(about(part)?);
        if let Some(own) = about["attributes"].as_object().filter(|_| !unknown.is_empty()) {
            unknown.retain(|name| !own.contains_key(*name));
            let left = MAX_REMEMBERED.saturating_sub(known.len());
            known.extend(own.keys().take(left).cloned());
        }
        let holds = |condition: &AttributeCondition| {
            condition.holds(&match condition.name.as_str() {
                "id" => FeatureAttribute::Text(name.clone()),
                "type" => FeatureAttribute::from(&about["type"]),
                name => FeatureAttribute::from(&about["attributes"][name]),
            })
        };
        if filter.conditions.iter().all(holds) {
            found.insert(part);
        } else if let Some(list) = about["parents"].as_array() {
            parents.push((part, list.iter().filter_map(|name| name.as_str().map(String::from)).collect()));
        }
    }
    if let Some(name) = unknown.first() {
        let known: Vec<String> = known.into_iter().collect();
        let expected = format!("one of the objects' attributes: {}", known.join(", "));
        return Err(Error::invalid("attribute", format!("{name}, which no object has"), expected));
    }
    let numbers: HashMap<&str, u32> = names.iter().map(String::as_str).zip(0..).collect();
    // Add parts of selected parts until there are no more.
    loop {
        let before = parents.len();
        parents.retain(|(part, of)| {
            let is_of = of.iter().any(|name| numbers.get(name.as_str()).is_some_and(|n| found.contains(n)));
            !(is_of && found.insert(*part))
        });
        if parents.len() == before {
            return Ok(found);
        }
    }
}

fn parsed(about: Option<String>) -> Value {
    about.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or(Value::Null)
}

/// Maximum number of attributes with their own columns.
const MAX_COLUMNS: usize = 1000;

/// Writes a table of a model's parts that have faces, or of those in `chosen`. A row has the name
/// (`id`), `type`, whether it is `closed`, the number of `faces`, `volume` (if closed), `area`,
/// minimum and maximum height (`zmin`, `zmax`), centre of gravity (`x`, `y`, `z`) and the part's
/// attributes. Geometries are the bounding rectangles, in the model's coordinates. Returns the
/// number of rows.
///
/// # Errors
/// If `memory` bytes are not enough for the measures (1 KB per part), if the file is corrupt or
/// changed in the meantime, if the output cannot be written, or on cancellation.
pub fn export_objects(
    view: &ModelView,
    chosen: Option<&BTreeSet<u32>>,
    output: Output,
    format: VectorFormat,
    memory: u64,
    progress: &dyn Progress,
) -> Result<u64> {
    let model = view.file();
    let mut parts = view.part_measures(memory, progress)?;
    parts.retain(|part| chosen.is_none_or(|chosen| chosen.contains(&part.part)));
    let mut columns: Vec<(String, AttributeType)> = FIXED.map(|(name, kind)| (name.into(), kind)).to_vec();
    let (own, left_out) = own_columns(model, &parts)?;
    if left_out > 0 {
        let text = format!(
            "{left_out} attributes of objects exceed the table's limit of {MAX_COLUMNS} and are dropped"
        );
        progress.warn(output.path(), &text);
    }
    for (name, kind) in &own {
        push_attribute(&mut columns, name.clone(), *kind);
    }
    let [low, high] = view.bounds().unwrap_or([[0.0; 3]; 2]);
    let layer = VectorLayer {
        name: "objects".into(),
        kind: Some(GeometryKind::Polygon),
        is_multi: false,
        has_z: false,
        attributes: columns,
        crs: model.crs().cloned(),
        bounds: [[low[0], low[1]], [high[0], high[1]]],
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    // Degrees and heights have no common unit.
    let is_known = model.metadata().frame.cell_volume().is_ok();
    for part in &parts {
        progress.check()?;
        let about = parsed(model.part_attributes(part.part)?);
        let kind = FeatureAttribute::from(&about["type"]).to_text();
        let PartMeasures { is_closed, measures, .. } = part;
        let of_body =
            |value: f64| if *is_closed { AttributeValue::Number(value) } else { AttributeValue::None };
        let number = |value: Option<f64>| value.map_or(AttributeValue::None, AttributeValue::Number);
        let centre = measures.centre.filter(|_| *is_closed);
        let mut values = vec![
            AttributeValue::Text(&model.parts()[part.part as usize]),
            if kind.is_empty() { AttributeValue::None } else { AttributeValue::Text(&kind) },
            AttributeValue::Boolean(*is_closed),
            AttributeValue::Integer(measures.faces as i64),
            if is_known { of_body(measures.volume) } else { AttributeValue::None },
            if is_known { AttributeValue::Number(measures.area) } else { AttributeValue::None },
            number(measures.bounds.map(|[low, _]| low[2])),
            number(measures.bounds.map(|[_, high]| high[2])),
        ];
        values.extend([0, 1, 2].map(|axis| number(centre.map(|centre| centre[axis]))));
        let attributes: Vec<FeatureAttribute> =
            own.keys().map(|name| FeatureAttribute::from(&about["attributes"][name.as_str()])).collect();
        values.extend(attributes.iter().map(AttributeValue::from));
        let ring = measures.bounds.map(|[[west, south, _], [east, north, _]]| {
            let corners = [[west, south], [east, south], [east, north], [west, north], [west, south]];
            [corners.map(|[x, y]| [x, y, 0.0]).to_vec()]
        });
        let geometry = ring.as_ref().map(|ring| (GeometryKind::Polygon, ring as &dyn Geometry));
        writer.write_feature(&VectorFeature { id: None, geometry, attributes: &values })?;
    }
    model.check_unchanged()?;
    writer.finish(progress).map(|()| parts.len() as u64)
}

/// Columns of all tables.
const FIXED: [(&str, AttributeType); 11] = [
    ("id", AttributeType::Text),
    ("type", AttributeType::Text),
    ("closed", AttributeType::Boolean),
    ("faces", AttributeType::Integer),
    ("volume", AttributeType::Number),
    ("area", AttributeType::Number),
    ("zmin", AttributeType::Number),
    ("zmax", AttributeType::Number),
    ("x", AttributeType::Number),
    ("y", AttributeType::Number),
    ("z", AttributeType::Number),
];

/// Returns names and types of the parts' attributes, sorted by name, up to the limit; and the
/// number of dropped ones.
fn own_columns(
    model: &ExactModel,
    parts: &[PartMeasures],
) -> Result<(BTreeMap<String, AttributeType>, usize)> {
    let mut found: BTreeMap<String, AttributeType> = BTreeMap::new();
    let mut left_out: BTreeSet<String> = BTreeSet::new();
    for part in parts {
        let about = parsed(model.part_attributes(part.part)?);
        for (name, value) in about["attributes"].as_object().into_iter().flatten() {
            let Some(kind) = FeatureAttribute::from(value).kind() else { continue };
            let known = found.get(name).map(|known| known.with(kind));
            if known.is_some() || found.len() < MAX_COLUMNS {
                found.insert(name.clone(), known.unwrap_or(kind));
            } else {
                left_out.insert(name.clone());
            }
        }
    }
    Ok((found, left_out.len()))
}
