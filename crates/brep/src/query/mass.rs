//! Volume, centre of gravity, moments of inertia, area and bounds of a body: exact from its faces,
//! in one pass.
//!
//! Every face spans a cone with the grid's first point, and a body is the signed sum of these
//! cones. A cone is a signed sum of tetrahedra over the fans of the face's rings, with holes
//! counted as negative, so no triangulation is needed. Volume and moments of a tetrahedron with
//! integer coordinates are integers over 6, 24 and 120 (see for example P. Lien and J. T. Kajiya,
//! "A symbolic method for calculating the integral properties of arbitrary nonconvex polyhedra",
//! IEEE CG&A 4(10), 1984), and their sums do not depend on the order.

use super::ratio::{Whole, WideSum, odd_part, rounded, whole};
use crate::arrangement::{ExactFace, fraction_bits};
use crate::exact::vector::{cross, dot, subtract};
use crate::{ExactModel, Face, Faces, Grid};
use spinney_base::{Progress, Result};

/// Measures of a body of uniform density 1, in world units.
///
/// Volume, centre and moments are the exact values for the model's grid, each rounded once; the
/// grid's step counts as an exact quotient.
#[derive(Clone, Debug, PartialEq)]
pub struct MassProperties {
    /// Number of faces.
    pub faces: u64,
    /// Volume; negative if the surface is inside out. With off-grid vertices, it is the volume of
    /// the exact surface, whose vertices are rounded to 2^-58 of the grid's width; the other
    /// measures are those of the faces on the grid.
    pub volume: f64,
    /// Centre of gravity; `None` if there is no volume.
    pub centre: Option<[f64; 3]>,
    /// Second moments about the centre: the integrals of the products of two coordinates, row by
    /// row; zeros without a centre.
    pub second_moments: [[f64; 3]; 3],
    /// Inertia tensor about the centre for a density of 1; zeros without a centre.
    pub inertia: [[f64; 3]; 3],
    /// Area of all faces, with a relative error of about 2^-50 (and an absolute error of at most a
    /// millionth of a squared grid unit per million faces).
    pub area: f64,
    /// Minimum and maximum coordinates of the faces that have an area; `None` without any.
    pub bounds: Option<[[f64; 3]; 2]>,
}

impl MassProperties {
    /// Measures the body that faces enclose. The memory does not depend on their number. Files with
    /// stored sums are measured without reading their faces.
    ///
    /// The surface has to be closed, and its winding number has to be 0 or 1; otherwise, volume and
    /// moments are weighted by the winding number.
    ///
    /// # Errors
    /// If the faces cannot be read, or on cancellation.
    pub fn of(faces: &dyn Faces, progress: &dyn Progress) -> Result<MassProperties> {
        if let Some(sums) = faces.mass_sums(progress)? {
            return Ok(sums.measures(faces.grid()));
        }
        let mut sums = MassSums::new();
        faces.each(&mut |face| sums.add_face_of(face, faces.len(), progress))?;
        progress.advance(sums.faces % 1024, faces.len());
        let mut measures = sums.measures(faces.grid());
        let width = faces.grid().width();
        measures.volume += faces.volume_correction()? * width * width * width;
        Ok(measures)
    }
}

impl ExactModel {
    /// Computes the sums over all faces from the faces.
    pub(crate) fn sums_of_faces(&self, progress: &dyn Progress) -> Result<MassSums> {
        let mut sums = MassSums::new();
        self.each_face(&mut |face, is_proxy| {
            sums.add_face_of(face, self.len(), progress)?;
            if is_proxy {
                sums.remove_proxy(face, self.grid().bits);
            }
            Ok(())
        })?;
        progress.advance(sums.faces % 1024, self.len());
        self.each_exact(&mut |face| {
            sums.add_exact(&face, self.grid().bits);
            Ok(())
        })?;
        Ok(sums)
    }

    /// Computes the sums over faces with off-grid vertices and their proxies alone.
    pub(crate) fn off_grid_sums(&self) -> Result<MassSums> {
        let mut sums = MassSums::new();
        self.each_exact(&mut |face| {
            sums.add_exact(&face, self.grid().bits);
            Ok(())
        })?;
        self.each_proxy(&mut |face| {
            sums.remove_proxy(face, self.grid().bits);
            Ok(())
        })?;
        Ok(sums)
    }
}

