//! Statistics, as several subcommands print them.

use serde_json::{Value, json};
use spinney::query::Statistics;
use spinney::value::Number;

/// Extremes, mean and standard deviation of each channel.
pub(crate) fn channels_as_json(statistics: &Statistics) -> Vec<Value> {
    let channels = statistics.channels.iter();
    channels
        .map(|c| json!({ "cells": c.cells, "min": c.min, "max": c.max, "mean": c.mean, "standard_deviation": c.standard_deviation }))
        .collect()
}

/// The value of a class: an integer where it is one.
pub(crate) fn class_as_json(value: Number) -> Value {
    /// Floating numbers beyond are no longer all the whole ones.
    const MOST: f64 = 9_007_199_254_740_992.0;
    match value {
        Number::Float(float) if float.fract() == 0.0 && float.abs() <= MOST => json!(float as i64),
        value => json!(value),
    }
}
