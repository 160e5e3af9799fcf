//! Zones: statistics of all cells below a large node, so that edits and queries need not visit
//! them.
//!
//! A zone follows the record of every large node. Integers are LEB128: seven bits per byte, lowest
//! first. Sums of 16 bytes are zigzag-coded 128-bit integers. Sums of 24 bytes are three 64-bit
//! integers. Sums of floating-point samples are the bits of two or three `f64`.

use spinney_base::TreeType;
use spinney_base::value::{Sums, Value, ZoneStats};

/// Class count of a zone with too many classes to list.
const NOT_COUNTED: u64 = u32::MAX as u64;

/// Statistics of a node's cells, and the number of its INNER nodes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Zone {
    /// INNER nodes of the subtree, including its root. Nodes of shared subtrees count once per
    /// occurrence.
    pub(super) inner_nodes: u64,
    pub(super) tally: ZoneStats,
}

/// Reason why bytes are not a zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BadZone {
    /// The bytes end early.
    Short,
    /// A field has an impossible value.
    Wrong,
}

impl Zone {
    pub(super) fn to_bytes(&self, with_classes: bool) -> Vec<u8> {
        let Zone { inner_nodes, tally } = self;
        let width = tally.value_type.size();
        let mut bytes = Vec::with_capacity(64);
        put(&mut bytes, u128::from(*inner_nodes));
        put(&mut bytes, u128::from(tally.cells));
        if tally.value_type.is_masked() {
            let present = tally.present.iter().take(usize::from(tally.value_type.channels));
            present.for_each(|cells| put(&mut bytes, u128::from(*cells)));
        }
        bytes.extend_from_slice(&tally.min.to_bytes()[..width]);
        bytes.extend_from_slice(&tally.max.to_bytes()[..width]);
        for sums in [tally.sum, tally.squares] {
            for channel in 0..usize::from(tally.value_type.channels) {
                put_sum(&mut bytes, &sums, channel);
            }
        }
        if with_classes {
            let listed = tally.listed_classes();
            put(&mut bytes, listed.map_or(NOT_COUNTED, |classes| classes.len() as u64).into());
            for (value, cells) in listed.into_iter().flatten() {
                bytes.extend_from_slice(&value.to_bytes()[..width]);
                put(&mut bytes, u128::from(*cells));
            }
        }
        bytes
    }

    /// Decodes the zone of a node of `height` at the start of `bytes`.
    pub(super) fn from_bytes(
        bytes: &[u8],
        form: TreeType,
        height: u8,
        with_classes: bool,
    ) -> Result<Zone, BadZone> {
        let width = form.width();
        let rest = &mut { bytes };
        let inner_nodes = inner_nodes(rest)?;
        let cells = get_u64(rest)?;
        if cells > form.dimension.cells(height) {
            return Err(BadZone::Wrong);
        }
        let mut tally = ZoneStats { cells, present: [cells; 4], ..ZoneStats::void(form.value) };
        if form.value.is_masked() {
            for present in tally.present.iter_mut().take(usize::from(form.value.channels)) {
                *present = get_u64(rest)?;
                if *present > cells {
                    return Err(BadZone::Wrong);
                }
            }
        }
        tally.min = value(rest, width)?;
        tally.max = value(rest, width)?;
        for sums in [&mut tally.sum, &mut tally.squares] {
            for channel in 0..usize::from(form.value.channels) {
                get_sum(rest, sums, channel)?;
            }
            // Checked here, so that adding up zones cannot overflow.
            if !sums.are_possible(cells) {
                return Err(BadZone::Wrong);
            }
        }
        if with_classes {
            let count = get_u64(rest)?;
            if count == NOT_COUNTED && cells > 0 {
                return Ok(Zone { inner_nodes, tally });
            }
            if count > cells {
                return Err(BadZone::Wrong);
            }
            // (Reserve no more than the bytes can hold: the count is untrusted.)
            let least = width + 1;
            tally.classes.reserve((count as usize).min(rest.len() / least));
            let mut counted = 0u64;
            for _ in 0..count {
                let class = (value(rest, width)?, get_u64(rest)?);
                counted = counted.checked_add(class.1).ok_or(BadZone::Wrong)?;
                tally.classes.push(class);
            }
            if counted != cells {
                return Err(BadZone::Wrong);
            }
        }
        Ok(Zone { inner_nodes, tally })
    }
}

/// Decodes a zone's first field, the number of INNER nodes.
pub(super) fn inner_nodes(bytes: &mut &[u8]) -> Result<u64, BadZone> {
    get_u64(bytes)
}

fn value(bytes: &mut &[u8], width: usize) -> Result<Value, BadZone> {
    let value = Value::read(bytes, width).ok_or(BadZone::Short)?;
    *bytes = &bytes[width..];
    Ok(value)
}

