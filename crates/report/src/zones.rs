//! Statistics of polygons.

use serde_json::json;
use spinney_base::value::Number;
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ZoneChannel, ZoneStatistics};
use spinney_vector::import::feature::Feature;
use spinney_vector::import::zones::PolygonLayer;

use crate::{cell_area, class_as_json, class_name, printable_json};

/// Statistics of polygons as JSON, feature by feature. (As text, which takes a tenth of the memory that values would.)
pub struct ZoneReport<'a> {
    trees: &'a [&'a Dataset],
    quantiles: &'a [f64],
    /// Names of the attributes that are told; all if there is no list.
    attributes: Option<&'a [String]>,
    /// Number of features so far.
    count: usize,
    text: String,
}

impl<'a> ZoneReport<'a> {
    /// The text before all features, of layers of a file.
    pub fn begin(
        trees: &'a [&'a Dataset],
        quantiles: &'a [f64],
        attributes: Option<&'a [String]>,
    ) -> ZoneReport<'a> {
        ZoneReport { trees, quantiles, attributes, count: 0, text: "{\n  \"zones\": [".into() }
    }

    /// Adds the statistics of the next feature, which has such a number among those of the layer, of all layers of the tree.
    pub fn add(&mut self, layer: &PolygonLayer, number: usize, zones: &[ZoneStatistics]) {
        let mut json = self.feature(layer, &layer.features[number]);
        match zones {
            [zone] => json.extend(self.zone(self.trees[0], zone)),
            _ => {
                let rows = self.trees.iter().zip(zones).map(|(tree, zone)| {
                    let mut row = serde_json::Map::new();
                    row.insert("layer".into(), json!(tree.metadata().name));
                    row.insert("time".into(), json!(tree.metadata().time));
                    row.extend(self.zone(tree, zone));
                    serde_json::Value::from(row)
                });
                json.insert("layers".into(), rows.collect());
            }
        }
        let separator = if self.count > 0 { ",\n" } else { "\n" };
        self.count += 1;
        let json = format!("{:#}", serde_json::Value::from(json));
        // (Strings in JSON have no ends of lines.)
        let lines: Vec<String> = json.lines().map(|line| format!("    {line}")).collect();
        self.text.extend([separator, &lines.join("\n")]);
    }

    /// Adds the text behind all features.
    pub fn finish(&mut self) {
        self.text.push_str(if self.count > 0 { "\n  ]\n}\n" } else { "]\n}\n" });
    }

    /// Bytes of text that were not taken yet.
    pub fn held(&self) -> usize {
        self.text.len()
    }

    /// Takes the text so far.
    pub fn take(&mut self) -> String {
        let text = std::mem::take(&mut self.text);
        printable_json(&text).into_owned()
    }

    /// Id, name and attributes of a feature.
    fn feature(&self, layer: &PolygonLayer, feature: &Feature) -> Members {
        let is_wanted = |name: &String| self.attributes.is_none_or(|wanted| wanted.contains(name));
        let values =
            layer.attributes.iter().zip(&feature.attributes).filter(|((name, _), _)| is_wanted(name));
        let properties: Members = values.map(|((name, _), value)| (name.clone(), value.to_json())).collect();
        let members = [
            ("id", json!(feature.id)),
            ("name", json!(layer.name(feature))),
            ("properties", properties.into()),
        ];
        members.into_iter().map(|(name, value)| (name.to_string(), value)).collect()
    }

    /// Statistics of a zone's cells.
    fn zone(&self, tree: &Dataset, zone: &ZoneStatistics) -> Members {
        let area = cell_area(tree).ok();
        let channel = |channel: &ZoneChannel| {
            let ZoneChannel { cells, min, max, sum, mean, standard_deviation, values } = channel;
            let mut json = json!({
                "cells": cells,
                "min": min,
                "max": max,
                "sum": sum,
                "mean": mean,
                "standard_deviation": standard_deviation,
            });
            if let Some(values) = values {
                json["majority"] = class_as_json(values.majority);
                json["minority"] = class_as_json(values.minority);
                json["variety"] = json!(values.variety);
                json["median"] = json!(values.median);
                let quantiles = self.quantiles.iter().zip(&values.quantiles);
                json["quantiles"] = quantiles.map(|(at, value)| (at.to_string(), json!(value))).collect();
            }
            json
        };
        let class = |(value, cells): &(Number, f64)| {
            json!({
                "value": class_as_json(*value),
                "name": class_name(tree, *value),
                "cells": cells,
                "area_m2": area.map(|area| area * cells),
            })
        };
        let members = [
            ("cells", json!(zone.cells)),
            ("void_cells", json!(zone.void_cells)),
            ("void_share", json!(zone.void_share())),
            ("outside_cells", json!(zone.outside_cells)),
            ("area_m2", json!(area.map(|area| area * zone.cells))),
            ("channels", zone.channels.iter().map(channel).collect()),
            ("classes", zone.classes.iter().map(class).collect()),
        ];
        members.into_iter().map(|(name, value)| (name.to_string(), value)).collect()
    }
}

/// Members of an object, in their order.
type Members = serde_json::Map<String, serde_json::Value>;
