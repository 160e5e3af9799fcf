//! Statistics, as several subcommands print them.

use serde_json::{Value, json};
use spinney::query::Statistics;

/// Extremes, mean and deviation of each channel.
pub(crate) fn channels_as_json(statistics: &Statistics) -> Vec<Value> {
    let channels = statistics.channels.iter();
    channels
        .map(|c| json!({ "min": c.min, "max": c.max, "mean": c.mean, "deviation": c.deviation }))
        .collect()
}
