//! Division of a surface that is not closed into units with their own inside tests: closed ones,
//! ones that are closed except for inconsistent orientation, and open objects.
//!
//! Parts that are closed by themselves are kept unchanged, even if they touch others. The rest is
//! split into components, whose triangles share edges. Components that are not closed form one unit
//! if they belong to one part, or to one object and share edges. The inside of an object does not
//! depend on other objects.

use std::collections::{HashMap, HashSet};

use super::closure::{Closure, edge_number};
use super::field::WindingField;
use super::grid::Triangle;
use spinney_base::{Progress, Result, sort};
use spinney_brep::exact::union_find::UnionFind;
use spinney_brep::exact::vector::{dot, subtract};

/// Divided surface. Triangles keep their order.
#[derive(Debug, Default)]
pub(super) struct Units {
    /// All closed units.
    pub(super) closed: Vec<Triangle>,
    /// Units of objects, or of objects that close each other, in which every edge occurs an even
    /// number of times but not in opposite directions.
    pub(super) even: Vec<Vec<Triangle>>,
    /// Open units of each object.
    pub(super) open: Vec<Vec<Triangle>>,
    /// Number of duplicate triangles in what was not closed.
    pub(super) duplicates: u64,
}

impl Units {
    /// Memory in bytes for dividing this number of triangles: the triangles and their copies, their
    /// edges and the sets.
    pub(super) fn memory(triangles: usize) -> u64 {
        (triangles * (3 * size_of::<Triangle>() + size_of::<Component>() + 48)) as u64
    }

    /// Divides triangles. Triangles without area count for closedness and are then left out.
    /// `object` maps a part to its object.
    pub(super) fn of(
        triangles: Vec<Triangle>,
        object: &dyn Fn(u32) -> u32,
        progress: &dyn Progress,
    ) -> Result<Units> {
        let mut objects: HashMap<u32, Closure> = HashMap::new();
        for triangle in &triangles {
            progress.check()?;
            objects.entry(triangle.part).or_default().add(triangle.corners);
        }
        let (mut closed, rest): (Vec<Triangle>, Vec<Triangle>) =
            triangles.into_iter().partition(|triangle| objects[&triangle.part].is_closed());
        closed.retain(has_area);
        let single = without_duplicates(&rest, object, progress)?;
        let count = |triangles: &[Triangle]| triangles.iter().filter(|triangle| has_area(triangle)).count();
        let duplicates = (count(&rest) - count(&single)) as u64;
        drop(rest);
        let mut units = Units { closed, duplicates, ..Units::default() };
        units.add_components(&single, object, progress)?;
        Ok(units)
    }

    /// Divides the triangles of parts that are not closed.
    fn add_components(
        &mut self,
        triangles: &[Triangle],
        object: &dyn Fn(u32) -> u32,
        progress: &dyn Progress,
    ) -> Result<()> {
        let mut sets = UnionFind::new(triangles.len());
        join_by_edges((0..).zip(triangles).map(|(number, triangle)| (0, number, triangle)), &mut sets);
        progress.check()?;
        let mut components = vec![Component::default(); triangles.len()];
        for (number, triangle) in (0..).zip(triangles) {
            components[sets.root(number) as usize].add(triangle);
        }
        progress.check()?;
        let hollow = self.hollow(triangles, &components, &mut sets, progress)?;
        let kind = |root: u32| match components[root as usize].closure {
            closure if !closure.is_even() || hollow.contains(&root) => Kind::Open,
            closure if closure.is_closed() => Kind::Closed,
            _ => Kind::Even,
        };
        let kinds: Vec<Kind> = (0..triangles.len() as u32).map(|number| kind(sets.root(number))).collect();
        // Sets of triangles that form a unit.
        let mut units = UnionFind::new(triangles.len());
        let mut firsts: HashMap<(Kind, u32), u32> = HashMap::new();
        let mut join = |key: (Kind, u32), number: u32, units: &mut UnionFind| {
            units.join(*firsts.entry(key).or_insert(number), number);
        };
        for ((number, triangle), kind) in (0..).zip(triangles).zip(&kinds) {
            match kind {
                Kind::Open => join((*kind, triangle.part), number, &mut units),
                // (The key with `Kind::Closed` joins each component, also across objects. Closed
                // triangles need no units.)
                Kind::Even => {
                    join((*kind, object(triangle.part)), number, &mut units);
                    join((Kind::Closed, sets.root(number)), number, &mut units);
                }
                Kind::Closed => {}
            }
        }
        let open = (0..).zip(triangles).filter(|(number, _)| kinds[*number as usize] == Kind::Open);
        join_by_edges(open.map(|(number, triangle)| (object(triangle.part), number, triangle)), &mut units);
        progress.check()?;
        // In order of triangles, so that units are ordered by their first triangles.
        let mut list_indices: HashMap<u32, usize> = HashMap::new();
        for ((number, triangle), kind) in
            (0..).zip(triangles).zip(kinds).filter(|((_, triangle), _)| has_area(triangle))
        {
            let lists = match kind {
                Kind::Closed => {
                    self.closed.push(*triangle);
                    continue;
                }
                Kind::Even => &mut self.even,
                Kind::Open => &mut self.open,
            };
            let list_index = *list_indices.entry(units.root(number)).or_insert(lists.len());
            if list_index == lists.len() {
                lists.push(Vec::new());
            }
            lists[list_index].push(*triangle);
        }
        Ok(())
    }

