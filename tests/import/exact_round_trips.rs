//! Round trips: meshes become exact models, then meshes, then the same models.

use std::path::{Path, PathBuf};

use spinney::brep::{Face, Faces, MassProperties};
use spinney::export::{MeshFormat, export_exact};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::Triangulated;
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::import::mesh::{self, ExactReport, Model, ModelInfo};
use spinney::{Error, ExactModel, OpenOptions, Output, Result};

use crate::common::shared_data;

fn import(mesh: &Path, path: &Path, options: &ExactOptions) -> Result<(ExactModel, ExactReport)> {
    let models = open_all(&[mesh.to_path_buf()], 64 << 20)?;
    let report = import_exact(models, options, Output::create(path)?, &())?;
    Ok((ExactModel::open(path, &OpenOptions::new())?, report))
}

/// Returns what must be preserved: vertices, rings and parts of the faces, by face number.
fn faces(model: &dyn Faces) -> Vec<(Vec<[i32; 3]>, Vec<usize>)> {
    let mut all = Vec::new();
    let mut each = |face: &Face<'_>| {
        all.push((face.points.to_vec(), face.ring_ends.to_vec()));
        Ok(())
    };
    model.each(&mut each).unwrap();
    all
}

/// Exports a model in a format and imports it again, optionally with a given grid. Returns the
/// second model.
fn again(
    model: &ExactModel,
    directory: &Path,
    format: MeshFormat,
    name: &str,
    grid: Option<f64>,
) -> ExactModel {
    let mesh = directory.join(name);
    export_exact(model, format, Output::create(&mesh).unwrap(), &()).unwrap();
    let mut options = ExactOptions::new();
    options.snap = grid;
    import(&mesh, &directory.join("again.goblin"), &options).unwrap().0
}

/// Checks that a round trip preserves the model.
fn check(name: &str, model: &ExactModel, directory: &Path, grid: Option<f64>) {
    let topology = Topology::of(model, &TopologyOptions::default(), &()).unwrap();
    let euler = topology.euler();
    assert!(euler.boundaries == 0 && euler.genus.is_some(), "{name}: {euler:?}");
    let sum = euler.vertices as i64 - euler.edges as i64 + euler.faces as i64 - euler.rings as i64;
    assert_eq!(sum, 2 * (euler.shells as i64 - euler.genus.unwrap() as i64), "{name}");
    let expected = faces(model);
    let mass = MassProperties::of(model, &()).unwrap();
    let formats = [
        (MeshFormat::Ply, "x.ply"),
        (MeshFormat::Obj, "x.obj"),
        (MeshFormat::Off, "x.off"),
        (MeshFormat::CityJson, "x.city.json"),
    ];
    // For large models, every second format.
    let step = if model.len() > 50_000 { 2 } else { 1 };
    for (format, file) in formats.into_iter().step_by(step) {
        let second = again(model, directory, format, file, grid);
        assert_eq!(second.grid(), model.grid(), "{name} {file}");
        let divided = match format {
            MeshFormat::Ply => Triangulated::of(model).map(Some),
            MeshFormat::Obj | MeshFormat::Off => Triangulated::of_concave(model).map(Some),
            _ => Ok(None),
        };
        if let Some(divided) = divided.unwrap().filter(|divided| divided.len() != model.len()) {
            assert!(faces(&second) == faces(&divided), "{name} {file}: other triangles");
            assert_eq!(MassProperties::of(&second, &()).unwrap().volume, mass.volume, "{name} {file}");
            continue;
        }
        assert!(faces(&second) == expected, "{name} {file}: other faces");
        assert_eq!(second.nodes(), model.nodes(), "{name} {file}");
        assert_eq!(MassProperties::of(&second, &()).unwrap(), mass, "{name} {file}");
    }
}

