//! Cancellation of long operations on solids. The tests count checks, not time.

use std::sync::atomic::{AtomicU64, Ordering};

use spinney::import::mesh::{SolidOptions, plan_models};
use spinney::query::EdgeRule;
use spinney::raw::import::mesh::{InsideTest, SolidReport};
use spinney::{DataKind, Error, Output, Progress, Result, Rule};

use crate::common::solid::{Triangle, plain, tetrahedra, unit_cells};
use crate::common::{OCT, Random, byte, goblin_bytes, made, with};

/// Cancels after a number of checks.
struct Impatient {
    patience: u64,
    checks: AtomicU64,
}

impl Impatient {
    fn new(patience: u64) -> Impatient {
        Impatient { patience, checks: AtomicU64::new(0) }
    }

    fn checks(&self) -> u64 {
        self.checks.load(Ordering::Relaxed)
    }
}

impl Progress for Impatient {
    fn interrupted(&self) -> bool {
        self.checks.fetch_add(1, Ordering::Relaxed) >= self.patience
    }
}

/// Runs an operation with at least `least` checks and cancels it at four of them: it then ends at
/// the next check.
fn check(work: &dyn Fn(&dyn Progress) -> Result<()>, least: u64, what: &str) {
    let patient = Impatient::new(u64::MAX);
    work(&patient).unwrap();
    let all = patient.checks();
    assert!(all >= least, "{what}: {all} checks, expected at least {least}");
    for quarter in 0..4 {
        let patience = all * quarter / 4;
        let impatient = Impatient::new(patience);
        assert!(matches!(work(&impatient), Err(Error::Interrupted)), "{what} after {patience} of {all}");
        assert_eq!(impatient.checks(), patience + 1, "{what}");
    }
}

fn build(triangles: &[Triangle], options: &SolidOptions, progress: &dyn Progress) -> Result<SolidReport> {
    let directory = tempfile::tempdir().unwrap();
    let output = Output::create(&directory.path().join("solid.goblin")).unwrap();
    let built = plan_models(vec![plain(triangles)], options).unwrap().build(output, progress);
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), usize::from(built.is_ok()));
    built
}

#[test]
fn one_block_of_many_triangles_is_interrupted_within() {
    let triangles = tetrahedra(&mut Random(5), 20, 16.0, 0.37);
    let soup: Vec<Triangle> = triangles.iter().step_by(3).copied().collect();
    for edge in [EdgeRule::Centre, EdgeRule::Touch, EdgeRule::Area] {
        let options = with(unit_cells(4), |it| it.edge = edge);
        for (triangles, inside) in [(&triangles, InsideTest::Closed), (&soup, InsideTest::Open)] {
            let work = |progress: &dyn Progress| {
                build(triangles, &options, progress).map(|report| assert_eq!(report.inside, inside))
            };
            check(&work, 2 * triangles.len() as u64, &format!("{edge:?}, {inside:?}"));
        }
    }
    let surface = with(unit_cells(4), |it| it.shell = true);
    let work = |progress: &dyn Progress| build(&soup, &surface, progress).map(|_| ());
    check(&work, soup.len() as u64, "surface");
}

#[test]
fn division_of_space_is_interrupted_at_each_triangle() {
    let triangles = tetrahedra(&mut Random(5), 100, 256.0, 0.37);
    let work = |progress: &dyn Progress| build(&triangles, &unit_cells(8), progress).map(|_| ());
    let patient = Impatient::new(u64::MAX);
    work(&patient).unwrap();
    // The root's triangles are visited twice, those of its children once more.
    assert!(patient.checks() > 3 * triangles.len() as u64, "{}", patient.checks());
    // Blocks that were begun at the same time end at their first check.
    let impatient = Impatient::new(patient.checks() / 2);
    assert!(matches!(work(&impatient), Err(Error::Interrupted)));
    assert!(
        impatient.checks() <= patient.checks() / 2 + 64,
        "{} of {}",
        impatient.checks(),
        patient.checks()
    );
}

/// An operation that can be cancelled.
type Work<'a> = dyn Fn(&Impatient) -> spinney::Result<()> + Sync + 'a;

#[test]
fn measures_of_solids_are_interrupted() {
    let cells = made(OCT, [64; 3], |[x, y, z]| ((3 * x + 5 * y + 7 * z) % 5 < 2).then(|| byte(255)));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("solid.goblin");
    std::fs::write(&path, goblin_bytes(&cells, Rule::Occupancy, DataKind::Continuous)).unwrap();
    let tree = spinney::open(&path).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let volume = |progress: &Impatient| tree.solid(6, progress).map(|_| ());
    let surface = |progress: &Impatient| tree.solid_surface(6, progress).map(|_| ());
    // Each of 8 x 8 x 8 nodes that threads share checks once; in each of 8 blocks each plane of
    // faces does.
    let works: [(&Work<'_>, u64); 2] = [(&volume, 512), (&surface, 24)];
    for (work, least) in works {
        let patient = Impatient::new(u64::MAX);
        pool.install(|| work(&patient)).unwrap();
        assert!(patient.checks() >= least, "{}", patient.checks());
        let impatient = Impatient::new(patient.checks() / 2);
        assert!(matches!(pool.install(|| work(&impatient)), Err(Error::Interrupted)));
        // Each shared task checks once more.
        assert!(impatient.checks() < patient.checks() / 2 + 600, "{}", impatient.checks());
    }
}
