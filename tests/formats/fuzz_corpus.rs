//! Replays the fuzzing corpus: seeds and findings.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::command::{is_alone, own_peak_memory};
use crate::targets::TARGETS;

#[test]
fn the_corpus_does_no_harm() {
    if !is_alone("fuzz_corpus::the_corpus_does_no_harm") {
        return;
    }
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let names = |directory: &Path| {
        let entries =
            std::fs::read_dir(directory).unwrap_or_else(|error| panic!("{}: {error}", directory.display()));
        let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        paths
    };
    let directories: Vec<_> =
        names(&corpus).iter().map(|path| path.file_name().unwrap().to_owned()).collect();
    assert_eq!(directories, TARGETS.map(|(name, _)| name), "a directory for each target");
    for (name, target) in TARGETS {
        let paths = names(&corpus.join(name));
        assert!(!paths.is_empty(), "{name}");
        for path in paths {
            let bytes = std::fs::read(&path).unwrap();
            let start = Instant::now();
            println!("{}", path.display());
            target(&bytes);
            // The limit allows for slow or busy machines.
            assert!(start.elapsed() < Duration::from_secs(5), "{}: {:?}", path.display(), start.elapsed());
        }
    }
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}
