//! Boundary of an open surface: edges that have a face on one side only, joined to loops.

use std::collections::BTreeMap;
use std::path::Path;

use super::super::solid::closure::edge_number;
use spinney_base::io::Sorter;
use spinney_base::{Error, Progress, Result, sort};
use spinney_brep::Face;
use spinney_brep::geometry::Triangulator;

/// Bytes of an edge: its key, its ends in ascending order, the direction, the part of the face, the
/// part's object, and the face's normal.
const EDGE: usize = 8 + 24 + 4 + 4 + 4 + 12;

/// Edge as the sorter returns it: key, object, ends, whether it runs to the greater end, part, bits
/// of the normal.
type SortedEdge = (u64, u32, [[i32; 3]; 2], bool, u32, [u32; 3]);

/// Cosine of the angle between face normals below which the faces count as walls back to back
/// rather than as patches of one surface. Terraced houses that are open at their bases share edges
/// there.
const BACK_TO_BACK: f32 = -0.98;

/// Whether two faces with these normals, on opposite directions of an edge, may belong to one
/// surface.
fn goes_on(one: [u32; 3], other: [u32; 3]) -> bool {
    let products = (0..3).map(|axis| f32::from_bits(one[axis]) * f32::from_bits(other[axis]));
    products.sum::<f32>() > BACK_TO_BACK
}

/// Bits of a face's unit normal; zero for a face without area.
fn normal_bits(face: &Face<'_>) -> [u32; 3] {
    let normal = face.area_vector();
    let length = normal.iter().map(|part| part * part).sum::<f64>().sqrt();
    normal.map(|part| if length > 0.0 { (part / length) as f32 } else { 0.0 }.to_bits())
}

/// Collects edges.
pub(super) struct Boundary {
    sorter: Sorter,
}

/// Closed loop of open edges around a hole. A face that closes the hole has its edges in this
/// order.
pub(super) struct Loop {
    pub(super) points: Vec<[i32; 3]>,
    /// Part of a face next to the hole.
    pub(super) part: u32,
}

impl Boundary {
    /// Creates an empty collection. About `memory` bytes are used before edges spill to a temporary
    /// file in `directory`.
    pub(super) fn new(directory: &Path, memory: u64) -> Boundary {
        Boundary { sorter: Sorter::new(directory, memory) }
    }

    /// Adds the edges of a face of an object.
    pub(super) fn add_face(&mut self, face: &Face<'_>, object: u32) -> Result<()> {
        let normal = normal_bits(face);
        edges(face).try_for_each(|[from, to]| self.add([from, to], face.part, object, normal))
    }

    /// Adds an edge of a face.
    fn add(&mut self, [from, to]: [[i32; 3]; 2], part: u32, object: u32, normal: [u32; 3]) -> Result<()> {
        let (number, is_forward) = edge_number(from, to);
        let (low, high) = if is_forward { (from, to) } else { (to, from) };
        let mut item = Vec::with_capacity(EDGE);
        item.extend_from_slice(&number.to_le_bytes());
        low.iter().chain(&high).for_each(|at| item.extend_from_slice(&at.to_le_bytes()));
        item.extend_from_slice(&u32::from(is_forward).to_le_bytes());
        item.extend_from_slice(&part.to_le_bytes());
        item.extend_from_slice(&object.to_le_bytes());
        normal.iter().for_each(|bits| item.extend_from_slice(&bits.to_le_bytes()));
        self.sorter.push(number, &item)
    }

