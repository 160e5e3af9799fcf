//! Volume, centre, bounds and surface of solids, against their definitions.

use spinney::{Bounds, Dataset, Frame, Rule};

use crate::common::{Cells, OCT, as_byte, byte, made, opened, write_goblin};
use crate::solids::{SOLID, ball, blocks, byte_at, every_cell, solid};

/// The occupancy of a level's cells in an array, with a margin of empty ones.
struct Fill {
    side: i64,
    cells: Vec<u8>,
}

impl Fill {
    /// Empty cells on each side: as far as a moment extends beyond a face on the border.
    const AROUND: i64 = 5;

    fn of(side: u64, fill: impl Fn([u64; 3]) -> u8) -> Fill {
        let side = side as i64;
        let all = side + 2 * Fill::AROUND;
        let inside = |cell: [u64; 3]| cell.map(|at| at as i64 - Fill::AROUND);
        let at = |cell: [i64; 3]| {
            let is_inside = cell.iter().all(|at| (0..side).contains(at));
            if is_inside { fill(cell.map(|at| at as u64)) } else { 0 }
        };
        Fill { side, cells: every_cell([all as u64; 3]).map(|cell| at(inside(cell))).collect() }
    }

    fn index(&self, [x, y, z]: [i64; 3]) -> i64 {
        let all = self.side + 2 * Fill::AROUND;
        ((z + Fill::AROUND) * all + y + Fill::AROUND) * all + x + Fill::AROUND
    }

    fn at(&self, cell: [i64; 3]) -> u8 {
        self.cells[self.index(cell) as usize]
    }
}

/// The area of a solid's smooth surface by its definition: for each face between a cell that is at
/// least half full and one that is not, the projection along the first moment of the occupancy
/// within 4 cells, with weights that fall to 0 at the sphere.
fn naive_area(fill: &Fill) -> f64 {
    let mut area = 0.0;
    for axis in 0..3 {
        // The contributing cells, by their offset in the array: weights, and weights times the
        // vector from the face's centre.
        let mut around = Vec::new();
        for other in every_cell([9; 3]) {
            let other = other.map(|at| at as i64 - 4);
            let away: [f64; 3] = std::array::from_fn(|a| other[a] as f64 + if a == axis { 0.5 } else { 0.0 });
            let weight = 16.0 - away.iter().map(|x| x * x).sum::<f64>();
            if weight > 0.0 {
                around.push((fill.index(other) - fill.index([0; 3]), away.map(|x| weight * x)));
            }
        }
        for cell in every_cell([fill.side as u64 + 1; 3]) {
            let cell = cell.map(|cell| cell as i64);
            let mut before = cell;
            before[axis] -= 1;
            if (fill.at(cell) >= 128) == (fill.at(before) >= 128) {
                continue;
            }
            let (mut sum, middle) = ([0.0; 3], fill.index(cell));
            for (away, moment) in &around {
                let full = f64::from(fill.cells[(middle + away) as usize]);
                (0..3).for_each(|a| sum[a] += full * moment[a]);
            }
            let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
            area += if length > 0.0 { sum[axis].abs() / length } else { 1.0 };
        }
    }
    area
}

