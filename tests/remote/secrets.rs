//! Signatures and passwords in URLs are sent to their host only, and neither shown nor stored.

use std::path::Path;

use spinney::remote::{RemoteOptions, client};
use spinney::{FileAccess, Result};

use super::server::{Fault, Server};
use super::{new_access, opened, program, put, server};

const SIGNED: &str = "?X-Amz-Signature=SECRETSIG&token=SECRETTOKEN";

fn raster() -> Vec<u8> {
    std::fs::read(format!("{}/fixtures/island_elevation.tif", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// Returns whether a file, or one in a directory, has a secret in its contents or name.
fn leaks(path: &Path) -> bool {
    let is_named = path.to_string_lossy().contains("SECRET");
    let below = std::fs::read_dir(path).into_iter().flatten().any(|entry| leaks(&entry.unwrap().path()));
    let bytes = std::fs::read(path).unwrap_or_default();
    is_named || below || bytes.windows(6).any(|window| window == b"SECRET")
}

#[test]
fn no_command_shows_or_stores_the_secrets_of_a_url() {
    let server = server();
    let directory = tempfile::tempdir().unwrap();
    let tree = put(&server, "secret", "elevation.goblin") + SIGNED;
    let layers = put(&server, "secret", "stack.goblin") + SIGNED;
    let tif = server.put("secret/island.tif", raster()) + SIGNED;
    let none = format!("{}/secret/none.goblin{SIGNED}", server.address);
    let (good, bad) = (Some(0), Some(1));
    for (arguments, code) in [
        (vec!["build", &tif, "-o", "OUT/built.goblin"], good),
        (vec!["info", "OUT/built.goblin"], good),
        (vec!["info", &tree], good),
        (vec!["info", "--json", &tree], good),
        (vec!["info", &layers], good),
        (vec!["info", "--json", &layers], good),
        (vec!["-v", "stats", &tree], good),
        (vec!["stats", "--json", &tree], good),
        (vec!["verify", &tree], good),
        (vec!["find", &tree, "--above", "100"], good),
        (vec!["get", &tree, "-o", "OUT/a.tif"], good),
        (vec!["get", &tree, "-o", "OUT/a.png", "--size", "50"], good),
        (vec!["transform", &tree, "rotate=30", "-o", "OUT/turned.goblin"], good),
        (vec!["convert", &tree, "-o", "OUT/copy.goblin"], good),
        (vec!["combine", "over", &tree, &tree, "-o", "OUT/both.goblin"], good),
        (vec!["combine", "over", &tree, &tree, "-o", "OUT/both.autumn"], good),
        (vec!["edit", "OUT/both.autumn", "paste", &tree], good),
        (vec!["edit", "OUT/both.autumn", "add-layer", &tree], good),
        (vec!["log", "OUT/both.autumn"], good),
        (vec!["export", &tree, "-o", "OUT/cog.tif"], good),
        (vec!["export", &tree, "-o", "OUT/map.pmtiles"], good),
        (vec!["export", &tree, "-o", "OUT/tiles/{z}/{x}/{y}.png"], good),
        (vec!["export", &tree, "-o", "OUT/page/index.html"], bad),
        (vec!["manifest", &tree, "-o", "OUT/all.manifest.json"], good),
        (vec!["info", "OUT/all.manifest.json"], bad),
        (vec!["shard", "plan", &tif, "-o", "OUT/job", "--shards", "2"], good),
        (vec!["info", &none], bad),
        (vec!["build", &none, "-o", "OUT/none.goblin"], bad),
        (vec!["transform", &tree, "nonsense=1", "-o", "OUT/none.goblin"], Some(2)),
        (vec!["info", &tree, &tree], Some(2)),
    ] {
        let base = directory.path().display().to_string();
        let arguments: Vec<String> = arguments.iter().map(|word| word.replace("OUT", &base)).collect();
        let Some(output) = program(&arguments.iter().map(String::as_str).collect::<Vec<_>>()) else { return };
        let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
        assert_eq!(output.status.code(), code, "{arguments:?}: {text}");
        assert!(!text.contains("SECRET"), "{arguments:?}: {text}");
        assert!(!leaks(directory.path()), "{arguments:?}");
    }
    let name = |name: &str| directory.path().join(name).display().to_string();
    program(&["--cache", &name("cache"), "stats", &tree]).unwrap();
    assert!(!leaks(directory.path()));
    // With the URLs, files that name them without their queries can be read.
    let (urls, job, merged) = (name("urls"), name("job"), name("merged.goblin"));
    std::fs::write(&urls, format!("{tree}\n\n{tif}\n")).unwrap();
    for arguments in [
        &["--signed-urls", &urls, "stats", &name("all.manifest.json")][..],
        &["--signed-urls", &urls, "shard", "build", &job, "0"],
        &["--signed-urls", &urls, "shard", "build", &job, "1"],
        &["shard", "merge", &job, "-o", &merged],
    ] {
        let output = program(arguments).unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    assert!(std::fs::read(&merged).unwrap() == std::fs::read(name("built.goblin")).unwrap());
}

#[test]
fn other_hosts_get_neither_referer_nor_password() {
    let (first, second) = (server(), Server::start());
    let bytes = std::fs::read(super::fixture("classes.goblin")).unwrap();
    let plain = first.put("leaves/classes.goblin", bytes.clone());
    second.put("leaves/classes.goblin", bytes);
    let port = second.address.rsplit_once(':').unwrap().1.parse().unwrap();
    first.take_heads();
    let url = format!("{}{SIGNED}", plain.replace("http://", "http://us%40er:SECRETPW@"));
    for fault in [Fault::None, Fault::Leaves(port)] {
        first.set_fault(fault);
        let tree = spinney::raw::dataset::open(Path::new(&url), &new_access().into()).unwrap();
        super::cells(&tree).unwrap();
    }
    // Base64 of `us@er:SECRETPW`, and no user in the request line.
    let heads = first.take_heads();
    assert!(!heads.is_empty());
    for head in heads {
        assert!(head.contains("authorization: basic dxnaz"), "{head}");
        assert!(head.contains("SECRETSIG") && !head.contains("us%40er"), "{head}");
    }
    let heads = second.take_heads();
    assert!(!heads.is_empty());
    for head in heads {
        let lower = head.to_ascii_lowercase();
        assert!(
            !["authorization", "referer", "cookie", "secret"].iter().any(|word| lower.contains(word)),
            "{head}"
        );
    }
}

#[test]
fn urls_without_their_secrets_are_completed_or_refused() {
    let server = server();
    let url = put(&server, "complete", "classes.goblin");
    let opened_with = |access: FileAccess| -> Result<()> {
        let stored = format!("{url}?...");
        spinney::raw::dataset::open(Path::new(&stored), &access.into()).map(|_| ())
    };
    let error = opened_with(new_access()).unwrap_err().to_string();
    assert!(error.contains("--signed-urls") && error.contains("classes.goblin"), "{error}");
    let mut options = RemoteOptions::default();
    options.signed_urls = vec![format!("{url}?sig=1")];
    server.take_heads();
    opened_with(FileAccess::new().remote(client(options).unwrap())).unwrap();
    assert!(server.take_heads().iter().all(|head| head.contains("?sig=1 ")));
    // URLs that differ only in their query are different files.
    assert!(opened(&format!("{url}?v=1")).is_ok() && opened(&url).is_ok());
}
