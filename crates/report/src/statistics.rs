//! Statistics of boxes of cells, with a histogram.

use serde_json::{Value, json};
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_base::value::{DataKind, Number, Rule, SampleType};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ChannelStatistics, Statistics};

use crate::{CellMeasure, JsonNumbers, class_name, measure_key, world_unit};

/// Returns the combined statistics of some boxes of cells, or of all cells if none are given.
///
/// # Errors
/// If the file is corrupt there.
pub fn statistics_of(tree: &Dataset, boxes: Option<&[Bounds]>) -> Result<Statistics> {
    let Some(boxes) = boxes else { return tree.statistics(None, &()) };
    let parts = boxes.iter().map(|bounds| tree.statistics(Some(*bounds), &()));
    Ok(Statistics::of_parts(&parts.collect::<Result<Vec<_>>>()?))
}

/// Bins of a histogram of the first channel, each with its minimum value and its cell count.
pub type Bins = Vec<(f64, u64)>;

/// Returns the histogram of the first channel in some boxes of cells: `bins` bins of equal width
/// from `low` to `high`.
///
/// # Errors
/// If the file is corrupt there.
pub fn bins_of(tree: &Dataset, boxes: &[Bounds], (low, high): (f64, f64), bins: u32) -> Result<Bins> {
    let mut cells = vec![0; bins as usize];
    for bounds in boxes {
        let bounds = bounds.intersect(&tree.header().extent_bounds());
        let part = tree.histogram(&bounds, low, high, bins as usize, &())?;
        cells.iter_mut().zip(part).for_each(|(all, part)| *all += part);
    }
    let width = (high - low) / f64::from(bins);
    Ok((0..).map(|bin| low + f64::from(bin) * width).zip(cells).collect())
}

/// Returns the histogram that accompanies statistics, from minimum to maximum. It is empty for
/// classes, and if all values are equal.
///
/// # Errors
/// If the file is corrupt there.
pub fn bins_with(tree: &Dataset, boxes: &[Bounds], statistics: &Statistics, bins: u32) -> Result<Bins> {
    match statistics.channels.first() {
        Some(first) if statistics.classes.is_empty() && first.min < first.max && bins > 0 => {
            bins_of(tree, boxes, (first.min.to_f64(), first.max.to_f64()), bins)
        }
        _ => Ok(Bins::new()),
    }
}

/// Returns the fraction of cells that are VOID, or `None` if there are no cells.
pub fn void_share(statistics: &Statistics) -> Option<f64> {
    let all = statistics.cells + statistics.void_cells;
    (all > 0).then(|| statistics.void_cells as f64 / all as f64)
}

/// Returns the extremes, mean and standard deviation of each channel as JSON.
pub fn channels_as_json(statistics: &Statistics, of: SampleType, numbers: JsonNumbers) -> Vec<Value> {
    let channel = |channel: &ChannelStatistics| {
        json!({
            "cells": numbers.count(channel.cells),
            "min": numbers.sample(channel.min, of),
            "max": numbers.sample(channel.max, of),
            "mean": channel.mean,
            "standard_deviation": channel.standard_deviation,
        })
    };
    statistics.channels.iter().map(channel).collect()
}

/// Returns the number of full cells with the volume of all cells: see [`CellMeasure::filled`].
pub fn filled(measure: &CellMeasure, statistics: &Statistics) -> f64 {
    measure.filled(statistics.cells as f64, statistics.channels.first().map(|channel| channel.mean))
}

/// Returns the integral over the cells of an octree: the sum of the values times the volume of a
/// cell. That of densities is a mass. `None` for other trees, for classes, occupancy, colours and
/// scaled values, and if the volume is unknown.
pub fn integral(tree: &Dataset, statistics: &Statistics) -> Option<f64> {
    let header = tree.header();
    let has_continuous = header.kind == DataKind::Continuous && header.rule != Rule::Occupancy;
    let is_plain = tree.metadata().scale_offset.is_empty() && header.form.axes() == 3;
    let each = CellMeasure::of(tree).ok().filter(|_| has_continuous && is_plain)?.of_cell;
    match &statistics.channels[..] {
        [] => Some(0.0),
        [channel] if channel.cells == 0 => Some(0.0),
        [channel] => Some(channel.mean * (channel.cells as f64 * each)),
        _ => None,
    }
}

/// Returns bins as JSON.
pub fn bins_as_json(bins: &[(f64, u64)], numbers: JsonNumbers) -> Value {
    bins.iter().map(|(from, cells)| json!({ "from": from, "cells": numbers.count(*cells) })).collect()
}

/// Returns the statistics of a layer, and a histogram, as JSON.
pub fn statistics_as_json(
    tree: &Dataset,
    statistics: &Statistics,
    bins: &[(f64, u64)],
    numbers: JsonNumbers,
) -> Value {
    let (measure, of) = (CellMeasure::of(tree).ok(), tree.header().form.value.sample);
    let each = measure.as_ref().map(|measure| measure.of_cell);
    let key = measure_key(tree);
    let class = |(value, cells): &(Number, u64)| {
        json!({
            "value": numbers.class(*value, of),
            "name": class_name(tree, *value),
            "cells": numbers.count(*cells),
            (key): each.map(|each| each * *cells as f64),
        })
    };
    let mut json = json!({
        "layer": tree.metadata().name,
        "cells": numbers.count(statistics.cells),
        "void_cells": numbers.count(statistics.void_cells),
        "void_share": void_share(statistics),
        (key): measure.map(|measure| measure.of_cell * filled(&measure, statistics)),
        "channels": channels_as_json(statistics, of, numbers),
        "classes": statistics.classes.iter().map(class).collect::<Vec<_>>(),
        "histogram": bins_as_json(bins, numbers),
        "segments_read": statistics.segments_read,
    });
    if key == "volume" {
        json["unit"] = json!(world_unit(tree));
        json["integral"] = json!(integral(tree, statistics));
    }
    json
}
