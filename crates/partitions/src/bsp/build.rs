//! BSP trees of segments, polygons and faces.

use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_brep::exact::normal::triangle_normal;
use spinney_brep::geometry::Triangulator;
use spinney_brep::{ExactPlane, MAX_BITS};

use super::facet::{Facet, sides};
use super::{Bsp, BspFragment, Division};
use crate::preorder::PreorderBuilder;

/// Maximum number of fragments that segments or faces may be cut into.
pub const MAX_FRAGMENTS: usize = 1 << 20;

/// Candidate planes per node.
const TRIED: usize = 8;

/// Cost of a cut, relative to one fragment of imbalance between the two sides.
const CUT_WEIGHT: usize = 4;

impl Bsp {
    /// Builds a tree of the plane with these segments in its lines. The right side of a segment is
    /// in front. No cell is inside.
    ///
    /// # Errors
    /// If a segment is a point or leaves the grid, or there are more than [`MAX_FRAGMENTS`]
    /// fragments.
    pub fn of_segments(segments: &[[[i32; 2]; 2]]) -> Result<Bsp> {
        let fragments = segments.iter().enumerate();
        let fragments = fragments.map(|(source, segment)| fragment_of_segment(source, *segment));
        grow(Dimension::Quad, fragments.collect::<Result<_>>()?, false)
    }

    /// Builds a tree of the plane whose inside is that of these polygons. Each is an outer ring,
    /// followed by holes; rings may have either orientation and may touch in points.
    ///
    /// # Errors
    /// If a vertex is outside of the grid, rings cross or share edges, or there are more than
    /// [`MAX_FRAGMENTS`] fragments.
    pub fn of_polygons(polygons: &[Vec<Vec<[i32; 2]>>]) -> Result<Bsp> {
        let mut fragments = Vec::new();
        for (source, polygon) in polygons.iter().enumerate() {
            for (number, ring) in polygon.iter().enumerate() {
                let area = ring_edges(ring).map(|[[ax, ay], [bx, by]]| {
                    i128::from(ax) * i128::from(by) - i128::from(ay) * i128::from(bx)
                });
                // The inside is on the left of an edge.
                let is_turned = (area.sum::<i128>() < 0) != (number > 0);
                for [from, to] in ring_edges(ring).filter(|[from, to]| from != to) {
                    let edge = if is_turned { [to, from] } else { [from, to] };
                    fragments.push(fragment_of_segment(source, edge)?);
                }
            }
        }
        grow(Dimension::Quad, fragments, true)
    }

    /// Builds a tree of space whose inside is bounded by a closed surface. Each face is an outer
    /// ring, counterclockwise seen from outside, followed by holes.
    ///
    /// # Errors
    /// If a vertex is outside of the grid, a face cannot be triangulated, the surface is open or
    /// self-intersects, or there are more than [`MAX_FRAGMENTS`] fragments.
    pub fn of_faces(faces: &[Vec<Vec<[i32; 3]>>]) -> Result<Bsp> {
        let (mut fragments, mut triangulator) = (Vec::new(), Triangulator::new());
        for (source, rings) in faces.iter().enumerate() {
            let corners: Vec<_> = rings.iter().flatten().map(|corner| corner.map(i64::from)).collect();
            let mut end = 0;
            let ends = rings.iter().map(|ring| {
                end += ring.len();
                end
            });
            let mut triangles = Vec::new();
            if !triangulator.triangulate(&corners, &ends.collect::<Vec<_>>(), &mut triangles) {
                return Err(Error::invalid(
                    format!("face {source}"),
                    "rings that cross or have no area",
                    "a polygon with holes",
                ));
            }
            let corners: Vec<_> = rings.iter().flatten().collect();
            for triangle in triangles {
                let corners = triangle.map(|corner| *corners[corner as usize]);
                corners.iter().try_for_each(|corner| check(source, *corner))?;
                let normal = triangle_normal(&corners);
                // A triangle without area bounds nothing.
                if normal != [0; 3] {
                    let plane = ExactPlane::through(corners[0], normal);
                    fragments.push(BspFragment { source, facet: Facet::of_triangle(plane, &corners) });
                }
            }
        }
        grow(Dimension::Oct, fragments, true)
    }

    /// Builds a tree of space with these triangles in its planes. A triangle is counterclockwise
    /// seen from its front. No cell is inside. The triangles need not be closed, and may touch and
    /// intersect. Those without area are skipped.
    ///
    /// # Errors
    /// If a vertex is outside of the grid, or there are more than [`MAX_FRAGMENTS`] fragments.
    pub fn of_triangles(triangles: &[[[i32; 3]; 3]]) -> Result<Bsp> {
        let mut fragments = Vec::new();
        for (source, corners) in triangles.iter().enumerate() {
            corners.iter().try_for_each(|corner| check(source, *corner))?;
            let normal = triangle_normal(corners);
            if normal != [0; 3] {
                let plane = ExactPlane::through(corners[0], normal);
                fragments.push(BspFragment { source, facet: Facet::of_triangle(plane, corners) });
            }
        }
        grow(Dimension::Oct, fragments, false)
    }
}

