//! Sums that are stored with a model: those over all faces are in a section, those over the faces
//! of each part in a column of the parts table.

use super::reader::ExactModel;
use crate::query::{MassSums, WideSum};
use spinney_base::{Error, Result};

/// Tag of the section with the sums over all faces.
pub(crate) const SUMS: [u8; 4] = *b"SUMS";
/// Column of the parts table with the sums of the parts.
pub(super) const PART_SUMS: u32 = 7;

/// Maximum bytes of a record: flags, number of faces, bounds, volume, moments, area, and the volume
/// of faces with off-grid vertices.
pub(crate) const MAX_RECORD: usize = 1 + 10 + 6 * 6 + 17 + 9 * 25 + 18 + 25;

const CLOSED: u8 = 1;
const BOUNDED: u8 = 2;

/// Sums over faces, as they are stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StoredSums {
    pub(crate) mass: MassSums,
    /// Whether these faces are closed by themselves.
    pub(crate) is_closed: bool,
}

impl StoredSums {
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let MassSums { faces, volume, first, second, area, off_grid, bounds } = &self.mass;
        let flags = u8::from(self.is_closed) * CLOSED + u8::from(bounds.is_some()) * BOUNDED;
        let mut bytes = vec![flags];
        push_number(&mut bytes, wide(i128::from(*faces)));
        bounds.iter().flatten().flatten().for_each(|at| push_number(&mut bytes, wide(i128::from(*at))));
        push_number(&mut bytes, wide(*volume));
        first.iter().chain(second).for_each(|sum| push_number(&mut bytes, sum.to_bytes()));
        let mut unsigned = [0; 24];
        unsigned[..16].copy_from_slice(&area.to_le_bytes());
        push_number(&mut bytes, unsigned);
        push_number(&mut bytes, off_grid.to_bytes());
        bytes
    }

    /// Returns the name of a field that differs from that of other sums.
    pub(super) fn difference(&self, other: &StoredSums) -> Option<&'static str> {
        let (own, mass) = (&self.mass, &other.mass);
        let differences = [
            ("number of faces", own.faces != mass.faces),
            ("bounds", own.bounds != mass.bounds),
            ("volume", own.volume != mass.volume),
            ("first moments", own.first != mass.first),
            ("second moments", own.second != mass.second),
            ("area", own.area != mass.area),
            ("volume off the grid", own.off_grid != mass.off_grid),
            ("closedness", self.is_closed != other.is_closed),
        ];
        differences.into_iter().find(|(_, differs)| *differs).map(|(name, _)| name)
    }

    /// Reads a record; returns the bytes after it, or `None` if it is invalid.
    pub(crate) fn read(mut bytes: &[u8]) -> Option<(StoredSums, &[u8])> {
        let (flags, rest) = bytes.split_first()?;
        bytes = rest;
        let mut next = || take_number(&mut bytes);
        let faces = u64::try_from(narrow(next()?)?).ok()?;
        let mut bounds = None;
        if flags & BOUNDED != 0 {
            let mut corners = [[0; 3]; 2];
            for at in corners.as_flattened_mut() {
                *at = i32::try_from(narrow(next()?)?).ok()?;
            }
            bounds = Some(corners);
        }
        let volume = narrow(next()?)?;
        let mut sums = [WideSum::default(); 9];
        for sum in &mut sums {
            *sum = WideSum::from_bytes(next()?);
        }
        let [a, b, c, second @ ..] = sums;
        let area = next()?;
        let is_area = area[16..] == [0; 8];
        let area = u128::from_le_bytes(area[..16].try_into().ok()?);
        let off_grid = WideSum::from_bytes(next()?);
        let mass = MassSums { faces, volume, first: [a, b, c], second, area, off_grid, bounds };
        let is_valid = is_area && *flags <= CLOSED | BOUNDED;
        is_valid.then_some((StoredSums { mass, is_closed: flags & CLOSED != 0 }, bytes))
    }
}

fn wide(number: i128) -> [u8; 24] {
    let mut bytes = [if number < 0 { 0xff } else { 0 }; 24];
    bytes[..16].copy_from_slice(&number.to_le_bytes());
    bytes
}

fn narrow(bytes: [u8; 24]) -> Option<i128> {
    let number = i128::from_le_bytes(bytes[..16].try_into().ok()?);
    (wide(number) == bytes).then_some(number)
}

/// Appends a number in two's complement: the number of its bytes, and as few bytes as possible.
fn push_number(bytes: &mut Vec<u8>, number: [u8; 24]) {
    let sign = if number[23] >= 0x80 { 0xff } else { 0 };
    let mut count = 24;
    while count > 0 && number[count - 1] == sign && (count == 1 || (number[count - 2] ^ sign) < 0x80) {
        count -= 1;
    }
    // (Without bytes, a number is 0.)
    let count = if sign != 0 { count.max(1) } else { count };
    bytes.push(count as u8);
    bytes.extend_from_slice(&number[..count]);
}

