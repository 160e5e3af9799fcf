//! Polygons of BSP trees of the plane.

use spinney_base::space::Dimension;
use spinney_base::{Error, Result, sort};
use spinney_brep::ExactPoint;

use super::Bsp;
use super::sections::Boundary;

/// Edge of the boundary, with the inside on its left.
struct Edge {
    ends: [ExactPoint; 2],
    /// Point indices of the ends.
    corners: [usize; 2],
    direction: [i64; 2],
}

impl Bsp {
    /// Returns the rings around the inside of a tree of the plane. With y upwards, the inside is on
    /// their left: outer rings are counterclockwise, holes clockwise. Rings touch each other at
    /// most in vertices, and do not touch themselves.
    ///
    /// Vertices are doubles: exact for grid points, otherwise off by less than 2^-24 grid units.
    ///
    /// # Errors
    /// If it is a tree of space, or the inside extends beyond the grid, where its rings would not
    /// close.
    pub fn outlines(&self) -> Result<Vec<Vec<[f64; 2]>>> {
        if self.dimension != Dimension::Quad {
            return Err(Error::invalid("BSP tree", "a tree of space", "a tree of the plane"));
        }
        let mut edges = Vec::new();
        self.each_section(&mut |by, below, section| {
            let parts = self.on_both_sides(&by.plane, below, section).into_iter();
            edges.extend(
                parts.filter(|part| part.is_inside[0] != part.is_inside[1]).map(|part| edge_of(&part)),
            );
            Ok(())
        })?;
        let points = number(&mut edges);
        let mut leaving = vec![Vec::new(); points.len()];
        for (edge, Edge { corners, .. }) in edges.iter().enumerate() {
            leaving[corners[0]].push(edge);
        }
        let mut rings = Vec::new();
        // Position of each point in the current ring.
        let mut ring_positions = vec![None; points.len()];
        for first in 0..edges.len() {
            let (mut next, mut ring) = (Some(first), Vec::new());
            while let Some(edge) = next {
                let Edge { corners: [from, to], direction, .. } = edges[edge];
                let Some(position) = leaving[from].iter().position(|other| *other == edge) else { break };
                leaving[from].swap_remove(position);
                ring_positions[from] = Some(ring.len());
                ring.push((from, direction));
                // A ring that returns to one of its points is closed, from there on.
                if let Some(position) = ring_positions[to] {
                    let whole = ring.split_off(position);
                    whole.iter().for_each(|(point, _)| ring_positions[*point] = None);
                    rings.push(corners_of(&whole, &points));
                }
                let directions = leaving[to].iter().copied();
                next = directions.reduce(|best, other| {
                    let is_sharper = is_sharper(direction, edges[other].direction, edges[best].direction);
                    if is_sharper { other } else { best }
                });
                if ring.is_empty() {
                    break;
                }
            }
            if !ring.is_empty() {
                let found = "an inside that extends beyond the grid";
                return Err(Error::invalid("BSP tree", found, "an inside within the grid, 0 to 67108863"));
            }
        }
        Ok(rings)
    }
}

/// Vertices of a ring, without collinear points.
fn corners_of(ring: &[(usize, [i64; 2])], points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let before = ring.iter().cycle().skip(ring.len() - 1);
    let corners = ring.iter().zip(before).filter(|((_, along), (_, before))| turn(*before, *along) != 0);
    corners.map(|((point, _), _)| points[*point]).collect()
}

/// Bottom edge of a prism's wall.
fn edge_of(wall: &Boundary) -> Edge {
    let [x, y, _] = wall.facet.plane.normal;
    let direction = if wall.is_inside[0] { [-y, x] } else { [y, -x] };
    let axis = usize::from(direction[0] == 0);
    let mut foot = wall.facet.edges.iter().map(|edge| edge.start).filter(|corner| corner.near[2] == 0.0);
    // Each wall has two vertices at the bottom.
    let (Some(a), Some(b)) = (foot.next(), foot.next()) else { unreachable!("a wall has a bottom edge") };
    let rises = a.compare(&b, axis).is_lt();
    let ends = if rises == (direction[axis] > 0) { [a, b] } else { [b, a] };
    Edge { ends, corners: [0; 2], direction }
}

/// Assigns the same index to equal ends of edges, and returns the points.
fn number(edges: &mut [Edge]) -> Vec<[f64; 2]> {
    let mut ends: Vec<_> = (0..2 * edges.len()).collect();
    let point = |edges: &[Edge], end: usize| edges[end / 2].ends[end % 2];
    sort::by(&mut ends, &mut |a, b| {
        let (a, b) = (point(edges, *a), point(edges, *b));
        a.compare(&b, 0).then_with(|| a.compare(&b, 1))
    });
    let mut points = Vec::new();
    let mut last: Option<ExactPoint> = None;
    for end in ends {
        let found = point(edges, end);
        if !last.is_some_and(|last| last.is(&found)) {
            let [x, y, _] = found.settled().near;
            points.push([x, y]);
            last = Some(found);
        }
        edges[end / 2].corners[end % 2] = points.len() - 1;
    }
    points
}

/// Turn from one direction to another: 1 is left, -1 right, 0 straight.
fn turn([ax, ay]: [i64; 2], [bx, by]: [i64; 2]) -> i128 {
    (i128::from(ax) * i128::from(by) - i128::from(ay) * i128::from(bx)).signum()
}

/// Whether `direction` turns farther to the left than `other`, for a path that arrives in direction
/// `along`.
fn is_sharper(along: [i64; 2], direction: [i64; 2], other: [i64; 2]) -> bool {
    match (turn(along, direction), turn(along, other)) {
        (a, b) if a != b => a > b,
        _ => turn(other, direction) > 0,
    }
}
