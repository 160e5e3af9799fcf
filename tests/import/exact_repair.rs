//! Self-intersecting surfaces, resolved by winding numbers.

use std::path::Path;

use spinney::brep::{Faces, Grid, Location, MassProperties};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::brep::{FaceList, InsideRule};
use spinney::raw::import::mesh::ExactReport;
use spinney::{Error, ExactModel, OpenOptions, Output};

use crate::common::exact::{Ring, cuboid, prism, turned};
use crate::common::solid::winding;
use crate::common::{Random, shared_data};

type Solid = Vec<Vec<Ring>>;

/// Writes faces without holes to a file.
fn write(faces: &Solid, path: &Path) {
    let corners: Vec<[i32; 3]> = faces.iter().flat_map(|rings| rings[0].iter().copied()).collect();
    let mut text = format!("OFF\n{} {} 0\n", corners.len(), faces.len());
    corners.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
    let mut first = 0;
    for rings in faces {
        text += &rings[0].len().to_string();
        (first..first + rings[0].len()).for_each(|corner| text += &format!(" {corner}"));
        text += "\n";
        first += rings[0].len();
    }
    std::fs::write(path, text).unwrap();
}

fn options(snap: Option<f64>) -> ExactOptions {
    let mut options = ExactOptions::new();
    (options.repair, options.snap) = (true, snap);
    options
}

fn import(path: &Path, options: &ExactOptions) -> Result<(ExactModel, ExactReport), Error> {
    let target = path.with_extension("goblin");
    let models = open_all(&[path.to_path_buf()], 64 << 20)?;
    let report = import_exact(models, options, Output::create(&target)?, &())?;
    Ok((ExactModel::open(&target, &OpenOptions::new())?, report))
}

/// Repairs faces on a grid with units of `width`.
fn repaired(faces: &Solid, width: f64) -> Result<(ExactModel, ExactReport), Error> {
    repaired_by(faces, width, InsideRule::default())
}

/// Repairs faces by a rule.
fn repaired_by(faces: &Solid, width: f64, rule: InsideRule) -> Result<(ExactModel, ExactReport), Error> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.off");
    write(faces, &path);
    let mut options = options(Some(width));
    options.inside = rule;
    let found = import(&path, &options)?;
    assert_eq!(found.0.verify(64 << 20, &()).unwrap(), []);
    Ok(found)
}

fn volume(model: &ExactModel) -> f64 {
    let euler = Topology::of(model, &TopologyOptions::default(), &()).unwrap().euler();
    assert_eq!(euler.boundaries, 0);
    MassProperties::of(model, &()).unwrap().volume
}

fn triangles(faces: &Solid) -> Solid {
    let fan =
        |ring: &Ring| (2..ring.len()).map(|i| vec![vec![ring[0], ring[i - 1], ring[i]]]).collect::<Vec<_>>();
    faces.iter().flat_map(|rings| fan(&rings[0])).collect()
}

