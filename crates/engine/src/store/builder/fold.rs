//! Sums over all cells of a stored subtree, in the same order as the builder sums them.

use crate::store::records::Record;
use crate::store::records::dense::{DenseRows, dense_block, for_z_order};
use crate::store::records::subtree::RECORDS_ARE_CHECKED;
use spinney_container::{INNER, LEAF};

/// Sums the results of `leaf` for the LEAFs (value and number of cells) of a subtree of `levels`
/// levels, whose records were checked. `add` sums children in child order, and nodes after their
/// children. VOID is the default.
pub(super) fn fold<R: Record, T: Copy + Default>(
    records: &[R],
    levels: u8,
    leaf: &impl Fn(R::Bytes, u32) -> T,
    add: &impl Fn(&[T]) -> T,
) -> T {
    let record = &records[0];
    if record.is_dense() {
        return fold_dense(records, leaf, add);
    }
    let cells = 1 << (R::AXES * (levels as usize - 1));
    let mut next = 1;
    let mut sums = [T::default(); 8];
    for (child, sum) in sums[..R::CHILDREN].iter_mut().enumerate() {
        match record.state(child) {
            LEAF => *sum = leaf(record.values()[child], cells),
            INNER => {
                *sum = fold(&records[next..], levels - 1, leaf, add);
                next += records[next].skip() as usize;
            }
            _ => {}
        }
    }
    // Invariant: the order of summation is that of the builder: children in child order, nodes
    // after their descendants. It affects the last bits of floating-point sums. In any other order,
    // a tree with copied subtrees would have other means and statistics than one built from the
    // same cells.
    add(&sums[..R::CHILDREN])
}

/// [`fold`] of a dense block: level by level from single cells, even if they are equal. (Plain
/// loops, because this is compiled for very many types.)
#[inline(never)]
fn fold_dense<R: Record, T: Copy + Default>(
    records: &[R],
    leaf: &impl Fn(R::Bytes, u32) -> T,
    add: &impl Fn(&[T]) -> T,
) -> T {
    let block = dense_block(records, 0).expect(RECORDS_ARE_CHECKED);
    let values = block.values_of::<R>(block.levels);
    let mut sums = vec![T::default(); values.len()];
    for_z_order(R::DIMENSION, block.levels, &mut |z, row| {
        if block.bottom_state(row) == LEAF {
            sums[z] = leaf(values[row], 1);
        }
    });
    let mut nodes = sums.len();
    while nodes > 1 {
        nodes /= R::CHILDREN;
        for node in 0..nodes {
            sums[node] = add(&sums[node * R::CHILDREN..][..R::CHILDREN]);
        }
    }
    sums[0]
}