#[test]
fn surfaces_of_half_full_cells_and_of_large_blocks() {
    // Cells of any occupancy, so that some in the interior do not count.
    let graded = made(OCT, [40, 23, 37], |[x, y, z]| {
        let fill = (x * 7919 + y * 104_729 + z * 1_299_709) >> 3 & 255;
        // 250 is the nodata value for writing cells.
        (fill > 99 && fill != 250).then(|| byte(fill as u8))
    });
    // Blocks of 64 cells next to each other and at the border, with a hole across several.
    let large = made(OCT, [128, 100, 64], |[x, y, z]| {
        let is_hole = (30..80).contains(&x) && (20..50).contains(&y) && (31..33).contains(&z);
        (x < 64 || z < 32).then(|| byte(255)).filter(|_| !is_hole)
    });
    for cells in [graded, large] {
        let file = solid(&cells);
        let side = 1u64 << cells.depth();
        let fill = Fill::of(side, |cell| cells.get(cell).map_or(0, as_byte));
        let mut faces = [0; 3];
        for cell in every_cell([side + 1; 3]) {
            let cell = cell.map(|cell| cell as i64);
            for axis in 0..3 {
                let mut before = cell;
                before[axis] -= 1;
                faces[axis] += u64::from((fill.at(cell) >= 128) != (fill.at(before) >= 128));
            }
        }
        let found = file.solid_surface(cells.depth(), &()).unwrap();
        assert_eq!(found.faces, faces);
        let area = naive_area(&fill);
        assert!((found.smooth_area() / area - 1.0).abs() < 1e-9, "{} {area}", found.smooth_area());
        // Blocks away from the surface are not read.
        assert!(found.blocks <= (side / 32 + 1).pow(3), "{}", found.blocks);
    }
    let cube = made(OCT, [256; 3], |cell| cell.iter().all(|cell| *cell < 128).then(|| byte(255)));
    let found = solid(&cube).solid_surface(8, &()).unwrap();
    assert_eq!(found.faces, [2 * 128 * 128; 3]);
    // Of 4 x 4 blocks on each of six sides, those at its border.
    assert_eq!(found.blocks, 6 * 12);
}

#[test]
fn solids_are_measured_node_by_node() {
    let cells = blocks(3, [60, 33, 22]);
    let file = solid(&cells);
    // Each INNER node once, at the deepest level all of them; a uniform tree has none.
    assert_eq!(file.solid(6, &()).unwrap().nodes, file.metadata().counts.records());
    let above: Vec<u64> = (0..=6).map(|level| file.solid(level, &()).unwrap().nodes).collect();
    assert!(above.is_sorted() && above[0] == 0 && above[1] == 1, "{above:?}");
    // The result does not depend on the thread count, not even in the last digit.
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (file.solid(6, &()).unwrap(), file.solid_surface(6, &()).unwrap()))
    });
    assert_eq!(one, three);
}

#[test]
fn solids_are_measured_as_they_are_counted() {
    for (seed, size) in
        [(1, [16, 16, 16]), (2, [9, 14, 5]), (3, [30, 17, 22]), (4, [1, 1, 1]), (5, [40, 33, 64])]
    {
        let cells = blocks(seed, size);
        let (file, model) = (solid(&cells), cells.tree(Rule::Occupancy));
        for level in 0..=cells.depth() {
            let side = 1u64 << level;
            let fill = Fill::of(side, |cell| byte_at(&model, level, cell));
            let (mut sum, mut count, mut moment, mut faces) = (0u64, 0, [0.0; 3], [0u64; 3]);
            let mut bounds: Option<Bounds> = None;
            for cell in every_cell([side; 3]) {
                let signed = cell.map(|cell| cell as i64);
                let full = fill.at(signed);
                sum += u64::from(full);
                for axis in 0..3 {
                    moment[axis] += f64::from(full) * (cell[axis] as f64 + 0.5);
                    for shift in [-1, 1] {
                        let mut other = signed;
                        other[axis] += shift;
                        faces[axis] += u64::from(full >= 128 && fill.at(other) < 128);
                    }
                }
                if full > 0 {
                    count += 1;
                    let all = bounds.get_or_insert(Bounds { min: cell, max: cell.map(|cell| cell + 1) });
                    for (axis, number) in cell.iter().enumerate() {
                        all.min[axis] = all.min[axis].min(*number);
                        all.max[axis] = all.max[axis].max(number + 1);
                    }
                }
            }
            let found = file.solid(level, &()).unwrap();
            let what = format!("seed {seed} level {level}");
            assert_eq!((found.cells, found.bounds), (count, bounds), "{what}");
            let surface = file.solid_surface(level, &()).unwrap();
            assert_eq!((surface.level, surface.faces), (level, faces), "{what}");
            // World coordinates are in cells of the deepest level.
            let area = naive_area(&fill) * 4f64.powi(i32::from(cells.depth() - level));
            let found_area = surface.smooth_area();
            assert!((found_area - area).abs() < 1e-9 * area.max(1.0), "{what}: {found_area} {area}");
            assert_eq!(found.volume, sum as f64 / 255.0, "{what}");
            assert_eq!(found.centre.is_some(), sum > 0);
            for (axis, centre) in found.centre.into_iter().flatten().enumerate() {
                assert!((centre - moment[axis] / sum as f64).abs() < 1e-9, "{what}");
            }
        }
    }
}

