//! The winding field around a cube, evaluated at many points at once: coordinates are cells, from the cube's middle.

use std::f32::consts::PI;

use glam::DVec3;

/// Points that are evaluated side by side.
const LANES: usize = 8;
type Lanes = [f32; LANES];

/// A triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    corners: [[f32; 3]; 3],
    /// The normal, twice as long as the triangle is large.
    normal: [f32; 3],
}

impl Facet {
    pub(super) fn new(corners: [DVec3; 3]) -> Facet {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).as_vec3().into();
        Facet { corners: corners.map(|corner| corner.as_vec3().into()), normal }
    }
}

/// A group of triangles far away: a dipole, and the moments of its normals.
#[derive(Clone, Copy, Debug)]
pub(super) struct Far {
    pub(super) centre: [f32; 3],
    pub(super) normal: [f32; 3],
    pub(super) moments: [[f32; 3]; 3],
}

/// The triangles and groups around a cube.
#[derive(Debug)]
pub(super) struct Surroundings {
    near: Vec<Facet>,
    far: Vec<Far>,
    /// Half the cube's width.
    half: f32,
    /// Sum of squares of what dipoles leave out.
    squares: f64,
    /// Sum of squares of area by the sixth power of the distance.
    sixths: f64,
}

/// How many times the root of the sum of squares of all groups' errors their sum is taken to be at most. Each is the
/// greatest that the first moments left out can make; their signs have nothing to do with each other.
const DEVIATIONS: f64 = 2.0;
/// Rounding of a solid angle, in the units of [`Surroundings::add_near`].
const ROUNDING: f32 = 5e-7;

impl Surroundings {
    pub(super) fn new(half: f32) -> Surroundings {
        Surroundings { near: Vec::new(), far: Vec::new(), half, squares: 0.0, sixths: 0.0 }
    }

    pub(super) fn push_near(&mut self, facet: Facet) {
        self.near.push(facet);
    }

    pub(super) fn push_far(&mut self, far: Far) {
        self.far.push(far);
    }

    /// Adds a group's error, and its area by the sixth power of its distance, both over a sphere's.
    pub(super) fn add_error(&mut self, left_out: f64, sixth: f64) {
        self.squares += left_out.powi(2);
        self.sixths += sixth.powi(2);
    }

    /// Bound of what dipoles leave out.
    pub(super) fn error(&self) -> f32 {
        // (The second term is for rounding.)
        (DEVIATIONS * self.squares.sqrt() / (4.0 * std::f64::consts::PI)) as f32 + 1e-5
    }

    /// Bound of the fourth derivatives of the far field, by 24: five times area by the sixth power of the distance.
    pub(super) fn bend(&self) -> f32 {
        (5.0 * DEVIATIONS * self.sixths.sqrt() / (4.0 * std::f64::consts::PI)) as f32
    }

    /// Adds the field of the groups that are far, at points in the cube.
    pub(super) fn add_far(&self, points: &[[f32; 3]], field: &mut [f32]) {
        for (points, field) in points.chunks(LANES).zip(field.chunks_mut(LANES)) {
            let [x, y, z] = lanes(points);
            let mut sum = [0.0; LANES];
            for far in &self.far {
                let ([cx, cy, cz], [nx, ny, nz], m) = (far.centre, far.normal, &far.moments);
                let trace = m[0][0] + m[1][1] + m[2][2];
                let (xy, xz, yz) = (m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]);
                for lane in 0..LANES {
                    let (ax, ay, az) = (cx - x[lane], cy - y[lane], cz - z[lane]);
                    let square = ax * ax + ay * ay + az * az;
                    let inverse = 1.0 / square;
                    let cube = inverse * inverse * square.sqrt();
                    let quadratic = ax * (m[0][0] * ax + xy * ay + xz * az)
                        + ay * (m[1][1] * ay + yz * az)
                        + m[2][2] * az * az;
                    let along = nx * ax + ny * ay + nz * az;
                    sum[lane] += (along + trace - 3.0 * quadratic * inverse) * cube;
                }
            }
            for (field, sum) in field.iter_mut().zip(sum) {
                *field += sum / (4.0 * PI);
            }
        }
    }

    /// Adds the field of the triangles that are near, at points in the cube, and bounds of its rounding.
    pub(super) fn add_near(&self, points: &[[f32; 3]], field: &mut [f32], rounding: &mut [f32]) {
        let places = points.chunks(LANES).zip(field.chunks_mut(LANES)).zip(rounding.chunks_mut(LANES));
        for ((points, field), rounding) in places {
            let at = lanes(points);
            let (mut sum, mut doubt) = ([0.0; LANES], [0.0; LANES]);
            for facet in &self.near {
                add_angles(facet, &at, self.half, &mut sum, &mut doubt);
            }
            for (field, sum) in field.iter_mut().zip(sum) {
                *field += sum / (2.0 * PI);
            }
            for (rounding, doubt) in rounding.iter_mut().zip(doubt) {
                *rounding += doubt * ROUNDING;
            }
        }
    }
}

