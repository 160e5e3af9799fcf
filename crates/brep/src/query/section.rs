//! Sections: intersections of planes and a body, as polygons with holes.
//!
//! Each vertex of the surface is classified as above or below a plane, and faces are cut on their
//! edges from one to the other. Since only vertices are classified, neighbouring faces are cut at
//! the same points. So the section of a closed surface is closed, whatever is in the plane or
//! touches it. A vertex in the plane counts as above it: a section is that just below the plane.

use std::collections::{BTreeMap, HashSet};

use super::plane::Plane;
use super::simple_rings::simple_rings;
use super::visited::half_of;
use crate::exact::vector::{cross, dot};
use crate::{ExactModel, Face, FaceBuffer, Faces, Grid, ModelNode, ModelNodeState, format_position};
use spinney_base::io::batch::{defer_missing, finish_deferred, run_batched};
use spinney_base::{Error, Progress, Result, parallel, sort};

/// A plane of the world: the points whose dot product with the normal is `distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CuttingPlane {
    /// A vector perpendicular to the plane, of any length. Sections are seen from the side that it
    /// points to.
    pub normal: [f64; 3],
    /// The dot product of the normal and each point of the plane.
    pub distance: f64,
}

impl CuttingPlane {
    /// Creates the plane of all points with a coordinate along an axis (0 to 2).
    ///
    /// # Panics
    /// If there is no such axis.
    pub fn across(axis: usize, at: f64) -> CuttingPlane {
        let mut normal = [0.0; 3];
        normal[axis] = 1.0;
        CuttingPlane { normal, distance: at }
    }

    /// Returns two unit vectors in the plane, counterclockwise as seen from the normal's side: y
    /// and z for a plane across x, z and x across y, x and y across z.
    pub fn axes(&self) -> [[f64; 3]; 2] {
        let normal = unit(self.normal);
        // The axis after the normal's main axis is at a sufficient angle to the normal.
        let main = (0..3).max_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(2);
        let mut first = [0.0; 3];
        first[(main + 1) % 3] = 1.0;
        let along = dot(first, normal);
        let first = unit([0, 1, 2].map(|axis| first[axis] - along * normal[axis]));
        [first, cross(normal, first)]
    }
}

/// A polygon with holes in a plane.
#[derive(Clone, Debug, PartialEq)]
pub struct SectionPolygon {
    /// Rings in the world, the outer one first, which end with their first point. Seen from the
    /// normal's side, the outer ring is counterclockwise, and holes are clockwise.
    pub rings: Vec<Vec<[f64; 3]>>,
    /// Its area, without that of the holes.
    pub area: f64,
    /// Number of the part that was cut, if parts were cut one by one.
    pub part: Option<u32>,
}

impl ExactModel {
    /// Cuts the body by a plane. Points are computed in double precision. The section is that just
    /// below the plane, which matters for faces in the plane: a body that ends there from below is
    /// included, one that begins there is not. Of models with off-grid vertices, the proxies are
    /// cut. Takes time and memory proportional to the length of the outlines, whose faces are found
    /// by the octree.
    ///
    /// ```
    /// use spinney::ExactModel;
    /// use spinney::brep::CuttingPlane;
    /// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
    /// # use spinney::Output;
    /// # let directory = tempfile::tempdir().unwrap();
    /// # let [mesh, path] = ["tetrahedron.off", "tetrahedron.goblin"].map(|name| directory.path().join(name));
    /// # let text = "OFF\n4 4 0\n0 0 0\n6 0 0\n0 6 0\n0 0 6\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    /// # std::fs::write(&mesh, text).unwrap();
    /// # import_exact(open_all(&[mesh], 64 << 20)?, &ExactOptions::new(), Output::create(&path)?, &())?;
    /// // The corner of a cube, cut at half of its height.
    /// let model = ExactModel::open(&path, &Default::default())?;
    /// let found = model.section(&CuttingPlane::across(2, 3.0), &())?;
    /// assert_eq!((found.len(), found[0].area), (1, 4.5));
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the plane is invalid, the body is unbounded, the surface is not closed there, the file is
    /// corrupt or cannot be read, or on cancellation.
    pub fn section(&self, plane: &CuttingPlane, progress: &dyn Progress) -> Result<Vec<SectionPolygon>> {
        self.check_plane(plane)?;
        let mut found = self.cut(plane.normal, &[plane.distance], false, progress)?;
        Ok(found.pop().unwrap_or_default())
    }

