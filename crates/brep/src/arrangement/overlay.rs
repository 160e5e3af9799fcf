//! The regions into which segments divide a face's plane: a planar subdivision over exact points.
//!
//! Segments are cut where they meet. Edges with the same region on both sides are removed. The
//! remaining edges form loops, which are traced with the region to the left. Holes are assigned to
//! the loops around them.

use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};

use super::point::{ExactPlane, ExactPoint};
use crate::exact::bounds::MARGIN;
use crate::exact::union_find::UnionFind;
use crate::exact::vector::others;
use spinney_base::sort;

/// A segment in a face's plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlaneSegment {
    pub(crate) ends: [ExactPoint; 2],
    /// A second plane that contains the segment.
    pub(crate) line: ExactPlane,
}

/// A vertex of a ring.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Corner {
    pub(crate) point: ExactPoint,
    /// A second plane that contains the edge to the next vertex.
    pub(crate) line: ExactPlane,
}

/// A region. Seen from the positive end of the main axis, the outer ring is counterclockwise, and
/// holes are clockwise. The region lies to the left of all rings.
#[derive(Clone, Debug)]
pub(crate) struct PlaneRegion {
    /// Vertices of each ring, the outer ring first.
    pub(crate) rings: Vec<Vec<Corner>>,
}

/// Divides a plane by segments, and segments at points on them. Returns the bounded regions for
/// which `choose` returns a value, with that value. Adjacent regions with equal values are merged.
/// Returns `None` if `gives_up` returns true. It is called repeatedly with the vertex count, since
/// the work may be quadratic in the number of segments.
pub(crate) fn regions<T: PartialEq + Copy>(
    plane: &ExactPlane,
    segments: &[PlaneSegment],
    points: &[ExactPoint],
    gives_up: &dyn Fn(usize) -> bool,
    choose: impl Fn(&PlaneRegion) -> Option<T>,
) -> Option<Vec<(PlaneRegion, T)>> {
    let mut overlay = Overlay::new(plane);
    for segment in segments {
        overlay.add(segment);
    }
    let points: Vec<u32> = points.iter().map(|point| overlay.vertices.number(*point)).collect();
    if !overlay.cut(&points, gives_up) {
        return None;
    }
    overlay.edges();
    let loops = Loops::of(&overlay);
    // Invariant: each remaining edge has different loops on its two sides: edges that end inside a
    // region, or connect two rings, are gone. So no ring passes an edge twice, each ring has an
    // area, and its minimum vertex is strictly convex, as samples of regions require.
    overlay.leave_out(|half| loops.of_half[half]);
    let loops = Loops::of(&overlay);
    let outer = overlay.outer_loops(&loops);
    let chosen: Vec<Option<T>> =
        overlay.regions(&loops, &outer).iter().map(|region| choose(region.as_ref()?)).collect();
    let of_half = |half: usize| outer[loops.of_half[half] as usize].and_then(|outer| chosen[outer]);
    let kept: Vec<[Option<T>; 2]> = (0..overlay.edges.len())
        .map(|edge| [2 * edge, 2 * edge + 1].map(of_half))
        .filter(|[left, right]| left != right)
        .collect();
    overlay.leave_out(of_half);
    let loops = Loops::of(&overlay);
    let outer = overlay.outer_loops(&loops);
    let regions = overlay.regions(&loops, &outer);
    let found = regions.into_iter().zip(&loops.list).filter_map(|(region, list)| {
        let half = list.halves[0] as usize;
        Some((region?, kept[half / 2][half % 2]?))
    });
    Some(found.collect())
}

/// Distinct points.
#[derive(Default)]
pub(crate) struct Vertices {
    list: Vec<ExactPoint>,
    /// Numbers of the points in each cell of a lattice. Its cells are much larger than the error of
    /// approximations.
    cells: HashMap<[i64; 3], Vec<u32>>,
}

/// A point as a key: grid coordinates and 0, or rounded coordinates and a number above 0 if it is
/// off the grid.
pub(crate) type VertexKey = ([i32; 3], u32);

impl Vertices {
    /// Returns the points in the order of their numbers.
    pub(crate) fn list(&self) -> &[ExactPoint] {
        &self.list
    }

