//! Files on web servers and in buckets: server faults and their effects.

mod jobs;
mod outages;
mod secrets;
mod server;

use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use server::{Fault, Server};
use spinney::raw::dataset::open;
use spinney::remote::{RemoteOptions, client};
use spinney::{Bounds, Dataset, Error, FileAccess, Output, Result, WriteOptions};

/// The server, for one test at a time, with files of all kinds.
fn server() -> MutexGuard<'static, Server> {
    static SERVER: LazyLock<Mutex<Server>> = LazyLock::new(|| Mutex::new(Server::start()));
    let server = SERVER.lock().unwrap_or_else(PoisonError::into_inner);
    server.set_fault(Fault::None);
    server.take_counts();
    server
}

/// The access of all tests that do not create their own.
fn access() -> FileAccess {
    static ACCESS: LazyLock<FileAccess> = LazyLock::new(new_access);
    ACCESS.clone()
}

/// Returns an access with its own client and caches.
fn new_access() -> FileAccess {
    let mut options = RemoteOptions::default();
    options.timeout = Duration::from_secs(5);
    options.retries = 3;
    options.cache_directory_bytes = 1 << 30;
    FileAccess::new().remote(client(options).unwrap())
}

/// Puts a frozen file on the server under a name of this test: recently opened files count as open.
fn put(server: &Server, test: &str, name: &str) -> String {
    server.put(&format!("{test}/{name}"), std::fs::read(fixture(name)).unwrap())
}

