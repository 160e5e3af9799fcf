//! BSP trees of segments, polygons and faces.

use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_brep::exact::normal::triangle_normal;
use spinney_brep::geometry::Triangulator;
use spinney_brep::{ExactPlane, MAX_BITS};

use super::facet::{Facet, sides};
use super::{Bsp, BspPiece, Division};
use crate::preorder::Growing;

/// Most pieces that segments or faces may be cut into.
pub const MAX_PIECES: usize = 1 << 20;

/// Planes that are tried at each node.
const TRIED: usize = 8;

/// Plane pieces that a cut of one more weighs as much as, where sides have different numbers of pieces.
const CUT_WEIGHT: usize = 4;

impl Bsp {
    /// The tree of the plane that has these segments in its lines, each directed so that what is on its right is in front; no cell is inside.
    ///
    /// # Errors
    /// If a segment is a point or leaves the grid, or they are cut into more than [`MAX_PIECES`].
    pub fn of_segments(segments: &[[[i32; 2]; 2]]) -> Result<Bsp> {
        let pieces = segments.iter().enumerate();
        let pieces = pieces.map(|(source, segment)| piece_of_segment(source, *segment));
        grow(Dimension::Quad, pieces.collect::<Result<_>>()?, false)
    }

    /// The tree of the plane that is inside of these polygons: each an outer ring, and holes, whichever way they turn. Rings may touch in points.
    ///
    /// # Errors
    /// If a corner is outside of the grid, rings cross or have edges in common, or they are cut into more than [`MAX_PIECES`].
    pub fn of_polygons(polygons: &[Vec<Vec<[i32; 2]>>]) -> Result<Bsp> {
        let mut pieces = Vec::new();
        for (source, polygon) in polygons.iter().enumerate() {
            for (number, ring) in polygon.iter().enumerate() {
                let area = ring_edges(ring).map(|[[ax, ay], [bx, by]]| {
                    i128::from(ax) * i128::from(by) - i128::from(ay) * i128::from(bx)
                });
                // What is inside is on the left of an edge.
                let is_turned = (area.sum::<i128>() < 0) != (number > 0);
                for [from, to] in ring_edges(ring).filter(|[from, to]| from != to) {
                    let edge = if is_turned { [to, from] } else { [from, to] };
                    pieces.push(piece_of_segment(source, edge)?);
                }
            }
        }
        grow(Dimension::Quad, pieces, true)
    }

    /// The tree of space that is inside of a closed surface of faces: each an outer ring, counterclockwise as seen from outside, and holes.
    ///
    /// # Errors
    /// If a corner is outside of the grid, a face cannot be cut into triangles, the surface is open or crosses itself, or it is cut into more than
    /// [`MAX_PIECES`].
    pub fn of_faces(faces: &[Vec<Vec<[i32; 3]>>]) -> Result<Bsp> {
        let (mut pieces, mut triangulator) = (Vec::new(), Triangulator::new());
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
                // (One without an area bounds nothing.)
                if normal != [0; 3] {
                    let plane = ExactPlane::through(corners[0], normal);
                    pieces.push(BspPiece { source, facet: Facet::of_triangle(plane, &corners) });
                }
            }
        }
        grow(Dimension::Oct, pieces, true)
    }

    /// The tree of space that has these triangles in its planes, each counterclockwise as seen from where it is in front; no cell is inside. They
    /// need not be closed, and may touch and pass through each other. Those without an area are left out.
    ///
    /// # Errors
    /// If a corner is outside of the grid, or they are cut into more than [`MAX_PIECES`].
    pub fn of_triangles(triangles: &[[[i32; 3]; 3]]) -> Result<Bsp> {
        let mut pieces = Vec::new();
        for (source, corners) in triangles.iter().enumerate() {
            corners.iter().try_for_each(|corner| check(source, *corner))?;
            let normal = triangle_normal(corners);
            if normal != [0; 3] {
                let plane = ExactPlane::through(corners[0], normal);
                pieces.push(BspPiece { source, facet: Facet::of_triangle(plane, corners) });
            }
        }
        grow(Dimension::Oct, pieces, false)
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
            format!("a corner at {corner:?}"),
            "coordinates from 0 to 67108863",
        )),
    }
}

/// The wall over a segment.
fn piece_of_segment(source: usize, [[px, py], [qx, qy]]: [[i32; 2]; 2]) -> Result<BspPiece> {
    let at = |z: i32| ([px, py, z], [qx, qy, z]);
    let ((p, q), (above_p, above_q)) = (at(0), at(1));
    check(source, p)?;
    check(source, q)?;
    if p == q {
        return Err(Error::invalid(format!("segment {source}"), format!("the point {px}, {py}"), "two ends"));
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
    Ok(BspPiece { source, facet: Facet::of_grid(wall(p, [dy, -dx, 0]), &edges) })
}

/// The tree of pieces; of solid ones, what is behind their planes is inside.
fn grow(dimension: Dimension, pieces: Vec<BspPiece>, is_solid: bool) -> Result<Bsp> {
    let mut made = Growing::new(|by: &Division| !by.pieces.is_empty());
    let mut count = pieces.len();
    // Pieces in cells that are to come, with what a cell without any is.
    let mut pending = vec![(pieces, false)];
    while let Some((pieces, is_inside)) = pending.pop() {
        if count > MAX_PIECES {
            let found = format!("more than {MAX_PIECES} pieces of segments or faces");
            return Err(Error::invalid("BSP tree", found, format!("at most {MAX_PIECES}")));
        }
        if pieces.is_empty() {
            made.leaf(is_inside);
            continue;
        }
        let plane = choose(&pieces);
        let (mut within, mut parts) = (Vec::new(), [const { Vec::new() }; 2]);
        for piece in pieces {
            let signs = piece.facet.signs(&plane);
            match sides(&signs) {
                [false, false] => within.push(piece),
                [true, false] => parts[0].push(piece),
                [false, true] => parts[1].push(piece),
                [true, true] => {
                    count += 1;
                    for (part, facet) in parts.iter_mut().zip(piece.facet.cut(&plane, &signs)) {
                        part.push(BspPiece { source: piece.source, facet });
                    }
                }
            }
        }
        // Where nothing else is, the pieces in the plane tell what is on both of their sides.
        let is_behind = within.first().is_some_and(|piece: &BspPiece| piece.facet.plane.is_turned_as(&plane));
        made.divide(Division { plane, pieces: within });
        let [behind, before] = parts;
        pending.extend([(before, is_solid && !is_behind), (behind, is_solid && is_behind)]);
    }
    let tree = Bsp { dimension, nodes: made.finish() };
    if is_solid {
        tree.check_boundary()?;
    }
    Ok(tree)
}

/// The plane of a few that cuts few pieces, and has about as many on both sides.
fn choose(pieces: &[BspPiece]) -> ExactPlane {
    let tried =
        (0..TRIED.min(pieces.len())).map(|i| pieces[i * pieces.len() / TRIED.min(pieces.len())].facet.plane);
    let weight = |plane: &ExactPlane| {
        let (mut cuts, mut behind, mut before) = (0, 0usize, 0);
        for piece in pieces {
            let [is_behind, is_before] = sides(&piece.facet.signs(plane));
            cuts += usize::from(is_behind && is_before);
            behind += usize::from(is_behind);
            before += usize::from(is_before);
        }
        CUT_WEIGHT * cuts + behind.abs_diff(before)
    };
    // (There is a piece at least.)
    tried.min_by_key(weight).unwrap_or(pieces[0].facet.plane)
}
