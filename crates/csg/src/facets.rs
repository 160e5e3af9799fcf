//! Polyhedra of primitives: planar primitives exactly, curved ones by facets with vertices on their
//! surfaces.

use std::f64::consts::PI;

use crate::affine::Affine;
use crate::lowered::Bounds;
use crate::outline::Outline;
use crate::shape::Shape;

/// A closed surface. A face's outer ring is counterclockwise as seen from outside, and the rings of
/// its holes follow it.
#[derive(Default)]
pub(crate) struct Polyhedron {
    pub(crate) vertices: Vec<[f64; 3]>,
    pub(crate) corners: Vec<u32>,
    /// Ends of the rings in `corners`.
    pub(crate) ring_ends: Vec<usize>,
    /// Ends of the faces in `ring_ends`.
    pub(crate) face_ends: Vec<usize>,
}

/// Minimum number of facets around an axis.
const MIN_SIDES: f64 = 8.0;

/// Number of facets around a circle for a maximum distance of `within`: a chord's sagitta is the
/// radius times 1 - cos of half its angle.
fn sides(radius: f64, within: f64) -> f64 {
    let half = (1.0 - within / radius).max(0.0).acos();
    (PI / half).ceil().max(MIN_SIDES)
}

/// Number of facets around a ball for a maximum distance of `within`. Facets deviate along both
/// directions, so cos² of half their angle bounds the distance.
fn sides_of_ball(radius: f64, within: f64) -> f64 {
    let half = (within / radius).min(1.0).sqrt().asin();
    ((PI / half / 2.0).ceil() * 2.0).max(MIN_SIDES)
}

impl Shape {
    /// Returns the number of positions around the axis, and of vertices of the rings that are
    /// revolved, for a maximum distance of `within` from the surface. `None` for planar primitives.
    fn turned(&self, within: f64) -> Option<(f64, f64)> {
        match self {
            Shape::Ball { radius } => {
                let sides = sides_of_ball(*radius, within);
                Some((sides, sides / 2.0 + 1.0))
            }
            Shape::Cone { radii: [low, high], .. } => Some((sides(low.max(*high), within), 4.0)),
            Shape::Torus { ring, tube } => {
                Some((sides(ring + tube, within / 2.0), sides(*tube, within / 2.0)))
            }
            Shape::Revolved { outline } => {
                let points = outline.rings.iter().flat_map(|ring| &ring.points);
                let farthest = points.clone().fold(0.0, |most: f64, point| most.max(point[0]));
                Some((sides(farthest, within), points.count() as f64))
            }
            Shape::Block { .. } | Shape::HalfSpace | Shape::Prism { .. } | Shape::Patches { .. } => None,
        }
    }

    /// Returns the outline to revolve around the axis, with `corners` vertices per ring.
    fn profile(&self, corners: f64) -> Option<Outline> {
        let ring = match self {
            Shape::Ball { radius } => {
                let last = corners as usize - 1;
                let point = |number: usize| {
                    let (sin, cos) = (PI * (number as f64 / last as f64 - 0.5)).sin_cos();
                    let is_pole = number == 0 || number == last;
                    [if is_pole { 0.0 } else { radius * cos }, radius * sin]
                };
                (0..=last).map(point).collect()
            }
            Shape::Cone { radii: [low, high], height } => {
                let mut ring = vec![[0.0, 0.0], [*low, 0.0], [*high, *height], [0.0, *height]];
                ring.dedup();
                ring
            }
            Shape::Torus { ring, tube } => {
                let point = |number: usize| {
                    let (sin, cos) = (2.0 * PI * number as f64 / corners).sin_cos();
                    [ring + tube * cos, tube * sin]
                };
                (0..corners as usize).map(point).collect()
            }
            Shape::Revolved { outline } => return Some(outline.clone()),
            Shape::Block { .. } | Shape::HalfSpace | Shape::Prism { .. } | Shape::Patches { .. } => {
                return None;
            }
        };
        Some(Outline::new(vec![ring]))
    }

