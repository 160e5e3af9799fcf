//! Assembles rings of a shape into polygons, by finding which rings are holes of which outer rings.

use spinney_crs::PolygonParts;

type Ring = Vec<[f64; 2]>;

/// Limit of box and edge tests per shape.
const MAX_STEPS: u64 = 1 << 30;

/// Assembles rings in any order into polygons. By the specification (Esri, 1998), outer rings are
/// clockwise, holes counterclockwise, and each hole follows its outer ring. If rings seem to
/// violate this, nesting decides.
///
/// # Errors
/// If nesting would take too long, and the directions are inconsistent.
pub(super) fn parts_of(rings: Vec<Ring>) -> Result<PolygonParts, String> {
    let rings: Vec<Ring> = rings.into_iter().filter(|ring| !ring.is_empty()).collect();
    let (outer, is_sure) = in_order(&rings);
    if !is_sure && let Some(parts) = nested(&rings) {
        return Ok(parts);
    }
    let outer = outer.ok_or_else(|| format!("{} rings that do not say which are holes", rings.len()))?;
    let mut parts = PolygonParts::new();
    for (ring, is_outer) in rings.into_iter().zip(outer) {
        match parts.last_mut() {
            Some(last) if !is_outer => last.push(ring),
            _ => parts.push(vec![ring]),
        }
    }
    Ok(parts)
}

/// Returns twice the signed area, which is negative for clockwise rings (with y up).
fn area(ring: &Ring) -> f64 {
    let [ox, oy] = ring.first().copied().unwrap_or_default();
    let ends = ring.iter().zip(ring.iter().cycle().skip(1));
    ends.map(|([ax, ay], [bx, by])| (ax - ox) * (by - oy) - (bx - ox) * (ay - oy)).sum()
}

/// Returns which rings are outer ones by their directions, if each is followed by its holes, and
/// whether nothing contradicts this. After a limit, holes are tested by their boxes only.
fn in_order(rings: &[Ring]) -> (Option<Vec<bool>>, bool) {
    let mut around: Option<(&Ring, [f64; 4])> = None;
    let (mut steps, mut is_sure) = (0, true);
    let mut outer = Vec::with_capacity(rings.len());
    for ring in rings {
        let (is_outer, own) = (area(ring) <= 0.0, extent(ring));
        let is_in_box = around.is_some_and(|(_, extent)| has(extent, own));
        if is_outer {
            // This is an island in a hole, or a hole with the wrong direction.
            is_sure &= !is_in_box;
            around = Some((ring, own));
        } else if let Some((other, _)) = around.filter(|_| is_in_box) {
            steps += other.len() as u64;
            if steps < MAX_STEPS / 4 && !is_within(ring, other) {
                return (None, false);
            }
        } else {
            return (None, false);
        }
        outer.push(is_outer);
    }
    (Some(outer), is_sure)
}

/// Returns the minimum and maximum x and y.
fn extent(ring: &Ring) -> [f64; 4] {
    ring.iter()
        .fold([f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY], |[a, b, c, d], [x, y]| {
            [a.min(*x), b.min(*y), c.max(*x), d.max(*y)]
        })
}

fn has(outer: [f64; 4], inner: [f64; 4]) -> bool {
    outer[0] <= inner[0] && outer[1] <= inner[1] && outer[2] >= inner[2] && outer[3] >= inner[3]
}

/// Returns whether a ring is inside another one. The first vertex that is not on the other's border
/// decides, since vertices of a hole may be on it.
fn is_within(ring: &Ring, other: &Ring) -> bool {
    ring.iter().take(8).find_map(|corner| contains(other, *corner)).unwrap_or(true)
}