fn fixture(name: &str) -> String {
    format!("{}/fixtures/v1/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn opened(url: &str) -> Result<Dataset> {
    open(Path::new(url), &access().into())
}

/// Returns all cells of a raster.
fn cells(tree: &Dataset) -> Result<Vec<u8>> {
    let bounds = tree.header().extent_bounds();
    let mut values = vec![0; bounds.volume() as usize * tree.header().form.width()];
    tree.window(tree.depth(), &bounds, 0.0, &mut values, None)?;
    Ok(values)
}

#[test]
fn files_of_all_kinds_are_read() {
    let server = server();
    for name in ["classes.goblin", "elevation.goblin", "segments.goblin", "ball.goblin", "history.autumn"] {
        let (far, near) = (opened(&put(&server, "kinds", name)).unwrap(), opened(&fixture(name)).unwrap());
        assert!(cells(&far).unwrap() == cells(&near).unwrap(), "{name}");
        assert_eq!(far.statistics(None, &()).unwrap(), near.statistics(None, &()).unwrap());
        assert_eq!(far.metadata(), near.metadata());
        far.check_unchanged().unwrap();
    }
    for (suffix, name) in [(":1", "stack.goblin"), ("@1", "history.autumn"), ("@1:0", "stack.autumn")] {
        let far = format!("{}{suffix}", put(&server, "references", name));
        let near = format!("{}{suffix}", fixture(name));
        let signed = format!("{far}?signature=a:b/c@2");
        for url in [far, signed] {
            assert!(
                cells(&opened(&url).unwrap()).unwrap() == cells(&opened(&near).unwrap()).unwrap(),
                "{url}"
            );
        }
    }
    let path = put(&server, "models", "chapel.goblin");
    let far = spinney::ExactModel::open(Path::new(&path), &access().into()).unwrap();
    let near = spinney::ExactModel::open(Path::new(&fixture("chapel.goblin")), &Default::default()).unwrap();
    let point = [1.0, 1.0, 1.0];
    assert_eq!(far.locate(point).unwrap(), near.locate(point).unwrap());
    assert_eq!(far.nearest(point).unwrap(), near.nearest(point).unwrap());
    // A file URL on this machine.
    let url = format!("file://{}", fixture("classes.goblin"));
    assert!(
        cells(&opened(&url).unwrap()).unwrap()
            == cells(&opened(&fixture("classes.goblin")).unwrap()).unwrap()
    );
}

#[test]
fn requests_to_busy_or_failing_servers_are_retried() {
    let server = server();
    let expected = cells(&opened(&fixture("segments.goblin")).unwrap()).unwrap();
    for (number, fault) in
        [Fault::Busy(2), Fault::CutBodies(2), Fault::Redirects, Fault::Slow(Duration::from_millis(30))]
            .into_iter()
            .enumerate()
    {
        let url = put(&server, &format!("again{number}"), "segments.goblin");
        server.set_fault(fault);
        assert!(cells(&opened(&url).unwrap()).unwrap() == expected, "{fault:?}");
    }
}

#[test]
fn servers_that_cannot_be_used_are_reported() {
    let server = server();
    let refused = |fault: Fault| {
        let url = put(&server, &format!("{fault:?}"), "segments.goblin");
        server.set_fault(fault);
        opened(&url).and_then(|tree| cells(&tree)).unwrap_err()
    };
    for (fault, says) in [
        (Fault::NoRanges, "whole files only"),
        (Fault::Compresses, "compresses its responses (gzip)"),
        (Fault::Busy(usize::MAX), "500"),
        (Fault::Forbidden, "403"),
        (Fault::WrongLength, ""),
        (Fault::CutBodies(usize::MAX), ""),
    ] {
        let started = Instant::now();
        let error = refused(fault);
        let mut text = error.to_string();
        let mut cause = std::error::Error::source(&error);
        while let Some(next) = cause {
            text = format!("{text}: {next}");
            cause = next.source();
        }
        assert!(text.contains(says) && text.contains(&server.address), "{fault:?}: {text}");
        assert!(started.elapsed() < Duration::from_secs(60));
    }
    server.set_fault(Fault::None);
    let missing = opened(&format!("{}/nothing.goblin", server.address)).unwrap_err();
    assert!(
        matches!(&missing, Error::Io { cause, .. } if cause.kind() == std::io::ErrorKind::NotFound),
        "{missing}"
    );
    let text =
        server.put("text.goblin", b"no tree, but a page of the server, long enough to be inspected".to_vec());
    assert!(opened(&text).is_err());
    let empty = server.put("empty.goblin", Vec::new());
    assert!(opened(&empty).is_err());
    assert!(opened("http://127.0.0.1:1/x.goblin").is_err());
    // Remote Autumnal files cannot be edited, and the error says so.
    let history = put(&server, "edited", "history.autumn");
    let edited = spinney::edit::Editor::open(Path::new(&history), 1 << 20).err().unwrap();
    assert!(matches!(&edited, Error::Unsupported { .. }), "{edited}");
}

/// Bytes of two versions are never mixed in one result.
#[test]
fn a_file_that_changes_is_an_error() {
    let server = server();
    let bytes = std::fs::read(fixture("stack.goblin")).unwrap();
    assert!(bytes.len() > 100_000, "more than its ends");
    for after in 2..6 {
        let url = server.put(&format!("changes{after}.goblin"), bytes.clone());
        server.set_fault(Fault::Changes(after));
        let mut has_failed = false;
        // Layers are read one by one, so that some are read before the change.
        for layer in 0..3 {
            let tree = opened(&url).and_then(|tree| tree.layer(&layer.to_string()));
            match tree.and_then(|tree| cells(&tree)) {
                Ok(found) => {
                    let near = opened(&format!("{}:{layer}", fixture("stack.goblin"))).unwrap();
                    assert!(found == cells(&near).unwrap(), "after {after} requests");
                }
                Err(Error::Changed { .. }) => has_failed = true,
                Err(error) => panic!("{error}"),
            }
        }
        assert!(has_failed || server.take_counts().0 <= after, "after {after} requests");
    }
}

#[test]
fn remote_bytes_are_cached() {
    let server = server();
    let url = put(&server, "held", "stack.goblin");
    let first = cells(&opened(&url).unwrap()).unwrap();
    assert!(server.take_counts().0 > 0);
    // The same file with another handle: its version is checked, its bytes are cached.
    std::thread::sleep(Duration::from_millis(1100));
    assert!(cells(&opened(&url).unwrap()).unwrap() == first);
    let (requests, _) = server.take_counts();
    assert_eq!(requests, 2);
}

#[test]
fn outputs_are_uploaded_whole_or_not_at_all() {
    let _server = server();
    let url = "memory:///directory/copy.goblin";
    let output = access().create(Path::new(url)).unwrap();
    spinney::convert(Path::new(&fixture("segments.goblin")), false, output, WriteOptions::new(64 << 20), &())
        .unwrap();
    let copy = opened(url).unwrap();
    assert!(cells(&copy).unwrap() == cells(&opened(&fixture("segments.goblin")).unwrap()).unwrap());
    // A dropped output never existed.
    let url = "memory:///directory/dropped.goblin";
    let mut output = access().create(Path::new(url)).unwrap();
    std::io::Write::write_all(&mut output, b"half").unwrap();
    drop(output);
    assert!(opened(url).is_err());
    // A history is created once.
    let url = "memory:///directory/map.autumn";
    let made = |url: &str| {
        let mut output = access().create(Path::new(url)).unwrap();
        output.keep_existing();
        spinney::convert(
            Path::new(&fixture("classes.goblin")),
            false,
            output,
            WriteOptions::new(64 << 20),
            &(),
        )
    };
    made(url).unwrap();
    assert!(matches!(made(url), Err(Error::Unsupported { .. })));
    assert!(Output::resumable(Path::new(url)).is_err());
}

/// Runs the program, if it was built with remote files.
fn program(arguments: &[&str]) -> Option<std::process::Output> {
    let output = Command::cargo_bin("spinney").unwrap().args(arguments).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    if text.contains("support for remote files") {
        eprintln!("skipped: the program was built without `remote`");
        return None;
    }
    Some(output)
}

#[test]
fn the_program_reads_urls_wherever_it_reads_a_file() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let url = put(&server, "program", "elevation.goblin");
    let near = fixture("elevation.goblin");
    for arguments in [
        vec!["stats", "FILE"],
        vec!["point", "FILE", "20,30", "100,50"],
        vec!["find", "FILE", "--above", "100"],
        vec!["get", "FILE", "OUT.png", "--size", "100"],
        vec!["get", "FILE", "OUT.npy", "--window", "30,40,50,60"],
        vec!["contours", "FILE", "--every", "50", "-o", "OUT.geojson"],
        vec!["transform", "FILE", "rotate=90", "-o", "OUT.goblin"],
        vec!["export", "FILE", "-o", "OUT.tif"],
        vec!["verify", "FILE"],
    ] {
        let run = |file: &str, name: &str| {
            let name = directory.path().join(name).display().to_string();
            let arguments: Vec<String> =
                arguments.iter().map(|word| word.replace("FILE", file).replace("OUT", &name)).collect();
            let output = program(&arguments.iter().map(String::as_str).collect::<Vec<_>>())?;
            assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
            Some(String::from_utf8(output.stdout).unwrap().replace(file, "FILE").replace(&name, "OUT"))
        };
        let Some(far) = run(&url, "far") else { return };
        assert_eq!(Some(far), run(&near, "near"), "{arguments:?}");
        for ending in ["png", "npy", "geojson", "goblin", "tif"] {
            let [far, near] =
                ["far", "near"].map(|name| std::fs::read(directory.path().join(format!("{name}.{ending}"))));
            if let (Ok(far), Ok(near)) = (far, near) {
                // Trees store the name of their source.
                let is_same = far == near || ending == "goblin" && far.len().abs_diff(near.len()) < 100;
                assert!(is_same, "{arguments:?}");
            }
        }
    }
    let report = program(&["-v", "stats", &url]).unwrap();
    let text = String::from_utf8(report.stderr).unwrap();
    assert!(text.contains("1 batches, 2 requests"), "{text}");
    let kept = directory.path().join("kept").display().to_string();
    for requests in [2, 2] {
        server.take_counts();
        program(&["--cache", &kept, "stats", &url, "--window", "10,10,100,100"]).unwrap();
        assert!(server.take_counts().0 >= requests);
    }
    assert_eq!(cells_of_box(&url), cells_of_box(&near));
}