    /// Returns the key of a point. Equal points have equal keys.
    pub(crate) fn key(&mut self, point: &ExactPoint) -> VertexKey {
        match point.on_grid() {
            Some(at) => (at, 0),
            None => (point.rounded(), self.number(*point) + 1),
        }
    }

    /// Returns the number of a point.
    pub(crate) fn number(&mut self, point: ExactPoint) -> u32 {
        /// Cells per grid unit.
        const FINE: f64 = 1024.0;
        const { assert!(MARGIN * FINE < 0.5, "two cells along an axis are enough") };
        let cell = |shift: f64| point.near.map(|at| (at * FINE + shift).floor() as i64);
        // Near a cell wall, another approximation of the same point may be in the next cell.
        // Invariant: a point has one number, however it was computed. Two of its approximations
        // differ by less than the margin. So the cell in which it was entered is among the cells
        // searched here; exact coordinates decide. If a point had two numbers, lines that meet
        // there would be cut at different vertices, and rings would not close.
        let (low, high) = (cell(-MARGIN * FINE), cell(MARGIN * FINE));
        if low == high {
            let known = self.cells.entry(low).or_default();
            return match known.iter().find(|known| self.list[**known as usize].is(&point)) {
                Some(found) => *found,
                None => {
                    let number = self.list.len() as u32;
                    known.push(number);
                    self.list.push(point);
                    number
                }
            };
        }
        let mut candidates = [low; 8];
        for (corner, candidate) in candidates.iter_mut().enumerate() {
            for axis in 0..3 {
                candidate[axis] = if corner >> axis & 1 == 1 { high[axis] } else { low[axis] };
            }
        }
        for (index, candidate) in candidates.iter().enumerate() {
            if candidates[..index].contains(candidate) {
                continue;
            }
            let known = self.cells.get(candidate).into_iter().flatten();
            if let Some(found) = known.copied().find(|known| self.list[*known as usize].is(&point)) {
                return found;
            }
        }
        let number = self.list.len() as u32;
        self.list.push(point);
        self.cells.entry(cell(0.0)).or_default().push(number);
        number
    }
}

/// A segment with the vertices on it.
struct Line {
    plane: ExactPlane,
    /// Side of the plane, 1 or -1, that is to the left in the direction of increasing coordinates.
    left: i32,
    /// The two ends first.
    vertices: Vec<u32>,
    bounds: [[f64; 2]; 2],
}

/// An edge of the subdivision, from the vertex with smaller coordinates to the other.
#[derive(Clone, Copy)]
struct Edge {
    ends: [u32; 2],
    line: u32,
}

struct Overlay<'a> {
    plane: &'a ExactPlane,
    axis: usize,
    vertices: Vertices,
    lines: Vec<Line>,
    /// Ends of the lines, in ascending order.
    known: HashSet<[u32; 2]>,
    /// Rank of each vertex in coordinate order.
    ranks: Vec<u32>,
    edges: Vec<Edge>,
}

