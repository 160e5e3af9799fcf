use std::io::Write;
use std::path::Path;

use super::*;
use crate::volume::{VolumeOptions, plan};
use spinney_base::io::Output;
use spinney_base::value::Number;
use spinney_container::{Tag, TagScope};
use spinney_engine::dataset::{self, Dataset};

const SIZE: [usize; 3] = [5, 4, 3];

fn samples(order: &str) -> Vec<u8> {
    let numbers = (0..60u16).map(|number| number * 7);
    numbers
        .flat_map(|number| if order == "big" { number.to_be_bytes() } else { number.to_le_bytes() })
        .collect()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

fn head(lines: &str) -> String {
    format!("NRRD0004\n# A comment.\ntype: unsigned short\ndimension: 3\nsizes: 5 4 3\n{lines}")
}

fn build(directory: &Path, head: &str, data: &[u8]) -> Result<Dataset> {
    let (input, out) = (directory.join("a.nrrd"), directory.join("a.goblin"));
    std::fs::write(&input, [head.as_bytes(), b"\n", data].concat()).unwrap();
    plan(&input, &VolumeOptions::new())?.build(Output::create(&out)?, &())?;
    dataset::open(&out, &Default::default())
}

fn check(tree: &Dataset) {
    assert_eq!(tree.header().extent, SIZE.map(|cells| cells as u64));
    for z in 0..SIZE[2] {
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let mut found = [Number::default(); 4];
                assert!(tree.point([x as u64, y as u64, z as u64], tree.depth(), &mut found).unwrap());
                let index = (z * SIZE[1] + y) * SIZE[0] + x;
                assert_eq!(found[0].to_f64(), index as f64 * 7.0, "{x} {y} {z}");
            }
        }
    }
}

#[test]
fn samples_are_read_from_any_location() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    for order in ["little", "big"] {
        let plain = samples(order);
        let raw = |more: &str| head(&format!("endian: {order}\nencoding: raw\n{more}"));
        let packed = |more: &str| head(&format!("encoding: gzip\nendian: {order}\n{more}"));
        check(&build(directory, &raw(""), &plain).unwrap());
        check(&build(directory, &packed(""), &gzip(&plain)).unwrap());
        // In several gzip members, as written by programs that append to a file.
        check(&build(directory, &packed(""), &[gzip(&plain[..33]), gzip(&plain[33..])].concat()).unwrap());
        // After lines and bytes to be skipped.
        let after_lines = |data: &[u8]| [b"one\ntwo\n".as_slice(), data].concat();
        check(
            &build(
                directory,
                &raw("line skip: 2\nbyte skip: 3\n"),
                &after_lines(&[b"xyz", &plain[..]].concat()),
            )
            .unwrap(),
        );
        check(&build(directory, &raw("byte skip: -1\n"), &after_lines(&plain)).unwrap());
        let skipped = gzip(&[b"xyz", &plain[..]].concat());
        check(&build(directory, &packed("lineskip: 2\nbyteskip: 3\n"), &after_lines(&skipped)).unwrap());
        // In data files.
        std::fs::create_dir_all(directory.join("data")).unwrap();
        std::fs::write(directory.join("data/a b.raw"), &plain).unwrap();
        std::fs::write(directory.join("a.raw.gz"), gzip(&plain)).unwrap();
        check(&build(directory, raw("data file: data/a b.raw").trim_end(), b"").unwrap());
        check(&build(directory, packed("datafile: a.raw.gz").trim_end(), b"").unwrap());
    }
    // With CR LF line ends and extra spaces.
    let lines = head("endian: little\nencoding:   RAW  ").replace('\n', "\r\n");
    let input = [lines.as_bytes(), b"\r\n\r\n", &samples("little")].concat();
    std::fs::write(directory.join("crlf.nrrd"), input).unwrap();
    let out = directory.join("crlf.goblin");
    plan(&directory.join("crlf.nrrd"), &VolumeOptions::new())
        .unwrap()
        .build(Output::create(&out).unwrap(), &())
        .unwrap();
    check(&dataset::open(&out, &Default::default()).unwrap());
}

