//! Solid angles of triangles and groups of triangles, at many points of a box at once. Coordinates
//! are in cells, relative to the box's centre.

use std::f32::consts::PI;

use glam::DVec3;

/// Points that are evaluated together.
const LANES: usize = 8;
type Lanes = [f32; LANES];

/// Near triangle.
#[derive(Clone, Copy, Debug)]
struct Facet {
    corners: [[f32; 3]; 3],
    /// Normal vector, whose length is twice the area.
    normal: [f32; 3],
    /// Distance of the plane from the centre, times the normal's length.
    offset: f32,
    /// Bound of the rounding error of such a distance, for points of the box.
    rounding: f32,
    /// Squared lengths of the edges ab, bc and ca.
    edges: [f32; 3],
    /// See [`ROUNDING`].
    doubt: f32,
}

/// Group of distant triangles: a dipole, and the moments of its normals.
#[derive(Clone, Copy, Debug)]
pub(super) struct Far {
    pub(super) centre: [f32; 3],
    pub(super) normal: [f32; 3],
    /// Integrals of normal times distance from the centre: xx, yy, zz, and xy + yx, xz + zx, yz +
    /// zy.
    pub(super) moments: [f32; 6],
}

/// Triangles and groups around a box.
#[derive(Debug)]
pub(super) struct Surroundings {
    near: Vec<Facet>,
    far: Vec<Far>,
    /// Distance of the box's corners from its centre.
    reach: f32,
}

/// Lower bound of the numerator and denominator of a tangent, relative to the product of lengths
/// that they consist of. Above it, solid angles have an error below 0.01.
const ROUNDING: f64 = 1.2e-5;

impl Surroundings {
    pub(super) fn new(reach: f64) -> Surroundings {
        Surroundings { near: Vec::new(), far: Vec::new(), reach: reach as f32 }
    }

    pub(super) fn push_near(&mut self, corners: [DVec3; 3]) {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        let offset = a.dot(normal);
        let edges = [(b - a), (c - b), (a - c)].map(DVec3::length_squared);
        let longest = edges[0].max(edges[1]).max(edges[2]);
        let doubt = ROUNDING * (longest.sqrt() + f64::from(self.reach)) * longest;
        let rounding =
            8.0 * f64::from(f32::EPSILON) * (offset.abs() + f64::from(self.reach) * normal.length());
        self.near.push(Facet {
            corners: corners.map(|corner| corner.as_vec3().into()),
            normal: normal.as_vec3().into(),
            offset: offset as f32,
            rounding: rounding as f32,
            edges: edges.map(|edge| edge as f32),
            doubt: doubt as f32,
        });
    }

    pub(super) fn push_far(&mut self, far: Far) {
        self.far.push(far);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.near.is_empty() && self.far.is_empty()
    }

    /// Adds the winding field at points of the box. Sets `in_doubt` for points that are on a
    /// triangle or on its edge, up to rounding.
    pub(super) fn add(&self, points: &[[f32; 3]], field: &mut [f32], in_doubt: &mut [bool]) {
        let batches = points.chunks(LANES).zip(field.chunks_mut(LANES)).zip(in_doubt.chunks_mut(LANES));
        for ((points, field), in_doubt) in batches {
            let at = lanes(points);
            let (mut angles, mut doubts, mut dipoles) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for facet in &self.near {
                add_angles(facet, &at, &mut angles, &mut doubts);
            }
            for far in &self.far {
                add_dipole(far, &at, &mut dipoles);
            }
            for (lane, (field, in_doubt)) in field.iter_mut().zip(in_doubt).enumerate() {
                *field += angles[lane] / (2.0 * PI) + dipoles[lane] / (4.0 * PI);
                *in_doubt = doubts[lane] != 0.0;
            }
        }
    }
}

/// Coordinates of the points as lanes; missing points are filled with the first one.
fn lanes(points: &[[f32; 3]]) -> [Lanes; 3] {
    std::array::from_fn(|axis| std::array::from_fn(|lane| points.get(lane).unwrap_or(&points[0])[axis]))
}

/// Adds the solid angles of a distant group.
#[inline]
fn add_dipole(far: &Far, [x, y, z]: &[Lanes; 3], sum: &mut Lanes) {
    let ([cx, cy, cz], [nx, ny, nz], [mxx, myy, mzz, mxy, mxz, myz]) = (far.centre, far.normal, far.moments);
    let trace = mxx + myy + mzz;
    for lane in 0..LANES {
        let (ax, ay, az) = (cx - x[lane], cy - y[lane], cz - z[lane]);
        let square = ax * ax + ay * ay + az * az;
        let inverse = 1.0 / square;
        let cube = inverse * inverse * square.sqrt();
        let quadratic = ax * (mxx * ax + mxy * ay + mxz * az) + ay * (myy * ay + myz * az) + mzz * az * az;
        let along = nx * ax + ny * ay + nz * az;
        sum[lane] += (along + trace - 3.0 * quadratic * inverse) * cube;
    }
}

/// Adds half of a triangle's solid angles (Van Oosterom and Strackee, 1983). Adds one to the doubts
/// if, due to rounding, neither the side of a point nor the angle is certain.
#[inline]
fn add_angles(facet: &Facet, [x, y, z]: &[Lanes; 3], sum: &mut Lanes, doubts: &mut Lanes) {
    let ([a, b, c], n, edges) = (&facet.corners, &facet.normal, &facet.edges);
    for lane in 0..LANES {
        let (ax, ay, az) = (a[0] - x[lane], a[1] - y[lane], a[2] - z[lane]);
        let (bx, by, bz) = (b[0] - x[lane], b[1] - y[lane], b[2] - z[lane]);
        let (cx, cy, cz) = (c[0] - x[lane], c[1] - y[lane], c[2] - z[lane]);
        let (aa, bb, cc) =
            (ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz);
        let (la, lb, lc) = (aa.sqrt(), bb.sqrt(), cc.sqrt());
        // Scalar products by the law of cosines, doubled.
        let over = 2.0 * (facet.offset - (n[0] * x[lane] + n[1] * y[lane] + n[2] * z[lane]));
        let under = 2.0 * la * lb * lc
            + (aa + bb - edges[0]) * lc
            + (bb + cc - edges[1]) * la
            + (cc + aa - edges[2]) * lb;
        // The arc tangent of the smaller over the greater, by a polynomial with an error below
        // 1/40,000; that of the quotient follows from it.
        let (height, width) = (over.abs(), under.abs());
        let is_steep = height > width;
        let (low, high) = if is_steep { (width, height) } else { (height, width) };
        let t = low / (high + f32::MIN_POSITIVE);
        let s = t * t;
        let series = ((((-0.011_721_2 * s + 0.052_653_32) * s - 0.116_432_87) * s + 0.193_543_46) * s
            - 0.332_623_47)
            * s
            + 0.999_977_26;
        let arc = series * t;
        let arc = if is_steep { PI / 2.0 - arc } else { arc };
        let arc = if under < 0.0 { PI - arc } else { arc };
        sum[lane] += if over < 0.0 { -arc } else { arc };
        let is_on = (under < 0.0) & (height <= facet.rounding);
        let is_near_edge = high <= facet.doubt;
        doubts[lane] += if is_on | is_near_edge { 1.0 } else { 0.0 };
    }
}
