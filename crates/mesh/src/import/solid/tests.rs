//! Solids built in shards are byte-identical to a single-process build.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::*;
use crate::import::{Model, open_all};
use spinney_base::io::Output;
use spinney_base::space::{Code, CodeRange, Dimension, EdgeRule};
use spinney_engine::store::goblin::{Shard, ShardRange, merge_shards};
use spinney_engine::store::{Packing, TreeWriter};

/// Vertices, and faces of vertex indices.
#[derive(Default)]
struct Mesh {
    points: Vec<[f64; 3]>,
    faces: Vec<Vec<usize>>,
}

impl Mesh {
    /// Surface that is periodic in both directions.
    fn round(counts: [usize; 2], point: impl Fn(f64, f64) -> [f64; 3]) -> Mesh {
        let mut mesh = Mesh::default();
        let turn = |at: usize, of: usize| at as f64 / of as f64 * std::f64::consts::TAU;
        let [n, m] = counts;
        for (u, v) in (0..n).flat_map(|u| (0..m).map(move |v| (u, v))) {
            mesh.points.push(point(turn(u, n), turn(v, m)));
            let at = |u: usize, v: usize| u % n * m + v % m;
            mesh.faces.push(vec![at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)]);
        }
        mesh
    }

    fn torus() -> Mesh {
        Mesh::round([40, 24], |u, v| {
            let away = 50.0 + 20.0 * v.cos();
            [away * u.cos() + 3.3, away * u.sin(), 20.0 * v.sin() + 0.7 * u.cos()]
        })
    }

    /// Ball around a point.
    fn ball(middle: [f64; 3], radius: f64) -> Mesh {
        let (rings, sides) = (14, 28);
        let mut mesh = Mesh::default();
        for ring in 0..=rings {
            let polar = ring as f64 / rings as f64 * std::f64::consts::PI;
            for side in 0..if ring % rings == 0 { 1 } else { sides } {
                let around = side as f64 / sides as f64 * std::f64::consts::TAU;
                let unit = [polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos()];
                mesh.points.push(std::array::from_fn(|axis| middle[axis] + radius * unit[axis]));
            }
        }
        let at = |ring: usize, side: usize| match ring {
            0 => 0,
            _ if ring == rings => 1 + (rings - 1) * sides,
            _ => 1 + (ring - 1) * sides + side % sides,
        };
        for (ring, side) in (0..rings).flat_map(|ring| (0..sides).map(move |side| (ring, side))) {
            let mut face =
                vec![at(ring, side), at(ring + 1, side), at(ring + 1, side + 1), at(ring, side + 1)];
            face.dedup();
            if face.first() == face.last() {
                face.pop();
            }
            mesh.faces.push(face);
        }
        mesh
    }

    fn cube([min, max]: [[f64; 3]; 2]) -> Mesh {
        let ends = [min, max];
        let corner = |number: usize| std::array::from_fn(|axis| ends[number >> axis & 1][axis]);
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Mesh { points: (0..8).map(corner).collect(), faces: faces.map(|face| face.to_vec()).to_vec() }
    }

    fn with(mut self, other: Mesh) -> Mesh {
        let first = self.points.len();
        self.points.extend(other.points);
        self.faces.extend(other.faces.iter().map(|face| face.iter().map(|corner| first + corner).collect()));
        self
    }

    fn turned(mut self) -> Mesh {
        self.faces.iter_mut().for_each(|face| face.reverse());
        self
    }

    fn save(&self, path: &Path) -> PathBuf {
        let mut text = format!("OFF\n{} {} 0\n", self.points.len(), self.faces.len());
        for [x, y, z] in &self.points {
            writeln!(text, "{x} {y} {z}").unwrap();
        }
        for face in &self.faces {
            let corners: Vec<String> = face.iter().map(usize::to_string).collect();
            writeln!(text, "{} {}", corners.len(), corners.join(" ")).unwrap();
        }
        std::fs::write(path, text).unwrap();
        path.into()
    }
}

struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    fn models(&self, meshes: &[Mesh]) -> Vec<PathBuf> {
        (0..)
            .zip(meshes)
            .map(|(number, mesh)| mesh.save(&self.0.path().join(format!("{number}.off"))))
            .collect()
    }

    /// Compares the bytes of merged shards with those of a single-process build.
    fn compare(&self, meshes: &[Mesh], options: &SolidOptions, is_divided: bool) {
        let (directory, paths) = (self.0.path(), self.models(meshes));
        let open = || -> Vec<Box<dyn Model>> { open_all(&paths, 1 << 20).unwrap() };
        let [whole, head, merged] =
            ["whole", "head", "merged"].map(|name| directory.join(name).with_extension("goblin"));
        let import = plan_models(open(), options).unwrap();
        let depth = import.grid.depth;
        let report = import.build(Output::create(&whole).unwrap(), &()).unwrap();
        assert!(report.cells > 0);
        let whole = std::fs::read(whole).unwrap();

        let mut file = TreeWriter::head(Output::create(&head).unwrap(), (Dimension::Oct, depth), 1).unwrap();
        let level = depth.saturating_sub(6).min(3);
        let import = plan_models(open(), options).unwrap();
        let (survey, _) =
            import.survey(&mut file, &|header| header.shape.shard_level(), directory, &()).unwrap();
        file.finish().unwrap();
        assert_eq!(survey.is_divided, is_divided);
        assert!(survey.nodes.is_sorted_by_key(|node| node.code.bits()));
        let units = 1u64 << (3 * level);
        let unit = |number: u64| {
            let digits = (0..level).rev().map(|digit| (number >> (3 * digit) & 7) as usize);
            Code::from_digits(Dimension::Oct, digits).unwrap()
        };
        for cuts in [&[0][..], &[0, 1, 2, 3, 5, 6, 7], &[0, 8, 9, 23, 36, 60]] {
            if cuts.iter().any(|cut| *cut >= units) {
                continue;
            }
            let ends: Vec<u64> = cuts.iter().copied().chain([units]).collect();
            let mut shards = Vec::new();
            for (number, pair) in (0..).zip(ends.windows(2)) {
                let mut run = CodeRange::of(unit(pair[0]), unit(pair[1] - 1)).unwrap();
                if pair[1] == units {
                    run = CodeRange::new(run.ends()[0], CodeRange::ALL.ends()[1]).unwrap();
                }
                let ranges = vec![ShardRange { layer: 0, run }];
                let shard =
                    Shard { directory: directory.into(), job: 1, number, ranges, access: Default::default() };
                let mut file = TreeWriter::shard(&head, shard.clone()).unwrap();
                // (A plan stores only these nodes.)
                let mut shard_survey = survey.clone();
                shard_survey.nodes.retain(|node| !node.inside.is_empty());
                let import = plan_part(open(), options, shard_survey).unwrap();
                import.write(&mut file, directory, &()).unwrap();
                file.finish().unwrap();
                shards.push(shard);
            }
            let output = Output::create(&merged).unwrap();
            merge_shards(&head, &shards, output.into(), 1 << 20, &()).unwrap();
            assert!(std::fs::read(&merged).unwrap() == whole, "{cuts:?} {options:?}");
        }
    }
}