/// Fraction bits of a sum of areas.
const AREA_BITS: i32 = 40;

/// Sums over faces, from which measures are computed. They can be computed for subsets of the faces
/// and added, with the same result for any partition.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MassSums {
    pub(crate) faces: u64,
    /// 6 times the volume.
    pub(crate) volume: i128,
    /// 24 times the integral of each coordinate.
    pub(crate) first: [WideSum; 3],
    /// 120 times the integrals of xx, yy, zz, xy, yz, zx.
    pub(crate) second: [WideSum; 6],
    /// Twice the area, in units of 2^-AREA_BITS.
    pub(crate) area: u128,
    /// 6 times the volume of the faces with off-grid vertices minus that of their proxies, in
    /// units of the cube of rounded coordinates.
    pub(crate) off_grid: WideSum,
    /// Minimum and maximum coordinates of the faces that have an area.
    pub(crate) bounds: Option<[[i32; 3]; 2]>,
}

impl MassSums {
    /// Creates empty sums.
    pub fn new() -> MassSums {
        MassSums::default()
    }

    /// Adds one of `total` faces, and advances the progress.
    fn add_face_of(&mut self, face: &Face<'_>, total: u64, progress: &dyn Progress) -> Result<()> {
        self.add_face(face);
        if self.faces.is_multiple_of(1024) {
            progress.check()?;
            progress.advance(1024, total);
        }
        Ok(())
    }

    /// Adds a face.
    pub fn add_face(&mut self, face: &Face<'_>) {
        self.faces += 1;
        let mut normal = [0i64; 3];
        let mut outer = None;
        for ring in face.rings() {
            let Some((first, others)) = ring.split_first() else { continue };
            for edge in others.windows(2) {
                let across = self.add_tetrahedron([*first, edge[0], edge[1]].map(|p| p.map(i64::from)));
                for axis in 0..3 {
                    normal[axis] = normal[axis].wrapping_add(across[axis]);
                }
            }
            outer = outer.or(Some(normal));
        }
        let square = normal.map(|n| i128::from(n) * i128::from(n)).iter().sum::<i128>();
        let area = (square as f64).sqrt() * (1u64 << AREA_BITS) as f64;
        self.area = self.area.wrapping_add(area as u128);
        // (The octree has the same bounds: faces without area are in no cell.)
        let Some(first) = face.points.first().filter(|_| outer.is_some_and(|normal| normal != [0; 3])) else {
            return;
        };
        let [min, max] = self.bounds.get_or_insert([*first; 2]);
        for point in face.points {
            for axis in 0..3 {
                min[axis] = min[axis].min(point[axis]);
                max[axis] = max[axis].max(point[axis]);
            }
        }
    }

    /// Adds the tetrahedron of a triangle and the grid's first point; returns twice the triangle's
    /// area vector.
    fn add_tetrahedron(&mut self, [a, b, c]: [[i64; 3]; 3]) -> [i64; 3] {
        let across = cross(subtract(b, a), subtract(c, a));
        // Six times the volume, below 2^80: coordinates have 26 bits.
        let volume = dot(a.map(i128::from), across.map(i128::from));
        self.volume = self.volume.wrapping_add(volume);
        let sum = [0, 1, 2].map(|i| a[i] + b[i] + c[i]);
        for (moment, sum) in self.first.iter_mut().zip(sum) {
            moment.add_product(volume, sum);
        }
        let product = |i: usize, j: usize| a[i] * a[j] + b[i] * b[j] + c[i] * c[j] + sum[i] * sum[j];
        for (moment, [i, j]) in self.second.iter_mut().zip(PAIRS) {
            moment.add_product(volume, product(i, j));
        }
        across
    }