    /// Fails if the plane is invalid or the body has no bounded sections.
    fn check_plane(&self, plane: &CuttingPlane) -> Result<()> {
        let length = dot(plane.normal, plane.normal).sqrt();
        if !(length.is_normal() && plane.distance.is_finite()) {
            let found = format!("normal {:?}, distance {}", plane.normal, plane.distance);
            return Err(Error::invalid("plane", found, "finite numbers, and a normal that is not zero"));
        }
        if self.is_unbounded() {
            let advice =
                "section its complement instead (`spinney combine not`), which has the same outlines";
            return Err(Error::unsupported(self.path(), "a section of an unbounded body", advice));
        }
        Ok(())
    }

    /// Cuts the body, or each of its parts, by parallel planes with ascending distances.
    fn cut(
        &self,
        normal: [f64; 3],
        distances: &[f64],
        by_part: bool,
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<SectionPolygon>>> {
        let cuts = run_batched(|| {
            let empty = PlaneCut::new(self.grid(), normal, distances);
            let mut cuts = PartCuts { empty, by_part, of_parts: BTreeMap::new() };
            let (known, buffer) = (HashSet::new(), FaceBuffer::default());
            SectionTraversal { model: self, progress, cuts: &mut cuts, known, buffer }.node(&self.root()?)?;
            Ok(cuts)
        })?;
        let world = |point: &[f64; 3]| self.grid().to_world_between(*point);
        let mut found = vec![Vec::new(); distances.len()];
        for (part, mut cut) in cuts.of_parts {
            for (plane, distance) in distances.iter().enumerate() {
                progress.check()?;
                let rings = cut.rings(plane).map_err(|end| {
                    let at = format!("it ends at {}", format_position(world(&end)));
                    self.open_outline(at, by_part.then_some(part))
                })?;
                let of_plane = CuttingPlane { normal, distance: *distance };
                let rings = simple_rings(rings, of_plane.axes());
                let rings = rings.into_iter().map(|ring| ring.iter().map(world).collect());
                found[plane].extend(polygons(rings, &of_plane, by_part.then_some(part)));
            }
        }
        Ok(found)
    }

    /// Returns the error for an outline that is not closed, of the body or of one of its parts.
    fn open_outline(&self, at: String, part: Option<u32>) -> Error {
        let name = part.and_then(|part| self.parts().get(part as usize));
        let (what, advice) = match name {
            None => (
                "the outline of the section is open, so the surface is not closed".into(),
                "find the cause with `spinney verify`, and build the model again",
            ),
            Some(name) => (
                format!("the outline of the section of `{name}` is open, so the object is not closed"),
                "cut the model as a whole",
            ),
        };
        let path = self.path().to_path_buf();
        Error::NotASolid { path, what, locations: vec![at], count: 1, advice: advice.into() }
    }
}

/// Receives the polygons of each plane, with the plane's index.
pub type SectionVisitor<'a> = dyn FnMut(usize, &[SectionPolygon]) -> Result<()> + 'a;

impl ExactModel {
    /// Cuts the body, or each of its parts (`by_part`), by many parallel planes of ascending
    /// distances, and visits the polygons of each plane in order, those of parts by number. Works
    /// as [`ExactModel::section`], on all threads of the current pool, with the sections of 256
    /// planes in memory.
    ///
    /// # Errors
    /// The errors of [`ExactModel::section`], descending distances, and the errors of `each`.
    pub fn plane_sections(
        &self,
        normal: [f64; 3],
        distances: &mut dyn ExactSizeIterator<Item = f64>,
        by_part: bool,
        progress: &dyn Progress,
        each: &mut SectionVisitor<'_>,
    ) -> Result<()> {
        /// Planes per task, and per batch.
        const TASK: usize = 64;
        const BATCH: usize = 4 * TASK;
        let total = distances.len() as u64;
        let (mut first, mut last) = (0, f64::NEG_INFINITY);
        loop {
            let batch: Vec<f64> = distances.take(BATCH).collect();
            let Some(end) = batch.last().copied() else { return Ok(()) };
            for distance in &batch {
                self.check_plane(&CuttingPlane { normal, distance: *distance })?;
            }
            if batch[0] < last || !batch.is_sorted() {
                return Err(Error::invalid("distances of planes", format!("{batch:?}"), "ascending numbers"));
            }
            last = end;
            let tasks: Vec<&[f64]> = batch.chunks(TASK).collect();
            let found = parallel::map(&tasks, |distances| self.cut(normal, distances, by_part, progress));
            for polygons in found {
                for polygons in polygons? {
                    progress.check()?;
                    each(first, &polygons)?;
                    first += 1;
                }
            }
            progress.advance(batch.len() as u64, total);
        }
    }
}

struct SectionTraversal<'a> {
    model: &'a ExactModel,
    progress: &'a dyn Progress,
    cuts: &'a mut PartCuts,
    /// Faces that were cut: large ones are in many leaves.
    known: HashSet<u64>,
    buffer: FaceBuffer,
}

