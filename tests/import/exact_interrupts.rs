//! Cancellation of long operations on exact models, at any of their checks, and their progress.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use spinney::brep::{Faces, Motion, TransformOptions, combine, transform};
use spinney::export::{MeshFormat, VectorFormat, export_exact};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::surface_intersection::surface_intersection;
use spinney::raw::brep::{InsideRule, ModelView};
use spinney::raw::export::vector::{SectionPlanes, export_objects, export_section};
use spinney::raw::import::mesh::model_contacts;
use spinney::{Codec, Error, ExactModel, OpenOptions, Output, Progress, Result, SetOperation};

/// Little enough that faces go to temporary files; repairs need to hold them.
const MEMORY: u64 = 1 << 20;
const PLENTY: u64 = 64 << 20;

/// Cancels after a number of checks, and records progress.
struct Impatient {
    patience: u64,
    checks: AtomicU64,
    /// The work done, and each total reported.
    reported: Mutex<(u64, Vec<u64>)>,
}

impl Impatient {
    fn new(patience: u64) -> Impatient {
        Impatient { patience, checks: AtomicU64::new(0), reported: Mutex::default() }
    }
}

impl Progress for Impatient {
    fn advance(&self, done: u64, total: u64) {
        let mut reported = self.reported.lock().unwrap();
        reported.0 += done;
        reported.1.push(total);
    }

    fn interrupted(&self) -> bool {
        self.checks.fetch_add(1, Ordering::Relaxed) >= self.patience
    }
}

/// An operation that may write a file into a directory.
type Work<'a> = dyn Fn(&Path, &dyn Progress) -> Result<()> + 'a;

/// Runs an operation with at least `least` checks and cancels it at many of them: each time it ends
/// as cancelled and leaves no file. Returns the progress of the run without cancellation.
fn check(what: &str, least: u64, work: &Work<'_>) -> (u64, Vec<u64>) {
    const MOMENTS: u64 = 8;
    let run = |patience: u64| {
        let directory = tempfile::tempdir().unwrap();
        let progress = Impatient::new(patience);
        let done = work(directory.path(), &progress);
        let left = std::fs::read_dir(directory.path()).unwrap().count();
        (done, progress, left)
    };
    let (done, patient, _) = run(u64::MAX);
    done.unwrap();
    let all = patient.checks.into_inner();
    assert!(all >= least, "{what}: {all} checks, expected at least {least}");
    for moment in 0..MOMENTS {
        // Includes the last check.
        let patience = (all - 1) * moment / (MOMENTS - 1);
        let (done, _, left) = run(patience);
        assert!(matches!(done, Err(Error::Interrupted)), "{what} after {patience} of {all}: {done:?}");
        assert_eq!(left, 0, "{what} after {patience} of {all}");
    }
    patient.reported.into_inner().unwrap()
}

/// Returns two intersecting tori, each of `2 * side * side` triangles, as an OBJ file with an
/// object each; or one of them.
fn tori(directory: &Path, side: i32, which: &[i32]) -> PathBuf {
    let angle = |step: i32| f64::from(step) * std::f64::consts::TAU / f64::from(side);
    let mut text = String::new();
    for (number, shift) in (0..).zip(which) {
        text += &format!("o torus{shift}\n");
        for (u, v) in (0..side).flat_map(|i| (0..side).map(move |j| (angle(i), angle(j)))) {
            let radius = 300.0 + 100.0 * v.cos();
            let at = [radius * u.cos(), radius * u.sin(), 100.0 * v.sin()].map(|at| at.round());
            text += &format!(
                "v {} {} {}\n",
                at[0] + 71.0 * f64::from(*shift),
                at[1],
                at[2] + 13.0 * f64::from(*shift)
            );
        }
        let corner = |i: i32, j: i32| 1 + side * side * number + i % side * side + j % side;
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
        }
    }
    let path = directory.join(format!("tori{which:?}.obj"));
    std::fs::write(&path, text).unwrap();
    path
}

fn options(memory: u64, set: impl FnOnce(&mut ExactOptions)) -> ExactOptions {
    let mut options = ExactOptions::new();
    (options.memory, options.snap) = (memory, Some(0.25));
    set(&mut options);
    options
}

