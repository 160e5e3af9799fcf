//! Statistics, as several subcommands print them.

use serde_json::{Number, Value, json};
use spinney::query::Statistics;

/// Extremes, mean and standard deviation of each channel.
pub(crate) fn channels_as_json(statistics: &Statistics) -> Vec<Value> {
    let channels = statistics.channels.iter();
    channels
        .map(|c| json!({ "cells": c.cells, "min": c.min, "max": c.max, "mean": c.mean, "standard_deviation": c.standard_deviation }))
        .collect()
}

/// The value of a class: an integer where it is one.
pub(crate) fn class_as_json(value: f64) -> Value {
    /// Whole numbers beyond are no longer all there.
    const MOST: f64 = 9_007_199_254_740_992.0;
    let whole = value.fract() == 0.0 && value.abs() <= MOST;
    if whole { Value::Number(Number::from(value as i64)) } else { json!(value) }
}
