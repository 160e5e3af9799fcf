//! Cuts a file's layers into shards of similar load.

use std::collections::BTreeMap;

use spinney_base::space::{Bounds, Code, CodeRange};
use spinney_container::Header;
use spinney_engine::store::goblin::ShardRange;

use crate::work::Load;

/// Maximum number of weighed nodes of all layers, with a minimum of one per layer.
const MAX_NODES: u64 = 1 << 16;

/// Cuts layers into `shards` shards. The code ranges of each shard are contiguous in the file, and
/// those of all shards cover each layer exactly once. If there are more shards than nodes, some
/// have no ranges.
pub(crate) fn cut(layers: &[Header], loads: &[Load], shards: u32) -> Vec<Vec<ShardRange>> {
    let max_nodes = (MAX_NODES / layers.len().max(1) as u64).max(1);
    let levels: Vec<u8> = layers.iter().map(|header| weighed_level(header, max_nodes)).collect();
    let mut weights: BTreeMap<(usize, u64), u64> = BTreeMap::new();
    for (layer, header) in layers.iter().enumerate() {
        // Nodes without input take some work, too.
        let all = Bounds::of_extent(header.extent);
        each_node(header, levels[layer], &all, &mut |node, _| {
            weights.insert((layer, node.bits()), 1);
        });
    }
    for Load { layer, cells, bytes } in loads {
        let volume = u128::from(cells.volume().max(1));
        each_node(&layers[*layer], levels[*layer], cells, &mut |node, overlap| {
            let share = (u128::from(*bytes) * u128::from(overlap.volume()) / volume) as u64;
            let weight = weights.entry((*layer, node.bits())).or_default();
            *weight = weight.saturating_add(share);
        });
    }
    let total: u128 = weights.values().map(|weight| u128::from(*weight)).sum();
    let mut ranges = vec![Vec::new(); shards as usize];
    // A node belongs to the shard whose share of the total weight contains the middle of the node's
    // weight. This gives the last node of each layer and shard; each range extends from the end of
    // the one before to that node.
    let mut ends: Vec<(usize, u32, u64)> = Vec::new();
    let mut before = 0u128;
    for ((layer, node), weight) in &weights {
        let middle = 2 * before + u128::from(*weight);
        let shard = (middle * u128::from(shards) / (2 * total.max(1))).min(u128::from(shards) - 1) as u32;
        before += u128::from(*weight);
        match ends.last_mut() {
            Some(end) if (end.0, end.1) == (*layer, shard) => end.2 = *node,
            _ => ends.push((*layer, shard, *node)),
        }
    }
    let mut first = 0;
    for (number, (layer, shard, node)) in ends.iter().enumerate() {
        let is_last = ends.get(number + 1).is_none_or(|next| next.0 != *layer);
        let node = Code::from_bits(layers[*layer].form.dimension, *node).expect("codes of nodes");
        let last = if is_last { CodeRange::ALL.ends()[1] } else { node.last_bits() };
        let run = CodeRange::new(first, last).expect("nodes ascend");
        ranges[*shard as usize].push(ShardRange { layer: *layer as u32, run });
        first = if is_last { 0 } else { last + 1 };
    }
    ranges
}

/// Deepest level at which the only layer of a file is cut.
pub(crate) fn level_of_cuts(header: &Header) -> u8 {
    weighed_level(header, MAX_NODES)
}

/// Deepest level with at most `max_nodes` nodes that have cells, but not deeper than the top levels
/// (`shard_level`).
fn weighed_level(header: &Header, max_nodes: u64) -> u8 {
    let nodes = |level: u8| {
        let side = |axis: usize| header.extent[axis].div_ceil(1 << (header.depth() - level));
        (0..header.form.axes()).fold(1u64, |nodes, axis| nodes.saturating_mul(side(axis)))
    };
    (0..=header.shape.shard_level()).rev().find(|level| nodes(*level) <= max_nodes).unwrap_or(0)
}

/// Calls `visit` for the nodes of a level that intersect a box, with the intersection.
fn each_node(header: &Header, level: u8, cells: &Bounds, visit: &mut dyn FnMut(Code, Bounds)) {
    let (dimension, height) = (header.form.dimension, header.depth() - level);
    let axis_range = |axis: usize| match axis < dimension.axes() {
        true => cells.min[axis] >> height..((cells.max[axis].max(1) - 1) >> height) + 1,
        false => 0..1,
    };
    for z in axis_range(2) {
        for y in axis_range(1) {
            for x in axis_range(0) {
                let node = Code::from_cell(dimension, level, [x as u32, y as u32, z as u32]);
                if let Some(node) = node {
                    visit(node, node.bounds(header.depth()).intersect(cells));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::TreeType;
    use spinney_base::space::Dimension;
    use spinney_base::value::{DataKind, SampleType, ValueType};
    use spinney_engine::store::BuildOptions;

    fn header(depth: u8, extent: [u64; 3]) -> Header {
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        BuildOptions::new(DataKind::Continuous, depth).header(form, extent).unwrap()
    }

    fn box_of(min: [u64; 2], max: [u64; 2]) -> Bounds {
        Bounds { min: [min[0], min[1], 0], max: [max[0], max[1], 1] }
    }

    #[test]
    fn shards_cover_every_layer_with_balanced_loads() {
        let layers = [header(14, [10_000, 16_000, 1]), header(3, [5, 8, 1]), header(12, [4096, 1, 1])];
        let loads = [
            Load { layer: 0, cells: box_of([0, 0], [10_000, 16_000]), bytes: 1 << 30 },
            Load { layer: 0, cells: box_of([0, 0], [2000, 2000]), bytes: 1 << 30 },
            Load { layer: 2, cells: box_of([0, 0], [4096, 1]), bytes: 1 << 28 },
        ];
        for shards in [1, 2, 7, 64, 1000] {
            let ranges = cut(&layers, &loads, shards);
            assert_eq!(ranges.len(), shards as usize);
            let all: Vec<&ShardRange> = ranges.iter().flatten().collect();
            assert!(all.is_sorted_by_key(|range| (range.layer, range.run.ends())));
            for (number, header) in (0..).zip(&layers) {
                let mut next = 0;
                for range in all.iter().filter(|range| range.layer == number) {
                    assert_eq!(range.run.ends()[0], next);
                    assert!(range.run.is_cut_at(Dimension::Quad, header.shape.shard_level()));
                    next = range.run.ends()[1] + 1;
                }
                assert_eq!(next, CodeRange::ALL.ends()[1] + 1);
            }
        }
        // The first half of the input is in the first sixteenth of the space.
        let halves = cut(&layers[..1], &loads[..2], 2);
        let [_, last] = halves[0][0].run.ends();
        let root = Code::root(Dimension::Quad);
        assert!(last < root.child(0).last_bits() && last > root.child(0).child(0).bits(), "{last:x}");
    }

    #[test]
    fn the_largest_space_is_cut_into_shards() {
        let layers = [header(29, [1 << 29, 1 << 29, 1])];
        let ranges = cut(&layers, &[], 5);
        assert!(ranges.iter().all(|ranges| ranges.len() == 1));
    }
}
