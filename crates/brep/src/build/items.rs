//! Faces of a subtree in memory, with the data for tests against octants and other faces.

use std::collections::HashMap;
use std::sync::Arc;

use super::division::{Division, Reach};
use super::subtree_faces::{FaceWords, SubtreeFaces, TRIANGLE_WORDS};
use crate::exact::crossing::{FinePoint, Outline};
use crate::exact::normal::ring_normal;
use crate::exact::rank::PlaneAt;
use crate::face_triangle::FaceTriangle;
use crate::geometry::{Flaw, GridPolygon, Stages, Triangulator};
use crate::{MAX_BITS, curve};
use spinney_base::Result;
use spinney_base::sort;

/// Faces in the Z-order of their centres: neighbours in space are neighbours in memory.
#[derive(Default)]
pub(super) struct Items {
    /// Minimum and maximum coordinates, which are read most often.
    bounds: Vec<[[i32; 3]; 2]>,
    list: Vec<Item>,
    polygons: Vec<Arc<PolygonItem>>,
}

/// A face.
struct Item {
    normal: [i64; 3],
    /// The triangle; for other faces, the first triangle of the triangulation.
    triangle: FaceTriangle,
    face: u32,
    /// Index into the polygons; [`TRIANGLE`] for triangles.
    polygon: u32,
}

const TRIANGLE: u32 = u32::MAX;

/// A face that is not a triangle.
struct PolygonItem {
    points: Vec<[i32; 3]>,
    ring_ends: Vec<usize>,
    /// In half units of the grid.
    polygon: GridPolygon,
    triangles: Vec<FaceTriangle>,
}

/// Cache of polygons with many vertices, by face number: a wall with many holes is triangulated
/// once for all leaves of a base.
///
/// Invariant: numbers are those of the file that is being built, where each belongs to one face.
/// Removed faces have the base's numbers, and are not looked up here; they would otherwise be
/// mistaken for other faces.
pub(super) struct LargePolygons {
    known: HashMap<u32, Arc<PolygonItem>>,
    /// Vertices of all polygons.
    corners: usize,
    most_corners: usize,
}

impl LargePolygons {
    /// Minimum number of vertices of a large polygon.
    const LARGE: usize = 64;
    /// Approximate bytes of memory per vertex: it has a triangle, and two planes.
    const CORNER: u64 = 256;

    /// Creates a cache of at most `memory` bytes.
    pub(super) fn new(memory: u64) -> LargePolygons {
        let most_corners = (memory / LargePolygons::CORNER) as usize;
        LargePolygons { known: HashMap::new(), corners: 0, most_corners }
    }

    fn polygon(&mut self, face: FaceWords<'_>, triangulator: &mut Triangulator) -> Arc<PolygonItem> {
        if let Some(known) = self.known.get(&face.number()) {
            return known.clone();
        }
        let item = Arc::new(PolygonItem::of(face, triangulator));
        let corners = item.points.len();
        if (LargePolygons::LARGE..=self.most_corners).contains(&corners) {
            if self.corners + corners > self.most_corners {
                self.known.clear();
                self.corners = 0;
            }
            self.corners += corners;
            self.known.insert(face.number(), item.clone());
        }
        item
    }
}

/// Bytes of a triangle in memory: its words, its sort key, the item, and its share of the cells'
/// lists.
pub(super) const ITEM: usize =
    4 * TRIANGLE_WORDS + size_of::<(u64, u32)>() + size_of::<Item>() + size_of::<[[i32; 3]; 2]>() + 16;

/// End of the only ring of triangles.
const ONE_RING: [usize; 1] = [3];

impl Items {
    /// Loads faces into memory. They are planar and have an area.
    pub(super) fn of(run: SubtreeFaces) -> Result<Items> {
        Items::with(run, &mut LargePolygons::new(0))
    }