    /// Estimates the number of faces of the polyhedron.
    pub(crate) fn facets(&self, within: f64) -> f64 {
        match (self.turned(within), self) {
            (Some((sides, corners)), _) => sides * corners,
            (None, Shape::Prism { outline, .. }) => {
                outline.rings.iter().map(|ring| ring.points.len() as f64 + 2.0).sum()
            }
            (None, Shape::Patches { shell, .. }) => shell.facet_count(within),
            (None, _) => 6.0,
        }
    }

    /// Whether the polyhedron only approximates the primitive.
    pub(crate) fn is_curved(&self) -> bool {
        match self {
            Shape::Block { .. } | Shape::HalfSpace | Shape::Prism { .. } => false,
            Shape::Patches { shell, .. } => shell.is_curved(),
            _ => true,
        }
    }

    /// Returns the polyhedron in world coordinates. The caller has checked that the number of
    /// facets is within the limit. An infinite primitive is cut off outside of a ball, given in
    /// local coordinates.
    pub(crate) fn polyhedron(
        &self,
        within: f64,
        to_world: &Affine,
        (centre, radius): ([f64; 3], f64),
    ) -> Polyhedron {
        let mut made = Polyhedron::default();
        match self {
            Shape::Block { min, max } => made.block(&[*min, *max]),
            Shape::HalfSpace => {
                let [x, y, z] = centre;
                let top = if z > radius { z - radius } else { (z + radius).min(0.0) };
                let min = [x - radius, y - radius, top - 2.0 * radius];
                made.block(&[min, [x + radius, y + radius, top]]);
            }
            Shape::Prism { outline, heights } => made.prism(outline, *heights),
            Shape::Patches { shell, .. } => {
                let facets = shell.facets(within);
                made.vertices = facets.vertices;
                facets.triangles.iter().for_each(|triangle| made.face(*triangle));
            }
            curved => {
                if let Some((sides, corners)) = curved.turned(within)
                    && let Some(profile) = curved.profile(corners)
                {
                    profile.directed().iter().for_each(|ring| made.revolve(&ring.points, sides as u32));
                }
            }
        }
        made.move_by(to_world);
        made
    }
}

impl Polyhedron {
    /// Adds a vertex and returns its index.
    fn vertex(&mut self, point: [f64; 3]) -> u32 {
        self.vertices.push(point);
        self.vertices.len() as u32 - 1
    }

    /// Adds a face without holes.
    fn face(&mut self, corners: impl IntoIterator<Item = u32>) {
        self.ring(corners);
        self.face_ends.push(self.ring_ends.len());
    }

    /// Adds a ring to the current face.
    fn ring(&mut self, corners: impl IntoIterator<Item = u32>) {
        self.corners.extend(corners);
        self.ring_ends.push(self.corners.len());
    }

    fn block(&mut self, [min, max]: &Bounds) {
        let ring = vec![[min[0], min[1]], [max[0], min[1]], [max[0], max[1]], [min[0], max[1]]];
        self.prism(&Outline::new(vec![ring]), [min[2], max[2]]);
    }

    fn prism(&mut self, outline: &Outline, heights: [f64; 2]) {
        let directed = outline.directed();
        // First and last vertex of each ring at both heights, and the indices of the holes in each
        // ring.
        let mut rings = Vec::new();
        let mut holes = vec![Vec::new(); directed.len()];
        for (number, ring) in directed.iter().enumerate() {
            let count = ring.points.len() as u32;
            let [low, high] = heights.map(|height| {
                let first = self.vertices.len() as u32;
                self.vertices.extend(ring.points.iter().map(|[x, y]| [*x, *y, height]));
                first
            });
            for corner in 0..count {
                let next = if corner + 1 == count { 0 } else { corner + 1 };
                self.face([low + corner, low + next, high + next, high + corner]);
            }
            rings.push((low..low + count, high..high + count));
            ring.hole_in.into_iter().for_each(|outer| holes[outer].push(number));
        }
        for (outer, _) in directed.iter().enumerate().filter(|(_, ring)| ring.hole_in.is_none()) {
            let face: Vec<usize> = std::iter::once(outer).chain(holes[outer].iter().copied()).collect();
            face.iter().for_each(|ring| self.ring(rings[*ring].0.clone().rev()));
            self.face_ends.push(self.ring_ends.len());
            face.iter().for_each(|ring| self.ring(rings[*ring].1.clone()));
            self.face_ends.push(self.ring_ends.len());
        }
    }

