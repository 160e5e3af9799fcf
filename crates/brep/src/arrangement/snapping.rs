//! Snapping of edges to vertices that they pass closer than a grid unit.
//!
//! Rounding vertices makes triangles so thin that their planes mean nothing. Dividing these by each
//! other makes more of them. So, as in snap rounding (Hobby, 1999), an edge is bent to every vertex
//! that it comes near, and thin triangles collapse. The choice of vertices depends only on the
//! edge, so adjacent faces stay adjacent.

use crate::boxes::{BoxTree, touch};
use crate::exact::vector::{dot, subtract};
use crate::{Face, FaceList};
use spinney_base::{Progress, Result, sort};

/// Visitor of faces, with whether each is new.
pub(super) type EachFace<'a> = dyn FnMut(&Face<'_>, bool) -> Result<()> + 'a;

/// Yields all faces, with vertices added where edges pass closer than a grid unit to one of
/// `vertices`. A face is new if vertices were added, or if it was changed before. The vertices of a
/// new face may be coincident or not coplanar.
pub(super) fn snap(
    faces: &FaceList,
    vertices: &[[i32; 3]],
    changed: &[bool],
    progress: &dyn Progress,
    each: &mut EachFace<'_>,
) -> Result<()> {
    let mut keys: Vec<u128> = vertices.iter().map(|vertex| sort::point_key(*vertex)).collect();
    sort::watched(&mut keys, progress)?;
    keys.dedup();
    let unique: Vec<[i32; 3]> = keys.into_iter().map(sort::key_point).collect();
    let boxes: Vec<_> = (0..).zip(&unique).map(|(number, at)| (number, [*at; 2])).collect();
    let tree = BoxTree::watched(&boxes, progress)?;
    let (mut points, mut colours, mut ring_ends) = (Vec::new(), Vec::new(), Vec::new());
    let mut near = Vec::new();
    for (number, is_changed) in changed.iter().enumerate() {
        if number % 4096 == 0 {
            progress.check()?;
        }
        let face = faces.get(number);
        points.clear();
        colours.clear();
        ring_ends.clear();
        let mut added = 0;
        for ring in face.rings() {
            for (index, &from) in ring.iter().enumerate() {
                let colour = face.colours.get(points.len() - added).copied();
                points.push(from);
                between(&tree, &unique, [from, ring[(index + 1) % ring.len()]], &mut near);
                points.extend_from_slice(&near);
                colours.extend(colour.into_iter().cycle().take(1 + near.len()));
                added += near.len();
            }
            ring_ends.push(points.len());
        }
        let face = Face { points: &points, ring_ends: &ring_ends, colours: &colours, ..face };
        each(&face, added > 0 || *is_changed)?;
    }
    Ok(())
}

/// Collects the vertices that an edge passes closer than a grid unit, in its order: the same for
/// both directions.
fn between(tree: &BoxTree, vertices: &[[i32; 3]], [from, to]: [[i32; 3]; 2], near: &mut Vec<[i32; 3]>) {
    near.clear();
    let reach = [
        [0, 1, 2].map(|axis| from[axis].min(to[axis]) - 1),
        [0, 1, 2].map(|axis| from[axis].max(to[axis]) + 1),
    ];
    let minus = |a: [i32; 3], b: [i32; 3]| subtract(a.map(i128::from), b.map(i128::from));
    let along = minus(to, from);
    let length = dot(along, along);
    let mut found: Vec<(i128, [i32; 3])> = Vec::new();
    tree.each(&|bounds| touch(bounds, &reach), |number| {
        let vertex = vertices[number as usize];
        let there = minus(vertex, from);
        let projection = dot(there, along);
        // Squared distance from the edge's line, times the edge's squared length.
        let distance = dot(there, there) * length - projection * projection;
        if projection > 0 && projection < length && distance < length {
            found.push((projection, vertex));
        }
    });
    // Invariant: both faces of an edge bend it in the same way. The vertices are chosen by integers
    // that do not depend on the edge's direction. Vertices at the same position along the edge have
    // an order that reverses with the direction. Otherwise closed surfaces would become open.
    let is_forward = from < to;
    sort::by(&mut found, &mut |a, b| {
        a.0.cmp(&b.0).then_with(|| if is_forward { a.1.cmp(&b.1) } else { b.1.cmp(&a.1) })
    });
    near.extend(found.into_iter().map(|(_, vertex)| vertex));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_go_through_what_they_pass() {
        let vertices = [[50, 0, 1], [50, 1, 0], [30, 0, 0], [0, 0, 0], [70, 0, 2], [200, 1, 0]];
        let tree = BoxTree::of((0..).zip(&vertices).map(|(number, at)| (number, [*at; 2])).collect());
        let mut near = Vec::new();
        let ends = [[0, 0, 0], [100, 1, 1]];
        between(&tree, &vertices, ends, &mut near);
        let mut there = near.clone();
        assert_eq!(there, [[30, 0, 0], [50, 0, 1], [50, 1, 0]]);
        there.reverse();
        between(&tree, &vertices, [ends[1], ends[0]], &mut near);
        assert_eq!(near, there);
    }
}
