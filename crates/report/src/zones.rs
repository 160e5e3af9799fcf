//! Statistics of polygons.

use serde_json::{Map, Value, json};
use spinney_base::value::{Number, SampleType};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ZoneChannel, ZoneStatistics};
use spinney_vector::import::feature::Feature;
use spinney_vector::import::zones::PolygonLayer;

use crate::{CellMeasure, JsonNumbers, class_name, measure_key, printable_json, world_unit};

/// Options of the JSON of polygon statistics.
#[derive(Clone, Copy)]
pub struct ZoneForm<'a> {
    /// Layers that were queried.
    pub trees: &'a [&'a Dataset],
    /// Quantiles that were requested.
    pub quantiles: &'a [f64],
    /// Names of the attributes to report; all if `None`.
    pub attributes: Option<&'a [String]>,
    /// Whether statistics are in a list of layers even if there is only one.
    pub has_layers: bool,
    /// Representation of numbers.
    pub numbers: JsonNumbers,
}

impl ZoneForm<'_> {
    /// Returns the statistics of the feature at index `number` of a layer of polygons, for all
    /// layers of the tree.
    pub fn as_json(&self, layer: &PolygonLayer, number: usize, zones: &[ZoneStatistics]) -> Value {
        let mut json = self.feature(layer, &layer.features[number]);
        match zones {
            [zone] if !self.has_layers => json.extend(self.zone(self.trees[0], zone)),
            _ => {
                let rows = self.trees.iter().zip(zones).map(|(tree, zone)| {
                    let metadata = tree.metadata();
                    let mut row = members([("layer", json!(metadata.name)), ("time", json!(metadata.time))]);
                    row.extend(self.zone(tree, zone));
                    Value::from(row)
                });
                json.insert("layers".into(), rows.collect());
            }
        }
        json.into()
    }

    /// Returns the id, name and attributes of a feature.
    fn feature(&self, layer: &PolygonLayer, feature: &Feature) -> Map<String, Value> {
        let is_wanted = |name: &String| self.attributes.is_none_or(|wanted| wanted.contains(name));
        let values =
            layer.attributes.iter().zip(&feature.attributes).filter(|((name, _), _)| is_wanted(name));
        let properties: Map<String, Value> =
            values.map(|((name, _), value)| (name.clone(), value.to_json())).collect();
        members([
            ("id", json!(feature.id)),
            ("name", json!(layer.name(feature))),
            ("properties", properties.into()),
        ])
    }

    /// Returns the statistics of a zone's cells.
    fn zone(&self, tree: &Dataset, zone: &ZoneStatistics) -> Map<String, Value> {
        let (measure, of) = (CellMeasure::of(tree).ok(), tree.header().form.value.sample);
        let each = measure.as_ref().map(|measure| measure.of_cell);
        let mean = zone.channels.first().map(|channel| channel.mean);
        let filled = measure.as_ref().map(|measure| measure.of_cell * measure.filled(zone.cells, mean));
        let key = measure_key(tree);
        let class = |(value, cells): &(Number, f64)| {
            json!({
                "value": self.numbers.class(*value, of),
                "name": class_name(tree, *value),
                "cells": cells,
                (key): each.map(|each| each * cells),
            })
        };
        let mut zone = members([
            ("cells", json!(zone.cells)),
            ("void_cells", json!(zone.void_cells)),
            ("void_share", json!(zone.void_share())),
            ("outside_cells", json!(zone.outside_cells)),
            (key, json!(filled)),
            ("channels", zone.channels.iter().map(|channel| self.channel(channel, of)).collect()),
            ("classes", zone.classes.iter().map(class).collect()),
        ]);
        if key == "volume" {
            zone.insert("unit".into(), json!(world_unit(tree)));
        }
        zone
    }

    /// Returns the statistics of a channel of a zone's cells.
    fn channel(&self, channel: &ZoneChannel, of: SampleType) -> Value {
        let ZoneChannel { cells, min, max, sum, mean, standard_deviation, values } = channel;
        let mut json = json!({
            "cells": cells,
            "min": self.numbers.sample(*min, of),
            "max": self.numbers.sample(*max, of),
            "sum": sum,
            "mean": mean,
            "standard_deviation": standard_deviation,
        });
        if let Some(values) = values {
            json["majority"] = self.numbers.class(values.majority, of);
            json["minority"] = self.numbers.class(values.minority, of);
            json["variety"] = json!(values.variety);
            json["median"] = json!(values.median);
            let quantiles = self.quantiles.iter().zip(&values.quantiles);
            json["quantiles"] = quantiles.map(|(at, value)| (at.to_string(), json!(value))).collect();
        }
        json
    }
}

/// Returns an object with members in the given order.
fn members<const N: usize>(members: [(&str, Value); N]) -> Map<String, Value> {
    members.into_iter().map(|(name, value)| (name.to_string(), value)).collect()
}

/// Polygon statistics as a JSON string, feature by feature. (A string takes a tenth of the memory
/// of JSON values.)
pub struct ZoneReport<'a> {
    form: ZoneForm<'a>,
    /// Number of features so far.
    count: usize,
    text: String,
}

impl<'a> ZoneReport<'a> {
    /// Creates a report with the JSON before all features.
    pub fn begin(form: ZoneForm<'a>) -> ZoneReport<'a> {
        ZoneReport { form, count: 0, text: "{\n  \"zones\": [".into() }
    }

    /// Adds the statistics of the next feature, at index `number` of the layer, for all layers of
    /// the tree.
    pub fn add(&mut self, layer: &PolygonLayer, number: usize, zones: &[ZoneStatistics]) {
        let separator = if self.count > 0 { ",\n" } else { "\n" };
        self.count += 1;
        let json = format!("{:#}", self.form.as_json(layer, number, zones));
        // (Strings in JSON contain no line ends.)
        let lines: Vec<String> = json.lines().map(|line| format!("    {line}")).collect();
        self.text.extend([separator, &lines.join("\n")]);
    }

    /// Adds the JSON after all features.
    pub fn finish(&mut self) {
        self.text.push_str(if self.count > 0 { "\n  ]\n}\n" } else { "]\n}\n" });
    }

    /// Returns the length of the JSON not taken yet, in bytes.
    pub fn held(&self) -> usize {
        self.text.len()
    }

    /// Takes the JSON written since the last call.
    pub fn take(&mut self) -> String {
        let text = std::mem::take(&mut self.text);
        printable_json(&text).into_owned()
    }
}