impl<'a> Overlay<'a> {
    fn new(plane: &'a ExactPlane) -> Overlay<'a> {
        let axis = plane.main_axis();
        Overlay {
            plane,
            axis,
            vertices: Vertices::default(),
            lines: Vec::new(),
            known: HashSet::new(),
            ranks: Vec::new(),
            edges: Vec::new(),
        }
    }

    fn add(&mut self, segment: &PlaneSegment) {
        let ends = segment.ends.map(|end| self.vertices.number(end));
        if ends[0] == ends[1] || !self.known.insert([ends[0].min(ends[1]), ends[0].max(ends[1])]) {
            return;
        }
        let [u, v] = others(self.axis);
        // The gradient of the height over the segment's plane, seen along the axis, points left or
        // right.
        let normal = self.plane.normal;
        let gradient = [u, v].map(|along| {
            let height = i128::from(segment.line.normal[along]) * i128::from(normal[self.axis])
                - i128::from(segment.line.normal[self.axis]) * i128::from(normal[along]);
            height.signum() * i128::from(normal[self.axis].signum())
        });
        // The direction with the gradient to its left is `(v, -u)` of the gradient.
        let left = if gradient[1] > 0 || (gradient[1] == 0 && gradient[0] < 0) { 1 } else { -1 };
        let [a, b] = segment.ends.map(|end| [end.near[u], end.near[v]]);
        let bounds = [[a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])]];
        self.lines.push(Line { plane: segment.line, left, vertices: ends.to_vec(), bounds });
    }

    fn point(&self, vertex: u32) -> &ExactPoint {
        &self.vertices.list[vertex as usize]
    }

    /// Compares two vertices by their coordinates.
    fn order(&self, a: u32, b: u32) -> Ordering {
        if a == b {
            return Ordering::Equal;
        }
        let [u, v] = others(self.axis);
        let (a, b) = (self.point(a), self.point(b));
        a.compare(b, u).then_with(|| a.compare(b, v))
    }

    /// Cuts lines where they meet, and at those of `points` that lie on them. Returns false if it
    /// was aborted.
    fn cut(&mut self, points: &[u32], gives_up: &dyn Fn(usize) -> bool) -> bool {
        let mut order: Vec<usize> = (0..self.lines.len()).collect();
        sort::by_key(&mut order, |line| sort::float_key(self.lines[*line].bounds[0][0]));
        for (index, &i) in order.iter().enumerate() {
            let [low, high] = self.lines[i].bounds;
            for &j in &order[index + 1..] {
                let [other_low, other_high] = self.lines[j].bounds;
                if other_low[0] > high[0] + MARGIN {
                    break;
                }
                if other_low[1] <= high[1] + MARGIN && low[1] <= other_high[1] + MARGIN {
                    self.cut_two(i, j);
                }
            }
            if gives_up(self.vertices.list.len()) {
                return false;
            }
        }
        let [u, v] = others(self.axis);
        for &vertex in points {
            let at = self.point(vertex).near;
            for i in 0..self.lines.len() {
                let [low, high] = self.lines[i].bounds;
                let is_near = |axis: usize, at: f64| low[axis] <= at + MARGIN && at <= high[axis] + MARGIN;
                if is_near(0, at[u]) && is_near(1, at[v]) && self.lines[i].plane.side(self.point(vertex)) == 0
                {
                    self.put_on(i, vertex);
                }
            }
        }
        true
    }

    fn cut_two(&mut self, i: usize, j: usize) {
        let ends = |line: usize| [self.lines[line].vertices[0], self.lines[line].vertices[1]];
        let (ends_i, ends_j) = (ends(i), ends(j));
        let sides =
            |line: usize, ends: [u32; 2]| ends.map(|end| self.lines[line].plane.side(self.point(end)));
        let of_j = sides(i, ends_j);
        if of_j[0] * of_j[1] > 0 {
            return;
        }
        let of_i = sides(j, ends_i);
        if of_i[0] * of_i[1] > 0 {
            return;
        }
        if of_i[0] * of_i[1] < 0 && of_j[0] * of_j[1] < 0 {
            let planes = [self.plane, &self.lines[i].plane, &self.lines[j].plane];
            let met = ExactPoint::of_planes(planes);
            let vertex = self.vertices.number(met);
            self.lines[i].vertices.push(vertex);
            self.lines[j].vertices.push(vertex);
            return;
        }
        for k in 0..2 {
            if of_j[k] == 0 {
                self.put_on(i, ends_j[k]);
            }
            if of_i[k] == 0 {
                self.put_on(j, ends_i[k]);
            }
        }
    }

    /// Cuts a line at a vertex in its plane, if the vertex is between the ends.
    fn put_on(&mut self, line: usize, vertex: u32) {
        let (a, b) = (self.lines[line].vertices[0], self.lines[line].vertices[1]);
        if self.order(a, vertex) == self.order(vertex, b) && vertex != a && vertex != b {
            self.lines[line].vertices.push(vertex);
        }
    }

    /// Makes distinct edges from the cut lines.
    fn edges(&mut self) {
        let mut order: Vec<u32> = (0..self.vertices.list.len() as u32).collect();
        sort::by(&mut order, &mut |a, b| self.order(*a, *b));
        self.ranks = vec![0; order.len()];
        for (rank, vertex) in (0..).zip(order) {
            self.ranks[vertex as usize] = rank;
        }
        for (number, line) in (0..).zip(&self.lines) {
            let mut along = line.vertices.clone();
            sort::by_key(&mut along, |vertex| self.ranks[*vertex as usize].into());
            along.dedup();
            self.edges.extend(along.windows(2).map(|ends| Edge { ends: [ends[0], ends[1]], line: number }));
        }
        // Invariant: edges meet only in their ends, and no two have the same ends. All vertices on
        // a line are in its list by now: every pair of lines was tried, and overlapping lines have
        // each other's ends. So the common section of two lines has the same pairs of vertices.
        // Loops follow the order of edges around vertices only: with edges that cross or overlap,
        // they would enclose overlapping regions.
        sort::by_wide_key(&mut self.edges, |edge| {
            u128::from(sort::pair_key(edge.ends)) << 32 | u128::from(edge.line)
        });
        self.edges.dedup_by_key(|edge| edge.ends);
    }

    /// Whether a vertex is to the left (1) of an edge in its direction, to the right (-1), or on
    /// its line.
    fn turn(&self, edge: &Edge, vertex: u32) -> i32 {
        let line = &self.lines[edge.line as usize];
        line.left * line.plane.side(self.point(vertex))
    }

    /// Removes edges whose half-edges have equal values to their left.
    fn leave_out<T: PartialEq>(&mut self, left: impl Fn(usize) -> T) {
        let mut index = 0;
        self.edges.retain(|_| {
            let [forward, backward] = [2 * index, 2 * index + 1].map(&left);
            index += 1;
            forward != backward
        });
    }

    /// Returns the outer loop of the region to the left of each loop; `None` for the unbounded
    /// region.
    fn outer_loops(&self, loops: &Loops) -> Vec<Option<usize>> {
        let of_hole = |hole: &Loop| {
            let around = (0..loops.list.len()).filter(|outer| {
                let outer = &loops.list[*outer];
                !outer.is_hole && outer.component != hole.component && self.is_inside(hole.vertices[0], outer)
            });
            // Of the loops around it, the innermost.
            around.reduce(|best, other| {
                if self.is_inside(loops.list[other].vertices[0], &loops.list[best]) { other } else { best }
            })
        };
        let outer = |(number, list): (usize, &Loop)| if list.is_hole { of_hole(list) } else { Some(number) };
        loops.list.iter().enumerate().map(outer).collect()
    }

    /// Returns the region of each outer loop.
    fn regions(&self, loops: &Loops, outer: &[Option<usize>]) -> Vec<Option<PlaneRegion>> {
        let ring = |list: &Loop| -> Vec<Corner> {
            let lines = list.halves.iter().map(|half| self.edges[*half as usize / 2].line);
            let corner = |(vertex, line): (&u32, u32)| Corner {
                // Invariant: a vertex of a region that lies on the grid is marked so, even if it
                // was computed from three planes. `Vertices::key` and the test for on-grid faces
                // use that mark. Without it, adjacent faces would have different keys for a shared
                // vertex, and results on the grid would be stored as fractions.
                point: self.point(*vertex).settled(),
                line: self.lines[line as usize].plane,
            };
            list.vertices.iter().zip(lines).map(corner).collect()
        };
        let mut regions: Vec<Option<PlaneRegion>> = loops
            .list
            .iter()
            .map(|list| (!list.is_hole).then(|| PlaneRegion { rings: vec![ring(list)] }))
            .collect();
        for (list, outer) in loops.list.iter().zip(outer).filter(|(list, _)| list.is_hole) {
            if let Some(region) = outer.and_then(|outer| regions[outer].as_mut()) {
                region.rings.push(ring(list));
            }
        }
        regions
    }

    /// Whether a vertex is inside a loop that does not contain it, by the parity of the edges to
    /// one side.
    fn is_inside(&self, vertex: u32, outer: &Loop) -> bool {
        let [_, v] = others(self.axis);
        let is_above = |other: u32| self.point(other).compare(self.point(vertex), v) == Ordering::Greater;
        let mut inside = false;
        for &half in &outer.halves {
            let edge = self.edges[half as usize / 2];
            let above = edge.ends.map(is_above);
            if above[0] != above[1] {
                // If the vertex is to the left of an upward edge, the edge passes at a greater
                // coordinate.
                inside ^= (self.turn(&edge, vertex) > 0) == above[1];
            }
        }
        inside
    }
}

