//! Segments that two surfaces have in common, each once, with the adjacent faces.

use std::collections::{HashMap, HashSet};

use super::around::{HalfPlane, SegmentAxis};
use crate::arrangement::{Contact, ExactPoint, Surface, Vertices};
use crate::boxes::touch;
use crate::exact::bounds::MARGIN;
use spinney_base::{Progress, Result, parallel, sort};

/// A segment between two vertices.
pub(super) struct CommonSegment {
    /// Its ends. Where surfaces intersect, what is left of the segment on the first surface is
    /// inside of the second body.
    pub(super) vertices: [u32; 2],
    /// Whether the surfaces intersect there.
    pub(super) is_crossing: bool,
    /// Of the first and the second body: the faces to the left and to the right.
    pub(super) faces: [[u32; 2]; 2],
}

/// All segments.
pub(super) struct Segments {
    pub(super) list: Vec<CommonSegment>,
    /// Ends of segments, also of those that only bound areas.
    pub(super) vertices: Vertices,
}

/// A segment that two faces have in common.
struct PairSegment {
    faces: [u32; 2],
    /// Its ends, in the direction of the line of both planes, and between them the vertices that
    /// divide it.
    points: Vec<ExactPoint>,
    /// Whether it runs along an edge of one of the faces, instead of crossing both.
    is_along_edge: bool,
}

impl Segments {
    /// Collects the segments of contacts.
    ///
    /// # Errors
    /// On cancellation.
    pub(super) fn of(
        surface: &Surface<'_>,
        contacts: &[Contact],
        progress: &dyn Progress,
    ) -> Result<Segments> {
        const TASK: usize = 1 << 8;
        let mut found = Segments { list: Vec::new(), vertices: Vertices::default() };
        let mut known: HashSet<[u32; 2]> = HashSet::new();
        let tasks: Vec<&[Contact]> = contacts.chunks(TASK).collect();
        for tasks in tasks.chunks(64) {
            progress.check()?;
            let parts = parallel::map(tasks, |contacts| {
                contacts.iter().flat_map(|contact| segments_of(surface, contact)).collect::<Vec<_>>()
            });
            for PairSegment { faces, points, is_along_edge } in parts.into_iter().flatten() {
                for ends in points.windows(2) {
                    let [one, other] = [ends[0], ends[1]].map(|end| found.vertices.number(end));
                    // Invariant: the list has each segment once for each time that surfaces meet
                    // there. If it crosses both faces, no other pair of faces has it. If it runs
                    // along an edge, several pairs have it. Each pair divides it at the vertices of
                    // all faces there, so it has the same ends, and duplicates are detected. With a
                    // duplicate, a line would return along the same segment.
                    if !is_along_edge {
                        let faces = faces.map(|face| [face; 2]);
                        found.list.push(CommonSegment { vertices: [one, other], is_crossing: true, faces });
                    } else if known.insert([one.min(other), one.max(other)]) {
                        found.add_along_edge(surface, faces, [one, other], [&ends[0], &ends[1]]);
                    }
                }
            }
        }
        found.cancel();
        Ok(found)
    }

    /// Removes pairs of crossing segments in opposite directions. They cross two coincident walls
    /// of a body, and bound nothing.
    fn cancel(&mut self) {
        let mut open: HashMap<[u32; 2], Vec<usize>> = HashMap::new();
        let mut is_gone = vec![false; self.list.len()];
        for (number, segment) in self.list.iter().enumerate().filter(|(_, segment)| segment.is_crossing) {
            let [from, to] = segment.vertices;
            if let Some(opposite) = open.get_mut(&[to, from]).and_then(Vec::pop) {
                is_gone[opposite] = true;
                is_gone[number] = true;
            } else {
                open.entry([from, to]).or_default().push(number);
            }
        }
        let mut is_gone = is_gone.into_iter();
        self.list.retain(|_| is_gone.next() != Some(true));
    }

