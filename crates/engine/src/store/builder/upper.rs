//! The upper levels of a run of records, as a coarser segment stores them.

use super::encode::encode;
use super::level::Level;
use super::reused::ReusedRecords;
use crate::store::records::subtree::BadSkip;
use crate::store::records::{RecordLayout, RunChildren, RunNode, Runs, with_record_type};
use spinney_base::TreeType;
use spinney_container::MAX_DENSE_LEVELS;
use spinney_container::{CUT, INNER, VOID};

/// Returns the first levels of the subtree whose root is the first record; deeper nodes become CUT.
///
/// # Errors
/// If skips lead out of the node, or to the same records more than once, which would let a few
/// records expand to very many.
pub(in crate::store) fn upper_levels(form: TreeType, records: &[u8], levels: u8) -> Result<Vec<u8>, BadSkip> {
    let layout = RecordLayout::new(form);
    // The run's own extent.
    let head = layout.head(records, 0).ok_or(BadSkip)?;
    if head.skip == 0 || layout.subtree(records, 0, head.skip).is_none() {
        return Err(BadSkip);
    }
    if levels == 0 {
        return Ok(Vec::new());
    }
    let mut above = vec![Level::root(form)];
    above[0].states[0] = INNER;
    let mut nodes = vec![RunNode::default()];
    let mut children = RunChildren::default();
    for below in (0..levels).rev() {
        let mut level = Level::new(form, nodes.len() * layout.children());
        let (mut expanded, mut deeper) = (Vec::new(), Vec::new());
        for (group, node) in nodes.iter().enumerate() {
            layout.run_children(records, *node, &mut children).ok_or(BadSkip)?;
            let first = group * layout.children();
            for (index, child) in (first..).zip(&children[..layout.children()]) {
                if child.state == VOID {
                    continue;
                }
                level.states[index] = child.state.min(INNER);
                child.value.write(&mut level.values[index * layout.width..][..layout.width]);
                match child.state {
                    INNER if below > 0 => {
                        expanded.push(index as u32);
                        deeper.push(child.node);
                    }
                    // Invariant: a run reaches at least as deep as the requested levels. This holds
                    // for runs that are built (a part keeps the levels of the next segment above);
                    // it is checked here for runs from files. The children of a CUT node above
                    // would be in another run, so the encoder could not write them.
                    CUT if below > 0 => return Err(BadSkip),
                    _ => {}
                }
            }
        }
        nodes = deeper;
        level.expanded = Some(expanded);
        above.push(level);
        if nodes.is_empty() {
            break;
        }
    }
    let reused = ReusedRecords::new(layout, levels);
    Ok(with_record_type!(layout, R => encode::<R>(&above, levels, MAX_DENSE_LEVELS, &reused)))
}

#[cfg(test)]
mod tests {
    use zerocopy::IntoBytes;

    use super::*;
    use crate::store::records::Record;
    use crate::store::records::RecordHead;
    use crate::store::records::record::QuadRecord;
    use spinney_base::space::Dimension;
    use spinney_base::value::{SampleType, ValueType};

    type Byte = QuadRecord<1>;

    #[test]
    fn upper_levels_are_cut_off_and_checked() {
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        let upper = |records: &[(u32, u32)], levels| {
            let bytes: Vec<Byte> = records
                .iter()
                .map(|(states, skip)| {
                    Record::new(RecordHead { states: *states, skip: *skip, dense: 0 }, &[[7]; 4])
                })
                .collect();
            let above = upper_levels(form, bytes.as_bytes(), levels).ok()?;
            Some(Byte::of(&above).iter().map(|record| (record.states(), record.skip())).collect::<Vec<_>>())
        };
        let good = [(0b1001_1000, 5), (0b10, 2), (0, 1), (0b0110, 2), (0, 1)];
        assert_eq!(upper(&good, 1), Some(vec![(0b1101_1100, 1)]));
        assert_eq!(upper(&good, 2), Some(vec![(0b1001_1000, 3), (0b11, 1), (0b0111, 1)]));
        assert_eq!(upper(&good, 3), Some(good.to_vec()));
        // Only two levels are copied, so the third is not checked.
        assert_eq!(upper(&[(0b10, 3), (0b10, 2), (0, 9)], 3), None);
        for bad in [
            &[(0b10, 2), (0, 0)][..],
            &[(0b10, 2), (0, 2), (0, 1)],
            &[(0b1010, 3), (0, 2), (0, 2)],
            &[(0b10, 1)],
            &[(0, 2)],
            &[],
        ] {
            assert_eq!((upper(bad, 1), upper(bad, 2)), (None, None), "{bad:?}");
        }
    }
}