#[test]
fn bodies_that_overlap_become_one() {
    let cube = cuboid([0; 3], [100; 3]);
    let join = |parts: &[Solid]| parts.concat();
    let cases = [
        ("apart", join(&[cube.clone(), cuboid([200; 3], [300; 3])]), 2e6),
        ("a corner in common", join(&[cube.clone(), cuboid([50; 3], [150; 3])]), 2e6 - 50f64.powi(3)),
        ("one in the other", join(&[cube.clone(), cuboid([20; 3], [70; 3])]), 1e6),
        ("a cavity", join(&[cube.clone(), turned(cuboid([20; 3], [70; 3]))]), 1e6 - 50f64.powi(3)),
        ("twice", join(&[cube.clone(), cube.clone()]), 1e6),
        ("twice, in triangles", join(&[cube.clone(), triangles(&cube)]), 1e6),
        ("a face in common", join(&[cube.clone(), cuboid([100, 0, 0], [150, 100, 100])]), 1.5e6),
        ("a part of a face in common", join(&[cube.clone(), cuboid([100, 20, 30], [150, 60, 130])]), 1.2e6),
        ("faces in one plane", join(&[cube.clone(), cuboid([50, 0, 0], [150, 100, 100])]), 1.5e6),
        ("through", join(&[cube.clone(), cuboid([20, 20, -50], [40, 40, 150])]), 1e6 + 400.0 * 100.0),
        ("an edge in common", join(&[cube.clone(), cuboid([100, 100, 0], [150, 150, 100])]), 1.25e6),
        ("inside out", turned(cube.clone()), 1e6),
        ("inside out, disjoint", join(&[cube.clone(), turned(cuboid([200; 3], [220; 3]))]), 1e6 + 8000.0),
        ("inside out across", join(&[cube.clone(), turned(cuboid([50; 3], [150; 3]))]), 2e6 - 50f64.powi(3)),
        (
            "inside out, with a cavity",
            join(&[turned(cube.clone()), cuboid([20; 3], [70; 3])]),
            1e6 - 50f64.powi(3),
        ),
        (
            "inside out, with what is full",
            join(&[turned(cube.clone()), turned(cuboid([20; 3], [70; 3]))]),
            1e6,
        ),
        (
            "a shell within a shell, inside out",
            join(&[
                turned(cube.clone()),
                cuboid([10; 3], [90; 3]),
                turned(cuboid([30; 3], [70; 3])),
                cuboid([40; 3], [60; 3]),
                turned(cuboid([200; 3], [300; 3])),
            ]),
            2e6 - 80f64.powi(3) + 40f64.powi(3) - 20f64.powi(3),
        ),
        (
            "an edge on a face",
            {
                let wedge = prism(&[vec![[100, 50], [140, 30], [140, 70]]], 20, 80);
                join(&[cube.clone(), wedge])
            },
            1e6 + 800.0 * 60.0,
        ),
    ];
    for (name, faces, expected) in cases {
        // Also in reverse order, and as triangles.
        let mut backwards = faces.clone();
        backwards.reverse();
        for faces in [faces.clone(), backwards, triangles(&faces)] {
            let (model, report) = repaired(&faces, 1.0).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(volume(&model), expected, "{name}");
            assert_eq!(report.repair.unwrap().displacement, 0.0, "{name}");
        }
    }
}

#[test]
fn repairs_keep_valid_models_unchanged() {
    let solid =
        [cuboid([0; 3], [300; 3]), turned(cuboid([50; 3], [250; 3])), cuboid([100; 3], [200; 3])].concat();
    let (model, report) = repaired(&solid, 1.0).unwrap();
    assert!(report.repair.unwrap().is_nothing());
    let list = FaceList::of(&model).unwrap();
    let faces: Solid = (0..list.len() as usize).map(|face| vec![list.get(face).points.to_vec()]).collect();
    assert_eq!(faces, solid);
}

#[test]
fn surfaces_without_an_interior_are_reported() {
    // A plate without thickness, and a duplicated cube under the even-odd rule.
    let plate =
        vec![vec![vec![[0, 0, 0], [9, 0, 0], [0, 9, 0]]], vec![vec![[0, 0, 0], [0, 9, 0], [9, 0, 0]]]];
    let cube = cuboid([0; 3], [100; 3]);
    let twice = [cube.clone(), cube].concat();
    for (faces, rule) in [(&plate, InsideRule::Nonzero), (&twice, InsideRule::Odd)] {
        let error = repaired_by(faces, 1.0, rule).err().unwrap();
        assert!(
            matches!(&error, Error::NotASolid { what, .. } if what.contains("nothing is inside")),
            "{error}"
        );
    }
}