    /// Returns the loops of the edges without a counterpart in their own object, grouped by object.
    /// They may use up to `memory` bytes. If open edges of different objects match, these objects
    /// are patches of one surface and are joined to one group.
    pub(super) fn loops(self, path: &Path, memory: u64, progress: &dyn Progress) -> Result<Open> {
        // Edges of the faces that would close the surface, with their objects: object, from, to,
        // part.
        let mut open: Vec<(u32, OpenEdge)> = Vec::new();
        let most = (memory / 160).max(1 << 12) as usize;
        let too_many = || Error::TooLarge {
            path: path.to_path_buf(),
            what: "the boundary of the surface".into(),
            needed: 160 * most as u64 + 1,
            limit: memory,
            advice: "allow more with --memory".into(),
        };
        let mut groups = Groups::default();
        let mut same: Vec<SortedEdge> = Vec::new();
        let mut settle = |same: &mut Vec<SortedEdge>| {
            // (Hash collisions are next to impossible and harmless: edges are sorted by their ends
            // first.)
            sort::by(same, &mut |a, b| (a.2, a.1, a.3, a.4, a.5).cmp(&(b.2, b.1, b.3, b.4, b.5)));
            for edges in same.chunk_by(|a, b| a.2 == b.2) {
                let (mut there, mut back) = (Vec::new(), Vec::new());
                for edges in edges.chunk_by(|a, b| a.1 == b.1) {
                    let forward = edges.iter().filter(|edge| edge.3).count();
                    let backward = edges.len() - forward;
                    let (_, object, _, _, part, normal) = edges[0];
                    there.extend((backward..forward).map(|_| (object, part, normal)));
                    back.extend((forward..backward).map(|_| (object, part, normal)));
                }
                let [low, high] = edges[0].2;
                there.retain(|one| {
                    let found = back.iter().position(|other| goes_on(one.2, other.2));
                    if let Some(found) = found {
                        groups.join(one.0, back.remove(found).0);
                    }
                    found.is_none()
                });
                open.extend(there.iter().map(|(object, part, _)| (*object, (high, low, *part))));
                open.extend(back.iter().map(|(object, part, _)| (*object, (low, high, *part))));
            }
            same.clear();
            if open.len() > most { Err(too_many()) } else { Ok(()) }
        };
        let mut count = 0u64;
        self.sorter.finish(&mut |item| {
            count += 1;
            if count.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            let number = |at: usize| u32::from_le_bytes(item[at..at + 4].try_into().expect("four bytes"));
            let key = u64::from_le_bytes(item[..8].try_into().expect("eight bytes"));
            let point = |at: usize| [0, 4, 8].map(|axis| number(at + axis) as i32);
            if same.first().is_some_and(|edge| edge.0 != key) {
                settle(&mut same)?;
            }
            let normal = [44, 48, 52].map(&number);
            same.push((key, number(40), [point(8), point(20)], number(32) == 1, number(36), normal));
            Ok(())
        })?;
        settle(&mut same)?;
        for (object, _) in &mut open {
            *object = groups.group(*object);
        }
        // (The sort is stable: edges of an object keep their order.)
        sort::by_key(&mut open, |(object, _)| (*object).into());
        let mut loops = Vec::new();
        for edges in open.chunk_by(|a, b| a.0 == b.0) {
            loops.extend(chain(edges.iter().map(|(_, edge)| *edge).collect(), progress)?);
        }
        Ok(Open { loops, groups })
    }
}

/// Boundaries of a surface.
pub(super) struct Open {
    pub(super) loops: Vec<Loop>,
    pub(super) groups: Groups,
}

/// Groups of objects whose open edges match. A group has the smallest number of its objects.
#[derive(Default)]
pub(super) struct Groups {
    /// Smaller object number of the same group, by object; without the smallest number of each
    /// group.
    joined: BTreeMap<u32, u32>,
}

impl Groups {
    /// Group number of an object.
    pub(super) fn group(&self, mut object: u32) -> u32 {
        while let Some(lesser) = self.joined.get(&object) {
            object = *lesser;
        }
        object
    }

    fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (self.group(one), self.group(other));
        if one != other {
            self.joined.insert(one.max(other), one.min(other));
        }
    }
}

/// Edge of a face that would close the surface: from, to, and the part of the adjacent face.
type OpenEdge = ([i32; 3], [i32; 3], u32);

/// Joins edges to loops. Each point has equally many incoming and outgoing edges.
fn chain(edges: Vec<OpenEdge>, progress: &dyn Progress) -> Result<Vec<Loop>> {
    let mut from: BTreeMap<[i32; 3], Vec<([i32; 3], u32)>> = BTreeMap::new();
    for (start, end, part) in edges {
        from.entry(start).or_default().push((end, part));
    }
    from.values_mut().for_each(|ends| {
        sort::by_wide_key(ends, |(to, part)| !(sort::point_key(*to) << 32 | u128::from(*part)));
    });
    let mut loops = Vec::new();
    while let Some(first) = from.first_entry() {
        if first.get().is_empty() {
            first.remove();
            continue;
        }
        progress.check()?;
        let start = *first.key();
        let mut points = vec![start];
        let mut visited = BTreeMap::new();
        visited.insert(start, 0);
        let mut part = 0;
        let mut at = start;
        while let Some((next, of)) = from.get_mut(&at).and_then(Vec::pop) {
            part = of;
            // Revisiting a point closes a loop.
            if let Some(&index) = visited.get(&next) {
                let ring: Vec<[i32; 3]> = points.drain(index..).collect();
                for point in &ring {
                    visited.remove(point);
                }
                if ring.len() > 2 {
                    loops.push(Loop { points: ring, part });
                }
                if index == 0 {
                    break;
                }
            }
            visited.insert(next, points.len());
            points.push(next);
            at = next;
        }
        if points.len() > 2 && at != start {
            loops.push(Loop { points, part });
        }
    }
    Ok(loops)
}

/// Directed edges of a face.
pub(super) fn edges<'a>(face: &Face<'a>) -> impl Iterator<Item = [[i32; 3]; 2]> + use<'a> {
    face.rings().flat_map(|ring| (0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]))
}

/// Passes triangles that close the boundaries to `each`. Their numbers start at `first`; they are
/// white if faces have colours.
pub(super) fn close(
    loops: &[Loop],
    (first, source): (u64, u64),
    is_coloured: bool,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
) -> Result<()> {
    let colours = if is_coloured { &[[255; 3]; 3][..] } else { &[] };
    let triangles =
        loops.iter().flat_map(|hole| hole.triangles().into_iter().map(|points| (hole.part, points)));
    for (number, (part, points)) in (first..).zip(triangles) {
        if number.is_multiple_of(1 << 12) {
            progress.check()?;
        }
        each(&Face { number, points: &points, ring_ends: &[3], colours, part, source })?;
    }
    Ok(())
}

