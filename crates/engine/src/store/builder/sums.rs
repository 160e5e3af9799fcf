//! Sums that depend on the order of summation: of floating-point samples, and of their squares.

use super::averaging::{decode, pairwise};
use super::block::Block;
use super::fold::fold;
use crate::store::records::Record;
use spinney_base::value::{Native, Sums};
use spinney_container::LEAF;

/// Sums of the samples of some cells, and of their squares.
type SumsAndSquares<V> = (<V as Native>::TotalSums, <V as Native>::TotalSquares);

#[inline]
fn of_leaf<V: Native>(value: V, cells: u64) -> SumsAndSquares<V> {
    (value.total_sums(cells), value.total_squares(cells))
}

#[inline]
fn add_both<V: Native>(a: SumsAndSquares<V>, b: SumsAndSquares<V>) -> SumsAndSquares<V> {
    (V::add_sums(a.0, b.0), V::add_squares(a.1, b.1))
}

/// Sums the samples and their squares of all leaves, pairwise in Z order: see
/// [`ZoneStats`](spinney_base::value::ZoneStats). `counted` replaces samples that do not count.
pub(super) fn pairwise_sums<V: Native, R: Record>(block: &Block, counted: &impl Fn(V) -> V) -> (Sums, Sums) {
    let mut below: Vec<SumsAndSquares<V>> = Vec::new();
    for (index, level) in block.levels.iter().enumerate().rev() {
        let cells = block.cells_at(index) as u64;
        let is_last = index + 1 == block.levels.len();
        let mut sums = vec![SumsAndSquares::<V>::default(); level.states.len()];
        if is_last || level.expanded.is_some() {
            let leaves = level.states.iter().zip(level.values_of::<R>());
            for (sum, (state, value)) in sums.iter_mut().zip(leaves) {
                if *state == LEAF {
                    *sum = of_leaf(counted(decode::<R, V>(*value)), cells);
                }
            }
        }
        for node in &level.reused {
            let reused = block.reused_records::<R>(node);
            let height = block.height - index as u8;
            let leaf = |bytes, cells| of_leaf(counted(decode::<R, V>(bytes)), u64::from(cells));
            let add = |sums: &[SumsAndSquares<V>]| pairwise(sums, add_both::<V>);
            sums[node.index as usize] = fold(reused, height, &leaf, &add);
        }
        for (group, children) in below.chunks_exact(R::CHILDREN).enumerate() {
            sums[level.parent(group)] = pairwise(children, add_both::<V>);
        }
        below = sums;
    }
    let (sums, squares) = below.first().copied().unwrap_or_default();
    (V::erase(sums), V::erase_squares(squares))
}