pub(super) fn put(bytes: &mut Vec<u8>, mut number: u128) {
    while number > 127 {
        bytes.push(number as u8 | 128);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Appends a signed integer. Zigzag coding maps small absolute values to small unsigned integers.
pub(super) fn put_signed(bytes: &mut Vec<u8>, number: i128) {
    put(bytes, (number << 1 ^ number >> 127) as u128);
}

pub(super) fn get_signed(bytes: &mut &[u8]) -> Result<i128, BadZone> {
    let number = get(bytes)?;
    Ok((number >> 1) as i128 ^ -((number & 1) as i128))
}

fn get(bytes: &mut &[u8]) -> Result<u128, BadZone> {
    let mut number = 0;
    for index in 0..19 {
        let (first, rest) = bytes.split_first().ok_or(BadZone::Short)?;
        *bytes = rest;
        // The last byte has the two highest bits of 128.
        if index == 18 && *first > 3 {
            return Err(BadZone::Wrong);
        }
        number |= u128::from(first & 127) << (7 * index);
        if first & 128 == 0 {
            return Ok(number);
        }
    }
    Err(BadZone::Wrong)
}

/// Appends a channel's sum.
fn put_sum(bytes: &mut Vec<u8>, sums: &Sums, channel: usize) {
    let mut sum = Vec::with_capacity(24);
    sums.write(channel, &mut sum);
    match <[u8; 16]>::try_from(&sum[..]) {
        Ok(sum) => put_signed(bytes, i128::from_le_bytes(sum)),
        Err(_) => {
            let (words, _) = sum.as_chunks();
            words.iter().for_each(|word| put(bytes, u64::from_le_bytes(*word).into()));
        }
    }
}

/// Decodes the output of [`put_sum`].
fn get_sum(bytes: &mut &[u8], sums: &mut Sums, channel: usize) -> Result<(), BadZone> {
    let mut sum = Vec::with_capacity(24);
    match sums.size() {
        16 => sum.extend(get_signed(bytes)?.to_le_bytes()),
        size => {
            for _ in 0..size / 8 {
                sum.extend(get_u64(bytes)?.to_le_bytes());
            }
        }
    }
    sums.read(channel, &sum).map(|_| ()).ok_or(BadZone::Short)
}

pub(super) fn get_u64(bytes: &mut &[u8]) -> Result<u64, BadZone> {
    u64::try_from(get(bytes)?).map_err(|_| BadZone::Wrong)
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::space::Dimension;
    use spinney_base::value::{SampleType, ValueType};

    #[test]
    fn numbers_of_any_size_come_back() {
        for number in [0, 1, 127, 128, u128::from(u64::MAX), u128::MAX - 1, u128::MAX] {
            let mut bytes = Vec::new();
            put(&mut bytes, number);
            assert_eq!(get(&mut &bytes[..]), Ok(number));
            assert_eq!(get(&mut &bytes[..bytes.len() - 1]), Err(BadZone::Short));
        }
        assert_eq!(get(&mut &[255; 30][..]), Err(BadZone::Wrong));
    }

    #[test]
    fn zones_come_back() {
        let (short, float) = (ValueType::new(SampleType::I16, 1), ValueType::new(SampleType::F32, 1));
        let (low, high) = (Value::from([-3i16]), Value::from([7i16]));
        let tally = ZoneStats::merge(&[
            &ZoneStats::leaf(short, low, 5, true),
            &ZoneStats::leaf(short, high, 90, true),
        ]);
        let zone = Zone { inner_nodes: 17, tally };
        let bytes = zone.to_bytes(true);
        let form = TreeType::new(Dimension::Quad, short);
        assert_eq!(Zone::from_bytes(&bytes, form, 6, true).as_ref(), Ok(&zone));
        assert_eq!(Zone::from_bytes(&bytes[..bytes.len() - 1], form, 6, true), Err(BadZone::Short));
        assert_eq!(Zone::from_bytes(&bytes, form, 3, true), Err(BadZone::Wrong));
        let rgb = ValueType::new(SampleType::U8, 3).with_missing(9.0);
        let tallies =
            [[9u8, 5, 9], [200, 9, 9]].map(|value| ZoneStats::leaf(rgb, Value::from(value), 16, false));
        let zone = Zone { inner_nodes: 2, tally: ZoneStats::merge(&[&tallies[0], &tallies[1]]) };
        assert_eq!(zone.tally.present, [16, 16, 0, 32]);
        let (mut bytes, form) = (zone.to_bytes(false), TreeType::new(Dimension::Quad, rgb));
        let found = Zone::from_bytes(&bytes, form, 6, false).unwrap();
        assert_eq!((found.to_bytes(false), found.tally.present), (bytes.clone(), [16, 16, 0, 32]));
        // More cells with a sample than the node has.
        bytes[4] = 33;
        assert_eq!(Zone::from_bytes(&bytes, form, 6, false), Err(BadZone::Wrong));
        let form = TreeType::new(Dimension::Quad, float);
        let floats =
            Zone { inner_nodes: 1, tally: ZoneStats::leaf(float, Value::from([-0.25f32]), 64, false) };
        assert_eq!(Zone::from_bytes(&floats.to_bytes(false), form, 6, false), Ok(floats));
    }
}
