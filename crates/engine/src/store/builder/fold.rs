//! Sums over all cells of a stored subtree, in the order in which building adds them.

use crate::store::records::Record;
use crate::store::records::dense::{DenseRows, dense_block, for_z_order};
use crate::store::records::subtree::RECORDS_ARE_CHECKED;
use spinney_container::{INNER, LEAF};

/// Adds up what `leaf` makes of the LEAFs (value and cells) of a subtree of so many levels, whose records were checked:
/// children in child order by `add`, nodes after their children. VOID is the default.
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
    // Invariant: sums are added in the order in which building adds them: children in child order, nodes
    // after what is below. Sums of floating samples depend on it in their last bits: otherwise a tree that
    // takes a subtree over would have other means and statistics than one that is built of the same cells.
    add(&sums[..R::CHILDREN])
}

/// [`fold`] of a dense block: level by level, however its cells condense. (Plain loops: this is compiled for very many types.)
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