/// Number of cells along the longest side, little memory, and a rule for cut cells.
fn options(cells: u64, edge: EdgeRule) -> SolidOptions {
    let mut options = SolidOptions::new();
    (options.resolution, options.edge, options.memory) = (Resolution::Cells(cells), edge, 1 << 16);
    options
}

#[test]
fn shards_of_closed_surfaces_make_the_bytes_of_a_build() {
    let files = TestDirectory(tempfile::tempdir().unwrap());
    // Nested balls, with winding number 2 inside, and a cavity.
    let nested = Mesh::ball([0.0; 3], 40.0).with(Mesh::ball([3.0, 1.0, 0.5], 22.0));
    files.compare(&[nested], &options(70, EdgeRule::Area), false);
    let hollow = Mesh::ball([0.0; 3], 40.0).with(Mesh::ball([3.0, 1.0, 0.5], 22.0).turned());
    files.compare(&[hollow], &options(70, EdgeRule::Centre), false);
    files.compare(&[Mesh::torus()], &options(80, EdgeRule::Touch), false);
    let mut packed = options(130, EdgeRule::Centre);
    packed.packing = Packing::packed();
    files.compare(&[Mesh::torus()], &packed, false);
    files.compare(&[Mesh::torus()], &options(50, EdgeRule::Centre), false);
    let mut shell = options(80, EdgeRule::Centre);
    shell.shell = true;
    files.compare(&[Mesh::torus()], &shell, false);
}

#[test]
fn shards_of_cubes_along_cells_make_the_bytes_of_a_build() {
    let files = TestDirectory(tempfile::tempdir().unwrap());
    for edge in [EdgeRule::Centre, EdgeRule::Area, EdgeRule::Touch] {
        let mut options = options(1, edge);
        options.resolution = Resolution::Cell(1.0);
        // Cubes along walls of units; two of them share a wall.
        let cubes = Mesh::cube([[0.0; 3], [64.0, 128.0, 100.0]])
            .with(Mesh::cube([[64.0, 0.0, 0.0], [128.0, 64.0, 64.0]]));
        files.compare(&[cubes], &options, false);
        let mut bar = Mesh::cube([[0.0; 3], [200.0, 3.0, 70.0]]);
        bar.faces[0].reverse();
        files.compare(&[bar], &options, false);
    }
}

#[test]
fn shards_of_several_objects_make_the_bytes_of_a_build() {
    let files = TestDirectory(tempfile::tempdir().unwrap());
    let balls = || {
        [
            Mesh::ball([0.0; 3], 30.0),
            Mesh::ball([25.0, 3.0, 0.0], 20.0),
            Mesh::cube([[-5.0; 3], [60.0, 5.0, 5.0]]),
        ]
    };
    let mut parts = options(120, EdgeRule::Centre);
    parts.attribute = Attribute::PartNumber;
    files.compare(&balls(), &parts, false);
    parts.edge = EdgeRule::Touch;
    files.compare(&balls(), &parts, false);
    // A partly inverted object is distinguished from the others.
    let mut turned = balls();
    turned[1].faces.iter_mut().step_by(7).for_each(|face| face.reverse());
    parts.memory = 1 << 24;
    files.compare(&turned, &parts, true);
    let mut area = options(120, EdgeRule::Area);
    area.memory = 1 << 24;
    files.compare(&turned, &area, true);
}

#[test]
fn parts_of_open_surfaces_are_refused() {
    let files = TestDirectory(tempfile::tempdir().unwrap());
    let mut torus = Mesh::torus();
    torus.faces.pop();
    let paths = files.models(&[torus]);
    let mut options = options(100, EdgeRule::Centre);
    options.memory = 1 << 24;
    let import = plan_models(open_all(&paths, 1 << 20).unwrap(), &options).unwrap();
    let head = Output::create(&files.0.path().join("head.goblin")).unwrap();
    let mut file = TreeWriter::head(head, (Dimension::Oct, 7), 1).unwrap();
    let error = import.survey(&mut file, &|_| 1, files.0.path(), &()).unwrap_err();
    assert!(error.to_string().contains("--shell"), "{error}");
}
