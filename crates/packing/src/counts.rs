//! Class counts of a segment.

use spinney_base::TreeType;

use crate::bits::BitCoder;
use spinney_container::CUT;

use crate::nodes::{FIRST_VALUE, Nodes};
use crate::plain::each_leaf;
use crate::values::{Numbers, bytes, numbers};

/// Returns the values and cell counts of a plain segment's class counts.
pub(crate) fn parse_counts(form: TreeType, counts: &[u8]) -> Vec<(Numbers, u64)> {
    let entries = counts.chunks_exact(form.width() + 8);
    let entry = |entry: &[u8]| {
        let (value, cells) = entry.split_at(form.width());
        (numbers(form, value), u64::from_le_bytes(*cells.first_chunk().unwrap_or(&[0; 8])))
    };
    entries.map(entry).collect()
}

/// Codes the cell counts of all values of a table. `counts` are those to be written. Returns the
/// class counts, which list the values with at least one cell. `nodes` is given if it has all
/// nodes, and a symbol for each value.
///
/// If no node is CUT, the counts follow from the nodes, and need not be stored.
pub(crate) fn code_counts<K: BitCoder>(
    coder: &mut K,
    (form, height): (TreeType, u8),
    table: &[Numbers],
    nodes: Option<&Nodes>,
    counts: &[u8],
) -> Vec<u8> {
    let counts = parse_counts(form, counts);
    let mut cells = vec![0; table.len()];
    // (Both are sorted, and the table has all counted values.)
    let mut listed = counts.iter().peekable();
    for (value, cells) in table.iter().zip(&mut cells) {
        if let Some((_, counted)) = listed.next_if(|(listed, _)| listed == value) {
            *cells = *counted;
        }
    }
    let whole = nodes.filter(|nodes| (0..nodes.len()).all(|node| nodes.state(node) != CUT));
    let found = whole.map(|nodes| {
        let mut found = vec![0; table.len()];
        each_leaf(nodes, form.axes(), height, |symbol, cells| {
            if let Some(found) = found.get_mut((symbol.wrapping_sub(FIRST_VALUE)) as usize) {
                *found += cells;
            }
        });
        found
    });
    let is_stored = coder.raw(u64::from(found.as_ref() != Some(&cells)), 1) == 1;
    match found {
        Some(found) if !is_stored => cells = found,
        _ => cells.iter_mut().for_each(|cells| *cells = coder.number(*cells)),
    }
    let mut plain = Vec::new();
    for (value, cells) in table.iter().zip(cells).filter(|(_, cells)| *cells > 0) {
        plain.extend_from_slice(&bytes(form, *value)[..form.width()]);
        plain.extend_from_slice(&cells.to_le_bytes());
    }
    plain
}
