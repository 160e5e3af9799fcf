//! Assembles the rings of bands to polygons with holes.

use std::collections::BTreeMap;

use super::fragments::{FragmentId, FragmentStore};
use super::join::ContourLine;
use spinney_base::Result;
use spinney_base::sort;

/// A closed ring.
struct BandRing {
    /// Its first fragment and its point count. No more, since there may be very many rings.
    first: FragmentId,
    count: u64,
    /// Twice the signed area; positive if the ring is clockwise with rows going down.
    area: f64,
    low: [f64; 2],
    high: [f64; 2],
    /// One of its points.
    point: [f64; 2],
}

/// Rings that do not belong to a complete polygon yet. A polygon has all its holes once no ring
/// above its lower end is incomplete.
pub(super) struct Polygons {
    outer: Vec<(i32, BandRing)>,
    /// By band, first row, and order of arrival.
    holes: BTreeMap<(i32, i64, u64), BandRing>,
    number: u64,
    /// Whether outer rings are counterclockwise with rows going down.
    is_reversed: bool,
}

impl Polygons {
    pub(super) fn new(is_reversed: bool) -> Polygons {
        Polygons { outer: Vec::new(), holes: BTreeMap::new(), number: 0, is_reversed }
    }

    /// Adds a ring.
    ///
    /// # Errors
    /// If its fragments cannot be read.
    pub(super) fn push(&mut self, line: ContourLine, fragments: &FragmentStore) -> Result<()> {
        let (low, high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (class, first, count) = (line.class, line.first, line.count);
        let mut ring = BandRing { first, count, area: 0.0, low, high, point: [0.0; 2] };
        let mut first = None;
        let mut last = [0.0; 2];
        fragments.each(line.first, &mut |points| {
            for point in points {
                let origin = *first.get_or_insert(*point);
                // (Relative to the first point, areas lose little to rounding.)
                let here = [point[0] - origin[0], point[1] - origin[1]];
                ring.area += last[0] * here[1] - here[0] * last[1];
                last = here;
                let [x, y] = *point;
                ring.low = [ring.low[0].min(x), ring.low[1].min(y)];
                ring.high = [ring.high[0].max(x), ring.high[1].max(y)];
            }
            Ok(())
        })?;
        ring.point = first.unwrap_or_default();
        if (ring.area > 0.0) != self.is_reversed {
            self.outer.push((class, ring));
        } else {
            self.number += 1;
            self.holes.insert((class, ring.low[1].floor() as i64, self.number), ring);
        }
        Ok(())
    }

    /// Passes all polygons with complete outer rings to `each`: the rings of each, the outer one
    /// first.
    ///
    /// # Errors
    /// If fragments cannot be read, or `each` fails.
    pub(super) fn settle(
        &mut self,
        fragments: &mut FragmentStore,
        each: &mut dyn FnMut(&[ContourLine], &FragmentStore) -> Result<()>,
    ) -> Result<()> {
        let mut outer = std::mem::take(&mut self.outer);
        // Of two rings around a hole, the smaller one is the inner. (The sort is stable for equal
        // areas.)
        sort::by_key(&mut outer, |(_, ring)| sort::float_key(ring.area.abs()));
        for (class, ring) in outer {
            let mut rings = vec![ContourLine::ring(class, ring.first, ring.count)];
            rings.extend(self.take_holes(class, &ring, fragments)?);
            each(&rings, fragments)?;
            rings.iter().for_each(|line| fragments.remove(line.first));
        }
        Ok(())
    }

    /// Removes and returns the holes inside a ring.
    fn take_holes(
        &mut self,
        class: i32,
        outer: &BandRing,
        fragments: &FragmentStore,
    ) -> Result<Vec<ContourLine>> {
        let rows = (class, outer.low[1].floor() as i64, 0)..=(class, outer.high[1].floor() as i64, u64::MAX);
        let is_near = |hole: &BandRing| {
            (0..2).all(|axis| outer.low[axis] <= hole.low[axis] && hole.high[axis] <= outer.high[axis])
        };
        let near = self.holes.range(rows).filter(|(_, hole)| is_near(hole));
        // Parity of the ring's crossings to the left of a point of each hole.
        let mut crossed: Vec<([f64; 2], _, bool)> =
            near.map(|(key, hole)| (hole.point, *key, false)).collect();
        if crossed.is_empty() {
            return Ok(Vec::new());
        }
        sort::by_key(&mut crossed, |(point, ..)| sort::float_key(point[1]));
        let mut last: Option<[f64; 2]> = None;
        fragments.each(outer.first, &mut |points| {
            for b in points {
                let Some(a) = last.replace(*b) else { continue };
                let (upper, lower) = (a[1].min(b[1]), a[1].max(b[1]));
                let start = crossed.partition_point(|(point, ..)| point[1] < upper);
                for (point, _, is_inside) in
                    crossed[start..].iter_mut().take_while(|(point, ..)| point[1] < lower)
                {
                    let x = a[0] + (point[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                    *is_inside ^= x < point[0];
                }
            }
            Ok(())
        })?;
        let mut inside: Vec<_> =
            crossed.into_iter().filter(|(.., is_inside)| *is_inside).map(|(_, key, _)| key).collect();
        sort::by(&mut inside, &mut Ord::cmp);
        Ok(inside
            .iter()
            .filter_map(|key| self.holes.remove(key))
            .map(|hole| ContourLine::ring(class, hole.first, hole.count))
            .collect())
    }
}
