//! Polygons of BSP trees of space.

use std::cmp::Ordering;

use spinney_base::space::Dimension;
use spinney_base::{Error, Progress, Result, sort};
use spinney_brep::{ExactPlane, ExactPoint, MAX_BITS, UnitedVertex, unite_facets};

use super::Bsp;
use super::facet::Facet;

/// Vertex coordinates of a polygon's rings: the outer ring first, then holes.
type Rings = Vec<Vec<[f64; 3]>>;

/// Plane of a polygon, and its rings.
type PlanePolygon = (ExactPlane, Vec<Vec<UnitedVertex>>);

/// End of the domain of trees, which begins at -1.
const FAR: i32 = 1 << MAX_BITS;

fn beyond() -> Error {
    let found = "an inside that extends beyond the grid";
    Error::invalid("BSP tree", found, "an inside within the grid, 0 to 67108863")
}

impl Bsp {
    /// Refuses a tree that has corners of the domain inside.
    pub(super) fn check_bounded(&self) -> Result<()> {
        let corners = (0..8).map(|bits| [0, 1, 2].map(|axis| if bits >> axis & 1 == 1 { FAR } else { -1 }));
        if { corners }.any(|corner| self.is_inside(corner)) { Err(beyond()) } else { Ok(()) }
    }

    /// Returns the polygons around the inside of a tree of space: one for each connected part of
    /// the boundary in a plane. Outer rings are counterclockwise as seen from outside, holes
    /// clockwise. An edge has the vertices at which any polygon turns, so that edges of neighbours
    /// match.
    ///
    /// Vertices are doubles: exact for grid points, otherwise off by less than 2^-24 grid units.
    ///
    /// # Errors
    /// If it is a tree of the plane, the inside extends beyond the grid, or on cancellation.
    pub fn polygons(&self, progress: &dyn Progress) -> Result<Vec<Rings>> {
        if self.dimension != Dimension::Oct {
            return Err(Error::invalid("BSP tree", "a tree of the plane", "a tree of space"));
        }
        self.check_bounded()?;
        let mut facets = Vec::new();
        self.each_section(&mut |by, below, section| {
            progress.check()?;
            for part in self.on_both_sides(&by.plane, below, section) {
                let plane = match part.is_inside {
                    [true, false] => by.plane,
                    [false, true] => by.plane.turned(),
                    _ => continue,
                };
                let is_at_end = |at: &f64| *at <= -1.0 || *at >= f64::from(FAR);
                if part.facet.edges.iter().any(|edge| edge.start.near.iter().any(is_at_end)) {
                    return Err(beyond());
                }
                facets.push(Facet { plane: plane.reduced(), ..part.facet });
            }
            Ok(())
        })?;
        sort::by(&mut facets, &mut |a, b| order(&a.plane, &b.plane));
        let mut polygons = Vec::new();
        // Invariant: facets of one plane have disjoint interiors, since each is in another cell of
        // the tree. Reduced planes are equal if and only if they have the same points and front.
        // Their union would lose what overlaps, and a plane in two groups would leave edges between
        // them in the polygons.
        for facets in facets.chunk_by(|a, b| a.plane == b.plane) {
            let vertices = |facet: &Facet| facet.edges.iter().map(|edge| (edge.start, edge.wall)).collect();
            let facets_of_plane: Vec<_> = facets.iter().map(vertices).collect();
            let found = unite_facets(&facets[0].plane, &facets_of_plane, &|| progress.interrupted());
            progress.check()?;
            polygons.extend(found.unwrap_or_default().into_iter().map(|rings| (facets[0].plane, rings)));
        }
        Ok(with_common_vertices(&polygons))
    }
}

fn order(a: &ExactPlane, b: &ExactPlane) -> Ordering {
    a.normal.cmp(&b.normal).then(a.offset.cmp(&b.offset))
}

fn compare(a: &ExactPoint, b: &ExactPoint) -> Ordering {
    a.compare(b, 0).then_with(|| a.compare(b, 1)).then_with(|| a.compare(b, 2))
}

/// Returns the rings with the vertices at which any ring turns: without those in the middle of
/// edges that are straight everywhere, and with those in the middle of an edge at which another one
/// ends.
fn with_common_vertices(polygons: &[PlanePolygon]) -> Vec<Rings> {
    let vertices = polygons.iter().flat_map(|(_, rings)| rings).flatten();
    let mut turning: Vec<ExactPoint> =
        vertices.filter(|vertex| vertex.turns).map(|vertex| vertex.point).collect();
    sort::by(&mut turning, &mut compare);
    turning.dedup_by(|a, b| a.is(b));
    let ring = |plane: &ExactPlane, ring: &Vec<UnitedVertex>| {
        // Invariant: the plane of a vertex's edge contains all of the straight edge to the next
        // corner, which consists of edges on one line. So points between the ends are found by both
        // planes, for all polygons alike: no edge ends in the middle of another one.
        let corners: Vec<&UnitedVertex> = ring.iter().filter(|vertex| vertex.turns).collect();
        let mut points = Vec::with_capacity(corners.len());
        for (i, UnitedVertex { point, line, .. }) in corners.iter().enumerate() {
            points.push(point.settled().near);
            let next = &corners[(i + 1) % corners.len()].point;
            points.extend(between(&turning, [point, next], [plane, line]));
        }
        points
    };
    polygons.iter().map(|(plane, rings)| rings.iter().map(|own| ring(plane, own)).collect()).collect()
}

/// Returns those of some sorted points that lie between the ends of an edge in two planes, from its
/// start to its end.
fn between(points: &[ExactPoint], ends: [&ExactPoint; 2], planes: [&ExactPlane; 2]) -> Vec<[f64; 3]> {
    let is_reversed = compare(ends[0], ends[1]).is_gt();
    let [low, high] = if is_reversed { [ends[1], ends[0]] } else { ends };
    let first = points.partition_point(|point| compare(point, low).is_le());
    let inner = points[first..].iter().take_while(|point| compare(point, high).is_lt());
    let on_edge = inner.filter(|point| planes.iter().all(|plane| plane.side(point) == 0));
    let mut found: Vec<[f64; 3]> = on_edge.map(|point| point.settled().near).collect();
    if is_reversed {
        found.reverse();
    }
    found
}
