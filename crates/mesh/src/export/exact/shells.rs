//! Shells of closed parts: bodies, each with its cavities.
//!
//! Two faces that are alone at an edge belong to the same shell. Where more faces meet at an edge,
//! bodies touch, or a body touches its cavity. Such an edge joins only shells that are not closed
//! yet, first those whose faces have solid between them.

use std::collections::HashMap;
use std::path::Path;

use super::Job;
use super::survey::{Survey, bounds_of, edges, join_bounds};
use spinney_base::io::Sorter;
use spinney_base::{Result, sort};
use spinney_brep::Face;
use spinney_brep::exact::union_find::UnionFind;

/// Bytes of memory for sorting edges.
const MEMORY: u64 = 64 << 20;

/// Bytes of an edge in the sort: its key, its face, the face's normal, and whether the face
/// traverses the edge from its second end.
const EDGE: usize = KEY + 4 + 24 + 1;

/// Bytes of the key: the part and the two ends.
const KEY: usize = 4 + 24;

/// Shell, and its position in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Shell {
    pub(super) number: u32,
    pub(super) part: u32,
    /// Number of solids of the part.
    pub(super) solids: u32,
    /// Index of the solid in the part. Its outer shell comes before those of its cavities.
    pub(super) solid: u32,
}

/// All shells, numbered in output order: part by part, then solid by solid. A part that is not
/// closed, or has no faces, counts as one shell.
pub(super) struct Shells {
    list: Vec<Shell>,
    /// First shell of each part, then the total number of shells.
    first: Vec<u32>,
    sets: UnionFind,
    /// Shells by set root, for parts that have several shells.
    of_root: HashMap<u32, u32>,
}

/// Measures of a shell or of a fragment of one.
#[derive(Clone, Copy)]
struct Measures {
    part: u32,
    /// Six times the volume, in cubic grid units; negative for cavities.
    volume: i128,
    /// Hash sum of the edges; 0 if the shell is closed.
    edges: u128,
    bounds: Option<[[i32; 3]; 2]>,
    /// Point on one of its faces.
    sample: [f64; 3],
}

impl Measures {
    fn of(face: &Face<'_>) -> Measures {
        Measures {
            part: face.part,
            volume: face.six_volumes(),
            edges: edges(face),
            bounds: bounds_of(face.points),
            sample: sample(face),
        }
    }

    fn add(&mut self, other: &Measures) {
        self.volume += other.volume;
        self.edges = self.edges.wrapping_add(other.edges);
        self.bounds = join_bounds(self.bounds, other.bounds);
    }

    /// Whether `cavity` may be a cavity of this body.
    fn may_hold(&self, cavity: &Measures) -> bool {
        let (Some([low, high]), Some([inner_low, inner_high])) = (self.bounds, cavity.bounds) else {
            return false;
        };
        let is_within = (0..3).all(|axis| low[axis] <= inner_low[axis] && inner_high[axis] <= high[axis]);
        self.volume >= 0 && cavity.volume < 0 && self.volume >= -cavity.volume && is_within
    }
}

/// Point inside a face, on none of its edges unless the face has no area. It is near the first
/// vertex in coordinate order, which is convex.
fn sample(face: &Face<'_>) -> [f64; 3] {
    let ring = face.rings().next().unwrap_or_default();
    let Some(at) = (0..ring.len()).min_by_key(|at| ring[*at]) else { return [0.0; 3] };
    let (before, after) = (ring[(at + ring.len() - 1) % ring.len()], ring[(at + 1) % ring.len()]);
    [0, 1, 2].map(|axis| {
        let [corner, before, after] = [ring[at], before, after].map(|point| f64::from(point[axis]));
        corner + ((before - corner) + (after - corner)) / 1024.0
    })
}