/// Returns the requests and bytes that a run of the program reports.
fn requests_of(arguments: &[&str]) -> Option<[u64; 2]> {
    let output = program(&[&["-v"], arguments].concat())?;
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{arguments:?}: {text}");
    let (before, after) = text.split_once(" requests, ").unwrap_or_else(|| panic!("{text}"));
    let requests = before.rsplit(' ').next().and_then(|number| number.parse().ok());
    let bytes = after.split(' ').next().and_then(|number| number.parse().ok());
    Some([requests.unwrap(), bytes.unwrap()])
}

/// Writes a raster of 1024 x 1024 random cells below `count`, and builds a tree of it. Returns the
/// tree's path, or `None` without the program.
fn noise_tree(directory: &Path, count: u64, options: &[&str]) -> Option<PathBuf> {
    let [raster, tree] = ["noise.pgm", "noise.goblin"].map(|name| directory.join(name));
    let mut state = 1u64;
    let mut noise = b"P5 1024 1024 255\n".to_vec();
    noise.extend((0..1 << 20).map(|_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40 & 255) % count) as u8
    }));
    std::fs::write(&raster, noise).unwrap();
    let words = ["build", "-q", raster.to_str().unwrap(), "-o", tree.to_str().unwrap()];
    let built = program(&[&words, options].concat())?;
    assert!(built.status.success());
    Some(tree)
}

/// The number for VOID cells follows from the bounds of the values, without a search for classes.
#[test]
fn windows_of_class_maps_read_few_segments() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let Some(tree) = noise_tree(directory.path(), 4, &["--kind", "categorical"]) else { return };
    let bytes = std::fs::read(&tree).unwrap();
    let size = bytes.len() as u64;
    let url = server.put("classes/noise.goblin", bytes);
    let out = directory.path().join("window.npy");
    let window = ["get", &url, out.to_str().unwrap(), "--window", "10,10,64,64"];
    let [requests, read] = requests_of(&window).unwrap();
    assert!(requests <= 5 && read < size / 4, "{requests} requests, {read} of {size} bytes");
}

#[test]
fn options_of_remote_files_have_effects() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let Some(tree) = noise_tree(directory.path(), 256, &[]) else { return };
    let url = server.put("options/noise.goblin", std::fs::read(&tree).unwrap());
    let far_apart = ["point", "--in", "cells", &url, "1,1", "900,100"];
    let [few, more] =
        ["1M", "1"].map(|gap| requests_of(&[&far_apart[..], &["--request-gap", gap]].concat()).unwrap());
    assert!(few[0] < more[0] && few[1] > more[1], "{few:?} {more:?}");
    let kept = directory.path().join("kept");
    let [first, second] = [(); 2]
        .map(|()| requests_of(&[&far_apart[..], &["--cache", kept.to_str().unwrap()]].concat()).unwrap());
    assert!(second[1] < first[1], "{first:?} {second:?}");
}

fn cells_of_box(path: &str) -> Vec<u8> {
    let tree = opened(path).unwrap();
    let bounds = Bounds { min: [5, 5, 0], max: [25, 15, 1] };
    let mut values = vec![0; bounds.volume() as usize * tree.header().form.width()];
    tree.window(tree.depth(), &bounds, 0.0, &mut values, None).unwrap();
    values
}