/// A cube, one overlapping its corner, a smaller one inside with the same orientation, and one with
/// the opposite orientation: by all rules.
#[test]
fn inside_rules_select_other_regions() {
    use InsideRule::{Nonzero, Odd, Positive};
    let cube = cuboid([0; 3], [100; 3]);
    let faces = [cube, cuboid([90; 3], [110; 3]), cuboid([10; 3], [30; 3]), turned(cuboid([50; 3], [60; 3]))]
        .concat();
    let all = 1e6 + 7000.0 - 1000.0;
    // The inner cube raises the winding number to 2; the reversed one leaves a hole by all rules.
    for (rule, expected) in [(Nonzero, all), (Positive, all), (Odd, all - 8000.0 - 1000.0)] {
        let (model, report) = repaired_by(&faces, 1.0, rule).unwrap();
        assert_eq!(volume(&model), expected, "{rule:?}");
        let done = report.repair.unwrap();
        assert_eq!((done.volume, done.cells_volume), (expected, all), "{rule:?}");
        // Regions with winding number 2 count twice.
        assert_eq!(done.volume_before, 1e6 + 8000.0 + 8000.0 - 1000.0);
    }
    // A hole that is subtracted twice: the winding number is 0 if subtracted once, negative if
    // twice.
    let hole = turned(cuboid([50; 3], [60; 3]));
    let faces = [cuboid([0; 3], [100; 3]), hole.clone(), hole].concat();
    for (rule, expected) in [(Nonzero, 1e6), (Positive, 1e6 - 1000.0), (Odd, 1e6)] {
        assert_eq!(volume(&repaired_by(&faces, 1.0, rule).unwrap().0), expected, "{rule:?}");
    }
}

/// Faces that bound nothing are counted. A surface that consists mostly of such faces is not a
/// solid.
#[test]
fn what_is_lost_is_counted_and_most_of_a_surface_is_not_lost() {
    let plate = |side: i32| -> Solid {
        let ring = vec![[200, 0, 0], [200 + side, 0, 0], [200 + side, side, 0], [200, side, 0]];
        let turned = ring.iter().rev().copied().collect();
        vec![vec![ring], vec![turned]]
    };
    let cube = cuboid([0; 3], [100; 3]);
    // In addition to 6 x 100²: 2 x 20² of that.
    let done = repaired(&[cube.clone(), plate(20)].concat(), 1.0).unwrap().1.repair.unwrap();
    assert_eq!((done.removed, done.outside, done.turned), (2, 2, (0, 0)));
    assert!((done.outside_share - 800.0 / 60_800.0).abs() < 1e-15, "{}", done.outside_share);
    let error = repaired(&[cube.clone(), plate(180)].concat(), 1.0).err().unwrap();
    assert!(matches!(&error, Error::NotASolid { what, .. } if what.contains("51 percent")), "{error}");
    // A rule that removes most of the solid.
    let error = repaired_by(&[cube, cuboid([5; 3], [95; 3])].concat(), 1.0, InsideRule::Odd).err().unwrap();
    assert!(
        matches!(&error, Error::NotASolid { what, .. } if what.contains("72 percent") && what.contains("271000")),
        "{error}"
    );
    // Walls between solids are interior, and not a loss.
    let mut stack = Solid::new();
    for cell in 0..27 {
        let low = [cell % 3, cell / 3 % 3, cell / 9].map(|at| at * 10);
        stack.extend(cuboid(low, low.map(|at| at + 10)));
    }
    let (model, report) = repaired(&stack, 1.0).unwrap();
    assert_eq!((volume(&model), report.repair.unwrap().outside), (27_000.0, 0));
}

/// A star whose outline intersects itself: its centre has winding number 2.
#[test]
fn a_pentagram_is_its_outline() {
    let star = vec![[0, 950], [588, -809], [-951, 309], [951, 309], [-588, -809]];
    let ring: Vec<[i32; 2]> = star.into_iter().rev().collect();
    // All faces are triangles: the caps are fans, which overlap.
    let faces = triangles(&prism(&[ring], -100, 100));
    let (model, _) = repaired(&faces, 1.0 / 64.0).unwrap();
    // Even-odd excludes the centre; by winding numbers, the whole star is inside.
    let points =
        [[0.0, 0.0, 0.0], [0.0, 600.0, 0.0], [0.0, -500.0, 0.0], [400.0, 250.0, 50.0], [600.0, -100.0, 0.0]];
    let expected = [true, true, false, true, false];
    let mut located = Vec::new();
    for point in points {
        located.push(model.locate(point).unwrap() == Location::Inside);
    }
    assert_eq!(located, expected);
    volume(&model);
}

