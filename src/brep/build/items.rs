//! Faces of a part of space, in memory, with what the tests against octants and each other need.

use super::run::{FaceWords, Run};
use crate::Result;
use crate::brep::MOST_BITS;
use crate::brep::piece::Piece;
use crate::geometry::crossing::{FinePoint, Outline, ring_normal};
use crate::geometry::rank::HomogeneousPlane;
use crate::geometry::{Box3, Flaw, Intersection, Polygon, Triangulator, triangle};
use crate::space::{Dimension, morton_encode};

/// Faces, in the order of the cells in which their middles lie: neighbours in space are neighbours in memory.
#[derive(Default)]
pub(super) struct Items {
    list: Vec<Item>,
    polygons: Vec<PolygonItem>,
}

/// A face.
struct Item {
    bounds: [[i32; 3]; 2],
    /// A triangle; of other faces the first triangle that is cut from it.
    piece: Piece,
    plane: HomogeneousPlane,
    /// A point inside, in units of 2^-[`SAMPLE_BITS`] of the grid's.
    sample: Option<[i64; 3]>,
    face: u32,
    /// Place among the polygons; [`TRIANGLE`] for triangles.
    polygon: u32,
}

const TRIANGLE: u32 = u32::MAX;

/// A face that is no triangle.
struct PolygonItem {
    points: Vec<[i32; 3]>,
    ring_ends: Vec<usize>,
    /// In half units of the grid.
    polygon: Polygon,
    triangles: Vec<Piece>,
}

/// Bytes of an item that is a triangle.
pub(super) const ITEM: usize = size_of::<Item>() + 16;

/// End of the only ring of triangles.
const ONE_RING: [usize; 1] = [3];

impl Items {
    /// Takes faces to memory. They are planar and have an area.
    pub(super) fn of(run: &Run) -> Result<Items> {
        let mut items = Items::default();
        let mut triangulator = Triangulator::new();
        run.each(|face| {
            items.push(face, &mut triangulator);
            Ok(())
        })?;
        // Spreading has room for 21 bits of each coordinate; the lowest ones do not matter for being near.
        let spread = |at: i32| morton_encode(Dimension::Oct, at as u32 >> (MOST_BITS - 21));
        let code = |item: &Item| {
            let [low, high] = item.bounds;
            let [x, y, z] = [0, 1, 2].map(|axis| spread((low[axis] + high[axis]) / 2));
            x | y << 1 | z << 2
        };
        items.list.sort_by_cached_key(|item| (code(item), item.face));
        Ok(items)
    }

    fn push(&mut self, face: FaceWords<'_>, triangulator: &mut Triangulator) {
        let (corners, normal, bounds, polygon) = match face.triangle() {
            Some(corners) => (corners, ring_normal(&corners), bounds_of(&corners), TRIANGLE),
            None => {
                let item = PolygonItem::of(face, triangulator);
                let normal = ring_normal(&item.points[..item.ring_ends[0]]);
                let corners = item.triangles.first().map_or([item.points[0]; 3], |piece| piece.corners);
                let bounds = bounds_of(&item.points);
                self.polygons.push(item);
                (corners, normal, bounds, self.polygons.len() as u32 - 1)
            }
        };
        let plane = HomogeneousPlane::through(normal, corners[0]);
        let sample = sample(&corners);
        let piece = Piece::of_triangle(corners);
        self.list.push(Item { bounds, piece, plane, sample, face: face.number(), polygon });
    }

    pub(super) fn len(&self) -> usize {
        self.list.len()
    }

    /// The number of a face.
    #[inline]
    pub(super) fn face(&self, item: u32) -> u32 {
        self.list[item as usize].face
    }

    #[inline]
    pub(super) fn plane(&self, item: u32) -> &HomogeneousPlane {
        &self.list[item as usize].plane
    }

    /// Least and greatest coordinates of a face.
    #[inline]
    pub(super) fn bounds(&self, item: u32) -> &[[i32; 3]; 2] {
        &self.list[item as usize].bounds
    }

    #[inline]
    fn polygon(&self, item: &Item) -> Option<&PolygonItem> {
        if item.polygon == TRIANGLE { None } else { self.polygons.get(item.polygon as usize) }
    }

