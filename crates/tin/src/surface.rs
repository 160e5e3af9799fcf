//! Surfaces of scattered points, with lines that become edges.

use crate::mesh::{Lines, Mesh, NONE};
use crate::tin::Tin;
use spinney_base::{Error, Result};
use spinney_crs::PolygonParts;

/// Rule for points at the same position with different heights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Duplicates {
    /// Reports an error.
    #[default]
    Refuse,
    /// Uses the mean of the heights.
    Mean,
}

/// Points and lines of a surface.
#[derive(Clone, Debug, Default)]
pub struct SurfaceInput {
    /// Points of the surface.
    pub points: Vec<[f64; 3]>,
    /// Lines that become edges, such as faults and ridges. A vertex with the height NaN gets the
    /// height of the surface through the other points.
    pub breaklines: Vec<Vec<[f64; 3]>>,
    /// Polygons, each an outer ring and its holes, that bound the surface. Without any, the surface
    /// covers the convex hull of the points.
    pub outlines: PolygonParts,
    /// Rule for points at the same position with different heights.
    pub duplicates: Duplicates,
}

/// Statistics of a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceReport {
    /// Number of points at the position of another point.
    pub duplicates: u64,
    /// Number of positions with different heights, which were averaged.
    pub averaged: u64,
    /// Number of line vertices outside of the convex hull of all points with heights. They get the
    /// height of the nearest point on the hull.
    pub extended: u64,
    /// Number of vertices that were created where outlines cross breaklines.
    pub crossings: u64,
}

/// Distinct positions, ordered by x and y, with their heights.
#[derive(Default)]
pub(crate) struct DistinctPoints {
    pub positions: Vec<[f64; 2]>,
    pub heights: Vec<f64>,
}

impl DistinctPoints {
    /// Sorts points by position and merges those at the same position.
    ///
    /// # Errors
    /// If a number is not finite, or if heights at a position differ and `duplicates` refuses that.
    pub(crate) fn of(
        points: &[[f64; 3]],
        duplicates: Duplicates,
        report: &mut SurfaceReport,
    ) -> Result<DistinctPoints> {
        if let Some(point) = points.iter().find(|point| point.iter().any(|at| !at.is_finite())) {
            return Err(Error::invalid("point of a surface", format!("{point:?}"), "finite numbers"));
        }
        // (Adding 0.0 turns -0.0 into 0.0.)
        let mut sorted: Vec<[f64; 3]> = points.iter().map(|point| point.map(|at| at + 0.0)).collect();
        sorted.sort_by(|a, b| order(a, b).then(a[2].total_cmp(&b[2])));
        let mut distinct = DistinctPoints::default();
        for same in sorted.chunk_by(|a, b| order(a, b).is_eq()) {
            let [x, y, lowest] = same[0];
            let highest = same[same.len() - 1][2];
            report.duplicates += same.len() as u64 - 1;
            let mut height = lowest;
            if highest > lowest {
                if duplicates == Duplicates::Refuse {
                    let found = format!("heights from {lowest} to {highest} at {x}, {y}");
                    return Err(Error::invalid(
                        "points of a surface",
                        found,
                        "one height per position, or duplicates as the mean",
                    ));
                }
                report.averaged += 1;
                let above: f64 = same.iter().map(|point| (point[2] - lowest) / same.len() as f64).sum();
                height = (lowest + above).min(highest);
            }
            distinct.positions.push([x, y]);
            distinct.heights.push(height);
        }
        Ok(distinct)
    }

    /// Returns the index of a position.
    pub(crate) fn number(&self, [x, y]: [f64; 2]) -> Option<u32> {
        let position = [x, y].map(|at| at + 0.0);
        let found = self.positions.binary_search_by(|other| order(other, &position));
        found.ok().map(|number| number as u32)
    }
}

/// Compares positions.
pub(crate) fn order(a: &[f64], b: &[f64]) -> std::cmp::Ordering {
    a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
}

/// Triangulates scattered points: the result is their Delaunay triangulation with lines as edges.
/// Vertices of outlines, and vertices of breaklines without heights, get the heights of the surface
/// without them.
///
/// # Errors
/// If all points are on one line; if a number is not finite; if heights at a position differ and
/// the input refuses that; if breaklines cross other than in vertices.
pub fn triangulate(input: &SurfaceInput) -> Result<(Tin, SurfaceReport)> {
    let mut report = SurfaceReport::default();
    let known = input.breaklines.iter().flatten().filter(|corner| !corner[2].is_nan());
    let all: Vec<[f64; 3]> = input.points.iter().chain(known).copied().collect();
    let mut distinct = DistinctPoints::of(&all, input.duplicates, &mut report)?;
    // (Vertices shared by consecutive segments do not count as duplicates.)
    let alone = DistinctPoints::of(&input.points, Duplicates::Mean, &mut SurfaceReport::default())?;
    report.duplicates = (input.points.len() - alone.positions.len()) as u64;

    let unknown = input.breaklines.iter().flatten().filter(|corner| corner[2].is_nan());
    let unknown: Vec<[f64; 2]> = unknown.map(|corner| [corner[0], corner[1]]).collect();
    let free = Lines { breaklines: &[], outlines: &[] };
    if !unknown.is_empty() {
        let plain = Tin { mesh: Mesh::new(&distinct.positions, &free)?, heights: distinct.heights.clone() };
        distinct = add(distinct, &plain, &unknown, &mut report)?;
    }
    let breaklines = segments(&input.breaklines, &distinct);
    let lines = Lines { breaklines: &breaklines, outlines: &[] };
    let tin = Tin { mesh: Mesh::new(&distinct.positions, &lines)?, heights: distinct.heights.clone() };
    if input.outlines.is_empty() {
        return Ok((tin, report));
    }
    let corners: Vec<[f64; 2]> = input.outlines.iter().flatten().flatten().copied().collect();
    let distinct = add(distinct, &tin, &corners, &mut report)?;
    let breaklines = segments(&input.breaklines, &distinct);
    let outlines = ring_segments(&input.outlines, &distinct);
    let mut mesh = Mesh::new(&distinct.positions, &Lines { breaklines: &breaklines, outlines: &outlines })?;
    let mut heights = distinct.heights;
    let (boundary, mut near) = (tin.mesh.boundary(), 0);
    for position in &mesh.points[heights.len()..] {
        heights.push(tin.extended(*position, &mut near, &boundary).0);
        report.crossings += 1;
    }
    let inside = inside(&mesh, &input.outlines);
    let kept = mesh.keep(&|triangle| inside[triangle]);
    if mesh.triangles.is_empty() {
        return Err(Error::invalid("outline", "an outline without area", "polygons with an area"));
    }
    let heights = kept.iter().map(|old| heights[*old as usize]).collect();
    Ok((Tin { mesh, heights }, report))
}