impl Loop {
    /// Triangles that close the hole. The hole is triangulated in its largest axis projection, or
    /// as a fan if it intersects itself there.
    fn triangles(&self) -> Vec<[[i32; 3]; 3]> {
        let wide: Vec<[i64; 3]> = self.points.iter().map(|point| point.map(i64::from)).collect();
        let mut triangles = Vec::new();
        if !Triangulator::new().triangulate(&wide, &[wide.len()], &mut triangles) {
            triangles.extend((2..wide.len() as u32).map(|corner| [0, corner - 1, corner]));
        }
        let corners = |triangle: [u32; 3]| triangle.map(|corner| self.points[corner as usize]);
        triangles.into_iter().map(corners).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No normal.
    const FLAT: [u32; 3] = [0; 3];

    #[test]
    fn edges_without_partners_become_loops() {
        let square = |z: i32| [[0, 0, z], [4, 0, z], [4, 4, z], [0, 4, z]];
        let mut boundary = Boundary::new(&std::env::temp_dir(), 1 << 20);
        for z in [0, 9] {
            // A square, and a triangle that shares an edge with it.
            let ring = square(z);
            (0..4).for_each(|i| boundary.add([ring[i], ring[(i + 1) % 4]], 7, 0, FLAT).unwrap());
            let wing = [ring[1], ring[0], [2, -3, z]];
            (0..3).for_each(|i| boundary.add([wing[i], wing[(i + 1) % 3]], 7, 0, FLAT).unwrap());
        }
        let loops = boundary.loops(Path::new("x"), 1 << 20, &()).unwrap().loops;
        assert_eq!(loops.iter().map(|hole| (hole.points.len(), hole.part)).collect::<Vec<_>>(), [(5, 7); 2]);
        assert_eq!(loops[0].triangles().len(), 3);
    }

    /// Objects that lack the same edge have separate loops; objects with matching open edges are
    /// patches of one surface.
    #[test]
    fn objects_with_matching_open_edges_are_joined() {
        let ring = [[0, 0, 0], [4, 0, 0], [0, 4, 0]];
        let of = |is_turned: bool, more: bool| {
            let mut boundary = Boundary::new(&std::env::temp_dir(), 1 << 20);
            for i in 0..3 {
                let (from, to) = (ring[i], ring[(i + 1) % 3]);
                boundary.add([from, to], 0, 0, FLAT).unwrap();
                let (from, to) = if is_turned { (to, from) } else { (from, to) };
                boundary.add([from, to], 1, 1, FLAT).unwrap();
            }
            if more {
                let wing = [[4, 0, 0], [0, 0, 0], [2, 9, 9]];
                (0..3).for_each(|i| boundary.add([wing[i], wing[(i + 1) % 3]], 2, 2, FLAT).unwrap());
            }
            let open = boundary.loops(Path::new("x"), 1 << 20, &()).unwrap();
            let loops: Vec<_> = open.loops.iter().map(|hole| (hole.points.len(), hole.part)).collect();
            (loops, [0, 1, 2].map(|object| open.groups.group(object)))
        };
        assert_eq!(of(false, false), (vec![(3, 0), (3, 1)], [0, 1, 2]));
        assert_eq!(of(true, false), (vec![], [0, 0, 2]));
        // (Three edges: the two matching edges with the smallest objects are a pair.)
        let (loops, groups) = of(true, true);
        assert_eq!((loops.len(), groups[..2].to_vec()), (1, vec![0, 0]));
    }

    /// Walls back to back share edges but are not patches of one surface.
    #[test]
    fn walls_of_neighbours_are_not_joined() {
        let mut boundary = Boundary::new(&std::env::temp_dir(), 1 << 20);
        let (from, to) = ([0, 0, 0], [4, 0, 0]);
        let along_y = |y: f32| [0, y.to_bits(), 0];
        boundary.add([from, to], 0, 0, along_y(1.0)).unwrap();
        boundary.add([to, from], 1, 1, along_y(-1.0)).unwrap();
        let open = boundary.loops(Path::new("x"), 1 << 20, &()).unwrap();
        assert_eq!([0, 1].map(|object| open.groups.group(object)), [0, 1]);
        assert!(goes_on(along_y(1.0), along_y(1.0)) && goes_on([0; 3], along_y(-1.0)));
    }

    /// Two loops that share a vertex stay separate.
    #[test]
    fn loops_that_touch_are_taken_apart() {
        let mut boundary = Boundary::new(&std::env::temp_dir(), 1 << 20);
        for ring in [[[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 0, 0], [-4, 0, 0], [0, -4, 0]]] {
            (0..3).for_each(|i| boundary.add([ring[i], ring[(i + 1) % 3]], 0, 0, FLAT).unwrap());
        }
        let loops = boundary.loops(Path::new("x"), 1 << 20, &()).unwrap().loops;
        assert_eq!(loops.iter().map(|hole| hole.points.len()).collect::<Vec<_>>(), [3, 3]);
    }
}
