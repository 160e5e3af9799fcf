//! Searches for blocks by value.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{Condition, FoundBlock};
use spinney_report::JsonNumbers;

use crate::region::Region;
use crate::result::{Found, count};

/// A condition on the first channel, and the number of blocks.
#[derive(Deserialize)]
pub(crate) struct Request {
    above: Option<Number>,
    below: Option<Number>,
    equal: Option<Number>,
    limit: Option<usize>,
    /// The largest blocks, instead of the first ones.
    largest: Option<usize>,
}

/// Default and maximum number of blocks.
const BLOCKS: usize = 10_000;
const MAX_BLOCKS: usize = 1_000_000;

pub(crate) fn find(tree: &Dataset, region: &Region, request: &Request) -> Result<Found> {
    let condition = match (request.above, request.below, request.equal) {
        (Some(bound), None, None) => Condition::Above(bound),
        (None, Some(bound), None) => Condition::Below(bound),
        (None, None, Some(number)) => Condition::Equal(number),
        _ => return Err(Error::invalid("where", "no condition or several", "one of above, below or equal")),
    };
    let boxes = region.boxes(tree)?.map_or(vec![None], |boxes| boxes.into_iter().map(Some).collect());
    let limit = request.limit.unwrap_or(BLOCKS).min(MAX_BLOCKS);
    let largest = request.largest.map(|limit| limit.min(MAX_BLOCKS));
    let (mut found, mut is_all): (Vec<FoundBlock>, bool) = (Vec::new(), true);
    let order = |block: &FoundBlock| (block.level, block.code.clone());
    for bounds in boxes {
        tree.find(condition, bounds, &(), &mut |block| {
            if largest.is_none() && found.len() >= limit {
                is_all = false;
                return Ok(false);
            }
            found.push(block);
            // (Excess blocks are dropped from time to time.)
            if let Some(limit) = largest.filter(|limit| found.len() >= 2 * limit + 1024) {
                found.sort_by_cached_key(order);
                found.truncate(limit);
            }
            Ok(true)
        })?;
    }
    if let Some(limit) = largest {
        found.sort_by_cached_key(order);
        is_all = found.len() <= limit;
        found.truncate(limit);
    }
    let blocks: Vec<Value> = found.iter().map(|block| block_json(tree, block)).collect();
    Ok(json!({ "blocks": blocks, "isAll": is_all }).into())
}

fn block_json(tree: &Dataset, block: &FoundBlock) -> Value {
    let (axes, of) = (tree.header().form.axes(), tree.header().form.value.sample);
    let [low, high] = tree.metadata().frame.world_box(&block.bounds);
    let counts = |numbers: [u64; 3]| numbers[..axes].iter().map(|number| count(*number)).collect::<Vec<_>>();
    json!({
        "code": block.code,
        "level": block.level,
        "min": counts(block.bounds.min),
        "size": counts(block.bounds.size()),
        "world": [&low[..axes], &high[..axes]],
        "value": block.value.map(|value| JsonNumbers::Marked.class(value, of)),
    })
}
