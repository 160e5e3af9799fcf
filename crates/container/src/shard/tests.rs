//! Truncated, corrupt and forged summaries are rejected with typed errors.

use std::fs;
use std::path::Path;

use super::summary::{BLOCKS, Entry, Identity, MAX_BLOCK, SECTION, SHARD, StoredRange};
use super::{Shard, ShardRange, ShardSummary, SummaryWriter};
use crate::{BlockWriter, Content, FileHeader, Metadata, TreeFormat};
use spinney_base::io::{FileAccess, Output, Sorter};
use spinney_base::space::{CodeRange, Dimension};
use spinney_base::{Error, Result};

fn shard(directory: &Path) -> Shard {
    let [first, last] = CodeRange::ALL.ends();
    let range = |layer| ShardRange { layer, run: CodeRange::new(first, last).unwrap() };
    Shard {
        directory: directory.into(),
        job: 7,
        number: 3,
        ranges: vec![range(0), range(2), range(5)],
        access: FileAccess::default(),
    }
}

/// Bytes of the three layers: two blocks and a rest, none, and exactly one block.
fn contents() -> [Vec<u8>; 3] {
    [2 * MAX_BLOCK + 77, 0, MAX_BLOCK].map(|length| (0..length).map(|at| ((at * at) >> 3) as u8).collect())
}

fn write(shard: &Shard) {
    let mut writer = SummaryWriter::new(shard).unwrap();
    for (range, bytes) in shard.ranges.iter().zip(contents()) {
        writer.begin(*range);
        bytes.chunks(1000).for_each(|bytes| writer.write(bytes).unwrap());
        writer.end(0, u64::from(range.layer)).unwrap();
    }
    writer.finish().unwrap();
}

/// The bytes of all layers; empty if there is no summary.
fn read(shard: &Shard) -> Result<Vec<Vec<u8>>> {
    let Some(summary) = ShardSummary::<u64>::find(shard)? else { return Ok(Vec::new()) };
    let mut all = Vec::new();
    for (range, expected) in summary.ranges.iter().zip(contents()) {
        assert_eq!(range.totals, u64::from(range.range.layer));
        let mut bytes = summary.bytes_of(range)?;
        let half = bytes.take(expected.len() as u64 / 2)?;
        all.push([half, bytes.take((expected.len() - expected.len() / 2) as u64)?].concat());
        assert!(bytes.is_over() && matches!(bytes.take(1), Err(Error::Corrupt { .. })));
    }
    Ok(all)
}

#[test]
fn bytes_are_those_that_were_written() {
    let directory = tempfile::tempdir().unwrap();
    let shard = shard(directory.path());
    assert!(read(&shard).unwrap().is_empty());
    write(&shard);
    assert!(read(&shard).unwrap() == contents());
    let summary = ShardSummary::<u64>::find(&shard).unwrap().unwrap();
    let mut bytes = summary.bytes_of(&summary.ranges[0]).unwrap();
    assert!(matches!(bytes.take(u64::MAX), Err(Error::Corrupt { .. })));
    let mut other = shard.clone();
    other.ranges.pop();
    for other in [other, Shard { job: 8, ..shard.clone() }] {
        assert!(matches!(ShardSummary::<u64>::find(&other), Err(Error::Unsupported { .. })));
    }
}

#[test]
fn truncated_and_corrupt_summaries_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let shard = shard(directory.path());
    write(&shard);
    let path = shard.summary_path();
    let good = fs::read(&path).unwrap();
    for at in (0..good.len()).filter(|at| at % 4999 == 0 || at + 700 > good.len() || *at < 30) {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        fs::write(&path, &bad).unwrap();
        let error = read(&shard).expect_err("a bit was flipped");
        assert!(matches!(error, Error::Corrupt { .. } | Error::Unsupported { .. }), "{at}: {error}");
    }
    for length in (0..good.len()).filter(|length| length % 4999 == 0 || length + 300 > good.len()) {
        fs::write(&path, &good[..length]).unwrap();
        assert!(matches!(read(&shard), Err(Error::Corrupt { .. })), "{length}");
    }
}

/// Writes a file of one block of ten bytes, with a changed entry and section, and valid checksums.
fn forge(shard: &Shard, change: &dyn Fn(&mut Entry), section: &[u8]) {
    let (format, content, dimension) = (TreeFormat::Goblin, Content::Shard, Dimension::Quad);
    let header = FileHeader { format, content, dimension, depth: 0, layers: 0 };
    let output = Output::create(&shard.summary_path()).unwrap();
    let mut writer = BlockWriter::new(output, header, "shards").unwrap();
    let mut entry = Entry { block: writer.block(0, &[9; 10], 10).unwrap(), bounds: [[]; 2] };
    change(&mut entry);
    let mut list = Sorter::new(&shard.directory, 0);
    list.push(0, &entry.to_bytes()).unwrap();
    writer.finish(vec![(BLOCKS, list)], (SHARD, section.to_vec()), &Metadata::default()).unwrap();
}

#[test]
fn forged_summaries_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let mut shard = shard(directory.path());
    shard.ranges.truncate(1);
    let identity = |layer, run: [u64; 2]| {
        let ranges = vec![StoredRange { layer, run, run_bytes: 0, totals: 0u64 }];
        SECTION.encode(&Identity { job: 7, number: 3, ranges }).unwrap()
    };
    let section = identity(0, CodeRange::ALL.ends());
    let taken = |length| {
        let summary = ShardSummary::<u64>::find(&shard)?.expect("the file exists");
        summary.bytes_of(&summary.ranges[0])?.take(length)
    };
    forge(&shard, &|_| {}, &section);
    assert_eq!(taken(10).unwrap(), [9; 10]);
    let changes: [&dyn Fn(&mut Entry); 7] = [
        &|entry| entry.block.offset = u64::MAX,
        &|entry| entry.block.offset += 1,
        &|entry| entry.block.length = u32::MAX,
        &|entry| entry.block.length -= 1,
        &|entry| entry.block.count = u32::MAX,
        &|entry| entry.block.count = 0,
        &|entry| entry.block.key = 1,
    ];
    for (number, change) in changes.iter().enumerate() {
        forge(&shard, change, &section);
        assert!(matches!(taken(10), Err(Error::Corrupt { .. })), "{number}");
    }
    // Sections with an invalid run, another layer, trailing bytes, and a huge count of layers.
    let count = section.iter().position(|byte| *byte == 3).unwrap() + 1;
    let mut many = section.clone();
    many.splice(count..count + 1, [253, 255, 255, 255, 255, 255, 255, 255, 255]);
    for wrong in
        [identity(0, [5, 2]), identity(1, CodeRange::ALL.ends()), [&section[..], &[0]].concat(), many]
    {
        forge(&shard, &|_| {}, &wrong);
        let error = taken(10).unwrap_err();
        assert!(matches!(error, Error::Corrupt { .. } | Error::Unsupported { .. }), "{error}");
    }
}