    /// Whether a face cuts an octant, given in half units of the grid: the five-stage test.
    #[inline]
    pub(super) fn cuts(&self, item: u32, min: [i64; 3], max: [i64; 3]) -> Intersection {
        let item = &self.list[item as usize];
        match self.polygon(item) {
            None => {
                let corners = item.piece.corners.map(|corner| corner.map(|at| 2 * i64::from(at)));
                triangle::intersect(&corners, min, max)
            }
            Some(polygon) => polygon.polygon.cuts(&Box3 { min, max }),
        }
    }

    #[inline]
    pub(super) fn outline(&self, item: u32) -> Outline<'_> {
        let item = &self.list[item as usize];
        let normal = item.plane.normal;
        match self.polygon(item) {
            None => Outline { points: &item.piece.corners, ring_ends: &ONE_RING, normal },
            Some(polygon) => Outline { points: &polygon.points, ring_ends: &polygon.ring_ends, normal },
        }
    }

    /// The face as triangles.
    #[inline]
    pub(super) fn triangles(&self, item: u32) -> &[Piece] {
        let item = &self.list[item as usize];
        match self.polygon(item) {
            None => std::slice::from_ref(&item.piece),
            Some(polygon) => &polygon.triangles,
        }
    }

    /// Corners of a face.
    pub(super) fn points(&self, item: u32) -> &[[i32; 3]] {
        let item = &self.list[item as usize];
        match self.polygon(item) {
            None => &item.piece.corners,
            Some(polygon) => &polygon.points,
        }
    }

    /// A point inside a face that lies on no wall between cells, if there is one among some.
    #[inline]
    pub(super) fn sample(&self, item: u32) -> Option<FinePoint> {
        self.list[item as usize].sample.map(|at| FinePoint { at, bits: SAMPLE_BITS })
    }
}

/// Bits behind the point of samples.
const SAMPLE_BITS: u32 = 5;

/// A point inside a triangle that lies on no wall between cells.
fn sample([a, b, c]: &[[i32; 3]; 3]) -> Option<[i64; 3]> {
    // Odd enough for coordinates that have many factors of 2.
    let weights = [
        [11, 13, 8],
        [7, 12, 13],
        [9, 17, 6],
        [13, 14, 5],
        [5, 11, 16],
        [10, 15, 7],
        [3, 22, 7],
        [15, 8, 9],
        [19, 2, 11],
        [1, 6, 25],
        [14, 1, 17],
        [23, 5, 4],
    ];
    let points = weights.into_iter().map(|[u, v, w]: [i64; 3]| {
        [0, 1, 2].map(|axis| u * i64::from(a[axis]) + v * i64::from(b[axis]) + w * i64::from(c[axis]))
    });
    // Walls lie in the middle between points of the grid.
    let half = (1i64 << SAMPLE_BITS) / 2;
    let is_off = |at: &[i64; 3]| at.iter().all(|at| at & ((1 << SAMPLE_BITS) - 1) != half);
    points.into_iter().find(is_off)
}

/// Least and greatest coordinates of points, of which there is one at least.
pub(super) fn bounds_of(points: &[[i32; 3]]) -> [[i32; 3]; 2] {
    points.iter().fold([points[0]; 2], |[min, max], point| {
        [[0, 1, 2].map(|axis| min[axis].min(point[axis])), [0, 1, 2].map(|axis| max[axis].max(point[axis]))]
    })
}

impl PolygonItem {
    fn of(face: FaceWords<'_>, triangulator: &mut Triangulator) -> PolygonItem {
        let (points, ring_ends) = face.rings();
        let wide: Vec<[i64; 3]> = points.iter().map(|point| point.map(|at| 2 * i64::from(at))).collect();
        let triangles = Piece::of_face(&points, &ring_ends, triangulator);
        let polygon = match Polygon::new(&wide, &ring_ends, triangulator) {
            Ok(polygon) => polygon,
            Err(Flaw::NoArea | Flaw::NotSimple) => {
                unreachable!("faces that are no polygons are refused before: {points:?}")
            }
        };
        PolygonItem { points, ring_ends, polygon, triangles }
    }
}
