//! Fullness of the INNER nodes of solids, predicted from the nodes below them. (That of CUT nodes
//! is coded with the nodes.)

use crate::adaptive::AdaptiveSymbols;
use crate::bits::BitCoder;
use spinney_container::{CUT, INNER, LEAF};

use crate::nodes::{FIRST_VALUE, Nodes, ROOT};

/// Probabilities of differences: of small ones, and of the upper bits of others.
pub(crate) type FullnessContexts = [AdaptiveSymbols; 2];

/// Codes the fullness of INNER nodes, from the bottom up. If everything below a node is known, its
/// fullness follows exactly; otherwise the difference from the expected fullness is coded. `truth`
/// has the nodes to be written, and `values` the values of LEAF nodes by symbol.
pub(crate) fn code_inner_fullness<K: BitCoder>(
    coder: &mut K,
    nodes: &mut Nodes,
    (axes, height): (usize, u8),
    truth: &Nodes,
    values: &[u8],
    contexts: &mut FullnessContexts,
) {
    // (Children have higher indices than their parents.)
    let mut heights = vec![height; nodes.len() as usize];
    for node in ROOT..nodes.len() {
        if let Some(first) = nodes.first(node) {
            let below = heights[node as usize].saturating_sub(1);
            heights[first as usize..][..1 << axes].fill(below);
        }
    }
    let leaf =
        |symbol: u32| values.get(symbol.wrapping_sub(FIRST_VALUE) as usize).copied().unwrap_or_default();
    // Sum over all cells below each node, and whether it is exact.
    let mut sums = vec![(0u128, true); nodes.len() as usize];
    for node in (ROOT + 1..nodes.len()).rev() {
        let at = node as usize;
        let cells = 1u128 << (axes * usize::from(heights[at]));
        sums[at] = match nodes.state(node) {
            LEAF => (u128::from(leaf(nodes.symbol(node))) * cells, true),
            CUT => (u128::from(nodes.fullness(node)) * cells, false),
            INNER => {
                let below =
                    nodes.first(node).map_or(0..0, |first| first as usize..first as usize + (1 << axes));
                let (sum, is_known) = sums[below]
                    .iter()
                    .fold((0, true), |(sum, known), below| (sum + below.0, known && below.1));
                let expected = ((2 * sum + cells) / (2 * cells)) as u8;
                let difference = if K::READS { 0 } else { truth.fullness(node).wrapping_sub(expected) };
                let difference = if is_known { 0 } else { code_difference(coder, contexts, difference) };
                nodes.set_fullness(node, expected.wrapping_add(difference));
                (sum, is_known)
            }
            _ => (0, true),
        };
    }
}

/// Codes a difference of two bytes, which is mostly small: differences from -7 to 7 have a symbol
/// each.
fn code_difference<K: BitCoder>(coder: &mut K, contexts: &mut FullnessContexts, difference: u8) -> u8 {
    let near = difference.wrapping_add(8);
    match coder.symbol(&mut contexts[0], usize::from(if (1..16).contains(&near) { near } else { 0 })) {
        0 => {
            let upper = coder.symbol(&mut contexts[1], usize::from(difference >> 4));
            (upper as u8) << 4 | coder.short(u32::from(difference & 15), 4) as u8
        }
        near => (near as u8).wrapping_sub(8),
    }
}
