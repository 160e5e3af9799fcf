//! Areas in which two surfaces coincide.

use std::collections::BTreeMap;

use super::IntersectionArea;
use crate::Grid;
use crate::arrangement::{Contact, Corner, PlaneRegion, PlaneSegment, SamplePoint, Surface, regions};
use crate::exact::union_find::UnionFind;
use crate::exact::vector::{cross, subtract};
use crate::query::SectionPolygon;
use spinney_base::{Progress, Result, parallel, sort};

/// Returns the areas in which faces of both bodies coincide. Adjacent areas of one kind are merged.
///
/// # Errors
/// If `memory` bytes are insufficient, or on cancellation.
pub(crate) fn areas(
    surface: &Surface<'_>,
    contacts: &[Contact],
    grid: &Grid,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Vec<IntersectionArea>> {
    /// Bytes per vertex, with its edges and loops.
    const VERTEX: u64 = 1 << 10;
    let groups = groups(contacts);
    let gives_up = |vertices: usize| vertices as u64 * VERTEX > memory || progress.interrupted();
    let found = parallel::map(&groups, |faces| match progress.interrupted() {
        true => None,
        false => areas_of(surface, faces, grid, &gives_up),
    });
    progress.check()?;
    let mut all = Vec::new();
    for found in found {
        let found = found.ok_or_else(|| surface.too_large(memory))?;
        all.extend(found);
    }
    Ok(all)
}

/// Groups coplanar faces that overlap, directly or through other faces of the group, by their first
/// faces.
fn groups(contacts: &[Contact]) -> Vec<Vec<u32>> {
    let pairs: Vec<[u32; 2]> =
        contacts.iter().filter(|contact| contact.may_overlap).map(|contact| contact.faces).collect();
    let mut faces: Vec<u32> = pairs.iter().flatten().copied().collect();
    sort::numbers32(&mut faces);
    faces.dedup();
    let place = |face: u32| faces.partition_point(|known| *known < face) as u32;
    let mut sets = UnionFind::new(faces.len());
    for [one, other] in pairs {
        sets.join(place(one), place(other));
    }
    let mut groups: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (place, face) in (0..).zip(&faces) {
        groups.entry(sets.root(place)).or_default().push(*face);
    }
    groups.into_values().collect()
}

/// Returns the areas of faces of one plane; `None` if it was aborted.
fn areas_of(
    surface: &Surface<'_>,
    faces: &[u32],
    grid: &Grid,
    gives_up: &dyn Fn(usize) -> bool,
) -> Option<Vec<IntersectionArea>> {
    let plane = surface.plane(faces[0]);
    let axis = plane.main_axis();
    let mut segments: Vec<PlaneSegment> = Vec::new();
    for &face in faces {
        surface.edges(face, axis, |segment| segments.push(segment));
    }
    // Orientation of each body's face at a sample.
    let sides = |sample: &SamplePoint<'_>| -> Option<[bool; 2]> {
        let mut sides = [None; 2];
        surface.each_at(sample, |face| {
            let is_there = faces.binary_search(&face).is_ok() && surface.meets(sample, face);
            if is_there {
                sides[surface.operand(face)] = Some(surface.plane(face).normal[axis] > 0);
            }
        });
        Some([sides[0]?, sides[1]?])
    };
    let choose = |region: &PlaneRegion| sides(&SamplePoint::of_region(plane, region));
    let found = regions(plane, &segments, &[], gives_up, choose)?;
    let area = |(region, [is_up, other_is_up]): (PlaneRegion, [bool; 2])| {
        let ring = |corners: &Vec<Corner>| {
            // (Rings are oriented as seen from the axis's positive end.)
            let mut ring: Vec<[f64; 3]> = corners.iter().map(|corner| corner.point.to_world(grid)).collect();
            if !is_up {
                ring.reverse();
            }
            ring.extend(ring.first().copied());
            ring
        };
        let rings: Vec<Vec<[f64; 3]>> = region.rings.iter().map(ring).collect();
        let polygon = SectionPolygon { area: size(&rings), rings, part: None };
        IntersectionArea { polygon, is_same_side: is_up == other_is_up }
    };
    Some(found.into_iter().map(area).collect())
}

/// Returns the area of a planar polygon with holes.
fn size(rings: &[Vec<[f64; 3]>]) -> f64 {
    let base = rings[0][0];
    let mut sum = [0.0; 3];
    for ends in rings.iter().flat_map(|ring| ring.windows(2)) {
        let [a, b] = [0, 1].map(|end| subtract(ends[end], base));
        sum.iter_mut().zip(cross(a, b)).for_each(|(sum, own)| *sum += own);
    }
    sum.iter().map(|part| part * part).sum::<f64>().sqrt() / 2.0
}