    /// Adds a face with off-grid vertices. Only the volume includes it: the other sums are those of
    /// its proxies.
    pub(crate) fn add_exact(&mut self, face: &ExactFace, bits: u8) {
        for ring in face.rings() {
            let points: Vec<[i64; 3]> =
                ring.iter().map(|corner| corner.point.fixed(fraction_bits(bits))).collect();
            self.add_cones(&points, 1);
        }
    }

    /// Subtracts a face that is a proxy from the volume.
    pub(crate) fn remove_proxy(&mut self, face: &Face<'_>, bits: u8) {
        for ring in face.rings() {
            let points: Vec<[i64; 3]> =
                ring.iter().map(|point| point.map(|at| i64::from(at) << fraction_bits(bits))).collect();
            self.add_cones(&points, -1);
        }
    }

    /// Adds the volume between a ring and the grid's first point.
    fn add_cones(&mut self, ring: &[[i64; 3]], sign: i128) {
        let Some((first, others)) = ring.split_first() else { return };
        for edge in others.windows(2) {
            // Coordinates have 59 bits with their signs.
            let across = cross(edge[0].map(i128::from), edge[1].map(i128::from));
            for (across, at) in across.into_iter().zip(first) {
                self.off_grid.add_product(sign * across, *at);
            }
        }
    }

    /// Returns the volume of the faces with off-grid vertices minus that of their proxies, in cubed
    /// grid units.
    pub(crate) fn volume_correction(&self, bits: u8) -> f64 {
        rounded(self.off_grid.value(), whole(6), -3 * fraction_bits(bits) as i32)
    }

    /// Adds the sums over other faces.
    pub fn add(&mut self, other: &MassSums) {
        self.faces += other.faces;
        self.volume = self.volume.wrapping_add(other.volume);
        self.first.iter_mut().zip(&other.first).for_each(|(sum, other)| sum.add(other));
        self.second.iter_mut().zip(&other.second).for_each(|(sum, other)| sum.add(other));
        self.area = self.area.wrapping_add(other.area);
        self.off_grid.add(&other.off_grid);
        if let Some([min, max]) = other.bounds {
            let all = self.bounds.get_or_insert([min, max]);
            for axis in 0..3 {
                all[0][axis] = all[0][axis].min(min[axis]);
                all[1][axis] = all[1][axis].max(max[axis]);
            }
        }
    }

    /// Returns the measures in world units.
    pub fn measures(&self, grid: &Grid) -> MassProperties {
        let volume = whole(self.volume);
        let unit = ExactGridUnit::of(grid);
        let area = self.area as f64 / (1u128 << (AREA_BITS + 1)) as f64;
        let mut measures = MassProperties {
            faces: self.faces,
            volume: {
                let fine = 3 * fraction_bits(grid.bits);
                unit.scaled((volume << fine) + self.off_grid.value(), whole(6) << fine, 3)
            },
            centre: None,
            second_moments: [[0.0; 3]; 3],
            inertia: [[0.0; 3]; 3],
            area: area * grid.width() * grid.width(),
            bounds: self.bounds.map(|bounds| bounds.map(|corner| grid.to_world(corner))),
        };
        if self.volume == 0 {
            return measures;
        }
        let first: [Whole; 3] = [0, 1, 2].map(|axis| self.first[axis].value());
        // First moments over the volume: a 24th over a sixth.
        let of_volume = volume * whole(4);
        measures.centre = Some([0, 1, 2].map(|axis| {
            let origin = of_volume * whole(i128::from(grid.origin[axis]));
            unit.scaled(origin + first[axis], of_volume, 1)
        }));
        // Subtracts the product of two first moments over the volume: in 480ths of the volume.
        let mut second = [[whole(0); 3]; 3];
        for (moment, [i, j]) in self.second.iter().zip(PAIRS) {
            second[i][j] = of_volume * moment.value() - whole(5) * first[i] * first[j];
            second[j][i] = second[i][j];
        }
        let divisor = whole(480) * volume;
        let trace = second[0][0] + second[1][1] + second[2][2];
        for (i, row) in second.iter().enumerate() {
            for (j, moment) in row.iter().enumerate() {
                let inertia = if i == j { trace - *moment } else { -*moment };
                measures.second_moments[i][j] = unit.scaled(*moment, divisor, 5);
                measures.inertia[i][j] = unit.scaled(inertia, divisor, 5);
            }
        }
        measures
    }
}