/// Adds positions with the heights of a surface.
fn add(
    distinct: DistinctPoints,
    tin: &Tin,
    corners: &[[f64; 2]],
    report: &mut SurfaceReport,
) -> Result<DistinctPoints> {
    if let Some(corner) = corners.iter().find(|corner| corner.iter().any(|at| !at.is_finite())) {
        return Err(Error::invalid("vertex of a line", format!("{corner:?}"), "finite numbers"));
    }
    let mut more: Vec<[f64; 2]> = corners.iter().map(|corner| corner.map(|at| at + 0.0)).collect();
    more.sort_by(|a, b| order(a, b));
    more.dedup();
    let (boundary, mut near) = (tin.mesh.boundary(), 0);
    let mut all: Vec<[f64; 3]> =
        distinct.positions.iter().zip(&distinct.heights).map(|([x, y], z)| [*x, *y, *z]).collect();
    for [x, y] in more {
        if distinct.number([x, y]).is_none() {
            let (height, is_outside) = tin.extended([x, y], &mut near, &boundary);
            report.extended += u64::from(is_outside);
            all.push([x, y, height]);
        }
    }
    DistinctPoints::of(&all, Duplicates::Refuse, &mut SurfaceReport::default())
}

/// Returns the segments of lines, by the indices of their ends.
fn segments(lines: &[Vec<[f64; 3]>], distinct: &DistinctPoints) -> Vec<[u32; 2]> {
    let ends = lines.iter().flat_map(|line| line.windows(2));
    let numbers = ends.filter_map(|ends| {
        let [a, b] = [ends[0], ends[1]].map(|[x, y, _]| distinct.number([x, y]));
        Some([a?, b?])
    });
    numbers.collect()
}

/// Returns the segments of rings, by the indices of their ends.
pub(crate) fn ring_segments(polygons: &PolygonParts, distinct: &DistinctPoints) -> Vec<[u32; 2]> {
    let mut found = Vec::new();
    for ring in polygons.iter().flatten() {
        for (at, corner) in ring.iter().enumerate() {
            let next = ring[(at + 1) % ring.len()];
            if let (Some(a), Some(b)) = (distinct.number(*corner), distinct.number(next)) {
                found.push([a, b]);
            }
        }
    }
    found
}

/// Returns which triangles are inside of polygons whose rings are edges of the mesh. Tests one
/// triangle for each component that constraints separate.
pub(crate) fn inside(mesh: &Mesh, polygons: &PolygonParts) -> Vec<bool> {
    let mut group = vec![NONE; mesh.triangles.len()];
    let mut is_inside_group = Vec::new();
    for first in 0..mesh.triangles.len() {
        if group[first] != NONE {
            continue;
        }
        let number = is_inside_group.len() as u32;
        let (mut open, mut largest) = (vec![first], (f64::NEG_INFINITY, [0.0; 2]));
        group[first] = number;
        while let Some(triangle) = open.pop() {
            let [a, b, c] = mesh.corners(triangle);
            let area = crate::mesh::side(a, b, c);
            if area > largest.0 {
                // (Divided first, so that the sum does not overflow.)
                largest = (area, [0, 1].map(|axis| a[axis] / 3.0 + b[axis] / 3.0 + c[axis] / 3.0));
            }
            let corners = mesh.triangles[triangle];
            for edge in 0..3 {
                let next = mesh.neighbours[triangle][edge];
                if next != NONE
                    && group[next as usize] == NONE
                    && !mesh.is_constraint([corners[edge], corners[(edge + 1) % 3]])
                {
                    group[next as usize] = number;
                    open.push(next as usize);
                }
            }
        }
        is_inside_group.push(polygons.iter().any(|polygon| is_inside(polygon, largest.1)));
    }
    group.iter().map(|group| is_inside_group[*group as usize]).collect()
}

/// Whether a position is inside a polygon, by the even-odd rule.
fn is_inside(polygon: &[Vec<[f64; 2]>], position: [f64; 2]) -> bool {
    let mut is_odd = false;
    for ring in polygon {
        for (at, a) in ring.iter().enumerate() {
            let b = ring[(at + 1) % ring.len()];
            if (a[1] > position[1]) != (b[1] > position[1]) {
                let (low, high) = if a[1] < b[1] { (*a, b) } else { (b, *a) };
                is_odd ^= crate::mesh::side(low, high, position) > 0.0;
            }
        }
    }
    is_odd
}
