//! Zones: what is known of all the cells below a large node, so that edits and statistics need not look at them.
//!
//! A zone stands behind the record of every INNER node of at least 4096 cells. Numbers are LEB128: seven bits a byte,
//! the lowest first; sums are zigzag-coded 128-bit numbers (those of floating samples are the bits of an f64).

use zerocopy::{FromBytes, IntoBytes};

use crate::space::Dimension;
use crate::value::{Sample, Sum, Tally, Value};

/// Levels below the smallest nodes with zones: 64 x 64 cells, or 16 x 16 x 16.
pub(super) const fn zone_height<D: Dimension>() -> u8 {
    12 / D::AXES as u8
}

/// A zone.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Zone<V: Value> {
    /// INNER nodes of the subtree, its root included; those of shared subtrees as often as they occur.
    pub(super) records: u64,
    pub(super) tally: Tally<V>,
}

/// Why bytes are no zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BadZone {
    /// They end too early.
    Short,
    /// They say something impossible.
    Wrong,
}

impl<V: Value> Zone<V> {
    pub(super) fn to_bytes(&self, with_classes: bool) -> Vec<u8> {
        let Zone { records, tally } = self;
        let mut bytes = Vec::with_capacity(64);
        put(&mut bytes, u128::from(*records));
        put(&mut bytes, u128::from(tally.cells));
        bytes.extend_from_slice(tally.min.to_wire().as_bytes());
        bytes.extend_from_slice(tally.max.to_wire().as_bytes());
        for sum in tally.sum.as_ref().iter().chain(tally.squares.as_ref()) {
            let number = i128::from_le_bytes(sum.to_bytes());
            put(&mut bytes, (number << 1 ^ number >> 127) as u128);
        }
        if with_classes {
            put(&mut bytes, tally.classes.len() as u128);
            for (value, cells) in &tally.classes {
                bytes.extend_from_slice(value.to_wire().as_bytes());
                put(&mut bytes, u128::from(*cells));
            }
        }
        bytes
    }

    /// Reads the zone of a node of `height` levels from the start of some bytes.
    pub(super) fn from_bytes(
        bytes: &[u8],
        axes: usize,
        height: u8,
        with_classes: bool,
    ) -> Result<Self, BadZone> {
        let rest = &mut { bytes };
        let records = records(rest)?;
        let cells = get_u64(rest)?;
        let all = 1u64 << (axes * usize::from(height)).min(63);
        if cells > all {
            return Err(BadZone::Wrong);
        }
        let mut tally: Tally<V> = Tally { cells, ..Tally::void() };
        tally.min = value(rest)?;
        tally.max = value(rest)?;
        // No square of an integer sample is larger than 2^64: sums of any zones cannot overflow.
        let most = cells as f64 * 2f64.powi(64);
        for sum in tally.sum.as_mut().iter_mut().chain(tally.squares.as_mut()) {
            let number = get(rest)?;
            let number = (number >> 1) as i128 ^ -((number & 1) as i128);
            *sum = <V::Sample as Sample>::TotalSum::from_bytes(number.to_le_bytes());
            if !V::TYPE.sample.is_float() && sum.to_f64().abs() > most {
                return Err(BadZone::Wrong);
            }
        }
        if with_classes {
            let count = get_u64(rest)?;
            if count > cells {
                return Err(BadZone::Wrong);
            }
            // (No more room than the bytes can need: the number may lie.)
            let least = size_of::<V::Wire>() + 1;
            tally.classes.reserve((count as usize).min(rest.len() / least));
            let mut counted = 0u64;
            for _ in 0..count {
                let class = (value(rest)?, get_u64(rest)?);
                counted = counted.checked_add(class.1).ok_or(BadZone::Wrong)?;
                tally.classes.push(class);
            }
            if counted != cells {
                return Err(BadZone::Wrong);
            }
        }
        Ok(Zone { records, tally })
    }
}

/// The first number of a zone.
pub(super) fn records(bytes: &mut &[u8]) -> Result<u64, BadZone> {
    get_u64(bytes)
}

fn value<V: Value>(bytes: &mut &[u8]) -> Result<V, BadZone> {
    let (wire, rest) = V::Wire::read_from_prefix(bytes).map_err(|_| BadZone::Short)?;
    *bytes = rest;
    Ok(V::from_wire(wire))
}

fn put(bytes: &mut Vec<u8>, mut number: u128) {
    while number > 127 {
        bytes.push(number as u8 | 128);
        number >>= 7;
    }
    bytes.push(number as u8);
}

fn get(bytes: &mut &[u8]) -> Result<u128, BadZone> {
    let mut number = 0;
    for place in 0..19 {
        let (first, rest) = bytes.split_first().ok_or(BadZone::Short)?;
        *bytes = rest;
        // The last byte has room for the two bits that are left.
        if place == 18 && *first > 3 {
            return Err(BadZone::Wrong);
        }
        number |= u128::from(first & 127) << (7 * place);
        if first & 128 == 0 {
            return Ok(number);
        }
    }
    Err(BadZone::Wrong)
}

fn get_u64(bytes: &mut &[u8]) -> Result<u64, BadZone> {
    u64::try_from(get(bytes)?).map_err(|_| BadZone::Wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let classes = [([-3i16], 5), ([7], 90)];
        let tally =
            Tally::merge(&[&Tally::leaf(classes[0].0, 5, true), &Tally::leaf(classes[1].0, 90, true)]);
        let zone = Zone { records: 17, tally };
        let bytes = zone.to_bytes(true);
        assert_eq!(Zone::from_bytes(&bytes, 2, 6, true).as_ref(), Ok(&zone));
        assert_eq!(Zone::<[i16; 1]>::from_bytes(&bytes[..bytes.len() - 1], 2, 6, true), Err(BadZone::Short));
        assert_eq!(Zone::<[i16; 1]>::from_bytes(&bytes, 2, 3, true), Err(BadZone::Wrong));
        let floats = Zone { records: 1, tally: Tally::<[f32; 1]>::leaf([-0.25], 64, false) };
        assert_eq!(Zone::from_bytes(&floats.to_bytes(false), 2, 6, false), Ok(floats));
    }
}