#[test]
fn positions_units_and_tags_are_kept() {
    let directory = tempfile::tempdir().unwrap();
    let made = |lines: &str| {
        build(directory.path(), &head(&format!("endian: little\nencoding: raw\n{lines}")), &samples("little"))
            .unwrap()
    };
    let tree = made(
        "space: left-posterior-superior\nspace directions: (0.5,0,0) (0,0,-2) (0,1,0.25)\nspace origin: (-10,20,30.5)\n\
         space units: \"mm\" \"mm\" \"mm\"\nkinds: domain domain domain\nsample units: HU\ncontent: a \"test\"\n\
         modality:=CT\\nhead\nurl: x:=http://a\n",
    );
    let metadata = tree.metadata();
    // The centre of the first cell is at the origin.
    assert_eq!(metadata.frame.to_world([0.5; 3]), [-10.0, 20.0, 30.5]);
    assert_eq!(metadata.frame.to_world([1.5, 0.5, 0.5]), [-9.5, 20.0, 30.5]);
    assert_eq!(metadata.frame.to_world([0.5, 1.5, 0.5]), [-10.0, 20.0, 28.5]);
    assert_eq!(metadata.frame.to_world([0.5, 0.5, 1.5]), [-10.0, 21.0, 30.75]);
    assert_eq!(metadata.tag(Tag::Unit), Some("mm"));
    assert_eq!(metadata.units, ["HU"]);
    assert_eq!(metadata.tags["modality"], "CT\nhead");
    let fields = &metadata.scoped_tags[&TagScope { channel: None, domain: "NRRD".into() }];
    assert_eq!(fields["space"], "left-posterior-superior");
    assert_eq!((&*fields["kinds"], &*fields["content"]), ("domain domain domain", "a \"test\""));

    let frame = made("spacings: 0.5 nan 2\nunits: \"um\" \"um\" \"um\"\n").metadata().frame.clone();
    assert_eq!(frame.matrix, [[0.5, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]]);
    let frame =
        made("spacings: 0.5 1 2\naxis mins: 10 20 30\ncenters: node node node\n").metadata().frame.clone();
    assert_eq!((frame.to_world([0.5; 3]), frame.pixel_is_point), ([10.0, 20.0, 30.0], true));
    // From the minimum and the maximum of each axis (5 x 4 x 3 cells): cell edges or node centres.
    let frame = made("axis mins: 10 nan 30\naxis maxs: 20 8 27\n").metadata().frame.clone();
    assert_eq!(frame.matrix, [[2.0, 0.0, 0.0, 10.0], [0.0, 1.0, 0.0, 4.0], [0.0, 0.0, -1.0, 30.0]]);
    let frame =
        made("axismins: 10 0 1\naxismaxs: 18 6 2\ncenterings: node node node\n").metadata().frame.clone();
    assert_eq!(frame.to_world([0.5; 3]), [10.0, 0.0, 1.0]);
    assert_eq!(frame.to_world([4.5, 3.5, 2.5]), [18.0, 6.0, 2.0]);
    let frame = made("spacings: 0.5 1 2\naxis maxs: 12.5 4 6\n").metadata().frame.clone();
    assert_eq!(frame.matrix, [[0.5, 0.0, 0.0, 10.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]]);
    assert!(made("").metadata().frame.is_identity());
}

#[test]
fn channels_are_samples_of_a_cell() {
    let directory = tempfile::tempdir().unwrap();
    let head = "NRRD0005\ntype: uint8_t\ndimension: 4\nsizes: 3 2 2 1\nkinds: RGB-color domain domain domain\nspacings: nan 1 1 3\n\
                space directions: none (1,0,0) (0,1,0) (0,0,3)\nencoding: raw\n";
    let bytes: Vec<u8> = (0..12).collect();
    let tree = build(directory.path(), head, &bytes).unwrap();
    assert_eq!((tree.header().form.value.channels, tree.header().extent), (3, [2, 2, 1]));
    let mut found = [Number::default(); 4];
    assert!(tree.point([1, 1, 0], tree.depth(), &mut found).unwrap());
    assert_eq!(found[..3].iter().map(|number| number.to_f64()).collect::<Vec<_>>(), [9.0, 10.0, 11.0]);
}