impl SectionTraversal<'_> {
    fn node(&mut self, node: &ModelNode<'_>) -> Result<()> {
        let mut is_unread = false;
        match node.state() {
            ModelNodeState::Void | ModelNodeState::Full => {}
            ModelNodeState::Inner => {
                self.progress.check()?;
                let bounds = node.bounds(self.model.grid());
                for child in 0..8 {
                    if self.cuts.empty.may_meet(&half_of(&bounds, child)) {
                        let child = self.model.child(node, child);
                        defer_missing(child.and_then(|child| self.node(&child)), &mut is_unread)?;
                    }
                }
            }
            ModelNodeState::Leaf { .. } => {
                for number in node.faces() {
                    if self.known.insert(number) {
                        let read = self.model.face(number, &mut self.buffer);
                        if defer_missing(read, &mut is_unread)?.is_some() {
                            let face = self.buffer.face();
                            self.cuts.of_part(face.part).face(&face);
                        }
                    }
                }
            }
        }
        finish_deferred(is_unread)
    }
}

/// An edge between two grid points, the smaller one first. Each point is packed into one integer,
/// so that a comparison is a single operation.
type Edge = [u128; 2];

fn packed([x, y, z]: [i32; 3]) -> u128 {
    u128::from(x as u32) << 64 | u128::from(y as u32) << 32 | u128::from(z as u32)
}

fn unpacked(point: u128) -> [i32; 3] {
    [(point >> 64) as u32 as i32, (point >> 32) as u32 as i32, point as u32 as i32]
}

/// Cuts of the body, or of each of its parts.
struct PartCuts {
    /// A cut without segments.
    empty: PlaneCut,
    by_part: bool,
    /// By part number; that of the body has the number 0.
    of_parts: BTreeMap<u32, PlaneCut>,
}

impl PartCuts {
    fn of_part(&mut self, part: u32) -> &mut PlaneCut {
        let number = if self.by_part { part } else { 0 };
        self.of_parts.entry(number).or_insert_with(|| self.empty.clone())
    }
}

/// The cut of a surface by parallel planes, face by face, on the grid.
#[derive(Clone)]
struct PlaneCut {
    normal: [f64; 3],
    /// Distance of each plane, in grid units times the normal's length; ascending.
    distances: Vec<f64>,
    /// Segments in each plane: the edges from and to which they lead.
    segments: Vec<Vec<[Edge; 2]>>,
    /// Heights of the vertices of a face.
    heights: Vec<f64>,
}

