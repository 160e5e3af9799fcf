//! Simplification of a group: each object by itself, within the group's border.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use super::distance::{Point, distance_bound};
use super::grouping::{Item, divide};
use super::patch::Patch;
use super::triangles::Triangle;
use super::{CLUSTER_FACES, REDUCTION, Simplifier};
use crate::boxes::bounds_of;

/// The object of all parts that are not closed by themselves.
pub(super) const OPEN: u32 = u32::MAX;

/// A group that was simplified.
pub(super) struct Simplified {
    /// Triangles of each cluster.
    pub(super) clusters: Vec<Vec<Triangle>>,
    /// Bound of the distance from the input, in grid units.
    pub(super) distance: f64,
    /// Number of bodies that disappeared, and a bound of the largest diameter of their exact
    /// surfaces.
    pub(super) vanished: u64,
    pub(super) diameter: f64,
}

/// The connected triangles of an object in the group.
struct Component {
    /// Whether they are closed: a whole body, or a cavity.
    is_whole: bool,
    before: usize,
    after: Vec<Triangle>,
    distance: f64,
    /// Diagonal of the bounding box.
    diagonal: f64,
}

/// Bodies with at most this many faces are not simplified: they disappear.
const SMALL: usize = 12;
/// Components with at most this many faces are also simplified without an error. Those with few
/// planes, such as buildings, thereby keep their shape.
const FEW_PLANES: usize = 2048;
/// A simplified component has at most this distance from the original, as a share of its diagonal.
const MAX_DISTANCE: f64 = 1.0 / 16.0;

/// Simplifies a group, whose triangles have a distance of at most `error` from the exact surface.
/// `objects` has the object of each part. Returns `None` if this saves too little.
pub(super) fn simplify(
    triangles: &[Triangle],
    error: f64,
    objects: &[u32],
    simplifier: &dyn Simplifier,
    level: usize,
) -> Option<Simplified> {
    let mut by_object: BTreeMap<u32, Vec<Triangle>> = BTreeMap::new();
    for triangle in triangles {
        by_object.entry(objects[triangle.part as usize]).or_default().push(*triangle);
    }
    let mut connected: Vec<Vec<Triangle>> = Vec::new();
    for own in by_object.into_values() {
        match Patch::of(&own).components() {
            None => connected.push(own),
            Some(parts) => connected
                .extend(parts.iter().map(|part| part.iter().map(|index| own[*index as usize]).collect())),
        }
    }
    // The largest components determine the error of the group; the others get no larger one.
    connected.sort_by_key(|triangles| Reverse(triangles.len()));
    let mut components: Vec<Component> = Vec::new();
    let mut most = f64::INFINITY;
    for triangles in &connected {
        let component = simplify_component(triangles, (error, most), simplifier);
        if component.distance > 0.0 {
            most = if most.is_finite() { most.max(component.distance) } else { component.distance };
        }
        components.push(component);
    }
    // Whole bodies disappear, the smallest first: those within the error, and up to half of all if
    // there are too many faces. The largest body of a group stays.
    // (A smaller goal would increase the error of all others by much.)
    let goal = triangles.len().div_ceil(2);
    let mut distance = components.iter().map(|component| component.distance).fold(0.0, f64::max);
    let mut count: usize = components.iter().map(|component| component.after.len()).sum();
    let (mut vanished, mut diameter) = (0, 0.0f64);
    let mut bodies: Vec<usize> = (0..components.len()).filter(|index| components[*index].is_whole).collect();
    bodies.sort_by(|a, b| components[*a].diagonal.total_cmp(&components[*b].diagonal));
    if bodies.len() == components.len() {
        bodies.pop();
    }
    let half = bodies.len() / 2;
    for (rank, index) in bodies.into_iter().enumerate() {
        // (The exact body is within `error` of this one.)
        let own = components[index].diagonal + 2.0 * error;
        if (count <= goal || rank >= half) && own > error + distance {
            break;
        }
        count -= components[index].after.len();
        components[index].after.clear();
        vanished += 1;
        diameter = diameter.max(own);
        distance = distance.max(own - error);
    }
    if count * 5 > triangles.len() * 4 {
        return None;
    }
    Some(Simplified { clusters: clusters(&components, level), distance, vanished, diameter })
}

