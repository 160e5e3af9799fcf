//! Placements: windows of sources, and the cells that they cover.

use spinney_base::sort;
use spinney_base::space::{Dimension, Region, morton_encode};
use spinney_packing::Columns;

/// A window of a source, and the cells of a layer that its pixels are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappedWindow {
    /// Number of the source.
    pub source: u32,
    /// Number of the list of the source's channels that are used.
    pub channels: u32,
    /// Number of the rule for pixels that are VOID.
    pub rule: u32,
    /// The cells.
    pub cells: Region,
    /// Column and row of the source's pixel that is the first cell.
    pub from: [u64; 2],
}

/// Maximum number of placements of all layers.
pub(crate) const MAX_PLACEMENTS: u64 = 1 << 22;
/// Maximum number of placements per byte that they take.
const MAX_PER_BYTE: u64 = 1 << 6;
/// Contexts of numbers: a placement has nine.
const NUMBERS: usize = 9;
/// Limit of positions and sizes.
const MAX_SIDE: u64 = 1 << 31;

/// Encodes placements, from the bottom to the top: the number of each field minus that of the
/// placement before.
pub(crate) fn encode(placements: &[MappedWindow]) -> Vec<u8> {
    let mut columns = Columns::writer(1, NUMBERS);
    let mut before = [0; NUMBERS];
    for placement in placements {
        let fields = fields(placement);
        for (context, (field, before)) in fields.iter().zip(&before).enumerate() {
            columns.near(context, field - before);
        }
        before = fields;
    }
    columns.finish()
}

/// Decodes `count` placements, at most [`MAX_PLACEMENTS`], of sources below `sources`; `None` if
/// they are invalid.
pub(crate) fn decode(bytes: &[u8], count: u64, sources: u32) -> Option<Vec<MappedWindow>> {
    if count > MAX_PER_BYTE.saturating_mul(bytes.len() as u64) {
        return None;
    }
    let mut columns = Columns::reader(bytes, 1, NUMBERS)?;
    let mut placements = Vec::new();
    let mut fields = [0i64; NUMBERS];
    for _ in 0..count {
        for (context, field) in fields.iter_mut().enumerate() {
            *field = field.checked_add(columns.near(context, 0))?;
        }
        let number = |field: i64| u64::try_from(field).ok().filter(|number| *number < MAX_SIDE);
        let [source, channels, rule, x, y, width, height, left, top] = fields.map(number);
        let region = Region::new(x?, y?, width?, height?);
        if region.is_empty() || u64::from(sources) <= source? {
            return None;
        }
        let [source, channels, rule] = [source?, channels?, rule?].map(|number| number as u32);
        placements.push(MappedWindow { source, channels, rule, cells: region, from: [left?, top?] });
    }
    columns.is_whole().then_some(placements)
}

fn fields(placement: &MappedWindow) -> [i64; NUMBERS] {
    let MappedWindow { source, channels, rule, cells, from } = *placement;
    let numbers = [source, channels, rule].map(u64::from);
    let [source, channels, rule] = numbers;
    let Region { x, y, width, height } = cells;
    [source, channels, rule, x, y, width, height, from[0], from[1]].map(|number| number as i64)
}

/// Finds the placements that intersect a region: a tree of bounding boxes.
pub struct MappedWindowIndex {
    /// Placements from the bottom to the top.
    placements: Vec<MappedWindow>,
    /// Numbers of the placements, those that are near each other together.
    order: Vec<u32>,
    /// Levels of boxes: of [`FANOUT`] placements each, then of `FANOUT` boxes of the level before.
    levels: Vec<Vec<Region>>,
}

/// Number of children of a box.
const FANOUT: usize = 8;

