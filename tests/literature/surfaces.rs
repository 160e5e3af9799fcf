//! Tyukachev's paper: surfaces of triangles (CTIN), and constrained triangulations.

use spinney::brep::Faces;
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::export::vector::{LineSectionOptions, SectionLine, line_section};
use spinney::raw::tin::{
    LayerInput, LayerOptions, LayerSurface, Smoothing, SurfaceInput, Tin, build_layers, triangulate,
};
use spinney::{ExactModel, Output};

/// A height function of x and y.
type Height = fn(f64, f64) -> f64;

/// Returns random numbers below a bound, with a fixed seed.
fn random(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) % below
    }
}

/// Twice the area of a triangle with integer coordinates.
fn twice_area([a, b, c]: [[f64; 2]; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn corners(tin: &Tin) -> Vec<[[f64; 2]; 3]> {
    let positions: Vec<[f64; 2]> = tin.vertices().map(|[x, y, _]| [x, y]).collect();
    tin.triangles().iter().map(|corners| corners.map(|corner| positions[corner as usize])).collect()
}

/// Returns whether the interiors of two segments intersect, or one has an end inside the other.
fn cross([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> bool {
    let sides = [twice_area([a, b, c]), twice_area([a, b, d]), twice_area([c, d, a]), twice_area([c, d, b])];
    let is_within = |p: [f64; 2], a: [f64; 2], b: [f64; 2]| {
        p != a
            && p != b
            && (0..2).all(|axis| (a[axis].min(b[axis])..=a[axis].max(b[axis])).contains(&p[axis]))
    };
    (sides[0] * sides[1] < 0.0 && sides[2] * sides[3] < 0.0)
        || (sides[0] == 0.0 && is_within(c, a, b))
        || (sides[1] == 0.0 && is_within(d, a, b))
        || (sides[2] == 0.0 && is_within(a, c, d))
        || (sides[3] == 0.0 && is_within(b, c, d))
}

#[test]
fn item_54_two_triangles_meet_in_a_vertex_or_a_whole_edge() {
    for seed in 0..10 {
        let mut random = random(seed);
        let mut input = SurfaceInput::default();
        for _ in 0..40 {
            let [x, y] = [random(32) as f64, random(32) as f64];
            input.points.push([x, y, x - y]);
        }
        input.breaklines = vec![vec![[-1.0, 9.0, 0.0], [33.0, 9.0, 0.0]]];
        input.duplicates = spinney::raw::tin::Duplicates::Mean;
        let (tin, _) = triangulate(&input).unwrap();
        let triangles = corners(&tin);
        for (number, first) in triangles.iter().enumerate() {
            assert!(twice_area(*first) > 0.0);
            for second in &triangles[..number] {
                let edges = |[a, b, c]: [[f64; 2]; 3]| [[a, b], [b, c], [c, a]];
                for one in edges(*first) {
                    assert!(
                        edges(*second).into_iter().all(|other| !cross(one, other)),
                        "{first:?} {second:?}"
                    );
                }
            }
        }
        // Each input point is a triangle vertex.
        for [x, y, _] in &input.points {
            assert!(triangles.iter().flatten().any(|corner| corner == &[*x, *y]));
        }
    }
}

#[test]
fn item_54_layers_are_closed() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("layers.goblin");
    let heights: [(&str, Height); 4] = [
        ("ground", |x, y| 40.0 + (x / 5.0).sin() + y / 9.0),
        ("sand", |x, _| 30.0 + x / 8.0),
        ("ore", |x, y| 25.0 + (x + y) / 10.0),
        ("base", |_, _| 10.0),
    ];
    // All surfaces have the same boreholes.
    let mut random = random(3);
    let holes: Vec<[f64; 2]> = (0..120).map(|_| [0; 2].map(|_| random(100) as f64)).collect();
    let surface = |(name, height): (&str, Height)| LayerSurface {
        name: name.into(),
        points: holes.iter().map(|[x, y]| [*x, *y, height(*x, *y)]).collect(),
    };
    let input = LayerInput { surfaces: heights.map(surface).into(), ..LayerInput::default() };
    let output = Output::create(&path).unwrap();
    let report = build_layers(&input, &LayerOptions::new(), output, &()).unwrap();
    let model = ExactModel::open(&path, &Default::default()).unwrap();
    assert_eq!(model.parts(), ["ground to sand", "sand to ore", "ore to base"]);
    let topology = Topology::of(&model, &TopologyOptions::default(), &()).unwrap();
    assert!(topology.counts_by_shell().iter().all(|counts| counts.boundaries == 0));
    assert!(report.layers.iter().all(|layer| layer.volume > 0.0));
}

#[test]
fn item_54_layers_have_the_volumes_of_integrals() {
    // Between z = 5 + (x² + y²) / 16 and the plane z = x / 4 - 2, over a square of side 8.
    let exact = 320.0 + 2.0 * 8f64.powi(4) / 48.0 - (64.0 - 128.0);
    for step in [2.0, 1.0, 0.5] {
        let count = (8.0 / step) as u32;
        let surface = |name: &str, height: Height| {
            let positions = (0..=count).flat_map(|row| (0..=count).map(move |column| [column, row]));
            let positions = positions.map(|place| place.map(|at| f64::from(at) * step));
            LayerSurface { name: name.into(), points: positions.map(|[x, y]| [x, y, height(x, y)]).collect() }
        };
        let top = surface("top", |x, y| 5.0 + (x * x + y * y) / 16.0);
        let input = LayerInput {
            surfaces: vec![top, surface("base", |x, _| x / 4.0 - 2.0)],
            ..LayerInput::default()
        };
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("bowl.goblin");
        let report = build_layers(&input, &LayerOptions::new(), Output::create(&path).unwrap(), &()).unwrap();
        // Chords of x² are above it by a sixth of the squared step length, on average.
        let expected = exact + 2.0 * 64.0 * step * step / 6.0 / 16.0;
        assert!((report.layers[0].volume - expected).abs() < 1e-4, "{report:?} {expected}");
    }
}

#[test]
fn item_61_lines_in_a_face_are_edges_and_not_crossed() {
    for seed in 0..30 {
        let mut random = random(seed + 50);
        // A triangular face, and non-crossing lines on it: the intersection of two solids within
        // one face.
        let mut input = SurfaceInput {
            points: vec![[0.0, 0.0, 0.0], [200.0, 0.0, 0.0], [0.0, 200.0, 0.0]],
            ..SurfaceInput::default()
        };
        let mut segments: Vec<[[f64; 2]; 2]> = Vec::new();
        while segments.len() < 8 {
            let segment = [0; 2].map(|_: i32| [0; 2].map(|_: i32| 1.0 + random(98) as f64));
            let is_separate = |other: &[[f64; 2]; 2]| {
                !cross(*other, segment) && other.iter().all(|end| !segment.contains(end))
            };
            if segment[0] != segment[1] && segments.iter().all(is_separate) {
                segments.push(segment);
            }
        }
        let line = |segment: &[[f64; 2]; 2]| segment.iter().map(|[x, y]| [*x, *y, 0.0]).collect();
        input.breaklines = segments.iter().map(line).collect();
        let (tin, _) = triangulate(&input).unwrap();
        let triangles = corners(&tin);
        for [a, b] in &segments {
            let is_edge = triangles.iter().any(|[p, q, r]| {
                [[p, q], [q, r], [r, p]].iter().any(|edge| *edge == [a, b] || *edge == [b, a])
            });
            assert!(is_edge, "{a:?} {b:?}");
        }
        assert_eq!(triangles.iter().map(|corners| twice_area(*corners)).sum::<f64>(), 40_000.0);
        // A triangulation of n points, b of them on the boundary, has 2n - 2 - b triangles.
        assert_eq!(triangles.len(), 2 * tin.vertices().len() - 2 - 3);
    }
}

#[test]
fn item_62_a_face_with_an_inner_triangle_is_seven() {
    let inner = [[3.0, 2.0, 0.0], [5.0, 3.0, 0.0], [4.0, 5.0, 0.0]];
    let input = SurfaceInput {
        points: vec![[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [4.0, 9.0, 0.0]],
        breaklines: vec![vec![inner[0], inner[1], inner[2], inner[0]]],
        ..SurfaceInput::default()
    };
    let (tin, _) = triangulate(&input).unwrap();
    assert_eq!(tin.triangles().len(), 2 * 6 - 2 - 3);
    let wanted = inner.map(|[x, y, _]| [x, y]);
    let is_inner = |corners: &[[f64; 2]; 3]| corners.iter().all(|corner| wanted.contains(corner));
    assert_eq!(corners(&tin).iter().filter(|corners| is_inner(corners)).count(), 1);
}

#[test]
fn item_62_a_box_of_sixteen_triangles_has_ten_vertices() {
    // A layer over a square with a point in the middle: four triangles above, four below, and four
    // walls of two.
    let place = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [2.0, 2.0]];
    let surface = |name: &str, height: f64| LayerSurface {
        name: name.into(),
        points: place.iter().map(|[x, y]| [*x, *y, height]).collect(),
    };
    let input =
        LayerInput { surfaces: vec![surface("top", 4.0), surface("base", 0.0)], ..LayerInput::default() };
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("box.goblin");
    let report = build_layers(&input, &LayerOptions::new(), Output::create(&path).unwrap(), &()).unwrap();
    assert_eq!((report.faces, report.layers[0].volume), (4 + 4 + 4, 64.0));
    let model = ExactModel::open(&path, &Default::default()).unwrap();
    let euler = Topology::of(&model, &TopologyOptions::default(), &()).unwrap().euler();
    // Each wall that is cut into two triangles has one edge more: 10 - 24 + 16 = 2.
    let (triangles, edges) = (euler.faces + 4, euler.edges + 4);
    assert_eq!((euler.vertices, edges, triangles), (10, 24, 16));
}

#[test]
fn item_54_triangulations_are_smoothed_and_have_isolines() {
    // The paper's other tasks: a hill sampled by boreholes, with a fault across it.
    let hill = |x: f64, y: f64| 900.0 - (x - 30.0).powi(2) - (y - 30.0).powi(2);
    let mut input = SurfaceInput::default();
    for row in 0..=12 {
        for column in 0..=12 {
            let [x, y] = [column, row].map(|at| f64::from(at) * 5.0);
            input.points.push([x, y, hill(x, y)]);
        }
    }
    input.breaklines = vec![(0..=12).map(|at| [f64::from(at) * 5.0, 15.0, f64::NAN]).collect()];
    let (tin, _) = triangulate(&input).unwrap();
    assert_eq!(tin.constraints().len(), 12);
    let (area, volume) = tin.integral();
    // The hill's integral, up to the error of chords of length 5 (at least a twelfth of 5² along
    // each axis).
    let expected = 3600.0 * 900.0 - 2.0 * 60.0 * (2.0 * 30f64.powi(3) / 3.0);
    assert_eq!(area, 3600.0);
    assert!((0.0..3600.0 * 25.0 / 2.0).contains(&(expected - volume)), "{volume} {expected}");
    let (smooth, _) = tin.smoothed(&Smoothing::of_passes(3), &()).unwrap();
    assert!(smooth.range().unwrap().1 < 900.0);
    for [x, _, z] in smooth.vertices().filter(|vertex| vertex[1] == 15.0) {
        assert_eq!(z, hill(x, 15.0));
    }
    let mut lengths = Vec::new();
    tin.isolines(&[600.0, 800.0], &mut |line| {
        assert!(line.is_closed());
        let steps =
            line.points.windows(2).map(|ends| (ends[0][0] - ends[1][0]).hypot(ends[0][1] - ends[1][1]));
        lengths.push(steps.sum::<f64>());
        Ok(())
    })
    .unwrap();
    let circle = |level: f64| 2.0 * std::f64::consts::PI * (900.0 - level).sqrt();
    assert_eq!(lengths.len(), 2);
    assert!(lengths[0] / circle(600.0) > 0.9 && lengths[0] / circle(600.0) < 1.1, "{lengths:?}");
}

#[test]
fn item_54_sections_of_layers_are_triangulated() {
    // A layer between a tilted plane and a fold, cut at an angle: its section is not convex.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("fold.goblin");
    let top = |x: f64, _: f64| 20.0 + (x - 16.0).abs() / 2.0;
    let base = |x: f64, y: f64| x / 4.0 - y / 8.0;
    let surface = |name: &str, height: Height| {
        let positions = (0..=8).flat_map(|row| (0..=8).map(move |column| [column, row]));
        let points = positions.map(|at| at.map(|at| f64::from(at) * 4.0));
        LayerSurface { name: name.into(), points: points.map(|[x, y]| [x, y, height(x, y)]).collect() }
    };
    let input =
        LayerInput { surfaces: vec![surface("top", top), surface("base", base)], ..LayerInput::default() };
    let report = build_layers(&input, &LayerOptions::new(), Output::create(&path).unwrap(), &()).unwrap();
    // Over a square of side 32: the mean of |x - 16| is 8, that of x and of y is 16.
    assert!((report.layers[0].volume - 1024.0 * (20.0 + 4.0 - 4.0 + 2.0)).abs() < 1e-3, "{report:?}");
    let view = ExactModel::open(&path, &Default::default()).unwrap().into();
    for (line, expected) in [
        ("0,10,32,10", 32.0 * (20.0 + 4.0 - 4.0 + 1.25)),
        ("16,-5,16,99", 32.0 * (20.0 - 4.0 + 2.0)),
        ("32,0,0,32", 32.0 * 2f64.sqrt() * (20.0 + 4.0 - 4.0 + 2.0)),
    ] {
        let line: SectionLine = line.parse().unwrap();
        let (mut areas, mut counts) = ([0.0; 2], [0; 2]);
        for triangles in [false, true] {
            let options = LineSectionOptions { flat: true, triangles };
            let made = line_section(&view, &line, &options, &(), &mut |figure| {
                areas[usize::from(triangles)] += figure.area;
                // A triangulated ring of n vertices has n - 2 triangles, some of which are slivers
                // between vertices on a line.
                counts[usize::from(triangles)] += if triangles { 1 } else { figure.rings[0].len() - 3 };
                assert!(figure.area > 0.0 && figure.object == "top to base");
                Ok(())
            });
            assert_eq!(made.unwrap().objects.len(), 1);
        }
        assert!((areas[0] - expected).abs() < 1e-4 && (areas[1] - expected).abs() < 1e-4, "{areas:?}");
        assert!(counts[1] > 4 && counts[1] <= counts[0], "{counts:?}");
    }
}
