//! Second pass over features: converts them to shapes in grid units of the tree's cells.

use spinney_base::value::Number;
use spinney_crs::CellLocator;
use spinney_overlay::{OrientedRings, oriented_rings};

use super::edge::{Edge, MAX_CELLS, PARTS, Point};
use super::shapes::{ShapeKind, Shapes};
use crate::import::feature::FeatureGeometry;

/// Shapes under construction.
pub(super) struct Loader {
    locator: CellLocator,
    pub(super) shapes: Shapes,
    /// Values of the shapes, by value number.
    pub(super) values: Vec<Number>,
    /// Number of points outside the domain of the tree's coordinate system.
    pub(super) lost: u64,
    /// Extent of the tree in cells.
    extent: [u64; 3],
    /// Number of geometries that extend beyond the tree's raster, and of those entirely outside.
    pub(super) beyond: u64,
    pub(super) outside: u64,
    /// Number of polygons whose rings cross or touch each other, or whose parts overlap.
    pub(super) invalid: u64,
}

impl Loader {
    /// Creates a loader without shapes; `locator` converts coordinates to the tree's cells.
    pub(super) fn new(locator: CellLocator, extent: [u64; 3]) -> Loader {
        let (shapes, values) = (Shapes::default(), Vec::new());
        Loader { locator, shapes, values, lost: 0, extent, beyond: 0, outside: 0, invalid: 0 }
    }

    /// Adds the shape of a geometry with the last value, or returns an error message.
    ///
    /// A line covers the cells within `radius` grid units, or, with `None`, those that contain its
    /// points.
    pub(super) fn add(&mut self, geometry: &FeatureGeometry, radius: Option<i64>) -> Result<(), String> {
        let value = self.values.len() as u32 - 1;
        let mut edges = Vec::new();
        let kind = match geometry {
            FeatureGeometry::Points(points) => {
                for point in points {
                    if let Some(point) = self.point(*point)? {
                        edges.push(Edge { a: point, b: point });
                    }
                }
                ShapeKind::Points
            }
            FeatureGeometry::Lines(lines) => {
                for line in lines {
                    let points =
                        line.iter().map(|point| self.point(*point)).collect::<Result<Vec<_>, _>>()?;
                    // A line is interrupted at points outside the domain of the tree's coordinate
                    // system.
                    edges
                        .extend(points.windows(2).filter_map(|ends| Some(Edge { a: ends[0]?, b: ends[1]? })));
                }
                radius.map_or(ShapeKind::Line, ShapeKind::Wide)
            }
            FeatureGeometry::Polygons(parts) => {
                let OrientedRings { rings, displacement } =
                    oriented_rings(&self.locator.parts(parts)).map_err(|error| error.to_string())?;
                self.invalid += u64::from(displacement.is_some());
                for ring in &rings {
                    add_ring(ring, &mut edges)?;
                }
                ShapeKind::Polygon
            }
            FeatureGeometry::Collection(members) => {
                return members.iter().try_for_each(|member| self.add(member, radius));
            }
        };
        self.compare(&edges);
        if self.shapes.edges.len() + edges.len() > u32::MAX as usize {
            return Err("more than 2^32 edges".into());
        }
        if !edges.is_empty() {
            self.shapes.add(kind, value, edges.into_iter());
        }
        Ok(())
    }

    /// Compares the bounding box of edges with the raster.
    fn compare(&mut self, edges: &[Edge]) {
        let range = |axis: usize| {
            let ranges = edges.iter().map(|edge| edge.range(axis));
            ranges.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
        };
        let end = |axis: usize| self.extent[axis] as i64 * PARTS;
        let ranges = [range(0), range(1)];
        let is_outside =
            (0..2).any(|axis| ranges[axis].is_none_or(|[low, high]| high < 0 || low > end(axis)));
        let is_inside =
            (0..2).all(|axis| ranges[axis].is_some_and(|[low, high]| low >= 0 && high <= end(axis)));
        self.beyond += u64::from(!is_inside);
        self.outside += u64::from(is_outside);
    }

    /// Converts a point to grid units; `None` outside the domain of the tree's coordinate system.
    fn point(&mut self, [x, y]: [f64; 2]) -> Result<Option<Point>, String> {
        let Some([x, y, _]) = self.locator.cell([x, y, 0.0]) else {
            self.lost += 1;
            return Ok(None);
        };
        rounded([x, y]).map(Some)
    }
}

/// Rounds a point to grid units.
fn rounded(cell: [f64; 2]) -> Result<Point, String> {
    match cell.iter().find(|at| at.abs() > MAX_CELLS) {
        Some(at) => Err(format!("a vertex {at:e} cells from the tree's origin")),
        None => Ok(cell.map(|at| (at * PARTS as f64).round() as i64)),
    }
}

/// Adds the edges of a ring.
fn add_ring(ring: &[[f64; 2]], edges: &mut Vec<Edge>) -> Result<(), String> {
    let vertices = ring.iter().map(|vertex| rounded(*vertex)).collect::<Result<Vec<_>, _>>()?;
    let next = vertices.iter().cycle().skip(1);
    edges.extend(vertices.iter().zip(next).filter(|(a, b)| a != b).map(|(a, b)| Edge { a: *a, b: *b }));
    Ok(())
}