impl PlaneCut {
    fn new(grid: &Grid, normal: [f64; 3], distances: &[f64]) -> PlaneCut {
        // World coordinates are the origin plus grid coordinates times the step's width.
        let origin = dot(normal, grid.to_world_between([0.0; 3]));
        let distances: Vec<f64> =
            distances.iter().map(|distance| (distance - origin) / grid.width()).collect();
        let segments = vec![Vec::new(); distances.len()];
        PlaneCut { normal, distances, segments, heights: Vec::new() }
    }

    fn height(&self, point: [i32; 3]) -> f64 {
        dot(self.normal, point.map(f64::from))
    }

    /// Returns the planes that may have points between two heights.
    fn planes(&self, low: f64, high: f64) -> std::ops::Range<usize> {
        let first = self.distances.partition_point(|distance| *distance < low);
        let count = self.distances[first..].partition_point(|distance| *distance <= high);
        first..first + count
    }

    /// Returns whether a plane may intersect a box in half grid units.
    fn may_meet(&self, [low, high]: &[[i64; 3]; 2]) -> bool {
        let middle = dot(self.normal, [0, 1, 2].map(|axis| (low[axis] + high[axis]) as f64 / 4.0));
        // (Extended by a grid unit for rounding errors.)
        let reach =
            (0..3).map(|axis| self.normal[axis].abs() * ((high[axis] - low[axis]) as f64 / 4.0 + 1.0));
        let reach = reach.sum::<f64>();
        !self.planes(middle - reach, middle + reach).is_empty()
    }

    fn face(&mut self, face: &Face<'_>) {
        let mut heights = std::mem::take(&mut self.heights);
        heights.clear();
        heights.extend(face.points.iter().map(|point| self.height(*point)));
        let (low, high) = heights
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(*at), high.max(*at)));
        for plane in self.planes(low, high) {
            self.add_segments(plane, face, &heights);
        }
        self.heights = heights;
    }

    /// Adds the segments of a face in a plane.
    fn add_segments(&mut self, plane: usize, face: &Face<'_>, heights: &[f64]) {
        let is_above = |corner: usize| heights[corner] >= self.distances[plane];
        // Downward and upward edges. The face is between each edge and the next one of the other
        // kind.
        let mut crossed: [Vec<Edge>; 2] = Default::default();
        let mut start = 0;
        for &end in face.ring_ends {
            for from in start..end {
                let to = if from + 1 == end { start } else { from + 1 };
                if is_above(from) != is_above(to) {
                    let ends = [face.points[from], face.points[to]].map(packed);
                    crossed[usize::from(is_above(to))].push([ends[0].min(ends[1]), ends[0].max(ends[1])]);
                }
            }
            start = end;
        }
        if crossed[0].len() > 1 {
            let normal = Plane::of(face).normal.map(|part| part as f64);
            let along = cross(self.normal, normal);
            for edges in &mut crossed {
                let place = |edge: &Edge| dot(along, self.point(plane, edge));
                sort::by_key(edges, |edge| sort::float_key(place(edge)));
            }
        }
        let [down, up] = crossed;
        self.segments[plane].extend(down.into_iter().zip(up).map(|(from, to)| [from, to]));
    }

    /// Returns the point of an edge in a plane: the same for all faces with the edge.
    fn point(&self, plane: usize, edge: &Edge) -> [f64; 3] {
        let [from, to] = edge.map(unpacked);
        let [a, b] = [from, to].map(|point| self.height(point) - self.distances[plane]);
        let share = a / (a - b);
        [0, 1, 2].map(|axis| f64::from(from[axis]) + f64::from(to[axis] - from[axis]) * share)
    }

    /// Returns the rings of a plane's segments; each ends with its first point. If they are not
    /// closed, the error is the end of an open line.
    fn rings(&mut self, plane: usize) -> Result<Vec<Vec<[f64; 3]>>, [f64; 3]> {
        let mut segments = SectionSegments::of(std::mem::take(&mut self.segments[plane]));
        let mut rings = Vec::new();
        // Lines that end at edges whose other face has no area, and is in no leaf.
        let mut open: Vec<Vec<[f64; 3]>> = Vec::new();
        for start in segments.starts() {
            while let Some(mut next) = segments.take(&start) {
                let mut line = vec![self.point(plane, &start), self.point(plane, &next)];
                while next != start
                    && let Some(after) = segments.take(&next)
                {
                    next = after;
                    line.push(self.point(plane, &next));
                }
                if next == start { &mut rings } else { &mut open }.push(line);
            }
        }
        rings.extend(joined(open)?);
        rings.iter_mut().for_each(|ring| ring.dedup());
        rings.retain(|ring| ring.len() > 3);
        Ok(rings)
    }
}