fn build(mesh: &Path, options: &ExactOptions, directory: &Path, progress: &dyn Progress) -> Result<()> {
    let models = open_all(&[mesh.to_path_buf()], PLENTY)?;
    import_exact(models, options, Output::create(&directory.join("model.goblin"))?, progress).map(|_| ())
}

/// Returns models of the first and the second torus.
fn models(directory: &Path, side: i32) -> [ExactModel; 2] {
    [0, 1].map(|shift| {
        let mesh = tori(directory, side, &[shift]);
        let path = directory.join(format!("{shift}.goblin"));
        let models = open_all(&[mesh], PLENTY).unwrap();
        import_exact(models, &options(MEMORY, |_| ()), Output::create(&path).unwrap(), &()).unwrap();
        ExactModel::open(&path, &OpenOptions::new()).unwrap()
    })
}

#[test]
fn cancelled_builds_and_repairs_leave_no_files() {
    let input = tempfile::tempdir().unwrap();
    // The first torus's faces take 1.7 times the words that a sorted run holds in memory.
    let (one, both) = (tori(input.path(), 36, &[0]), tori(input.path(), 24, &[0, 1]));
    let plain = options(MEMORY / 4, |_| ());
    check("build", 10, &|directory, progress| build(&one, &plain, directory, progress));
    let repair = options(PLENTY, |options| options.repair = true);
    check("repair", 100, &|directory, progress| build(&both, &repair, directory, progress));
    let positive = options(PLENTY, |options| (options.repair, options.inside) = (true, InsideRule::Positive));
    check("positive repair", 100, &|directory, progress| build(&both, &positive, directory, progress));
    let skip =
        options(PLENTY, |options| (options.repair, options.skip_bad, options.close) = (true, true, true));
    check("repair of objects", 100, &|directory, progress| build(&both, &skip, directory, progress));
    // Without the last faces both tori are open.
    let text = std::fs::read_to_string(&one).unwrap();
    let open = input.path().join("open.obj");
    std::fs::write(&open, text.rsplit_once("f ").unwrap().0).unwrap();
    let close = options(MEMORY / 4, |options| options.close = true);
    check("closing", 10, &|directory, progress| build(&open, &close, directory, progress));
}