#[test]
fn surfaces_are_near_the_true_ones() {
    let sphere = |radius: f64| 4.0 * std::f64::consts::PI * radius * radius;
    let file = solid(&ball(6, 25.0));
    let found = file.solid_surface(6, &()).unwrap();
    assert!(
        (found.smooth_area() / sphere(25.0) - 1.0).abs() < 0.01,
        "{}",
        found.smooth_area() / sphere(25.0)
    );
    assert!((found.block_area() / sphere(25.0) - 1.5).abs() < 0.02);
    // A coarser level keeps the volume up to the rounding of each cell, and nearly the surface.
    let volume = |level: u8| file.solid(level, &()).unwrap().world_volume();
    assert!((volume(4) / volume(6) - 1.0).abs() < 0.005);
    let coarse = file.solid_surface(4, &()).unwrap();
    assert!(
        (coarse.smooth_area() / sphere(25.0) - 1.0).abs() < 0.08,
        "{}",
        coarse.smooth_area() / sphere(25.0)
    );
    // A cube is only rounded at its edges.
    let cube = made(OCT, [64; 3], |cell| cell.iter().all(|cell| (8..56).contains(cell)).then(|| byte(255)));
    let found = solid(&cube).solid_surface(6, &()).unwrap();
    let area = 6.0 * 48.0 * 48.0;
    assert_eq!(found.block_area(), area);
    assert!((found.smooth_area() / area - 1.0).abs() < 0.08, "{}", found.smooth_area() / area);
}

/// Writes a file with a frame.
fn framed(cells: &Cells, matrix: [[f64; 4]; 3]) -> Dataset {
    opened(|path| write_goblin(path, cells, SOLID, Frame { matrix, ..Frame::identity() }))
}

#[test]
fn measures_go_through_the_frame() {
    // Cells of 1 by 2 by 4, mirrored along y and rotated about z: the ball becomes an ellipsoid.
    let (s, c) = (0.6, 0.8);
    let matrix = [[c, 2.0 * s, 0.0, 100.0], [s, -2.0 * c, 0.0, -50.0], [0.0, 0.0, 4.0, 7.0]];
    let file = framed(&ball(6, 25.0), matrix);
    let found = file.solid(6, &()).unwrap();
    assert!((found.world_volume() - 8.0 * found.volume).abs() < 1e-6);
    let centre = found.world_centre().unwrap();
    let expected = [c * 32.0 + 2.0 * s * 32.0 + 100.0, s * 32.0 - 2.0 * c * 32.0 - 50.0, 4.0 * 32.0 + 7.0];
    assert!(centre.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{centre:?}");
    // Thomsen's formula, accurate to one percent.
    let [a, b, d] = [25.0f64, 50.0, 100.0];
    let p = 1.6075;
    let surface = file.solid_surface(6, &()).unwrap();
    let mean = ((a * b).powf(p) + (a * d).powf(p) + (b * d).powf(p)) / 3.0;
    let area = 4.0 * std::f64::consts::PI * mean.powf(1.0 / p);
    assert!((surface.smooth_area() / area - 1.0).abs() < 0.04, "{}", surface.smooth_area() / area);
    let [low, high] = found.world_bounds().unwrap();
    assert_eq!([low[2], high[2]], [7.0 + 4.0 * 7.0, 7.0 + 4.0 * 57.0]);
}
