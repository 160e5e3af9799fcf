//! Assembles complete regions into polygons: their borders as rings, the outer ring first.

use std::collections::{BTreeMap, HashMap};

use super::arcs::Arcs;
use super::labels::Labels;
use super::points::{NONE, Point};
use spinney_base::Result;
use spinney_base::sort;

/// A ring of consecutive half-edges.
#[derive(Default)]
pub(super) struct Ring {
    halves: Vec<u32>,
    /// Number of points. The last point repeats the first.
    pub(super) count: u64,
}

/// Rules for assembling rings.
#[derive(Clone, Copy)]
pub(super) struct RingRules {
    /// Whether to reverse the orientation of rings.
    pub(super) is_reversed: bool,
    /// Whether to keep collinear points where arcs end.
    pub(super) keeps_junctions: bool,
}

impl Ring {
    fn new(mut halves: Vec<u32>, arcs: &Arcs, rules: RingRules) -> Ring {
        if rules.is_reversed {
            // (Use the opposite half-edges.)
            halves.reverse();
            halves.iter_mut().for_each(|half| *half ^= 1);
        }
        let mut count = 1;
        for (index, half) in halves.iter().enumerate() {
            count += arcs.arc(half / 2).count - 1;
            count -= u64::from(Ring::is_dropped(&halves, index, arcs, rules));
        }
        Ring { halves, count }
    }

    /// Returns whether to omit the point where a half-edge begins.
    fn is_dropped(halves: &[u32], index: usize, arcs: &Arcs, rules: RingRules) -> bool {
        let before = halves[index.checked_sub(1).unwrap_or(halves.len() - 1)];
        !rules.keeps_junctions && arcs.is_straight(before, halves[index])
    }

    /// Passes the points to `each` in chunks.
    pub(super) fn points(
        &self,
        arcs: &Arcs,
        rules: RingRules,
        each: &mut dyn FnMut(&[Point]) -> Result<()>,
    ) -> Result<()> {
        let mut first: Option<Point> = None;
        for (index, half) in self.halves.iter().enumerate() {
            let arc = arcs.arc(half / 2);
            // The last point is the first of the next half-edge.
            let mut left = arc.count - 1;
            let mut skipped = usize::from(Ring::is_dropped(&self.halves, index, arcs, rules));
            arcs.points.each(arc.chain, half % 2 == 1, &mut |points| {
                let points = &points[..points.len().min(usize::try_from(left).unwrap_or(usize::MAX))];
                left -= points.len() as u64;
                let skip = skipped.min(points.len());
                skipped -= skip;
                let points = &points[skip..];
                if let Some(point) = points.first() {
                    first.get_or_insert(*point);
                    each(points)?;
                }
                Ok(())
            })?;
        }
        first.map_or(Ok(()), |first| each(&[first]))
    }
}

/// Polygons of a region.
pub(super) struct RegionRings {
    /// Rings of all polygons, polygon by polygon, each with its outer ring first.
    pub(super) rings: Vec<Ring>,
    /// Number of rings of each polygon.
    pub(super) polygons: Vec<usize>,
    /// Arcs of the region, each once: its other side has another class, so the region has only one
    /// of its half-edges.
    arcs: Vec<u32>,
}

impl RegionRings {
    /// Assembles the borders of a region.
    pub(super) fn new(first: u32, arcs: &mut Arcs, labels: &mut Labels, rules: RingRules) -> RegionRings {
        let mut all = Vec::new();
        // Rings of each polygon, by the root of its cells.
        let mut rings_by_root: BTreeMap<u32, Vec<(i128, Ring)>> = BTreeMap::new();
        let mut listed = first;
        while listed != NONE {
            all.push(listed / 2);
            let start = listed;
            listed = arcs.listed_after(listed);
            let mut half = start;
            let mut border = Vec::new();
            while arcs.see(half) {
                border.push(half);
                // (The number of an end is also the half-edge that begins there.)
                half = arcs.half_after(half);
            }
            if border.is_empty() {
                continue;
            }
            let label = arcs.arc(start / 2).labels[(start % 2) as usize];
            let own_rings = rings_by_root.entry(labels.find_edge_root(label)).or_default();
            for halves in simple_rings(border, arcs) {
                let area: i128 = halves.iter().map(|half| arcs.swept(*half)).sum();
                own_rings.push((area, Ring::new(halves, arcs, rules)));
            }
        }
        let mut made = RegionRings { rings: Vec::new(), polygons: Vec::new(), arcs: all };
        for (_, mut rings) in rings_by_root {
            // The region is on the left, so its outer ring is counterclockwise with rows going down
            // and has a negative area. (Simplified arcs keep the area of the exact border. Only its
            // sign is used, which simplification preserves.)
            sort::by_key(&mut rings, |(area, _)| u64::from(*area >= 0));
            made.polygons.push(rings.len());
            made.rings.extend(rings.into_iter().map(|(_, ring)| ring));
        }
        made
    }

    /// Releases the region's arcs.
    pub(super) fn release(self, arcs: &mut Arcs) {
        self.arcs.into_iter().for_each(|arc| arcs.release(arc));
    }
}

/// Splits a closed border where it visits a point twice, which it only does at pinched ends. Rings
/// then touch there instead of crossing themselves or each other.
fn simple_rings(border: Vec<u32>, arcs: &Arcs) -> Vec<Vec<u32>> {
    let mut rings = Vec::new();
    // Half-edges that are in no ring yet, and the positions of those that begin at pinched points.
    let mut open_path: Vec<u32> = Vec::new();
    let mut positions: HashMap<Point, usize> = HashMap::new();
    for half in border {
        if let (point, true) = arcs.start(half) {
            if let Some(position) = positions.get(&point).copied() {
                // The path returns to this point: its end from there on is a ring.
                let ring = open_path.split_off(position);
                for half in &ring[1..] {
                    positions.remove(&arcs.start(*half).0);
                }
                rings.push(ring);
            } else {
                positions.insert(point, open_path.len());
            }
        }
        open_path.push(half);
    }
    rings.push(open_path);
    rings
}
