//! Sources that readers of an index would refuse are refused when the index is made.

use std::path::PathBuf;

use spinney::Error;
use spinney::import::raster::{ImportOptions, plan};

use crate::common::command::{is_alone, own_peak_memory};
use crate::common::tiff_file::{Ifd, Values, file};
use crate::common::with;
use crate::compare::{Directory, assert_equal, assert_resolves, build, index, indexed, tree};
use crate::tiffs::Packing;

/// Bytes after the chunks of a file: more than compression may add to a small chunk.
const REST: usize = 300_000;

/// A directory with a file `a.tif` of some bytes, and the file.
fn written(bytes: &[u8]) -> (Directory, [PathBuf; 1]) {
    let directory = Directory::new();
    let source = directory.path("a.tif");
    std::fs::write(&source, bytes).unwrap();
    (directory, [source])
}

/// Options of an index with the program's memory.
fn options() -> ImportOptions {
    with(indexed(2), |it| it.memory = None)
}

/// Returns the error for an index of a file, of which nothing is written.
fn refusal(bytes: &[u8]) -> Error {
    let (directory, source) = written(bytes);
    let made = directory.path("x.goblin");
    let error = build(&source, &made, &options()).unwrap_err();
    assert!(error.to_string().contains("a.tif") && !made.exists(), "{error}");
    error
}

/// Checks that the index of a file equals its tree.
fn assert_indexable(bytes: &[u8], what: &str) {
    let (directory, source) = written(bytes);
    let [made, whole] = ["x.goblin", "whole.goblin"].map(|name| directory.path(name));
    index(&source, &made);
    tree(&source, &whole);
    assert_equal(&made, &whole, what);
    assert_resolves(&made, &whole, what);
}

/// Returns the bytes of a file without the byte counts of its strips.
fn without_counts(image: Ifd) -> Vec<u8> {
    let mut bytes = file(&[image]);
    let entry = [23, 1, 4, 0];
    let at = bytes.windows(4).rposition(|window| window == entry).unwrap();
    // (Tag 280, which is not read, in place of 279.)
    bytes[at] = 24;
    bytes
}

#[test]
fn large_strips() {
    let strip = |width: u16, height| {
        let zeros = vec![0; usize::from(width) * usize::from(height)];
        file(&[Ifd::grey(width, height, Packing::Deflate.pack(&zeros)).short(259, &[8])])
    };
    let error = refusal(&strip(6000, 6000)).to_string();
    assert!(error.contains("6000 x 6000") && error.contains("`spinney build`"), "{error}");
    let planned = |bytes: &[u8]| {
        let (_directory, source) = written(bytes);
        plan(&source, &options()).map(drop)
    };
    planned(&strip(8192, 4096)).unwrap();
    assert!(matches!(planned(&strip(8192, 4097)), Err(Error::Unsupported { .. })));
}

#[test]
fn shares_of_colours_in_luma() {
    let image = |green: f64| {
        let samples = (0..48).map(|at| at * 5).collect();
        let shares = Values::Double(vec![0.3, green, 0.1]);
        file(&[Ifd::grey(4, 4, samples)
            .short(258, &[8; 3])
            .short(262, &[6])
            .short(277, &[3])
            .short(530, &[1, 1])
            .tag(529, shares)])
    };
    for green in [0.6, 0.0, 1e-60] {
        assert_indexable(&image(green), "shares");
    }
    for green in [f64::NAN, f64::INFINITY, 1e60] {
        let error = refusal(&image(green));
        assert!(matches!(error, Error::Unsupported { .. }) && error.to_string().contains("luma"), "{error}");
    }
}

#[test]
fn strips_of_unknown_length() {
    let noise: Vec<u8> = (0..40 * 30u32).map(|at| (at.wrapping_mul(2_654_435_761) >> 20) as u8).collect();
    for (packing, number) in
        [(Packing::None, 1), (Packing::Lzw, 5), (Packing::Deflate, 8), (Packing::PackBits, 32773)]
    {
        let image = Ifd::grey(40, 30, packing.pack(&noise)).short(259, &[number]);
        let what = format!("{packing:?}");
        let alone = without_counts(image.clone());
        assert_indexable(&alone, &what);
        assert_indexable(&[alone, vec![7; REST]].concat(), &what);
    }
}

#[test]
fn long_strips() {
    let packed = Packing::Deflate.pack(&[5; 1200]);
    let image = |more: usize| {
        let strip = [&packed[..], &vec![0; more]].concat();
        file(&[Ifd::grey(40, 30, strip).short(259, &[8])])
    };
    // The decoded strip takes 1200 bytes.
    let limit = 2 * 1200 + 65536 - packed.len();
    assert_indexable(&image(limit), "as long as possible");
    let error = refusal(&image(limit + 1));
    assert!(matches!(error, Error::Unsupported { .. }), "{error:?}");
    assert!(error.to_string().contains("strip at column 0, row 0 of 67937 bytes"), "{error}");
    let (directory, source) = written(&image(REST));
    tree(&source, &directory.path("whole.goblin"));
}

#[test]
fn strips_of_any_number_of_chunks() {
    if !is_alone("limits::strips_of_any_number_of_chunks") {
        return;
    }
    let sized = |image: Ifd, [width, height]: [u32; 2]| {
        image.tag(256, Values::Long(vec![width])).tag(257, Values::Long(vec![height]))
    };
    let largest = 1 << 29;
    let one = Ifd::grey(1, 1, vec![0]);
    // More cells than a tree may have.
    let error = refusal(&without_counts(sized(one.clone(), [100_000_000, i32::MAX as u32])));
    assert!(matches!(error, Error::Invalid { .. }), "{error:?}");
    // Rows after the end of the file.
    let error = refusal(&without_counts(sized(one.clone(), [100_000, 2_000_000])));
    assert!(matches!(error, Error::Corrupt { .. }), "{error:?}");
    // A strip that was never written.
    let error = refusal(&file(&[sized(one, [largest; 2]).chunks(&[vec![]])]));
    assert!(matches!(error, Error::TooLarge { .. }), "{error:?}");
    // Strips of the same bytes, each of as many chunks as it has rows: their number is a prime.
    let rows = 1_048_583;
    let strips = largest.div_ceil(rows) as usize;
    let image = Ifd::grey(1, 1, vec![0]).tag(278, Values::Long(vec![rows]));
    let bytes = file(&[sized(image, [1, largest]).chunks(&vec![vec![0; 1]; strips])]);
    let error = refusal(&[bytes, vec![0; rows as usize]].concat());
    assert!(matches!(error, Error::TooLarge { .. }), "{error:?}");
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}