fn take_number(bytes: &mut &[u8]) -> Option<[u8; 24]> {
    let (count, rest) = bytes.split_first()?;
    let (own, rest) = rest.split_at_checked(usize::from(*count))?;
    *bytes = rest;
    let mut number = [if own.last().is_some_and(|last| *last >= 0x80) { 0xff } else { 0 }; 24];
    number.get_mut(..own.len())?.copy_from_slice(own);
    Some(number)
}

impl ExactModel {
    /// Reads the stored sums over all faces; `None` for files without sums.
    pub(crate) fn stored_sums(&self) -> Result<Option<StoredSums>> {
        let section = self.trailer.section(SUMS);
        if section.length == 0 {
            return Ok(None);
        }
        if section.length > MAX_RECORD as u64 {
            return Err(self.wrong_sums(format!("{} bytes", section.length)));
        }
        let sums = self.sums_of(&section.read(&self.path, &*self.backend, "sums")?)?;
        if sums.mass.faces != self.summary.faces {
            return Err(self.wrong_sums(format!("{} of {} faces", sums.mass.faces, self.summary.faces)));
        }
        Ok(Some(sums))
    }

    /// Returns the stored bytes of the section; empty for files without sums.
    pub(crate) fn sums_section(&self) -> Result<Vec<u8>> {
        self.stored_sums().map(|sums| sums.map_or_else(Vec::new, |sums| sums.to_bytes()))
    }

    /// Visits the stored sums of all parts with faces, by ascending part numbers. Returns whether
    /// there are any: otherwise, nothing was visited.
    pub(crate) fn each_part_sums(
        &self,
        each: &mut dyn FnMut(u32, &StoredSums) -> Result<()>,
    ) -> Result<bool> {
        let Some(total) = self.stored_sums()? else { return Ok(false) };
        if self.summary.parts == 1 {
            if self.summary.faces + self.summary.exact_faces > 0 {
                each(0, &total)?;
            }
            return Ok(true);
        }
        let mut faces = 0u64;
        self.each_value(&self.objects, PART_SUMS, &mut |part, value| {
            if u64::from(part) >= self.summary.parts {
                return Err(self.wrong_sums(format!("sums of part {part} of {}", self.summary.parts)));
            }
            let sums = self.sums_of(value)?;
            faces = faces.saturating_add(sums.mass.faces);
            each(part, &sums)
        })?;
        match faces == self.summary.faces {
            true => Ok(true),
            false => Err(self.wrong_sums(format!("{faces} of {} faces in all parts", self.summary.faces))),
        }
    }

    /// Reads the stored sums of a part that has some.
    pub(super) fn part_sums(&self, part: u32) -> Result<Option<StoredSums>> {
        match self.summary.parts {
            1 => self.stored_sums(),
            _ => self.value(&self.objects, PART_SUMS, part)?.map(|value| self.sums_of(&value)).transpose(),
        }
    }

    fn sums_of(&self, bytes: &[u8]) -> Result<StoredSums> {
        let found = StoredSums::read(bytes).filter(|(_, rest)| rest.is_empty());
        let (sums, _) = found.ok_or_else(|| self.wrong_sums("a record that does not fit".into()))?;
        let is_within = |[min, max]: [[i32; 3]; 2]| {
            (0..3).all(|axis| {
                0 <= min[axis] && min[axis] <= max[axis] && max[axis] >> self.summary.grid.bits == 0
            })
        };
        match sums.mass.bounds {
            Some(bounds) if !is_within(bounds) => Err(self.wrong_sums(format!("bounds {bounds:?}"))),
            _ => Ok(sums),
        }
    }

    pub(super) fn wrong_sums(&self, found: String) -> Error {
        self.corrupt("sums".into(), found, "sums as in formats.md")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_take_as_few_bytes_as_possible() {
        let numbers = [(0, 0), (1, 1), (127, 1), (128, 2), (-1, 1), (-128, 1), (-129, 2), (i128::MIN, 16)];
        for (number, bytes) in numbers {
            let mut stored = Vec::new();
            push_number(&mut stored, wide(number));
            assert_eq!(stored.len(), bytes + 1, "{number}");
            let found = take_number(&mut &stored[..]).unwrap();
            assert_eq!(narrow(found), Some(number));
        }
        assert_eq!(take_number(&mut &[25; 26][..]), None);
        assert_eq!(take_number(&mut &[2, 0][..]), None);
    }

    #[test]
    fn largest_records_are_restored() {
        let full = WideSum::from_bytes([0x7f; 24]);
        let mass = MassSums {
            faces: u64::MAX,
            volume: i128::MIN,
            first: [full; 3],
            second: [full; 6],
            area: u128::MAX,
            off_grid: full,
            bounds: Some([[i32::MIN; 3], [i32::MAX; 3]]),
        };
        for sums in
            [StoredSums { mass, is_closed: false }, StoredSums { mass: MassSums::new(), is_closed: true }]
        {
            let bytes = sums.to_bytes();
            assert!(bytes.len() <= MAX_RECORD, "{}", bytes.len());
            assert_eq!(StoredSums::read(&bytes), Some((sums, &[][..])));
            for end in 0..bytes.len() {
                assert_eq!(StoredSums::read(&bytes[..end]), None);
            }
        }
    }
}
