//! Packed segments: what they are to whoever packs and unpacks them, and how many bytes they may become.

use super::directory::NOT_COUNTED;
use super::segment::COUNT_SIZE;
use crate::store::builder::SealedSegment;
use crate::store::records::RecordLayout;
use spinney_base::space::Code;
use spinney_base::value::ZoneStats;
use spinney_container::Header;
use spinney_packing::{SegmentForm, may_unpack, pack};

/// The meaning of the bytes of a node's segment in a tree that has it; `None` if that has no such level.
pub(super) fn segment_form(header: &Header, node: Code) -> Option<SegmentForm> {
    let Header { form, rule, kind, shape, .. } = *header;
    let height = shape.depth.checked_sub(node.level())?;
    Some(SegmentForm { form, rule, kind, height, reach: shape.reach })
}

/// Whether a segment means the same in two trees, at nodes with as many levels below them.
pub(super) fn are_packed_alike(a: &Header, b: &Header) -> bool {
    let of = |header: &Header| (header.form, header.rule, header.kind, header.shape.reach);
    of(a) == of(b)
}

/// Packs the bytes of a node's segment, which has so many places; `None` where they are to stay plain.
pub(super) fn pack_bytes(header: &Header, node: Code, places: u32, plain: &[u8]) -> Option<Vec<u8>> {
    let form = segment_form(header, node)?;
    // (Nobody has to pack what nobody may unpack.)
    if !may_unpack(plain.len() as u64, plain.len() as u64) {
        return None;
    }
    pack(&form, places, plain).filter(|packed| may_unpack(packed.len() as u64, plain.len() as u64))
}

/// Packs a segment, if that makes it smaller.
pub(super) fn pack_sealed(header: &Header, segment: &SealedSegment) -> Option<Vec<u8>> {
    let (_, counts) = class_counts(header, &segment.tally);
    let places = RecordLayout::new(header.form).count(&segment.records) as u32;
    let joined = (!counts.is_empty()).then(|| [&segment.records[..], &counts].concat());
    pack_bytes(header, segment.code, places, joined.as_ref().unwrap_or(&segment.records))
}

/// The class counts that follow a segment's records: their number as the directory has it, and their bytes, of each the value's, then
/// the cells.
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
