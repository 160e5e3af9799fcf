//! Statistics of boxes, as printed by the program.

use serde::Deserialize;
use serde_json::json;
use spinney_base::Result;
use spinney_engine::dataset::Dataset;
use spinney_report::{JsonNumbers, bins_as_json, bins_of, bins_with, statistics_as_json, statistics_of};

use crate::region::Region;
use crate::result::Found;

/// Number of the histogram's bins, and their range.
#[derive(Deserialize)]
pub(crate) struct Request {
    bins: Option<u32>,
    low: Option<f64>,
    high: Option<f64>,
}

/// Default and maximum number of bins.
const BINS: u32 = 16;
const MAX_BINS: u32 = 1 << 16;

pub(crate) fn statistics(tree: &Dataset, region: &Region, request: &Request) -> Result<Found> {
    let boxes = region.boxes(tree)?;
    let statistics = statistics_of(tree, boxes.as_deref())?;
    let boxes = boxes.unwrap_or_else(|| vec![tree.header().extent_bounds()]);
    let bins = bins_with(tree, &boxes, &statistics, request.bins.unwrap_or(BINS).min(MAX_BINS))?;
    Ok(statistics_as_json(tree, &statistics, &bins, JsonNumbers::Marked).into())
}

pub(crate) fn histogram(tree: &Dataset, region: &Region, request: &Request) -> Result<Found> {
    let boxes = region.boxes(tree)?;
    let bins = request.bins.unwrap_or(BINS).clamp(1, MAX_BINS);
    let range = match (request.low, request.high) {
        (Some(low), Some(high)) => Some((low, high)),
        (low, high) => {
            let statistics = statistics_of(tree, boxes.as_deref())?;
            let of =
                |first: &spinney_engine::query::ChannelStatistics| (first.min.to_f64(), first.max.to_f64());
            let extremes = statistics.channels.first().map(of);
            extremes.map(|(min, max)| (low.unwrap_or(min), high.unwrap_or(max)))
        }
    };
    let Some((low, high)) = range else { return Ok(json!({ "low": null, "high": null, "bins": [] }).into()) };
    let boxes = boxes.unwrap_or_else(|| vec![tree.header().extent_bounds()]);
    let bins = bins_as_json(&bins_of(tree, &boxes, (low, high), bins)?, JsonNumbers::Marked);
    Ok(json!({ "low": low, "high": high, "bins": bins }).into())
}