/// A closed chain of half-edges with a region to the left.
struct Loop {
    halves: Vec<u32>,
    /// First vertex of each half-edge.
    vertices: Vec<u32>,
    /// Whether the region is outside of the loop.
    is_hole: bool,
    /// Number of the connected component.
    component: u32,
}

/// All loops of a subdivision. Half-edge `2 e` is edge `e` in its direction, `2 e + 1` its reverse.
struct Loops {
    list: Vec<Loop>,
    /// Number of the loop of each half-edge.
    of_half: Vec<u32>,
}

impl Loops {
    fn of(overlay: &Overlay<'_>) -> Loops {
        let edges = &overlay.edges;
        let origin = |half: u32| edges[half as usize / 2].ends[half as usize % 2];
        let mut around: Vec<Vec<u32>> = vec![Vec::new(); overlay.vertices.list.len()];
        for half in 0..2 * edges.len() as u32 {
            around[origin(half) as usize].push(half);
        }
        // Counterclockwise, starting opposite to the second coordinate's direction: first the edges
        // to greater coordinates, then the others. Invariant: no two compare as equal, since no two
        // edges at a vertex have the same direction. Loops and holes depend on this order; with
        // ties, they would depend on the sort algorithm.
        for halves in &mut around {
            sort::by(halves, &mut |a, b| {
                (a % 2).cmp(&(b % 2)).then_with(|| {
                    let edge = &edges[*a as usize / 2];
                    let tip = origin(b ^ 1);
                    let turn = overlay.turn(edge, tip) * if a % 2 == 0 { 1 } else { -1 };
                    0.cmp(&turn)
                })
            });
        }
        // Index of each half-edge among those around its first vertex.
        let mut index_around = vec![0u32; 2 * edges.len()];
        for halves in &around {
            for (index, half) in (0..).zip(halves) {
                index_around[*half as usize] = index;
            }
        }
        let components = components(overlay);
        let mut loops = Loops { list: Vec::new(), of_half: vec![u32::MAX; 2 * edges.len()] };
        for first in 0..2 * edges.len() as u32 {
            if loops.of_half[first as usize] != u32::MAX {
                continue;
            }
            let number = loops.list.len() as u32;
            let mut found = Loop {
                halves: Vec::new(),
                vertices: Vec::new(),
                is_hole: false,
                component: components[origin(first) as usize],
            };
            let (mut half, mut least) = (first, u32::MAX);
            loop {
                loops.of_half[half as usize] = number;
                found.halves.push(half);
                found.vertices.push(origin(half));
                // The next half-edge is clockwise from the reverse one.
                let back = half ^ 1;
                let vertex = origin(back);
                let halves = &around[vertex as usize];
                let at = index_around[back as usize] as usize;
                let next = halves[(at + halves.len() - 1) % halves.len()];
                // At the vertex with the minimum coordinates, all edges lead to greater ones. The
                // region between the last and the first edge is outside of the loop.
                let rank = overlay.ranks[vertex as usize];
                if rank < least {
                    (least, found.is_hole) = (rank, false);
                }
                found.is_hole |= rank == least && at == 0;
                half = next;
                if half == first {
                    break;
                }
            }
            loops.list.push(found);
        }
        loops
    }
}