/// Points against winding numbers of the input surface, for random solids that intersect.
#[test]
fn points_are_where_the_surface_goes_around_them() {
    let mut random = Random(5);
    let mut crossing = 0;
    for round in 0..12 {
        let count = 2 + round % 4;
        let mut faces: Solid = Vec::new();
        for _ in 0..count {
            // An octahedron with random vertices: closed, and sometimes self-intersecting.
            let mut number = |below: u64| random.below(below) as i32;
            let centre = [300 + number(300), 300 + number(300), 300 + number(300)];
            let corners: Vec<[i32; 3]> = (0..6)
                .map(|corner| {
                    let mut at = [0, 1, 2].map(|axis| centre[axis] + number(60) - 30);
                    at[corner / 2] += if corner % 2 == 0 { 80 + number(200) } else { -80 - number(200) };
                    at
                })
                .collect();
            for octant in 0..8 {
                let [a, b, c] = [0, 1, 2].map(|axis| corners[2 * axis + (octant >> axis & 1)]);
                let is_even = (octant as u32).count_ones().is_multiple_of(2);
                faces.push(vec![if is_even { vec![a, b, c] } else { vec![a, c, b] }]);
            }
        }
        if round % 3 == 2 {
            // Also with coplanar faces.
            faces.extend(cuboid([350; 3], [500; 3]));
            faces.extend(cuboid([400, 350, 300], [700, 500, 450]));
        }
        let width = if round % 2 == 0 { 1.0 / 256.0 } else { 1.0 };
        let (model, report) = repaired(&faces, width).unwrap_or_else(|error| panic!("{round}: {error}"));
        let moved = report.repair.unwrap().displacement;
        assert!(moved < 4.0 * width, "{round}: {moved}");
        crossing += u32::from(moved > 0.0);
        let before: Vec<[[f64; 3]; 3]> = triangles(&faces)
            .iter()
            .map(|rings| [0, 1, 2].map(|corner| rings[0][corner].map(f64::from)))
            .collect();
        let (mut inside, mut outside) = (0, 0);
        for _ in 0..1500 {
            let point = [0; 3].map(|_| 200.0 + random.below(500_000) as f64 / 1000.0 + 0.0003);
            let winding = winding(&before, point).round() as i32;
            let location = model.locate(point).unwrap();
            let distance = model.signed_distance(point).unwrap().abs();
            if distance > 4.0 * width {
                assert_eq!(location == Location::Inside, winding != 0, "{round}: {point:?} {winding}");
                if winding != 0 { inside += 1 } else { outside += 1 }
            }
        }
        assert!(inside > 20 && outside > 100, "{round}: {inside} {outside}");
        volume(&model);
    }
    assert!(crossing > 8, "{crossing}");
}