/// Segments, sorted by the edge that they lead from; some are removed.
struct SectionSegments {
    list: Vec<[Edge; 2]>,
    /// At the first segment from an edge: number of removed segments from that edge.
    taken: Vec<usize>,
}

impl SectionSegments {
    fn of(mut list: Vec<[Edge; 2]>) -> SectionSegments {
        sort::by(&mut list, &mut Ord::cmp);
        SectionSegments { taken: vec![0; list.len()], list }
    }

    /// Returns the edges to begin at: first those that no segment leads to, then all others.
    fn starts(&self) -> Vec<Edge> {
        let mut ends: Vec<Edge> = self.list.iter().map(|[_, to]| *to).collect();
        sort::by(&mut ends, &mut Ord::cmp);
        let (mut first, mut others) = (Vec::new(), Vec::new());
        for same in self.list.chunk_by(|a, b| a[0] == b[0]) {
            let edge = same[0][0];
            let led = ends.partition_point(|end| *end <= edge) - ends.partition_point(|end| *end < edge);
            if same.len() > led { &mut first } else { &mut others }.push(edge);
        }
        first.append(&mut others);
        first
    }

    /// Removes a segment that leads from an edge; returns the edge that it leads to.
    fn take(&mut self, from: &Edge) -> Option<Edge> {
        let first = self.list.partition_point(|[start, _]| start < from);
        let taken = self.taken.get_mut(first)?;
        let [_, to] = self.list.get(first + *taken).filter(|[start, _]| start == from)?;
        *taken += 1;
        Some(*to)
    }
}

/// Joins lines whose ends coincide, with some tolerance, to rings. The error is the end of a line
/// where no other begins.
fn joined(lines: Vec<Vec<[f64; 3]>>) -> Result<Vec<Vec<[f64; 3]>>, [f64; 3]> {
    /// Points may be apart by about this fraction of a grid unit.
    const FINE: f64 = 1024.0;
    let place = |point: &[f64; 3]| point.map(|at| (at * FINE).round() as i64);
    let mut starts: BTreeMap<[i64; 3], Vec<Vec<[f64; 3]>>> = BTreeMap::new();
    for line in lines {
        starts.entry(place(&line[0])).or_default().push(line);
    }
    let mut rings = Vec::new();
    while let Some(mut entry) = starts.first_entry() {
        let Some(mut line) = entry.get_mut().pop() else {
            entry.remove();
            continue;
        };
        let begin = place(&line[0]);
        loop {
            let [x, y, z] = place(&line[line.len() - 1]);
            if (0..3).all(|axis| ([x, y, z][axis] - begin[axis]).abs() <= 1) {
                break;
            }
            let mut near = (0..27).map(|step| [x + step % 3 - 1, y + step / 3 % 3 - 1, z + step / 9 - 1]);
            match near.find_map(|at| starts.get_mut(&at)?.pop()) {
                Some(next) => line.extend(next),
                None => return Err(line[line.len() - 1]),
            }
        }
        line.push(line[0]);
        rings.push(line);
    }
    Ok(rings)
}