/// Returns the number of each vertex's connected component.
fn components(overlay: &Overlay<'_>) -> Vec<u32> {
    let mut sets = UnionFind::new(overlay.vertices.list.len());
    for Edge { ends: [a, b], .. } in &overlay.edges {
        sets.join(*a, *b);
    }
    sets.roots()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLANE: [i64; 3] = [0, 0, 1];

    /// Regions of segments between points of the plane z = 0, as ring counts and twice the areas.
    fn areas(segments: &[[[i32; 2]; 2]], points: &[[i32; 2]]) -> Vec<(usize, f64)> {
        let plane = ExactPlane::through([0; 3], PLANE);
        let lift = |at: [i32; 2]| [at[0], at[1], 0];
        let segments: Vec<PlaneSegment> = segments
            .iter()
            .map(|ends| PlaneSegment {
                ends: ends.map(|end| ExactPoint::of_grid(lift(end))),
                line: ExactPlane::along(2, lift(ends[0]), lift(ends[1])),
            })
            .collect();
        let points: Vec<ExactPoint> = points.iter().map(|at| ExactPoint::of_grid(lift(*at))).collect();
        let area = |ring: &Vec<Corner>| -> f64 {
            (0..ring.len())
                .map(|i| {
                    let (a, b) = (ring[i].point.near, ring[(i + 1) % ring.len()].point.near);
                    a[0] * b[1] - a[1] * b[0]
                })
                .sum()
        };
        // (All regions are chosen, with distinct values.)
        let count = std::cell::Cell::new(0);
        let choose = |_: &PlaneRegion| Some(count.replace(count.get() + 1));
        let mut found: Vec<(usize, f64)> = regions(&plane, &segments, &points, &|_| false, choose)
            .unwrap()
            .iter()
            .map(|(region, _)| {
                (region.rings.len(), (region.rings.iter().map(area).sum::<f64>() * 1e6).round() / 1e6)
            })
            .collect();
        found.sort_by(|a, b| a.1.total_cmp(&b.1));
        found
    }

    fn square(low: i32, high: i32) -> Vec<[[i32; 2]; 2]> {
        let corners = [[low, low], [high, low], [high, high], [low, high]];
        (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect()
    }

    #[test]
    fn segments_divide_a_square() {
        assert_eq!(areas(&square(0, 8), &[[4, 0], [3, 3]]), [(1, 128.0)]);
        let with = |more: &[[[i32; 2]; 2]]| areas(&[square(0, 8), more.to_vec()].concat(), &[]);
        // Two that cross, one that ends inside, one from outside, one along an edge.
        assert_eq!(with(&[[[0, 4], [8, 4]], [[4, 0], [4, 8]]]), [(1, 32.0); 4]);
        assert_eq!(with(&[[[0, 4], [5, 4]]]), [(1, 128.0)]);
        assert_eq!(with(&[[[-3, 4], [11, 4]], [[2, 0], [6, 0]]]), [(1, 64.0), (1, 64.0)]);
        assert_eq!(with(&[[[2, 2], [5, 5]]]), [(1, 128.0)]);
        // Crossings off the grid.
        assert_eq!(with(&[[[0, 1], [8, 4]], [[0, 5], [8, 1]]]).len(), 4);
    }

    #[test]
    fn holes_go_to_the_region_around_them() {
        let nested = [square(0, 20), square(2, 18), square(4, 6), square(8, 10), square(9, 12)].concat();
        let found = areas(&nested, &[]);
        assert_eq!(
            found,
            [
                (1, 2.0),
                (1, 6.0),
                (1, 8.0),
                (1, 16.0),
                (2, 2.0 * 400.0 - 2.0 * 256.0),
                (3, 2.0 * (256.0 - 4.0 - 4.0 - 9.0 + 1.0))
            ]
        );
        // A bridge to a hole, and two squares that share a vertex.
        let bridged = [square(0, 20), square(4, 6), vec![[[0, 0], [4, 4]]], square(6, 9)].concat();
        assert_eq!(areas(&bridged, &[]), [(1, 8.0), (1, 18.0), (2, 774.0)]);
    }

    /// Random segments in a square: the areas add up to the square's, and no region is empty.
    #[test]
    fn areas_add_up() {
        let mut state = 11u64;
        let mut number = |below: i32| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 33) as i32).rem_euclid(below)
        };
        for round in 0..200 {
            let size = [6, 40, 1 << 20][round % 3];
            let mut segments = square(0, size);
            for _ in 0..round % 17 {
                let mut point = || [number(size + 1), number(size + 1)];
                segments.push([point(), point()]);
            }
            segments.retain(|[a, b]| a != b);
            let found = areas(&segments, &[]);
            let sum: f64 = found.iter().map(|(_, area)| area).sum();
            let whole = 2.0 * f64::from(size) * f64::from(size);
            assert!((sum - whole).abs() < 1e-6 * whole, "{round}: {sum} {whole}");
            assert!(found.iter().all(|(_, area)| *area > 0.0), "{found:?}");
        }
    }
}
