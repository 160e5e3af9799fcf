//! Objects of models that are chosen by what is said of them.

use std::collections::{BTreeSet, HashMap};

use anyhow::Result;
use serde_json::Value;
use spinney::import::feature::{AttributeCondition, FeatureAttribute, FeatureFilter};

/// The parts for which all conditions hold, or for an object that they are a part of: on `id`, which is the name, on `type`, and on the
/// attributes. `about` gives what is said of a part, a JSON object, if anything is.
pub(crate) fn chosen(
    filter: &FeatureFilter,
    names: &[String],
    about: &dyn Fn(u32) -> Result<Option<String>>,
) -> Result<BTreeSet<u32>> {
    let mut found = BTreeSet::new();
    let mut parents: Vec<(u32, Vec<String>)> = Vec::new();
    for (part, name) in (0..).zip(names) {
        let about: Value =
            about(part)?.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or(Value::Null);
        let holds = |condition: &AttributeCondition| {
            let value = match condition.name.as_str() {
                "id" => FeatureAttribute::Text(name.clone()),
                "type" => attribute(&about["type"]),
                name => attribute(&about["attributes"][name]),
            };
            condition.holds(&value)
        };
        if filter.conditions.iter().all(holds) {
            found.insert(part);
        } else if let Some(list) = about["parents"].as_array() {
            parents.push((part, list.iter().filter_map(|name| name.as_str().map(String::from)).collect()));
        }
    }
    let numbers: HashMap<&str, u32> = names.iter().map(String::as_str).zip(0..).collect();
    // (Parts of parts: as long as there is one more.)
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

fn attribute(value: &Value) -> FeatureAttribute {
    match value {
        Value::Null => FeatureAttribute::None,
        Value::Bool(is) => FeatureAttribute::Boolean(*is),
        Value::String(text) => FeatureAttribute::Text(text.clone()),
        Value::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(number), _) => FeatureAttribute::Integer(number),
            (None, Some(number)) => FeatureAttribute::Number(number),
            (None, None) => FeatureAttribute::None,
        },
        Value::Array(_) | Value::Object(_) => FeatureAttribute::Json(value.to_string()),
    }
}
