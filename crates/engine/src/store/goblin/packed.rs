//! Packed segments: what packing needs to know about a segment, and size limits.

use super::directory::NOT_COUNTED;
use super::segment::COUNT_SIZE;
use crate::store::builder::SealedSegment;
use crate::store::records::RecordLayout;
use spinney_base::space::Code;
use spinney_base::value::ZoneStats;
use spinney_container::Header;
use spinney_packing::{SegmentForm, may_unpack, pack};

/// Returns the description of a node's segment that packing needs; `None` if the tree does not have
/// the node's level.
pub(super) fn segment_form(header: &Header, node: Code) -> Option<SegmentForm> {
    let Header { form, rule, kind, shape, .. } = *header;
    let height = shape.depth.checked_sub(node.level())?;
    Some(SegmentForm { form, rule, kind, height, reach: shape.reach })
}

/// Returns whether packed segments of one tree are valid in the other, for nodes with equally many
/// levels below them.
pub(super) fn are_packed_alike(a: &Header, b: &Header) -> bool {
    let of = |header: &Header| (header.form, header.rule, header.kind, header.shape.reach);
    of(a) == of(b)
}

/// Packs the bytes of a node's segment, which has `slots` record slots; `None` if they should stay
/// plain.
pub(super) fn pack_bytes(header: &Header, node: Code, slots: u32, plain: &[u8]) -> Option<Vec<u8>> {
    let form = segment_form(header, node)?;
    // (Segments that exceed the limits for unpacking are not packed.)
    if !may_unpack(plain.len() as u64, plain.len() as u64) {
        return None;
    }
    pack(&form, slots, plain).filter(|packed| may_unpack(packed.len() as u64, plain.len() as u64))
}

/// Packs a segment, if that makes it smaller.
pub(super) fn pack_sealed(header: &Header, segment: &SealedSegment) -> Option<Vec<u8>> {
    if header.is_referenced(segment.code.level()) {
        return None;
    }
    let (_, counts) = class_counts(header, &segment.tally);
    let slots = RecordLayout::new(header.form).count(&segment.records) as u32;
    let joined = (!counts.is_empty()).then(|| [&segment.records[..], &counts].concat());
    pack_bytes(header, segment.code, slots, joined.as_ref().unwrap_or(&segment.records))
}

/// Returns the class counts that follow a segment's records: their number as stored in the entry,
/// and their bytes. Each is the value's bytes, then the number of cells.
pub(super) fn class_counts(header: &Header, tally: &ZoneStats) -> (u16, Vec<u8>) {
    let listed = if header.counts_classes() { tally.listed_classes() } else { Some(&[][..]) };
    let Some(classes) = listed else { return (NOT_COUNTED, Vec::new()) };
    let width = header.form.width();
    let mut bytes = Vec::with_capacity(classes.len() * (width + COUNT_SIZE));
    for (value, cells) in classes {
        bytes.extend_from_slice(&value.to_bytes()[..width]);
        bytes.extend_from_slice(&cells.to_le_bytes());
    }
    (classes.len() as u16, bytes)
}