    /// Does the same as [`Items::of`], but uses polygons of the cache.
    pub(super) fn with(run: SubtreeFaces, large: &mut LargePolygons) -> Result<Items> {
        let words = run.into_words()?;
        let mut order = Vec::with_capacity(words.len() / TRIANGLE_WORDS);
        let mut offset = 0;
        for face in FaceWords::all(&words) {
            let bounds = match face.triangle() {
                Some(corners) => bounds_of(&corners),
                None => bounds_of(&face.rings().0),
            };
            // Invariant: the sort keys are distinct, since faces with equal codes have different
            // positions. So the order, which cell lists and files depend on, does not depend on the
            // number of threads.
            order.push(u128::from(curve::position_of_centre(&bounds)) << 32 | offset as u128);
            offset += face.0.len();
        }
        debug_assert!(u32::try_from(offset).is_ok());
        // (Keys ascend with the position of equal codes.)
        sort::numbers128(&mut order);
        let mut items = Items {
            bounds: Vec::with_capacity(order.len()),
            list: Vec::with_capacity(order.len()),
            polygons: Vec::new(),
        };
        let mut triangulator = Triangulator::new();
        for coded in order {
            let face = FaceWords::all(&words[coded as u32 as usize..]).next();
            face.into_iter().for_each(|face| items.push(face, &mut triangulator, large));
        }
        Ok(items)
    }

    fn push(&mut self, face: FaceWords<'_>, triangulator: &mut Triangulator, large: &mut LargePolygons) {
        let (corners, normal, bounds, polygon) = match face.triangle() {
            Some(corners) => (corners, ring_normal(&corners), bounds_of(&corners), TRIANGLE),
            None => {
                let item = large.polygon(face, triangulator);
                let normal = ring_normal(&item.points[..item.ring_ends[0]]);
                let corners = item.triangles.first().map_or([item.points[0]; 3], |triangle| triangle.corners);
                let bounds = bounds_of(&item.points);
                self.polygons.push(item);
                (corners, normal, bounds, self.polygons.len() as u32 - 1)
            }
        };
        let triangle = FaceTriangle::of_triangle(corners);
        self.bounds.push(bounds);
        self.list.push(Item { normal, triangle, face: face.number(), polygon });
    }

    pub(super) fn len(&self) -> usize {
        self.list.len()
    }

    /// Returns the number of a face.
    #[inline]
    pub(super) fn face(&self, item: u32) -> u32 {
        self.list[item as usize].face
    }

    #[inline]
    pub(super) fn plane(&self, item: u32) -> PlaneAt {
        let Item { normal, triangle, .. } = &self.list[item as usize];
        PlaneAt { normal: *normal, point: triangle.corners[0] }
    }

    /// Returns the minimum and maximum coordinates of a face.
    #[inline]
    pub(super) fn bounds(&self, item: u32) -> &[[i32; 3]; 2] {
        &self.bounds[item as usize]
    }

    #[inline]
    fn polygon(&self, item: &Item) -> Option<&PolygonItem> {
        if item.polygon == TRIANGLE {
            None
        } else {
            self.polygons.get(item.polygon as usize).map(Arc::as_ref)
        }
    }

    /// Returns the children of a cell that a face cuts, as bits, if the face cuts the cell.
    #[inline]
    pub(super) fn children(&self, item: u32, reach: Reach, division: &Division, stages: &mut Stages) -> u8 {
        if let Some(child) = reach.only_child(stages) {
            return child;
        }
        let item = &self.list[item as usize];
        match self.polygon(item) {
            None => division.children_of_triangle(reach, &item.triangle.corners, item.normal, stages),
            Some(polygon) => division.children_of_polygon(reach, &polygon.polygon, stages),
        }
    }

    #[inline]
    pub(super) fn outline(&self, item: u32) -> Outline<'_> {
        let item = &self.list[item as usize];
        let normal = item.normal;
        match self.polygon(item) {
            None => Outline { points: &item.triangle.corners, ring_ends: &ONE_RING, normal },
            Some(polygon) => Outline { points: &polygon.points, ring_ends: &polygon.ring_ends, normal },
        }
    }

    /// Returns the face's triangles.
    #[inline]
    pub(super) fn triangles(&self, item: u32) -> &[FaceTriangle] {
        let item = &self.list[item as usize];
        match self.polygon(item) {
            None => std::slice::from_ref(&item.triangle),
            Some(polygon) => &polygon.triangles,
        }
    }

    /// Returns the face's vertices.
    pub(super) fn points(&self, item: u32) -> &[[i32; 3]] {
        let item = &self.list[item as usize];
        match self.polygon(item) {
            None => &item.triangle.corners,
            Some(polygon) => &polygon.points,
        }
    }

    /// Returns a point inside a face that is not on a wall between cells.
    #[inline]
    pub(super) fn sample(&self, item: u32) -> FinePoint {
        sample(&self.list[item as usize].triangle.corners)
    }
}