/// The points' coordinates side by side; those that are not there are the first.
fn lanes(points: &[[f32; 3]]) -> [Lanes; 3] {
    std::array::from_fn(|axis| std::array::from_fn(|lane| points.get(lane).unwrap_or(&points[0])[axis]))
}

/// Adds half the solid angles of a triangle (Van Oosterom and Strackee, 1983), and how much rounding weighs in them: all
/// lengths over how far the quotient of the tangent is from 0 / 0, and very much where the point lies so near the
/// triangle that its side is in doubt.
#[inline]
fn add_angles(facet: &Facet, [x, y, z]: &[Lanes; 3], half: f32, sum: &mut Lanes, doubt: &mut Lanes) {
    let ([a, b, c], n) = (&facet.corners, &facet.normal);
    for lane in 0..LANES {
        let (ax, ay, az) = (a[0] - x[lane], a[1] - y[lane], a[2] - z[lane]);
        let (bx, by, bz) = (b[0] - x[lane], b[1] - y[lane], b[2] - z[lane]);
        let (cx, cy, cz) = (c[0] - x[lane], c[1] - y[lane], c[2] - z[lane]);
        let la = (ax * ax + ay * ay + az * az).sqrt();
        let lb = (bx * bx + by * by + bz * bz).sqrt();
        let lc = (cx * cx + cy * cy + cz * cz).sqrt();
        let ab = ax * bx + ay * by + az * bz;
        let bc = bx * cx + by * cy + bz * cz;
        let ca = cx * ax + cy * ay + cz * az;
        let over = ax * n[0] + ay * n[1] + az * n[2];
        let lengths = la * lb * lc;
        let under = lengths + ab * lc + bc * la + ca * lb;
        // The arc tangent of the lesser over the greater, by a polynomial that is off by less than its 40,000th, and
        // from it that of the quotient.
        let (height, width) = (over.abs(), under.abs());
        let is_steep = height > width;
        let (low, high) = if is_steep { (width, height) } else { (height, width) };
        let inverse = 1.0 / (high + f32::MIN_POSITIVE);
        let t = low * inverse;
        let s = t * t;
        let series = ((((-0.011_721_2 * s + 0.052_653_32) * s - 0.116_432_87) * s + 0.193_543_46) * s
            - 0.332_623_47)
            * s
            + 0.999_977_26;
        let arc = series * t;
        let arc = if is_steep { PI / 2.0 - arc } else { arc };
        let arc = if under < 0.0 { PI - arc } else { arc };
        sum[lane] += if over < 0.0 { -arc } else { arc };
        let scale = 3.0 * lengths + half * (la * lb + lb * lc + lc * la);
        let is_on = under < 0.0 && height < 1e-5 * scale;
        doubt[lane] += scale * inverse + 50.0 * t + if is_on { 1e9 } else { 0.0 };
    }
}
