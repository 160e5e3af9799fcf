//! Sets every byte of a line file to malicious values with valid checksums: an error or a harmless
//! result is required.

use std::time::{Duration, Instant};

use spinney::lines::{LineBuildOptions, LinesInMemory, build};
use spinney::{Dimension, Metadata, Output};

use super::attack_goblin::{Field, changed};
use crate::common::command::{is_alone, own_peak_memory};
use crate::common::line_features;
use crate::targets::lines::query_lines;
use crate::targets::seal::{self, END};

fn small(dimension: Dimension) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("lines.goblin");
    let (attributes, features) = line_features::some(dimension, 12);
    let options = LineBuildOptions { leaf_size: 4, ..LineBuildOptions::default() };
    let mut source = LinesInMemory::new(dimension, attributes, features);
    build(&mut source, &options, &Metadata::default(), Output::create(&path).unwrap(), &()).unwrap();
    std::fs::read(&path).unwrap()
}

#[test]
fn bytes_that_do_harm() {
    if !is_alone("attack_lines::bytes_that_do_harm") {
        return;
    }
    [Dimension::Quad, Dimension::Oct].map(small).iter().for_each(|file| harm(file));
    assert!(own_peak_memory() < 512 << 20, "{} bytes", own_peak_memory());
}

fn harm(file: &[u8]) {
    let mut resealed = file.to_vec();
    seal::goblin(&mut resealed);
    assert!(resealed == file, "checksums are at the expected offsets");
    let (_, lists, _) = seal::section(file, b"LBLK").unwrap();
    let query = |mut bytes: Vec<u8>, what: String| {
        seal::goblin(&mut bytes);
        let start = Instant::now();
        query_lines(bytes);
        assert!(start.elapsed() < Duration::from_secs(5), "{what}: {:?}", start.elapsed());
    };
    for at in 0..file.len() - END {
        for wrong in [0, 0xff, file[at] ^ 1 << (at % 8)] {
            let mut bytes = file.to_vec();
            bytes[at] = wrong;
            query(bytes, format!("byte {at} is {wrong:#x}"));
        }
    }
    // After the blocks there are multi-byte numbers: lengths, counts, offsets.
    for at in (lists.next_multiple_of(4)..file.len() - END - 3).step_by(4) {
        let field = Field { name: "the file".into(), at, size: 4 };
        changed(file, &field, &mut |bytes, what| query(bytes, what));
    }
}