#[test]
fn cancelled_operations_on_models_leave_no_files() {
    let input = tempfile::tempdir().unwrap();
    let models = models(input.path(), 50);
    let [a, b] = models.map(ModelView::from);
    let (view, a, b) = (&a, a.file(), b.file());
    let file = |directory: &Path, name: &str| Output::create(&directory.join(name));
    for operation in [SetOperation::Difference, SetOperation::Union] {
        check("combine", 50, &|directory, progress| {
            let output = file(directory, "made.goblin")?;
            combine(operation, &[a, b], output, Codec::Packed, PLENTY, progress).map(|_| ())
        });
    }
    let rows = |turn: f64| {
        [[turn.cos(), -turn.sin(), 0.0, 1.0], [turn.sin(), turn.cos(), 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
    };
    for turn in [0.0, 0.3] {
        let motion = Motion::from_rows(rows(turn)).unwrap();
        let how = TransformOptions::new(MEMORY);
        check("transform", 10, &|directory, progress| {
            transform(a, &motion, &how, file(directory, "made.goblin")?, progress).map(|_| ())
        });
    }
    for format in [MeshFormat::Ply, MeshFormat::Obj, MeshFormat::Stl, MeshFormat::CityJson] {
        check("export", 4, &|directory, progress| {
            export_exact(a, format, file(directory, "made")?, progress).map(|_| ())
        });
    }
    let planes: Vec<SectionPlanes> = vec!["z=-90..90/3".parse().unwrap()];
    check("section", 100, &|directory, progress| {
        export_section(
            view,
            &planes,
            (false, false),
            file(directory, "made.geojson")?,
            VectorFormat::GeoJson,
            progress,
        )
        .map(|_| ())
    });
    check("stats --each", 2, &|directory, progress| {
        export_objects(view, None, file(directory, "made.csv")?, VectorFormat::Csv, MEMORY, progress)
            .map(|_| ())
    });
    check("section of two", 20, &|_, progress| surface_intersection(a, b, PLENTY, progress).map(|_| ()));
    check("verify", 10, &|_, progress| a.verify(MEMORY, progress).map(|_| ()));
}

#[cfg(feature = "meshopt")]
#[test]
fn cancelled_levels_and_files_for_viewers_leave_nothing() {
    use spinney::brep::{add_levels, with_levels};
    use spinney::export::{GltfOptions, export_model_glb, export_model_tileset};
    use spinney::raw::io::OutputDirectory;
    let input = tempfile::tempdir().unwrap();
    let [model, _] = models(input.path(), 50);
    let output = |directory: &Path| Output::create(&directory.join("made"));
    check("levels", 4, &|directory, progress| {
        add_levels(&model, (output(directory)?, Codec::Packed), PLENTY, progress).map(|_| ())
    });
    let one = tori(input.path(), 30, &[0]);
    check("build with levels", 10, &|directory, progress| {
        let models = open_all(std::slice::from_ref(&one), PLENTY)?;
        let options = options(PLENTY, |_| ());
        with_levels(output(directory)?, PLENTY, progress, |output| {
            import_exact(models, &options, output, progress)
        })
        .map(|_| ())
    });
    let path = input.path().join("levels.goblin");
    add_levels(&model, (Output::create(&path).unwrap(), Codec::Plain), PLENTY, &()).unwrap();
    let model = ExactModel::open(&path, &OpenOptions::new()).unwrap();
    assert!(model.levels().len() > 2);
    check("glTF", 2, &|directory, progress| {
        export_model_glb(&model, &GltfOptions::new(), output(directory)?, progress).map(|_| ())
    });
    check("3D Tiles", 2, &|directory, progress| {
        let output = OutputDirectory::create(&directory.join("tiles"))?;
        export_model_tileset(&model, &GltfOptions::new(), output, MEMORY, progress).map(|_| ())
    });
}

#[test]
fn searches_for_contacts_are_cancelled() {
    let input = tempfile::tempdir().unwrap();
    let mesh = tori(input.path(), 40, &[0, 1]);
    check("contacts", 100, &|_, progress| {
        let models = open_all(std::slice::from_ref(&mesh), PLENTY)?;
        model_contacts(models, &options(PLENTY, |_| ()), progress, &mut |_| Ok(true))
    });
}

/// Progress reaches the total, which is constant from the start and reported well before the end.
#[test]
fn progress_comes_to_its_end() {
    let input = tempfile::tempdir().unwrap();
    let both = tori(input.path(), 60, &[0, 1]);
    let [a, b] = models(input.path(), 60);
    let complete = |what: &str, least: usize, work: &Work<'_>| {
        let directory = tempfile::tempdir().unwrap();
        let progress = Impatient::new(u64::MAX);
        work(directory.path(), &progress).unwrap();
        let (done, totals) = progress.reported.into_inner().unwrap();
        let total = totals[0];
        assert!(totals.iter().all(|other| *other == total), "{what}: {totals:?}");
        assert!(totals.len() >= least, "{what}: {} reports", totals.len());
        assert!(done <= total && done + total / 50 >= total, "{what}: {done} of {total}");
    };
    for inside in [InsideRule::Nonzero, InsideRule::Positive] {
        let repair = options(PLENTY, |options| (options.repair, options.inside) = (true, inside));
        complete("repair", 10, &|directory, progress| build(&both, &repair, directory, progress));
    }
    let skip = options(PLENTY, |options| (options.repair, options.skip_bad) = (true, true));
    complete("repair of objects", 10, &|directory, progress| build(&both, &skip, directory, progress));
    complete("combine", 5, &|directory, progress| {
        let output = Output::create(&directory.join("made.goblin"))?;
        combine(SetOperation::Union, &[&a, &b], output, Codec::Plain, PLENTY, progress).map(|_| ())
    });
    let motion =
        Motion::from_rows([[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]]).unwrap();
    assert!(a.len() > 4096);
    let directory = tempfile::tempdir().unwrap();
    let progress = Impatient::new(u64::MAX);
    let output = Output::create(&directory.path().join("made.goblin")).unwrap();
    transform(&a, &motion, &TransformOptions::new(PLENTY), output, &progress).unwrap();
    let (done, totals) = progress.reported.into_inner().unwrap();
    assert!(totals.iter().all(|total| *total == 3 * a.len()) && done == 3 * a.len(), "{done} of {totals:?}");
}