/// Axes of the second moments.
const PAIRS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [2, 0]];

/// The grid unit as the exact quotient of two integers, times a power of two.
struct ExactGridUnit {
    number: Whole,
    divisor: Whole,
    exponent: i32,
}

impl ExactGridUnit {
    fn of(grid: &Grid) -> ExactGridUnit {
        let ((number, up), (divisor, down)) = (odd_part(grid.step), odd_part(grid.divisor));
        ExactGridUnit { number: whole(number), divisor: whole(divisor), exponent: up - down }
    }

    /// Returns a quotient times a power of the grid unit, rounded once.
    fn scaled(&self, mut number: Whole, mut divisor: Whole, power: i32) -> f64 {
        for _ in 0..power {
            number *= self.number;
            divisor *= self.divisor;
        }
        rounded(number, divisor, power * self.exponent)
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Body, Ring, cuboid};
    use super::*;
    use crate::FaceList;

    fn grid(step: f64, divisor: f64, origin: [i64; 3]) -> Grid {
        Grid { bits: 26, origin, step, divisor }
    }

    fn list(grid: Grid, faces: &[Vec<Ring>]) -> FaceList {
        Body::new(26).with(faces.to_vec()).list_on(grid)
    }

    fn measure(list: &FaceList) -> MassProperties {
        MassProperties::of(list, &()).unwrap()
    }

    #[test]
    fn boxes_have_the_measures_of_boxes() {
        let sides = [3, 10, 7];
        let faces = cuboid([5, 6, 9], [8, 16, 16], false);
        let found = measure(&list(grid(1.0, 1.0, [100, -200, 0]), &faces));
        assert_eq!((found.faces, found.volume, found.area), (6, 210.0, 2.0 * (30.0 + 70.0 + 21.0)));
        assert_eq!(found.centre, Some([106.5, -189.0, 12.5]));
        assert_eq!(found.bounds, Some([[105.0, -194.0, 9.0], [108.0, -184.0, 16.0]]));
        let second = sides.map(|side| 210.0 * f64::from(side * side) / 12.0);
        for i in 0..3 {
            for j in 0..3 {
                let (moment, inertia) =
                    if i == j { (second[i], second.iter().sum::<f64>() - second[i]) } else { (0.0, 0.0) };
                assert_eq!((found.second_moments[i][j], found.inertia[i][j]), (moment, inertia), "{i} {j}");
            }
        }
    }

    /// On a grid of thousandths, measures are the doubles nearest to the decimal numbers.
    #[test]
    fn a_decimal_grid_is_taken_for_what_it_is() {
        let faces = cuboid([0; 3], [100, 300, 700], false);
        let found = measure(&list(grid(1.0, 1000.0, [200, 0, 0]), &faces));
        assert_eq!((found.volume, found.centre), (0.021, Some([0.25, 0.15, 0.35])));
        assert_eq!(found.second_moments[2][2], 0.000_857_5);
        let found = measure(&list(grid(0.3, 1.0, [0; 3]), &cuboid([0; 3], [1; 3], false)));
        assert_eq!(found.volume, 0.027 - 3e-18, "0.3 is not three tenths");
    }

    #[test]
    fn the_largest_box_is_exact() {
        let most = (1 << 26) - 1;
        let found = measure(&list(grid(1.0, 1.0, [0; 3]), &cuboid([0; 3], [most; 3], false)));
        let side = f64::from(most);
        assert_eq!(found.centre, Some([side / 2.0; 3]));
        // The cube of a 26-bit integer has 78 bits; the fifth power over 12 is compared as a
        // decimal number.
        assert_eq!(found.volume, (i128::from(most).pow(3)) as f64);
        let fifth = whole(i128::from(most).pow(4)) * whole(i128::from(most));
        assert_eq!(found.second_moments[0][0], (fifth / whole(12)).to_string().parse::<f64>().unwrap());
        assert_eq!(found.second_moments[0][1], 0.0);
    }