#[test]
fn false_headers_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let plain = samples("little");
    let refuse = |head: &str, data: &[u8], expected: &str| {
        let error =
            build(directory, head, data).err().unwrap_or_else(|| panic!("{head}: {expected}")).to_string();
        assert!(error.contains(expected), "{head}\n{error}\nexpected: {expected}");
    };
    let raw = head("endian: little\nencoding: raw\n");
    let packed = head("endian: little\nencoding: gz\n");
    refuse(&raw, &plain[1..], "119 bytes after the header, expected 120 for 5 x 4 x 3 cells");
    refuse(&packed, &gzip(&plain[1..]), "found 119 bytes, expected 120");
    refuse(&packed, &gzip(&[&plain[..], b"x"].concat()), "found more bytes, expected 120");
    refuse(&packed, &plain, "a compressed stream (gzip)");
    let whole = gzip(&plain);
    refuse(&packed, &whole[..whole.len() / 2], "the samples");
    // More cells than any file has, more than the compressed bytes can expand to, and a stream that
    // expands too much.
    let sizes = |sizes: &str| raw.replace("5 4 3", sizes);
    refuse(&sizes("4294967296 4294967296 4294967296"), &plain, "a size in bytes that is a 64-bit number");
    refuse(&sizes("18446744073709551616 1 1"), &plain, "3 numbers of samples");
    refuse(&sizes("0 4 3"), &plain, "at least 1 each");
    refuse(&packed.replace("5 4 3", "500000 500000 400"), &whole, "compressed bytes, expected data for");
    refuse(&packed, &gzip(&vec![0; 50 << 20]), "found more bytes, expected 120");
    refuse(
        &raw.replace("\nencoding", "\nbyte skip: 18446744073709551615\nencoding"),
        &plain,
        "and 18446744073709551615 before them",
    );
    refuse(&raw.replace("\nencoding", "\nline skip: 9\nencoding"), &[b'a'; 30], "9 lines to skip");
    for (from, to, expected) in [
        ("NRRD0004", "NRRD0009", "`NRRD0001` to `NRRD0005`"),
        ("unsigned short", "block", "samples of type block"),
        ("unsigned short", "complex", "line 3: found `complex`, expected a type"),
        ("dimension: 3", "dimension: 99", "a number of axes from 1 to 16"),
        ("dimension: 3\nsizes: 5 4 3", "dimension: 2\nsizes: 5 12", "an array of 5 x 12 samples"),
        ("dimension: 3\nsizes: 5 4 3", "dimension: 4\nsizes: 5 4 3 1", "an array of 5 x 4 x 3 x 1 samples"),
        ("sizes: 5 4 3", "sizes: 5 4", "line 5: found `5 4`"),
        ("sizes: 5 4 3\n", "", "the field `sizes`"),
        ("endian: little\n", "", "the field `endian`"),
        ("endian: little", "endian: middle", "little or big"),
        ("encoding: raw", "encoding: bzip2", "unu save"),
        ("encoding: raw", "encoding: lzma", "an encoding: raw or gzip"),
        ("encoding: raw", "encoding: raw\nencoding: raw", "each field once"),
        ("encoding: raw", "encoding: raw\ndata file: LIST", "samples in several files"),
        ("encoding: raw", "encoding: raw\ndata file: x%02d.raw 1 9 1", "samples in several files"),
        ("encoding: raw", "encoding: raw\ndata file: missing.raw", "missing.raw: cannot open"),
        ("encoding: raw", "encoding: raw\nspace directions: (1,0,0) (0,1,0)", "3 vectors of three numbers"),
        ("encoding: raw", "encoding: raw\nspace directions: (1,0,0) (1,0,0) (0,0,1)", "an invertible map"),
        (
            "encoding: raw",
            "encoding: raw\nspace directions: (1,0,0) none (0,0,1)",
            "3 vectors of three numbers",
        ),
        ("encoding: raw", "encoding: raw\nspacings: 0 1 1", "an invertible map"),
        ("encoding: raw", "encoding: raw\nspacings: 1 1", "3 numbers"),
        ("encoding: raw", "encoding: raw\naxis mins: 1 1 1\naxis maxs: 2 1 2", "an invertible map"),
        ("encoding: raw", "encoding: raw\nspace units: mm", "3 strings in quotation marks"),
        ("encoding: raw", "encoding: raw\nwhat", "a field, as in `sizes: 64 64 32`"),
    ] {
        refuse(&raw.replace(from, to), &plain, expected);
    }
    let times = raw.replace(
        "dimension: 3\nsizes: 5 4 3",
        "dimension: 4\nsizes: 4 5 3 1\nkinds: domain domain domain time",
    );
    refuse(&times, &plain, "four axes that are domain domain domain time");
    refuse(&format!("{raw}{}", "#\n".repeat(1 << 20)), &plain, "more than 1 MiB");
    // Arbitrary bytes are rejected without a panic.
    let bytes = [raw.as_bytes(), b"spacings: 1 2 3\nspace units: \"a\" \"b\" \"c\"\n\n", &plain].concat();
    for place in 0..raw.len() + 40 {
        for byte in [b'\n', b'9', b'"', 0xff] {
            let mut changed = bytes.clone();
            changed[place] = byte;
            let input = directory.join("changed.nrrd");
            std::fs::write(&input, changed).unwrap();
            let _ = plan(&input, &VolumeOptions::new());
        }
    }
}