/// Combines rings of a plane to polygons.
fn polygons(
    rings: impl Iterator<Item = Vec<[f64; 3]>>,
    plane: &CuttingPlane,
    part: Option<u32>,
) -> Vec<SectionPolygon> {
    let [u, v] = plane.axes();
    let flat = |point: &[f64; 3]| [dot(u, *point), dot(v, *point)];
    let (mut outer, mut holes) = (Vec::new(), Vec::new());
    for ring in rings {
        let points: Vec<[f64; 2]> = ring.iter().map(flat).collect();
        let area = area(&points);
        let ring = FlatRing { bounds: bounds(&points), points, ring, area };
        if area > 0.0 { outer.push(ring) } else { holes.push(ring) }
    }
    // Of several rings around a hole, the smallest is its outer ring.
    sort::by_key(&mut outer, |ring| sort::float_key(ring.area));
    let mut found: Vec<SectionPolygon> = outer
        .iter()
        .map(|outer| SectionPolygon { rings: vec![outer.ring.clone()], area: outer.area, part })
        .collect();
    for hole in holes {
        let first = outer.partition_point(|outer| outer.area < -hole.area);
        if let Some(place) = (first..outer.len()).find(|place| outer[*place].is_around(&hole)) {
            found[place].area += hole.area;
            found[place].rings.push(hole.ring);
        }
    }
    found
}

/// A ring, in the world and in the plane.
struct FlatRing {
    points: Vec<[f64; 2]>,
    ring: Vec<[f64; 3]>,
    /// Positive if counterclockwise.
    area: f64,
    /// Minimum and maximum coordinates.
    bounds: [[f64; 2]; 2],
}

impl FlatRing {
    /// Returns whether another ring, which may touch this one in points, is inside: tests the
    /// midpoints of some of its edges.
    fn is_around(&self, other: &FlatRing) -> bool {
        /// Number of tested edges: an odd number.
        const EDGES: usize = 5;
        let middle = |ends: &[[f64; 2]]| [0, 1].map(|axis| ends[0][axis].midpoint(ends[1][axis]));
        let count = (other.points.len() - 1).min(EDGES);
        let inside = other.points.windows(2).take(count).filter(|ends| self.has(middle(ends))).count();
        2 * inside > count
    }

    /// Returns whether a point is inside, by the even-odd rule.
    fn has(&self, [x, y]: [f64; 2]) -> bool {
        let [low, high] = self.bounds;
        if x < low[0] || x > high[0] || y < low[1] || y > high[1] {
            return false;
        }
        let mut inside = false;
        for ends in self.points.windows(2) {
            let [a, b] = [ends[0], ends[1]];
            if (a[1] > y) != (b[1] > y) {
                inside ^= a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) > x;
            }
        }
        inside
    }
}

/// Returns the area of a closed ring, positive if counterclockwise. (Relative to its first point,
/// to limit rounding errors.)
fn area(points: &[[f64; 2]]) -> f64 {
    let Some(origin) = points.first() else { return 0.0 };
    let to = |point: &[f64; 2]| [point[0] - origin[0], point[1] - origin[1]];
    let twice = points.windows(2).map(|ends| {
        let (a, b) = (to(&ends[0]), to(&ends[1]));
        a[0] * b[1] - a[1] * b[0]
    });
    twice.sum::<f64>() / 2.0
}

fn bounds(points: &[[f64; 2]]) -> [[f64; 2]; 2] {
    points.iter().fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[low, high], [x, y]| {
        [[low[0].min(*x), low[1].min(*y)], [high[0].max(*x), high[1].max(*y)]]
    })
}

fn unit(vector: [f64; 3]) -> [f64; 3] {
    let length = dot(vector, vector).sqrt();
    vector.map(|part| part / length)
}