    /// Adds the surface that a ring of (radius, height) points sweeps when it is revolved around
    /// the axis.
    fn revolve(&mut self, ring: &[[f64; 2]], sides: u32) {
        let angles: Vec<(f64, f64)> =
            (0..sides).map(|side| (2.0 * PI * f64::from(side) / f64::from(sides)).sin_cos()).collect();
        // For each point, its first vertex and whether it lies on the axis: one vertex there,
        // otherwise one per side.
        let ring_vertices: Vec<(u32, bool)> = ring
            .iter()
            .map(|[radius, z]| {
                let first = self.vertices.len() as u32;
                if *radius == 0.0 {
                    return (self.vertex([0.0, 0.0, *z]), true);
                }
                self.vertices.extend(angles.iter().map(|(sin, cos)| [radius * cos, radius * sin, *z]));
                (first, false)
            })
            .collect();
        for (number, (from, from_axis)) in ring_vertices.iter().enumerate() {
            let following = if number + 1 == ring.len() { 0 } else { number + 1 };
            let (to, to_axis) = ring_vertices[following];
            let is_level = ring[number][1] == ring[following][1];
            match (from_axis, to_axis) {
                (true, true) => {}
                // A disc perpendicular to the axis is a single face.
                (true, false) if is_level => self.face((to..to + sides).rev()),
                (false, true) if is_level => self.face(*from..from + sides),
                _ => {
                    for side in 0..sides {
                        let next = if side + 1 == sides { 0 } else { side + 1 };
                        match (from_axis, to_axis) {
                            (true, _) => self.face([*from, to + next, to + side]),
                            (_, true) => self.face([from + side, from + next, to]),
                            _ => self.face([from + side, from + next, to + next, to + side]),
                        }
                    }
                }
            }
        }
    }

    /// Transforms all vertices. Reverses all rings if the transform is a reflection, so that they
    /// stay oriented.
    fn move_by(&mut self, map: &Affine) {
        self.vertices.iter_mut().for_each(|vertex| *vertex = map.apply(*vertex));
        if map.determinant() < 0.0 {
            let mut first = 0;
            for end in &self.ring_ends {
                self.corners[first..*end].reverse();
                first = *end;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the volume that a closed and oriented surface encloses.
    fn volume(made: &Polyhedron) -> f64 {
        let mut first = 0;
        let mut sum = 0.0;
        for end in &made.ring_ends {
            let at = |corner: usize| made.vertices[made.corners[corner] as usize];
            for corner in first + 1..end - 1 {
                let [a, b, c] = [at(first), at(corner), at(corner + 1)];
                let rows = [0, 1, 2].map(|axis| [a[axis], b[axis], c[axis], 0.0]);
                sum += Affine { rows }.determinant();
            }
            first = *end;
        }
        sum / 6.0
    }

    #[test]
    fn facets_come_near() {
        let shapes = [
            (Shape::Ball { radius: 2.0 }, 4.0 / 3.0 * PI * 8.0),
            (Shape::Cone { radii: [1.0, 2.0], height: 3.0 }, PI * 7.0),
            (Shape::Cone { radii: [1.0, 0.0], height: 3.0 }, PI),
            (Shape::Torus { ring: 3.0, tube: 1.0 }, 6.0 * PI * PI),
        ];
        let map = Affine::mirror([1.0, 2.0, 3.0]).after(&Affine::rotation([1.0, 1.0, 0.0], 20.0));
        for (shape, exact) in shapes {
            for within in [0.1, 0.01, 0.001] {
                let made = shape.polyhedron(within, &map, ([0.0; 3], 0.0));
                let share = volume(&made) / exact;
                // (The volume error is at most `within` times the curved area, and the ratio of
                // that area to the volume is below 4 here.)
                assert!((1.0 - 4.0 * within..1.0).contains(&share), "{shape:?} within {within}: {share}");
            }
        }
    }
}