    /// Roots of closed components that a cavity binds to an open one: cavities of open components,
    /// and components with an open cavity. A cavity is an inverted component; it subtracts only
    /// from bodies of its own object.
    fn hollow(
        &self,
        triangles: &[Triangle],
        components: &[Component],
        sets: &mut UnionFind,
        progress: &dyn Progress,
    ) -> Result<HashSet<u32>> {
        let mut outward = self.closed.clone();
        let mut open_parts = HashSet::new();
        // One triangle of each inverted component.
        let (mut closed, mut open) = (HashMap::new(), HashMap::new());
        for (number, triangle) in (0..).zip(triangles).filter(|(_, triangle)| has_area(triangle)) {
            let root = sets.root(number);
            let component = &components[root as usize];
            let is_inverted = component.volume < 0;
            if !component.closure.is_even() {
                open_parts.insert(triangle.part);
                if is_inverted {
                    open.entry(root).or_insert(triangle);
                }
            } else if component.closure.is_closed() {
                if is_inverted {
                    closed.entry(root).or_insert(triangle);
                } else {
                    outward.push(*triangle);
                }
            }
        }
        closed.retain(|_, triangle| open_parts.contains(&triangle.part));
        if closed.is_empty() && open.is_empty() {
            return Ok(HashSet::new());
        }
        let field = WindingField::new(&outward, progress)?;
        let is_within = |triangle: &Triangle| field.at(triangle.middle()).abs() >= 0.5;
        let hollow_parts: HashSet<u32> =
            open.values().filter(|triangle| is_within(triangle)).map(|triangle| triangle.part).collect();
        let mut hollow: HashSet<u32> =
            closed.iter().filter(|(_, triangle)| !is_within(triangle)).map(|(root, _)| *root).collect();
        for (number, triangle) in (0..).zip(triangles) {
            if hollow_parts.contains(&triangle.part) {
                hollow.insert(sets.root(number));
            }
        }
        Ok(hollow)
    }
}

/// Kinds of components.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Kind {
    Closed,
    Even,
    Open,
}

fn has_area(triangle: &Triangle) -> bool {
    triangle.normal() != [0; 3]
}

/// Properties of a component.
#[derive(Clone, Copy, Default)]
struct Component {
    closure: Closure,
    /// One of its vertices.
    from: Option<[i32; 3]>,
    /// Six times the volume of the cone from that vertex over the component: the enclosed volume,
    /// approximate if the component is open. Negative if the component is inverted.
    volume: i128,
}

impl Component {
    fn add(&mut self, triangle: &Triangle) {
        self.closure.add(triangle.corners);
        let from = *self.from.get_or_insert(triangle.corners[0]);
        let normal = triangle.normal();
        let along = subtract(triangle.corners[0].map(i128::from), from.map(i128::from));
        self.volume += dot(along, normal.map(i128::from));
    }
}