/// Solid angle of a face seen from a point, positive from its inner side; 0 if the point is in the
/// face's plane.
fn solid_angle(face: &Face<'_>, from: [f64; 3]) -> f64 {
    /// Distance in grid units below which a point is in the plane: far above rounding errors, which
    /// are about 1e-8.
    const IN_PLANE: f64 = 1e-6;
    let normal = face.area_vector();
    let length = dot(normal, normal).sqrt();
    let to = |point: [i32; 3]| [0, 1, 2].map(|axis| f64::from(point[axis]) - from[axis]);
    let Some(first) = face.points.first() else { return 0.0 };
    if length == 0.0 || (dot(normal, to(*first)) / length).abs() < IN_PLANE {
        return 0.0;
    }
    let mut sum = 0.0;
    for ring in face.rings() {
        let Some((first, rest)) = ring.split_first() else { continue };
        let a = to(*first);
        for pair in rest.windows(2) {
            let (b, c) = (to(pair[0]), to(pair[1]));
            let [la, lb, lc] = [a, b, c].map(|v| dot(v, v).sqrt());
            let volume = dot(a, cross(b, c));
            sum += 2.0 * volume.atan2(la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
        }
    }
    sum
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl Shells {
    pub(super) fn of(job: &Job<'_>, survey: &Survey, directory: &Path) -> Result<Shells> {
        let parts = job.faces.parts().len() as u32;
        let is_solid = |part: u32| survey.is_closed(part) && survey.bounds(part).is_some();
        let has_solids = (0..parts).any(is_solid) && job.faces.len() <= u64::from(u32::MAX);
        let (sets, roots) = match has_solids {
            true => find_shells(job, &is_solid, directory)?,
            false => {
                job.progress.advance(2 * job.faces.len(), job.passes * job.faces.len());
                (UnionFind::new(0), HashMap::new())
            }
        };
        let mut shells = Shells { list: Vec::new(), first: Vec::new(), sets, of_root: HashMap::new() };
        let mut by_part: Vec<(u32, u32)> = roots.iter().map(|(root, own)| (own.part, *root)).collect();
        sort::by(&mut by_part, &mut |a, b| a.cmp(b));
        let holders = find_holders(job, &roots, &by_part, &mut shells.sets)?;
        let mut all = by_part.chunk_by(|a, b| a.0 == b.0).peekable();
        for part in 0..parts {
            shells.first.push(shells.list.len() as u32);
            let own = all.next_if(|own| own[0].0 == part).unwrap_or_default();
            if own.len() < 2 {
                let number = shells.list.len() as u32;
                shells.list.push(Shell { number, part, solids: 1, solid: 0 });
                continue;
            }
            // Cavities follow the outer shell that contains them.
            let mut order: Vec<[u32; 2]> =
                own.iter().map(|(_, root)| [holders.get(root).copied().unwrap_or(*root), *root]).collect();
            sort::by(&mut order, &mut |a, b| (a[0], a[0] != a[1], a[1]).cmp(&(b[0], b[0] != b[1], b[1])));
            let solids = order.chunk_by(|a, b| a[0] == b[0]).count() as u32;
            for (solid, of_solid) in (0..).zip(order.chunk_by(|a, b| a[0] == b[0])) {
                for [_, root] in of_solid {
                    let number = shells.list.len() as u32;
                    shells.of_root.insert(*root, number);
                    shells.list.push(Shell { number, part, solids, solid });
                }
            }
        }
        shells.first.push(shells.list.len() as u32);
        Ok(shells)
    }

    /// Shell of a face, where `number` is the index of the face among all faces.
    pub(super) fn of_face(&mut self, face: &Face<'_>, number: u64) -> u32 {
        let first = self.first.get(face.part as usize).copied().unwrap_or(0);
        if self.of_root.is_empty() || self.count(face.part) < 2 {
            return first;
        }
        self.of_root.get(&self.sets.root(number as u32)).copied().unwrap_or(first)
    }

    /// Position of a shell.
    pub(super) fn get(&self, shell: u32) -> Shell {
        self.list.get(shell as usize).copied().unwrap_or_default()
    }

    /// Number of a part's first shell.
    pub(super) fn first(&self, part: u32) -> u32 {
        self.first.get(part as usize).copied().unwrap_or(0)
    }

    /// Number of shells of a part.
    pub(super) fn count(&self, part: u32) -> u32 {
        self.first.get(part as usize + 1).map_or(1, |next| next - self.first(part))
    }
}

/// Hash of an edge's key.
fn key_of(edge: &[u8]) -> u64 {
    xxhash_rust::xxh3::xxh3_64(&edge[..KEY])
}

/// Face of an edge.
fn face_of(edge: &[u8]) -> u32 {
    u32::from_le_bytes(edge[KEY..KEY + 4].try_into().unwrap_or_default())
}

/// Pairs of faces around an edge that have solid between them.
fn pairs_around(edges: &[Vec<u8>]) -> Vec<[u32; 2]> {
    /// Angle in radians below which two faces are coplanar: far above rounding errors.
    const IN_PLANE: f64 = 1e-9;
    let coordinate =
        |at: usize| f64::from(i32::from_le_bytes(edges[0][at..at + 4].try_into().unwrap_or_default()));
    let along = [0, 1, 2].map(|axis| coordinate(16 + 4 * axis) - coordinate(4 + 4 * axis));
    let along = along.map(|at| at / dot(along, along).sqrt());
    let (mut right, mut up) = ([0.0; 3], [0.0; 3]);
    let mut faces: Vec<(f64, bool, u32)> = Vec::new();
    for edge in edges {
        let number = |at: usize| f64::from_le_bytes(edge[at..at + 8].try_into().unwrap_or_default());
        let normal = [0, 1, 2].map(|axis| number(KEY + 4 + 8 * axis));
        // Going around the edge, solid begins at a face that traverses the edge backwards.
        let begins = edge[EDGE - 1] != 0;
        let into = cross(normal, along).map(|at| if begins { -at } else { at });
        if right == [0.0; 3] {
            (right, up) = (into, cross(along, into));
        }
        let angle = dot(into, up).atan2(dot(into, right));
        let angle = if angle < -IN_PLANE { angle + std::f64::consts::TAU } else { angle };
        faces.push((angle, begins, face_of(edge)));
    }
    sort::by(&mut faces, &mut |a, b| a.0.total_cmp(&b.0));
    // Among coplanar faces, ends come before beginnings.
    let mut start = 0;
    for end in 1..=faces.len() {
        if end == faces.len() || faces[end].0 - faces[end - 1].0 > IN_PLANE {
            sort::by(&mut faces[start..end], &mut |a, b| (a.1, a.2).cmp(&(b.1, b.2)));
            start = end;
        }
    }
    let (mut pairs, mut begun, mut ended) = (Vec::new(), Vec::new(), vec![false; faces.len()]);
    for round in 0..2 {
        for (at, (_, begins, face)) in faces.iter().enumerate() {
            if *begins && round == 0 {
                begun.push(*face);
            } else if !*begins
                && !ended[at]
                && let Some(other) = begun.pop()
            {
                ended[at] = true;
                pairs.push([other, *face]);
            }
        }
    }
    pairs
}

/// Sets of faces that are shells of closed parts, and measures by set root.
fn find_shells(
    job: &Job<'_>,
    is_solid: &dyn Fn(u32) -> bool,
    directory: &Path,
) -> Result<(UnionFind, HashMap<u32, Measures>)> {
    let mut sets = UnionFind::new(job.faces.len() as usize);
    let mut sorter = Sorter::new(directory, MEMORY);
    let mut number = 0u32;
    job.each(&mut |face| {
        let normal = face.area_vector();
        for ring in face.rings().filter(|_| is_solid(face.part)) {
            for (i, &from) in ring.iter().enumerate() {
                let to = ring[(i + 1) % ring.len()];
                let mut item = Vec::with_capacity(EDGE);
                item.extend(face.part.to_le_bytes());
                [from.min(to), from.max(to)]
                    .as_flattened()
                    .iter()
                    .for_each(|at| item.extend(at.to_le_bytes()));
                item.extend(number.to_le_bytes());
                normal.iter().for_each(|at| item.extend(at.to_le_bytes()));
                item.push(u8::from(from > to));
                sorter.push(key_of(&item), &item)?;
            }
        }
        number = number.wrapping_add(1);
        Ok(())
    })?;
    // Pairs of faces at edges where more than two meet.
    let (mut pairs, mut others) = (Vec::new(), Vec::new());
    let mut near: Vec<Vec<u8>> = Vec::new();
    let mut flush = |near: &mut Vec<Vec<u8>>, sets: &mut UnionFind| {
        sort::by(near, &mut |a, b| a.cmp(b));
        for same in near.chunk_by(|a, b| a[..KEY] == b[..KEY]) {
            match same {
                [a, b] => _ = sets.join(face_of(a), face_of(b)),
                _ => {
                    pairs.extend(pairs_around(same));
                    others.extend(same.windows(2).map(|pair| [face_of(&pair[0]), face_of(&pair[1])]));
                }
            }
        }
        near.clear();
    };
    let mut count = 0u64;
    sorter.finish(&mut |item| {
        count += 1;
        if count.is_multiple_of(1 << 14) {
            job.progress.check()?;
        }
        if near.last().is_some_and(|last| key_of(last) != key_of(item)) {
            flush(&mut near, &mut sets);
        }
        near.push(item.to_vec());
        Ok(())
    })?;
    flush(&mut near, &mut sets);

    let mut roots: HashMap<u32, Measures> = HashMap::new();
    number = 0;
    job.each(&mut |face| {
        if is_solid(face.part) {
            let own = Measures::of(face);
            let root = sets.root(number);
            roots.entry(root).and_modify(|measures| measures.add(&own)).or_insert(own);
        }
        number = number.wrapping_add(1);
        Ok(())
    })?;
    // (`others` covers pairs that were missed due to rounding of angles.)
    for [a, b] in pairs.into_iter().chain(others) {
        let (a, b) = (sets.root(a), sets.root(b));
        let is_open = |root: u32| roots.get(&root).is_some_and(|own| own.edges != 0);
        if a == b || !is_open(a) || !is_open(b) {
            continue;
        }
        if let [Some(mut own), Some(other)] = [a, b].map(|root| roots.remove(&root)) {
            own.add(&other);
            roots.insert(sets.join(a, b), own);
        }
    }
    Ok((sets, roots))
}

/// The body that contains each cavity, in parts with several shells. Maps the cavity's set root to
/// the body's.
fn find_holders(
    job: &Job<'_>,
    roots: &HashMap<u32, Measures>,
    by_part: &[(u32, u32)],
    sets: &mut UnionFind,
) -> Result<HashMap<u32, u32>> {
    let mut holders = HashMap::new();
    // Cavities that several bodies may contain, by body, each with the body's solid angle.
    let mut unsure: HashMap<u32, Vec<(u32, f64)>> = HashMap::new();
    for own in by_part.chunk_by(|a, b| a.0 == b.0).filter(|own| own.len() > 1) {
        job.progress.check()?;
        let bodies = own.iter().filter(|(_, root)| roots[root].volume >= 0);
        let bodies: Vec<u32> = bodies.map(|(_, root)| *root).collect();
        for (_, cavity) in own.iter().filter(|(_, root)| roots[root].volume < 0) {
            let mut possible = bodies.iter().filter(|body| roots[*body].may_hold(&roots[cavity]));
            match (possible.next(), possible.next()) {
                (Some(body), None) => _ = holders.insert(*cavity, *body),
                (None, _) => {}
                (Some(first), Some(second)) => {
                    for body in [first, second].into_iter().chain(possible) {
                        unsure.entry(*body).or_default().push((*cavity, 0.0));
                    }
                }
            }
        }
    }
    if unsure.is_empty() {
        return Ok(holders);
    }
    let mut number = 0u32;
    // (Few models need this pass, so progress does not count it.)
    job.faces.each(&mut |face| {
        if number.is_multiple_of(1024) {
            job.progress.check()?;
        }
        if let Some(cavities) = unsure.get_mut(&sets.root(number)) {
            for (cavity, angle) in cavities {
                *angle += solid_angle(face, roots[&*cavity].sample);
            }
        }
        number = number.wrapping_add(1);
        Ok(())
    })?;
    // The smallest body that contains the cavity.
    for (body, cavities) in unsure {
        for (cavity, angle) in cavities {
            if angle.abs() < std::f64::consts::TAU {
                continue;
            }
            let order = |body: u32| (roots[&body].volume, body);
            let held = holders.entry(cavity).or_insert(body);
            if order(body) < order(*held) {
                *held = body;
            }
        }
    }
    Ok(holders)
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_brep::{FaceList, Grid};

    fn list(parts: usize) -> FaceList {
        let names = (0..parts).map(|part| format!("part {part}")).collect();
        FaceList::new(Grid::over([[0.0; 3], [64.0; 3]], Some(1.0)).unwrap(), names)
    }

    /// Adds the sides of a box, inverted if it is a cavity.
    fn push_box(faces: &mut FaceList, part: u32, low: [i32; 3], high: [i32; 3], is_cavity: bool) {
        let corner = |number: usize| [0, 1, 2].map(|axis| [low, high][number >> axis & 1][axis]);
        for side in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            let mut points = side.map(corner);
            if is_cavity {
                points.reverse();
            }
            faces.push(&Face { number: 0, points: &points, ring_ends: &[4], colours: &[], part, source: 0 });
        }
    }

    /// Part, solid and number of each box's shell.
    fn shells(faces: &FaceList) -> Vec<(u32, u32, u32)> {
        let job = Job { faces, progress: &(), passes: 5 };
        let survey = Survey::of(&job).unwrap();
        let mut shells = Shells::of(&job, &survey, &std::env::temp_dir()).unwrap();
        let (mut found, mut number) = (Vec::new(), 0);
        job.each(&mut |face| {
            let shell = shells.of_face(face, number);
            if number % 6 == 0 {
                found.push(shells.get(shell));
            }
            assert_eq!(Some(&shells.get(shell)), found.last());
            number += 1;
            Ok(())
        })
        .unwrap();
        found.iter().map(|shell| (shell.part, shell.solid, shell.number)).collect()
    }

    #[test]
    fn cavities_are_in_their_bodies() {
        // A cavity before its body, a body in the cavity with a cavity of its own, and a body next
        // to them.
        let mut faces = list(1);
        push_box(&mut faces, 0, [2; 3], [30; 3], true);
        push_box(&mut faces, 0, [0; 3], [40; 3], false);
        push_box(&mut faces, 0, [5; 3], [20; 3], false);
        push_box(&mut faces, 0, [6; 3], [19; 3], true);
        push_box(&mut faces, 0, [50; 3], [60; 3], false);
        assert_eq!(shells(&faces), [(0, 0, 1), (0, 0, 0), (0, 1, 2), (0, 1, 3), (0, 2, 4)]);
    }

    #[test]
    fn boxes_around_cavities_do_not_decide() {
        // The bounding box of an L-shaped body contains the cavity's box, but the cavity is in the
        // other body.
        let mut faces = list(2);
        push_box(&mut faces, 1, [10; 3], [20; 3], false);
        push_box(&mut faces, 1, [12; 3], [14; 3], true);
        let l = [[0, 0], [60, 0], [60, 5], [5, 5], [5, 60], [0, 60]];
        let at = |z: i32| move |[x, y]: [i32; 2]| [x, y, z];
        let (bottom, top) = (l.map(at(0)), l.map(at(60)));
        let mut sides: Vec<Vec<[i32; 3]>> = vec![top.to_vec(), bottom.iter().rev().copied().collect()];
        for i in 0..6 {
            let j = (i + 1) % 6;
            sides.push(vec![bottom[i], bottom[j], top[j], top[i]]);
        }
        for side in &sides {
            faces.push(&Face {
                number: 0,
                points: side,
                ring_ends: &[side.len()],
                colours: &[],
                part: 1,
                source: 0,
            });
        }
        let job = Job { faces: &faces, progress: &(), passes: 5 };
        let survey = Survey::of(&job).unwrap();
        let mut shells = Shells::of(&job, &survey, &std::env::temp_dir()).unwrap();
        let mut found = Vec::new();
        job.each(&mut |face| {
            let shell = shells.of_face(face, found.len() as u64);
            found.push(shells.get(shell).solid);
            Ok(())
        })
        .unwrap();
        assert_eq!(found, [[0; 12].as_slice(), &[1; 8]].concat());
    }

    #[test]
    fn bodies_that_touch_are_apart_and_what_is_open_is_one() {
        // Two bodies share an edge, two share a vertex.
        let mut faces = list(3);
        push_box(&mut faces, 0, [0; 3], [4; 3], false);
        push_box(&mut faces, 0, [4, 4, 0], [8, 8, 4], false);
        push_box(&mut faces, 0, [8, 8, 4], [9; 3], false);
        push_box(&mut faces, 2, [0; 3], [4; 3], false);
        assert_eq!(shells(&faces), [(0, 0, 0), (0, 1, 1), (0, 2, 2), (2, 0, 4)]);
        // A cavity without a body.
        let mut faces = list(1);
        push_box(&mut faces, 0, [0; 3], [4; 3], true);
        push_box(&mut faces, 0, [14; 3], [18; 3], false);
        assert_eq!(shells(&faces), [(0, 0, 0), (0, 1, 1)]);
        let mut faces = list(1);
        push_box(&mut faces, 0, [0; 3], [4; 3], false);
        let points = [[0, 0, 9], [4, 0, 9], [0, 4, 9], [0, 0, 9]];
        for _ in 0..6 {
            faces.push(&Face {
                number: 0,
                points: &points[..3],
                ring_ends: &[3],
                colours: &[],
                part: 0,
                source: 0,
            });
        }
        assert_eq!(shells(&faces), [(0, 0, 0), (0, 0, 0)]);
    }

    #[test]
    fn walls_that_are_shared_divide_bodies() {
        // Four boxes around an edge, each of which shares walls with two others.
        let mut faces = list(1);
        push_box(&mut faces, 0, [0; 3], [4; 3], false);
        push_box(&mut faces, 0, [0, 0, 4], [4, 4, 8], false);
        push_box(&mut faces, 0, [4, 0, 0], [8, 4, 4], false);
        push_box(&mut faces, 0, [4, 0, 4], [8, 4, 8], false);
        assert_eq!(shells(&faces), [(0, 0, 0), (0, 1, 1), (0, 2, 2), (0, 3, 3)]);
        // A cavity that touches another one along an edge is a shell of its own.
        let mut faces = list(1);
        push_box(&mut faces, 0, [0; 3], [9; 3], false);
        push_box(&mut faces, 0, [2; 3], [4; 3], true);
        push_box(&mut faces, 0, [4, 4, 2], [6, 6, 4], true);
        assert_eq!(shells(&faces), [(0, 0, 0), (0, 0, 1), (0, 0, 2)]);
    }
}