fn ring_edges(ring: &[[i32; 2]]) -> impl Iterator<Item = [[i32; 2]; 2]> {
    ring.iter().zip(ring.iter().cycle().skip(1)).map(|(from, to)| [*from, *to])
}

fn check(source: usize, corner: [i32; 3]) -> Result<()> {
    match corner.iter().all(|at| (0..1 << MAX_BITS).contains(at)) {
        true => Ok(()),
        false => Err(Error::invalid(
            format!("shape {source}"),
            format!("a vertex at {corner:?}"),
            "coordinates from 0 to 67108863",
        )),
    }
}

/// Wall of height 1 over a segment.
fn fragment_of_segment(source: usize, [[px, py], [qx, qy]]: [[i32; 2]; 2]) -> Result<BspFragment> {
    let at = |z: i32| ([px, py, z], [qx, qy, z]);
    let ((p, q), (above_p, above_q)) = (at(0), at(1));
    check(source, p)?;
    check(source, q)?;
    if p == q {
        return Err(Error::invalid(
            format!("segment {source}"),
            format!("the point {px}, {py}"),
            "two different ends",
        ));
    }
    let [dx, dy] = [i64::from(qx) - i64::from(px), i64::from(qy) - i64::from(py)];
    let across = if dx.abs() >= dy.abs() { [1, 0, 0] } else { [0, 1, 0] };
    let wall = ExactPlane::through;
    let edges = [
        (p, wall(p, [0, 0, 1])),
        (q, wall(q, across)),
        (above_q, wall(above_q, [0, 0, 1])),
        (above_p, wall(p, across)),
    ];
    Ok(BspFragment { source, facet: Facet::of_grid(wall(p, [dy, -dx, 0]), &edges) })
}

/// Builds the tree of fragments. If `is_solid`, the back of each fragment is inside.
fn grow(dimension: Dimension, fragments: Vec<BspFragment>, is_solid: bool) -> Result<Bsp> {
    let mut made = PreorderBuilder::new(|by: &Division| !by.fragments.is_empty());
    let mut count = fragments.len();
    // Fragments of cells that are still to be divided, and whether the cell is inside if it has
    // none.
    let mut pending = vec![(fragments, false)];
    while let Some((fragments, is_inside)) = pending.pop() {
        if count > MAX_FRAGMENTS {
            let found = format!("more than {MAX_FRAGMENTS} fragments of segments or faces");
            return Err(Error::invalid("BSP tree", found, format!("at most {MAX_FRAGMENTS}")));
        }
        if fragments.is_empty() {
            made.leaf(is_inside);
            continue;
        }
        let plane = choose(&fragments);
        let (mut within, mut parts) = (Vec::new(), [const { Vec::new() }; 2]);
        for fragment in fragments {
            let signs = fragment.facet.signs(&plane);
            match sides(&signs) {
                [false, false] => within.push(fragment),
                [true, false] => parts[0].push(fragment),
                [false, true] => parts[1].push(fragment),
                [true, true] => {
                    count += 1;
                    for (part, facet) in parts.iter_mut().zip(fragment.facet.cut(&plane, &signs)) {
                        part.push(BspFragment { source: fragment.source, facet });
                    }
                }
            }
        }
        // If a side has no other fragments, those in the plane determine whether it is inside.
        let is_back =
            within.first().is_some_and(|fragment: &BspFragment| fragment.facet.plane.is_turned_as(&plane));
        made.divide(Division { plane, fragments: within });
        let [back, front] = parts;
        pending.extend([(front, is_solid && !is_back), (back, is_solid && is_back)]);
    }
    let tree = Bsp { dimension, nodes: made.finish() };
    if is_solid {
        tree.check_boundary()?;
    }
    Ok(tree)
}

/// Chooses from a few candidates a plane that cuts few fragments and balances both sides.
fn choose(fragments: &[BspFragment]) -> ExactPlane {
    let tried = (0..TRIED.min(fragments.len()))
        .map(|i| fragments[i * fragments.len() / TRIED.min(fragments.len())].facet.plane);
    let weight = |plane: &ExactPlane| {
        let (mut cuts, mut back, mut front) = (0, 0usize, 0);
        for fragment in fragments {
            let [is_back, is_front] = sides(&fragment.facet.signs(plane));
            cuts += usize::from(is_back && is_front);
            back += usize::from(is_back);
            front += usize::from(is_front);
        }
        CUT_WEIGHT * cuts + back.abs_diff(front)
    };
    // There is at least one fragment.
    tried.min_by_key(weight).unwrap_or(fragments[0].facet.plane)
}
