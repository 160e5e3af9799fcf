//! Remote jobs, rasters and outputs.

use std::path::{Path, PathBuf};

use spinney::import::raster::{ImportOptions, plan as plan_pictures};
use spinney::raw::shards::{Job, JobSpec, plan};
use spinney::{Error, Output, Result};

use super::server::{Fault, Server};
use super::{access, server};

fn picture(name: &str) -> Vec<u8> {
    std::fs::read(format!("{}/fixtures/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn is_there(url: &str) -> bool {
    access().stat_companions(&[Path::new(url)]).unwrap()[0].is_some()
}

fn spec(url: &str) -> JobSpec {
    JobSpec::Pictures { inputs: vec![url.into()], options: ImportOptions::new() }
}

/// Returns the file built from a raster in a single process.
fn whole(url: &str, folder: &Path) -> Vec<u8> {
    let path = folder.join("whole.goblin");
    let mut options = ImportOptions::new();
    options.access = access();
    let import = plan_pictures(&[url.into()], &options).unwrap();
    import.build(Output::create(&path).unwrap(), &()).unwrap();
    std::fs::read(path).unwrap()
}

/// Builds a job, and merges it on this machine.
fn make(job: &Path, folder: &Path) -> Result<Vec<u8>> {
    let merged = folder.join("merged.goblin");
    for number in 0..Job::open_with(job, &access())?.shards() {
        Job::open_with(job, &access())?.build(number, 64 << 20, &())?;
    }
    Job::open_with(job, &access())?.merge(Output::create(&merged)?.into(), 64 << 20, &())?;
    Ok(std::fs::read(merged).unwrap())
}

#[test]
fn jobs_elsewhere_make_the_same_bytes_and_are_removed() {
    let server = server();
    let folder = tempfile::tempdir().unwrap();
    let url = server.put("jobs/elevation.tif", picture("island_elevation.tif")) + "?signed=a.b";
    let expected = whole(&url, folder.path());
    let places = ["memory:///jobs/a".into(), folder.path().join("job")];
    for job in places {
        assert!(!plan(&spec(&url), &job, Some(3), &access(), &()).unwrap().was_there);
        assert!(plan(&spec(&url), &job, Some(3), &access(), &()).unwrap().was_there);
        let other = plan(&spec(&url), &job, Some(4), &access(), &()).unwrap_err();
        assert!(matches!(other, Error::PlanMismatch { .. }), "{other}");
        assert_eq!(Job::open_with(&job, &access()).unwrap().missing().unwrap(), [0, 1, 2]);
        assert!(make(&job, folder.path()).unwrap() == expected);
        assert!(Job::open_with(&job, &access()).unwrap().missing().unwrap().is_empty());
        let plan: PathBuf = job.join("plan.json");
        let is_planned = || access().stat_companions(&[&plan]).unwrap()[0].is_some();
        assert!(is_planned());
        Job::open_with(&job, &access()).unwrap().remove().unwrap();
        assert!(Job::find(&job, &access()).unwrap().is_none() && !is_planned());
    }
    assert!(!folder.path().join("job").exists());
    let left = ["head.goblin", "shards/0000.summary", "shards/0001.summary", "shards/0001-0.run"];
    assert!(!left.iter().any(|name| is_there(&format!("memory:///jobs/a/{name}"))));
}

#[test]
fn pictures_that_hosts_do_not_give_are_told() {
    let server = server();
    let folder = tempfile::tempdir().unwrap();
    let url = server.put("told/classes.tif", picture("island_classes.tif"));
    // Temporary faults of a host are tolerated. Nothing is cached of a file with another query.
    for (number, fault) in [Fault::Busy(2), Fault::CutBodies(2)].into_iter().enumerate() {
        let (url, job) = (format!("{url}?{number}"), folder.path().join(format!("{number}")));
        server.set_fault(fault);
        plan(&spec(&url), &job, Some(2), &access(), &()).unwrap();
        server.set_fault(fault);
        let made = make(&job, folder.path()).unwrap();
        server.set_fault(Fault::None);
        assert!(made == whole(&url, folder.path()));
    }
    let fails = |server: &Server, name: &str, fault| {
        let job = folder.path().join(name);
        plan(&spec(&url), &job, Some(1), &access(), &()).unwrap();
        server.set_fault(fault);
        let error = Job::open_with(&job, &access()).unwrap().build(0, 64 << 20, &()).unwrap_err();
        server.set_fault(Fault::None);
        assert!(error.to_string().contains("told/classes.tif"), "{error}");
        assert_eq!(Job::open_with(&job, &access()).unwrap().missing().unwrap(), [0]);
        error
    };
    assert!(matches!(fails(&server, "forbidden", Fault::Forbidden), Error::Io { .. }));
    assert!(matches!(fails(&server, "changed", Fault::Changes(0)), Error::PlanMismatch { .. }));
    // Unreadable sidecars count as missing.
    assert!(!is_there(&format!("{}/told/none.prj", server.address)));
    let gone = plan(
        &spec(&format!("{}/told/none.tif", server.address)),
        &folder.path().join("none"),
        None,
        &access(),
        &(),
    );
    assert!(gone.unwrap_err().to_string().contains("none.tif"));
}