    #[test]
    fn tetrahedra_cavities_and_holes() {
        // The corner of a cube: moments about the corner are side^5 / 60 and / 120.
        let [o, x, y, z] = [[0; 3], [60, 0, 0], [0, 60, 0], [0, 0, 60]];
        let faces = [[o, y, x], [o, x, z], [o, z, y], [x, y, z]].map(|ring| vec![ring.to_vec()]);
        let found = measure(&list(grid(1.0, 1.0, [0; 3]), &faces));
        assert_eq!((found.volume, found.centre), (36_000.0, Some([15.0; 3])));
        let fifth = 60f64.powi(5);
        assert_eq!(found.second_moments[0][0], fifth / 60.0 - 36_000.0 * 225.0);
        assert_eq!(found.second_moments[0][1], fifth / 120.0 - 36_000.0 * 225.0);
        assert!((found.area / (1800.0 * (3.0 + 3f64.sqrt())) - 1.0).abs() < 1e-12);

        let mut faces = cuboid([0; 3], [10; 3], false);
        faces.extend(cuboid([1; 3], [3; 3], true));
        let found = measure(&list(grid(1.0, 1.0, [0; 3]), &faces));
        assert_eq!((found.volume, found.area), (992.0, 624.0));
        assert_eq!(found.centre, Some([(5000.0 - 16.0) / 992.0; 3]));

        // A box with a square tunnel along z: two faces have a hole.
        let mut faces = cuboid([0; 3], [10; 3], false);
        let tunnel = cuboid([4, 4, 0], [6, 6, 10], true);
        faces[0].extend(tunnel[0].iter().cloned());
        faces[1].extend(tunnel[1].iter().cloned());
        faces.extend(tunnel[2..].iter().cloned());
        let found = measure(&list(grid(1.0, 1.0, [0; 3]), &faces));
        assert_eq!((found.volume, found.area), (960.0, 600.0 - 8.0 + 80.0));
        assert_eq!(found.centre, Some([5.0; 3]));
        assert_eq!(found.second_moments[0][0], (1e5 - 4.0 * 4.0 * 10.0) / 12.0);
    }

    #[test]
    fn a_cube_that_is_turned_has_the_same_moments_about_all_axes() {
        // Edges along orthogonal vectors of length 9.
        let edges = [[8, 1, 4], [-4, 4, 7], [1, 8, -4]].map(|edge: [i32; 3]| edge.map(|x| 1000 * x));
        let corner = |i: usize| -> [i32; 3] {
            std::array::from_fn(|axis| {
                9_000 + (0..3).map(|edge| (i >> edge & 1) as i32 * edges[edge][axis]).sum::<i32>()
            })
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        // (These vectors are a left-handed system.)
        let face = |quad: [usize; 4]| vec![quad.into_iter().rev().map(corner).collect()];
        let found = measure(&list(grid(1.0, 1.0, [0; 3]), &quads.map(face)));
        let side = 9000f64;
        assert_eq!((found.volume, found.area), (side.powi(3), 6.0 * side.powi(2)));
        for i in 0..3 {
            for j in 0..3 {
                let expected = if i == j { side.powi(5) / 6.0 } else { 0.0 };
                assert_eq!(found.inertia[i][j], expected);
            }
        }
    }

    #[test]
    fn sums_over_parts_add_up_whatever_the_parts() {
        let mut faces = cuboid([0; 3], [1000, 20, 30], false);
        faces.extend(cuboid([10; 3], [17, 18, 19], true));
        let list = list(grid(1.0, 1.0, [0; 3]), &faces);
        let sums = |range: std::ops::Range<usize>| {
            let mut sums = MassSums::new();
            range.for_each(|number| sums.add_face(&list.get(number)));
            sums
        };
        let all = sums(0..12);
        for middle in 0..=12 {
            let mut sum = sums(middle..12);
            sum.add(&sums(0..middle));
            assert_eq!(sum, all);
        }
        assert_eq!(all.measures(list.grid()), measure(&list));
        let nothing = MassSums::new().measures(list.grid());
        assert_eq!((nothing.volume, nothing.centre, nothing.bounds), (0.0, None, None));
    }
}