/// All closed meshes of the test data.
#[test]
fn closed_meshes_round_trip() {
    let Some(data) = shared_data() else { return println!("skipped: no test data") };
    let directory = tempfile::tempdir().unwrap();
    for name in ["fandisk.ply", "rocker-arm.obj", "spot.ply", "armadillo.ply", "bunny_hr.ply"] {
        let mesh = data.join("mesh").join(name);
        let (model, report) =
            import(&mesh, &directory.path().join("model.goblin"), &ExactOptions::new()).unwrap();
        assert_eq!((report.cut, report.slivers, report.collapsed), (0, 0, 0), "{name}");
        assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
        check(name, &model, directory.path(), None);
    }
}

/// One part of a model.
struct PartModel {
    model: Box<dyn Model>,
    info: ModelInfo,
    part: u32,
}

impl Model for PartModel {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&mesh::MeshFace<'_>) -> Result<()>) -> Result<()> {
        let part = self.part;
        self.model.faces(&mut |face| {
            if face.part == part { each(&mesh::MeshFace { part: 0, ..*face }) } else { Ok(()) }
        })
    }
}

/// Buildings as separate solids: on the file's own grid no vertex moves, and all faces are planar.
#[test]
fn buildings_round_trip() {
    let Some(data) = shared_data() else { return println!("skipped: no test data") };
    let directory = tempfile::tempdir().unwrap();
    let path: PathBuf = data.join("mesh/cityjson/DH_01_subs.city.json");
    let parts = mesh::open(&path, 64 << 20).unwrap().info().parts.len() as u32;
    let mut built = 0;
    for part in 0..parts {
        let model = mesh::open(&path, 64 << 20).unwrap();
        let info = ModelInfo { parts: vec!["building".into()], ..model.info().clone() };
        let goblin = directory.path().join("building.goblin");
        let only: Vec<Box<dyn Model>> = vec![Box::new(PartModel { model, info, part })];
        let report = match import_exact(only, &ExactOptions::new(), Output::create(&goblin).unwrap(), &()) {
            // Some objects are groups of others, without faces.
            Err(Error::Corrupt { .. }) => continue,
            report => report.unwrap(),
        };
        built += 1;
        assert!(report.displacement < 1e-10 && report.grid.width() == 0.001, "{report:?}");
        check(
            &format!("part {part}"),
            &ExactModel::open(&goblin, &OpenOptions::new()).unwrap(),
            directory.path(),
            Some(0.001),
        );
    }
    assert_eq!(built, 9);
}

/// A face with holes remains one face with holes, whether or not the format supports holes.
#[test]
fn holes_round_trip() {
    let square =
        |low: i32, high: i32| format!("[{low},{low},0],[{high},{low},0],[{high},{high},0],[{low},{high},0]");
    // A plate of 9 x 9 with two square through holes: vertices of the bottom, then of the top.
    let corners =
        |z: i32| [square(0, 9), square(1, 3), square(5, 8)].join(",").replace(",0]", &format!(",{z}]"));
    let ring = |first: usize, turned: bool| {
        let mut ring = [first, first + 1, first + 2, first + 3];
        if turned {
            ring.reverse();
        }
        format!("{ring:?}")
    };
    let top = format!("[{},{},{}]", ring(12, false), ring(16, true), ring(20, true));
    let bottom = format!("[{},{},{}]", ring(0, true), ring(4, false), ring(8, false));
    let mut walls = Vec::new();
    for first in [0, 4, 8] {
        for i in 0..4 {
            let (a, b) = (first + i, first + (i + 1) % 4);
            let mut wall = [a, b, b + 12, a + 12];
            if first > 0 {
                wall.reverse();
            }
            walls.push(format!("[{wall:?}]"));
        }
    }
    let text = format!(
        r#"{{"type":"CityJSON","version":"2.0","transform":{{"scale":[1,1,1],"translate":[0,0,0]}},"CityObjects":{{"plate":{{"type":"Building","geometry":[{{"type":"Solid","lod":"2","boundaries":[[{top},{bottom},{}]]}}]}}}},"vertices":[{},{}]}}"#,
        walls.join(","),
        corners(0),
        corners(2)
    );
    let directory = tempfile::tempdir().unwrap();
    let mesh = directory.path().join("plate.city.json");
    std::fs::write(&mesh, text).unwrap();
    let (model, report) =
        import(&mesh, &directory.path().join("plate.goblin"), &ExactOptions::new()).unwrap();
    assert_eq!((report.faces, report.cut, report.fanned), (14, 0, 0));
    let volume = MassProperties::of(&model, &()).unwrap().volume;
    assert_eq!(volume, 2.0 * (81.0 - 4.0 - 9.0));
    let euler = Topology::of(&model, &TopologyOptions::default(), &()).unwrap().euler();
    assert_eq!((euler.rings, euler.shells, euler.genus), (4, 1, Some(2)));
    let holes = |model: &ExactModel| {
        let mut rings: Vec<usize> = faces(model).iter().map(|(_, ends)| ends.len()).collect();
        rings.sort_unstable();
        rings
    };
    let expected = holes(&model);
    assert_eq!(expected[11..], [1, 3, 3]);
    for (format, name) in
        [(MeshFormat::CityJson, "p.city.json"), (MeshFormat::Ply, "p.ply"), (MeshFormat::Obj, "p.obj")]
    {
        // Formats without a grid of their own get a finer one, and have triangles instead of holes.
        let second = again(&model, directory.path(), format, name, None);
        match format {
            MeshFormat::CityJson => assert_eq!(holes(&second), expected, "{name}"),
            _ => assert!(holes(&second).iter().all(|rings| *rings == 1), "{name}"),
        }
        assert_eq!(MassProperties::of(&second, &()).unwrap().volume, volume, "{name}");
    }
}