#[test]
fn colours_and_parts_stay_with_their_faces() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.ply");
    // Two tetrahedra, one red and one black to white along x.
    let mut text =
        String::from("ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n");
    text +=
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 8\n";
    text += "property list uchar int vertex_indices\nend_header\n";
    text += "0 0 0 255 0 0\n100 0 0 255 0 0\n0 100 0 255 0 0\n0 0 100 255 0 0\n";
    text += "-50 10 10 0 0 0\n150 10 10 255 255 255\n0 60 12 64 64 64\n0 12 60 64 64 64\n";
    for first in [0, 4] {
        for [a, b, c] in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
            text += &format!("3 {} {} {}\n", first + a, first + b, first + c);
        }
    }
    std::fs::write(&path, text).unwrap();
    let (model, report) = import(&path, &options(None)).unwrap();
    assert!(report.repair.unwrap().divided > 0);
    let list = FaceList::of(&model).unwrap();
    let grid: &Grid = list.grid();
    let (mut red, mut grey) = (0, 0);
    for number in 0..list.len() as usize {
        let face = list.get(number);
        for (point, colour) in face.points.iter().zip(face.colours) {
            let [x, _, _] = grid.to_world(*point);
            if face.source < 4 {
                assert_eq!(*colour, [255, 0, 0]);
                red += 1;
            } else {
                let expected = ((x + 50.0) / 200.0 * 255.0).clamp(0.0, 255.0);
                assert!(
                    colour[0] == colour[1] && (f64::from(colour[0]) - expected).abs() < 2.0,
                    "{x} {colour:?}"
                );
                grey += 1;
            }
        }
    }
    assert!(red > 9 && grey > 9);
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let faces = [cuboid([0; 3], [100; 3]), cuboid([33, 41, 57], [150, 160, 143])].concat();
    let lean = |faces: &Solid| -> Solid {
        let map = |p: &[i32; 3]| [2 * p[0] + p[1] / 3, 3 * p[1] - p[2] / 5, 2 * p[2] + p[0] / 7];
        triangles(faces).iter().map(|rings| vec![rings[0].iter().map(map).collect()]).collect()
    };
    let faces = lean(&faces);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.off");
    write(&faces, &path);
    let bytes = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| import(&path, &options(Some(0.01))).unwrap());
        std::fs::read(path.with_extension("goblin")).unwrap()
    });
    assert!(bytes[0] == bytes[1]);
}

#[test]
fn insufficient_memory_is_reported() {
    let mut faces = Solid::new();
    for i in 0..400 {
        faces.extend(triangles(&cuboid([i, 2 * i, 3 * i], [i + 1000, 2 * i + 1000, 3 * i + 1000])));
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.off");
    write(&faces, &path);
    let mut options = options(Some(1.0));
    options.memory = 1 << 20;
    assert!(matches!(import(&path, &options).err().unwrap(), Error::TooLarge { .. }));
    assert!(!path.with_extension("goblin").exists());
}

/// Self-intersecting scans and constructions, against volumes that another program computes with
/// exact arithmetic (libigl 2.6.3, the union of a mesh with an empty one).
#[test]
fn dirty_models_become_bodies() {
    let Some(directory) = shared_data() else { return };
    for (name, expected) in DIRTY {
        let path = directory.join("mesh").join(name);
        let there = tempfile::tempdir().unwrap();
        let target = there.path().join("x.goblin");
        let models = open_all(&[path], 64 << 20).unwrap();
        import_exact(models, &options(None), Output::create(&target).unwrap(), &())
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let found = volume(&ExactModel::open(&target, &OpenOptions::new()).unwrap());
        // Those of the thin shells Offset1 and Offset2 depend on the grid: 1.2e-5 and 7.4e-5 off
        // with the default one of 2^24 units.
        assert!((found - expected).abs() < 1e-4 * expected, "{name}: {found} {expected}");
    }
}

const DIRTY: [(&str, f64); 17] = [
    ("nasty/1313535.stl", 871694.4553242793),
    ("nasty/301921.stl", 12129.815057826228),
    ("nasty/36088.stl", 19113.93131549414),
    ("nasty/39926.stl", 21912.00534924501),
    ("nasty/51334.stl", 9645.581623410542),
    ("nasty/59082.stl", 128897.94603798837),
    ("nasty/61459.stl", 56360.54292598405),
    ("nasty/74660.stl", 31270.003342733155),
    ("nasty/91946.stl", 627.3318757182551),
    ("nasty/939888.stl", 771.9881629767725),
    ("nasty/Offset1.obj", 1614716.5048631097),
    ("nasty/Offset2.obj", 209026.71894800212),
    ("nasty/self_intersectA.obj", 0.14266215546792002),
    ("nasty/self_intersectB.obj", 0.14266443142431864),
    ("bad_two_armadillos_overlap.ply", 0.11356412684155537),
    // Inside out: the sums of their components' volumes.
    ("../hostile/bodies/horse.ply", 0.0002634182770055288),
    ("../hostile/bodies/68730.stl", 34102.55324),
];