/// Fraction bits of most samples.
const SAMPLE_BITS: u32 = 5;

/// Returns a point inside a triangle that is not on a wall between cells.
fn sample([a, b, c]: &[[i32; 3]; 3]) -> FinePoint {
    /// Odd enough for coordinates with many factors of 2.
    const WEIGHTS: [[i64; 3]; 12] = [
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
    let mut points = WEIGHTS.iter().map(|[u, v, w]| {
        [0, 1, 2].map(|axis| u * i64::from(a[axis]) + v * i64::from(b[axis]) + w * i64::from(c[axis]))
    });
    // Walls are halfway between grid points.
    let half = (1i64 << SAMPLE_BITS) / 2;
    let is_off = |at: &[i64; 3]| at.iter().all(|at| at & ((1 << SAMPLE_BITS) - 1) != half);
    points.find(is_off).map_or_else(
        || {
            // Invariant: in units of this many fraction bits, half a grid unit is more than the sum
            // of two coordinate differences. So no wall is this close to a vertex. (If all
            // coordinates are multiples of 16, many of the points above are on walls.)
            const BITS: u32 = MAX_BITS as u32 + 2;
            let at = [0, 1, 2].map(|axis| {
                let [a, b, c] = [a, b, c].map(|corner| i64::from(corner[axis]));
                (a << BITS) + (b - a) + (c - a)
            });
            FinePoint { at, bits: BITS }
        },
        |at| FinePoint { at, bits: SAMPLE_BITS },
    )
}

/// Returns the minimum and maximum coordinates of points, of which there must be at least one.
pub(super) fn bounds_of(points: &[[i32; 3]]) -> [[i32; 3]; 2] {
    points.iter().fold([points[0]; 2], |[min, max], point| {
        [[0, 1, 2].map(|axis| min[axis].min(point[axis])), [0, 1, 2].map(|axis| max[axis].max(point[axis]))]
    })
}

impl PolygonItem {
    fn of(face: FaceWords<'_>, triangulator: &mut Triangulator) -> PolygonItem {
        let (points, ring_ends) = face.rings();
        let wide: Vec<[i64; 3]> = points.iter().map(|point| point.map(|at| 2 * i64::from(at))).collect();
        let triangles = FaceTriangle::of_face(&points, &ring_ends, triangulator);
        let polygon = match GridPolygon::new(&wide, &ring_ends, triangulator) {
            Ok(polygon) => polygon,
            Err(Flaw::NoArea | Flaw::NotSimple) => {
                unreachable!("faces that are not polygons were rejected before: {points:?}")
            }
        };
        PolygonItem { points, ring_ends, polygon, triangles }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles on coarse and fine lattices, up to the grid's ends: samples are inside of them,
    /// and not on a wall.
    #[test]
    fn samples_are_inside_and_on_no_wall() {
        let mut state = 7u64;
        let mut below = |count: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % count
        };
        let mut fine = 0;
        for round in 0..4000u32 {
            let coarse = round % 25;
            let corners: [[i32; 3]; 3] = [(); 3].map(|()| {
                [(); 3].map(|()| {
                    (below(1 << (u32::from(MAX_BITS) - coarse).min(6 + round % 21)) as i32) << coarse
                })
            });
            let FinePoint { at, bits } = sample(&corners);
            let normal = ring_normal(&corners);
            if normal == [0; 3] {
                continue;
            }
            fine += u32::from(bits > SAMPLE_BITS);
            let half = 1i64 << (bits - 1);
            assert!(at.iter().all(|at| at & (2 * half - 1) != half), "{corners:?}");
            let outline = Outline { points: &corners, ring_ends: &[3], normal };
            assert!(outline.has(&FinePoint { at, bits }), "{corners:?}");
        }
        assert!(fine > 100, "{fine}");
    }
}
