//! Hosts that fail or hang during detection of a file's type: an error, and not another file type.

use std::time::Duration;

use super::server::Fault;
use super::{program, put, server};

#[test]
fn outages_are_errors_of_the_first_request() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let [out, job] = ["out.goblin", "job"].map(|name| directory.path().join(name).display().to_string());
    let faults = [Fault::Busy(usize::MAX), Fault::Slow(Duration::from_secs(30))];
    for (number, fault) in faults.into_iter().enumerate() {
        let commands = [
            &["info", "FILE"][..],
            &["stats", "FILE"],
            &["point", "FILE", "1,2"],
            &["verify", "FILE"],
            &["get", "FILE", &out],
            &["build", "FILE", "-o", &out],
            &["transform", "FILE", "crop", "-o", &out],
            &["combine", "over", "FILE", "FILE", "-o", &out],
            &["shard", "plan", "FILE", "-o", &job],
        ];
        for (kind, arguments) in commands.into_iter().enumerate() {
            let url = put(&server, &format!("outage{number}-{kind}"), "classes.goblin");
            server.set_fault(fault);
            let words = ["-q", "--remote-timeout", "2"].iter().chain(arguments);
            let words: Vec<&str> = words.map(|word| if *word == "FILE" { &url } else { *word }).collect();
            let Some(output) = program(&words) else { return };
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(1), "{fault:?}, {arguments:?}: {text}");
            let expected = if number == 0 { ["500", "--remote-timeout"] } else { ["--remote-timeout"; 2] };
            let is_reported = expected.iter().any(|word| text.contains(word));
            assert!(text.contains(&url) && is_reported, "{fault:?}, {arguments:?}: {text}");
            // Two ends of one file, each retried at most five times.
            let (requests, _) = server.take_counts();
            assert!(requests <= 12, "{fault:?}, {arguments:?}: {requests} requests");
            server.set_fault(Fault::None);
        }
    }
}

#[test]
fn remote_and_external_files_are_rejected_on_request() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let url = put(&server, "refused", "classes.goblin");
    let name = |name: &str| directory.path().join(name).display().to_string();
    let run = |arguments: &[&str], refused: Option<&str>| {
        let Some(output) = program(arguments) else { return };
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let expected = if refused.is_some() { 1 } else { 0 };
        assert_eq!(output.status.code(), Some(expected), "{arguments:?}: {text}");
        assert!(text.contains(refused.unwrap_or_default()), "{arguments:?}: {text}");
    };
    let vrt = |file: &str| {
        let source = format!("<SourceFilename>{file}</SourceFilename><SourceBand>1</SourceBand>");
        format!(
            "<VRTDataset rasterXSize=\"256\" rasterYSize=\"200\"><VRTRasterBand dataType=\"Byte\" band=\"1\">\
             <SimpleSource>{source}</SimpleSource></VRTRasterBand></VRTDataset>"
        )
    };
    let source = format!("{}/fixtures/island_classes.tif", env!("CARGO_MANIFEST_DIR"));
    std::fs::write(name("far.vrt"), vrt(&url.replace(".goblin", ".tif"))).unwrap();
    std::fs::write(name("near.vrt"), vrt(&source)).unwrap();
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: x.raw\n\n";
    std::fs::write(name("x.nhdr"), head).unwrap();
    std::fs::write(name("x.raw"), [7; 8]).unwrap();
    let view = r#"{"image":"x.png","kind":"silhouette","from":[0,0],"centre":[0.5,0.5,0.5],"pixel":0.1}"#;
    std::fs::write(name("x.views"), format!(r#"{{"bounds":[0,0,0,1,1,1],"views":[{view}]}}"#)).unwrap();
    let (out, tree, listed) =
        (name("out.goblin"), super::fixture("classes.goblin"), name("all.manifest.json"));
    run(&["-q", "manifest", &tree, "-o", &listed], None);
    server.take_counts();
    run(&["-q", "--no-remote", "info", &url], Some("--no-remote"));
    run(&["-q", "--no-remote", "build", &name("far.vrt"), "-o", &out], Some("--no-remote"));
    assert_eq!(server.take_counts().0, 0);
    for file in ["near.vrt", "x.nhdr", "x.views"] {
        run(&["-q", "--no-external", "build", &name(file), "-o", &out], Some("--no-external"));
    }
    run(&["-q", "--no-external", "stats", &listed], Some("--no-external"));
    // Files with their own data are read, and so are these if they are trusted.
    run(&["-q", "--no-external", "--no-remote", "stats", &tree], None);
    run(&["-q", "stats", &listed], None);
    run(&["-q", "build", &name("x.nhdr"), "-o", &out], None);
    run(&["-q", "build", &name("near.vrt"), "-o", &out], None);
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_in_the_cache_are_not_waited_for() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let cache = directory.path().join("cache");
    let url = put(&server, "pipes", "stack.goblin") + ":0";
    let stats = || {
        let cache = cache.to_str().unwrap();
        program(&["-q", "--cache", cache, "stats", &url, "--window", "10,10,100,100"])
    };
    let Some(first) = stats() else { return };
    assert!(first.status.success(), "{}", String::from_utf8_lossy(&first.stderr));
    let mut ranges = Vec::new();
    for file in std::fs::read_dir(cache.join("spinney-ranges")).unwrap() {
        ranges.extend(std::fs::read_dir(file.unwrap().path()).unwrap().map(|range| range.unwrap().path()));
    }
    assert!(!ranges.is_empty());
    for kind in 0..3 {
        for range in &ranges {
            let _ = std::fs::remove_file(range).or_else(|_| std::fs::remove_dir(range));
            match kind {
                0 => assert!(std::process::Command::new("mkfifo").arg(range).status().unwrap().success()),
                1 => std::os::unix::fs::symlink("/dev/zero", range).unwrap(),
                _ => std::fs::create_dir(range).unwrap(),
            }
        }
        assert_eq!(stats().unwrap().stdout, first.stdout);
    }
}
