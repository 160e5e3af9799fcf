//! Means of blocks in rows, and statistics of their cells.
//!
//! These are kernels: compiled for each value type, selected once per block.

use zerocopy::FromBytes;

use super::{RowBlock, child_pairs, reduce};
use spinney_base::value::{Native, ZoneStats, erase};

/// Maximum number of a node's cells for narrow sums, as a power of two: see [`Native::NarrowSums`].
const NARROW_BITS: usize = 15;

/// Sets the values of all nodes of a block to their means, and returns the statistics of its cells.
pub(super) fn means<V: Native>(block: &mut RowBlock) -> ZoneStats {
    let (axes, height) = (block.form.axes(), block.height);
    let mut narrow: Vec<V::NarrowSums> = Vec::new();
    let mut up = 1;
    while up <= height && axes * up <= NARROW_BITS {
        block.push_level();
        let side = block.side(up - 1);
        let mut sums = vec![V::NarrowSums::default(); block.levels[up].uniform.len()];
        if up == 1 {
            let of = |wire| V::from_wire(wire).narrow_sums();
            reduce(axes, side, values::<V>(&block.levels[0].values), &mut sums, of, V::add_narrow_sums);
        } else {
            reduce(axes, side, &narrow, &mut sums, |sums| sums, V::add_narrow_sums);
        }
        put_means::<V, _>(block, &sums, |sums| V::narrow_mean(sums, (axes * up) as u32));
        narrow = sums;
        up += 1;
    }
    // (Few nodes are left.)
    let mut sums: Vec<V::BlockSums> = narrow.into_iter().map(V::widen_narrow).collect();
    while up <= height {
        block.push_level();
        let mut above = vec![V::BlockSums::default(); block.levels[up].uniform.len()];
        reduce(axes, block.side(up - 1), &sums, &mut above, |sums| sums, V::add_block_sums);
        put_means::<V, _>(block, &above, |sums| V::block_mean(sums, 1 << (axes * up)));
        sums = above;
        up += 1;
    }
    tally::<V>(block, sums[0])
}

fn values<V: Native>(bytes: &[u8]) -> &[V::Wire] {
    <[V::Wire]>::ref_from_bytes(bytes).expect("whole values")
}

/// Sets the values of the last level's nodes to their means.
#[inline]
fn put_means<V: Native, S: Copy>(block: &mut RowBlock, sums: &[S], mean: impl Fn(S) -> V) {
    let (axes, side) = (block.form.axes(), block.side(block.levels.len() - 2));
    let (below, level) = block.last_two();
    let means = <[V::Wire]>::mut_from_bytes(&mut level.values).expect("whole values");
    for (mean_of, sums) in means.iter_mut().zip(sums) {
        *mean_of = mean(*sums).to_wire();
    }
    if !V::TYPE.sample.is_float() {
        return;
    }
    // The mean of equal floating-point samples may differ from them: very large samples have an
    // infinite sum.
    let children = values::<V>(&below.values);
    let rows = means.chunks_exact_mut(side / 2).zip(level.uniform.chunks_exact(side / 2));
    for (row, (means, uniform)) in rows.enumerate() {
        let [first, ..] = child_pairs(axes, side, children, row);
        for ((mean, uniform), first) in means.iter_mut().zip(uniform).zip(first) {
            if *uniform == 1 {
                *mean = first[0];
            }
        }
    }
}

/// Returns the statistics of all cells, whose sums are known.
fn tally<V: Native>(block: &RowBlock, sums: V::BlockSums) -> ZoneStats {
    let values = values::<V>(&block.levels[0].values);
    let cells = values.len() as u64;
    let mut min = V::from_wire(values[0]);
    let mut max = min;
    for value in values {
        let value = V::from_wire(*value);
        (min, max) = (min.min(value), max.max(value));
    }
    let squares = if const { !V::TYPE.sample.is_float() } {
        squares::<V>(values)
    } else {
        pairwise_squares::<V>(block)
    };
    ZoneStats {
        value_type: block.form.value,
        cells,
        present: [cells; 4],
        min: erase(min),
        max: erase(max),
        sum: V::erase(V::widen(sums)),
        squares: V::erase_squares(V::widen_squares(squares)),
        classes: Vec::new(),
    }
}

/// Returns the sum of squares, for types where it is exact in any order.
fn squares<V: Native>(values: &[V::Wire]) -> V::BlockSquares {
    let narrow = |values: &[V::Wire]| {
        let squares = values.iter().map(|value| V::from_wire(*value).narrow_squares());
        V::widen_narrow_squares(squares.fold(V::NarrowSquares::default(), V::add_narrow_squares))
    };
    values.chunks(1 << NARROW_BITS).map(narrow).fold(V::BlockSquares::default(), V::add_block_squares)
}

/// Returns the sum of squares, for types where it depends on the order of summation: see
/// [`ZoneStats`].
fn pairwise_squares<V: Native>(block: &RowBlock) -> V::BlockSquares {
    let axes = block.form.axes();
    let cells = values::<V>(&block.levels[0].values);
    let mut squares = vec![V::BlockSquares::default(); cells.len() >> axes];
    let of = |wire| V::from_wire(wire).block_squares(1);
    reduce(axes, block.side(0), cells, &mut squares, of, V::add_block_squares);
    for up in 2..=block.height {
        let mut above = vec![V::BlockSquares::default(); squares.len() >> axes];
        reduce(axes, block.side(up - 1), &squares, &mut above, |squares| squares, V::add_block_squares);
        squares = above;
    }
    squares[0]
}