    /// Adds a segment along edges. Chooses its direction.
    fn add_along_edge(
        &mut self,
        surface: &Surface<'_>,
        faces: [u32; 2],
        vertices: [u32; 2],
        ends: [&ExactPoint; 2],
    ) {
        let axis = SegmentAxis::of(surface, faces);
        let mut around: [Vec<HalfPlane>; 2] = [Vec::new(), Vec::new()];
        for face in faces_at(surface, ends) {
            around[surface.operand(face)].extend(axis.half_planes(surface, face, ends));
        }
        let (crossings, is_on) = axis.crossings(&around[0], &around[1]);
        if crossings == 0 && is_on {
            return;
        }
        let mut sides = [0, 1].map(|body| {
            let on = |is_left: bool| around[body].iter().filter(move |half| half.is_left == is_left);
            [true, false].map(|is_left| on(is_left).map(|half| half.face).min().unwrap_or(faces[body]))
        });
        let mut vertices = vertices;
        if crossings < 0 {
            vertices.reverse();
            sides.iter_mut().for_each(|sides| sides.reverse());
        }
        // (Where more than two faces share an edge, a line may pass it more than once.)
        for _ in 0..crossings.abs().max(1) {
            self.list.push(CommonSegment { vertices, is_crossing: crossings != 0, faces: sides });
        }
    }

    /// Returns points of contacts that are not vertices of segments, each once, with the first two
    /// faces that have it.
    pub(super) fn lone_points(&mut self, contacts: &[Contact]) -> Vec<(ExactPoint, [u32; 2])> {
        let mut lone = Vec::new();
        for contact in contacts {
            for point in &contact.points {
                let known = self.vertices.list().len();
                if self.vertices.number(*point) as usize == known {
                    lone.push((*point, contact.faces));
                }
            }
        }
        lone
    }
}

/// Returns the segments of a contact.
fn segments_of(surface: &Surface<'_>, contact: &Contact) -> Vec<PairSegment> {
    let faces = contact.faces;
    let axis = SegmentAxis::of(surface, faces);
    let segment = |ends: &[ExactPoint; 2]| {
        let mut ends = *ends;
        if axis.order(&ends[0], &ends[1]).is_gt() {
            ends.reverse();
        }
        let mut points = ends.to_vec();
        let is_along_edge = faces.iter().any(|face| has_on_edge(surface, *face, &ends));
        if is_along_edge {
            for face in faces_at(surface, [&ends[0], &ends[1]]) {
                let polygon = surface.polygon(face);
                points.extend(polygon.corners.iter().map(|corner| corner.point).filter(|point| {
                    let is_on_line = || faces.iter().all(|face| surface.plane(*face).side(point) == 0);
                    axis.order(&ends[0], point).is_lt() && axis.order(point, &ends[1]).is_lt() && is_on_line()
                }));
            }
            sort::by(&mut points, &mut |a, b| axis.order(a, b));
            points.dedup_by(|a, b| axis.order(a, b).is_eq());
        }
        PairSegment { faces, points, is_along_edge }
    };
    contact.segments.iter().map(segment).collect()
}

/// Whether a segment runs along an edge of a face.
fn has_on_edge(surface: &Surface<'_>, face: u32, ends: &[ExactPoint; 2]) -> bool {
    let mut is_on = false;
    surface.edges(face, surface.plane(face).main_axis(), |edge| {
        is_on |= ends.iter().all(|end| edge.line.side(end) == 0);
    });
    is_on
}

/// Returns the faces of both bodies whose boxes touch a segment and whose planes contain it.
fn faces_at(surface: &Surface<'_>, ends: [&ExactPoint; 2]) -> Vec<u32> {
    let bound = |least: bool| {
        [0, 1, 2].map(|axis| {
            let [a, b] = ends.map(|end| end.near[axis]);
            if least { (a.min(b) - MARGIN).floor() as i32 } else { (a.max(b) + MARGIN).ceil() as i32 }
        })
    };
    let around = [bound(true), bound(false)];
    let mut found = Vec::new();
    surface.boxes().each(&|bounds| touch(bounds, &around), |face| {
        if ends.iter().all(|end| surface.plane(face).side(end) == 0) {
            found.push(face);
        }
    });
    sort::numbers32(&mut found);
    found
}