/// An open surface is rejected with its boundaries, or closed.
#[test]
fn open_surfaces_are_refused_or_closed() {
    let directory = tempfile::tempdir().unwrap();
    let mesh = directory.path().join("open.off");
    // A box of 2 x 3 x 4 without its lid.
    let text = "OFF\n8 5 0\n0 0 0\n2 0 0\n2 3 0\n0 3 0\n0 0 4\n2 0 4\n2 3 4\n0 3 4\n\
                4 3 2 1 0\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";
    std::fs::write(&mesh, text).unwrap();
    let path = directory.path().join("box.goblin");
    let mut options = ExactOptions::new();
    match import(&mesh, &path, &options).map(|_| ()) {
        Err(Error::NotASolid { locations, count: 1, .. }) => {
            assert!(locations[0].contains("4 edges"), "{locations:?}")
        }
        other => panic!("{other:?}"),
    }
    assert!(!path.exists());
    options.close = true;
    let (model, report) = import(&mesh, &path, &options).unwrap();
    assert_eq!(report.closed, (1, 2));
    assert_eq!(MassProperties::of(&model, &()).unwrap().volume, 24.0);
}

/// An exact model can be the input of other models: cells, and the same model again.
#[test]
fn models_are_built_of_models() {
    let directory = tempfile::tempdir().unwrap();
    let mesh = directory.path().join("box.off");
    let text = "OFF\n8 6 0\n0 0 0\n2 0 0\n2 2 0\n0 2 0\n0 0 2\n2 0 2\n2 2 2\n0 2 2\n\
                4 3 2 1 0\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n4 4 5 6 7\n";
    std::fs::write(&mesh, text).unwrap();
    let first = directory.path().join("first.goblin");
    let (model, _) = import(&mesh, &first, &ExactOptions::new()).unwrap();
    let (second, _) = import(&first, &directory.path().join("second.goblin"), &ExactOptions::new()).unwrap();
    assert!(faces(&second) == faces(&model) && second.grid() == model.grid());
    let cells = directory.path().join("cells.goblin");
    let plan = spinney::import::mesh::plan_models(
        open_all(&[first], 64 << 20).unwrap(),
        &spinney::import::mesh::SolidOptions::new(),
    )
    .unwrap();
    let report = plan.build(Output::create(&cells).unwrap(), &()).unwrap();
    assert_eq!(report.cells, 256 * 256 * 256);
}