/// Joins triangles of the same object that share an edge, in either direction. Triangles are given
/// as object, index and triangle.
fn join_by_edges<'a>(triangles: impl Iterator<Item = (u32, u32, &'a Triangle)>, sets: &mut UnionFind) {
    // Object, edge hash, and triangle index in the low bits.
    let mut edges: Vec<u128> = Vec::with_capacity(3 * triangles.size_hint().0);
    for (object, number, triangle) in triangles {
        let [a, b, c] = triangle.corners;
        let of = |(from, to)| {
            u128::from(object) << 96 | u128::from(edge_number(from, to).0) << 32 | u128::from(number)
        };
        edges.extend([(a, b), (b, c), (c, a)].map(of));
    }
    sort::numbers128(&mut edges);
    for pair in edges.windows(2).filter(|pair| pair[0] >> 32 == pair[1] >> 32) {
        sets.join(pair[0] as u32, pair[1] as u32);
    }
}

/// Removes triangles that occur more than once in an object.
fn without_duplicates(
    triangles: &[Triangle],
    object: &dyn Fn(u32) -> u32,
    progress: &dyn Progress,
) -> Result<Vec<Triangle>> {
    let mut seen = HashSet::with_capacity(triangles.len());
    let mut single = Vec::new();
    for triangle in triangles {
        progress.check()?;
        let mut corners = triangle.corners;
        let least = (0..3).min_by_key(|corner| corners[*corner]).unwrap_or(0);
        // Rotated, not sorted: triangles of opposite orientation are not duplicates.
        corners.rotate_left(least);
        if seen.insert((object(triangle.part), corners)) {
            single.push(*triangle);
        }
    }
    Ok(single)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tetrahedron of a part.
    fn tetrahedron([x, y, z]: [i32; 3], size: i32, part: u32) -> Vec<Triangle> {
        let [a, b, c, d] = [[x, y, z], [x + size, y, z], [x, y + size, z], [x, y, z + size]];
        let of = |corners| Triangle { corners, attribute: 0, part };
        [[a, c, b], [a, b, d], [b, c, d], [c, a, d]].map(of).to_vec()
    }

    fn counts(triangles: &[Triangle]) -> (usize, usize, Vec<usize>, u64) {
        counts_of(triangles, &|part| part)
    }

    fn counts_of(triangles: &[Triangle], object: &dyn Fn(u32) -> u32) -> (usize, usize, Vec<usize>, u64) {
        let units = Units::of(triangles.to_vec(), object, &()).unwrap();
        let open = units.open.iter().map(Vec::len).collect();
        (units.closed.len(), units.even.iter().map(Vec::len).sum(), open, units.duplicates)
    }

    #[test]
    fn open_objects_are_apart_where_they_touch() {
        // Two tetrahedra that share a face, which neither of them has.
        let [a, b, c, d, e] = [[0, 0, 0], [90, 0, 0], [0, 90, 0], [0, 0, 90], [90, 90, 90]];
        let of = |part: u32, corners| Triangle { corners, attribute: 0, part };
        let one = [[a, c, b], [a, b, d], [c, a, d]].map(|corners| of(0, corners));
        let other = [[e, b, c], [e, d, b], [e, c, d]].map(|corners| of(1, corners));
        // They close each other. One surface is closed regardless of its parts.
        assert_eq!(counts(&[&one[..], &other].concat()), (6, 0, vec![], 0));
        // Each has a hole: the region between them belongs to neither, unless they are groups of
        // one object.
        let both = [&one[1..], &other[1..]].concat();
        assert_eq!(counts(&both), (0, 0, vec![2, 2], 0));
        assert_eq!(counts_of(&both, &|_| 0), (0, 0, vec![4], 0));
        // A face that both have counts for either.
        let both = [&one[1..], &[of(0, [b, c, d])], &other[1..], &[of(1, [b, c, d])]].concat();
        assert_eq!(counts(&both), (0, 0, vec![3, 3], 0));
        assert_eq!(counts_of(&both, &|_| 0), (0, 0, vec![5], 1));
    }

    #[test]
    fn flipped_objects_are_apart() {
        let flipped = |at: i32, part: u32| {
            let mut faces = tetrahedron([at; 3], 90, part);
            faces[0].corners.swap(0, 1);
            faces
        };
        let units = |object: &dyn Fn(u32) -> u32| {
            let all = [flipped(0, 0), flipped(10, 1), flipped(20, 1)].concat();
            Units::of(all, object, &()).unwrap().even.iter().map(Vec::len).collect::<Vec<_>>()
        };
        assert_eq!(units(&|part| part), [4, 8]);
        assert_eq!(units(&|_| 0), [12]);
    }

    #[test]
    fn objects_and_components_are_distinguished() {
        let (a, b) = (tetrahedron([0; 3], 90, 0), tetrahedron([200, 0, 0], 90, 1));
        assert_eq!(counts(&[&a[..], &b].concat()), (8, 0, vec![], 0));
        assert_eq!(counts(&[&a[1..], &b].concat()), (4, 0, vec![3], 0));
        // Two components of one object, one of them open; then both open, with another object.
        let c = tetrahedron([0, 200, 0], 90, 0);
        assert_eq!(counts(&[&a[..], &c[1..]].concat()), (4, 0, vec![3], 0));
        assert_eq!(counts(&[&a[1..], &b[1..], &c[1..]].concat()), (0, 0, vec![6, 3], 0));
        // Objects that share an edge; duplicate triangles; inverted faces.
        let touching = Triangle { part: 2, ..a[0] };
        assert_eq!(counts(&[&a[..], &[touching]].concat()), (4, 0, vec![1], 0));
        assert_eq!(counts(&[&a[..], &a[..2]].concat()), (4, 0, vec![], 2));
        let mut flipped = c.clone();
        flipped[0].corners.swap(0, 1);
        assert_eq!(counts(&[&b[1..], &flipped].concat()), (0, 4, vec![3], 0));
    }

    #[test]
    fn triangles_without_area_close_what_they_join() {
        // An edge of the tetrahedron has its midpoint as a vertex of only one of its two faces.
        let mut joined = tetrahedron([0; 3], 90, 0);
        let [a, b, c, middle] = [[0, 0, 0], [90, 0, 0], [0, 90, 0], [45, 0, 0]];
        let of = |corners| Triangle { corners, attribute: 0, part: 0 };
        joined.splice(..1, [of([a, c, middle]), of([c, b, middle])]);
        assert_eq!(counts(&joined), (0, 0, vec![5], 0));
        joined.push(of([a, middle, b]));
        assert_eq!(counts(&joined), (5, 0, vec![], 0));
        let other = tetrahedron([200; 3], 90, 0);
        assert_eq!(counts(&[&joined[..], &other[1..]].concat()), (5, 0, vec![3], 0));
    }

    #[test]
    fn cavities_stay_with_what_they_are_in() {
        let outer = tetrahedron([0; 3], 900, 0);
        let mut cavity = tetrahedron([50; 3], 90, 0);
        cavity.iter_mut().for_each(|triangle| triangle.corners.swap(0, 1));
        assert_eq!(counts(&[&outer[1..], &cavity].concat()), (0, 0, vec![7], 0));
        // An open cavity binds the body to it.
        assert_eq!(counts(&[&outer[..], &cavity[1..]].concat()), (0, 0, vec![7], 0));
        let object = |part: u32, it: &[Triangle]| -> Vec<Triangle> {
            it.iter().map(|triangle| Triangle { part, ..*triangle }).collect()
        };
        assert_eq!(
            counts(&[&outer[..], &object(1, &cavity[1..])].concat()),
            (4, 0, vec![3], 0),
            "another object"
        );
        let distant = tetrahedron([2000; 3], 90, 0);
        assert_eq!(counts(&[&outer[..], &cavity, &distant[1..]].concat()), (8, 0, vec![3], 0));
    }
}
