//! Threads, memory and ways of reading do not change an index.

use std::fs;

use crate::common::command::spinney;
use crate::compare::{Directory, assert_equal};
use crate::tiffs::{Chunks, Packing, Samples, Tiff};

#[test]
fn threads_and_memory_do_not_change_bytes() {
    let directory = Directory::new();
    let mut names = Vec::new();
    for number in 0..5 {
        let origin = Some([(number % 2 * 390) as i64, (number * 170) as i64]);
        let packing = [Packing::Deflate, Packing::Zstd, Packing::None][number % 3];
        let chunks = if number % 2 == 0 { Chunks::Strips(5) } else { Chunks::Tiles(80, 48) };
        let tiff = Tiff {
            origin,
            packing,
            chunks,
            samples: Samples::Int(16),
            nodata: Some("3"),
            ..Tiff::new([500, 420], 1)
        };
        names.push(directory.name(&format!("{number}.tif")));
        tiff.filled(number as u64).write(&directory.path(&format!("{number}.tif")));
    }
    let sources: Vec<&str> = names.iter().map(String::as_str).collect();
    let whole = directory.name("whole.goblin");
    spinney(&[&["-q", "build"], &sources[..], &["-o", &whole]].concat()).success();
    let mut first: Option<Vec<u8>> = None;
    for options in [
        &["--threads", "1", "--memory", "64M"][..],
        &["--threads", "2", "--memory", "64M"],
        &["--threads", "5", "--memory", "256M"],
        &["--threads", "2", "--memory", "256M", "--positioned"],
    ] {
        let made = directory.name("x.goblin");
        spinney(&[&["-q", "index"], &sources[..], &["-o", &made], options].concat()).success();
        let bytes = fs::read(&made).unwrap();
        assert!(*first.get_or_insert_with(|| bytes.clone()) == bytes, "{options:?}");
        // An update with these options, too.
        fs::write(&names[2], [fs::read(&names[2]).unwrap(), vec![0]].concat()).unwrap();
        spinney(&[&["-q", "index", "--update", &made], options].concat()).success();
        let fresh = directory.name("fresh.goblin");
        spinney(&[&["-q", "index"], &sources[..], &["-o", &fresh]].concat()).success();
        assert!(fs::read(&made).unwrap() == fs::read(&fresh).unwrap(), "update, {options:?}");
        first = Some(fs::read(&fresh).unwrap());
        assert_equal(made.as_ref(), whole.as_ref(), "threads");
    }
    let found = directory.name("found.npy");
    for options in [&["--threads", "1"][..], &["--threads", "5"], &["--positioned"], &["--cache-memory", "1"]]
    {
        spinney(&[&["-q", "get", &directory.name("x.goblin"), &found], options].concat()).success();
        let expected = directory.name("expected.npy");
        spinney(&["-q", "get", &whole, &expected]).success();
        assert!(fs::read(&found).unwrap() == fs::read(&expected).unwrap(), "{options:?}");
    }
}