/// Simplifies connected triangles, or keeps them where this fails: `error` is the bound of their
/// distance from the exact surface, and `most` the maximum distance of the result from them.
fn simplify_component(
    triangles: &[Triangle],
    (error, most): (f64, f64),
    simplifier: &dyn Simplifier,
) -> Component {
    let patch = Patch::of(triangles);
    let points = patch.points();
    let [min, max] = bounds_of(&points, 0);
    let side = |axis: usize| f64::from(max[axis] - min[axis]);
    let diagonal = (0..3).map(|axis| side(axis).powi(2)).sum::<f64>().sqrt();
    let boundary = patch.boundary(&patch.triangles);
    let kept = |after: Vec<Triangle>, distance| Component {
        is_whole: boundary.is_empty(),
        before: triangles.len(),
        after,
        distance,
        diagonal,
    };
    if triangles.len() <= SMALL {
        return kept(triangles.to_vec(), 0.0);
    }
    // (The simplifier computes in single precision, which is exact up to 2^24.)
    let near = |point: &[i32; 3]| [0, 1, 2].map(|axis| (point[axis] - min[axis]) as f32);
    let positions: Vec<[f32; 3]> = points.iter().map(near).collect();
    let goal = (triangles.len() / REDUCTION).max(SMALL);
    let locked = patch.locked(&boundary);
    let by_position = |triangles: &[[u32; 3]]| -> Vec<[u32; 3]> {
        triangles.iter().map(|triangle| triangle.map(|vertex| patch.position(vertex))).collect()
    };
    let exact_points: Vec<Point> = patch.each_position().map(|point| point.map(f64::from)).collect();
    let before = by_position(&patch.triangles);
    // Returns triangles and their distance, up to an estimated error.
    let simplified = |most: f64| -> Option<(Vec<[u32; 3]>, f64)> {
        let mut after = simplifier.simplify(&positions, &patch.triangles, &locked, goal, most as f32);
        after.retain(|triangle| !patch.is_folded(triangle));
        // Invariant: the boundary never changes, so that any choice of groups fits together. The
        // simplifier need not be trusted: a result with another boundary, or inside out, is not
        // used.
        let is_usable = after.len() < triangles.len()
            && patch.boundary(&after) == boundary
            && (!boundary.is_empty()
                || !after.is_empty() && patch.volume_sign(&after) == patch.volume_sign(&patch.triangles));
        let tolerance = error / 16.0;
        let distance = || distance_bound(&exact_points, &before, &by_position(&after), tolerance);
        is_usable.then(distance).map(|distance| (after, distance))
    };
    let free = (error / 8.0).max(0.25);
    let limit = (MAX_DISTANCE * diagonal).min(most.max(free));
    let is_bad = |(_, distance): &(Vec<[u32; 3]>, f64)| *distance > limit;
    let mut best = simplified(most.max(free).min(f32::MAX.into()));
    if triangles.len() <= FEW_PLANES && best.as_ref().is_none_or(|(_, distance)| *distance > free) {
        let flat = simplified(free);
        let is_enough = flat.as_ref().is_some_and(|(after, _)| after.len() * 2 <= triangles.len());
        if is_enough || best.as_ref().is_none_or(is_bad) {
            best = flat;
        }
    }
    match best.filter(|best| !is_bad(best)) {
        Some((after, distance)) => {
            kept(after.iter().map(|triangle| patch.triangle(triangle)).collect(), distance)
        }
        None => kept(triangles.to_vec(), 0.0),
    }
}

/// Divides the remaining triangles into clusters. Small bodies stay together.
fn clusters(components: &[Component], level: usize) -> Vec<Vec<Triangle>> {
    let mut all = Vec::new();
    let mut items = Vec::new();
    // First triangle of each item.
    let mut firsts = Vec::new();
    for component in components {
        let is_one = component.is_whole && component.before <= CLUSTER_FACES / 2;
        let size = if is_one { component.after.len().max(1) } else { 1 };
        for triangles in component.after.chunks(size) {
            let centres = triangles.iter().map(Triangle::centre);
            let sum = centres.fold([0; 3], |sum, at| [0, 1, 2].map(|axis| sum[axis] + at[axis]));
            let centre = sum.map(|sum| sum / size as i64);
            items.push(Item { centre, faces: triangles.len() as u32, index: firsts.len() as u32 });
            firsts.push(all.len());
            all.extend_from_slice(triangles);
        }
    }
    firsts.push(all.len());
    let sets = divide(items, CLUSTER_FACES as u32, level + 1);
    let of = |set: Vec<u32>| {
        let ranges = set.into_iter().map(|item| firsts[item as usize]..firsts[item as usize + 1]);
        ranges.flat_map(|range| all[range].iter().copied()).collect()
    };
    sets.into_iter().map(of).collect()
}