/// Returns whether a point is inside; `None` on the border.
fn contains(ring: &Ring, [x, y]: [f64; 2]) -> Option<bool> {
    let mut is_inside = false;
    for ([ax, ay], [bx, by]) in ring.iter().zip(ring.iter().cycle().skip(1)) {
        let side = (bx - ax) * (y - ay) - (x - ax) * (by - ay);
        let (is_in_x, is_in_y) = (ax.min(*bx) <= x && x <= ax.max(*bx), ay.min(*by) <= y && y <= ay.max(*by));
        if side == 0.0 && is_in_x && is_in_y {
            return None;
        }
        if (*ay > y) != (*by > y) && (side > 0.0) == (by > ay) {
            is_inside = !is_inside;
        }
    }
    Some(is_inside)
}

/// Assembles polygons by nesting. Rings inside an even number of others are outer rings, the others
/// are holes of the smallest ring around them. `None` if that takes too long.
fn nested(rings: &[Ring]) -> Option<PolygonParts> {
    let sized = rings.iter().map(|ring| (area(ring).abs(), extent(ring), ring));
    let mut sized: Vec<(f64, [f64; 4], &Ring)> = sized.collect();
    // Largest first, so that enclosing rings precede a ring.
    spinney_base::sort::by(&mut sized, &mut |a, b| b.0.total_cmp(&a.0));
    let mut steps = 0u64;
    // Depth of each ring, and the polygon that contains it.
    let mut placed: Vec<(usize, usize)> = Vec::with_capacity(rings.len());
    let mut parts = PolygonParts::new();
    for (index, (_, own, ring)) in sized.iter().enumerate() {
        let mut around = None;
        for (before, (_, extent, other)) in sized[..index].iter().enumerate().rev() {
            steps += 1;
            if has(*extent, *own) {
                steps += other.len() as u64;
                if is_within(ring, other) {
                    around = Some(placed[before]);
                    break;
                }
            }
            if steps > MAX_STEPS {
                return None;
            }
        }
        match around {
            // The enclosing ring is an outer ring, so this is a hole.
            Some((depth, part)) if depth % 2 == 0 => {
                parts[part].push((*ring).clone());
                placed.push((depth + 1, part));
            }
            around => {
                placed.push((around.map_or(0, |(depth, _)| depth + 1), parts.len()));
                parts.push(vec![(*ring).clone()]);
            }
        }
    }
    Some(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(at: [f64; 2], size: f64, is_clockwise: bool) -> Ring {
        let [x, y] = at;
        let mut ring = vec![[x, y], [x, y + size], [x + size, y + size], [x + size, y], [x, y]];
        if !is_clockwise {
            ring.reverse();
        }
        ring
    }

    #[test]
    fn holes_find_the_ring_around_them() {
        let lengths =
            |rings: Vec<Ring>| -> Vec<usize> { parts_of(rings).unwrap().iter().map(Vec::len).collect() };
        let [outer, hole] = [square([0.0, 0.0], 10.0, true), square([1.0, 1.0], 3.0, false)];
        let island = square([2.0, 2.0], 1.0, true);
        let other = square([20.0, 0.0], 10.0, true);
        assert_eq!(lengths(vec![outer.clone(), hole.clone(), island.clone(), other.clone()]), [2, 1, 1]);
        // Holes before their outer rings, or after another ring.
        assert_eq!(lengths(vec![hole.clone(), outer.clone()]), [2]);
        assert_eq!(lengths(vec![outer.clone(), other.clone(), hole.clone()]), [2, 1]);
        // All with the wrong direction.
        let turned = |ring: &Ring| ring.iter().rev().copied().collect::<Ring>();
        assert_eq!(lengths([&outer, &hole, &island].map(turned).to_vec()), [2, 1]);
        assert_eq!(lengths(vec![outer.clone(), turned(&hole), island.clone()]), [2, 1]);
        // A hole that touches its ring at a vertex.
        assert_eq!(lengths(vec![outer, square([0.0, 0.0], 3.0, false)]), [2]);
        assert_eq!(lengths(vec![]), [] as [usize; 0]);
    }
}