impl MappedWindowIndex {
    /// Creates the index of placements, from the bottom to the top.
    pub fn new(placements: Vec<MappedWindow>) -> MappedWindowIndex {
        let mut order: Vec<u32> = (0..placements.len() as u32).collect();
        let middle = |number: u32| {
            let Region { x, y, width, height } = placements[number as usize].cells;
            let spread = |at: u64| morton_encode(Dimension::Quad, at as u32);
            spread(x + width / 2) | spread(y + height / 2) << 1
        };
        sort::by_key(&mut order, |number| middle(*number));
        let joined = |boxes: &[Region]| boxes.iter().copied().reduce(union).expect("chunks are not empty");
        let leaves: Vec<Region> = order.iter().map(|number| placements[*number as usize].cells).collect();
        let mut levels: Vec<Vec<Region>> = vec![leaves.chunks(FANOUT).map(joined).collect()];
        while let Some(last) = levels.last().filter(|last| last.len() > 1) {
            levels.push(last.chunks(FANOUT).map(joined).collect());
        }
        MappedWindowIndex { placements, order, levels }
    }

    /// Returns the placements that intersect a region, from the bottom to the top.
    pub fn touching(&self, region: &Region) -> Vec<&MappedWindow> {
        let mut found = Vec::new();
        let mut pending = vec![(self.levels.len(), 0)];
        while let Some((level, number)) = pending.pop() {
            let Some(below) = level.checked_sub(1) else {
                let number = self.order[number];
                if !self.placements[number as usize].cells.intersect(region).is_empty() {
                    found.push(number);
                }
                continue;
            };
            if self.levels[below].get(number).is_none_or(|bounds| bounds.intersect(region).is_empty()) {
                continue;
            }
            let children = if below == 0 { self.order.len() } else { self.levels[below - 1].len() };
            let first = number * FANOUT;
            pending.extend((first..children.min(first + FANOUT)).map(|child| (below, child)));
        }
        sort::numbers32(&mut found);
        found.into_iter().map(|number| &self.placements[number as usize]).collect()
    }
}

/// Returns the smallest region that has all cells of two regions.
pub(crate) fn union(a: Region, b: Region) -> Region {
    let (x, y) = (a.x.min(b.x), a.y.min(b.y));
    Region::new(x, y, a.right().max(b.right()) - x, a.bottom().max(b.bottom()) - y)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn placement() -> impl Strategy<Value = MappedWindow> {
        let place = (0u64..2000, 0u64..2000, 1u64..400, 1u64..400);
        (0u32..50, 0u32..2, 0u32..2, place, 0u64..9).prop_map(|(source, channels, rule, at, from)| {
            let cells = Region::new(at.0, at.1, at.2, at.3);
            MappedWindow { source, channels, rule, cells, from: [from, 0] }
        })
    }

    /// Placements of a regular grid take least, and are within the limit.
    #[test]
    fn a_regular_grid_is_within_the_limit() {
        let cells = |number: u64| Region::new(number % 300 * 512, number / 300 * 512, 512, 512);
        let placement = |number: u64| MappedWindow {
            source: number as u32,
            channels: 0,
            rule: 0,
            cells: cells(number),
            from: [0; 2],
        };
        let all: Vec<MappedWindow> = (0..90_000).map(placement).collect();
        let bytes = encode(&all);
        assert!(decode(&bytes, all.len() as u64, 90_000) == Some(all));
    }

    proptest! {
        #[test]
        fn placements_come_back_and_are_found(
            all in prop::collection::vec(placement(), 0..80),
            (x, y, width, height) in (0u64..2400, 0u64..2400, 1u64..500, 1u64..500),
        ) {
            let bytes = encode(&all);
            prop_assert_eq!(decode(&bytes, all.len() as u64, 50), Some(all.clone()));
            prop_assert_eq!(decode(&bytes, all.len() as u64 + 1, 50), None);
            let region = Region::new(x, y, width, height);
            let index = MappedWindowIndex::new(all.clone());
            let touching: Vec<&MappedWindow> =
                all.iter().filter(|placement| !placement.cells.intersect(&region).is_empty()).collect();
            prop_assert_eq!(index.touching(&region), touching);
        }
    }
}
