//! Remote jobs, rasters and outputs.

use std::path::{Path, PathBuf};

use spinney::import::raster::{ImportOptions, plan as plan_rasters};
use spinney::raw::shards::{Job, JobSpec, plan};
use spinney::{Error, Output, Result};

use super::server::{Fault, Server};
use super::{access, server};

fn fixture_bytes(name: &str) -> Vec<u8> {
    std::fs::read(format!("{}/fixtures/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn is_there(url: &str) -> bool {
    access().stat_companions(&[Path::new(url)]).unwrap()[0].is_some()
}

fn spec(url: &str) -> JobSpec {
    JobSpec::Rasters { inputs: vec![url.into()], options: ImportOptions::new() }
}

/// Returns the file built from a raster in a single process.
fn whole(url: &str, directory: &Path) -> Vec<u8> {
    let path = directory.join("whole.goblin");
    let mut options = ImportOptions::new();
    options.access = access();
    let import = plan_rasters(&[url.into()], &options).unwrap();
    import.build(Output::create(&path).unwrap(), &()).unwrap();
    std::fs::read(path).unwrap()
}

/// Builds a job, and merges it on this machine.
fn make(job: &Path, directory: &Path) -> Result<Vec<u8>> {
    let merged = directory.join("merged.goblin");
    for number in 0..Job::open_with(job, &access())?.shards() {
        Job::open_with(job, &access())?.build(number, 64 << 20, &())?;
    }
    Job::open_with(job, &access())?.merge(Output::create(&merged)?.into(), 64 << 20, &())?;
    Ok(std::fs::read(merged).unwrap())
}

#[test]
fn remote_jobs_make_the_same_bytes_and_are_removed() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let url = server.put("jobs/elevation.tif", fixture_bytes("island_elevation.tif")) + "?signed=a.b";
    let expected = whole(&url, directory.path());
    let paths = ["memory:///jobs/a".into(), directory.path().join("job")];
    for job in paths {
        assert!(!plan(&spec(&url), &job, Some(3), &access(), &()).unwrap().existed);
        assert!(plan(&spec(&url), &job, Some(3), &access(), &()).unwrap().existed);
        let other = plan(&spec(&url), &job, Some(4), &access(), &()).unwrap_err();
        assert!(matches!(other, Error::PlanMismatch { .. }), "{other}");
        assert_eq!(Job::open_with(&job, &access()).unwrap().missing().unwrap(), [0, 1, 2]);
        assert!(make(&job, directory.path()).unwrap() == expected);
        assert!(Job::open_with(&job, &access()).unwrap().missing().unwrap().is_empty());
        let plan: PathBuf = job.join("plan.json");
        let is_planned = || access().stat_companions(&[&plan]).unwrap()[0].is_some();
        assert!(is_planned());
        Job::open_with(&job, &access()).unwrap().remove().unwrap();
        assert!(Job::find(&job, &access()).unwrap().is_none() && !is_planned());
    }
    assert!(!directory.path().join("job").exists());
    let left = ["head.goblin", "shards/0000.summary", "shards/0001.summary", "shards/0001-0.run"];
    assert!(!left.iter().any(|name| is_there(&format!("memory:///jobs/a/{name}"))));
}

#[test]
fn rasters_that_hosts_refuse_are_reported() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let url = server.put("refused/classes.tif", fixture_bytes("island_classes.tif"));
    // Temporary faults of a host are tolerated. Nothing is cached of a file with another query.
    for (number, fault) in [Fault::Busy(2), Fault::CutBodies(2)].into_iter().enumerate() {
        let (url, job) = (format!("{url}?{number}"), directory.path().join(format!("{number}")));
        server.set_fault(fault);
        plan(&spec(&url), &job, Some(2), &access(), &()).unwrap();
        server.set_fault(fault);
        let made = make(&job, directory.path()).unwrap();
        server.set_fault(Fault::None);
        assert!(made == whole(&url, directory.path()));
    }
    let fails = |server: &Server, name: &str, fault| {
        let job = directory.path().join(name);
        plan(&spec(&url), &job, Some(1), &access(), &()).unwrap();
        server.set_fault(fault);
        let error = Job::open_with(&job, &access()).unwrap().build(0, 64 << 20, &()).unwrap_err();
        server.set_fault(Fault::None);
        assert!(error.to_string().contains("refused/classes.tif"), "{error}");
        assert_eq!(Job::open_with(&job, &access()).unwrap().missing().unwrap(), [0]);
        error
    };
    assert!(matches!(fails(&server, "forbidden", Fault::Forbidden), Error::Io { .. }));
    assert!(matches!(fails(&server, "changed", Fault::Changes(0)), Error::PlanMismatch { .. }));
    // Unreadable sidecars count as missing.
    assert!(!is_there(&format!("{}/refused/none.prj", server.address)));
    let gone = plan(
        &spec(&format!("{}/refused/none.tif", server.address)),
        &directory.path().join("none"),
        None,
        &access(),
        &(),
    );
    assert!(gone.unwrap_err().to_string().contains("none.tif"));
}
