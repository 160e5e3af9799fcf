//! Statistics of boxes, as the program prints them.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::Result;
use spinney_base::value::{Number, SampleType};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::Statistics;

use crate::answer::{Found, big, count, sample};
use crate::part::Part;

/// How many bins the histogram has, and their range.
#[derive(Deserialize)]
pub(crate) struct Request {
    bins: Option<u32>,
    low: Option<f64>,
    high: Option<f64>,
}

/// Bins if nobody says how many, and at most.
const BINS: u32 = 16;
const MOST_BINS: u32 = 1 << 16;

/// The value of a class: an integer where it is one.
pub(crate) fn class(value: Number, of: SampleType) -> Value {
    match (value.to_integer(), of) {
        (_, SampleType::U64 | SampleType::I64) => sample(value, of),
        (Some(whole), _) if whole.unsigned_abs() < 1 << 53 => json!(whole as i64),
        (Some(whole), _) if !of.is_float() => big(whole),
        _ => sample(value, of),
    }
}

fn of_part(tree: &Dataset, part: &Part) -> Result<(Statistics, Vec<spinney_base::space::Bounds>)> {
    match part.boxes(tree)? {
        None => Ok((tree.statistics(None, &())?, vec![tree.header().picture()])),
        Some(boxes) => {
            let parts = boxes.iter().map(|bounds| tree.statistics(Some(*bounds), &()));
            Ok((Statistics::of_parts(&parts.collect::<Result<Vec<_>>>()?), boxes))
        }
    }
}

pub(crate) fn statistics(tree: &Dataset, part: &Part, request: &Request) -> Result<Found> {
    let (stats, boxes) = of_part(tree, part)?;
    let (metadata, of) = (tree.metadata(), tree.header().form.value.sample);
    let area = metadata.frame.cell_square_metres().ok();
    let one_class = |(value, cells): &(Number, u64)| {
        json!({
            "value": class(*value, of),
            "name": metadata.class_names.get(value),
            "cells": count(*cells),
            "area_m2": area.map(|area| area * *cells as f64),
        })
    };
    let channels = stats.channels.iter().map(|channel| {
        json!({
            "cells": count(channel.cells),
            "min": sample(channel.min, of),
            "max": sample(channel.max, of),
            "mean": channel.mean,
            "standard_deviation": channel.standard_deviation,
        })
    });
    let all = stats.cells + stats.void_cells;
    let bins = request.bins.unwrap_or(BINS).min(MOST_BINS);
    let histogram = match stats.channels.first() {
        Some(first) if stats.classes.is_empty() && first.min < first.max && bins > 0 => {
            bins_of(tree, &boxes, (first.min.to_f64(), first.max.to_f64()), bins)?
        }
        _ => Vec::new(),
    };
    Ok(json!({
        "layer": metadata.name,
        "cells": count(stats.cells),
        "void_cells": count(stats.void_cells),
        "void_share": (all > 0).then(|| stats.void_cells as f64 / all as f64),
        "area_m2": area.map(|area| area * stats.cells as f64),
        "channels": channels.collect::<Vec<_>>(),
        "classes": stats.classes.iter().map(one_class).collect::<Vec<_>>(),
        "histogram": histogram.iter().map(|(from, cells)| json!({ "from": from, "cells": count(*cells) })).collect::<Vec<_>>(),
        "segments_read": stats.segments_read,
    })
    .into())
}

/// Bins of the first channel, each with its least value and its cells.
fn bins_of(
    tree: &Dataset,
    boxes: &[spinney_base::space::Bounds],
    (low, high): (f64, f64),
    bins: u32,
) -> Result<Vec<(f64, u64)>> {
    let mut cells = vec![0; bins as usize];
    for bounds in boxes {
        let bounds = bounds.intersect(&tree.header().picture());
        let part = tree.histogram(&bounds, low, high, bins as usize, &())?;
        cells.iter_mut().zip(part).for_each(|(all, part)| *all += part);
    }
    let width = (high - low) / f64::from(bins);
    Ok((0..).map(|bin| low + f64::from(bin) * width).zip(cells).collect())
}

pub(crate) fn histogram(tree: &Dataset, part: &Part, request: &Request) -> Result<Found> {
    let boxes = part.boxes(tree)?.unwrap_or_else(|| vec![tree.header().picture()]);
    let bins = request.bins.unwrap_or(BINS).clamp(1, MOST_BINS);
    let range = match (request.low, request.high) {
        (Some(low), Some(high)) => Some((low, high)),
        (low, high) => {
            let (stats, _) = of_part(tree, part)?;
            stats
                .channels
                .first()
                .map(|first| (low.unwrap_or(first.min.to_f64()), high.unwrap_or(first.max.to_f64())))
        }
    };
    let Some((low, high)) = range else { return Ok(json!({ "low": null, "high": null, "bins": [] }).into()) };
    let found = bins_of(tree, &boxes, (low, high), bins)?;
    let bins: Vec<Value> =
        found.iter().map(|(from, cells)| json!({ "from": from, "cells": count(*cells) })).collect();
    Ok(json!({ "low": low, "high": high, "bins": bins }).into())
}
